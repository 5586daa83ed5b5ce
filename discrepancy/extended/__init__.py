"""The model that a diagnosis ends with, as a case: calibrated numbers, effects and corrected tables."""
