"""Static equilibrium under contacts: every yes comes with forces that balance, every no with a motion that proves it."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench.statics import Contact, body_equilibrium, hold, least_norm_contact_forces, robot_equilibrium

UR5 = tw.robots.ur5()
FEET = ("FL_foot", "FR_foot", "RL_foot", "RR_foot")


def grasp(rng, count):
    points, normals = rng.standard_normal((count, 3)), rng.standard_normal((count, 3))
    return [Contact(p, n, mu) for p, n, mu in zip(points, normals, rng.uniform(0, 1.2, count), strict=True)]


def check_body(contacts, F, found):
    """Verify an answer by its proof alone."""
    if found.holds:
        total = np.array(F, float)
        for c, f in zip(contacts, found.forces, strict=True):
            assert c.allows(f, slack=1e-6)
            total += np.concatenate([np.cross(c.point, f), f])
        assert_allclose(total, 0, atol=1e-6 * np.abs(F).max())
    elif found.holds is False:
        check_certificate([(c, found.motion[3:] + np.cross(found.motion[:3], c.point)) for c in contacts])
        assert_allclose(F @ found.motion, found.power, rtol=1e-9)
        assert found.power > 0


def check_certificate(velocities):
    """No force of the true cone does negative work: the velocity lies in the cone's polar, turned."""
    for c, v in velocities:
        away = c.normal @ v
        sliding = np.linalg.norm(v - away * c.normal)
        assert away >= c.friction * sliding - 1e-6


@pytest.mark.parametrize("seed", range(60))
def test_every_answer_about_a_body_proves_itself(seed):
    rng = np.random.default_rng(seed)
    contacts, F = grasp(rng, rng.integers(1, 8)), rng.standard_normal(6)
    found = body_equilibrium(contacts, F)
    assert found.holds is not None
    check_body(contacts, F, found)


@pytest.mark.parametrize(
    ("scale", "away"), [(1e-9, 0.0), (1e-9, 1e6), (1e-8, 1e6), (1e-4, 0.0), (1e3, 1e6), (1e6, 0.0)]
)
def test_an_answer_does_not_depend_on_the_unit_of_length_or_on_the_origin(scale, away):
    """The same grasps in nanometres and megametres, and a million of their sizes away from the frame's origin."""
    rng = np.random.default_rng(7)
    answers = set()
    for _ in range(12):
        contacts, F = grasp(rng, rng.integers(3, 8)), rng.standard_normal(6)
        usual = body_equilibrium(contacts, F)
        shift = scale * away * np.array([0.6, -0.48, 0.64])
        moved = [Contact(scale * c.point + shift, c.normal, c.friction) for c in contacts]
        load = np.concatenate([scale * F[:3] + np.cross(shift, F[3:]), F[3:]])
        found = body_equilibrium(moved, load)
        assert found.holds is usual.holds
        answers.add(found.holds)
        if found.holds:
            forces = found.forces
            assert all(c.allows(f, slack=1e-6) for c, f in zip(contacts, forces, strict=True))
            # About the grasp's own middle: rounding of the origin's distance, eps·1e6 of the lever, is not the answer's.
            moment = F[:3] + np.cross([c.point for c in contacts], forces).sum(axis=0)
            assert_allclose(forces.sum(axis=0) + F[3:], 0, atol=2e-6 * np.abs(F).max())
            assert_allclose(moment, 0, atol=2e-6 * np.abs(F).max() + 4e-16 * away * np.abs(forces).sum())
    assert answers == {True, False}


@pytest.mark.parametrize("arm", [1e-10, 1e-8, 1e-4, 1.0, 1e4, 1e8])
def test_a_yes_balances_the_forces_however_far_the_load_is(arm):
    """A tongs' small fingers and a load at the end of a long stick: large forces, of which the small load is not a rounding."""
    fingers = [Contact((x, y, 0), (0, 0, z), 0.5) for x in (-arm, arm) for y in (-arm, arm) for z in (1, -1)]
    F = np.array([0, 1.0, 0, 0, 0, -1.0])
    found = body_equilibrium(fingers, F)
    if found.holds:
        total = F[3:] + found.forces.sum(axis=0)
        assert np.abs(total).max() <= 1e-6 + 1e-13 * np.abs(found.forces).sum()
    assert found.holds is True


def test_both_answers_occur():
    answers = [
        body_equilibrium(grasp(rng, 7), rng.standard_normal(6)).holds for rng in map(np.random.default_rng, range(30))
    ]
    assert {True, False} <= set(answers)


@pytest.mark.parametrize(("friction", "holds"), [(0.577, False), (0.578, True)])
def test_a_block_slides_where_the_tangent_of_the_slope_passes_its_friction(friction, holds):
    """Slope of 30°: tan 30° = 0.57735."""
    slope = np.radians(30)
    weight = 10 * np.array([np.sin(slope), 0, -np.cos(slope)])
    corners = [Contact((x, y, 0), friction=friction) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    F = np.concatenate([np.cross([0, 0, 0.2], weight), weight])
    turned = [Contact(c.point, c.normal, friction) for c in corners]
    for angle in (0.0, 0.3):
        R = tw.so3.exp([0, 0, angle])
        rotated = [Contact(R @ c.point, c.normal, friction) for c in turned]
        found = body_equilibrium(rotated, np.concatenate([R @ F[:3], R @ F[3:]]))
        assert found.holds is holds
        check_body(rotated, np.concatenate([R @ F[:3], R @ F[3:]]), found)


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0, 7))
def test_the_edge_of_a_cone_is_within_a_millionth_of_its_friction(angle):
    """A force on the cone in any direction: contacts have no preferred tangents."""
    for lean, holds in ((0.5 * (1 - 1e-6), True), (0.5 * (1 + 1e-6), False)):
        F = -np.array([0, 0, 0, lean * np.cos(angle), lean * np.sin(angle), 1.0])
        found = body_equilibrium([Contact(friction=0.5)], F)
        assert found.holds is holds
        check_body([Contact(friction=0.5)], F, found)


def test_a_block_tips_over_its_edge():
    legs = [Contact((x, y, 0), friction=0.3) for x, y in ((1, 0), (-1, 1), (-1, -1))]
    found = body_equilibrium(legs, [0, 0, 0, 0, 12.0, -30.0])
    assert found.holds is False
    check_body(legs, np.array([0, 0, 0, 0, 12.0, -30.0]), found)
    assert str(found).startswith("cannot hold: no contact resists the motion (")
    nothing = body_equilibrium([], [0, 0, 0, 0, 0, -1.0])
    assert nothing.holds is False
    assert str(nothing).startswith("cannot hold: there is no contact to resist the motion (-1 vz)")
    assert body_equilibrium([], np.zeros(6)).holds is True


def test_what_a_no_says_can_be_checked_from_its_text():
    """The entries printed are all there are, with their frame and the power, and one of six where one is enough."""
    corners = [Contact((x, y, 0), friction=0.5) for x in (-1, 1) for y in (-1, 1)]
    F = np.array([0, 0, 0, 6.0, 0, -10.0])
    found = body_equilibrium(corners, F)
    said = {name: float(value) for value, name in re.findall(r"([+-]\S+) ([wv][xyz])", str(found))}
    V = np.array([said.get(name, 0.0) for name in found.names])
    assert_allclose(V, found.motion, atol=1e-3)
    assert "in the frame of points and normals" in str(found)
    assert float(re.search(r"puts (\S+) W", str(found))[1]) == pytest.approx(F @ found.motion, rel=1e-3)
    assert_allclose(found.velocities, [V[3:] + np.cross(V[:3], c.point) for c in corners], atol=1e-3)
    lifted = body_equilibrium(corners, [0, 0, 0, 0, 0, 10.0])
    assert_allclose(lifted.motion, [0, 0, 0, 0, 0, 1], atol=1e-9)


def test_no_force_of_any_contact_reaches_the_side_that_rest_needs():
    """The certificate as a direction of wrenches: contacts apply F · V ≥ 0 alone, and rest needs less."""
    rng = np.random.default_rng(4)
    refused = 0
    for _ in range(20):
        contacts, F = grasp(rng, 4), rng.standard_normal(6)
        found = body_equilibrium(contacts, F)
        if found.holds is not False:
            continue
        refused += 1
        for c in contacts:
            f = rng.uniform(0, 5, (200, 1)) * c.normal + rng.standard_normal((200, 3))
            f = f[c.allows(f)]
            applied = np.concatenate([np.cross(c.point, f), f], axis=1)
            assert (applied @ found.motion >= -1e-5 * np.linalg.norm(f, axis=1)).all()
        assert -F @ found.motion < 0
    assert refused > 5


def test_forces_are_judged_in_batches():
    c = Contact(normal=(0, 0, 1), friction=0.5)
    assert c.allows([[[0, 0, 1], [0.6, 0, 1]], [[0.4, 0, 1], [0, 0, -1]]]).tolist() == [[True, False], [True, False]]


def test_two_fingers_hold_what_friction_lets_them():
    """Antipodal fingers with μ hold a weight in the plane; without friction they drop it straight down."""
    F = np.array([0, 0, 0, 0, 0, -2.0])
    for friction in (0.0, 0.4):
        fingers = [Contact((-1, 0, 0), (1, 0, 0), friction), Contact((1, 0, 0), (-1, 0, 0), friction)]
        found = body_equilibrium(fingers, F)
        check_body(fingers, F, found)
        assert found.holds is (friction > 0)
        if found.holds:
            assert_allclose(found.forces[:, 2], 1.0, atol=1e-7)
            assert (np.abs(found.forces[:, 0]) >= 1.0 / friction - 1e-6).all()


@pytest.mark.parametrize("seed", range(8))
def test_pushes_and_pulls_are_those_of_motions(seed):
    """A grasp with fingers of limited force, pads in groups and preloads: the answer of ``hold``, and the same forces."""
    rng = np.random.default_rng(seed)
    kinds = ({}, {"push": 0.4}, {"pull": 0.3}, {"push": 0.6, "group": "pad"})
    some = [kinds[k] for k in rng.integers(4, size=6)]
    contacts = [Contact(c.point, c.normal, c.friction, **k) for c, k in zip(grasp(rng, 6), some, strict=True)]
    F = 0.7 * rng.standard_normal(6)
    found, moving = body_equilibrium(contacts, F), hold(F, contacts)
    assert found.holds is bool(moving.holds[0])
    if found.holds:
        assert_allclose(found.forces, moving.forces[0], atol=1e-6)
        assert all(c.allows(f, slack=1e-6) for c, f in zip(contacts, found.forces, strict=True))
    else:  # random forces that the contacts can apply absorb less than the load puts in
        f = rng.standard_normal((2000, 6, 3)) + np.array([c.normal for c in contacts])
        f[:, :, :] *= np.stack([c.allows(f[:, k]) for k, c in enumerate(contacts)], axis=1)[..., None]
        pad = [k for k, c in enumerate(contacts) if c.group]
        f[np.einsum("nkx,kx->n", f[:, pad], np.array([contacts[k].normal for k in pad]).reshape(-1, 3)) > 0.6] = 0.0
        v = found.motion[3:] + np.cross(found.motion[:3], [c.point for c in contacts])
        assert (np.einsum("nkx,kx->n", f, v) + F @ found.motion >= found.power - 1e-6).all() and found.power > 0


# ── robots ──


@pytest.fixture(scope="module")
def dog():
    return tw.robots.quadruped()


@pytest.fixture(scope="module")
def standing(dog):
    legs = {
        f"{leg}_{part}_joint": x for leg in ("FL", "FR", "RL", "RR") for part, x in (("thigh", 0.8), ("calf", -1.6))
    }
    return dog.coordinates(**legs)


def on_floor(friction=0.6, feet=FEET):
    return [Contact(frame=foot, friction=friction) for foot in feet]


def check_robot(robot, q, contacts, found, limits, on=None):
    if found.holds:
        wrenches = dict(on or {})
        for c, f in zip(contacts, found.forces, strict=True):
            assert c.allows(f, slack=1e-6)
            local = robot.forward_kinematics(q, c.frame)[:3, :3].T @ f
            wrenches[c.frame] = wrenches.get(c.frame, 0) + np.concatenate([np.cross(c.point, local), local])
        tau = robot.holding_torques(q, wrench_on_robot=wrenches)
        assert_allclose(tau, found.torques, atol=1e-5)
        assert (np.abs(tau) <= limits + 1e-5).all()
        driven = (limits > 0) & np.isfinite(limits)
        assert_allclose((np.abs(tau[driven]) / limits[driven]).max(), found.share, atol=1e-6)
    else:
        moves = []
        for c in contacts:
            V = robot.jacobian(q, c.frame, "world_aligned") @ found.motion
            arm = robot.forward_kinematics(q, c.frame)[:3, :3] @ c.point
            moves.append((c, V[3:] + np.cross(V[:3], arm)))
        check_certificate(moves)
        assert_allclose(found.velocities, np.reshape([v for _, v in moves], (-1, 3)), atol=1e-9)
        load = -robot.holding_torques(q, wrench_on_robot=on)
        resisted = np.where(
            found.motion == 0, 0.0, np.where(np.isfinite(limits), limits, 0) * np.abs(found.motion)
        ).sum()
        assert_allclose(load @ found.motion - resisted, found.power, rtol=1e-6)
        assert found.power > 0


def test_a_quadruped_stands_on_its_feet(dog, standing):
    found = robot_equilibrium(dog, standing, on_floor())
    limits = np.concatenate([np.zeros(6), dog.limits.effort[6:]])
    assert found.holds
    check_robot(dog, standing, on_floor(), found, limits)
    weight = 9.81 * sum(b.inertia.mass for b in dog.model.bodies)
    assert_allclose(found.forces[:, 2].sum(), weight, rtol=1e-7)
    assert found.share < 0.2
    pushed = {"trunk": np.array([0, 0, 0, 30.0, 0, -100.0])}
    loaded = robot_equilibrium(dog, standing, on_floor(), wrench_on_robot=pushed)
    check_robot(dog, standing, on_floor(), loaded, limits, pushed)
    assert loaded.share > found.share


@pytest.mark.parametrize("seed", range(12))
def test_every_answer_about_a_robot_proves_itself(dog, standing, seed):
    """Contacts anywhere on turned links, with normals of any direction, and a push."""
    rng = np.random.default_rng(seed)
    q = dog.add(standing, 0.3 * rng.standard_normal(dog.nv))
    links = rng.choice([name for name in dog.link_names if "calf" in name or name == "trunk"], rng.integers(3, 7))
    contacts = [
        Contact(rng.uniform(-0.3, 0.3, 3), rng.normal((0, 0, 2)), rng.uniform(0.2, 1), frame=str(link))
        for link in links
    ]
    on = {"trunk": 20 * rng.standard_normal(6)}
    limits = np.concatenate([np.zeros(6), dog.limits.effort[6:]])
    found = robot_equilibrium(dog, q, contacts, wrench_on_robot=on)
    assert found.holds is not None
    check_robot(dog, q, contacts, found, limits, on)
    least = least_norm_contact_forces(dog, q, contacts, wrench_on_robot=on)
    assert least.holds == found.holds
    check_robot(dog, q, contacts, least, limits, on)
    if least.holds:  # the nearest of a convex set to zero: every other of it lies on its far side
        away = (least.forces * (found.forces - least.forces)).sum()
        assert away >= -1e-6 * (found.forces**2).sum()


def test_a_box_shares_its_weight_as_the_least_norm_does_in_closed_form():
    """Four corners under a load off the middle, all within their cones: the pseudoinverse of six rows of balance."""
    box = tw.robots.floating_box()
    corners = [np.array([x, y, -0.1]) for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    contacts = [Contact(p, friction=0.9, frame=box.link_names[0]) for p in corners]
    on = {box.link_names[0]: np.array([0.3, -0.4, 0.0, 2.0, 1.0, -5.0])}
    found = least_norm_contact_forces(box, box.neutral, contacts, wrench_on_robot=on)
    G = np.hstack([np.vstack([tw.so3.hat(p), np.eye(3)]) for p in corners])
    expected = np.linalg.pinv(G) @ box.holding_torques(box.neutral, wrench_on_robot=on)
    assert_allclose(found.forces.ravel(), expected, atol=1e-9 * np.abs(expected).max())
    assert found.share is None


def test_it_cannot_stand_on_two_feet_of_one_side_nor_with_weak_motors_nor_on_ice_when_pushed(dog, standing):
    strong = np.concatenate([np.zeros(6), dog.limits.effort[6:]])
    weak = 0.01 * strong
    on = {"trunk": np.array([0, 0, 0, 50.0, 0, 0])}
    for contacts, limits, pushed in (
        (on_floor(feet=FEET[:2]), strong, None),
        (on_floor(), weak, None),
        (on_floor(friction=0.0), strong, on),
        ([], strong, None),
    ):
        found = robot_equilibrium(dog, standing, contacts, limits=limits, wrench_on_robot=pushed)
        assert found.holds is False
        check_robot(dog, standing, contacts, found, limits, pushed)


def test_the_least_share_is_where_standing_ends(dog, standing):
    found = robot_equilibrium(dog, standing, on_floor())
    full = np.where(np.isfinite(dog.limits.effort), dog.limits.effort, 0)
    assert robot_equilibrium(dog, standing, on_floor(), limits=1.001 * found.share * full).holds
    assert robot_equilibrium(dog, standing, on_floor(), limits=0.99 * found.share * full).holds is False


def test_an_arm_without_contacts_holds_itself_exactly_when_its_torques_suffice():
    arm, q = tw.robots.planar_2r(), np.zeros(2)
    strong = robot_equilibrium(arm, q, [], limits=[30.0, 10.0])
    assert strong.holds
    assert_allclose(strong.torques, arm.gravity_forces(q))
    weak = robot_equilibrium(arm, q, [], limits=[29.0, 10.0])
    assert weak.holds is False
    check_robot(arm, q, [], weak, np.array([29.0, 10.0]))
    propped = [Contact(frame="tip", friction=0.2)]
    assert robot_equilibrium(arm, q, propped, limits=[29.0, 10.0]).holds


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: Contact((0, 0)), tw.ShapeError, "point"),
        (lambda: Contact("abc"), tw.ShapeError, "point"),
        (lambda: Contact([[1, 2], [3]]), tw.ShapeError, "point"),
        (lambda: Contact((0, np.nan, 0)), tw.ValueRangeError, "point has the entry nan"),
        (lambda: Contact(normal=(0, 0, 0)), tw.ValueRangeError, "normal has no length"),
        (lambda: Contact(friction=-0.1), tw.ValueRangeError, "friction is -0.1"),
        (lambda: Contact(friction="a"), tw.ValueRangeError, "friction is 'a'"),
        (lambda: Contact(friction=None), tw.ValueRangeError, "friction is None"),
        (lambda: Contact(friction=np.nan), tw.ValueRangeError, "friction is nan"),
        (lambda: Contact(friction=[0.5]), tw.TwistWrenchError, "friction"),
        (lambda: Contact(frame=3), tw.ValueRangeError, "frame is 3"),
        (lambda: Contact().edges(2), tw.ValueRangeError, "edges is 2"),
        (lambda: Contact().edges("a"), tw.ValueRangeError, "edges is 'a'"),
        (lambda: Contact().allows([1, 2]), tw.ShapeError, "force has shape"),
        (lambda: Contact().allows([1, 2, np.nan]), tw.ValueRangeError, "force has the entry nan"),
        (lambda: body_equilibrium([], [1, 2, 3]), tw.ShapeError, "wrench_on_body"),
        (lambda: body_equilibrium([], [[0.0] * 6] * 2), tw.ShapeError, r"wrench_on_body .* has shape \(2, 6\)"),
        (lambda: body_equilibrium([], [0, 0, 0, np.nan, 0, 0]), tw.ValueRangeError, "wrench_on_body .* nan"),
        (lambda: body_equilibrium([3], [0] * 6), tw.ValueRangeError, r"contacts\[0\] is 3"),
        (lambda: body_equilibrium(Contact(), [0] * 6), tw.ValueRangeError, "Give a list"),
        (
            lambda: body_equilibrium([Contact(), Contact(frame="FL_foot")], [0, 0, 0, 0, 0, -1]),
            tw.FrameError,
            r"contacts\[1\] is at 'FL_foot', a link of a robot",
        ),
        (lambda: robot_equilibrium(UR5, np.zeros((2, 6)), []), tw.ShapeError, "one q .* pose by pose"),
        (lambda: robot_equilibrium(UR5, [np.nan] * 6, []), tw.ValueRangeError, "'shoulder_pan_joint' is nan"),
        (lambda: robot_equilibrium(UR5, "zero", []), tw.ShapeError, "q has shape"),
        (lambda: robot_equilibrium(UR5, np.zeros(6), [Contact(frame="paw")]), tw.UnknownNameError, "paw"),
        (
            lambda: robot_equilibrium(UR5, np.zeros(6), [], wrench_on_robot={"tool0": [np.nan] * 6}),
            tw.ValueRangeError,
            "wrench_on_robot at tool0",
        ),
    ],
)
def test_errors_name_the_offender(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_a_share_is_of_torques_with_limits_and_of_nothing_else(dog, standing):
    body = body_equilibrium([Contact()], [0, 0, 0, 0, 0, -1.0])
    assert body.holds
    assert body.share is None
    assert repr(body) == "Equilibrium: holds, with contact forces up to 1 N"
    stands = robot_equilibrium(dog, standing, on_floor())
    assert repr(stands).endswith(f"torques up to {100 * stands.share:.3g} % of their limits")


def test_contacts_print_where_they_are():
    assert repr(Contact((0, 0.1, 0), friction=0.6, frame="foot")) == (
        "Contact at (0, 0.1, 0) m of foot, normal (0, 0, 1), friction 0.6"
    )
