"""Imports while the main thread waits for kernels, which need no interpreter."""

from __future__ import annotations

import importlib
import threading


def import_meanwhile(*modules: str) -> None:
    """Begin to import modules in a thread; who imports one meanwhile waits for it, and sees its errors."""

    def imported() -> None:
        for module in modules:
            importlib.import_module(module)

    threading.Thread(target=imported, daemon=True, name="imports").start()
