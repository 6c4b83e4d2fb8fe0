"""Integration methods: Runge–Kutta tableaus with orders verified by rooted trees, and variational integrators.

Order conditions: the expansion of the exact solution of y' = f(y) has one term for each rooted tree, and so has that of
a step. They agree to order p if they agree on all trees with at most p nodes. Source: Butcher, Numerical Methods for
Ordinary Differential Equations, 3rd ed., section 31; Hairer, Nørsett and Wanner, Solving Ordinary Differential
Equations I, section II.2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property
from math import comb, factorial, prod
from typing import Protocol

import numpy as np

from ..core.errors import SimulationError, UnknownNameError, ValueRangeError
from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.bodies.inertia import COMPOSITIONS
from .forces import WORKS, System

Tree = tuple["Tree", ...]
"""Subtrees of a root, sorted."""
Row = tuple[Fraction, ...]


@cache
def trees(nodes: int) -> tuple[Tree, ...]:
    """Rooted trees with a given number of nodes: 1, 1, 2, 4, 9, 20, 48 and so on.

    >>> [len(trees(n)) for n in range(1, 7)]
    [1, 1, 2, 4, 9, 20]
    """
    return tuple(sorted(_forests(nodes - 1, nodes - 1)))


def _forests(nodes: int, largest: int) -> set[Tree]:
    """Collections of trees with a given total number of nodes, none with more than ``largest``."""
    if nodes == 0:
        return {()}
    return {
        tuple(sorted((first, *rest)))
        for size in range(1, min(nodes, largest) + 1)
        for first in trees(size)
        for rest in _forests(nodes - size, size)
    }


def order(tree: Tree) -> int:
    """Number of nodes."""
    return 1 + sum(map(order, tree))


def density(tree: Tree) -> int:
    """Density γ: product over all nodes of the sizes of their subtrees; 1/γ is the exact value of Σ bφ."""
    return order(tree) * prod(map(density, tree))


def elementary_weights(tree: Tree, matrix: Sequence[Row]) -> Row:
    """Elementary weight φ of every stage: product over the subtrees of Σ_j a_ij φ_j; (stages,)."""
    found = [Fraction(1)] * len(matrix)
    for branch in tree:
        below = elementary_weights(branch, matrix)
        along = [sum((a * w for a, w in zip(row, below, strict=True)), Fraction(0)) for row in matrix]
        found = [x * y for x, y in zip(found, along, strict=True)]
    return tuple(found)


# ── Runge–Kutta tableaus of fractions, with orders verified on construction

# k_i = f(t + c_i h, y + h Σ a_ij k_j),        y(t + h) = y + h Σ b_i k_i
#
# A tableau must satisfy the conditions of all rooted trees up to its order, exactly, and violate one of the next order:
# the stated order is neither too high nor too low.


@dataclass(frozen=True)
class Tableau:
    """Butcher tableau of a Runge–Kutta method, checked to have the stated order.

    Examples
    --------
    >>> Tableau("Heun", 2, a=((0, 0), (1, 0)), b=(Fraction(1, 2), Fraction(1, 2))).c
    (Fraction(0, 1), Fraction(1, 1))
    >>> Tableau("wrong", 2, a=((0,),), b=(1,))
    Traceback (most recent call last):
    twistwrench.core.errors.ValueRangeError: tableau 'wrong' is not of order 2: tree ((),) gives 0, wanted 1/2.
    """

    name: str
    """Name of the method."""
    order: int
    """Order of consistency."""
    a: tuple[Row, ...]
    """Coefficients of the stages (stages, stages)."""
    b: Row
    """Weights of the step (stages,)."""
    embedded: Row = ()
    """Weights (stages,) of an embedded step; its difference from the step estimates the error."""
    embedded_order: int = 0
    """Order of the embedded step."""
    dense: tuple[Row, ...] = ()
    """Weights of dense output (stages, degree): b_i(θ) = Σ_j dense[i][j] θ^(j+1) for 0 ≤ θ ≤ 1."""
    dense_order: int = 0
    """Order of dense output."""

    def __post_init__(self) -> None:
        for part in ("a", "dense"):
            object.__setattr__(self, part, tuple(tuple(map(Fraction, row)) for row in getattr(self, part)))
        for part in ("b", "embedded"):
            object.__setattr__(self, part, tuple(map(Fraction, getattr(self, part))))
        if len(self.b) != len(self.a) or any(len(row) != len(self.a) for row in self.a):
            raise ValueRangeError(f"tableau {self.name!r}: a must be square, with a row for each entry of b.")
        self._require(self.b, self.order, "is not")
        if self.embedded:
            self._require(self.embedded, self.embedded_order, "has no embedded step")
        if not self.dense:
            return
        # Σ b_i(θ) φ_i = θ^nodes / γ, power by power of θ; for θ = 1 this is the step itself.
        if tuple(sum(row, Fraction(0)) for row in self.dense) != self.b:
            raise ValueRangeError(f"tableau {self.name!r}: the dense output does not end where the step does.")
        for power, weights in enumerate(zip(*self.dense, strict=True), start=1):
            for tree, found, wanted in self._conditions(weights, self.dense_order):
                if found != (wanted if order(tree) == power else 0):
                    raise ValueRangeError(
                        f"tableau {self.name!r} has no dense output of order {self.dense_order}: at θ^{power} tree "
                        f"{tree} gives {found}."
                    )

    @cached_property
    def c(self) -> Row:
        """Times of the stages (stages,): row sums of a."""
        return tuple(sum(row, Fraction(0)) for row in self.a)

    @property
    def explicit(self) -> bool:
        """True if each stage depends only on earlier ones."""
        return not any(x for i, row in enumerate(self.a) for x in row[i:])

    @property
    def first_same_as_last(self) -> bool:
        """True if the last stage of a step is the first of the next."""
        return self.explicit and len(self.b) > 1 and self.a[-1] == self.b

    @property
    def symplectic(self) -> bool:
        """True if b_i a_ij + b_j a_ji = b_i b_j: quadratic invariants and volumes are preserved."""
        return _keeps(self.b, self.a, self.b, self.a)

    @cached_property
    def numbers(self) -> tuple[tuple[Array, ...], Array, Array, Array, Array]:
        """Rows of a up to the diagonal, b, c, b - embedded, dense, as float64."""
        rows = tuple(np.array(row[:i], float) for i, row in enumerate(self.a))
        b, c = np.array(self.b, float), np.array(self.c, float)
        error = b - np.array(self.embedded, float) if self.embedded else np.zeros(0)
        return rows, b, c, error, np.array(self.dense, float)

    def _require(self, weights: Row, order: int, claim: str) -> None:
        for tree, found, wanted in self._conditions(weights, order):
            if found != wanted:
                raise ValueRangeError(
                    f"tableau {self.name!r} {claim} of order {order}: tree {tree} gives {found}, wanted {wanted}."
                )
        if all(found == wanted for _, found, wanted in self._conditions(weights, order + 1, order + 1)):
            raise ValueRangeError(f"tableau {self.name!r} claims order {order} and has order {order + 1}.")

    def _conditions(self, weights: Row, last: int, first: int = 1) -> Iterator[tuple[Tree, Fraction, Fraction]]:
        """Tree, Σ b_i φ_i and 1/γ, for the trees with ``first`` to ``last`` nodes."""
        for nodes in range(first, last + 1):
            for tree in trees(nodes):
                yield tree, _dot(weights, elementary_weights(tree, self.a)), Fraction(1, density(tree))


@dataclass(frozen=True)
class Partitioned:
    """Partitioned Runge–Kutta method: separate tableaus for two parts of a state, such as velocities and positions."""

    name: str
    """Name of the method."""
    order: int
    """Order of consistency."""
    velocities: Tableau
    """Tableau of the velocities."""
    positions: Tableau
    """Tableau of the positions."""

    def __post_init__(self) -> None:
        v, p = self.velocities, self.positions
        ends = all(sum(t.b) == 1 for t in (v, p))
        # Trees with two nodes, by the colours of root and leaf: Σ b_i a_ij = ½ with b and a of either part.
        pairs = [_dot(s.b, t.c) == Fraction(1, 2) for s in (v, p) for t in (v, p)]
        found = 0 if not ends else 2 if all(pairs) else 1
        if min(found, 2) != self.order:
            raise ValueRangeError(f"partitioned tableau {self.name!r} claims order {self.order} and has order {found}.")

    @property
    def symplectic(self) -> bool:
        """True if b_i â_ij + b̂_j a_ji = b_i b̂_j: the map preserves the symplectic form of H(q, p)."""
        return _keeps(self.velocities.b, self.velocities.a, self.positions.b, self.positions.a)


def _dot(weights: Sequence[Fraction], values: Sequence[Fraction]) -> Fraction:
    return sum((w * x for w, x in zip(weights, values, strict=True)), Fraction(0))


def _keeps(b: Row, a: tuple[Row, ...], b_hat: Row, a_hat: tuple[Row, ...]) -> bool:
    stages = range(len(b))
    return all(b[i] * a_hat[i][j] + b_hat[j] * a[j][i] == b[i] * b_hat[j] for i in stages for j in stages)


def _fractions(*rows: str) -> tuple[Row, ...]:
    return tuple(tuple(map(Fraction, row.split())) for row in rows)


EULER = Tableau("Euler", 1, a=_fractions("0"), b=(Fraction(1),))
IMPLICIT_EULER = Tableau("implicit Euler", 1, a=_fractions("1"), b=(Fraction(1),))
MIDPOINT = Tableau("implicit midpoint", 2, a=_fractions("1/2"), b=(Fraction(1),))
SEMI_IMPLICIT_EULER = Partitioned("semi-implicit Euler", 1, velocities=EULER, positions=IMPLICIT_EULER)
RK4 = Tableau(
    "Runge–Kutta 4",
    4,
    a=_fractions("0 0 0 0", "1/2 0 0 0", "0 1/2 0 0", "0 0 1 0"),
    b=_fractions("1/6 1/3 1/3 1/6")[0],
)
DORMAND_PRINCE = Tableau(
    "Dormand–Prince 5(4)",
    5,
    a=_fractions(
        "0 0 0 0 0 0 0",
        "1/5 0 0 0 0 0 0",
        "3/40 9/40 0 0 0 0 0",
        "44/45 -56/15 32/9 0 0 0 0",
        "19372/6561 -25360/2187 64448/6561 -212/729 0 0 0",
        "9017/3168 -355/33 46732/5247 49/176 -5103/18656 0 0",
        "35/384 0 500/1113 125/192 -2187/6784 11/84 0",
    ),
    b=_fractions("35/384 0 500/1113 125/192 -2187/6784 11/84 0")[0],
    embedded=_fractions("5179/57600 0 7571/16695 393/640 -92097/339200 187/2100 1/40")[0],
    embedded_order=4,
    dense=_fractions(
        "1 -8048581381/2820520608 8663915743/2820520608 -12715105075/11282082432",
        "0 0 0 0",
        "0 131558114200/32700410799 -68118460800/10900136933 87487479700/32700410799",
        "0 -1754552775/470086768 14199869525/1410260304 -10690763975/1880347072",
        "0 127303824393/49829197408 -318862633887/49829197408 701980252875/199316789632",
        "0 -282668133/205662961 2019193451/616988883 -1453857185/822651844",
        "0 40617522/29380423 -110615467/29380423 69997945/29380423",
    ),
    dense_order=4,
)
"""Dormand and Prince, "A family of embedded Runge–Kutta formulae", J. Comp. Appl. Math. 6(1), 1980; dense output by
Shampine, "Some practical Runge–Kutta formulas", Math. Comp. 46, 1986."""


# ── Variational integrators: discrete forms of Hamilton's principle

# The action of one step of length h from q to q exp(η), with ξ = η/h, is evaluated at the midpoint,
#
#     L_d = h L(q exp(η/2), ξ),        L = ½ ξᵀ M ξ - U
#
# and made stationary. With the momenta p = M dq, a = ad(η) and E = exp(a/2) = Ad(exp(η/2)), joint by joint, this gives
#
#     (a / (e^a - 1))ᵀ M ξ = p0 + h (1 + E)⁻ᵀ G        to be solved for ξ,
#     p1 = Eᵀ (Eᵀ p0 + h G),        q1 = q0 exp(h ξ),
#
# where G = ∂L/∂q + f at the midpoint. For joints with one degree of freedom E = 1 and a = 0, and the method is the
# midpoint rule of Hamilton's equations. The map is symplectic and symmetric. Momenta that no force changes, such as the
# spatial momentum of a free-floating robot, are preserved to rounding errors. Symmetric compositions raise the order
# and preserve these properties. Forces act at the midpoint, by d'Alembert's principle.
#
# Sources: Marsden and West, "Discrete mechanics and variational integrators", Acta Numerica 10, 2001; Bou-Rabee and
# Marsden, "Hamilton–Pontryagin integrators on Lie groups", Found. Comput. Math. 9, 2009; the compositions are those of
# :mod:`twistwrench.mechanics.bodies.inertia`.

_MOST = 100
"""Largest number of iterations. Convergence is linear and faster for shorter steps; three or four are usual."""
_SLOW = 0.3
"""Largest ratio of consecutive changes; above it a tiny change is rounding error, otherwise secant updates are used."""

# Series of ad(η), whose eigenvalues are 0 and ±i times the rotation angle. The first two converge for less than a full
# turn; at 1 rad the first omitted term is below 1e-19.

LARGEST_TURN = 2.0
"""Largest rotation per step [rad]; the first omitted term is then below 1e-12."""
_TERMS = 13
_POWERS = 20


_BERNOULLI = [Fraction(1)]
for _m in range(1, 2 * _TERMS + 1):
    _BERNOULLI.append(-sum((comb(_m + 1, j) * _BERNOULLI[j] for j in range(_m)), Fraction(0)) / (_m + 1))
_RATIOS = [float(_BERNOULLI[2 * n] / factorial(2 * n)) for n in range(1, _TERMS + 1)]
"""B_2n / (2n)! for n = 1, 2, …, with the Bernoulli numbers B."""
_TANH = [0.5 * 4.0**n * (4.0**n - 1.0) * r * 0.25 ** (2 * n - 1) for n, r in enumerate(_RATIOS, start=1)]
"""½ tanh(a/4) = Σ _TANH a^(2n-1)."""


def _adjoint(V: Array, constants: Array) -> Array:
    """ad(V) (n, n) of velocities (n,) in the directions of a group, from its structure constants (n, n²)."""
    return np.asarray(V @ constants).reshape(len(V), len(V))


def _exponential(a: Array, x: Array) -> Array:
    """e^a x."""
    y = x
    for k in range(_POWERS, 0, -1):
        y = x + a.dot(y) / k
    return y


def _even(a: Array, x: Array, coefficients: list[float]) -> Array:
    """Σ c_n a^(2n) x over n = 0, 1, … of an even function."""
    square, y = a.dot(a), coefficients[-1] * x
    for c in coefficients[-2::-1]:
        y = c * x + square.dot(y)
    return y


class _Secant:
    """Broyden's method: secant updates for iterations that do not converge by themselves.

    Source: Broyden, "A class of methods for solving nonlinear simultaneous equations", Math. Comp. 19, 1965.
    """

    def __init__(self, change: Array) -> None:
        self.inverse, self.plain, self.last = np.eye(len(change)), change, change

    def changed(self, plain: Array) -> Array:
        """Broyden's change for the change of the plain iteration."""
        less = self.inverse @ (self.plain - plain)  # change by the current inverse
        along = float(self.last @ less)
        if along:
            self.inverse = self.inverse + np.outer(self.last - less, self.last @ self.inverse) / along
        self.plain, self.last = plain, self.inverse @ plain
        return self.last


class Variational:
    """Midpoint rule from Hamilton's principle, composed to an order of :data:`COMPOSITIONS`."""

    lagging = False

    def __init__(self, system: System, order: int) -> None:
        self.system, self.order, self.fractions = system, order, COMPOSITIONS[order]
        parts = np.array(self.fractions)
        self.quadrature = np.cumsum(parts) - 0.5 * parts, parts
        robot = system.robot
        self.terms = robot.kernel("mass_matrix", "coriolis_matrix", "bias_forces")
        self.groups = system.manifold.groups

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """State a time ``h`` later; ``rate`` is f(t, y)."""
        system = self.system
        q, dq = system.split(y)
        p = system.robot.mass_matrix(q) @ dq
        works, ddq, xi, gone = y[-len(WORKS) :].copy(), rate[system.moving], dq, 0.0
        for c in self.fractions:
            xi = xi + (0.5 * c * h - gone) * ddq  # initial guess: velocity at the midpoint
            q, p, xi, powers = self._step(t, q, p, xi, c * h)
            t, gone = t + c * h, -0.5 * c * h
            works += c * h * powers
        return np.concatenate([q, np.linalg.solve(system.robot.mass_matrix(q), p), works])

    def _step(self, t: float, q0: Array, p0: Array, xi: Array, h: float) -> tuple[Array, Array, Array, Array]:
        """One midpoint step; returns the state after it, ξ, and the powers of the forces at the midpoint (4,)."""
        system, before, powers = self.system, np.inf, np.zeros(len(WORKS))
        secant: _Secant | None = None
        usual = float(np.abs(xi).max()) or 1e-300  # the robot may come to rest in a step
        for _ in range(_MOST):
            middle = system.manifold.move(q0, 0.5 * h * xi)
            M, C, bias = self.terms(middle, xi)
            powers[:] = 0.0
            # ∂L/∂q = Cᵀ ξ - g, since dM/dt = C + Cᵀ and p' = M ddq + (dM/dt) ξ; minus ad(ξ)ᵀ p for group joints.
            G = (C + C.T) @ xi - bias + system.forces(t + 0.5 * h, middle, xi, powers)
            system.evaluations += 1
            p = M @ xi
            left, half = self._brought(xi, h, p, G) if self.groups else (p, 0.5 * G)
            missing = p0 + h * half - left
            change = system.robot.forward_dynamics(middle, xi, missing + bias)  # M⁻¹ times the residual
            if secant is not None:
                change = secant.changed(change)
            xi = xi + change
            size, scale = float(np.abs(change).max()), max(float(np.abs(xi).max()), usual)
            if not size < np.inf:
                raise self._lost(t, "the step is unstable", change)
            if any(np.linalg.norm(h * xi[k][turning]) > LARGEST_TURN for k, turning, _ in self.groups):
                raise self._lost(t, f"the step turns a body by more than {printed(LARGEST_TURN)} rad", change)
            # The next change would be smaller by the same ratio; this one may already be rounding error.
            settled = size * min(size / before, 1.0) if before < np.inf else size
            if settled <= 1e-16 * scale or _SLOW * before < size <= 1e-11 * scale:
                p1 = self._carried(h * xi, p0, h * G)
                return system.manifold.move(q0, h * xi), p1, xi, powers
            if secant is None and size > _SLOW * before:  # force too stiff for the step, as in a contact
                secant = _Secant(change)
            before = size
        raise self._lost(t, f"{_MOST} iterations found no balance", change)

    def _brought(self, xi: Array, h: float, p: Array, G: Array) -> tuple[Array, Array]:
        """(a / (e^a - 1))ᵀ p and (1 + E)⁻ᵀ G, after ad(ξ)ᵀ p is subtracted from G."""
        brackets = [(k, _adjoint(xi[k], c).T) for k, _, c in self.groups]
        for k, ad in brackets:
            G[k] -= ad @ p[k]
        left, half = p.copy(), 0.5 * G
        for k, ad in brackets:
            a = h * ad
            ap = a.dot(p[k])
            left[k] = p[k] - 0.5 * ap + a.dot(a.dot(_even(a, p[k], _RATIOS)))  # Σ B_n / n! a^n p
            half[k] = 0.5 * G[k] - a.dot(_even(a, G[k], _TANH))  # ½ G - ½ tanh(a/4) G
        return left, half

    def _carried(self, eta: Array, p0: Array, impulse: Array) -> Array:
        """Eᵀ (Eᵀ p0 + h G)."""
        p1 = p0 + impulse
        for k, _, c in self.groups:
            half = 0.5 * _adjoint(eta[k], c).T
            p1[k] = _exponential(half, _exponential(half, p0[k]) + impulse[k])
        return p1

    def _lost(self, t: float, what: str, change: Array) -> SimulationError:
        bad = int(np.argmax(np.where(np.isfinite(change), np.abs(change), np.inf)))
        name = self.system.robot.model.velocity_names[bad]
        return SimulationError(f"at t = {printed(t, 9)} s {what}, first of all in joint {name!r}. Take a smaller dt.")


# ── One step of each method


class Scheme(Protocol):
    """One-step method."""

    order: int
    quadrature: tuple[Array, Array]
    """Times at which forces are evaluated, as fractions of a step, and their weights in the impulse: c and b."""

    @property
    def lagging(self) -> bool:
        """True if the velocities of a state lag half a step behind its coordinates."""

    def step(self, t: float, y: Array, h: float, rate: Array, /) -> Array:
        """State a time ``h`` later; ``rate`` is f(t, y)."""


class RungeKutta:
    """Explicit method from its tableau. The caller normalises quaternions."""

    lagging = False

    def __init__(self, system: System, tableau: Tableau) -> None:
        self.system, self.tableau, self.order = system, tableau, tableau.order
        self.a, self.b, self.c, self.error, self.dense = tableau.numbers
        self.quadrature = self.c, self.b
        self.K = np.zeros((len(self.b), system.size))
        """Rates of the stages of the last step."""

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """Step y + h Σ b_i k_i."""
        K, rates = self.K, self.system.rates
        K[0] = rate
        for i in range(1, len(self.b)):
            rates(t + self.c[i] * h, y + h * np.dot(self.a[i], K[:i]), K[i])
        return y + h * np.dot(self.b, K)


class SemiImplicit:
    """Semi-implicit Euler: velocities by the rates before, coordinates by the velocities after, along the manifold.

    Friction, and velocity gains of laws that return them, are implicit. With friction, velocities change at the
    midpoint.
    """

    order = SEMI_IMPLICIT_EULER.order
    quadrature = np.zeros(1), np.ones(1)

    def __init__(self, system: System) -> None:
        self.system = system

    @property
    def lagging(self) -> bool:
        """True unless friction makes the velocities change at the midpoint of the step."""
        return self.system.dry_friction is None or not self.system.dry_friction.friction

    def step(self, t: float, y: Array, h: float, rate: Array) -> Array:
        """dq1 = dq + h ddq, with implicit friction and gains if any; then q1 = q ⊕ h dq1, or half steps by dq and dq1."""
        s = self.system
        if s.dry_friction is None:
            y1 = y + h * rate
            y1[: s.nq] = s.manifold.move(y[: s.nq], h * y1[s.moving])
            return y1
        y1, powers = y.copy(), np.zeros(len(WORKS))
        v = s.braked_step(t, y, h, powers)
        middle = s.dry_friction.middle(s.manifold, y[: s.nq], y[s.moving], h)
        y1[: s.nq], y1[s.moving] = s.dry_friction.end(s.manifold, middle, v, h), v
        y1[-len(WORKS) :] += h * powers
        return y1


class OneByOne:
    """Steps of a method from any state: first the rates there, last the normalisation of quaternions."""

    takes_many = False

    def __init__(self, system: System, scheme: Scheme) -> None:
        self.system, self.scheme, self.order = system, scheme, scheme.order
        self.accelerations = system.accelerations

    def after(self, t: float, y: Array, h: float) -> Array:
        """State a time ``h`` later."""
        return self.begun(t, y, h)[0]

    def begun(self, t: float, y: Array, h: float) -> tuple[Array, Array]:
        """State a time h later, and accelerations (nv,) at the given state."""
        rate = np.zeros(self.system.size)
        self.system.rates(t, y, rate)
        y = self.scheme.step(t, y, h, rate)
        self.system.manifold.normalise(y[: self.system.nq])
        return y, rate[self.system.moving]


METHODS: dict[str, Callable[[System], Scheme]] = {
    "dopri5": lambda system: RungeKutta(system, DORMAND_PRINCE),
    "euler": lambda system: RungeKutta(system, EULER),
    "midpoint": lambda system: Variational(system, 2),
    "rk4": lambda system: RungeKutta(system, RK4),
    "semi_implicit": SemiImplicit,
    "variational": lambda system: Variational(system, 4),
    "variational6": lambda system: Variational(system, 6),
}
"""Methods by name; ``dopri5`` adapts its steps, the others take fixed steps."""


ADAPTIVE = "dopri5"


def scheme_of(name: str, system: System) -> Scheme:
    """Method by name; raises UnknownNameError with the list of methods."""
    if not isinstance(name, str) or name not in METHODS:
        raise UnknownNameError.from_choices("method", name, METHODS)
    return METHODS[name](system)
