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
_BUNDLED = Path(__file__).parent.parent / "robots"


def limits_remedy(robot: str = "ROBOT") -> str:
    """Remedy for missing or placeholder limits of a robot file (:attr:`Model.source`).

    >>> limits_remedy("arm.urdf")
    "write a table with tw.info('arm.urdf').to_csv('limits.csv'), fill in its efforts, and add limits='limits.csv'"
    """
    path = Path(robot or "ROBOT")
    bundled, unknown = path.parent == _BUNDLED, not robot or "site-packages" in path.parts
    if in_the_shell():
        name = shlex.quote(str(path))
        if bundled:
            name = path.stem
        elif unknown:
            name = "ROBOT"
        quote = "'"
        if quote in name:
            quote = '"'
        command = f"{quote}twistwrench info {name} {spell(Argument('csv', 'limits.csv'))}{quote}"
    else:
        argument = repr(str(path))
        if bundled:
            argument = repr(path.stem)
        elif unknown:
            argument = "robot"
        command = f"tw.info({argument}).to_csv('limits.csv')"
    return f"write a table with {command}, fill in its efforts, and add {spell(Argument('limits', 'limits.csv'))}"


_OF_MOTORS = "give each coupled motor an effort in the actuator file, such as effort: 28 N m"
_MAX_LISTED_NAMES = 6


def confirmed_efforts(model: Model, *, of: str = "the robot") -> str:
    """Remedy for efforts that are doubted and right: the header of a limits file that states their unit."""
    turning = bool((driven_entries(model) & Coordinates.from_model(model).angular_velocity).any())
    return f"if the efforts of {of} are right, name their unit in its header, 'effort [{unit_of('tau', turning)}]'"


def loaded_entries(model: Model, peaks: ArrayLike) -> Array:
    """Entries of τ, (nv,) of bool, driven and loaded by ``peaks`` (nv,) [N m or N]; with an elastic joint, its motor."""
    size = np.abs(np.asarray(peaks, float))
    entry = {body.joint.name: body.places[1] for body in model.leaders}
    for motor, actuator in model.actuators.items():
        if motor != actuator.joint:
            size[entry[motor]] = np.maximum(size[entry[motor]], size[entry[actuator.joint]])
    return driven_entries(model) & (size > MIN_SHARE_OF_LARGEST * size.max(initial=0.0))


def drives_without_limit(model: Model, effort: ArrayLike, peaks: ArrayLike) -> list[str]:
    """Names of the drives that are loaded by ``peaks`` (nv,) and have no limit in ``effort`` (nv,)."""
    missing = loaded_entries(model, peaks) & ~np.isfinite(effort)
    return np.array(model.drive_labels, object)[missing].tolist()


def without_velocity_limit(model: Model, limits: Limits) -> list[str]:
    """Driven joints whose velocity limit is missing or implausibly large."""
    turning = Coordinates.from_model(model).angular_velocity
    unknown = ~np.isfinite(known_velocities(limits.velocity, turning))
    return np.array(model.velocity_names, object)[driven_entries(model) & unknown].tolist()


def placeholder_doubt(robot: Robot, limits: Limits) -> str:
    """Sentence on torque limits that are probably not those of motors, with its remedy; empty if none."""
    text = placeholder_limits(robot, limits)
    if not text:
        return ""
    from_table = isinstance(limits, StatedLimits) and limits.stated.any()
    if from_table:
        remedy = confirmed_efforts(robot.model, of="the table")
    else:
        remedy = f"{limits_remedy(robot.model.source)}; {confirmed_efforts(robot.model)}"
    return Reason(f"{text}; {remedy}", remedy)


def limit_doubts(robot: Robot, limits: Limits, peaks: ArrayLike) -> list[str]:
    """Reasons why torque limits cannot be judged, sentences without a full stop.

    ``peaks`` (nv,) are the largest torques of a motion or pose. Limits given with their unit are not doubted.
    """
    sentences, model = list[str](), robot.model
    loaded = loaded_entries(model, peaks)
    missing = drives_without_limit(model, limits.effort, peaks)
    if missing:
        remedy = limits_remedy(model.source)
        coupled_motors = {*model.drive_labels} - {*model.velocity_names}
        if coupled_motors & {*missing}:
            remedy = _OF_MOTORS
        joints = _joints_text(missing, int(loaded.sum()))
        sentences.append(Reason(sentence("unlimited", joints=joints, remedy=remedy), remedy))
    unconfirmed = loaded & ~limits.has_unit("effort")
    if unconfirmed.any():
        doubt = placeholder_doubt(robot, limits)
        if doubt:
            sentences.append(doubt)
    return sentences


def _joints_text(missing: Sequence[str], count: int) -> str:
    """Joints without a limit, of ``count`` that are loaded."""
    if count == 1:
        return sentence("one", joint=missing[0])
    names = ""
    if len(missing) < count:
        names = f" ({listed(missing, _MAX_LISTED_NAMES)})"
    return sentence("some", count=str(len(missing)), all=str(count), named=names)


TERMS = ("inertia", "coriolis", "gravity", "spring", "payload", "wrench", "friction")
"""Causes of a torque: M ddq, c, g, springs, all terms of the payload, -J' F_on of wrenches, joint friction and damping."""
_LABELS = {"coriolis": "Coriolis", "wrench": "ext. wrench"}

STEADY = ("gravity", "spring", "wrench", "friction")
"""Terms that depend on positions and velocities only, so that noise hardly affects them."""


def cause_label(term: str) -> str:
    """Printed name of a term of the torque.

    >>> cause_label("coriolis")
    'Coriolis'
    """
    return _LABELS.get(term, term)


_NO_LEVER = 1e-6
"""Fraction of reach times gravity below which a torque per kilogram is due to a rounded angle."""


def least_torque_per_kilogram(model: Model) -> float:
    """Torque per kilogram [N m/kg] below which a joint does not carry the payload: 1e-6 of the robot's reach times gravity."""
    lever = reach(model)
    if not 0 < lever < np.inf:
        lever = 1.0
    return _NO_LEVER * float(np.linalg.norm(model.gravity)) * lever


@dataclass(frozen=True, eq=False)
class Payload:
    """A mass [kg] with its centre at a point (3,) [m] of a frame; the robot's tip if the frame is None."""

    mass: float
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame: str | None = None
    body: SpatialInertia | None = None
    """The whole body, in the axes of the frame; None for a point mass."""

    @classmethod
    def from_inertia(cls, inertia: SpatialInertia, frame: str | None = None) -> Payload:
        """A body with moments of inertia, in the axes of a frame; None: the robot's tip."""
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
    first, *_ = tips = model.possible_tips
    named = spell(Argument("payload", f"{printed(mass)}@{first}"))
    return (
        f"robot {model.name!r} has no single tip, so the frame of the payload must be named. It may be one of "
        f"{listed(tips, _MAX_TIPS)}. Write {named}, or load with {spell(Argument('tip', first))}."
    )


_MAX_TIPS = 12
_MIN_RATIO_OF_GRAMS, _MIN_GRAMS = 10.0, 10.0
"""Multiple of the robot's moving mass from which a payload may be in grams, and least number of grams."""


def _grams(mass: float, robot: float) -> str:
    """Hint on a payload that is implausible in kilograms and plausible in grams; empty for others [kg].

    >>> _grams(3000.0, 17.0)
    'a payload of 3000 kg is 176 times the mass of the moving links. Payloads are in kg: if these are grams, give 3.'
    >>> _grams(100.0, 17.0), _grams(3000.0, 0.0), _grams(3e6, 17.0)
    ('', '', '')
    """
    if robot <= 0 or mass < _MIN_GRAMS:
        return ""
    share = mass / robot
    if not _MIN_RATIO_OF_GRAMS < share <= 1000.0:
        return ""
    times, kilograms = number(share, 3), printed(mass / 1000)
    return (
        f"a payload of {printed(mass)} kg is {times} times the mass of the moving links. Payloads are in kg: "
        f"if these are grams, give {kilograms}."
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
        robot = self.robot
        for load in self.payloads:
            frame = load.frame
            if frame is None:
                frame = robot.model.tip
            if frame is None:
                raise FrameError(no_tip_for_payload(robot.model, load.mass))
            robot.model.frame(frame)  # raises for unknown frames
            robot = robot.with_payload(load.inertia, frame=frame)
        for frame in self.wrenches:
            robot.model.frame(frame)
        object.__setattr__(self, "wrenches", {frame: _wrench(F, frame) for frame, F in self.wrenches.items()})
        object.__setattr__(self, "with_load", robot)

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
        for load in self.payloads:
            doubts += credible_load(load.mass, load.place, load.frame, self.robot, robot_reach)
        return tuple(doubts)

    @property
    def unit_hints(self) -> tuple[str, ...]:
        """Sentences on payloads far heavier than the robot, which a thousandth would not be."""
        robot_mass = self.robot.model.moving_mass
        return tuple(filter(None, [_grams(load.mass, robot_mass) for load in self.payloads]))

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Sentences on payloads farther from their frame than the robot's reach."""
        return tuple(str(each) for each in self.doubts if each.refuses)

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
        for kind, loads in bearing_loads(model, F).items():
            for k, body in enumerate(model.bodies):
                if body.joint.nv == 1 and not body.follows:
                    loads_by_kind[kind][:, body.v_index] = np.nan_to_num(loads[:, k])
        return loads_by_kind

    def _wrenches(self, s: MotionSamples) -> dict[str, Array] | None:
        return {frame: np.broadcast_to(F, (len(s), 6)) for frame, F in self.wrenches.items()} or None

    @property
    def carries(self) -> bool:
        """True if there are payloads or wrenches."""
        return bool(self.payloads or self.wrenches)

    def unloaded_torques(self, s: MotionSamples) -> Array:
        """Torques without payloads and wrenches."""
        tau = self.robot.inverse_dynamics(s.q, s.dq, s.ddq)
        return self._with_friction(s, tau)

    def terms(self, s: MotionSamples) -> dict[str, Array]:
        """Causes, (n, nv) each, in the order of :data:`TERMS`; their sum is :meth:`torques`."""
        bare, zero = self.robot, np.zeros_like(s.dq)
        gravity = np.asarray(bare.gravity_forces(s.q))
        wrench = zero.copy()
        for frame, F in self.wrenches.items():  # what the robot must apply to the world is -F
            wrench += bare.wrench_torques(s.q, np.broadcast_to(-F, (len(s), 6)), frame)
        terms = {
            "inertia": bare.inverse_dynamics(s.q, zero, s.ddq) - bare.bias_forces(s.q, zero),
            "coriolis": np.asarray(bare.coriolis_forces(s.q, s.dq)),
            "gravity": gravity,
            "spring": zero,
            "payload": zero,
            "wrench": wrench,
            "friction": zero,
        }
        if bare.model.springs:
            terms["spring"] = bare.bias_forces(s.q, zero) - gravity
        if self.payloads:
            terms["payload"] = self.payload_torques(s)
        if self.friction:
            without_friction = list(terms.values())[:-1]
            terms["friction"] = self._friction(s, np.sum(without_friction, axis=0))
        return terms

    def drive_torques(self, tau: Array) -> Array:
        """Drive torques from joint torques, (..., nv)."""
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
        carried, rotor = self.with_load.drive_torques(s.q, s.dq, s.ddq, wrench_on_robot=self._wrenches(s))
        friction: Array | float = 0.0
        if self.friction:
            friction = self._friction(s, carried + rotor)
        # At rest, noise must not determine the direction of power through a gear.
        moving = np.where(s.stationary, 0.0, s.dq)
        return motor_loads(self.with_load.model, moving, carried + friction, rotor)

    def _with_friction(self, s: MotionSamples, tau: Array) -> Array:
        """Torques (n, nv) with joint friction, if it is counted."""
        if self.friction:
            tau = tau + self._friction(s, tau)
        return np.asarray(tau)

    def _friction(self, s: MotionSamples, carried: Array) -> Array:
        """Joint friction at these torques; viscous only if the sign of the velocity is unknown."""
        moving = np.where(s.stationary, 0.0, s.dq)
        tau = np.broadcast_to(self.robot.friction_forces(moving, load=carried), s.dq.shape)
        model = self.robot.model
        return np.asarray(tau + joint_torques(model, model.friction.viscous * motor_velocities(model, s.dq - moving)))

    def payload_torques(self, s: MotionSamples) -> Array:
        """Contribution of the payloads to the torques, (n, nv)."""
        return np.asarray(
            self.with_load.inverse_dynamics(s.q, s.dq, s.ddq) - self.robot.inverse_dynamics(s.q, s.dq, s.ddq)
        )

    def follower_payload_torques(self, s: MotionSamples) -> Array:
        """Contribution of the payloads to :meth:`follower_torques`, (n, k)."""
        F = np.asarray(self.with_load.joint_wrenches(s.q, s.dq, s.ddq))
        alone = np.asarray(self.robot.joint_wrenches(s.q, s.dq, s.ddq))
        return follower_torques(self.robot.model, F - alone)


def _wrench(given: ArrayLike, frame: str) -> Array:
    F = np.asarray(finite(given, f"wrench on {frame}"), float)
    if F.shape != (6,):
        raise ShapeError(f"the wrench on {frame} has shape {F.shape}; give (6,): moments [N m], then forces [N].")
    return F


def reach(model: Model) -> float:
    """Reach: largest distance of a frame or link end from the base [m], fully stretched; inf with an unlimited sliding joint.

    If the last link has no frame at its end, its length is that of a uniform rod with its mass and moments, which does not
    begin before its joint. For a floating base the reach is measured from the base.
    """
    lengths = {BASE: 0.0}  # from the base to the frame of each body
    for i, body in enumerate(model.bodies):
        slides = body.joint.nv == 1 and not body.joint.axes[0][:3].any()
        travel = 0.0
        if slides:
            k = body.v_index
            travel = abs(body.ratio) * float(np.maximum(np.abs(model.limits.lower[k]), np.abs(model.limits.upper[k])))
        lengths[i] = lengths[body.parent] + float(np.linalg.norm(body.placement[:3, 3])) + travel
    ends = [lengths[frame.body] + float(np.linalg.norm(frame.pose[:3, 3])) for frame in model.frames.values()]
    for i, body in enumerate(model.bodies):
        G = body.inertia
        if G.mass > 0.0:
            half = float(np.sqrt(1.5 * max(np.trace(G.moment_about_com), 0.0) / G.mass))  # of a uniform rod
            place = float(np.linalg.norm(G.com))
            ends.append(lengths[i] + place + min(place, half))
    return max(ends, default=0.0)


def parse_payload(text: str, tip: str | None = None) -> Payload:
    """Read ``MASS[,x,y,z][@FRAME]``, at the ``tip`` if no frame is given; raises ValueRangeError with the expected form."""
    form = "MASS[,x,y,z][@FRAME] in kg and m, for example 5 or 2.5,0,0,0.08@tool0"
    numbers, at, frame = text.partition("@")
    first, *others = numbers.split(",")
    first = re.sub(r"(?<=[\d.])\s*kg\s*$", "", first)  # 2kg
    mass, *place = parse_numbers(",".join([first, *others]), "payload", form, 1, 4)
    if mass < 0:
        raise ValueRangeError(f"payload {text!r} has a negative mass. Give kilograms, at least 0: {form}.")
    if at and not frame.strip():
        raise ValueRangeError(f"payload {text!r} names no frame after '@'. Write {form}.")
    x, y, z = place or (0.0, 0.0, 0.0)
    return Payload(mass, (x, y, z), frame.strip() or tip)


LoadsGiven: TypeAlias = "float | str | SpatialInertia | Payload | Mapping[str, Any] | Sequence[Any]"
"""Kilograms, ``"5,0,0,0.1@tool0"``, a body, {frame: one of these}, or several of these."""


def payloads_of(given: LoadsGiven, tip: str | None = None) -> tuple[Payload, ...]:
    """Payloads that a user gives, at the ``tip`` if no frame is named.

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
        wrenches[frame] = wrenches.get(frame, 0.0) + np.array(parse_numbers(numbers, f"wrench on {frame}", form, 6))
    return wrenches


@dataclass(frozen=True)
class PayloadMargin:
    """Largest mass of the single payload for which all torques of a motion are within their limits."""

    mass: float
    """Largest mass [kg]."""
    joint: str
    """Joint that reaches its limit with this mass."""
    time: float
    """Time at which it does [s]."""
    frame: str = ""
    """Frame of the payload."""

    @property
    def words(self) -> str:
        """Sentence with the mass rounded down."""
        return self._sentence("margin")

    @property
    def words_alone(self) -> str:
        """The same, if the payload must also keep limits that are not those of torques, as of a grip, bolts or bearings."""
        return self._sentence("margin alone")

    def _sentence(self, kind: str) -> str:
        return sentence(kind, mass=rounded_down(self.mass), frame=self.frame, joint=self.joint, time=seconds(self.time))


class PayloadShares(NamedTuple):
    """Figures of the payload margin of some rows, for drives and then mimic joints with an effort limit, (nv + k,) each."""

    greatest: Extrema
    """Negative of the smallest share of the payload's mass that takes a torque to its limit."""
    carried: Array
    """Largest contribution of the payload to the torque."""
    within: bool
    """True if the robot alone keeps its limits."""

    @classmethod
    def from_parts(cls, parts: Sequence[PayloadShares]) -> PayloadShares:
        """Figures of consecutive rows from those of their parts."""
        greatest, carried, within = zip(*parts, strict=True)
        return cls(Extrema.merge(greatest), np.max(carried, axis=0), all(within))


def margin_determined(load: LoadCase) -> bool:
    """True for a single payload, and if friction does not depend on load: torques are then linear in the mass."""
    laws = load.robot.model.friction
    linear = not load.fixed_words and not (load.friction and laws.load.any())
    return len(load.payloads) == 1 and load.payloads[0].mass > 0 and linear


def payload_shares(load: LoadCase, effort: Array, time: Array, torques: Array, carried: Array) -> PayloadShares:
    """Figures of torques (n, nv + k) of drives and limited mimic joints, with the payload's contribution (n, nv + k)."""
    effort = _with_followers(load, effort)
    least = load.payloads[0].mass * least_torque_per_kilogram(load.robot.model)
    alone, limit = torques - carried, np.copysign(effort, carried)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (limit - alone) / carried  # alone + share carried = limit
    share = np.where((np.abs(carried) > least) & ~np.isnan(share), share, np.inf)
    within = bool((np.abs(alone) <= effort).all())
    return PayloadShares(Extrema.from_rows(time, -share, share), np.abs(carried).max(axis=0, initial=0.0), within)


def _with_followers(load: LoadCase, effort: Array) -> Array:
    """Torque limits (nv + k,): those of drives (nv,), then those of mimic joints that have one."""
    model = load.robot.model
    follower_efforts = [model.bodies[i].effort for i in model.limited_followers]
    return np.array([*effort, *follower_efforts], float)


def payload_margin(load: LoadCase, effort: Array, shares: PayloadShares) -> PayloadMargin | None:
    """Margin; None if a loaded joint has no limit or the robot alone exceeds a limit."""
    model, nv = load.robot.model, load.robot.nv
    share, time = -shares.greatest.value, shares.greatest.time
    joint = min(range(len(share)), key=lambda k: (share[k], time[k]))
    if (
        not shares.within
        or not math.isfinite(share[joint])
        or drives_without_limit(model, effort[:nv], shares.carried[:nv])
    ):
        return None
    follower_names = [model.bodies[i].joint.name for i in model.limited_followers]
    name = [*model.drive_labels, *follower_names][joint]
    payload = load.payloads[0]
    frame = payload.frame or model.tip or ""
    return PayloadMargin(float(share[joint]) * payload.mass, name, float(time[joint]), frame)


def joints_held(model: Model, lock: Mapping[str, float], *, degrees: bool) -> dict[str, float]:
    """Positions [rad, m] of the joints in ``lock``; revolute ones are given in degrees if ``degrees``.

    A name takes precedence over a pattern. Raises :class:`~twistwrench.UnknownNameError` if no joint matches, and
    :class:`~twistwrench.ValueRangeError` for positions beyond a joint's limits and for contradictory patterns.
    """
    bodies = {b.joint.name: b for b in model.bodies}
    positions: dict[str, float] = {}
    origin: dict[str, str] = {}
    for name in sorted(lock, key=lambda n: not _is_pattern(n, bodies)):
        if not _is_pattern(name, bodies):
            matches = [name]
        else:
            leaders = [b.joint.name for b in model.leaders if b.joint.nv == 1]
            matches = [joint for joint in leaders if fnmatchcase(joint, name)]
            if not matches:
                raise UnknownNameError.from_choices("joint that fits the pattern", name, leaders)
        for joint in matches:
            value = lock[name]
            if degrees and joint in bodies and bodies[joint].joint.turning[0]:
                value = math.radians(value)
            if _is_pattern(name, bodies) and joint in positions and positions[joint] != value:
                raise ValueRangeError(
                    f"{{0}}: {origin[joint]!r} and {name!r} both hold {joint!r}. Keep one of them.", Argument("lock")
                )
            positions[joint], origin[joint] = value, name
    for b in model.leaders:
        if b.joint.name in positions and b.joint.nv == 1:
            name = origin[b.joint.name]
            value = float(lock[name])
            if value.is_integer():
                value = int(value)
            argument = Argument("lock", {name: value})
            _check(model, b, positions[b.joint.name], argument, degrees=degrees)
    return positions


def joints_beside(model: Model, base: str, tip: str) -> tuple[str, ...]:
    """Joints outside the chain between two frames; raises UnknownNameError, and ValueRangeError if the chain has no joint."""
    above_base, above_tip = model.ancestors(model.frame(base).body), model.ancestors(model.frame(tip).body)
    between = {model.bodies[k].q_index for k in above_base ^ above_tip}
    if not between:
        raise ValueRangeError(
            "{0}: no joint moves one of these frames from the other. Name two others.", Argument("chain", (base, tip))
        )
    return tuple(b.joint.name for b in model.leaders if b.q_index not in between)


def _is_pattern(name: str, joints: Mapping[str, object]) -> bool:
    return name not in joints and any(c in name for c in "*?[")


def _check(model: Model, body: Body, value: float, argument: Argument, *, degrees: bool) -> None:
    low, high = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
    tolerance = float(model.limits.tolerance[body.v_index])
    if low - tolerance <= value <= high + tolerance:
        return
    turns = body.joint.turning[0]
    unit, unit_name = 1.0, unit_of("q", turns, degrees=degrees)
    if degrees and turns:
        unit = math.degrees(1.0)
    joint = f" {body.joint.name}"
    if isinstance(argument.value, Mapping) and body.joint.name in argument.value:  # the argument names it
        joint = ""
    hint = ""
    if turns and not degrees and low <= math.radians(value) <= high:
        hint = f" If {printed(value)} are degrees, add {{1}}, or write {number(math.radians(value), 6)}."
    limits = f"{quantity(unit * low, unit_name, 6)} to {quantity(unit * high, unit_name, 6)}"
    raise ValueRangeError(
        f"{{0}} is outside the joint's limits,{joint} {limits}. Hold it within them.{hint}",
        argument,
        Argument("degrees", True),
    )
