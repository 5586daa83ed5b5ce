"""Tables as benches write them: text, spreadsheets, columnar files, MATLAB, and the formats of cyclers.

`read_table` returns the columns as they are, with their units; nothing is renamed or converted. Packages that read a
format are imported when a file of that format is read.
"""

from jaxmodel.data.tables.raw_table import RawTable
from jaxmodel.data.tables.reading import SUFFIXES, read_table

__all__ = ["SUFFIXES", "RawTable", "read_table"]
