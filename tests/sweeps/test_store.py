"""Nothing is lost: the disk holds what memory would, whatever stops the run, and no other study goes on with it."""

from __future__ import annotations

import errno
import json
import math
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.base.errors import SweepError
from jaxmodel.sweeps import Study, load, manifest, places, plan, results, run
from jaxmodel.sweeps.places import LOG
from jaxmodel.sweeps.store import Store

REPOSITORY = Path(__file__).parents[2]
AXES = {"current_A": np.linspace(0.2, 3.0, 40).tolist(), "storage_months": np.linspace(0.0, 36.0, 30).tolist()}


@pytest.fixture(scope="module")
def study(cell_study: Callable[..., Study]) -> Study:
    """1,200 lanes, a course of each; some reach the cut-off."""
    return cell_study(
        axes=AXES, parameters={"capacity_Ah": 0.5}, store=["voltage_V"], store_every=30, cutoff={"soc": 0.4}
    )


@pytest.fixture(scope="module")
def whole(study: Study) -> xr.Dataset:
    return run(study)


@pytest.fixture
def many_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """About 20 chunks of 60 lanes, two rows of the grid each."""
    monkeypatch.setattr(plan, "LANE_STEPS_PER_CHUNK", 60 * 64)


def assert_same_bits(result: xr.Dataset, expected: xr.Dataset) -> None:
    assert set(result.variables) == set(expected.variables)
    assert list(result.data_vars) == list(expected.data_vars)
    for name, values in expected.variables.items():
        found = result[name].values
        assert found.dtype == values.dtype
        assert found.tobytes() == values.values.tobytes(), name
        np.testing.assert_equal(dict(result[name].attrs), dict(values.attrs))


@given(
    shape=st.lists(st.integers(1, 12), min_size=1, max_size=4).map(tuple),
    most=st.integers(1, 300),
)
def test_chunks_are_consecutive_lanes_and_cover_each_once(shape: tuple[int, ...], most: int):
    chunks = plan.cut(shape, most)
    numbers = np.arange(math.prod(shape)).reshape(shape)
    spans = [chunks.span(number) for number in range(len(chunks))]
    assert [first for first, _ in spans] == np.cumsum([0, *(count for _, count in spans)])[:-1].tolist()
    assert sum(count for _, count in spans) == numbers.size
    assert chunks.lanes <= most
    for number, (first, count) in enumerate(spans):
        assert numbers[chunks.region(number)].ravel().tolist() == list(range(first, first + count))


@given(lanes=st.integers(1, 10**6), steps=st.integers(1, 10**5), devices=st.integers(1, 64))
def test_calls_hold_all_lanes_of_a_chunk_in_blocks_that_do_not_depend_on_the_devices(lanes, steps, devices):
    calls = plan.calls_of(lanes, steps, devices, 128)
    assert calls.width == plan.calls_of(lanes, steps, 1, 128).width
    assert calls.number * calls.blocks * calls.width * devices >= lanes
    assert calls.blocks == 1 or calls.blocks * calls.width * steps <= plan.LANE_STEPS_PER_CALL


def test_store_is_what_memory_would_hold_and_is_read_as_used(study, whole, many_chunks, tmp_path):
    result = run(study, out=tmp_path / "out")
    assert len(json.loads(result.attrs["manifest"])["chunks"]) > 0
    assert not isinstance(result["min_voltage_V"].variable._data, np.ndarray)
    assert_same_bits(result, whole)
    assert list((tmp_path / "out" / "result.zarr" / "status" / "c").iterdir())
    assert not (tmp_path / "out" / LOG).exists()


def test_memory_sizes_the_chunks(study):
    per_lane = 8 * (2 + 3 + 3) + 1  # axes, metrics, stored rows, status
    chunks = plan.cut((1_000_000,), plan.lanes_per_chunk(1_000_000, 1, per_lane, 2**20))
    assert plan.COPIES * per_lane * chunks.lanes <= 2**20
    with pytest.raises(SweepError, match="is too little for 64 lanes at a time"):
        plan.lanes_per_chunk(1_000_000, 1, per_lane, 1000)
    with pytest.raises(SweepError, match=r"lanes take 58\.8 kB, more than 50 kB; name a folder"):
        run(study, memory="50 kB")


@pytest.mark.parametrize(("text", "size"), [("500 MB", 5e8), ("1.5GiB", 1.5 * 2**30), (2e9, 2e9), ("64k", 64_000)])
def test_sizes_are_read_as_written(text, size):
    assert plan.bytes_of(text) == size


@pytest.mark.parametrize("text", ["", "much", "-1", "0", "3 apples", "1.2.3 MB"])
def test_what_is_no_size_is_told(text):
    with pytest.raises(SweepError, match="is not a size"):
        plan.bytes_of(text)


CHILD = """
import json, sys
from jaxmodel import sweeps
from sweeps import manifest, plan
manifest.sources_digest = lambda: "that of this test"
plan.LANE_STEPS_PER_CHUNK = 60 * 64
study = sweeps.Study(**json.loads(sys.argv[1]))
sys.stdin.readline()
sweeps.run(study, out=sys.argv[2], resume=True)
"""


@pytest.mark.slow
def test_killed_ten_times_at_random_moments_and_resumed_gives_the_same_bits(cell_study, tmp_path):
    """Each run is a process of its own, ended by SIGKILL: after a few ms, or after some more chunks and a few ms.

    Of 150 chunks: so many that a fast machine does not come to the end before the last kill.
    """
    study = cell_study(axes=AXES | {"current_A": np.linspace(0.2, 3.0, 300)}, store=["voltage_V"], store_every=30)
    out, moments, kills = tmp_path / "out", random.Random(4), 10

    def imported() -> subprocess.Popen:
        """A process that is ready to run: the next one imports while the last one is at work."""
        command = [sys.executable, "-c", CHILD, study.model_dump_json(), str(out)]
        return subprocess.Popen(command, cwd=REPOSITORY, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def chunks_done() -> int:
        return (out / LOG).read_bytes().count(b"\n") if (out / LOG).exists() else 0

    log, following = [], imported()
    for kill in range(kills):
        child, before = following, chunks_done()
        following = imported()
        assert child.stdin is not None
        child.stdin.write("go\n")
        child.stdin.flush()
        more = 0 if kill < 2 else moments.choice([1, 2])
        patience = time.monotonic() + 60.0
        while chunks_done() < before + more and time.monotonic() < patience:
            time.sleep(0.0005)
        time.sleep(moments.uniform(0.0, 1.0 if kill < 2 else 0.02))
        child.kill()
        _, complaint = child.communicate()
        assert child.returncode == -signal.SIGKILL, complaint
        log.append((before, chunks_done()))
    _, complaint = following.communicate("go\n")
    assert following.returncode == 0, complaint
    assert [before for before, _ in log] == [0, *(after for _, after in log)][:-1]  # what was done was kept
    assert 0 < log[-1][1] < 150  # the kills came in mid-run
    assert_same_bits(load(out), run(study))


def stop_after(monkeypatch: pytest.MonkeyPatch, chunks: int, error: OSError) -> None:
    """Let the disk fail in the middle of a chunk."""
    writes = 0

    def write(array: zarr.Array, region: object, values: object, plain=zarr.Array.__setitem__) -> None:
        nonlocal writes
        writes += 1
        if writes > 5 * chunks + 3:  # five variables a chunk
            raise error
        plain(array, region, values)  # type: ignore[arg-type]

    monkeypatch.setattr(zarr.Array, "__setitem__", write)


def test_full_disk_is_told_and_what_was_done_is_kept(study, whole, many_chunks, tmp_path, monkeypatch):
    with monkeypatch.context() as failing:
        stop_after(failing, 7, OSError(errno.ENOSPC, "No space left on device"))
        with pytest.raises(
            SweepError, match=r"disk is full after 7 of 20 chunks, which are kept; free 38.2 kB and continue"
        ):
            run(study, out=tmp_path)
    part = load(tmp_path)
    assert int((part["status"] >= 0).sum()) == 7 * 60 + 0
    assert_same_bits(part.isel(current_A=slice(0, 14)), whole.isel(current_A=slice(0, 14)))
    told: list[int] = []
    assert_same_bits(run(study, lambda done, _: told.append(done), out=tmp_path, resume=True), whole)
    assert told[0] == 7 * 60


def test_line_of_the_log_that_was_torn_is_run_again(study, whole, many_chunks, tmp_path, monkeypatch):
    with monkeypatch.context() as failing:
        stop_after(failing, 12, OSError(errno.EIO, "Input/output error"))
        with pytest.raises(OSError, match="Input/output"):
            run(study, out=tmp_path)
    log = (tmp_path / LOG).read_bytes()
    assert log == b"".join(b"%d\n" % n for n in range(12))
    (tmp_path / LOG).write_bytes(log[:-1])  # "11" without its end
    store = zarr.open_group(tmp_path / "result.zarr", mode="r+", use_consolidated=False)
    store["soc_gradient"][22:24] = -1.0  # what chunk 11 held is not to be trusted
    assert_same_bits(run(study, out=tmp_path, resume=True), whole)


def test_only_the_same_study_by_the_same_code_goes_on(cell_study, tmp_path, monkeypatch):
    csv = tmp_path / "drive.csv"
    csv.write_text("time_s,current_A,ambient_degC\n0,1,20\n10,1,20\n")

    def study(**changes) -> Study:
        return cell_study(
            **{"profile": {"csv": str(csv)}, "axes": {"cycles": [0.0, 9.0], "initial_soc": [0.5]}} | changes
        )

    run(study(), out=tmp_path / "out")
    with pytest.raises(SweepError, match="holds a finished sweep; give another folder"):
        run(study(), out=tmp_path / "out")
    assert_same_bits(run(study(), out=tmp_path / "out", resume=True), run(study()))

    def refused(changed: Study) -> str:
        with pytest.raises(SweepError) as caught:
            run(changed, out=tmp_path / "out", resume=True)
        text = str(caught.value)
        assert text.endswith("since it was begun; give another folder.")
        return text

    assert "the study has changed (axes.cycles)" in refused(study(axes={"cycles": [0.0, 8.0], "initial_soc": [0.5]}))
    assert "the study has changed (parameters.R_0)" in refused(study(parameters={"R_0": 0.1}))
    assert "(the order of its axes)" in refused(study(axes={"initial_soc": [0.5], "cycles": [0.0, 9.0]}))
    ranges = {"cycles": (0.0, 9.0), "capacity_Ah": (2.0, 3.0)}
    drawn = study(axes={}, sample={"count": 4, "ranges": ranges})
    run(drawn, out=tmp_path / "drawn")
    turned = study(axes={}, sample={"count": 4, "ranges": dict(reversed(ranges.items()))})
    with pytest.raises(SweepError, match="the order of its sample's ranges"):
        run(turned, out=tmp_path / "drawn", resume=True)
    with monkeypatch.context() as other:
        other.setattr(manifest, "sources_digest", lambda: "other")
        assert "the code has changed (jaxmodel" in refused(study())
    with monkeypatch.context() as other:
        other.setattr(manifest.jax, "default_backend", lambda: "abacus")
        assert "this machine is abacus" in refused(study())
    with monkeypatch.context() as other:
        other.setattr(manifest, "processor", lambda: "abacus (beads)")
        assert ", abacus (beads), and it was" in refused(study())
    with monkeypatch.context() as other:
        real = manifest.importlib.metadata.version
        other.setattr(manifest.importlib.metadata, "version", lambda name: "0" if name == "llvmlite" else real(name))
        assert "llvmlite is 0, and was" in refused(study())
    csv.write_text("time_s,current_A,ambient_degC\n0,1,20\n10,1.1,20\n")
    assert f"the file {csv} has changed" in refused(study())


def test_only_the_program_that_began_a_sweep_goes_on(study, whole, many_chunks, tmp_path, monkeypatch):
    """Vector instructions and XLA round otherwise: a result of both would be that of neither."""
    with monkeypatch.context() as failing:
        stop_after(failing, 2, OSError(errno.ENOSPC, "No space left on device"))
        with pytest.raises(SweepError, match="disk is full"):
            run(study, out=tmp_path)
    with pytest.raises(
        SweepError, match="it was begun with vector instructions, and would go on with XLA, which rounds otherwise"
    ):
        run(study, out=tmp_path, resume=True, engine="xla")
    assert_same_bits(run(study, out=tmp_path, resume=True), whole)
    assert json.loads((tmp_path / "manifest.json").read_text())["program"] == "vector instructions"


def test_stopped_sweep_is_not_begun_anew_and_two_runs_do_not_write_one_folder(
    study, many_chunks, tmp_path, monkeypatch
):
    with monkeypatch.context() as failing:
        stop_after(failing, 2, OSError(errno.ENOSPC, "No space left on device"))
        with pytest.raises(SweepError, match="disk is full"):
            run(study, out=tmp_path)
    with pytest.raises(SweepError, match="holds a sweep that was stopped; continue it with --resume"):
        run(study, out=tmp_path)
    first = Store(study, plan.cut(study.shape, 60), tmp_path, resume=True)
    with pytest.raises(SweepError, match="another run is writing here"):
        run(study, out=tmp_path, resume=True)
    first.close()
    assert places.fcntl is not None


def _cut_off(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-3])


def _flip(file: Path) -> None:
    whole = file.read_bytes()
    file.write_bytes(whole[:9] + bytes([whole[9] ^ 1]) + whole[10:])


@pytest.mark.parametrize("damage", [_cut_off, _flip, Path.unlink])
@pytest.mark.parametrize("name", ["min_voltage_V", "voltage_V", "status"])
def test_a_chunk_that_was_damaged_is_run_again(study, whole, many_chunks, tmp_path, monkeypatch, name, damage):
    out = tmp_path / "out"
    committed = []
    real = Store.commit

    def commit(store: Store, number: int, outcome) -> None:
        if len(committed) == 5:
            raise KeyboardInterrupt
        real(store, number, outcome)
        committed.append(number)

    monkeypatch.setattr(Store, "commit", commit)
    with pytest.raises(KeyboardInterrupt):
        run(study, out=out)
    damage(next(path for path in sorted((out / "result.zarr" / name / "c").rglob("*")) if path.is_file()))
    monkeypatch.setattr(Store, "commit", real)
    chunks = plan.cut(study.shape, 60)
    store = Store(study, chunks, out, resume=True)
    assert len(store.pending) == len(store.chunks) - 4
    store.close()
    assert_same_bits(run(study, out=out, resume=True), whole)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("manifest.json", "{"), ("manifest.json", '{"chunks": 3}'), ("manifest.json", "\xff"),
        ("result.zarr/zarr.json", "{"), ("result.zarr/status/zarr.json", "{}"),
    ],
)  # fmt: skip
def test_a_store_that_was_damaged_is_refused_in_a_sentence(study, many_chunks, tmp_path, monkeypatch, file, text):
    out = tmp_path / "out"
    monkeypatch.setattr(Store, "commit", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        run(study, out=out)
    (out / file).write_text(text, encoding="latin-1")
    with pytest.raises(SweepError, match=r"(is damaged|no sweep that can be continued); give another folder"):
        run(study, out=out, resume=True)


def test_a_study_for_which_there_is_no_room_is_refused_before_it_is_begun(cell_study, tmp_path: Path):
    spans = {"current_A": 4.0, "cycles": 500.0, "ambient_degC": 40.0}
    huge = cell_study(axes={name: {"start": 0.1, "stop": end, "count": 10**4} for name, end in spans.items()})
    assert huge.size == 10**12
    with pytest.raises(SweepError, match=r"1,000,000,000,000 lanes take .* are free where .* take fewer values"):
        run(huge, out=tmp_path / "result")
    assert not (tmp_path / "result").exists()
    with pytest.raises(SweepError, match=r"this machine has .* of memory; name a folder with out"):
        run(huge)


@pytest.mark.parametrize("damage", [_cut_off, _flip, Path.unlink])
def test_a_finished_result_that_was_damaged_is_mended_by_resume(study, whole, many_chunks, tmp_path, damage):
    out = tmp_path / "out"
    run(study, out=out)
    damage(next(path for path in sorted((out / "result.zarr" / "min_voltage_V" / "c").rglob("*")) if path.is_file()))
    store = Store(study, plan.cut(study.shape, 60), out, resume=True)
    assert len(store.pending) == 1
    store.close()
    assert_same_bits(run(study, out=out, resume=True), whole)
    assert_same_bits(run(study, out=out, resume=True), whole)


@pytest.mark.parametrize("file", ["manifest.json", "result.zarr/zarr.json", "result.zarr/status/zarr.json"])
def test_a_result_whose_files_are_damaged_is_not_loaded(study, many_chunks, tmp_path, file):
    out = tmp_path / "out"
    run(study, out=out)
    (out / file).write_text('{"half":', encoding="utf-8")
    with pytest.raises(SweepError, match=r"its files are damaged .* run the sweep again into another folder"):
        load(out)


def _stated(folder: Path, **versions: str) -> None:
    """Change which libraries wrote a result, as its manifest states."""
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    manifest["versions"] |= versions
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


@pytest.mark.parametrize("error", [AttributeError, ImportError, NotImplementedError, TypeError, ValueError])
def test_a_library_that_cannot_read_is_named_and_the_files_are_not_called_damaged(study, tmp_path, monkeypatch, error):
    """xarray 2025.3 with zarr 3.1 raises an AttributeError."""
    out = tmp_path / "out"
    run(study, out=out)
    _stated(out, xarray="2031.1.0")

    def refuse(*_: object, **__: object) -> None:
        raise error("'Float64' object has no attribute 'value'")

    monkeypatch.setattr(results.xr, "open_zarr", refuse)
    installed = version("xarray")
    with pytest.raises(SweepError) as caught:
        load(out)
    assert f"xarray {installed} cannot read what xarray 2031.1.0 wrote ({error.__name__}); install" in str(caught.value)
    assert "damaged" not in str(caught.value)


@pytest.mark.parametrize("file", ["manifest.json", "result.zarr/zarr.json", "result.zarr/status/zarr.json"])
@pytest.mark.parametrize("text", ['{"half":', "[]"])
def test_damage_is_damage_whatever_wrote_it(study, tmp_path, file, text):
    out = tmp_path / "out"
    run(study, out=out)
    _stated(out, xarray="2031.1.0", zarr="9.0")
    (out / file).write_text(text, encoding="utf-8")
    with pytest.raises(SweepError, match="its files are damaged"):
        load(out)


def test_what_the_same_libraries_wrote_and_cannot_read_is_damaged(study, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(study, out=out)
    monkeypatch.setattr(results.xr, "open_zarr", lambda *_, **__: {}["nothing"])
    with pytest.raises(SweepError, match=r"its files are damaged \(KeyError\)"):
        load(out)


def test_a_folder_without_a_result_is_not_loaded(tmp_path: Path):
    with pytest.raises(SweepError, match="holds no result of a sweep"):
        load(tmp_path)


def test_what_was_drawn_is_in_the_order_of_the_study_however_a_folder_lists_it(study, tmp_path):
    ranges = {"storage_months": (0.0, 9.0), "capacity_Ah": (2.0, 3.0)}
    for number, own in enumerate((ranges, dict(reversed(ranges.items())))):
        run(
            study.replace(axes={"current_A": [1.0]}, parameters={}, sample={"count": 4, "ranges": own}),
            out=tmp_path / str(number),
        )
        assert [name for name in load(tmp_path / str(number)).coords if name in own] == list(own)
        columns = (tmp_path / str(number) / "lanes.csv").read_text().splitlines()[0].split(",")
        assert [name for name in columns if name in own] == list(own)
