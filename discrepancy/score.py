"""The efficient score of every candidate effect at once: which ones would lower chi-square, and which look alike.

One Jacobian at the calibrated base model tests all candidates without a refit. With P the projected sensitivity of a
candidate (`projection`), z = P'r / |P| is standard normal where the effect is absent, z^2 is the drop in chi-square
that a refit with the effect would bring, and eta = P'r / |P|^2 the amplitude it would find.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components
from scipy.stats import norm

from discrepancy.projection import Block, Candidate, Projection, project, z_equivalent
from discrepancy.whitening import Floats

# Of all random numbers: the same case is told the same.
SEED = 0
SAME_COSINE = 0.98
_SEPARATED_SIGMA = 3.0
_VISIBLE_SIGMA = 4.0  # 80 % power at a critical value of 3.2


@dataclass(frozen=True)
class EffectScore:
    """One candidate against the base model.

    Attributes:
        name: the candidate.
        shape: index of its best shape.
        z: signed score for a single amplitude, sqrt(chi2) for several.
        chi2: predicted drop in chi-square within the sign constraints.
        dof: amplitudes tested; 0 where the base absorbs the candidate.
        p: p-value at the best shape: two-sided, one-sided or chi-bar-square.
        z_equivalent: |z| of a two-sided normal test with the same p; what the critical value is for.
        amplitude: (m,) estimates, in the effect's units; 0 for an absorbed column.
        amplitude_sd: (m,) their standard errors; infinite for an absorbed column.
        detectability: |P| / |S|, the share of the effect that no recalibration can imitate.
        hidden_by: the base parameter that moves most, in its own standard errors, to imitate the effect.
    """

    name: str
    shape: int
    z: float
    chi2: float
    dof: int
    p: float
    z_equivalent: float
    amplitude: Floats
    amplitude_sd: Floats
    detectability: float
    hidden_by: str


@dataclass(frozen=True)
class ScoreTable:
    """Every candidate's score, strongest first.

    Attributes:
        effects: the scores.
        critical_z: value that z_equivalent exceeds anywhere in the table in 5 % of data sets without any effect.
        significant: names above it.
        names: order of the rows and columns of the matrices, that of `effects`.
        cosine: cosine between projected sensitivities at their best shapes, signed for single amplitudes, else of the
            smallest principal angle.
        separation: sigmas between two candidates' explanations of this residual: what the one fits and the other
            cannot.
        classes: candidates that this data cannot tell apart, each class with its strongest first.
        projection: what the table was computed from.
    """

    effects: tuple[EffectScore, ...]
    critical_z: float
    significant: tuple[str, ...]
    names: tuple[str, ...]
    cosine: Floats
    separation: Floats
    classes: tuple[tuple[str, ...], ...]
    projection: Projection

    def __getitem__(self, name: str) -> EffectScore:
        return self.effects[self.names.index(name)]

    def block(self, name: str) -> Block:
        """The candidate's projected sensitivity at its best shape."""
        shape = self[name].shape
        return next(block for block in self.projection.blocks if (block.candidate, block.shape) == (name, shape))


def score_effects(
    base_sensitivities: ArrayLike,
    residual: ArrayLike,
    candidates: Mapping[str, Candidate],
    base_names: Sequence[str] | None = None,
    *,
    absorbed_below: float = 0.03,
    familywise_error: float = 0.05,
    draws: int = 10_000,
    seed: int = SEED,
) -> ScoreTable:
    """Score every candidate effect at the calibrated base model.

    The critical value comes from draws of N(0, C), C the correlation of all projected sensitivities, so that what is
    counted is how many truly different tests were made: all shapes of all candidates, each with its own kind of
    p-value.

    Args:
        base_sensitivities: A (n, p), as in `projection.project`.
        residual: r (n,), whitened, with prior rows.
        candidates: sensitivities of the candidate effects by name; at least one.
        base_names: names of the p base parameters.
        absorbed_below: share below which a direction counts as absorbed by the base.
        familywise_error: probability of naming any effect where there is none.
        draws: number of simulated data sets.
        seed: of the draws.

    Returns:
        The table.

    Raises:
        ValueError: as `projection.project`.
    """
    projection = project(base_sensitivities, residual, candidates, base_names, absorbed_below)
    blocks = projection.blocks
    observed = np.array([z_equivalent(block.log_p(projection.scores(block)[None]))[0] for block in blocks])
    largest = _largest_under_null(projection, draws, np.random.default_rng(seed))
    critical = float(np.quantile(largest, 1.0 - familywise_error))

    best = {}
    for index, block in enumerate(blocks):
        if block.candidate not in best or observed[index] > observed[best[block.candidate]]:
            best[block.candidate] = index
    ranked = sorted(best.values(), key=lambda index: -observed[index])
    effects = tuple(_effect_score(projection, blocks[index], float(observed[index])) for index in ranked)
    significant = tuple(effect.name for effect in effects if effect.z_equivalent > critical)
    cosine, separation, alike = _compare(projection, [blocks[index] for index in ranked], observed[ranked], critical)
    names = tuple(effect.name for effect in effects)
    _, label = connected_components(alike, directed=False)
    grouped = [
        tuple(name for name, own in zip(names, label, strict=True) if own == one) for one in dict.fromkeys(label)
    ]
    return ScoreTable(
        effects=effects,
        critical_z=critical,
        significant=significant,
        names=names,
        cosine=cosine,
        separation=separation,
        classes=tuple(group for group in grouped if len(group) > 1),
        projection=projection,
    )


def _largest_under_null(projection: Projection, draws: int, generator: np.random.Generator) -> Floats:
    """The largest z_equivalent of all blocks in each of many data sets without any effect, (draws,)."""
    values, vectors = np.linalg.eigh(projection.gram)
    real = values > 1e-10 * max(1.0, values.max(initial=0.0))
    scores = generator.standard_normal((draws, int(real.sum()))) @ (vectors[:, real] * np.sqrt(values[real])).T
    largest = np.zeros(draws)
    for block in projection.blocks:
        largest = np.maximum(largest, z_equivalent(block.log_p(scores[:, block.columns])))
    return largest


def _effect_score(projection: Projection, block: Block, z_eq: float) -> EffectScore:
    scores = projection.scores(block)
    (drop,), (fitted,) = block.fit(scores[None])
    amplitude, amplitude_sd = block.amplitudes(scores if block.dof == 1 else fitted)
    p = float(2.0 * norm.sf(z_eq))
    # Where nothing can be tested the direction, not the size, says which parameter stands in the effect's place.
    direction = block.in_base @ (amplitude if block.dof else 1.0 / np.where(block.scale > 0.0, block.scale, 1.0))
    moved = np.abs(projection.base.step(direction)) / projection.base.sd()
    return EffectScore(
        name=block.candidate,
        shape=block.shape,
        z=float(np.sign(block.triangle[0, 0]) * scores[0]) if block.dof == 1 else float(np.sqrt(drop)),
        chi2=float(drop),
        dof=block.dof,
        p=p,
        z_equivalent=float(z_eq),
        amplitude=amplitude,
        amplitude_sd=amplitude_sd,
        detectability=block.detectability,
        hidden_by=projection.base.names[int(np.argmax(moved))] if moved.any() else "",
    )


def _compare(
    projection: Projection, blocks: Sequence[Block], z_eq: Floats, critical: float
) -> tuple[Floats, Floats, np.ndarray]:
    """Cosines, separations, and which pairs are alike, for blocks sorted by strength.

    Two candidates are alike where their sensitivities are nearly parallel, or where one is significant, they are
    expected to differ by less than 3 sigma, and the weaker leaves less than 3 sigma of the stronger: a candidate that
    explains nothing is no rival of one that does.
    """
    count = len(blocks)
    cosine, separation, alike = np.eye(count), np.zeros((count, count)), np.zeros((count, count), dtype=bool)
    fits = [block.fit(projection.scores(block)[None]) for block in blocks]
    for i in range(count):
        for j in range(i + 1, count):
            if not (blocks[i].dof and blocks[j].dof):
                continue
            cross = projection.cross(blocks[i], blocks[j])
            if cross.size == 1:
                angle = cross[0, 0] * np.sign(blocks[i].triangle[0, 0] * blocks[j].triangle[0, 0])
            else:
                angle = np.linalg.norm(cross, 2)
            (drop_i,), (fit_i,) = fits[i]
            (drop_j,), (fit_j,) = fits[j]
            apart = min(drop_i - np.sum((cross.T @ fit_i) ** 2), drop_j - np.sum((cross @ fit_j) ** 2))
            cosine[i, j] = cosine[j, i] = angle
            separation[i, j] = separation[j, i] = np.sqrt(max(0.0, apart))
            alike[i, j] = abs(angle) > SAME_COSINE
            if not alike[i, j] and z_eq[i] > critical and separation[i, j] < _SEPARATED_SIGMA:
                left = projection.joint_drop(blocks[i], blocks[j])[0] - drop_j
                alike[i, j] = left < _SEPARATED_SIGMA**2
    return cosine, separation, alike


@dataclass(frozen=True)
class Sight:
    """What this data can say of one effect at the smallest amplitude that matters.

    Attributes:
        name: the effect.
        cell: "present", "negligible" (real, but below the amplitude that matters), "absent" or "blind".
        sigma: delta |P|, how far the smallest amplitude that matters lifts above the noise, at the median shape.
    """

    name: str
    cell: str
    sigma: float


def sight(table: ScoreTable, smallest: Mapping[str, float | ArrayLike]) -> tuple[Sight, ...]:
    """Sort effects into the four cells: present, negligible, absent and blind.

    What the data could not have shown is not absent: where delta |P| < 4, an insignificant effect is "blind".

    Args:
        table: the scores.
        smallest: smallest amplitude that matters of each effect, in its units: a number, or (m,) for several
            amplitudes.

    Returns:
        One entry for each name in `smallest`, in its order.
    """
    result = []
    for name, delta in smallest.items():
        shapes = [block for block in table.projection.blocks if block.candidate == name]
        sigma = float(np.median([block.projected_length(delta) for block in shapes]))
        if name in table.significant:
            matters = np.any(np.abs(table[name].amplitude) >= np.abs(np.asarray(delta, dtype=float)))
            cell = "present" if matters else "negligible"
        else:
            cell = "absent" if sigma >= _VISIBLE_SIGMA else "blind"
        result.append(Sight(name, cell, sigma))
    return tuple(result)
