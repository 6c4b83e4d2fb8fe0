"""Result of a calibration: verdict, corrected robot, groups with intervals, held-out and remaining error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt, verdict_from_doubts
from ..core.numbers import number
from ..core.tables import csv_table
from ..core.text import argument
from ..core.typing import Array
from ..core.verdict import Verdict, refuse_to_write
from ..mechanics.lie import se3
from ..motion.limits_file import robot_origin
from ..robot import Robot
from .fit import CalibrationFit
from .groups import ParameterGroup, ParameterGroups, Remaining
from .held_out import HeldOutError
from .targets import FrameTarget, rigid_motion

if TYPE_CHECKING:
    from ..core.answers.page import Setting

_MIN_STATED_SHIFT = 1e-6
"""Smallest displacement of the tip [m] about which there is a note, if no file can have it."""
_MIN_GAIN = 3.0
"""Ratio of the tip's error by the file's tolerances to its error now, from which the file needs no correction."""
_MAX_RATIO_TO_FLOOR = 2.0
"""Largest ratio of the error before calibration to the smallest that readings can show, with which nothing is to correct."""
PREFIX = "calibration-"
"""Beginning of the doubts' names in the table."""


@dataclass(frozen=True, eq=False, repr=False)
class CalibratedRobot(Answer):
    """Arm whose geometry was fitted to measurements: result of :func:`twistwrench.calibration.calibrate`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> found = tw.calibration.calibrate("ur5", "demo")
    >>> found
    OK: the tip is right to 0.098 mm (rms, held out), 3.34 mm before; largest: zero of elbow_joint off by -0.2393 ± 0.0040°.
    >>> found.rank, found.groups[0], found.robot.nq, len(found.outliers), found.facts()["held out"]
    (27, 'tip.x - 0.0299 wrist_3_joint.zero', 6, 0, '0.098 mm')
    >>> found.interval().shape, found.remaining_at(np.zeros((2, 6))).shape, found.tables["Groups"].columns[0][0]
    ((21, 2), (2,), 'group')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found.write(f"{folder}/mine.urdf").name, found.to_csv(f"{folder}/residuals.csv").name
    ('mine.urdf', 'residuals.csv')
    """

    call: ClassVar[str] = "calibrate"

    original: Robot
    """Robot with the geometry in its file."""
    fit: CalibrationFit
    """Fit of the geometry, with its linearisation."""
    plain: CalibrationFit
    """Fit of targets and tip alone, with the geometry in the file."""
    held_out: HeldOutError
    """Error of readings that were not used in their fits."""
    doubts: tuple[Doubt, ...]
    """Reasons against OK, and notes; the most severe first."""
    file_accuracy: tuple[float, float]
    """Standard deviations of the file's lengths [m] and axes [rad]."""
    reference: Array
    """(500, nq) configurations of :attr:`remaining`."""
    settings: Mapping[str, Any]
    """Options of the call."""
    files: Mapping[str, str]
    """Files of the measurements, by the argument that names them."""

    # ── What was found

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.original.name

    @property
    def subject(self) -> str:
        """Robot and number of readings."""
        readings = [f"{measurement.count} of kind {measurement.kind}" for measurement in self.fit.problem.measured]
        return f"{self.original.name} · readings: {' and '.join(readings)}"

    @cached_property
    def robot(self) -> Robot:
        """Robot with the corrected geometry, at configurations without gear error and sag."""
        return self.fit.problem.chain.calibrated_robot(self.fit.state.corrections)

    @cached_property
    def parameter_groups(self) -> ParameterGroups:
        """Groups of parameters that the measurements determine."""
        return ParameterGroups(self.fit)

    @cached_property
    def _group_list(self) -> list[ParameterGroup]:
        """Groups of the chain's parameters, without targets."""
        return self.parameter_groups.all

    @property
    def rank(self) -> int:
        """Number of groups, including the targets' unknowns."""
        return self.parameter_groups.rank

    @property
    def theory(self) -> int:
        """Number of groups that many different readings of these kinds determine."""
        return self.parameter_groups.theory

    @property
    def groups(self) -> list[str]:
        """Names of the groups without the targets' unknowns: ``joint_2.zero + 3.7 joint_3.x``."""
        return [group.text for group in self._group_list]

    @property
    def values(self) -> Array:
        """(k,) values of the groups [rad, m]."""
        return np.array([group.value for group in self._group_list])

    @property
    def standard_deviations(self) -> Array:
        """(k,) standard deviations of the groups."""
        return np.array([group.deviation for group in self._group_list])

    def interval(self, level: float = 0.95) -> Array:
        """Intervals of the groups, with Student's quantiles.

        Parameters
        ----------
        level : float

        Returns
        -------
        bounds : (k, 2) array [rad, m]
        """
        half_widths = np.array([group.half_width(level) for group in self._group_list])
        return np.stack([self.values - half_widths, self.values + half_widths], axis=1)

    def _joint_estimates(self, kind: str) -> dict[str, tuple[float, float]]:
        """Value and half width by joint, of the groups led by a parameter of a kind: ``zero``, ``sag`` or ``gear``."""
        ending = f".{kind}"
        estimates = {}
        for group in self._group_list:
            if group.name.endswith(ending):
                joint = group.name.removesuffix(ending)
                estimates[joint] = (group.value, group.half_width())
        return estimates

    @property
    def zeros(self) -> dict[str, tuple[float, float]]:
        """Offset of each joint's zero, and half its 95 % interval [rad or m].

        Zeros that cannot be distinguished from the mounting of the target are left out, such as the zero of the last joint
        if poses are measured.
        """
        return self._joint_estimates("zero")

    @property
    def sag(self) -> dict[str, tuple[float, float]]:
        """Compliance of each joint [rad/(N m)], and half its interval; empty unless assumed."""
        return self._joint_estimates("sag")

    @property
    def gears(self) -> dict[str, tuple[float, float]]:
        """Error of each gear, as a share, and half its interval; empty unless assumed."""
        return self._joint_estimates("gear")

    @property
    def tip_pose(self) -> Array:
        """(4, 4) pose of the target on the robot in its last moving link."""
        return self.fit.state.corrections.tip

    @property
    def tip_note(self) -> str:
        """Sentence on a displacement of the tip that no file can have; empty if :attr:`robot` has it."""
        chain = self.fit.problem.chain
        start_to_tip = np.asarray(se3.inverse(chain.start.tip)) @ self.tip_pose
        shift = start_to_tip[:3, 3]
        if chain.moves_tip or not np.linalg.norm(shift) > _MIN_STATED_SHIFT:
            return ""
        shift_in_mm = ", ".join(number(1e3 * x, 3) for x in shift)
        return (
            f"The target is at ({shift_in_mm}) mm in {chain.frame}. A file cannot have this displacement, as {chain.frame} is "
            f"the frame of {chain.joints[-1]}: in a written robot the target is at .tip_pose. "
            f"To have it written, name a frame that is fixed to the link: {argument('tip', 'FRAME')}."
        )

    @property
    def target_pose(self) -> Array:
        """(4, 4) pose by the first measurement: of the base in the tracker's frame, or of the target's centre in the base."""
        return self.fit.state.targets[0].frame()

    @property
    def outliers(self) -> list[tuple[int, float]]:
        """Row (from 0) and error [m] of each left-out reading that contradicts the others; the largest error first."""
        return [(row, error) for _, row, error in self.fit.outliers]

    @property
    def residuals(self) -> list[Array]:
        """(m, r) residuals of each measurement [rad, m]."""
        return list(self.fit.equations.residuals)

    # ── What the file and the readings leave

    @property
    def measures_tip(self) -> bool:
        """True if all readings are poses or positions of the tip; False if some are distances or touches."""
        # only measurements of poses and positions have points
        return all(len(measurement.points) for measurement in self.fit.problem.measured)

    @cached_property
    def errors_before(self) -> Array:
        """Sizes [m] of the residuals of all readings, with the geometry in the file."""
        return np.concatenate(self.plain.errors)

    @property
    def error_vectors(self) -> tuple[Array, Array, Array]:
        """Measured points, and their errors before and after calibration, (n, 3) each, in the base frame [m].

        Only readings of poses and positions have error vectors; others are left out.
        """
        no_rows = np.zeros((0, 3))  # concatenate needs an array, also without poses and positions
        points = [no_rows]
        before = [no_rows]
        after = [no_rows]
        for k, target in enumerate(self.fit.state.targets):
            target_before = self.plain.state.targets[k]
            if not isinstance(target, FrameTarget) or not isinstance(target_before, FrameTarget):
                continue
            # X maps the base to the tracker's frame. A row times R is R' times the vector: back to the base.
            R, p = target.X[:3, :3], target.X[:3, 3]
            R_before = target_before.X[:3, :3]
            points.append((target.given.points - p) @ R)
            # the last three residuals of a reading are those of its position
            before.append(self.plain.equations.residuals[k][:, -3:] @ R_before)
            after.append(self.fit.equations.residuals[k][:, -3:] @ R)
        return np.concatenate(points), np.concatenate(before), np.concatenate(after)

    @cached_property
    def before(self) -> float:
        """Error [m] (rms) of the used readings with the geometry in the file, if target and tip are fitted."""
        is_used = np.concatenate([W[:, -1] > 0 for W in self.fit.weights])
        return float(np.sqrt(np.mean(self.errors_before[is_used] ** 2)))

    @cached_property
    def remaining_before(self) -> float:
        """Predicted error of the tip [m] (rms) with the geometry in the file.

        Its square is the sum of two squares: change by the calibration, without rigid motion of the base; and remaining error.
        """
        chain = self.fit.problem.chain
        after = chain.tips(self.reference, self.fit.state.corrections)[:, :3, 3]
        before = chain.tips(self.reference, self.plain.state.corrections)[:, :3, 3]
        X = rigid_motion(before, after)
        changes = after - before @ X[:3, :3].T - X[:3, 3]
        mean_squared_change = (changes**2).sum(axis=1).mean()
        return float(np.hypot(np.sqrt(mean_squared_change), self.remaining.rms))

    @cached_property
    def remaining(self) -> Remaining:
        """Predicted error of the tip over the configurations :attr:`reference`: ``rms``, ``worst`` [m]."""
        return Remaining(self.fit, self.reference, self.file_accuracy)

    def remaining_at(self, q: ArrayLike) -> Array:
        """Predicted error of the tip at configurations, without a rigid motion of the base.

        Parameters
        ----------
        q : (n, nq) array_like

        Returns
        -------
        error : (n,) array [m], rms
        """
        configurations = np.atleast_2d(arguments.finite(q, "q", self.original.nq))
        squared_errors, _ = self.remaining.squares(configurations)
        return np.asarray(np.sqrt(squared_errors))

    @property
    def floor(self) -> float:
        """Error [m] expected of held-out readings: the larger of noise and remaining error."""
        return max(self.fit.noise, self.remaining.rms)

    @property
    def needs_nothing(self) -> bool:
        """True if the file needs no correction.

        It is then as accurate as the measurements can show, and these determine all that moves the tip.
        """
        if self.remaining.is_unseen:
            return False
        if self.remaining_before > self.remaining.by_file / _MIN_GAIN:
            return False
        return max(self.before, self.remaining_before) <= _MAX_RATIO_TO_FLOOR * self.floor

    # ── The answer on every surface

    @cached_property
    def verdict(self) -> Verdict:
        """LOOK AGAIN if readings contradict the robot, UNSURE if they do not show all that moves the tip, otherwise OK."""
        return verdict_from_doubts(self.doubts)

    def __repr__(self) -> str:
        return self.headline

    def blocks(self) -> Iterator[Block]:
        """Verdict, error before and after, groups and remarks."""
        from .result_view import calibration_view

        return calibration_view(self)

    def facts(self) -> Mapping[str, str]:
        """Held-out and remaining error, and rank.

        Returns
        -------
        facts : {name: text}
        """
        from .result_view import millimetres, noun_of_readings

        quantity = "" if self.measures_tip else f" of {noun_of_readings(self)}"
        return {
            f"held out{quantity}": millimetres(self.held_out.rms),
            f"before{quantity}": millimetres(self.before),
            "remaining": millimetres(self.remaining.rms),
            "remaining before": millimetres(self.remaining_before),
            "rank": f"{self.rank} of {self.theory}",
        }

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the robot and of the measurements.

        Returns
        -------
        files : {argument: path}
        """
        return {"ROBOT": self.original.model.source, **self.files}

    def origin(self) -> Iterator[Setting]:
        """Robot with its joints.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        return robot_origin(self.robot)

    def to_dict(self) -> dict[str, Any]:
        """Data of :meth:`Answer.to_dict`, and all results in SI units.

        Returns
        -------
        data : dict, as written by ``--json``
        """
        joint_estimates = {}
        for name in ("zeros", "sag", "gears"):
            # [value, half width] of each joint
            joint_estimates[name] = {joint: list(estimate) for joint, estimate in getattr(self, name).items()}
        groups = []
        for group, (low, high) in zip(self._group_list, self.interval().tolist(), strict=True):
            figures = {"value": group.value, "low": low, "high": high, "unit": group.unit}
            groups.append({"name": group.text, "terms": dict(group.terms), **figures})
        doubts = []
        for doubt in self.doubts:
            name = doubt.kind.removeprefix(PREFIX)
            figures = {"value": doubt.value, "unit": doubt.unit}
            doubts.append({"name": name, "joints": list(doubt.joints), **figures, "sentence": str(doubt)})
        return super().to_dict() | {
            "doubts": doubts,
            "before": self.before,
            "held_out": {
                "rms": self.held_out.rms, "max": self.held_out.max, "poses": self.held_out.poses, "angle": self.held_out.angle,
            },
            "remaining": {"rms": self.remaining.rms, "max": self.remaining.worst},
            "remaining_before": self.remaining_before,
            "rank": self.rank,
            "theory": self.theory,
            "groups": groups,
            **joint_estimates,
            "outliers": [{"row": row, "size": error} for row, error in self.outliers],
            "tip_pose": self.tip_pose.tolist(),
            "target_pose": self.target_pose.tolist(),
            "settings": dict(self.settings),
        }  # fmt: skip

    def write(self, path: str | Path) -> Path:
        """Write the robot's URDF or MJCF file with the corrected placements; all other bytes stay.

        Gear errors and sags cannot be stored in these formats; ``to_dict`` has them.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the file

        Raises
        ------
        ValueRangeError
            The verdict is LOOK AGAIN, or the file cannot be written.
        ModelError
            The robot has no URDF or MJCF file.
        RobotFileError
            The written text does not give the same poses to 1e-9 m.
        """
        from .result_view import figures
        from .write import write_geometry

        refuse_to_write(self.verdict, "Correct the measurements.")
        return write_geometry(self.original, self.robot, self.fit.problem.chain.frame, path, figures(self))

    def to_csv(self, path: str | Path) -> Path:
        """Write a row for each reading: number, error [m], for poses also the angle [rad], and whether the reading was used.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the file
        """
        with csv_table(path, ["measurement", "row", "error [m]", "error [rad]", "used"]) as table:
            for k, (errors, W) in enumerate(zip(self.fit.errors, self.fit.weights, strict=True)):
                no_angles = [None] * len(errors)  # of readings that measure positions or distances alone
                angles = self.fit.turns[k] if self.fit.turns[k].size else no_angles
                # an outlier has weight 0 in all of its equations; the last column stands for them
                for row, (error, angle, weight) in enumerate(zip(errors, angles, W[:, -1], strict=True)):
                    table.row([k + 1, row, error, angle, int(weight > 0)])
        return Path(path)
