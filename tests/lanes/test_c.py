"""Functions of JAX as C: what a compiler makes of the text returns what JAX returns."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.lanes.c_emitter import CEmitter, literal
from jaxmodel.lanes.c_lowering import CLowering, numbers
from jaxmodel.lanes.emitter import Value
from jaxmodel.lanes.operands import NotNative, array_of

AT = np.array([-2.5, -1.0, -0.25, 0.0, 0.3, 1.0, 1.75, 4.0])
KNOTS = np.array([-1.0, 0.0, 0.5, 2.0])


def loop(x: jax.Array) -> jax.Array:
    """Swap two numbers in every round, so that a variable takes the other's old number."""

    def goes_on(carried: tuple) -> jax.Array:
        return carried[2] < 5.0

    return jax.lax.while_loop(goes_on, lambda c: (c[1] + x, c[0] * 0.5, c[2] + 1.0), (x, x * x, 0.0))[0]


FUNCTIONS: dict[str, Callable] = {
    "arithmetic": lambda x: -x * 2.0 + x / 3.0 - x * x * x,
    "elementary": lambda x: jnp.exp(x) + jnp.expm1(x) + jnp.tanh(x) + jnp.sin(x) * jnp.cos(x) + jnp.arcsinh(x),
    "logarithms": lambda x: jnp.log(2.6 + x) + jnp.log1p(x + 3.0) + jnp.sqrt(x + 2.5) + jnp.abs(x) ** 1.7,
    "rounding": lambda x: jnp.floor(x) + 10.0 * jnp.ceil(x) + 100.0 * jnp.round(x) + 1000.0 * jnp.sign(x),
    "choices": lambda x: jnp.where((x > 0.0) & ~(x > 1.0), x, jnp.where(x < -1.0, 7.0, jnp.clip(x, -0.5, 0.5))),
    "truths": lambda x: jnp.where(jnp.where(x > 0.0, x < 1.5, False), 1.0, jnp.where(jnp.isfinite(x), 2.0, 3.0)),
    "arrays": lambda x: jnp.sum(jnp.cumsum(jnp.stack([x, 2.0 * x, x * x])) @ jnp.arange(9.0).reshape(3, 3)),
    "place": lambda x: jnp.asarray([1.0, 4.0, 9.0, 16.0])[jnp.sum(x >= KNOTS)],
    "place of what is computed": lambda x: jnp.stack([x, x + 1.0, x * x])[(x > 0.0).astype(int)],
    "branches": lambda x: jax.lax.switch((x > 0.0).astype(int) + (x > 1.0), [jnp.sin, lambda y: -y, jnp.exp], x),
    "loop": loop,
    "rounds": lambda x: jax.lax.fori_loop(0, 4, lambda k, y: y * x + k, x),
    "derivative": jax.grad(lambda x: jnp.exp(-x * x) * jnp.interp(x, KNOTS, KNOTS**2)),
}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], ctypes.CDLL]:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler is installed")
    folder: Path = tmp_path_factory.mktemp("c")

    def build(text: str) -> ctypes.CDLL:
        number = len(list(folder.iterdir()))
        source, library = folder / f"f{number}.c", folder / f"f{number}.so"
        source.write_text(text, encoding="utf-8")
        flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-pedantic", "-shared", "-fPIC"]
        subprocess.run([compiler, *flags, str(source), "-o", str(library), "-lm"], check=True)
        return ctypes.CDLL(str(library))

    return build


def text_of(name: str, function: Callable) -> str:
    traced = jax.make_jaxpr(function)(jnp.zeros(()))
    emitter = CEmitter()
    given = array_of(Value("%x", np.dtype(float)))
    (found,) = CLowering(emitter).run(traced.jaxpr, [numbers(c) for c in traced.consts], [given])
    emitter.line(f"return {emitter.text_of(found[()])};")
    tables = [
        f"static const {'double' if values.dtype == float else 'int64_t'} {table}[] = "
        f"{{{', '.join(literal(one, values.dtype) for one in values)}}};"
        for table, values in emitter.tables.values()
    ]
    used = [line for line in tables if line.split()[3].split("[")[0] in emitter.finished()]
    return "\n".join([*used, f"double {name}(double x);", f"double {name}(double x)\n{{", emitter.finished(), "}"])


def test_functions_return_in_c_what_they_return_in_jax(compiled: Callable[[str], ctypes.CDLL]) -> None:
    head = "#include <math.h>\n#include <stdbool.h>\n#include <stdint.h>\n"
    bodies = [text_of(f"f{k}", function) for k, function in enumerate(FUNCTIONS.values())]
    renamed = [body.replace("table_", f"table_{k}_") for k, body in enumerate(bodies)]
    library = compiled(head + "\n".join(renamed))
    for k, (name, function) in enumerate(FUNCTIONS.items()):
        one = getattr(library, f"f{k}")
        one.restype, one.argtypes = ctypes.c_double, [ctypes.c_double]
        expected = np.array([function(jnp.asarray(x)) for x in AT])
        np.testing.assert_allclose([one(x) for x in AT], expected, rtol=1e-13, atol=1e-15, err_msg=name)


def test_what_is_known_is_computed_when_the_text_is_written() -> None:
    text = text_of("f", lambda x: x + 0.0 * jnp.exp(x) + jnp.sum(jnp.asarray([1.0, 2.0]) * 3.0))
    assert "exp" not in text
    assert "9.0" in text


def test_an_operation_that_c_has_not_is_refused() -> None:
    with pytest.raises(NotNative):
        text_of("f", lambda x: jnp.sort(jnp.stack([x, 1.0, -x]))[0])
