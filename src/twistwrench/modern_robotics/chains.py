"""Chains of the book's lists, with kernels cached by the content of the lists."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError
from ..core.typing import Array
from ..robot import Robot, from_screws
from .checks import pose

# ``thetalist``, ``dthetalist`` … are (..., n); ``g`` (..., 3) m/s² in the space frame; ``Ftip`` (..., 6) the wrench applied
# by the robot, in the end-effector frame {n+1}; ``Mlist`` (n + 1, 4, 4); ``Glist`` (n, 6, 6); ``Slist`` (6, n).

MAX_CACHED_CHAINS = 64
"""Maximum number of cached sets of lists (least recently used are dropped). Machine code remains cached on disk."""
LISTS = ("Mlist", "Glist", "Slist", "Blist")
SIZES = {"g": 3, "Ftip": 6}
"""Numbers of an input that is not one per joint."""
_AT_TIP: dict[str, Any] = {"gravity": "input", "wrenches": True}
_KERNELS: dict[str, tuple[str, dict[str, Any]]] = {
    "pose": ("forward_kinematics", {}),
    "space_jacobian": ("jacobian", {"kind": "space"}),
    "body_jacobian": ("jacobian", {"kind": "body"}),
    "inverse_dynamics": ("inverse_dynamics", _AT_TIP),
    "forward_dynamics": ("forward_dynamics", _AT_TIP),
    "mass_matrix": ("mass_matrix", {}),
    "coriolis_forces": ("coriolis_forces", {}),
    "gravity_forces": ("gravity_forces", {"gravity": "input"}),
    "wrench_torques": ("wrench_torques", {}),
}
"""Quantities of a chain with their options. Gravity and the tip wrench are inputs, so new values need no compilation."""


class Chain:
    """Serial chain with its kernels."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.n = robot, robot.nv
        self._kernels: dict[str, np.ufunc] = {}

    def kernel(self, name: str) -> np.ufunc:
        """Kernel for a key of the table."""
        found = self._kernels.get(name)
        if found is None:
            quantity, options = _KERNELS[name]
            if "wrenches" in options:
                options = {**options, "wrenches": (str(self.robot.tip),)}
            found = self._kernels[name] = self.robot.kernel(quantity, **options)
        return found

    def joints(self, x: ArrayLike, name: str) -> Array:
        """Vector with one number per joint, or a batch of such vectors."""
        found = arguments.real(x, name)
        if found.ndim == 0 or found.shape[-1] != self.n:
            raise ShapeError(f"{name} has shape {found.shape}, but the lists describe {self.n} joints.")
        return found

    def checked(self, x: ArrayLike, name: str) -> Array:
        """Input of a kernel: gravity, a wrench at the tip, or one number per joint."""
        if name in SIZES:
            return arguments.real(x, name, SIZES[name])
        return self.joints(x, name)

    def run(self, quantity: str, **arrays: Array) -> Array:
        """Evaluate a quantity; raises ShapeError for batches that do not broadcast."""
        kernel = self.kernel(quantity)
        try:
            return kernel(*arrays.values())
        except ValueError:
            raise arguments.mismatch(**arrays) from None


def chain_of(Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Chain:
    """Chain from the book's lists: n + 1 poses, n inertias, n screw columns. Impossible inertias are accepted.

    Raises ShapeError for inconsistent lists, ModelError and InertiaError if they do not describe a robot.
    """
    steps = np.ascontiguousarray(arguments.real(Mlist, "Mlist"), float)
    inertias = np.ascontiguousarray(arguments.real(Glist, "Glist"), float)
    screws = np.ascontiguousarray(arguments.real(Slist, "Slist"), float)
    return _built(steps.tobytes(), inertias.tobytes(), screws.tobytes(), (steps.shape, inertias.shape, screws.shape))


def screws_of(screws: ArrayLike, name: str) -> Chain:
    """Chain from screws only: every link frame is {s} at zero, so space screws and body screws have equal coordinates."""
    S = np.ascontiguousarray(arguments.real(screws, name), float)
    if S.ndim != 2 or S.shape[0] != 6 or S.shape[1] == 0:
        raise ShapeError(f"{name} has shape {S.shape}, expected (6, n): a screw axis (omega, v) in each column.")
    n = S.shape[1]
    return _built(_HOME * (n + 1), bytes(288 * n), S.tobytes(), ((n + 1, 4, 4), (n, 6, 6), S.shape))


_HOME = np.eye(4).tobytes()
Shape = tuple[int, ...]


@lru_cache(maxsize=MAX_CACHED_CHAINS)
def _built(steps: bytes, inertias: bytes, screws: bytes, shapes: tuple[Shape, Shape, Shape]) -> Chain:
    raw = zip((steps, inertias, screws), shapes, strict=True)
    Mlist, Glist, Slist = (np.frombuffer(data).reshape(shape) for data, shape in raw)
    if Mlist.ndim == 3 and Mlist.shape[1:] == (4, 4):
        Mlist = np.array([pose(T, f"Mlist[{i}]") for i, T in enumerate(Mlist)])
    return Chain(from_screws(None, Slist, Mlist, Glist, name="lists", non_unit_screws=True, inertia="accept"))
