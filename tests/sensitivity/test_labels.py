"""Every variable of every analysis has a name in words and a unit."""

from __future__ import annotations

import re

import pytest
import xarray

from jaxmodel import sensitivity, sweeps

STUDY = sweeps.Study(
    kind="cell",
    title="a cell",
    profile={"duration_s": 60.0, "step_s": 10.0, "current_A": 4.0, "ambient_degC": 20.0},
    axes={"ambient_degC": [10.0, 20.0], "capacity_Ah": [2.0, 3.0]},
    metrics=["final_soc"],
    store=["voltage_V"],
)
ANALYSES = {
    "sweep": lambda: sweeps.run(STUDY),
    "percentiles": lambda: sweeps.percentiles(sweeps.run(STUDY)),
    "local": lambda: sensitivity.local(STUDY),
    "interactions": lambda: sensitivity.interactions(STUDY, [("capacity_Ah", "cycles")]),
    "uncertainty": lambda: sensitivity.uncertainty(STUDY, {"capacity_Ah": 0.1}, draws=16),
    "sobol": lambda: sensitivity.global_indices(STUDY, count=4),
    "morris": lambda: sensitivity.global_indices(STUDY, "morris", count=2),
    "dgsm": lambda: sensitivity.global_indices(STUDY, "dgsm", count=4),
    "map": lambda: sensitivity.elasticity_map(STUDY, ["capacity_Ah"]),
}


@pytest.mark.parametrize("analysis", ANALYSES)
def test_every_variable_says_what_it_is_and_in_which_unit(analysis: str) -> None:
    data: xarray.Dataset = ANALYSES[analysis]()
    unlabelled = [n for n, v in data.variables.items() if not v.attrs.get("long_name") or "units" not in v.attrs]
    assert unlabelled == []
    for name, variable in data.variables.items():
        units = variable.attrs["units"]
        # Where a unit stands in another variable, that is there, along the same axis.
        for other, axis in (("metric_unit", "metric"), ("unit", "parameter")):
            if other in re.findall(r"\w+", units):
                assert other in data.variables, name
                assert axis in variable.dims or "pair" in variable.dims, name


def test_units_of_what_is_known() -> None:
    data = sensitivity.elasticity_map(STUDY, ["capacity_Ah"])
    assert data["ambient_degC"].attrs["units"] == "degC"
    assert data["metric_unit"].item() == ""
    assert data["unit"].item() == "A h"
    assert data["metric_derivative"].attrs["units"] == "metric_unit / unit"
