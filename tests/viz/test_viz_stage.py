"""A robot in the axes of a figure: where it is, which pose is pale, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.viz.style import figure

pytest.importorskip("matplotlib")


def drawn(robot, q, **options):
    """The camera, and the corners and colours of each part, shadow and robot by turns."""
    with figure(4, 3, "a robot") as whole:
        axes = whole.subplots()
        camera = tw.viz.draw(axes, robot, q, **options)
        parts = [(np.array([p.vertices[:3] for p in c.get_paths()]), c.get_facecolor()) for c in axes.collections]
    return camera, parts, axes


def test_all_that_is_drawn_is_where_the_camera_sees_it():
    """Of the surfaces of the scene, moved by forward kinematics here."""
    robot, q = tw.robots.ur5(), np.array([0.3, -1.2, 1.0, 0.2, 0.4, 0.1])
    camera, [_, (corners, _)], axes = drawn(robot, q)
    poses = dict(zip(robot.link_names, robot.link_poses(q), strict=True))
    looks = [s for s in tw.viz.scene_of(robot).shapes if s.layer == "looks" and s.body >= 0]
    assert looks
    for shape in looks:
        link = robot.model.bodies[shape.body].link
        points = shape.surface.placed(poses[link] @ shape.pose).vertices
        at = camera.project(points)[0]
        away = np.abs(corners.reshape(-1, 1, 2) - at[:5]).max(axis=-1).min(axis=0)
        assert away.max() < 1e-12
    low, high = np.array(axes.get_xlim()), corners[..., 0]
    assert low[0] <= high.min()
    assert high.max() <= low[1]


def test_earlier_poses_are_paler_and_shade_no_other():
    robot = tw.robots.planar_2r()
    _, parts, axes = drawn(robot, [[0.0, 0.5], [0.3, 0.8], [0.6, 1.1]])
    assert len(parts) == 6
    lightness = [colours[:, :3].mean() for _, colours in parts[1::2]]
    assert lightness == sorted(lightness, reverse=True)
    assert lightness[0] - lightness[2] > 0.1
    orders = [c.get_zorder() for c in axes.collections]
    assert max(orders[::2]) < min(orders[1::2])
    alone = drawn(robot, [0.6, 1.1])[1][1][1]  # from a camera that is elsewhere, so only about the same
    assert lightness[2] == pytest.approx(alone[:, :3].mean(), abs=0.02)


def test_without_inertia_all_is_solid():
    dog = tw.robots.quadruped()
    some, whole = (drawn(dog, dog.neutral, inertia=i)[1][1][1] for i in (False, True))
    assert (some[:, 3] == 1).all()
    assert (whole[:, 3] < 1).any()
    assert len(some) == (whole[:, 3] == 1).sum()


def test_poses_are_checked():
    robot = tw.robots.planar_2r()
    with pytest.raises(tw.ShapeError, match="draw: q"):
        drawn(robot, [0.0, 0.5, 1.0])
    with pytest.raises(tw.ShapeError, match="expected"):
        drawn(robot, np.zeros((2, 2, 2)))
    with pytest.raises(tw.ShapeError, match="n poses"):
        drawn(robot, np.zeros((0, 2)))
    with pytest.raises(tw.ValueRangeError, match="finite"):
        drawn(robot, [0.0, np.nan])
    with pytest.raises(tw.ValueRangeError, match="floor"):
        drawn(robot, [0.0, 0.5], floor="low")
