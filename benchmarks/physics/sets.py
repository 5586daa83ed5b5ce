"""The parameter sets of PyBaMM that are drawn from, and why the others are not.

All sets of PyBaMM 26.10 were tried: each of `SETS` runs from full to empty as a DFN and as an SPMe.
"""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class ParameterSet:
    """What has to be known of a set before it is simulated.

    Attributes:
        chemistry: in words, for the title of a case.
        half_cell: whether the negative electrode is lithium metal.
        composite: whether the negative electrode has silicon beside graphite.
        entropy: whether the set states an entropic change that is not zero.
    """

    chemistry: str
    half_cell: bool = False
    composite: bool = False
    entropy: bool = False


SETS = {
    "Ai2020": ParameterSet("LCO pouch cell", entropy=True),
    "Bonkile2024": ParameterSet("NMC cell with graphite and silicon", composite=True),
    "Chen2020": ParameterSet("NMC 21700 cell"),
    "Chen2020_composite": ParameterSet("NMC 21700 cell with graphite and silicon", composite=True),
    "Ecker2015": ParameterSet("LiNiCoO2 pouch cell"),
    "Marquis2019": ParameterSet("LCO pouch cell", entropy=True),
    "Mohtat2020": ParameterSet("NMC pouch cell", entropy=True),
    "NCA_Kim2011": ParameterSet("NCA pouch cell"),
    "OKane2022": ParameterSet("NMC 21700 cell"),
    "ORegan2022": ParameterSet("NMC 21700 cell", entropy=True),
    "Prada2013": ParameterSet("LFP cell"),
    "Ramadass2004": ParameterSet("LCO cell", entropy=True),
    "Xu2019": ParameterSet("NMC cell on lithium metal", half_cell=True),
}
LEFT_OUT = {
    "Chayambuka2022": "a sodium cell, for which PyBaMM has one isothermal model",
    "ECM_Example": "an equivalent circuit: the model that is to be judged",
    "Ecker2015_graphite_halfcell": "graphite on lithium, an electrode under study and no cell that drives anything",
    "MSMR_Example": "a model of another kind, without an exchange current and a diffusivity to activate",
    "OKane2022_graphite_SiOx_halfcell": "graphite on lithium, an electrode under study and no cell",
    "Sulzer2019": "lead and acid",
}
