"""Derivatives at the point of a study: the same file as a sweep's, analysed at one point instead of over its axes."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping

import numpy as np
import xarray

from jaxmodel.base.progress import Stage, stages
from jaxmodel.sensitivity.derivatives import local_sensitivities
from jaxmodel.sensitivity.doubling import doubling_test
from jaxmodel.sensitivity.interaction import second_derivatives
from jaxmodel.sensitivity.labels import labelled
from jaxmodel.sensitivity.metrics import choose_metrics, has_derivative
from jaxmodel.sensitivity.propagation import propagate
from jaxmodel.sensitivity.uncertain import stated_sd
from jaxmodel.sweeps.metrics import Metric
from jaxmodel.sweeps.plausible import warn_of_odd_values
from jaxmodel.sweeps.prepare import Prepared
from jaxmodel.sweeps.study import Study


def local(study: Study, *, doubling: bool = True, progress: bool | Stage = True) -> xarray.Dataset:
    """Return the derivatives of a study's metrics and readings by every parameter, beside the paper's doubling test.

    The point is the study's model and profile: a parameter on an axis has the value that `parameters` or the preset
    gives it, an input on an axis its first value, an input in a range the middle; `Study.at` sets another point.
    Metrics are those that the study names, as far as they have a derivative, or all; readings are the columns that it
    stores, at the rows that it stores, or all.

    Args:
        study: from `jaxmodel.sweeps.read_study`, or `jaxmodel.sweeps.Study(...)`.
        doubling: False leaves out the doubling test, whose program takes several times as long to compile.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with
            what is done next.

    Returns:
        A data set over parameter, metric, output and time_s, in the units that `unit` and `metric_unit` state:
        value, unit, step, doubles (parameter): `step` is the value itself where `doubles`;
        metric_value, metric_unit (metric);
        metric_derivative, metric_change (derivative times step), elasticity (p/y) dy/dp (metric, parameter);
        output_value (output, time_s); output_derivative, output_change (output, parameter, time_s);
        and the variables of `jaxmodel.sensitivity.doubling.doubling_test`.

    Raises:
        ParameterError, SweepError: what the study names has no sensitivity.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> study = sweeps.Study(
        ...     kind="cell",
        ...     profile={"duration_s": 60.0, "step_s": 10.0, "ambient_degC": 20.0},
        ...     axes={"current_A": [2.0]},
        ...     metrics=["final_soc"],
        ... )
        >>> data = sensitivity.local(study, doubling=False)
        >>> f"{float(data['elasticity'].sel(metric='final_soc', parameter='current_A')):.4f}"
        '-0.0078'
    """
    prepared, metrics, outputs = _asked(study)
    model, profile, cutoff = prepared.model, prepared.profile, prepared.cutoff
    with stages(progress, "sensitivity") as tell:
        tell("differentiating")
        data = local_sensitivities(model, profile, None, metrics, outputs, cutoff=cutoff)
        if doubling:
            tell("doubling each parameter")
            doubled = doubling_test(model, profile, data.parameter.values, metrics, outputs, cutoff=cutoff)
            # Both hold the run itself, from two programs that may differ in the last bit.
            data = data.merge(doubled, compat="override").assign_attrs(data.attrs | doubled.attrs)
    return _at_stored_rows(data, study, "local")


def interactions(
    study: Study, pairs: Iterable[tuple[str, str]] | Iterable[str], *, progress: bool | Stage = True
) -> xarray.Dataset:
    """Return the second derivatives of a study's metrics by pairs of parameters, beside the doubling of both.

    Args:
        study: the point is that of `local`.
        pairs: pairs of parameters or inputs; or names, of which every pair is taken, each name with itself too.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with
            what is done next.

    Returns:
        As `jaxmodel.sensitivity.interaction.second_derivatives`.

    Raises:
        ParameterError, SweepError: a parameter or metric is unknown, or no pair is given.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> data = sensitivity.interactions(study, ["capacity_Ah", "current_A"], progress=False)
        >>> list(data.dims)
        ['parameter', 'metric', 'pair']
    """
    prepared, metrics, _ = _asked(study)
    given = list(pairs)
    names = [name for name in given if isinstance(name, str)]
    chosen = [(pair[0], pair[1]) for pair in given if not isinstance(pair, str)]
    chosen += itertools.combinations_with_replacement(names, 2)
    with stages(progress, "interactions") as tell:
        tell(f"second derivatives by {len(chosen)} pairs")
        data = second_derivatives(prepared.model, prepared.profile, chosen, metrics, cutoff=prepared.cutoff)
    return labelled(data).assign_attrs(title=study.title, analysis="interactions")


def uncertainty(
    study: Study,
    sd: Mapping[str, float] | None = None,
    correlation: np.ndarray | None = None,
    *,
    draws: int = 512,
    seed: int = 0,
    progress: bool | Stage = True,
) -> xarray.Dataset:
    """Return the spread of a study's metrics and stored columns that comes of uncertain parameters.

    With the results of an identification: `known = read_estimates(folder)`, then
    `uncertainty(study.at(known.values), known.sd, known.correlation)`.

    Args:
        study: its model and profile are the centre.
        sd: standard deviations by name of a parameter or input, in its unit; None takes those that the study's case
            states.
        correlation: of the parameters, in the order of `sd`; none where it is not given.
        draws: runs that are sampled, 8 or more; rounded up to a power of two.
        seed: of the draws.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with
            what is done next.

    Returns:
        As `jaxmodel.sensitivity.propagation.propagate`.

    Raises:
        ParameterError, SweepError: a name is unknown, an sd is negative, the correlations contradict each other, fewer
            than eight draws can be run, or the case states no sd.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> data = sensitivity.uncertainty(study, {"capacity_Ah": 0.05}, draws=64, progress=False)
        >>> data["metric_sd_gradient"].round(6).values
        array([0.000742])
    """
    prepared, metrics, outputs = _asked(study)
    with stages(progress, "uncertainty") as tell:
        tell(f"differentiating, and sampling {draws} runs")
        data = propagate(
            prepared.model,
            prepared.profile,
            stated_sd(study) if sd is None else sd,
            correlation,
            metrics,
            outputs,
            cutoff=prepared.cutoff,
            draws=draws,
            seed=seed,
        )
    return _at_stored_rows(data, study, "uncertainty")


def _asked(study: Study) -> tuple[Prepared, tuple[Metric, ...], list[str] | None]:
    """Return what a study means, its metrics that have a derivative, and the columns that it stores; None for all."""
    warn_of_odd_values(study)
    prepared = study.prepared
    named = [metric for metric in prepared.metrics if has_derivative(metric)] if study.metrics else None
    return prepared, choose_metrics(named, prepared.model.kind), study.store or None


def _at_stored_rows(data: xarray.Dataset, study: Study, analysis: str) -> xarray.Dataset:
    rows = data.isel(time_s=slice(None, None, study.store_every))
    return labelled(rows).assign_attrs(title=study.title, analysis=analysis)
