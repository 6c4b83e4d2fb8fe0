"""The doctor of robot files: checks, the effect of what they find, and repairs in the file itself."""

from .checks import CHECKS
from .examination import doctor
from .findings import Edit, Effect, FileRepair, Finding, Place, Severity
from .nearest import METRICS
from .report import DoctorReport

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
