"""How numbers, units and verdicts are printed: what is read back is what was meant, to the digits that are promised."""

from __future__ import annotations

import io

import numpy as np
import pytest

from twistwrench.core.answers.blocks import Bar, Table, word_cell, words
from twistwrench.core.answers.terminal import console, renderable
from twistwrench.core.colours import terminal_style
from twistwrench.core.numbers import deviation, estimate, number, torque, without_noise
from twistwrench.core.verdict import Word
from twistwrench.mechanics.joints.units import unit_of


@pytest.mark.parametrize("digits", [3, 4, 6])
def test_numbers_below_a_million_have_no_exponent_and_are_right_to_their_digits(digits):
    edges = 10.0 ** np.arange(-3, 6)
    for x in np.outer(edges, [1.0, 0.99999, 0.9999949, 0.9995, 0.99951, 1.00049, 4.44449, 9.9996]).ravel():
        text = number(x, digits)
        assert "e" not in text
        assert abs(float(text) - x) <= max(0.5 * 10.0 ** (np.floor(np.log10(x)) + 1 - digits), 1e-15) * (1 + 1e-9)


@pytest.mark.parametrize("x", [0.00049, 0.0005, 0.99996, 9.9996, 62.2001, 99.996, 1234.56, 43210.9])
def test_torques_are_right_to_four_digits_or_three_decimals(x):
    for sign in (1, -1):
        least = 0.5 * max(10.0 ** (np.floor(np.log10(x)) - 3), 1e-3)
        assert abs(float(torque(sign * x)) - sign * x) <= least * (1 + 1e-9)
        assert len(torque(sign * x).partition(".")[2]) <= 3


@pytest.mark.parametrize("sigma", [0.000123, 0.0099, 0.00996, 0.0996, 0.1, 0.996, 1.0, 9.96, 99.6, 123.0])
def test_an_estimate_ends_where_its_deviation_does_which_has_two_digits(sigma):
    for value in (2.00345, -3452.0, 0.0):
        said, off = estimate(value, sigma)
        assert len(said.partition(".")[2]) == len(off.partition(".")[2])
        assert float(off) == float(f"{sigma:.1e}")
        assert sigma > 99 or len(off.replace(".", "").lstrip("0")) == 2
        assert abs(float(said) - value) <= 0.05 * sigma * 1.1
    assert float(deviation(sigma, 9)) == float(f"{sigma:.1e}")


def test_what_is_left_of_noise_has_no_sign():
    assert not np.signbit(without_noise(np.array([-0.0, -1e-17, 1.0]))).any()


@pytest.mark.parametrize("turns", [True, False])
def test_rates_are_per_second_and_torque_times_rate_is_power(turns):
    q = unit_of("q", turns)
    assert unit_of("dq", turns) == f"{q}/s"
    assert unit_of("ddq", turns) == f"{q}/s²"
    assert (unit_of("tau", turns), unit_of("dq", turns)) in {("N m", "rad/s"), ("N", "m/s")}


def test_a_bar_is_off_by_half_a_character_at_most():
    for share in np.linspace(0.0, 1.0, 101):
        assert abs(len(Bar(share).pieces[0][0]) - 12 * share) <= 0.5 + 1e-12
    assert Bar(7.0).pieces[0][0] == 12 * "━"


def test_verdicts_that_differ_have_colours_that_differ_and_only_ok_is_green():
    green, doubt, bad = (word_cell(word).pieces[0][1] for word in (Word.OK, Word.UNSURE, Word.OVER_LIMIT))
    assert len({green, doubt, bad}) == 3
    assert terminal_style(green) == "bold green" and terminal_style(bad) == "bold red"
    assert word_cell(Word.DONE).pieces[0][1] == "strong"


def test_counts_and_names_that_do_not_fold_stand_in_full():
    names, long = words("name", ["a_name_that_is_long", "b"], fold=False), " ".join(["word"] * 30)
    table = Table("", names, words("words", [long, 12345678]))
    printer = console()
    printer.width, printer.file = 40, io.StringIO()
    printer.print(renderable(table, printer))
    assert "a_name_that_is_long" in printer.file.getvalue() and "12345678" in printer.file.getvalue()
