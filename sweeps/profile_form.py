"""The form of `[profile]`: constants, pulse trains, a CSV or drive cycle, or a mission of segments."""

import math
from typing import Annotated

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from jaxmodel.base.forms import Form, wrong
from jaxmodel.case.forms import Number
from jaxmodel.model.profile import MOST_ROWS
from jaxmodel.sweeps.form import refuse_unquoted_names


class Inputs(Form):
    """A table whose further keys are constant inputs."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float] = Field(init=False)  # type: ignore[override]

    @property
    def inputs(self) -> dict[str, float]:
        """The constant inputs by name."""
        return dict(self.__pydantic_extra__)


class PulsesForm(Form):
    """A train of pulses: `high` for `on_s` at the start of every `period_s`, from `start_s` on; `low` otherwise."""

    high: float
    low: float = 0.0
    on_s: float = Field(gt=0)
    period_s: float = Field(gt=0)
    start_s: float = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _on_within_period(self) -> "PulsesForm":
        if self.on_s > self.period_s:
            raise wrong("has on_s = {on} and period_s = {period}; a pulse is no longer than its period",
                        on=self.on_s, period=self.period_s)  # fmt: skip
        return self


class SegmentForm(Inputs):
    """A part of a mission: its length and its inputs; `speed_m_s` of a robot stands for the duty that holds it."""

    duration_s: float = Field(gt=0)
    speed_m_s: float | None = None


class ProfileForm(Inputs):
    """`[profile]`: one of duration_s, csv and mission; any further key is a constant input."""

    csv: str | None = None
    duration_s: float | None = Field(default=None, gt=0)
    mission: list[SegmentForm] = Field(default_factory=list)
    step_s: float = Field(default=1.0, gt=0)
    pulses: dict[str, PulsesForm] = Field(default_factory=dict)
    repeat: int = Field(default=1, ge=1)
    scale: Annotated[dict[str, Number], BeforeValidator(refuse_unquoted_names)] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_source(self) -> "ProfileForm":
        sources = [self.csv is not None, self.duration_s is not None, bool(self.mission)]
        if sum(sources) != 1:
            raise wrong("needs one of duration_s (with constant inputs), csv and mission")
        if self.scale and self.csv is None:
            raise wrong("has a scale and no csv; a scale multiplies columns of a csv")
        if self.pulses and self.duration_s is None:
            raise wrong("has pulses and no duration_s; pulses run for a duration")
        if self.repeat > 1 and self.duration_s is not None:
            raise wrong("has repeat and duration_s; a csv and a mission are repeated, a duration may be made longer")
        if "step_s" in self.model_fields_set and self.csv is not None:
            raise wrong("has step_s and csv; the steps of a csv are its rows")
        self._in_steps(self.duration_s, "duration_s", "the duration")
        for number, segment in enumerate(self.mission, start=1):
            self._in_steps(segment.duration_s, f"mission[{number}].duration_s", "a segment")
        for name, pulses in self.pulses.items():
            for key in ("on_s", "period_s", "start_s"):
                self._in_steps(getattr(pulses, key), f"pulses.{name}.{key}", "each time of a pulse", least=0)
        self._fits()
        return self

    def _fits(self) -> None:
        seconds = self.duration_s or self.repeat * sum(segment.duration_s for segment in self.mission)
        if (rows := seconds / self.step_s) > MOST_ROWS:
            raise wrong(
                "has {rows} rows of {step} s, for which there is no memory; at most {most} fit, so shorten it or "
                "lengthen step_s",
                rows=f"{rows:.3g}", step=self.step_s, most=f"{MOST_ROWS:,}",
            )  # fmt: skip

    def _in_steps(self, value: float | None, key: str, what: str, least: int = 1) -> None:
        if value is None:
            return
        steps = value / self.step_s
        whole = math.isfinite(steps) and math.isclose(steps, round(steps), rel_tol=1e-9, abs_tol=1e-9)
        if not whole or round(steps) < least:
            raise wrong(
                "has {key} = {value} and step_s = {step}; {what} must be a whole number of steps",
                key=key, value=value, step=self.step_s, what=what,
            )  # fmt: skip
