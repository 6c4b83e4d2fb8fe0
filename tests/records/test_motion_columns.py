"""Columns of logs, coordinates and limits files on record: names, units, rules of matching, and messages."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.errors import TwistWrenchError
from twistwrench.core.text import words_of_the_shell
from twistwrench.motion import column_names, columns, coordinates, limits_file, matching
from twistwrench.motion.columns import Columns, Reading, absent_joints
from twistwrench.motion.coordinates import Continuity, Coordinates, configuration_of

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)


def loaded(text, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tw.load(text, **options)


def link(name, mass, com, moments):
    ixx, iyy, izz, ixy, ixz, iyz = moments
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}" rpy="0.2 -0.1 0.3"/><mass value="{mass}"/><inertia ixx="{ixx}" '
        f'iyy="{iyy}" izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial></link>'
    )


def joint(name, kind, parent, child, xyz, axis, more=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="0.1 0.4 -0.2"/><axis xyz="{axis}"/>{more}</joint>'
    )


CRANE_TEXT = (
    '<robot name="crane"><link name="ground"/>'
    + link("cart", 6.5, "0.1 -0.05 0.2", (0.31, 0.27, 0.4, 0.01, -0.02, 0.03))
    + link("jib", 3.25, "0.3 0.02 -0.07", (0.11, 0.17, 0.2, -0.01, 0.015, 0.005))
    + link("turret", 2.1, "-0.03 0.1 0.15", (0.05, 0.06, 0.045, 0.002, 0.001, -0.003))
    + link("hand", 0.9, "0.04 0.06 0.12", (0.012, 0.015, 0.011, 0.001, -0.002, 0.0015))
    + link("finger", 0.35, "0.02 -0.01 0.05", (0.002, 0.003, 0.0025, 0.0001, 0.0002, -0.0003))
    + '<link name="tool0"/><joint name="mount" type="fixed"><parent link="hand"/><child link="tool0"/>'
    '<origin xyz="0.03 -0.02 0.21" rpy="0.3 0.2 0.1"/></joint>'
    + joint(
        "zslide", "prismatic", "ground", "cart", "0.2 0.1 0.3", "0.6 0.8 0.5",
        '<limit lower="-0.75" upper="1.5" velocity="0.8" effort="900"/><dynamics damping="11" friction="7"/>',
    )
    + joint(
        "boom_joint", "revolute", "cart", "jib", "0.05 0.3 0.4", "0.2 -1 0.3",
        '<limit lower="-2.5" upper="1.25" velocity="2.2" effort="140"/><dynamics damping="1.3" friction="2.1"/>',
    )
    + joint(
        "spin", "continuous", "jib", "turret", "0.7 -0.04 0.1", "0.9 0.1 -0.3",
        '<limit velocity="3.1" effort="45"/><dynamics damping="0.4" friction="0.6"/>',
    )
    + joint(
        "a_tilt", "revolute", "turret", "hand", "0.15 0.02 0.25", "-0.1 0.3 1",
        '<limit lower="-1.75" upper="2.875" velocity="4.3" effort="18"/><dynamics damping="0.2" friction="0.35"/>',
    )
    + joint(
        "claw", "revolute", "hand", "finger", "0.02 0.07 0.18", "1 0.2 0.1",
        '<limit lower="-3" upper="3" velocity="9" effort="2.5"/><mimic joint="a_tilt" multiplier="-0.7" offset="0.3"/>',
    )
    + "</robot>"
)  # fmt: skip
CRANE = loaded(CRANE_TEXT, gravity=(1.2, -0.7, -9.3), tip="tool0")
"""Sliding, limited, endless and limited joint, and a mimic joint; names that are not sorted."""

RAFT = loaded(
    '<robot name="raft"><link name="sea"/>'
    + link("deck", 8.5, "0.1 0.2 -0.05", (0.5, 0.7, 0.9, 0.02, -0.03, 0.01))
    + link("mast", 1.4, "0.05 -0.1 0.4", (0.09, 0.08, 0.02, 0.003, 0.001, -0.002))
    + link("buoy", 2.7, "-0.02 0.03 0.06", (0.04, 0.05, 0.06, -0.002, 0.004, 0.001))
    + joint("sway", "planar", "sea", "deck", "0.1 0.2 0.3", "0.2 0.3 1")
    + joint("mast_joint", "revolute", "deck", "mast", "0.2 0.1 0.5", "0.3 1 0.2", '<limit lower="-1.2" upper="0.9" velocity="2.4" effort="60"/>')
    + joint("free", "floating", "sea", "buoy", "1.5 -0.4 0.2", "1 0 0")
    + "</robot>"
)  # fmt: skip
"""Planar, limited and floating joint."""

GEARED = CRANE.with_actuators({
    "couplings": {"wrist": {"motors": ["m_left", "m_right"], "joints": ["spin", "a_tilt"], "motor_per_joint": [[1, 0.5], [1, -2]]}},
    "actuators": {
        "m_left": {"ratio": 80, "rotor": {"inertia": "20 g cm^2"}, "effort": "26 N m"},
        "m_right": {"ratio": 60, "rotor": {"inertia": "12 g cm^2"}, "effort": "17 N m"},
    },
})  # fmt: skip
"""The crane with a differential at its wrist."""

ARM = loaded(
    '<robot name="crx_arm"><link name="floor"/>'
    + "".join(link(f"l{k}", 5.0 - 0.6 * k, f"0.{k} 0.02 0.0{k}", (0.1, 0.12, 0.09, 0.001, 0.002, 0.003)) for k in range(1, 9))
    + "".join(
        joint(name, kind, parent, child, f"0.{k} 0.05 0.2", axis, f'<limit lower="-{1 + k / 8}" upper="{1.5 + k / 4}" velocity="{1 + k / 4}" effort="{90 - 9 * k}"/>')
        for k, (name, kind, parent, child, axis) in enumerate(
            [
                ("J1", "revolute", "floor", "l1", "0 0.1 1"),
                ("J2", "revolute", "l1", "l2", "0 1 0.2"),
                ("J3", "revolute", "l2", "l3", "0.1 1 0"),
                ("J4", "revolute", "l3", "l4", "1 0 0.3"),
                ("J5", "revolute", "l4", "l5", "0 1 0"),
                ("J6", "revolute", "l5", "l6", "1 0.2 0"),
                ("thumb", "prismatic", "l6", "l7", "0 1 0"),
                ("pinky", "prismatic", "l6", "l8", "0 -1 0"),
            ]
        )
    )
    + "</robot>"
)  # fmt: skip
"""Six joints of a Fanuc by its name, and two fingers."""

KUKA = tw.load(
    '<robot name="lbr"><link name="floor"/>'
    + "".join(link(f"l{k}", 5.0 - 0.6 * k, f"0.{k} 0.02 0.0{k}", (0.1, 0.12, 0.09, 0.001, 0.002, 0.003)) for k in range(1, 4))
    + "".join(joint(f"joint_a{k}", "continuous", "floor" if k == 1 else f"l{k - 1}", f"l{k}", f"0.{k} 0.05 0.2", "0.3 1 0") for k in range(1, 4))
    + "</robot>"
)  # fmt: skip

TWIN_LINKS = [
    (f"{side}_{k}", "torso" if k == 1 else f"{side}_l{k - 1}", f"{side}_l{k}")
    for side, count in (("left", 4), ("right", 5))
    for k in range(1, count + 1)
]
TWINS = loaded(
    '<robot name="twins"><link name="floor"/>'
    + "".join(link(name, 2.0 - 0.1 * k, f"0.{k} 0.02 0.1", (0.1, 0.12, 0.09, 0.001, 0.002, 0.003)) for k, name in enumerate(["torso", "head", *[child for _, _, child in TWIN_LINKS]]))
    + joint("waist", "continuous", "floor", "torso", "0 0 1", "0 0.1 1")
    + joint("neck", "continuous", "torso", "head", "0 0 0.5", "0 0.1 1")
    + "".join(joint(name, "continuous", parent, child, "0 0.1 0.3", "0 1 0.2") for name, parent, child in TWIN_LINKS)
    + "</robot>"
)  # fmt: skip
"""Two arms of four and five joints on a waist, and a neck."""

ROBOTS = {
    "twins": TWINS,
    "crane": CRANE,
    "raft": RAFT,
    "geared": GEARED,
    "arm": ARM,
    "kuka": KUKA,
    "hinge": tw.robots.pendulum(),
}


def compact(value):
    """Value with size and weighted sums in place of arrays of more than ten numbers."""
    if isinstance(value, np.ndarray):
        if value.size <= 10 or value.dtype.kind not in "fiub" or not np.isfinite(value).all():
            return value
        entries = value.astype(float).ravel()
        index = np.arange(1.0, len(entries) + 1.0)
        return {
            "shape": value.shape,
            "size": np.abs(entries).sum(),
            "sums": [np.sin(k * index) @ entries for k in (1.0, 1.7, 0.013)],
        }
    if isinstance(value, dict):
        return {key: compact(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [compact(entry) for entry in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [field.name for field in dataclasses.fields(value) if not field.name.startswith("_")]
        return {"type": type(value).__name__} | {name: compact(getattr(value, name)) for name in fields}
    return value


def compactly(records):
    """Decorator ``records.of`` whose calls have compact results."""

    def of(call=None, **options):
        def add(call):
            @functools.wraps(call)
            def compacted(*folder):
                return compact(call(*folder))

            return records.of(compacted, **options)

        return add if call is None else add(call)

    return of


def outcome(call, *arguments, **named):
    """Result of a call, or type and message of its error."""
    try:
        return call(*arguments, **named)
    except (TwistWrenchError, TypeError, ValueError, KeyError, AttributeError) as error:
        return f"{type(error).__name__}: {error}"


def numbers_of(header, given):
    """Function of a column's first numbers: given by name, else distinct and not rising in every row."""

    def first(k):
        values = given.get(header[k])
        if isinstance(values, Exception):
            raise values
        if values is not None:
            return np.asarray(values, float)
        return np.array([0.25 * k, 0.5 + 0.125 * k, 0.125, -0.25 * k])

    return first


def assigned(header, robot="crane", given=None, **reading):
    header = header.split(",") if isinstance(header, str) else header
    header = [cell.strip() for cell in header]
    options = Reading(Path("logs/run.csv"), **reading)
    model = ROBOTS[robot].model

    def read():
        found = Columns.from_header(
            header, Coordinates.from_model(model), "run.csv: line 3", options, numbers_of(header, given or {})
        )
        fields = {
            name: value for name, value in vars(found).items() if not isinstance(value, np.ndarray | dict) and value
        }
        if not found.counted:
            del fields["header"]
        fields["places"] = {part: columns for part, columns in found.places.items() if columns is not None}
        fields["factors"] = {part: factors for part, factors in found.factors.items() if (factors != 1.0).any()}
        fields["stated"] = np.flatnonzero(found.angle_stated)
        fields["angle"] = found.angle if (found.angle != 1.0).any() else found.has_degrees
        return fields

    return outcome(read)


def refusal_in_shell(header, robot="crane"):
    with words_of_the_shell():
        return assigned(header, robot)


def headers(prefix="", suffix="", names=("zslide", "boom_joint", "spin", "a_tilt")):
    return ",".join(f"{prefix}{name}{suffix}" for name in names)


Q = headers()
LEFT = [name for name in TWINS.joint_names if name.startswith("left")]
RIGHT = [name for name in TWINS.joint_names if name.startswith("right")]


def absent_from(cells, robot, given=None):
    model = ROBOTS[robot].model
    names = [body.joint.name for body in model.leaders]
    return outcome(absent_joints, cells.split(","), Coordinates.from_model(model), names, given or {}, Path("run.csv"))


RISING = [0.5, 0.75, 1.0, 1.25]


record = compactly(records)


@record
def units_and_names_of_columns():
    units = ["rad", "RADIANS", "mrad", "deg", "°", "rev", "turn", "m", "cm", "mm", "um", "µm", "s", "sec", "ms", "us", "ns", "min",
             "rad/s", "deg/s", "deg./sec", "°/s", "rpm", "1/s", "rev/min", "m/s", "mm/s", "cm/s", "rad/s^2", "deg/s²", "deg/s/s", "rad / s**2",
             "1/s2", "m/s2", "mm/s^2", "rad/s^3", "deg/s³", "m/s3", "mm/s3", "Nm", "N m", "N·m", "N*m", "mN.m", "kN-m", "N cm", "N", "mN", "kN", "A", "mA", "kg"]  # fmt: skip
    kinds = [(part, turns) for part in ("q", "dq", "ddq", "jerk", "tau", "command") for turns in (True, False)]
    names = ["time", "Time", "T", "%time", " t ", "_time_", "timestamp", "stamp_ms", "time_stamp", "Zeit", "temps_us", "elapsed_s", "clock",
             "seconds", "secs", "Seconds_ns", "t_sec", "t_min", "时间", "times", "step", "tempo_ns", "elapsed_time"]  # fmt: skip
    return {
        "factors": {u: {f"{p}{int(t)}": f for p, t in kinds if (f := column_names.si_factor(u, p, t)) is not None} for u in units},
        "currents": {u: column_names.current_factor(u) for u in ("A", "mA", " a", "uA", "N")},
        "times": {u: column_names.time_factor(u) for u in ("s", "SEC", "secs", "second", "seconds", "ms", "msec", "millisecond", "us", "usec", "µs", "microseconds", "ns", "nsec", "nanosecond", "min", "h")},
        "refused": {f"{p}{int(t)}": refusal(lambda p=p, t=t: column_names.unit_factor("furlong", p, t, "file, column 'x'")) for p, t in kinds},
        "meanings": {n: column_names.time_meaning(n) for n in names},
        "called seconds": {n: column_names.is_called_seconds(n) for n in ("Seconds", "_secs ", "sec", "time", "%seconds")},
        "split": {t: column_names.split_unit(t) for t in ("a [deg]", "b (ms)", "c[0]", "d [ 12 ]", "[rad]", "e []", "f [x] [mm]", "g(1)(s)", " h  [ N m ] ", "k [a", "l {m}")},
        "written": {n: (column_names.is_result(n), column_names.is_command(n)) for n in ("work.x", "workpiece", "kinetic_energy", "potential_energy", "momentum.mx", "momentum.fz", "momentum", "a.command", "a.command [deg]", "command", "a_command")},
        "degrees by name": {str(n): column_names.are_in_degrees(n) for n in (["A1", "a2"], ["rax_1", "RAX_2"], ["A1", "B2"], ["A12"], [])},
        "time column": [column_names.time_column(n) for n in ([], ["time"], ["time", "time [s]"], ["time", "time [s]", "timestamp [s]"])],
        "dates": {str(x): column_names.date_note(x) for x in (99999999.0, 1e8, 100000001.0, 1234567890.9, 1.999e11, 2e11, 2.1e11)},
        "since 1970": {str(x): column_names.unit_since_1970(np.array([x, x])) for x in (1.1e18, 1.2e18, 2.2e18, 2.3e18, 1.1e15, 1.2e15, 2.2e15, 2.3e15, 1.1e12, 1.2e12, 2.2e12, 2.3e12, 1.5e9, 1.5e21)},
        "since 1970, spread": [column_names.unit_since_1970(np.array(x)) for x in ([], [1.1e12, 1.5e12], [1.5e12, 2.3e12], [1.5e12, 1.6e15])],
        "ros": {str(x): column_names.ros_nanoseconds(np.array(x)) for x in ([], [0.9e17], [1e17], [5.0], [5.5], [0.0, 9999.0], [0.0, 1e4], [0.0, 20000.5], [0.0, 1e4, 2e4, 20001.0], [0.5, 1.1e17], [-1.5e17, -1.4e17])},
        "tables": {"words": column_names.PART_OF, "commands": column_names.COMMANDS, "neutral": column_names.NEUTRAL, "joint": column_names.JOINT, "units": column_names.UNITS},
    }  # fmt: skip


@record
def columns_by_exact_names_and_units():
    return {
        "positions": assigned(f"time,{Q}"),
        "other order, own units": assigned("spin [deg],a_tilt [mrad],t [ms],boom_joint [rev],zslide [mm]"),
        "rates": assigned(
            f"t,{Q},{headers(suffix='.vel [deg/s]', names=['boom_joint', 'spin', 'a_tilt'])},zslide.vel [cm/s],zslide.acc [mm/s^2],"
            f"{headers(suffix='.acc [deg/s2]', names=['a_tilt', 'boom_joint', 'spin'])},zslide.tau [kN],spin.torque [mN m],a_tilt.effort,boom_joint.tau [N cm]"
        ),
        "commands": assigned(f"time,{Q},spin.command [deg],zslide.command [mm]", commands=True),
        "commands not asked": assigned(f"time,{Q},spin.command [deg],zslide.command [mm]"),
        "degrees": assigned(f"time,{Q},{headers(suffix='.vel')},{headers(suffix='.torque')},claw", degrees=True),
        "degrees, one stated": assigned("time,zslide,boom_joint [rad],spin,a_tilt [°]", degrees=True),
        "follower": assigned(f"time,claw [deg],{Q},claw_extra,odd"),
        "follower twice": assigned(f"time,claw,claw,{Q}"),
        "some torques": assigned(f"time,{Q},spin.tau,zslide.tau"),
        "results": assigned(f"time,{Q},kinetic_energy,work.motors,momentum.my,spin.command,other"),
        "unnamed": assigned(f"time,,{Q},"),
        "twice": assigned(f"time,{Q},spin"),
        "twice, velocities": assigned(f"time,{Q},{headers(suffix='.vel')},spin.vel [rpm]"),
        "bad unit": assigned("time,zslide [deg],boom_joint,spin,a_tilt"),
        "bad torque unit": assigned(f"time,{Q},{headers(suffix='.tau [kg]')}"),
        "raft": assigned(["time", *Coordinates.from_model(RAFT.model).names, *[f"{n}.vel" for n in RAFT.model.velocity_names], *[f"{n}.torque" for n in RAFT.model.velocity_names]], "raft", degrees=True),
        "raft without its base": assigned("time,mast_joint", "raft"),
        "raft by words": assigned("time,pos_mast_joint,sway.x,sway.y,sway.theta [deg],free.x,free.y,free.z,free.qw,free.qx,free.qy,free.qz", "raft"),
        "motors": assigned(f"time,{Q},zslide.tau,boom_joint.tau,m_left.tau,m_right.torque [mN m]", "geared"),
        "motors and joints": assigned(f"time,{Q},{headers(suffix='.tau')}", "geared"),
        "motors by words": assigned(f"time,{Q},torque_zslide,torque_boom,torque_m_left,m_right.current", "geared", gain={"m_right": 0.3}),
        "motor currents": assigned(f"time,{Q},zslide.tau,boom_joint.tau,m_left.current,m_right.current [mA]", "geared", gain={"m_right": 0.3, "m_left": 0.7}),
    }  # fmt: skip


@record
def columns_of_time():
    late = [1.7e9, 1.7e9 + 0.01]
    return {
        "unit in the name": assigned(f"timestamp_ns,{Q}"),
        "unit in brackets": assigned(f"stamp_ms [us],{Q}"),
        "two certain": assigned(f"t,{Q},time"),
        "certain and probable": assigned(f"stamp,{Q},Time"),
        "two probable": assigned(f"stamp,{Q},clock"),
        "joint named t": assigned(f"t,{Q},stamp", given={"stamp": RISING}),
        "ros whole": assigned(f"%time,{Q}", given={"%time": [1.7e18, 1.7e18 + 1e7]}),
        "ros seconds": assigned(f"%time,{Q}", given={"%time": late}),
        "since 1970 in ms": assigned(f"stamp,{Q}", given={"stamp": [1.7e12, 1.7e12 + 10]}),
        "since 1970 in s": assigned(f"stamp,{Q}", given={"stamp": late}),
        "by unit": assigned(f"run [ms],{Q}", given={"run [ms]": RISING}),
        "by two units": assigned(f"run [ms],walk [s],{Q}", given={"run [ms]": RISING, "walk [s]": RISING}),
        "rising": assigned(f"run,{Q}", given={"run": RISING}),
        "two rising": assigned(f"run,walk,{Q}", given={"run": RISING, "walk": RISING}),
        "rising, no time": assigned(f"batt_volt,seq,{Q}", given={"batt_volt": RISING, "seq": RISING}),
        "row numbers rise": assigned(f"run,{Q}", given={"run": [1, 2, 3, 4]}),
        "text": assigned(f"run,{Q}", given={"run": tw.TrajectoryError("words")}),
        "rate": assigned(Q, rate=250.0),
        "rate and time": assigned(f"time,{Q}", rate=250.0),
        "rate and rows": assigned(f"time,{Q}", rate=250.0, given={"time": [3, 4, 5, 8]}),
        "rate and chosen rows": assigned(f"step,{Q}", rate=250.0, columns={"time": "step"}, given={"step": [3, 4, 5, 8]}),
        "rate and chosen time": assigned(f"step,{Q}", rate=250.0, columns={"time": "step [ms]"}, given={"step": [3, 4, 5, 8]}),
        "rate, rising": assigned(f"run,{Q}", rate=250.0, given={"run": RISING}),
        "chosen": assigned(f"time,{Q},step", columns={"time": "step [ms]"}),
        "chosen, unit of the header": assigned(f"time,{Q},step [min]", columns={"time": "step"}),
        "chosen, no unit of time": assigned(f"time,{Q},step", columns={"time": "step [mm]"}),
        "none": assigned(Q),
        "none, of ALOHA": assigned("observations/qpos1,observations/qpos2,observations/qpos3,observations/qpos4"),
        "unit that is none": assigned(f"time [furlong],{Q}"),
    }  # fmt: skip


@record
def columns_by_words_and_rules():
    gain = {"zslide": 12.0, "boom_joint": 0.8, "spin": 0.25, "a_tilt.current": 0.125}
    return {
        "words": assigned("time,/joint_states/position/zslide,actual boom_joint deg,spin_pos_deg,pos.a_tilt"),
        "short name": assigned("time,zslide,boom,spin,a_tilt,boom_velocity_deg_s,vel_spin [rpm],a_tilt qd,qd zslide,boom_effort,torque.spin,zslide_force,tau a_tilt"),
        "two may be": assigned("time,zslide,pos_boom,boom_position,spin,a_tilt"),
        "two may be, velocities": assigned(f"time,{Q},vel_boom,boom_speed,spin.vel,zslide.vel,a_tilt.vel"),
        "uncertain words": assigned(f"time,{Q},boom_temperature,boom_error,spin_deg_rad"),
        "commands": assigned(f"time,{Q},cmd_spin,boom_target_deg,goal_vel_zslide", commands=True),
        "currents with gains": assigned(f"time,{Q},{headers(suffix='_current')}", gain=gain),
        "currents with gains, mA": assigned(f"time,{Q},{headers(suffix='_curr [mA]')}", gain=gain),
        "currents without gains": assigned(f"time,{Q},{headers(suffix='_current')}"),
        "currents beside torques": assigned(f"time,{Q},{headers(suffix='.tau')},spin_current", gain={"spin": 0.25}),
        "currents beside torques of another": assigned(f"time,{Q},{headers(suffix='.tau')},spin_current", gain={"boom_joint": 0.25}),
        "gain of a torque": assigned(f"time,{Q},{headers(suffix='.tau [N m]')}", gain={"spin": 0.25}),
        "gain of a current": assigned(f"time,{Q},{headers(suffix='.tau [mA]')}", gain=gain),
        "asked currents": [assigned(f"time,{Q},one{u},two,three,four", gain=gain, columns=dict(zip(("zslide.current", "boom_joint.current", "spin.current", "a_tilt.current"), (f"one{u}", "two", "three", "four"), strict=True))) for u in ("", " [mA]")],
        "gain by current of a torque": assigned(f"time,{Q},{headers(suffix='.tau')}", gain={"a_tilt.current": 0.5}),
        "gain of nobody": assigned(f"time,{Q},{headers(suffix='.tau')}", gain={"spim": 0.25}),
        "gains of currents by number": assigned(f"time,{Q},current_1,current_2,current_3,current_4", gain={"zslide": 2.0}),
        "prefix": assigned("time," + headers("fer_", names=["spin", "a_tilt", "zslide", "boom_joint"])),
        "prefix, one more": assigned("time," + headers("fer_", names=["spin", "a_tilt", "zslide", "boom_joint", "claw", "tool_temp"])),
        "two prefixes": assigned("time," + headers("left_") + "," + headers("right_")),
        "numbers": assigned("time,q_3,q_1,q_2,q_0,qd_0,qd_2,qd_1,qd_3,tau0,tau1,tau2,tau3"),
        "numbers from one": assigned("time,joint4_deg,joint1_deg,joint2_deg,joint3_deg"),
        "numbers from two": assigned("time,q_2,q_3,q_4,q_5"),
        "number too many": assigned("time,q_1,q_2,q_3,q_4,q_5"),
        "numbers with a gap": assigned("time,q_0,q_1,q_2,q_4"),
        "maker's degrees": assigned("time,A2,A1,A3,E1", "kuka"),
        "maker's degrees, commands": assigned("time,A2,A1,A3,A1_cmd,A2_cmd,A3_cmd,A1.vel,A2.vel,A3.vel,A1.tau,A2.tau,A3.tau", "kuka", commands=True),
        "ending with units": assigned("time,A2 [rad],A1 [rad],A3 [rad]", "kuka"),
        "rules and commands": assigned("time,actual_q_0,actual_q_1,actual_q_2,actual_q_3,target_q_1,target_q_0,target_q_2,target_q_3,action0", commands=True),
        "arm by ending": assigned("time,robot_J2,robot_J1,robot_J3,robot_J5,robot_J4,robot_J6,robot_thumb,robot_pinky", "arm"),
        "arm alone": assigned("time,J1,J2,J3,J4,J5,J6", "arm"),
        "arm alone by numbers": assigned("time,q1,q2,q3,q4,q5,q6", "arm"),
        "one arm of two": assigned("time," + headers(names=LEFT), "twins"),
        "one arm of two by numbers": assigned("time,q1,q2,q3,q4,q5", "twins"),
        "both arms": assigned("time," + headers(names=LEFT + RIGHT), "twins"),
        "both arms, one column unknown": assigned("time,moves," + headers(names=LEFT + RIGHT), "twins"),
        "an arm and the neck": assigned("time,neck," + headers(names=RIGHT), "twins"),
        "an arm without waist": [absent_from("time," + headers(names=RIGHT), "twins"), absent_from("time,q1,q2,q3,q4", "twins"), absent_from("time,q1,q2,q3,q4,q5,q6", "twins")],
        "numbers with units": assigned("time,q_0 [mm],q_1 [deg],q_2,q_3 [mrad],qd_0 [mm/s],qd_1,qd_2 [rpm],qd_3"),
        "one joint": assigned("time,pos,speed [deg/s],torque [mN m]", "hinge"),
        "one joint by number": assigned("time,q1", "hinge"),
        "arm and one finger": assigned("time,J1,J2,J3,J4,J5,J6,pinky", "arm"),
        "arm and another column": assigned("time,J1,J2,J3,J4,J5,J6,grip", "arm"),
    }  # fmt: skip


@record
def columns_that_the_caller_names():
    twelve = ",".join(f"c{k}" for k in range(12))
    return {
        "joints": assigned(f"time,{twelve}", columns={"zslide": "c3 [mm]", "boom_joint": "c1", "spin": "c0 [deg]", "a_tilt.pos": "c7", "spin.vel": "c8", "boom_joint.current": "c9"}, gain={"boom_joint": 2.0}),
        "with rates": assigned(f"time,{twelve}", columns={"zslide": "c3", "boom_joint": "c1", "spin": "c0", "a_tilt": "c7", "zslide.acc": "c2", "boom_joint.acc": "c4 [deg/s2]", "spin.acc": "c5", "a_tilt.acc": "c6", "spin.effort": "c8"}),
        "by order": assigned(f"time,{twelve}", columns={"#2": "c5", "#1": "c4 [cm]", "#3": "c11", "#4": "c9"}),
        "by order, too few": assigned(f"time,{twelve}", columns={"#2": "c5", "#1": "c4"}),
        "for this log": assigned(f"time,{twelve}", columns={"run.csv:spin": "c5", "spin": "c6", "logs/run.csv:a_tilt": "c4", "other.csv:zslide": "c1", "zslide": "c0", "boom_joint": "c9"}),
        "twice": assigned(f"time,{twelve}", columns={"spin": "c5", "spin.pos": "c6"}),
        "no such column": assigned(f"time,{twelve}", columns={"spin": "c55"}),
        "no such column, none similar": assigned("time,,zslide", columns={"spin": "torque"}),
        "no such joint": assigned(f"time,{twelve}", columns={"spim": "c5"}),
        "repeated column": assigned("time,c1,c1,zslide,boom_joint,a_tilt", columns={"spin": "c1"}),
        "two units": assigned("time,c1 [deg],c1 [rad],zslide,boom_joint,a_tilt", columns={"spin": "c1 [rad]"}),
        "part by rule": assigned("time,left1,q1,q2,q3", columns={"spin": "left1"}),
        "commands": assigned(f"time,{twelve},{Q}", columns={"spin.command": "c3", "a_tilt.command": "c4 [deg]"}, commands=True),
    }  # fmt: skip


@record
def columns_that_are_missing():
    return {
        "another robot": assigned("time,shoulder,elbow,wrist"),
        "misspelt": assigned("time,zslide,boom_joint,spinn,atilt", given={"spinn": [0.0, 1.0], "atilt": [0.0, 2.0]}),
        "series": assigned("time,ax10,ax11,ax12,ax13", given={f"ax1{k}": [0.1 * k, 7.0] for k in range(4)}),
        "series, small": assigned("time,ax10,ax11,ax12,ax13", given={f"ax1{k}": [0.1 * k, 6.0] for k in range(4)}),
        "series without time": assigned("ax10,ax11,ax12,ax13"),
        "series in degrees": assigned("time,ax10,ax11,ax12,ax13", degrees=True, given={f"ax1{k}": [0.1 * k, 70.0] for k in range(4)}),
        "one": assigned("time,zslide,boom_joint,spin,moves,stands", given={"moves": [0.0, 1.0], "stands": [1.0, 1.0]}),
        "all but one": assigned("time,zslide"),
        "some velocities": assigned(f"time,{Q},spin.vel,zslide.vel,boom_jnt.vel"),
        "some accelerations": assigned(f"time,{Q},{headers(suffix='.acc', names=['spin', 'a_tilt', 'zslide'])},b"),
        "numbers for names": assigned("0.1,0.2,0.3,-0.4,5"),
        "numbers and blanks": assigned("0.1,,0.3"),
        "locked": assigned(f"time,{Q},mount,mount.vel,mount_torque,mounted", locked=("mount",)),
        "raft": assigned("time,mast_joint,sway.x", "raft"),
        "arm": assigned("time,J1,J2,J3", "arm"),
        "in the shell": [refusal_in_shell("time,zslide"), refusal_in_shell("x10,x11,x12,x13"), refusal_in_shell("time,J1,J2,J3,J4,J5,J6", "arm"), refusal_in_shell(Q)],
    }  # fmt: skip


@record
def names_of_joints_in_columns():
    named = matching.NamedJoints(["arm_1_joint", "arm_10_joint", "joint_x", "joint_xyz", "Elbow"])
    cased = matching.NamedJoints(["A_axis", "a_axis"])
    texts = ["arm_1_joint", "arm_10", "ARM_1 vel", "arm_1_joint_vel_deg_s", "xyz_position_rad", "x", "joint_x_q", "elbow torque", "elbow deg rad", "elbow pos vel", "elbow cmd", "elbow cmd vel",
             "elbow cmd what", "elbow_current", "elbow state", "forearm_1_joint", "elbow.elbow", "elbow_s", "elbow vel s", "elbow measured value data"]  # fmt: skip
    names = ["panda_joint1", "panda_joint2", "panda_joint3"]
    kuka = ["joint_a1", "joint_a2", "joint_a3"]

    def rules(cells, joints, others=()):
        found = matching.candidates(dict(enumerate(cells)))
        return {
            part: {rule: outcome(match, group, joints, others) for rule, match in matching.RULES.items()}
            for part, group in found.items()
        }

    return {
        "meanings": {t: (named.meaning(t), cased.meaning(t)) for t in [*texts, "A_axis vel", "a_axis vel"]},
        "candidates": matching.candidates(dict(enumerate(["fer_joint1_velocity", "actual_q_0", "x [m]", "J1 Current", "temp", "pos deg s 3", "q_des_1", "s joint"]))),
        "commands": matching.command_candidates(dict(enumerate(["actual_q_0", "target_q_0", "target_qd_0", "action1", "cmd_cmd 2", "reference.position.x"]))),
        "same prefix": rules(["fer_joint3", "fer_joint1", "fer_joint2", "fer_finger"], names),
        "prefix and a stranger": rules(["fer_joint3", "fer_joint1", "fer_joint2", "fer_joint4"], names),
        "prefix and a known stranger": rules(["fer_joint3", "fer_joint1", "fer_joint2", "fer_joint4"], names, ["panda_joint4"]),
        "two prefixes, one complete": rules(["fer_joint3", "fer_joint1", "fer_joint2", "b_joint1"], names),
        "two prefixes, one nearly": rules(["fer_joint3", "fer_joint1", "fer_joint2", "b_joint1", "b_joint2"], names),
        "prefix of another quantity": rules(["temp_joint3", "temp_joint1", "temp_joint2"], names),
        "endings": rules(["A1", "A3", "A2", "E1"], kuka),
        "endings and a stranger": rules(["A1", "A3", "A2", "A4"], kuka),
        "endings of two robots": rules(["l_joint_a1", "r_joint_a2", "l_joint_a3"], kuka),
        "an ending of two": rules(["A1", "x_A1", "A2", "A3"], kuka),
        "single": rules(["pos"], ["hinge"]) | {"number": rules(["q7"], ["hinge"]), "one": rules(["q1"], ["hinge"])},
        "codes": rules(["q_1000", "q_1001"], ["a", "b"]),
        "most by prefix": [matching.match_most_by_prefix(matching.candidates(dict(enumerate(c)))["q"], names) for c in (["b_joint1", "b_joint3"], ["b_joint1"], ["b_joint1", "b_joint2", "c_joint1", "c_joint3"], ["b_joint1", "b_joint2", "c_joint1"], ["z_joint1", "z_joint2", "z_joint3", "a_joint2", "a_joint1"], ["a_joint1", "a_joint2", "a_joint3", "z_joint2", "z_joint1"])],
        "alike": [matching.alike(*c) for c in ((["shoulder", "elbow"], ["schoulder", "elbo", "elbows"]), (["shoulder_pan", "shoulder_lift"], ["shoulder", "pan_shoulder"]), (["wrist1", "wrist2"], ["wrist_1", "wrst2", "zzz"]), (["abcdef"], ["abcxyz", "abcxy"]))],
        "series": [matching.series(*c) for c in ((["A2", "A10", "A1", "E1"], 3), (["A2", "A1", "E2", "E1"], 2), (["x1 [deg]", "x0 [deg]"], 2), (["x"], 1), (["b_2_1", "b_1_9"], 2))],
        "rows": [matching.counts_rows(np.array(c)) for c in ([7.0, 8.0, 9.0, 12.0], [7.0], [0.0, 1.0, 2.5], [0.0, 2.0, 4.0], [0.0, 0.0, 1.0, 2.0])],
        "varying": matching.varying_columns(["a", "b [mm]", "c [kg]", "d_temp", "e", "f", "g", "h", "i"], ["a", "b [mm]", "c [kg]", "d_temp", "e", "f", "g", "i"],
            numbers_of(["a", "b [mm]", "c [kg]", "d_temp", "e", "f", "g", "h", "i"], {"a": [1, 1 + 1.5e-6], "b [mm]": [1, 1 + 3e-6], "e": [np.nan, 1], "f": [], "g": tw.TrajectoryError("text"), "i": [1000.0, 1000.0009]})),
    }  # fmt: skip


@record
def joints_without_columns():
    def absent(cells, robot, given=None):
        model = ROBOTS[robot].model
        names = [body.joint.name for body in model.leaders]
        return outcome(
            absent_joints, cells.split(","), Coordinates.from_model(model), names, given or {}, Path("run.csv")
        )

    return {
        "none": absent(f"time,{Q}", "crane"),
        "some": absent("time,spin,pos_boom", "crane"),
        "named": absent("time,spin,x", "crane", {"a_tilt.pos": "x", "run.csv:zslide": "y", "o.csv:boom_joint": "z"}),
        "prefix": absent("time,b_spin,b_zslide", "crane"),
        "arm": absent("time,q1,q2,q3,q4,q5,q6", "arm"),
        "raft": absent("time,sway.x,sway.y,sway.theta", "raft"),
        "all": absent("time,u,v", "crane"),
        "keys": [columns._lists_columns(k) for k in (["#1"], ["log:#2"], ["spin"], ["#log:spin"])],
        "coordinates": [columns._joint(n) for n in ("free.qw", "sway.theta", "a.b", "free.z", "x", "a.vel")],
    }


BELT = loaded(
    '<robot name="belt"><link name="floor"/>' + "".join(link(f"b{k}", 1.0 + k, "0.1 0 0.2", (0.1, 0.12, 0.09, 0.001, 0.002, 0.003)) for k in range(3))
    + joint("drum", "continuous", "floor", "b0", "0 0.1 0", "0 1 0") + joint("idler", "continuous", "b0", "b1", "0 0.1 0", "0 1 0", '<mimic joint="drum" multiplier="2" offset="0.1"/>')
    + joint("flap", "prismatic", "b1", "b2", "0 0.1 0", "0 1 0", '<limit lower="0" upper="1" velocity="3" effort="4"/>') + "</robot>"
)  # fmt: skip


@record
def coordinates_of_robots():
    found = {}
    for name, robot in (ROBOTS | {"belt": BELT}).items():
        c = Coordinates.from_model(robot.model)
        found[name] = {
            "all": {k: [(s.start, s.stop) for s in v] if k == "quaternions" else v for k, v in vars(c).items()},
            "headers": [
                c.headers(part, degrees=degrees)
                for part in ("q", "dq", "ddq", "tau", "command")
                for degrees in (False, True)
            ],
            "units": c.torque_units,
            "example": coordinates._example(robot),
        }
    return found


@record
def configurations_from_users():
    start = np.array([0.3, -0.4, 0.5, -0.6])
    cases = {
        "none": None, "array": [0.1, -0.2, 0.3, 0.4], "mapping": {"spin": 20.0, "zslide": 0.5}, "text": "0.1,-20,30,40", "texts": ["a_tilt=10", "zslide=0.25"],
        "both": ["0.1,20,30,40", "spin=5"], "two texts": ["0.1,2,3,4", "1,2,3,4"], "unknown": {"claw": 0.1}, "unknown text": ["spim=1"], "short": [0.1, 0.2], "not finite": [0.1, np.nan, 0, 0],
        "wrong text": "home", "wrong number": "1,2,3", "twice": ["spin=1", "spin=2"], "two numbers": ["spin=1,2"], "array of joint": {"spin": [1.0, 2.0]}, "batch": [[0.1, 0.2, 0.3, 0.4]],
    }  # fmt: skip
    found = {
        name: [
            outcome(configuration_of, CRANE, given, degrees=d, start=s) for d in (False, True) for s in (None, start)
        ]
        for name, given in cases.items()
    }
    found["raft"] = [
        outcome(configuration_of, RAFT, given, degrees=True)
        for given in ({"sway": [0.1, 0.2, 30.0]}, ["free=0.1,0.2,0.3,1,0,0,0", "mast_joint=20"], "1,2", {"free": [1.0]})
    ]
    found["rates"] = [
        outcome(coordinates.parse_rates, robot, texts, "--dq", degrees=d)
        for robot, texts in (
            (CRANE, ["spin=30", "zslide=2"]),
            (RAFT, ["sway=1,2,30", "free=10,20,30,1,2,3"]),
            (CRANE, ["spin"]),
            (RAFT, ["sway=1"]),
        )
        for d in (False, True)
    ]
    found["hints"] = [
        coordinates.degrees_hint(CRANE, np.array(q))
        for q in ([99.0, 1.0, 18.8, 2.0], [99.0, 1.0, -18.9, 2.0], [0.0, 100.0, 90.0, 2.0])
    ]
    with words_of_the_shell():
        found["shell"] = [
            outcome(configuration_of, CRANE, "home"),
            coordinates.degrees_hint(CRANE, np.array([0.0, 100.0, 90.0, 2.0])),
        ]
    return found  # fmt: skip


@record
def curves_without_jumps():
    turn = math.tau
    ramp = np.linspace(0.0, 7.0, 12)
    q = np.stack([0.3 * ramp, (ramp + 1.2) % turn - math.pi, (ramp + 2.0) % turn - math.pi, 0.1 * ramp], axis=1)
    c = Coordinates.from_model(CRANE.model)
    found = {}
    for name, rows, unit in (("radians", q, turn), ("degrees", np.degrees(q), 360.0), ("beyond a turn", 1.2 * q, turn), ("above zero", q + np.array([0, math.pi, math.pi, 0]), turn), ("tolerance", np.clip(q, -3.15, 3.15) * 1.002, turn), ("over tolerance", np.where(np.abs(q) > 2.9, np.sign(q) * 3.2, q), turn)):  # fmt: skip
        continuity = Continuity.from_parts(c, [rows[:5], rows[5:]], unit)
        found[name] = {
            "masks": [continuity.wrapped, continuity.left_out],
            "curves": continuity.curves(rows, unit)[:, 1:3],
        }
    p = np.linspace(0, 2, 6)[:, None]
    quaternion = (
        np.c_[np.cos(p), 0.2 * np.sin(p), 0.6 * np.sin(p), 0.5 * np.sin(p)] * np.array([1, -1, -1, 1, -1, 1])[:, None]
    )
    raft = np.c_[0.1 * p, 0.2 * p, (3 * p + 3) % turn - math.pi, 0.3 * p, 0.4 * p, 0.5 * p, 0.6 * p, quaternion]
    continuity = Continuity.from_parts(Coordinates.from_model(RAFT.model), [raft])
    found["raft"] = {
        "masks": [continuity.wrapped, continuity.left_out],
        "curves": continuity.curves(raft)[:, [2, 7, 8, 9, 10]],
    }
    q = np.arange(33.0).reshape(3, 11) / 10 + 0.2
    q[:, 7:] = quaternion[:3]
    found["rates"] = coordinates.joint_rates(RAFT.model, q, np.cos(q), np.sin(2 * q))
    return found


TABLES = {
    "some": "joint,lower,upper,velocity,effort\nspin,,,2.5,31\nboom_joint,-1.5,1.125,,99\n",
    "units": "joint,velocity [deg/s],lower [deg],upper [rad],effort [kN m],acceleration [deg/s^2],jerk [rad/s^3],axial [kN],tilting [N m],radial\nboom_joint,120,-80,1.1,0.07,400,50,1.5,22,310\n",
    "unit column": "joint,unit,lower,upper,velocity,deceleration\na_tilt,deg,-90,100,200,300\nzslide,mm,-300,1200,600,900\n",
    "all kinds": "Joint;Lower;Upper;Velocity;Effort;Acceleration;Deceleration;Jerk;Axial;Radial;Tilting\nspin;-inf;+Infinity;2,5;31;7;8;90;1000;2000;30\n",
    "follower and info": "joint,velocity_name,type,parent_link,child_link,unit,lower,upper,velocity,effort,acceleration,deceleration,jerk,damping,friction,armature,leader,ratio,offset\n"
    "claw,claw,revolute,hand,finger,rad,-1,1,5,6,,,,,,,a_tilt,-0.7,0.3\nspin,spin,continuous,jib,turret,rad,,,5,6,11,,,,,,,,\n",
    "unknown joint": "joint,effort\nspim,3\n",
    "twice": "joint,effort\nspin,3\nspin,4\n",
    "zero": "joint,effort\nspin,0\n",
    "nan": "joint,lower\nspin,nan\n",
    "negative position": "joint,lower,upper\nboom_joint,-0.5,-0.25\n",
    "swapped": "joint,lower,upper\nboom_joint,0.5,0.25\n",
    "word": "joint,effort\nspin,lots\n",
    "header": "joint,effort,colour\nspin,3,red\n",
    "header twice": "joint,effort,effort\nspin,3,4\n",
    "no joint": "name,effort\nspin,3\n",
    "empty": "",
    "short row": "joint,effort,velocity\nspin,3\n",
    "bad unit": "joint,velocity [mm/s]\nspin,3\n",
    "bad unit of a slide": "joint,velocity [deg/s]\nzslide,3\n",
    "bad unit column": "joint,unit,lower\nspin,mm,-1\n",
    "axial of a slide": "joint,axial\nzslide,300\n",
    "radial of a slide": "joint,radial\nzslide,300\n",
}  # fmt: skip


def limits_text(found):
    if isinstance(found, str):
        return found
    fields = {
        kind: values for kind, values in vars(found).items() if kind in limits_file.KINDS and np.isfinite(values).any()
    }
    with_unit = [(limits_file.KINDS[row], int(column)) for row, column in np.argwhere(found.with_unit)]
    return fields | {
        "stated": np.flatnonzero(found.stated),
        "with unit": with_unit,
        "notes": list(limits_file.notes_on_limits(found)),
    }


@record
def limits_files(folder):
    found = {}
    with contextlib.chdir(folder):
        for name, text in TABLES.items():
            path = Path(f"{name.replace(' ', '_')}.csv")
            path.write_text(text)
            found[name] = limits_text(outcome(limits_file.read_limits, path, CRANE.model))
        found["degrees"] = limits_text(limits_file.read_limits("some.csv", CRANE.model, degrees=True))
        for name, text in {
            "raft position": "joint,lower\nsway.x,1\n", "raft velocity": "joint,velocity\nfree.vz,1\n", "raft bearing": "joint,radial\nfree.wx,1\n",
        }.items():  # fmt: skip
            Path("raft.csv").write_text(text)
            found[name] = limits_text(outcome(limits_file.read_limits, "raft.csv", RAFT.model))
        found["coupled"] = outcome(limits_file.read_limits, "some.csv", GEARED.model)
        locked = CRANE.lock({"spin": 0.2})
        found["locked"] = limits_text(limits_file.read_limits("some.csv", locked.model))
        found["absent"] = outcome(limits_file.read_limits, "no.csv", CRANE.model)
    return found


@record
def limits_given_in_python():
    model = CRANE.model
    cases = {
        "efforts": {"spin": 31.0, "zslide": 700}, "arrays": {"velocity": [1.0, 2.0, 3.0, 4.0], "effort": [5.0, 6.0, 7.0, np.inf], "a_tilt": 8.0, "lower": [-0.1, -0.2, -0.3, -0.4]},
        "shape": {"velocity": [1.0, 2.0]}, "joint": {"spim": 3.0}, "zero": {"effort": [1.0, 0.0, 2.0, 3.0]}, "nan": {"upper": [1.0, np.nan, 2.0, 3.0]}, "negative": {"spin": -1.0}, "jerk": {"jerk": [1.0, 2.0, -3.0, 4.0]},
    }  # fmt: skip
    found = {name: limits_text(outcome(limits_file.limits_of, given, model)) for name, given in cases.items()}
    locked = CRANE.lock({"spin": 0.2})
    found["locked"] = limits_text(limits_file.limits_of({"spin": 3.0, "a_tilt": 2.0}, locked.model))
    found["own"] = (
        limits_file.limits_of(model.limits, model) is model.limits
        and limits_file.limits_of(None, model) is model.limits
    )
    tables = {}
    for name, robot, limits in (
        ("crane", CRANE, limits_file.limits_of(cases["efforts"], model)),
        ("geared", GEARED, GEARED.limits),
        ("raft", RAFT, RAFT.limits),
    ):
        for degrees in (False, True):
            subject, table = limits_file.robot_origin(robot, limits, degrees=degrees)
            tables[f"{name} {degrees}"] = {
                "subject": subject,
                "rows": [(c.head, c.values, c.unit) for c in table.columns],
            }
    found["tables"] = tables
    return found


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
