"""Changes that should not matter: the names must stay when a case is written a little differently."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.real.one import diagnose_apart
from jaxmodel.app.terminal import say, table

NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
ADDED_SOC_SD = 0.01
CHANGES_BY = 0.02  # of a column's largest value: a smaller change of an input from row to row is none
AS_IT_IS = "as it is"


def noise_doubled(text: str) -> str:
    """Return case.toml with twice the sd of every sensor."""
    head, sensors, rest = re.split(r"(\[sensors\]\n(?:[^\[\n].*\n|\n)*)", text, maxsplit=1)
    doubled = re.sub(rf"= *({NUMBER})", lambda found: f"= {2.0 * float(found[1]):.6g}", sensors)
    return head + doubled + rest


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
    values = rows[inputs]
    changes = (values.diff().shift(-1).abs() > CHANGES_BY * values.abs().max()).any(axis=1)
    changes.iloc[-1] = True  # the run ends where it ended
    thinner = rows.copy()
    thinner.loc[dropped, outputs] = np.nan
    return thinner[~(dropped & ~changes)]


INPUTS = ("current_A", "ambient_degC"), ("voltage_V", "load_torque_Nm", "ambient_degC")
TEXTS: dict[str, Callable[[str], str]] = {
    AS_IT_IS: lambda text: text,
    "noise sd x 2": noise_doubled,
    "runs reversed": runs_reversed,
    "every second row": lambda text: text,
    "sd on initial_soc": soc_sd_changed,
}


def write_changed(folder: Path, change: str, out: Path) -> Path | None:
    """Write a case with one change; return its folder, or None where it has nothing to change."""
    text = (folder / "case.toml").read_text(encoding="utf-8")
    changed = TEXTS[change](text)
    if changed == text and change not in (AS_IT_IS, "every second row"):
        return None
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    (out / "case.toml").write_text(changed, encoding="utf-8", newline="\n")
    inputs = INPUTS['kind = "motor"' in text]
    for path in folder.glob("*.csv"):
        if change == "every second row":
            every_second(pd.read_csv(path), inputs).to_csv(out / path.name, index=False, lineterminator="\n")
        else:
            shutil.copy(path, out / path.name)
    return out


def judge_harmless(folders: Iterable[Path], work: Path, limit_s: float) -> list[dict[str, Any]]:
    """Diagnose each case after each change, print the table, and return what was named."""
    found = []
    for folder in folders:
        row: dict[str, Any] = {"case": folder.name, "named": {}}
        for change in TEXTS:
            written = write_changed(folder, change, work / folder.name / change.replace(" ", "_"))
            if written is None:
                continue
            say(f"{folder.name}, {change} ...")
            answer = diagnose_apart(written, limit_s)
            names = [effect["name"] for effect in answer.get("effects", ())]
            row["named"][change] = {"failed": answer["failed"]} if "failed" in answer else sorted(names)
        found.append(row)
    print_harmless(found)
    return found


def print_harmless(found: list[dict[str, Any]]) -> None:
    """Print what is named as it is, and where a change makes it another set."""
    lines, others, asked = [], 0, 0
    for row in found:
        first, line = row["named"].get(AS_IT_IS), [row["case"]]
        for change in TEXTS:
            said = row["named"].get(change)
            text = "not applicable" if said is None else ", ".join(said) if isinstance(said, list) else "FAILED"
            if change != AS_IT_IS and said is not None:
                same = said == first and isinstance(said, list)
                asked, others = asked + 1, others + (not same)
                text = "same" if same else text or "nothing"
            line.append(text or "nothing")
        lines.append(line)
    table("Names after changes that should not matter", ["case", *TEXTS], lines)
    say(f"{others} of {asked} harmless changes change a name (asked: none).")
