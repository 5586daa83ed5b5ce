"""Charts as elements of a page: plotly is this project's own, served from here, and drawn by two small components."""

from __future__ import annotations

from typing import Any

from nicegui.element import Element


class Figure(Element, component="static/figure.js"):
    """A figure that the server describes; a click on it is the event "pick" with its place."""

    def __init__(self, figure: dict[str, Any], label: str) -> None:
        """Draw a figure of plotly; colours may be `var(--name)` of the theme, and `label` says what it shows."""
        super().__init__()
        self._props["figure"] = figure
        self._props["label"] = label

    def show(self, figure: dict[str, Any]) -> None:
        """Draw another figure in its place."""
        self._props["figure"] = figure
        self.update()


class Traces(Element, component="static/traces.js"):
    """The runs over time; it fetches what it draws from the session's address by itself."""

    def __init__(self, source: str) -> None:
        """Draw the runs of a session at an address."""
        super().__init__()
        self._props.update({"src": source, "version": -1, "runs": [], "view": {}})

    def show(self, view: dict[str, Any]) -> None:
        """Draw the runs as a session's view has them now."""
        case = view["case"]
        units = {"time": case["time"], "channels": case["channels"], "inputs": case["inputs"]}
        shown = units | {"residuals": view.get("residuals", {})}
        self._props.update({"version": view["version"], "runs": case["runs"], "view": shown})
        self.update()
