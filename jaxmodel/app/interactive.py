"""The pictures of sensitivities to be read with a pointer: one HTML page that needs nothing but itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.units import difference_unit, split_unit
from jaxmodel.plots.style import BLUE, LINES, ORANGE, axis_label, column_label

_MOST = 14
_FONT = {"family": "DejaVu Sans, Arial, sans-serif", "size": 13}


def write_interactive(path: Path, figures: Sequence[go.Figure]) -> None:
    """Write figures one below the other into a page; plotly itself is in it, once."""
    parts = [
        figure.update_layout(template="plotly_white", font=_FONT).to_html(full_html=False, include_plotlyjs=number == 0)
        for number, figure in enumerate(figures)
    ]
    head = '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Sensitivity</title></head><body>'
    write_whole(path, f"{head}{''.join(parts)}</body></html>\n")


def local_figures(data: xr.Dataset) -> list[go.Figure]:
    """Return the elasticities as colours, and each reading's change over time, one ribbon for each parameter.

    Args:
        data: as `jaxmodel.sensitivity.local` returns it.
    """
    table = data["elasticity"].transpose("parameter", "metric").dropna("metric", how="all")
    size = abs(table).max("metric").fillna(0.0).to_numpy()
    order = [i for i in np.argsort(-size)[:_MOST] if size[i] > 0.0]
    chosen = table.isel(parameter=order)
    figures = []
    if chosen.size:
        limit = float(np.nanmax(np.abs(chosen.to_numpy())))
        colours = go.Heatmap(
            z=chosen.to_numpy(),
            x=chosen["metric"].to_numpy().tolist(),
            y=chosen["parameter"].to_numpy().tolist(),
            zmin=-limit,
            zmax=limit,
            colorscale=[[0.0, BLUE], [0.5, "#ffffff"], [1.0, ORANGE]],
            hovertemplate="%{y} on %{x}: %{z:.4f}<extra></extra>",
        )
        figure = go.Figure(colours, {"title": "Elasticity: % for 1 % of the parameter"})
        figures.append(figure.update_yaxes(autorange="reversed"))
    return figures + [
        figure for output in map(str, data["output"].to_numpy()) if (figure := _ribbons(data, output)) is not None
    ]


def _ribbons(data: xr.Dataset, output: str) -> go.Figure | None:
    change = 0.01 * data["output_change"].sel(output=output).isel(parameter=np.flatnonzero(data["doubles"].to_numpy()))
    size = abs(change).max("time_s").to_numpy()
    order = [i for i in np.argsort(-size)[:_MOST] if size[i] > 1e-3 * size.max()]
    if not order:
        return None
    quantity, unit = split_unit(output)
    figure = go.Figure()
    for number, i in enumerate(order):
        course = change.isel(parameter=i)
        figure.add_scatter(
            x=change["time_s"].to_numpy(),
            y=course.to_numpy(),
            name=str(course["parameter"].item()),
            fill="tozeroy",
            line={"color": LINES[number % len(LINES)]},
            opacity=0.5,
        )
    figure.update_layout(title=f"{quantity}: change for +1 % of each parameter", hovermode="x unified")
    figure.update_xaxes(title="time [s]")
    return figure.update_yaxes(title=axis_label(f"change of {quantity}", difference_unit(unit)))


def uncertainty_figures(data: xr.Dataset) -> list[go.Figure]:
    """Return each reading with its band of 95 % by the gradient and by sampling.

    Args:
        data: as `jaxmodel.sensitivity.uncertainty` returns it.
    """
    figures = []
    for output in map(str, data["output"].to_numpy()):
        one = data.sel(output=output)
        time = one["time_s"].to_numpy()
        if not float(one["output_sd_gradient"].max()) > 0.0:
            continue
        low, high = (one["output_quantile"].sel(quantile=q).to_numpy() for q in (0.025, 0.975))
        figure = go.Figure()
        figure.add_scatter(x=time, y=low, line={"width": 0, "color": BLUE}, showlegend=False, name="2.5 %")
        figure.add_scatter(x=time, y=high, line={"width": 0, "color": BLUE}, fill="tonexty", name="sampled, 95 %")
        reach = 1.96 * one["output_sd_gradient"].to_numpy()
        for sign in (-1.0, 1.0):
            figure.add_scatter(
                x=time,
                y=one["output_value"].to_numpy() + sign * reach,
                line={"dash": "dash", "color": ORANGE},
                name="by the gradient, 95 %",
                showlegend=sign > 0.0,
            )
        figure.add_scatter(x=time, y=one["output_value"].to_numpy(), line={"color": "black"}, name="the run itself")
        figure.update_layout(hovermode="x unified").update_xaxes(title="time [s]")
        figures.append(figure.update_yaxes(title=column_label(output)))
    return figures


def global_figures(data: xr.Dataset) -> list[go.Figure]:
    """Return the indices of each metric with their intervals.

    Args:
        data: as `jaxmodel.sensitivity.global_indices` returns it.
    """
    names = [name for name in ("first", "total", "mu_star", "dgsm") if name in data]
    figures = []
    for metric in map(str, data["metric"].to_numpy()):
        one = data.sel(metric=metric)
        size = np.nan_to_num(one[names[-1]].to_numpy())
        if not np.any(size > 0.0):
            continue
        order = np.argsort(-size)[:_MOST]
        figure = go.Figure()
        for name, colour in zip(names, (BLUE, ORANGE), strict=False):
            error = {"type": "data", "array": one[f"{name}_error"].to_numpy()[order]}
            factors = one["factor"].to_numpy()[order].tolist()
            figure.add_bar(x=factors, y=one[name].to_numpy()[order], error_y=error, name=name, marker_color=colour)
        figure.update_layout(title=f"{split_unit(metric)[0]}, intervals of 95 %", barmode="group")
        unit = difference_unit(str(one["metric_unit"].item())) if "mu_star" in names else ""
        what = "mean size of the effect" if "mu_star" in names else "share of the variance"
        figures.append(figure.update_yaxes(title=axis_label(what, unit)))
    return figures
