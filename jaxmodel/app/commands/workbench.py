"""`jaxmodel workbench`: the whole job in a browser, on loopback."""

from __future__ import annotations

import importlib.util
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any

LOOPBACK = ("127.0.0.1", "localhost", "::1")
_LEAST_TOKEN = 12
# What the extra brings.
_NEEDED = ("nicegui", "tsdownsample", "fastapi")


def open_workbench(
    data: Sequence[Path],
    kind: str,
    ambient: float | None,
    *,
    host: str,
    port: int,
    token: str | None,
    folder: Path | None,
    show: bool,
    forget_days: float | None = None,
) -> None:
    """Serve the workbench until it is interrupted.

    Args:
        data: a case, raw files of a bench, or nothing.
        kind: of what raw files measured.
        ambient: temperature of all runs in raw files [degC].
        host: address to listen on.
        port: to listen on.
        token: that lets a browser in.
        folder: for the sessions.
        show: open the page.
        forget_days: remove the sessions that have not been used for so many days; None to keep all.

    Raises:
        UserError: what it needs is not installed, the port is taken, or a word or file cannot be used.
    """
    if any(importlib.util.find_spec(name) is None for name in _NEEDED):
        raise _mistake(
            "The workbench needs packages that are not installed; install jaxmodel with its extra: "
            "pip install 'jaxmodel[workbench]'."
        )
    if host not in LOOPBACK and token is None:
        raise _mistake(
            f"--host {host}: others can reach this address, so the workbench needs a word that lets them in; give "
            f"--token WORD of at least {_LEAST_TOKEN} letters."
        )
    if token is not None and len(token) < _LEAST_TOKEN:
        raise _mistake(f"--token: {len(token)} letters are too easily guessed; give at least {_LEAST_TOKEN}.")
    opening = first_job(data, kind, ambient)
    _check_port(host, port)
    from jaxmodel.app.browser.server import serve

    place = folder or Path.home() / ".jaxmodel" / "workbench"
    serve(place.resolve(), host=host, port=port, token=token, show=show, opening=opening, forget_days=forget_days)


def first_job(data: Sequence[Path], kind: str, ambient: float | None) -> dict[str, Any] | None:
    """Return the job that opens what the command line names; None for nothing.

    Raises:
        UserError: it is not there.
    """
    for path in data:
        if not path.exists():
            raise _mistake(f"{path} does not exist; name a case or the files of a bench.")
    if not data:
        return None
    if len(data) == 1 and ((data[0] / "case.toml").is_file() or data[0].suffix.lower() == ".toml"):
        return {"do": "open", "with": {"path": str(data[0].resolve()), "how": "case"}}
    inside = [file for path in data for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
    files = [str(file.resolve()) for file in inside if file.is_file() and not file.name.startswith(".")]
    return {"do": "import", "with": {"files": files, "kind": kind, "options": {"ambient": ambient}}}


def _mistake(sentence: str) -> Exception:
    """Return a user's mistake; the model, which takes seconds to load, is imported for no other reason."""
    from jaxmodel.base.errors import UserError

    return UserError(sentence)


def _check_port(host: str, port: int) -> None:
    """Refuse a port that something else listens on."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind((host, port))
        except OSError as error:
            raise _mistake(f"--port {port}: {str(error.strerror).lower()}; give another port.") from error
