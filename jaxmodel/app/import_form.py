"""What a form asks of an import: the options of `jaxmodel import`, with their words there, and who needs which."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import typing
from collections.abc import Mapping

import typer

from jaxmodel.app import import_command

KINDS = {"cell": "a battery cell", "motor": "a motor", "robot": "a robot: pack, bridge and motors"}
SIGNS = {
    "": "found from the voltage",
    "discharge-positive": "positive on discharge",
    "charge-positive": "positive on charge",
}
LOADS = {
    "": "the measured torque, else unknown",
    "free": "nothing",
    "propeller": "a propeller",
    "gravity": "a weight on an arm",
    "rolling": "a vehicle that rolls",
    "measured": "the measured torque or incline",
    "unknown": "unknown, whatever the file says",
}
DRIVES = {"": "what the columns say", "voltage": "the voltage", "current": "the current"}
BRUSHLESS = {"": "none: it has brushes", "rms": "the RMS of a phase", "peak": "the amplitude of a phase"}
CONTROLLERS = {"": "none", "position": "of the position", "speed": "of the speed"}
SPLITS = {
    "auto": "at each file",
    "rests": "at long rests too",
    "steps": "at each cycle or step too",
    "files": "at files only",
}
DECIMALS = {"": "found", ".": "a point", ",": "a comma"}
_TURNS, _CELLS = ("motor", "robot"), ("cell", "robot")


@dataclasses.dataclass(frozen=True)
class Field:
    """One option of an import on a form.

    Attributes:
        name: of `jaxmodel.data.importing.Options`.
        words: above it.
        option: of `jaxmodel import`, without its dashes.
        kinds: of hardware that it is shown for.
        choices: words by value; None for a text.
        is_flag: whether it is on or off.
        is_usual: whether it is seen at once.
        needs: a choice, and the values of it for which it is shown; None for always.
        form: of its text, where that of a shell differs.
    """

    name: str
    words: str
    option: str
    kinds: tuple[str, ...] = tuple(KINDS)
    choices: dict[str, str] | None = None
    is_flag: bool = False
    is_usual: bool = False
    needs: tuple[str, tuple[str, ...]] | None = None
    form: str = ""

    @property
    def hint(self) -> str:
        """What the command line says of it."""
        said = _options()[self.option]
        names = [one for one in said.param_decls or () if one.startswith("--")]
        option = names[0] if names else f"--{self.option.replace('_', '-')}"
        if self.form:
            return f"{option}, as {self.form}"
        if self.choices or self.is_flag:
            return option
        words = str(said.help).rstrip(".").replace("; repeatable", "; several by commas").replace(". Repeatable", "")
        return f"{option}: {words[:1].lower()}{words[1:]}"


FIELDS = (
    Field("ambient", "Ambient temperature [°C]", "ambient", is_usual=True),
    Field("ambients", "Ambient temperature of some files [°C]", "ambient", form="*_10c*=10, *_40c*=40"),
    Field("capacity_Ah", "Capacity [A h]", "capacity", ("cell",), is_usual=True),
    Field("initial_soc", "State of charge at the start, 0 to 1", "initial_soc", _CELLS, is_usual=True),
    Field("load", "The load is", "load", _TURNS, LOADS, is_usual=True),
    Field("load_numbers", "Numbers of the load", "load", _TURNS, is_usual=True,
          needs=("load", ("propeller", "gravity", "rolling")), form="mass_kg=0.5, arm_m=0.1"),
    Field("drive", "The drive sets", "drive", ("motor",), DRIVES, is_usual=True),
    Field("controller", "Controller", "controller", ("motor",), CONTROLLERS, is_usual=True),
    Field("controller_numbers", "Gains of the controller", "controller", ("motor",), is_usual=True,
          needs=("controller", ("position", "speed")), form="k_p=10, k_d=0.2, limit=10"),
    Field("brushless", "Current of a brushless motor", "brushless", _TURNS, BRUSHLESS),
    Field("brushless_numbers", "Constants of the brushless motor", "brushless", _TURNS,
          needs=("brushless", ("rms", "peak")), form="R_line_to_line_ohm=0.1, KV_rpm_per_V=170"),
    Field("specimens", "Files of several motors or cells", "specimen", ("cell", "motor"), is_usual=True,
          form="A=motorA_*, B=motorB_*"),
    Field("each_cell", "Each cell of a module is a run", "each_cell", ("cell",), is_flag=True),
    Field("motors", "Motors of one log", "motor", ("motor",)),
    Field("sign", "A positive current means", "sign", choices=SIGNS),
    Field("split_at", "Runs begin", "split_at", choices=SPLITS),
    Field("rest_minutes", "Shortest rest that ends a run [min]", "rest_minutes"),
    Field("check", "Held-out runs, by name or pattern", "check"),
    Field("seconds_per_row", "Seconds per row, without a clock", "seconds_per_row"),
    Field("cells_in_series", "Cells in series", "cells_in_series", _CELLS),
    Field("parallel_cells", "Cells in parallel", "parallel_cells", _CELLS),
    Field("preset", "Preset", "preset"),
    Field("units", "Units", "unit", form="COLUMN=UNIT, several by commas"),
    Field("constants", "Inputs that never change", "constant", form="load_torque_Nm=0, several by commas"),
    Field("rows", "Rows to import", "rows"),
    Field("flip", "Reversed columns", "flip"),
    Field("sheet", "Sheet, variable or key", "sheet"),
    Field("encoding", "Encoding of text", "encoding"),
    Field("delimiter", "Delimiter of text", "delimiter"),
    Field("decimal", "Decimal mark of text", "decimal", choices=DECIMALS),
    Field("title", "Title", "title"),
)  # fmt: skip


def shown(kind: str, is_usual: bool, made: Mapping[str, object]) -> list[Field]:
    """Return the fields of a form.

    Args:
        kind: of hardware.
        is_usual: those that are seen at once, or the others.
        made: what was chosen so far, by name.
    """
    return [
        one
        for one in FIELDS
        if kind in one.kinds
        and one.is_usual == is_usual
        and (one.needs is None or made.get(one.needs[0]) in one.needs[1])
    ]


@functools.cache
def _options() -> dict[str, typer.models.OptionInfo]:
    """Return what the command line says of each option, by parameter."""
    hints = typing.get_type_hints(import_command.import_, include_extras=True)
    said = {name: hints[name].__metadata__[0] for name in inspect.signature(import_command.import_).parameters}
    return {name: one for name, one in said.items() if isinstance(one, typer.models.OptionInfo)}
