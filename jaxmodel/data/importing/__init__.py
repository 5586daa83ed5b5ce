"""Raw files of a bench as a case: columns, units, signs, clocks and runs are found, decided and written down.

    from jaxmodel import import_case

    imported = import_case(["cycle_1.xlsx", "cycle_2.xlsx"], kind="cell", ambient=25.0)
    print(imported.summary())
    imported.write("my_cell")  # case.toml, a CSV for each run, import.json

The room is private: users import `import_case` and what it takes and returns from `jaxmodel`.
"""

from jaxmodel.data.importing.findings import Decision, Finding, Question
from jaxmodel.data.importing.imported import Imported, ImportedRun
from jaxmodel.data.importing.importer import import_case
from jaxmodel.data.importing.options import Options

__all__ = ["Decision", "Finding", "Imported", "ImportedRun", "Options", "Question", "import_case"]
