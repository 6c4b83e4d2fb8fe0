"""Exported C: what the compiler says of it, what its functions give beside the kernels, and what is refused.

Tests that need a C compiler are skipped where ``cc`` is not found.
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess

import numpy as np
import pytest
from places import ROOT
from quick import mostly_slow

import twistwrench as tw
from twistwrench.compiler.ir.program import ARITY, Instruction, Program, TensorSpec
from twistwrench.compiler.ir.tracer import trace
from twistwrench.compiler.printers.c99 import FUSED_MACROS, CFunction
from twistwrench.compiler.runtime.gufunc import make_ufunc
from twistwrench.robot.quantities import QUANTITIES
from twistwrench.testing import assert_close, relative_gap

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Wdouble-promotion", "-Werror"]
STRICT, STRICT_CPP = ["-std=c99", *WARNINGS], ["-x", "c++", "-std=c++11", *WARNINGS]
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)] or ["cc"]
DTYPES = {"double": np.float64, "float": np.float32}
EPS = {"double": 2.0**-52, "float": 2.0**-23}

compiled = pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler: cc is not on the path")


def everything(robot):
    """Every quantity that is a function of the robot's state, with options where they are needed."""
    found = []
    for name, quantity in QUANTITIES.items():
        options = {}
        if "constraints" in quantity.options or (name == "christoffel" and robot.nq != robot.nv):
            continue
        if "frame" in quantity.options:
            options["frame"] = robot.frame_names[-1]
        if "rows" in quantity.options:
            options |= {"kind": "world_aligned", "rows": "vx vz"}
        found.append((name, options))
    return found


MAIN = ["inverse_dynamics", "mass_matrix", "forward_dynamics", "gravity_forces", "momentum", "link_poses"]


class Library:
    """The functions of one export, called with arrays of one state."""

    def __init__(self, robot, quantities, folder, precision="double", flags=("-O1",), **options):
        files = robot.export_c(quantities, folder, precision=precision, test=False, **options)
        library = folder / f"{files[1].stem}_{precision}.so"
        build("cc", ["-std=c99", *flags, "-shared", "-fPIC", files[1], "-o", library, "-lm"])
        self.code, self.dtype = ctypes.CDLL(str(library)), DTYPES[precision]

    def __call__(self, function, program, *arrays):
        """The outputs of one function; arrays of one state."""
        outputs = [np.full(port.shape, np.nan, self.dtype) for port in program.outputs]
        self.into(function, [np.ascontiguousarray(a, self.dtype) for a in arrays], outputs)
        return outputs

    def into(self, function, inputs, outputs):
        getattr(self.code, function)(*(a.ctypes.data_as(ctypes.c_void_p) for a in (*inputs, *outputs)))


def build(compiler, arguments):
    done = subprocess.run([compiler, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr


def names_of(header):
    return re.findall(r"^void (\w+)\(", header.read_text(), re.MULTILINE)


def states(robot, program, count, seed=1):
    """Random inputs of a program, one list of arrays a state."""
    rng = np.random.default_rng(seed)
    made = [
        robot.random_configuration(rng, count) if p.name == "q" else rng.standard_normal((count, *p.shape))
        for p in program.inputs
    ]
    return [list(state) for state in zip(*made, strict=True)]


# ── what the functions give ──

CASES = [
    ("planar_2r", everything),
    ("cart_pole", lambda _: MAIN[:3]),
    ("ur5", lambda _: [*MAIN, ("jacobian", {"frame": "wrist_3_link", "kind": "space"}), "coriolis_matrix"]),
    ("panda", lambda _: MAIN[:3]),
    ("quadruped", lambda _: [*MAIN[:2], ("frame_acceleration", {"frame": "FL_foot", "kind": "world_aligned"})]),
]


@compiled
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize(("name", "wanted"), mostly_slow(CASES, 4), ids=[name for name, _ in CASES])
def test_the_functions_give_what_the_kernels_give(name, wanted, precision, bundled, tmp_path):
    robot = bundled(name)
    quantities = wanted(robot)
    library = Library(robot, quantities, tmp_path, precision)
    exported = names_of(tmp_path / f"{name}.h")
    assert len(exported) == len(quantities)
    for function, quantity in zip(exported, quantities, strict=True):
        quantity, options = (quantity, {}) if isinstance(quantity, str) else quantity
        kernel, program = robot.kernel(quantity, **options), robot.program(quantity, **options)
        for state in states(robot, program, 5):
            given = [a.astype(np.float32) for a in state]
            single, double, same = (
                x if isinstance(x, tuple) else (x,)
                for x in (
                    kernel(*given),
                    kernel(*(a.astype(float) for a in given)),
                    kernel(*(a.astype(DTYPES[precision]) for a in given)),
                )
            )
            found = library(function, program, *given)
            for port, f, s, d, k in zip(program.outputs, found, single, double, same, strict=True):
                # Sines differ in the last place, so the two may be apart as far as rounding reaches at this state: that
                # of single precision is its distance from double; that of double is as much smaller as its numbers are finer.
                rounding = max(relative_gap(s, d), EPS["float"]) * EPS[precision] / EPS["float"]
                assert_close(f, k, 16 * rounding, f"{function}: {port.name}")


@compiled
@pytest.mark.parametrize("precision", ["double", "float"])
def test_without_sines_results_have_the_bits_of_the_kernels(precision, bundled, tmp_path):
    robot = bundled("floating_box")
    quantities = [(n, o) for n, o in everything(robot) if "rows" not in o and n != "add"]  # that turns by an angle
    quantities = quantities[precision == "float" :: 2]  # half of them in each precision
    library = Library(robot, quantities, tmp_path, precision)
    for function, (quantity, options) in zip(names_of(tmp_path / "floating_box.h"), quantities, strict=True):
        kernel, program = robot.kernel(quantity, **options), robot.program(quantity, **options)
        assert not {"sin", "cos", "exp"} & set(program.counts())
        for state in states(robot, program, 5):
            state = [a.astype(DTYPES[precision]) for a in state]
            wanted = kernel(*state)
            for f, k in zip(library(function, program, *state), wanted if kernel.nout > 1 else [wanted], strict=True):
                np.testing.assert_array_equal(f, k, err_msg=function)


@compiled
def test_where_sines_agree_results_have_the_bits_of_the_kernels(bundled, tmp_path):
    """Fused products are fused in C too, and nothing else is: only the sines are others."""
    robot = tw.Robot(bundled("ur5").model)  # kernels of this processor, whatever other tests asked the shared robot for
    ours = make_ufunc(trace(lambda x: (np.sin(x), np.cos(x)), [("x", ())], ["sin", "cos"]), "sincos", "")
    program = trace(lambda q: (np.sin(q), np.cos(q)), [("q", (6,))], ["s", "c"])
    source = tmp_path / "sines.c"
    source.write_text(f"#include <math.h>\n{CFunction('sines', program).definition}\n")
    build("cc", ["-std=c99", "-shared", "-fPIC", "-w", source, "-o", tmp_path / "sines.so", "-lm"])
    sines = ctypes.CDLL(str(tmp_path / "sines.so"))
    library = Library(robot, MAIN, tmp_path)
    agreeing = 0
    for q, dq, ddq in states(robot, robot.program("inverse_dynamics"), 300):
        s, c = np.empty(6), np.empty(6)
        sines.sines(*(a.ctypes.data_as(ctypes.c_void_p) for a in (q, s, c)))
        if not all(np.array_equal(a, b) for a, b in zip((s, c), ours(q), strict=True)):
            continue
        agreeing += 1
        given = {"q": q, "dq": dq, "ddq": ddq, "tau": ddq}
        for quantity in MAIN:
            program = robot.program(quantity)
            arrays = [given[port.name] for port in program.inputs]
            (found,) = library(f"ur5_{quantity}", program, *arrays)
            np.testing.assert_array_equal(found, robot.kernel(quantity)(*arrays), err_msg=quantity)
    assert agreeing >= 5  # of 300; each of the twelve agrees some nine times in ten


@compiled
def test_without_fma_results_agree_to_round_off(bundled, tmp_path):
    robot = bundled("panda")
    library = Library(robot, MAIN[:2], tmp_path, flags=("-O1", "-DTWISTWRENCH_NO_FMA"))
    program = robot.program("inverse_dynamics")
    for state in states(robot, program, 5):
        (tau,) = library("panda_inverse_dynamics", program, *state)
        assert_close(tau, robot.kernel("inverse_dynamics")(*state), 1e-13)  # 500 operations of 1e-16 each


OPERATIONS = {
    "fma": lambda a, b, c: a * b + c,
    "fms": lambda a, b, c: a * b - c,
    "fnma": lambda a, b, c: c - a * b,
    "fnms": lambda a, b, c: -(a * b) - c,
    "add": lambda a, b, c: a + b,
    "sub": lambda a, b, c: a - b,
    "mul": lambda a, b, c: a * b,
    "div": lambda a, b, c: a / b,
    "neg": lambda a, b, c: -a,
    "sqrt": lambda a, b, c: np.sqrt(a),
    "sin": lambda a, b, c: np.sin(a),
    "cos": lambda a, b, c: np.cos(a),
    "exp": lambda a, b, c: np.exp(a),
    "sign": lambda a, b, c: np.sign(a),
    "min": lambda a, b, c: np.where(a < b, a, b),
    "max": lambda a, b, c: np.where(a > b, a, b),
}


@compiled
@pytest.mark.parametrize("flags", [(), ("-DTWISTWRENCH_NO_FMA",)], ids=["fma", "no fma"])
def test_every_operation_is_what_its_name_says(flags, tmp_path):
    """Signs of the fused ones; 0 and NaN have no sign."""
    inputs = [Instruction("input", (), k) for k in range(3)]
    operations = [Instruction(op, (0, 1, 2)[: ARITY[op]], 0.0) for op in OPERATIONS]
    assert set(ARITY) == {"const", "input", *OPERATIONS}
    results = tuple(range(3, 3 + len(operations)))
    ports = tuple(TensorSpec(name, ()) for name in "abc"), tuple(TensorSpec(f"{op}_of", ()) for op in OPERATIONS)
    source, library = tmp_path / "ops.c", tmp_path / "ops.so"
    body = CFunction("ops", Program((*inputs, *operations), results, *ports)).definition
    source.write_text(f"#include <math.h>\n{FUSED_MACROS.format(fma='fma')}\n{body}\n")
    build("cc", ["-std=c99", *flags, "-shared", "-fPIC", "-w", source, "-o", library, "-lm"])
    ops = ctypes.CDLL(str(library)).ops
    for a, b, c in ((2.0, 3.0, 5.0), (0.0, 4.0, -1.0), (9.0, -0.5, 0.25), (-1.5, 2.0, 3.0), (np.nan, 1.0, 1.0)):
        given, found = [np.array(x) for x in (a, b, c)], [np.array(7.0) for _ in OPERATIONS]
        ops(*(x.ctypes.data_as(ctypes.c_void_p) for x in (*given, *found)))
        with np.errstate(invalid="ignore"):
            for name, x, wanted in zip(OPERATIONS, found, (f(a, b, c) for f in OPERATIONS.values()), strict=True):
                np.testing.assert_allclose(x, wanted, rtol=1e-15, err_msg=f"{name}({a}, {b}, {c})")


@compiled
def test_an_output_may_be_the_array_of_an_input(bundled, tmp_path):
    robot = bundled("ur5")
    library = Library(robot, ["inverse_dynamics", "forward_dynamics"], tmp_path, flags=("-O2",))
    for quantity in ("inverse_dynamics", "forward_dynamics"):
        program = robot.program(quantity)
        (state,) = states(robot, program, 1)
        (apart,) = library(f"ur5_{quantity}", program, *state)
        for k in range(3):
            shared = [a.copy() for a in state]
            library.into(f"ur5_{quantity}", shared, [shared[k]])
            np.testing.assert_array_equal(shared[k], apart)


@compiled
def test_all_is_read_before_anything_is_written(tmp_path):
    program = trace(lambda x: np.stack([x[1], 2.0 * x[0]]), [("x", (2,))], ["y"])
    (tmp_path / "swap.c").write_text(f"{CFunction('swap', program).definition}\n")
    build("cc", ["-std=c99", "-O2", "-w", "-shared", "-fPIC", tmp_path / "swap.c", "-o", tmp_path / "swap.so"])
    x = np.array([3.0, 4.0])
    ctypes.CDLL(str(tmp_path / "swap.so")).swap(*[x.ctypes.data_as(ctypes.c_void_p)] * 2)
    assert x.tolist() == [4.0, 6.0]


@compiled
def test_wrenches_and_gravity_are_further_inputs(bundled, tmp_path):
    robot = bundled("ur5")
    options = {"wrenches": ("tool0", "forearm_link"), "gravity": "input"}
    library = Library(robot, {"inverse_dynamics": options}, tmp_path)
    (function,) = names_of(tmp_path / "ur5.h")
    assert function == "ur5_inverse_dynamics_wrench_tool0_wrench_forearm_link_gravity_input"
    program = robot.program("inverse_dynamics", **options)
    for state in states(robot, program, 3):
        (tau,) = library(function, program, *state)
        assert_close(tau, robot.kernel("inverse_dynamics", **options)(*state), 1e-13)


# ── what compilers say ──


@compiled
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize(("name", "level"), mostly_slow([("planar_2r", "-O2"), ("cart_pole", "-O0")], 2))
def test_no_compiler_has_anything_to_remark(compiler, precision, name, level, bundled, tmp_path):
    robot = bundled(name)
    _, source, test = robot.export_c(everything(robot), tmp_path, precision=precision)
    for file in (source, test):
        build(compiler, [*STRICT, level, "-c", file, "-o", tmp_path / "a.o"])
    build(compiler, [*STRICT, level, "-DTWISTWRENCH_NO_FMA", "-c", source, "-o", tmp_path / "a.o"])


@pytest.mark.parametrize("compiler", [c for c in ("g++", "clang++") if shutil.which(c)] or ["c++"])
def test_header_and_source_are_cpp_too(compiler, bundled, tmp_path):
    if not shutil.which(compiler):
        pytest.skip("no C++ compiler: c++ is not on the path")
    robot = bundled("planar_2r")
    header, source, _ = robot.export_c(everything(robot), tmp_path)
    user = tmp_path / "user.cpp"
    user.write_text(
        f'#include "{header.name}"\nint main() {{ double M[4], q[2] = {{0.0, 0.0}};\n'
        "planar_2r_mass_matrix(q, M); return M[0] > 0.0 ? 0 : 1; }\n"
    )
    build(compiler, [*STRICT_CPP, "-c", source, "-o", tmp_path / "cpp.o"])
    build("cc", ["-std=c99", "-c", source, "-o", tmp_path / "c.o"])
    build(compiler, [user, tmp_path / "c.o", "-lm", "-o", tmp_path / "user"])  # C linkage
    assert subprocess.run([tmp_path / "user"]).returncode == 0


@compiled
def test_the_loop_of_the_page_compiles_and_controls(bundled, tmp_path):
    """At the wanted state the feedback is silent: what remains is inverse dynamics."""
    page = ROOT / "docs" / "export.md"
    (snippet,) = re.findall(r"^```c\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    robot = bundled("panda")
    _, source, _ = robot.export_c("inverse_dynamics", tmp_path)
    (tmp_path / "loop.c").write_text(snippet)
    build("cc", [*STRICT, "-shared", "-fPIC", source, tmp_path / "loop.c", "-o", tmp_path / "loop.so", "-lm"])
    (state,) = states(robot, robot.program("inverse_dynamics"), 1)
    q, dq, ddq = state
    tau = np.empty(7)
    control = ctypes.CDLL(str(tmp_path / "loop.so")).control
    control(*(a.ctypes.data_as(ctypes.c_void_p) for a in (q, dq, q, dq, ddq, tau)))
    assert_close(tau, robot.inverse_dynamics(q, dq, ddq), 1e-13)


HOSTILE = """
<robot name="7 arms */ int x; /* &quot;α&quot; ??/">
  <link name="base"/>
  <link name="up per"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="up-per"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j*/#error&#x202e;" type="continuous"><parent link="base"/><child link="up per"/><axis xyz="0 0 1"/></joint>
  <joint name="\\" type="prismatic"><parent link="up per"/><child link="up-per"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""


@compiled
def test_names_of_a_robot_can_neither_end_a_comment_nor_break_an_identifier(tmp_path):
    robot = tw.load(HOSTILE)
    wanted = [("inverse_dynamics", {"wrenches": ("up per", "up-per")}), ("jacobian", {"frame": "up per"})]
    header, source, test = robot.export_c(wanted, tmp_path)
    assert header.name == "robot_7_arms_int_x.h"
    for file in (header, source, test):
        assert file.read_text().isascii()
    build("cc", [*STRICT, source, test, "-o", tmp_path / "test", "-lm"])
    assert subprocess.run([tmp_path / "test"]).returncode == 0


# ── the test that goes along ──


@compiled
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("wrong", ["1.1 times", "no number"])
def test_the_test_passes_and_notices_a_wrong_number(wrong, precision, bundled, tmp_path):
    robot = bundled("panda")
    _, source, test = robot.export_c(MAIN[:2], tmp_path, precision=precision)
    program = tmp_path / "check"
    build("cc", [*STRICT, source, test, "-o", program, "-lm"])
    done = subprocess.run([program], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.count("ok  ") == 2, done.stdout
    text = source.read_text()
    constant = max(re.findall(r"\b\d\.\d{5,}", text), key=float)
    if wrong == "1.1 times":
        source.write_text(text.replace(constant, str(float(constant) * 1.1)))
    else:  # the first entry at the first state alone
        one_off = re.sub(r"(_M\[3\]\[49\] = \{\n    \{)[^,]+", rf"\1({precision})NAN", test.read_text())
        assert one_off.count("NAN") == 1
        test.write_text(one_off)
    build("cc", [*STRICT, source, test, "-o", program, "-lm"])
    done = subprocess.run([program], capture_output=True, text=True)
    assert done.returncode == 1 and "FAIL" in done.stdout, done.stdout


# ── the texts ──


def test_the_same_text_twice(tmp_path):
    texts = []
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        files = tw.robots.ur5().export_c(MAIN[:2], tmp_path / folder)
        texts.append([file.read_bytes() for file in files])
    assert texts[0] == texts[1]
    for text in texts[0]:
        assert str(tmp_path).encode() not in text and not re.search(rb"20\d\d-\d\d", text)


def test_the_header_says_what_is_what(bundled, tmp_path):
    robot = bundled("quadruped")
    header, _, _ = robot.export_c(["inverse_dynamics", "friction_forces"], tmp_path / "legs.c", prefix="dog")
    text = header.read_text()
    assert "#define DOG_NQ 19\n#define DOG_NV 18" in text and "#ifndef LEGS_H" in text
    for k, name in enumerate(robot.coordinate_names):
        assert re.search(rf"^ \* +{k}  {re.escape(name)}( +m| +rad)?$", text, re.MULTILINE)
    assert "void dog_inverse_dynamics(const double q[19], const double dq[18]" in text
    assert "void dog_friction_forces(const double dq[18], double tau[18])" in text
    counts = robot.program("inverse_dynamics").counts()
    assert f"{counts['mul']} multiplications, {counts['add'] + counts['sub']} additions" in text
    assert f"{sum(counts[k] for k in ('fma', 'fms', 'fnma'))} fused multiply-adds" in text
    assert "twistwrench 0." in text and "(0, 0, -9.81) m/s^2" in text


def test_the_header_names_the_parameters_with_the_robots_own_numbers(bundled, tmp_path):
    asked = ("inverse_dynamics", {"parameters": ("link2.mass", "joint2.x"), "by": "parameters"})
    header, *_ = bundled("planar_2r").export_c([asked], tmp_path, test=False)
    assert " *     0  link2.mass  1\n *     1  joint2.x    1\n" in header.read_text()


def test_units_go_with_the_joints(bundled, tmp_path):
    header, *_ = bundled("cart_pole").export_c("mass_matrix", tmp_path, test=False)
    slide, swing = bundled("cart_pole").joint_names
    assert re.search(rf"{slide} +m\n", header.read_text()) and re.search(rf"{swing} +rad\n", header.read_text())
    assert re.search(rf"{slide} +m/s, m/s\^2, N\n", header.read_text())


def test_units_of_a_free_joint_s_velocities_are_those_of_turning_and_then_of_sliding(bundled, tmp_path):
    """A twist: the angular part first, in rad/s, and then the linear part, in m/s."""
    header, *_ = bundled("floating_box").export_c("kinetic_energy", tmp_path, test=False)
    (joint,) = bundled("floating_box").joint_names
    units = re.findall(rf"^ \* +\d  {joint} +(.*/s.*)$", header.read_text(), re.MULTILINE)
    assert units == ["rad/s, rad/s^2, N m"] * 3 + ["m/s, m/s^2, N"] * 3


def test_every_quantity_has_a_meaning_in_ascii():
    texts = [quantity.meaning for quantity in QUANTITIES.values()]
    assert all(text and text.isascii() and not text.endswith(".") for text in texts)


def test_sine_and_cosine_of_an_angle_stand_together():
    """One call makes both, where the compiler sees that it may."""
    program = trace(lambda x: np.concatenate([np.sin(x), np.cos(x)]), [("x", (3,))], ["y"])
    calls = re.findall(r"= (sin|cos)\((x_\d)\);", CFunction("f", program).definition)
    assert calls == [(name, f"x_{k}") for k in range(3) for name in ("sin", "cos")]


# ── what is refused ──


@pytest.mark.parametrize(
    ("quantities", "options", "error", "words"),
    [
        ("inverse_dynamic", {}, tw.UnknownNameError, ["inverse_dynamics", "mass_matrix"]),
        ([], {}, tw.ValueRangeError, ["no quantity is named", "mass_matrix"]),
        (["mass_matrix", "mass_matrix"], {}, tw.ValueRangeError, ["ur5_mass_matrix would be there twice"]),
        ([("mass_matrix", {"frame": "tool0"})], {}, tw.KernelError, ["takes no option 'frame'"]),
        ([("bias_forces", {"friction": True})], {}, tw.KernelError, ["takes no option 'friction'", "wrenches"]),
        ([("jacobian", {"frame": "tool9"})], {}, tw.UnknownNameError, ["tool9", "tool0"]),
        ([("jacobian", {"kind": "bodily"})], {}, tw.UnknownNameError, ["world_aligned"]),
        (["mass_matrix", 3], {}, tw.ShapeError, ["3 is not a quantity"]),
        (3, {}, tw.ShapeError, ["3 is not a quantity"]),
        (["constraint_jacobian"], {}, tw.KernelError, ["constraints="]),
        ("mass_matrix", {"precision": "half"}, tw.UnknownNameError, ["half", "double, float"]),
        ("mass_matrix", {"prefix": "my robot"}, tw.ValueRangeError, ["my robot", "letter first"]),
        ("mass_matrix", {"prefix": ""}, tw.ValueRangeError, ["letter first"]),
    ],
)
def test_what_cannot_be_exported_is_refused(quantities, options, error, words, bundled, tmp_path):
    with pytest.raises(error) as caught:
        bundled("ur5").export_c(quantities, tmp_path, **options)
    assert all(word in str(caught.value) for word in words), caught.value
    assert not list(tmp_path.iterdir())


def test_more_rows_than_velocities_have_no_program(bundled, tmp_path):
    with pytest.raises(tw.KernelError, match="singular values of J on a robot with 2 velocities"):
        bundled("planar_2r").export_c("task_inertia", tmp_path)
    with pytest.raises(tw.KernelError, match="Lambda is not finite"):  # the tip does not move along its own z axis
        bundled("planar_2r").export_c([("task_inertia", {"rows": "vx vz"})], tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_robot_without_inverse_and_one_without_joints_are_refused(bundled, tmp_path):
    massless = '<robot name="a"><link name="b"/><link name="c"/><joint name="j" type="continuous"><parent link="b"/><child link="c"/></joint></robot>'
    with pytest.raises(tw.SingularMassMatrixError):
        tw.load(massless).export_c("forward_dynamics", tmp_path)
    arm = bundled("planar_2r")
    with pytest.raises(tw.KernelError, match="no joint that moves"):
        arm.lock({"joint1": 0.0, "joint2": 0.0}).export_c("mass_matrix", tmp_path)


def test_numbers_beyond_float_are_refused(bundled, tmp_path):
    heavy = bundled("planar_2r").with_payload(tw.SpatialInertia.from_com(1e39))
    with pytest.raises(tw.KernelError, match="not a finite float"):
        heavy.export_c("mass_matrix", tmp_path, precision="float")
    heavy.export_c("mass_matrix", tmp_path, test=False)


def test_paths_that_cannot_be_written_are_refused(bundled, tmp_path):
    arm = bundled("planar_2r")
    for path, words in (
        (tmp_path / "missing", "neither a folder"),
        (tmp_path / "missing" / "arm.c", "no such folder"),
        (tmp_path / "arm.h", "ends in .c"),
        (tmp_path / 'a"b.c', "#include"),
    ):
        with pytest.raises(tw.ValueRangeError, match=words):
            arm.export_c("mass_matrix", path)
    (tmp_path / "arm.h").mkdir()
    with pytest.raises(tw.ValueRangeError, match="it is a folder"):
        arm.export_c("mass_matrix", tmp_path / "arm.c")


def test_the_file_of_the_robot_is_never_overwritten(tmp_path):
    for name in ("arm.c", "arm.h", "arm_test.c"):
        source = tmp_path / name
        shutil.copy(tw.robots.path_of("planar_2r"), source)
        before = source.read_bytes()
        with pytest.raises(tw.ValueRangeError, match="overwrite the file of the robot"):
            tw.load(source).export_c("mass_matrix", tmp_path / "arm.c")
        assert source.read_bytes() == before
        source.unlink()
