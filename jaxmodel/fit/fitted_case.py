"""A calibrated model as a case: its numbers, effects and starts of runs, and tables with its curves in them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.case.build import case_model
from jaxmodel.case.known import Known, Specimen
from jaxmodel.case.records import Case, Run
from jaxmodel.case.specimens import difference_label
from jaxmodel.effects.differences import DIFFERENCES
from jaxmodel.fit.estimates import CurveAtKnots, Estimate
from jaxmodel.fit.tables import corrected_motor_tables, corrected_tables
from jaxmodel.model.declaration import ParameterInfo, describe
from jaxmodel.model.parameters import info
from jaxmodel.model.ports import Effect

STARTS = ("initial_temperature_rise_K", "initial_hysteresis")
# Share of a usual size by which a number at the end of what is possible may be beyond it. Assumed.
_ROUNDED = 1e-8
# Curves of one number that effects of a case hold.
DETAILS = ("series_energy", "short_energy", "long_energy", "short_heat", "long_heat", "convection_curve")


def fitted_case(
    case: Case,
    fitted: FittedNumbers,
    added: Sequence[str] = (),
    curves: Sequence[CurveAtKnots] = (),
    *,
    between: bool = True,
    differ: Sequence[str] = (),
) -> tuple[Case, list[str]]:
    """Return the case with a model's parameters, effects, starts and tables, each with its sd; and notes on its tables.

    Notes on numbers that had to change are among those of `fitted`.

    Args:
        case: as it was fitted.
        fitted: the numbers of the model.
        added: effects of the model that the case does not have.
        curves: its corrections of tables and relations; unknown laws are left out.
        between: tables get points between the knots of a curve, where a line between these is not accurate enough.
        differ: differences of specimens in the model that the case does not have, as 'resistance_difference@left'.
    """
    catalogue = case.catalogue
    values = {name: dict(of_effect) for name, of_effect in case.effects.items()}
    effect_sd = {name: dict(of_effect) for name, of_effect in case.effect_sd.items()}
    for name, sds in case.effect_sd.items():
        column = case.effects[name].get("column")
        fitted.put_effect(f"{name}:{column}" if column else name, list(sds), catalogue, values, effect_sd)
    for label in added:
        name = label.partition(":")[0]
        if name in values:
            fitted.notes.append(f"{label} is left out: a case file holds one effect of each name.")
        else:
            fitted.put_effect(label, list(describe(catalogue[name])), catalogue, values, effect_sd)
    _put_details(curves, values, catalogue, fitted)
    parameters = {name: fitted.known(name, before, info(name)) for name, before in case.parameters.items()}
    runs = [fitted.run(run) for run in case.runs]
    found = dataclasses.replace(case, parameters=parameters, effects=values, effect_sd=effect_sd, runs=tuple(runs))
    found = dataclasses.replace(found, specimens=_specimens(case, fitted, differ))
    tables, notes = corrected_tables(case_model(found, runs[0]), curves, between=between)
    cycles = {run.overrides["cycles"].value if "cycles" in run.overrides else None for run in runs}
    if "R_ints" in tables and len(cycles) > 1:
        notes.append(
            "The curve in R_ints is exact for the cycles of the first run and approximate for runs with other cycles."
        )
    motor_tables = case.motor_tables | corrected_motor_tables(case, curves)
    return dataclasses.replace(found, tables=case.tables | tables, motor_tables=motor_tables), notes


def _specimens(case: Case, fitted: FittedNumbers, differ: Sequence[str]) -> dict[str, Specimen]:
    """Return the specimens of a case with what each has of its own in a model."""
    found = {}
    for name, own in case.specimens.items():
        parameters = {one: fitted.known(f"{one}[{name}]", known, info(one)) for one, known in own.parameters.items()}
        values = {one: dict(numbers) for one, numbers in own.effects.items()}
        sd = {one: dict(numbers) for one, numbers in own.effect_sd.items()}
        labels = [difference_label(one, own.effects[one]) for one in own.effect_sd]
        labels += [label.partition("@")[0] for label in differ if label.partition("@")[2] == name]
        for label in labels:
            one = label.partition(":")[0]
            fitted.put_effect(label, list(describe(DIFFERENCES[one])), DIFFERENCES, values, sd, f"[{name}]")
        found[name] = Specimen(parameters, values, sd)
    return found


def _put_details(
    curves: Sequence[CurveAtKnots],
    values: dict[str, dict[str, float | str]],
    catalogue: Mapping[str, type[Effect]],
    fitted: FittedNumbers,
) -> None:
    """Put what no table holds among the effects: an activation energy of each resistance, and details of the heat."""
    at = dict.fromkeys(DETAILS, 0.0) | {curve.label: float(curve.value[0]) for curve in curves if curve.value.size}

    def put(name: str, field: str, more: float) -> float:
        """Add to a number of an effect within its bounds; return what was added."""
        if not more:
            return 0.0
        entry = describe(catalogue[name])[field]
        before = float(values[name].get(field, entry.default)) if name in values else 0.0
        now = fitted.bounded(f"{name}.{field}", before + more, entry)
        values.setdefault(name, {})[field] = now
        return now - before

    # The energy of the series resistance acts on the pairs too, and that of both pairs on the long one.
    energy = put("arrhenius_resistance", "E_a", at["series_energy"])
    energy += put("arrhenius_polarisation", "E_rc", at["short_energy"] - energy)
    put("arrhenius_long_polarisation", "E_l", at["long_energy"] - energy)
    for field, label in {"s": "short_heat", "l": "long_heat", "c": "convection_curve"}.items():
        put("heat_details", field, at[label])


class FittedNumbers:
    """Fitted parameters within their bounds, and notes on those that were changed."""

    def __init__(self, estimates: Mapping[str, Estimate]) -> None:
        """Take the estimates by name."""
        self._estimates = estimates
        self.notes: list[str] = []

    def number(self, name: str, before: float, entry: ParameterInfo) -> float:
        """Return the fitted value of a parameter, or its previous value."""
        return self.bounded(name, self._estimates[name].value if name in self._estimates else before, entry)

    def bounded(self, name: str, value: float, entry: ParameterInfo) -> float:
        """Return a value within the bounds of its table."""
        bounded = min(max(value, entry.lower), entry.upper)
        # A coordinate whose centre is at the end of what is possible comes within a billionth of an sd of it.
        if abs(bounded - value) > _ROUNDED * max(map(abs, entry.typical or (value,))):
            self.notes.append(f"{name} was fitted as {value:g}, outside its range; it is set to {bounded:g} here.")
        return bounded

    def sd(self, name: str, before: float | None) -> float | None:
        """Return the posterior sd of a parameter, or its previous sd if it was not fitted."""
        if name not in self._estimates:
            return before
        sd = float(self._estimates[name].sd)
        return sd if np.isfinite(sd) and sd > 0.0 else None

    def known(self, name: str, before: Known, entry: ParameterInfo) -> Known:
        """Return a parameter with its sd."""
        return Known(self.number(name, before.value, entry), self.sd(name, before.sd))

    def put_effect(
        self,
        label: str,
        fields: list[str],
        catalogue: Mapping[str, type[Effect]],
        values: dict[str, dict[str, float | str]],
        effect_sd: dict[str, dict[str, float]],
        of: str = "",
    ) -> None:
        """Put the fitted parameters of an effect among the values and sd of a case's effects.

        Args:
            label: of the effect, with its column where it has one.
            fields: its parameters.
            catalogue: effects by name.
            values: of the effects, by name and parameter.
            effect_sd: of these values.
            of: what its estimates have after their name: the specimen in brackets.
        """
        name, _, column = label.partition(":")
        table = describe(catalogue[name])
        own = values.setdefault(name, {})
        for field in fields:
            known = f"{label}.{field}{of}"
            if known not in self._estimates:
                continue
            own[field] = self.number(known, 0.0, table[field])
            effect_sd.setdefault(name, {}).pop(field, None)
            sd = self.sd(known, None)
            if sd is not None:
                effect_sd[name][field] = sd
        own |= {"column": column} if column else {}
        if not effect_sd.get(name):
            effect_sd.pop(name, None)

    def run(self, run: Run) -> Run:
        """Return a run with its own fitted parameters, including those of its start."""
        known = run.overrides | {"initial_soc": run.initial_soc}
        known |= {name: Known(0.0) for name in STARTS if f"{name}[{run.name}]" in self._estimates and name not in known}
        values = {name: self.known(f"{name}[{run.name}]", before, info(name)) for name, before in known.items()}
        # A stated temperature and a fitted rise are the same quantity; a case file holds one of them.
        stated = None if STARTS[0] in values else run.initial_cell_temperature
        soc = values.pop("initial_soc")
        return dataclasses.replace(run, initial_soc=soc, overrides=values, initial_cell_temperature=stated)
