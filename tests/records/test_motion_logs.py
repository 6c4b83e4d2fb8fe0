"""Motion files on record: text and arrays as they are read, joined files, time stamps, and whole motions with their notes."""

from __future__ import annotations

import contextlib
import gzip
import json
import os
import re
import sqlite3
import threading
from pathlib import Path

import numpy as np
import pytest
from recorded_answers import Records
from ros_logs import (
    CONTROLLER_STATE,
    HEADER,
    JOINT_STATE,
    PLAN,
    POINT,
    SHOWN_PLAN,
    controller_state,
    plan,
    point,
    stamp,
    typestore,
    write_database,
    write_folder,
    write_messages,
    write_ros1,
)
from ros_logs import header as ros_header

import twistwrench as tw
from twistwrench.motion import log_table, motion_file
from twistwrench.motion.log_checks.time_stamps import DuplicateTimestamps, steady_times
from twistwrench.motion.log_table import check_ratio, excerpts, spread_rows, windows
from twistwrench.motion.motion_file import JoinedFile, joints_without_column, moves_motors, open_motion_file
from twistwrench.motion.motion_log import MotionLog
from twistwrench.motion.readers import child_readers, csv_reader, file_ends, format_of, recording_bounds
from twistwrench.motion.readers.array_files import array_file
from twistwrench.motion.readers.columnar_file import ArrayFile
from twistwrench.motion.readers.csv_reader import CsvFile, Dialect, is_number, parse_block
from twistwrench.motion.readers.file_ends import FileEnds
from twistwrench.motion.readers.lerobot import read_metadata
from twistwrench.motion.readers.ros_recordings import between_points, ros_file

from .test_motion_columns import CRANE, GEARED, RAFT, compactly, outcome

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
record = compactly(records)

TEN = "".join(f"{0.1 * k:.3f},{k * k:.2f},{-k:.4f}\n" for k in range(10))
TEXTS = {
    "commas": "t,a,b\n0.5,-1.5e3,+2\n 1.5 ,.25,3.\n",
    "semicolons and decimal commas": "t;a;b\n0,5;-1,25;2\n1,5;7;1e1\n",
    "semicolons and points": "t;a;b\n0.5;-1.25;2\n",
    "mixed decimals": "t;a;b\n0,5;-1.25;2\n1,5;3;4\n",
    "tabs": "t\ta\tb\n0.5\t-1,5\t2\n",
    "blanks": '# made by hand\n"t"  a   b\n0.5 -1.5   2\n\n1.5 2 3\n',
    "quotes": 't,"a, b","c ""d"""\n"0.5",-1.5,2\n1,2,3\n',
    "escaped names": "t,'=a,\"\"\"x \"\"\"\n0.5,-1.5,2\n",
    "comments": "# one\n\n  # two\nt,a,b\n# three\n0.5,1,2\n\n \t# four\n1.5,2,3\n",
    "header in a comment": "# first\n# t a b\n0.5 1 2\n1.5 2 3\n",
    "header in a longer comment": "# t a b c\n0.5 1 2\n1.5 2 3\n",
    "comment of numbers": "# 1 2 3\n0.5 1 2\n1.5 2 3\n",
    "windows": "t,a,b\r\n0.5,1,2\r\n1.5,2,3\r\n",
    "old macs": "t,a,b\r0.5,1,2\r1.5,2,3\r",
    "no end": "t,a,b\n0.5,1,2\n1.5,2,3",
    "cut short": f"t,a,b\n{TEN}1.000,100.00,-10.0",
    "not cut short": f"t,a,b\n{TEN}1.000,100.00,-10.0000",
    "cut, others differ": f"t,a,b\n{TEN}1.1,2,-3.25\n1.000,100.00,-10.0",
    "few and cut": "t,a\n0.1,0.25\n0.2,0.2",
    "text column": "t,state,a\n0.5,RUN,1\n1.5,,2\n2.5,nan,3\n",
    "underscore": "t,a\n0.5,1_000\n",
    "not a number": "t,a\n0.5,1\n0.6,x1\n",
    "blank": "t,a\n0.5,1\n0.6,\n",
    "nan": "t,a\n0.5,1\n0.6,nan\n0.7,-Inf\n0.8,2\n",
    "one nan": "t,a\n0.5,1\n0.6,1e999\n0.7,2\n",
    "point among commas": "t;a\n0,5;1,5\n0,6;1.5x\n0,7;1.25\n",
    "point where others have commas": "t;a\n0,5;1.25\n",
    "decimal commas": "t,a\n0,5,1,25\n",
    "comma in a cell": 't,a\n0.5,"1,25"\n',
    "too many": "t,a\n0.5,1,2\n",
    "some too many": "t,a,b\n0.5,1,2,3\n",
    "long and faulty": "t,a\n0.5,1," + "7" * 90 + "\n",
    "too few": "t,a,b\n0.5,1,2\n0.6,1\n",
    "semicolons below": "t,a,b\n0.5;1;2\n",
    "open quote": 't,a\n0.5,"1\n',
    "control": "t,a\n0.5,1\x07\n",
    "one column": "a b\n0.5\n1.5\n",
    "one column of decimal commas": "a\n0,5\n1,5\n",
    "only a header": "t,a\n",
    "empty": "# nothing\n\n",
    "long line": "t,a\n0.5," + "x" * 90 + "\n",
    "ros": "%time,field.name0,field.name1,field.position1,field.position0,field.velocity0,field.effort1,field.position2\n"
    "1000000,elbow,wrist,0.5,0.25,1,2,7\n2000000,elbow,wrist,0.6,0.35,1.5,2.5,8\n",
    "ros, joints change": "%time,field.name0,field.position0\n1000000,elbow,0.5\n2000000,wrist,0.6\n",
}  # fmt: skip


def read_text(path):
    def read():
        file = CsvFile.open(path)
        numeric = [k for k in range(len(file.header)) if k not in file.text_columns()]
        return {
            "header": file.header, "line": file.header_line, "cells": file.dialect.name, "text": file.text_columns(), "notes": file.notes,
            "table": outcome(file.table, numeric), "first": outcome(file.first, numeric[-1]) if len(numeric) > 2 else "", "place": file.place(1),
            "rows": outcome(lambda: list(file.rows())) if len(file.header) < 3 else "",
        }  # fmt: skip

    return outcome(read)


@record
def texts_of_all_dialects(folder):
    found = {}
    raw = {
        "byte order mark": b"\xef\xbb\xbft,a\n0.5,1\n", "utf-16": "t,ä\n0.5,1\n".encode("utf-16"), "utf-16 be": "t,a\n0.5,1\n".encode("utf-16-be"), "utf-16 le": "t,a\n0.5,1\n".encode("utf-16-le"),
        "utf-32": "t,a\n0.5,1\n".encode("utf-32"), "gzip": gzip.compress(b"t,a\r0.5,1\r", mtime=0), "gzip cut": gzip.compress(b"t,a\n0.5,1\n", mtime=0)[:-9], "latin": b"t,a\n0.5,1\n0.6,\xe9\n", "latin header": b"t,\xe9\n0.5,1\n",
    }  # fmt: skip
    with contextlib.chdir(folder):
        for name, text in (TEXTS | raw).items():
            path = Path(f"{name.replace(' ', '_').replace(',', '')}.csv")
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
            found[name] = read_text(path)
        Path("sub").mkdir()
        found["folder"] = read_text("sub")
        found["absent"] = read_text("no.csv")
    return found


@record
def numbers_in_cells():
    cells = [
        " -1.5e3 ",
        "1_000",
        "0,5",
        ".5",
        "5.",
        "+1E-3",
        "1e",
        "0x1",
        "",
        " ",
        "nan",
        "1 2",
        "--1",
        "1e999",
        "-1,5",
        "1.000,5",
        "١",
    ]
    block = b"0.5,1,2\n# x\n1.5,2,3\n\n"
    return {
        "plain": {c: (is_number(c), is_number(c, decimal_comma=True)) for c in cells},
        "dialects": {c: [Dialect(s).number(c) for s in (",", ";", "\t", None)] for c in cells},
        "headers": {f"{h} | {r}": Dialect.from_header(h, r).name for h, r in (("t;a,b", "1;2,5"), ("t;a,b", "1,2"), ("a b,c d", "1 2"), ("a b", "1"), ("a", "1,5"), ("a", None), ("a b", None), ("a\tb c", "1 2 3"), ("a b c", "1\t2\t3"), ("a,b;c", None))},
        "blocks": [parse_block(text, Dialect(s), n, used) for text, s, n, used in ((block, ",", 3, [2, 0]), (block, ",", 3, [0, 1, 2]), (block, ",", 2, [0]), (b"1 2\n3  4\n", None, 2, [1]), (b"1 2\n3\n", None, 2, [1]), (b"1,5;2\n", ";", 2, [0]), (b'"1",2\n', ",", 2, [0, 1]), (b"x,2\n1,3\n", ",", 2, [1]), (b"1,nan\n", ",", 2, [1]), (b"1,nan\n", ",", 2, [0]), (b"\n\n", ",", 2, [0]), (b"1\x00,2\n", ",", 2, [0]))],
        "formats": {name: outcome(lambda n=name, s=start: (format_of(Path(n), s) or ("", "text"))[1]) for name, start in (("a.MCAP", b""), ("a.csv", b"SQLite format 3\0x"), ("a.txt", b"PK\3"), ("a.feather", b""), ("a.csv", b"t,a"), ("a", b""))},
    }  # fmt: skip


def summary(file, columns=None):
    """What an opened file of arrays has."""
    columns = range(len(file.header)) if columns is None else columns
    table = outcome(file.table, list(columns))
    fields = {"header": file.header, "notes": file.notes, "table": table}
    fields |= {
        name: getattr(file, name) for name in ("epoch", "dataset", "plan", "advice") if getattr(file, name, None)
    }
    return fields


def read_arrays(path, episode=None):
    return outcome(lambda: summary(array_file(FileEnds.from_path(Path(path)), episode)))


T4 = np.array([0.5, 0.75, 1.25, 1.5])
Q42 = np.array([[0.1, -0.2], [0.3, 0.4], [-0.5, 0.6], [0.7, 0.85]])


@record
def files_of_numpy_and_matlab(folder):
    from scipy.io import savemat

    found = {}
    dates = np.array(
        ["2020-01-01T00:00:00.5", "2020-01-01T00:00:01", "2020-01-01T00:00:03", "2020-01-01T00:00:04"], "datetime64[ns]"
    )
    fields = np.array(
        [(0.5, 1, "x", (1.0, 2.0)), (0.75, 2, "y", (3.0, 4.0))],
        [("t", "f8"), ("n", "i4"), ("word", "U1"), ("pair", "f8", (2,))],
    )
    with contextlib.chdir(folder):
        np.savez(
            "a.npz",
            t=T4,
            q=Q42,
            line=T4[None, :] + 1,
            word=np.array("x"),
            single=np.array(3.5),
            short=T4[:2],
            cube=np.zeros((4, 2, 2)),
            date=dates,
            step=np.diff(dates, append=dates[-1:]),
            flag=np.array([True, False, True, True]),
        )
        np.savez_compressed("wide.npz", t=T4, wide=np.zeros((4, 10_001)), f=np.asfortranarray(Q42.astype("f4")))
        np.savez("none.npz", word=np.array(["x"]), one=np.ones(1))
        np.savez("nan.npz", t=T4, x=np.array([1, np.nan, 2, np.inf]), y=np.array([1.0, 2, 3, 4]))
        np.save("plain.npy", Q42[::-1])
        np.save("columns.npy", np.asfortranarray(Q42))
        np.save("fields.npy", fields)
        np.save("line.npy", T4[:, None])
        data = Path("plain.npy").read_bytes()
        Path("cut.npy").write_bytes(data[:-8])
        savemat("five.mat", {"t": T4, "q": Q42, "z": Q42 + 1j, "name": "word", "small": np.array([1, 2, 3, 4], "i2")})
        savemat("packed.mat", {"t": T4.astype("f4"), "q": Q42}, do_compression=True)
        savemat("four.mat", {"t": T4, "q": Q42.astype("f4"), "w": "word"}, format="4")
        five, four = Path("five.mat").read_bytes(), Path("four.mat").read_bytes()
        Path("five_cut.mat").write_bytes(five[:-60])
        Path("four_cut.mat").write_bytes(four[:-9])
        Path("five_odd.mat").write_bytes(b"MATLAB 5.0" + b" " * 118 + b"\x0e\x00\x00\x00")
        Path("text.mat").write_bytes(b"MATLAB 5.0 MAT-file" + b" " * 120)
        for path in sorted(Path().glob("*.*")):
            found[path.name] = read_arrays(path)
        found["episode"] = read_arrays("a.npz", episode=1)
        found["absent"] = read_arrays("no.npz")
        file = array_file(FileEnds.from_path(Path("a.npz")))
        found["parts"] = [outcome(file.table, [2, 0]), file.first(1), file.place(4)]
    return found


@record
def files_of_arrow_and_hdf5(folder):
    import h5py
    import pyarrow as pa
    from pyarrow import feather, parquet

    found = {}
    lists = [[0.1, 0.2], [0.3, 0.4], [0.5, 0.6], [0.7, 0.8]]
    table = pa.table({
        "timestamp": T4, "observation.state": lists, "action": lists[::-1], "episode_index": [0, 0, 1, 1], "word": ["a", "b", "c", "d"], "odd": [{"y": 1.5, "z": 2}] * 4, "flag": [True, False, True, True],
        "when": pa.array([0, 10**9, 3 * 10**9, 4 * 10**9], pa.timestamp("ns")), "nested": [{"x": 1}] * 4,
    })  # fmt: skip
    info = {
        "features": {
            "observation.state": {"names": {"motors": ["elbow", "wrist.vel"]}},
            "action": {"names": ["a", "b"]},
            "other": {"names": None},
        }
    }
    with contextlib.chdir(folder):
        Path("set/meta").mkdir(parents=True)
        Path("set/data/chunk").mkdir(parents=True)
        parquet.write_table(table, "set/data/chunk/e.parquet")
        parquet.write_table(table.drop_columns(["episode_index", "observation.state"]), "plain.parquet")
        feather.write_feather(table.drop_columns(["episode_index", "nested"]), "plain.feather")
        Path("old.feather").write_bytes(b"FEA1 ")
        for unit, text in {
            "degrees": '"units": "degrees"',
            "use": '"use_degrees": true',
            "radians": '"unit": "rad"',
            "range": '"m": "range_m100_100"',
            "unknown": '"m": 1',
        }.items():
            Path("set/meta/info.json").write_text(json.dumps(info)[:-1] + f", {text}}}")
            found[f"metadata {unit}"] = read_metadata(Path("set/data/chunk/e.parquet"))
        for text in ("[]", "{", '{"features": {"a": 1}}'):
            Path("set/meta/info.json").write_text(text)
            found[f"metadata {text}"] = outcome(read_metadata, Path("set/data/chunk/e.parquet")) if text != "{" else ""
        Path("set/meta/info.json").write_text(json.dumps(info))
        for episode in (None, 0, 1, 2):
            found[f"episode {episode}"] = read_arrays("set/data/chunk/e.parquet", episode)
        found["deeper"] = read_metadata(Path("set/data/chunk/a/b/e.parquet"))
        for name in ("plain.parquet", "plain.feather", "old.feather"):
            found[name] = read_arrays(name)
        with h5py.File("a.h5", "w") as file:
            file["t"] = T4
            file["group/q"] = Q42
            file["group/line"] = T4[None, :] + 2
            file["word"] = "x"
            file["table"] = np.array(
                [(0.5, 1, b"x"), (0.75, 2, b"y"), (1.0, 3, b"z"), (1.5, 4, b"w")],
                [("u", "f8"), ("n", "i4"), ("s", "S1")],
            )
            file.create_dataset("big", (10**6, 400), "f8", chunks=(10**4, 900 // 3))
            file.create_dataset("chunky", (10**7,), "f8", chunks=(9 * 10**6,))
        with h5py.File("m.mat", "w", userblock_size=512) as file:
            file["t"] = T4[None, :]
            file["q"] = Q42.T
        mat = Path("m.mat").read_bytes()
        Path("m.mat").write_bytes(b"MATLAB 7.3 MAT-file" + mat[19:])
        found["hdf5"] = read_arrays("a.h5")
        found["matlab"] = read_arrays("m.mat")
    return found


@record
def file_of_parquet_read_in_a_child(folder):
    import pyarrow as pa
    from pyarrow import parquet

    with contextlib.chdir(folder):
        parquet.write_table(
            pa.table(
                {
                    "timestamp": T4,
                    "observation.state": [[0.1], [0.2], [0.3], [0.4]],
                    "episode_index": [3, 3, 5, 5],
                    "t2": [1.0, 2.0, np.nan, 3.0],
                }
            ),
            "e.parquet",
        )
        path = Path("e.parquet")
        limits = child_readers._limits(path)
        size = path.stat().st_size
        return {
            "in this process": [
                child_readers.head_of_arrays("e.parquet", 5)[::2],
                list(child_readers.rows_of_arrays("e.parquet", 3, (2, 0))),
            ],
            "in a child": outcome(lambda: summary(child_readers.array_file_in_child(path, 5), [0, 1])),
            "errors": [
                outcome(child_readers.array_file_in_child, path, 4),
                outcome(lambda: child_readers.array_file_in_child(path, 5).table([0, 3])),
            ],
            "limits": [round((limits.seconds - 30) / size, 9), (limits.memory - 2**30) / size, limits.output / 2**29],
        }


def pair(folder, one, other, names="one.csv+two.csv"):
    first, second = names.split("+")
    Path(first).write_text(one)
    Path(second).write_text(other)

    def read():
        file = open_motion_file(names)
        if isinstance(file, JoinedFile):
            file.check_columns()
        columns = range(len(file.header))
        return {
            "header": file.header,
            "notes": file.notes,
            "table": outcome(file.table, list(columns)),
            "other order": outcome(file.table, list(columns)[::-1]),
            "first": file.first(len(file.header) - 1),
            "place": file.place(3),
            "text": motion_file.text_columns(file),
        }

    return outcome(read)


def pair_sum():
    Path("sum.csv").write_text("time,J2 [deg],J3 [deg]\n0,10,20\n1,11,25\n")
    return summary(motion_file.with_sums(open_motion_file("sum.csv"), {"a": "J3-J2"}))


def arrays_in_a_folder():
    np.savez("opened.npz", t=T4, q=Q42)
    opened = open_motion_file("opened.npz")
    return [opened.header, motion_file.text_columns(opened), outcome(open_motion_file, "opened.npz", episode=3)]


@record
def files_joined_by_columns(folder):
    a = "time,x,y\n0,1,10\n0.5,2,20\n1,3,40\n1.5,5,50\n"
    with contextlib.chdir(folder):
        return {
            "same stamps": pair(folder, a, "z,time\n7,0\n8,0.5\n9,1\n11,1.5\n"),
            "nearly the same": pair(folder, a, "time,z\n0,7\n0.5000009,8\n1,9\n1.5,11\n"),
            "other stamps": pair(folder, a, "stamp [ms],z\n250,7\n750,8\n1400,10\n"),
            "apart": pair(folder, a, "time,z\n2,7\n3,8\n"),
            "without time": pair(folder, "x,y\n1,2\n3,4\n", "z\n5\n6\n"),
            "without time, unequal": pair(folder, "x,y\n1,2\n3,4\n", "z\n5\n"),
            "words in unused columns": [motion_file.text_columns(open_motion_file("one.csv+two.csv")) for _ in [pair(folder, "time,x,s\n0,1,RUN\n1,2,RUN\n", "time,u,y\n0,a,1\n1,b,2\n")]],
            "sums of a text": pair_sum(),
            "arrays": arrays_in_a_folder(),
            "time in one": pair(folder, a, "z\n5\n6\n7\n8\n"),
            "the same columns": pair(folder, a, a),
            "quantities in names": pair(folder, a, a.replace("0,1,10", "0,1.5,10.5"), "pos_data.csv+curr_data.csv"),
            "units and quantities": pair(folder, "time,x [deg]\n0,1\n1,2\n", "time,x [deg]\n0,3\n1,5\n", "a_position.csv+a_velocity.csv"),
            "words": pair(folder, "time,x,s\n0,1,RUN\n1,2,RUN\n", "time,x,u\n0,1,a\n1,2,b\n"),
            "since 1970": pair(folder, "t,x\n1.5e9,1\n1500000001,2\n", "t,z\n1500000000500,1\n1500000001500,3\n"),
            "one name": outcome(open_motion_file, "one.csv+"),
            "topic of text": outcome(open_motion_file, "one.csv", topic="/j"),
            "episode of text": outcome(open_motion_file, "one.csv", episode=2),
            "commands of arrays": outcome(open_motion_file, "a.npz", command_topic="/c"),
            "motors": [moves_motors("one.csv"), moves_motors("none.csv"), moves_motors(ArrayFile.from_table(Path("m"), ["time", "a.motor "], np.zeros((1, 2)), 1))],
            "absent joints": outcome(joints_without_column, "one.csv", CRANE.model, {"spin": "u"}),
        }  # fmt: skip


@record
def sums_of_columns():
    def summed(columns, header=("time", "J2 [deg]", "J3 [deg]", "x", "y-z")):
        file = ArrayFile.from_table(Path("log.csv"), header, np.arange(15.0).reshape(3, 5) ** 2, 120)
        changed = motion_file.with_sums(file, columns)
        return summary(changed) | {"same": changed is file, "pair": changed.table([len(changed.header) - 1, 1])}

    cases = [
        {"a": "J3+J2"},
        {"a": "J3-J2"},
        {"a": "-J3"},
        {"a": "-J3+J2-J2", "b": "x+x"},
        {"a": "J3+x"},
        {"a": "y-z"},
        {"a": "J3+q"},
        {"a": "J3 [deg]+J2"},
        {},
    ]
    return {str(c): outcome(summed, c) for c in cases}


@record
def rows_of_one_time():
    base = np.array(
        [
            [0.0, 1.0, 0.5],
            [1.0, 2.0, 0.6],
            [1.0, 2.0, 0.6],
            [2.0, 3.0, 0.7],
            [2.0, 3.5, 0.9],
            [2.0, 3.25, 0.8],
            [3.0, 4.0, 1.0],
            [4.0, 5.0, -3.0],
            [4.0, 5.0, 0.0],
        ]
    )

    def merged(rows, half_turn=np.pi):
        duplicates = DuplicateTimestamps()
        table = duplicates.merge(rows.copy(), np.array([2]), np.array([half_turn]), "log.csv")
        return {"table": table, "counts": vars(duplicates), "doubts": duplicates.doubts()}

    grid = np.floor(np.arange(60) * 0.4 + 0.1) * 0.01
    paused = np.r_[grid, grid + 1.0]
    return {
        "merged": outcome(merged, base), "half a turn exceeded": outcome(merged, base, 2.9), "none": outcome(merged, base[[0, 1, 3]]), "repeated only": outcome(merged, base[:4]),
        "steady": [None if (t := steady_times(stamps)) is None else t for stamps in (grid, grid[:21], grid[:20], paused, np.r_[grid, grid[:15] + 1], grid[::-1], np.arange(60) * 0.01, np.r_[np.arange(55) * 0.01, [0.54]], grid + 0.003 * (np.arange(60) % 7 == 0), np.zeros(30), np.repeat(np.sqrt(np.arange(30.0)), 2), np.floor(np.arange(60) ** 1.1 * 0.3) * 0.01, 1.7e9 + grid)],
        "slices": [list(map(str, spread_rows(*c))) for c in ((100, 3, 10), (30, 3, 10), (29, 3, 10), (31, 3, 10), (31, 1, 10), (5, 0, 4))],
        "excerpts": excerpts(np.arange(24.0).reshape(12, 2), 2, 3),
        "windows": [[(w.start, w.stop, c.start, c.stop) for w, c in windows(*c)] for c in ((20, 6, 2), (19, 6, 2), (20, 6, 0), (5, 9, 3), (0, 3, 1))],
        "ratio": [outcome(check_ratio, Path("x"), *c) for c in ((2**28, 1), (2**28 + 1, 1), (2**30, 2**24), (101 * 2**24, 2**24))],
    }  # fmt: skip


def whole(motion):
    """All that a motion has, short if it is usual."""
    fields = {
        name: getattr(motion, name) for name in ("time", "q", "tau", "command", "notes", "plan", "epoch", "derived")
    }
    if motion.derived != "positions":
        fields["dq"] = motion.dq
    if not motion.derived:
        fields["ddq"] = motion.ddq
    if motion.doubts:
        fields["doubts"] = [(d.kind, d.level, d.joints, d.sentence, d.value, d.unit) for d in motion.doubts]
    fields["instants"] = motion.instants
    if motion.log:
        fields["log"] = [str(motion.log.origin), motion.log.unused, motion.log.columns.counted, motion.log.size]
    return {
        name: value
        for name, value in fields.items()
        if value is not None and (not hasattr(value, "__len__") or len(value))
    }


def read_motion(text, robot=CRANE, name="run.csv", **options):
    Path(name).write_text(text)
    return outcome(lambda: whole(tw.Motion.from_file(name, robot, **options)))


def rows_of(t, *columns, start=0):
    return "".join(",".join(f"{x:.6g}" for x in row) + "\n" for row in zip(t, *columns, strict=True))


T = np.arange(13) * 0.05
CURVES = [0.3 * np.sin(2 * T), -0.5 + 0.4 * T**2, 1.5 * T, 0.2 - 0.3 * np.cos(3 * T)]
NAMES = "zslide,boom_joint,spin,a_tilt"


@record
def motions_from_text_files(folder):
    degrees = [100 * CURVES[0], *[np.degrees(c) for c in CURVES[1:]]]
    rates = [np.gradient(c, T) for c in CURVES]
    plain = f"time,{NAMES}\n" + rows_of(T, *CURVES)
    with contextlib.chdir(folder):
        return {
            "plain": read_motion(plain),
            "plan": read_motion(plain, plan=True),
            "units": read_motion("t [ms],zslide [cm],boom_joint [deg],spin [deg],a_tilt [deg],odd\n" + rows_of(1000 * T, *degrees, T)),
            "degrees": read_motion(f"time,{NAMES},claw\n" + rows_of(T, CURVES[0], *degrees[1:], -0.7 * degrees[3] + np.degrees(0.3)), degrees=True),
            "follower off": read_motion(f"time,{NAMES},claw\n" + rows_of(T, *CURVES, -0.7 * CURVES[3] + 0.3 + 0.25 * T)),
            "follower nearly": read_motion(f"time,{NAMES},claw\n" + rows_of(T, *CURVES, -0.7 * CURVES[3] + 0.3 + 0.018 * (T > 0.3))),
            "rates and torques": read_motion(f"time,{NAMES},{','.join(n + '.vel' for n in NAMES.split(','))},{','.join(n + '.current [mA]' for n in NAMES.split(','))},spin.command,zslide.command\n" + rows_of(T, *CURVES, *rates, *[1000 * c for c in CURVES], CURVES[2] + 0.01, CURVES[0] - 0.02), gain={"zslide": 20.0, "boom_joint": 3.0, "spin": 0.5, "a_tilt": 0.25}),
            "no time": read_motion(f"{NAMES}\n" + rows_of(*CURVES), rate=125.0),
            "row numbers": read_motion(f"time,{NAMES}\n" + rows_of(np.arange(13), *CURVES), rate=125.0),
            "since 1970": read_motion(f"stamp,{NAMES}\n" + "".join(f"{1700000000 + t:.2f},{a:.4f},{b:.4f},{c:.4f},{d:.4f}\n" for t, a, b, c, d in zip(T, *CURVES, strict=True))),
            "backwards": read_motion(f"time,{NAMES}\n" + rows_of(np.r_[T[:7], T[5:11]], *CURVES)),
            "repeated": read_motion(f"time,{NAMES}\n" + rows_of(np.r_[T[:7], T[6:12]], *[np.r_[c[:7], c[6], c[7:12]] for c in CURVES])),
            "averaged": read_motion(f"time,{NAMES}\n" + rows_of(np.r_[T[:7], T[6:12]], *CURVES)),
            "other columns": read_motion("time,c1,c2,c3,c4\n" + rows_of(T, *CURVES), columns={"#1": "c1", "#2": "c2", "#3": "c4", "#4": "c3 [deg]"}),
            "locked": read_motion("time,zslide,boom_joint,a_tilt,spin,moves\n" + rows_of(T, *CURVES, T), CRANE.lock({"spin": 0.1})),
            "locked without column": read_motion("time,zslide,boom_joint,a_tilt,moves,stands\n" + rows_of(T, *CURVES[:3], T, 0 * T), CRANE.lock({"spin": 0.1})),
            "no rows": read_motion(f"time,{NAMES}\n"),
            "five rows": read_motion(f"time,{NAMES}\n" + rows_of(T[:5], *[c[:5] for c in CURVES])),
            "six rows": read_motion(f"time,{NAMES}\n" + rows_of(T[:6], *[c[:6] for c in CURVES])),
            "bad rate": [read_motion(plain, rate=r) for r in (0.0, -1.0, float("nan"))],
            "in the order of the caller": read_motion("time,c1,c2,c3,c4\n" + rows_of(T, CURVES[0], CURVES[1], CURVES[2] + 0.3 * (T[7] == T), CURVES[3]), columns={f"#{k}": f"c{k}" for k in (1, 2, 3, 4)}),
            "motors": read_motion(f"time,{NAMES},zslide.tau,boom_joint.tau,m_left.tau,m_right.tau\n" + rows_of(T, *CURVES, *CURVES), GEARED),
            "zero quaternion": read_motion("time,sway.x,sway.y,sway.theta,mast_joint,free.qw,free.qx,free.qy,free.qz,free.x,free.y,free.z\n" + rows_of(T, *[CURVES[k % 4] for k in range(4)], *[(T != 0.25) * (0.5 + T)] * 4, *CURVES[:3]), RAFT),
            "raft": read_motion("time,sway.x,sway.y,sway.theta [deg],mast_joint,free.qw,free.qx,free.qy,free.qz,free.x [mm],free.y,free.z\n" + rows_of(T, *[CURVES[k % 4] for k in range(4)], np.cos(T), 0.6 * np.sin(T), 0 * T, -0.8 * np.sin(T), *CURVES[:3]), RAFT),
        }  # fmt: skip


@record
def motions_with_rounded_stamps(folder):
    n = 45
    t = np.floor(np.arange(n) * 0.4 + 0.1) * 0.01
    k = np.arange(n) * 0.004
    rough = [0.3 * np.sin(9 * k), -0.5 + 4 * k**2, 5 * k, 0.2 - 0.3 * np.cos(8 * k)]
    repeats = np.arange(n) // 2 * 2
    with contextlib.chdir(folder):
        return {
            "rounded": read_motion(f"time,{NAMES}\n" + rows_of(t, *rough)),
            "repeated": read_motion(f"time,{NAMES}\n" + rows_of(t[repeats], *[c[repeats] for c in rough])),
            "seconds by name": read_motion(f"secs,{NAMES}\n" + rows_of(np.arange(n), *rough)),
            "unnamed seconds": read_motion(f"t,{NAMES}\n" + rows_of(np.arange(n), *rough)),
        }


@record
def motion_logs_without_files():
    motion = tw.Motion(T, np.stack(CURVES, 1), robot=CRANE, tau=np.stack(CURVES[::-1], 1))
    given = tw.Motion(T, motion.q, motion.dq, motion.ddq, robot=CRANE, tau=motion.tau, plan=True)
    velocities = tw.Motion(T, motion.q, motion.dq, robot=CRANE)
    found = {}
    for name, m in (("positions", motion), ("all", given), ("velocities", velocities)):
        log = MotionLog.from_motion(m)
        found[name] = {
            "header": log.file.header,
            "table": log.table,
            "plan": log.plan,
            "origin": str(log.origin),
            "rows": [x is not None for x in vars(log.motion(log.table)).values()],
        }
    log = MotionLog.from_motion(motion)
    own = CRANE.limits
    found["log"] = {
        "locked": log.locked_without_column,
        "notes": log.notes,
        "path": log.path,
        "size": log.size,
        "doubts": log.doubts(own, own=own),
    }
    found["no joints"] = outcome(MotionLog.open, log.file, CRANE.lock(dict.fromkeys(CRANE.joint_names, 0.1)).model)
    return found


NAMES2 = ["elbow", "ankle"]
TIME6 = np.array([0.0, 0.004, 0.01, 0.0165, 0.02, 0.025])
Q6 = np.stack([np.sin(40 * TIME6), 1 - np.cos(30 * TIME6)], 1)
DQ6 = np.stack([40 * np.cos(40 * TIME6), 30 * np.sin(30 * TIME6)], 1)
DDQ6 = np.stack([-1600 * np.sin(40 * TIME6), 900 * np.cos(30 * TIME6)], 1)


def joint_state(t, names, q, dq=(), tau=(), date=0):
    return t, {
        "header": ros_header(t, date),
        "name": list(names),
        "position": list(map(float, q)),
        "velocity": list(map(float, dq)),
        "effort": list(map(float, tau)),
    }


def read_recording(path, **options):
    return outcome(lambda: summary(ros_file(Path(path), **options)))


@record
def recordings_of_ros(folder):
    date = 1_600_000_000
    states = [joint_state(t, NAMES2, q, dq, tau, date) for t, q, dq, tau in zip(TIME6, Q6, DQ6, DDQ6, strict=True)]
    states.insert(2, joint_state(0.007, ["elbow"], [0.5], date=date))
    turned = [
        joint_state(t, [*NAMES2[::-1], "toe"], [*q[::-1], 9.0], date=date)
        for t, q in zip(TIME6[2:], Q6[2:], strict=True)
    ]
    commands = [
        joint_state(t, NAMES2[::-1], q + 0.5, date=date) for t, q in zip(TIME6[1::2] + 0.001, Q6[1::2], strict=True)
    ]
    late = [joint_state(t + 9, NAMES2, q, date=date) for t, q in zip(TIME6, Q6, strict=True)]
    back = [joint_state(t, NAMES2, q, date=date) for t, q in zip(TIME6[::-1], Q6, strict=True)]
    control = [
        (t, {"header": ros_header(t, date), "joint_names": NAMES2, "reference": point(t, q + 1, dq + 1, ddq), "feedback": point(t, q, dq, [], ddq), "error": point(t), "output": point(t)})
        for t, q, dq, ddq in zip(TIME6, Q6, DQ6, DDQ6, strict=True)
    ]  # fmt: skip
    kinds = ("sensor_msgs/msg/JointState", JOINT_STATE)
    text = ("std_msgs/msg/String", "string data\n", [(0.0, {"data": "x"})] * 9)
    whole_plan = plan(NAMES2, TIME6, Q6, DQ6, DDQ6)
    short = plan(NAMES2, TIME6[:4], Q6[:4], DQ6[:4])
    plans = {
        "quintic": whole_plan, "cubic": plan(NAMES2, TIME6, Q6, DQ6), "positions": plan(NAMES2, TIME6, Q6), "few positions": plan(NAMES2, TIME6[:5], Q6[:5]), "one point": plan(NAMES2, TIME6[:1], Q6[:1]),
        "backwards": plan(NAMES2, TIME6[[0, 2, 2, 3]], Q6[:4], DQ6[:4]), "no positions": plan(NAMES2, TIME6, Q6[:, :1]), "nan": plan(NAMES2, TIME6, Q6, np.where(DQ6[2] == DQ6, np.nan, DQ6)),
    }  # fmt: skip
    mixed = plan(NAMES2, TIME6, Q6, DQ6, DDQ6)
    mixed["points"][3]["accelerations"] = []
    plans["mixed"] = mixed
    found = {}
    with contextlib.chdir(folder):
        write_messages(
            "states.mcap",
            {
                "/a": (*kinds, states),
                "/b": (*kinds, turned),
                "/c": (*kinds, commands),
                "/late": (*kinds, late),
                "/back": (*kinds, back[:2]),
                "/text": text,
            },
        )
        found["most messages"] = read_recording("states.mcap")
        found["topic"] = read_recording("states.mcap", topic="/b")
        found["commands"] = read_recording("states.mcap", topic="/a", command_topic="/c")
        found["wrong"] = [
            read_recording("states.mcap", **o)
            for o in (
                {"topic": "/text"},
                {"topic": "/a:reference"},
                {"command_topic": "/no"},
                {"command_topic": "/late"},
                {"command_topic": "/back"},
                {"command_topic": "/text"},
            )
        ]
        write_messages(
            "control.mcap",
            {"/ctrl": (CONTROLLER_STATE, controller_state("new") + POINT + HEADER, control), "/c": (*kinds, commands)},
        )
        found["controller"] = read_recording("control.mcap")
        found["reference"] = read_recording("control.mcap", topic="/ctrl:reference")
        found["controller and commands"] = read_recording("control.mcap", topic="/ctrl:other", command_topic="/c")
        for name, message in plans.items():
            write_messages(
                "plan.mcap", {"/p": ("trajectory_msgs/msg/JointTrajectory", PLAN + POINT + HEADER, [(0.5, message)])}
            )
            found[name] = read_recording("plan.mcap")
        write_messages(
            "two.mcap",
            {
                "/p": (
                    "trajectory_msgs/msg/JointTrajectory",
                    PLAN + POINT + HEADER,
                    [(0.5, short), (0.6, whole_plan), (0.7, short)],
                ),
                "/c": (*kinds, commands),
            },
        )
        found["longest of three"] = read_recording("two.mcap", topic="/p")
        found["plan and commands"] = read_recording("two.mcap", topic="/p", command_topic="/c")
        shown = {
            "model_id": "r",
            "trajectory": [
                {"joint_trajectory": short},
                {"joint_trajectory": short},
                {"joint_trajectory": plan(["x"], [0.1], [[1.0]])},
            ],
        }
        write_messages("shown.mcap", {"/p": ("moveit_msgs/msg/DisplayTrajectory", SHOWN_PLAN, [(0.5, shown)])})
        found["in parts"] = read_recording("shown.mcap")
        write_messages("text.mcap", {"/text": text})
        found["no motion"] = read_recording("text.mcap")
        write_messages("empty.mcap", {})
        found["nothing"] = read_recording("empty.mcap")
        found["absent"] = read_recording("no.mcap")
    found["stamp"] = stamp(1.5)
    return found  # fmt: skip


@record
def databases_of_ros(folder):
    states = [joint_state(t, NAMES2, q, [], tau) for t, q, tau in zip(TIME6, Q6, DDQ6, strict=True)]
    found = {}
    with contextlib.chdir(folder):
        topics = {
            "/j": ("sensor_msgs/msg/JointState", states),
            "/p": ("trajectory_msgs/msg/JointTrajectory", [(1.0, plan(NAMES2, TIME6, Q6, DQ6, DDQ6))]),
        }
        write_database(Path("a.db3"), topics, typestore(), definitions=False)
        found["most"] = read_recording("a.db3")
        found["plan"] = read_recording("a.db3", topic="/p")
    return found


@record
def points_of_plans():
    ddq = DDQ6.copy()
    ddq[2, 1] = np.nan
    return {
        "quintic and cubic": between_points(TIME6, Q6, DQ6, ddq, 0.002)[:, :5],
        "at the points": between_points(TIME6[:3], Q6[:3, :1], DQ6[:3, :1], DDQ6[:3, :1], 0.0020004),
        "near a point": between_points(TIME6[:3], Q6[:3, :1], DQ6[:3, :1], DDQ6[:3, :1], 0.0019996),
    }


@record
def rows_in_small_blocks(folder):
    """A log in many blocks and in one, and tables that are too large for the memory: nothing depends on it."""
    k = np.arange(70)
    columns = [0.3 * np.sin(0.1 * k), -0.5 + 1e-4 * k**2, 0.03 * k + 0.2 * (k == 33), 0.2 - 0.3 * np.cos(0.08 * k)]
    t = k * 0.02 + 0.011 * (k == 52) - 0.02 * (k > 40)
    text = f"time,{NAMES},claw\n# x\n" + rows_of(t, *columns, 0.3 - 0.7 * columns[3] + 0.2 * (k == 60))
    found = {}
    with contextlib.chdir(folder):
        for name, rows, block, memory in (
            ("one", log_table.ROWS, csv_reader._BLOCK_SIZE, log_table.MAX_TABLE_IN_MEMORY),
            ("many", 13, 64, 256),
            ("other", 41, 1000, 99999),
        ):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(log_table, "ROWS", rows)
                patch.setattr(csv_reader, "_BLOCK_SIZE", block)
                patch.setattr(log_table, "MAX_TABLE_IN_MEMORY", memory)
                Path("run.csv").write_text(text)
                log = MotionLog.open("run.csv", CRANE.model, rate=None)
                found[name] = [
                    np.array(log.table),
                    log.notes,
                    [[d.kind, d.sentence] for d in log.doubts()],
                    log.instants,
                    type(log.table).__name__,
                ]
                Path("run.csv").write_text(text + "9.0,0,0,x,0,0\n")
                found[f"{name}, error"] = outcome(lambda: MotionLog.open("run.csv", CRANE.model).table)
                Path("run.csv").write_text(text + "0.5,0,0,0,0,0\n")
                found[f"{name}, order"] = outcome(lambda: MotionLog.open("run.csv", CRANE.model).table)
                found[f"{name}, counted"] = outcome(
                    lambda: np.array(
                        MotionLog.open(
                            ArrayFile.from_table(Path("x"), NAMES.split(","), np.stack(columns, 1), 9),
                            CRANE.model,
                            rate=50.0,
                        ).table
                    )
                )
                Path("b.csv").write_text("time,z\n" + "".join(f"{0.3 + 0.07 * k},{k * k}\n" for k in range(9)))
                Path("run.csv").write_text(text)
                joined = open_motion_file("run.csv+b.csv")
                found[f"{name}, joined"] = joined.table([0, 2, len(joined.header) - 1])
                found[f"{name}, without"] = log_table.without_times(np.c_[t, k].astype(float), t[[3, 20, 69]])[:, 1]
        return found


@record
def bounds_on_recordings(folder):
    def database(name, *statements, bound=None):
        with contextlib.closing(sqlite3.connect(name)) as made:
            for statement in statements:
                made.execute(statement)
            made.commit()

        def read():
            with recording_bounds.recording_database(Path(name)) as opened:
                if bound:
                    opened.execute(bound).fetchall()
                return sorted(row[0] for row in opened.execute("select name from sqlite_master where type = 'table'"))

        return outcome(read)

    with contextlib.chdir(folder):
        found = {
            "plain": database("a.db3", "create table topics (id, name, type)", "create table messages (id, topic_id, data)", "create table other (x)"), "view": database("b.db3", "create table t (id)", "create view topics as select * from t"), "computed": database("c.db3", "create table topics (id, twice generated always as (id * 2))", "create view messages as select 1"),
            "computed alone": database("d.db3", "create table messages (id, twice generated always as (id * 2), thrice generated always as (id * 3) stored)"), "virtual": database("e.db3", "create virtual table topics using fts5(name)"), "many steps": database("f.db3", "create table topics (id)", bound="with recursive c(x) as (select 1 union all select x + 1 from c where x < 9000000) select count(*) from c"),
        }  # fmt: skip
        path = Path("a.db3")
        found["values"] = [
            outcome(lambda n=n: len(recording_bounds.values_within([b"x" * 2**19] * n, path))) for n in (2, 3)
        ]
        with recording_bounds.BoundedFile(path) as file:
            found["reads"] = [
                len(file.read(7)),
                len(file.read(10**9)) == path.stat().st_size - 7,
                len(file.read()),
                len(file.read(5)),
                file.seek(3),
                len(file.read()) == path.stat().st_size - 3,
            ]
        import zstandard

        Path("x.zstd").write_bytes(zstandard.ZstdCompressor().compress(b"0" * 1000))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(log_table, "FREE_UNPACKED_SIZE", 900)
            patch.setattr(log_table, "MAX_RATIO", 10)
            found["packed"] = outcome(recording_bounds._check_packed, Path("x.zstd")).split(" MiB")[1:]
        write_messages(
            "s.mcap",
            {
                "/a": (
                    "sensor_msgs/msg/JointState",
                    JOINT_STATE,
                    [joint_state(t, NAMES2, q) for t, q in zip(TIME6, Q6, strict=True)],
                )
            },
        )
        found["recording"] = [
            x if isinstance(x, np.ndarray) else x[::2] for x in child_readers.recording("s.mcap", "/a", "/a")
        ]
        Path("folder").mkdir()
        Path("folder/a.db3").write_bytes(Path("b.db3").read_bytes())
        found["folder"] = outcome(recording_bounds.check_folder, Path("folder"))
        found["sizes"] = [child_readers._limits(Path(p)).output for p in ("folder", "none")]
    return found


@record
def archives_of_simulations(folder):
    said = {"coordinate_names": ["a", "b.x"], "velocity_names": ["a", "b.w"]}
    arrays = {"times": T4, "q": Q42, "dq": 2 * Q42, "ddq": 3 * Q42, "tau": 4 * Q42, "said": json.dumps(said)}
    with contextlib.chdir(folder):
        np.savez("sim.npz", format="twistwrench simulation 1", **arrays)
        np.savez("big.npz", format=np.array("twistwrench simulation 1").astype(">U24"), **arrays)
        np.savez("other.npz", format="another", **arrays)
        np.savez("numbers.npz", format=np.arange(3.0), t=T4, x=T4 * 2)
        np.savez("lacks.npz", format="twistwrench simulation 1", times=T4)
        for name in ("sim", "other"):
            Path(f"{name}.dat").write_bytes(Path(f"{name}.npz").read_bytes())
        with Path("second.npy").open("wb") as file:
            np.lib.format.write_array(file, Q42, version=(2, 0))
        found = {
            name: read_arrays(name)
            for name in ("sim.npz", "big.npz", "other.npz", "numbers.npz", "sim.dat", "other.dat", "second.npy")
        }
        found["lacks"] = read_arrays("lacks.npz").partition(":")[0]
        found["plan"] = open_motion_file("sim.npz").plan
        return found


@record
def damaged_files_of_matlab(folder):
    from scipy.io import savemat

    found = {}
    with contextlib.chdir(folder):
        for version in ("5", "4"):
            savemat("a.mat", {"t": T4, "q": Q42}, format=version)
            data = Path("a.mat").read_bytes()
            for offset in range(128 if version == "5" else 0, 208 if version == "5" else 60, 4):
                Path("b.mat").write_bytes(data[:offset] + b"\x07\0\0\0" + data[offset + 4 :])
                result = read_arrays("b.mat")
                found[f"{version} {offset}"] = (
                    result.partition("mat: ")[2].partition(". The file")[0] or result[:60]
                    if isinstance(result, str)
                    else [result["header"], result["table"]]
                )
        savemat("p.mat", {"t": T4, "q": Q42}, do_compression=True)
        data = Path("p.mat").read_bytes()
        Path("p.mat").write_bytes(data[:-6])
        found["packed"] = re.sub(r"\d+", "#", read_arrays("p.mat"))
    return found


@record
def tables_of_arrow_in_portions(folder):
    import pyarrow as pa
    from pyarrow import feather

    table = pa.table(
        {
            "t": T4,
            "lists": [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], None],
            "words": [["a"], ["b"], ["c"], ["d"]],
            "empty": [[], [1.0], [2.0], [3.0]],
            "short": [[1.0], [2.0, 3.0], [4.0], [5.0]],
            "whole": [[1, 2], [3, 4], [5, 6], [7, 8]],
        }
    )
    with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
        feather.write_feather(table, "a.feather", chunksize=1)
        feather.write_feather(table.slice(0, 0), "none.feather")
        found = {"whole": read_arrays("a.feather"), "none": read_arrays("none.feather")}
        patch.setattr(log_table, "ROWS", 3)
        found["portions"] = read_arrays("a.feather")
        missing = pa.table({"timestamp": T4, "episode_index": [0.0, None, 1.0, 1.0]})
        feather.write_feather(missing, "m.feather")
        found["missing episode"] = read_arrays("m.feather")
        feather.write_feather(pa.table({"timestamp": T4, "episode_index": [2, 2, 2, 2]}), "one.feather")
        found["one episode"] = read_arrays("one.feather")
    return found


@record
def readers_chosen_by_the_sandbox(folder):
    given = []
    with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
        for name in ("array_file", "array_file_in_child", "ros_file_in_child"):
            patch.setattr(
                child_readers,
                name,
                lambda *p, name=name: given.append([name, *[str(getattr(x, "path", x)) for x in p]]),
            )
        from twistwrench.motion.readers import ros_recordings

        patch.setattr(ros_recordings, "ros_file", lambda *p: given.append(["ros_file", *map(str, p)]))
        for value in (True, False):
            patch.setattr(child_readers, "sandboxed", lambda value=value: value)
            for name, start in (
                ("a.npz", b""),
                ("a.parquet", b""),
                ("a.H5", b""),
                ("a.mat", b"MATLAB 5.0"),
                ("b.mat", b"\x89HDF"),
                ("c.mat", b"MATLAB 7.3"),
            ):
                child_readers.arrays_file(FileEnds(Path(name), start), 4)
            child_readers.recording_file(FileEnds(Path("a.mcap")), "t", "c")
    return given


@record
def texts_between_their_ends(folder):
    text = "t,a\n" + "".join(f"{k},{k * k}\n" for k in range(40))
    with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
        patch.setattr(file_ends, "_START_SIZE", 32)
        patch.setattr(file_ends, "_END_SIZE", 24)
        Path("a.csv").write_text(text)
        ends = FileEnds.from_path(Path("a.csv"))
        with ends.open() as stream:
            whole = stream.read().decode() == text
            stream.seek(-9, os.SEEK_END)
            end = stream.read().decode()
            stream.seek(20)
            stream.seek(5, os.SEEK_CUR)
            middle = stream.read(30).decode()
        os.mkfifo("pipe")
        writer = threading.Thread(target=lambda: Path("pipe").write_bytes(gzip.compress(b"t,a\n0.5,1\n", mtime=0)))
        writer.start()
        piped = read_text("pipe")
        writer.join()
        return {
            "ends": [ends.start.decode(), ends.end.decode(), ends.size],
            "whole": whole,
            "parts": [end, middle],
            "after": [ends.after(0).decode()[:4], ends.after(ends.size - 5).decode()],
            "read": read_text("a.csv"),
            "pipe": piped,
            "none": vars(FileEnds.from_path(Path("no"))) | {"path": "", "start": "", "end": ""},
        }


@record
def bags_of_ros(folder):
    states = [joint_state(t, NAMES2, q, [], tau) for t, q, tau in zip(TIME6, Q6, DDQ6, strict=True)]
    bare = [joint_state(t, NAMES2, []) for t in TIME6]
    kind = "sensor_msgs/msg/JointState"
    with contextlib.chdir(folder):
        write_folder(Path("bag"), {"/j": (kind, states), "/n": (kind, bare[:2])}, typestore())
        write_ros1(Path("one.bag"), kind, states, topic="/j")
        write_database(Path("d.db3"), {"/j": (kind, states)}, typestore())
        write_messages("bare.mcap", {"/n": (kind, JOINT_STATE, bare)})
        return {
            "folder": read_recording("bag"),
            "first": read_recording("one.bag"),
            "own definitions": read_recording("d.db3"),
            "bare": read_recording("bare.mcap"),
            "formats": [format_of(Path("bag")) is not None, format_of(Path("bag/x")) is None],
        }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
