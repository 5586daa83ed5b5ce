"""Where the energy goes: it is all accounted for, whatever effects are on, and the metrics are what they say."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from jaxmodel.sweeps import Study, metrics_on_request, percentiles, run
from jaxmodel.sweeps.metrics import Ratio
from jaxmodel.sweeps.power import LOSSES

EFFECTS = {
    "ocv_hysteresis": {}, "slow_diffusion": {}, "saturation": {}, "viscous_friction": {}, "stribeck_friction": {},
    "gear_loss": {}, "bridge_resistance": {}, "onboard_temperature": {},
}  # fmt: skip
MORE = ["delivered_energy_Wh", "mean_speed_rad_s", "soc_gradient"]


def balance(kind: str) -> Ratio:
    """All losses and the work over what the source gave."""
    return Ratio("balance", "", "energy accounted for", (kind,), (*LOSSES[kind], "work_W"), ("source_W",))


def shares_of(kind: str) -> list[str]:
    return [name for name in metrics_on_request(kind) if name.startswith("loss_share")]


@pytest.fixture(scope="module")
def robots() -> xr.Dataset:
    """A start, a slower stretch, then zero duty and load: at the end nothing is stored in rotor and coil."""
    segments = [(60, 0.4, 0.2), (60, 0.3, 0.1), (20, 0.0, 0.0)]
    mission = [{"duration_s": t, "duty": duty, "load_torque_Nm": load} for t, duty, load in segments]
    return run(
        Study(
            kind="robot",
            effects=EFFECTS,
            profile={"mission": mission, "ambient_degC": 20.0, "flipper_torque_Nm": 0.05, "flipper_duty": 0.2},
            axes={"scale.load_torque_Nm": [0.5, 1.0], "bridge_resistance.R_on": [0.0, 0.05]},
            metrics=[*metrics_on_request("robot"), "distance_m", "energy_per_metre_J", *MORE, balance("robot")],
            store=["soc"],
        )
    )  # fmt: skip


def test_all_energy_of_a_robot_is_accounted_for(robots):
    """Up to the trapezium rule over the steps of a start, which are a quarter of L/R and grow."""
    np.testing.assert_allclose(robots["balance"], 1.0, atol=2e-4)


def test_shares_of_the_losses_add_up_and_follow_their_cause(robots):
    total = sum(robots[name] for name in shares_of("robot"))
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)
    assert np.all(robots["loss_share_electronics"].diff("bridge_resistance.R_on") > 0.0)
    assert np.all(robots["loss_share_copper"].diff("scale.load_torque_Nm") > 0.0)
    lost = robots["balance"] - robots["efficiency"]
    assert np.all((lost > 0.0) & (robots["efficiency"] > 0.0))


def test_energy_per_metre_is_energy_over_way(robots):
    """Way = mean speed x time x r / G; every lane drives forward only."""
    metres = robots["mean_speed_rad_s"] * 140.0 * 0.1 / 156.0
    np.testing.assert_allclose(robots["distance_m"], metres, rtol=1e-9)
    np.testing.assert_allclose(robots["energy_per_metre_J"], 3600.0 * robots["delivered_energy_Wh"] / metres, rtol=1e-9)


def test_fitted_gradient_is_the_line_through_the_rows(robots):
    soc = robots["soc"].stack(lane=("scale.load_torque_Nm", "bridge_resistance.R_on")).to_numpy()
    slopes = np.polyfit(robots["time_s"], soc, 1)[0]
    np.testing.assert_allclose(robots["soc_gradient_fitted"].values.ravel(), slopes, rtol=1e-9)
    assert np.all(np.abs(robots["soc_gradient_fitted"] / robots["soc_gradient"] - 1.0) > 1e-3)


def test_a_robot_that_stands_has_no_energy_per_metre():
    standing = {"duration_s": 5, "ambient_degC": 20.0, "duty": 0.0, "load_torque_Nm": 0.0}
    result = run(
        Study(kind="robot", profile=standing, axes={"cycles": [0.0]}, metrics=["energy_per_metre_J", "efficiency"])
    )
    assert np.isnan(result["energy_per_metre_J"]).all()
    np.testing.assert_array_equal(result["efficiency"], 0.0)


def test_a_cell_at_rest_in_its_pairs_loses_by_ohm_alone_at_first(cell_study):
    """Over a first millisecond the RC pairs are empty: efficiency = V / V_oc, all losses i^2 R."""
    profile = {"duration_s": 0.001, "step_s": 0.001, "ambient_degC": 20.0}
    metrics = ["efficiency", *shares_of("cell"), "min_voltage_V", balance("cell")]
    result = run(cell_study(profile=profile, axes={"current_A": [0.5, 2.0]}, metrics=metrics))
    full_V = 3.685 + 0.2156 - 0.1178 + 0.3201 - 1.031 * np.exp(-35.0)
    np.testing.assert_allclose(result["efficiency"], result["min_voltage_V"] / full_V, rtol=1e-6)
    np.testing.assert_allclose(result["loss_share_ohmic"], 1.0, atol=1e-4)
    np.testing.assert_allclose(result["balance"], 1.0, rtol=1e-12)


@pytest.mark.parametrize("drive", [{"voltage_V": 12.0}, {"current_A": 3.0}])
def test_all_energy_of_a_motor_is_accounted_for(drive):
    """At a steady load: what the terminals give is copper, friction and work, once the rotor has its speed."""
    profile = {"duration_s": 600, "step_s": 10, "ambient_degC": 20.0, "load_torque_Nm": 0.1, **drive}
    if "current_A" in drive:
        profile["load_torque_Nm"] = 3.0 * 0.0385 - 0.01  # no torque left to speed up: it stands
    metrics = ["efficiency", *shares_of("motor"), balance("motor")]
    result = run(Study(kind="motor", profile=profile, axes={"R_0": [0.1, 0.2]}, metrics=metrics))
    np.testing.assert_allclose(result["balance"], 1.0, atol=1e-3)
    np.testing.assert_allclose(sum(result[name] for name in shares_of("motor")), 1.0, rtol=1e-12)


def test_percentiles_are_over_lanes_with_a_value(robots):
    found = percentiles(robots, (0, 50, 100))
    values = robots["efficiency"].values
    np.testing.assert_allclose(found["efficiency"], [values.min(), np.median(values), values.max()])
    assert "soc" not in found
    spoiled = robots.assign(efficiency=robots["efficiency"].where(robots["efficiency"] > values.min()))
    assert percentiles(spoiled, (0,))["efficiency"].item() == np.sort(values.ravel())[1]
