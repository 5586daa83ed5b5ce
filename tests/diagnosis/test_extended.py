"""The case that a diagnosis ends with: accepted by every reader, and the same model to the last digit."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known, MotorTable, Table, Tolerance
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.case.writing import write_case
from jaxmodel.diagnosis.finishing import conclusion
from jaxmodel.diagnosis.result import CurveFound, Diagnosis, Estimate, RunFound
from jaxmodel.effects.curves import CURVES, MEDIUM
from jaxmodel.fit.tables import corrected_motor_tables
from jaxmodel.model.simulation import simulate
from tests.diagnosis.made_cases import case_of, investigation_of, run_of, small_cell
from tests.made_up import contact, law, ocv_curve, with_additions


def of(diagnosis: Diagnosis) -> tuple[Case, list[str]]:
    return diagnosis.extension


@pytest.fixture
def written(diagnosis: Diagnosis, tmp_path: Path) -> Case:
    folder = tmp_path / "somewhere" / "else"
    folder.mkdir(parents=True)
    write_case(diagnosis.extended_case(), folder / "extended.toml", ["a comment"])
    return read_case(folder / "extended.toml")


def read_back(diagnosis: Diagnosis, folder: Path) -> tuple[Case, list[str]]:
    case, notes = of(diagnosis)
    write_case(case, folder / "extended.toml", notes)
    return read_case(folder / "extended.toml"), notes


def test_extended_case_holds_the_final_model(diagnosis: Diagnosis, written: Case) -> None:
    estimates = diagnosis.final.estimates
    assert written.parameters["capacity_Ah"].value == estimates["capacity_Ah"].value
    assert written.effects == {"self_heating": {"C_th": 82.0, "hA": 0.11}, "arrhenius_resistance": {"E_a": 9000.0}}
    assert written.effect_sd == {"self_heating": {"C_th": 3.0, "hA": 0.01}, "arrhenius_resistance": {"E_a": 700.0}}
    assert {name: known.sd for name, known in written.parameters.items()} == {
        name: estimates[name].sd if known.sd else None for name, known in diagnosis.case.parameters.items()
    }
    assert [run.initial_soc for run in written.runs] == [
        Known(estimates[f"initial_soc[{run.name}]"].value, estimates[f"initial_soc[{run.name}]"].sd)
        for run in written.runs
    ]
    assert [run.source for run in written.runs] == [run.source for run in diagnosis.case.runs]
    assert (written.title, written.sensors) == (diagnosis.case.title, diagnosis.case.sensors)
    assert written.tolerance == diagnosis.case.tolerance == {"voltage_V": Tolerance(0.01, 0.03)}


def test_extended_case_predicts_what_the_diagnosis_predicted(diagnosis: Diagnosis, written: Case) -> None:
    for outcome in simulate_case(written):
        for channel, predicted in diagnosis.final.predictions[outcome.run.name].items():
            np.testing.assert_allclose(outcome.table[channel], predicted, rtol=1e-12)


def test_effects_that_the_case_had_are_refitted_too(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """A number of an effect that the case states to an sd is calibrated like any other."""
    case = dataclasses.replace(
        diagnosis.case,
        effects={"voltage_offset": {"c": 0.02, "column": "voltage_V"}, "rate_capacity": {"p": 1.05}},
        effect_sd={"voltage_offset": {"c": 0.01}},
    )
    changed = with_additions(
        dataclasses.replace(diagnosis, case=case), estimates={"voltage_offset:voltage_V.c": Estimate(0.013, 0.002, "V")}
    )
    written, notes = read_back(changed, tmp_path)
    assert notes == []
    assert written.effects["voltage_offset"] == {"c": 0.013, "column": "voltage_V"}
    assert written.effect_sd["voltage_offset"] == {"c": 0.002}
    assert written.effects["rate_capacity"] == {"p": 1.05}
    assert "rate_capacity" not in written.effect_sd


def test_start_of_a_run_is_kept_as_its_own(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """A fitted rise takes the place of a stated temperature: a case file takes one of them."""
    first = dataclasses.replace(
        diagnosis.case.runs[0],
        initial_cell_temperature=Known(12.0, 0.5),
        tolerance={"cell_temperature_degC": Tolerance(0.5)},
    )
    second = dataclasses.replace(diagnosis.case.runs[1], initial_cell_temperature=Known(15.5, 0.5))
    case = dataclasses.replace(diagnosis.case, runs=(first, second, diagnosis.case.runs[2]))
    starts = {
        "initial_temperature_rise_K[run-01]": Estimate(1.7, 0.1, "K"),
        "initial_hysteresis[run-03]": Estimate(0.4, 0.2, ""),
    }
    written, _ = read_back(with_additions(dataclasses.replace(diagnosis, case=case), estimates=starts), tmp_path)
    assert written.runs[0].overrides == {"initial_temperature_rise_K": Known(1.7, 0.1)}
    assert written.runs[0].initial_cell_temperature is None
    assert written.runs[0].tolerance == {"cell_temperature_degC": Tolerance(0.5)}
    assert written.runs[1].initial_cell_temperature == Known(15.5, 0.5)
    assert written.runs[2].overrides == {"initial_hysteresis": Known(0.4, 0.2)}
    started = simulate_case(written)[0].table["cell_temperature_degC"][0]
    assert started == pytest.approx(11.7)


OCV = Table(np.array([0.0, 0.5, 1.0]), np.array([3.0, 3.6, 4.15]), None, 0.005)
R_INTS = Table(np.array([0.0, 1.0]), np.array([[0.09, 0.07], [0.05, 0.04]]), np.array([0.0, 40.0]))
ENTROPY = Table(np.array([0.0, 0.4, 1.0]), np.array([-1e-4, 2e-4, 0.0]))
OF_CELL = [name for name, cls in CURVES.items() if "cell" in cls.kinds]
COVERED = {"soc": (0.02, 0.98), "temperature_degC": (0.0, 40.0), "temperature_rise_K": (0.0, 20.0)}
COVERED |= {"current_A": (0.0, 9.0), "speed_rad_s": (0.0, 300.0)}
# What tables hold of a curve, and what else a case holds: effects by name.
HELD = {
    "ocv_curve": ({"ocv"}, {}),
    "series_resistance_curve": ({"R_ints"}, {}),
    "short_resistance_curve": ({"R_TS", "C_TS"}, {}),
    "long_resistance_curve": ({"R_TL", "C_TL"}, {}),
    "short_time_curve": ({"C_TS"}, {}),
    "long_time_curve": ({"C_TL"}, {}),
    "convection_curve": (set(), {"heat_details": {"c": 0.05}}),
    "short_heat": (set(), {"heat_details": {"s": 0.3}}),
    "long_heat": (set(), {"heat_details": {"l": 0.3}}),
    "entropy_curve": ({"dU_dT"}, {}),
    "series_energy": (set(), {"arrhenius_resistance": {"E_a": 29e3}, "arrhenius_polarisation": {"E_rc": -20e3}}),
    "short_energy": (set(), {"arrhenius_polarisation": {"E_rc": 20e3}, "arrhenius_long_polarisation": {"E_l": -20e3}}),
    "long_energy": (set(), {"arrhenius_long_polarisation": {"E_l": 20e3}}),
}


def found(name: str, value: float = 1.0) -> CurveFound:
    """A curve of its usual size that goes up and down over what the runs cover."""
    cls = CURVES[name]
    values = value * cls.typical * np.cos(1.7 * np.arange(len(cls.usual_knots)))
    at = cls(values, *COVERED[cls.over]).knots
    return CurveFound(name, cls.port, cls.over, at, values, np.full(at.size, 0.1 * cls.typical), cls.unit, {}, False)


def predicted(diagnosis: Diagnosis, curves: tuple[CurveFound, ...], tables: dict[str, Table]) -> list[dict]:
    """What the final model with its curves as effects reads, as the diagnosis had it."""
    final = dataclasses.replace(with_additions(diagnosis).extended_case(), tables=tables)
    effects = tuple(CURVES[one.label](jnp.asarray(one.value), *COVERED[CURVES[one.label].over]) for one in curves)
    models = [case_model(final, run) for run in final.runs]
    # Curves come first: at a shared port an effect acts on the corrected relation.
    models = [dataclasses.replace(model, effects=(*effects, *model.effects)) for model in models]
    return [simulate(model, run_profile(run)).readings for model, run in zip(models, final.runs, strict=True)]


def largest(diagnosis: Diagnosis, one: list[dict], other: list[dict]) -> dict[str, float]:
    """The largest difference of each channel over all runs."""
    return {
        name: max(
            float(np.abs(np.asarray(a[name]) - np.asarray(b[name])).max()) for a, b in zip(one, other, strict=True)
        )
        for name in diagnosis.final.errors
    }


@pytest.mark.parametrize("name", OF_CELL)
def test_a_curve_in_the_case_file_predicts_what_the_diagnosis_predicted(
    diagnosis: Diagnosis, tmp_path: Path, name: str
) -> None:
    """One curve at a time, so that none makes good for another; each shows by many times what a file rounds off."""
    written, notes = read_back(with_additions(diagnosis, curves=(found(name),)), tmp_path)
    assert notes == []
    tables, effects = HELD[name]
    assert set(written.tables) == tables
    before = diagnosis.extended_case().effects
    assert written.effects == before | {key: before.get(key, {}) | values for key, values in effects.items()}
    everything = tuple(found(one, float(one == name)) for one in OF_CELL)  # one program for all curves
    expected, without = (
        predicted(diagnosis, everything, {}),
        [o.table for o in simulate_case(diagnosis.extended_case())],
    )
    off = largest(diagnosis, [o.table for o in simulate_case(written)], expected)
    shown = largest(diagnosis, without, expected)
    assert off["voltage_V"] < 2.5e-4
    assert off["cell_temperature_degC"] < 0.02
    assert any(shown[channel] > 5.0 * off[channel] for channel in shown), (off, shown)


@pytest.mark.slow("tables")
@pytest.mark.parametrize("tables", [{}, {"ocv": OCV, "R_ints": R_INTS, "dU_dT": ENTROPY}], ids=["formulas", "tables"])
def test_all_curves_together_are_in_the_case_file(
    diagnosis: Diagnosis, tmp_path: Path, tables: dict[str, Table]
) -> None:
    """The model with the curves as effects, as the diagnosis had it, and the case file with its tables are the same."""
    case, curves = dataclasses.replace(diagnosis.case, tables=tables), tuple(map(found, OF_CELL))
    written, notes = read_back(with_additions(dataclasses.replace(diagnosis, case=case), curves=curves), tmp_path)
    assert notes == []
    assert set(written.tables) == {"ocv", "R_ints", "R_TS", "R_TL", "C_TS", "C_TL", "dU_dT"}
    assert all(table.sd is not None for table in written.tables.values())
    off = largest(diagnosis, [o.table for o in simulate_case(written)], predicted(diagnosis, curves, tables))
    assert off["voltage_V"] < 2.5e-4
    assert off["cell_temperature_degC"] < 0.02


def test_sd_of_a_corrected_table_is_that_of_its_curve(diagnosis: Diagnosis, tmp_path: Path) -> None:
    case = dataclasses.replace(diagnosis.case, tables={"ocv": OCV})
    curve = dataclasses.replace(ocv_curve(), sd=np.full(len(MEDIUM), 0.0012))
    written, _ = read_back(with_additions(dataclasses.replace(diagnosis, case=case), curves=(curve,)), tmp_path)
    assert written.tables["ocv"].sd == pytest.approx(0.0012)
    assert set(OCV.soc) | set(MEDIUM) == set(written.tables["ocv"].soc)


def test_knots_of_a_curve_that_are_hardly_those_of_the_table_are_written_once(
    diagnosis: Diagnosis, tmp_path: Path
) -> None:
    """In the digits of a file they would be the same, and a table with a knot twice is refused."""
    case = dataclasses.replace(diagnosis.case, tables={"ocv": OCV})
    at = np.array(MEDIUM) * (1.0 + 1e-9)
    curve = dataclasses.replace(ocv_curve(), at=at)
    written, _ = read_back(with_additions(dataclasses.replace(diagnosis, case=case), curves=(curve,)), tmp_path)
    soc = np.asarray(written.tables["ocv"].soc)
    assert np.all(np.diff(soc) > 0.0)
    assert set(OCV.soc) | set(MEDIUM) == set(soc)


def test_energies_beyond_the_bounds_of_an_effect_are_moved_to_them_and_said(
    diagnosis: Diagnosis, tmp_path: Path
) -> None:
    """What one effect cannot hold of a pair's energy the next one does."""
    curves = (found("series_energy", -2.0), found("long_energy", 0.5))
    written, notes = read_back(with_additions(diagnosis, curves=curves), tmp_path)
    assert written.effects["arrhenius_resistance"] == {"E_a": -20e3}  # 9 - 40 kJ/mol, of which 29 arrive
    assert written.effects["arrhenius_polarisation"] == {"E_rc": 29e3}
    assert written.effects["arrhenius_long_polarisation"] == {"E_l": 10e3}
    assert notes == ["arrhenius_resistance.E_a was fitted as -31000, outside its range; it is set to -20000 here."]


def test_what_a_case_file_cannot_hold_is_in_the_notes(diagnosis: Diagnosis, tmp_path: Path) -> None:
    written, notes = read_back(with_additions(diagnosis, curves=(law(),), runs=(contact(),)), tmp_path)
    assert written.tables == {}
    text = "\n".join(notes)
    for said in (
        "run-02: series resistance differs by +11.20 ± 0.80 mohm from the other runs",
        "give --effect found_law.py:FoundLaw",
    ):
        assert said in text
    assert len(notes) == 2


STATED = {"friction": MotorTable(np.array([0.0, 100.0, 200.0]), np.array([0.001, 0.004, 0.005]), 0.0005)}
STATED |= {"torque_factor": MotorTable(np.array([1.0, 6.0]), np.array([1.0, 0.9]))}


@pytest.mark.parametrize("tables", [{}, STATED], ids=["none stated", "stated"])
def test_curves_of_a_motor_are_tables_of_the_case_file(tables: dict[str, MotorTable], tmp_path: Path) -> None:
    """A motor with the curves as effects, as the diagnosis had it, and the case file with its tables are the same."""
    rows = 60
    load = 0.05 * np.sin(np.arange(rows) / 7.0) + 0.06
    inputs = {"voltage_V": np.full(rows, 8.0), "load_torque_Nm": load, "ambient_degC": np.full(rows, 20.0)}
    case = dataclasses.replace(
        case_of("motor", {}, [run_of(1, inputs, {"speed_rad_s": np.ones(rows)}, step_s=0.1)]), motor_tables=tables
    )
    curves = tuple(map(found, ("friction_curve", "torque_constant_curve")))
    now = corrected_motor_tables(case, curves)
    assert set(now) == {"friction", "torque_factor"}
    file = tmp_path / "extended.toml"
    run = dataclasses.replace(case.runs[0], source=None)
    write_case(dataclasses.replace(case, motor_tables=now, runs=(run,)), file)
    written = read_case(file)
    for name, table in now.items():
        np.testing.assert_array_equal(written.motor_tables[name].values, table.values)
        assert written.motor_tables[name].sd == table.sd > 0.0
    effects = tuple(CURVES[one.label](jnp.asarray(one.value), *COVERED[CURVES[one.label].over]) for one in curves)
    profile, model = run_profile(case.runs[0]), case_model(case, case.runs[0])
    expected = simulate(dataclasses.replace(model, effects=(*model.effects, *effects)), profile).readings
    without = simulate(model, profile).readings
    for outcome in simulate_case(written):
        for channel in ("speed_rad_s", "current_A"):
            shown = np.abs(expected[channel] - without[channel]).max()
            off = np.abs(outcome.table[channel] - expected[channel]).max()
            assert off < 1e-3 * shown


def test_friction_of_one_run_is_its_own_number(diagnosis: Diagnosis) -> None:
    tight = RunFound("friction_shift@run-02", "run-02", "run-02.csv", "friction_torque_Nm", 0.004, 0.001, "N m", {})
    case, notes = of(with_additions(diagnosis, runs=(tight,)))
    assert notes == []
    default = case_model(diagnosis.case).parameters.tau_0
    assert case.runs[1].overrides["tau_0"].value == pytest.approx(float(default) + 0.004)
    assert case.runs[1].overrides["tau_0"].sd == pytest.approx(0.001)
    assert "tau_0" not in case.runs[0].overrides


def test_tables_overrides_ambient_and_cutoff_survive(case_folder: Path, diagnosis: Diagnosis, tmp_path: Path) -> None:
    toml = case_folder / "case.toml"
    text = toml.read_text().replace(
        'label = "9 A"', 'label = "9 A"\ncycles = { value = 40, sd = 5 }\nambient_degC = 21.5'
    )
    text = text.replace("[sensors]", "ocv = { soc = [0, 1], voltage_V = [3.0, 4.1], sd_V = 0.004 }\n"
                        "R_ints = { soc = [0, 1], temperature_degC = [0, 40], ohm = [[0.05, 0.04], [0.03, 0.02]] }\n"
                        "[cutoff]\nvoltage_V = 2.5\n[sensors]")  # fmt: skip
    toml.write_text(text)
    last = case_folder / "run-03.csv"
    last.write_text("\n".join(",".join(line.split(",")[:2] + line.split(",")[3:]) for line in last.read_text().split()))
    case = read_case(case_folder)
    changed = with_additions(
        dataclasses.replace(diagnosis, case=case), estimates={"cycles[run-03]": Estimate(44.0, 4.0, "")}
    )
    written, _ = read_back(changed, tmp_path)
    assert written.runs[2].overrides["cycles"] == Known(44.0, 4.0)
    assert set(written.runs[2].measured.inputs["ambient_degC"]) == {21.5}
    assert written.cutoff == {"voltage_V": 2.5}
    np.testing.assert_array_equal(written.tables["R_ints"].values, case.tables["R_ints"].values)
    np.testing.assert_array_equal(written.tables["R_ints"].temperature_degC, [0.0, 40.0])
    np.testing.assert_array_equal(written.tables["ocv"].values, [3.0, 4.1])
    assert (written.tables["ocv"].sd, written.tables["R_ints"].sd) == (0.004, None)


def test_second_fault_of_one_kind_is_left_out_and_said(diagnosis: Diagnosis) -> None:
    labels = ("voltage_offset:voltage_V", "voltage_offset:pack_voltage_V")
    estimates = {f"{label}.c": Estimate(0.01, 0.001, "V") for label in labels}
    final = dataclasses.replace(diagnosis.final, added=labels, estimates=estimates)
    two_faults = dataclasses.replace(diagnosis, ladder=(*diagnosis.ladder[:-1], final))
    case, notes = of(two_faults)
    assert case.effects == {"voltage_offset": {"c": 0.01, "column": "voltage_V"}}
    assert case.effect_sd == {"voltage_offset": {"c": 0.001}}
    assert notes == [f"{labels[1]} is left out: a case file holds one effect of each name."]


def test_number_fitted_beyond_its_bounds_is_moved_to_them_and_said(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """A wrong model may want a state of charge of 1.2; the file must be readable all the same."""
    far = {"initial_soc[run-02]": Estimate(1.2, 0.001, ""), "self_heating.hA": Estimate(-1.0, 0.1, "W/K")}
    written, notes = read_back(with_additions(diagnosis, estimates=far), tmp_path)
    assert written.runs[1].initial_soc.value == 1.1
    assert {note.split()[0] for note in notes} == set(far)
    assert "# initial_soc[run-02] was fitted as 1.2, outside its range; it is set to 1.1 here.\n" in (
        tmp_path / "extended.toml"
    ).read_text(encoding="utf-8")


def test_the_final_model_of_a_diagnosis_gives_the_reported_errors_as_a_case() -> None:
    """A cell that heats itself, and whose stated open-circuit voltage is off: its errors are those of the case file."""
    true, soc = small_cell({"self_heating": {"C_th": 60.0, "hA": 0.1}}, seed=1), np.linspace(0.0, 1.0, 101)
    volt = np.asarray(jax.vmap(case_model(true).curves.ocv, in_axes=(0, None))(jnp.asarray(soc), jnp.asarray(20.0)))
    case = dataclasses.replace(true, tables={"ocv": Table(soc, volt + 0.01 * np.sin(6.0 * soc))})
    found = conclusion(investigation_of(case, "self_heating", *OF_CELL).add("self_heating"))
    assert [one.label for one in found.curves] == ["ocv_curve"]
    corrected = {one.label for one in found.corrections}
    assert corrected > {"ocv_curve"}
    extended, notes = found.extension
    assert notes == []
    assert set(extended.tables) == set().union(*(HELD[label][0] for label in corrected))
    for run, outcome in zip(extended.runs, simulate_case(extended), strict=True):
        for channel, errors in found.final.by_run.items():
            if run.split == "fit":  # a check run's start is adjusted in a diagnosis, and stated in a case
                rms = np.sqrt(np.mean((run.measured.outputs[channel] - outcome.table[channel]) ** 2))
                assert rms == pytest.approx(errors[run.name].rms, rel=0.01)
