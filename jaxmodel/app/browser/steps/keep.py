"""Keep: the report, the extended model, the answer, figures, and a script that repeats the session."""

from __future__ import annotations

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, h, size_words

_FIRST = 6  # files that are shown before "more"


def show(context: Context) -> None:
    """Show what can be kept, and what was written."""
    h("h2", "Keep")
    h("p", "A report that opens offline, the case with what was added, the answer for programs, every figure, and a "
      "Python script that repeats this session.", "lead")  # fmt: skip
    kept = context.view.get("kept")
    words = "Write them again" if kept else "Write report and files"
    button(words, lambda: context.do("keep"), "button primary", disabled=context.is_busy)
    if not kept:
        return
    h("h3", "Written")
    with h("ul", "", "files"):
        for one in kept[:_FIRST]:
            _file(context, one)
    if len(kept) > _FIRST:
        with h("details"):
            h("summary", f"{len(kept) - _FIRST} more")
            with h("ul", "", "files"):
                for one in kept[_FIRST:]:
                    _file(context, one)
    h("a", "Download all of it", "button", href=f"{context.address}/kept.zip", download="workbench.zip")


def _file(context: Context, one: dict) -> None:
    with h("li"):
        h("a", one["name"], href=f"{context.address}/kept/{one['name']}", target="_blank")
        h("span", one["what"], "soft")
        h("span", size_words(one["bytes"]), "soft n")
