"""`python -m tests.stress.workbench --sessions 20 --kills 100`: many users at once, and a server that is killed.

First all users, each in a browser of its own, drop the same case, add an effect, take it back and add it again, all at
the same time. Then the server is killed at random moments of such a path and started again. What each session shows in
the end must be what one user alone is shown.
"""

from __future__ import annotations

import argparse
import random
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
from playwright.sync_api import Error as PlaywrightError
from playwright.sync_api import sync_playwright

from jaxmodel.app.browser.files import PROGRESS, VIEW, WANTED, read_json
from tests.app.browser.conftest import ARGUMENTS, Server, Visitor, chromium
from tests.made_up import write_case

EFFECT = "self_heating"
# What a user does, by what is clicked; a model after each.
PATH = {"add": (EFFECT,), "undo": (), "again": (EFFECT,)}


def _click(visitor: Visitor, what: str) -> None:
    if what == "undo":
        visitor.step("Add it")
        visitor.page.click(".actions >> text=Undo")
    else:
        visitor.page.wait_for_selector(".step:not([disabled]):has-text('Learn what is missing')")
        visitor.step("Learn what is missing")
        visitor.page.click(f"[data-candidate={EFFECT}] >> text=Add")


def _folder(visitor: Visitor) -> Path:
    (found,) = (visitor.server.folder / "sessions").glob(f"*/{visitor.session}")
    return found


def _job(visitor: Visitor) -> str:
    return (read_json(_folder(visitor) / PROGRESS) or {}).get("id", "")


def _asked(visitor: Visitor, what: str, case: Path) -> None:
    """Ask for a job, and wait until the server knows of it: a page that is left at once takes a click with it."""
    before = "" if what == "upload" else _job(visitor)
    if what == "upload":
        visitor.upload(*case.iterdir())
        visitor.page.wait_for_selector(".job", state="attached")
    else:
        _click(visitor, what)
    began = time.perf_counter()
    while _job(visitor) == before and not (_folder(visitor) / WANTED).exists():
        assert time.perf_counter() - began < 60.0, f"the click of {what} is lost"
        visitor.page.wait_for_timeout(5)


def _ended(visitor: Visitor, limit_s: float = 600.0) -> dict[str, Any]:
    """Return what a session shows when its job has ended."""
    folder, began = _folder(visitor), time.perf_counter()
    while (folder / WANTED).exists() or (read_json(folder / PROGRESS) or {"state": "running"})["state"] == "running":
        assert time.perf_counter() - began < limit_s, f"no end: {read_json(folder / PROGRESS)}"
        visitor.page.wait_for_timeout(50)
    progress = read_json(folder / PROGRESS)
    assert progress["state"] == "done", progress
    return read_json(folder / VIEW)


def _errors(view: dict[str, Any]) -> list[tuple[str, float]]:
    """Return every error of the present model, to six digits: a model fitted anew begins elsewhere."""
    return [
        (f"{channel} of {part}", float(f"{value:.3g}"))
        for channel, error in view["ladder"][-1]["errors"].items()
        for part, value in sorted(error.items())
        if isinstance(value, float)
    ]


def _shown(view: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(sorted(view["models"][-1])), _errors(view)


@contextmanager
def _place(folder: Path) -> Iterator[tuple[Any, Server]]:
    server = Server(folder / "workbench")
    with sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=chromium(), args=ARGUMENTS, headless=True)
        try:
            yield browser, server
        finally:
            browser.close()
            server.stop()


def _memory_MiB(server: Server) -> float:
    whole = psutil.Process(server.process.pid)
    return sum(one.memory_info().rss for one in (whole, *whole.children(recursive=True))) / 2**20


def together(browser: Any, server: Server, case: Path, count: int) -> list[str]:
    """Let so many users do the same at once; return what is wrong."""
    alone = Visitor(browser, server)
    expected = {}
    for what in ("upload", *PATH):
        _asked(alone, what, case)
        expected[what] = _shown(_ended(alone))
        alone.page.wait_for_selector(".panel h2:has-text('Compare')" if what == "upload" else ".panel h2")
    alone.context.close()
    visitors, wrong, most = [Visitor(browser, server) for _ in range(count)], [], 0.0
    for what in expected:
        began = time.perf_counter()
        for visitor in visitors:
            _asked(visitor, what, case)
        for number, visitor in enumerate(visitors):
            found = _shown(_ended(visitor))
            most = max(most, _memory_MiB(server))
            if found != expected[what]:
                wrong.append(f"user {number} after {what}: {found} for {expected[what]}")
        began_page = time.perf_counter()
        visitors[0].page.reload()
        visitors[0].page.wait_for_selector(".panel h2")
        paged = time.perf_counter() - began_page
        print(
            f"{count} users, {what}: {began_page - began:.1f} s, then a page {paged:.1f} s, {most:.0f} MiB", flush=True
        )
    wrong += [f"user {number}: {said}" for number, one in enumerate(visitors) for said in one.complaints]
    for visitor in visitors:
        visitor.context.close()
    return wrong


def killed(browser: Any, server: Server, case: Path, at: random.Random) -> list[str]:
    """Go the path once and kill the server in each part of it; return what is wrong."""
    visitor = Visitor(browser, server)
    try:
        return _path_with_kills(visitor, case, at)
    except (PlaywrightError, AssertionError) as error:
        visitor.picture("after-a-kill")
        return [str(error).splitlines()[0]]
    finally:
        visitor.context.close()


def _path_with_kills(visitor: Visitor, case: Path, at: random.Random) -> list[str]:
    server, page, wrong = visitor.server, visitor.page, []
    for what, model in {"upload": (), **PATH}.items():
        _asked(visitor, what, case)
        page.wait_for_timeout(at.uniform(0.0, 1500.0))
        address = page.url
        server.kill()
        page.goto("about:blank")
        server.start()
        page.goto(address)
        page.wait_for_selector(".panel h2")
        shown = _ended(visitor)
        if tuple(shown["models"][-1]) != model:
            wrong.append(f"{shown['models'][-1]} after {what}")
    return wrong


def main() -> int:
    """Run both; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    at, failed = random.Random(given.seed), 0
    with tempfile.TemporaryDirectory(prefix="workbench") as name:
        case = write_case(Path(name) / "small")
        with _place(Path(name)) as (browser, server):
            wrong = together(browser, server, case, given.sessions) if given.sessions else []
            failed += len(wrong)
            print(*wrong, sep="\n", end="\n" if wrong else "")
            for number in range(-(-given.kills // (1 + len(PATH)))):
                if wrong := killed(browser, server, case, at):
                    failed += 1
                    print(f"  path {number}: {wrong}", flush=True)
            print(f"{given.sessions} users at once and {given.kills} kills: {failed} wrong", flush=True)
    print(f"largest process of ours {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024:.0f} MiB")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
