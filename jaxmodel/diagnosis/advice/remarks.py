"""What a reader of a diagnosis should know beside its verdict: of the fit, and of what it is held against."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath

import numpy as np

from jaxmodel.base.remark import Remark
from jaxmodel.base.units import split_unit
from jaxmodel.case.records import Case, Run
from jaxmodel.diagnosis.result import Extrapolated, Rung
from jaxmodel.diagnosis.usual import in_usual_range
from jaxmodel.diagnosis.wording import amount, join
from jaxmodel.fit.candidates import Candidate, specimen_ranges
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.noise.instrument import NoiseModel
from jaxmodel.fit.settings import SETTINGS
from jaxmodel.fit.space import ModelSpace
from jaxmodel.model.declaration import describe
from jaxmodel.model.parameters import info

# Readings that tell less of every unknown than this share of its prior do not answer to any.
NO_ANSWER = 1e-6
# A speed that begins so many sd of its noise off the model's is remarked on.
STARTS_ELSEWHERE = 5.0
SPEED, START_SPEED = "speed_rad_s", "initial_speed_rad_s"
# What starts a run; of these a cell's hysteresis and the rise of its temperature no case states.
STARTS = ("initial_soc", "initial_temperature_rise_K", "initial_hysteresis", "initial_speed_rad_s")
# A check run lies outside the conditions fitted by more than this: K of a temperature, of the state of charge, and of
# all else, and of wide spans of temperature, this share of what was fitted. Assumed.
BEYOND_K, BEYOND_SOC, BEYOND_SHARE = 5.0, 0.1, 0.2
# A held-out error that is larger or smaller by this share is so for a user too. Assumed.
DIFFERS = 0.1
# Share of a sensor's readings at either end that tell no range: its noise.
NOISY_ENDS = 0.005
# Columns whose size counts, whatever their sign.
_SIZES = ("current_A", "pack_current_A", "motor_current_A", "load_torque_Nm", "incline_deg", SPEED, "duty", "V_set")
_SIZES += ("flipper_torque_Nm", "arm_torque_Nm")
# Exact numbers of a specimen in which runs may differ.
_AGES = ("cycles", "storage_months")


@dataclasses.dataclass(frozen=True)
class Strained:
    """A number that was fitted far from what the case states of it.

    Attributes:
        name: of the number.
        value: where it was fitted.
        pull: sd from what is stated, signed.
        stated: what the case states.
        sd: of that.
        run: to which it belongs; "" where it is of all.
    """

    name: str
    value: float
    pull: float
    stated: float
    sd: float
    run: str = ""

    def remark(self) -> Remark:
        """Say how far it is, and what that may mean."""
        side = "above" if self.pull > 0.0 else "below"
        off = f"{self.name} = {self.value:.4g} is {abs(self.pull):.1f} sd {side}"
        known = f"({self.stated:.4g} ± {self.sd:.2g})"
        subject = f"{self.name}@{self.run}" if self.run else self.name
        numbers = {"value": self.value, "stated": self.stated, "stated_sd": self.sd, "off_sd": self.pull}
        if self.run and self.name in STARTS:
            moved = f"The start of {self.run} was moved to compensate for an error: {off} its stated value {known}."
            return Remark(moved, "start_moved", subject, **numbers)
        where = f" of {self.run}" if self.run else ""
        lacks = f"something that the model lacks{' in that run' if self.run else ''}"
        far = f"{off} what the case states{where} {known}: correct it, or it stands in for {lacks}."
        return Remark(far, "far_from_stated", subject, **numbers)


def strained(numbers: Sequence[Strained], least: float = SETTINGS.strained) -> tuple[Remark, ...]:
    """Say which parameters were fitted more than so many sd from their stated value, the furthest first."""
    far = [one for one in numbers if abs(one.pull) > least]
    return tuple(one.remark() for one in sorted(far, key=lambda one: -abs(one.pull)))


def noise_remarks(noise: Mapping[str, NoiseModel]) -> tuple[Remark, ...]:
    """Say of which channels the stated noise is contradicted by the readings, and of which none is stated."""
    remarks = []
    for name, model in noise.items():
        if model.stated is None:
            remarks.append(
                Remark(
                    f"The noise of {name} is not stated; taken as {model.sd:.3g} ({model.source}). State it under "
                    "[sensors]: all that is called significant is held against it.",
                    "noise_not_stated",
                    name,
                    sd=model.sd,
                )
            )
        elif model.contradicts:
            ratio = model.sd / model.stated
            off = f"{ratio:.2g} times" if ratio > 1.0 else f"1/{1.0 / ratio:.2g} of"
            remarks.append(
                Remark(
                    f"The readings of {name} scatter by {model.sd:.3g}, {off} the stated sd of {model.stated:.3g}: "
                    "what they show was used; correct the stated one.",
                    "noise_contradicted",
                    name,
                    sd=model.sd,
                    stated_sd=model.stated,
                )
            )
        elif model.is_filtered:
            remarks.append(
                Remark(
                    f"The readings of {name} scatter far less than the stated sd of {model.stated:.3g}: their log was "
                    "filtered or interpolated. The stated sd was used; give the readings as they were taken.",
                    "readings_filtered",
                    name,
                    stated_sd=model.stated,
                )
            )
    return tuple(remarks)


def not_converged(fitted: Fit) -> tuple[Remark, ...]:
    """Say where a calibration did not come to its end."""
    if fitted.converged:
        return ()
    return (
        Remark(
            f"The fit did not reach a minimum (another step promises {fitted.promise:.2g} of {fitted.objective:.3g}): "
            "its numbers are not to be relied on.",
            "no_minimum",
            promise=fitted.promise,
            objective=fitted.objective,
        ),
    )


def nothing_moves(fitted: Fit) -> tuple[Remark, ...]:
    """Say where no unknown moves any reading."""
    scale = fitted.spec.precision**-0.5
    if np.max(np.abs(scale[:, None] * fitted.gram.square * scale), initial=0.0) > NO_ANSWER:
        return ()
    return (
        Remark(
            "No unknown moves any reading of the fit runs: at what the case states as known the model stands still, as "
            "a motor does whose friction no torque overcomes, or is out of its range.",
            "nothing_moves",
        ),
    )


def out_of_range(space: ModelSpace, fit: Fit) -> tuple[Remark, ...]:
    """Say which numbers of a model's effects are outside their usual range, that of the specimen where it has one."""
    remarks: list[Remark] = []
    for label in fit.added:
        candidate = space.candidates[label]
        if candidate.is_switched:
            places = list(space.layout.of[label])
            values = [c.number(x) for c, x in zip(candidate.coordinates, fit.x[places], strict=True)]
            remarks.extend(unusual(candidate, values, specimen_ranges(space.case, type(candidate.effect))))
    return tuple(remarks)


def unusual(
    candidate: Candidate, values: Sequence[float], usual: Mapping[str, tuple[float, float]] | None = None
) -> tuple[Remark, ...]:
    """Say which numbers of one effect are outside their usual range.

    Args:
        candidate: the effect.
        values: its numbers, in the order of its table.
        usual: ranges in place of the table's.
    """
    remarks = []
    for value, (name, about) in zip(values, describe(candidate.effect).items(), strict=True):
        low, high = (usual or {}).get(name) or about.typical or (-np.inf, np.inf)
        if not in_usual_range(value, low, high):
            remarks.append(
                Remark(
                    f"{candidate.label}.{name} = {value:.3g} is outside its usual range, {low:.3g} to {high:.3g}: the "
                    "effect may be standing in for another.",
                    "outside_usual_range",
                    f"{candidate.label}.{name}",
                    value=value,
                    low=low,
                    high=high,
                )
            )
    return tuple(remarks)


def starts_moving(
    case: Case, noise: Mapping[str, NoiseModel], predicted: Mapping[str, Mapping[str, np.ndarray]]
) -> tuple[Remark, ...]:
    """Say where a motor turns at the first row, and the model does not, or at another speed that the case states.

    Args:
        case: with its measurements.
        noise: of every output.
        predicted: readings of the base model, by run and output.
    """
    if SPEED not in noise:
        return ()
    starts: dict[str, float] = {}
    elsewhere: list[Remark] = []
    for run in case.runs:
        read = run.measured.outputs.get(SPEED)
        if read is None or not np.isfinite(read[0]):
            continue
        far, model = STARTS_ELSEWHERE * noise[SPEED].sd, predicted[run.name][SPEED][0]
        if abs(read[0] - model) <= far:
            continue
        stated = run.overrides.get(START_SPEED, case.parameters.get(START_SPEED))
        if stated is not None:
            elsewhere.append(
                Remark(
                    f"{SPEED} of {run.name} is {read[0]:.4g} at the first row, and {START_SPEED} is stated as "
                    f"{stated.value:.4g}: correct one of them, or give it an sd.",
                    "start_speed_contradicted",
                    f"{SPEED}@{run.name}",
                    value=read[0],
                    stated=stated.value,
                )
            )
        else:
            starts[run.name] = read[0]
    if not starts:
        return tuple(elsewhere)
    give = ", ".join(f"{START_SPEED} = {speed:.4g} to {name}" for name, speed in starts.items())
    return (
        *elsewhere,
        Remark(
            f"{SPEED} shows a motor that turns at the first row, where the model's stands still: if it did turn, give "
            f"{give}.",
            "start_speed_missing",
            SPEED,
            **starts,
        ),
    )


def formulas_of_the_paper(case: Case) -> tuple[Remark, ...]:
    """Return a remark if a cell other than the paper's uses curves of the paper's cell."""
    if not case.formulas:
        return ()
    names = ", ".join(case.formulas)
    return (
        Remark(
            f"{names} are the formulas of the paper's 5.2 A h cell, because the case states no tables; state tables or "
            "a preset of your cell.",
            "paper_formulas",
            names,
        ),
    )


def nothing_held_out(case: Case) -> tuple[Remark, ...]:
    """Say where no run is left to check the model on."""
    if any(run.split == "check" for run in case.runs):
        return ()
    how = (
        'set split = "check" for one of them'
        if len(case.runs) > 1
        else 'record another run and list it with split = "check"'
    )
    return (
        Remark(
            "No run is held out: the errors are those of runs that the model was fitted to, and how well it predicts "
            f"others cannot be judged; {how}.",
            "nothing_held_out",
        ),
    )


def better_as_stated(stated: Rung, final: Rung) -> tuple[Remark, ...]:
    """Say where the held-out runs are predicted worse by the final model than by what the case states.

    Args:
        stated: the base model before any calibration.
        final: the model that the diagnosis ends with.
    """
    pairs = {name: (one.check, final.errors[name].check) for name, one in stated.errors.items()}
    worse = {name: pair for name, pair in pairs.items() if pair[1] > (1.0 + DIFFERS) * pair[0]}
    if not worse or any(after < (1.0 - DIFFERS) * before for before, after in pairs.values()):
        return ()
    changes = []
    for name, pair in worse.items():
        (before, after), unit = amount(name, pair)
        changes.append(f"{split_unit(name)[0]} is {after} {unit} off, and {before} {unit} as stated")
    return (
        Remark(
            f"On the check runs the final model is no better than the base model as stated: {join(changes)}. Keep the "
            "stated values, or give them a smaller sd.",
            "better_as_stated",
            ", ".join(worse),
            **{name: after for name, (_, after) in worse.items()},
            **{f"{name}_stated": before for name, (before, _) in worse.items()},
        ),
    )


def stated_model_stays(tried: Sequence[str]) -> Remark:
    """Say that the case stays as it is stated, and what was tried."""
    with_them = f" and {join([label.replace(':', ' of ') for label in tried])}" if tried else ""
    return Remark(
        f"Calibration{with_them} fits the fit runs better and predicts the check runs worse than the case as stated: "
        "the model stays as it was. The fit runs lack what the check runs need: fit a run of their kind.",
        "stated_model_stays",
        ", ".join(tried),
    )


def badly_started(pulls: Mapping[str, float], reach: float = SETTINGS.start_reach) -> tuple[Remark, ...]:
    """Say which check runs begin elsewhere than is stated of their start.

    Args:
        pulls: by run, the sd by which its first readings ask a number of its start to leave what is stated.
        reach: the sd within which it may.
    """
    return tuple(
        Remark(
            f"The start of {run} is wrong: its first readings require a start {abs(pull):.1f} sd from the stated one, "
            f"but it was limited to {reach:g} sd; part of its error comes from the start. Correct what the case states "
            "of this start, or increase its sd.",
            "start_wrong",
            run,
            off_sd=pull,
            limit_sd=reach,
        )
        for run, pull in pulls.items()
        if abs(pull) > reach
    )


def extrapolated(case: Case) -> tuple[Extrapolated, ...]:
    """Return which conditions of held-out runs lie outside those of the fitted ones, the runs in order."""
    fitted: dict[str, tuple[float, float]] = {}
    for run in case.runs:
        if run.split == "fit":
            for name, (low, high) in _conditions(case, run):
                before = fitted.get(name, (low, high))
                fitted[name] = (min(low, before[0]), max(high, before[1]))
    return tuple(
        Extrapolated(run.file, name, fitted[name], span)
        for run in case.runs
        if run.split == "check"
        for name, span in _conditions(case, run)
        if name in fitted and _outside(name, fitted[name], span)
    )


def outside_fitted(one: Extrapolated) -> Remark:
    """Say where a held-out run lies outside the conditions that were fitted."""
    (low, high), (from_, to) = one.span_fitted, one.span
    fitted = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    own = f"is {to:.3g}" if from_ == to else f"is {from_:.3g} to {to:.3g}"
    return Remark(
        f"{one.file} is outside the fit runs: {one.condition} {own}; the fit runs cover {fitted}.",
        "run_outside_fitted",
        f"{one.condition}@{PurePath(one.file).stem}",
        low=from_,
        high=to,
        low_fit=low,
        high_fit=high,
    )


def _outside(name: str, fitted: tuple[float, float], span: tuple[float, float]) -> bool:
    if name.endswith("degC"):
        room = max(BEYOND_K, BEYOND_SHARE * (fitted[1] - fitted[0]))
    elif name == "soc":
        room = BEYOND_SOC
    else:
        room = BEYOND_SHARE * max(abs(fitted[0]), abs(fitted[1]))
    room += 1e-9
    below = span[0] < fitted[0] - room and not name.startswith("|")
    return below or span[1] > fitted[1] + room


def _conditions(case: Case, run: Run) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield the conditions of a run, each with its lowest and highest value."""
    measured = run.measured
    for name, values in (measured.outputs | measured.inputs).items():
        read = values[np.isfinite(values)]
        if not read.size:
            continue
        if name in measured.outputs:
            read = np.quantile(read, [NOISY_ENDS, 1.0 - NOISY_ENDS])
        if name in _SIZES:
            yield f"|{name}|", (float(np.min(np.abs(read))), float(np.max(np.abs(read))))
        elif name.endswith("degC") or (name == "soc" and "current_A" not in measured.inputs):
            yield name, (float(np.min(read)), float(np.max(read)))
    if case.kind == "cell" and "current_A" in measured.inputs:
        capacity_C = 3600.0 * _number(case, run, "capacity_Ah")
        steps = np.diff(measured.time_s, prepend=measured.time_s[0])
        soc = run.initial_soc.value - np.cumsum(measured.inputs["current_A"] * steps) / capacity_C
        yield "soc", (float(np.min(soc)), float(np.max(soc)))
    for name in _AGES:
        if name in run.overrides or name in case.parameters:
            value = _number(case, run, name)
            yield name, (value, value)


def _number(case: Case, run: Run, name: str) -> float:
    """Return a number of a run: its own, the case's, or that of the paper."""
    known = run.overrides.get(name, case.parameters.get(name))
    return info(name).default if known is None else known.value
