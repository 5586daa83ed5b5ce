"""Pictures and report of a diagnosis: complete, readable offline, safe against what a user's file may hold."""

from __future__ import annotations

import dataclasses
import hashlib
import re
from decimal import Decimal
from html.parser import HTMLParser
from pathlib import Path

import pytest

import jaxmodel.app.report
from jaxmodel.app.commands.diagnose import print_diagnosis
from jaxmodel.app.report import report_content, write_report
from jaxmodel.app.report_rows import ladder_tables
from jaxmodel.case.build import load_effect_class
from jaxmodel.diagnosis.advice.remarks import outside_fitted
from jaxmodel.diagnosis.result import Diagnosis, Immaterial, Removed, RunFound
from jaxmodel.diagnosis.summary import extrapolated_sentence, purpose_sentences
from jaxmodel.diagnosis.wording import curve_sentence, ladder_names, removed, run_sentence, verdict_sentence
from tests.made_up import contact, law, ocv_curve, with_additions

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
def full(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis that finds something of every kind."""
    return with_additions(diagnosis, curves=(ocv_curve(),), runs=(contact(),))


@pytest.fixture(scope="module")
def page(full: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Page:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(full, path.parent)
    return Page(path.read_text(encoding="utf-8"))


def text_of(page: Page) -> str:
    return re.sub(r"\s+", " ", page.text.replace("\u200b", ""))


def test_report_needs_nothing_but_itself(page: Page) -> None:
    assert page.addresses
    assert all(address.startswith("data:image/png;base64,") for address in page.addresses)
    assert not re.search(r"https?://|@import|url\(", page.text)


def test_report_has_every_picture_with_its_caption(page: Page, diagnosis: Diagnosis) -> None:
    # ladder, curves, errors by run, conditions, candidates, scores, and the pulses of run-02
    assert len(page.images) == 7 + len(diagnosis.case.runs)
    assert all(image["alt"] for image in page.images)


def test_report_says_what_the_diagnosis_says(page: Page, full: Diagnosis) -> None:
    text = text_of(page)
    for said in (
        "The model lacks self_heating and arrhenius_resistance. self_heating: the cell warms by its own losses.",
        "Fairly sure: the least certain effect has probability 0.81.",
        "charge_transfer would do as well as arrhenius_resistance; only run-02 shows arrhenius_resistance",
        "A run to be fitted that covers what the check runs cover: current 9 A (fitted so far: 3 to 6 A).",
        "C_th = 82.0 ± 3.0 J/K",
        "reduces the error of voltage by 12.3 mV on fit runs and 10.1 mV on check runs; "
        "it reduces the error of cell temperature by 1.92 K on fit runs",
        "only run-02 shows it",
        "arrhenius_resistance: charge_transfer",
        "Not detectable with these data: self_discharge and clock_shift.",
        "Open circuit voltage is off by +11.8 mV at SOC 0.58 (sd 1.2 mV)",
        "run-02: series resistance differs by +11.20 ± 0.80 mohm from the other runs",
        "Runs at 6 A lie 24 mV above the model, growing with time.",
        "Above SOC 0.9: 4, 7, 14 mV below the model, growing with current.",
        "slow_diffusion: the fitted runs show it, and no run left out is better.",
        "run-03.csv: current 9 A; the fit runs cover 3 to 6 A.",
        "voltage is within 10 mV (stated) in 0 of 1 check runs; not in run-03.",
        "cell temperature is within 1 K (assumed) in 1 of 1 check runs.",
    ):
        assert said in text, said
    (table,) = ladder_tables(full)
    for row in table["rows"]:
        assert all(error in text for error, _ in row["cells"])


def test_report_begins_with_three_lines_a_picture_and_the_ladder(page: Page) -> None:
    places = [
        page.text.index(heading)
        for heading in (
            "Missing",
            "How sure",
            "Measure next",
            "The ladder: what each step brings",
            "What is missing?",
            "Which values and tables of the case are wrong?",
            "Which error remains, and is it within tolerance?",
            "Errors by run",
            "Pulses and steps, one by one",
            "Parameters",
            "Noise",
            "Candidates and evidence",
            "Provenance",
        )
    ]
    assert places == sorted(places)
    # The run that opens the page is drawn once.
    assert "run-03" in (page.images[0]["alt"] or "")
    assert len({image["src"] for image in page.images}) == len(page.images)


def test_word_that_no_engineer_uses_is_explained_where_it_stands(page: Page) -> None:
    text = text_of(page)
    for explained in (
        "The ladder is the sequence of models that were fitted.",
        '"as stated" with the values that the case states',
        "The tolerance is the largest acceptable root mean square error on check runs.",
        "The noise is the random error of one reading.",
        "The pull is the distance of the final value from the stated one",
        "chi-square, the sum of squared errors in units of the noise",
    ):
        assert explained in text, explained


def test_changes_along_the_ladder_add_up_as_they_are_shown(full: Diagnosis) -> None:
    """To the last digit: errors and changes are rounded alike."""
    for table in ladder_tables(full):
        for column, total in enumerate(table["total"]):
            errors, changes = zip(*(row["cells"][column] for row in table["rows"]), strict=True)
            if "-" in errors:
                continue
            steps = [Decimal(change.replace("\u2212", "-").replace(",", "")) for change in changes[1:]]
            first, last = (Decimal(errors[place].replace(",", "")) for place in (0, -1))
            assert sum(steps) == last - first
            assert Decimal(total.replace("\u2212", "-")) == last - first


def test_errors_of_the_ladder_are_those_of_the_models(full: Diagnosis) -> None:
    (table,) = ladder_tables(full)
    for rung, row in zip(full.ladder, table["rows"], strict=True):
        scales = [1e3 if "[mV]" in label else 1.0 for label in table["channels"]]
        pairs = [(rung.errors[channel].fit, rung.errors[channel].check) for channel in full.noise]
        true = [scale * error for scale, pair in zip(scales, pairs, strict=True) for error in pair]
        shown = [float(error) for error, _ in row["cells"]]
        assert shown == pytest.approx(true, rel=0.05)


def test_ladder_of_many_channels_is_several_narrow_tables(full: Diagnosis) -> None:
    names = [f"speed_{k}_rad_s" for k in range(5)]
    error = full.final.errors["voltage_V"]
    ladder = tuple(dataclasses.replace(rung, errors=dict.fromkeys(names, error)) for rung in full.ladder)
    many = dataclasses.replace(full, ladder=ladder, noise=dict.fromkeys(names, full.noise["voltage_V"]))
    assert [len(table["channels"]) for table in ladder_tables(many)] == [3, 2]


def test_numbers_do_not_part_from_their_units(full: Diagnosis, tmp_path: Path) -> None:
    write_report(full, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for whole in ("82.0 ± 3.0 J/K", "12.3 mV", "1.92 K", "10 mV"):
        assert whole.replace(" ", "\u00a0") in page
        assert whole not in page


def test_what_a_tool_made_is_not_called_yours(page: Page) -> None:
    """A table may be of `parameterise` or of an import; the page does not know whose it is."""
    assert not re.search(r"\byours?\b table|\byour (table|value|number)", text_of(page))


def test_nothing_on_the_page_contradicts_anything(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """No effect is named and possible; an error that no condition explains is told where it is largest."""
    off = {name: dict(channels) for name, channels in diagnosis.final.predictions.items()}
    off["run-03"]["voltage_V"] = diagnosis.case.runs[2].measured.outputs["voltage_V"].copy()
    off["run-03"]["voltage_V"][-6:] += 5.0
    final = dataclasses.replace(diagnosis.final, predictions=off)
    twice = Immaterial("self_heating", {}, "self_heating: it is significant, but only on the fit runs")
    contradictory = dataclasses.replace(
        diagnosis,
        ladder=(*diagnosis.ladder[:-1], final),
        remaining={},
        immaterial=(twice, *diagnosis.immaterial),
        blind_to=("self_heating", *diagnosis.blind_to),
    )
    write_report(contradictory, tmp_path)
    text = text_of(Page((tmp_path / "report.html").read_text(encoding="utf-8")))
    assert "depends on no condition" not in text
    assert re.search(
        r"voltage: run-0. \((fit|check) run\), second .{,12}: the measurement is [\d.]+ m?V (above|below) the model",
        text,
    )
    assert "self_heating: it is significant" not in text
    assert "Not detectable with these data: self_discharge and clock_shift." in text
    assert "Possible, but not named: slow_diffusion." in text


def test_report_names_its_data_by_their_digests(page: Page, diagnosis: Diagnosis) -> None:
    for file in (diagnosis.case.path, *(run.source for run in diagnosis.case.runs)):
        assert hashlib.sha256(file.read_bytes()).hexdigest() in page.text


def test_report_says_what_else_it_was_made_with(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """The seed, what the user ordered, and the file of an effect of their own."""
    own = load_effect_class(f"{OWN_EFFECTS}:HotContact")
    case = dataclasses.replace(diagnosis.case, own_effects={own.name: own})
    write_report(dataclasses.replace(diagnosis, case=case, ordered=("--without pwm_ripple",)), tmp_path)
    text = Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    assert "random seed 0" in text
    assert "options: --without pwm_ripple" in text
    assert hashlib.sha256(OWN_EFFECTS.read_bytes()).hexdigest() in text


def test_model_that_fails_nowhere_has_a_report_too(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """No effect named, no correction, no remaining error."""
    fine = dataclasses.replace(
        diagnosis,
        verdict="adequate",
        effects=(),
        where_base={},
        remaining={},
        immaterial=(),
        extrapolated=(),
        tolerance={},
        fit_for_purpose={},
        errors=None,
        ladder=diagnosis.ladder[:2],
    )
    final = dataclasses.replace(fine.final, at_bound=())
    fine = dataclasses.replace(fine, ladder=(fine.ladder[0], final))
    pictures = write_report(fine, tmp_path)
    assert not {"curves", "errors-by-run"} & set(pictures)
    text = text_of(Page((tmp_path / "report.html").read_text(encoding="utf-8")))
    for said in ("No effect is named.", "The data show none.", "The runs share no significant dependence"):
        assert said in text


def test_rung_says_what_was_taken_out(diagnosis: Diagnosis) -> None:
    last = dataclasses.replace(diagnosis.final, added=("arrhenius_resistance", "ocv_hysteresis"))
    swapped = dataclasses.replace(diagnosis, ladder=(*diagnosis.ladder, last))
    assert ladder_names(swapped.ladder)[2:] == [
        "with self_heating",
        "and arrhenius_resistance",
        "and ocv_hysteresis, without self_heating",
    ]


def test_what_is_off_is_one_sentence() -> None:
    assert removed({"voltage_V": Removed(float("nan"), float("nan"))}) == ""
    assert removed({"voltage_V": Removed(0.0, 0.0)}) == ""
    assert removed({"voltage_V": Removed(-0.001, float("nan"))}) == "raises the error of voltage by 1 mV on fit runs"
    assert removed({"voltage_V": Removed(0.0123, -0.001)}) == (
        "reduces the error of voltage by 12.3 mV on fit runs and raises it by 1 mV on check runs"
    )
    shift = RunFound(
        "voltage_shift:voltage_V@run-02", "run-02", "run-02.csv", "voltage_shift:voltage_V", -0.0031, 0.0002, "V", {}
    )
    assert run_sentence(shift) == "run-02: voltage shift of voltage_V differs by -3.10 ± 0.20 mV from the other runs."
    assert curve_sentence(law()) == "overpotential is off by +81 mV at current_A 9 (sd 2 mV)."


def test_extrapolation_is_told_under_its_own_heading_alone(diagnosis: Diagnosis) -> None:
    outside = tuple(map(outside_fitted, diagnosis.extrapolated))
    assert outside
    content = report_content(dataclasses.replace(diagnosis, remarks=(*outside, *diagnosis.remarks)), {})
    assert content["remarks"] == list(diagnosis.remarks)
    assert len(content["extrapolated"]) == len(outside)


def test_condition_without_a_span_is_one_number(diagnosis: Diagnosis) -> None:
    one = dataclasses.replace(
        diagnosis.extrapolated[0], condition="ambient_degC", span_fitted=(20.0, 20.0), span=(-5.0, 8.0)
    )
    assert extrapolated_sentence(one) == "run-03.csv: ambient -5 to 8 °C; the fit runs cover 20 °C."
    size = dataclasses.replace(diagnosis.extrapolated[0], condition="|current_A|")
    assert extrapolated_sentence(size) == "run-03.csv: size of current 9 A; the fit runs cover 3 to 6 A."


def test_purpose_is_silent_without_held_out_runs(diagnosis: Diagnosis) -> None:
    assert purpose_sentences(dataclasses.replace(diagnosis, fit_for_purpose={"voltage_V": {}})) == []


def test_what_a_user_writes_is_text_and_no_markup(page: Page) -> None:
    """The title of the case contains `<bench>`; as markup, the parser would have opened a tag."""
    assert "Small cell <bench> & load" in page.text


@pytest.mark.parametrize(
    ("verdict", "unexplained", "said"),
    [
        ("adequate", None, "no missing effect"),
        ("sensor_fault", None, "sensor may be faulty: "),
        ("unknown_effect", "a torque that grows with speed", "show in these data): a torque that grows with speed."),
        ("undecided", None, "do not distinguish between"),
        ("undecided", "Check runs are far off.", "not the check runs: Check runs are far off."),
        ("", None, "no effects were tested"),
    ],
)
def test_every_verdict_is_one_sentence(diagnosis: Diagnosis, verdict: str, unexplained: str | None, said: str) -> None:
    named = () if verdict in ("adequate", "", "undecided") else diagnosis.effects
    other = dataclasses.replace(diagnosis, verdict=verdict, effects=named, unexplained=unexplained)
    sentence = verdict_sentence(other)
    assert said in sentence
    assert sentence.endswith(".")
    assert sentence.count(". ") == 0


def test_verdict_and_what_it_rests_on_are_printed(full: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    print_diagnosis(full)
    printed = " ".join(capsys.readouterr().out.split())
    for said in (
        verdict_sentence(full),
        f"Note: {full.remarks[0]}",
        f"Correction: {curve_sentence(full.curves[0])}",
        f"Correction: {run_sentence(full.runs[0])}",
        "Found: self_heating, C_th = 82.0 ± 3.0 J/K and hA = 0.110 ± 0.010 W/K",
        "10, at most 30",
        "1, assumed",
    ):
        assert said in printed


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
        immaterial=(),
        fit_for_purpose={},
        errors=diagnosis.errors[diagnosis.errors["model"] == "base"],
    )
    pictures = write_report(compared, tmp_path)
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "no effects were tested" in page.text
    assert "What the data cannot show" not in page.text
    assert "Candidates and evidence" not in page.text
    assert "scores" not in pictures
    assert "errors-by-run" in pictures


def test_template_speaks_of_no_state_of_charge() -> None:
    """What is said of every kind is said of motors too, which have none."""
    template = Path(jaxmodel.app.report.__file__).parent / "templates" / "diagnosis_body.html"
    assert not re.search(r"\bSOC\b|\bsoc\b|state of charge|\bcell\b|\bpack\b", template.read_text(encoding="utf-8"))
