"""What is printed: a line for each case and channel, the ratios to the reference, and what was asked."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.real.cases import CASES, RealCase
from jaxmodel.app.terminal import say, table

# Of a channel: its short name, the unit of its error, and how many of them are one of the column's.
UNITS = {
    "voltage_V": ("voltage", "mV", 1e3),
    "cell_temperature_degC": ("temperature", "K", 1.0),
    "current_A": ("current", "mA", 1e3),
    "speed_rad_s": ("speed", "rad/s", 1.0),
}
ASKED_MEDIAN, ASKED_WORST, ASKED_NAMED = 1.0, 1.2, 10.0 / 12.0
# Geometric mean of the ratios by channel; where check runs leave the fitted conditions, "outside".
ASKED_MEAN = {"inside": {}, "outside": {"voltage_V": 1.1, "cell_temperature_degC": 0.7}}
ASKED_INSIDE, ASKED_OVERLAP = 0.9, 0.9


@dataclasses.dataclass(frozen=True)
class Row:
    """What came out of one case.

    Attributes:
        name: of the case.
        answer: of the diagnosis, with `seconds`, or with `failed`; empty where it was not asked.
        reference: the errors of the reference by channel and split, with `seconds`, or with `failed`.
    """

    name: str
    answer: dict[str, Any]
    reference: dict[str, Any]

    @property
    def case(self) -> RealCase:
        """The case."""
        return CASES[self.name]

    @property
    def named(self) -> tuple[str, ...]:
        """The names of the effects in the answer."""
        return tuple(effect["name"] for effect in self.answer.get("effects", ()))

    @property
    def all_expected(self) -> bool:
        """Whether every effect that an expert expects is named."""
        return all(set(either.split("|")) & set(self.named) for either in self.case.expects)

    def check(self, channel: str, when: str) -> float:
        """Return the error on check runs, "before", "after" or of the "reference"; NaN where there is none."""
        if when == "reference":
            found = self.reference.get("errors", {}).get(channel, {}).get("check")
        else:
            found = self.answer.get("error", {}).get(channel, {}).get(when, {}).get("check")
        return float("nan") if found is None else float(found)

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that were judged."""
        return tuple(dict.fromkeys([*self.reference.get("errors", {}), *self.answer.get("error", {})]))

    @property
    def where(self) -> str:
        """Return "outside" if a check run leaves the conditions of the fit runs, else "inside"."""
        return "outside" if self.answer.get("extrapolated") else "inside"

    def ratios(self) -> dict[str, float]:
        """Return error after over the reference's, on check runs, by channel."""
        found = {c: self.check(c, "after") / self.check(c, "reference") for c in self.channels}
        return {channel: ratio for channel, ratio in found.items() if np.isfinite(ratio)}


def shown(value: float, channel: str) -> str:
    """Return an error with its unit, "" where there is none."""
    _, unit, scale = UNITS.get(channel, (channel, "", 1.0))
    return f"{value * scale:.3g} {unit}" if np.isfinite(value) else ""


def told(answer: dict[str, Any]) -> str:
    """Return what is named: effects, then curves and single runs."""
    if "failed" in answer:
        return f"FAILED: {answer['failed'][:120]}"
    if not answer:
        return ""
    names = [effect["name"] for effect in answer.get("effects", ())]
    names += [f"curve: {curve.get('port')} over {curve.get('over')}" for curve in answer.get("curves", ())]
    names += [f"{run.get('file')}: {run.get('parameter')}" for run in answer.get("runs", ())]
    return f"{answer.get('verdict')}: {', '.join(names) or 'nothing'}"


def print_rows(rows: Sequence[Row]) -> None:
    """Print the table, a line for each channel of each case."""
    columns = ["case", "an expert expects", "named", "check", "before", "after", "reference", "ratio", "s", "ref. s"]
    lines = []
    for row in rows:
        seconds = [f"{one['seconds']:.3g}" if "seconds" in one else "" for one in (row.answer, row.reference)]
        starts = [row.name, ", ".join(row.case.expects), told(row.answer)]
        if "failed" in row.reference:
            starts[2] = f"{starts[2]} reference FAILED: {row.reference['failed'][:120]}".strip()
        ratios = row.ratios()
        for number, channel in enumerate(row.channels or ("",)):
            errors = [shown(row.check(channel, when), channel) for when in ("before", "after", "reference")]
            ratio = f"{ratios[channel]:.2f}" if channel in ratios else ""
            start, end = (starts, seconds) if number == 0 else ([""] * 3, [""] * 2)
            lines.append([*start, UNITS.get(channel, (channel,))[0], *errors, ratio, *end])
    table("Real cases: root mean square error on runs that were never fitted", columns, lines, right=range(4, 10))


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Return what the rows come to."""
    ratios = {f"{row.name} {channel}": ratio for row in rows for channel, ratio in row.ratios().items()}
    answered = [row for row in rows if row.answer and "failed" not in row.answer]
    targets = [
        {
            "case": row.name,
            "channel": channel,
            "at_most": most,
            "after": row.check(channel, "after"),
            "reference": row.check(channel, "reference"),
            "met": bool(row.check(channel, "after") <= most),
        }
        for row in rows
        for channel, most in row.case.targets.items()
    ]
    worst = max(ratios, key=ratios.__getitem__, default="")
    by_channel: dict[str, dict[str, list[float]]] = {}
    for row in answered:
        for channel, ratio in row.ratios().items():
            by_channel.setdefault(row.where, {}).setdefault(channel, []).append(ratio)
    means = {
        where: {channel: float(np.exp(np.mean(np.log(some)))) for channel, some in of.items()}
        for where, of in by_channel.items()
    }
    return {
        "geometric_means": means,
        "ratios": len(ratios),
        "median_ratio": float(np.median(list(ratios.values()))) if ratios else None,
        "worst_ratio": ratios.get(worst),
        "worst": worst,
        "expected_named": sum(row.all_expected for row in answered),
        "answered": len(answered),
        "failed": [row.name for row in rows if "failed" in row.answer or "failed" in row.reference],
        "targets": targets,
    }


def sentences(found: dict[str, Any]) -> Iterator[str]:
    """Yield the summary as lines for a person."""
    if found["ratios"]:
        yield (
            f"Error after over the reference's: median {found['median_ratio']:.2f} (asked: at most {ASKED_MEDIAN:g}),"
            f" worst {found['worst_ratio']:.2f}, {found['worst']} (asked: at most {ASKED_WORST:g}),"
            f" of {found['ratios']} cases and channels."
        )
    for where, of in sorted(found["geometric_means"].items()):
        parts = []
        for channel, mean in of.items():
            most = ASKED_MEAN[where].get(channel, ASKED_INSIDE if where == "inside" else None)
            asked = f" (asked: at most {most:g})" if most else ""
            parts.append(f"{UNITS.get(channel, (channel,))[0]} {mean:.2f}{asked}")
        yield f"Geometric mean, check runs {where} the fitted conditions: {', '.join(parts)}."
    if found["answered"]:
        yield (
            f"The expert's effects are named in {found['expected_named']} of {found['answered']} cases"
            f" (asked: {ASKED_NAMED:.0%})."
        )
    for target in found["targets"]:
        channel, reference = target["channel"], shown(target["reference"], target["channel"])
        after = shown(target["after"], channel)
        verdict = f"{after}: {'met' if target['met'] else 'NOT met'}" if after else "not diagnosed"
        yield f"{target['case']}: at most {shown(target['at_most'], channel)} asked, {verdict} (reference {reference})."
    if found["failed"]:
        yield f"Failed: {', '.join(found['failed'])}."


def print_summary(found: dict[str, Any]) -> None:
    """Print the summary."""
    for sentence in sentences(found):
        say(sentence)


def print_halves(found: Mapping[str, Mapping[str, Any]]) -> None:
    """Print what each half of the fit runs says of each parameter, and of how many the intervals overlap."""
    lines = []
    for name, case in found.items():
        if "failed" in case:
            lines.append([name, case["failed"], "", "", "", ""])
        for one in case.get("parameters", ()):
            values = [f"{value:.4g} ± {sd:.2g}" for value, sd in zip(one["values"], one["sd"], strict=True)]
            lines.append([name, one["name"], *values, one["unit"], "" if one["overlap"] else "apart"])
    table(
        "Parameters from two halves of the fit runs", ["case", "parameter", "one half", "the other", "unit", ""], lines
    )
    overlap, count = overlapping(found)
    say(f"The 95 % intervals of {overlap} of {count} parameters overlap (asked: {ASKED_OVERLAP:.0%}).")


def overlapping(found: Mapping[str, Mapping[str, Any]]) -> tuple[int, int]:
    """Return of how many parameters of all cases the intervals overlap, and how many there are."""
    overlaps = [one["overlap"] for case in found.values() for one in case.get("parameters", ())]
    return sum(overlaps), len(overlaps)
