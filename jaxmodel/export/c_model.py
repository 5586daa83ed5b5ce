"""A case's model as one file of C: its start, its step, its readings and where it is valid, with test vectors.

The functions are `jaxmodel.model.electrothermal`'s own, written from the jaxprs that kernels come from. The file asks
for no memory, calls nothing recursively, and needs C99 with its `math.h`.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case
from jaxmodel.export import c_vectors
from jaxmodel.export.c_file import CFile, Given, comment
from jaxmodel.export.wording import heading, ideal_readings, identifier, own_values_of_runs
from jaxmodel.lanes.emitter import NotNative
from jaxmodel.model.declaration import ParameterInfo
from jaxmodel.model.electrothermal import Model, initial_state, read, step, valid
from jaxmodel.model.flow import State, with_rests
from jaxmodel.model.names import parameter_table
from jaxmodel.model.profile import Profile
from jaxmodel.model.robot import Inputs

PRECISIONS = {"float64": np.float64, "float32": np.float32}
_TEXT = """{heading}
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* Current is positive on discharge; temperatures are in degC; other units are at the end of the names. */
typedef struct {{
{state}
}} {name}_state;

typedef struct {{
{inputs}
}} {name}_inputs;

typedef struct {{
{readings}
}} {name}_readings;

/* The state at the start of a run: charged to p_initial_soc, at rest, at the ambient temperature. */
void {name}_start(const {name}_inputs *inputs, {name}_state *state);
/* The state after duration_s seconds (>= 0) under constant inputs: second order, stable at any step. */
void {name}_step(const {name}_inputs *inputs, {real} duration_s, {name}_state *state);
/* The readings of ideal sensors in a state under inputs. */
void {name}_read(const {name}_inputs *inputs, const {name}_state *state, {name}_readings *readings);
/* Whether the equations are valid there: within tables and formulas, with positive resistances. */
bool {name}_valid(const {name}_inputs *inputs, const {name}_state *state);

{body}
{test}"""


def export_c(case: Case, *, precision: str = "float64") -> Exported:
    """Return a case's model as one file of C.

    Args:
        case: of any kind, with at least one run, which says what the inputs are and what test vectors are taken from.
        precision: "float64", or "float32" with Kahan's sums of the states.

    Raises:
        ParameterError: the precision is unknown, or the model has an operation that has no C.
    """
    if precision not in PRECISIONS:
        raise ParameterError(f"There is no precision '{precision}' of C; use float64 or float32.")
    run = case.runs[0]
    model, profile = case_model(case), run_profile(run)
    left_out = left_out_of_model(case, model, profile)
    name, dtype = identifier(case.name), np.dtype(PRECISIONS[precision])
    vectors = c_vectors.steps(model, case_model(case, run), profile)
    with jax.enable_x64(dtype.itemsize == 8):
        cast = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), dtype=dtype), model)
        inputs = {key: jnp.zeros((), dtype) for key in profile.inputs}
        start = start_of(cast, inputs)
        file = CFile(dtype)
        try:
            write_functions(file, constants_of(file, cast), cast, start, inputs, name)
        except NotNative as error:
            raise ParameterError(f"{case.label}: its model cannot be written as C ({error}).") from error
        error = c_vectors.error_of_float32(cast, start, vectors) if dtype.itemsize == 4 else 0.0
    if error:
        share = f"In float32 a step differs from one in float64 by up to {error:.1g} of the largest number of its kind."
        left_out = (*left_out, share)
    text = _TEXT.format(
        heading=comment(heading(case, "The model", left_out)),
        name=name,
        real=file.real,
        state=fields(sorted(start), file.real),
        inputs=fields(sorted(inputs), file.real),
        readings=fields(vectors.readings, file.real),
        body=file.text(),
        test=c_vectors.program(name, file.real, vectors, c_vectors.tolerance(error)),
    )
    return Exported(text, left_out)


def left_out_of_model(case: Case, model: Model, profile: Profile) -> tuple[str, ...]:
    """Say what C of a model does not carry of its case; `profile` is of the first run."""
    left_out = (*ideal_readings(model, profile.inputs), *own_values_of_runs(case), *_other_inputs(case))
    if "initial_soc" in (case.parameters | case.runs[0].overrides) or case.kind == "motor":
        return left_out
    sentence = "Runs of the case begin at a state of charge of their own; in the file it is that of a full cell, 1."
    return (*left_out, sentence)


def _other_inputs(case: Case) -> tuple[str, ...]:
    first = case.runs[0]
    others = [run.name for run in case.runs if set(run.measured.inputs) != set(first.measured.inputs)]
    if not others:
        return ()
    return (f"The inputs are those of {first.name}; {', '.join(others)} have others.",)


def start_of(model: Model, inputs: Inputs) -> State:
    """Return the state at the start of a run, with the rests of sums where numbers are short."""
    state = {
        key: jnp.asarray(value, dtype=inputs["ambient_degC"].dtype)
        for key, value in initial_state(model, inputs).items()
    }
    return with_rests(state) if inputs["ambient_degC"].dtype == np.float32 else state


def write_functions(
    file: CFile,
    constants: Sequence[Given],
    model: Model,
    start: State,
    inputs: Inputs,
    name: str,
    before: str = "",
    first: str = "",
) -> None:
    """Write start, step, readings and validity of a model into a file.

    Args:
        file: of numbers of the type of the model's.
        constants: what each number of the model is in C.
        model: whose functions they are.
        start: a state of it.
        inputs: of it.
        name: that the functions begin with.
        before: what stands before each head, as "static ".
        first: an argument that each function takes first, as "const model_parameters *p, ".
    """
    of_state = [Given(start[key], f"state->{identifier(key)}", f"x_{identifier(key)}") for key in sorted(start)]
    of_inputs = [Given(inputs[key], f"inputs->{identifier(key)}", f"u_{identifier(key)}") for key in sorted(inputs)]
    duration = Given(jnp.zeros((), file.dtype), "duration_s", "h")
    to_state = {key: f"state->{identifier(key)}" for key in start}
    readings = {key: f"readings->{identifier(key)}" for key in jax.eval_shape(read, model, start, inputs)}
    ins = f"{first}const {name}_inputs *inputs"
    file.write(
        f"{before}void {name}_start({ins}, {name}_state *state)",
        start_of, (model, inputs), [*constants, *of_inputs], to_state,
    )  # fmt: skip
    file.write(
        f"{before}void {name}_step({ins}, {file.real} duration_s, {name}_state *state)",
        step, (model, start, inputs, duration.value), [*constants, *of_state, *of_inputs, duration], to_state,
    )  # fmt: skip
    file.write(
        f"{before}void {name}_read({ins}, const {name}_state *state, {name}_readings *readings)",
        read, (model, start, inputs), [*constants, *of_state, *of_inputs], readings,
    )  # fmt: skip
    file.write(
        f"{before}bool {name}_valid({ins}, const {name}_state *state)",
        lambda *given: {"is_valid": valid(*given)},
        (model, start, inputs), [*constants, *of_state, *of_inputs], {"is_valid": "const bool is_valid"}, "is_valid",
    )  # fmt: skip


def numbers_of(model: Model) -> list[tuple[str, np.ndarray, ParameterInfo | None]]:
    """Return the label, the values and the declaration of each leaf of a model, in order."""
    known = parameter_table(model)
    labels = [(_label(path, model), np.asarray(leaf)) for path, leaf in jax.tree_util.tree_flatten_with_path(model)[0]]
    return [(label, values, known.get(label)) for label, values in labels]


def constants_of(file: CFile, model: Model) -> list[Given]:
    """Return what each number of a model is in C: a named constant, or a table."""
    found = []
    for label, values, info in numbers_of(model):
        if values.ndim:
            found.append(table_of(file, label, values))
            continue
        constant = f"p_{identifier(label)}"
        about = f"{info.unit + ', ' if info.unit else ''}{info.meaning}" if info else ""
        file.constants[constant] = (float(values), about.replace("*/", "* /"))
        found.append(Given(values, constant))
    return found


def table_of(file: CFile, label: str, values: np.ndarray) -> Given:
    """Return an array of a model as a table of a file."""
    file.name_table(label, values)
    return Given(values, "", is_table=True)


def _label(path: tuple, model: Model) -> str:
    """Return the name of a number of a model: that of a parameter, of an effect's, or of a curve's field."""
    words = [str(getattr(part, "name", getattr(part, "idx", getattr(part, "key", "")))) for part in path]
    if words[0] == "parameters":
        return words[1]
    if words[0] == "effects":
        return ".".join([model.effects[int(words[1])].label, *words[2:]])
    return "_".join(words[1:])


def fields(names: Sequence[str], real: str) -> str:
    """Return the numbers of a structure in C."""
    return "\n".join(f"    {real} {identifier(name)};" for name in names)
