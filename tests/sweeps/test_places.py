"""A result in an object store: S3 as moto speaks it on this machine, and fsspec's store in memory."""

from __future__ import annotations

import json
import logging
import os
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from moto.server import ThreadedMotoServer
from typer.testing import CliRunner

from jaxmodel.app.cli import app
from jaxmodel.base.errors import SweepError
from jaxmodel.sweeps import Study, load, plan, run
from jaxmodel.sweeps.places import Bucket, Folder, place_of
from jaxmodel.sweeps.plan import cut
from jaxmodel.sweeps.results import variables_of
from jaxmodel.sweeps.store import RUN, Grid, Store

AXES = {"current_A": np.linspace(0.2, 3.0, 20).tolist(), "cycles": np.linspace(0.0, 300.0, 15).tolist()}


@pytest.fixture(scope="module")
def study(cell_study: Callable[..., Study]) -> Study:
    """300 lanes, a course of each."""
    return cell_study(axes=AXES, store=["voltage_V"], store_every=30)


@pytest.fixture(scope="module")
def whole(study: Study) -> xr.Dataset:
    return run(study)


@pytest.fixture(scope="module", autouse=True)
def quiet() -> None:
    """No line for each request."""
    logging.getLogger("werkzeug").setLevel(logging.ERROR)


@pytest.fixture(scope="module")
def s3() -> Iterator[str]:
    """The URL of a bucket on a server of this machine, which the environment names."""
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    named = {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "one", "AWS_SECRET_ACCESS_KEY": "two", "AWS_DEFAULT_REGION": "us-east-1",
    }  # fmt: skip
    before = {name: os.environ.get(name) for name in named}
    os.environ.update(named)
    import s3fs

    s3fs.S3FileSystem().mkdir("bench")
    yield "s3://bench"
    server.stop()
    for name, value in before.items():
        os.environ.pop(name) if value is None else os.environ.update({name: value})


@pytest.fixture(params=["s3", "memory"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A prefix of its own for each test."""
    root = request.getfixturevalue("s3") if request.param == "s3" else "memory://"
    return f"{root}/{tmp_path.name}"


@pytest.fixture
def many_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five chunks of 60 lanes, four rows of the grid each."""
    monkeypatch.setattr(plan, "LANE_STEPS_PER_CHUNK", 60 * 64)


def assert_same_bits(result: xr.Dataset, expected: xr.Dataset) -> None:
    assert list(result.data_vars) == list(expected.data_vars)
    for name, values in expected.variables.items():
        assert result[name].values.tobytes() == values.values.tobytes(), name
        np.testing.assert_equal(dict(result[name].attrs), dict(values.attrs))


def test_a_bucket_holds_what_a_folder_would(study, whole, url, many_chunks):
    assert_same_bits(run(study, out=url), whole)
    assert_same_bits(load(url), whole)
    place = place_of(url)
    assert json.loads(place.read("manifest.json"))["performance"]["lanes_run"] == 300
    assert place.read("lanes.csv").count("\n") == 301
    assert not place.holds(RUN)


def test_a_sweep_into_a_bucket_goes_on_where_it_stopped(study, whole, url, many_chunks, monkeypatch):
    real, committed = Store.commit, []

    def commit(store: Store, number: int, outcome) -> None:
        if len(committed) == 3:
            raise KeyboardInterrupt
        real(store, number, outcome)
        committed.append(number)

    with monkeypatch.context() as stopping:
        stopping.setattr(Store, "commit", commit)
        with pytest.raises(KeyboardInterrupt):
            run(study, out=url)
    assert int((load(url)["status"] >= 0).sum()) == 180
    with pytest.raises(SweepError, match=f"{url} holds a sweep that was stopped; continue it with --resume"):
        run(study, out=url)
    told: list[int] = []
    assert_same_bits(run(study, lambda done, _: told.append(done), out=url, resume=True), whole)
    assert told[0] == 180
    with pytest.raises(SweepError, match="holds a finished sweep"):
        run(study, out=url)


@pytest.mark.slow("s3")
def test_an_object_that_was_damaged_or_lost_is_computed_again(study, whole, url, many_chunks):
    run(study, out=url)
    bucket = place_of(url)
    assert isinstance(bucket, Bucket)
    lost, torn = f"{bucket._root}/result.zarr/status/c/0/0", f"{bucket._root}/result.zarr/min_voltage_V/c/1/0"
    bucket._fs.rm_file(lost)
    content = bucket._fs.cat_file(torn)
    bucket._fs.pipe_file(torn, content[:9] + bytes([content[9] ^ 1]) + content[10:])
    store = Store(study, cut(study.shape, 60), url, resume=True)
    assert store.pending == [0, 1]
    assert_same_bits(run(study, out=url, resume=True), whole)


def test_a_network_that_fails_while_chunks_are_checked_is_told(study, url, many_chunks, monkeypatch):
    run(study, out=url)

    def lost(array: zarr.Array, region: object) -> None:
        raise ConnectionError("the line is cut")

    monkeypatch.setattr(zarr.Array, "__getitem__", lost)
    with pytest.raises(SweepError, match=r"the object store cannot be used \(the line is cut\); check the name"):
        run(study, out=url, resume=True)


def test_a_store_that_was_being_made_is_made_anew(study, whole, url, many_chunks, monkeypatch):
    with monkeypatch.context() as stopping:
        stopping.setattr(Store, "_create_drawn", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt()))
        with pytest.raises(KeyboardInterrupt):
            run(study, out=url)
    assert_same_bits(run(study, out=url, resume=True), whole)


@pytest.mark.parametrize("kind", ["folder", "s3"])
def test_a_worker_elsewhere_writes_into_the_place_of_this_study_alone(study, kind, request, tmp_path, many_chunks):
    out = tmp_path / "out" if kind == "folder" else f"{request.getfixturevalue('s3')}/{tmp_path.name}"
    run(study, out=out)
    place_of(out).write(RUN, "this run")
    grid = Grid(place_of(out), list(variables_of(study)), cut(study.shape, 60), "this run")
    assert grid.arrays
    there = pickle.loads(pickle.dumps(grid))
    assert there.is_reached
    assert there.is_whole(3)
    assert not Grid(place_of(out), list(variables_of(study)), cut(study.shape, 60), "an earlier run").is_reached
    assert not Grid(Folder(tmp_path / "not there"), ["status"], cut(study.shape, 60), "this run").is_reached


@pytest.mark.parametrize(
    ("out", "sentence"),
    [
        ("s4://bench/x", r"s4://bench/x: .*; give a folder, or a URL such as s3://bucket/name"),
        ("s3://no-such-bucket/x", r"s3://no-such-bucket/x: the object store cannot be used \(.*\); check the name"),
        ("s3:/bench/x", r"s3:/bench/x: a slash is missing; write s3://bench/x for an object store, \./s3:/bench/x for"),
    ],
)
def test_a_place_that_cannot_be_used_is_told(study, s3, out, sentence):
    with pytest.raises(SweepError, match=sentence):
        run(study, out=out)


def test_the_command_writes_to_a_bucket(study, s3, tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(
        'kind = "cell"\n[profile]\nduration_s = 60\nambient_degC = 20\n[axes]\ncurrent_A = [0.5, 1.0]\n', "utf-8"
    )
    result = CliRunner().invoke(app, ["sweep", str(file), "--out", f"{s3}/by-command"])
    assert result.exit_code == 0, result.output
    assert f"manifest.json are in {s3}/by-command" in " ".join(result.output.split())
    assert load(f"{s3}/by-command")["status"].size == 2
