"""`jaxmodel parameterise`: first parameters of a case from its fit runs alone."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path

from jaxmodel.app import terminal
from jaxmodel.app.article import Picture, Section, Table, write_article
from jaxmodel.app.commands.start import read_case_with, start
from jaxmodel.base.errors import MeasurementError
from jaxmodel.parameterisation import Extraction, Parameterisation, parameterise, write_preset
from jaxmodel.parameterisation.preset import checked_name
from jaxmodel.plots.style import png

CAPTIONS = {
    "slow": "Slow discharges and charges on one scale of the charge.",
    "rests": "The last voltage of each rest of ten minutes or more.",
    "resistance": "Voltage step over current step at each edge of the current.",
    "relaxation": "Two time constants of each rest, by variable projection.",
    "fit": "The joint refit of all curves on the readings of each fit run.",
    "thermal": "Heating and cooling, measured and fitted.",
    "electrical": "Voltage, measured and as R i + k w.",
    "friction": "Torque over speed, measured and fitted.",
    "curves": "The tables of the case.",
}


def parameterise_case(
    path: Path,
    out: Path,
    effects: Sequence[str],
    *,
    answer_only: bool = False,
    preset: str | None = None,
    data: str = "",
    licence: str = "",
) -> Parameterisation:
    """Write the parameterised case, its tables and, but for `answer_only`, pictures and a page to `out`.

    Args:
        path: of the case.
        out: folder for the results.
        effects: the user's own, as `file.py:Class`.
        answer_only: leaves out pictures and page.
        preset: the name of a preset to be written too.
        data: where the measurements are from, for the preset.
        licence: of the measurements, for the preset.

    Raises:
        UserError: the case cannot be used, or its fit runs lack what is needed.
    """
    case = read_case_with(path, effects)
    if any(file.resolve().parent == out.resolve() for file in case.files):
        raise MeasurementError(f"--out {out}: the case was read from this folder; give another one.")
    if preset is not None:
        checked_name(preset)
    start(out)
    began = time.perf_counter()
    with terminal.stages(case.name) as progress:
        found = parameterise(case, progress=progress)
        progress("forward simulation")
        found.write(out, pictures=False)
        if preset is not None:
            write_preset(found, out / f"{preset}.toml", data, licence)
        if not answer_only:
            progress("pictures and page")
        _write_page(found, out, time.perf_counter() - began, pictures=not answer_only)
    _print(found)
    page = "" if answer_only else ", report.html and its pictures"
    terminal.say(f"case.toml, extractions.csv, errors.csv{page} are in {out}.")
    if preset is not None:
        terminal.say(f'{out / preset}.toml is a preset: a case beside it uses it by preset = "{preset}.toml".')
    return found


def _write_page(found: Parameterisation, out: Path, seconds: float, *, pictures: bool) -> None:
    given = [one for one in found.extractions if one.found]
    missing = [one for one in found.extractions if not one.found]
    sections = [
        Section(
            "Numbers from the data",
            [
                "The sd allow for what the model misses: its residuals are correlated, and only one in many counts.",
                Table(
                    "numbers", ("number", "how", "from", "value", "sd", "unit"), [_row(one) for one in given], words=3
                ),
            ],
        )
    ]
    if missing:
        rows = [(one.name, one.method, one.test, _number(one.value)) for one in missing]
        head = ("number", "where it comes from", "a test that would give it", "value used")
        sections.append(Section("Not in these data", [Table("missing", head, rows, words=3)]))
    if pictures:
        sections += [
            Section(
                name.replace("_", " ").capitalize(),
                [Picture(f"extraction-{name}", png(found.plot.extraction(name)), _caption(name))],
            )
            for name in found.points
        ]
        if found.case.tables:
            sections.append(Section("Tables", [Picture("curves", png(found.plot.curves()), CAPTIONS["curves"])]))
    sections.append(Section("Forward simulation of every run", [_errors(found)]))
    findings = [f"{len(given)} numbers from the data, {len(missing)} not in them.", *found.remarks]
    write_article(
        out,
        f"Parameters: {found.case.title}",
        f"From the fit runs alone; made in {seconds:.0f} s",
        findings,
        sections,
        found.case.files,
        pictures=pictures,
    )


def _caption(name: str) -> str:
    return CAPTIONS.get(name) or CAPTIONS[name.split("_", 1)[1]]


def _row(one: Extraction) -> tuple[str, ...]:
    where = f"{', '.join(one.runs)}: {one.samples}"
    return (one.name, one.method, where, _number(one.value), _number(one.sd, 2), one.unit)


def _number(value: float, digits: int = 5) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else ""


def _errors(found: Parameterisation) -> Table:
    """Return the errors of the forward simulation; those above a state of charge where there is one."""
    columns = {"run": "run", "split": "split", "reading": "reading", "rms": "rms"}
    columns |= {} if found.case.kind == "motor" else {"rms_to_soc_0.1": "rms above SOC 0.1"}
    rows = [
        tuple(_number(row[name], 3) if name.startswith("rms") else str(row[name]) for name in columns)
        for row in found.errors.to_dict("records")
    ]
    return Table("simulated", tuple(columns.values()), rows, words=3)


def _print(found: Parameterisation) -> None:
    """Print the numbers but for the points of tables, what is missing, and the errors of the forward simulation."""
    shown = [one for one in found.extractions if one.found and " at SOC " not in one.name]
    rows = [(one.name, _number(one.value), _number(one.sd, 2), one.unit, one.method) for one in shown]
    terminal.table(found.case.title, ("number", "value", "sd", "unit", "how"), rows, right=(1, 2))
    for one in found.extractions:
        if not one.found:
            terminal.say(one.sentence())
    table = _errors(found)
    terminal.table("Forward simulation", table.head, table.rows, right=range(3, len(table.head)))
    for remark in found.remarks:
        terminal.say(f"Note: {remark}")
