"""The integrators: tables that prove themselves, orders measured by halving steps, and what the variational ones keep."""

from __future__ import annotations

import functools
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from quick import mostly_slow
from simulated import dop853, far, rates, run

import twistwrench as tw
from twistwrench.mechanics.bodies.inertia import COMPOSITIONS
from twistwrench.simulation import METHODS, Partitioned, Tableau
from twistwrench.simulation.forces import Manifold, System
from twistwrench.simulation.methods.schemes import scheme_of
from twistwrench.simulation.methods.tableaus import (
    DORMAND_PRINCE,
    EULER,
    IMPLICIT_EULER,
    MIDPOINT,
    RK4,
    SEMI_IMPLICIT_EULER,
    density,
    order,
    trees,
)
from twistwrench.testing import random_robot, random_state

ORDERS = {
    "euler": 1,
    "semi_implicit": 1,
    "midpoint": 2,
    "rk4": 4,
    "variational": 4,
    "dopri5": 5,
    "variational6": 6,
}
ROBOTS = {
    "one degree": lambda: tw.robots.planar_2r(),
    "floating": lambda: random_robot(4, joints=3, floating_base=True),
    "planar": lambda: random_robot(100, joints=3, kinds=("planar", "revolute")),
}


@pytest.fixture(scope="module", params=ROBOTS)
def case(request):
    """A robot, a state, and where the rates lead to in 0.4 s by DOP853 on rates written here."""
    robot = ROBOTS[request.param]()
    state = random_state(robot, 1)
    return robot, state, dop853(robot, state.q, state.dq, 0.4)


@pytest.mark.parametrize("method", METHODS)
def test_the_order_is_measured(case, method):
    """Halving the step divides the error by 2^order. Errors stay far above rounding, where the next terms still show a little:
    less than a quarter of an order is allowed below, less than three quarters above.
    """
    robot, state, wanted = case
    steps = {1: (128, 256), 2: (32, 64), 4: (16, 32), 5: (12, 24), 6: (6, 12)}[ORDERS[method]]
    errors = [far(robot, run(robot, state, 0.4, n, method), wanted) for n in steps]
    found = np.log2(errors[-2] / errors[-1])
    assert errors[-1] > 1e-13
    assert -0.25 < found - ORDERS[method] < 0.75, errors
    assert scheme_of(method, System(robot)).order == ORDERS[method]


@pytest.mark.parametrize("method", ["midpoint", "variational", "variational6"])
def test_a_constant_torque_does_the_work_of_its_angle(method):
    """On a wheel midpoint steps turn by h times the velocity of the torque's work, in each part of a composed step."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    found = wheel.simulate([0.0], [0.5], 1.0, 0.05, method=method, tau=[0.4])
    np.testing.assert_allclose(found.work["torques"], 0.4 * found.q[:, 0], rtol=0.0, atol=1e-13)


def test_orders_of_all_methods_are_claimed_above():
    assert set(ORDERS) == set(METHODS)


# ── tables ──


def test_trees_are_counted_and_weighed():
    assert [len(trees(n)) for n in range(1, 8)] == [1, 1, 2, 4, 9, 20, 48]
    for n in range(1, 7):
        assert all(order(t) == n for t in trees(n))
    tall, bushy = ((((),),),), ((), (), ())
    assert (density(tall), density(bushy)) == (24, 4)


@pytest.mark.parametrize("table", [EULER, IMPLICIT_EULER, MIDPOINT, RK4, DORMAND_PRINCE], ids=lambda t: t.name)
def test_any_changed_coefficient_is_noticed(table):
    """Each coefficient matters to some tree: but those of the last row of a method whose last stage is the next first one."""
    for i, row in enumerate(table.a[: -1 if table.first_same_as_last else None]):
        for j, x in enumerate(row):
            if x:
                changed = tuple(
                    r if k != i else (*r[:j], x + Fraction(1, 1000), *r[j + 1 :]) for k, r in enumerate(table.a)
                )
                if table.order > 1:
                    with pytest.raises(tw.ValueRangeError, match="order"):
                        replace(table, a=changed)
    for j, x in enumerate(table.b):
        if x:
            with pytest.raises(tw.ValueRangeError):
                replace(table, b=(*table.b[:j], x + Fraction(1, 1000), *table.b[j + 1 :]))


def test_claims_of_order_are_neither_too_high_nor_too_low():
    with pytest.raises(tw.ValueRangeError, match="not of order 5"):
        replace(RK4, order=5)
    with pytest.raises(tw.ValueRangeError, match="has order 4"):
        replace(RK4, order=3)
    with pytest.raises(tw.ValueRangeError, match="dense output of order 5"):
        replace(DORMAND_PRINCE, dense_order=5)
    with pytest.raises(tw.ValueRangeError, match="has no embedded step of order 5"):
        replace(DORMAND_PRINCE, embedded_order=5)
    with pytest.raises(tw.ValueRangeError, match="claims order 3 and has order 4"):
        replace(DORMAND_PRINCE, embedded_order=3)
    with pytest.raises(tw.ValueRangeError, match="does not end where the step does"):
        replace(DORMAND_PRINCE, dense=(*DORMAND_PRINCE.dense[1:], DORMAND_PRINCE.dense[0]))
    with pytest.raises(tw.ValueRangeError, match="square"):
        Tableau("odd", 1, a=((0, 0),), b=(1,))
    with pytest.raises(tw.ValueRangeError, match="claims order 2"):
        replace(SEMI_IMPLICIT_EULER, order=2)
    assert Partitioned("midpoint", 2, MIDPOINT, MIDPOINT).symplectic


def test_dormand_and_prince_as_in_scipy():
    from scipy.integrate import RK45

    rows, b, c, error, dense = DORMAND_PRINCE.numbers
    np.testing.assert_allclose(np.array([np.r_[r, np.zeros(5 - len(r))] for r in rows[:6]]), RK45.A, rtol=1e-15)
    np.testing.assert_allclose(b[:6], RK45.B, rtol=1e-15)
    np.testing.assert_allclose(c[:6], RK45.C, rtol=1e-15)
    np.testing.assert_allclose(error, -RK45.E, rtol=1e-13)
    np.testing.assert_allclose(dense, RK45.P, rtol=1e-15)


def test_what_is_symplectic_and_what_is_not():
    assert MIDPOINT.symplectic
    assert SEMI_IMPLICIT_EULER.symplectic
    assert not any(t.symplectic for t in (EULER, IMPLICIT_EULER, RK4, DORMAND_PRINCE))
    assert DORMAND_PRINCE.first_same_as_last
    assert not RK4.first_same_as_last
    assert RK4.explicit
    assert not MIDPOINT.explicit


def test_compositions_meet_their_conditions():
    """A symmetric composition of order p: symmetric, of sum 1, and without odd powers below p."""
    for p, fractions in COMPOSITIONS.items():
        assert np.allclose(fractions, fractions[::-1], atol=0)
        assert abs(sum(fractions) - 1) < 1e-15
        for power in range(3, p, 2):
            assert abs(sum(c**power for c in fractions)) < 1e-14


# ── the manifold ──


@pytest.mark.parametrize("seed", range(4))
def test_rates_of_coordinates_are_those_of_the_motion(seed):
    """They are the derivative of robot.add along dq."""
    robot = random_robot(seed, joints=5, floating_base=True, kinds=("planar", "floating", "revolute", "prismatic"))
    state, h = random_state(robot, seed), 1e-4
    out = np.zeros(robot.nq)
    Manifold(robot).rates(state.q, state.dq, out)
    steps = [
        (robot.add(state.q, s * h * state.dq) - robot.add(state.q, -s * h * state.dq)) / (2 * s * h) for s in (1, 2)
    ]
    np.testing.assert_allclose(out, (4 * steps[0] - steps[1]) / 3, atol=1e-10)
    np.testing.assert_allclose(out, rates(robot, state.q, state.dq), atol=1e-14)


# ── what is kept ──


@functools.cache
def weightless(seed):
    return random_robot(seed, joints=3, floating_base=True).with_gravity([0, 0, 0])


@pytest.mark.parametrize("method", ["midpoint", "variational"])
@pytest.mark.parametrize("seed", mostly_slow([3, 5], 2))
def test_momentum_of_a_floating_robot_is_kept_to_rounding(method, seed):
    """The spatial momentum is what no force changes: Noether's theorem holds for the step, however long it is."""
    robot = weightless(seed)
    state = random_state(robot, seed)
    before = robot.momentum(state.q, state.dq)
    q, dq = run(robot, state, 1.0, 20, method)
    np.testing.assert_allclose(robot.momentum(q, dq), before, atol=1e-12 * np.abs(before).max())
    q, dq = run(robot, state, 1.0, 20, "rk4")
    assert np.abs(robot.momentum(q, dq) - before).max() > 1e-9 * np.abs(before).max()


@pytest.mark.parametrize("method", ["midpoint", "variational", "variational6"])
def test_variational_steps_are_reversible(method):
    robot = tw.robots.planar_3r()
    state = random_state(robot, 2)
    q, dq = run(robot, state, 0.4, 20, method)
    back = run(robot, state._replace(q=q, dq=-dq), 0.4, 20, method)
    assert far(robot, (back[0], -back[1]), np.r_[state.q, state.dq]) < 1e-11


def test_variational_steps_keep_the_symplectic_form():
    """The Jacobian of (q, p) → (q', p') is a symplectic matrix; RK4's is not."""
    robot, h, e = tw.robots.planar_2r(), 0.1, 1e-5
    q0, dq0 = np.array([0.3, -0.8]), np.array([1.0, 2.0])
    J = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])

    def gap(method):
        def step(z):
            q, p = z[:2], z[2:]
            system = System(robot)
            y, rate = np.r_[q, np.linalg.solve(robot.mass_matrix(q), p), np.zeros(4)], np.zeros(system.size)
            system.rates(0.0, y, rate)
            y = scheme_of(method, system).step(0.0, y, h, rate)
            return np.r_[y[:2], robot.mass_matrix(y[:2]) @ y[2:4]]

        z = np.r_[q0, robot.mass_matrix(q0) @ dq0]
        D = np.array([(step(z + e * d) - step(z - e * d)) / (2 * e) for d in np.eye(4)]).T
        return np.abs(D.T @ J @ D - J).max()

    assert gap("midpoint") < 1e-8  # what is left is the differences' own error
    assert gap("variational") < 1e-8
    assert gap("rk4") > 1e-6
