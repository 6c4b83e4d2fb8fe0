"""Where the book's package loses digits and ours must not: each input of ``bench/book_traps.py``, and every angle in 50 digits.

The table of these errors in ``docs/modern-robotics.md``, and that of times, are what ``bench/book.json`` says.
"""

from __future__ import annotations

import importlib
import json
import sys

import mpmath
import numpy as np
import pytest
from places import ROOT

import twistwrench as tw
import twistwrench.modern_robotics as mr
from twistwrench.mechanics.lie import series
from twistwrench.mechanics.lie.half_angles import LARGEST_HALF_TURN

sys.path.insert(0, str(ROOT))
try:
    traps = importlib.import_module("bench.book_traps")
    report = importlib.import_module("bench.book")
finally:
    sys.path.remove(str(ROOT))

each_trap = pytest.mark.parametrize("trap", traps.TRAPS, ids=lambda t: f"{t.function}: {t.what}")


@each_trap
def test_ours_is_right(trap):
    assert trap.error(mr) <= trap.ours


@each_trap
def test_the_books_package_is_not(trap):
    """So that the page stays true: a version that mends one of these fails here, and the page is to be written again."""
    book = pytest.importorskip("modern_robotics", reason="the book's package is not installed")
    assert not trap.error(book) < trap.theirs  # NaN, no answer, is not less


ANGLES = [
    *(0.0, 1e-300, 1e-160, 1e-20, 1e-12, 1e-9, 1e-8, 9e-7, 1.1e-6, 1e-5, 1e-3, 0.1, 1.0, 2.0),
    *(np.nextafter(series.SWITCH, 0.0), series.SWITCH, 2.9),
    *(np.pi - 1e-3, np.pi - 1e-6, np.pi - 1e-7, np.pi - 2e-8, np.pi - 1e-9, np.nextafter(np.pi, 0.0)),
]
AXES = [(0, -1, 0), (0.6, -0.48, 0.64), (1e-5, 1e-5, -1)]
FEW = 1.5e-15  # a dozen roundings of numbers up to π


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("angle", ANGLES, ids=lambda a: f"{a:.17g}")
def test_exponentials_and_logarithms_of_single_motions_are_right_to_a_few_ulp(axis, angle):
    w = np.array(axis, float) / np.linalg.norm(axis) * angle
    V = np.r_[w, 0.28, -0.96, 0.1]
    with mpmath.workdps(50):
        R, T = traps.exact(traps.hat(w)), traps.exact(traps.hat6(V))
        assert traps.off(mr.MatrixExp3(traps.rounded(traps.hat(w))), R) <= FEW
        assert traps.off(mr.MatrixExp6(traps.rounded(traps.hat6(V))), T) <= FEW
        assert traps.off(mr.MatrixLog3(traps.rounded(R)), traps.hat(w)) <= FEW
        assert traps.off(mr.MatrixLog6(traps.rounded(T)), traps.hat6(V)) <= FEW


def test_turns_beyond_what_is_compiled_and_nan():
    far = np.array([0.0, 0.0, 2.0 * LARGEST_HALF_TURN])
    assert np.array_equal(mr.MatrixExp3(tw.so3.hat(far)), tw.so3.exp(far))
    V = np.r_[far, 1.0, 2.0, 3.0]
    assert np.array_equal(mr.MatrixExp6(tw.se3.hat(V)), tw.se3.exp(V))
    assert np.isnan(mr.MatrixExp3(np.full((3, 3), np.nan))).all()


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_lengths_whose_squares_are_no_numbers_are_lengths(size):
    """By 3² + 4² = 5², for one vector and for rows of them."""
    for vectors in (size * np.array([3.0, 0.0, 4.0]), size * np.array([[3.0, 0.0, 4.0]])):
        axis, angle = mr.AxisAng3(vectors)
        np.testing.assert_allclose(np.ravel(axis), [0.6, 0.0, 0.8], rtol=FEW)
        np.testing.assert_allclose(angle, 5.0 * size, rtol=FEW)


def test_single_and_batched_motions_agree_in_float32_too():
    rng = np.random.default_rng(0)
    V = rng.standard_normal((20, 6)).astype(np.float32)
    batch = mr.MatrixExp6(mr.VecTose3(V))
    rows = np.array([mr.MatrixExp6(mr.VecTose3(row)) for row in V])
    assert batch.dtype == rows.dtype == mr.MatrixLog6(rows[0]).dtype == np.float32
    assert np.abs(batch - rows).max() <= 1e-6


@pytest.mark.parametrize("axis", [*np.eye(3), (0.6, 0, -0.8), (-0.6, 0.8, 0), (0.48, 0.6, -0.64)], ids=str)
def test_of_the_two_logarithms_of_a_half_turn_the_books_is_returned(axis):
    a = np.array(axis)
    R = 2.0 * np.outer(a, a) - np.eye(3)
    w = mr.so3ToVec(mr.MatrixLog3(R))
    assert (
        np.abs(w * np.sign(w @ a) - np.pi * a).max() <= 2e-8
    )  # R is a half turn to rounding: its square root in the axis
    assert w[np.nonzero(np.abs(w) > 1e-3)[0][-1]] > 0
    assert np.abs(w - mr.so3ToVec(mr.MatrixLog3(R[None]))[0]).max() <= FEW


# ── the page ──


def test_the_tables_of_the_page_are_what_was_measured():
    results = json.loads((ROOT / "bench" / "book.json").read_text("utf-8"))
    page = (ROOT / "docs" / "modern-robotics.md").read_text("utf-8")
    assert list(results["functions"]) == [case.function for case in report.CASES]
    assert set(results["functions"]) == set(mr.__all__)
    assert f"The {len(mr.__all__)} functions" in page
    assert report.with_tables(page, results) == page, "run: python -m bench.book --render"
    assert report.report(results) == (ROOT / "bench" / "BOOK.md").read_text("utf-8")
    assert [(t["function"], t["what"]) for t in results["traps"]] == [(t.function, t.what) for t in traps.TRAPS]
