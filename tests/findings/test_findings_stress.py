"""Findings on faults under stress: files that take all memory or kill the process, full disks, interrupts, caches."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="devices and limits of Linux")


def run(*arguments, **options):
    return CliRunner().invoke(main, [str(x) for x in arguments], env={"COLUMNS": "200"}, **options)


def one_error(result):
    """The line of an error of ours that ended a command with exit code 2."""
    assert result.exit_code == 2, (result.exit_code, result.output[-500:], result.exception)
    (line,) = [x for x in result.stderr.splitlines() if x.startswith("error:")]
    return line


def in_child(code, *arguments, limit=0, **options):
    """Python in a child process, with its memory limited to so many bytes."""
    head = f"import resource, sys; resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}))\n" if limit else ""
    command = [sys.executable, "-c", head + code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


# ── files that unpack to more than there is ──

ROWS = 150_000_000


def bomb_h5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as f:
        for n in ("time", "joint1", "joint2"):
            f.create_dataset(n, shape=(ROWS,), dtype="f8", chunks=(1_000_000,))


def bomb_npz(path, rows=ROWS // 2):
    import zipfile

    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in ("time", "joint1", "joint2"):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (rows,)})
                for _ in range(0, rows, 1_000_000):
                    file.write(bytes(8_000_000))


def bomb_mat(path, rows=ROWS // 3):
    import struct
    import zlib

    with path.open("wb") as file:
        file.write(b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x100) + b"IM")
        for name in (b"time", b"joint1", b"joint2"):
            head = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, rows, 1)
            head += struct.pack("<II", 1, len(name)) + name.ljust(8, b"\0") + struct.pack("<II", 9, 8 * rows)
            packer = zlib.compressobj(9)
            packed = packer.compress(struct.pack("<II", 14, len(head) + 8 * rows) + head)
            for _ in range(0, rows, 1_000_000):
                packed += packer.compress(bytes(8_000_000))
            packed += packer.flush()
            file.write(struct.pack("<II", 15, len(packed)) + packed)


def bomb_parquet(path, rows=ROWS):
    pytest.importorskip("pyarrow")
    import pyarrow
    import pyarrow.parquet

    schema = pyarrow.schema([(n, pyarrow.float64()) for n in ("time", "joint1", "joint2")])
    with pyarrow.parquet.ParquetWriter(path, schema) as writer:
        part = pyarrow.table({n: np.zeros(10_000_000) for n in schema.names})
        for _ in range(0, rows, 10_000_000):
            writer.write_table(part)


TORQUES = "import sys; from twistwrench.cli.main import main; main(sys.argv[1:])"
SLOW = pytest.mark.slow
SYSTEM_MEMORY = os.environ | {"ARROW_DEFAULT_MEMORY_POOL": "system"}  # pyarrow's own reserves 1 GiB of addresses


@LINUX
@pytest.mark.parametrize(
    "make", [bomb_h5, *(pytest.param(make, marks=SLOW) for make in (bomb_npz, bomb_mat, bomb_parquet))]
)
def test_finding_45_small_files_that_unpack_to_gigabytes_are_one_error(make, tmp_path):
    path = tmp_path / f"bomb.{make.__name__.removeprefix('bomb_')}"
    make(path)
    assert path.stat().st_size < 2.5e6
    done = in_child(TORQUES, "torques", "planar_2r", "--trajectory", path, limit=1_500_000_000, env=SYSTEM_MEMORY)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("error:") and done.stderr.count("\n") == 1, done.stderr


def test_finding_45_sizes_are_asked_before_numbers_are_unpacked(tmp_path):
    """Of files that are read whole: Fortran's order, dates, MAT, and headers that say more than there is."""
    for name, order in (("a.npy", True), ("b.npy", False)):
        with (tmp_path / name).open("wb") as file:
            np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": order, "shape": (10**10, 3)})
            file.write(bytes(100))
        assert name in one_error(run("log", "info", tmp_path / name))


def test_finding_45_a_large_npz_gives_what_a_small_one_gives(tmp_path):
    """In portions, as beyond 32 MiB of numbers, and whole."""
    t = np.arange(100_000) * 1e-3
    q = np.c_[np.sin(t), 0.3 * np.cos(2 * t)]
    for rows in (100_000, 1_000):
        rest = np.zeros((rows, 40))
        np.savez_compressed(tmp_path / "log.npz", time=t[:rows], joint=q[:rows], rest=rest, word=np.array("a"))
        found = tw.Motion.from_file(tmp_path / "log.npz", tw.robots.planar_2r())
        assert (found.time == t[:rows]).all() and (found.q == q[:rows]).all()


def log_of(kind, folder):
    """A small right log of that kind."""
    path, t = folder / f"log.{kind}", np.arange(50) * 0.01
    columns = {"time": t, "joint1": np.sin(t), "joint2": np.cos(t)}
    if kind == "npz":
        np.savez(path, **columns)
    elif kind == "npy":
        np.save(path, np.rec.fromarrays(list(columns.values()), names=list(columns)))
    elif kind in ("mat", "4.mat"):
        pytest.importorskip("scipy.io").savemat(
            path, columns, do_compression=False, format="4" if kind == "4.mat" else "5"
        )
    elif kind == "7.mat":
        pytest.importorskip("scipy.io").savemat(path, columns, do_compression=True)
    elif kind == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            for name, values in columns.items():
                file[name] = values
    else:
        pytest.importorskip("pyarrow")
        import pyarrow
        import pyarrow.feather
        import pyarrow.parquet

        write = pyarrow.parquet.write_table if kind == "parquet" else pyarrow.feather.write_feather
        write(pyarrow.table(columns), path)
    return path


KINDS = ("npz", "npy", "mat", "4.mat", "7.mat", "h5", "parquet", "feather")


@pytest.mark.parametrize("kind", KINDS)
def test_finding_46_each_kind_of_log_reads_to_the_bit(kind, tmp_path):
    t = np.arange(50) * 0.01
    found = tw.Motion.from_file(log_of(kind, tmp_path), tw.robots.planar_2r())
    assert (found.time == t).all() and (found.q == np.c_[np.sin(t), np.cos(t)]).all()


def test_finding_46_a_mat_file_that_ended_the_process(tmp_path):
    path = log_of("mat", tmp_path)
    raw = bytearray(path.read_bytes())
    raw[145] = 255
    path.write_bytes(raw)
    done = in_child(TORQUES, "torques", "planar_2r", "--trajectory", path)
    assert done.returncode == 2 and done.stderr.startswith("error:") and done.stderr.count("\n") == 1


FUZZ = """
import random, sys, warnings
from pathlib import Path
import twistwrench as tw
robot, (count, *paths) = tw.robots.planar_2r(), sys.argv[1:]
warnings.simplefilter("ignore")
read = 0
for path in map(Path, paths):
    whole, made = path.read_bytes(), path.with_name("fuzzed." + path.name.split(".", 1)[1])
    for seed in range(int(count)):
        rng, raw = random.Random(seed), bytearray(whole)
        for _ in range(rng.choice((1, 1, 2, 8))):
            where = rng.randrange(len(raw)) if rng.random() < 0.5 else rng.randrange(min(400, len(raw)))
            raw[where] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        if rng.random() < 0.1:
            del raw[rng.randrange(len(raw)):]
        made.write_bytes(raw)
        print(path.name, seed, file=sys.stderr, flush=True)
        try:
            tw.Motion.from_file(made, robot)
            read += 1
        except tw.TwistWrenchError:
            pass
print(read)
"""


@LINUX
@pytest.mark.parametrize("count", [25, pytest.param(2_000, marks=SLOW)])
def test_finding_46_damaged_logs_of_each_kind_are_errors_of_ours(count, tmp_path):
    """In a child process with 3 GB of memory, which names the file that it looked at last."""
    paths = [log_of(kind, tmp_path) for kind in KINDS]
    done = in_child(FUZZ, count, *paths, limit=3_000_000_000, env=SYSTEM_MEMORY)
    assert done.returncode == 0, (done.returncode, done.stderr[-1500:])
    assert 0 < int(done.stdout) < count * len(KINDS)


def test_finding_40_columns_of_lists_are_remarked(tmp_path):
    pytest.importorskip("pyarrow")
    import pyarrow
    import pyarrow.feather
    import pyarrow.parquet

    t = np.arange(50) * 0.01
    table = pyarrow.table({"time": t, "joint1": t, "joint2": t, "torque": [[1.0, 2.0]] * 50})
    for name, write in (("a.parquet", pyarrow.parquet.write_table), ("a.feather", pyarrow.feather.write_feather)):
        write(table, tmp_path / name)
        said = "'torque' (list<element: double>)" if name == "a.parquet" else "'torque' (list<"
        assert said in run("log", "info", tmp_path / name).stdout
        (found,) = json.loads(run("log", "info", "--json", tmp_path / name).stdout)
        assert "torque" in found["notes"][0]
        assert "'torque'" in run("torques", "planar_2r", "--trajectory", tmp_path / name).output
