"""What people bring of motors and cells: single readings far off are left out, and no kind of run is all held out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.data.importing import Imported, import_case
from tests.conftest import Wild
from tests.data.importing.benches import cell_log

AT_REST, ON_A_RAMP = 12, 200


def motor_run(kind: str, volts: float, seed: int = 0, step_s: float = 0.01, rows: int = 400) -> pd.DataFrame:
    """A first-order motor of 0.05 V s/rad and 80 ms: a step in the second row, or a ramp."""
    drive = np.linspace(0.0, volts, rows) if kind == "ramp" else np.where(np.arange(rows) > 0, volts, 0.0)
    speed, found = 0.0, []
    for each in drive:
        push = each / 0.05 - speed
        speed += (push - np.sign(push) * min(abs(push), 10.0)) * step_s / 0.08
        found.append(speed)
    noisy = np.array(found) + 0.3 * np.random.default_rng(seed).standard_normal(rows)
    return pd.DataFrame({"t [ms]": 1e3 * step_s * np.arange(rows), "U [V]": drive, "n [rpm]": noisy * 30.0 / np.pi})


def imported(folder: Path, frames: dict[str, pd.DataFrame], kind: str = "motor", **options) -> Imported:
    for name, frame in frames.items():
        frame.to_csv(folder / f"{name}.csv", index=False)
    if kind == "motor":
        options |= {"columns": {"time_s": "t [ms]", "voltage_V": "U [V]", "speed_rad_s": "n [rpm]"}}
        options |= {"constants": {"load_torque_Nm": 0.0}}
    return import_case([folder / f"{name}.csv" for name in frames], kind, ambient=25.0, **options)


def held(one: Imported) -> set[str]:
    return {run.log.name for run in one.runs if run.split == "check"}


def spoilt(frame: pd.DataFrame, column: str, rows: list[int], value: float) -> pd.DataFrame:
    return frame.assign(**{column: frame[column].where(~frame.index.isin(rows), value)})


def test_the_only_slow_charge_is_fitted_and_the_only_fast_one_held_out(tmp_path: Path) -> None:
    """Half of the gap between slow branches is the hysteresis: without one of them there is none."""
    for hours, expected in ((20.0, set()), (1.0, {"charge"})):
        frames = {}
        for name, sign in (("charge", -1.0), ("discharge", 1.0)):
            passed = np.linspace(0.0, 1.0, 400)
            soc = passed if sign < 0.0 else 1.0 - passed
            volts = 3.0 + 1.1 * soc - sign * 0.05 / hours - sign * 0.01
            ends = [0.0] + [sign * 2.0 / hours] * 398 + [0.0]
            frame = pd.DataFrame({"time_s": 3600.0 * hours * passed, "current_A": ends, "voltage_V": volts})
            frames[name] = frame.assign(voltage_V=np.where(frame.current_A == 0.0, 3.0 + 1.1 * soc, volts))
        assert held(imported(tmp_path, frames, "cell", capacity_Ah=2.0)) == expected


@pytest.mark.parametrize("kind", ["ramp", "step"])
def test_a_spike_of_a_speed_is_named_and_left_out(tmp_path: Path, kind: str) -> None:
    clean = motor_run(kind, 24.0)
    rows = [3, AT_REST, ON_A_RAMP]
    one = imported(tmp_path, {"run": spoilt(clean, "n [rpm]", rows, -9e3)})
    (spike,) = [finding for finding in one.findings if finding.what == "spike"]
    assert "3 single readings of speed_rad_s" in spike.sentence
    assert "left out as outliers; that is 0.8% of its readings" in spike.sentence
    assert list(np.flatnonzero(np.isnan(one.runs[0].log.columns["speed_rad_s"]))) == rows
    assert not [f for f in imported(tmp_path, {"clean": clean}).findings if f.what == "spike"]


@pytest.mark.parametrize(("column", "value"), [("voltage_V", 0.0), ("temperature_degC", -40.0)])
def test_a_spike_of_a_cell_is_left_out_under_load_and_at_rest(tmp_path: Path, column: str, value: float) -> None:
    rows = [30, 300]  # at rest, and while 2.9 A flow
    one = imported(tmp_path, {"log": spoilt(cell_log(), column, rows, value)}, "cell")
    read = one.runs[0].log.columns["cell_temperature_degC" if column == "temperature_degC" else column]
    assert list(np.flatnonzero(np.isnan(read))) == rows
    assert np.nanmin(read) > value + 1.0


def test_a_spike_of_a_cells_current_is_left_out_where_the_voltage_did_not_follow(tmp_path: Path) -> None:
    log = cell_log()
    one = imported(tmp_path, {"log": spoilt(log, "current_A", [30, 300], 65.5)}, "cell", sign="discharge-positive")
    np.testing.assert_allclose(one.runs[0].log.columns["current_A"], log.current_A)
    (spike,) = [finding for finding in one.findings if finding.what == "spike"]
    assert "2 single readings of current_A" in spike.sentence
    pulsed = spoilt(log, "current_A", [30, 300], 65.5)
    pulsed["voltage_V"] -= 0.03 * (pulsed.current_A - log.current_A)
    true = imported(tmp_path, {"log": pulsed}, "cell", sign="discharge-positive")
    assert true.runs[0].log.columns["current_A"][30] == 65.5, "the voltage followed"
    assert np.isfinite(true.runs[0].log.columns["voltage_V"]).all()


def test_the_inrush_of_a_current_is_no_spike(tmp_path: Path) -> None:
    frame = motor_run("step", 24.0, rows=200)
    current = np.where(np.arange(200) > 0, 1.0, 0.0) + 0.01 * np.random.default_rng(1).standard_normal(200)
    current[1] += 30.0
    one = imported(tmp_path, {"run": frame.assign(current_A=current)})
    assert np.isfinite(one.runs[0].log.columns["current_A"]).all()


def test_of_ramps_and_steps_one_direction_is_held_out(tmp_path: Path) -> None:
    kinds = {"sweep_up": ("ramp", 12.0), "sweep_down": ("ramp", -12.0), "jump_up": ("step", 9.0)}
    kinds |= {"jump_down": ("step", -9.0)}
    one = imported(tmp_path, {name: motor_run(*which) for name, which in kinds.items()})
    assert held(one) == {"sweep_down", "jump_down"}
    (why,) = [decision.why for decision in one.decisions if decision.about == "check runs"]
    assert "one direction" in why
    assert "friction that differs between the directions is not fitted" in why


def test_a_repetition_is_held_out_and_never_the_only_ramp(tmp_path: Path) -> None:
    runs = {"a": motor_run("ramp", 12.0), "b": motor_run("step", 9.0), "c": motor_run("step", 9.0, seed=1)}
    assert held(imported(tmp_path, runs)) == {"c"}
    runs["d"], runs["e"] = motor_run("step", 4.0), motor_run("step", 6.0)
    assert held(imported(tmp_path, runs)) == {"e"}, "the load between others"


def test_where_each_run_is_the_only_one_of_its_kind_none_is_held_out(tmp_path: Path) -> None:
    one = imported(tmp_path, {"a": motor_run("ramp", 12.0), "b": motor_run("step", 9.0)})
    assert held(one) == set()
    (said,) = [finding.sentence for finding in one.findings if finding.what == "no check run"]
    assert "the only one of its kind (ramp, constant voltage)" in said
    assert "--check" in said


def test_many_near_loads_are_not_all_held_out(tmp_path: Path) -> None:
    runs = {f"u{volts:g}": motor_run("step", volts) for volts in (5.0, 8.0, 8.5, 9.0, 9.5, 11.5)}
    assert len(held(imported(tmp_path, runs))) == 1


def test_of_two_temperatures_what_it_costs_is_said(tmp_path: Path) -> None:
    frames = {f"cell_{degC}degC": cell_log()[::3].drop(columns="temperature_degC") for degC in (10, 40)}
    for name, frame in frames.items():
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
    one = import_case([tmp_path / f"{name}.csv" for name in frames], "cell")
    assert held(one) == {"cell_40degC"}
    (why,) = [decision.why for decision in one.decisions if decision.about == "check runs"]
    assert "change with temperature is not fitted" in why


def test_the_only_ramps_stay_to_be_fitted(wild: Wild) -> None:
    files = wild("15-split-takes-the-only-ramps")
    one = import_case(files, "motor", ambient=25.0, constants={"load_torque_Nm": 0.0})
    assert held(one) == {"dynamic_reverse", "quasistatic_reverse"}


def test_spikes_at_the_start_of_each_test_are_left_out(wild: Wild) -> None:
    files = wild("28-spikes-of-a-motor")
    one = import_case(files, "motor", ambient=25.0, constants={"load_torque_Nm": 0.0}, check=("*reverse",))
    for run in one.runs:
        assert list(np.flatnonzero(np.isnan(run.log.columns["speed_rad_s"]))) == [3, 7]
    assert sum(finding.what == "spike" for finding in one.findings) == 4
