"""Hardware by name: the paper's robot, and real cells, each a TOML file of this folder.

LICENSE-DATA states the source and the licence of each. Data whose licence is not known give no preset of the package.

A preset states the parameters of one piece of hardware, in the form of a case's `[parameters]`, with sd and source.
Other values are those of the paper. A file of the same form is a preset too: its name ends in `.toml`.
"""

from __future__ import annotations

import dataclasses
import functools
import os
from importlib import resources
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from jaxmodel.base import toml
from jaxmodel.base.errors import ParameterError, UserError, instead
from jaxmodel.base.forms import Form, complaint
from jaxmodel.case.forms import CutoffEntry, ParametersEntry
from jaxmodel.case.known import Known, Table, scalars, tables
from jaxmodel.case.measurements import read_utf8

Kind = Literal["cell", "motor", "robot"]
# The titles are here too, so that listing the presets, or using that of the paper, opens no file.
PRESETS = {
    "paper": "the robot of the paper: 6S1P 5.2 Ah pack, two maxon RE50 motors",
    "samsung_30q": "Samsung INR18650-30Q, 3.0 A h",
    "lg_mj1": "LG INR18650-MJ1 that gave 2.9 A h",
    "k2_lfp_26650": "K2 Energy 26650 LFP, 2.2 A h",
    "coreless_7x16": "7x16 mm coreless motor of a Crazyflie 2.1",
}
# The paper states no voltage at which its pack is empty: 2.7 V of a cell is assumed, as data sheets of lithium polymer
# cells state it (Kokam, SLPB). With it the robot drives for the half hour of each of its tests at 20 degC.
_CUTOFF_OF_THE_PAPER = {"voltage_V": 2.7}


class HeldOut(Form):
    """RMS error of the preset on a run that was not used for it, in the column's unit."""

    run: str
    column: str
    rms: float


class PresetForm(Form):
    """The content of a preset file."""

    title: str
    kinds: list[Kind]
    data: str
    licence: str
    parameters: ParametersEntry
    cutoff: CutoffEntry = CutoffEntry()
    held_out: list[HeldOut] = Field(default_factory=list)


@dataclasses.dataclass(frozen=True, eq=False)
class Preset:
    """One piece of hardware.

    Attributes:
        name: a key of `PRESETS`, or the path of a file.
        kinds: kinds of model for which it can be used.
        parameters: scalar parameters by name.
        tables: curves by name.
        cutoff: where a discharge ends, as in a case; a study of this preset ends there, a case does not.
    """

    name: str
    kinds: tuple[Kind, ...]
    parameters: dict[str, Known]
    tables: dict[str, Table]
    cutoff: dict[str, float] = dataclasses.field(default_factory=dict)


def located(name: str, folder: Path) -> str:
    """Return the name of a preset; that of a file as its path, which is relative to a folder where it is stated."""
    return os.path.abspath(folder / name) if name.endswith(".toml") else name


def read_form(name: str) -> PresetForm:
    """Return the content of a preset except the paper's, with data set, licence and errors on held-out runs.

    Raises:
        MeasurementError, ParameterError: the file cannot be read, or has another form than those of this folder.
    """
    own, where = name.endswith(".toml"), f"preset '{Path(name).name}'"
    text = read_utf8(Path(name)) if own else (resources.files(__name__) / f"{name}.toml").read_text(encoding="utf-8")
    content = toml.parsed(text, where)
    try:
        return PresetForm.model_validate(content)
    except ValidationError as error:
        raise ParameterError(f"{where}: {complaint(error, content, 'the file')}") from error


def read_preset(name: str) -> Preset:
    """Return a preset by its name: a key of `PRESETS`, or the path of a file."""
    return _of_form(name) if name.endswith(".toml") else _of_package(name)


@functools.cache
def _of_package(name: str) -> Preset:
    if name == "paper":
        return Preset(name, ("cell", "motor", "robot"), {}, {}, _CUTOFF_OF_THE_PAPER)
    return _of_form(name)


def _of_form(name: str) -> Preset:
    form = read_form(name)
    numbers = scalars(form.parameters.__pydantic_extra__, f"preset '{Path(name).name}'")
    cutoff = form.cutoff.model_dump(exclude_none=True)
    return Preset(name, tuple(form.kinds), numbers, tables(form.parameters), cutoff)


def why_not(name: str, kind: str) -> str:
    """Return why a preset cannot be used for a kind of model, as a sentence; '' if it can."""
    label = Path(name).name
    if name.endswith(".toml"):
        if not os.path.isfile(name):
            return f"there is no preset file '{label}' in {Path(name).parent}; correct its name."
        try:
            title, kinds = read_form(name).title, read_preset(name).kinds
        except UserError as error:
            return str(error)
    elif name not in PRESETS:
        return f"no preset is called '{name}'.{instead(name, PRESETS)}"
    else:
        title, kinds = PRESETS[name], read_preset(name).kinds
    if kind in kinds:
        return ""
    served = " and ".join(kinds)
    return f"preset '{label}' ({title}) serves kind {served}, not '{kind}'; use another preset, or another kind."
