"""What is wrong with one column or parameter, and how to mend it: one sentence."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.case.measurements import file_label
from jaxmodel.case.records import Case, Run
from jaxmodel.model.parameters import info


@dataclasses.dataclass(frozen=True)
class Mend:
    """A mistake of unit or sign, and what mends it: (value + offset) times factor.

    Attributes:
        name: of the column or parameter.
        factor: by which it is multiplied, after the offset.
        when: the mistake, as in "it is in mA".
        offset: what is added first.
        todo: what to do, where "multiply by the factor" does not say it.
    """

    name: str
    factor: float
    when: str
    offset: float = 0.0
    todo: str = ""

    def apply(self, values: np.ndarray | float) -> np.ndarray | float:
        """Return the values mended."""
        return (values + self.offset) * self.factor

    def sentence(self) -> str:
        """Say what to do."""
        if self.todo:
            return f"if {self.when}, {self.todo}"
        if self.factor == -1.0:
            return f"reverse its sign (multiply {self.name} by -1): {self.when}"
        return f"if {self.when}, multiply {self.name} by {self.factor:g}"


@dataclasses.dataclass(frozen=True)
class Finding:
    """A value that cannot be, or is not likely.

    Attributes:
        where: the file, the run and the column or parameter.
        seen: what was read.
        possible: what could be.
        mends: what may be done about it, one of them.
        certain: False where there is another explanation that can be.
        name: of the column or parameter; "" where it is that of the first mend.
    """

    where: str
    seen: str
    possible: str
    mends: tuple[Mend, ...]
    certain: bool = True
    name: str = ""

    def sentence(self) -> str:
        """Say all of it in one sentence."""
        todo = "; or ".join(mend.sentence() for mend in self.mends) or "correct it"
        return f"{self.where}: {self.seen}, and {self.possible}; {todo}."


def place(case: Case, run: Run, mend_or_column: Mend | str) -> str:
    """Return how a message names a column of a run, or a parameter or table of the case."""
    name = mend_or_column if isinstance(mend_or_column, str) else mend_or_column.name
    if name in run.overrides:
        return f"{case.label}, the run of {run.file}"
    if name in (*run.measured.inputs, *run.measured.outputs, "time_s"):
        file = f"{case.label}, run '{run.name}'" if run.source is None else file_label(run.source)
        return f"{file}, column '{name}'"
    return f"{case.label}: [parameters]"


def number(case: Case, name: str, run: Run) -> float:
    """Return a number of a run: its own, the case's, or that of the paper."""
    known = run.overrides.get(name, case.parameters.get(name))
    return info(name).default if known is None else known.value


def column(run: Run, name: str) -> np.ndarray | None:
    """Return a column of a run, None where it was not measured."""
    return run.measured.inputs.get(name, run.measured.outputs.get(name))
