"""What a seed says of each cell: its physics, what is hidden in it, how it is measured. PyBaMM is not needed here."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

import numpy as np

from benchmarks.physics.profiles import Plan, draw_plans
from benchmarks.physics.sets import SETS

# A change of what is simulated or drawn counts this up: what was simulated before is then not used.
VERSION = 1
COUNT, SEED = 60, 2026
EVERY = 4  # every fourth cell has nothing hidden or a sensor fault
REFERENCE_DEGC = 25.0  # of the pulse test and the open-circuit table

# All that follows is assumed, unless a source is given.
SHARE_DFN = 0.6  # of the cells; the others are single particles with electrolyte
CAPACITY_AH = (1.5, 60.0)  # from an 18650 to a large prismatic cell
MOST_J_MOL = 60e3  # physics-based models of cells state 30 to 60 kJ/mol (jaxmodel/effects/battery.py, charge_transfer)
HEAT_CAPACITY_J_K_AH = (15.0, 60.0)  # jaxmodel/effects/battery.py, self_heating
COOLING_S = (400.0, 2500.0)  # C_th / hA: a cell in moving air to one in foam
OIL_S = 5.0  # the same in an oil bath, where a cell keeps its temperature
HEAT_SHARES = {"isothermal": 0.35, "lumped": 0.65}
SHARE_THERMOMETER = 0.65  # of the cells that warm
SHARE_AMBIENTS = 0.75  # of cells with something hidden, those measured at several ambients
SHARE_ENTROPY = 0.6  # of cells whose temperature moves
ENTROPY_V_K = (1e-4, 4e-4)  # size, where the set states none or by half of the chances
SHARE_HYSTERESIS = 0.2
HALF_WIDTH_V = (0.005, 0.030)  # of a loop; LFP some 10 to 20 mV, silicon more
DECAY = (5.0, 40.0)  # of the loop over the stoichiometry; it is crossed within 1 / DECAY of the charge
VOLTAGE_NOISE_V, TEMPERATURE_NOISE_K = (0.001, 0.005), (0.05, 0.2)
CURRENT_NOISE = (0.0005, 0.002)  # of the one-hour current
FAULTS = ("current_offset", "current_gain", "voltage_offset", "temperature_lag", "temperature_offset")
# Sizes, each of either sign but for the lag: of the one-hour current, a share, V, s, K.
FAULT_SIZES = {
    "current_offset": (0.005, 0.02),
    "current_gain": (0.01, 0.03),
    "voltage_offset": (0.005, 0.02),
    "temperature_lag": (20.0, 120.0),
    "temperature_offset": (0.8, 2.0),
}


@dataclasses.dataclass(frozen=True)
class Recipe:
    """All that a seed says of a cell.

    Attributes:
        index: of the cell among those of its seed.
        seed: of all cells.
        attempt: how often it was drawn before because a simulation failed.
        parameter_set: of PyBaMM.
        model: "DFN" or "SPMe".
        capacity_Ah: nominal; the set's cell has more or less of its electrodes in parallel.
        energies_J_mol: activation energies of "kinetics", "diffusion" (particles) and "electrolyte".
        heat: "isothermal" or "lumped".
        heat_capacity_J_K: of the cell; not used where it is isothermal.
        cooling_s: heat capacity over heat transfer.
        thermometer: whether the temperature of the cell is measured.
        entropy: "none", "bundled" (the set's own) or "constant".
        entropy_V_K: of the cell, where it is constant.
        hysteresis: "none", "silicon" (of a composite electrode) or "positive" or "negative" (one state).
        half_width_V: of the loop of a positive or negative electrode.
        decay: of the loop over the stoichiometry.
        noise: sd by column.
        fault: name of a sensor fault, "" for none.
        fault_size: its parameter.
        null: whether nothing is hidden but a fault; under a thermometer's fault the cell warms as others do.
        plans: the runs.
    """

    index: int
    seed: int
    attempt: int
    parameter_set: str
    model: str
    capacity_Ah: float
    energies_J_mol: dict[str, float]
    heat: str
    heat_capacity_J_K: float
    cooling_s: float
    thermometer: bool
    entropy: str
    entropy_V_K: float
    hysteresis: str
    half_width_V: float
    decay: float
    noise: dict[str, float]
    fault: str
    fault_size: float
    null: bool
    plans: tuple[Plan, ...]

    @property
    def name(self) -> str:
        """The name of the cell's folders: its seed, its number, and what tells whether it is simulated anew."""
        content = json.dumps([VERSION, dataclasses.asdict(self)], sort_keys=True)
        return f"s{self.seed}-{self.index:03d}-{hashlib.sha256(content.encode()).hexdigest()[:8]}"

    @property
    def hidden(self) -> tuple[str, ...]:
        """What is switched on in the runs and was not in the base's tests: each has a twin without it.

        "activation", "heat", "entropy", "hysteresis".
        """
        moves = self.heat == "lumped" and self.cooling_s > OIL_S
        ambients = {plan.ambient_degC for plan in self.plans}
        found = []
        if moves or ambients != {REFERENCE_DEGC}:
            found.append("activation")
        if moves:
            found.append("heat")
        if self.entropy != "none":
            found.append("entropy")
        if self.hysteresis != "none":
            found.append("hysteresis")
        return tuple(found)


def draw(seed: int, index: int, attempt: int = 0) -> Recipe:
    """Return a cell; one seed, index and attempt always give the same."""
    rng = np.random.default_rng([seed, index, attempt])
    while True:
        found = _draw(rng, seed, index, attempt)
        if found.null or found.hidden:
            return found


def _draw(rng: np.random.Generator, seed: int, index: int, attempt: int) -> Recipe:
    """Return a cell that may have nothing hidden."""
    special = index % EVERY == EVERY - 1
    fault = str(rng.choice(FAULTS)) if special and rng.random() < 0.5 else ""
    warms = fault.startswith("temperature")  # a thermometer's fault is on a cell that warms
    name = str(rng.choice(list(SETS)))
    known = SETS[name]
    capacity = _log(rng, *CAPACITY_AH)
    heat, cooling_s, thermometer, several = _surroundings(rng, special, warms)
    moves = several or (heat == "lumped" and cooling_s > OIL_S)
    entropy = "none"
    if moves and not special and rng.random() < SHARE_ENTROPY:
        entropy = "bundled" if known.entropy and rng.random() < 0.5 else "constant"
    noise = {
        "voltage_V": _log(rng, *VOLTAGE_NOISE_V),
        "current_A": _digits(capacity * _log(rng, *CURRENT_NOISE)),
        **({"cell_temperature_degC": _log(rng, *TEMPERATURE_NOISE_K)} if thermometer else {}),
    }
    return Recipe(
        index=index,
        seed=seed,
        attempt=attempt,
        parameter_set=name,
        model="DFN" if rng.random() < SHARE_DFN else "SPMe",
        capacity_Ah=capacity,
        energies_J_mol={
            what: _digits(rng.uniform(0.0, MOST_J_MOL)) for what in ("kinetics", "diffusion", "electrolyte")
        },
        heat=heat,
        heat_capacity_J_K=_digits(capacity * _log(rng, *HEAT_CAPACITY_J_K_AH)),
        cooling_s=cooling_s,
        thermometer=thermometer,
        entropy=entropy,
        entropy_V_K=_digits(_log(rng, *ENTROPY_V_K) * rng.choice((-1.0, 1.0))),
        hysteresis=_hysteresis(rng, special, known.composite, known.half_cell),
        half_width_V=_log(rng, *HALF_WIDTH_V),
        decay=_log(rng, *DECAY),
        noise=noise,
        fault=fault,
        fault_size=_fault_size(rng, fault, capacity),
        null=special,
        plans=draw_plans(rng, several, REFERENCE_DEGC),
    )


def _surroundings(rng: np.random.Generator, special: bool, warms: bool) -> tuple[str, float, bool, bool]:
    """Return heat, cooling time, whether there is a thermometer, and whether there are several ambients."""
    heat = str(rng.choice(list(HEAT_SHARES), p=list(HEAT_SHARES.values())))
    cooling_s, thermometer = _log(rng, *COOLING_S), rng.random() < SHARE_THERMOMETER
    several = rng.random() < SHARE_AMBIENTS
    if warms:
        return "lumped", cooling_s, True, several
    if special:
        return heat, OIL_S, thermometer and heat == "lumped", False
    return heat, cooling_s, thermometer and heat == "lumped", several


def _hysteresis(rng: np.random.Generator, special: bool, composite: bool, half_cell: bool) -> str:
    """Return where a loop is."""
    one_state = rng.random() < SHARE_HYSTERESIS
    electrode = "positive" if half_cell or rng.random() < 0.5 else "negative"
    if special or half_cell:  # PyBaMM's own loop fails beside lithium metal
        return "none"
    if composite:
        return "silicon" if rng.random() < 0.5 else "none"
    return electrode if one_state else "none"


def _fault_size(rng: np.random.Generator, fault: str, capacity_Ah: float) -> float:
    """Return the parameter of a fault."""
    size, sign = {name: _log(rng, *span) for name, span in FAULT_SIZES.items()}, float(rng.choice((-1.0, 1.0)))
    if not fault:
        return 0.0
    if fault == "temperature_lag":
        return size[fault]
    return _digits(sign * size[fault] * (capacity_Ah if fault == "current_offset" else 1.0))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is drawn uniformly, to four digits."""
    return _digits(float(np.exp(rng.uniform(np.log(low), np.log(high)))))


def _digits(value: Any) -> float:
    return float(f"{value:.4g}")
