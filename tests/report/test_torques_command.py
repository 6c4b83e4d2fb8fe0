"""The torques command: its options, its exit codes, and what its report says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from motions import report_of, write_motion, write_positions

from twistwrench import ModelWarning, ValueRangeError, load, robots
from twistwrench.mechanics.model.inertia_checks import massless_links
from twistwrench.motion.load_case import parse_payload, parse_wrenches
from twistwrench.motion.model_doubts import missing_force, open_loop_joints
from twistwrench.reports.torque_report import JointTorque

pytest_plugins = ("torque_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")
DEMO = Path(robots.__file__).parent / "ur5_demo.csv"

# ── options ──


def test_payloads_and_wrenches_are_read_as_written():
    assert parse_payload("5").mass == 5
    load = parse_payload(" 2.5,0,-.1,1e-2@tool0")
    assert (load.mass, load.place, load.frame) == (2.5, (0.0, -0.1, 0.01), "tool0")
    assert parse_payload("2kg").mass == parse_payload("2 kg, 0, 0, 0").mass == 2
    for wrong in ("kg", "2g", "2kg kg", "1,2kg,0,0"):
        with pytest.raises(ValueRangeError, match="expected MASS"):
            parse_payload(wrong)
    wrenches = parse_wrenches(["a:1,2,3,4,5,6", "ns:b:0,0,0,0,0,1", "a:1,1,1,1,1,1"])
    np.testing.assert_array_equal(wrenches["a"], [2, 3, 4, 5, 6, 7])
    np.testing.assert_array_equal(wrenches["ns:b"], [0, 0, 0, 0, 0, 1])


def test_a_robot_without_friction_in_its_file_is_said_to_have_none(run):
    for flags, said in (([], "no friction, as its file gives none"), (["--no-friction"], "without friction")):
        _, output = run("torques", "ur5", "--trajectory", "demo", *flags)
        assert said in " ".join(output.split())


BAD_INPUT = {
    "no such robot": (["nobot", "--trajectory", DEMO], "no robot file 'nobot'"),
    "no such motion": (["ur5", "--trajectory", "none.csv"], "no motion file"),
    "no bundled motion": (["panda", "--trajectory", "demo"], "no motion is bundled with 'panda'. With: ur5"),
    "payload words": (["ur5", "--trajectory", DEMO, "--payload", "heavy"], "expected MASS[,x,y,z][@FRAME] in kg and m"),
    "payload pair": (["ur5", "--trajectory", DEMO, "--payload", "1,2"], "payload '1,2': expected MASS"),
    "payload below zero": (["ur5", "--trajectory", DEMO, "--payload", "-1"], "negative mass"),
    "payload infinite": (["ur5", "--trajectory", DEMO, "--payload", "inf"], "payload 'inf': expected MASS"),
    "payload nowhere": (["ur5", "--trajectory", DEMO, "--payload", "1@hand"], "no frame named 'hand'"),
    "payload at nothing": (["ur5", "--trajectory", DEMO, "--payload", "1@"], "names no frame"),
    "wrench without frame": (["ur5", "--trajectory", DEMO, "--wrench-on-robot", "1,2,3,4,5,6"], "names no frame"),
    "wrench too short": (
        ["ur5", "--trajectory", DEMO, "--wrench-on-robot", "tool0:1,2,3"],
        "wrench on tool0 '1,2,3': expected FRAME:m,m,m,f,f,f",
    ),
    "wrench nowhere": (["ur5", "--trajectory", DEMO, "--wrench-on-robot", "hand:0,0,0,0,0,1"], "no frame named 'hand'"),
    "lock nothing": (["ur5", "--trajectory", DEMO, "--lock", "elbow_joint"], "is not JOINT=VALUE"),
    "lock unknown": (["ur5", "--trajectory", DEMO, "--lock", "elbow=1"], "elbow"),
    "locked twice": (["ur5", "--trajectory", DEMO, *("--lock", "elbow_joint=0") * 2], "is given twice"),
    "demo in degrees": (["ur5", "--trajectory", "demo", "--degrees"], "is in radians"),
    "wrench without numbers": (["ur5", "--trajectory", DEMO, "--wrench-on-robot", "tool0"], "names no frame"),
    "no such picture folder": (["ur5", "--trajectory", DEMO, "--plot", "no/such/o.png"], "cannot write"),
    "no such option": (["ur5", "--trajectory", DEMO, "--plott", "o.png"], "--plot"),
    "no trajectory": (["ur5"], "Missing MOTION: a log or plan, or 'demo'."),
    "kind without plot": (["ur5", "--trajectory", DEMO, "--kind", "power"], "Add --plot OUT.png"),
    "no such folder": (["ur5", "--trajectory", DEMO, "--csv", "no/such/folder/o.csv"], "cannot write"),
    "no such picture": (["ur5", "--trajectory", DEMO, "--plot", "o.xyz"], "pictures of kind 'xyz'"),
    "no such limits": (["ur5", "--trajectory", DEMO, "--limits", "none.csv"], "no limits file"),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_exits_2_with_one_line(run, case):
    arguments, said = BAD_INPUT[case]
    if "--plot" in arguments:
        pytest.importorskip("matplotlib")
    code, text = run("torques", *arguments)
    assert code == 2, text
    (line,) = [x for x in text.splitlines() if x.startswith("error: ")]
    assert said in line


def test_the_verdict_and_the_limits_of_the_page_are_in_degrees_if_asked(run, tmp_path):
    """180 °/s allowed, 250 °/s reached: no figure of the headline or of the page's limits is in radians."""
    t = np.linspace(0.0, 4.0, 401)
    q = np.degrees(0.5) * (1 - np.cos(2.0 * t))
    q *= 250.0 / np.gradient(q, t).max()
    table = np.column_stack([t, q, 0 * q])
    np.savetxt(tmp_path / "m.csv", table, delimiter=",", header="time,joint1 [deg],joint2 [deg]", comments="")
    (tmp_path / "limits.csv").write_text("joint,effort,velocity\njoint1,900,180\njoint2,900,180\n")
    code, output = run(
        "torques", "planar_2r", "--trajectory", tmp_path / "m.csv", "--limits", tmp_path / "limits.csv", "--degrees",
        "--report", tmp_path / "page.html",
    )  # fmt: skip
    assert code == 1
    headline = " ".join(output.partition("\n\n")[0].split())
    assert re.search(
        r"joint1 exceeds its velocity limit at t = \S+ s by (69\.\d|70(\.\d)?) °/s: -?2(49|50)[.\d]*, limit 180\.",
        headline,
    ), headline
    assert "rad" not in headline
    limits = re.search(r"Limits used.*?</table>", (tmp_path / "page.html").read_text(), re.DOTALL)[0]
    assert "velocity [°/s]" in limits and "180" in limits and "rad" not in limits


def test_degrees_and_radians_give_the_same_torques(run, ur5, motion, tmp_path, motion_file):
    t, *columns = motion
    turned = write_motion(tmp_path / "degrees.csv", ur5, t, [np.degrees(c) for c in columns])
    run("torques", "ur5", "--trajectory", motion_file, "--csv", tmp_path / "a.csv")
    run("torques", "ur5", "--trajectory", turned, "--degrees", "--csv", tmp_path / "b.csv")
    a, b = (np.loadtxt(tmp_path / f"{x}.csv", delimiter=",", skiprows=1) for x in "ab")
    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_a_locked_joint_needs_no_column(run, ur5, motion, tmp_path):
    t, *columns = motion
    locked = ur5.lock({"wrist_3_joint": 0.5})
    path = write_motion(tmp_path / "m.csv", locked, t, [c[:, :5] for c in columns])
    for value, flags in (("0.5", []), (repr(float(np.degrees(0.5))), ["--degrees"])):
        code, text = run("info", "ur5", "--lock", f"wrist_3_joint={value}", *flags)
        assert code == 0, text
        assert "5 moving bodies" in text
    assert run("torques", "ur5", "--trajectory", path, "--lock", "wrist_3_joint=0.5")[0] in (0, 1)


def test_columns_of_locked_joints_and_others_are_ignored_with_a_note(run, ur5, motion, motion_file, tmp_path):
    code, text = run("torques", "ur5", "--trajectory", motion_file, "--lock", "elbow_joint=1")
    assert code in (0, 1), text
    assert "Columns of locked joints are ignored: elbow_joint, elbow_joint.vel" in " ".join(text.split())
    lines = motion_file.read_text().splitlines()
    path = tmp_path / "x.csv"
    path.write_text("\n".join([lines[0] + ",temp", *(f"{x},20" for x in lines[1:])]) + "\n")
    said = " ".join(run("torques", "ur5", "--trajectory", path)[1].split())
    assert "not coordinates of this robot are ignored: temp." in said


# ── verdicts ──


def test_a_motion_within_limits_exits_0(run, tmp_path):
    code, text = run("torques", "ur5", "--trajectory", "demo", "--payload", "5")
    assert code == 0, text
    assert "OK: all limits kept. Closest: shoulder_lift_joint" in text
    assert "!" not in text, "nothing to remark in our own demonstration"


def test_what_is_derived_is_said(run, tmp_path):
    lines = DEMO.read_text().splitlines()
    rows = [",".join(line.split(",")[:7]) for line in lines if not line.startswith("#")]
    path = tmp_path / "positions.csv"
    path.write_text("\n".join(rows) + "\n")
    code, text = run("torques", "ur5", "--trajectory", path, "--payload", "5")
    assert (code, "derived by a quintic spline" in text) == (0, False), text
    assert "1 note on how the log was read: --all" in text
    code, text = run("torques", "ur5", "--trajectory", path, "--payload", "5", "--all")
    assert "! The file has no velocities and accelerations: derived by a quintic spline." in " ".join(text.split())
    assert "--all" not in text


@pytest.mark.parametrize(
    "row, said",
    [
        (
            "shoulder_lift_joint,,,,80",
            r"OVER LIMIT: shoulder_lift_joint needs -114\.6 N m at t = \d\.\d+ s, 143 % of its limit \(80 N m\)",
        ),
        ("elbow_joint,,1,,", "OVER LIMIT: elbow_joint exceeds its position limit at t ="),
        ("elbow_joint,,,0.5,", "OVER LIMIT: elbow_joint exceeds its velocity limit at t ="),
    ],
)
def test_a_limit_passed_exits_1_and_says_which(run, tmp_path, row, said):
    limits = tmp_path / "limits.csv"
    limits.write_text(f"joint,lower,upper,velocity,effort\n{row}\n")
    code, text = run("torques", "ur5", "--trajectory", "demo", "--payload", "5", "--limits", limits)
    assert code == 1
    assert re.search(said, " ".join(text.split()))


def noisy_still(tmp_path, robot):
    t = np.arange(400) * 0.01
    q = np.array([0, -1.0, 1, 0, 0, 0]) + 1e-5 * np.random.default_rng(5).normal(size=(400, 6))
    return write_positions(tmp_path / "m.csv", robot, t, q)


def with_limit(tmp_path, effort):
    limits = tmp_path / "l.csv"
    limits.write_text(f"joint,effort\nshoulder_lift_joint,{effort!r}\n")
    return limits


def test_an_excess_that_noise_explains_is_none_and_the_first_line_says_so(run, ur5, tmp_path):
    path = noisy_still(tmp_path, ur5)
    joint = report_of(ur5, path).joints[1]
    held = abs(float(ur5.gravity_forces([0, -1.0, 1, 0, 0, 0])[1]))
    # Among 400 samples the largest is some three standard deviations of the noise above what the joint holds.
    assert abs(joint.raw) > held + 2 * joint.noise
    assert abs(joint.peak) == pytest.approx(held, abs=3 * joint.uncertainty)
    assert joint.uncertainty < 0.3 * joint.noise
    limits = with_limit(tmp_path, 0.5 * (abs(joint.raw) + held))
    code, text = run("torques", "ur5", "--trajectory", path, "--limits", limits)
    assert code == 0
    first = " ".join(text.split("\n\n")[0].split())
    assert first.startswith("OK: all limits kept. Closest: shoulder_lift_joint")
    assert " % ± " in first and first.endswith("Without smoothing, noise would take 1 joint over a limit.")
    assert f"{joint.raw:.2f}" in text and f"{joint.peak:.2f}" in text
    assert "± 1σ" in text


def test_a_limit_that_noise_reaches_is_unsure_and_one_beyond_it_is_passed(run, ur5, tmp_path):
    path = noisy_still(tmp_path, ur5)
    joint = report_of(ur5, path).joints[1]
    for sigmas, word, code in (
        (-20, "OVER LIMIT: shoulder_lift_joint", 1),
        (-0.5, "UNSURE: shoulder_lift_joint may exceed its limit", 1),
    ):
        limits = with_limit(tmp_path, abs(joint.peak) + sigmas * joint.uncertainty)
        found, text = run("torques", "ur5", "--trajectory", path, "--limits", limits)
        assert (found, text.startswith(word)) == (code, True), text


def test_links_without_mass_make_the_verdict_unsure(run, tmp_path):
    text = re.sub(r"<inertial>.*?</inertial>", "", robots.path_of("planar_2r").read_text(), flags=re.DOTALL)
    bare = tmp_path / "bare.urdf"
    bare.write_text(text)
    robot = load(bare)
    code, text = run("torques", bare, "--trajectory", still_file(tmp_path, robot))
    assert code == 1
    first = " ".join(text[text.index("UNSURE") :].split("\n\n")[0].split())
    assert first.startswith("UNSURE: ")
    assert all(link in first for link in massless_links(robot.model))
    assert "have no mass" in first


def test_a_joint_is_named_once_in_the_verdict(run, motion_file, tmp_path):
    limits = tmp_path / "l.csv"
    limits.write_text("joint,lower,upper,velocity [rad/s]\nelbow_joint,-0.1,0.1,0.1\n")
    said = " ".join(run("torques", "ur5", "--trajectory", motion_file, "--limits", limits)[1].split())
    assert said[: said.index("ur5")].count("elbow_joint") <= 2


def test_a_payload_on_the_base_and_a_limit_of_none_are_noted_once(run, motion_file, tmp_path):
    limits = tmp_path / "l.csv"
    limits.write_text("joint,effort\nelbow_joint,inf\n")
    flags = ("--payload", "5@base_link", "--limits", limits)
    said = " ".join(run("torques", "ur5", "--trajectory", motion_file, *flags)[1].split())
    assert "rests on the fixed base and loads no joint" in said
    assert said.count("no torque limit for 1 of 6 joints (elbow_joint)") == said.lower().count("no torque limit") == 1


def test_rounding_is_printed_as_no_torque_and_raises_no_alarm(run, ur5, tmp_path):
    t = np.arange(300) * 0.01
    q = np.tile([0.0, -1.0, 1.0, 0, 0, 0], (300, 1))
    path = write_positions(tmp_path / "m.csv", ur5, t, q + 1e-14 * np.random.default_rng(2).normal(size=q.shape))
    said = run("torques", "ur5", "--trajectory", path)[1]
    assert "Try --smooth" not in said
    assert re.search(r"shoulder_pan_joint .* –", said.split("made of")[1])


# ── logs as they are ──


def test_gaps_in_time_are_told(run, ur5, motion, tmp_path):
    _, *columns = motion
    t = np.arange(700) * 0.01
    t[400:] += 0.2
    _, text = run("torques", "ur5", "--trajectory", write_motion(tmp_path / "m.csv", ur5, t, columns))
    assert "Time jumps 1 time by more than 5 usual steps; the longest gap is 0.21 s, after t = 3.9900 s" in " ".join(
        text.split()
    )


def test_a_noisy_log_is_told_and_smoothed_by_itself(run, tmp_path):
    t = np.arange(1500) * 1e-3
    q = 0.5 * np.sin(np.outer(t, np.arange(1, 7))) - 0.5
    path = tmp_path / "m.csv"
    np.savetxt(
        path, np.column_stack([t, q]), "%.5f", ",", header="time," + ",".join(robots.ur5().joint_names), comments=""
    )
    _, text = run("torques", "ur5", "--trajectory", path)
    said = " ".join(text.split())
    assert "on a grid of 1e-05" in said
    assert "after smoothing to the noise found" in said
    assert "raw" in said
    _, text = run("torques", "ur5", "--trajectory", path, "--smooth")
    said = " ".join(text.split())
    assert "after smoothing to the noise found" in said
    assert "raw" not in said


def test_smoothing_tells_of_the_glitch_it_removes(run, ur5, tmp_path):
    t = np.arange(400) * 0.01
    q = 0.3 * np.sin(np.outer(t, np.arange(1, 7) * 0.5)) + 1e-3 * np.random.default_rng(3).normal(size=(400, 6))
    flags = ("torques", "ur5", "--trajectory", tmp_path / "m.csv", "--smooth")
    write_positions(tmp_path / "m.csv", ur5, t, q)
    assert "flattened" not in run(*flags)[1]
    q[160, 2] += 0.5
    write_positions(tmp_path / "m.csv", ur5, t, q)
    said = " ".join(run(*flags)[1].split())
    assert "flattened" in said
    at = re.search(r"elbow_joint at t = 1\.6000 s off by (\S+)", said)
    assert float(at[1]) == pytest.approx(0.5, rel=0.2)
    assert "UNSURE" in said


def test_units_in_doubt_are_asked_about(run, ur5, motion, tmp_path):
    t, q, *_ = motion
    turned = write_positions(tmp_path / "d.csv", ur5, t, 90 * q)
    code, text = run("torques", "ur5", "--trajectory", turned)
    first = " ".join(text.split("\n\n")[0].split())
    assert code == 1
    assert first.startswith("LOOK AGAIN: ")
    assert "Did you mean --degrees?" in first
    assert "Did you mean --degrees?" not in run("torques", "ur5", "--trajectory", turned, "--degrees")[1]
    slow = write_positions(tmp_path / "ms.csv", ur5, 1000 * t, q)
    assert "time seems to be in ms" in " ".join(run("torques", "ur5", "--trajectory", slow)[1].split("\n\n")[0].split())


def test_one_row_is_enough_where_rates_are_given(run, ur5, motion, tmp_path):
    t, *columns = motion
    path = write_motion(tmp_path / "m.csv", ur5, t[:1], [c[:1] for c in columns])
    code, text = run("torques", "ur5", "--trajectory", path, "--plot", tmp_path / "o.png")
    assert code in (0, 1), text
    assert "1 row " in text


def test_a_zero_quaternion_is_refused_by_line(run, tmp_path):
    box = robots.floating_box()
    q = np.tile(box.neutral, (10, 1))
    q[6, :4] = 0
    path = write_positions(tmp_path / "b.csv", box, np.arange(10) * 0.1, q)
    code, text = run("torques", "floating_box", "--trajectory", path)
    assert code == 2
    assert "line 8, column" in text
    assert "quaternion is zero" in text


def test_a_floating_base_is_held_up_against_gravity_and_its_acceleration(run, tmp_path):
    box = robots.floating_box()
    t = np.arange(500) * 0.01
    still = np.broadcast_to(box.neutral[:6], (500, 6))
    path, out = tmp_path / "box.csv", tmp_path / "out.csv"
    table = np.column_stack([t, still, 0.5 * np.sin(2 * t)])
    np.savetxt(path, table, "%.17g", ",", header="time," + ",".join(box.coordinate_names), comments="")
    code, text = run("torques", "floating_box", "--trajectory", path, "--csv", out)
    assert code == 1, text
    assert text.startswith(
        "UNSURE: nothing drives the base, but the motion needs 70.86 N there, 120 % of the robot's weight"
    )
    assert "IS A CONTACT MISSING?" in text and "--wrench-on-robot" in text
    assert " ".join(text.split()).lower().count("nothing drives") == 2  # the reason, and its meaning
    force = np.loadtxt(out, delimiter=",", skiprows=1)[:, 1:]
    np.testing.assert_allclose(force[5:-5, 5], 6.0 * (9.81 - 2.0 * np.sin(2 * t[5:-5])), rtol=1e-5)
    np.testing.assert_allclose(force[:, :5], 0, atol=1e-7)


@pytest.mark.parametrize(("up", "code"), [(1.0, 0), (0.96, 0), (0.94, 1), (1.04, 0), (1.06, 1)])
def test_a_base_at_rest_whose_weight_contacts_take_is_fine(run, tmp_path, up, code):
    box = robots.floating_box()
    path = write_positions(tmp_path / "box.csv", box, np.arange(50) * 0.01, np.tile(box.neutral, (50, 1)))
    push = f"{box.tip}:0,0,0,0,0,{up * 6.0 * 9.81}"
    found, text = run("torques", "floating_box", "--trajectory", path, "--wrench-on-robot", push)
    assert found == code and ("IS A CONTACT MISSING?" in text) == bool(code), text


@pytest.mark.parametrize(("share", "code", "said"), [(0.996, 0, "99.6 %"), (1.0, 0, "100 %"), (1.003, 1, "100.3 %")])
@pytest.mark.parametrize("width", ["60", "140"])
def test_what_is_nearly_at_a_limit_or_just_beyond_is_not_said_to_be_at_it(
    run, tmp_path, monkeypatch, share, code, said, width
):
    """100 % beside an OK, or beside an OVER LIMIT, is the limit itself."""
    monkeypatch.setenv("COLUMNS", width)
    arm = robots.planar_2r()
    path = write_positions(tmp_path / "still.csv", arm, np.arange(50) * 0.01, np.zeros((50, 2)))
    limit = np.abs(arm.gravity_forces(np.zeros(2)))[0] / share
    limits = tmp_path / "limits.csv"
    limits.write_text(f"joint,effort\n{arm.joint_names[0]},{float(limit)!r}\n{arm.joint_names[1]},900\n")
    found, text = run("torques", "planar_2r", "--trajectory", path, "--limits", limits)
    assert found == code, text
    shown = re.findall(r"[\d.]+ %", re.sub(r"gravity[\s,]+\d+ %", "", text))
    assert {said} <= {*shown} and (said == "100 %" or "100 %" not in shown), text


@pytest.mark.parametrize(("acceleration", "code"), [(0.0, 0), (0.1, 1)])
def test_what_drifts_without_gravity_needs_no_contact(run, tmp_path, acceleration, code):
    """A body that goes straight on needs no force. A log of six decimals says so to rounding; a push it does tell."""
    box = robots.floating_box()
    file = tmp_path / "box.xml"
    file.write_text(box.with_gravity((0, 0, 0)).to_mjcf())
    t = np.arange(300) * 0.01
    q = np.tile(box.neutral, (300, 1))
    q[:, 4], q[:, 5] = 0.1 * t + 0.5 * acceleration * t**2, 0.1 - 0.03 * t
    path = tmp_path / "drift.csv"
    header = "time," + ",".join(box.coordinate_names)
    np.savetxt(path, np.column_stack([t, q]), "%.6f", ",", header=header, comments="")
    found, text = run("torques", file, "--trajectory", path)
    assert found == code and ("IS A CONTACT MISSING?" in text) == bool(code), text


@pytest.mark.parametrize(("noise", "needed"), [(0.0, True), (0.5, True), (3.0, False)])
def test_noise_of_a_base_is_no_missing_contact(noise, needed):
    """Of a force of 6 N beside a weight of 59 N five standard deviations are left out."""
    box = robots.floating_box()
    units = ["N m"] * 3 + ["N"] * 3
    for k, sign in [(3, 1), (5, -1)]:
        peaks = [6.0 * sign * (i == k) for i in range(6)]
        joints = [JointTorque(f"j{i}", units[i], peaks[i], 0.0, 0.0, np.inf, {}, noise) for i in range(6)]
        assert missing_force(box.model, joints) == pytest.approx(6.0 - 5.0 * noise if needed else 0.0)
    turned = [JointTorque(f"j{i}", units[i], 600.0 * (i < 3), 0.0, 0.0, np.inf, {}, noise) for i in range(6)]
    assert missing_force(box.model, turned) == 0.0


def test_the_force_of_a_loop_moves_the_torques_between_its_ends_alone():
    """A shoulder carries the linkage, and feels its weight; its loop's force is within it."""
    links = "".join(f'<link name="{name}"/>' for name in ("base", "arm", "crank", "coupler", "rocker"))
    joints = "".join(
        f'<joint name="to_{child}" type="continuous"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/></joint>'
        for parent, child in (("base", "arm"), ("arm", "crank"), ("crank", "coupler"), ("arm", "rocker"))
    )
    loop = """<constraint name="loop" type="revolute"><parent link="coupler"/><parent_origin xyz="0.4 0 0"/>
    <parent_axis xyz="0 1 0"/><child link="rocker"/><child_origin xyz="0 0 0.3"/></constraint>"""
    with pytest.warns(ModelWarning):
        robot = load(f'<robot name="gripper">{links}{joints}{loop}</robot>')
    assert open_loop_joints(robot.model) == ["to_crank", "to_coupler", "to_rocker"]


def test_a_base_that_slides_and_is_driven_needs_no_contact(run, tmp_path):
    cart = robots.cart_pole()
    t = np.arange(200) * 0.01
    q = np.column_stack([0.5 * np.sin(4 * t), np.zeros(200)])
    path = write_positions(tmp_path / "cart.csv", cart, t, q)
    assert "IS A CONTACT MISSING?" not in run("torques", "cart_pole", "--trajectory", path)[1]


# ── friction ──


def still_file(tmp_path, robot, rows=200):
    q = np.tile([0.3, -0.3, 0.7], 4)[: robot.nq] * np.ones((rows, 1))
    return write_positions(tmp_path / "still.csv", robot, np.arange(rows) * 0.01, q)


@pytest.fixture
def rubbing(tmp_path):
    """A planar arm in the plane of gravity, with friction in every joint."""
    text = robots.path_of("planar_2r").read_text()
    text = re.sub(r"<dynamics[^>]*/>", "", text)
    path = tmp_path / "rubbing.urdf"
    path.write_text(re.sub(r"</joint>", '<dynamics friction="1" damping="1"/></joint>', text))
    return path


def test_a_joint_at_rest_has_no_coulomb_friction(run, rubbing, tmp_path):
    robot, out = load(rubbing), tmp_path / "o.csv"
    assert robot.model.friction.coulomb.all()
    code, text = run("torques", rubbing, "--trajectory", still_file(tmp_path, robot), "--csv", out)
    assert (code, "UNSURE: no torque limit for 2 of 2 joints" in text) == (1, True), text
    assert "Coulomb friction is undetermined" in text
    found = np.loadtxt(out, delimiter=",", skiprows=1)[:, 1:3]
    held = np.broadcast_to(robot.gravity_forces(np.array([0.3, -0.3])), found.shape)
    np.testing.assert_allclose(found, held, atol=1e-7)


def test_a_joint_that_moves_has_coulomb_friction(run, rubbing, tmp_path):
    robot, out = load(rubbing), tmp_path / "o.csv"
    t = np.arange(200) * 0.01
    path = write_positions(tmp_path / "m.csv", robot, t, np.outer(t, [0.1, -0.2]))
    run("torques", rubbing, "--trajectory", path, "--csv", out)
    lines = out.read_text().splitlines()[0].split(",")
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    for joint, v in zip(robot.joint_names, (0.1, -0.2), strict=True):
        np.testing.assert_allclose(table[:, lines.index(f"{joint}.friction")], v + np.sign(v), atol=1e-9)


def test_logs_of_motors_are_not_read_as_those_of_joints(run, ur5, motion, tmp_path):
    t, q, *_ = motion
    path = write_positions(tmp_path / "m.csv", ur5, t, q)
    file = tmp_path / "drives.yaml"
    file.write_text("robot: ur5\nactuators:\n  elbow_joint: {ratio: 100}\nlog: {side: motor}\n")
    code, text = run("torques", "ur5", "--trajectory", path, "--actuators", file)
    assert code == 2
    assert "drives.yaml, logs have the motors' positions" in " ".join(text.split())
    file.write_text("robot: ur5\nactuators:\n  elbow_joint: {ratio: 100}\n")
    assert run("torques", "ur5", "--trajectory", path, "--actuators", file)[0] in (0, 1)


@pytest.mark.parametrize("mass", [2.0, 11.0])
def test_how_heavy_the_payload_may_be_is_what_passes_and_a_little_more_fails(run, tmp_path, mass):
    """An independent check of the mass named: the command itself, with that mass and with a thousandth more."""
    place = ",0.05,0,0.08@tool0"
    code, said = run("torques", "ur5", "--trajectory", DEMO, "--payload", f"{mass}{place}")
    found = re.search(
        r"Maximum payload on this path: ([\d.]+) kg at tool0 \(limit of (\w+) at t = ([\d.]+) s\)\.",
        " ".join(said.split()),
    )
    assert found, said
    most = float(found[1])
    assert (code == 0) == (mass <= most)
    code, said = run("torques", "ur5", "--trajectory", DEMO, "--payload", f"{most}{place}")
    assert code == 0, said
    code, said = run("torques", "ur5", "--trajectory", DEMO, "--payload", f"{1.001 * most}{place}")
    assert code == 1
    assert re.match(rf"OVER LIMIT: {found[2]} needs \S+ N m at t = {found[3]} s, ", said)


def test_how_heavy_it_may_be_is_not_said_where_it_is_not_known(run, tmp_path):
    """Two payloads, no limits, and a robot that is too weak for itself."""
    (tmp_path / "weak.csv").write_text("joint,effort\nshoulder_lift_joint,10\n")
    for given in (
        ["ur5", "--trajectory", DEMO, "--payload", "1", "--payload", "2"],
        ["ur5", "--trajectory", DEMO],
        ["ur5", "--trajectory", DEMO, "--payload", "1", "--limits", tmp_path / "weak.csv"],
    ):
        _, said = run("torques", *given)
        assert "Maximum payload" not in " ".join(said.split())
