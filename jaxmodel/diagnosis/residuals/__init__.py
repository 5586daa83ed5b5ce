"""Residuals of a model: where it fails and by how much, as sentences."""

from __future__ import annotations

from jaxmodel.diagnosis.residuals.regimes import Bins, Regimes, cut, regimes
from jaxmodel.diagnosis.residuals.statement import Statement
from jaxmodel.diagnosis.residuals.statements import Account, account, statements
from jaxmodel.diagnosis.residuals.table import ChannelResiduals

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
