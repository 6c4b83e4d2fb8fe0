"""Core on record: arguments, numbers, texts, errors, files, tables, gravity, verdicts, doubts, first calls and foreign libraries."""

from __future__ import annotations

import contextlib
import errno
import fractions
import io
import os
import re
import resource
import stat
import threading
import time
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_answers import Records

import twistwrench as tw
from twistwrench.core import (
    arguments,
    blas_threads,
    child_process,
    colours,
    doubts,
    entities,
    errors,
    files,
    first_calls,
    glossary,
    gravity,
    object_cache,
    quadrature,
    tables,
    text,
    third_party,
    verdict,
)
from twistwrench.core import numbers as printed_numbers
from twistwrench.core.answers import sentences
from twistwrench.core.child_process import ChildLimits
from twistwrench.core.text import Argument, Placeholder, words_of_the_shell
from twistwrench.core.third_party import workers
from twistwrench.core.verdict import Reason, Verdict, Word

pytest_plugins = ("numpy_fixtures",)
records = Records(__file__)


def outcome(call, *positional, **named):
    """Result of a call, or type and message of its error, as in Python and as in the shell."""
    try:
        return call(*positional, **named)
    except Exception as error:
        shell = [error.in_shell()] if isinstance(error, tw.TwistWrenchError) and error.in_shell() != str(error) else []
        return " | ".join([f"{type(error).__name__}: {error}", *shell])


def kinds(call, *positional, **named):
    """As outcome; for an array also its type."""
    found = outcome(call, *positional, **named)
    return (
        [str(found.dtype), list(found.shape), found.tolist()]
        if isinstance(found, np.ndarray) and found.dtype != object
        else found
        if isinstance(found, str)
        else str(found)
    )


def written(value):
    """Text of a constant, without order of sets and with few digits."""
    if isinstance(value, dict):
        return "; ".join(f"{written(key)}: {written(entry)}" for key, entry in value.items())
    if isinstance(value, set | frozenset):
        return ", ".join(sorted(map(written, value)))
    if isinstance(value, list | tuple | np.ndarray):
        return "(" + ", ".join(map(written, value)) + ")"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


@records.of
def arrays_as_arguments():
    import pandas as pd

    frame = pd.DataFrame({"b": [1.0, 2.0], "a": [3.0, 4.0]})
    given = {
        "list": [[1, 2], [3, 4]], "float32": np.ones((2, 2), np.float32), "integers": np.array([[1, 2]], np.uint8), "bool": np.array([[True, False]]), "complex": np.array([[1j, 2]]), "text": [["x", "y"]], "objects": np.array([[fractions.Fraction(1, 4), 2]], object), "none": [[None, 1]], "large": [[10**400, 1]], "dates": np.array([["2020-01-01", "2020-01-02"]], "datetime64[D]"),
        "nan": [[np.nan, np.inf]], "masked": np.ma.array([[1.0, 2.0]], mask=[[True, False]]), "unmasked": np.ma.array([[1.0, 2.0]]), "single": [1, 2], "scalar": 3.0, "bytes": [[b"x", b"y"]], "spans": np.array([[1, 2]], "timedelta64[s]"), "empty": np.zeros((0, 2)),
    }  # fmt: skip
    found = {}
    for name, x in given.items():
        found[name] = [
            kinds(arguments.array, x, "q", 2),
            kinds(arguments.real, x, "q", 2, batch=False),
            kinds(arguments.finite, x, "q", 2),
            kinds(arguments.one, x, "q", 2),
        ][: 4 if name in ("nan", "single", "objects", "float32") else 2]
    x = [["a", "b"], ["b", "a"], ["a", "c"], ["a", "b", "c"], ["b"], []]
    found["tables"] = [outcome(lambda n=n: arguments.columns_in_order(frame, "q", n).tolist()) for n in x]
    found["repeated"] = outcome(arguments.columns_in_order, pd.DataFrame([[1.0, 2.0]], columns=["a", "a"]), "q", ["a"])
    found["rows"] = [
        outcome(lambda: arguments.columns_in_order(frame.iloc[0], "q", ["a", "b"]).tolist()),
        arguments.is_table(frame),
        arguments.is_table([1]),
        arguments.is_table(np.ones(2)),
        outcome(lambda: arguments.columns_in_order(pd.DataFrame([[1.0, 2.0]]), "q", []).tolist()),
    ]
    data = tw.Motion(
        np.arange(6.0), np.arange(12.0).reshape(6, 2), robot=tw.robots.planar_2r(), in_seconds=True
    ).to_xarray()
    found["xarray"] = [
        arguments.columns_in_order(data.q, "q", ["joint2", "joint1"])[0],
        arguments.is_table(data.q),
        arguments.is_table(data.q[:, 0].transpose()),
        arguments.is_table(SimpleNamespace(dims=("a",), coords={})),
    ]
    found["turned around"] = arguments.columns_in_order(
        pd.DataFrame([[1.0, 2.0, 3.0]], columns=["a", "b", "c"]), "q", ["b", "c", "a"]
    )
    found["plain"] = [
        None if (r := arguments.of_plain(v)) is None else [a.tolist() for a in r]
        for v in ([[1, 2], 3.0], [frame], [[[1], [1, 2]]], [(1,), np.ones(1)])
    ]
    found["together"] = [
        [a.tolist() for a in arguments.together(a=np.ones((2, 1)), b=np.arange(3.0))],
        outcome(arguments.together, a=np.ones((2, 3)), b=np.ones(4)),
    ]
    return found


def turn(angle, axis=2):
    c, s = np.cos(angle), np.sin(angle)
    return np.roll(np.roll(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), axis + 1, 0), axis + 1, 1)


@records.of
def rotations_and_poses_as_arguments():
    R = turn(0.4) @ turn(-0.7, 0)
    off = R + 1e-6 * np.array([[0, 0.4, 0], [0, 0, 0.3], [-0.5, 0, 0]])
    batch = np.stack([R, off, R.T])
    bad = batch.copy()
    bad[2, 0, 1] += 0.25
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, [1, 2, 3]
    row = T.copy()
    row[3, 1] = 3e-6
    nan = np.where(np.eye(3) == 1, np.nan, R)
    inf = R.copy()
    inf[1, 2] = np.inf

    def ok(call, x, *more):
        found = outcome(call, x, "R", *more)
        return found if isinstance(found, str) else "fine"

    return {
        "rotations": [ok(arguments.rotation, x) for x in (R, off, batch, R + 3e-6, bad, bad[None], -R, R * [1, 1, -1], nan, inf, R.astype(np.float32), (R + 8e-6).astype(np.float32), (R + 3e-5).astype(np.float32), 2 * R, R.astype(object))],
        "sure": [bool(arguments._surely_rotations(x)) for x in (R, R + 1e-7 * np.eye(3), R + 2e-7 * np.eye(3), R[[1, 0, 2]], batch, bad)], "gaps": np.round(arguments.gaps((R + 0.1 * np.arange(9.0).reshape(3, 3)).tolist()), 9),
        "poses": [ok(arguments.pose, x) for x in (T, row, np.stack([T, row]), T * 2, T[:3], T.astype(object))], "last rows": [outcome(arguments.last_row, x, "T", *m) for x, m in ((row, ()), (row, (1e-5,)), (np.stack([T, T]), ()))], "matrices": [outcome(arguments.matrix_of_rotation, x, "from", "Rotation") for x in (3, SimpleNamespace(as_matrix=lambda: [[1, 2]]))],
    }  # fmt: skip


@records.of
def single_values_as_arguments():
    values = [
        3,
        2.5,
        "4",
        "5 ms",
        True,
        np.int8(3),
        np.float32(0.5),
        None,
        [1],
        np.array(2.0),
        np.nan,
        np.inf,
        0,
        -1,
        6.0,
        "x",
        1j,
        fractions.Fraction(1, 2),
    ]
    calls = {
        "number": lambda x: arguments.number(x, "n"), "positive": lambda x: arguments.positive(x, "n", "s"), "at least zero": lambda x: arguments.positive(x, "n", "kg", zero=True), "infinite": lambda x: arguments.positive(x, "n", infinite=True), "whole": lambda x: arguments.whole(x, "n"), "least": lambda x: arguments.whole(x, "n", 3),
        "integer": lambda x: arguments.integer(x, "n"), "integer from 3": lambda x: arguments.integer(x, "n", 4), "flag": lambda x: arguments.flag(x, "n"), "choice": lambda x: arguments.choice(x, "n", ["x", "y"]), "text": arguments.value_text,
    }  # fmt: skip
    few = ("infinite", "least", "integer from 3", "choice")
    found = {
        name: {str(x): outcome(call, x) for x in (values[::3] if name in few else values)}
        for name, call in calls.items()
    }
    found["quantities"] = {
        t: outcome(arguments.read_quantity, t, "duration", "s")
        for t in ("5", "5s", " 500 ms ", "2 min", "1e3 ms", "1e3", "-2s", "5 h", "x", "", "inf", "5 e3 s", "0x1")
    }
    found["texts"] = [
        arguments.value_text(x)
        for x in ("a" * 58, "a" * 59, np.zeros((2, 3)), np.array(3.5), int, object(), b"x", {1: 2}, np.str_("y"), abs)
    ]
    found["parsed"] = {
        t: outcome(arguments.parse_numbers, t, "--at", "2 or 3 numbers", 2, 3)
        for t in ("1,2", "1, 2,3", "1", "1,x", "1,nan", "")
    }
    found["assigned"] = [
        outcome(arguments.assignments, t, "--set", "NAME=VALUE")
        for t in (["a=1", " b = x=y "], ["a"], ["=1"], ["a="], ["a=1", "a=2"])
    ]
    found["srdf"] = [outcome(arguments.refuse_unused_srdf, c, s) for c, s in ((None, "x"), (0.1, "x"), (None, None))]
    found["generators"] = [outcome(lambda x=x: int(arguments.generator(x).integers(1000))) for x in (3, "x", -1)]

    @arguments.hint_if_misused("give a, then b")
    def add(a, b=1):
        if b == 0:
            raise TypeError("inside")
        return a + b

    found["misused"] = [
        outcome(add, 1),
        outcome(add),
        outcome(add, 1, 0),
        outcome(add, 1, c=2),
        arguments.taking_the_arguments_of(add)(lambda *a: sum(a))(1, 2, 3),
    ]
    return found


@records.of
def printed_numbers_of_all_sizes():
    values = [
        0.0,
        -0.0,
        1.0,
        -62.2648,
        12345.6,
        9999.4,
        9999.5,
        9999.6,
        999999.4,
        1e6,
        1234567.0,
        0.00012345,
        2e-5,
        1e-13,
        0.5,
        0.0004,
        0.0006,
        -0.00049,
        99.96,
        123.456,
        float("inf"),
        -float("inf"),
        float("nan"),
    ]
    shares = [
        0.0,
        0.7649,
        0.989,
        0.9901,
        0.995,
        1.005,
        0.996,
        0.99996,
        0.9999996,
        1.0,
        1.0000004,
        1.00004,
        1.009,
        1.01,
        -0.997,
        12345.678,
        1e5,
        None,
        float("nan"),
    ]
    sigmas = [
        0.0,
        -1.0,
        0.0001,
        0.0004,
        0.0005,
        0.0994,
        0.0996,
        1.25,
        9.96,
        123.0,
        1e6,
        2e-9,
        float("nan"),
        float("inf"),
    ]
    n = printed_numbers
    return {
        "number": {str(x): [n.number(x), n.number(x, 3), n.number(x, decimals=3), n.printed(x), n.printed(x, 3, signed=True), n.torque(x), n.rounded_down(x), n.quantity(x, "N m"), n.file_number(x)] for x in values},
        "none": [n.number(None), n.number(None, missing="x"), n.quantity(None, "N"), n.quantity(30.0, "°"), n.quantity(1 / 3, "m", 2), n.quantity(1e-5, "m", decimals=3)], "down": [n.rounded_down(x) for x in (11.3295, 0.3, 0.1 + 0.2, 99999.9, 1e-7, 2)],
        "shares": {str(x): [n.percent(x), n.percent(x, 3), n.percent_of_limit(x)] for x in shares}, "sigmas": {str(s): [n.deviation(s), n.deviation(s, 1), n.estimate(12.3456, s), n.estimate(-1e7, s), n.plus_minus(0.0496, s, "kg")] for s in sigmas}, "values": [n.estimate(x, 0.12) for x in (float("inf"), -0.0001, 1e6, 999999.0)] + [n.estimate(12345.0, s) for s in (12.0, 123.0, 950.0, 996.0, 1e-7)],
        "others": [n.seconds(1.23456), n.seconds(2, 1), n.residual(0.0), n.residual(1.26e-9), n.vector(np.array([0.1 + 0.2, 1e-17, -2.0, np.nan])), n.vector(np.array(["x", 2], object)), n.vector(np.array([1 / 3]), 2)], "noise": [n.without_noise(np.array([1e-13, 1e-11, -5.0, np.inf])), n.without_noise(np.array([1e-13, 1e-11]), 0.5)],
        "limits": [n.over_limit(np.array([1.0, 1 + 0.9e-6, 1 + 1.1e-6, np.nan, -2.0])), n.margin([150.0, np.inf, 0.0, -2.0])],
    }  # fmt: skip


@records.of
def texts_of_messages():
    long = "x" * 250
    values = [Argument("tip"), Argument("tip", "tool 0"), Argument("lock", {"a": 0, "b c": 0.5}), Argument("lock", {"time": "COLUMN [ms]"}), Argument("x", {"it's": "a"}), Argument("friction", False), Argument("friction", True), Argument("inertia", True, "with-inertia"), Argument("inertia", False, "without"), Argument("rate", Placeholder("HZ")), Argument("chain", ("a b", "c")), Argument("tw.load", None, "robot"), Argument("kind_of", 3.5), Argument("feet", "auto", "feet", alone=True), Argument("columns", {"@x": 'say "y", z'})]  # fmt: skip
    template = "with <friction=False> or <inertia=True|with-inertia>, {name} and <known={'J.m': 'M'}> or <feet='a{b}'>"
    with words_of_the_shell():
        shell = [
            text.argument("tip", "a b"),
            text.spell_out(template),
            text.in_the_shell(),
            text.spell(values[2], shell=False),
        ]
    return {
        "lists": [text.listed(x, *m) for x, m in (("abcdefghijklm", ()), ("abcdefghijkl", ()), ("abcde", (2,)), ("abc", (1, "; ")), (["a\tb", "c\nd", long], ()), ([], ()), (range(5), (3, " / ")))],
        "arguments": {str(a): [text.spell(a), text.spell(a, shell=True)] for a in values}, "spelled": [text.spell_out(template), text.argument("tip"), text.in_the_shell()], "shell": shell, "filled": [text.with_arguments("Take {0}, {1}, {0} or {2}.", values[:2], shell=s) for s in (True, False, None)],
        "names": [text.quote_name(n) for n in ("a", "a,b", "a=b", '"a"', "@a", "a@b", "a b")], "short": [len(text.shorten("a" * k)) for k in (200, 201)], "clipped": [len(text.with_clipped_quotations(f"link {'a' * k!r} is it's {'b' * k!r}")) for k in (200, 201, 400)], "bounded": [len(text.bounded_message("a " * k)) for k in (500, 501)],
        "widths": [text.text_width(t) for t in ("q̇ = 1", "abc", "")], "visible": [text.visible(t) for t in ("a\x1b[2J\tb\n\u202ec\x7f", "é\u2066", "\u2028")],
    }  # fmt: skip


@records.of
def errors_of_all_kinds():
    cls = errors.TwistWrenchError
    path = errors.PathError("too far", reached=0.4, partial=[1])
    return {
        "unknown": [str(errors.UnknownNameError.from_choices("joint", n, c, *s)) for n, c, s in (("elbo", ["elbow", "wrist", "elbow", "elbo2"], ()), ("zzz", [], ()), (3, ["a"], ()), ("wrst", ["wrist"], (0.95,)), ("a" * 300, ["b" * 300], ()), ("n", [f"n{k}" for k in range(45)], ()))],
        "arguments": [[str(e), e.in_shell()] for e in (cls("Use {0} or {1}.", Argument("tip", "x"), Argument("friction", False)), cls("no {0}", 3), cls(), cls("a\x07b"), errors.UnknownNameError("it's {0}", Argument("tip")))], "long": [len(str(cls("a " * 900))), len(str(errors.FrameError(f"frame {'x' * 900!r}")))], "path": [str(path), path.reached, path.partial], "simulation": errors.SimulationError("x").result,
        "extra": str(errors.MissingExtraError.from_extra("matplotlib", "plot", "Drawing")).partition(" in a checkout")[0], "bases": {n: [b.__name__ for b in getattr(errors, n).__mro__[1:-2]] for n in errors.__all__},
        "classes": [outcome(lambda n=n, c=c: getattr(c, n)) for c, n in ((tw.Robot, "from_urdf"), (tw.Motion, "from_csv"), (tw.Motion, "nonsense"), (tw.SpatialInertia, "from_inertia"), (tw.Robot, "_x"), (tw.Motion, "tua"))],
    }  # fmt: skip


@records.of
def verdicts_and_doubts():
    reasons = {
        "look_again": ["l"],
        "collision": ["c"],
        "over": ["o"],
        "unsure": ["u", Reason("u; give it", "give it"), Reason("v; give it", "give it")],
    }
    names = list(reasons)
    joined = {}
    words = [Verdict(w, ("r",)) for w in (Word.LOOK_AGAIN, Word.COLLISION, Word.OVER_LIMIT, Word.UNSURE)] + [
        Verdict(Word.OK),
        Verdict(Word.DONE),
    ]
    for a in words:
        joined[str(a.word)] = [str(a.joined(b)) for b in words]
    joined["two reasons"] = str(Verdict(Word.UNSURE, ("z",)).joined(Verdict(Word.UNSURE, ("a", "z"))))
    table = doubts.doubt_table()
    made = [
        doubts.doubt("rate", ["a", "b"], rate="velocity", what="is x"),
        doubts.doubt(
            "spikes",
            ["a"],
            level="note",
            rows="3 %",
            joint="a",
            found={"value": 3.0, "unit": "rows", "interval": (1.0, 4.0)},
        ),
        doubts.doubt("left-out", named="all", log="my.csv", path="log.csv", reason="it is empty"),
        doubts.doubt("dead-torque", ["J1", "J2"], named=""),
        doubts.doubt("fanuc-j3", ["J3"], joint="J3", column=Argument("columns", {"J3": "x"})),
    ]
    effect = next(kind for kind, row in table.items() if row.level == "effect")
    placeholders = {
        "joints",
        *re.findall(r"\{(\w+)\}", table[effect].sentence + table[effect].remedy),
    } - {"joints"}
    made.append(doubts.doubt(effect, ["x"], **dict.fromkeys(placeholders, "?")))
    saved = {k: list(v) if isinstance(v, tuple) else v for k, v in vars(made[1]).items()}
    return {
        "order": [str(Verdict.from_reasons(**{n: reasons[n] for n in names[k:]})) for k in range(5)], "joined": joined, "codes": [(str(v.word), v.ok, int(v.exit_code), v.remedies) for v in [*words, Verdict.from_reasons(unsure=reasons["unsure"]), Verdict(Word.CONTACT, ("x",)), Verdict(Word.STOPPED, ("x",))]], "without a reason": [outcome(Verdict, w) for w in (Word.UNSURE, Word.STOPPED)],
        "exit codes": {c.name: int(c) for c in verdict.ExitCode}, "doubts": [vars(d) | {"refuses": d.refuses} for d in made], "dictionary": made[1].to_dict(), "saved": doubts.Doubt.from_saved(saved) == made[1], "verdicts": [str(doubts.verdict_from_doubts(d)) for d in (made, made[1:2], made[1:4], [])], "unknown": outcome(doubts.doubt, "rats"),
        "table": {name: f"{row.stage} {row.level} {row.false_alarms:g} {row.unit} {' '.join(row.reads)} {len(row.sentence)} {len(row.remedy)}" for name, row in table.items()}, "undetermined": {name: [len(t) for t in row] for name, row in doubts.undetermined_table().items()},
    }  # fmt: skip


@records.of
def colours_and_sentences():
    return {
        "styles": [colours.word_style(w) for w in Word], "terminal": [colours.terminal_style(s) for s in ("strong over", "near good", "pointed", "quiet", "strong", "")], "page": colours.page_colours().splitlines(), "table": {str(s): vars(c) for s, c in colours.COLOURS.items()},
        "sentences": {k: v for k, v in sentences.spoken_sentences().items() if "=" in v}, "filled": [sentences.sentence("margin", mass="2", frame="f", joint="j", time="1"), sentences.sentence("open", joint="j", end=sentences.sentence("end"), peak="1", sigma="2", unit="N", limit="3")], "all": {k: len(v) for k, v in sentences.SENTENCES.items()},
    }  # fmt: skip


@records.of
def files_read_and_written(folder):
    def error(call, *positional, **named):
        try:
            return call(*positional, **named)
        except OSError as problem:
            return [
                type(problem).__name__,
                problem.errno and errno.errorcode[problem.errno],
                problem.strerror if problem.errno in (errno.EFBIG, errno.EISDIR) else "",
            ]

    found = {}
    with contextlib.chdir(folder):
        Path("a.txt").write_bytes(b"\xef\xbb\xbfab\r\nc")
        Path("a.txt").chmod(0o604)
        Path("sub").mkdir()
        Path("link").symlink_to("a.txt")
        Path("old.csv").write_text("old")
        Path("old.csv").chmod(0o640)
        found["read"] = [
            files.read_text(Path("a.txt")),
            len(files.read_bytes(Path("a.txt"), 8)),
            error(files.read_bytes, Path("a.txt"), 7),
            error(files.read_bytes, Path("sub")),
            error(files.read_bytes, Path("no")),
            error(files.read_bytes, Path("/dev/zero"), 5_000_000),
        ]
        found["streams"] = [files.is_stream(Path(p)) for p in ("a.txt", "/dev/null", "no", "sub")]
        found["paths"] = [outcome(lambda p=p: str(files.as_path(p))) for p in ("x", Path("y"), "", 3, b"x", None)]
        found["pictures"] = [
            outcome(files.picture_path, p) for p in ("a", "a.PNG", "a.svg", "sub", "a.gif", "x.y/z.jpg")
        ]
        outputs = {
            "fine": ({"--csv": "new.csv", "--plot": None}, {"ROBOT": "a.txt"}), "input": ({"--csv": "link"}, {"ROBOT": "a.txt"}), "twice": ({"--csv": "n.csv", "--html": "./n.csv"}, {}), "folder": ({"--csv": "sub"}, {}), "no folder": ({"--csv": "none/n.csv"}, {}), "spreadsheet": ({"--csv": "n.xlsx"}, {}), "another option": ({"--html": "n.xlsx"}, {}), "device": ({"--csv": "/dev/null", "--html": "/dev/null"}, {}), "long": ({"--csv": "n" * 300}, {}), "none": ({"--csv": "no.csv"}, {"LOG": "no.csv"}),
        }  # fmt: skip
        found["outputs"] = {name: outcome(files.check_outputs, *o) for name, o in outputs.items()}
        found["existing"] = [
            outcome(lambda o=o, p=p: str(files.refuse_existing(p, overwrite=o)))
            for p in ("a.txt", "new", "/dev/null", "sub")
            for o in (False, True)
        ]

        def write(path, fail=False):
            with files.replacing(path) as temporary:
                name = temporary.name
                private = oct(stat.S_IMODE(temporary.stat().st_mode))
                temporary.write_text("new")
                if fail:
                    raise KeyError("x")
            return [
                name.startswith(".") and name.endswith(Path(path).suffix),
                Path(path).read_text(),
                private,
                oct(stat.S_IMODE(Path(path).stat().st_mode)),
            ]

        found["replaced"] = [
            write("old.csv"),
            write("link"),
            Path("link").is_symlink(),
            Path("a.txt").read_text(),
            outcome(write, "failed.csv", fail=True),
            outcome(write, "sub"),
            outcome(write, "none/x.csv"),
            outcome(write, "n" * 300),
        ]
        with files.replacing_together(["one.a", "two.b"]) as (one, two):
            one.write_text("1")
            two.write_text("2")
            found["not yet"] = [Path("one.a").exists(), one.suffix, two.suffix]
        found["left"] = sorted(p.name for p in Path().iterdir())
    return found


@records.of
def tables_of_text(folder):
    names = [
        "elbow",
        "=1+1",
        "-x",
        "+x",
        "@x",
        "'=x",
        "''-",
        "'a",
        " a",
        "a ",
        "a\nb",
        '"a"',
        "＝x",
        "\tx",
        "a,b",
        'a"b',
        "",
    ]
    with contextlib.chdir(folder):
        with tables.csv_table("t.csv", ["name", *names[:5]]) as table:
            table.row(["a,b", 1, None, 0.1, -2e-9, "=x"])
            table.numbers(np.array([[1.0, 2.5], [1 / 3, -1e300]]))
        written = Path("t.csv").read_bytes().decode().split("\n")
    return {
        "harmless": {n: [tables.harmless_text(n), tables.unescape_cell(tables.harmless_text(n)) == n] for n in names}, "cells": [tables.unescape_cell(c) for c in ('"x', '"', '"\\u00e9"', "'=", "'x", '"bad\\q"')], "csv": written,
        "html": tables.html_table("t & u", ["a", "<b>", "c"], [[1 / 3, "x", None], [2, "y<z", float("nan")], ["w", 3.0, True]]), "untitled": tables.html_table("", ["a"], []), "frame": [list(tables.data_frame({"a": [1, 2], "b": [3, 4]}).columns)],
    }  # fmt: skip


@records.of
def gravity_and_quadrature():
    rule = quadrature.ProbeRule(np.array([0.0, 0.5, 1.0]), np.array([0.25, 0.0, 0.75]), 0.01)
    forces = np.array([[1.0, 2.0], [0.0, -1.0], [4.0, 1e-15], [2.0, -1e-15]])
    return {
        "strength": [outcome(gravity.checked_strength, g) for g in (1.62, 0, -9.81, float("inf"), "x")], "axes": [gravity.vertical_axis(g) for g in ([0, 0, -9.81], [8.4, 0, -4.9], [8.6, 0, -4.9], [0, 7.0, -2.0], [0, 0, 0])], "vectors": [outcome(gravity.gravity_vector, g) for g in ([1, 2, -3], [1, 2], "x", [1, np.nan, 2], [[1, 2, 3]])], "read only": gravity.gravity_vector([0, 0, -1]).flags.writeable,
        "spacing": [quadrature.probe_spacing(0.01, 20.0), quadrature.probe_spacing(0.01, 2.0)], "needed": [rule.needed(h) for h in (0.0019, 0.002, 0.0021)], "shares": [[x.round(12) for x in rule.shares(h)] for h in (0.05, 0.051)], "counts": [len(rule.shares(h)[0]) for h in (0.01, 0.1, 0.11)],
        "left out": [quadrature.left_out(np.array([0.5, -0.25, 0.25, -0.5]), forces), quadrature.left_out(np.array([1.0, -1.0 + 1e-15]), np.ones((2, 1)))], "entities": [outcome(entities.refuse_entities, x, ValueError) for x in ("<r/>", '<!DOCTYPE r [<!ENTITY a "x">]><r/>', '<!DOCTYPE r [<!ENTITY % b SYSTEM "f">]><r/>')],
    }  # fmt: skip


@records.of
def first_calls_of_newcomers():
    rows = first_calls.first_calls()
    keys = [(place, word) for r in rows for place in r.where for word in r.words]
    keys = list(dict.fromkeys(keys))
    words = ["rnea", "RNEA", "crba", "inverse_dynamics", "computeMinverse", "nq_dot", "fkine", "jacob0", "dof", "mass"]
    return {
        "count": [len(rows), sorted({r.of for r in rows}), sum(len(r.words) for r in rows)], "case": {f"{place} {w}": [r.use for r in first_calls.rows_of(w, place)] for place, w in keys if w == w.casefold() and len([v for p, v in keys if p == place and v.casefold() == w]) > 1 and any(w in r.words and place in r.where for r in rows)}, "found": {w: [[r.use, r.of] for r in first_calls.rows_of(w, "robot")] for w in words}, "places": {p: sum(p in r.where for r in rows) for p in ("robot", "module", "motion", "inertia", "command", "option", "page")},
        "quantities": [r.quantity for r in rows if r.quantity][:40], "advice": [r.advice for r in rows[:60:3]], "plain": first_calls.plain_text("`robot.nv`, **not** [q](page.md)"), "similar": [first_calls.similar_names(n, ["mass_matrix", "mass_matrices", "momentum", "masses"]) for n in ("mass_matrx", "elbow", "mass_matri")],
        "missing": [str(first_calls.missing_attribute("'X' object", n, p, ["mass_matrix"])) for n, p in (("crba", "robot"), ("mass_matrx", "robot"), ("zzz", "robot"), ("plot", "module"), ("torque", "motion"))], "only": [r.only for r in rows if r.only][:9], "shown": sum(bool(r.shown) for r in rows),
    }  # fmt: skip


DOC = """Do a thing.

    Long text.

    Parameters
    ----------
    b, c : float
        Meaning of both.

    Raises
    ------
    ValueError
        Bad.

    Examples
    --------
    >>> 1
    1
    """


@records.of
def docstrings_completed():
    def sample(self, q, b, c, frame=None, *, tau=None) -> str: ...

    return {
        "completed": [glossary.complete_docstring(d, n, r, res).splitlines() for d, n, r, res in ((DOC, ["q", "b", "c", "frame"], "", "str"), (DOC, ["b", "c"], "", ""), (DOC, ["t", "dt"], "trajectories", "Motion"), (DOC, ["zzz"], "", "int"), ("One line.", ["q"], "", "str"), (DOC.partition("    Examples")[0], ["q"], "", ""), (DOC.replace("Examples", "Returns"), ["wrench_on_robot", "wrench_by_robot"], "", "str"))],
        "rooms": [glossary.room_of(f) for f in (["robot", "viz"], ["viz", "plots"], ["control"], [])], "names": glossary.signature_names(sample), "counts": [len(glossary.ENTRIES), len(glossary.RETURNS), {k: len(v) for k, v in glossary.ROOMS.items()}],
    }  # fmt: skip


@records.of
def foreign_libraries():
    def converted(problem):
        with third_party.third_party_errors(lambda reason: tw.TrajectoryError(f"file: {reason}.")):
            raise problem

    class Unreadable(Exception):
        def __str__(self):
            raise RuntimeError

    with third_party.capture_stderr() as output:
        os.write(2, b"  one\n two " + b"x" * 400)
    lazy = third_party.lazy_module("math")
    double = workers.Workers()
    progress = []

    def half(x):
        if x == 3:
            raise tw.ValueRangeError("three")
        return x / 2

    def pool(*positional):
        with workers.workers_of(*positional) as found:
            return [found.client, found.ahead]

    return {
        "reasons": [third_party.reason_of(p) for p in (ValueError("a\n b."), ValueError(), KeyError("k"), RecursionError("x"), MemoryError(), OSError(errno.ENOENT, "No such"), OSError("plain"), ValueError("y" * 250), Unreadable())], "converted": [outcome(converted, p) for p in (ValueError("bad."), tw.FrameError("own"))], "captured": [str(output)[:12], len(str(output)), len(output.text)],
        "lazy": [lazy.hypot(3, 4), "hypot" in vars(lazy), third_party.is_lazy([1]), third_party.any_lazy([1, {"a": 2}])], "signature": third_party._signature_part([(6,), (6, 6), ()]), "results": [str(r) for r in double.results(half, [1, 3, 5], progress.append)], "progress": progress, "pools": [outcome(pool), outcome(pool, 2, "tcp://x"), *[outcome(pool, n).partition("; this machine")[0] for n in (0, 5000)]],
    }  # fmt: skip


@records.of
def blocks_of_dask_arrays():
    import dask.array as da

    robot = tw.robots.planar_2r()
    q = np.arange(12.0).reshape(6, 2) / 10
    lazy = da.from_array(q, chunks=(4, 1))
    found = robot.mass_matrix(lazy)
    torques = robot.inverse_dynamics(lazy, 0.5 * lazy, q, wrench_on_robot={robot.frame_names[-1]: np.arange(6.0)})
    return {
        "mass": [type(found).__name__, found.shape, found.chunks, float(np.abs(np.asarray(found) - robot.mass_matrix(q)).max())], "torques": [torques.shape, float(np.abs(np.asarray(torques) - robot.inverse_dynamics(q, 0.5 * q, q, wrench_on_robot={robot.frame_names[-1]: np.arange(6.0)})).max())],
        "any": [third_party.any_lazy([1, {"a": lazy}]), third_party.is_lazy(lazy), third_party.is_asking_for_type()], "later": [np.asarray(x) for x in third_party.later(lambda a, b: (a + b.sum(axis=-1, keepdims=True), a), "(2),(3)->(2),(2)", [lazy[:2], np.ones(3)])], "types": [str(third_party.later(lambda a: a, "(2)->(2)", [a]).dtype) for a in (lazy, lazy.astype(np.float32))], "errors": [outcome(robot.mass_matrix, lazy[:, :1]), outcome(robot.inverse_dynamics, lazy, lazy, lazy, wrench_on_robot={"link2": np.ones(5)})],
        "derivatives": [d.shape for d in robot.inverse_dynamics_derivatives(lazy, lazy, lazy)],
    }  # fmt: skip


@records.of
def cache_of_objects(folder):
    found = {}
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings(record=True) as given, contextlib.chdir(folder):
        warnings.simplefilter("always")
        patch.setattr(object_cache, "_WARNINGS_GIVEN", set())
        patch.setenv(object_cache.VARIABLE, str(Path("cache/inner").absolute()))
        key = object_cache.digest("a", b"b").hex()
        found["digests"] = [object_cache.digest(*p).hex()[:16] for p in (("ab", "c"), ("a", "bc"), (b"ab", b"c"), ())]
        object_cache.store(key, b"code")
        cache = object_cache.folder()
        found["stored"] = [
            object_cache.load(key),
            object_cache.load("0" * 64),
            oct(stat.S_IMODE(cache.stat().st_mode)),
            (cache / key).read_bytes()[:18],
            len((cache / key).read_bytes()),
        ]
        (cache / key).write_bytes((cache / key).read_bytes()[:-1] + b"x")
        found["damaged"] = [object_cache.load(key), (cache / key).exists()]
        (cache / ("1" * 64)).mkdir()
        (cache / ("2" * 64)).symlink_to("/dev/null")
        found["others"] = [
            object_cache.load("1" * 64),
            (cache / ("1" * 64)).exists(),
            object_cache.load("2" * 64),
            (cache / ("2" * 64)).is_symlink(),
        ]
        patch.setattr(object_cache, "MOST_ENTRIES", 8)
        for k in range(9):
            name = f"{k:064x}"
            object_cache.store(name, b"x")
            os.utime(cache / name, (1e9 + k, 1e9 + k))
        (cache / "mine.txt").write_text("x")
        object_cache.store("f" * 64, b"y")
        found["pruned"] = sorted(p.name[-3:] for p in cache.iterdir())
        cache.chmod(0o722)
        found["writable by others"] = [object_cache.folder(), object_cache.load("f" * 64)]
        for value in ("OFF", str(Path("cache/inner/mine.txt").absolute())):
            patch.setenv(object_cache.VARIABLE, value)
            found["off" if value == "OFF" else "file"] = object_cache.folder()
        found["warnings"] = [str(w.message) for w in given]
        found["safe"] = [
            object_cache._is_safe_parent(SimpleNamespace(st_uid=u, st_gid=g, st_mode=m))
            for u, g, m in (
                (os.getuid(), os.getuid(), 0o775),
                (0, 5, 0o775),
                (0, 5, 0o755),
                (os.getuid(), os.getuid(), 0o777),
                (0, 0, 0o1777),
                (12345, 12345, 0o755),
            )
        ]
    return {
        k: [x.decode() if isinstance(x, bytes) else x for x in v] if isinstance(v, list) else v
        for k, v in found.items()
    }


@records.of
def calls_in_a_child():
    def run(target, *positional, **limits):
        return outcome(
            child_process.run_in_child,
            target,
            *positional,
            limits=ChildLimits(**limits) if limits else None,
            error_of=tw.TrajectoryError,
        )

    def stream(target, *positional):
        return outcome(lambda: list(child_process.stream_from_child(target, *positional, error_of=tw.TrajectoryError)))

    with pytest.MonkeyPatch.context() as patch:
        settings = []
        for value in ("0", "1"):
            patch.setenv(child_process.VARIABLE, value)
            settings.append(child_process.sandboxed())
    found = {
        "results": [run("math:hypot", 3.0, 4.0), stream("builtins:range", 3), run("builtins:divmod", 7, 2)], "errors": [run("builtins:int", "x"), run("os:abort"), run("fractions:Fraction", 1, 2), run("builtins:bytearray", 3_000_000, output=1000_000), run("twistwrench.core.arguments:parse_numbers", "1", "at", "two", 2), run("twistwrench.core.arguments:refuse_unused_srdf", None, "x")],
        "settings": settings, "reasons": [str(child_process._error_from(n, "text {0}", ("tip", "x"))) for n in ("FrameError", "ModelWarning", "nothing")], "parts": [child_process._text_and_arguments(e) for e in (tw.FrameError("a {0}", Argument("tip")), tw.FrameError("a {0}", Argument("tip", 3)), tw.FrameError("a", 3), tw.FrameError())], "sizes": [child_process._size_text(s) for s in (2**20, 2**28 - 1, 2**28, 3 * 2**30)],
    }  # fmt: skip
    child_process.end_children()
    return found


@records.of
def threads_of_blas():
    calls = []
    counts = {"a": 4, "b": 8}
    libraries = [
        blas_threads._Library(lambda n=n: counts[n], lambda k, n=n: (calls.append((n, k)), counts.__setitem__(n, k)))
        for n in counts
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blas_threads, "_libraries", lambda: libraries)
        patch.setattr(blas_threads, "_ONE_THREAD", blas_threads._OneThread())
        with blas_threads.one_blas_thread():
            inside = blas_threads.blas_threads()
            with blas_threads.one_blas_thread():
                pass
            nested = dict(counts)
        return [inside, nested, dict(counts), calls]


@records.of
def streams_and_standard_input(folder):
    found = {}
    with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
        os.mkfifo("pipe")

        def write():
            with Path("pipe").open("wb") as stream:
                stream.write(b"ab")
                stream.flush()
                time.sleep(0.05)
                stream.write(b"c" * 5)

        for most in (7, 6):
            writer = threading.Thread(target=write)
            writer.start()
            with contextlib.suppress(BrokenPipeError):
                found[f"pipe {most}"] = outcome(lambda most=most: files.read_text(Path("pipe"), most))
                writer.join()
        found["is a stream"] = files.is_stream(Path("pipe"))
        for most in (5, 4):
            patch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(b"12345")))
            found[f"input {most}"] = outcome(lambda most=most: files.read_standard_input(most).decode())
        patch.setattr(files, "_OPENING_TIMEOUT", 0.02)
        found["nobody"] = outcome(files.read_bytes, Path("pipe"))
        with files.replacing("/dev/null") as target:
            found["device"] = str(target)
        Path("a").symlink_to("b")
        Path("b").symlink_to("a")
        with contextlib.suppress(tw.ValueRangeError), files.replacing("a"):
            pass
        found["circle"] = [
            outcome(files.check_outputs, {"--csv": "a"}, {}).partition(":")[0],
            sorted(p.name for p in Path().iterdir()),
        ]
    return found


@records.of
def cache_in_its_usual_folder(folder):
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings(record=True) as given, contextlib.chdir(folder):
        warnings.simplefilter("always")
        patch.setattr(object_cache, "_WARNINGS_GIVEN", set())
        patch.setattr("sys.platform", "linux")
        patch.delenv(object_cache.VARIABLE, raising=False)
        patch.setenv("XDG_CACHE_HOME", str(Path("x").absolute()))
        first = str(object_cache.folder())
        patch.setenv("XDG_CACHE_HOME", " ")
        patch.setenv("HOME", str(Path("home").absolute()))
        second = str(object_cache.folder())
        patch.setenv(object_cache.VARIABLE, str(Path("c").absolute()))

        def full(**options):
            raise OSError(errno.ENOSPC, "No space")

        patch.setattr("tempfile.mkstemp", full)
        object_cache.store("a" * 64, b"x")
        object_cache.store("a" * 64, b"x")
        patch.setattr("os.getuid", lambda: 1234)
        patch.setattr("os.getgid", lambda: 100)
        statuses = {
            f"{user} {group} {mode:o}": object_cache._is_safe_parent(
                SimpleNamespace(st_uid=user, st_gid=group, st_mode=mode)
            )
            for user in (0, 1234, 7)
            for group in (100, 1234)
            for mode in (0o755, 0o775, 0o757, 0o1777)
        }
        return [first, second, sorted(p.name for p in Path("c").iterdir()), [str(w.message) for w in given], statuses]


@records.of
def limits_of_a_child(folder):
    def run(target, *positional, **limits):
        return outcome(
            child_process.run_in_child,
            target,
            *positional,
            limits=ChildLimits(**limits) if limits else None,
            error_of=tw.TrajectoryError,
        )

    with contextlib.chdir(folder):
        items = child_process.stream_from_child("builtins:range", 9, error_of=tw.TrajectoryError)
        started = [next(items), next(items)]
        items.close()
        found = {
            "part": started, "again": run("builtins:pow", 3, 4), "folder": run("os:getcwd"), "environment": [run("os:getenv", name) for name in ("OMP_NUM_THREADS", child_process.VARIABLE)], "core": run("resource:getrlimit", resource.RLIMIT_CORE)[0], "array": run("numpy:arange", 3.0), "waits": run("time:sleep", 9.0, seconds=0.04),
            "memory": run("builtins:bytearray", 600_000_000, memory=200_000_000), "code": run("os:_exit", 3), "exact": run("builtins:len", "abc"), "module": run("no_such_module:x"),
        }  # fmt: skip
        child_process.end_children()
    return found


@records.of
def jobs_of_a_client():
    """Jobs submitted to a Dask client: in order, some ahead, each with retries; a dead worker is a failure."""
    from distributed.scheduler import KilledWorker

    submitted, released = [], []

    class Future:
        def __init__(self, job, item):
            self.job, self.item = job, item

        def result(self):
            if self.item == 4:
                raise KilledWorker("job-4", SimpleNamespace(address="tcp://worker"), 3)
            return self.job(self.item)

        def release(self):
            released.append(self.item)

    class Client:
        def nthreads(self):
            return {"a": 1, "b": 1}

        def submit(self, job, item, **options):
            submitted.append([item, options, len(released)])
            return Future(job, item)

    def half(x):
        if x == 3:
            raise tw.ValueRangeError("three")
        return x / 2

    progress = []
    pool = workers.Workers.from_client(Client())
    results = [str(r).partition(": ")[0][:60] for r in pool.results(half, list(range(9)), progress.append)]
    return {
        "ahead": pool.ahead,
        "results": results,
        "submitted": submitted,
        "released": released,
        "progress": progress,
        "alone": workers.Workers.from_client(None).ahead,
    }


@records.of
def methods_called_later():
    import dask.array as da

    class Owner:
        nq, nv = 3, 2

        @third_party.lazy_by_blocks(lambda owner, arguments: [(owner.nv,)])
        def one(self, q, dq=None, *, scale=1.0, wrench_on_robot=None):
            total = sum(np.asarray(F).sum(axis=-1) for F in (wrench_on_robot or {}).values())
            return scale * np.asarray(q)[..., :2] + (0 if dq is None else np.asarray(dq)) + np.asarray(total)[..., None]

        @third_party.lazy_by_blocks(
            lambda owner, arguments: [(owner.nv,), (2, 3)], result=lambda a, b: [a, b], dtype=np.float64
        )
        def two(self, q):
            q = np.asarray(q)
            return q[..., :2], np.stack([q, 2 * q], axis=-2)

    q = np.arange(12.0).reshape(4, 3)
    lazy = da.from_array(q, chunks=(3, 2))
    owner = Owner()
    wrench = {"a": np.arange(6.0), "b": da.from_array(np.ones((4, 6)), chunks=2)}
    a, b = owner.two(lazy)
    return {
        "plain": owner.one(q, scale=2.0), "later": np.asarray(owner.one(lazy, q[:, :2], scale=2.0, wrench_on_robot=wrench)), "by wrench": np.asarray(owner.one(q, wrench_on_robot=wrench)), "two": [np.asarray(a), np.asarray(b).shape, a.chunks, b.dtype.name], "kept": sorted(type(F).__name__ for F in wrench.values()),
        "errors": [outcome(owner.one, lazy[:, :2]), outcome(owner.one, lazy, q), outcome(owner.one, lazy, wrench_on_robot={"a": np.ones(5)})],
    }  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
