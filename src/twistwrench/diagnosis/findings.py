"""Findings of the doctor with their effects, and repairs that edit only the numbers concerned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from ..bodies.inertia import SpatialInertia
from ..core.numbers import number
from ..formats.edit import Edit


class Severity(StrEnum):
    """How much a finding matters."""

    ERROR = "error"
    """What it is about cannot exist, or cannot be read."""
    WARNING = "warning"
    """Very probably not meant, and it changes what is computed."""
    NOTE = "note"


_ALL = 1e8
"""Per cent of what is left, from which a repair takes all inertia that a joint moves."""


@dataclass(frozen=True)
class Effect:
    """Effect of a finding: the largest changes between the file and its repair, over random configurations.

    Attributes
    ----------
    inertia_percent : float, of a diagonal entry of the mass matrix, in percent of the repaired robot's
    inertia_joint : str, whose entry that is; empty where none changes
    torque : float, of a gravity torque or force [N m or N]
    torque_joint : str
    effort_percent : float, of a gravity torque in percent of the joint's effort limit; 0 where no limit is given
    effort_joint : str

    Examples
    --------
    >>> print(Effect(260.0, "wrist_3_joint", 0.0, "", 0.0, ""))
    M of wrist_3_joint by 260 %
    """

    inertia_percent: float = 0.0
    inertia_joint: str = ""
    torque: float = 0.0
    torque_joint: str = ""
    effort_percent: float = 0.0
    effort_joint: str = ""

    def __str__(self) -> str:
        lost = self.inertia_percent >= _ALL
        by = f"M of {self.inertia_joint} " + ("to next to nothing" if lost else f"by {_percent(self.inertia_percent)}")
        said = [by] if self.inertia_joint else []
        if self.torque_joint:
            share = (
                f", {_percent(self.effort_percent)} of the effort of {self.effort_joint}" if self.effort_joint else ""
            )
            said.append(f"g of {self.torque_joint} by {number(self.torque, 3)}{share}")
        return "; ".join(said) or "none"

    def reaches(self, percent: float, effort: float = 1.0) -> bool:
        """Whether an entry of M changes by that much, or a gravity torque by that much of its limit.

        Parameters
        ----------
        percent : float, of M
        effort : float, of the effort limit, percent

        Returns
        -------
        answer : bool

        Examples
        --------
        >>> Effect(3.0, "elbow").reaches(5.0)
        False
        """
        return self.inertia_percent >= percent or self.effort_percent >= effort


@dataclass(frozen=True, eq=False)
class FileRepair:
    """FileRepair of a finding: what it changes, and why.

    Attributes
    ----------
    kind : str, "slip" where one slip explains the numbers, "nearest", "entropic", "shape", "mirror", "number" or "advice"
    sentence : str
    inertias : {link: SpatialInertia} about the link's origin, what they become
    edits : the numbers of the file to change; empty where nothing is written
    metric : str, what "nearest" is measured in
    """

    kind: str
    sentence: str
    inertias: Mapping[str, SpatialInertia] = field(default_factory=dict)
    edits: tuple[Edit, ...] = ()
    metric: str = ""


@dataclass(frozen=True, eq=False)
class Finding:
    """Finding of the doctor.

    Attributes
    ----------
    check : str, name of the check
    severity : Severity
    where : str, the link or joint
    line : int, in the file; 0 where it is not known
    sentence : str, what is wrong
    numbers : {name: float}, what it is judged by
    effect : Effect, between the file and its repair
    repair : FileRepair, or None
    file : str, the included file that the line is of; empty for the robot's own
    """

    check: str
    severity: Severity
    where: str
    line: int
    sentence: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    effect: Effect = Effect()
    repair: FileRepair | None = None
    file: str = ""

    def __str__(self) -> str:
        place = f" ({self.file + ', ' if self.file else ''}line {self.line})" if self.line else ""
        return f"{self.severity}: {self.where}{place}: {self.sentence}"


def _percent(value: float) -> str:
    return f"{number(value, 3)} %" if value < 1e4 else f"a factor of {number(value / 100.0, 2)}"
