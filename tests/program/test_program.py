"""Tracing: what folds, what fuses, and that a program means what its author wrote."""

from __future__ import annotations

import operator
import os
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twistwrench import robots
from twistwrench.compiler.ir.program import FUSED, Program
from twistwrench.compiler.ir.tracer import Trace, trace
from twistwrench.compiler.lowering.numpy_kernels import CHUNK, NumpyKernel


def traced(function, inputs="xyzw") -> Program:
    """The program of a function of numbers, one input a letter."""
    return trace(function, [(letter, ()) for letter in inputs], ["result"])


SAME = {
    "x + 0": (lambda x, y: x + 0, lambda x, y: x),
    "0 + x": (lambda x, y: 0.0 + x, lambda x, y: x),
    "x + (-0.0)": (lambda x, y: x + -0.0, lambda x, y: x),
    "x - 0": (lambda x, y: x - 0, lambda x, y: x),
    "0 - x": (lambda x, y: 0 - x, lambda x, y: -x),
    "x · 1": (lambda x, y: x * 1, lambda x, y: x),
    "1 · x": (lambda x, y: 1.0 * x, lambda x, y: x),
    "x / 1": (lambda x, y: x / 1, lambda x, y: x),
    "x · (-1)": (lambda x, y: x * -1, lambda x, y: -x),
    "x · 0": (lambda x, y: x * 0, lambda x, y: x - x),
    "0 / x": (lambda x, y: 0 / x, lambda x, y: x - x),
    "−(−x)": (lambda x, y: operator.neg(-x), lambda x, y: x),
    "sums commute": (lambda x, y: x + y, lambda x, y: y + x),
    "products commute": (lambda x, y: x * y, lambda x, y: y * x),
    "x + (-y)": (lambda x, y: x + (-y), lambda x, y: x - y),
    "(-x) + y": (lambda x, y: (-x) + y, lambda x, y: y - x),
    "x - (-y)": (lambda x, y: x - (-y), lambda x, y: x + y),
    "-(x - y)": (lambda x, y: -(x - y), lambda x, y: y - x),
    "(-x) y": (lambda x, y: (-x) * y, lambda x, y: -(x * y)),
    "(-x)(-y)": (lambda x, y: (-x) * (-y), lambda x, y: x * y),
    "(-x) / (-y)": (lambda x, y: (-x) / (-y), lambda x, y: x / y),
    "constants merge": (lambda x, y: 2 * (3 * x), lambda x, y: 6 * x),
    "constants merge through a negation": (lambda x, y: (-2 * x) * -0.5, lambda x, y: x),
    "division by a constant": (lambda x, y: x / 4, lambda x, y: 0.25 * x),
    "sin(-x)": (lambda x, y: np.sin(-x), lambda x, y: -np.sin(x)),
    "cos(-x)": (lambda x, y: np.cos(-x), lambda x, y: np.cos(x)),
    "sign(-x)": (lambda x, y: (-x).sign(), lambda x, y: -(x.sign())),
    "common subexpressions": (lambda x, y: (x + y) * (x + y), lambda x, y: (y + x) * (x + y)),
}


@pytest.mark.parametrize("law", SAME)
def test_both_sides_of_a_folding_law_are_the_same_object(law):
    owner = Trace()
    x, y = owner.input(0), owner.input(1)
    left, right = SAME[law]
    assert left(x, y) is right(x, y)


@pytest.mark.parametrize(
    ("function", "value"),
    [
        (lambda c: c(2) + c(3), 5.0),
        (lambda c: c(2) - c(3), -1.0),
        (lambda c: c(2) * c(3), 6.0),
        (lambda c: c(2) / c(4), 0.5),
        (lambda c: np.sqrt(c(9)), 3.0),
        (lambda c: np.sin(c(0)), 0.0),
        (lambda c: np.cos(c(0)), 1.0),
        (lambda c: c(-7).sign(), -1.0),
        (lambda c: -c(0), 0.0),
    ],
)
def test_constants_fold(function, value):
    folded = function(Trace().constant)
    assert folded.op == "const"
    assert folded.value == value
    assert not np.signbit(folded.value) or value < 0  # there is no -0.0


def test_different_expressions_are_different_objects():
    owner = Trace()
    x, y = owner.input(0), owner.input(1)
    assert len({id(e) for e in (x + y, x - y, y - x, x * y, x / y, y / x, x, y, np.sin(x), np.cos(x))}) == 10


# ── what a program means: exact arithmetic on both sides, so any wrong fold shows ──


def value(program: Program, inputs: list[Fraction]) -> Fraction:
    """Run a program of sums and products on exact numbers."""
    made: list[Fraction] = []
    for op, args, number in program.instructions:
        a = [made[k] for k in args]
        if op in FUSED:
            product, addend = FUSED[op]
            made.append(product * a[0] * a[1] + addend * a[2])
        else:
            made.append(
                {
                    "const": lambda a, n: Fraction(n), "input": lambda a, n: inputs[int(n)], "neg": lambda a, n: -a[0],
                    "add": lambda a, n: a[0] + a[1], "sub": lambda a, n: a[0] - a[1], "mul": lambda a, n: a[0] * a[1],
                }[op](a, number)
            )  # fmt: skip
    return made[program.results[0]]


LEAVES = st.sampled_from(["x", "y", "z", 0.0, 1.0, -1.0, 2.0, -0.5])  # dyadic, so that folded constants are exact
TREES = st.recursive(
    LEAVES,
    lambda t: st.one_of(st.tuples(st.just("neg"), t), st.tuples(st.sampled_from(["add", "sub", "mul"]), t, t)),
    max_leaves=25,
)


def evaluate(tree, leaf):
    if not isinstance(tree, tuple):
        return leaf(tree)
    op, *rest = tree
    a = [evaluate(r, leaf) for r in rest]
    return -a[0] if op == "neg" else a[0] + a[1] if op == "add" else a[0] - a[1] if op == "sub" else a[0] * a[1]


@settings(deadline=None)
@given(TREES)
def test_a_program_computes_what_was_written(tree):
    program = traced(
        lambda *v: evaluate(tree, lambda t: v["xyz".index(t)] if t in ("x", "y", "z") else v[0] * 0 + t), "xyz"
    )
    at = [Fraction(7, 3), Fraction(-11, 5), Fraction(13, 17)]
    expected = evaluate(tree, lambda t: at["xyz".index(t)] if t in ("x", "y", "z") else Fraction(t))
    assert value(program, at) == expected


# ── fusing ──


@pytest.mark.parametrize(
    ("function", "counts"),
    [
        (lambda x, y, z, w: x * y + z, {"fma": 1}),
        (lambda x, y, z, w: z + x * y, {"fma": 1}),
        (lambda x, y, z, w: x * y - z, {"fms": 1}),
        (lambda x, y, z, w: z - x * y, {"fnma": 1}),
        (lambda x, y, z, w: x * y + z * w, {"mul": 1, "fma": 1}),
        (lambda x, y, z, w: 2 * x + y, {"fma": 1}),
        (lambda x, y, z, w: x * y * z, {"mul": 2}),
        (lambda x, y, z, w: (x * y) / z, {"mul": 1, "div": 1}),
    ],
)
def test_a_sum_takes_in_a_product(function, counts):
    assert traced(function).counts() == counts


@pytest.mark.parametrize(
    "function",
    [
        lambda x, y, z, w: np.array([x * y + z, x * y + w]),  # the product is used twice
        lambda x, y, z, w: np.array([x * y + z, x * y]),  # the product is itself a result
        lambda x, y, z, w: (x * y + z) / (x * y),
    ],
)
def test_a_product_used_more_than_once_is_made_once_and_not_fused(function):
    counts = traced(function).counts()
    assert counts["mul"] == 1
    assert not counts.keys() & FUSED.keys()


# ── counts, digests, limits ──


def test_counts_and_flops():
    program = traced(lambda x, y, z, w: np.array([x * y + z, np.sin(x) - w, np.sqrt(x) / y, -z, 3.0]))
    assert program.counts() == {"fma": 1, "sin": 1, "sub": 1, "sqrt": 1, "div": 1, "neg": 1}
    assert program.flops == 2 + 1 + 1
    assert program.multiplications == 1
    assert program.signature == "(),(),(),()->(5)"


def digest_of_arm() -> str:
    return robots.planar_2r().program("forward_dynamics").digest


@pytest.mark.parametrize("seed", ["0", "1", "123"])
def test_digest_is_the_same_in_every_process(seed):
    code = "from twistwrench import robots; print(robots.planar_2r().program('forward_dynamics').digest)"
    env = {**os.environ, "PYTHONHASHSEED": seed}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == digest_of_arm()


def test_different_programs_have_different_digests():
    functions = [
        lambda x, y: x + y, lambda x, y: x - y, lambda x, y: y - x, lambda x, y: x * y, lambda x, y: 2.0 * x,
        lambda x, y: 2.0000000000000004 * x, lambda x, y: np.array([x, y]), lambda x, y: np.array([y, x]),
        lambda x, y: np.array([[x], [y]]), lambda x, y: np.array([[x, y]]),
    ]  # fmt: skip
    digests = {traced(f, "xy").digest for f in functions}
    assert len(digests) == len(functions)


def test_mixing_traces_is_refused():
    with pytest.raises(ValueError, match="another trace"):
        Trace().input(0) + Trace().input(0)


def test_a_traced_value_has_no_truth():
    x = Trace().input(0)
    for question in (lambda: bool(x), lambda: x and 1, lambda: x < 1, lambda: float(x)):
        with pytest.raises(TypeError):
            question()
    with pytest.raises(TypeError, match="must not branch"):
        traced(lambda x, y, z, w: x if x else y)


def test_deep_programs_do_not_overflow_the_stack():
    depth = 100_000

    def chain(x, y):
        total = x
        for _ in range(depth):
            total = total + y
        return total

    program = traced(chain, "xy")
    assert program.counts() == {"add": depth}
    # Sums of 1 are exact up to 2^53.
    assert NumpyKernel(program, "chain", "")(2.0, 1.0) == depth + 2.0


@pytest.mark.parametrize("samples", [CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 3])
def test_numpy_takes_batches_of_any_length(samples):
    """In parts that fit the caches; no sample is left out between them."""
    x = np.arange(2.0 * samples).reshape(samples, 2)
    found = NumpyKernel(trace(lambda a: a * a[::-1] + 1.0, [("a", (2,))], ["b"]), "turned", "")(x)
    assert np.array_equal(found, x * x[:, ::-1] + 1.0)
