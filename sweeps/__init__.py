"""Thousands of combinations of parameters, inputs and effects through the model."""

import jaxmodel as jaxmodel  # the first: 64-bit numbers, before any array
from sweeps.devices import use_all_cores

use_all_cores()  # before the modules below make the first array

from sweeps.engine import run  # noqa: E402
from sweeps.metrics import Metric, metrics_of  # noqa: E402
from sweeps.results import load, save  # noqa: E402
from sweeps.study import Study, read_study  # noqa: E402

__all__ = ["Metric", "Study", "load", "metrics_of", "read_study", "run", "save", "use_all_cores"]
