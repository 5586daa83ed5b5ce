"""Small studies that several tests look at, each run once."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import xarray as xr

from jaxmodel.sweeps import Study, run


@pytest.fixture(scope="session")
def robot_study() -> Study:
    """A robot that drains from half charge until it is cut off, or not; at 100 degC its equations make no sense."""
    return Study(
        kind="robot",
        parameters={"initial_soc": 0.5, "capacity_Ah": 0.5},
        effects={"ocv_hysteresis": {"M_V": 0.02, "g": 60.0}},
        profile={"duration_s": 240, "step_s": 2, "duty": 0.3},
        axes={
            "ambient_degC": [-20.0, 100.0],
            "load_torque_Nm": [0.0, 0.25, 0.35],
            "ocv_hysteresis.M_V": [0.0, 0.03],
        },
        store=["soc", "pack_voltage_V"],
        store_every=30,
        cutoff={"soc": 0.3},
    )


@pytest.fixture(scope="session")
def robot_result(robot_study: Study) -> xr.Dataset:
    return run(robot_study)


@pytest.fixture(scope="session")
def cell_study() -> Callable[..., Study]:
    """A cell at constant current; what is given replaces a part of it."""

    def build(**changes) -> Study:
        fields = {
            "kind": "cell",
            "profile": {"duration_s": 600, "step_s": 10, "ambient_degC": 20.0},
            "axes": {"current_A": [0.5, 1.0, 2.0], "storage_months": [0.0, 18.0, 36.0]},
            "metrics": ["soc_gradient", "delivered_charge_Ah", "min_voltage_V"],
        }
        return Study(**(fields | changes))

    return build
