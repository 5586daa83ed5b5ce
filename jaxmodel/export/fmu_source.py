"""A case's model as the C of an FMU: its parameters in a structure, and its numbers by their value references.

The functions are those of `--to c`, written from the same jaxprs. The hand-written files of the folder `fmi` include
this one, `model.h`, and add the functions of the standard.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import re
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.units import split_unit, unit_of
from jaxmodel.case.records import Case
from jaxmodel.export.c_file import CFile, Given, comment
from jaxmodel.export.c_model import fields, numbers_of, start_of, table_of, write_functions
from jaxmodel.export.wording import heading, identifier
from jaxmodel.lanes.c_emitter import literal
from jaxmodel.model import profile as paces
from jaxmodel.model.electrothermal import Model, read
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Pace, pace_of

# Of the rule of steps, for the C that follows it.
_PACES = ("FIRST_STEP_SHARE", "BENDING_STEP_SHARE", "SETTLED", "SLOW_ROTOR_S", "WARMING_STEP_SHARE", "WARMING_S")
LONGEST_STEP = "longest_step_s"
VALID = "valid"

_TEXT = """{heading}
#define MODEL_TOKEN "{token}"

/* Current is positive on discharge; temperatures are in degC; other units are at the end of the names. */
typedef struct {{
{parameters}
}} model_parameters;

typedef struct {{
{inputs}
}} model_inputs;

typedef struct {{
{state}
}} model_state;

typedef struct {{
{readings}
}} model_readings;

typedef struct {{
    model_parameters parameters;
    model_inputs inputs;
    model_state state;
    model_readings readings;
    bool is_valid;
    double longest_step_s;
}} model_data;

/* Value references: inputs from 1, readings, states, numbers that may be set at any time, and those of the start. */
{places}

/* The rule of steps: of jaxmodel, and of this model. */
{paces}

{body}
/* Whether inputs differ that move a motor. */
static bool model_jumped(const model_inputs *before, const model_inputs *now)
{{
{jumped}
}}

/* The number that a value reference means; NULL if there is none. */
static double *model_place(model_data *data, uint32_t reference)
{{
    switch (reference) {{
{cases}
        default: return NULL;
    }}
}}

static model_data model_defaults(void)
{{
    model_data data;
    memset(&data, 0, sizeof data);
{defaults}
    return data;
}}
"""


@dataclasses.dataclass(frozen=True)
class Variable:
    """A number of an FMU.

    Attributes:
        name: as importers show it.
        place: its expression in C.
        role: "input", "reading", "state", "tunable" (a parameter that may be set at any time), "fixed" (one of the
            start), or "valid".
        unit: as `jaxmodel.base.units` writes it; "" for a pure number.
        meaning: in words.
        start: the value before it is set; None for what is computed.
        lower: the smallest valid value; also `upper`.
    """

    name: str
    place: str
    role: str
    unit: str = ""
    meaning: str = ""
    start: float | None = None
    lower: float = -math.inf
    upper: float = math.inf


@dataclasses.dataclass(frozen=True)
class Source:
    """The C of a model for an FMU: its text, the token that tells it from others, and its numbers in their order.

    The value reference of a number is its place in `variables`, from 1.
    """

    text: str
    token: str
    variables: tuple[Variable, ...]


def source_of(case: Case, model: Model, profile: Profile, left_out: Sequence[str]) -> Source:
    """Return the C of a case's model for an FMU, in float64.

    Args:
        case: of any kind.
        model: of it.
        profile: of its first run, which says what the inputs are, the first ambient temperature, and the usual step.
        left_out: what the file does not carry.

    Raises:
        NotNative: the model has an operation that has no C.
    """
    inputs = {key: jnp.zeros(()) for key in profile.inputs}
    start, file = start_of(model, inputs), CFile(np.float64)
    given, parameters = _parameters(file, model)
    write_functions(file, given, model, start, inputs, "model", "static ", "const model_parameters *p, ")
    pace = _write_pace(file, given, model, profile)
    used = [set(re.findall(r"(?<=\bp->)\w+", text)) for text in file.functions]
    used_later = set().union(*used[1:])
    variables = [
        *(_input(name, profile) for name in sorted(inputs)),
        *(_reading(name) for name in sorted(jax.eval_shape(read, model, start, inputs))),
        *(_state(name) for name in sorted(start)),
        *(one for one in parameters if _field(one) in used_later),
        Variable(
            LONGEST_STEP, LONGEST_STEP, "tunable", "s", "a communication step is cut into steps no longer than this",
            float(np.median(np.diff(profile.time_s))), lower=0.0,
        ),
        *(dataclasses.replace(one, role="fixed") for one in parameters if _field(one) in used[0] - used_later),
        Variable(VALID, "is_valid", "valid", meaning="whether the equations are valid there: within tables, say"),
    ]  # fmt: skip
    token = "{token}"
    text = _TEXT.format(
        heading=comment(heading(case, "The model", tuple(left_out))),
        token=token,
        body=file.text(),
        places="\n".join(f"#define {name} {number}" for name, number in _firsts(variables).items()),
        paces="\n".join(_pace_lines(pace)),
        jumped=_jumped(sorted(inputs)),
        cases="\n".join(
            f"        case {number}: return &data->{one.place};"
            for number, one in enumerate(variables, start=1)
            if one.role != "valid"
        ),
        defaults="\n".join(
            f"    data.{one.place} = {literal(one.start, np.float64)};" for one in variables if one.start is not None
        ),
        parameters=fields([_field(one) for one in variables if one.place.startswith("parameters.")], file.real),
        inputs=fields(sorted(inputs), file.real),
        state=fields(sorted(start), file.real),
        readings=fields([one.name for one in variables if one.role == "reading"], file.real),
    )
    found = hashlib.sha256(text.encode()).hexdigest()
    name = "-".join(found[first:end] for first, end in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32)))
    return Source(text.replace(token, f"{{{name}}}"), f"{{{name}}}", tuple(variables))


def _parameters(file: CFile, model: Model) -> tuple[list[Given], list[Variable]]:
    """Return what each number of a model is in C, and those that are in the structure of parameters."""
    given, found = [], []
    for label, values, info in numbers_of(model):
        name = identifier(label)
        if values.ndim:
            given.append(table_of(file, label, values))
        elif info is None:
            file.constants[f"p_{name}"] = (float(values), "")
            given.append(Given(values, f"p_{name}"))
        else:
            given.append(Given(values, f"p->{name}", f"p_{name}"))
            found.append(
                Variable(
                    _dotted(label), f"parameters.{name}", "tunable", info.unit, info.meaning, float(values), info.lower,
                    info.upper,
                )
            )  # fmt: skip
    return given, found


def _write_pace(file: CFile, given: Sequence[Given], model: Model, profile: Profile) -> Pace:
    """Write what the steps of a model follow, and return it."""
    names = ("longest_s", "electrical_s", "rotor_s")

    def numbers(model: Model) -> dict[str, Any]:
        pace = pace_of(model, profile.inputs)
        return {name: jnp.asarray(value) for name in names if (value := getattr(pace, name)) is not None}

    pace = pace_of(model, profile.inputs)
    file.write(
        f"static void model_pace(const model_parameters *p, {', '.join(f'double *{name}' for name in names)})",
        numbers, (model,), given, {name: f"*{name}" for name in names},
    )  # fmt: skip
    return pace


def _pace_lines(pace: Pace) -> list[str]:
    lines = [f"#define PACE_{name} {literal(getattr(paces, name), np.float64)}" for name in _PACES]
    settles = pace.electrical_s is not None
    lines += [f"#define MODEL_SETTLES {int(settles)}  /* whether a rotor settles after a jump of the inputs */"]
    lines += [f"#define MODEL_BENDS {int(pace.bends)}  /* whether the armature has a kink at zero current */"]
    return [*lines, f"#define MODEL_GROWTH {literal(pace.growth, np.float64)}"]


def _firsts(variables: Sequence[Variable]) -> dict[str, int]:
    """Return the value reference of the first number of each role, and of that of validity."""
    roles = [one.role for one in variables]
    after = {"reading": roles.index("reading"), "tunable": roles.index("tunable"), "valid": len(roles) - 1}
    after["fixed"] = roles.index("fixed") if "fixed" in roles else after["valid"]
    names = {"reading": "FIRST_READING", "tunable": "FIRST_TUNABLE", "fixed": "FIRST_FIXED", "valid": "VALID"}
    return {f"MODEL_{names[role]}": after[role] + 1 for role in names}


def _jumped(inputs: Sequence[str]) -> str:
    moving = [identifier(name) for name in inputs if name != "ambient_degC"]
    if not moving:
        return "    (void)before;\n    (void)now;\n    return false;"
    return f"    return {' || '.join(f'before->{name} != now->{name}' for name in moving)};"


def _input(name: str, profile: Profile) -> Variable:
    start = float(profile.inputs[name][0]) if name == "ambient_degC" else 0.0
    return Variable(_dotted(name), f"inputs.{identifier(name)}", "input", unit_of(name), split_unit(name)[0], start)


def _reading(name: str) -> Variable:
    return Variable(_dotted(name), f"readings.{identifier(name)}", "reading", unit_of(name), split_unit(name)[0])


def _state(name: str) -> Variable:
    return Variable(f"state.{_dotted(name)}", f"state.{identifier(name)}", "state", unit_of(name), split_unit(name)[0])


def _field(variable: Variable) -> str:
    return variable.place.rpartition(".")[2]


def _dotted(name: str) -> str:
    """Return a name whose parts between dots are identifiers, as the naming convention "structured" asks."""
    return ".".join(identifier(part) for part in name.split("."))
