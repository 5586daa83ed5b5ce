"""Declaration of parameters: fields of a module with unit, meaning, bounds and source.

The base model and all effects declare their parameters in this way. The declarations define validation messages, the
keys of case files, the transforms and priors of fits, and tables of the docs.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.base.errors import ParameterError

Scalar = Float[Array, ""]
"""One number of a model: an array without axes, of one lane."""
Transform = Literal["log", "identity"]
# Units whose thousandth people write.
_IN_MILLI = ("A h", "V", "A", "ohm", "N m", "N m/A", "H")


@dataclasses.dataclass(frozen=True)
class ParameterInfo:
    """The declaration of one parameter, without its value."""

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
        """Return `value` as a float; raise ParameterError if it is not a number within the bounds."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ParameterError(f"{where}: '{self.name}' must be a number, not {value!r}; write it without quotes.")
        if not math.isfinite(value) or not self.lower <= value <= self.upper:
            raise ParameterError(
                f"{where}: '{self.name}' = {value:g} is outside its range {self.lower:g} to {self.upper:g}"
                f"{' ' + self.unit if self.unit else ''}; {self._mend(value)}."
            )
        if self.whole and value != round(value):
            raise ParameterError(f"{where}: '{self.name}' = {value:g} is a count; give a whole number.")
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
    """Declare a parameter as a field of a module.

    Args:
        default: the default value; for an effect, a typical one.
        unit: SI, or degC, A h and months according to the name; "" for a pure number.
        meaning: one line for the table.
        symbol: the paper's symbol.
        equation: the paper's equation number.
        lower: smallest valid value.
        upper: largest valid value.
        transform: "log" for positive parameters that are fitted on the logarithm.
        source: of the default, or "assumed".
        null: value of an effect's amplitude at which the model is exactly the base model.
        typical: usual range of an effect's parameter.
        shape_grid: values to be tried for a parameter without derivative at the effect's null.
        whole: True for a count.
        scales: how `typical` and `shape_grid` scale with the cell or motor, as in "1/capacity"; "" if they do not.

    Example:
        >>> from jaxmodel import Effect, Scalar, parameter
        >>> class Leak(Effect):
        ...     name = "leak"
        ...     R: Scalar = parameter(200.0, unit="ohm", meaning="leakage resistance", lower=1.0)
        >>> float(Leak().R)
        200.0
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
    """Convert numbers to float64 arrays; leave tracers, None and axes unchanged."""
    return jnp.asarray(value, dtype=float) if isinstance(value, int | float) else value


def describe(module: type[eqx.Module] | eqx.Module) -> dict[str, ParameterInfo]:
    """Return the table of the parameters that a module declares, by name, in order of declaration."""
    return {
        field.name: ParameterInfo(name=field.name, **field.metadata["parameter"])
        for field in dataclasses.fields(module)  # type: ignore[arg-type]
        if "parameter" in field.metadata
    }
