"""Coordinates of a motion: names, units, joint velocities, continuity of wrapped angles, and configurations that are given."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, printed
from ..core.text import Argument, spell
from ..core.typing import Array
from ..mechanics.joints.units import units_of
from ..mechanics.model.couplings import drive_turns
from ..mechanics.model.model import Body, Model
from .column_names import DEGREES, SUFFIX

if TYPE_CHECKING:
    from ..robot import Robot


class MimicJoint(NamedTuple):
    """Mimic joint: its coordinate is ``ratio`` times the leader's, plus ``offset``."""

    name: str
    leader: int
    """Index of the leader's coordinate in q."""
    ratio: float
    offset: float
    """Coordinate with the leader at zero [rad or m]."""
    angular: bool
    """True if the coordinate is an angle."""


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Names and units of the entries of q (nq) and of dq (nv) of one robot.

    Examples
    --------
    >>> import twistwrench as tw
    >>> coordinates = Coordinates.from_model(tw.robots.pendulum().model)
    >>> coordinates.names, coordinates.headers("dq", degrees=True)
    (('hinge',), ['hinge.vel [deg/s]'])
    """

    names: tuple[str, ...]
    """Names of the entries of q: the joint's name, with a suffix for joints with several coordinates."""
    velocity_names: tuple[str, ...]
    """Names of the entries of dq, ddq and torques; the joint's name for one-degree joints."""
    angular: Array
    """(nq,) True for angles; False for lengths and quaternion entries."""
    angular_velocity: Array
    """(nv,) True for rotation about an axis [rad/s, N m]; False for translation along it [m/s, N]."""
    position_of: Array
    """(nv,) index in q that belongs to each velocity; -1 if none does (planar and floating joints)."""
    endless: Array
    """(nq,) True for angles that a log may wrap at ±π: continuous joints and theta of planar joints."""
    quaternions: tuple[slice, ...]
    """Slices of the floating joints' quaternions in q."""
    mimic_joints: tuple[MimicJoint, ...]
    """Mimic joints, except those with a continuous leader, whose angle a log may wrap."""
    drive_names: tuple[str, ...] = ()
    """Names of drive torques, with coupled motors in place of their joints; empty without coupled motors."""
    drive_turns: tuple[bool, ...] = ()
    """True for drive torques in N m, False for forces in N."""
    coupled: tuple[tuple[Array, Array, Array], ...] = ()
    """Indices of coupled joints and matrices of their motors, see :attr:`twistwrench.mechanics.model.model.Model.coupled`."""
    arms: tuple[tuple[int, ...], ...] = ()
    """Indices in q of the joints of each arm of the robot, from its base on."""

    def headers(self, part: str = "q", *, degrees: bool = False) -> list[str]:
        """Column names of a quantity in written files.

        Parameters
        ----------
        part : "q", "dq", "ddq", "tau" or "command"
        degrees : bool, use degrees for angles and note them in the names

        Returns
        -------
        headers : list of str
        """
        names = self.velocity_names
        is_angular = self.angular_velocity
        if part == "q":
            names = self.names
            is_angular = self.angular
        headers = [f"{name}{SUFFIX[part]}" for name in names]
        if degrees and part in DEGREES:
            for k in np.flatnonzero(is_angular):
                headers[k] += f" [{DEGREES[part]}]"
        return headers

    @classmethod
    def from_model(cls, model: Model) -> Coordinates:
        """Names and units of a model's coordinates.

        Returns
        -------
        coordinates : Coordinates
        """
        cached = _CACHE.get(model)
        if cached is not None:
            return cached
        angular: list[bool] = []
        angular_velocity: list[bool] = []
        endless_angles: list[bool] = []
        position_of = np.full(model.nv, -1)
        for body in model.leaders:
            joint = body.joint
            angular += [unit == "rad" for unit in joint.coordinate_units]
            angular_velocity += map(bool, joint.turning)
            endless_angles += [k in joint.wraps for k in range(joint.nq)]
            if joint.nv == 1:
                position_of[body.v_index] = body.q_index
        endless = np.array(endless_angles, bool)
        mimic_joints = []
        for body in model.bodies:
            if body.follows and not endless[body.q_index]:
                is_angular = bool(body.joint.turning[0])
                mimic_joints.append(MimicJoint(body.joint.name, body.q_index, body.ratio, body.offset, is_angular))
        coordinates = cls(
            names=model.coordinate_names,
            velocity_names=model.velocity_names,
            angular=np.array(angular, bool),
            angular_velocity=np.array(angular_velocity, bool),
            position_of=position_of,
            endless=endless,
            quaternions=model.quaternions,
            mimic_joints=tuple(mimic_joints),
            drive_names=model.drive_names if model.couplings else (),
            drive_turns=tuple(drive_turns(model)) if model.couplings else (),
            coupled=model.coupled,
            arms=serial_arms(model),
        )
        _CACHE[model] = coordinates
        return coordinates

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit, ``N m`` or ``N``, for each velocity."""
        return units_of("tau", self.angular_velocity)


_MIN_JOINTS_OF_ARM = 4
"""Least number of joints of an arm."""


def serial_arms(model: Model) -> tuple[tuple[int, ...], ...]:
    """Arms of a robot, each as indices in q: runs of at least four turning joints without a branch between them.

    Rails, fingers and mimic joints do not belong to arms.

    >>> import twistwrench as tw
    >>> serial_arms(tw.robots.panda().model)
    ((0, 1, 2, 3, 4, 5, 6),)
    """
    child_counts = Counter(body.parent for body in model.bodies)
    runs: list[list[int]] = []
    run_of_body: dict[int, list[int]] = {}
    for i, body in enumerate(model.bodies):  # parents come before their children
        is_hinge = body.joint.nv == 1 and body.joint.turning[0]
        if body.follows or not is_hinge:
            continue
        if body.parent in run_of_body and child_counts[body.parent] == 1:
            run = run_of_body[body.parent]
        else:
            run = []
            runs.append(run)
        run.append(body.q_index)
        run_of_body[i] = run
    return tuple(tuple(run) for run in runs if len(run) >= _MIN_JOINTS_OF_ARM)


def joint_rates(model: Model, q: Array, dq_dt: Array, d2q_dt2: Array) -> tuple[Array, Array]:
    """Joint velocities and accelerations (n, nv) from the first and second derivatives of q (n, nq).

    Velocities and accelerations of planar and floating joints are in the child's frame.
    """
    no_columns = np.zeros((len(q), 0))  # for robots without joints
    velocities = [no_columns]
    accelerations = [no_columns]
    for body in model.leaders:
        columns, _ = body.places
        v, a = body.joint.velocities(q[:, columns], dq_dt[:, columns], d2q_dt2[:, columns])
        velocities.append(v)
        accelerations.append(a)
    return np.concatenate(velocities, axis=1), np.concatenate(accelerations, axis=1)


_CACHE: WeakKeyDictionary[Model, Coordinates] = WeakKeyDictionary()
"""Cache by model, as every simulation needs the coordinates."""


_MIN_STEP_OF_TURN = 0.75
"""Smallest step, as a fraction of a turn, that counts as an omitted turn of a bounded joint."""
_TURN_TOLERANCE = 0.01
"""Relative excess over half a turn due to rounding to two decimals (3.15 for π)."""


@dataclass(frozen=True, eq=False)
class Continuity:
    """Columns of q with spurious jumps, determined once for a log, so that all excerpts are continued alike."""

    wrapped: Array
    """(nq,) True for endless angles that stay within one turn, ±π or 0 to 2π.

    Other endless angles count turns, so that their steps of more than π are real.
    """
    quaternions: tuple[slice, ...]
    """Slices of quaternions; p and -p are the same rotation, but a sign change breaks the curve."""
    left_out: Array
    """(nq,) True for angles of bounded joints within one turn, where the log may leave out turns.

    Only a step of nearly a full turn counts as an omitted turn.
    """

    @classmethod
    def from_parts(cls, coordinates: Coordinates, parts: Sequence[Array], turn: float | Array = math.tau) -> Continuity:
        """Columns with jumps, from excerpts of q (n, nq); ``turn``, () or (nq,), is a full turn in the excerpts' units."""
        rows = np.concatenate(parts)
        smallest_q = rows.min(axis=0, initial=math.inf)
        largest_q = rows.max(axis=0, initial=-math.inf)
        half_turn = 0.5 * np.asarray(turn)
        tolerance = _TURN_TOLERANCE * half_turn
        is_about_zero = (smallest_q >= -half_turn - tolerance) & (largest_q <= half_turn + tolerance)
        is_above_zero = (smallest_q >= -tolerance) & (largest_q <= turn + tolerance)
        is_within_turn = is_about_zero | is_above_zero
        is_bounded = coordinates.angular & ~coordinates.endless
        return cls(coordinates.endless & is_within_turn, coordinates.quaternions, is_bounded & is_within_turn)

    def curves(self, q: Array, turn: float | Array = math.tau) -> Array:
        """Consecutive rows of q (n, nq) without the jumps; each column keeps its first value. ``turn``: a full turn."""
        continuous = q.copy()
        turns = np.broadcast_to(np.asarray(turn, float), q.shape[1:])  # full turn of each column
        for k in np.flatnonzero(self.wrapped):
            continuous[:, k] = np.unwrap(q[:, k], period=turns[k])
        for k in np.flatnonzero(self.left_out):
            # np.unwrap does not change steps below ``discont``.
            continuous[:, k] = np.unwrap(q[:, k], period=turns[k], discont=_MIN_STEP_OF_TURN * turns[k])
        for entries in self.quaternions:
            p = q[:, entries]
            keeps_sign = np.sum(p[1:] * p[:-1], axis=1) >= 0
            sign_changes = np.where(keeps_sign, 1.0, -1.0)
            signs = np.cumprod(np.r_[1.0, sign_changes])
            continuous[:, entries] = p * signs[:, None]
        return continuous


ConfigurationGiven: TypeAlias = ArrayLike | str | Mapping[str, ArrayLike] | Sequence[str] | None
"""Coordinates, positions by joint, the name of a configuration, or texts as typed in a shell."""
_MIN_DEGREES = 3 * math.tau
"""Magnitude [rad] from which a coordinate is taken for degrees: three turns are rare, 19 degrees are not."""
_MAX_LISTED_NAMES = 8
"""Largest number of names that a message lists."""

_AT_ARGUMENT = Argument("at")


def configuration_of(
    robot: Robot,
    given: ConfigurationGiven,
    *,
    degrees: bool = False,
    what: Argument = _AT_ARGUMENT,
    start: Array | None = None,
) -> Array:
    """Configuration (nq,) that a user gives; other joints keep their value in ``start``.

    Parameters
    ----------
    given : (nq,) array, {joint: position}, name of a configuration of the robot, "v,v,…", "JOINT=VALUE", or a list of texts
    degrees : bool, given angles are in degrees
    what : Argument that errors name
    start : (nq,) array, optional; None: neutral

    Raises
    ------
    ShapeError, UnknownNameError, ValueRangeError
        It is not a configuration of this robot.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> [configuration_of(arm, given).tolist() for given in ([0.1, 0.5], {"joint2": 0.5}, "0.1,0.5", ["0.1,0", "joint2=0.5"])]
    [[0.1, 0.5], [0.0, 0.5], [0.1, 0.5], [0.1, 0.5]]
    """
    q = robot.neutral.copy() if start is None else np.array(start)
    if given is None:
        return q
    name = spell(replace(what, value=None))
    is_angular = Coordinates.from_model(robot.model).angular
    si_factors = np.where(is_angular & degrees, math.radians(1.0), 1.0)
    if isinstance(given, Mapping):
        for joint, position in given.items():
            body = _body_of_joint(robot, joint)
            entries, _ = body.places
            q[entries] = arguments.finite(np.atleast_1d(position), f"{name} {joint}", body.joint.nq)
            q[entries] *= si_factors[entries]
        return q
    texts: Any = [given] if isinstance(given, str) else given
    are_texts = isinstance(texts, Sequence) and all(isinstance(text, str) for text in texts)
    if not are_texts:
        return configuration(robot, texts, name) * si_factors
    configurations = [text for text in texts if "=" not in text]
    positions = [text for text in texts if "=" in text]
    if len(configurations) > 1:
        first, second = configurations[:2]
        raise ValueRangeError(
            f"{name} {first!r} and {name} {second!r} both set all coordinates. Keep one of them; others are JOINT=VALUE."
        )
    if configurations:
        q = _all_coordinates(robot, configurations[0], name, si_factors)
    for body, numbers in _numbers_by_joint(robot, positions, name, velocities=False):
        entries, _ = body.places
        q[entries] = np.array(numbers) * si_factors[entries]
    return q


def configuration(robot: Robot, q: ArrayLike, name: str) -> Array:
    """Finite copy of q (nq,)."""
    finite_q = arguments.finite(q, name, robot.nq, names=robot.coordinate_names)
    return np.array(arguments.one(finite_q, name, robot.nq))


def _all_coordinates(robot: Robot, text: str, option: str, si_factors: Array) -> Array:
    """Configuration (nq,) from its name, or from numbers, which ``si_factors`` (nq,) convert to SI units."""
    configurations = robot.configurations
    if text in configurations:
        return np.array(configurations[text])
    # The text has numbers; ``form`` is for the message if it does not.
    form = f"{robot.nq} numbers, {_first_names(robot.coordinate_names, ',')}; or JOINT=VALUE, as {_example(robot)}"
    if configurations:
        form += f"; or a configuration of the file: {_first_names(list(configurations), ', ')}"
    else:
        form += "; the file names no configuration"
    numbers = arguments.parse_numbers(text, option, form, robot.nq)
    return np.array(numbers) * si_factors


def _first_names(names: Sequence[str], separator: str) -> str:
    """Text of the first names, with an ellipsis for others."""
    listed_names = list(names[:_MAX_LISTED_NAMES])
    if len(names) > _MAX_LISTED_NAMES:
        listed_names.append("…")
    return separator.join(listed_names)


def _example(robot: Robot) -> str:
    """Example of JOINT=VALUE for messages, with a joint of one coordinate, since other joints need several numbers."""
    for body in robot.model.leaders:
        if body.joint.nq == 1:
            return f"{body.joint.name}=0.5"
    return "joint1=0.5"


def degrees_hint(robot: Robot, q: Array) -> str:
    """Hint on coordinates q (nq,) [rad] that are obviously degrees; otherwise empty.

    >>> import twistwrench as tw
    >>> degrees_hint(tw.robots.planar_2r(), np.array([90.0, 0.0]))[:45]
    'joint1 is at 90 rad, 14.3 turns. For degrees '
    >>> degrees_hint(tw.robots.planar_2r(), np.array([-6.5, 0.0]))
    ''
    """
    is_angular = Coordinates.from_model(robot.model).angular
    angle_sizes = np.where(is_angular, np.abs(q), 0.0)
    if angle_sizes.max(initial=0.0) < _MIN_DEGREES:
        return ""
    k = int(np.argmax(angle_sizes))
    name = robot.coordinate_names[k]
    turns = number(angle_sizes[k] / math.tau, 3)
    return f"{name} is at {printed(q[k])} rad, {turns} turns. For degrees add {spell(Argument('degrees', True))}."


def parse_rates(robot: Robot, texts: Iterable[str], option: str, *, degrees: bool) -> Array:
    """Velocities or torques (nv,) from texts ``JOINT=VALUE``, others zero; ``degrees`` applies to turning joints.

    Raises ValueRangeError and UnknownNameError.
    """
    rates = np.zeros(robot.nv)
    for body, numbers in _numbers_by_joint(robot, texts, option, velocities=True):
        _, entries = body.places
        is_angular = np.any(body.joint.axes[:, :3] != 0, axis=1)
        rates[entries] = np.where(is_angular & degrees, np.radians(numbers), numbers)
    return rates


def _numbers_by_joint(
    robot: Robot, texts: Iterable[str], option: str, *, velocities: bool
) -> list[tuple[Body, list[float]]]:
    """Bodies with the numbers of texts ``JOINT=VALUE``, one for each coordinate; or for each velocity, if ``velocities``."""
    bodies_with_numbers = []
    assignments = arguments.assignments(texts, option, f"JOINT=VALUE, for example {_example(robot)}")
    for joint, value in assignments.items():
        body = _body_of_joint(robot, joint)
        count = body.joint.nv if velocities else body.joint.nq
        form = "1 number" if count == 1 else f"{count} numbers"
        numbers = arguments.parse_numbers(value, f"{option} {joint}", form, count)
        bodies_with_numbers.append((body, numbers))
    return bodies_with_numbers


def _body_of_joint(robot: Robot, name: str) -> Body:
    """Body with the joint of this name, which must not be a mimic joint; raises UnknownNameError."""
    bodies = {body.joint.name: body for body in robot.model.leaders}
    if name not in bodies:
        raise UnknownNameError.from_choices("joint", name, bodies)
    return bodies[name]


complete(globals())
