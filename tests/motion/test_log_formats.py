"""One motion in every format that logs come in gives the same states."""

from __future__ import annotations

import json
import struct
from functools import partial

import numpy as np
import pytest
from click.testing import CliRunner
from ros_logs import write_bag, write_mcap

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.motion.readers.file_ends import FileEnds
from twistwrench.motion.readers.mat_files import read_mat

ARM = tw.robots.planar_2r()
TIME = np.arange(50) * 0.01
Q = np.stack([np.sin(3 * TIME), np.cos(2 * TIME)], axis=1)
TAU = np.stack([TIME, -(TIME**2)], axis=1)
NAMES = ARM.joint_names


def columns():
    found = {"time": TIME}
    found |= {name: Q[:, k] for k, name in enumerate(NAMES)}
    return found | {f"{name}.torque": TAU[:, k] for k, name in enumerate(NAMES)}


def write_npz(path):
    np.savez(path, time=TIME, q=Q, tau=TAU, remark=np.array("a log"))


def write_npy(path):
    kinds = [(name, float) for name in columns()]
    rows = np.zeros(len(TIME), kinds)
    for name, values in columns().items():
        rows[name] = values
    np.save(path, rows)


def write_mat(path):
    from scipy.io import savemat

    savemat(path, {"t": TIME[:, None], "q": Q, "tau": TAU})


def write_hdf5(path):
    with pytest.importorskip("h5py").File(path, "w") as file:
        file["time"], file["joint_states/position"], file["joint_states/effort"] = TIME, Q, TAU


def write_parquet(path):
    pytest.importorskip("pyarrow")
    import pyarrow

    write_table(pyarrow.table(columns() | {"mode": ["run"] * len(TIME)}), path)


def write_table(table, path):
    import pyarrow.feather
    import pyarrow.parquet

    (pyarrow.parquet.write_table if path.suffix == ".parquet" else pyarrow.feather.write_feather)(table, path)


@pytest.fixture(params=["whole", "in blocks"])
def reading(request, monkeypatch):
    """Small tables are in memory; large ones in a temporary file, as all are here where the bound is taken away."""
    if request.param == "in blocks":
        for place in ("motion.log_table.MAX_TABLE_IN_MEMORY", "reports.log_quality.MAX_TABLE_IN_MEMORY"):
            monkeypatch.setattr(f"twistwrench.{place}", 0)
        monkeypatch.setattr("twistwrench.motion.log_table.ROWS", 7)


FORMATS = {
    "log.npz": write_npz, "log.npy": write_npy, "log.mat": write_mat, "log.h5": write_hdf5, "log.parquet": write_parquet,
    "log.feather": write_parquet, "log.mcap": partial(write_mcap, names=NAMES, time=TIME, q=Q, tau=TAU),
    "bag": partial(write_bag, names=NAMES, time=TIME, q=Q, tau=TAU),
}  # fmt: skip


@pytest.mark.usefixtures("reading")
@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_motion(name, tmp_path):
    FORMATS[name](tmp_path / name)
    motion = tw.Motion.from_file(tmp_path / name, ARM)
    assert np.allclose(motion.time - motion.time[0], TIME, atol=1e-12)
    assert (motion.q == Q).all() and (motion.tau == TAU).all()


@pytest.mark.parametrize("name", ["log.npz", "log.npy", "log.mat", "log.h5", "log.parquet", "log.feather", "log.mcap"])
def test_a_file_cut_short_is_one_clear_error(name, tmp_path):
    FORMATS[name](tmp_path / name)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: len(whole) // 3])
    with pytest.raises(tw.TrajectoryError, match=name):
        tw.Motion.from_file(tmp_path / name, ARM)


def test_a_plain_array_is_told_by_columns(tmp_path):
    np.save(tmp_path / "log.npy", np.column_stack([TIME, Q]))
    told = {"time": "column1", "joint1": "column2", "joint2": "column3"}
    assert (tw.Motion.from_file(tmp_path / "log.npy", ARM, columns=told).q == Q).all()


@pytest.mark.parametrize(
    "filters",
    [
        {"compression": "gzip"}, {"compression": "gzip", "shuffle": True}, {"compression": "lzf"}, {"fletcher32": True},
        {"compression": "lzf", "shuffle": True, "fletcher32": True},
    ],
    ids=str,
)  # fmt: skip
def test_datasets_packed_by_filters_of_hdf5_are_read(filters, tmp_path):
    with pytest.importorskip("h5py").File(tmp_path / "log.h5", "w") as file:
        for name, values in {"time": TIME, "joint_states/position": Q, "joint_states/effort": TAU}.items():
            file.create_dataset(name, data=values, chunks=True, **filters)
    motion = tw.Motion.from_file(tmp_path / "log.h5", ARM)
    assert (motion.q == Q).all() and (motion.tau == TAU).all()


@pytest.mark.parametrize("suffix", ["parquet", "feather"])
@pytest.mark.parametrize("kind", ["timestamp", "timestamp with a zone", "duration"])
def test_times_of_tables_are_stamps(kind, suffix, tmp_path):
    """As pandas writes them: datetime64, with a zone, and Timedelta."""
    pyarrow = pytest.importorskip("pyarrow")
    types = {
        "timestamp": pyarrow.timestamp("ns"), "timestamp with a zone": pyarrow.timestamp("us", "UTC"),
        "duration": pyarrow.duration("ms"),
    }  # fmt: skip
    units = {"timestamp": 1e9, "timestamp with a zone": 1e6, "duration": 1e3}
    stamps = np.round(TIME * units[kind]).astype(np.int64)
    table = {"time": pyarrow.array(stamps).cast(types[kind])} | {n: v for n, v in columns().items() if n != "time"}
    path = tmp_path / f"log.{suffix}"
    write_table(pyarrow.table(table), path)
    assert np.allclose(np.diff(tw.Motion.from_file(path, ARM).time), 0.01, atol=1e-12)


# ── several files of one motion ──


def write_csv(path, names, values):
    np.savetxt(path, values, delimiter=",", header=",".join(names), comments="")
    return str(path)


@pytest.mark.usefixtures("reading")
def test_files_without_time_are_joined_row_by_row(tmp_path):
    """Columns that are called alike are told apart by the names of the files."""
    a = write_csv(tmp_path / "pos_data.csv", NAMES, Q)
    b = write_csv(tmp_path / "motor_currents.csv", NAMES, TAU)
    motion = tw.Motion.from_file(f"{a}+{b}", ARM, rate=100.0)
    assert np.allclose(motion.q, Q) and np.allclose(motion.tau, TAU) and np.allclose(motion.time, TIME)
    short = write_csv(tmp_path / "torques.csv", NAMES, TAU[:-1])
    with pytest.raises(tw.TrajectoryError, match="rows differ"):
        tw.Motion.from_file(f"{a}+{short}", ARM, rate=100.0)


def test_logs_of_the_same_columns_are_not_joined(tmp_path):
    """Two logs of one robot, unless columns are named."""
    a, b = (write_csv(tmp_path / name, ["time", *NAMES], np.column_stack([TIME, Q])) for name in ("a.csv", "b.csv"))
    with pytest.raises(tw.TrajectoryError, match=r"same columns, as several logs have.*Give logs one by one"):
        tw.Motion.from_file(f"{a}+{b}", ARM)
    named = tw.Motion.from_file(f"{a}+{b}", ARM, columns={name: f"b:{name}" for name in NAMES})
    assert np.allclose(named.q, Q)


@pytest.mark.usefixtures("reading")
def test_files_with_time_are_joined_by_their_stamps(tmp_path):
    a = write_csv(tmp_path / "a.csv", ["time", *NAMES], np.column_stack([TIME, Q]))
    b = write_csv(tmp_path / "b.csv", ["t", *(f"{n}.torque" for n in NAMES)], np.column_stack([TIME[5:], TAU[5:]]))
    motion = tw.Motion.from_file(f"{a}+{b}", ARM)
    assert np.allclose(motion.time, TIME[5:]) and np.allclose(motion.tau, TAU[5:]) and np.allclose(motion.q, Q[5:])
    bare = write_csv(tmp_path / "bare.csv", NAMES, TAU)
    with pytest.raises(tw.TrajectoryError, match="no column of time"):
        tw.Motion.from_file(f"{a}+{bare}", ARM)
    late = write_csv(tmp_path / "late.csv", ["t", *(f"{n}.torque" for n in NAMES)], np.column_stack([TIME + 9, TAU]))
    with pytest.raises(tw.TrajectoryError, match="do not overlap"):
        tw.Motion.from_file(f"{a}+{late}", ARM)


def test_a_file_with_a_plus_in_its_name_is_itself(tmp_path):
    path = write_csv(tmp_path / "a+b.csv", ["time", *NAMES], np.column_stack([TIME, Q]))
    assert np.allclose(tw.Motion.from_file(path, ARM).q, Q)


# ── twistwrench log ──


@pytest.mark.usefixtures("reading")
def test_log_info_says_what_is_in_a_file(tmp_path):
    t = np.delete(TIME, slice(20, 30))
    t[5] = t[4]
    rng = np.random.default_rng(0)
    table = np.column_stack([t, np.minimum(rng.normal(size=len(t)), -0.2), np.full(len(t), 3.0)])
    path = write_csv(tmp_path / "log.csv", ["time", "clipped", "dead"], table)
    result = CliRunner().invoke(main, ["log", path, "--json", "-"])
    assert result.exit_code == 0, result.output
    (found,) = json.loads(result.output)
    assert found["rows"] == 40 and abs(found["rate"] - 100) < 1e-6 and found["gaps"] == 1 and found["repeated"] == 1
    assert found["columns"][0]["cut"] > 0.2 and found["columns"][1]["dead"]
    shown = CliRunner().invoke(main, ["log", path])
    said = " ".join(shown.output.split())  # lines are as wide as a terminal
    assert "one number throughout" in said and "1 gap, " in said and "1 stamp repeated" in said
    assert CliRunner().invoke(main, ["log", str(tmp_path / "none.csv")]).exit_code == 2


def test_the_longer_arrays_of_a_file_are_the_motion(tmp_path):
    """As many columns of calibration, which are shorter, are none of it."""
    np.savez(tmp_path / "log.npz", joint=Q, time=TIME, anchor=np.zeros((10, 3)))
    motion = tw.Motion.from_file(tmp_path / "log.npz", ARM)
    assert (motion.q == Q).all() and (motion.time == TIME).all()


@pytest.mark.usefixtures("reading")
def test_dates_of_a_long_array_are_seconds_since_its_first(tmp_path):
    rows = np.zeros(len(TIME), [("time", "M8[us]"), *((name, float) for name in NAMES)])
    rows["time"] = np.datetime64("2026-01-01") + np.round(1e6 * TIME).astype("m8[us]")
    rows[NAMES[0]], rows[NAMES[1]] = Q.T
    np.save(tmp_path / "log.npy", rows)
    motion = tw.Motion.from_file(tmp_path / "log.npy", ARM)
    assert np.allclose(motion.time, TIME, atol=1e-9) and (motion.q == Q).all()


def test_matlab_4_gives_the_same_motion(tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "log.mat", {"t": TIME[:, None], "q": Q, "tau": TAU}, format="4")
    motion = tw.Motion.from_file(tmp_path / "log.mat", ARM)
    assert (motion.q == Q).all() and (motion.tau == TAU).all()


@pytest.mark.parametrize("kind", ["int32", "int16", "uint16", "uint8"])
def test_whole_numbers_of_matlab_4_keep_their_sign_and_size(kind, tmp_path):
    """The extremes of each type: a negative number is no large one, and one above half the span no negative one."""
    from scipy.io import savemat

    ends = np.iinfo(kind)
    tau = np.resize(np.array([ends.min, ends.max, 1, 0, ends.max], kind), Q.shape)
    savemat(tmp_path / "log.mat", {"t": TIME[:, None], "q": Q, "tau": tau}, format="4")
    motion = tw.Motion.from_file(tmp_path / "log.mat", ARM)
    np.testing.assert_array_equal(motion.tau, tau.astype(float))


def mat_5(order, arrays):
    """A MAT file of version 5 as its definition lays it out; arrays by name, as (class, type of the numbers, array)."""

    def element(code, content):
        return struct.pack(f"{order}II", code, len(content)) + content + bytes(-len(content) % 8)

    out = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(f"{order}H", 0x0100) + (b"IM" if order == "<" else b"MI")
    for name, (kind, code, array) in arrays.items():
        numbers = array.astype(array.dtype.newbyteorder(order)).tobytes(order="F")
        if len(name) <= 4:  # short contents stand within the tag
            label = struct.pack(f"{order}I", (len(name) << 16) | 1) + name.encode().ljust(4, b"\0")
        else:
            label = element(1, name.encode())
        shape = element(5, struct.pack(f"{order}2i", *array.shape))
        out += element(14, element(6, struct.pack(f"{order}II", kind, 0)) + shape + label + element(code, numbers))
    return out


def mat_4(order, arrays):
    """A MAT file of version 4: five whole numbers, the name with a zero, and the numbers by columns; big-endian is 1000."""
    out = b""
    for name, (kind, code, array) in arrays.items():
        code = (1000 if order == ">" else 0) + 10 * code + kind
        out += struct.pack(f"{order}5i", code, *array.shape, 0, len(name) + 1) + name.encode() + b"\0"
        out += array.astype(array.dtype.newbyteorder(order)).tobytes(order="F")
    return out


VERSIONS = {  # writer, class of arrays of numbers, and types of numbers by their codes
    "5": (mat_5, 6, {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}),
    "4": (mat_4, 0, {0: "f8", 1: "f4", 2: "i4", 3: "i2", 4: "u2", 5: "u1"}),
}


@pytest.mark.parametrize("order", ["<", ">"], ids=["little", "big"])
@pytest.mark.parametrize("version", VERSIONS)
def test_each_type_of_number_of_matlab_is_read_in_both_orders_of_bytes(version, order, tmp_path):
    """MATLAB keeps whole numbers in the smallest type that holds them, whatever the class of the array."""
    write, kind, types = VERSIONS[version]
    arrays = {}
    for code, dtype in types.items():
        numbers = np.arange(2.0 * len(TIME)).reshape(-1, 2) - (0 if dtype[0] == "u" else 40)
        arrays[dtype] = arrays[f"long_name_{dtype}"] = (kind, code, numbers.astype(dtype))
    path = tmp_path / "log.mat"
    path.write_bytes(write(order, arrays))
    found, _ = read_mat(FileEnds.from_path(path))
    assert list(found) == list(arrays)
    for name, (_, _, numbers) in arrays.items():
        np.testing.assert_array_equal(np.concatenate(list(found[name].portions(20))), numbers, err_msg=name)


@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"format": "4"}], ids=["5", "packed", "4"])
def test_what_is_no_array_of_real_numbers_in_a_mat_file_is_left_out(options, tmp_path):
    from scipy.io import savemat
    from scipy.sparse import eye

    log = {"t": TIME[:, None], "first": "a text", "q": Q, "z": 1j * Q, "s": eye(3), "tau": TAU}
    if "format" not in options:
        log |= {
            "parts": {"inner": Q, "deep": TAU},
            "cells": np.array([Q, "word"], dtype=object),
            "on": np.array([[True]]),
        }
    path = tmp_path / "log.mat"
    savemat(path, log, **options)
    found, _ = read_mat(FileEnds.from_path(path))
    kept = {name: np.concatenate(list(array.portions(20))) for name, array in found.items() if array.size}
    assert list(kept) == [name for name in ("t", "q", "tau", "on") if name in log]
    for name, numbers in kept.items():
        np.testing.assert_array_equal(numbers, np.squeeze(log[name]))


UNEVEN = {
    "one row": [[0.1, 0.2]],
    "a shorter first": [[0.1], *[[0.1, 0.2]] * 9],
    "a longer first": [[0.1, 0.2, 0.3], *[[0.1, 0.2]] * 9],
    "an empty first": [[], *[[0.1, 0.2]] * 9],
    "none in between": [*[[0.1, 0.2]] * 5, None, *[[0.1, 0.2]] * 5],
    "words": [["a", "b"]] * 9,
}


@pytest.mark.parametrize("name", UNEVEN)
def test_lists_that_make_no_array_are_columns_of_nothing(name, tmp_path):
    import pyarrow.parquet

    lists = UNEVEN[name]
    table = pyarrow.table({"time": 0.01 * np.arange(len(lists)), "q": lists})
    pyarrow.parquet.write_table(table, tmp_path / "log.parquet")
    with pytest.raises(tw.TrajectoryError, match=r"no arrays of numbers|no column for joint1, joint2"):
        tw.Motion.from_file(tmp_path / "log.parquet", ARM)


@pytest.mark.usefixtures("reading")
def test_the_row_of_a_number_that_is_not_finite_is_counted_from_the_first(tmp_path):
    q = Q.copy()
    q[20, 1] = np.nan
    np.savez(tmp_path / "log.npz", time=TIME, joint=q)
    with pytest.raises(tw.TrajectoryError, match="row 21, column 'joint2' is nan"):
        tw.Motion.from_file(tmp_path / "log.npz", ARM)


# ── Times


@pytest.mark.parametrize(("unit", "factor"), [("ns", 1e9), ("us", 1e6), ("ms", 1e3), (None, 1.0)])
def test_stamps_that_can_only_count_from_1970_are_read_in_their_unit(unit, factor, tmp_path):
    path = tmp_path / "log.csv"
    stamps = np.round((1_700_000_000 + TIME) * factor, 0 if unit else 2)
    rows = (
        f"{stamp!r},{a},{b}\n"
        for stamp, a, b in zip(stamps.astype(int if unit else float).tolist(), *Q.T.tolist(), strict=True)
    )
    path.write_text(f"timestamp,{','.join(NAMES)}\n" + "".join(rows))
    motion = tw.Motion.from_file(path, ARM)
    assert np.abs(motion.time - TIME).max() < 1e-6
    assert any(f"read in {unit} since 1970" in note for note in motion.notes) == (unit is not None)
    result = CliRunner().invoke(main, ["log", str(path)])
    assert "100 Hz" in " ".join(result.output.split())


def test_no_command_takes_the_first_row_for_names(tmp_path):
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([TIME, Q]), delimiter=",")
    for words in (
        ["log", str(path)],
        ["identify", "planar_2r", str(path)],
        ["torques", "planar_2r", "--trajectory", str(path)],
    ):
        result = CliRunner().invoke(main, words)
        assert result.exit_code == 2 and "the header is missing; the first line has numbers" in " ".join(
            result.output.split()
        )
