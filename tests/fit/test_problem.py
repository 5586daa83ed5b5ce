"""The problem of a case is the plain simulation of each of its runs; what pads it never counts."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from jaxmodel.base.errors import FitError
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case, Run
from jaxmodel.effects.battery import ArrheniusResistance, OcvHysteresis
from jaxmodel.effects.sensors import VoltageOffset
from jaxmodel.fit.candidates import make_candidate
from jaxmodel.fit.data import PIECES, collect
from jaxmodel.fit.lanes import LANES, at_places, one_thread_of_blas, predictions
from jaxmodel.fit.laws import no_laws
from jaxmodel.fit.layout import Layout, make_layout
from jaxmodel.fit.noise.instrument import NoiseModel
from jaxmodel.fit.problem import Lane, Problem, make_problem
from jaxmodel.fit.shapes import shapes_of
from jaxmodel.model.simulation import simulate
from tests.diagnosis.made_cases import case_of, run_of

PARAMETERS = {
    "capacity_Ah": Known(2.0, 0.05),
    "series_resistance_scale": Known(1.0, 0.1),
    "cycles": Known(50.0),
    "storage_months": Known(0.0),
}
CANDIDATES = [
    make_candidate(OcvHysteresis()),
    make_candidate(VoltageOffset(column="voltage_V")),
    make_candidate(ArrheniusResistance()),
]
NOISE = {
    "voltage_V": NoiseModel(0.003, 0.6, "assumed"),
    "cell_temperature_degC": NoiseModel(0.2, 0.0, "assumed"),
}
CHANNELS = ("voltage_V", "cell_temperature_degC")


def cell_run(number: int, rows: int, **options) -> Run:
    generator = np.random.default_rng(number)
    current = np.repeat(generator.uniform(-2.0, 5.0, -(-rows // 10)), 10)[:rows]
    voltage = 3.8 + 0.1 * generator.standard_normal(rows)
    voltage[generator.random(rows) < 0.2] = np.nan
    temperature = np.full(rows, 10.0 * number + 1.0)
    temperature[1::3] = np.nan
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
    layout = make_layout(case, CANDIDATES)
    return make_problem(case, layout, CANDIDATES), layout


@pytest.fixture(scope="module")
def lane(made: tuple[Problem, Layout]) -> Lane:
    """Hysteresis and offset are on, the third effect is not."""
    x = 0.5 * np.random.default_rng(0).normal(size=made[1].size)
    return Lane(x, np.array([1.0, 1.0, 0.0]), no_laws("cell"))


@pytest.fixture(scope="module")
def predicted(made: tuple[Problem, Layout], lane: Lane) -> np.ndarray:
    return predictions(made[0], [lane])[0]


def alone(case: Case, layout: Layout, lane: Lane, number: int) -> dict[str, np.ndarray]:
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
    rest = {name: parameters.pop(name) for name in ("initial_temperature_rise_K", "initial_hysteresis")}
    effects = {
        "ocv_hysteresis": {name: numbers[f"ocv_hysteresis.{name}", -1] for name in ("M_V", "g", "b")},
        "voltage_offset": {"column": "voltage_V", "c": numbers["voltage_offset:voltage_V.c", -1]},
    }
    if lane.switches[2]:
        effects["arrhenius_resistance"] = {"E_a": numbers["arrhenius_resistance.E_a", -1]}
    known = {name: Known(value) for name, value in parameters.items()}
    single = dataclasses.replace(case, parameters=known, effects=effects)
    plain = dataclasses.replace(run, overrides={}, initial_soc=soc)
    model = case_model(single, plain)
    start = [jnp.asarray(value) for value in rest.values()]
    model = eqx.tree_at(lambda m: [getattr(m.parameters, name) for name in rest], model, start)
    return {name: np.asarray(v) for name, v in simulate(model, run_profile(plain)).readings.items()}


def test_unknowns_are_what_the_case_its_runs_and_the_effects_leave_open(made: tuple[Problem, Layout]) -> None:
    layout = made[1]
    stated = list(zip(layout.names, layout.runs, layout.fixed_in, strict=True))
    assert stated[: layout.base] == [
        ("capacity_Ah", -1, (1,)),
        ("series_resistance_scale", -1, ()),
        ("initial_soc", 0, ()),
        ("capacity_Ah", 2, ()),
        ("cycles", 2, ()),
        ("initial_soc", 2, ()),
        *((name, run, ()) for run in range(3) for name in ("initial_hysteresis", "initial_temperature_rise_K")),
    ]
    first = layout.base
    assert layout.of == {
        "ocv_hysteresis": (first, first + 1, first + 2),
        "voltage_offset:voltage_V": (first + 3,),
        "arrhenius_resistance": (first + 4,),
    }
    assert layout.places_of(["arrhenius_resistance"]) == [*range(first), first + 4]
    own = layout.coordinates[3]
    assert (own.number(0.0), own.slope(0.0)) == pytest.approx((1.8, 0.1))
    # The thermometer reads 1 K more than the other: the cell may have been at rest.
    rise = layout.coordinates[layout.names.index("initial_temperature_rise_K")]
    assert rise.number(0.0) == 0.0


@pytest.mark.parametrize(
    ("read_K", "others_K", "split", "expected_K", "sd_K"),
    [
        (1.9, 0.0, "fit", 0.0, 0.5),
        (2.1, 0.0, "fit", 2.1, 0.5),
        (-2.1, 0.0, "fit", -2.1, 0.5),
        (-2.1, -1.9, "fit", 0.0, 0.5),  # the thermometer reads 2 K low in all runs, and 0.1 K more is its noise
        (1.9, 0.0, "check", 1.9, 1.9),  # whatever the thermometer is off, the start may be adjusted to it
        (9.0, 0.0, "check", 9.0, 2.0),
    ],
)
def test_a_cell_starts_at_the_ambient_temperature_or_was_warm(
    case: Case, read_K: float, others_K: float, split: str, expected_K: float, sd_K: float
) -> None:
    def reading(run: Run, above_K: float) -> Run:
        read = run.measured.inputs["ambient_degC"][0] + np.full(run.measured.time_s.size, above_K)
        measured = dataclasses.replace(run.measured, outputs={**run.measured.outputs, "cell_temperature_degC": read})
        return dataclasses.replace(run, measured=measured, initial_cell_temperature=None)

    first, *others = case.runs
    runs = (
        dataclasses.replace(reading(first, read_K), split=split),
        *(reading(run, others_K) for run in others),
    )
    layout = make_layout(dataclasses.replace(case, runs=runs), [])
    places = [p for p, name in enumerate(layout.names) if name == "initial_temperature_rise_K" and layout.runs[p] == 0]
    rise = layout.coordinates[places[0]]
    assert (rise.number(0.0), rise.slope(0.0)) == pytest.approx((expected_K, sd_K))


@pytest.mark.parametrize("number", [0, 1, 2])
def test_prediction_is_the_simulation_of_each_run(
    case: Case, made: tuple[Problem, Layout], lane: Lane, predicted: np.ndarray, number: int
) -> None:
    problem, layout = made
    rows = case.runs[number].measured.time_s.size
    for name, values in alone(case, layout, lane, number).items():
        column = predicted[number, :, problem.channels.index(name)]
        np.testing.assert_allclose(column[:rows], values, rtol=1e-11, err_msg=name)
        np.testing.assert_array_equal(column[rows:], column[rows - 1])


def test_many_lanes_are_each_as_if_alone(made: tuple[Problem, Layout], lane: Lane, predicted: np.ndarray) -> None:
    problem, _ = made
    others = [lane._replace(x=lane.x + 0.01 * number) for number in range(LANES + 3)]
    found = predictions(problem, others)
    assert found.shape == (LANES + 3, *predicted.shape)
    np.testing.assert_allclose(found[0], predicted, rtol=1e-12)
    np.testing.assert_allclose(found[-1], predictions(problem, others[-1:])[0], rtol=1e-12)
    assert not np.allclose(found[-1], found[-2], rtol=1e-9)
    places = (np.array([0, 1, 2, 1]), np.array([3, 60, 24, 0]), np.array([0, 0, 1, 1]))
    np.testing.assert_array_equal(at_places(problem, places, others), found[(slice(None), *places)])


def test_runs_by_themselves_are_simulated_as_beside_the_others(
    made: tuple[Problem, Layout], lane: Lane, predicted: np.ndarray
) -> None:
    problem, _ = made
    for runs in ([0, 1], [2]):
        part = predictions(problem.of(np.array(runs)), [lane])[0]
        np.testing.assert_allclose(part[:, :61], predicted[runs, :61], rtol=0.0, atol=1e-9)


def test_switch_turns_an_effect_on(case: Case, made: tuple[Problem, Layout], lane: Lane) -> None:
    problem, layout = made
    switched = lane._replace(switches=np.ones(3))
    on = predictions(problem, [switched])[0]
    expected = alone(case, layout, switched, 0)["voltage_V"]
    np.testing.assert_allclose(on[0, : expected.size, problem.channels.index("voltage_V")], expected, rtol=1e-11)


def test_effects_that_are_off_leave_the_base_model_to_the_bit(
    case: Case, made: tuple[Problem, Layout], lane: Lane
) -> None:
    problem, layout = made
    off = lane._replace(switches=np.zeros(3))
    far = off._replace(x=np.concatenate([lane.x[: layout.base], np.full(5, 2.0)]))
    np.testing.assert_array_equal(predictions(problem, [off]), predictions(problem, [far]))


def test_readings_are_listed_channel_by_channel_without_gaps(case: Case) -> None:
    data = collect(case, NOISE, CHANNELS, [0, 1])
    assert [series for series, _ in data.chains] == [(name, run) for name in CHANNELS for run in (0, 1)]
    for (name, run), rows in data.chains:
        measured = case.runs[run].measured
        present = np.flatnonzero(np.isfinite(measured.outputs[name]))
        np.testing.assert_array_equal(data.value[rows], measured.outputs[name][present])
        np.testing.assert_array_equal(data.row[rows], present)
        np.testing.assert_array_equal(data.time_s[rows], measured.time_s[present])
        assert set(data.sd[rows]) == {NOISE[name].sd}
        assert set(data.run[rows]) == {run}
    assert data.by_channel == {name: [rows for (own, _), rows in data.chains if own == name] for name in CHANNELS}


def test_only_given_rows_of_a_run_count(case: Case) -> None:
    data = collect(case, NOISE, CHANNELS, [0, 1], rows_of={1: slice(0, 5)})
    assert data.row[data.run == 1].max() < 5 < data.row[data.run == 0].max()


def test_blocks_are_pieces_of_runs_of_equal_time(case: Case) -> None:
    readings = collect(case, NOISE, CHANNELS, [0, 1])
    block = readings.block
    np.testing.assert_array_equal(block // PIECES, readings.run)
    for number, of_channels in readings.blocks.items():
        mine = np.concatenate([np.arange(readings.count)[rows] for rows in of_channels.values()])
        np.testing.assert_array_equal(np.sort(mine), np.flatnonzero(block == number))
        of_run = readings.time_s[readings.run == number // PIECES]
        assert np.ptp(readings.time_s[mine]) <= 1.05 / PIECES * np.ptp(of_run)
        for name, rows in of_channels.items():
            assert set(readings.channel[rows]) == {CHANNELS.index(name)}
    assert sorted(readings.blocks) == sorted(set(block))


def test_too_many_readings_are_thinned_evenly(case: Case) -> None:
    from jaxmodel.fit.settings import SETTINGS

    whole = collect(case, NOISE, CHANNELS, [0, 1])
    few = collect(case, NOISE, CHANNELS, [0, 1], settings=dataclasses.replace(SETTINGS, most_readings=50))
    assert few.count <= 60
    for (series, rows), (same, of_whole) in zip(few.chains, whole.chains, strict=True):
        assert series == same
        np.testing.assert_array_equal(few.row[rows], whole.row[of_whole][:: -(-whole.count // 50)])


def test_a_case_that_cannot_be_fitted_is_refused(case: Case) -> None:
    exact = dataclasses.replace(cell_run(1, 20), initial_soc=Known(0.9))
    with pytest.raises(FitError, match="nothing to calibrate"):
        make_layout(dataclasses.replace(case, parameters={"capacity_Ah": Known(2.0)}, runs=(exact,)), [])


def test_short_runs_have_a_program_of_their_own_where_padding_takes_longer() -> None:
    assert shapes_of([(512, 1024), (33_280, 33_792), (512, 1024)], np.array([0, 1])) == (
        (1, 512, 1024),
        (1, 33_280, 33_792),
    )
    # A check run that is little longer shares the program of the others.
    assert shapes_of([(2048, 2048), (2560, 3072)], np.array([0])) == ((1, 2560, 3072),)
    assert shapes_of([(2048, 2048), (3584, 4096)], np.array([0])) == ((1, 2048, 2048),)
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
