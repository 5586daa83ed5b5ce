"""The report in a browser: it fits on a narrow page, in a light and a dark room."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from jaxmodel.app.report import write_report
from jaxmodel.diagnosis.result import Diagnosis
from tests.app.browser.conftest import PICTURES
from tests.made_up import contact, ocv_curve, with_additions

TOO_WIDE = "() => [...document.querySelectorAll('.wide')].filter(e => e.scrollWidth > e.clientWidth + 1).length"
CUT = "() => document.documentElement.scrollWidth - window.innerWidth"
BRIGHTNESS = """([selector, name]) => {
  const colour = getComputedStyle(document.querySelector(selector))[name].match(/\\d+/g).map(Number);
  return (colour[0] + colour[1] + colour[2]) / 765;
}"""
# Each number of a table, with its unit and sd, is on one line.
BROKEN = """() => [...document.querySelectorAll('td.n')].filter(cell => {
  const walker = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const range = document.createRange();
    range.selectNodeContents(walker.currentNode);
    if (range.getClientRects().length > 1) return true;
  }
  return false;
}).length"""


@pytest.fixture(scope="module")
def page_file(diagnosis: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_report(with_additions(diagnosis, curves=(ocv_curve(),), runs=(contact(),)), folder)
    return folder / "report.html"


@pytest.mark.parametrize("width", [820, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_report_fits_and_is_readable(browser: Any, page_file: Path, width: int, scheme: str) -> None:
    context = browser.new_context(viewport={"width": width, "height": 1000}, color_scheme=scheme)
    page = context.new_page()
    page.goto(page_file.as_uri())
    assert page.evaluate(TOO_WIDE) == 0
    assert page.evaluate(CUT) <= 0
    assert page.evaluate(BROKEN) == 0
    paper = page.evaluate(BRIGHTNESS, ["body", "backgroundColor"])
    ink = page.evaluate(BRIGHTNESS, ["body", "color"])
    assert (paper > 0.9) == (scheme == "light")
    assert abs(paper - ink) > 0.7
    # The three lines are seen without scrolling.
    assert page.locator(".opening").bounding_box()["y"] < 400
    PICTURES.mkdir(exist_ok=True)
    page.screenshot(path=PICTURES / f"report-{width}-{scheme}.png", full_page=True)
    context.close()
