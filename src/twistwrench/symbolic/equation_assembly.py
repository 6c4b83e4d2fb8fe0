"""From terms as sums of products to equations as SymPy expressions, with the steps in the order of the book."""

from __future__ import annotations

from typing import Any

from .equations import Label, Line, Step
from .expanded_form import Terms
from .factored_form import EquationWriter
from .trig_sum import TrigSum

STEPS = {
    "momenta": "the derivatives of L with respect to the rates",
    "explicit_time": "what of their rates is due to time alone",
    "momentum_rates": "their derivatives with respect to time",
    "slopes": "the derivatives of L with respect to the coordinates",
    "mass_matrix": "M, symmetric: what multiplies the accelerations",
    "christoffel": "Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i), those that are not zero, j ≤ k",
    "centripetal": "what multiplies the squared rates, by torque and joint: Γ_ijj",
    "coriolis": "what multiplies the products of two rates, by torque and joints: 2 Γ_ijk",
    "coriolis_matrix": "C_ij = Σ Γ_ijk q̇_k: dM/dt − 2C is skew",
    "gravity_forces": "g, what is left at rest",
    "equations": "d/dt ∂L/∂q̇ − ∂L/∂q, the equations of motion",
}
"""Name and remark of the steps after the Lagrangian, in order."""


def entry_name(letter: str, *indices: int) -> str:
    """M, 0, 1 → M_12; indices beyond nine are kept apart."""
    apart = "_" if max(indices) > 8 else ""
    return f"{letter}_{apart.join(str(i + 1) for i in indices)}"


def assembled(terms: Terms, writer: EquationWriter) -> dict[str, Any]:
    """The fields of :class:`~twistwrench.symbolic.equations.Equations` that follow from K and P."""
    import sympy

    n, ring = len(terms.coordinates), terms.ring
    rates = [c.rate for c in terms.coordinates]
    motions = [*rates, *(c.acceleration for c in terms.coordinates)]
    speed, push = (
        [ring.symbol(c.rate) for c in terms.coordinates],
        [ring.symbol(c.acceleration) for c in terms.coordinates],
    )
    L = terms.kinetic - terms.potential

    def moving(total: TrigSum) -> Any:
        return writer.by_motion(total, motions, writer.by_angle)

    def energetic(total: TrigSum) -> Any:
        return writer.by_motion(total, motions, writer.by_mass)

    def rate(total: TrigSum) -> TrigSum:
        found = terms.zero
        for c, v, a in zip(terms.coordinates, speed, push, strict=True):
            found = found + total.diff(c.name) * v + total.diff(c.rate) * a
        return found

    M, gamma, g = terms.mass_matrix, terms.christoffel, terms.gravity_forces
    C = [[sum((gamma[i, j, k] * speed[k] for k in range(n)), terms.zero) for j in range(n)] for i in range(n)]
    c = [sum((C[i][j] * speed[j] for j in range(n)), terms.zero) for i in range(n)]
    momenta = [L.diff(name) for name in rates]
    slopes = [L.diff(x.name) for x in terms.coordinates]
    written_M = sympy.ImmutableMatrix(n, n, lambda i, j: writer.by_mass(M[min(i, j), max(i, j)]))
    written_gamma = sympy.ImmutableDenseNDimArray(
        [[[writer.by_angle(x) for x in row] for row in block] for block in gamma]
    )
    written_C = sympy.ImmutableMatrix(n, n, lambda i, j: moving(C[i][j]))
    written_c = sympy.ImmutableMatrix([moving(x) for x in c])
    written_g = sympy.ImmutableMatrix([writer.by_angle(x) for x in g])
    ddq = [writer.symbols[x.acceleration] for x in terms.coordinates]
    inertial = [sympy.Add(*(written_M[i, j] * ddq[j] for j in range(n))) for i in range(n)]
    # Whatever L has beside ½ q̇'M q̇ and its potential: terms linear in the rates push too.
    rest = []
    for p, s, c_i, g_i, i in zip(momenta, slopes, c, g, range(n), strict=True):
        accelerated = sum((M[i, j] * push[j] for j in range(n)), terms.zero)
        rest.append((rate(p) - s - accelerated - c_i - g_i).without_dust(0.0))
    tau = sympy.ImmutableMatrix(
        [a + b + d + moving(e) for a, b, d, e in zip(inertial, written_c, written_g, rest, strict=True)]
    )
    lines: dict[str, list[Line]] = {
        "momenta": [(Label("L", x), energetic(p)) for x, p in zip(rates, momenta, strict=True)],
        "momentum_rates": [(Label("L", x, rate=True), energetic(rate(p))) for x, p in zip(rates, momenta, strict=True)],
        "slopes": [(Label("L", x.name), moving(s)) for x, s in zip(terms.coordinates, slopes, strict=True)],
        **term_lines(written_M, written_gamma, written_C, written_g),
        "equations": [(Label(entry_name("tau", i)), tau[i]) for i in range(n)],
    }
    return {
        "lagrangian": energetic(L),
        "mass_matrix": written_M,
        "christoffel": written_gamma,
        "coriolis_matrix": written_C,
        "coriolis_forces": written_c,
        "gravity_forces": written_g,
        "tau": tau,
        "split": all(not e.terms for e in rest),
        "steps": steps_of(lines),
    }


def steps_of(lines: dict[str, list[Line]]) -> tuple[Step, ...]:
    """Those steps of :data:`STEPS` that have lines."""
    return tuple(Step(name, STEPS[name], tuple(lines[name])) for name in STEPS if lines.get(name))


def term_lines(M: Any, gamma: Any, C: Any, g: Any) -> dict[str, list[Line]]:
    """The lines of the named terms."""
    n = M.shape[0]
    triples = [(i, j, k) for i in range(n) for j in range(n) for k in range(j, n) if gamma[i, j, k] != 0]
    return {
        "mass_matrix": [(Label(entry_name("M", i, j)), M[i, j]) for i in range(n) for j in range(i, n)],
        "christoffel": [(Label(entry_name("Gamma", *t)), gamma[t]) for t in triples],
        "centripetal": [(Label(entry_name("b", i, j)), gamma[i, j, k]) for i, j, k in triples if j == k],
        "coriolis": [(Label(entry_name("b", i, j, k)), 2 * gamma[i, j, k]) for i, j, k in triples if j < k],
        "coriolis_matrix": [
            (Label(entry_name("C", i, j)), C[i, j]) for i in range(n) for j in range(n) if C[i, j] != 0
        ],
        "gravity_forces": [(Label(entry_name("g", i)), g[i]) for i in range(n)],
    }
