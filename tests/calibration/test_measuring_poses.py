"""Configurations to measure: ranks of theory, better than random ones, a prediction that comes true, clear, readable."""

from __future__ import annotations

import csv
import functools
import json

import numpy as np
import pytest
from calibration_worlds import ANGLE, CENTRE, NOISE, World, gantry, planar, rail, scara
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.calibration import Measurements, measuring_poses
from twistwrench.cli.main import main
from twistwrench.core.errors import ModelError, ValueRangeError
from twistwrench.shapes.capsules import MARGIN, CapsuleDistances, LinkCapsules

ARMS = {f"{n}R": (lambda n=n: planar(n)) for n in (3, 5, 6, 7)} | {"scara": scara, "rail": rail, "gantry": gantry}
ARMS = {name: functools.cache(make) for name, make in ARMS.items()}
QUICK = ("3R", "6R", "scara", "rail", "gantry")
LACKING = {"pose": 0, "position": 3, "distance": 6, "pair": 9}


def given(kind):
    return {"towards": CENTRE} if kind == "distance" else {}


@pytest.mark.parametrize("kind", LACKING)
@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in ARMS])
def test_planned_readings_determine_all_groups_of_the_theory(name, kind):
    """4 R + 2 P + 6 with poses, fewer by 3, 6 and 9 with positions, distances and pairs; the number of turns decides."""
    robot = ARMS[name]()
    chain = World.drawn(robot, 0).chain
    turning = sum(chain.turning)
    plan = measuring_poses(robot, 45, kind=kind, **given(kind))
    assert plan.rank == plan.theory == 4 * turning + 2 * (len(chain.turning) - turning) + 6 - LACKING[kind]
    assert plan.q.shape == (90 if kind == "pair" else 45, robot.nq)


@pytest.mark.parametrize("kind", ["position", pytest.param("pose", marks=pytest.mark.slow)])
def test_chosen_configurations_beat_random_ones(kind):
    """Twelve chosen readings leave less than the best of four random dozens; the error falls with every reading."""
    robot = tw.robots.ur5()
    plan = measuring_poses(robot, 12, kind=kind, noise=(NOISE, ANGLE), clear=False)
    random = []
    for seed in range(4):
        world = World.drawn(robot, seed)
        q = robot.random_configuration(seed, 12)
        found = tw.calibration.calibrate(robot, world.readings(kind, q), noise=(NOISE, ANGLE))
        random.append(found.remaining.rms)
    assert plan.remaining[-1] < min(random)
    assert (np.diff(plan.remaining) < 0).all() and plan.remaining[0] < plan.by_file


@pytest.mark.parametrize(
    "kind", ["position", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("pose", "distance", "pair"))]
)
def test_the_prediction_comes_true(kind):
    """Arms measured as planned: the true error of the tip is within a factor of two of the prediction, in the median of three."""
    robot = tw.robots.ur5()
    errors = []
    plan = measuring_poses(robot, 40, kind=kind, noise=(NOISE, ANGLE), **given(kind))
    for seed in range(3):
        world = World.drawn(robot, 20 + seed)
        found = tw.calibration.calibrate(robot, world.readings(kind, plan.q))
        errors.append(world.error(found))
    assert 0.5 < np.median(errors) / plan.remaining[-1] < 2.0


def test_configurations_are_clear_inside_limits_and_face_the_tracker():
    """Links 20 mm apart, ends above the floor, joints inside their limits, the tip's z axis within 60° of the tracker."""
    robot, place = tw.robots.ur5(), np.array([2.0, 0.5, 1.0])
    plan = measuring_poses(robot, 30, floor=0.0, towards=place)
    distances = CapsuleDistances.from_capsules(robot, LinkCapsules.from_robot(robot), floor=0.0, itself=True)
    apart = distances.evaluate(plan.q)[0]
    pairs = apart[:, : len(distances.margins)]
    assert (pairs >= distances.margins).all() and distances.margins.max() == MARGIN and (apart >= 0.0).all()
    assert (plan.q >= robot.limits.lower).all() and (plan.q <= robot.limits.upper).all()
    T = robot.forward_kinematics(plan.q)
    away = place - T[:, :3, 3]
    cosine = (away * T[:, :3, 2]).sum(axis=1) / np.linalg.norm(away, axis=1)
    assert (np.degrees(np.arccos(cosine)) < 63.0).all()  # the target is 50 mm beside the frame: 1.5° at 2 m


def test_existing_readings_count():
    """After forty readings, ten more leave less than forty alone, and less than ten alone."""
    ten, more = measuring_poses("ur5", 10), measuring_poses("ur5", 10, after="demo")
    alone = tw.calibration.calibrate("ur5", "demo").remaining.rms
    assert more.remaining[-1] < alone < ten.remaining[-1]


def test_moves_between_neighbours_are_small():
    """The order shortens the way: shorter than that of the choice, over three plans."""
    for seed in range(3):
        plan = measuring_poses("ur5", 30, seed=seed)
        chosen = plan.fit.problem.measured[-1].q
        assert sorted(map(tuple, plan.q)) == sorted(map(tuple, chosen))
        assert np.abs(np.diff(plan.q, axis=0)).max(axis=1).sum() < np.abs(np.diff(chosen, axis=0)).max(axis=1).sum()


@pytest.mark.parametrize("kind", LACKING)
@pytest.mark.parametrize("degrees", [False, True])
def test_the_file_with_readings_is_read_by_calibrate(tmp_path, kind, degrees):
    """Columns of readings added to the written file give the measurements of the arrays, to the digits that are written."""
    robot = tw.robots.ur5()
    plan = measuring_poses(robot, 30, kind=kind, **given(kind))
    m = World.drawn(robot, 1).readings(kind, plan.q)
    file = plan.to_csv(tmp_path / "poses.csv", degrees=degrees)
    head, *rows = list(csv.reader(file.read_text().splitlines()))
    if kind == "pose":
        turns = tw.so3.log(m.poses[:, :3, :3])
        head, added = [*head, "x", "y", "z", "rx [rad]", "ry [rad]", "rz [rad]"], np.c_[m.poses[:, :3, 3], turns]
    elif kind == "position":
        head, added = [*head, "x", "y", "z"], m.positions
    else:
        sizes = m.distances if kind == "distance" else np.repeat(m.distances, 2)
        head, added = [*head, "distance"], sizes[:, None]
    with file.open("w", newline="") as out:
        csv.writer(out).writerows(
            [head, *([*row, *map(repr, map(float, more))] for row, more in zip(rows, added, strict=True))]
        )
    again = Measurements.from_file(file, robot)
    assert again.kind == kind and again.count == plan.count == 30
    assert np.allclose(again.q, plan.q, atol=1e-12)
    kept = {"pose": m.poses, "position": m.positions}.get(kind, m.distances)
    found = {"pose": again.poses, "position": again.positions}.get(kind, again.distances)
    assert np.allclose(found, kept, atol=1e-12)


def test_the_answer_says_what_was_assumed():
    """A target on the last axis is assumed 50 mm beside it, and said; shapes that are missing make it UNSURE."""
    plan = measuring_poses("ur5", 25)
    assert plan.moved_off_axis and "50 mm off the axis of wrist_3_joint" in str(plan)
    assert plan.verdict.word == "UNSURE" and "6 links have no shapes" in plan.verdict.reasons[0]
    few = measuring_poses("ur5", 4)
    assert "of 27 groups" in few.verdict.reasons[0] and few.rank < few.theory


def test_the_command_is_the_function(tmp_path):
    """Verdict, sentences, tables and the written file of ``--plan`` are those of ``measuring_poses``, after readings too."""
    for words, options in (
        (["--plan", "12", "--floor", "0"], {"count": 12, "floor": 0.0}),
        (["demo", "--plan", "10", "--towards=2,0.5,1"], {"count": 10, "after": "demo", "towards": (2, 0.5, 1)}),
        (
            ["--plan", "14", "--kind", "pose", "--noise", "0.05mm,0.01deg"],
            {"count": 14, "kind": "pose", "noise": (5e-5, np.radians(0.01))},
        ),
    ):
        data, table = tmp_path / "plan.json", tmp_path / "poses.csv"
        done = CliRunner().invoke(
            main, ["calibrate", "ur5", *words, "--json", str(data), "--csv", str(table), "--overwrite"]
        )
        plan = measuring_poses("ur5", **options)
        found, wanted = json.loads(data.read_text()), plan.to_dict()
        assert done.exit_code == int(plan.verdict.exit_code) == 1
        assert all(found[name] == wanted[name] for name in ("verdict", "reasons", "facts", "sentences", "tables"))
        assert table.read_text() == plan.to_csv(tmp_path / "own.csv").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--floor", "0"], "belong to --plan"),
        (["demo", "demo", "--plan", "12"], "one file"),
        (["--plan", "12", "--length", "0.5"], "--length belongs to measurements"),
        (["--plan", "12", "--kind", "distance"], "--towards X,Y,Z"),
        (["--plan", "2"], "3 to 1,000"),
    ],
)
def test_options_that_do_not_belong_together_are_one_line(words, said):
    """Exit code 2, and the option to change."""
    done = CliRunner().invoke(main, ["calibrate", "ur5", *words])
    assert done.exit_code == 2 and said in done.output and len(done.output.splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"count": 2}, ValueRangeError, "3 to 1,000"),
        ({"kind": "plane"}, ValueError, "plane"),
        ({"kind": "distance"}, ValueRangeError, "towards=X,Y,Z"),
        ({"towards": (0.0, np.nan, 0.0)}, ValueRangeError, "towards"),
        ({"floor": 0.9}, ValueRangeError, "random configurations are clear"),
        ({"noise": 0.0}, ValueRangeError, "noise"),
        ({"tip": "nowhere"}, KeyError, "nowhere"),
    ],
)
def test_bad_input_is_one_error(options, error, words):
    """What is wrong, and what is allowed."""
    with pytest.raises(error, match=words.replace("(", r"\(").replace(")", r"\)")):
        measuring_poses("ur5", **{"count": 20, **options})


def test_a_robot_without_a_tip_needs_one():
    """A branched robot names its leaves."""
    with pytest.raises(ModelError, match="tip='FRAME'"):
        measuring_poses("quadruped", 20)
