"""Links to what a page shows, and the same in Python: under Node, and in a browser what buttons and the back button do."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from page_under_node import under_node
from test_page_verdict import report_of

import twistwrench as tw
from twistwrench.motion.load_case import Payload
from twistwrench.reports.drawn_motion import reported_motion
from twistwrench.viz import write_page

pytest_plugins = ("page_fixtures",)

FIRST = """const first = { q: motion ? null : m.robot.start, load: 5, push: [0, 0, 0], speed: 1, t: 0,
    camera: [1, 0.5, 2, 0, 0, 0.3], layers: ["looks", "torques"] };"""


@pytest.fixture(scope="module")
def motion():
    robot, wrench = tw.robots.ur5(), {"tool0": np.array([0, 0, 1.0, 4.0, 0, -20.0])}
    log = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
    return reported_motion(report_of(robot, log, Payload(5.0, (0.0, 0.0, 0.1)), wrenches=wrench))


@pytest.fixture(scope="module")
def written(motion, tmp_path_factory):
    return write_page(motion.load.robot, tmp_path_factory.mktemp("sharing") / "ur5.html", motion=motion)


def test_an_address_gives_back_the_state_that_wrote_it(written):
    work = f"""(m, state, motion) => {{ {FIRST} const hash = written(state, first);
        return [hash, read(hash, m.robot, first), written(first, first)]; }}"""
    state = {
        "q": [0.1, -1.25, 1.5, 0, 2e-7, -3],
        "load": 8.38,
        "push": [0, 0, -60],
        "speed": 1.5,
        "t": 1.808,
        "camera": [1, 0.5, 2.125, 0, -1e-3, 0.3],
        "layers": ["looks", "path"],
    }
    hash_, found, empty = under_node(written, work, state)
    assert hash_ == (
        "q=0.1,-1.25,1.5,0,2e-7,-3&load=8.38&push=0,0,-60&speed=1.5&t=1.808&camera=1,0.5,2.125,0,-0.001,0.3&layers=looks,path"
    )
    assert found == state
    assert empty == ""


WRONG = [
    "q=1,2", "q=a,b,c,d,e,f", "load=-3", "load=", "load=NaN", "push=1,2", "push=1,2,Infinity", "speed=0", "speed=x",
    "t=soon", "camera=1,2,-3,0,0,0", "camera=1", "unknown=7", "&&&=", "%", "load=1e999",
]  # fmt: skip


def test_what_an_address_has_wrong_falls_back(written):
    work = f"(m, all, motion) => {{ {FIRST} return [first, all.map((hash) => read(hash, m.robot, first))]; }}"
    first, found = under_node(written, work, [f"#{wrong}" for wrong in [*WRONG, "layers=nothing,<b>,looks"]])
    assert found[:-1] == [first] * len(WRONG)
    assert found[-1] == first | {"layers": ["looks"]}


def run(text, folder):
    """The array that a program prints at its end."""
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, cwd=folder, check=False, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr
    return np.array(done.stdout.replace("[", " ").replace("]", " ").split(), float)


def test_copied_python_prints_the_torques_of_the_page(written, tmp_path):
    """The largest of the motion under payload, push, wrench and speed; and those that hold a pose."""
    work = """(m, given, motion) => { m.mass = 6; m.push = [3, 0, -40]; motion.pace = 1.5; motion.run();
        const viewer = { robot: m.robot, mechanics: m, motion, posed: false, q: given, time: 0 };
        const text = pythonOf(viewer), pose = pythonOf({ ...viewer, posed: true });
        return [text, motion.peaks.map((peak) => Math.abs(peak.value)), pose, m.holding(given)]; }"""
    text, peaks, pose, holding = under_node(written, work, [0.3, -1.2, 1.3, -0.5, 0.4, 0.1])
    assert text.startswith("import numpy as np\nimport twistwrench as tw\n\nrobot = tw.robots.ur5()\n")
    np.testing.assert_allclose(run(text, tmp_path), peaks, rtol=1e-7)
    np.testing.assert_allclose(run(pose, tmp_path), holding, rtol=1e-7, atol=1e-7)


def test_a_robot_file_is_loaded_by_its_name_and_not_by_its_folder(tmp_path):
    (tmp_path / "arm.urdf").write_text(tw.robots.path_of("planar_2r").read_text())
    robot = tw.load(tmp_path / "arm.urdf").with_payload(tw.SpatialInertia.from_com(2.0, (0.1, 0, 0)), frame="tip")
    page = write_page(robot, tmp_path / "page.html")
    work = """(m, q) => [pythonOf({ robot: m.robot, mechanics: m, motion: null, posed: true, q }), m.holding(q)]"""
    text, holding = under_node(page, work, [0.3, 0.4])
    assert "tw.load('arm.urdf', tip='tip')" in text
    assert str(tmp_path) not in page.read_text()
    np.testing.assert_allclose(run(text, tmp_path), holding, rtol=1e-7)


# ── In a browser


def test_ctrl_z_undoes_a_release_and_back_leaves(show, motion):
    page = show("ur5_share", motion.load.robot, motion=motion)
    put = """(id, x, kind) => { const s = document.getElementById(id); s.value = x; s.dispatchEvent(new Event("input"));
        if (kind) s.dispatchEvent(new Event(kind)); }"""
    entries = page.run("history.length")
    keys = """(shift) => document.body.dispatchEvent(new KeyboardEvent("keydown",
        { key: "z", ctrlKey: true, shiftKey: shift, bubbles: true, cancelable: true }))"""
    for x in (6, 7, 8):
        page.run(f"({put})('payload', {x})")
    assert page.run("[history.length, location.hash]") == [entries, ""]  # it was not let go yet
    page.run(f"({put})('payload', 10, 'change')")
    assert page.run("location.hash") == "#load=10"
    page.run(f"({put})('pace', 2, 'change')")
    over = page.run("viewer.verdict.text")
    assert over.startswith("OVER LIMIT")
    page.run(f"({keys})(false)")
    assert page.run("[location.hash, viewer.motion.pace]") == ["#load=10", 1]
    page.run(f"({keys})(false)")
    page.run(f"({keys})(false)")  # nothing is left to undo
    assert page.run("[location.hash, viewer.mechanics.mass]") == ["", 5]
    page.run(f"({keys})(true)")
    page.run(f"({keys})(true)")
    assert page.run("[location.hash, viewer.motion.pace]") == ["#load=10&speed=2", 2]
    assert page.run("viewer.verdict.text") == over
    page.run("document.dispatchEvent(new KeyboardEvent('keydown', { key: 'r' }))")
    assert page.run("[viewer.motion.pace, viewer.mechanics.mass, location.hash]") == [1, 5, ""]
    page.run("document.body.dispatchEvent(new PointerEvent('pointerdown', { bubbles: true }))")
    page.run("document.getElementById('payload-typed').value = '8,38 kg'")
    page.run("document.getElementById('payload-typed').dispatchEvent(new Event('change'))")
    assert page.run("[viewer.mechanics.mass, location.hash]") == [8.38, "#load=8.38"]
    page.run("document.getElementById('payload-typed').value = 'much'")
    page.run("document.getElementById('payload-typed').dispatchEvent(new Event('change'))")
    assert page.run("[viewer.mechanics.mass, document.getElementById('payload-typed').value]") == [8.38, "8.38 kg"]
    steps = page.run("viewer.address.past.length")
    page.run("document.body.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true }))")
    for x in (9, 9.5, 10):  # keys pressed within a second are one step
        page.run(f"({put})('payload', {x}, 'change')")
    assert page.run("viewer.address.past.length") == steps + 1
    page.run(f"({keys})(false)")
    assert page.run("viewer.mechanics.mass") == 8.38
    assert page.run("history.length") == entries
    assert page.complaints == []


@pytest.mark.slow
def test_a_page_opens_in_the_state_of_its_address(show, motion, folder):
    page = show("ur5_share", motion.load.robot, motion=motion)
    link = "#load=10&push=0,0,-20&speed=1.5&t=1.2&camera=-0.5,0.4,2,0,0,0.3&layers=looks,torques"
    page.call("Page.navigate", url="about:blank")
    page.open((folder / "ur5_share.html").as_uri() + link)
    assert page.wait("!!window.viewer")
    seen = page.run("""[viewer.mechanics.mass, viewer.mechanics.push, viewer.motion.pace, viewer.motion.shown(viewer.time),
        viewer.stage.azimuth, viewer.shown.path, document.getElementById('payload-typed').value, `#${viewer.address.hash}`]""")
    assert seen == [10, [0, 0, -20], 1.5, pytest.approx(1.2), -0.5, False, "10 kg", link]
    q = [0.1, -1.25, 1.5, 0.25, 0.5, -3.0]
    page.run(f"location.hash = 'q={','.join(map(str, q))}'")
    page.wait("viewer.posed")
    assert page.run("viewer.q") == q
    assert page.complaints == []


@pytest.mark.slow
def test_the_menu_copies_and_draws(show, motion):
    page = show("ur5_share", motion.load.robot, motion=motion)
    page.run("document.getElementById('menu').open = true")
    page.click("#copy-python")
    assert page.wait("document.getElementById('copied').value").startswith("import numpy as np")
    page.click("#copy-link")
    page.wait("document.getElementById('said').textContent.includes('file goes with it')")
    assert page.run("document.getElementById('copied').value").startswith("#")
    size, share = page.run("""(() => { const paper = viewer.menu.picture(), draw = paper.getContext('2d');
        const data = draw.getImageData(0, 0, paper.width, paper.height).data, first = data.slice(0, 3);
        let other = 0;
        for (let k = 0; k < data.length; k += 4) if (Math.abs(data[k] - first[0]) > 30) other += 1;
        return [[paper.width, paper.height], (4 * other) / data.length]; })()""")
    box = page.run("[viewer.stage.canvas.clientWidth - viewer.stage.covered.right, viewer.stage.canvas.clientHeight]")
    assert size == [2 * x for x in box]
    assert 0.01 < share < 0.6  # the robot and the words are on it
    assert page.complaints == []
