"""Packages load what is used, and have all their names."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys
from types import ModuleType

import pytest

PUBLIC = {  # the modules among the names of each
    "jaxmodel": ["effects", "operation", "plots", "presets", "sensitivity", "sweeps"],
    "jaxmodel.effects": [],
    "jaxmodel.operation": [],
    "jaxmodel.plots": [],
    "jaxmodel.sensitivity": [],
    "jaxmodel.sweeps": [],
    "jaxmodel.diagnosis": [],
    "jaxmodel.lanes": [],
}
NOT_IMPORTED = ("cluster", "examples")  # needs an extra; scripts


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_there_whatever_was_imported_before(name: str) -> None:
    package = importlib.import_module(name)
    for module in pkgutil.iter_modules(package.__path__):
        if module.name not in NOT_IMPORTED:
            importlib.import_module(f"{name}.{module.name}")
    assert set(package.__all__) <= set(dir(package))
    modules = [public for public in package.__all__ if isinstance(getattr(package, public), ModuleType)]
    assert modules == PUBLIC[name]
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nothing'"):
        package.nothing  # noqa: B018


@pytest.mark.parametrize("name", PUBLIC)
def test_no_module_stands_in_the_place_of_a_name(name: str) -> None:
    package = importlib.import_module(name)
    inside = {module.name for module in pkgutil.iter_modules(package.__path__)} - set(PUBLIC[name])
    assert inside & set(package.__all__) == set()


def test_a_name_needs_no_other_before_it() -> None:
    """Each is taken from a package that has none yet."""
    code = """
import importlib, sys
import jaxmodel
for name in jaxmodel.__all__:
    getattr(jaxmodel, name)
    for loaded in [one for one in vars(jaxmodel) if one in jaxmodel.__all__]:
        delattr(jaxmodel, loaded)
"""
    subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


def test_one_module_has_one_name() -> None:
    code = (
        "import sys; from jaxmodel import sweeps, sensitivity, read_case; import jaxmodel.app.cli; print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"sweeps", "sensitivity"} & set(done.stdout.split()) == set()


def test_a_picture_of_a_run_loads_no_sweep_and_no_diagnosis() -> None:
    unwanted = {"xarray", "zarr", "jaxmodel.sweeps.engine", "jaxmodel.fit"}
    code = f"import sys; from jaxmodel import plots; plots.simulation; print(*{unwanted} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
