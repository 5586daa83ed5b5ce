"""The schema of case.toml, and one sentence for each violation.

Pydantic checks the schema; the meaning of values (parameter bounds, column names, files) is checked in `cases`.
"""

import itertools
import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Field, ValidationError, field_validator, model_validator

from jaxmodel.base import toml
from jaxmodel.base.errors import MeasurementError, ParameterError
from jaxmodel.base.forms import Form, complaint, shown, wrong
from jaxmodel.base.units import LARGEST
from jaxmodel.model.parameters import TABLE

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
SD = Positive | None


class KnownEntry(Form):
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
        raise wrong("must be a number or { value = ..., sd = ... }, not {found}", found=shown(raw))


def _finite_numbers(values: list[Any]) -> list[Any]:
    """Check that a list, or a list of lists, holds finite numbers only."""
    for entry in values:
        for number in entry if isinstance(entry, list) else [entry]:
            if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
                raise wrong("must hold finite numbers only, not {found}", found=shown(number))
            if abs(number) > LARGEST:
                raise wrong("holds {found}, larger than any of its kind; correct it or its unit", found=shown(number))
    return values


Axis = Annotated[list[Number], Field(min_length=1)]
Values = Annotated[list[Any], AfterValidator(_finite_numbers)]


def _increasing(name: str, axis: list[float]) -> None:
    for lower, upper in itertools.pairwise(axis):
        if upper <= lower:
            raise wrong(
                "has {name} {upper} after {lower}; sort it to increase, each value once",
                name=name,
                lower=lower,
                upper=upper,
            )


class CurveEntry(Form):
    """A curve by its points; its values and their sd have the names that a case file has for them."""

    value_key: ClassVar[str]
    sd_key: ClassVar[str] = "sd_relative"
    positive: ClassVar[bool] = True

    @property
    def values(self) -> list[Any]:
        """The values, flat or one row per temperature."""
        return getattr(self, self.value_key)

    @property
    def sd(self) -> float | None:
        """Sd of the values: a share of them (`sd_relative`), or in their unit."""
        return getattr(self, self.sd_key)

    def _check_positive(self, values: list[Any]) -> None:
        if self.positive and min(values) <= 0:
            raise wrong(
                "has {key} = {found}; every value must be greater than 0", key=self.value_key, found=min(values)
            )


class TableEntry(CurveEntry):
    """A curve over SOC, shape (soc,), or over SOC and temperature, shape (temperature, soc)."""

    soc: Axis
    temperature_degC: Axis | None = None

    @model_validator(mode="after")
    def _consistent(self) -> "TableEntry":
        key, rows = self.value_key, self.values
        if self.temperature_degC is None:
            if any(isinstance(row, list) for row in rows):
                raise wrong("has rows in {key} but no temperature_degC; add it, one temperature per row", key=key)
            rows = [rows]
        elif len(rows) != len(self.temperature_degC) or not all(isinstance(row, list) for row in rows):
            raise wrong(
                "needs one row of {key} per temperature_degC, {count} rows of {points} numbers in their own brackets",
                key=key,
                count=len(self.temperature_degC),
                points=len(self.soc),
            )
        for row in rows:
            if len(row) != len(self.soc):
                raise wrong(
                    "has {soc} soc and {values} values in {key}; give one value per soc",
                    soc=len(self.soc),
                    values=len(row),
                    key=key,
                )
            self._check_positive(row)
        for name, axis in (("soc", self.soc), ("temperature_degC", self.temperature_degC or [])):
            _increasing(name, axis)
        # A fit to data may be slightly outside 0 to 1; values far outside are percent.
        if self.soc[0] < -0.05 or self.soc[-1] > 1.05:
            raise wrong(
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


class EntropyTable(TableEntry):
    """An entropy coefficient dU/dT [V/K] over SOC."""

    V_per_K: Values
    sd_V_per_K: SD = None
    source: str = ""
    value_key = "V_per_K"
    sd_key = "sd_V_per_K"
    positive = False


class MotorTableEntry(CurveEntry):
    """A curve of a motor over the size of its speed or current."""

    over_key: ClassVar[str]

    @property
    def at(self) -> list[float]:
        """The points, from 0 on."""
        return getattr(self, self.over_key)

    @model_validator(mode="after")
    def _consistent(self) -> "MotorTableEntry":
        over, key, values = self.over_key, self.value_key, self.values
        if any(isinstance(value, list) for value in values) or len(values) != len(self.at):
            raise wrong(
                "has {points} {over} and {values} values in {key}; give one number for each",
                points=len(self.at),
                over=over,
                values=len(values),
                key=key,
            )
        _increasing(over, self.at)
        if self.at[0] < 0.0:
            raise wrong("has {over} {found}; it is a size, from 0 on", over=over, found=self.at[0])
        self._check_positive(values)
        return self


class FrictionTable(MotorTableEntry):
    """The friction [N m] that a motor has beside tau_0, over the size of its speed."""

    speed_rad_s: Axis
    Nm: Values
    sd_Nm: SD = None
    source: str = ""
    over_key = "speed_rad_s"
    value_key = "Nm"
    sd_key = "sd_Nm"
    positive = False


class TorqueFactorTable(MotorTableEntry):
    """The factor on a motor's torque k_tau i_a, over the size of its current."""

    current_A: Axis
    factor: Values
    sd_relative: SD = None
    source: str = ""
    over_key = "current_A"
    value_key = "factor"


CELL_TABLES: dict[str, type[TableEntry]] = {
    "ocv": VoltageTable,
    "R_ints": ResistanceTable,
    "R_TS": ResistanceTable,
    "R_TL": ResistanceTable,
    "C_TS": CapacitanceTable,
    "C_TL": CapacitanceTable,
    "dU_dT": EntropyTable,
}
MOTOR_TABLES: dict[str, type[MotorTableEntry]] = {"friction": FrictionTable, "torque_factor": TorqueFactorTable}


class ParametersEntry(Form):
    """`[parameters]`: tables by their names, and any scalar parameter of the model."""

    model_config = ConfigDict(extra="allow")
    further_keys = TABLE
    __pydantic_extra__: dict[str, KnownEntry] = Field(init=False)  # type: ignore[override]
    ocv: VoltageTable | None = None
    R_ints: ResistanceTable | None = None
    R_TS: ResistanceTable | None = None
    R_TL: ResistanceTable | None = None
    C_TS: CapacitanceTable | None = None
    C_TL: CapacitanceTable | None = None
    dU_dT: EntropyTable | None = None
    friction: FrictionTable | None = None
    torque_factor: TorqueFactorTable | None = None


class EffectEntry(Form):
    """One effect of `[effects]`: numbers by parameter name, each with an sd or without, and a sensor's `column`."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, KnownEntry] = Field(init=False)  # type: ignore[override]
    column: str | None = None


class PositiveEntry(KnownEntry):
    """A number above 0, exact or with a standard deviation."""

    value: Positive


class BrushlessEntry(Form):
    """`[brushless]`: what a current of a brushless motor is, and constants of a phase or between two lines."""

    current: Literal["rms", "peak"]
    R_phase_ohm: PositiveEntry | None = None
    R_line_to_line_ohm: PositiveEntry | None = None
    L_phase_H: PositiveEntry | None = None
    L_line_to_line_H: PositiveEntry | None = None
    KV_rpm_per_V: PositiveEntry | None = None
    Nm_per_A_rms: PositiveEntry | None = None
    Nm_per_A_peak: PositiveEntry | None = None


class SpecimenEntry(Form):
    """`[specimens.NAME]`: what one of several motors or cells has of its own; any further key is a parameter."""

    model_config = ConfigDict(extra="allow")
    further_keys = TABLE
    __pydantic_extra__: dict[str, KnownEntry] = Field(init=False)  # type: ignore[override]
    effects: dict[str, EffectEntry] = Field(default_factory=dict)


class ToleranceEntry(Form):
    """The acceptable error: its rms (`0.01`), or rms and maximum (`{ rms = , max = }`)."""

    rms: Positive
    max: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_bare_number(cls, raw: Any) -> Any:
        if isinstance(raw, dict):
            return raw
        if isinstance(raw, int | float) and not isinstance(raw, bool):
            return {"rms": raw}
        raise wrong("must be a number or { rms = ..., max = ... }, not {found}", found=shown(raw))

    @model_validator(mode="after")
    def _consistent(self) -> "ToleranceEntry":
        if self.max is not None and self.max < self.rms:
            raise wrong(
                "has max {max} below rms {rms}, which is impossible; correct one of them", max=self.max, rms=self.rms
            )
        return self


class RunEntry(Form):
    """One `[[runs]]` block; any further key overrides a parameter of the case for this run."""

    model_config = ConfigDict(extra="allow")
    further_keys = TABLE
    __pydantic_extra__: dict[str, KnownEntry] = Field(init=False)  # type: ignore[override]
    file: str = Field(min_length=1)
    split: Literal["fit", "check"]
    label: str = ""
    specimen: str = ""
    initial_soc: KnownEntry | None = None
    initial_cell_temperature_degC: KnownEntry | None = None
    ambient_degC: Number | None = None
    tolerance: dict[str, ToleranceEntry] = Field(default_factory=dict)


class CutoffEntry(Form):
    """`[cutoff]`: where a discharge ends."""

    soc: float | None = Field(default=None, ge=0, le=1)
    voltage_V: Positive | None = None


class CaseEntry(Form):
    """The whole of case.toml."""

    title: str = ""
    kind: Literal["cell", "motor", "robot"]
    load: Literal["measured", "unknown", "free", "propeller", "gravity", "rolling"] | None = None
    drive: Literal["voltage", "current"] | None = None
    controller: Literal["position", "speed"] | None = None
    brushless: BrushlessEntry | None = None
    preset: str = "paper"
    parameters: ParametersEntry = ParametersEntry()
    effects: dict[str, EffectEntry] = Field(default_factory=dict)
    sensors: dict[str, Positive] = Field(default_factory=dict)
    tolerance: dict[str, ToleranceEntry] = Field(default_factory=dict)
    cutoff: CutoffEntry = CutoffEntry()
    specimens: dict[str, SpecimenEntry] = Field(default_factory=dict)
    runs: list[RunEntry] = Field(default=[], validate_default=True)

    @field_validator("runs", mode="before")
    @classmethod
    def _some_runs(cls, raw: Any) -> Any:
        if not isinstance(raw, list) or not raw:
            raise wrong("must be one [[runs]] block for each CSV file, at least one")
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
    return check_case(toml.parsed(text, where), where)


def check_case(raw: dict[str, Any], where: str) -> CaseEntry:
    """Return the checked form of the content of a case file.

    Raises:
        MeasurementError: a part is missing, unknown or of the wrong form.
        ParameterError: the same, inside `[parameters]`.
    """
    try:
        return CaseEntry.model_validate(raw)
    except ValidationError as error:
        place = error.errors(include_url=False)[0]["loc"]
        match place:
            case ("runs", int(index), *_) if isinstance(raw["runs"][index], dict) and "file" in raw["runs"][index]:
                where += f", the run of {raw['runs'][index]['file']}"
        kind = ParameterError if place[:1] == ("parameters",) else MeasurementError
        raise kind(f"{where}: {complaint(error, raw, 'the file')}") from error
