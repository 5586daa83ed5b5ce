"""What the tables of a study file share: unknown keys, quotes around dotted names, one sentence for a mistake."""

from collections.abc import Collection, Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from jaxmodel.errors import nearest


def wrong(sentence: str, **details: Any) -> PydanticCustomError:
    """Return an error whose text is ours; `{name}` in it stands for a detail."""
    return PydanticCustomError("form", sentence, details)  # type: ignore[arg-type]


class Form(BaseModel):
    """A table of the file. A key that it does not know is an error that names the nearest one."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _reject_unknown_keys(cls, raw: Any) -> Any:
        if cls.model_config.get("extra") == "forbid":
            for key in raw if isinstance(raw, Mapping) else ():
                if key not in cls.model_fields:
                    hint = nearest(key, cls.model_fields) or " Remove it."
                    raise wrong("knows no '{key}'.{hint}", key=key, hint=hint)
        return raw


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


def complaint(error: ValidationError) -> str:
    """Return the first of pydantic's findings as one sentence that starts with the path of the field."""
    first, *others = error.errors(include_url=False)
    place = ""
    for key in first["loc"]:
        place += f"[{key + 1}]" if isinstance(key, int) else f".{key}"  # a person counts from 1
    what = first["msg"].removeprefix("Input ")
    if first["type"] == "missing":
        what = "is missing; add it"
    elif first["type"] == "too_short":
        what = "must not be empty"
    elif first["type"] != "form":
        what += f", not {_shown(first['input'])}"
    more = f" (and {len(others)} more)" if others else ""
    end = "" if what.endswith((".", "?")) else "."
    return f"{place.removeprefix('.') or 'the study'} {what}{more}{end}"


def _shown(value: Any) -> str:
    """Return a value cut short, in double quotes where it is text."""
    text = str(value) if len(str(value)) <= 60 else f"{str(value)[:60]}..."
    return f'"{text}"' if isinstance(value, str) else text
