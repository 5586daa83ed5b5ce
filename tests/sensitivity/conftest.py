"""A short, smooth run of each kind: the cell with all its effects, every sensor's among them, the drives with some.

That each effect's own derivatives are right is tested on the model itself (tests/model/test_derivatives.py), but for
the brush drop's; here, that effects of any kind go through metrics, inputs and curves. All of a robot's would compile
three times as long.
"""

from __future__ import annotations

import pytest

from jaxmodel.effects import CATALOGUE
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import Effect
from jaxmodel.model.profile import Profile, constant
from jaxmodel.sensitivity.response import Response, make_response

# Off the kinks: a shift by a whole number of rows, or a start at full charge, has one derivative to each side.
OFF_A_ROW = {"clock_shift": {"d": 0.4}}
SENSOR_COLUMNS = {
    "current_offset": "current_A",
    "voltage_gain": "voltage_V",
    "voltage_offset": "voltage_V",
    "temperature_lag": "cell_temperature_degC",
    "clock_shift": "",
    "current_gain": "current_A",
    "temperature_offset": "cell_temperature_degC",
    "temperature_gain": "cell_temperature_degC",
    "chamber_offset": "ambient_degC",
}

OF_DRIVES = {"motor": ("magnet_temperature", "brush_drop"), "robot": ("bridge_resistance", "pwm_ripple")}

PROFILES = {
    "cell": constant(12.0, 1.0, current_A=4.0, ambient_degC=12.0),
    "motor": constant(12.0, 1.0, voltage_V=3.0, load_torque_Nm=0.05, ambient_degC=12.0),
    "robot": constant(
        12.0,
        1.0,
        duty=0.2,
        incline_deg=5.0,
        acceleration_m_s2=0.1,
        flipper_torque_Nm=0.1,
        flipper_duty=0.3,
        arm_torque_Nm=0.05,
        arm_duty=0.1,
        ambient_degC=12.0,
    ),
}


def effects_of(kind: str) -> tuple[Effect, ...]:
    names = OF_DRIVES.get(kind, [name for name, cls in CATALOGUE.items() if kind in cls.kinds])
    chosen = []
    for name in names:
        sensor = {"column": SENSOR_COLUMNS[name]} if CATALOGUE[name].is_sensor else {}
        chosen.append(CATALOGUE[name](**OFF_A_ROW.get(name, {}), **sensor))
    return tuple(chosen)


def model_of(kind: str, **parameters: float) -> Model:
    # At standstill friction has a kink: there no reading has a derivative by the speed.
    begins = {"initial_soc": 0.9, "initial_speed_rad_s": 30.0}
    return Model(kind, Parameters(**(begins | parameters)), effects=effects_of(kind))


@pytest.fixture(scope="session", params=["cell", "motor", "robot"])
def kind(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="session")
def model(kind: str) -> Model:
    return model_of(kind)


@pytest.fixture(scope="session")
def profiles() -> dict[str, Profile]:
    return PROFILES


@pytest.fixture(scope="session")
def profile(kind: str) -> Profile:
    return PROFILES[kind]


@pytest.fixture(scope="session")
def response(model: Model, profile: Profile) -> Response:
    return make_response(model, profile)
