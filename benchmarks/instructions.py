"""What a step of a packet of lanes is made of, counted in the machine code of the kernel."""

from __future__ import annotations

import re
from typing import Any

from benchmarks.work import Ours, study_of
from jaxmodel.lanes import machine

_KINDS = {
    "multiplications and sums": r"v(add|sub|mul|fn?m(add|sub)\d*)[ps][ds]",
    "divisions": r"vdiv[ps][ds]",
    "comparisons, selections and logic": r"v(cmp|blend|min|max|and|or|xor|p?andn)\w*",
    "moves": r"v(mov|p?broadcast)\w*",
}


def instructions(kind: str) -> dict[str, Any]:
    """Return the counts of the step of a kind: of the longest loop without another inside."""
    kernel = Ours(study_of(kind, 64), 1).kernel
    step = _longest_loop(machine.assembly(kernel.module.text))
    found: dict[str, Any] = {"kind": kind, "lanes": kernel.lanes, "instructions": len(step)}
    for name, pattern in _KINDS.items():
        found[name] = sum(re.match(pattern, line) is not None for line in step)
    found["with an operand on the stack"] = sum("(%rsp)" in line or "(%rbp)" in line for line in step)
    return found


def _longest_loop(text: str) -> list[str]:
    """Return the instructions from a label to the last jump back to it, of the longest such part."""
    places: dict[str, int] = {}
    lines: list[str] = []
    loops: list[tuple[int, int]] = []
    for line in text.splitlines():
        if label := re.match(r"(\.?L\w+):", line):
            places[label[1]] = len(lines)
        elif re.match(r"\t[a-z]", line):
            lines.append(line.strip())
            jump = re.match(r"j\w+\s+(\S+)", line.strip())
            if jump and jump[1] in places:
                loops.append((places[jump[1]], len(lines)))
    inner = [loop for loop in loops if not any(loop[0] <= a and b <= loop[1] and (a, b) != loop for a, b in loops)]
    first, last = max(inner, key=lambda loop: loop[1] - loop[0])
    return lines[first:last]
