"""Pages without a side panel: within another page, and on a small screen. What remains works and fits."""

from __future__ import annotations

import base64
import re

import pytest
from click.testing import CliRunner
from page_files import read_page
from test_page_verdict import report_of

import twistwrench as tw
from twistwrench.cli import main
from twistwrench.motion.load_case import Payload
from twistwrench.reports.drawn_motion import reported_motion
from twistwrench.viz import write_page

pytest_plugins = ("page_fixtures",)
SEEN = """(() => {
    const names = ["header", "#verdict", "#one", "#player", "aside", "#shown"], found = {};
    for (const name of names) {
        const e = document.querySelector(name), box = e.getBoundingClientRect();
        if (box.width && getComputedStyle(e).visibility !== "hidden") found[name] = [box.left, box.top, box.right, box.bottom];
    }
    return found; })()"""


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def motion():
    log = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
    return reported_motion(report_of(tw.robots.ur5(), log, Payload(5.0)))


@pytest.fixture
def at(page, folder, motion):
    """Opens the motion's page, or an embedded one, at a size and a place of its address."""

    def at(width, height, hash_="", **options):
        path = folder / f"embed{len(options)}.html"
        if not path.exists():
            write_page(motion.load.robot, path, motion=motion, **options)
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        page.call("Page.navigate", url="about:blank")
        page.complaints.clear()
        page.open(f"{path.as_uri()}{hash_}")
        assert page.wait("!!window.viewer")
        page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return page

    at.folder = folder
    yield at
    page.call("Emulation.clearDeviceMetricsOverride")


def apart(boxes, width, height):
    """True if all boxes are on the screen and none overlaps another."""
    inside = all(a >= 0 and b >= 0 and c <= width and d <= height for a, b, c, d in boxes)
    pairs = [(x, y) for k, x in enumerate(boxes) for y in boxes[:k]]
    return inside and not any(min(x[2], y[2]) > max(x[0], y[0]) and min(x[3], y[3]) > max(x[1], y[1]) for x, y in pairs)


def test_a_small_screen_has_the_verdict_one_control_and_the_play_bar(at):
    page = at(390, 844, "#load=10&t=1.808")
    seen = page.run(SEEN)
    assert sorted(seen) == sorted(["header", "#verdict", "#one", "#player"])
    assert apart(list(seen.values()), 390, 844)
    assert page.run("document.getElementById('verdict').textContent").startswith("OVER LIMIT: shoulder_lift_joint")
    assert page.run("Array.from(document.querySelectorAll('#one input'), (e) => e.id)") == ["payload", "payload-typed"]
    page.click("#open-full")  # the panel, and back
    assert {"aside", "#shown"} <= set(page.run(SEEN))
    assert page.run("document.querySelector('#load #payload') !== null")
    page.click("#open-full")
    assert page.run(SEEN) == seen
    assert page.complaints == []


@pytest.mark.slow
@pytest.mark.parametrize(("control", "named"), [("speed", "pace"), ("push", "push-z"), ("q:elbow_joint", "hand-2")])
def test_an_embedded_page_keeps_the_control_that_is_named(at, control, named, folder):
    (folder / "embed2.html").unlink(missing_ok=True)
    page = at(900, 520, embed=True, control=control)
    seen = page.run(SEEN)
    assert sorted(seen) == sorted(["header", "#verdict", "#one", "#player"])
    assert apart(list(seen.values()), 900, 520)
    assert page.run("document.querySelector('#one input').id") == named
    corners = page.run("""viewer.robot.bodies.map((_, k) => viewer.stage.project(place(viewer.poses[k])))""")
    assert all(0 < x < 900 and 0 < y < seen["#one"][1] for x, y in corners)  # nothing covers the robot
    assert page.complaints == []
    page.call("Page.navigate", url="about:blank")
    page.open(f"{(folder / 'embed2.html').as_uri()}#full")
    assert page.wait("!!window.viewer")
    assert "aside" in page.run(SEEN)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (900, 520), (700, 800), (390, 844)])
def test_nothing_overlaps_and_words_stand_out(at, width, height, scheme):
    """Contrast of the verdict's words with its paper, in light and dark: 4.5 to 1 at least."""
    page = at(width, height, "#load=10")
    page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    try:
        seen = page.run(SEEN)
        boxes = [box for name, box in seen.items() if name != "#verdict" or "aside" not in seen]
        assert apart(boxes, width, height)
        colours = page.run("""Array.from(document.querySelectorAll('#verdict b, #verdict span, #load h2, #subtitle'), (e) =>
            getComputedStyle(e).color.match(/[\\d.]+/g).slice(0, 3).map(Number))""")
        paper = page.run(
            "getComputedStyle(document.getElementById('verdict')).backgroundColor.match(/[\\d.]+/g).map(Number)"
        )
        stage = 255 if scheme == "light" else 60
        ground = [paper[3] * c + (1 - paper[3]) * stage for c in paper[:3]] if len(paper) > 3 else paper
        for colour in colours:
            assert contrast(colour, ground) >= 4.5
    finally:
        page.call("Emulation.setEmulatedMedia", features=[])


def contrast(a, b):
    def light(colour):
        c = [x / 255 / 12.92 if x / 255 <= 0.04045 else ((x / 255 + 0.055) / 1.055) ** 2.4 for x in colour]
        return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]

    low, high = sorted([light(a), light(b)])
    return (high + 0.05) / (low + 0.05)


NOTCHES = 10


@pytest.fixture
def frame(page, folder, motion):
    """A page with the motion's page in a frame at its top, and room to scroll."""
    write_page(motion.load.robot, folder / "guest.html", motion=motion, embed=True, control="payload")
    host = folder / "host.html"
    host.write_text(
        "<!doctype html><body style='margin:0;height:4000px'>"
        "<iframe id='guest' src='guest.html' style='width:900px;height:480px;border:0;display:block'></iframe>"
    )
    page.complaints.clear()
    page.open(host.as_uri())
    page.wait("!!document.getElementById('guest').contentDocument || true")
    return page


def scrolled(page, x, y, **keys):
    """How far the page scrolls in ten notches of the wheel at a place [px]."""
    page.run("scrollTo(0, 0)")
    before = page.run("scrollY")
    for _ in range(NOTCHES):
        page.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=40, **keys)
    page.run("new Promise((done) => setTimeout(done, 300))")
    return page.run("scrollY") - before


def test_the_wheel_over_an_embedded_page_scrolls_the_page_around_it(frame):
    beside, over = scrolled(frame, 1100, 240), scrolled(frame, 450, 240)
    assert over == beside == NOTCHES * 40
    assert frame.complaints == []


def test_an_embedded_page_zooms_with_ctrl_and_stays_above_the_floor(at):
    page = at(900, 520, embed=True)
    wheel = """(ctrl) => { const event = new WheelEvent("wheel", { deltaY: 100, ctrlKey: ctrl, bubbles: true, cancelable: true });
        const before = viewer.stage.distance; viewer.stage.canvas.dispatchEvent(event);
        return [event.defaultPrevented, viewer.stage.distance > before, document.getElementById("hint").hidden]; }"""
    assert page.run(f"({wheel})(true)") == [True, True, True]
    assert page.run(f"({wheel})(false)") == [False, False, False]  # and it says how to zoom
    assert page.run("document.getElementById('hint').textContent").endswith("+ scroll to zoom")
    page.wait("document.getElementById('hint').hidden", 3)
    assert page.run("getComputedStyle(viewer.stage.canvas).touchAction") == "pan-y"
    page.drag((300, 300), (300, 200), (300, 5))
    assert page.run("viewer.stage.elevation") == 0.02
    assert page.run("viewer.stage.camera().eye[2] > viewer.robot.floor")
    page = at(1280, 800)
    assert page.run(f"({wheel})(false)") == [True, True, True]
    assert page.run("getComputedStyle(viewer.stage.canvas).touchAction") == "none"
    assert page.complaints == []


def test_a_page_never_answers_ok_beside_a_red_joint(at):
    """A pose set by hand that passes a limit, under a motion that keeps all."""
    page = at(1280, 800, "#load=12&speed=0.25")
    word = "document.getElementById('verdict').textContent"
    assert page.run(word).startswith("OK: ")
    page.run("viewer.setCoordinates([0, 0, 0, -Math.PI / 2, Math.PI / 2, 0])")
    need = page.run(
        "[Math.max(...viewer.tau.map((x, k) => Math.abs(x) / viewer.robot.torques[k].limit)), viewer.over.size]"
    )
    assert need[0] > 1 and need[1] > 0
    assert page.run(word).startswith("OVER LIMIT: shoulder_lift_joint needs ")
    page.run("viewer.seek(0)")
    assert page.run(word).startswith("OK: ")


def test_a_payload_beyond_the_largest_asks_to_be_dragged_back(at, folder):
    """With a mark at the largest payload; the robot fills the frame, with its upper arm red."""
    page = at(690, 560, "#load=10", embed=True)
    seen = """[!document.getElementById("try").hidden, viewer.redBodies().size, document.querySelector("#one .slid i").title,
        document.querySelector("#one .slid i").getBoundingClientRect().x]"""
    asked, red, title, x = page.run(seen)
    assert (asked, red, title) == (True, 1, "allowed: 8.38 kg")
    knob = page.run("""(() => { const slider = document.getElementById("payload"), box = slider.getBoundingClientRect();
        return box.x + 8 + (8.38 / slider.max) * (box.width - 16); })()""")
    assert abs(x + 1 - knob) < 2
    page.run("""(() => { const slider = document.getElementById("payload"); slider.value = 8.3;
        slider.dispatchEvent(new Event("input")); })()""")
    asked, red, *_ = page.run(seen)
    assert (asked, red) == (False, 0)
    assert page.run("document.getElementById('verdict').textContent").startswith("OK: ")


TALL = """(() => { const { stage, poses, robot, grasp } = viewer;
    const y = [...robot.bodies.map((_, k) => place(poseOf(poses, k))), [0, 0, 0], grasp.tip].map((p) => stage.project(p)[1]);
    return (Math.max(...y) - Math.min(...y)) / innerHeight; })()"""


@pytest.mark.parametrize(("width", "least"), [(900, 0.45), (690, 0.45), (358, 0.25)])
def test_the_robot_fills_the_frame_of_a_guide(at, width, least):
    """Joints and tip at the motion's start, as a share of the frame's height, on a desktop and on a phone."""
    assert at(width, 560, embed=True).run(TALL) > least


@pytest.mark.parametrize(("width", "least"), [(900, 0.45), (690, 0.45), (358, 0.25)])
def test_a_robot_to_be_let_go_fills_its_frame_until_it_falls(page, folder, width, least):
    """Then the view draws back to its floor, and stays there when it is stopped."""
    path = folder / "falling.html"
    if not path.exists():
        write_page(tw.robots.ur5(), path, embed=True, control="fall")
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=560, deviceScaleFactor=1, mobile=False)
    try:
        page.call("Page.navigate", url="about:blank")
        page.complaints.clear()
        page.open(path.as_uri())
        page.wait("!!window.viewer")
        assert page.run(TALL) > least
        near = page.run("viewer.stage.distance")
        floor = "viewer.stage.project([0, 0, viewer.ground])[1]"
        assert page.run(floor) > 560
        page.click("#let-go")
        page.wait("!viewer.glide && viewer.fall.time > 0.1")
        assert page.run(floor) < 560
        page.click("#let-go")
        assert page.run("viewer.fall") is None
        assert page.run("viewer.stage.distance") > 1.3 * near
        assert page.complaints == []
    finally:
        page.call("Emulation.clearDeviceMetricsOverride")


def test_without_scripts_the_sentence_of_the_verdict_is_there(page, at, motion):
    page.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        page.call("Page.navigate", url="about:blank")
        page.call("Page.navigate", url=(at.folder / "embed0.html").as_uri())
        page.wait("document.readyState === 'complete' && location.href !== 'about:blank'")
        text = page.run(
            "document.querySelector('noscript').innerText || document.querySelector('noscript').textContent"
        )
        assert "OK: all limits kept. Closest: shoulder_lift_joint" in text
        hidden = "getComputedStyle(document.querySelector('aside')).visibility"
        assert page.run(hidden) == "hidden"
    finally:
        page.call("Emulation.setScriptExecutionDisabled", value=False)


def test_a_frame_without_scripts_has_a_picture_of_its_first_frame(motion, tmp_path):
    """WebP of at most 25 kB, inside noscript; a page by itself has the sentence alone."""
    image = re.compile(r'<noscript><img alt="" width="480" src="data:image/webp;base64,([^"]+)">')
    framed = write_page(motion.load.robot, tmp_path / "framed.html", motion=motion, embed=True).read_text("utf-8")
    content = base64.b64decode(image.search(framed)[1])
    assert content[8:12] == b"WEBP"
    assert len(content) <= 25_000
    assert not image.search(write_page(motion.load.robot, tmp_path / "page.html", motion=motion).read_text("utf-8"))


@pytest.mark.parametrize("width", [1280, 390])
def test_typed_loads_fit_their_fields(at, width):
    """Six digits and a minus sign, in the panel and in the one row of a phone."""
    page = at(width, 844)
    put = """(id, text) => { const field = document.getElementById(`${id}-typed`); field.value = text; field.dispatchEvent(new Event("change"));
        return [field.value, field.scrollWidth <= field.clientWidth]; }"""
    assert page.run(f"({put})('payload', '8.33333')") == ["8.33333 kg", True]
    if width == 1280:
        assert page.run(f"({put})('push-x', '-123.456')") == ["−123.456 N", True]
    assert page.complaints == []


SMALL = """[...document.querySelectorAll('button, input, select, summary, #open-full')].filter((e) => e.checkVisibility({ visibilityProperty: true }))
    .map((e) => [e.id || e.textContent, e.getBoundingClientRect().height]).filter(([, height]) => height < 39.5)"""


def test_on_a_phone_targets_are_large_and_nothing_scrolls_sideways(at):
    page = at(390, 844, "#load=10")
    assert page.run(SMALL) == []
    lines = "Math.round((document.getElementById('verdict').clientHeight - 6) / parseFloat(getComputedStyle(document.getElementById('verdict')).lineHeight))"
    assert page.run(lines) <= 3
    page.click("#open-full")
    assert page.run(SMALL) == []
    assert page.run("document.documentElement.scrollWidth") == 390
    assert page.complaints == []


def test_a_page_within_another_plays_once_and_stands_at_its_start(opened):
    """As long as it is looked at, a motion that goes on by itself draws the eye from the text around it."""
    page = opened(tw.check("ur5", "demo"))
    page.run("Object.assign(viewer, { once: true, playing: true, now: 0 }); viewer.seek(viewer.motion.end - 1e-3)")
    seen = page.run(
        "(() => { viewer.now = 0; viewer.advance(100); return [viewer.playing, viewer.once, viewer.time]; })()"
    )
    assert seen == [False, False, page.run("viewer.motion.begin")]


@pytest.mark.parametrize(("address", "embedded"), [("", True), ("#full", False), ("#embed", True)])
def test_the_address_opens_an_embedded_page_in_full(page, folder, address, embedded):
    path = folder / "ur5_address.html"
    if not path.exists():
        write_page(tw.robots.ur5(), path, embed=True)
    page.call("Page.navigate", url="about:blank")
    page.open(path.as_uri() + address)
    assert page.wait("!!window.viewer")
    assert page.run("viewer.compact.embedded") == embedded


def test_no_control_adds_to_the_history(at):
    page = at(900, 520, embed=True)
    before = page.run("history.length")
    for x in (6, 7, 8, 9, 10):
        page.run(f"""(() => {{ const slider = document.getElementById("payload"); slider.value = {x};
            slider.dispatchEvent(new Event("input")); slider.dispatchEvent(new Event("change")); }})()""")
    assert page.run("[history.length, location.hash]") == [before, "#load=10"]


def test_the_shell_writes_embedded_pages_and_refuses_controls_that_are_not_there(tmp_path):
    out = tmp_path / "a.html"
    done = run("view", "ur5", "--trajectory", "demo", "--payload", "5", "--html", out, "--embed", "--control", "speed")
    assert done.exit_code == 0, done.output
    header, _ = read_page(out)
    assert (header["embed"], header["control"]) == (True, "speed")
    assert out.stat().st_size < 340_000
    done = run("view", "ur5", "--html", out, "--embed", "--control", "speed")
    assert done.exit_code == 2
    assert "this page has payload, push, fall, q:shoulder_pan_joint" in done.output
    done = run("view", "ur5", "--embed", "--no-browser")
    assert done.exit_code == 2
    assert "Add --html" in done.output


def test_pages_stay_small(tmp_path, motion):
    """Without meshes: a robot at most 210 kB, a motion of 751 rows at most 340 kB."""
    assert write_page(motion.load.robot, tmp_path / "robot.html").stat().st_size <= 210_000
    assert write_page(motion.load.robot, tmp_path / "motion.html", motion=motion).stat().st_size <= 340_000


@pytest.fixture
def opened(page, folder):
    """Opens the page inside the page of an answer."""

    def opened(answer, width=960, height=480):
        path = folder / f"{answer.call}.html"
        path.write_text(answer.viewer().page, encoding="utf-8")
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        page.call("Page.navigate", url="about:blank")
        page.complaints.clear()
        page.open(path.as_uri())
        assert page.wait("!!window.viewer")
        page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return page

    yield opened
    page.call("Emulation.clearDeviceMetricsOverride")


def test_a_robot_at_a_pose_is_within_its_frame(opened):
    """Its shapes, not only its joints, stand above the control."""
    page = opened(tw.payload("ur5", {"shoulder_lift_joint": -0.6}))
    seen = page.run(SEEN)
    assert sorted(seen) == ["#one", "header"]
    places = page.run("viewer.reach.map((p) => viewer.stage.project(p))")
    assert len(places) > 8  # the box around the shapes among them
    assert all(0 <= x <= 960 and 0 <= y <= seen["#one"][3] for x, y in places)
    assert page.complaints == []


def test_a_simulation_has_no_second_verdict_inside_its_page(opened):
    """A fall passes speeds that a planned motion must keep: DONE outside, and no word inside."""
    robot = tw.robots.ur5()
    fall = robot.simulate(robot.neutral, [0.0] * 6, duration=0.3)
    assert fall.verdict.word == "DONE"
    page = opened(fall)
    assert sorted(page.run(SEEN)) == ["#player", "header"]
    assert page.run("viewer.motion.time.length") > 100
    assert page.complaints == []


def test_a_simulation_under_a_wrench_is_shown_without_its_motion(folder):
    """Torques of the states alone would be those of other forces."""
    robot = tw.robots.pendulum()
    for wrench, is_shown in ((None, True), ({robot.tip: [0.0, 0.0, 0.0, 5.0, 0.0, 0.0]}, False)):
        fall = robot.simulate([0.3], [0.0], wrench_on_robot=wrench, duration=0.05)
        path = folder / "wrench.html"
        path.write_text(fall.viewer().page, encoding="utf-8")
        assert (read_page(path)[0]["motion"] is not None) == is_shown
