"""Calibration: verdicts, doubts at both sides of their limits, other readings, reports and files, on record."""

from __future__ import annotations

import functools
import importlib
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from calibration_worlds import World
from leaning_arm import LEANING, leaning_arm, packed
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.calibration import doubts, poses, poses_view, readings_otherwise, result_view
from twistwrench.calibration.calibrate import _with_options, calibrate
from twistwrench.calibration.chain import TipChain
from twistwrench.calibration.fit import CalibrationProblem
from twistwrench.calibration.groups import ParameterGroup
from twistwrench.calibration.instrument import Offered
from twistwrench.calibration.measurements import Measurements, read_measurements, rotations_from_roll
from twistwrench.calibration.poses import measuring_poses
from twistwrench.calibration.result import CalibratedRobot
from twistwrench.calibration.write import write_geometry
from twistwrench.core.doubts import doubt, verdict_from_doubts
from twistwrench.mechanics.lie import quaternion

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
calibrate_module = importlib.import_module("twistwrench.calibration.calibrate")
factory = importlib.import_module("twistwrench.calibration.factory")  # the package has a function of this name


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


def stub(**fields):
    return SimpleNamespace(**fields)


# ── Doubts


def weights_of(used, rows, unused=0):
    return np.concatenate([np.ones((used, rows)), np.zeros((unused, rows))])


@functools.cache
def leaning_chain(tip="tool"):
    return TipChain.from_robot(leaning_arm(), tip)


@records.of
def doubts_about_effects_that_readings_do_not_show():
    def found(weights, rank, theory, unseen=False, scaleless=False, kind="position", last_turns=True, off=0.05):
        measured = [stub(kind=kind, rows_each=weights[0].shape[1])] + [stub(kind="distance", rows_each=1)] * (
            len(weights) - 1
        )
        screws = np.array([[0, 0, 1, 0, 0, 0.0], [0.6, 0, 0.8, 0.0, 0.3, 0.0]])
        chain = stub(turning=[True, last_turns], screws=screws, joints=("waist", "bend"))
        point = np.cross(screws[1, :3], screws[1, 3:]) + 0.7 * screws[1, :3] + off * np.array([0.8, 0.0, -0.6])
        tip = tw.se3.pose(np.eye(3), point)
        fit = stub(problem=stub(is_scaleless=scaleless, measured=measured, chain=chain), weights=weights)
        return stub(remaining=stub(rms=0.00123, is_unseen=unseen), fit=fit, rank=rank, theory=theory, tip_pose=tip)

    cases = {
        "enough": found([weights_of(18, 3, 4)], 27, 27),
        "one fewer": found([weights_of(17, 3, 4)], 27, 28),
        "two kinds": found([weights_of(9, 6, 1), weights_of(3, 1, 2)], 30, 30),
        "unseen": found([weights_of(18, 3)], 20, 20, unseen=True),
        "scaleless": found([weights_of(18, 1)], 9, 10, unseen=True, scaleless=True, kind="sphere"),
        "on the axis": found([weights_of(18, 3)], 25, 27, off=0.99e-3),
        "beside the axis": found([weights_of(18, 3)], 25, 27, off=1.01e-3),
        "poses on the axis": found([weights_of(18, 6)], 25, 27, off=0.0, kind="pose"),
        "sliding last": found([weights_of(18, 3)], 25, 27, off=0.0, last_turns=False),
    }
    return {name: list(doubts._unseen_effects(case)) for name, case in cases.items()}


@records.of
def doubts_about_errors_without_a_cause():
    def found(held_out, floor, remaining, before, remaining_before, unseen=False, right=False, tip=True):
        return stub(
            held_out=stub(rms=held_out), floor=floor, remaining=stub(rms=remaining, is_unseen=unseen), needs_nothing=right,
            before=before, remaining_before=remaining_before, measures_tip=tip,
        )  # fmt: skip

    cases = {
        "neither": found(0.002, 0.001, 0.001, 0.0031, 0.001),
        "unexplained": found(0.00202, 0.001, 0.001, 0.0031, 0.001),
        "little": found(0.001, 0.001, 0.001, 0.0029, 0.02),
        "little beside readings": found(0.001, 0.001, 0.001, 0.02, 0.0029, tip=False),
        "much beside readings": found(0.001, 0.001, 0.001, 0.0029, 0.0031, tip=False),
        "unseen": found(0.003, 0.001, 0.001, 0.0029, 0.02, unseen=True),
        "right": found(0.003, 0.001, 0.001, 0.0029, 0.02, right=True),
    }
    return {name: list(doubts._unexplained_errors(case)) for name, case in cases.items()}


def at_limits(*excess_by_row):
    """Readings whose joints exceed their upper limit, or with a negative sign their lower one, by shares of the range."""
    limits = leaning_arm().limits
    rows = []
    for row in excess_by_row:
        shares = np.array(row)
        ranges = limits.upper - limits.lower
        rows.append(np.where(shares > 0, limits.upper + shares * ranges, limits.lower + shares * ranges))
    return np.array(rows)


@records.of
def doubts_about_rows_that_contradict():
    def found(measured, outliers=()):
        return stub(
            original=leaning_arm(), outliers=list(outliers),
            fit=stub(problem=stub(chain=leaning_chain(), measured=measured, count=sum(m.count for m in measured))),
        )  # fmt: skip

    inside = np.asarray(leaning_arm().random_configuration(2, 40))
    places = drawn(40, 3, seed=1)
    q = inside.copy()
    q[[7, 12, 30]] = q[[3, 3, 29]]
    p = places.copy()
    p[[7, 12, 30]] = p[[3, 3, 29]] + [[0, 0.9e-9, 0], [0, 0, 1.2e-9], [0, 0, 0]]
    out = at_limits((0.09, 0.11, -0.11, 0.2, -0.09), (0.12, 0.3, -0.2, 0.2, -0.2), (0.12, -0.12, -0.14, 0.2, -0.2))
    far = Measurements(out, distances=np.array([0.5, 0.6, 0.7]))
    six = [(3, 0.01), (8, 0.008), (21, 0.0071), (22, 0.006), (25, 0.005), (29, 0.004)]
    doubled = Measurements(q, distances=np.where(np.isin(np.arange(40), [7, 12, 30]), p[[3] * 40, 0] + 5, p[:, 0] + 5))
    return {
        "nothing": list(doubts._contradictory_rows(found([Measurements(inside, positions=places)]))),
        "copies": list(doubts._contradictory_rows(found([Measurements(q, positions=p)]))),
        "copied distances": list(doubts._contradictory_rows(found([doubled]))),
        "touches": list(doubts._contradictory_rows(found([Measurements(q, kind="plane")]))),
        "limits": list(doubts._contradictory_rows(found([Measurements(inside, positions=places), far]))),
        "two outliers of 40": list(
            doubts._contradictory_rows(found([Measurements(inside, positions=places)], six[:2]))
        ),
        "three outliers of 40": list(
            doubts._contradictory_rows(found([Measurements(inside, positions=places)], six[:3]))
        ),
        "six outliers": list(doubts._contradictory_rows(found([Measurements(inside, positions=places)], six))),
    }


CAUSES = {
    "sag": Offered(0.5, doubt("calibration-sag", plain="2 mm", rms="1 mm")),
    "gears": Offered(0.7, doubt("calibration-gears", plain="2 mm", rms="1.4 mm")),
    "scale": Offered(0.96, doubt("calibration-scale", scale="1.02 ± 0.001")),
    "unseen": Offered(1.0, doubt("calibration-offset-unseen")),
    "half": Offered(0.94, doubt("calibration-offset", offset="3 mm too long")),
}


@records.of
def causes_that_are_named():
    orders = (
        "sag gears",
        "gears sag",
        "scale sag",
        "sag unseen",
        "scale unseen",
        "half gears",
        "unseen",
        "gears half scale",
        "",
    )
    return {
        order: [d.kind for d in doubts._causes_to_name([CAUSES[name] for name in order.split()])] for order in orders
    }


@records.of
def precedence_of_doubts():
    """Each source of doubts by one doubt; what the whole answer keeps, and in which order."""
    refusing = doubt("calibration-unit", words="mm", plain="1 m", misfit="1 mm")
    step = doubt("calibration-slipped", size="3 mm", row="7", left="20")
    own = doubt("calibration-own-kinematics", before="1")
    copy = doubt("calibration-duplicate", rows="7 of 3")
    note = doubt("calibration-outlier", level="note", rows="row 3 by 1 mm")
    seen = doubt("calibration-unseen", left="1 mm")
    unexplained = doubt("calibration-unexplained", held_out="2 mm", floor="1 mm")
    found = {}
    sources = "computed_doubts step_doubts reading_doubts effect_doubts instrument_doubts _contradictory_rows _unseen_effects _unexplained_errors"
    nothing = {function: [] for function in sources.split()}
    rest = {"_contradictory_rows": [note], "_unseen_effects": [seen], "_unexplained_errors": [unexplained]}
    cases = {
        "nothing": {},
        "computed": {"computed_doubts": [own], "step_doubts": [step], "reading_doubts": [refusing]},
        "steps": {"step_doubts": [step], "reading_doubts": [refusing], **rest},
        "readings": {"reading_doubts": [refusing], **rest},
        "copies": {"_contradictory_rows": [copy], "_unseen_effects": [seen]},
        "causes": {**rest, "effect_doubts": [CAUSES["sag"]], "instrument_doubts": [CAUSES["gears"]]},
        "second cause": {
            **rest,
            "effect_doubts": [CAUSES["gears"]],
            "instrument_doubts": [CAUSES["half"], CAUSES["sag"]],
        },
        "note alone": {**rest, "instrument_doubts": [CAUSES["unseen"]]},
        "rest": rest,
    }
    for name, case in cases.items():
        with pytest.MonkeyPatch.context() as patch:
            for function, answer in (nothing | case).items():
                patch.setattr(doubts, function, lambda _, answer=answer: list(answer))
            found[name] = [(d.kind, d.level) for d in doubts.doubts_of(None)]
    return found


# ── Other readings


@records.of
def readings_that_a_fit_explains():
    def found(rms=0.9e-3, angles=(0.019,), outliers=2, count=40, before=0.01, right=False):
        turns = [np.full(4, angle) for angle in angles] + [np.zeros(0)]
        fit = stub(rms=rms, turns=turns, outliers=[None] * outliers, problem=stub(count=count))
        return stub(fit=fit, before=before, needs_nothing=right)

    cases = {
        "all": found(), "rms": found(rms=1e-3, before=1.0), "below": found(rms=0.99e-3), "angle": found(angles=(0.001, 0.02)),
        "no angle": found(angles=()), "outliers": found(outliers=3), "small share": found(before=4.4e-3),
        "large share": found(before=4.6e-3), "right": found(before=4.4e-3, right=True), "right but large": found(rms=0.002, right=True),
    }  # fmt: skip
    return {name: readings_otherwise._explains_readings(case) for name, case in cases.items()}


@records.of
def zeros_that_are_large():
    def found(own, *rows):
        problem = stub(chain=stub(own=own))
        return stub(fit=stub(problem=problem, state=stub(corrections=stub(displacements=np.array(rows)))))

    small = [0.3, 0.3, 0.1, 0.4, 0.5, 0.6]
    cases = {
        "other entries": found([2, 2], small, small), "second": found([2, 1], small, small), "negative": found([2], [0, 0, -0.21, 0, 0, 0]),
        "at the limit": found([0], [0.2, 0, 0, 0, 0, 0.0]), "sliding": found([3, 5], small, small),
    }  # fmt: skip
    return {name: readings_otherwise._has_large_zero(case) for name, case in cases.items()}


def small_readings(kind):
    world = World.drawn(leaning_arm(), 1, tip="tool")
    return world.measured(kind, 8)


@records.of
def other_readings_and_what_they_change():
    found = {}
    for kinds in (("pose",), ("position", "distance"), ("pair",)):
        measured = tuple(map(small_readings, kinds))
        listed = []
        for other in readings_otherwise._alternatives(CalibrationProblem(leaning_chain(), measured)):
            changed = [other.change(m) for m in measured]
            arrays = [getattr(m, name) for m in changed for name in ("q", "poses", "positions", "distances")]
            sums = [round(float(np.sin(np.arange(a.size)) @ np.ravel(a)), 9) for a in arrays if a is not None]
            counts = [m.count for m in changed]
            listed.append([other.kind, *other.joints, other.value, other.unit, other.words, *counts, *sums])
        found[str(kinds)] = listed
    touches = CalibrationProblem(leaning_chain(), (Measurements(np.zeros((5, 5)), kind="plane"),))
    found["touches"] = [[other.kind, other.words] for other in readings_otherwise._alternatives(touches)]
    return found


@records.of
def changes_of_single_measurements():
    found = {}
    for kind in ("pose", "position", "distance", "pair"):
        m = small_readings(kind)
        m = replace(m, q=m.q[:4], poses=None if m.poses is None else m.poses[:4], positions=None if m.positions is None else m.positions[:4],
                    distances=None if m.distances is None else m.distances[: 2 if kind == "pair" else 4],
                    pairs=None if m.pairs is None else m.pairs[:2])  # fmt: skip
        for name, change in {
            "scale": lambda m: readings_otherwise._scale_readings(m, 0.0254),
            "plus": lambda m: readings_otherwise._q_plus(m, 2, 0.25),
            "exchange": lambda m: readings_otherwise._exchange_joints(m, 1, 4),
            "late": lambda m: readings_otherwise._shift_rows(m, 1),
            "early": lambda m: readings_otherwise._shift_rows(m, -1),
            "mirror": readings_otherwise._mirror_readings,
            "inverse": lambda m: readings_otherwise._change_poses(m, tw.se3.inverse),
        }.items():
            other = change(m)
            readings = other.poses if other.poses is not None else other.points if len(other.points) else other.sizes
            found[f"{kind} {name}"] = [other.q[0], other.q[-1], packed(readings)]
    T = small_readings("pose").poses[:2]
    for shift in (-1, 1):
        found[f"roll {shift}"] = readings_otherwise._roll_quaternions(T, shift)[1]
    return found | {words: read(T)[1] for words, read in readings_otherwise._ANGLE_CONVENTIONS.items()}


@records.of
def other_reading_that_is_chosen():
    """Misfits of the frames alone and of full fits, by rank; what is chosen."""

    def chosen(frames, full, as_given):
        others = [readings_otherwise.Alternative("sign", (name,), None) for name in "abcdef"]
        fits = [readings_otherwise._FrameFit(misfit, rank, others[rank]) for rank, misfit in frames]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                readings_otherwise, "_fits_of_frames", lambda _: sorted(fits, key=lambda fit: (fit.misfit, fit.rank))
            )
            patch.setattr(readings_otherwise, "_misfit_with", lambda _, other, frames_only: full[other.joints[0]])
            best = readings_otherwise._best_alternative(None, as_given)
            convention = readings_otherwise._best_convention(None, as_given)
        return [pair and (pair[0].joints[0], pair[1]) for pair in (best, convention)]

    frames = [(4, 0.004), (1, 0.005), (2, 0.0059), (0, 0.0062), (3, 0.0001)]
    return {
        "the more usual of equal ones": chosen(
            frames, {"d": 0.0021, "e": 0.0029, "b": 0.0015, "c": 1.0, "a": 0.0}, 0.1
        ),
        "the least one": chosen(frames, {"d": 0.0021, "e": 0.0032, "b": 0.008, "c": 1.0, "a": 0.0}, 0.1),
        "equal below a millimetre": chosen(frames, {"d": 0.00099, "e": 0.0005, "b": 0.0001, "c": 1.0, "a": 0.0}, 0.1),
        "above a millimetre": chosen(frames, {"d": 0.00099, "e": 0.00101, "b": 0.00102, "c": 1.0, "a": 0.0}, 0.1),
        "frames far apart": chosen([(4, 0.004), (1, 0.0061), (2, 0.0062)], {"e": 0.001, "b": 0.001, "c": 0.001}, 0.1),
        "frames near": chosen([(4, 0.004), (1, 0.0059), (2, 0.0062)], {"e": 0.001, "b": 0.001, "c": 0.001}, 0.1),
        "half the misfit": chosen(frames, {"d": 0.0021, "e": 0.004, "b": 0.003}, 0.00421),
        "not half of it": chosen(frames, {"d": 0.0021, "e": 0.004, "b": 0.003}, 0.00419),
        "too large": chosen(frames, {"d": 0.0101, "e": 0.02, "b": 0.03}, 0.1),
        "large": chosen(frames, {"d": 0.0099, "e": 0.02, "b": 0.03}, 0.1),
        "convention": chosen([(0, 0.0199), (1, 0.3)], {"a": 1.0, "b": 1.0}, 0.1),
        "no convention": chosen([(0, 0.0201), (1, 0.3)], {"a": 1.0, "b": 1.0}, 0.1),
    }


@records.of
def doubts_about_other_readings():
    other = readings_otherwise.Alternative("zero", ("elbow",), None, 90.0, "°", "90")

    def found(explained, large, best, convention, misfits):
        left = list(misfits)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(readings_otherwise, "_explains_readings", lambda _: explained)
            patch.setattr(readings_otherwise, "_has_large_zero", lambda _: large)
            patch.setattr(readings_otherwise, "_best_alternative", lambda problem, misfit: best)
            patch.setattr(readings_otherwise, "_best_convention", lambda problem, misfit: convention)
            patch.setattr(readings_otherwise, "_misfit", lambda fit: left.pop(0))
            patch.setattr(CalibrationProblem, "solve", lambda self, *a, **k: None)
            problem = CalibrationProblem(leaning_chain(), ())
            return readings_otherwise.reading_doubts(stub(fit=stub(problem=problem), plain=None))

    return {
        "explained": found(True, False, (other, 0.001), (other, 0.001), [0.5]),
        "large zero": found(True, True, None, (other, 0.0012), [0.5]),
        "large zero, no convention": found(True, True, (other, 0.001), None, [0.5]),
        "other": found(False, False, (other, 0.0013), None, [0.4]),
        "wrong robot": found(False, True, None, (other, 0.0012), [0.0102]),
        "not wrong": found(False, False, None, None, [0.0099]),
    }


@records.of
def doubts_about_computed_readings():
    cases = {"computed": (4.9e-6, True), "measured": (5.1e-6, True), "distances": (4.9e-6, False)}
    return {
        name: readings_otherwise.computed_doubts(stub(before=before, measures_tip=tip))
        for name, (before, tip) in cases.items()
    }


@records.of
def effects_that_are_offered():
    def found(assume, rms_by_assume, rows, rank=10, fails=()):
        chain = TipChain.from_robot(leaning_arm(), "tool", assume)
        problem = CalibrationProblem(chain, ())
        fit = stub(problem=problem, weights=[weights_of(rows // 3, 3, 5)])
        asked = []

        def solve(self, *_, **__):
            if self.chain.assume[-1:] == tuple(fails):
                raise np.linalg.LinAlgError
            return self

        def cross_validated(fit, seed):
            key = fit.chain.assume if isinstance(fit, CalibrationProblem) else assume
            asked.append([*key, seed])
            return stub(rms=rms_by_assume[" ".join(key)])

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(CalibrationProblem, "solve", solve)
            patch.setattr(readings_otherwise, "fitted_in_groups", lambda fit: fit)
            patch.setattr(readings_otherwise, "cross_validated", cross_validated)
            offered = list(readings_otherwise.effect_doubts(stub(fit=fit, settings={"seed": 3}, rank=rank)))
        return [offered, asked]

    rms = {"": 0.001, "sag": 0.00079, "gears": 0.0005, "sag gears": 0.0004, "gears sag": 0.0007}
    return {
        "sag": found((), rms, 60), "gears": found((), rms | {"sag": 0.00081}, 60), "neither": found((), rms | {"sag": 1, "gears": 0.00081}, 60),
        "sag assumed": found(("sag",), rms, 60), "too few": found((), rms, 27), "just enough": found((), rms, 30, rank=11),
        "failed": found((), rms, 60, fails=("sag",)), "gears assumed": found(("gears",), rms, 60),
    }  # fmt: skip


# ── Results


def calibrated_from(folder, **options):
    path = folder / "leaning.urdf"
    path.write_text(LEANING)
    robot = tw.load(path)
    world = World.drawn(robot, 1, tip="tool")
    return calibrate(robot, world.measured("position", 34), tip="tool", **options)


def lines_of(path):
    """Lines of a file, without the day and the version of the signature."""
    return re.sub(r"calibrate \S+, \d{4}-\d\d-\d\d", "calibrate VERSION, DATE", path.read_text()).splitlines()


@records.of(relative=1e-4)
def calibration_with_positions_and_its_files(folder):
    found = calibrated_from(folder)
    data = found.to_dict()
    changed = [line for line in lines_of(found.write(folder / "mine.urdf")) if line not in LEANING.splitlines()]
    numbers = [float(x) for line in changed for x in re.findall(r"(?<=[\" ])-?\d+\.\d+(?:e-?\d+)?", line)]
    back = tw.load(folder / "mine.urdf")
    q = np.asarray(back.random_configuration(5, 4))
    residuals = [line.split(",") for line in lines_of(found.to_csv(folder / "residuals.csv"))]
    headless = [[float(cell or -1) for cell in row] for row in residuals[1:]]
    named = (
        "doubts",
        "before",
        "held_out",
        "remaining",
        "remaining_before",
        "rank",
        "theory",
        "zeros",
        "sag",
        "gears",
        "settings",
    )
    return {
        "text": str(found).splitlines(), "brief": found.brief, "repr": repr(found), "facts": dict(found.facts()),
        **{name: data[name] for name in named}, "groups": [[g["name"], g["unit"]] for g in data["groups"]],
        "bounds": np.array([[g["value"], g["low"], g["high"]] for g in data["groups"]]).ravel(),
        "tip": np.array(data["tip_pose"]), "target": np.array(data["target_pose"]),
        "sources": {name: str(path) for name, path in found.sources().items()}, "subject": found.subject,
        "interval": found.interval(0.5), "remaining at": found.remaining_at(q), "residuals": found.residuals,
        "vectors": found.error_vectors, "floor": found.floor, "right": found.needs_nothing, "note": found.tip_note,
        "changed lines": len(changed), "numbers": len(numbers), "poses": back.forward_kinematics(q, frame="tool"),
        "csv head": residuals[0], "csv": np.array(headless), "deviations": found.standard_deviations, "values": found.values,
    }  # fmt: skip


@records.of(relative=1e-4)
def calibration_of_two_kinds_with_options(folder):
    """Distances and poses, gears assumed, a known noise, outliers kept, the link's own frame as the tip, readings held out."""
    robot = leaning_arm()
    world = World.drawn(robot, 2, tip="hand", ball=tw.se3.pose(np.eye(3), [0.11, -0.07, 0.05]))
    measured = [world.measured("distance", 20), world.measured("pose", 22)]
    distances = measured[0].distances.copy()
    distances[7] += 0.02
    measured[0] = replace(measured[0], distances=distances)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(doubts, "effect_doubts", lambda _: [])  # two further fits, each with six folds
        found = calibrate(
            robot, measured, tip="hand", assume="gears", noise=(1e-4, 3e-4), file_accuracy=(2e-3, 3e-3), outliers="keep", seed=4,
            test=world.measured("position", 9),
        )  # fmt: skip
    data = found.to_dict()
    named = (
        "doubts",
        "before",
        "held_out",
        "remaining",
        "remaining_before",
        "rank",
        "theory",
        "gears",
        "settings",
        "outliers",
    )
    return {
        "text": str(found).splitlines(), "facts": dict(found.facts()), **{name: data[name] for name in named},
        "note": found.tip_note, "subject": found.subject, "groups": found.groups, "points": [len(v) for v in found.error_vectors],
        "refused": refusal(lambda: found.write(folder / "no.urdf")) if not found.verdict.ok else "",
    }  # fmt: skip


@records.of
def geometries_in_robot_files(folder):
    """URDF and MJCF, with and without a frame that is fixed to the last link, and fixed links between joints."""
    between = LEANING.replace(
        '<parent link="arm"/><child link="hand"/>', '<parent link="wrist"/><child link="hand"/>'
    ).replace(
        "</robot>",
        '<link name="wrist"/><joint name="stay" type="fixed"><parent link="arm"/><child link="wrist"/>'
        '<origin xyz="0.01 0.02 0.03" rpy="0.1 0.2 0.3"/></joint></robot>',
    )
    (folder / "plain.urdf").write_text(LEANING)
    (folder / "between.urdf").write_text(between)
    tw.save(leaning_arm(), folder / "arm.xml")
    found = {}
    for name, tip in (
        ("plain.urdf", "tool"),
        ("plain.urdf", "hand"),
        ("plain.urdf", "claw"),
        ("between.urdf", "tool"),
        ("arm.xml", "hand"),
    ):
        original = tw.load(folder / name)
        chain = TipChain.from_robot(original, tip)
        values = 0.01 * drawn(len(chain.parameters), seed=3)
        values[6:12] = 0.0  # the second joint stays as it is
        calibrated = chain.calibrated_robot(chain.corrections(values))
        path = write_geometry(original, calibrated, tip, folder / f"new_{tip}_{name}", "a -- summary")
        q = np.asarray(original.random_configuration(6, 3))
        frames = [frame for frame in ("tool", "hand", "claw", "arm", "boom") if frame in original.model.frames]
        lines = lines_of(path)
        old = set((folder / name).read_text().splitlines())
        found[f"{name} {tip}"] = [
            packed(*(tw.load(path).forward_kinematics(q, frame=frame) for frame in frames)), packed(calibrated.forward_kinematics(q, frame=tip)),
            len([line for line in lines if line not in old]), [line.strip() for line in lines if "VERSION" in line],
        ]  # fmt: skip
    bare = tw.from_screws(np.eye(4), np.array([[0, 0, 1, 0, 0, 0.0]]).T, [np.eye(4)] * 2, [np.eye(6)], name="s")
    found["no file"] = refusal(lambda: write_geometry(bare, bare, str(bare.tip), folder / "a.urdf", ""))
    return found


@records.of(relative=1e-4)
def calibration_from_two_files(folder):
    robot = leaning_arm()
    world = World.drawn(robot, 3, tip="tool")
    paths = []
    for k, kind in enumerate(("position", "distance")):
        m = world.measured(kind, 16)
        readings = m.positions if kind == "position" else m.distances[:, None]
        head = "waist,slide,elbow,finger,bend," + ("x,y,z" if kind == "position" else "distance")
        rows = [",".join(map(repr, map(float, row))) for row in np.c_[m.q, readings]]
        paths.append(folder / f"m{k}.csv")
        paths[-1].write_text("\n".join([head, *rows]) + "\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            calibrate_module, "doubts_of", lambda _: [doubt("calibration-unit", words="mm", plain="1 m", misfit="1 mm")]
        )
        found = calibrate(robot, paths, tip="tool", noise=(1e-4, 2e-4), seed=2)
    return [
        {name: str(path) for name, path in found.sources().items()}, found.settings, found.before, found.held_out.rms, found.subject, found.fit.deviations,
        refusal(lambda: found.write(folder / "a.urdf")), [len(e) for e in found.residuals], str(found.headline),
    ]  # fmt: skip


@records.of
def arguments_that_are_refused():
    robot = leaning_arm()
    few = Measurements(np.array([[1.0] * 5, [2.0] * 5]), positions=drawn(2, 3))
    return {
        "outliers": refusal(lambda: calibrate(robot, few, tip="tool", outliers="drop")),
        "number": refusal(lambda: calibrate(robot, 3.5, tip="tool")),
        "nothing": refusal(lambda: calibrate(robot, [], tip="tool")),
        "few": refusal(lambda: calibrate(robot, few, tip="tool")),
        "wide": refusal(lambda: calibrate(robot, Measurements(np.ones((4, 3)), positions=drawn(4, 3)), tip="tool")),
        "list of numbers": refusal(lambda: calibrate(robot, [3], tip="tool")),
        "accuracy": refusal(lambda: calibrate(robot, few, tip="tool", file_accuracy=(0.0, 1.0))),
        "tip": refusal(lambda: calibrate(robot, few)),
        "read": refusal(lambda: read_measurements(3, robot, None, None)),
    }


@records.of
def options_of_the_call_and_of_measurements():
    plain = Measurements(np.zeros((4, 5)) + np.arange(4)[:, None], kind="sphere")
    own = replace(plain, length=0.3, noise=(0.1, 0.2))
    found = [_with_options(m, length, noise) for m in (plain, own) for length in (None, 0.7) for noise in (None, 0.05)]
    return [[m.length, m.noise] for m in found]


@records.of
def files_that_need_nothing():
    def right(unseen=False, remaining_before=0.9e-3, by_file=3e-3, before=1.9e-3, floor=1e-3):
        found = stub(
            remaining=stub(is_unseen=unseen, by_file=by_file),
            remaining_before=remaining_before,
            before=before,
            floor=floor,
        )
        return CalibratedRobot.needs_nothing.fget(found)

    return {
        "right": right(), "unseen": right(unseen=True), "file": right(remaining_before=1.01e-3), "at a third": right(remaining_before=1e-3),
        "before": right(before=2.01e-3), "at twice": right(before=2e-3), "predicted": right(remaining_before=2.01e-3, by_file=1.0),
        "far": right(remaining_before=1.9e-3, by_file=1.0),
    }  # fmt: skip


def view_stub(**fields):
    """What the report's lines read of a result."""
    chain = stub(joints=("waist", "slide", "elbow"), turning=[True, False, True], frame="tool")
    measured = [stub(kind=kind, notes=()) for kind in fields.pop("kinds", ("position",))]
    base = {
        "held_out": stub(rms=2.3e-4, max=5.1e-4, poses=34, note=""), "before": 3.4e-3, "remaining": stub(rms=1.7e-4, worst=4.4e-4),
        "remaining_before": 2.9e-3, "measures_tip": True, "zeros": {}, "needs_nothing": False, "reference": np.zeros((500, 2)),
        "fit": stub(problem=stub(measured=measured, chain=chain, count=34)),
        "verdict": verdict_from_doubts(()),
    }  # fmt: skip
    return stub(**(base | fields))


@records.of
def lines_of_the_report():
    zeros = {"waist": (0.02, 0.003), "slide": (-0.03, 0.0011), "elbow": (-0.025, 0.004)}
    turning = {"waist": (0.02, 0.003), "elbow": (-0.025, 0.004)}
    few = doubt("calibration-few", rows=20, rank=27, more=4)
    unseen = doubt("calibration-unseen", left="1 mm")
    cases = {
        "plain": view_stub(), "sliding": view_stub(zeros=zeros), "turning": view_stub(zeros=turning),
        "predicted": view_stub(remaining=stub(rms=4.7e-4, worst=1e-3)), "not predicted": view_stub(remaining=stub(rms=4.5e-4, worst=1e-3)),
        "rounding": view_stub(held_out=stub(rms=1e-8, max=2e-8, poses=3), remaining=stub(rms=0.9e-6, worst=1e-6)),
        "distances": view_stub(kinds=("distance", "pair"), measures_tip=False, zeros=turning),
        "touches": view_stub(kinds=("plane", "sphere"), measures_tip=False), "mixed": view_stub(kinds=("plane", "pose"), measures_tip=False),
        "right": view_stub(needs_nothing=True), "right touches": view_stub(needs_nothing=True, measures_tip=False, kinds=("point",)),
        "unsure": view_stub(verdict=verdict_from_doubts([few, unseen]), zeros=turning),
        "unsure distances": view_stub(verdict=verdict_from_doubts([few]), measures_tip=False, kinds=("distance",)),
    }  # fmt: skip
    found = {}
    for name, case in cases.items():
        headline = result_view._headline(case)
        titles = [table.title for table in result_view._error_tables(case)]
        found[name] = [result_view.noun_of_readings(case), result_view.figures(case), headline_lines(headline), titles]
    return found


def headline_lines(headline):
    further = ["".join(map(str, line.pieces)) for line in headline.further]
    return [str(headline.word), headline.sentence, list(headline.reasons), further]


@records.of
def figures_of_groups():
    found = {}
    for name, is_length in (
        ("a.gear", False),
        ("a.sag", False),
        ("a.x", True),
        ("a.zero", True),
        ("a.zero", False),
        ("a.ry", False),
    ):
        group = ParameterGroup(name, {name: 1.0}, 0.0123, 0.0007, 31.0, is_length)
        found[f"{name} {is_length}"] = result_view._group_figures(group)
    return found


@records.of
def notes_about_the_tip():
    def note(tip, moves, shift):
        chain = stub(
            start=stub(tip=tw.se3.exp(np.array([0.1, 0.2, 0.3, 1, 2, 3]))),
            moves_tip=moves,
            frame="hand",
            joints=("a", "b"),
        )
        pose = chain.start.tip @ tw.se3.pose(tw.so3.exp(np.array([0.4, 0, 0])), shift)
        return CalibratedRobot.tip_note.fget(stub(fit=stub(problem=stub(chain=chain)), tip_pose=pose))

    return [note("hand", False, [0.01, -0.02, 0.0301]), note("tool", True, [0.01, 0, 0]), note("hand", False, [0.9e-6, 0, 0]),
            note("hand", False, [0, 1.1e-6, 0])]  # fmt: skip


# ── Measurements


@records.of
def measurements_from_arrays():
    q = np.arange(20.0).reshape(4, 5) / 7
    p, T = drawn(4, 3), np.asarray(tw.se3.exp(drawn(4, 6, seed=1)))
    names = ["b", "a", "b", "c"]
    made = {
        "poses": Measurements(q, poses=T, noise=0.1), "positions": Measurements(q, positions=p, noise=(0.1, 0.2)),
        "both": Measurements(q, poses=T, positions=p), "distances": Measurements(q, distances=[0.5, 0.6, 0.7, 0.8]),
        "pairs": Measurements(q, pairs=[[0, 2], [3, 1]], distances=[0.5, 0.6]), "point": Measurements(q, kind="point", targets=names),
        "plane": Measurements(q, kind="plane", targets="abba", length=0.3), "sphere": Measurements(q, kind="sphere", length=0.4),
    }  # fmt: skip
    found = {}
    for name, m in made.items():
        some = m.taken(np.array([1]) if m.pairs is not None else np.array([2, 0]))
        mask = m.taken(np.arange(m.count) > 0)
        found[name] = [
            m.kind, len(m), m.count, m.target_names, m.target_index, m.points, m.rotations.shape, m.sizes, m.rows_each, m.angle_rows,
            m.is_scaleless, m.noise, m.length, [some.q[:, 0], some.points, some.sizes, some.pairs, some.targets], [mask.count, mask.sizes],
        ]  # fmt: skip
    return found


@records.of
def arrays_that_are_refused():
    q = np.arange(20.0).reshape(4, 5) / 7
    p = drawn(4, 3)
    far = np.full((4, 3), 1.0)
    far[2, 1] = -1.1e6
    given = {
        "none": {}, "kind": {"kind": "line", "positions": p}, "few positions": {"positions": p[:3]}, "no poses": {"kind": "pose"},
        "few distances": {"distances": [1.0, 2.0]}, "pairs": {"pairs": [[0, 1]], "distances": [1.0, 2.0]}, "no pairs": {"kind": "pair"},
        "far": {"positions": far}, "targets": {"kind": "plane", "targets": "abc"}, "rows": {"pairs": [[0, 4]], "distances": [1.0]},
        "negative row": {"pairs": [[0, 1], [-1, 2]], "distances": [1.0, 2.0]}, "touch": {"kind": "plane", "distances": [1.0] * 4},
        "zero": {"distances": [1.0, 0.0, 2.0, -1.0]}, "length": {"positions": p, "length": 0.1}, "one plane": {"kind": "plane", "length": 0.1},
        "three points": {"kind": "point", "targets": "abcb", "length": 0.2}, "noise": {"positions": p, "noise": (0.1, -0.2)},
    }  # fmt: skip
    found = {name: refusal(lambda options=options: Measurements(q, **options)) for name, options in given.items()}
    same = q.copy()
    same[3] = same[1] + 0.9e-9
    pairs = {"pairs": [[0, 2], [1, 3]], "distances": [1.0, 2.0]}
    found["one configuration"] = refusal(lambda: Measurements(same, **pairs))
    same[3, 2] += 1.2e-9
    found["at the largest size"] = (
        Measurements(same, **pairs, noise=0.1).count,
        Measurements(q, distances=[1e6] * 4).count,
    )
    return found


JOINTS = "waist,slide,elbow,bend"
ROWS = ["0.1,0.2,-0.3,0.4", "0.5,-0.1,0.7,-0.8", "-0.9,0.05,1.1,1.2", "1.3,0.15,-1.5,1.6"]


def csv_of(folder, head, cells, joints=JOINTS, name="m.csv"):
    path = folder / name
    path.write_text(
        "\n".join([f"{joints},{head}", *(f"{row},{more}" for row, more in zip(ROWS, cells, strict=False))]) + "\n"
    )
    return path


@records.of
def measurements_from_files(folder):
    robot = leaning_arm()
    turn = [f"{x},{y},{z}" for x, y, z in drawn(4, 3, seed=2)]
    place = [f"{x},{y},{z}" for x, y, z in drawn(4, 3, seed=3)]
    units = [np.asarray(quaternion.from_matrix(tw.so3.exp(w))) for w in drawn(4, 3, seed=4)]
    quaternions = [",".join(map(str, unit * (1 + 0.0009 * (-1) ** k))) for k, unit in enumerate(units)]
    matrices = [",".join(map(str, (tw.so3.exp(w) + 3e-4 * drawn(3, 3, seed=5)).ravel())) for w in drawn(4, 3, seed=4)]
    both = [f"{a},{b}" for a, b in zip(place, turn, strict=True)]
    files = {
        "position": ("x,y,z", place), "mm": ("y [mm],x [mm],z [cm]", place), "distance": ("distance", ["0.5", "0.6", "0.7", "0.8"]),
        "distance in": ("distance [mm]", ["500", "600", "700", "800"]), "vector": ("x,y,z,rx,ry,rz", both),
        "vector in degrees": ("x,y,z,rx [deg],ry [deg],rz [rad]", both), "roll": ("x,y,z,roll,pitch,yaw", both),
        "quaternion": ("x,y,z,qx,qy,qz,qw", [f"{a},{b}" for a, b in zip(place, quaternions, strict=True)]),
        "matrix": ("X,Y,Z,r11,r12,r13,r21,r22,r23,r31,r32,r33", [f"{a},{b}" for a, b in zip(place, matrices, strict=True)]),
        "board": ("board_in_camera_x,board_in_camera_y,Board_In_Camera_z", place), "pair": ("distance,pair", ["0.5,2", "0.6,3", "0.5,0", "0.6,1"]),
        "self": ("distance,pair", ["0.5,3", "0.6,1", "0.7,2", "0.5,0"]), "other columns": ("x,time,y,z", [p.replace(",", ",9,", 1) for p in place]),
    }  # fmt: skip
    found = {}
    for name, (head, cells) in files.items():
        path = csv_of(folder, head, cells)
        for degrees in (False, True):
            m = Measurements.from_file(path, robot, tip="tool", degrees=degrees)
            readings = m.poses[:, :3].ravel() if m.poses is not None else m.points if len(m.points) else m.sizes
            found[f"{name} {degrees}"] = [
                m.kind,
                m.q[1],
                packed(readings),
                m.pairs,
                m.notes,
                m.board_in_camera,
                str(m.path),
            ]
    for kind in ("point", "plane", "sphere"):
        m = Measurements.from_file(csv_of(folder, "target", ["u", "v", "u", "w"]), robot, tip="tool", kind=kind)
        found[kind] = [m.kind, m.targets, m.q[1]]
    m = Measurements.from_file(csv_of(folder, "x,y,z", place), robot, tip="tool", kind="plane")
    found["places that are touched"] = [m.kind, m.positions]
    m = Measurements.from_file(
        csv_of(folder, "x,y,z", place, "waist,slide,J3 [deg],bend"), robot, tip="tool", columns={"elbow": "J3 [deg]"}
    )
    found["named column"] = m.q
    m = Measurements.from_file(csv_of(folder, "x,y,z", place, "bend,elbow,slide,waist"), robot, tip="arm")
    found["only the way to the tip"] = [m.q, m.notes]
    m = Measurements.from_file(csv_of(folder, "finger,x,y,z", [f"0.01,{p}" for p in place]), robot)
    found["all joints without a tip"] = [m.q, m.notes]
    m = Measurements.from_file(csv_of(folder, "finger,x,y,z", [f"0.01,{p}" for p in place]), robot, tip="tool")
    found["a joint beside the way"] = [m.q, m.notes]
    return found


@records.of
def files_that_are_refused(folder):
    robot = leaning_arm()
    four = ["1,2,3"] * 4

    def read(head, cells, joints=JOINTS, **options):
        path = csv_of(folder, head, cells, joints)
        return refusal(lambda: Measurements.from_file(path, robot, **({"tip": "tool"} | options)))

    return {
        "no rows": read("x,y,z", []), "no reading": read("a,b,c", four), "target alone": read("target", ["u"] * 4),
        "kind": read("x,y,z", four, kind="distance"), "pair": read("distance", ["1"] * 4, kind="pair"),
        "touch": read("distance", ["1"] * 4, kind="plane"), "two columns": read("x,y,z,x [mm]", ["1,2,3,4"] * 4),
        "two orientations": read("x,y,z,rx,ry,rz,roll,pitch,yaw", ["1,2,3,1,2,3,1,2,3"] * 4),
        "no orientation": read("x,y,z,qw,qx,qy", ["1,2,3,1,0,0"] * 4, kind="pose"),
        "quaternion": read("x,y,z,qw,qx,qy,qz", ["1,2,3,1,0,0,0", "1,2,3,1.0011,0,0,0"]),
        "matrix": read("x,y,z,r11,r12,r13,r21,r22,r23,r31,r32,r33", ["1,2,3,1,0,0,0,1,0,0,0,1", "1,2,3,1,0,0,0,1,0.0011,0,0,1"]),
        "not finite": read("x,y,z", ["1,2,3", "1,nan,3"]), "joint": read("x,y,z", four, "waist,slide,shoulder,bend"),
        "unit": read("x [rad],y,z", four), "tip": read("x,y,z", four, tip="nose"), "infinite": read("distance", ["1", "inf"]),
        "rows": Measurements.from_file(csv_of(folder, "x,y,z,qw,qx,qy,qz", ["1,2,3,1,0,0,0", "1,2,3,1.0009,0,0,0"]), robot, tip="tool").count,
    }  # fmt: skip


@records.of
def rotations_of_roll_pitch_yaw():
    return rotations_from_roll(np.array([[0.3, -0.5, 0.9], [-1.2, 0.4, 2.1]]))


# ── Planned readings


@records.of(relative=1e-5)
def plans_of_all_kinds(folder):
    found = {}
    robot = leaning_arm()
    world = World.drawn(robot, 1, tip="tool")
    cases = {
        "position": {"count": 9}, "pose": {"count": 7, "kind": "pose", "floor": -0.4, "noise": (2e-4, 7e-4)},
        "distance": {"count": 11, "kind": "distance", "towards": (0.4, -0.9, 0.3), "assume": "sag", "file_accuracy": (2e-3, 1e-3)},
        "pair": {"count": 8, "kind": "pair", "clear": False, "seed": 5},
        "facing": {"count": 13, "towards": (1.5, 0.8, 1.1), "assume": ("gears", "sag"), "clear": False, "floor": -0.6},
        "after": {"count": 6, "after": world.measured("pose", 12), "kind": "distance", "towards": (0.4, -0.9, 0.3)},
    }  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(poses, "CANDIDATES", 150)
        patch.setattr(poses, "REFERENCE", 60)
        for name, options in cases.items():
            plan = measuring_poses(robot, **({"tip": "tool"} | options))
            csv = plan.to_csv(folder / "a.csv").read_text().splitlines()
            csv_degrees = plan.to_csv(folder / "b.csv", degrees=True).read_text().splitlines()
            found[name] = {
                "text": str(plan).splitlines(), "facts": dict(plan.facts()), "q": packed(plan.q), "counts": plan.counts, "subject": plan.subject,
                "remaining": plan.remaining, "by file": plan.by_file, "noise": plan.noise, "moved": plan.moved_off_axis,
                "rank": [plan.rank, plan.theory], "csv": csv[:3], "degrees": csv_degrees[:3], "verdict": str(plan.verdict.word),
                "deviations": plan.fit.deviations, "sources": list(plan.sources()),
            }  # fmt: skip
    return found


@records.of
def plans_that_are_refused():
    robot = leaning_arm()

    def plan(**options):
        return refusal(lambda: measuring_poses(robot, **({"count": 5, "tip": "tool"} | options)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(poses, "CANDIDATES", 40)
        return {
            "few": plan(count=2), "many": plan(count=1001), "kind": plan(kind="plane"), "distance": plan(kind="distance"),
            "floor": plan(floor=1.5), "towards": plan(count=39, towards=(3.0, 0.2, 0.3)), "noise": plan(noise=-1.0), "count": plan(count=41),
            "accuracy": plan(file_accuracy=(1.0, 0.0)), "point": plan(towards=(1.0, 2.0)), "assume": plan(assume="wind"), "tip": plan(tip=None),
        }  # fmt: skip


@records.of
def targets_moved_off_the_last_axis():
    """A tip at, below and above 10 mm from the last axis; a sliding last joint."""
    found = {}
    for off in (0.0, 0.0099, 0.0101):
        x, y, z = np.array([0.85, 0.3, -0.2]) / np.linalg.norm([0.85, 0.3, -0.2]) * 0.3 + off * np.array(
            [0, 0.2, 0.3]
        ) / math.hypot(0.2, 0.3)
        text = LEANING.replace('xyz="0.07 0.11 0.16" rpy="0.3 -0.5 0.2"', f'xyz="{x} {y} {z}" rpy="0.3 -0.5 0.2"')
        start, moved = poses._start(TipChain.from_robot(tw.load(text), "tool"), None)
        found[str(off)] = [
            np.linalg.norm(start.tip[:3, 3] - [x, y, z]),
            np.linalg.norm(start.tip),
            moved,
        ]  # of two arbitrary directions
    start, moved = poses._start(TipChain.from_robot(leaning_arm(), "claw"), None)
    return found | {"sliding": [start.tip, moved]}


@records.of
def order_of_moves():
    q = np.array([[0.0, 0], [1.0, 0.9], [0.2, 0.5], [0.4, -0.3], [0.9, 1.0], [0.1, 0.1]])
    return [
        poses._in_order_of_moves(Measurements(q, positions=drawn(6, 3))),
        poses._in_order_of_moves(Measurements(q, pairs=[[0, 1], [2, 3], [4, 5]], distances=[1.0, 2.0, 3.0])),
    ]


@records.of
def doubts_about_plans():
    def plan(rank=27, remaining=0.3e-3, capsules="shapes", unwatched=()):
        seen = (
            None
            if capsules is None
            else stub(capsules=stub(assumption=capsules if capsules != "shapes" else ""), unwatched=unwatched)
        )
        return stub(rank=rank, theory=27, count=12, remaining=np.array([1e-3, remaining]), by_file=3e-3, capsules=seen)

    cases = {
        "ok": plan(), "rank": plan(rank=26), "a tenth": plan(remaining=0.303e-3), "not looked at": plan(capsules=None, rank=20),
        "assumed": plan(capsules="two links have no shapes"), "unwatched": plan(unwatched=("the floor is near", "a and b touch"), remaining=1e-3),
    }  # fmt: skip
    return {name: poses_view.doubts_of_plan(case) for name, case in cases.items()}


# ── Factory calibration


LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


def conf_of(folder, size=1.0):
    rng = np.random.default_rng(7)
    lines = []
    for name, scale in (("theta", 1e-3), ("d", 2e-4), ("a", 3e-4), ("alpha", 1e-3)):
        numbers = ", ".join(repr(float(x)) for x in size * scale * rng.normal(size=6))
        lines.append(f"delta_{name} = [{numbers}]  # of the controller")
    path = folder / "calibration.conf"
    path.write_text("\n".join(["[mounting]", *lines]))
    return path


def yaml_of(folder, last=0.0823, name="calibration.yaml"):
    """Poses of a UR5's joints with errors of millimetres."""
    rng = np.random.default_rng(8)
    nominal = [
        (0, 0, 0.089159, 0, 0, 0), (0, 0, 0, np.pi / 2, 0, 0), (-0.425, 0, 0, 0, 0, 0), (-0.39225, 0, 0.10915, 0, 0, 0),
        (0, -0.09465, 0, np.pi / 2, 0, 0), (0, last, 0, np.pi / 2, np.pi, np.pi),
    ]  # fmt: skip
    text = "kinematics:\n"
    for link, entry in zip(LINKS, nominal, strict=True):
        text += f"  {link}:\n"
        for key, value in zip(("x", "y", "z", "roll", "pitch", "yaw"), entry, strict=True):
            text += f"    {key}: {float(value + 3e-4 * rng.normal()):.12f}\n"
    path = folder / name
    path.write_text(text)
    return path


@records.of
def factory_calibrations(folder):
    robot = tw.robots.ur5()
    q = np.asarray(robot.random_configuration(3, 3))
    found = {}
    for path in (conf_of(folder), yaml_of(folder), yaml_of(folder, name="short.YML")):
        answer = factory.FactoryCalibration.from_file(robot, path)
        frames = [
            np.asarray(answer.robot.forward_kinematics(q, frame=f))
            for f in ("tool0", "wrist_3_link", "forearm_link", "upper_arm_link")
        ]
        found[path.name] = [
            packed(*frames),
            frames[0][1],
            answer.displacement,
            str(answer).splitlines(),
            dict(answer.facts()),
            answer.brief,
            list(answer.sources()),
        ]
        calibrated = tw.load(answer.write(folder / "mine.urdf"))
        found[f"{path.name}, written"] = packed(calibrated.forward_kinematics(q))
    other = factory.FactoryCalibration.from_file(robot, conf_of(folder), "wrist_3_link")
    found["of another frame"] = [other.frame, other.displacement, other.brief]
    return found


@records.of
def tables_of_factory_calibrations():
    chain = TipChain.from_robot(tw.robots.ur5())
    frames, d, a = factory._nominal_table(chain)
    T = np.asarray(tw.se3.exp(drawn(3, 6, seed=9)))
    return {
        "frames": [frames[k] for k in (0, 2, 3, 6)], "d": d, "a": a, "links": factory._link_frames(chain)[4],
        "table": factory._frames_of_table(T[0], drawn(6, seed=1), drawn(6, seed=2), drawn(6, seed=3), drawn(6, seed=4))[5],
        "placements": factory._frames_of_placements(T[0], [T[1], T[2]]), "shift": factory._axis_shift(T[0], T[1]),
    }  # fmt: skip


@records.of
def factory_calibrations_that_are_refused(folder):
    robot = tw.robots.ur5()

    def refused(path, text=None, of=robot):
        if text is not None:
            path = folder / path
            path.write_text(text)
        return refusal(lambda: factory.factory(of, path))

    conf, yaml = conf_of(folder), yaml_of(folder)
    text, kinematics = conf.read_text(), yaml.read_text()
    wide = text.replace("delta_a = [", "delta_a = [0.0, 0.021, 0.0, 0.0, 0.0, 0.0] #")
    narrow = text.replace("delta_a = [", "delta_a = [0.0, 0.0175, 0.0, 0.0, 0.0, 0.0] #")
    return {
        "missing": refused(folder / "no.conf"), "other": refused(conf, of=leaning_arm()), "wide": refused("wide.conf", wide),
        "five": refused("five.conf", text.replace(", ", "; ", 1)), "nan": refused("nan.conf", re.sub(r"= \[[^,]*", "= [nan", text, count=1)),
        "no section": refused("s.conf", text.replace("mounting", "Mounting")), "no list": refused("l.conf", text.replace("delta_d", "delta_e")),
        "link": refused("k.yaml", kinematics.replace("wrist_2", "wrist_9")), "word": refused("w.yaml", kinematics.replace("roll: ", "roll: a", 1)),
        "flange": refused(yaml_of(folder, last=0.0883, name="long.yaml")), "table": refused("n.yaml", "links: {}"),
        "folder": refused(folder), "narrow": isinstance(factory.factory(robot, _written(folder / "n.conf", narrow)), tw.Robot),
    }  # fmt: skip


def _written(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
