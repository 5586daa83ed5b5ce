"""What every command does first: compiled programs are kept, effects of the user's own are known."""

from __future__ import annotations

import gc
from collections.abc import Mapping, Sequence
from pathlib import Path

from jaxmodel.build import load_effect_class
from jaxmodel.effects import CATALOGUE
from jaxmodel.errors import EffectError
from jaxmodel.ports import Effect
from workbench.compiled import keep_compiled_programs


def start(out: Path) -> None:
    """Make the folder for the results, switch on the cache of compiled programs, and collect garbage seldom.

    Raises:
        OSError: the folder cannot be made.
    """
    out.mkdir(parents=True, exist_ok=True)
    keep_compiled_programs()
    # What is imported and traced stays: to look through it over and over took 15 % of a diagnosis.
    gc.freeze()
    gc.set_threshold(50_000)


def own_effects(references: Sequence[str]) -> dict[str, type[Effect]]:
    """Return the effect classes that `file.py:Class` names, by their names.

    Raises:
        EffectError: a class cannot be loaded, is not whole, or takes the name of another effect.
    """
    found: dict[str, type[Effect]] = {}
    for reference in references:
        cls = load_effect_class(reference)
        name = cls.name
        if name in CATALOGUE or name in found:
            raise EffectError(
                f"--effect {reference}: there is an effect called '{name}' already; give it another name."
            )
        found[name] = cls
    return found


def catalogue_with(effects: Mapping[str, type[Effect]]) -> dict[str, type[Effect]]:
    """Return the catalogue with effects of the user's own."""
    return {**CATALOGUE, **effects}
