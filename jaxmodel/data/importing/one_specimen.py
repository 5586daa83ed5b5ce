"""One of several motors or cells that a log has side by side."""

from __future__ import annotations

import dataclasses

from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.tables import RawTable


@dataclasses.dataclass(frozen=True)
class OneSpecimen:
    """The columns of one motor or cell of a log.

    Attributes:
        name: "left", "front_left", "motor1", "cell3"; "" for a log of one.
        table: its own columns, named as if it were the only one, and those of all.
        found: what is to be said.
    """

    name: str
    table: RawTable
    found: tuple[Finding | Decision, ...] = ()
