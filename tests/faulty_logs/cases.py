"""Cases of faulty logs: what is done to a robot or to its log, the names under which that may be reported, and its value.

A case changes the world (the true robot, where it stands, its friction), or the log of it, or both. Rows of a log that is
changed in time are computed anew for the times that they are of, so that nothing is interpolated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.signal import lfilter

from twistwrench.mechanics.bodies.inertia import SpatialInertia

from .truth import (
    RATE,
    SECONDS,
    Array,
    States,
    Truth,
    coloured,
    moved_links,
    turned_gravity,
    with_links,
)

TIP_LOAD, TIP_COM = 2.0, np.array([0.02, -0.01, 0.05])
"""kg, and where in the frame of the tip [m]."""
_LEAD = 3.0
"""Seconds before the log, for filters to settle."""


@dataclass(eq=False)
class Recording:
    """A log in the making: motion, truth, rows; ``tau`` are measured torques, with noise."""

    truth: Truth
    motion: Callable[[Array], States]
    rng: np.random.Generator
    t: Array
    q: Array
    tau: Array
    noise: Array
    value: dict[str, Any] = field(default_factory=dict)
    """What was drawn: times, places and sizes."""

    def torques_at(self, t: Array) -> Array:
        """True torques at times."""
        return self.truth.torques(*self.motion(t), t)

    @property
    def size(self) -> Array:
        """(nv,) deviations of the torques."""
        return self.tau.std(axis=0)


World = Callable[[Truth, States, np.random.Generator], Truth]
Change = Callable[[Recording], None]


@dataclass(frozen=True, eq=False)
class Case:
    """A case: its name, names of causes any of which is right, and what is done."""

    name: str
    causes: tuple[str, ...] = ()
    """Right names; empty where nothing is wrong, so that any cause named is a false alarm."""
    world: tuple[World, ...] = ()
    log: tuple[Change, ...] = ()
    value: Mapping[str, Any] = field(default_factory=dict)
    """Expected values by cause: a number, in the unit of the report."""
    joints: tuple[int, ...] = ()
    told: bool = True
    """False where no single log can tell it."""
    notes: tuple[str, ...] = ()
    """Names that may stand there besides, as notes."""
    single: bool = False
    """True if it is one of the 31 faults of the prototype."""
    variant: str = ""

    @property
    def clean(self) -> bool:
        """True if nothing is wrong with the log that a cause could name."""
        return not self.causes


# ── The world


def tilted(truth: Truth, _states: States, rng: np.random.Generator, *, degrees: float) -> Truth:
    """The base tilted about a horizontal axis."""
    return replace(truth, gravity=turned_gravity(truth.gravity, np.radians(degrees), rng.uniform(0, 2 * np.pi)))


def mounted(truth: Truth, _states: States, _rng: np.random.Generator, *, degrees: float) -> Truth:
    """On a wall or a ceiling."""
    return replace(truth, gravity=turned_gravity(truth.gravity, np.radians(degrees), 0.0))


def laws(truth: Truth, _states: States, _rng: np.random.Generator, **changes: float) -> Truth:
    """Other laws of friction; static friction as a share of Coulomb's."""
    if "static" in changes:
        return replace(truth, **{**changes, "static": changes["static"] * truth.drives["coulomb"]})
    return replace(truth, **changes)


def loaded(truth: Truth, _states: States, _rng: np.random.Generator) -> Truth:
    """Two kilograms at the tip."""
    return truth.carrying(TIP_LOAD, TIP_COM)


def other_masses(truth: Truth, _states: States, rng: np.random.Generator) -> Truth:
    """Every link up to three times as heavy, or as light, as it was."""
    shares = {n: 3.0 ** rng.uniform(-1, 1) for n in moved_links(truth.robot)}
    links = {n: SpatialInertia.from_parameters(shares[n] * G.parameters) for n, G in moved_links(truth.robot).items()}
    return replace(truth, robot=with_links(truth.robot, links))


# ── The log: time


def late(log: Recording, *, seconds: float, joints: tuple[int, ...] | None = None) -> None:
    """Torques that are written later than the positions that they belong to."""
    which = list(range(log.tau.shape[1])) if joints is None else list(joints)
    log.tau[:, which] = (log.torques_at(log.t - seconds) + log.noise)[:, which]


def low_passed(log: Recording, *, hertz: float) -> None:
    """Torques through a filter of first order, discretised by its exact step response."""
    keep = np.exp(-2 * np.pi * hertz / RATE)
    before = np.arange(-_LEAD, 0.0, 1 / RATE)
    whole = log.torques_at(np.concatenate([before, log.t]))
    start = whole[:1] * keep
    log.tau = lfilter([1 - keep], [1, -keep], whole, axis=0, zi=start)[0][len(before) :] + log.noise


def rows_missing(log: Recording, *, share: float) -> None:
    """Rows left out at random."""
    _keep(log, log.rng.random(len(log.t)) >= share)


def stamps_shaken(log: Recording) -> None:
    """Stamps that are off by a millisecond at most."""
    log.t = log.t + log.rng.uniform(-1e-3, 1e-3, len(log.t))


def resampled(log: Recording) -> None:
    """Every tenth row."""
    _keep(log, np.arange(len(log.t)) % 10 == 0)


def held(log: Recording) -> None:
    """Positions of every tenth row, written into the nine that follow."""
    log.q = log.q[np.arange(len(log.t)) // 10 * 10]


def paused(log: Recording, *, seconds: float, closed: bool = False) -> None:
    """Rows missing for a while; the times after it moved up where it is closed."""
    start = 0.45 * SECONDS
    gap = (log.t >= start) & (log.t < start + seconds)
    after = log.t >= start + seconds
    if closed:
        log.t = np.where(after, log.t - gap.sum() / RATE, log.t)
    _keep(log, ~gap)
    log.value |= {"from": start, "to": start + seconds}


def buffered(log: Recording, *, seconds: float) -> None:
    """Positions that are late for half of the time, in stretches of half a second to two."""
    late_now, now, flag = np.zeros(len(log.t), bool), 0.0, bool(log.rng.integers(2))
    while now < log.t[-1]:
        length = log.rng.uniform(0.5, 2.0)
        late_now[(log.t >= now) & (log.t < now + length)] = flag
        now, flag = now + length, not flag
    log.q = np.where(late_now[:, None], log.motion(log.t - seconds)[0], log.q)
    log.value |= {"share": float(late_now.mean())}


def clocked(log: Recording, *, times: float) -> None:
    """A clock that runs at another rate."""
    log.t = log.t * times


def _keep(log: Recording, rows: Array) -> None:
    log.t, log.q, log.tau, log.noise = log.t[rows], log.q[rows], log.tau[rows], log.noise[rows]


# ── The log: columns


def scaled(log: Recording, *, times: float, joints: tuple[int, ...] | None = None) -> None:
    """Torques of joints times a number."""
    log.tau[:, slice(None) if joints is None else list(joints)] *= times


def positions_scaled(log: Recording, *, times: float, joints: tuple[int, ...] | None = None) -> None:
    """Positions of joints times a number."""
    log.q[:, slice(None) if joints is None else list(joints)] *= times


def exchanged(log: Recording, *, column: str, joints: tuple[int, int]) -> None:
    """Two columns of torques, or of positions, exchanged."""
    x = getattr(log, column)
    x[:, list(joints)] = x[:, list(joints)[::-1]]


def zero_off(log: Recording, *, degrees: float, joint: int) -> None:
    """Positions of a joint counted from another zero."""
    log.q[:, joint] += np.radians(degrees)


def without_gravity(log: Recording) -> None:
    """Torques less those of gravity, as controllers report that compensate it."""
    q, dq, _ = log.motion(log.t)
    log.tau = log.tau - log.truth.rigid(q, 0 * dq, 0 * dq)


def friction_compensated(log: Recording) -> None:
    """Torques less 1.3 times those of friction."""
    states = log.motion(log.t)
    log.tau = log.tau - 1.3 * log.truth.friction(log.truth.rigid(*states), states[1], log.t)


def elastic(log: Recording, *, degrees: float) -> None:
    """Positions of motors before elastic gears, which twist by so much at the largest torque."""
    clean = log.tau - log.noise
    log.q = log.q + np.radians(degrees) * clean / np.abs(clean).max(axis=0)


def quantised(log: Recording) -> None:
    """Positions on a grid of a milliradian."""
    log.q = log.q.round(3)


def saturated(log: Recording) -> None:
    """Torques cut off at 60 % of the largest."""
    most = 0.6 * np.abs(log.tau).max(axis=0)
    log.tau = np.clip(log.tau, -most, most)


def pushed(log: Recording) -> None:
    """Thirty newtons on the tip for two seconds, in a direction of its own."""
    start, direction = 0.4 * SECONDS, log.rng.normal(size=3)
    on = (log.t >= start) & (log.t < start + 2.0)
    force = 30.0 * direction / np.linalg.norm(direction)
    states = tuple(x[on] for x in log.motion(log.t))
    with_force = log.truth.rigid(*states, force=np.broadcast_to(force, (int(on.sum()), 3)))
    log.tau[on] += with_force - log.truth.rigid(*states)
    log.value |= {"from": start, "to": start + 2.0}


def swaying(log: Recording) -> None:
    """A base that sways by 0.5 m/s² at 0.83 Hz, horizontally."""
    angle = log.rng.uniform(0, 2 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    states = log.motion(log.t)
    accelerations = 0.5 * np.sin(2 * np.pi * 0.83 * log.t)[:, None] * along
    log.tau = log.tau + log.truth.rigid(*states, accelerations=accelerations) - log.truth.rigid(*states)


def spiked(log: Recording) -> None:
    """Half a per cent of the rows with a torque that is far off."""
    rows = np.flatnonzero(log.rng.random(len(log.t)) < 0.005)
    joints = log.rng.integers(log.tau.shape[1], size=len(rows))
    log.tau[rows, joints] += log.rng.choice([-10.0, 10.0], len(rows)) * log.size[joints]
    log.value |= {"rows": len(rows)}


def one_row_off(log: Recording) -> None:
    """One position that is off by 0.05 rad."""
    row = int(log.rng.integers(len(log.t) // 4, 3 * len(log.t) // 4))
    log.q[row, 1] += 0.05
    log.value |= {"at": float(log.t[row])}


def drifting(log: Recording) -> None:
    """A torque whose zero drifts by 30 % of its deviation."""
    log.tau[:, 1] += 0.3 * log.size[1] * log.t / SECONDS
    log.value |= {"drift": float(0.3 * log.size[1])}


def dead(log: Recording, *, column: str, joint: int) -> None:
    """A column that is one number throughout."""
    x = getattr(log, column)
    x[:, joint] = x[0, joint] if column == "q" else 0.0


def half_way(log: Recording) -> Array:
    """(n,) bool: rows of the second half."""
    log.value |= {"from": SECONDS / 2}
    return np.asarray(log.t >= SECONDS / 2)


def scaled_half_way(log: Recording, *, times: float, joint: int) -> None:
    """Torque of a joint times a number, in the second half."""
    log.tau[half_way(log), joint] *= times


def loaded_after(log: Recording, *, part: float, mass: float) -> None:
    """A load on the tip, from a part of the log on."""
    rows = log.t >= part * SECONDS
    log.value |= {"from": part * SECONDS}
    log.tau[rows] += log.truth.carrying(mass, TIP_COM).torques(*log.motion(log.t[rows]), log.t[rows])
    log.tau[rows] -= log.torques_at(log.t[rows])


def shifted_half_way(log: Recording, *, seconds: float) -> None:
    """Positions that are late in the second half."""
    rows = half_way(log)
    log.q[rows] = log.motion(log.t[rows] - seconds)[0]


def dropped_out(log: Recording, *, joint: int) -> None:
    """A torque that is zero for four seconds."""
    rows = (log.t >= 0.6 * SECONDS) & (log.t < 0.8 * SECONDS)
    log.tau[rows, joint] = 0.0
    log.value |= {"from": 0.6 * SECONDS, "to": 0.8 * SECONDS}


def without_gravity_of(log: Recording, *, joint: int) -> None:
    """A torque less that of gravity."""
    q, dq, _ = log.motion(log.t)
    log.tau[:, joint] -= log.truth.rigid(q, 0 * dq, 0 * dq)[:, joint]


def gain_drifting(log: Recording, *, share: float, joints: tuple[int, ...] | None = None) -> None:
    """Torques whose constants fall as motors warm."""
    which = list(range(log.tau.shape[1])) if joints is None else list(joints)
    log.tau[:, which] *= 1.0 - share * (log.t / SECONDS)[:, None]


def sprung(log: Recording, *, joint: int) -> None:
    """A linear spring whose torque has 30 % of the deviation of the joint's."""
    q = log.motion(log.t)[0][:, joint]
    log.tau[:, joint] += 0.3 * log.size[joint] * (q - q.mean()) / q.std()


def pulled(log: Recording) -> None:
    """Twenty newtons on the tip throughout, along one direction of the world."""
    direction = log.rng.normal(size=3)
    force = 20.0 * direction / np.linalg.norm(direction)
    states = log.motion(log.t)
    log.tau += log.truth.rigid(*states, force=np.broadcast_to(force, (len(log.t), 3))) - log.truth.rigid(*states)


def offset_half_way(log: Recording, *, joint: int) -> None:
    """An offset of half a torque's deviation in the second half."""
    log.tau[half_way(log), joint] += 0.5 * log.size[joint]


def copied(log: Recording, *, joint: int, times: float = 0.5) -> None:
    """The torque of the joint before, written into a joint's column at a scale."""
    log.tau[:, joint] = times * log.tau[:, joint - 1]


def coupled_encoder(log: Recording, *, joint: int) -> None:
    """A position that counts that of the joint before as well."""
    log.q[:, joint] += log.q[:, joint - 1]


def unsigned(log: Recording, *, joint: int) -> None:
    """A torque without its sign."""
    log.tau[:, joint] = np.abs(log.tau[:, joint])


def standing(log: Recording) -> None:
    """A robot at rest, whose encoders are noisy by a microradian."""
    q = np.tile(log.q[100], (len(log.t), 1))
    log.tau = log.truth.rigid(q, 0 * q, 0 * q) + log.noise
    log.q = q + 1e-6 * log.rng.normal(size=q.shape)


# ── The table


def _cases() -> tuple[Case, ...]:
    """The 70 faults of the specification, in its order."""
    tilt, gain, zero = ("tilt",), ("gain",), ("zero",)
    turn, mount, both = ("zero-turn", "zero"), ("mounting", "tilt"), ("both-signs", "zero-turn", "zero")
    of_j = [(k,) for k in range(8)]
    single = partial(Case, single=True)
    return (
        Case("clean"),
        Case("noise of 200 ms", log=(partial(_other_noise, memory=0.2),)),
        Case("quantised to 1e-3 rad", notes=("quantised",), log=(quantised,)),
        Case("5 % of rows missing", log=(partial(rows_missing, share=0.05),)),
        Case("30 % of rows missing", log=(partial(rows_missing, share=0.3),)),
        Case("stamps off by 1 ms", log=(stamps_shaken,)),
        Case("25 Hz resampled", log=(resampled,)),
        *(
            single(f"late {ms} ms", ("late",), log=(partial(late, seconds=ms / 1e3),), value={"late": float(ms)})
            for ms in (4, 12, 40, 200)
        ),
        single(
            "late 40 ms, joint 2",
            ("late-joint",),
            log=(partial(late, seconds=0.04, joints=(1,)),),
            value={"late-joint": 40.0},
            joints=(1,),
        ),
        *(
            Case(f"low-pass {f} Hz", ("low-pass",), log=(partial(low_passed, hertz=f),), value={"low-pass": float(f)})
            for f in (3, 1)
        ),
        single("Stribeck", ("stribeck",), (partial(laws, static=0.5),)),
        single("load friction 10 %", ("load-friction",), (partial(laws, load=0.1),), value={"load-friction": 10.0}),
        single("warming 40 %", ("warming",), (partial(laws, warming=-0.4),)),
        single("elastic 0.5 deg", ("elasticity",), log=(partial(elastic, degrees=0.5),), value={"elasticity": 0.5}),
        Case("asymmetric Coulomb 40 %", ("asymmetry",), (partial(laws, asymmetry=0.4),), told=False),
        *(single(f"tilt {d} deg", tilt, (partial(tilted, degrees=d),), value={"tilt": float(d)}) for d in (3, 10, 30)),
        single("on a wall", mount, (partial(mounted, degrees=90),)),
        single("on a ceiling", mount, (partial(mounted, degrees=180),)),
        single("gravity not in the torques", ("mounting",), log=(without_gravity,)),
        *(
            single(
                f"sign of torque {k + 1}",
                ("torque-sign",),
                log=(partial(scaled, times=-1.0, joints=(k,)),),
                joints=(k,),
            )
            for k in (1, 3)
        ),
        Case("sign of all torques", ("torque-sign",), log=(partial(scaled, times=-1.0),)),
        *(
            single(
                f"sign of position {k + 1}",
                ("position-sign",),
                log=(partial(positions_scaled, times=-1.0, joints=(k,)),),
                joints=(k,),
            )
            for k in (1, 3)
        ),
        *(
            single(
                f"both signs of {k + 1}",
                both,
                joints=(k,),
                log=(partial(scaled, times=-1.0, joints=(k,)), partial(positions_scaled, times=-1.0, joints=(k,))),
            )
            for k in (1, 2, 4)
        ),
        Case("all torques / 100", gain, log=(partial(scaled, times=0.01),), value={"gain": 0.01}),
        Case("all torques in N mm", gain, log=(partial(scaled, times=1000.0),), value={"gain": 1000.0}),
        single(
            "torque 3 / 50", gain, log=(partial(scaled, times=0.02, joints=(2,)),), value={"gain": 0.02}, joints=(2,)
        ),
        single("gain 1.5 on 3", gain, log=(partial(scaled, times=1.5, joints=(2,)),), value={"gain": 1.5}, joints=(2,)),
        *(
            Case(f"gain {g} on all", gain, log=(partial(scaled, times=g),), value={"gain": g}, told=False)
            for g in (1.2, 2.0)
        ),
        *(
            single(
                f"{what} {a + 1} and {b + 1} exchanged",
                (f"exchanged-{what}",),
                joints=(a, b),
                log=(partial(exchanged, column=column, joints=(a, b)),),
            )
            for what, column in (("torques", "tau"), ("positions", "q"))
            for a, b in ((1, 2), (3, 5))
        ),
        Case("all in degrees", ("degrees",), log=(partial(positions_scaled, times=180 / np.pi),)),
        single(
            "joint 3 in degrees",
            ("degrees",),
            log=(partial(positions_scaled, times=180 / np.pi, joints=(2,)),),
            joints=(2,),
        ),
        single(
            "zero of 2 off 5 deg",
            zero,
            log=(partial(zero_off, degrees=5.0, joint=1),),
            value={"zero": 5.0},
            joints=(1,),
        ),
        single(
            "zero of 2 off 90 deg",
            turn,
            log=(partial(zero_off, degrees=90.0, joint=1),),
            value={"zero-turn": 90.0},
            joints=of_j[1],
        ),
        Case("zero of the last off 90 deg", turn, log=(partial(zero_off, degrees=90.0, joint=-1),), told=False),
        Case("pause of 2 s", notes=("pause",), log=(partial(paused, seconds=2.0),)),
        Case(
            "pause of 2 s closed up", ("pause",), log=(partial(paused, seconds=2.0, closed=True),), value={"pause": 9.0}
        ),
        Case(
            "buffered 100 ms half the time",
            ("buffered",),
            log=(partial(buffered, seconds=0.1),),
            value={"buffered": 100.0},
        ),
        Case("payload 2 kg", notes=("payload",), world=(loaded,), value={"payload": TIP_LOAD}),
        Case("other masses, times 3", notes=("payload",), world=(other_masses,)),
        Case("saturated at 60 %", ("saturated",), log=(saturated,)),
        Case("push of 30 N for 2 s", ("push",), log=(pushed,), value={"push": (8.0, 10.0)}),
        Case("time times 2", ("time-scale",), log=(partial(clocked, times=2.0),), value={"time-scale": 2.0}),
        Case("time times 0.5", ("time-scale",), log=(partial(clocked, times=0.5),), value={"time-scale": 0.5}),
        Case("time times 1.1", ("time-scale",), log=(partial(clocked, times=1.1),), told=False),
        Case("swaying base", ("swaying",), log=(swaying,), value={"swaying": 0.83}),
        Case("spikes in 0.5 % of the rows", ("spikes",), log=(spiked,)),
        Case("one row off by 0.05 rad", notes=("spikes",), log=(one_row_off,)),
        Case("25 Hz held", ("repeated",), log=(held,), value={"repeated": 25.0}),
        Case("friction compensated", ("friction-compensated",), log=(friction_compensated,)),
        Case(
            "tilt 10 deg and gain 1.5 on 3",
            ("tilt", "gain"),
            (partial(tilted, degrees=10),),
            (partial(scaled, times=1.5, joints=(2,)),),
            {"tilt": 10.0, "gain": 1.5},
            (2,),
        ),
        Case(
            "late 40 ms and zero of 2 off 5 deg",
            ("late", "zero"),
            (),
            (partial(late, seconds=0.04), partial(zero_off, degrees=5.0, joint=1)),
            {"late": 40.0, "zero": 5.0},
            (1,),
        ),
        Case(
            "load friction 10 % and payload 2 kg",
            ("load-friction",),
            (loaded, partial(laws, load=0.1)),
            (),
            {"load-friction": 10.0},
            notes=("payload",),
        ),
        Case("a joint that follows", variant="mimic"),
        Case(
            "a joint that follows, gain 1.5 on 3",
            gain,
            log=(partial(scaled, times=1.5, joints=(2,)),),
            value={"gain": 1.5},
            joints=(2,),
            variant="mimic",
        ),
        Case("a joint that slides", variant="prismatic"),
        Case(
            "a joint that slides, tilt 10 deg",
            tilt,
            (partial(tilted, degrees=10),),
            value={"tilt": 10.0},
            variant="prismatic",
        ),
    )


def _other_noise(log: Recording, *, memory: float) -> None:
    noise = np.std(log.noise, axis=0) * coloured(len(log.t), log.tau.shape[1], log.rng, memory)
    log.tau, log.noise = log.tau - log.noise + noise, noise


FAULTS: Mapping[str, Case] = {case.name: case for case in _cases()}
MORE: Mapping[str, Case] = {
    case.name: case
    for case in (
        Case("drift of torque 2", ("drift",), log=(drifting,), joints=(1,)),
        Case("torque 3 dead", ("dead-torque",), log=(partial(dead, column="tau", joint=2),), joints=(2,)),
        Case("position 6 dead", ("dead-position",), log=(partial(dead, column="q", joint=5),), joints=(5,)),
        Case(
            "gain 1.5 on 3 half way",
            ("gain-change",),
            log=(partial(scaled_half_way, times=1.5, joint=2),),
            value={"gain-change": 1.5},
            joints=(2,),
        ),
        Case(
            "payload 2 kg half way",
            ("load-change",),
            log=(partial(loaded_after, part=0.5, mass=TIP_LOAD),),
            value={"load-change": TIP_LOAD},
        ),
        Case(
            "clock 60 ms off half way",
            ("late-change",),
            log=(partial(shifted_half_way, seconds=0.06),),
            value={"late-change": -60.0},
            notes=("pause",),
        ),
        Case("torque 2 drops out", ("dropout",), log=(partial(dropped_out, joint=1),), joints=(1,)),
        Case("no gravity in torque 2", ("no-gravity",), log=(partial(without_gravity_of, joint=1),), joints=(1,)),
        Case("at rest", ("dead-position",), log=(standing,)),
        Case(
            "constants fall 15 %",
            ("gain-drift",),
            log=(partial(gain_drifting, share=0.15),),
            value={"gain-drift": -15.0},
        ),
        Case(
            "constant of 2 falls 25 %",
            ("gain-drift",),
            log=(partial(gain_drifting, share=0.25, joints=(1,)),),
            joints=(1,),
        ),
        Case("spring at 3", ("spring",), log=(partial(sprung, joint=2),), joints=(2,)),
        Case("a hose pulls 20 N", ("force",), log=(pulled,), value={"force": 20.0}),
        Case("offset of 2 steps", ("offset-step",), log=(partial(offset_half_way, joint=1),), joints=(1,)),
        Case("torque 2 copied to 3", ("copied",), log=(partial(copied, joint=2),), joints=(1, 2)),
        Case("encoder of 3 counts 2", ("coupled",), log=(partial(coupled_encoder, joint=2),), joints=(2, 1)),
        Case("torque 2 without sign", ("unsigned",), log=(partial(unsigned, joint=1),), joints=(1,)),
        Case(
            "zeros of 2 and 3 off 5 and -4 deg",
            ("zero",),
            log=(partial(zero_off, degrees=5.0, joint=1), partial(zero_off, degrees=-4.0, joint=2)),
            value={"zero": 5.0},
        ),
    )
}
"""Beyond the 70."""
