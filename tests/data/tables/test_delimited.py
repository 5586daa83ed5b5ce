"""Text of any delimiter, encoding, decimal mark and header gives the same table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel import read_table
from jaxmodel.base.errors import MeasurementError

NAMES = ["Zeit (s)", "Strom (mA)", "Spannung (V)", "Temperatur (°C)"]
numbers = st.floats(-1e5, 1e5, allow_nan=False).map(lambda value: round(value, 6))


def text_of(rows: list[tuple[float, ...]], delimiter: str, decimal: str, before: int, missing: str) -> str:
    lines = [f"parameter {n} : {n}" for n in range(before)]
    lines.append(delimiter.join(NAMES))
    for n, row in enumerate(rows):
        fields = [repr(float(n)), *(repr(value) for value in row)]
        lines.append(delimiter.join(field.replace(".", decimal) for field in fields))
    lines.append(delimiter.join([repr(float(len(rows))).replace(".", decimal), missing, "1", "1"]))
    return "\n".join(lines) + "\n"


@given(
    rows=st.lists(st.tuples(numbers, numbers, numbers), min_size=3, max_size=12),
    delimiter=st.sampled_from([",", ";", "\t", "|"]),
    decimal=st.sampled_from([".", ","]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16"]),
    before=st.sampled_from([0, 1, 7, 300]),
    missing=st.sampled_from(["", "NaN", "n/a"]),
)
def test_any_form_gives_the_same_numbers(tmp_path_factory, rows, delimiter, decimal, encoding, before, missing):
    if delimiter == decimal:
        decimal = "."
    path = tmp_path_factory.mktemp("text") / "log.txt"
    path.write_bytes(text_of(rows, delimiter, decimal, before, missing).encode(encoding))
    table = read_table(path)
    assert list(table.frame) == NAMES
    assert dict(table.units) == {"Zeit (s)": "s", "Strom (mA)": "mA", "Spannung (V)": "V", "Temperatur (°C)": "°C"}
    read = table.frame.to_numpy()
    np.testing.assert_array_equal(read[:-1, 1:], rows)
    assert np.isnan(read[-1, 1])


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("# time current\n0.0 1.5\n0.1 1.6\n0.2 1.7\n", ["time", "current"]),
        ("t;U\ns;V\n0,0;3,5\n1,0;3,4\n2,0;3,3\n", ["t", "U"]),
        ("0.0,3.5\n1.0,3.4\n2.0,3.3\n", ["column 1", "column 2"]),
        ("a,b,\n0.0,3.5,\n1.0,3.4,\n2.0,3.3,\n", ["a", "b", "column 3"]),
        ('"time","n"\n"0.0","1,200"\n"1.0","1,201"\n"2.0","2,202.5"\n', ["time", "n"]),
    ],
    ids=["comment as header", "units in a line of their own", "no header", "delimiter at the end", "thousands"],
)
def test_usual_forms_of_headers(tmp_path: Path, text: str, columns: list[str]):
    path = tmp_path / "log.csv"
    path.write_text(text)
    table = read_table(path)
    assert list(table.frame) == columns
    assert len(table.frame) == 3
    assert np.isfinite(table.frame[columns[1]].to_numpy(dtype=float)).all()


def test_text_among_numbers_is_missing_and_said(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("t,u\n" + "".join(f"{n}.0,{'OVRFLW' if n == 500 else n}\n" for n in range(1000)))
    table = read_table(path)
    assert np.isnan(table.frame.u[500])
    assert np.isfinite(table.frame.u.drop(500)).all()
    assert any("1 field is no number" in remark and "row 501" in remark for remark in table.losses)


def test_a_line_with_other_fields_is_left_out_and_said(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("t,u\n" + "".join(f"{n}.0,{n}\n" if n != 700 else "stopped by operator\n" for n in range(1000)))
    table = read_table(path)
    assert len(table.frame) == 999
    assert any("1 line was left out" in remark for remark in table.losses)


def test_a_line_left_out_of_a_table_between_blanks_is_said(tmp_path: Path):
    path = tmp_path / "log.txt"
    path.write_text("t u\n" + "".join(f"{n}.0 {n}\n" if n != 700 else "7 7 7 7\n" for n in range(1000)))
    table = read_table(path)
    assert len(table.frame) == 999
    assert any("1 line was left out" in remark for remark in table.losses)


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (b"", ["empty", "export"]),
        (b"just a letter\nto a friend\n", ["no rows of numbers"]),
        (b"\x00\x01\x02\x03binary\x00", ["not text"]),
    ],
)
def test_what_is_no_table_gets_one_sentence(tmp_path: Path, content: bytes, parts: list[str]):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(MeasurementError) as caught:
        read_table(path)
    for part in ["log.csv", *parts]:
        assert part in str(caught.value)
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_a_column_that_is_not_there_is_named_with_those_that_are(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("t,u\n0.0,1\n1.0,2\n")
    assert list(read_table(path, columns=["u"]).frame) == ["u"]
    with pytest.raises(MeasurementError, match="no column 'v'; it has t, u"):
        read_table(path, columns=["v"])
    with pytest.raises(MeasurementError, match="no file"):
        read_table(tmp_path / "absent.csv")
