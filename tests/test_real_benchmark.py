"""Real cases are valid, the reference finds what a made cell has and sees no check run, harmless changes are that."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.real.cases import CASES, build, find_data
from benchmarks.real.halves import halves
from benchmarks.real.harmless import (
    AS_IT_IS,
    CHANGES,
    TOLERANCE,
    counts,
    every_second,
    interpolated,
    noise_scaled,
    runs_reversed,
    soc_sd_changed,
    tolerance_stated,
    write_changed,
)
from benchmarks.real.least_squares import relaxed
from benchmarks.real.one import diagnose_apart
from benchmarks.real.reference import reference
from benchmarks.real.reference_cell import CellReference
from benchmarks.real.reference_motor import MotorReference
from benchmarks.real.table import Row, overlapping, sentences, summary
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.effects import CATALOGUE

try:
    DATA = find_data()
except FileNotFoundError:
    DATA = Path("no-data")
ONE_OF_EACH_BUILDER = [
    "samsung_30q",
    "panasonic_drive",
    "panasonic_four",
    "a123_warm",
    "k2_lfp",
    "lg_mj1",
    "dmegc_18650",
    "nasa_ageing",
    "leaf",
    "gear_motor",
    "propellers",
]


@pytest.mark.slow("panasonic_drive")
@pytest.mark.parametrize("name", ONE_OF_EACH_BUILDER)
def test_a_real_case_is_valid_and_keeps_runs_for_the_check(name: str, tmp_path: Path):
    wanted = CASES[name]
    if wanted.needs and not (DATA / wanted.needs).is_dir():
        pytest.skip("The measurements are not here.")
    case = read_case(build(wanted, DATA, tmp_path))
    assert case.kind == wanted.kind
    assert {run.split for run in case.runs} == {"fit", "check"}
    assert len({run.name for run in case.runs}) == len(case.runs)
    judged = {channel for run in case.runs if run.split == "check" for channel in run.measured.outputs}
    assert wanted.targets.keys() <= judged
    assert case.sensors.keys() & judged


def test_what_an_expert_expects_is_in_the_catalogue():
    for case in CASES.values():
        assert all(set(either.split("|")) & CATALOGUE.keys() for either in case.expects)


# A made cell: R_0 and both pairs follow Arrhenius, it warms, and its table is off by a bump of 15 mV.

SOC = np.linspace(0.0, 1.0, 21)
TRUE_OCV = 3.3 + 0.8 * SOC + 0.1 * np.sin(5.0 * SOC)
BUMP = 0.015 * np.exp(-(((SOC - 0.5) / 0.15) ** 2))
CAPACITY_AH, R_OHM, TAUS_S, E_J_MOL = 2.0, (0.030, 0.015, 0.020), (12.0, 200.0), 20e3
C_J_K, HA_W_K = 60.0, 0.1
NOISE_V, NOISE_K = 0.001, 0.05


def colder(degC: np.ndarray | float) -> np.ndarray:
    return np.exp(E_J_MOL / 8.314 * (1.0 / (degC + np.float64(273.15)) - 1.0 / 298.15))


def made_run(seed: int, ambient_degC: float, count: int = 2400, step_s: float = 2.0) -> pd.DataFrame:
    random = np.random.default_rng(seed)
    current = np.repeat(random.choice([0.0, 1.0, 2.0, 5.0, -1.5], count // 30), 30)
    time_s = step_s * np.arange(count)
    soc = 1.0 - np.append(0.0, np.cumsum(current[1:])) * step_s / 3600.0 / CAPACITY_AH
    degC, lags, rows = ambient_degC, np.zeros(2), []
    kept, cooled = np.exp(-step_s / np.array(TAUS_S)), np.exp(-step_s * HA_W_K / C_J_K)
    for row in range(count):
        factor = colder(degC)
        if row:
            lags = kept * lags + (1.0 - kept) * current[row] * factor * np.array(R_OHM[1:])
        drop = current[row] * R_OHM[0] * factor + lags.sum()
        if row:
            degC = ambient_degC + cooled * (degC - ambient_degC) + (1.0 - cooled) * current[row] * drop / HA_W_K
        rows.append((np.interp(soc[row], SOC, TRUE_OCV) - drop, degC))
    voltage, degC = np.array(rows).T
    return pd.DataFrame(
        {
            "time_s": time_s,
            "current_A": current,
            "ambient_degC": ambient_degC,
            "voltage_V": voltage + NOISE_V * random.standard_normal(count),
            "cell_temperature_degC": degC + NOISE_K * random.standard_normal(count),
        }
    )


def write_case(
    folder: Path, kind: str, parameters: str, runs: dict[str, tuple[pd.DataFrame, str]], sensors: str
) -> Case:
    folder.mkdir(parents=True, exist_ok=True)
    text = f'kind = "{kind}"\n[parameters]\n{parameters}\n[sensors]\n{sensors}\n'
    for name, (rows, split) in runs.items():
        rows.to_csv(folder / f"{name}.csv", index=False)
        text += f'[[runs]]\nfile = "{name}.csv"\nsplit = "{split}"\n'
        text += "initial_soc = { value = 1.0, sd = 0.01 }\n" if kind == "cell" else ""
    (folder / "case.toml").write_text(text, encoding="utf-8")
    return read_case(folder)


@pytest.fixture(scope="module")
def made_cell(tmp_path_factory: pytest.TempPathFactory) -> Case:
    parameters = (
        f"capacity_Ah = {CAPACITY_AH}\nocv = {{ soc = {SOC.tolist()}, voltage_V = {(TRUE_OCV + BUMP).tolist()} }}"
    )
    runs = {f"fit_{degC}": (made_run(degC, float(degC)), "fit") for degC in (0, 15, 25, 40)}
    runs |= {"check": (made_run(7, 20.0), "check")}
    sensors = f"voltage_V = {NOISE_V}\ncell_temperature_degC = {NOISE_K}"
    return write_case(tmp_path_factory.mktemp("made") / "cell", "cell", parameters, runs, sensors)


@pytest.fixture(scope="module")
def fitted(made_cell: Case) -> CellReference:
    return CellReference(made_cell)


def test_the_reference_foretells_a_made_cell_to_its_noise(made_cell: Case):
    errors = reference(made_cell).errors
    assert errors["voltage_V"]["check"] < 1.5 * NOISE_V
    assert errors["cell_temperature_degC"]["check"] < 2.0 * NOISE_K


def test_the_reference_recovers_the_series_resistance(fitted: CellReference):
    soc = np.array([0.3, 0.5, 0.8])
    for degC in (10.0, 25.0, 35.0):
        np.testing.assert_allclose(fitted.series_ohm(soc, degC), R_OHM[0] * colder(degC), rtol=0.05)


def test_the_reference_does_not_see_what_it_is_judged_on(made_cell: Case, fitted: CellReference):
    def spoiled(run):
        outputs = {
            name: values + np.where(np.arange(values.size) > 0, 1.0, 0.0)
            for name, values in run.measured.outputs.items()
        }
        return dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs))

    runs = tuple(spoiled(run) if run.split == "check" else run for run in made_cell.runs)
    blind = CellReference(dataclasses.replace(made_cell, runs=runs)).predict(runs[-1])
    for channel, foretold in fitted.predict(made_cell.runs[-1]).items():
        np.testing.assert_array_equal(blind[channel], foretold)


def test_a_lag_is_that_of_a_drive_held_over_each_step():
    time_s = np.array([0.0, 1.0, 5.0, 6.0])
    found = relaxed(time_s, np.array([9.0, 2.0, 2.0, 0.0]), tau_s=4.0)
    after = 2.0 * (1.0 - np.exp(-5.0 / 4.0))
    np.testing.assert_allclose(found, [0.0, 2.0 * (1.0 - np.exp(-0.25)), after, after * np.exp(-0.25)], rtol=1e-12)


def test_the_reference_recovers_a_motor_with_a_lossy_gear(tmp_path: Path):
    R, k, friction, loss = 2.0, 0.05, 0.004, 1.2
    random = np.random.default_rng(1)

    def points(voltage: float) -> pd.DataFrame:
        load = np.linspace(0.0, 0.03, 16)
        current = (friction + loss * load) / k
        speed = (voltage - R * current) / k
        columns = {"time_s": 10.0 * np.arange(16), "voltage_V": voltage, "load_torque_Nm": load, "ambient_degC": 20.0}
        read = {
            "current_A": current + 1e-3 * random.standard_normal(16),
            "speed_rad_s": speed + 0.1 * random.standard_normal(16),
        }
        return pd.DataFrame(columns | read)

    runs = {
        f"v{volt}": (points(float(volt)), split) for volt, split in ((6, "fit"), (8, "fit"), (10, "fit"), (12, "check"))
    }
    case = write_case(tmp_path, "motor", "R_0 = 2.0", runs, "current_A = 0.001\nspeed_rad_s = 0.1")
    found = MotorReference(case).chosen
    assert found["R"] == pytest.approx(R, rel=0.02)
    assert found["k"] == pytest.approx(k, rel=0.01)
    assert found["g"] == pytest.approx(loss, rel=0.02)
    errors = reference(case).errors
    assert errors["current_A"]["check"] < 2e-3
    assert errors["speed_rad_s"]["check"] < 0.2


# Harmless changes


def test_every_second_row_leaves_the_charge_and_half_the_readings():
    rows = pd.DataFrame(
        {
            "time_s": [0.0, 30.0, 31.0, 32.0, 33.0, 63.0, 64.0],
            "current_A": [0.0, 0.0, 6.0, 6.0, 6.0, 0.0, 0.0],
            "voltage_V": np.linspace(4.0, 3.9, 7),
        }
    )

    def charge(run: pd.DataFrame) -> float:
        return float(np.sum(np.diff(run.time_s) * run.current_A.to_numpy()[1:]))

    thinner = every_second(rows, ["current_A", "ambient_degC"])
    assert charge(thinner) == charge(rows)
    assert thinner.voltage_V.count() == 4
    assert len(thinner) < len(rows)


def test_a_finer_log_has_the_same_charge_and_readings_and_none_across_a_step():
    rows = pd.DataFrame(
        {
            "time_s": [0.0, 30.0, 31.0, 32.0],
            "current_A": [0.0, 0.0, 6.0, 6.0],
            "voltage_V": [4.0, 4.1, 3.8, np.nan],
            "cell_temperature_degC": [20.0, 21.0, 22.0, 22.5],
        }
    )
    finer = interpolated(rows, ["current_A", "ambient_degC"])
    np.testing.assert_allclose(finer.time_s, [*np.linspace(0, 30, 6), *np.linspace(30.2, 32, 10)])
    assert np.sum(np.diff(finer.time_s) * finer.current_A.to_numpy()[1:]) == pytest.approx(12.0)
    pd.testing.assert_frame_equal(finer[::5].reset_index(drop=True), rows)
    np.testing.assert_allclose(finer.voltage_V[:6], np.linspace(4.0, 4.1, 6))
    assert finer.cell_temperature_degC[6:10].isna().all()
    np.testing.assert_allclose(finer.cell_temperature_degC[10:], np.linspace(22.0, 22.5, 6))


def test_every_harmless_change_gives_a_case_that_can_be_read(made_cell: Case, tmp_path: Path):
    folder = made_cell.path.parent
    written = {change: write_changed(folder, change, tmp_path / str(place)) for place, change in enumerate(CHANGES)}
    assert all(one is not None and read_case(one).kind == "cell" for one in written.values())


def test_the_tolerance_that_is_assumed_is_stated_and_a_stated_one_is_only_written_otherwise(made_cell: Case):
    text = (made_cell.path.parent / "case.toml").read_text(encoding="utf-8")
    readings = {"voltage_V": pd.Series([3.0, np.nan, 4.0]), "cell_temperature_degC": pd.Series([20.0, 30.0])}
    assert 'kind = "cell"' in text
    stated = tolerance_stated(text, readings)
    assert "[tolerance]\nvoltage_V = 0.01\ncell_temperature_degC = 1\n" in stated
    again = tolerance_stated(stated, readings)
    assert "[tolerance]\nvoltage_V = { rms = 0.01 }\ncell_temperature_degC = { rms = 1 }\n" in again
    assert again.split("[sensors]")[1] == text.split("[sensors]")[1]


def test_only_names_are_judged_and_what_is_possible_is_counted_apart():
    row = {
        "case": "one",
        "named": {AS_IT_IS: ["a"], "noise sd x 2": ["a"], "noise sd / 2": ["a", "b"], TOLERANCE: {"failed": "it fell"}},
        "possible": {AS_IT_IS: ["b"], "noise sd x 2": [], "noise sd / 2": [], TOLERANCE: []},
    }
    assert counts([row]) == {"changes": 3, "change_a_name": 2, "move_what_is_possible": 1}


def test_changes_of_the_toml_change_what_they_are_called(made_cell: Case, tmp_path: Path):
    folder = made_cell.path.parent
    changed = {
        name: read_case(write_changed(folder, name, tmp_path / name.replace("/", "over")) or folder)
        for name in ("noise sd x 2", "noise sd / 2", "runs reversed", "sd on initial_soc")
    }
    for name, factor in (("noise sd x 2", 2.0), ("noise sd / 2", 0.5)):
        assert changed[name].sensors == {column: factor * sd for column, sd in made_cell.sensors.items()}
    assert [run.name for run in changed["runs reversed"].runs] == [run.name for run in reversed(made_cell.runs)]
    assert {run.initial_soc.sd for run in changed["sd on initial_soc"].runs} == {None}
    text = (folder / "case.toml").read_text(encoding="utf-8")
    assert soc_sd_changed(soc_sd_changed(text)) == text
    assert runs_reversed(runs_reversed(text)).split() == text.split()
    assert noise_scaled(text, 2.0).split("[sensors]")[0] == text.split("[sensors]")[0]


# The table


def answer(*names: str, after: float = 0.010) -> dict:
    error = {"before": {"fit": 0.03, "check": 0.03}, "after": {"fit": 0.01, "check": after}}
    return {"verdict": "missing_effect", "effects": [{"name": name} for name in names], "error": {"voltage_V": error}}


def test_the_summary_counts_ratios_names_targets_and_failures():
    beside = {"errors": {"voltage_V": {"fit": 0.01, "check": 0.008}}}
    rows = [
        Row("samsung_30q", answer("arrhenius_resistance", "self_heating"), beside),
        Row("nasa_ageing", answer("self_heating", "resistance_ageing", "windage", after=0.004), beside),
        Row("lg_mj1", answer("self_heating"), beside),
        Row("leaf", {"failed": "it fell", "seconds": 1.0}, beside),
    ]
    found = summary(rows)
    assert found["ratios"] == 3
    assert found["median_ratio"] == pytest.approx(1.25)
    assert (found["expected_named"], found["answered"]) == (2, 3)
    assert found["failed"] == ["leaf"]
    assert [(target["case"], target["met"]) for target in found["targets"]] == [
        ("samsung_30q", True),
        ("samsung_30q", False),
        ("leaf", False),
    ]
    assert any("Failed: leaf" in sentence for sentence in sentences(found))


def test_ratios_are_averaged_by_channel_and_by_whether_check_runs_leave_the_fitted_conditions():
    def row(name: str, check: float, reference: float, extrapolated: list[dict]) -> Row:
        answer = {"error": {"voltage_V": {"after": {"check": check}}}, "extrapolated": extrapolated}
        return Row(name, answer, {"errors": {"voltage_V": {"check": reference}}})

    rows = [row("leaf", 2.0, 1.0, []), row("leaf_3c", 1.0, 8.0, []), row("k2_lfp", 3.0, 2.0, [{"file": "hot"}])]
    found = summary(rows)["geometric_means"]
    assert found["inside"]["voltage_V"] == pytest.approx(0.5)
    assert found["outside"]["voltage_V"] == pytest.approx(1.5)


def test_a_case_of_one_fit_run_has_no_halves(made_cell: Case):
    first = next(run for run in made_cell.runs if run.split == "fit")
    kept = tuple(run for run in made_cell.runs if run.split == "check" or run is first)
    assert "failed" in halves(CASES["samsung_30q"], dataclasses.replace(made_cell, runs=kept))


def test_intervals_of_all_cases_are_counted():
    parameters = [{"overlap": True}, {"overlap": False}, {"overlap": True}]
    assert overlapping({"leaf": {"parameters": parameters}, "k2_lfp": {"failed": "no"}}) == (2, 3)


def test_a_case_that_cannot_be_diagnosed_says_why(tmp_path: Path):
    failed = diagnose_apart(tmp_path, limit_s=120.0)
    assert "There is no" in failed["failed"]
