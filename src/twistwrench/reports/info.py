"""Function of the command ``info``: contents of a robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.answers.answer import Answer
from ..core.files import as_path, refuse_existing, replacing
from ..core.verdict import Verdict, Word
from ..robot import Robot, load
from .robot_summary import limits_csv, summary

if TYPE_CHECKING:
    from ..core.answers.blocks import Block

__all__ = ["RobotReport", "info"]


@dataclass(frozen=True, eq=False, repr=False)
class RobotReport(Answer):
    """Joints, limits, inertias, masses, frames and tree of a robot; nothing is judged, so the verdict is DONE.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> report = tw.info("planar_2r")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     limits = report.to_csv(f"{folder}/limits.csv").read_text()
    >>> str(report.verdict.word), report.to_dict()["nv"], limits[:5]
    ('DONE', 2, 'joint')
    >>> list(report.tables)[0]
    'Joints: positions in rad, m, velocities in rad/s, m/s, efforts in N m, N'
    """

    robot: Robot
    """The robot."""
    degrees: bool = False
    """True if the report has angles in degrees."""
    call = "info"

    @property
    def verdict(self) -> Verdict:
        """DONE."""
        return Verdict(Word.DONE)

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    def blocks(self) -> Iterator[Block]:
        """Heading, joints, actuators, inertias, tree and notes.

        Returns
        -------
        blocks : iterator of Block
        """
        from .info_view import info_view

        return info_view(self.robot, degrees=self.degrees)

    def sources(self) -> Mapping[str, str | Path]:
        """File of the robot.

        Returns
        -------
        files : {argument: path}

        Examples
        --------
        >>> import twistwrench as tw
        >>> list(tw.info("ur5").sources())
        ['ROBOT']
        """
        return {"ROBOT": self.robot.model.source}

    def to_dict(self) -> dict[str, Any]:
        """Data of the answer, and the entries of :meth:`Robot.info`.

        Returns
        -------
        data : dict, as written by ``--json``
        """
        return {**super().to_dict(), **summary(self.robot)}

    def to_csv(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write joints and limits as a table in SI units and radians, which ``limits=`` reads.

        Parameters
        ----------
        path : str or Path
        overwrite : bool, replace an existing file

        Returns
        -------
        path : Path of the written file

        Raises
        ------
        ValueRangeError
            The file exists, and ``overwrite`` is False.
        """
        target = refuse_existing(as_path(path), overwrite=overwrite)
        with replacing(target) as temporary_file:
            temporary_file.write_text(limits_csv(self.robot), encoding="utf-8", newline="")
        return target


def info(robot: Robot | str | Path, *, degrees: bool = False) -> RobotReport:
    """Show joints, limits, inertias, masses, frames and the tree of a robot.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    degrees : bool, angles of the report are in degrees

    Returns
    -------
    report : RobotReport

    Raises
    ------
    NotFoundError, ModelError
        The file does not exist, or is not a robot.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.info("ur5")
    <RobotReport of ur5: DONE>
    """
    loaded_robot = robot if isinstance(robot, Robot) else load(robot)
    return RobotReport(loaded_robot, degrees)
