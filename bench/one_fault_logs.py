"""Clean logs of the one-fault benchmark: motions in several styles at a wanted load, sensors, and files in several formats."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tests.faulty_logs.truth import Array, States, generator

from bench.one_fault_judge import Judge, Judgement, Limits, judge_of

RATES = (10.0, 25.0, 50.0, 100.0, 125.0, 250.0, 500.0, 1000.0)
LEVELS = (0.35, 0.6, 0.3, 0.8, 0.45, 1.5)
"""Largest shares of a limit that motions are made to reach."""
NOISES = (0.0, 0.0, 1e-6, 1e-5, 1e-4)
"""White noise of positions [rad or m]."""
MOST_ROWS, LEAST_ROWS = 1200, 120
_PHASES = 160
_SPEEDS = np.geomspace(0.04, 1.0, 40)
_PER_RATE = 0.04
"""Cycles a second, at most, for each row a second."""
TORQUE_NOISE, TORQUE_FLOOR = 0.01, 0.002
"""Noise of measured torques, as a share of their deviation, and at least of their limit, or of the robot's largest torque."""


# ── Motions


class Path_(NamedTuple):
    """Coordinates, and their first two derivatives by the phase, as a function of the phase (n,)."""

    of: Callable[[Array], States]
    end: float


def _centres(judge: Judge, rng: np.random.Generator) -> tuple[Array, Array]:
    """Centres and half widths of a motion within the stops."""
    lower = np.where(np.isfinite(judge.limits.lower), judge.limits.lower, np.where(judge.turns, -np.pi, -0.5))
    upper = np.where(np.isfinite(judge.limits.upper), judge.limits.upper, np.where(judge.turns, np.pi, 0.5))
    room = np.minimum(0.42 * (upper - lower), 1.3)
    off = rng.uniform(-1, 1, len(lower)) * np.minimum((upper - lower) / 2 - room, 0.8)
    base = judge.base
    centre = np.concatenate([np.zeros(base), (lower + upper) / 2 + off])
    return centre, np.concatenate([[0.8, 0.8, 0.4, 0.15, 0.15, 0.4][:base], room])


def sines(judge: Judge, rng: np.random.Generator, harmonics: Sequence[float] = (0.3, 0.6, 1.0)) -> Path_:
    """Sums of sines, one cycle a phase at most."""
    centre, room = _centres(judge, rng)
    w = 2 * np.pi * np.asarray(harmonics)
    sizes = rng.dirichlet(np.ones(len(w)), len(centre)).T * room
    turned = rng.uniform(0, 2 * np.pi, sizes.shape)

    def of(s: Array) -> States:
        angle = s[:, None, None] * w[:, None] + turned
        first, second = w[:, None] * sizes, w[:, None] ** 2 * sizes
        q = centre + (sizes * np.sin(angle)).sum(axis=1)
        return q, (first * np.cos(angle)).sum(axis=1), -(second * np.sin(angle)).sum(axis=1)

    return Path_(of, 6.0)


def _stops(configurations: Array, moving: float, resting: float) -> Path_:
    """Quintic moves between configurations (n, k), with standstill between them."""
    each, last = moving + resting, len(configurations) - 2

    def of(s: Array) -> States:
        k = np.clip((s // each).astype(int), 0, last)
        u = np.clip((s - k * each) / moving, 0.0, 1.0)[:, None]
        away = configurations[k + 1] - configurations[k]
        q = configurations[k] + away * (10 * u**3 - 15 * u**4 + 6 * u**5)
        rate = away / moving * (30 * u**2 - 60 * u**3 + 30 * u**4)
        return q, rate, away / moving**2 * (60 * u - 180 * u**2 + 120 * u**3)

    return Path_(of, each * (last + 1))


def point_to_point(judge: Judge, rng: np.random.Generator) -> Path_:
    """Moves between random configurations."""
    centre, room = _centres(judge, rng)
    return _stops(centre + room * rng.uniform(-1, 1, (7, len(centre))), 1.0, 0.15)


def pick_and_place(judge: Judge, rng: np.random.Generator) -> Path_:
    """Two places in turn with a standstill at each."""
    centre, room = _centres(judge, rng)
    two = centre + room * rng.uniform(-1, 1, (2, len(centre)))
    return _stops(np.vstack([two] * 4), 1.0, 0.8)


def one_joint(judge: Judge, rng: np.random.Generator) -> Path_:
    """One joint after another; the others stand still."""
    centre, room = _centres(judge, rng)
    places = [centre]
    for k in rng.permutation(len(centre))[:6]:
        places.append(places[-1].copy())
        places[-1][k] += room[k] * rng.choice([-0.9, 0.9])
    return _stops(np.array(places), 1.0, 0.1)


def teleoperated(judge: Judge, rng: np.random.Generator) -> Path_:
    """Slow wandering with a tremor of the hand."""
    return sines(judge, rng, (0.07, 0.19, 0.31, 0.53, 1.0))


def impacts(judge: Judge, rng: np.random.Generator) -> Path_:
    """Slow sines with short knocks, as of a tool that touches down."""
    plain = sines(judge, rng, (0.2, 0.45))
    size = 1e-3 * _centres(judge, rng)[1]
    at, width = np.array([1.7, 3.1, 4.9]), 0.03

    def of(s: Array) -> States:
        q, dq, ddq = plain.of(s)
        u = (s[:, None] - at) / width
        bump = np.exp(-(u**2))
        parts = bump, -2 * u * bump / width, (4 * u**2 - 2) * bump / width**2
        told = [part.sum(axis=1)[:, None] * size for part in parts]
        return q + told[0], dq + told[1], ddq + told[2]

    return Path_(of, plain.end)


STYLES: dict[str, Callable[[Judge, np.random.Generator], Path_]] = {
    "sines": sines,
    "point to point": point_to_point,
    "pick and place": pick_and_place,
    "teleoperated": teleoperated,
    "one joint": one_joint,
    "impacts": impacts,
}


@dataclass(frozen=True, eq=False)
class Motion:
    """A path at a constant speed of its phase; times (n,) → coordinates and their rates."""

    path: Path_
    speed: float

    def __call__(self, t: Array) -> States:
        q, first, second = self.path.of(np.asarray(t) * self.speed)
        return q, self.speed * first, self.speed**2 * second

    @property
    def duration(self) -> float:
        """Seconds of the whole path."""
        return self.path.end / self.speed


def at_level(judge: Judge, path: Path_, level: float, fastest: float) -> Motion:
    """The fastest motion along a path whose load stays below a level, with the velocities that the robot can have."""
    s = np.linspace(0.0, path.end, _PHASES)
    velocity = np.where(np.isfinite(judge.limits.velocity), judge.limits.velocity, judge.mechanism.speed)
    if judge.mechanism.placeholder:
        velocity = np.full_like(velocity, judge.mechanism.speed)
    limits = judge.limits._replace(velocity=velocity)
    if judge.mechanism.placeholder:
        limits = limits._replace(effort=np.full_like(velocity, np.inf))
    chosen = Motion(path, fastest * _SPEEDS[0])
    for speed in fastest * _SPEEDS[1::2]:
        motion = Motion(path, speed)
        if replace(judge, limits=limits).of_motion(motion, s / speed).share > level:
            break
        chosen = motion
    return chosen


# ── Logs


@dataclass(eq=False)
class Recording:
    """A log as it is written; a fault changes it in place. Units of columns are as their headers state."""

    judge: Judge
    motion: Motion
    rng: np.random.Generator
    rate: float
    t: Array
    q: Array
    dq: Array | None = None
    tau: Array | None = None
    time_name: str = "time"
    units: list[str] = field(default_factory=list)
    """Unit in the header of each position column; empty for radians or metres."""
    limits: Limits | None = None
    """A table of limits that is given beside the log."""
    form: str = "csv"
    digits: str = "%.9g"
    value: dict[str, Any] = field(default_factory=dict)
    """What was drawn: joints, times and sizes."""

    @property
    def names(self) -> tuple[str, ...]:
        """Joints, in the order of the columns."""
        return self.judge.names

    def keep(self, rows: Array, *, closed_up: bool = False) -> None:
        """Keep some rows; their stamps too, or the first ones."""
        n = len(self.t)
        self.t = self.t[: len(self.t[rows])] if closed_up else self.t[rows]
        for name in ("q", "dq", "tau"):
            column = getattr(self, name)
            if column is not None and len(column) == n:
                setattr(self, name, column[rows])

    def positions(self, change: Callable[[Array], Array]) -> None:
        """Change the positions; written velocities are those of the motion."""
        self.q = change(self.q)

    def judged(self) -> Judgement:
        """Judgement of the log as it is written."""
        q = self.q.copy()
        scale = {"deg": np.pi / 180, "mm": 1e-3, "": 1.0}
        q[:, self.judge.base :] *= [scale[unit] for unit in self.units]
        t = self.t * (1e-3 if self.time_name.endswith("ms") else 1.0)
        return self.judge.of_log(t, q, self.limits, self.tau)


def recording(robot: str, seed: int, style: str, rate: float, level: float, *, measured: bool, form: str) -> Recording:
    """A clean log: quantised or noisy positions, rates where drawn, measured torques where wanted."""
    judge, rng = judge_of(robot), generator(robot, seed, style)
    fastest = min(judge.mechanism.fastest, _PER_RATE * rate)
    motion = at_level(judge, STYLES[style](judge, rng), level, fastest)
    rows = int(np.clip(motion.duration * rate, LEAST_ROWS, MOST_ROWS))
    t = np.arange(rows) / rate
    q, dq, ddq = motion(t)
    made = Recording(judge, motion, rng, rate, t, q, form=form, units=[""] * len(judge.names))
    noise = 2e-5 if style == "teleoperated" else float(rng.choice(NOISES))
    made.q = q + noise * rng.normal(size=q.shape)
    if rng.random() < 0.5:  # counts of an encoder
        step = np.where(judge.turns, 2 * np.pi / 2.0 ** rng.integers(14, 21), 1e-6)
        made.q[:, judge.base :] = np.round(made.q[:, judge.base :] / step) * step
    if not judge.base and rng.random() < 0.3:
        made.dq = dq + 10 * noise * rng.normal(size=q.shape)
    if measured:
        tau = judge.torques(q, dq, ddq)
        known = np.isfinite(judge.limits.effort) & (not judge.mechanism.placeholder)
        floor = TORQUE_FLOOR * np.where(known, judge.limits.effort, np.abs(tau).max())
        made.tau = tau + np.maximum(TORQUE_NOISE * tau.std(axis=0), floor) * rng.normal(size=tau.shape)
    made.digits = str(rng.choice(["%.9g", "%.6f", "%.17g"]))
    if rng.random() < 0.25:  # since 1970, or since the start of the computer
        made.t = made.t + float(rng.choice([1_700_000_000.0, 5123.25]))
    made.value = {"noise": noise, "speed": round(motion.speed, 4)}
    return made


# ── Files


def columns(log: Recording) -> dict[str, Array]:
    """Columns of the file by their headers."""
    found: dict[str, Array] = {log.time_name: log.t}
    if log.judge.base:
        poses = np.array([log.judge.configuration(x)[:7] for x in log.q])
        kinds = ("qw", "qx", "qy", "qz", "x", "y", "z")
        for kind, column in zip(kinds, poses[:, [6, 3, 4, 5, 0, 1, 2]].T, strict=True):
            found[f"root_joint.{kind}"] = column
    for k, (name, unit) in enumerate(zip(log.names, log.units, strict=True)):
        found[f"{name} [{unit}]" if unit else name] = log.q[:, log.judge.base + k]
    for kind, values in (("vel", log.dq), ("tau", log.tau)):
        if values is not None:
            found |= {f"{name}.{kind}": values[:, k] for k, name in enumerate(log.names)}
    return found


def _text(log: Recording, separator: str, *, comma: bool = False) -> str:
    table = columns(log)
    digits = [log.digits] * len(table)
    digits[0] = "%.17g" if abs(log.t[0]) > 1e6 else "%.9g"
    lines = [separator.join(table)]
    lines += [
        separator.join(d % x for d, x in zip(digits, row, strict=True)) for row in zip(*table.values(), strict=True)
    ]
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma and not any("." in name for name in table) else text


def _csv(log: Recording, path: Path) -> Path:
    path = path.with_suffix(".csv")
    path.write_text(_text(log, ","), "utf-8")
    return path


def _semicolons(log: Recording, path: Path) -> Path:
    path = path.with_suffix(".csv")
    path.write_text(_text(log, ";", comma=True), "utf-8")
    return path


def _tabs(log: Recording, path: Path) -> Path:
    path = path.with_suffix(".txt")
    path.write_text(_text(log, "\t"), "utf-16")
    return path


def _gzip(log: Recording, path: Path) -> Path:
    path = path.with_suffix(".csv.gz")
    path.write_bytes(gzip.compress(_text(log, ",").encode()))
    return path


def _npz(log: Recording, path: Path) -> Path:
    path = path.with_suffix(".npz")
    np.savez(path, allow_pickle=False, **columns(log))
    return path


def _parquet(log: Recording, path: Path) -> Path:
    import pandas as pd

    path = path.with_suffix(".parquet")
    pd.DataFrame(columns(log)).to_parquet(path)
    return path


def _hdf5(log: Recording, path: Path) -> Path:
    import h5py

    path = path.with_suffix(".h5")
    with h5py.File(path, "w") as file:
        for name, values in columns(log).items():
            file[name] = values
    return path


def _bag(log: Recording, path: Path) -> Path:
    """A rosbag2 folder of joint states, stamped when they were taken."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    none = np.empty(0)
    dq = np.empty((len(log.t), 0)) if log.dq is None else log.dq
    tau = np.empty((len(log.t), 0)) if log.tau is None else log.tau
    with Writer(path, version=8) as writer:
        connection = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for k, now in enumerate(log.t):
            nano = max(0, round(now * 1e9))
            stamp = kinds["Time"](sec=nano // 10**9, nanosec=nano % 10**9)
            message = kinds["JointState"](
                header=kinds["Header"](stamp=stamp, frame_id=""),
                name=list(log.names),
                position=np.ascontiguousarray(log.q[k]),
                velocity=np.ascontiguousarray(dq[k]) if len(dq[k]) else none,
                effort=np.ascontiguousarray(tau[k]) if len(tau[k]) else none,
            )
            writer.write(connection, nano, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
    return path


FORMS: dict[str, Callable[[Recording, Path], Path]] = {
    "csv": _csv,
    "semicolons": _semicolons,
    "tabs": _tabs,
    "gzip": _gzip,
    "npz": _npz,
    "parquet": _parquet,
    "hdf5": _hdf5,
    "bag": _bag,
}


def write(log: Recording, folder: Path) -> list[str]:
    """Write a log, and its table of limits; arguments of the command."""
    arguments = ["--trajectory", str(FORMS[log.form](log, folder / "log"))]
    if log.limits is not None:
        table = folder / "limits.csv"
        rows = [",".join(("joint", *Limits._fields))]
        rows += [f"{name},{','.join(f'{x:.9g}' for x in row)}" for name, *row in _rows(log)]
        table.write_text("\n".join(rows) + "\n", "utf-8")
        arguments += ["--limits", str(table)]
    return arguments


def _rows(log: Recording) -> list[tuple[Any, ...]]:
    assert log.limits is not None
    return list(zip(log.names, *log.limits, strict=True))
