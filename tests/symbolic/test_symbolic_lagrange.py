"""``lagrange``: systems worked by hand, coordinates that are not joint angles, and what is refused."""

from __future__ import annotations

import pytest
import sympy

import twistwrench as tw
from twistwrench.core.errors import ShapeError, UnknownNameError, ValueRangeError
from twistwrench.symbolic import derive, lagrange

m, M, R, l, g, k, Omega, t = sympy.symbols("m M R l g k Omega t")
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


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_equations_split_into_M_c_and_g_only_if_those_of_every_coordinate_do(order):
    """At x, y and z in turn: a momentum A t, a growing mass and a field are outside M, c and g; time in a force at rest is in g."""
    z, zdot = sympy.symbols("z zdot")
    chosen, rates = (tuple(of[k] for k in order) for of in ((x, y, z), (xdot, ydot, zdot)))
    plain = m / 2 * (xdot**2 + ydot**2 + zdot**2)
    for extra, splits in {
        R * t * rates[0]: False,
        (1 + t**2) * rates[0] ** 2: False,
        sympy.exp(chosen[0]) * rates[1]: False,
        sympy.exp(chosen[0]) * rates[0]: True,  # d/dt of a function of coordinates
        R * t * chosen[0]: True,
        sympy.exp(chosen[0]) * rates[1] ** 2: True,
    }.items():
        free = lagrange(plain + extra, [x, y, z], time=t)
        rest = sympy.Matrix(free.tau) - free.mass_matrix * sympy.Matrix(free.ddq)
        rest -= sympy.Matrix(free.coriolis_forces) + sympy.Matrix(free.gravity_forces)
        assert (rest.expand() == sympy.zeros(3, 1)) == splits == free.split
        assert ("h has terms besides c and g" in free.c_source()) == (not splits)


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


# ── explicit time ──

A, w = sympy.symbols("A w")
driven = m / 2 * (xdot + A * w * cos(w * t)) ** 2 - k * x**2 / 2


def test_a_base_that_shakes():
    """By hand: m ẍ − m A ω² sin ωt + k x; what is due to time alone is a step of its own."""
    shaken = lagrange(driven, x, time=t)
    assert same(shaken.tau[0], m * xddot - m * A * w**2 * sin(w * t) + k * x)
    (line,) = shaken.step("explicit_time").lines
    assert same(line[1], -m * A * w**2 * sin(w * t))
    assert "∂/∂t ∂L/∂ẋ = −m A w² sin(w t)" in shaken.text("explicit_time")
    assert r"\frac{\partial}{\partial t} \frac{\partial L}{\partial \dot{x}}" in shaken.latex("explicit_time")
    assert "<math>" in shaken.html("explicit_time")
    number = shaken.function("inverse_dynamics")([0.1], [0.2], [0.3], {"m": 2, "A": 1, "w": 2, "k": 3, "t": 0.5})
    assert number[0] == pytest.approx(2 * 0.3 - 2 * 4 * float(sin(1.0)) + 3 * 0.1, rel=1e-14)


@pytest.mark.parametrize(
    "L",
    [
        driven,
        m * (1 + t**2) * xdot**2 / 2 - k * x**2 / 2,  # a mass that grows
        m / 2 * (xdot**2 + ydot**2) + A * t * (x * ydot - y * xdot) - k * x * y * cos(w * t),  # a field that does
        m * t * cos(x) * xdot * ydot + m * (xdot**2 + ydot**2) / 2 + A * x * y,
    ],
)
def test_explicit_time_is_what_sympy_finds(L):
    """Against ``sympy.calculus.euler``, whose coordinates are functions of time."""
    coordinates = [x, y] if L.has(ydot) else [x]
    functions = {s: sympy.Function(s.name)(t) for s in coordinates}
    mine = lagrange(L, coordinates, time=t)
    dotted = zip(mine.q, mine.dq, mine.ddq, strict=True)
    back = [(f.diff(t, n), s[n]) for s in dotted for f in [functions[s[0]]] for n in (2, 1, 0)]
    of_time = L.subs([(v, functions[s].diff(t)) for s, v in zip(mine.q, mine.dq, strict=True)]).subs(functions)
    wanted = sympy.calculus.euler.euler_equations(of_time, list(functions.values()), t)
    for one, equation in zip(mine.tau, wanted, strict=True):
        assert same(one, -(equation.lhs - equation.rhs).doit().subs(back))


def test_a_time_that_L_does_not_have_changes_nothing():
    still = lagrange(m * xdot**2 / 2 - k * x**2 / 2, x, time=t)
    assert still.text() == lagrange(m * xdot**2 / 2 - k * x**2 / 2, x).text()


@pytest.mark.parametrize(
    ("factor", "text"), [(1.0, "m"), (-1.0, "−m"), (2.0, "2 m"), (0.5, "0.5 m"), (sympy.Rational(1, 2), "½ m")]
)
def test_a_factor_of_one_is_not_written_be_it_a_decimal(factor, text):
    slide = lagrange(factor * m * xdot**2 / 2, x)
    assert slide.text("mass_matrix").splitlines()[-1] == f"  M₁₁ = {text}"
    assert slide.latex("mass_matrix").count("1 \\,") == 0


@pytest.mark.parametrize("length", [sympy.sqrt(xdot**2), sympy.sqrt(x**2 * xdot**2), sympy.sqrt((xdot - R) ** 2)])
def test_a_momentum_that_jumps_has_no_mass_matrix(length):
    """The momentum of √ẋ² is ẋ / √ẋ², 1 or -1: its derivative vanishes on both sides of the jump, as a mass matrix must not."""
    for L in (m * length, m * xdot**2 / 2 + k * length):
        with pytest.raises(ValueRangeError, match="degree two"):
            lagrange(L, x)


def test_a_momentum_may_be_written_with_a_sum_below_it():
    """(a ẋ² + x ẋ²) / (a + x) is ẋ²; the force of c(x) ẋ alone vanishes."""
    body = lagrange(m * (R * xdot**2 + x * xdot**2) / (2 * (R + x)) + k * xdot * sympy.exp(x), x)
    assert sympy.simplify(body.tau[0] - m * xddot) == 0


@pytest.mark.parametrize(
    ("L", "words"),
    [
        (driven, ["contains t", "time=t"]),
        (m * (xdot**2 + ydot**2) / 2, ["ydot", "q=x", "rates"]),  # a coordinate forgotten
        (m * xdot**2 / 2 + xddot * x, ["xddot", "order"]),
        (m * xdot**2 / 2 + yddot, ["yddot"]),
        (m * xdot**2 / 2 + sympy.Symbol("thetadot_1"), ["thetadot_1"]),
        (m * xdot**2 / 2 + sympy.Symbol("theta_1dot"), ["theta_1dot"]),
        (m * xdot**2 / 2 + sympy.Symbol("x", real=True), ["another x", "assumptions"]),
    ],
)
def test_what_would_silently_be_a_constant_is_refused(L, words):
    with pytest.raises(ValueRangeError) as refused:
        lagrange(L, x)
    assert all(word in str(refused.value) for word in words), refused.value


def test_time_is_a_symbol_of_its_own():
    for time in ("t", x, xdot, 0.5):
        with pytest.raises(ShapeError, match="time="):
            lagrange(m * xdot**2, x, time=time)
    clock = lagrange(m * sympy.Symbol("tdot") ** 2 / 2 + k * t, t)  # a coordinate of that name is one
    assert same(clock.tau[0], m * sympy.Symbol("tddot") - k)


# ── constants of the source ──


def test_constants_that_are_missing_or_unknown_are_named():
    inverse_dynamics = lagrange(m / 2 * (rdot**2 + r**2 * Omega**2), r).function("inverse_dynamics")
    with pytest.raises(ValueRangeError, match=r"no number for Omega\. All are wanted: Omega, m"):
        inverse_dynamics([0.5], [1.0], [2.0], {"m": 3.0})
    with pytest.raises(ValueRangeError, match="Omega, m"):
        inverse_dynamics([0.5], [1.0], [2.0])
    with pytest.raises(UnknownNameError, match=r"'omega'.*Did you mean 'Omega'"):
        inverse_dynamics([0.5], [1.0], [2.0], {"m": 3.0, "Omega": 4.0, "omega": 4.0})
    with pytest.raises(ShapeError, match="dict"):
        inverse_dynamics([0.5], [1.0], [2.0], [3.0, 4.0])
    assert inverse_dynamics([0.5], [1.0], [2.0], parameters={m: 3.0, Omega: 4.0}).tolist() == [-18.0]


def test_constants_of_a_robot_are_all_or_none():
    gravity_forces = derive(tw.robots.planar_2r()).function("gravity_forces")
    assert gravity_forces([0.0, 0.0]) == pytest.approx([29.43, 9.81], rel=1e-15)
    with pytest.raises(ValueRangeError, match="L_1, L_2, m_1, g"):
        gravity_forces([0.0, 0.0], {"m_2": 3})
    with pytest.raises(UnknownNameError, match="m_7"):
        gravity_forces([0.0, 0.0], {"m_7": 3})


@pytest.mark.parametrize("q", [[[x, theta]], [sympy.Matrix([x])], [x, x], []])
def test_what_is_no_row_of_different_symbols_is_one_error(q):
    with pytest.raises(ShapeError, match="not different SymPy symbols"):
        lagrange(m * xdot**2 / 2, q)
