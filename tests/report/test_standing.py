"""Torques of robots that stand on their feet: with contact forces, against independent programs, and the first lines."""

from __future__ import annotations

import functools
import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from quick import mostly_slow
from robot_files import FILES, NONE
from scipy.optimize import linprog
from standing_robots import LEGS, dog

import twistwrench as tw
from twistwrench import statics
from twistwrench.cli.main import main
from twistwrench.reports.support.noise import SupportNoise
from twistwrench.reports.support.view import contact_tables
from twistwrench.viz.page_layer import contact_layer

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

HUMANOIDS = [
    name
    for name in (
        "talos_data/talos_reduced", "g1_description/g1_29dof_rev_1_0", "go2_description/go2",
        "anymal_c_simple_description/anymal", "beside/unitree_h1_2",
    )
    if name in FILES
] or NONE  # fmt: skip
BENT = {"thigh": 0.75, "calf": -1.5, "HFE": 0.75, "KFE": -1.5, "hip_pitch": -0.3, "knee": 0.6, "ankle_pitch": -0.3}


def opened(name, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(FILES[name], inertia="accept", **options)


def standing(robot):
    """A bent stance, at rest: angles by the words in joints' names, mirrored in the hind legs of ANYmal."""
    q = robot.neutral.copy()
    for k, joint in enumerate(robot.coordinate_names):
        angle = next((angle for word, angle in BENT.items() if word in joint), 0.0)
        q[k] = -angle if joint[1:3] == "H_" else angle
    return q


def at_rest(robot, rows=8):
    q, none = np.tile(standing(robot), (rows, 1)), np.zeros((rows, robot.nv))
    return tw.Motion(np.linspace(0, 1, rows), q, none, none, robot=robot)


@functools.cache
def swaying(acceleration, friction):
    """What a check says of the dog that sways, on ground of a coefficient of friction."""
    return tw.check(*dog(acceleration), feet="auto", contact_friction=friction)


# ── Torques ──


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n else n for n in HUMANOIDS])
def test_the_torques_of_a_robot_that_stands_are_those_of_mujoco_with_the_forces_of_least_norm(name):
    """MuJoCo's inverse dynamics and Jacobians, and its own least squares for the forces; all of them press and none slips."""
    mujoco = pytest.importorskip("mujoco")
    robot = opened(name, mimic="independent")
    answer = tw.check(robot, at_rest(robot), feet="auto", contact_friction=0.7)
    case = answer.load
    model = case.robot.to_mujoco()
    data = mujoco.MjData(model)
    state = answer.motion.q[0]
    data.qpos[:7] = np.r_[state[4:7], state[:4]]
    data.qpos[7:] = state[7:]
    mujoco.mj_inverse(model, data)
    maps = []
    for contact in case.ground.contacts:
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, contact.frame)
        place = np.asarray(case.robot.forward_kinematics(state, contact.frame)) @ np.r_[contact.point, 1.0]
        if body < 0:  # fixed to another link
            body = model.body_parentid[-1]
            links = case.robot.model
            link = links.bodies[links.frame(contact.frame).body].link
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link)
        J = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, J, None, place[:3], body)
        maps.append(J)
    G = np.concatenate(maps).T
    if len(case.ground.contacts) < 3:
        assert (
            answer.verdict.word == "UNSURE" and "feet are points, so it can only balance" in answer.verdict.reasons[0]
        )
        forces = np.linalg.lstsq(G[:6], data.qfrc_inverse[:6], rcond=None)[0]
    else:
        assert answer.headline.startswith("OK: stands. It needs no friction (given 0.7).")
        forces = np.linalg.lstsq(G[:6], data.qfrc_inverse[:6], rcond=None)[0]
        assert (forces[2::3] > 0).all()
    torques = data.qfrc_inverse[6:] - G[6:] @ forces
    assert_allclose(answer.torques()[0, 6:], torques, atol=1e-6 * np.abs(data.qfrc_inverse).max())
    assert (answer.torques()[:, :6] == 0).all()


def test_contact_forces_sum_up_to_the_mass_times_the_acceleration_of_its_centre_less_gravity():
    robot, motion = dog(3.0)
    answer = swaying(3.0, 0.6)
    mass = robot.model.moving_mass
    total = answer.support.forces.sum(axis=1)
    J = np.asarray(robot.com_jacobian(motion.q))
    acceleration = np.einsum("nij,nj->ni", J, motion.ddq)
    h = 1e-6
    ahead, behind = (np.asarray(robot.com_jacobian(robot.add(motion.q, sign * h * motion.dq))) for sign in (1, -1))
    acceleration += np.einsum("nij,nj->ni", (ahead - behind) / (2 * h), motion.dq)
    assert_allclose(total, mass * (acceleration + np.array([0, 0, 9.81])), atol=1e-7 * mass * 9.81)


def test_the_causes_of_a_torque_sum_up_to_it_and_the_ground_is_one_of_them():
    robot, motion = dog(3.0)
    answer = tw.check(robot, motion, feet="auto", contact_friction=0.6, payload="3,0.1,0,0@trunk")
    states = next(iter(answer.differentiation.states(100)))
    terms = answer.load.terms(states)
    assert "contact" in terms
    assert_allclose(sum(terms.values())[:, 6:], answer.torques()[:, 6:], atol=1e-9)
    assert_allclose(sum(terms.values())[:, :6], 0.0, atol=1e-9)
    assert answer.joints["FL_calf_joint"].main_cause[0] == "contact"
    why = answer.load.explain(states[3])
    assert_allclose(why.torque[6:], answer.torques()[3, 6:], atol=1e-9)


def test_a_log_of_the_joints_alone_gives_the_answer_of_a_log_with_the_base(tmp_path):
    """The base is found from the feet; peaks and margins agree to what the derived rates allow."""
    held = tw.load(tw.robots.path_of("quadruped"), floating_base=False)
    free = tw.robots.quadruped()
    t = np.linspace(0, 2, 101)
    bend = 0.2 * np.sin(np.pi * t)[:, None] ** 4
    joints = tw.Motion(
        t, np.tile([0.0, 0.7, -1.4], 4) + bend * np.tile([0.0, 1.0, -2.0], 4), robot=held, in_seconds=True
    )
    whole = statics.base_from_stance(free, joints, statics.find_feet(free))
    file = joints.to_csv(tmp_path / "joints.csv")
    first = tw.check(free, whole, feet="auto", contact_friction=0.6)
    for robot in (free, tw.load(tw.robots.path_of("quadruped"))):
        again = tw.check(robot, file, feet="auto", contact_friction=0.6)
        assert again.verdict.word == first.verdict.word == "OK"
        assert_allclose(again.peaks, first.peaks, atol=2e-3 * np.abs(first.peaks).max())
        assert_allclose(again.support.speed.min(), first.support.speed.min(), rtol=2e-2)


def test_columns_of_the_log_say_which_feet_stand(tmp_path):
    """A foot that the log has in the air carries nothing; forces in newtons count from 20."""
    _, motion = dog()
    file = motion.to_csv(tmp_path / "dog.csv")
    head, *rows = file.read_text().splitlines()
    columns = ",".join(f"{leg}_foot.contact" for leg in LEGS)
    file.write_text("\n".join([f"{head},{columns}", *(f"{row},35,0,40,50" for row in rows)]))
    asked = {"feet": "auto", "contact_friction": 0.6}
    answer = tw.check("quadruped", file, **asked, in_contact="log")
    assert (answer.support.in_contact == [True, False, True, True]).all()
    assert tw.check("quadruped", file, **asked).support.in_contact.all()
    with pytest.raises(tw.ValueRangeError, match=r"FL_foot\.contact"):
        tw.check("quadruped", motion.to_csv(tmp_path / "without.csv"), **asked, in_contact="log")


def feet_of_own_columns(tmp_path):
    """File of the dog whose feet have columns of their own: a force in kN, a switch, and two forces in N."""
    _, motion = dog()
    file = motion.to_csv(tmp_path / "own.csv")
    head, *rows = file.read_text().splitlines()
    file.write_text("\n".join([f"{head},fl [kN],fr,hind left,hind right", *(f"{row},0.035,0,40,1" for row in rows)]))
    return file, dict(zip([f"{leg}_foot" for leg in LEGS], ("fl", "fr", "hind left", "hind right"), strict=True))


def test_a_mapping_names_the_column_of_each_foot(tmp_path):
    """Columns by their names with or without the unit; in the shell FRAME=COLUMN."""
    file, columns = feet_of_own_columns(tmp_path)
    asked = {"feet": "auto", "contact_friction": 0.6}
    answer = tw.check("quadruped", file, **asked, in_contact=columns)
    assert (answer.support.in_contact == [True, False, True, True]).all()
    options = [part for frame, column in columns.items() for part in ("--in-contact", f"{frame}={column}")]
    told = CliRunner().invoke(
        main, ["torques", "quadruped", str(file), "--feet", "auto", "--contact-friction", "0.6", *options]
    )
    assert answer.headline in " ".join(told.output.split())


def test_a_mapping_has_a_value_for_each_row_of_a_motion():
    robot, motion = dog()
    asked = {"feet": "auto", "contact_friction": 0.6}
    half = np.arange(len(motion.time)) < len(motion.time) // 2
    given = {"FL_foot": True, "FR_foot": half, "RL_foot": 1.0, "RR_foot": [1.0] * len(half)}
    found = tw.check(robot, motion, **asked, in_contact=given).support
    assert_allclose(found.time, motion.time)
    assert (found.in_contact == np.c_[half | True, half, half | True, half | True]).all()
    forces = tw.check(robot, motion, **asked, in_contact={**given, "FL_foot": 300.0 * half, "RR_foot": 1}).support
    assert (forces.in_contact == np.c_[half, half, half | True, half | True]).all()


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"FL_foot": "fll"}, tw.ValueRangeError, r"no column 'fll', .* Did you mean 'fl'"),
        ({"FL_fot": "fl"}, tw.UnknownNameError, r"foot of in_contact named 'FL_fot'\. Did you mean 'FL_foot'"),
        ({"FL_foot": None}, tw.ValueRangeError, "FL_foot"),
        ({"FL_foot": [1.0, 0.0]}, tw.ShapeError, r"shape \(2,\), and the motion has 41 rows"),
        ({"FL_foot": np.nan}, tw.ValueRangeError, "finite"),
    ],
)  # fmt: skip
def test_a_mapping_that_does_not_fit_names_the_foot_and_the_remedy(tmp_path, change, error, words):
    file, columns = feet_of_own_columns(tmp_path)
    with pytest.raises(error, match=words):
        tw.check("quadruped", file, feet="auto", in_contact={**columns, **change})
    with pytest.raises(tw.ValueRangeError, match="no entry for 'RL_foot'"):
        tw.check("quadruped", file, feet="auto", in_contact={"FL_foot": "fl", "FR_foot": "fr"})
    with pytest.raises(tw.ValueRangeError, match="Choose one of: auto, log"):
        tw.check("quadruped", file, feet="auto", in_contact="columns")


# ── First lines ──


def test_a_robot_that_stands_is_ok_with_the_friction_it_needs_and_its_margin_in_speed():
    answer = swaying(3.0, 0.6)
    need, speed = answer.support.friction.max(), answer.support.speed.min()
    assert 0.9 * 3.0 / 9.81 < need < 1.1 * 3.0 / 9.81 and 1.1 < speed < 1.5
    first = f"OK: stands. It needs friction {np.ceil(100 * need) / 100:.2f} (given 0.6) and holds up to "
    assert answer.headline.startswith(first)
    assert "× this speed. Closest: " in answer.headline
    _, faster = dog(3.0 * speed**2 * 1.01)
    assert not tw.check(answer.load.robot, faster, feet="auto", contact_friction=0.6).support.holds.all()


def test_without_a_coefficient_none_is_invented():
    little, much = (swaying(a, None) for a in (2.0, 3.6))
    assert little.headline.startswith("OK: stands, if the ground gives friction 0.2")
    assert much.headline.startswith("UNSURE: needs friction 0.")
    assert "and none is given" in much.headline
    tipping = swaying(8.0, None)
    assert tipping.headline.startswith("OVER LIMIT: tips over ")


def test_a_robot_that_tips_or_slips_is_over_its_limit_with_the_place_and_the_remedy():
    tipping = swaying(6.0, 2.0)
    assert tipping.headline.startswith("OVER LIMIT: tips over ")
    assert {*tipping.headline.partition("over ")[2].partition(" at t")[0].split(" and ")} in (
        {"FL_foot", "RL_foot"}, {"FR_foot", "RR_foot"}
    )  # fmt: skip
    assert f"It stands up to 0.{int(1000 * tipping.support.speed.min())}" in tipping.headline
    slipping = swaying(4.0, 0.3)
    assert slipping.headline.startswith("OVER LIMIT: slips at ")
    assert ", given 0.3. It stands up to 0.8" in slipping.headline


def least_largest_share(robot, motion, row, friction, edges=64, limits=None):
    """Least possible largest share of a torque limit over forces in pyramids inside the cones: a linear programme."""
    q, feet = motion.q[row], [f"{leg}_foot" for leg in LEGS]
    J = np.concatenate([np.asarray(robot.jacobian(q, foot, "world_aligned"))[3:] for foot in feet])
    tau = robot.inverse_dynamics(q, motion.dq[row], motion.ddq[row])
    limits = robot.limits.effort if limits is None else limits
    turn = 2 * np.pi * np.arange(edges) / edges
    cone = np.stack([np.cos(turn), np.sin(turn), -friction * np.cos(np.pi / edges) * np.ones(edges)], axis=1)
    rows = [np.c_[np.kron(np.eye(4), cone), np.zeros(4 * edges)]]
    rows += [np.c_[-sign * J[:, 6:].T, -limits[6:]] for sign in (1, -1)]
    bounds = np.concatenate([np.zeros(4 * edges), *(-sign * tau[6:] for sign in (1, -1))])
    goal, balance = np.r_[np.zeros(12), 1.0], np.c_[J[:, :6].T, np.zeros(6)]
    free = [(None, None)] * 12 + [(0, None)]
    found = linprog(goal, np.concatenate(rows), bounds, balance, tau[:6], free)
    assert found.status == 0
    return found.fun


def test_torques_beyond_their_limits_are_over_though_the_robot_stands():
    """One weak leg is relieved by the others; under a load that is too much for all, no distribution of their forces helps."""
    robot, motion = dog()
    asked = {"feet": "auto", "contact_friction": 0.6}
    relieved = tw.check(robot, motion, **asked, limits={"FL_calf_joint": 1.0})
    assert relieved.verdict.ok and relieved.joints["FL_calf_joint"].share <= 1.0 + 1e-6
    weak = tw.check(robot, motion, **asked, payload="150@trunk")
    least = least_largest_share(robot.with_payload(tw.SpatialInertia.from_com(150.0), "trunk"), motion, 0, 0.6)
    (worst,) = {round(joint.share, 3) for joint in weak.joints if joint.joint.endswith(("hip_joint", "calf_joint"))}
    assert weak.headline.startswith("OVER LIMIT: ") and abs(worst - least) < 2e-3  # all hips and calves share the load
    assert "Stands with the friction given, 0.6." in str(weak)


def test_friction_that_torque_limits_need_is_stated():
    """A weak leg is relieved by forces across the floor: the least coefficient is that of a linear programme."""
    robot, motion = dog()
    smooth = tw.check(robot, motion, feet="auto", contact_friction=0.0)
    weak = {"FL_thigh_joint": 0.7 * abs(smooth.joints["FL_thigh_joint"].peak)}
    answer = tw.check(robot, motion, feet="auto", contact_friction=0.6, limits=weak)
    low, high = 0.0, 0.6
    for _ in range(12):
        middle = 0.5 * (low + high)
        share = least_largest_share(robot, motion, 0, middle, limits=answer.limits.effort)
        low, high = (low, middle) if share <= 1 else (middle, high)
    assert_allclose(answer.support.friction[0], high, atol=2e-3)
    stated = float(answer.headline.partition("needs friction ")[2].split()[0])
    assert high - 2e-3 <= stated <= 1.1 * high + 2e-3
    none = tw.check(robot, motion, feet="auto", limits=weak)
    assert "without any friction" not in none.headline


# ── Feet that carry: flight, a foot that slides, points, and noise ──


def test_a_robot_in_the_air_needs_nothing_from_the_ground_and_one_that_hovers_is_unsure():
    robot, still = dog(rows=21)
    fall = still.q.copy()
    t = still.time
    fall[:, 6] += 0.5 - 0.5 * 9.81 * t**2
    dq, ddq = np.zeros((21, 18)), np.zeros((21, 18))
    dq[:, 5], ddq[:, 5] = -9.81 * t, -9.81
    asked = {"feet": "auto", "contact_friction": 0.6}
    columns = np.zeros((21, 4))

    def flown(q, dq, ddq):
        file = tw.Motion(t, q, dq, ddq, robot=robot, in_seconds=True)
        return tw.check(robot, file, **asked)

    assert not columns.any()
    free = flown(fall, dq, ddq)
    assert not free.support.in_contact[5:].any()
    assert "no foot is down" not in str(free.verdict)
    hovering = still.q.copy()
    hovering[:, 6] += 0.5
    moving = np.zeros((21, 18))
    moving[:, 3] = 0.3  # all feet move with the trunk
    hovering[:, 4] += 0.3 * t
    hovers = flown(hovering, moving, np.zeros((21, 18)))
    assert hovers.verdict.word == "UNSURE"
    assert "slides at 0.3 m/s" in hovers.headline  # the lowest height of the log is taken for the floor


@pytest.mark.parametrize(
    ("phases", "turn"), [("stand, fly, slide", 0.1), ("slide, fly, stand", -0.1), ("fly, slide, stand", -0.1)]
)
def test_the_foot_that_slides_is_the_fastest_on_the_floor_with_its_own_speed_and_time(phases, turn):
    """Stiff and upright it moves along x and turns, fastest in flight; ω×r adds to the speed of feet on one side."""
    robot, still = dog(rows=21)
    speeds = {"stand": np.zeros(7), "fly": np.full(7, 2.0), "slide": np.array([0.2, 0.25, 0.3, 0.4, 0.3, 0.25, 0.2])}
    order = phases.split(", ")
    q, dq = np.tile(still.q[0], (21, 1)), np.zeros((21, 18))
    q[:, 6] += np.concatenate([np.full(7, 0.3 * (phase == "fly")) for phase in order])
    dq[:, 3] = np.concatenate([speeds[phase] for phase in order])
    dq[:, 2] = turn * dq[:, 3]
    row = 7 * order.index("slide") + 3
    motion = tw.Motion(0.02 * np.arange(21) + 5.0, q, dq, 0 * dq, robot=robot, in_seconds=True)
    foot, speed, time = tw.check(robot, motion, feet="auto", contact_friction=0.6).support.sliding
    base = robot.forward_kinematics(q[row], "trunk")
    places = {f"{leg}_foot": robot.forward_kinematics(q[row], f"{leg}_foot")[:2, 3] - base[:2, 3] for leg in LEGS}
    by_foot = {name: 0.4 * np.hypot(1.0 - turn * y, turn * x) for name, (x, y) in places.items()}
    assert foot == max(by_foot, key=by_foot.get)
    assert speed == pytest.approx(by_foot[foot], rel=1e-6)
    assert time == pytest.approx(5.0 + 0.02 * row, rel=1e-12)


def test_a_robot_on_points_is_no_equilibrium_and_is_printed_so():
    robot, motion = dog()
    answer = tw.check(robot, motion, feet=["FL_foot", "RR_foot"], contact_friction=0.6)
    assert answer.headline.startswith("UNSURE: feet are points, so it can only balance")
    assert "feet='LxW@FL_foot'" in answer.headline.replace('"', "'") or "feet=LxW@FL_foot" in answer.headline
    if not answer.support.holds.any():
        assert "Forces of the ground" not in answer.tables
        assert f"NO EQUILIBRIUM: at {len(motion.time)} of {len(motion.time)} instants" in str(answer)
    assert "NO EQUILIBRIUM" not in str(swaying(0.0, 0.6))


def test_the_least_force_of_a_foot_is_that_of_the_instants_that_balance():
    """Forces of 100 N; at the second instant none balance."""
    forces = np.zeros((3, 2, 3))
    forces[:, :, 2] = [[40.0, 60.0], [0.0, 0.0], [70.0, 30.0]]
    contact = tw.statics.Contact()
    ground = SimpleNamespace(
        frames=("a", "b"),
        contacts_at=lambda frame: np.array(["ab".index(frame)]),
        given=True,
        normals=np.tile(contact.normal, (2, 1)),
        frictions=np.full(2, contact.friction),
    )
    found = SimpleNamespace(
        balanced=np.array([True, False, True]),
        balanced_forces=forces,
        aground=np.ones(3, bool),
        in_contact=np.ones((3, 2), bool),
        contacts=(contact, contact),
        time=np.arange(3.0),
        ground=ground,
    )
    (table,) = contact_tables(found)
    shown = {column.name: [*column.values] for column in table.columns}
    assert (shown["least"], shown["pressing"], shown["when"]) == ([40.0, 30.0], [70.0, 60.0], [2.0, 0.0])


def noisy(acceleration, noise, tmp_path, rows=201, seed=1):
    """Log of positions for 0.4 s with noise, of the dog that sways."""
    robot, motion = dog(acceleration, rows=rows)
    rng = np.random.default_rng(seed)
    q = motion.q + noise * rng.standard_normal(motion.q.shape)
    file = tmp_path / f"{acceleration}_{noise}.csv"
    tw.Motion(motion.time, q, robot=robot, in_seconds=True).to_csv(file)
    head, *rows = file.read_text().splitlines()
    keep = [k for k, name in enumerate(head.split(",")) if not name.endswith((".vel", ".acc")) and "acc" not in name]
    file.write_text("\n".join(",".join(np.array(row.split(","))[keep]) for row in [head, *rows]))
    return robot, file


@pytest.mark.parametrize(("acceleration", "word"), mostly_slow([(2.0, "OK"), (8.0, "OVER LIMIT")], 2))
def test_noise_within_the_margin_changes_no_first_word(acceleration, word, tmp_path):
    robot, file = noisy(acceleration, 2e-5, tmp_path)
    assert tw.check(robot, file, feet="auto", contact_friction=0.6).verdict.word == word


@pytest.mark.parametrize("seed", mostly_slow(range(6), 3))
def test_noise_at_the_end_of_a_log_tips_no_robot(seed, tmp_path):
    """Beyond its ends a log has no samples: derived accelerations there have up to nine times the noise."""
    robot, file = noisy(2.0, 2e-5, tmp_path, rows=101, seed=seed)
    answer = tw.check(robot, file, feet="auto", contact_friction=0.6)
    assert answer.verdict.word in ("OK", "UNSURE"), answer.headline


@pytest.mark.parametrize("acceleration", mostly_slow([3.0, 2.85], 2))  # slips at 0.3 g = 2.943 m/s²
def test_within_the_noise_a_robot_that_would_slip_is_unsure(acceleration, tmp_path):
    robot, file = noisy(acceleration, 1e-4, tmp_path, rows=101)
    answer = tw.check(robot, file, feet="auto", contact_friction=0.3)
    assert answer.verdict.word == "UNSURE", answer.headline
    assert "noise of the log" in str(answer.verdict)


@pytest.mark.parametrize("margin", [1.05, 2.5])
@pytest.mark.parametrize("spread", [0.0022, 0.012, 0.07])
def test_the_interval_of_a_margin_in_speed_is_half_that_of_the_power(spread, margin):
    """Inertial forces grow with the square of the speed: a power 1 ± 1.96 spread is that of the speed √(1 ± 1.96 spread)."""
    noise = SupportNoise(np.zeros(1, bool), spread, margin, 0.1, "slips")
    slow, fast = margin * np.sqrt(1.0 + 1.96 * spread * np.array([-1.0, 1.0]))
    beside_the_margin = re.fullmatch(r" \(± (\S+) by noise\)", noise.interval_words(margin))
    in_a_sentence = re.search(r"up to (\S+) ± (\S+) × this speed", noise.words)
    for stated in (beside_the_margin[1], in_a_sentence[2]):
        assert float(stated) == pytest.approx(0.5 * (fast - slow), rel=0.06)  # two digits
    assert float(in_a_sentence[1]) == pytest.approx(margin, rel=0.01)


def test_the_interval_of_a_margin_is_left_out_below_one_in_500_and_without_a_margin():
    def words(spread, margin):
        return SupportNoise(np.zeros(1, bool), spread, margin, 0.1, "slips").interval_words(margin)

    half_width = 0.002 / (0.5 * 1.96)  # in standard deviations of the power
    assert words(1.01 * half_width, 2.5) == " (± 0.0051 by noise)"
    assert words(0.99 * half_width, 2.5) == words(0.0, 2.5) == words(0.07, np.inf) == ""


# ── At rest ──


def test_a_robot_at_rest_is_asked_without_a_motion(tmp_path):
    robot, _ = dog()
    at = {f"{leg}_{k}_joint": a for leg in LEGS for k, a in (("thigh", 0.8), ("calf", -1.6))}
    answer = tw.check(robot, at=at, feet="auto", contact_friction=0.6)
    assert answer.headline.startswith("OK: stands. It needs no friction (given 0.6)")
    assert_allclose(np.abs(answer.peaks), np.abs(swaying(0.0, 0.6).peaks), atol=1e-6)
    assert_allclose(answer.motion.q[0, :7], [1, 0, 0, 0, 0, 0, answer.motion.q[0, 6]], atol=1e-9)
    assert "At rest with each joint at zero, or at the nearest limit" in str(tw.check(robot, feet="auto"))
    assert "nearest limit" not in str(answer)
    arm = tw.check("ur5", at={"shoulder_lift_joint": -0.6})
    assert_allclose(arm.torques()[0], tw.robots.ur5().gravity_forces(arm.motion.q[0]), atol=1e-9)
    with pytest.raises(tw.ValueRangeError, match="no motion is given"):
        tw.check("ur5")
    with pytest.raises(tw.ValueRangeError, match="a motion is given too"):
        tw.check("ur5", "demo", at={"elbow_joint": 0.1})


@pytest.mark.parametrize("options", [[], ["--at", "FL_calf_joint=-1.6"]])
def test_the_shortest_command_asks_for_standing_at_rest(options):
    done = CliRunner().invoke(main, ["torques", "quadruped", "--feet", "auto", *options])
    assert "stands" in done.output.lower() or "tips" in done.output, done.output
    help_text = CliRunner().invoke(main, ["torques", "--help"]).output
    assert "--at" in help_text and "[MOTION]" in help_text
    bare = CliRunner().invoke(main, ["torques", "ur5"])
    assert bare.exit_code == 2 and "--at" in bare.output
    unused = CliRunner().invoke(main, ["torques", "quadruped", "--feet", "auto", "--rate", "100"])
    assert unused.exit_code == 2 and "--rate" in unused.output


@pytest.mark.parametrize(("friction", "acceleration"), [(0.6, 2.0), (0.3, 4.0), (None, 8.0), (None, 3.6)])
def test_the_page_does_not_claim_that_a_robot_stands_which_does_not(friction, acceleration):
    answer = swaying(acceleration, friction)
    words = contact_layer(answer.support, answer.motion.time).told
    assert words.startswith("stands") == answer.verdict.ok
    assert words.split(". ")[0].rstrip(".") in answer.headline


@pytest.mark.slow
def test_the_page_shows_contact_forces_the_foundation_and_the_grip(tmp_path):
    pytest.importorskip("matplotlib")
    moved = swaying(3.0, 0.6)
    arm = tw.check("ur5", "demo", payload=5, mounting=True, bolts="4x0.17", grip="80,0.5")
    resting = tw.check("quadruped", feet="auto")
    for answer, titles in (
        (moved, ["Contact forces, margins and friction cones"]),
        (arm, ["Load of the foundation", "Grip of the payload"]),
        (resting, ["Contact forces, margins and friction cones"]),
    ):
        assert [picture.title for picture in answer.pictures()][-len(titles) :] == titles
    page = resting.to_html(tmp_path / "rest.html").read_text()
    assert "Contact forces, margins and friction cones" in page and len(page) < 1_000_000
    assert moved.plot("support", tmp_path / "forces.png").stat().st_size > 10_000


# ── Bad input ──


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"feet": "FL_hand"}, "no frame of feet named 'FL_hand'"),
        ({"feet": []}, "is empty"),
        ({"feet": "0.2xlong@FL_foot"}, "LENGTHxWIDTH"),
        ({"feet": "auto", "contact_friction": -1}, "at least zero"),
        ({"feet": "auto", "contact_friction": {"FL_foot": 0.5}}, "no coefficient for 'FR_foot'"),
        ({"feet": "auto", "contact_friction": {"FL_hand": 0.5}}, "FL_hand"),
        ({"contact_friction": 0.5}, "nothing stands on it"),
    ],
)
def test_bad_input_is_one_error_that_says_what_to_give(options, words):
    with pytest.raises((tw.ValueRangeError, tw.UnknownNameError)) as found:
        tw.check(*dog(rows=11), **options)
    assert words in str(found.value)


def test_feet_of_a_robot_whose_base_is_fixed_or_planar_are_refused():
    held = tw.load(tw.robots.path_of("quadruped"), floating_base=False)
    motion = tw.Motion(np.linspace(0, 1, 8), np.zeros((8, 12)), np.zeros((8, 12)), np.zeros((8, 12)), robot=held)
    with pytest.raises(tw.ValueRangeError, match="fixed"):
        tw.check(held, motion, feet="auto")
    arm = tw.robots.ur5()
    still = tw.Motion(np.linspace(0, 1, 8), np.zeros((8, 6)), np.zeros((8, 6)), np.zeros((8, 6)), robot=arm)
    with pytest.raises(tw.ValueRangeError, match="no legs are found"):
        tw.check(arm, still, feet="auto")


def test_a_planar_base_carries_no_feet(tmp_path):
    """Its file holds the height and the tilt of the base, which the ground would have to carry."""
    inertial = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = "".join(f'<link name="{name}">{inertial}</link>' for name in ("floor", "cart", "arm"))
    path = tmp_path / "planar.urdf"
    path.write_text(
        f'<robot name="planar">{links}<joint name="drives" type="planar"><parent link="floor"/><child link="cart"/>'
        '<axis xyz="0 0 1"/></joint><joint name="turns" type="continuous"><parent link="cart"/><child link="arm"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    robot = tw.load(path)
    with pytest.raises(tw.ValueRangeError, match=r"planar joint 'drives' alone\. Lock that joint"):
        tw.check(robot, at={"turns": 0.1}, wheels="cart")


def test_the_command_asks_the_same_question(tmp_path):
    _, motion = dog(3.0)
    file = motion.to_csv(tmp_path / "dog.csv")
    words = ["torques", "quadruped", str(file), "--feet", "auto", "--contact-friction", "0.6"]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0
    assert " ".join(done.output.split()).startswith("OK: stands. It needs friction 0.")
    alone = CliRunner().invoke(main, [*words[:3], "--contact-friction", "0.6"])
    assert alone.exit_code == 2 and "--feet auto" in alone.output
