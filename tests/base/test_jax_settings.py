"""JAX is configured whenever it is imported, before `jaxmodel` or after it, and `jaxmodel` itself imports none."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

SHOW = "import jax; print(jax.numpy.ones(1).dtype, jax.device_count())"
EXPECTED = f"float64 {len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()}"


def printed(program: str, **environment: str) -> str:
    plain = {name: value for name, value in os.environ.items() if name not in ("XLA_FLAGS", "JAX_NUM_CPU_DEVICES")}
    return subprocess.run(
        [sys.executable, "-c", program],
        env=plain | {"JAX_PLATFORMS": "cpu"} | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout.strip()


@pytest.mark.parametrize(
    "before",
    [
        "import jaxmodel, sys; assert 'jax' not in sys.modules",
        "import jax, jaxmodel",
        "import jaxmodel, importlib.util; importlib.util.find_spec('jax')",  # as packages ask whether it is there
        "import jaxmodel; import jax.numpy",
        "import jaxmodel.model.scan",
    ],
)
def test_jax_is_configured_in_whatever_order(before: str) -> None:
    assert printed(f"{before}; {SHOW}") == EXPECTED


def test_jax_is_left_alone_on_request() -> None:
    assert printed(f"import jaxmodel; {SHOW}", JAXMODEL_JAX_SETTINGS="off") == "float32 1"
