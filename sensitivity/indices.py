"""Global sensitivity through SALib: Sobol indices, Morris screening and derivative-based measures, over whole ranges.

A design is points of the unit cube in blocks, one block for each base point: what the analysis of a block needs stands
together, so that a block of which one run failed is left out as a whole, and so that a part of the blocks is a smaller
design. The numbers come from a sweep (`jaxmodel.sensitivity.global_study`) or from any function.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import warnings
from collections.abc import Generator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray

from jaxmodel.base.errors import SweepError

# SALib is imported where it is used: it brings a plotting package, which this package must not load.
METHODS = ("sobol", "morris", "dgsm")
CONFIDENCE = 0.95
_RESAMPLES = 200
_FEWEST = 16  # blocks of the smallest part whose indices are drawn as convergence
_LEVELS = 4
_STEP = 1e-3  # of a range, for derivatives
# What SALib calls the indices.
_COLUMNS = {
    "sobol": {"first": "S1", "first_error": "S1_conf", "total": "ST", "total_error": "ST_conf"},
    "morris": {"mu": "mu", "mu_star": "mu_star", "mu_star_error": "mu_star_conf", "sigma": "sigma"},
    "dgsm": {"dgsm": "dgsm", "dgsm_error": "dgsm_conf"},
}
_PAIRS = {"second": "S2", "second_error": "S2_conf"}


@dataclasses.dataclass(frozen=True)
class Design:
    """Which points a method asks for.

    Attributes:
        method: "sobol", "morris" or "dgsm".
        names: of the parameters, the columns of the points.
        groups: for each parameter the group it moves with; its own name where it moves alone.
        points: (blocks * rows, parameters), in the unit cube.
        rows: of a block.
        second_order: True where the blocks of "sobol" have the rows for indices of pairs.
    """

    method: str
    names: tuple[str, ...]
    groups: tuple[str, ...]
    points: np.ndarray
    rows: int
    second_order: bool

    @property
    def factors(self) -> tuple[str, ...]:
        """Return what indices are of: the groups, in order."""
        return tuple(dict.fromkeys(self.groups))

    @property
    def problem(self) -> dict[str, Any]:
        """Return the design as SALib names it."""
        return _problem(self.names, self.groups)


def make_design(
    method: str,
    names: Sequence[str],
    count: int,
    groups: Mapping[str, Sequence[str]] | None = None,
    *,
    second_order: bool = True,
    seed: int = 0,
) -> Design:
    """Return the points of a method.

    Args:
        method: "sobol" (Saltelli's design), "morris" (trajectories on four levels) or "dgsm" (a point and a small step
            along each parameter).
        names: of the parameters.
        count: of base points or trajectories; of "sobol" rounded up to a power of two.
        groups: parameters that move together, by the group's name; not for "dgsm".
        second_order: of "sobol", whether pairs are asked for, at twice the runs.
        seed: of the points.

    Raises:
        SweepError: the method, a group or the count cannot be used.
    """
    if method not in METHODS:
        raise SweepError(f"method {method}: use one of {', '.join(METHODS)}.")
    if count < 2:
        raise SweepError(f"count {count}: {method} needs at least two base points; a few hundred are usual.")
    of_group = _groups(names, groups or {})
    if method == "dgsm" and groups:
        raise SweepError("groups: derivatives are of one parameter each; use sobol or morris for groups.")
    if len(set(of_group)) < 2:
        raise SweepError("ranges: indices need two parameters or groups at least that vary; add ranges to the study.")
    problem = _problem(names, of_group)
    with _quiet():
        if method == "sobol":
            from SALib.sample import sobol

            count = 2 ** int(np.ceil(np.log2(count)))
            points = sobol.sample(problem, count, calc_second_order=second_order, seed=seed)
        elif method == "morris":
            from SALib.sample import morris

            points = morris.sample(problem, count, num_levels=_LEVELS, seed=seed)
        else:
            from SALib.sample import finite_diff

            points = finite_diff.sample(problem, count, delta=_STEP, seed=seed)
    return Design(method, tuple(names), of_group, points, len(points) // count, second_order and method == "sobol")


def _groups(names: Sequence[str], groups: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    found = {name: name for name in names}
    for group, members in groups.items():
        for member in members:
            if member not in found:
                raise SweepError(f"group {group}: '{member}' does not vary; the study varies {', '.join(names)}.")
            if found[member] != member:
                raise SweepError(
                    f"group {group}: '{member}' is in group {found[member]} already; remove it from one of the two."
                )
            found[member] = group
    return tuple(found.values())


def _problem(names: Sequence[str], groups: Sequence[str]) -> dict[str, Any]:
    problem: dict[str, Any] = {"num_vars": len(names), "names": list(names), "bounds": [[0.0, 1.0]] * len(names)}
    return problem if tuple(groups) == tuple(names) else problem | {"groups": list(groups)}


@contextlib.contextmanager
def _quiet() -> Generator[None, None, None]:
    """Silence SALib's warnings of what is checked here, constant results, and leave NumPy's own generator as it was."""
    state = np.random.get_state()  # noqa: NPY002
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    np.random.set_state(state)  # noqa: NPY002


def analyse(design: Design, results: Mapping[str, np.ndarray], *, seed: int = 0) -> xarray.Dataset:
    """Return the indices of some numbers at the design's points, with bootstrap intervals.

    Args:
        design: from `make_design`.
        results: for each metric its (points,) values; NaN where a run failed, whose block is left out.
        seed: of the resampling.

    Returns:
        A data set over metric and factor; half-widths of intervals of 95 % end in `_error`:
        of "sobol" first, total (metric, factor), second (metric, factor, other), and first_converging, total_converging
        (metric, blocks, factor), from the first so many blocks;
        of "morris" mu, mu_star, sigma: effects over the whole range; mu_star_converging;
        of "dgsm" dgsm, an upper bound of the total index; dgsm_converging;
        blocks_used (metric); a metric that does not vary has NaN indices.
        Attributes: method, blocks, runs, confidence, failed (runs).
    """
    blocks = len(design.points) // design.rows
    parts, failed = [], np.zeros(len(design.points), dtype=bool)
    for metric, values in results.items():
        by_block = np.asarray(values, dtype=float).reshape(blocks, design.rows)
        whole = np.all(np.isfinite(by_block), axis=1)
        failed |= ~np.isfinite(by_block).reshape(-1)
        points = design.points.reshape(blocks, design.rows, -1)[whole]
        found = _converged(design, points, by_block[whole], seed)
        part = xarray.Dataset(found).assign(blocks_used=int(whole.sum()))
        parts.append(part.expand_dims(metric=[metric]))
    data = xarray.concat(parts, "metric", join="outer")
    coordinates = {"factor": list(design.factors)}
    if "other" in data.dims:
        coordinates["other"] = list(design.factors)
    return data.assign_coords(coordinates).assign_attrs(
        method=design.method,
        blocks=blocks,
        runs=len(design.points),
        failed=int(failed.sum()),
        confidence=CONFIDENCE,
        groups=str(
            {g: [n for n, of in zip(design.names, design.groups, strict=True) if of == g] for g in design.factors}
        ),
    )


def _converged(design: Design, points: np.ndarray, values: np.ndarray, seed: int) -> dict[str, Any]:
    """Return the indices of all blocks, and the main ones of the first 16, 32, ... blocks."""
    whole = _indices(design, points, values, seed)
    sizes = [n for n in 2 ** np.arange(4, 31) if _FEWEST <= n < len(values)]
    steps = {int(n): _indices(design, points[:n], values[:n], seed) for n in sizes} | {len(values): whole}
    shown = [name for name in ("first", "total", "mu_star", "dgsm") if name in whole]
    converging: dict[str, Any] = {}
    for name in shown:
        for kind in (name, f"{name}_error"):
            rows = np.array([steps[n][kind].values for n in steps])
            label = kind.replace(name, f"{name}_converging")
            converging[label] = xarray.DataArray(rows, {"blocks": list(steps)}, ("blocks", "factor"))
    return whole | converging


def _varies(values: np.ndarray) -> bool:
    return bool(values.size) and float(np.ptp(values)) > 1e-9 * float(np.max(np.abs(values)))


def _indices(design: Design, points: np.ndarray, values: np.ndarray, seed: int) -> dict[str, xarray.Variable]:
    """Return the indices from some blocks, NaN where there are none: of one block, or of numbers that do not vary."""
    size, columns = len(design.factors), _COLUMNS[design.method]
    if len(values) < 2 or not _varies(values):
        found = {name: np.full(size, np.nan) for name in columns}
        pairs = {name: np.full((size, size), np.nan) for name in _PAIRS}
    else:
        got = _by_salib(design, points, values, seed)
        order = [list(got["names"]).index(name) for name in design.factors] if "names" in got else slice(None)
        found = {name: np.asarray(got[key], dtype=float)[order] for name, key in columns.items()}
        pairs = {name: np.asarray(got[key]) for name, key in _PAIRS.items() if key in got}
        if design.method == "dgsm":
            # SALib's interval is of the mean squared derivative; the measure divides that by pi^2 variances.
            found["dgsm_error"] /= np.pi**2 * np.var(values[:, 0])
    variables = {name: xarray.Variable("factor", column) for name, column in found.items()}
    if design.second_order:  # SALib fills what is above the diagonal
        for name, above in pairs.items():
            variables[name] = xarray.Variable(("factor", "other"), np.where(np.isnan(above), above.T, above))
    return variables


def _by_salib(design: Design, points: np.ndarray, values: np.ndarray, seed: int) -> Any:
    analyser = importlib.import_module(f"SALib.analyze.{design.method}")
    own: dict[str, Any] = {"calc_second_order": design.second_order}
    if design.method != "sobol":
        own = {"X": points.reshape(-1, points.shape[-1])}
    if design.method == "morris":
        own["num_levels"] = _LEVELS
    with _quiet():
        return analyser.analyze(
            design.problem, Y=values.reshape(-1), num_resamples=_RESAMPLES, conf_level=CONFIDENCE, seed=seed, **own
        )
