"""A chain of a hundred links: how long its matrices compile without a cache, and what a state takes; Pinocchio's Python call.

``python -m bench.long_chain QUANTITY`` measures one in a process of its own and prints it; the section starts such processes.
"""

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from typing import Any

import numpy as np
import pinocchio as pin

import twistwrench as tw
from bench import machine
from bench.timing import ROUNDS, Contender, calls, interleave

LINKS, STATES = 100, 64
QUANTITIES = ("inverse_dynamics", "mass_matrix", "inverse_dynamics_derivatives")
INPUTS = {"mass_matrix": 1}


def times(rounds: int = ROUNDS) -> dict[str, Any]:
    """By quantity: seconds of the processor to compile, ns a state in a batch and alone, and those of Pinocchio."""
    where, rows = machine.describe(), {}
    for quantity in QUANTITIES:
        print(f"chain of {LINKS}: {quantity}", flush=True)
        command = [sys.executable, "-m", "bench.long_chain", quantity, str(rounds)]
        environment = {**os.environ, "TWISTWRENCH_CACHE_DIR": "off"}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
        rows[quantity] = json.loads(done.stdout)
    return {
        "date": where["date"],
        "cpu": where["cpu"],
        "rounds": rounds,
        "links": LINKS,
        "states": STATES,
        "rows": rows,
    }


def chain(links: int = LINKS) -> str:
    """URDF of links that are all a little different, their joints about x, y and z in turns."""
    parts = ['<link name="link0"/>']
    for k in range(1, links + 1):
        mass, axis = 0.5 + 0.01 * k, ("1 0 0", "0 1 0", "0 0 1")[k % 3]
        parts.append(
            f'<link name="link{k}"><inertial><origin xyz="0.0{k % 7 + 1} 0.01 0.1" rpy="0.1 0.2 0.{k % 9}"/>'
            f'<mass value="{mass:g}"/><inertia ixx="0.01" iyy="0.012" izz="0.009" ixy="0.001" ixz="0.0005" iyz="0.0002"/>'
            f'</inertial></link><joint name="joint{k}" type="revolute"><parent link="link{k - 1}"/><child link="link{k}"/>'
            f'<origin xyz="0.02 0.01 0.2" rpy="0.1 0.{k % 4} 0.2"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="chain">{"".join(parts)}</robot>'


def _measured(quantity: str, rounds: int) -> dict[str, Any]:
    text = chain()
    robot, model = tw.load(text), pin.buildModelFromXML(text)
    data, count = model.createData(), INPUTS.get(quantity, 3)
    arrays = np.random.default_rng(0).uniform(-1.0, 1.0, (3, STATES, LINKS))[:count]
    start = time.process_time()
    kernel = robot.kernel(quantity)
    seconds = time.process_time() - start
    out = kernel(*arrays)
    method, rows = getattr(robot, quantity), list(zip(*arrays, strict=True))
    theirs = {"inverse_dynamics": pin.rnea, "mass_matrix": pin.crba}.get(quantity, pin.computeRNEADerivatives)
    pin_rows = [(model, data, *row) for row in rows]

    def batch(times: int) -> None:
        for _ in range(times):
            kernel(*arrays, out=out)

    ways = [Contender("batch", batch, STATES), calls("one", method, rows), calls("Pinocchio", theirs, pin_rows)]
    timings = {name: asdict(timing) for name, timing in interleave(ways, rounds).items()}
    return {"compile": seconds, "timings": timings}


if __name__ == "__main__":
    print(json.dumps(_measured(sys.argv[1], int(sys.argv[2]))))
