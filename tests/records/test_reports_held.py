"""Mountings, bolts, grips, cups and fingers: complete answers on record."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.verdict import Verdict
from twistwrench.motion.load_case import LoadCase
from twistwrench.reports.support import grip
from twistwrench.reports.support.fingers import FingerDrives, finger_drives
from twistwrench.reports.support.grip import Holder
from twistwrench.reports.support.mounting import BoltPattern
from twistwrench.reports.torque_verdict import verdict_of
from twistwrench.reports.torque_view import report_view
from twistwrench.statics.reactions import bolt_circle

from .report_cases import CRANE, GRAVITY, crane, fields_of, motion, quietly, said, shown, styled, words_of

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

PAYLOAD = "1.7,0.03,-0.05,0.06@hook"
GRIP = {"force": 90.0, "friction": 0.6, "frame": "hook", "axis": "x", "width": 0.07, "pad": (0.05, 0.03)}
CUP = {"force": 150.0, "friction": 0.5, "frame": "slider", "radius": 0.06}


@functools.cache
def gripped(**changes):
    return tw.check(crane(), motion(rows=9), payload=PAYLOAD, grip=GRIP | changes)


@functools.cache
def cupped(force=150.0):
    return tw.check(crane(), motion(rows=9), payload=PAYLOAD, cup=CUP | {"force": force})


def line_of(held):
    return held.line if held.verdict.ok else None  # only of a payload that is held


def figures(report):
    held = report.held.grip
    return [
        words_of(report), held.verdict, line_of(held), shown([held.table()]), held.needed, held.mass, held.columns(), report.grip_force,
        fields_of(held.support, "holds", "speed", "payload", "friction", "forces"), held.fingers,
    ]  # fmt: skip


# ── Grips and cups


@records.of(relative=1e-5)
def grips_along_a_motion():
    robot = crane()
    short = motion(rows=9)
    answers = {
        "holds": gripped(),
        "weak": gripped(force=11.0),
        "slippery": gripped(friction=0.0),
        "along y": tw.check(robot, short, payload=PAYLOAD, grip="40,0.7@hook"),
        "along z": tw.check(robot, short, payload=PAYLOAD, grip=GRIP | {"axis": "z"}),
        "default frame": tw.check(robot, short, payload=2.1, grip="140,0.9"),
        "cup": cupped(),
        "weak cup": cupped(31.0),
        "cup of text": tw.check(robot, short, payload="0.4@slider", cup="33,0.45@slider"),
    }
    table = {name: figures(answer) for name, answer in answers.items()}
    table["whole"] = said(answers["along y"])
    return table


@records.of
def holders_of_all_forms():
    load = LoadCase(crane(), tw.check(crane(), at={"luff": 0.1}, payload=PAYLOAD).load.payloads)
    given = {
        "text": ("grip", "60,0.5"), "text at a frame": ("grip", "60,0.5@ slider "), "mapping": ("grip", GRIP), "no pad": ("grip", {k: v for k, v in GRIP.items() if k != "pad"}),
        "no width": ("grip", {k: v for k, v in GRIP.items() if k != "width"}), "cup": ("cup", "80,0.25@claw_b"), "radius": ("cup", CUP), "no friction": ("cup", "80,0"),
    }  # fmt: skip
    table = {}
    for name, (kind, one) in given.items():
        holder = Holder.from_given(kind, one, load)
        groups = list(dict.fromkeys(c.group for c in holder.contacts))
        contacts = [
            [c.point, c.normal, c.friction, c.push, c.pull, c.frame, groups.index(c.group)] for c in holder.contacts
        ]
        table[name] = [fields_of(holder, "kind", "force", "frame", "assumed"), contacts]
    wrong = {
        "axis": ("grip", GRIP | {"axis": "u"}), "frame": ("grip", GRIP | {"frame": "hok"}), "key": ("grip", {"forc": 3}), "cup's axis": ("cup", GRIP), "missing": ("grip", {"force": 3}),
        "missing force": ("cup", {"friction": 3}), "one number": ("grip", "60"), "three": ("cup", "60,1,2"), "word": ("grip", "a,b"), "negative": ("grip", "60,-0.1"), "infinite": ("cup", "60,inf"),
        "zero force": ("grip", "0,0.1"), "zero width": ("grip", GRIP | {"width": 0}), "zero radius": ("cup", CUP | {"radius": -1}),
    }  # fmt: skip
    table["refused"] = {
        name: refusal(lambda kind=kind, one=one: Holder.from_given(kind, one, load))
        for name, (kind, one) in wrong.items()
    }
    table["no payload"] = refusal(lambda: tw.check(crane(), motion(rows=9), grip="60,0.5"))
    table["two"] = refusal(lambda: tw.check(crane(), motion(rows=9), payload=[1, "2@hook"], cup="60,0.5"))
    table["zero"] = refusal(lambda: tw.check(crane(), motion(rows=9), payload=0, cup="60,0.5"))
    table["moves"] = refusal(lambda: tw.check(crane(), motion(rows=9), payload=1, grip="60,0.5@jib"))
    return table


@records.of(relative=1e-6)
def wrenches_on_a_gripped_body():
    """Inertia, weight and velocity terms of a body with a full inertia tensor, about a frame off its centre."""
    G = tw.SpatialInertia.from_com(
        1.3, (0.04, -0.03, 0.08), np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.025]])
    )
    wrenches, weights = grip._payload_wrenches(np.asarray(G.matrix), crane(), motion(rows=4), "claw_b")
    body = tw.check(crane(), motion(rows=9), payload={"hook": G}, grip="80,0.6@slider")
    return {"wrenches": wrenches, "weights": weights, "body": [body.grip_force, body.held.grip.mass]}


@records.of
def numbers_rounded_up():
    return [
        grip._rounded_up(x)
        for x in (-1.0, 0.0, 0.00123, 0.0012301, 9.99, 9.991, 10.0, 10.01, 12.3, 12.3000000001, 123.4, 99.95, 12341.0)
    ]


@records.of(relative=1e-6)
def verdicts_on_a_grip():
    """Instants that fail, and instants at which rounding prevents an answer."""
    report = gripped()
    table = {}
    for name, held in {"grip": report.held.grip, "cup": cupped().held.grip}.items():
        n = len(held.time)
        support = held.support
        fails = np.arange(n) >= 5

        def altered(held=held, support=support, n=n, **changes):
            fields = {
                k: np.where(np.arange(n) >= 5, v, getattr(support, k)) for k, v in changes.items() if k != "needed"
            }
            needed = np.where(
                np.arange(n) >= 5, changes.get("needed", 0) + np.array([0, 0, 0, 0, 0, 1, 5, 3, 2.0]), held.needed
            )
            return replace(held, support=replace(support, **fields), needed=needed)

        cases = {
            "fails": altered(holds=False, needed=100.0), "no force": altered(holds=False, needed=np.inf), "comes off": altered(holds=False, needed=100.0, friction=np.inf),
            "undecided": altered(holds=False, decided=False, needed=100.0), "assumed": replace(altered(holds=False, needed=100.0), holder=replace(held.holder, assumed="pads of 20 x 20 mm")),
            "no margins": altered(speed=np.inf, payload=np.inf), "still": replace(held, support=replace(support, speed=np.full(n, np.inf))),
        }  # fmt: skip
        for case, one in cases.items():
            joined = replace(report, held=replace(report.held, grip=one))
            verdict = verdict_of(joined)
            table[f"{name} {case}"] = [one.verdict, line_of(one), shown([one.table()]), verdict]
        assert fails.any()
    line = next(iter(report_view(report)))
    table["view"] = [styled(line.pieces), [list(answer) for answer in (report.tables,)]]
    return table


# ── Fingers


@records.of
def drives_of_fingers():
    model = crane().model
    efforts = np.array([61.0, 47.0, 83.0, 29.0])
    unlimited = np.array([61.0, 47.0, 83.0, np.inf])
    turning = quietly(tw.load)(
        CRANE.replace('"pinch_b" type="prismatic"', '"pinch_b" type="revolute"'), gravity=GRAVITY
    ).model
    table = {
        frame: finger_drives(model, frame, efforts, ())
        for frame in ("hook", "slider", "claw_b", "claw_a", "jib", "post", "eye", "turret")
    }
    table |= {
        "unlimited": finger_drives(model, "hook", unlimited, ()), "pushed": finger_drives(model, "hook", efforts, ("claw_b",)), "palm is pushed": finger_drives(model, "hook", efforts, ("hook", "jib")),
        "turning": finger_drives(turning, "hook", efforts, ()),
    }  # fmt: skip
    drives = {
        "none": FingerDrives(), "one": FingerDrives(("a",), (30.0,), (False,)), "two": FingerDrives(("a", "b"), (30.0, 3.1), (False, True)), "equal": FingerDrives(("a", "b"), (30.0, 30.0), (False, False)),
        "turns": FingerDrives(("a",), (3.0,), (True,)),
    }  # fmt: skip
    table["words"] = {
        name: [one.remark(31.5)] + [one.are_weaker(force) for force in (29.9, 30.0, 30.00002, 30.00004, 31.0)]
        for name, one in drives.items()
    }
    weak = gripped(force=90.0)
    strong = gripped(force=16.0)
    table["verdicts"] = [
        weak.held.grip.verdict,
        line_of(weak.held.grip),
        strong.held.grip.verdict,
        strong.held.grip.fingers,
    ]
    table["cup"] = cupped().held.grip.fingers
    return table


# ── Mountings and bolts


@records.of
def patterns_of_bolts(folder):
    files = {
        "plain": "x,y\n0.1,0.05\n-0.1,0.07\n", "preload": "x,y,preload\n0.1,0.05,5000\n-0.1,0.07,0\n", "units": "X [mm],y [cm],Preload [kN]\n100,5,5.5\n-90,7,4.5\n",
        "columns": "x,z\n1,2\n", "order": "y,x\n1,2\n", "unit": "x [deg],y\n1,2\n", "far": "x,y\n3,4.01\n", "near": "x,y\n3,4\n", "negative": "x,y,preload\n0.1,0,5\n0.2,0,-4\n0.3,0,-7\n",
    }  # fmt: skip
    table = {}
    for name, text in files.items():
        path = folder / f"{name}.csv"
        path.write_text(text)
        try:
            table[name] = BoltPattern.from_given(str(path) if name == "plain" else path)
        except Exception:
            table[name] = refusal(lambda path=path: BoltPattern.from_given(path))
    given = {
        "circle": "5x0.31",
        "spaces": " 3 x 2e-1 ",
        "array": [[0.1, 0.2], [-0.1, 0.3]],
        "one": [0.1, 0.2],
        "large": "4x10",
        "path": folder / "plain.csv",
    }
    table |= {name: BoltPattern.from_given(one) for name, one in given.items()}
    wrong = {
        "too large": "4x10.01",
        "word": "4y3",
        "two": "4x3x2",
        "file": "bolts.csv",
        "shape": [[1, 2, 3]],
        "none": "0x0.3",
        "number": "4x1.2.3",
        "place of a path": folder / "5x0.31",
    }
    table["refused"] = {name: refusal(lambda one=one: BoltPattern.from_given(one)) for name, one in wrong.items()}
    table["angles"] = bolt_circle(5, 0.31)
    return table


@records.of
def mountings_and_their_bolts():
    robot = crane()
    whole = tw.check(
        robot,
        motion(rows=9),
        payload=PAYLOAD,
        mounting="eye",
        bolts="5x0.31",
        wrench_on_robot={"turret": (1, -2, 3, 5, 4, 60.0)},
    )
    base = tw.check(robot, motion(rows=9), payload=PAYLOAD, mounting=True)
    load = whole.held.mounting
    pulls = load.pulls(load.pattern)
    largest = pulls[..., 0].max(axis=0)
    table = {
        "whole": said(whole), "wrench": whole.mounting.wrench, "bolts": whole.bolt_loads, "columns": {name: values[:3] for name, values in load.columns().items()}, "base": words_of(base),
        "base wrench": base.mounting.wrench, "beside": words_of(tw.check(robot, motion(rows=9), mounting="eye")), "no bolts": [base.bolt_loads, base.held.mounting.verdict, sorted(base.held.mounting.columns())],
    }  # fmt: skip
    for name, preload in {
        "enough": largest + 50.0, "at": np.maximum(largest, 0.0), "one opens": largest + np.array([9, 9, -0.5, 9, 9.0]), "two open": largest + np.array([9, -2.0, -3.0, 9, 9.0]),
        "all": np.zeros(5), "rounding": largest * (1 - 0.9e-6), "more than rounding": largest * (1 - 1.1e-6),
    }.items():  # fmt: skip
        pattern = BoltPattern(load.pattern.places, np.maximum(preload, 0.0))
        one = replace(load, pattern=pattern)
        report = replace(whole, held=replace(whole.held, mounting=one))
        table[name] = [one.verdict, one.line, one.bolts[2], verdict_of(report)]
    preloaded = replace(load, pattern=BoltPattern(load.pattern.places, np.arange(5.0) * 1000 + 3))
    table["blocks"] = [shown(load.blocks()), shown(preloaded.blocks()), preloaded.columns()["bolt3.axial [N]"]]
    table["questions"] = [
        refusal(lambda: tw.check(robot, motion(rows=9), mounting="jib")), words_of(tw.check(robot, motion(rows=9), bolts="5x0.31"))["sentences"][1:3],
        isinstance(whole.verdict, Verdict), words_of(tw.check(robot, at={"luff": 0.3}, mounting=False))["sentences"][:1],
    ]  # fmt: skip
    return table


@records.of
def bolts_that_open():
    """A load that lifts the robot pulls at its bolts."""
    lifted = tw.check(
        crane(), motion(rows=9), mounting=True, bolts="5x0.31", wrench_on_robot={"post": (3, -2, 1, 20, -30, 900.0)}
    )
    load = lifted.held.mounting
    largest = load.pulls(load.pattern)[..., 0].max(axis=0)
    table = {"pulls": load.pulls(load.pattern), "line": load.line}
    for name, preload in {
        "enough": largest + 5.0, "one": largest + np.array([9, 9, -0.5, 9, 9.0]), "two": largest + np.array([9, -2.0, -3.0, 9, 9.0]), "none": np.zeros(5),
        "rounding": largest * (1 - 0.9e-6), "more than rounding": largest * (1 - 1.2e-6),
    }.items():  # fmt: skip
        one = replace(load, pattern=BoltPattern(load.pattern.places, np.maximum(preload, 0.0)))
        report = replace(lifted, held=replace(lifted.held, mounting=one))
        table[name] = [one.verdict, one.line, one.bolts[2], verdict_of(report)]
    return table


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
