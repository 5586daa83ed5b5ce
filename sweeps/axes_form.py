"""The form of what lanes differ in: axes, whose values are all combined, and samples, drawn from ranges."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from jaxmodel.base.forms import Form, wrong
from jaxmodel.sweeps.form import refuse_unquoted_names

Spacing = Literal["linear", "log"]
# A step that ends this share of itself before the stop, or past it, has met it.
_ROUNDING = 1e-9
# Of one axis: each is a line in the study's manifest and a coordinate of its result.
_MOST_VALUES = 1_000_000
# Of a Latin hypercube, which is drawn whole: 0.4 GB.
_MOST_DRAWN = 50_000_000


class _Spaced(Form):
    """An axis by its ends, and the number of its values or the step between them."""

    start: float
    stop: float
    count: int | None = Field(default=None, ge=2, le=_MOST_VALUES)
    step: float | None = Field(default=None, gt=0)
    spacing: Spacing = "linear"

    @model_validator(mode="after")
    def _one_way(self) -> "_Spaced":
        if (self.count is None) == (self.step is None):
            raise wrong("needs either count or step, one of them")
        if self.spacing == "log" and (self.step is not None or min(self.start, self.stop) <= 0.0):
            raise wrong('has spacing = "log", which takes a count, and start and stop greater than 0')
        if not math.isfinite(self.stop - self.start):
            raise wrong("has start and stop too far apart for a number between; correct one of them")
        if self.step is not None and abs(self.stop - self.start) / self.step > _MOST_VALUES:
            raise wrong("has more than {most} values; raise step", most=f"{_MOST_VALUES:,}")
        return self

    @property
    def values(self) -> list[float]:
        if self.step is not None:
            steps = math.floor(abs(self.stop - self.start) / self.step + _ROUNDING)
            return (self.start + math.copysign(self.step, self.stop - self.start) * np.arange(steps + 1)).tolist()
        assert self.count is not None
        spaced = np.geomspace if self.spacing == "log" else np.linspace
        return spaced(self.start, self.stop, self.count).tolist()


def _axis_values(raw: Any) -> Any:
    """Return the values of an axis as a list: as given, or spaced."""
    if isinstance(raw, Mapping):
        raw = _Spaced.model_validate(dict(raw)).values
    if isinstance(raw, np.ndarray | range | tuple):
        raw = np.asarray(raw).tolist()
    if not isinstance(raw, list):
        raise wrong("must be a list of numbers, or { start = ..., stop = ..., count = ... }")
    if not raw:
        raise wrong("is empty; give it at least one value")
    if len(set(map(str, raw))) < len(raw):
        raise wrong("has a value twice; each value of an axis is one row of lanes")
    return raw


def _quoted_axes(raw: Any) -> Any:
    return refuse_unquoted_names(raw, _Spaced.model_fields)


Axis = Annotated[list[float], BeforeValidator(_axis_values)]
Axes = Annotated[dict[str, Axis], BeforeValidator(_quoted_axes)]


class Range(Form):
    """Where a number is drawn from: evenly between low and high, or evenly in its logarithm."""

    low: float
    high: float
    spacing: Spacing = "linear"

    @model_validator(mode="before")
    @classmethod
    def _from_a_pair(cls, raw: Any) -> Any:
        if isinstance(raw, list | tuple):
            if len(raw) != 2:
                raise wrong('must be [low, high], or { low = ..., high = ..., spacing = "log" }')
            return {"low": raw[0], "high": raw[1]}
        return raw

    @model_validator(mode="after")
    def _rises(self) -> "Range":
        if not self.low < self.high:
            raise wrong("has low = {low} and high = {high}; low must be less", low=self.low, high=self.high)
        if self.spacing == "log" and self.low <= 0.0:
            raise wrong('has spacing = "log", which takes a low greater than 0')
        reach = self.high / self.low if self.spacing == "log" else self.high - self.low
        if not math.isfinite(reach):
            raise wrong("has low and high too far apart for a number between; correct one of them")
        return self


def _quoted_ranges(raw: Any) -> Any:
    return refuse_unquoted_names(raw, Range.model_fields)


class SampleForm(Form):
    """`[sample]`: so many lanes with values drawn from ranges, beside the axes or instead of them."""

    method: Literal["sobol", "latin_hypercube", "random"] = "sobol"
    count: int = Field(ge=1, le=2**30)
    seed: int = Field(default=0, ge=0)
    ranges: Annotated[dict[str, Range], BeforeValidator(_quoted_ranges)] = Field(min_length=1)

    @model_validator(mode="after")
    def _fits(self) -> "SampleForm":
        if self.method == "latin_hypercube" and self.count * len(self.ranges) > _MOST_DRAWN:
            raise wrong('has a count too large for a Latin hypercube, which is drawn whole; use method = "sobol"')
        return self
