"""Which physics does a model lack? An electro-thermal model of a lithium pack driving DC motors, held to measurements.

    from jaxmodel import diagnose, read_case, simulate_case

    case = read_case("examples/samsung_30q")  # or Case.from_dataframes({"1C": frame}, kind="cell")
    simulate_case(case).to_dataframe()
    diagnose(case).summary()

What `__all__` lists here, and in `jaxmodel.effects`, `jaxmodel.operation`, `jaxmodel.plots`, `jaxmodel.sensitivity` and
`jaxmodel.sweeps`, is the public API. Every other module is private and may change. A name is imported when it is first
used.

The import sets three things of JAX, all in `jaxmodel.base.jax_settings`: float64, one device per core, and a flag of
the compiler. The environment variable JAXMODEL_JAX_SETTINGS=off, set before the import, leaves JAX as it is.
"""

from typing import TYPE_CHECKING

from jaxmodel.base import jax_settings
from jaxmodel.base.lazy import names_when_used

jax_settings.apply()

if TYPE_CHECKING:
    from jaxmodel import effects, operation, plots, sensitivity, sweeps
    from jaxmodel.app.report import write_report
    from jaxmodel.base.errors import UserError
    from jaxmodel.base.jax_settings import keep_compiled_programs
    from jaxmodel.base.version import __version__ as __version__
    from jaxmodel.case import presets
    from jaxmodel.case.build import case_model, load_effect_class, preset_model, run_profile
    from jaxmodel.case.exported import Exported
    from jaxmodel.case.known import Known, Table
    from jaxmodel.case.reading import read_case
    from jaxmodel.case.records import Case, Run
    from jaxmodel.case.simulation import CaseSimulation, simulate_case
    from jaxmodel.data.importing.findings import Question
    from jaxmodel.data.importing.imported import Imported
    from jaxmodel.data.importing.importer import import_case
    from jaxmodel.data.importing.options import Options
    from jaxmodel.data.tables.raw_table import RawTable
    from jaxmodel.data.tables.reading import read_table
    from jaxmodel.diagnosis.answers import history
    from jaxmodel.diagnosis.changes import AnswerChanges, compare_answers
    from jaxmodel.diagnosis.diagnosis import compare, diagnose
    from jaxmodel.diagnosis.finishing import conclusion, finish
    from jaxmodel.diagnosis.identification import Identification, identify
    from jaxmodel.diagnosis.investigation import Investigation
    from jaxmodel.diagnosis.result import Diagnosis
    from jaxmodel.diagnosis.saved import read_diagnosis
    from jaxmodel.fit.regressor import CaseRegressor
    from jaxmodel.fit.settings import SETTINGS, Settings
    from jaxmodel.model.curves import between_knots
    from jaxmodel.model.declaration import Scalar, parameter
    from jaxmodel.model.electrothermal import Model
    from jaxmodel.model.flow import Flow, State, integral, relaxation
    from jaxmodel.model.names import parameter_table, with_values
    from jaxmodel.model.parameters import Parameters
    from jaxmodel.model.ports import CellContext, Effect, MotorContext
    from jaxmodel.model.profile import Profile, constant
    from jaxmodel.model.simulation import Cutoff, Status, Trajectory, run_track, simulate, track
    from jaxmodel.parameterisation.parameterise import parameterise
    from jaxmodel.parameterisation.preset import write_preset
    from jaxmodel.parameterisation.result import Extraction, Parameterisation

__all__ = [
    "SETTINGS",
    "AnswerChanges",
    "Case",
    "CaseRegressor",
    "CaseSimulation",
    "CellContext",
    "Cutoff",
    "Diagnosis",
    "Effect",
    "Exported",
    "Extraction",
    "Flow",
    "Identification",
    "Imported",
    "Investigation",
    "Known",
    "Model",
    "MotorContext",
    "Options",
    "Parameterisation",
    "Parameters",
    "Profile",
    "Question",
    "RawTable",
    "Run",
    "Scalar",
    "Settings",
    "State",
    "Status",
    "Table",
    "Trajectory",
    "UserError",
    "between_knots",
    "case_model",
    "compare",
    "compare_answers",
    "conclusion",
    "constant",
    "diagnose",
    "effects",
    "finish",
    "history",
    "identify",
    "import_case",
    "integral",
    "keep_compiled_programs",
    "load_effect_class",
    "operation",
    "parameter",
    "parameter_table",
    "parameterise",
    "plots",
    "preset_model",
    "presets",
    "read_case",
    "read_diagnosis",
    "read_table",
    "relaxation",
    "run_profile",
    "run_track",
    "sensitivity",
    "simulate",
    "simulate_case",
    "sweeps",
    "track",
    "with_values",
    "write_preset",
    "write_report",
]

__getattr__, __dir__ = names_when_used(__name__, __file__)
