"""Robots with closed loops on contacts: no verdict on torques of the open tree, and what the loops do not change."""

from __future__ import annotations

import functools
import warnings

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from scipy.linalg import null_space

import twistwrench as tw
from twistwrench import statics
from twistwrench.cli.main import main

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

LEGS = ("fl", "fr", "rl", "rr")
FEET = [f"{leg}_foot" for leg in LEGS]
DRIVES = [f"{leg}_{side}" for leg in LEGS for side in "ab"]
_BAR = """<body name="{name}" pos="{at}"><joint name="{name}" axis="0 1 0" range="-2 2"/>
<geom type="capsule" fromto="0 0 0 {to}" size="0.01" mass="{mass}"/>{more}</body>"""


def bar(name, at, to, mass, more=""):
    return _BAR.format(name=name, at=at, to=to, mass=mass, more=more)


def five_bar(leg="", x=0.0, y=0.0):
    """Two cranks whose shins meet at the foot, 0.4 m below."""
    foot = f'<body name="{leg}foot" pos="0.15 0 -0.2"><geom type="sphere" size="0.02" mass="0.5"/></body>'
    shin, other = (
        bar(f"{leg}{n}s", f"{s}0.1 0 -0.2", f"{t}0.15 0 -0.2", 0.2, m)
        for n, s, t, m in (("a", "-", "", foot), ("b", "", "-", ""))
    )
    return bar(f"{leg}a", f"{x - 0.05} {y} 0", "-0.1 0 -0.2", 0.3, shin) + bar(
        f"{leg}b", f"{x + 0.05} {y} 0", "0.1 0 -0.2", 0.3, other
    )


def file_of(legs, joint=""):
    """MJCF file of a trunk with five-bar legs, {prefix: (x, y)}, whose <connect> closes them."""
    bodies = "".join(five_bar(leg, *place) for leg, place in legs.items())
    loops = "".join(f'<connect name="{leg}loop" body1="{leg}foot" body2="{leg}bs" anchor="0 0 0"/>' for leg in legs)
    return f"""<mujoco model="five-bar"><compiler angle="radian"/><worldbody><body name="trunk" pos="0 0 0.42">{joint}
<geom type="box" size="0.3 0.15 0.04" mass="10"/>{bodies}</body></worldbody><equality>{loops}</equality></mujoco>"""


def opened(text):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(text)


@functools.cache
def dog():
    places = {f"{leg}_": (0.25 if leg[0] == "f" else -0.25, 0.15 if leg[1] == "l" else -0.15) for leg in LEGS}
    return opened(file_of(places, '<freejoint name="root"/>'))


def limits(robot, effort=60.0):
    return {name: effort for name in robot.joint_names if name != "root"}


@functools.cache
def closed(robot):
    for closure in robot.closures.values():
        robot = robot.close(closure.frame_a, closure.frame_b, "vx vz")
    return robot


def test_torques_of_a_loop_that_is_left_open_are_never_ok():
    """A crank needs 2.2 N m and the tree gives 0.05: neither OK nor OVER LIMIT follows from the tree."""
    arm = opened(file_of({"": (0.0, 0.0)}))
    needed = closed(arm).inverse_dynamics(arm.neutral, np.zeros(4), np.zeros(4), actuated=["a", "b"]).tau
    enough, little = (tw.check(arm, at=arm.neutral, limits=limits(arm) | {"as": effort}) for effort in (60.0, 0.8))
    assert np.abs(needed).max() > 10 * abs(enough.torques()[0, 0])
    assert enough.headline.startswith(
        "UNSURE: the file closes loop, and torques of a, as, b, bs are those of the open tree"
    )
    assert little.headline.startswith("UNSURE: with loops of its file open OVER LIMIT: as needs ")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        remedy = arm.close("loop:foot", "loop:bs", "vx vy vz", redundant="accept")
    assert "robot.close('loop:foot', 'loop:bs', 'vx vy vz', redundant='accept')" in enough.headline
    again = remedy.inverse_dynamics(arm.neutral, np.zeros(4), np.zeros(4), actuated=["a", "b"]).tau
    assert_allclose(again, needed, atol=1e-9)


def test_a_robot_with_loops_on_its_feet_is_unsure_and_stands_all_the_same(tmp_path):
    robot = dog()
    answer = tw.check(robot, feet=FEET, contact_friction=0.6, limits=limits(robot))
    assert answer.headline.startswith("UNSURE: the file closes fl_loop and 3 more, and torques of fl_a, fl_as, ")
    assert answer.support.holds.all()
    assert_allclose(answer.support.forces.sum(axis=1)[0], [0, 0, 9.81 * robot.model.moving_mass], atol=1e-6)
    file = tmp_path / "dog.xml"
    file.write_text(file_of({"": (0.0, 0.0)}, '<freejoint name="root"/>'))
    told = CliRunner().invoke(main, ["torques", str(file), "--feet", "0.1x0.1@foot"])
    assert "\nUNSURE: " in told.output and told.exit_code == 1


@pytest.mark.parametrize(
    "ask",
    [
        lambda robot: tw.check(robot, feet=FEET, contact_friction=0.6),
        lambda robot: statics.support(robot, robot.neutral, np.zeros(robot.nv), np.zeros(robot.nv), soles()),
        lambda robot: statics.robot_equilibrium(robot, robot.neutral, soles()),
    ],
)
def test_a_closed_robot_on_contacts_is_refused_with_the_closure_and_the_remedy(ask):
    with pytest.raises(
        tw.ConstraintError, match=r"closed by fl_loop:fl_foot–fl_loop:fl_bs and 3 more.* robot\.open\(\)"
    ):
        ask(closed(dog()))


def test_a_robot_closed_with_the_ground_is_refused_with_a_contact_as_the_remedy():
    robot = dog()
    grounded = robot.close("ground", "fl_foot", "vx vy vz", pose=robot.forward_kinematics(robot.neutral, "fl_foot"))
    with pytest.raises(
        tw.ConstraintError, match=r"closed by ground–fl_foot, .* In place of ground–fl_foot give a contact"
    ):
        statics.support(grounded, robot.neutral, np.zeros(robot.nv), np.zeros(robot.nv), soles())


def soles():
    return [statics.Contact((0, 0, -0.02), friction=0.6, frame=foot) for foot in FEET]


def test_the_remedy_gives_torques_of_the_drives_by_virtual_work():
    """Contact forces of the open tree, torques of the closed robot: in every motion that keeps loops closed and feet still
    the drives' power is the rise of the potential energy, and nothing else is driven."""
    robot, contacts = dog(), soles()
    z = np.zeros(robot.nv)
    q = closed(robot).consistent(robot.coordinates(fl_a=0.2, fr_b=-0.1, rl_a=-0.1))
    q[: len(robot.neutral) - 16] = robot.neutral[: len(robot.neutral) - 16]
    found = statics.support(robot, q, z, z, contacts)
    assert found.holds.all()
    R = [robot.forward_kinematics(q, foot)[:3, :3] for foot in FEET]
    forces = [R_sf.T @ f for R_sf, f in zip(R, found.forces[0], strict=True)]
    wrenches = {foot: np.r_[np.cross(c.point, f), f] for foot, c, f in zip(FEET, contacts, forces, strict=True)}
    tau = closed(robot).inverse_dynamics(q, z, z, actuated=DRIVES, wrench_on_robot=wrenches).tau
    drives = [robot.joint_names.index(name) + 5 for name in DRIVES]
    assert_allclose(np.delete(tau, drives), 0.0, atol=1e-9)
    h, rows = 1e-6, []
    for k in range(robot.nv):
        ahead, behind = (robot.add(q, s * h * np.eye(robot.nv)[k]) for s in (1, -1))
        rows.append((still(robot, ahead) - still(robot, behind)) / (2 * h))
    motions = null_space(np.array(rows).T, rcond=1e-6)
    assert motions.shape[1] >= 2  # the trunk can move on its feet
    assert_allclose(motions.T @ tau, motions.T @ robot.gravity_forces(q), atol=1e-6)


def still(robot, q):
    """Places of the feet, and gaps of the loops in their planes."""
    feet = [robot.forward_kinematics(q, foot) @ [0, 0, -0.02, 1] for foot in FEET]
    gaps = [
        robot.forward_kinematics(q, c.frame_a)[:3, 3] - robot.forward_kinematics(q, c.frame_b)[:3, 3]
        for c in robot.closures.values()
    ]
    return np.concatenate([*(p[:3] for p in feet), *gaps])
