"""From the form of a study to its model, profile and metrics; every name and number is checked."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import SweepError, instead
from jaxmodel.base.units import unit_of
from jaxmodel.case.build import case_model
from jaxmodel.case.forms import parse_case
from jaxmodel.case.measurements import KINDS, file_label, read_utf8
from jaxmodel.case.presets import located, read_preset, why_not
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.effects import own_effects
from jaxmodel.model.declaration import ParameterInfo
from jaxmodel.model.electrothermal import Model, initial_state
from jaxmodel.model.names import parameter_table, with_values
from jaxmodel.model.parameters import TABLE
from jaxmodel.model.ports import Effect
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Cutoff
from jaxmodel.sweeps.metrics import Metric, metrics_of, metrics_on_request
from jaxmodel.sweeps.profiles import build_profile, check_input, input_names
from jaxmodel.sweeps.study_form import StudyForm

# Prefixes of names: a factor on an input, a state at the start.
SCALE, INITIAL = "scale.", "initial."


@dataclasses.dataclass(frozen=True, eq=False)
class Prepared:
    """A study ready to run.

    Attributes:
        model: with the study's parameters and effects, its axes at their defaults.
        profile: inputs over time, those in which lanes differ at one of their values.
        cutoff: where a run ends, or None.
        metrics: computed for each lane.
        info: unit, bounds and meaning of each parameter in which lanes differ, by name; inputs have none.
        stored_rows: the rows of the profile at which columns are stored.
    """

    model: Model
    profile: Profile
    cutoff: Cutoff | None
    metrics: tuple[Metric, ...]
    info: dict[str, ParameterInfo]
    stored_rows: np.ndarray

    @property
    def stored_time_s(self) -> np.ndarray:
        """The times of the stored rows."""
        return self.profile.time_s[self.stored_rows]


def prepare(study: StudyForm) -> Prepared:
    """Return a study ready to run; every name and number in it is checked."""
    case = _case(study)
    model = with_values(case_model(case, fidelity=study.fidelity), _initial_soc_of_case(study))
    table = parameter_table(model)
    for name, value in study.parameters.items():
        _known(name, table, f"parameters.{name}: no parameter is called").check(value, f"parameters.{name}")
    model = with_values(model, {name: jnp.asarray(value) for name, value in study.parameters.items()})

    profile = build_profile(study.profile, study.folder, model, _one_value_of_inputs(study, model.kind))
    varied = {name: (values, f"axes.{name}") for name, values in study.axes.items()}
    for name, span in study.sample.ranges.items() if study.sample else ():
        varied[name] = ([span.low, span.high], f"sample.ranges.{name}")
    info: dict[str, ParameterInfo] = {}
    for name, (values, where) in varied.items():
        if name.startswith(SCALE):
            own = {column: ends for column, (ends, _) in varied.items() if column in input_names(model.kind)}
            info[name] = _scale(name, values, profile, model.kind, where, own)
        elif name.startswith(INITIAL):
            info[name] = _initial(name, values, model, profile, where)
        elif name in input_names(model.kind):
            check_input(name, model.kind, values, where)
        else:
            info[name] = _parameter(name, values, model, table, where, case.catalogue)
            if info[name].whole and study.sample and name in study.sample.ranges:
                raise SweepError(f"{where}: {name} takes whole numbers; put it on an axis instead.")

    cutoff = _cutoff(study, case)
    for name in study.store:
        outputs = KINDS[model.kind].outputs
        if name not in outputs:
            raise SweepError(f"store: a {model.kind} has no column '{name}'.{instead(name, outputs)}")
        if name in varied:
            raise SweepError(
                f"store: lanes differ in '{name}', which is a coordinate of the result already; remove it here."
            )
    return Prepared(
        model=model,
        profile=profile,
        cutoff=Cutoff(**cutoff) if cutoff else None,
        metrics=_metrics(study, model.kind, bool(cutoff)),
        info=info,
        stored_rows=np.arange(0, profile.time_s.size, study.store_every),
    )


def _case(study: StudyForm) -> Case:
    """Return the case that the study describes or names, with the study's effects."""
    if study.case is not None:
        case = study.case if isinstance(study.case, Case) else read_case(study.folder / study.case)
        if study.kind not in (None, case.kind):
            raise SweepError(f"kind is '{study.kind}', but the case is a {case.kind}; remove one of the two.")
        case = dataclasses.replace(case, own_effects={**case.own_effects, **own_effects(study.own_effects)})
        effects = {name: values for name, values in case.effects.items() if not _is_of_sensor(name, case.catalogue)}
        case = dataclasses.replace(case, effects=effects)
    elif study.kind is None:
        raise SweepError('kind is missing; add kind = "cell", "motor" or "robot", or name a case.')
    elif problem := why_not(preset := located(study.preset, study.folder), study.kind):
        raise SweepError(f"preset: {problem}")
    else:
        case = Case("study", None, study.title, study.kind, preset, {}, {}, {}, {}, (), {})
        case = dataclasses.replace(case, own_effects=own_effects(study.own_effects))
    for name in study.effects:
        if _is_of_sensor(name, case.catalogue):
            raise SweepError(f"effects.{name}: a sweep has true values, not a sensor's readings; remove this effect.")
    return dataclasses.replace(case, effects=case.effects | study.effects)


def _cutoff(study: StudyForm, case: Case) -> dict[str, float]:
    """Return where lanes end: as the study says, else as its case does, else as the cells of its preset do."""
    if study.cutoff is not None:
        return study.cutoff.model_dump(exclude_none=True)
    if study.case is not None or case.kind == "motor":
        return case.cutoff
    return read_preset(case.preset).cutoff


def _initial_soc_of_case(study: StudyForm) -> dict[str, Any]:
    """Return the `initial_soc` of a case's `[parameters]`: a case has it for its runs, a study takes it as its own."""
    if study.case is None:
        return {}
    path = study.case.path if isinstance(study.case, Case) else study.folder / study.case
    if path is None:
        return {}
    file = path / "case.toml" if path.is_dir() else path
    stated = parse_case(read_utf8(file), file_label(file)).parameters.__pydantic_extra__.get("initial_soc")
    return {} if stated is None else {"initial_soc": jnp.asarray(stated.value)}


def _one_value_of_inputs(study: StudyForm, kind: str) -> dict[str, float]:
    """Return the inputs in which lanes differ: of an axis its first value, of a range its middle."""
    values = {name: entries[0] for name, entries in study.axes.items()}
    values |= {
        name: 0.5 * (span.low + span.high) for name, span in (study.sample.ranges if study.sample else {}).items()
    }
    return {name: value for name, value in values.items() if name in input_names(kind)}


def _parameter(
    name: str,
    values: list[float],
    model: Model,
    table: Mapping[str, ParameterInfo],
    where: str,
    catalogue: Mapping[str, type[Effect]],
) -> ParameterInfo:
    """Return unit, bounds and meaning of a parameter in which lanes differ."""
    effect = name.partition(".")[0]
    if effect in catalogue and name not in table and effect not in {on.name for on in model.effects}:
        raise SweepError(f"{where}: the effect '{effect}' is off; turn it on, as in [effects] {effect} = {{}}.")
    what = f"{where}: no parameter, and no input of a {model.kind}, is called"
    info = _known(name, table, what, input_names(model.kind))
    for value in values:
        info.check(value, where)
    return info


def _scale(
    name: str, values: list[float], profile: Profile, kind: str, where: str, own: Mapping[str, list[float]]
) -> ParameterInfo:
    """Return unit and meaning of a factor on an input; `own` are the inputs in which lanes differ."""
    column = name.removeprefix(SCALE)
    if column not in profile.inputs:
        raise SweepError(f"{where}: the profile has no input '{column}'.{instead(column, profile.inputs)}")
    if column.endswith("_degC"):
        raise SweepError(f"{where}: a temperature in degC has no factor; put {column} itself on an axis.")
    size = np.concatenate([profile.inputs[column], own.get(column, [])])
    for value in values:
        check_input(column, kind, [value * size.min(), value * size.max()], where)
    return ParameterInfo(name, unit="", meaning=f"factor on the input {column}", default=1.0)


def _initial(name: str, values: list[float], model: Model, profile: Profile, where: str) -> ParameterInfo:
    """Return unit, bounds and meaning of a state at the start."""
    state = name.removeprefix(INITIAL)
    states = initial_state(model, {name: jnp.asarray(column[0]) for name, column in profile.inputs.items()})
    if state not in states:
        raise SweepError(f"{where}: the model has no state '{state}'.{instead(state, states)}")
    meaning = f"{state} at the start of a run"
    info = ParameterInfo(name, unit=unit_of(state), meaning=meaning, default=float(states[state]))
    if state == "soc":
        info = dataclasses.replace(TABLE["initial_soc"], name=name)
    for value in values:
        info.check(value, where)
    return info


def _metrics(study: StudyForm, kind: str, has_cutoff: bool) -> tuple[Metric, ...]:
    """Return the metrics that the study names, or all but those on request."""
    shipped = metrics_of(kind)
    if not has_cutoff:
        shipped.pop("time_to_cutoff_s", None)
    chosen: list[Metric] = []
    by_default, shipped = list(shipped), shipped | metrics_on_request(kind)
    for given in study.metrics or by_default:
        if isinstance(given, str) and given not in shipped:
            if given == "time_to_cutoff_s" and not has_cutoff:
                raise SweepError("metrics: 'time_to_cutoff_s' needs a [cutoff] with soc or voltage_V; add one.")
            raise SweepError(f"metrics: a {kind} has no metric '{given}'.{instead(given, shipped)}")
        metric = shipped[given] if isinstance(given, str) else given
        if kind not in metric.kinds:
            raise SweepError(f"metrics: '{metric.name}' applies to {' and '.join(metric.kinds)}, not to a {kind}.")
        taken = {*study.store, *study.axes, *(study.sample.ranges if study.sample else ()), "lane", "time_s", "status"}
        if metric.name in {other.name for other in chosen} | taken:
            raise SweepError(f"metrics: the result would have two variables called '{metric.name}'; rename one.")
        chosen.append(metric)
    return tuple(chosen)


def _is_of_sensor(effect: str, catalogue: Mapping[str, type[Effect]]) -> bool:
    return effect in catalogue and catalogue[effect].is_sensor


def _known(name: str, table: Mapping[str, ParameterInfo], what: str, others: Iterable[str] = ()) -> ParameterInfo:
    if name not in table:
        raise SweepError(f"{what} '{name}'.{instead(name, [*others, *table])}")
    return table[name]
