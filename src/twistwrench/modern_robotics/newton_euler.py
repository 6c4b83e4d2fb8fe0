"""The Newton–Euler recursion of MR section 8.3 for one state, step by step: twists, accelerations, wrenches and torques."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.answers.answer import Answer
from ..core.errors import ConstraintError, ShapeError
from ..core.glossary import complete
from ..core.numbers import number
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..mechanics.algorithms.inverse_dynamics import applied_wrenches
from ..mechanics.algorithms.recursion import (
    armature_forces,
    collect,
    inward,
    joint_poses,
    outward,
    spread,
    spring_forces,
)
from ..mechanics.joints.units import units_of
from ..mechanics.lie.adjoint import Ad, ad
from ..mechanics.model.model import BASE
from ..robot import Robot
from ..robot.arguments import Wrenches, finite_states, sum_by_frame

if TYPE_CHECKING:
    from ..core.answers.blocks import Block, Column, Table

__all__ = ["NewtonEuler", "newton_euler"]

_DECIMALS = 12
"""Decimals of printed entries; digits after them are rounding errors."""
_MAX_ROWS = 12
"""Largest number of rows of a table in a short answer."""


@dataclass(frozen=True, eq=False, repr=False)
class NewtonEuler(Answer):
    """Both passes of the recursion of MR section 8.3; every vector is in the frame of its body. The verdict is DONE.

    Examples
    --------
    >>> import twistwrench as tw
    >>> steps = tw.robots.planar_2r().newton_euler([0, 0], [1, 0], [0, 0])
    >>> steps.V.shape, steps.F.shape, steps.tau.round(2).tolist(), list(steps.tables)
    ((2, 6), (2, 6), [29.43, 9.81], ['Twists V', 'Accelerations dV', 'Wrenches F', 'Torques'])
    """

    robot: Robot
    """The robot."""
    V: Array
    """(nbodies, 6) twists of the bodies (ω, v) [rad/s, m/s], from eq. 8.51."""
    dV: Array
    """(nbodies, 6) derivatives of the twists [rad/s², m/s²], from eq. 8.52; the base accelerates against gravity."""
    F: Array
    """(nbodies, 6) wrenches (m, f) [N m, N] through the joint of each body, from eq. 8.53."""
    of_wrenches: Array
    """(nv,) torques A'F of the wrenches F, from eq. 8.54."""
    of_drives: Array
    """(nv,) torques of armature and springs, which no body carries."""
    call = "newton_euler"

    @property
    def tau(self) -> Array:
        """(nv,) joint torques [N m, N], those of :meth:`.Robot.inverse_dynamics`."""
        return self.of_wrenches + self.of_drives

    @property
    def verdict(self) -> Verdict:
        """DONE."""
        return Verdict(Word.DONE)

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    def blocks(self) -> Iterator[Block]:
        """Tables of the outward and of the inward pass, and the torques.

        Returns
        -------
        blocks : iterator of Block
        """
        from ..core.answers.blocks import Table, numbers, words

        bodies = self.robot.body_names
        yield "MR section 8.3. Outward: V (8.51), dV (8.52); inward: F (8.53), τ = A' F (8.54)."
        yield _table("Twists V", bodies, self.V, ("ω", "v"), "dq")
        yield _table("Accelerations dV", bodies, self.dV, ("dω", "dv"), "ddq")
        yield _table("Wrenches F", bodies, self.F, ("m", "f"), "tau")
        model = self.robot.model
        units = units_of("tau", (turns for body in model.leaders for turns in body.joint.turning))
        columns_of_parts: list[Column] = []
        if self.of_drives.any():
            columns_of_parts.append(numbers("A' F", self.of_wrenches, _entry_text))
            columns_of_parts.append(numbers("drives", self.of_drives, _entry_text))
        yield Table(
            "Torques",
            words("joint", model.velocity_names),
            *columns_of_parts,
            numbers("τ", self.tau, _entry_text),
            words("unit", units),
            most=_MAX_ROWS,
        )

    def sources(self) -> Mapping[str, str | Path]:
        """File of the robot.

        Returns
        -------
        files : {argument: path}
        """
        return {"ROBOT": self.robot.model.source}


def newton_euler(
    robot: Robot,
    q: ArrayLike,
    dq: ArrayLike,
    ddq: ArrayLike,
    *,
    wrench_by_robot: Wrenches | None = None,
    wrench_on_robot: Wrenches | None = None,
) -> NewtonEuler:
    """Recursion of MR section 8.3 at one state, as the book writes it, for reading; slow.

    Returns
    -------
    steps : NewtonEuler

    Raises
    ------
    ConstraintError
        The robot has constraints, whose forces the recursion does not contain.

    Examples
    --------
    >>> import twistwrench as tw
    >>> newton_euler(tw.robots.planar_2r(), [0, 0], [0, 0], [0, 0]).tau.round(2).tolist()
    [29.43, 9.81]
    """
    if robot.constraints:
        raise ConstraintError(
            "newton_euler is of trees, and this robot has constraints. Give the robot before .close()."
        )
    q, dq, ddq = finite_states(robot.model, "newton_euler", q=q, dq=dq, ddq=ddq)
    if any(vector.ndim != 1 for vector in (q, dq, ddq)):
        raise ShapeError(
            f"newton_euler: one state is shown at a time, and q has shape {q.shape}. Give q[0], dq[0], ddq[0]."
        )
    model = robot.model
    n = len(model.bodies)
    T = joint_poses(model, q)
    Adq = spread(model, dq)  # A dq of each body's joint
    Addq = spread(model, ddq)
    V, dV, F = np.zeros((n, 6)), np.zeros((n, 6)), np.zeros((n, 6))
    V_base = np.zeros(6)
    dV_base = np.concatenate([np.zeros(3), -model.gravity])  # in place of weights
    for i, p in outward(model):
        V_p, dV_p = (V_base, dV_base) if p == BASE else (V[p], dV[p])
        Ad_ip = Ad(T[i]).inverse
        V[i] = Ad_ip @ V_p + Adq[i]  # (8.51)
        dV[i] = Ad_ip @ dV_p + ad(V[i]) @ Adq[i] + Addq[i]  # (8.52)
        G = model.bodies[i].inertia.matrix
        F[i] = G @ dV[i] - ad(V[i]).T @ (G @ V[i])  # (8.53), the body's own part
    wrenches = sum_by_frame(model, (q, dq, ddq), wrench_by_robot, wrench_on_robot)
    for i, F_by_body in applied_wrenches(model, wrenches):
        F[i] += F_by_body
    for i, p in inward(model):
        if p != BASE:
            F[p] += Ad(T[i]).inverse.T @ F[i]  # (8.53), the children's part
    of_wrenches = np.asarray(collect(model, F), float)  # (8.54)
    of_drives = np.asarray(armature_forces(model, dq, ddq) + spring_forces(model, q), float)
    return NewtonEuler(robot, V, dV, F, of_wrenches, of_drives)


def _entry_text(value: float) -> str:
    """Text of an entry of a vector."""
    return number(value, decimals=_DECIMALS)


def _table(title: str, bodies: tuple[str, ...], rows: Array, parts: tuple[str, str], quantity: str) -> Table:
    """Table of vectors (n, 6), one body a row; ``parts`` are the symbols of the angular and of the linear part.

    The ``quantity`` dq, ddq or tau has the same units.
    """
    from ..core.answers.blocks import Table, numbers, words

    angular_symbol, linear_symbol = parts
    angular_unit, linear_unit = units_of(quantity, (True, False))
    columns = []
    for k in range(6):
        symbol, unit = angular_symbol, angular_unit
        if k >= 3:
            symbol, unit = linear_symbol, linear_unit
        axis = "xyz"[k % 3]
        has_unit_in_heading = axis == "x"  # once for each part
        columns.append(numbers(f"{symbol}{axis}", rows[:, k], _entry_text, unit, headed=has_unit_in_heading))
    return Table(title, words("body", bodies), *columns, most=_MAX_ROWS)


complete(globals())
