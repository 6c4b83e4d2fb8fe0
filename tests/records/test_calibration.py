"""Calibration: chain, targets, fits, groups and errors of an arm in which nothing is equal, on record."""

from __future__ import annotations

import functools
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from calibration_worlds import World, planar
from leaning_arm import leaning_arm, offset_arm, packed
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.calibration import held_out, instrument, targets
from twistwrench.calibration.chain import EFFECTS, Corrections, TipChain, point_columns
from twistwrench.calibration.fit import CalibrationProblem, Estimate, IndependentParameters
from twistwrench.calibration.groups import ParameterGroup, ParameterGroups, Remaining, _preference, fitted_in_groups
from twistwrench.calibration.held_out import configuration_labels, cross_validated, error_of_test
from twistwrench.calibration.measurements import KINDS, Measurements

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

ALL_KINDS = ("pose", "position", "distance", "pair", "point", "plane", "sphere")


@functools.cache
def chain_with(*assume):
    return TipChain.from_robot(offset_arm(), "tool", assume)


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


def some_corrections(chain, size=0.05):
    """Corrections in which every entry differs from all others."""
    n = len(chain.joints)
    tip = chain.start.tip @ np.asarray(tw.se3.exp(np.array([0.2, -0.3, 0.1, 0.04, 0.02, -0.03])))
    return Corrections(size * drawn(n, 6, seed=1), 0.1 * drawn(n, seed=2), 0.02 * drawn(n, seed=3), tip)


def some_configurations(robot, count, seed=4):
    return np.asarray(robot.random_configuration(seed, count))


# ── Chain


@records.of
def chain_of_an_arm_with_a_joint_beside_it():
    chain = chain_with("gears", "sag")
    names = "joints columns turning placements screws centres own axes loaded_joints parameters are_lengths moves_tip assume"
    found = {name: getattr(chain, name) for name in names.split()}
    found |= {f"placement of {k}": chain.placements[k] for k in range(4)}
    found |= {f"axes of {k}": chain.axes[k] for k in range(4)}
    found["start"] = chain.start
    return found


@records.of
def chains_to_other_tips_with_other_effects():
    robot = leaning_arm()
    found = {}
    for tip in ("hand", "arm", "claw", "boom", "tool"):
        for assume in ((), ("sag",), ("gears",), ("gears", "sag"), ("sag", "gears")):
            chain = TipChain.from_robot(robot, tip, assume)
            q = some_configurations(robot, 3)
            x = chain.scales(2.0, 3.0, 5.0, 7.0, (11.0, 13.0))
            found[f"{tip} {assume}"] = [
                chain.frame, chain.assume, chain.columns, chain.moves_tip, packed(chain.loads(q)), chain.loaded_joints,
                len(chain.parameters), chain.parameters[-8], packed(x), packed(chain.are_lengths), packed(chain.tips(q)),
            ]  # fmt: skip
    return found


MIMIC = """<robot name="m"><link name="a"/><link name="b"/><link name="c"/>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="k" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/><mimic joint="j" multiplier="2"/></joint>
</robot>"""


@records.of
def chains_that_cannot_be_calibrated():
    robot = leaning_arm()
    floating = tw.load(MIMIC.replace('type="continuous"', 'type="floating"', 1).split("<mimic")[0] + "</joint></robot>")
    return [
        refusal(lambda: TipChain.from_robot(robot)),
        refusal(lambda: TipChain.from_robot(robot, "plinth")),
        refusal(lambda: TipChain.from_robot(robot, "nose")),
        refusal(lambda: TipChain.from_robot(robot, "tool", ("gears", "wind", "heat"))),
        refusal(lambda: TipChain.from_robot(tw.load(MIMIC))),
        refusal(lambda: TipChain.from_robot(floating)),
        EFFECTS,
    ]


@records.of
def corrections_and_their_parameters():
    found = {}
    for assume in ((), ("sag",), ("gears",), ("gears", "sag")):
        chain = chain_with(*assume)
        at = some_corrections(chain)
        values = chain.values(at)
        back = chain.corrections(values)
        stepped = chain.step(at, 0.1 * drawn(len(values), seed=5))
        found[str(assume)] = {
            "values": values,
            "back": packed(back.displacements, back.gears, back.sags, back.tip),
            "stepped": packed(stepped.displacements, stepped.gears, stepped.sags, stepped.tip),
        }
    turns, shifts = chain.turns_and_shifts(at)
    return found | {"turns": turns, "shifts": shifts} | {f"bend {k}": D for k, D in enumerate(chain.bends(at))}


@records.of
def poses_and_columns_of_the_corrected_chain():
    found = {}
    for assume in ((), ("sag",), ("gears",), ("gears", "sag")):
        chain = chain_with(*assume)
        q = some_configurations(chain.robot, 3)
        at = some_corrections(chain)
        loads = chain.loads(q)
        T, J = chain.poses(q, loads, at)
        found[str(assume)] = [
            T,
            T[1],
            loads,
            J,
            J[2, :, 9],
            J[1, :, -3],
            J[0, :, -9],
            point_columns(T, J),
            chain.tips(q),
        ]
        found[f"{assume} tips"] = chain.tips(q, at)
    return found


@records.of
def robots_with_corrected_placements():
    found = {}
    for tip in ("tool", "hand", "claw"):
        chain = TipChain.from_robot(offset_arm(), tip, ("sag",))
        robot = chain.calibrated_robot(some_corrections(chain))
        q = some_configurations(robot, 2)
        found[tip] = [
            np.asarray(robot.forward_kinematics(q, frame=frame)) for frame in ("tool", "hand", "claw", "boom")
        ]
    return found


# ── Targets


@functools.cache
def target_of(kind, with_length=False):
    """A target of a kind at readings with errors of centimetres, poses of the tip there, and their columns."""
    chain = chain_with("gears")
    robot = chain.robot
    q = some_configurations(robot, 15)
    T, J = chain.poses(q, chain.loads(q), some_corrections(chain))
    X = np.asarray(tw.se3.exp(np.array([0.3, -0.2, 1.0, 2.0, -1.0, 0.5])))
    Y = X @ T @ np.asarray(tw.se3.exp(0.03 * drawn(15, 6, seed=6)))
    names = ["b", "a", "b", "c", "a", "c", "b", "b", "a", "c", "c", "b", "a", "b", "c"]
    options = {}
    if kind == "pose":
        options = {"poses": Y}
    elif kind == "position":
        options = {"positions": Y[:, :3, 3]}
    elif kind == "distance":
        options = {"distances": np.linalg.norm(T[:, :3, 3] - [0.2, 0.1, -1.5], axis=1) + 0.02 * drawn(15, seed=7)}
    elif kind == "pair":
        pairs = np.array([[0, 3], [5, 1], [2, 8], [7, 4]])
        far = np.linalg.norm(T[pairs[:, 0], :3, 3] - T[pairs[:, 1], :3, 3], axis=1)
        options = {"pairs": pairs, "distances": far + 0.02 * drawn(4, seed=8)}
    elif with_length and kind == "sphere":
        options = {"kind": kind, "length": 0.4, "targets": names}
    elif with_length:
        options = {"kind": kind, "length": 0.4, "targets": ["b" if name == "c" else name for name in names]}
    else:
        options = {"kind": kind, "targets": names}
    m = Measurements(q, **options)
    return targets.TARGETS[kind].from_tips(m, T), T, J


@records.of
def targets_of_all_kinds():
    found = {}
    for kind in ALL_KINDS:
        for with_length in (False, True) if kind in ("point", "plane", "sphere") else (False,):
            target, T, J = target_of(kind, with_length)
            k = len(target.names)
            rows = target.rows(T, J)
            moved = target.step(0.1 * drawn(k, seed=9)) if k else target.step(np.zeros(0))
            moved_rows = moved.rows(T, J)
            found[f"{kind} {with_length}"] = {
                "names": target.names,
                "unknowns": [getattr(target, name) for name in ("X", "centre", "x") if hasattr(target, name)],
                "residual": packed(rows.residual), "columns": packed(rows.columns), "own": packed(rows.own),
                "shapes": [rows.residual.shape, rows.own.shape, rows.columns.shape], "moved": packed(moved_rows.residual),
                "moved own": packed(moved_rows.own), "moved columns": packed(moved_rows.columns), "length": target.length_row(T, J), "length after": moved.length_row(T, J),
                "freedom": [target.freedom(5, 2), target.freedom(0, 3)], "frame": target.frame(), "after": moved.frame(),
                "angles": target.angles, "knows length": target.knows_length, "each": target.given.rows_each,
                "angle rows": target.given.angle_rows, "scaleless": target.given.is_scaleless,
            }  # fmt: skip
    return found


@records.of
def starts_of_touched_targets():
    p = np.array([[0.3, -0.2, 0.5], [0.7, 0.1, 0.45], [-0.4, 0.6, 0.55], [0.2, 0.9, 0.38], [0.5, -0.7, 0.62]])
    planes = {
        "above": p, "below": p - [0, 0, 1], "level": p * [1, 1, 0] + [0, 0, 0.25], "under": p * [1, 1, 0] - [0, 0, 0.25],
        "upright": p[:, [2, 0, 1]],
    }  # fmt: skip
    found = {name: targets.PlaneTarget.start(points) for name, points in planes.items()}
    found["point"] = targets.PointTarget.start(p)
    found["sphere"] = targets.SphereTarget.start(p)
    line = np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.3, 0.0, 0.0], [0.4, 0.0, 0.0]])
    found["no sphere"] = targets.SphereTarget.start(line)
    found["one point twice"] = targets._distances_and_directions(
        np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 4.0], [5e-10, 0, 0]])
    )
    return found


@records.of
def rotations_and_motions_between_points():
    M = drawn(3, 3, seed=10)
    mirrored = M @ np.diag([1.0, -1.0, 1.0])
    points = drawn(7, 3, seed=11)
    X = np.asarray(tw.se3.exp(np.array([0.8, -1.2, 0.5, 0.3, -0.6, 0.9])))
    places = points @ X[:3, :3].T + X[:3, 3] + 0.02 * drawn(7, 3, seed=12)
    R = np.asarray(tw.so3.exp(1.5 * drawn(8, 3, seed=13)))
    target = np.asarray(tw.so3.exp(np.array([0.5, -0.9, 1.3])))
    measured = X[:3, :3] @ R @ target
    one_axis = np.asarray(tw.so3.exp(np.outer(np.linspace(0.1, 1.9, 8), [0.2, 0.3, 0.9])))
    nearly = np.asarray(tw.so3.exp(np.outer(np.linspace(0.1, 1.9, 8), [0.2, 0.3, 0.9]) + 0.12 * drawn(8, 3, seed=14)))
    return {
        "nearest": [targets._nearest_rotation(M), targets._nearest_rotation(mirrored)],
        "motion": targets.rigid_motion(points, places),
        "mirrored": targets.rigid_motion(points, places @ np.diag([1.0, 1.0, -1.0])),
        "turn": targets.turn_of_target(measured, R),
        "turn of one axis": targets.turn_of_target(X[:3, :3] @ one_axis @ target, one_axis),
        "turn of nearly one axis": targets.turn_of_target(X[:3, :3] @ nearly @ target, nearly),
        "angle of that turn": float(np.trace(targets.turn_of_target(X[:3, :3] @ nearly @ target, nearly))),
    }


# ── Fit


def world(seed=1):
    """The arm as it is. It draws numbers, so each call makes its own."""
    return World.drawn(offset_arm(), seed, tip="tool")


@functools.cache
def readings(kind, count=24, seed=1):
    """Readings, of which the fifth is off by 40 mm."""
    m = world(seed=seed).measured(kind, count)
    off = np.eye(len(m.sizes) or len(m.points))[4] * 0.04
    if m.poses is not None:
        poses = m.poses.copy()
        poses[:, 0, 3] += off
        return replace(m, poses=poses)
    if m.positions is not None:
        return replace(m, positions=m.positions + off[:, None] * [1.0, -0.5, 0.7])
    return replace(m, distances=m.distances + off)


def solution(fit):
    """Everything about a fit."""
    at = fit.state.corrections
    return {
        "names": len(fit.names), "last names": fit.names[-5:], "displacements": packed(at.displacements, at.gears, at.sags),
        "tip": packed(at.tip, *(t.frame() for t in fit.state.targets)), "deviations": fit.deviations,
        "outliers": fit.outliers, "errors": packed(*fit.errors), "turns": packed(*fit.turns), "rms": fit.rms,
        "noise": fit.noise, "weights": packed(*fit.weights), "frames only": fit.frames_only,
    }  # fmt: skip


@records.of
def problems_before_the_first_iteration():
    found = {}
    for kinds in (("pose", "distance"), ("position",), ("pair", "pose"), ("distance",)):
        measured = tuple(readings(kind) for kind in kinds)
        chain = chain_with("gears", "sag")
        used = tuple(np.arange(m.count) % 4 != k for k, m in enumerate(measured))
        problem = CalibrationProblem(chain, measured, used=used)
        state = problem.start()
        equations = problem.equations(state)
        stepped = problem.step(state, 0.01 * drawn(equations.design[0].shape[2], seed=15))
        weights = problem._first_weights()
        found[str(kinds)] = {
            "targets": packed(state.corrections.tip, *(target.frame() for target in state.targets)),
            "residuals": packed(*equations.residuals), "design": equations.design, "lengths": equations.lengths,
            "stepped": packed(*problem.equations(stepped).residuals), "row": [w[0] for w in weights],
            "weighted": equations.weighted_rows(weights), "masks": problem.masks, "count": problem.count,
            "prior": np.diag(problem.prior), "loads": problem.loads, "scaleless": problem.is_scaleless,
            "freedom": [problem._freedom(equations, frames_only) for frames_only in (False, True)],
            "free": [problem.free(50, frames_only=True), problem.free(50, frames_only=False)],
        }  # fmt: skip
    return found


@records.of
def weights_of_readings():
    found = {}
    chain = chain_with()
    for kind in ("pose", "position", "distance"):
        for noise in (None, (0.003, 0.005)):
            for keep in (False, True):
                problem = CalibrationProblem(chain, (replace(readings(kind), noise=noise),), keep_outliers=keep)
                equations = problem.equations(problem.start())
                for frames_only in (False, True):
                    for trim in (False, True):
                        (W,) = problem._weights(equations, frames_only, trim=trim)
                        found[f"{kind} {noise} {keep} {frames_only} {trim}"] = [
                            packed(W),
                            np.flatnonzero(W[:, -1] == 0),
                        ]
    return found


@records.of(relative=1e-5)
def a_single_step_of_the_fit():
    found = {}
    problem = CalibrationProblem(chain_with("gears"), (readings("pose"), readings("distance")))
    state = problem.start()
    equations = problem.equations(state)
    weights = problem._first_weights()
    for damping in (0.0, 1e-3, 0.1, 5e-9):
        for frames_only in (False, True):
            new, _, new_damping, decrease = problem._step(state, equations, weights, damping, frames_only)
            values = problem.chain.values(new.corrections)
            frames = [target.frame() for target in new.targets]
            found[f"{damping} {frames_only}"] = [packed(values), packed(*frames), new_damping, decrease]
    return found


@records.of(relative=1e-5)
def a_step_that_raises_the_cost_first():
    """A turn of 2.5 rad of the tip: undamped steps overshoot."""
    problem = CalibrationProblem(chain_with(), (readings("pose"),))
    state = problem.start()
    chain = problem.chain
    far = Estimate(chain.step(state.corrections, 0.9 * drawn(len(chain.parameters), seed=16)), state.targets)
    found = {}
    for damping in (1e-4, 1e-2, 1.0):
        new, _, new_damping, decrease = problem._step(
            far, problem.equations(far), problem._first_weights(), damping, False
        )
        found[str(damping)] = [packed(chain.values(new.corrections)), new_damping, decrease]
    return found


@records.of(relative=1e-5)
def fits_of_single_kinds():
    found = {}
    for kind in ("pose", "position", "distance", "pair"):
        m = readings(kind, 56 if kind == "pair" else 28)
        problem = CalibrationProblem(chain_with(), (m,))
        found[kind] = solution(problem.solve())
        found[f"{kind}, frames"] = solution(problem.solve(frames_only=True))
    return found


@records.of(relative=1e-5)
def fits_of_kinds_together_with_effects():
    chain = chain_with("gears", "sag")
    first, second = readings("pose"), readings("distance")
    used = (np.arange(24) % 5 != 2, np.arange(24) % 7 != 3)
    found = {"all": solution(CalibrationProblem(chain, (first, second)).solve())}
    found["some"] = solution(CalibrationProblem(chain, (first, second), used=used).solve())
    found["kept"] = solution(CalibrationProblem(chain, (second, first), keep_outliers=True).solve())
    noisy = (replace(first, noise=(2e-4, 3e-4)), replace(second, noise=4e-4))
    found["noise"] = solution(CalibrationProblem(chain, noisy).solve())
    return found


def bent_world():
    """Five turning joints: enough to touch a point in many ways."""
    return World.drawn(planar(5), 3)


@functools.cache
def touches(kind, count, length=None):
    m = bent_world().touched(kind, count, targets=2)
    return replace(m, length=length) if length else m


@records.of(relative=1e-4)
def fits_of_touches():
    found = {}
    for kind, length in (("point", None), ("point", 0.1), ("plane", 0.1), ("sphere", 0.8)):
        m = touches(kind, 24 if kind == "point" else 44, length)
        problem = CalibrationProblem(bent_world().chain, (m,))
        start = problem.start()
        equations = problem.equations(start)
        found[f"{kind} {length}"] = {
            "start": [target.x for target in start.targets], "residual": equations.residuals, "lengths": equations.lengths,
            "length rows": equations.length_rows, "prior": np.diag(problem.prior), "scaleless": problem.is_scaleless,
            "freedom": problem._freedom(equations, False),
        }  # fmt: skip
    fit = CalibrationProblem(bent_world().chain, (touches("point", 24, 0.1),)).solve()
    found["fit"] = [fit.rms, fit.noise, fit.names[-6:], fit.equations.lengths]
    return found


@records.of
def prior_of_groups():
    independent = IndependentParameters((1, 3, 7), np.array([[0.5, 1.0, 0.0, 0.0, 2.0], [0.3, 0.0, -0.7, 1.0, 0.4]]))
    problem = CalibrationProblem(chain_with(), (readings("position"),), independent=independent)
    return [
        independent.prior(np.array([2.0, 3.0, 5.0, 7.0, 11.0])),
        problem.free(9, frames_only=False),
        problem.free(44, frames_only=True),
        problem.wide_deviations,
        CalibrationProblem(chain_with("sag", "gears"), (readings("pose"),)).wide_deviations,
        CalibrationProblem(chain_with("sag"), (Measurements(np.zeros((5, 5)), kind="plane"),)).wide_deviations,
    ]


# ── Groups


@functools.cache
def fit_of(*kinds, assume=(), grouped=False):
    fit = CalibrationProblem(chain_with(*assume), tuple(readings(kind, 28) for kind in kinds)).solve()
    return fitted_in_groups(fit) if grouped else fit


@records.of(relative=1e-4)
def groups_that_readings_determine():
    found = {}
    for kinds, assume in (
        (("pose",), ()),
        (("position", "pose"), ("gears",)),
        (("position",), ("sag",)),
        (("distance", "position"), ()),
    ):
        for grouped in (False, True):
            fit = fit_of(*kinds, assume=assume, grouped=grouped)
            groups = ParameterGroups(fit)
            found[f"{kinds} {assume} {grouped}"] = {
                "columns": groups.independent_columns, "rank": groups.rank, "theory": groups.theory, "freedom": groups.freedom,
                "variances": packed(groups.covariance.diagonal()), "covariance": packed(groups.covariance),
                "values": packed(groups.values), "terms": packed(groups.independent.terms),
                "texts": [group.text for group in groups.all], "units": [group.unit for group in groups.all],
                "deviations": packed([group.deviation for group in groups.all]),
                "fitted": fit.problem.independent is not None, "rms": fit.rms,
            }  # fmt: skip
    return found


@records.of
def group_texts_units_and_widths():
    found = {}
    for name, is_length in (("a.gear", False), ("a.sag", False), ("a.x", True), ("a.rx", False), ("a.zero", True)):
        group = ParameterGroup(name, {name: 1.0, "b.y": -0.03, "c.z": 3.71234}, 0.2, 0.3, 7.0, is_length)
        found[name] = [group.unit, group.text, group.half_width(), group.half_width(0.5), group.half_width(0.99)]
    few = ParameterGroup("tip.x", {"tip.x": 1.0}, 0.0, 1.0, 0.4, True)
    names = ["target.x", "target2.rz", "tip.rx", "j.zero", "j.x", "j.z", "j.gear", "j.sag", "j.rx", "j.ry", "k.tip.y"]
    return found | {"few": few.half_width(), "preference": {name: _preference(name) for name in names}}


@records.of(relative=1e-4)
def remaining_errors():
    found = {}
    for kinds, assume in ((("pose",), ()), (("position", "distance"), ("gears", "sag")), (("pair",), ())):
        fit = fit_of(*kinds, assume=assume)
        reference = some_configurations(fit.problem.chain.robot, 40, seed=17)
        remaining = Remaining(fit, reference, (0.7e-3, 1.9e-3))
        J, J_base = remaining._columns(reference[:2])
        A, _ = fit.weighted_rows
        found[f"{kinds} {assume}"] = {
            "wide": remaining.wide, "rms": remaining.rms, "by noise": remaining.by_noise, "worst": remaining.worst,
            "by file": remaining.by_file, "unseen": remaining.is_unseen, "squares": remaining.squares(reference[3:6]),
            "with more": remaining.squares(reference[3:6], added=A[:7] * 3.0), "columns": J, "base": J_base,
            "base motions": remaining._base_motions, "scaled": remaining._scaled_columns(reference[:2]),
        }  # fmt: skip
    return found


@records.of
def errors_that_readings_do_not_show():
    """Both sides of all four limits: ratio to the part by noise, 1 µm, share of the file's error, noise of a reading."""

    def unseen(rms, by_noise, by_file, noise):
        stub = SimpleNamespace(rms=rms, by_noise=by_noise, by_file=by_file, fit=SimpleNamespace(noise=noise))
        return Remaining.is_unseen.fget(stub)

    cases = [
        (3.0, 1.0, 40.0, 0.1), (3.01, 1.0, 40.0, 0.1), (1e-6, 1e-9, 1.0, 1.0), (1.01e-6, 1e-9, 1.0, 1.0), (0.5, 0.25, 5.0, 0.1),
        (0.51, 0.25, 5.0, 0.1), (0.5, 0.25, 1.0, 0.25), (0.51, 0.25, 1.0, 0.25), (0.51, 0.25, 1.0, 0.3), (0.51, 0.25, 6.0, 0.1),
    ]  # fmt: skip
    return {str(case): unseen(*case) for case in cases}


# ── Held-out errors


@records.of(relative=1e-5)
def held_out_errors():
    found = {}
    for kinds, seeds in ((("pose",), (0, 3)), (("position", "pair"), (0,))):
        fit = fit_of(*kinds)
        for seed in seeds:
            found[f"{kinds} {seed}"] = cross_validated(fit, seed)
    fit = fit_of("pose")
    other = readings("pose", 9, seed=1)
    here = world()
    remounted = replace(here, truth=replace(here.truth, tip=here.truth.tip @ np.asarray(tw.se3.exp(np.full(6, 0.01)))))
    found["test"] = error_of_test(fit, [other])
    found["two tests"] = error_of_test(fit, [other, readings("distance", 8)])
    found["remounted"] = error_of_test(fit, [remounted.measured("pose", 9)])
    few = fit_of("pose").problem.measured[0].taken(np.arange(3))
    found["few"] = refusal(lambda: cross_validated(CalibrationProblem(chain_with(), (few,)).solve(), 0))
    return found


@records.of
def labels_of_configurations():
    q = np.array([[0.3, 0.1], [0.5, 0.2], [0.3, 0.1 + 2e-10], [0.3, 0.1 + 3e-9], [0.7, 0.4], [0.5, 0.2]])
    distances = np.array([0.1, 0.2])
    return [
        configuration_labels(Measurements(q, positions=drawn(6, 3))),
        configuration_labels(Measurements(q, pairs=[[0, 1], [3, 4]], distances=distances)),
        configuration_labels(Measurements(q, pairs=[[0, 1], [2, 4]], distances=distances)),
        configuration_labels(Measurements(q[[1, 3, 4, 0]], pairs=[[3, 1], [0, 2]], distances=distances)),
        held_out.FOLDS,
    ]


# ── Errors of the instrument


def stub_of(fit):
    """What the tests of instruments read of a calibrated robot."""
    reference = some_configurations(fit.problem.chain.robot, 30, seed=17)
    groups = ParameterGroups(fit)
    return SimpleNamespace(fit=fit, parameter_groups=groups, remaining=Remaining(fit, reference, (1e-3, 2e-3)))


def scaled(m, factor=1.0, offset=0.0):
    if m.poses is not None:
        return replace(m, poses=tw.se3.pose(m.rotations, m.points * factor))
    if m.positions is not None:
        return replace(m, positions=m.positions * factor)
    return replace(m, distances=m.distances * factor + offset)


@records.of(relative=1e-4)
def scales_and_offsets_of_instruments():
    cases = {
        "right": (readings("position", 28),),
        "long": (scaled(readings("position", 28), 1.02),),
        "short": (scaled(readings("pose", 28), 0.985), scaled(readings("position", 28), 0.985)),
        "slightly": (scaled(readings("position", 28), 1.0035),),
        "offset": (scaled(readings("distance", 40), 1.0, 0.012),),
        "negative": (readings("position", 28), scaled(readings("pair", 56), 1.0, -0.015)),
        "both": (scaled(readings("distance", 40), 1.03, 0.004), readings("distance", 24)),
    }
    found = {}
    for name, measured in cases.items():
        stub = stub_of(CalibrationProblem(chain_with(), measured).solve())
        columns = [-(k + 1.0) * (m.points if len(m.points) else m.sizes[:, None]) for k, m in enumerate(measured)]
        found[name] = {
            "error": instrument._instrument_error(stub, columns)._asdict(),
            "scale": list(instrument._scale_error(stub)),
            "doubts": instrument.instrument_doubts(stub),
        }
    return found


def shaped(offered):
    """Causes with the shape of their sentences, which has the number of digits that they show."""
    return [[size, each, re.sub(r"\d", "0", str(each.doubt))] for size, each in offered]


@records.of
def scales_at_their_limits():
    found = {}
    for value, deviation in (
        (0.0301, 0.01),
        (0.0299, 0.01),
        (-0.0301, 0.01),
        (0.00505, 0.001),
        (0.00495, 0.001),
        (-0.2, 0.0123),
    ):
        with pytest.MonkeyPatch.context() as patch:
            error = instrument._InstrumentError(value, deviation, 0.5, 0.25)
            patch.setattr(instrument, "_instrument_error", lambda found, columns, error=error: error)
            found[f"{value} {deviation}"] = shaped(instrument._scale_error(stub_of(fit_of("pose"))))
    return found


@records.of
def offsets_at_their_limits():
    def offset(value, deviation, noise):
        error = instrument._InstrumentError(value, deviation, 0.5, 0.25)
        return shaped(instrument._offset_error(error, noise))

    cases = (
        (3.0, 1.0, 0.5),
        (3.03, 1.0, 0.5),
        (-3.03, 1.0, 0.5),
        (0.5, 0.125, 0.5),
        (0.51, 0.125, 0.5),
        (-0.51, 0.125, 0.5),
    )
    return {str(case): offset(*case) for case in cases}


@records.of(relative=1e-4)
def steps_of_targets_and_instruments():
    found = {}
    for kind in ("pose", "position", "distance"):
        here = world()
        m = here.measured(kind, 24)
        slip = tw.se3.exp(np.r_[0, 0, 0, 4, -2, 3] / 1e3)
        slipped_world = replace(here, truth=replace(here.truth, tip=here.truth.tip @ slip))
        after = slipped_world.readings(kind, m.q)
        is_after = np.arange(24) >= 15
        other = readings("position", 24)
        if kind == "pose":
            slipped = replace(m, poses=np.where(is_after[:, None, None], after.poses, m.poses))
            moved = replace(
                m, poses=np.where(is_after[:, None, None], tw.se3.exp(np.r_[2, 1, 3, 4, 5, 2] / 1e3) @ m.poses, m.poses)
            )
        elif kind == "position":
            slipped = replace(m, positions=np.where(is_after[:, None], after.positions, m.positions))
            moved = replace(m, positions=m.positions + np.outer(is_after, [0.004, -0.003, 0.005]))
        else:
            slipped = replace(m, distances=np.where(is_after, after.distances, m.distances))
            moved = slipped
        for name, measured in (
            ("none", (m,)),
            ("slipped", (slipped,)),
            ("moved", (moved,)),
            ("second", (other, moved)),
        ):
            stub = stub_of(CalibrationProblem(chain_with(), measured).solve())
            steps = [step._asdict() for k in range(len(measured)) for step in instrument._steps(stub, k)]
            found[f"{kind} {name}"] = [
                [step for step in steps if step["chance"] > 1e-200],
                instrument.step_doubts(stub),
            ]
    few = stub_of(
        CalibrationProblem(chain_with(), (readings("position", 28), readings("pose", 6).taken(np.arange(5)))).solve()
    )
    pairs = stub_of(CalibrationProblem(chain_with(), (readings("pair", 56),)).solve())
    found["too few"] = [step.row for step in instrument._steps(few, 1)]
    six = CalibrationProblem(chain_with(), (readings("position", 28), readings("pose", 6)))
    found["just enough"] = [[step.kind, step.row] for step in instrument._steps(stub_of(six.solve()), 1)]
    found["pairs"] = [step.row for step in instrument._steps(pairs, 0)]
    return found


@records.of
def kinds_of_readings():
    return KINDS


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
