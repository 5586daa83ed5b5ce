"""The form of a study file: what may stand where.

What a value means (names of parameters, inputs, metrics and files) is checked in `prepare`.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, ConfigDict, Field, field_serializer, model_validator

from jaxmodel.case_schema import CutoffEntry
from sweeps.axes_form import Axes, SampleForm
from sweeps.form import Form, refuse_unquoted_names, wrong
from sweeps.metrics import Metric
from sweeps.profile_form import ProfileForm


class StudyForm(Form):
    """The whole file."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    title: str = ""
    kind: Literal["cell", "motor", "robot"] | None = None
    preset: str = "paper"
    case: str | None = None
    fidelity: Literal["formula", "lut"] = "formula"
    parameters: Annotated[dict[str, float], BeforeValidator(refuse_unquoted_names)] = Field(default_factory=dict)
    effects: dict[str, dict[str, float | str]] = Field(default_factory=dict)
    profile: ProfileForm
    axes: Axes = Field(default_factory=dict)
    sample: SampleForm | None = None
    metrics: list[str | Metric] = Field(default_factory=list)
    store: list[str] = Field(default_factory=list)
    store_every: int = Field(default=1, ge=1)
    cutoff: CutoffEntry = CutoffEntry()
    folder: Path = Field(default=Path(), exclude=True, repr=False)

    @model_validator(mode="after")
    def _something_varies(self) -> "StudyForm":
        if not self.axes and self.sample is None:
            raise wrong("varies nothing; add [axes] with at least one name, or a [sample]")
        for name in self.sample.ranges if self.sample else ():
            if name in self.axes:
                raise wrong("has '{name}' under [axes] and under [sample.ranges]; remove one of the two", name=name)
        return self

    @field_serializer("metrics")
    def _metric_names(self, metrics: list[str | Metric]) -> list[str]:
        return [metric if isinstance(metric, str) else metric.name for metric in metrics]
