"""Physically consistent bodies, and files that come back as they were written."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from identification_logs import known_log
from scipy import stats

import twistwrench as tw
from twistwrench.core.estimation.covariance import GroupCovariance
from twistwrench.core.numbers import number
from twistwrench.identification import BaseParameters, UnknownParameters, identify
from twistwrench.identification.consistent import (
    MOST_STEPS,
    STRENGTHS,
    ConsistentRobot,
    PositiveFit,
    PositivePrior,
    PositiveProblem,
)
from twistwrench.identification.result import IdentifiedRobot
from twistwrench.identification.write import check_written
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.testing import random_robot

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

GIVEN = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}


def random_problem(seed, joints=4, rows=60):
    """A random robot, and rows of torques that no robot has: noise as large as the torques."""
    robot = random_robot(seed, joints, kinds=("revolute", "prismatic"))
    unknown = UnknownParameters(robot)
    base = BaseParameters.from_unknowns(unknown)
    rng = np.random.default_rng(seed)
    q = np.stack([robot.random_configuration(rng) for _ in range(rows)])
    dq, ddq = rng.normal(size=(2, rows, robot.nv))
    W = unknown.columns(base.kept, q, dq, ddq, np.full(robot.nv, 0.1)).reshape(rows * robot.nv, -1)
    tau = W @ base.project(unknown.file_values)
    tau = tau + rng.normal(size=tau.shape) * np.sqrt((tau**2).mean())
    ones = np.ones(robot.nv)
    sizes = unknown.scales(ones, ones, ones)
    prior = PositivePrior.from_values(base, np.zeros(base.count), sizes)
    return PositiveProblem(base, prior, W.T @ W, W.T @ tau, float(tau @ tau), sizes), base, prior, sizes


def bodies(base, fit):
    places = base.unknown.of_bodies
    values = np.zeros(10 * len(base.unknown.model.bodies))
    values[places[places >= 0]] = fit.values[places >= 0]
    return [SpatialInertia.from_parameters(p) for p in values.reshape(-1, 10)]


@pytest.mark.parametrize("seeds", [range(5), pytest.param(range(5, 1000), marks=pytest.mark.slow)], ids=["few", "many"])
def test_every_body_can_exist(seeds):
    for seed in seeds:
        problem, base, _, _ = random_problem(seed)
        for fit in problem.path(STRENGTHS):
            assert fit.steps <= MOST_STEPS
            assert fit.above <= 0.01 * abs(fit.cost)
            assert min(np.linalg.eigvalsh(G.pseudo_inertia)[0] for G in bodies(base, fit)) > 0
            assert (fit.values[np.isin(base.unknown.kinds, ("viscous", "coulomb", "motor_inertia"))] > 0).all()


def test_a_strong_pull_is_the_file_and_a_weak_one_the_least_squares():
    problem, base, _, _ = random_problem(1)
    far = problem.path((1e9,))[-1]
    file = base.unknown.file_values[base.unknown.of_bodies >= 0]
    assert np.allclose(far.values[base.unknown.of_bodies >= 0], file, rtol=1e-4, atol=1e-4 * np.abs(file).max())
    costs = [fit.cost for fit in problem.path(STRENGTHS)]
    assert (np.diff(costs) <= 1e-9 * np.abs(costs[:-1])).all()


@pytest.mark.slow
def test_the_cost_is_that_of_a_conic_solver():
    """Clarabel by way of cvxpy, at every strength that is offered."""
    cp = pytest.importorskip("cvxpy")
    problem, base, prior, sizes = random_problem(2, joints=3)
    unknown = base.unknown
    kinds = np.array(unknown.kinds)
    from twistwrench.identification.consistent import pseudo_inertia
    from twistwrench.mechanics.algorithms.inverse_dynamics import PARAMETER_NAMES

    units = [pseudo_inertia(e) for e in np.eye(10)]
    x = cp.Variable(len(unknown.names))
    terms = []
    for i in range(len(unknown.model.bodies)):
        places = [int(np.flatnonzero(unknown.of_bodies == 10 * i + k)[0]) for k in range(len(PARAMETER_NAMES))]
        L = np.linalg.inv(np.linalg.cholesky(prior.bodies[i]))
        J = sum(x[p] * (L @ E @ L.T) for p, E in zip(places, units, strict=True))
        terms.append(cp.trace(J) - cp.log_det(J) - 4)
    drives = np.flatnonzero(prior.positive)
    terms += [x[k] / prior.drives[k] - cp.log(x[k] / prior.drives[k]) - 1 for k in drives]
    free = np.flatnonzero(kinds == "offset")
    root = np.linalg.cholesky(problem.H + 1e-12 * np.trace(problem.H) * np.eye(len(problem.H))).T
    for strength, fit in zip(STRENGTHS, problem.path(STRENGTHS), strict=True):
        squares = 0.5 * (cp.sum_squares(root @ x) - 2 * problem.g @ x + problem.y)
        cost = squares + strength * cp.sum(terms) + 0.5 * cp.sum_squares(x[free] / sizes[free])
        best = cp.Problem(cp.Minimize(cost)).solve(solver=cp.CLARABEL)
        assert fit.cost <= best * 1.01


ARM = tw.load(tw.robots.path_of("ur5"))


@pytest.fixture(scope="module")
def found():
    """Of a robot whose forearm is 20 % heavier than in its file."""
    heavy = tw.robots.ur5().with_payload(SpatialInertia.from_com(0.5, (0.0, 0.0, 0.1)), "forearm_link")
    return identify(ARM, known_log(heavy, 4, of=ARM).motion, **GIVEN)


def test_the_robot_predicts_what_the_file_does_not(found):
    assert found.consistent.held_out < 0.5 * found.consistent.of_file
    names = [body.link for body in ARM.model.bodies]
    gained = [G.mass - b.inertia.mass for G, b in zip(found.consistent.inertias, ARM.model.bodies, strict=True)]
    assert not any(defect for G in found.consistent.inertias for defect in G.defects())
    assert names[int(np.argmax(gained))] in ("upper_arm_link", "forearm_link")


def test_what_four_models_leave_adds_up_to_what_the_pull_was_chosen_by(found):
    """Joint by joint in the picture, of all joints where γ is chosen: the same fits, so equal to rounding."""
    left, torques = found.residuals, sum(fifth.y for fifth in found._fifths)
    for shares, whole in ((left.consistent, found.consistent.held_out), (left.with_friction, found.consistent.of_file)):
        assert np.isclose(np.sqrt(shares**2 @ torques / torques.sum()), whole, rtol=1e-9)
    assert (left.identified < left.file).all()  # the robot of the log has friction, and more mass


def test_files_come_back_as_they_were_written(found, tmp_path):
    found.write(tmp_path / "new.urdf", tmp_path / "new.yaml", logs=["log.csv"])
    again = tw.load(tmp_path / "new.urdf").with_actuators(tmp_path / "new.yaml")
    robot = found.robot
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 500, 6))
    ours, theirs = (r.inverse_dynamics(q, dq, ddq, friction=True) for r in (robot, again))
    assert np.abs(ours - theirs).max() <= 1e-12 * np.abs(ours).max()


def test_everything_else_stays_as_it_was(found, tmp_path):
    found.write(tmp_path / "new.urdf")
    before, after = (p.read_text() for p in (tw.robots.path_of("ur5"), tmp_path / "new.urdf"))
    kept = [
        line
        for line in before.splitlines()
        if not any(w in line for w in ("<mass", "<inertia", "<origin", "<dynamics"))
    ]
    lines = after.splitlines()
    at = 0
    for line in kept:
        at = next(k for k in range(at, len(lines)) if line.strip() in lines[k]) + 1
    assert "twistwrench identify: version" in after


def test_links_without_an_inertial_or_an_origin_get_one(tmp_path):
    text = tw.robots.path_of("planar_2r").read_text()
    import re

    first = re.search(r"<inertial>.*?</inertial>", text, re.DOTALL)[0]
    bare = text.replace(first, re.sub(r"<origin[^>]*/>", "", first), 1)
    arm = tw.load(bare.replace("\t", " "), inertia="accept")
    path = tmp_path / "arm.urdf"
    path.write_text(bare)
    arm = tw.load(path, inertia="accept")
    found = identify(arm, known_log(tw.robots.planar_2r(), 1, of=arm).motion, **GIVEN)
    found.write(tmp_path / "new.urdf", force=True)
    assert tw.load(tmp_path / "new.urdf").nv == 2


@pytest.mark.slow
def test_nothing_is_written_after_look_again(tmp_path):
    log = known_log(ARM, 1)
    tau = log.motion.tau.copy()
    tau[:, 1] *= -1
    found = identify(ARM, log.changed(tau=tau), **GIVEN)
    with pytest.raises(tw.ValueRangeError, match="LOOK AGAIN"):
        found.write(tmp_path / "new.urdf")
    assert not list(tmp_path.iterdir())


def test_a_robot_without_a_file_says_so(tmp_path):
    arm = tw.robots.planar_2r()
    found = identify(
        tw.Robot(_without_source(arm.model)), known_log(arm, 1, of=tw.Robot(_without_source(arm.model))).motion, **GIVEN
    )
    with pytest.raises(tw.ModelError, match="not read from a file"):
        found.write(tmp_path / "new.urdf")


def _without_source(model):
    from dataclasses import replace

    return replace(model, source="")


def test_what_no_file_holds_and_what_is_pulled_out_of_its_interval_is_told(tmp_path):
    """One motor that turns two joints has friction of its own, and a pull that is far too strong moves what the log tells."""
    arm = tw.robots.planar_2r()
    log = known_log(arm, 3, seconds=10.0, rate=100.0)
    side = tw.identification.MotorSide(np.array([[1.0, 0.0], [1.0, 1.0]]), np.zeros(2), np.ones(2))
    motors = tw.Motion(log.motion.time, log.motion.q, tau=log.motion.tau, robot=arm)
    found = tw.identification.identify(arm, motors, **GIVEN, motor_side=side)
    together = found.consistent.of_several_joints
    assert set(together) == {f"joint1+joint2.{kind}" for kind in ("motor_inertia", "viscous", "coulomb")}
    notes = " ".join(found.write(None, tmp_path / "new.yaml", force=True))
    assert "joint1+joint2.viscous" in notes and "joint1+joint2.viscous" in (tmp_path / "new.yaml").read_text("utf-8")
    plain = tw.identification.identify(arm, motors, **GIVEN)
    wide = plain.interval() + np.array([-9.0, 9.0])
    assert plain.consistent.outside(wide, plain.standard_deviations) == []
    pulled = plain.consistent_at(1e5)
    of_noise = plain.values[:, None] + np.outer(2.0 * plain.covariance.textbook, [-1.0, 1.0])
    (said,) = pulled.outside(of_noise, plain.covariance.textbook)
    assert "outside their 95 % intervals" in said


def test_the_page_shows_each_picture_and_friction_only_where_it_was_sought(tmp_path):
    log = known_log(tw.robots.planar_2r(), 3, seconds=10.0, rate=100.0).motion
    found = tw.identification.identify(tw.robots.planar_2r(), log, **GIVEN)
    page = found.report(tmp_path / "a.html").read_text("utf-8")
    assert page.count("<svg") == 7 and 'aria-label="Friction"' in page
    assert all(model in page for model in ("file, friction fitted", "identified", "physically consistent bodies"))
    bare = tw.identification.identify(tw.robots.planar_2r(), log, **GIVEN, friction=())
    page = bare.report(tmp_path / "b.html").read_text("utf-8")
    assert page.count("<svg") == 6 and 'aria-label="Friction"' not in page


def checked(scale, held_out, of_file):
    """Remarks on a robot whose bodies are those of the file times a scale, with these residuals."""
    base = BaseParameters.from_unknowns(UnknownParameters(tw.robots.ur5(), friction=()))
    values = scale * base.unknown.file_values
    found = ConsistentRobot(base, PositiveFit(1.0, values, 0.0, 0), ((1.0, held_out),), of_file, ())
    return " ".join(check_written(found))


def test_a_robot_that_got_much_lighter_or_heavier_is_remarked():
    assert checked(1.0, 0.05, 0.1) == ""
    mass = tw.robots.ur5().model.moving_mass
    for scale in (0.7, 1.3):
        remark = f"the moving bodies weigh {number(scale * mass)} kg, in the file {number(mass)} kg"
        assert remark in checked(scale, 0.05, 0.1)


def test_a_robot_is_written_if_it_is_as_good_as_the_file_in_either_sense():
    """Up to 5 % more of the residual of the file, or 0.2 % of the torques more."""
    for held_out, of_file in ((0.52, 0.50), (0.0025, 0.0010)):
        assert "explain rows held out as well" in checked(1.0, held_out, of_file)
    for held_out, of_file in ((0.53, 0.50), (0.0035, 0.0010)):
        with pytest.raises(tw.ValueRangeError, match="Nothing is written"):
            checked(1.0, held_out, of_file)


def test_words_about_groups_follow_from_their_values_and_deviations():
    """Three groups of value 1 with deviations of 0.5, 0.9 and 0.1; of two offsets only one is surely not zero."""
    found = SimpleNamespace(
        values=np.ones(3), standard_deviations=np.array([0.5, 0.9, 0.1]), groups=("a", "b", "c"),
        base=SimpleNamespace(held=np.zeros(3, bool)), covariance=GroupCovariance(np.eye(3), np.full(3, 5.0), np.ones(3), 1.0),
    )  # fmt: skip
    assert IdentifiedRobot.poorly_determined.fget(found) == ("b", "a")
    low, high = IdentifiedRobot.interval(found, 0.5).T
    np.testing.assert_allclose(high - low, 2.0 * stats.t.isf(0.25, 5.0))
    names = SimpleNamespace(model=SimpleNamespace(velocity_names=("j1", "j2", "j3")))
    offsets = SimpleNamespace(
        original=names, groups=("j1.offset", "j2.offset"), values=np.array([0.3, 0.4]),
        interval=lambda: np.array([[-0.1, 0.7], [0.2, 0.6]]),
    )  # fmt: skip
    assert IdentifiedRobot.offsets.fget(offsets) == {"j1": 0.0, "j2": 0.4}
