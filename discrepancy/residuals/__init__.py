"""Residuals of a model: where it fails and by how much, as sentences."""

from __future__ import annotations

from discrepancy.residuals.regimes import Bins, Regimes, cut, regimes
from discrepancy.residuals.statement import Statement
from discrepancy.residuals.statements import Account, account, statements
from discrepancy.residuals.table import ChannelResiduals

__all__ = [
    "Account",
    "Bins",
    "ChannelResiduals",
    "Regimes",
    "Statement",
    "account",
    "cut",
    "regimes",
    "statements",
]
