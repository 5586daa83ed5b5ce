"""A worker does its jobs, says how far it is, stops when it is asked to, and goes on from its files when it is new."""

from __future__ import annotations

import json
import secrets
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from jaxmodel.app.browser.files import PROGRESS, STOP, WANTED, read_json
from jaxmodel.app.browser.sessions import Session, Sessions
from jaxmodel.app.browser.worker.__main__ import do
from jaxmodel.app.browser.worker.exploring import _liveliest
from jaxmodel.app.browser.worker.keeping import script_of
from jaxmodel.app.browser.worker.place import Place
from jaxmodel.app.browser.worker.progress import Progress, Stopped
from jaxmodel.app.browser.worker.view import sweepable
from jaxmodel.app.browser.workers import MOST, Worker, Workers
from jaxmodel.case.records import Case


class StandIn(Worker):
    """A worker that notes what it is told."""

    def __init__(self) -> None:
        self.told: list[dict[str, Any]] = []
        self.is_dead, self.used_at = False, 0.0

    @property
    def lives(self) -> bool:
        return not self.is_dead

    def tell(self, line: dict[str, Any]) -> None:
        self.told.append(line)

    def end(self) -> None:
        self.is_dead = True


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Sessions(tmp_path).new("a" * 32)


@pytest.fixture
def workers(monkeypatch: pytest.MonkeyPatch) -> Workers:
    monkeypatch.setattr("jaxmodel.app.browser.workers.Worker", StandIn)
    return Workers(spare=False)


def job(place: Place, name: str, **with_: Any) -> dict[str, Any]:
    """Do a job in this process, and return how it ended."""
    do(place, {"id": secrets.token_hex(8), "do": name, "with": with_})
    return read_json(place.folder / PROGRESS)


def test_what_a_session_shows_is_what_the_investigation_says(session: Session, made_case: Path) -> None:
    from jaxmodel.case.reading import read_case
    from jaxmodel.diagnosis import Investigation

    place = Place(session.folder)
    assert job(place, "open", path=str(made_case), how="case")["state"] == "done"
    assert job(place, "add", names=["self_heating"])["state"] == "done"
    view = session.view
    own = Investigation(read_case(made_case))
    first = own.candidates()["name"].iloc[0]
    own.add("self_heating")
    ladder = own.ladder()
    for place_in_ladder, rung in enumerate(view["ladder"]):
        for channel, error in rung["errors"].items():
            assert error["fit"] == pytest.approx(ladder[f"{channel} fit"].iloc[place_in_ladder])
            assert error["check"] == pytest.approx(ladder[f"{channel} check"].iloc[place_in_ladder])
    assert first == "self_heating"
    # A new worker goes on from the files: the same model, the same numbers.
    again = Place(session.folder)
    assert job(again, "undo")["state"] == "done"
    assert [rung["present"] for rung in session.view["ladder"]] == [True]


def test_a_mistake_is_the_sentence_of_the_command_line(session: Session, tmp_path: Path) -> None:
    ended = job(Place(session.folder), "open", path=str(tmp_path / "nothing"), how="case")
    assert ended["state"] == "failed"
    assert "no case.toml" in ended["now"]
    assert session.view["stage"] == "empty"


def test_a_job_ends_where_it_next_reports_once_it_is_to_stop(tmp_path: Path) -> None:
    progress = Progress(tmp_path, {"id": "1", "do": "diagnose"})
    progress("refitting with self_heating")
    (tmp_path / STOP).touch()
    with pytest.raises(Stopped):
        progress("refitting with another")


def test_time_left_follows_from_how_long_it_took_before(tmp_path: Path) -> None:
    Progress(tmp_path, {"id": "1", "do": "add"}, usual_s=40.0)("scoring every candidate")
    assert read_json(tmp_path / PROGRESS)["left_s"] == pytest.approx(40.0, abs=1.0)


def test_a_diagnosis_is_estimated_anew_whatever_the_last_one_took(tmp_path: Path) -> None:
    progress = Progress(tmp_path, {"id": "1", "do": "diagnose"}, usual_s=4000.0)
    progress("trying 8 candidates")
    assert read_json(tmp_path / PROGRESS)["left_s"] is None
    assert read_json(tmp_path / PROGRESS)["share"] == 0.0


def test_a_sweep_is_estimated_from_its_second_report_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1000.0]
    monkeypatch.setattr("jaxmodel.app.browser.worker.progress.time.time", lambda: now[0])
    tell = Progress(tmp_path, {"id": "1", "do": "sweep"}).counted("sweep", "lanes")
    for seconds, done in ((60.0, 500), (10.0, 1000)):  # a minute of compiling, and a part that was there before
        now[0] += seconds
        tell(done, 2000)
    assert read_json(tmp_path / PROGRESS)["left_s"] == pytest.approx(20.0)


def test_candidates_stand_in_the_order_of_the_number_that_is_shown(session: Session, made_case: Path) -> None:
    place = Place(session.folder)
    assert job(place, "open", path=str(made_case), how="case")["state"] == "done"
    found = session.view["candidates"]
    shares = [one["share"] for one in found]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] == 1.0
    assert found[0]["name"] == "self_heating"
    assert found[0]["reason"].endswith("Nothing else explains more.")
    for one in found[1:]:
        if one["share"] > 0.0:
            percent = f"{100.0 * one['share']:.0f} %" if one["share"] >= 0.01 else "less than 1 %"
            assert one["reason"].endswith(f"It explains {percent} of what self heating explains.")
        else:
            assert one["reason"] == "These runs give no reason to add it."


def test_an_axis_that_changes_nothing_is_not_offered(session: Session, made_case: Path) -> None:
    place = Place(session.folder)
    assert job(place, "open", path=str(made_case), how="case")["state"] == "done"
    offered = {one["name"] for one in session.view["sweepable"]}
    assert {"capacity_Ah", "initial_soc"} <= offered
    assert not {"mass_kg", "k_tau", "gear_ratio", "n_series"} & offered
    job(place, "add", names=["self_heating"])
    assert "self_heating.hA" in {one["name"] for one in session.view["sweepable"]}  # that of the present model
    job(place, "add", names=["voltage_offset:voltage_V"])
    assert not any(one["name"].startswith("voltage_offset") for one in session.view["sweepable"])


def test_an_axis_of_whole_numbers_has_whole_values() -> None:
    rows = {"time_s": [0.0, 10.0, 20.0], "ambient_degC": 20.0, "duty": 0.5, "load_torque_Nm": 0.05}
    robot = Case.from_dataframes({"drive": pd.DataFrame(rows | {"pack_voltage_V": 22.0})}, kind="robot")
    cells = next(one for one in sweepable(robot) if one["name"] == "n_series")
    assert (cells["low"], cells["high"], cells["count"]) == (4.0, 8.0, 5)


def test_the_first_map_is_that_of_the_metric_that_varies_most() -> None:
    across, up = np.meshgrid([1.0, 2.0, 3.0], [1.0, 2.0], indexing="ij")
    gone = np.full((3, 2), np.nan)
    of_one_axis = {"stripes": 10.0 * across, "flat": 100.0 + up, "gone": gone}
    data = xr.Dataset({name: (("x", "y"), values) for name, values in of_one_axis.items()})
    assert _liveliest(data) == "stripes"
    assert _liveliest(data.assign(both=(("x", "y"), 20.0 + across + up))) == "both"


def test_one_job_at_a_time(session: Session, workers: Workers) -> None:
    assert workers.do(session, "compare")
    assert not workers.do(session, "add", names=["self_heating"])


def test_a_job_that_does_not_stop_is_ended_with_its_worker(
    session: Session, workers: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    workers.do(session, "diagnose")
    workers.stop(session)
    workers.look_after(session)
    assert session.wanted is not None  # it has a few seconds
    monkeypatch.setattr("jaxmodel.app.browser.workers.PATIENCE_S", -1.0)
    workers.look_after(session)
    assert session.wanted is None
    assert session.progress is not None
    assert session.progress["state"] == "stopped"
    assert workers.do(session, "compare")  # with a new worker


def test_a_worker_that_died_is_said(session: Session, workers: Workers) -> None:
    workers.do(session, "diagnose")
    next(iter(workers._of.values())).end()
    workers.look_after(session)
    assert session.progress is not None
    assert session.progress["state"] == "failed"
    assert "worker.log" in session.progress["now"]


def test_what_was_wanted_before_a_crash_is_begun_again(session: Session, workers: Workers) -> None:
    session.want("add", names=["self_heating"])
    workers.take_up(session)
    (worker,) = workers._of.values()
    assert worker.told[-1]["with"] == {"names": ["self_heating"]}


def test_where_every_worker_has_a_job_a_further_one_waits(tmp_path: Path, workers: Workers) -> None:
    sessions = [Sessions(tmp_path).new("a" * 32) for _ in range(MOST + 2)]
    assert all(workers.do(one, "compare") for one in sessions)
    assert len(workers._of) == MOST
    assert [(one.progress or {})["now"] for one in sessions[MOST - 1 :]] == [
        "starting",
        f"waiting for {MOST} jobs of other sessions",
        f"waiting for {MOST + 1} jobs of other sessions",
    ]
    workers.stop(sessions[MOST])  # who waits no longer leaves the place to the next
    assert sessions[MOST].wanted is None
    sessions[0].was_stopped()
    workers.look_after(sessions[1])
    assert workers._of[sessions[-1].folder].told[-1]["do"] == "compare"  # type: ignore[attr-defined]
    assert sessions[0].folder not in workers._of  # the idle one made room


def test_a_worker_that_is_about_to_say_how_its_job_ended_is_not_taken_for_idle(
    tmp_path: Path, workers: Workers
) -> None:
    sessions = [Sessions(tmp_path).new("a" * 32) for _ in range(MOST + 1)]
    for one in sessions[:-1]:
        workers.do(one, "compare")
    (sessions[0].folder / WANTED).unlink()  # and its progress still says that it runs
    workers.do(sessions[-1], "compare")
    assert sessions[0].folder in workers._of
    assert workers._of[sessions[0].folder].lives


def test_what_was_done_before_a_crash_is_not_done_again(session: Session, made_case: Path) -> None:
    place = Place(session.folder)
    job(place, "open", path=str(made_case), how="case")
    job(place, "add", names=["self_heating"])
    undo = {"id": "2", "do": "undo", "with": {}}
    do(place, undo)
    do(Place(session.folder), undo)  # of a server that was killed before it saw the end
    assert session.progress is not None
    assert session.progress["state"] == "done"
    assert [verb for verb, _ in session.view["script"]] == ["add", "undo"]


def test_an_import_takes_what_a_form_sends_as_text(session: Session, tmp_path: Path) -> None:
    time = 0.01 * np.arange(400)
    frame = pd.DataFrame({"time_s": time, "voltage_V": 6.0 * np.sign(np.sin(3.0 * time)), "current_A": np.sin(time)})
    files = []
    for name in ("a_1", "b_1", "b_2"):
        files.append(str(tmp_path / f"{name}.csv"))
        frame.assign(speed_rad_s=100.0 * np.sin(2.9 * time), reference_speed_rad_s=100.0).to_csv(files[-1], index=False)
    form = {
        "ambient": "22,5", "load": "gravity", "load_numbers": "mass_kg=0.1, arm_m=0.2", "controller": "speed",
        "controller_numbers": "k_p=0.1", "specimens": "A=a_*, B=b_*", "check": "b_2", "each_cell": "", "columns": {},
    }  # fmt: skip
    place = Place(session.folder)
    assert job(place, "import", files=files, kind="motor", options=form)["state"] == "done"
    case, options = session.view["case"], session.view["source"]["options"]
    assert (case["load"], case["controller"]) == ("gravity", "speed")
    assert [(run["specimen"], run["split"]) for run in case["runs"]] == [("A", "fit"), ("B", "fit"), ("B", "check")]
    assert options["specimens"] == {"A": "a_*", "B": "b_*"}
    assert options["controller_numbers"] == {"k_p": 0.1}
    program = script_of(session.view)
    assert "specimens={'A': 'a_*', 'B': 'b_*'}, check=['b_2'], ambient=22.5" in program
    wrong = job(place, "import", files=files, kind="motor", options=form | {"controller_numbers": "k_p"})
    assert wrong["state"] == "failed"
    assert wrong["now"].startswith("--controller k_p: give position:NAME=VALUE")


@pytest.mark.slow
def test_the_script_repeats_the_session(made_case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view = {"source": {"how": "case"}, "path": str(made_case), "script": [["add", ["self_heating"]], ["undo", []]]}
    program = script_of(view)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(program, "session.py", "exec"), names)
    assert names["investigation"].added == ()
    assert tomllib.loads((tmp_path / "extended" / "case.toml").read_text(encoding="utf-8"))["kind"] == "cell"


def test_what_pages_show_is_json_without_nan(session: Session, made_case: Path) -> None:
    place = Place(session.folder)
    job(place, "open", path=str(made_case), how="case")
    json.dumps(session.view, allow_nan=False)
    index = read_json(session.folder / "previews" / "index.json")
    left = np.load(session.folder / "previews" / "left.npy")
    assert left.shape == (len(index["names"]), index["series"][-1]["last"])


def test_the_diagnoses_of_a_session_are_kept_and_compared(session: Session, made_case: Path) -> None:
    place = Place(session.folder)
    job(place, "open", path=str(made_case), how="example")
    for label in ("self_heating", "voltage_offset:voltage_V"):
        assert job(place, "add", names=[label])["state"] == "done"
        assert job(place, "keep")["state"] == "done"
    job(place, "keep")  # once more: it is the same diagnosis
    newest, first = place.view["answers"]
    assert first["named"] == ["self heating"]
    assert newest["named"] == ["self heating", "voltage offset of voltage"]
    assert job(place, "changes", before=first["name"], after=newest["name"])["state"] == "done"
    shown = place.view["changes"]
    names = {one["name"]: (one["before"], one["after"].split()[0]) for one in shown["names"]}
    assert names["voltage offset of voltage"] == ("absent", "named")
    assert {one["run"] for one in shown["errors"]} >= {"run-01", "all fit runs", "all check runs"}
    assert "The data are the same." in shown["sentences"]
    assert job(place, "changes", before="../../x", after=first["name"])["state"] == "failed"
    # A worker that begins anew lists them as before.
    assert Place(session.folder).view["answers"] == [newest, first]
