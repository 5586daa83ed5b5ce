"""Whether a user's options of an import can be: known words, numbers within range, nothing that contradicts another."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import get_args

from jaxmodel.base.errors import MeasurementError, instead, nearest
from jaxmodel.case.brushless import FACTOR, WAYS
from jaxmodel.case.measurements import (
    AMBIENT_RANGE_DEGC,
    COLUMNS_OF_LAWS,
    KINDS,
    OPEN,
    REFERENCES,
    SET_BY,
    vocabulary,
)
from jaxmodel.data.importing.options import Kind, Options, Sign, SplitAt
from jaxmodel.data.importing.roles import ONLY_STATED, ROLES
from jaxmodel.effects.controllers import CONTROLLERS
from jaxmodel.effects.loads import LAWS
from jaxmodel.model.declaration import describe

_KELVIN = 273.15
_CONSTANTS = set().union(*WAYS.values())


def checked(options: Options, kind: Kind) -> Options:
    """Return options whose words are known, whose numbers can be, and that fit each other and the kind.

    Args:
        options: decisions of the user.
        kind: of the case.

    Raises:
        MeasurementError: one does not; the first is said.
        ParameterError: a number of a load or controller is outside its range.
    """
    for problem in itertools.chain(
        _words(options),
        _numbers(options),
        _of_kind(options, kind),
        _of_loads_and_loops(options),
        _of_columns(options, kind),
        _of_specimens(options),
    ):
        raise MeasurementError(problem)
    return options


def _words(options: Options) -> Iterator[str]:
    for name, given, known in (
        ("sign", options.sign, get_args(Sign)),
        ("split_at", options.split_at, get_args(SplitAt)),
        ("decimal", options.decimal, (".", ",")),
        ("load", options.load, ("measured", "unknown", *COLUMNS_OF_LAWS)),
        ("drive", options.drive, tuple(SET_BY)),
        ("controller", options.controller, tuple(REFERENCES)),
        ("brushless", options.brushless, tuple(FACTOR)),
    ):
        if given is not None and given not in known:
            yield f"{name}: there is no '{given}'; use {' or '.join(known)}.{nearest(str(given), known)}"


def _numbers(options: Options) -> Iterator[str]:
    for name, value, low, high in (
        ("rest_minutes", options.rest_minutes, 0.0, 1e6),
        ("capacity_Ah", options.capacity_Ah, 1e-6, 1e6),
        ("initial_soc", options.initial_soc, 0.0, 1.0),
        ("seconds_per_row", options.seconds_per_row, 1e-9, 1e9),
        ("cells_in_series", options.cells_in_series, 1, 10_000),
        ("parallel_cells", options.parallel_cells, 1, 10_000),
        *(("ambient", value, *AMBIENT_RANGE_DEGC) for value in (options.ambient, *options.ambients.values())),
    ):
        if value is not None and not low <= value <= high:
            todo = "correct it"
            if name == "ambient" and low <= value - _KELVIN <= high:
                todo = f"it is in degC: if this is kelvin, state {value - _KELVIN:.5g}"
            if name == "initial_soc" and 1.0 < value <= 100.0:
                todo = f"it is a fraction: if this is in percent, state {value / 100.0:g}"
            yield f"{name}: {value!s:.40} is not within {low:g} and {high:g}; {todo}."


def _of_kind(options: Options, kind: Kind) -> Iterator[str]:
    if kind != "motor" and options.motors:
        yield f"motor: a log is parted into its motors with --kind motor; remove it for a {kind}."
    if kind != "cell" and options.each_cell:
        yield f"each cell: cells are parted with --kind cell; remove it for a {kind}."
    if kind == "cell" and options.load:
        yield "load: a cell turns nothing; remove --load."
    if kind == "cell" and (options.brushless or options.brushless_numbers):
        yield "brushless: a cell turns nothing; remove --brushless."
    if kind != "motor" and options.servo != OPEN:
        yield f"drive: that of a {kind} is not modelled; remove --drive and --controller."
    if options.each_cell and options.cells_in_series > 1:
        yield "each cell: the voltage of a single cell is not divided; remove --each-cell or --cells-in-series."
    if options.each_cell and options.columns.get("voltage_V"):
        yield 'each cell: the columns of the cells are the voltages; remove --each-cell or --column voltage_V="...".'


def _of_loads_and_loops(options: Options) -> Iterator[str]:
    law, loop = LAWS.get(options.load or ""), CONTROLLERS.get(options.controller or "")
    for what, said, numbers, effect in (
        ("load", options.load, options.load_numbers, law),
        ("controller", options.controller, options.controller_numbers, loop),
    ):
        known = {} if effect is None else describe(effect)
        for name, value in numbers.items():
            if not said:
                yield f"{what}: '{name}' is a number of none; name one, as in --{what} NAME:{name}={value:g}."
            elif name not in known:
                yield f"{what}: {said} has no number '{name}'.{instead(name, known)}"
            else:
                known[name].check(value, f"{what}: {said}")
    for name, value in options.brushless_numbers.items():
        if not options.brushless:
            yield f"brushless: '{name}' is a number of none; name one, as in --brushless rms:{name}={value:g}."
        elif name not in _CONSTANTS:
            yield f"brushless: a motor has no constant '{name}'.{instead(name, _CONSTANTS)}"
        elif not value > 0.0:
            yield f"brushless: {name} = {value:g} is not above 0; correct it."
    if loop is not None and not options.controller_numbers:
        yield (
            f"controller: {options.controller} has no gains; state them, as in --controller "
            f"{options.controller}:k_p=10."
        )
    gains = [value for name, value in options.controller_numbers.items() if name != "limit"]
    if loop is not None and (not any(gains) or options.controller_numbers.get("limit") == 0.0):
        yield f"controller: with these numbers the output of {options.controller} is always 0; correct them."
    if loop is not None and options.load == "unknown":
        yield (
            "controller: the speed is an answer of the loop, and with --load unknown it drives the model; state what "
            "the load follows, or remove --controller."
        )


def _of_columns(options: Options, kind: Kind) -> Iterator[str]:
    """Yield what is stated of columns that the case does not have, as it is or with what is said of load and drive."""
    known = vocabulary(kind, options.load or "", options.servo).columns
    of_kind = {*ROLES[kind], *KINDS[kind].columns, *(ONLY_STATED if kind == "motor" else ())}
    said = [
        f"--{name} {value}"
        for name, value in (("load", options.load), ("drive", options.drive), ("controller", options.controller))
        if value
    ]
    named = [name for name, column in options.columns.items() if column and name != "position_rad"]  # tells the speed
    for option, names in (("column", named), ("constant", options.constants.keys())):
        for name in (name for name in names if name not in known):
            if name in ONLY_STATED and kind == "motor":
                loop = next(one for one, reference in REFERENCES.items() if reference == name)
                yield f"{option}: {name} is the input of a controller; state --controller {loop}:k_p=VALUE too."
            elif name in of_kind and said:
                yield f"{option}: with {' and '.join(said)} a {kind} has no {name}; remove one of them."
            elif option == "constant":
                yield f"{option}: a {kind} has no column '{name}'; it has {', '.join(known)}."


def _of_specimens(options: Options) -> Iterator[str]:
    for name, pattern in options.specimens.items():
        if not pattern:
            yield f'specimen: {name} has no pattern of files; state one, as in --specimen {name}="{name}_*".'
    if options.specimens and options.each_cell:
        yield "specimen: with --each-cell the columns tell the cells; remove one of them."
    if len(options.specimens) == 1:
        (name,) = options.specimens
        yield (
            f"specimen: only {name} is stated, and there is nothing to compare it with; state another with --specimen "
            "NAME=PATTERN, or none."
        )
