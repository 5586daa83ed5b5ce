"""What the proving ground says of the sealed cases: the tables of its page, JSON and pictures."""

from __future__ import annotations

import collections
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discrepancy.bench import BENCH_FROM
from benchmarks.discrepancy.generate import CONFUSABLE_FROM, HARDER_FROM
from benchmarks.discrepancy.judge import Judged, calibration_error, keep, metrics, power, read, reliability
from benchmarks.discrepancy.pictures import reliability_picture
from benchmarks.discrepancy.rates import Rate, markdown
from jaxmodel.plots.style import png

SEALED_FROM = 1000
# Begins the names of files with the answers to cases of one group.
ALONE = "alone-"
# What is asked of the sealed cases, in the words of the page.
ASKED = {
    "false alarms on clean nulls": "at most 5 %",
    "false alarms on hostile nulls": "at most 8 %",
    "right verdict": "90 %",
    "singles above 4 sigma: right effect first": "90 %",
    "singles above 4 sigma: in the first three": "98 %",
    "doubles exactly right": "80 %",
    "outside the catalogue recognised": "90 %",
    "outside the catalogue: in the right equation": "80 %",
    "known effects called unknown": "at most 5 %",
    "physics called a sensor's fault": "at most 5 %",
    "a sensor's fault called physics": "at most 5 %",
    "answers above 0.95 that are right": "93 %",
    "parameters in their 95 % interval": "92 to 98 %",
    "check error over floor, median": "at most 1.05",
    "check error over floor, 95th percentile": "at most 1.2",
}


def publish(folder: Path, page: Path, group: str | None = None) -> None:
    """Write the figures of sealed cases into a page, and `results.json` and pictures into a folder of the page's name.

    The answers are kept in `sealed.jsonl`, those of harder cases in `harder.jsonl`, of confusable pairs in
    `confusable.jsonl`, of those nearer to a bench in `bench.jsonl`: so many cases take hours, and need not be diagnosed
    in one go. Those of earlier versions are in
    `before.jsonl`, `harder-before.jsonl` and `opened.jsonl`; they stand beside, and judge no more.

    Args:
        folder: with cases made and diagnosed.
        page: to be filled.
        group: where the folder has cases of this group alone, kept in a file of their own: they say nothing of others.
    """
    out = page.with_suffix("")
    names = ("before", "opened", "harder-before", "sealed")
    before, opened, harder_before, cases = (keep([], out / f"{name}.jsonl") for name in names)
    seen = {case.number for case in (*before, *opened, *harder_before)}
    new = [case for case in read(folder) if case.number >= SEALED_FROM and case.number not in seen]
    if group is not None:
        keep([case for case in new if case.blind.group == group], out / f"{ALONE}{group}.jsonl")
    else:
        cases = keep([case for case in new if case.number < HARDER_FROM], out / "sealed.jsonl")
    harder = keep([case for case in new if HARDER_FROM <= case.number < CONFUSABLE_FROM], out / "harder.jsonl")
    alike = keep([case for case in new if CONFUSABLE_FROM <= case.number < BENCH_FROM], out / "confusable.jsonl")
    bench = keep([case for case in new if case.number >= BENCH_FROM], out / "bench.jsonl")
    alone = {path.stem.removeprefix(ALONE): keep([], path) for path in sorted(out.glob(f"{ALONE}*.jsonl"))}
    sets = {"sealed": cases}
    sets |= {f"{name}s alone": some for name, some in alone.items()}
    sets |= {"harder": harder, "confusable": alike, "near a bench": bench}
    sets |= {"version before": before, "both": [*before, *cases], "versions before that": opened}
    sets |= {"harder, version before": harder_before}
    tables = {
        "cases": _in_words(cases),
        "metrics": _side_by_side({name: metrics(some) for name, some in sets.items() if some}),
        "reliability": _table("right at a probability of", reliability([*before, *cases])),
        "power": _table("named where hidden", power([*before, *cases])),
        "bench": _by_class(bench),
    }
    figures = {"sealed": _summary(cases)} | {f"{name}s alone": _summary(some) for name, some in alone.items()}
    figures |= {name: _summary(sets[name]) for name in ("harder", "confusable", "near a bench") if sets[name]}
    (out / "reliability.png").write_bytes(png(reliability_picture([*before, *cases])))
    _write(out / "results.json", figures)
    page.write_text(filled(page.read_text(), tables))


def _groups(cases: Sequence[Judged]) -> dict[str, int]:
    """Return how many cases there are of each group and kind."""
    return dict(sorted(collections.Counter(f"{c.blind.group} ({c.blind.kind})" for c in cases).items()))


def _by_class(cases: Sequence[Judged]) -> str:
    """Return how many cases nearer to a bench are right, in part and wrong, by what is judged in them."""
    counted = collections.Counter((case.blind.told_as, case.grade) for case in cases)
    grades = ("right", "part", "wrong")
    found = {name: {g: str(counted[name, g]) for g in grades} for name in sorted({name for name, _ in counted})}
    return markdown(found, "class") if found else "No case yet."


def _in_words(cases: Sequence[Judged]) -> str:
    return f"{len(cases)} cases: {', '.join(f'{count} of {name}' for name, count in _groups(cases).items())}."


def _summary(cases: Sequence[Judged]) -> dict[str, Any]:
    """Return the figures of some cases."""
    return {
        "cases": len(cases),
        "first": min(c.number for c in cases),
        "last": max(c.number for c in cases),
        "groups": _groups(cases),
        "metrics": metrics(cases),
        "reliability": reliability(cases),
        "calibration_error": calibration_error(cases),
        "power": power(cases),
    }


def _write(file: Path, figures: Mapping[str, Any]) -> None:
    """Write figures into a file of JSON, beside others that it has."""
    known = json.loads(file.read_text()) if file.exists() else {}
    file.write_text(json.dumps(known | _plain(figures), indent=1) + "\n")


def filled(text: str, tables: Mapping[str, str]) -> str:
    """Return a page with each table put between `<!-- its name -->` and `<!-- end -->`."""
    for name, table in tables.items():
        before, begin, rest = text.partition(f"<!-- {name} -->")
        if begin:
            text = f"{before}{begin}\n\n{table}\n\n<!-- end -->{rest.partition('<!-- end -->')[2]}"
    return text


def _side_by_side(tables: Mapping[str, Mapping[str, Rate | float]]) -> str:
    """Return figures of merit, a row each, with what is asked of them and a column for each set of cases."""
    turned = {
        name: {"asked": ASKED.get(name, "")} | {title: found[name] for title, found in tables.items()}
        for name in next(iter(tables.values()))
    }
    return markdown(turned, "figure of merit")


def _table(first: str, found: Mapping[str, Rate | float]) -> str:
    lines = [f"| {first} | share | 95 % interval | of |", "| --- | --- | --- | --- |"]
    for name, value in found.items():
        if isinstance(value, Rate) and value.of:
            low, high = value.interval
            cells = f"{100 * value.share:.0f} % | {100 * low:.0f} to {100 * high:.0f} % | {value.hits} of {value.of}"
        else:
            cells = "no case | | " if isinstance(value, Rate) or np.isnan(value) else f"{value:.3g} | | "
        lines.append(f"| {name} | {cells} |")
    return "\n".join(lines)


def _plain(value: Any) -> Any:
    """Return anything as JSON has it; what is not a number is null."""
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, Rate):
        low, high = value.interval
        return {"share": _plain(value.share), "low": low, "high": high, "hits": value.hits, "of": value.of}
    if isinstance(value, float):
        return round(value, 4) if np.isfinite(value) else None
    return value
