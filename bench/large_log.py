"""A synthetic log of a seven-joint arm at 1 kHz in a binary file, and how long and with how much memory it is identified.

python -m bench.large_log write FOLDER --seconds 8640 --files 4
python -m bench.large_log read FOLDER [--cutoff 50] [--workers 2]
"""

from __future__ import annotations

import argparse
import json
import resource
import time
import zlib
from pathlib import Path

import numpy as np

import twistwrench as tw

RATE = 1000.0
_CHUNK = 50_000
NOISE = 0.02
"""Of each torque's size."""


def states(robot: tw.Robot, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a Fourier series of twenty seconds."""
    rng = np.random.default_rng(7)
    w = 2 * np.pi * np.arange(1, 6) / 20.0
    a, b = rng.normal(size=(2, robot.nv, 5)) / np.arange(1, 6) * 0.6
    sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    return sin @ a.T + cos @ b.T, (cos * w) @ a.T - (sin * w) @ b.T, -(sin * w**2) @ a.T - (cos * w**2) @ b.T


def drives(robot: tw.Robot) -> dict[str, np.ndarray]:
    """What is true of each joint besides its bodies."""
    q, dq, ddq = states(robot, np.arange(0, 20, 0.01))
    size = np.sqrt((np.asarray(robot.inverse_dynamics(q, dq, ddq)) ** 2).mean(axis=0)) + 0.5
    return {"size": size, "viscous": 0.1 * size, "coulomb": 0.1 * size, "inertia": 0.02 * size}


def write(folder: Path, seconds: float, files: int) -> None:
    """The log in files of equal length: records of numbers in npy."""
    robot = tw.robots.panda()
    names = ["time", *robot.coordinate_names, *(f"{n}.tau" for n in robot.joint_names)]
    dtype = np.dtype([(name, float) for name in names])
    true, rng = drives(robot), np.random.default_rng(0)
    folder.mkdir(parents=True, exist_ok=True)
    rows = round(seconds * RATE / files)
    for k in range(files):
        with (folder / f"log{k:03d}.npy").open("wb") as file:
            np.lib.format.write_array_header_2_0(
                file, {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": (rows,)}
            )
            for first in range(0, rows, _CHUNK):
                number = k * rows + np.arange(first, min(rows, first + _CHUNK))
                t = number / RATE
                q, dq, ddq = states(robot, t)
                tau = np.asarray(robot.inverse_dynamics(q, dq, ddq)) + true["viscous"] * dq + true["inertia"] * ddq
                tau += true["coulomb"] * np.tanh(dq / 0.05) + NOISE * true["size"] * rng.normal(size=tau.shape)
                file.write(np.ascontiguousarray(np.column_stack([t, q, tau])).tobytes())


def read(folder: Path, cutoff: float | None, workers: int | None) -> dict[str, object]:
    """Identify; s of processor and of the clock, and the most memory that this process had [MB]."""
    from twistwrench.core.third_party.workers import workers_of

    robot = tw.robots.panda()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    wall, begun = time.perf_counter(), time.process_time()
    with workers_of(workers) as team:
        logs = sorted(folder.glob("*.npy"))
        found = tw.identification.identify(robot, logs, cutoff=cutoff, client=team.client)
    return {
        "notes": list(found.notes),
        "cutoff": found.settings.cutoff,
        "processor": round(time.process_time() - begun, 1),
        "clock": round(time.perf_counter() - wall, 1),
        "workers": workers,
        "memory before": round(before),
        "memory": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "held out": found.held_out.all,
        "verdict": str(found.verdict.word),
        "doubts": [str(d) for d in found.doubts],
        "crc32 of the values": zlib.crc32(found.values.tobytes()),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", choices=["write", "read"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=8640.0)
    parser.add_argument("--files", type=int, default=1)
    parser.add_argument("--cutoff", type=float)
    parser.add_argument("--workers", type=int)
    given = parser.parse_args()
    if given.action == "write":
        write(given.folder, given.seconds, given.files)
    else:
        print(json.dumps(read(given.folder, given.cutoff, given.workers), indent=2))
