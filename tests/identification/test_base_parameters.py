"""Base parameters: the groups that torques tell, beside published ones, and what they must do for every robot."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from places import SHARED
from quick import mostly_slow

import twistwrench as tw
from twistwrench.identification import BaseParameters, MotorSide, UnknownParameters
from twistwrench.identification.parameters import group_units
from twistwrench.testing import random_robot

TX40 = SHARED / "robots" / "staubli_tx40.urdf"
PUBLISHED = SHARED / "logs" / "staubli_tx40" / "staubli_TX40_bp_5.csv"


@pytest.mark.parametrize("seed", mostly_slow(range(6), 3))
def test_groups_are_all_that_torques_tell(seed):
    """Parameters with the same groups give the same torques; as many groups as the regressor has rank."""
    robot = random_robot(seed, kinds=("revolute", "prismatic", "helical"))
    unknown = UnknownParameters(robot)
    base = BaseParameters.from_unknowns(unknown)
    rng = np.random.default_rng(seed)
    n = len(unknown.names)
    q = np.stack([robot.random_configuration(rng) for _ in range(4 * n)])
    dq, ddq = rng.normal(size=(2, 4 * n, robot.nv))
    W = unknown.columns(np.arange(n), q, dq, ddq, np.full(robot.nv, 0.3)).reshape(-1, n)
    assert base.count == np.linalg.matrix_rank(W / np.maximum(np.linalg.norm(W, axis=0), 1e-9), tol=1e-6)
    x = rng.normal(size=n)
    assert np.allclose(W @ x, W[:, base.kept] @ base.project(x), atol=1e-9 * np.abs(W @ x).max())


def test_regrouping_in_closed_form_keeps_the_groups():
    """What Gautier and Khalil's rules move inward is in no group: both models have the same ones."""
    from twistwrench.mechanics.model.parameters import regrouped

    robot = tw.robots.ur5()
    base = BaseParameters.from_unknowns(UnknownParameters(robot, motor_inertia=False, friction=()))
    moved = tw.Robot(regrouped(robot.model))
    before = base.project(base.unknown.file_values)
    after = base.project(UnknownParameters(moved, motor_inertia=False, friction=()).file_values)
    assert np.allclose(before, after, atol=1e-12 * np.abs(before).max())


def test_joints_of_several_degrees_are_refused():
    with pytest.raises(tw.ModelError, match="several degrees of freedom"):
        UnknownParameters(tw.robots.floating_box())


@pytest.mark.skipif(not PUBLISHED.is_file(), reason="the shared logs are not here")
def test_published_groups_of_the_tx40_are_among_ours():
    """FIGAROH's 60 groups, coefficients included, in our 61; ours has the inertia of motor 6 besides."""
    robot = tw.load(TX40)
    side = MotorSide(np.eye(6) + _coupling(), np.zeros(6), np.ones(6))
    base = BaseParameters.from_unknowns(UnknownParameters(robot, motor_side=side))
    assert base.count == 61
    ours = [_terms(name.replace("link_", "").replace("joint_", "")) for name in base.names]
    published = [line.split(",")[0] for line in PUBLISHED.read_text().splitlines() if line.strip()]
    assert len(published) == 60
    for text in published:
        wanted = _figaroh(text)
        assert any(
            set(wanted) == set(mine) and all(abs(wanted[k] - mine[k]) <= 2e-5 for k in wanted) for mine in ours
        ), text


def _coupling():
    found = np.zeros((6, 6))
    found[5, 4] = 1.0
    return found


KINDS = {
    "motor_inertia": "Ia",
    "viscous": "fv",
    "coulomb": "fs",
    "offset": "off",
    "mcx": "mx",
    "mcy": "my",
    "mcz": "mz",
}


def _terms(name):
    """{parameter as FIGAROH calls it: coefficient} of ``1.Izz + 0.07 3.mcz``."""
    found = {}
    for sign, size, owner, kind in re.findall(r"([+-]?)\s*(?:(\d[\d.e-]*) )?([\d+]+)\.([A-Za-z_]+)", name):
        short = KINDS.get(kind, kind)
        label = f"{short}m6" if owner == "5+6" else f"{short}{owner}"
        found[label] = (-1.0 if sign == "-" else 1.0) * float(size or 1.0)
    return found


def _figaroh(text):
    found = {}
    for sign, size, label in re.findall(r"([+-]?)\s*(?:([\d.]+)\*)?([A-Za-z]+\d)", text):
        found[label] = (-1.0 if sign == "-" else 1.0) * float(size or 1.0)
    return found


def test_armature_and_friction_of_the_file_count_as_unknown():
    robot = tw.robots.planar_2r().with_armature({"joint1": 0.5})
    unknown = UnknownParameters(robot)
    assert not unknown.model.armature.any() and not unknown.file_values[unknown.of_bodies < 0].any()
    with pytest.raises(tw.ModelError, match="actuators already"):
        geared = {"actuators": {"joint1": {"ratio": "50", "rotor": {"inertia": "1 g cm^2", "extra": "true"}}}}
        UnknownParameters(tw.robots.planar_2r().with_actuators(geared))
    assert replace(unknown, friction=()).names[10] == "joint1.motor_inertia"


def test_parameters_of_sliding_joints_have_units_of_forces():
    """Friction of a slide is a force, its motor inertia a mass; what a group is called by has its unit, of a body or a drive."""
    link = '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    joint = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" velocity="1"/></joint>'
    text = (
        "".join(map(link.format, "abc"))
        + joint.format("slide", "prismatic", "a", "b")
        + joint.format("turn", "revolute", "b", "c")
    )
    model = tw.load(f'<robot name="r">{text}</robot>').model
    kinds = "motor_inertia", "viscous", "coulomb", "offset"
    sliding = group_units([f"slide.{kind} + 2 turn.{kind}" for kind in kinds], model)
    turning = group_units([*(f"turn.{kind}" for kind in kinds), "c.m", "c.mcx - b.m", "b.Izz"], model)
    assert sliding == ("kg", "N s/m", "N", "N")
    assert turning == ("kg m^2", "N m s/rad", "N m", "N m", "kg", "kg m", "kg m^2")
