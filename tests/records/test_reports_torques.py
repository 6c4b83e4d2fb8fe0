"""Reports on torques: complete answers on record."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.spoken_verdict import verdict_data
from twistwrench.reports.torque_report import Joints

from .report_cases import (
    CRANE,
    GRAVITY,
    crane,
    fields_of,
    heads,
    motion,
    quietly,
    said,
    shown,
    swing,
    uneven,
    words_of,
    write_log,
)

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

WRENCH = (1.1, -2.3, 3.7, 5.2, 4.1, -20.6)
PAYLOAD = "2.5,0.03,-0.05,0.12@hook"
SMALL = (0.5, (0.01, 0.02, -0.03), "claw_b")


def figures(report):
    """Fields of a report that its text does not show."""
    own = fields_of(
        report, "rows", "begin", "end", "joints", "excesses", "near", "bearings", "measured", "causes", "stationary",
        "largest", "peaks", "largest_payload", "payload_margin", "idle_payload", "noisy", "in_degrees", "brief", "subject",
        "scale", "worst", "robot_name", "band", "outliers", "sound",
    )  # fmt: skip
    own["estimates"] = [None if joint.estimate is None else joint.estimate for joint in report.joints]
    own["joints"] = [
        [
            joint.joint,
            joint.unit,
            joint.largest,
            joint.time,
            joint.rms,
            joint.limit,
            joint.noise,
            joint.raw,
            joint.raw_time,
            joint.peak,
            joint.chance,
            joint.uncertainty,
            joint.share,
            joint.main_cause,
            report.reach(joint),
            report.at_an_end(joint),
            report.reference(joint),
        ]
        for joint in report.joints
    ]
    own["terms"] = {name: [joint.terms[name] for joint in report.joints] for name in report.joints[0].terms}
    own["around"] = fields_of(report.around, "time", "q")
    own["envelope"] = report.envelope
    own["shares"] = report.shares()
    own["origin"] = [entry if isinstance(entry, tuple) else shown([entry]) for entry in report.origin()]
    own["facts"] = report.facts()
    own["torques"] = report.torques()
    own["gaps"] = fields_of(
        report.gaps, "threshold", "count", "longest", "longest_at", "hidden", "exceeds_logged_motion"
    )
    return own


@functools.cache
def loaded_report():
    return tw.check(
        crane(), motion(scale=1.6), payload=PAYLOAD, wrench_on_robot={"turret": WRENCH}, degrees=True, why=True,
        bolts="5x0.31", mounting="post",
    )  # fmt: skip


@functools.cache
def noisy_positions(rows=60, size=1e-4):
    t = uneven(rows)
    q, _, _ = swing(t)
    q = q + np.random.default_rng(3).normal(0, size, q.shape)
    return tw.Motion(t, q, robot=crane(), in_seconds=True)


@functools.cache
def noisy_report():
    return tw.check(crane(), noisy_positions(), payload=1.5)


@records.of
def a_loaded_crane_with_wrench_bolts_and_reasons():
    return shown(loaded_report().blocks())


@records.of
def figures_of_a_loaded_crane():
    return figures(loaded_report())


@records.of
def page_of_a_loaded_crane():
    report = loaded_report()
    data = verdict_data(report.load, report.limits, report)
    return {key: value for key, value in data.items() if key not in ("sentences",)}


@records.of(relative=1e-4)
def a_noisy_log_of_positions():
    return shown(noisy_report().blocks())


@records.of(relative=1e-4)
def figures_of_a_noisy_log():
    report = noisy_report()
    derived = report.derived
    return figures(report) | {
        "derived": fields_of(derived, "excesses", "envelope", "motors"),
        "page": {
            key: value
            for key, value in verdict_data(report.load, report.limits, report).items()
            if key in ("joints", "gap", "asLogged", "noisy", "passed", "near", "questions", "text", "margin", "doubts")
        },
    }


@records.of(relative=1e-4)
def noise_that_matters_more_or_less():
    clean = tw.Motion(uneven(60), swing(uneven(60))[0], robot=crane(), in_seconds=True)
    return {
        "without friction": said(tw.check(crane(), noisy_positions(), friction=False)),
        "smooth": said(tw.check(crane(), noisy_positions(size=1e-6), smooth=True)),
        "small": words_of(tw.check(crane(), noisy_positions(size=3e-7), payload=4.2)),
        "clean": words_of(tw.check(crane(), clean, payload=5.5)),
        "large": words_of(tw.check(crane(), noisy_positions(size=2e-3))),
        "enough for a limit": words_of(tw.check(crane(), noisy_positions(), limits={"luff": 29.5, "swivel": 24.0})),
        "speeds": words_of(
            tw.check(crane(), noisy_positions(size=1e-3), limits={"velocity": np.array([1.5, 1.46, 0.42, 0.06])})
        ),
    }


def _logs(folder):
    t = uneven(40)
    q, dq, ddq = swing(t)
    robot = crane()
    names = list(robot.coordinate_names)
    tau = np.asarray(robot.inverse_dynamics(q, dq, ddq)) + 0.3 * np.sin(np.outer(t, [3, 5, 7, 9]))
    tau[:, 1] *= -1.0
    tau[:, 2] *= 5.0
    tau[:, 3] = 0.7
    logs = {
        "q dq": ((q, dq), heads(robot, "", ".vel")),
        "q dq ddq": ((q, dq, ddq), heads(robot, "", ".vel", ".acc")),
        "q ddq": ((q, ddq), heads(robot, "", ".acc")),
        "torques": ((q, dq, ddq, tau), heads(robot, "", ".vel", ".acc", ".torque")),
        "degrees": (
            (np.column_stack([np.degrees(q[:, :2]), 1e3 * q[:, 2:]]),),
            [f"{n} [{u}]" for n, u in zip(names, ("deg", "deg", "mm", "mm"), strict=True)],
        ),
        "plain degrees": ((np.column_stack([np.degrees(q[:, :2]), q[:, 2:]]),), names),
        "other names": ((q,), ["a", "b", "c", "d"]),
        "currents": ((q, dq, ddq, tau / [3.1, 2.2, 5.3, 1.7]), heads(robot, "", ".vel", ".acc", ".current")),
    }
    return {name: write_log(folder / f"{name}.csv", t, *log) for name, log in logs.items()}


@records.of(relative=1e-4)
def logs_of_all_columns(folder):
    logs = _logs(folder)
    columns = dict(zip(crane().coordinate_names, "abcd", strict=True))
    gain = dict(zip(crane().coordinate_names, (3.1, 2.2, 5.3, 1.7), strict=True))
    answers = {
        "q dq": tw.check(crane(), logs["q dq"]),
        "q ddq": tw.check(crane(), logs["q ddq"]),
        "plan": tw.check(crane(), logs["q dq ddq"], plan=True),
        "torques": tw.check(crane(), logs["torques"]),
        "torques with a payload": tw.check(crane(), logs["torques"], payload=0.9, limits={"boom": 9.0, "swivel": 11.5}),
        "torques with a wrench": tw.check(crane(), logs["torques"], wrench_on_robot={"hook": WRENCH}),
        "degrees": tw.check(crane(), logs["degrees"]),
        "plain degrees": tw.check(crane(), logs["plain degrees"], degrees=True),
        "other names": tw.check(crane(), logs["other names"], columns=columns),
        "currents": tw.check(crane(), logs["currents"], gain=gain),
    }
    return {
        name: words_of(answer)
        | fields_of(answer, "peaks", "measured", "in_degrees")
        | {
            "tables": list(answer.tables),
            "origin": answer.differentiation.source,
            "doubts": [d.kind for d in answer.doubts],
        }
        for name, answer in answers.items()
    } | {"whole": said(answers["torques"])}


@records.of
def tables_that_are_written(folder):
    report = tw.check(
        crane(), motion(rows=12, scale=1.4), payload=PAYLOAD, mounting=True, bolts=[[0.11, 0.07], [-0.09, 0.05], [0.02, -0.13]],
        grip="60,0.5",
    )  # fmt: skip
    noisy = noisy_report()
    return {
        "split": _table(report.to_csv(folder / "split.csv", split=True)),
        "torques": _table(report.to_csv(folder / "torques.csv")),
        "noisy": _table(noisy.to_csv(folder / "noisy.csv", split=True)),
    }


def _table(path):
    head, *lines = path.read_text().splitlines()
    rows = np.array([[float(cell or "nan") for cell in line.split(",")] for line in lines])
    return {"head": head, "rows": rows, "first": rows[0], "last": rows[-1]}


@records.of
def limits_on_both_sides():
    """Each kind of limit a little below, at and a little above the largest value."""
    robot = crane()
    base = tw.check(robot, motion(), payload=1.3)
    q, dq, _ = swing(uneven(23))
    peaks = np.abs(base.peaks)
    loads = base.load.bearing_loads(next(iter(base.differentiation.states(100))))
    tables = {
        "effort": {"effort": peaks},
        "velocity": {"velocity": np.abs(dq).max(axis=0)},
        "lower": {"lower": q.min(axis=0)},
        "upper": {"upper": q.max(axis=0)},
        **{kind: {kind: np.maximum(np.abs(load).max(axis=0), 0.05)} for kind, load in loads.items()},
    }
    said_of = {}
    for kind, table in tables.items():
        (value,) = table.values()
        for name, factor in (("below", 0.983), ("at", 1.0), ("above", 1.017)):
            away = (factor - 1) * np.abs(value) if kind == "upper" else (1 - factor) * np.abs(value)
            limit = value + away if kind in ("lower", "upper") else factor * value
            limit = np.where(
                [True, False, True, False] if name == "below" else [True] * 4, limit, 1.3 * np.abs(limit) + 0.1
            )
            if kind == "lower":
                limit = np.where([True, False, True, False] if name == "below" else [True] * 4, limit, -9.0)
            answer = tw.check(robot, motion(), payload=1.3, limits={kind: limit}, degrees=name == "below")
            said_of[f"{kind} {name}"] = {
                "reasons": list(answer.verdict.reasons), "text": str(answer.headline), "excesses": answer.excesses,
                "near": answer.near, "bearings": answer.bearings, "brief": answer.brief,
                "further": answer.to_dict()["sentences"],
            }  # fmt: skip
            if name == "below":
                said_of[f"{kind} table"] = shown(answer.blocks())[5:]
    return said_of


@records.of
def followers_over_their_limit():
    tight = CRANE.replace('effort="17"', 'effort="0.4"')
    robot = quietly(tw.load)(tight, gravity=GRAVITY, tip="hook")
    t = uneven(23)
    own = tw.Motion(t, *swing(t), robot=robot, in_seconds=True)
    over = tw.check(robot, own)
    payload = tw.check(robot, own, payload="0.3@claw_a")
    return {
        "over": said(over),
        "excesses": over.excesses,
        "payload": words_of(payload),
        "margin": payload.payload_margin,
    }


MOTORS = """
motors:
  large: {torque_constant: 0.13 N m/A, resistance: 0.4 ohm, inductance: 0.3 mH, voltage: 36 V, current_continuous: 1.2 A, current_peak: 9 A, speed: 2900 rpm}
  small: {torque_constant: 0.05 N m/A, resistance: 1.3 ohm, voltage: 20 V, current_peak: 0.9 A}
actuators:
  swivel: {ratio: 81, efficiency: 0.7, motor: large, rotor: {inertia: 190 g cm^2}, friction: {viscous: 3 N m s/rad, coulomb: 2 N m, load: 0.04}}
  boom: {ratio: 40 mm/turn, efficiency: 0.8, motor: small, rotor: {inertia: 30 g cm^2}}
"""


@functools.cache
def driven_crane(motors=MOTORS):
    return quietly(crane().with_actuators)(motors)


@records.of
def motors_of_a_crane():
    t = uneven(23)
    robot = driven_crane()
    swung = tw.Motion(t, *swing(t, 1.3), robot=robot, in_seconds=True)
    answer = quietly(tw.check)(robot, swung, payload=1.1)
    by_option = quietly(tw.check)(crane(), motion(scale=1.3), payload=1.1, actuators=MOTORS)
    unlimited = MOTORS.replace(
        "voltage: 36 V, current_continuous: 1.2 A, current_peak: 9 A, speed: 2900 rpm", "inductance: 1 mH"
    )
    unlimited = unlimited.replace(", voltage: 20 V, current_peak: 0.9 A", "").replace("inductance: 0.3 mH, ", "")
    wide = MOTORS.replace("1.2 A", "4.4 A").replace("0.9 A", "7 A")
    unknown = quietly(tw.check)(crane(), motion(), actuators=unlimited)
    enough = quietly(tw.check)(crane(), motion(), actuators=wide)
    return {
        "small": shown(answer.blocks()),
        "use": [
            fields_of(use, "joint", "demands", "power", "heat", "time", "speed", "torque", "too_small", "words")
            for use in answer.motors
        ],
        "by option": words_of(by_option) | {"peaks": by_option.peaks},
        "unknown": said(unknown),
        "enough": said(enough),
        "noise": words_of(quietly(tw.check)(crane(), noisy_positions(), actuators=MOTORS)),
    }  # fmt: skip


@np.errstate(all="ignore")
def _overflowing(robot, t):
    return tw.check(robot, tw.Motion(t, *[1e200 * x for x in swing(t)], robot=robot, in_seconds=True))


@records.of
def calls_that_are_refused(folder):
    robot = crane()
    other = tw.robots.planar_2r()
    t = uneven(23)
    swung = motion()
    _logs(folder)
    return {
        "no motion": refusal(lambda: tw.check(robot)),
        "two": refusal(lambda: tw.check(robot, swung, at={"luff": 0.2})),
        "type": refusal(lambda: tw.check(robot, 3.7)),
        "other robot": refusal(lambda: tw.check(other, swung)),
        "demo": refusal(lambda: tw.check("ur5", "demo", degrees=True)),
        "no demo": refusal(lambda: tw.check(robot, "demo")),
        "srdf": refusal(lambda: tw.check(robot, swung, srdf="a.srdf")),
        "grip and cup": refusal(lambda: tw.check(robot, swung, payload=1, grip="9,0.5", cup="8,0.4")),
        "friction of nothing": refusal(lambda: tw.check(robot, swung, contact_friction=0.5)),
        "normal of nothing": refusal(lambda: tw.check(robot, swung, contact_normal=(0, 0, 1))),
        "feet and mounting": refusal(lambda: tw.check(robot, swung, feet="hook", mounting=True)),
        "wheels and bolts": refusal(lambda: tw.check(robot, swung, wheels="hook", bolts="5x0.3")),
        "unknown joint": refusal(lambda: tw.check(robot, swung, limits={"luf": 4.0})),
        "unknown name": refusal(lambda: Joints(tw.check(robot, swung).joints)["luf"]),
        "topic": refusal(lambda: tw.check(robot, folder / "q dq.csv", topic="/x")),
        "episode": refusal(lambda: tw.check(robot, folder / "q dq.csv", episode=3)),
        "column": refusal(lambda: tw.check(robot, folder / "q dq.csv", columns={"luff": "zz"})),
        "not finite": refusal(lambda: _overflowing(robot, t)),
    }  # fmt: skip


@records.of
def robots_at_rest():
    robot = crane()
    locked = tw.check(robot, at={"swivel": 0.7, "boom": 0.21}, payload=4.4, lock={"luff": 0.6})
    return {
        "dict": said(tw.check(robot, at={"swivel": 0.7, "boom": 0.21}, payload=4.4)),
        "array": words_of(tw.check(robot, at=[0.7, -0.3, 0.21, 0.02], payload=[4.4, "1.2@claw_b"])),
        "degrees": words_of(tw.check(robot, at={"luff": 31}, degrees=True)),
        "locked": words_of(locked) | {"peaks": locked.peaks},
        "at the base": words_of(tw.check(robot, at={"luff": 0.3}, payload="3@eye")),
        "payload on the axis": words_of(tw.check("planar_2r", at={"joint1": 0.3}, payload=0)),
        "by name": words_of(tw.check("ur5", at={"elbow_joint": 1.0})),
        "log": tw.check(robot, at={"luff": 0.3}).motion.time,
        "of a motion's log": MotionLog.from_motion(motion()).table[:3],
    }


@records.of
def spans_of_time_of_a_rate(folder):
    """A file without a column of time, with a rate."""
    t = np.arange(30) / 40.0
    q, dq, ddq = swing(t)
    path = folder / "counted.csv"
    np.savetxt(
        path, np.hstack([q, dq, ddq]), "%.9g", ",", header=",".join(heads(crane(), "", ".vel", ".acc")), comments=""
    )
    answer = tw.check(crane(), path, rate=40.0)
    return words_of(answer) | {
        "times": [joint.time for joint in answer.joints],
        "end": answer.end,
        "peaks": answer.peaks,
    }


@records.of(relative=1e-4)
def logs_that_no_robot_makes():
    """Torques far beyond the limits, a wrong row with and without rates of its own, a corner of the path and repeated rows."""
    robot = crane()
    t = 0.02 * np.arange(60)
    q, dq, ddq = swing(t)
    pulse = q.copy()
    pulse[30, 1] += 0.15
    corner = q.copy()
    corner[25:, 0] += 1.5 * (t[25:] - t[25])
    held = q.copy()
    held[20:23] = held[20]
    tau = np.asarray(robot.inverse_dynamics(q, dq, ddq)) * 1.05
    logs = {
        "fast": tw.Motion(t / 7, q, robot=robot, in_seconds=True),
        "pulse": tw.Motion(t, pulse, robot=robot, in_seconds=True),
        "pulse beside rates": tw.Motion(t, pulse, dq, ddq, robot=robot, in_seconds=True),
        "pulse beside torques": tw.Motion(t, pulse, tau=tau, robot=robot, in_seconds=True),
        "corner": tw.Motion(t, corner, robot=robot, in_seconds=True),
        "corner beside torques": tw.Motion(t, corner, tau=tau, robot=robot, in_seconds=True),
        "held": tw.Motion(t, held, robot=robot, in_seconds=True),
    }
    table = {}
    for name, log in logs.items():
        answer = tw.check(robot, log, payload=1.2)
        spans = [list(instant) for instant in answer.spans.instants]
        sound = None if answer.sound is None else [answer.sound.peaks, answer.sound.excesses]
        table[name] = [
            words_of(answer),
            [doubt.kind for doubt in answer.doubts],
            spans,
            answer.spans.reach,
            sound,
            answer.excesses,
        ]
    table["fast plan"] = words_of(tw.check(robot, replace(logs["fast"], plan=True)))
    return table


@records.of
def progress_of_a_check():
    finished = []
    tw.check(crane(), noisy_positions(), progress=finished.append)
    smooth = []
    tw.check(crane(), noisy_positions(), smooth=True, progress=smooth.append)
    plain = []
    tw.check(crane(), motion(), progress=plain.append)
    return {"noisy": finished, "smooth": smooth, "plain": plain}


@records.of
def replaced_reports_keep_their_words():
    report = loaded_report()
    return {
        "label": [report.label(x) for x in (0.0, 1e-8, 1e-9, 1.5e-8, 12.3456, -0.004)],
        "zero": [report.is_zero(factor * report.scale) for factor in (0.99e-9, 1.01e-9, -0.5e-9)],
        "no joints": [replace(report, joints=Joints()).worst, replace(report, joints=Joints()).brief, replace(report, joints=Joints()).facts()],
        "slice": [joint.joint for joint in report.joints[1:3]] + [report.joints["boom"].joint, report.joints[-1].joint],
    }  # fmt: skip


@records.of
def robots_and_motions_of_other_forms(folder):
    """A robot of a path with drives, a table of pandas, a motion that has a log, and rows in doubt beside rates of their own."""
    pandas = pytest.importorskip("pandas")
    path = folder / "crane.urdf"
    path.write_text(CRANE)
    swung = motion()
    frame = pandas.DataFrame(
        np.column_stack([swung.time, swung.q, swung.dq, swung.ddq]),
        columns=["time", *heads(crane(), "", ".vel", ".acc")],
    )
    t = 0.02 * np.arange(60)
    q, dq, ddq = swing(t)
    held = q.copy()
    held[20:23] = held[20]
    rates = tw.check(crane(), tw.Motion(t, held, dq, ddq, robot=crane(), in_seconds=True), payload=1.2)
    log = _logs(folder)["torques"]
    answers = {
        "path": quietly(tw.check)(
            str(path), swung, actuators="actuators: {luff: {ratio: 3, reflected_inertia: 0.1 kg m^2}}"
        ),
        "table": tw.check(crane(), frame),
        "motion of a log": tw.check(crane(), tw.Motion.from_file(log, crane())),
        "rates": rates,
    }
    return {name: [words_of(answer)["sentences"][0], answer.peaks, answer.excesses, [d.kind for d in answer.doubts]] for name, answer in answers.items()} | {
        "sound": None if rates.sound is None else [rates.sound.peaks, rates.sound.excesses], "sources": list(rates.sources()),
    }  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
