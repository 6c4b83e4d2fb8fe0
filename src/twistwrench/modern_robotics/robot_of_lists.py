"""Compiled robots from the book's lists, cached by their content."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError
from ..robot import Robot, from_screws
from ..typing import Array
from . import matrix_arguments

KEPT = 64
"""How many sets of lists keep their kernels; the least recently used goes first. Machine code stays on disk beyond that."""


class Chain:
    """A serial chain and its kernels. Gravity and the wrench at the tip are inputs, so that no value of them compiles anew."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.n = robot, robot.nv
        self._tip = str(robot.tip)

    @cached_property
    def pose(self) -> np.ufunc:
        """theta → T_s,tip."""
        return self.robot.kernel("forward_kinematics")

    @cached_property
    def space_jacobian(self) -> np.ufunc:
        """theta → J_s."""
        return self.robot.kernel("jacobian", kind="space")

    @cached_property
    def body_jacobian(self) -> np.ufunc:
        """theta → J_b."""
        return self.robot.kernel("jacobian", kind="body")

    @cached_property
    def inverse_dynamics(self) -> np.ufunc:
        """theta, dtheta, ddtheta, F_tip, g → τ."""
        return self.robot.kernel("inverse_dynamics", gravity="input", wrenches=(self._tip,))

    @cached_property
    def forward_dynamics(self) -> np.ufunc:
        """theta, dtheta, τ, F_tip, g → ddtheta."""
        return self.robot.kernel("forward_dynamics", gravity="input", wrenches=(self._tip,))

    @cached_property
    def mass_matrix(self) -> np.ufunc:
        """theta → M."""
        return self.robot.kernel("mass_matrix")

    @cached_property
    def coriolis_forces(self) -> np.ufunc:
        """theta, dtheta → c."""
        return self.robot.kernel("coriolis_forces")

    @cached_property
    def gravity_forces(self) -> np.ufunc:
        """theta, g → g(theta)."""
        return self.robot.kernel("gravity_forces", gravity="input")

    @cached_property
    def wrench_torques(self) -> np.ufunc:
        """theta, F_tip → J' F."""
        return self.robot.kernel("wrench_torques")

    def joints(self, x: ArrayLike, name: str) -> Array:
        """A vector with one number for each joint, or a batch of such vectors."""
        found = matrix_arguments.array(x, name)
        if found.ndim == 0 or found.shape[-1] != self.n:
            raise ShapeError(f"{name} has shape {found.shape}, but the lists describe {self.n} joints.")
        return found

    def run(self, kernel: np.ufunc, **arrays: Array) -> Array:
        """The kernel on arrays that are cleaned already; batches that do not broadcast are a ShapeError."""
        try:
            return kernel(*arrays.values())
        except ValueError:
            raise arguments.mismatch(**arrays) from None


def chain_of(Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Chain:
    """The chain of the book's lists: n + 1 poses, n inertias, screws in n columns. Impossible inertias are accepted.

    Raises ShapeError for lists that do not fit together, ModelError and InertiaError for what describes no robot.
    """
    steps, inertias, screws = (
        np.ascontiguousarray(matrix_arguments.array(x, name), float)
        for x, name in ((Mlist, "Mlist"), (Glist, "Glist"), (Slist, "Slist"))
    )
    return _built(steps.tobytes(), inertias.tobytes(), screws.tobytes(), (steps.shape, inertias.shape, screws.shape))


def screws_of(screws: ArrayLike, name: str) -> Chain:
    """The chain of screws alone: every link frame is {s} at zero, so space screws and body screws are the same numbers."""
    S = np.ascontiguousarray(matrix_arguments.array(screws, name), float)
    if S.ndim != 2 or S.shape[0] != 6 or S.shape[1] == 0:
        raise ShapeError(f"{name} has shape {S.shape}, expected (6, n): a screw axis (omega, v) in each column.")
    n = S.shape[1]
    return _built(_HOME * (n + 1), bytes(288 * n), S.tobytes(), ((n + 1, 4, 4), (n, 6, 6), S.shape))


_HOME = np.eye(4).tobytes()
Shape = tuple[int, ...]


@lru_cache(maxsize=KEPT)
def _built(steps: bytes, inertias: bytes, screws: bytes, shapes: tuple[Shape, Shape, Shape]) -> Chain:
    raw = zip((steps, inertias, screws), shapes, strict=True)
    Mlist, Glist, Slist = (np.frombuffer(data).reshape(shape) for data, shape in raw)
    if Mlist.ndim == 3 and Mlist.shape[1:] == (4, 4):
        Mlist = np.array([matrix_arguments.pose(T, f"Mlist[{i}]") for i, T in enumerate(Mlist)])
    return Chain(from_screws(None, Slist, Mlist, Glist, name="lists", non_unit_screws=True, inertia="accept"))
