"""Instructions taken out of a function, as a function of their own."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

# Stands for the name of the function.
OUTLINED = "@outlined"
_NAME = re.compile(r"%[A-Za-z_][\w.]*|%\d+")
_LABEL = re.compile(r"^([A-Za-z_][\w.]*):$")


def outlined(
    lines: Sequence[str], entry: str, result: str, kind: str, types: Mapping[str, str]
) -> tuple[str, list[str]]:
    """Return the text of a function, and the registers that a call passes; alike for lines that are alike.

    Args:
        lines: instructions and labels.
        entry: the block in which the first is.
        result: the register or constant to return.
        kind: its type.
        types: of registers from outside.
    """
    text = [f"{entry}:", *lines, f"  ret {kind} {result}"]
    own = {f"%{found[1]}" for line in text if (found := _LABEL.match(line))}
    own |= {line.split(" = ", 1)[0].strip() for line in text if " = " in line}
    renamed: dict[str, str] = {}
    given: list[str] = []

    def rename(found: re.Match) -> str:
        name = found[0]
        if name not in renamed:
            renamed[name] = f"%n{len(renamed)}"
            if name not in own:
                given.append(name)
        return renamed[name]

    body = []
    for line in text:
        label = _LABEL.match(line)
        body.append(_NAME.sub(rename, f"%{label[1]}")[1:] + ":" if label else _NAME.sub(rename, line))
    parameters = ", ".join(f"{types[name]} {renamed[name]}" for name in given)
    head = f'define private {kind} {OUTLINED}({parameters}) noinline cold nounwind "prefer-vector-width"="512" {{'
    return "\n".join([head, *body, "}"]), given
