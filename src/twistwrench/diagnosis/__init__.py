"""Doctor of robot files: checks, the effect of findings, and repairs in the file itself."""

from ..formats.edit import Edit
from ..formats.xml import Place
from .checks import CHECKS
from .findings import Effect, FileRepair, Finding, Severity
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
