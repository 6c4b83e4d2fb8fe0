"""The doctor: all checks on one robot file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..core import arguments
from ..robot import Robot
from .checks import CHECKS, Options
from .findings import Finding, Severity
from .nearest import METRICS
from .reading import MOST_BODIES, read_subject
from .report import DoctorReport

_ORDER = list(Severity)


def doctor(
    robot: str | Path | Robot,
    *,
    only: str | Sequence[str] | None = None,
    meshes: bool | Sequence[str | Path] = True,
    metric: str = "frobenius",
    mirror_from: str | None = None,
    floating_base: bool | None = None,
    model: str | None = None,
    max_bodies: int = MOST_BODIES,
) -> DoctorReport:
    """What is wrong with a robot file, what it does to the dynamics, and how it is repaired.

    Parameters
    ----------
    robot : str, Path or Robot, a URDF, MJCF or SDF file, its text, or a robot, whose file is read again if it has one
    only : str or sequence of str, optional, names of the checks to run; None: all
    meshes : bool or sequence of folders, whether mesh files are opened, and where they may be besides
    metric : "frobenius" or "entropic", in which the nearest tensor is looked for where no one slip explains the numbers
    mirror_from : "left" or "right", optional, the side that is copied, mirrored, where two sides are no mirror images
    floating_base : bool, optional, let the root link float, so that its own inertia counts; None: as the file says
    model : str, optional, look at one model of an SDF world
    max_bodies : int, more are refused

    Returns
    -------
    report : DoctorReport
        Its ``findings`` are ordered by severity, then by what they change.

    Raises
    ------
    NotFoundError
        There is no such file.
    ModelError
        It cannot be read, or makes no robot.
    ValueRangeError
        There is no such check or metric.

    Notes
    -----
    The effect of a finding is the largest change of a diagonal entry of the mass matrix and of a gravity torque over 200
    seeded configurations, between the file and its repair. A severity follows from it.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.doctor(tw.robots.path_of("ur5"), only="impossible").summary
    'nothing found'
    """
    names = list(CHECKS) if only is None else [only] if isinstance(only, str) else list(only)
    for one in names:
        arguments.choice(one, "doctor: only", list(CHECKS))
    side = "" if mirror_from is None else arguments.choice(mirror_from, "doctor: mirror_from", ("left", "right"))
    options = Options(arguments.choice(metric, "doctor: metric", list(METRICS)), side)
    subject = read_subject(robot, meshes=meshes, floating_base=floating_base, model=model, max_bodies=max_bodies)
    findings = [finding for one in names for finding in CHECKS[one](subject.robot, options)]
    name = subject.robot.model.name
    source = str(subject.path) if subject.path is not None else "the text given" if subject.text else name
    return DoctorReport(name, source, tuple(sorted(findings, key=_rank)), tuple(names), subject)


def _rank(finding: Finding) -> tuple[int, float]:
    effect = finding.effect
    return _ORDER.index(finding.severity), -max(effect.inertia_percent, effect.effort_percent)
