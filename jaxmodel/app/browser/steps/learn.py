"""Learn what is missing: candidates in groups, each with its reason; pointing at one previews it in the traces."""

from __future__ import annotations

from typing import Any

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, h

GROUPS = {
    "Effects": "physics that the base model leaves out",
    "Sensors": "a fault of an instrument",
    "Single specimens": "one motor or cell of several that is unlike the others",
    "Single runs": "something that differs in one run alone",
}
_SHOWN = 4  # candidates of a group before "more"


def show(context: Context) -> None:
    """Show the candidates of the present model."""
    h("h2", "Learn what is missing")
    h(
        "p",
        "In the order of how much they explain of the error of the fitted runs. Point at one to preview the residual "
        "that it would leave, before any refit.",
        "lead",
    )
    candidates = context.view["candidates"]
    for group, words in GROUPS.items():
        own = [one for one in candidates if one["group"] == group]
        if not own:
            continue
        with h("h3", f"{group} "):
            h("small", words, "soft")
        shown = [one for one in own if one["share"] > 0.0][:_SHOWN]
        rest = own[len(shown) :]
        with h("ol", "", "candidates"):
            for one in shown:
                candidate(context, one)
        if rest:
            promising = any(one["share"] > 0.0 for one in rest)
            with h("details"):
                h("summary", f"{len(rest)} {'more' if promising else 'that these runs give no reason to add'}")
                with h("ol", "", "candidates"):
                    for one in rest:
                        candidate(context, one)


def candidate(context: Context, one: dict[str, Any]) -> None:
    """Show one candidate: its name, its reason, what it is, and the button that adds it."""
    promises = one["share"] > 0.0
    with h(
        "li", "", "candidate" if promises else "candidate faint", data_candidate=one["name"], data_title=one["title"]
    ):
        with h("div", "", "head"):
            h("b", one["title"])
            button(
                "Add",
                lambda name=one["name"]: _add(context, name),
                "button small",
                disabled=context.is_busy,
                aria_label=f"Add {one['title']}",
            )
        if promises:
            h("i", "", "promise", style=f"width:{100.0 * one['share']:.1f}%", aria_hidden="true")
        h("p", one["reason"])
        h("p", one["physics"], "soft")


def _add(context: Context, name: str) -> None:
    context.do("add", names=[name])
    context.go("add")
