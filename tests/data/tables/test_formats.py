"""Spreadsheets, columnar and MATLAB files, and loggers' formats, give the table that was written."""

from __future__ import annotations

import gzip
import io
import sys
import types
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.io

from jaxmodel import read_table
from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.tables.loggers import PACKAGES

FRAME = pd.DataFrame(
    {"Test_Time(s)": np.arange(50.0), "Current(A)": np.linspace(-1.0, 1.0, 50), "Voltage(V)": np.linspace(3.0, 4.0, 50)}
)


def test_sheets_of_one_header_are_read_one_after_the_other(tmp_path: Path):
    path = tmp_path / "log.xlsx"
    with pd.ExcelWriter(path, engine="openpyxl") as book:
        pd.DataFrame({"Test name": ["hppc"], "Operator": ["x"]}).to_excel(book, sheet_name="Global_Info", index=False)
        FRAME[:30].to_excel(book, sheet_name="Channel_1_1", index=False, startrow=3)
        FRAME[30:].to_excel(book, sheet_name="Channel_1_2", index=False, startrow=3)
    table = read_table(path)
    pd.testing.assert_frame_equal(table.frame, FRAME)
    assert dict(table.units) == {"Test_Time(s)": "s", "Current(A)": "A", "Voltage(V)": "V"}
    assert any("Global_Info" in remark for remark in table.remarks)
    assert len(read_table(path, sheet="Channel_1_2").frame) == 20
    with pytest.raises(MeasurementError, match=r"no sheet 'Chanel_1_2'\. Did you mean 'Channel_1_2'"):
        read_table(path, sheet="Chanel_1_2")


def test_time_stamps_and_empty_cells_of_a_spreadsheet(tmp_path: Path):
    path = tmp_path / "log.xlsx"
    frame = pd.DataFrame({"Date_Time": pd.date_range("2024-01-01", periods=5, freq="10s"), "n": 1.0})
    frame["U [V]"] = [3.0, None, 3.2, 3.3, 3.4]
    frame.to_excel(path, index=False)
    table = read_table(path)
    assert table.frame["Date_Time"].dtype.kind == "M"
    assert np.isnan(table.frame["U [V]"][1])


def ods(rows: list[list[object]]) -> bytes:
    """An OpenDocument spreadsheet with one sheet, as an office program packs it."""
    office, sheet = (
        "urn:oasis:names:tc:opendocument:xmlns:office:1.0",
        "urn:oasis:names:tc:opendocument:xmlns:table:1.0",
    )
    text = "urn:oasis:names:tc:opendocument:xmlns:text:1.0"

    def cell(value: object) -> str:
        if value is None:
            return "<table:table-cell/>"
        if isinstance(value, str):
            return f'<table:table-cell office:value-type="string"><text:p>{value}</text:p></table:table-cell>'
        return (
            f'<table:table-cell office:value-type="float" office:value="{value}"><text:p>x</text:p></table:table-cell>'
        )

    body = "".join(f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in rows)
    content = (
        f'<?xml version="1.0" encoding="UTF-8"?><office:document-content xmlns:office="{office}" xmlns:table="{sheet}" '
        f'xmlns:text="{text}" office:version="1.2"><office:body><office:spreadsheet><table:table table:name="Log">'
        f"{body}</table:table></office:spreadsheet></office:body></office:document-content>"
    )
    mime = "application/vnd.oasis.opendocument.spreadsheet"
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as file:
        file.writestr("mimetype", mime)
        file.writestr("META-INF/manifest.xml", '<?xml version="1.0"?><manifest:manifest xmlns:manifest="urn:x"/>')
        file.writestr("content.xml", content)
    return packed.getvalue()


def test_ods(tmp_path: Path):
    path = tmp_path / "log.ods"
    names = [*FRAME, "Note"]
    rows: list[list[object]] = [[*row, "rest"] for row in FRAME.to_numpy().tolist()]
    rows[3][2] = None
    path.write_bytes(ods([["Test of cell 7"], [], list(names), *rows]))
    table = read_table(path)
    expected = FRAME.copy()
    expected.loc[3, "Voltage(V)"] = np.nan
    pd.testing.assert_frame_equal(table.frame[[*FRAME]], expected)
    assert dict(table.units) == {"Test_Time(s)": "s", "Current(A)": "A", "Voltage(V)": "V"}
    assert set(table.frame["Note"]) == {"rest"}
    assert table.remarks == ("Read sheet 'Log'.",)


@pytest.mark.parametrize("suffix", [".parquet", ".feather"])
def test_columnar_files(tmp_path: Path, suffix: str):
    path = tmp_path / f"log{suffix}"
    FRAME.to_parquet(path) if suffix == ".parquet" else FRAME.to_feather(path)
    pd.testing.assert_frame_equal(read_table(path).frame, FRAME)
    table = read_table(path, columns=["Voltage(V)"])
    assert list(table.frame) == ["Voltage(V)"]
    assert table.left_out == ("Test_Time(s)", "Current(A)")


def test_a_structure_of_a_matlab_file(tmp_path: Path):
    path = tmp_path / "log.mat"
    meas = dict(zip(["Time", "Current", "Voltage"], FRAME.to_numpy().T, strict=True))
    scipy.io.savemat(path, {"meas": meas, "note": "25 degC", "short": np.arange(3.0)})
    table = read_table(path)
    assert list(table.frame) == ["Time", "Current", "Voltage"]
    np.testing.assert_array_equal(table.frame.to_numpy(), FRAME.to_numpy())
    assert any("short (3)" in remark for remark in table.remarks)


def runs_of_a_file(nested: bool) -> dict[str, object]:
    """Three runs as structures, and what is none: a note, and settings of another form."""
    halves = [FRAME[:20], FRAME[20:], FRAME[5:15]]
    runs = {f"run{n}": {name: part[name].to_numpy() for name in part} for n, part in enumerate(halves, start=1)}
    runs = {name: dict(zip(["Time", "Current", "Voltage"], run.values(), strict=True)) for name, run in runs.items()}
    others = {"note": "25 degC", "settings": {"gain": np.arange(7.0), "offset": np.arange(7.0)}}
    return {"bench": {**runs, **others}} if nested else {**runs, **others}


@pytest.mark.parametrize("nested", [False, True])
def test_structures_of_a_matlab_file_are_runs_by_their_names(tmp_path: Path, nested: bool):
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, runs_of_a_file(nested))
    table = read_table(path)
    assert [name for name, _ in table.tables()] == ["log-run1", "log-run2", "log-run3"]
    parts = dict(table.tables())
    np.testing.assert_array_equal(parts["log-run2"].frame[["Time", "Current", "Voltage"]], FRAME[20:])


@pytest.mark.parametrize(
    ("sheet", "runs"),
    [("run[12]", ["run1", "run2"]), ("run*", ["run1", "run2", "run3"]), (("run1", "run3"), ["run1", "run3"])],
)
def test_runs_of_a_matlab_file_are_chosen_by_pattern(tmp_path: Path, sheet: str | tuple[str, ...], runs: list[str]):
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, runs_of_a_file(nested=True))
    table = read_table(path, sheet=sheet)
    assert list(dict.fromkeys(table.frame[table.key])) == runs
    (alone,) = read_table(path, sheet="run2").tables()
    np.testing.assert_array_equal(alone[1].frame[["Time", "Current", "Voltage"]], FRAME[20:])
    with pytest.raises(MeasurementError, match=r"has no variable 'walk\*'"):
        read_table(path, sheet="walk*")


def test_an_array_of_structures_is_a_run_each(tmp_path: Path):
    path = tmp_path / "aged.mat"
    kind = np.dtype([("Time", object), ("Current", object), ("Voltage", object)])
    cycles = np.zeros((1, 300), dtype=kind)
    for n in range(300):
        cycles[0, n] = tuple(FRAME[name].to_numpy() + n for name in FRAME)
    scipy.io.savemat(path, {"cycle": cycles})
    parts = dict(read_table(path).tables())
    assert len(parts) == 300
    np.testing.assert_allclose(parts["aged-cycle 300"].frame["Voltage"], FRAME["Voltage(V)"] + 299.0)


def test_structures_of_one_signal_each_are_columns(tmp_path: Path):
    path = tmp_path / "scope.mat"
    time_s, current, voltage = FRAME.to_numpy().T
    scipy.io.savemat(path, {"I": {"time": time_s, "data": current}, "U": {"time": time_s, "data": voltage}})
    table = read_table(path)
    assert table.key == ""
    np.testing.assert_array_equal(table.frame["U.data"], voltage)


def test_sheets_that_a_user_names_are_runs(tmp_path: Path):
    path = tmp_path / "log.xlsx"
    with pd.ExcelWriter(path, engine="openpyxl") as book:
        for name, part in {"run 1": FRAME[:20], "run 2": FRAME[20:], "old": FRAME}.items():
            part.to_excel(book, sheet_name=name, index=False)
    table = read_table(path, sheet="run*")
    assert [name for name, _ in table.tables()] == ["log-run 1", "log-run 2"]
    pd.testing.assert_frame_equal(pd.DataFrame(table.frame[[*FRAME]]), FRAME)


def test_matlab_7_3(tmp_path: Path):
    pytest.importorskip("matio")
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in zip(["Time", "Current", "Voltage"], FRAME.to_numpy().T, strict=True):
            data = file.create_dataset(name, data=values[None, :])
            data.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(head)
    table = read_table(path)
    np.testing.assert_array_equal(table.frame[["Time", "Current", "Voltage"]].to_numpy(), FRAME.to_numpy())


def test_tdms(tmp_path: Path):
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "log.tdms"
    channels = [nptdms.ChannelObject("bench", name, FRAME[name].to_numpy()) for name in FRAME]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)
    pd.testing.assert_frame_equal(read_table(path).frame, FRAME)


def test_mdf(tmp_path: Path):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "log.mf4"
    time_s = FRAME["Test_Time(s)"].to_numpy()
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(FRAME["Current(A)"].to_numpy(), time_s, unit="A", name="Current")])
        file.save(path)
    table = read_table(path)
    np.testing.assert_allclose(table.frame["Time (s)"], time_s)
    np.testing.assert_allclose(table.frame["Current (A)"], FRAME["Current(A)"])


@pytest.mark.parametrize("suffix", [".xlsx", ".ods", ".parquet", ".feather", ".mat"])
def test_a_damaged_file_gets_one_sentence(tmp_path: Path, suffix: str):
    path = tmp_path / f"log{suffix}"
    path.write_bytes(b"PK\x03\x04" + b"nonsense" * 100)
    with pytest.raises(MeasurementError, match=r"log\.\w+ (cannot be read|holds no)") as caught:
        read_table(path)
    assert "\n" not in str(caught.value)


def test_a_spreadsheet_without_numbers_gets_one_sentence(tmp_path: Path):
    path = tmp_path / "log.xlsx"
    pd.DataFrame({"name": ["a", "b"], "note": ["c", "d"]}).to_excel(path, index=False)
    with pytest.raises(MeasurementError, match="no sheet with a table of numbers"):
        read_table(path)
    assert zipfile.is_zipfile(path)


@pytest.mark.parametrize("suffix", sorted(PACKAGES))
def test_a_format_whose_package_is_absent_names_its_extra(tmp_path: Path, suffix: str, monkeypatch):
    path = tmp_path / f"log{suffix}"
    path.write_bytes(b"MDF     " if suffix == ".dat" else b"nonsense")
    monkeypatch.setattr("importlib.import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    with pytest.raises(MeasurementError, match=rf"install jaxmodel\[{PACKAGES[suffix][1]}\], or export") as caught:
        read_table(path)
    assert ("GPL" in str(caught.value)) == (PACKAGES[suffix][0] == "galvani")


@pytest.mark.parametrize("suffix", [".nda", ".ndax", ".tdms", ".mf4"])
def test_a_damaged_file_of_a_logger_gets_one_sentence(tmp_path: Path, suffix: str):
    pytest.importorskip(PACKAGES[suffix][0])
    path = tmp_path / f"log{suffix}"
    path.write_bytes(b"nonsense" * 50)
    with pytest.raises(MeasurementError) as caught:
        read_table(path)
    assert f"log{suffix} cannot be read by {PACKAGES[suffix][0]}" in str(caught.value)
    assert "\n" not in str(caught.value)


class FakeGalvani:
    """What `galvani` gives of a charge at constant current, for which BioLogic stores no current."""

    def __init__(self, path: str) -> None:
        time_s = np.array([0.0, 10.0, 10.0, 30.0])
        columns = {"time/s": time_s, "control/V/mA": 2.0, "(Q-Qo)/mA.h": 2.0 * time_s / 3600.0, "Ewe/V": 3.7}
        self.data = pd.DataFrame(columns).to_records(index=False)


def test_a_file_of_biologic_without_current_has_the_rate_of_its_charge(tmp_path: Path, monkeypatch):
    path = tmp_path / "log.mpr"
    path.write_bytes(b"nonsense")
    monkeypatch.setitem(sys.modules, "galvani", types.SimpleNamespace(MPRfile=FakeGalvani))
    table = read_table(path)
    np.testing.assert_allclose(table.frame["I/mA"], 2.0)
    assert table.units["I/mA"] == "mA"
    assert "control/V/mA" not in table.frame
    assert table.current_positive_on == "charge"
    assert "rate of its charge" in table.summary()


def test_a_compressed_table_is_read_as_the_table(tmp_path: Path):
    frame = pd.DataFrame({"time_s": np.arange(50.0), "current_A": 1.0, "voltage_V": 3.7 + 0.01 * np.arange(50)})
    frame.to_csv(tmp_path / "log.csv", index=False)
    frame.to_csv(tmp_path / "log.csv.gz", index=False)
    frame.to_parquet(tmp_path / "log.parquet")
    with gzip.open(tmp_path / "log.parquet.gz", "wb") as packed:
        packed.write((tmp_path / "log.parquet").read_bytes())
    for name in ("log.csv.gz", "log.parquet.gz"):
        table = read_table(tmp_path / name)
        pd.testing.assert_frame_equal(table.frame, frame)
        assert table.source == tmp_path / name


def test_a_compressed_file_that_is_cut_or_too_large_or_packed_twice_gets_one_sentence(tmp_path: Path, monkeypatch):
    whole = gzip.compress(b"time_s,voltage_V\n" + b"1,2\n" * 5000)
    for name, content, said in (
        ("cut.csv.gz", whole[: len(whole) // 2], "is damaged or not a gzip file"),
        ("none.csv.gz", b"nonsense", "is damaged or not a gzip file"),
        ("twice.csv.gz.gz", gzip.compress(whole), "is compressed twice"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(MeasurementError, match=said):
            read_table(tmp_path / name)
    monkeypatch.setattr("jaxmodel.data.tables.reading._MOST_BYTES", 1000)
    (tmp_path / "large.csv.gz").write_bytes(whole)
    with pytest.raises(MeasurementError, match="becomes larger than"):
        read_table(tmp_path / "large.csv.gz")


def test_a_wrong_table_in_a_compressed_file_is_named_as_it_would_be_without(tmp_path: Path):
    with gzip.open(tmp_path / "log.csv.gz", "wb") as packed:
        packed.write(b"name,note\na,b\nc,d\n")
    with pytest.raises(MeasurementError, match=rf"{tmp_path.name}/log.csv"):
        read_table(tmp_path / "log.csv.gz")


@pytest.mark.parametrize("form", ["xlsx", "csv"])
def test_names_in_two_lines_with_units_below(tmp_path: Path, form: str):
    head = [
        ["Time", "Electrical", "", "Temperatures", ""],
        ["", "Current", "Voltage", "Cell", "Ambient"],
        ["s", "A", "V", "°C", "°C"],
    ]
    rows = [[float(t), 1.5, 4.1 - 0.001 * t, 24.0 + 0.01 * t, 23.0] for t in range(40)]
    path = tmp_path / f"log.{form}"
    if form == "csv":
        path.write_text("\n".join(",".join(map(str, row)) for row in [*head, *rows]), encoding="utf-8")
    else:
        table = pd.DataFrame([[cell or None for cell in row] for row in head] + rows)
        table.to_excel(path, header=False, index=False, engine="openpyxl")
    table = read_table(path)
    assert list(table.frame) == ["Time", "Current", "Voltage", "Cell", "Ambient"]
    assert table.units == {"Time": "s", "Current": "A", "Voltage": "V", "Cell": "°C", "Ambient": "°C"}
    assert len(table.frame) == 40
