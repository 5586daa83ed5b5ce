"""The sensitivity of a sweep study's model: the same file, looked at in one point instead of over its axes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import xarray

from sensitivity.doubling import doubling_test
from sensitivity.interaction import interactions
from sensitivity.local import local_sensitivities
from sensitivity.metrics import choose_metrics, has_derivative
from sensitivity.uncertainty import propagate
from sweeps.metrics import Metric
from sweeps.prepare import Prepared
from sweeps.study import Study


def sensitivity_of_study(study: Study, doubling: bool = True) -> xarray.Dataset:
    """Return the local sensitivities of a study's model, with the paper's doubling test beside them.

    The point is the study's model and profile: a parameter on an axis has the value that `parameters` or the preset
    gives it, an input on an axis its first value. Metrics are those that the study names, as far as they have a
    derivative, or all; outputs are the columns that it stores, at the rows that it stores, or all.

    Args:
        study: from `sweeps.study.read_study`, or written in Python.
        doubling: False leaves out the doubling test, whose program takes several times as long to compile.

    Returns:
        The variables of `local_sensitivities` and of `doubling_test` in one data set.

    Raises:
        ParameterError, SweepError: what the study names has no sensitivity.
    """
    prepared, metrics, outputs = _asked(study)
    model, profile, cutoff = prepared.model, prepared.profile, prepared.cutoff
    data = local_sensitivities(model, profile, None, metrics, outputs, cutoff=cutoff)
    if doubling:
        doubled = doubling_test(model, profile, data.parameter.values, metrics, outputs, cutoff=cutoff)
        # Both hold the run itself, from two programs that may differ in the last bit.
        data = data.merge(doubled, compat="override").assign_attrs(data.attrs | doubled.attrs)
    return data.isel(time_s=slice(None, None, study.store_every)).assign_attrs(title=study.title)


def interactions_of_study(study: Study, pairs: Iterable[tuple[str, str]]) -> xarray.Dataset:
    """Return the second derivatives of a study's metrics by pairs, beside the doubling of both.

    Args:
        study: the point is that of `sensitivity_of_study`.
        pairs: names of parameters or inputs.

    Returns:
        As `sensitivity.interaction.interactions`.
    """
    prepared, metrics, _ = _asked(study)
    data = interactions(prepared.model, prepared.profile, pairs, metrics, cutoff=prepared.cutoff)
    return data.assign_attrs(title=study.title)


def uncertainty_of_study(
    study: Study, sd: Mapping[str, float], correlation: np.ndarray | None = None, draws: int = 512
) -> xarray.Dataset:
    """Return the spread of a study's metrics and stored columns that comes of not knowing parameters.

    Args:
        study: its model and profile are the centre.
        sd: standard deviations by name.
        correlation: of the parameters, in the order of `sd`.
        draws: runs that are sampled.

    Returns:
        As `sensitivity.uncertainty.propagate`.
    """
    prepared, metrics, outputs = _asked(study)
    data = propagate(
        prepared.model, prepared.profile, sd, correlation, metrics, outputs, cutoff=prepared.cutoff, draws=draws
    )
    return data.isel(time_s=slice(None, None, study.store_every)).assign_attrs(title=study.title)


def _asked(study: Study) -> tuple[Prepared, tuple[Metric, ...], list[str] | None]:
    """Return what a study means, its metrics that have a derivative, and the columns that it stores; None for all."""
    prepared = study.prepared
    named = [metric for metric in prepared.metrics if has_derivative(metric)] if study.metrics else None
    return prepared, choose_metrics(named, prepared.model.kind), study.store or None
