"""Clearance between links: bounds by capsules, distances by coal, verdicts along motions, SRDF files, inverse kinematics."""

from __future__ import annotations

import re
import sys
import warnings
from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner
from places import ROOT
from quick import mostly_slow
from robot_files import FILES
from robot_files import load as load_file

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.statics.clearance import PathClearance
from twistwrench.statics.link_pairs import LinkPairs

pytest_plugins = ("small_trees",)

ARMS = [
    name for name in ("ur_description/ur5_robot", "panda_description/panda", "xarm_description/xarm7") if name in FILES
]
ARM = FILES.get("ur_description/ur5_robot")
needs_files = pytest.mark.skipif(len(ARMS) < 3, reason="example-robot-data is not installed")
MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
SPHERE, CUBE = '<sphere radius="0.1"/>', '<box size="0.2 0.2 0.2"/>'
MESH = '<mesh filename="gone.stl"/>'


def slider(folder, *shapes, at="0 0 0", name="slider"):
    """Robot file of links a, b, c … on sliding joints along x, each with a shape at a place."""
    names = "abcdef"[: len(shapes)]
    links = [
        f'<link name="{n}">{MASS}<collision><origin xyz="{at}"/><geometry>{shape}</geometry></collision></link>'
        for n, shape in zip(names, shapes, strict=True)
    ]
    joints = [
        f'<joint name="j{b}" type="prismatic"><parent link="{a}"/><child link="{b}"/><axis xyz="1 0 0"/>'
        '<limit lower="-1" upper="1" velocity="10" effort="100"/></joint>'
        for a, b in pairwise(names)
    ]
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="{name}">{"".join(links + joints)}</robot>')
    return path


@pytest.fixture
def coal():
    return pytest.importorskip("coal", reason="coal is not installed")


@pytest.fixture
def without_coal(monkeypatch):
    monkeypatch.setitem(sys.modules, "coal", None)


@pytest.fixture
def run():
    def run(*arguments):
        result = CliRunner().invoke(main, [*map(str, arguments)])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, result.stdout

    return run


# ── distances ──


@pytest.mark.parametrize("exact", [False, True])
def test_spheres_are_as_far_apart_as_their_centres_less_the_radii(tmp_path, exact):
    if exact:
        pytest.importorskip("coal")
    robot = tw.load(slider(tmp_path, SPHERE, SPHERE, SPHERE))
    q = np.random.default_rng(0).uniform(-1, 1, (5, 4, 2))
    found = robot.clearance(q, exact=exact)
    np.testing.assert_allclose(found.distance, np.maximum(np.abs(q.sum(axis=-1)) - 0.2, 0.0), atol=1e-9)  # a and c
    assert found.pair.shape == (5, 4, 2) and set(found.pair.ravel()) == {"a", "c"}
    assert (found.exact, found.unknown) == (exact, ())


def pruned_and_every_pair(name, count):
    """Least distances of the search and those of all pairs, in random configurations."""
    robot = load_file(name, floating_base=False)
    pairs, q = LinkPairs.from_robot(robot, exact=True), robot.random_configuration(1, count)
    every = np.array([[pairs.distance(T, k) for k in range(len(pairs.links))] for T in robot.link_poses(q)])
    return robot.clearance(q, exact=True), np.maximum(every, 0.0), np.maximum(pairs.bounds(q), 0.0)


def check_pruning(name, count):
    found, every, bounds = pruned_and_every_pair(name, count)
    np.testing.assert_allclose(found.distance, every.min(axis=1), atol=1e-9)
    # Facets of curved shapes are inside them by 1.5 % of the radius or less, which their capsules add.
    assert (bounds <= every + 1e-6).all()


@needs_files
@pytest.mark.parametrize("name", mostly_slow(ARMS, 3))
def test_the_pruned_distance_is_that_of_all_pairs(coal, name):
    check_pruning(name, 5)


@needs_files
@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_the_pruned_distance_is_that_of_all_pairs_at_1000_poses(coal, name):
    check_pruning(name, 1000)


@needs_files
def test_distances_are_those_that_pinocchio_computes_from_the_same_file(coal):
    """Pinocchio reads meshes and places them by itself, and calls coal."""
    pin = pytest.importorskip("pinocchio", exc_type=ImportError)
    robot = load_file(ARMS[0], floating_base=False)
    model = pin.buildModelFromUrdf(str(ARM))
    shapes = pin.buildGeomFromUrdf(model, str(ARM), pin.GeometryType.COLLISION, package_dirs=[str(ARM.parents[4])])
    pairs = LinkPairs.from_robot(robot, exact=True).names
    for a, b in pairs:
        shapes.addCollisionPair(pin.CollisionPair(*(shapes.getGeometryId(f"{link}_0") for link in (a, b))))
    data, of_shapes = model.createData(), shapes.createData()
    for q in robot.random_configuration(5, 20):
        pin.updateGeometryPlacements(model, data, shapes, of_shapes, q)
        pin.computeDistances(shapes, of_shapes)
        least = min(result.min_distance for result in of_shapes.distanceResults)
        # The meshes are stored in single precision.
        assert robot.clearance(q).distance == pytest.approx(max(least, 0.0), abs=1e-6)


def test_pairs_always_in_contact_are_left_out_and_named(tmp_path, coal):
    """Bars a and c are longer than the strokes of the joints: they always touch each other, and a the sphere d."""
    bar = '<box size="9 0.1 0.1"/>'
    found = tw.load(slider(tmp_path, bar, SPHERE, bar, SPHERE)).clearance([0.1, 0.2, 0.3])
    assert found.touching == ("a – c", "a – d")
    assert found.pair.tolist() == ["b", "d"] and found.distance == pytest.approx(0.3)


def test_links_that_a_joint_connects_are_left_out(tmp_path):
    robot = tw.load(slider(tmp_path, SPHERE, SPHERE))
    found = robot.clearance([0.0], exact=False)
    assert found.distance == np.inf and found.pair.tolist() == ["", ""]


def test_a_link_without_shape_is_named_and_never_clear(tmp_path):
    robot = tw.load(slider(tmp_path, SPHERE, MESH, SPHERE))
    assert robot.clearance([0.5, 0.5], exact=False).unknown == ("b",)
    words = str(PathClearance.along(robot, [(np.zeros(1), np.array([[0.5, 0.5]]))], 0.0).verdict)
    assert words.startswith("UNSURE: clearance not known of 1 of 3 links")
    bare = tw.robots.ur5().clearance(np.zeros((3, 6)))
    assert np.isnan(bare.distance).all() and len(bare.unknown) == 7


def test_exact_distances_need_coal(tmp_path, without_coal):
    robot = tw.load(slider(tmp_path, SPHERE, SPHERE, SPHERE))
    with pytest.raises(tw.MissingExtraError, match="coal"):
        robot.clearance([0.5, 0.5], exact=True)
    assert not robot.clearance([0.5, 0.5]).exact
    with pytest.raises(tw.ValueRangeError, match="'auto'"):
        robot.clearance([0.5, 0.5], exact="often")


# ── along motions ──


def through(robot, begin, end, asked=0.0, srdf=None):
    """Clearance of a motion in 10 s at constant speed, in two portions."""
    t = np.linspace(0.0, 10.0, 1001)
    q = np.outer(1.0 - t / 10.0, begin) + np.outer(t / 10.0, end)
    portions = [(t[:400], q[:400]), (t[400:], q[400:])]
    return PathClearance.along(robot, portions, asked, srdf)


def test_the_first_contact_of_a_motion_is_found(tmp_path, coal):
    """c comes to a at 0.1 m/s from 0.7 m: the spheres meet at 0.2 m, after 5 s, and stay together beyond it."""
    robot = tw.load(slider(tmp_path, SPHERE, SPHERE, SPHERE))
    found = through(robot, [0.7, 0.0], [-0.3, 0.0])
    assert str(found.verdict).startswith("COLLISION: a and c are in contact at t = 5.0")
    assert abs(found.time - 5.0) <= 0.01 + 1e-9
    assert found.lines == [f"Closest links: a – c, in contact from t = {found.time:.3f} s (exact, every 10 ms)."]


@pytest.mark.parametrize("step", [0.001, 0.003, 0.03])
def test_the_first_and_the_last_row_of_every_portion_are_evaluated(tmp_path, coal, step):
    """c is nearest to a in the row between its way there and its way back, however many rows lie between those evaluated."""
    robot = tw.load(slider(tmp_path, SPHERE, SPHERE, SPHERE))
    for count in (1, 2, 10, 11, 12):
        t = step * np.arange(count)
        way_there = np.column_stack([np.linspace(0.9, 0.5, count), np.zeros(count)])
        smallest = way_there[-1, 0] - 0.2  # less the radii
        found = PathClearance.along(robot, [(t, way_there), (t[-1] + step + t, way_there + 0.1)], 0.0)
        assert (found.distance, found.time) == pytest.approx((smallest, t[-1]), abs=1e-9)
        way_back = way_there[::-1]
        found = PathClearance.along(robot, [(t, way_there + 0.1), (t[-1] + step + t, way_back)], 0.0)
        assert (found.distance, found.time) == pytest.approx((smallest, t[-1] + step), abs=1e-9)
        assert found.step <= max(0.01, step) + 1e-9


@pytest.mark.parametrize(("asked", "word"), [(0.0, "OK"), (0.29, "OK"), (0.31, "OVER LIMIT")])
def test_a_distance_that_is_not_kept_is_over_the_limit(tmp_path, coal, asked, word):
    found = through(tw.load(slider(tmp_path, SPHERE, SPHERE, SPHERE)), [1.0, 0.0], [0.5, 0.0], asked)
    assert found.verdict.word == word and found.distance == pytest.approx(0.3, abs=1e-9)


def test_capsules_alone_are_never_certain_of_a_contact(tmp_path, without_coal):
    """Capsules around cubes reach beyond them: they may touch, and further apart they do not."""
    robot = tw.load(slider(tmp_path, CUBE, CUBE, CUBE))
    near, far = through(robot, [0.5, 0.0], [0.22, 0.0]), through(robot, [1.0, 0.0], [0.6, 0.0])
    assert str(near.verdict).startswith("UNSURE: a and c may touch") and "pip install" in str(near.verdict)
    assert far.verdict.ok and "at least" in far.words and far.distance < 0.4


def test_coal_decides_where_capsules_cannot(tmp_path, coal):
    robot = tw.load(slider(tmp_path, CUBE, CUBE, CUBE))
    assert through(robot, [0.5, 0.0], [0.22, 0.0]).verdict.ok
    assert through(robot, [0.5, 0.0], [0.22, 0.0]).distance == pytest.approx(0.02, abs=1e-6)


def test_pairs_of_an_srdf_file_are_left_out(tmp_path, coal):
    robot = tw.load(slider(tmp_path, SPHERE, SPHERE, SPHERE, SPHERE))
    srdf = '<robot name="slider"><disable_collisions link1="{}" link2="{}" reason="Never"/></robot>'
    path = tmp_path / "s.srdf"
    path.write_text(srdf.format("c", "a"))
    q = [0.05, 0.0, 0.5]
    assert robot.clearance(q).pair.tolist() == ["a", "c"]
    assert robot.clearance(q, srdf=path).pair.tolist() == ["b", "d"]
    path.write_text(srdf.format("a", "z").replace("</robot>", '<disable_collisions link1="a" link2="c"/></robot>'))
    assert robot.clearance(q, srdf=path).pair.tolist() == ["b", "d"]


# ── inverse kinematics ──


@needs_files
def test_inverse_kinematics_takes_a_branch_that_is_clear(coal):
    robot = load_file(ARMS[0], floating_base=False)
    q = robot.random_configuration(3, 12)
    poses = robot.forward_kinematics(q)
    plain, clear = robot.inverse_kinematics(poses, q0=q), robot.inverse_kinematics(poses, q0=q, clearance=0.005)
    assert plain.converged.all() and (robot.clearance(plain.q).distance < 0.005).sum() >= 3
    reached = clear.converged
    assert reached.sum() > (robot.clearance(plain.q).distance >= 0.005).sum()
    assert (robot.clearance(clear.q[reached]).distance >= 0.005).all()
    np.testing.assert_allclose(robot.forward_kinematics(clear.q[reached]), poses[reached], atol=1e-9)


def test_inverse_kinematics_says_which_links_are_too_near(tmp_path):
    """The place of c decides its distance from a, whatever the joints do."""
    robot = tw.load(slider(tmp_path, SPHERE, SPHERE, SPHERE))
    near, far = tw.se3.exp([0, 0, 0, 0.25, 0, 0]), tw.se3.exp([0, 0, 0, 0.9, 0, 0])
    found = robot.inverse_kinematics(np.stack([near, far]), rows="vx", clearance=0.1)
    assert found.converged.tolist() == [False, True]
    assert found.reason(0).startswith("reached, but a and c are 0.05 m apart there, and 0.1 m are required")
    assert found.reason(1) == ""
    with pytest.raises(tw.ValueRangeError, match="clearance"):
        robot.inverse_kinematics(near, rows="vx", clearance=-1.0)
    with pytest.raises(tw.ModelError, match="no link has a shape"):
        tw.robots.ur5().inverse_kinematics(np.eye(4), clearance=0.01)


# ── commands ──


def written(path, *rows):
    path.write_text("time,jb,jc\n" + "".join(f"{0.1 * k:g},{x:g},0\n" for k, x in enumerate(rows)))
    return path


def test_torques_ends_with_1_after_a_collision(tmp_path, run, coal):
    robot = slider(tmp_path, SPHERE, SPHERE, SPHERE)
    ahead = written(tmp_path / "a.csv", *np.linspace(0.7, 0.0, 60))
    away = written(tmp_path / "b.csv", *np.linspace(0.7, 0.9, 60))
    code, output = run("torques", robot, "--trajectory", ahead, "--clearance")
    assert code == 1 and output.startswith("COLLISION: a and c are in contact at t = 4.")
    code, output = run("torques", robot, "--trajectory", away, "--clearance", "0.1")
    assert (
        code == 0
        and output.startswith("OK:")
        and "\nClosest links: a – c, 0.5 m at t = 0.000 s (exact, every" in output
    )
    code, output = run("torques", robot, "--trajectory", away)
    assert code == 0 and "Closest links" not in output


@pytest.mark.parametrize(("end", "word"), [(0.6, "OK"), (0.1, "COLLISION"), (0.25, "OVER LIMIT")])
def test_motions_of_other_commands_are_judged_likewise(tmp_path, run, coal, end, word):
    robot = slider(tmp_path, SPHERE, SPHERE, SPHERE)
    code, output = run("move", robot, "--from", "jb=0.7", "--to", f"jb={end}", "--clearance", "0.1")
    assert (code, output.partition(":")[0]) == (0 if word == "OK" else 1, word)
    assert "\nClosest links: a – c" in output
    assert not output.partition("\n")[2].startswith("OK")
    code, output = run(
        "simulate", robot, "--at", "jb=0.7", "--velocity", f"jb={end - 0.7:g}", "--duration", "1", "--clearance", "0.1"
    )
    assert (code, output.partition(":")[0]) == (0 if word == "OK" else 1, word)
    assert "\nOK" not in output and "\nClosest links: a – c" in output


def test_an_exciting_motion_is_judged_by_the_exact_distance(tmp_path, run, coal):
    robot = slider(tmp_path, SPHERE, SPHERE, SPHERE)
    options = "--duration", 4, "--harmonics", 1, "--restarts", 1, "--acceleration", 5
    code, output = run("excite", robot, *options, "--clearance", "0.9")
    assert code == 1 and output.startswith("OVER LIMIT: a and c come within 0.")
    assert "\nClosest links: a – c, 0." in output and "\nOK" not in output


def test_view_says_the_same_and_its_page_too(tmp_path, run, coal):
    from page_under_node import under_node

    robot = slider(tmp_path, SPHERE, SPHERE, SPHERE)
    log = written(tmp_path / "a.csv", *np.linspace(0.7, 0.0, 60))
    page = tmp_path / "page.html"
    code, output = run("view", robot, "--trajectory", log, "--clearance", "--html", page)
    assert code == 1 and output.startswith("COLLISION: a and c are in contact at t = ")
    _, expected = run("torques", robot, "--trajectory", log, "--clearance")
    text = "(m, all, motion) => new Verdict(motion, m.robot).now.text"
    assert " ".join(expected.split()).startswith(" ".join(under_node(page, text, []).split()))
    code, output = run("view", robot, "--clearance", "--html", tmp_path / "other.html")
    assert code == 2


def test_floating_bases_and_closed_loops_have_a_clearance_too(tmp_path):
    path = slider(tmp_path, SPHERE, SPHERE, SPHERE)
    robot = tw.load(path, floating_base=True)
    q = robot.neutral.copy()
    q[-2:] = 0.3, 0.4
    assert robot.clearance(q, exact=False).distance == pytest.approx(0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        closed = tw.load(path).close("a", "c", rows="vx", pose=tw.se3.exp([0, 0, 0, 0.5, 0, 0]))
    assert closed.clearance([0.2, 0.3], exact=False).distance == pytest.approx(0.3)


@needs_files
def test_locked_joints_keep_the_shapes_and_leave_fewer_pairs():
    robot = load_file(ARMS[0], floating_base=False)
    q = np.array([0.3, -1.0, 1.2, 0.4, 0.5, 1.0])
    locked = robot.lock({"wrist_2_joint": 0.5, "wrist_3_joint": 1.0})
    free, fewer = ({*map(tuple, LinkPairs.from_robot(r, exact=False).names.tolist())} for r in (robot, locked))
    assert fewer < free
    assert locked.clearance(q[:4], exact=False).distance >= robot.clearance(q, exact=False).distance


# ── the page ──


@pytest.mark.slow
@needs_files
def test_the_page_shows_what_the_commands_say(run, coal):
    """Commands, their outputs and the numbers in the comments of the Python block."""
    text = (
        (ROOT / "docs" / "torques.md")
        .read_text("utf-8")
        .partition("## Self-collision and clearance\n")[2]
        .partition("\n## ")[0]
    )
    shown = re.findall(
        r"```console no-run(?: exit=(\d))?\n\$ twistwrench ([^\n]+)\n```\n\n```text\n(.*?)```", text, re.DOTALL
    )
    assert len(shown) == 2
    for code, command, lines in shown:
        found, output = run(*command.split())
        assert found == int(code or 0)
        assert " ".join(output.split()).startswith(" ".join(lines.split()))
    scope = {"tw": tw}
    exec(re.findall(r"```python no-run\n(.*?)```", text, re.DOTALL)[0], scope)
    np.testing.assert_allclose(scope["found"].distance, [0.0143, 0.0], atol=5e-5)
    assert scope["found"].pair[1].tolist() == ["upper_arm_link", "wrist_2_link"]
    assert scope["found"].exact and scope["found"].unknown == ()
    assert scope["arm"].clearance(scope["q"]).distance == 0.0
    assert scope["solution"].converged and scope["arm"].clearance(scope["solution"].q).distance >= 0.005


def test_false_alarms_of_capsules_are_those_measured():
    from bench.clearance import table, totals

    text = (ROOT / "docs" / "torques.md").read_text("utf-8")
    count, alarms, missed = totals()
    assert table() in text
    assert f"Of {count:,} configurations, {alarms:,} are false alarms and {missed:,} contacts are missed" in text


# ── a link inside another ──


def cube(size, place=(0.0, 0.0, 0.0), *, turned_in=False, lid=True):
    """Triangles (k, 3, 3) of a cube, its faces outward or inward, with or without its upper side."""
    corners = size * (np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) - 0.5) + place
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]][: 6 if lid else 5]
    faces = np.array([[a, b, c] for a, b, c, d in sides] + [[a, c, d] for a, b, c, d in sides])
    return corners[faces[:, ::-1] if turned_in else faces]


def stl(folder, name, *parts):
    """Binary STL file of triangles."""
    triangles = np.concatenate(parts)
    rows = np.zeros(len(triangles), dtype=[("normal", "<3f4"), ("corners", "<9f4"), ("more", "<u2")])
    rows["corners"] = triangles.reshape(-1, 9)
    (folder / name).write_bytes(b" " * 80 + np.uint32(len(rows)).tobytes() + rows.tobytes())
    return f'<mesh filename="{name}"/>'


HOLLOW = cube(0.8), cube(0.6, turned_in=True)
INSIDE = {
    "a mesh in a mesh": ((cube(0.2),), (cube(0.8),), 0.0, 0.0),
    "beside it": ((cube(0.2),), (cube(0.8),), 0.7, 0.2),
    "a part of several in a mesh": ((cube(0.1, (0, 0, 2.0)), cube(0.2)), (cube(0.8),), 0.0, 0.0),
    "in one part of several": ((cube(0.1),), (cube(0.4, (-0.5, 0, 0)), cube(0.4, (0.5, 0, 0))), 0.5, 0.0),
    "between parts": ((cube(0.1),), (cube(0.4, (-0.5, 0, 0)), cube(0.4, (0.5, 0, 0))), 0.0, 0.25),
    "in overlapping parts": ((cube(0.1),), (cube(0.5, (-0.1, 0, 0)), cube(0.5, (0.1, 0, 0))), 0.0, 0.0),
    "in the cavity of a housing": ((cube(0.2),), HOLLOW, 0.0, 0.2),
    "in the cavity, its inner wall turned outward": ((cube(0.2),), (cube(0.8), cube(0.6)), 0.0, 0.2),
    "in a solid in the cavity": ((cube(0.1),), (*HOLLOW, cube(0.4)), 0.0, 0.0),
    "in a mesh whose faces point inward": ((cube(0.2),), (cube(0.8, turned_in=True),), 0.0, 0.0),
}


@pytest.mark.usefixtures("each_on_numpy")
@pytest.mark.parametrize("name", INSIDE)
def test_a_link_inside_the_solid_of_another_is_in_contact(tmp_path, coal, name):
    """Cubes by their own arithmetic; in a cavity, between parts and beside a mesh, a link is as far as its surface is."""
    inner, outer, x, expected = INSIDE[name]
    meshes = stl(tmp_path, "inner.stl", *inner), stl(tmp_path, "outer.stl", *outer)
    for first, second, sign in ((*meshes, -1.0), (*meshes[::-1], 1.0)):
        robot = tw.load(slider(tmp_path, first, '<sphere radius="0.001"/>', second))
        found = robot.clearance([sign * x, 0.0])
        assert abs(float(found.distance) - expected) < 1e-6  # float32 corners of 1 m
        assert not found.hidden


def test_a_simple_shape_inside_a_mesh_is_in_contact(tmp_path, coal):
    robot = tw.load(slider(tmp_path, SPHERE, SPHERE, stl(tmp_path, "outer.stl", cube(0.8))))
    assert robot.clearance([[0.0, 0.0], [0.7, 0.0]]).distance.round(6).tolist() == [0.0, 0.2]


def test_whether_a_link_is_inside_an_open_mesh_is_not_known(tmp_path, coal):
    """A box without its lid may be a housing or a badly written solid: UNSURE, and its name."""
    robot = tw.load(slider(tmp_path, CUBE, '<sphere radius="0.001"/>', stl(tmp_path, "open.stl", cube(0.8, lid=False))))
    found = robot.clearance([0.0, 0.0])
    assert (found.hidden, round(float(found.distance), 6)) == (("a – c",), 0.3)
    assert robot.clearance([2.0, 0.0]).hidden == ()
    verdict = PathClearance.along(robot, [(np.array([0.0, 1.0]), np.zeros((2, 2)))], 0.0).verdict
    assert str(verdict).startswith(
        "UNSURE: a mesh is not closed, so it is not known whether one link is inside the other: a – c"
    )
    assert PathClearance.along(robot, [(np.array([0.0]), np.array([[0.0, 0.0]]))], 0.5).verdict.word == "OVER LIMIT"


@pytest.mark.parametrize("at", ["2 0 0", "0 -3 1"])
def test_a_mesh_encloses_where_its_origin_places_it(tmp_path, coal, at):
    meshes = stl(tmp_path, "inner.stl", cube(0.2)), stl(tmp_path, "outer.stl", cube(0.8))
    robot = tw.load(slider(tmp_path, meshes[0], '<sphere radius="0.001"/>', meshes[1], at=at))
    assert robot.clearance([[0.0, 0.0], [0.7, 0.0]]).distance.round(6).tolist() == [0.0, 0.2]


def test_a_motion_stays_unsure_of_a_mesh_that_is_not_closed_once_the_link_has_left_it(tmp_path, coal):
    robot = tw.load(slider(tmp_path, CUBE, '<sphere radius="0.001"/>', stl(tmp_path, "open.stl", cube(0.8, lid=False))))
    q = np.array([[0.0, 0.0], [0.75, 0.0]])
    for rows in (q, q[::-1]):
        assert PathClearance.along(robot, [(np.array([0.0, 1.0]), rows)], 0.0).verdict.word == "UNSURE"
