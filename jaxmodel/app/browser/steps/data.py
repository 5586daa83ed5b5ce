"""Bring data: shipped examples, dropped files, what the importer found, and how to correct it."""

from __future__ import annotations

import tomllib
from functools import cache
from typing import Any

from nicegui.element import Element

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, counted, duration, field, h, select, size_words
from jaxmodel.app.shipped import EXAMPLES

# The columns that each kind of hardware may have, and what they are called on the form.
COLUMNS = {
    "cell": ("time_s", "current_A", "voltage_V", "cell_temperature_degC", "ambient_degC"),
    "motor": ("time_s", "voltage_V", "current_A", "speed_rad_s", "load_torque_Nm", "winding_temperature_degC"),
    "robot": ("time_s", "duty", "load_torque_Nm", "pack_voltage_V", "pack_current_A", "speed_rad_s"),
}
KINDS = {"cell": "a battery cell", "motor": "a motor", "robot": "a robot: pack, bridge and motors"}
SIGNS = {
    "": "found from the voltage",
    "discharge-positive": "positive on discharge",
    "charge-positive": "positive on charge",
}
LOADS = {
    "": "the measured torque, else unknown",
    "free": "nothing",
    "propeller": "a propeller",
    "gravity": "a weight on an arm",
    "rolling": "a vehicle that rolls",
    "unknown": "unknown, whatever the file says",
}
SPLITS = {
    "auto": "at each file",
    "rests": "at long rests too",
    "steps": "at each cycle or step too",
    "files": "at files only",
}
NUMBERS = {
    "ambient": ("Ambient temperature [°C]", "--ambient"),
    "capacity_Ah": ("Capacity [A h]", "--capacity"),
    "initial_soc": ("State of charge at the start, 0 to 1", "--initial-soc"),
    "seconds_per_row": ("Seconds per row, without a clock", "--seconds-per-row"),
}


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

    def kind(value: str) -> None:
        form["kind"] = value
        context.go("")

    with h("div", "", "form"):
        select("What was measured", KINDS, form["kind"], kind)
        for name in ("ambient", "capacity_Ah", "initial_soc") if form["kind"] == "cell" else ("ambient",):
            words, option = NUMBERS[name]
            field(words, _text(form.get(name)), lambda v, n=name: put(n, v), option, inputmode="decimal")
        if form["kind"] != "cell":
            select("The load is", LOADS, str(form.get("load") or ""), lambda v: put("load", v), "--load")
        with h("details"):
            h("summary", "Correct what was found")
            select("A positive current means", SIGNS, str(form.get("sign") or ""), lambda v: put("sign", v), "--sign")
            select(
                "Runs begin", SPLITS, str(form.get("split_at") or "auto"), lambda v: put("split_at", v), "--split-at"
            )
            words, option = NUMBERS["seconds_per_row"]
            field(words, _text(form.get("seconds_per_row")), lambda v: put("seconds_per_row", v), option)
            held = ", ".join(form["check"]) if isinstance(form.get("check"), list | tuple) else form.get("check", "")
            field("Held-out runs, by name", held or "", lambda v: put("check", v), "--check, several by commas")
            field(
                "Preset", _text(form.get("preset")), lambda v: put("preset", v), "--preset, for what files do not tell"
            )
            columns = form.setdefault("columns", {})
            for name in COLUMNS[form["kind"]]:
                field(
                    name, columns.get(name, ""), lambda v, n=name: columns.__setitem__(n, v), "its column in the file"
                )
            units = form.get("units") or {}
            text = ", ".join(f"{name}={unit}" for name, unit in units.items()) if isinstance(units, dict) else units
            field("Units", text, lambda v: put("units", v), "COLUMN=UNIT, several by commas")
        again = "Import again" if source.get("how") == "files" else "Import"
        button(again, lambda: _import(context, form, source), "button primary", disabled=context.is_busy)


def _text(value: Any) -> str:
    return "" if value is None else str(value)


def _import(context: Context, form: dict[str, Any], source: dict[str, Any]) -> None:
    """Send the form; a number that is none is said by the importer's own sentence."""
    options: dict[str, Any] = {name: form.get(name) or None for name in ("sign", "split_at", "preset", "load")}
    for name in NUMBERS:
        options[name] = _number(form.get(name))
    options["columns"] = {name: value.strip() for name, value in form.get("columns", {}).items() if value.strip()}
    options["units"] = _pairs(form.get("units"))
    check = form.get("check")
    if isinstance(check, str):
        check = [name.strip() for name in check.split(",") if name.strip()]
    options["check"] = list(check) if check else None
    if context.session.uploads:
        context.do("upload", kind=form["kind"], options=options)
    else:
        context.do("import", files=source.get("paths", []), kind=form["kind"], options=options)


def _number(text: Any) -> float | None:
    try:
        return float(str(text).replace(",", ".")) if text not in (None, "") else None
    except ValueError:
        return None


def _pairs(given: Any) -> dict[str, str]:
    if isinstance(given, dict):
        return given
    parts = [part.partition("=") for part in str(given or "").split(",")]
    return {name.strip(): value.strip() for name, equals, value in parts if equals}


def _summary(context: Context) -> None:
    """Show the case: its runs, what is uncertain, and what the importer decided and found."""
    case = context.view["case"]
    h("h2", case["title"])
    fit = sum(run["split"] == "fit" for run in case["runs"])
    held = len(case["runs"]) - fit
    kind = KINDS[case["kind"]]
    h("p", f"{kind[:1].upper()}{kind[1:]}: {counted(fit, 'fitted run')}, {held} held out.", "lead")
    imported = context.view.get("imported")
    if imported:
        _findings(imported)
    with h("div", "", "wide"), h("table"):
        with h("thead"), h("tr"):
            for words in ("run", "", "rows", "duration", "conditions"):
                h("th", words, "n" if words in ("rows", "duration") else "")
        with h("tbody"):
            for run in case["runs"]:
                with h("tr"):
                    h("td", run["name"])
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
