"""Vector instructions against XLA: the same lanes, with as many effects at once as may be combined.

Both round in their own order. A lane agrees where each of its numbers does to 1e-12. Some lanes of motors have fewer
digits than that: where friction takes the speed through zero, XLA's own numbers jump when the inputs of the lane change
by a few units in the last place. A lane that differs more is therefore judged against what XLA's numbers of that lane
change by under such nudges. A few nudges do not find every jump, so a small share of lanes may escape them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from jaxmodel.base.errors import SweepError
from jaxmodel.lanes import machine
from jaxmodel.model.names import parameter_table
from jaxmodel.model.simulation import Status
from jaxmodel.sweeps import Study, metrics_of, metrics_on_request, run

AGREES = 1e-12
# What XLA's own numbers of a lane change by where it may differ more, and the shares of lanes of motors that may do so,
# and that may although the nudges did not find their jump. Cells have no such lanes.
UNSTABLE = 1e-13
MOST_UNSTABLE, MOST_UNFOUND = 0.2, 0.01
LANES = 3_000
NUDGES = 8


@pytest.fixture(autouse=True)
def as_users_have_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not as quickly as other tests compile them."""
    monkeypatch.setattr(machine, "is_quick", lambda: False)


OF_CELL = (
    "arrhenius_resistance", "capacity_temperature", "charge_transfer", "entropic_ocv", "ocv_hysteresis",
    "rate_capacity", "resistance_ageing", "self_discharge", "self_heating", "slow_diffusion", "arrhenius_polarisation",
    "capacity_fade", "contact_drift", "contact_heating", "core_temperature", "discharge_resistance",
)  # fmt: skip
OF_MOTOR = (
    "brush_drop", "friction_temperature", "gear_loss", "magnet_temperature", "saturation", "viscous_friction",
    "windage", "brush_current_drop", "directional_friction",
)  # fmt: skip
OF_ROBOT = ("cell_imbalance", "bridge_resistance", "constant_power_load", "onboard_temperature", "pwm_ripple",
            "bridge_dead_time")  # fmt: skip

# Powers of voltages of 1e60 V cancel to nothing but rounding.
OF_STATES = [name for name in metrics_of("cell") if name != "time_to_cutoff_s"]


class Nudged(Study):
    """A study whose lanes differ by up to four units in the last place from what they should, at random."""

    _seed: int = 0

    def lanes(self, numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Return what lanes differ in, moved."""
        random = np.random.default_rng(self._seed)
        units = {name: random.integers(-4, 5, LANES)[numbers] for name in super().lanes(numbers)}
        return {name: x * (1.0 + units[name] * 2.0**-52) for name, x in super().lanes(numbers).items()}


def fields_of(kind: str, effects: tuple[str, ...], ranges: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A sample over the given ranges and over those that parameters of effects typically have."""
    fields: dict[str, Any] = {"kind": kind, "effects": {name: {} for name in effects}} | more
    base = fields | {"sample": {"count": 1, "ranges": ranges}}
    known = parameter_table(Study(**base).prepared.model)
    typical = {
        name: info.typical
        for name, info in known.items()
        if name.partition(".")[0] in effects and info.typical is not None and not info.whole
    }
    if "metrics" not in more:
        names = [*metrics_of(kind), *metrics_on_request(kind)]
        fields["metrics"] = [name for name in names if name != "time_to_cutoff_s" or "cutoff" in more]
    return fields | {"sample": {"method": "random", "count": LANES, "seed": 3, "ranges": typical | ranges}}


STUDIES = {
    "cell, all effects, cut-off": fields_of(
        "cell", OF_CELL, {"current_A": (-1.0, 8.0), "initial_soc": (0.05, 1.0), "ambient_degC": (0.0, 45.0)},
        profile={"duration_s": 1200, "step_s": 100}, store=["voltage_V"], store_every=4,
        cutoff={"soc": 0.1, "voltage_V": 3.0},
    ),
    # At 100 A the state of charge falls below -20, where the open-circuit voltage overflows.
    "cell, tables, some not finite": fields_of(
        "cell", (), {"scale.current_A": (-1.0, 25.0), "cycles": (0.0, 500.0), "initial_soc": (0.0, 1.0)},
        profile={"duration_s": 5200, "step_s": 400, "ambient_degC": 20.0, "current_A": 4.0}, fidelity="lut",
        metrics=OF_STATES, cutoff={},
    ),
    "cell, formulas, some not finite": fields_of(
        "cell", ("self_heating",), {"current_A": (-1.0, 100.0), "cycles": (0.0, 500.0), "initial_soc": (0.0, 1.0)},
        profile={"duration_s": 5200, "step_s": 400, "ambient_degC": 20.0}, metrics=OF_STATES, cutoff={},
    ),
    "motor, all effects": fields_of(
        "motor", OF_MOTOR, {"voltage_V": (-12.0, 12.0), "load_torque_Nm": (-0.1, 0.3), "R_0": (0.05, 0.3)},
        profile={"duration_s": 8, "step_s": 1, "ambient_degC": 20.0}, store=["speed_rad_s"],
    ),
    "robot, all effects, cut-off": fields_of(
        "robot", OF_CELL[:10] + OF_MOTOR + OF_ROBOT,
        {"duty": (0.05, 0.9), "load_torque_Nm": (0.0, 0.35), "initial_soc": (0.1, 1.0)},
        profile={"duration_s": 8, "step_s": 1, "ambient_degC": 20.0}, store=["soc", "pack_voltage_V"],
        cutoff={"soc": 0.2},
    ),
    "robot on slopes, friction at standstill": fields_of(
        "robot", ("stribeck_friction",), {"duty": (0.0, 0.5), "incline_deg": (-20.0, 30.0), "mass_kg": (20.0, 60.0)},
        profile={"duration_s": 4, "step_s": 0.5, "ambient_degC": 20.0},
    ),
}  # fmt: skip


def apart(one: xr.Dataset, other: xr.Dataset) -> np.ndarray:
    """The largest relative difference of each lane's numbers; infinite where only one is a number.

    Relative to the number itself, and where that is near zero to a thousandth of the largest of an ordinary lane.
    """
    worst = np.zeros(one.sizes["lane"])
    for name in one.data_vars:
        x, y = (found[name].values.reshape(worst.size, -1).astype(float) for found in (one, other))
        floor = 1e-3 * np.nanpercentile(np.abs(y), 90)
        with np.errstate(invalid="ignore"):
            difference = np.abs(x - y) / np.maximum(np.abs(y), floor)
        difference = np.where(np.isnan(x) & np.isnan(y) | (x == y), 0.0, difference)
        worst = np.maximum(worst, np.max(np.where(np.isnan(difference), np.inf, difference), axis=1))
    return worst


@pytest.mark.slow("motor, all effects", "robot on slopes, friction at standstill", "robot, all effects, cut-off")
@pytest.mark.parametrize("what", STUDIES)
def test_vector_instructions_give_what_xla_gives(what: str) -> None:
    fields = STUDIES[what]
    native, by_xla = run(Study(**fields)), run(Study(**fields), engine="xla")
    difference = apart(native, by_xla)
    differ = difference > AGREES
    if what.startswith("cell"):
        assert not differ.any()
    else:
        moved, nudged = np.zeros(LANES), Nudged(**fields)
        for nudged._seed in range(NUDGES):
            moved = np.maximum(moved, apart(run(nudged, engine="xla"), by_xla))
        found = (moved > UNSTABLE) & (difference <= 10.0 * moved)
        assert differ.mean() <= MOST_UNSTABLE
        assert (differ & ~found).mean() <= MOST_UNFOUND
        assert difference.max() <= 10.0 * moved.max()
    ended = set(np.unique(by_xla["status"]))
    expected = {Status.COMPLETE}
    expected |= {Status.REACHED_CUTOFF} if fields.get("cutoff") else set()
    expected |= {Status.NOT_FINITE, Status.IMPOSSIBLE} if "not finite" in what else set()
    assert ended == expected


# float32: error of each metric by the largest value of the study, over loads, ages and step lengths.
SINGLE_ERRORS = {
    "final_soc": 3e-7, "soc_gradient": 3e-7, "delivered_charge_Ah": 1e-6, "delivered_energy_Wh": 1e-6,
    "min_voltage_V": 1e-6, "min_pack_voltage_V": 1e-6, "mean_speed_rad_s": 1e-6, "valid_share": 1e-7,
    "final_cell_temperature_degC": 1e-6, "peak_winding_temperature_degC": 1e-6, "final_case_temperature_degC": 1e-6,
}  # fmt: skip


@pytest.mark.parametrize(("duration_s", "step_s"), [(1800, 10), (1800, 1), (18_000, 1)])
@pytest.mark.parametrize("kind", ["cell", "robot"])
def test_float32_keeps_the_digits_that_the_documentation_states(kind: str, duration_s: int, step_s: int) -> None:
    load, low, high = ("current_A", 0.05, 4.0) if kind == "cell" else ("load_torque_Nm", 0.01, 0.35)
    study = Study(
        kind=kind,  # type: ignore[arg-type]
        parameters={"capacity_Ah": 5.2 * duration_s / 1800.0},
        effects={"self_heating": {}},
        profile={"duration_s": duration_s, "step_s": step_s, "ambient_degC": 20.0}
        | ({} if kind == "cell" else {"duty": 0.3}),
        axes={load: np.linspace(low, high, 16), "cycles": [0.0, 150.0, 400.0]},
        metrics=[name for name in SINGLE_ERRORS if name in metrics_of(kind)],
    )
    exact, single = run(study), run(study.replace(precision="float32"))
    for name in exact.data_vars:
        if name != "status":
            error = float(np.abs(single[name] - exact[name]).max() / np.abs(exact[name]).max())
            assert 0.0 <= error <= SINGLE_ERRORS[str(name)], name
    assert (single["status"] == exact["status"]).all()


def test_float32_is_refused_where_it_cannot_be() -> None:
    study = Study(
        kind="cell", profile={"duration_s": 60, "ambient_degC": 20.0}, axes={"current_A": [1.0]}, precision="float32"
    )
    with pytest.raises(SweepError, match='precision: "float32" needs the vector instructions of a processor'):
        run(study, engine="xla")
