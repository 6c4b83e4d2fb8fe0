"""Robots as code, files and models of other libraries: complete texts and numbers on record."""

from __future__ import annotations

import pickle
import re
import warnings
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.compiler.printers.c99 import FUSED_MACROS
from twistwrench.robot import convert
from twistwrench.robot.export import c99, comments, request, structured_text
from twistwrench.robot.export.written import Saved, Written

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


records = Records(__file__, listed=18)

TWIN = """<robot name="Twin-Arm 2"><link name="stand"/>
<link name="beam"><inertial><origin xyz="0.25 0 0.125"/><mass value="2"/>
  <inertia ixx="0.25" iyy="0.5" izz="0.375" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="car/\u00e9"><inertial><origin xyz="0 0.125 0"/><mass value="0.75"/>
  <inertia ixx="0.125" iyy="0.0625" izz="0.125" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="tilt" type="revolute"><parent link="stand"/><child link="beam"/><origin xyz="0 0.5 1"/><axis xyz="0 1 0"/>
  <limit lower="-1.5" upper="1.25" velocity="2" effort="30"/><dynamics damping="0.5" friction="0.25"/></joint>
<joint name="slide \u00e9?" type="prismatic"><parent link="beam"/><child link="car/\u00e9"/><origin xyz="0.5 0 0.25"/>
  <axis xyz="1 0 0"/><limit lower="-0.5" upper="0.75" velocity="1" effort="40"/></joint></robot>"""
"""Numbers that are exact in binary, so that programs have the same operations everywhere; names that no language takes."""

BALL = """<mujoco model="pendulum"><worldbody><body name="bob"><inertial pos="0.25 0 -0.5" mass="2" diaginertia="0.5 0.25 0.375"/>
  <joint name="socket" type="ball"/><site name="hook" pos="0 0 -1"/></body></worldbody></mujoco>"""

DRIVES = {
    "actuators": {
        "tilt": {"ratio": 32, "efficiency": 0.75, "no_load_torque": "0.125 N m", "rotor": {"inertia": "0.001 kg m^2"}},
        "slide \u00e9?": {"ratio": -128, "efficiency": 0.5, "friction": {"viscous": "2 N s/m", "coulomb": "1 N"}},
    }
}


@cache
def twin():
    return tw.load(TWIN, gravity=(0.5, 0, -9.5))


@cache
def driven():
    box = tw.SpatialInertia.from_com(0.5, (0, 0.25, 0), np.diag([0.25, 0.125, 0.25]))
    return twin().with_payload(box, "car/\u00e9").with_actuators(DRIVES)


@cache
def ball():
    return tw.load(BALL)


@cache
def looped():
    text = TWIN.replace("Twin-Arm 2", "frame").replace(
        "</robot>",
        '<link name="pin"/><joint name="weld" type="fixed"><parent link="car/\u00e9"/><child link="pin"/>'
        '<origin xyz="0 0.25 0"/></joint></robot>',
    )
    return tw.load(text).constrain("pin", "vz")


NUMBER = re.compile(r"-?0x[\d.a-f]+p[+-]\d+|-?\d+\.\d+(?:[eE][+-]?\d+)?|\d+[eE][+-]\d+")


def plain_text(text):
    """Text with numbers of eight digits, without version, hash and fixed paragraphs, in lines."""

    def shorter(match):
        word = match[0]
        x = float.fromhex(word) if "0x" in word else float(word)
        return f"{x:.8g}" if abs(x) > 1e-13 else "0"

    text = text.replace(FUSED_MACROS, "")
    for line in (*c99._CONVENTIONS.splitlines(), *structured_text._CONVENTIONS.splitlines()):
        text = text.replace(f" * {line}\n", "")
    text = re.sub(r"(twistwrench) \d[\w.+-]*", r"\1 V", text)
    text = re.sub(r"(equations: )[\da-f, ]+", r"\1HASH", text)
    return NUMBER.sub(shorter, text).splitlines()


def answer(files):
    data = {key: entry for key, entry in files.to_dict().items() if key not in ("version", "schema")}
    return [str(files).splitlines(), data, files.brief, bool(files), len(files), files.robot_name, str(files.verdict)]


def warned(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = call()
    return {"result": result, "warnings": [f"{w.category.__name__}: {w.message}" for w in caught]}


QUANTITIES = [
    "gravity_forces",
    ("jacobian", {"frame": "beam", "kind": "space"}),
    ("task_inertia", {"rows": "vx vz", "kind": "world_aligned"}),
    ("inverse_dynamics", {"wrenches": ("beam", "car/\u00e9"), "on_robot": ("car/\u00e9",), "friction": True}),
    ("holding_torques", {"wrenches": "beam"}),
    ("bias_forces", {"gravity": "input"}),
    ("kinetic_energy", {"by": ("q", "dq"), "form": "hessian"}),
    ("mass_matrix", {"by": "q"}),
    ("gravity_forces", {"parameters": ("beam.mass", "tilt.z"), "wrenches": ("beam",)}),
]


@records.of
def code_in_c(folder):
    files = driven().export_c(QUANTITIES, folder)
    header, source, test = (plain_text(file.read_text("utf-8")) for file in files)
    return {
        "header": header,
        "source": [line for line in source if not line.startswith("    const double t")],
        "operations": len(source),
        "test": [line for line in test if "{" not in line or "for" in line or "check" in line][:160],
        "lines of test": len(test),
        "answer": answer(files),
    }


@records.of
def code_in_c_of_single_precision(folder):
    path = folder / "arm.c"
    files = twin().export_c(
        {"friction_forces": {}, "mass_matrix": {}}, path, precision="float", prefix="arm", test=False
    )
    small = twin().export_c("forward_kinematics", folder / "2nd.c", precision="float")
    quaternion = ball().export_c([("forward_kinematics", {"frame": "hook"}), "add"], folder, prefix="bob")
    loop = looped().export_c(["constrained_dynamics", "constraint_bias"], folder, test=False)
    return {
        "texts": [plain_text(file.read_text("utf-8")) for file in files],
        "answer": answer(files),
        "test": plain_text(small[2].read_text("utf-8")),
        "guard": [line for line in plain_text(small[0].read_text("utf-8")) if line.startswith(("#", "void"))],
        "quaternion": plain_text(quaternion[0].read_text("utf-8")),
        "loop": plain_text(loop[0].read_text("utf-8"))[-24:],
    }


@records.of
def code_for_graphics_cards(folder):
    (file,) = twin().export_cuda("gravity_forces", folder, precision="float")
    (named,) = twin().export_cuda([("friction_forces", {})], folder / "f.cu", prefix="x")
    many = twin().export_cuda(["gravity_forces", "mass_matrix"], folder)
    return {
        "text": plain_text(file.read_text("utf-8")),
        "named": [named.name, plain_text(named.read_text("utf-8"))[:12]],
        "many": [path.name for path in many],
        "refused": [
            refusal(lambda: twin().export_cuda(["gravity_forces", "mass_matrix"], folder / "two.cu")),
            refusal(lambda: twin().export_cuda("gravity_forces", folder / "f.c")),
        ],
    }


@records.of
def structured_text_of_blocks(folder):
    (file,) = twin().export_st(["gravity_forces", ("wrench_torques", {"frame": "beam"})], folder)
    (single,) = twin().export_st("friction_forces", folder / "f.SCL", precision="float", prefix="var", test=False)
    motors = driven().export_st(
        [("inverse_dynamics", {"friction": True, "wrenches": ("beam", "car/\u00e9"), "on_robot": ("beam",)})],
        folder / "m.exp",
        torque="motor",
        test=False,
    )
    codesys = twin().export_st("inverse_dynamics", folder / "c.txt", style="codesys")
    both = driven().export_st(("inverse_dynamics",), folder / "b.st", style="codesys", torque="motor", prefix="if")
    return {
        "text": plain_text(file.read_text("ascii")),
        "single": plain_text(single.read_text("ascii")),
        "motors": [line for line in plain_text(motors[0].read_text("ascii")) if "t1" not in line],
        "codesys": plain_text(codesys[0].read_text("ascii"))[-60:],
        "both": plain_text(both[0].read_text("ascii"))[-90:],
        "answer": answer(motors),
    }


@records.of
def a_package_for_ros(folder):
    files = driven().export_ros2(folder / "twin_arm2", license="BSD-3-Clause")
    texts = {file.name: plain_text(file.read_text("utf-8")) for file in files if file.suffix not in (".c", ".h")}
    whole = ("README.md", "plugin.xml")
    texts = {
        name: text
        if name in whole
        else [line for line in text if re.search("win|car|beam|double [A-Z]|BSD|  {|Twin", line)]
        for name, text in texts.items()
    }
    (folder / "full").mkdir()
    return {
        "texts": texts,
        "files": [str(file) for file in files],
        "answer": answer(files),
        "refused": {
            "name": refusal(lambda: twin().export_ros2(folder / "Twin")),
            "name again": refusal(lambda: twin().export_ros2(folder / "twin__arm")),
            "license": refusal(lambda: twin().export_ros2(folder / "twin", license="<b>")),
            "no license": refusal(lambda: twin().export_ros2(folder / "twin", license=3)),
            "there": refusal(lambda: twin().export_ros2(folder / "full")),
            "above": refusal(lambda: twin().export_ros2(folder / "no" / "twin")),
            "ball": refusal(lambda: ball().export_ros2(folder / "ball")),
        },
    }


@records.of
def code_in_javascript():
    options = {"wrenches": ("beam",), "friction": True}
    return {
        "gravity": twin().to_javascript("gravity_forces").splitlines(),
        "two results": twin().to_javascript("drive_torques").splitlines()[:3],
        "wrenches": twin().to_javascript("inverse_dynamics", **options).splitlines()[:8],
        "friction": plain_text(driven().to_javascript("friction_forces")),
        "number": twin().to_javascript("kinetic_energy").splitlines()[:2],
        "ball": plain_text(ball().to_javascript("add"))[:6],
        "loop": looped().to_javascript("constraint_jacobian").splitlines()[:3],
        "refused": refusal(lambda: twin().to_javascript("gravity")),
    }


@records.of
def functions_of_casadi():
    found = {}
    q, dq, ddq = [0.25, 0.125], [0.5, -0.75], [1.5, 0.25]
    for label, robot, name, options, arrays in (
        ("torques", driven(), "inverse_dynamics", {"friction": True}, (q, dq, ddq)),
        ("wrench", twin(), "holding_torques", {"wrenches": ("beam",)}, (q, [1, 2, 3, 4, 5, 6])),
        ("matrix", twin(), "jacobian", {"kind": "space"}, (q,)),
        ("slopes", twin(), "jacobian_derivative", {}, (q,)),
        ("number", twin(), "kinetic_energy", {}, (q, dq)),
        ("same name", ball(), "add", {}, ([0.5, 0.5, -0.5, 0.5], [0.1, 0.2, 0.3])),
    ):
        function = robot.to_casadi(name, **options)
        returned = function(*arrays)
        values = returned if isinstance(returned, tuple) else (returned,)
        found[label] = [str(function), [np.array(value) for value in values]]
    found["refused"] = [
        refusal(lambda: twin().to_casadi("mass_matrix", by="q")),
        refusal(lambda: twin().to_casadi("mas_matrix")),
    ]
    return found


@records.of
def requests_of_exports():
    robot = driven()

    def names(quantities, **more):
        return [entry.function.name for entry in request.requests(robot, quantities, "double", "p", **more)]

    def renamed(name):
        return SimpleNamespace(name=name)

    calls = {
        "precision": lambda: request.requests(robot, "mass_matrix", "half", "p"),
        "nothing": lambda: names([]),
        "a number": lambda: names([3]),
        "three": lambda: names([("jacobian", {}, 1)]),
        "no options": lambda: names([("jacobian", "beam")]),
        "a number alone": lambda: names(3),
        "twice": lambda: names(["mass_matrix", ("mass_matrix", {})]),
        "twice by frame": lambda: names(["jacobian", ("jacobian", {"frame": "car/\u00e9"})]),
        "option": lambda: names([("jacobian", {"frames": "beam"})]),
        "rows": lambda: names([("task_inertia", {"rows": "vx vy vz"})]),
        "all rows": lambda: names("task_bias"),
        "nothing moves": lambda: request.requests(
            tw.load('<robot name="s"><link name="a"/></robot>'), "mass_matrix", "double", "s"
        ),
        "prefix": lambda: request.prefix_of(robot, "2p"),
        "prefix of a number": lambda: request.prefix_of(robot, 2),
        "empty prefix": lambda: request.prefix_of(robot, ""),
        "umlaut": lambda: request.prefix_of(robot, "\u00e9"),
    }
    return {
        "names": names(QUANTITIES),
        "more names": [
            *names(
                [("task_inertia", {"rows": (5, 3)}), ("inverse_dynamics", {"wrenches": ("beam",), "gravity": "input"})]
            ),
            *names([("gravity_forces", {"by": "q", "form": "along"}), ("frame_velocity", {"frame": "beam"})]),
        ],
        "mapping": names({"mass_matrix": {}, "jacobian": {"kind": "body"}}),
        "list": names([["jacobian", {"kind": "body"}], "mass_matrix"]),
        "prefixes": [
            request.prefix_of(renamed(name), None) for name in ("arm", "2 arms", "\u00e9l\u00e9", "_x", "a-b.c")
        ],
        "given": [request.prefix_of(robot, name) for name in ("a", "A_9")],
        "refused": {label: refusal(call) for label, call in calls.items()},
    }


@records.of
def arrays_brought_to_other_packages():
    bridged = request.BridgedQuantity.from_robot("to_x", twin(), "inverse_dynamics", {"wrenches": ("beam",)}, "double")
    of_ball = request.BridgedQuantity.from_robot("to_x", ball(), "gravity_forces", {}, "single")
    slopes = bridged.derivative(["q", "dq"], "weighted", values=True)
    q = [0.5, 0.5, -0.5, 0.5]
    from twistwrench.compiler.lowering.numpy_kernels import NumpyKernel

    velocities, by_entries = NumpyKernel(of_ball.velocities(), "v", ""), NumpyKernel(of_ball.slopes(), "s", "")
    six = np.zeros(6)
    return {
        "inputs": [bridged.inputs_text, bridged.input_names, of_ball.inputs_text],
        "curved": [bridged.curved_inputs, of_ball.curved_inputs],
        "derivative": [[port.name for port in slopes.inputs], [port.name for port in slopes.program.outputs]],
        "again": bridged.derivative(("q", "dq"), "weighted", values=True) is slopes,
        "other": bridged.derivative(("q", "dq"), "weighted") is slopes,
        "velocities": velocities(q, [0.1, -0.2, 0.3, 0.4]),
        "slopes": by_entries(q, [1.0, 2.0, -3.0]),
        "brought": [type(x).__name__ for x in bridged.brought("to_x", ([1, 2], np.ones(2), [0.5, 1], six), np.ndarray)],
        "broadcast": bridged.require_shapes("to_x", [(2,), (3, 2), (4, 1, 2), (6,)]),
        "refused": {
            "few": refusal(lambda: bridged.brought("to_x", ([1, 2],), np.ndarray)),
            "shape": refusal(lambda: bridged.brought("to_x", ([1, 2, 3], six[:2], six[:2], six), np.ndarray)),
            "wanted": refusal(lambda: bridged.require_shapes("to_x", [(2,), (3,), (2,), (6,)])),
            "rank": refusal(lambda: bridged.require_shapes("to_x", [(), (2,), (2,), (6,)])),
            "batches": refusal(lambda: bridged.require_shapes("to_x", [(3, 2), (2, 2), (2,), (6,)])),
            "by": refusal(
                lambda: request.BridgedQuantity.from_robot("to_x", twin(), "mass_matrix", {"by": "q"}, "double")
            ),
            "precision": refusal(lambda: request.BridgedQuantity.from_robot("to_x", twin(), "mass_matrix", {}, "half")),
        },
    }


@records.of
def words_of_exported_code(folder):
    names = structured_text.Names(["Taken"])
    wanted = ("taken", "TAKEN", "q", "tau", "1st", "var", "Do", "_x", "t1", "t1", "t1", "\u00e9\u00e9", "x y")
    literals = (1.0, -2.5, 1e-7, 3e20, -1e-300, 0.1, 12345.5)
    number_free = tw.load(TWIN.replace("Twin-Arm 2", "*/ //* ??= \u00e9"), gravity=(0, 0, 0))
    return {
        "names": [names.free(name) for name in wanted],
        "numbers": [[structured_text.real_literal(x, p) for x in literals] for p in ("double", "float")],
        "lines": [
            list(structured_text._wrap([f"name{k}" for k in range(n)], end, each=each))
            for n, end, each in ((1, ";", True), (12, " : REAL;", True), (14, "];", False), (11, "];", False))
        ],
        "comments": [
            comments.comment(["a */ b /* c ?? d", "", "\u00e9 \x07 e"]),
            structured_text._comment(["(* x *) y", "z"]),
        ],
        "entries": list(comments.entries(ball())),
        "entries of two": list(comments.entries(twin())),
        "name": plain_text(number_free.export_c("gravity_forces", folder, test=False)[0].read_text("utf-8"))[:12],
        "no operation": comments._operations_text(ball().program("mass_matrix")),
        "operations": comments._operations_text(driven().program("inverse_dynamics", friction=True)),
        "reserved": len(structured_text.RESERVED),
        "digits": [structured_text.STATES, structured_text.STYLES, structured_text.TYPES],
    }


@records.of
def exports_refused(folder):
    robot = twin()
    own = folder / "own.urdf"
    own.write_text(TWIN.replace("\u00e9", "e"), "utf-8")
    loaded = tw.load(own)
    calls = {
        "path": lambda: robot.export_c("mass_matrix", folder / "x.cpp"),
        "no folder": lambda: robot.export_c("mass_matrix", folder / "no" / "x"),
        "quote": lambda: robot.export_c("mass_matrix", folder / 'a"b.c'),
        "backslash": lambda: robot.export_c("mass_matrix", folder / "a\\b.c"),
        "unprintable": lambda: robot.export_c("mass_matrix", folder / "a\x07b.c"),
        "prefix": lambda: robot.export_c("mass_matrix", folder, prefix="9"),
        "own file": lambda: loaded.export_st("mass_matrix", Path(str(own))),
        "st path": lambda: robot.export_st("mass_matrix", folder / "x.c"),
        "style": lambda: robot.export_st("mass_matrix", folder, style="block"),
        "torque": lambda: robot.export_st("mass_matrix", folder, torque="gear"),
        "codesys": lambda: robot.export_st("mass_matrix", folder, style="codesys"),
        "codesys two": lambda: robot.export_st(["inverse_dynamics", "mass_matrix"], folder, style="codesys"),
        "motor": lambda: robot.export_st("inverse_dynamics", folder, torque="motor"),
        "motor of another": lambda: driven().export_st("mass_matrix", folder, torque="motor"),
        "motor by": lambda: driven().export_st([("inverse_dynamics", {"by": "q"})], folder, torque="motor"),
        "motor parameters": lambda: driven().export_st(
            [("inverse_dynamics", {"parameters": "beam.mass"})], folder, torque="motor"
        ),
        "not finite": lambda: robot.export_c([("task_inertia", {"rows": "vy wx"})], folder),
        "loop": lambda: looped().export_c("inverse_dynamics", folder),
        "name": lambda: robot.export_c("mass", folder),
    }
    found = {}
    for label, call in calls.items():
        try:
            found[label] = [file.name for file in call()]
        except Exception as error:
            found[label] = f"{type(error).__name__}: {error}"
    return found


@records.of
def answers_on_written_files(folder):
    one = Written([folder / "a.c"], folder / "a.c", "arm", "cc a.c\n")
    two = Written([folder / "b.h", folder / "b.c"], folder / "b.c", "leg", "cc b.c")
    joined = Written.joined([one, two])
    found = {
        label: [
            answer(written),
            written.check,
            written.path,
            list(pickle.loads(pickle.dumps(written))),
            hasattr(written, "call"),
        ]
        for label, written in (("one", one), ("two", two), ("joined", joined), ("alone", Written.joined([one])))
    }
    for strict in (False, True):
        for lost in ([], ["the colour is not kept"], ["one is lost", "two is lost"]):
            saved = Saved(lost, folder / "r.urdf", "arm", strict=strict)
            again = pickle.loads(pickle.dumps(saved))
            found[f"saved {len(lost)} {strict}"] = [answer(saved), again == saved, again.strict, list(again)]
    return found


# ── files ──

FLOATER = """<mujoco model="kite"><worldbody><body name="sail" pos="0 0 0"><freejoint name="air"/>
  <inertial pos="0.1 -0.2 0.3" mass="1.5" fullinertia="0.2 0.3 0.25 0.01 -0.02 0.03"/>
  <body name="tail" pos="0.4 0.1 -0.2" euler="10 20 -30"><inertial pos="0.05 0.02 0.1" mass="0.6" diaginertia="0.02 0.03 0.025"/>
    <joint name="swivel" type="ball" pos="0 0 0"/>
    <body name="ring" pos="0.1 0.2 0.05" euler="-15 5 25"><inertial pos="0.01 0.03 -0.02" mass="0.2" diaginertia="0.002 0.003 0.0025"/>
      <joint name="spin" axis="1 2 -1" range="-80 110" armature="0.01"/><site name="tag" pos="0.02 0.01 0.05"/></body></body>
  <body name="rod" pos="-0.2 0.1 0.1"><inertial pos="0.02 0.01 0.1" mass="0.4" diaginertia="0.01 0.02 0.015"/>
    <joint name="push" type="slide" axis="0 1 2" range="-0.1 0.3"/>
    <body name="knob" pos="0 0.1 0.2"><inertial pos="0 0.01 0.02" mass="0.1" diaginertia="0.001 0.002 0.0015"/>
      <joint name="twist" axis="0 0 1"/></body></body></body></worldbody>
  <equality><joint joint1="twist" joint2="push" polycoef="0.2 -1.5 0 0 0"/></equality></mujoco>"""


@cache
def kite():
    return tw.load(FLOATER)


@records.of
def texts_of_robots():
    found = {}
    for label, robot in {"twin": twin(), "driven": driven(), "kite": kite(), "ball": ball()}.items():
        for form in ("urdf", "mjcf", "sdf"):
            write = getattr(robot, f"to_{form}")
            try:
                result = warned(write)
            except tw.TwistWrenchError as error:
                found[f"{label} {form}"] = f"{type(error).__name__}: {error}"
                continue
            text = plain_text(result["result"])
            found[f"{label} {form}"] = [len(text), text[:6] if label != "twin" else text, result["warnings"]]
    return found


@records.of
def robots_saved(folder):
    found = {}
    robot = tw.load(TWIN.replace("\u00e9", "e"), tip="beam")
    for name in ("a.urdf", "a.XML", "a.mjcf", "a.sdf", "a.world"):
        saved = tw.save(robot, folder / name)
        found[name] = [list(saved), answer(saved)]
    found["strict"] = str(tw.save(robot, str(folder / "s.urdf"), strict=True).verdict)
    found["again"] = len((folder / "a.urdf").read_text())
    found["overwritten"] = list(tw.save(twin().lock({"tilt": 0.5}), folder / "a.urdf", overwrite=True))
    found["no tip"] = list(tw.save(kite().chain(tip="tag"), folder / "t.xml"))
    found["refused"] = {
        "exists": refusal(lambda: tw.save(robot, folder / "a.urdf")),
        "ending": refusal(lambda: tw.save(robot, folder / "a.txt")),
        "mjcf": refusal(lambda: tw.save(robot, "mjcf")),
        "sdf": refusal(lambda: tw.save(robot, "SDF")),
        "robot": refusal(lambda: tw.save(3, folder / "b.urdf")),
        "loop": refusal(lambda: tw.save(looped(), folder / "b.urdf")),
        "folder": refusal(lambda: tw.save(robot, folder / "no" / "b.urdf")),
    }
    return found


@records.of
def robots_loaded_with_options(folder):
    path = folder / "twin.urdf"
    path.write_text(TWIN.replace("\u00e9", "e"), "utf-8")

    def shown(robot):
        return [repr(robot), robot.gravity, robot.joint_names, robot.tip, robot.model.limits.lower]

    found = {
        "plain": shown(tw.load(path)),
        "second time": shown(tw.load(path)),
        "text": shown(tw.load(str(path), gravity=[1, 2, 3])),
        "options": shown(tw.load(path, lock={"tilt": 0.25}, tip="beam", floating_base=True)),
        "free name": shown(tw.load("planar_2r", gravity=[0, 1, -2])),
        "spelling": shown(tw.load("UR5", tip="wrist_1_link")),
        "mimic": [tw.load(FLOATER, mimic=m).joint_names for m in ("follow", "independent")],
        "keep": shown(tw.load(FLOATER, keep="rod")),
        "format": shown(tw.load(TWIN, format="urdf")),
        "model": refusal(lambda: tw.load(TWIN, model="other")),
        "bodies": refusal(lambda: tw.load(path, max_bodies=2)),
        "bodies enough": shown(tw.load(path, max_bodies=3)),
        "inertia": [
            refusal(lambda: tw.load(TWIN.replace('ixx="0.125"', 'ixx="1.5"'))),
            warned(lambda: tw.load(TWIN.replace('ixx="0.125"', 'ixx="1.5"'), inertia="repair").parameters),
            warned(lambda: tw.load(TWIN.replace('ixx="0.125"', 'ixx="1.5"'), inertia="accept").parameters),
        ],
        "snap": [tw.load(TWIN.replace('xyz="0 1 0"', 'xyz="0.001 1 0"'), snap=s).screws.Slist for s in (1e-9, 0.01)],
        "no file": refusal(lambda: tw.load(folder / "none.urdf")),
        "no name": refusal(lambda: tw.load("planar_9r")),
    }
    M = np.eye(4)
    M[:3, 3] = [0.5, 0.25, 1.0]
    S = np.array([[0, 0, 1, 0, 0, 0.0], [0, 1, 0, -1, 0, 0.25]]).T
    G = [np.diag([0.1, 0.2, 0.25, 2, 2, 2]), np.diag([0.02, 0.03, 0.025, 1, 1, 1])]
    screws = tw.from_screws(None, S, [M, np.eye(4), np.eye(4)], G, joint_names=["u", "v"], name="s", gravity=(0, 1, -9))
    found["screws"] = [*shown(screws), screws.gravity_forces([0.1, 0.2])]
    found["screws of other length"] = shown(
        tw.from_screws(M, 2 * S, [M, np.eye(4), np.eye(4)], G, non_unit_screws=True)
    )
    found["screws refused"] = refusal(lambda: tw.from_screws(M, 2 * S, [M, np.eye(4), np.eye(4)], G))
    table = [[0.5, 0.1, 0.25, 0.2], [0.3, -0.4, 0.125, 0.5]]
    for convention in ("standard", "modified"):
        arm = tw.from_dh(
            table,
            convention=convention,
            columns=("a", "alpha", "d", "theta"),
            joint_types=["revolute", "prismatic"],
            masses=[2, 1],
            coms=[[0.1, 0.2, 0.3], [0.0, 0.1, -0.1]],
            moments_about_com=[np.diag([0.1, 0.2, 0.15]), np.diag([0.02, 0.03, 0.025])],
            tool=M,
            joint_names=["u", "v"],
            name="d",
            gravity=(1, 0, -9),
        )
        found[convention] = [*shown(arm), arm.gravity_forces([0.3, 0.1]), arm.forward_kinematics([0.3, 0.1])]
    found["DH refused"] = refusal(lambda: tw.from_dh(table, inertia="none"))
    return found


@records.of
def files_kept_in_the_cache(folder):
    from twistwrench.robot.kernels import disk_cache

    path = folder / "twin.urdf"
    path.write_text(TWIN.replace("\u00e9", "e"), "utf-8")
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TWISTWRENCH_CACHE_DIR", str(folder / "cache"))
        first = disk_cache.known_file(path, {"gravity": None})
        if first is not None:
            disk_cache.keep_file(first, ["one", "two"])
            again = disk_cache.known_file(path, {})
            found["again"] = [again.key == first.key, again.remarks, first.remarks, again.data == path.read_bytes()]
            found["other options"] = disk_cache.known_file(path, {"tip": "beam"}).key == first.key
            found["keys"] = len(first.key)
        for label, text in (
            ("mujoco", TWIN + "<mujoco"),
            ("sdf", TWIN + "<sdf"),
            ("xacro", TWIN + "xacro:"),
            ("dollar", TWIN + "${"),
            ("no robot", "<link/>"),
        ):
            other = folder / f"{label}.urdf"
            other.write_text(text, "utf-8")
            found[label] = disk_cache.known_file(other, {}) is None
        other = folder / "twin.xml"
        other.write_text(TWIN, "utf-8")
        found["ending"] = disk_cache.known_file(other, {}) is None
        found["no file"] = disk_cache.known_file(folder / "none.urdf", {}) is None
        found["a number"] = disk_cache.known_file(3, {}) is None
        found["an array"] = disk_cache.known_file(path, {"gravity": np.zeros(3)}) is None
        found["quiet"] = [warned(lambda: tw.load(_bad_file(folder), inertia="repair").name) for _ in range(2)]
        found["kernels"] = [
            disk_cache.kernel_key("", ["q"], {}),
            len(disk_cache.kernel_key("o", ["q"], {})),
            disk_cache.kernel_key("o", ["q"], {"rows": np.zeros(2)}),
            disk_cache.kernel_key("o", ["q"], {}) == disk_cache.kernel_key("o", ["r"], {}),
            disk_cache.kernel_key("o", ["q"], {}) == disk_cache.kernel_key("p", ["q"], {}),
            disk_cache.kernel_key("o", ["q"], {"a": 1}) == disk_cache.kernel_key("o", ["q"], {"a": 2}),
            disk_cache.kernel_key("o", ["q"], {"b": 1, "a": None}) == disk_cache.kernel_key("o", ["q"], {"b": 1}),
        ]
    found["remarks"] = [disk_cache._remarks(x) for x in (b"('a', 'b')", b"['a']", b"('a', 3)", b"('a'", b"\xff", b"()")]
    found["texts"] = [
        disk_cache._options_text(x)
        for x in (
            {},
            {"b": 1, "a": (1.5, "x", [True, None])},
            {"a": {"x": 2}},
            {"a": {2: "x"}},
            {"a": {3}},
            {"a": None, "c": np.float64(1.0)},
        )
    ]
    made = []
    cached = disk_cache.CachedModel("k", lambda: made.append(1) or "model")
    found["model"] = [cached.model, cached.model, len(made), cached.key]
    return found


def _bad_file(folder):
    path = folder / "bad.urdf"
    path.write_text(TWIN.replace("\u00e9", "e").replace('ixx="0.125"', 'ixx="1.5"'), "utf-8")
    return path


# ── other libraries ──


@records.of
def states_in_the_order_of_mujoco():
    pytest.importorskip("mujoco")
    robot = kite()
    model = robot.to_mujoco()
    rng = np.random.default_rng(2)
    q = robot.random_configuration(1)
    dq, ddq = rng.uniform(-1, 2, (2, robot.nv))
    qpos, qvel, qacc = convert.to_mujoco(robot, model, q, dq, ddq)
    unnamed = tw.from_mujoco(model, floating_base=True, gravity=(0, 1, -9))
    nameless = _nameless_model()
    alone = tw.load(FLOATER).lock({"swivel": [1.0, 0, 0, 0], "spin": 0.0, "push": 0.0}).to_mujoco()
    return {
        "to": [qpos, qvel, qacc],
        "position alone": convert.to_mujoco(robot, model, q),
        "back": convert.from_mujoco(robot, model, qpos, qvel, qacc),
        "back to q": convert.from_mujoco(robot, model, qpos),
        "two": [len(convert.to_mujoco(robot, model, q, dq)), len(convert.from_mujoco(robot, model, qpos, qvel))],
        "P": convert.mujoco_rates(robot, model, q),
        "read": [repr(unnamed), unnamed.gravity],
        "names": [convert._joint_name(nameless, k) for k in range(nameless.njnt)],
        "nameless": convert.to_mujoco(tw.from_mujoco(nameless), nameless, tw.from_mujoco(nameless).neutral),
        "fixed base": repr(tw.from_mujoco(nameless, lock={"b1.slide1": 0.1})),
        "offset": refusal(lambda: convert.mujoco_rates(_displaced(), alone, _displaced().neutral)),
        "refused": {
            "model": refusal(lambda: convert.to_mujoco(robot, 3, q)),
            "robot": refusal(lambda: convert.to_mujoco(3, model, q)),
            "other": refusal(lambda: convert.to_mujoco(twin(), model, [0.1, 0.2])),
            "locked": refusal(lambda: convert.mujoco_rates(robot.lock({"spin": 0.3}), model, q[:-1])),
            "many": refusal(lambda: convert.to_mujoco(robot, model, [q, q])),
            "dq": refusal(lambda: convert.to_mujoco(robot, model, q, dq[1:])),
            "ddq": refusal(lambda: convert.to_mujoco(robot, model, q, dq, ddq[1:])),
            "back dq": refusal(lambda: convert.from_mujoco(robot, model, qpos, dq[1:])),
            "back ddq": refusal(lambda: convert.from_mujoco(robot, model, qpos, qvel, ddq[2:])),
            "back q": refusal(lambda: convert.from_mujoco(robot, model, q[1:])),
            "massless": refusal(
                lambda: tw.load(
                    '<robot name="g"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'
                ).to_mujoco()
            ),
        },
    }


def _displaced():
    return tw.load(
        '<robot name="kite"><link name="ground"/><link name="sail"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"'
        ' ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="air" type="floating"><parent link="ground"/><child'
        ' link="sail"/><origin xyz="0.1 0.2 0.3"/></joint></robot>'
    )


def _nameless_model():
    import mujoco

    return mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="b1"><inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/>
        <joint type="hinge" axis="0 1 0"/><joint type="slide" axis="1 0 0"/>
        <body pos="0 0 0.5"><inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/><joint type="ball"/></body></body>
        <body><inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/><joint type="hinge" name="last"/></body>
        </worldbody></mujoco>"""
    )


PLANAR = TWIN.replace(
    "</robot>",
    """<link name="disc"><inertial><mass value="1"/><inertia ixx="0.5" iyy="0.25" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="wheel"><inertial><mass value="0.5"/><inertia ixx="0.5" iyy="0.25" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="plane" type="planar"><parent link="beam"/><child link="disc"/><origin xyz="0 0.25 0.5"/><axis xyz="0 0 1"/></joint>
  <joint name="around" type="continuous"><parent link="stand"/><child link="wheel"/><origin xyz="0 1 0.5"/><axis xyz="0 1 0"/>
  </joint></robot>""",
).replace("\u00e9", "e")


@records.of
def states_in_the_order_of_pinocchio():
    pytest.importorskip("pinocchio")
    found = {}
    rng = np.random.default_rng(2)
    for label, robot in {"kite": kite(), "planar": tw.load(PLANAR), "ball": ball()}.items():
        model = warned(robot.to_pinocchio)
        library = model["result"]
        q = robot.random_configuration(1, (2,))
        dq, ddq = rng.uniform(-1, 2, (2, 2, robot.nv))
        there = convert.to_pinocchio(robot, library, q, dq, ddq)
        found[label] = {
            "warnings": model["warnings"],
            "to": there,
            "one": convert.to_pinocchio(robot, library, q[0]),
            "back": convert.from_pinocchio(robot, library, *there),
            "P": convert.pinocchio_rates(robot, library),
            "names": list(library.names),
        }
    robot = kite()
    library = warned(robot.to_pinocchio)["result"]
    again = warned(lambda: tw.from_pinocchio(library, gravity=(1, 0, -9)))["result"]
    found["read"] = [
        repr(again),
        again.gravity,
        repr(warned(lambda: tw.from_pinocchio(library, lock={"spin": 0.2}))["result"]),
    ]
    found["refused"] = {
        "model": refusal(lambda: convert.to_pinocchio(robot, 3, robot.neutral)),
        "kinds": refusal(lambda: convert.pinocchio_rates(_other_kinds(), library)),
        "names": refusal(lambda: convert.pinocchio_rates(twin(), library)),
        "locked": refusal(lambda: convert.pinocchio_rates(robot.lock({"spin": 0.3}), library)),
        "q": refusal(lambda: convert.to_pinocchio(robot, library, robot.neutral[1:])),
        "rate": refusal(lambda: convert.to_pinocchio(robot, library, robot.neutral, [1.0])),
        "back q": refusal(lambda: convert.from_pinocchio(robot, library, robot.neutral[2:])),
        "back rate": refusal(lambda: convert.from_pinocchio(robot, library, np.zeros(library.nq), [1.0])),
    }
    return found


def _other_kinds():
    return tw.load(FLOATER.replace('name="swivel" type="ball" pos="0 0 0"', 'name="swivel" axis="1 0 0"'))


@records.of
def halves_and_quaternions_of_other_libraries():
    rows = np.arange(1.0, 7.0)
    J = np.arange(12.0).reshape(6, 2)
    calls = {
        "none": lambda: convert.swap_halves(np.ones((5, 7))),
        "both": lambda: convert.swap_halves(np.ones((6, 6))),
        "axis": lambda: convert.swap_halves(J, axis=1),
        "no axis": lambda: convert.swap_halves(rows, axis=-2),
        "scipy": lambda: convert.to_scipy_quaternion([1, 2, 3]),
        "from scipy": lambda: convert.from_scipy_quaternion([[1, 2, 3]]),
    }
    return {
        "twist": convert.swap_halves(rows),
        "Jacobian": convert.swap_halves(J),
        "transposed": convert.swap_halves(J.T),
        "chosen": [convert.swap_halves(np.arange(36.0).reshape(6, 6), axis=k)[:2, :3] for k in (0, 1, -1, -2)],
        "batch": convert.swap_halves(np.arange(24.0).reshape(2, 6, 2)),
        "quaternions": [
            convert.to_scipy_quaternion([[0.1, 0.2, 0.3, 0.4], [1, 2, 3, 4]]),
            convert.from_scipy_quaternion([0.1, 0.2, 0.3, 0.4]),
        ],
        "refused": {label: refusal(call) for label, call in calls.items()},
    }


# ── derivatives of functions, and functions entry by entry ──


@records.of
def derivatives_of_functions():
    arm = twin()

    def energy(q, dq):
        return arm.kinetic_energy(q, dq) + 3.0 * q[0] ** 2 * dq[1]

    def pair(x, M):
        return np.sin(x[0]) * M, x[1] * x[0] - M[0, 1]

    def height(q):
        return arm.forward_kinematics(q)[2, 3]

    def turned(q):
        return ball().forward_kinematics(q, "hook")[:3, 3]

    x, M = np.array([0.5, -1.5]), np.array([[1.0, 2.0, -3.0], [0.5, 0.25, 4.0]])
    q, dq = np.array([0.25, 0.125]), np.array([0.5, -0.75])
    unit = np.array([0.5, 0.5, -0.5, 0.5])
    found = {}
    kernels = {
        "energy": (tw.differentiate(energy, {"q": arm, "dq": (2,)}), (q, dq)),
        "energy by q": (tw.differentiate(energy, {"q": arm, "dq": 2}, "q", values=True, mode="reverse"), (q, dq)),
        "second": (tw.differentiate(energy, {"q": arm, "dq": 2}, ["dq", "q"], form="hessian"), (q, dq)),
        "second along": (
            tw.differentiate(energy, {"q": arm, "dq": 2}, form="hessian_along"),
            (q, dq, [0.5, 2.0], [-1.0, 3.0]),
        ),
        "weighted": (tw.differentiate(energy, {"q": arm, "dq": 2}, form="weighted"), (q, dq)),
        "two results": (tw.differentiate(pair, {"x": 2, "M": (2, 3)}, mode="forward"), (x, M)),
        "two weighted": (tw.differentiate(pair, {"x": 2, "M": (2, 3)}, "x", form="weighted"), (x, M, 2 * M, 0.5)),
        "two along": (tw.differentiate(pair, {"x": 2, "M": (2, 3)}, "M", form="along", values=True), (x, M, M)),
        "two second": (tw.differentiate(pair, {"x": 2, "M": (2, 3)}, "x", form="hessian"), (x, M)),
        "two second along": (
            tw.differentiate(pair, {"x": 2, "M": (2, 3)}, "x", form="hessian_along"),
            (x, M, M, 2.0, [1.0, 0.5]),
        ),
        "height": (tw.differentiate(height, {"q": arm}, "q"), (q,)),
        "ball": (tw.differentiate(turned, {"q": ball()}, "q"), (unit,)),
        "ball second": (tw.differentiate(turned, {"q": ball()}, "q", form="hessian"), (unit,)),
        "ball second along": (
            tw.differentiate(turned, {"q": ball()}, form="hessian_along"),
            (unit, [0.3, -0.2, 0.7], [0.1, 0.5, -0.4]),
        ),
        "number": (tw.differentiate(lambda t: t**3, {"t": ()}), (2.0,)),
        "constant": (tw.differentiate(lambda t: np.ones(2), {"t": 2}), ([1.0, 2.0],)),
    }
    for label, (kernel, arrays) in kernels.items():
        found[label] = [kernel.signature, kernel.__doc__.splitlines()[0], kernel.__name__, kernel(*arrays)]
    return found


@records.of
def derivatives_refused():
    def branch(x):
        return x if x[0] > 0 else -x

    def refused(*arguments, **options):
        return refusal(lambda: tw.differentiate(*arguments, **options))

    def square(x):
        return x * x

    def many(x):
        return np.concatenate([np.sin(x * k) for k in range(1, 30)])

    return {
        "no function": refused("mass_matrix", {"x": 2}),
        "no arguments": refused(square, {}),
        "a list": refused(square, ["x"]),
        "shape": refused(square, {"x": 1.5}),
        "negative": refused(square, {"x": (2, -1)}),
        "more arguments": refused(square, {"x": 2, "y": 2}),
        "branches": refused(branch, {"x": 2}),
        "nothing": refused(lambda x: (), {"x": 2}),
        "a text": refused(lambda x: "a" * 90, {"x": 2}),
        "by": refused(square, {"x": 2}, "y"),
        "by none": refused(square, {"x": 2}, []),
        "form": refused(square, {"x": 2}, form="gradient"),
        "mode": refused(square, {"x": 2}, mode="both"),
        "mode of a form": refused(square, {"x": 2}, form="along", mode="reverse"),
        "error inside": refused(lambda x: twin().mass_matrix(x[:1]), {"x": 2}),
        "size": [refused(many, {"x": n}, form="hessian") for n in (27,)],
        "size of a Jacobian": refused(many, {"x": 132}),
        "less": tw.differentiate(many, {"x": 131}).signature,
    }


@records.of
def functions_entry_by_entry():
    from twistwrench.robot import pointwise

    x = np.array([-1.5, -0.25, 0.0, 0.5, 2.0])
    y = np.array([-1.0, -0.5, 0.25, 0.5, -3.0])

    def traced(x, y):
        return (
            pointwise.maximum(x, y),
            pointwise.minimum(x, 0.25),
            pointwise.maximum(-0.75, y),
            pointwise.clip(x, -0.5, y + 2.0),
            pointwise.where_positive(x, 3.0 * y, y - 1.0),
            pointwise.where_positive(x - y, 7.0, x),
        )

    kernel = tw.differentiate(traced, {"x": 5, "y": 5}, "x", values=True, form="along")
    nan = np.array([np.nan, 1.0, np.nan, -2.0, np.inf])
    return {
        "numbers": traced(x, y),
        "traced": kernel(x, y, np.arange(1.0, 6.0)),
        "not numbers": [kernel(nan, y, np.ones(5))[:6], kernel(x, nan, np.ones(5))[:6]],
        "constants": [
            warned(
                lambda: tw.differentiate(lambda x: pointwise.maximum(x, np.nan), {"x": 2}, values=True)([1.0, 2.0])[0]
            )["result"],
            tw.differentiate(lambda x: pointwise.minimum(np.inf, x), {"x": 2}, values=True)([1.0, np.nan])[0],
        ],
    }


@records.of
def exports_of_coupled_and_other_drives(folder):
    pair = {"motors": ["m1", "m2"], "joints": ["tilt", "slide \u00e9?"], "motor_per_joint": [[1.0, 0.5], [-0.5, 2.0]]}
    robot = twin().with_actuators(
        {"couplings": {"p": pair}, "actuators": {"m1": {"ratio": 4, "efficiency": 0.5}, "m2": {"ratio": -8}}}
    )
    files = robot.export_st("inverse_dynamics", folder, torque="motor", test=False)
    gravity = driven().export_st(
        [("inverse_dynamics", {"gravity": "input"})], folder / "g.st", torque="motor", test=False
    )
    named = tw.load(TWIN.replace("Twin-Arm 2", "x"), gravity=(0, 0, -8))
    from twistwrench.robot.export import javascript

    return {
        "coupled": plain_text(files[0].read_text("ascii")),
        "gravity": [line for line in plain_text(gravity[0].read_text("ascii")) if "gravity" in line or "tau" in line],
        "no file": c99.file_of(named),
        "long text": c99.file_of(tw.load(TWIN.replace("</robot>", " " * 9000 + "</robot>"))),
        "names": [javascript._name(name) for name in ("out", "with", "1st", "q", "\u00e9", "Math", "dq 2")],
        "numbers": [javascript._number(x) for x in ("t1", 2.0, -0.5, 1e-9)],
        "loss": Saved([], folder / "a", "r")._loss_text,
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
