"""Thousands of combinations of parameters, inputs and effects through the model, into one labelled data set.

    from jaxmodel import sweeps

    study = sweeps.read_study("examples/paper_sweep.toml")  # or sweeps.Study(kind="cell", profile={...}, axes={...})
    dataset = sweeps.run(study)                             # xarray.Dataset: metrics over the axes
    dataset["soc_gradient"].sel(ambient_degC=20.0)
    sweeps.save(dataset, "results")                         # result.zarr, lanes.csv, manifest.json

A metric of your own derives from `Metric`.
"""

from typing import TYPE_CHECKING

from jaxmodel.base.lazy import names_when_used

if TYPE_CHECKING:
    from jaxmodel.sweeps.engine import Progress, run
    from jaxmodel.sweeps.forecasting import Forecast, forecast
    from jaxmodel.sweeps.metrics import End, Metric, Moment, Step, metrics_of, metrics_on_request
    from jaxmodel.sweeps.parquet import to_parquet
    from jaxmodel.sweeps.results import lanes_per_second, load, percentiles, save
    from jaxmodel.sweeps.study import Study, read_study

__all__ = [
    "End",
    "Forecast",
    "Metric",
    "Moment",
    "Progress",
    "Step",
    "Study",
    "forecast",
    "lanes_per_second",
    "load",
    "metrics_of",
    "metrics_on_request",
    "percentiles",
    "read_study",
    "run",
    "save",
    "to_parquet",
]

__getattr__, __dir__ = names_when_used(__name__, __file__)
