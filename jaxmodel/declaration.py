"""How a parameter is declared: as a field of a module, with its unit, meaning, bounds and source beside it.

The base model's table and every effect declare theirs in this one way. From the declarations come the validation
messages, the vocabulary of case files, the transforms and priors of the fits and the pages of the docs.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.errors import ParameterError

Scalar = Float[Array, ""]
Transform = Literal["log", "identity"]
# Units whose thousandth people write.
_IN_MILLI = ("A h", "V", "A", "ohm", "N m", "N m/A", "H")


@dataclasses.dataclass(frozen=True)
class ParameterInfo:
    """What is known of one parameter, beside its value."""

    name: str
    unit: str
    meaning: str
    default: float
    symbol: str = ""
    equation: str = ""
    lower: float = -math.inf
    upper: float = math.inf
    transform: Transform = "identity"
    source: str = "assumed"
    null: float | None = None
    typical: tuple[float, float] | None = None
    shape_grid: tuple[float, ...] = ()
    whole: bool = False
    scales: str = ""

    def check(self, value: Any, where: str) -> float:
        """Return `value` as a float; raise ParameterError where it is not a number within the bounds."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ParameterError(f"{where}: '{self.name}' must be a number, not {value!r}; write it without quotes.")
        if not math.isfinite(value) or not self.lower <= value <= self.upper:
            raise ParameterError(
                f"{where}: '{self.name}' = {value:g} is outside its range {self.lower:g} to {self.upper:g}"
                f"{' ' + self.unit if self.unit else ''}; {self._mend(value)}."
            )
        if self.whole and value != round(value):
            raise ParameterError(f"{where}: '{self.name}' = {value:g} counts things; give a whole number.")
        return float(value)

    def _mend(self, value: float) -> str:
        """Return what brings a value of another unit within the bounds, or that it is to be corrected."""
        mends = [(value / 1000.0, f"if it is in m{self.unit}, multiply it by 0.001")] if self.unit in _IN_MILLI else []
        if self.unit == "degC":
            mends = [(value - 273.15, "if it is in kelvin, subtract 273.15")]
        if not self.unit and self.upper < 2.0:
            mends = [(value / 100.0, "if it is in percent, divide it by 100")]
        fitting = [todo for mended, todo in mends if self.lower <= mended <= self.upper]
        return fitting[0] if fitting and math.isfinite(value) else "correct the value or its unit"


def parameter(
    default: float,
    *,
    unit: str,
    meaning: str,
    symbol: str = "",
    equation: str = "",
    lower: float = -math.inf,
    upper: float = math.inf,
    transform: Transform = "identity",
    source: str = "assumed",
    null: float | None = None,
    typical: tuple[float, float] | None = None,
    shape_grid: tuple[float, ...] = (),
    whole: bool = False,
    scales: str = "",
) -> Any:
    """Declare a parameter as a field of a module, with what the table says of it.

    Args:
        default: the value where nobody gives one; of an effect, a middling one.
        unit: SI, or degC, A h and months where the name says so; "" is a pure number.
        meaning: one line for the table.
        symbol: the paper's symbol.
        equation: the paper's equation number.
        lower: smallest value that makes sense.
        upper: largest value that makes sense.
        transform: "log" where only positive values make sense and fits run on the logarithm.
        source: where the default comes from, or "assumed".
        null: of an effect's amplitude, the value at which the model is the base model, to the bit.
        typical: of an effect's parameter, the range that a designer meets often.
        shape_grid: of a parameter that has no derivative at the effect's null, the values to be tried.
        whole: True of a number of things.
        scales: how `typical` and `shape_grid` grow with the cell or motor, as in "1/capacity"; "" where they do not.
    """
    info = {
        "unit": unit,
        "meaning": meaning,
        "default": default,
        "symbol": symbol,
        "equation": equation,
        "lower": lower,
        "upper": upper,
        "transform": transform,
        "source": source,
        "null": null,
        "typical": typical,
        "shape_grid": shape_grid,
        "whole": whole,
        "scales": scales,
    }
    return eqx.field(default=default, converter=_as_array, metadata={"parameter": info})


def _as_array(value: Any) -> Any:
    """Make numbers float64 arrays; leave alone what a transformation put there (tracers, None, axes)."""
    return jnp.asarray(value, dtype=float) if isinstance(value, int | float) else value


def describe(module: type[eqx.Module] | eqx.Module) -> dict[str, ParameterInfo]:
    """Return the table of the parameters that a module declares, by name, in order of declaration."""
    return {
        field.name: ParameterInfo(name=field.name, **field.metadata["parameter"])
        for field in dataclasses.fields(module)  # type: ignore[arg-type]
        if "parameter" in field.metadata
    }
