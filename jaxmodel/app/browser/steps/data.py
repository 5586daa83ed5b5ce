"""Bring data: shipped examples, dropped files, what the importer found, and how to correct it."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import cache
from typing import Any

from nicegui.element import Element

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, counted, duration, field, h, select, size_words
from jaxmodel.app.import_form import CONTROLLERS, DRIVES, KINDS, LOADS, Field, shown
from jaxmodel.app.shipped import EXAMPLES

# The columns that each kind of hardware may have.
COLUMNS = {
    "cell": ("time_s", "current_A", "voltage_V", "cell_temperature_degC", "ambient_degC"),
    "motor": ("time_s", "voltage_V", "current_A", "speed_rad_s", "load_torque_Nm", "position_rad",
              "winding_temperature_degC", "case_temperature_degC"),
    "robot": ("time_s", "duty", "load_torque_Nm", "pack_voltage_V", "pack_current_A", "motor_current_A", "speed_rad_s"),
}  # fmt: skip
# What a controller follows.
REFERENCES = {"position": "reference_position_rad", "speed": "reference_speed_rad_s"}


class DropZone(Element, component="../static/drop.js"):
    """A place to drop files on; they go to the session's address, and the event "uploaded" says that all are there."""

    def __init__(self, target: str) -> None:
        """Send files to an address."""
        super().__init__()
        self._props["target"] = target


@cache
def examples() -> tuple[tuple[str, str, str], ...]:
    """Return folder and title of every shipped case, and what it is of."""
    found = []
    for path in sorted(EXAMPLES.glob("*/case.toml"), key=lambda path: path.parent.name != "samsung_30q"):
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        runs = len(content.get("runs", ()))
        about = f"{KINDS[content['kind']]}, {counted(runs, 'run')}"
        found.append((str(path.parent), str(content.get("title", path.parent.name)), about))
    return tuple(found)


def show(context: Context) -> None:
    """Show how to bring data, and what the session has."""
    if context.stage == "empty":
        h("h2", "Bring data")
        h("p", "Start with an example, or drop what your bench wrote. Nothing leaves this machine.", "lead")
        _bring(context)
        _uploads(context)
        return
    _summary(context)
    _uploads(context)
    with h("details"):
        h("summary", "Bring other data")
        _bring(context)


def _bring(context: Context) -> None:
    """Show the examples, and the place to drop files on."""
    with h("ul", "", "cards", aria_label="Examples"):
        for folder, title, about in examples():
            with h("li"), button("", lambda folder=folder: _open(context, folder), "card"):
                h("b", title)
                h("span", f"{about[:1].upper()}{about[1:]}", "soft")
    DropZone(f"{context.address}/files").on("uploaded", lambda: _uploaded(context))


def _open(context: Context, folder: str) -> None:
    context.do("open", path=folder, how="example")


def _uploaded(context: Context) -> None:
    """Open a case at once; raw files wait for their kind."""
    if any(name.lower().endswith(".toml") for name, _ in context.session.uploads):
        context.do("upload", kind="", options={})
    else:
        context.go("")


def _uploads(context: Context) -> None:
    """Show the files that were dropped, and the form that imports them."""
    files = context.session.uploads
    source = context.view.get("source", {})
    is_raw = bool(files) and not any(name.lower().endswith(".toml") for name, _ in files)
    if not is_raw and source.get("how") != "files":
        return
    h("h3", "Correct the import" if source.get("how") == "files" else "Import")
    if files:
        with h("ul", "", "files"):
            for name, size in files:
                with h("li"):
                    h("span", name)
                    h("span", size_words(size), "soft")
        button("Remove these files", lambda: _remove(context), "link")
    _form(context, source)


def _remove(context: Context) -> None:
    context.session.remove_uploads()
    context.go("")


def _form(context: Context, source: dict[str, Any]) -> None:
    """Show what the user may state of an import; what is left open is found in the files."""
    form = context.form.setdefault("import", {"kind": source.get("kind", "cell"), **source.get("options", {})})

    def put(name: str, value: Any) -> None:
        form[name] = value

    def choose(name: str, value: Any) -> None:
        """Keep a choice, and show the form anew where other fields belong to it."""
        before = _asked(form)
        put(name, value)
        if _asked(form) != before:
            context.go("")

    with h("div", "", "form"):
        select("What was measured", KINDS, form["kind"], lambda value: choose("kind", value))
        for one in shown(form["kind"], True, form):
            _ask(one, form, choose)
        with h("details"):
            h("summary", "Correct what was found")
            for one in shown(form["kind"], False, form):
                _ask(one, form, put)
            columns = form.setdefault("columns", {})
            for name in _columns(form):
                field(
                    name, columns.get(name, ""), lambda v, n=name: columns.__setitem__(n, v), "its column in the file"
                )
        words = "Import again" if source.get("how") == "files" else "Import"
        button(words, lambda: _import(context, form, source), "button primary", disabled=context.is_busy)


def _ask(one: Field, form: dict[str, Any], put: Callable[[str, Any], None]) -> None:
    """Show one option, and keep what is stated of it."""
    value = _text(form.get(one.name))
    if one.is_flag:
        select(one.words, {"": "no", "yes": "yes"}, value, lambda v: put(one.name, v), one.hint)
    elif one.choices is not None:
        select(one.words, one.choices, value or next(iter(one.choices)), lambda v: put(one.name, v), one.hint)
    else:
        field(one.words, value, lambda v: put(one.name, v), one.hint)


def _asked(form: dict[str, Any]) -> list[Field]:
    """Return the options that a form asks for."""
    return [*shown(form["kind"], True, form), *shown(form["kind"], False, form)]


def _columns(form: dict[str, Any]) -> list[str]:
    """Return the columns that the case of a form may have."""
    followed = REFERENCES.get(str(form.get("controller") or "")) if form["kind"] == "motor" else None
    return [*COLUMNS[form["kind"]], *([followed] if followed else [])]


def _text(value: Any) -> str:
    """Return an option as a person writes it."""
    if isinstance(value, dict):
        return ", ".join(f"{name}={one}" for name, one in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value))
    return "yes" if value is True else "" if value in (None, False) else str(value)


def _import(context: Context, form: dict[str, Any], source: dict[str, Any]) -> None:
    """Send the form as it is written; what is wrong in it is said by the importer's own sentence."""
    kind = form["kind"]
    options: dict[str, Any] = {one.name: _text(form.get(one.name)).strip() for one in _asked(form)}
    columns = form.get("columns", {})
    options["columns"] = {name: columns[name].strip() for name in _columns(form) if columns.get(name, "").strip()}
    if context.session.uploads:
        context.do("upload", kind=kind, options=options)
    else:
        context.do("import", files=source.get("paths", []), kind=kind, options=options)


def _summary(context: Context) -> None:
    """Show the case: its runs, what is uncertain, and what the importer decided and found."""
    case = context.view["case"]
    h("h2", case["title"])
    fit = sum(run["split"] == "fit" for run in case["runs"])
    held = len(case["runs"]) - fit
    kind = KINDS[case["kind"]]
    h("p", f"{kind[:1].upper()}{kind[1:]}: {counted(fit, 'fitted run')}, {held} held out.", "lead")
    if said := _said(case):
        h("p", f"{'; '.join(said)}.", "soft")
    imported = context.view.get("imported")
    if imported:
        _findings(imported)
    several = any(run.get("specimen") for run in case["runs"])
    with h("div", "", "wide"), h("table"):
        with h("thead"), h("tr"):
            for words in ("run", *(["of"] if several else []), "", "rows", "duration", "conditions"):
                h("th", words, "n" if words in ("rows", "duration") else "")
        with h("tbody"):
            for run in case["runs"]:
                with h("tr"):
                    h("td", run["name"])
                    if several:
                        h("td", run["specimen"])
                    with h("td"):
                        h("span", "held out" if run["split"] == "check" else "fitted", f"tag of-{run['split']}")
                    h("td", f"{run['rows']:,}", "n")
                    h("td", duration(run["duration_s"]), "n")
                    h("td", run["label"], "soft")
    if case["uncertain"]:
        with h("details"):
            h("summary", f"{counted(len(case['uncertain']), 'uncertain parameter')}, to be calibrated")
            with h("ul"):
                for one in case["uncertain"]:
                    h("li", f"{one['name']} = {one['text']}")
    if context.stage == "opened":
        button("Compare with the model", lambda: _compare(context), "button primary", disabled=context.is_busy)


def _said(case: dict[str, Any]) -> list[str]:
    """Return what a case says of its load, drive and controller, in words."""
    of = (("load", "the load is ", LOADS), ("drive", "the drive sets ", DRIVES))
    said = [f"{before}{words[case[name]]}" for name, before, words in of if case.get(name)]
    said += [f"a controller {CONTROLLERS[case['controller']]} sets it"] if case.get("controller") else []
    return [f"{one[:1].upper()}{one[1:]}" if place == 0 else one for place, one in enumerate(said)]


def _compare(context: Context) -> None:
    context.do("compare")
    context.go("compare")


def _findings(imported: dict[str, Any]) -> None:
    """Show warnings first, then decisions, then notes."""
    if imported["warned"]:
        h("h3", "Look at")
        with h("ul", "", "findings warned"):
            for sentence in imported["warned"]:
                h("li", sentence)
    if imported["missing"]:
        h(
            "p",
            "First parameters are taken from the runs themselves when you compare, unless you name a preset.",
            "soft",
        )
    for words, key in (("decision", "decided"), ("note", "noted")):
        if imported[key]:
            with h("details"):
                h("summary", f"{counted(len(imported[key]), words)} of the importer")
                with h("ul", "", "findings"):
                    for sentence in imported[key]:
                        h("li", sentence)
