"""An electro-thermal model of a lithium pack driving brushed DC motors: a pure step, scanned.

    from jaxmodel import Case, read_case, simulate_case

    case = read_case("examples/samsung_30q")  # or Case.from_dataframes({"1C": frame}, kind="cell")
    simulation = simulate_case(case)
    simulation.to_dataframe()

What `__all__` lists is the public API; the modules behind it may change.

The import sets three things of JAX, all in `jaxmodel.jax_settings`: float64, one device per core, and a flag of the
compiler. The environment variable JAXMODEL_JAX_SETTINGS=off, set before the import, leaves JAX as it is.
"""

from typing import TYPE_CHECKING

from jaxmodel import jax_settings

jax_settings.apply()

from jaxmodel import effects, presets
from jaxmodel.build import case_model, preset_model, run_profile
from jaxmodel.case import Case, Run
from jaxmodel.case_simulation import CaseSimulation, simulate_case
from jaxmodel.cases import read_case
from jaxmodel.declaration import Scalar, parameter
from jaxmodel.errors import UserError
from jaxmodel.jax_settings import keep_compiled_programs
from jaxmodel.known import Known, Table
from jaxmodel.lazy import names_when_used
from jaxmodel.model import Model
from jaxmodel.parameters import Parameters
from jaxmodel.ports import CellContext, Effect, MotorContext
from jaxmodel.profile import Profile, constant
from jaxmodel.simulation import Cutoff, Status, Trajectory, run_track, simulate, track

if TYPE_CHECKING:
    from jaxmodel.tables import RawTable, read_table

__all__ = [
    "Case",
    "CaseSimulation",
    "CellContext",
    "Cutoff",
    "Effect",
    "Known",
    "Model",
    "MotorContext",
    "Parameters",
    "Profile",
    "RawTable",
    "Run",
    "Scalar",
    "Status",
    "Table",
    "Trajectory",
    "UserError",
    "case_model",
    "constant",
    "effects",
    "keep_compiled_programs",
    "parameter",
    "preset_model",
    "presets",
    "read_case",
    "read_table",
    "run_profile",
    "run_track",
    "simulate",
    "simulate_case",
    "track",
]

# What reads files of benches: most programs need none of it.
__getattr__, __dir__ = names_when_used(__name__, __file__)
