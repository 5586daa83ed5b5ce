"""What the tables by name of a study file share: quotes around names with a dot."""

from collections.abc import Collection, Mapping
from typing import Any

from jaxmodel.base.forms import wrong


def refuse_unquoted_names(table: Any, known: Collection[str] = ()) -> Any:
    """Return a table by name as it is, unless TOML made a table of a dotted name that has no quotes."""
    for name, entry in table.items() if isinstance(table, Mapping) else ():
        if isinstance(entry, Mapping) and entry and not set(entry) & set(known):
            raise wrong(
                'has a name with a dot and no quotes around it; write "{name}.{inner}" = ...',
                name=name,
                inner=next(iter(entry)),
            )
    return table
