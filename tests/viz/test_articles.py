"""Articles on sections: every number of a picture is the library's, mistakes are named, and the page is small and keeps to itself."""

from __future__ import annotations

import re

import numpy as np
import pytest
from article_under_node import pictures_under_node
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.viz.article import ARTICLES, article_of, article_text
from twistwrench.viz.colours import QUANTITIES

pytest_plugins = ("page_fixtures",)
CARTON = tw.RigidBody(tw.SpatialInertia.from_com(1.0, [0, 0, 0], np.diag([0.02, 0.06, 0.07])))
THROW = [1.6, 0.35, 2.6, 0, 0, 0]


def shifted(p):
    T = np.eye(4)
    T[:3, 3] = p
    return T


def matrix(state):
    return np.reshape(state["R"], (3, 3))


# ── 8.2: the momentum of a body


def test_the_throw_is_the_library_s_flight(tmp_path):
    """State after 2.8 s and 8 s: pose, twist, momentum on the body and in the room, and ad(V)' P."""
    work = (
        "({ throw: p }) => { p.reset(); p.advance(2.8); const a = p.state(); p.advance(5.2); return [a, p.state()]; }"
    )
    for state in pictures_under_node("8.2", work, tmp_path):
        flight = CARTON.fly(np.eye(4), THROW, state["t"], 1e-3, order=6)
        V, P = np.array(state["twist_body"]), np.array(state["momentum_body"])
        # Runge-Kutta of order 4 in steps of 1 ms at 3 rad/s: 8 s * (3e-3)^4 / 120 per second, below 1e-11
        np.testing.assert_allclose(matrix(state), flight.poses[-1, :3, :3], atol=1e-9)
        np.testing.assert_allclose(V, flight.twists[-1], atol=1e-9)
        np.testing.assert_allclose(P, CARTON.momentum(V), rtol=1e-14)
        np.testing.assert_allclose(state["adT_momentum"], tw.ad(V).T @ P, atol=1e-15)
        np.testing.assert_allclose(state["momentum_room"][:3], [0.032, 0.021, 0.182], rtol=1e-9)
        if state["t"] == 2.8:
            np.testing.assert_allclose(P[:3], [-0.0126, -0.1159, 0.1449], atol=5e-5)


RANDOM = """(_, throws) => throws.map(({ moments, V, F }) => {
    const body = new RigidBody(moments, 1), flight = new Flight(body, { R: UPRIGHT, V }, F), P = (t) => body.momentum(flight.at(t).V);
    const room = (t) => inRoom(flight.at(t).R, P(t)), times_ = [0.5, 3.1, 7.7], half = 1e-4;
    const drift = Math.max(...times_.concat(10).map((t) => Math.hypot(...add(room(t), times(-1, room(0)))) / Math.hypot(...room(0))));
    const seen = times_.map((t) => times(0.5 / half, add(P(t + half), times(-1, P(t - half)))));
    return { drift, seen, states: times_.map((t) => ({ V: flight.at(t).V, P: P(t), change: changeByTurning(flight.at(t).V, P(t)) })) }; })"""


def throws(count):
    rng = np.random.default_rng(4)
    for _ in range(count):
        a, b, c = rng.uniform(0.1, 1.0, 3)  # sides of a box
        moments = np.array([b * b + c * c, c * c + a * a, a * a + b * b]) / 12
        yield {"moments": moments.tolist(), "V": [*rng.normal(0, 2, 3), *rng.normal(0, 1, 3)], "F": [0.0] * 6}


@pytest.mark.parametrize("count", [5, pytest.param(50, marks=pytest.mark.slow)])
def test_the_momentum_stands_still_in_the_room_and_its_turning_on_the_body_is_ad(tmp_path, count):
    for flight in pictures_under_node("8.2", RANDOM, tmp_path, list(throws(count))):
        assert flight["drift"] < 1e-6  # in 10 s
        for seen, state in zip(flight["seen"], flight["states"], strict=True):
            np.testing.assert_allclose(state["change"], tw.ad(state["V"]).T @ state["P"], rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(seen, state["change"], atol=1e-6 * np.linalg.norm(state["change"]))


def test_the_glimpsed_velocity_is_the_grey_arrow_to_four_digits(tmp_path):
    work = "({ tangent: p }) => [0, 0.7, 2.8, 8].map((t) => { p.set('time', t); return p.numbers().map(([, text]) => text); })"
    for seen, change in pictures_under_node("8.2", work, tmp_path):
        assert seen == change


def test_a_push_moves_the_head_along_itself(tmp_path):
    """In the room the rate of the momentum is the wrench, by central differences of 1e-4 s: error h^2/6 |P'''| < 1e-9."""
    work = """({ push: p }) => [0.5, 1.9].map((t) => { const at = (s) => { p.rewind(); p.advance(s); return p.state(); };
        return [at(t - 1e-4).momentum_room, at(t).wrench_room, at(t + 1e-4).momentum_room]; })"""
    for before, wrench, after in pictures_under_node("8.2", work, tmp_path):
        np.testing.assert_allclose((np.array(after) - before) / 2e-4, wrench, atol=1e-8)


def test_the_tilted_rotor_needs_the_library_s_wrench(tmp_path):
    work = """({ rotor: p }) => [0, 2, 5, 10, 37, 90].map((tilt) => { p.reset(); p.set("tilt", tilt); p.advance(0.013); return { tilt, ...p.state() }; })"""
    rotor = tw.RigidBody(tw.SpatialInertia.from_com(1.0, [0, 0, 0], np.diag([0.01, 0.01, 0.02])))
    sizes = {}
    for state in pictures_under_node("8.2", work, tmp_path):
        F, R = np.array(state["wrench_body"]), matrix(state)
        np.testing.assert_allclose(F, rotor.wrench(state["twist_body"], np.zeros(6)), atol=1e-13)
        np.testing.assert_allclose(state["wrench_room"], [*(R @ F[:3]), *(R @ F[3:])], atol=1e-13)
        np.testing.assert_allclose(
            R @ state["twist_body"][:3], [0, 0, 50], atol=1e-12
        )  # the shaft is along z of the room
        sizes[state["tilt"]] = np.linalg.norm(F[:3])
    np.testing.assert_allclose([sizes[b] for b in (0, 2, 5, 10, 90)], [0, 0.872, 2.171, 4.275, 0], atol=5e-4)


def test_a_moved_frame_changes_numbers_and_not_the_motion(tmp_path):
    work = "({ frame: p }) => [0, 0.1, 0.3].map((x) => { p.set('offset', x); return p.state(); })"
    box = tw.RigidBody(tw.SpatialInertia.from_com(2.0, [0, 0, 0], np.diag([0.01, 0.01, 0.01])))
    moments = []
    for state in pictures_under_node("8.2", work, tmp_path):
        seen = np.eye(4)
        seen[1, 3] = -state["offset"]  # the mass centre's frame in the moved one
        moved, V = box.in_frame(seen), np.array(state["twist_body"])
        np.testing.assert_allclose(V, tw.Ad(seen) @ [0, 0, 0, 0.2, 0, 0], atol=1e-15)
        np.testing.assert_allclose(state["momentum_body"], moved.momentum(V), atol=1e-15)
        np.testing.assert_allclose(state["adT_momentum"], np.zeros(6), atol=1e-15)
        assert state["energy"] == pytest.approx(0.04, rel=1e-12)
        moments.append(state["momentum_body"][2])
    np.testing.assert_allclose(moments, [0, 0.04, 0.12], atol=1e-12)


def test_beside_the_mass_centre_v_cross_f_is_the_moment_of_the_string(tmp_path):
    work = "({ centre: p }) => [0, 0.1, 0.25].map((x) => { p.set('offset', x); return p.state(); })"
    stone = tw.RigidBody(tw.SpatialInertia.from_com(2.0, [0, 0, 0], np.diag([0.008, 0.008, 0.008])))
    for state in pictures_under_node("8.2", work, tmp_path):
        seen = np.eye(4)
        seen[1, 3] = -state["offset"]
        there, V = stone.in_frame(seen), np.array(state["twist_body"])
        np.testing.assert_allclose(state["momentum_body"], there.momentum(V), atol=1e-14)
        np.testing.assert_allclose(state["wrench_body"], there.wrench(V, np.zeros(6)), atol=1e-14)
        np.testing.assert_allclose(state["wrench_body"], [0, 0, -4 * state["offset"], -4, 0, 0], atol=1e-14)


def test_the_gap_of_four_motions_is_the_bracket_to_third_order(tmp_path):
    work = "({ bracket: p }) => [0.4, 0.2, 0.1].map((h) => { p.set('h', h); return p.state(); })"
    turn, drive, rests = np.array([0, 0, 1.0, 0, 0, 0]), np.array([0, 0, 0, 1.0, 0, 0]), []
    for state in pictures_under_node("8.2", work, tmp_path):
        h = state["h"]
        T = np.linalg.multi_dot([tw.se3.exp(h * V) for V in (turn, drive, -turn, -drive)])
        np.testing.assert_allclose(state["gap"], tw.se3.log(T), atol=1e-14)
        np.testing.assert_allclose(state["bracket"], h * h * (tw.ad(turn) @ drive), atol=1e-15)
        rests.append(np.linalg.norm(np.subtract(state["gap"], state["bracket"])))
    assert np.log2(rests[0] / rests[1]) == pytest.approx(3, abs=0.05)
    assert np.log2(rests[1] / rests[2]) == pytest.approx(3, abs=0.05)


# ── 5.2: torques of a force at the tip

ARM = tw.robots.planar_2r()


def plane_jacobian(angles):
    """Linear rows of the tip's Jacobian in the plane of the arm."""
    return ARM.jacobian(angles, kind="world_aligned")[[3, 5]]


TORQUES = """(pictures) => { const out = []; for (const [name, key, values] of [["push", "shoulder", [-30, 30, 71]], ["along", "load", [0, 10, 20]],
        ["turned", "angle", [0, 45, 180, 300]], ["work", "turn", [0.01, 0.3]], ["straight", "bend", [0, 20, 60]], ["ellipse", "angle", [0, 30, 200]]])
    for (const value of values) { pictures[name].set(key, value); out.push({ name, value, ...pictures[name].state() }); } return out; }"""


def test_torques_of_all_pictures_are_those_of_the_library(tmp_path):
    seen = {}
    for state in pictures_under_node("5.2", TORQUES, tmp_path):
        angles, f = state.get("angles", np.radians([30, 60])), np.array(state["force"])
        J = plane_jacobian(angles)
        np.testing.assert_allclose(state["J"], J, atol=1e-15)
        np.testing.assert_allclose(state["tau"], J.T @ f, atol=1e-13)
        seen[state["name"], state["value"]] = state
    np.testing.assert_allclose(seen["push", 30]["tau"], [15, 10], atol=1e-9)
    np.testing.assert_allclose(seen["along", 10]["tau"], [-8.660254, 0], atol=1e-6)
    np.testing.assert_allclose(seen["straight", 0]["tau"], [0, 0], atol=1e-13)
    for turn in (0.01, 0.3):
        assert seen["work", turn]["work_force"] == pytest.approx(seen["work", turn]["work_torque"], rel=1e-14)
    for angle in (0, 30, 200):
        assert np.linalg.norm(seen["ellipse", angle]["tau"]) == pytest.approx(10, rel=1e-12)
    for bend in (20, 60):  # joint speeds that pull the tip towards the shoulder at 0.1 m/s
        state = seen["straight", bend]
        rates = np.linalg.solve(plane_jacobian(state["angles"]), 0.1 * np.array(state["force"]) / 10)
        assert abs(rates[1]) == pytest.approx(state["elbow_rate"], rel=1e-12)
    assert seen["straight", 0]["elbow_rate"] is None


def test_the_way_of_the_tip_is_its_arm_turned_by_a_right_angle(tmp_path):
    """A small turn d of the shoulder takes a tip at (x, y) by (-y, x) d."""
    work = "({ work }) => [-0.2, 0.05].map((turn) => { work.set('turn', turn); return work.state(); })"
    for state in pictures_under_node("5.2", work, tmp_path):
        x, y, _ = state["tip"]
        assert x > 0.5 and y > 0.5
        np.testing.assert_allclose(state["way"], np.array([-y, x]) * state["turn"], atol=1e-15)


def test_mistakes_with_the_torque_of_the_first_joint_are_named(tmp_path):
    """Minus, f in the axes of the tip, J f, degrees as radians, the other joint: from the library's Jacobian."""
    J, f = plane_jacobian(np.radians([20, 30])), np.array([-25.0, 0.0])
    right, other = J.T @ f
    turned = np.radians(50)  # of the second link
    in_tip = (J.T @ [np.cos(turned) * f[0], np.sin(turned) * f[0]])[0]
    degrees = 25 * (np.sin(20) + np.sin(50))
    values = [right, -right, 2 * right, right / 2, in_tip, (J @ f)[1], degrees, other]
    found = pictures_under_node(
        "5.2", "({ push }, typed) => typed.map((text) => push.check(text))", tmp_path, list(map(str, values))
    )
    assert [each["near"] for each in found] == [None, "sign", "double", "half", "frame", "frame", "degrees", None]
    assert found[0]["right"]
    assert found[-1]["words"].startswith("That is joint 2's torque")


def test_numbers_in_the_text_of_5_2_are_those_of_the_library():
    """Longest forces of the ellipse, the tangent's distance from the arc, and the elbow's speed in a nearly straight arm."""
    texts = {picture["name"]: " ".join(picture["after"].split()) for picture in article_of("5.2")["picture"]}
    longest = [
        10 / np.linalg.svd(plane_jacobian([0.3, np.radians(bend)]), compute_uv=False)[1] for bend in (60, 30, 10)
    ]
    assert (
        "longest force is {:.0f} N with the elbow at 60°, {:.0f} N at 30° and {:.0f} N at 10°".format(*longest)
        in texts["ellipse"]
    )
    minus_y, x = plane_jacobian(np.radians([30, 60]))[:, 0]
    tip = np.array([x, -minus_y])
    beside = []
    for d in (0.1, 0.3):
        c, s = np.cos(d), np.sin(d)
        beside.append(1000 * np.linalg.norm(np.array([[c, -s], [s, c]]) @ tip - tip - d * np.array([-tip[1], tip[0]])))
    assert "at 0.1 rad its head is {:.0f} mm beside the tip, at 0.3 rad {:.0f} mm".format(*beside) in texts["work"]
    angles = np.radians([60 - 2.5, 5])
    rates = np.linalg.solve(plane_jacobian(angles), -0.1 * np.array([np.cos(np.pi / 3), np.sin(np.pi / 3)]))
    assert f"{abs(rates[1]):.1f} rad/s at 5°" in texts["straight"]


# ── Exercises

NEAR = """({ rotor, frame, bracket }, typed) => { rotor.advance(0.01);
    return [typed.map((text) => rotor.check(text)),
        ...[frame, bracket].map((p) => { const { answer } = p.question(); return [answer, -answer, 2 * answer, answer / 2].map((a) => p.check(String(a))); })]; }"""


def test_mistakes_are_named(tmp_path):
    """Right answers are the library's: 8 degrees at 60 rad/s; 3 kg at 0.5 m/s, 0.2 m beside; a turn of 0.3 rad and a drive of 0.5 m."""
    body = tw.RigidBody(tw.SpatialInertia.from_com(1.0, [0, 0, 0], np.diag([0.01, 0.01, 0.02])))

    def moment(angle):
        return np.linalg.norm(body.wrench([60 * np.sin(angle), 0, 60 * np.cos(angle), 0, 0, 0], np.zeros(6))[:3])

    m, wrong = moment(np.radians(8)), moment(8)
    # 10 ms at 60 rad/s have turned the moment, which is along -y of the rotor, by 0.6 rad
    values = [
        f"{m:.3f}",
        f"{m:.3f} N m".replace(".", ","),
        f"−{m:.3f}",
        2 * m,
        m / 2,
        m * np.sin(0.6),
        wrong,
        3,
        "heavy",
    ]
    rotor, *others = pictures_under_node("8.2", NEAR, tmp_path, list(map(str, values)))
    named = [(found["right"], found["near"]) for found in rotor]
    wrong = [(False, near) for near in ("sign", "double", "half", "frame", "degrees", None, None)]
    assert named == [(True, None), (True, None), *wrong]
    assert [found["words"] for found in rotor[-2:]] == ["Not yet.", "Type a number."]
    for found in others:
        assert [each["near"] for each in found] == [None, "sign", "double", "half"]
    sled = tw.RigidBody(tw.SpatialInertia.from_com(3.0, [0, 0, 0], np.eye(3))).in_frame(shifted([0, -0.2, 0]))
    legs = [[0, 0, 0.3, 0, 0, 0], [0, 0, 0, 0.5, 0, 0], [0, 0, -0.3, 0, 0, 0], [0, 0, 0, -0.5, 0, 0]]
    gap = np.linalg.norm(np.linalg.multi_dot([tw.se3.exp(leg) for leg in legs])[:3, 3])
    work = "({ frame, bracket }) => [frame, bracket].map((p) => p.question().answer)"
    answers = pictures_under_node("8.2", work, tmp_path)
    np.testing.assert_allclose(answers, [sled.momentum([0, 0, 0, 0.5, 0, 0])[2], gap], rtol=1e-9)


def test_right_wins_over_near_and_near_misses_are_named_in_their_order(tmp_path):
    work = """() => [judged("0", 0), judged("1.005", 1, { frame: [1.004] }), judged("2", 1, { frame: [2], degrees: [2] }), judged("3", 1, { frame: [3], degrees: [3] }),
        judged("-1", 1, {}, ["double"])].map(({ right, near }) => [right, near])"""
    found = pictures_under_node("8.2", work, tmp_path)
    assert found == [[True, None], [True, None], [False, "double"], [False, "frame"], [False, None]]


# ── The page


def plain(html):
    return re.sub(r"<[^>]+>", "", html)


@pytest.mark.parametrize("section", ARTICLES)
def test_an_article_is_short_and_has_one_idea_a_picture(section):
    text, article = article_text(section), article_of(section)
    body = text.partition("<main")[2].partition("</main>")[0]
    assert len(text.encode()) <= 220_000
    assert len(text.partition("<script>")[2].encode()) <= 60_000
    assert len(plain(body).split()) <= 2500
    assert all(len(plain(p).split()) <= 90 for p in re.findall(r"<p>(.*?)</p>", body, re.DOTALL))
    assert all(len(picture["sliders"]) == 1 for picture in article["picture"])
    assert len(article["question_at_end"]) == 3
    assert "http" not in re.sub(r"<meta http-equiv[^>]*>", "", text)


def test_a_picture_has_at_most_six_numbers(tmp_path):
    work = "(pictures) => Object.values(pictures).map((p) => p.numbers().map(([, text]) => text).join(' '))"
    for section in ARTICLES:
        for shown in pictures_under_node(section, work, tmp_path):
            assert 1 <= len(re.findall(r"\d+(?:\.\d+)?", shown)) <= 6


def luminance(colour):
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


def test_coloured_words_can_be_read_on_light_and_on_dark_paper():
    for both in QUANTITIES.values():
        for colour, papers in zip(both, (("#ffffff", "#f5f7fa"), ("#171d24", "#1f2730")), strict=True):
            for paper in papers:
                high, low = sorted((luminance(colour), luminance(paper)), reverse=True)
                assert (high + 0.05) / (low + 0.05) >= 4.5


@pytest.fixture(scope="module")
def article(page, folder):
    """Opens an article anew, at a size of the screen."""

    def article(section="8.2", width=1280, height=900, mobile=False):
        path = tw.viz.write_article(section, folder / f"{section}.html")
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)
        page.call("Page.navigate", url="about:blank")
        page.complaints.clear()
        page.requests.clear()
        page.open(path.as_uri())
        page.wait("!!window.viewer")
        frames(page)
        assert page.requests == [path.as_uri()]
        return page

    yield article
    page.call("Emulation.clearDeviceMetricsOverride")


def frames(page):
    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def head(page, picture):
    """Place of the momentum's head on the screen."""
    return page.run(
        f"""(() => {{ const canvas = document.querySelector('figure[data-picture={picture}] canvas'); canvas.scrollIntoView({{ block: "center" }});
        const box = canvas.getBoundingClientRect(); return [box.x, box.y, box.width, box.height]; }})()"""
    )


def test_a_guess_comes_before_the_play(article):
    """Play is off until the arrow is taken hold of; then the picture runs to the asked second, and the difference is told.

    A slider that is moved afterwards does not change what was said of the guess.
    """
    page = article()
    assert page.run("viewer.article") == "8.2"
    state = "[document.querySelector('#throw .play').disabled, getComputedStyle(document.querySelector('#throw .after')).visibility === 'hidden']"
    assert page.run(state) == [True, True]
    x, y, width, height = head(page, "throw")
    frames(page)
    page.run(
        """(() => { const p = viewer.pictures.throw; window.place = null;
        const draw = View.prototype.draw; View.prototype.draw = function (...a) { draw.apply(this, a); if (this.canvas.closest('#throw')) window.place = this.heads.find((h) => h.name === 'momentum').to; };
        p.changed(); })()"""
    )
    u, v = page.wait("window.place")
    assert 0 < u < width and 0 < v < height
    page.drag((x + u, y + v), (x + u + 90, y + v + 40))
    assert page.run(state) == [False, True]
    page.click("#throw .play")
    page.wait("!document.querySelector('#throw .after').classList.contains('later')")
    told = page.run("document.querySelector('#throw .prompt').textContent")
    assert re.match(r"You are \d+° off\. The arrow has not moved", told)
    page.run("viewer.pictures.throw.set('spin', -2)")
    assert page.run("document.querySelector('#throw .prompt').textContent") == f"Before you moved the slider: {told}"
    assert page.run("viewer.pictures.throw.t") == pytest.approx(1, abs=1e-9)
    assert page.complaints == []


@pytest.mark.parametrize(("section", "width"), [("8.2", 1280), ("8.2", 390), ("5.2", 390)])
def test_what_is_told_after_a_guess_has_its_place_before(article, section, width):
    """Headings stay where they are when every picture with a guess is played."""
    page = article(section, width=width)
    heads = "[...document.querySelectorAll('h2')].map((head) => head.getBoundingClientRect().y + scrollY)"
    before = page.run(heads)
    assert page.run("document.querySelectorAll('.later').length") > 0
    for name in page.run("Object.keys(viewer.pictures).filter((name) => viewer.pictures[name].entry.predict)"):
        page.run(f"document.querySelector('#{name} figure').scrollIntoView()")
        page.click(f"#{name} .skip")
        page.wait(f"!document.querySelector('#{name} .later')")
        frames(page)
    np.testing.assert_allclose(page.run(heads), before, atol=1)
    assert page.complaints == []


def test_a_choice_is_a_guess(article):
    """Which of two joints: the one that is chosen is told, with the right one."""
    page = article("5.2")
    play = "document.querySelector('#along .play').disabled"
    assert page.run(play)
    page.run("document.querySelector('#along figure').scrollIntoView()")
    page.click("#along .choice label:nth-child(1) input")
    assert not page.run(play)
    page.click("#along .play")
    told = page.wait("document.querySelector('#along .prompt.told')?.textContent")
    assert told.startswith("You chose joint 1, the shoulder. It is joint 2, the elbow. ")
    page.click("#along .again")
    page.click("#along .choice label:nth-child(2) input")
    page.click("#along .play")
    assert page.wait("document.querySelector('#along .prompt.told')?.textContent").startswith("Right. It is joint 2")
    assert page.complaints == []


def kept_views(page):
    """Views of pictures in ``window.views`` by name once they are drawn."""
    page.run(
        """(() => { window.views = {}; const draw = View.prototype.draw;
        View.prototype.draw = function (...a) { draw.apply(this, a); const { picture } = this.canvas.closest('figure').dataset; window.views[picture] ??= this; }; })()"""
    )


def test_a_ring_is_dragged_along_the_way_of_the_slider(article):
    """The head of the push goes to where it is dragged: up, then to the lower left; keys move it by steps, and the page stays still."""
    page = article("5.2")
    kept_views(page)
    x, y, *_ = head(page, "turned")
    page.run("viewer.pictures.turned.changed()")
    page.wait("!!window.views.turned")
    ring = "views.turned.onScreen(viewer.pictures.turned.handle(viewer.pictures.turned.value('angle')))"
    for angle in (90, 225):
        u, v = page.run(ring)
        to = page.run(f"views.turned.onScreen(viewer.pictures.turned.handle({angle}))")
        page.drag((x + u + 3, y + v), (x + u + 8, y + v + 5), (x + to[0] + 3, y + to[1]))
        assert page.run("viewer.pictures.turned.value('angle')") == angle
        np.testing.assert_allclose(page.run(ring), to, atol=1e-9)
    tau = page.run("viewer.pictures.turned.state().tau")
    push = 10 * np.array([np.cos(np.radians(225)), np.sin(np.radians(225))])
    np.testing.assert_allclose(tau, plane_jacobian(np.radians([30, 60])).T @ push, atol=1e-12)
    press = "(key) => document.querySelector('#turned canvas').dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }))"
    page.run(f"({press})('ArrowRight')")
    assert page.run("document.querySelector('#turned .slider').textContent") == "230°"
    assert "arrow keys, for the direction of the push" in page.run(
        "document.querySelector('#turned canvas').getAttribute('aria-label')"
    )
    page.drag((x + 5, y + 5), (x + 60, y + 60))  # beside the ring
    assert page.run("viewer.pictures.turned.value('angle')") == 230
    assert page.complaints == []


def test_every_ring_follows_its_slider(article):
    """In all articles a ring is where its slider says, and leads back to the value it came from."""
    rings = 0
    for section in ARTICLES:
        page = article(section)
        kept_views(page)
        for name in page.run("Object.keys(viewer.pictures).filter((name) => viewer.pictures[name].handle)"):
            page.run(f"document.querySelector('#{name} figure').scrollIntoView(); viewer.pictures.{name}.changed()")
            page.wait(f"!!window.views.{name}")
            found = page.run(
                f"""(() => {{ const p = viewer.pictures.{name}, {{ handle }} = views.{name}, {{ name: slider, least, most, step }} = p.entry.sliders[0];
                const value = least + step * Math.round((0.3 * (most - least)) / step), place = views.{name}.onScreen(p.handle(value));
                p.set(slider, most); handle.follow(place); return [p.value(slider), value]; }})()"""
            )
            assert found[0] == pytest.approx(found[1], abs=1e-6), (section, name)
            rings += 1
        assert page.complaints == []
    assert rings >= 12


def test_a_guess_says_what_comes_next_and_readouts_wait_for_it(article):
    """After a guess the page says to press Play; the gap of the bracket is read only once the car has returned."""
    page = article()
    for name in ("rotor", "bracket"):
        assert page.run(f"document.querySelector('#{name} .numbers .wrench, #{name} .numbers .change')") is None
        assert page.run(f"document.querySelector('#{name} .guess output').textContent").startswith("? ")
        page.run(
            f"(() => {{ const f = document.querySelector('#{name} .guess input'); f.value = 2; f.dispatchEvent(new Event('input')); }})()"
        )
        assert page.run(f"document.querySelector('#{name} .prompt').textContent").endswith(" Now press Play.")
    page.run("document.querySelector('#bracket figure').scrollIntoView()")
    page.click("#bracket .play")
    page.wait("viewer.pictures.bracket.t > 0.5")
    assert page.run("document.querySelector('#bracket .numbers .change')") is None
    told = page.wait("document.querySelector('#bracket .prompt.told')?.textContent")
    assert told.startswith("You guessed 2.0. It is 3.980 times smaller.")
    assert page.run("document.querySelector('#bracket .numbers').textContent").startswith("gap 0.0399 m")
    assert page.complaints == []


def test_an_arrow_that_is_pressed_before_the_first_frame_is_held(article):
    page = article()
    kept_views(page)
    head(page, "push")
    page.run("viewer.pictures.push.changed()")
    page.wait("!!window.views.push")
    pressed = """(() => {
        const p = viewer.pictures.push, view = views.push, [x, y] = view.onScreen(times(p.perUnit, p.grasped));
        delete view.onScreen;
        return typeof view.grasp(x, y, 0);
    })()"""
    assert page.run(pressed) == "function"
    assert page.complaints == []


def test_a_guessed_arrow_may_become_longer_where_its_length_is_asked(article):
    """The guess ends at the pointer; a right direction with a wrong length is told as that."""
    page = article()
    kept_views(page)
    x, y, *_ = head(page, "push")
    page.run("viewer.pictures.push.changed()")
    page.wait("!!window.views.push")
    truth, start = page.run(
        """(() => { const p = viewer.pictures.push, on = (a) => views.push.onScreen(times(p.perUnit, a)); return [on(p.truth(1)), on(p.grasped)]; })()"""
    )
    page.drag((x + start[0], y + start[1]), (x + truth[0], y + truth[1]))
    guess = page.run("views.push.onScreen(times(viewer.pictures.push.perUnit, viewer.pictures.push.guess))")
    np.testing.assert_allclose(
        guess, truth, atol=1.5
    )  # pixels: the pixel's length is that at the arrow's head where the drag began
    page.click("#push .play")
    assert page.wait("document.querySelector('#push .prompt.told')?.textContent").startswith(
        "Right. The head has moved"
    )
    says = """[[3, 1.25], [30, 0.8], [30, 1], [3, 1.05]].map(([degrees, longer]) =>
        Prediction.prototype.told.call({ entry: viewer.pictures.push.entry.predict }, [0, 0, 1], [0, 0, 1], degrees, longer))"""
    first, second, third, fourth = page.run(says)
    assert first.startswith("The direction is right. Longer than you drew it: 1.25 times. ")
    assert second.startswith("You are 30° off. Shorter than you drew it: 0.80 times. ")
    assert third.startswith("You are 30° off. The head")
    assert fourth.startswith("Right. The head")
    assert page.complaints == []


def test_rows_of_the_transposed_jacobian_are_shown(tmp_path):
    """As the library's Jacobian has them, in the picture and in the text."""
    J = plane_jacobian(np.radians([30, 60]))
    work = "({ turned: p }) => p.numbers().map(([label, text]) => [label, text.replaceAll('−', '-')])"
    found = dict(pictures_under_node("5.2", work, tmp_path))
    for k in (0, 1):
        shown = [float(x) for x in found[f"row {k + 1} of Jᵀ"].strip("()").split(", ")]
        np.testing.assert_allclose(shown, J[:, k], atol=5e-4)
    assert "−1.5 · (−10) + 0.866 · 0 = 15 N m" in article_of("5.2")["picture"][2]["after"]
    np.testing.assert_allclose(J[:, 0], [-1.5, 0.866], atol=5e-4)


def test_a_number_in_the_sentence_is_moved_by_keys_and_typed(article):
    page = article()
    slide = """(key) => { const s = document.querySelector('#rotor .slider'); s.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true })); return s.textContent; }"""
    assert page.run(f"({slide})('ArrowRight')") == "21°"
    assert page.run(f"({slide})('End')") == "90°"
    typed = """(() => { const s = document.querySelector('#rotor .slider'); s.dispatchEvent(new KeyboardEvent('keydown', { key: 'Enter' }));
        const field = s.querySelector('input'); field.value = '10 deg'; field.dispatchEvent(new KeyboardEvent('keydown', { key: 'Enter' })); return s.textContent; })()"""
    assert page.run(typed) == "10°"
    assert page.run("viewer.pictures.rotor.value('tilt')") == 10
    assert page.run("document.querySelector('#rotor .slider').getAttribute('aria-valuenow')") == "10"
    assert page.complaints == []


def test_pointing_at_a_word_lights_its_arrow_and_the_reverse(article):
    page = article()
    lit = """(() => { const word = document.querySelector('#body .word.momentum'); word.dispatchEvent(new PointerEvent('pointerenter')); return 1; })()"""
    page.run(
        "window.lit = []; const draw = View.prototype.draw; View.prototype.draw = function (...a) { window.lit.push(a[3]); draw.apply(this, a); }; 0"
    )
    page.run("document.querySelector('#body').scrollIntoView()")
    frames(page)
    page.run(lit)
    frames(page)
    assert "momentum" in page.run("window.lit")


def test_a_word_stays_lit_after_a_tap_until_the_next_one(article):
    page = article()
    page.call("Emulation.setTouchEmulationEnabled", enabled=True)
    page.run(
        "window.lit = []; const draw = View.prototype.draw; View.prototype.draw = function (...a) { window.lit.push(a[3]); draw.apply(this, a); }; 0"
    )
    page.run("document.querySelector('#body').scrollIntoView()")

    def tap(element: str) -> None:
        box = page.run(
            f"(() => {{ const b = {element}.getBoundingClientRect(); return [b.x + 5, b.y + b.height / 2]; }})()"
        )
        page.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": box[0], "y": box[1]}])
        page.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        frames(page)

    tap("document.querySelector('#body .word.momentum')")
    assert page.run("window.lit.at(-1)") == "momentum"
    tap("document.querySelector('#body h2')")
    assert page.run("window.lit.at(-1)") is None


def test_nothing_runs_out_of_sight_or_at_rest(article):
    page = article()
    page.run(
        "window.drawn = 0; const draw = View.prototype.draw; View.prototype.draw = function (...a) { window.drawn++; draw.apply(this, a); }; 0"
    )
    page.run("document.querySelector('#body').scrollIntoView(); document.querySelector('#body .play').click()")
    page.wait("window.drawn > 2")
    page.run("scrollTo(0, 0)")
    page.run("new Promise((done) => setTimeout(done, 200))")
    page.run("window.drawn = 0")
    page.run("new Promise((done) => setTimeout(done, 300))")
    assert page.run("window.drawn") == 0


def test_the_wheel_over_a_picture_scrolls_the_page(article):
    page = article()
    x, y, width, height = head(page, "body")
    before = page.run("scrollY")
    page.call("Input.dispatchMouseEvent", type="mouseWheel", x=x + width / 2, y=y + height / 2, deltaX=0, deltaY=120)
    page.wait(f"scrollY === {before} + 120")


@pytest.mark.parametrize("section", [ARTICLES[-1], *(pytest.param(s, marks=pytest.mark.slow) for s in ARTICLES[:-1])])
def test_on_a_phone_nothing_scrolls_sideways_and_targets_are_large(article, section):
    page = article(section, width=390, height=844, mobile=True)
    assert page.run("document.documentElement.scrollWidth") == 390
    small = """[...document.querySelectorAll('button, form input, .guess input, nav a, summary, .slider')].filter((e) => !e.closest('[hidden]') && !e.hidden)
        .map((e) => [e.className, e.getBoundingClientRect().height]).filter(([, height]) => height < 39.5)"""
    assert page.run(small) == []
    assert page.complaints == []


# ── The command


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--section", "5.4"], "section 5.4 has no article, only a page with a robot"),
        (["--section", "5.44"], "Choose one of: 3.4"),
        (["--section", "8.2", "--payload", "3"], "Leave --payload out, or name ROBOT first."),
        ([], "Missing ROBOT"),
        (["planar_2r", "--section", "8.1"], "no page with a robot: twistwrench view --section 8.1 --html page.html"),
    ],
)
def test_the_command_says_why_it_writes_no_article(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(main, ["view", *arguments, "--html", "x.html"])
    assert found.exit_code == 2
    assert message in " ".join(found.output.split())
    assert not any(tmp_path.iterdir())


def test_without_a_robot_the_command_writes_an_article(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.html").write_text("of before")
    done = CliRunner().invoke(main, ["view", "--section", "8.2", "--html", "x.html", "--overwrite"])
    assert (done.exit_code, done.output) == (0, "wrote x.html\n")
    assert (tmp_path / "x.html").read_text("utf-8") == article_text("8.2")
