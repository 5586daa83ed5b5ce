"""What simpler methods say of the same cases: correlation and stepwise selection here, LASSO and SINDy by `peers.py`.

Each sees one screening's arrays, errors in units of their noise's sd and as correlated as they are, and says whether
the model is adequate and which effects it would name, first first.
"""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.stats import chi2, norm

from benchmarks.discrepancy.evidence import Evidence, read_evidence
from benchmarks.peer import ENVIRONMENT

SIGNIFICANT = 0.05
# A direction of which less survives is kept as the part within the base alone; see `evidence._whole`.
ABSORBED = 3e-3
MOST_STEPS = 12
PEERS = Path(__file__).with_name("peers.py")


@dataclasses.dataclass(frozen=True)
class Says:
    """What a method says of a case.

    Attributes:
        adequate: nothing is missing.
        ranking: labels of effects, likeliest first.
        named: how many of them the method would name.
        unknown: something in no catalogue is missing; only ours can say so.
    """

    adequate: bool
    ranking: tuple[str, ...]
    named: int
    unknown: bool = False

    @property
    def effects(self) -> list[str]:
        """The effects named, without their columns."""
        return [] if self.adequate else [label.split(":")[0] for label in self.ranking[: self.named]]

    @property
    def first(self) -> str:
        """The likeliest effect, "" where none is named or an unknown one is likelier."""
        return next(iter(self.effects), "")


def best_of_each(names: Iterable[str], strength: np.ndarray) -> tuple[str, ...]:
    """Return the candidates by their strongest column."""
    names = [str(name) for name in names]
    return tuple(dict.fromkeys(names[place] for place in np.argsort(-strength, kind="stable") if strength[place] > 0.0))


def correlation(evidence: Evidence) -> Says:
    """Rank by |r's| / |r||s|, r the residual and s an effect's sensitivity, both as they are.

    The mean is not taken out: an offset would have nothing left. Adequate where the largest is within what white noise
    gives in 5 % of cases (Bonferroni over all columns).
    """
    plain = evidence.coloured()
    residual, effects = plain.residual[: plain.rows], plain.effects[: plain.rows]
    lengths = np.linalg.norm(effects, axis=0) * np.linalg.norm(residual)
    found = np.abs(residual @ effects) / np.where(lengths > 0.0, lengths, np.inf)
    limit = norm.isf(0.5 * SIGNIFICANT / found.size) / np.sqrt(plain.rows)
    return Says(bool(found.max() < limit), best_of_each(plain.names, found), 1)


def stepwise(evidence: Evidence, bic: bool) -> Says:
    """Add the effect of the largest drop in chi-square, all else refitted linearly, until the drop is too small.

    Too small is below the 5 % point of chi-square, or with `bic` below log n. Signs are free.
    """
    plain = evidence.coloured()
    least = np.log(plain.rows) if bic else chi2.isf(SIGNIFICANT, 1)
    length = np.linalg.norm(plain.effects, axis=0)
    columns = plain.effects / np.where(length > 0.0, length, 1.0)
    basis, _ = np.linalg.qr(plain.base / np.maximum(np.linalg.norm(plain.base, axis=0), 1e-300))
    columns, left = columns - basis @ (basis.T @ columns), plain.residual - basis @ (basis.T @ plain.residual)
    chosen: list[str] = []
    for _ in range(MOST_STEPS):
        size = np.linalg.norm(columns, axis=0)
        free = (size > ABSORBED) & ~np.isin(plain.names, chosen)
        drops = np.where(free, (columns.T @ left) ** 2 / np.where(free, size, 1.0) ** 2, 0.0)
        best = int(np.argmax(drops))
        if drops[best] < least:
            break
        chosen.append(str(plain.names[best]))
        unit = columns[:, best] / size[best]
        columns, left = columns - np.outer(unit, unit @ columns), left - unit * (unit @ left)
    return Says(not chosen, tuple(chosen), len(chosen))


def by_peers(folders: list[Path]) -> None:
    """Let LASSO and SINDy, in the peers' environment, say what they say of cases; kept beside each."""
    wanted = [folder for folder in folders if not (folder / "peers.json").exists()]
    python = ENVIRONMENT / "bin" / "python"
    if not wanted or not python.exists():
        return
    for folder in wanted:
        write_plain(folder)
    alone = os.environ | {"OMP_NUM_THREADS": "1"}  # products this small are slower on many threads
    subprocess.run([str(python), str(PEERS), *map(str, wanted)], check=True, env=alone)
    for folder in wanted:
        (folder / "plain.npz").unlink()


def write_plain(folder: Path) -> None:
    """Write the rows of a case as the peers read them."""
    plain = read_evidence(folder / "evidence.npz").coloured()
    given = {f"conditions.{name}": values for name, values in plain.conditions.items() if name != "run"}
    np.savez(
        folder / "plain.npz",
        allow_pickle=False,
        residual=plain.residual[: plain.rows],
        effects=plain.effects[: plain.rows],
        names=plain.names,
        channel=plain.channel,
        run=plain.run,
        **given,
    )


def baselines(folder: Path) -> dict[str, Says]:
    """Return what each baseline says of a case that was gathered."""
    evidence = read_evidence(folder / "evidence.npz")
    found = {
        "residual correlation": correlation(evidence),
        "stepwise, 5 %": stepwise(evidence, bic=False),
        "stepwise, BIC": stepwise(evidence, bic=True),
    }
    kept = folder / "peers.json"
    if kept.exists():
        found |= {name: Says(**says) for name, says in json.loads(kept.read_text()).items()}
    return found
