"""A cell of known truth is recovered from its readings, each number within its stated interval."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Known, Table, read_case, simulate_case
from jaxmodel.base.errors import FitError, MeasurementError
from jaxmodel.parameterisation import Parameterisation, parameterise
from jaxmodel.parameterisation.cell import _as_new
from jaxmodel.parameterisation.resistance import typical_ohm
from jaxmodel.parameterisation.rows import rows_of
from jaxmodel.parameterisation.thermal_start import bounded
from jaxmodel.plots.style import new_figure
from tests.parameterisation import made

SIGMAS = 4.0


@pytest.fixture(scope="module")
def found() -> Parameterisation:
    effects = {"arrhenius_resistance": {"E_a": made.ENERGY}}
    frames = {"slow": made.slow(1.0), "cold": made.pulses(5.0), "warm": made.pulses(25.0), "drive": made.drive(15.0)}
    return parameterise(made.raw_cell(made.measured(frames, effects=effects), check=["drive"]))


@pytest.fixture(scope="module")
def heated() -> Parameterisation:
    effects = {"self_heating": {"C_th": 60.0, "hA": 0.2}}
    frames = {
        "slow": made.slow(1.0),
        "pulses": made.pulses(25.0),
        "fast": made.drive(25.0).assign(current_A=6.0).iloc[:1000],
    }
    return parameterise(made.raw_cell(made.measured(frames, thermometer=True, effects=effects)))


def factor(degC: float) -> float:
    return float(np.exp(made.ENERGY / 8.314 * (1.0 / (degC + 273.15) - 1.0 / 293.15)))


def test_capacity_is_that_of_the_slow_discharge(found: Parameterisation) -> None:
    one = found["capacity_Ah"]
    assert one.found
    assert one.runs == ("slow",)
    assert abs(one.value - made.CAPACITY_AH) < SIGMAS * one.sd


@pytest.mark.parametrize("degC", [5.0, 25.0])
def test_series_resistance_and_open_circuit_voltage_are_recovered(found: Parameterisation, degC: float) -> None:
    for soc in (0.2, 0.5, 0.9):
        series = found[f"R_ints at SOC {soc:g}, {degC:g} degC"]
        assert abs(series.value - made.R_0 * factor(degC)) < SIGMAS * series.sd + 0.02 * made.R_0
        voltage = found[f"ocv at SOC {soc:g}, {degC:g} degC"]
        assert abs(voltage.value - made.open_V(np.array(soc))) < SIGMAS * voltage.sd + 0.002


def test_pairs_are_recovered(found: Parameterisation) -> None:
    for name, truth in (("short", made.TAU_S), ("long", made.TAU_L)):
        one = found[f"time constant, {name} pair"]
        truth = truth * factor(25.0)  # time constants are those at 25 degC
        assert abs(one.value - truth) < SIGMAS * one.sd + 0.03 * truth
    for name, ohm in (("R_TS", made.R_S), ("R_TL", made.R_L)):
        one = found[f"{name} at SOC 0.5, 25 degC"]
        assert abs(one.value - ohm * factor(25.0)) < SIGMAS * one.sd + 0.03 * ohm


def test_activation_energies_are_recovered(found: Parameterisation) -> None:
    for name in ("R_ints", "R_TS", "R_TL"):
        one = found[f"activation energy of {name}"]
        assert abs(one.value - made.ENERGY) < SIGMAS * one.sd + 500.0


def test_noise_is_recovered(found: Parameterisation) -> None:
    one = found["noise of voltage_V"]
    assert abs(one.value - made.NOISE_V) < SIGMAS * one.sd


def test_a_run_that_was_not_used_is_predicted_to_a_few_millivolts(found: Parameterisation) -> None:
    row = found.errors.set_index("run").loc["drive"]
    assert row["split"] == "check"
    assert row["rms"] < 0.004


def test_first_sample_is_an_upper_bound_of_the_series_resistance(found: Parameterisation) -> None:
    one = found["first-sample resistance at 25 degC"]
    assert made.R_0 * factor(25.0) < one.value + one.sd
    assert one.value < (made.R_0 + made.R_S) * factor(25.0)


def test_check_runs_are_not_used(found: Parameterisation) -> None:
    assert all("drive" not in one.runs for one in found.extractions)
    stated = {run.name: run.initial_soc.value for run in found.case.runs}
    assert stated["drive"] == 1.0


def test_what_the_data_cannot_give_is_said_with_a_test_that_would_give_it(found: Parameterisation) -> None:
    missing = {one.name: one for one in found.extractions if not one.found}
    assert "C_th and hA" in missing
    assert "thermometer" in missing["C_th and hA"].test
    assert "hysteresis" in missing
    assert "self_heating" not in found.case.effects


@pytest.mark.slow
def test_heat_capacity_and_transfer_are_recovered(heated: Parameterisation) -> None:
    for name, truth in (("C_th", 60.0), ("hA", 0.2)):
        assert abs(heated[name].value - truth) < SIGMAS * heated[name].sd
    assert set(heated.case.effects["self_heating"]) == {"C_th", "hA"}


def test_a_start_that_cannot_be_is_counted_back_and_no_table_leaves_0_to_1(tmp_path: Path) -> None:
    frames = made.measured({"slow": made.slow(1.0), "pulses": made.pulses(25.0)})
    found = parameterise(made.raw_cell(frames, starts={"slow": 0.6}))  # a discharge of the whole capacity from SOC 1
    (remark,) = (one for one in found.remarks if one.code == "start_counted_back")
    assert (remark.subject, remark.numbers["stated"]) == ("initial_soc@slow", 0.6)
    again = read_case(found.write(tmp_path / "out", pictures=False))
    # What defines the capacity is a start from full, which is not stated: the run ends empty by the stated capacity.
    drawn_Ah = float(np.sum(frames["slow"]["current_A"])) * 120.0 / 3600.0
    assert abs(again.runs[0].initial_soc.value - drawn_Ah / found["capacity_Ah"].value) < 0.01
    for table in again.tables.values():
        assert table.soc[0] >= 0.0
        assert table.soc[-1] <= 1.0


@pytest.mark.parametrize(("read", "C_th"), [(300.0, 120.0), (10.0, 30.0), (60.0, 60.0)])
def test_heat_capacity_is_one_that_cells_have(read: float, C_th: float) -> None:
    kept, hA = bounded(read, 0.5, made.CAPACITY_AH)
    assert kept == pytest.approx(C_th)
    assert kept / hA == pytest.approx(read / 0.5)  # the time constant, which readings show best, stays


def test_one_temperature_gives_no_activation_energy() -> None:
    frames = made.measured({"slow": made.slow(1.0), "pulses": made.pulses(25.0)})
    found = parameterise(made.raw_cell(frames))
    assert not found["activation energies"].found
    assert "two temperatures" in found["activation energies"].test
    assert found.case.tables["R_ints"].temperature_degC is None


def test_half_the_gap_between_slow_branches_is_hysteresis() -> None:
    effects, starts = {"ocv_hysteresis": {"M_V": 0.02, "g": 60.0}}, {"charge": 0.0}
    frames = made.measured(
        {"discharge": made.slow(1.0), "charge": made.slow(-1.0), "pulses": made.pulses(25.0)},
        effects=effects,
        starts=starts,
    )
    found = parameterise(made.raw_cell(frames, starts=starts))
    one = found["hysteresis at 25 degC"]
    assert abs(one.value - 0.02) < SIGMAS * one.sd
    assert abs(found["M_V"].value - 0.02) < 0.004


def test_case_that_is_written_predicts_as_the_one_in_memory(found: Parameterisation, tmp_path: Path) -> None:
    again = read_case(found.write(tmp_path / "out", pictures=False))
    one, other = found.simulation[3].table, simulate_case(again)[3].table
    np.testing.assert_allclose(one["voltage_V"], other["voltage_V"], atol=1e-9)


def test_exact_numbers_of_the_case_are_kept_but_for_the_age() -> None:
    frames = made.measured({"pulses": made.pulses(25.0)})
    case = made.raw_cell(frames)
    exact = {"capacity_Ah": Known(2.0), "cycles": Known(300.0)}
    found = parameterise(dataclasses.replace(case, parameters=case.parameters | exact))
    assert not found["capacity_Ah"].found
    # The resistance of an aged cell is that of its age: it must not age by the 300 cycles once more.
    assert found.case.parameters["cycles"].value == 0.0
    assert "age_included" in {one.code for one in found.remarks}


def test_what_a_case_can_hold_only_approximately_is_said() -> None:
    """A correction of the series resistance is of what cycles add to it too; a table holds it for all runs alike."""
    case = made.raw_cell(made.measured({"new": made.pulses(25.0), "aged": made.drive(25.0)}))
    aged = [dataclasses.replace(run, overrides={"cycles": Known(150.0 * n)}) for n, run in enumerate(case.runs)]
    found = parameterise(dataclasses.replace(case, runs=tuple(aged)))
    said = [one for one in found.remarks if one.code == "written_approximately"]
    assert len(said) == 1
    assert "exact for the cycles of the first run" in said[0]
    assert "written_approximately" not in {one.code for one in parameterise(case).remarks}


def test_tables_that_the_case_states_as_exact_are_kept() -> None:
    """A series resistance that is stated a tenth too small is told by its scale; its table and the entropy stay."""
    frames = {"cold": made.pulses(5.0), "warm": made.pulses(25.0)}
    exact = {
        "R_ints": Table(np.array([0.0, 1.0]), np.full(2, made.R_0 / 1.1)),
        "dU_dT": Table(np.array([0.0, 1.0]), np.full(2, 1e-4)),
    }
    case = dataclasses.replace(made.raw_cell(made.measured(frames)), tables=exact)
    found = parameterise(case)
    for name, table in exact.items():
        np.testing.assert_array_equal(found.case.tables[name].values, table.values)
    assert found.case.parameters["series_resistance_scale"].value == pytest.approx(1.1, rel=0.02)
    told = found["R_ints at SOC 0.5, 25 degC"]
    assert abs(told.value - made.R_0) < SIGMAS * told.sd + 0.02 * made.R_0


@pytest.mark.parametrize(("change", "says"), [("voltage", "voltage_V"), ("check", "no fit run"), ("still", "current")])
def test_failures_say_what_is_missing(change: str, says: str) -> None:
    frame = made.measured({"pulses": made.pulses(25.0)})["pulses"]
    frame = frame.drop(columns="voltage_V") if change == "voltage" else frame
    frame = frame.assign(current_A=0.0) if change == "still" else frame
    case = made.raw_cell({"pulses": frame}, check=["pulses"] if change == "check" else ())
    with pytest.raises(FitError, match=says):
        parameterise(case)


def test_unknown_picture_is_refused_with_the_known_ones(found: Parameterisation) -> None:
    with pytest.raises(MeasurementError, match="no extraction is called"):
        found.plot.extraction("resistances of gold")


def test_every_picture_is_drawn(found: Parameterisation) -> None:
    pictures = {name: found.plot.extraction(name) for name in found.points} | {"curves": found.plot.curves()}
    assert {"slow", "rests", "resistance", "relaxation", "fit", "curves"} <= pictures.keys()
    assert all(figure.axes for figure in pictures.values())


def test_every_picture_is_drawn_on_axes_of_the_caller(found: Parameterisation) -> None:
    own = new_figure(30.0, 8.0)
    axes = own.subplots(1, 3)
    run = str(found.points["fit"]["run"].iloc[0])
    assert found.plot.extraction("rests", ax=axes[0]) is own
    assert found.plot.extraction("fit", run, axes[1]) is own
    assert found.plot.curves("ocv", axes[2]) is own
    assert [len(one.lines) > 0 for one in axes] == [True] * 3
    assert axes[1].get_title("left").startswith(run)


def test_axes_of_the_caller_take_one_run_or_table(found: Parameterisation) -> None:
    (axes,) = new_figure(9.0, 8.0).subplots(1, 1, squeeze=False).flat
    with pytest.raises(MeasurementError, match=r"plot: 'fit' is of \d+ runs; name one for your axes, as run='"):
        found.plot.extraction("fit", ax=axes)
    with pytest.raises(MeasurementError, match=r"extraction 'rests' has no run 'slow'. It is not drawn run by run"):
        found.plot.extraction("rests", "slow")
    with pytest.raises(MeasurementError, match=r"name the table for your axes, as table='ocv'"):
        found.plot.curves(ax=axes)
    with pytest.raises(MeasurementError, match=r"no table 'R_int'. Did you mean 'R_ints'"):
        found.plot.curves("R_int")


def test_a_thermometer_that_never_moves_tells_of_no_noise() -> None:
    """With an sd of nothing every effect would be significant."""
    frames = {
        name: frame.assign(cell_temperature_degC=25.1)
        for name, frame in made.measured({"slow": made.slow(1.0), "pulses": made.pulses(25.0)}).items()
    }
    assert "cell_temperature_degC" not in parameterise(made.raw_cell(frames)).case.sensors


def test_the_gap_between_slow_branches_is_less_the_drop_over_a_cell_that_is_half_full() -> None:
    """The first samples of steps at empty and full hold a part of the curve: 0.3 ohm there is none of the cell's."""
    at_the_ends = pd.DataFrame({"soc": [0.0, 1.0], "ohm": [0.3, 0.3]})
    assert typical_ohm(at_the_ends, 3.0) == pytest.approx(0.05)
    with_pulses = pd.concat([at_the_ends, pd.DataFrame({"soc": [0.4, 0.5, 0.6], "ohm": [0.03, 0.031, 0.034]})])
    assert typical_ohm(with_pulses, 3.0) == pytest.approx(0.031)
    assert typical_ohm(pd.DataFrame(), 3.0) == pytest.approx(0.05)


def test_the_charge_of_an_aged_cell_is_counted_by_what_it_holds(found: Parameterisation) -> None:
    """A run that states 1.4 of 2.0 A h is empty after 1.4: at the same state of charge as a new cell after 2.0."""
    case = dataclasses.replace(found.case, parameters=found.case.parameters | {"capacity_Ah": Known(2.0)})
    run = case.runs[0]
    aged = dataclasses.replace(run, overrides=run.overrides | {"capacity_Ah": Known(1.4, 0.03)})
    assert _as_new(case, rows_of(aged)).drawn_Ah == pytest.approx(rows_of(run).drawn_Ah / 0.7)
    assert np.array_equal(_as_new(case, rows_of(run)).drawn_Ah, rows_of(run).drawn_Ah)
