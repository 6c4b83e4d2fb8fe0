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
"""Share of the largest singular value up to which a singular value counts as zero."""
_BALANCE_TOLERANCE = 1e-9
"""Largest unbalanced torque of balanced torques, as a share of given torques and gravity."""
_ROUNDING = 1e-13
"""Rounding error of a torque, as a share of given torques and gravity."""
_MIN_ENTRY_SHARE = 1e-9
"""Share of the largest entry up to which an entry of a combination is a rounding error."""
_MAX_ROUNDING = 1e-12
"""Largest rounding error of an entry, relative to the pivot 1 of its row."""
_MAX_ROUNDING_OF_FACTOR = 1e-9
"""Difference from 1 up to which a factor counts as 1, which is not written."""


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
        max_unbalanced = np.abs(self.unbalanced).max(initial=0.0)
        return bool(max_unbalanced <= _BALANCE_TOLERANCE * self._torque_scale)

    @property
    def _torque_scale(self) -> float:
        """Sum of the largest given torque and the largest torque of gravity."""
        return self.size + float(np.abs(self.gravity).max(initial=0.0))

    def __str__(self) -> str:
        return "\n".join(self._sentences())

    def _sentences(self) -> Iterator[str]:
        """Sentences on the wrench, on wrenches and motions that torques do not determine, and on unbalanced torques."""
        least_lever = 1.0
        if self.rank:
            least_lever = self.singular_values[self.rank - 1]
        rounding = _ROUNDING * self._torque_scale / least_lever  # of an entry of the wrench
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
    found : TorqueWrench, ``wrench`` (6,), and what the torques do not determine

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
    rank, U, Vt, row_scale, column_scale = _equilibrate(J)
    scale = np.array([length] * 3 + [1.0] * 3)  # scale * J is in m in all rows
    idle = column_scale[:, None] * Vt[rank:].T
    borne = row_scale[:, None] * U[:, rank:]
    idle_basis, _ = np.linalg.qr(idle)
    unbalanced = idle_basis @ (idle_basis.T @ (tau - g))
    # The wrench of least norm in the metric of ``length``: any solution minus its part in the null space.
    equilibrated_J = row_scale[:, None] * J * column_scale
    solution, *_ = np.linalg.lstsq(equilibrated_J.T, column_scale * (tau - g - unbalanced), rcond=RANK_TOLERANCE)
    F = row_scale * solution
    borne_basis, _ = np.linalg.qr(borne / scale[:, None])
    F = F - scale * (borne_basis @ (borne_basis.T @ (F / scale)))
    producible, _ = np.linalg.qr((scale**2 / row_scale)[:, None] * U[:, :rank])
    return TorqueWrench(
        wrench=F,
        unbalanced=unbalanced,
        producible=producible,
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
    """Rank of J (6, nv), U and V' of the singular value decomposition of R J C, and the diagonals of R and C.

    R multiplies rotational rows by the longest lever of a revolute joint, so that ranks do not depend on the robot's size.
    C scales every joint to the same effect on the frame.
    """
    rotation = np.linalg.norm(J[:3], axis=0)  # of each joint
    translation = np.linalg.norm(J[3:], axis=0)
    turns = rotation > 0
    longest_lever = np.max(translation[turns] / rotation[turns], initial=0.0)  # [m]
    if longest_lever == 0.0:  # no revolute joint moves the frame's origin
        longest_lever = 1.0
    row_scale = np.array([longest_lever] * 3 + [1.0] * 3)
    effects = np.linalg.norm(row_scale[:, None] * J, axis=0)  # of the joints on the frame
    largest_effect = effects.max(initial=0.0)  # 0 if no joint moves the frame
    has_effect = effects > RANK_TOLERANCE**1.5 * largest_effect  # far below the rank tolerance: only rounding errors
    column_scale = 1.0 / np.where(has_effect, effects, largest_effect or 1.0)
    U, singular_values, Vt = np.linalg.svd(row_scale[:, None] * J * column_scale)
    is_nonzero = singular_values > RANK_TOLERANCE * singular_values.max(initial=0.0)
    rank = int(np.sum(is_nonzero))
    return rank, U, Vt, row_scale, column_scale


def _sparse_basis(B: Array) -> Array:
    """Sparse basis (n, k) of the space of the columns B (n, k) by elimination; the largest entry of each column is 1."""
    rows = B.T.copy()
    for k in range(len(rows)):
        remaining_entries = np.abs(rows[k:])
        pivot_index = int(np.argmax(remaining_entries))
        row_after_k, column = np.unravel_index(pivot_index, remaining_entries.shape)
        pivot_row = k + int(row_after_k)
        rows[[k, pivot_row]] = rows[[pivot_row, k]]
        rows[k] /= rows[k, column]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, column] * rows[k]
                rows[other, column] = 0.0
    rows[np.abs(rows) < _MAX_ROUNDING] = 0.0
    if not rows.size:
        return rows.T
    peak_columns = np.argmax(np.abs(rows), axis=1)
    peaks = rows[np.arange(len(rows)), peak_columns]  # largest entry of each row, with its sign
    return (rows / peaks[:, None]).T


def _combination(x: Array, names: tuple[str, ...], nothing: str = "nothing", least: float = 0.0) -> str:
    """Linear combination as text, ``0.5 mx − 2 fz``, without entries up to ``least`` and rounding errors.

    ``nothing`` is the text if no entry remains.
    """
    max_left_out = max(least, _MIN_ENTRY_SHARE * float(np.abs(x).max(initial=0.0)))
    terms = []
    for entry, name in zip(x, names, strict=True):
        magnitude = abs(entry)
        if not magnitude > max_left_out:
            continue
        sign = "-" if entry < 0 else "+"
        is_one = abs(magnitude - 1) < _MAX_ROUNDING_OF_FACTOR
        factor = "" if is_one else f"{number(magnitude)} "
        terms.append(f"{sign} {factor}{name}")
    if not terms:
        return nothing
    return " ".join(terms).removeprefix("+ ").replace("-", "−")


complete(globals())
