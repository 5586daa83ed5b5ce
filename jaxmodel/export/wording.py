"""What the files of all formats say: which case they are of, and what they do not carry."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection

from jaxmodel.base.version import __version__
from jaxmodel.case.records import Case
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.sensors import sensors_of

WIDTH = 110


def heading(case: Case, what: str, left_out: tuple[str, ...]) -> list[str]:
    """Return the lines of a comment: the case, what the file is of it, and what it does not carry."""
    lines = textwrap.wrap(f"{what} of {case.title} (jaxmodel case '{case.name}', kind {case.kind}).", WIDTH)
    lines += [f"Written by jaxmodel {__version__}.", ""]
    lines.append("What this file does not carry:" if left_out else "This file carries the whole model of the case.")
    for sentence in left_out:
        lines += textwrap.wrap(sentence, WIDTH, initial_indent="- ", subsequent_indent="  ")
    return lines


def identifier(name: str) -> str:
    """Return a name that C and Python accept: letters, digits and underscores, not a digit first."""
    plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    return plain if plain and not plain[0].isdigit() else f"case_{plain}".rstrip("_")


def ideal_readings(model: Model, inputs: Collection[str] = ()) -> tuple[str, ...]:
    """Say that sensors are left out, if the model has faulty ones; those of `inputs` are carried."""
    names = [effect.label for effect in sensors_of(model) if effect.column not in inputs]
    if not names:
        return ()
    return (f"The readings are those of ideal sensors: {', '.join(names)} of the case is left out.",)


def own_values_of_runs(case: Case) -> tuple[str, ...]:
    """Say that values which differ from run to run are left out, if there are some."""
    names = sorted({name for run in case.runs for name in run.overrides})
    if not names and not case.specimens:
        return ()
    what = [f"what single runs state of their own ({', '.join(names)})"] if names else []
    what += [f"how the specimens differ ({', '.join(case.specimens)})"] if case.specimens else []
    return (f"The values are those of the case: {' and '.join(what)} is left out.",)
