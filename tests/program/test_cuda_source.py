"""CUDA source: what NVIDIA's compilers say of it, and what the same text gives as C++ beside the kernels of the processor.

Compiling it for a GPU needs ``nvcc`` on the path, or NVRTC; running it as C++ needs ``c++``.
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from bench.cuda_launch import compile_kernel, launch
from quick import mostly_slow

import twistwrench as tw
from twistwrench.compiler.printers.cuda import OPTIONS, CudaFunction
from twistwrench.robot.quantities import QUANTITIES

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Wdouble-promotion", "-Werror"]
COMPILERS = [name for name in ("g++", "clang++") if shutil.which(name)] or ["c++"]
DTYPES = {"double": np.float64, "float": np.float32}
EPS = {"double": 2.0**-52, "float": 2.0**-23}

as_cpp = pytest.mark.skipif(not shutil.which("c++"), reason="no C++ compiler: c++ is not on the path")


def build(source, folder, compiler="c++", flags=("-O0",)):
    """The function of a kernel's name: all its blocks on the processor."""
    file = folder / "kernel.cpp"
    file.write_text(source)
    library = folder / "kernel.so"
    command = [compiler, "-std=c++17", "-ffp-contract=off", *flags, "-shared", "-fPIC", file, "-o", library, "-lm"]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr
    return getattr(ctypes.CDLL(str(library)), "kernel")  # noqa: B009


def run(code, program, arrays, steps=None):
    """Outputs of a kernel for arrays of N rows; NaN where nothing was written. An array of one row serves all."""
    count = max(len(a) for a in arrays)
    dtype = arrays[0].dtype
    outputs = [np.full((count + 1, *port.shape), np.nan, dtype) for port in program.outputs]
    arguments: list[object] = [ctypes.c_longlong(count)]
    for k, (a, port) in enumerate(zip(arrays, program.inputs, strict=True)):
        step = steps[k] if steps else 0 if len(a) == 1 < count else port.size
        arguments += [ctypes.c_void_p(a.ctypes.data), ctypes.c_longlong(step)]
    code(*arguments, *(ctypes.c_void_p(o.ctypes.data) for o in outputs))
    for o in outputs:
        assert np.isnan(o[count]).all(), "written beyond the last sample"
    return [o[:count] for o in outputs]


def states(robot, program, count, seed=1):
    """Random inputs, numbers that float32 has, an array of ``count`` rows each."""
    rng = np.random.default_rng(seed)
    made = [
        robot.random_configuration(rng, count) if p.name == "q" else rng.standard_normal((count, *p.shape))
        for p in program.inputs
    ]
    return [a.astype(np.float32) for a in made]


def assert_same(found, kernel, given, precision):
    """Row by row. Sines differ in the last place, so two results may be apart as far as rounding reaches at that state: that of
    single precision is its distance from double, by the kernels of the processor, and where it happens to be small the
    distance that is usual; that of double is as much smaller as its numbers are finer. Thirty-two such roundings.
    """
    single, double, same = (
        x if isinstance(x, tuple) else (x,)
        for x in (kernel(*(a.astype(t) for a in given)) for t in (np.float32, float, DTYPES[precision]))
    )
    for f, s, d, k in zip(found, single, double, same, strict=True):
        f, s, d, k = (np.asarray(x, float).reshape(len(f), -1) for x in (f, s, d, k))
        size = np.abs(d).max(axis=1)
        apart = np.abs(s - d).max(axis=1) / size
        rounding = np.maximum(apart, max(np.median(apart), EPS["float"])) * EPS[precision] / EPS["float"]
        worst = (np.abs(f - k).max(axis=1) / size / rounding).max()
        assert worst <= 32


CASES = [
    ("panda", "inverse_dynamics", {}),
    ("panda", "forward_dynamics", {}),
    ("panda", "mass_matrix", {}),
    ("panda", "forward_dynamics_derivatives", {}),
    ("ur5", "inverse_dynamics", {"wrenches": ("tool0",), "gravity": "input"}),
    ("ur5", "jacobian", {"frame": "wrist_3_link", "kind": "space"}),
    ("ur5", "inverse_dynamics_derivatives", {}),
    ("quadruped", "inverse_dynamics", {}),
    ("quadruped", "mass_matrix", {}),
    ("quadruped", "forward_dynamics", {}),
    ("cart_pole", "kinetic_energy", {}),
]


@as_cpp
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize(("name", "quantity", "options"), mostly_slow(CASES, 4), ids=[f"{n}-{q}" for n, q, _ in CASES])
def test_the_same_text_as_cpp_gives_what_the_kernels_give(name, quantity, options, precision, bundled, tmp_path):
    robot = bundled(name)
    program, kernel = robot.program(quantity, **options), robot.kernel(quantity, **options)
    code = build(CudaFunction("kernel", program, precision).source, tmp_path)
    for count in (1, 127, 128, 1000):
        given = states(robot, program, count)
        found = run(code, program, [a.astype(DTYPES[precision]) for a in given])
        assert_same(found, kernel, given, precision)


@as_cpp
def test_an_input_may_serve_all_samples_or_be_columns_of_a_wider_array(bundled, tmp_path):
    robot = bundled("panda")
    program, kernel = robot.program("inverse_dynamics"), robot.kernel("inverse_dynamics")
    code = build(CudaFunction("kernel", program).source, tmp_path)
    q, dq, ddq = (a.astype(float) for a in states(robot, program, 300))
    for some in ([q, dq[:1], ddq], [q[:1], dq, ddq[:1]], [q, dq, np.zeros((1, 7))]):
        (found,) = run(code, program, [np.ascontiguousarray(a) for a in some])
        whole = [np.ascontiguousarray(np.broadcast_to(a, (300, 7))) for a in some]
        np.testing.assert_array_equal(found, run(code, program, whole)[0])
    state = np.concatenate([q, dq], axis=1)
    (found,) = run(code, program, [state, state[:, 7:], ddq], steps=[14, 14, 7])
    np.testing.assert_array_equal(found, run(code, program, [q, dq, ddq])[0])
    np.testing.assert_allclose(found, kernel(q, dq, ddq), rtol=1e-10, atol=1e-10)


@as_cpp
@pytest.mark.parametrize("precision", ["double", "float"])
def test_without_sines_results_have_the_bits_of_the_kernels(precision, bundled, tmp_path):
    """The same products are fused, and no others: a floating box has no joint that turns by an angle."""
    robot = bundled("floating_box")
    for quantity in ("inverse_dynamics", "forward_dynamics", "momentum", "jacobian_rate"):
        program, kernel = robot.program(quantity), robot.kernel(quantity)
        assert not {"sin", "cos", "exp"} & set(program.counts())
        (tmp_path / quantity).mkdir()
        code = build(CudaFunction("kernel", program, precision).source, tmp_path / quantity)
        given = [a.astype(DTYPES[precision]) for a in states(robot, program, 200)]
        np.testing.assert_array_equal(run(code, program, given)[0], kernel(*given), err_msg=quantity)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("compiler", "name", "precision"),
    list(zip(COMPILERS, ("floating_box", "planar_2r"), ("float", "double"), strict=False)),
)
def test_every_quantity_compiles_as_cpp_without_a_warning(compiler, name, precision, bundled, tmp_path):
    if not shutil.which(compiler):
        pytest.skip("no C++ compiler: c++ is not on the path")
    robot = bundled(name)
    for quantity, row in QUANTITIES.items():
        options = {"rows": "vx vz"} if "rows" in row.options else {}
        if "constraints" in row.options or (quantity == "christoffel" and robot.nq != robot.nv):
            continue
        source = tmp_path / f"{quantity}.cpp"
        robot.export_cuda([(quantity, options)], source.with_suffix(".cu"), precision=precision)
        source.with_suffix(".cu").rename(source)
        assert source.read_text().isascii()
    command = [compiler, "-std=c++17", *WARNINGS, "-fsyntax-only", *map(str, sorted(tmp_path.glob("*.cpp")))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr


FOR_A_GPU = [
    ("panda", "inverse_dynamics", "float"),
    ("panda", "mass_matrix", "double"),
    ("ur5", "forward_dynamics_derivatives", "double"),
    ("quadruped", "mass_matrix", "float"),
    ("floating_box", "jacobian", "float"),
]


needs_a_gpu = pytest.mark.skipif(
    not (shutil.which("nvcc") and shutil.which("nvidia-smi")), reason="no NVIDIA GPU with a compiler: nvcc, nvidia-smi"
)


@needs_a_gpu
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize(("name", "quantity", "options"), CASES, ids=[f"{n}-{q}" for n, q, _ in CASES])
def test_on_a_gpu_it_gives_what_the_kernels_give(name, quantity, options, precision, bundled, tmp_path):
    robot = bundled(name)
    program, kernel = robot.program(quantity, **options), robot.kernel(quantity, **options)
    library = compile_kernel(CudaFunction("kernel", program, precision).source, "kernel", tmp_path, OPTIONS)
    for count in (1, 127, 128, 1000):
        given = states(robot, program, count)
        found = [np.full((count, *port.shape), np.nan, DTYPES[precision]) for port in program.outputs]
        launch(library, [a.astype(DTYPES[precision]) for a in given], found, count)
        assert_same(found, kernel, given, precision)


@pytest.mark.skipif(not shutil.which("nvcc"), reason="no CUDA compiler: nvcc is not on the path")
@pytest.mark.parametrize(("name", "quantity", "precision"), FOR_A_GPU)
def test_nvcc_compiles_it_without_a_warning(name, quantity, precision, bundled, tmp_path):
    source = tmp_path / "kernel.cu"
    source.write_text(CudaFunction("kernel", bundled(name).program(quantity), precision).source)
    command = ["nvcc", *OPTIONS, "-arch=sm_90", "-Werror", "all-warnings", "-ptx", source, "-o", tmp_path / "k.ptx"]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr
    ptx = (tmp_path / "k.ptx").read_text()
    assert "%tid.x" in ptx and "%ctaid.x" in ptx
    assert_good_assembly(ptx, bundled(name).program(quantity), precision)


def assert_good_assembly(ptx, program, precision):
    """The kernel is there; what is fused is what the program fuses, besides what is within the library's sine and cosine."""
    assert ".visible .entry kernel(" in ptx
    counts = program.counts()
    fused = sum(counts.get(op, 0) for op in ("fma", "fms", "fnma", "fnms"))
    found = len(re.findall(rf"\bfma\.rn\.{'f32' if precision == 'float' else 'f64'}\b", ptx))
    assert found >= fused and (found == fused or counts.get("sin", 0) + counts.get("cos", 0) + counts.get("div", 0))
    if precision == "float":  # no number of double precision outside the reduction of large angles
        assert len(re.findall(r"\b(add|sub|fma)\S*\.f64\b", ptx)) == 0


NVRTC = """
import ctypes, importlib.util, pathlib, sys
folder = pathlib.Path(importlib.util.find_spec("nvidia.cuda_nvrtc").submodule_search_locations[0]) / "lib"
library = ctypes.CDLL(str(next(folder.glob("libnvrtc.so*"))))
program, source = ctypes.c_void_p(), pathlib.Path(sys.argv[1]).read_bytes()
assert library.nvrtcCreateProgram(ctypes.byref(program), source, b"kernel.cu", 0, None, None) == 0
options = (ctypes.c_char_p * (len(sys.argv) - 2))(*(a.encode() for a in sys.argv[2:]))
print(library.nvrtcCompileProgram(program, len(options), options))
"""


@pytest.mark.parametrize("precision", ["double", "float"])
def test_nvrtc_compiles_it(precision, bundled, tmp_path):
    pytest.importorskip("nvidia.cuda_nvrtc", reason="NVRTC is not installed: pip install nvidia-cuda-nvrtc-cu12")
    (source,) = bundled("panda").export_cuda("inverse_dynamics", tmp_path, precision=precision)
    command = [sys.executable, "-c", NVRTC, str(source), "--gpu-architecture=compute_80", *OPTIONS]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == "0"


# ── robot.export_cuda ──


def text_of(robot, quantity, folder, precision="double", **options):
    """The exported source of one quantity."""
    (file,) = robot.export_cuda([(quantity, options)], folder, precision=precision)
    return file.read_text()


def test_the_source_names_robot_and_quantity(bundled, tmp_path):
    text = text_of(bundled("panda"), "inverse_dynamics", tmp_path, "float")
    assert text == text_of(bundled("panda"), "inverse_dynamics", tmp_path, "float")
    assert "inverse_dynamics of the robot panda as a CUDA kernel, numbers of type float" in text
    assert "panda_inverse_dynamics(\n    long long samples,\n    const float *q, long long q_step," in text
    assert "double" not in text.split("*/", 1)[1]
    assert "panda_jacobian_panda_hand_tcp_space" in text_of(
        bundled("panda"), "jacobian", tmp_path, frame="panda_hand_tcp", kind="space"
    )


@pytest.mark.parametrize(
    ("arguments", "options", "error", "words"),
    [
        (("inverse_dynamic",), {}, tw.UnknownNameError, ["inverse_dynamics"]),
        (("mass_matrix", "half"), {}, tw.UnknownNameError, ["half", "double, float"]),
        (("mass_matrix",), {"frame": "tool0"}, tw.KernelError, ["takes no option 'frame'"]),
        (("jacobian",), {"frame": "tool9"}, tw.UnknownNameError, ["tool9", "tool0"]),
        (("constraint_jacobian",), {}, tw.KernelError, ["constraints="]),
    ],
)
def test_a_quantity_without_kernel_is_refused(arguments, options, error, words, bundled, tmp_path):
    name, *precision = arguments
    with pytest.raises(error) as caught:
        text_of(bundled("ur5"), name, tmp_path, *precision, **options)
    assert all(word in str(caught.value) for word in words), caught.value
    assert not list(tmp_path.iterdir())


def test_robots_without_a_program_are_refused(bundled, tmp_path):
    arm = bundled("planar_2r")
    with pytest.raises(tw.KernelError, match="no joint that moves"):
        arm.lock({"joint1": 0.0, "joint2": 0.0}).export_cuda("mass_matrix", tmp_path)
    heavy = arm.with_payload(tw.SpatialInertia.from_com(1e39))
    with pytest.raises(tw.KernelError, match="not a finite float"):
        heavy.export_cuda("mass_matrix", tmp_path, precision="float")
    massless = '<robot name="a"><link name="b"/><link name="c"/><joint name="j" type="continuous"><parent link="b"/><child link="c"/></joint></robot>'
    with pytest.raises(tw.SingularMassMatrixError):
        tw.load(massless).export_cuda("forward_dynamics", tmp_path)
    assert not list(tmp_path.iterdir())


def test_several_kernels_need_a_folder(bundled, tmp_path):
    with pytest.raises(tw.ValueRangeError, match=r"ends in \.cu, for one kernel"):
        bundled("planar_2r").export_cuda(["mass_matrix", "momentum"], tmp_path / "all.cu")
    with pytest.raises(tw.ValueRangeError, match=r"ends in \.cu, for one kernel"):
        bundled("planar_2r").export_cuda("mass_matrix", tmp_path / "M.txt")
