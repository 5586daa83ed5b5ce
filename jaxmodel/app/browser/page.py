"""One page: the steps at the top, the panel of the step, and the traces or what is beside the path."""

from __future__ import annotations

import functools
import time
from importlib import metadata
from typing import Any

from nicegui import ui
from nicegui.element import Element

from jaxmodel.app.browser import beside
from jaxmodel.app.browser.answers import answers
from jaxmodel.app.browser.chart import Traces
from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.files import GRID
from jaxmodel.app.browser.html import button, change, duration, h
from jaxmodel.app.browser.sessions import Session
from jaxmodel.app.browser.steps import STEPS
from jaxmodel.app.browser.workers import Workers

# Seconds between two looks at the session's files.
LOOK_S = 0.25
TABS = {
    "traces": "Traces",
    "sweep": "Sweep",
    "sensitivity": "Sensitivity",
    "next": "Next experiment",
    "answers": "Diagnoses",
}
_BESIDE = {"sweep": beside.sweep, "sensitivity": beside.sensitivity, "next": beside.next_experiment, "answers": answers}
_STAGES = ("empty", "opened", "compared")
_DOING = {
    "open": "Opening",
    "upload": "Reading the files",
    "import": "Importing",
    "compare": "Comparing",
    "add": "Adding",
    "drop": "Removing",
    "undo": "Undoing",
    "diagnose": "Diagnosing",
    "next": "Looking for an experiment",
    "forecast": "Estimating",
    "sweep": "Sweeping",
    "sensitivity": "Differentiating",
    "keep": "Writing",
    "changes": "Comparing two diagnoses",
}


@functools.cache
def documentation() -> str:
    """Return the address of the folder of the documentation, as the package states it; "" where it states none."""
    try:
        stated = metadata.metadata("jaxmodel").get_all("Project-URL") or []
    except metadata.PackageNotFoundError:
        return ""
    addresses = dict(one.split(", ", 1) for one in stated)
    return addresses.get("Documentation", "").rpartition("/")[0]


class Page:
    """What one tab shows of a session."""

    def __init__(self, session: Session, workers: Workers, step: str) -> None:
        """Build the page at a step."""
        self.context = Context(session, workers, self.go)
        self.step = step if step in [one.name for one in STEPS] else ""
        self.tab = "traces"
        self._seen: dict[str, Any] = {}
        self._map: beside.Map | None = None
        self._build()
        self.look()
        ui.timer(LOOK_S, self.look)

    def _build(self) -> None:
        h("a", "Skip to the panel", "skip", href="#panel")
        with h("header", "", "top"):
            h("b", "jaxmodel workbench", "brand")
            self.title = h("span", "", "title")
            self.case_file = h("a", "Case file", "quiet", href=f"{self.context.address}/case", target="_blank")
            for name, page in (("Documentation", "index.md"), ("Glossary", "glossary.md")):
                if documentation():
                    address = f"{documentation()}/{page}"
                    h("a", name, "quiet", href=address, target="_blank", rel="noopener noreferrer")
            h("a", "New session", "quiet", href="/new")
            h("button", "", "quiet theme", type="button", id="theme", aria_label="Light or dark")
        # Steps and tabs stay, and only change: a click on a button that is replaced at that moment would be lost.
        with h("nav", "", "steps", aria_label="Steps"), h("ol"), h("div", "", "contents"):
            self.steps = {step.name: self._step(number, step.name, step.title) for number, step in enumerate(STEPS, 1)}
        self.job = h("div", "", "job", role="status", aria_live="polite")
        with h("main", "", "split") as self.main:
            with h("section", "", "panel", id="panel", tabindex="-1", aria_label="Step"):
                self.panel = h("div", "", "contents")
            with h("section", "", "stage", aria_label="Traces and what is beside the path"):
                with h("div", "", "tabs", role="tablist"):
                    self.tabs = {name: self._tab(name, words) for name, words in TABS.items()}
                with h("div", "", "tab") as self.traces_tab:
                    self.traces = Traces(self.context.address)
                    self.empty = h("p", "The traces of your runs appear here.", "empty")
                self.other = h("div", "", "tab other")

    def _step(self, number: int, name: str, title: str) -> tuple[Element, Element]:
        with h("li") as item, button("", lambda: self.go(name), "step") as one:
            h("span", str(number) if name != "keep" else "✓", "number", aria_hidden="true")
            h("span", title)
        return item, one

    def _tab(self, name: str, words: str) -> Element:
        return button(words, lambda: self.go(name), "tab-button", role="tab")

    def go(self, place: str) -> None:
        """Go to a step or a tab by its name; "" stays and draws anew.

        A place that is shown already is not drawn anew: a click on a button that is replaced just then would be lost.
        """
        if place in TABS:
            self.tab = place
        elif place:
            self.step = place
            if self.tab != "traces" and place != "keep":
                self.tab = "traces"
            ui.navigate.history.replace(f"{self.context.address}?step={place}")
        else:
            self._seen.pop("panel", None)
            self._seen.pop("tab", None)
        self.look()

    def look(self) -> None:
        """Draw what has changed in the session's files since the last look."""
        context = self.context
        context.workers.look_after(context.session)
        view, progress = context.view, context.session.progress
        is_new = self._changed("path", view.get("path")) and "path" in view and not view.get("imported")
        if not self.step or (is_new and self.step == "data"):
            self.step = "compare" if context.stage != "empty" else "data"
        drawn = (view["version"], context.is_busy)
        if self._changed("version", view["version"]) and context.stage != "empty":
            self.traces.show(view)
        if self._changed("job", progress):
            self._show_job(progress)
        elif progress is not None and progress["state"] == "running":
            self._count_down(progress)
        # Apart: a button of the panel is not replaced because another tab is shown, nor the other way round.
        panel, tab = self._changed("panel", (*drawn, self.step)), self._changed("tab", (*drawn, self.tab))
        if panel:
            self._draw()
        if tab:
            self._show_tab()
        elif self._map and self._changed("grid", (context.session.content(GRID) or {}).get("done")):
            self._map.update()

    def _changed(self, what: str, value: Any) -> bool:
        changed = what not in self._seen or self._seen[what] != value
        self._seen[what] = value
        return changed

    def _draw(self) -> None:
        """Draw steps and panel anew."""
        context = self.context
        self.title.set_text(context.view["case"]["title"] if context.stage != "empty" else "")
        self.case_file.set_visibility(context.stage != "empty")
        for step in STEPS:
            item, one = self.steps[step.name]
            is_here = step.name == self.step
            item.classes(add="here") if is_here else item.classes(remove="here")
            ready = _STAGES.index(context.stage) >= _STAGES.index(step.stage)
            change(one, disabled=not ready, aria_current="step" if is_here else "false")
        self.panel.clear()
        with self.panel:
            shown = next(step for step in STEPS if step.name == self.step)
            if _STAGES.index(context.stage) >= _STAGES.index(shown.stage):
                shown.show(context)
            else:
                h("h2", shown.title)
                h("p", "This step needs the one before it.", "lead")

    def _show_tab(self) -> None:
        """Draw the tab beside the panel; traces keep their zoom, the others are drawn anew."""
        is_traces = self.tab == "traces"
        for name, one in self.tabs.items():
            change(one, aria_selected=str(name == self.tab).lower())
        self.main.classes(remove="bare free")
        if not is_traces:
            self.main.classes("free")
        if self.context.stage == "empty":
            self.main.classes("bare")
        self.traces_tab.set_visibility(is_traces)
        self.other.set_visibility(not is_traces)
        self.traces.set_visibility(self.context.stage != "empty")
        self.empty.set_visibility(self.context.stage == "empty")
        self.other.clear()
        self._map = None
        if not is_traces:
            with self.other:
                self._map = _BESIDE[self.tab](self.context)

    def _show_job(self, progress: dict[str, Any] | None) -> None:
        """Show what is being done, how far it is and how long it takes; or why it could not be done."""
        running = progress if progress is not None and progress["state"] == "running" else None
        if self._changed("bar", running["do"] if running else progress):
            self._build_job(progress)
        if running:
            # In place: a button that is built anew between press and release would lose the click.
            self._bar.style(f"width:{100.0 * running['share']:.1f}%")
            self._now.set_text(running["now"].replace("_", " "))
            self._count_down(running)

    def _count_down(self, running: dict[str, Any]) -> None:
        """Show the time left, which was estimated when the present part of the job began."""
        left = running["left_s"]
        seconds = None if left is None else left - (time.time() - running["ended"])
        # What lasts longer than was estimated has no time left that anybody knows.
        self._left.set_text("" if seconds is None or seconds < 0.5 else f"about {duration(float(round(seconds)))} left")

    def _build_job(self, progress: dict[str, Any] | None) -> None:
        self.job.clear()
        self.job.classes(remove="running failed stopped done")
        if progress is None:
            return
        self.job.classes(progress["state"])
        what = _DOING.get(progress["do"], progress["do"])
        with self.job:
            if progress["state"] == "running":
                self._bar = h("i", "", "progress", aria_hidden="true")
                h("b", str(what))
                self._now, self._left = h("span"), h("span", "", "soft")
                button("Stop", self.context.stop, "button small right")
            elif progress["state"] == "failed":
                h("span", progress["now"], "sentence", role="alert")
            elif progress["state"] == "stopped":
                h("span", f"{what} was stopped. {progress['now'] or 'What was done before stays.'}")
