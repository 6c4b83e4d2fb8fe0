"""A first word depends on the question, not on how it is written: rates, noise, formats, files, tables, options, headers."""

from __future__ import annotations

import importlib
import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from places import ROOT, SHARED
from quick import mostly_slow
from ros_logs import write_mcap
from scipy.interpolate import CubicSpline

import twistwrench as tw
from twistwrench.motion.load_case import without_velocity_limit

pytest_plugins = ("torque_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")

SLOW = pytest.mark.slow
"""Of the long form, for `make test-all`."""


def slow(*values):
    return [pytest.param(value, marks=SLOW) for value in values]


ARM = """<robot name="arm"><link name="base"/>
{links}
</robot>"""
PART = """<link name="link{k}"><inertial><origin xyz="0.15 0 {z}"/><mass value="{mass}"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/><origin xyz="{x} 0 0.1"/>
  <axis xyz="{axis}"/>{limit}{dynamics}</joint>"""
AXES = ("0 0 1", "0 1 0", "0 1 0")
EFFORTS = np.array([20.0, 24.0, 6.0])
"""Peak torques [N m] of which the arm's own weight takes up to 61 %, as in real arms."""
JOINTS = ("joint1", "joint2", "joint3")


def arm(
    efforts=EFFORTS, velocities=(3.0, 3.0, 4.0), stops=((-3.1, 3.1),) * 3, *, friction=False, masses=(6.0, 4.0, 2.0)
) -> str:
    """URDF of an arm of three joints; a limit that is None is left out."""
    parts = []
    for k, axis in enumerate(AXES):
        given = {"lower": stops[k][0], "upper": stops[k][1], "velocity": velocities[k], "effort": efforts[k]}
        told = " ".join(f'{name}="{value:.12g}"' for name, value in given.items() if value is not None)
        dynamics = '<dynamics friction="1.5" damping="0.8"/>' if friction else ""
        parent = f"link{k}" if k else "base"
        parts.append(
            PART.format(
                k=k + 1,
                z=0.02 * k,
                mass=masses[k],
                parent=parent,
                x=0.3 * (k > 0),
                axis=axis,
                limit=f"<limit {told}/>",
                dynamics=dynamics,
            )
        )
    return ARM.format(links="\n".join(parts))


@dataclass(frozen=True)
class Swing:
    """A motion: sines of each joint about a pose, at a common speed."""

    speed: float
    size: float = 0.5

    def __call__(self, t):
        w = self.speed * np.array([1.0, 0.8, 1.3])
        centre = np.array([0.2, 0.4, 0.5])
        a = self.size * np.array([1.0, 0.7, 0.9])
        angle = np.outer(t, w) + np.array([0.3, 1.1, 0.2])
        return centre + a * np.sin(angle), a * w * np.cos(angle), -a * w**2 * np.sin(angle)


FINE, OVER = Swing(1.5), Swing(7.0)
"""Motions that take 61 % of a torque, and more than 260 % of one and 116 % of a velocity."""


@pytest.fixture
def ask(run, tmp_path):
    """The first word of ``torques`` on a robot and a file, its line, and the report's peaks with their deviations."""

    def ask(robot, log, *options):
        path = robot
        if isinstance(robot, str):
            path = tmp_path / f"robot{len(list(tmp_path.iterdir()))}.urdf"
            path.write_text(robot, "utf-8")
        found = tmp_path / "said.json"
        code, text = run("torques", path, "--trajectory", log, "--json", found, "--overwrite", *options)
        if code == 2:
            return "refused", text, {}
        line = " ".join(text.split("\n\n")[0].split())
        line = re.sub(r"^(note: .*?\. )+(?=OK|UNSURE|LOOK|OVER)", "", line)
        word = re.match(r"OK|UNSURE|OVER LIMIT|LOOK AGAIN", line)
        assert word, line
        table = json.loads(found.read_text("utf-8"))["tables"][0]
        names = [column["name"] for column in table["columns"]]
        peaks = {row[0]: dict(zip(names, row, strict=True)) for row in table["rows"]}
        return word.group(), line, peaks

    return ask


def write_log(path: Path, t, q, dq=None, ddq=None, *, digits="%.12g", names=JOINTS, time="time", separator=","):
    """A table of a motion; rates where they are given."""
    blocks, header = [t, q], [time, *names]
    for kind, values in (("vel", dq), ("acc", ddq)):
        if values is not None:
            blocks.append(values)
            header += [f"{name}.{kind}" for name in names]
    np.savetxt(path, np.column_stack(blocks), digits, separator, header=separator.join(header), comments="")
    return path


# ── 1. One motion, written in many ways


def writings(tmp_path: Path, motion: Swing, *, seed: int) -> dict[str, Path]:
    """Files of one motion at 200 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 4, 1 / 200)
    q, dq, ddq = motion(t)
    spline = CubicSpline(t, q)
    found = {
        "exact rates": write_log(tmp_path / "exact.csv", t, q, dq, ddq),
        "exact velocities": write_log(tmp_path / "velocities.csv", t, q, dq),
        "positions": write_log(tmp_path / "positions.csv", t, q),
        "spline": write_log(tmp_path / "spline.csv", t, q, spline(t, 1), spline(t, 2)),
        "half the rate": write_log(tmp_path / "half.csv", t[::2], q[::2]),
        "tabs": write_log(tmp_path / "tabs.txt", t, q, separator="\t"),
        "since 1970": write_log(tmp_path / "date.csv", t + 1.7e9, q, digits="%.17g"),
        "degrees": write_log(tmp_path / "deg.csv", t, np.degrees(q), names=[f"{n} [deg]" for n in JOINTS]),
        "milliseconds": write_log(tmp_path / "ms.csv", 1e3 * t, q, time="time [ms]"),
    }
    for noise in (1e-6, 1e-5, 1e-4):
        noisy = q + noise * rng.normal(size=q.shape)
        found[f"noise of {noise:g} rad"] = write_log(tmp_path / f"noise{noise:g}.csv", t, noisy)
    np.savez(tmp_path / "log.npz", time=t, **dict(zip(JOINTS, q.T, strict=True)))
    found["npz"] = tmp_path / "log.npz"
    return found


@pytest.mark.parametrize(("motion", "word"), [(FINE, "OK"), pytest.param(OVER, "OVER LIMIT", marks=SLOW)])
def test_one_motion_has_one_word_however_it_is_written(ask, tmp_path, motion, word):
    """Peaks lie within the interval said, and within half a per cent of rounding and differentiation."""
    peaks = {}
    for name, path in writings(tmp_path, motion, seed=1).items():
        found, line, joints = ask(arm(), path)
        assert found == word, (name, line)
        peaks[name] = joints
    exact = peaks["exact rates"]
    for name, joints in peaks.items():
        for joint, row in joints.items():
            sigma = row.get("± 1σ") or 0.0
            true = abs(exact[joint]["peak"])  # the motion swings to both sides: the sign of the peak is a draw
            assert abs(abs(row["peak"]) - true) <= 4 * sigma + 5e-3 * true, (name, joint, row, true)


def test_a_recording_has_the_word_of_its_table(ask, tmp_path):
    pytest.importorskip("mcap_ros2")
    t = np.arange(0, 3, 0.01)
    q = FINE(t)[0]
    tau = tw.load(arm()).inverse_dynamics(*FINE(t))
    write_mcap(tmp_path / "log.mcap", JOINTS, t, q, tau)
    table = write_log(tmp_path / "log.csv", t, q)
    assert ask(arm(), tmp_path / "log.mcap")[0] == ask(arm(), table)[0] == "OK"


def test_a_slow_log_has_the_times_and_positions_of_a_fast_one():
    """At 0.1 rad/s the width assumed for friction's step matters; another scale of the rates must not stand for another width."""
    robot, rng, t = tw.load(arm(friction=True)), np.random.default_rng(2), np.arange(0, 24, 0.02)
    q, dq, ddq = Swing(0.18)(t)
    tau = robot.inverse_dynamics(q, dq, ddq, friction=True)
    tau += np.maximum(0.01 * tau.std(axis=0), 0.002 * EFFORTS) * rng.normal(size=tau.shape)
    log = tw.Motion(t, q + 2e-5 * rng.normal(size=q.shape), tau=tau, robot=robot)
    found = {doubt.kind for doubt in tw.identification.measured_causes(robot, log)}
    assert not {"time-scale", "position-scale"} & found


# ── 2. One number, by file, table, option and header


def table_of(path: Path, **columns) -> Path:
    rows = zip(JOINTS, *columns.values(), strict=True)
    lines = [",".join(["joint", *columns]), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


@pytest.mark.parametrize("times", [0.5, 1.0, *slow(0.1, 3.0)])
def test_a_torque_limit_has_one_word_by_file_and_by_table(ask, tmp_path, times):
    """A file without efforts and a table of them are the file with them."""
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *FINE(t))
    table = table_of(tmp_path / "limits.csv", effort=times * EFFORTS)
    by_file = ask(arm(times * EFFORTS), log)
    by_table = ask(arm([None] * 3), log, "--limits", table)
    assert by_file[0] == by_table[0], (by_file[1], by_table[1])


@pytest.mark.parametrize("velocity", [0.2, 3.0, *slow(1.0, 6.0)])
def test_a_velocity_limit_has_one_word_by_file_and_by_table(ask, tmp_path, velocity):
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *FINE(t))
    by_file = ask(arm(velocities=[velocity] * 3), log)
    by_table = ask(arm(), log, "--limits", table_of(tmp_path / "limits.csv", velocity=[velocity] * 3))
    assert by_file[0] == by_table[0], (by_file[1], by_table[1])


# Every door to one limit: the robot's file, a table beside a file without it, and a table beside the file with it.


def with_limits(text: str, changed: dict[str, float | None]) -> str:
    """A URDF with the limits of some kinds times a factor, or without them for None."""
    for kind, factor in changed.items():
        value = "" if factor is None else r' {}="{:.12g}"'
        pattern = re.compile(rf'(<limit\b[^>]*?)\s{kind}="([^"]*)"')
        text = pattern.sub(lambda m: m[1] + value.format(kind, (factor or 1.0) * float(m[2])), text)  # noqa: B023
    return text


def limits_table(path: Path, robot: tw.Robot, kinds) -> Path:
    """Table of the limits of some kinds that a robot has."""
    rows = zip(robot.joint_names, *(getattr(robot.limits, kind) for kind in kinds), strict=True)
    lines = [",".join(["joint", *kinds]), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def camera_head() -> str:
    """URDF of a head that pans and tilts, of which the tilt bears little weight."""
    one = re.sub(r"<link name=\"link3\".*?</joint>", "", arm(efforts=(2.0, 4.0, 1.0)), flags=re.DOTALL)
    return one.replace('xyz="0.15 0 0', 'xyz="0.03 0 0')


def bundled(name: str) -> str:
    return tw.robots.path_of(name).read_text("utf-8")


def shared(name: str) -> str:
    file = SHARED / "robots" / name
    if not file.exists():
        pytest.skip("the shared robots are not here")
    return re.sub(r"<(visual|collision)>.*?</\1>", "", file.read_text("utf-8"), flags=re.DOTALL)


LIMITED = {
    "arm": arm,
    "camera head": camera_head,
    "ur5": lambda: bundled("ur5"),
    "panda": lambda: bundled("panda"),
    "tx40": lambda: shared("staubli_tx40.urdf"),
    "gen3 lite": lambda: shared("kinova_gen3_lite.urdf"),
}
"""Robots with limits of all kinds."""
CHANGES = {
    "a hundredth": {"effort": 0.01},
    "N m as kgf m": {"effort": 1 / 9.81},
    "a fifth": {"effort": 0.2},
    "five times": {"effort": 5.0},
    "a gear of eight": {"effort": 8.0},
    "kgf cm": {"effort": 10.2},
    "N cm": {"effort": 100.0},
    "N mm": {"effort": 1000.0},
    "degrees": {"lower": 57.3, "upper": 57.3, "velocity": 57.3},
    "positions in degrees": {"lower": 57.295779513, "upper": 57.295779513},
    "slow": {"velocity": 0.3},  # a log faster than 3 times the limit of its file is doubted instead, and not by a table
    "no velocity": {"velocity": 1e6},
}
DOORS = [(robot, change) for robot in LIMITED for change in CHANGES]
SHORT_FORM = [("arm", "five times"), ("arm", "degrees"), ("camera head", "N cm"), ("ur5", "a gear of eight")]


@pytest.mark.parametrize(
    ("name", "change"), [*SHORT_FORM, *(pytest.param(*door, marks=SLOW) for door in DOORS if door not in SHORT_FORM)]
)
def test_a_limit_has_one_word_through_every_door(ask, tmp_path, name, change):
    """The file that has the number; the file without it, or with it, and a table of it."""
    text, kinds = LIMITED[name](), CHANGES[change]
    scaled, without = (with_limits(text, made) for made in (kinds, dict.fromkeys(kinds)))
    robot = tw.load(scaled)
    table = limits_table(tmp_path / "limits.csv", robot, kinds)
    log = swinging_log(tmp_path / "log.csv", tw.load(text))
    said = {
        "file": ask(scaled, log),
        "table beside a file without": ask(without, log, "--limits", table),
        "table beside the file": ask(scaled, log, "--limits", table),
    }
    assert len({word for word, *_ in said.values()}) == 1, {door: line for door, (_, line, _) in said.items()}


def swinging_log(path: Path, robot: tw.Robot) -> Path:
    """A slow motion of all joints about the middle of their ranges."""
    t, lower, upper = np.arange(0, 4, 0.01), robot.limits.lower, robot.limits.upper
    ends = np.stack([np.maximum(lower, -1.0), np.minimum(upper, 1.0)])
    middle = np.clip(0.0, ends.min(axis=0), ends.max(axis=0)) + 0.25 * (lower > 0.0) - 0.25 * (upper < 0.0)
    size = np.minimum(0.3, 0.4 * (upper - lower))
    q = middle + size * np.sin(np.outer(t, np.linspace(0.6, 1.4, robot.nv)) + np.arange(robot.nv))
    return write_log(path, t, np.clip(q, lower + 0.01, upper - 0.01), names=robot.joint_names)


@pytest.mark.parametrize("change", ["N cm", *slow("kgf cm", "N m as kgf m", "N mm")])
@pytest.mark.parametrize("name", ["ur5", *slow("arm", "camera head", "panda", "tx40", "gen3 lite")])
def test_efforts_that_are_a_multiple_of_the_files_are_not_ok(ask, tmp_path, name, change):
    """A table that can be compared with its file; a unit in its header confirms it."""
    text = LIMITED[name]()
    table = limits_table(tmp_path / "limits.csv", tw.load(with_limits(text, CHANGES[change])), ["effort"])
    log = swinging_log(tmp_path / "log.csv", tw.load(text))
    word, line, _ = ask(text, log, "--limits", table)
    assert word == "UNSURE", line
    table.write_text(table.read_text("utf-8").replace("effort", "effort [N m]"), "utf-8")
    assert ask(text, log, "--limits", table)[0] in ("OK", "OVER LIMIT")


@pytest.mark.parametrize("command", ["payload", *slow("move", "doctor")])
@pytest.mark.parametrize("change", ["five times", "degrees", *slow("a hundredth", "N mm", "no velocity")])
def test_commands_have_one_word_for_a_limit_through_every_door(run, tmp_path, command, change):
    text, kinds = arm(), CHANGES[change]
    scaled, without = (with_limits(text, made) for made in (kinds, dict.fromkeys(kinds)))
    table = limits_table(tmp_path / "limits.csv", tw.load(scaled), kinds)
    rest = {"move": ["--from=0.1,0.4,0.5", "--to=0.5,0.6,0.8"], "payload": ["--at", "0.2,0.4,0.5"], "doctor": []}[
        command
    ]
    words = {}
    for door, file, options in (
        ("file", scaled, []),
        ("without", without, ["--limits", table]),
        ("beside", scaled, ["--limits", table]),
    ):
        (tmp_path / f"{door}.urdf").write_text(file, "utf-8")
        _, said = run(command, tmp_path / f"{door}.urdf", *rest, *options)
        words[door] = re.search(r"^(OK|UNSURE|OVER LIMIT|LOOK AGAIN|STOPPED)", said, re.MULTILINE)[0]
    assert len(set(words.values())) == 1, words


def test_violations_are_those_of_the_limits_wherever_they_stand():
    """In Python, limits of the robot and the argument ``bounds``."""
    t = np.arange(0, 4, 0.01)
    for change in ({"effort": 0.2}, {"velocity": 0.05}, {"effort": 5.0}):
        scaled = tw.load(with_limits(arm(), change))
        own = tw.Motion(t, *FINE(t), robot=scaled).violations()
        given = tw.Motion(t, *FINE(t), robot=tw.load(arm())).violations(scaled.limits)
        assert [str(v) for v in own] == [str(v) for v in given]


@pytest.mark.parametrize("mass", [1e7, *slow(1e4, 1e6)])
def test_a_load_that_no_robot_carries_is_not_ok_where_no_torque_depends_on_it(ask, run, tmp_path, mass):
    """On the axis of the only joint that is loaded; by ``torques`` and by the tool of ``payload``."""
    t = np.arange(0, 4, 0.01)
    q = np.outer(0.5 * np.sin(t), np.ones(3))
    text = arm(efforts=(20.0, 24.0, 24.0)).replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>')
    log = write_log(tmp_path / "log.csv", t, q)
    (tmp_path / "arm.urdf").write_text(text, "utf-8")
    load = f"{mass:.0f},0,0,0@base"
    assert ask(text, log, "--payload", load)[0] == "UNSURE"
    still = write_log(tmp_path / "still.csv", t, 0.0 * q)
    word, line, _ = ask(text, still, "--payload", f"{mass:.0f}")
    assert word == "UNSURE" and "times as heavy as all moving links" in line
    assert run("payload", tmp_path / "arm.urdf", "--tool", f"{mass:.0f}")[1].startswith("UNSURE")


@pytest.mark.parametrize("mass", [1.0, 30.0, 1000.0])
def test_a_load_of_any_size_keeps_its_excess(ask, tmp_path, mass):
    """A doubt about a load is never a way out of OVER LIMIT."""
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *FINE(t))
    assert ask(arm(), log, "--payload", f"{mass}")[0] == ("OK" if mass < 2.0 else "OVER LIMIT")


@pytest.mark.parametrize("name", ["arm", *slow("camera head", "ur5", "panda", "tx40", "gen3 lite")])
def test_velocities_without_a_limit_are_named_through_every_door(ask, tmp_path, name):
    text = LIMITED[name]()
    log, bare = swinging_log(tmp_path / "log.csv", tw.load(text)), with_limits(text, {"velocity": None})
    names = tw.load(text).joint_names
    lines = ["joint,velocity", *(f"{joint},inf" for joint in names)]
    (tmp_path / "limits.csv").write_text("\n".join(lines) + "\n", "utf-8")
    by_file, by_table = ask(bare, log), ask(text, log, "--limits", tmp_path / "limits.csv")
    assert by_file[:2] == by_table[:2]
    assert by_file[0] != "OK" or "no velocity limit is known" in by_file[1]


@pytest.mark.parametrize("mass", [3.0, *slow(0.5, 8.0)])
def test_a_load_has_one_word_by_option_and_in_the_file(ask, tmp_path, mass):
    """As long as the arm can hold itself: limits below half of what its own weight needs are doubted, and 20 kg would be that."""
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *FINE(t))
    (tmp_path / "plain.urdf").write_text(arm(), "utf-8")
    robot = tw.load(tmp_path / "plain.urdf")
    loaded = robot.with_payload(tw.SpatialInertia.from_com(mass, (0.0, 0.0, 0.0)))
    tw.save(loaded, tmp_path / "loaded.urdf")
    by_option = ask(tmp_path / "plain.urdf", log, "--payload", f"{mass}")
    by_file = ask(tmp_path / "loaded.urdf", log)
    assert by_option[0] == by_file[0], (by_option[1], by_file[1])


@pytest.mark.parametrize("motion", [FINE, *slow(OVER)])
def test_degrees_have_one_word_by_option_header_and_assignment(ask, tmp_path, motion):
    t = np.arange(0, 4, 0.01)
    q = np.degrees(motion(t)[0])
    plain = write_log(tmp_path / "plain.csv", t, q)
    headed = write_log(tmp_path / "headed.csv", t, q, names=[f"{n} [deg]" for n in JOINTS])
    radians = write_log(tmp_path / "radians.csv", t, np.radians(q))
    assigned = ",".join(f"{n}={n} [deg]" for n in JOINTS)
    words = {
        ask(arm(), plain, "--degrees")[0],
        ask(arm(), headed)[0],
        ask(arm(), plain, "--columns", assigned)[0],
        ask(arm(), radians)[0],
    }
    assert len(words) == 1, words


def test_the_rate_has_one_word_by_option_and_by_column(ask, tmp_path):
    t = np.arange(0, 4, 0.01)
    q = FINE(t)[0]
    plain = write_log(tmp_path / "plain.csv", t, q)
    np.savetxt(tmp_path / "untimed.csv", q, "%.12g", ",", header=",".join(JOINTS), comments="")
    assert ask(arm(), plain)[0] == ask(arm(), tmp_path / "untimed.csv", "--rate", "100")[0] == "OK"


# ── 3. Less is known


@pytest.mark.parametrize("motion", [FINE, *slow(OVER)])
@pytest.mark.parametrize("joint", range(3))
def test_a_torque_limit_removed_is_never_ok(ask, tmp_path, motion, joint):
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *motion(t))
    efforts = [None if k == joint else x for k, x in enumerate(EFFORTS)]
    word, line, _ = ask(arm(efforts), log)
    assert word in ("UNSURE", "OVER LIMIT"), line


def test_a_velocity_limit_removed_is_not_ok_or_named(ask, tmp_path):
    """A motion too fast for one joint, whose limit is then left out."""
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *FINE(t))
    assert ask(arm(velocities=(3.0, 3.0, 0.8)), log)[0] == "OVER LIMIT"
    word, line, _ = ask(arm(velocities=(3.0, 3.0, None)), log)
    assert word != "OK" or "no velocity limit of joint3 is known" in line


def test_a_velocity_limit_far_beyond_all_drives_is_as_good_as_none(ask, tmp_path):
    """The unit of time was read off it: a slow log at 5 Hz seemed to be one in ms."""
    t = np.arange(0, 40, 0.2)
    slow_log = write_log(tmp_path / "log.csv", t, 0.2 * np.sin(0.3 * t)[:, None] * np.ones(3))
    text = arm(velocities=(1e9, 1e9, 1e9))
    word, line, _ = ask(text, slow_log)
    assert word == "OK" and "no velocity limit is known" in line
    (tmp_path / "gantry.urdf").write_text(text.replace("revolute", "prismatic"))
    gantry = tw.load(tmp_path / "gantry.urdf")
    assert without_velocity_limit(gantry.model, gantry.limits) == list(JOINTS)


@pytest.mark.parametrize("link", range(3))
def test_a_mass_removed_is_not_ok(ask, tmp_path, link):
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *FINE(t))
    text = arm().replace(f'<mass value="{(6.0, 4.0, 2.0)[link]}"/>', '<mass value="0"/>')
    zero = re.sub(
        rf'(<link name="link{link + 1}">.*?)<inertia [^>]*/>',
        r'\1<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>',
        text,
        flags=re.DOTALL,
    )
    word, line, _ = ask(zero, log)
    assert word != "OK" and f"link{link + 1}" in line


def test_friction_removed_is_remarked(run, tmp_path):
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *FINE(t))
    (tmp_path / "arm.urdf").write_text(arm(friction=True), "utf-8")
    (tmp_path / "bare.urdf").write_text(arm(), "utf-8")
    said = [
        " ".join(run("torques", tmp_path / name, "--trajectory", log)[1].split()) for name in ("arm.urdf", "bare.urdf")
    ]
    assert "with friction" in said[0] and "no friction, as its file gives none" in said[1]
    left_out = " ".join(run("torques", tmp_path / "arm.urdf", "--trajectory", log, "--no-friction")[1].split())
    assert "without friction" in left_out and "joint friction is left out" in left_out


# ── 4. Plans


PLANS = (
    ("--fastest", "--payload", "1.5"),
    ("--scaling", "s-curve", "--acceleration", "6", "--jerk", "60"),
    *slow(
        (),
        ("--fastest",),
        ("--fastest", "--acceleration", "8"),
        ("--scaling", "trapezoid", "--acceleration", "5"),
    ),
)


@pytest.mark.parametrize("seed", [0, *slow(*range(1, 20))])
@pytest.mark.parametrize("plan", PLANS)
def test_a_planned_motion_is_never_over_a_limit(run, ask, tmp_path, plan, seed):
    """Between random poses, with friction; the verdict on the plan's own file, with the options of the plan."""
    rng = np.random.default_rng(seed)
    poses = [",".join(f"{x:.3f}" for x in rng.uniform([-1.5, -0.5, -0.5], [1.5, 1.0, 1.5])) for _ in range(2)]
    (tmp_path / "arm.urdf").write_text(arm(friction=True), "utf-8")
    motion = tmp_path / "plan.csv"
    code, text = run("move", tmp_path / "arm.urdf", f"--from={poses[0]}", f"--to={poses[1]}", *plan, "--csv", motion)
    assert code == 0, text
    load = plan[plan.index("--payload") :][:2] if "--payload" in plan else ()
    word, line, _ = ask(tmp_path / "arm.urdf", motion, *load)
    assert word in ("OK", "UNSURE"), line


@SLOW
def test_an_exciting_motion_is_never_over_a_limit(run, ask, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(friction=True), "utf-8")
    motion = tmp_path / "excite.csv"
    run("excite", tmp_path / "arm.urdf", "--duration", "10", "--restarts", "1", "--acceleration", "8", "--csv", motion)
    word, line, _ = ask(tmp_path / "arm.urdf", motion)
    assert word in ("OK", "UNSURE"), line


# ── 5. One mechanism in three formats


@pytest.mark.parametrize("motion", [FINE, *slow(OVER)])
@pytest.mark.parametrize("load", [(), *slow(("--payload", "2"))])
def test_one_mechanism_has_one_word_in_every_format(ask, tmp_path, motion, load):
    t = np.arange(0, 4, 0.01)
    log = write_log(tmp_path / "log.csv", t, *motion(t))
    limits = table_of(
        tmp_path / "limits.csv", lower=[-3.1] * 3, upper=[3.1] * 3, velocity=[3.0, 3.0, 4.0], effort=EFFORTS
    )
    words = {}
    for ending in ("urdf", "xml", "sdf"):
        path = tmp_path / f"arm.{ending}"
        tw.save(tw.load(arm()), path)
        words[ending] = ask(path, log, "--limits", limits, "--tip", "link3", *load)[:2]
    assert len({word for word, _ in words.values()}) == 1, words


# ── 6. Logs with one fault, judged by an independent program


SHORT = ("pick_scara", "ur5", "delta", "gantry")
"""Robots of the short form: written and bundled ones, whose kernels compile quickly."""


@pytest.fixture
def one_fault(monkeypatch):
    """The benchmark's module; it lies beside the package, not in it."""
    pytest.importorskip("pinocchio", reason="the independent judge is Pinocchio", exc_type=ImportError)
    monkeypatch.syspath_prepend(str(ROOT))
    return importlib.import_module("bench.one_fault")


def log_of(one_fault, part: str, number: int):
    """A log of the benchmark's kinds, on the robots of the short form in turn; clean ones for the part ``clean``."""
    robots = [one_fault.ROBOTS[name] for name in SHORT]
    styles = [style for style in one_fault.STYLES if style != "impacts"]
    kind = None
    if part != "clean":
        every = list(one_fault.kinds(part).values())
        kind = every[number % len(every)]
        robots = [robot for robot in robots if one_fault.fits(kind, one_fault.judge_of(robot.name))]
    return one_fault.drawn(part, number, robots[number % len(robots)], kind, styles[number % len(styles)])


FAULTS = [("open", number) for number in range(18)] + [("held-out", number) for number in range(25)]


@pytest.mark.parametrize(("part", "number"), mostly_slow(FAULTS, every=15))
def test_a_log_with_one_fault_has_no_wrong_word(one_fault, part, number):
    """Neither an OK nor an OVER LIMIT that the true motion does not have; a log without a trace of its fault is excepted."""
    row = one_fault.score(log_of(one_fault, part, number))
    assert row["class"] in ("right", "doubt", "excluded") or not row["trace"], row


@pytest.mark.parametrize("number", mostly_slow(range(24), every=14))
def test_a_clean_log_has_no_false_doubt(one_fault, number):
    row = one_fault.score(log_of(one_fault, "clean", number))
    assert row["class"] == "right" or row["class"].startswith("doubt: "), row
