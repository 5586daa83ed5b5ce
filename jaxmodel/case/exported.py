"""A case in the file of another tool; the room `export` makes it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from jaxmodel.base.in_short import InShort


@dataclasses.dataclass(frozen=True, repr=False)
class Exported(InShort):
    """A case in the file of another tool.

    Attributes:
        content: of the file; text, or the bytes of a binary one. "" where the format has several files.
        left_out: what the file does not carry, one sentence each; the file has them in a comment, if it can have one.
        files: the content of each file by name, of a format that writes several into a folder.

    Example:
        >>> from jaxmodel import read_case
        >>> read_case("examples/samsung_30q").export("c").left_out
        ('Runs of the case begin at a state of charge of their own; in the file it is that of a full cell, 1.',)
    """

    content: str | bytes
    left_out: tuple[str, ...]
    files: Mapping[str, str | bytes] = dataclasses.field(default_factory=dict)

    def _in_short(self) -> str:
        if self.files:
            return f"{len(self.files)} files, {len(self.left_out)} things left out"
        kind = "characters" if isinstance(self.content, str) else "bytes"
        return f"{len(self.content)} {kind}, {len(self.left_out)} things left out"
