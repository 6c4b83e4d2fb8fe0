"""The doctor of robot files: checks, the effect of what they find, and repairs in the file itself."""

from .checks import CHECKS
from .findings import Edit, Effect, FileRepair, Finding, Place, Severity
from .report import DoctorReport, doctor
from .shapes import METRICS

__all__ = [
    "CHECKS",
    "METRICS",
    "DoctorReport",
    "Edit",
    "Effect",
    "FileRepair",
    "Finding",
    "Place",
    "Severity",
    "doctor",
]
