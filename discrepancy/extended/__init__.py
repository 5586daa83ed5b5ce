"""The model that an investigation ends with, as a case: calibrated numbers, effects and corrected tables."""

from discrepancy.extended.case import extended_case

__all__ = ["extended_case"]
