"""Beside the path: a sweep with its live map, sensitivities at a point of it, and the next experiment."""

from __future__ import annotations

from typing import Any

from nicegui.events import GenericEventArguments

from jaxmodel.app.browser.chart import Figure
from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.files import GRID, SENSITIVITY
from jaxmodel.app.browser.html import TextElement, button, duration, field, h, select

_COUNT = 40  # values of an axis at first
_NEEDS = "Compare with the model first: a sweep needs a calibrated model."


def sweep(context: Context) -> Map | None:
    """Show the form of a sweep, what it would take, and its map, which is returned: it grows while the form stays."""
    h("h2", "Sweep")
    if context.stage != "compared":
        h("p", _NEEDS, "lead")
        return None
    view = context.view
    choices = {one["name"]: one for one in view["sweepable"]}
    form = context.form.setdefault("sweep", _first(view, list(choices.values())))
    h("p", "The present model, driven by the inputs of one run, over two of its parameters.", "lead")
    with h("div", "", "row"):
        select("Inputs of the run", {run["name"]: run["name"] for run in view["case"]["runs"]}, form["run"],
               lambda value: form.__setitem__("run", value))  # fmt: skip
    for axis in ("x", "y"):
        _axis(context, form, axis, choices)
    state = (view.get("sweep") or {}).get("state")
    running = context.is_busy and (context.session.progress or {}).get("do") == "sweep"
    with h("div", "", "actions"):
        if running:
            button("Stop", context.stop, "button")
        else:
            asked = {"run": form["run"], "axes": form["axes"]}
            button("Estimate", lambda: _ask(context, "forecast", form), "button", disabled=context.is_busy)
            button("Start", lambda: _ask(context, "sweep", form, resume=False), "button primary",
                   disabled=context.is_busy)  # fmt: skip
            if state == "stopped" and _same(view["sweep"], asked):
                button("Resume", lambda: _ask(context, "sweep", form, resume=True), "button", disabled=context.is_busy)
    planned = (view.get("sweep") or {}).get("forecast")
    if planned:
        h(
            "p",
            f"{planned['lanes']:,} combinations at {planned['lanes_per_s']:,.0f} a second: about "
            f"{duration(planned['run_s'])}, after {duration(planned['compile_s'])} of compiling.",
            "sentence",
            role="status",
        )
    return Map(context)


def _first(view: dict[str, Any], choices: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what the form says at first: the ambient temperature and the first parameter."""
    asked = view.get("sweep")
    if asked:
        return {"run": asked["run"], "axes": {name: dict(axis) for name, axis in asked["axes"].items()}, "metric": ""}
    picked = [choices[0], next((one for one in choices if one["name"] == "capacity_Ah"), choices[-1])]
    axes = {one["name"]: {"low": one["low"], "high": one["high"], "count": one["count"] or _COUNT} for one in picked}
    return {"run": view["case"]["runs"][0]["name"], "axes": axes, "metric": ""}


def _same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return all(one[key] == other[key] for key in ("run", "axes"))


def _ask(context: Context, job: str, form: dict[str, Any], **further: Any) -> None:
    context.do(job, run=form["run"], axes=form["axes"], **further)


def _axis(context: Context, form: dict[str, Any], place: str, choices: dict[str, dict[str, Any]]) -> None:
    """Show the fields of one axis."""
    names = list(form["axes"])
    name = names[0 if place == "x" else 1]
    other = names[1 if place == "x" else 0]
    axis = form["axes"][name]
    words = {one: f"{one}: {own['meaning']}" for one, own in choices.items() if one != other}

    def chosen(value: str) -> None:
        own = choices[value]
        count = own["count"] or (_COUNT if choices[name]["count"] else axis["count"])
        new = {"low": own["low"], "high": own["high"], "count": count}
        pairs = [(value, new), (other, form["axes"][other])]
        form["axes"] = dict(pairs if place == "x" else pairs[::-1])
        context.go("")

    def put(key: str, text: str) -> None:
        try:
            axis[key] = int(text) if key == "count" else float(text.replace(",", "."))
        except ValueError:
            return

    unit = choices[name]["unit"]
    of_unit = f" [{unit}]" if unit else ""
    with h("div", "", "row axis"):
        select("Across" if place == "x" else "Up", words, name, chosen)
        field(f"from{of_unit}", f"{axis['low']:g}", lambda v: put("low", v), inputmode="decimal")
        field(f"to{of_unit}", f"{axis['high']:g}", lambda v: put("high", v), inputmode="decimal")
        field("values", str(axis["count"]), lambda v: put("count", v), inputmode="numeric")


class Map:
    """The map of one metric of a sweep over both axes; a click on it asks for the sensitivities at that point."""

    def __init__(self, context: Context) -> None:
        """Draw what has landed so far."""
        self._context = context
        self._place = h("div", "", "contents")
        self._words: TextElement | None = None
        self._chart: Figure | None = None
        self._shown = ""
        self.update()

    def update(self) -> None:
        """Draw what has landed since; what a person is about to press stays where it is."""
        grid = self._context.session.content(GRID)
        if not grid or not self._context.view.get("sweep"):
            return
        metric = self._metric(grid)
        self._shown = metric["name"]
        if self._words is None or self._chart is None:
            self._words, self._chart = self._build(grid, metric)
        else:
            self._chart.show(_heat(grid, metric))
        self._words.set_text(_done(grid))

    def _metric(self, grid: dict[str, Any]) -> dict[str, Any]:
        wanted = self._context.form["sweep"]["metric"] or self._shown or grid["liveliest"]
        return next((one for one in grid["metrics"] if one["name"] == wanted), grid["metrics"][0])

    def _build(self, grid: dict[str, Any], metric: dict[str, Any]) -> tuple[TextElement, Figure]:
        across, up = (axis["name"] for axis in grid["axes"][:2])

        def show(value: str) -> None:
            self._context.form["sweep"]["metric"] = value
            self.update()

        with self._place:
            with h("div", "", "row"):
                select("Shown", {one["name"]: one["title"] for one in grid["metrics"]}, metric["name"], show)
            words = h("p", "", "soft")
            chart = Figure(_heat(grid, metric), "Map of the chosen metric over both axes")
            chart.on("pick", lambda event: _point(self._context, event, across, up))
        return words, chart


def _done(grid: dict[str, Any]) -> str:
    thinned = f" The map draws every {' x '.join(map(str, grid['every']))} of them." if max(grid["every"]) > 1 else ""
    return f"{grid['done']:,} of {grid['of']:,} combinations are done.{thinned} Click a place for its sensitivities."


def _heat(grid: dict[str, Any], metric: dict[str, Any]) -> dict[str, Any]:
    """Return the figure of one metric over both axes."""
    across, up = grid["axes"][0], grid["axes"][1]
    heat = {
        "type": "heatmap",
        "x": across["values"],
        "y": up["values"],
        "z": [list(row) for row in zip(*metric["values"], strict=True)],  # the first axis goes across
        "colorscale": "Cividis",
        "colorbar": {
            "thickness": 10,
            "outlinewidth": 0,
            "title": {"text": metric["title"], "side": "right"},
            "tickformat": ".3~g",
        },
        "hovertemplate": f"%{{x:.4~g}}, %{{y:.4~g}}: %{{z:.4~g}} {metric['unit']}<extra></extra>",
    }
    layout = {
        "height": 380,
        "xaxis": {"title": {"text": across["title"]}, "showgrid": False},
        "yaxis": {"title": {"text": up["title"]}, "showgrid": False},
    }
    return {"data": [heat], "layout": layout}


def _point(context: Context, event: GenericEventArguments, across: str, up: str) -> None:
    point = {across: float(event.args["x"]), up: float(event.args["y"])}
    context.do("sensitivity", run=context.form["sweep"]["run"], point=point)
    context.go("sensitivity")


def sensitivity(context: Context) -> None:
    """Show by how much each parameter changes each metric, and each reading over time."""
    h("h2", "Sensitivity")
    if context.stage != "compared":
        h("p", _NEEDS, "lead")
        return
    found = context.session.content(SENSITIVITY)
    if not found or not context.view.get("sensitivity"):
        h("p", "Click a place in the map of a sweep, or begin here.", "lead")
        run = context.view["case"]["runs"][0]["name"]
        first = context.view["sweepable"][0]
        value = 20.0 if first["name"] == "ambient_degC" else 0.5 * (first["low"] + first["high"])
        words = f"With the inputs of {run}, {first['meaning']} {value:g} {first['unit']}".rstrip()
        button(words, lambda: context.do("sensitivity", run=run, point={first["name"]: value}), "button primary",
               disabled=context.is_busy)  # fmt: skip
        return
    h("p", f"The present model on the inputs of {found['run']}, at {found['at']}.", "lead")
    form = context.form.setdefault("sensitivity", {"metric": "", "output": ""})

    def put(key: str, value: str) -> None:
        form[key] = value
        context.go("")

    metrics = {one["name"]: one for one in found["metrics"]}
    if metrics:
        chosen = metrics.get(form["metric"]) or next(iter(metrics.values()))
        words = {name: one["title"] for name, one in metrics.items()}
        with h("div", "", "row"):
            select("Result", words, chosen["name"], lambda value: put("metric", value))
        _tornado(chosen)
    outputs = {one["name"]: one for one in found["outputs"]}
    if outputs:
        chosen = outputs.get(form["output"]) or next(iter(outputs.values()))
        words = {name: one["quantity"] for name, one in outputs.items()}
        with h("div", "", "row"):
            select("Reading over time", words, chosen["name"], lambda value: put("output", value))
        _courses(found["time_s"], chosen)


def _tornado(metric: dict[str, Any]) -> None:
    bars = metric["bars"][::-1]
    bar = {
        "type": "bar",
        "orientation": "h",
        "x": [one["value"] for one in bars],
        "y": [one["name"] for one in bars],
        "marker": {"color": ["var(--high)" if one["value"] > 0 else "var(--low)" for one in bars]},
        "hovertemplate": "%{y}: %{x:.3~g} % for 1 %<extra></extra>",
    }
    layout = {
        "height": 90 + 24 * len(bars),
        "margin": {"l": 190, "r": 16, "t": 8, "b": 44},
        "xaxis": {"title": {"text": "change of the result for 1 % of the parameter [%]"}, "zeroline": True},
        "yaxis": {"showgrid": False},
        "bargap": 0.35,
    }
    Figure({"data": [bar], "layout": layout}, f"Elasticity of {metric['name']} by parameter")


def _courses(time_s: list[float], output: dict[str, Any]) -> None:
    hues = ("--line-1", "--line-2", "--line-3", "--line-4", "--line-5", "--line-6")
    dashes = ("solid", "dash", "dot", "dashdot", "solid", "dash")
    lines = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": one["name"],
            "x": time_s,
            "y": one["values"],
            "line": {"color": f"var({hue})", "width": 1.8, "dash": dash},
        }
        for one, hue, dash in zip(output["lines"], hues, dashes, strict=False)
    ]
    unit = output["difference"]
    layout = {
        "height": 320,
        "margin": {"l": 70, "r": 16, "t": 8, "b": 44},
        "xaxis": {"title": {"text": "time [s]"}},
        "yaxis": {"title": {"text": f"change for +1 %{f' [{unit}]' if unit else ''}"}},
        "legend": {"orientation": "h", "y": 1.12, "x": 0},
        "hovermode": "x unified",
    }
    Figure({"data": lines, "layout": layout}, f"Change of {output['name']} over time for one percent of each parameter")


def next_experiment(context: Context) -> None:
    """Show which experiment decides best between the models that remain."""
    h("h2", "Next experiment")
    if context.stage != "compared":
        h("p", _NEEDS, "lead")
        return
    h(
        "p",
        "Which run would best tell the present model from its best rivals, on the loads your bench has shown?",
        "lead",
    )
    button("Propose experiments", lambda: context.do("next"), "button primary", disabled=context.is_busy)
    found = context.view.get("proposals")
    if not found:
        return
    if found["rivals"]:
        h("p", f"To decide between {'; '.join(found['rivals'])}:")
    if not found["found"]:
        h("p", "The models that remain do not differ: no experiment is needed.")
    with h("table"):
        with h("thead"), h("tr"):
            h("th", "experiment")
            h("th", "separation [sd]", "n")
            h("th", "runs for 5 sd", "n")
        with h("tbody"):
            for one in found["found"]:
                with h("tr"):
                    h("td", one["what"])
                    h("td", f"{one['sigma']:.3g}", "n")
                    h("td", f"{one['repeats']:,}" if one["repeats"] <= 99 else "more than 99", "n")
    h("p", "The separation is how far apart the models would be, in standard deviations, after refitting both.", "soft")
