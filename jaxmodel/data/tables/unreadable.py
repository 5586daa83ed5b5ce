"""Files of known formats that are not read, by their first bytes: what each is, and what to do with it."""

from __future__ import annotations

from pathlib import Path

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label

_DECODE = "decode it with blackbox_decode, or export it as CSV from the Blackbox Explorer, and give the CSV"
_STARTS = {
    b"H Product:Blackbox": f"is a binary log of a blackbox; {_DECODE}",
}
_ENDINGS = {
    ".bbl": f"is a binary log of a blackbox; {_DECODE}",
    ".bfl": f"is a binary log of a blackbox; {_DECODE}",
}  # fmt: skip


def refuse_unreadable(path: Path) -> None:
    """Raise MeasurementError for a file of a format that is known and not read.

    Raises:
        MeasurementError: it is; the sentence says how its readings can be had.
    """
    with path.open("rb") as stream:
        start = stream.read(64)
    found = next((what for mark, what in _STARTS.items() if start.startswith(mark)), _ENDINGS.get(path.suffix.lower()))
    if found is not None:
        raise MeasurementError(f"{file_label(path)} {found}.")
