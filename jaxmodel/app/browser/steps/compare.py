"""Compare: how large the error is in each run, against noise and tolerance."""

from __future__ import annotations

from typing import Any

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, h


def show(context: Context) -> None:
    """Show the errors of the present model by channel and run."""
    h("h2", "Compare")
    if context.stage == "opened":
        if context.is_busy:
            h("p", "The base model is being calibrated on the fitted runs. The measurements are there already.", "lead")
            return
        h("p", "Calibrate the base model to see how far it is from the measurements.", "lead")
        button("Compare with the model", lambda: context.do("compare"), "button primary", disabled=context.is_busy)
        return
    view = context.view
    h("p", headline(view), "lead")
    for channel in view["case"]["channels"]:
        rows = [row for row in view["errors"] if row["channel"] == channel["name"]]
        if rows:
            _table(channel, rows, view["residuals"][channel["name"]])
    with h("p", "", "soft"):
        h("span", "RMS is the root mean square of measured minus model. ")
        h("span", "Held-out runs were not used to calibrate; their error tells how the model does on new data.")
    button("See where it fails", lambda: context.go("where"), "button")


def headline(view: dict[str, Any]) -> str:
    """Say in one sentence how far the present model is from the measurements."""
    name = "The present model" if view["added"] else "The calibrated base model"
    held = "check" if any(row["split"] == "check" for row in view["errors"]) else "fit"
    rung = view["ladder"][[one["present"] for one in view["ladder"]].index(True)]
    parts = [
        f"{channel['quantity']} by {rung['errors'][channel['name']][f'{held}_text']}"
        for channel in view["case"]["channels"]
        if channel["name"] in rung["errors"]
    ]
    where = "on held-out runs" if held == "check" else "on the fitted runs"
    return f"{name} misses {' and '.join(parts)} RMS {where}."


def _times(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def _table(channel: dict[str, str], rows: list[dict[str, Any]], limits: dict[str, Any]) -> None:
    noise = f"noise {limits['noise_text']}"
    tolerance = f", tolerance {limits['tolerance_text']}" if limits["tolerance_text"] else ""
    with h("h3", f"{channel['quantity'].capitalize()} "):
        h("small", f"{noise}{tolerance}", "soft")
    largest = max(row["rms"] or 0.0 for row in rows) or 1.0
    with h("table", "", "errors"):
        with h("thead"), h("tr"):
            for words, kind in (("run", ""), ("", ""), ("RMS", "n"), ("mean", "n"), ("largest", "n"), ("/ noise", "n")):
                h("th", words, kind)
        with h("tbody"):
            for row in rows:
                with h("tr"):
                    h("td", row["run"])
                    with h("td", "", "barred"):
                        width = 100.0 * (row["rms"] or 0.0) / largest
                        h("i", "", f"bar of-{row['split']}", style=f"width:{width:.1f}%", aria_hidden="true")
                    with h("td", row["text"], "n"):
                        if row["within"] is not None:
                            h("span", " ✓" if row["within"] else " !", "ok" if row["within"] else "bad")
                    h("td", row["mean"], "n soft")
                    h("td", row["worst"], "n soft")
                    h("td", _times(row["over_noise"]), "n soft")
    with h("p", "", "key"):
        h("i", "", "swatch of-fit")
        h("span", "fitted")
        h("i", "", "swatch of-check")
        h("span", "held out")
