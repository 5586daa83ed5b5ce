"""Remarks: sentences beside a result, each with what a program acts on. `CODES` lists all that there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class Code(NamedTuple):
    """What the remarks of one code have in common.

    Attributes:
        meaning: what they say.
        subject: what their subject is; "" where they have none.
        numbers: names of their numbers, in the unit of the subject where none is in the name; a name in angle brackets
            stands for several.
    """

    meaning: str
    subject: str = ""
    numbers: tuple[str, ...] = ()


_STATED = ("value", "stated", "stated_sd", "off_sd")

CODES: Mapping[str, Code] = {
    # of the data
    "not_likely": Code("something is not likely, such as a wrong unit, and yet can be", "column or parameter"),
    "sensor_stuck": Code(
        "a sensor repeats one reading under load; these readings are excluded",
        "column@run",
        ("value", "from_s", "to_s"),
    ),
    "voltage_late": Code(
        "a voltage comes late in one run alone; it was moved to its current", "column@run", ("value", "steps")
    ),
    "sensor_saturated": Code(
        "a sensor repeats its largest or smallest reading; these readings are excluded", "column", ("limit", "readings")
    ),
    "outliers_excluded": Code(
        "outliers are excluded; value and time are those of the first",
        "column",
        ("readings", "share", "value", "time_s"),
    ),
    "outliers_kept": Code(
        "readings look like outliers, and are too many for that; the share is that of the first run with some",
        "column",
        ("readings", "share"),
    ),
    "input_outliers_replaced": Code(
        "no reading followed an outlier of an input: it is taken as its neighbours",
        "column@run",
        ("readings", "value", "time_s"),
    ),
    # of what a case states
    "nothing_held_out": Code("no run is a check run"),
    "paper_formulas": Code("curves of a cell are those of the paper's cell, because none are stated", "tables"),
    "noise_not_stated": Code("no noise is stated; it is estimated", "column", ("sd",)),
    "noise_contradicted": Code(
        "the readings scatter otherwise than is stated; their scatter is used", "column", ("sd", "stated_sd")
    ),
    "readings_filtered": Code(
        "the readings scatter far less than is stated: the log was filtered", "column", ("stated_sd",)
    ),
    "start_speed_contradicted": Code(
        "a motor's speed at the first row is not the stated one", "column@run", ("value", "stated")
    ),
    "start_speed_missing": Code(
        "a motor turns at the first row, and no speed at the start is stated", "column", ("<run>",)
    ),
    "start_wrong": Code(
        "the first readings of a check run require another start than is stated, and than the limit allows",
        "run",
        ("off_sd", "limit_sd"),
    ),
    "start_moved": Code("the fit moved the start of a run far from what is stated", "parameter@run", _STATED),
    "far_from_stated": Code("a number was fitted far from what is stated", "parameter, or parameter@run", _STATED),
    "run_outside_fitted": Code(
        "a check run is outside the conditions of the fit runs", "condition@run", ("low", "high", "low_fit", "high_fit")
    ),
    # of a fit
    "no_minimum": Code("the fit did not reach a minimum", "", ("promise", "objective")),
    "nothing_moves": Code("no unknown moves any reading of the fit runs"),
    "outside_usual_range": Code(
        "a number of an effect is outside its usual range", "effect.parameter", ("value", "low", "high")
    ),
    "better_as_stated": Code(
        "check runs are predicted no better than by the base model as stated; numbers are RMS errors of both",
        "columns",
        ("<column>", "<column>_stated"),
    ),
    "stated_model_stays": Code(
        "what fits the fit runs better predicts the check runs worse: the case stays as stated",
        "labels that were tried",
    ),
    # of first parameters
    "not_parameterised": Code("a part of a robot could not be parameterised", "cells or motors"),
    "age_included": Code("the numbers hold the age of the cell: it counts from here", "parameters of age"),
    "start_counted_back": Code(
        "the charge counts beyond full or empty: the start is counted back from there",
        "parameter@run",
        ("value", "stated"),
    ),
    "refit_error": Code("RMS that the joint refit leaves of the run of which it is largest", "column@run", ("rms",)),
    "written_approximately": Code("the written case differs from the fitted model, and in what", "", ()),
    "readings_correlated": Code("one in so many readings counts", "column", ("readings",)),
    "torque_error": Code("RMS that the torque balance leaves", "", ("rms_Nm",)),
    "runs_contradict": Code(
        "one motor of one fit run is fitted, one of all is not; shares of the scatter that are left",
        "runs",
        ("alone", "together"),
    ),
    "never_turns": Code("no run shows the motor turning: friction and inertia are not extracted"),
    # of a simulation
    "reached_cutoff": Code("a simulation ended before its run", "run", ("time_s",)),
    "not_finite": Code("a simulation has numbers that are not finite", "run"),
    "impossible": Code("a simulation goes where nothing can be; numbers are largest sizes", "run", ("<column>",)),
    "outside_valid_range": Code(
        "a simulation is outside the valid range of the cell's equations", "run", ("rows", "time_s")
    ),
}


class Remark(str):
    """A sentence beside a result, and what it is about; it is printed, compared and written as the sentence.

    Attributes:
        code: one of `CODES`; "" in a file that has the sentence alone.
        subject: a column, run, parameter or effect; `name@run` for that of one run, and several after commas.
        numbers: of the sentence, by the names that its code has.
    """

    code: str
    subject: str
    numbers: Mapping[str, float]

    def __new__(cls, sentence: str, code: str = "", subject: str = "", /, **numbers: float) -> Remark:
        """Return a remark; `numbers` may have any names."""
        made = super().__new__(cls, sentence)
        made.code, made.subject = code, subject
        made.numbers = {name: float(value) for name, value in numbers.items()}
        return made

    def record(self) -> dict[str, Any]:
        """Return code, subject, numbers and text, as files have them."""
        return {"code": self.code, "subject": self.subject, "numbers": dict(self.numbers), "text": str(self)}
