"""Several motors side by side in one log, such as left and right: their columns, by motor, as those of one motor."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence

from jaxmodel.base.errors import MeasurementError, instead, listed
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.one_specimen import OneSpecimen
from jaxmodel.data.importing.options import Options
from jaxmodel.data.importing.roles import roles_of
from jaxmodel.data.tables import RawTable
from jaxmodel.data.tables.raw_table import units_in

_FEWEST = 2
# A word begins after a separator or where small letters end, and ends before a separator or a capital.
_BEGIN, _END = r"(?:(?<![A-Za-z0-9])|(?<=[a-z])(?=[A-Z]))", r"(?![a-z0-9])"


def _any(*words: str) -> str:
    return "|".join(form for word in words for form in (word, word.capitalize(), word.upper()))


_ENDS = rf"(?:{_any('front', 'rear', 'back', 'middle')})"
_SIDES = rf"(?:{_any('left', 'right')})"
_CORNERS = {
    "fl": "front_left", "fr": "front_right", "rl": "rear_left", "rr": "rear_right", "bl": "back_left",
    "br": "back_right",
}  # fmt: skip
_NUMBERED = (
    "motor", "mot", "wheel", "propeller", "prop", "rotor", "esc", "axis", "joint", "servo", "actuator", "ODrive",
    "odrive", "odrv",
)  # fmt: skip
_MARK = re.compile(
    rf"{_BEGIN}(?:(?P<side>(?:{_ENDS}[\W_]?)?{_SIDES}(?:[\W_]?{_ENDS})?){_END}"
    rf"|(?P<corner>{'|'.join((*_CORNERS, *map(str.upper, _CORNERS)))})(?![A-Za-z0-9])"
    rf"|(?P<word>{_any(*_NUMBERED)})[ _.\[-]?(?P<number>\d{{1,2}})\]?"
    rf"(?![0-9])|[Mm](?P<short>\d{{1,2}})(?![A-Za-z0-9]))"
)
# What each of several motors has: one motor may have two thermometers.
_TELLING = {"current_A", "voltage_V", "speed_rad_s", "load_torque_Nm", "position_rad"}
# What a log has of all motors together is not that of one.
_OF_ONE = ("current_A", "load_torque_Nm")


def motors_in(names: Sequence[str], options: Options) -> dict[str, dict[str, str]]:
    """Return by motor its columns, and what each is called without its motor; empty where there is only one.

    Two motors have a column that differs in their name alone and is of a current, voltage, speed, torque or angle, or
    that a formula of the user names. Where the user names a column of one motor, that motor is meant already.

    Args:
        names: of the columns of a file.
        options: decisions of the user.
    """
    own, common = _numbered(names)
    if len(own) < _FEWEST or (not options.motors and _named(own, options)):
        return {}
    known = roles_of([*common], units_in(common), "motor", {})
    stated = " ".join(options.columns.values())
    is_of_motor = known.keys() & _TELLING or any(_word(bare).search(stated) for bare in common)
    return own if is_of_motor else {}


def meant(names: Sequence[str], options: Options) -> list[str]:
    """Return the columns of a file without those of other motors than the one of which the user names a column.

    Args:
        names: of the columns of a file.
        options: decisions of the user.
    """
    own, _ = _numbered(names)
    named = _named(own, options)
    if options.motors or len(own) < _FEWEST or len(named) != 1:
        return list(names)
    others = {name for motor, columns in own.items() if motor not in named for name in columns}
    return [name for name in names if name not in others]


def _numbered(names: Sequence[str]) -> tuple[dict[str, dict[str, str]], set[str]]:
    """Return by motor its columns with their names without it, and which of these names several motors have."""
    own: dict[str, dict[str, str]] = {}
    for name in names:
        motor, bare = _parted(name)
        if motor and bare not in own.get(motor, {}).values():
            own.setdefault(motor, {})[name] = bare
    counts: dict[str, int] = {}
    for columns in own.values():
        for bare in columns.values():
            counts[bare] = counts.get(bare, 0) + 1
    common = {bare for bare, count in counts.items() if count >= _FEWEST}
    return {motor: columns for motor, columns in own.items() if common & set(columns.values())}, common


def by_motor(table: RawTable, options: Options) -> list[OneSpecimen]:
    """Return the motors of a log, each with a table of its own; a log of one motor as it is.

    Args:
        table: of a file.
        options: decisions of the user.

    Raises:
        MeasurementError: the user chooses a motor that the file does not have.
    """
    own = motors_in([str(name) for name in table.frame], options)
    if not own:
        if options.motors:
            raise MeasurementError(
                f"{table.label}: motor: its columns are not of several motors, as left_... and right_... or motor1_... "
                "and motor2_... are; leave --motor out."
            )
        return [OneSpecimen("", table)]
    for motor in options.motors:
        if motor not in own:
            raise MeasurementError(f"{table.label}: motor: there is no '{motor}'.{instead(motor, own)}")
    chosen = [motor for motor in own if motor in options.motors] if options.motors else list(own)
    left, about_left = _of_all_together(table, own, options)
    named = chosen if len(chosen) > 1 else [""]
    motors = [OneSpecimen(name, _of_one(table, own, motor, left)) for name, motor in zip(named, chosen, strict=True)]
    called = listed(dict.fromkeys(bare for motor in chosen for bare in own[motor].values()), 6)
    why = f"columns name them, and are called {called} without it; each is a run, one alone is --motor {chosen[0]}"
    if options.motors:
        why = f"stated, of {listed(own, 6)}; without the motor its columns are called {called}"
    done = Decision("motors", table.label, listed(chosen, 6), why, "user" if options.motors else "file")
    return [dataclasses.replace(motors[0], found=(done, *about_left)), *motors[1:]]


def _parted(name: str) -> tuple[str, str]:
    """Return the motor that a column is of, and its name without it; ("", name) for none."""
    marks = list(_MARK.finditer(name))
    if not marks:
        return "", name
    bare = name
    for mark in reversed(marks):
        kept = mark["word"] or ""
        bare = f"{bare[: mark.start()]}{kept}{bare[mark.end() :]}"
    bare = re.sub(r"(?<=[\W_])_+|^[_\W]+|[_.\s-]+$", "", bare)
    return "_".join(map(_motor, marks)), bare


def _motor(mark: re.Match[str]) -> str:
    if mark["corner"]:
        return _CORNERS[mark["corner"].lower()]
    if not mark["side"]:
        return f"motor{int(mark['number'] or mark['short'])}"
    words = re.sub(r"[\W_]", "", mark["side"]).lower()
    side = "left" if "left" in words else "right"
    end = words.replace(side, "")
    return f"{end}_{side}" if end else side


def _named(own: Mapping[str, Mapping[str, str]], options: Options) -> list[str]:
    """Return the motors of which the user names a column, as the file has it."""
    texts = " ".join([*options.columns.values(), *options.units, options.rows or ""])
    return [motor for motor, columns in own.items() if any(_word(name).search(texts) for name in columns)]


def _word(name: str) -> re.Pattern[str]:
    return re.compile(rf"(?<!\w){re.escape(name)}(?!\w)")


def _of_all_together(
    table: RawTable, own: Mapping[str, Mapping[str, str]], options: Options
) -> tuple[list[str], list[Finding | Decision]]:
    """Return the columns of all motors that would be taken for those of one, and what is said of them."""
    of_motors = {name for columns in own.values() for name in columns}
    shared = [str(name) for name in table.frame if str(name) not in of_motors]
    roles = roles_of(shared, {**units_in(shared), **table.units}, "motor", {})
    left, found = [], []
    for target in _OF_ONE:
        role = roles.get(target)
        if role is None or target in options.columns:
            continue
        left.append(role.column)
        sentence = (
            f"{table.label}: column '{role.column}' is of all {len(own)} motors together, and {target} is of one; it "
            f'is left out. If they share it evenly, state --column "{target}={role.column}/{len(own)}".'
        )
        found.append(Finding("of all motors", table.label, sentence, "warning", target))
    return left, found


def _of_one(table: RawTable, own: Mapping[str, Mapping[str, str]], motor: str, left: Sequence[str]) -> RawTable:
    """Return the table of one motor."""
    mine = own[motor]
    others = {name for columns in own.values() for name in columns} - mine.keys()
    dropped = [name for name in table.frame if name in others or name in left or name in mine.values()]
    frame = table.frame.drop(columns=[name for name in dropped if name not in mine]).rename(columns=mine)

    def renamed(of_columns: Mapping[str, str]) -> dict[str, str]:
        return {mine.get(name, name): text for name, text in of_columns.items() if mine.get(name, name) in frame}

    return dataclasses.replace(table, frame=frame, units=renamed(table.units), plain=renamed(table.plain))
