"""Changes that should not matter: the names must stay when a case is written a little differently.

Only what is named is judged. That something moves between "possible" and nothing is allowed, and counted apart.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.real.one import diagnose_apart
from jaxmodel.app.terminal import say, table
from jaxmodel.fit.settings import SETTINGS

NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
ADDED_SOC_SD = 0.01
CHANGES_BY = 0.02  # of a column's largest value: a smaller change of an input from row to row is none. Assumed.
FINER = 5
AS_IT_IS, SECOND_ROW, INTERPOLATED = "as it is", "every second row", "five times finer"


def noise_scaled(text: str, factor: float) -> str:
    """Return case.toml with the sd of every sensor multiplied by a factor."""
    head, sensors, rest = _section(text, "sensors")
    scaled = re.sub(rf"= *({NUMBER})", lambda found: f"= {factor * float(found[1]):.6g}", sensors)
    return head + scaled + rest


def _section(text: str, name: str) -> tuple[str, str, str]:
    """Return what is before a section of case.toml, the section, and what is after it; all before where none is."""
    parts = re.split(rf"(\[{name}\]\n(?:[^\[\n].*\n|\n)*)", text, maxsplit=1)
    return (parts[0], parts[1], parts[2]) if len(parts) == 3 else (text, "", "")


def runs_reversed(text: str) -> str:
    """Return case.toml with its runs in the opposite order."""
    head, *runs = text.split("[[runs]]")
    return head + "".join(f"[[runs]]{run.rstrip()}\n\n" for run in reversed(runs))


def soc_sd_changed(text: str) -> str:
    """Return case.toml with an sd on each run's `initial_soc` where there was none, and without it where there was."""
    stated = rf"initial_soc = \{{ value = ({NUMBER}), sd = {NUMBER} \}}"
    if re.search(stated, text):
        return re.sub(stated, r"initial_soc = \1", text)
    return re.sub(rf"initial_soc = ({NUMBER})", rf"initial_soc = {{ value = \1, sd = {ADDED_SOC_SD} }}", text)


def every_second(rows: pd.DataFrame, inputs: Iterable[str]) -> pd.DataFrame:
    """Return a run without every second row that has readings.

    An input holds until its row: where it changes to the next row, the row stays and its readings alone are dropped,
    as else the next row's current would have flowed during a rest.
    """
    inputs = [name for name in inputs if name in rows]
    outputs = [name for name in rows if name not in ("time_s", *inputs)]
    read = rows[outputs].notna().any(axis=1)
    dropped = read & (read.cumsum() % 2 == 0)
    changes = _steps(rows[inputs]).shift(-1, fill_value=True)  # the run ends where it ended
    thinner = rows.copy()
    thinner.loc[dropped, outputs] = np.nan
    return thinner[~(dropped & ~changes)]


def interpolated(rows: pd.DataFrame, inputs: Iterable[str]) -> pd.DataFrame:
    """Return a run with four more rows between every two, at equal times, as a logger's export may have them.

    An input holds until its row, so that the charge stays. Readings are straight between two rows; where an input
    steps between them they are missing, as none was taken there and a straight line would be none of the hardware.
    """
    inputs = [name for name in inputs if name in rows]
    outputs = [name for name in rows if name not in ("time_s", *inputs)]
    place = np.arange(FINER * (len(rows) - 1) + 1) / FINER
    before, after = np.floor(place).astype(int), np.ceil(place).astype(int)
    share = (place - before)[:, None]
    finer = rows.iloc[after].reset_index(drop=True)
    straight = ["time_s", *outputs]
    finer[straight] = (1.0 - share) * rows[straight].to_numpy()[before] + share * rows[straight].to_numpy()[after]
    own = before == after
    finer.loc[own, outputs] = rows[outputs].to_numpy()  # NaN times nothing is NaN
    finer.loc[_steps(rows[inputs]).to_numpy()[after] & ~own, outputs] = np.nan
    return finer


def _steps(inputs: pd.DataFrame) -> pd.Series:
    """Return in which rows an input differs from the row before."""
    return (inputs.diff().abs() > CHANGES_BY * inputs.abs().max()).any(axis=1)


def tolerance_stated(text: str, readings: dict[str, pd.Series]) -> str:
    """Return case.toml with the tolerance that would be assumed without one stated, or another form of the one stated.

    A case states a tolerance in the unit of its column and in no other; `{ rms = }` and the bare number are the same.
    """
    head, stated, rest = _section(text, "tolerance")
    if stated:
        return head + re.sub(rf"^(\w+) = ({NUMBER})$", r"\1 = { rms = \2 }", stated, flags=re.MULTILINE) + rest
    lines = [f"{name} = {assumed_tolerance(name, values):.6g}\n" for name, values in readings.items()]
    return text.replace("[sensors]\n", f"[tolerance]\n{''.join(lines)}\n[sensors]\n", 1)


def assumed_tolerance(column: str, readings: pd.Series) -> float:
    """Return the tolerance that a diagnosis assumes of a channel, in its unit."""
    if column.endswith("_degC"):
        return SETTINGS.assumed_temperature_K
    share = SETTINGS.assumed_voltage if column.endswith("_V") else SETTINGS.assumed_share
    return share * float(readings.max() - readings.min())


INPUTS = ("current_A", "ambient_degC"), ("voltage_V", "load_torque_Nm", "ambient_degC")
TOLERANCE = "tolerance stated"
TEXTS: dict[str, Callable[[str], str]] = {
    AS_IT_IS: lambda text: text,
    "noise sd x 2": partial(noise_scaled, factor=2.0),
    "noise sd / 2": partial(noise_scaled, factor=0.5),
    "runs reversed": runs_reversed,
    "sd on initial_soc": soc_sd_changed,
}
ROWS: dict[str, Callable[[pd.DataFrame, Iterable[str]], pd.DataFrame]] = {
    SECOND_ROW: every_second,
    INTERPOLATED: interpolated,
}
CHANGES = (*TEXTS, *ROWS, TOLERANCE)


def write_changed(folder: Path, change: str, out: Path) -> Path | None:
    """Write a case with one change; return its folder, or None where it has nothing to change."""
    text = (folder / "case.toml").read_text(encoding="utf-8")
    inputs = INPUTS['kind = "motor"' in text]
    paths = sorted(folder.glob("*.csv"))
    changed = tolerance_stated(text, _readings(folder, inputs)) if change == TOLERANCE else text
    changed = TEXTS[change](text) if change in TEXTS else changed
    if changed == text and change not in (AS_IT_IS, *ROWS):
        return None
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    (out / "case.toml").write_text(changed, encoding="utf-8", newline="\n")
    for path in paths:
        if change in ROWS:
            ROWS[change](pd.read_csv(path), inputs).to_csv(out / path.name, index=False, lineterminator="\n")
        else:
            shutil.copy(path, out / path.name)
    return out


def _readings(folder: Path, inputs: Iterable[str]) -> dict[str, pd.Series]:
    """Return all readings of a case by column, over its runs."""
    files = [run["file"] for run in tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))["runs"]]
    rows = pd.concat([pd.read_csv(folder / file) for file in files])
    return {name: rows[name] for name in rows if name not in ("time_s", *inputs)}


def judge_harmless(folders: Iterable[Path], work: Path, limit_s: float) -> list[dict[str, Any]]:
    """Diagnose each case after each change, print the table, and return what was named and what was possible."""
    found = []
    for folder in folders:
        row: dict[str, Any] = {"case": folder.name, "named": {}, "possible": {}}
        for change in CHANGES:
            written = write_changed(folder, change, work / folder.name / _folder(change))
            if written is None:
                continue
            say(f"{folder.name}, {change} ...")
            answer = diagnose_apart(written, limit_s)
            names = {effect["name"] for effect in answer.get("effects", ())}
            row["named"][change] = {"failed": answer["failed"]} if "failed" in answer else sorted(names)
            row["possible"][change] = sorted({one["name"] for one in answer.get("immaterial", ())} - names)
        found.append(row)
    print_harmless(found)
    return found


def _folder(change: str) -> str:
    """Return the name of a change as one of a folder."""
    return change.replace("/", "over").replace(" ", "_")


def counts(found: list[dict[str, Any]]) -> dict[str, int]:
    """Return how many changes were made, how many change a name, and in how many something possible comes or goes.

    Of these last, what became named or was named before counts as a changed name alone.
    """
    asked = others = moved = 0
    for row in found:
        first, possible = row["named"].get(AS_IT_IS), row["possible"].get(AS_IT_IS, [])
        for change, said in row["named"].items():
            if change == AS_IT_IS:
                continue
            asked += 1
            others += not _same(said, first)
            if isinstance(said, list) and isinstance(first, list):
                moved += bool((set(possible) ^ set(row["possible"][change])) - set(said) - set(first))
    return {"changes": asked, "change_a_name": others, "move_what_is_possible": moved}


def _same(said: Any, first: Any) -> bool:
    return isinstance(said, list) and said == first


def print_harmless(found: list[dict[str, Any]]) -> None:
    """Print what is named as it is, and where a change makes it another set."""
    lines = []
    for row in found:
        first, line = row["named"].get(AS_IT_IS), [row["case"]]
        for change in CHANGES:
            said = row["named"].get(change)
            text = "not applicable" if said is None else ", ".join(said) if isinstance(said, list) else "FAILED"
            if change != AS_IT_IS and said is not None:
                text = "same" if _same(said, first) else text or "nothing"
            line.append(text or "nothing")
        lines.append(line)
    table("Names after changes that should not matter", ["case", *CHANGES], lines)
    found_counts = counts(found)
    say(f"{found_counts['change_a_name']} of {found_counts['changes']} harmless changes change a name (asked: none).")
    say(
        f"In {found_counts['move_what_is_possible']} of them something moves between possible and nothing, which is"
        " allowed."
    )
