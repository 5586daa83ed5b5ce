"""`jaxmodel identify`: how well the readings of a case determine its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxmodel.app import terminal
from jaxmodel.app.commands.start import read_case_with, start
from jaxmodel.diagnosis import Identification, identify
from jaxmodel.diagnosis.advice.identifiability import MISFIT


def identify_case(
    path: Path,
    out: Path,
    parameters: Sequence[str],
    profiles: Sequence[str],
    add: Sequence[str],
    effects: Sequence[str],
    *,
    answer_only: bool = False,
) -> Identification:
    """Print how well the fit runs of a case determine every unknown; write tables and pictures to `out`.

    Args:
        path: of the case.
        out: folder for the results.
        parameters: as `jaxmodel.diagnosis.identify` takes them.
        profiles: the same.
        add: the same.
        effects: the user's own, as `file.py:Class`.
        answer_only: leaves out the pictures.

    Raises:
        UserError: the case cannot be used, or a name is unknown.
    """
    case = read_case_with(path, effects)
    start(out)
    with terminal.stages("identify") as progress:
        identification = identify(case, parameters, profiles=profiles, add=add, progress=progress)
        identification.write(out, pictures=not answer_only)
    _print(identification)
    terminal.say(f"identify.json, tables{'' if answer_only else ' and pictures'} are in {out}.")
    return identification


def _print(identification: Identification) -> None:
    found, rows = identification.found, []
    runs, sensors = found.shares_by_run(), found.shares_by_sensor()
    for i, name in enumerate(found.names):
        run, sensor = int(np.argmax(runs[:, i])), int(np.argmax(sensors[:, i]))
        alone = f"{found.sd_of_data[i]:.2g}" if np.isfinite(found.sd_of_data[i]) else "not determined"
        numbers = (f"{found.values[i]:.5g}", f"{found.prior_sd[i]:.2g}", f"{found.sd[i]:.2g}", alone)
        sources = (
            f"{found.runs[run]} {runs[run, i]:.0%}, {found.sensors[sensor]} {sensors[sensor, i]:.0%}"
            if runs[run, i] > 0.005
            else "the prior"
        )
        rows.append((f"{name} [{found.units[i]}]" if found.units[i] else name, *numbers, sources))
    columns = ("parameter", "value", "prior sd", "posterior sd", "sd, data alone", "main source")
    terminal.table(f"Parameters of {found.case} from its fit runs", columns, rows, right=(1, 2, 3, 4))
    if found.misfit > MISFIT:
        terminal.say(
            f"The RMS residual is {found.misfit:.3g} times the noise; it was treated as model error. Run `jaxmodel "
            f"diagnose` to find what the model lacks."
        )
    for one in identification.profiles:
        terminal.say(found.answer(one.name))
    for sentence in identification.sentences():
        terminal.say(sentence)
