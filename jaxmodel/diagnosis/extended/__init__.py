"""The model that an investigation ends with, as a case: calibrated numbers, effects and corrected tables."""

from jaxmodel.diagnosis.extended.case import extended_case

__all__ = ["extended_case"]
