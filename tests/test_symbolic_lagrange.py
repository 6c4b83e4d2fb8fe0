"""``lagrange``: systems worked by hand, coordinates that are no joint angles, and what is refused."""

from __future__ import annotations

import pytest
import sympy

import twistwrench as tw
from twistwrench.errors import ShapeError, ValueRangeError
from twistwrench.symbolic import derive, lagrange

m, M, R, l, g, k, Omega = sympy.symbols("m M R l g k Omega")
x, xdot, xddot = sympy.symbols("x xdot xddot")
y, ydot, yddot = sympy.symbols("y ydot yddot")
r, rdot, rddot = sympy.symbols("r rdot rddot")
theta, thetadot, thetaddot = sympy.symbols("theta thetadot thetaddot")
sin, cos = sympy.sin, sympy.cos


def same(one, other):
    return sympy.expand(one - other) == 0


def test_bead_on_a_hoop_that_turns():
    """By hand: m R² θ̈ - m R² Ω² sin θ cos θ + m g R sin θ; at rest where cos θ = g / (R Ω²)."""
    bead = lagrange(m * R**2 / 2 * (thetadot**2 + Omega**2 * sin(theta) ** 2) + m * g * R * cos(theta), theta)
    assert same(
        bead.tau[0], m * R**2 * thetaddot - m * R**2 * Omega**2 * sin(theta) * cos(theta) + m * g * R * sin(theta)
    )
    assert bead.mass_matrix[0, 0] == m * R**2
    assert bead.coriolis_forces[0] == 0
    assert same(bead.gravity_forces[0].subs(cos(theta), g / (R * Omega**2)), 0)


def test_bead_on_a_straight_wire_that_turns():
    """By hand: m r̈ - m Ω² r."""
    bead = lagrange(m / 2 * (rdot**2 + r**2 * Omega**2), r)
    assert same(bead.tau[0], m * rddot - m * Omega**2 * r)


def test_bead_on_a_parabola():
    """A mass matrix of a length: (1 + 4 a² x²) m ẍ + 4 m a² x ẋ² + 2 m g a x."""
    a = sympy.Symbol("a")
    bead = lagrange(m / 2 * (xdot**2 + (2 * a * x * xdot) ** 2) - m * g * a * x**2, x)
    assert same(bead.tau[0], m * (1 + 4 * a**2 * x**2) * xddot + 4 * m * a**2 * x * xdot**2 + 2 * m * g * a * x)
    assert same(bead.centripetal[0, 0], 4 * m * a**2 * x)


def test_cart_pole_by_hand():
    """A point mass on a massless pole, θ from upright: the equations of any textbook."""
    p = sympy.Matrix([x + l * sin(theta), l * cos(theta)])
    v = p.diff(x) * xdot + p.diff(theta) * thetadot
    system = lagrange(M * xdot**2 / 2 + m * v.dot(v) / 2 - m * g * l * cos(theta), [x, theta])
    assert same(system.tau[0], (M + m) * xddot + m * l * cos(theta) * thetaddot - m * l * sin(theta) * thetadot**2)
    assert same(system.tau[1], m * l * cos(theta) * xddot + m * l**2 * thetaddot - m * g * l * sin(theta))
    assert system.text("equations").splitlines()[1].strip() == "τ₁ = (m + M) ẍ + m l cos(θ) θ̈ − m l sin(θ) θ̇²"


def test_two_ways_to_the_same_arm():
    """The Lagrangian of a derivation, given back as any other."""
    arm = derive(tw.robots.planar_2r())
    again = lagrange(arm.lagrangian, arm.q)
    for one, other in (
        (again.tau, arm.tau),
        (again.mass_matrix, arm.mass_matrix),
        (again.gravity_forces, arm.gravity_forces),
    ):
        assert all(same(a, b) for a, b in zip(one, other, strict=True))


def test_polar_coordinates_have_coriolis_terms():
    planet = lagrange(m / 2 * (rdot**2 + r**2 * thetadot**2) + k / r, [r, theta])
    assert same(planet.tau[0], m * rddot - m * r * thetadot**2 + k / r**2)
    assert same(planet.tau[1], m * r**2 * thetaddot + 2 * m * r * rdot * thetadot)
    assert same(planet.coriolis[1, 0, 1], 2 * m * r)
    assert same(planet.centripetal[0, 1], -m * r)


def test_forces_linear_in_the_rates_stay():
    """A charge in a magnetic field: B neither in M, nor in c, nor in g."""
    B = sympy.Symbol("B")
    charge = lagrange(m / 2 * (xdot**2 + ydot**2) + B / 2 * (x * ydot - y * xdot), [x, y])
    assert same(charge.tau[0], m * xddot - B * ydot)
    assert same(charge.tau[1], m * yddot + B * xdot)
    assert all(entry == 0 for entry in charge.coriolis_forces)


def test_rates_of_other_names_and_any_function():
    w = sympy.Symbol("w")
    spring = lagrange(m / 2 * sympy.exp(2 * x) * w**2 - k * sympy.sqrt(1 + x**2), x, rates=[w])
    assert same(spring.tau[0], m * sympy.exp(2 * x) * (xddot + w**2) + k * x / sympy.sqrt(1 + x**2))


def test_source_takes_the_constants_as_numbers():
    bead = lagrange(m / 2 * (rdot**2 + r**2 * Omega**2), r, name="bead")
    tau = bead.function("inverse_dynamics")([[0.5]], [[1.0]], [[2.0]], {"m": 3.0, "Omega": 4.0})
    assert tau.tolist() == [[3.0 * 2.0 - 3.0 * 16.0 * 0.5]]


def test_what_is_no_lagrangian_is_refused():
    t = sympy.Symbol("t")
    q = sympy.Function("q")(t)
    with pytest.raises(ValueRangeError, match=r"q\(t\).*symbols"):
        lagrange(m / 2 * q.diff(t) ** 2 + xdot, x)
    with pytest.raises(ValueRangeError, match="does not depend on xdot"):
        lagrange(m * x**2, x)
    with pytest.raises(ValueRangeError, match="degree two"):
        lagrange(m * xdot**4, x)
    with pytest.raises(ShapeError, match="q="):
        lagrange(m * xdot**2, q)
    with pytest.raises(ShapeError, match="rates="):
        lagrange(m * xdot**2, [x, y], rates=[xdot])
    with pytest.raises(ShapeError, match="rates="):
        lagrange(m * xdot**2, [x], rates=[x])
    with pytest.raises(ShapeError, match="expression"):
        lagrange("m * (", x)
