"""From `[profile]` to inputs over time: constants, pulse trains, drive cycles and missions of segments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import SweepError, instead
from jaxmodel.base.units import LARGEST
from jaxmodel.case.measurements import KINDS, file_label, read_measurements
from jaxmodel.case.plausible.ranges import mend_into
from jaxmodel.case.run_csv import read_header
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import MOST_ROWS, Profile, constant
from jaxmodel.model.robot import load_torque
from jaxmodel.sweeps.profile_form import ProfileForm, PulsesForm

Columns = dict[str, np.ndarray]
# Outside these an input is in the wrong unit, or wrong.
_INPUT_BOUNDS = {
    **dict.fromkeys(("duty", "flipper_duty", "arm_duty"), (-1.0, 1.0)),
    "V_set": (0.0, 5.0),
    "ambient_degC": (-90.0, 200.0),
    "incline_deg": (-90.0, 90.0),
}


def input_names(kind: str) -> tuple[str, ...]:
    """Return the inputs that a kind of model may have."""
    vocabulary = KINDS[kind]
    return (*vocabulary.required_inputs, *sum(vocabulary.alternatives, ()), *vocabulary.optional_inputs)


def check_input(name: str, kind: str, values: Sequence[float] | np.ndarray, where: str) -> None:
    """Raise SweepError for an input that the kind does not have, or a value that it cannot have."""
    if name not in input_names(kind):
        raise SweepError(f"{where}: a {kind} has no input '{name}'.{instead(name, input_names(kind))}")
    lower, upper = _INPUT_BOUNDS.get(name, (-LARGEST, LARGEST))
    for value in values:
        if not lower <= value <= upper:
            mend = mend_into(name, float(value), lower, upper)
            todo = "correct the value or its unit" if mend is None else mend.sentence()
            raise SweepError(f"{where}: {value:g} is outside {lower:g} to {upper:g}; {todo}.")


def build_profile(form: ProfileForm, folder: Path, model: Model, varied: dict[str, float]) -> Profile:
    """Return the inputs over time that a profile describes.

    Args:
        form: the profile; its constants replace columns of its CSV, and inputs of its segments.
        folder: where relative paths start.
        model: for the duty that holds a speed.
        varied: inputs in which lanes differ, each with one of its values; they replace what the profile says.

    Raises:
        SweepError, MeasurementError: an input is missing, unknown or out of its bounds.
    """
    kind, vocabulary = model.kind, KINDS[model.kind]
    for name, value in form.inputs.items():
        check_input(name, kind, [value], f"profile.{name}")
    if form.csv is not None:
        time_s, columns = _cycle(form, folder, kind, (form.inputs | varied).get("ambient_degC"))
    elif form.mission:
        time_s, columns = _mission(form, model, form.inputs | varied)
    else:
        assert form.duration_s is not None  # the form has one of the three
        time_s = constant(form.duration_s, form.step_s).time_s
        columns = {name: _train(pulses, time_s, form.step_s) for name, pulses in form.pulses.items()}
        for name, values in columns.items():
            check_input(name, kind, values, f"profile.pulses.{name}")
            if name in form.inputs:
                raise SweepError(f"profile: '{name}' is a constant and has pulses; remove one of the two.")
    for layer in (form.inputs, varied):
        others = {other for group in vocabulary.alternatives if set(group) & set(layer) for other in group}
        columns = {name: values for name, values in columns.items() if name not in others} | dict(layer)
    for name in vocabulary.required_inputs:
        if name not in columns:
            raise SweepError(f"profile: a {kind} needs the input '{name}'; add it under [profile] or [axes].")
    for group in vocabulary.alternatives:
        if (count := len(set(group) & set(columns))) != 1:
            need = "needs one of the inputs" if count == 0 else "takes one, not both, of the inputs"
            raise SweepError(f"profile: a {kind} {need} {' and '.join(group)}; change [profile] or [axes].")
    for name, other in vocabulary.only_with.items():
        if name in columns and other not in columns:
            raise SweepError(f"profile: '{name}' is used only together with '{other}'; add that or remove this.")
    return Profile(time_s, {name: np.broadcast_to(values, time_s.shape) for name, values in columns.items()})


def _train(pulses: PulsesForm, time_s: np.ndarray, step_s: float) -> np.ndarray:
    """Return a train of pulses at the rows; each holds since the row before, and row 0 is as row 1."""
    since = time_s - 0.5 * step_s - pulses.start_s
    on = (since >= 0.0) & (np.mod(since, pulses.period_s) < pulses.on_s)
    return _first_as_second(np.where(on, pulses.high, pulses.low))


def _first_as_second(values: np.ndarray) -> np.ndarray:
    values[0] = values[1]
    return values


def _cycle(form: ProfileForm, folder: Path, kind: str, ambient_degC: float | None) -> tuple[np.ndarray, Columns]:
    """Return the inputs of a CSV, scaled, one cycle after the other: the row that ends one begins the next.

    Raises:
        SweepError, MeasurementError: the CSV cannot be used, or its repetitions have too many rows.
    """
    assert form.csv is not None
    path = folder / form.csv
    has_ambient = "ambient_degC" in read_header(path, file_label(path)).names
    measured = read_measurements(path, kind, None if has_ambient else ambient_degC)
    columns = dict(measured.inputs)
    for name, factor in form.scale.items():
        if name not in columns:
            raise SweepError(f"profile.scale: the CSV has no input '{name}'.{instead(name, columns)}")
        columns[name] = columns[name] * factor
        check_input(name, kind, columns[name], f"profile.scale.{name}")
    if (rows := measured.time_s.size * form.repeat) > MOST_ROWS:
        raise SweepError(
            f"profile.repeat: {rows:,} rows are more than {MOST_ROWS:,}, for which there is no memory; repeat less."
        )
    return _repeated(measured.time_s, columns, form.repeat)


def _repeated(time_s: np.ndarray, columns: Columns, times: int) -> tuple[np.ndarray, Columns]:
    length = time_s[-1] - time_s[0]
    later = [time_s[1:] + number * length for number in range(times)]
    return np.concatenate([time_s[:1], *later]), {
        name: np.concatenate([values[:1], *[values[1:]] * times]) for name, values in columns.items()
    }


def _mission(form: ProfileForm, model: Model, constants: Mapping[str, float]) -> tuple[np.ndarray, Columns]:
    """Return the inputs of segments, one after the other."""
    rows = [round(segment.duration_s / form.step_s) for segment in form.mission]
    levels = []
    for number, segment in enumerate(form.mission, start=1):
        where = f"profile.mission[{number}]"
        for name, value in segment.inputs.items():
            check_input(name, model.kind, [value], f"{where}.{name}")
        inputs = dict(segment.inputs)
        if segment.speed_m_s is not None:
            inputs["duty"] = _duty_for(segment.speed_m_s, model, {**inputs, **constants}, where)
        levels.append(inputs)
        if inputs.keys() != levels[0].keys():
            odd = sorted(inputs.keys() ^ levels[0].keys())[0]
            raise SweepError(f"{where}: '{odd}' is given in one segment and not in another; give it in each.")
    time_s = constant(sum(rows) * form.step_s, form.step_s).time_s
    columns = {
        name: np.concatenate([[levels[0][name]], np.repeat([level[name] for level in levels], rows)])
        for name in levels[0]
    }
    return _repeated(time_s, columns, form.repeat)


def _duty_for(speed_m_s: float, model: Model, inputs: Mapping[str, float], where: str) -> float:
    """Return the duty that holds a speed at the pack's nominal voltage, eqs. 11-14 and 18 in equilibrium, cold winding.

    w = v G / r; i_a = (tau_l + tau_0 sgn w) / k_tau; duty = (k_tau w + R_0 i_a) / (n_series V_nominal). Zero at rest.
    """
    if model.kind != "robot":
        raise SweepError(f"{where}.speed_m_s: only a robot drives at a speed; a {model.kind} has no wheels.")
    if {"duty", "V_set"} & set(inputs):
        raise SweepError(f"{where}: speed_m_s stands for a duty; give one of the two.")
    if not {"load_torque_Nm", "incline_deg"} & set(inputs):
        raise SweepError(f"{where}: speed_m_s needs incline_deg or load_torque_Nm beside it.")
    if speed_m_s == 0.0:
        return 0.0
    p = model.parameters
    torque = load_torque(p, {name: jnp.asarray(value) for name, value in inputs.items()}, model.effects)
    speed = speed_m_s * p.gear_ratio / p.wheel_radius_m
    current = (torque + p.tau_0 * jnp.sign(speed)) / p.k_tau
    duty = float((p.k_tau * speed + p.R_0 * current) / (p.n_series * p.nominal_cell_voltage_V))
    if abs(duty) > 1.0:
        raise SweepError(f"{where}: {speed_m_s:g} m/s takes a duty of {duty:.2f}; slow down to at most 1.")
    return duty
