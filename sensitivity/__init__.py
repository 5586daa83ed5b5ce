"""How results depend on parameters: derivatives, pairs, uncertainty, and indices over whole ranges.

    from jaxmodel import sensitivity, sweeps

    study = sweeps.read_study("examples/paper_sweep.toml").at({"ambient_degC": 20.0, "load_torque_Nm": 0.175})
    data = sensitivity.local(study)                         # xarray.Dataset: derivatives, elasticities, doubling
    sensitivity.uncertainty(study, {"capacity_Ah": 0.05})   # spread of each metric, by gradient and by sampling
    sensitivity.save(data, "results")                       # sensitivity.zarr, sensitivity.csv

Each analysis takes a study and returns an `xarray.Dataset`, whose attribute `analysis` is the function's name.
"""

from typing import TYPE_CHECKING

from jaxmodel.base.lazy import names_when_used

if TYPE_CHECKING:
    from jaxmodel.sensitivity.doubling import doubling_test
    from jaxmodel.sensitivity.global_study import global_indices
    from jaxmodel.sensitivity.over_axes import elasticity_map
    from jaxmodel.sensitivity.results import largest_elasticity, load, save, tables
    from jaxmodel.sensitivity.study import interactions, local, uncertainty
    from jaxmodel.sensitivity.uncertain import Estimates, read_estimates, stated_sd

__all__ = [
    "Estimates",
    "doubling_test",
    "elasticity_map",
    "global_indices",
    "interactions",
    "largest_elasticity",
    "load",
    "local",
    "read_estimates",
    "save",
    "stated_sd",
    "tables",
    "uncertainty",
]

__getattr__, __dir__ = names_when_used(__name__, __file__)
