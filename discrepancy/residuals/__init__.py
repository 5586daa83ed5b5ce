"""What a model leaves of the readings: where it fails and by how much, in words, tables and maps; plain arrays."""

from __future__ import annotations

from discrepancy.residuals.maps import MapCell, Profile, map_over_two, maps, profile
from discrepancy.residuals.regimes import Bins, Regimes, cut, regimes
from discrepancy.residuals.statement import Statement
from discrepancy.residuals.statements import Account, account, statements
from discrepancy.residuals.summary import error_table
from discrepancy.residuals.table import ChannelResiduals

__all__ = [
    "Account",
    "Bins",
    "ChannelResiduals",
    "MapCell",
    "Profile",
    "Regimes",
    "Statement",
    "account",
    "cut",
    "error_table",
    "map_over_two",
    "maps",
    "profile",
    "regimes",
    "statements",
]
