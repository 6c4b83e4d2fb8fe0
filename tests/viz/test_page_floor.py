"""The floor under a robot let go: its links stay above it, energy is accounted for, and arms fall from a pedestal."""

from __future__ import annotations

import numpy as np
import pytest
from page_files import read_page
from page_under_node import under_node

import twistwrench as tw
from twistwrench.viz import scene_of, write_page
from twistwrench.viz.page_floor import spheres_of

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

DROP = """(m, { seconds, stops, height, q }) => {
    m.open = Boolean(m.robot.loops);
    const floor = new Floor(m, height, q ?? m.robot.start), fall = new Fall(m, q ?? m.robot.start, [], stops, null, floor);
    let deepest = 0, most = 0;
    while (fall.time < seconds && !fall.rests) {
      fall.step();
      deepest = Math.max(deepest, ...floor.heights(fall.y).map((z, i) => floor.below[i] - z));
      if (Math.round(fall.time / fall.h) % 16 === 0) fall.advance(0);
      most = Math.max(most, fall.most); }
    return { deepest, most, time: fall.time, rests: fall.rests, lost: fall.lost, drift: fall.drift, q: fall.q, touched: floor.pushes.size }; }"""


def test_an_arm_falls_onto_the_floor_and_rests_on_it(tmp_path):
    """Without the pedestal: the ur5 sinks by less than 1 % of its size, and comes to rest with contact."""
    page = write_page(tw.robots.ur5(), tmp_path / "page.html")
    header = read_page(page)[0]
    height = header["floor"] + 0.02
    found = under_node(page, DROP, {"seconds": 12, "stops": True, "height": height})
    assert found["rests"]
    assert found["touched"]
    assert 0 < found["deepest"] < 0.01 * header["size"]


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_spheres_around_a_link_end_where_it_ends(name):
    """Along the line of a link's spheres no vertex lies beyond the first or the last of them, and none of them beyond all."""
    scene = scene_of(getattr(tw.robots, name)())
    spheres = spheres_of(scene)
    for body in {sphere["body"] for sphere in spheres}:
        middles = np.array([sphere["middle"] for sphere in spheres if sphere["body"] == body])
        if len(middles) < 2:
            continue
        radius = next(sphere["radius"] for sphere in spheres if sphere["body"] == body)
        way = (middles[-1] - middles[0]) / np.linalg.norm(middles[-1] - middles[0])
        shapes = [shape for shape in scene.shapes if shape.body == body and shape.layer == "looks"]
        along = np.concatenate([shape.surface.placed(shape.pose).vertices for shape in shapes]) @ way
        ends = [middles[0] @ way - radius, middles[-1] @ way + radius]
        np.testing.assert_allclose(ends, [along.min(), along.max()], atol=1e-9)


def test_what_the_floor_takes_is_in_the_account_of_energy(tmp_path):
    """Without friction and stops, the sum of kinetic, potential and given energy stays within a microjoule."""
    page = write_page(tw.robots.ur5(), tmp_path / "page.html")
    header = read_page(page)[0]
    found = under_node(page, DROP, {"seconds": 0.9, "stops": False, "height": header["floor"] + 0.02})
    assert found["lost"] > 1.0
    assert found["drift"] < 2e-6
    assert found["deepest"] < 0.01 * header["size"]


def test_a_robot_off_its_feet_lands_on_the_floor(tmp_path):
    robot = tw.robots.quadruped()
    page = write_page(robot, tmp_path / "page.html")
    header = read_page(page)[0]
    q = np.array(header["start"])
    q[6] += 0.1
    found = under_node(page, DROP, {"seconds": 0.5, "stops": True, "height": header["floor"], "q": q.tolist()})
    assert found["touched"] > 0
    assert found["deepest"] < 0.01 * header["size"]
    assert found["q"][6] > 0.02


@pytest.mark.parametrize(("name", "stands"), [("ur5", True), ("panda", True), ("quadruped", False)])
def test_an_arm_on_the_floor_has_a_pedestal_as_high_as_its_reach(tmp_path, name, stands):
    robot = getattr(tw.robots, name)()
    header = read_page(write_page(robot, tmp_path / "page.html"))[0]
    pedestal = header["fall"]["pedestal"]
    assert (pedestal > 0) == stands
    if stands:
        q = np.random.default_rng(3).uniform(-np.pi, np.pi, (2000, robot.nv))
        reached = header["floor"] - robot.forward_kinematics(q)[:, 2, 3].min()
        assert reached < pedestal < 1.5 * reached + 0.1
