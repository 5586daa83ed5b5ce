"""Hardware by name: the paper's robot, and real cells and motors, each a TOML file of this folder.

A preset states the parameters of one piece of hardware, in the form of a case's `[parameters]`, with sd and source.
Other values are those of the paper. A file of the same form is a preset too: its name ends in `.toml`.
"""

from __future__ import annotations

import dataclasses
import functools
import tomllib
from importlib import resources
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from jaxmodel.case_schema import ParametersEntry
from jaxmodel.errors import UserError, nearest
from jaxmodel.known import Known, Table, scalars, tables

Kind = Literal["cell", "motor", "robot"]
# The titles are here too, so that listing the presets, or using that of the paper, opens no file.
PRESETS = {
    "paper": "the robot of the paper: 6S1P 5.2 Ah pack, two maxon RE50 motors",
    "samsung_30q": "Samsung INR18650-30Q, 3.0 A h",
    "lg_mj1": "LG INR18650-MJ1 that gave 2.9 A h",
    "k2_lfp_26650": "K2 Energy 26650 LFP, 2.2 A h",
    "panasonic_18650pf": "Panasonic NCR18650PF, 2.9 A h",
    "hobby_servo_s3315d": "HJ S3315D hobby servo with its gear, 7 V",
    "prony_gearmotor": "an unnamed 12 V gear motor measured on a brake",
}


class HeldOut(BaseModel):
    """RMS error of the preset on a run that was not used for it, in the column's unit."""

    model_config = ConfigDict(extra="forbid", strict=True)

    run: str
    column: str
    rms: float


class PresetForm(BaseModel):
    """The content of a preset file."""

    model_config = ConfigDict(extra="forbid", strict=True)

    title: str
    kinds: list[Kind]
    data: str
    licence: str
    parameters: ParametersEntry
    held_out: list[HeldOut] = []


@dataclasses.dataclass(frozen=True, eq=False)
class Preset:
    """One piece of hardware.

    Attributes:
        name: a key of `PRESETS`, or the path of a file.
        kinds: kinds of model for which it can be used.
        parameters: scalar parameters by name.
        tables: curves by name.
    """

    name: str
    kinds: tuple[Kind, ...]
    parameters: dict[str, Known]
    tables: dict[str, Table]


def located(name: str, folder: Path) -> str:
    """Return the name of a preset; that of a file as its path, which is relative to a folder where it is stated."""
    return str((folder / name).resolve()) if name.endswith(".toml") else name


def read_form(name: str) -> PresetForm:
    """Return the content of a preset except the paper's, with data set, licence and errors on held-out runs."""
    file = Path(name) if name.endswith(".toml") else resources.files(__name__) / f"{name}.toml"
    return PresetForm.model_validate(tomllib.loads(file.read_text(encoding="utf-8")))


def read_preset(name: str) -> Preset:
    """Return a preset by its name: a key of `PRESETS`, or the path of a file."""
    return _of_form(name) if name.endswith(".toml") else _of_package(name)


@functools.cache
def _of_package(name: str) -> Preset:
    return Preset(name, ("cell", "motor", "robot"), {}, {}) if name == "paper" else _of_form(name)


def _of_form(name: str) -> Preset:
    form = read_form(name)
    numbers = scalars(form.parameters.__pydantic_extra__, f"preset '{Path(name).name}'")
    return Preset(name, tuple(form.kinds), numbers, tables(form.parameters))


def why_not(name: str, kind: str) -> str:
    """Return why a preset cannot be used for a kind of model, as a sentence; '' if it can."""
    label = Path(name).name
    if name.endswith(".toml"):
        if not Path(name).is_file():
            return f"there is no file '{label}' where the preset is sought ({Path(name).parent}); correct its name."
        try:
            title, kinds = read_form(name).title, read_preset(name).kinds
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, first["loc"])) or "the file"
            return (
                f"preset '{label}': {place} is wrong: {first['msg']}; it has the form of the files in jaxmodel/presets."
            )
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, UserError) as error:
            return f"preset '{label}' cannot be read: {error}"
    elif name not in PRESETS:
        return f"no preset is called '{name}'.{nearest(name, PRESETS)}"
    else:
        title, kinds = PRESETS[name], read_preset(name).kinds
    if kind in kinds:
        return ""
    return f"preset '{label}' ({title}) serves kind {' and '.join(kinds)}, not '{kind}'; use another of the two."
