"""Residuals are complete: every reading has its run, time and conditions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.residuals.made_residuals import constant_currents


def test_columns_of_unequal_length_and_missing_values_are_refused() -> None:
    residuals = constant_currents(lambda run, number: 0.0)
    with pytest.raises(ValueError, match="shape"):
        dataclasses.replace(residuals, weight_s=residuals.weight_s[1:])
    with pytest.raises(ValueError, match="missing"):
        dataclasses.replace(residuals, error=np.where(residuals.run == 0, np.nan, residuals.error))
