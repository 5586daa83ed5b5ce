"""`jaxmodel identify`: what the readings of a case can tell of its parameters."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from discrepancy.advice.identifiability import (
    MISFIT,
    Identifiability,
    Profiled,
    asking_for,
    calibrated,
    deeper,
    identifiability,
    profile_likelihood,
)
from discrepancy.investigation import Investigation
from jaxmodel.cases import read_case
from jaxmodel.effects import CATALOGUE
from plots.identifiability import correlations, ellipse, information_bars, profile_beside_quadratic
from plots.style import png
from workbench import terminal
from workbench.commands.start import own_effects, start

# A profile can lead to a deeper minimum, from which another one can.
_MOST_RESTARTS = 3


def identify(
    path: Path,
    out: Path,
    parameters: Sequence[str],
    profiles: Sequence[str],
    add: Sequence[str],
    effects: Sequence[str],
    *,
    answer_only: bool = False,
) -> Identifiability:
    """Calibrate a case's model and tell what its fit runs know of every unknown; write tables and pictures to `out`.

    Args:
        path: of the case.
        out: folder for the results.
        parameters: asked for: made uncertain where the case states them as exact, and their likelihood profiled.
        profiles: further unknowns whose likelihood is profiled.
        add: effects added to the model, their parameters unknown.
        effects: the user's own, as `file.py:Class`.
        answer_only: leave out the pictures.

    Raises:
        UserError: the case cannot be used, or a name is unknown.
    """
    own = own_effects(effects)
    case, assumed = asking_for(read_case(path), parameters, CATALOGUE | own)
    investigation = Investigation(case, extra_effects=own)
    labels = investigation.bench.labels_to_add(add)
    start(out)
    with terminal.told("identify") as progress:
        progress("calibrating")
        model, misfit = calibrated(investigation, labels)
        found = identifiability(investigation, model, misfit, assumed)
        asked = [found.place(name) for name in dict.fromkeys([*parameters, *profiles])]
        profiled: list[Profiled] = []
        for _ in range(_MOST_RESTARTS):
            progress("profiles of the likelihood" if asked else "tables and pictures")
            profiled = [profile_likelihood(investigation, model, found.names[i]) for i in asked]
            better = [one for one in (deeper(model, each) for each in profiled) if one is not None]
            if not better:
                break
            model = min(better, key=lambda one: one.fitted.objective)
            found = identifiability(investigation, model, misfit, assumed)
        _write(found, profiled, [found.names[i] for i in asked], investigation.preparation, out)
        if not answer_only:
            for name, picture in _pictures(found, profiled, [found.names[i] for i in asked]):
                (out / f"{name}.png").write_bytes(picture)
    _print(found, profiled, [found.names[i] for i in asked])
    for left_out in investigation.preparation:
        terminal.say(f"Note: {left_out}")
    terminal.say(f"identify.json{' and tables' if answer_only else ', tables and pictures'} are in {out}.")
    return found


def table_of(found: Identifiability) -> pd.DataFrame:
    """Return one line for each unknown: its value, what was known of it, what is, and who brings it."""
    own, others = found.shares_known_before()
    columns: dict[str, Any] = {
        "parameter": found.names,
        "value": found.values,
        "unit": found.units,
        "sd_before": found.prior_sd,
        "assumed": [name in found.assumed for name in found.names],
        "sd": found.sd,
        "sd_of_data_alone": found.sd_of_data,
    }
    columns |= {f"share_of_{run}": part for run, part in zip(found.runs, found.shares_by_run(), strict=True)}
    columns |= {f"share_of_{name}": part for name, part in zip(found.sensors, found.shares_by_sensor(), strict=True)}
    columns |= {"share_known_before": own, "share_of_others_known_before": others}
    return pd.DataFrame(columns)


def _write(
    found: Identifiability, profiled: Sequence[Profiled], asked: Sequence[str], remarks: Sequence[str], out: Path
) -> None:
    table_of(found).to_csv(out / "identifiability.csv", index=False, float_format="%.8g")
    parts = [("run", found.runs, found.sd_without_run()), ("sensor", found.sensors, found.sd_without_sensor())]
    left_out = [
        {"left_out": kind, "name": name, **dict(zip(found.names, row, strict=True))}
        for kind, names, rows in parts
        for name, row in zip(names, rows, strict=True)
    ]
    pd.DataFrame(left_out).to_csv(out / "sd-without.csv", index=False, float_format="%.8g")
    covariance = found.information.covariance * np.outer(found.prior_sd, found.prior_sd)
    pd.DataFrame(covariance, found.names, found.names).to_csv(out / "covariance.csv", float_format="%.12g")
    content = {
        "case": found.case,
        "misfit": found.misfit,
        "remarks": list(remarks),
        "answers": {name: found.answer(name) for name in found.names},
        "asked": list(asked),
        "sloppy": [{"information": strength, "told": words} for strength, words in found.sloppy()],
        "correlation": {
            name: dict(zip(found.names, row.tolist(), strict=True))
            for name, row in zip(found.names, found.information.correlation(), strict=True)
        },
        "profiles": [
            {
                "parameter": one.name,
                "values": one.values.tolist(),
                "rise_of_chi2": one.rise.tolist(),
                "quadratic": one.quadratic.tolist(),
                "interval": [end if np.isfinite(end) else None for end in one.interval],
                "quadratic_lies": one.lies,
            }
            for one in profiled
        ],
    }
    (out / "identify.json").write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _pictures(
    found: Identifiability, profiled: Sequence[Profiled], asked: Sequence[str]
) -> Iterator[tuple[str, bytes]]:
    yield "information", png(information_bars(found))
    if len(found.names) > 1:
        yield "correlations", png(correlations(found))
        for first, second in _pairs(found, asked):
            yield f"ellipse-{first}-{second}", png(ellipse(found, first, second))
    for one in profiled:
        i = found.names.index(one.name)
        yield f"profile-{one.name}", png(profile_beside_quadratic(one, found.units[i]))


def _pairs(found: Identifiability, asked: Sequence[str]) -> list[tuple[str, str]]:
    """Return each parameter that was asked for with the one it is told from worst; where none was, the worst of all."""
    size = np.abs(found.information.correlation() - np.eye(len(found.names)))
    if not asked:
        first, second = np.unravel_index(int(np.argmax(size)), size.shape)
        return [(found.names[first], found.names[second])]
    return [(name, found.names[int(np.argmax(size[found.names.index(name)]))]) for name in asked]


def _print(found: Identifiability, profiled: Sequence[Profiled], asked: Sequence[str]) -> None:
    rows = []
    runs, sensors = found.shares_by_run(), found.shares_by_sensor()
    for i, name in enumerate(found.names):
        run, sensor = int(np.argmax(runs[:, i])), int(np.argmax(sensors[:, i]))
        alone = f"{found.sd_of_data[i]:.2g}" if np.isfinite(found.sd_of_data[i]) else "open"
        numbers = (f"{found.values[i]:.5g}", f"{found.prior_sd[i]:.2g}", f"{found.sd[i]:.2g}", alone)
        sources = (
            f"{found.runs[run]} {runs[run, i]:.0%}, {found.sensors[sensor]} {sensors[sensor, i]:.0%}"
            if runs[run, i] > 0.005
            else "what was known before"
        )
        rows.append((f"{name} [{found.units[i]}]" if found.units[i] else name, *numbers, sources))
    columns = ("parameter", "value", "± before", "± after", "± data alone", "most of it from")
    terminal.table(f"What the fit runs of {found.case} tell", columns, rows, right=(1, 2, 3, 4))
    if found.misfit > MISFIT:
        terminal.say(
            f"The model misses the data by {found.misfit:.3g} times the noise: what it misses was counted as an error "
            f"with a memory beside it. `jaxmodel diagnose` looks for what is missing."
        )
    for strength, words in found.sloppy():
        terminal.say(f"Told less than was known before: {words} (information {strength:.2g}).")
    for name in asked:
        terminal.say(found.answer(name))
    for one in profiled:
        low, high = (f"{end:.5g}" if np.isfinite(end) else "open" for end in one.interval)
        verdict = "the quadratic lies" if one.lies else "the quadratic holds"
        terminal.say(f"Profile of {one.name}: {low} to {high} at one sd; {verdict}.")
