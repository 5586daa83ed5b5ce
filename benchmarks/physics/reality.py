"""A cell as PyBaMM knows it: parameter values of a recipe, and the voltage and temperature of a run."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.physics.draw import REFERENCE_DEGC, Recipe
from benchmarks.physics.sets import SETS
from jaxmodel.base.errors import UserError

GAS_J_MOL_K, ZERO_DEGC_IN_K = 8.314, 273.15
REFERENCE_K = REFERENCE_DEGC + ZERO_DEGC_IN_K
# Of IDA; seen: a drive cycle is within 0.03 mV of what 1e-7 gives.
RELATIVE, ABSOLUTE = 1e-5, 1e-6
# Of the first state of a composite electrode: with 1e-6 a full one is 5 mV off, and PyBaMM does not start there.
STATE = 1e-12
# Half of PyBaMM's points across the electrodes, which is twice as fast. What they differ by is in all of a cell's runs.
POINTS = {"x_n": 12, "x_s": 8, "x_p": 12}
# Of sets that state no current collectors: thickness (m) and conductivity (S/m) of foils, copper's and aluminium's.
FOILS = {"Negative": (1e-5, 5.9e7), "Positive": (1.5e-5, 3.6e7)}
RAMP_S = 0.05  # in which a step of current is made; assumed, a bench needs some 10 ms
VOLUME_M3_AH = 8e-6  # any: heat capacity and heat transfer are stated for the whole cell
EMPTY, FULL = 0.02, 0.999  # between the limits of the open-circuit voltage: at them PyBaMM does not start
BRANCHES = ("lithiation", "delithiation")
ELECTRODES = {"negative": "Negative", "positive": "Positive"}
KINETICS = (
    "Negative electrode exchange-current density [A.m-2]",
    "Primary: Negative electrode exchange-current density [A.m-2]",
    "Secondary: Negative electrode exchange-current density [A.m-2]",
    "Positive electrode exchange-current density [A.m-2]",
    "Exchange-current density for lithium metal electrode [A.m-2]",
)
DIFFUSION = (
    "Negative particle diffusivity [m2.s-1]",
    "Primary: Negative particle diffusivity [m2.s-1]",
    "Secondary: Negative particle diffusivity [m2.s-1]",
    "Positive particle diffusivity [m2.s-1]",
)
ELECTROLYTE = ("Electrolyte diffusivity [m2.s-1]", "Electrolyte conductivity [S.m-1]")
ENTROPY = (
    "Negative electrode OCP entropic change [V.K-1]",
    "Primary: Negative electrode OCP entropic change [V.K-1]",
    "Secondary: Negative electrode OCP entropic change [V.K-1]",
    "Positive electrode OCP entropic change [V.K-1]",
)


_STATES: dict[tuple[Any, ...], dict[str, float]] = {}


class NotSimulated(Exception):
    """A simulation failed or ended too early; the message says how."""


def pybamm_of_peers() -> Any:
    """Return PyBaMM, quiet.

    Raises:
        UserError: it is not installed.
    """
    try:
        import pybamm  # pyrefly: ignore
    except ImportError as error:
        raise UserError(
            "Cells are simulated by PyBaMM, which is not installed: pip install -e '.[test,peers]' -c constraints.txt."
        ) from error
    pybamm.set_logging_level("ERROR")
    return pybamm


@dataclasses.dataclass(frozen=True, eq=False)
class Trace:
    """What a simulation gives at rows; shorter than asked where the cell reached a limit of its voltage.

    Attributes:
        time_s: (rows,).
        current_A: (rows,); holds over the step that ends at a row.
        voltage_V: (rows,).
        temperature_degC: (rows,).
    """

    time_s: np.ndarray
    current_A: np.ndarray
    voltage_V: np.ndarray
    temperature_degC: np.ndarray


class Reality:
    """The cell of a recipe.

    Attributes:
        size: electrodes in parallel for each of the set's, so that the capacity is the recipe's.
    """

    def __init__(self, recipe: Recipe, without: str = "", size: float | None = None) -> None:
        """Prepare a cell.

        Args:
            recipe: of the cell.
            without: of `Recipe.hidden`, what is switched off: the twin.
            size: electrodes in parallel for each of the set's, where it is known of the twin.
        """
        self._pybamm = pybamm_of_peers()
        self._recipe, self._set = recipe, SETS[recipe.parameter_set]
        self._without = without
        warnings.filterwarnings("ignore", module="pybamm")
        self.size = 1.0
        self.size = recipe.capacity_Ah / self._own_Ah() if size is None else size

    def run(
        self,
        time_s: np.ndarray,
        current_A: np.ndarray,
        first_soc: float,
        ambient_degC: float,
        *,
        at_reference: bool = False,
        after: str = "discharge",
    ) -> Trace:
        """Return what a run gives, from equilibrium.

        Args:
            time_s: (rows,) from zero.
            current_A: (rows,) that holds over the step that ends at a row, positive on discharge.
            first_soc: between the set's limits.
            ambient_degC: of the chamber; the cell begins with it.
            at_reference: whether the cell keeps that temperature whatever it gives off, as in the base's tests.
            after: "discharge" or "charge", which led to the first state: the branch of a loop that it begins on.

        Raises:
            NotSimulated: PyBaMM did not find a solution.
        """
        try:
            return self._solve(time_s, current_A, first_soc, ambient_degC, at_reference, after)
        except (ArithmeticError, RuntimeError, ValueError, self._pybamm.SolverError) as error:
            raise NotSimulated(_told(error)) from error

    def _own_Ah(self) -> float:
        """Return the charge between the set's limits of the open-circuit voltage, of its own cell."""
        held = []
        for soc in (EMPTY, FULL):
            simulation = self._simulation(np.array([0.0, 1.0]), np.zeros(2), soc, REFERENCE_DEGC, True, "discharge")
            try:
                solution = simulation.solve([0.0, 1.0])
            except (ArithmeticError, RuntimeError, ValueError, self._pybamm.SolverError) as error:
                raise NotSimulated(_told(error)) from error
            held.append(float(solution["Total lithium in positive electrode [mol]"].entries[0]))
        return abs(held[1] - held[0]) / (FULL - EMPTY) * self._pybamm.constants.F.value / 3600.0

    def _solve(
        self,
        time_s: np.ndarray,
        current_A: np.ndarray,
        first_soc: float,
        ambient_degC: float,
        at_reference: bool,
        after: str,
    ) -> Trace:
        simulation = self._simulation(time_s, current_A, first_soc, ambient_degC, at_reference, after)
        changes = time_s[:-1][np.diff(current_A) != 0.0]
        stops = np.unique(np.concatenate([[0.0], changes, changes + RAMP_S, time_s[-1:]]))
        solution = simulation.solve(stops, t_interp=time_s)
        last = float(solution.t[-1])
        kept = time_s <= last + 1e-6
        at = np.minimum(time_s[kept], last)
        voltage, kelvin = (
            np.interp(at, solution.t, solution[name].entries)  # the solution has every row
            for name in ("Voltage [V]", "Volume-averaged cell temperature [K]")
        )
        return Trace(at, current_A[kept], voltage, kelvin - ZERO_DEGC_IN_K)

    def _simulation(
        self,
        time_s: np.ndarray,
        current_A: np.ndarray,
        first_soc: float,
        ambient_degC: float,
        at_reference: bool,
        after: str,
    ) -> Any:
        pybamm, isothermal = self._pybamm, at_reference or self._recipe.heat == "isothermal" or self._without == "heat"
        options = self._options("isothermal" if isothermal else "lumped")
        model = getattr(pybamm.lithium_ion, self._recipe.model)(options)
        values = self._values(ambient_degC)
        changes = np.flatnonzero(np.diff(current_A) != 0.0)
        at = np.concatenate([[-1.0], np.ravel(np.column_stack([time_s[changes], time_s[changes] + RAMP_S]))])
        ampere = np.concatenate(
            [[current_A[0]], np.ravel(np.column_stack([current_A[changes], current_A[changes + 1]]))]
        )
        at, ampere = np.append(at, time_s[-1] + 1e4), np.append(ampere, current_A[-1])
        values["Current function [A]"] = pybamm.Interpolant(at, ampere, pybamm.t, interpolator="linear")
        direction = after if "hysteresis" in str(options.get("open-circuit potential", "")) else None
        values.update(self._state(first_soc, direction, model))
        solver = pybamm.IDAKLUSolver(rtol=RELATIVE, atol=ABSOLUTE)
        points = {**model.default_var_pts, **{name: POINTS[name] for name in POINTS if name in model.default_var_pts}}
        return pybamm.Simulation(model, parameter_values=values, solver=solver, var_pts=points)

    def _state(self, soc: float, direction: str | None, model: Any) -> dict[str, float]:
        """Return the initial concentrations at a state of charge; they do not depend on the temperature.

        Without a composite electrode they are straight lines of the state of charge.
        """
        if self._set.composite:
            return self._solved_state(soc, direction, model)
        ends = [self._solved_state(end, direction, model) for end in (EMPTY, FULL)]
        share = (soc - EMPTY) / (FULL - EMPTY)
        return {name: value + share * (ends[1][name] - value) for name, value in ends[0].items()}

    def _solved_state(self, soc: float, direction: str | None, model: Any) -> dict[str, float]:
        """Return the same by PyBaMM, and keep it: the twins begin with it too."""
        key = (self._recipe.name, self._without == "hysteresis", soc, direction)
        if key not in _STATES:
            from pybamm.models.full_battery_models.lithium_ion.initial_state import set_initial_state  # pyrefly: ignore

            values = self._values(REFERENCE_DEGC)
            before = dict(values)
            set_initial_state(
                soc,
                values,
                direction=direction,
                param=model.param,
                options=model.options,
                **({"tol": STATE} if self._set.composite else {}),
            )
            _STATES[key] = {
                name: float(value)
                for name, value in dict(values).items()
                if "Initial" in name and (name not in before or before[name] is not value)
            }
        return _STATES[key]

    def _options(self, thermal: str) -> dict[str, Any]:
        """Return the options of the model; everything else is PyBaMM's default, so heat of mixing is not counted."""
        options: dict[str, Any] = {"thermal": thermal}
        if thermal == "lumped":
            options["use lumped thermal capacity"] = "true"
        if self._set.half_cell:
            options["working electrode"] = "positive"
        if self._set.composite:
            options["particle phases"] = ("2", "1")
        loop = "none" if self._without == "hysteresis" else self._recipe.hysteresis
        law = "one-state hysteresis"
        if loop == "silicon":
            options["open-circuit potential"] = (("single", law), "single")
        elif loop == "positive":
            options["open-circuit potential"] = ("single", law)
        elif loop == "negative":
            options["open-circuit potential"] = (law, "single")
        return options

    def _values(self, ambient_degC: float) -> Any:
        recipe = self._recipe
        values = self._pybamm.ParameterValues(recipe.parameter_set)
        own = "Number of electrodes connected in parallel to make a cell"
        volume = VOLUME_M3_AH * recipe.capacity_Ah
        kelvin = ambient_degC + ZERO_DEGC_IN_K
        changed = {
            own: float(values[own]) * self.size,
            "Nominal cell capacity [A.h]": recipe.capacity_Ah,
            "Ambient temperature [K]": kelvin,
            "Initial temperature [K]": kelvin,
            "Reference temperature [K]": REFERENCE_K,
            "Cell volume [m3]": volume,
            "Cell cooling surface area [m2]": 1.0,
            "Cell heat capacity [J.K-1.m-3]": recipe.heat_capacity_J_K / volume,
            "Total heat transfer coefficient [W.m-2.K-1]": recipe.heat_capacity_J_K / recipe.cooling_s,
        }
        for of, (thickness, conductivity) in FOILS.items():
            foil = {f"{of} current collector thickness [m]": thickness}
            foil |= {f"{of} current collector conductivity [S.m-1]": conductivity}
            changed |= {key: value for key, value in foil.items() if key not in values}
        energies = recipe.energies_J_mol if self._without != "activation" else dict.fromkeys(recipe.energies_J_mol, 0.0)
        for what, names in (("kinetics", KINETICS), ("diffusion", DIFFUSION), ("electrolyte", ELECTROLYTE)):
            changed |= {name: self._activated(values[name], energies[what]) for name in names if name in values}
        if recipe.entropy != "bundled" or self._without == "entropy":
            changed |= {name: 0.0 for name in ENTROPY if name in values}
            if recipe.entropy == "constant" and self._without != "entropy":
                changed[ENTROPY[-1]] = recipe.entropy_V_K
        values.update(changed | self._loop(values), check_already_exists=False)
        return values

    def _loop(self, values: Any) -> dict[str, Any]:
        """Return the branches and the decay of a loop; of silicon the set has the branches."""
        recipe = self._recipe
        if recipe.hysteresis == "none":
            return {}
        if recipe.hysteresis == "silicon":
            of, found = "Secondary: Negative", {}
        else:
            of = ELECTRODES[recipe.hysteresis]
            middle = values[f"{of} electrode OCP [V]"]
            found = {
                f"{of} electrode {branch} OCP [V]": _shifted(middle, sign * recipe.half_width_V)
                for branch, sign in (("lithiation", -1.0), ("delithiation", 1.0))
            }
        return found | {f"{of} particle {branch} hysteresis decay rate": recipe.decay for branch in BRANCHES}

    def _activated(self, law: Any, energy_J_mol: float) -> Callable[..., Any]:
        """Return a law of which the last argument is the temperature, with one activation energy in place of its own.

        k(x, T) = k(x, 298.15 K) exp(E / 8.314 (1 / 298.15 - 1 / T))
        """
        exp = self._pybamm.exp

        def found(*arguments: Any) -> Any:
            *others, kelvin = arguments
            at_reference = law(*others, REFERENCE_K) if callable(law) else law
            return at_reference * exp(energy_J_mol / GAS_J_MOL_K * (1.0 / REFERENCE_K - 1.0 / kelvin))

        return found


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


def _shifted(law: Any, by_V: float) -> Callable[..., Any]:
    """Return an open-circuit potential some volts higher."""

    def found(stoichiometry: Any) -> Any:
        return (law(stoichiometry) if callable(law) else law) + by_V

    return found
