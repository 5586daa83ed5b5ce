"""The form of a study file: what may stand where, and one sentence for what does not.

What a value means (names of parameters, inputs, metrics and files) is checked in `prepare`.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_serializer, model_validator
from pydantic_core import PydanticCustomError

from jaxmodel.case_schema import CutoffEntry
from jaxmodel.errors import nearest
from sweeps.metrics import Metric


def wrong(sentence: str, **details: Any) -> PydanticCustomError:
    """Return an error whose text is ours; `{name}` in it stands for a detail."""
    return PydanticCustomError("form", sentence, details)  # type: ignore[arg-type]


class Form(BaseModel):
    """A table of the file. A key that it does not know is an error that names the nearest one."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _reject_unknown_keys(cls, raw: Any) -> Any:
        if cls.model_config.get("extra") == "forbid":
            for key in raw if isinstance(raw, Mapping) else ():
                if key not in cls.model_fields:
                    hint = nearest(key, cls.model_fields) or " Remove it."
                    raise wrong("knows no '{key}'.{hint}", key=key, hint=hint)
        return raw


class ProfileForm(Form):
    """`[profile]`: constant inputs for some time, or a CSV of inputs over time; any further key is a constant input."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float] = Field(init=False)
    csv: str | None = None
    duration_s: float | None = Field(default=None, gt=0)
    step_s: float = Field(default=1.0, gt=0)

    @property
    def inputs(self) -> dict[str, float]:
        """The constant inputs by name."""
        return dict(self.__pydantic_extra__)

    @model_validator(mode="after")
    def _one_course(self) -> "ProfileForm":
        if (self.csv is None) == (self.duration_s is None):
            raise wrong("needs either duration_s (with constant inputs) or csv, one of them")
        if self.duration_s is not None:
            steps = self.duration_s / self.step_s
            if not math.isclose(steps, round(steps), rel_tol=1e-9) or round(steps) < 1:
                raise wrong(
                    "has duration_s = {duration} and step_s = {step}; the duration must be a whole number of steps",
                    duration=self.duration_s,
                    step=self.step_s,
                )
        return self


class _Spaced(Form):
    """An axis by its ends and the number of its values."""

    start: float
    stop: float
    count: int = Field(ge=2)


def _axis_values(raw: Any) -> Any:
    """Return the values of an axis as a list: as given, or evenly spaced."""
    if isinstance(raw, Mapping):
        spaced = _Spaced.model_validate(dict(raw))
        return np.linspace(spaced.start, spaced.stop, spaced.count).tolist()
    if isinstance(raw, np.ndarray | range | tuple):
        raw = np.asarray(raw).tolist()
    if not isinstance(raw, list):
        raise wrong("must be a list of numbers, or { start = ..., stop = ..., count = ... }")
    if not raw:
        raise wrong("is empty; give it at least one value")
    if len(set(map(str, raw))) < len(raw):
        raise wrong("has a value twice; each value of an axis is one row of lanes")
    return raw


Axis = Annotated[list[float], BeforeValidator(_axis_values)]


class StudyForm(Form):
    """The whole file."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    title: str = ""
    kind: Literal["cell", "motor", "robot"] | None = None
    preset: str = "paper"
    case: str | None = None
    fidelity: Literal["formula", "lut"] = "formula"
    parameters: dict[str, float] = Field(default_factory=dict)
    effects: dict[str, dict[str, float | str]] = Field(default_factory=dict)
    profile: ProfileForm
    axes: dict[str, Axis] = Field(min_length=1)
    metrics: list[str | Metric] = Field(default_factory=list)
    store: list[str] = Field(default_factory=list)
    store_every: int = Field(default=1, ge=1)
    cutoff: CutoffEntry = CutoffEntry()
    folder: Path = Field(default=Path(), exclude=True, repr=False)

    @field_serializer("metrics")
    def _metric_names(self, metrics: list[str | Metric]) -> list[str]:
        return [metric if isinstance(metric, str) else metric.name for metric in metrics]


def complaint(error: ValidationError) -> str:
    """Return the first of pydantic's findings as one sentence that starts with the path of the field."""
    first, *others = error.errors(include_url=False)
    place = ""
    for key in first["loc"]:
        place += f"[{key + 1}]" if isinstance(key, int) else f".{key}"  # a person counts from 1
    what = first["msg"].removeprefix("Input ")
    if first["type"] == "missing":
        what = "is missing; add it"
    elif first["type"] == "too_short":
        what = "must not be empty"
    elif first["type"] != "form":
        what += f", not {_shown(first['input'])}"
    more = f" (and {len(others)} more)" if others else ""
    end = "" if what.endswith((".", "?")) else "."
    return f"{place.removeprefix('.') or 'the study'} {what}{more}{end}"


def _shown(value: Any) -> str:
    """Return a value cut short, in double quotes where it is text."""
    text = str(value) if len(str(value)) <= 60 else f"{str(value)[:60]}..."
    return f'"{text}"' if isinstance(value, str) else text
