"""Clearance between links: complete answers on record, by capsules and, where coal is installed, exact."""

from __future__ import annotations

import dataclasses
import importlib.util
import warnings
from itertools import product

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.statics import clearance, link_pairs
from twistwrench.statics.clearance import PathClearance
from twistwrench.statics.link_pairs import LinkPairs, Nearest

from .test_statics import from_file, joint, link, quiet

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)


def shape(inner, at="0 0 0", turn="0 0 0"):
    return f'<collision><origin xyz="{at}" rpy="{turn}"/><geometry>{inner}</geometry></collision>'


MOMENTS = (0.02, 0.03, 0.025, 0.001, 0.002, -0.001)
ROD, BALL, SLAB = '<cylinder radius="0.05" length="0.5"/>', '<sphere radius="0.07"/>', '<box size="0.12 0.08 0.2"/>'
MISSING = '<mesh filename="nowhere.stl"/>'
BODIES = {
    "stand": shape('<box size="0.3 0.25 0.1"/>', "0 0 0.02", "0 0 0.3"),
    "arm": shape(ROD, "0.25 0.01 0", "0 1.57 0") + shape(BALL, "0.5 0 0.02"),
    "forearm": shape(ROD, "0.24 0 0.01", "0 1.5 0.1"),
    "hand": shape(SLAB, "0.05 0.02 0.03", "0.2 0.1 0"),
    "lamp": shape(BALL, "0.1 0.05 0.1") + shape('<capsule radius="0.03" length="0.2"/>', "0.1 0 0.2"),
}


def machine(bodies=BODIES):
    """Arm of three joints and a lamp on a mast of its own."""
    links = "".join(
        link(n, 1.2 + 0.3 * k, "0.05 0.01 0.02", MOMENTS, shape=s) for k, (n, s) in enumerate(bodies.items())
    )
    text = (
        '<robot name="crane">' + links
        + joint("swing", "revolute", "stand", "arm", "0.02 0.03 0.14|0.1 0 0", "0.1 0.3 0.95", "-2.6 2.2 50")
        + joint("bend", "revolute", "arm", "forearm", "0.55 0.02 0.05|0 0 0.2", "0.1 0.95 0.1", "-2.4 2.7 40")
        + joint("tilt", "revolute", "forearm", "hand", "0.5 0 0.03|0.1 0 0", "0.9 0.2 0.3", "-1.5 1.9 20")
        + joint("slide", "prismatic", "stand", "lamp", "-0.3 0.1 0.1|0 0.1 0", "0.9 0.1 0.3", "-0.4 0.7 30")
        + "</robot>"
    )  # fmt: skip
    return from_file(text)


CONFIGURATIONS = np.array([
    [0.3, 0.4, -0.2, 0.1], [-1.2, 2.1, 0.7, 0.4], [2.0, -1.4, 0.3, -0.3], [-2.3, 2.6, 1.1, 0.6], [1.1, 1.9, -1.2, 0.2],
])  # fmt: skip
SRDF = '<robot name="crane"><disable_collisions link1="{}" link2="{}" reason="Never"/>{}</robot>'


def fields(pairs):
    return {
        "names": pairs.names, "starts": pairs.starts, "unknown": pairs.unknown, "known": pairs.known,
        "undecided": pairs.undecided, "touching": pairs.touching, "exact": pairs.shapes is not None,
    }  # fmt: skip


def motion(robot, rows=61, period=0.004):
    t = period * np.arange(rows) + 0.0003 * np.sin(np.arange(rows))
    s = np.linspace(0, 1, rows)[:, None]
    q = CONFIGURATIONS[0] + s * (CONFIGURATIONS[1] - CONFIGURATIONS[0])
    return [(t[:25], q[:25]), (t[25:], q[25:])]


# ── Capsules


@records.of(relative=1e-2)  # as near as capsules are fitted
def clearance_by_capsules(folder):
    robot = machine()
    partly = machine(BODIES | {"forearm": shape(MISSING), "lamp": ""})
    bare = machine(dict.fromkeys(BODIES, ""))
    two = from_file(
        '<robot name="two">' + link("a", 1, "0 0 0", MOMENTS, shape=shape(BALL)) + link("b", 1, "0 0 0", MOMENTS, shape=shape(BALL))
        + joint("j", "prismatic", "a", "b", "0.3 0 0", "1 0 0", "-1 1 5") + "</robot>"
    )  # fmt: skip
    path = folder / "crane.srdf"
    path.write_text(SRDF.format("hand", "stand", '<disable_collisions link1="lamp" link2="gone"/>'))
    return {
        "one": robot.clearance(CONFIGURATIONS[0], exact=False),
        "many": robot.clearance(CONFIGURATIONS.reshape(1, 5, 4), exact=False),
        "none": robot.clearance(np.zeros((0, 4)), exact=False).distance.shape,
        "with pairs left out": robot.clearance(CONFIGURATIONS, exact=False, srdf=path),
        "partly known": partly.clearance(CONFIGURATIONS[:2], exact=False),
        "bare": bare.clearance(CONFIGURATIONS[:2], exact=False),
        "two": two.clearance([[0.1], [0.2]], exact=False),
        "pairs": fields(LinkPairs.from_robot(robot, exact=False)),
        "pairs left out": fields(LinkPairs.from_robot(robot, False, path)),
        "partly": fields(LinkPairs.from_robot(partly, exact=False)),
        "exact": refusal(lambda: robot.clearance(CONFIGURATIONS[0], exact="often")),
        "nan": refusal(lambda: robot.clearance([np.nan, 0, 0, 0], exact=False)),
    }


@records.of(relative=1e-2)
def nearest_rows_by_capsules():
    pairs = LinkPairs.from_robot(machine(), exact=False)
    bounds = pairs.bounds(CONFIGURATIONS)
    some = CONFIGURATIONS[[0, 2, 4]]
    apart = np.array([[0.3, 0.4, -0.2, 0.1], [0.5, 0.2, 0.1, 0.2], [0.1, 0.3, 0.2, 0.15]])
    return {
        "bounds": bounds,
        "nearest": pairs.nearest(CONFIGURATIONS),
        "bounded": [pairs._nearest_pair(np.zeros((5, 4, 4)), bounds[0], x) for x in (0.01, 0.1, 0.5, np.inf, 0.0)],
        "rows": [pairs.nearest_row(rows, x) for rows in (CONFIGURATIONS, some, apart, apart[::-1], apart[:0]) for x in (np.inf, 0.2, 0.02)],
        "texts": pairs.pair_texts([2, 0]),
    }  # fmt: skip


@records.of
def answers_of_any():
    rows = list(product((True, False, None), repeat=3))
    return {str(row): link_pairs.any_of(row) for row in rows} | {"none": link_pairs.any_of([])}


@records.of(relative=1e-4)
def paths_by_capsules():
    robot = machine()
    pairs = LinkPairs.from_robot(robot, exact=False)
    partly = LinkPairs.from_robot(machine(BODIES | {"forearm": shape(MISSING), "lamp": ""}), exact=False)
    bare = LinkPairs.from_robot(machine(dict.fromkeys(BODIES, "")), exact=False)
    near = {"pair": ("arm", "lamp"), "time": 1.2345678, "step": 0.0125}
    made = {
        "apart": PathClearance(pairs, 0.05, 0.0873, **near),
        "at the limit": PathClearance(pairs, 0.0625, 0.0625, **near),
        "just apart": PathClearance(pairs, 0.0625, 0.0626, **near),
        "too near": PathClearance(pairs, 0.1, 0.0873, **near),
        "touch": PathClearance(pairs, 0.05, 0.0, **near),
        "touch, none asked": PathClearance(pairs, 0.0, 0.0, **near),
        "no step": PathClearance(pairs, 0.05, 0.0873, ("arm", "lamp"), 0.2),
        "hidden": PathClearance(pairs, 0.05, 0.0873, **near, hidden=frozenset({0, 2})),
        "exact, apart": PathClearance(dataclasses.replace(pairs, shapes=()), 0.05, 0.0873, **near),
        "exact, at the limit": PathClearance(dataclasses.replace(pairs, shapes=()), 0.0625, 0.0625, **near),
        "exact, too near": PathClearance(dataclasses.replace(pairs, shapes=()), 0.1, 0.0873, **near),
        "exact, contact": PathClearance(dataclasses.replace(pairs, shapes=()), 0.1, 0.0, **near),
        "exact, hidden contact": PathClearance(dataclasses.replace(pairs, shapes=()), 0.1, 0.0, **near, hidden=frozenset({1})),
        "undecided": PathClearance(dataclasses.replace(pairs, undecided=("a – b", "c – d")), 0.05, 0.0873, **near),
        "touching": PathClearance(dataclasses.replace(pairs, touching=tuple(f"a – {x}" for x in "bcdefg")), 0.05, 0.0873, **near),
        "partly known": PathClearance(partly, 0.05, 0.0873, **near),
        "nothing known": PathClearance(bare, 0.0),
        "no pairs": PathClearance(dataclasses.replace(pairs, links=pairs.links[:0]), 0.0),
    }  # fmt: skip
    return {
        name: {"words": path.words, "lines": path.lines, "verdict": str(path.verdict), "blocks": [getattr(b, "sentence", b) == b for b in path.blocks()]}
        for name, path in made.items()
    }  # fmt: skip


def along(robot, *arguments):
    path = PathClearance.along(robot, *arguments)
    return {f.name: getattr(path, f.name) for f in dataclasses.fields(path) if f.name != "pairs"} | {
        "lines": path.lines
    }


# ── SRDF files


@records.of
def pairs_of_srdf_files():
    robot = machine()
    more = '<disable_collisions link1="lamp" link2="stand"/><disable_collisions link1="lamp" link2="gone"/>'

    def pairs(text):
        return sorted(sorted(pair) for pair in link_pairs.disabled_pairs(robot, text))

    return {
        "some": pairs(SRDF.format("hand", "arm", more)),
        "of another robot": refusal(lambda: pairs(SRDF.format("finger", "arm", ""))),
        "none": refusal(lambda: pairs('<robot name="crane"><group name="g"/></robot>')),
        "another file": refusal(lambda: pairs(SRDF.format("hand", "arm", "").replace("robot", "model"))),
        "without a link": refusal(lambda: pairs('<robot name="crane"><disable_collisions link1="arm"/></robot>')),
        "xacro": refusal(
            lambda: pairs(
                '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"><xacro:include filename="b"/></robot>'
            )
        ),
        "not there": refusal(lambda: link_pairs.disabled_pairs(robot, "nowhere.srdf")),
    }


# ── Exact distances, by coal


def cube(size, at=(0.0, 0.0, 0.0), lid=True, turned_in=False):
    """Triangles of a box (12, 3, 3); without its lid 10."""
    corners = 0.5 * size * np.array(list(product((-1, 1), repeat=3))) * [1.0, 0.9, 1.1] + at
    faces = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
    ]
    faces += [(1, 5, 7), (1, 7, 3)] if lid else []
    triangles = corners[np.array(faces)]
    return triangles[:, ::-1] if turned_in else triangles


def mesh(folder, name, *parts):
    triangles = np.concatenate(parts)
    rows = np.zeros(len(triangles), dtype=[("normal", "<3f4"), ("corners", "<9f4"), ("more", "<u2")])
    rows["corners"] = triangles.reshape(-1, 9)
    (folder / name).write_bytes(b" " * 80 + np.uint32(len(rows)).tobytes() + rows.tobytes())
    return f'<mesh filename="{name}" scale="1 0.9 1.2"/>'


@records.of(relative=1e-4)
def exact_clearance(folder):
    robot = machine()
    wider = machine(
        BODIES | {"lamp": shape('<box size="0.9 0.7 0.8"/>', "0.3 0 0.3") + shape('<sphere radius="0.1"/>', "2 0 0")}
    )
    path = folder / "crane.srdf"
    path.write_text(SRDF.format("hand", "stand", ""))
    portions = motion(robot)
    coarse = [(np.array([0.0, 0.4, 0.9]), CONFIGURATIONS[:3]), (np.array([1.7]), CONFIGURATIONS[3:4])]
    return {
        "many": robot.clearance(CONFIGURATIONS, exact=True),
        "auto": robot.clearance(CONFIGURATIONS, srdf=path),
        "pairs": fields(LinkPairs.from_robot(robot, exact=True)),
        "wider": [fields(LinkPairs.from_robot(wider, exact=x)) for x in (True, False)],
        "along": [along(robot, portions, asked) for asked in (0.0, 0.3)],
        "along, pairs left out": along(robot, portions, 0.1, path),
        "along coarse rows": along(robot, coarse, 0.05),
        "along one row": along(robot, coarse[1:], 0.05),
        "along nothing": along(robot, [], 0.05),
        "asked": refusal(lambda: PathClearance.along(robot, portions, -0.1)),
    }


@records.of(relative=1e-4)
def exact_distances_of_meshes(folder):
    inner, outer = (
        mesh(folder, "inner.stl", cube(0.1), cube(0.08, (0.0, 0.0, 1.5))),
        mesh(folder, "outer.stl", cube(0.8), cube(0.5, turned_in=True)),
    )
    lidless = mesh(folder, "open.stl", cube(0.8, lid=False))
    found = {}
    q = np.array([[0.0, 0.0], [0.3, 0.05], [0.32, -0.1], [0.9, 0.1], [1.4, -0.2]])
    for name, a, c in (
        ("hollow", inner, outer),
        ("open", inner, lidless),
        ("ball", BALL, outer),
        ("turned", outer, inner),
    ):
        text = '<robot name="telescope">' + "".join(
            link(n, 1, "0 0 0", MOMENTS, shape=shape(s, at, "0 0 0.1"))
            for n, s, at in (
                ("a", a, "0.01 0 0"),
                ("b", '<sphere radius="0.002"/>', "0 0 0.9"),
                ("c", c, "0 0.02 0.01"),
            )
        )
        text += joint("ab", "prismatic", "a", "b", "0 0 0", "1 0 0", "-2 2 5") + joint(
            "bc", "prismatic", "b", "c", "0 0 0", "1 0 0", "-2 2 5"
        )
        path = folder / f"{name}.urdf"
        path.write_text(text + "</robot>")
        robot = quiet(path)
        pairs = LinkPairs.from_robot(robot, exact=True)
        poses = robot.link_poses(q)
        found[name] = {
            "clearance": robot.clearance(q), "row": pairs.nearest_row(q, np.inf), "row back": pairs.nearest_row(q[::-1], 0.5),
            "encloses": [pairs.encloses(T, 0) for T in poses], "separation": [pairs.separation(T, 0, 0.3) for T in poses],
            "distance": [pairs.distance(T, 0) for T in poses],
        }  # fmt: skip
    return found


@records.of(relative=1e-4)
def exact_search_of_inverse_kinematics():
    robot, bare = machine(), machine(dict.fromkeys(BODIES, ""))
    partly = machine(BODIES | {"forearm": shape(MISSING)})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        distances = [clearance.distances_for_search(r)(CONFIGURATIONS[:2]).distance for r in (robot, partly)]
    return {
        "distances": distances,
        "warnings": [str(w.message) for w in caught if issubclass(w.category, tw.ModelWarning)],
        "bare": refusal(lambda: clearance.distances_for_search(bare)),
        "nothing near": Nearest(1.0, -1).hidden,
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    if name.startswith("exact") and importlib.util.find_spec("coal") is None:
        pytest.skip("coal is not installed")
    records.compare(name, tmp_path)
