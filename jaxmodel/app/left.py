"""How long some work may still take, estimated from the parts that are left and from what a part has taken so far."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping

# What the parts of a search take, in passes over all candidates, by their first words. Measured on cells and robots of
# 3 to 7 runs: what is estimated with them is right within a factor of about two.
_UNITS = {
    "trying": 1.0,
    "refitting with": 0.8,
    "calibrating with": 0.5,
    "adding": 0.0,
    "dropping": 0.3,
    "replacing": 0.3,
    "refitting the law": 0.8,
    "comparing models": 1.0,
    "searching for": 0.5,
    "pictures": 1.5,
}
# A part that takes so many times what was estimated, and some seconds, shows that the estimate was wrong.
_TOO_LONG, _SLACK_S = 2.0, 2.0
_TRYING = re.compile(r"trying (\d+) candidates")
# A round that is still to come: all candidates are tried, and so many pairs of them refitted.
_ROUND = _UNITS["trying"] + 3 * _UNITS["refitting with"]


def of_part(table: Mapping[str, float], now: str) -> float | None:
    """Return the value of the part that begins with the most words of a table; None for another part."""
    known = [start for start in table if now.startswith(start)]
    return table[max(known, key=len)] if known else None


class Left:
    """The time that some work may still take.

    Work without a search has shares: the time to the start of a part tells how long the rest takes. A search repeats
    its parts, and how often is not known before. What is left of it is counted instead: the pairs of candidates that
    are still to be refitted, a further round after the first addition, and the end. Before the first part of a search
    is done no time is named.
    """

    def __init__(self, shares: Mapping[str, float]) -> None:
        """Begin now; `shares` of the work are usually done when a part begins, by its first words."""
        self._shares = shares
        self._began = self._part_began = time.perf_counter()
        self._reached, self._scale_s = 0.0, 0.0
        self._estimated: float | None = None
        self._least = 0.0
        self._search: _Search | None = None

    @property
    def elapsed_s(self) -> float:
        """Return how long the work has taken."""
        return time.perf_counter() - self._began

    @property
    def share(self) -> float | None:
        """Return the share of a search that was done when its present part began; None where there is none."""
        return None if self._search is None else self._search.share

    def begin(self, now: str) -> None:
        """Take note that a part begins."""
        at = time.perf_counter()
        if self._search is None and _TRYING.match(now):
            self._search = _Search(at, "pictures" in self._shares)
        if self._search is None:
            self._by_shares(now, at)
        elif self._search.begin(now):
            self._part_began = at
            self._estimated, self._least = self._search.left_s(at)

    def seconds(self) -> float | None:
        """Return the time left now; None where it is not known, or a part lasts far longer than was estimated."""
        if self._estimated is None:
            return None
        gone = time.perf_counter() - self._part_began
        if gone > _TOO_LONG * (self._estimated - self._least) + _SLACK_S:
            return None
        return max(self._estimated - gone, self._least)

    def _by_shares(self, now: str, at: float) -> None:
        share = of_part(self._shares, now)
        if not share:
            return
        if share > self._reached:  # a part that comes again is no further
            self._reached, self._scale_s = share, (at - self._began) / share
        later = min((one for one in self._shares.values() if one > share), default=1.0)
        self._part_began, self._estimated = at, self._scale_s * (1.0 - share)
        self._least = self._scale_s * (1.0 - later)


class _Search:
    """What is done and what is left of a search, in passes over all candidates."""

    def __init__(self, at: float, with_pictures: bool) -> None:
        self._began = at
        self._end = _UNITS["comparing models"] + _UNITS["searching for"] + with_pictures * _UNITS["pictures"]
        self._done = self._own = 0.0  # of the part that is under way
        self._pairs, self._of_round = 0, 0  # that are still to be refitted, and all of the present round
        self._rounds, self._likely = 2, 1.0

    @property
    def share(self) -> float:
        """Return the share that is done."""
        return self._done / (self._done + self._own + self._later)

    def begin(self, now: str) -> bool:
        """Take note that a part begins; False for what is none of a search."""
        own = of_part(_UNITS, now)
        if own is None:
            return False
        self._done += self._own
        if found := _TRYING.match(now):
            self._pairs = self._of_round = -(-int(found[1]) // 2)
            self._rounds, self._likely = max(self._rounds - 1, 0), 1.0
        elif now.startswith("adding"):
            self._pairs, self._rounds, self._likely = 0, 1, 1.0
        elif now.startswith("refitting with") and "beside" not in now:
            # The best come first: the further a round goes, the less likely is it that one enters and another follows.
            self._likely = self._pairs / max(self._of_round, 1)
            self._pairs = max(self._pairs - 1, 0)
        elif now.startswith(("comparing models", "searching for", "pictures")):
            self._pairs, self._rounds, self._end = 0, 0, max(self._end - own, 0.0)
        self._own = own
        return True

    def left_s(self, at: float) -> tuple[float | None, float]:
        """Return the time left from the start of the present part, and from its end; None before one is done."""
        if not self._done:
            return None, 0.0
        of_one = (at - self._began) / self._done
        return of_one * (self._own + self._later), of_one * self._later

    @property
    def _later(self) -> float:
        """Return what follows the present part."""
        return self._pairs * _UNITS["refitting with"] + self._likely * self._rounds * _ROUND + self._end
