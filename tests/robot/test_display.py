"""What robots show in notebooks and give to programs."""

from __future__ import annotations

import json
from html.parser import HTMLParser

import numpy as np
import pytest

import twistwrench as tw


class Cells(HTMLParser):
    """The texts of a table's cells; every tag is closed."""

    def __init__(self):
        super().__init__()
        self.open, self.cells = [], []

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        if tag == "td":
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "td":
            self.cells[-1] += data


def cells(thing):
    found = Cells()
    found.feed(thing._repr_html_())
    assert not found.open
    return found.cells


def test_a_robots_table_has_its_joints_and_limits():
    found = cells(tw.robots.ur5())
    assert "shoulder_pan_joint" in found and "150" in found and len(found) == 6 * 9


def test_the_title_of_a_robot_with_several_ends_says_that_it_has_no_tip():
    dog = tw.robots.quadruped()
    assert dog.tip is None and "tip none" in dog._repr_html_() and "None" not in dog._repr_html_()


def test_names_are_text_and_never_markup():
    text = tw.robots.path_of("pendulum").read_text("utf-8")
    name = tw.robots.pendulum().joint_names[0]
    robot = tw.load(text.replace(f'"{name}"', '"&lt;script&gt;x"'))
    assert "<script>" not in robot._repr_html_() and "<script>x" in cells(robot)


def test_inertias_and_reports_have_tables():
    assert cells(tw.SpatialInertia.from_com(2, (0, 0, 0.1), [[1, 0, 0], [0, 2, 0], [0, 0, 2.5]]))[4] == "2"
    assert cells(tw.doctor(tw.robots.path_of("planar_2r"))) is not None


def test_identified_robots_have_tables():
    arm, t = tw.robots.pendulum(), np.arange(0, 10, 0.01)
    motion = tw.Motion(t, (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None], robot=arm)
    log = tw.Motion(t, motion.q, tau=motion.torques() + 0.01 * np.sin(40 * t)[:, None], robot=arm)
    found = tw.identification.identify(arm, log, friction=())
    assert cells(found)[0] == arm.model.bodies[0].link and cells(found)[4] == "all"
    assert str(found.verdict.word) in found._repr_html_()


def test_simulations_have_tables():
    fall = tw.robots.planar_2r().simulate([0.5, 0.2], duration=0.1, dt=0.05)
    assert cells(fall)[:2] == ["joint1", "0.5"] and len(cells(fall)) == 2 * 5
    assert "simulated 0.1 s." in fall._repr_html_()


def test_a_simulations_table_has_start_end_lowest_and_highest_in_that_order():
    swing = tw.robots.pendulum().simulate([1.0], [2.0], duration=1.0)
    q = swing.q[:, 0]
    assert q.max() > q[0] + 0.01  # up first, then down
    start, end, lowest, highest = map(float, cells(swing)[1:5])
    np.testing.assert_allclose([start, end, lowest, highest], [q[0], q[-1], q.min(), q.max()], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", ["ur5", "quadruped", "floating_box"])
def test_info_is_what_json_takes(name):
    robot = getattr(tw.robots, name)()
    found = json.loads(json.dumps(robot.info()))
    assert found["nv"] == robot.nv and found["name"] == robot.name
