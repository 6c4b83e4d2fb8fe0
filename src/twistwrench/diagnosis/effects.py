"""The effect of other inertias on the dynamics: change of the diagonal of M and of gravity torques over configurations.

With the pseudo-inertia J of a body in the base frame and the twist [A] that a velocity gives it, both (4, 4),
M_jj = Σ tr([A] J [A]') and g_j = -Σ g . ([A] J)_4: linear in J, so that a change needs the changed bodies alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..lie import se3
from ..model.configuration import random_configuration
from ..model.model import BASE, Body, Model
from ..typing import Array
from .findings import Effect

CONFIGURATIONS = 200
"""Random configurations that effects are the largest over."""
_STEPS = 3_000_000
"""Bodies times configurations times depth that are walked; with more, there are fewer configurations."""
_TINY = 1e-9
"""Changes of this share are rounding."""


class Effects:
    """Effects on one model at seeded configurations."""

    def __init__(self, model: Model, seed: int = 0, count: int = CONFIGURATIONS) -> None:
        self.model = model
        depths: list[int] = []
        for body in model.bodies:
            depths.append(1 + (depths[body.parent] if body.parent != BASE else 0))
        self.count = int(np.clip(_STEPS // max(1, sum(depths)), 1, count))
        self.q = random_configuration(model, np.random.default_rng(seed), (self.count,))

    def of(self, changes: Mapping[str, SpatialInertia]) -> Effect:
        """The effect of links having other inertias, each about its link's origin: what they would be, not by how much."""
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
        """Of changes (count, k) in some columns."""
        if not len(columns):
            return Effect()
        names = [self.model.velocity_names[k] for k in columns]
        M, limit = self.diagonal[:, columns], self.model.limits.effort[columns]
        new = np.maximum(M + dM, _TINY * np.maximum(np.abs(M), np.abs(dM)) + 1e-300)
        share = 100.0 * (np.abs(dM) / new).max(axis=0)
        torque = np.abs(dg).max(axis=0)
        effort = np.where(np.isfinite(limit) & (limit > 0), 100.0 * torque / np.where(limit > 0, limit, 1.0), 0.0)
        j, k, l = int(share.argmax()), int(torque.argmax()), int(effort.argmax())
        loads = torque[k] > _TINY * self._largest_torque
        return Effect(
            float(share[j]) if share[j] > 100.0 * _TINY else 0.0,
            names[j] if share[j] > 100.0 * _TINY else "",
            float(torque[k]) if loads else 0.0,
            names[k] if loads else "",
            float(effort[l]) if loads else 0.0,
            names[l] if loads and effort[l] > 0 else "",
        )

    @cached_property
    def _largest_torque(self) -> float:
        return float(np.abs(self.gravity_torques).max(initial=0.0))

    @cached_property
    def diagonal(self) -> Array:
        """The diagonal of M with armature, (count, nv)."""
        return self._totals[0] + self.model.armature

    @cached_property
    def gravity_torques(self) -> Array:
        """(count, nv), without springs."""
        return self._totals[1]

    @cached_property
    def _totals(self) -> tuple[Array, Array]:
        M, g = np.zeros((self.count, self.model.nv)), np.zeros((self.count, self.model.nv))
        columns, some, torques = self._sums({i: b.inertia.pseudo_inertia for i, b in enumerate(self.model.bodies)})
        M[:, columns], g[:, columns] = some, torques
        return M, g

    def _sums(self, inertias: Mapping[int, Array]) -> tuple[Array, Array, Array]:
        """Σ over bodies of tr([A] J [A]') and -g . ([A] J)_4, J in the bodies' frames: columns (k,), and (count, k) of each."""
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
        """Of each velocity that moves a body: its column, and the twist (count, 4, 4) that a unit of it gives the body."""
        found: dict[int, Array] = {}
        at = body
        while at != BASE:
            for column, A in self._screws(at):
                found[column] = found[column] + A if column in found else A
            at = self.model.bodies[at].parent
        yield from found.items()

    def _screws(self, body: int) -> list[tuple[int, Array]]:
        if body not in self._known:
            b, T = self.model.bodies[body], self.poses[body]
            back = se3.inverse(T)
            self._known[body] = [
                (b.v_index + k, T @ se3.hat(b.ratio * axis) @ back) for k, axis in enumerate(b.joint.axes)
            ]
        return self._known[body]

    @cached_property
    def _known(self) -> dict[int, list[tuple[int, Array]]]:
        return {}

    @cached_property
    def poses(self) -> list[Array]:
        """Of each body in the base frame, (count, 4, 4)."""
        found: list[Array] = []
        for body in self.model.bodies:
            T = np.asarray(body.placement @ self._joint_poses(body))
            found.append(T if body.parent == BASE else found[body.parent] @ T)
        return found

    def _joint_poses(self, body: Body) -> Array:
        joint = body.joint
        q = body.ratio * self.q[:, body.places[0]] + body.offset
        if joint.nq == 1:
            return np.asarray(se3.exp(q * joint.axes[0]))
        return np.stack([joint.pose(one) for one in q])
