"""Clean logs of robots that could trip a rule about motions that no robot makes: how often a rule speaks.

    python -m bench.clean_motions [--half tuned|kept] [--robots NAME ...] [--every]

Rules were tuned on the robots of the half "tuned" only; "kept" was looked at afterwards. Each robot moves in several styles,
sampled and written in several ways, within its limits by construction, and the report of ``torques`` is looked at for doubts of
``motion/plausibility.py``. ``--every`` prints all first lines.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import twistwrench as tw
from twistwrench.core.typing import Array
from twistwrench.motion.coordinates import Coordinates
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import LoadCase
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.torque_analysis import analyse
from twistwrench.reports.torque_report import TorqueReport

KINDS = (
    "impossible-speed", "impossible-torque", "lone-step", "doubtful-rows", "angle-zero", "degrees-inside", "length-unit",
)  # fmt: skip
"""Doubts that are looked for."""
SHARED = Path(__file__).resolve().parents[2] / "shared" / "robots"


# ── Robots

_LINK = """<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{m}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
_JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>
<axis xyz="{axis}"/>{limit}</joint>"""


def _limit(lower: float, upper: float, velocity: float, effort: float) -> str:
    return f'<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="{effort}"/>'


def _body(name: str, m: float, length: float) -> str:
    return _LINK.format(name=name, com=f"0 0 {length / 2}", m=m, i=m * length**2 / 12 + 1e-9)


def chain(
    name: str,
    lengths: Sequence[float],
    masses: Sequence[float],
    limits: Sequence[str],
    axes: str = "zyyxyx",
    kinds: Sequence[str] = (),
) -> str:
    """URDF of an open chain whose links lie along z."""  # fmt: skip
    parts, parent, at = ['<link name="base"/>'], "base", "0 0 0"
    vectors = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    for k, (length, mass, limit) in enumerate(zip(lengths, masses, limits, strict=True)):
        kind = kinds[k] if kinds else "revolute"
        parts.append(_body(f"link{k}", mass, length))
        axis = vectors[axes[k % len(axes)]]
        parts.append(
            _JOINT.format(name=f"j{k}", kind=kind, parent=parent, child=f"link{k}", at=at, axis=axis, limit=limit)
        )
        parent, at = f"link{k}", f"0 0 {length}"
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def star(name: str, arms: int, length: float, mass: float, limit: str, joints: int = 1) -> str:
    """URDF of equal arms around a base, as of a delta or a hand."""
    parts = ['<link name="base"/>']
    for k in range(arms):
        parent, at = "base", f"{0.1 * np.cos(k):.4f} {0.1 * np.sin(k):.4f} 0"
        for i in range(joints):
            parts.append(_body(f"a{k}{i}", mass, length))
            parts.append(
                _JOINT.format(
                    name=f"j{k}{i}", kind="revolute", parent=parent, child=f"a{k}{i}", at=at, axis="0 1 0", limit=limit
                )
            )
            parent, at = f"a{k}{i}", f"0 0 {length}"
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def _drone() -> str:
    parts = [_body("body", 0.8, 0.1)]
    for k in range(4):
        parts.append(_body(f"rotor{k}", 0.01, 0.02))
        parts.append(
            _JOINT.format(
                name=f"spin{k}", kind="continuous", parent="body", child=f"rotor{k}",
                at=f"{0.2 * np.cos(1.57 * k):.3f} {0.2 * np.sin(1.57 * k):.3f} 0", axis="0 0 1", limit="",
            )
        )  # fmt: skip
    return f'<robot name="drone">{"".join(parts)}</robot>'


TEXTS: Mapping[str, str] = {
    "small_fast": chain("small_fast", [0.1, 0.12, 0.1], [0.3, 0.2, 0.1], [_limit(-2, 2, 25, 6)] * 3),
    "delta_arms": star("delta_arms", 3, 0.2, 0.15, _limit(-1.2, 1.5, 18, 12)),
    "hobby_ten": chain("hobby_ten", [0.06, 0.1, 0.1, 0.05, 0.04], [0.08] * 5, [_limit(-1.8, 1.8, 10, 10)] * 5),
    "hobby_one": chain("hobby_one", [0.06, 0.1, 0.1, 0.05, 0.04], [0.08] * 5, [_limit(-3.14, 3.14, 1, 1)] * 5),
    "hobby_weak": chain("hobby_weak", [0.2, 0.3, 0.3, 0.1], [1.0] * 4, [_limit(-3.14, 3.14, 0.5, 0.1)] * 4),
    "hand": star("hand", 4, 0.04, 0.02, _limit(0, 1.6, 6, 1), 3),
    "gantry": chain(
        "gantry", [0.2, 0.2, 0.3], [40.0, 20.0, 8.0],
        [_limit(0, 3, 2, 3000), _limit(0, 2, 2, 2000), _limit(0, 1, 1.5, 600)], "xyz", ["prismatic"] * 3,
    ),
    "no_limits": chain("no_limits", [0.3, 0.3, 0.2], [2.0, 1.5, 1.0], [""] * 3, kinds=["continuous"] * 3),
    "no_effort": chain("no_effort", [0.3, 0.3], [2.0, 1.0], [_limit(-3, 3, 0, 0)] * 2),
    "scara": chain(
        "scara", [0.3, 0.3, 0.2, 0.1], [5.0, 3.0, 1.0, 0.3],
        [_limit(-2.5, 2.5, 8, 90), _limit(-2.6, 2.6, 12, 40), _limit(-0.2, 0.0, 1.1, 200), _limit(-6.3, 6.3, 35, 5)],
        "zzzz", ["revolute", "revolute", "prismatic", "revolute"],
    ),
    "slow_heavy": chain(
        "slow_heavy", [0.8, 1.2, 1.2, 0.3, 0.2, 0.2], [300.0, 250.0, 180.0, 60.0, 40.0, 20.0],
        [_limit(-3.1, 3.1, 1.8, 9e3), _limit(-1.0, 1.4, 1.7, 16e3), _limit(-2, 1.2, 1.7, 11e3)]
        + [_limit(-6, 6, 3.0, 2.5e3)] * 3,
    ),
    "gripper_arm": chain(
        "gripper_arm", [0.2, 0.3, 0.3, 0.1], [3.0, 2.0, 1.0, 0.05],
        [_limit(-3, 3, 3, 90), _limit(-2, 2, 3, 90), _limit(-2, 2, 3, 50), _limit(0, 0.04, 0.2, 20)],
        "zyyx", ["revolute"] * 3 + ["prismatic"],
    ),
    "pan_tilt": chain("pan_tilt", [0.05, 0.05], [0.2, 0.1], [_limit(-1.5, 1.5, 6.28, 0.5), _limit(-0.7, 0.9, 6.28, 0.5)], "zy"),
    "geared": chain("geared", [0.3, 0.4, 0.3], [4.0, 3.0, 2.0], [_limit(-3, 3, 4, 150)] * 2 + [_limit(-3, 3, 6, 60)]),
    "pendulum": chain("pendulum", [0.5], [1.0], [_limit(-3.2, 3.2, 12, 8)], "y"),
    "cart_pole": chain(
        "cart_pole", [0.1, 0.5], [1.0, 0.1], [_limit(-2, 2, 10, 100), _limit(-100, 100, 100, 1)], "xy",
        ["prismatic", "revolute"],
    ),
}  # fmt: skip
FILES = (
    "ufactory_xarm6", "leap_hand_right", "kuka_iiwa7_allegro", "rethink_sawyer", "trossen_wx250s", "staubli_tx40",
    "kinova_gen3_lite", "barrett_hand", "quanser_qarm", "abb_yumi", "shadow_hand_left", "unitree_dex5_left",
    "icub_genova02", "robotiq_3f", "dual_ur10e", "minitaur",
)  # fmt: skip
BUNDLED = ("ur5", "panda", "planar_2r", "planar_3r")
TUNED = {*list(TEXTS)[::2], *FILES[::2], *BUNDLED[::2]}
"""Robots on which rules were tuned; the others were kept."""


@cache
def robot_of(name: str) -> tw.Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if name in BUNDLED:
            return tw.load(tw.robots.path_of(name))
        if name in FILES:
            return tw.load(SHARED / f"{name}.urdf", inertia="repair")
        return tw.load(TEXTS[name])


# ── Motions, as functions of time; q within the stops, scaled to a share of the limits afterwards


def _profile(style: str, t: Array, k: int, random: np.random.Generator) -> Array:
    """Curve between -1 and 1 of joint k."""
    T = t[-1]
    phase = random.uniform(0, 2 * np.pi)
    if style == "series":
        w = 2 * np.pi * random.integers(1, 4, 3) / T * 1.7
        x = sum(
            a * np.sin(f * t + p)
            for a, f, p in zip((0.5, 0.3, 0.2), w * (1, 2, 3), random.uniform(0, 6, 3), strict=True)
        )
        return np.asarray(x)
    if style == "cycle":  # there and back, with dwells, minimum jerk
        u = np.clip(np.abs(((t / T * 6 + 0.13 * k) % 2) - 1) * 1.6 - 0.3, 0, 1)
        return np.asarray(2 * (10 * u**3 - 15 * u**4 + 6 * u**5) - 1) * np.cos(phase)
    if style == "trapezoid":  # constant speeds between corners that take a few rows
        u = np.clip(np.abs(((t / T * 4 + 0.21 * k) % 2) - 1) * 1.4 - 0.2, 0, 1)
        width = max(3, len(t) // 150)
        return (
            np.asarray(
                np.convolve(
                    np.pad(u, width, "edge"), np.hanning(2 * width + 1) / np.hanning(2 * width + 1).sum(), "valid"
                )
            )
            * 2
            - 1
        )
    if style == "bang":  # constant acceleration, then the opposite
        u = (t / T * 5 + 0.17 * k) % 2
        return np.asarray(np.where(u < 1, 4 * u * (1 - u), -4 * (u - 1) * (2 - u)))
    if style == "short":  # still but for one move in the middle, of 8 % of the time
        u = np.clip((t / T - 0.5) / 0.08 + 0.5, 0, 1) if k % 2 == 0 else np.zeros_like(t)
        return np.asarray(10 * u**3 - 15 * u**4 + 6 * u**5 - 0.5)
    if style == "impact":  # swings, bounces off a wall: the speed changes its sign at once
        x = np.sin(2 * np.pi * 2 * t / T * 1.3 + phase)
        return np.asarray(np.where(x > 0.6, 1.2 - x, x))
    raise ValueError(style)


def motion_of(
    robot: tw.Robot, style: str, rate: float, T: float, seed: int, share: float = 0.85
) -> tuple[Array, Array]:
    """Times and positions within stops, slowed down until speeds and torques are at most ``share`` of credible limits."""
    c, limits = Coordinates.from_model(robot.model), robot.limits
    at = c.position_of
    single = np.flatnonzero(at >= 0)
    for _ in range(40):
        t = np.arange(0.0, T, 1.0 / rate)
        q = np.tile(robot.neutral, (len(t), 1))
        inner = np.random.default_rng(seed)
        for k in single.tolist():
            lower, upper = float(limits.lower[k]), float(limits.upper[k])
            turns = c.angular_velocity[k]
            span = 1.0 if turns else 0.3
            lower, upper = max(lower, -span * 1.2), min(upper, span * 1.2)
            if not lower < upper:
                lower, upper = float(limits.lower[k]), float(limits.upper[k])
                lower, upper = (lower, lower + span) if np.isfinite(lower) else (upper - span, upper)
            middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
            q[:, at[k]] = middle + 0.9 * half * _profile(style, t, k, inner)
        motion = tw.Motion(t, q, robot=robot, in_seconds=True)
        speed = np.abs(np.diff(q[:, at[single]], axis=0)).max(axis=0) * rate
        use = [0.01]
        most = limits.velocity[single]
        real = np.isfinite(most) & (most > 0)
        if real.any() and robot.name not in ("hobby_one", "hobby_weak"):
            use.append(float((speed[real] / most[real]).max()))
        if style != "impact":
            torque = np.abs(motion.torques()[8:-8]).max(axis=0)
            weight = np.abs(robot.holding_torques(q)).max(axis=0)
            left = share * limits.effort - weight
            strong = np.isfinite(left) & (limits.effort > 0) & (left > 0)
            faster = np.where(strong, (torque - weight) / np.where(strong, left, 1.0), 0.0)
            use.append(float(np.sqrt(max(faster.max(initial=0.0), 0.0))) * share)
        if max(use) <= share * 1.001:
            break
        T *= min(max(use) / share, 3.0) * 1.05
    return t, q


# ── How it is sampled and written


@dataclass(frozen=True)
class Writing:
    """Rate of the rows, and what becomes of the exact positions."""

    name: str
    rate: float
    distort: Callable[[Array, Array, np.random.Generator], tuple[Array, Array]]
    measured: bool = False


def _exact(t: Array, q: Array, _r: np.random.Generator) -> tuple[Array, Array]:
    return t, q


def _noisy(sigma: float) -> Callable[[Array, Array, np.random.Generator], tuple[Array, Array]]:
    return lambda t, q, r: (t, q + sigma * r.standard_normal(q.shape))


def _encoder(counts: int) -> Callable[[Array, Array, np.random.Generator], tuple[Array, Array]]:
    step = 2 * np.pi / counts
    return lambda t, q, _r: (t, np.round(q / step) * step)


def _jitter(share: float) -> Callable[[Array, Array, np.random.Generator], tuple[Array, Array]]:
    def jittered(t: Array, q: Array, r: np.random.Generator) -> tuple[Array, Array]:
        h = t[1] - t[0]
        stamps = t + share * h * r.uniform(-0.5, 0.5, len(t))
        return np.sort(stamps), q

    return jittered


def _dropped(t: Array, q: Array, r: np.random.Generator) -> tuple[Array, Array]:
    kept = r.random(len(t)) > 0.05
    kept[[0, -1]] = True
    return t[kept], q[kept]


WRITINGS = (
    Writing("exact 100 Hz", 100.0, _exact),
    Writing("exact 1 kHz", 1000.0, _exact),
    Writing("30 Hz", 30.0, _exact),
    Writing("10 Hz", 10.0, _exact),
    Writing("noise 1e-4, 250 Hz", 250.0, _noisy(1e-4)),
    Writing("noise 1e-3, 100 Hz", 100.0, _noisy(1e-3)),
    Writing("encoder 4096, 100 Hz", 100.0, _encoder(4096)),
    Writing("encoder 1e5, 500 Hz, torques", 500.0, _encoder(100_000), measured=True),
    Writing("jitter 60 %, 100 Hz", 100.0, _jitter(0.6)),
    Writing("5 % of the rows missing, 100 Hz", 100.0, _dropped),
)
STYLES = ("series", "cycle", "trapezoid", "bang", "short", "impact")


def written(robot: tw.Robot, style: str, how: Writing, seed: int, path: Path, T: float = 8.0) -> Path:
    """CSV file of one clean log."""
    t, q = motion_of(robot, style, how.rate, T, seed)
    names, random = list(robot.coordinate_names), np.random.default_rng(seed + 7)
    columns = [t, q]
    if how.measured:
        tau = tw.Motion(t, q, robot=robot, in_seconds=True).torques()
        columns.append(tau * (1 + 0.01 * random.standard_normal(tau.shape)))
        names += [f"{n}.tau" for n in Coordinates.from_model(robot.model).velocity_names]
    columns[0], columns[1] = how.distort(t, q, random)
    if how.measured and len(columns[0]) != len(t):
        raise AssertionError("torques of rows that are gone")
    np.savetxt(path, np.column_stack(columns), "%.12g", ",", header=",".join(["time", *names]), comments="")
    return path


def reported(robot: tw.Robot, path: Path, **reading: bool) -> TorqueReport:
    """Report of ``torques``."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        log = MotionLog.open(path, robot.model, **reading)
        return analyse(LoadCase(robot), Differentiation.plan(log, robot.model), robot.limits)


def alarms(report: TorqueReport) -> list[str]:
    """Doubts of the module of plausibility that the verdict has."""
    said = [found.kind for found in report.doubts if found.kind in KINDS and found.level != "note"]
    rows = [reason for reason in report.verdict.reasons if reason.startswith("rows are missing, repeated or wrong")]
    return said + ["doubtful-rows"] * len(rows)


def cases(half: str | None, robots: Sequence[str]) -> Iterator[tuple[str, str, Writing, int]]:
    """Robot, style, writing and seed of every log."""
    every = [*TEXTS, *BUNDLED, *(FILES if SHARED.is_dir() else ())]
    for i, name in enumerate(every):
        if (robots and name not in robots) or (half and (name in TUNED) != (half == "tuned")):
            continue
        for k, how in enumerate(WRITINGS):
            for j in range(2):
                style = STYLES[(i + k + 3 * j) % len(STYLES)]
                yield name, style, how, 100 * i + 10 * k + j


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--half", choices=("tuned", "kept"))
    parser.add_argument("--robots", nargs="+", default=[])
    parser.add_argument("--every", action="store_true")
    asked = parser.parse_args()
    total, said = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for name, style, how, seed in cases(asked.half, asked.robots):
            path = Path(folder, "log.csv")
            try:
                robot = robot_of(name)
                written(robot, style, how, seed, path)
                report = reported(robot, path)
            except tw.TwistWrenchError as problem:
                print(f"{name:20s} {style:10s} {how.name:32s} ERROR {problem}"[:180], flush=True)
                continue
            found = alarms(report)
            total, said = total + 1, said + bool(found)
            if found or asked.every:
                first = str(report.verdict)[:150]
                print(f"{name:20s} {style:10s} {how.name:32s} {','.join(found) or '-':20s} {first}", flush=True)
    print(f"{said} of {total} clean logs are doubted")


if __name__ == "__main__":
    main()
