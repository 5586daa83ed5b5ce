"""Runs over the life of a cell: cycles and what is left of the capacity are written, ages between others held out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.data.importing import Imported, import_case

LIFE = (1, 40, 80, 120, 160, 200)


def discharge(capacity_Ah: float, cycle: int, *, half: bool = False) -> pd.DataFrame:
    """A discharge at 2 A from full to 3.0 V, after a minute of rest."""
    hours = capacity_Ah / 2.0 * (0.5 if half else 1.0)
    time_s = np.append(np.arange(0.0, 60.0, 10.0), 60.0 + np.linspace(0.0, 3600.0 * hours, 200))
    soc = 1.0 - np.clip(time_s - 60.0, 0.0, None) * 2.0 / 3600.0 / capacity_Ah
    current = np.where(time_s < 60.0, 0.0, 2.0)
    return pd.DataFrame(
        {"time_s": time_s, "current_A": current, "voltage_V": 3.1 + 1.1 * soc - 0.05 * current, "cycle": cycle}
    )


def life(fade: float, cycles: tuple[int, ...] = LIFE, short: int = -1) -> pd.DataFrame:
    of_each = [discharge(2.5 * (1.0 - fade * k / 200.0), k, half=n == short) for n, k in enumerate(cycles)]
    return pd.concat(of_each, ignore_index=True)


def imported(folder: Path, log: pd.DataFrame, **options) -> Imported:
    log.to_csv(folder / "life.csv", index=False)
    return import_case(folder / "life.csv", "cell", ambient=25.0, **options)


def test_each_run_has_its_cycles_and_the_capacity_that_is_left(tmp_path: Path) -> None:
    one = imported(tmp_path, life(0.3))
    assert [run.entries()["cycles"] for run in one.runs] == list(LIFE)
    left = np.array([run.entries()["capacity_Ah"]["value"] for run in one.runs])
    assert left == pytest.approx(2.5 * (1.0 - 0.3 * np.array(LIFE) / 200.0), rel=0.02)
    assert one.case.runs[-1].overrides["capacity_Ah"].value == pytest.approx(1.75, rel=0.02)
    assert one.capacity is not None
    assert one.capacity.value == pytest.approx(2.5, rel=0.02)
    assert one.capacity.sd == pytest.approx(0.02 * one.capacity.value), "that it fades is no doubt of it"
    assert not [finding for finding in one.findings if finding.what in ("charge balance", "no check condition")]
    assert "cycle 200" in one.runs[-1].label


def test_ages_between_others_are_held_out_and_their_capacity_is_not_taken_from_them(tmp_path: Path) -> None:
    log = life(0.3)
    one = imported(tmp_path, log)
    held = [run for run in one.runs if run.split == "check"]
    assert [run.condition.cycles for run in held] == [80.0]
    # The held-out cell has lost far more than its neighbours say: nobody knew before it was measured.
    late = pd.concat([log[log.cycle != 80], discharge(1.9, 80)], ignore_index=True).sort_values("cycle", kind="stable")
    other = imported(tmp_path, late.reset_index(drop=True))
    (its,) = [run.entries()["capacity_Ah"]["value"] for run in other.runs if run.split == "check"]
    assert its == pytest.approx(2.5 * (1.0 - 0.3 * 80 / 200.0), rel=0.02)


def test_a_part_of_a_discharge_has_the_capacity_of_its_neighbours_in_age(tmp_path: Path) -> None:
    one = imported(tmp_path, life(0.3, short=3))
    assert one.runs[3].entries()["capacity_Ah"]["value"] == pytest.approx(2.5 * (1.0 - 0.3 * 120 / 200.0), rel=0.02)


def test_a_large_cell_has_its_capacities_and_not_the_resistance_of_a_small_one(tmp_path: Path) -> None:
    """By eq. 7 two hundred cycles add 21 mohm: ten times what a cell of 100 A h has."""
    log = life(0.3).assign(current_A=lambda log: 40.0 * log.current_A)
    large = imported(tmp_path, log)
    entries = [run.entries() for run in large.runs]
    assert all("cycles" not in one for one in entries)
    assert [(one.value, one.source) for one in large.decisions if one.about == "cycles of each run"] == [
        ("not stated", "physics")
    ]
    assert entries[-1]["capacity_Ah"]["value"] == pytest.approx(70.0, rel=0.02)


@pytest.mark.parametrize(
    ("log", "cycles", "faded"),
    [
        (life(0.3, (1, 2, 3, 4)), False, False),  # no cell ages in four cycles
        (life(0.005), True, False),  # it does not fade
        (life(0.3).drop(columns="cycle"), False, False),
        (life(0.3).rename(columns={"cycle": "run"}), False, False),  # counts tests, and tells no age
        (life(0.3).assign(cycle=lambda log: np.where(log.index % 2, log.cycle, 1)), False, False),
    ],
)
def test_without_an_age_or_a_loss_nothing_is_stated_of_it(
    tmp_path: Path, log: pd.DataFrame, cycles: bool, faded: bool
) -> None:
    entries = [run.entries() for run in imported(tmp_path, log).runs]
    assert all(("cycles" in one) is cycles and ("capacity_Ah" in one) is faded for one in entries)
