"""Learn what is missing: candidates in groups, each with its reason; pointing at one previews it in the traces."""

from __future__ import annotations

from typing import Any

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, h

GROUPS = {
    "Effects": "physics that the base model leaves out",
    "Sensors": "a fault of an instrument",
    "Single runs": "something that differs in one run alone",
}
_SHOWN = 4  # candidates of a group before "more"


def show(context: Context) -> None:
    """Show the candidates of the present model."""
    h("h2", "Learn what is missing")
    h(
        "p",
        "Ranked by how much better they explain the fitted runs. Point at one to preview the residual that it would "
        "leave, before any refit.",
        "lead",
    )
    candidates = context.view["candidates"]
    best = max((one["gain"] for one in candidates), default=0.0)
    for group, words in GROUPS.items():
        own = [one for one in candidates if one["group"] == group]
        if not own:
            continue
        with h("h3", f"{group} "):
            h("small", words, "soft")
        with h("ol", "", "candidates"):
            for one in own[:_SHOWN]:
                candidate(context, one, best)
        if len(own) > _SHOWN:
            with h("details"):
                h("summary", f"{len(own) - _SHOWN} more")
                with h("ol", "", "candidates"):
                    for one in own[_SHOWN:]:
                        candidate(context, one, best)


def candidate(context: Context, one: dict[str, Any], best: float) -> None:
    """Show one candidate: its name, its reason, what it is, and the button that adds it."""
    promises = one["gain"] > 0.0
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
        if promises and best > 0.0:
            h("i", "", "promise", style=f"width:{100.0 * max(one['gain'], 0.0) / best:.1f}%", aria_hidden="true")
        h("p", one["reason"])
        h("p", one["physics"], "soft")


def _add(context: Context, name: str) -> None:
    context.do("add", names=[name])
    context.go("add")
