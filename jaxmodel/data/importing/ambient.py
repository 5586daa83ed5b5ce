"""The ambient temperature of a run: its column, the user, the name of its file, or what its thermometer begins with."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log

# 'p25degC', 'n20degC', '-10 degC', 'Cell25degC', 'minus5degC', '25°C'. A letter is a sign where no word ends in it:
# between words, or where upper and lower case meet. A dash after a letter or digit only separates.
_SIGN = (
    r"(?:(?P<word>minus|negative|neg|plus)[ _-]{0,3}|(?:(?P<mark>\u2212|(?<![A-Za-z0-9])[pnm+-])"
    r"|(?P<letter>(?-i:(?<=[a-z])[PNM]|(?<=[A-Z])[pnm])))_?)?"
)
_NUMBER = r"(?<![\d.])(?P<number>\d{1,3}([.p]\d+)?)"
_DEGREES = re.compile(_SIGN + _NUMBER + r"[\s_-]{0,2}(deg(rees?)?_?\s?C|°\s?C|℃|celsius|grad)", re.IGNORECASE)
# Without "C" it may be an angle; without "deg" also a rate, so it must agree with the thermometer.
_BARE = re.compile(_SIGN + _NUMBER + r"[\s_-]{0,2}(deg(rees?)?|°)(?![A-Za-z])", re.IGNORECASE)
_TURNING = ("speed_rad_s", "position_rad", "incline_deg", "duty")
_LETTER = re.compile(r"(?<![A-Za-z0-9.])(?P<sign>[nm-]?)(?P<number>\d{1,2})_?C(?![A-Za-z0-9])")
_AGREE_K, _AGREE_OF_LETTER_K = 15.0, 8.0
THERMOMETERS = ("cell_temperature_degC", "case_temperature_degC", "winding_temperature_degC")
_COLDEST, _WARMEST = -90.0, 200.0
# An ambient temperature that is stated may differ by so much [K] from a name or a column, and from a thermometer of the
# hardware at rest.
_STATED_K, _AT_REST_K = 2.0, 5.0
# Of runs in one room a cell at rest begins within so much [K]: as a tolerance of a temperature is. Assumed.
_ONE_ROOM_K = 1.0
# Below this share of its largest current hardware rests.
_REST = 0.02
_CURRENTS = ("current_A", "pack_current_A", "motor_current_A")
# What a program sets; where fewer rows than this share have it, it is a message of its own.
_SET, _SENT = ("voltage_V", "duty", "V_set"), 0.2
_MOST_NAMED = 4  # runs in one sentence


def with_ambient(run: Log, stated: float | None, listed: float | None) -> tuple[Log, float | None]:
    """Return a run and its constant ambient temperature [degC]; None where it has a column, or nothing tells.

    Args:
        run: the run.
        stated: by the user.
        listed: by a list of files.
    """
    if stated is not None:
        columns = {name: values for name, values in run.columns.items() if name != "ambient_degC"}
        run = dataclasses.replace(run, columns=columns)
        return run.also(Decision("ambient_degC", run.name, f"{stated:g}", "stated", "user")), stated
    if "ambient_degC" in run.columns:
        return _filled(run), None
    if listed is not None:
        return run.also(Decision("ambient_degC", run.name, f"{listed:g}", "a list of files states it", "file")), listed
    first = first_reading(run)
    turns = any(name in run.columns for name in _TURNING)
    named, what = _named(run, first, turns)
    if named is not None:
        run = run.also(Decision("ambient_degC", run.name, f"{named:g}", f"the name of the {what} states it", "file"))
        if first is not None and abs(first - named) > 5.0:
            sentence = (
                f"{run.name}: the name of the {what} states {named:g} degC, and the thermometer begins at "
                f"{first:.1f} degC; "
                "it may have begun warm."
            )
            run = run.also(Finding("ambient", run.name, sentence, "warning", "ambient_degC"))
        return run, named
    if first is None:
        return run, None
    value = round(first, 1)
    why = "assumed: the first reading of its thermometer"
    sentence = (
        f"{run.name}: no ambient temperature was measured; {value:g} degC, the first reading of its "
        "thermometer, is taken for all of the run (--ambient)."
    )
    found = Finding("ambient", run.name, sentence, "warning", "ambient_degC")
    return run.also(Decision("ambient_degC", run.name, f"{value:g}", why, "assumed"), found), value


def contradictions(runs: Sequence[Log], stated: float, cells: bool) -> Iterator[Finding]:
    """Yield what speaks against an ambient temperature that the user states for all runs.

    Args:
        runs: with every column that the files have.
        stated: by the user [degC].
        cells: whether they are of a cell; what turns is often warm of an earlier run.
    """
    begins = {
        run.name
        for run, before in zip(runs, [None, *runs], strict=False)
        if before is None or before.source != run.source
    }

    def named(run: Log) -> float | None:
        return _named(run, None, any(name in run.columns for name in _TURNING))[0]

    def column(run: Log) -> float | None:
        values = run.columns.get("ambient_degC", np.zeros(0))
        return float(np.nanmedian(values)) if np.isfinite(values).any() else None

    evidence: tuple[tuple[str, str, float, Callable[[Log], float | None]], ...] = (
        ("what files or folders are called", "the names count", _STATED_K, named),
        ("the column of the ambient temperature", "the column counts", _STATED_K, column),
        ("the thermometer at rest", "each run takes its first reading", _AT_REST_K, at_rest),
    )
    told: set[str] = set()
    for source, instead, within, reading in evidence:
        read = [(run.name, value) for run in runs if (value := reading(run)) is not None and run.name not in told]
        if reading is at_rest:  # a later run of a file begins warm of the one before it
            read = [(name, value) for name, value in read if name in begins]
        apart = {name: value for name, value in read if abs(value - stated) > within}
        if not apart or (reading is at_rest and not cells and len(apart) < len(read)):
            continue
        told |= apart.keys()
        some = ", ".join(f"{name} ({value:.3g} degC)" for name, value in [*apart.items()][:_MOST_NAMED])
        more = f" and {len(apart) - _MOST_NAMED} more runs" if len(apart) > _MOST_NAMED else ""
        sentence = (
            f"--ambient {stated:g} contradicts {source} in {some}{more}, and an error of the ambient temperature looks "
            f"like missing physics; leave --ambient out, and {instead}."
        )
        numbers = {"stated_degC": stated, "runs": float(len(apart))}
        yield Finding("ambient contradicted", "", sentence, "warning", "ambient_degC", numbers=numbers)
    first = {run.name: value for run in runs if run.name in begins and (value := at_rest(run)) is not None}
    if cells and not told and first and max(first.values()) - min(first.values()) > _ONE_ROOM_K:
        (coldest, low), (warmest, high) = (of(first.items(), key=lambda one: one[1]) for of in (min, max))
        sentence = (
            f"--ambient {stated:g} is one temperature for all runs, and their cell rests at {low:.3g} degC when "
            f"{coldest} begins and at {high:.3g} degC when {warmest} does; leave --ambient out, and each run takes its "
            "first reading."
        )
        numbers = {"lowest_degC": low, "highest_degC": high}
        yield Finding("ambient contradicted", "", sentence, "warning", "ambient_degC", numbers=numbers)


def at_rest(run: Log) -> float | None:
    """Return the temperature of a run's hardware before its first load [degC]; None where it begins under load."""
    first = first_reading(run)
    current = next((run.columns[name] for name in _CURRENTS if name in run.columns), None)
    if first is None or current is None or not np.isfinite(current).any():
        return first
    loaded = np.abs(current) > _REST * np.nanmax(np.abs(current))
    rests = int(np.argmax(loaded)) if loaded.any() else loaded.size
    values = next(run.columns[name] for name in THERMOMETERS if name in run.columns)[:rests]
    return float(np.nanmedian(values)) if np.isfinite(values).any() else None


def _named(run: Log, first: float | None, turns: bool) -> tuple[float | None, str]:
    """Return the temperature that the names of a run's file and of its two folders state, and which of them does."""
    stem = run.source.stem
    names = [("file", run.name if run.name.startswith(stem) else stem)]
    names += [("folder", folder.name) for folder in run.source.resolve().parents[:2]]
    for what, name in names:
        if (value := temperature_in(name, first, turns)) is not None:
            return value, what
    return None, ""


def temperature_in(name: str, first: float | None, turns: bool = False) -> float | None:
    """Return the temperature that a name states [degC], None if it states none or another than the thermometer's.

    Args:
        name: of a file or folder.
        first: the first reading of a thermometer [degC], if there is one.
        turns: whether its log is of something that turns, so that degrees alone may be an angle.
    """
    name = re.sub("_+", "_ ", name)
    for pattern, within in ((_DEGREES, _AGREE_K), (_BARE, _AGREE_K), (_LETTER, _AGREE_OF_LETTER_K)):
        for found in pattern.finditer(name) if not (turns and pattern is _BARE) else ():
            value = float(found["number"].lower().replace("p", "."))
            signs = found.groupdict()
            sign = next((signs[name] for name in ("sign", "word", "mark", "letter") if signs.get(name)), "+")
            value = value if sign[0].lower() in "p+" else -value
            if first is None and pattern is _LETTER:
                continue
            if (first is None or abs(first - value) <= within) and _COLDEST <= value <= _WARMEST:
                return value
    return None


def first_reading(run: Log) -> float | None:
    """Return the first reading of the run's thermometer [degC]."""
    for name in THERMOMETERS:
        values = run.columns.get(name)
        if values is not None and np.isfinite(values).any():
            return float(values[np.isfinite(values)][0])
    return None


def _filled(run: Log) -> Log:
    """Return a run whose ambient temperature has no gaps."""
    return fill(run, "ambient_degC")


def fill(run: Log, name: str) -> Log:
    """Return a run without gaps in an input: interpolated between its neighbours, and held at the ends.

    What is set seldom, as by messages of their own, is held until it is set anew.
    """
    values = run.columns[name]
    there = np.isfinite(values)
    if there.all():
        return run
    lost = int((~there).sum())
    weight = "warning" if lost > 0.01 * there.size else "note"
    sentence = f"{run.name}: {name} is missing in {lost:,} of {there.size:,} rows; an input has no gaps, so it is "
    if name in _SET and there.mean() < _SENT:  # a message that is sent when it changes
        last = np.maximum.accumulate(np.where(there, np.arange(there.size), -1))
        filled = np.where(last < 0, 0.0, values[last])
        sentence += "held until it is set anew, and 0 before it is set."
    else:
        filled = np.interp(run.time_s, run.time_s[there], values[there])
        sentence += "interpolated between its neighbours."
    found = Finding("gap in an input", run.name, sentence, weight, name, numbers={"rows": float(lost)})
    return dataclasses.replace(run, columns=run.columns | {name: filled}).also(found)
