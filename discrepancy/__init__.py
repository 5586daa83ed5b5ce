"""Model against measurement: where it fails, what it is missing, which tables are off, and what remains."""

from discrepancy.diagnosis import compare, diagnose
from discrepancy.investigation import Investigation
from discrepancy.result import Diagnosis, answer

__all__ = ["Diagnosis", "Investigation", "answer", "compare", "diagnose"]
