"""From the form of a study to what it means: the model, the profile and the metrics, after a look at every name."""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxmodel.build import case_model
from jaxmodel.cases import Case, read_case
from jaxmodel.declaration import ParameterInfo
from jaxmodel.effects import CATALOGUE
from jaxmodel.errors import SweepError, nearest
from jaxmodel.measurements import KINDS, read_measurements, read_utf8
from jaxmodel.model import Model
from jaxmodel.names import parameter_table, with_values
from jaxmodel.presets import why_not
from jaxmodel.profile import Profile, constant
from jaxmodel.simulate import Cutoff
from sweeps.metrics import Metric, metrics_of
from sweeps.study_form import StudyForm

# Outside these an input is in the wrong unit, or wrong.
_INPUT_BOUNDS = {
    **dict.fromkeys(("duty", "flipper_duty", "arm_duty"), (-1.0, 1.0)),
    "V_set": (0.0, 5.0),
    "ambient_degC": (-90.0, 200.0),
    "incline_deg": (-90.0, 90.0),
}


@dataclasses.dataclass(frozen=True, eq=False)
class Prepared:
    """What a study means, ready to run.

    Attributes:
        model: with the study's parameters and effects, its axes at their defaults.
        profile: inputs over time, those on an axis at its first value.
        cutoff: where a run ends, or None.
        metrics: what is kept of each lane.
        info: what is known of each axis that is a parameter, by axis name.
        stored_rows: the rows of the profile at which courses are kept.
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
    """Return what a study means, after a look at every name and number in it."""
    case = _case(study)
    model = case_model(case, fidelity=study.fidelity)
    table = parameter_table(model)
    for name, value in study.parameters.items():
        _known(name, table, f"parameters.{name}: no parameter is called").check(value, f"parameters.{name}")
    model = with_values(model, {name: jnp.asarray(value) for name, value in study.parameters.items()})

    inputs = _input_names(model.kind)
    info = {}
    for name, values in study.axes.items():
        if name in inputs:
            _check_input(name, values, f"axes.{name}")
            continue
        effect = name.partition(".")[0]
        if effect in CATALOGUE and name not in table and effect not in {on.name for on in model.effects}:
            raise SweepError(f"axes.{name}: the effect '{effect}' is off; turn it on, as in [effects] {effect} = {{}}.")
        what = f"axes.{name}: no parameter, and no input of a {model.kind}, is called"
        info[name] = _known(name, table, what, inputs)
        for value in values:
            info[name].check(value, f"axes.{name}")

    cutoff = study.cutoff.model_dump(exclude_none=True) or case.cutoff
    for name in study.store:
        outputs = KINDS[model.kind].outputs
        if name not in outputs:
            raise SweepError(f"store: a {model.kind} has no column '{name}'.{nearest(name, outputs)}")
    profile = _profile(study, model.kind)
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
        case = read_case(study.folder / study.case)
        if study.kind not in (None, case.kind):
            raise SweepError(f"kind is '{study.kind}', but the case is a {case.kind}; remove one of the two.")
        effects = {name: values for name, values in case.effects.items() if not _is_of_sensor(name)}
        case = dataclasses.replace(case, effects=effects)
    elif study.kind is None:
        raise SweepError('kind is missing; add kind = "cell", "motor" or "robot", or name a case.')
    elif problem := why_not(study.preset, study.kind):
        raise SweepError(f"preset: {problem}")
    else:
        case = Case("study", Path("effects"), study.title, study.kind, study.preset, {}, {}, {}, {}, (), {})
    for name in study.effects:
        if _is_of_sensor(name):
            raise SweepError(f"effects.{name}: a sweep looks at true values, not at a sensor's; remove this effect.")
    return dataclasses.replace(case, effects=case.effects | study.effects)


def _profile(study: StudyForm, kind: str) -> Profile:
    """Return the inputs over time: the CSV's, replaced by the constants of the profile and by the axes."""
    form, vocabulary = study.profile, KINDS[kind]
    for name, value in form.inputs.items():
        if name not in _input_names(kind):
            raise SweepError(f"profile.{name}: a {kind} has no input '{name}'.{nearest(name, _input_names(kind))}")
        _check_input(name, [value], f"profile.{name}")
    axes = {name: values[0] for name, values in study.axes.items() if name in _input_names(kind)}
    columns: dict[str, Any] = {}
    if form.csv is None:
        assert form.duration_s is not None  # the form has one of the two
        time_s = constant(form.duration_s, form.step_s).time_s
    else:
        path = study.folder / form.csv
        ambient = (form.inputs | axes).get("ambient_degC")
        measured = read_measurements(path, kind, None if _has_column(path, "ambient_degC") else ambient)
        time_s, columns = measured.time_s, measured.inputs
    for layer in (form.inputs, axes):
        others = {other for group in vocabulary.alternatives if set(group) & set(layer) for other in group}
        columns = {name: values for name, values in columns.items() if name not in others} | layer
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


def _metrics(study: StudyForm, kind: str, has_cutoff: bool) -> tuple[Metric, ...]:
    """Return the metrics that the study names, or all that make sense."""
    shipped = metrics_of(kind)
    if not has_cutoff:
        shipped.pop("time_to_cutoff_s", None)
    chosen: list[Metric] = []
    for given in study.metrics or shipped:
        if isinstance(given, str) and given not in shipped:
            if given == "time_to_cutoff_s" and not has_cutoff:
                raise SweepError("metrics: 'time_to_cutoff_s' needs a [cutoff] with soc or voltage_V; add one.")
            raise SweepError(f"metrics: a {kind} has no metric '{given}'.{nearest(given, shipped)}")
        metric = shipped[given] if isinstance(given, str) else given
        if kind not in metric.kinds:
            raise SweepError(f"metrics: '{metric.name}' applies to {' and '.join(metric.kinds)}, not to a {kind}.")
        if metric.name in {other.name for other in chosen} | set(study.store) | set(study.axes):
            raise SweepError(f"metrics: the result would have two variables called '{metric.name}'; rename one.")
        chosen.append(metric)
    return tuple(chosen)


def _input_names(kind: str) -> tuple[str, ...]:
    vocabulary = KINDS[kind]
    return (*vocabulary.required_inputs, *sum(vocabulary.alternatives, ()), *vocabulary.optional_inputs)


def _is_of_sensor(effect: str) -> bool:
    return effect in CATALOGUE and CATALOGUE[effect].is_sensor


def _known(name: str, table: Mapping[str, ParameterInfo], what: str, others: Iterable[str] = ()) -> ParameterInfo:
    if name not in table:
        raise SweepError(f"{what} '{name}'.{nearest(name, [*table, *others])}")
    return table[name]


def _check_input(name: str, values: list[float], where: str) -> None:
    lower, upper = _INPUT_BOUNDS.get(name, (-math.inf, math.inf))
    for value in values:
        if not lower <= value <= upper:
            raise SweepError(f"{where}: {value:g} is outside {lower:g} to {upper:g}; correct the value or its unit.")


def _has_column(csv: Path, name: str) -> bool:
    """Return True if the header of a CSV has a column."""
    lines = (line.strip() for line in read_utf8(csv).splitlines())
    header = next((line for line in lines if line and not line.startswith("#")), "")
    return name in [field.strip() for field in header.split(",")]
