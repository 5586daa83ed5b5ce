"""Public measurements, where they lie beside the repository, become cases without a flag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import read_case
from jaxmodel.data.importing import import_case

SETS = {
    "samsung_30q_18650": ("cell1_*[1c][C0]*.csv", 3.0),
    "k2_lfp_26650": ("*_p[23]0degC.csv", 2.2),
    "a123_26650_plett": ("*p25degC.csv", 2.06),
    "lg_mj1_18650": ("*_p*0degC.csv", 2.96),
}


@pytest.mark.parametrize("name", SETS)
def test_a_set_is_imported_without_flags(shared: Path, tmp_path: Path, name: str):
    pattern, capacity_Ah = SETS[name]
    files = sorted((shared / "data" / name).glob(pattern))
    if not files:
        pytest.skip("these measurements are not there")
    imported = import_case(files, "cell", out=tmp_path / "case")
    assert imported.capacity is not None
    assert abs(imported.capacity.value - capacity_Ah) < 2.0 * (imported.capacity.sd or 0.0)
    case = read_case(tmp_path / "case")
    for run in case.runs:
        raw = pd.read_csv(next(file for file in files if file.stem == run.name))
        assert run.measured.time_s.size >= len(raw.drop_duplicates())
        np.testing.assert_allclose(np.sort(run.measured.inputs["current_A"])[-1], raw.current_A.max())


def test_a_reversed_log_comes_out_as_the_log_itself(shared: Path, tmp_path: Path):
    file = shared / "data" / "lg_mj1_18650" / "pulse_10pctSOC_p20degC.csv"
    if not file.is_file():
        pytest.skip("this measurement is not there")
    raw = pd.read_csv(file)
    raw.assign(current_A=-raw.current_A).to_csv(tmp_path / "reversed.csv", index=False)
    straight, turned = (import_case(path, "cell").runs[0].log for path in (file, tmp_path / "reversed.csv"))
    np.testing.assert_array_equal(turned.columns["current_A"], straight.columns["current_A"])
