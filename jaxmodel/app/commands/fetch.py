"""`jaxmodel fetch`: public data sets by name."""

from __future__ import annotations

import shlex
from pathlib import Path

from jaxmodel.app import terminal
from jaxmodel.data.public import data_sets, fetch


def list_sets() -> None:
    """Print what can be fetched."""
    rows = [(one.name, one.title, str(len(one.files)), one.licence, one.by) for one in data_sets().values()]
    terminal.table("Public data sets", ("name", "what", "files", "licence", "by"), rows)
    terminal.say("jaxmodel fetch NAME brings one.")


def fetch_to(name: str, out: Path | None) -> None:
    """Fetch one, and print its licence and what to do next.

    Raises:
        UserError: it is not known, or cannot be fetched.
    """
    folder = out or Path(name)
    with terminal.stages(name) as tell:
        files = fetch(name, folder, tell)
    one = data_sets()[name]
    terminal.say(f"{len(files)} files of {one.by} are in {folder}.")
    terminal.say(f"Their licence: {one.licence}. From {one.page}, commit {one.commit[:12]}.")
    pattern = shlex.quote(str(folder)) + "/*"
    terminal.say(f"Go on: jaxmodel start {pattern} {one.start}")
