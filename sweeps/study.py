"""A sweep study: which model, which profile, which axes, which metrics; read from TOML or written in Python."""

import hashlib
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from pydantic import PrivateAttr, ValidationError

from jaxmodel.base import toml
from jaxmodel.base.errors import SweepError, UserError, listed
from jaxmodel.base.forms import complaint
from jaxmodel.base.in_short import InShort
from jaxmodel.case.measurements import file_label, read_utf8
from jaxmodel.model.ports import Effect
from jaxmodel.model.robot import duty_of_signal
from jaxmodel.sweeps.prepare import INITIAL, SCALE, Prepared, prepare
from jaxmodel.sweeps.profiles import input_names
from jaxmodel.sweeps.sample import draw
from jaxmodel.sweeps.study_form import StudyFields, StudyForm

# The dimension along which lanes lie whose values are drawn.
LANE = "lane"


class Study(InShort, StudyForm):
    """A study: one model, one input profile, and the parameters and inputs in which its runs (lanes) differ.

    Every argument is a key of the study file; a table of the file is a mapping in Python:

        Study(
            kind="cell",
            profile={"duration_s": 600.0, "step_s": 10.0, "ambient_degC": 20.0},
            axes={"current_A": [0.5, 1.0, 2.0], "cycles": {"start": 0, "stop": 200, "count": 5}},
            sample={"count": 64, "ranges": {"capacity_Ah": (2.5, 3.5)}},
        )

    Attributes:
        title: free text.
        kind: "cell", "motor" or "robot"; a case brings its own.
        preset: where every parameter not named here comes from.
        case: a case file (or its folder), or a `jaxmodel.Case`, that describes the hardware, instead of a preset; its
            runs and sensors are not used.
        fidelity: "formula", or "lut" for the paper's look-up tables.
        precision: "float64", or "float32" for sweeps that screen: half the time of a sweep, some digits less.
        parameters: values by name, as in a case file, or `effect.parameter`.
        effects: effects turned on, with their values, as in a case file.
        profile: inputs over time: constants, pulse trains, a CSV or drive cycle, a mission.
        axes: by name of a parameter, of an effect's parameter (`ocv_hysteresis.M_V`) or of an input, its values, as a
            list, an array, or {"start": ..., "stop": ..., "count": ... or "step": ...}; all are combined;
            an input's axis replaces what the profile says of that input; `scale.INPUT` multiplies it, `initial.STATE`
            sets a state at the start.
        sample: {"count": ..., "ranges": {name: (low, high)}}: lanes whose values are drawn from ranges, along a
            dimension `lane` of the result.
        metrics: names of shipped metrics, or instances of `jaxmodel.sweeps.Metric`; by default all that the kind has.
        store: columns that are stored over time too, at every `store_every`-th row.
        store_every: a number of rows.
        cutoff: where a run ends before its profile does; {} for nowhere, None for that of the case or the preset.
        own_effects: effect classes of your own, known to this study beside the catalogue.
        folder: where relative paths start; of a study file, its folder.

    Raises:
        SweepError, ParameterError, EffectError, MeasurementError: the study cannot be run; the message says why.

    Example:
        >>> from jaxmodel import sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> study.size
        2
    """

    _prepared: Prepared = PrivateAttr()

    def __init__(self, /, **fields: Unpack[StudyFields]) -> None:
        values: dict[str, Any] = {**fields}
        values["own_effects"] = list(values.get("own_effects", ()))
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise SweepError(complaint(error, values, "the study")) from error
        self._prepared = prepare(self)

    def _in_short(self) -> str:
        title = f"{self.title}, " if self.title else ""
        return f"{title}{self.size:,} lanes of a {self.prepared.model.kind} over {listed(self.varied, 6)}"

    @property
    def prepared(self) -> Prepared:
        """The model, profile and metrics that the study names."""
        return self._prepared

    def replace(self, **changes: Unpack[StudyFields]) -> "Study":
        """Return a copy of the study with some of its arguments changed.

        Raises:
            SweepError, ParameterError, EffectError, MeasurementError: as for the study itself.
        """
        fields: dict[str, Any] = {**dict(self), **changes}
        return Study(**fields)

    def at(self, point: Mapping[str, float]) -> "Study":
        """Return the study at a point: each name has one value, whether the study varies it or not.

        An input, or a name that the study varies, becomes an axis of one value; any other name becomes a parameter.

        Args:
            point: values by name of a parameter or input, in its unit.

        Raises:
            SweepError, ParameterError: a name or value cannot be used.
        """
        inputs = input_names(self.prepared.model.kind)
        for name in point:
            if name.startswith((SCALE, INITIAL)):
                raise SweepError(f"at {name}: a point has parameters and inputs; state the input or parameter itself.")
        sample = self.sample
        if sample is not None:
            ranges = {name: span for name, span in sample.ranges.items() if name not in point}
            sample = sample.model_copy(update={"ranges": ranges}) if ranges else None
        return self.replace(
            axes=self.axes | {name: [value] for name, value in point.items() if name in inputs or name in self.varied},
            parameters=self.parameters | {name: value for name, value in point.items() if name not in inputs},
            sample=sample,
        )

    @property
    def varied(self) -> tuple[str, ...]:
        """The names in which lanes differ."""
        return (*self.axes, *(self.sample.ranges if self.sample else ()))

    def range_of(self, name: str) -> tuple[float, float]:
        """Return the least and the greatest value that lanes have of a name."""
        if self.sample is not None and name in self.sample.ranges:
            return self.sample.ranges[name].low, self.sample.ranges[name].high
        return min(self.axes[name]), max(self.axes[name])

    @property
    def dims(self) -> dict[str, int]:
        """The number of values along each dimension of the result, by name, in order."""
        sizes = {name: len(values) for name, values in self.axes.items()}
        return sizes | ({LANE: self.sample.count} if self.sample else {})

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values along each dimension, in order."""
        return tuple(self.dims.values())

    @property
    def size(self) -> int:
        """The number of lanes."""
        return math.prod(self.shape)

    @property
    def digest(self) -> str:
        """The SHA-256 of the study and of the files that it names."""
        hashed = hashlib.sha256(self.model_dump_json().encode())
        for digest in self.file_digests.values():
            hashed.update(digest.encode())
        return hashed.hexdigest()

    @property
    def file_digests(self) -> dict[str, str]:
        """The SHA-256 of each file that the study names, by the name."""
        paths = {file: self.folder / file for file in (self.case, self.profile.csv) if isinstance(file, str)}
        whole = {file: path / "case.toml" if path.is_dir() else path for file, path in paths.items()}
        return {file: hashlib.sha256(path.read_bytes()).hexdigest() for file, path in whole.items()}

    def drawn(self, numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values drawn for places along the dimension `lane`."""
        return draw(self.sample, numbers) if self.sample else {}

    def lanes(self, numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Return what lanes differ in, by their number, the last dimension running fastest.

        A set signal becomes a duty here (eq. 22), which is what the model takes.
        """
        places = np.unravel_index(numbers, self.shape)
        lanes = {name: np.asarray(self.axes[name])[place] for name, place in zip(self.axes, places, strict=False)}
        lanes |= self.drawn(places[-1])
        if "V_set" in lanes:
            lanes["duty"] = duty_of_signal(lanes.pop("V_set"))
        return lanes


def read_study(path: str | Path, *, own_effects: Iterable[type[Effect]] = ()) -> Study:
    """Read a study file.

    Args:
        path: a TOML file; the paths that it names are relative to it.
        own_effects: effect classes of your own, which the file may name beside those of the catalogue.

    Raises:
        SweepError, ParameterError, EffectError, MeasurementError: the study cannot be run; the message is one
            sentence with the file and the path of the field.

    Example:
        >>> from jaxmodel import sweeps
        >>> sweeps.read_study("examples/pulsed_cell.toml").varied
        (...)
    """
    path = Path(path)
    label = file_label(path)
    fields: dict[str, Any] = {
        **toml.parsed(read_utf8(path), label),
        "folder": path.parent,
        "own_effects": list(own_effects),
    }
    try:
        return Study(**fields)
    except UserError as error:
        raise type(error)(f"{label}: {error}") from error
