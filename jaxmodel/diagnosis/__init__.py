"""Compare a model with measurements: where it fails, what it lacks, which tables are wrong, and what remains.

    from jaxmodel import Investigation, diagnose

    diagnosis = diagnose(case)  # the verdict and its reasons
    diagnosis.plot.ladder()

    investigation = Investigation(case)  # the same step by step
    investigation.candidates()
    investigation.add("self_heating")
    investigation.ladder()

The room is private: users import these names from `jaxmodel`.
"""

from typing import TYPE_CHECKING

from jaxmodel.base.lazy import names_when_used

if TYPE_CHECKING:
    from jaxmodel.diagnosis.diagnosis import compare, diagnose
    from jaxmodel.diagnosis.finishing import conclusion, finish
    from jaxmodel.diagnosis.identification import Identification, identify
    from jaxmodel.diagnosis.investigation import Investigation
    from jaxmodel.diagnosis.result import Diagnosis
    from jaxmodel.fit.settings import SETTINGS, Settings

__all__ = [
    "SETTINGS",
    "Diagnosis",
    "Identification",
    "Investigation",
    "Settings",
    "compare",
    "conclusion",
    "diagnose",
    "finish",
    "identify",
]

__getattr__, __dir__ = names_when_used(__name__, __file__)
