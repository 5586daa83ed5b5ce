"""What each variable of a result is called and in which unit it is, as attributes `long_name` and `units`.

The numbers of one variable may have different units: those of a metric, of a parameter, of a reading. `units` then says
where they stand: "metric_unit" is the variable of that name, "reading" the end of the reading's name.
"""

from __future__ import annotations

from collections.abc import Mapping

import xarray

_METRIC, _PARAMETER, _READING = "metric_unit", "unit", "reading"
_CHANGES = {
    "first": "the first doubled",
    "second": "the second doubled",
    "both": "both doubled",
    "joint": "both doubled, beyond that of each",
}

_LABELS: dict[str, tuple[str, str]] = {
    "parameter": ("parameter or input", ""),
    "metric": ("metric", ""),
    "output": ("reading", ""),
    "time_s": ("time", "s"),
    "pair": ("pair of parameters", ""),
    "first": ("first parameter of the pair", ""),
    "second": ("second parameter of the pair", ""),
    "quantile": ("share of the draws below", ""),
    "factor": ("parameter or group that varies", ""),
    "other": ("parameter or group that varies with it", ""),
    "blocks": ("blocks of points used", ""),
    # Of parameters.
    "value": ("value", _PARAMETER),
    "unit": ("unit of the parameter", ""),
    "step": ("step of the change", _PARAMETER),
    "doubles": ("the step is the value itself", ""),
    "in_bounds": ("value and step are within the bounds", ""),
    "status": ("how the run after the step ended", ""),
    "valid_share": ("share of the rows in which the equations make sense", ""),
    "sd": ("standard deviation", _PARAMETER),
    "low": ("low end of the range", _PARAMETER),
    "high": ("high end of the range", _PARAMETER),
    # Of metrics.
    "metric_value": ("metric", _METRIC),
    "metric_unit": ("unit of the metric", ""),
    "metric_derivative": ("derivative of the metric", f"{_METRIC} / {_PARAMETER}"),
    "metric_change": ("derivative times step", _METRIC),
    "elasticity": ("percent of the metric for one percent of the parameter", ""),
    "metric_moved": ("metric after the step", _METRIC),
    "linear_change": ("change predicted by the derivative", _METRIC),
    "curvature_change": ("further change predicted by the curvature", _METRIC),
    "effect": ("change of the metric by the step, as a share of it", ""),
    "linear": ("share predicted by the derivative", ""),
    "curvature": ("further share predicted by the curvature", ""),
    "power_law": ("share predicted by a power law", ""),
    "metric_sd_gradient": ("sd of the metric by the gradient", _METRIC),
    "metric_sd_sampled": ("sd of the metric by sampling", _METRIC),
    "metric_mean": ("mean of the metric over the draws", _METRIC),
    "metric_agrees": ("gradient and sampling agree", ""),
    "metric_share": ("share of the variance", ""),
    "metric_quantile": ("quantile of the metric", _METRIC),
    # Of readings over time.
    "output_value": ("reading", _READING),
    "output_derivative": ("derivative of the reading", f"{_READING} / {_PARAMETER}"),
    "output_change": ("derivative times step", _READING),
    "output_moved": ("reading after the step", _READING),
    "output_linear": ("reading predicted by the derivative", _READING),
    "output_sd_gradient": ("sd of the reading by the gradient", _READING),
    "output_sd_sampled": ("sd of the reading by sampling", _READING),
    "output_mean": ("mean of the reading over the draws", _READING),
    "output_agrees": ("gradient and sampling agree", ""),
    "output_quantile": ("quantile of the reading", _READING),
    # Of pairs.
    "second_derivative": ("second derivative of the metric", f"{_METRIC} / ({_PARAMETER} x {_PARAMETER})"),
    "predicted_joint": ("change by both beyond that of each, predicted", _METRIC),
    "interaction": ("share by both beyond that of each, predicted", ""),
    **{f"change_{name}": (f"change of the metric, {words}", _METRIC) for name, words in _CHANGES.items()},
    **{f"effect_{name}": (f"change as a share of the metric, {words}", "") for name, words in _CHANGES.items()},
    # Global.
    "total": ("total index", ""),
    "mu": ("mean effect over the range", _METRIC),
    "mu_star": ("mean size of the effect over the range", _METRIC),
    "sigma": ("sd of the effects over the range", _METRIC),
    "dgsm": ("upper bound of the total index", ""),
    "blocks_used": ("blocks of points whose runs were complete", ""),
}
# Indices that have the names of coordinates of another analysis.
_GLOBAL = {"first": ("first-order index", ""), "second": ("second-order index of a pair", "")}


def labelled(data: xarray.Dataset, axes: Mapping[str, Mapping[str, str]] | None = None) -> xarray.Dataset:
    """Return a result whose every variable has `long_name` and `units`.

    Args:
        data: of any analysis of this package.
        axes: of a map, the attributes of its axes by name.
    """
    known = _LABELS | (_GLOBAL if "factor" in data.dims else {})
    labels = {str(name): _label(str(name), known) for name in data.variables if str(name) not in (axes or {})}
    found = data.copy()
    for name, (words, unit) in labels.items():
        found[name].attrs |= {"long_name": words, "units": unit}
    for name, attributes in (axes or {}).items():
        found[name].attrs |= attributes
    return found


def _label(name: str, known: Mapping[str, tuple[str, str]]) -> tuple[str, str]:
    """Return a variable's label; that of an interval or of a part of the points is made from that of the index."""
    if name in known:
        return known[name]
    of_index = name.replace("_converging", "").removesuffix("_error")
    words, unit = known[of_index]
    words = f"half-width of the interval of 95 % of the {words}" if name.endswith("_error") else words
    return (f"{words}, from the first blocks" if "_converging" in name else words), unit
