"""What a user installs: wheel and source distribution are built, and the wheel works where the repository is not."""

from __future__ import annotations

import email
import fnmatch
import http.cookiejar
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import sysconfig
import time
import tomllib
import urllib.request
import zipfile
from email.message import Message
from pathlib import Path

import pytest

from tests.oldest import oldest
from tests.public_rooms import PUBLIC

REPOSITORY = Path(__file__).parents[1]
URLS = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
TOOLS = Path(sysconfig.get_path("scripts"))
TOKEN = "let-this-test-in"


def ran(*command: str | Path, cwd: Path, **environment: str) -> str:
    """The output of a program that succeeds, in the environment of a user: nothing there leads to the repository."""
    kept = ("PATH", "LANG", "TMPDIR", "SSL_CERT_FILE", "UV_CACHE_DIR", "JAX_COMPILATION_CACHE_DIR")
    kept += ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy", "SSL_CERT_DIR")
    own = {name: os.environ[name] for name in kept if name in os.environ} | {"HOME": str(cwd)} | environment
    done = subprocess.run(command, cwd=cwd, env=own, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def uv(*arguments: str | Path, cwd: Path, **environment: str) -> str:
    """The tool that builds and installs, with the cache of the user who runs the tests."""
    cache = ran(TOOLS / "uv", "cache", "dir", cwd=cwd, HOME=str(Path.home())).strip()
    return ran(TOOLS / "uv", *arguments, "--quiet", "--cache-dir", cache, cwd=cwd, **environment)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository without git, and without what git ignores: an earlier build is no part of this one."""
    entries = (REPOSITORY / ".gitignore").read_text(encoding="utf-8").splitlines()
    ignored = [".git", *(entry.rstrip("/") for entry in entries if entry and not entry.startswith("#"))]

    def left_out(_: str, names: list[str]) -> set[str]:
        return {name for name in names if any(fnmatch.fnmatch(name, pattern) for pattern in ignored)}

    place = tmp_path_factory.mktemp("source") / "jaxmodel"
    return Path(shutil.copytree(REPOSITORY, place, symlinks=True, ignore=left_out))


@pytest.fixture(scope="module")
def built(source: Path) -> Path:
    """A folder with the source distribution and the wheel that is built from it."""
    uv("build", "--out-dir", source.parent / "built", cwd=source)
    return source.parent / "built"


@pytest.fixture(scope="module")
def wheel(built: Path) -> Path:
    (one,) = built.glob("*.whl")
    return one


@pytest.fixture(scope="module")
def metadata(wheel: Path) -> Message:
    content = contents(wheel)
    (name,) = [name for name in content if name.endswith(".dist-info/METADATA")]
    return email.message_from_bytes(content[name])


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of programs of a new environment with the wheel and what it needs, and nothing else."""
    folder = tmp_path_factory.mktemp("installed")
    uv("venv", "--python", sys.executable, folder / "venv", cwd=folder)
    programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    pins = ("--constraint", REPOSITORY / "constraints.txt")
    uv("pip", "install", "--python", programs / "python", *pins, f"{wheel}[workbench]", cwd=folder)
    return programs


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_a_wheel_of_the_source_is_the_wheel_of_the_source_distribution(source: Path, wheel: Path) -> None:
    uv("build", "--wheel", "--out-dir", source.parent / "direct", cwd=source)
    assert contents(source.parent / "direct" / wheel.name) == contents(wheel)


def test_a_wheel_takes_one_name(wheel: Path) -> None:
    tops = {name.partition("/")[0] for name in contents(wheel)}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"jaxmodel"}


def test_a_wheel_has_every_module_and_no_other_program(wheel: Path) -> None:
    modules = {
        Path("jaxmodel", *path.relative_to(REPOSITORY).parts[path.is_relative_to(REPOSITORY / "jaxmodel") :]).as_posix()
        for folder in ("jaxmodel", "sweeps", "sensitivity")
        for path in (REPOSITORY / folder).rglob("*.py")
    }
    content = contents(wheel)
    assert {name for name in content if name.endswith(".py")} == modules
    assert "jaxmodel/py.typed" in content  # counts for all packages inside
    sources = {f"jaxmodel/export/fmi/{path.name}" for path in (REPOSITORY / "jaxmodel/export/fmi").iterdir()}
    assert {name for name in content if name.endswith((".c", ".h"))} == sources  # what an FMU is compiled from


def test_the_version_is_that_of_the_tag(source: Path, tmp_path: Path) -> None:
    """Without git the version is stated: `test_the_version_is_said` has it."""
    if shutil.which("git") is None:
        pytest.skip("there is no git on this machine")
    copy = shutil.copytree(source, tmp_path / "tagged", symlinks=True)
    who = ("-c", "user.name=one", "-c", "user.email=one@example.org")
    ran("git", "init", "--quiet", cwd=copy)
    ran("git", "add", ".", cwd=copy)
    ran("git", *who, "commit", "--quiet", "--message", "All of it", cwd=copy)
    ran("git", *who, "tag", "v7.8.9", cwd=copy)
    uv("build", "--wheel", "--out-dir", tmp_path / "built", cwd=copy)
    assert [path.name for path in (tmp_path / "built").glob("*.whl")] == ["jaxmodel-7.8.9-py3-none-any.whl"]


def test_the_package_index_would_take_both(built: Path) -> None:
    files = [path for path in built.iterdir() if path.suffix in (".whl", ".gz")]
    assert len(files) == 2
    said = ran(TOOLS / "twine", "check", "--strict", *files, cwd=built)
    assert said.count("PASSED") == 2


def test_metadata_are_whole(metadata: Message) -> None:
    assert metadata["License-Expression"] == "Apache-2.0 AND CC-BY-SA-4.0 AND MIT"
    assert metadata.get_all("License-File") == ["LICENSE", "LICENSE-DATA"]
    for field in ("Author", "Keywords", "Summary", "Requires-Python"):
        assert metadata[field], field
    assert len(metadata.get_all("Classifier", [])) > 8
    assert dict(entry.split(", ") for entry in metadata.get_all("Project-URL", [])) == URLS
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    assert f"repository-code: {URLS['Source']}\n" in citation


def test_links_of_the_page_lead_to_files_of_the_repository(metadata: Message) -> None:
    links = re.findall(r"\]\(([^)]+)\)", metadata.get_payload())
    assert len(links) > 10
    for link in links:
        found = re.fullmatch(rf"{URLS['Source']}/(?:blob|raw)/main/([^#]+)(?:#.*)?", link)
        assert link.startswith("#") or link.startswith("http"), link
        assert found is None or (REPOSITORY / found[1]).exists(), link


def test_the_licence_of_all_data_is_stated(wheel: Path) -> None:
    stated = (REPOSITORY / "LICENSE-DATA").read_text(encoding="utf-8")
    for name in contents(wheel):
        place = name.removeprefix("jaxmodel/") if name.startswith("jaxmodel/examples/") else name
        if name.startswith("jaxmodel/case/presets/") and name.endswith(".toml"):
            assert f"{place}\n" in stated
        elif place.endswith(".csv"):
            assert place.rpartition("/")[0] in stated, name


def test_nothing_of_the_repository_is_needed(installed: Path, tmp_path: Path) -> None:
    """Every public name is there, from the installed package."""
    program = f"""
import importlib, pathlib, jaxmodel
for package in {PUBLIC}:
    module = importlib.import_module(package)
    assert pathlib.Path(module.__file__).is_relative_to({str(installed.parent)!r}), module.__file__
    for name in module.__all__:
        getattr(module, name)
from jaxmodel import sensitivity, sweeps
print(len(jaxmodel.__all__), sweeps.run.__name__, sensitivity.local.__name__, jaxmodel.__version__)
"""
    said = ran(installed / "python", "-c", program, cwd=tmp_path).split()
    assert int(said[0]) > 40
    assert said[1:3] == ["run", "local"]


def test_the_peers_go_beside_it(installed: Path, wheel: Path, tmp_path: Path) -> None:
    """One environment holds ours, PyBaMM, PyBOP and numba, whose bounds on numpy and llvmlite are their own."""
    (tmp_path / "wanted.txt").write_text(f"jaxmodel[workbench,peers] @ {wheel.as_uri()}\n", encoding="utf-8")
    files = (tmp_path / "wanted.txt", "--output-file", tmp_path / "found.txt")
    pins = ("--constraint", REPOSITORY / "constraints.txt")
    uv("pip", "compile", "--python", installed / "python", *pins, *files, cwd=tmp_path)
    found = (tmp_path / "found.txt").read_text(encoding="utf-8")
    for name in ("pybamm", "pybop", "numba", "llvmlite", "numpy"):
        assert f"\n{name}==" in found


def test_the_oldest_releases_go_together(source: Path, tmp_path: Path) -> None:
    """Where two bounds exclude each other, `make test-oldest` would have nothing to install."""
    lines = oldest((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    (tmp_path / "oldest.txt").write_text("\n".join(lines), encoding="utf-8")
    files = ("pyproject.toml", "--extra", "test", "--output-file", tmp_path / "found.txt")
    uv("pip", "compile", "--python", sys.executable, "--constraint", tmp_path / "oldest.txt", *files, cwd=source)
    assert set(lines) >= {"jax==0.10", "numpy==2.2", "llvmlite==0.45"}


def test_the_version_is_said(installed: Path, wheel: Path, tmp_path: Path) -> None:
    """That of a copy without git, from its metadata."""
    version = wheel.name.split("-")[1]
    assert version == "0.1.dev0"
    assert ran(installed / "jaxmodel", "--version", cwd=tmp_path) == f"jaxmodel {version}\n"
    said = ran(installed / "python", "-c", "import jaxmodel; print(jaxmodel.__version__)", cwd=tmp_path)
    assert said == f"{version}\n"


def test_the_demo_runs_to_its_page(installed: Path, tmp_path: Path) -> None:
    said = ran(installed / "jaxmodel", "demo", "--out", "demo", cwd=tmp_path)
    assert "Missing from the model of the real cell: self_heating" in said
    assert (tmp_path / "demo" / "index.html").stat().st_size > 100_000


def test_a_robot_is_compensated_without_a_file_of_ones_own(installed: Path, tmp_path: Path) -> None:
    ran(installed / "jaxmodel", "compensate", "--answer-only", "--out", "out", cwd=tmp_path)
    assert len(list((tmp_path / "out").glob("map-*.csv"))) == 3


def test_the_workbench_shows_its_examples(installed: Path, tmp_path: Path) -> None:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    command = [installed / "jaxmodel", "workbench", "--no-open", "--port", str(port)]
    command += ["--token", TOKEN, "--folder", tmp_path / "sessions"]
    # NiceGUI does not serve as for a user where it sees that it is under test.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen(command, cwd=tmp_path, stdout=log, stderr=log, env=environment)
    try:
        page = first_page(f"http://127.0.0.1:{port}/?token={TOKEN}", process, tmp_path / "log")
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20)
    for title in ("Samsung INR18650-30Q", "Table 1 of the paper as a measurement", "The paper's experiment"):
        assert title in page


def first_page(address: str, process: subprocess.Popen[bytes], log: Path) -> str:
    """What a browser gets, once there is a server."""
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(http.cookiejar.CookieJar()))
    for _ in range(600):
        assert process.poll() is None, log.read_text()
        try:
            with opener.open(address, timeout=30) as answer:
                return answer.read().decode()
        except ConnectionError:
            time.sleep(0.1)
        except OSError as error:
            if not isinstance(getattr(error, "reason", None), ConnectionError):
                raise
            time.sleep(0.1)
    raise AssertionError(log.read_text())
