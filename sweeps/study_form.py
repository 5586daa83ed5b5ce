"""The form of a study file: what may stand where.

What a value means (names of parameters, inputs, metrics and files) is checked in `prepare`.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field, field_serializer, model_validator

from jaxmodel.base.forms import Form, wrong
from jaxmodel.case.forms import CutoffEntry
from jaxmodel.case.records import Case
from jaxmodel.model.ports import Effect
from jaxmodel.sweeps.axes_form import Axes, SampleForm
from jaxmodel.sweeps.form import refuse_unquoted_names
from jaxmodel.sweeps.metrics import Metric
from jaxmodel.sweeps.profile_form import ProfileForm

Kind = Literal["cell", "motor", "robot"]
Fidelity = Literal["formula", "lut"]
Precision = Literal["float64", "float32"]


class StudyFields(TypedDict, total=False):
    """The keyword arguments of `jaxmodel.sweeps.Study`, which explains each; tables of the file are mappings here."""

    title: str
    kind: Kind | None
    preset: str
    case: str | Case | None
    fidelity: Fidelity
    precision: Precision
    parameters: Mapping[str, float]
    effects: Mapping[str, Mapping[str, float | str]]
    profile: ProfileForm | Mapping[str, Any]
    axes: Mapping[str, Sequence[float] | np.ndarray | Mapping[str, float | str]]
    sample: SampleForm | Mapping[str, Any] | None
    metrics: Sequence[str | Metric]
    store: Sequence[str]
    store_every: int
    cutoff: CutoffEntry | Mapping[str, float] | None
    own_effects: Iterable[type[Effect]]
    folder: Path


class StudyForm(Form):
    """The whole file."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    title: str = ""
    kind: Kind | None = None
    preset: str = "paper"
    case: str | Case | None = None
    fidelity: Fidelity = "formula"
    precision: Precision = "float64"
    parameters: Annotated[dict[str, float], BeforeValidator(refuse_unquoted_names)] = Field(default_factory=dict)
    effects: dict[str, dict[str, float | str]] = Field(default_factory=dict)
    profile: ProfileForm
    axes: Axes = Field(default_factory=dict)
    sample: SampleForm | None = None
    metrics: list[str | Metric] = Field(default_factory=list)
    store: list[str] = Field(default_factory=list)
    store_every: int = Field(default=1, ge=1)
    cutoff: CutoffEntry | None = None
    own_effects: list[type[Effect]] = Field(default_factory=list, exclude=True, repr=False)
    folder: Path = Field(default=Path(), exclude=True, repr=False)

    @model_validator(mode="after")
    def _something_varies(self) -> "StudyForm":
        if not self.axes and self.sample is None:
            raise wrong("varies nothing; add [axes] with at least one name, or a [sample]")
        for name in self.sample.ranges if self.sample else ():
            if name in self.axes:
                raise wrong("has '{name}' under [axes] and under [sample.ranges]; remove one of the two", name=name)
        return self

    @field_serializer("case")
    def _case_content(self, case: str | Case | None) -> str | dict[str, Any] | None:
        """Return a case in memory as what its model is made of; a file as its name."""
        if not isinstance(case, Case):
            return case
        tables = {name: dataclasses.asdict(table) for name, table in case.tables.items()}
        return {
            "name": case.name,
            "kind": case.kind,
            "preset": case.preset,
            "parameters": {name: known.value for name, known in case.parameters.items()},
            "tables": {
                name: {key: x.tolist() if isinstance(x, np.ndarray) else x for key, x in table.items()}
                for name, table in tables.items()
            },
            "effects": case.effects,
            "cutoff": case.cutoff,
        }

    @field_serializer("metrics")
    def _metric_names(self, metrics: list[str | Metric]) -> list[str]:
        return [metric if isinstance(metric, str) else metric.name for metric in metrics]
