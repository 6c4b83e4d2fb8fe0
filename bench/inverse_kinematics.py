"""Inverse kinematics of the panda: many poses at once, one far away, one near by; and `ik_LM` of the Robotics Toolbox, in C++.

The Toolbox wants an older NumPy, so it runs in a process of its own, by the Python that TWISTWRENCH_BENCH_RTB names.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import twistwrench as tw
from bench import machine
from bench.timing import ROUNDS, Contender, interleave

POSES, MANY, NEAR = 256, 4096, 0.05
VARIABLE = "TWISTWRENCH_BENCH_RTB"
WAYS = ("a batch of 4096", "one pose", "one pose from 0.05 rad away")

Sweep = Callable[[int], object]


def times(rounds: int = ROUNDS) -> dict[str, Any]:
    """Nanoseconds a pose by way, ours and theirs in turns, means over the same poses; and how many each reached."""
    where = machine.describe()
    robot = tw.robots.panda()
    rng = np.random.default_rng(1)
    q = robot.random_configuration(rng, MANY)
    T = robot.forward_kinematics(q)
    near = np.clip(q + rng.uniform(-NEAR, NEAR, q.shape), robot.limits.lower, robot.limits.upper)
    print("panda: inverse kinematics", flush=True)
    rows: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "poses.npz"
        np.savez(file, T=T[:POSES], near=near[:POSES], q=q[:POSES])
        peer, version = _peer(file)
        for way, ours in zip(WAYS, _ours(robot, T, near), strict=True):
            ours[0](2)
            pair = [Contender("ours", ours[0], ours[1])]
            far = "near" if way == WAYS[2] else "far"
            if peer is not None:
                pair.append(Contender("theirs", lambda n, far=far, peer=peer: _asked(peer, f"{far} {n}"), POSES))
            found = {name: asdict(timing) for name, timing in interleave(pair, rounds).items()}
            rows[way] = {**found, "reached": {"ours": ours[2]}}
            if peer is not None:
                rows[way]["reached"]["theirs"] = float(_asked(peer, f"{far} 1"))
        if peer is not None:
            peer.kill()
            peer.wait()
    return {"date": where["date"], "cpu": where["cpu"], "rounds": rounds, "rows": rows, "toolbox": version}


def _ours(robot: tw.Robot, T: np.ndarray, near: np.ndarray) -> list[tuple[Sweep, int, float]]:
    """For each way a sweep, how many poses it is, and the share of them that is reached."""
    poses, starts = list(T[:POSES].copy()), list(near[:POSES].copy())

    def many(count: int) -> None:
        for _ in range(count):
            robot.inverse_kinematics(T)

    def far(count: int) -> None:
        for _ in range(count):
            for pose in poses:
                robot.inverse_kinematics(pose)

    def nearby(count: int) -> None:
        for _ in range(count):
            for pose, start in zip(poses, starts, strict=True):
                robot.inverse_kinematics(pose, q0=start)

    reached = robot.inverse_kinematics(T).converged
    close = robot.inverse_kinematics(T[:POSES], q0=near[:POSES]).converged
    shares = (float(x.mean()) for x in (reached, reached[:POSES], close))
    return list(zip((many, far, nearby), (MANY, POSES, POSES), shares, strict=True))


def _peer(file: Path) -> tuple[subprocess.Popen[str] | None, str]:
    """The Toolbox's process, once it has the poses, and its version; None where there is none."""
    python = os.environ.get(VARIABLE, sys.executable)
    script = str(Path(__file__).with_name("peer_rtb.py"))
    try:
        peer = subprocess.Popen([python, script, str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    except OSError:
        return None, ""
    said = "" if peer.stdout is None else peer.stdout.readline()
    return (peer, said.split()[1]) if said.startswith("ready ") else (None, "")


def _asked(peer: subprocess.Popen[str], text: str) -> str:
    assert peer.stdin is not None
    assert peer.stdout is not None
    print(text, file=peer.stdin, flush=True)
    return peer.stdout.readline()
