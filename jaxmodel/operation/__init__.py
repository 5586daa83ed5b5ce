"""The model on a robot: duty maps that compensate cold and load, state of charge, and how long a mission lasts.

    import numpy as np

    from jaxmodel import operation, read_case

    (robot,) = operation.read_robots(["my_robot"]).values()
    map_ = operation.compensate(robot, ambient_degC=np.arange(-20, 61, 20.0), load_torque_Nm=np.arange(0.1, 0.4, 0.05))
    mission = operation.read_mission("examples/missions/house_search.toml")
    operation.endurance(robot, mission, np.array([0.0, 20.0]), compensation=map_).to_dataframe()
    operation.evaluate_estimators(read_case("my_cell")).errors

`read_robots` gives the models of cases of the kind robot by the names of their folders.
"""

from jaxmodel.operation.c_code import c_header, interpolation_error
from jaxmodel.operation.compensation import Compensation, Reference, compensate, paper_rule_error
from jaxmodel.operation.controller import SinglePrecision, single_precision
from jaxmodel.operation.innovations import Consistency, consistency
from jaxmodel.operation.kalman import FilterOutput, Measured, Tuning, ekf
from jaxmodel.operation.load import LoadEstimate, RunLoad, estimate_load, sides
from jaxmodel.operation.mission import (
    LIMITS,
    SURFACES,
    Limits,
    Mission,
    Segment,
    endurance,
    mission_profile,
    read_mission,
)
from jaxmodel.operation.pack import CellCharge, PackCharge, cells_of_pack
from jaxmodel.operation.polynomial import PolynomialEstimator, polynomial_estimator, run_polynomial
from jaxmodel.operation.preparation import for_estimation
from jaxmodel.operation.robots import cells_in_parallel, read_robots
from jaxmodel.operation.state_of_charge import Evaluation, cost_per_step, evaluate_estimators, read_tunings
from jaxmodel.operation.wear import Trend, Wear, trend

__all__ = [
    "LIMITS",
    "SURFACES",
    "CellCharge",
    "Compensation",
    "Consistency",
    "Evaluation",
    "FilterOutput",
    "Limits",
    "LoadEstimate",
    "Measured",
    "Mission",
    "PackCharge",
    "PolynomialEstimator",
    "Reference",
    "RunLoad",
    "Segment",
    "SinglePrecision",
    "Trend",
    "Tuning",
    "Wear",
    "c_header",
    "cells_in_parallel",
    "cells_of_pack",
    "compensate",
    "consistency",
    "cost_per_step",
    "ekf",
    "endurance",
    "estimate_load",
    "evaluate_estimators",
    "for_estimation",
    "interpolation_error",
    "mission_profile",
    "paper_rule_error",
    "polynomial_estimator",
    "read_mission",
    "read_robots",
    "read_tunings",
    "run_polynomial",
    "sides",
    "single_precision",
    "trend",
]
