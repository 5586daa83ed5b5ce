"""Pictures and report of a diagnosis: complete, readable offline, safe against what a user's file may hold."""

from __future__ import annotations

import dataclasses
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from discrepancy.result import Diagnosis
from discrepancy.whiteness import FloorRatio
from jaxmodel.build import load_effect_class
from jaxmodel.effects import CATALOGUE
from workbench.commands.diagnose import pictures_of, print_diagnosis
from workbench.extended import extended_case
from workbench.pictures.failures import maps
from workbench.report import write_report
from workbench.runs import simulate_case
from workbench.wording import verdict_sentence

OWN_EFFECTS = Path(__file__).parents[2] / "examples" / "my_effects.py"
VOID = {"meta", "img", "br", "hr", "link", "input"}


class Page(HTMLParser):
    """A page as its tags and attributes; raises where a tag is not closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.text = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action")]
        if tag == "img":
            self.images.append(dict(attrs))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def page(diagnosis: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Page:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(diagnosis, path, pictures_of(diagnosis, simulate_case(extended_case(diagnosis)[0])))
    return Page(path.read_text(encoding="utf-8"))


def test_report_needs_nothing_but_itself(page: Page) -> None:
    assert page.addresses
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert not re.search(r"https?://|@import|url\(", page.text)


def test_report_has_every_picture_with_its_caption(page: Page, diagnosis: Diagnosis) -> None:
    # ladder, excess, maps, shifts, conditions, candidates, scores
    assert len(page.images) == 7 + len(diagnosis.case.runs)
    assert all(image["alt"] for image in page.images)


def test_report_says_what_the_diagnosis_says(page: Page, diagnosis: Diagnosis) -> None:
    text = re.sub(r"\s+", " ", page.text.replace("\u200b", ""))
    assert "The base model misses self_heating (probability 0.97) and arrhenius_resistance (probability 0.81)." in text
    assert "C_th = 82.0 ± 3.0 J/K" in text
    assert "arrhenius_resistance: charge_transfer" in text
    assert "Blind to: self_discharge and clock_shift." in text
    assert diagnosis.failure.sentences[0] in text
    assert diagnosis.failure.shift_sentence() in text
    assert "series_resistance_scale" in text
    for rung in diagnosis.ladder:
        for error in rung.errors.values():
            assert f"{error.check:.3g}" in text or f"{1e3 * error.check:.3g}" in text


def test_report_names_its_data_by_their_digests(page: Page, diagnosis: Diagnosis) -> None:
    for file in (diagnosis.case.path, *(run.source for run in diagnosis.case.runs)):
        assert hashlib.sha256(file.read_bytes()).hexdigest() in page.text


def test_report_says_what_else_it_was_made_with(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """The seed, what the user ordered, and the file of an effect of their own."""
    own = load_effect_class(f"{OWN_EFFECTS}:HotContact")
    ordered = dataclasses.replace(diagnosis, ordered=("--without pwm_ripple",))
    pictures = pictures_of(ordered, simulate_case(ordered.case))
    write_report(ordered, tmp_path / "report.html", pictures, CATALOGUE | {own.name: own})
    text = Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    assert "random numbers from seed 0" in text
    assert "ordered: --without pwm_ripple" in text
    assert hashlib.sha256(OWN_EFFECTS.read_bytes()).hexdigest() in text


def test_model_that_fails_nowhere_has_a_report_too(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """Without failing channels there are no pictures of where they fail."""
    fine = dataclasses.replace(
        diagnosis.failure, floor={name: FloorRatio(1.0, 1.1, 100.0) for name in diagnosis.failure.floor}, shifts=()
    )
    diagnosis = dataclasses.replace(diagnosis, failure=fine)
    pictures = pictures_of(diagnosis, simulate_case(diagnosis.case))
    assert not {"excess", "maps", "run-shifts"} & set(pictures)
    write_report(diagnosis, tmp_path / "report.html", pictures)
    assert "Where it fails" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_chi_square_over_something_else_than_noise_says_so(page: Page, diagnosis: Diagnosis, tmp_path: Path) -> None:
    """Far from the noise it is near one where the error is not: a reader must not take it for a good fit."""
    assert "weighed by what" not in page.text
    far = dataclasses.replace(diagnosis, far=("voltage_V",))
    write_report(far, tmp_path / "report.html", pictures_of(far, simulate_case(diagnosis.case)))
    assert "weighed by what" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_labels_of_maps_stay_beside_their_map(diagnosis: Diagnosis) -> None:
    """The longest name of a condition is longer than a map is high."""
    found = diagnosis.failure
    cells = next(cells for pairs in found.maps.values() for cells in pairs.values())
    long = {("current_A", "time since load changed_s"): cells}
    figure = maps(dataclasses.replace(found, maps=dict.fromkeys(found.maps, long)))
    figure.draw_without_rendering()
    drawn = [axes for axes in figure.axes if axes.get_ylabel().startswith("time")]
    assert drawn
    for axes in drawn:
        assert axes.yaxis.label.get_window_extent().height < axes.get_window_extent().height


def test_what_a_user_writes_is_text_and_no_markup(page: Page) -> None:
    """The case's title has an angle bracket in it; were it markup, the parser would have opened a tag `bench`."""
    assert "Small cell <bench> & load" in page.text


@pytest.mark.parametrize(
    ("verdict", "unexplained", "said"),
    [
        ("adequate", None, "nothing is missing"),
        ("sensor_fault", None, "a sensor is not"),
        ("unknown_effect", "a torque that grows with speed", "catalogue explains: a torque that grows with speed."),
        ("undecided", None, "cannot tell between"),
        ("undecided", "Runs held out are far off.", "not beyond: Runs held out are far off."),
        ("", None, "no effects were tried"),
    ],
)
def test_every_verdict_is_one_sentence(diagnosis: Diagnosis, verdict: str, unexplained: str | None, said: str) -> None:
    named = () if verdict in ("adequate", "", "undecided") else diagnosis.effects
    other = dataclasses.replace(diagnosis, verdict=verdict, effects=named, unexplained=unexplained)
    sentence = verdict_sentence(other)
    assert said in sentence
    assert sentence.endswith(".")
    assert sentence.count(". ") == 0


def test_verdict_and_remarks_are_printed(diagnosis: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    print_diagnosis(diagnosis)
    printed = " ".join(capsys.readouterr().out.split())
    assert verdict_sentence(diagnosis) in printed
    assert f"Note: {diagnosis.remarks[0]}" in printed


def test_comparison_without_effects_has_a_report_too(diagnosis: Diagnosis, tmp_path: Path) -> None:
    compared = dataclasses.replace(
        diagnosis,
        verdict="",
        effects=(),
        candidates=(),
        scores=(),
        blind_to=(),
        critical_z=float("nan"),
        ladder=diagnosis.ladder[:2],
    )
    pictures = pictures_of(compared, simulate_case(extended_case(compared)[0]))
    write_report(compared, tmp_path / "report.html", pictures)
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "no effects were tried" in page.text
    assert "What this data cannot say" not in page.text
    assert "scores" not in pictures


def test_maps_without_a_cell_are_left_out(diagnosis: Diagnosis) -> None:
    """Few readings leave no combination of two conditions with five of them."""
    found = diagnosis.failure
    sparse = {name: {("a", "b"): (), **pairs} for name, pairs in found.maps.items()}
    drawn = maps(dataclasses.replace(found, maps=sparse))
    assert "a" not in {axes.get_xlabel() for axes in drawn.axes}
