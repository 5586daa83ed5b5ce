"""Thousands of combinations of parameters, inputs and effects through the model."""

from sweeps.engine import run
from sweeps.forecast import Forecast, forecast
from sweeps.metrics import Metric, metrics_of, metrics_on_request
from sweeps.results import load, percentiles, save
from sweeps.study import Study, read_study

__all__ = [
    "Forecast",
    "Metric",
    "Study",
    "forecast",
    "load",
    "metrics_of",
    "metrics_on_request",
    "percentiles",
    "read_study",
    "run",
    "save",
]
