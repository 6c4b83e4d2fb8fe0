"""From torques back to the wrench: what the joints produce, what the structure bears, and what nothing balances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import number
from ..screws.component_names import WRENCH
from ..typing import Array
from .pose_arguments import one_configuration

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.quantity_types import Kind

RANK_TOLERANCE = 1e-9
"""Singular values below this share of the largest count as zero: the pose is then singular."""


@dataclass(frozen=True, eq=False)
class TorqueWrench:
    """The wrench a set of torques produces at rest, and the parts of both worlds that the other never sees.

    Balance reads τ - g(q) = J' F + ``unbalanced``. Every F = ``wrench`` + ``borne`` @ x, for any x (6 - rank), fits it
    equally: what the structure bears takes no torque, and torques cannot tell it. ``print`` it for the whole in words.
    """

    wrench: Array
    """(6,): (m, f) by the robot on the world, the smallest of those that fit [N m, N]."""
    unbalanced: Array
    """(nv,): the part of τ - g that no wrench at the frame balances; it would set the robot in motion."""
    producible: Array
    """(6, rank): an orthonormal basis of the wrenches that torques make, the smallest of their kind; range of J."""
    borne: Array
    """(6, 6 - rank): a basis of the wrenches the structure bears without torque, null space of J'; sparse."""
    idle: Array
    """(nv, nv - rank): a basis of the joint motions that leave the frame at rest, null space of J; sparse."""
    singular_values: Array
    """Of J with lengths in units of ``length``, descending."""
    gravity: Array
    """(nv,): g(q), taken off first; use ``robot.with_gravity((0, 0, 0))`` to leave it out."""
    joint_names: tuple[str, ...]
    """Names of the joints."""
    frame: str
    """The frame at which the wrench is applied."""
    kind: Kind
    """Axes and reference point, as in :meth:`Robot.jacobian`."""
    length: float
    """The length by which moments and forces were compared [m]."""
    size: float
    """The largest of the torques given, which rounding goes by [N m or N]."""

    @property
    def rank(self) -> int:
        """How many independent wrenches the torques make."""
        return self.producible.shape[1]

    @property
    def balanced(self) -> bool:
        """Whether the wrench balances the torques entirely, to a billionth of them."""
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
        singular = f", a singular pose (rank {self.rank} of {min(6, n)})" if self.rank < min(6, n) else ""
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
    r"""Wrench from joint torques: what the robot at rest applies at a frame with torques ``tau``.

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    tau : (nv,) array_like, joint torques [N m, sliding joints: N]
    frame : str, optional, a link of the robot; its tip if None
    kind : "body", "space" or "world_aligned", axes and reference point as in :meth:`twistwrench.Robot.jacobian`
    length : float, by which moments and forces are compared [m]

    Returns
    -------
    found : TorqueWrench, ``wrench`` (6,) and its company

    Raises
    ------
    ShapeError, ValueRangeError
        An argument is of another size, or the state is a batch.
    UnknownNameError
        The robot has no such frame.
    FrameError
        No frame is named, and the robot has no single tip.

    Notes
    -----
    Solves τ - g(q) = J' F by singular values, MR eq. 5.26, section 5.2; right at singular poses and for any number of
    joints. The smallest of many wrenches is that with the least \|f\|² + \|m\|² / length²; what torques and structure
    can do does not depend on ``length``. One state at a time, as the rank differs from pose to pose.

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
    g = np.asarray(robot.holding_torques(q))  # springs too, where joints are elastic
    J = np.asarray(robot.jacobian(q, frame, kind))
    rank, U, Vt, rows, columns = _equilibrated(J)
    scale = np.array([length] * 3 + [1.0] * 3)  # J_w * length and J_v are both in m
    idle = columns[:, None] * Vt[rank:].T
    borne = rows[:, None] * U[:, rank:]
    lost = np.linalg.qr(idle)[0]
    unbalanced = lost @ (lost.T @ (tau - g))
    # Any wrench that fits, less what the structure bears anyway: the smallest, in the metric of ``length``.
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


def _equilibrated(J: Array) -> tuple[int, Array, Array, Array, Array]:
    """The rank of J (6, nv), U and V' of R J C by singular values, and the diagonals of R and C, which make its entries alike.

    R counts turning at the length of the longest lever that a turning joint has, so that robots of a micrometre have the
    ranks of those of a metre, and C every joint as if it moved the frame as much as any.
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
    """A basis (n, k) of the same space with as many zeros as elimination brings, each column's largest entry 1."""
    rows = B.T.copy()
    for k in range(len(rows)):
        r, c = divmod(int(np.argmax(np.abs(rows[k:]))), rows.shape[1])
        rows[[k, k + r]] = rows[[k + r, k]]
        rows[k] /= rows[k, c]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, c] * rows[k]
                rows[other, c] = 0.0
    rows[np.abs(rows) < 1e-12] = 0.0  # beside the 1 that each row was divided to
    peaks = rows[np.arange(len(rows)), np.argmax(np.abs(rows), axis=1)] if rows.size else np.ones(len(rows))
    return (rows / peaks[:, None]).T


def _combination(x: Array, names: tuple[str, ...], nothing: str = "nothing", least: float = 0.0) -> str:
    """Numbers with their names, round-off left out: ``0.5 mx − 2 fz``."""
    least = max(least, 1e-9 * float(np.abs(x).max(initial=0.0)))
    shown = [(v, n) for v, n in zip(x, names, strict=True) if abs(v) > least]
    if not shown:
        return nothing
    words = [f"{'-' if v < 0 else '+'} {'' if abs(abs(v) - 1) < 1e-9 else f'{number(abs(v))} '}{n}" for v, n in shown]
    return " ".join(words).removeprefix("+ ").replace("-", "−")
