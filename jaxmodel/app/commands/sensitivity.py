"""`jaxmodel sensitivity`: derivatives of a study's run, the paper's doubling beside them, and the other analyses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from jaxmodel import sensitivity as analyses
from jaxmodel import sweeps
from jaxmodel.app import terminal
from jaxmodel.app.commands.start import own_effects, start
from jaxmodel.app.interactive import global_figures, local_figures, uncertainty_figures, write_interactive
from jaxmodel.base.errors import SweepError
from jaxmodel.plots.datasets import save_pictures
from jaxmodel.plots.global_indices import MAIN_INDEX, metrics_that_vary


def sensitivity(
    path: Path, out: Path, at: Sequence[str], effects: Sequence[str], *, doubling: bool, pictures: bool = True
) -> xr.Dataset:
    """Differentiate a study at one point; write `sensitivity.zarr`, `sensitivity.csv` and pictures to `out`.

    Raises:
        UserError: the study or the point cannot be used.
    """
    study = study_at(path, at, effects)
    start(out)
    with terminal.stages("sensitivity") as progress:
        progress("compiling and running, half a minute the first time" if doubling else "compiling and running")
        data = analyses.local(study, doubling=doubling, progress=False)
        progress("tables and pictures")
        analyses.save(data, out)
        if pictures:
            save_pictures(data, out)
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
    """Propagate the uncertainty of parameters through a study's run; write `uncertainty.zarr`, `.csv` and pictures.

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
    study = study_at(path, (), effects)
    sd: dict[str, float] = {}
    estimates: analyses.Estimates | None = None
    for entry in uncertain:
        if entry == "case":
            sd |= analyses.stated_sd(study)
        elif "=" in entry:
            sd |= dict([assignment(entry, "--uncertain")])
        else:
            estimates = analyses.read_estimates(entry)
            sd |= estimates.sd
    if estimates is not None and list(sd) != list(estimates.sd):
        raise SweepError("--uncertain: state either standard deviations or the folder of an identify, not both.")
    values = {} if estimates is None else estimates.values
    study = study.at(values | point_of(at))
    start(out)
    with terminal.stages("uncertainty") as progress:
        progress("compiling and running")
        correlation = None if estimates is None else estimates.correlation
        data = analyses.uncertainty(study, sd, correlation, draws=draws, progress=False)
        progress("tables and pictures")
        analyses.save(data, out)
        if pictures:
            save_pictures(data, out)
            write_interactive(out / "uncertainty.html", uncertainty_figures(data))
    _print_uncertainty(data)
    terminal.say(f"uncertainty.zarr, uncertainty.csv{' and pictures' if pictures else ''} are in {out}.")
    return data


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
    study = study_at(path, at, effects)
    start(out)
    with terminal.counted("global", "lanes") as progress:
        data = analyses.global_indices(study, method, count, of_group, second_order=second_order, progress=progress)
    analyses.save(data, out)
    if pictures:
        save_pictures(data, out)
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
    index = MAIN_INDEX[data.attrs["method"]]
    rows = []
    for metric in metrics_that_vary(data):
        one = data.sel(metric=metric)
        values, error = one[index].to_numpy(), one[f"{index}_error"].to_numpy()
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
    study = study_at(path, at, effects)
    start(out)
    with terminal.counted("elasticity map", "lanes") as progress:
        data = analyses.elasticity_map(study, progress=progress)
    analyses.save(data, out)
    if pictures:
        save_pictures(data, out)
    terminal.say(f"elasticity-map.zarr{' and pictures' if pictures else ''} are in {out}.")
    return data


def _print_uncertainty(data: xr.Dataset) -> None:
    rows = []
    for metric in map(str, data["metric"].to_numpy()):
        one = data.sel(metric=metric)
        if not float(one["metric_sd_gradient"]) > 0.0:
            continue
        share = one["metric_share"].fillna(0.0).to_numpy()
        most = int(np.argmax(np.abs(share))) if share.size else 0
        low, high = (float(one["metric_quantile"].sel(quantile=q)) for q in (0.025, 0.975))
        verdict = "yes" if bool(one["metric_agrees"]) else "no, not linear: trust the sampling"
        numbers = (f"{float(one[name]):.4g}" for name in ("metric_value", "metric_sd_gradient", "metric_sd_sampled"))
        of = f"{data['parameter'].to_numpy()[most]} {share[most]:.0%}" if share.any() else ""
        rows.append((metric, *numbers, f"{low:.4g} to {high:.4g}", str(one["metric_unit"].item()), of, verdict))
    columns = ("metric", "value", "sd, gradient", "sd, sampled", "95 %, sampled", "unit", "largest share", "agree")
    terminal.table(data.attrs["title"] or "Uncertainty", columns, rows, right=(1, 2, 3))
    left_out = data.attrs["out_of_bounds"] + data.attrs["failed"]
    if left_out:
        terminal.say(
            f"Of {data.attrs['draws']} draws {data.attrs['out_of_bounds']} were outside of a parameter's bounds and "
            f"{data.attrs['failed']} runs failed: they are left out."
        )


def study_at(path: Path, at: Sequence[str], effects: Sequence[str]) -> sweeps.Study:
    """Return the study of a file at a point, given as `NAME=VALUE`."""
    return sweeps.read_study(path, own_effects=own_effects(effects)).at(point_of(at))


def point_of(at: Sequence[str]) -> dict[str, float]:
    """Return the point that `NAME=VALUE` entries state."""
    return dict(assignment(entry, "--at") for entry in at)


def assignment(entry: str, option: str) -> tuple[str, float]:
    """Return the name and the number of NAME=VALUE."""
    name, _, text = entry.partition("=")
    try:
        return name.strip(), float(text)
    except ValueError:
        raise SweepError(f"{option} {entry}: write a name and a number, as in {option} ambient_degC=20.") from None


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
