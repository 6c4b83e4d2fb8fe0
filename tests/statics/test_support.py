"""Contact forces of a motion and their margins: laws of the balance, and independent programmes as oracles."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linprog

import twistwrench as tw
from twistwrench import statics
from twistwrench.statics.cone_programme import Cones, cone_programme, least_norm_in_cones

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

LEGS = ("FL", "FR", "RL", "RR")


def random_cones(rng, contacts):
    """Contacts with random or parallel normals, some without friction, on one plane or not."""
    normals = rng.standard_normal((contacts, 3)) if rng.random() < 0.5 else np.tile([0.0, 0.0, 1.0], (contacts, 1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = rng.uniform(-1, 1, (contacts, 3))
    points[:, 2] *= rng.random() < 0.5
    friction = rng.uniform(0, 1, contacts) * (rng.random(contacts) < 0.8)
    maps = np.stack([np.vstack([tw.so3.hat(p), np.eye(3)]) for p in points], axis=1)
    return Cones(normals, friction), maps


def margin(cones, maps, b, d, edges, *, around):
    """Largest s of a pyramid inside or around the cones; None if impossible at every s."""
    columns = []
    for k, (n, mu) in enumerate(zip(cones.normals, cones.friction, strict=True)):
        pyramid = statics.Contact((0, 0, 0), n, mu).edges(edges, around=around)
        columns.append(maps[:, k] @ pyramid.T)
    E = np.column_stack([*columns, -d])
    found = linprog(np.r_[np.zeros(E.shape[1] - 1), -1.0], A_eq=E, b_eq=b, method="highs")
    return np.inf if found.status == 3 else None if found.status != 0 else found.x[-1]


def sideways_dog(rows=40, acceleration=3.0, friction=0.6):
    """Quadruped whose trunk is thrown sideways while the feet stand, with the feet as contacts."""
    dog = tw.robots.quadruped()
    bent = {f"{leg}_{joint}_joint": angle for leg in LEGS for joint, angle in (("thigh", 0.8), ("calf", -1.6))}
    q = np.repeat(dog.coordinates(**bent)[None], rows, axis=0)
    dq, ddq = np.zeros((2, rows, dog.nv))
    ddq[:, 4] = acceleration * np.sin(np.linspace(0, 2 * np.pi, rows))  # (omega, v) of the trunk: along y
    return dog, q, dq, ddq, [statics.Contact(frame=f"{leg}_foot", friction=friction) for leg in LEGS]


# ── The solver ──


def check_against_pyramids(seed):
    """Margin between pyramids inside and around; forces balance within the cones; every no has its motion."""
    rng = np.random.default_rng(seed)
    contacts = int(rng.integers(1, 9))
    cones, maps = random_cones(rng, contacts)
    inside = np.einsum("mck,ck->m", maps, cones.normals * rng.uniform(0, 10, (contacts, 1)))
    b = inside if rng.random() < 0.7 else rng.standard_normal(6) * 10
    d = rng.standard_normal(6)
    found = cone_programme(cones, maps[None], b[None], d[None])
    assert found.settled.all()
    y, f, s = found.prices[0], found.forces[0], found.s[0]
    if np.isnan(s):
        v = np.einsum("mck,m->ck", maps, y)
        rise = (v * cones.normals).sum(axis=1)
        slide = np.linalg.norm(v - rise[:, None] * cones.normals, axis=1)
        assert (rise - cones.friction * slide >= -1e-7 * np.abs(y).max()).all() and y @ b < 0
        return False
    if np.isfinite(s):
        assert_allclose(np.einsum("mck,ck->m", maps, f), b + s * d, atol=1e-7 * (np.abs(b).max() + s))
    along = (f * cones.normals).sum(axis=1)
    slide = np.linalg.norm(f - along[:, None] * cones.normals, axis=1)
    assert (slide <= cones.friction * along + 1e-9 * (1 + np.abs(f).max())).all()
    low = margin(cones, maps, b, d, 64, around=False)
    high = margin(cones, maps, b, d, 64, around=True)
    slack = 1e-6 * (1 + abs(s)) if np.isfinite(s) else 0.0
    assert low is None or low <= s + slack
    assert high is None or s <= high + slack
    return True


def test_margins_lie_between_pyramids_and_every_no_has_its_motion():
    held = [check_against_pyramids(seed) for seed in range(60)]
    assert 10 < sum(held) < 55  # both answers occur


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_margins_of_many_random_systems(block):
    for seed in range(1000 + 500 * block, 1500 + 500 * block):
        check_against_pyramids(seed)


def test_forces_of_least_norm_are_optimal_in_the_true_cones():
    """At the optimum f = P(G'y): the force's distance to G'y is polar to the cone, and no feasible force is shorter."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        cones, maps = random_cones(rng, 6)
        b = np.einsum("mck,ck->m", maps, cones.normals * rng.uniform(1, 10, (6, 1)))
        forces, found = least_norm_in_cones(cones, maps[None], b[None], np.ones((1, 6), bool))
        basic = cone_programme(cones, maps[None], b[None]).forces
        assert not found[0] or np.linalg.norm(forces) <= np.linalg.norm(basic) * (1 + 1e-9)
        if found[0]:
            assert_allclose(np.einsum("mck,ck->m", maps, forces[0]), b, atol=1e-9 * np.abs(b).max())


def test_contacts_without_friction_do_not_pull():
    """A plate on four legs of ice with its load near one: the pseudo-inverse would pull at the opposite one."""
    legs = [statics.Contact((x, y, 0), friction=0.0) for x in (-1, 1) for y in (-1, 1)]
    load = np.array([0.0, 0.0, -10.0])
    found = statics.hold(np.r_[np.cross([0.7, 0.6, 0.0], load), load], legs)
    assert found.holds[0] and found.least_norm[0]
    assert all(c.allows(f) for c, f in zip(legs, found.forces[0], strict=True))
    assert (np.linalg.pinv(np.vstack([np.ones(4), *np.array([c.point for c in legs]).T[:2]])) @ [10, 7, 6]).min() < -0.5


# ── Robots ──


def test_contact_forces_and_torques_satisfy_the_equations_of_motion():
    dog, q, dq, ddq, feet = sideways_dog()
    found = statics.support(dog, q, dq, ddq, feet)
    assert found.holds.all()
    assert all(c.allows(found.forces[:, k]).all() for k, c in enumerate(feet))
    on_robot = np.zeros((len(q), dog.nv))
    for k, c in enumerate(feet):
        R = dog.forward_kinematics(q, c.frame)[:, :3, :3]
        f = np.einsum("nji,nj->ni", R, found.forces[:, k])  # in the foot's axes
        on_robot += np.einsum("nij,ni->nj", dog.jacobian(q, c.frame), np.c_[np.zeros((len(q), 3)), f])
    assert_allclose(dog.inverse_dynamics(q, dq, ddq) - on_robot, found.torques, atol=1e-8)
    assert (found.torques[:, :6] == 0).all()


def test_momentum_of_the_whole_robot_is_the_sum_of_contact_forces():
    """Newton's law: Σ f = m (a_com - g), with the acceleration of the centre of mass by its Jacobian."""
    dog, q, dq, ddq, feet = sideways_dog()
    found = statics.support(dog, q, dq, ddq, feet)
    mass = dog.model.moving_mass
    a = np.einsum("nij,nj->ni", dog.com_jacobian(q), ddq)  # dq = 0
    assert_allclose(found.forces.sum(axis=1), mass * (a - dog.gravity), rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("friction", [0.2, 0.6])
def test_the_margin_in_speed_is_where_support_ends(friction):
    """Time scaled by s keeps what stands at rest and multiplies accelerations by s²."""
    dog, q, dq, ddq, feet = sideways_dog(rows=12, friction=friction)
    found = statics.support(dog, q, dq, ddq, feet)
    s = found.speed[found.worst]
    assert statics.support(dog, q, 0.999 * s * dq, (0.999 * s) ** 2 * ddq, feet).holds.all()
    assert not statics.support(dog, q, 1.001 * s * dq, (1.001 * s) ** 2 * ddq, feet).holds.all()


def test_a_box_slides_at_the_coefficient_of_friction_and_tips_at_its_lever():
    """By hand: it needs a / g; a box 0.2 m wide with its centre 0.1 m high tips at a = g, 0.2 m high at g / 2."""
    box, g = tw.robots.floating_box(), 9.81

    def thrown(acceleration, height, friction):
        corners = [(x, y, -height) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
        feet = [statics.Contact(p, frame=box.tip, friction=friction) for p in corners]
        return statics.support(box, box.neutral, np.zeros(6), [0, 0, 0, acceleration, 0, 0], feet)

    slow = thrown(2.0, 0.1, 0.5)
    assert_allclose(slow.friction, 2.0 / g, atol=1e-4)
    assert_allclose(slow.speed, np.sqrt(0.5 * g / 2.0), rtol=1e-9)
    assert_allclose(slow.zmp[0], [-0.1 * 2.0 / g, 0.0], atol=1e-12)
    assert_allclose(slow.zmp_margin, 0.1 - 0.1 * 2.0 / g, atol=1e-12)
    assert thrown(6.0, 0.1, 0.5).how == "slips"
    tips = thrown(6.0, 0.2, 2.0)
    assert tips.how == "tips" and tips.friction == np.inf and tips.power > 0 and tips.zmp_margin < 0
    assert_allclose(tips.speed, np.sqrt(0.5 * g / 6.0), rtol=1e-9)


def test_a_further_payload_is_that_of_a_robot_that_has_it_built_in():
    """The payload is in front of the support, and the trunk accelerates: the mass at which it tips or slips."""
    dog = tw.robots.quadruped()
    skids = [statics.Contact((x, y, -0.05), frame="trunk", friction=0.6) for x in (-0.15, 0.1) for y in (-0.1, 0.1)]
    z = np.zeros(dog.nv)
    ddq = z.copy()
    ddq[3] = -1.0
    found = statics.support(dog, dog.neutral, z, ddq, skids, payload_frame="FL_hip")
    mass = float(found.payload[0])
    assert 0 < mass < np.inf
    for share, holds in ((0.9999, True), (1.0001, False)):
        heavier = dog.with_payload(tw.SpatialInertia.from_com(share * mass), "FL_hip")
        again = statics.support(heavier, dog.neutral, z, ddq, skids, payload_frame="FL_hip")
        assert bool(again.holds[0]) is holds
        assert_allclose(again.payload[0], (1 - share) * mass, atol=1e-6 * mass)  # negative: what is too much


def test_a_pose_at_rest_holds_as_in_the_static_equilibrium():
    dog, q, _, _, feet = sideways_dog(rows=1)
    zero = np.zeros(dog.nv)
    unlimited = np.full(dog.nv, np.inf)
    for some in (feet, feet[:3], feet[:2], feet[1:3]):
        static = statics.robot_equilibrium(dog, q[0], some, limits=unlimited)
        assert bool(statics.support(dog, q, zero, zero, some).holds[0]) is bool(static.holds)


def agreement(seeds):
    """Poses whose answers differ between one pose at rest and a motion that stands still; and the count of each answer."""
    dog, q0, _, _, _ = sideways_dog(rows=1)
    zero, unlimited, differ, counts = np.zeros(dog.nv), np.full(dog.nv, np.inf), [], {True: 0, False: 0}
    for seed in seeds:
        rng = np.random.default_rng(seed)
        q = dog.add(q0[0], 0.3 * rng.standard_normal(dog.nv))
        kinds = ({}, {"push": 60.0}, {"pull": 20.0}, {"push": 90.0, "group": "pad"})
        contacts = [
            statics.Contact(
                rng.uniform(-0.1, 0.1, 3),
                rng.normal((0, 0, 4)),
                rng.uniform(0.2, 1),
                f"{leg}_calf",
                **kinds[rng.integers(4)],
            )
            for leg in rng.choice(LEGS, rng.integers(3, 5), replace=False)
        ]
        static = statics.robot_equilibrium(dog, q, contacts, limits=unlimited)
        moving = statics.support(dog, q, zero, zero, contacts)
        counts[bool(moving.holds[0])] += 1
        if static.holds is None or not moving.decided[0] or bool(moving.holds[0]) is not static.holds:
            differ.append(seed)
        elif static.holds:
            assert_allclose(static.forces, moving.forces[0], atol=1e-7 * np.abs(static.forces).max())
    return differ, counts


def test_a_pose_and_a_motion_that_stands_still_have_the_same_answer():
    differ, counts = agreement(range(12))
    assert not differ and min(counts.values()) > 0


@pytest.mark.slow
def test_500_poses_and_motions_that_stand_still_have_the_same_answer():
    differ, counts = agreement(range(100, 600))
    assert not differ and min(counts.values()) > 50


def test_limits_of_torques_choose_among_the_forces_that_balance():
    """One knee is weaker than the forces of least norm want: others take over, until no forces are left."""
    dog, q, dq, ddq, feet = sideways_dog(rows=9, acceleration=1.0)
    usual = statics.support(dog, q, dq, ddq, feet)
    knee = dog.model.velocity_names.index("FL_calf_joint")
    limits = np.full(dog.nv, np.inf)
    limits[knee] = 0.7 * np.abs(usual.torques[:, knee]).max()
    spared = statics.support(dog, q, dq, ddq, feet, limits=limits)
    over = np.abs(usual.torques[:, knee]) > limits[knee]
    assert 0 < over.sum() < len(q) and spared.least_norm.all()
    assert (np.abs(spared.torques[:, knee]) <= limits[knee] * (1 + 1e-6)).all()
    assert_allclose(spared.forces[~over], usual.forces[~over])
    assert_allclose(spared.forces.sum(axis=1), usual.forces.sum(axis=1), rtol=1e-7, atol=1e-6)
    assert all(c.allows(spared.forces[:, k]).all() for k, c in enumerate(feet))
    weak = statics.support(dog, q, dq, ddq, feet, limits=0.1 * np.abs(usual.torques).max(axis=0) + 1e-3)
    one = statics.robot_equilibrium(dog, q[0], feet, limits=np.full(dog.nv, 1e3))
    assert weak.holds.all() and one.share is not None
    strong = statics.support(dog, q[:1], 0 * dq[:1], 0 * ddq[:1], feet, limits=np.full(dog.nv, 1.0))
    assert_allclose(np.abs(strong.torques).max(), 1e3 * one.share, rtol=1e-5)


def test_feet_in_the_air_carry_nothing():
    dog, q, dq, ddq, feet = sideways_dog(rows=3, acceleration=0.0)
    down = np.array([[True] * 4, [True, True, True, False], [False] * 4])
    found = statics.support(dog, q, dq, ddq, feet, in_contact=down)
    assert not found.holds[2] and (found.forces[1, 3] == 0).all() == bool(found.holds[1])


# ── Bolts, cups and fingers ──


def test_fingers_hold_twice_the_friction_of_their_force():
    pads = [statics.Contact((0, y, 0), (0, -y, 0), friction=0.5, push=60.0) for y in (-0.02, 0.02)]
    weight = [0, 0, 0, 0, 0, -9.81]
    found = statics.hold(weight, pads, per_kilogram=weight)
    assert_allclose(1.0 + found.payload, 2 * 0.5 * 60.0 / 9.81, rtol=1e-9)
    heavy = statics.hold(10 * np.array(weight), pads, per_kilogram=weight)
    assert not heavy.holds[0] and heavy.how[0] == "slips"
    assert_allclose(10.0 + heavy.payload, 2 * 0.5 * 60.0 / 9.81, rtol=1e-9)
    assert_allclose(found.forces[0, :, 1], [0.5 * 9.81 / 0.5, -0.5 * 9.81 / 0.5], rtol=1e-6)


def test_a_group_shares_its_force():
    pads = [
        statics.Contact((x, y, 0), (0, -y, 0), friction=0.5, push=60.0, group=f"pad {y}")
        for y in (-0.02, 0.02)
        for x in (-0.01, 0.01)
    ]
    weight = np.array([0, 0, 0, 0, 0, -9.81])
    found = statics.hold(weight, pads, per_kilogram=weight)
    assert_allclose(1.0 + found.payload, 2 * 0.5 * 60.0 / 9.81, rtol=1e-9)


@pytest.mark.parametrize(("push", "stands"), [(0.51, True), (0.49, False)])
def test_equal_pads_of_two_links_press_with_their_own_forces(push, stands):
    """Two feet with the same corners and normal carry half of the weight each, so each must bear that, and not all of it."""
    feet = "".join(
        f"""<link name="{name}"/><joint name="to_{name}" type="fixed"><parent link="trunk"/><child link="{name}"/>
        <origin xyz="0 {y} -0.3"/></joint>"""
        for name, y in (("left", 0.1), ("right", -0.1))
    )
    inertia = '<mass value="10"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    text = f'<robot name="biped"><link name="trunk"><inertial>{inertia}</inertial></link>{feet}</robot>'
    robot = tw.load(text, floating_base=True)
    corners = [(x, y, 0.0) for x in (-0.05, 0.05) for y in (-0.02, 0.02)]
    weight = 10 * np.linalg.norm(robot.gravity)
    pads = [c for foot in ("left", "right") for c in statics.patch(foot, corners, (0, 0, 1), 0.5, push=push * weight)]
    found = statics.support(robot, robot.neutral, np.zeros(6), np.zeros(6), pads)
    assert bool(found.holds[0]) == stands


def test_a_cup_pulls_off_at_its_vacuum_force_and_slides_at_friction_times_it():
    ring = [
        statics.Contact((0.02 * np.cos(a), 0.02 * np.sin(a), 0), (0, 0, -1), 0.5, pull=10.0)
        for a in np.arange(8) * np.pi / 4
    ]
    down, along = np.array([0, 0, 0, 0, 0, -1.0]), np.array([0, 0, 0, 1.0, 0, 0])
    assert_allclose(statics.hold(down, ring, per_kilogram=down).payload + 1.0, 80.0, rtol=1e-9)
    assert_allclose(statics.hold(along, ring, per_kilogram=along).payload + 1.0, 40.0, rtol=1e-9)
    assert statics.hold(81 * down, ring).how[0] == "pulls off"
    assert statics.hold(41 * along, ring).how[0] == "slips"


# ── Laws ──


def test_margins_do_not_depend_on_the_order_of_contacts_nor_on_the_scale_of_masses():
    rng = np.random.default_rng(2)
    corners = [(x, y, -0.3) for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    wrench, rest = rng.standard_normal((5, 6)) - [0, 0, 0, 0, 0, 20.0], np.tile([0, 0, 0, 0, 0, -20.0], (5, 1))
    feet = [statics.Contact(p, friction=0.4) for p in corners]
    one = statics.hold(wrench, feet, at_rest=rest)
    reordered = statics.hold(wrench, feet[::-1], at_rest=rest)
    heavier = statics.hold(7.0 * wrench, feet, at_rest=7.0 * rest)
    R = tw.so3.exp([0, 0, 0.7])
    turned = statics.hold(
        np.c_[wrench[:, :3] @ R.T, wrench[:, 3:] @ R.T],
        [statics.Contact(R @ p, friction=0.4) for p in corners],
        at_rest=rest,
    )
    for other in (reordered, heavier, turned):
        assert_allclose(other.speed, one.speed, rtol=1e-7)
        assert (other.holds == one.holds).all()


# ── Bad input ──


@pytest.mark.parametrize(
    ("change", "words"),
    [({"push": -1.0}, "push"), ({"pull": np.inf}, "pull"), ({"pull": -2.0}, "pull"), ({"group": 3}, "group")],
)
def test_contacts_of_impossible_forces_are_errors(change, words):
    with pytest.raises(tw.ValueRangeError, match=words):
        statics.Contact(**change)


def test_a_fixed_base_and_impossible_contacts_are_errors():
    arm = tw.robots.ur5()
    with pytest.raises(tw.ValueRangeError, match="floating_base=True"):
        statics.support(arm, arm.neutral, np.zeros(6), np.zeros(6), [statics.Contact(frame="tool0")])
    with pytest.raises(tw.ValueRangeError, match="at least one"):
        statics.hold(np.zeros(6), [])
    pads = [statics.Contact(push=p, group="pad") for p in (1.0, 2.0)]
    with pytest.raises(tw.ValueRangeError, match="pushes"):
        statics.hold(np.zeros(6), pads)


@pytest.mark.parametrize("entry", [0, 3])
def test_an_infinite_wrench_is_refused_without_a_warning_of_numpy(entry):
    """Lever arms of zero times an infinite force are not a number."""
    wrench = np.zeros(6)
    wrench[entry] = np.inf
    arm = tw.robots.ur5()
    with pytest.raises(tw.ValueRangeError, match=r"give each frame one wrench .* of six finite numbers"):
        statics.robot_equilibrium(arm, arm.neutral + 0.3, [], wrench_on_robot={"tool0": wrench})
