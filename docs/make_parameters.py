"""Write the pages that are tables of the code: `python docs/make_parameters.py`."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from jaxmodel.base.remark import CODES
from jaxmodel.effects import CATALOGUE, battery, drive, motion, sensors
from jaxmodel.effects.controllers import SERVO
from jaxmodel.effects.curves import CURVES
from jaxmodel.effects.differences import DIFFERENCES
from jaxmodel.effects.shifts import SHIFTS
from jaxmodel.effects.specimen import SIZES
from jaxmodel.fit.settings import table as settings_table
from jaxmodel.model.declaration import ParameterInfo, describe
from jaxmodel.model.parameters import TABLE
from jaxmodel.model.ports import PORTS, Effect

HERE = Path(__file__).parent
NOTE = "<!-- Made by make_parameters.py from the code; do not edit. -->\n"
GROUPS = {
    battery: (
        "Cell and pack",
        "T is the cell's temperature where `self_heating` is on, else the ambient.",
    ),
    drive: (
        "Motor, gear, bridge, electronics",
        "T_w is the winding's temperature, T_c the case's, w the rotor's speed.",
    ),
    motion: (
        "Motion both ways",
        "Tried where a run reverses four times and more, in rows of 50 ms at most; a case states `flexible_shaft`.",
    ),
    sensors: (
        "Sensors",
        "Each fault except `clock_shift` acts on one `column`. The faults of the load torque and of the chamber have a "
        "fixed column. If the column is a measured input, the fault is subtracted from the measured values.",
    ),
}


def parameters_page() -> str:
    """Return the page of the base model's parameters."""
    rows = [
        (
            f"`{info.name}`",
            info.symbol,
            info.equation,
            info.meaning,
            info.unit or "-",
            f"{info.default:g}",
            _range(info),
            "log" if info.transform == "log" else "",
            info.source,
        )
        for info in TABLE.values()
    ]
    head = ("name", "symbol", "eq.", "meaning", "unit", "default", "bounds", "fitted", "source of the default")
    return f"""{NOTE}
# Parameters

Every parameter of the base model, with the name that case files, studies and `--at` use. Equation numbers are those of
[the model](model.md). `fitted` is `log` if a fit uses the logarithm, so that the parameter stays positive. A default
with the source "assumed" was not measured: state your own value.

A value outside its bounds is refused. The parameters of effects are in [the catalogue of effects](effects.md). Their
names have the form `effect.parameter`.

{_table(head, rows)}
The cell also has six curves over state of charge: `ocv`, `R_ints`, `R_TS`, `C_TS`, `R_TL`, `C_TL`. They are the
formulas of the paper unless a case gives tables; see [cases](cases.md#tables).
"""


def effects_page() -> str:
    """Return the page of the catalogue of effects."""
    parts = [
        f"""{NOTE}
# Catalogue of effects

{len(CATALOGUE)} effects that a model may be missing. An effect is off unless a case, a study or a diagnosis turns it
on. At its null the model equals the base model bit for bit. An effect acts on [ports](your_own_effect.md#ports), the
named relations of the model.

The usual range is what occurs often in practice. A diagnosis uses it as the prior, with its ends at one standard
deviation. A value in a file may lie anywhere within the bounds. A parameter without a null sets the shape of the
effect; if "tried at" has values, a diagnosis tries each of them. `self_heating` has no null: it is on or off.

Ranges and "tried at" are for the paper's cell, 5.2 A h, and its motor, a maxon RE50 at 24 V. If "scales as" names a
size, they scale with your cell or motor by the ratio of its size to the paper's:

{_table(("size", "what", "from"), _sizes())}
"""
    ]
    for module, (title, note) in GROUPS.items():
        classes = [cls for cls in CATALOGUE.values() if cls.__module__ == module.__name__]
        parts.append(f"## {title}\n\n{note}\n\n{_effects(classes)}\n{_effect_parameters(classes)}")
    parts.append(
        f"""## Curves

Curves are not in the catalogue: a case does not name them. They correct relations of the model. They are piecewise
linear between knots and constant beyond the ends; the knots are shares of the range of the variable that the fit runs
cover. [A diagnosis](discrepancy.md) has them in every model and finds the size of each, up to the largest, from the
evidence. It reports a table of the case as "wrong by this much at this point". A value without a unit is the logarithm
of a factor. A single knot is a number that does not depend on the variable.

{_effects(CURVES.values())}
{_curve_values()}"""
    )
    parts.append(
        f"""## Servo

Not in the catalogue: they belong to [a case that states its drive](cases.md#the-drive), and no diagnosis looks for
them. Gains are those of a drive that sets the current (A) or the voltage (V).

{_effects(SERVO.values())}
{_effect_parameters(SERVO.values())}"""
    )
    parts.append(
        f"""## Differences

Differences are not in the catalogue either. A difference is what one of several motors or cells of a case has of its
own, in all of its runs ([Several motors or cells](cases.md#several-motors-or-cells)).

{_effects(DIFFERENCES.values())}
{_effect_parameters(DIFFERENCES.values())}
## Shifts

Shifts are not in the catalogue either. A shift is one parameter that differs in a single run, for example a contact
resistance, the air flow around the cell, or the zero point of a sensor.

{_effects(SHIFTS.values())}
{_effect_parameters(SHIFTS.values())}"""
    )
    return "\n".join(parts)


def settings_page() -> str:
    """Return the page of the constants of a diagnosis."""
    rows = [(f"`{row['name']}`", row["value"], row["meaning"], row["source"]) for row in settings_table()]
    return f"""{NOTE}
# Settings of a diagnosis

The constants of [a diagnosis](../discrepancy.md) that may be changed, with their source. Those of the fit and of the
search itself stand in `jaxmodel/fit` and `jaxmodel/diagnosis/search.py`. An investigation takes others:

```python
import dataclasses

from jaxmodel import SETTINGS, Investigation, read_case

settings = dataclasses.replace(SETTINGS, noise_contradiction=2.0)
investigation = Investigation(read_case("examples/samsung_30q"), settings=settings)
```

{_table(("constant", "value", "meaning", "source"), rows)}"""


def remarks_page() -> str:
    """Return the page of the codes of remarks."""
    rows = [
        (f"`{name}`", code.meaning, code.subject or "-", ", ".join(f"`{one}`" for one in code.numbers) or "-")
        for name, code in CODES.items()
    ]
    return f"""{NOTE}
# Codes of remarks

A remark is a sentence on the data or the fit. `findings` in [`answer.json`](../discrepancy.md#answerjson) and in
`identify.json` have each with its code, subject and numbers, so that a program can act on it; `remarks` has the
sentences alone, in the same order. In Python, each of the `remarks` of a result is a `str` with the same as attributes:
`[one for one in diagnosis.remarks if one.code == "noise_contradicted"]`.

`name@run` is a column, parameter or condition of one run. Several subjects are separated by commas. A number is in the
unit of its subject where its name has none; `off_sd` and `limit_sd` count standard deviations. A name in angle brackets
stands for a number for each run or column. The code of a remark that an older version has written is `""`.

{_table(("code", "what is said", "subject", "numbers"), rows)}"""


def _sizes() -> list[tuple[str, str, str]]:
    of = {
        "capacity": "`capacity_Ah`",
        "surface": "`capacity_Ah` to the power 2/3",
        "supply": "`n_series`, `nominal_cell_voltage_V`; for a motor alone the voltage in its runs",
        "speed": "supply, `k_tau`",
        "motor_current": "`R_0`, `R_wc` + `R_ca`",
        "torque": "`k_tau`, motor_current",
    }
    return [
        (f"`{name}`", (inspect.getdoc(size) or "").split("\n")[0].rstrip("."), of[name]) for name, size in SIZES.items()
    ]


def _effects(classes: Iterable[type[Effect]]) -> str:
    rows = [
        (
            f"`{cls.name}`",
            re.split(r":|\n\n", inspect.getdoc(cls) or "")[0].rstrip("."),
            f"`{cls.equation}`",
            ", ".join(cls.kinds),
            ", ".join(f"`{port}`" for port in PORTS if hasattr(cls, port)),
        )
        for cls in classes
    ]
    return _table(("effect", "what", "equation", "kinds", "ports"), rows)


def _effect_parameters(classes: Iterable[type[Effect]]) -> str:
    rows = [
        (
            f"`{cls.name}.{info.name}`",
            info.meaning,
            info.unit or "-",
            f"{info.default:g}",
            "" if info.typical is None else f"{info.typical[0]:g} to {info.typical[1]:g}",
            "" if info.null is None else _number(info.null),
            ", ".join(f"{value:g}" for value in info.shape_grid),
            info.scales,
            _range(info),
        )
        for cls in classes
        for info in describe(cls).values()
    ]
    head = ("parameter", "meaning", "unit", "default", "usual range", "null", "tried at", "scales as", "bounds")
    return _table(head, rows)


def _curve_values() -> str:
    rows = [
        (
            f"`{cls.name}`",
            cls.unit or "-",
            f"-{cls.typical:g} to {cls.typical:g}",
            cls.scales,
            f"`{cls.over}`",
            f"{cls.largest:g}",
            ", ".join(f"{knot:g}" for knot in cls.usual_knots),
        )
        for cls in CURVES.values()
    ]
    return _table(("curve", "unit", "usual range", "scales as", "over", "largest", "knots"), rows)


def _range(info: ParameterInfo) -> str:
    return f"{_number(info.lower)} to {_number(info.upper)}"


def _number(value: float) -> str:
    return f"{value:g}" if math.isfinite(value) else ("infinity" if value > 0.0 else "-infinity")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


PAGES = {
    "parameters.md": parameters_page,
    "effects.md": effects_page,
    "reference/settings.md": settings_page,
    "reference/remarks.md": remarks_page,
}

if __name__ == "__main__":
    for name, page in PAGES.items():
        (HERE / name).write_text(page(), encoding="utf-8")
