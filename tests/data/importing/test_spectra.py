"""Impedance spectra in a log are left out and said; what remains is the log without them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

FREQUENCIES_HZ = np.geomspace(1e4, 0.01, 40)


def with_spectrum(log: pd.DataFrame, at: int, names: tuple[str, str, str]) -> pd.DataFrame:
    """A log of a cycler with a spectrum between two of its rows, measured about a current of 0.1 A."""
    frequency, real, imaginary = names
    table = pd.DataFrame({"time/s": log.time_s, "Ewe/V": log.voltage_V, "<I>/mA": -1000.0 * log.current_A})
    table = table.assign(**{frequency: 0.0, real: 0.0, imaginary: 0.0})
    times = np.linspace(table["time/s"][at - 1], table["time/s"][at], FREQUENCIES_HZ.size + 2)[1:-1]
    spectrum = pd.DataFrame({"time/s": times, "Ewe/V": 3.9, "<I>/mA": 100.0})
    arc = 0.02 + 0.01 / (1.0 + 1j * FREQUENCIES_HZ)
    spectrum = spectrum.assign(**{frequency: FREQUENCIES_HZ, real: arc.real, imaginary: -arc.imag})
    return pd.concat([table[:at], spectrum, table[at:]], ignore_index=True)


@pytest.mark.parametrize(
    "names",
    [
        ("freq/Hz", "Re(Z)/Ohm", "-Im(Z)/Ohm"),
        ("Frequency (Hz)", "Z' (Ohm)", "Z'' (Ohm)"),
        ("frequency", "Z_real", "Z_imag"),
    ],
)
def test_rows_of_a_spectrum_are_left_out(tmp_path: Path, names: tuple[str, str, str]):
    path, log = tmp_path / "bench.csv", cell_log()
    with_spectrum(log, 200, names).to_csv(path, index=False)
    imported = import_case(path, "cell", ambient=25.0)
    columns = imported.runs[0].log.columns
    np.testing.assert_allclose(columns["voltage_V"], log.voltage_V)
    np.testing.assert_allclose(columns["current_A"], log.current_A)
    (found,) = [one for one in imported.findings if one.what == "spectra"]
    assert found.numbers == {"rows": 40.0}
    assert f"40 of {len(log) + 40:,} rows are of impedance spectra" in found.sentence


def test_a_file_of_spectra_alone_is_left_out_beside_logs(tmp_path: Path):
    log = cell_log()
    names = ("freq/Hz", "Re(Z)/Ohm", "-Im(Z)/Ohm")
    log.to_csv(tmp_path / "bench.csv", index=False)
    table = with_spectrum(log, 200, names)
    table[table["freq/Hz"] > 0.0].to_csv(tmp_path / "peis.csv", index=False)
    imported = import_case([tmp_path / "bench.csv", tmp_path / "peis.csv"], "cell", ambient=25.0)
    assert [run.log.name for run in imported.runs] == ["bench"]
    (found,) = [one for one in imported.findings if one.what == "file left out"]
    assert "impedance spectra (0.01 Hz to 1e+04 Hz) and no readings over time" in found.sentence
    with pytest.raises(MeasurementError, match="give a log of pulses or of a discharge"):
        import_case(tmp_path / "peis.csv", "cell", ambient=25.0)


def test_a_bridge_at_one_frequency_is_no_spectrum(tmp_path: Path):
    """A meter of 1 kHz beside the cycler logs an impedance in every row."""
    path, log = tmp_path / "bench.csv", cell_log()
    log.assign(**{"AC frequency (Hz)": 1000.0, "impedance (mOhm)": 20.0}).to_csv(path, index=False)
    imported = import_case(path, "cell", ambient=25.0)
    assert imported.runs[0].log.rows == len(log)
    assert not [one for one in imported.findings if one.what == "spectra"]
