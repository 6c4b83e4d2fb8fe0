"""Force-torque sensors: complete answers on record."""

from __future__ import annotations

import dataclasses
import json
import warnings

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench import sensing
from twistwrench.mechanics.lie import quaternion, so3
from twistwrench.sensing import (
    compensation,
    contact_detection,
    conventions,
    files,
    log,
    observability,
    outliers,
    poses,
    sensor,
    static_poses,
    uncertainty,
    unknowns,
)
from twistwrench.sensing import fit as fits
from twistwrench.sensing.contact_detection import CollisionThreshold
from twistwrench.sensing.doubts import departure, reading_doubts, unit_doubts
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.sensor import ForceTorqueSensor
from twistwrench.sensing.simulated_logs import lively_motion
from twistwrench.sensing.unknowns import SensorState, Unknowns

from .test_statics import Q, arm

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

INERTIA = np.array([[0.021, 0.002, -0.003], [0.002, 0.026, 0.001], [-0.003, 0.001, 0.012]])
LOAD = tw.SpatialInertia.from_com(2.7, (0.03, -0.02, 0.09), INERTIA)
BIAS = np.array([0.11, -0.23, 0.34, 5.0, -3.2, 8.1])
TURN = so3.exp(np.array([0.3, -0.5, 0.8]))
SENSOR = ForceTorqueSensor(LOAD, BIAS, mounting=TURN)
STRAIGHT = ForceTorqueSensor(LOAD, BIAS)
BY = ForceTorqueSensor(LOAD, BIAS, "by_sensor", TURN)
NOISE = np.array([0.008, 0.011, 0.014, 0.21, 0.27, 0.34])


def quietly(call):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return call()


def rotations(count, seed=1, spread=3.0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return so3.exp(
        spread * vectors / np.linalg.norm(vectors, axis=1, keepdims=True) * np.linspace(0.2, 1, count)[:, None]
    )


def at_rest(
    of=STRAIGHT, count=14, each=6, seed=2, noise=NOISE, error=0.0, time=False, spread=3.0, pose=True, name="log"
):
    """Log of dwells of unequal length, each in its orientation; ``error``: of the orientations [rad]."""
    rng = np.random.default_rng(seed)
    R = rotations(count, seed, spread)
    felt = R @ so3.exp(error * rng.normal(size=(count, 3)))
    sizes = each + np.arange(count) % 3
    readings = np.repeat(of.predict(felt), sizes, axis=0)
    readings = readings + noise * rng.normal(size=readings.shape)
    t = 0.1 * np.arange(len(readings)) + 0.01 * np.sin(np.arange(len(readings))) if time else None
    R = np.repeat(R, sizes, axis=0)
    if pose:
        return quietly(lambda: ReadingLog.from_arrays(readings, pose=R, time=t, name=name))
    g = sensor.gravity_in_frame(R)
    return quietly(lambda: ReadingLog.from_arrays(readings, gravity=g, time=t, name=name))


def moving(of=STRAIGHT, count=90, seconds=4.0, late=0.0, seed=3, noise=NOISE, rotated=True):
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, seconds, count) + 0.004 * np.sin(np.arange(count))
    T, V, dV = lively_motion(t)
    then = lively_motion(t - late)
    readings = of.predict(then[0], then[1], then[2]) + noise * rng.normal(size=(count, 6))
    where = {"pose": T} if rotated else {"gravity": sensor.gravity_in_frame(T)}
    return quietly(lambda: ReadingLog.from_arrays(readings, V=V, dV=dV, time=t, **where))


def table(path):
    """Header and numbers of a table, which a text would record to the last bit."""
    header, *rows = path.read_text("utf-8").splitlines()
    return [header, np.array([[float(x) for x in row.split(",")] for row in rows])]


def changed(source, **changes):
    return dataclasses.replace(source, **changes)


# ── The sensor


@records.of
def readings_that_a_sensor_predicts():
    t = np.array([0.0, 0.3, 0.71])
    T, V, dV = lively_motion(t)
    sensors = {
        "straight": STRAIGHT, "turned": SENSOR, "by the sensor": BY,
        "unknown inertia": ForceTorqueSensor(LOAD, BIAS, inertia="unknown"),
    }  # fmt: skip
    g = (0.7, -1.1, -9.3)
    found = {}
    for name, each in sensors.items():
        rest = quietly(lambda each=each: each.compensate(np.arange(18.0).reshape(3, 6), T, V, dV, gravity=g))
        found[name] = {
            "at rest": each.predict(T),
            "with V": each.predict(T, V),
            "moving": each.predict(T, V, dV, gravity=g),
            "broadcast": each.predict(T[1, :3, :3], V[:, None], dV[None]),
            "compensated": rest,
            "contact": each.contact_wrench(rest),
            "signals": [each.missing_signals(*x) for x in ((None, None), (V, None), (None, dV), (np.eye(6)[3:], None))],
        }
    return found | {
        "motion": [T, V, dV],
        "regressor": [sensor.load_regressor(g), sensor.load_regressor(g, V[1], dV[1]), sensor.load_regressor(g, V[1]), sensor.load_regressor(g, None, dV[1])],
        "gravity": sensor.gravity_in_frame(T, g),
        "rotations": sensor.rotations_to_gravity([[0.3, -0.5, 0.8], [0, 0, -2], [0, 0, 3], [1, 0, 0], [1e-10, 0, 1], [1e-8, 0, 1]]),
        "quaternions": sensor.rotations_of_quaternions([[0.5, 0.5, -0.5, 0.5], [0.6, 0, 0.8, 0]]),
    }  # fmt: skip


def caught(call):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        call()
    return [str(w.message) for w in found]


@records.of
def refusals_and_warnings_of_a_sensor():
    eye = np.eye(3)
    V = np.array([0.1, 0, 0, 0, 0, 0])
    hand = ForceTorqueSensor(LOAD, frame="hand")
    turned = ForceTorqueSensor(LOAD, frame="hand", mounting=TURN)
    pose = tw.Pose(np.eye(4), "world", "hand")
    other = tw.Pose(np.eye(4), "world", "flange")
    wrench = tw.Wrench(np.arange(6.0), frame="hand")
    unknown = ForceTorqueSensor(LOAD, inertia="unknown")
    inconsistent = tw.SpatialInertia.from_parameters([1.0, 0, 0, 0, 0.1, 0, 0.1, 0, 0, 0.5])
    made = [
        lambda: ForceTorqueSensor(3.0), lambda: ForceTorqueSensor(LOAD, [1, 2, 3]), lambda: ForceTorqueSensor(LOAD, sign="off"),
        lambda: ForceTorqueSensor(LOAD, inertia="some"), lambda: ForceTorqueSensor(LOAD, mounting=np.stack([eye, eye])),
        lambda: ForceTorqueSensor(LOAD, mounting=eye + 2e-3), lambda: ForceTorqueSensor(LOAD, mounting=-eye),
        lambda: ForceTorqueSensor(LOAD, [np.nan] * 6), lambda: ForceTorqueSensor(inconsistent), lambda: ForceTorqueSensor(LOAD, frame=""),
        lambda: SENSOR.predict(np.eye(2)), lambda: SENSOR.predict(eye, np.zeros(5)),
        lambda: SENSOR.predict(np.tile(eye, (3, 1, 1)), np.zeros((2, 6))), lambda: SENSOR.compensate(np.zeros((3, 6)), np.tile(eye, (2, 1, 1))),
        lambda: sensor.rotations_of_quaternions([1.0, 0.05, 0, 0]), lambda: hand.predict(other), lambda: hand.predict(wrench),
        lambda: turned.compensate(wrench, pose), lambda: hand.contact_wrench(tw.Wrench(np.arange(6.0), frame="flange")),
        lambda: sensor.checked_sensor(4, "act"),
    ]  # fmt: skip
    return {
        "refused": [refusal(call) for call in made],
        "accepted": [
            ForceTorqueSensor(inconsistent, inertia="accept").load.mass,
            ForceTorqueSensor(inconsistent, inertia="unknown").inertia,
            ForceTorqueSensor(LOAD, mounting=np.round(TURN, 4)).mounting,
            hand.compensate(wrench, pose),
            turned.compensate(tw.Wrench(np.arange(6.0), frame="gauge"), pose),
            hand.contact_wrench(wrench),
        ],
        "warned": [
            caught(lambda: unknown.compensate(np.zeros(6), eye, V)), caught(lambda: unknown.compensate(np.zeros(6), eye)),
            caught(lambda: STRAIGHT.compensate(np.zeros(6), eye, V)), caught(lambda: moving(count=5).compensated(unknown)),
        ],
    }  # fmt: skip


# ── Logs


@records.of
def logs_of_arrays():
    R = rotations(4)
    F = np.arange(24.0).reshape(4, 6) ** 1.1
    T, V, dV = lively_motion([0.0, 0.2, 0.5, 0.9])
    quat = np.asarray(quaternion.from_matrix(R))
    made = {
        "rotations": {"pose": R, "gravity": (0.5, -0.4, -9.6)},
        "poses": {"pose": T, "V": V, "dV": dV, "time": [0.0, 0.2, 0.5, 0.9], "name": "run"},
        "one pose": {"pose": R[2]},
        "quaternions": {"quaternion": quat},
        "gravity": {"gravity": np.outer([1, 2, 3, 4.0], [0.5, 0.3, -2.0])},
        "one gravity": {"gravity": [0.1, 0.2, -9.8]},
        "one twist": {"gravity": [0.1, 0.2, -9.8], "V": V[1], "dV": dV[1]},
    }
    logs = {name: ReadingLog.from_arrays(F, **options) for name, options in made.items()}
    whole = logs["poses"]
    return {
        name: {f.name: getattr(each, f.name) for f in dataclasses.fields(each)} | {"text": repr(each), "clock": each.clock}
        for name, each in logs.items()
    } | {
        "rows": [len(whole.rows(x)) for x in (slice(2), [True, False, True, True], [3, 1])],
        "rows of times": whole.rows([3, 1]).time,
        "predicted": whole.predicted(SENSOR),
        "compensated": whole.compensated(BY),
        "late": [log.first_late_row(np.array(t)) for t in ([0.0, 1, 2], [0, 1, 1, 2], [0, 2, 1, 0.5], [3.0])],
        "refused": [
            refusal(lambda o=o, f=f: ReadingLog.from_arrays(f, **o))
            for f, o in (
                (np.zeros((0, 6)), {}), (np.zeros((4, 5)), {}), (F, {"pose": R, "quaternion": quat}), (F, {"pose": R[:3]}),
                (F, {"V": V}), (F, {"dV": dV}), (F, {"gravity": np.zeros(3)}), (F, {"time": [0, 1, 1, 2]}), (F, {"time": [0, 1]}),
                (np.where(F > 20, np.nan, F), {}), (F, {"V": V[:2], "dV": dV}), (F, {"quaternion": 1.01 * quat}),
            )
        ],
        "rows refused": [refusal(lambda x=x: whole.rows(x)) for x in ([9], [True], "all")],
        "no sensor": refusal(lambda: whole.predicted(3)),
        "no log": refusal(lambda: log.checked_log(3, "act")),
    }  # fmt: skip


@records.of
def doubts_about_sizes_in_a_log():
    base = at_rest(count=5)
    move = moving(count=12)

    def forces(size, moment=1.0):
        rows = np.zeros((5, 6))
        rows[:, 5] = [0.0, 0, 0, size, 0]
        rows[:, 1] = [0.0, 0, 0, moment, 0]
        return changed(base, readings=rows + 40.0, gravity=base.gravity[:5])

    def scaled(field, column, peak):
        values = getattr(move, field).copy()
        values[3, column] = peak
        return changed(move, **{field: values})

    cases = {
        "fine": base,
        "force 1090": forces(1090.0), "force 1110": forces(1110.0),
        "moment 9.9": forces(0.5, 9.9), "moment 10.1": forces(0.5, 10.1), "lever 4.9": forces(4.0, 19.6), "lever 5.1": forces(4.0, 20.4),
        "moments alone": forces(0.0, 30.0),
        "turned 1.9": changed(base, turned=np.radians(1.9)), "turned 2.1": changed(base, turned=np.radians(2.1)),
        "gravity 1.4": changed(base, gravity=base.gravity * 1.4 / 9.81), "gravity 1.6": changed(base, gravity=base.gravity * 1.6 / 9.81),
        "gravity 29": changed(base, gravity=base.gravity * 29 / 9.81), "gravity 31": changed(base, gravity=base.gravity * 31 / 9.81),
        "w 49": scaled("V", 1, -49.0), "w 51": scaled("V", 1, -51.0), "v 29": scaled("V", 4, -29.0), "v 31": scaled("V", 4, -31.0),
        "a 990": scaled("dV", 4, -990.0), "a 1010": scaled("dV", 4, -1010.0), "angular acceleration": scaled("dV", 1, 5000.0),
    }  # fmt: skip
    return {name: [str(d) for d in each.doubts()] for name, each in cases.items()}


@records.of
def static_poses_of_logs():
    dwells = at_rest()
    short = dwells.rows(np.r_[0:8, 9, 16, 17:23, 30, 31:38])
    rng = np.random.default_rng(5)
    t = np.linspace(0, 1, 40)
    T, V, dV = lively_motion(t)
    still = np.zeros(40, bool)
    still[[4, 5, 6, 7, 20, 21, 22, 23, 24, 25]] = True
    mixed = quietly(
        lambda: ReadingLog.from_arrays(
            rng.normal(size=(40, 6)),
            pose=np.where(still[:, None, None], T[5], T),
            V=V * ~still[:, None],
            dV=dV * ~still[:, None],
        )
    )
    slow = [
        changed(mixed, V=np.where(still[:, None], v, V), dV=np.where(still[:, None], a, dV))
        for v, a in (
            ([0.019, 0, 0, 0.0099, 0, 0], [0.19, 0, 0, 0, 0.19, 0]), ([0.021, 0, 0, 0, 0, 0], np.zeros(6)),
            ([0, 0, 0, 0, 0.011, 0], np.zeros(6)), (np.zeros(6), [0, 0, 0.21, 0, 0, 0]), (np.zeros(6), [0, 0, 0, 0.21, 0, 0]),
        )
    ]  # fmt: skip
    revisited = changed(dwells, readings=dwells.readings[::-1])
    back = dwells.rows(np.r_[0:20, 0:14, 6:30])
    by_gravity = at_rest(pose=False).rows(np.r_[0:20, 0:14, 6:30])
    near = so3.exp(np.outer(np.repeat([0.0, 0.003, 1.0, 2.0, 0.0015], 6), [0.8, 0.6, 0.0]))
    between = quietly(lambda: ReadingLog.from_arrays(rng.normal(size=(30, 6)), pose=near))
    cases = {
        "between": between,
        "dwells": dwells,
        "short": short,
        "mixed": mixed,
        "revisited": revisited,
        "back": back,
        "by gravity": by_gravity,
    }
    cases |= {f"slow {k}": each for k, each in enumerate(slow)}
    found = {name: static_poses.static_poses(each) for name, each in cases.items()}
    small = [
        static_poses._direction_tolerance(np.array(d))
        for d in (
            [[0, 0, 1.0]],
            [[0, 0, 1.0], [0, 0.001, 1]],
            [[0, 0, 1.0], [0, 1.0, 0], [1.0, 0, 0]],
            [[0, 0, 1.0], [0, 0.006, 1], [0, 0.012, 1], [1, 0, 0.0]],
        )
    ]
    return {
        name: {
            "count": p.count, "row": p.row, "label": p.label, "moving": p.moving, "within": p.within, "freedom": p.within_freedom,
            "readings": p.log.readings, "gravity": p.log.gravity, "time": p.log.time, "spread": p.spread(np.arange(len(p.count)) % 2 == 0),
        }
        for name, p in found.items()
        if not name.startswith("slow")
    } | {
        "slow": {name: p.count for name, p in found.items() if name.startswith("slow")},
        "tolerance": small,
        "runs": [static_poses.runs(np.array(m, bool)) for m in ([], [1, 1, 0, 1], [0, 1, 1, 0], [0, 0])],
    }  # fmt: skip


# ── Files


HEADER = "mx,my,mz,fx,fy,fz,gx,gy,gz"
ROWS = "0.1,-0.2,0.3,1,2,-30,0.1,0.2,-0.9\n0.2,0.1,-0.3,4,-2,-29,0.5,-0.2,-0.8\n0.4,0.3,0.2,-3,1,28,0.1,0.1,0.9\n"


def csv_texts():
    quat = "0.5,0.5,-0.5,0.5"
    rows = [r.split(",") for r in ROWS.split()]
    plain = [",".join(r[:6]) for r in rows]
    matrix = ",".join(f"{x:.9f}" for x in TURN.ravel())
    motion = "wx,wy,wz,vx,vy,vz,dwx,dwy,dwz,dvx,dvy,dvz"
    twelve = "0.1,0.2,0.3,0.4,0.5,0.6,0.7,0.8,0.9,1.0,1.1,1.2"
    return {
        "gravity": f"{HEADER}\n{ROWS}",
        "units": "Tx [Nm],ty (N*m),mz [N·m],FX [N],fy,fz,gx [m/s^2],gy [-],gz [],Time [s]\n" + "".join(f"{r},{0.1 * k}\n" for k, r in enumerate(ROWS.split())),
        "other columns": f"{HEADER},fxx,px,py,note,qz1\n" + "".join(f"{r},1,2,3,4,5\n" for r in ROWS.split()),
        "quaternion": "mx,my,mz,fx,fy,fz,qw,qx,qy,qz\n" + "".join(f"{p},{quat}\n" for p in plain),
        "matrix": "mx,my,mz,fx,fy,fz,r11,r12,r13,r21,r22,r23,r31,r32,r33\n" + "".join(f"{p},{matrix}\n" for p in plain),
        "motion": f"t,{HEADER},{motion}\n" + "".join(f"{0.2 * k},{r},{twelve}\n" for k, r in enumerate(ROWS.split())),
        "motion with units": f"{HEADER},wx [rad/s],wy,wz,vx [m/s],vy,vz,dwx [rad/s^2],dwy,dwz,dvx [m/s2],dvy,dvz\n" + "".join(f"{r},{twelve}\n" for r in ROWS.split()),
    }  # fmt: skip


@records.of
def logs_of_files(folder):
    found = {}
    for name, text in csv_texts().items():
        path = folder / f"{name}.csv"
        path.write_text(text)
        each = quietly(lambda path=path: sensing.read_log(path, gravity=(0.4, 0.3, -9.7)))
        found[name] = {f.name: getattr(each, f.name) for f in dataclasses.fields(each)}
        sensing.write_log(each, folder / "again.csv")
        found[name]["written"] = table(folder / "again.csv")
    return found


@records.of
def refusals_of_log_files(folder):
    first = ROWS.split()[0]
    texts = {
        "missing": f"mx,my,mz,fx,fy,gx,gy,gz\n{first.rsplit(',', 1)[0]}\n",
        "similar": f"mx,my,mz,force_x,fy,fz,gx,gy,gz\n{first}\n",
        "torque": f"torque_x,my,mz,fx,fy,fz,gx,gy,gz\n{first}\n",
        "tick": f"mx,my,t_z,fx,fy,fz,gx,gy,gz\n{first}\n",
        "no orientation": f"mx,my,mz,fx,fy,fz,a1,b2,c3\n{first}\n",
        "angles": f"mx,my,mz,fx,fy,fz,roll,Pitch,yaw\n{first}\n",
        "one angle": f"mx,my,mz,fx,fy,fz,roll,u1,u2\n{first}\n",
        "two orientations": f"{HEADER},qw,qx,qy,qz\n{first},1,0,0,0\n",
        "half a quaternion": f"mx,my,mz,fx,fy,fz,qw,qx,q_y\n{first}\n",
        "half a motion": f"{HEADER},wx,wy,wz,vx,vy,vz\n{first},1,2,3,4,5,6\n",
        "twice": f"{HEADER},Fx\n{first},1\n",
        "millimetres": f"mx [N mm],my,mz,fx,fy,fz,gx,gy,gz\n{first}\n",
        "degrees": f"{HEADER},wx [deg/s]\n{first},1\n",
        "grams": f"mx,my,mz,fx [g],fy,fz,gx,gy,gz\n{first}\n",
        "milliseconds": f"{HEADER},time [ms]\n{first},1\n",
        "gravity": f"mx,my,mz,fx,fy,fz,gx [cm],gy,gz\n{first}\n",
        "empty": f"{HEADER}\n",
        "no header": f"{first}\n{first}\n",
        "late": f"{HEADER},time\n{first},0.1\n{first},0.2\n{first},0.2\n",
        "no gravity": f"{HEADER}\n{first}\n0,0,0,1,2,3,0,0,0\n",
        "text": f"{HEADER}\n{first}\n0,0,0,one,2,3,0,0,1\n",
    }
    found = {}
    for name, text in texts.items():
        path = folder / f"{name}.csv"
        path.write_text(text)
        found[name] = refusal(lambda path=path: sensing.read_log(path))
    return found | {
        "not there": refusal(lambda: sensing.read_log(folder / "none.csv")),
        "not a path": refusal(lambda: sensing.read_log(3)),
        "write": [refusal(lambda: sensing.write_log(folder, "a.csv")), refusal(lambda: sensing.write_log(at_rest(count=4), 3))],
        "swapped": refusal(lambda: sensing.write_log("a.csv", at_rest(count=4))),
    }  # fmt: skip


@records.of
def logs_with_joint_positions(folder):
    names = arm().joint_names
    rows = np.array([Q, Q + 0.1, Q - 0.2 * np.arange(6)])
    plain = [",".join(r.split(",")[:6]) for r in ROWS.split()]

    def text(unit="", scale=1.0, time=True, more="", rest=""):
        header = (
            ("time," if time else "")
            + "mx,my,mz,fx,fy,fz,"
            + ",".join(f"{n}{unit if n != 'raise' else ''}" for n in names)
            + more
        )
        lines = [
            (f"{0.1 * k}," if time else "")
            + p
            + ","
            + ",".join(f"{x * (scale if n != 'raise' else 1):.9f}" for n, x in zip(names, q, strict=True))
            + rest
            for k, (p, q) in enumerate(zip(plain, rows, strict=True))
        ]
        return "\n".join([header, *lines]) + "\n"

    found = {}
    cases = {
        "radians": (text(), {}), "frame": (text(), {"frame": "upper"}), "degrees": (text(" [deg]", 180 / np.pi), {}),
        "degrees by option": (text("", 180 / np.pi), {"degrees": True}), "without times": (text(time=False), {}),
        "with gravity": (text(more=",gx,gy,gz", rest=",0.1,0.2,-0.9"), {}),
    }  # fmt: skip
    for name, (content, options) in cases.items():
        path = folder / f"{name}.csv"
        path.write_text(content)
        each = quietly(lambda path=path, options=options: sensing.read_log(path, robot=arm(), **options))
        found[name] = [each.gravity, each.turned, each.notes, each.time, [str(d) for d in each.doubts()]]
    path.write_text(text().replace("bend", "bent"))
    return found | {"missing": refusal(lambda: sensing.read_log(path, robot=arm()))}


@records.of
def sensor_files(folder):
    found = quietly(lambda: sensing.identify(at_rest()))
    known = quietly(lambda: sensing.identify(at_rest(), noise=NOISE, bias=BIAS))
    sensors = {
        "plain": (STRAIGHT, (0.01, 0.3), None), "turned": (BY, (0.0, 0.0), None),
        "frame": (ForceTorqueSensor(LOAD, BIAS, frame="hand", inertia="unknown"), (0.02, 0.4), None),
        "identified": (found.sensor, found.noise, found.uncertainty), "known noise": (known.sensor, known.noise, known.uncertainty),
    }  # fmt: skip
    written = {}
    for name, (each, noise, doubt) in sensors.items():
        path = folder / f"{name}.json"
        sensing.write_sensor(each, path, noise, doubt)
        again = files.read_sensor_file(path)
        written[name] = {
            "file": list(json.loads(path.read_text())), "size": len(path.read_text().splitlines()), "read": again,
        }  # fmt: skip
    plain = (folder / "plain.json").read_text()
    old = plain.replace(' "inertia": "given",\n', "")
    point = tw.SpatialInertia.from_com(2.0, (0.1, 0.2, 0.3)).parameters.tolist()
    texts = {
        "old": old, "old point mass": old.replace(str(LOAD.parameters.tolist()[0]), str(LOAD.parameters.tolist()[0])),
        "no object": "[1, 2]", "no JSON": "{", "no sign": plain.replace('"sign"', '"sense"'), "other sign": plain.replace("on_sensor", "off"),
        "negative": plain.replace("2.7,", "-2.7,"), "noise": plain.replace("0.01,", "-0.01,"), "huge": plain.replace("2.7,", "1e999,"),
    }  # fmt: skip
    results = {}
    for name, text in texts.items():
        path = folder / "case.json"
        path.write_text(text)
        try:
            results[name] = files.read_sensor_file(path).sensor.inertia
        except tw.TwistWrenchError as error:
            results[name] = f"{type(error).__name__}: {error}"
    states = [
        files._inertia_state({}, tw.SpatialInertia.from_parameters(np.array(p)))
        for p in (point, LOAD.parameters.tolist(), [0.0] * 10, [1.0, 0, 0, 0, 0.1, 0, 0.1, 0, 0, 0.5])
    ]
    return written | results | {
        "states": states,
        "not there": refusal(lambda: sensing.read_sensor(folder / "none.json")),
        "not a path": refusal(lambda: sensing.read_sensor(3)),
        "write": [
            refusal(lambda: sensing.write_sensor(3, folder / "a.json", (0.1, 0.2))),
            refusal(lambda: sensing.write_sensor(STRAIGHT, 3, (0.1, 0.2))),
            refusal(lambda: sensing.write_sensor(STRAIGHT, folder / "a.json", (0.1, -0.2))),
            refusal(lambda: sensing.write_sensor(STRAIGHT, folder / "a.json", (0.1, 0.2), "x")),
        ],
        "bundled": [files.log_path("demo").name, files.log_path("demo-motion").name, str(files.log_path("a.csv")), files.sensor_path("demo").name],
    }  # fmt: skip


# ── Contacts


F = np.array(
    [
        [0.3, -0.5, 0.8, 4.0, -7.0, 9.0],
        [0.1, 0.2, 0.3, 0, 0, 0],
        [0.5, 0.1, -0.2, 0, 3.0, 0.0],
        [-0.9, 0.4, 1.1, -6.0, 2.0, -8.0],
    ]
)


@records.of
def points_of_contact():
    return {
        "moment": sensing.residual_moment(F),
        "plane": sensing.contact_on_plane(F, (0.1, 0.2, 0.3), (0.2, -0.3, 0.9)),
        "parallel planes": sensing.contact_on_plane(
            [[0.1, 0.2, 0.3, 0, 3.0, 0]] * 3, (0.1, 0.2, 0.3), [[0, 0, 2.0], [0, 1e-11, 2], [0, 4e-12, 2.0]]
        ),
        "sphere": sensing.contact_on_sphere(F, (0.05, -0.02, 0.06), 0.21),
        "small sphere": sensing.contact_on_sphere(F, (0.05, -0.02, 0.06), 0.03),
        "nearest": sensing.contact_nearest(F, [[0.1, 0.2, 0.3], [0.1, 0, 0], [0.2, 0.4, 0.1], [0, 0, 0.5]]),
        "one": [sensing.residual_moment(F[0]), sensing.contact_nearest(F[0], (0.1, 0.2, 0.3))],
        "no radius": refusal(lambda: sensing.contact_on_sphere(F, (0, 0, 0), 0.0)),
    }


@records.of
def thresholds_of_contacts():
    rng = np.random.default_rng(8)
    B = rng.normal(size=(6, 6))
    S = B @ B.T + 0.3 * np.eye(6)
    r = 3.0 * rng.normal(size=(5, 6))
    freedom = np.array([4.0, 6, 9, 15, 30, np.inf])
    singular = S.copy()
    singular[:, 5], singular[5, :] = singular[:, 2], singular[2, :]
    singular[5, 5] = singular[2, 2]
    made = {
        "axes": CollisionThreshold.of_axes(NOISE, 1e-4), "forces": CollisionThreshold.of_axes(NOISE, 1e-4, axes=slice(3, 6)),
        "noise": CollisionThreshold.of_noise((0.02, 0.5)), "moments": CollisionThreshold.of_noise((0.02, 0.5), 1e-3, axes=slice(0, 3)),
        "covariance": CollisionThreshold.predictive(S, None, 1e-3), "freedom": CollisionThreshold.predictive(S, freedom, 1e-3),
        "forces, freedom": CollisionThreshold.predictive(S, freedom, 1e-3, axes=slice(3, 6)),
        "each": CollisionThreshold.predictive(np.stack([(k + 1.0) * S for k in range(5)]), freedom, 1e-3),
        "residuals": CollisionThreshold.of_residuals(rng.normal(size=(12, 6)) @ B + 0.2, 1e-3),
        "singular": CollisionThreshold.predictive(singular, None, 1e-3),
    }  # fmt: skip
    zeros = np.zeros((9, 6))
    ramp = np.outer(np.arange(9.0), np.arange(1, 7.0))
    limits = CollisionThreshold.of_axes(np.ones(6), 0.5, axes=slice(0, 1))
    return {
        name: {
            "limit": t.limit, "middle": t.middle, "covariance": t.covariance, "rate": t.false_alarms,
            "distance": t.distance(r) if name != "singular" else None, "contacts": t(r), "per axis": t.per_axis if name != "singular" else None,
        }
        for name, t in made.items()
    } | {
        "sides": [bool(limits([x, 9, 9, 9, 9, 9])) for x in (0.67, 0.68, np.nan)],
        "refused": [
            refusal(call)
            for call in (
                lambda: CollisionThreshold.of_noise((0.1, 0.0)), lambda: CollisionThreshold.of_noise((0.1, 0.2), 0.0),
                lambda: CollisionThreshold.of_noise((0.1, 0.2), 1.0), lambda: CollisionThreshold.of_noise((0.1,)),
                lambda: CollisionThreshold.of_axes([1, 2, 3, 4, 5, 0]), lambda: CollisionThreshold.of_axes([1, 2, 3, 4, 5, np.inf]),
                lambda: CollisionThreshold.predictive(S, None, 0.1, axes=3), lambda: CollisionThreshold.of_residuals(zeros[:, :5]),
                lambda: CollisionThreshold.of_residuals(ramp[:7]), lambda: CollisionThreshold.of_residuals(zeros),
                lambda: CollisionThreshold.of_residuals(ramp), lambda: contact_detection.checked_noise((0.0, -0.1), none_at_all=True),
                lambda: contact_detection.six_noises([1, 2, 3]),
            )
        ],
        "noise": [contact_detection.checked_noise((0.0, 0.0), none_at_all=True), contact_detection.six_noises((0.1, 0.2)), contact_detection.six_noises(NOISE)],
    }  # fmt: skip


# ── Identification


def findings(found):
    """Numbers and doubts of an identification."""
    return {
        "mass": found.sensor.load.mass, "com": found.sensor.load.com, "bias": found.sensor.bias, "turn": found.turn,
        "sigma": found.fit.sigma, "freedom": found.fit.freedom, "deviation": np.sqrt(np.diag(found.fit.covariance)), "known": found.fit.known,
        "joint": np.sqrt(np.diag(found.fit.joint)), "joint freedom": found.fit.joint_freedom, "com intervals": found.com_intervals,
        "verdict": str(found.verdict), "doubts": [str(d) for d in found.doubts], "kept": int(found.kept.sum()), "rows": int(found.rows.sum()),
        "outliers": found.outliers, "text": repr(found), "state": [found.fit.state.tilt, found.fit.state.delay, found.fit.state.middle],
    }  # fmt: skip


def drift(source, rate, gain=0.0):
    middle = np.arange(len(source)) - 0.5 * len(source)
    readings = source.readings + np.outer(middle, rate)
    return changed(
        source,
        readings=readings
        + gain * (readings - readings.mean(axis=0))[:, [3, 4, 5, 0, 1, 2]] * [0.02, 0.03, 0.01, 0, 0, 0],
    )


@records.of(relative=1e-4)
def identification_with_each_option():
    rest, timed, move = at_rest(), at_rest(time=True, count=16), moving(seed=9)
    turned = at_rest(SENSOR)
    cases = {
        "plain": (rest, {}), "by the sensor": (at_rest(ForceTorqueSensor(LOAD, BIAS, "by_sensor")), {"sign": "by_sensor"}),
        "known bias": (rest, {"bias": BIAS}), "known noise": (rest, {"noise": NOISE}), "two noises": (rest, {"noise": (0.011, 0.27)}),
        "keep": (rest, {"outliers": "keep"}), "confidence": (rest, {"confidence": 0.8}), "orientation": (turned, {"assume": "orientation"}),
        "by the sensor, turned": (at_rest(BY), {"sign": "by_sensor", "assume": ["orientation"]}), "drift": (drift(rest, 0.002 * NOISE), {"assume": "drift"}),
        "drift in time": (drift(timed, 0.003 * NOISE), {"assume": ("drift",)}), "tilt": (rest, {"assume": "tilt"}),
        "moving": (move, {}), "inertia": (move, {"inertia": True}), "delay": (moving(late=0.03), {"inertia": True, "assume": "delay"}),
        "all": (moving(SENSOR, count=120, late=-0.02), {"inertia": True, "assume": ("orientation", "drift", "tilt", "delay")}),
        "few": (at_rest(count=4), {}), "single readings": (at_rest(each=1, count=15).rows(np.arange(0, 29, 2)), {}),
    }  # fmt: skip
    return {
        name: findings(quietly(lambda each=each, o=o: sensing.identify(each, **o))) for name, (each, o) in cases.items()
    }


@records.of(relative=1e-4)
def identification_answers(folder):
    move, rest = moving(SENSOR, count=120, late=-0.02), at_rest(each=8)
    whole = quietly(lambda: sensing.identify(move, inertia=True, assume=("orientation", "drift", "tilt", "delay")))
    known = quietly(lambda: sensing.identify(rest, bias=BIAS, confidence=0.98765))
    demo = sensing.identify("demo")
    other = at_rest(seed=6)
    return {
        "whole": str(whole).splitlines(), "known bias": known, "demo": str(demo).splitlines(), "facts": [whole.facts(), known.facts()],
        "drift without times": str(quietly(lambda: sensing.identify(rest, assume="drift"))).splitlines(),
        "table": table(known.to_csv(folder / "rest.csv")), "rest": [known.rest(other), whole.rest(move)],
        "intervals": {n: whole.interval(n) for n in whole.fit.unknowns.names}, "no interval": refusal(lambda: known.interval("Ixx")),
        "com": [known.com_region_contains(c) for c in (known.sensor.load.com, LOAD.com, [0.04, -0.02, 0.09], [0.03, -0.02, 0.1])],
        "region": [known.region_contains(m, c) for m, c in ((2.7, LOAD.com), (2.75, LOAD.com), (2.7, [0.035, -0.02, 0.09]))],
        "com shape": refusal(lambda: known.com_region_contains([1, 2])), "deviation": known.com_deviation,
        "uncertainty": [known.uncertainty, whole.uncertainty], "predictive": known.uncertainty.predictive(other.rows([0, 40]), known.sensor),
        "predictive of all": whole.uncertainty.predictive(move.rows([3, 77]), whole.sensor),
        "subject": [known.subject, known.brief, sorted(demo.sources())],
    }  # fmt: skip


def in_centimetres(share):
    """Log whose moments are in N cm, with a share of the usual noise."""
    each = at_rest(noise=share * NOISE)
    return changed(each, readings=each.readings * [100, 100, 100, 1, 1, 1])


def mistaken_logs():
    """Logs with a mistake each, and the options of their identification."""
    rest, move = at_rest(), moving(seed=9)
    r = rest.readings
    by_gravity = at_rest(pose=False)
    R = so3.exp(np.outer(np.linspace(0, 5, 20), [0.1, 0.9, 0.2]))
    one_axis = quietly(
        lambda: ReadingLog.from_arrays(
            SENSOR.predict(np.repeat(R, 5, axis=0)) + NOISE * np.random.default_rng(3).normal(size=(100, 6)),
            pose=np.repeat(R, 5, axis=0),
        )
    )
    touched = r.copy()
    touched[[3, 4, 40]] += [0, 0.5, 0, 12, 0, -9]
    dwell = r.copy()
    dwell[rest.gravity[:, 0] == rest.gravity[30, 0]] += [0, 1.5, 0, 15, 0, -9]
    smooth = so3.exp(
        np.outer(np.linspace(0, 4, 60), [0.5, 0.6, 0.3]) + 0.3 * np.sin(np.outer(np.arange(60) / 9, [1, 2, 3]))
    )
    steady = quietly(lambda: ReadingLog.from_arrays(moving(count=60).readings, pose=smooth))
    light = ForceTorqueSensor(tw.SpatialInertia.from_com(0.01, (0.02, 0.01, 0.05)), BIAS)
    walk = np.cumsum(np.random.default_rng(4).normal(size=r.shape), axis=0)
    return {
        "other sign": (changed(rest, readings=-r), {}),
        "other sign by gravity": (changed(by_gravity, readings=-by_gravity.readings), {}),
        "other sign in motion": (changed(move, readings=-move.readings), {}),
        "turned": (at_rest(SENSOR), {}),
        "turned, other sign": (at_rest(BY), {}),
        "swapped": (changed(rest, readings=r[:, [3, 4, 5, 0, 1, 2]]), {}),
        "wrong bias": (rest, {"bias": BIAS + np.array([0.2, 0, 0, 4, 0, -3])}),
        "bias within noise": (rest, {"bias": BIAS + 0.1 * NOISE}),
        "gravity up in motion": (changed(moving(rotated=False), gravity=-moving(rotated=False).gravity), {"inertia": True}),
        "poses wrong": (changed(rest, gravity=rest.gravity[::-1], rotations=rest.rotations[::-1]), {}),
        "pose errors": (at_rest(error=0.15), {}),
        "small pose errors": (at_rest(error=0.02), {}),
        "steady motion": (steady, {}),
        "one axis": (one_axis, {"assume": "orientation"}),
        "grams": (changed(rest, readings=r / [1, 1, 1, 0.00980665, 0.00980665, 0.00980665]), {}),
        "kilograms": (changed(rest, readings=r / [1, 1, 1, 9.80665, 9.80665, 9.80665]), {}),
        "N mm": (changed(rest, readings=r * [1000, 1000, 1000, 1, 1, 1]), {}),
        "N cm": (changed(rest, readings=r * [100, 100, 100, 1, 1, 1]), {}),
        "counts": (changed(rest, readings=r * 900.0), {}),
        "N cm, little noise": (in_centimetres(0.03), {}),
        "N cm, hardly any noise": (in_centimetres(0.008), {}),
        "touched": (changed(rest, readings=touched), {}),
        "touched, kept": (changed(rest, readings=touched), {"outliers": "keep"}),
        "touched in time": (changed(at_rest(time=True), readings=touched), {}),
        "dwell touched": (changed(rest, readings=dwell), {}),
        "light": (at_rest(light), {}),
        "drift": (drift(rest, 0.05 * NOISE), {}),
        "gain": (drift(rest, 0 * NOISE, 1.0), {}),
        "tilt": (changed(rest, gravity=(np.swapaxes(rest.rotations, 1, 2) @ so3.exp(np.array([0.05, -0.03, 0])) @ [0, 0, -9.81])), {}),
        "delay": (moving(late=0.04), {"inertia": True}),
        "no inertia": (move, {}),
        "too little noise": (rest, {"noise": 0.4 * NOISE}),
        "too little noise of forces": (rest, {"noise": (0.012, 0.1)}),
        "wandering": (changed(rest, readings=r + 0.5 * NOISE * walk), {}),
        "between dwells": (at_rest().rows(np.r_[0:8, 9, 16:23, 25, 30:38, 44:60]), {}),
        "motion in degrees": (changed(move, V=move.V * 57.3), {}),
        "gravity in g": (changed(by_gravity, gravity=by_gravity.gravity / 9.81), {}),
        "few orientations": (at_rest(count=6), {}),
    }  # fmt: skip


@records.of(relative=1e-4)
def identification_of_mistaken_logs():
    found = {}
    for name, (each, options) in mistaken_logs().items():
        try:
            answer = quietly(lambda each=each, options=options: sensing.identify(each, **options))
            found[name] = [
                answer.sensor.load.mass,
                str(answer.verdict.word),
                [str(d) for d in answer.doubts],
                len(answer.outliers),
            ]
        except tw.TwistWrenchError as error:
            found[name] = f"{type(error).__name__}: {error}"
    return found


def problem_of(each, **options):
    """Problem of a fit, with rows for dwells."""
    p = static_poses.static_poses(each)
    options = {"unknowns": Unknowns(), "factor": 1.0, "bias": np.zeros(6), "noise": None} | options
    return fits.Problem(p.log, *options.values(), p.count, p.within, p.within_freedom, p.label)


def explained(found):
    if found is None:
        return None
    fit = found.fit
    return [
        found.sign,
        found.options,
        found.noise,
        found.noise_product,
        found.freedom,
        fit.estimate,
        fit.sigma,
        np.sqrt(np.diag(fit.covariance)),
        fit.mounting,
    ]


@records.of(relative=1e-4)
def explanations_by_other_conventions():
    rest, move = at_rest(), moving()
    swapped = changed(rest, readings=rest.readings[:, [3, 4, 5, 0, 1, 2]])
    upward = changed(moving(rotated=False), gravity=-moving(rotated=False).gravity)
    turned = problem_of(at_rest(SENSOR), unknowns=Unknowns(turn=True))
    plain, wrong = (
        problem_of(rest),
        problem_of(rest, unknowns=Unknowns(bias=False), bias=BIAS + np.array([0.2, 0, 0, 4, 0, -3])),
    )
    up = problem_of(upward, unknowns=Unknowns(inertia=True))
    known = problem_of(swapped, noise=NOISE[[3, 4, 5, 0, 1, 2]])
    found = {name: conventions.explain(sign, p) for name, sign, p in (
        ("plain", "on_sensor", plain), ("other sign", "by_sensor", plain), ("turned", "on_sensor", turned), ("turned, by", "by_sensor", turned),
        ("swapped", "on_sensor", problem_of(swapped)), ("wrong bias", "on_sensor", wrong), ("up", "on_sensor", up), ("known noise", "on_sensor", known),
    )}  # fmt: skip
    by_two = conventions.others("on_sensor", problem_of(at_rest(BY)))
    return {name: explained(each) for name, each in found.items()} | {
        "swap": explained(conventions.swap_forces_and_moments(problem_of(swapped), found["swapped"])), "swap, known noise": explained(conventions.swap_forces_and_moments(known, found["known noise"])),
        "no swap": explained(conventions.swap_forces_and_moments(plain, found["plain"])), "free bias": explained(conventions.free_bias(found["wrong bias"], wrong)),
        "no free bias": explained(conventions.free_bias(found["plain"], plain)), "upside down": explained(conventions.upside_down(found["up"], up, found["up"])),
        "not upside down": [explained(conventions.upside_down(found["plain"], plain, found["plain"])), explained(conventions.upside_down(found["plain"], problem_of(move), found["plain"]))],
        "others": [explained(each) for each in by_two], "best": [each.options for each in conventions.indistinguishable_from_the_best(by_two)],
        "guess": [conventions.first_guess(p) for p in (turned, plain, wrong, up)],
        "better": [found["plain"].improves(found["other sign"].fit), found["turned"].improves(found["turned"].fit), found["plain"].equals(found["plain"].fit, found["plain"].kept)],
    }  # fmt: skip


def outcome(call):
    """Text of an answer, or of an error."""
    try:
        return repr(quietly(call))
    except tw.TwistWrenchError as error:
        return f"{type(error).__name__}: {error}"


@records.of(relative=1e-4)
def refusals_of_identification():
    rest, move = at_rest(), moving(count=30)
    upright = changed(rest, gravity=np.tile([0.0, 0, -9.81], (len(rest), 1)), rotations=None)
    two = at_rest(count=2)
    cases = [
        (rest, {"sign": "on"}), (rest, {"assume": "turn"}), (rest, {"bias": [1, 2]}), (rest, {"noise": [0.1]}), (rest, {"noise": (0.1, 0)}),
        (rest, {"outliers": "drop"}), (rest, {"confidence": 1.0}), (rest, {"confidence": 0.0}), (rest, {"inertia": True}), (rest, {"assume": "delay"}),
        (at_rest(pose=False), {"assume": "tilt"}), (changed(move, time=None), {"assume": "delay"}), (two, {}), (rest.rows(slice(3)), {}),
        (upright, {}), (upright, {"bias": BIAS}), (rest.rows(slice(2)), {}), (3, {}), ("none.csv", {}),
        (move.rows(slice(6)), {"inertia": True}), (at_rest(pose=False), {"inertia": 1}),
    ]  # fmt: skip
    return [outcome(lambda each=each, o=o: sensing.identify(each, **o)) for each, o in cases]


@records.of
def unobservable_unknowns_and_advice():
    R = so3.exp(np.outer(np.linspace(0, 2.5, 8), [0.1, 0.9, 0.2])) @ TURN
    logs = {
        "upright": ReadingLog.from_arrays(np.zeros((3, 6)), gravity=[0.3, 0.2, -9.8]),
        "one axis": ReadingLog.from_arrays(np.zeros((8, 6)), pose=R),
        "two": ReadingLog.from_arrays(np.zeros((4, 6)), pose=np.repeat(R[[0, 5]], 2, axis=0)),
        "opposite": ReadingLog.from_arrays(np.zeros((4, 6)), gravity=[[0, 9.81, 0], [0, -9.81, 0]] * 2),
        "all": at_rest(count=6, each=2),
        "moving": moving(count=30),
    }
    kinds = {
        "plain": Unknowns(), "known bias": Unknowns(bias=False), "turn": Unknowns(turn=True), "drift": Unknowns(drift=True),
        "tilt": Unknowns(tilt=True), "inertia": Unknowns(inertia=True), "delay": Unknowns(delay=True),
    }  # fmt: skip
    return {
        name: {kind: observability.blind_spots(each, u, -1.0) for kind, u in kinds.items()}
        | {"advice": [observability.advice(each, kinds["plain"]), observability.advice(each, kinds["inertia"])[:60]]}
        for name, each in logs.items()
    }


@records.of
def designs_of_unknowns():
    move = moving(SENSOR, count=5)
    state = SensorState(TURN, so3.exp(np.array([0.05, -0.1, 0.02])), 0.03, LOAD.parameters.astype(float))
    by_gravity = moving(SENSOR, count=5, rotated=False)
    sets = {
        "all": Unknowns(True, True, True, True, True, True), "no bias": Unknowns(False, False, True), "tilt alone": Unknowns(tilt=True),
        "delay alone": Unknowns(delay=True), "plain": Unknowns(), "drift": Unknowns(drift=True),
    }  # fmt: skip
    x = np.linspace(0.01, 0.3, 28)
    step = sets["all"].next_state(state, move, x)
    far = [
        sets["delay alone"].next_state(SensorState(delay=0.4, load=state.load), move, np.r_[np.zeros(10), d]).delay
        for d in (0.05, 0.2, -1.2)
    ]
    return {
        name: {
            "kinds": u.kinds, "names": u.names, "scales": u.scales, "load": [u.load.start, u.load.stop], "nonlinear": u.nonlinear_columns,
            "design": u.design(move, -1.0, state), "by gravity": u.design(by_gravity, 1.0, state),
            "middle": u.design(move, 1.0, changed(state, middle=0.7)), "without a load": u.design(move, 1.0, SensorState())[..., -2:],
        }
        for name, u in sets.items()
    } | {"next": step, "next delay": far, "level": [unknowns.level_axes(move), unknowns.level_axes(by_gravity)]}  # fmt: skip


@records.of(relative=1e-4)
def fits_of_rows():
    poses_ = static_poses.static_poses(at_rest())
    base = fits.Problem(
        poses_.log, Unknowns(), 1.0, BIAS, None, poses_.count, poses_.within, poses_.within_freedom, poses_.label
    )  # fmt: skip
    keep = np.ones(len(poses_.log), bool)
    some = keep.copy()
    some[[2, 5]] = False
    bent = changed(base, log=changed(base.log, readings=base.log.readings + np.eye(14, 6, 1) * 5.0 * NOISE))
    move = moving()
    raw = fits.Problem(
        move, Unknowns(inertia=True), 1.0, BIAS, None, np.ones(90), np.zeros(6), 0.0, np.arange(90), True
    )
    problems = {
        "all": (base, keep, False), "some": (base, some, False), "huber": (bent, keep, True), "huber of few": (changed(bent, label=np.arange(14) % 4), keep, True),
        "few clusters": (changed(base, label=np.arange(14) % 4), keep, False), "known noise": (changed(base, noise=NOISE), keep, False),
        "known bias": (base.with_unknowns(bias=False), keep, False), "clusters": (changed(base, label=np.arange(14) // 2), keep, False),
        "motion": (raw, np.ones(90, bool), False), "motion, turn and delay": (raw.with_unknowns(turn=True, delay=True), np.arange(90) % 7 > 0, False),
        "motion, huber": (raw, np.ones(90, bool), True), "exact": (changed(raw, log=changed(move, readings=move.predicted(STRAIGHT))), np.ones(90, bool), False),
    }  # fmt: skip
    found = {name: fits.fit(p, keep=k, huber=h) for name, (p, k, h) in problems.items() if name != "exact"}
    exact = fits.fit(problems["exact"][0], keep=problems["exact"][1])
    return {
        name: {
            "estimate": f.estimate, "deviation": np.sqrt(np.diag(f.covariance)), "covariance": f.covariance, "known": f.known, "com known": f.com_known,
            "joint": f.joint, "joint freedom": f.joint_freedom, "sigma": f.sigma, "freedom": f.freedom, "row deviation": f.deviation,
            "residuals": f.residuals, "leverage": f.leverage, "state": f.state, "text": repr(f), "load": f.load, "noise": f.noise,
            "mass": f.mass_deviation, "com": f.com_deviation, "interval": f.interval("mass", 0.9), "spread": f.spread(k),
        }
        for (name, f), k in zip(found.items(), [x[1] for x in problems.values()], strict=False)
    } | {"exact": exact.estimate, "few": [fits.few(np.arange(k)) for k in (5, 6)],
         "in the log": [fits._pose_is_in_log(move, d) for d in (0.05, -0.05, 0.2)], "least": [outliers.least_rows(changed(base, unknowns=u)) for u in (Unknowns(), Unknowns(turn=True), Unknowns(True, True), Unknowns(True, True, True, True, True, True), Unknowns(bias=False))]}  # fmt: skip


@records.of(relative=1e-4)
def outliers_of_logs():
    rest = at_rest(each=5)
    poses_ = static_poses.static_poses(rest)
    found = {}
    for name, size in {"small": 4.0, "just below": 5.5, "just above": 8.5, "large": 30.0}.items():
        readings = rest.readings.copy()
        readings[[2, 3]] += size * NOISE * [1, -1, 1, 1, 1, -1] / np.sqrt(6) * 1.0
        readings[20:24] += 30 * NOISE
        found[name] = np.flatnonzero(outliers.touched_in_static_poses(changed(rest, readings=readings), poses_))
    short = at_rest(each=2)
    constant = changed(rest, readings=np.round(rest.readings, 0))
    found["short"] = outliers.touched_in_static_poses(
        changed(short, readings=short.readings + np.eye(len(short), 6) * 90), static_poses.static_poses(short)
    ).sum()
    found["repeated"] = np.flatnonzero(outliers.touched_in_static_poses(constant, poses_))
    rows = fits.Problem(
        poses_.log, Unknowns(), 1.0, BIAS, None, poses_.count, poses_.within, poses_.within_freedom, poses_.label
    )  # fmt: skip
    for name, size in {"kept": 2.5, "rejected": 12.0, "far": 60.0}.items():
        log_ = changed(rows.log, readings=rows.log.readings + np.outer(np.isin(np.arange(14), [4, 9]), size * NOISE))
        for kind, problem in {
            "": rows,
            " known noise": changed(rows, noise=NOISE),
            " few": changed(rows, count=np.full(14, 3.0)),
        }.items():
            _, kept = outliers.reject_outliers(changed(problem, log=log_))
            found[f"rows {name}{kind}"] = np.flatnonzero(~kept)
    return found


@records.of
def doubts_about_readings():
    rest, move = at_rest(), moving()
    smooth = so3.exp(np.outer(np.linspace(0, 1.0, 12), [0.5, 0.6, 0.3]))
    steady = ReadingLog.from_arrays(np.ones((12, 6)), pose=smooth)
    jumping = ReadingLog.from_arrays(np.ones((12, 6)), pose=smooth[[0, 1, 2, 3, 4, 11, 10, 9, 8, 7, 6, 5]])
    standing = ReadingLog.from_arrays(np.ones((12, 6)), pose=np.repeat(smooth[::2], 2, axis=0))
    narrow = ReadingLog.from_arrays(np.ones((12, 6)), pose=so3.exp(np.outer(np.linspace(0, 0.15, 12), [0.5, 0.6, 0.3])))
    return {
        "moving": [
            reading_doubts.seems_moving(x)
            for x in (rest, move, steady, jumping, standing, narrow, steady.rows(slice(9)), steady.rows(slice(10)))
        ],
        "bias": reading_doubts.listed_bias(BIAS),
        "places": [
            unit_doubts._decimal_place(np.array(x))
            for x in ([1.0, 2, 30], [0.1, 2.5], [0.25, 0.5], [1e-6, 2.0], [1e-7, 1], [np.pi])
        ],
        "cures": [m.cure for m in unit_doubts.MIXUPS],
        "overlap": unit_doubts._overlap(
            np.array([[0.01, 0.02, 0.045], [0.34, 0.5, 0.6], [3.0, 3.5, 4.0]]), unit_doubts._USUAL_TOOLS
        ),
        "basis": departure.orthonormal(np.column_stack([np.ones(4), np.arange(4.0), 2 + 3 * np.arange(4.0)])).shape,
        "share": departure.largest_share(np.outer(np.arange(4.0), BIAS), np.outer(np.arange(4.0) ** 2, 1 + BIAS)),
    }


# ── Compensation


@records.of(relative=1e-4)
def compensation_of_logs(folder):
    rest, move = at_rest(), moving()
    found = quietly(lambda: sensing.identify(at_rest(seed=6)))
    inertial = quietly(lambda: sensing.identify(moving(seed=5), inertia=True))
    hit = rest.readings.copy()
    hit[[3, 4, 20, 40, 41, 42, 60, 70, 80]] += [0, 0.4, 0, 6, 0, -4]
    touched = move.readings.copy()
    touched[30:36] += [0, 0.4, 0, 6, 0, -4]
    timed = at_rest(time=True)
    s = np.linspace(-0.5, 0.5, len(rest))[:, None]
    unknown = changed(STRAIGHT, inertia="unknown")
    cases = {
        "fine": (rest, found, {}), "contacts": (changed(rest, readings=hit), found, {"false_alarms": 1e-4}),
        "off": (changed(rest, readings=hit), found, {}), "no contact": (rest, found, {"false_alarms": 1e-6}),
        "contacts in time": (changed(timed, readings=hit), found, {"false_alarms": 1e-4}),
        "motion, unknown inertia": (move, found, {}), "motion, unknown inertia, contacts": (changed(move, readings=touched), found, {"false_alarms": 1e-4}),
        "motion, no contact, unknown inertia": (move, found, {"false_alarms": 1e-4}),
        "motion": (move, inertial, {}), "motion, contacts": (changed(move, readings=touched), inertial, {"false_alarms": 1e-4}),
        "sensor": (rest, STRAIGHT, {"noise": (0.011, 0.28)}), "sensor, contacts": (changed(rest, readings=hit), STRAIGHT, {"noise": (0.011, 0.28), "false_alarms": 1e-4}),
        "sensor with uncertainty": (rest, STRAIGHT, {"noise": (0.011, 0.28), "uncertainty": found.uncertainty}),
        "other noise": (rest, found, {"noise": (0.03, 0.6)}), "less noise": (rest, STRAIGHT, {"noise": (0.002, 0.05)}),
        "offset": (changed(rest, readings=rest.readings + 3.5 * NOISE), found, {}), "moved bias": (changed(rest, readings=rest.readings + 60 * NOISE), found, {}),
        "drift": (changed(rest, readings=rest.readings + 20 * s * NOISE), found, {}), "drift in time": (changed(timed, readings=timed.readings + 20 * s * NOISE), found, {}),
        "gain": (changed(rest, readings=rest.readings + 0.15 * (rest.readings - BIAS)), found, {}),
        "other sign": (changed(rest, readings=-rest.readings), found, {}), "swapped": (changed(rest, readings=np.roll(rest.readings, 3, axis=1)), found, {}),
        "gravity up": (changed(rest, gravity=-rest.gravity), found, {}), "gravity up by gravity": (changed(at_rest(pose=False), gravity=-rest.gravity), found, {}),
        "grams": (changed(rest, readings=rest.readings / [1, 1, 1, 0.00980665, 0.00980665, 0.00980665]), found, {}),
        "all in kilograms": (changed(rest, readings=rest.readings / 9.80665), found, {}), "N mm": (changed(rest, readings=rest.readings * [1000, 1000, 1000, 1, 1, 1]), found, {}),
        "another tool": (at_rest(ForceTorqueSensor(tw.SpatialInertia.from_com(5.0, (0.3, 0.1, 0.2)), BIAS)), found, {}),
        "another tool in motion": (moving(ForceTorqueSensor(tw.SpatialInertia.from_com(5.0, (0.3, 0.1, 0.2)), BIAS)), inertial, {}),
        "steady motion": (mistaken_logs()["steady motion"][0], found, {}), "motion in degrees": (changed(move, V=move.V * 57.3), inertial, {}),
        "by the sensor": (at_rest(BY), BY, {"noise": (0.011, 0.28)}), "unknown inertia at rest": (rest, unknown, {"noise": (0.011, 0.28), "false_alarms": 1e-3}),
    }  # fmt: skip
    answers = {
        name: quietly(lambda each=each, s=s, o=o: sensing.compensate(each, s, **o))
        for name, (each, s, o) in cases.items()
    }
    return {
        name: {
            "headline": a.headline, "doubts": [[str(d), d.refuses] for d in a.doubts], "off": np.flatnonzero(a.off)[:12], "hits": np.flatnonzero(a.hits),
            "facts": a.facts(), "explained": a.explained, "noise": a.noise, "rest": a.rest,
            "threshold": a.threshold and [a.threshold.limit, a.threshold.per_axis, a.threshold.freedom],
        }
        for name, a in answers.items()
    } | {
        "texts": [str(answers[name]).splitlines() for name in ("contacts in time", "motion, unknown inertia, contacts", "off", "moved bias")],
        "answer": answers["motion, contacts"],
        "table": table(answers["contacts in time"].to_csv(folder / "rest.csv")),
        "table without times": table(answers["contacts"].to_csv(folder / "rest.csv")),
        "rms": [compensation.rms_residuals(rest.readings), compensation.rms_residuals(rest.readings[:0])],
        "refused": [
            refusal(lambda: sensing.compensate(rest, STRAIGHT)), refusal(lambda: sensing.compensate(rest, 3)), refusal(lambda: sensing.compensate(3, found)),
            refusal(lambda: sensing.compensate(rest, STRAIGHT, noise=(0.0, 0.0), false_alarms=1e-3)), refusal(lambda: sensing.compensate(rest, found, false_alarms=2.0)),
        ],
        "sources": sorted(sensing.compensate("demo-motion", "demo").sources()),
    }  # fmt: skip


# ── Poses and simulation


@records.of(relative=1e-6)
def proposals_of_poses(folder):
    six = np.array(
        [
            [0.1, 0.2, -1],
            [0.5, -0.3, -0.7],
            [-0.6, 0.2, 0.5],
            [0.2, 0.9, 0.1],
            [0.8, 0.1, -0.2],
            [0, 0, 2.0],
            [-0.3, -0.7, 0.3],
        ]
    )
    made = {
        "plain": sensing.propose_poses(7), "options": sensing.propose_poses(5, noise=(0.03, 0.2), mass=2.4, gravity=9.7),
        "candidates": sensing.propose_poses(4, candidates=six), "within": sensing.propose_poses(6, within=0.4, mass=1.7),
        "candidates within": sensing.propose_poses(3, candidates=six, within=1.2), "after a log": sensing.propose_poses(3, log=at_rest(count=3, name="first.csv")),
        "one": sensing.propose_poses(1), "two": sensing.propose_poses(2, within=1.0), "heavy noise": sensing.propose_poses(4, noise=(2.0, 0.3), mass=0.3),
        "upright only": sensing.propose_poses(2, within=0.0),
    }  # fmt: skip
    return {
        name: {
            "gravity": p.gravity, "rotations": p.rotations, "mass": p.mass_deviation, "first moment": p.first_moment_deviation, "intervals": p.intervals,
            "text": str(p).splitlines()[:9] if name in ("options", "one", "heavy noise", "two") else p.headline, "facts": p.facts(), "brief": p.brief, "subject": p.subject, "doubts": [str(d) for d in p.doubts],
        }
        for name, p in made.items()
    } | {
        "answer": made["candidates"], "table": table(made["plain"].to_csv(folder / "poses.csv")),
        "directions": [poses._candidate_directions(None, w) for w in (0.5, 4.0)],
        "refused": [
            refusal(call)
            for call in (
                lambda: sensing.propose_poses(0), lambda: sensing.propose_poses(3, within=-0.1), lambda: sensing.propose_poses(3, mass=0.0),
                lambda: sensing.propose_poses(3, mass=np.inf), lambda: sensing.propose_poses(3, noise=(0, 1)), lambda: sensing.propose_poses(3, candidates=[1, 2, 3]),
                lambda: sensing.propose_poses(3, candidates=[[0, 0, 0.0]]), lambda: sensing.propose_poses(3, candidates=[[0, 0, 1.0]], within=0.3),
                lambda: sensing.propose_poses(3, gravity=0.0),
            )
        ],
    }  # fmt: skip


@records.of
def simulated_logs():
    made = {
        "poses": sensing.simulate(SENSOR, 4, noise=(0.02, 0.4), rng=3), "rotations": sensing.simulate(BY, rotations(3), noise=(0, 0)),
        "motion": sensing.simulate(SENSOR, 5, motion=2.5, rng=4), "touched": sensing.simulate(BY, 4, touch={1: F[0], -1: F[3]}, rng=1),
        "one": sensing.simulate(STRAIGHT, rotations(3)[1], noise=(0, 0)), "default": sensing.simulate(STRAIGHT, 3),
    }  # fmt: skip
    return {
        name: {"readings": s.readings, "gravity": s.gravity, "V": s.V, "dV": s.dV, "time": s.time, "name": s.name, "by": s.by_gravity}
        for name, s in made.items()
    } | {
        "refused": [
            refusal(call)
            for call in (
                lambda: sensing.simulate(3, 4), lambda: sensing.simulate(SENSOR, rotations(3), motion=2.0), lambda: sensing.simulate(SENSOR, 4, motion=0.0),
                lambda: sensing.simulate(SENSOR, 4, motion=np.inf), lambda: sensing.simulate(SENSOR, 4, touch=[1]), lambda: sensing.simulate(SENSOR, 4, touch={4: F[0]}),
                lambda: sensing.simulate(SENSOR, 4, touch={-5: F[0]}), lambda: sensing.simulate(SENSOR, 4, touch={"a": F[0]}), lambda: sensing.simulate(SENSOR, 2.5),
                lambda: sensing.simulate(SENSOR, 4, touch={1: [1, 2]}), lambda: sensing.simulate(SENSOR, 4, noise=(-0.1, 0.2)),
            )
        ]
    }  # fmt: skip


@records.of
def uncertainties_that_are_refused():
    names = Unknowns().names
    C = 0.1 * np.eye(10) + 0.01
    fine = {"covariance": C, "freedom": np.full(10, 5.0), "noise": NOISE, "noise_freedom": np.full(6, np.inf)}
    skew = C.copy()
    skew[0, 1] += 0.01
    negative = np.eye(10)
    negative[0, 1] = negative[1, 0] = 1.1
    zero = np.eye(10)
    zero[3, 3] = 0.0
    cases = [
        (names[1:], {}), (names, {"covariance": C[:9]}), (names, {"covariance": skew}), (names, {"covariance": negative}), (names, {"covariance": zero}),
        (names, {"freedom": np.full(9, 1.0)}), (names, {"freedom": -np.ones(10)}), (names, {"noise": -NOISE}), (names, {"noise": np.full(6, np.inf)}),
        (names, {"noise_freedom": np.full(6, np.nan)}), (("mass", "bias mx"), {}),
    ]  # fmt: skip
    return [refusal(lambda n=n, o=o: uncertainty.Uncertainty(tuple(n), **{**fine, **o})) for n, o in cases] + [
        uncertainty.Uncertainty(names, **fine)
    ]


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
