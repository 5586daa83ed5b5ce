"""A run of a motor whose voltage is not the one that is stated is told by the constants of the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.data.importing import import_case

VOLTS = (5.0, 7.0, 8.0, 9.0, 11.0)


def points(true_V: float, stated_V: float, seed: int) -> pd.DataFrame:
    """Steady points of a motor of 0.7 V s/rad and 10 ohm at several loads."""
    random = np.random.default_rng(seed)
    current = np.linspace(0.1, 0.35, 12) * true_V / 10.0 + 0.003 * random.normal(size=12)
    speed = (true_V - 10.0 * current) / 0.7 + 0.1 * random.normal(size=12)
    return pd.DataFrame({"V": stated_V, "I_A": current, "speed_rad_s": speed, "load_torque_Nm": 0.6 * current})


def findings(folder: Path, true_V: dict[float, float], stuck: int = 0) -> list[str]:
    log = pd.concat([points(true_V.get(volts, volts), volts, n) for n, volts in enumerate(VOLTS)], ignore_index=True)
    log.loc[: stuck - 1, "I_A"] = 0.9  # a meter that hangs in a few rows of the first run
    log.to_csv(folder / "points.csv", index=False)
    options = {"seconds_per_row": 10.0, "columns": {"step": "V", "voltage_V": "V"}, "split_at": "steps"}
    one = import_case(folder / "points.csv", "motor", ambient=22.0, **options)
    return [finding.sentence for finding in one.findings if finding.what == "another voltage"]


@pytest.mark.parametrize("true_V", [4.8, 10.0])
def test_another_voltage_than_stated_is_told(tmp_path: Path, true_V: float) -> None:
    (said,) = findings(tmp_path, {8.0: true_V})
    assert said.startswith("points-3: its 8 V do not fit its current and speed")
    assert float(said.split("ask for ")[1].split(" V")[0]) == pytest.approx(true_V, rel=0.03)
    assert '--rows "V != 8"' in said


def test_a_right_voltage_is_not(tmp_path: Path) -> None:
    assert not findings(tmp_path, {})
    assert not findings(tmp_path, {}, stuck=3), "single bad rows are none of the voltage"
    assert not findings(tmp_path, {volts: 0.7 * volts for volts in VOLTS}), "all of them may be right"
