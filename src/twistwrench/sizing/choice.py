"""Sizing of a robot's drives for a repeated motion, and choice of the smallest drives from a catalogue."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.errors import UnknownNameError
from ..core.files import replacing
from ..core.numbers import number, percent_of_limit
from ..core.tables import csv_table
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..formats.yaml import si_unit
from ..mechanics.joints.units import units_of
from ..mechanics.model.actuators import RATINGS, moving
from ..mechanics.model.limits import BEARINGS
from ..motion.coordinates import Coordinates
from ..motion.limits_file import robot_origin
from ..motion.model_doubts import base_doubts, hanging_excess, model_warnings
from ..motion.motion import Motion
from ..reports.load_states import LoadStates
from ..reports.motors import Demand
from ..reports.torque_report import TorqueReport
from ..reports.torque_verdict import condition_of_excesses, contradictions, log_doubts, rows_in_doubt
from ..statics.reactions import bearing_loads
from .catalog import DIRECT, Catalog, Pair
from .cycle import Cycle, with_noise
from .drives import CatalogMotor, SizedMotor, Supply, sized_motor, supply_of
from .gear import Gear, SizedGear, sized_gear

if TYPE_CHECKING:
    from ..core.answers.page import Setting
    from ..robot import Robot

_MAX_SHARE_FOR_NOISE = 2.0
"""Share of a limit above which noise of a log cannot matter."""
_UNKNOWN_ROTOR_INERTIA = 1e-15
"""Inertia used for rotors of unknown inertia [kg m²]."""


@dataclass(frozen=True, eq=False)
class SizedJoint:
    """Drive of one joint over the cycle."""

    joint: str
    """Name of the joint."""
    drive: Pair
    """Names of the motor and of the gear."""
    mass: float
    """Mass of motor and gear together [kg]."""
    motor: SizedMotor
    gear: SizedGear
    cycle: Cycle
    """Loads of the joint."""

    @property
    def excess(self) -> tuple[str, ...]:
        """Sentence without a full stop for each exceeded limit, largest excess first."""
        shares: list[float] = []
        sentences: list[str] = []
        for kind, part in self._parts:
            for demand in part.excess:
                shares.append(demand.share)
                sentences.append(_demand_sentence(self.joint, kind, part, demand))
        order = np.argsort(-np.array(shares), kind="stable")
        return tuple(sentences[k] for k in order)

    @property
    def missing(self) -> tuple[str, ...]:
        """Sentence without a full stop for each part that lacks ratings."""
        sentences = []
        for kind, part in self._parts:
            if part.missing:
                ratings = ", ".join(part.missing)
                if "stall" not in part.missing[-1]:  # the sentence on the stall torque is complete
                    ratings += " not given"
                sentences.append(f"{self.joint}, {kind} {part.name}: {ratings}")
        return tuple(sentences)

    @property
    def tightest(self) -> tuple[str, Demand]:
        """Name of a part, and its demand that is nearest to its limit of all demands."""
        kind, part = max(self._parts, key=lambda kind_and_part: kind_and_part[1].tightest.share)
        return f"{kind} {part.name}", part.tightest

    @property
    def open(self) -> tuple[str, ...]:
        """Sentence without a full stop for each demand of which noise of the log decides whether it exceeds its limit."""
        sentences = []
        for kind, part in self._parts:
            for demand in part.open:
                sentence = _demand_sentence(self.joint, kind, part, demand)
                sentences.append(f"noise of the log decides: {sentence}")
        return tuple(sentences)

    @property
    def fits(self) -> bool:
        """True if no limit is certainly exceeded."""
        return not (self.motor.excess or self.gear.excess)

    @property
    def sure(self) -> bool:
        """True if all limits are certainly kept, and no rating is missing."""
        return self.fits and not (self.open or self.missing)

    @property
    def _parts(self) -> tuple[tuple[str, SizedMotor | SizedGear], ...]:
        """Pairs of the kind of a part, and the part."""
        return ("gear", self.gear), ("motor", self.motor)


def _demand_sentence(joint: str, kind: str, part: SizedMotor | SizedGear, demand: Demand) -> str:
    """Sentence without a full stop on a demand and its limit."""
    return f"{joint}, {kind} {part.name}: {demand.words}"


@dataclass(frozen=True, eq=False)
class Chosen:
    """Drive chosen for a joint."""

    joint: str
    drive: Pair | None
    """None if no pair of the catalogue is sufficient."""
    smaller: tuple[Pair, str] | None
    """Next smaller pair and the reason for its rejection; None if there is none."""
    rivals: tuple[Pair, ...] = ()
    """Smaller pairs of which noise of the log decides whether they are sufficient."""


@dataclass(frozen=True, eq=False)
class SizingProblem:
    """Robot, cycle and settings shared by all candidates."""

    robot: Robot
    states: Sequence[tuple[Array, Array, Array]]
    """q, dq and ddq at the nodes of the cycle, followed by those of equally likely cycles."""
    time: Array
    """Times of the nodes [s]."""
    brake: bool
    """True if brakes hold the joints in the pause, without torques of the motors."""
    holding: slice
    """Nodes of the pause."""
    emergency: Motion | None
    """Motion of an emergency stop; None without one."""
    friction: bool
    """True if friction of the joints loads the drives."""
    add_masses: bool
    """True if the masses of motors and gears load the robot."""
    armed: tuple[str, ...]
    """Joints whose armature in the robot file is replaced by the rotors of the drives."""
    ambient: float
    """Temperature of the surroundings [°C]."""
    life: float | None
    """Required life of the gears [h]; None if it is not checked."""
    shared: bool
    """True if all drives have one electrical supply."""
    doubts: tuple[str, ...] = ()
    """Reasons to be unsure of all loads."""
    bears: bool = False
    """True if a gear of the catalogue has limits of its bearing."""

    def with_drives(self, drives: Mapping[str, tuple[CatalogMotor, Gear]], probe: str | None = None) -> Robot:
        """Robot with the drives as rotors with mass, and at the joint ``probe`` a rotor of 1 kg m² without a gear.

        The probe shows the torque that a rotor at the joint needs. From it, the rotor torques of all candidates follow.
        """
        entries: dict[str, Any] = {}
        for joint, (motor, gear) in drives.items():
            rotor = {
                "inertia": f"{motor.inertia or _UNKNOWN_ROTOR_INERTIA!r} kg m^2",
                "extra": True,
                "mass": f"{(motor.mass + gear.mass) * self.add_masses!r} kg",
            }
            entries[joint] = {"ratio": gear.ratio, "rotor": rotor}
        if probe is not None:
            entries[probe] = {"ratio": 1, "rotor": {"inertia": "1 kg m^2", "extra": True}}
        if not entries:
            return self.robot
        return self.robot.with_actuators({"actuators": entries})

    def cycles(self, joint: str, drives: Mapping[str, tuple[CatalogMotor, Gear]]) -> list[Cycle]:
        """Loads of a joint in each of the cycles, with the drives of other joints on the robot."""
        robot = self._robot_with_probe(joint, drives)
        cycles = [self._cycle(robot, joint, states, self.time, self.holding) for states in self.states]
        if not self.bears:
            return cycles
        robot_without_probe = self.with_drives(_other_drives(drives, joint))
        cycles_with_bearing: list[Cycle] = []
        for cycle, states in zip(cycles, self.states, strict=True):
            loads = _bearing_loads_of(robot_without_probe, joint, states)
            cycles_with_bearing.append(cycle._replace(bearing=loads))
        return cycles_with_bearing

    def emergency_cycle(self, joint: str, drives: Mapping[str, tuple[CatalogMotor, Gear]]) -> Cycle | None:
        """Loads of a joint in the emergency; None without one."""
        stop = self.emergency
        if stop is None:
            return None
        robot = self._robot_with_probe(joint, drives)
        no_nodes = slice(len(stop), None)  # without a pause
        return self._cycle(robot, joint, (stop.q, stop.dq, stop.ddq), stop.time, no_nodes)

    def _robot_with_probe(self, joint: str, drives: Mapping[str, tuple[CatalogMotor, Gear]]) -> Robot:
        """Robot with the drives of the other joints, and the probe at this joint."""
        return self.with_drives(_other_drives(drives, joint), probe=joint)

    def _cycle(
        self, robot: Robot, joint: str, states: tuple[Array, Array, Array], time: Array, holding: slice
    ) -> Cycle:
        """Loads of a joint at the nodes of a cycle, for a robot with the probe; ``holding`` are the nodes of the pause."""
        q, dq, ddq = states
        k = robot.model.velocity_names.index(joint)
        link_torques, rotor_torques = robot.drive_torques(q, dq, ddq)
        torque = np.array(link_torques[:, k])
        if self.friction:
            torque = torque + robot.friction_forces(moving(dq), load=link_torques)[:, k]
        if self.brake:
            torque[holding] = 0.0
        # Subtract the probe: its inertia of 1 kg m², and the torque of its own acceleration.
        inertia = robot.mass_matrix(q)[:, k, k] - 1.0
        carrier_acceleration = rotor_torques[:, k] - ddq[:, k]
        return Cycle(time, np.diff(time), moving(dq[:, k]), torque, ddq[:, k], carrier_acceleration, inertia)

    def size_joint(
        self, joint: str, drive: tuple[CatalogMotor, Gear], cycles: Sequence[Cycle], emergency: Cycle | None
    ) -> SizedJoint:
        """One drive under the loads of its joint, in the cycle and in equally likely cycles."""
        entry, gear = drive

        def motor_in(cycle: Cycle) -> SizedMotor:
            holding = self.holding if self.brake else slice(0, 0)
            return sized_motor(entry, gear, cycle, ambient=self.ambient, holding=holding, weighs=self.add_masses)

        def gear_in(cycle: Cycle) -> SizedGear:
            return sized_gear(gear, cycle, self.life, emergency, weighs=self.add_masses)

        cycle, *likely_cycles = cycles
        motor_use = motor_in(cycle)
        gear_use = gear_in(cycle)
        max_share = max(motor_use.tightest.share, gear_use.tightest.share)
        if likely_cycles and max_share < _MAX_SHARE_FOR_NOISE:
            motor_draws = [motor_in(likely_cycle).demands for likely_cycle in likely_cycles]
            gear_draws = [gear_in(likely_cycle).demands for likely_cycle in likely_cycles]
            motor_use = replace(motor_use, demands=with_noise(motor_use.demands, motor_draws))
            gear_use = replace(gear_use, demands=with_noise(gear_use.demands, gear_draws))
        return SizedJoint(joint, (entry.name, gear.name), entry.mass + gear.mass, motor_use, gear_use, cycle)


def _other_drives(drives: Mapping[str, tuple[CatalogMotor, Gear]], joint: str) -> dict[str, tuple[CatalogMotor, Gear]]:
    """Drives of all other joints."""
    others = dict(drives)
    others.pop(joint, None)
    return others


def _bearing_loads_of(robot: Robot, joint: str, states: tuple[Array, Array, Array]) -> dict[str, Array]:
    """Loads of a joint's bearing over the nodes, by their kind."""
    loads = bearing_loads(robot, *states)
    k = loads.joints.index(joint)
    return {kind: getattr(loads, kind)[:, k] for kind in BEARINGS}


@dataclass(frozen=True, eq=False, repr=False)
class Sizing(Answer):
    """Drives of a robot over a cycle, compared with their ratings: result of :func:`twistwrench.size_drives`.

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.pendulum(), np.linspace(0, 2, 201)
    >>> motion = tw.Motion(t, np.sin(np.pi * t / 2)[:, None] ** 2, robot=arm)
    >>> servos = {name: {"stall_torque": f"{most} N m", "no_load_speed": "60 rpm", "voltage": "24 V"}
    ...           for name, most in (("small", 4), ("large", 30))}
    >>> s = tw.size_drives(arm, motion, {"motors": servos, "actuators": {"hinge": {"motor": "small"}}})
    >>> print(s.verdict.word, s.choose().joints["hinge"].drive)
    OVER LIMIT ('large', 'none')
    >>> s.actuators()["actuators"]["hinge"]["ratio"]
    1.0
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     s.write_actuators(f"{folder}/actuators.yaml").name, s.to_csv(f"{folder}/sizing.csv").name
    ('actuators.yaml', 'sizing.csv')
    >>> s.brief[:5], s.of_drives.ok, s.subject, len(list(s.blocks())), s.sources()["ROBOT"].endswith("pendulum.urdf")
    ('hinge', False, 'pendulum', 7, True)
    """

    call: ClassVar[str] = "size"

    joints: Mapping[str, SizedJoint]
    """Sized drive of each joint, with ``motor`` and ``gear``."""
    supply: Supply
    """Electrical supply of all drives."""
    catalog: Catalog
    """Motors and gears to choose from."""
    choice: Mapping[str, Chosen]
    """Choice for each joint; empty if the drives were given."""
    left_out: tuple[str, ...]
    """Joints without a drive to size."""
    problem: SizingProblem
    """Robot, cycle and settings."""
    motion: Motion | None = None
    """The motion of the cycle, without the pause."""
    report: TorqueReport | None = None
    """Analysis of the log; None for a motion in memory."""

    @cached_property
    def verdict(self) -> Verdict:
        """OVER LIMIT with every exceeded limit, UNSURE with every missing rating and every doubt, or OK.

        LOOK AGAIN if the log contradicts itself. A rating exceeded by a log whose rows are in doubt is not certain.
        """
        drive_verdict = self.of_drives
        report = self.report
        if report is None:
            return drive_verdict
        refusals = contradictions(report)
        if refusals:
            return Verdict.from_reasons(look_again=refusals)
        row_doubts = rows_in_doubt(report)
        if row_doubts and drive_verdict.word is Word.OVER_LIMIT:
            doubt = f"{condition_of_excesses(report)} {Word.OVER_LIMIT}: {drive_verdict.reasons[0]}"
            drive_verdict = Verdict.from_reasons(unsure=[doubt])
        other_doubts = [text for text in log_doubts(report) if text not in row_doubts]
        return Verdict.from_reasons(unsure=[*row_doubts, *other_doubts]).joined(drive_verdict)

    @cached_property
    def of_drives(self) -> Verdict:
        """Verdict on the drives alone, as if the log had no doubts."""
        over, unsure = [], []
        for name, chosen in self.choice.items():
            if chosen.drive is None:
                over.append(f"{name}: no pair of the catalogue does it")
            elif chosen.rivals:
                rivals = " and ".join(map(drive_name, (*chosen.rivals, chosen.drive)))
                unsure.append(f"{name}: noise of the log decides between {rivals}")
        for joint in self._joints_by_share:
            over += joint.excess
            unsure += [*joint.open, *joint.missing]
        if base_doubts(self.problem.robot.model):  # nothing holds the base: torques differ if the robot stands
            if over:
                unsure.insert(0, hanging_excess(over[0]))
            over = []
        return Verdict.from_reasons(over=over, unsure=[*self.problem.doubts, *unsure])

    # ── The answer on every surface

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.problem.robot.name

    @property
    def subject(self) -> str:
        """Robot and motion."""
        if self.report is None:
            return self.robot_name
        return f"{self.robot_name} · {Path(self.report.trajectory).name}"

    @property
    def brief(self) -> str:
        """Joint without a sufficient drive, or the joint nearest to a rating with its share."""
        for name, chosen in self.choice.items():
            if chosen.drive is None:
                return f"no drive for {name}"
        if not self.joints:
            return ""
        nearest = self._joints_by_share[0]
        _, demand = nearest.tightest
        return f"{nearest.joint} {percent_of_limit(demand.share)}"

    def blocks(self) -> Iterator[Block]:
        """Verdict, drives with their figures, supply and remarks."""
        from .sizing_view import sizing_view

        return sizing_view(self)

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the motion and of the robot.

        Returns
        -------
        files : {argument: path}
        """
        files: dict[str, str | Path] = {}
        if self.report is not None:
            files["MOTION"] = self.report.trajectory
        files["ROBOT"] = self.problem.robot.model.source
        return files

    def origin(self) -> Iterator[Setting]:
        """Robot with its joints.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        return robot_origin(self.problem.robot)

    def to_csv(self, path: str | Path) -> Path:
        """Write a row for each figure of each motor and gear, with its limit.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the file

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        columns = "joint", "part", "name", "figure", "value", "limit", "unit", "share"
        with csv_table(path, columns) as table:
            for joint in self.joints.values():
                for kind, part in joint._parts:
                    for demand in part.demands:
                        limit = _finite_or_none(demand.limit)
                        share = _finite_or_none(demand.share)
                        names = (joint.joint, kind, part.name)
                        table.row([*names, demand.what, demand.value, limit, demand.unit, share])
        return Path(path)

    @property
    def _joints_by_share(self) -> list[SizedJoint]:
        """Joints by the largest share of a limit, largest first."""

        def largest_share(joint: SizedJoint) -> float:
            _, demand = joint.tightest
            return demand.share

        return sorted(self.joints.values(), key=largest_share, reverse=True)

    @property
    def mass(self) -> float:
        """Mass of all drives [kg]."""
        return sum(joint.mass for joint in self.joints.values())

    def choose(self) -> Sizing:
        """Smallest drives of the catalogue, by mass, then price, then torque.

        Joints are processed from tip to base: a drive sits on the link before its joint and loads only joints nearer
        the base.

        Returns
        -------
        sizing : Sizing, with all chosen drives on the robot
        """
        without_drive = [name for name, chosen in self.choice.items() if not chosen.drive]
        sizing = _choose_drives(self.problem, self.catalog, (*self.joints, *without_drive))
        return replace(sizing, motion=self.motion, report=self.report)

    def actuators(self) -> dict[str, Any]:
        """Drives as entries of an actuator file; docs/actuation.md shows one.

        Returns
        -------
        content : dict, for :meth:`twistwrench.Robot.with_actuators`
        """
        entries: dict[str, Any] = {}
        for name, joint in self.joints.items():
            entries[name] = _actuator_entry(self.catalog, joint.drive, self.problem.add_masses)
            if name in self.problem.armed:
                entries[name]["reflected_inertia"] = "0 kg m^2"
        return {"actuators": entries}

    def write_actuators(self, path: str | Path) -> Path:
        """Write the drives as an actuator file.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the file

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        import yaml

        text = yaml.safe_dump(self.actuators(), sort_keys=False, allow_unicode=True)
        with replacing(path) as scratch:
            scratch.write_text(text, encoding="utf-8")
        return Path(path)


def _finite_or_none(value: float) -> float | None:
    """Value; None, an empty cell of a table, if it is not finite."""
    if math.isfinite(value):
        return value
    return None


def _shortest_decimal(value: float) -> str:
    """Shortest decimal that is read as the same number."""
    return repr(float(value))


def _actuator_entry(catalog: Catalog, pair: Pair, add_masses: bool) -> dict[str, Any]:
    """Entry of an actuator file for a drive of the catalogue."""
    entry, gear = catalog.pair(pair)
    motor, thermal = entry.motor, entry.motor.thermal
    rating_units = {name: si_unit(rating.kind) for name, rating in RATINGS.items()}
    motor_content: dict[str, Any] = _finite_values(motor, rating_units)
    if thermal is not None:
        thermal_units = {
            "winding_housing": "K/W", "housing_ambient": "K/W", "winding_time": "s", "housing_time": "s", "maximum": "degC",
        }  # fmt: skip
        thermal_content = _finite_values(thermal, thermal_units)
        thermal_content["coefficient"] = thermal.coefficient
        thermal_content["reference"] = f"{_shortest_decimal(thermal.reference)} degC"
        motor_content["thermal"] = thermal_content
    content: dict[str, Any] = {"ratio": gear.ratio, "efficiency": gear.efficiency, "motor": motor_content}
    if gear.no_load_torque:
        content["no_load_torque"] = f"{_shortest_decimal(gear.no_load_torque)} N m"
    mass = (entry.mass + gear.mass) * add_masses
    if entry.inertia or mass:
        inertia = f"{_shortest_decimal(entry.inertia or _UNKNOWN_ROTOR_INERTIA)} kg m^2"
        content["rotor"] = {"inertia": inertia, "extra": True, "mass": f"{_shortest_decimal(mass)} kg"}
    return content


def _finite_values(part: object, units: Mapping[str, str]) -> dict[str, Any]:
    """Attributes of a part that are finite, with their units."""
    values: dict[str, Any] = {}
    for name, unit in units.items():
        value = getattr(part, name)
        if math.isfinite(value):
            values[name] = f"{_shortest_decimal(value)} {unit}"
    return values


def sizing_of(
    robot: Robot,
    states: LoadStates,
    catalog: Catalog,
    *,
    pause: float,
    ambient: float,
    life: float | None,
    brake: bool,
    emergency: Motion | None,
    friction: bool,
    add_masses: bool,
    shared_supply: bool,
) -> Sizing:
    """Sizing for the states of a motion followed by the pause; smallest drives if the catalogue names none."""
    names = drive_joints(robot, catalog)
    robot_without_armature = bare_robot(robot, names)
    cycle_states, time, holding = _with_pause([states.motion, *states.draws], pause)
    problem = SizingProblem(
        robot=robot_without_armature,
        states=cycle_states,
        time=time,
        brake=brake,
        holding=holding,
        emergency=emergency,
        friction=friction,
        add_masses=add_masses,
        armed=_joints_with_armature(robot, names),
        ambient=ambient,
        life=life,
        shared=shared_supply,
        doubts=tuple(_load_doubts(robot_without_armature, states.motion)),
        bears=catalog.bears,
    )
    if catalog.drives:
        sizing = _size_drives(problem, catalog, catalog.drives, {})
    else:
        sizing = _choose_drives(problem, catalog, names)
    return replace(sizing, motion=states.motion)


def sizing_refused(robot: Robot, catalog: Catalog, report: TorqueReport) -> Sizing:
    """Sizing without drives, for a log that contradicts itself."""
    without_cycle = SizingProblem(
        robot,
        states=(),
        time=np.array([0.0, 1.0]),
        brake=False,
        holding=slice(0, 0),
        emergency=None,
        friction=True,
        add_masses=True,
        armed=(),
        ambient=25.0,
        life=None,
        shared=True,
    )
    return replace(_size_drives(without_cycle, catalog, {}, {}), report=report)


def drive_joints(robot: Robot, catalog: Catalog) -> tuple[str, ...]:
    """Joints whose drives are sized: those of the catalogue, or all driven revolute joints. Raises UnknownNameError."""
    revolute_joints: list[str] = []
    for body in robot.model.leaders:
        joint = body.joint
        if joint.nv == 1 and all(joint.turning) and joint.driven:
            revolute_joints.append(joint.name)
    names = tuple(catalog.drives) or tuple(revolute_joints)
    for name in names:
        if name not in revolute_joints:
            raise UnknownNameError.from_choices("joint that turns", name, revolute_joints)
    return names


def _joints_with_armature(robot: Robot, names: Iterable[str]) -> tuple[str, ...]:
    """Names of the joints whose armature is not zero."""
    armature_by_joint = dict(zip(robot.model.velocity_names, robot.armature, strict=True))
    return tuple(name for name in names if armature_by_joint[name])


def bare_robot(robot: Robot, names: Iterable[str]) -> Robot:
    """Robot without the armature of these joints, which the rotors of the drives replace."""
    joints = _joints_with_armature(robot, names)
    if not joints:
        return robot
    return robot.with_armature(dict.fromkeys(joints, 0.0))


class _Peak(NamedTuple):
    """Largest torque of a joint, as :func:`model_warnings` reads it."""

    peak: float
    unit: str
    uncertainty: float = 0.0


def _load_doubts(robot: Robot, motion: Motion) -> list[str]:
    """Reasons to be unsure of the loads of a robot: links without mass, and a base that nothing holds."""
    peaks = np.abs(robot.inverse_dynamics(motion.q, motion.dq, motion.ddq)).max(axis=0)
    units = units_of("tau", Coordinates.from_model(robot.model).angular_velocity)
    joint_peaks = [_Peak(float(peak), unit) for peak, unit in zip(peaks, units, strict=True)]
    return [*base_doubts(robot.model), *model_warnings(robot.model, joint_peaks)]


def _with_pause(motions: Sequence[Motion], pause: float) -> tuple[list[tuple[Array, Array, Array]], Array, slice]:
    """States of each motion followed by the pause, their times from 0, and the nodes of the pause, its begin and end."""
    first_motion = motions[0]  # all have the same times
    n = len(first_motion)
    time = first_motion.time - first_motion.time[0]
    if pause == 0:
        return [(motion.q, motion.dq, motion.ddq) for motion in motions], time, slice(n, n)
    zeros = np.zeros((2, first_motion.dq.shape[1]))
    states = []
    for motion in motions:
        q = np.concatenate([motion.q, motion.q[-1:], motion.q[-1:]])
        states.append((q, np.concatenate([motion.dq, zeros]), np.concatenate([motion.ddq, zeros])))
    time_with_pause = np.append(time, [time[-1], time[-1] + pause])
    return states, time_with_pause, slice(n, n + 2)


def _size_drives(
    problem: SizingProblem, catalog: Catalog, drives: Mapping[str, Pair], choice: Mapping[str, Chosen]
) -> Sizing:
    """Sizing of these drives, all of them on the robot."""
    parts_by_joint = {name: catalog.pair(pair) for name, pair in drives.items()}
    joints: dict[str, SizedJoint] = {}
    for name, motor_and_gear in parts_by_joint.items():
        cycles = problem.cycles(name, parts_by_joint)
        emergency = problem.emergency_cycle(name, parts_by_joint)
        joints[name] = problem.size_joint(name, motor_and_gear, cycles, emergency)
    left_out = tuple(name for name in problem.robot.model.velocity_names if name not in joints)
    powers = [joint.motor.power for joint in joints.values()]
    if not powers:
        powers = [np.zeros(len(problem.time))]
    supply = supply_of(powers, np.diff(problem.time), shared=problem.shared)
    return Sizing(joints, supply, catalog, choice, left_out, problem)


def _choose_drives(problem: SizingProblem, catalog: Catalog, names: Iterable[str]) -> Sizing:
    """Smallest drive of each joint, from tip to base, then the sizing with all of them on the robot."""
    sized_names = set(names)
    from_tip = [name for name in reversed(problem.robot.model.velocity_names) if name in sized_names]
    chosen_parts: dict[str, tuple[CatalogMotor, Gear]] = {}
    choice: dict[str, Chosen] = {}
    for joint in from_tip:
        chosen = _smallest_drive(problem, catalog, joint, chosen_parts)
        choice[joint] = chosen
        if chosen.drive is not None:
            chosen_parts[joint] = catalog.pair(chosen.drive)
    from_base = dict(reversed(choice.items()))
    drives = {name: chosen.drive for name, chosen in from_base.items() if chosen.drive}
    return _size_drives(problem, catalog, drives, from_base)


def _smallest_drive(
    problem: SizingProblem, catalog: Catalog, joint: str, chosen_parts: Mapping[str, tuple[CatalogMotor, Gear]]
) -> Chosen:
    """Smallest pair that is certainly sufficient; if there is none, the smallest that may be. Pairs are tried by size."""
    cycles = problem.cycles(joint, chosen_parts)
    emergency = problem.emergency_cycle(joint, chosen_parts)
    trials: list[SizedJoint] = []
    pairs = sorted(catalog.pairs, key=catalog.size)
    for pair in pairs:
        trial = problem.size_joint(joint, catalog.pair(pair), cycles, emergency)
        trials.append(trial)
        if trial.sure:
            break
    fitting_indices = [k for k, trial in enumerate(trials) if trial.fits]
    if not fitting_indices:
        return Chosen(joint, None, None)
    rivals: list[Pair] = []
    chosen_index = fitting_indices[0]
    if trials[-1].sure:  # the last trial, which also fits
        *rival_indices, chosen_index = fitting_indices
        rivals = [pairs[k] for k in rival_indices if not trials[k].missing]
    smaller = None
    if chosen_index > 0:
        next_smaller = trials[chosen_index - 1]
        reasons = next_smaller.excess or next_smaller.open or next_smaller.missing
        smaller = (pairs[chosen_index - 1], reasons[0])
    return Chosen(joint, pairs[chosen_index], smaller, tuple(rivals))


def drive_name(pair: Pair) -> str:
    """Names of a pair as text."""
    motor, gear = pair
    if gear == DIRECT:
        return f"motor {motor}"
    return f"gear {gear} with motor {motor}"


def smallest_drives(given: Sizing, chosen: Sizing) -> list[str]:
    """Sentence for each joint whose given drive is insufficient: the chosen drive and the mass that it adds."""
    sentences = []
    for name, joint in given.joints.items():
        if joint.fits:
            continue
        drive = chosen.choice[name].drive
        if drive is None:
            sentences.append(f"{name}: no pair of the catalogue does it")
        else:
            added_mass = chosen.joints[name].mass - joint.mass
            sign = "+" if added_mass >= 0 else "-"
            sentences.append(f"{name}: smallest that does it: {drive_name(drive)} ({sign}{number(abs(added_mass))} kg)")
    return sentences
