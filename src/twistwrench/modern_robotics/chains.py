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
"""Names of the lists that describe a chain."""
SIZES = {"g": 3, "Ftip": 6}
"""Number of entries of each input that does not have one entry per joint."""
_GRAVITY_AND_TIP_WRENCH: dict[str, Any] = {"gravity": "input", "wrenches": True}
_KERNELS: dict[str, tuple[str, dict[str, Any]]] = {
    "pose": ("forward_kinematics", {}),
    "space_jacobian": ("jacobian", {"kind": "space"}),
    "body_jacobian": ("jacobian", {"kind": "body"}),
    "inverse_dynamics": ("inverse_dynamics", _GRAVITY_AND_TIP_WRENCH),
    "forward_dynamics": ("forward_dynamics", _GRAVITY_AND_TIP_WRENCH),
    "mass_matrix": ("mass_matrix", {}),
    "coriolis_forces": ("coriolis_forces", {}),
    "gravity_forces": ("gravity_forces", {"gravity": "input"}),
    "wrench_torques": ("wrench_torques", {}),
}
"""Quantity and options of each kernel of a chain. Gravity and tip wrench are inputs, so new values need no compilation."""


class Chain:
    """Serial chain with its kernels."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.n = robot.nv
        """Number of joints."""
        self._kernels: dict[str, np.ufunc] = {}

    def kernel(self, name: str) -> np.ufunc:
        """Kernel of a quantity in ``_KERNELS``, made at the first use."""
        kernel = self._kernels.get(name)
        if kernel is None:
            quantity, options = _KERNELS[name]
            if "wrenches" in options:
                options = {**options, "wrenches": (str(self.robot.tip),)}
            kernel = self.robot.kernel(quantity, **options)
            self._kernels[name] = kernel
        return kernel

    def joints(self, values: ArrayLike, name: str) -> Array:
        """Vector with one number per joint, or a batch of such vectors."""
        vectors = arguments.real(values, name)
        if vectors.ndim == 0 or vectors.shape[-1] != self.n:
            raise ShapeError(f"{name} has shape {vectors.shape}, but the lists describe {self.n} joints.")
        return vectors

    def checked(self, values: ArrayLike, name: str) -> Array:
        """Input of a kernel: gravity, a wrench at the tip, or one number per joint."""
        if name in SIZES:
            return arguments.real(values, name, SIZES[name])
        return self.joints(values, name)

    def run(self, quantity: str, **arrays: Array) -> Array:
        """Evaluate a quantity; raises ShapeError for batches that do not broadcast."""
        kernel = self.kernel(quantity)
        try:
            return kernel(*arrays.values())
        except ValueError:
            raise arguments.mismatch(**arrays) from None


def chain_of(Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Chain:
    """Chain from the book's lists: n + 1 poses, n inertias, n screws in columns. Impossible inertias are accepted.

    Raises ShapeError for inconsistent lists, ModelError and InertiaError if they do not describe a robot.
    """
    poses = np.ascontiguousarray(arguments.real(Mlist, "Mlist"), float)
    inertias = np.ascontiguousarray(arguments.real(Glist, "Glist"), float)
    screws = np.ascontiguousarray(arguments.real(Slist, "Slist"), float)
    shapes = (poses.shape, inertias.shape, screws.shape)
    return _cached_chain(poses.tobytes(), inertias.tobytes(), screws.tobytes(), shapes)


def screws_of(screws: ArrayLike, name: str) -> Chain:
    """Chain from screws only. Every link frame is {s} at zero, so space screws and body screws have equal coordinates."""
    S = np.ascontiguousarray(arguments.real(screws, name), float)
    if S.ndim != 2 or S.shape[0] != 6 or S.shape[1] == 0:
        raise ShapeError(f"{name} has shape {S.shape}, expected (6, n): a screw axis (omega, v) in each column.")
    n = S.shape[1]
    zero_inertias = bytes(_INERTIA_BYTES * n)
    shapes = ((n + 1, 4, 4), (n, 6, 6), S.shape)
    identity_poses = _IDENTITY_BYTES * (n + 1)
    return _cached_chain(identity_poses, zero_inertias, S.tobytes(), shapes)


_IDENTITY_BYTES = np.eye(4).tobytes()
_INERTIA_BYTES = 6 * 6 * 8
"""Size of a matrix (6, 6) of float64 [bytes]."""
Shape = tuple[int, ...]


@lru_cache(maxsize=MAX_CACHED_CHAINS)
def _cached_chain(poses: bytes, inertias: bytes, screws: bytes, shapes: tuple[Shape, Shape, Shape]) -> Chain:
    """Chain from the bytes of the lists and their shapes; both are the key of the cache."""
    pose_shape, inertia_shape, screw_shape = shapes
    Mlist = np.frombuffer(poses).reshape(pose_shape)
    Glist = np.frombuffer(inertias).reshape(inertia_shape)
    Slist = np.frombuffer(screws).reshape(screw_shape)
    if Mlist.ndim == 3 and Mlist.shape[1:] == (4, 4):
        Mlist = np.array([pose(T, f"Mlist[{i}]") for i, T in enumerate(Mlist)])
    return Chain(from_screws(None, Slist, Mlist, Glist, name="lists", non_unit_screws=True, inertia="accept"))
