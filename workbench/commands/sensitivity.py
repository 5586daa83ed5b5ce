"""`jaxmodel sensitivity`: derivatives of a study's run, and the paper's doubling beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import sweeps
from jaxmodel.errors import SweepError
from jaxmodel.measurements import KINDS
from sensitivity.study import sensitivity_of_study
from workbench import terminal
from workbench.commands.start import in_catalogue, own_effects, start
from workbench.pictures.sensitivities import doubling_beside_gradient, elasticities, over_time
from workbench.pictures.style import png


def sensitivity(path: Path, out: Path, at: Sequence[str], effects: Sequence[str], *, doubling: bool) -> xr.Dataset:
    """Look at a study in one point; write `sensitivity.zarr`, `sensitivity.csv` and pictures to `out`.

    Raises:
        UserError: the study or the point cannot be used.
    """
    point = dict(_assignment(entry) for entry in at)
    with in_catalogue(own_effects(effects)):
        study = moved_to(sweeps.read_study(path), point)
    start(out)
    with terminal.told("sensitivity") as progress:
        progress("compiling and running, half a minute the first time" if doubling else "compiling and running")
        data = sensitivity_of_study(study, doubling)
        progress("tables and pictures")
        _save(data, out / "sensitivity.zarr")
        by_pair(data).to_csv(out / "sensitivity.csv", index=False, float_format="%.12g")
        for name, picture in pictures_of(data):
            (out / f"{name}.png").write_bytes(picture)
    print_sensitivity(data)
    terminal.say(f"sensitivity.zarr, sensitivity.csv and pictures are in {out}.")
    return data


def _assignment(entry: str) -> tuple[str, float]:
    name, _, text = entry.partition("=")
    try:
        return name.strip(), float(text)
    except ValueError:
        raise SweepError(f"--at {entry}: write a name and a number, as in --at ambient_degC=20.") from None


def moved_to(study: sweeps.Study, point: Mapping[str, float], **changes: Any) -> sweeps.Study:
    """Return a study whose own point, on its axes or beside them, has the given values.

    Raises:
        UserError: a name or value cannot be used.
    """
    vocabulary = KINDS[study.prepared.model.kind]
    inputs = {*vocabulary.required_inputs, *sum(vocabulary.alternatives, ()), *vocabulary.optional_inputs}
    of_inputs = {name: [value] for name, value in point.items() if name in inputs}
    of_model = {name: value for name, value in point.items() if name not in inputs}
    fields = study.model_dump() | {"metrics": study.metrics, "folder": study.folder}
    on_axes = {name: [value] for name, value in point.items() if name in study.axes}
    fields["axes"] = study.axes | on_axes | of_inputs
    fields["parameters"] = study.parameters | {n: v for n, v in of_model.items() if n not in on_axes}
    return sweeps.Study(**(fields | changes))


def _save(data: xr.Dataset, store: Path) -> None:
    # Text of fixed width has no place in the Zarr format yet, text of any length has.
    texts = {name: (v.dims, v.to_numpy().astype(object)) for name, v in data.variables.items() if v.dtype.kind == "U"}
    data.assign(texts).to_zarr(store, mode="w", consolidated=False)


def by_pair(data: xr.Dataset):
    """Return one line for each metric and parameter, as a pandas table."""
    pairs = data.drop_dims(["output", "time_s"], errors="ignore")
    return pairs.to_dataframe(dim_order=["metric", "parameter"]).reset_index()


def pictures_of(data: xr.Dataset) -> Iterator[tuple[str, bytes]]:
    """Yield the elasticities of all metrics, the doubling of each, and each output over time."""
    yield "elasticities", png(elasticities(data))
    if "effect" in data:
        for metric in map(str, data["metric"].to_numpy()):
            if float(np.abs(data["linear_change"].sel(metric=metric)).max()) > 0.0:
                yield f"doubling-{metric}", png(doubling_beside_gradient(data, metric))
    moved = abs(data["output_change"].where(data["doubles"])).max(["parameter", "time_s"])
    for output in map(str, data["output"].to_numpy()):
        if float(moved.sel(output=output)) > 0.0:
            yield f"over-time-{output}", png(over_time(data, output))


def largest_elasticity(data: xr.Dataset, metric: str) -> tuple[str, float]:
    """Return the parameter by which a metric changes most, and the elasticity; ('', nan) where there is none."""
    values = data["elasticity"].sel(metric=metric).to_numpy()
    if not np.isfinite(values).any():
        return "", float("nan")
    place = int(np.nanargmax(np.abs(values)))
    return str(data["parameter"].to_numpy()[place]), float(values[place])


def print_sensitivity(data: xr.Dataset) -> None:
    """Print each metric's value and the three parameters that it depends on most."""
    rows = []
    for metric in map(str, data["metric"].to_numpy()):
        one = data.sel(metric=metric)
        values = one["elasticity"].fillna(0.0).to_numpy()
        strongest = [place for place in np.argsort(-np.abs(values))[:3] if abs(values[place]) > 0.005]
        named = ", ".join(f"{data['parameter'].to_numpy()[place]} {values[place]:+.2f}" for place in strongest)
        rows.append((metric, f"{float(one['metric_value']):.5g}", str(one["metric_unit"].item()), named))
    columns = ("metric", "value", "unit", "largest elasticities: % for 1 % of the parameter")
    terminal.table(data.attrs["title"] or "Sensitivity", columns, rows, right=(1,))
