"""Motion files: what is read, what is refused and how it is said."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_fixtures import GOOD, read

from twistwrench import robots
from twistwrench.core.errors import NotFoundError, TrajectoryError
from twistwrench.formats import load_model
from twistwrench.motion.coordinates import Coordinates
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.log_table import excerpts
from twistwrench.motion.motion_log import MotionLog
from twistwrench.motion.readers import csv_reader as csv_module
from twistwrench.motion.readers.csv_reader import Dialect, parse_block

pytest_plugins = ("motion_fixtures",)

# ── numbers ──


def table_text(table, form):
    return "".join(",".join(form % x for x in row) + "\n" for row in table.tolist()).encode()


@pytest.mark.parametrize("form", ["%.0f", "%.3f", "%.6f", "%.9f", "%.15f", "%r", "%.6e", "%+.3f", "  %.2f ", "%g"])
def test_numbers_are_those_of_python(form):
    rng = np.random.default_rng(1)
    table = rng.normal(size=(500, 3)) * 10.0 ** rng.integers(-3, 4, size=(500, 3))
    text = table_text(table, form)
    expected = np.array([[float(x) for x in line.split(b",")] for line in text.splitlines()])
    found = parse_block(text, Dialect(","), 3, range(3))
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


@given(st.lists(st.decimals(-(10**9), 10**9, places=6), min_size=1, max_size=60))
@settings(deadline=None, max_examples=40)
def test_every_decimal_is_rounded_correctly(values):
    text = "".join(f"{x}\n" for x in values).encode()
    np.testing.assert_array_equal(parse_block(text, Dialect(","), 1, [0])[:, 0], [float(x) for x in values])


@pytest.mark.parametrize("wrong", ["-", ".", "-.", "1.2.3", "", "--1", "1-2", "0x10", "1 2", "a", "1.5a", "½", "1_0.5"])
def test_what_is_no_number_is_never_read_as_one(wrong):
    good = b"1.5,-2.25\n" * 50
    assert parse_block(good + f"{wrong},0.5\n".encode() + good, Dialect(","), 2, range(2)) is None


# ── headers ──


@pytest.mark.parametrize(
    "header, order",
    [
        ("time,joint1,joint2", [0, 1]),
        ("joint2,t,joint1", [2, 0]),
        ('\ufeff# made by hand\r\n\r\n# twice\r\nTIME, joint1 ,"joint2"', [0, 1]),
    ],
)
def test_columns_come_in_any_order(model, write, header, order):
    first, second = "0.5,1,2", "0.75,3,4"
    if header.startswith("joint2"):
        first, second = "2,0.5,1", "4,0.75,3"
    motion = read(write(f"{header}\r\n{first}\r\n{second}"), model)
    np.testing.assert_array_equal(motion.time, [0.5, 0.75])
    np.testing.assert_array_equal(motion.q, [[1, 2], [3, 4]])
    assert motion.dq is None
    assert motion.ddq is None


def test_rates_are_read_where_given_and_degrees_are_turned_into_radians(model, write):
    path = write("time,joint1,joint2,joint2.vel,joint1.vel,joint1.acc,joint2.acc\n0,90,180,10,20,30,40\n")
    motion = read(path, model, degrees=True)
    np.testing.assert_allclose(motion.q, [[np.pi / 2, np.pi]])
    np.testing.assert_allclose(np.degrees(motion.dq), [[20, 10]])
    np.testing.assert_allclose(np.degrees(motion.ddq), [[30, 40]])


def test_lengths_are_not_taken_for_degrees(write):
    model = load_model(robots.path_of("cart_pole"))
    names = Coordinates.from_model(model).names
    motion = read(write(f"time,{','.join(names)}\n0,180,180\n"), model, degrees=True)
    assert sorted(motion.q[0]) == pytest.approx([np.pi, 180])


# ── refusals ──

REFUSED = {
    "empty": ("", "empty"),
    "comments only": ("# nothing\n", "empty"),
    "no rows": ("time,joint1,joint2\n", "no rows after the header of line 1"),
    "no time": ("joint1,joint2\n0,0\n", "no time column"),
    "two times": ("t,time,joint1,joint2\n0,0,0,0\n", "two time columns"),
    "no header": ("0,0.1,0.2\n", "header is missing"),
    "semicolons below": ("time,joint1,joint2\n0;1;2\n", "line 2: semicolons"),
    "missing joint": ("time,joint1\n0,1\n", "no column for joint2. Expected: joint1, joint2"),
    "unknown joint": ("time,joint1,elbow\n0,1,2\n", "no column for joint2. Expected"),
    "misspelt rate": ("time,joint1,joint2,joint1.vel,joint_2.vel\n0,1,2,3,4\n", "Did you mean 'joint2.vel'"),
    "misspelt joint": ("time,joint1,joint_2\n0,1,2\n", "Did you mean 'joint2'"),
    "repeated joint": ("time,joint1,joint2,joint1\n0,1,2,3\n", "'joint1' is there 2 times"),
    "half of the rates": ("time,joint1,joint2,joint1.vel\n0,1,2,3\n", "no column joint2.vel"),
    "decimal comma": ("time,joint1,joint2\n0,0,0,5,1,2\n", "decimal marks"),
    "short row": (GOOD + "0.2,1\n", "line 4 has 2 values, and the header names 3 columns"),
    "long row": (GOOD + "0.2,1,2,3\n", "line 4 has 4 values"),
    "blank value": (GOOD + "0.2,,1\n", "line 4, column 'joint1' is blank"),
    "no number": (GOOD + "0.2,1,x7\n", "line 4, column 'joint2' is 'x7', which is not a number"),
    "quoted comma": (GOOD + '0.2,"0,5",1\n', "line 4, column 'joint1' is '0,5'. Where commas separate values"),
    "nan": (GOOD + "0.2,nan,1\n", "line 4, column 'joint1' is 'nan'"),
    "infinite": (GOOD + "0.2,1,-inf\n", "line 4, column 'joint2' is '-inf'"),
    "overflow": (GOOD + "0.2,1,1e999\n", "line 4, column 'joint2' is '1e999'"),
    "time runs back": (GOOD + "0.05,1,2\n", "line 4, column 'time': time 0.05 comes before 0.1"),
    "underscore": (GOOD + "1_0,1,2\n", "line 4, column 'time' is '1_0'"),
    "not text": (b"t\xffi\xfem", "line 1 is not UTF-8"),
    "binary below": (b"time,joint1,joint2\n\x00\x01\x02\xff\n", "line 2 is not UTF-8"),
    "a NUL": (GOOD.encode() + b"0.2,1,\x002\n", "line 4 has a control character"),
    "a unit separator": (GOOD.encode() + b"0.2,\x1f1,2\n", "line 4 has a control character"),
    "a lone quote": (GOOD + '0.2,"1,2\n', "line 4 has a quote that never ends"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_files_are_refused_by_line_and_column(model, write, case):
    text, said = REFUSED[case]
    path = write(text)
    with pytest.raises(TrajectoryError, match=re.escape(said)) as caught:
        read(path, model)
    assert "motion.csv" in str(caught.value)
    assert str(caught.value).count(".") >= 2, "says what to try after what is wrong"


def test_lines_are_counted_across_blocks(model, write, monkeypatch):
    monkeypatch.setattr(csv_module, "_BLOCK_SIZE", 64)
    rows = [f"{0.01 * k:.2f},0.1,0.2\n" for k in range(300)]
    rows[251] = "2.51,0.1,oops\n"
    with pytest.raises(TrajectoryError, match="line 254, column 'joint2' is 'oops'"):
        read(write("# remark\ntime,joint1,joint2\n" + "".join(rows)), model)


def test_time_must_increase_across_blocks_too(model, write, monkeypatch):
    monkeypatch.setattr(csv_module, "_BLOCK_SIZE", 12)
    with pytest.raises(TrajectoryError, match="line 4, column 'time'"):
        read(write(GOOD + "0.05,1,2\n"), model)


def test_lines_are_counted_with_the_comments_and_blanks_between_rows(model, write):
    with pytest.raises(TrajectoryError, match="line 6, column 'time'"):
        read(write(GOOD + "  # remark\n\n0.05,1,2\n"), model)


def test_excerpts_of_a_file_are_of_its_ends_too(model, write):
    rows = "".join(f"{k},0.5,0.25\n" for k in range(10_000, 30_000))
    log = MotionLog.open(write("time,joint1,joint2\n" + rows), model)
    runs = [table[:, 0] for table in excerpts(log.table, 5, 100)]
    assert (runs[0][0], runs[-1][-1]) == (10_000, 29_999)
    for k, times in enumerate(runs):
        assert len(times) == 100
        assert abs(times.mean() - (10_050 + k * 19_900 / 4)) < 60  # evenly spread


def test_a_file_that_is_not_there_says_so(model, tmp_path):
    with pytest.raises(NotFoundError, match="no motion file"):
        MotionLog.open(tmp_path / "none.csv", model)
    with pytest.raises(TrajectoryError, match="is a folder"):
        MotionLog.open(tmp_path, model)


@pytest.mark.parametrize("rows", [1, 5])
def test_too_few_rows_to_derive_from_are_refused(model, write, rows):
    text = "time,joint1,joint2\n" + "".join(f"{k},0,0\n" for k in range(rows))
    trajectory = MotionLog.open(write(text), model)
    with pytest.raises(TrajectoryError, match="too few to derive accelerations"):
        Differentiation.plan(trajectory, model)
