"""Common start of all commands: the cache of compiled programs, the user's own effects."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from pathlib import Path

from jaxmodel.app.folders import take
from jaxmodel.app.terminal import complain
from jaxmodel.base.jax_settings import keep_compiled_programs
from jaxmodel.case.build import load_effect_class
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.model.ports import Effect


def start(out: Path | None) -> None:
    """Take the folder for results, if there is one, and enable the cache of compiled programs.

    Raises:
        UserError: the folder cannot be used.
        OSError: it cannot be made.
    """
    if out is not None:
        take(out)
    if problem := keep_compiled_programs():
        complain(problem)
    gc.freeze()  # all that was imported


def own_effects(references: Sequence[str]) -> list[type[Effect]]:
    """Return the effect classes that `file.py:Class` names.

    Raises:
        EffectError: a class cannot be loaded.
    """
    return [load_effect_class(reference) for reference in references]


def read_case_with(path: Path, effects: Sequence[str]) -> Case:
    """Read a case that knows the user's own effects, each given as `file.py:Class`.

    Raises:
        UserError: the case or an effect cannot be used.
    """
    return read_case(path, own_effects=own_effects(effects))
