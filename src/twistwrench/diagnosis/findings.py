"""Findings of the doctor, their repairs, and the effect of changed inertias on a model.

With the pseudo-inertia J of a body in the base frame and the twist [A] of the body due to a unit velocity, both (4, 4),
M_jj = Σ tr([A] J [A]') and g_j = -Σ g . ([A] J)_4. Both are linear in J, so only the changed bodies are evaluated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from ..core.glossary import complete
from ..core.numbers import number
from ..core.typing import Array
from ..formats.edit import Edit
from ..mechanics.algorithms.recursion import ancestors, base_poses
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import se3
from ..mechanics.model.assembly import random_configuration
from ..mechanics.model.model import BASE, Model


class Severity(StrEnum):
    """Severity of a finding."""

    ERROR = "error"
    """The part is physically impossible or cannot be read."""
    WARNING = "warning"
    """Very probably an error that changes results."""
    NOTE = "note"


_ALL = 1e8
"""Percentage above which a repair leaves a joint with almost no inertia."""


@dataclass(frozen=True)
class Effect:
    """Effect of a finding: the largest changes between file and repair over random configurations.

    Attributes
    ----------
    inertia_percent : float, change of a diagonal entry of the mass matrix, in percent of the repaired robot's
    inertia_joint : str, joint of that entry; empty without a change
    torque : float, change of a gravity torque or force [N m or N]
    torque_joint : str
    effort_percent : float, change of a gravity torque in percent of the effort limit; 0 without a limit
    effort_joint : str

    Examples
    --------
    >>> print(Effect(260.0, "wrist_3_joint", 0.0, "", 0.0, ""))
    M of wrist_3_joint by 260 %
    """

    inertia_percent: float = 0.0
    inertia_joint: str = ""
    torque: float = 0.0
    torque_joint: str = ""
    effort_percent: float = 0.0
    effort_joint: str = ""

    def __str__(self) -> str:
        lost = self.inertia_percent >= _ALL
        by = f"M of {self.inertia_joint} " + ("to next to nothing" if lost else f"by {_percent(self.inertia_percent)}")
        said = [by] if self.inertia_joint else []
        if self.torque_joint:
            share = (
                f", {_percent(self.effort_percent)} of the effort of {self.effort_joint}" if self.effort_joint else ""
            )
            said.append(f"g of {self.torque_joint} by {number(self.torque, 3)}{share}")
        return "; ".join(said) or "none"

    def reaches(self, percent: float, effort: float = 1.0) -> bool:
        """True if an entry of M or a gravity torque changes by at least the given percentage.

        Parameters
        ----------
        percent : float, of the entry of M
        effort : float, of the effort limit

        Examples
        --------
        >>> Effect(3.0, "elbow").reaches(5.0)
        False
        """
        return self.inertia_percent >= percent or self.effort_percent >= effort


@dataclass(frozen=True, eq=False)
class FileRepair:
    """Repair of a finding: changes and reason.

    Attributes
    ----------
    kind : str, "slip" for a single entry error, "nearest", "entropic", "shape", "mirror", "number" or "advice"
    sentence : str
    inertias : {link: SpatialInertia}, repaired inertias about the link's origin
    edits : numbers of the file to change; empty if nothing is written
    metric : str, metric of "nearest"
    """

    kind: str
    sentence: str
    inertias: Mapping[str, SpatialInertia] = field(default_factory=dict)
    edits: tuple[Edit, ...] = ()
    metric: str = ""


@dataclass(frozen=True, eq=False)
class Finding:
    """Finding of the doctor.

    Attributes
    ----------
    check : str, name of the check
    severity : Severity
    where : str, link or joint
    line : int, line in the file; 0 if unknown
    sentence : str, description of the error
    numbers : {name: float}, values behind the finding
    effect : Effect, between the file and its repair
    repair : FileRepair, or None
    file : str, included file that contains the line; empty for the robot's own
    collective : bool, True if ``where`` names all joints with the same problem
    """

    check: str
    severity: Severity
    where: str
    line: int
    sentence: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    effect: Effect = Effect()
    repair: FileRepair | None = None
    file: str = ""
    collective: bool = False

    def __str__(self) -> str:
        place = f" ({self.file + ', ' if self.file else ''}line {self.line})" if self.line else ""
        return f"{self.severity}: {self.where}{place}: {self.sentence}"


def _percent(value: float) -> str:
    return f"{number(value, 3)} %" if value < 1e4 else f"a factor of {number(value / 100.0, 2)}"


# ── Effects over random configurations

CONFIGURATIONS = 200
"""Number of random configurations for the largest effect."""
_STEPS = 3_000_000
"""Largest product of bodies, configurations and depth; above it, fewer configurations are used."""
_TINY = 1e-9
"""Relative changes below this are rounding errors."""


class Effects:
    """Effects on one model at random configurations with a fixed seed."""

    def __init__(self, model: Model, seed: int = 0, count: int = CONFIGURATIONS) -> None:
        self.model = model
        depths: list[int] = []
        for body in model.bodies:
            depths.append(1 + (depths[body.parent] if body.parent != BASE else 0))
        self.count = int(np.clip(_STEPS // max(1, sum(depths)), 1, count))
        self.q = random_configuration(model, np.random.default_rng(seed), (self.count,))
        self._screws: list[list[tuple[int, Array]] | None] = [None] * len(model.bodies)

    def evaluate(self, changes: Mapping[str, SpatialInertia]) -> Effect:
        """Effect of changed inertias of links, each about its link's origin."""
        deltas: dict[int, Array] = {}
        for link, wanted in changes.items():
            frame = self.model.frames[link]
            if frame.body == BASE:
                continue
            change = (wanted - self.model.link_inertias[link]).in_frame(frame.pose)
            deltas[frame.body] = deltas.get(frame.body, 0.0) + change.pseudo_inertia
        if not deltas:
            return Effect()
        columns, dM, dg = self._sums(deltas)
        return self._largest(columns, dM, dg)

    def _largest(self, columns: Array, dM: Array, dg: Array) -> Effect:
        """Largest effect of changes (count, k) in the given columns."""
        if not len(columns):
            return Effect()
        names = [self.model.velocity_names[k] for k in columns]
        M, limit = self.diagonal[:, columns], self.model.limits.effort[columns]
        new = np.maximum(M + dM, _TINY * np.maximum(np.abs(M), np.abs(dM)) + 1e-300)
        share = 100.0 * (np.abs(dM) / new).max(axis=0)
        torque = np.abs(dg).max(axis=0)
        effort = np.where(np.isfinite(limit) & (limit > 0), 100.0 * torque / np.where(limit > 0, limit, 1.0), 0.0)
        j, k, l = int(share.argmax()), int(torque.argmax()), int(effort.argmax())
        found = Effect()
        if share[j] > 100.0 * _TINY:
            found = replace(found, inertia_percent=float(share[j]), inertia_joint=names[j])
        if torque[k] > _TINY * np.abs(self.gravity_torques).max(initial=0.0):
            most, joint = float(effort[l]), names[l] if effort[l] > 0 else ""
            found = replace(
                found, torque=float(torque[k]), torque_joint=names[k], effort_percent=most, effort_joint=joint
            )
        return found

    @cached_property
    def diagonal(self) -> Array:
        """Diagonal of M (count, nv), including armature."""
        return self._totals[0] + self.model.armature

    @cached_property
    def gravity_torques(self) -> Array:
        """Gravity torques (count, nv), without springs."""
        return self._totals[1]

    @cached_property
    def _totals(self) -> tuple[Array, Array]:
        M, g = np.zeros((self.count, self.model.nv)), np.zeros((self.count, self.model.nv))
        columns, some, torques = self._sums({i: b.inertia.pseudo_inertia for i, b in enumerate(self.model.bodies)})
        M[:, columns], g[:, columns] = some, torques
        return M, g

    def _sums(self, inertias: Mapping[int, Array]) -> tuple[Array, Array, Array]:
        """Sums over bodies of tr([A] J [A]') and -g . ([A] J)_4, J in body frames: columns (k,), (count, k) each."""
        found: dict[int, tuple[Array, Array]] = {}
        zero = np.zeros(self.count)
        for i, inertia in inertias.items():
            T = self.poses[i]
            J = T @ inertia @ np.swapaxes(T, -1, -2)
            for column, A in self._twists(i):
                AJ = A @ J
                M, g = found.get(column, (zero, zero))
                found[column] = M + np.einsum("cij,cij->c", AJ, A), g - AJ[:, :3, 3] @ self.model.gravity
        columns = np.array(list(found), int)
        M, g = (np.reshape([pair[k] for pair in found.values()], (-1, self.count)).T for k in (0, 1))
        return columns, M, g

    def _twists(self, body: int) -> Iterator[tuple[int, Array]]:
        """Columns of the velocities that move a body, with the twist (count, 4, 4) of a unit velocity."""
        found: dict[int, Array] = {}
        for i in ancestors(self.model, body):
            if self._screws[i] is None:
                b, T = self.model.bodies[i], self.poses[i]
                back = se3.inverse(T)
                axes = enumerate(b.joint.axes, start=b.v_index)
                self._screws[i] = [(column, T @ se3.hat(b.ratio * axis) @ back) for column, axis in axes]
            for column, A in self._screws[i] or ():
                found[column] = found[column] + A if column in found else A
        yield from found.items()

    @cached_property
    def poses(self) -> list[Array]:
        """Poses (count, 4, 4) of the bodies in the base frame."""
        coordinates = [body.ratio * self.q[:, body.places[0]] + body.offset for body in self.model.bodies]
        poses = [
            se3.exp(q * body.joint.axes[0]) if body.joint.nq == 1 else np.stack([body.joint.pose(one) for one in q])
            for body, q in zip(self.model.bodies, coordinates, strict=True)
        ]
        return base_poses(
            self.model, [np.asarray(b.placement @ T) for b, T in zip(self.model.bodies, poses, strict=True)]
        )


complete(globals())
