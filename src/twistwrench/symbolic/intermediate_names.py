"""Lagrange's equations with named intermediate results: ordered definitions and their derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.typing import Array
from ..mechanics.joints.joint import exact
from ..mechanics.model.model import BASE, Model
from .equations import Label, Step, entry_name, equation_fields
from .expanded_form import Coordinate, chart_waves, joint_motion, numbers_of
from .names import BodyEntries, Entry, ModelEntries, sympy

AXES = "xyz"


def exact_number(value: float) -> Any:
    """SymPy number; integers are exact, so that 0 and ±1 simplify."""
    return sympy.sympify(exact(value))


class Definitions:
    """Ordered definitions, with their derivatives."""

    def __init__(self, coordinates: tuple[Coordinate, ...], entries: ModelEntries) -> None:
        self.q = [sympy.Symbol(c.name) for c in coordinates]
        self.definitions: list[tuple[Any, Any]] = []
        self.groups: list[tuple[str, str, int]] = []
        self._taken = {s.name for s in self.q} | {p.name for p in entries.parameters}
        self._expr: dict[Any, Any] = {}
        self._slopes: dict[tuple[Any, int], Any] = {}
        self._waves: dict[tuple[int, float, float], tuple[Any, Any]] = {}

    def group(self, name: str, remark: str) -> None:
        """Begin a step, to which the following definitions belong."""
        self.groups.append((name, remark, len(self.definitions)))

    def name(self, name: str, expr: Any) -> Any:
        """New name for the expression, or the expression itself if it is a number or a number times a symbol."""
        expr = sympy.sympify(expr)
        core = expr.as_coeff_Mul()[1]
        if core.is_Symbol or not expr.free_symbols:
            return expr
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        symbol = sympy.Symbol(name)
        self.definitions.append((symbol, expr))
        self._expr[symbol] = expr
        return symbol

    def names(self, pattern: str, vector: Array) -> Array:
        """Names for the entries of a vector, with x, y, z appended."""
        return np.array([self.name(f"{pattern}{AXES[k]}", x) for k, x in enumerate(vector)], object)

    def slope(self, expr: Any, k: int) -> Any:
        """d(expr)/dq_k by the chain rule through the definitions; derivatives of names get names."""
        total = sympy.Integer(0)
        for symbol in sorted(expr.free_symbols, key=str):
            inner = self._symbol_slope(symbol, k)
            if inner != 0:
                total = total + expr.diff(symbol) * inner
        return total

    def _symbol_slope(self, symbol: Any, k: int) -> Any:
        if symbol == self.q[k]:
            return sympy.Integer(1)
        if symbol not in self._expr:
            return sympy.Integer(0)
        if (symbol, k) not in self._slopes:
            self._slopes[symbol, k] = self.name(f"d{symbol.name}_q{k + 1}", self.slope(self._expr[symbol], k))
        return self._slopes[symbol, k]

    # ── arithmetic of kinematics ──

    def number(self, entry: Entry) -> Any:
        """Number of the model, or its symbol."""
        if entry.parameter is None:
            return exact_number(entry.value)
        return entry.sign * sympy.Symbol(entry.parameter.name)

    def coordinate(self, k: int) -> Any:
        """Coordinate number k."""
        return self.q[k]

    def cosine_sine(self, k: int, rate: float, offset: float) -> tuple[Any, Any]:
        """Names for the cosine and sine; for a coordinate itself they are c_k and s_k."""
        key = (k, rate, offset)
        if key not in self._waves:
            again = sum(1 for other in self._waves if other[0] == k)
            index = f"{self.q[k].name.partition('_')[2]}{'_' + str(again + 1) if again else ''}"
            argument = exact_number(rate) * self.q[k] + exact_number(offset)
            letter = "" if self.q[k].name.startswith("theta") else self.q[k].name.partition("_")[0]
            self._waves[key] = (
                self.name(f"c{letter}_{index}", sympy.cos(argument)),
                self.name(f"s{letter}_{index}", sympy.sin(argument)),
            )
            c, s = self._waves[key]
            if c in self._expr:  # their derivatives refer to each other
                self._slopes[c, k], self._slopes[s, k] = -exact_number(rate) * s, exact_number(rate) * c
        return self._waves[key]


# ── The equations

# Order of the definitions: cosines and sines; rotations between links; velocities of centres of mass and links per unit
# of each rate, for K; the direction of gravity and the height in each link, for P; derivatives by the chain rule. Every
# line uses only names of earlier lines. Modern Robotics sections 8.1 and 5.1.


def named_derivation(model: Model, entries: ModelEntries, coordinates: tuple[Coordinate, ...]) -> dict[str, Any]:
    """Fields of :class:`~twistwrench.symbolic.derivation.Derivation`."""
    names = Definitions(coordinates, entries)
    n = len(coordinates)
    names.group("sines", "cosines and sines of the coordinates")
    raw = [joint_motion(names, body, mine) for body, mine in zip(model.bodies, entries.bodies, strict=True)]
    motions = _motions(names, [b.tag for b in entries.bodies], raw)
    velocities = _velocities(names, model, entries, motions)
    heights = _heights(names, model, entries, motions)
    names.group("mass_matrix", "M_jk = Σ m v_j·v_k + ω_j·I ω_k over the links: K = ½ q̇'M q̇")
    M = _mass_matrix(names, entries, velocities, n)
    names.group("potential_energy", "the sum of −m (gravity · p), and the energy of springs")
    lifted = (names.number(b.mass) * y for b, y in zip(entries.bodies, heights, strict=True))
    P = names.name("P", _springs(names, model, entries) + sympy.Add(*lifted))
    remark = "derivatives of M and P with respect to the coordinates (d…_qk), by the chain rule"
    names.group("slopes_of_energies", remark)
    dM = [[[names.slope(M[min(i, j)][max(i, j)], k) for k in range(n)] for j in range(n)] for i in range(n)]
    for i, j, k in np.ndindex(n, n, n):
        if i <= j:
            dM[i][j][k] = names.name(f"d{entry_name('M', i, j)}_q{k + 1}", dM[i][j][k])
    g = sympy.ImmutableMatrix([names.slope(P, k) for k in range(n)])
    return {**_equations(names, coordinates, M, dM, g, P), "definitions": tuple(names.definitions), "form": "named"}


def _motions(names: Definitions, tags: list[str], raw: list[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
    names.group("placements", "R_i and t_i: rotation and place of each link in the one before it")
    found = []
    for i, (R, p) in zip(tags, raw, strict=True):
        rows = [[names.name(f"R_{i}_{AXES[a]}{AXES[b]}", R[a, b]) for b in range(3)] for a in range(3)]
        found.append((np.array(rows, object), names.names(f"t_{i}_", p)))
    return found


def _velocities(
    names: Definitions, model: Model, entries: ModelEntries, motions: Any
) -> list[dict[int, tuple[Array, Array]]]:
    """Velocities of each body: coordinate → (ω, v of the centre of mass) per unit of its rate, in body axes."""
    remark = "w_i_j, u_i_j, v_i_j: turning, origin and centre of mass of link i per unit of rate j, in its own axes"
    names.group("velocities", remark)
    origins: list[dict[int, tuple[Array, Array]]] = []
    centres: list[dict[int, tuple[Array, Array]]] = []
    for i, (body, mine) in enumerate(zip(model.bodies, entries.bodies, strict=True)):
        R, p = motions[i]
        columns: dict[int, tuple[Array, Array]] = {}
        if body.parent != BASE:
            for j, (w, u) in origins[body.parent].items():
                columns[j] = (R.T @ w, R.T @ (u + _cross(w, p)))
        for k in range(body.v_index, body.v_index + body.joint.nv):
            own = _own(names, R, k, body, mine)
            old = columns.get(k)  # a follower also moves with its leader's rate
            columns[k] = own if old is None else (old[0] + own[0], old[1] + own[1])
        ends = {j: f"{mine.tag}_{j + 1}" for j in columns}
        named = {j: (names.names(f"w_{ends[j]}", w), names.names(f"u_{ends[j]}", u)) for j, (w, u) in columns.items()}
        com, massless = numbers_of(names, mine.com), not mine.mass.value
        origins.append(named)
        centre = {
            j: (w, w * 0 if massless else names.names(f"v_{ends[j]}", u + _cross(w, com)))
            for j, (w, u) in named.items()
        }
        centres.append(centre)
    return centres


def _own(names: Definitions, R: Array, k: int, body: Any, mine: BodyEntries) -> tuple[Array, Array]:
    """Contribution of the joint itself: ω and v of the origin in child axes, per unit of the rate of coordinate k."""
    joint, number = body.joint, k - body.v_index
    if joint.nv > 1:
        R0 = body.placement[:3, :3]
        return joint.chart_column(number, lambda step: R.T @ exact(R0 @ step), chart_waves(names, body))
    ratio = exact(body.ratio) if joint.moves_body else names.number(mine.ratio)
    w = ratio * exact(joint.axes[0, :3])
    if not joint.axes[0, :3].any():
        return w, exact(body.ratio) * exact(joint.axes[0, 3:])
    return w, -_cross(w, numbers_of(names, mine.point)) + w * names.number(mine.pitch)


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]], object)


def _heights(names: Definitions, model: Model, entries: ModelEntries, motions: Any) -> list[Any]:
    """-gravity · (position of the centre of mass) of each body; n_i is -gravity in body axes, eta_i the origin's value."""
    remark = (
        "n_i: minus gravity in the axes of link i; eta_i, zeta_i: that times the place of its origin and centre of mass"
    )
    names.group("heights", remark)
    up = -numbers_of(names, entries.gravity)
    directions: list[Array] = []
    origins: list[Any] = []
    centres = []
    for i, (body, mine) in enumerate(zip(model.bodies, entries.bodies, strict=True)):
        R, p = motions[i]
        n, y = (up, 0) if body.parent == BASE else (directions[body.parent], origins[body.parent])
        directions.append(names.names(f"n_{mine.tag}_", R.T @ n))
        origins.append(names.name(f"eta_{mine.tag}", y + n @ p))
        centres.append(names.name(f"zeta_{mine.tag}", origins[-1] + directions[-1] @ numbers_of(names, mine.com)))
    return centres


def _springs(names: Definitions, model: Model, entries: ModelEntries) -> Any:
    """Sum of ½ k (Σ weight · coordinate - rest)²."""
    places = {body.joint.name: body.v_index for body in model.leaders}
    total = sympy.Integer(0)
    for spring, k in zip(model.springs, entries.springs, strict=True):
        ends = (exact_number(weight) * names.q[places[joint]] for joint, weight in spring.terms)
        stretch = sympy.Add(*ends) - exact_number(spring.rest)
        total += sympy.Rational(1, 2) * names.number(k) * stretch**2
    return total


def _mass_matrix(names: Definitions, entries: ModelEntries, velocities: Any, n: int) -> list[list[Any]]:
    M = [[sympy.Integer(0)] * n for _ in range(n)]
    for j in range(n):
        for k in range(j, n):
            total = sympy.Integer(0)
            for mine, columns in zip(entries.bodies, velocities, strict=True):
                if j in columns and k in columns:
                    (w, v), (x, u) = columns[j], columns[k]
                    total += names.number(mine.mass) * (v @ u) + w @ (numbers_of(names, mine.inertia) @ x)
            if j == k:
                total += names.number(entries.armature[j])
            M[j][k] = M[k][j] = names.name(entry_name("M", j, k), total)
    return M


def _equations(names: Definitions, coordinates: Any, M: Any, dM: Any, g: Any, P: Any) -> dict[str, Any]:
    n = len(coordinates)
    dq = [sympy.Symbol(c.rate) for c in coordinates]
    ddq = [sympy.Symbol(c.acceleration) for c in coordinates]
    half = sympy.Rational(1, 2)

    def total(terms: Any) -> Any:
        return sympy.Add(*terms)

    gamma = [[[half * (dM[i][j][k] + dM[i][k][j] - dM[j][k][i]) for k in range(n)] for j in range(n)] for i in range(n)]
    names.group("christoffel", "Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i), those that are not zero, j ≤ k")
    for i, j, k in np.ndindex(n, n, n):
        if j <= k:
            gamma[i][j][k] = gamma[i][k][j] = names.name(entry_name("Gamma", i, j, k), gamma[i][j][k])
    matrix = sympy.ImmutableMatrix
    C = matrix(n, n, lambda i, j: total(gamma[i][j][k] * dq[k] for k in range(n)))
    pairs = [(j, k) for j in range(n) for k in range(j, n)]
    c = matrix([total(gamma[i][j][k] * dq[j] * dq[k] * (1 if j == k else 2) for j, k in pairs) for i in range(n)])
    names.group("gravity_forces", "g = ∂P/∂q, torques at rest")
    g = matrix([names.name(entry_name("g", i), x) for i, x in enumerate(g)])
    tau = matrix([total(M[i][j] * ddq[j] for j in range(n)) + c[i] + g[i] for i in range(n)])
    squares = total(half * M[i][i] * dq[i] ** 2 for i in range(n))
    L = squares + total(M[i][j] * dq[i] * dq[j] for i, j in pairs if i < j) - P
    momenta = [total(M[i][j] * dq[j] for j in range(n)) for i in range(n)]
    rates = [
        total(M[i][j] * ddq[j] + total(dM[i][j][k] * dq[k] for k in range(n)) * dq[j] for j in range(n))
        for i in range(n)
    ]
    slopes = [total(dM[j][k][i] * dq[j] * dq[k] * (half if j == k else 1) for j, k in pairs) - g[i] for i in range(n)]
    named = ("momenta", "momentum_rates", "slopes", "centripetal", "coriolis", "coriolis_matrix", "equations")
    fields = equation_fields(
        [x.name for x in coordinates], [x.rate for x in coordinates], matrix(M), sympy.ImmutableDenseNDimArray(gamma),
        C, c, g, tau, momenta, rates, slopes, only=named,
    )  # fmt: skip
    first = Step("lagrangian", "K − P", ((Label("L"), L),))
    return {**fields, "lagrangian": L, "steps": (*_definition_steps(names), first, *fields["steps"])}


def _definition_steps(names: Definitions) -> list[Step]:
    """Definitions as steps."""
    ends = [start for _, _, start in names.groups[1:]] + [len(names.definitions)]
    return [
        Step(name, remark, tuple((Label(symbol.name), expr) for symbol, expr in names.definitions[start:end]))
        for (name, remark, start), end in zip(names.groups, ends, strict=True)
        if end > start
    ]
