"""Faulty logs of known robots: what the program says of them, whether it names the cause, and how wrong its torques are.

    python -m bench.faulty_logs --list
    python -m bench.faulty_logs --case "tilt 3 deg" --robot ur5 --write FILE.npz

writes one log with its truth; ``log("ur5", "tilt 3 deg", seed=0)`` gives it in Python.
"""

from __future__ import annotations

import argparse
import json
import warnings
from pathlib import Path

import numpy as np

import twistwrench as tw
from bench.faulty_logs_cases import FAULTS, MORE, Case, Recording
from bench.faulty_logs_truth import ARMS, MEMORY, NOISE, RATE, SECONDS, Series, Truth, coloured, generator, load

CASES = {**FAULTS, **MORE}


def recording(robot: str, case: Case, seed: int = 0, *, memory: float = MEMORY, noise: float = NOISE) -> Recording:
    """A log in the making: the truth, motion and noise are those of the robot and the seed, whatever the case."""
    file, rng = load(robot, case.variant), generator(robot, seed)
    truth, motion = Truth.random(file, rng), Series.random(file, rng)
    t = np.arange(round(SECONDS * RATE)) / RATE
    states = motion(t)
    truth = truth.with_drives(states)
    errors = coloured(len(t), file.nv, rng, memory) * noise * truth.torques(*states).std(axis=0)
    mine = generator(robot, seed, case.name)
    for change in case.world:
        truth = change(truth, states, mine)
    tau = truth.torques(*states, t) + errors
    log = Recording(truth, motion, mine, t, states[0].copy(), tau, errors)
    for fault in case.log:
        fault(log)
    return log


def motion_of(log: Recording) -> tw.Motion:
    """The log as a user has it: times, positions and torques of the file's robot."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.Motion(log.t, log.q, tau=log.tau, robot=log.truth.file)


def log(robot: str, case: str, seed: int = 0) -> tuple[tw.Robot, tw.Motion, Recording]:
    """The robot as in its file, a log of it, and what is true of it (``.truth``, ``.value``)."""
    made = recording(robot, CASES[case], seed)
    return made.truth.file, motion_of(made), made


def write(path: Path, robot: str, case: Case, seed: int) -> None:
    """Times, positions and torques of a log (.npz, or .csv without the truth), its robot, and what is expected."""
    made = recording(robot, case, seed)
    if path.suffix == ".csv":
        motion_of(made).to_csv(path)
        return
    expected = {"case": case.name, "causes": case.causes, "told": case.told, "value": {**case.value, **made.value}}
    truth = made.truth
    np.savez(
        path,
        time=made.t,
        q=made.q,
        tau=made.tau,
        robot=robot,
        expected=json.dumps(expected),
        parameters=truth.robot.parameters,
        parameter_names=truth.robot.parameter_names,
        gravity=truth.gravity,
        **truth.drives,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--list", action="store_true", help="names of the cases")
    parser.add_argument("--case", help="one case, to be written")
    parser.add_argument("--robot", default="ur5", choices=ARMS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", type=Path, metavar="FILE", help=".npz or .csv")
    given = parser.parse_args()
    if given.list:
        print("\n".join(CASES))
    elif given.write:
        write(given.write, given.robot, CASES[given.case], given.seed)
    else:
        parser.error("give --list, or --case and --write")


if __name__ == "__main__":
    main()
