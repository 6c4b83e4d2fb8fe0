"""Sizing of a robot's drives for a repeated motion, and choice of the smallest drives from a catalogue."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core import arguments
from ..core.errors import ModelError, ShapeError, UnknownNameError, ValueRangeError
from ..core.files import replacing
from ..core.numbers import number
from ..core.typing import Array
from ..core.verdict import Verdict
from ..formats.yaml import Source, si_unit
from ..mechanics.joints.units import units_of
from ..mechanics.model.actuators import RATINGS, moving
from ..mechanics.model.couplings import refuse_couplings
from ..motion.coordinates import Coordinates
from ..motion.model_doubts import as_it_hangs, base_doubts, model_warnings
from ..motion.motion import Motion
from ..reports.load_states import LoadStates
from ..reports.motors import Demand
from ..robot.task_space_methods import require_robot
from .catalog import Catalog, Pair, read_catalog
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
        return [self._cycle(robot, joint, states, self.time, self.holding) for states in self.states]

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


@dataclass(frozen=True, eq=False)
class Sizing:
    """Drives of a robot over a cycle, compared with their ratings.

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
    ...     s.write_actuators(f"{folder}/actuators.yaml").name
    'actuators.yaml'
    """

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

    @cached_property
    def verdict(self) -> Verdict:
        """OVER LIMIT with every exceeded limit, UNSURE with every missing rating or where noise decides, or OK."""
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
        return _chosen(
            self.problem, self.catalog, tuple(self.joints) + tuple(n for n, c in self.choice.items() if not c.drive)
        )

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


def size_drives(
    robot: Robot,
    motion: Motion,
    catalog: Source | Catalog,
    *,
    pause: float = 0.0,
    ambient: float = 25.0,
    life: float | None = None,
    brake: bool = False,
    emergency: Motion | None = None,
    friction: bool = True,
    add_masses: bool = True,
    shared_supply: bool = True,
    draws: Sequence[Motion] = (),
) -> Sizing:
    """Drive sizing: loads of motors and gears over a repeated motion, compared with the ratings of a catalogue.

    If the catalogue has no ``actuators:``, the smallest pair is chosen for each revolute joint.

    Parameters
    ----------
    robot : Robot, with its payload, without actuators
    motion : Motion of this robot; the cycle is the motion followed by the pause, repeated indefinitely
        Derived rates are judged as those of a log by the command ``torques``: smoothed if noise matters.
    catalog : str, Path, mapping or Catalog; YAML file, its text or content, or "servos"; see docs/sizing.md
    pause : float, time at rest after the motion, while the motors hold the robot [s]
    ambient : float, temperature of the air [°C]
    life : float, optional, required life L₁₀ of strain-wave gears [h]
    brake : bool, brakes hold the robot in the pause
    emergency : Motion, optional, stop or collision, for the momentary peak torque of the gears
    friction : bool, include joint friction of the robot file
    add_masses : bool, add the masses of the drives; False if the links include them
    shared_supply : bool, a braking drive feeds the others through a common link
    draws : sequence of Motion, optional, equally likely motions at the same times, for the effect of noise on each load

    Returns
    -------
    sizing : Sizing

    Raises
    ------
    ModelError, UnknownNameError, NotFoundError
        The catalogue contradicts itself or names an unknown joint, or the robot has actuators.
    ValueRangeError
        A setting is not finite, or negative.

    Notes
    -----
    Iron losses, bearing moments and losses of the electronics are neglected.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.pendulum(), np.linspace(0, 2, 201)
    >>> motion = tw.Motion(t, np.sin(np.pi * t / 2)[:, None] ** 2, robot=arm)
    >>> s = tw.size_drives(arm, motion, {"motors": {"servo": {
    ...     "stall_torque": "30 N m", "no_load_speed": "60 rpm", "voltage": "24 V"}}})
    >>> print(s.verdict)
    UNSURE: hinge, motor servo: stall data only
    """
    require_robot(robot, "size_drives")
    refuse_couplings(robot.model, "size_drives")
    for given in (motion, *([] if emergency is None else [emergency]), *draws):
        if not isinstance(given, Motion):
            raise ShapeError(f"size_drives: a motion is a tw.Motion, got {arguments.shown(given)}.")
    listed = read_catalog(catalog)
    arguments.positive(pause, "size_drives: pause", "s", zero=True)
    arguments.positive(1.0 if life is None else life, "size_drives: life", "h")
    if not -273.15 <= arguments.number(ambient, "size_drives: ambient") < 1000:
        raise ValueRangeError(f"size_drives: ambient={ambient!r} is not a temperature of air in °C.")
    if robot.actuators:
        raise ModelError(
            f"robot {robot.name!r} has actuators already, and the catalogue describes the drives. Load it without --actuators."
        )
    turning = {b.joint.name for b in robot.model.leaders if b.joint.nv == 1 and b.joint.turning[0] and b.joint.driven}
    names = tuple(listed.drives) or tuple(n for n in robot.model.velocity_names if n in turning)
    for name in names:
        if name not in turning:
            raise UnknownNameError.from_choices("joint that turns", name, turning)
    armed = {n: 0.0 for n in names if robot.armature[robot.model.velocity_names.index(n)]}
    bare = robot.with_armature(armed) if armed else robot
    states = LoadStates.from_motion(bare, motion.with_robot(bare), friction=friction)
    stop = None if emergency is None else LoadStates.from_motion(bare, emergency.with_robot(bare)).motion
    likely = states.draws or [one.with_robot(bare) for one in draws]
    cycles, time, holding = _with_pause([states.motion, *likely], pause)
    problem = SizingProblem(
        bare, cycles, time, brake, holding, stop, friction, add_masses, tuple(armed), ambient, life, shared_supply,
        tuple(_doubts(bare, states.motion)),
    )  # fmt: skip
    if not listed.drives:
        return _chosen(problem, listed, names)
    return _sizing(problem, listed, listed.drives, {})


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
