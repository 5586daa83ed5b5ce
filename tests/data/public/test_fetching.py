"""Public data sets are fetched from a server on this machine, held to their checksums, and kept."""

from __future__ import annotations

import functools
import hashlib
import re
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jaxmodel.app.cli import app
from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import KINDS
from jaxmodel.data.public import data_sets, fetch, fetching
from jaxmodel.data.public.fetching import DataSet

CONTENT = {"logs/20 degC.csv": b"time_s,voltage_V\n0,4.1\n", "logs/b.csv": b"time_s,voltage_V\n0,4.0\n"}
SET = DataSet(
    "cell", "A cell", "A bench", "CC0", "owner/cells", "c" * 40, "--kind cell",
    {path: hashlib.sha256(content).hexdigest() for path, content in CONTENT.items()},
)  # fmt: skip


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """What a server was asked for that has the files of the set."""
    paths: list[str] = []

    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, *args: object) -> None:
            paths.append(self.path)

    root = tmp_path / "served"
    for path, content in CONTENT.items():
        file = root / SET.repository / SET.commit / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=str(root)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    monkeypatch.setenv(fetching.SOURCE_VARIABLE, f"http://127.0.0.1:{server.server_port}/")
    monkeypatch.setenv("JAXMODEL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(fetching, "data_sets", lambda: {"cell": SET})
    yield paths
    server.shutdown()
    server.server_close()


def test_files_are_those_of_the_server_and_are_fetched_once(asked: list[str], tmp_path: Path) -> None:
    first = fetch("cell", tmp_path / "one")
    assert {path.name: path.read_bytes() for path in first} == {Path(p).name: one for p, one in CONTENT.items()}
    assert f"/owner/cells/{SET.commit}/logs/20%20degC.csv" in asked
    count = len(asked)
    second = fetch("cell", tmp_path / "two")
    assert [path.read_bytes() for path in second] == [path.read_bytes() for path in first]
    assert len(asked) == count, "the second time they come from the cache"


def test_another_file_in_its_place_is_refused(asked: list[str], tmp_path: Path) -> None:
    (tmp_path / "served" / SET.repository / SET.commit / "logs" / "b.csv").write_bytes(b"changed")
    with pytest.raises(MeasurementError, match="is not the file that was read here: its SHA-256 differs"):
        fetch("cell", tmp_path / "one")
    assert not (tmp_path / "one" / "b.csv").exists()


def test_a_set_that_is_not_known_or_not_there_is_one_sentence(asked: list[str], tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"no data set 'cel'; there are cell\. Did you mean 'cell'"):
        fetch("cel", tmp_path)
    (tmp_path / "served" / SET.repository / SET.commit / "logs" / "b.csv").unlink()
    with pytest.raises(MeasurementError, match=r"b\.csv cannot be fetched \(HTTPError\)"):
        fetch("cell", tmp_path / "one")


def test_the_command_shows_licence_source_and_what_to_do_next(
    asked: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jaxmodel.app.commands.fetch.data_sets", lambda: {"cell": SET})
    said = CliRunner().invoke(app, ["fetch", "cell", "--out", str(tmp_path / "logs")])
    assert said.exit_code == 0
    assert "Their licence: CC0. From https://github.com/owner/cells, commit cccccccccccc." in said.output
    assert f"jaxmodel start {tmp_path / 'logs'}/* --kind cell" in said.output.replace("\n", " ").replace("  ", " ")


def test_every_set_is_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, one in data_sets().items():
        assert re.fullmatch(r"[0-9a-f]{40}", one.commit), name
        assert all(re.fullmatch(r"[0-9a-f]{64}", checksum) for checksum in one.files.values()), name
        assert len({Path(path).name for path in one.files}) == len(one.files), "files of one name would overwrite"
        assert one.start.split()[1] in KINDS
        assert one.licence
    listed = CliRunner().invoke(app, ["fetch"])
    assert listed.exit_code == 0
    assert all(name in listed.output for name in data_sets())
