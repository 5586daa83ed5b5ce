"""How good the diagnosis is on blind cases: each rate with its interval, power by effect, reliability, the misses."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discrepancy.bench import GROUPS
from benchmarks.discrepancy.grades import judge
from benchmarks.discrepancy.hidden import Blind
from benchmarks.discrepancy.outside import ACTS_ON
from benchmarks.discrepancy.rates import Rate, in_words, rate

SURE = 0.95
# A candidate more probable than this is not ruled out.
RIVAL = 0.05
# Of the true effect, in sigma after projection: what the data show clearly. Not known where it was not gathered.
CLEAR = 4.0
# Of one of several: what stands out so far should not be missed.
STRONG = 12.0
# What a line does not tell where it is nothing.
_IF_ANY = ("heavy", "decoy", "rival", "beside", "stands_out")
BINS = (0.0, 0.5, 0.8, 0.95, 1.0)


@dataclasses.dataclass(frozen=True)
class Judged:
    """One blind case, what was said of it, how long that took, and by how many sigma its faintest effect stands out."""

    number: int
    blind: Blind
    said: dict[str, Any]
    seconds: float
    sigma: float = float("nan")

    @property
    def named(self) -> list[str]:
        """The effects named, in their order."""
        return [effect["name"] for effect in self.said["effects"]]

    @property
    def right(self) -> bool:
        """Whether the verdict and, where effects of the catalogue were hidden, all names are right.

        Of a case nearer to a bench: whether all is told that its class asks for.
        """
        if self.blind.group in GROUPS:
            return self.grade == "right"
        names = self.blind.outside or sorted(self.named) == sorted(self.blind.effects)
        return self.said["verdict"] == self.blind.verdict and bool(names)

    @property
    def grade(self) -> str:
        """How right the answer is: "right", "part" or "wrong"."""
        return judge(self.blind.truth, self.said).grade

    @property
    def faintest(self) -> float:
        """By how many sigma the faintest hidden thing stands out; nan where that is not known."""
        return min(self.blind.stands_out.values(), default=self.sigma)

    @property
    def first_three(self) -> list[str]:
        """The effects of the likeliest hypotheses, named ones first."""
        others = [name for each in self.said["candidates"] for name in each["name"].split("+")]
        return list(dict.fromkeys([*self.named, *others]))[:3]

    @property
    def not_ruled_out(self) -> set[str]:
        """The effects named, what they cannot be told from and, where the answer is undecided, the candidates."""
        rivals = [rival for effect in self.said["effects"] for rival in effect["cannot_tell_apart_from"]]
        likely = [each["name"] for each in self.said["candidates"] if each["probability"] > RIVAL]
        return {*self.named, *rivals, *(likely if self.said["verdict"] == "undecided" else ())}

    @property
    def first_is_right(self) -> bool:
        """Whether the likeliest effect is the one hidden."""
        return self.first_three[:1] == list(self.blind.effects)

    @property
    def in_first_three(self) -> bool:
        """Whether all that is hidden is among the likeliest."""
        return set(self.blind.effects) <= set(self.first_three)

    @property
    def right_equation(self) -> bool:
        """Whether a law in no catalogue is told where it acts."""
        said = self.said["unexplained"] or ""
        return self.said["verdict"] == "unknown_effect" and any(e in said for e in ACTS_ON[self.blind.outside])

    @property
    def probability(self) -> float:
        """What the answer gives its best hypothesis."""
        return max((each["probability"] for each in self.said["candidates"]), default=float("nan"))

    @property
    def after_over_floor(self) -> float:
        """The worst channel's error on check runs with the effects added, over its noise floor."""
        ratios = [e["after"]["check"] / e["noise_floor"] for e in self.said["error"].values() if e["after"]["check"]]
        return max(ratios, default=float("nan"))

    def covered(self) -> list[bool]:
        """Whether each parameter of the effects lies in its 95 % interval, where the right effects are named."""
        found = []
        for effect in self.said["effects"]:
            truth = self.blind.effects.get(effect["name"], {})
            if "other" in truth:  # of another form: its numbers are not the catalogue's
                continue
            for name, estimate in effect["parameters"].items():
                if isinstance(estimate, dict) and name in truth and estimate["sd"]:
                    found.append(abs(estimate["value"] - truth[name]) < 1.96 * estimate["sd"])
        return found


def metrics(cases: Sequence[Judged]) -> dict[str, Rate | float]:
    """Return every figure of merit by name; nan without a case."""
    nulls = [c for c in cases if c.blind.group == "null"]
    singles = [c for c in cases if c.blind.group == "single"]
    doubles = [c for c in cases if c.blind.group == "double"]
    clear = [c for c in singles if c.sigma >= CLEAR]
    sensors = [c for c in cases if c.blind.group == "sensor"]
    catalogued = [c for c in cases if c.blind.effects]
    physics = [c for c in cases if c.blind.verdict == "missing_effect" and c.blind.effects]
    outside = [c for c in cases if c.blind.outside]
    alike = [c for c in cases if c.blind.rival]
    sure = [c for c in cases if c.probability > SURE]
    ratios = [c.after_over_floor for c in catalogued if c.right]
    near_bench = {name: [c for c in cases if c.blind.group == name] for name in GROUPS}
    several = near_bench["several"]
    return {
        "false alarms on clean nulls": rate(c.said["verdict"] != "adequate" for c in nulls if not c.blind.hostile),
        "false alarms on hostile nulls": rate(c.said["verdict"] != "adequate" for c in nulls if c.blind.hostile),
        "right verdict": rate(c.said["verdict"] == c.blind.verdict for c in cases),
        "singles: right effect first": rate(c.first_is_right for c in singles),
        "singles: right effect in the first three": rate(c.in_first_three for c in singles),
        f"singles above {CLEAR:g} sigma: right effect first": rate(c.first_is_right for c in clear),
        f"singles above {CLEAR:g} sigma: in the first three": rate(c.in_first_three for c in clear),
        "doubles exactly right": rate(c.right for c in doubles),
        f"doubles both above {CLEAR:g} sigma: exactly right": rate(c.right for c in doubles if c.sigma >= CLEAR),
        "outside the catalogue recognised": rate(c.said["verdict"] == "unknown_effect" for c in outside),
        "outside the catalogue: in the right equation": rate(c.right_equation for c in outside),
        "confusable pairs: the right one named": rate(set(c.named) == set(c.blind.effects) for c in alike),
        "confusable pairs: the right one not ruled out": rate(set(c.blind.effects) <= c.not_ruled_out for c in alike),
        "confusable pairs: its rival alone named": rate(
            c.blind.rival in c.named and not set(c.blind.effects) <= c.not_ruled_out for c in alike
        ),
        "several at once: all named, no other": rate(c.right for c in several),
        f"several, each above {STRONG:g} sigma: all named": rate(c.right for c in several if c.faintest >= STRONG),
        "several at once: half of them at least": rate(c.grade != "wrong" for c in several),
        "a wrong table told, and the effects": rate(c.right for c in near_bench["table"]),
        "a wrong table told, or the effects": rate(c.grade != "wrong" for c in near_bench["table"]),
        "one bad run told as that run": rate(c.right for c in near_bench["run"]),
        "wrong stated noise: right all the same": rate(c.right for c in near_bench["noise"]),
        "numbers and sizes that no prior foretells": rate(c.right for c in near_bench["prior"]),
        "extrapolation told": rate(c.right for c in near_bench["extrapolation"]),
        "the immaterial left alone": rate(c.right for c in near_bench["immaterial"]),
        "all that is hidden named": rate(set(c.blind.effects) <= set(c.named) for c in catalogued),
        "known effects called unknown": rate(c.said["verdict"] == "unknown_effect" for c in catalogued),
        "physics called a sensor's fault": rate(c.said["verdict"] == "sensor_fault" for c in physics),
        "a sensor's fault called physics": rate(c.said["verdict"] == "missing_effect" for c in sensors),
        f"answers above {SURE} that are right": rate(c.right for c in sure),
        "parameters in their 95 % interval": rate(hit for c in catalogued if c.right for hit in c.covered()),
        "check error over floor, median": float(np.median(ratios)) if ratios else float("nan"),
        "check error over floor, 95th percentile": float(np.quantile(ratios, 0.95)) if ratios else float("nan"),
        "seconds a case, median": float(np.nanmedian([c.seconds for c in cases])),
    }


def power(cases: Sequence[Judged]) -> dict[str, Rate]:
    """Return by effect how often it was named where it was hidden."""
    found: dict[str, list[bool]] = defaultdict(list)
    for case in cases:
        for name in case.blind.effects:
            found[name].append(name in case.named)
    return {name: rate(hits) for name, hits in sorted(found.items())}


def reliability(cases: Sequence[Judged]) -> dict[str, Rate]:
    """Return by probability of the best hypothesis how often the answer is right."""
    bins = itertools.pairwise(BINS)
    return {
        f"{low:.2f} to {high:.2f}": rate(c.right for c in cases if low < c.probability <= high) for low, high in bins
    }


def calibration_error(cases: Sequence[Judged]) -> float:
    """Return the expected calibration error: |share of right answers - mean probability| over the bins, by cases.

    ECE of Naeini et al., "Obtaining well calibrated probabilities using Bayesian binning", AAAI 2015, with `BINS`.
    """
    found = 0.0
    for low, high in itertools.pairwise(BINS):
        if some := [c for c in cases if low < c.probability <= high]:
            right, said = np.mean([c.right for c in some]), np.mean([c.probability for c in some])
            found += abs(float(right - said)) * len(some) / len(cases)
    return found


def report(cases: Sequence[Judged]) -> str:
    """Return everything as text, the misses last."""
    lines = [f"{len(cases)} blind cases", ""]
    for title, table in (
        ("", metrics(cases)),
        ("named where hidden", power(cases)),
        ("right at a probability of", reliability(cases)),
    ):
        lines += [*([title] if title else []), *(f"{name:44s} {in_words(found)}" for name, found in table.items()), ""]
    lines += [f"expected calibration error {calibration_error(cases):.3f}", "", "not right"]
    for case in cases:
        if not case.right:
            beside = [f"{case.blind.group}: {case.blind.beside}"] if case.blind.beside else []
            hidden = case.blind.outside or ", ".join([*case.blind.effects, *beside]) or "nothing"
            said = ", ".join(case.named) or case.said["unexplained"] or "nothing"
            lines.append(f"{case.number:04d} {case.blind.kind}: {hidden} | {case.said['verdict']}: {said}")
    return "\n".join(lines)


def read_blind(path: Path) -> Blind:
    """Return what is hidden in a case."""
    hidden = json.loads((path / "blind.json").read_text())
    hidden.pop("verdict", None)  # follows from the group
    return Blind(**hidden)


def keep(cases: Sequence[Judged], file: Path) -> list[Judged]:
    """Write cases into a file, one a line, beside those that it has of other seeds; return all in order."""
    lines = file.read_text().splitlines() if file.exists() else []
    known = {case.number: case for case in (_of_line(json.loads(line)) for line in lines)}
    known |= {case.number: case for case in cases}
    ordered = [known[number] for number in sorted(known)]
    file.write_text("".join(f"{_line(case)}\n" for case in ordered))
    return ordered


def _line(case: Judged) -> str:
    kept: dict[str, Any] = dataclasses.asdict(case) | {"sigma": None if np.isnan(case.sigma) else case.sigma}
    kept["blind"] = {name: value for name, value in kept["blind"].items() if value or name not in _IF_ANY}
    return json.dumps(kept)


def _of_line(kept: dict[str, Any]) -> Judged:
    sigma = float("nan") if kept["sigma"] is None else kept["sigma"]
    return Judged(**kept | {"blind": Blind(**kept["blind"]), "sigma": sigma})


def _sigma(screened: Path) -> float:
    """Return by how many sigma the faintest hidden effect of a case stands out, nan where that was not gathered."""
    hidden = json.loads(screened.read_text())["hidden"] if screened.exists() else {}
    return min((sigma or 0.0 for sigma in hidden.values()), default=float("nan"))


def read(folder: Path) -> list[Judged]:
    """Return the cases of a folder that were diagnosed."""
    found = []
    for path in sorted(folder.glob("[0-9]*")):
        hidden, said = path / "blind.json", path / "said.json"
        if hidden.exists() and said.exists():
            answer = json.loads(said.read_text())
            seconds = answer.get("seconds", float("nan"))
            found.append(Judged(int(path.name), read_blind(path), answer, seconds, _sigma(path / "evidence.json")))
    return found
