"""Wrench from joint torques: produced, borne by the structure, and unbalanced."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from ..core.numbers import number
from ..core.typing import Array
from ..mechanics.lie.labelled import WRENCH
from .arguments import one_configuration

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.arguments import Kind

RANK_TOLERANCE = 1e-9
"""Singular values below this share of the largest count as zero: the pose is then singular."""


@dataclass(frozen=True, eq=False)
class TorqueWrench:
    """Wrench of a set of torques at rest, with the wrenches and torques that the other side does not determine.

    Balance is τ - g(q) = J' F + ``unbalanced``. Torques do not determine the part that the structure bears: every
    F = ``wrench`` + ``borne`` @ x, for any x (6 - rank), fits equally. ``print`` shows the result as text.
    """

    wrench: Array
    """(6,): smallest wrench (m, f) that fits, by the robot on the world [N m, N]."""
    unbalanced: Array
    """(nv,): the part of τ - g that no wrench at the frame balances; it would set the robot in motion."""
    producible: Array
    """(6, rank): orthonormal basis of the wrenches that torques produce, of least norm; range of J."""
    borne: Array
    """(6, 6 - rank): sparse basis of the wrenches that the structure bears without torque, null space of J'."""
    idle: Array
    """(nv, nv - rank): sparse basis of the joint motions that leave the frame at rest, null space of J."""
    singular_values: Array
    """Singular values of J with lengths in units of ``length``, descending."""
    gravity: Array
    """(nv,): g(q), subtracted first; use ``robot.with_gravity((0, 0, 0))`` to exclude it."""
    joint_names: tuple[str, ...]
    """Names of the joints."""
    frame: str
    """Frame of application of the wrench."""
    kind: Kind
    """Axes and reference point, as in :meth:`Robot.jacobian`."""
    length: float
    """Characteristic length that relates moments to forces [m]."""
    size: float
    """Largest given torque, the scale of rounding errors [N m or N]."""

    @property
    def rank(self) -> int:
        """Number of independent wrenches that torques can produce."""
        return self.producible.shape[1]

    @property
    def balanced(self) -> bool:
        """True if the wrench balances the torques to within 1e-9 of them."""
        return bool(np.abs(self.unbalanced).max(initial=0.0) <= 1e-9 * self._torques)

    @property
    def _torques(self) -> float:
        return self.size + float(np.abs(self.gravity).max(initial=0.0))

    def __str__(self) -> str:
        return "\n".join(self._sentences())

    def _sentences(self) -> Iterator[str]:
        rounding = 1e-13 * self._torques / (self.singular_values[self.rank - 1] if self.rank else 1.0)
        yield f"wrench at {self.frame} ({self.kind}): {_combination(self.wrench, WRENCH, 'none', rounding)}"
        n = len(self.joint_names)
        singular = ""
        if self.rank < min(6, n):
            singular = f", a singular pose (rank {self.rank} of {min(6, n)})"
        yield f"{n} joints make {self.rank} independent wrenches{singular}"
        for column in self.borne.T:
            yield f"borne by the structure: {_combination(column, WRENCH)}"
        for column in self.idle.T:
            yield f"moves nothing there: {_combination(column, self.joint_names)}"
        if not self.balanced:
            yield f"no wrench balances: {_combination(self.unbalanced, self.joint_names)}"


def wrench_from_torques(
    robot: Robot, q: ArrayLike, tau: ArrayLike, frame: str | None = None, *, kind: Kind = "body", length: float = 1.0
) -> TorqueWrench:
    r"""Wrench from joint torques: the wrench that the robot at rest applies at a frame with torques ``tau``.

    Solves τ - g(q) = J' F by singular values, MR eq. 5.26, section 5.2, also at singular poses and for any number of
    joints. If several wrenches fit, the one with the least \|f\|² + \|m\|² / length² is returned. The range and null
    space do not depend on ``length``. Takes one state per call, as the rank depends on the pose.

    Parameters
    ----------
    length : float, by which moments and forces are compared [m]

    Returns
    -------
    found : TorqueWrench, ``wrench`` (6,) and its company

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r().with_gravity((0, 0, 0))
    >>> found = wrench_from_torques(arm, [0.0, np.pi / 2], [1.0, 1.0], kind="world_aligned")
    >>> found.rank, found.balanced
    (2, True)
    >>> stretched = wrench_from_torques(arm, [0.0, 0.0], [2.0, 1.0])
    >>> bool(np.allclose(arm.wrench_torques([0.0, 0.0], stretched.wrench), [2.0, 1.0]))
    True
    """
    q = one_configuration(robot, q, "wrench_from_torques", "the rank of J differs from pose to pose")
    tau = arguments.one(tau, "wrench_from_torques: tau", robot.nv, names=robot.model.velocity_names)
    tau = arguments.finite(tau, "wrench_from_torques: tau")
    length = arguments.positive(length, "length [m]")
    g = np.asarray(robot.holding_torques(q))  # includes springs of elastic joints
    J = np.asarray(robot.jacobian(q, frame, kind))
    rank, U, Vt, rows, columns = _equilibrate(J)
    scale = np.array([length] * 3 + [1.0] * 3)  # J_w * length and J_v are both in m
    idle = columns[:, None] * Vt[rank:].T
    borne = rows[:, None] * U[:, rank:]
    lost = np.linalg.qr(idle)[0]
    unbalanced = lost @ (lost.T @ (tau - g))
    # The wrench of least norm in the metric of ``length``: any solution minus its part in the null space.
    B = rows[:, None] * J * columns
    F = rows * np.linalg.lstsq(B.T, columns * (tau - g - unbalanced), rcond=RANK_TOLERANCE)[0]
    free = np.linalg.qr(borne / scale[:, None])[0]
    F = F - scale * (free @ (free.T @ (F / scale)))
    return TorqueWrench(
        wrench=F,
        unbalanced=unbalanced,
        producible=np.linalg.qr((scale**2 / rows)[:, None] * U[:, :rank])[0],
        borne=_sparse_basis(borne),
        idle=_sparse_basis(idle),
        singular_values=np.linalg.svd(scale[:, None] * J, compute_uv=False),
        gravity=g,
        joint_names=robot.model.velocity_names,
        frame=str(robot.tip if frame is None else frame),
        kind=kind,
        length=length,
        size=float(np.abs(tau).max(initial=0.0)),
    )


def _equilibrate(J: Array) -> tuple[int, Array, Array, Array, Array]:
    """Rank of J (6, nv), U and V' of R J C by singular values, and the diagonals of R and C, which equilibrate J.

    R divides rotational rows by the longest lever of a revolute joint, so that ranks do not depend on the robot's size.
    C scales every joint to the same effect on the frame.
    """
    turn, move = (np.linalg.norm(part, axis=0) for part in (J[:3], J[3:]))
    lever = np.max(move[turn > 0] / turn[turn > 0], initial=0.0)
    rows = np.array([lever or 1.0] * 3 + [1.0] * 3)
    moves = np.linalg.norm(rows[:, None] * J, axis=0)
    felt = moves > RANK_TOLERANCE**1.5 * moves.max(initial=0.0)
    columns = 1.0 / np.where(felt, moves, moves.max(initial=0.0) or 1.0)
    U, s, Vt = np.linalg.svd(rows[:, None] * J * columns)
    return int(np.sum(s > RANK_TOLERANCE * s.max(initial=0.0))), U, Vt, rows, columns


def _sparse_basis(B: Array) -> Array:
    """Sparse basis (n, k) of the same space by elimination, each column's largest entry 1."""
    rows = B.T.copy()
    for k in range(len(rows)):
        r, c = divmod(int(np.argmax(np.abs(rows[k:]))), rows.shape[1])
        rows[[k, k + r]] = rows[[k + r, k]]
        rows[k] /= rows[k, c]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, c] * rows[k]
                rows[other, c] = 0.0
    rows[np.abs(rows) < 1e-12] = 0.0  # relative to the pivot 1 of each row
    if not rows.size:
        return rows.T
    peaks = rows[np.arange(len(rows)), np.argmax(np.abs(rows), axis=1)]
    return (rows / peaks[:, None]).T


def _combination(x: Array, names: tuple[str, ...], nothing: str = "nothing", least: float = 0.0) -> str:
    """Linear combination as text, without rounding errors: ``0.5 mx − 2 fz``."""
    least = max(least, 1e-9 * float(np.abs(x).max(initial=0.0)))
    shown = [(v, n) for v, n in zip(x, names, strict=True) if abs(v) > least]
    if not shown:
        return nothing
    terms = []
    for value, name in shown:
        factor = "" if abs(abs(value) - 1) < 1e-9 else f"{number(abs(value))} "
        terms.append(f"{'-' if value < 0 else '+'} {factor}{name}")
    return " ".join(terms).removeprefix("+ ").replace("-", "−")


complete(globals())
