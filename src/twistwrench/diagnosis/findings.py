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
from ..mechanics.model.configurations import random_configuration
from ..mechanics.model.model import BASE, Model


class Severity(StrEnum):
    """Severity of a finding of the doctor."""

    ERROR = "error"
    """The part is physically impossible or cannot be read."""
    WARNING = "warning"
    """Very probably an error that changes results."""
    NOTE = "note"


_MAX_STATED_PERCENT = 1e8
"""Percentage from which a repair leaves a joint with almost no inertia, so that the figure is not stated."""


@dataclass(frozen=True)
class Effect:
    """Effect of a finding: the largest changes between file and repair over random configurations.

    Attributes
    ----------
    inertia_percent : float, change of a diagonal entry of the mass matrix, in percent of the repaired robot's
    inertia_joint : str, joint of that entry; empty without a change
    torque : float, change of a gravity torque or force [N m or N]
    torque_joint : str, joint of that torque; empty without a change
    effort_percent : float, change of a gravity torque in percent of the effort limit; 0 without a limit
    effort_joint : str, joint of that limit; empty without one

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
        changes = []
        if self.inertia_joint:
            extent = f"by {_percent_text(self.inertia_percent)}"
            if self.inertia_percent >= _MAX_STATED_PERCENT:
                extent = "to next to nothing"
            changes.append(f"M of {self.inertia_joint} {extent}")
        if self.torque_joint:
            torque_change = f"g of {self.torque_joint} by {number(self.torque, 3)}"
            if self.effort_joint:
                torque_change += f", {_percent_text(self.effort_percent)} of the effort of {self.effort_joint}"
            changes.append(torque_change)
        return "; ".join(changes) or "none"

    def reaches(self, percent: float, effort: float = 1.0) -> bool:
        """True if an entry of M or a gravity torque changes by at least the given percentage.

        Parameters
        ----------
        percent : float, percentage of the entry of M
        effort : float, percentage of the effort limit

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
    sentence : str, reason
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
        place = self.where
        line = line_text(self)
        if line:
            place += f" ({line})"
        return f"{self.severity}: {place}: {self.sentence}"


def line_text(finding: Finding) -> str:
    """``line 7`` of a finding, after the name of its file if that is an included one; empty if the line is unknown."""
    if not finding.line:
        return ""
    line = f"line {finding.line}"
    return f"{finding.file}, {line}" if finding.file else line


def _percent_text(percent: float) -> str:
    """Percentage, or the factor from 10,000 % on."""
    if percent < 1e4:
        return f"{number(percent, 3)} %"
    return f"a factor of {number(percent / 100.0, 2)}"


# ── Effects over random configurations

CONFIGURATIONS = 200
"""Number of random configurations for the largest effect."""
_MAX_POSE_STEPS = 3_000_000
"""Largest product of configurations and the sum of all bodies' depths; above it, fewer configurations are used."""
_MAX_ROUNDING_ERROR = 1e-9
"""Relative change up to which it is a rounding error."""


class Effects:
    """Effects on one model at random configurations with a fixed seed."""

    def __init__(self, model: Model, seed: int = 0, count: int = CONFIGURATIONS) -> None:
        self.model = model
        depths = {BASE: 0}
        for i, body in enumerate(model.bodies):
            depths[i] = 1 + depths[body.parent]
        max_count = _MAX_POSE_STEPS // max(1, sum(depths.values()))
        self.count = int(np.clip(max_count, 1, count))
        """Number of configurations."""
        self.q = random_configuration(model, np.random.default_rng(seed), (self.count,))
        self._screws_of: dict[int, list[tuple[int, Array]]] = {}
        """Result of :meth:`_screws` by body."""

    def evaluate(self, changes: Mapping[str, SpatialInertia]) -> Effect:
        """Effect of changed inertias of links, each about its link's origin."""
        pseudo_inertia_changes: dict[int, Array] = {}
        for link, inertia in changes.items():
            frame = self.model.frames[link]
            if frame.body == BASE:
                continue
            change_in_link = inertia - self.model.link_inertias[link]
            change = change_in_link.in_frame(frame.pose)  # in the body's frame
            earlier_change = pseudo_inertia_changes.get(frame.body, 0.0)
            pseudo_inertia_changes[frame.body] = earlier_change + change.pseudo_inertia
        if not pseudo_inertia_changes:
            return Effect()
        velocities, dM, dg = self._sums(pseudo_inertia_changes)
        return self._largest(velocities, dM, dg)

    def _largest(self, velocities: Array, dM: Array, dg: Array) -> Effect:
        """Largest effect of changes dM and dg (count, k) at the velocities with the indices ``velocities`` (k,)."""
        if not len(velocities):
            return Effect()
        names = [self.model.velocity_names[k] for k in velocities]
        effect = Effect()
        M = self.diagonal[:, velocities]
        # above rounding errors, as a repair may leave almost no inertia; and above zero, as a divisor
        rounding_errors = _MAX_ROUNDING_ERROR * np.maximum(np.abs(M), np.abs(dM)) + 1e-300
        repaired_M = np.maximum(M + dM, rounding_errors)
        inertia_percents = 100.0 * (np.abs(dM) / repaired_M).max(axis=0)
        largest_inertia_index = int(inertia_percents.argmax())
        max_percent = float(inertia_percents[largest_inertia_index])
        if max_percent > 100.0 * _MAX_ROUNDING_ERROR:
            effect = replace(effect, inertia_percent=max_percent, inertia_joint=names[largest_inertia_index])
        torques = np.abs(dg).max(axis=0)
        largest_torque_index = int(torques.argmax())
        max_torque = float(torques[largest_torque_index])
        largest_gravity_torque = np.abs(self.gravity_torques).max(initial=0.0)
        if max_torque > _MAX_ROUNDING_ERROR * largest_gravity_torque:
            effect = replace(effect, torque=max_torque, torque_joint=names[largest_torque_index])
            effort_percents = self._effort_percents(torques, velocities)
            largest_effort_index = int(effort_percents.argmax())
            max_effort_percent = float(effort_percents[largest_effort_index])
            if max_effort_percent > 0:
                effect = replace(effect, effort_percent=max_effort_percent, effort_joint=names[largest_effort_index])
        return effect

    def _effort_percents(self, torques: Array, velocities: Array) -> Array:
        """Torques (k,) in percent of the effort limits of the velocities with the given indices (k,); 0 without a limit."""
        efforts = self.model.limits.effort[velocities]
        is_limited = np.isfinite(efforts) & (efforts > 0)
        percents = np.zeros(len(velocities))
        percents[is_limited] = 100.0 * torques[is_limited] / efforts[is_limited]
        return percents

    @cached_property
    def diagonal(self) -> Array:
        """Diagonal of M (count, nv), including armature."""
        diagonal_of_bodies, _ = self._totals
        return diagonal_of_bodies + self.model.armature

    @cached_property
    def gravity_torques(self) -> Array:
        """Gravity torques (count, nv), without springs."""
        _, gravity_torques = self._totals
        return gravity_torques

    @cached_property
    def _totals(self) -> tuple[Array, Array]:
        """Diagonal of M without armature, and gravity torques, of all bodies; (count, nv) each."""
        diagonal = np.zeros((self.count, self.model.nv))
        gravity_torques = np.zeros((self.count, self.model.nv))
        inertias = {i: body.inertia.pseudo_inertia for i, body in enumerate(self.model.bodies)}
        velocities, M, g = self._sums(inertias)
        diagonal[:, velocities] = M
        gravity_torques[:, velocities] = g
        return diagonal, gravity_torques

    def _sums(self, inertias: Mapping[int, Array]) -> tuple[Array, Array, Array]:
        """Indices (k,) of velocities, and sums over bodies of tr([A] J [A]') and -g . ([A] J)_4, (count, k) each.

        ``inertias`` are pseudo-inertias J by body, in the frames of the bodies.
        """
        M: dict[int, Array] = {}  # by velocity
        g: dict[int, Array] = {}
        for i, inertia in inertias.items():
            T = self.poses[i]
            J = T @ inertia @ np.swapaxes(T, -1, -2)
            for k, A in self._twists(i):
                AJ = A @ J
                M[k] = M.get(k, 0.0) + np.einsum("cij,cij->c", AJ, A)
                g[k] = g.get(k, 0.0) - AJ[:, :3, 3] @ self.model.gravity
        shape = (-1, self.count)  # also without any velocity
        velocities = np.array(list(M), int)
        diagonal = np.reshape([*M.values()], shape).T
        gravity_torques = np.reshape([*g.values()], shape).T
        return velocities, diagonal, gravity_torques

    def _twists(self, body: int) -> Iterator[tuple[int, Array]]:
        """Index of each velocity that moves a body, with the twist (count, 4, 4) of the body at unit velocity."""
        twists: dict[int, Array] = {}
        for i in ancestors(self.model, body):
            for k, A in self._screws(i):
                twists[k] = twists.get(k, 0.0) + A  # mimic joints share a velocity
        yield from twists.items()

    def _screws(self, body: int) -> list[tuple[int, Array]]:
        """Index of each velocity of a body's joint, with the screw axis (count, 4, 4) in the base frame; cached."""
        if body not in self._screws_of:
            b = self.model.bodies[body]
            T = self.poses[body]
            T_inverse = se3.inverse(T)
            axes_by_velocity = enumerate(b.joint.axes, start=b.v_index)
            screws = [(k, T @ se3.hat(b.ratio * axis) @ T_inverse) for k, axis in axes_by_velocity]
            self._screws_of[body] = screws
        return self._screws_of[body]

    @cached_property
    def poses(self) -> list[Array]:
        """Poses (count, 4, 4) of the bodies in the base frame."""
        joint_poses = []
        for body in self.model.bodies:
            coordinate_slice, _ = body.places
            coordinates = body.ratio * self.q[:, coordinate_slice] + body.offset
            if body.joint.nq == 1:
                T = se3.exp(coordinates * body.joint.axes[0])
            else:
                T = np.stack([body.joint.pose(q) for q in coordinates])
            joint_poses.append(np.asarray(body.placement @ T))
        return base_poses(self.model, joint_poses)


complete(globals())
