"""Models of the user's own robots, and packs with cells in parallel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.build import preset_model
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import constant
from jaxmodel.model.simulation import simulate
from jaxmodel.operation import cells_in_parallel, read_robots


def write_case(folder: Path, kind: str = "robot", mass_kg: float = 30.0) -> Path:
    folder.mkdir(parents=True)
    inputs = {"robot": "duty,load_torque_Nm", "cell": "current_A,voltage_V"}[kind]
    parameters = f"[parameters]\nmass_kg = {mass_kg}\n" if kind == "robot" else ""
    runs = '[[runs]]\nfile = "r.csv"\nsplit = "fit"\n' + ("initial_soc = 1.0\n" if kind == "cell" else "")
    (folder / "case.toml").write_text(f'kind = "{kind}"\n{parameters}{runs}', encoding="utf-8")
    (folder / "r.csv").write_text(f"time_s,ambient_degC,{inputs}\n0,20,0.3,0.1\n1,20,0.3,0.1\n", encoding="utf-8")
    return folder


def test_robots_are_read_by_the_names_of_their_folders(tmp_path: Path) -> None:
    paths = [write_case(tmp_path / "light"), write_case(tmp_path / "heavy", mass_kg=60.0)]
    models = read_robots(paths)
    assert {name: float(model.parameters.mass_kg) for name, model in models.items()} == {"light": 30.0, "heavy": 60.0}
    with pytest.raises(MeasurementError, match="Two of the models are called 'light'"):
        read_robots([paths[0], write_case(tmp_path / "other" / "light")])
    with pytest.raises(MeasurementError, match="needs a case of kind robot, and this one is of kind cell"):
        read_robots([write_case(tmp_path / "cell", kind="cell")])


def test_cells_in_parallel_share_the_current() -> None:
    """Two cells at 6 A are one cell at 3 A."""
    one = preset_model("lg_mj1", "cell")
    profile_of = {amps: constant(600.0, 10.0, current_A=amps, ambient_degC=20.0) for amps in (3.0, 6.0)}

    def readings(model: Model, amps: float) -> dict[str, np.ndarray]:
        return {name: np.asarray(values) for name, values in simulate(model, profile_of[amps]).readings.items()}

    alone, pair = readings(one, 3.0), readings(cells_in_parallel(one, 2.0), 6.0)
    np.testing.assert_allclose(pair["soc"], alone["soc"], rtol=1e-12)
    np.testing.assert_allclose(pair["voltage_V"], alone["voltage_V"], rtol=1e-9)
