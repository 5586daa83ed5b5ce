"""Runs of one compiled shape: what many tests of a kind share, so that each kind compiles once a file."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Cutoff, Track, Trajectory, run_track, track

ROWS, STEPS = 128, 640


def padded(model: Model, profile: Profile, rows: int = ROWS, steps: int = STEPS) -> tuple[Track, jax.Array]:
    """Lay a profile out with steps of zero length, and copies of its last row, behind its end."""
    run_steps, missing = track(model, profile, steps), rows - profile.time_s.size
    last_step = jnp.pad(run_steps.last_step, (0, missing), mode="edge")
    time_s = jnp.asarray(np.pad(profile.time_s, (0, missing), mode="edge"))
    return eqx.tree_at(lambda c: c.last_step, run_steps, last_step), time_s


def run(model: Model, profile: Profile, cutoff: Cutoff | None = None) -> Trajectory:
    """Run a model over a profile of at most `ROWS` rows and `STEPS` steps."""
    ran = run_track(model, *padded(model, profile), cutoff)
    return jax.tree.map(lambda x: x[: profile.time_s.size] if x.ndim else x, ran)


def readings(model: Model, profile: Profile) -> dict[str, np.ndarray]:
    return {name: np.asarray(values) for name, values in run(model, profile).readings.items()}


def staircase(seed: int, rows: int, largest: float, *, reversing: bool = True) -> np.ndarray:
    """Levels of a few rows each, some of them zero, of either sign if it is reversing."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(0.1, 1.0, rows) * (rng.uniform(size=rows) < 0.7)
    signs = rng.choice([-1.0, 1.0], rows) if reversing else 1.0
    return np.round(np.repeat(largest * levels * signs, rng.integers(2, 9, rows))[:rows], 3)
