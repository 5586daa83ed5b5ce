"""What a reader of a diagnosis should know beside its verdict: of the fit, and of what it is held against."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from discrepancy.best_model import BestModel
from discrepancy.contract import Predictions
from discrepancy.hypothesis import Hypothesis
from discrepancy.ladder import Rung
from discrepancy.noise import NoiseModel
from discrepancy.session import FAR_FROM_PRIOR, Session
from jaxmodel.cases import Case
from jaxmodel.declaration import describe

# An effect's number is remarked on this share of its usual range beyond an end: the ends are nothing sharp.
OUT_OF_RANGE = 0.25
# Readings that tell less of every unknown than this share of its prior do not answer to any.
NO_ANSWER = 1e-6
# A temperature that begins so many sd of its noise off the ambient one, from which every model starts, is remarked on,
# where that is this share of its course or more.
STARTS_ELSEWHERE = 5.0
SHARE_OF_COURSE = 0.1
SPEED = "speed_rad_s"
# So is a channel whose error on runs held out is so many times that on fit runs and the noise: assumed. Of
# the sealed cases answered rightly one in twenty exceeds 1.07.
FAR_HELD_OUT = 1.25
# So are effects with which a channel's error on runs held out grows by this, beyond its noise.
WORSE_HELD_OUT = 1.1


def remarks(session: Session, hypothesis: Hypothesis) -> tuple[str, ...]:
    """Return what a reader should know of a fit, and of what it is held against."""
    predictions = session.rung("", session.hypothesis()).predictions
    found = [
        *starts_elsewhere(session.case, session.noise, predictions),
        *starts_moving(session.case, session.noise, predictions),
    ]
    if not hypothesis.fitted.converged:
        found.append(
            f"The fit did not reach a minimum (score {hypothesis.fitted.greatest_score:.2g} where 0.1 is the limit): "
            "its numbers are not to be relied on."
        )
    if np.allclose(hypothesis.fitted.information, np.eye(hypothesis.fitted.x.size), rtol=0.0, atol=NO_ANSWER):
        found.append(
            "No unknown moves any reading of the fit runs: at what the case states as known the model stands still, as "
            "a motor does whose friction no torque overcomes, or is out of its range."
        )
    for place, coordinate in enumerate(hypothesis.layout.coordinates[: hypothesis.layout.base]):
        run = hypothesis.layout.runs[place]
        where = f" of {session.case.runs[run].name}" if run >= 0 else ""
        if abs(hypothesis.fitted.x[place]) > FAR_FROM_PRIOR:
            found.append(
                f"{coordinate.name}{where} is {abs(hypothesis.fitted.x[place]):.1f} sd from what the case states: "
                "it may be standing in for something the model lacks."
            )
    for label in hypothesis.labels:
        places = hypothesis.layout.of_effect[label]
        for place, (name, info) in zip(places, describe(session.candidates[label].effect).items(), strict=True):
            low, high = info.typical or (-np.inf, np.inf)
            value = hypothesis.layout.coordinates[place].number(hypothesis.fitted.x[place])
            if not _about(value, low, high):
                found.append(
                    f"{label}.{name} = {value:.3g} is outside its usual range, {low:g} to {high:g}: "
                    "the effect may be standing in for another."
                )
    return tuple(found)


def starts_elsewhere(case: Case, noise: Mapping[str, NoiseModel], predicted: Predictions) -> tuple[str, ...]:
    """Say where a temperature does not begin at the ambient one, as the model does.

    An offset of a thermocouple has no effect of the catalogue: left in, it hides what the temperature does after it.

    Args:
        case: with its measurements.
        noise: of every output.
        predicted: readings of the base model, by run and output.
    """
    told = []
    for name, model in noise.items():
        if not name.endswith("temperature_degC"):
            continue
        runs = [run for run in case.runs if name in run.measured.outputs]
        off = {}
        for run in runs:
            read = run.measured.outputs[name]
            there = np.flatnonzero(np.isfinite(read))
            if not there.size:
                continue
            starts = float(read[there[0]] - predicted[run.name][name][there[0]])
            course = float(np.ptp(read[there]))
            if abs(starts) > max(STARTS_ELSEWHERE * model.sd, SHARE_OF_COURSE * course):
                off[run.name] = starts
        if off:
            worst = max(off, key=lambda run: abs(off[run]))
            others = f", as it does by less in {', '.join(run for run in off if run != worst)}" if len(off) > 1 else ""
            told.append(
                f"{name} in {worst} begins {off[worst]:+.2g} K off ambient_degC, where the model starts{others}: if "
                "all was at rest, give what this sensor read as ambient_degC; no effect stands for an offset."
            )
    return tuple(told)


def starts_moving(case: Case, noise: Mapping[str, NoiseModel], predicted: Predictions) -> tuple[str, ...]:
    """Say where a motor turns at the first row, and the model does not; arguments as `starts_elsewhere`."""
    if SPEED not in noise:
        return ()
    told = []
    for run in case.runs:
        read = run.measured.outputs.get(SPEED)
        if read is None or not np.isfinite(read[0]):
            continue
        if abs(read[0] - predicted[run.name][SPEED][0]) > STARTS_ELSEWHERE * noise[SPEED].sd:
            told.append(f"initial_speed_rad_s = {read[0]:.4g} to {run.name}")
    if not told:
        return ()
    return (
        f"{SPEED} shows a motor that turns at the first row, where the model's stands still: if it did turn, give "
        f"{', '.join(told)}.",
    )


def _about(value: float, low: float, high: float) -> bool:
    """Return True within a usual range and a little beyond: of its ratio where it has one sign, else of its length."""
    if low > 0.0:
        room = (high / low) ** OUT_OF_RANGE
        return bool(low / room <= value <= high * room)
    room = OUT_OF_RANGE * (high - low)
    return bool(low - room <= value <= high + room)


def far_on_check_runs(rung: Rung, noise: Mapping[str, NoiseModel]) -> tuple[str, ...]:
    """Say which channels a calibrated model leaves far above the noise in runs held out, and not in those fitted.

    What acts in all runs a parameter of the model may have taken up in the others.

    Args:
        rung: the model.
        noise: of every output.
    """
    told = []
    for name, model in noise.items():
        error = rung.errors[name]
        if error.check > FAR_HELD_OUT * max(error.fit, model.sd):
            told.append(
                f"On check runs the error of {name} is {error.check / max(error.fit, model.sd):.1f} times that on fit "
                "runs: something acts there that the fit runs do not show; make one of those runs a fit run."
            )
    return tuple(told)


def worse_held_out(ladder: Sequence[Rung], noise: Mapping[str, NoiseModel]) -> tuple[str, ...]:
    """Say which effects fit the fit runs and make runs held out worse.

    Args:
        ladder: calibrated models, each with one effect more than the one before.
        noise: of every output.
    """
    told = []
    for before, after in itertools.pairwise(ladder):
        added = " and ".join(label for label in after.added if label not in before.added)
        for name, model in noise.items():
            now = after.errors[name].check
            if now > WORSE_HELD_OUT * max(before.errors[name].check, model.sd):
                growth = now / before.errors[name].check - 1.0
                told.append(
                    f"With {added} the error of {name} on check runs grows by {growth:.0%}: "
                    "it may stand in for something else, and is not to be relied on beyond the runs fitted."
                )
    return tuple(told)


def what_is_explained(found: BestModel) -> tuple[str, ...]:
    """Say what the effects named are worth where no model comes near the noise."""
    if not found.far:
        return ()
    told = (
        f"No model of few effects comes near the noise of {' and '.join(found.far)}: channels are weighed by what the "
        "best single effect leaves in them, and evidence by the time that readings span."
    )
    base, best = found.session.hypothesis(), found.best
    if not best.labels:
        return (told,)
    verb = "explains" if len(best.labels) == 1 else "explain"
    share = 100.0 * (1.0 - best.fitted.chi2 / base.fitted.chi2)
    return (
        told,
        f"{' and '.join(best.labels)} {verb} {share:.3g} % of the mean square that the base model leaves.",
    )
