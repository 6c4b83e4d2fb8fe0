"""Lagrange's equations written out: kinematics, and energies as sums of products.

The functions for kinematics work with any arithmetic: sums of products in :mod:`.trig_polynomial`, SymPy expressions, floats.

The recursive algorithms are not used. Positions follow from the joints' placements and axes, and velocities are derivatives of
positions. The kinetic energy is K = Σ ½ m v'v + ½ ω'I ω; the equations are derivatives of energies, as in Modern Robotics
section 8.1.
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
    number_of_each = np.frompyfunc(arithmetic.number, 1, 1)
    return np.asarray(number_of_each(np.array(entries, object)))


def joint_motion(arithmetic: Arithmetic, body: Body, entries: BodyEntries) -> tuple[Array, Array]:
    """Pose of a body's frame in its parent's frame, R (3, 3) and p (3,); MR eq. 3.51 and 3.88."""
    R_placement = exact(body.placement[:3, :3])
    p_placement = numbers_of(arithmetic, entries.place)
    joint = body.joint
    first_coordinate = body.v_index
    if not joint.moves_body:
        no_motion = (Entry(0.0),) * 3
        R = exact(np.eye(3))
        p = numbers_of(arithmetic, no_motion)
    elif joint.nv == 1:
        R, p = _screw_motion(arithmetic, body, entries)
    else:
        waves = chart_waves(arithmetic, body)
        R, p = joint.chart_pose(waves, lambda k: arithmetic.coordinate(first_coordinate + k))
    return R_placement @ R, p_placement + R_placement @ p


def chart_waves(arithmetic: Arithmetic, body: Body) -> CosineSine:
    """Function that returns cosine and sine of an entry of a joint's chart."""
    return lambda k: arithmetic.cosine_sine(body.v_index + k, rate=1.0, offset=0.0)


def _screw_motion(arithmetic: Arithmetic, body: Body, entries: BodyEntries) -> tuple[Array, Array]:
    """R (3, 3) and p (3,) of a joint of one degree of freedom, from the point of its axis and its pitch."""
    w, v = body.joint.axes[0, :3], body.joint.axes[0, 3:]
    k = body.v_index
    rate = float(np.linalg.norm(w))  # angle for a unit of the coordinate
    if abs(rate - 1.0) < _MAX_ROUNDING:
        rate = 1.0
    x = exact(body.ratio) * arithmetic.coordinate(k) + exact(body.offset)  # coordinate of this joint
    if rate == 0.0:
        return exact(np.eye(3)), exact(v) * x
    w = w / rate
    cosine, sine = arithmetic.cosine_sine(k, rate * body.ratio, rate * body.offset)
    R = exact_rodrigues(w, cosine, sine)
    point = numbers_of(arithmetic, entries.point)
    pitch = arithmetic.number(entries.pitch)
    distance = pitch * (exact(rate) * x)
    return R, point - R @ point + exact(w) * distance


_MAX_ROUNDING = 1e-15
"""Rounding error of a number near 1 or 0."""
_ROUNDING_SHARE = 1e-14
"""Share of an energy's largest coefficient below which terms are rounding errors of cancelled terms."""
_MAX_MISALIGNMENT = 1e-12
"""Largest difference of a cosine from ±1 at which axes count as parallel."""


@dataclass(frozen=True, eq=False)
class SymbolicMotion:
    """Motion of all bodies as sums of products; each array is (3,)."""

    positions: tuple[Array, ...]
    """Positions of the centres of mass in the base frame."""
    velocities: tuple[Array, ...]
    """Velocities of the centres of mass in the base frame."""
    turning: tuple[Array, ...]
    """Angular velocities of the bodies in their own axes [rad/s]."""

    def products(self, inertias: Iterable[tuple[Entries, ...]]) -> int:
        """Number of products of two terms in the kinetic energy; ``inertias`` are the tensors (3, 3) of the bodies."""
        product_count = 0
        for v, w, I in zip(self.velocities, self.turning, inertias, strict=True):
            for component in v:
                product_count += len(component) ** 2
            for row, column in np.ndindex(3, 3):
                if I[row][column].value:
                    product_count += len(w[row]) * len(w[column])
        return product_count


class RingArithmetic:
    """Kinematics over sums of products."""

    def __init__(self, ring: Ring, coordinates: tuple[Coordinate, ...]) -> None:
        self.ring, self.coordinates = ring, coordinates
        self._angle_indices = {name: k for k, name in enumerate(ring.angles)}

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
        multiple: Any = Fraction(rate)  # a float is a fraction, so sums of multiples are exact
        if multiple.denominator == 1:
            multiple = int(multiple)
        multiples: list[Any] = [0] * len(self._angle_indices)
        angle_index = self._angle_indices[self.coordinates[k].name]
        multiples[angle_index] = multiple
        c = self.ring.wave("cos", multiples)
        s = self.ring.wave("sin", multiples)
        if not offset:
            return c, s
        c_offset = _without_round_off(np.cos(offset))
        s_offset = _without_round_off(np.sin(offset))
        return c * c_offset - s * s_offset, s * c_offset + c * s_offset


def _without_round_off(x: float) -> float:
    """Nearest integer if a cosine or sine equals it up to rounding, otherwise the number itself."""
    nearest_integer = round(x)
    return nearest_integer if abs(x - nearest_integer) < _MAX_ROUNDING else x


def ring_of(entries: ModelEntries, coordinates: tuple[Coordinate, ...]) -> Ring:
    """Ring of a robot: its parameters, coordinates and rates."""
    names = names_of(entries.parameters)
    for coordinate in coordinates:
        names += [coordinate.name, coordinate.rate, coordinate.acceleration]
    angles = [coordinate.name for coordinate in coordinates if coordinate.angle]
    return Ring(names, angles)


def motion_of(
    model: Model,
    entries: ModelEntries,
    coordinates: tuple[Coordinate, ...],
    ring: Ring,
    max_position_terms: int,
    max_rotation_terms: int,
) -> SymbolicMotion | None:
    """Positions and velocities of all bodies; None if an entry has more terms than allowed."""
    arithmetic = RingArithmetic(ring, coordinates)
    poses: list[tuple[Array, Array]] = []
    positions, velocities, angular_velocities = [], [], []

    def rates_of(array: Array) -> Array:
        """Derivatives of the entries with respect to time."""
        rate_of_each = np.frompyfunc(lambda x: _rate(x, coordinates, ring), 1, 1)
        return np.asarray(rate_of_each(array))

    zero = ring.number(0.0)
    for body, body_entries in zip(model.bodies, entries.bodies, strict=True):
        R, p = joint_motion(arithmetic, body, body_entries)
        if body.parent != BASE:
            R_parent, p_parent = poses[body.parent]
            R, p = R_parent @ R, p_parent + R_parent @ p
        poses.append((R, p))
        centre = p + R @ numbers_of(arithmetic, body_entries.com)
        if _max_terms(centre, ring) > max_position_terms:
            return None
        if _max_terms(R.flat, ring) > max_rotation_terms:
            return None
        R = _sums(R, zero)
        rotor_velocity = [zero] * 3
        if not body.joint.moves_body:  # a rotor rotates, but its frame does not
            rate = ring.symbol(coordinates[body.v_index].rate)
            for axis, component in enumerate(body.joint.axes[0, :3]):
                rotor_velocity[axis] = float(component) * arithmetic.number(body_entries.ratio) * rate
        W = rates_of(R)
        if W.any():  # the body rotates
            W = R.T @ W  # [ω_b] = R'Ṙ, MR eq. 3.33
        omega_of_frame = np.array([W[2, 1], W[0, 2], W[1, 0]], object)
        omega = omega_of_frame + np.array(rotor_velocity, object)
        position = _sums(centre, zero)
        positions.append(position)
        velocities.append(rates_of(position))
        components = [component.without_dust(_ROUNDING_SHARE) for component in omega]
        angular_velocities.append(np.array(components, object))
    return SymbolicMotion(tuple(positions), tuple(velocities), tuple(angular_velocities))


def _sums(array: Array, zero: TrigPolynomial) -> Array:
    """Entries as sums of the ring; an entry that is a number becomes a constant sum."""
    sum_of_each = np.frompyfunc(lambda x: zero + x, 1, 1)
    return np.asarray(sum_of_each(array))


def _max_terms(entries: Iterable[Any], ring: Ring) -> int:
    """Number of terms of the longest entry."""
    zero = ring.number(0.0)  # makes a sum of an entry that is a number
    return max(len(zero + entry) for entry in entries)


def _rate(x: TrigPolynomial, coordinates: tuple[Coordinate, ...], ring: Ring) -> TrigPolynomial:
    """dx/dt = Σ ∂x/∂q_j q̇_j."""
    total = ring.number(0.0)
    for coordinate in coordinates:
        total = total + x.diff(coordinate.name) * ring.symbol(coordinate.rate)
    return total


def spring_energies(model: Model, entries: ModelEntries, arithmetic: RingArithmetic) -> list[TrigPolynomial]:
    """Energies ½ k (Σ weight · coordinate - rest)² of the springs."""
    v_index = {body.joint.name: body.v_index for body in model.leaders}
    energies = []
    for spring, stiffness in zip(model.springs, entries.springs, strict=True):
        stretch = arithmetic.ring.number(-spring.rest)
        for joint, weight in spring.terms:
            stretch = stretch + arithmetic.coordinate(v_index[joint]) * weight
        energies.append(arithmetic.number(stiffness) * stretch * stretch * 0.5)
    return energies


def drive_energies(entries: ModelEntries, arithmetic: RingArithmetic) -> list[TrigPolynomial]:
    """Energies ½ J q̇² of the drives that have an inertia of their own."""
    energies = []
    for k, J in enumerate(entries.armature):
        if J.value:
            rate = arithmetic.ring.symbol(arithmetic.coordinates[k].rate)
            energies.append(arithmetic.number(J) * rate * rate * 0.5)
    return energies


def energies(
    entries: ModelEntries, motion: SymbolicMotion, arithmetic: RingArithmetic
) -> tuple[list[TrigPolynomial], list[TrigPolynomial]]:
    """Kinetic energies K and potential energies P of the bodies, by the formulas of MR section 8.1.2."""
    gravity = numbers_of(arithmetic, entries.gravity)
    kinetic, potential = [], []
    for body, p, v, w in zip(entries.bodies, motion.positions, motion.velocities, motion.turning, strict=True):
        m = arithmetic.number(body.mass)
        I = numbers_of(arithmetic, body.inertia)
        K = (m * (v @ v) + w @ (I @ w)) * 0.5
        P = -1.0 * m * (gravity @ p)
        kinetic.append(K.without_dust(_ROUNDING_SHARE))
        potential.append(P.without_dust(_ROUNDING_SHARE))
    return kinetic, potential


def chain_angles(model: Model, ring: Ring, coordinates: tuple[Coordinate, ...]) -> Array:
    """Coefficients (n, n) of sums of angles: row j is θ_j ± θ_i ± … along the chain of parallel axes that ends with joint j."""
    sums = np.eye(len(ring.angles), dtype=int)
    for body in model.bodies:
        if body.parent == BASE or not _has_own_angle(body):
            continue
        parent = model.bodies[body.parent]
        if not _has_own_angle(parent):
            continue
        axis_in_parent = body.placement[:3, :3] @ body.joint.axes[0, :3]
        cosine = float(axis_in_parent @ parent.joint.axes[0, :3])
        is_parallel_or_opposite = abs(abs(cosine) - 1.0) < _MAX_MISALIGNMENT
        if is_parallel_or_opposite:
            j = ring.angles.index(coordinates[body.v_index].name)
            i = ring.angles.index(coordinates[parent.v_index].name)
            sums[j] += int(np.sign(cosine)) * sums[i]
    return sums


def _has_own_angle(body: Body) -> bool:
    """True if a body's joint has one coordinate, which is an angle and not the coordinate of another joint."""
    return not body.follows and body.joint.nv == 1 and bool(body.joint.axes[0, :3].any())


@dataclass(frozen=True, eq=False)
class Terms:
    """Energies K and P as sums of products, and their derivatives, of which the equations consist."""

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
        for i, row in enumerate(self.coordinates):
            momentum = L.diff(row.rate)
            for j, column in enumerate(self.coordinates):
                M[i, j] = momentum.diff(column.rate)
        return M

    @cached_property
    def christoffel(self) -> Array:
        """Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j - ∂M_jk/∂q_i); MR section 8.1.2."""
        n = len(self.coordinates)
        M: Any = self.mass_matrix
        dM = np.empty((n, n, n), object)
        for i, j, k in np.ndindex(n, n, n):
            if i <= j:  # M is symmetric
                dM[i, j, k] = dM[j, i, k] = M[i, j].diff(self.coordinates[k].name)
        gamma = np.empty((n, n, n), object)
        for i, j, k in np.ndindex(n, n, n):
            if j <= k:  # Γ_ijk = Γ_ikj
                gamma[i, j, k] = gamma[i, k, j] = 0.5 * (dM[i, j, k] + dM[i, k, j] - dM[j, k, i])
        return gamma

    @cached_property
    def gravity_forces(self) -> Array:
        """g_i = -∂L₀/∂q_i, where L₀ are the terms of L without rates; ∂P/∂q_i if all terms of K have rates."""
        names, rates, _ = variable_names(self.coordinates)
        terms_by_rates = (self.kinetic - self.potential).split(rates)  # by monomial of the rates; 0 is the monomial 1
        without_rates = terms_by_rates.get(0, self.zero)
        return np.array([-without_rates.diff(name) for name in names], object)
