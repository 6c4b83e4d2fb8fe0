"""Lagrange's equations with named intermediate results: ordered definitions and their derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.typing import Array
from ..mechanics.joints.joint import exact
from ..mechanics.model.model import BASE, Model
from .coordinates import Coordinate, variable_names
from .equations import Label, Step, entry_name, equation_fields, weighted_sum
from .expanded_form import chart_waves, joint_motion, numbers_of
from .names import names_of, sympy
from .parameters import BodyEntries, Entry, ModelEntries

AXES = "xyz"
"""Names of the entries of a vector."""


def exact_number(value: float) -> Any:
    """SymPy number; integers are exact, so that 0 and ±1 simplify."""
    return sympy.sympify(exact(value))


class Definitions:
    """Ordered definitions of names for intermediate results, with their derivatives."""

    def __init__(self, coordinates: tuple[Coordinate, ...], entries: ModelEntries) -> None:
        self.q = list(map(sympy.Symbol, names_of(coordinates)))  # symbols of the coordinates
        self.definitions: list[tuple[Any, Any]] = []  # symbol and expression
        self.groups: list[tuple[str, str, int]] = []  # name of a step, its remark, index of its first definition
        self._used_names = set(names_of([*self.q, *entries.parameters]))
        self._expressions: dict[Any, Any] = {}  # by symbol
        self._derivatives: dict[tuple[Any, int], Any] = {}  # by symbol and number of the coordinate
        self._waves: dict[tuple[int, float, float], tuple[Any, Any]] = {}  # cosine, sine by arguments of cosine_sine

    def group(self, name: str, remark: str) -> None:
        """Begin a step, to which the following definitions belong."""
        self.groups.append((name, remark, len(self.definitions)))

    def name(self, name: str, expr: Any) -> Any:
        """Symbol of a new definition; an expression that is a number, or a number times a symbol, stays as it is."""
        expr = sympy.sympify(expr)
        _, factor = expr.as_coeff_Mul()  # without its numeric coefficient
        if factor.is_Symbol or not expr.free_symbols:
            return expr
        while name in self._used_names:
            name += "_"
        self._used_names.add(name)
        symbol = sympy.Symbol(name)
        self.definitions.append((symbol, expr))
        self._expressions[symbol] = expr
        return symbol

    def names(self, prefix: str, vector: Array) -> Array:
        """Symbols for the entries of a vector, named by the prefix and x, y, z; as :meth:`name`."""
        symbols = np.empty(len(vector), object)
        for k, entry in enumerate(vector):
            symbols[k] = self.name(f"{prefix}{AXES[k]}", entry)
        return symbols

    def slope(self, expr: Any, k: int) -> Any:
        """d(expr)/dq_k by the chain rule through the definitions; derivatives of names get names."""
        total = sympy.Integer(0)
        symbols = sorted(expr.free_symbols, key=str)  # so that names are defined in the same order each time
        for symbol in symbols:
            symbol_slope = self._symbol_slope(symbol, k)
            if symbol_slope != 0:
                total = total + expr.diff(symbol) * symbol_slope
        return total

    def _symbol_slope(self, symbol: Any, k: int) -> Any:
        """d(symbol)/dq_k: 1 for q_k, 0 for a parameter or another coordinate, a name for a defined symbol."""
        if symbol == self.q[k]:
            return sympy.Integer(1)
        if symbol not in self._expressions:
            return sympy.Integer(0)
        if (symbol, k) not in self._derivatives:
            derivative = self.slope(self._expressions[symbol], k)
            self._derivatives[symbol, k] = self.name(f"d{symbol.name}_q{k + 1}", derivative)
        return self._derivatives[symbol, k]

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
        """Symbols for cosine and sine of rate · q_k + offset; the first ones of q_k are named c_k and s_k."""
        key = (k, rate, offset)
        if key not in self._waves:
            self._waves[key] = self._name_waves(k, rate, offset)
        return self._waves[key]

    def _name_waves(self, k: int, rate: float, offset: float) -> tuple[Any, Any]:
        """New symbols for cosine and sine, with their derivatives; their names have the coordinate's letter, except theta."""
        letter, _, index = self.q[k].name.partition("_")
        if letter.startswith("theta"):
            letter = ""
        earlier_waves = sum(coordinate == k for coordinate, _, _ in self._waves)
        if earlier_waves:
            index += f"_{earlier_waves + 1}"
        argument = exact_number(rate) * self.q[k] + exact_number(offset)
        c = self.name(f"c{letter}_{index}", sympy.cos(argument))
        s = self.name(f"s{letter}_{index}", sympy.sin(argument))
        if c in self._expressions:  # their derivatives refer to each other
            self._derivatives[c, k] = -exact_number(rate) * s
            self._derivatives[s, k] = exact_number(rate) * c
        return c, s


# ── The equations

# Order of the definitions: cosines and sines; poses of links in the links before them; velocities of links and their centres of
# mass per unit of each rate, for K; direction of gravity and heights in each link, for P; derivatives by the chain rule. Every
# line uses only names of earlier lines. Modern Robotics sections 8.1 and 5.1.


def named_derivation(model: Model, entries: ModelEntries, coordinates: tuple[Coordinate, ...]) -> dict[str, Any]:
    """Fields of :class:`~twistwrench.symbolic.derivation.Derivation`."""
    names = Definitions(coordinates, entries)
    n = len(coordinates)
    names.group("sines", "cosines and sines of the coordinates")
    poses = []
    for body, body_entries in zip(model.bodies, entries.bodies, strict=True):
        poses.append(joint_motion(names, body, body_entries))
    motions = _motions(names, entries, poses)
    velocities = _velocities(names, model, entries, motions)
    heights = _heights(names, model, entries, motions)
    names.group("mass_matrix", "M_jk = Σ m v_j·v_k + ω_j·I ω_k over the links: K = ½ q̇'M q̇")
    M = _mass_matrix(names, entries, velocities)
    names.group("potential_energy", "the sum of −m (gravity · p), and the energy of springs")
    gravity_energies = []
    for body_entries, height in zip(entries.bodies, heights, strict=True):
        gravity_energies.append(names.number(body_entries.mass) * height)
    P = names.name("P", _spring_energy(names, model, entries) + sympy.Add(*gravity_energies))
    remark = "derivatives of M and P with respect to the coordinates (d…_qk), by the chain rule"
    names.group("slopes_of_energies", remark)
    dM = np.empty((n, n, n), object)
    for i, j, k in np.ndindex(n, n, n):
        if i <= j:  # M is symmetric
            dM[i, j, k] = dM[j, i, k] = names.slope(M[i, j], k)
    g = [names.slope(P, k) for k in range(n)]
    fields = _equations(names, coordinates, M, dM, g, P)
    return {**fields, "definitions": tuple(names.definitions), "form": "named"}


def _motions(names: Definitions, entries: ModelEntries, poses: list[tuple[Array, Array]]) -> list[tuple[Array, Array]]:
    """Poses (R, p) of the links in their parents, with names for their entries."""
    names.group("placements", "R_i and t_i: rotation and place of each link in the one before it")
    motions = []
    for body, (R, p) in zip(entries.bodies, poses, strict=True):
        named_R = np.empty((3, 3), object)
        for row, column in np.ndindex(3, 3):
            name = f"R_{body.tag}_{AXES[row]}{AXES[column]}"
            named_R[row, column] = names.name(name, R[row, column])
        motions.append((named_R, names.names(f"t_{body.tag}_", p)))
    return motions


def _velocities(
    names: Definitions, model: Model, entries: ModelEntries, motions: Any
) -> list[dict[int, tuple[Array, Array]]]:
    """For each body: {coordinate: (ω, v of the centre of mass) per unit of its rate}, in body axes."""
    remark = "w_i_j, u_i_j, v_i_j: turning, origin and centre of mass of link i per unit of rate j, in its own axes"
    names.group("velocities", remark)
    origins: list[dict[int, tuple[Array, Array]]] = []
    centres: list[dict[int, tuple[Array, Array]]] = []
    for body, body_entries, (R, p) in zip(model.bodies, entries.bodies, motions, strict=True):
        columns: dict[int, tuple[Array, Array]] = {}  # (ω, velocity u of the origin) by coordinate
        if body.parent != BASE:  # motion with the parent
            for j, (w, u) in origins[body.parent].items():
                columns[j] = (R.T @ w, R.T @ (u + _cross(w, p)))
        for k in range(body.v_index, body.v_index + body.joint.nv):
            w, u = _joint_column(names, R, k, body, body_entries)
            if k in columns:  # a follower also moves with its leader's rate
                leader_w, leader_u = columns[k]
                w = leader_w + w
                u = leader_u + u
            columns[k] = (w, u)
        for j, (w, u) in columns.items():
            label = f"{body_entries.tag}_{j + 1}"
            columns[j] = (names.names(f"w_{label}", w), names.names(f"u_{label}", u))
        origins.append(columns)
        centres.append(_centre_velocities(names, columns, body_entries))
    return centres


def _centre_velocities(
    names: Definitions, columns: dict[int, tuple[Array, Array]], body_entries: BodyEntries
) -> dict[int, tuple[Array, Array]]:
    """(ω, v of the centre of mass) from (ω, u of the origin), by coordinate; v is zero for a body without mass."""
    com = numbers_of(names, body_entries.com)
    centre_columns = {}
    for j, (w, u) in columns.items():
        v = w * 0
        if body_entries.mass.value:
            v = names.names(f"v_{body_entries.tag}_{j + 1}", u + _cross(w, com))
        centre_columns[j] = (w, v)
    return centre_columns


def _joint_column(names: Definitions, R: Array, k: int, body: Any, body_entries: BodyEntries) -> tuple[Array, Array]:
    """Contribution of the joint itself: ω and u of the origin in child axes, per unit of the rate of coordinate k."""
    joint = body.joint
    if joint.nv > 1:
        R_placement = body.placement[:3, :3]

        def in_child_axes(vector: Array) -> Any:
            """Vector in the child's axes, from those of the placement."""
            return R.T @ exact(R_placement @ vector)

        return joint.chart_column(k - body.v_index, in_child_axes, chart_waves(names, body))
    ratio = exact(body.ratio)
    if not joint.moves_body:
        ratio = names.number(body_entries.ratio)  # a symbol for the gear of a rotor
    w = ratio * exact(joint.axes[0, :3])
    if not joint.axes[0, :3].any():
        return w, exact(body.ratio) * exact(joint.axes[0, 3:])
    u = -_cross(w, numbers_of(names, body_entries.point)) + w * names.number(body_entries.pitch)
    return w, u


def _cross(a: Array, b: Array) -> Array:
    """a × b of symbols (3,)."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    z = a[0] * b[1] - a[1] * b[0]
    return np.array([x, y, z], object)


def _heights(names: Definitions, model: Model, entries: ModelEntries, motions: Any) -> list[Any]:
    """-gravity · (position of the centre of mass) of each body; n_i is -gravity in body axes, eta_i the origin's value."""
    remark = (
        "n_i: minus gravity in the axes of link i; eta_i, zeta_i: that times the place of its origin and centre of mass"
    )
    names.group("heights", remark)
    minus_gravity = -numbers_of(names, entries.gravity)
    directions: list[Array] = []  # n of each body
    origin_heights: list[Any] = []  # eta of each body
    centre_heights = []  # zeta of each body
    for body, body_entries, (R, p) in zip(model.bodies, entries.bodies, motions, strict=True):
        parent_n = minus_gravity
        parent_eta = 0
        if body.parent != BASE:
            parent_n = directions[body.parent]
            parent_eta = origin_heights[body.parent]
        n = names.names(f"n_{body_entries.tag}_", R.T @ parent_n)
        eta = names.name(f"eta_{body_entries.tag}", parent_eta + parent_n @ p)
        zeta = names.name(f"zeta_{body_entries.tag}", eta + n @ numbers_of(names, body_entries.com))
        directions.append(n)
        origin_heights.append(eta)
        centre_heights.append(zeta)
    return centre_heights


def _spring_energy(names: Definitions, model: Model, entries: ModelEntries) -> Any:
    """Sum of ½ k (Σ weight · coordinate - rest)²."""
    v_indices = {body.joint.name: body.v_index for body in model.leaders}
    total = sympy.Integer(0)
    for spring, stiffness in zip(model.springs, entries.springs, strict=True):
        displacements = []
        for joint, weight in spring.terms:
            displacements.append(exact_number(weight) * names.q[v_indices[joint]])
        stretch = sympy.Add(*displacements) - exact_number(spring.rest)
        total += sympy.Rational(1, 2) * names.number(stiffness) * stretch**2
    return total


def _mass_matrix(names: Definitions, entries: ModelEntries, velocities: Any) -> Array:
    """M_jk = Σ m v_j·v_k + ω_j·I ω_k over the links, plus the armature; with names for its entries."""
    n = len(names.q)
    M = np.empty((n, n), object)
    for j in range(n):
        for k in range(j, n):
            total = sympy.Integer(0)
            for body, columns in zip(entries.bodies, velocities, strict=True):
                if j in columns and k in columns:
                    w_j, v_j = columns[j]
                    w_k, v_k = columns[k]
                    I = numbers_of(names, body.inertia)
                    total += names.number(body.mass) * (v_j @ v_k) + w_j @ (I @ w_k)
            if j == k:
                total += names.number(entries.armature[j])
            M[j, k] = M[k, j] = names.name(entry_name("M", j, k), total)
    return M


_SUMMARY_STEPS = (
    "momenta", "momentum_rates", "slopes", "centripetal", "coriolis", "coriolis_matrix", "equations",
)  # fmt: skip
"""Steps that are written after the definitions; the definitions contain all other steps."""


def _equations(names: Definitions, coordinates: Any, M: Array, dM: Array, P_slopes: Any, P: Any) -> dict[str, Any]:
    """Fields of the equations from M, ∂M/∂q (n, n, n), ∂P/∂q and P."""
    n = len(coordinates)
    coordinate_names, rate_names, acceleration_names = variable_names(coordinates)
    dq = list(map(sympy.Symbol, rate_names))
    ddq = list(map(sympy.Symbol, acceleration_names))
    matrix = sympy.ImmutableMatrix
    names.group("christoffel", "Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i), those that are not zero, j ≤ k")
    gamma = np.empty((n, n, n), object)
    for i, j, k in np.ndindex(n, n, n):
        if j <= k:
            value = sympy.Rational(1, 2) * (dM[i, j, k] + dM[i, k, j] - dM[j, k, i])
            gamma[i, j, k] = gamma[i, k, j] = names.name(entry_name("Gamma", i, j, k), value)
    C = matrix(n, n, lambda i, j: weighted_sum(gamma[i, j], dq))
    names.group("gravity_forces", "g = ∂P/∂q, torques at rest")
    gravity_forces = []
    for i, P_slope in enumerate(P_slopes):
        gravity_forces.append(names.name(entry_name("g", i), P_slope))
    g = matrix(gravity_forces)
    L = _quadratic_form(M / 2, dq) - P
    c = []  # velocity terms c_i = q̇' Γ_i q̇
    tau = []
    momenta, momentum_rates = [], []  # ∂L/∂q̇ and its derivative by time
    slopes = []
    for i in range(n):
        c.append(_quadratic_form(gamma[i], dq))
        tau.append(weighted_sum(M[i], ddq) + c[i] + g[i])
        momenta.append(weighted_sum(M[i], dq))
        dM_dt = [weighted_sum(row, dq) for row in dM[i]]  # row i
        momentum_rates.append(weighted_sum(M[i], ddq) + weighted_sum(dM_dt, dq))
        slopes.append(_quadratic_form(dM[:, :, i] / 2, dq) - g[i])  # ∂L/∂q_i = ½ q̇' ∂M/∂q_i q̇ - ∂P/∂q_i
    gamma_array = sympy.ImmutableDenseNDimArray(list(gamma.flat), gamma.shape)
    fields = equation_fields(
        coordinate_names, rate_names, matrix(M), gamma_array, C, matrix(c), g, matrix(tau),
        momenta, momentum_rates, slopes, only=_SUMMARY_STEPS,
    )  # fmt: skip
    lagrangian_step = Step("lagrangian", "K − P", ((Label("L"), L),))
    return {**fields, "lagrangian": L, "steps": (*_definition_steps(names), lagrangian_step, *fields["steps"])}


def _quadratic_form(A: Array, x: list[Any]) -> Any:
    """x' A x, written out."""
    return sympy.Add(*[A[j, k] * x[j] * x[k] for j, k in np.ndindex(A.shape)])


def _definition_steps(names: Definitions) -> list[Step]:
    """Definitions as steps, one for each group that has any."""
    steps = []
    later_starts = [start for _, _, start in names.groups[1:]]
    ends = [*later_starts, len(names.definitions)]  # a group ends where the next one starts
    for (name, remark, start), end in zip(names.groups, ends, strict=True):
        lines = []
        for symbol, expr in names.definitions[start:end]:
            lines.append((Label(symbol.name), expr))
        if lines:
            steps.append(Step(name, remark, tuple(lines)))
    return steps
