"""Structured Text: the rules of the standard, results by two interpreters, and the self-test."""

from __future__ import annotations

import re

import numpy as np
import pytest
from click.testing import CliRunner
from structured_text import FUNCTIONS, Instance, blocks

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.robot.export.structured_text import RESERVED, Names, real_literal

STATES = 200
NAME = re.compile(r"[A-Za-z](_?[A-Za-z0-9])*")
REAL = r"\d+\.\d+(E[+-]?\d+)?"
STATEMENT = re.compile(
    rf"{NAME.pattern}(\[\d+\])? := ([A-Za-z](_?[A-Za-z0-9])*(\[\d+\])?|{REAL}|SEL|SQRT|SIN|COS|EXP|MIN|MAX|[-+*/<>(), ])+;"
)
MOTOR = {"torque_constant": "0.1 N m/A"}
FRICTION = {
    "viscous": "0.3 N m s/rad",
    "coulomb": "0.5 N m",
    "static": "0.8 N m",
    "stribeck": "0.1 rad/s",
    "load": "0.02",
}
DRIVES = {
    "actuators": {
        name: {"ratio": ratio, "efficiency": 0.7, "motor": MOTOR, "friction": FRICTION,
               "rotor": {"inertia": "20 g cm^2", "extra": True}}
        for name, ratio in (("joint1", 100), ("joint2", -80))
    }
}  # fmt: skip
UR5 = tw.robots.ur5().with_payload(tw.SpatialInertia.from_com(3.0, (0.0, 0.02, 0.1)), "tool0")
ARM = tw.robots.planar_2r().with_actuators(DRIVES)
COUPLED = tw.robots.planar_2r().with_actuators({
    "couplings": {
        "both": {"motors": ["left", "right"], "joints": ["joint1", "joint2"], "motor_per_joint": [[1, 0.5], [1, -1]]}
    },
    "actuators": {
        name: {"ratio": ratio, "efficiency": 0.7, "friction": FRICTION, "rotor": {"inertia": "20 g cm^2"}}
        for name, ratio in (("left", 100), ("right", -80))
    },
})  # fmt: skip


def exported(robot, quantities, folder, **options):
    return robot.export_st(quantities, folder / "x.st", **options).path.read_text(encoding="ascii")


def code(text):
    """The text without its comments."""
    return re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)


def bodies(text):
    """Statements of each function block, by its name."""
    found = re.findall(r"FUNCTION_BLOCK (\w+)\n(.*?)END_FUNCTION_BLOCK", code(text), flags=re.DOTALL)
    return {name: body.rpartition("END_VAR\n")[2].splitlines() for name, body in found}


def as_python(text, block, real=np.float64, **inputs):
    """Results of a block, its statements read as those of Python."""
    head = code(text).partition(f"FUNCTION_BLOCK {block}\n")[2].partition("END_FUNCTION_BLOCK")[0]
    sizes = re.findall(r"(\w+) : ARRAY\[0\.\.(\d+)\]", head)
    arrays = {name: [None] * (int(top) + 1) for name, top in sizes} | inputs
    statements = re.sub(REAL, r"R(\g<0>)", "\n".join(bodies(text)[block])).replace(":=", "=")
    exec(statements, {**FUNCTIONS, "R": real, **arrays})
    return {name: array for name, array in arrays.items() if name not in inputs}


def states(robot, *names, seed=3):
    rng = np.random.default_rng(seed)
    made = {"q": robot.random_configuration(rng, STATES)}
    made |= {
        name: rng.standard_normal((STATES, 3 if name == "gravity" else robot.nv)) for name in ("dq", "ddq", "gravity")
    }
    return {name: made[name] for name in names}


def columns(arrays, dtype=np.float64):
    return {name: list(np.moveaxis(x.astype(dtype), -1, 0)) for name, x in arrays.items()}


def gap(found, wanted):
    """The largest difference, as a share of the largest entry."""
    wanted = np.moveaxis(np.asarray(wanted).reshape(STATES, -1), -1, 0)
    return max(np.abs(f - w).max() for f, w in zip(found, wanted, strict=True)) / np.abs(wanted).max()


CASES = {
    "pendulum": (tw.robots.pendulum(), "inverse_dynamics", {}, ("q", "dq", "ddq")),
    "cart_pole": (tw.robots.cart_pole(), "mass_matrix", {}, ("q",)),
    "planar_2r with motors": (ARM, "inverse_dynamics", {"friction": True}, ("q", "dq", "ddq")),
    "ur5 with a payload": (UR5, "inverse_dynamics", {"gravity": "input"}, ("q", "dq", "ddq", "gravity")),
    "panda": (tw.robots.panda(), "gravity_forces", {}, ("q",)),
}


def case(name, folder, **options):
    robot, quantity, own, inputs = CASES[name]
    text = exported(robot, [(quantity, own)], folder, test=False, **options)
    return text, states(robot, *inputs), robot.kernel(quantity, **own)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(("precision", "most"), [("double", 1e-13), ("float", 1e-5)])
def test_statements_compute_the_quantity(name, precision, most, tmp_path):
    text, given, kernel = case(name, tmp_path, precision=precision)
    dtype = np.float64 if precision == "double" else np.float32
    (block,) = bodies(text)
    (found,) = as_python(text, block, dtype, **columns(given, dtype)).values()
    assert gap(found, kernel(*(x.astype(dtype).astype(float) for x in given.values()))) < most
    assert all(np.asarray(x).dtype == dtype for x in found if np.ndim(x))


@pytest.mark.parametrize("precision", ["double", "float"])
def test_friction_has_the_sign_of_each_speed_and_none_at_rest(precision, tmp_path):
    """Coulomb friction of 0.5 N m in the direction of each speed, also the smallest ones, and none at 0 and -0."""
    entry = {"friction": {"coulomb": "0.5 N m"}}
    arm = tw.robots.planar_2r().with_gravity([0, 0, 0])
    arm = arm.with_actuators({"actuators": dict.fromkeys(arm.joint_names, entry)})
    text = exported(arm, [("inverse_dynamics", {"friction": True})], tmp_path, test=False, precision=precision)
    (block,) = bodies(text)
    speeds = [0.0, -0.0, 1e-12, -1e-12, 0.25, -0.25]
    dq = np.array(np.meshgrid(speeds, speeds)).reshape(2, -1).T
    rest = np.zeros(dq.shape)  # of a straight arm, whose links move each other by nothing but their accelerations
    dtype = np.float64 if precision == "double" else np.float32
    (tau,) = as_python(text, block, dtype, **columns({"q": rest, "dq": dq, "ddq": rest}, dtype)).values()
    np.testing.assert_allclose(np.stack(tau, axis=-1), 0.5 * np.sign(dq), rtol=0, atol=1e-6)


def interpreted(text, given):
    pytest.importorskip("blark", reason="blark, a parser of Structured Text, is not installed")
    known = blocks(text)
    (name,) = known
    values = Instance(known, name).run(**columns(given))
    (output,) = re.findall(r"VAR_OUTPUT\s+(\w+)", text)
    return values[output.upper()]


@pytest.mark.parametrize(
    "name", ["pendulum", "cart_pole", *(pytest.param(n, marks=pytest.mark.slow) for n in list(CASES)[2:])]
)
def test_an_independent_parser_reads_the_same(name, tmp_path):
    text, given, kernel = case(name, tmp_path)
    assert gap(interpreted(text, given), kernel(*given.values())) < 1e-13


def test_the_self_test_passes_and_finds_a_changed_number(tmp_path):
    pytest.importorskip("blark", reason="blark, a parser of Structured Text, is not installed")
    text = exported(tw.robots.pendulum(), ["gravity_forces"], tmp_path)
    values = Instance(blocks(text), "pendulum_TEST").run()
    assert values["PASSED"] and values["WORST"] <= 1.0
    changed = text.replace("9.81 * t0", "9.82 * t0")
    assert changed != text and not Instance(blocks(changed), "pendulum_TEST").run()["PASSED"]


# ── Rules of the standard ──


def everything(folder, **options):
    """A file with square roots, signs, exponentials, minima, matrices and the test."""
    quantities = [
        ("inverse_dynamics", {"friction": True}), "forward_dynamics", "mass_matrix", "forward_kinematics",
        ("jacobian", {"kind": "space"}), ("inverse_dynamics", {"gravity": "input", "wrenches": "tip"}),
    ]  # fmt: skip
    return exported(ARM, quantities, folder, **options)


def test_each_statement_is_one_assignment_of_known_operations(tmp_path):
    text = everything(tmp_path, test=False)
    lines = [line for body in bodies(text).values() for line in body]
    assert len(lines) > 150
    assert not [line for line in lines if not STATEMENT.fullmatch(line)]
    assert {"SEL(", "EXP(", "SIN(", "COS("} <= set(re.findall(r"[A-Z]+\(", "".join(lines)))
    assert "ATAN" not in text and max(map(len, lines)) < 80


def test_real_literals_have_digits_on_both_sides_of_the_point():
    for value in (1e-5, 1.0, -2.0, 1e22, 5e-324, 0.1, 123456.789, 1e16, 0.0, -0.0):
        text = real_literal(value)
        assert re.fullmatch(rf"{REAL}|\(-{REAL}\)", text) and float(text.strip("()")) == value
    assert real_literal(0.1, "float") == "0.1"
    with pytest.raises(tw.KernelError, match="not a finite"):
        real_literal(np.inf)
    with pytest.raises(tw.KernelError, match="precision='double'"):
        real_literal(1e60, "float")


def test_names_differ_by_more_than_case_and_are_not_reserved(tmp_path):
    names = Names()
    assert [names.free(x) for x in ("M", "m", "dt", "DT", "2r", "a__b_", "Lambda", "lambda")] == [
        "M", "m_2", "dt_value", "DT_value_2", "x_2r", "a_b", "Lambda", "lambda_2"
    ]  # fmt: skip
    text = everything(tmp_path)
    for part in re.split(r"END_FUNCTION_BLOCK|END_PROGRAM", code(text))[:-1]:
        declared = re.findall(r"(?:FUNCTION_BLOCK|PROGRAM) (\w+)", part)
        for line in re.findall(r"^    ([\w, ]+) : ", part, flags=re.MULTILINE):
            declared += line.split(", ")
        assert len({x.lower() for x in declared}) == len(declared)
        assert all(NAME.fullmatch(x) and x.lower() not in RESERVED for x in declared)
    assert {"dt", "time", "ln", "mod", "of", "to", "tod", "date", "exp"} <= RESERVED


def test_frames_that_differ_by_case_make_two_blocks(tmp_path):
    text = tw.robots.planar_2r().to_urdf().replace('"link2"', '"LINK1"')
    asked = [("forward_kinematics", {"frame": frame}) for frame in ("link1", "LINK1")]
    names = list(bodies(exported(tw.load(text), asked, tmp_path, test=False)))
    assert len({name.lower() for name in names}) == 2


def test_matrices_lie_row_by_row_and_arrays_begin_at_zero(tmp_path):
    text = exported(tw.robots.ur5(), [("jacobian", {"kind": "space"})], tmp_path, test=False)
    assert "J : ARRAY[0..35] OF LREAL;" in text and "q : ARRAY[0..5] OF LREAL;" in text
    given = states(tw.robots.ur5(), "q")
    (found,) = as_python(text, "ur5_jacobian_tool0_space", **columns(given)).values()
    wanted = tw.robots.ur5().jacobian(given["q"], kind="space")
    assert np.allclose(np.broadcast_to(found[6 * 1 + 2], STATES), wanted[:, 1, 2], atol=1e-14)


def test_single_precision_has_no_lreal_and_comments_no_signs_that_end_them(tmp_path):
    assert "LREAL" not in everything(tmp_path, precision="float")
    named = tw.robots.pendulum().to_urdf().replace('"hinge"', '"h*)x(*é"')
    text = exported(tw.load(named), ["gravity_forces"], tmp_path)
    assert text.count("(*") == text.count("*)") and text.isascii()
    outside = code(text)
    assert "*)" not in outside and "(*" not in outside


def test_the_header_names_robot_hash_order_and_limits(tmp_path):
    text = exported(UR5, ["inverse_dynamics"], tmp_path, test=False)
    program = UR5.program("inverse_dynamics")
    for words in ("robot ur5", program.digest[:12], "Not run on a PLC", "shoulder_lift_joint", "signs of rotation"):
        assert words in text, words
    assert "PROGRAM" not in text and "PROGRAM ur5_TEST" in exported(UR5, ["inverse_dynamics"], tmp_path)


# ── Motors, CODESYS, the command ──


@pytest.mark.parametrize("arm", [ARM, COUPLED], ids=["one motor a joint", "coupled motors"])
@pytest.mark.parametrize("friction", [False, True])
def test_motor_torques_are_those_of_motor_loads(arm, friction, tmp_path):
    text = exported(arm, [("inverse_dynamics", {"friction": friction})], tmp_path, torque="motor")
    assert ("in the order left, right." if arm is COUPLED else "in the order of the joints.") in text
    (block,) = bodies(text)
    assert block == f"planar_2r_motor_torques{'_friction' * friction}"
    given = states(arm, "q", "dq", "ddq")
    found = as_python(text, block, **columns(given))["tau"]
    assert gap(found, arm.motor_loads(*given.values(), friction=friction).torque) < 1e-13


@pytest.mark.parametrize("ratios", [(50, 30), (-50, 30), (50, -30), (-50, -30)])
def test_no_load_torques_oppose_rotors_that_gears_turn_either_way(ratios, tmp_path):
    drives = {
        "actuators": {"joint1": {"ratio": ratios[0], "no_load_torque": "0.3 N m"}, "joint2": {"ratio": ratios[1]}}
    }
    arm = tw.robots.planar_2r().with_actuators(drives)
    text = exported(arm, ["inverse_dynamics"], tmp_path, torque="motor")
    given = states(arm, "q", "dq", "ddq")
    found = as_python(text, *bodies(text), **columns(given))["tau"]
    assert gap(found, arm.motor_loads(*given.values()).torque) < 1e-13


def test_wrenches_and_gravity_reach_the_motors(tmp_path):
    wanted = ("inverse_dynamics", {"wrenches": ("tip",), "on_robot": ("tip",), "gravity": "input"})
    text = exported(ARM, [wanted], tmp_path, torque="motor", test=False)
    given = states(ARM, "q", "dq", "ddq")
    wrench = np.random.default_rng(0).standard_normal((STATES, 6))
    gravity = np.broadcast_to([0.0, 1.0, -3.0], (STATES, 3))
    more = columns({"wrench_tip": wrench, "gravity": gravity})
    (found,) = as_python(text, *bodies(text), **columns(given), **more).values()
    tilted = tw.robots.planar_2r().with_gravity([0.0, 1.0, -3.0]).with_actuators(DRIVES)
    assert gap(found, tilted.motor_loads(*given.values(), wrench_on_robot={"tip": wrench}).torque) < 1e-13


def test_codesys_has_gravity_as_an_input_and_says_what_is_missing(tmp_path):
    text = exported(ARM, "inverse_dynamics", tmp_path, style="codesys", torque="motor")
    assert "FUNCTION_BLOCK planar_2r_dynamics IMPLEMENTS ISMDynamics" in text
    assert "METHOD AxesStateToTorque" in text and "To be completed in CODESYS" in text
    assert "gravity : ARRAY[0..2] OF LREAL;" in text


@pytest.mark.parametrize(
    ("robot", "quantities", "options", "words"),
    [
        (ARM, ["mass_matrix"], {"torque": "motor"}, "applies to inverse_dynamics"),
        (tw.robots.ur5(), ["inverse_dynamics"], {"torque": "motor"}, "needs an actuator at every joint"),
        (ARM, ["mass_matrix"], {"style": "codesys"}, "writes inverse_dynamics alone"),
        (ARM, ["mass_matrix"], {"style": "beckhoff"}, "style"),
        (ARM, ["mass_matrix"], {"torque": "both"}, "torque"),
        (ARM, ["mass"], {}, "mass_matrix"),
        (ARM, [], {}, "no quantity is named"),
    ],
)
def test_bad_input_is_one_error_and_no_file(robot, quantities, options, words, tmp_path):
    with pytest.raises(tw.TwistWrenchError, match=words):
        robot.export_st(quantities, tmp_path, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("path", ["nowhere", "arm.c", "nowhere/arm.st"])
def test_paths_that_cannot_be_written(path, tmp_path):
    with pytest.raises(tw.TwistWrenchError, match=r"nowhere|arm"):
        ARM.export_st("mass_matrix", tmp_path / path)
    assert not list(tmp_path.iterdir())


def test_the_command_writes_what_the_library_writes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = [
        "export",
        "ur5",
        "--st",
        "a.st",
        "--payload",
        "3,0,0.02,0.1@tool0",
        "--gravity-input",
        "--actuators",
        "demo",
    ]
    result = CliRunner().invoke(main, [*arguments, "--torque-side", "motor", "--float"])
    assert result.exit_code == 0 and "wrote a.st" in result.output, result.output
    ur5 = tw.robots.ur5().with_actuators(tw.robots.path_of("ur5").with_name("ur5_demo.yaml"))
    loaded = ur5.with_payload(tw.SpatialInertia.from_com(3.0, (0.0, 0.02, 0.1)), "tool0")
    wanted = loaded.export_st([("inverse_dynamics", {"gravity": "input"})], "b.st", precision="float", torque="motor")
    assert (tmp_path / "a.st").read_text() == wanted.path.read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "Add --c OUT.c, --st OUT.st or --ros2 DIR"),
        (["--c", "a.c", "--torque-side", "motor"], "Add --st OUT.st"),
        (["--st", "a.st", "--torque-side", "motor"], "--torque-side motor needs an actuator"),
        (["--st", "a.c"], "--st 'a.c'"),
    ],
)
def test_bad_options_are_one_line(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, ["export", "planar_2r", *arguments])
    assert result.exit_code == 2 and words in result.output and not list(tmp_path.iterdir()), result.output
