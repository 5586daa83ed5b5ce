"""The schema of case.toml, and one sentence for each violation.

Pydantic checks the schema; the meaning of values (parameter bounds, column names, files) is checked in `cases`.
"""

import itertools
import math
import tomllib
from collections.abc import Collection
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from jaxmodel.errors import MeasurementError, ParameterError, UserError, nearest
from jaxmodel.parameters import TABLE


def _wrong(sentence: str, **details: Any) -> PydanticCustomError:
    return PydanticCustomError("form", sentence, details)  # type: ignore[arg-type]


class _Entry(BaseModel):
    """A table of the file. An unknown key is an error that names the nearest known one."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)
    further_keys: ClassVar[Collection[str]] = ()

    @model_validator(mode="before")
    @classmethod
    def _reject_unknown_keys(cls, raw: Any) -> Any:
        known = (*cls.model_fields, *cls.further_keys)
        for key in raw if isinstance(raw, dict) else ():
            if key not in known:
                hint = nearest(key, known) or (f" It knows {', '.join(known)}." if len(known) < 10 else " Remove it.")
                raise _wrong("knows no '{key}'.{hint}", key=key, hint=hint)
        return raw


SD = Annotated[float | None, Field(gt=0)]


class KnownEntry(_Entry):
    """A number, exact (`5.2`) or with a standard deviation (`{ value = 5.2, sd = 0.15 }`)."""

    value: float
    sd: SD = None
    source: str = ""

    @model_validator(mode="before")
    @classmethod
    def _from_bare_number(cls, raw: Any) -> Any:
        if isinstance(raw, dict):
            return raw
        if isinstance(raw, int | float) and not isinstance(raw, bool):
            return {"value": raw}
        raise _wrong("must be a number or { value = ..., sd = ... }, not {found}", found=_toml(raw))


def _finite_numbers(values: list[Any]) -> list[Any]:
    """Check that a list, or a list of lists, holds finite numbers only."""
    for entry in values:
        for number in entry if isinstance(entry, list) else [entry]:
            if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
                raise _wrong("must hold finite numbers only, not {found}", found=_toml(number))
    return values


Axis = Annotated[list[float], Field(min_length=1)]
Values = Annotated[list[Any], AfterValidator(_finite_numbers)]


class TableEntry(_Entry):
    """A curve over SOC, shape (soc,), or over SOC and temperature, shape (temperature, soc)."""

    soc: Axis
    temperature_degC: Axis | None = None
    value_key: ClassVar[str]
    sd_key: ClassVar[str] = "sd_relative"
    positive: ClassVar[bool] = True

    @property
    def values(self) -> list[Any]:
        """The values, flat or one row per temperature."""
        return getattr(self, self.value_key)

    @property
    def sd(self) -> float | None:
        """Sd of the values: V of an open-circuit voltage, a share of the value of all others."""
        return getattr(self, self.sd_key)

    @model_validator(mode="after")
    def _consistent(self) -> "TableEntry":
        key, rows = self.value_key, self.values
        if self.temperature_degC is None:
            if any(isinstance(row, list) for row in rows):
                raise _wrong("has rows in {key} but no temperature_degC; add it, one temperature per row", key=key)
            rows = [rows]
        elif len(rows) != len(self.temperature_degC) or not all(isinstance(row, list) for row in rows):
            raise _wrong(
                "needs one row of {key} per temperature_degC, {count} rows of {points} numbers in their own brackets",
                key=key,
                count=len(self.temperature_degC),
                points=len(self.soc),
            )
        for row in rows:
            if len(row) != len(self.soc):
                raise _wrong(
                    "has {soc} soc and {values} values in {key}; give one value per soc",
                    soc=len(self.soc),
                    values=len(row),
                    key=key,
                )
            if self.positive and min(row) <= 0:
                raise _wrong("has {key} = {found}; every value must be greater than 0", key=key, found=min(row))
        for name, axis in (("soc", self.soc), ("temperature_degC", self.temperature_degC or [])):
            for lower, upper in itertools.pairwise(axis):
                if upper <= lower:
                    raise _wrong(
                        "has {name} {upper} after {lower}; sort it to increase, each value once",
                        name=name,
                        lower=lower,
                        upper=upper,
                    )
        # A fit to data may be slightly outside 0 to 1; values far outside are percent.
        if self.soc[0] < -0.05 or self.soc[-1] > 1.05:
            raise _wrong(
                "has soc from {lower} to {upper}; it is a fraction, 0 to 1", lower=self.soc[0], upper=self.soc[-1]
            )
        return self


class VoltageTable(TableEntry):
    """An open-circuit voltage [V] over SOC."""

    voltage_V: Values
    sd_V: SD = None
    source: str = ""
    value_key = "voltage_V"
    sd_key = "sd_V"
    positive = False


class ResistanceTable(TableEntry):
    """A resistance [ohm] over SOC."""

    ohm: Values
    sd_relative: SD = None
    source: str = ""
    value_key = "ohm"


class CapacitanceTable(TableEntry):
    """A capacitance [F] over SOC."""

    farad: Values
    sd_relative: SD = None
    source: str = ""
    value_key = "farad"


class ParametersEntry(_Entry):
    """`[parameters]`: tables by their names, and any scalar parameter of the model."""

    model_config = ConfigDict(extra="allow")
    further_keys = TABLE
    __pydantic_extra__: dict[str, KnownEntry] = Field(init=False)
    ocv: VoltageTable | None = None
    R_ints: ResistanceTable | None = None
    R_TS: ResistanceTable | None = None
    R_TL: ResistanceTable | None = None
    C_TS: CapacitanceTable | None = None
    C_TL: CapacitanceTable | None = None


class EffectEntry(_Entry):
    """One effect of `[effects]`: numbers by parameter name, each with an sd or without, and a sensor's `column`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, KnownEntry] = Field(init=False)
    column: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _reject_unknown_keys(cls, raw: Any) -> Any:
        return raw  # parameters of effects are checked against the catalogue


class ToleranceEntry(_Entry):
    """The acceptable error: its rms (`0.01`), or rms and maximum (`{ rms = , max = }`)."""

    rms: float = Field(gt=0)
    max: float | None = Field(default=None, gt=0)

    @model_validator(mode="before")
    @classmethod
    def _from_bare_number(cls, raw: Any) -> Any:
        if isinstance(raw, dict):
            return raw
        if isinstance(raw, int | float) and not isinstance(raw, bool):
            return {"rms": raw}
        raise _wrong("must be a number or { rms = ..., max = ... }, not {found}", found=_toml(raw))

    @model_validator(mode="after")
    def _consistent(self) -> "ToleranceEntry":
        if self.max is not None and self.max < self.rms:
            raise _wrong(
                "has max {max} below rms {rms}, which is impossible; correct one of them", max=self.max, rms=self.rms
            )
        return self


class RunEntry(_Entry):
    """One `[[runs]]` block; any further key overrides a parameter of the case for this run."""

    model_config = ConfigDict(extra="allow")
    further_keys = TABLE
    __pydantic_extra__: dict[str, KnownEntry] = Field(init=False)
    file: str = Field(min_length=1)
    split: Literal["fit", "check"]
    label: str = ""
    initial_soc: KnownEntry | None = None
    initial_cell_temperature_degC: KnownEntry | None = None
    ambient_degC: float | None = None
    tolerance: dict[str, ToleranceEntry] = {}


class CutoffEntry(_Entry):
    """`[cutoff]`: where a discharge ends."""

    soc: float | None = Field(default=None, ge=0, le=1)
    voltage_V: float | None = Field(default=None, gt=0)


class CaseEntry(_Entry):
    """The whole of case.toml."""

    title: str = ""
    kind: Literal["cell", "motor", "robot"]
    preset: str = "paper"
    parameters: ParametersEntry = ParametersEntry()
    effects: dict[str, EffectEntry] = {}
    sensors: dict[str, Annotated[float, Field(gt=0)]] = {}
    tolerance: dict[str, ToleranceEntry] = {}
    cutoff: CutoffEntry = CutoffEntry()
    runs: list[RunEntry] = Field(default=[], validate_default=True)

    @field_validator("runs", mode="before")
    @classmethod
    def _some_runs(cls, raw: Any) -> Any:
        if not isinstance(raw, list) or not raw:
            raise _wrong("must be one [[runs]] block for each CSV file, at least one")
        return raw


def parse_case(text: str, where: str) -> CaseEntry:
    """Return the checked form of a case file.

    Args:
        text: the TOML.
        where: name of the file in messages.

    Raises:
        MeasurementError: the text is not TOML, or a part of it is missing, unknown or of the wrong form.
        ParameterError: the same, inside `[parameters]`.
    """
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        what, _, place = str(error).removesuffix(")").partition(" (at ")
        raise MeasurementError(f"{where}, {place}: this is not valid TOML ({what}); correct it there.") from error
    return check_case(raw, where)


def check_case(raw: dict[str, Any], where: str) -> CaseEntry:
    """Return the checked form of the content of a case file.

    Raises:
        MeasurementError: a part is missing, unknown or of the wrong form.
        ParameterError: the same, inside `[parameters]`.
    """
    try:
        return CaseEntry.model_validate(raw)
    except ValidationError as error:
        raise _user_error(error, raw, where) from error


def _user_error(error: ValidationError, raw: dict[str, Any], where: str) -> UserError:
    """Return the first error of pydantic as a sentence, with the number of others."""
    first, *others = error.errors(include_url=False)
    place = ""
    for step in first["loc"]:
        place += f"[{step + 1}]" if isinstance(step, int) else f".{step}"  # counted from 1
    match first["loc"]:
        case ("runs", int(index), *_) if isinstance(raw["runs"][index], dict) and "file" in raw["runs"][index]:
            where += f", the run of {raw['runs'][index]['file']}"
    sentence = f"{where}: {place.removeprefix('.') or 'the file'} {_complaint(first)}"
    if others:
        sentence += f" (and {len(others)} more error{'s' if len(others) > 1 else ''})"
    sentence += "" if sentence.endswith((".", "?")) else "."
    return ParameterError(sentence) if first["loc"][:1] == ("parameters",) else MeasurementError(sentence)


def _complaint(error: ErrorDetails) -> str:
    """Return what one field must be."""
    found, context = _toml(error["input"]), error.get("ctx", {})
    match error["type"]:
        case "form":
            return error["msg"]
        case "missing":
            return "is missing; add it"
        case "literal_error":
            return f"must be {context['expected'].replace(chr(39), chr(34))}, not {found}"
        case "float_type":
            return f"must be a number{', without quotes' if isinstance(error['input'], str) else ''}, not {found}"
        case "finite_number":
            return f"must be a finite number, not {found}"
        case "greater_than":
            return f"must be greater than {context['gt']:g}, not {found}; correct it or leave it out"
        case "greater_than_equal":
            return f"must be at least {context['ge']:g}, not {found}"
        case "less_than_equal":
            return f"must be at most {context['le']:g}, not {found}"
        case "string_type":
            return f"must be text in quotes, not {found}"
        case "too_short" | "string_too_short":
            return "must not be empty"
        case "list_type":
            return f"must be a list in brackets, not {found}"
        case "model_type" | "dict_type":
            return f"must be a table, {{ name = value }}, not {found}"
    return f"is wrong: {error['msg']}"


def _toml(value: Any) -> str:
    """Return a value as written in the file, shortened."""
    text = {True: "true", False: "false"}[value] if isinstance(value, bool) else str(value)
    text = text if len(text) <= 60 else f"{text[:60]}..."
    return f'"{text}"' if isinstance(value, str) else text
