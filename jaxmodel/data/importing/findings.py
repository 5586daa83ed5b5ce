"""What an import found in files, and what it decided: data, each with its sentence."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Literal

Weight = Literal["note", "warning"]


@dataclasses.dataclass(frozen=True)
class Finding:
    """Something about a file or run that a person should know.

    Attributes:
        what: one word or two for the sort, as "gap" or "stuck sensor".
        where: the file or run.
        sentence: what was found, and what was done about it.
        weight: "warning" where results may be wrong if it is not looked at.
        column: of the case, "" where it concerns all.
        spans_s: the times that it concerns, in seconds of the run; empty where it concerns the whole run.
        numbers: what was measured, by name with unit.
    """

    what: str
    where: str
    sentence: str
    weight: Weight = "note"
    column: str = ""
    spans_s: tuple[tuple[float, float], ...] = ()
    numbers: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as JSON holds it."""
        return dataclasses.asdict(self) | {
            "numbers": dict(self.numbers),
            "spans_s": [list(span) for span in self.spans_s],
        }


@dataclasses.dataclass(frozen=True)
class Decision:
    """Something that the files leave open and that was settled.

    Attributes:
        about: what, as "current_A" or "sign of the current".
        where: the file or run, "" for all.
        value: the outcome, in words.
        why: what it rests on.
        source: who settled it: the user, the file itself, physics, or an assumption.
    """

    about: str
    where: str
    value: str
    why: str
    source: Literal["user", "file", "physics", "assumed"]

    def sentence(self) -> str:
        """Return the decision in one line."""
        where = f" of {self.where}" if self.where else ""
        return f"{self.about}{where}: {self.value} ({self.why})"

    def to_dict(self) -> dict[str, Any]:
        """Return the decision as JSON holds it."""
        return dataclasses.asdict(self)


@dataclasses.dataclass(frozen=True)
class Question:
    """What only a person can answer.

    Attributes:
        sentence: the question.
        option: the option of the command line that answers it, with what it takes.
        choices: possible answers; empty for a number.
        default: the answer to a bare return, "" for none.

    Example:
        >>> from jaxmodel import Question
        >>> def ask(question: Question) -> str:  # as `import_case(..., ask=ask)`
        ...     return question.choices[0] if question.choices else question.default
        >>> ask(Question("log.csv: in which unit is column 'time'?", "--unit", ("s", "ms")))
        's'
    """

    sentence: str
    option: str
    choices: tuple[str, ...] = ()
    default: str = ""


Ask = Callable[[Question], str]
