"""``robot.show()`` and ``motion.show()``: a frame in a notebook, the browser elsewhere."""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.viz.page import viewer_page

pytest_plugins = ("page_fixtures",)


@pytest.fixture
def opened(monkeypatch):
    """Addresses that were opened in a browser, which this machine seems to have."""
    found = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda url: found.append(url) or True)
    return found


def frame(page):
    """Text of the page that the frame of a notebook holds."""
    shown = page._repr_html_()
    assert 'sandbox="allow-scripts"' in shown
    return html.unescape(re.fullmatch(r'<iframe srcdoc="([^"]*)" .*></iframe>', shown, re.DOTALL)[1])


def test_outside_of_a_notebook_the_browser_opens_the_page(opened, monkeypatch):
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    robot = tw.robots.planar_2r()
    page = robot.show([0.3, 0.4])
    [url] = opened
    assert Path(url.removeprefix("file://")).read_text("utf-8") == page.text == viewer_page(robot, q=[0.3, 0.4]).page


def test_in_a_notebook_a_frame_holds_the_page_as_it_is(opened, monkeypatch):
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    t = np.linspace(0, 1, 21)
    motion = tw.Motion(t, np.outer(np.sin(t), [1.0, 0.5]), robot=tw.robots.planar_2r())
    page = motion.show(embed=True, control="speed")
    assert frame(page) == page.text
    assert opened == []
    with pytest.raises(tw.ValueRangeError, match="this page has payload, push, speed"):
        motion.show(control="elbow")
    with pytest.raises(tw.ValueRangeError, match="the motion belongs to robot"):
        motion.show(tw.robots.ur5())


@pytest.mark.slow
def test_the_page_runs_within_a_frame_that_reaches_nothing(page, folder, monkeypatch):
    """It draws, and complains of nothing, although it has no address of its own."""
    monkeypatch.setitem(sys.modules, "ipykernel", ModuleType("ipykernel"))
    path = folder / "notebook.html"
    path.write_text(f"<!doctype html><body>{tw.robots.ur5().show()._repr_html_()}", "utf-8")
    page.complaints.clear()
    page.open(path.as_uri())
    page.wait("document.querySelector('iframe') !== null")
    page.run("new Promise((done) => setTimeout(done, 3000))")
    seen = page.picture().astype(int)[8:488]
    dark = (seen.sum(axis=2) < 250).mean()
    assert 0.002 < dark < 0.3  # the robot, and words
    box = page.run("(({ left, bottom }) => [left, bottom])(document.querySelector('iframe').getBoundingClientRect())")
    page.drag((box[0] + 500, box[1] - 40), (box[0] + 560, box[1] - 40), (box[0] + 600, box[1] - 40))
    page.run("new Promise((done) => setTimeout(done, 500))")
    assert page.complaints == []
