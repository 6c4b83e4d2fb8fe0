"""Checks of the doctor: names and functions from the parsed file to findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from ..entry_errors import Options
from ..findings import Finding
from ..parsed_file import ParsedFile
from .inertia import check_impossible, check_too_large, check_too_small
from .joints import (
    check_axis,
    check_degrees,
    check_effort,
    check_friction,
    check_limits,
    check_mimic,
    check_placeholder_limits,
)
from .masses import (
    check_assumed,
    check_com,
    check_density,
    check_light,
    check_massless,
    check_mirror,
    check_no_inertia,
    check_no_mass,
    check_placeholder,
    check_units,
)  # fmt: skip

__all__ = ["CHECKS", "Options"]

CHECKS: Mapping[str, Callable[[ParsedFile, Options], Iterator[Finding]]] = {
    "impossible": check_impossible,
    "too-large": check_too_large,
    "too-small": check_too_small,
    "placeholder": check_placeholder,
    "no-inertia": check_no_inertia,
    "no-mass": check_no_mass,
    "massless": check_massless,
    "assumed": check_assumed,
    "com-outside": check_com,
    "density": check_density,
    "light": check_light,
    "units": check_units,
    "mirror": check_mirror,
    "mimic": check_mimic,
    "degrees": check_degrees,
    "limits": check_limits,
    "effort": check_effort,
    "placeholder-limits": check_placeholder_limits,
    "axis": check_axis,
    "friction": check_friction,
}
"""Checks by name, in the order of reports."""
