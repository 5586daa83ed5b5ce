"""What a model leaves of the readings: where it fails and by how much, in words and tables; plain arrays."""

from __future__ import annotations

from discrepancy.residuals.regimes import Bins, Regimes, cut, regimes
from discrepancy.residuals.statement import Statement
from discrepancy.residuals.statements import Account, account, statements
from discrepancy.residuals.summary import error_table
from discrepancy.residuals.table import ChannelResiduals

__all__ = [
    "Account",
    "Bins",
    "ChannelResiduals",
    "Regimes",
    "Statement",
    "account",
    "cut",
    "error_table",
    "regimes",
    "statements",
]
