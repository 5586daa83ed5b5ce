"""Everything that the proving ground says of the cases diagnosed and screened, as tables, JSON and pictures."""

from __future__ import annotations

import collections
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discrepancy.ablations import IN_ANSWER
from benchmarks.discrepancy.compare import OURS, markdown, rates, read_compared, read_hidden, read_lifts
from benchmarks.discrepancy.judge import Rate, metrics, power, read, reliability
from benchmarks.discrepancy.pictures import power_picture, range_picture, reliability_picture
from workbench.pictures.style import png

BASELINES = (OURS, "residual correlation", "stepwise, 5 %", "stepwise, BIC", "LASSO", "SINDy")


def publish(folder: Path, out: Path) -> None:
    """Write `tables.md`, `results.json` and three pictures into `out`."""
    cases = read(folder)
    compared = rates(read_compared(folder, cases))
    hidden = read_hidden(folder, cases)
    ablated = [name for name in compared if name.startswith("score") or name in IN_ANSWER]
    groups = collections.Counter(f"{c.blind.kind}, {c.blind.group}" for c in cases)
    out.mkdir(parents=True, exist_ok=True)
    for name, figure in (
        ("power", power_picture(hidden)),
        ("range", range_picture(read_lifts(folder, cases))),
        ("reliability", reliability_picture(cases)),
    ):
        (out / f"{name}.png").write_bytes(png(figure))
    everything: dict[str, Any] = {
        "cases": len(cases),
        "first": min(c.number for c in cases),
        "last": max(c.number for c in cases),
        "groups": dict(sorted(groups.items())),
        "metrics": metrics(cases),
        "reliability": reliability(cases),
        "power": power(cases),
        "methods": compared,
    }
    (out / "results.json").write_text(json.dumps(_plain(everything), indent=1) + "\n")
    parts = [
        f"{len(cases)} cases diagnosed.",
        _table("figure of merit", metrics(cases)),
        markdown(compared, "method", BASELINES),
        markdown(compared, "with one part left out", [OURS, *ablated]),
        _table("right at a probability of", reliability(cases)),
        _table("named where hidden", power(cases)),
    ]
    (out / "tables.md").write_text("\n\n".join(parts) + "\n")


def _table(first: str, found: Mapping[str, Rate | float]) -> str:
    lines = [f"| {first} | share | 95 % interval | of |", "| --- | --- | --- | --- |"]
    for name, value in found.items():
        if isinstance(value, Rate) and value.of:
            low, high = value.interval
            cells = f"{value.share:.0%} | {low:.0%} to {high:.0%} | {value.hits} of {value.of}".replace("%", " %")
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
