"""What cannot be is refused with the one thing that mends it, and what can be is never refused.

The cases are the model's own readings, so that nothing is wrong with them but what a test puts there.
"""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxmodel.base.errors import MeasurementError, ParameterError
from jaxmodel.case.known import Table
from jaxmodel.case.measurements import Measured
from jaxmodel.case.plausible import check, doubts
from jaxmodel.case.reading import Case, Known, Run, read_case
from jaxmodel.case.simulation import simulate_case
from tests.case.test_reading import shared_cases

ROWS = 121
TIME_S = np.linspace(0.0, 3000.0, ROWS)
PULSES = np.where((TIME_S // 300.0) % 2 == 0, 1.0, 0.2)
HERE = Path("bench/case.toml")
REPOSITORY = Path(__file__).parents[2]
TABLES = {
    "ocv": Table(np.array([0.0, 0.1, 0.5, 1.0]), np.array([2.6, 3.2, 3.7, 4.15])),
    "R_ints": Table(np.array([0.0, 1.0]), np.array([0.05, 0.03])),
}
BLANK = {
    "cell": ("voltage_V", "cell_temperature_degC"),
    "motor": ("current_A", "speed_rad_s", "winding_temperature_degC"),
    "robot": ("pack_voltage_V", "pack_current_A", "motor_current_A", "speed_rad_s", "cell_temperature_degC"),
}


def case_of(kind: str, runs: list[dict], numbers: dict[str, float], tables: dict[str, Table], preset="paper") -> Case:
    """Return a case whose readings are those of its own model."""
    made = tuple(
        Run(f"run-{n}", f"run-{n}.csv", "fit", "", Known(float(inputs.pop("soc", 1.0))), {},
            Measured(TIME_S, {k: np.broadcast_to(v, ROWS).astype(float) for k, v in inputs.items()},
                     {k: np.zeros(ROWS) for k in BLANK[kind]}),
            Path(f"bench/run-{n}.csv"))
        for n, inputs in enumerate(runs)
    )  # fmt: skip
    known = {name: Known(value) for name, value in numbers.items()}
    case = Case("bench", HERE, "", kind, preset, known, tables, {}, {}, made, {})
    found = [outcome.table for outcome in simulate_case(case)]
    return dataclasses.replace(
        case,
        runs=tuple(
            dataclasses.replace(
                run, measured=Measured(TIME_S, run.measured.inputs, {k: np.array(t[k]) for k in BLANK[kind]})
            )
            for run, t in zip(case.runs, found, strict=True)
        ),
    )


@pytest.fixture(scope="module")
def right() -> dict[str, Case]:
    """A right case of each kind: capacity 2.6 A h with its own tables, and the paper's motor and robot."""
    cell = [
        {"current_A": 2.6 * PULSES, "ambient_degC": 25.0},
        {"current_A": 3.9 * PULSES, "ambient_degC": 5.0, "soc": 0.9},
    ]
    motor = [{"voltage_V": 14.0 * PULSES, "load_torque_Nm": 0.12 * PULSES, "ambient_degC": 20.0}]
    robot = [{"duty": 0.5 * PULSES, "load_torque_Nm": 0.15, "ambient_degC": 20.0}]
    return {
        "cell": case_of("cell", cell, {"capacity_Ah": 2.6, "cycles": 0.0, "storage_months": 0.0}, TABLES),
        "motor": case_of("motor", motor, {}, {}),
        "robot": case_of("robot", robot, {}, {}),
    }


def column(case: Case, name: str, change) -> Case:
    """Return the case with a column changed in every run."""

    def changed(run: Run) -> Run:
        m = run.measured
        inputs, outputs = (
            {k: change(v) if k == name else v for k, v in part.items()} for part in (m.inputs, m.outputs)
        )
        return dataclasses.replace(
            run, measured=Measured(change(m.time_s) if name == "time_s" else m.time_s, inputs, outputs)
        )

    return dataclasses.replace(case, runs=tuple(changed(run) for run in case.runs))


def stated(case: Case, **numbers: float) -> Case:
    return dataclasses.replace(case, parameters=case.parameters | {k: Known(v) for k, v in numbers.items()})


def table(case: Case, name: str, factor: float) -> Case:
    found = dataclasses.replace(case.tables[name], values=factor * case.tables[name].values)
    return dataclasses.replace(case, tables=case.tables | {name: found})


def times(factor: float):
    return lambda values: factor * values


RPM = 30.0 / np.pi
MISTAKES = [
    ("cell", "mV", lambda c: column(c, "voltage_V", times(1e3)), "run-0.csv", "multiply voltage_V by 0.001"),
    ("cell", "kV", lambda c: column(c, "voltage_V", times(1e-3)), "run-0.csv", "multiply voltage_V by 1000"),
    ("cell", "3 cells", lambda c: column(c, "voltage_V", times(3)), "run-0.csv", "divide voltage_V by the number"),
    ("cell", "mA", lambda c: column(c, "current_A", times(1e3)), "run-1.csv", "multiply current_A by 0.001"),
    ("cell", "sign", lambda c: column(c, "current_A", times(-1)), "run-1.csv", "multiply current_A by -1"),
    ("cell", "minutes", lambda c: column(c, "time_s", times(1 / 60)), "run-", "multiply time_s by 60"),
    ("cell", "hours", lambda c: column(c, "time_s", times(1 / 3600)), "run-", "multiply time_s by 3600"),
    ("cell", "ms", lambda c: column(c, "time_s", times(1e3)), "run-1.csv", "multiply time_s by 0.001"),
    ("cell", "mAh", lambda c: stated(c, capacity_Ah=2600.0), "capacity_Ah = 2600", "multiply capacity_Ah by 0.001"),
    ("cell", "mohm", lambda c: table(c, "R_ints", 1e3), "case.toml", "multiply R_ints.ohm by 0.001"),
    ("cell", "mV of ocv", lambda c: table(c, "ocv", 1e3), "case.toml", "multiply ocv.voltage_V by 0.001"),
    ("cell", "kelvin", lambda c: column(c, "cell_temperature_degC", lambda t: t + 273.15), "run-0.csv",
     "subtract 273.15 from cell_temperature_degC"),
    ("cell", "kelvin of ambient", lambda c: column(c, "ambient_degC", lambda t: t + 273.15), "298.15 at time_s = 0",
     "subtract 273.15 from ambient_degC"),
    ("cell", "degF", lambda c: column(c, "cell_temperature_degC", lambda t: 1.8 * (t + 5.0) + 32.0 - 9.0), "run-0.csv",
     "subtract 32 from cell_temperature_degC and divide by 1.8"),
    ("motor", "rpm", lambda c: column(c, "speed_rad_s", times(RPM)), "run-0.csv", "multiply speed_rad_s by 0.10472"),
    ("motor", "deg/s", lambda c: column(c, "speed_rad_s", times(180 / np.pi)), "run-0.csv", "speed_rad_s by 0.017453"),
    ("motor", "turns/s", lambda c: column(c, "speed_rad_s", times(0.5 / np.pi)), "run-0.csv", "speed_rad_s by 6.2832"),
    ("motor", "speed's sign", lambda c: column(c, "speed_rad_s", times(-1)), "run-0.csv", "speed_rad_s by -1"),
    ("motor", "mA", lambda c: column(c, "current_A", times(1e3)), "run-0.csv", "multiply current_A by 0.001"),
    ("motor", "current's sign", lambda c: column(c, "current_A", times(-1)), "run-0.csv", "current_A by -1"),
    ("motor", "mV", lambda c: column(c, "voltage_V", times(1e3)), "run-0.csv", "multiply voltage_V by 0.001"),
    ("motor", "mN m", lambda c: column(c, "load_torque_Nm", times(1e3)), "run-0.csv", "load_torque_Nm by 0.001"),
    ("motor", "N cm", lambda c: column(c, "load_torque_Nm", times(1e2)), "run-0.csv", "load_torque_Nm by 0.01"),
    ("motor", "mN m/A", lambda c: stated(c, k_tau=38.5), "k_tau = 38.5", "multiply k_tau by 0.001"),
    ("motor", "mohm", lambda c: stated(c, R_0=103.0), "R_0 = 103", "multiply R_0 by 0.001"),
    ("motor", "g cm2", lambda c: stated(c, J=542.0), "J = 542", "multiply J by 1e-07"),
    ("motor", "kelvin", lambda c: column(c, "winding_temperature_degC", lambda t: t + 273.15), "run-0.csv",
     "subtract 273.15 from winding_temperature_degC"),
    ("robot", "percent", lambda c: column(c, "duty", times(100)), "run-0.csv", "multiply duty by 0.01"),
    ("robot", "mV", lambda c: column(c, "pack_voltage_V", times(1e3)), "run-0.csv", "pack_voltage_V by 0.001"),
    ("robot", "one cell's", lambda c: column(c, "pack_voltage_V", times(1 / 6)), "run-0.csv", "by n_series = 6"),
    ("robot", "mA", lambda c: column(c, "pack_current_A", times(1e3)), "run-0.csv", "pack_current_A by 0.001"),
    ("robot", "sign", lambda c: column(c, "pack_current_A", times(-1)), "run-0.csv", "pack_current_A by -1"),
    ("robot", "mA of a motor", lambda c: column(c, "motor_current_A", times(1e3)), "run-0.csv", "current_A by 0.001"),
    ("robot", "rpm", lambda c: column(c, "speed_rad_s", times(RPM)), "run-0.csv", "speed_rad_s by 0.10472"),
]  # fmt: skip


def test_a_right_case_of_each_kind_is_taken(right: dict[str, Case]) -> None:
    for case in right.values():
        check(case)
        assert doubts(case) == ()


@pytest.mark.parametrize(
    ("kind", "change", "place", "mend"), [pytest.param(m[0], *m[2:], id=f"{m[0]}: {m[1]}") for m in MISTAKES]
)
def test_a_wrong_unit_or_sign_is_refused_with_its_mend(right, kind, change, place, mend) -> None:
    with pytest.raises(MeasurementError) as caught:
        check(change(right[kind]))
    sentence = str(caught.value)
    assert place in sentence
    assert mend in sentence
    # Of a speed and a voltage of opposite signs either may be wrong; else no other mend is as good.
    assert ("; or " in sentence) == ("speed_rad_s by -1" in sentence)
    assert sentence.startswith("bench/")
    assert sentence.endswith(".")
    assert "\n" not in sentence


def test_one_file_in_another_unit_is_named(right: dict[str, Case]) -> None:
    case = right["cell"]
    wrong = column(case, "current_A", times(-1.0)).runs[0]
    with pytest.raises(MeasurementError, match=r"run-0\.csv, column 'current_A': .* by -1"):
        check(dataclasses.replace(case, runs=(wrong, case.runs[1])))


def test_a_current_is_refused_by_its_charge_where_no_voltage_is_measured(right: dict[str, Case]) -> None:
    silent = column(right["cell"], "voltage_V", lambda v: np.full(v.shape, np.nan))
    check(silent)
    with pytest.raises(MeasurementError, match=r"times capacity_Ah = 2\.6, and a cell holds one; if it is in mA"):
        check(column(silent, "current_A", times(1e3)))


def test_what_has_another_explanation_is_only_doubted(right: dict[str, Case]) -> None:
    """One run that begins warm may be in degF; the same at two temperatures of the room is no chance."""
    case = column(right["cell"], "cell_temperature_degC", lambda t: 1.8 * t + 32.0)
    with pytest.raises(MeasurementError, match="degF"):
        check(case)
    alone = dataclasses.replace(case, runs=case.runs[:1])
    check(alone)
    (doubt,) = doubts(alone)
    assert (doubt.code, doubt.subject) == ("not_likely", "cell_temperature_degC")
    assert "77 at the first row" in doubt
    assert "divide by 1.8, unless that is so." in doubt


def test_a_dead_sensor_and_a_current_that_says_nothing_are_let_pass(right: dict[str, Case]) -> None:
    rng = np.random.default_rng(0)
    check(column(right["cell"], "voltage_V", np.zeros_like))
    check(column(right["cell"], "current_A", np.zeros_like))
    check(column(right["cell"], "current_A", rng.permutation))
    check(column(right["motor"], "speed_rad_s", np.zeros_like))
    check(column(right["motor"], "current_A", np.zeros_like))


@pytest.mark.parametrize(
    ("line", "mend"),
    [
        ("initial_soc = 95", "if it is in percent, divide it by 100"),
        ("storage_temperature_degC = 293.15", "if it is in kelvin, subtract 273.15"),
        ("capacity_Ah = 3e6", "if it is in mA h, multiply it by 0.001"),
        ("capacity_Ah = 3e9", "correct the value or its unit"),
        ("cycles = 1e6", "correct the value or its unit"),
    ],
)
def test_a_parameter_beyond_its_bounds_is_refused_with_its_mend(tmp_path: Path, line: str, mend: str) -> None:
    text = f'kind = "cell"\n[parameters]\n{line}\n[[runs]]\nfile = "run.csv"\nsplit = "fit"\n'
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    (tmp_path / "run.csv").write_text("time_s,current_A,ambient_degC\n0,1,20\n1,1,20\n", encoding="utf-8")
    with pytest.raises(ParameterError, match=mend):
        read_case(tmp_path)


def test_a_case_is_checked_when_it_is_read(tmp_path: Path, right: dict[str, Case]) -> None:
    """With what its preset states: 3.0 A h of a Samsung 30Q, whose current is in mA here."""
    measured = right["cell"].runs[0].measured
    frame = pd.DataFrame({"time_s": TIME_S, **measured.inputs, "voltage_V": measured.outputs["voltage_V"]})
    (tmp_path / "case.toml").write_text(
        'kind = "cell"\npreset = "samsung_30q"\n[[runs]]\nfile = "run.csv"\nsplit = "fit"\n', encoding="utf-8"
    )
    frame.to_csv(tmp_path / "run.csv", index=False)
    read_case(tmp_path)
    frame.assign(current_A=1e3 * frame["current_A"]).to_csv(tmp_path / "run.csv", index=False)
    with pytest.raises(MeasurementError, match=r"run\.csv, column 'current_A': .* multiply current_A by 0\.001"):
        read_case(tmp_path)
    frame.assign(ambient_degC=293.15).to_csv(tmp_path / "run.csv", index=False)
    with pytest.raises(MeasurementError, match=r"'ambient_degC': 293\.15 at time_s = 0, .* subtract 273\.15"):
        read_case(tmp_path)


@settings(max_examples=40, deadline=None)
@given(
    capacity=st.floats(0.2, 300.0),
    rate=st.floats(0.05, 3.0),
    charge=st.booleans(),
    ambient=st.floats(-20.0, 50.0),
    soc=st.floats(0.2, 0.9),
    resistance=st.floats(0.3, 1.5),
    with_tables=st.booleans(),
    noise=st.floats(0.0, 0.01),
)
def test_a_right_cell_is_never_refused(capacity, rate, charge, ambient, soc, resistance, with_tables, noise) -> None:
    depth = min(rate * 3000.0 / 3600.0, (1.0 - soc) if charge else soc)
    current = capacity * depth * 1.2 * PULSES * (-1.0 if charge else 1.0)
    scale = {"series_resistance_scale": 0.5, "rc_resistance_scale": 0.5, "rc_capacitance_scale": 2.0}
    size = {name: value * (5.2 / capacity) ** (-1 if "capac" in name else 1) for name, value in scale.items()}
    tables = {}
    if with_tables:
        at = np.array([0.0, 1.0])
        tables = TABLES | {"R_ints": Table(at, np.full(2, 0.1 * resistance / capacity))}
        size["series_resistance_scale"] = 1.0
    numbers = {name: float(np.clip(value, 1e-3, 1e3)) for name, value in size.items()}
    case = case_of(
        "cell",
        [{"current_A": current, "ambient_degC": ambient, "soc": soc}],
        {"capacity_Ah": capacity} | numbers,
        tables,
    )
    rng = np.random.default_rng(1)
    check(column(case, "voltage_V", lambda v: v + noise * rng.standard_normal(v.size)))


@settings(max_examples=40, deadline=None)
@given(
    k_tau=st.floats(1e-3, 1.0),
    supply=st.floats(2.0, 48.0),
    share=st.floats(0.0, 0.6),
    stall=st.floats(1.0, 200.0),
    ambient=st.floats(-20.0, 50.0),
    backwards=st.booleans(),
)
def test_a_right_motor_is_never_refused(k_tau, supply, share, stall, ambient, backwards) -> None:
    sign, winding = (-1.0 if backwards else 1.0), supply / stall
    numbers = {"k_tau": k_tau, "R_0": winding, "tau_0": 0.02 * k_tau * stall, "J": 0.5 * k_tau**2 / winding}
    inputs = {
        "voltage_V": sign * supply * PULSES,
        "load_torque_Nm": sign * share * k_tau * stall * PULSES,
        "ambient_degC": ambient,
    }
    numbers |= {"R_wc": 1.0 / (winding * stall), "R_ca": 2.0 / (winding * stall)}
    check(case_of("motor", [inputs], numbers, {}))


@pytest.mark.parametrize(
    "path",
    [*shared_cases(), *(REPOSITORY / "examples" / n for n in ("samsung_30q", "paper_table1", "paper_experiment"))],
    ids=lambda path: path.name,
)
def test_real_and_development_cases_are_taken(path: Path) -> None:
    assert tomllib.loads((path / "case.toml").read_text())["kind"] == read_case(path).kind


def test_a_capacity_that_nobody_stated_refuses_no_cell(right: dict[str, Case]):
    """The paper's capacity stands in for it: what rests on that is a doubt, and says that none is stated."""
    wrong = column(right["cell"], "current_A", lambda values: 1000.0 * values)
    with pytest.raises(MeasurementError, match="it is in mA"):
        check(wrong)
    unstated = {name: known for name, known in wrong.parameters.items() if name != "capacity_Ah"}
    wrong = dataclasses.replace(wrong, parameters=unstated)
    check(wrong)
    (doubt,) = doubts(wrong)
    assert "because none is stated: state it" in doubt
    assert "it is in mA" in doubt
