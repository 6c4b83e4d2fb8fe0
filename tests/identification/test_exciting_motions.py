"""Exciting motions: limits are kept between the instants that the search looks at, and they tell more than random ones do."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.identification import exciting_trajectory
from twistwrench.identification.exciting_motion import _bounds, _noise, _search
from twistwrench.identification.motion_room import Band, shared_bounds
from twistwrench.identification.parameter_groups import BaseParameters
from twistwrench.identification.rest_series import RestSeries
from twistwrench.identification.unknown_parameters import UnknownParameters

PLANAR = tw.robots.planar_2r()
UR5 = tw.robots.ur5().lock({"wrist_2_joint": 0.3, "wrist_3_joint": 0.0})
GIVEN = {
    "planar_2r": {"velocity": 2.0, "acceleration": 8.0, "effort": 45.0},
    "ur5": {"acceleration": 6.0, "floor": 0.05},
}
ROBOTS = {"planar_2r": PLANAR, "ur5": UR5}
SHARE = 0.8


@functools.cache
def found(name):
    return exciting_trajectory(ROBOTS[name], 10.0, 3, share=SHARE, seed=1, **GIVEN[name])


def search(name):
    """What the function searches with."""
    robot, given = ROBOTS[name], dict(GIVEN[name])
    floor = given.pop("floor", None)
    limits = {key: given.get(key) for key in ("velocity", "acceleration", "effort")}
    base = BaseParameters.of(UnknownParameters(robot))
    speed = np.full(robot.nv, 0.05)
    bounds = _bounds(robot, SHARE, **limits)
    return _search(robot, RestSeries(10.0, 3), bounds, base, speed, _noise(robot, None), floor, None)


@pytest.mark.parametrize("name", ROBOTS)
def test_limits_are_kept_between_the_instants_of_the_search(name):
    """At 6007 instants, a prime number, with friction; the search looks at 121 and judges at 961."""
    robot, given = ROBOTS[name], dict(GIVEN[name])
    floor = given.pop("floor", None)
    bounds = shared_bounds(tw.trajectories.bounds_of(robot, **given), SHARE)
    t = np.linspace(0, 10, 6007)
    motion = tw.Motion(t, *found(name)(t), robot=robot, in_seconds=True)
    assert motion.violations(bounds, friction=True) == ()
    if floor is not None:
        heights = robot.link_poses(motion.q)[..., 2, 3]
        assert heights[:, np.ptp(heights, axis=0) > 1e-9].min() >= floor


@pytest.mark.parametrize("name", ROBOTS)
def test_it_rests_at_both_ends(name):
    one = found(name)
    q, dq, ddq = one(np.array([-1.0, 0.0, 10.0, 11.0]))
    assert not dq.any() and not ddq.any()
    assert np.ptp(q, axis=0).max() < 1e-12
    near = one(np.array([1e-6, 10 - 1e-6]))
    assert max(np.abs(near[1]).max(), np.abs(near[2]).max()) < 1e-3  # of some rad/s³: no jump


@pytest.mark.parametrize("name", ROBOTS)
def test_rates_are_those_of_the_positions(name):
    """By central differences, whose error is h² times the third derivative."""
    t, h = np.linspace(0.5, 9.5, 41), 1e-4
    one = found(name)
    _, dq, ddq = one(t)
    ahead, behind = one(t + h), one(t - h)
    for value, (a, b) in ((dq, (ahead[0], behind[0])), (ddq, (ahead[1], behind[1]))):
        assert np.abs((a - b) / (2 * h) - value).max() < 1e-5


@pytest.mark.parametrize("name", ROBOTS)
def test_it_tells_more_than_random_motions_that_are_as_wide_as_they_can_be(name):
    looking, rng = search(name), np.random.default_rng(5)
    motions = [z for _ in range(60) if (z := looking.random(rng)) is not None]
    assert len(motions) > 30 and all(looking.fits(z) for z in motions)
    information = looking.information
    rows = [information.rows(*looking._states(z, fine=True)) for z in motions]
    one = found(name)
    assert one.log_det > max(map(information.log_det, rows)) + 1.0
    medians = [np.median(information.deviations(W)) for W in rows]  # what is sought is log det, not the least median
    assert np.median(one.predicted_deviations) < 0.8 * np.median(medians)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_slope_of_the_search_is_that_of_its_cost(name):
    """By central differences along random directions, near the edges where the barrier is steep."""
    looking, rng = search(name), np.random.default_rng(3)
    z = looking.random(rng)
    for width in (0.1, 0.01):
        slope = looking.cost_and_slope(z, 1.0, width)[1]
        for _ in range(3):
            d, h = rng.normal(size=z.shape), 1e-6
            ahead, behind = (looking.cost_and_slope(z + s * h * d, 1.0, width)[0] for s in (1, -1))
            along = float((slope * d).sum())
            assert abs((ahead - behind) / (2 * h) - along) < 1e-4 * (abs(along) + np.linalg.norm(slope))


def test_the_barrier_is_smooth_where_it_becomes_a_parabola():
    band = Band(np.array([-np.inf]), np.array([1.0]), np.array([2.0]))
    x = 1.0 - 2.0 * 0.1 + np.array([[-1e-9], [1e-9]])
    values = [band.barrier(one[None], 0.1) for one in x]
    assert abs(values[0][0] - values[1][0]) < 1e-7
    assert abs(values[0][1] - values[1][1]).max() < 1e-6
    assert band.barrier(np.array([[5.0]]), 0.1)[0] > band.barrier(np.array([[2.0]]), 0.1)[0] > 0


def test_the_seed_decides():
    again = exciting_trajectory(PLANAR, 10.0, 3, share=SHARE, seed=1, **GIVEN["planar_2r"])
    assert (again.coefficients == found("planar_2r").coefficients).all()
    other = exciting_trajectory(PLANAR, 10.0, 3, share=SHARE, seed=2, **GIVEN["planar_2r"])
    assert (again.coefficients != other.coefficients).any()


def test_more_beginnings_are_no_worse_and_progress_is_told():
    told: list[float] = []
    more = exciting_trajectory(
        PLANAR, 10.0, 3, share=SHARE, seed=1, restarts=2, progress=told.append, **GIVEN["planar_2r"]
    )
    assert more.log_det >= found("planar_2r").log_det - 1e-6
    assert told == sorted(told) and told[-1] == 1.0 and 0 < told[0] < 0.5


def test_clear_of_what_the_user_tells():
    """A joint that stays above a line."""
    given = {"velocity": 2.0, "acceleration": 8.0, "clear": lambda q: q[:, 1] - 0.2}
    one = exciting_trajectory(PLANAR, 8.0, 2, **given)
    assert one(np.linspace(0, 8, 4001))[0][:, 1].min() >= 0.2


def test_deviations_are_those_of_least_squares():
    """Of many logs with independent noise at 25 rows a second."""
    one = found("planar_2r")
    information = one.information
    W = information.rows(*one(np.linspace(0, 10, 251)[:-1]))
    rng = np.random.default_rng(0)
    A = (W / information.noise[:, None]).reshape(-1, W.shape[-1])
    spread = np.std([np.linalg.lstsq(A, rng.normal(size=len(A)), rcond=None)[0] for _ in range(400)], axis=0)
    assert np.allclose(spread, one.predicted_deviations, rtol=0.15)  # 400 draws: 3.5 % each


BAD = {
    "no duration": ({"duration": 0.0}, "duration"),
    "no harmonic": ({"harmonics": 0}, "harmonics"),
    "half a harmonic": ({"harmonics": 2.5}, "harmonics"),
    "too many harmonics": ({"harmonics": 1000}, "at most"),
    "all and more": ({"share": 1.1}, "share"),
    "a limit that is none": ({"acceleration": -1.0}, "acceleration"),
    "no limit": ({"acceleration": None}, "nothing limits"),
    "noise of nothing": ({"noise": 0.0}, "noise"),
    "noise of three": ({"noise": [1.0, 1.0, 1.0]}, "noise"),
    "no beginning": ({"restarts": 0}, "restarts"),
    "a step too long": ({"step": 5.0}, "step"),
    "a seed that is none": ({"seed": "x"}, "seed"),
    "a floor above it all": ({"floor": 10.0}, "no motion"),
    "too weak to stand": ({"effort": 1e-3}, "no motion"),
    "an unknown law": ({"friction": ("magic",)}, "magic"),
    "a distance that is none": ({"clear": 3}, "clear"),
    "a distance too many": ({"clear": lambda q: np.ones(3)}, "clear"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_error(case):
    given, word = BAD[case]
    with pytest.raises(tw.TwistWrenchError, match=word):
        exciting_trajectory(PLANAR, **({"duration": 5.0, "harmonics": 2, "acceleration": 5.0} | given))


def test_joints_of_several_degrees_are_refused():
    with pytest.raises(tw.ModelError, match="several degrees"):
        exciting_trajectory(tw.robots.floating_box())


def run(*arguments):
    return CliRunner().invoke(main, [*map(str, arguments)])


def test_the_motion_of_the_command_passes_no_limit(tmp_path):
    out = tmp_path / "motion.csv"
    hold = ["--lock", "wrist_2_joint=0.3", "--lock", "wrist_3_joint=0"]
    said = run(
        "excite", "ur5", *hold, "--seconds", 10, "--harmonics", 3, "--acceleration", 6, "--floor", 0.05, "--out", out
    )
    assert said.exit_code == 0, said.output
    assert "condition" in said.output and "not looked at" in said.output
    after = run("torques", "ur5", *hold, "--trajectory", out)
    assert after.exit_code == 0, after.output


def test_the_command_answers_bad_input_with_a_line_and_writes_nothing(tmp_path):
    out = tmp_path / "motion.csv"
    said = run("excite", "planar_2r", "--out", out)
    assert said.exit_code == 2 and "--acceleration" in said.output and not out.exists()
    said = run("excite", "planar_2r", "--acceleration", 5, "--out", tmp_path / "none" / "motion.csv")
    assert said.exit_code == 2 and "no such folder" in said.output
