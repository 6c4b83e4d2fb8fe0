"""Impacts against the closed forms of the stated law: its restitution, its duration, and Coulomb's deceleration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import twistwrench as tw
from twistwrench.simulation import JointStops, Plane
from twistwrench.simulation.accuracy.contact_durations import ContactDurations


@pytest.fixture(scope="module")
def free():
    """A box of 6 kg without gravity: a point mass, where it is hit at its centre."""
    return tw.robots.floating_box().with_gravity([0, 0, 0])


@pytest.fixture(scope="module")
def box():
    return tw.robots.floating_box()


def restitution(c, v):
    """e of c v - ln(1 + c v) = -c e v - ln(1 - c e v): the energy integral of the law, written down once more."""
    return brentq(
        lambda e: c * v - np.log1p(c * v) + c * e * v + np.log1p(-c * e * v), 0.0, min(1.0, 0.999999 / (c * v))
    )


@pytest.mark.parametrize("v", [0.5, 3.0])
@pytest.mark.parametrize("c", [0.1, 1.0])
@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_an_impact_gives_back_the_speed_that_the_law_says(free, v, c, exponent):
    """Whatever stiffness and exponent: only c v counts. 1e-6 is what some hundred steps of 1e-10 in a contact add up to."""
    plane = Plane("box", normal=[0, 0, 2], height=-0.1, stiffness=1e5, exponent=exponent, dissipation=c)
    found = free.simulate(None, [0, 0, 0, 0.2, 0, -v], 0.2 + 0.1 / v, 1e-3, contacts=plane, rtol=1e-10)
    assert found.dq[-1, 5] == pytest.approx(restitution(c, v) * v, rel=1e-6)
    assert found.dq[-1, 3] == pytest.approx(0.2, abs=1e-12)
    lost = 3.0 * v**2 * (1 - restitution(c, v) ** 2)
    assert found.work["contacts"][-1] == pytest.approx(-lost, rel=1e-5)
    assert found.relative_drift < 1e-8
    (touch,) = found.events
    assert touch.time == pytest.approx(0.1 / v, abs=1e-9)
    assert touch.name == "box touches the plane"


def test_a_linear_contact_without_loss_lasts_half_a_period(free):
    """π √(m / k); and all of the energy comes back."""
    plane = Plane("box", height=0.0, stiffness=6e3, exponent=1.0)
    found = free.simulate(None, [0, 0, 0, 0, 0, -1.0], 0.2, 1e-4, contacts=plane, rtol=1e-11)
    inside = found.q[:, 6] < 0
    period = np.pi * np.sqrt(6.0 / 6e3)
    assert found.times[inside].max() == pytest.approx(period, abs=1.1e-4)
    assert found.q[:, 6].min() == pytest.approx(-np.sqrt(6.0 / 6e3), abs=1e-6)
    assert found.dq[-1, 5] == pytest.approx(1.0, abs=1e-7)


def test_a_ball_bounces_back_to_where_it_was_dropped(box):
    plane = Plane("box", stiffness=1e6)
    q0 = box.coordinates(root_joint=[1, 0, 0, 0, 0, 0, 0.5])
    found = box.simulate(q0, None, 1.8, 1e-3, contacts=plane, rtol=1e-10)
    period = 2 * np.sqrt(2 * 0.5 / 9.81)
    tops = found.times[1:-1][(found.q[1:-1, 6] > found.q[:-2, 6]) & (found.q[1:-1, 6] >= found.q[2:, 6])]
    np.testing.assert_allclose(found.q[np.isin(found.times, tops), 6], 0.5, atol=1e-5)
    assert len(tops) == 2
    assert tops[0] > period  # the contact takes its time too
    assert found.relative_drift < 1e-7


def test_a_sliding_point_is_slowed_by_mu_g_and_then_creeps_below_the_slip_speed(box):
    """A point at the centre of mass, so that nothing turns: x = v t - ½ μ g t², to the share of slip speed in v."""
    plane = Plane("box", stiffness=1e5, dissipation=1.0, friction=0.3, slip=1e-3)
    depth = (6 * 9.81 / 1e5) ** (1 / 1.5)
    q0 = box.coordinates(root_joint=[1, 0, 0, 0, 0, 0, -depth])
    found = box.simulate(q0, [0, 0, 0, 1.2, 1.6, 0], 0.8, 0.01, contacts=plane, rtol=1e-8)
    t = found.times[found.times < 0.6]
    speed = np.linalg.norm(found.dq[:, 3:5], axis=1)
    np.testing.assert_allclose(speed[: len(t)], 2.0 - 0.3 * 9.81 * t, atol=1e-4)
    np.testing.assert_allclose(found.dq[: len(t), 3] / speed[: len(t)], 0.6, atol=1e-9)
    assert speed[-1] < 1e-4


def test_a_box_comes_to_rest_on_its_corners_and_its_energy_is_accounted_for(box):
    corners = [[x, y, z] for x in (-0.15, 0.15) for y in (-0.1, 0.1) for z in (-0.05, 0.05)]
    plane = Plane("box", corners, stiffness=1e5, dissipation=0.5, friction=0.6)
    q0 = box.coordinates(root_joint=[1, 0, 0, 0, 0, 0, 0.3])
    found = box.simulate(q0, [1.0, 2.0, 0.5, 0.1, 0, 0], 2.0, 0.01, contacts=plane, rtol=1e-6)
    assert np.abs(found.dq[-1]).max() < 0.05
    sunk = (6 * 9.81 / 4 / 1e5) ** (1 / 1.5)
    height = {0.05, 0.1, 0.15}
    assert min(abs(found.q[-1, 6] - (h - sunk)) for h in height) < 1e-3
    assert found.relative_drift < 1e-4


def test_each_contact_begins_when_its_own_points_touch(box):
    """Two planes of one box that falls and does not turn: their points touch the ground one after the other."""
    low = Plane("box", [[0, 0, -0.05]], stiffness=1e3, dissipation=0.5)
    high = Plane("box", [[0, 0, 0.05]], stiffness=1e3, dissipation=0.5)
    q0 = box.coordinates(root_joint=[1, 0, 0, 0, 0, 0, 0.3])
    for contacts in ([low, high], [high, low]):
        found = box.simulate(q0, None, 0.3, 1e-3, contacts=contacts)
        first = found.events[0]
        assert first.time == pytest.approx(np.sqrt(2 * 0.25 / 9.81), rel=1e-6)
        assert first.q[6] == pytest.approx(0.05, abs=1e-9)
        assert len(found.events) == 2
        assert found.events[1].q[6] == pytest.approx(-0.05, abs=1e-9)


@pytest.mark.parametrize(("method", "allowed"), [("variational", 1e-5), ("midpoint", 1e-3), ("rk4", 1e-2)])
def test_fixed_steps_carry_through_a_stiff_contact_with_friction(box, method, allowed):
    """Friction eased off within 1 cm/s is stiff against 1 ms: implicit steps find their balance all the same."""
    corners = [[x, y, z] for x in (-0.15, 0.15) for y in (-0.1, 0.1) for z in (-0.05, 0.05)]
    plane = Plane("box", corners, stiffness=1e5, dissipation=0.3, friction=0.5)
    q0 = box.coordinates(root_joint=[1, 0, 0, 0, 0, 0, 0.2])
    found, wanted = (box.simulate(q0, [1, 2, 0.5, 0, 0, 0], 0.25, contacts=plane, method=m) for m in (method, "dopri5"))
    assert found.relative_drift < allowed
    assert found.work["contacts"][-1] < -1.0
    assert found.events[0].time == pytest.approx(wanted.events[0].time, abs=1e-6)
    np.testing.assert_allclose(found.q[-1], wanted.q[-1], atol=1e-2)  # a touch within a step costs it its order


@pytest.mark.parametrize("c", [0.0, 0.5])
def test_a_joint_stop_gives_back_the_speed_that_the_law_says(c):
    """The elbow of a planar arm runs into its stop alone; the shoulder is locked."""
    panda = tw.robots.panda().with_gravity([0, 0, 0])
    alone = panda.lock(
        {n: float(x) for n, x in zip(panda.joint_names, panda.neutral, strict=True) if n != "panda_joint4"}
    )
    low, high = alone.limits.lower[0], alone.limits.upper[0]
    found = alone.simulate([high - 0.1], [2.0], 0.15, 1e-3, contacts=JointStops(1e5, dissipation=c), rtol=1e-10)
    wanted = -2.0 * (restitution(c, 2.0) if c else 1.0)
    assert found.dq[-1, 0] == pytest.approx(wanted, rel=1e-6)
    assert found.q.max() > high > low
    back = alone.simulate([low + 0.1], [-2.0], 0.15, 1e-3, contacts=JointStops(1e5, dissipation=c), rtol=1e-10)
    assert back.dq[-1, 0] == pytest.approx(-wanted, rel=1e-6)
    assert found.events[0].time == pytest.approx(0.05, abs=1e-9)


def test_stops_of_some_joints_leave_the_others_alone():
    panda = tw.robots.panda()
    q0 = panda.random_configuration(1)
    some = panda.simulate(q0, None, 0.8, 0.01, contacts=JointStops(1e4, joints=("panda_joint2",)))
    free = panda.simulate(q0, None, 0.8, 0.01)
    k = panda.joint_names.index("panda_joint2")
    assert abs(free.q[-1, k]) > abs(panda.limits.upper[k])
    assert np.abs(some.q[:, k]).max() < panda.limits.upper[k] + 0.1


def test_a_leg_pushes_back_through_jacobian_and_frame():
    """The force of the plane on a robot at rest is what statics says: J'F of the same wrench."""
    dog = tw.robots.quadruped()
    foot = next(n for n in dog.frame_names if "foot" in n)
    from twistwrench.simulation.contact import PlaneContact

    q = dog.random_configuration(1)
    T = dog.forward_kinematics(q, foot)
    plane = Plane(foot, [0.01, 0.02, 0.03], height=float((T @ [0.01, 0.02, 0.03, 1])[2]) + 0.01, stiffness=1e4)
    f = T[:3, :3].T @ [0, 0, 1e4 * 0.01**1.5]
    wanted = dog.wrench_torques(q, np.r_[np.cross([0.01, 0.02, 0.03], f), f], foot)
    np.testing.assert_allclose(PlaneContact(dog, plane).torques(q, np.zeros(dog.nv)), wanted, atol=1e-10)


@pytest.mark.parametrize("speed", [-1.5, -0.2, 0.0, 0.3], ids="normal velocity {}".format)
@pytest.mark.parametrize("seed", range(3))
def test_friction_is_along_the_plane_whatever_the_velocity_across_it(box, seed, speed):
    """A corner slides, spins and sinks into a tilted plane, or comes out of it; all is worked out from ddq here.

    The one contact force f at the corner p is what inverse dynamics says (m = p x f). Its part along the normal is the law of
    the depth alone, f_n = k d^1.5 (1 + c d'); the rest opposes the slip v_t = v - (v.n) n and is mu f_n |v_t| / sqrt(v_t^2 + s^2).
    """
    rng = np.random.default_rng(seed)
    p, n = np.array([0.15, 0.1, -0.05]), np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    q0 = box.coordinates(root_joint=[*(x := rng.normal(size=4)) / np.linalg.norm(x), *rng.normal(size=3)])
    T = box.forward_kinematics(q0, "box")
    R, corner = T[:3, :3], (T @ [*p, 1.0])[:3]
    dq0 = rng.normal(size=6)
    v = R @ (dq0[3:] + np.cross(dq0[:3], p))
    dq0[3:] += R.T @ ((speed - v @ n) * n)  # across the plane: what the test asks for
    v += (speed - v @ n) * n
    k, c, mu, slip, depth = 2e4, 0.4, 0.7, 0.05, 0.01
    plane = Plane("box", p, normal=n, height=n @ corner + depth, stiffness=k, dissipation=c, friction=mu, slip=slip)
    found = box.simulate(q0, dq0, 1e-3, 1e-3, contacts=plane)
    F = box.inverse_dynamics(q0, dq0, found.ddq[0])
    f = R @ F[3:]
    np.testing.assert_allclose(F[:3], np.cross(p, F[3:]), atol=1e-9)
    wanted = k * depth**1.5 * (1 - c * speed)
    along = v - (v @ n) * n
    assert np.linalg.norm(along) > 0.1
    assert f @ n == pytest.approx(wanted, rel=1e-9)
    friction = -mu * wanted * along / np.sqrt(along @ along + slip**2)
    np.testing.assert_allclose(f - (f @ n) * n, friction, atol=1e-9 * wanted)


@pytest.mark.parametrize(("closed", "short"), [(1, 1), (2, 1), (3, 0)])
def test_a_contact_is_too_short_that_is_closed_at_no_more_than_two_ends_of_steps(closed, short):
    """It begins before the first of them and ends after the last: with two, within three steps."""
    durations = ContactDurations(["foot"])
    for k, gap in enumerate([0.1, *[-0.01] * closed, 0.1]):
        durations.step(0.01 * k, [gap], worked=gap < 0)
    assert durations.short == short
    assert ("over within three steps" in durations.remark(0.01)) == bool(short)


@pytest.mark.parametrize(("depth", "buried"), [(0.01, False), (0.02, True)])
def test_a_point_is_buried_where_its_contact_pushes_with_three_weights(depth, buried):
    """6 kg weigh 58.9 N, and k d^1.5 is 100 N and 283 N; k d^2.5 / 2.5 is stored."""
    box = tw.robots.floating_box()
    ground = Plane("box", stiffness=1e5)
    found = box.simulate(box.coordinates(root_joint=[1, 0, 0, 0, 0, 0, -depth]), None, 1e-3, contacts=ground)
    said = [remark for remark in found.remarks if "which throws the robot out" in remark]
    assert len(said) == buried
    assert all("2.26 J are in that contact" in remark for remark in said)
    assert f"{1e5 * 0.02**2.5 / 2.5:.3g}" == "2.26"
