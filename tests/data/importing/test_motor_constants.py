"""First values of a motor's constants: what its readings tell, with a current, with a load, with neither."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import import_case

K_TAU, R_0 = 0.8, 9.0


def swinging(path: Path, **columns: np.ndarray | float) -> Path:
    """Write the log of a geared motor that swings a pendulum: most of its voltage carries the load."""
    t = np.arange(0.0, 12.0, 0.01)
    angle = np.sin(1.3 * t)
    speed, load = 1.3 * np.cos(1.3 * t), 0.48 * np.sin(angle)
    voltage = R_0 * load / K_TAU + K_TAU * speed
    of_pendulum = {"time_s": t, "voltage_V": voltage, "speed_rad_s": speed, "load_torque_Nm": load}
    frame = pd.DataFrame(of_pendulum | columns)
    frame.to_csv(path, index=False)
    return path


def test_a_load_tells_the_resistance_where_no_current_was_read(tmp_path: Path):
    imported = import_case(swinging(tmp_path / "pendulum.csv"), "motor", ambient=25.0)
    imported.check()  # the voltage is not that of a free motor, and the readings are right
    assert imported.constants["k_tau"].value == pytest.approx(K_TAU, rel=0.01)
    assert imported.constants["R_0"].value == pytest.approx(R_0, rel=0.01)


def test_without_current_and_load_the_faster_rows_tell_the_constant(tmp_path: Path):
    t = np.arange(0.0, 12.0, 0.01)
    free = {"voltage_V": 2.0 + t, "speed_rad_s": (2.0 + t) / K_TAU, "load_torque_Nm": 0.0}
    imported = import_case(swinging(tmp_path / "free.csv", **free), "motor", ambient=25.0)
    assert imported.constants["k_tau"].value == pytest.approx(K_TAU)
    assert "R_0" not in imported.constants


def test_a_constant_that_no_motor_has_names_the_columns_and_not_itself(tmp_path: Path):
    """A duty cycle of 16 bits divided by 65535 twice: the user stated no k_tau that could be corrected."""
    t = np.arange(0.0, 12.0, 0.01)
    free = {"voltage_V": 4e-5 + 1e-6 * t, "speed_rad_s": 2000.0 + t, "load_torque_Nm": 0.0}
    with pytest.raises(MeasurementError, match=r"voltage of at most 5\.2e-05 V .* --column"):
        import_case(swinging(tmp_path / "tiny.csv", **free), "motor", ambient=25.0)
