"""`jaxmodel sensitivity`: derivatives of a study's run, and the paper's doubling beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sweeps
from jaxmodel.cases import read_case
from jaxmodel.errors import SweepError
from jaxmodel.measurements import KINDS
from plots import global_indices as global_pictures
from plots.sensitivities import (
    doubling_beside_gradient,
    elasticities,
    elasticity_maps,
    over_time,
)
from plots.style import png
from plots.uncertainty import bands_over_time, metric_intervals
from sensitivity.elasticity_map import elasticity_map
from sensitivity.global_study import global_of_study
from sensitivity.study import sensitivity_of_study, uncertainty_of_study
from sweeps.prepare import INITIAL, SCALE
from workbench import terminal
from workbench.commands.start import in_catalogue, own_effects, start
from workbench.interactive import global_figures, local_figures, uncertainty_figures, write_interactive


def sensitivity(
    path: Path, out: Path, at: Sequence[str], effects: Sequence[str], *, doubling: bool, pictures: bool = True
) -> xr.Dataset:
    """Look at a study in one point; write `sensitivity.zarr`, `sensitivity.csv` and pictures to `out`.

    Raises:
        UserError: the study or the point cannot be used.
    """
    study = study_at(path, dict(assignment(entry, "--at") for entry in at), effects)
    start(out)
    with terminal.told("sensitivity") as progress:
        progress("compiling and running, half a minute the first time" if doubling else "compiling and running")
        data = sensitivity_of_study(study, doubling)
        progress("tables and pictures")
        save(data, out / "sensitivity.zarr")
        by_pair(data).to_csv(out / "sensitivity.csv", index=False, float_format="%.12g")
        for name, picture in pictures_of(data) if pictures else ():
            (out / f"{name}.png").write_bytes(picture)
        if pictures:
            write_interactive(out / "sensitivity.html", local_figures(data))
    print_sensitivity(data)
    terminal.say(f"Differentiated in {data.attrs['mode']} mode: {data.attrs['passes']} passes.")
    terminal.say(f"sensitivity.zarr, sensitivity.csv{' and pictures' if pictures else ''} are in {out}.")
    return data


def uncertainty(
    path: Path,
    out: Path,
    at: Sequence[str],
    effects: Sequence[str],
    uncertain: Sequence[str],
    draws: int,
    *,
    pictures: bool = True,
) -> xr.Dataset:
    """Push what is not known of parameters through a study's run; write `uncertainty.zarr`, `.csv` and pictures.

    Args:
        path: of the study.
        out: folder for the results.
        at: the point, as `NAME=VALUE`.
        effects: the user's own.
        uncertain: `NAME=SD`, "case" for what the study's case states, or the folder of an `identify`.
        draws: runs to sample.
        pictures: whether to draw.

    Raises:
        UserError: the study, the point or what is uncertain cannot be used.
    """
    point: dict[str, float] = {}
    sd: dict[str, float] = {}
    correlation, correlated = None, []
    for entry in uncertain:
        if entry == "case":
            sd |= _stated_sd(study_at(path, {}, effects))
        elif "=" in entry:
            sd |= dict([assignment(entry, "--uncertain")])
        else:
            estimates, sd_of_fit, correlation = _estimates(Path(entry))
            point |= estimates
            sd |= sd_of_fit
            correlated = list(sd_of_fit)
    if correlation is not None and list(sd) != correlated:
        raise SweepError("--uncertain: state either standard deviations or the folder of an identify, not both.")
    study = study_at(path, point | dict(assignment(entry, "--at") for entry in at), effects)
    start(out)
    with terminal.told("uncertainty") as progress:
        progress("compiling and running")
        data = uncertainty_of_study(study, sd, correlation, draws)
        progress("tables and pictures")
        save(data, out / "uncertainty.zarr")
        metrics = data.drop_dims(["output", "time_s", "parameter"], errors="ignore")
        table = metrics.drop_dims("quantile").to_dataframe()
        for q in data["quantile"].to_numpy():
            table[f"quantile_{q:g}"] = data["metric_quantile"].sel(quantile=q).to_numpy()
        table.to_csv(out / "uncertainty.csv", float_format="%.12g")
        if pictures:
            _draw_uncertainty(data, out)
    _print_uncertainty(data)
    terminal.say(f"uncertainty.zarr, uncertainty.csv{' and pictures' if pictures else ''} are in {out}.")
    return data


def _draw_uncertainty(data: xr.Dataset, out: Path) -> None:
    (out / "uncertainty.png").write_bytes(png(metric_intervals(data)))
    for output in map(str, data["output"].to_numpy()):
        if float(data["output_sd_gradient"].sel(output=output).max()) > 0.0:
            (out / f"uncertainty-{output}.png").write_bytes(png(bands_over_time(data, output)))
    write_interactive(out / "uncertainty.html", uncertainty_figures(data))


def global_indices(
    path: Path,
    out: Path,
    at: Sequence[str],
    effects: Sequence[str],
    *,
    method: str,
    count: int,
    groups: Sequence[str],
    second_order: bool,
    pictures: bool = True,
) -> xr.Dataset:
    """Find how a study's metrics depend on its ranges as a whole; write `global.zarr`, `global.csv` and pictures.

    Raises:
        UserError: the study or the point cannot be used, too little varies, or a group is wrong.
    """
    of_group = dict(_group(entry) for entry in groups)
    study = study_at(path, dict(assignment(entry, "--at") for entry in at), effects)
    start(out)
    with terminal.counted("global", "lanes") as progress:
        data = global_of_study(study, method, count, of_group, second_order=second_order, progress=progress)
    save(data, out / "global.zarr")
    main = data.drop_dims(["blocks", "other", "parameter"], errors="ignore")
    main.to_dataframe(dim_order=["metric", "factor"]).to_csv(out / "global.csv", float_format="%.8g")
    if "second" in data:
        pairs = data[["second", "second_error"]].to_dataframe(dim_order=["metric", "factor", "other"])
        pairs.dropna().to_csv(out / "global-pairs.csv", float_format="%.8g")
    for name, picture in global_pictures.pictures_of(data) if pictures else ():
        (out / f"{name}.png").write_bytes(png(picture))
    if pictures:
        write_interactive(out / "global.html", global_figures(data))
    _print_global(data)
    terminal.say(f"global.zarr, global.csv{' and pictures' if pictures else ''} are in {out}.")
    return data


def _group(entry: str) -> tuple[str, list[str]]:
    name, equals, members = entry.partition("=")
    if not equals or not name or not members:
        raise SweepError(f"--group {entry}: write a name and its members, as in --group ageing=cycles,storage_months.")
    return name.strip(), [member.strip() for member in members.split(",")]


def _print_global(data: xr.Dataset) -> None:
    index = {"sobol": "total", "morris": "mu_star", "dgsm": "dgsm"}[data.attrs["method"]]
    rows = []
    for metric in map(str, data["metric"].to_numpy()):
        one = data.sel(metric=metric)
        values, error = one[index].to_numpy(), one[f"{index}_error"].to_numpy()
        if not np.any(np.nan_to_num(values) > 0.0):
            continue
        named = [f"{one['factor'].to_numpy()[i]} {values[i]:.3g} ± {error[i]:.1g}" for i in np.argsort(-values)[:4]]
        rows.append((metric, str(int(one["blocks_used"])), ", ".join(named)))
    title = f"{data.attrs['title'] or 'Global'}: {data.attrs['method']}, {data.attrs['runs']:,} runs"
    terminal.table(title, ("metric", "blocks", f"largest {index} with intervals of 95 %"), rows, right=(1,))
    if data.attrs["failed"]:
        terminal.say(f"{data.attrs['failed']:,} of {data.attrs['runs']:,} runs failed: their blocks are left out.")


def maps(path: Path, out: Path, at: Sequence[str], effects: Sequence[str], *, pictures: bool = True) -> xr.Dataset:
    """Differentiate at every combination of a study's axes; write `elasticity-map.zarr` and a picture for each metric.

    Raises:
        UserError: the study or the point cannot be used, or it has fewer than two axes.
    """
    study = study_at(path, dict(assignment(entry, "--at") for entry in at), effects)
    if len(study.axes) < 2:
        raise SweepError("--map: two axes make a map; add them to the study's [axes].")
    start(out)
    with terminal.counted("elasticity map", "lanes") as progress:
        data = elasticity_map(study, progress=progress)
    save(data, out / "elasticity-map.zarr")
    for metric in map(str, data["metric"].to_numpy()):
        if pictures and bool(np.any(np.isfinite(data["elasticity"].sel(metric=metric)))):
            (out / f"elasticity-map-{metric}.png").write_bytes(png(elasticity_maps(data, metric)))
    terminal.say(f"elasticity-map.zarr{' and pictures' if pictures else ''} are in {out}.")
    return data


def study_at(path: Path, point: Mapping[str, float], effects: Sequence[str]) -> sweeps.Study:
    """Return the study of a file, moved to a point."""
    with in_catalogue(own_effects(effects)):
        return moved_to(sweeps.read_study(path), point)


def _stated_sd(study: sweeps.Study) -> dict[str, float]:
    """Return the standard deviations that the study's case states of parameters."""
    if study.case is None:
        raise SweepError("--uncertain case: the study names no case; say NAME=SD.")
    stated = read_case(study.folder / study.case).parameters
    found = {name: known.sd for name, known in stated.items() if known.sd}
    if not found:
        raise SweepError(f"--uncertain case: {study.case} states no sd of a parameter; say NAME=SD.")
    return found


def _estimates(folder: Path) -> tuple[dict[str, float], dict[str, float], np.ndarray]:
    """Return the estimates that `jaxmodel identify` wrote, their sd and their correlation.

    What belongs to one run of the case (an initial state of charge) is left out: that averages over it.
    """
    if not (folder / "covariance.csv").exists():
        raise SweepError(f"--uncertain {folder}: write NAME=SD, case, or a folder in which identify wrote its results.")
    covariance = pd.read_csv(folder / "covariance.csv", index_col=0)
    names = [name for name in covariance.index if "[" not in name]
    matrix = covariance.loc[names, names].to_numpy()
    sd = np.sqrt(np.diag(matrix))
    values = pd.read_csv(folder / "identifiability.csv", index_col="parameter").loc[names, "value"]
    return (
        dict(zip(names, map(float, values), strict=True)),
        dict(zip(names, map(float, sd), strict=True)),
        matrix / np.outer(sd, sd),
    )


def _print_uncertainty(data: xr.Dataset) -> None:
    rows = []
    for metric in map(str, data["metric"].to_numpy()):
        one = data.sel(metric=metric)
        if not float(one["metric_sd_gradient"]) > 0.0:
            continue
        share = one["metric_share"].fillna(0.0).to_numpy()
        most = int(np.argmax(np.abs(share))) if share.size else 0
        low, high = (float(one["metric_quantile"].sel(quantile=q)) for q in (0.025, 0.975))
        verdict = "yes" if bool(one["metric_agrees"]) else "no, not straight: the sampling is right"
        numbers = (f"{float(one[name]):.4g}" for name in ("metric_value", "metric_sd_gradient", "metric_sd_sampled"))
        of = f"{data['parameter'].to_numpy()[most]} {share[most]:.0%}" if share.any() else ""
        rows.append((metric, *numbers, f"{low:.4g} to {high:.4g}", str(one["metric_unit"].item()), of, verdict))
    columns = ("metric", "value", "sd, gradient", "sd, sampled", "95 %, sampled", "unit", "most of it from", "agree")
    terminal.table(data.attrs["title"] or "Uncertainty", columns, rows, right=(1, 2, 3))
    left_out = data.attrs["out_of_bounds"] + data.attrs["failed"]
    if left_out:
        terminal.say(
            f"Of {data.attrs['draws']} draws {data.attrs['out_of_bounds']} were outside of a parameter's bounds and "
            f"{data.attrs['failed']} runs failed: they are left out."
        )


def assignment(entry: str, option: str) -> tuple[str, float]:
    """Return the name and the number of NAME=VALUE."""
    name, _, text = entry.partition("=")
    try:
        return name.strip(), float(text)
    except ValueError:
        raise SweepError(f"{option} {entry}: write a name and a number, as in {option} ambient_degC=20.") from None


def moved_to(study: sweeps.Study, point: Mapping[str, float], **changes: Any) -> sweeps.Study:
    """Return a study whose own point has the given values, wherever it varies these names or does not.

    Raises:
        UserError: a name or value cannot be used.
    """
    vocabulary = KINDS[study.prepared.model.kind]
    inputs = {*vocabulary.required_inputs, *sum(vocabulary.alternatives, ()), *vocabulary.optional_inputs}
    for name in point:
        if name.startswith((SCALE, INITIAL)):
            raise SweepError(f"--at {name}: a point has parameters and inputs; say the input or parameter itself.")
    fields = study.model_dump() | {"metrics": study.metrics, "folder": study.folder}
    fixed = {name: [value] for name, value in point.items() if name in inputs or name in study.varied}
    fields["axes"] = study.axes | fixed
    fields["parameters"] = study.parameters | {name: value for name, value in point.items() if name not in inputs}
    if study.sample is not None:
        ranges = {name: span for name, span in study.sample.model_dump()["ranges"].items() if name not in point}
        fields["sample"] = study.sample.model_dump() | {"ranges": ranges} if ranges else None
    return sweeps.Study(**(fields | changes))


def save(data: xr.Dataset, store: Path) -> None:
    """Write a data set as a Zarr store."""
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
