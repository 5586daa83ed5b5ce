"""The documentation says what the code does: made pages, keys, metrics, ports, constants, examples, links."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml

from jaxmodel.base.errors import UserError
from jaxmodel.case.build import load_effect_class, make_effect
from jaxmodel.case.forms import CaseEntry, RunEntry, parse_case
from jaxmodel.case.measurements import KINDS
from jaxmodel.case.reading import read_case
from jaxmodel.diagnosis.decision import RULES
from jaxmodel.diagnosis.headline import Grade
from jaxmodel.diagnosis.wording import VERDICT_TITLES
from jaxmodel.effects import CATALOGUE
from jaxmodel.fit.settings import table
from jaxmodel.model.curves import CellCurves
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import PORTS
from jaxmodel.model.profile import constant
from jaxmodel.model.simulation import Status
from jaxmodel.sensitivity import metrics as of_sensitivity
from jaxmodel.sweeps import metrics_of, read_study
from jaxmodel.sweeps.study_form import ProfileForm, StudyForm
from tests.model.runs import readings

REPOSITORY = Path(__file__).parents[1]
DOCS = REPOSITORY / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
NOTEBOOKS = sorted(DOCS.rglob("*.ipynb"))
OWN_EFFECT = f"{REPOSITORY / 'examples' / 'my_effects.py'}:HotContact"


def text_of(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("name", ["parameters.md", "effects.md", "reference/settings.md", "reference/remarks.md"])
def test_page_is_what_the_code_says(name: str) -> None:
    spec = importlib.util.spec_from_file_location("make_parameters", DOCS / "make_parameters.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert text_of(name) == module.PAGES[name](), "run: python docs/make_parameters.py"


@pytest.mark.parametrize("page", [*PAGES, REPOSITORY / "README.md"], ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if target.startswith("http"):
            continue
        file, _, anchor = target.partition("#")
        found = (page.parent / file).resolve() if file else page
        assert found.exists(), target
        assert not anchor or anchor in anchors(found), target


def test_every_page_is_in_the_navigation() -> None:
    def pages_of(entry: object) -> list[str]:
        if isinstance(entry, str):
            return [entry]
        return [page for part in (entry.values() if isinstance(entry, dict) else entry) for page in pages_of(part)]

    site = yaml.safe_load((REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8"))
    files = [path.relative_to(DOCS).with_suffix(".md").as_posix() for path in [*PAGES, *NOTEBOOKS]]
    assert sorted(pages_of(site["nav"])) == sorted(files)


def test_home_page_lists_every_page() -> None:
    home = text_of("index.md")
    files = [path.relative_to(DOCS).as_posix() for path in [*PAGES, *NOTEBOOKS]]
    assert [file for file in files if f"]({file}" not in home] == ["index.md"]


def test_glossary_has_every_word_of_a_verdict_and_of_a_status() -> None:
    glossary = text_of("glossary.md")
    words = [*VERDICT_TITLES, *(grade.value for grade in Grade), *(status.name for status in Status)]
    said = glossary.lower().replace("`", "")
    others = {"reached_cutoff": "cutoff reached"}
    looked_for = [others.get(word.lower(), word.lower().replace("_", " ")) for word in words]
    assert [word for word in looked_for if word not in said.replace("_", " ")] == []
    for row in re.findall(r"^\| (.+?) \|", glossary, re.MULTILINE):
        assert glossary.count(f"\n| {row} |") == 1 or row in ("term", "---"), row


def test_what_to_measure_repeats_what_parameterise_says() -> None:
    """The tests of the page are those that the program asks for where the data lack them."""
    page = text_of("how_to/what_to_measure.md")
    sources = (REPOSITORY / "jaxmodel" / "parameterisation").glob("*.py")
    said = set(re.findall(r"\"([A-Z][^\"]+ would (?:give|show) [^\"]+\.)\"", "".join(p.read_text() for p in sources)))
    quoted = re.findall(r"\| ([A-Z][^|]+ would give (?:it|them)\.) \|", page)
    assert len(quoted) == 9
    assert set(quoted) <= said


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_toml_is_toml_and_a_whole_case_is_a_case(page: Path) -> None:
    for block in blocks(page, "toml"):
        content = tomllib.loads(block)
        if "runs" in content:
            parse_case(block, page.name)
        elif "axes" in content:
            StudyForm(**content)


def test_cases_page_has_every_key_and_column() -> None:
    page = text_of("cases.md")
    keys = [*CaseEntry.model_fields, *RunEntry.model_fields, *(c for kind in KINDS.values() for c in kind.columns)]
    assert [key for key in keys if not re.search(rf"`\[*{key}\]*`", page)] == []


def test_sweeps_page_has_every_key_and_no_other() -> None:
    table = text_of("sweeps.md").partition("## Keys")[2].partition("\n- ")[0]
    named = set(re.findall(r"^\| `\[?(\w+)\]?` \|", table, re.MULTILINE))
    assert named == StudyForm.model_fields.keys() - {"folder", "own_effects"}  # of Python alone
    assert set(re.findall(r"^\| `profile\.(\w+)`", table, re.MULTILINE)) == set(ProfileForm.model_fields)


def test_sweeps_page_has_every_metric_and_no_other() -> None:
    table = text_of("sweeps.md").partition("## Metrics")[2].partition("\nIntegrals")[0]
    for kind in KINDS:
        rows = [line.split("|") for line in table.splitlines() if line.startswith("| `")]
        named = {name for row in rows if kind in row[3] or "all" in row[3] for name in re.findall(r"`(\w+)`", row[1])}
        assert named == set(metrics_of(kind))
    added = {name for kind in KINDS for name in of_sensitivity.metrics_of(kind).keys() - metrics_of(kind).keys()}
    assert all(f"`{name}`" in text_of("sensitivity.md") for name in added)


def test_own_effect_page_has_every_port() -> None:
    table = text_of("your_own_effect.md").partition("| port | value |")[2].partition("\n\n")[0]
    assert set(re.findall(r"`(\w+)`", table)) == set(PORTS)


def test_constants_and_rules_of_the_diagnosis_are_as_printed() -> None:
    settings = text_of("reference/settings.md")
    for row in table():
        assert f"| `{row['name']}` | {row['value']} | {row['meaning']} | {row['source']} |" in settings
    page = text_of("discrepancy.md")
    for name, (verdict, when) in RULES.items():
        assert f"| {name} | `{verdict}` | {when} |" in page


def test_commands_name_files_that_are_there() -> None:
    for page in PAGES:
        for command in "\n".join(blocks(page, "sh")).splitlines():
            for path in re.findall(r"(?:examples|docs)/[\w./]+", command):
                assert (REPOSITORY / path).exists(), command


def test_files_of_the_own_effect_are_read_with_it_alone() -> None:
    cls = load_effect_class(OWN_EFFECT)
    read_case(DOCS / "own_effect")
    study = DOCS / "own_effect" / "study.toml"
    with pytest.raises(UserError, match="hot_contact"):
        read_study(study)
    assert read_study(study, own_effects=[cls]).prepared.model.effects[0].label == "hot_contact"
    assert cls.name not in CATALOGUE


def cell(**effects: dict[str, float]) -> Model:
    own = load_effect_class(OWN_EFFECT)
    catalogue = CATALOGUE | {own.name: own}
    made = tuple(make_effect(name, values, "test", catalogue) for name, values in effects.items())
    return Model("cell", Parameters(), CellCurves(), made)


def test_own_effect_is_absent_at_its_null() -> None:
    profile = constant(100.0, 1.0, current_A=3.0, ambient_degC=20.0)
    base, null = readings(cell(), profile), readings(cell(hot_contact={"R_c": 0.0}), profile)
    assert all(np.array_equal(base[name], null[name]) for name in base)


def test_own_effect_settles_where_its_equation_does() -> None:
    current, cold, thermal = 3.0, 0.02, 40.0
    profile = constant(100.0, 1.0, current_A=current, ambient_degC=20.0)
    with_contact = cell(hot_contact={"R_c": cold, "R_th": thermal, "tau_c": 2.0})
    lost = readings(cell(), profile)["voltage_V"][-1] - readings(with_contact, profile)["voltage_V"][-1]
    # x = R_th i^2 R_c (1 + a x), solved for the rise x.
    rise = thermal * current**2 * cold / (1.0 - 0.0039 * thermal * current**2 * cold)
    np.testing.assert_allclose(lost, current * cold * (1.0 + 0.0039 * rise), rtol=1e-9)


def test_own_effect_heats_its_contact_and_not_the_cell() -> None:
    heating = {"C_th": 20.0, "hA": 0.1}
    profile = constant(100.0, 1.0, current_A=3.0, ambient_degC=20.0)
    alone = readings(cell(self_heating=heating), profile)["cell_temperature_degC"]
    with_contact = readings(cell(self_heating=heating, hot_contact={}), profile)["cell_temperature_degC"]
    assert alone[-1] > 22.0
    np.testing.assert_allclose(with_contact, alone, rtol=0.0, atol=1e-9)
