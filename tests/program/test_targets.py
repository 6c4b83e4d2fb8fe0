"""Every target computes what the algorithm itself computes on plain floats: every quantity, robot and batch shape.

The tolerance is not a guess but a running error analysis (Higham, Accuracy and Stability of Numerical Algorithms, section
3.3): beside each value of a program goes a bound of its rounding error, to first order in the unit roundoff u.
"""

from __future__ import annotations

import functools
import warnings

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.compiler.ir.program import FUSED, Program
from twistwrench.compiler.lowering.numpy_kernels import NumpyKernel
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.robot import Robot
from twistwrench.robot.quantities import QUANTITIES

BATCHES = [(), (1,), (3,), (4099,), (2, 0, 5), (2, 3)]
STATES = 3
"""States the reference is computed for; batches are made of them, in turn."""


def every_joint() -> Robot:
    """A tree with a joint of each kind, a mimic, friction, an offset pose everywhere and inertias without symmetry."""
    rng = np.random.default_rng(7)
    builder = ModelBuilder("every_joint")
    builder.add_link("base")
    joints = [
        ("base", "turning", "revolute", {"damping": 0.3, "friction": 0.2}),
        ("turning", "screwing", "helical", {"pitch": 0.15}),
        ("screwing", "gliding", "planar", {}),
        ("gliding", "sliding", "prismatic", {"damping": 1.5}),
        ("sliding", "following", "revolute", {"mimic": ("to_turning", -0.7, 0.3)}),
        ("turning", "branching", "continuous", {"friction": 0.1}),
        ("branching", "flying", "floating", {}),
        ("base", "rolling", "ball", {}),
    ]
    for parent, child, kind, options in joints:
        points = rng.normal(scale=0.3, size=(6, 3))
        bodies = [tw.SpatialInertia.from_com(m, r) for m, r in zip(rng.uniform(0.2, 1, 6), points, strict=True)]
        builder.add_link(child, sum(bodies[1:], bodies[0]))
        axis = {} if kind == "floating" else {"axis": rng.normal(size=3)}
        builder.add_joint(f"to_{child}", kind, parent, child, placement=se3.exp(rng.normal(size=6)), **axis, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Robot(builder.build(gravity=(0.3, -1.0, -9.7)))


ROBOTS = {
    "planar_2r": tw.robots.planar_2r,
    "cart_pole": tw.robots.cart_pole,
    "floating_box": tw.robots.floating_box,
    "quadruped": tw.robots.quadruped,
    "every_joint": every_joint,
}
KINDS = ("frame_acceleration", "frame_velocity", "jacobian", "jacobian_rate")
NAMES = [name for name, quantity in QUANTITIES.items() if not {"constraints", "rows"} & {*quantity.options}]
"""All but those that are singular at some states: tests/robot/test_constraints.py and tests/robot/test_task_space.py compare them."""
VARIANTS = [
    *((name, {"kind": kind}) for name in KINDS for kind in ("space", "world_aligned")),
    *((name, {"wrenches": 2}) for name in NAMES if "wrenches" in QUANTITIES[name].options),
]


@functools.cache
def robot_named(name: str) -> Robot:
    return ROBOTS[name]()


def cases():
    for robot in ROBOTS:
        rates = robot in ("planar_2r", "cart_pole")  # only there are velocities the rates of coordinates
        for name in NAMES:
            if name != "christoffel" or rates:
                # what long programs do, register pressure and sections, shows in a few of the quadruped's
                long = robot == "every_joint" and name.endswith("_derivatives")
                long |= robot == "quadruped" and name not in (
                    "inverse_dynamics",
                    "forward_dynamics",
                    "jacobian_derivative",
                )
                slow = long or (robot == "cart_pole" and name != "christoffel")  # its joints are two of every_joint's
                yield pytest.param(robot, name, {}, id=f"{robot}-{name}", marks=pytest.mark.slow if slow else ())
    for name, options in VARIANTS:
        marks = pytest.mark.slow if name == "forward_dynamics_derivatives" else ()
        yield pytest.param(
            "every_joint", name, options, id=f"every_joint-{name}-{next(iter(options.values()))}", marks=marks
        )


def options_of(robot: Robot, name: str, options: dict) -> dict:
    """Name the frames, for a robot may have no single tip."""
    full = dict(options)
    if "frame" in QUANTITIES[name].options:
        full["frame"] = robot.frame_names[-1]
    if "wrenches" in full:
        full["wrenches"] = robot.frame_names[-full["wrenches"] :]
    return full


def states(robot: Robot, program: Program) -> list[np.ndarray]:
    """Inputs of float32 precision, so that they are the same numbers for every target."""
    rng = np.random.default_rng(11)
    made = [
        robot.random_configuration(rng, STATES) if port.name == "q" else rng.normal(size=(STATES, *port.shape))
        for port in program.inputs
    ]
    return [a.astype(np.float32).astype(float) for a in made]


def rounding(program: Program, inputs: list[np.ndarray], u: float) -> tuple[np.ndarray, np.ndarray]:
    """Running bound of the rounding error of each result, and the largest value met, or 1; (STATES, nresults), ().

    Each operation adds u of its result, sine and cosine 2 u (tests/program/test_sincos.py), a constant the rounding of itself.
    A fused product may also be rounded twice, so it counts twice.
    """
    columns = np.concatenate([a.reshape(STATES, -1) for a in inputs], axis=1).T
    values, bounds = [], []
    for op, args, number in program.instructions:
        a, e = [values[k] for k in args], [bounds[k] for k in args]
        if op == "input":
            value, bound = columns[int(number)], np.zeros(STATES)
        elif op == "const":
            value, bound = np.full(STATES, number), np.full(STATES, abs(number) * u)
        elif op in ("add", "sub"):
            value, bound = (a[0] + a[1] if op == "add" else a[0] - a[1]), e[0] + e[1]
        elif op == "mul" or op in FUSED:
            value, bound = a[0] * a[1], abs(a[0]) * e[1] + abs(a[1]) * e[0]
            if op in FUSED:
                bound = bound + u * abs(value) + e[2]
                value = FUSED[op][0] * value + FUSED[op][1] * a[2]
        elif op == "div":
            value = a[0] / a[1]
            bound = (e[0] + abs(value) * e[1]) / abs(a[1])
        elif op == "sqrt":
            value = np.sqrt(a[0])
            bound = e[0] / (2 * value)
        elif op in ("sin", "cos"):
            value, bound = getattr(np, op)(a[0]), e[0] + 2 * u
        elif op in ("min", "max"):
            value, bound = getattr(np, f"{op}imum")(*a), np.maximum(*e)
        else:
            value, bound = {"neg": np.negative, "sign": np.sign}[op](a[0]), (e[0] if op == "neg" else np.zeros(STATES))
        values.append(value)
        bounds.append(bound + u * abs(value) * (op not in ("input", "const", "neg", "sign")))
    return np.stack([bounds[k] for k in program.results], axis=1), max(1.0, np.max(np.abs(values)))


def flat(results, batch: tuple[int, ...]) -> np.ndarray:
    """One array or several, side by side; (*batch, nresults)."""
    arrays = results if isinstance(results, tuple) else (results,)
    sizes = [int(np.prod(a.shape[len(batch) :])) for a in map(np.asarray, arrays)]
    return np.concatenate([np.reshape(a, (*batch, n)) for a, n in zip(arrays, sizes, strict=True)], axis=-1)


@pytest.mark.parametrize(("robot_name", "name", "options"), mostly_slow(cases(), 3))
def test_targets_agree_with_the_algorithm(robot_name, name, options):
    robot = robot_named(robot_name)
    options = options_of(robot, name, options)
    kernel, program = robot.kernel(name, **options), robot.program(name, **options)
    oracle = NumpyKernel(program, name, "")
    inputs = states(robot, program)
    reference = np.stack([flat(robot.reference(name, *(a[k] for a in inputs), **options), ()) for k in range(STATES)])
    shapes = [port.shape for port in program.outputs]
    twice = name == "forward_dynamics_derivatives"
    conditions = max(np.linalg.cond(robot.reference("mass_matrix", q)) for q in inputs[0]) if twice else 1.0
    for dtype, targets in ((np.float64, (kernel, oracle)), (np.float32, (kernel, oracle))):
        bound, largest = rounding(program, inputs, np.finfo(dtype).eps / 2)
        # Twice the bound of first order, and twice for a target that rounds in its own way. The reference, in double, also
        # computes what cancels and vanishes in a program: a hundred roundings of the largest value met. The last line
        # shows that all this is not an empty promise: less than 1e4 roundings of that value, times the condition of M where
        # its inverse comes twice.
        tolerance = 4 * bound + 100 * np.finfo(float).eps * largest
        assert tolerance.max(initial=0.0) <= 1e4 * conditions * np.finfo(dtype).eps * largest
        for batch in BATCHES:
            turn = np.arange(np.prod(batch, dtype=int)).reshape(batch) % STATES
            for target in targets:
                got = target(*(a[turn].astype(dtype) for a in inputs))
                arrays = got if isinstance(got, tuple) else (got,)
                assert [a.shape for a in arrays] == [(*batch, *shape) for shape in shapes]
                assert {a.dtype for a in arrays} == {np.dtype(dtype)}
                assert np.all(np.abs(flat(got, batch) - reference[turn]) <= tolerance[turn])
