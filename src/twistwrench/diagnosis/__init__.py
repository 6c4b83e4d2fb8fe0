"""Doctor of robot files: checks, effects of findings, and repairs of the file."""

from ..formats.edit import Edit
from ..formats.xml import Place
from ..shapes.solids import METRICS
from .checks import CHECKS
from .findings import Effect, FileRepair, Finding, Severity
from .report import DoctorReport, doctor

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
