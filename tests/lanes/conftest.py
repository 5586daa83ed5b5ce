"""Kernels are tested as users have them, not as quickly as other tests compile them."""

from __future__ import annotations

import pytest

from jaxmodel.lanes import machine


@pytest.fixture(autouse=True)
def as_users_have_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "is_quick", lambda: False)
