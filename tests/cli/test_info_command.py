"""The commands info and verify, and the program itself: names, notes, and what it loads."""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from printed_blocks import printed
from rich.console import Console

import twistwrench as tw
from twistwrench import NotFoundError, robots
from twistwrench.motion.limits_file import read_limits
from twistwrench.reports.info_view import info_view
from twistwrench.robots.known_robots import name_columns

pytest_plugins = ("torque_fixtures",)


def test_info_tells_what_a_robot_is_made_of(run, ur5):
    code, text = run("info", "ur5", "--degrees")
    assert code == 0
    for name in (*ur5.joint_names, *ur5.frame_names):
        assert name in text
    moving = sum(b.inertia.mass for b in ur5.model.bodies)
    assert f"mass {moving:.4g} kg moving" in text
    assert "360" in text


def test_info_tells_the_sites_and_the_configurations_of_a_file(run, tmp_path):
    """All frames that may be named, and all names that --at takes."""
    text = """<mujoco><worldbody><body name="rod"><joint name="hinge" axis="0 1 0"/><geom size="0.1" mass="1" pos="1 0 0"/>
      <site name="foot" pos="1 0 0"/></body></worldbody><keyframe><key name="up" qpos="0.5"/></keyframe></mujoco>"""
    (tmp_path / "r.xml").write_text(text)
    code, said = run("info", tmp_path / "r.xml")
    assert code == 0, said
    assert "3 frames" in said
    assert "hinge (revolute) → rod  + foot" in said
    assert "configurations qpos0, up" in said
    code, said = run("info", tmp_path / "r.xml", "--json", "-")
    found = json.loads(said)
    assert (found["frames"], found["sites"]) == (["world", "rod"], ["foot"])
    assert found["configurations"] == {"qpos0": [0.0], "up": [0.5]}


@pytest.mark.parametrize("flags, offset", [([], "+0.2"), (["--degrees"], "+11.46")])
def test_info_tells_whom_a_joint_follows_and_no_limits_of_its_own(run, tmp_path, flags, offset):
    text = robots.path_of("planar_2r").read_text()
    mimic = '<mimic joint="joint1" multiplier="-2" offset="0.2"/>'
    head, tail = text.split('<joint name="joint2"', 1)
    path = tmp_path / "follower.urdf"
    path.write_text(head + '<joint name="joint2"' + tail.replace("</joint>", mimic + "</joint>", 1))
    code, said = run("info", path, *flags)
    assert code == 0, said
    lines = said.splitlines()
    k = next(k for k, line in enumerate(lines) if line.split()[:1] == ["joint2"])
    assert lines[k].split()[1] == "continuous,"
    assert f"follows -2 × joint1 {offset}" in lines[k + 1]
    assert len(lines[k].split()) == 3  # name, kind, link


def test_the_tree_of_a_long_chain_stays_in_the_terminal(run, tmp_path):
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = [f'<link name="link{k}">{inertial}</link>' for k in range(61)]
    joints = [
        f'<joint name="joint{k}" type="continuous"><parent link="link{k}"/><child link="link{k + 1}"/></joint>'
        for k in range(60)
    ]
    path = tmp_path / "chain.urdf"
    path.write_text(f'<robot name="chain">{"".join(links + joints)}</robot>')
    code, said = run("info", path, "--all")
    assert code == 0, said
    for k in range(60):
        assert f"── joint{k} (continuous) → link{k + 1}\n" in said
    assert said.count("carries on:") == 4 and "── link48 carries on:" in said


def test_info_names_a_defect_once(run, tmp_path):
    text = robots.path_of("planar_2r").read_text()
    path = tmp_path / "odd.urdf"
    path.write_text(re.sub(r'ixx="[^"]*"', 'ixx="99"', text, count=1))
    said = run("info", path, "--inertia", "accept")[1]
    assert said.count("triangle inequality") == 1


def test_names_are_not_taken_for_markup(run, tmp_path):
    text = robots.path_of("planar_2r").read_text().replace("joint1", "[red]1").replace("joint2", "[/]2")
    path = tmp_path / "odd.urdf"
    path.write_text(text)
    motion = tmp_path / "m.csv"
    motion.write_text("time,[red]1,[/]2,[red]1.vel,[/]2.vel,[red]1.acc,[/]2.acc\n0,0,0,0,0,0,0\n")
    limits = tmp_path / "l.csv"
    limits.write_text("joint,lower\n[/]2,0.5\n")
    for arguments in (("info", path), ("torques", path, "--trajectory", motion, "--limits", limits)):
        code, text = run(*arguments)
        assert code == (0 if arguments[0] == "info" else 1)
        assert "[red]1" in text
        assert "[/]2" in text


def test_a_lock_outside_the_limits_is_refused(run):
    for flags in (["elbow_joint=9"], ["elbow_joint=200", "--degrees"]):
        code, text = run("info", "ur5", "--lock", *flags)
        assert (code, "outside the joint's limits" in text) == (2, True), text
    assert run("info", "ur5", "--lock", "elbow_joint=1")[0] == 0


def test_a_robot_without_joints_has_nothing_to_verify(run):
    lock = [x for k in ("joint1", "joint2") for x in ("--lock", f"{k}=0")]
    code, text = run("verify", "planar_2r", *lock)
    assert code == 2
    assert "nothing to check" in text


def test_the_module_runs_as_a_program():
    done = subprocess.run([sys.executable, "-m", "twistwrench", "--help"], capture_output=True, text=True, check=True)
    for command in ("torques", "info", "verify"):
        assert command in done.stdout


def test_help_imports_nothing_heavy():
    code = "import sys, twistwrench.cli.main; print([m for m in ('scipy', 'llvmlite', 'rich', 'matplotlib') if m in sys.modules])"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )


# ── for programs, and in narrow places ──


LONG = "a_joint_whose_name_is_longer_than_any_column_of_a_table_should_ever_have_to_be_made_for_it"


@pytest.fixture
def long_names(tmp_path):
    text = robots.path_of("ur5").read_text().replace('"elbow_joint"', f'"{LONG}"')
    path = tmp_path / "long.urdf"
    path.write_text(text)
    return path


@pytest.mark.parametrize("width", [80, 100, 110, 200])
def test_names_fold_and_no_number_is_cut(long_names, width, ur5):
    """Whatever the width, every number of the table of joints is there in full."""
    console = Console(width=width, file=io.StringIO(), highlight=False)
    console.print(printed(info_view(tw.load(long_names)), console.width))
    said = console.file.getvalue()
    assert "…" not in said
    joints = said[said.index("Joints") : said.index("Links with mass")]
    numbers = [re.findall(r"(?<!\S)-?\d+(?:\.\d+)?(?!\S)", line) for line in joints.splitlines()]
    expected = [
        [f"{x:.4g}" for x in row]
        for row in zip(ur5.limits.lower, ur5.limits.upper, ur5.limits.velocity, ur5.limits.effort, strict=True)
    ]
    assert [row for row in numbers if row] == expected


def test_info_as_json_and_csv_has_the_numbers_of_the_robot(run, ur5):
    summary = json.loads(run("info", "ur5", "--json", "-")[1])
    rows = list(csv.DictReader(io.StringIO(run("info", "ur5", "--csv", "-")[1])))
    assert [j["joint"] for j in summary["joints"]] == [r["joint"] for r in rows] == list(ur5.joint_names)
    for side in ("lower", "upper", "velocity", "effort"):
        limits = getattr(ur5.limits, side).tolist()
        assert [j[side] for j in summary["joints"]] == limits
        assert [float(r[side]) for r in rows] == limits
    assert summary["moving_mass"] == pytest.approx(sum(b.inertia.mass for b in ur5.model.bodies), rel=1e-15)
    assert {link["link"] for link in summary["links"]} >= {"upper_arm_link", "wrist_3_link"}
    assert summary["tip"] == "tool0"


def test_limits_of_acceleration_and_jerk_come_back_from_the_table_of_info(run, tmp_path):
    text = robots.path_of("planar_2r").read_text().replace("</joint>", '<limit acceleration="6" jerk="90"/></joint>', 1)
    (tmp_path / "arm.urdf").write_text(text)
    assert re.search(r"acceleration\s+deceleration\s+jerk", run("info", tmp_path / "arm.urdf")[1])
    assert "deceleration" not in run("info", "planar_2r")[1]
    code, _ = run("info", tmp_path / "arm.urdf", "--csv", tmp_path / "limits.csv")
    found = read_limits(tmp_path / "limits.csv", robots.planar_2r().model)
    assert code == 0
    for kind, expected in (("acceleration", 6), ("deceleration", 6), ("jerk", 90)):
        assert getattr(found, kind).tolist() == [expected, float("inf")]


def test_damping_and_friction_are_told_apart(run, tmp_path):
    text = robots.path_of("planar_2r").read_text()
    path = tmp_path / "rough.urdf"
    path.write_text(text.replace("</joint>", '<dynamics damping="1.5" friction="0.25"/></joint>', 1))
    model = tw.load(path).model
    [first, second] = json.loads(run("info", path, "--json", "-")[1])["joints"]
    assert (
        (first["damping"], first["friction"]) == (1.5, 0.25) == (model.friction.viscous[0], model.friction.coulomb[0])
    )
    assert second["damping"] == second["friction"] == 0.0


def test_a_mimic_joint_is_independent_where_it_is_asked_for(run, tmp_path):
    text = robots.path_of("planar_2r").read_text()
    path = tmp_path / "follower.urdf"
    path.write_text(
        re.sub(r'(<joint name="joint2".*?)</joint>', r'\1<mimic joint="joint1"/></joint>', text, flags=re.DOTALL)
    )
    for flags, nv in (([], 1), (["--mimic", "follow"], 1), (["--mimic", "independent"], 2)):
        assert json.loads(run("info", path, "--json", "-", *flags)[1])["nv"] == nv


@pytest.mark.parametrize("flags, ratio", [([], "0.5"), (["--degrees"], "0.008727")])
def test_a_slider_that_follows_an_angle_does_so_by_its_unit(run, tmp_path, flags, ratio):
    """Half a metre for each radian is 8.7 mm for each degree, and 0.2 m stay 0.2 m."""
    text = robots.path_of("planar_2r").read_text()
    head, tail = text.split('<joint name="joint2" type="continuous"', 1)
    mimic = '<mimic joint="joint1" multiplier="0.5" offset="0.2"/>'
    limit = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    path = tmp_path / "rack.urdf"
    path.write_text(
        f'{head}<joint name="joint2" type="prismatic"' + tail.replace("</joint>", f"{limit}{mimic}</joint>", 1)
    )
    code, said = run("info", path, *flags)
    assert code == 0, said
    assert f"follows {ratio} × joint1 +0.2" in " ".join(said.split())


def test_json_has_null_where_nothing_is_known(run):
    [first, _] = json.loads(run("info", "planar_2r", "--json", "-")[1])["joints"]
    assert first["lower"] is first["effort"] is None


def test_info_prints_one_file_at_a_time(run):
    code, text = run("info", "ur5", "--json", "-", "--csv", "-")
    assert (code, "Choose one" in text) == (2, True)


def test_files_of_info_are_in_radians_though_the_report_is_in_degrees(run):
    assert run("info", "ur5", "--csv", "-", "--degrees") == run("info", "ur5", "--csv", "-")


def test_robots_lists_what_is_bundled(run):
    code, said = run("robots")
    assert code == 0
    for name in robots.names():
        assert name in said
    assert "pendulum" not in run("robots", "quad")[1]
    assert run("robots", "nothing_like_it")[0] == 2


@pytest.mark.parametrize("word", ["", "panda", "quad", "planar", "ur"])
def test_robots_prints_what_its_function_returns(run, monkeypatch, word):
    monkeypatch.setenv("COLUMNS", "80")
    known, words = tw.robots.known(word), [word] if word else []
    code, text = run("robots", *words)
    assert code == known.verdict.exit_code == 0
    shown, returned = (
        [line.rstrip() for line in each.splitlines() if line.strip() and not line.startswith("Files, and")]
        for each in (text, str(known))
    )
    assert shown == returned and len(text.splitlines()) <= 45
    whole = run("robots", *words, "--all")[1].replace(",", " ").split()
    assert {*known.bundled, *(found.name for found in known.others)} <= {*whole}


def test_names_of_robots_stand_in_columns_that_fit():
    names = [f"arm_{'x' * (k % 5)}{k}" for k in range(30)]
    for width in (12, 40, 80):
        rows = name_columns(" ".join(names), width)
        assert sorted(" ".join(rows).split()) == sorted(names)
        assert max(map(len, rows)) <= width
        assert all(found.start() % 13 == 0 for row in rows for found in re.finditer(r"\S+", row))
    assert len(name_columns(" ".join(names), 80)) < len(name_columns(" ".join(names), 40))


def test_a_name_in_another_case_is_the_same(run):
    assert run("info", "Panda") == run("info", "panda")
    assert "Did you mean 'panda'" in run("info", "pandaa")[1]
    with pytest.raises(NotFoundError, match=r"twistwrench\.robots\.panda\(\)"):
        tw.load(Path("panda"))  # a path is a file
    assert tw.load("Panda").name == "panda"
