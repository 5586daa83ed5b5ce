"""From an investigation to a diagnosis: search on from where it is, or take its present model as the final one."""

from __future__ import annotations

from collections.abc import Callable

from jaxmodel.diagnosis.diagnosis import comparison, conclude
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.fit.lanes import one_thread_of_blas


@one_thread_of_blas
def finish(investigation: Investigation, *, each: Callable[[], None] = lambda: None) -> Diagnosis:
    """Go on with an investigation automatically from its present model, and return the diagnosis.

    Args:
        investigation: what was added to it by hand stays; its present model becomes the final one.
        each: is called whenever its present model has changed; what it raises ends the search there.
    """
    wanted = investigation.added
    found = investigation.search(each)
    return conclude(investigation.searching, found, wanted, [f"--with {name}" for name in wanted])


@one_thread_of_blas
def conclusion(investigation: Investigation) -> Diagnosis:
    """Return the present model of an investigation as a diagnosis that tests no other candidate; nothing is refitted.

    Args:
        investigation: without additions, the result is that of `compare`.
    """
    wanted = investigation.added
    if not wanted:
        return comparison(investigation.cache)
    search = investigation.searching
    return conclude(search, search.run(wanted, seek=False), wanted, [f"--add {name}" for name in wanted])
