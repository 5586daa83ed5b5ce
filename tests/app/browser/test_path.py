"""The whole path in a real browser: on the shipped example, on a made case, on raw files; and what goes wrong."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.app.browser.conftest import REPOSITORY, Server, Visitor

Visit = Callable[..., Visitor]


def errors_of(page: Any) -> list[float]:
    """The widths of the bars of the ladder's first channel on fit runs, in the order of the models."""
    bars = page.locator("ol.ladder").nth(-1).locator(".bar.of-fit")
    return [bars.nth(place).bounding_box()["width"] for place in range(bars.count())]


def test_the_shipped_example_from_data_to_report(visit: Visit) -> None:
    visitor = visit()
    page = visitor.page
    page.click(".card >> nth=0")
    page.wait_for_selector(".plot .main-svg")
    visitor.picture("1-data")
    page.wait_for_selector("table.errors")
    page.wait_for_selector(".legend .base")
    assert "held-out runs" in page.inner_text(".panel .lead")
    visitor.picture("2-compare")
    # Zoomed in, every axis follows the readings of the window, and those of all runs are linked.
    with page.expect_response(lambda answer: "low=" in answer.url):
        page.click("[aria-label='Zoom in']")
    page.wait_for_function("document.querySelector('.plot')._fullLayout.xaxis.range[0] > 1")
    page.wait_for_function("document.querySelector('.plot')._fullLayout.yaxis.range[0] > 2")
    ranges = page.evaluate("['xaxis', 'xaxis2'].map((x) => document.querySelector('.plot')._fullLayout[x].range)")
    assert ranges[0] == ranges[1]
    page.click(".zoom >> text=All")

    # The case as it is read, and the pages that explain the words.
    answer = page.request.get(f"{visitor.server.address}{page.get_attribute('text=Case file', 'href')}")
    assert 'kind = "cell"' in answer.text()
    assert "glossary.md" in (page.get_attribute("a:has-text('Glossary')", "href") or "")

    visitor.step("See where it fails")
    assert "lacks heat" in page.inner_text(".panel")
    page.wait_for_selector(".map .main-svg")
    # Without a mouse too: the first key shows the frame in the first cell, the second moves it.
    page.locator(".map").first.focus()
    for key in ("ArrowUp", "ArrowRight", "Enter"):
        page.keyboard.press(key)
    page.wait_for_selector(".legend .dot")
    by_keyboard = page.inner_text(".legend")
    assert "row 1 of" in page.locator(".map").first.get_attribute("aria-label")
    box = page.locator(".map .nsewdrag").first.bounding_box()
    page.mouse.click(box["x"] + 0.05 * box["width"], box["y"] + 0.1 * box["height"])
    # The samples of the cell are marked in the traces.
    page.wait_for_function("before => document.querySelector('.legend').innerText !== before", arg=by_keyboard)
    visitor.picture("3-where")

    visitor.step("Learn what is missing")
    page.hover("[data-candidate=self_heating]")
    page.wait_for_selector(".legend .line.preview")
    visitor.picture("4-learn")
    # Another tab is shown without a new panel: a click on a button that is replaced just then would be lost.
    page.evaluate("document.querySelector('.panel h2').dataset.drawn = 'once'")
    page.click("[role=tab]:has-text('Sweep')")
    page.click("[role=tab]:has-text('Traces')")
    assert page.locator(".panel h2[data-drawn=once]").count() == 1
    page.click("[data-candidate=self_heating] >> text=Add")
    page.wait_for_selector(".switches li")
    before, after = errors_of(page)
    assert after < 0.2 * before  # the temperature's error falls to a fifteenth
    page.wait_for_selector(".legend .line.model")
    visitor.picture("5-add")
    page.click(".actions >> text=Undo")
    page.wait_for_selector(".switches li", state="detached")
    assert len(errors_of(page)) == 1
    visitor.ended("undo")

    visitor.step("Keep")
    page.click("text=Write report and files")
    page.wait_for_selector("text=Download all of it")
    visitor.picture("6-keep")
    for name in ("report.html", "session.py"):
        answer = page.request.get(f"{visitor.server.address}/s/{visitor.session}/kept/{name}")
        assert answer.ok
    assert "Investigation(case)" in answer.text()
    # Nothing was asked of any other host.
    assert {url.split("/")[2] for url in visitor.asked if not url.startswith(("data:", "blob:"))} == {
        f"127.0.0.1:{visitor.server.port}"
    }
    assert visitor.complaints == []


@pytest.mark.slow
def test_a_made_case_is_diagnosed_stopped_and_taken_over(visit: Visit, made_case: Path) -> None:
    visitor = visit()
    page = visitor.page
    visitor.upload(*made_case.iterdir())
    page.wait_for_selector("table.errors")
    visitor.ended("upload")
    visitor.step("Add it")
    page.click("text=Diagnose automatically")
    page.click("text=Stop and take over")
    page.wait_for_selector(".job.stopped")
    page.wait_for_selector("button:has-text('Diagnose automatically'):not([disabled])")
    # What a person does next works at once, and the same search goes on from there.
    page.click("text=Diagnose automatically")
    page.wait_for_selector(".verdict.missing_effect")
    assert "Self heating" in page.inner_text(".switches")
    visitor.picture("5-diagnosed")

    # The same session in a second tab, and after a reload.
    other = visitor.tab()
    other.goto(page.url)
    other.wait_for_selector(".verdict.missing_effect")
    page.reload()
    page.wait_for_selector(".verdict.missing_effect")

    page.click(".switches [role=switch]")
    page.wait_for_selector(".switches li", state="detached")
    other.wait_for_selector(".switches li", state="detached")

    page.click("[role=tab]:has-text('Sweep')")
    page.click("button:has-text('Estimate')")
    page.wait_for_selector(".other [role=status]")
    page.click("button:has-text('Start')")
    page.wait_for_selector(".other .figure .nsewdrag")
    visitor.ended("sweep")
    page.wait_for_selector("text=1,600 of 1,600 combinations are done")
    visitor.picture("7-sweep")
    box = page.locator(".other .figure .nsewdrag").first.bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    page.wait_for_selector("[aria-label^='Elasticity of'] .main-svg")
    visitor.picture("8-sensitivity")
    assert visitor.complaints == []


@pytest.mark.slow
def test_raw_files_are_imported_corrected_and_compared(visit: Visit, log: Path) -> None:
    visitor = visit()
    page = visitor.page
    visitor.upload(*log.iterdir())
    page.wait_for_selector("text=What was measured")
    page.fill("label:has-text('Ambient temperature') input", "10")
    page.click("button:has-text('Import')")
    page.wait_for_selector("text=decisions of the importer")
    assert "25 degC" not in page.inner_text(".panel table")
    page.fill("label:has-text('Ambient temperature') input", "")
    page.click("text=Correct what was found")
    page.fill("label:has-text('Capacity') input", "3")
    page.fill("label:has-text('Held-out runs') input", "run-03_25degC")
    page.click("button:has-text('Import again')")
    page.wait_for_selector("td:has-text('25 degC')")
    visitor.picture("1-imported")
    page.click("button:has-text('Compare with the model')")
    page.wait_for_selector("table.errors")
    visitor.ended("compare")
    assert visitor.complaints == []


def test_the_form_asks_for_drive_controller_and_specimens(visit: Visit, tmp_path: Path) -> None:
    import numpy as np
    import pandas as pd

    time = 0.01 * np.arange(400)
    table = {"time_s": time, "voltage_V": np.sin(time), "current_A": np.cos(time), "position_rad": np.sin(2.0 * time)}
    for name in ("a_1", "b_1"):
        pd.DataFrame(table | {"goal": np.sin(2.0 * time)}).to_csv(tmp_path / f"{name}.csv", index=False)
    visitor = visit()
    page = visitor.page
    visitor.upload(tmp_path / "a_1.csv", tmp_path / "b_1.csv")
    page.wait_for_selector("text=What was measured")
    assert page.locator("label:has-text('Controller')").count() == 0
    page.select_option("label:has-text('What was measured') select", "motor")
    page.select_option("label:has-text('Controller') select", "position")
    page.wait_for_selector("label:has-text('Gains of the controller')")
    page.select_option("label:has-text('The load is') select", "free")
    page.fill("label:has-text('Ambient temperature') input", "22")
    page.fill("label:has-text('Gains of the controller') input", "k_p=5, k_q=2")
    page.fill("label:has-text('Files of several motors') input", "A=a_*, B=b_*")
    page.click("button:has-text('Import')")
    page.wait_for_selector(".job [role=alert]:has-text(\"no number 'k_q'. Did you mean 'k_p'\")")
    page.fill("label:has-text('Gains of the controller') input", "k_p=5")
    page.click("text=Correct what was found")
    page.fill("label:has-text('reference_position_rad') input", "goal*1")
    visitor.picture("1-form")
    page.click("button:has-text('Import')")
    page.wait_for_selector("text=a controller of the position sets it")
    assert "A" in page.inner_text(".panel table tbody tr >> nth=0")
    visitor.picture("1-servo")
    assert visitor.complaints == []


def test_wrong_files_get_the_sentence_of_the_command_line(visit: Visit, tmp_path: Path, case_folder: Path) -> None:
    from jaxmodel.base.errors import UserError
    from jaxmodel.data.importing import import_case

    visitor = visit()
    page = visitor.page
    code = tmp_path / "effect.py"
    code.write_text("print('run')", encoding="utf-8")
    visitor.upload(code)
    assert "is code" in page.inner_text(".drop [role=alert]")

    wrong = tmp_path / "wrong.csv"
    wrong.write_text("a,b\n<b>x</b>,y\n", encoding="utf-8")
    visitor.upload(wrong)
    page.wait_for_selector("text=What was measured")
    page.click("button:has-text('Import')")
    page.wait_for_selector(".job [role=alert]")
    try:
        import_case([wrong], "cell")
        sentence = "it was imported"
    except UserError as error:
        sentence = " ".join(str(error).split())
    # The same sentence; the folder before the file's name is that of the session.
    assert page.inner_text(".job [role=alert]").partition("/wrong.csv")[2] == sentence.partition("/wrong.csv")[2] != ""
    page.click("text=Remove these files")
    page.wait_for_selector("text=Remove these files", state="detached")

    toml = case_folder / "case.toml"
    toml.write_text(toml.read_text(encoding="utf-8").replace('"run-01.csv"', '"../../secret.csv"'), encoding="utf-8")
    visitor.upload(*case_folder.iterdir())
    page.wait_for_selector("text=is outside the upload")
    visitor.picture("1-refused")
    assert visitor.complaints == []


def test_two_users_do_not_see_each_other(visit: Visit, made_case: Path) -> None:
    first, second = visit(), visit()
    assert first.session != second.session
    assert second.page.request.get(f"{second.server.address}/s/{first.session}/case").status == 404
    answer = second.page.request.get(f"{second.server.address}/s/{first.session}/traces")
    assert answer.status == 404
    second.page.goto(f"{second.server.address}/s/{first.session}")
    assert "no such session" in second.page.inner_text("body")


@pytest.mark.slow
def test_a_killed_server_takes_its_sessions_up_again(browser: Any, tmp_path: Path, made_case: Path) -> None:
    copy = Path(shutil.copytree(made_case, tmp_path / "small"))
    server = Server(tmp_path / "sessions", str(copy))
    try:
        visitor = Visitor(browser, server)
        page = visitor.page
        page.wait_for_selector(".job.running")
        session = visitor.session
        server.kill()
        page.goto("about:blank")  # the page that lost its server would load itself again, and cut off what follows
        server.start()
        page.goto(f"{server.address}/")  # the cookie is still good, and leads to the same session
        assert visitor.session == session
        page.wait_for_selector("table.errors")  # the job that the crash interrupted was begun again
        visitor.ended("open")
        visitor.context.close()
    finally:
        server.stop()


def test_the_example_answers_within_five_seconds(visit: Visit, server: Server) -> None:
    """On a machine that has nothing else to do; here with room for one that has."""
    began = time.perf_counter()
    visitor = visit()
    visitor.page.wait_for_selector(".card")
    seconds = server.seconds_to_start + time.perf_counter() - began
    print(f"from the command to the first page: {seconds:.1f} s")
    assert seconds < 30.0


def test_the_step_that_is_shown_is_not_drawn_anew(visit: Visit) -> None:
    """A click on a button that is replaced at that moment would be lost."""
    page = visit().page
    page.wait_for_selector(".panel h2:has-text('Bring data')")
    page.evaluate("document.querySelector('.panel h2').dataset.drawn = 'once'")
    page.click(".step:has-text('Bring data')")
    page.wait_for_timeout(500)
    assert page.locator(".panel h2[data-drawn=once]").count() == 1


def test_a_tablet_in_the_dark_shows_the_path_without_scrolling_sideways(visit: Visit) -> None:
    visitor = visit(size=(820, 1180))
    page = visitor.page
    page.wait_for_selector(".card")
    page.click("#theme")
    assert page.evaluate("document.documentElement.scrollWidth") <= 820
    visitor.picture("tablet-dark")


assert (REPOSITORY / "examples" / "samsung_30q" / "case.toml").is_file()


def test_two_diagnoses_of_a_session_are_put_side_by_side(visit: Visit, made_case: Path) -> None:
    visitor = visit()
    page = visitor.page
    visitor.upload(*made_case.iterdir())
    page.wait_for_selector("table.errors")
    visitor.ended("upload")
    page.click(".tab-button:has-text('Diagnoses')")
    page.wait_for_selector("text=Each diagnosis of this session appears here")
    for candidate in ("self_heating", "voltage_offset:voltage_V"):
        visitor.step("Learn what is missing")
        page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
        page.click(f"[data-candidate='{candidate}'] >> text=Add")
        page.wait_for_selector(".switches li:has-text('" + candidate.split(":")[0].split("_")[1] + "')")
        visitor.ended("add")
        visitor.step("Keep")
        page.click("button:has-text('Write')")
        visitor.ended("keep")
        page.wait_for_selector("text=Download all of it")
    page.click(".tab-button:has-text('Diagnoses')")
    page.wait_for_selector(".tab.other tbody tr >> nth=1")
    page.click(".tab.other button:has-text('Compare')")
    page.wait_for_selector("text=What changed")
    shown = page.inner_text(".tab.other")
    assert "voltage offset of voltage" in shown
    assert "The data are the same." in shown
    assert "all check runs" in shown
    visitor.picture("8-diagnoses")
    assert visitor.complaints == []
