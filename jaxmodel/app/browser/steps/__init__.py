"""The steps of the path, a module each: each has `show(context)`, which fills the panel."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from jaxmodel.app.browser.context import Context
from jaxmodel.app.browser.steps import add, compare, data, keep, learn, where


@dataclasses.dataclass(frozen=True)
class Step:
    """One step: its name in the address, its title, what fills its panel, and from which stage on it has something."""

    name: str
    title: str
    show: Callable[[Context], None]
    stage: str


STEPS = (
    Step("data", "Bring data", data.show, "empty"),
    Step("compare", "Compare", compare.show, "opened"),
    Step("where", "See where it fails", where.show, "compared"),
    Step("learn", "Learn what is missing", learn.show, "compared"),
    Step("add", "Add it", add.show, "compared"),
    Step("keep", "Keep", keep.show, "compared"),
)
