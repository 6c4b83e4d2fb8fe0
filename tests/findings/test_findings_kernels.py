"""Kernels and speed: stores past the caches, interrupts, small stacks, kept robots, derivatives of derivatives in JAX."""

from __future__ import annotations

import time

import numpy as np
import pytest

import twistwrench as tw


def derivatives_of_a_quadruped(count: int):
    """The kernel of ∂tau, so many states, and arrays for its results as NumPy makes them."""
    robot = tw.robots.quadruped()
    kernel = robot.kernel("inverse_dynamics_derivatives")
    rng = np.random.default_rng(68)
    q = robot.random_configuration(rng=1, size=count)
    given = (q, *(rng.normal(size=(count, robot.nv)) for _ in range(2)))
    return kernel, given, tuple(np.empty((count, robot.nv, robot.nv)) for _ in range(2))


def test_finding_68_results_beyond_the_caches_have_the_same_bits():
    kernel, given, out = derivatives_of_a_quadruped(4096)  # 21 MB
    assert sum(x.nbytes for x in out) > 1 << 24
    kernel(*given, out=out)
    few = slice(4000, 4064)
    for whole, part in zip(out, kernel(*(x[few] for x in given)), strict=True):
        np.testing.assert_array_equal(whole[few], part)


@pytest.mark.slow
def test_finding_68_a_state_of_a_large_batch_takes_about_what_one_of_a_small_batch_takes():
    """The least of many rounds: other programs may have the caches at any time."""
    cases = {count: derivatives_of_a_quadruped(count) for count in (512, 4096)}
    taken = dict.fromkeys(cases, np.inf)
    for _ in range(60):
        for count, (kernel, given, out) in cases.items():
            for _ in range(2):
                began = time.thread_time_ns()
                kernel(*given, out=out)
                taken[count] = min(taken[count], (time.thread_time_ns() - began) / count)
    assert taken[4096] < 1.8 * taken[512], taken
