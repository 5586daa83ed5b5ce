"""Two halves of the fit runs of a real case: do their parameters agree within the intervals that are stated?

The expert's effects are fitted to every other fit run, and to the rest. A parameter counts where both halves tell of
it: each reduces its prior sd to less than half.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from benchmarks.real.cases import RealCase
from jaxmodel.case.records import Case
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimates import estimates_of
from jaxmodel.fit.lanes import one_thread_of_blas

# Half the width of an interval, in sd: 95 % of a normal.
INTERVAL = 1.96
# Share of its prior sd below which a half tells of a parameter. Assumed.
TOLD = 0.5


@one_thread_of_blas
def halves(real: RealCase, case: Case) -> dict[str, Any]:
    """Return the parameters that both halves tell, with their numbers, sd and whether the intervals overlap.

    `failed` says why there are none: a case of one fit run has no halves.
    """
    fitted = [run for run in case.runs if run.split == "fit"]
    if len(fitted) < 2:
        return {"failed": "one fit run has no halves"}
    found = []
    for half in (fitted[::2], fitted[1::2]):
        cache = FitCache(dataclasses.replace(case, runs=tuple(half)))
        expected = [name for of in real.expects for name in of.split("|")[:1]]
        fit = cache.fit(cache.space.labels_of([name for name in expected if name in _names(cache)]))
        told = {
            cache.space.layout.coordinates[place].name
            for place, sd in zip(fit.spec.free, fit.sd, strict=True)
            if sd < TOLD and cache.space.layout.runs[place] < 0
        }
        found.append({name: one for name, one in estimates_of(cache, fit)[0].items() if name in told})
    one, other = found
    parameters = [
        {
            "name": name,
            "values": [one[name].value, other[name].value],
            "sd": [one[name].sd, other[name].sd],
            "unit": one[name].unit,
            "overlap": bool(abs(one[name].value - other[name].value) <= INTERVAL * (one[name].sd + other[name].sd)),
        }
        for name in one
        if name in other
    ]
    return {"runs": [[run.name for run in half] for half in (fitted[::2], fitted[1::2])], "parameters": parameters}


def _names(cache: FitCache) -> set[str]:
    return {candidate.name for candidate in cache.space.candidates.values()}
