"""Load cases of a robot: payloads and wrenches, locked joints, torque limits that apply, and the payload margin of a motion."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..core.answers.sentences import sentence
from ..core.arguments import finite, parse_numbers
from ..core.arguments import number as number_of
from ..core.doubts import Doubt
from ..core.errors import FrameError, ShapeError, UnknownNameError, ValueRangeError
from ..core.numbers import number, printed, quantity, rounded_down, seconds
from ..core.text import Argument, in_the_shell, listed, spell
from ..core.typing import Array
from ..core.verdict import Reason
from ..mechanics.algorithms.motor_loads import MotorLoads, motor_loads
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.joints.units import unit_of, units_of
from ..mechanics.model.couplings import drive_turns, joint_torques, motor_torques, motor_velocities
from ..mechanics.model.joint_loads import bearing_loads, follower_torques
from ..mechanics.model.limits import BEARINGS, Limits, StatedLimits, known_velocities
from ..mechanics.model.model import BASE, Model
from .bounds import Extrema
from .coordinates import Coordinates
from .credible_values import credible_load, driven_entries, placeholder_limits
from .differentiation import MotionSamples

if TYPE_CHECKING:
    from ..mechanics.model.model import Body, Model
    from ..robot import Robot
    from ..robot.explanation import Explanation

MIN_SHARE_OF_LARGEST = 1e-6
"""Fraction of the largest torque above which a joint counts as loaded; smaller torques are rounding errors."""
_BUNDLED_FOLDER = Path(__file__).parent.parent / "robots"
"""Folder of the bundled robots."""


def limits_remedy(robot: str = "ROBOT") -> str:
    """Remedy for missing or placeholder limits of the robot file ``robot`` (:attr:`Model.source`).

    >>> limits_remedy("arm.urdf")
    "write a table with tw.info('arm.urdf').to_csv('limits.csv'), fill in its efforts, and add limits='limits.csv'"
    """
    path = Path(robot or "ROBOT")
    is_bundled = path.parent == _BUNDLED_FOLDER
    is_unknown = not robot or "site-packages" in path.parts  # a file of another package is not named
    if in_the_shell():
        name = shlex.quote(str(path))
        if is_bundled:
            name = path.stem
        elif is_unknown:
            name = "ROBOT"
        quote = "'"
        if quote in name:
            quote = '"'
        command = f"{quote}twistwrench info {name} {spell(Argument('csv', 'limits.csv'))}{quote}"
    else:
        argument = repr(str(path))
        if is_bundled:
            argument = repr(path.stem)
        elif is_unknown:
            argument = "robot"
        command = f"tw.info({argument}).to_csv('limits.csv')"
    return f"write a table with {command}, fill in its efforts, and add {spell(Argument('limits', 'limits.csv'))}"


_REMEDY_FOR_MOTORS = "give each coupled motor an effort in the actuator file, such as effort: 28 N m"
"""Remedy for missing limits of coupled motors."""
_MAX_LISTED_NAMES = 6
"""Largest number of joints that a sentence names."""


def confirmed_efforts(model: Model, *, of: str = "the robot") -> str:
    """Remedy for doubted efforts that are right: a header of the limits file with their unit. ``of`` is their source."""
    is_angular = Coordinates.from_model(model).angular_velocity
    some_turn = bool((driven_entries(model) & is_angular).any())
    unit = unit_of("tau", some_turn)
    return f"if the efforts of {of} are right, name their unit in its header, 'effort [{unit}]'"


def loaded_entries(model: Model, peaks: ArrayLike) -> Array:
    """Mask (nv,) of the entries of τ that are driven and loaded by ``peaks`` (nv,) [N m or N].

    The motor of an elastic joint is loaded as the joint is.
    """
    magnitudes = np.abs(np.asarray(peaks, float))
    entries_by_joint: dict[str, slice] = {}
    for body in model.leaders:
        _, entries = body.places
        entries_by_joint[body.joint.name] = entries
    for motor, actuator in model.actuators.items():
        if motor != actuator.joint:  # the motor of an elastic joint
            motor_entries = entries_by_joint[motor]
            joint_entries = entries_by_joint[actuator.joint]
            magnitudes[motor_entries] = np.maximum(magnitudes[motor_entries], magnitudes[joint_entries])
    is_loaded = magnitudes > MIN_SHARE_OF_LARGEST * magnitudes.max(initial=0.0)
    return driven_entries(model) & is_loaded


def drives_without_limit(model: Model, effort: ArrayLike, peaks: ArrayLike) -> list[str]:
    """Names of the drives that are loaded by ``peaks`` (nv,) and have no limit in ``effort`` (nv,)."""
    is_missing = loaded_entries(model, peaks) & ~np.isfinite(effort)
    return np.array(model.drive_labels, object)[is_missing].tolist()


def without_velocity_limit(model: Model, limits: Limits) -> list[str]:
    """Names of driven joints whose velocity limit is missing or implausibly large."""
    is_angular = Coordinates.from_model(model).angular_velocity
    velocities = known_velocities(limits.velocity, is_angular)
    is_unknown = ~np.isfinite(velocities)
    return np.array(model.velocity_names, object)[driven_entries(model) & is_unknown].tolist()


def placeholder_doubt(robot: Robot, limits: Limits) -> str:
    """Sentence on torque limits that are probably not those of motors, with its remedy; empty if none."""
    doubt_text = placeholder_limits(robot, limits)
    if not doubt_text:
        return ""
    are_from_table = isinstance(limits, StatedLimits) and limits.stated.any()
    if are_from_table:
        remedy = confirmed_efforts(robot.model, of="the table")
    else:
        remedy = f"{limits_remedy(robot.model.source)}; {confirmed_efforts(robot.model)}"
    return Reason(f"{doubt_text}; {remedy}", remedy)


def limit_doubts(robot: Robot, limits: Limits, peaks: ArrayLike) -> list[str]:
    """Reasons why torques cannot be judged by their limits, sentences without a full stop.

    ``peaks`` (nv,) are the largest torques of a motion or pose. Limits that are given with their unit are not doubted.
    """
    sentences: list[str] = []
    model = robot.model
    is_loaded = loaded_entries(model, peaks)
    missing = drives_without_limit(model, limits.effort, peaks)
    if missing:
        remedy = limits_remedy(model.source)
        coupled_motors = {*model.drive_labels} - {*model.velocity_names}
        if coupled_motors & {*missing}:
            remedy = _REMEDY_FOR_MOTORS
        joints_text = _joints_text(missing, int(is_loaded.sum()))
        sentences.append(Reason(sentence("unlimited", joints=joints_text, remedy=remedy), remedy))
    is_unconfirmed = is_loaded & ~limits.has_unit("effort")
    if is_unconfirmed.any():
        doubt = placeholder_doubt(robot, limits)
        if doubt:
            sentences.append(doubt)
    return sentences


def _joints_text(missing: Sequence[str], loaded_count: int) -> str:
    """Text of the joints without a limit, out of ``loaded_count`` joints that are loaded."""
    if loaded_count == 1:
        return sentence("one", joint=missing[0])
    names = ""
    if len(missing) < loaded_count:
        names = f" ({listed(missing, _MAX_LISTED_NAMES)})"
    return sentence("some", count=str(len(missing)), all=str(loaded_count), named=names)


TERMS = ("inertia", "coriolis", "gravity", "spring", "payload", "wrench", "friction")
"""Causes of a torque: M ddq, c, g, springs, all terms of the payload, -J' F_on of wrenches, joint friction and damping."""
_LABELS = {"coriolis": "Coriolis", "wrench": "ext. wrench"}
"""Printed names of causes, where they differ."""

STEADY = ("gravity", "spring", "wrench", "friction")
"""Terms that depend on positions and velocities only, so that noise hardly affects them."""


def cause_label(term: str) -> str:
    """Printed name of a term of the torque.

    >>> cause_label("coriolis")
    'Coriolis'
    """
    return _LABELS.get(term, term)


_MIN_LEVER_OF_REACH = 1e-6
"""Torque per kilogram, as a share of reach times gravity, below which it is due to a rounded angle."""


def least_torque_per_kilogram(model: Model) -> float:
    """Torque per kilogram [N m/kg] below which a joint does not carry the payload: 1e-6 of the robot's reach times gravity."""
    length = reach(model)
    if not 0 < length < np.inf:
        length = 1.0  # [m]
    return _MIN_LEVER_OF_REACH * float(np.linalg.norm(model.gravity)) * length


@dataclass(frozen=True, eq=False)
class Payload:
    """A mass [kg] whose centre is at the point ``place`` (3,) [m] of a frame; None stands for the robot's tip."""

    mass: float
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame: str | None = None
    body: SpatialInertia | None = None
    """The whole body, in the axes of the frame; None for a point mass."""

    @classmethod
    def from_inertia(cls, inertia: SpatialInertia, frame: str | None = None) -> Payload:
        """A body with moments of inertia, in the axes of a frame; None stands for the robot's tip."""
        x, y, z = np.asarray(inertia.com, float).tolist()
        return cls(float(inertia.mass), (x, y, z), frame, inertia)

    @property
    def inertia(self) -> SpatialInertia:
        """Spatial inertia in the axes of the frame."""
        if self.body is not None:
            return self.body
        return SpatialInertia.from_com(self.mass, self.place)


def no_tip_for_payload(model: Model, mass: float) -> str:
    """Message for a payload [kg] without a frame on a robot without a single tip."""
    tips = model.possible_tips
    payload_argument = spell(Argument("payload", f"{printed(mass)}@{tips[0]}"))
    tip_argument = spell(Argument("tip", tips[0]))
    return (
        f"robot {model.name!r} has no single tip, so the frame of the payload must be named. It may be one of "
        f"{listed(tips, _MAX_LISTED_TIPS)}. Write {payload_argument}, or load with {tip_argument}."
    )


_MAX_LISTED_TIPS = 12
"""Largest number of tips that a message names."""
_MIN_RATIO_OF_GRAMS = 10.0
_MAX_RATIO_OF_GRAMS = 1000.0
"""Multiples of the robot's moving mass between which a payload may be in grams."""
_MIN_GRAMS = 10.0
"""Smallest number that may be in grams."""


def _hint_at_grams(mass: float, robot_mass: float) -> str:
    """Hint on a payload [kg] that is implausible in kilograms and plausible in grams; empty for others.

    >>> _hint_at_grams(3000.0, 17.0)
    'a payload of 3000 kg is 176 times the mass of the moving links. Payloads are in kg: if these are grams, give 3.'
    >>> _hint_at_grams(100.0, 17.0), _hint_at_grams(3000.0, 0.0), _hint_at_grams(3e6, 17.0)
    ('', '', '')
    """
    if robot_mass <= 0 or mass < _MIN_GRAMS:
        return ""
    ratio = mass / robot_mass
    if not _MIN_RATIO_OF_GRAMS < ratio <= _MAX_RATIO_OF_GRAMS:
        return ""
    return (
        f"a payload of {printed(mass)} kg is {number(ratio, 3)} times the mass of the moving links. Payloads are in kg: "
        f"if these are grams, give {printed(mass / 1000)}."
    )


@dataclass(frozen=True, eq=False)
class LoadCase:
    """Robot with payloads, and with wrenches (6,) on frames, each expressed in its frame."""

    robot: Robot
    payloads: tuple[Payload, ...] = ()
    wrenches: dict[str, Array] = field(default_factory=dict)
    friction: bool = True
    """True if torques include joint friction and damping."""
    with_load: Robot = field(init=False)
    """Robot with its payloads."""

    def __post_init__(self) -> None:
        with_load = self.robot
        for payload in self.payloads:
            frame = payload.frame
            if frame is None:
                frame = with_load.model.tip
            if frame is None:
                raise FrameError(no_tip_for_payload(with_load.model, payload.mass))
            with_load.model.frame(frame)  # only for the error if the frame is unknown
            with_load = with_load.with_payload(payload.inertia, frame=frame)
        for frame in self.wrenches:
            with_load.model.frame(frame)  # likewise
        wrenches = {frame: _wrench_array(F, frame) for frame, F in self.wrenches.items()}
        object.__setattr__(self, "wrenches", wrenches)
        object.__setattr__(self, "with_load", with_load)

    @property
    def causes(self) -> tuple[str, ...]:
        """Causes of a torque, in order."""
        return TERMS

    @property
    def fixed_words(self) -> str:
        """Reason why torques of other loads are not known from those of this one; empty if they are."""
        return ""

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Doubts about payloads that are not where a robot carries them."""
        doubts: list[Doubt] = []
        robot_reach = reach(self.robot.model)
        for payload in self.payloads:
            doubts += credible_load(payload.mass, payload.place, payload.frame, self.robot, robot_reach)
        return tuple(doubts)

    @property
    def unit_hints(self) -> tuple[str, ...]:
        """Sentences on payloads that are far heavier than the robot, but would not be if their numbers were grams."""
        robot_mass = self.robot.model.moving_mass
        hints = [_hint_at_grams(payload.mass, robot_mass) for payload in self.payloads]
        return tuple(filter(None, hints))

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Sentences on payloads farther from their frame than the robot's reach."""
        return tuple(str(doubt) for doubt in self.doubts if doubt.refuses)

    def torques(self, s: MotionSamples) -> Array:
        """Inverse dynamics with payloads, wrenches and friction; (n,) states → (n, nv)."""
        tau = self.with_load.inverse_dynamics(s.q, s.dq, s.ddq, wrench_on_robot=self._wrenches(s))
        return self._with_friction(s, tau)

    def follower_torques(self, s: MotionSamples) -> Array:
        """Torques at mimic joints with an effort limit, (n, k), without friction."""
        F = self.with_load.joint_wrenches(s.q, s.dq, s.ddq, wrench_on_robot=self._wrenches(s))
        return follower_torques(self.with_load.model, np.asarray(F))

    def bearing_loads(self, s: MotionSamples) -> dict[str, Array]:
        """Loads (n, nv) of the bearings by kind; zero at joints that have none."""
        model = self.with_load.model
        F = np.asarray(self.with_load.joint_wrenches(s.q, s.dq, s.ddq, wrench_on_robot=self._wrenches(s)))
        loads_by_kind = {kind: np.zeros((len(s), model.nv)) for kind in BEARINGS}
        for kind, loads_by_body in bearing_loads(model, F).items():
            for k, body in enumerate(model.bodies):
                if body.joint.nv == 1 and not body.follows:
                    loads_by_kind[kind][:, body.v_index] = np.nan_to_num(loads_by_body[:, k])  # NaN: no bearing
        return loads_by_kind

    def _wrenches(self, s: MotionSamples) -> dict[str, Array] | None:
        """Wrenches at all samples; None if there are none."""
        if not self.wrenches:
            return None
        return {frame: np.broadcast_to(F, (len(s), 6)) for frame, F in self.wrenches.items()}

    @property
    def carries(self) -> bool:
        """True if there are payloads or wrenches."""
        return bool(self.payloads or self.wrenches)

    def unloaded_torques(self, s: MotionSamples) -> Array:
        """Torques (n, nv) without payloads and wrenches."""
        tau = self.robot.inverse_dynamics(s.q, s.dq, s.ddq)
        return self._with_friction(s, tau)

    def terms(self, s: MotionSamples) -> dict[str, Array]:
        """Causes, (n, nv) each, in the order of :data:`TERMS`; their sum is :meth:`torques`."""
        unloaded = self.robot
        zero = np.zeros_like(s.dq)
        gravity = np.asarray(unloaded.gravity_forces(s.q))
        wrench = zero.copy()
        for frame, F in self.wrenches.items():  # what the robot must apply to the world is -F
            wrench += unloaded.wrench_torques(s.q, np.broadcast_to(-F, (len(s), 6)), frame)
        terms = {
            "inertia": unloaded.inverse_dynamics(s.q, zero, s.ddq) - unloaded.bias_forces(s.q, zero),
            "coriolis": np.asarray(unloaded.coriolis_forces(s.q, s.dq)),
            "gravity": gravity,
            "spring": zero,
            "payload": zero,
            "wrench": wrench,
            "friction": zero,
        }
        if unloaded.model.springs:
            terms["spring"] = unloaded.bias_forces(s.q, zero) - gravity
        if self.payloads:
            terms["payload"] = self.payload_torques(s)
        if self.friction:
            terms_without_friction = list(terms.values())[:-1]  # friction is the last term
            terms["friction"] = self._friction(s, np.sum(terms_without_friction, axis=0))
        return terms

    def drive_torques(self, tau: Array) -> Array:
        """Drive torques (..., nv) from joint torques (..., nv)."""
        return np.asarray(motor_torques(self.with_load.model, tau))

    def mass_matrix(self, q: Array) -> Array:
        """Drive torques per joint acceleration, (..., nv, nv); M if no joints are coupled."""
        M = np.asarray(self.with_load.mass_matrix(q))
        if not self.with_load.model.couplings:
            return M
        return np.swapaxes(self.drive_torques(M), -1, -2)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the drive torques, (nv,)."""
        return units_of("tau", drive_turns(self.with_load.model))

    def explain(self, s: MotionSamples) -> Explanation:
        """Drive torques of one state by link and by term, with friction as in :meth:`terms`."""
        why = self.with_load.explain(s.q, s.dq, s.ddq, wrench_on_robot=self.wrenches or None, friction=False)
        if self.friction:
            why = why.with_term("friction", self._friction(s, why.torque))
        model = self.with_load.model
        if not model.couplings:
            return why
        return replace(why, joints=model.drive_labels, units=self.units, parts=self.drive_torques(why.parts))

    def motor_loads(self, s: MotionSamples) -> MotorLoads:
        """Motor loads of the robot with its payloads, (n, actuators) each."""
        link_torques, rotor_torques = self.with_load.drive_torques(s.q, s.dq, s.ddq, wrench_on_robot=self._wrenches(s))
        friction: Array | float = 0.0
        if self.friction:
            friction = self._friction(s, link_torques + rotor_torques)
        dq_without_noise = np.where(s.stationary, 0.0, s.dq)  # noise must not determine the direction of power at rest
        return motor_loads(self.with_load.model, dq_without_noise, link_torques + friction, rotor_torques)

    def _with_friction(self, s: MotionSamples, tau: Array) -> Array:
        """Torques (n, nv) with joint friction, if it is counted."""
        if self.friction:
            tau = tau + self._friction(s, tau)
        return np.asarray(tau)

    def _friction(self, s: MotionSamples, tau: Array) -> Array:
        """Joint friction (n, nv) under the torques ``tau`` (n, nv) of all other causes.

        Stationary joints have viscous friction only, as the sign of their velocity is unknown.
        """
        model = self.robot.model
        dq_without_noise = np.where(s.stationary, 0.0, s.dq)
        friction = np.broadcast_to(self.robot.friction_forces(dq_without_noise, load=tau), s.dq.shape)
        viscous_at_rest = model.friction.viscous * motor_velocities(model, s.dq - dq_without_noise)
        return np.asarray(friction + joint_torques(model, viscous_at_rest))

    def payload_torques(self, s: MotionSamples) -> Array:
        """Contribution of the payloads to the torques, (n, nv)."""
        tau = self.with_load.inverse_dynamics(s.q, s.dq, s.ddq)
        tau_without_payload = self.robot.inverse_dynamics(s.q, s.dq, s.ddq)
        return np.asarray(tau - tau_without_payload)

    def follower_payload_torques(self, s: MotionSamples) -> Array:
        """Contribution of the payloads to :meth:`follower_torques`, (n, k)."""
        F = np.asarray(self.with_load.joint_wrenches(s.q, s.dq, s.ddq))
        F_without_payload = np.asarray(self.robot.joint_wrenches(s.q, s.dq, s.ddq))
        return follower_torques(self.robot.model, F - F_without_payload)


def _wrench_array(wrench: ArrayLike, frame: str) -> Array:
    """Wrench (6,) on a frame; raises ShapeError."""
    F = np.asarray(finite(wrench, f"wrench on {frame}"), float)
    if F.shape != (6,):
        raise ShapeError(f"the wrench on {frame} has shape {F.shape}; give (6,): moments [N m], then forces [N].")
    return F


def reach(model: Model) -> float:
    """Reach: largest distance of a frame or link end from the base [m], fully stretched; inf with an unlimited sliding joint.

    The last link may have no frame at its end. Its end is then that of a uniform rod with the link's mass and moments,
    which does not begin before the link's joint. For a floating base the reach is measured from the base.
    """
    distances = {BASE: 0.0}  # from the base to the frame of each body, fully stretched
    for i, body in enumerate(model.bodies):
        slides = body.joint.nv == 1 and not body.joint.axes[0][:3].any()
        stroke = 0.0
        if slides:
            k = body.v_index
            position_limits = [model.limits.lower[k], model.limits.upper[k]]
            largest_position = np.abs(position_limits).max()
            stroke = abs(body.ratio) * float(largest_position)
        distance_from_parent = float(np.linalg.norm(body.placement[:3, 3]))
        distances[i] = distances[body.parent] + distance_from_parent + stroke
    frames = model.frames.values()
    end_distances = [distances[frame.body] + float(np.linalg.norm(frame.pose[:3, 3])) for frame in frames]
    for i, body in enumerate(model.bodies):
        G = body.inertia
        if G.mass > 0.0:
            # A uniform rod of half length h has two moments m h²/3, so that h² = 3/2 tr(I)/m.
            half_length = float(np.sqrt(1.5 * max(np.trace(G.moment_about_com), 0.0) / G.mass))
            com_distance = float(np.linalg.norm(G.com))
            end_distances.append(distances[i] + com_distance + min(com_distance, half_length))
    return max(end_distances, default=0.0)


def parse_payload(text: str, tip: str | None = None) -> Payload:
    """Read ``MASS[,x,y,z][@FRAME]``, at the ``tip`` if no frame is given; raises ValueRangeError with the expected form."""
    form = "MASS[,x,y,z][@FRAME] in kg and m, for example 5 or 2.5,0,0,0.08@tool0"
    numbers_text, at_sign, frame = text.partition("@")
    mass_text, *coordinate_texts = numbers_text.split(",")
    mass_text = re.sub(r"(?<=[\d.])\s*kg\s*$", "", mass_text)  # the unit in 2kg
    mass, *place = parse_numbers(",".join([mass_text, *coordinate_texts]), "payload", form, 1, 4)
    if mass < 0:
        raise ValueRangeError(f"payload {text!r} has a negative mass. Give kilograms, at least 0: {form}.")
    if at_sign and not frame.strip():
        raise ValueRangeError(f"payload {text!r} names no frame after '@'. Write {form}.")
    x, y, z = place or (0.0, 0.0, 0.0)
    return Payload(mass, (x, y, z), frame.strip() or tip)


LoadsGiven: TypeAlias = "float | str | SpatialInertia | Payload | Mapping[str, Any] | Sequence[Any]"
"""Kilograms, text such as ``"5,0,0,0.1@tool0"``, a body, {frame: one of these}, or several of these."""


def payloads_of(given: LoadsGiven, tip: str | None = None) -> tuple[Payload, ...]:
    """Payloads from the argument of a user, at the ``tip`` if no frame is named.

    Examples
    --------
    >>> [(p.mass, p.place, p.frame) for p in payloads_of([5, "2,0,0,0.1@flange", {"tool0": 1.5}])]
    [(5.0, (0.0, 0.0, 0.0), None), (2.0, (0.0, 0.0, 0.1), 'flange'), (1.5, (0.0, 0.0, 0.0), 'tool0')]
    """
    if isinstance(given, Payload):
        return (given,)
    if isinstance(given, SpatialInertia):
        return (Payload.from_inertia(given, tip),)
    if isinstance(given, str):
        return (parse_payload(given, tip),)
    payloads: list[Payload] = []
    if isinstance(given, Mapping):
        for frame, loads in given.items():
            payloads += payloads_of(loads, frame)
        return tuple(payloads)
    if isinstance(given, Sequence):
        for load in given:
            payloads += payloads_of(load, tip)
        return tuple(payloads)
    mass = number_of(given, "payload")
    if not 0 <= mass < math.inf:
        raise ValueRangeError(f"payload {printed(mass)} cannot be a mass. Give kilograms, at least 0.")
    return (Payload(mass, frame=tip),)


def parse_wrenches(texts: Iterable[str]) -> dict[str, Array]:
    """Read texts ``FRAME:m,m,m,f,f,f``, summing those on one frame; raises ValueRangeError with the expected form."""
    form = "FRAME:m,m,m,f,f,f (moment, then force, in that frame), for example tool0:0,0,0,0,0,-20"
    wrenches: dict[str, Array] = {}
    for text in texts:
        frame, _, numbers = text.rpartition(":")
        frame = frame.strip()
        if not frame:
            raise ValueRangeError(f"wrench {text!r} names no frame. Write {form}.")
        F = np.array(parse_numbers(numbers, f"wrench on {frame}", form, 6))
        wrenches[frame] = wrenches.get(frame, 0.0) + F
    return wrenches


@dataclass(frozen=True)
class PayloadMargin:
    """Largest mass of the single payload for which all torques of a motion are within their limits."""

    mass: float
    """Largest mass [kg]."""
    joint: str
    """Joint that reaches its limit with this mass."""
    time: float
    """Time at which the joint reaches its limit [s]."""
    frame: str = ""
    """Frame of the payload."""

    @property
    def words(self) -> str:
        """Sentence with the mass rounded down."""
        return self._sentence("margin")

    @property
    def words_alone(self) -> str:
        """As :attr:`words`, if other loads have limits too, such as a grip, bolts or bearings."""
        return self._sentence("margin alone")

    def _sentence(self, kind: str) -> str:
        """Sentence of a kind, with the figures of this margin."""
        return sentence(kind, mass=rounded_down(self.mass), frame=self.frame, joint=self.joint, time=seconds(self.time))


class PayloadShares(NamedTuple):
    """Figures of the payload margin of some rows: (nv + k,) each, of the drives and of k mimic joints with an effort limit."""

    greatest: Extrema
    """Greatest value, over the rows, of the negative share of the payload's mass that takes a torque to its limit."""
    carried: Array
    """Largest contribution of the payload to the torque."""
    within: bool
    """True if the robot without the payload keeps its limits in all rows."""

    @classmethod
    def from_parts(cls, parts: Sequence[PayloadShares]) -> PayloadShares:
        """Figures of consecutive rows from those of their parts."""
        greatest = Extrema.merge([part.greatest for part in parts])
        carried = np.max([part.carried for part in parts], axis=0)
        return cls(greatest, carried, within=all(part.within for part in parts))


def margin_determined(load: LoadCase) -> bool:
    """True for a single payload with mass, if friction does not depend on load: torques are then linear in the mass."""
    friction_depends_on_load = load.friction and load.robot.model.friction.load.any()
    if load.fixed_words or friction_depends_on_load:
        return False
    return len(load.payloads) == 1 and load.payloads[0].mass > 0


def payload_shares(load: LoadCase, effort: Array, time: Array, torques: Array, carried: Array) -> PayloadShares:
    """Figures of torques (n, nv + k) of drives and limited mimic joints; ``carried`` is the payload's part of them."""
    effort = _with_followers(load, effort)
    least_torque = load.payloads[0].mass * least_torque_per_kilogram(load.robot.model)
    torques_without_payload = torques - carried
    signed_limits = np.copysign(effort, carried)
    with np.errstate(divide="ignore", invalid="ignore"):
        # share of the payload with torques_without_payload + share * carried = signed_limits
        shares_at_limit = (signed_limits - torques_without_payload) / carried
    carries_payload = np.abs(carried) > least_torque
    shares = np.where(carries_payload & ~np.isnan(shares_at_limit), shares_at_limit, np.inf)
    within = bool((np.abs(torques_without_payload) <= effort).all())
    greatest = Extrema.from_rows(time, -shares, shares)
    largest_carried = np.abs(carried).max(axis=0, initial=0.0)
    return PayloadShares(greatest, largest_carried, within)


def _with_followers(load: LoadCase, effort: Array) -> Array:
    """Torque limits (nv + k,): ``effort`` (nv,) of the drives, then the limits of the k mimic joints that have one."""
    model = load.robot.model
    follower_efforts = [model.bodies[i].effort for i in model.limited_followers]
    return np.array([*effort, *follower_efforts], float)


def payload_margin(load: LoadCase, effort: Array, shares: PayloadShares) -> PayloadMargin | None:
    """Payload margin of a motion; None if a loaded joint has no limit or the robot without the payload exceeds a limit."""
    model = load.robot.model
    nv = load.robot.nv
    least_shares = -shares.greatest.value  # of the payload's mass, for each torque
    times = shares.greatest.time
    # the earliest one of equal shares
    k = min(range(len(least_shares)), key=lambda index: (least_shares[index], times[index]))
    if not shares.within or not math.isfinite(least_shares[k]):
        return None
    if drives_without_limit(model, effort[:nv], shares.carried[:nv]):
        return None
    follower_names = [model.bodies[i].joint.name for i in model.limited_followers]
    joint_names = [*model.drive_labels, *follower_names]
    joint = joint_names[k]
    payload = load.payloads[0]  # the only one
    frame = payload.frame or model.tip or ""
    return PayloadMargin(float(least_shares[k]) * payload.mass, joint, float(times[k]), frame)


def joints_held(model: Model, lock: Mapping[str, float], *, degrees: bool) -> dict[str, float]:
    """Positions [rad, m] of the joints in ``lock``, whose keys are names or patterns; with ``degrees``, angles are in degrees.

    A name takes precedence over a pattern. Raises :class:`~twistwrench.UnknownNameError` if no joint matches, and
    :class:`~twistwrench.ValueRangeError` for positions beyond a joint's limits and for contradictory patterns.
    """
    bodies = {body.joint.name: body for body in model.bodies}
    positions: dict[str, float] = {}
    key_by_joint: dict[str, str] = {}
    patterns_first = sorted(lock, key=lambda key: not _is_pattern(key, bodies))  # so that names override them
    for key in patterns_first:
        is_pattern = _is_pattern(key, bodies)
        if is_pattern:
            leaders = [body.joint.name for body in model.leaders if body.joint.nv == 1]
            joints = [joint for joint in leaders if fnmatchcase(joint, key)]
            if not joints:
                raise UnknownNameError.from_choices("joint that fits the pattern", key, leaders)
        else:
            joints = [key]
        for joint in joints:
            position = lock[key]
            if degrees and joint in bodies and bodies[joint].joint.turning[0]:
                position = math.radians(position)
            if is_pattern and joint in positions and positions[joint] != position:
                raise ValueRangeError(
                    f"{{0}}: {key_by_joint[joint]!r} and {key!r} both hold {joint!r}. Keep one of them.",
                    Argument("lock"),
                )
            positions[joint] = position
            key_by_joint[joint] = key
    for body in model.leaders:
        joint = body.joint.name
        if joint in positions and body.joint.nv == 1:
            key = key_by_joint[joint]
            value = float(lock[key])
            if value.is_integer():
                value = int(value)  # printed without a decimal point
            _check_position(model, body, positions[joint], Argument("lock", {key: value}), degrees=degrees)
    return positions


def joints_beside(model: Model, base: str, tip: str) -> tuple[str, ...]:
    """Names of the joints outside the chain between two frames.

    Raises UnknownNameError for an unknown frame, and ValueRangeError if the chain has no joint.
    """
    bodies_above_base = model.ancestors(model.frame(base).body)
    bodies_above_tip = model.ancestors(model.frame(tip).body)
    bodies_of_chain = bodies_above_base ^ bodies_above_tip  # above one frame only
    q_indices_of_chain = {model.bodies[i].q_index for i in bodies_of_chain}
    if not q_indices_of_chain:
        raise ValueRangeError(
            "{0}: no joint moves one of these frames from the other. Name two others.", Argument("chain", (base, tip))
        )
    return tuple(body.joint.name for body in model.leaders if body.q_index not in q_indices_of_chain)


def _is_pattern(key: str, joints: Mapping[str, object]) -> bool:
    """True if a key has wildcards and is not the name of a joint."""
    return key not in joints and any(wildcard in key for wildcard in "*?[")


def _check_position(model: Model, body: Body, position: float, argument: Argument, *, degrees: bool) -> None:
    """Raise ValueRangeError for a position [rad, m] outside the joint's limits; ``degrees``: angles of messages are in °."""
    low = float(model.limits.lower[body.v_index])
    high = float(model.limits.upper[body.v_index])
    tolerance = float(model.limits.tolerance[body.v_index])
    if low - tolerance <= position <= high + tolerance:
        return
    turns = body.joint.turning[0]
    unit = unit_of("q", turns, degrees=degrees)
    units_per_si_unit = math.degrees(1.0) if degrees and turns else 1.0
    joint_text = f" {body.joint.name}"
    if isinstance(argument.value, Mapping) and body.joint.name in argument.value:  # the argument names it
        joint_text = ""
    hint = ""
    if turns and not degrees and low <= math.radians(position) <= high:
        hint = f" If {printed(position)} are degrees, add {{1}}, or write {number(math.radians(position), 6)}."
    limits_text = f"{quantity(units_per_si_unit * low, unit, 6)} to {quantity(units_per_si_unit * high, unit, 6)}"
    raise ValueRangeError(
        f"{{0}} is outside the joint's limits,{joint_text} {limits_text}. Hold it within them.{hint}",
        argument,
        Argument("degrees", True),
    )
