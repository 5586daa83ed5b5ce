"""The public API: what each package exports is there, documented and typed."""

from __future__ import annotations

import importlib
import inspect
import os
import subprocess
import sys

import pytest

from tests.public_rooms import PUBLIC


@pytest.mark.parametrize("package", PUBLIC)
def test_what_is_exported_is_there_sorted_and_documented(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__doc__
    assert list(module.__all__) == sorted(
        module.__all__, key=lambda name: (not name.isupper(), name[0].islower(), name)
    )
    for name in module.__all__:
        exported = getattr(module, name)
        if inspect.isfunction(exported) or inspect.isclass(exported):
            assert (inspect.getdoc(exported) or "").strip(), name


@pytest.mark.parametrize("package", PUBLIC)
def test_public_methods_of_results_are_documented(package: str) -> None:
    module = importlib.import_module(package)
    for name in module.__all__:
        exported = getattr(module, name)
        if not inspect.isclass(exported) or not exported.__module__.startswith("jaxmodel"):
            continue
        for method, value in vars(exported).items():
            if not method.startswith("_") and (inspect.isfunction(value) or isinstance(value, property)):
                assert inspect.getdoc(value), f"{name}.{method}"


def test_the_switch_leaves_jax_alone() -> None:
    settings = "(jax.config.jax_enable_x64, jax.config.jax_num_cpu_devices, os.environ.get('XLA_FLAGS'))"
    program = f"import jax, os; a = {settings}; import jaxmodel; b = {settings}; print(a == b, b[0])"
    said = {}
    for switch in ("on", "off"):
        environment = {**os.environ, "JAXMODEL_JAX_SETTINGS": switch}
        run = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=120
        )
        assert run.returncode == 0, run.stderr
        said[switch] = run.stdout.split()
    assert said == {"on": ["False", "True"], "off": ["True", "False"]}


def test_the_package_runs_as_the_command() -> None:
    said = subprocess.run([sys.executable, "-m", "jaxmodel", "--version"], capture_output=True, text=True, check=True)
    assert said.stdout.startswith("jaxmodel ")
