"""The one robot of the tables about other packages, its states, and whether two packages compute the same of it.

The panda of `example-robot-data` with its fingers fixed, in float64. Everything is in our order and signs.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

import twistwrench as tw
from bench.cases import CASES
from bench.timing import Contender, interleave

OURS, KERNEL = "twistwrench", "twistwrench, NumPy"
"""In the other package, and the same compiled kernel called with arrays."""
BATCH = 4096
STATES = 64
"""On which all must agree before anything is timed."""
TOLERANCE = 1e-6
QUANTITIES = ("inverse_dynamics", "mass_matrix", "forward_dynamics")
Functions = dict[str, Callable[..., Any]]
"""By quantity, a function of (q, dq, x), x the accelerations or torques."""


@dataclass(frozen=True)
class Panda:
    """The robot, and its file in a folder that is written to."""

    folder: Path

    @cached_property
    def path(self) -> Path:
        path = self.folder / "panda.urdf"
        root = ElementTree.fromstring(next(c for c in CASES if c.name == "panda").text)
        for dynamics in root.iter("dynamics"):  # attributes of its own, which ADAM's parser complains of, one by one
            for name in {*dynamics.attrib} - {"damping", "friction"}:
                del dynamics.attrib[name]
        path.write_bytes(ElementTree.tostring(root))
        return path

    @cached_property
    def robot(self) -> tw.Robot:
        return tw.load(self.path)

    def states(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Configurations within the limits, and velocities and accelerations or torques from N(0, 1)."""
        rng = np.random.default_rng(0)
        return self.robot.random_configuration(0, count), *rng.normal(size=(2, count, self.robot.nv))

    def _method(self, name: str) -> Callable[..., Any]:
        """A method as programs have it after their first calls: then its attribute calls the compiled code by itself."""
        given = [x[0] for x in self.states(1)][: 1 if name == "mass_matrix" else 3]
        for _ in range(3):
            getattr(self.robot, name)(*given)
        method: Callable[..., Any] = getattr(self.robot, name)
        return method

    @cached_property
    def kernels(self) -> Functions:
        """Our compiled functions of arrays; the gradient of |tau|^2 and the slope of tau are by q."""
        inverse, mass, forward = (self._method(name) for name in QUANTITIES)
        slope = self.robot.kernel("inverse_dynamics", by="q")
        weighted = self.robot.kernel("inverse_dynamics", by="q", form="weighted")
        return {
            "inverse_dynamics": inverse,
            "mass_matrix": lambda q, *_: mass(q),
            "forward_dynamics": forward,
            "gradient": lambda q, dq, ddq: weighted(q, dq, ddq, 2 * inverse(q, dq, ddq)),
            "slope": slope,
        }


def require_agreement(package: str, name: str, quantity: str, values: Any, ours: Any) -> None:
    """Stop the benchmark where a contender computes something else; a NaN is something else too."""
    values, ours = np.asarray(values), np.asarray(ours)
    off = float(np.abs(values - ours).max() / np.abs(ours).max())
    print(f"{package}, {quantity.replace('_', ' ')}: {name} differs by {off:.1e}", flush=True)
    if not off <= TOLERANCE:
        raise SystemExit(f"{package}: {name} computes another {quantity}, nothing is timed")


def repeated(
    name: str, function: Callable[..., Any], arguments: Sequence[Any], samples: int, ready: Callable[[Any], object] = id
) -> Contender:
    """A contender that calls a function with the same arguments; ``ready`` waits for the last result."""

    def sweep(count: int) -> None:
        for _ in range(count):
            found = function(*arguments)
        ready(found)

    return Contender(name, sweep, samples)


def timed(contenders: Sequence[Contender], rounds: int) -> dict[str, dict[str, float]]:
    """Quartiles of each, in nanoseconds for a state."""
    return {name: asdict(timing) for name, timing in interleave(contenders, rounds).items()}


def installed(*packages: str) -> dict[str, str]:
    """Versions of those that are there."""
    found = {}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
