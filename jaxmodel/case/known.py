"""Stated values of hardware, checked: numbers with their sd, and curves."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from jaxmodel.base.in_short import InShort
from jaxmodel.case.forms import KnownEntry, MotorTableEntry, ParametersEntry, TableEntry
from jaxmodel.model.parameters import info


@dataclasses.dataclass(frozen=True)
class Known(InShort):
    """A stated number: its value and standard deviation (None: exact).

    Example:
        >>> from jaxmodel import Known
        >>> Known(2.0, sd=0.05)
        Known(value=2.0, sd=0.05)
    """

    value: float
    sd: float | None = None


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Table(InShort):
    """A curve over SOC, or over SOC and temperature; linear between the points, held at the ends.

    Attributes:
        soc: strictly increasing states of charge, shape (soc,).
        values: V of `ocv`, ohm of `R_ints`, `R_TS` and `R_TL`, F of `C_TS` and `C_TL`, V/K of `dU_dT`; shape (soc,),
            or (temperature, soc) where `temperature_degC` is given.
        temperature_degC: strictly increasing temperatures, shape (temperature,), or None.
        sd: of the values: V of `ocv`, V/K of `dU_dT`, a share of the value of the others; None: exact.

    Example:
        >>> import numpy as np
        >>> from jaxmodel import Table
        >>> Table(soc=np.array([0.0, 0.5, 1.0]), values=np.array([3.2, 3.7, 4.2]), sd=0.005)
        <Table: soc=3 values, 0 to 1, values=3 values, 3.2 to 4.2, sd=0.005>
    """

    soc: np.ndarray
    values: np.ndarray
    temperature_degC: np.ndarray | None = None
    sd: float | None = None


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MotorTable(InShort):
    """A curve of a motor over the size of its speed or current; linear between the points, held at the ends.

    Attributes:
        at: strictly increasing, from 0 on, shape (points,): rad/s of `friction`, A of `torque_factor`.
        values: N m beside tau_0 of `friction`, a factor on k_tau i_a of `torque_factor`; shape (points,).
        sd: of the values: N m of `friction`, a share of the value of `torque_factor`; None: exact.
    """

    at: np.ndarray
    values: np.ndarray
    sd: float | None = None


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Specimen(InShort):
    """What one of several specimens has of its own.

    Attributes:
        parameters: of the case that are different in all its runs.
        effects: differences of `jaxmodel.effects.differences.DIFFERENCES`: their numbers, and the column of a sensor's.
        effect_sd: by difference and number, the sd of the value in `effects`; others are exact.
    """

    parameters: dict[str, Known] = dataclasses.field(default_factory=dict)
    effects: dict[str, dict[str, float | str]] = dataclasses.field(default_factory=dict)
    effect_sd: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """The acceptable error of a reading, in its unit: rms, and maximum (None: any)."""

    rms: float
    max: float | None = None


def scalars(entries: Mapping[str, KnownEntry], where: str) -> dict[str, Known]:
    """Return scalar parameters, checked against their bounds.

    Raises:
        ParameterError: one is unknown or outside its bounds.
    """
    return {name: Known(info(name, where).check(entry.value, where), entry.sd) for name, entry in entries.items()}


def tables(entries: ParametersEntry) -> dict[str, Table]:
    """Return the curves over the state of charge among `[parameters]`, by name."""
    return {name: _table(entry) for name, entry in entries if isinstance(entry, TableEntry)}


def motor_tables(entries: ParametersEntry) -> dict[str, MotorTable]:
    """Return the curves of a motor among `[parameters]`, by name."""
    return {
        name: MotorTable(np.array(entry.at, dtype=float), np.array(entry.values, dtype=float), entry.sd)
        for name, entry in entries
        if isinstance(entry, MotorTableEntry)
    }


def _table(entry: TableEntry) -> Table:
    temperature_degC = None if entry.temperature_degC is None else np.array(entry.temperature_degC, dtype=float)
    return Table(np.array(entry.soc, dtype=float), np.array(entry.values, dtype=float), temperature_degC, entry.sd)
