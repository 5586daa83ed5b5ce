"""Global indices of a sweep study: the ranges of its axes and samples, run by the sweep engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Unpack

import numpy as np
import xarray
from pydantic import PrivateAttr

from jaxmodel.model.simulation import Status
from jaxmodel.sensitivity.indices import analyse, make_design
from jaxmodel.sensitivity.labels import labelled
from jaxmodel.sweeps.axes_form import Range
from jaxmodel.sweeps.engine import Progress, run
from jaxmodel.sweeps.results import about
from jaxmodel.sweeps.study import Study
from jaxmodel.sweeps.study_form import StudyFields


class DesignedStudy(Study):
    """A study whose lanes have the values of a design instead of drawn ones."""

    _values: dict[str, np.ndarray] = PrivateAttr()

    def __init__(self, values: Mapping[str, np.ndarray], /, **fields: Unpack[StudyFields]) -> None:
        super().__init__(**fields)
        self._values = dict(values)

    def drawn(self, numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Return the design's values for places along the dimension `lane`."""
        return {name: values[numbers] for name, values in self._values.items()}


def ranges_of(study: Study) -> dict[str, Range]:
    """Return over what a study varies each name: the range it is drawn from, or from the least value of an axis on."""
    spans = {name: Range(low=min(v), high=max(v)) for name, v in study.axes.items() if len(v) > 1}
    return spans | (dict(study.sample.ranges) if study.sample else {})


def global_indices(
    study: Study,
    method: str = "sobol",
    count: int = 1024,
    groups: Mapping[str, Sequence[str]] | None = None,
    *,
    second_order: bool = True,
    seed: int = 0,
    progress: bool | Progress = True,
) -> xarray.Dataset:
    """Return the global indices of a study's metrics over the ranges in which it varies.

    Values are drawn evenly over each range, in its logarithm where the range says so, independently of each other. An
    axis of one value stays. Runs that fail are left out with their block, and counted.

    Args:
        study: from `jaxmodel.sweeps.read_study`, or `jaxmodel.sweeps.Study(...)`; its axes and its sample are the
            ranges.
        method: "sobol", "morris" or "dgsm".
        count: of base points (trajectories of "morris"); of "sobol" rounded up to a power of two.
        groups: names that move together, by the group's name; not for "dgsm".
        second_order: of "sobol", indices of pairs too, at twice the runs.
        seed: of the points and of the resampling.
        progress: as in `jaxmodel.sweeps.run`.

    Returns:
        As `jaxmodel.sensitivity.indices.analyse`, and low, high and unit (parameter) and metric_unit (metric).

    Raises:
        SweepError: fewer than two names vary, or the method, a group or the count cannot be used.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> ranges = {"capacity_Ah": (2.0, 3.0), "current_A": (1.0, 2.0)}
        >>> sample = {"count": 8, "ranges": ranges}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], sample=sample)
        >>> data = sensitivity.global_indices(study, count=64, progress=False)
        >>> data["total"].sel(metric="final_soc").round(1).values
        array([0.3, 0.7])
    """
    spans = ranges_of(study)
    design = make_design(method, tuple(spans), count, groups, second_order=second_order, seed=seed)
    values = {}
    for share, (name, span) in zip(design.points.T, spans.items(), strict=True):
        logarithmic = span.spacing == "log"
        values[name] = (
            span.low * (span.high / span.low) ** share if logarithmic else span.low + (span.high - span.low) * share
        )
    fixed = {name: v for name, v in study.axes.items() if name not in spans}
    sample = {"count": len(design.points), "ranges": spans}
    fields: dict[str, Any] = {**dict(study), "axes": fixed, "sample": sample, "store": []}
    designed = DesignedStudy(values, **fields)
    done = run(designed, progress)
    over_lanes = done.isel({name: 0 for name in fixed})
    names = [metric.name for metric in designed.prepared.metrics]
    failed = over_lanes["status"].to_numpy() == Status.NOT_FINITE  # a metric may be missing where no run failed
    data = analyse(design, {name: over_lanes[name].to_numpy() for name in names}, seed=seed)
    whole = (
        data.assign_coords(parameter=list(spans))
        .assign(
            low=("parameter", [span.low for span in spans.values()]),
            high=("parameter", [span.high for span in spans.values()]),
            unit=("parameter", [about(study, name)["units"] for name in spans]),
            metric_unit=("metric", [metric.unit for metric in designed.prepared.metrics]),
        )
        .assign_attrs(title=study.title, analysis="global_indices", **data.attrs | {"failed": int(failed.sum())})
    )
    return labelled(whole)
