"""Common start of all commands: the cache of compiled programs, the user's own effects."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator, Sequence
from pathlib import Path

from jaxmodel.build import case_model, load_effect_class
from jaxmodel.case import Case
from jaxmodel.cases import read_case
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects import own_effects as named
from jaxmodel.errors import MeasurementError
from jaxmodel.jax_settings import keep_compiled_programs
from jaxmodel.model import Model
from jaxmodel.ports import Effect
from workbench.terminal import complain


def start(out: Path) -> None:
    """Make the folder for the results, enable the cache of compiled programs, and collect garbage rarely.

    Raises:
        OSError: the folder cannot be made.
    """
    out.mkdir(parents=True, exist_ok=True)
    if problem := keep_compiled_programs():
        complain(problem)
    # Imported and traced objects stay alive: checking them again and again took 15 % of a diagnosis.
    gc.freeze()
    gc.set_threshold(50_000)


def robots_of(paths: Sequence[Path]) -> dict[str, Model]:
    """Return the models of robots' cases by the names of their folders.

    Raises:
        UserError: a case cannot be used, is of another kind, or has the name of another.
    """
    models: dict[str, Model] = {}
    for path in paths:
        case = read_case(path)
        if case.kind != "robot":
            raise MeasurementError(f"{path}: the command needs a case of kind robot; this one is of kind {case.kind}.")
        if case.name in models:
            raise MeasurementError(f"Two of the models are called '{case.name}'; rename the folder of one of them.")
        models[case.name] = case_model(case)
    return models


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


@contextlib.contextmanager
def in_catalogue(classes: Sequence[type[Effect]]) -> Iterator[None]:
    """Add the user's own effects to the catalogue for a while, where study files look them up."""
    own = named(classes)
    CATALOGUE.update(own)
    try:
        yield
    finally:
        for name in own:
            del CATALOGUE[name]
