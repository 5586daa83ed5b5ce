"""Read a posterior from Zarr by ArviZ, and print its summary and leave-one-out scores as JSON."""

from __future__ import annotations

import json
import sys
import warnings

warnings.simplefilter("ignore")

import arviz as az  # noqa: E402 - it warns when it is imported
import xarray as xr  # noqa: E402

tree = xr.open_datatree(sys.argv[1], engine="zarr", consolidated=False)
data = az.from_datatree(tree) if hasattr(az, "from_datatree") else tree
summary = az.summary(data, kind="stats", round_to="none")
channels = list(tree["log_likelihood"].data_vars)
loo = {name: az.loo(data, var_name=name) for name in channels}
found = {
    "groups": list(tree.children),
    "mean": {name: float(value) for name, value in summary["mean"].items()},
    "sd": {name: float(value) for name, value in summary["sd"].items()},
    "elpd": {name: float(one.elpd_loo if hasattr(one, "elpd_loo") else one.elpd) for name, one in loo.items()},
    "readings": {name: int(one.n_data_points) for name, one in loo.items()},
}
print(json.dumps(found))
