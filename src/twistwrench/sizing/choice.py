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
from ..motion.model_doubts import as_it_hangs, base_doubts, model_warnings
from ..motion.motion import Motion
from ..reports.load_states import LoadStates
from ..reports.motors import Demand
from ..reports.torque_report import TorqueReport
from ..reports.torque_verdict import as_it_stands, contradictions, log_doubts, rows_in_doubt
from ..statics.reactions import bearing_loads
from .catalog import Catalog, Pair
from .drives import (
    CatalogMotor,
    Cycle,
    Gear,
    SizedGear,
    SizedMotor,
    Supply,
    sized_gear,
    sized_motor,
    supply_of,
    with_noise,
)

if TYPE_CHECKING:
    from ..core.answers.page import Setting
    from ..robot import Robot

_FAR = 2.0
"""Share of a limit above which noise of a log cannot matter."""
_LIGHTEST = 1e-15
"""Inertia used for rotors of unknown inertia [kg m²]."""


@dataclass(frozen=True, eq=False)
class SizedJoint:
    """Drive of one joint over the cycle."""

    joint: str
    drive: Pair
    mass: float
    """kg, of motor and gear together."""
    motor: SizedMotor
    gear: SizedGear
    cycle: Cycle

    @property
    def excess(self) -> tuple[str, ...]:
        """Sentence without a full stop for each exceeded limit, largest excess first."""
        found = [(d, part) for part in self._parts for d in part[1].excess]
        return tuple(_words(self.joint, part, d) for d, part in sorted(found, key=lambda x: -x[0].share))

    @property
    def missing(self) -> tuple[str, ...]:
        """Sentence without a full stop for each part that lacks ratings."""
        return tuple(
            f"{self.joint}, {what} {part.name}: {', '.join(part.missing)}{'' if 'stall' in part.missing[-1] else ' not given'}"
            for what, part in self._parts
            if part.missing
        )

    @property
    def tightest(self) -> tuple[str, Demand]:
        """Demand nearest to its limit, with the name of its part."""
        what, part = max(self._parts, key=lambda x: x[1].tightest.share)
        return f"{what} {part.name}", part.tightest

    @property
    def open(self) -> tuple[str, ...]:
        """Sentence without a full stop for each demand of which noise of the log decides whether its limit is exceeded."""
        return tuple(
            f"noise of the log decides: {_words(self.joint, part, d)}" for part in self._parts for d in part[1].open
        )

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
        return ("gear", self.gear), ("motor", self.motor)


def _words(joint: str, part: tuple[str, SizedMotor | SizedGear], demand: Demand) -> str:
    return f"{joint}, {part[0]} {part[1].name}: {demand.words}"


@dataclass(frozen=True, eq=False)
class Chosen:
    """Drive chosen for a joint."""

    joint: str
    drive: Pair | None
    """None if no pair of the catalogue is sufficient."""
    smaller: tuple[Pair, str] | None
    """Next smaller pair and the reason for its rejection; None if there is none."""
    rivals: tuple[Pair, ...] = ()
    """Smaller pairs that may be sufficient, as noise of the log decides."""


@dataclass(frozen=True, eq=False)
class SizingProblem:
    """Robot, cycle and settings shared by all candidates."""

    robot: Robot
    states: Sequence[tuple[Array, Array, Array]]
    """q, dq and ddq at the nodes of the cycle, followed by those of equally likely cycles."""
    time: Array
    brake: bool
    holding: slice
    emergency: Motion | None
    friction: bool
    add_masses: bool
    armed: tuple[str, ...]
    """Joints whose armature in the robot file is replaced by the rotors of the drives."""
    ambient: float
    life: float | None
    shared: bool
    doubts: tuple[str, ...] = ()
    """Reasons to be unsure of all loads."""
    bears: bool = False
    """True if a gear of the catalogue has limits of its bearing."""

    def driven(self, drives: Mapping[str, tuple[CatalogMotor, Gear]], probe: str | None = None) -> Robot:
        """Robot with the drives as rotors with mass, and a rotor of 1 kg m² without a gear at ``probe``."""
        entries: dict[str, Any] = {
            joint: {
                "ratio": gear.ratio,
                "rotor": {
                    "inertia": f"{motor.inertia or _LIGHTEST!r} kg m^2",
                    "extra": True,
                    "mass": f"{(motor.mass + gear.mass) * self.add_masses!r} kg",
                },
            }
            for joint, (motor, gear) in drives.items()
        }
        if probe is not None:
            entries[probe] = {"ratio": 1, "rotor": {"inertia": "1 kg m^2", "extra": True}}
        return self.robot.with_actuators({"actuators": entries}) if entries else self.robot

    def cycles(self, joint: str, drives: Mapping[str, tuple[CatalogMotor, Gear]]) -> list[Cycle]:
        """Loads of a joint in each of the cycles, given the drives of other joints that load it."""
        robot = self._probed(joint, drives)
        found = [self._cycle(robot, joint, states, self.time, self.holding) for states in self.states]
        if not self.bears:
            return found
        bare = self.driven({name: drive for name, drive in drives.items() if name != joint})
        return [
            cycle._replace(bearing=_bearing(bare, joint, states))
            for cycle, states in zip(found, self.states, strict=True)
        ]

    def emergency_cycle(self, joint: str, drives: Mapping[str, tuple[CatalogMotor, Gear]]) -> Cycle | None:
        """Loads of a joint in the emergency; None without one."""
        if (stop := self.emergency) is None:
            return None
        return self._cycle(
            self._probed(joint, drives), joint, (stop.q, stop.dq, stop.ddq), stop.time, slice(len(stop), None)
        )

    def _probed(self, joint: str, drives: Mapping[str, tuple[CatalogMotor, Gear]]) -> Robot:
        return self.driven({name: drive for name, drive in drives.items() if name != joint}, probe=joint)

    def _cycle(
        self, robot: Robot, joint: str, states: tuple[Array, Array, Array], time: Array, holding: slice
    ) -> Cycle:
        q, dq, ddq = states
        k = robot.model.velocity_names.index(joint)
        carried, rotor = robot.drive_torques(q, dq, ddq)
        torque = np.array(carried[:, k])
        if self.friction:
            torque = torque + robot.friction_forces(moving(dq), load=carried)[:, k]
        if self.brake:
            torque[holding] = 0.0
        mass = robot.mass_matrix(q)[:, k, k] - 1.0  # subtract the probe's inertia
        return Cycle(time, np.diff(time), moving(dq[:, k]), torque, ddq[:, k], rotor[:, k] - ddq[:, k], mass)

    def sized(
        self, joint: str, drive: tuple[CatalogMotor, Gear], cycles: Sequence[Cycle], emergency: Cycle | None
    ) -> SizedJoint:
        """One drive under the loads of its joint, in the cycle and in equally likely ones."""
        motor, gear = drive
        held = self.holding if self.brake else slice(0, 0)
        given: dict[str, Any] = {"ambient": self.ambient, "holding": held, "weighs": self.add_masses}
        motors = [sized_motor(motor, gear, cycles[0], **given)]
        gears = [sized_gear(gear, cycles[0], self.life, emergency, weighs=self.add_masses)]
        if len(cycles) > 1 and max(motors[0].tightest.share, gears[0].tightest.share) < _FAR:
            motors += [sized_motor(motor, gear, c, **given) for c in cycles[1:]]
            gears += [sized_gear(gear, c, self.life, emergency, weighs=self.add_masses) for c in cycles[1:]]
            motors[0] = replace(motors[0], demands=with_noise(motors[0].demands, [m.demands for m in motors[1:]]))
            gears[0] = replace(gears[0], demands=with_noise(gears[0].demands, [g.demands for g in gears[1:]]))
        mass = motor.mass + gear.mass
        return SizedJoint(joint, (motor.name, gear.name), mass, motors[0], gears[0], cycles[0])


def _bearing(robot: Robot, joint: str, states: tuple[Array, Array, Array]) -> dict[str, Array]:
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
        """OVER LIMIT with every exceeded limit, UNSURE with every missing rating or where noise or the log decides, or OK.

        LOOK AGAIN if the log contradicts itself. A rating exceeded by a log whose rows are in doubt is not certain.
        """
        own, report = self.of_drives, self.report
        if report is None:
            return own
        if refused := contradictions(report):
            return Verdict.from_reasons(look_again=refused)
        rows, others = rows_in_doubt(report), log_doubts(report)
        if rows and own.word is Word.OVER_LIMIT:
            own = Verdict.from_reasons(unsure=[f"{as_it_stands(report)} {Word.OVER_LIMIT}: {own.reasons[0]}"])
        return Verdict.from_reasons(unsure=[*rows, *(text for text in others if text not in rows)]).joined(own)

    @cached_property
    def of_drives(self) -> Verdict:
        """Verdict on the drives alone, as if the log had no doubts."""
        over = [f"{name}: no pair of the catalogue does it" for name, x in self.choice.items() if x.drive is None]
        over += [words for one in self._by_share for words in one.excess]
        unsure = [
            f"{name}: noise of the log decides between {' and '.join(map(drive_name, (*x.rivals, x.drive)))}"
            for name, x in self.choice.items()
            if x.drive is not None and x.rivals
        ]
        unsure += [words for one in self._by_share for words in (*one.open, *one.missing)]
        if base_doubts(self.problem.robot.model):  # other torques are those of a robot that stands
            over, unsure = [], [*map(as_it_hangs, over[:1]), *unsure]
        return Verdict.from_reasons(over=over, unsure=[*self.problem.doubts, *unsure])

    # ── The answer on every surface

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.problem.robot.name

    @property
    def subject(self) -> str:
        """Robot and motion."""
        return self.robot_name if self.report is None else f"{self.robot_name} · {Path(self.report.trajectory).name}"

    @property
    def brief(self) -> str:
        """Joint without a sufficient drive, or the joint nearest to a rating with its share."""
        if lacking := [name for name, chosen in self.choice.items() if chosen.drive is None]:
            return f"no drive for {lacking[0]}"
        nearest = next(iter(self._by_share), None)
        return "" if nearest is None else f"{nearest.joint} {percent_of_limit(nearest.tightest[1].share)}"

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
        motion = {} if self.report is None else {"MOTION": self.report.trajectory}
        return {**motion, "ROBOT": self.problem.robot.model.source}

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
        parts = [(j.joint, *part) for j in self.joints.values() for part in (("gear", j.gear), ("motor", j.motor))]
        with csv_table(path, columns) as table:
            for joint, part, use in parts:
                for d in use.demands:
                    limit, share = (x if np.isfinite(x) else None for x in (d.limit, d.share))
                    table.row([joint, part, use.name, d.what, d.value, limit, d.unit, share])
        return Path(path)

    @property
    def _by_share(self) -> list[SizedJoint]:
        return sorted(self.joints.values(), key=lambda one: -one.tightest[1].share)

    @property
    def mass(self) -> float:
        """Mass of all drives [kg]."""
        return sum(one.mass for one in self.joints.values())

    def choose(self) -> Sizing:
        """Smallest drives of the catalogue, by mass, then price, then torque.

        Joints are processed from tip to base: a drive sits on the link before its joint and loads only joints nearer
        the base.

        Returns
        -------
        sizing : Sizing, with all chosen drives on the robot
        """
        names = tuple(self.joints) + tuple(n for n, c in self.choice.items() if not c.drive)
        return replace(_chosen(self.problem, self.catalog, names), motion=self.motion, report=self.report)

    def actuators(self) -> dict[str, Any]:
        """Drives as entries of an actuator file; docs/actuation.md shows one.

        Returns
        -------
        content : dict, for :meth:`twistwrench.Robot.with_actuators`
        """
        entries = {name: _entry(self.catalog, one.drive, self.problem.add_masses) for name, one in self.joints.items()}
        for name in entries.keys() & set(self.problem.armed):
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

        with replacing(path) as scratch:
            scratch.write_text(yaml.safe_dump(self.actuators(), sort_keys=False, allow_unicode=True), encoding="utf-8")
        return Path(path)


def _exact(value: float) -> str:
    """Shortest decimal from which the number is read again."""
    return repr(float(value))


def _entry(catalog: Catalog, pair: Pair, add_masses: bool) -> dict[str, Any]:
    entry, gear = catalog.pair(pair)
    motor, thermal = entry.motor, entry.motor.thermal
    said: dict[str, Any] = {
        name: f"{_exact(getattr(motor, name))} {si_unit(row.kind)}"
        for name, row in RATINGS.items()
        if math.isfinite(getattr(motor, name))
    }
    if thermal is not None:
        units = {"winding_housing": "K/W", "housing_ambient": "K/W", "winding_time": "s", "housing_time": "s",
                 "maximum": "degC"}  # fmt: skip
        known = {name: getattr(thermal, name) for name in units}
        said["thermal"] = {name: f"{_exact(x)} {units[name]}" for name, x in known.items() if math.isfinite(x)}
        said["thermal"] |= {"coefficient": thermal.coefficient, "reference": f"{_exact(thermal.reference)} degC"}
    found: dict[str, Any] = {"ratio": gear.ratio, "efficiency": gear.efficiency, "motor": said}
    if gear.no_load_torque:
        found["no_load_torque"] = f"{_exact(gear.no_load_torque)} N m"
    mass = (entry.mass + gear.mass) * add_masses
    if entry.inertia or mass:
        inertia = f"{_exact(entry.inertia or _LIGHTEST)} kg m^2"
        found["rotor"] = {"inertia": inertia, "extra": True, "mass": f"{_exact(mass)} kg"}
    return found


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
    armed = tuple(n for n in names if robot.armature[robot.model.velocity_names.index(n)])
    bare = bare_robot(robot, names)
    cycles, time, holding = _with_pause([states.motion, *states.draws], pause)
    problem = SizingProblem(
        bare, cycles, time, brake, holding, emergency, friction, add_masses, armed, ambient, life, shared_supply,
        tuple(_doubts(bare, states.motion)), catalog.bears,
    )  # fmt: skip
    if not catalog.drives:
        found = _chosen(problem, catalog, names)
    else:
        found = _sizing(problem, catalog, catalog.drives, {})
    return replace(found, motion=states.motion)


def sizing_refused(robot: Robot, catalog: Catalog, report: TorqueReport) -> Sizing:
    """Sizing without drives, for a log that contradicts itself."""
    still = SizingProblem(robot, (), np.array([0.0, 1.0]), False, slice(0, 0), None, True, True, (), 25.0, None, True)
    return replace(_sizing(still, catalog, {}, {}), report=report)


def drive_joints(robot: Robot, catalog: Catalog) -> tuple[str, ...]:
    """Joints whose drives are sized: those of the catalogue, or all driven revolute joints. Raises UnknownNameError."""
    turning = {
        b.joint.name: b for b in robot.model.leaders if b.joint.nv == 1 and b.joint.turning[0] and b.joint.driven
    }
    names = tuple(catalog.drives) or tuple(n for n in robot.model.velocity_names if n in turning)
    for name in names:
        if name not in turning:
            raise UnknownNameError.from_choices("joint that turns", name, turning)
    return names


def bare_robot(robot: Robot, names: Iterable[str]) -> Robot:
    """Robot without the armature of these joints, which the rotors of the drives replace."""
    armed = {n: 0.0 for n in names if robot.armature[robot.model.velocity_names.index(n)]}
    return robot.with_armature(armed) if armed else robot


class _Peak(NamedTuple):
    """Largest torque of a velocity."""

    peak: float
    unit: str
    uncertainty: float = 0.0


def _doubts(robot: Robot, motion: Motion) -> list[str]:
    """Reasons to be unsure of the loads of a robot: links without mass, and a base that nothing holds."""
    peaks = np.abs(robot.inverse_dynamics(motion.q, motion.dq, motion.ddq)).max(axis=0)
    units = units_of("tau", Coordinates.from_model(robot.model).angular_velocity)
    found = [_Peak(float(x), unit) for x, unit in zip(peaks, units, strict=True)]
    return [*base_doubts(robot.model), *model_warnings(robot.model, found)]


def _with_pause(motions: Sequence[Motion], pause: float) -> tuple[list[tuple[Array, Array, Array]], Array, slice]:
    """States of each motion followed by the pause, their times, and the nodes of the pause."""
    n, time = len(motions[0]), motions[0].time - motions[0].time[0]
    if pause == 0:
        return [(one.q, one.dq, one.ddq) for one in motions], time, slice(n, n)
    still = np.zeros((2, motions[0].dq.shape[1]))
    states = [
        (
            np.concatenate([one.q, one.q[-1:], one.q[-1:]]),
            np.concatenate([one.dq, still]),
            np.concatenate([one.ddq, still]),
        )
        for one in motions
    ]
    return states, np.append(time, [time[-1], time[-1] + pause]), slice(n, n + 2)


def _sizing(
    problem: SizingProblem, catalog: Catalog, drives: Mapping[str, Pair], choice: Mapping[str, Chosen]
) -> Sizing:
    """Sizing of all drives."""
    parts = {name: catalog.pair(pair) for name, pair in drives.items()}
    joints = {
        name: problem.sized(name, drive, problem.cycles(name, parts), problem.emergency_cycle(name, parts))
        for name, drive in parts.items()
    }
    left = tuple(n for n in problem.robot.model.velocity_names if n not in joints)
    supply = supply_of([j.motor.power for j in joints.values()] or [np.zeros(len(problem.time))], np.diff(problem.time),
                       shared=problem.shared)  # fmt: skip
    return Sizing(joints, supply, catalog, choice, left, problem)


def _chosen(problem: SizingProblem, catalog: Catalog, names: Iterable[str]) -> Sizing:
    """Smallest drive of each joint, from tip to base, then the sizing with all of them on the robot."""
    order = [n for n in reversed(problem.robot.model.velocity_names) if n in set(names)]
    parts: dict[str, tuple[CatalogMotor, Gear]] = {}
    choice: dict[str, Chosen] = {}
    for joint in order:
        choice[joint] = found = _smallest(problem, catalog, joint, parts)
        if found.drive is not None:
            parts[joint] = catalog.pair(found.drive)
    back = {name: choice[name] for name in reversed(choice)}
    return _sizing(problem, catalog, {n: c.drive for n, c in back.items() if c.drive}, back)


def _smallest(
    problem: SizingProblem, catalog: Catalog, joint: str, parts: Mapping[str, tuple[CatalogMotor, Gear]]
) -> Chosen:
    """Smallest pair that certainly does it, else the smallest that may; pairs are tried by their size."""
    cycles, stop = problem.cycles(joint, parts), problem.emergency_cycle(joint, parts)
    tried: list[tuple[Pair, SizedJoint]] = []
    for pair in sorted(catalog.pairs, key=catalog.size):
        tried.append((pair, problem.sized(joint, catalog.pair(pair), cycles, stop)))
        if tried[-1][1].sure:
            break
    sure = bool(tried) and tried[-1][1].sure
    fitting = [k for k, (_, one) in enumerate(tried) if one.fits]
    if not fitting:
        return Chosen(joint, None, None)
    k = fitting[-1] if sure else fitting[0]
    smaller = None
    if k:
        pair, before = tried[k - 1]
        smaller = pair, (before.excess or before.open or before.missing)[0]
    rivals = tuple(tried[i][0] for i in fitting if i < k and not tried[i][1].missing)
    return Chosen(joint, tried[k][0], smaller, rivals if sure else ())


def drive_name(pair: Pair) -> str:
    """Names of a pair as text."""
    return f"motor {pair[0]}" if pair[1] == "none" else f"gear {pair[1]} with motor {pair[0]}"


def smallest_drives(now: Sizing, best: Sizing) -> list[str]:
    """Sentence for each joint with an insufficient drive: the smallest sufficient one and the mass it adds."""
    lines = []
    for name, one in now.joints.items():
        if one.fits:
            continue
        chosen = best.choice[name].drive
        if chosen is None:
            lines.append(f"{name}: no pair of the catalogue does it")
        else:
            more = best.joints[name].mass - one.mass
            lines.append(
                f"{name}: smallest that does it: {drive_name(chosen)} ({'+' if more >= 0 else '-'}{number(abs(more))} kg)"
            )
    return lines
