"""A real scheduler and its workers on the loopback: the bits of a local run, whoever is lost on the way."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from jaxmodel.base.errors import SweepError
from jaxmodel.sweeps import Metric, Study, plan, run
from jaxmodel.sweeps.places import LOG
from jaxmodel.sweeps.store import Grid

REPOSITORY = Path(__file__).parents[2]


class SocSquared(Metric):
    """A metric of the user's own, in a module that no worker can import."""

    def init(self, first):
        return first.columns["soc"]

    def update(self, carry, step):
        return step.after.columns["soc"]

    def finish(self, carry, end):
        return carry**2


@pytest.fixture(scope="module")
def study(cell_study: Callable[..., Study]) -> Study:
    own = SocSquared("soc_squared", "", "square of the state of charge", ("cell",))
    axes = {"current_A": np.linspace(0.2, 3.0, 120), "storage_months": np.linspace(0.0, 36.0, 30)}
    return cell_study(axes=axes, metrics=["final_soc", "min_voltage_V", own], store=["soc"], store_every=30)


@pytest.fixture(scope="module")
def local(study: Study) -> xr.Dataset:
    return run(study)


def assert_same_bits(result: xr.Dataset, expected: xr.Dataset) -> None:
    for name, values in expected.data_vars.items():
        assert result[name].values.tobytes() == values.values.tobytes(), name


@contextlib.contextmanager
def scheduler_and_workers(count: int, folder: Path) -> Iterator[tuple[str, list[subprocess.Popen], Callable]]:
    """A scheduler and single-threaded workers without a nanny: one that is killed does not come back. And one more."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    log = (folder / "cluster.log").open("w")

    def start(*command: str) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *command], cwd=REPOSITORY, stdout=log, stderr=subprocess.STDOUT
        )

    port = address.rpartition(":")[2]
    processes = [start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")]
    single = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(folder))
    processes += [start("worker", address, *single) for _ in range(count)]

    def one_more() -> None:
        processes.append(start("worker", address, *single))

    try:
        yield address, processes[1:], one_more
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait(timeout=30)
        log.close()


@pytest.mark.slow
def test_killed_worker_costs_its_chunk_and_no_bit(study, local, tmp_path, monkeypatch):
    monkeypatch.setattr(plan, "LANE_STEPS_PER_CHUNK", 60 * 64)
    """One of two is killed early; later the other, when only one that came meanwhile can finish."""
    out, done = tmp_path / "out", threading.Event()
    with scheduler_and_workers(2, tmp_path) as (address, workers, one_more):

        def kill_both_in_mid_run() -> None:
            for chunks, worker in ((2, workers[0]), (5, workers[1])):
                while not ((out / LOG).exists() and (out / LOG).read_bytes().count(b"\n") >= chunks):
                    if done.wait(0.0005):
                        return
                worker.kill()
                if worker is workers[0]:
                    one_more()

        killer = threading.Thread(target=kill_both_in_mid_run)
        killer.start()
        seen: list[int] = []
        try:
            result = run(study, lambda lanes, _: seen.append(lanes), out=out, engine=address)
        finally:
            done.set()
            killer.join()
        assert [worker.wait(timeout=30) for worker in workers] == [-signal.SIGKILL] * 2
        assert seen[-1] == study.size
        assert seen == sorted(set(seen))  # nothing was counted twice
        assert_same_bits(result, local)


@pytest.mark.slow
def test_local_cluster_gives_the_same_bits(study, local, tmp_path, monkeypatch):
    """The workers send results back where there is no place to write them, and else write them themselves."""
    assert_same_bits(run(study, engine="dask"), local)
    monkeypatch.setattr(Grid, "write", lambda *_: pytest.fail("the process of the user wrote a chunk"))
    assert_same_bits(run(study, engine="dask", out=tmp_path / "out"), local)


def test_scheduler_that_is_not_there_is_told(study, monkeypatch):
    monkeypatch.setattr("jaxmodel.sweeps.cluster._PATIENCE_S", 1)
    with pytest.raises(SweepError, match="no scheduler answers at tcp://127"):
        run(study, engine="tcp://127.0.0.1:9")
    with pytest.raises(
        SweepError, match='engine: there is no engine "cluster"; give "local", "xla", "dask", or an address'
    ):
        run(study, engine="cluster")


def test_sweep_of_little_is_cut_for_all_threads():
    assert plan.cut((1_000_000,), plan.lanes_per_chunk(1_000_000, 1, 8, 2**30, least=64)).counts == (64,)
