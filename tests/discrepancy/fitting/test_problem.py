"""The problem of a case is the plain simulation of each of its runs, whitened; what pads it never counts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from discrepancy.candidates import make_candidate
from discrepancy.lanes import LANES, one_thread_of_blas, predict, predictions, residuals
from discrepancy.noise import NoiseModel
from discrepancy.problem import Lane, Layout, Problem, make_layout, make_problem
from discrepancy.shapes import shapes_of
from discrepancy.whitening import whiten
from jaxmodel.build import case_model, run_profile
from jaxmodel.cases import Case, Known, Run
from jaxmodel.effects.battery import ArrheniusResistance, OcvHysteresis
from jaxmodel.effects.drive import ViscousFriction
from jaxmodel.effects.sensors import VoltageOffset
from jaxmodel.errors import FitError
from jaxmodel.simulate import simulate
from tests.discrepancy.made_cases import case_of, run_of

PARAMETERS = {
    "capacity_Ah": Known(2.0, 0.05),
    "series_resistance_scale": Known(1.0, 0.1),
    "cycles": Known(50.0),
    "storage_months": Known(0.0),
}
PRESENT = [make_candidate(OcvHysteresis()), make_candidate(VoltageOffset(column="voltage_V"))]
SWITCHED = [make_candidate(ArrheniusResistance())]
NOISE = {
    "voltage_V": NoiseModel(0.003, 0.6, "assumed"),
    "cell_temperature_degC": NoiseModel(0.2, 0.0, "assumed"),
}


def cell_run(number: int, rows: int, **options) -> Run:
    generator = np.random.default_rng(number)
    current = np.repeat(generator.uniform(-2.0, 5.0, -(-rows // 10)), 10)[:rows]
    voltage = 3.8 + 0.1 * generator.standard_normal(rows)
    voltage[generator.random(rows) < 0.2] = np.nan
    temperature = np.full(rows, 12.0)
    temperature[::3] = np.nan
    inputs = {"current_A": current, "ambient_degC": np.full(rows, 10.0 * number)}
    return run_of(number, inputs, {"voltage_V": voltage, "cell_temperature_degC": temperature}, **options)


@pytest.fixture(scope="module")
def case() -> Case:
    """Three runs of different length: the second has cells known exactly to be older, the third roughly other ones."""
    return case_of(
        "cell",
        PARAMETERS,
        [
            cell_run(1, 40),
            cell_run(2, 61, capacity_Ah=Known(1.6), cycles=Known(300.0), initial_soc=Known(0.7)),
            cell_run(3, 25, split="check", capacity_Ah=Known(1.8, 0.1), cycles=Known(400.0, 20.0)),
        ],
    )


@pytest.fixture(scope="module")
def made(case: Case) -> tuple[Problem, Layout]:
    return make_problem(case, NOISE, PRESENT, SWITCHED)


@pytest.fixture(scope="module")
def lane(made: tuple[Problem, Layout]) -> Lane:
    x = np.random.default_rng(0).normal(size=len(made[1].names))
    return Lane(x, np.zeros(1))


@pytest.fixture(scope="module")
def predicted(made: tuple[Problem, Layout], lane: Lane) -> np.ndarray:
    return predictions(made[0], [lane])[0]


def alone(case: Case, layout: Layout, lane: Lane, number: int, *, switch: float = 0.0) -> dict[str, np.ndarray]:
    """Simulate one run by itself, under the numbers that its user would give it."""
    numbers = {
        (name, run): coordinate.number(float(x))
        for name, run, coordinate, x in zip(layout.names, layout.runs, layout.coordinates, lane.x, strict=True)
    }
    run = case.runs[number]
    parameters = {name: known.value for name, known in case.parameters.items()}
    parameters |= {name: value for (name, where), value in numbers.items() if where == -1 and "." not in name}
    parameters |= {name: known.value for name, known in run.overrides.items()}
    parameters |= {name: value for (name, where), value in numbers.items() if where == number}
    soc = Known(parameters.pop("initial_soc", run.initial_soc.value))
    effects = {
        "ocv_hysteresis": {"M_V": numbers["ocv_hysteresis.M_V", -1], "g": numbers["ocv_hysteresis.g", -1]},
        "voltage_offset": {"column": "voltage_V", "c": numbers["voltage_offset:voltage_V.c", -1]},
    }
    if switch:
        effects["arrhenius_resistance"] = {"E_a": switch * numbers["arrhenius_resistance.E_a", -1]}
    known = {name: Known(value) for name, value in parameters.items()}
    single = dataclasses.replace(case, parameters=known, effects=effects)
    plain = dataclasses.replace(run, overrides={}, initial_soc=soc)
    return {name: np.asarray(v) for name, v in simulate(case_model(single, plain), run_profile(plain)).readings.items()}


def test_unknowns_are_what_the_case_its_runs_and_the_effects_leave_open(case: Case) -> None:
    layout = make_layout(case, [*PRESENT, *SWITCHED])
    stated = list(zip(layout.names, layout.runs, layout.fixed_in, strict=True))
    assert stated[: layout.base] == [
        ("capacity_Ah", -1, (1,)),
        ("series_resistance_scale", -1, ()),
        ("initial_soc", 0, ()),
        ("capacity_Ah", 2, ()),
        ("cycles", 2, ()),
        ("initial_soc", 2, ()),
    ]
    assert layout.of_effect == {
        "ocv_hysteresis": (6, 7),
        "voltage_offset:voltage_V": (8,),
        "arrhenius_resistance": (9,),
    }
    own = layout.coordinates[3]
    assert (own.number(0.0), own.slope(0.0)) == pytest.approx((1.8, 0.1))


@pytest.mark.parametrize("number", [0, 1, 2])
def test_prediction_is_the_simulation_of_each_run(
    case: Case, made: tuple[Problem, Layout], lane: Lane, predicted: np.ndarray, number: int
) -> None:
    problem, layout = made
    rows = case.runs[number].measured.time_s.size
    for name, values in alone(case, layout, lane, number).items():
        column = predicted[number, :, problem.channels.index(name)]
        np.testing.assert_allclose(column[:rows], values, rtol=1e-12, err_msg=name)
        np.testing.assert_array_equal(column[rows:], column[rows - 1])


def test_many_lanes_are_each_as_if_alone(made: tuple[Problem, Layout], lane: Lane, predicted: np.ndarray) -> None:
    problem, _ = made
    others = [Lane(lane.x + 0.01 * number, lane.switches) for number in range(LANES + 3)]
    found = predictions(problem, others)
    assert found.shape == (LANES + 3, *predicted.shape)
    np.testing.assert_allclose(found[0], predicted, rtol=1e-12)
    np.testing.assert_allclose(found[-1], predictions(problem, others[-1:])[0], rtol=1e-12)
    assert not np.allclose(found[-1], found[-2], rtol=1e-9)


def test_runs_to_be_judged_are_simulated_by_themselves_as_beside_the_others(
    made: tuple[Problem, Layout], lane: Lane
) -> None:
    problem, _ = made
    for split in ("fit", "check"):
        part, counted = problem.only(split), np.asarray(getattr(problem.readings, split)) > 0.0
        alone = residuals(part, [lane])[0][np.asarray(getattr(part.readings, split)) > 0.0]
        np.testing.assert_allclose(alone, residuals(problem, [lane])[0][counted], rtol=0.0, atol=1e-9)


def test_what_is_added_to_an_input_is_that_input(case: Case, made: tuple[Problem, Layout], lane: Lane) -> None:
    problem = made[0].only("fit")
    inputs = problem.courses.inputs
    half = dataclasses.replace(problem.courses, inputs=inputs | {"current_A": 0.5 * np.asarray(inputs["current_A"])})
    more = dataclasses.replace(lane, added={"current_A": 0.5 * np.asarray(inputs["current_A"])})
    np.testing.assert_allclose(
        predictions(dataclasses.replace(problem, courses=half), [more])[0], predictions(problem, [lane])[0], rtol=1e-12
    )


def test_short_runs_beside_long_ones_are_simulated_as_if_alone() -> None:
    """Padded to the long run they would take most of the time; where that is much they have a program of their own."""
    runs = [cell_run(1, 40), cell_run(2, 33_000), cell_run(3, 25, split="check")]
    case = case_of("cell", PARAMETERS, runs)
    problem, layout = make_problem(case, NOISE, PRESENT)
    assert problem.shapes == ((1, 512, 1024), (1, 33_280, 33_792))
    x = np.random.default_rng(1).normal(size=len(layout.names))
    together = predict(problem, x)
    lane = Lane(x, np.zeros(0))
    for number, run in enumerate(runs):
        rows = run.measured.time_s.size
        expected = alone(case, layout, lane, number)["voltage_V"]
        np.testing.assert_allclose(together[number, :rows, problem.channels.index("voltage_V")], expected, rtol=1e-9)
    part = problem.only("fit")
    more = {"current_A": 0.01 * np.ones(part.courses.inputs["current_A"].shape)}
    courses = dataclasses.replace(
        part.courses, inputs=part.courses.inputs | {"current_A": part.courses.inputs["current_A"] + 0.01}
    )
    added = residuals(part, [dataclasses.replace(lane, added=more)])
    np.testing.assert_allclose(added, residuals(dataclasses.replace(part, courses=courses), [lane]), atol=1e-8)


def test_switch_turns_an_effect_on(case: Case, made: tuple[Problem, Layout], lane: Lane) -> None:
    problem, layout = made
    on = predictions(problem, [Lane(lane.x, np.ones(1))])[0]
    expected = alone(case, layout, lane, 0, switch=1.0)["voltage_V"]
    np.testing.assert_allclose(on[0, : expected.size, problem.channels.index("voltage_V")], expected, rtol=1e-12)


def test_other_runs_change_nothing(case: Case, made: tuple[Problem, Layout], lane: Lane) -> None:
    problem, layout = made
    first_only = dataclasses.replace(case, runs=case.runs[:1])
    single, of_single = make_problem(first_only, NOISE, PRESENT, SWITCHED)
    places = {unknown: place for place, unknown in enumerate(zip(layout.names, layout.runs, strict=True))}
    x = [float(lane.x[places[unknown]]) for unknown in zip(of_single.names, of_single.runs, strict=True)]
    left = residuals(single, [Lane(np.array(x), lane.switches)])[0]
    counted = np.asarray(single.readings.fit) > 0.0
    together = residuals(problem, [lane])[0]
    first_run = np.asarray(problem.readings.index) < problem.times.shape[1] * len(problem.channels)
    in_first = first_run & (np.asarray(problem.readings.fit) > 0.0)
    np.testing.assert_allclose(together[in_first], left[counted], rtol=0.0, atol=1e-9)


def test_residual_is_whitened_channel_by_channel_with_its_gaps(
    case: Case, made: tuple[Problem, Layout], lane: Lane, predicted: np.ndarray
) -> None:
    problem, _ = made
    expected, is_fit = [], []
    for name, model in NOISE.items():
        place = problem.channels.index(name)
        for number, run in enumerate(case.runs):
            errors = run.measured.outputs[name] - predicted[number, : run.measured.time_s.size, place]
            present = np.isfinite(errors)
            start = np.arange(errors.size) == 0
            expected.append(whiten(errors, start, model.rho, model.sd, present)[present])
            is_fit.append(np.full(present.sum(), run.split == "fit"))
    expected, is_fit = np.concatenate(expected), np.concatenate(is_fit)
    residual = residuals(problem, [lane])[0]
    np.testing.assert_allclose(residual[: expected.size], expected, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(np.asarray(problem.readings.fit)[: expected.size], is_fit)
    np.testing.assert_array_equal(np.asarray(problem.readings.check)[: expected.size], ~is_fit)
    assert residual.size > expected.size
    assert not np.any(np.asarray(problem.readings.fit)[expected.size :])
    assert not np.any(np.asarray(problem.readings.check)[expected.size :])


def test_noise_before_a_pause_says_nothing_of_noise_after_it(case: Case) -> None:
    first = case.runs[0]
    later = np.where(np.arange(first.measured.time_s.size) < 20, 0.0, 3600.0)
    paused = dataclasses.replace(first.measured, time_s=first.measured.time_s + later)
    gap = dataclasses.replace(case, runs=(dataclasses.replace(first, measured=paused),))
    (whole, _), (parted, _) = (
        make_problem(dataclasses.replace(case, runs=(one.runs[0],)), NOISE) for one in (case, gap)
    )
    read = np.flatnonzero(np.isfinite(paused.outputs["voltage_V"]))
    weights = [np.asarray(problem.readings.weight)[: read.size] for problem in (whole, parted)]
    assert np.flatnonzero(weights[0] != weights[1]).tolist() == [np.searchsorted(read, 20)]
    assert weights[1][np.searchsorted(read, 20)] == 0.0


def test_motor_runs_of_different_grids_are_simulated_as_if_alone() -> None:
    def run(number: int, rows: int, jumps: int) -> Run:
        voltage = np.repeat(np.linspace(2.0, 8.0, jumps), -(-rows // jumps))[:rows]
        inputs = {"voltage_V": voltage, "load_torque_Nm": np.full(rows, 0.02), "ambient_degC": np.full(rows, 20.0)}
        return run_of(number, inputs, {"speed_rad_s": np.zeros(rows)}, step_s=0.1)

    case = case_of("motor", {"R_0": Known(0.1, 0.01)}, [run(1, 30, 2), run(2, 21, 7)])
    friction = make_candidate(ViscousFriction())
    problem, layout = make_problem(case, {"speed_rad_s": NoiseModel(0.1, 0.0, "assumed")}, [friction])
    assert (layout.names, layout.base) == (("R_0", "viscous_friction.b"), 1)
    x = np.array([0.7, -0.4])
    found = predict(problem, x)
    resistance, b = (coordinate.number(place) for coordinate, place in zip(layout.coordinates, x, strict=True))
    given = dataclasses.replace(case, parameters={"R_0": Known(resistance)}, effects={"viscous_friction": {"b": b}})
    truth = simulate(case_model(given), run_profile(given.runs[1])).readings
    for place, name in enumerate(problem.channels):
        np.testing.assert_allclose(found[1, :21, place], truth[name], rtol=1e-9, atol=1e-12, err_msg=name)


def test_what_cannot_be_fitted_is_said(case: Case) -> None:
    exact = dataclasses.replace(cell_run(1, 20), initial_soc=Known(0.9))
    with pytest.raises(FitError, match="nothing to calibrate"):
        make_layout(dataclasses.replace(case, parameters={"capacity_Ah": Known(2.0)}, runs=(exact,)), [])
    judged = dataclasses.replace(case.runs[0], split="check")
    with pytest.raises(FitError, match='split = "fit"'):
        make_problem(dataclasses.replace(case, runs=(judged,)), NOISE)


def test_a_run_that_only_judges_and_is_little_longer_shares_the_program_of_the_others() -> None:
    def of(judged: int) -> tuple[Case, Problem, Layout]:
        case = case_of("cell", PARAMETERS, [cell_run(1, 2000), cell_run(2, judged, split="check")])
        return case, *make_problem(case, NOISE, PRESENT)

    case, problem, layout = of(2500)
    assert problem.shapes == ((1, 2560, 3072),)
    assert {(part.times.shape, part.courses.duration_s.shape) for _, part in problem.blocks} == {((1, 2560), (1, 3072))}
    lane = Lane(np.random.default_rng(1).normal(size=len(layout.names)), np.zeros(0))
    together = predictions(problem, [lane])[0]
    for number, run in enumerate(case.runs):
        expected = alone(case, layout, lane, number)["voltage_V"]
        column = together[number, : run.measured.time_s.size, problem.channels.index("voltage_V")]
        np.testing.assert_allclose(column, expected, rtol=1e-9)
    assert of(3500)[1].shapes == ((1, 2048, 2048),)
    long = [(71_680, 71_680)] * 3 + [(102_400, 102_400)]
    assert shapes_of(long, np.arange(3)) == ((3, 71_680, 71_680),), "so many steps are worth a program"


def test_blas_has_one_thread_while_fits_have_them_all() -> None:
    def threads() -> list[int]:
        return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]

    @one_thread_of_blas
    def within(fails: bool) -> list[int]:
        if fails:
            raise FitError("no")
        return threads()

    with threadpool_limits(limits=2, user_api="blas"):
        assert set(threads()) == {2}
        assert set(within(False)) == {1}
        assert set(threads()) == {2}
        with pytest.raises(FitError, match="no"):
            within(True)
        assert set(threads()) == {2}
