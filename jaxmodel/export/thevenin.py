"""The equivalent circuit of a case's cell as tables over state of charge and temperature, which other tools have too.

What an effect does to an element as a function of state of charge and temperature is in the tables. Effects that have
states of their own, or that act by the current, are not: `left_out` names them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.build import case_model
from jaxmodel.case.records import Case
from jaxmodel.effects.battery import SelfHeating
from jaxmodel.export.wording import ideal_readings, own_values_of_runs
from jaxmodel.model import cell as cells
from jaxmodel.model.curves import CURVE_NAMES, SOC_FORMULA_FLOOR, Table
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.ports import CELL_PORTS, Effect
from jaxmodel.model.sensors import sensors_of

ELEMENTS = ("ocv_V", "R0_ohm", "R1_ohm", "C1_F", "R2_ohm", "C2_F")
# Ports whose values are those of elements.
_OF_ELEMENTS = {
    "usable_charge", "open_circuit_voltage", "cycle_resistance", "series_resistance", "rc_resistance", "rc_capacitance",
    "short_rc_resistance", "short_rc_capacitance", "long_rc_resistance", "long_rc_capacitance",
}  # fmt: skip
# Breakpoints beside those of the tables; an interval is halved where an element bends in it: until the middle is on the
# line within a share of the element, or so often. All assumed.
_SOC, _TEMPERATURE_DEGC = (0.0, SOC_FORMULA_FLOOR, 1.0), (-20.0, 60.0)
_ON_THE_LINE = {"ocv_V": 1e-5}
_ON_THE_LINE_ELSE, _MOST_ROUNDS = 2e-4, 10
_POINTS = 1024  # that are computed together: another number of them would be compiled again
_ALIKE = 1e-12  # share of an element's size by which rows that are the same may differ


# From (soc,) and (temperature,) to each element, (temperature, soc).
Evaluated = Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]


@dataclasses.dataclass(frozen=True, eq=False)
class Thevenin:
    """A cell of a source, a series resistance and two RC pairs; pair 1 is the short one.

    Attributes:
        soc: (soc,) breakpoints, rising.
        temperature_degC: (temperature,) breakpoints, rising; one where the temperature does nothing.
        elements: by a name of `ELEMENTS`, (temperature, soc); of one row where the temperature does nothing to it.
        dU_dT_V_K: (temperature, soc) derivative of the open-circuit voltage by temperature; None if it is not known.
        capacity_Ah: at `reference_degC`.
        reference_degC: mean ambient of the runs.
        initial_soc: of the first run.
        initial_rise_K: of the cell over the ambient, at the start of the first run.
        C_th: heat capacity in J/K, and `hA` heat transfer to the ambient in W/K; None where the cell is always at the
            ambient temperature.
        left_out: what the circuit does not carry, one sentence each.
    """

    soc: np.ndarray
    temperature_degC: np.ndarray
    elements: dict[str, np.ndarray]
    dU_dT_V_K: np.ndarray | None
    capacity_Ah: float
    reference_degC: float
    initial_soc: float
    initial_rise_K: float
    C_th: float | None
    hA: float | None
    left_out: tuple[str, ...]


def thevenin(case: Case) -> Thevenin:
    """Return the equivalent circuit of a case's cell.

    Raises:
        ParameterError: the case is of a motor.
    """
    if case.kind == "motor":
        raise ParameterError(f"{case.label}: it is of a motor, and this format is of a cell; give a case of a cell.")
    model = case_model(case)
    kept = tuple(effect for effect in model.effects if _is_of_elements(effect))
    warm = next((effect for effect in model.effects if isinstance(effect, SelfHeating)), None)
    first = case.runs[0]
    reference = float(np.mean([np.mean(run.measured.inputs["ambient_degC"]) for run in case.runs]))
    circuit = Model("cell", model.parameters, model.curves, kept)
    evaluated = _of(circuit)
    soc, celsius = _breakpoints(circuit, evaluated)
    elements = evaluated(soc, celsius)
    elements = {name: _with_one_row(values) for name, values in elements.items()}
    if all(len(values) == 1 for values in elements.values()):
        celsius = celsius[:1]
    dU_dT = elements.pop("dU_dT_V_K", None)
    rise = 0.0
    if first.initial_cell_temperature is not None:
        rise = first.initial_cell_temperature.value - float(first.measured.inputs["ambient_degC"][0])
    others = [effect for effect in model.effects if effect not in kept and effect is not warm]
    without = _effects_left_out(others, model)
    return Thevenin(
        soc=soc,
        temperature_degC=celsius,
        elements=elements,
        dU_dT_V_K=dU_dT,
        capacity_Ah=_usable_charge_C(circuit, reference) / 3600.0,
        reference_degC=reference,
        initial_soc=first.initial_soc.value,
        initial_rise_K=rise,
        C_th=None if warm is None else float(warm.C_th),
        hA=None if warm is None else float(warm.hA),
        left_out=(*without, *_of_kind(case), *own_values_of_runs(case), *ideal_readings(model)),
    )


def _is_of_elements(effect: Effect) -> bool:
    ports = {port for port in CELL_PORTS if hasattr(effect, port)}
    has_states = type(effect).initial_state is not Effect.initial_state
    return bool(ports) and ports <= _OF_ELEMENTS and not has_states


def _breakpoints(circuit: Model, evaluated: Evaluated) -> tuple[np.ndarray, np.ndarray]:
    """Return the breakpoints of the tables, and those between them that a formula or an effect needs."""
    tables = [getattr(circuit.curves, name) for name in (*CURVE_NAMES, "dU_dT")]
    tables = [table for table in tables if isinstance(table, Table)]
    soc = np.unique(np.concatenate([_SOC, *(np.asarray(table.soc) for table in tables)]))
    over_both = [np.asarray(table.temperature_degC) for table in tables if len(table.values) > 1]
    celsius = np.unique(np.concatenate([_TEMPERATURE_DEGC, *over_both]))
    soc = _halved(soc, lambda at: evaluated(at, celsius))
    return soc, _halved(celsius, lambda at: {name: values.T for name, values in evaluated(soc, at).items()})


def _halved(knots: np.ndarray, of: Callable[[np.ndarray], dict[str, np.ndarray]]) -> np.ndarray:
    """Return breakpoints between which all elements, (others, breakpoints) each, are straight."""
    for _ in range(_MOST_ROUNDS):
        middle = 0.5 * (knots[1:] + knots[:-1])
        ends, found = of(knots), of(middle)
        bent = np.zeros(middle.size, dtype=bool)
        for name, values in found.items():
            away = np.abs(values - 0.5 * (ends[name][:, 1:] + ends[name][:, :-1]))
            size = np.abs(values) if name in ELEMENTS else np.abs(values).max() + np.zeros_like(values)
            bent |= (away > _ON_THE_LINE.get(name, _ON_THE_LINE_ELSE) * size).any(axis=0)
        if not bent.any():
            break
        knots = np.sort(np.concatenate([knots, middle[bent]]))
    return knots


def _of(circuit: Model) -> Evaluated:
    """Return what gives each element, and dU/dT where it is known, at (soc,) and (temperature,): (temperature, soc)."""

    @jax.jit
    @jax.vmap
    def at(soc, celsius):
        cell = _cell(circuit, soc, celsius)
        c = cell.context
        values = (cell.open_circuit_voltage_V, c.series_resistance_ohm, c.R_TS, c.C_TS, c.R_TL, c.C_TL)
        found = dict(zip(ELEMENTS, values, strict=True))
        dU_dT = circuit.curves.dU_dT
        return found if dU_dT is None else found | {"dU_dT_V_K": dU_dT(soc, celsius)}

    def evaluated(soc: np.ndarray, celsius: np.ndarray) -> dict[str, np.ndarray]:
        points = np.stack([x.ravel() for x in np.meshgrid(soc, celsius)])
        points = np.pad(points, [(0, 0), (0, -points.shape[1] % _POINTS)], mode="edge")
        parts = [at(*jnp.asarray(points[:, first : first + _POINTS])) for first in range(0, points.shape[1], _POINTS)]
        joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return {name: x[: soc.size * celsius.size].reshape(celsius.size, soc.size) for name, x in joined.items()}

    return evaluated


def _cell(circuit: Model, soc, celsius) -> cells.Cell:
    state = {"soc": soc, "v_ts_V": jnp.zeros(()), "v_tl_V": jnp.zeros(())}
    return cells.evaluate(circuit.parameters, circuit.curves, circuit.effects, state, celsius)


def _usable_charge_C(circuit: Model, celsius: float) -> float:
    return float(_cell(circuit, jnp.asarray(0.5), jnp.asarray(celsius)).context.usable_charge_C)


def _with_one_row(values: np.ndarray) -> np.ndarray:
    """Return a table, of one row where the temperature does nothing."""
    same = np.abs(values - values[:1]) <= _ALIKE * np.abs(values).max()
    return values[:1] if same.all() else values


def _effects_left_out(effects: list[Effect], model: Model) -> tuple[str, ...]:
    sensors = sensors_of(model)
    names = [effect.label for effect in effects if effect not in sensors and "cell" in effect.kinds]
    if not names:
        return ()
    what = "an effect" if len(names) == 1 else "effects"
    return (f"The circuit is without {', '.join(names)}, {what} with states of its own or that acts by the current.",)


def _of_kind(case: Case) -> tuple[str, ...]:
    if case.kind == "cell":
        return ()
    return ("It is one cell of the pack of a robot: motors, slope, electronics and the number of cells are left out.",)
