"""A running workbench, a browser to drive it with, and pictures of what it showed.

The pictures lie in `workbench-pictures/`, which git ignores: look at them after a change of the pages.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).parents[3]
PICTURES = REPOSITORY / "workbench-pictures"
TOKEN = "let-this-test-in"
# A browser that keeps to itself.
ARGUMENTS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
).split()
PATIENCE_MS = 240_000


def chromium() -> str | None:
    """The browser of the system, where there is one."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Server:
    """`jaxmodel workbench` as a user starts it."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder, self._arguments = folder, arguments
        self._log = folder.with_name(f"{folder.name}.log")
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self.port = one.getsockname()[1]
        self.address = f"http://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        """Start it, and wait until it says where it is."""
        began = time.perf_counter()
        command = [sys.executable, "-m", "jaxmodel.app.cli", "workbench", *self._arguments, "--no-open"]
        command += ["--port", str(self.port), "--folder", str(self.folder), "--token", TOKEN]
        # NiceGUI does not serve as for a user where it sees that it is under test.
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
        with self._log.open("w") as log:
            self.process = subprocess.Popen(command, cwd=REPOSITORY, stdout=log, stderr=log, env=environment)
        while "The workbench is at" not in self._log.read_text():
            assert self.process.poll() is None, self._log.read_text()
            time.sleep(0.05)
        while not self._listens():  # it says so just before
            assert self.process.poll() is None, self._log.read_text()
            time.sleep(0.05)
        self.seconds_to_start = time.perf_counter() - began

    def _listens(self) -> bool:
        with socket.socket() as one:
            return one.connect_ex(("127.0.0.1", self.port)) == 0

    def kill(self) -> None:
        """End it as a crash would."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self) -> None:
        """End it as Ctrl-C would."""
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.kill()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    one = Server(tmp_path_factory.mktemp("workbench") / "sessions")
    yield one
    one.stop()


@pytest.fixture(scope="module")  # not longer: playwright keeps an event loop, in which other tests could start none
def browser() -> Iterator[Any]:
    """Chromium; without it, or without playwright, these tests are skipped, and say so once."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = chromium()
    if path is None:
        pytest.skip("there is no Chromium on this machine; apt-get install chromium to drive the workbench")
    with playwright.sync_playwright() as tools:
        one = tools.chromium.launch(executable_path=path, args=ARGUMENTS, headless=True)
        yield one
        one.close()


class Visitor:
    """One browser of its own, with its own cookie, and what its pages asked for and complained of."""

    def __init__(self, browser: Any, server: Server, size: tuple[int, int] = (1280, 800)) -> None:
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]})
        self.context.set_default_timeout(PATIENCE_MS)
        self.server = server
        self.asked: list[str] = []
        self.complaints: list[str] = []
        self.page = self.tab()
        self.page.goto(f"{server.address}/?token={TOKEN}")

    def tab(self) -> Any:
        """Open a tab."""
        page = self.context.new_page()
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        return page

    def picture(self, name: str) -> None:
        """Keep a picture of the page."""
        PICTURES.mkdir(exist_ok=True)
        self.page.screenshot(path=PICTURES / f"{name}.png")

    def step(self, title: str) -> None:
        """Go to a step."""
        self.page.click(f".step:has-text('{title}')")
        self.page.wait_for_selector(f".panel h2:has-text('{title}')")

    def upload(self, *files: Path) -> None:
        """Choose files as a person would."""
        self.page.set_input_files("input[type=file]", [str(file) for file in files])

    def ended(self, job: str) -> None:
        """Wait until no job runs; a failure is an error of the test."""
        self.page.wait_for_selector(".job:not(.running)", state="attached")
        assert "failed" not in (self.page.get_attribute(".job", "class") or ""), f"{job}: {self.said()}"

    def said(self) -> str:
        """Return what the line of the job says."""
        return self.page.inner_text(".job")

    @property
    def session(self) -> str:
        """Return the name of the session that the page shows."""
        found = re.search(r"/s/([0-9a-f]{32})", self.page.url)
        assert found, self.page.url
        return found[1]


@pytest.fixture
def visit(browser: Any, server: Server) -> Iterator[Callable[..., Visitor]]:
    """Open the workbench in a browser of its own; all are closed at the end."""
    visitors: list[Visitor] = []

    def new(of: Server = server, size: tuple[int, int] = (1280, 800)) -> Visitor:
        visitors.append(Visitor(browser, of, size))
        return visitors[-1]

    yield new
    for visitor in visitors:
        visitor.context.close()


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory, made_case: Path) -> Path:
    """Two runs of the small case as a cycler would write them: minutes, mA positive on charge, a decimal comma."""
    import pandas as pd

    folder = tmp_path_factory.mktemp("logs")
    for name in ("run-01", "run-02", "run-03"):
        run = pd.read_csv(made_case / f"{name}.csv")
        table = pd.DataFrame(
            {
                "Zeit [min]": run["time_s"] / 60.0,
                "Strom [mA]": -1000.0 * run["current_A"],
                "Spannung [V]": run["voltage_V"],
                "Temperatur [°C]": run["cell_temperature_degC"],
            }
        )
        table.to_csv(folder / f"{name}_25degC.csv", sep=";", decimal=",", index=False, float_format="%.5f")
    return folder


assert os.name == "posix" or chromium() is None, "the tests of the workbench end its server by signals"
