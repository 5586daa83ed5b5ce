"""Whatever happens to the folder of a sweep, in whatever order: its result is that of a run that was never stopped."""

from __future__ import annotations

import errno
import functools
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from jaxmodel.base.errors import SweepError
from jaxmodel.sweeps import Study, load, plan, run
from jaxmodel.sweeps.lane import Outcome
from jaxmodel.sweeps.results import GRID, MANIFEST, TABLE
from jaxmodel.sweeps.runner import Runner
from jaxmodel.sweeps.store import Store
from tests.stress.shortage import of_files
from tests.stress.trial import faults
from tests.sweeps.test_store import assert_same_bits

CHUNKS, LANES = 5, 40
STUDY = {
    "kind": "cell",
    "parameters": {"capacity_Ah": 0.5},
    "profile": {"duration_s": 60, "step_s": 10, "ambient_degC": 20.0},
    "axes": {
        "current_A": np.linspace(0.2, 3.0, CHUNKS).tolist(),
        "storage_months": np.linspace(0.0, 36.0, LANES).tolist(),
    },
    "metrics": ["final_soc", "min_voltage_V"],
}
OTHERS = ({"parameters": {"capacity_Ah": 0.6}}, {"metrics": ["final_soc"]}, {"precision": "float32"})
ERRORS: dict[str, Callable[[], BaseException]] = {
    "disk full": lambda: OSError(errno.ENOSPC, "No space left on device"),
    "disk broken": lambda: OSError(errno.EIO, "Input/output error"),
    "no memory": MemoryError,
}
# Files that a run begins: those of the store, and three for each chunk.
MOST_FILES = 70


class Stopped(Exception):
    """The user has stopped the run."""


@functools.cache
def whole() -> tuple[Study, xr.Dataset, dict[int, Outcome], str]:
    """The study, its result, its chunks, and what computed them."""
    study = Study(**STUDY)
    runner = Runner(study)
    chunks = runner.chunks(None, whole=False)
    runner.prepare(chunks)
    return study, run(study), dict(runner.outcomes(chunks, range(len(chunks)))), runner.program


class Sweep(RuleBasedStateMachine):
    """One folder, and which chunks are to be in it."""

    def __init__(self) -> None:
        super().__init__()
        self.patch = pytest.MonkeyPatch()
        self.patch.setattr(plan, "LANE_STEPS_PER_CHUNK", LANES * 6)
        self.study, self.whole, self.outcomes, self.program = whole()
        assert len(self.outcomes) == CHUNKS
        self.folder = Path(tempfile.mkdtemp(prefix="sweep"))
        self.out = self.folder / "out"
        self.kept: set[int] = set()
        self.says = "stopped"  # what the folder says of the sweep once one is begun; "either" where a run failed
        self.lost: set[int] = set()  # chunks that lack a file, which a run that failed may have written anew
        begin, commit = Store.__init__, Store.commit

        def opened(store: Store, *how: Any, **named: Any) -> None:
            begin(store, *how, **named)
            missing, pending = {*range(CHUNKS)} - self.kept, {*store.pending}
            if not missing - self.lost <= pending <= missing:
                store.close()
                raise AssertionError(f"{pending} are to be run, and {missing} are missing")
            self.kept = {*range(CHUNKS)} - pending

        def counted(store: Store, number: int, outcome: Outcome | None) -> None:
            commit(store, number, outcome)
            self.kept.add(number)
            self.lost.discard(number)

        self.patch.setattr(Store, "__init__", opened)
        self.patch.setattr(Store, "commit", counted)

    @property
    def is_begun(self) -> bool:
        return (self.out / MANIFEST).exists()

    def refused(self, words: str, study: Study, **how: bool) -> None:
        """Hold that a run is refused in one sentence with these words."""
        with pytest.raises(SweepError, match=words) as caught:
            run(study, out=self.out, **how)
        assert faults(str(caught.value), [str(self.out)]) == ""

    def run(self, stop_after: int = CHUNKS, **how: bool) -> xr.Dataset:
        """Run, and hold that it goes on where the last one stopped; after some more chunks the user stops it."""
        told: list[int] = []
        is_damaged = len(self.kept) < CHUNKS

        def tell(done: int, total: int) -> None:
            told.append(done)
            assert total == CHUNKS * LANES
            assert done == LANES * len(self.kept) if len(told) == 1 else done > told[-2]
            if done - told[0] >= LANES * stop_after and stop_after < CHUNKS:
                raise Stopped

        try:
            result = run(self.study, tell, out=self.out, **how)
        except BaseException:
            if self.says == "finished" and is_damaged:
                self.says = "either"
            raise
        self.says = "finished"
        return result

    @rule(resume=st.booleans(), stop_after=st.integers(0, CHUNKS))
    def a_run(self, resume: bool, stop_after: int) -> None:
        if self.is_begun and not resume:
            words = {
                "finished": "holds a finished sweep; give another folder or remove",
                "stopped": "a sweep that was stopped; continue it with --resume, or give another folder or remove",
                "either": "continue it with --resume|finished sweep",
            }
            self.refused(words[self.says], self.study)
            return
        try:
            result = self.run(stop_after, resume=resume)
        except Stopped:
            return
        assert_same_bits(result, self.whole)

    @rule(what=st.sampled_from(sorted(ERRORS)), at=st.integers(1, MOST_FILES), lasts=st.booleans())
    def a_run_that_may_fail(self, what: str, at: int, lasts: bool) -> None:
        error = self.error_of(at, lasts, ERRORS[what])
        if isinstance(error, SweepError):
            assert what == "disk full"
            assert f"disk is full after {len(self.kept)} of {CHUNKS} chunks, which are kept; free" in str(error)
            assert faults(str(error), [str(self.out)]) == ""
        elif error is not None:
            assert what != "disk full"
            assert type(error) is type(ERRORS[what]())

    def error_of(self, at: int, lasts: bool, error: Callable[[], BaseException]) -> BaseException | None:
        """Run while a file fails; return what is raised of it, None if the run comes to its end."""
        try:
            with of_files(self.out, at, lasts=lasts, error=error):
                result = self.run(resume=True)
        except (SweepError, OSError, MemoryError) as raised:
            return raised
        assert_same_bits(result, self.whole)
        return None

    @precondition(lambda self: self.is_begun)
    @rule(which=st.sampled_from(OTHERS), resume=st.booleans())
    def another_study(self, which: dict, resume: bool) -> None:
        words = (
            "the study has changed .* since it was begun; give another folder"
            if resume
            else "holds a (finished )?sweep"
        )
        self.refused(words, Study(**STUDY | which), resume=resume)

    @precondition(lambda self: self.says == "stopped" or len(self.kept) < CHUNKS)
    @rule(order=st.permutations(range(CHUNKS)), count=st.integers(0, CHUNKS))
    def chunks_come_in_any_order_while_another_run_is_kept_out(self, order: list[int], count: int) -> None:
        store = Store(self.study, plan.cut(self.study.shape, LANES), self.out, resume=True)
        try:
            self.says = "stopped"
            store.begin(self.program)
            for number in [one for one in order if one in store.pending][:count]:
                store.commit(number, self.outcomes[number])
            self.refused("another run is writing here; wait for it or stop it", self.study, resume=True)
        finally:
            store.close()

    @precondition(lambda self: self.kept)
    @rule(data=st.data())
    def a_file_is_lost(self, data: st.DataObject) -> None:
        number = data.draw(st.sampled_from(sorted(self.kept)))
        name = data.draw(st.sampled_from(sorted(map(str, self.whole.data_vars))))
        (self.out / GRID / name / "c" / str(number) / "0").unlink()
        self.kept.remove(number)
        self.lost.add(number)

    @invariant()
    def what_is_kept_is_read(self) -> None:
        if not self.is_begun:
            with pytest.raises(SweepError, match="holds no result of a sweep; give the folder"):
                load(self.out)
            return
        if not (self.out / GRID).exists():
            with pytest.raises(SweepError, match="run the sweep again"):
                load(self.out)
            return
        part = load(self.out).load()
        for name, expected in self.whole.data_vars.items():
            found, of_whole = part[name].values, expected.values
            none = found == -1 if found.dtype.kind == "i" else np.isnan(found)
            assert not none[sorted(self.kept)].any(), name
            assert (none | (found == of_whole)).all(), name

    def teardown(self) -> None:
        try:
            assert_same_bits(self.run(resume=True), self.whole)
            assert_same_bits(load(self.out), self.whole)
            assert sorted(path.name for path in self.out.iterdir()) == sorted([GRID, MANIFEST, TABLE])
        finally:
            self.patch.undo()
            shutil.rmtree(self.folder)


Sweep.TestCase.settings = settings(max_examples=12, stateful_step_count=8)
TestSweep = Sweep.TestCase
