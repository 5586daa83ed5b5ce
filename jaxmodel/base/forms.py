"""What the forms of case, preset, study and mission files share: unknown keys, and one sentence for each violation."""

import datetime
from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from jaxmodel.base.errors import instead


def wrong(sentence: str, **details: Any) -> PydanticCustomError:
    """Return an error whose text is ours; `{name}` in it stands for a detail."""
    return PydanticCustomError("form", sentence, details)  # type: ignore[arg-type]


class Form(BaseModel):
    """A table of a file. A key that it does not know is an error that names the nearest one.

    A form with `extra="allow"` takes those in `further_keys` too, or any where there are none.
    """

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)
    further_keys: ClassVar[Collection[str]] = ()

    @model_validator(mode="before")
    @classmethod
    def _reject_unknown_keys(cls, raw: Any) -> Any:
        known = (*cls.model_fields, *cls.further_keys)
        if cls.model_config.get("extra") == "forbid" or cls.further_keys:
            for key in raw if isinstance(raw, Mapping) else ():
                if key not in known:
                    raise wrong("knows no '{key}'.{hint}", key=key, hint=instead(str(key), known))
        return raw


def complaint(error: ValidationError, raw: Any, whole: str) -> str:
    """Return the first violation as a sentence that starts with its place, and the number of others.

    Args:
        error: from pydantic.
        raw: the content that was checked.
        whole: names the content, for a violation that has no place in it.
    """
    first, *others = error.errors(include_url=False)
    sentence = f"{_place(first, raw) or whole} {_what(first)}"
    if others:
        sentence += f" (and {len(others)} more error{'s' if len(others) > 1 else ''})"
    return sentence if sentence.endswith((".", "?")) else f"{sentence}."


def _place(error: ErrorDetails, raw: Any) -> str:
    """Return the path of a field as a person writes it, counted from 1."""
    place = ""
    for step in error["loc"]:
        if isinstance(step, int):
            place += f"[{step + 1}]"
            raw = raw[step] if isinstance(raw, Sequence) and step < len(raw) else None
        elif isinstance(raw, Mapping) and step in raw:
            place += f".{step}"
            raw = raw[step]
        elif error["type"] == "missing" or error["input"] is not raw:  # else the step is a type that pydantic tried
            place += f".{step}"
            raw = None
    return place.removeprefix(".")


def _what(error: ErrorDetails) -> str:
    """Return what one field must be."""
    found, context = shown(error["input"]), error.get("ctx", {})
    match error["type"]:
        case "form":
            return error["msg"]
        case "missing":
            return "is missing; add it"
        case "literal_error":
            return f"must be {context['expected'].replace(chr(39), chr(34))}, not {found}"
        case "float_type":
            return f"must be a number{', without quotes' if isinstance(error['input'], str) else ''}, not {found}"
        case "int_type" | "int_from_float":
            return f"must be a whole number, not {found}"
        case "finite_number":
            return f"must be a finite number, not {found}"
        case "greater_than":
            return f"must be greater than {context['gt']:g}, not {found}; correct it or leave it out"
        case "greater_than_equal":
            return f"must be at least {context['ge']:g}, not {found}"
        case "less_than_equal":
            return f"must be at most {context['le']:g}, not {found}"
        case "string_type":
            return f"must be text in quotes, not {found}"
        case "too_short" | "string_too_short":
            return "must not be empty"
        case "list_type":
            return f"must be a list in brackets, not {found}"
        case "model_type" | "dict_type" | "mapping_type":
            return f"must be a table, {{ name = value }}, not {found}"
    return f"is wrong ({error['msg']}), not {found}; correct it"


def shown(value: Any) -> str:
    """Return a value as written in the file, shortened."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    text = str(value)
    text = text if len(text) <= 60 else f"{text[:60]}..."
    return f'"{text}"' if isinstance(value, str) else text
