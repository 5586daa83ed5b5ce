"""See where it fails: sentences, and the map of the residual over two conditions, whose cells lead to their samples."""

from __future__ import annotations

import json
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from jaxmodel.app.browser.chart import Figure
from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, h

_LARGEST_SIDE = 34  # pixels of a cell
_LETTERS = 44  # of all labels of an axis, side by side


def show(context: Context) -> None:
    """Show where the present model fails."""
    view = context.view
    h("h2", "See where it fails")
    if not view["where"]:
        h("p", "Nothing stands out: what is left follows no condition of these runs.", "lead")
    for channel in view["case"]["channels"]:
        said = [one for one in view["where"] if one["channel"] == channel["name"]]
        drawn = next((one for one in view["maps"] if one["name"] == channel["name"]), None)
        if not said and drawn is None:
            continue
        h("h3", channel["quantity"].capitalize())
        if said:
            with h("ul", "", "sentences"):
                for one in said:
                    with h("li"):
                        h("span", _sentence(one["sentence"], view["case"]["runs"]))
                        h("span", f"{100 * one['share']:.0f} % of the squared error", "tag")
        if drawn is not None:
            _map(drawn)
    button("Learn what is missing", lambda: context.go("learn"), "button")


def _sentence(text: str, runs: list[dict[str, Any]]) -> str:
    """Return a sentence with a capital, unless it begins with the name of a run."""
    if not any(text.startswith(run["name"]) for run in runs):
        text = f"{text[:1].upper()}{text[1:]}"
    return f"{text.rstrip('.')}."


def _map(drawn: dict[str, Any]) -> None:
    """Draw one map; a click on a cell marks its samples in the traces."""
    sizes = [abs(value) for row in drawn["mean"] for value in row if value is not None]
    limit = max(sizes, default=1.0) or 1.0
    columns, rows = drawn["x"]["labels"], drawn["y"]["labels"]
    heat = {
        "type": "heatmap",
        "z": drawn["mean"],
        "customdata": drawn["rms"],
        "x": list(range(len(columns))),
        "y": list(range(len(rows))),
        "zmin": -limit,
        "zmax": limit,
        "xgap": 2,
        "ygap": 2,
        "colorscale": [[0.0, "var(--low)"], [0.5, "var(--middle)"], [1.0, "var(--high)"]],
        "colorbar": {
            "thickness": 10,
            "outlinewidth": 0,
            "title": {"text": f"mean residual [{drawn['unit']}]", "side": "right", "font": {"size": 11}},
            "tickfont": {"size": 11},
        },
        "hovertemplate": f"mean %{{z:.3~g}} {drawn['unit']}, RMS %{{customdata:.3~g}} {drawn['unit']}<extra></extra>",
    }
    layout = {
        "height": min(110 + _LARGEST_SIDE * len(rows), 300),
        "margin": {"l": 64, "r": 8, "t": 8, "b": 56},
        "xaxis": _axis(drawn["x"]["title"], columns),
        "yaxis": _axis(drawn["y"]["title"], rows) | {"tickvals": list(range(len(rows))), "ticktext": rows},
    }
    chart = Figure({"data": [heat], "layout": layout}, f"Map of the residual of {drawn['quantity']}")
    chart.classes("map")
    chart.on("pick", lambda event: _pick(event, drawn))
    with h("div", "", "cells", aria_label=f"Cells of the map of {drawn['quantity']}"):
        h(
            "p",
            "Click a cell, or walk there with the arrow keys and press Enter, to mark its samples in the traces. "
            "Orange: measured above the model; blue: below.",
            "soft",
        )


def _axis(title: str, labels: list[str]) -> dict[str, Any]:
    longest = max((len(label) for label in labels), default=1)
    every = max(1, -(-len(labels) * longest // _LETTERS)) if title != "run" else 1
    places = list(range(0, len(labels), every))
    return {
        "title": {"text": title},
        "tickvals": places,
        "ticktext": [labels[place] for place in places],
        "tickangle": 0,
        "showgrid": False,
        "fixedrange": True,
    }


def _pick(event: GenericEventArguments, drawn: dict[str, Any]) -> None:
    """Tell the traces which cell was clicked."""
    column, row = round(float(event.args["x"])), round(float(event.args["y"]))
    labels = drawn["x"]["labels"], drawn["y"]["labels"]
    if not (0 <= column < len(labels[0]) and 0 <= row < len(labels[1])):
        return
    words = f"{drawn['x']['title']} {labels[0][column]}, {drawn['y']['title']} {labels[1][row]}"
    detail = {"channel": drawn["name"], "cell": row * len(labels[0]) + column, "words": words}
    ui.run_javascript(f"document.dispatchEvent(new CustomEvent('workbench:cell', {{detail: {json.dumps(detail)}}}))")
