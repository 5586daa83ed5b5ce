"""A cell as the tables of Simscape: a MATLAB file that is read back, by SciPy and by our own reader of logs."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.io import loadmat

from jaxmodel import case_model, read_case, read_table
from jaxmodel.base.errors import ParameterError
from tests.export.test_c_model import made_up


def test_the_tables_are_those_of_the_cell(tmp_path: Path) -> None:
    case = read_case("examples/samsung_30q")
    case.export("simscape", tmp_path / "cell.mat")
    found, curves = loadmat(tmp_path / "cell.mat", squeeze_me=True), case_model(case).curves
    soc = jnp.asarray(found["SOC_vec"])
    assert found["T_vec"].tolist() == pytest.approx([253.15, 333.15])
    warm = jnp.asarray(20.0)
    for column in (0, 1):
        for name, curve in (("V0_mat", curves.ocv), ("R0_mat", curves.R_ints), ("R2_mat", curves.R_TL)):
            expected = [float(curve(one, warm)) for one in soc]
            np.testing.assert_allclose(found[name][:, column], expected, rtol=1e-12)
    np.testing.assert_allclose(found["tau1_mat"][0, 0], float(curves.R_TS(soc[0], warm) * curves.C_TS(soc[0], warm)))
    assert float(found["AH"]) == pytest.approx(2.996)


def test_our_reader_of_logs_reads_them(tmp_path: Path) -> None:
    case = read_case("examples/samsung_30q")
    case.export("simscape", tmp_path / "cell.mat")
    frame = read_table(tmp_path / "cell.mat").frame
    table = case_model(case).curves.ocv
    expected = np.interp(frame["SOC_vec"], table.soc, table.values[0])
    np.testing.assert_allclose(frame["V0_mat 1"], expected, rtol=1e-12)


def test_heat_and_what_is_left_out_are_in_the_file(tmp_path: Path) -> None:
    effects = {"self_heating": {"C_th": 45.0, "hA": 0.15}, "arrhenius_resistance": {}, "ocv_hysteresis": {}}
    case = dataclasses.replace(read_case("examples/samsung_30q"), effects=effects)
    left_out = case.export("simscape", tmp_path / "cell.mat").left_out
    found = loadmat(tmp_path / "cell.mat", squeeze_me=True)
    assert (float(found["thermal_mass"]), float(found["heat_transfer"])) == (45.0, 0.15)
    assert found["R0_mat"].shape == (found["SOC_vec"].size, found["T_vec"].size)
    assert np.all(np.diff(found["R0_mat"], axis=1) < 0.0)  # falls as the cell warms
    assert any("ocv_hysteresis" in sentence for sentence in left_out)
    said = " ".join(" ".join(np.atleast_1d(found["notes"])).split())
    assert all(sentence.split(",")[0] in said for sentence in left_out)


def test_a_motor_is_refused() -> None:
    with pytest.raises(ParameterError, match="of a motor"):
        made_up("motor").export("simscape")
