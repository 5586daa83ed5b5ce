"""Missions: a sequence of segments that a robot repeats, how long its pack lasts, and what ends it.

A mission is a list of segments: drive on a surface at a slope, climb stairs on the flippers, stand. It is repeated
until the first of three limits: the charge, the voltage of a cell, the temperature of a winding.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray
from jaxtyping import Array
from pydantic import Field, ValidationError, model_validator

from jaxmodel.base import toml
from jaxmodel.base.errors import SweepError, instead
from jaxmodel.base.forms import Form, complaint, wrong
from jaxmodel.base.in_short import InShort
from jaxmodel.case.measurements import file_label, read_utf8
from jaxmodel.model.cell import storage_factor
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.model.parameters import TABLE
from jaxmodel.model.profile import MOST_ROWS, Profile
from jaxmodel.model.robot import flipper_torque, track_torque
from jaxmodel.model.simulation import Cutoff, Track, run_track, track
from jaxmodel.operation.compensation import Compensation

SURFACES = {
    "asphalt": 0.7,
    "concrete": 0.65,
    "wet concrete": 0.45,
    "gravel": 0.6,
    "rubble": 0.8,
    "grass": 0.55,
    "ice": 0.1,
}
"""Friction coefficients mu of eq. 18 by surface.

The paper has 0.7, rubber on asphalt; the others are assumed, in the order of the traction of a track on them.
"""
FLIPPER_GEAR, FLIPPER_EFFICIENCY = 246.0, 0.94  # assumed; the paper states none for the flippers
LIMITS = ("charge", "voltage", "winding")
"""What may end a mission."""
NOT_REACHED = len(LIMITS)


class Segment(InShort, Form):
    """One part of a mission.

    Attributes:
        what: free text for pictures.
        duration_s: of it.
        speed_m_s: over ground; 0 is standing.
        surface: one of `SURFACES`.
        incline_deg: of the ground; stairs have that of their edges.
        flipper_load_kg: what the flippers lift (eq. 19); 0 where they rest.
        flipper_length_m: from their axis to that load.
        flipper_duty: of their motors while they lift.

    Example:
        >>> from jaxmodel.operation import Segment
        >>> Segment(what="up the ramp", duration_s=60.0, speed_m_s=0.3, incline_deg=10.0)
        <Segment: what=up the ramp, duration_s=60, speed_m_s=0.3, incline_deg=10>
    """

    what: str = ""
    duration_s: float = Field(gt=0)
    speed_m_s: float = Field(default=0.0, ge=0.0)
    surface: str = "asphalt"
    incline_deg: float = Field(default=0.0, ge=-60.0, le=60.0)
    flipper_load_kg: float = Field(default=0.0, ge=0.0)
    flipper_length_m: float = Field(default=0.3, gt=0.0)
    flipper_duty: float = Field(default=0.2, ge=0.0, le=1.0)


class Mission(InShort, Form):
    """A mission: the content of a mission file.

    Attributes:
        title: free text.
        step_s: of the simulation.
        segment: the segments of one round, in order.

    Example:
        >>> from jaxmodel.operation import Mission, Segment
        >>> segments = [Segment(duration_s=60.0, speed_m_s=0.3), Segment(duration_s=30.0)]
        >>> Mission(title="there and back", segment=segments)
        <Mission: title=there and back, segment=<Segment: duration_s=60, speed_m_s=0.3>, <Segment: duration_s=30>>
    """

    title: str = ""
    step_s: float = Field(default=1.0, gt=0)
    segment: list[Segment] = Field(min_length=1)

    @model_validator(mode="after")
    def _whole_steps(self) -> "Mission":
        for number, one in enumerate(self.segment, start=1):
            steps = one.duration_s / self.step_s
            if not math.isfinite(steps) or round(steps) < 1 or not math.isclose(steps, round(steps), rel_tol=1e-9):
                raise wrong(
                    "segment {number} lasts {duration} s, no whole number of steps of {step} s; correct one of them",
                    number=number, duration=f"{one.duration_s:g}", step=f"{self.step_s:g}",
                )  # fmt: skip
        return self


@dataclasses.dataclass(frozen=True)
class Limits(InShort):
    """What ends a mission: the first of a charge, the voltage of one cell, and the temperature of a winding.

    Attributes:
        soc: state of charge; a tenth is the reserve for the way back: assumed.
        cell_V: the paper recommends 3 V.
        winding_degC: maxon's limit for the RE50.

    Example:
        >>> from jaxmodel import operation
        >>> operation.Limits(soc=0.2)
        Limits(soc=0.2, cell_V=3.0, winding_degC=125.0)
    """

    soc: float = 0.1
    cell_V: float = 3.0
    winding_degC: float = 125.0


@dataclasses.dataclass(frozen=True, repr=False)
class Endurance(InShort):
    """How long missions last, over lanes of any shape.

    Attributes:
        time_s: until the first limit; the whole of the longest run where none was reached.
        distance_m: driven until then.
        limit: index in `LIMITS`, or `NOT_REACHED`.
        each_s: until each limit alone, by name; inf where it was not reached.
    """

    time_s: np.ndarray
    distance_m: np.ndarray
    limit: np.ndarray
    each_s: Mapping[str, np.ndarray]


def read_mission(path: str | Path) -> Mission:
    """Read a mission file.

    Raises:
        MeasurementError: it is no TOML.
        SweepError: a key is wrong, or a surface is unknown.

    Example:
        >>> from jaxmodel import operation
        >>> operation.read_mission("examples/missions/house_search.toml").title
        'Search of a house'
    """
    path = Path(path)
    label = file_label(path)
    content = toml.parsed(read_utf8(path), label)
    try:
        mission = Mission.model_validate(content)
    except ValidationError as error:
        raise SweepError(f"{label}: {complaint(error, content, 'the mission')}") from error
    for number, segment in enumerate(mission.segment, start=1):
        if segment.surface not in SURFACES:
            raise SweepError(
                f"{label}: segment {number} has no surface '{segment.surface}'.{instead(segment.surface, SURFACES)}"
            )
    return mission


def mission_profile(
    mission: Mission,
    model: Model,
    rounds: int = 1,
    limited: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> Profile:
    """Return the input profile of some rounds: torque by eq. 18, the duty that holds the speed, flippers by eq. 19.

    The duty is that of eqs. 11 to 14 in equilibrium at the pack's nominal voltage, cold winding. The ambient is 20
    degC; lanes bring their own.

    Args:
        mission: its segments.
        model: whose robot drives.
        rounds: how often the segments are repeated.
        limited: given the torques and duties of the rows, returns lower duties.

    Raises:
        SweepError: a segment is too fast for the pack, or there are more rows than memory.

    Example:
        >>> from jaxmodel import Model
        >>> from jaxmodel.operation import Mission, Segment, mission_profile
        >>> mission = Mission(segment=[Segment(duration_s=60.0, speed_m_s=0.3), Segment(duration_s=30.0)])
        >>> mission_profile(mission, Model("robot"), rounds=2)
        <Profile: 181 rows, 0 to 180 s, duty, load_torque_Nm, flipper_torque_Nm, flipper_duty, ambient_degC>
    """
    if (needed := rounds * sum(segment.duration_s for segment in mission.segment) / mission.step_s) > MOST_ROWS:
        raise SweepError(
            f"mission: {needed:.3g} rows of {mission.step_s:g} s are more than {MOST_ROWS:,}, for which there is no "
            "memory; lengthen step_s, or shorten the segments."
        )
    rows: dict[str, list[float]] = {
        name: [] for name in ("duty", "load_torque_Nm", "flipper_torque_Nm", "flipper_duty")
    }
    counts = []
    for number, segment in enumerate(mission.segment, start=1):
        torque, duty = drive(segment, model)
        if duty > 1.0:
            raise SweepError(
                f"mission: segment {number} takes a duty of {duty:.2f} for {segment.speed_m_s:g} m/s; slow it down."
            )
        load, length = jnp.asarray(segment.flipper_load_kg), jnp.asarray(segment.flipper_length_m)
        lift = flipper_torque(load, length, jnp.asarray(FLIPPER_GEAR), jnp.asarray(FLIPPER_EFFICIENCY))
        lifts = segment.flipper_load_kg > 0.0
        values = (duty, torque, float(lift), segment.flipper_duty if lifts else 0.0)
        for name, value in zip(rows, values, strict=True):
            rows[name].append(value)
        counts.append(round(segment.duration_s / mission.step_s))
    columns = {name: np.tile(np.repeat(values, counts), rounds) for name, values in rows.items()}
    if limited is not None:
        columns["duty"] = limited(columns["load_torque_Nm"], columns["duty"])
    columns = {name: np.concatenate([values[:1], values]) for name, values in columns.items()}
    time_s = mission.step_s * np.arange(columns["duty"].size)
    return Profile(time_s, columns | {"ambient_degC": np.full(time_s.size, 20.0)})


def drive(segment: Segment, model: Model) -> tuple[float, float]:
    """Return the torque of a track motor (N m) and the duty that holds a segment's speed; both 0 at a standstill."""
    if segment.speed_m_s == 0.0:
        return 0.0, 0.0
    p = model.parameters
    ground = eqx.tree_at(lambda q: q.friction_coefficient, p, SURFACES[segment.surface])
    torque = float(track_torque(ground, jnp.asarray(segment.incline_deg), jnp.zeros(())))
    speed = segment.speed_m_s * p.gear_ratio / p.wheel_radius_m
    current = (torque + p.tau_0) / p.k_tau
    return torque, float((p.k_tau * speed + p.R_0 * current) / (p.n_series * p.nominal_cell_voltage_V))


def endurance(
    model: Model,
    mission: Mission,
    ambient_degC: np.ndarray,
    ages: Mapping[str, tuple[float, float]] | None = None,
    limits: Limits | None = None,
    *,
    compensation: Compensation | None = None,
    longest_h: float = 8.0,
) -> xarray.Dataset:
    """Return how long a robot can repeat a mission, over ambient temperature and age of its pack, and what ends it.

    Args:
        model: a robot.
        mission: from `read_mission`, or `Mission(...)`; it is repeated until the first limit.
        ambient_degC: shape (ambients,).
        ages: by name, months of storage and charging cycles; the model's own if not given.
        limits: what ends the mission; 10 % charge, 3 V of a cell or 125 degC of a winding if not given.
        compensation: a map whose duty no segment exceeds.
        longest_h: after so many hours a mission counts as not ended.

    Returns:
        A data set over ambient_degC and age: storage_months, cycles (age); time_s until the first limit; distance_m
        until then; ended_by, one of `LIMITS` or "nothing"; until_charge_s, until_voltage_s and until_winding_s, until
        each limit alone, inf where it was not reached.

    Raises:
        SweepError: a segment is too fast for the pack, or an age leaves no capacity.
        ParameterError: an age is out of bounds.

    Example:
        >>> import numpy as np
        >>> from jaxmodel import Model
        >>> from jaxmodel.operation import Mission, Segment, endurance
        >>> mission = Mission(segment=[Segment(duration_s=60.0, speed_m_s=0.3), Segment(duration_s=30.0)])
        >>> endurance(Model("robot"), mission, np.array([20.0])).sizes["ambient_degC"]
        1
    """
    p = model.parameters
    ages = ages or {_age_name(float(p.storage_months), float(p.cycles)): (float(p.storage_months), float(p.cycles))}
    for name, (months, cycles) in ages.items():
        _check_age(model, months, cycles, f"age '{name}'")
    months, cycles = np.array(list(ages.values())).T
    rounds = rounds_in(mission, longest_h)
    if compensation is None:
        found = [_endurance_at(model, mission_profile(mission, model, rounds), ambient_degC, months, cycles, limits)]
    else:
        found = []
        for ambient in ambient_degC:
            profile = mission_profile(mission, model, rounds, _limited_by(compensation, float(ambient)))
            found.append(_endurance_at(model, profile, np.array([ambient]), months, cycles, limits))

    def joined(values: Callable[[Endurance], np.ndarray]) -> tuple[tuple[str, str], np.ndarray]:
        return ("ambient_degC", "age"), np.concatenate([values(part) for part in found])

    data = xarray.Dataset(
        {
            "time_s": joined(lambda part: part.time_s),
            "distance_m": joined(lambda part: part.distance_m),
            "ended_by": joined(lambda part: np.array([*LIMITS, "nothing"])[part.limit]),
        }
        | {f"until_{limit}_s": joined(lambda part, limit=limit: part.each_s[limit]) for limit in LIMITS},
        {
            "ambient_degC": np.asarray(ambient_degC, dtype=float),
            "age": list(ages),
            "storage_months": ("age", months),
            "cycles": ("age", cycles),
        },
        {"title": mission.title},
    )
    for name, (words, unit) in _LABELS.items():
        data[name].attrs |= {"long_name": words, "units": unit}
    return data


# What each variable of `endurance` is called, and its unit.
_LABELS = {
    "time_s": ("time until the first limit", "s"),
    "distance_m": ("distance until the first limit", "m"),
    "ended_by": ("first limit", ""),
    "ambient_degC": ("ambient temperature", "degC"),
    "age": ("age of the pack", ""),
    "storage_months": ("months of storage", "months"),
    "cycles": ("charging cycles", ""),
    **{f"until_{limit}_s": (f"time until the limit of {limit}", "s") for limit in LIMITS},
}


def rounds_in(mission: Mission, hours: float) -> int:
    """Return how many rounds of a mission begin within so many hours."""
    return math.ceil(hours * 3600.0 / sum(segment.duration_s for segment in mission.segment))


def _limited_by(compensation: Compensation, ambient_degC: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return what lowers duties to those of a map at an ambient; where the map has none, they stay."""

    def limited(torque: np.ndarray, duty: np.ndarray) -> np.ndarray:
        most = compensation.interpolated(np.full_like(torque, ambient_degC), torque)
        return np.where(np.isfinite(most), np.minimum(duty, most), duty)

    return limited


def _age_name(months: float, cycles: float) -> str:
    return f"{months:g} months, {cycles:g} cycles"


def _check_age(model: Model, months: float, cycles: float, where: str) -> None:
    TABLE["storage_months"].check(months, where)
    TABLE["cycles"].check(cycles, where)
    degC = model.parameters.storage_temperature_degC
    if float(storage_factor(jnp.asarray(months), degC)) <= 0.0:
        raise SweepError(
            f"{where}: by eq. 8 no capacity is left after {months:g} months at {float(degC):g} degC; take fewer."
        )


def _endurance_at(
    model: Model,
    profile: Profile,
    ambient_degC: np.ndarray,
    months: np.ndarray,
    cycles: np.ndarray,
    limits: Limits | None,
) -> Endurance:
    """Return endurances of shape (ambients, ages)."""
    shape = (len(ambient_degC), len(months))
    lanes = {
        "ambient_degC": np.broadcast_to(np.asarray(ambient_degC, dtype=float)[:, None], shape),
        "storage_months": np.broadcast_to(months, shape),
        "cycles": np.broadcast_to(cycles, shape),
    }
    return run_mission(model, profile, lanes, limits)


def run_mission(
    model: Model, profile: Profile, lanes: Mapping[str, np.ndarray], limits: Limits | None = None
) -> Endurance:
    """Run a mission in many lanes and return when and why each ends.

    Args:
        model: a robot.
        profile: from `mission_profile`, long enough.
        lanes: by parameter or "ambient_degC", values of one shape.
        limits: what ends it.
    """
    limits = limits or Limits()
    shape = np.shape(next(iter(lanes.values())))
    flat = {name: jnp.asarray(np.ravel(values), dtype=float) for name, values in lanes.items()}
    cutoff = Cutoff(soc=0.5 * limits.soc)  # type: ignore[arg-type]
    laid = track(model, profile)
    ran = _lanes(model, laid, jnp.asarray(profile.time_s), cutoff, flat)
    end, reached, speed = (np.asarray(part) for part in ran)
    rows = np.arange(profile.time_s.size)
    # Of each limit the first row beyond it; a run counts up to its last row.
    first = {}
    p = model.parameters
    values = dict(zip(("soc", "pack", "winding"), np.moveaxis(reached, 1, 0), strict=True))
    beyond = {
        "charge": values["soc"] < limits.soc,
        "voltage": values["pack"] / float(p.n_series) < limits.cell_V,
        "winding": values["winding"] > limits.winding_degC,
    }
    reached_rows = rows[None, :] <= end[:, None]
    each = {}
    for name, crossed in beyond.items():
        crossed = crossed & reached_rows
        first[name] = np.where(crossed.any(axis=1), crossed.argmax(axis=1), rows.size)
        each[name] = np.where(crossed.any(axis=1), profile.time_s[np.minimum(first[name], rows.size - 1)], np.inf)
    stacked = np.stack([first[name] for name in LIMITS])
    last = np.minimum(stacked.min(axis=0), end)
    metres = np.abs(speed) * float(p.wheel_radius_m / p.gear_ratio)
    steps = np.diff(profile.time_s)
    driven = np.concatenate([np.zeros((len(metres), 1)), np.cumsum(metres[:, 1:] * steps, axis=1)], axis=1)
    limit = np.where(stacked.min(axis=0) < rows.size, stacked.argmin(axis=0), NOT_REACHED)
    return Endurance(
        time_s=profile.time_s[last].reshape(shape),
        distance_m=np.take_along_axis(driven, last[:, None], axis=1)[:, 0].reshape(shape),
        limit=limit.reshape(shape),
        each_s={name: times.reshape(shape) for name, times in each.items()},
    )


@eqx.filter_jit
def _lanes(
    model: Model, laid: Track, time_s: Array, cutoff: Cutoff, flat: dict[str, Array]
) -> tuple[Array, Array, Array]:
    """Return the last row, (soc, pack voltage, winding temperature) and speed of each lane at all rows."""

    def one(own: dict[str, Array]) -> tuple[Array, Array, Array]:
        ambient = own.pop("ambient_degC", None)
        inputs = (
            laid.inputs
            if ambient is None
            else laid.inputs | {"ambient_degC": jnp.full_like(laid.inputs["duty"], ambient)}
        )
        ran = run_track(with_values(model, own), eqx.tree_at(lambda t: t.inputs, laid, inputs), time_s, cutoff)
        readings = ran.readings
        kept = jnp.stack([readings[n] for n in ("soc", "pack_voltage_V", "winding_temperature_degC")])
        return ran.end_row, kept, readings["speed_rad_s"]

    return jax.vmap(lambda own: one(dict(own)))(flat)
