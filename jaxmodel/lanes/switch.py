"""A change that a lane may be without; kernels do not compute it where no lane has it."""

from __future__ import annotations

from typing import Any

import jax

# The name of the function below in a jaxpr.
SWITCHED = "switched"


@jax.jit
def switched(switch: Any, value: Any, changed: Any) -> Any:
    """Return a value where a switch is 0, the changed one where it is 1.

    Kernels know it by its name: they compute what is changed only where some lane has its switch on.
    """
    return value + switch * (changed - value)
