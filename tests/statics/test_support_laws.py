"""Laws of margins: what may be changed about a robot and its ground without a margin noticing, and bolted feet."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_feet import biped_text

import twistwrench as tw
from twistwrench import statics
from twistwrench.mechanics.lie import quaternion

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

LEGS = ("FL", "FR", "RL", "RR")
MARGINS = ("speed", "slowest", "friction", "zmp_margin", "payload")


def dog(text=None):
    """The quadruped thrown forward and sideways at two instants, and turned about its yaw axis."""
    robot = tw.robots.quadruped() if text is None else tw.load(text, floating_base=True)
    angles = {f"{leg}_{k}_joint": a for leg in LEGS for k, a in (("hip", 0.1), ("thigh", 0.8), ("calf", -1.6))}
    q = np.repeat(robot.coordinates(**angles)[None], 3, axis=0)
    rates = np.random.default_rng(4).uniform(-1, 1, (2, 3, robot.nv))
    rates[:, :, 3:6] *= 2
    contacts = [statics.Contact(frame=f"{leg}_foot", friction=0.6 + 0.1 * k) for k, leg in enumerate(LEGS)]
    return robot, q, *rates, contacts


def margins(robot, q, dq, ddq, contacts):
    found = statics.support(robot, q, dq, ddq, contacts, payload_frame="trunk")
    return found, {name: getattr(found, name) for name in MARGINS}


def same(one, other, **scaled):
    for name in MARGINS:
        assert_allclose(other[name], scaled.get(name, 1.0) * one[name], rtol=1e-6, atol=1e-9, err_msg=name)


def test_turning_the_world_about_the_vertical_changes_no_margin():
    robot, q, dq, ddq, contacts = dog()
    before, one = margins(robot, q, dq, ddq, contacts)
    turn = tw.so3.exp([0, 0, 0.7])
    turned = q.copy()
    half = np.array([np.cos(0.35), 0, 0, np.sin(0.35)])
    w, x, y, z = q[:, :4].T
    a, _, _, d = half
    turned[:, :4] = np.stack([a * w - d * z, a * x - d * y, a * y + d * x, a * z + d * w], axis=1)
    turned[:, 4:7] = q[:, 4:7] @ turn.T
    after, other = margins(robot, turned, dq, ddq, contacts)
    same(one, other)
    holds = before.holds
    assert (after.holds == holds).all()
    assert_allclose(after.forces[holds], before.forces[holds] @ turn.T, atol=1e-6)


def test_the_order_of_contacts_changes_no_margin():
    robot, q, dq, ddq, contacts = dog()
    order = [2, 0, 3, 1]
    before, one = margins(robot, q, dq, ddq, contacts)
    after, other = margins(robot, q, dq, ddq, [contacts[k] for k in order])
    same(one, other)
    assert_allclose(after.forces[before.holds], before.forces[before.holds][:, order], atol=1e-6)


def test_masses_twice_as_large_double_forces_and_payload_and_change_no_other_margin():
    text = tw.robots.path_of("quadruped").read_text()

    def doubled(found):
        return re.sub(r'(="|^)([-+\d.eE]+)(?=")', lambda x: f"{x[1]}{2 * float(x[2])!r}", found[0])

    heavy = re.sub(r"<mass[^>]*>|<inertia [^>]*>", doubled, text)
    before, one = margins(*dog(text))
    after, other = margins(*dog(heavy))
    same(one, other, payload=2.0)
    assert_allclose(after.forces[before.holds], 2 * before.forces[before.holds], atol=1e-6)


def test_a_mirrored_motion_has_the_margins_of_the_motion():
    """The quadruped is symmetric about its xz plane: hips, lateral velocities and turns about x and z change their signs."""
    robot, q, dq, ddq, contacts = dog()
    names, places = list(robot.model.velocity_names), {}
    for k, name in enumerate(names[6:]):
        other = {"L": "R", "R": "L"}[name[1]]
        places[k] = names[6:].index(name[0] + other + name[2:])
    sign = np.array([-1.0 if "hip" in name else 1.0 for name in names[6:]])
    order = np.array([places[k] for k in range(12)])

    def mirrored(x):
        return np.column_stack([x[:, :6] * [-1, 1, -1, 1, -1, 1], (x[:, 6:] * sign)[:, order]])

    turned = np.column_stack([q[:, :7] * [1, -1, 1, -1, 1, -1, 1], (q[:, 7:] * sign)[:, order]])
    swapped = [
        statics.Contact(frame=c.frame.replace("L_", "x_").replace("R_", "L_").replace("x_", "R_"), friction=c.friction)
        for c in contacts
    ]
    _, one = margins(robot, q, dq, ddq, contacts)
    _, other = margins(robot, turned, mirrored(dq), mirrored(ddq), swapped)
    for name in MARGINS:  # the file's inertias are symmetric to their printed digits
        assert_allclose(other[name], one[name], rtol=5e-3, atol=1e-3, err_msg=name)


def test_a_bolted_foot_has_the_torques_of_a_constraint(tmp_path):
    """Bolts that never open: the same torques as the closed robot, along a squat; the free root bears none."""
    path = tmp_path / "biped.urdf"
    path.write_text(biped_text())
    held, free = tw.load(path), tw.load(path, floating_base=True)
    t = np.linspace(0, 1, 21)
    bend = 0.4 + 0.2 * np.sin(2 * np.pi * t)
    joints = tw.Motion(t, bend[:, None] * np.array([-1, 2, -1, -0.9, 1.7, -0.8]), robot=held, in_seconds=True)
    motion = statics.base_from_stance(free, joints, ("left_foot", "right_foot"), "left_foot")
    bolts = [
        statics.Contact(c.point, c.normal, 1.0, c.frame, pull=5000.0) for c in statics.sole(free, "left_foot", 1.0)
    ]
    found = statics.support(free, motion.q, motion.dq, motion.ddq, bolts)
    assert found.holds.all()
    pose = np.asarray(free.forward_kinematics(motion.q[0], "left_foot"))
    closed = free.close("ground", "left_foot", pose=pose, near=motion.q[0])
    for k in (0, 7, 13):
        tau = closed.inverse_dynamics(motion.q[k], motion.dq[k], motion.ddq[k]).tau
        assert_allclose(np.asarray(tau)[6:], found.torques[k, 6:], atol=1e-7)
        assert_allclose(np.asarray(tau)[:6], 0.0, atol=1e-9)


@pytest.mark.slow
def test_equilibrium_at_rest_and_support_agree_on_500_poses():
    rng = np.random.default_rng(7)
    robot, q, *_ = dog()
    q = np.repeat(q[:1], 500, axis=0)
    q[:, 7:] += rng.uniform(-0.5, 0.5, (500, 12))
    q[:, :4] = quaternion.from_matrix(tw.so3.exp(rng.uniform(-0.6, 0.6, (500, 3))))
    contacts = [statics.Contact(frame=f"{leg}_foot", friction=0.5) for leg in LEGS]
    zero = np.zeros((500, robot.nv))
    holds = statics.support(robot, q, zero, zero, contacts).holds
    free = np.full(robot.nv, np.inf)
    free[:6] = 0.0
    answers = [statics.robot_equilibrium(robot, row, contacts, limits=free).holds for row in q]
    assert 20 < holds.sum() < 480
    assert [bool(a) for a in answers if a is not None] == [
        bool(h) for h, a in zip(holds, answers, strict=True) if a is not None
    ]


def test_what_no_friction_holds_tips_by_a_motion_without_sliding():
    """Random boxes on four corners under random loads: with a coefficient for which a motion slides too, the answer is that of
    unlimited friction, and its motion proves the failure with every coefficient up to 10."""
    rng = np.random.default_rng(8)
    corners = [statics.Contact((x, y, 0), friction=0.9) for x in (-0.3, 0.3) for y in (-0.2, 0.2)]
    load = np.concatenate(
        [rng.uniform(-60, 60, (300, 3)), rng.uniform(-220, 220, (300, 2)), np.full((300, 1), -200.0)], axis=1
    )
    found = statics.hold(load, corners)
    tips = np.isinf(found.friction)
    assert tips.sum() > 50 and (~found.holds & ~tips).sum() > 20
    assert (found.how[tips] == "tips").all() and (found.how[~found.holds & ~tips] == "slips").all()
    motion = found.motion[tips]
    for c in corners:
        v = motion[:, 3:] + np.cross(motion[:, :3], c.point)
        assert (v[:, 2] >= 10 * np.hypot(v[:, 0], v[:, 1]) - 1e-6).all()
    assert_allclose((motion * load[tips]).sum(axis=1), found.power[tips], rtol=1e-9)
    assert (found.power[tips] > 0).all()


def test_a_caster_slides_though_no_friction_of_the_wheels_helps():
    """A cart whose wheels carry nothing: friction grows at the wheels alone, and the cart slips."""
    wheel, casters = (
        statics.Contact((0, 0, 0), friction=0.6),
        [statics.Contact((1, y, 0), friction=0.0) for y in (-0.3, 0.3)],
    )
    found = statics.hold([0, 100, -30, 0, -30, -100], [wheel, *casters])
    assert np.isinf(found.friction[0]) and found.how[0] == "slips"


def test_a_body_on_casters_holds_its_weight_at_rest_and_no_motion_along_the_ground():
    """Speeds above zero need forces along the ground, which casters lack: both margins are zero, and never NaN."""
    rng = np.random.default_rng(3)
    casters = [statics.Contact(point, friction=0.0) for point in ((0.3, 0.25, 0), (0.28, -0.26, 0), (-0.33, 0.03, 0))]
    weight, rows = 230.0, 200
    x, y = rng.uniform(-0.08, 0.08, (2, rows))  # of the centre of mass, above the triangle of the casters
    zeros = np.zeros(rows)
    at_rest = np.stack([-weight * y, weight * x, zeros, zeros, zeros, zeros - weight], axis=1)
    found = statics.hold(at_rest + rng.uniform(-30, 30, (rows, 6)), casters, at_rest=at_rest)
    assert not found.holds.any()
    assert_allclose(found.speed, 0.0, atol=1e-6)
    assert_allclose(found.slowest, 0.0, atol=1e-6)
