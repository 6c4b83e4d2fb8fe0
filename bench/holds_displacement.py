"""Displacement of contacts beyond a margin, from the balance of the margin alone: how far rigid contacts move.

The base deviates from its motion by a twist u where no forces of the contacts balance the load b:

    M du/dt = G f - b, each f_i in its cone, and 0 at a contact above the floor

The deviation is small, so that M, G and b are those of the motion. Steps of the velocity with a Gauss-Seidel iteration over the
contacts: Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988; Jean, The non-smooth contact dynamics
method, 1999. No stiffness of contacts is in it, and nothing is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import twistwrench as tw
from bench.holds_scenes import FIRST, MOVED, Scene
from twistwrench import statics
from twistwrench.core.typing import Array

_FACTORS = 1.0 + np.geomspace(2e-4, 0.8, 40)
"""Factors of the speed, or of the load, whose displacements are computed together."""
_ROUNDS, _SETTLED = 60, 1e-9
"""Rounds of the iteration over contacts, and change of an impulse relative to the weight's that ends them."""
_EVERY = slice(None, None, 2)
"""Rows of the motion that are used."""
_AFTER = 0.05
"""Time after the motion [s], as in the simulation."""


@dataclass(frozen=True, eq=False)
class Loads:
    """What the contacts of m cases of a scene must balance at each row of its motion."""

    maps: Array
    """(n, 6, 3 c): columns of the contacts' forces."""
    whole: Array
    """(m, n, 6): load of the moving robot."""
    rest: Array
    """(m, n, 6): load at rest."""
    mobility: Array
    """(m, n, 6, 6): inverse inertia of the base with its joints driven."""
    step: Array
    """(m,): duration of a row [s]."""
    friction: float

    @classmethod
    def of(cls, scene: Scene, speeds: Array, masses: Array) -> Loads:
        """Loads of a scene at speeds (m,), with masses (m,) [kg] of its load, of which one kind varies."""
        bare = _terms(scene, scene.robot)
        heavier = bare
        if (masses > scene.payload).any():
            heavier = _terms(scene, scene.robot.with_payload(tw.SpatialInertia.from_com(1.0), "load"))
        more = np.nan_to_num(masses - scene.payload)  # the terms are linear in the mass
        whole, rest, inertia = (
            a + more.reshape(-1, *[1] * a.ndim) * (b - a) for a, b in zip(bare, heavier, strict=True)
        )
        maps, _ = statics.contacts.contact_maps(scene.robot, scene.q[_EVERY], scene.contacts)
        moving = rest + (speeds**2)[:, None, None] * (whole - rest)
        return cls(
            maps[:, :6].reshape(len(maps), 6, -1), moving, rest, np.linalg.inv(inertia), 1.0 / speeds / (len(maps) - 1),
            scene.contacts[0].friction,
        )  # fmt: skip

    def largest_displacements(self, starts: Array) -> Array:
        """Largest rise or slide (m,) of a contact [m]; at rows before ``starts`` (m,) forces balance."""
        m, n, _ = self.whole.shape
        size = self.maps.shape[-1]
        u, moved, impulses, largest = np.zeros((m, 6)), np.zeros((m, size)), np.zeros((m, size)), np.zeros(m)
        dt = self.step[:, None]
        weights = self.step * np.abs(self.rest[:, 0, 3:]).max(axis=1)
        for k in [*range(int(starts.min()), n), *[n - 1] * round(_AFTER / self.step.max())]:
            G, W = self.maps[k], self.mobility[:, k]
            free = u - dt * _times(W, self.whole[:, k] if k < n - 1 else self.rest[:, k])
            target = free @ G
            target[:, 2::3] += moved[:, 2::3] / dt
            impulses = _impulses(G.T @ W @ G, target, impulses, self.friction, weights)
            u = np.where((k >= starts)[:, None], free + _times(W, impulses @ G.T), 0.0)
            moved += dt * (u @ G)
            slide = np.hypot(moved[:, ::3], moved[:, 1::3])
            largest = np.maximum(largest, np.maximum(moved[:, 2::3], slide).max(axis=1))
        return largest


def _terms(scene: Scene, robot: tw.Robot) -> tuple[Array, Array, Array]:
    """Load and load at rest (n, 6) at speed 1, and inertia (n, 6, 6) of the base."""
    q, dq, ddq = scene.q[_EVERY], scene.dq[_EVERY], scene.ddq[_EVERY]
    b, rest = robot.inverse_dynamics(q, dq, ddq), robot.gravity_forces(q)
    return b[:, :6], rest[:, :6], np.asarray(robot.mass_matrix(q))[:, :6, :6]


def _times(A: Array, x: Array) -> Array:
    return np.asarray((A @ x[..., None])[..., 0])


def _impulses(D: Array, free: Array, start: Array, friction: float, weights: Array) -> Array:
    """Impulses (m, 3 c) of contacts on the floor that keep them from sinking and, within their cones, from sliding.

    Velocities are D f + free, of which the third of each contact has its gap divided by the step.
    """
    found = start.copy()
    places = [slice(k, k + 3) for k in range(0, D.shape[-1], 3)]
    inverses = [np.linalg.inv(D[:, s, s]) for s in places]
    steps = [1.0 / np.linalg.eigvalsh(D[:, s, s][:, :2, :2])[:, -1:] for s in places]
    for _ in range(_ROUNDS):
        before_all = found.copy()
        for s, inverse, step in zip(places, inverses, steps, strict=True):
            before, v = found[:, s].copy(), free[:, s] + _times(D[:, s], found)
            stuck = before - _times(inverse, v)
            sticks = (stuck[:, 2] >= 0) & (np.hypot(stuck[:, 0], stuck[:, 1]) <= friction * stuck[:, 2])
            found[:, s] = np.where(sticks[:, None], stuck, _sliding(before, v, D[:, s, s][:, 2, 2], step, friction))
        if (np.abs(found - before_all).max(axis=1) < _SETTLED * weights).all():
            break
    return found


def _sliding(before: Array, v: Array, normal: Array, step: Array, friction: float) -> Array:
    """Impulse (m, 3) of a contact that lifts, or slides against its velocity."""
    pressing = np.maximum(0.0, before[:, 2] - v[:, 2] / normal)
    along = before[:, :2] - step * v[:, :2]
    size, most = np.hypot(along[:, 0], along[:, 1]), friction * pressing
    share = np.divide(most, size, out=np.ones_like(size), where=size > most)
    return np.column_stack([along * share[:, None], pressing])


def expected(scene: Scene, speed: float, load: float, *, grows: str) -> dict[str, float]:
    """Factors of the speed or of the load at which a contact has moved by 0.2 mm and by 2 mm, from the balance alone."""
    still = np.ones_like(_FACTORS)
    margins = scene.support(speed)
    if grows == "speed":
        loads, fails = Loads.of(scene, speed * _FACTORS, load * still), margins.speed[_EVERY] < _FACTORS[:, None]
    else:
        loads = Loads.of(scene, speed * still, load * _FACTORS)
        fails = scene.payload + margins.payload[_EVERY] < load * _FACTORS[:, None]
    starts = np.where(fails.any(axis=1), fails.argmax(axis=1), fails.shape[1])
    moved = np.maximum.accumulate(loads.largest_displacements(starts))
    excess = [np.exp(np.interp(np.log(most), np.log(moved + 1e-12), np.log(_FACTORS - 1.0))) for most in (FIRST, MOVED)]
    return {"first expected": 1.0 + float(excess[0]), "seen expected": 1.0 + float(excess[1])}
