"""`mission` and `estimate` from files to a page."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.app.commands import compensate as compensate_command
from jaxmodel.app.commands import mission as mission_command
from jaxmodel.case.build import preset_model
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate
from jaxmodel.operation import state_of_charge
from tests.app.conftest import Run
from tests.app.test_mistakes import assert_one_sentence

MISSION = """title = "Up and down"
step_s = 60

[[segment]]
what = "up"
duration_s = 300
speed_m_s = 0.1
incline_deg = 10

[[segment]]
what = "standing"
duration_s = 300
"""


@pytest.mark.slow
def test_mission_ends_with_a_page(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mission_command, "usual_models", lambda: {"printed": preset_model("paper", "robot")})
    monkeypatch.setattr(mission_command, "AMBIENT_DEGC", np.array([-20.0, 20.0]))
    (tmp_path / "m.toml").write_text(MISSION, encoding="utf-8")
    out = tmp_path / "out"
    result = run("mission", tmp_path / "m.toml", "--age", "0,0", "--age", "36,200", "--out", out)
    assert result.exit_code == 0, result.output
    table = pd.read_csv(out / "endurance.csv").set_index(["ambient_degC", "age"])
    assert table.shape[0] == 4
    new, old = (table.loc[20.0, age] for age in ("0 months, 0 cycles", "36 months, 200 cycles"))
    assert old["minutes"] < new["minutes"] < 8 * 60
    limits = table[["charge_minutes", "voltage_minutes", "winding_minutes"]].min(axis=1)
    np.testing.assert_allclose(table["minutes"], limits)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 2
    assert "Up and down" in page


def made_case(folder: Path) -> Path:
    """Runs of an hour and a half of the paper's cell, simulated: one to tune on, one to score."""
    cell = preset_model("paper", "cell")
    rng = np.random.default_rng(0)
    text = 'title = "Made"\nkind = "cell"\n'
    for number, split in enumerate(("fit", "check")):
        time_s = np.arange(0.0, 5400.0, 4.0)
        current = np.repeat(rng.uniform(0.0, 4.0, time_s.size // 15 + 1), 15)[: time_s.size]
        inputs = {"current_A": current, "ambient_degC": np.full(time_s.size, 20.0)}
        ran = simulate(cell, Profile(time_s, inputs))
        columns = {"time_s": time_s, **inputs}
        columns |= {name: np.asarray(ran.readings[name]) for name in ("voltage_V", "soc")}
        columns["voltage_V"] = columns["voltage_V"] + rng.normal(0.0, 2e-3, time_s.size)
        pd.DataFrame(columns).to_csv(folder / f"{number}.csv", index=False, float_format="%.6g")
        text += f'\n[[runs]]\nfile = "{number}.csv"\nsplit = "{split}"\ninitial_soc = 1.0\n'
    (folder / "case.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.slow
def test_estimate_ends_with_a_page(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(state_of_charge, "BATCH", 8)
    case, out = made_case(tmp_path), tmp_path / "out"
    result = run("estimate", case, "--tunings", 2, "--out", out)
    assert result.exit_code == 0, result.output
    errors = pd.read_csv(out / "errors.csv")
    assert set(errors.run) == {"1"} or set(errors.run) == {1}  # of the check run alone
    of = errors[errors["from"] == "start"].groupby("estimator").rms.max()
    # The cell is the filter's own: it finds the charge, and counting from a wrong start never does.
    assert of[state_of_charge.FILTER] < 0.02
    assert of[state_of_charge.COUNTED] == pytest.approx(0.3)
    tuning = json.loads((out / "tuning.json").read_text(encoding="utf-8"))
    again = run("estimate", case, "--tuning", out / "tuning.json", "--out", tmp_path / "again")
    assert again.exit_code == 0, again.output
    assert json.loads((tmp_path / "again" / "tuning.json").read_text(encoding="utf-8")) == tuning
    np.testing.assert_allclose(pd.read_csv(tmp_path / "again" / "errors.csv").rms, errors.rms, rtol=1e-4)


@pytest.mark.slow
def test_robot_that_drives_nowhere_on_the_map_is_told(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compensate_command, "AMBIENT_DEGC", np.array([0.0, 20.0]))
    monkeypatch.setattr(compensate_command, "TORQUE_NM", np.array([0.1, 0.2]))
    weak = tmp_path / "weak"
    weak.mkdir()
    (weak / "case.toml").write_text(
        'kind = "robot"\n[parameters]\nk_tau = 0.01\nR_0 = 0.5\nn_series = 2\n'
        '[[runs]]\nfile = "r.csv"\nsplit = "fit"\n',
        encoding="utf-8",
    )
    (weak / "r.csv").write_text("time_s,ambient_degC,duty,load_torque_Nm\n0,20,0.3,0.1\n1,20,0.3,0.1\n", "utf-8")
    result = run("compensate", "--model", weak, "--out", tmp_path / "out")
    assert_one_sentence(result, "weak: this robot does not drive at any point of the map, 0.1 to 0.2 N m")
