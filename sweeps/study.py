"""A sweep study: which model, which profile, which axes, which metrics; read from TOML or written in Python."""

import dataclasses
import hashlib
import math
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from pydantic import ConfigDict, Field, PrivateAttr, ValidationError, field_serializer

from jaxmodel.build import case_model
from jaxmodel.case_schema import CutoffEntry
from jaxmodel.cases import Case, read_case
from jaxmodel.errors import SweepError, UserError, nearest
from jaxmodel.measurements import KINDS, file_label, read_measurements, read_utf8
from jaxmodel.model import Model
from jaxmodel.names import parameter_table, with_values
from jaxmodel.parameters import ParameterInfo
from jaxmodel.profile import Profile, constant
from jaxmodel.robot import duty_of_signal
from jaxmodel.simulate import Cutoff
from sweeps.metrics import Metric, metrics_of
from sweeps.study_form import Axis, Form, ProfileForm, complaint

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
    """

    model: Model
    profile: Profile
    cutoff: Cutoff | None
    metrics: tuple[Metric, ...]
    info: dict[str, ParameterInfo]


class Study(Form):
    """A study: a full grid of runs of one model.

    Attributes:
        title: free text.
        kind: "cell", "motor" or "robot"; a case brings its own.
        preset: where every parameter not named here comes from.
        case: a case file (or its folder) that describes the hardware, instead of a preset.
        fidelity: "formula", or "lut" for the paper's look-up tables.
        parameters: values by name, as in a case file, or `effect.parameter`.
        effects: effects turned on, with their values, as in a case file.
        profile: constant inputs for some time, or a CSV.
        axes: by name of a parameter, of an effect's parameter (`ocv_hysteresis.M_V`) or of an input, its values;
            an input's axis replaces what the profile says of that input.
        metrics: names of shipped metrics, or metrics of one's own; all that the kind has where none are named.
        store: columns whose course is kept too, at every `store_every`-th row.
        store_every: a number of rows.
        cutoff: where a run ends before its profile does; the case's where there is one.
        folder: where relative paths start; of a study file, its folder.

    Raises:
        SweepError, ParameterError, EffectError, MeasurementError: the study cannot be run; the message says why.
    """

    model_config = ConfigDict(arbitrary_types_allowed=True)

    title: str = ""
    kind: Literal["cell", "motor", "robot"] | None = None
    preset: str = "paper"
    case: str | None = None
    fidelity: Literal["formula", "lut"] = "formula"
    parameters: dict[str, float] = {}
    effects: dict[str, dict[str, float | str]] = {}
    profile: ProfileForm
    axes: dict[str, Axis] = Field(min_length=1)
    metrics: list[str | Metric] = []
    store: list[str] = []
    store_every: int = Field(default=1, ge=1)
    cutoff: CutoffEntry = CutoffEntry()
    folder: Path = Field(default=Path(), exclude=True, repr=False)
    _prepared: Prepared = PrivateAttr()

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise SweepError(complaint(error)) from error
        self._prepared = _prepare(self)

    @field_serializer("metrics")
    def _metric_names(self, metrics: list[str | Metric]) -> list[str]:
        return [metric if isinstance(metric, str) else metric.name for metric in metrics]

    @property
    def prepared(self) -> Prepared:
        """The model, profile and metrics that the study names."""
        return self._prepared

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values on each axis, in order."""
        return tuple(len(values) for values in self.axes.values())

    @property
    def size(self) -> int:
        """The number of lanes."""
        return math.prod(self.shape)

    @property
    def digest(self) -> str:
        """The SHA-256 of the study and of the files that it names."""
        hashed = hashlib.sha256(self.model_dump_json().encode())
        for file in (self.case, self.profile.csv):
            if file is not None:
                path = self.folder / file
                hashed.update((path / "case.toml" if path.is_dir() else path).read_bytes())
        return hashed.hexdigest()

    def lanes(self, numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of every axis for lanes by their number, the last axis running fastest.

        A set signal becomes a duty here (eq. 22), which is what the model takes.
        """
        places = np.unravel_index(numbers, self.shape)
        lanes = {name: np.asarray(self.axes[name])[place] for name, place in zip(self.axes, places, strict=True)}
        if "V_set" in lanes:
            lanes["duty"] = duty_of_signal(lanes.pop("V_set"))
        return lanes


def read_study(path: str | Path) -> Study:
    """Read a study file.

    Args:
        path: a TOML file; the paths that it names are relative to it.

    Raises:
        SweepError, ParameterError, EffectError, MeasurementError: the study cannot be run; the message is one sentence with
            the file and the path of the field.
    """
    path = Path(path)
    label = file_label(path)
    try:
        raw = tomllib.loads(read_utf8(path))
    except tomllib.TOMLDecodeError as error:
        raise SweepError(f"{label}: this is not valid TOML ({error}); correct it there.") from error
    try:
        return Study(**{**raw, "folder": path.parent})
    except UserError as error:
        raise type(error)(f"{label}: {error}") from error


def _prepare(study: Study) -> Prepared:
    """Return what a study means, after a look at every name and number in it."""
    case = _case(study)
    model = case_model(case, fidelity=study.fidelity)
    table = parameter_table(model)
    for name, value in study.parameters.items():
        _known(name, table, f"parameters.{name}: no parameter is called").check(value, "parameters")
    model = with_values(model, {name: jnp.asarray(value) for name, value in study.parameters.items()})

    inputs = _input_names(model.kind)
    info = {}
    for name, values in study.axes.items():
        if name in inputs:
            _check_input(name, values, f"axes.{name}")
            continue
        what = f"axes.{name}: no parameter, and no input of a {model.kind}, is called"
        info[name] = _known(name, table, what, inputs)
        for value in values:
            info[name].check(value, "axes")

    cutoff = study.cutoff.model_dump(exclude_none=True) or case.cutoff
    for name in study.store:
        outputs = KINDS[model.kind].outputs
        if name not in outputs:
            raise SweepError(f"store: a {model.kind} has no column '{name}'.{nearest(name, outputs)}")
    return Prepared(
        model=model,
        profile=_profile(study, model.kind),
        cutoff=Cutoff(**cutoff) if cutoff else None,
        metrics=_metrics(study, model.kind, bool(cutoff)),
        info=info,
    )


def _case(study: Study) -> Case:
    """Return the case that the study describes or names, with the study's effects."""
    if study.case is not None:
        case = read_case(study.folder / study.case)
        if study.kind not in (None, case.kind):
            raise SweepError(f"kind is '{study.kind}', but the case is a {case.kind}; remove one of the two.")
        case = dataclasses.replace(case, effects={n: e for n, e in case.effects.items() if "column" not in e})
    elif study.kind is None:
        raise SweepError('kind is missing; add kind = "cell", "motor" or "robot", or name a case.')
    else:
        case = Case("study", Path("effects"), study.title, study.kind, study.preset, {}, {}, {}, {}, (), {})
    for name, values in study.effects.items():
        if "column" in values:
            raise SweepError(f"effects.{name}: a sweep looks at true values, not at a sensor's; remove this effect.")
    return dataclasses.replace(case, effects=case.effects | study.effects)


def _profile(study: Study, kind: str) -> Profile:
    """Return the inputs over time: the CSV's, replaced by the constants of the profile and by the axes."""
    form, vocabulary = study.profile, KINDS[kind]
    for name, value in form.inputs.items():
        if name not in _input_names(kind):
            raise SweepError(f"profile.{name}: a {kind} has no input '{name}'.{nearest(name, _input_names(kind))}")
        _check_input(name, [value], f"profile.{name}")
    axes = {name: values[0] for name, values in study.axes.items() if name in _input_names(kind)}
    if form.csv is None:
        time_s, columns = constant(form.duration_s, form.step_s).time_s, {}
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
    return Profile(time_s, columns)


def _metrics(study: Study, kind: str, has_cutoff: bool) -> tuple[Metric, ...]:
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
