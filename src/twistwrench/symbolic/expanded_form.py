"""Lagrange's equations written out: kinematics, and energies as sums of products.

Kinematics works with any arithmetic: sums of products in :mod:`.trig_polynomial`, SymPy expressions, floats.

The recursive algorithms are not used. Positions come from the joints' placements and axes, and velocities are their
derivatives. K = Σ ½ m v'v + ½ ω'I ω, and the rest is differentiation. Modern Robotics section 8.1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ..core.typing import Array
from ..mechanics.joints.joint import CosineSine, exact, exact_rodrigues
from ..mechanics.model.model import BASE, Body, Model
from .coordinates import Coordinate, Variable, variable_names
from .names import names_of
from .parameters import BodyEntries, Entries, Entry, ModelEntries
from .trig_polynomial import Ring, TrigPolynomial


class Arithmetic(Protocol):
    """Interface of the numbers used in kinematics."""

    def number(self, entry: Entry) -> Any:
        """Number of the model, or its symbol."""

    def coordinate(self, k: int) -> Any:
        """Coordinate number k."""

    def cosine_sine(self, k: int, rate: float, offset: float) -> tuple[Any, Any]:
        """Cosine and sine of ``rate`` times coordinate k plus ``offset``."""


def numbers_of(arithmetic: Arithmetic, entries: Any) -> Array:
    """Array of entries in this arithmetic."""
    return np.asarray(np.frompyfunc(arithmetic.number, 1, 1)(np.array(entries, object)))


def joint_motion(arithmetic: Arithmetic, body: Body, entries: BodyEntries) -> tuple[Array, Array]:
    """Pose of a body's frame in its parent's frame, R (3, 3) and p (3,); MR eq. 3.51 and 3.88."""
    R0, p0 = exact(body.placement[:3, :3]), numbers_of(arithmetic, entries.place)
    joint, first = body.joint, body.v_index
    if not joint.moves_body:
        R, p = exact(np.eye(3)), numbers_of(arithmetic, (Entry(0.0),) * 3)
    elif joint.nv == 1:
        R, p = _screw(arithmetic, body, entries)
    else:
        R, p = joint.chart_pose(chart_waves(arithmetic, body), lambda k: arithmetic.coordinate(first + k))
    return R0 @ R, p0 + R0 @ p


def chart_waves(arithmetic: Arithmetic, body: Body) -> CosineSine:
    """Cosines and sines of the entries of a joint's chart."""
    return lambda k: arithmetic.cosine_sine(body.v_index + k, 1.0, 0.0)


def _screw(arithmetic: Arithmetic, body: Body, entries: BodyEntries) -> tuple[Array, Array]:
    w, v = body.joint.axes[0, :3], body.joint.axes[0, 3:]
    k, rate = body.v_index, float(np.linalg.norm(w))
    if abs(rate - 1.0) < 1e-15:
        rate = 1.0
    x = exact(body.ratio) * arithmetic.coordinate(k) + exact(body.offset)
    if rate == 0.0:
        return exact(np.eye(3)), exact(v) * x
    w = w / rate
    R = exact_rodrigues(w, *arithmetic.cosine_sine(k, rate * body.ratio, rate * body.offset))
    point, pitch = numbers_of(arithmetic, entries.point), arithmetic.number(entries.pitch)
    return R, point - R @ point + exact(w) * (pitch * (exact(rate) * x))


_DUST = 1e-14
"""Terms below this share of an energy's largest coefficient are rounding errors of cancelled terms."""


@dataclass(frozen=True, eq=False)
class SymbolicMotion:
    """Positions and velocities of the centres of mass in the base frame, and angular velocities in body axes; (3,) each."""

    positions: tuple[Array, ...]
    velocities: tuple[Array, ...]
    turning: tuple[Array, ...]

    def products(self, inertias: Iterable[tuple[Entries, ...]]) -> int:
        """Number of products of two terms in the kinetic energy."""
        count = 0
        for v, w, I in zip(self.velocities, self.turning, inertias, strict=True):
            for component in v:
                count += len(component) ** 2
            for a, b in np.ndindex(3, 3):
                if I[a][b].value:
                    count += len(w[a]) * len(w[b])
        return count


class RingArithmetic:
    """Kinematics over sums of products."""

    def __init__(self, ring: Ring, coordinates: tuple[Coordinate, ...]) -> None:
        self.ring, self.coordinates = ring, coordinates
        self._places = {name: k for k, name in enumerate(ring.angles)}

    def number(self, entry: Entry) -> TrigPolynomial:
        """Number of the model, or its symbol."""
        if entry.parameter is None:
            return self.ring.number(entry.value)
        return entry.sign * self.ring.symbol(entry.parameter.name)

    def coordinate(self, k: int) -> TrigPolynomial:
        """Coordinate number k."""
        return self.ring.symbol(self.coordinates[k].name)

    def cosine_sine(self, k: int, rate: float, offset: float) -> tuple[TrigPolynomial, TrigPolynomial]:
        """Cosine and sine of ``rate`` times coordinate k plus ``offset``."""
        multiples: list[Any] = [0] * len(self._places)
        multiple: Any = Fraction(rate)  # a float is a fraction, so sums of multiples are exact
        if multiple.denominator == 1:
            multiple = int(multiple)
        multiples[self._places[self.coordinates[k].name]] = multiple
        c, s = self.ring.wave("cos", multiples), self.ring.wave("sin", multiples)
        if not offset:
            return c, s
        c0, s0 = _without_round_off(np.cos(offset)), _without_round_off(np.sin(offset))
        return c * c0 - s * s0, s * c0 + c * s0


def _without_round_off(x: float) -> float:
    """Nearest integer if a cosine or sine equals it but for rounding, else the number itself."""
    return round(x) if abs(x - round(x)) < 1e-15 else x


def ring_of(entries: ModelEntries, coordinates: tuple[Coordinate, ...]) -> Ring:
    """Ring of a robot: its parameters, coordinates and rates."""
    names = names_of(entries.parameters)
    for c in coordinates:
        names += [c.name, c.rate, c.acceleration]
    return Ring(names, [c.name for c in coordinates if c.angle])


def motion_of(
    model: Model,
    entries: ModelEntries,
    coordinates: tuple[Coordinate, ...],
    ring: Ring,
    largest_position: int,
    largest_rotation: int,
) -> SymbolicMotion | None:
    """Positions and velocities of all bodies; None if an entry has more terms than allowed."""
    arithmetic = RingArithmetic(ring, coordinates)
    poses: list[tuple[Array, Array]] = []
    positions, velocities, turning = [], [], []

    def rates_of(array: Array) -> Array:
        return np.asarray(np.frompyfunc(lambda x: _rate(x, coordinates, ring), 1, 1)(array))

    zero = ring.number(0.0)
    for body, numbers in zip(model.bodies, entries.bodies, strict=True):
        R, p = joint_motion(arithmetic, body, numbers)
        if body.parent != BASE:
            R_p, p_p = poses[body.parent]
            R, p = R_p @ R, p_p + R_p @ p
        poses.append((R, p))
        centre = p + R @ numbers_of(arithmetic, numbers.com)
        if _terms(centre, ring) > largest_position or _terms(R.flat, ring) > largest_rotation:
            return None
        R = _sums(R, zero)
        spin = [zero] * 3
        if not body.joint.moves_body:  # rotates a frame of the same body
            rate = ring.symbol(coordinates[body.v_index].rate)
            for axis, component in enumerate(body.joint.axes[0, :3]):
                spin[axis] = float(component) * arithmetic.number(numbers.ratio) * rate
        W = rates_of(R)
        if W.any():
            W = R.T @ W  # [ω_b] = R'Ṙ, MR eq. 3.33
        omega = np.array([W[2, 1], W[0, 2], W[1, 0]], object) + np.array(spin, object)
        positions.append(_sums(centre, zero))
        velocities.append(rates_of(positions[-1]))
        turning.append(np.array([x.without_dust(_DUST) for x in omega], object))
    return SymbolicMotion(tuple(positions), tuple(velocities), tuple(turning))


def _sums(array: Array, zero: TrigPolynomial) -> Array:
    """Entries as sums of the ring, numbers too."""
    return np.asarray(np.frompyfunc(lambda x: zero + x, 1, 1)(array))


def _terms(entries: Iterable[Any], ring: Ring) -> int:
    return max(len(ring.number(0.0) + x) for x in entries)


def _rate(x: TrigPolynomial, coordinates: tuple[Coordinate, ...], ring: Ring) -> TrigPolynomial:
    total = ring.number(0.0)
    for c in coordinates:
        total = total + x.diff(c.name) * ring.symbol(c.rate)
    return total


def spring_energies(model: Model, entries: ModelEntries, arithmetic: RingArithmetic) -> list[TrigPolynomial]:
    """½ k (Σ weight · coordinate - rest)² of each spring."""
    v_index = {body.joint.name: body.v_index for body in model.leaders}
    energies = []
    for spring, k in zip(model.springs, entries.springs, strict=True):
        stretch = arithmetic.ring.number(-spring.rest)
        for joint, weight in spring.terms:
            stretch = stretch + arithmetic.coordinate(v_index[joint]) * weight
        energies.append(arithmetic.number(k) * stretch * stretch * 0.5)
    return energies


def drive_energies(entries: ModelEntries, arithmetic: RingArithmetic) -> list[TrigPolynomial]:
    """½ J q̇² of each drive with its own inertia."""
    energies = []
    for k, J in enumerate(entries.armature):
        if J.value:
            rate = arithmetic.ring.symbol(arithmetic.coordinates[k].rate)
            energies.append(arithmetic.number(J) * rate * rate * 0.5)
    return energies


def energies(
    entries: ModelEntries, motion: SymbolicMotion, arithmetic: RingArithmetic
) -> tuple[list[TrigPolynomial], list[TrigPolynomial]]:
    """K and P of every body by the formulas of MR section 8.1.2."""
    gravity = numbers_of(arithmetic, entries.gravity)
    kinetic, potential = [], []
    for body, p, v, w in zip(entries.bodies, motion.positions, motion.velocities, motion.turning, strict=True):
        m, I = arithmetic.number(body.mass), numbers_of(arithmetic, body.inertia)
        K = (m * (v @ v) + w @ (I @ w)) * 0.5
        kinetic.append(K.without_dust(_DUST))
        potential.append((-1.0 * m * (gravity @ p)).without_dust(_DUST))
    return kinetic, potential


def chain_angles(model: Model, ring: Ring, coordinates: tuple[Coordinate, ...]) -> Array:
    """(n, n) integers: row j is the sum of joint angles that rotates body j if the preceding axes are parallel."""
    sums = np.eye(len(ring.angles), dtype=int)
    for body in model.bodies:
        if body.follows or body.joint.nv > 1 or not coordinates[body.v_index].angle or body.parent == BASE:
            continue
        parent = model.bodies[body.parent]
        if parent.follows or parent.joint.nv > 1 or not parent.joint.axes[0, :3].any():
            continue
        cosine = float((body.placement[:3, :3] @ body.joint.axes[0, :3]) @ parent.joint.axes[0, :3])
        if abs(abs(cosine) - 1.0) < 1e-12:
            j = ring.angles.index(coordinates[body.v_index].name)
            i = ring.angles.index(coordinates[parent.v_index].name)
            sums[j] += int(np.sign(cosine)) * sums[i]
    return sums


@dataclass(frozen=True, eq=False)
class Terms:
    """Derivatives of K and P that make up the equations."""

    ring: Ring
    coordinates: tuple[Coordinate | Variable, ...]
    kinetic: TrigPolynomial
    potential: TrigPolynomial

    @property
    def zero(self) -> TrigPolynomial:
        """Zero of the ring."""
        return self.ring.number(0)

    @cached_property
    def mass_matrix(self) -> Array:
        """M_ij = ∂²L/∂q̇_i∂q̇_j."""
        n = len(self.coordinates)
        M = np.empty((n, n), object)
        L = self.kinetic - self.potential
        for i, c in enumerate(self.coordinates):
            momentum = L.diff(c.rate)
            for j, other in enumerate(self.coordinates):
                M[i, j] = momentum.diff(other.rate)
        return M

    @cached_property
    def christoffel(self) -> Array:
        """Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j - ∂M_jk/∂q_i); MR section 8.1.2."""
        n = len(self.coordinates)
        M: Any = self.mass_matrix
        dM = np.empty((n, n, n), object)
        for i, j, k in np.ndindex(n, n, n):
            if i <= j:
                dM[i, j, k] = dM[j, i, k] = M[i, j].diff(self.coordinates[k].name)
        gamma = np.empty((n, n, n), object)
        for i, j, k in np.ndindex(n, n, n):
            if j <= k:
                gamma[i, j, k] = gamma[i, k, j] = 0.5 * (dM[i, j, k] + dM[i, k, j] - dM[j, k, i])
        return gamma

    @cached_property
    def gravity_forces(self) -> Array:
        """g_i = ∂P/∂q_i; for energies without rates, also of L."""
        names, rates, _ = variable_names(self.coordinates)
        by_motion = (self.kinetic - self.potential).split(rates)
        still = by_motion.get(0, self.zero)
        return np.array([-still.diff(name) for name in names], object)
