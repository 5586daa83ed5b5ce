"""A session of the workbench, whatever its user does in whatever order: what it shows is true, and it goes on."""

from __future__ import annotations

import copy
import errno
import functools
import inspect
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from jaxmodel.app.browser.files import STOP, TRACES, UPLOADS, VIEW, read_json
from jaxmodel.app.browser.sessions import Sessions
from jaxmodel.app.browser.worker import keeping
from jaxmodel.app.browser.worker import place as places
from jaxmodel.app.browser.worker.__main__ import JOBS, do
from jaxmodel.app.browser.worker.place import Place
from jaxmodel.app.browser.worker.progress import Progress
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.search import Search
from tests.diagnosis.made_cases import investigation_of
from tests.made_up import write_case
from tests.stress.shortage import of_files
from tests.stress.trial import faults

ADDITIONS = ("self_heating", "voltage_offset:voltage_V", "arrhenius_resistance")
NAMES = st.lists(st.sampled_from((*ADDITIONS, *ADDITIONS, "self_heatin")), min_size=1, max_size=2)
Job = tuple[str, dict[str, Any]]
AXES = {
    "capacity_Ah": {"low": 2.5, "high": 3.5, "count": 3},
    "ambient_degC": {"low": 10.0, "high": 30.0, "count": 2},
    "self_heating.hA": {"low": 0.1, "high": 0.2, "count": 2},  # of a model that has it
}
TWO_AXES = st.permutations(sorted(AXES)).map(lambda names: {name: AXES[name] for name in names[:2]})

# What jobs take, by the name of the argument.
EXAMPLES = {
    "names": ["self_heating"],
    "before": "2025",
    "after": "2026",
    "run": "run-01",
    "axes": AXES,
    "point": {"ambient_degC": 20.0},
    "resume": False,
}


_FOLDER = tempfile.TemporaryDirectory(prefix="made")  # as long as the process
_KNOWN: dict[str, Investigation] = {}


def quick(case: Case, *, progress: Any = True) -> Investigation:
    """An investigation in which few candidates could be missing, and which finds what was fitted before."""
    assert case.path is not None
    lines = case.path.read_text(encoding="utf-8").splitlines()
    key = "\n".join(line for line in lines if not line.startswith("file"))
    one = copy.copy(_KNOWN.setdefault(key, _KNOWN.get(key) or investigation_of(case, *ADDITIONS)))
    one._progress, one.searching = progress, Search(one.cache)
    one.cache._progress = lambda now: one._tell(now)
    return one


@functools.cache
def made() -> Path:
    """The small case."""
    return write_case(Path(_FOLDER.name) / "small")


def jobs() -> st.SearchStrategy[Job]:
    """What pages may ask for, and what they would not."""
    small = str(made())
    run = st.sampled_from(("run-01", "run-02", "run-03", "run-09"))
    fixed = st.fixed_dictionaries
    asked: Mapping[str, st.SearchStrategy[dict[str, Any]]] = {
        "open": fixed({"path": st.sampled_from((small, small, f"{small}/nowhere")), "how": st.just("case")}),
        "upload": st.just({"kind": "", "options": {}}),
        "import": fixed({"files": st.just([f"{small}/run-01.csv"]), "kind": st.sampled_from(("cell", "motor", "car")),
                         "options": st.sampled_from(({}, {"ambient": "22,5"}, {"ambient": "warm"}))}),
        "compare": st.just({}),
        "add": fixed({"names": NAMES}),
        "drop": fixed({"names": NAMES}),
        "undo": st.just({}),
        "diagnose": st.just({}),
        "next": st.just({}),
        "changes": fixed({"before": st.just("2025"), "after": st.just("2026")}),
        "forecast": fixed({"run": run, "axes": TWO_AXES}),
        "sweep": fixed({"run": run, "axes": TWO_AXES, "resume": st.booleans()}),
        "sensitivity": fixed({"run": run, "point": st.sampled_from(({"ambient_degC": 20.0}, {"x": 1.0}))}),
        "keep": st.just({}),
    }  # fmt: skip
    assert {*asked} == {*JOBS}
    often = (*["add"] * 6, *["undo"] * 4, *["drop"] * 2, *["diagnose"] * 2)
    return st.sampled_from((*often, *asked)).flatmap(lambda name: st.tuples(st.just(name), asked[name]))


@pytest.mark.parametrize("name", sorted({*JOBS} - {"open", "upload", "import"}))
def test_without_data_every_job_asks_for_them(name: str, tmp_path: Path) -> None:
    session = Sessions(tmp_path).new("a" * 32)
    taken = list(inspect.signature(JOBS[name]).parameters)[2:]
    do(Place(session.folder), session.want(name, **{one: EXAMPLES[one] for one in taken}))
    assert session.progress is not None
    assert (session.progress["state"], session.view["stage"]) == ("failed", "empty")
    no = "This diagnosis is not one of the session; choose" if name == "changes" else "There is no data yet; choose"
    assert session.progress["now"].startswith(no)


ERRORS = (MemoryError, lambda: OSError(errno.ENOSPC, "No space left on device"))


class Session(RuleBasedStateMachine):
    """One session, its worker in this process, and the models on the way to the one that it shows."""

    everything = False  # pages and pictures too, which take seconds

    def __init__(self) -> None:
        super().__init__()
        self.patch, machine = pytest.MonkeyPatch(), self
        self.patch.setattr(places, "Investigation", quick)
        if not self.everything:
            self.patch.setattr(keeping, "write_report", lambda diagnosis, folder: None)
        self.stop_at = self.reports = 0
        report = Progress.__call__

        def reported(progress: Progress, now: str, share: float | None = None) -> None:
            machine.reports += 1
            if machine.reports == machine.stop_at:
                (machine.folder / STOP).touch()
            report(progress, now, share)

        self.patch.setattr(Progress, "__call__", reported)
        self.home = Path(tempfile.mkdtemp(prefix="workbench"))
        self.session = Sessions(self.home).new("a" * 32)
        self.folder = self.session.folder
        self.place = Place(self.folder)
        self.path: list[frozenset[str]] = []

    @initialize(is_open=st.sampled_from((*[True] * 7, False)))
    def begin(self, is_open: bool) -> None:
        if is_open:
            self.ask(("open", {"path": str(made()), "how": "case"}))

    @property
    def view(self) -> dict[str, Any]:
        return read_json(self.folder / VIEW) or {"stage": "empty"}

    @rule(
        job=st.deferred(jobs),
        stop_at=st.sampled_from((*[0] * 6, 1, 2, 3, 5, 8, 12, 16)),
        is_new=st.sampled_from((False, False, False, True)),
        short_at=st.sampled_from((*[0] * 6, 2, 3, 7, 15, 20, 30)),
        error=st.sampled_from(ERRORS),
    )
    def asks(self, job: Job, stop_at: int, is_new: bool, short_at: int, error: Callable[[], BaseException]) -> None:
        self.ask(job, stop_at, is_new, short_at, error)

    def ask(
        self,
        job: Job,
        stop_at: int = 0,
        is_new: bool = False,
        short_at: int = 0,
        error: Callable[[], BaseException] = MemoryError,
    ) -> None:
        """Ask for a job, perhaps of a new worker; stop it at one of its reports, or let one of its files fail."""
        name, with_ = job
        if is_new:
            self.place = Place(self.folder)
        before = self.view
        if name == "upload":
            shutil.copytree(made(), self.folder / UPLOADS, dirs_exist_ok=True)
        wanted = self.session.want(name, **with_)
        self.reports, self.stop_at = 0, stop_at
        try:
            with of_files(self.folder, short_at, error=error):
                do(self.place, wanted)
        except (OSError, MemoryError):  # it cannot say how the job ended: this worker dies, and the server says so
            assert short_at
            self.session.was_stopped("The worker ended; try again.", "failed")
            self.place = Place(self.folder)
            self.path = self.path if self.shown == self.path else self.after(wanted)
        self.ended(wanted, before)

    def after(self, wanted: dict[str, Any]) -> list[frozenset[str]]:
        """Return the path once a change is made."""
        present, names = self.path[-1] if self.path else frozenset(), wanted["with"].get("names", [])
        if wanted["do"] == "undo":
            return self.path[:-1] or self.path
        return self.path + {"add": [present | {*names}], "drop": [present - {*names}]}.get(wanted["do"], [])

    def ended(self, wanted: dict[str, Any], before: dict[str, Any]) -> None:
        """Hold how a job ended, and note the models that are to be shown then."""
        ended, view = self.session.progress, self.view
        assert ended is not None
        assert ended["id"] == wanted["id"]
        assert self.session.wanted is None
        if ended["state"] == "failed":
            assert "The workbench failed" not in ended["now"], ended["now"]
            assert faults(ended["now"], [""]) == "", ended["now"]
        else:
            assert (ended["state"] == "stopped") == (0 < self.stop_at <= self.reports)
        if wanted["do"] in ("open", "upload", "import"):
            is_new = view.get("script") == [] and view.get("version", 0) > before.get("version", 0)
            self.path = [frozenset()] if is_new else self.path
        elif wanted["do"] == "diagnose":
            assert self.shown[: len(self.path)] == self.path
            self.path = self.shown
        elif ended["state"] == "done":
            self.path = self.after(wanted)

    @property
    def shown(self) -> list[frozenset[str]]:
        return [frozenset(model) for model in self.view.get("models", [])]

    @invariant()
    def what_is_shown_is_what_was_asked_for(self) -> None:
        view = self.view
        json.dumps(view, allow_nan=False)
        assert self.shown == self.path
        if view["stage"] == "empty":
            return
        assert (self.folder / TRACES / "0" / "time_s.npy").exists()
        assert view["case"]["runs"]
        if view["stage"] == "compared":
            present = view["models"][-1]
            assert [one["name"] for one in view["added"]] == present
            assert [one["present"] for one in view["ladder"]].count(True) == 1
            assert not {*present} & {one["name"] for one in view["candidates"]}

    @invariant()
    def its_script_repeats_it(self) -> None:
        view = self.view
        if not view.get("script"):
            return
        one = quick(read_case(view["path"]), progress=False)
        for verb, labels in view["script"]:
            if verb == "follow":
                one.follow(labels)
            else:
                {"add": one.add, "drop": one.drop, "undo": one.undo, "finish": one.search}[verb](*labels)
        assert [*map(frozenset, one.path)] == self.path

    def teardown(self) -> None:
        self.patch.undo()
        shutil.rmtree(self.home)


Session.TestCase.settings = settings(max_examples=8, stateful_step_count=16)
TestSession = Session.TestCase

# What went wrong once: jobs, at which report each is stopped (0: at none), and whether a new worker does it.
ADD = [("add", {"names": [name]}) for name in ADDITIONS]
ORDERS = {
    "a stopped addition is not there": [(ADD[0], 0, False), (ADD[1], 5, False), (ADD[2], 0, False)],
    "a stopped undo is not done": [(ADD[0], 0, False), (("undo", {}), 2, False), (ADD[2], 0, False)],
    "a new worker goes back as the old one": [*((one, 0, False) for one in ADD), *[(("undo", {}), 0, True)] * 3],
    "back from a stopped diagnosis": [(ADD[1], 0, False), (("diagnose", {}), 12, False), (("undo", {}), 0, False)],
}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
def test_what_went_wrong_once(order: list[tuple[Job, int, bool]]) -> None:
    session = Session()
    try:
        session.begin(is_open=True)
        for job, stop_at, is_new in order:
            session.ask(job, stop_at, is_new)
            assert (session.session.progress or {})["state"] == ("stopped" if stop_at else "done")
            session.what_is_shown_is_what_was_asked_for()
            session.its_script_repeats_it()
    finally:
        session.teardown()
