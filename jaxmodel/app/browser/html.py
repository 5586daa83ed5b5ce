"""Plain elements of HTML: their text is a text node and never markup, so that what a file says stays text."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui.element import Element
from nicegui.elements.mixins.text_element import TextElement


def h(tag: str, text: str = "", classes: str = "", **attributes: Any) -> TextElement:
    """Return an element of the page.

    Args:
        tag: of HTML.
        text: inside it.
        classes: of workbench.css.
        attributes: as in HTML, with underscores for hyphens; one that is None or False is left out.
    """
    element = TextElement(tag=tag, text=text)
    if classes:
        element.classes(classes)
    change(element, **attributes)
    return element


def change(element: Element, **attributes: Any) -> None:
    """Set attributes of an element; one that is None or False is removed."""
    for name, value in attributes.items():
        if value is not None and value is not False:
            element._props[name.replace("_", "-")] = value
        else:
            element._props.pop(name.replace("_", "-"), None)
    element.update()


def button(text: str, action: Callable[[], Any], classes: str = "button", **attributes: Any) -> TextElement:
    """Return a button that calls an action."""
    return h("button", text, classes, type="button", **attributes).on("click", lambda: action())


def field(label: str, value: str, changed: Callable[[str], None], hint: str = "", **attributes: Any) -> TextElement:
    """Return an input with its label above and a hint beneath; `changed` is told every new value."""
    with h("label", "", "field"):
        h("span", label)
        own = h("input", value=value, **attributes)
        own.on("input", lambda event: changed(str(event.args)), js_handler="(e) => emit(e.target.value)")
        if hint:
            h("small", hint)
    return own


def select(
    label: str, options: dict[str, str], value: str, changed: Callable[[str], None], hint: str = ""
) -> TextElement:
    """Return a choice with its label above; `options` are words by value."""
    with h("label", "", "field"):
        h("span", label)
        own = h("select")
        own.on("change", lambda event: changed(str(event.args)), js_handler="(e) => emit(e.target.value)")
        with own:
            for name, words in options.items():
                h("option", words, value=name, selected=name == value)
        if hint:
            h("small", hint)
    return own


def duration(seconds: float) -> str:
    """Return a time for a person: 42 s, 12 min, 3.4 h, 2.1 days."""
    for limit, size, unit in ((120.0, 1.0, "s"), (7200.0, 60.0, "min"), (172_800.0, 3600.0, "h")):
        if seconds < limit:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 86_400.0:.3g} days"


def counted(count: int, what: str) -> str:
    """Return '1 run' or '3 runs'."""
    return f"{count} {what}{'s' * (count != 1)}"


def size_words(count: int) -> str:
    """Return a size for a person: 12 kB, 3.4 MB."""
    if count < 1000:
        return f"{count} B"
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.3g} kB"
