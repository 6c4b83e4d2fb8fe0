"""Which moving links are said to want a mass, and which massless ones are left alone."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from robot_files import BESIDE, FILES

import twistwrench as tw
from twistwrench.mechanics.model.inertia_checks import massless_links

INERTIAL = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
SHAPE = "<visual><geometry><box size='1 1 1'/></geometry></visual>"


def arm(*links: str, away: str = "0 0 0.3") -> tw.Robot:
    """A chain of revolute joints ``away`` from one another; ``links`` are what stands in the links after the base."""
    text = [f'<link name="link0">{SHAPE if any("visual" in x for x in links) else ""}</link>']
    for k, inside in enumerate(links, 1):
        limit = '<limit lower="-2" upper="2" effort="100" velocity="3"/>'
        text.append(
            f'<link name="link{k}">{inside}</link><joint name="joint{k}" type="revolute"><parent link="link{k - 1}"/>'
            f'<child link="link{k}"/><origin xyz="{away}"/><axis xyz="0 {k % 2} {1 - k % 2}"/>{limit}</joint>'
        )
    text.append(
        f'<link name="tool0"/><joint name="flange" type="fixed"><parent link="link{len(links)}"/><child link="tool0"/>'
        "</joint>"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(f"<robot name='arm'>{''.join(text)}</robot>")


def test_a_robot_without_any_mass_names_every_moving_link() -> None:
    assert massless_links(arm("", "", "").model) == ("link1", "link2", "link3")


def test_a_frame_fixed_to_a_link_with_mass_is_not_named() -> None:
    assert massless_links(arm(INERTIAL, INERTIAL).model) == ()


def test_the_one_link_without_mass_among_others_is_named_where_something_must_reach_to_the_next_joint() -> None:
    assert massless_links(arm(INERTIAL, "", INERTIAL).model) == ("link2",)


def test_a_ball_joint_of_three_revolute_joints_is_left_alone() -> None:
    assert massless_links(arm("", "", INERTIAL, away="0 0 0").model) == ()


def test_a_link_with_a_shape_needs_a_mass_wherever_its_joints_stand() -> None:
    assert massless_links(arm(SHAPE, "", SHAPE + INERTIAL, away="0 0 0").model) == ("link1",)


def test_a_link_that_moves_nothing_but_itself_needs_a_mass() -> None:
    assert massless_links(arm(INERTIAL + SHAPE, "", away="0 0 0").model) == ("link2",)


def test_a_mass_that_is_locked_on_or_carried_counts() -> None:
    robot = arm(INERTIAL, "", INERTIAL)
    assert massless_links(robot.lock({"joint3": 0.5}).model) == ()
    tip = arm(INERTIAL, "")
    assert massless_links(tip.model) == ("link2",)
    assert massless_links(tip.with_payload(tw.SpatialInertia.from_com(1.0), frame="tool0").model) == ()


def test_moments_without_a_mass_are_those_of_a_rotor() -> None:
    rotor = INERTIAL.replace('mass value="2"', 'mass value="0"')
    assert massless_links(arm(INERTIAL, rotor).model) == ()


@pytest.mark.skipif(not BESIDE.is_dir(), reason="the folder ../shared/robots is not there")
@pytest.mark.parametrize(
    ("file", "named"),
    [
        ("beside/mit_humanoid_massless_chain", 0),  # its hips and shoulders are several joints in one
        ("beside/g1_floating_ppprrr", 0),  # three sliding and three turning joints in place of a floating base
        ("beside/kuka_iiwa7_allegro", 0),
        ("beside/franka_panda_curobo_nonpsd", 2),  # the fingers
        ("beside/sdformat_massless_child_ft", 1),
    ],
)
def test_real_files(file: str, named: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.load(FILES[file], inertia="accept")
    found = massless_links(robot.model)
    assert len(found) == named
    assert not np.any([robot.model.link_inertias[link].mass for link in found])
