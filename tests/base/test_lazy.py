"""Packages load what is used, and have all their names."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys
from types import ModuleType

import pytest

LAZY = ["jaxmodel", "sweeps", "sensitivity", "discrepancy", "plots"]


@pytest.mark.parametrize("name", LAZY)
def test_every_public_name_is_there_whatever_was_imported_before(name: str) -> None:
    package = importlib.import_module(name)
    for module in pkgutil.iter_modules(package.__path__):
        if module.name not in ("cluster", "presets"):
            importlib.import_module(f"{name}.{module.name}")
    assert set(package.__all__) <= set(dir(package))
    modules = [public for public in package.__all__ if isinstance(getattr(package, public), ModuleType)]
    assert modules == (["effects", "presets"] if name == "jaxmodel" else [])
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nothing'"):
        package.nothing  # noqa: B018


def test_a_picture_of_a_run_loads_no_sweep_and_no_diagnosis() -> None:
    unwanted = {"xarray", "zarr", "jaxmodel.sweeps.engine", "jaxmodel.diagnosis.fitting"}
    code = f"import sys, plots; plots.simulation; print(*{unwanted} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
