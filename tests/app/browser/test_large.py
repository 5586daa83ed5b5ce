"""Large work in a real browser: a log of a million readings, and a sweep that is stopped and resumed."""

from __future__ import annotations

import re
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.app.browser.conftest import Server, Visitor

READINGS = 1_000_000
SPIKE_V = 4.5
# The points of every trace that is drawn, and the highest voltage among them.
DRAWN = """() => document.querySelector('.plot')._fullData.map((one) => one.x.length)"""
HIGHEST = """() => Math.max(...document.querySelector('.plot')._fullData.filter((one) => one.yaxis === 'y')
  .flatMap((one) => [...one.y]))"""
MORE_DONE = """(before) => {
  const [, done] = document.querySelector('.other').innerText.match(/([0-9,]+) of /);
  return Number(done.replaceAll(',', '')) > before;
}"""
# Seconds of the slowest of some frames while the pointer moves over the traces.
FRAMES = """() => new Promise((done) => {
  const times = [];
  const frame = (now) => {
    times.push(now);
    if (times.length < 60) requestAnimationFrame(frame);
    else done(Math.max(...times.slice(1).map((one, k) => one - times[k])) / 1000);
  };
  requestAnimationFrame(frame);
})"""


@pytest.fixture
def long_case(made_case: Path, tmp_path: Path) -> Path:
    """The small case with its first run logged every 0.6 ms, for 24 ms of it far too high."""
    folder = Path(shutil.copytree(made_case, tmp_path / "long"))
    run = pd.read_csv(folder / "run-01.csv")
    time_s = np.linspace(0.0, run["time_s"].iloc[-1], READINGS)
    table = {name: np.interp(time_s, run["time_s"], run[name]) for name in run.columns if name != "time_s"}
    table["voltage_V"][654_321:654_361] = SPIKE_V
    pd.DataFrame({"time_s": time_s} | table).to_csv(folder / "run-01.csv", index=False, float_format="%.8g")
    return folder


@pytest.mark.slow
def test_a_million_readings_are_drawn_with_their_extremes_and_exactly_where_zoomed(
    browser: Any, long_case: Path, tmp_path: Path
) -> None:
    server = Server(tmp_path / "sessions", str(long_case))
    try:
        visitor = Visitor(browser, server)
        page = visitor.page
        page.wait_for_selector("table.errors")
        page.wait_for_selector(".legend .base")
        assert max(page.evaluate(DRAWN)) <= 4000
        assert page.evaluate(HIGHEST) == pytest.approx(SPIKE_V, abs=1e-3)
        box = page.locator(".plot .nsewdrag").first.bounding_box()
        page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"])
        page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"], steps=5)
        print(f"slowest frame: {page.evaluate(FRAMES):.3f} s")
        visitor.picture("2-million")
        for _ in range(12):
            began = time.perf_counter()
            with page.expect_response(lambda answer: "low=" in answer.url) as response:
                page.click("[aria-label='Zoom in']")
            drawn = response.value.json()
            print(f"zoomed in: {time.perf_counter() - began:.2f} s, {drawn['runs'][0]['rows']} rows")
            if drawn["exact"]:
                break
        page.wait_for_selector("text=every reading is drawn")
        assert drawn["exact"]
        assert 500 < drawn["runs"][0]["rows"] <= 4000
        visitor.ended("open")
        assert visitor.complaints == []
        visitor.context.close()
    finally:
        server.stop()


def done_of(page: Any) -> tuple[int, int]:
    """Return how many combinations of the sweep are done, and of how many."""
    found = re.search(r"([\d,]+) of ([\d,]+) combinations are done", page.inner_text(".other"))
    assert found
    done, of = (int(one.replace(",", "")) for one in found.groups())
    return done, of


@pytest.mark.slow
def test_a_stopped_sweep_keeps_what_is_done_and_goes_on(browser: Any, made_case: Path, tmp_path: Path) -> None:
    server = Server(tmp_path / "sessions", str(shutil.copytree(made_case, tmp_path / "small")))
    try:
        visitor = Visitor(browser, server)
        page = visitor.page
        page.wait_for_selector("table.errors")
        visitor.ended("open")
        page.click("[role=tab]:has-text('Sweep')")
        for place in (0, 1):
            page.locator("label:has-text('values') input").nth(place).fill("2000")
        page.click("button:has-text('Start')")
        page.wait_for_selector("text=/[1-9][0-9,]* of 4,000,000 combinations are done/")
        page.click(".other button:has-text('Stop')")
        page.wait_for_selector(".job.stopped")
        page.wait_for_selector("button:has-text('Resume')")
        before, of = done_of(page)
        assert 0 < before < of == 4_000_000
        visitor.picture("7-sweep-stopped")
        page.reload()  # and after a reload
        page.click("[role=tab]:has-text('Sweep')")
        page.wait_for_selector("text=of 4,000,000 combinations are done")
        assert done_of(page) == (before, of)
        page.click("button:has-text('Resume')")
        page.wait_for_selector(".job.running")
        page.wait_for_function(MORE_DONE, arg=before)
        page.click(".other button:has-text('Stop')")
        page.wait_for_selector(".job.stopped")
        assert visitor.complaints == []
        visitor.context.close()
    finally:
        server.stop()
