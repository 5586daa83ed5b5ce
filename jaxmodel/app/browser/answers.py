"""Beside the path: the diagnoses of the session, and two of them side by side."""

from __future__ import annotations

from typing import Any

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, h, select


def answers(context: Context) -> None:
    """Show the diagnoses of the session, the newest first, and what changed from one to another."""
    h("h2", "Diagnoses")
    listed: list[dict[str, Any]] = context.view.get("answers") or []
    if not listed:
        h("p", "Each diagnosis of this session appears here, automatic or kept, with its verdict.", "lead")
        return
    h("p", "Every diagnosis of this session, the newest first.", "lead")
    _table(
        ("diagnosed at", "case", "verdict", "named", "possible"),
        [
            [one["made"], one["case"], one["verdict"], ", ".join(one["named"]), ", ".join(one["possible"])]
            for one in listed
        ],
    )
    if len(listed) < 2:
        h("p", "With a second one, both can be put side by side.", "soft")
        return
    form = context.form.setdefault("answers", {"before": listed[1]["name"], "after": listed[0]["name"]})
    words = {one["name"]: f"{one['made']}: {', '.join(one['named']) or one['verdict']}" for one in listed}
    with h("div", "", "row"):
        for place, label in (("before", "Before"), ("after", "After")):
            select(label, words, form[place], lambda value, place=place: form.__setitem__(place, value))
    button("Compare", lambda: context.do("changes", **form), "button primary", disabled=context.is_busy)
    found = context.view.get("changes")
    if found:
        _changes(found)


def _changes(found: dict[str, Any]) -> None:
    h("h3", "What changed")
    rows = [["verdict", *found["verdict"]], *([one["what"], one["before"], one["after"]] for one in found["origin"])]
    _table(("", "before", "after"), rows)
    if found["names"]:
        h("h4", "Effects")
        _table(
            ("effect", "before", "after"), [[one[key] for key in ("name", "before", "after")] for one in found["names"]]
        )
    h("h4", "Runs, numbers and data")
    with h("ul", "", "findings"):
        for sentence in found["sentences"]:
            h("li", sentence)
    h("h4", "RMS error of the final model")
    with h("table"):
        _head(("reading", "run", "before", "after"), numbers=2)
        with h("tbody"):
            for one in found["errors"]:
                with h("tr"):
                    h("td", one["reading"])
                    h("td", one["run"])
                    h("td", one["before"], "n")
                    h("td", one["after"], "n bad" if one["is_worse"] else "n")


def _table(heads: tuple[str, ...], rows: list[list[str]]) -> None:
    with h("table"):
        _head(heads)
        with h("tbody"):
            for row in rows:
                with h("tr"):
                    for cell in row:
                        h("td", cell)


def _head(heads: tuple[str, ...], numbers: int = 0) -> None:
    """Show the heads of columns, the last so many of them above numbers."""
    with h("thead"), h("tr"):
        for place, name in enumerate(heads):
            h("th", name, "n" if place >= len(heads) - numbers else "")
