"""First parameters of a cell, motor or robot from its measurements alone, with uncertainties that become priors.

    from jaxmodel import parameterise, read_case

    found = parameterise(read_case("CASE"))
    print(found.summary())  # every number with its sd and origin, and what the data do not give
    found.write("parameterised")  # a case for simulate, compare, diagnose

The room is private: users import these names from `jaxmodel`.
"""

from jaxmodel.parameterisation.parameterise import parameterise
from jaxmodel.parameterisation.preset import write_preset
from jaxmodel.parameterisation.result import Extraction, Parameterisation

__all__ = ["Extraction", "Parameterisation", "parameterise", "write_preset"]
