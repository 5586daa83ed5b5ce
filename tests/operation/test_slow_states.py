"""What the filters know of a cell that is not that of their tables: capacity, sensors, hysteresis, a full cell."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from jaxmodel.case.build import preset_model
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.curves import Table
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.model.ports import Effect
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate
from jaxmodel.operation import Measured, Tuning, consistency, ekf, for_estimation, single_precision
from jaxmodel.operation.calibration import calibrated
from jaxmodel.operation.evaluation import Trial, known_of
from jaxmodel.operation.innovations import CAUTIOUS, CONSISTENT, OVERCONFIDENT
from jaxmodel.operation.kalman import expected_voltage, state_names, within_range
from jaxmodel.operation.sigma_points import cubature_filter

CELL = preset_model("lg_mj1", "cell")
TIME_S = np.arange(0.0, 7200.0, 4.0)
QUIET = Tuning(
    voltage_sd_V=2e-3, drop_share=0.0, scale_sd=0.05, offset_sd_V=1e-3, bias_sd_V=0.0, charge_sd=5e-4, current_sd=0.0
)
RUN, RUN_BY_POINTS = (eqx.filter_jit(one) for one in (ekf, cubature_filter))


def drive(model: Model, capacity: float = 1.0, seed: int = 0) -> tuple[Measured, np.ndarray]:
    """Two hours of a cell with a share of its capacity, from full: as read, and its charge."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(0.0, 2.0, TIME_S.size // 15 + 1), 15)[: TIME_S.size]
    inputs = {"current_A": current, "ambient_degC": np.full(TIME_S.size, 20.0)}
    worn = with_values(model, {"capacity_Ah": model.parameters.capacity_Ah * capacity})
    ran = simulate(worn, Profile(TIME_S, inputs))
    volts = np.asarray(ran.readings["voltage_V"]) + rng.normal(0.0, 2e-3, TIME_S.size)
    measured = Measured(*(jnp.asarray(x, dtype=float) for x in (TIME_S, *inputs.values(), volts)))
    return measured, np.asarray(ran.readings["soc"])


def with_effects(*added: Effect) -> Model:
    return eqx.tree_at(lambda m: m.effects, CELL, added, is_leaf=lambda x: isinstance(x, tuple))


def test_aged_cell_shows_its_capacity() -> None:
    """15 % of the capacity is gone: the filter finds it, and its charge is right where the count is wrong by 8 %."""
    measured, soc = drive(CELL, capacity=0.85)
    track = RUN(CELL, QUIET, measured, jnp.asarray(0.7), jnp.zeros(()))
    counted = 1.0 - (1.0 - soc[-1]) * 0.85
    assert counted - soc[-1] > 0.08
    assert float(track.capacity_scale[-1]) == pytest.approx(0.85, abs=0.04)
    assert abs(float(track.soc[-1]) - soc[-1]) < 0.01
    fixed = RUN(
        CELL, eqx.tree_at(lambda t: t.capacity_sd, QUIET, jnp.zeros(())), measured, jnp.asarray(0.7), jnp.zeros(())
    )
    assert float(jnp.abs(fixed.capacity_scale - 1.0).max()) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.7, 1.0])
def test_band_holds_the_charge_of_an_aged_cell(start: float) -> None:
    measured, soc = drive(CELL, capacity=0.9, seed=1)
    for run in (RUN, RUN_BY_POINTS):
        track = run(CELL, QUIET, measured, jnp.asarray(start), jnp.zeros(()))
        late = TIME_S > 900.0
        assert np.mean(np.abs(np.asarray(track.soc) - soc)[late] < 2.0 * np.asarray(track.sd)[late]) > 0.9


def test_offset_of_the_current_is_found() -> None:
    measured, _ = drive(CELL)
    shifted = eqx.tree_at(lambda m: m.current_A, measured, measured.current_A + 0.1)
    tuning = eqx.tree_at(lambda t: (t.capacity_sd, t.current_sd), QUIET, (jnp.asarray(0.0), jnp.asarray(0.03)))
    track = RUN(CELL, tuning, shifted, jnp.asarray(1.0), jnp.zeros(()))
    assert float(track.current_offset_A[-1]) == pytest.approx(0.1, abs=0.03)


@pytest.mark.slow
def test_filters_agree_where_the_cell_is_their_own() -> None:
    """Linearised or by sigma points: 10 % of resistance more, the start wrong by 0.3."""
    measured, soc = drive(CELL)
    tracks = [run(CELL, QUIET, measured, jnp.asarray(0.7), jnp.zeros(())) for run in (RUN, RUN_BY_POINTS)]
    late = TIME_S > 900.0
    for track in tracks:
        assert np.abs(np.asarray(track.soc) - soc)[late].max() < 0.01
    np.testing.assert_allclose(tracks[0].sd[-1], tracks[1].sd[-1], rtol=0.5)


@pytest.mark.slow
def test_state_of_hysteresis_is_carried_along() -> None:
    """A loop of 20 mV, its start unknown: without it, the voltage of its branch is wrong by up to 40 mV."""
    loop = with_effects(CATALOGUE["ocv_hysteresis"](M_V=0.02, g=40.0))
    charged = with_values(loop, {"initial_hysteresis": jnp.asarray(-1.0)})
    measured, soc = drive(charged)
    late = TIME_S > 900.0
    errors = []
    for model in (loop, CELL):
        track = RUN(model, QUIET, measured, jnp.asarray(1.0), jnp.zeros(()))
        errors.append(np.abs(np.asarray(track.soc) - soc)[late].max())
    assert errors[0] < 0.01 < errors[1]


def test_full_cell_moves_the_other_states_with_the_charge() -> None:
    """A charge of 1.1 is 1.0; what is correlated with it by 0.5 moves by half as much, and what is not, not at all."""
    moved = within_range(jnp.array([1.1, 0.0, 3.0]), jnp.array([0.02, 0.01, 0.0]), 0)
    np.testing.assert_allclose(moved, [1.0, -0.05, 3.0], atol=1e-12)
    inside = jnp.array([0.4, 0.2, 3.0])
    np.testing.assert_array_equal(within_range(inside, jnp.array([0.02, 0.01, 0.0]), 0), inside)


def test_voltage_of_the_model_rises_with_the_charge() -> None:
    """A table that falls near full is replaced by the nearest that does not; a rising one stays as it is."""
    heated = CATALOGUE["self_heating"](C_th=60.0, hA=0.1)
    kept = CATALOGUE["entropic_ocv"]()
    falls = Table([0.0, 0.4, 0.8, 0.9, 1.0], [3.0, 3.6, 4.0, 4.1, 4.0])
    model = with_effects(heated, kept)
    model = eqx.tree_at(lambda m: m.curves.ocv, model, falls, is_leaf=lambda x: isinstance(x, Table))
    made = for_estimation(model)
    np.testing.assert_allclose(made.curves.ocv.values[0, :3], [3.0, 3.6, 4.0])
    np.testing.assert_allclose(made.curves.ocv.values[0, 3:], 4.05, atol=1e-12)
    assert [effect.name for effect in made.effects] == ["entropic_ocv"]


@pytest.mark.parametrize(("sd", "verdict"), [(0.7, CAUTIOUS), (1.0, CONSISTENT), (1.4, OVERCONFIDENT)])
def test_innovations_are_tested(sd: float, verdict: str) -> None:
    found = consistency(np.random.default_rng(1).normal(0.0, sd, 2000))
    assert found.verdict == verdict
    assert found.nis == pytest.approx(sd**2, rel=0.1)
    assert found.low < 1.0 < found.high


def test_correlated_innovations_count_as_fewer() -> None:
    """With a correlation of 0.9, 2,000 squares tell as much as 210: the interval is 3 times as wide."""
    rng, r = np.random.default_rng(2), 0.9
    white = rng.normal(0.0, 1.0, 2000)
    correlated = np.empty(2000)
    correlated[0] = white[0]
    for k in range(1, 2000):
        correlated[k] = r * correlated[k - 1] + np.sqrt(1.0 - r * r) * white[k]
    wide, narrow = (found.high - found.low for found in map(consistency, (correlated, white)))
    assert wide / narrow == pytest.approx(np.sqrt((1.0 + r * r) / (1.0 - r * r)), rel=0.15)


@pytest.mark.slow
def test_float32_is_enough() -> None:
    measured, _ = drive(CELL)
    cost = single_precision(CELL, QUIET, measured, 0.7)
    assert cost.soc_error < 2e-3
    assert cost.state_bytes < 500
    assert 100.0 < cost.operations < 1e5


def test_table_is_corrected_by_runs_whose_charge_is_known() -> None:
    """A table 30 mV too high in the middle of the charge is put right within 10 mV, where the run has been."""
    measured, soc = drive(CELL)
    trial = Trial("made", measured, soc, TIME_S, (0.0, -0.3), rested=True)
    table = CELL.curves.ocv
    assert isinstance(table, Table)
    bump = 0.03 * np.exp(-(((np.asarray(table.soc) - 0.6) / 0.15) ** 2))
    wrong = eqx.tree_at(lambda m: m.curves.ocv.values, CELL, table.values + bump)
    right = calibrated(wrong, [trial])
    at = np.linspace(0.5, 0.9, 9)
    off = [[float(m.curves.ocv(jnp.asarray(s), jnp.asarray(20.0))) for s in at] for m in (CELL, wrong, right)]
    assert np.abs(np.subtract(off[1], off[0])).max() > 0.025
    assert np.abs(np.subtract(off[2], off[0])).max() < 0.01


def test_voltage_beyond_the_range_is_that_of_its_end() -> None:
    """Sigma points lie beyond a full cell: there the voltage is held, and its derivative by the charge is 0."""
    names, row = state_names(CELL), (jnp.zeros(()), jnp.asarray(20.0), jnp.asarray(4.0), jnp.zeros(()))

    def volts(soc: Array) -> Array:
        return expected_voltage(CELL, jnp.zeros(len(names)).at[names.index("soc")].set(soc), row)

    assert float(volts(jnp.asarray(1.7))) == pytest.approx(float(volts(jnp.asarray(1.001))))
    assert float(jax.grad(volts)(jnp.asarray(1.7))) == 0.0
    assert float(jax.grad(volts)(jnp.asarray(0.6))) > 0.3


def test_what_no_run_has_shown_is_unknown() -> None:
    """Below 60 % the resistance is threefold: a filter that knows that no run has been there counts, and says so."""
    table = CELL.curves.R_ints
    assert isinstance(table, Table)
    more = table.values * np.where(np.asarray(table.soc) < 0.6, 3.0, 1.0)
    measured, soc = drive(eqx.tree_at(lambda m: m.curves.R_ints.values, CELL, more))
    trial = Trial("made", measured, soc, TIME_S, (0.0,), rested=True)
    upper = dataclasses.replace(trial, soc=np.maximum(soc, 0.6))
    (known,) = known_of([trial], [upper])
    assert float(known.measured.least_soc[0]) == pytest.approx(0.6)
    tracks = [RUN(CELL, QUIET, one.measured, jnp.asarray(1.0), jnp.zeros(())) for one in (trial, known)]
    low = soc < 0.5
    errors = [np.abs(np.asarray(track.soc) - soc)[low].max() for track in tracks]
    assert errors[1] < 0.3 * errors[0]
    sds = [float(np.mean(np.asarray(track.sd)[low])) for track in tracks]
    assert sds[1] > 1.5 * sds[0]


def test_model_is_known_near_the_temperatures_of_its_runs() -> None:
    measured, soc = drive(CELL)
    trial = Trial("made", measured, soc, TIME_S, (0.0,), rested=True)
    cold = dataclasses.replace(trial, measured=eqx.tree_at(lambda m: m.degC, measured, measured.degC - 40.0))
    near = dataclasses.replace(trial, measured=eqx.tree_at(lambda m: m.degC, measured, measured.degC - 8.0))
    least = [float(one.measured.least_soc[0]) for one in known_of([trial, near, cold], [trial])]
    np.testing.assert_allclose(least, [soc.min(), soc.min(), 1.0])


def test_reference_is_as_uncertain_as_the_charge_drawn() -> None:
    soc = np.linspace(1.0, 0.2, TIME_S.size)
    trial = Trial("made", drive(CELL)[0], soc, TIME_S, (0.0,), rested=True, capacity_sd=0.02)
    np.testing.assert_allclose(trial.reference_sd[[0, -1]], [0.005, np.hypot(0.005, 0.016)])
