"""What is left of each candidate's sensitivity once the base parameters have taken all that they can imitate.

Everything is in whitened units, prior rows appended: A (n, p) base sensitivities, S (n, m) one candidate's
sensitivities at its null, r (n,) residual. With A = QR, a candidate's projected sensitivity is P = (I - QQ')S, and only
P can tell it from a recalibration. Only inner products of columns enter, so the rows may be replaced by the R factor of
[A | S ... | r], run by run.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import qr, solve_triangular
from scipy.special import gammaincc, gammaln, log_ndtr, logsumexp, ndtri_exp

from discrepancy.whitening import Floats, Integers

_RANK_TOLERANCE = 1e-9
_CONE_DRAWS = 20_000


@dataclass(frozen=True)
class Candidate:
    """The whitened sensitivities of one candidate effect at its null, prior rows zero.

    Attributes:
        shapes: one (n,) or (n, m) array for each value tried of a shape parameter that is undefined at the null (a
            Stribeck speed, a time constant); a single one where there is no such parameter. Columns are the effect's
            amplitudes.
        signs: +1 or -1 where physics allows an amplitude only on that side of its null, 0 where it is free; one number
            for all columns, or one per column (the work doubles with each constrained column: keep to a few).
    """

    shapes: Sequence[Floats]
    signs: int | Sequence[int] = 0


@dataclass(frozen=True)
class Base:
    """QR factors of the base sensitivities, columns scaled to unit length and those without own information dropped.

    Attributes:
        names: the p parameters' names.
        q: (n, k) orthonormal basis of the base sensitivities.
        triangle: (k, k) upper triangular factor of the kept, scaled columns.
        kept: indices of the k kept parameters, in the triangle's order.
        scale: (p,) column lengths.
    """

    names: tuple[str, ...]
    q: Floats
    triangle: Floats
    kept: tuple[int, ...]
    scale: Floats

    @property
    def dropped(self) -> tuple[str, ...]:
        """Parameters of which this data and its priors say nothing of their own."""
        return tuple(name for index, name in enumerate(self.names) if index not in self.kept)

    def step(self, coordinates: Floats) -> Floats:
        """Parameter change (p,) whose effect on the outputs has these coordinates (k,) in the basis."""
        change = np.zeros(len(self.names))
        kept = list(self.kept)
        change[kept] = solve_triangular(self.triangle, coordinates) / self.scale[kept]
        return change

    def sd(self) -> Floats:
        """Standard errors (p,) of the base parameters, infinite for the dropped ones."""
        result = np.full(len(self.names), np.inf)
        kept = list(self.kept)
        inverse = solve_triangular(self.triangle, np.eye(len(kept)))
        result[kept] = np.linalg.norm(inverse, axis=1) / self.scale[kept]
        return result


@dataclass(frozen=True)
class Block:
    """One candidate at one shape, projected off the base: P = U T for the directions that are not absorbed.

    Attributes:
        candidate: its name.
        shape: index of the shape.
        u: (n, k) orthonormal basis of the projected sensitivity; k = 0 where the base absorbs the candidate.
        triangle: (k, k) upper triangular T of the kept columns, scaled by `scale`.
        kept: indices of the k kept columns.
        scale: (m,) lengths of the unprojected columns.
        detectability: |P| / |S|, of the best column: the share of the effect that no recalibration can imitate.
        in_base: (rank of base, m) coordinates Q'S of the part that the base can imitate.
        signs: sign constraint of each kept column.
        cone_weights: chi-bar-square weights of 0..k amplitudes off their bound; empty where no sign is constrained.
        first_column: place of its first column of U among those of all blocks side by side.
    """

    candidate: str
    shape: int
    u: Floats
    triangle: Floats
    kept: tuple[int, ...]
    scale: Floats
    detectability: float
    in_base: Floats
    signs: tuple[int, ...]
    cone_weights: Floats = field(default_factory=lambda: np.zeros(0))
    first_column: int = 0

    @property
    def dof(self) -> int:
        """Number of amplitudes that can be tested."""
        return len(self.kept)

    @property
    def columns(self) -> slice:
        """Place of its columns of U among those of all blocks side by side."""
        return slice(self.first_column, self.first_column + self.dof)

    def projected_length(self, amplitude: float | ArrayLike) -> float:
        """|P delta|: how many sigma an effect of this amplitude, in its own units, lifts above the noise."""
        delta = np.broadcast_to(np.asarray(amplitude, dtype=float), self.scale.shape) * self.scale
        return float(np.linalg.norm(self.triangle @ delta[list(self.kept)]))

    def amplitudes(self, coordinates: Floats) -> tuple[Floats, Floats]:
        """Amplitudes (m,) of these coordinates (k,) in U, and their standard errors; 0 and inf where absorbed."""
        value, error = np.zeros(len(self.scale)), np.full(len(self.scale), np.inf)
        kept = list(self.kept)
        inverse = solve_triangular(self.triangle, np.eye(self.dof)) if kept else np.zeros((0, 0))
        value[kept] = inverse @ coordinates / self.scale[kept]
        error[kept] = np.linalg.norm(inverse, axis=1) / self.scale[kept]
        return value, error

    def allows(self, coordinates: Floats) -> bool:
        """Whether the amplitudes with these coordinates in U are all on their allowed side."""
        return bool(np.all(np.asarray(self.signs) * self.amplitudes(coordinates)[0][list(self.kept)] >= 0.0))

    def fit(self, scores: Floats) -> tuple[Floats, Floats]:
        """Constrained least squares for draws (d, k) of U'r: drop in chi-square (d,), fitted coordinates (d, k)."""
        best = np.zeros(len(scores))
        fitted = np.zeros_like(scores)
        bound = [column for column in range(self.dof) if self.signs[column]]
        # On the cone the optimum is the unconstrained one on some face; with few amplitudes all faces are tried.
        for at_bound in itertools.chain.from_iterable(itertools.combinations(bound, k) for k in range(len(bound) + 1)):
            free = [column for column in range(self.dof) if column not in at_bound]
            if not free:
                continue
            basis, triangle = np.linalg.qr(self.triangle[:, free])
            inside = scores @ basis
            drop = np.sum(inside**2, axis=1)
            if bound:
                amplitude = np.linalg.solve(triangle, inside.T).T
                feasible = np.all(amplitude * np.asarray(self.signs)[free] >= 0.0, axis=1)
                drop = np.where(feasible, drop, 0.0)
            better = drop > best
            best = np.where(better, drop, best)
            fitted[better] = (inside @ basis.T)[better]
        return best, fitted

    def log_p(self, scores: Floats) -> Floats:
        """Log p-values (d,) of draws (d, k) of U'r: two-sided, one-sided or chi-bar-square as the signs ask for."""
        if self.dof == 0:
            return np.zeros(len(scores))
        if self.dof == 1 and self.signs[0]:
            return log_ndtr(-self.signs[0] * np.sign(self.triangle[0, 0]) * scores[:, 0])
        drop = self.fit(scores)[0]
        if not any(self.signs):
            return _log_sf_chi2(drop, self.dof)
        terms = np.array([_log_sf_chi2(drop, k) for k in range(self.dof + 1)])
        return np.where(drop > 0.0, logsumexp(terms, axis=0, b=self.cone_weights[:, None]), 0.0)


@dataclass(frozen=True)
class Projection:
    """All candidates projected off one base, and the residual's scores on them.

    Attributes:
        base: the base sensitivities' factors.
        blocks: every candidate at every shape, in the candidates' order.
        residual: (n,) residual with the base's part taken out, Mr.
        all_scores: (K,) U'r of all blocks side by side.
        gram: (K, K) U'U of all blocks side by side: their correlations in the absence of any effect.
        base_z: (p,) score of each base parameter, A_k'r / |A_k|; the test assumes a converged fit, |base_z| < 0.1.
    """

    base: Base
    blocks: tuple[Block, ...]
    residual: Floats
    all_scores: Floats
    gram: Floats
    base_z: Floats

    def scores(self, block: Block) -> Floats:
        """U'r of a block, (k,)."""
        return self.all_scores[block.columns]

    def cross(self, first: Block, second: Block) -> Floats:
        """U'U of two blocks, (k of the first, k of the second)."""
        return self.gram[first.columns, second.columns]

    def joint_drop(self, first: Block, second: Block) -> tuple[float, Floats, Floats]:
        """Drop in chi-square with two blocks together, signs not enforced, and the coordinates of each one's part."""
        cross = self.cross(first, second)
        gram = np.block([[np.eye(first.dof), cross], [cross.T, np.eye(second.dof)]])
        scores = np.concatenate([self.scores(first), self.scores(second)])
        fitted = np.linalg.lstsq(gram, scores, rcond=1e-9)[0]
        return float(scores @ fitted), fitted[: first.dof], fitted[first.dof :]


def project(
    base_sensitivities: ArrayLike,
    residual: ArrayLike,
    candidates: Mapping[str, Candidate],
    base_names: Sequence[str] | None = None,
    absorbed_below: float = 0.03,
) -> Projection:
    """Project every candidate's sensitivities off those of the base parameters.

    Args:
        base_sensitivities: A (n, p), whitened d output / d theta with the prior rows appended.
        residual: r (n,), whitened measured - modelled, prior rows (prior - theta) / sd.
        candidates: sensitivities d output / d eta by name, (n, m) each, prior rows zero.
        base_names: names of the p parameters; their numbers when not given.
        absorbed_below: a direction of which a smaller share than this survives counts as absorbed by the base, for
            there the curvature of the base decides more than the data.

    Returns:
        The projection.

    Raises:
        ValueError: a sensitivity or the residual is not finite, or lengths differ.
    """
    a, r = np.asarray(base_sensitivities, dtype=float), np.asarray(residual, dtype=float)
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(r))):
        raise ValueError("The base sensitivities and the residual must be finite; missing rows are 0 after whitening.")
    names = tuple(str(index) for index in range(a.shape[1])) if base_names is None else tuple(base_names)
    scale = np.linalg.norm(a, axis=0)
    q, triangle, order = _pivoted_qr(a / np.where(scale > 0.0, scale, 1.0))
    rank = int(np.sum(np.abs(np.diag(triangle)) > _RANK_TOLERANCE))
    q, triangle = q[:, :rank], triangle[:rank, :rank]
    base = Base(names, q, triangle, tuple(int(index) for index in order[:rank]), scale)
    blocks = []
    for name, candidate in candidates.items():
        for shape, sensitivity in enumerate(candidate.shapes):
            s = np.asarray(sensitivity, dtype=float).reshape(len(sensitivity), -1)
            if s.shape[0] != len(r) or not np.all(np.isfinite(s)):
                raise ValueError(f"The sensitivities of {name} must be finite and have {len(r)} rows.")
            signs = tuple(np.broadcast_to(candidate.signs, s.shape[1]).tolist())
            block = _block(name, shape, s, signs, q, absorbed_below)
            blocks.append(replace(block, first_column=sum(before.dof for before in blocks)))
    beside = np.concatenate([np.zeros((len(r), 0)), *(block.u for block in blocks)], axis=1)
    left = r - q @ (q.T @ r)
    base_z = a.T @ r / np.where(scale > 0.0, scale, 1.0)
    return Projection(base, tuple(blocks), left, beside.T @ left, beside.T @ beside, base_z)


def _pivoted_qr(columns: Floats) -> tuple[Floats, Floats, Integers]:
    if not columns.shape[1]:  # LAPACK does not take a matrix without columns
        return columns, np.zeros((0, 0)), np.zeros(0, dtype=int)
    q, triangle, order = (np.asarray(factor) for factor in qr(columns, mode="economic", pivoting=True))
    return q.astype(float), triangle.astype(float), order


def _block(name: str, shape: int, s: Floats, signs: tuple[int, ...], q: Floats, absorbed_below: float) -> Block:
    scale = np.linalg.norm(s, axis=0)
    unit = s / np.where(scale > 0.0, scale, 1.0)
    in_base = q.T @ unit
    projected = unit - q @ in_base
    projected -= q @ (q.T @ projected)  # once more: what is nearly absorbed is a small difference of large numbers
    u, triangle, order = _pivoted_qr(projected)
    survives = np.abs(np.diag(triangle))
    dof = int(np.sum(survives >= absorbed_below))
    kept = tuple(int(index) for index in order[:dof])
    block = Block(
        name, shape, u[:, :dof], triangle[:dof, :dof], kept, scale, float(survives[0]), in_base * scale,
        tuple(signs[index] for index in kept),
    )  # fmt: skip
    if dof < 2 or not any(block.signs):
        return block
    # The weights depend on the angles between the columns; beyond two columns there is no closed form.
    _, fitted = block.fit(np.random.default_rng(0).standard_normal((_CONE_DRAWS, dof)))
    amplitudes = solve_triangular(block.triangle, fitted.T)
    off_bound = np.sum(np.abs(amplitudes) > 1e-9, axis=0)
    weights = np.bincount(off_bound, minlength=dof + 1) / _CONE_DRAWS
    return replace(block, cone_weights=weights)


def z_equivalent(log_p: Floats) -> Floats:
    """The |z| of a two-sided normal test with this log p-value: one scale for tests of every kind."""
    return -ndtri_exp(np.minimum(log_p, 0.0) - np.log(2.0))


def _log_sf_chi2(x: Floats, dof: int) -> Floats:
    """Log of the upper tail of chi-square, also where the tail underflows."""
    if dof == 0:
        return np.where(x > 0.0, -np.inf, 0.0)
    if dof == 1:
        return np.log(2.0) + log_ndtr(-np.sqrt(x))
    half, shape = 0.5 * x, 0.5 * dof
    tail = gammaincc(shape, half)
    with np.errstate(divide="ignore"):
        beyond = np.maximum(half, 300.0)  # x^(a-1) e^-x / Gamma(a), with the first term of its asymptotic series
        asymptotic = (shape - 1.0) * np.log(beyond) - beyond - gammaln(shape) + np.log1p((shape - 1.0) / beyond)
        return np.where(tail > 1e-250, np.log(tail), asymptotic)
