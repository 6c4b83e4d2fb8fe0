"""Loops in the page: feet on the floor and closed robots, whose sliders keep them closed; torques against the library."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from mechanisms import closed_platform, four_bar
from page_files import read_page
from page_under_node import under_node

import twistwrench as tw
from twistwrench import statics
from twistwrench.cli.main import main
from twistwrench.viz import write_page
from twistwrench.viz.page_loops import closed_by_file, contacts_of

pytest_plugins = ("page_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")

LEG = (  # joint, axis, where it is on the link before, limits, mass and length of its link
    ("yaw", "0 0 1", "0 {y} -0.1", (-0.6, 0.6), 1.0, 0.0),
    ("roll", "1 0 0", "0 0 0", (-0.5, 0.5), 1.0, 0.0),
    ("pitch", "0 1 0", "0 0 0", (-2.0, 1.0), 3.0, 0.4),
    ("knee", "0 1 0", "0 0 -0.4", (0.0, 2.5), 2.0, 0.4),
    ("ankle", "0 1 0", "0 0 -0.4", (-1.2, 0.9), 0.5, 0.0),
    ("foot", "1 0 0", "0 0 0", (-0.5, 0.5), 1.0, 0.0),
)


def biped():
    """A torso on two legs of six joints with box feet, and two arms of two joints, as a robot file."""
    links, joints = [], []

    def link(name, mass, length, more=""):
        i = mass * max(length, 0.15) ** 2 / 6
        links.append(
            f'<link name="{name}"><inertial><origin xyz="0 0 {-length / 2}"/><mass value="{mass}"/>'
            f'<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>{more}</link>'
        )

    def joint(name, parent, child, axis, at, ends, effort=150):
        joints.append(
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
            f'<axis xyz="{axis}"/><limit lower="{ends[0]}" upper="{ends[1]}" effort="{effort}" velocity="9"/></joint>'
        )

    link("torso", 20.0, -0.4)
    sole = '<collision><origin xyz="0.03 0 -0.06"/><geometry><box size="0.22 0.1 0.04"/></geometry></collision>'
    for side, y in (("left", 0.1), ("right", -0.1)):
        last = "torso"
        for name, axis, at, ends, mass, length in LEG:
            link(f"{side}_{name}_link", mass, length, sole if name == "foot" else "")
            joint(f"{side}_{name}", last, f"{side}_{name}_link", axis, at.format(y=y), ends)
            last = f"{side}_{name}_link"
        link(f"{side}_upper_arm", 1.5, 0.3)
        link(f"{side}_hand", 1.0, 0.25)
        joint(f"{side}_shoulder", "torso", f"{side}_upper_arm", "0 1 0", f"0 {2.5 * y} 0.35", (-2.5, 2.5), 40)
        joint(f"{side}_elbow", f"{side}_upper_arm", f"{side}_hand", "0 1 0", "0 0 -0.3", (-2.2, 0.0), 30)
    return f'<robot name="biped">{"".join(links)}{"".join(joints)}</robot>'


SLIDE = """(m, given) => { const loops = new Loops(m), stand = m.robot.standing && new Standing(m);
    m.mass = given.mass ?? 0; m.push = given.push ?? [0, 0, 0];
    return given.moves.map(([q0, hand, value]) => {
      const { q: at, v } = m.robot.hands[hand], from = q0[at];
      const { q, stopped } = loops.led(q0, (q, share) => { const z = q.slice(); z[at] = from + share * (value - from); return z; }, v);
      const holding = Array.from(m.holding(q));
      return { q, stopped, held: stand ? stand.held(q) : loops.torques(q, holding), gap: Math.max(...loops.gaps(q).map(Math.abs)) };
    }); }"""


def moved(page, moves, **given):
    return under_node(page, SLIDE, {"moves": [[np.asarray(q).tolist(), k, value] for q, k, value in moves], **given})


@pytest.fixture(scope="module", params=["quadruped", "biped"])
def standing(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("standing")
    (folder / "biped.urdf").write_text(biped())
    robot = (
        tw.robots.quadruped() if request.param == "quadruped" else tw.load(folder / "biped.urdf", floating_base=True)
    )
    page = write_page(robot, folder / "page.html")
    return robot, page, read_page(page)[0]


def check_standing(robot, header, found, **on):
    """Held as the library says, or where it says that limits, or no forces at all, allow it."""
    q, contacts = np.array(found["q"]), contacts_of(robot, header["standing"])
    full = np.array([np.inf if x is None else x for x in header["standing"]["limits"]])
    answer = statics.least_norm_contact_forces(robot, q, contacts, limits=full, **on)
    assert answer.holds == statics.robot_equilibrium(robot, q, contacts, limits=full, **on).holds
    assert bool(answer.holds) == (found["held"] is not None and not found["held"]["over"])
    if answer.holds is False:
        free = np.where(full == 0, 0.0, np.inf)
        answer = statics.least_norm_contact_forces(robot, q, contacts, limits=free, **on)
        assert bool(answer.holds) == (found["held"] is not None)
    if answer.holds:
        scale = np.abs(answer.forces).max()
        np.testing.assert_allclose(found["held"]["forces"], answer.forces, atol=1e-8 * scale)
        np.testing.assert_allclose(found["held"]["tau"], answer.torques, atol=1e-8 * scale)
    return answer.holds


def test_a_robot_stands_on_its_feet_at_first(standing):
    robot, page, header = standing
    q = np.array(header["start"])
    contacts = contacts_of(robot, header["standing"])
    places = [(robot.forward_kinematics(q, c.frame) @ [*c.point, 1.0])[:3] for c in contacts]
    np.testing.assert_allclose(np.array(places)[:, 2], header["floor"], atol=1e-5 * header["size"])
    joints = [b for b in robot.model.leaders if b.joint.nv == 1]
    low, high = robot.limits.lower, robot.limits.upper
    for b in joints:
        room = 0.099 * (high[b.v_index] - low[b.v_index])
        assert low[b.v_index] + room <= q[b.q_index] <= high[b.v_index] - room
    (found,) = moved(page, [(q, 0, q[header["hands"][0]["q"]])])
    assert check_standing(robot, header, found)


def test_feet_stay_where_they_are_and_share_the_weight_wherever_sliders_go(standing):
    robot, page, header = standing
    start, rng = np.array(header["start"]), np.random.default_rng(0)
    hands = [k for k, hand in enumerate(header["hands"]) if "turn" not in hand]
    moves = []
    for k in rng.choice(hands, 6):
        hand = header["hands"][k]
        wide = 0.15 if hand["unit"] == "m" else 0.4
        moves.append(
            (start, int(k), float(np.clip(start[hand["q"]] + wide * rng.uniform(-1, 1), hand["lower"], hand["upper"])))
        )
    tip = header["frames"][header["tip"]]["name"]
    holds = []
    for given in ({}, {"mass": 1.0, "push": [20.0, 5.0, -10.0]}, {"mass": 0.1, "push": [0.0, 0.0, 900.0]}):
        heavy = robot.with_payload(tw.SpatialInertia.from_com(given["mass"]), frame=tip) if given else robot
        for found in moved(page, moves, **given):
            q = np.array(found["q"])
            on = {}
            if given:
                R = robot.forward_kinematics(q, tip)[:3, :3]
                on = {"wrench_on_robot": {tip: np.concatenate([np.zeros(3), R.T @ given["push"]])}}
            holds.append(check_standing(heavy, header, found, **on))
            assert found["gap"] < 1e-10
            for c in contacts_of(robot, header["standing"]):
                p, p0 = ((robot.forward_kinematics(x, c.frame) @ [*c.point, 1.0])[:3] for x in (q, start))
                np.testing.assert_allclose(p, p0, atol=1e-9)
    assert True in holds
    assert False in holds  # lifted off the floor


def test_a_robot_that_leans_too_far_falls(standing):
    robot, page, header = standing
    along = next(k for k, hand in enumerate(header["hands"]) if hand["name"].endswith(" x"))
    q = np.array(header["start"])
    (found,) = moved(page, [(q, along, q[header["hands"][along]["q"]] + 0.5 * header["size"])])
    check_standing(robot, header, found)


def closed_robots():
    yield "four-bar", four_bar().close("rocker_pin", "coupler_pin", "vx vz"), None
    yield "platform", closed_platform()[0], None
    yield "four-bar with two motors", four_bar().close("rocker_pin", "coupler_pin", "vx vz"), ["a", "d"]


CLOSED = {name: (closed, motors) for name, closed, motors in closed_robots()}


@pytest.fixture(scope="module", params=CLOSED)
def closed(request, tmp_path_factory):
    robot, motors = CLOSED[request.param]
    page = write_page(robot, tmp_path_factory.mktemp("closed") / "page.html", actuated=motors)
    return robot, page, read_page(page)[0]


def test_loops_stay_closed_and_torques_are_those_of_the_motors(closed):
    robot, page, header = closed
    loops, start, rng = header["loops"], np.array(header["start"]), np.random.default_rng(1)
    free = robot.nv - len(robot.independent)
    assert robot.nv - sum(loops["dependent"]) == free
    assert np.abs(robot.constraint_error(start)).max() < 1e-10
    names = [b.joint.name for b in robot.open().model.leaders for _ in range(b.joint.nv)]
    motors = list(dict.fromkeys(name for name, yes in zip(names, loops["actuated"], strict=True) if yes))
    hands = [
        k
        for k, hand in enumerate(header["hands"])
        if "turn" not in hand and not all(loops["dependent"][v] for v in hand["v"])
    ]
    assert hands
    moves = [
        (start, int(k), float(start[header["hands"][k]["q"]] + 0.3 * rng.uniform(-1, 1))) for k in rng.choice(hands, 8)
    ]
    for found in moved(page, moves):
        q = np.array(found["q"])
        assert np.abs(robot.constraint_error(q)).max() < 1e-10
        expected = robot.holding_torques(q, motors).tau
        np.testing.assert_allclose(found["held"]["tau"], expected, atol=1e-8 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("motor", range(3))
def test_the_joint_with_the_motor_leads_whichever_it_is(tmp_path, motor):
    """A four-bar has one degree of freedom: its motor's slider moves, and the other joints follow."""
    robot = four_bar().close("rocker_pin", "coupler_pin", "vx vz")
    name = robot.open().joint_names[motor]
    loops = read_page(write_page(robot, tmp_path / "page.html", actuated=[name]))[0]["loops"]
    assert [k for k in range(3) if loops["actuated"][k]] == [motor]
    assert [k for k in range(3) if not loops["dependent"][k]] == [motor]


def test_a_slider_stops_where_no_closed_pose_exists(tmp_path):
    """A rocker as the independent joint of a crank and rocker swings between two dead centres, known in closed form."""
    crank, coupler, rocker, ground = 0.3, 0.8, 0.6, 0.7
    robot = four_bar((crank, coupler, rocker, ground)).close("rocker_pin", "coupler_pin", "vx vz")
    page = write_page(robot, tmp_path / "page.html", actuated=["d"])
    header = read_page(page)[0]
    assert [bool(x) for x in header["loops"]["dependent"]] == [True, True, False]
    start = np.array(header["start"])
    hand = next(k for k, h in enumerate(header["hands"]) if h["name"] == "d")
    for way in (1, -1):
        (found,) = moved(page, [(start, hand, float(start[2] + 3.0 * way))])
        assert found["stopped"]
        B, C = np.array([0.0, 0.0]), np.array([ground + rocker * np.cos(found["q"][2]), rocker * np.sin(found["q"][2])])
        far = np.linalg.norm(C - B)  # at a dead centre crank and coupler lie in one line
        assert min(abs(far - (coupler + crank)), abs(far - (coupler - crank))) < 3e-3
        assert np.abs(robot.constraint_error(np.array(found["q"]))).max() < 1e-10


DRAG = """(m, given) => { const viewer = { robot: m.robot, mechanics: m, loops: new Loops(m), holds: true, q: m.robot.start, shown: { keep: false },
      stage: {}, setCoordinates(q) { this.q = q; } }, grasp = new Grasp(viewer);
    return given.map((goal) => { for (let k = 0; k < 20; k++) grasp.reach(goal); return viewer.q; }); }"""


def test_the_tip_of_a_closed_robot_is_dragged(closed):
    robot, page, header = closed
    tip, start, rng = header["frames"][header["tip"]]["name"], np.array(header["start"]), np.random.default_rng(2)
    goals = [robot.consistent(robot.open().add(start, 0.05 * rng.normal(size=robot.nv)), within=2.0) for _ in range(4)]
    places = [robot.open().forward_kinematics(q, tip)[:3, 3] for q in goals]
    found = [np.array(q) for q in under_node(page, DRAG, [p.tolist() for p in places])]
    for q, p in zip(found, places, strict=True):
        assert np.abs(robot.constraint_error(q)).max() < 1e-10
        np.testing.assert_allclose(robot.open().forward_kinematics(q, tip)[:3, 3], p, atol=1e-5 * header["size"])
    (far,) = under_node(page, DRAG, [[9.0, 9.0, 9.0]])  # out of reach
    assert np.abs(robot.constraint_error(np.array(far))).max() < 1e-10
    assert not robot.open().limits.exceeded(robot.open().model.positions(np.array(far))).any()


LET_GO = """(m, given) => { const fall = new Fall(m, given.q, given.dq, given.stops, new Loops(m));
    const found = given.times.map((t) => { while (fall.time < t - 1e-9) { fall.step(); if (Math.round(fall.time / fall.h) % 8 === 0) fall.keep(); }
      fall.advance(0); return [fall.q, fall.dq, fall.at, fall.kinetic + fall.potential]; });
    return { found, drift: fall.drift, at: fall.resistance?.at }; }"""


@pytest.mark.parametrize("name", ["four-bar", pytest.param("platform", marks=pytest.mark.slow)])
def test_a_closed_robot_let_go_moves_as_simulate_says(tmp_path, name):
    """Both integrate to round-off here: RK4 with 0.5 ms in the page, the library with 0.1 ms."""
    robot, motors = CLOSED[name]
    page = write_page(robot, tmp_path / "page.html", actuated=motors)
    header = read_page(page)[0]
    given = {"q": header["start"], "dq": [0.0] * robot.nv, "stops": False, "times": [0.02, 0.04]}
    gone = under_node(page, LET_GO, given)
    expected = robot.simulate(header["start"], np.zeros(robot.nv), 0.04, 1e-4)
    for (q, dq, *_), row in zip(gone["found"], (200, 400), strict=True):
        np.testing.assert_allclose(q, expected.q[row], atol=1e-9)
        np.testing.assert_allclose(dq, expected.dq[row], atol=1e-8)
        assert np.abs(robot.constraint_error(np.array(q))).max() < 1e-10
    assert gone["drift"] < 1e-7


def test_a_standing_robot_let_go_sinks_on_its_feet(standing):
    """Its energy goes to friction alone, its feet stay, and no joint passes its stops."""
    robot, page, header = standing
    start = {"q": header["start"], "dq": [0.0] * robot.nv}
    assert under_node(page, LET_GO, {**start, "stops": False, "times": [0.1]})["drift"] < 1e-7
    gone = under_node(page, LET_GO, {**start, "stops": True, "times": [0.1, 0.2, 0.3]})
    energies = [energy for *_, energy in gone["found"]]
    assert energies == sorted(energies, reverse=True)
    q = np.array(gone["found"][-1][0])
    assert q[6] < header["start"][6] - 0.01
    ends = [(q[b.q_index], robot.limits.lower[b.v_index], robot.limits.upper[b.v_index]) for b in robot.model.leaders]
    assert all(low - 0.02 <= x <= high + 0.02 for x, low, high in ends if np.isfinite([low, high]).all())
    for c in contacts_of(robot, header["standing"]):
        p, p0 = ((robot.forward_kinematics(x, c.frame) @ [*c.point, 1.0])[:3] for x in (q, np.array(header["start"])))
        np.testing.assert_allclose(p, p0, atol=1e-9)


def test_a_page_of_a_closed_robot_in_chromium(show):
    """A slider drags the crank all the way round; the others follow, and are not sliders."""
    robot = four_bar().close("rocker_pin", "coupler_pin", "vx vz")
    page = show("four_bar", robot)
    assert page.run("Array.from(document.querySelectorAll('#joints input'), (e) => e.disabled)") == [False, True, True]
    page.run(
        "(() => { const s = document.getElementById('hand-0'); for (let x = -3; x < 3; x += 0.1) { s.value = x; s.dispatchEvent(new Event('input')); } })()"
    )
    q = np.array(page.run("viewer.q"))
    assert q[0] == pytest.approx(2.9, abs=0.11)
    assert np.abs(robot.constraint_error(q)).max() < 1e-10
    np.testing.assert_allclose(page.run("viewer.tau"), robot.holding_torques(q, ["a"]).tau, atol=1e-9)
    page.open(page.run("location.href").split("#")[0] + f"#q={','.join(map(str, np.round(q, 6)))}")
    assert page.wait("!!window.viewer")
    assert np.abs(robot.constraint_error(np.array(page.run("viewer.q")))).max() < 1e-10
    u, v = page.run("viewer.stage.project(viewer.grasp.tip)")
    page.drag((u, v), (u - 30, v - 20))
    dragged = np.array(page.run("viewer.q"))
    assert np.abs(dragged - np.round(q, 6)).max() > 0.01
    assert np.abs(robot.constraint_error(dragged)).max() < 1e-10
    page.run("document.getElementById('let-go').click()")
    assert page.wait("viewer.fall && viewer.fall.time > 0.2")
    assert np.abs(robot.constraint_error(np.array(page.run("viewer.q")))).max() < 1e-9
    assert page.complaints == []


def test_a_standing_robot_in_chromium(show):
    robot = tw.robots.quadruped()
    page = show("quadruped_stands", robot)
    assert "On its feet: the floor bears 147 N" in page.run("document.getElementById('stands').textContent")
    at = next(k for k, hand in enumerate(page.run("viewer.robot.hands")) if hand["name"].endswith(" x"))
    page.run(
        f"(() => {{ const s = document.getElementById('hand-{at}'); s.value = 0.25; s.dispatchEvent(new Event('input')); }})()"
    )
    said = page.run("document.getElementById('stands').textContent + document.getElementById('stopped').textContent")
    assert "centre of mass is not above its feet" in said or "Stopped" in said
    page.run("viewer.address.reset(); document.getElementById('let-go').click()")
    assert page.wait("viewer.fall && viewer.fall.time > 0.02")
    assert "lost to friction" in page.run("document.getElementById('fall').textContent")
    page.run("document.getElementById('let-go').click(); document.getElementById('show-feet').click()")
    tau = page.run("viewer.tau")
    np.testing.assert_allclose(tau, robot.holding_torques(np.array(page.run("viewer.q"))), atol=1e-9)
    assert page.complaints == []


FOUR_BAR = """<mujoco model="linkage"><worldbody>
<body name="crank"><joint name="a" axis="0 -1 0"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"/>
<body name="coupler" pos="0.3 0 0"><joint name="b" axis="0 -1 0"/><geom type="capsule" fromto="0 0 0 0.8 0 0" size="0.02" mass="2"/></body></body>
<body name="rocker" pos="0.7 0 0"><joint name="d" axis="0 -1 0"/><geom type="capsule" fromto="0 0 0 0.6 0 0" size="0.02" mass="1.5"/></body>
</worldbody><equality><connect name="pin" body1="coupler" body2="rocker" anchor="0.8 0 0"/></equality>
<actuator><motor joint="a"/></actuator></mujoco>"""


def test_the_command_closes_the_loops_of_a_file(tmp_path):
    (tmp_path / "linkage.xml").write_text(FOUR_BAR)
    done = CliRunner().invoke(main, ["view", str(tmp_path / "linkage.xml"), "--html", str(tmp_path / "page.html")])
    assert done.exit_code == 0, done.output
    header = read_page(tmp_path / "page.html")[0]
    assert sum(header["loops"]["dependent"]) == 2
    assert not any("left open" in note for note in header["notes"])


GRIPPER = """<mujoco model="gripper"><worldbody><body name="palm"><geom type="box" size=".05 .03 .02" mass=".5"/>
<body name="crank" pos=".03 0 0"><joint name="crank" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.1" size=".005" mass=".05"/>
<body name="coupler" pos="0 0 -.1"><joint name="coupler" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .08 0 0" size=".005" mass=".05"/>
</body></body><body name="rocker" pos=".1 0 0"><joint name="rocker" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .01 0 -.1" size=".005" mass=".05"/></body></body></worldbody>
<equality><connect name="pin" body1="coupler" body2="rocker" anchor=".08 0 0"/></equality>
<tendon><fixed name="split"><joint joint="rocker" coef=".5"/></fixed></tendon>
<actuator>{}</actuator></mujoco>"""


def test_joints_of_tendon_actuators_are_the_motors_of_a_page(tmp_path):
    """The page moves and loads the joint that the tendon drives; without actuators it names the motors that it assumes."""
    texts = {"driven": GRIPPER.format('<general tendon="split" ctrlrange="0 1"/>'), "plain": GRIPPER.format("")}
    headers = {}
    for name, text in texts.items():
        closed = closed_by_file(tw.load(text))
        headers[name] = read_page(write_page(closed, tmp_path / f"{name}.html"))[0]
    loops = headers["driven"]["loops"]
    assert [bool(x) for x in loops["actuated"]] == [False, False, True]
    assert [bool(x) for x in loops["dependent"]] == [True, True, False]
    assert not any("assumed" in note for note in headers["driven"]["notes"])
    assert any(note.startswith("The file names no motors; assumed: crank.") for note in headers["plain"]["notes"])
    assert all(
        header["subtitle"].startswith("1 degree of freedom (3 joints, 1 closure),") for header in headers.values()
    )
