"""Logs of the motors' side, and identification of a payload with all other parameters fixed.

R are the ratios: R_kk of motor k's own joint, R_kj of other joints that it turns with. With the positions o of the joints at
the log's zero, and the torque g per unit of the log's torque columns,

    q_motor = R (q - o),    dq_motor = R dq,    τ = R' g τ_motor
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..core.doubts import Doubt
from ..core.errors import ValueRangeError
from ..core.estimation.single_row_glitches import OVERLAP
from ..core.glossary import complete
from ..core.typing import Array
from ..formats.actuators import ActuatorFile, read_log_side
from ..formats.yaml import Source
from ..mechanics.algorithms.inverse_dynamics import PARAMETER_NAMES
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.couplings import motor_velocities, refuse_couplings, with_couplings, without_couplings
from ..mechanics.model.limits import Limits
from ..mechanics.model.model import BASE, Model
from ..motion.contradictions import Contradictions
from ..motion.log_table import excerpts, slices
from ..motion.motion import Motion
from ..motion.motion_file import open_motion_file
from ..motion.motion_log import LogRows, MotionLog
from ..robot import Robot
from .parameters import FRICTION, BaseParameters, UnknownParameters

_RUN_COUNT = 16
"""Number of runs of a long log on which rates are compared with slopes."""
_ROWS_PER_RUN = 1 << 12
"""Number of rows of each run."""


@dataclass(frozen=True, eq=False)
class MotorSide:
    """Relation of a log's columns to the joints.

    Parameters
    ----------
    ratios : (nv, nv) array, R; the unit matrix for a log of the joints' side
    zero : (nv,) array, positions of the joints at the log's zero [rad or m]
    gain : (nv,) array, torque per unit of the log's torque column, such as N m/A
    names : tuple of str, optional, columns of the log, coupled ones at the indices of their joints; empty: joints' names
    rates : (nv, nv) array, optional, matrix A of couplings without gears, q̇_m = A q̇_j; friction of named motors is per q̇_m

    Raises
    ------
    ValueRangeError
        The matrix of ratios is singular.

    Examples
    --------
    >>> import numpy as np
    >>> from twistwrench.motion import LogRows
    >>> side = MotorSide(np.diag([10.0, -20.0]), np.array([0.0, 0.5]), np.ones(2))
    >>> side.joint_positions(np.array([[10.0, -20.0]])).tolist(), side.joint_torques(np.ones((1, 2))).tolist()
    ([[1.0, 1.5]], [[10.0, -20.0]])
    >>> side.of_joints(LogRows(np.zeros(1), np.ones((1, 2)), None, None, np.ones((1, 2)))).q.tolist()
    [[0.1, 0.45]]
    """

    ratios: Array
    zero: Array
    gain: Array
    names: tuple[str, ...] = ()
    rates: Array | None = None

    @classmethod
    def of_couplings(cls, model: Model) -> MotorSide:
        """Relation of a robot's motors to its joints through gears, given by the matrix of its couplings.

        Returns
        -------
        side : MotorSide

        Examples
        --------
        >>> import twistwrench as tw
        >>> MotorSide.of_couplings(tw.robots.planar_2r().model).ratios.tolist()
        [[1.0, 0.0], [0.0, 1.0]]
        """
        R = motor_velocities(model, np.eye(model.nv)).T
        return cls(R, np.zeros(model.nv), np.ones(model.nv), model.drive_names, R)

    def __post_init__(self) -> None:
        is_finite = np.isfinite(self.ratios).all()
        if not is_finite or np.linalg.matrix_rank(self.ratios) < len(self.ratios):
            raise ValueRangeError("the ratios of the motors cannot be solved for the joints. Is a ratio 0 or missing?")

    @property
    def is_of_joints(self) -> bool:
        """True if the log's columns are on the joints' side."""
        has_unit_ratios = np.array_equal(self.ratios, np.eye(len(self.zero)))
        return has_unit_ratios and not self.zero.any() and bool((self.gain == 1).all())

    @property
    def coupled_rates(self) -> Array:
        """(k, nv) rates of the motors that turn with several joints, per rate of each joint.

        Rows of A for named motors; otherwise rows of R, scaled to 1 for their own joint.
        """
        if self.rates is not None:
            return self.rates[self._coupled_indices]
        scaled_rows = []
        for j in self._coupled_indices:
            ratios_of_motor = self.ratios[j]
            scale = ratios_of_motor[j]
            if scale == 0.0:  # the motor does not turn its own joint
                scale = np.abs(ratios_of_motor).max()
            scaled_rows.append(ratios_of_motor / scale)
        return np.array(scaled_rows).reshape(-1, len(self.ratios))

    @property
    def coupled_motors(self) -> list[str]:
        """Names of the motors that turn with several joints; each is empty if the motors have no names."""
        return [self.names[j] if self.names else "" for j in self._coupled_indices]

    @property
    def _coupled_indices(self) -> list[int]:
        """Indices of the motors that turn with several joints."""
        joint_counts = np.count_nonzero(self.ratios, axis=1)  # joints that each motor turns with
        return np.flatnonzero(joint_counts > 1).tolist()

    def joint_positions(self, q: Array) -> Array:
        """Positions of the joints.

        Parameters
        ----------
        q : (n, nv) array, as logged

        Returns
        -------
        q : (n, nv) array
        """
        return np.asarray(np.linalg.solve(self.ratios, q.T).T + self.zero)

    def joint_torques(self, tau: Array) -> Array:
        """Torques of the joints.

        Parameters
        ----------
        tau : (n, nv) array, as logged

        Returns
        -------
        tau : (n, nv) array
        """
        return np.asarray((tau * self.gain) @ self.ratios)

    def of_joints(self, rows: LogRows) -> LogRows:
        """Convert rows of a log to positions and torques of the joints.

        Parameters
        ----------
        rows : LogRows

        Returns
        -------
        rows : LogRows
        """
        dq, ddq, tau = rows.dq, rows.ddq, rows.tau
        if dq is not None:
            dq = np.linalg.solve(self.ratios, dq.T).T
        if ddq is not None:
            ddq = np.linalg.solve(self.ratios, ddq.T).T
        if tau is not None:
            tau = self.joint_torques(tau)
        return replace(rows, q=self.joint_positions(rows.q), dq=dq, ddq=ddq, tau=tau)


def motor_side(model: Model, source: Source | ActuatorFile) -> MotorSide:
    """Relation of a log's columns to the joints, from the entries ``log:`` and ``ratio:`` of an actuator file.

    Parameters
    ----------
    source : str, Path, mapping or ActuatorFile; a path, YAML text, or its content

    Raises
    ------
    NotFoundError, ModelError
        The file or an entry is invalid; the message names both.

    Examples
    --------
    >>> import twistwrench as tw
    >>> said = {"actuators": {"joint1": {"ratio": "50"}, "joint2": {"ratio": "-20"}}, "log": {"side": "motor"}}
    >>> motor_side(tw.robots.planar_2r().model, said).ratios.tolist()
    [[50.0, 0.0], [0.0, -20.0]]
    """
    side = read_log_side(model, source)
    joints = model.velocity_names
    joint_index = {name: k for k, name in enumerate(joints)}
    coupled_model = with_couplings(without_couplings(model), side.couplings)
    unit = np.eye(len(joints))
    rates = motor_velocities(coupled_model, unit).T  # A of the couplings
    R = rates.copy() if side.of_motors else unit
    gain = np.ones(len(joints))
    zero = np.array([side.zero.get(name, 0.0) for name in joints])
    for k, name in enumerate(coupled_model.drive_names):
        if side.of_motors:
            R[k] *= side.ratios.get(name, 1.0)
            for other, ratio in side.coupled.get(name, {}).items():
                R[k, joint_index[other]] = ratio
        R[k] *= side.sign.get(name, 1.0)
        gain[k] = side.gain.get(name, 1.0)
    R = R + 0.0  # no negative zeros
    if side.of_motors and side.couplings:
        return MotorSide(R, zero, gain, coupled_model.drive_names, rates)
    return MotorSide(R, zero, gain)


def open_log(path: str | Path, model: Model, side: MotorSide | None, **reading: Any) -> MotionLog:
    """Open a log whose columns are named after the joints or, for coupled motors, after the motors.

    Parameters
    ----------
    side : MotorSide, optional
    reading : options of :meth:`MotionLog.open <twistwrench.motion.motion_log.MotionLog.open>`

    Returns
    -------
    log : MotionLog

    Examples
    --------
    >>> import twistwrench as tw
    >>> open_log(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5().model, None).table.shape
    (751, 19)
    """
    if side is not None and side.names:
        motors = {*side.names} - {*model.velocity_names}
        header = open_motion_file(path, reading.get("topic"), reading.get("episode")).header
        names = set()
        for cell in header:  # NAME.quantity, NAME or NAME [unit]
            name, _, _ = cell.partition(".")
            name, _, _ = name.partition(" ")
            names.add(name)
        if not motors.isdisjoint(names):
            model = _model_named_after_motors(model, side.names)
    return MotionLog.open(path, model, **reading)


def _model_named_after_motors(model: Model, names: Sequence[str]) -> Model:
    """Model whose joints have the names of their motors, without actuators and springs."""
    bodies = list(model.bodies)
    for i, body in enumerate(bodies):
        if not body.follows:
            joint = replace(body.joint, name=names[body.v_index])
            bodies[i] = replace(body, joint=joint)
    return replace(model, bodies=tuple(bodies), actuators={}, springs=())


def read_motion(
    path: str | Path,
    robot: Robot,
    *,
    columns: Mapping[str, str] | None = None,
    rate: float | None = None,
    degrees: bool = False,
    side: MotorSide | None = None,
    gain: Mapping[str, float] | None = None,
    topic: str | None = None,
    episode: int | None = None,
) -> Motion:
    """Read a log of the joints' or the motors' side as a motion of the robot.

    Parameters
    ----------
    columns : {joint: column}, optional, as for :meth:`Motion.from_file <twistwrench.Motion.from_file>`
    rate : float, optional [Hz]
    degrees : bool
    side : MotorSide, optional; None: columns are on the joints' side
    gain : {joint: float}, optional, as for :meth:`Motion.from_file <twistwrench.Motion.from_file>`
    topic : str, optional, topic of a ROS recording
    episode : int, optional, episode of a LeRobot dataset

    Raises
    ------
    NotFoundError, TrajectoryError
        The file cannot be read.

    Examples
    --------
    >>> import twistwrench as tw
    >>> ur5 = tw.robots.ur5()
    >>> read_motion(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), ur5)
    <Motion of 'ur5': 751 states, 0 to 6 s>
    """
    options: dict[str, Any] = {"columns": columns, "rate": rate, "degrees": degrees, "gain": gain}
    options |= {"topic": topic, "episode": episode}
    if side is None or side.is_of_joints:
        return Motion.from_file(path, robot, **options)
    log = open_log(path, robot.model, side, **options)
    rows = side.of_joints(log.motion(log.table))
    doubts = sided_doubts(log, side, robot.limits)
    rates_and_torques: dict[str, Any] = {"dq": rows.dq, "ddq": rows.ddq, "tau": rows.tau}
    return Motion(rows.time, rows.q, **rates_and_torques, in_seconds=True, robot=robot, notes=log.notes, read=doubts)


def sided_doubts(log: MotionLog, side: MotorSide, limits: Limits) -> tuple[Doubt, ...]:
    """Doubts about all rows of a log of the motors' side, converted to the joints' side."""
    tables_of_runs = excerpts(log.table, _RUN_COUNT, _ROWS_PER_RUN)
    runs = [side.of_joints(log.motion(table)) for table in tables_of_runs]
    contradictions = Contradictions(log.coordinates, runs=runs)
    for portion in slices(len(log.table), _RUN_COUNT * _ROWS_PER_RUN):  # to limit memory
        first_row = max(0, portion.start - OVERLAP)
        table = log.table[first_row : portion.stop]
        rows = side.of_joints(log.motion(table))
        contradictions.add(rows.time, rows.q, portion.start - first_row)
    return tuple(contradictions.doubts(limits))


# ── Payload alone


@dataclass(frozen=True, eq=False)
class IdentifiedPayload:
    """Identified payload.

    Attributes
    ----------
    frame : str, frame to which the payload is fixed
    inertia : SpatialInertia, in that frame
    mass_deviation : float [kg]
    com_deviations : (3,) array, along the frame's axes [m]
    unidentifiable : tuple of str, parameters of the carrying body that do not affect any torque of this robot
    """

    frame: str
    inertia: SpatialInertia
    mass_deviation: float
    com_deviations: Array
    unidentifiable: tuple[str, ...] = ()

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.inertia.mass)

    def to_dict(self) -> dict[str, object]:
        """Dictionary of plain data, in SI units.

        Returns
        -------
        findings : dict, compatible with ``json.dumps``

        Examples
        --------
        >>> one = IdentifiedPayload("tool0", SpatialInertia.from_com(2.0, (0, 0, 0.1)), 0.01, np.zeros(3))
        >>> one.to_dict()["com"]
        [0.0, 0.0, 0.1]
        """
        return {
            "frame": self.frame,
            "mass": self.mass,
            "mass_deviation": self.mass_deviation,
            "com": self.com.tolist(),
            "com_deviations": self.com_deviations.tolist(),
            "undetermined": list(self.unidentifiable),
            "moment_about_com": np.asarray(self.inertia.moment_about_com).tolist(),
        }

    @property
    def com(self) -> Array:
        """(3,) centre of mass in the frame [m]."""
        return np.asarray(self.inertia.com)


def payload_body(robot: Robot, frame: str) -> str:
    """Name of the moving link to which a frame is fixed."""
    carrier = robot.model.frame(frame).body
    if carrier == BASE:
        raise ValueRangeError(f"frame {frame!r} does not move, so no torque depends on what is fixed to it.")
    return robot.model.bodies[carrier].link


def known_but_for(robot: Robot, link: str) -> dict[str, float]:
    """Values of the file, by parameter, for all but the ten parameters of the body of ``link`` and the torque offsets."""
    model = robot.model
    known: dict[str, float] = {}
    parameters_of_bodies = robot.parameters.reshape(-1, len(PARAMETER_NAMES)).tolist()
    for body, values in zip(model.bodies, parameters_of_bodies, strict=True):
        if body.link != link and body.link in model.link_inertias:
            names = [f"{body.link}.{name}" for name in PARAMETER_NAMES]
            known |= dict(zip(names, values, strict=True))
    drive_parameters: Mapping[str, Array] = {
        "motor_inertia": np.broadcast_to(model.armature, robot.nv),
        "viscous": model.friction.viscous,
        "coulomb": model.friction.coulomb,
    }
    for kind, values_of_joints in drive_parameters.items():
        names = [f"{name}.{kind}" for name in model.velocity_names]
        known |= dict(zip(names, np.asarray(values_of_joints, float).tolist(), strict=True))
    return known


def payload_from(robot: Robot, frame: str, base: BaseParameters, values: Array, covariance: Array) -> IdentifiedPayload:
    """Payload: difference between identified groups and the file in the ten parameters of the carrying body.

    ``values`` (r,) are the identified groups, with ``covariance`` (r, r).
    """
    names = list(base.unknown.names)
    body = payload_body(robot, frame)
    difference = values - base.project(base.unknown.file_values)
    S = np.zeros((10, base.count))  # selects the body's parameters; undetermined ones keep the values of the file
    undetermined: list[str] = []
    for k, parameter in enumerate(PARAMETER_NAMES):
        name = f"{body}.{parameter}"
        is_parameter = base.kept == names.index(name)  # mask of groups; no group if the parameter is undetermined
        S[k, is_parameter] = 1.0
        if not S[k].any():
            undetermined.append(name)
    T = np.linalg.inv(robot.model.frames[frame].pose)
    unit_inertias = [SpatialInertia.from_parameters(unit_vector) for unit_vector in np.eye(10)]
    columns = [inertia.in_frame(T).parameters for inertia in unit_inertias]  # of the change of frame
    A = np.stack(columns, axis=1) @ S  # (10, r): parameters in the payload's frame by the groups
    G = SpatialInertia.from_parameters(A @ difference)
    C = A @ covariance @ A.T
    m = PARAMETER_NAMES.index("m")  # row of the mass
    mc = PARAMETER_NAMES.index("mcx")  # first row of the first moment
    J = np.zeros((3, 10))  # derivatives of the centre of mass c = (m c) / m
    J[:, mc : mc + 3] = np.eye(3) / G.mass
    J[:, m] = -np.asarray(G.com) / G.mass
    com_deviations = np.sqrt((J @ C @ J.T).diagonal())
    mass_deviation = float(np.sqrt(C[m, m]))
    return IdentifiedPayload(frame, G, mass_deviation, com_deviations, tuple(undetermined))


def unknown_of(
    robot: Robot,
    *,
    motor_inertia: bool,
    friction: Sequence[str],
    motor_side: MotorSide | None,
    known: Mapping[str, float] | None,
    payload_only: str | None,
    stribeck_speed: float,
) -> UnknownParameters:
    """Unknown parameters of a fit.

    If ``payload_only`` names the frame of a payload, only the payload and the torque offsets are unknown.
    """
    known_values = dict(known or {})
    if payload_only is not None:
        refuse_couplings(robot.model, "identification of a payload alone")
        file_values = known_but_for(robot, payload_body(robot, payload_only))
        known_values = file_values | known_values  # the caller's values take precedence
        motor_inertia, friction = True, FRICTION
    return UnknownParameters(robot, motor_inertia, tuple(friction), motor_side, known_values, stribeck_speed)


complete(globals())
