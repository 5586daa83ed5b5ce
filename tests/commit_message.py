"""`python tests/commit_message.py FILE`: refuse a commit message that is not as CONTRIBUTING.md asks."""

from __future__ import annotations

import re
import sys
from pathlib import Path

# The words of git itself: a merge, and a commit that a rebase will take into another.
BY_GIT = re.compile(r"(Merge (remote-tracking )?branch |(fixup|squash|amend)! )")
TRAILER = re.compile(r"[\w-]+-by: ")
# Below this line `git commit --verbose` shows the change.
CUT = "# ------------------------ >8 ------------------------"


def faults(message: str) -> list[str]:
    """Return a sentence for each fault of a message; comments, which git leaves out, are no part of it."""
    kept = [line for line in message.partition(CUT)[0].splitlines() if not line.startswith("#")]
    subject, *rest = "\n".join(kept).strip().split("\n")
    if BY_GIT.match(subject):
        return []
    found = []
    if len(subject) >= 72:
        found.append(f"The first line has {len(subject)} characters; write fewer than 72.")
    if rest and rest[0].strip():
        found.append("The second line is not empty; leave a blank line after the first.")
    if not any(line.strip() and not TRAILER.match(line) for line in rest):
        found.append("There is no body; say why, after a blank line.")
    return found


if __name__ == "__main__":
    sys.exit("\n".join(faults(Path(sys.argv[1]).read_text(encoding="utf-8"))) or None)
