"""Armature, rotor inertia and stiffness as inputs of kernels and rollouts: the same as a robot made with those numbers."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from random_trees import tree

import twistwrench as tw
from twistwrench.testing import assert_close, random_state

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

QUANTITIES = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "kinetic_energy", "drive_torques")
GEARED = {
    "shoulder_lift_joint": {"ratio": 100, "rotor": {"inertia": "3 kg cm^2"}},
    "elbow_joint": {"ratio": -80, "rotor": {"inertia": "2 kg cm^2", "link": "forearm_link", "axis": [0.3, 0.2, -0.9]}},
    "wrist_1_joint": {"ratio": 50, "rotor": {"inertia": "1 kg cm^2", "extra": True, "mass": "0.3 kg"}},
}
ELASTIC = {"elbow_joint": GEARED["shoulder_lift_joint"] | {"stiffness": "9 kN m/rad"}}
COUPLING = {
    "wrist": {"motors": ["a", "b"], "joints": ["wrist_2_joint", "wrist_3_joint"], "motor_per_joint": [[1, 1], [1, -2]]}
}
COUPLED = {"couplings": COUPLING, "actuators": {"a": {"ratio": 40, "rotor": {"inertia": "2 kg cm^2"}}, "b": {}}}


def edited(entries, **numbers):
    """Actuator entries with other rotor inertias or stiffnesses, by joint."""
    found = copy.deepcopy(entries)
    for joint, number in numbers.items():
        if "stiffness" in found[joint]:
            found[joint]["stiffness"] = f"{number!r} N m/rad"
        else:
            found[joint]["rotor"]["inertia"] = f"{number!r} kg m^2"
    return found


def compare(robot, other, **parameters):
    """Quantities of the robot with these parameters, against those of another robot."""
    names, values = [name.replace("__", ".") for name in parameters], list(parameters.values())
    state = random_state(robot, np.random.default_rng(3))
    for quantity in QUANTITIES:
        mine = state[: len(robot.program(quantity).inputs)]
        if quantity == "forward_dynamics":
            mine = (*state[:2], robot.inverse_dynamics(*state))  # accelerations of order 1
        found = robot.kernel(quantity, parameters=names)(*mine, values)
        expected = other.kernel(quantity)(*mine)
        pairs = zip(found, expected, strict=True) if isinstance(found, tuple) else [(found, expected)]
        for one, true in pairs:
            assert_close(one, true, 1e-9, quantity)


@pytest.mark.parametrize("name", ["one_degree5", pytest.param("tree1", marks=pytest.mark.slow)])
def test_an_armature_is_that_of_a_robot_edited_by_hand(name):
    robot = tree(name)
    joints = [name.removesuffix(".armature") for name in robot.varying("*.armature")][:2]
    numbers = dict(zip(joints, (0.3, 0.7), strict=True))
    compare(robot, robot.with_armature(numbers), **{f"{joint}__armature": x for joint, x in numbers.items()})


def test_a_rotor_inertia_is_that_of_another_actuator_file():
    """Rotors of any place and axis, weighed with their links or apart from them."""
    ur5 = tw.robots.ur5()
    robot = ur5.with_actuators({"actuators": GEARED})
    numbers = {"shoulder_lift_joint": 5e-4, "elbow_joint": 1e-4, "wrist_1_joint": 3e-4}
    other = ur5.with_actuators({"actuators": edited(GEARED, **numbers)})
    assert robot.varying("*.rotor_inertia")["elbow_joint.rotor_inertia"] == pytest.approx(2e-4)
    compare(robot, other, **{f"{joint}__rotor_inertia": x for joint, x in numbers.items()})


def test_the_link_that_holds_a_rotor_loses_its_inertia_in_the_links_own_axes():
    """Each joint of a panda is turned about x in its parent link and shifted: the rotor's axis is another there."""
    panda = tw.robots.panda()
    names = ("panda_joint2", "panda_joint4", "panda_joint6")
    turning = [body.placement[:3, :3] for body in panda.model.bodies if body.joint.name in names]
    assert all(abs(R[2, 2]) < 0.5 for R in turning)
    weighed = {name: {"ratio": 50 + 10 * k, "rotor": {"inertia": "2 kg cm^2"}} for k, name in enumerate(names)}
    numbers = {name: 3e-3 + 1e-3 * k for k, name in enumerate(names)}
    other = panda.with_actuators({"actuators": edited(weighed, **numbers)})
    robot = panda.with_actuators({"actuators": weighed})
    compare(robot, other, **{f"{joint}__rotor_inertia": x for joint, x in numbers.items()})


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_rotors_of_random_robots_may_vary(seed):
    robot = tree(f"driven{seed}")
    names = list(robot.varying("*.rotor_inertia"))
    own = robot.varying(*names)
    actuators = robot.actuators
    entries = {
        name: {"ratio": a.ratio, "rotor": {
            "inertia": f"{2 * a.rotor.inertia!r} kg m^2", "extra": True, "mass": f"{a.rotor.mass!r} kg",
            "place": [f"{float(x)!r} m" for x in a.rotor.place],
            **({} if a.rotor.link is None else {"link": a.rotor.link, "axis": a.rotor.axis.tolist()})}}
        for name, a in actuators.items()
    }  # fmt: skip
    other = tw.testing.random_robot(rng=seed, joints=5).with_actuators({"actuators": entries})
    compare(robot, other, **{name.replace(".rotor", "__rotor"): 2 * x for name, x in own.items()})


def test_a_stiffness_is_that_of_another_elastic_gear():
    ur5 = tw.robots.ur5()
    robot = ur5.with_actuators({"actuators": ELASTIC})
    other = ur5.with_actuators({"actuators": edited(ELASTIC, elbow_joint=5000.0)})
    assert robot.varying("*.stiffness") == {"elbow_joint.stiffness": pytest.approx(9000.0)}
    compare(robot, other, elbow_joint__stiffness=5000.0)


SPRUNG = """<mujoco><worldbody><body><joint name="hinge" type="hinge" axis="0 1 0" stiffness="{}" springref="20" armature="0.2"/>
<inertial pos="0 0 0.4" mass="1.5" diaginertia="0.1 0.1 0.01"/></body></worldbody></mujoco>"""


def test_a_spring_of_a_joint_and_its_armature_may_vary():
    robot, other = tw.load(SPRUNG.format(7)), tw.load(SPRUNG.format(3)).with_armature({"hinge": 0.5})
    assert robot.varying("*.stiffness", "*.armature") == {"hinge.stiffness": 7.0, "hinge.armature": 0.2}
    compare(robot, other, hinge__stiffness=3.0, hinge__armature=0.5)


def test_inertias_of_coupled_motors_may_vary():
    ur5 = tw.robots.ur5()
    robot = ur5.with_actuators(COUPLED)
    other = ur5.with_actuators(COUPLED | {"actuators": edited({"a": COUPLED["actuators"]["a"]}, a=5e-4) | {"b": {}}})
    assert "a.armature" not in robot.varying() and "b.armature" in robot.varying()
    compare(robot, other.with_armature({"b": 0.1}), a__rotor_inertia=5e-4, b__armature=0.1)


# ── Derivatives ──


@pytest.mark.parametrize("quantity", ["inverse_dynamics", pytest.param("forward_dynamics", marks=pytest.mark.slow)])
def test_derivatives_by_numbers_of_drives_are_differences(quantity):
    robot = tw.robots.ur5().with_actuators({"actuators": ELASTIC | {"wrist_1_joint": GEARED["wrist_1_joint"]}})
    names = (
        "elbow_joint.stiffness",
        "elbow_joint.rotor_inertia",
        "wrist_1_joint.rotor_inertia",
        "wrist_2_joint.armature",
    )
    own = np.array([*robot.varying(*names[:3]).values(), 0.2])
    q, dq, x = random_state(robot, np.random.default_rng(5))
    plain = robot.kernel(quantity, parameters=names)
    slopes = robot.kernel(quantity, parameters=names, by="parameters")(q, dq, x, own)
    assert slopes.shape == (robot.nv, 4)
    for k, size in enumerate(own):
        step = 2e-3 * size
        up, down, wider, narrower = (plain(q, dq, x, own + e * step * np.eye(4)[k]) for e in (1, -1, 2, -2))
        expected = (8 * (up - down) - (wider - narrower)) / (12 * step)
        assert np.abs(slopes[:, k] - expected).max() <= 1e-7 * max(np.abs(expected).max(), 1e-3 / size), names[k]


def test_rollouts_with_numbers_of_drives_and_their_gradients(monkeypatch):
    """A rollout is that of the edited robots, sample by sample; slopes of a cost against differences."""
    monkeypatch.setenv("TWISTWRENCH_JIT", "1")  # the loop over the steps is another one where it is compiled
    robot = tw.load(SPRUNG.format(7))
    given = {"hinge.stiffness": np.array([3.0, 9.0]), "hinge.armature": np.array([0.1, 0.4])}
    start, tau, options = ([[0.3], [0.3]], [[0.0], [0.5]]), np.full((40, 1), 0.4), {"dt": 0.01, "gradients": True}
    found = robot.rollout(*start, tau, parameters=given, **options)
    for k in range(2):
        other = tw.load(SPRUNG.format(given["hinge.stiffness"][k])).with_armature({"hinge": given["hinge.armature"][k]})
        alone = other.rollout(start[0][k], start[1][k], tau, dt=0.01)
        assert np.abs(found.q[k] - alone.q).max() < 1e-11
    weights = np.sin(np.arange(41.0))[:, None] * np.ones((2, 1, 1))
    by = found.gradient(weights).parameters
    for name, values in given.items():
        for k in range(2):
            costs = []
            for e in (1e-4, -1e-4):
                moved = values + e * np.eye(2)[k]
                costs.append(
                    float((weights * robot.rollout(*start, tau, parameters=given | {name: moved}, dt=0.01).q).sum())
                )
            assert by[name][k] == pytest.approx((costs[0] - costs[1]) / 2e-4, rel=1e-5)


def test_negative_inertias_of_drives_and_stiffnesses_are_refused():
    robot = tw.load(SPRUNG.format(7))
    for name in ("hinge.armature", "hinge.stiffness"):
        with pytest.raises(tw.ValueRangeError, match=r"'hinge.* is -1, and .* is at least 0"):
            robot.rollout([0.1], [0.0], np.zeros((3, 1)), dt=0.01, parameters={name: -1.0})
