"""Add it: a switch for each addition, the automatic diagnosis, and the ladder of errors that falls."""

from __future__ import annotations

from typing import Any

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.html import button, counted, h
from jaxmodel.app.browser.steps.learn import candidate

_NEXT = 2  # candidates that are offered here too


def show(context: Context) -> None:
    """Show the present model, its additions and every model so far."""
    view = context.view
    h("h2", "Add it")
    progress = context.session.progress or {}
    diagnosing = context.is_busy and progress.get("do") == "diagnose"
    with h("div", "", "actions"):
        if diagnosing:
            button("Stop and take over", context.stop, "button primary")
        else:
            button("Diagnose automatically", lambda: context.do("diagnose"), "button primary", disabled=context.is_busy)
        can_undo = len(view["ladder"]) > 1
        button("Undo", lambda: context.do("undo"), "button", disabled=context.is_busy or not can_undo)
    if view.get("verdict"):
        _verdict(view["verdict"])
    _ladder(view)
    h("h3", "In the model")
    if not view["added"]:
        h("p", "Nothing yet: this is the calibrated base model.", "soft")
    with h("ul", "", "switches"):
        for one in view["added"]:
            with h("li"):
                button(
                    "",
                    lambda name=one["name"]: context.do("drop", names=[name]),
                    "switch",
                    role="switch",
                    aria_checked="true",
                    aria_label=f"Remove {one['title']}",
                    disabled=context.is_busy,
                )
                with h("div"):
                    h("b", one["title"])
                    h("p", one["physics"], "soft")
    offered = _offered(view["candidates"])
    if offered:
        h("h3", "Most promising now")
        with h("ol", "", "candidates"):
            for one in offered:
                candidate(context, one)
    _parameters(view)


def _offered(candidates: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the best effects and sensor faults, and the best of the rest, which is no new physics."""
    promising = [one for one in candidates if one["share"] > 0.0]
    physics = [one for one in promising if one["group"] in ("Effects", "Sensors")]
    return physics[:_NEXT] + [one for one in promising if one not in physics][:1]


def _verdict(verdict: dict[str, Any]) -> None:
    with h("div", "", f"verdict {verdict['verdict']}"):
        h("small", "Verdict")
        h("b", verdict["title"])
        for name, sentence in verdict["lines"]:
            with h("p"):
                h("b", f"{name} ", "line")
                h("span", sentence)
    if verdict["hidden"]:
        with h("details"):
            h("summary", f"{counted(len(verdict['hidden']), 'kind')} of effect that would not show in these data")
            h("p", f"{', '.join(verdict['hidden'])}.")
    if verdict["remarks"]:
        with h("details"):
            h("summary", f"{counted(len(verdict['remarks']), 'remark')} on the data and the fit")
            with h("ul", "", "findings"):
                for remark in verdict["remarks"]:
                    h("li", remark)


def _ladder(view: dict[str, Any]) -> None:
    """Draw every model's error on fit runs and on held-out runs, side by side, against noise and tolerance."""
    h("h3", "The ladder: RMS error of every model")
    if len(view["ladder"]) == 1:
        h("p", "Add something below, or let the diagnosis do it: each model gets its bars here.", "soft")
    for channel in view["case"]["channels"]:
        if channel["name"] not in view["ladder"][0]["errors"]:
            continue
        _rungs(view, channel)
    with h("p", "", "key"):
        for kind, words in (("fit", "fitted runs"), ("check", "held-out runs")):
            h("i", "", f"swatch of-{kind}")
            h("span", words)
        h("i", "", "tick noise")
        h("span", "noise")
        if any(limits["tolerance"] for limits in view["residuals"].values()):
            h("i", "", "tick tolerance")
            h("span", "tolerance")


def _rungs(view: dict[str, Any], channel: dict[str, Any]) -> None:
    name, limits = channel["name"], view["residuals"][channel["name"]]
    errors = [one["errors"][name] for one in view["ladder"]]
    largest = max((e[split] or 0.0 for e in errors for split in ("fit", "check")), default=0.0) or 1.0
    scale = limits["factor"] * largest
    tolerance = f", tolerance {limits['tolerance_text']}" if limits["tolerance_text"] else ""
    with h("h4", f"{channel['quantity'].capitalize()} "):
        h("small", f"noise {limits['noise_text']}{tolerance}", "soft")
    with h("ol", "", "ladder"):
        for one, error in zip(view["ladder"], errors, strict=True):
            with h("li", "", "present" if one["present"] else "", aria_current="step" if one["present"] else None):
                h("span", one["name"], "rung")
                for split in ("fit", "check"):
                    if error[split] is None:
                        continue
                    with h("div", "", "bars"):
                        with h("div", "", "track"):
                            h("i", "", f"bar of-{split}", style=f"width:{100.0 * error[split] / largest:.2f}%")
                            for kind in ("noise", "tolerance"):
                                if limits[kind] and limits[kind] < scale:
                                    h("i", "", f"tick {kind}", style=f"left:{100.0 * limits[kind] / scale:.2f}%")
                        h("span", error[f"{split}_text"], "n")


def _parameters(view: dict[str, Any]) -> None:
    with h("details"):
        h("summary", f"{len(view['parameters'])} fitted numbers")
        with h("table"), h("tbody"):
            for one in view["parameters"]:
                with h("tr"):
                    h("td", one["name"])
                    h("td", one["text"], "n")
                    h("td", "far from its stated value" if one["strained"] else "", "bad")
