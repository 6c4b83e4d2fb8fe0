"""Faults under stress: files that take all memory or kill the process, full disks, interrupts, caches."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from ros_logs import write_bag, write_mcap

import twistwrench as tw
from twistwrench.cli.main import main

NEEDS_SIGINT = pytest.mark.skipif(
    signal.getsignal(signal.SIGINT) is signal.SIG_IGN, reason="SIGINT is ignored where the tests were started"
)


LINUX = pytest.mark.skipif(sys.platform != "linux", reason="devices and limits of Linux")


def run(*arguments, **options):
    return CliRunner().invoke(main, [str(x) for x in arguments], env={"COLUMNS": "200"}, **options)


def one_error(result):
    """The line of an error of ours that ended a command with exit code 2."""
    assert result.exit_code == 2, (result.exit_code, result.output[-500:], result.exception)
    (line,) = [x for x in result.stderr.splitlines() if x.startswith("error:")]
    return line


def in_child(code, *arguments, limit=0, timeout=300, **options):
    """Python in a child process, with its memory limited to so many bytes."""
    head = f"import resource, sys; resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}))\n" if limit else ""
    command = [sys.executable, "-c", head + code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, **options)


# ── files that unpack to more than there is ──

ROWS = 150_000_000


def bomb_h5(path, rows=ROWS):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as f:
        for n in ("time", "joint1", "joint2"):
            f.create_dataset(n, shape=(rows,), dtype="f8", chunks=(1_000_000,))


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


@pytest.mark.slow
@LINUX
@pytest.mark.parametrize(
    ("make", "rows", "limit"),
    [
        (bomb_h5, ROWS // 3, 1_000_000_000),
        *(pytest.param(bomb, None, 1_500_000_000, marks=SLOW) for bomb in (bomb_h5, bomb_npz, bomb_mat, bomb_parquet)),
    ],
)
def test_small_files_that_unpack_to_gigabytes_are_one_error(make, rows, limit, tmp_path):
    path = tmp_path / f"bomb.{make.__name__.removeprefix('bomb_')}"
    make(path, *([rows] if rows else []))
    assert path.stat().st_size < 2.5e6
    done = in_child(TORQUES, "torques", "planar_2r", "--trajectory", path, limit=limit, env=SYSTEM_MEMORY)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("error:") and done.stderr.count("\n") == 1, done.stderr


def test_sizes_are_asked_before_numbers_are_unpacked(tmp_path):
    """Of files that are read whole: Fortran's order, dates, MAT, and headers that say more than there is."""
    for name, order in (("a.npy", True), ("b.npy", False)):
        with (tmp_path / name).open("wb") as file:
            np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": order, "shape": (10**10, 3)})
            file.write(bytes(100))
        assert name in one_error(run("log", tmp_path / name))


def test_a_large_npz_gives_what_a_small_one_gives(tmp_path):
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
    elif kind in ("mcap", "bag"):
        q = np.c_[columns["joint1"], columns["joint2"]]
        (write_mcap if kind == "mcap" else write_bag)(path, ("joint1", "joint2"), t, q, q)
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
def test_each_kind_of_log_reads_to_the_bit(kind, tmp_path):
    t = np.arange(50) * 0.01
    found = tw.Motion.from_file(log_of(kind, tmp_path), tw.robots.planar_2r())
    assert (found.time == t).all() and (found.q == np.c_[np.sin(t), np.cos(t)]).all()


def test_a_mat_file_that_ended_the_process(tmp_path):
    path = log_of("mat", tmp_path)
    raw = bytearray(path.read_bytes())
    raw[145] = 255
    path.write_bytes(raw)
    done = in_child(TORQUES, "torques", "planar_2r", "--trajectory", path)
    assert done.returncode == 2 and done.stderr.startswith("error:") and done.stderr.count("\n") == 1


FUZZ = """
import random, shutil, sys, warnings
from pathlib import Path
import twistwrench as tw
robot, (count, *paths) = tw.robots.planar_2r(), sys.argv[1:]
warnings.simplefilter("ignore")
read = 0
for path in map(Path, paths):
    made = target = path.with_name("fuzzed." + path.name.split(".", 1)[1])
    if path.is_dir():
        shutil.copytree(path, made)
        (target,) = made.glob("*.db3")
        whole = target.read_bytes()
    else:
        whole = path.read_bytes()
    for seed in range(int(count)):
        rng, raw = random.Random(seed), bytearray(whole)
        for _ in range(rng.choice((1, 1, 2, 8))):
            where = rng.randrange(len(raw)) if rng.random() < 0.5 else rng.randrange(min(400, len(raw)))
            raw[where] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        if rng.random() < 0.1:
            del raw[rng.randrange(len(raw)):]
        target.write_bytes(raw)
        print(path.name, seed, file=sys.stderr, flush=True)
        try:
            tw.Motion.from_file(made, robot)
            read += 1
        except tw.TwistWrenchError:
            pass
print(read)
"""


@pytest.mark.slow
@LINUX
@pytest.mark.parametrize("count", [25, pytest.param(2_000, marks=SLOW)])
def test_damaged_logs_of_each_kind_are_errors_of_ours(count, tmp_path):
    """In a child process with 3 GB of memory, which names the file that it looked at last."""
    paths = [log_of(kind, tmp_path) for kind in (*KINDS, "mcap", "bag")]
    done = in_child(FUZZ, count, *paths, limit=3_000_000_000, timeout=300 + count, env=SYSTEM_MEMORY)
    assert done.returncode == 0, (done.returncode, done.stderr[-1500:])
    assert 0 < int(done.stdout) < count * len(paths)


def test_columns_of_lists_are_read_or_remarked(tmp_path):
    """Lists of as many numbers are columns; those of several lengths are not read, and a note says so."""
    pytest.importorskip("pyarrow")
    import pyarrow
    import pyarrow.feather
    import pyarrow.parquet

    t = np.arange(50) * 0.01
    table = pyarrow.table({"time": t, "joint1": t, "joint2": t, "torque": [[1.0, 2.0], [1.0]] * 25})
    for name, write in (("a.parquet", pyarrow.parquet.write_table), ("a.feather", pyarrow.feather.write_feather)):
        write(table, tmp_path / name)
        said = "'torque' (list<element: double>)" if name == "a.parquet" else "'torque' (list<"
        assert said in run("log", tmp_path / name).stdout
        (found,) = json.loads(run("log", "--json", "-", tmp_path / name).stdout)
        assert "torque" in found["notes"][0]
        assert "'torque'" in run("torques", "planar_2r", "--trajectory", tmp_path / name).output
        write(table.set_column(3, "torque", [[[1.0, 2.0]] * 50]), tmp_path / name)
        motion = tw.Motion.from_file(tmp_path / name, tw.robots.planar_2r())
        assert (motion.tau == [1.0, 2.0]).all()


# ── exit codes: a fault of the system is not one of the program ──

ARM = """<robot name="arm"><link name="base"/>
<link name="l"><inertial><origin xyz=".5 0 0"/><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="l"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="5" effort="30"/></joint>
</robot>"""

COMMANDS = (
    "--help", "--version", "info ur5", "info ur5 --json -", "robots", "torques ur5 --trajectory demo", "torques ur5 --trajectory demo --csv /dev/full",
    "payload planar_2r --at 0,0", "simulate pendulum --duration 0.01", "simulate pendulum --duration 0.01 --npz /dev/full",
    "simulate pendulum --duration 0.01 --csv /dev/full", "move planar_2r --to 1,1 --duration 2", "move planar_2r --to 1,1 --duration 2 --csv /dev/full", "derive pendulum",
    "doctor arm.urdf", "doctor arm.urdf --json -", "verify pendulum", "log log.csv", "log log.csv --json -",
    "export pendulum --c FOLDER", "view pendulum --html FOLDER/p.html", "torques pendulum --trajectory log.csv --kind power --plot FOLDER/p.png",
    "sensor --help", "identify --help", "excite --help",
)  # fmt: skip


class Full:
    """A standard output on a full disk."""

    encoding, errors = "utf-8", "strict"

    def write(self, text):
        raise OSError(28, "No space left on device")

    flush = fileno = lambda self: self.write("")

    def isatty(self):
        return False


@LINUX
@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk_ends_every_command_with_2(command, tmp_path, monkeypatch, capsys):
    (tmp_path / "arm.urdf").write_text(ARM)
    (tmp_path / "log.csv").write_text("time,joint1\n" + "".join(f"{k / 100},{k / 100}\n" for k in range(50)))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdout", Full())
    with pytest.raises(SystemExit) as ended:
        main(command.replace("FOLDER", ".").split(), prog_name="twistwrench")
    said = [x for x in capsys.readouterr().err.splitlines() if x.startswith("error:")]
    assert ended.value.code == 2 and len(said) == 1 and "No space left" in said[0], said


@LINUX
def test_a_full_disk_and_a_process(tmp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "twistwrench", "info", "pendulum"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 2 and done.stderr.count("\n") == 1


@pytest.mark.parametrize("length", [256, 300, 5_000])
@pytest.mark.parametrize("command", ["info {}", "doctor {}", "torques ur5 --trajectory {}", "log {}", "derive {}"])
def test_names_that_are_too_long(command, length):
    one_error(run(*command.format("a" * length).split()))


@pytest.mark.parametrize(
    "stamps",
    [[0, 1e-300, *(0.01 * np.arange(1, 60))], [*(0.01 * np.arange(60)), 1e300], [0, 5e-324, 1, 2, 3, 4, 5, 6, 7]],
)
def test_stamps_that_no_curve_leads_through(stamps, tmp_path):
    rows = "".join(f"{t!r},{np.sin(k / 9)!r},0.5\n" for k, t in enumerate(map(float, stamps)))
    (tmp_path / "log.csv").write_text(f"time,joint1,joint2\n{rows}")
    for plot in ((), ("--kind", "power", "--plot", tmp_path / "p.png")):
        found = run("torques", "planar_2r", "--trajectory", tmp_path / "log.csv", *plot)
        assert found.exit_code in (1, 2), found.output


# ── others' text ──

EVIL = "\x1b[31mjoint\x1b[2J1\x9b\u202e\u2066"


def test_control_characters_reach_no_terminal(tmp_path):
    (tmp_path / "e.csv").write_text(f"time,{EVIL},\x1b]0;owned\x07x\n0,1,2\n1,2,3\n")
    (tmp_path / "r.urdf").write_text(
        ARM.replace('"j"', '"j&#x9b;2J&#x202e;&#x2066;"').replace('"arm"', '"a&#x9b;&#x202e;"')
    )
    out = tmp_path / "out"
    out.mkdir()
    for command in (
        "log e.csv", "torques r.urdf --trajectory e.csv", "info r.urdf", "info r.urdf --json -", "info r.urdf --csv -", "doctor r.urdf",
        "payload r.urdf --at 0", "simulate r.urdf --duration 0.01", "derive r.urdf", "export r.urdf --c out", "verify r.urdf",
        "move r.urdf --to 1",
    ):  # fmt: skip
        words = [str(tmp_path / w) if (tmp_path / w).exists() else w for w in command.split()]
        found = run(*words)
        assert found.exit_code in (0, 1, 2), (command, found.exception)
        bad = [c for c in found.output if c in "\x1b\x07\x9b\u202e\u2066" or (c < " " and c not in "\n\t")]
        assert not bad, (command, bad)
    for file in out.iterdir():
        assert file.read_text().isascii()
    for name, made in (("c", "eq.c"), ("md", "eq.md")):
        found = run("derive", tmp_path / "r.urdf", "--out", out / made)
        if found.exit_code == 0:
            text = (out / made).read_text()
            assert not set(text) & set("\x9b\u202e\u2066"), name


# ── interrupts and whole files ──


def test_slices_of_steps_change_no_bit():
    """A rollout that is long enough to be cut, against one that is taken piece by piece."""
    robot, q, dq = tw.robots.planar_2r(), [0.3, 0.2], [0.0, 0.0]
    for method in ("semi_implicit", "rk4"):
        whole = robot.rollout(q, dq, steps=1_200_000, dt=1e-5, every=600_000, method=method)
        half = robot.rollout(q, dq, steps=600_000, dt=1e-5, every=600_000, method=method)
        rest = robot.rollout(half.q[-1], half.dq[-1], steps=600_000, dt=1e-5, every=300_000, method=method)
        assert (whole.q[1] == half.q[1]).all() and (whole.q[2] == rest.q[2]).all() and (whole.dq[2] == rest.dq[2]).all()


@LINUX
@pytest.mark.parametrize("method", ["semi_implicit", pytest.param("rk4", marks=SLOW)])
def test_ctrl_c_is_answered_by_a_rollout(method):
    """In processor time: machines may be busy."""
    code = (
        (
            "import signal, sys, time, twistwrench as tw\n"
            "robot = tw.robots.panda(); robot.rollout(robot.q, robot.q * 0, steps=5, method=sys.argv[1])\n"
            "signal.signal(signal.SIGVTALRM, signal.default_int_handler); signal.setitimer(signal.ITIMER_VIRTUAL, 0.3)\n"
            "begin = time.process_time()\n"
            "try: robot.rollout(robot.q, robot.q * 0, steps=20_000_000, dt=1e-3, every=1_000_000, method=sys.argv[1])\n"
            "except KeyboardInterrupt: print(time.process_time() - begin - 0.3)\n"
        )
        .replace("robot.q,", "robot.neutral,")
        .replace("robot.q *", "robot.zero_velocity *")
    )
    code = code.replace("robot.neutral", "[0, -.5, 0, -1.5, 0, 1.5, .5]").replace("robot.zero_velocity * 0", "[0] * 7")
    done = in_child(code, method)
    assert done.returncode == 0 and float(done.stdout) < 0.5, done.stderr  # 14 s before


@LINUX
@NEEDS_SIGINT
def test_ctrl_c_during_imports_gives_no_traceback():
    """The signal arrives as soon as NumPy begins to be imported."""
    code = (
        "import builtins, os, runpy, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == sys.argv_module: sys.meta_path.remove(self); os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.argv_module = sys.argv[1]; sys.argv = ['/usr/bin/twistwrench', 'info', 'pendulum']\n"
        "sys.meta_path.insert(0, Finder())\n"
        "from twistwrench.cli.main import main; main()\n"
    )
    for module in ("numpy", "click", "twistwrench.robot", "twistwrench.robots.finding"):
        done = in_child(code, module)
        assert done.returncode == 130 and done.stderr == "interrupted\n", (module, done.stderr)


@NEEDS_SIGINT
def test_an_interrupt_that_a_library_swallows(monkeypatch, tmp_path):
    """As Matplotlib's own code may: what it raises in its place is not an error of the program."""
    import signal

    def draws(*_, **__):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ValueError("Invalid bounding box") from None

    monkeypatch.setattr(tw.simulation.SimulationResult, "plot", draws)
    found = run("simulate", "pendulum", "--duration", "0.01", "--plot", tmp_path / "p.png")
    assert found.exit_code == 130 and "interrupted" in found.output


def test_a_whole_file_is_not_replaced_by_part_of_one(tmp_path, monkeypatch):
    path, begun = tmp_path / "run.csv", ["simulate", "pendulum", "--duration", "0.05", "--csv"]
    assert run(*begun, path).exit_code == 0
    whole, real = path.read_bytes(), tw.Robot.simulate

    def interrupted(*given, **options):
        stop = KeyboardInterrupt()
        stop.result = real(*given, **options)
        raise stop

    monkeypatch.setattr(tw.Robot, "simulate", interrupted)
    found = run(*begun, path, "--overwrite")
    assert found.exit_code == 130 and path.read_bytes() == whole and "is kept" in found.output
    assert run(*begun, tmp_path / "new.csv").exit_code == 130 and (tmp_path / "new.csv").read_bytes() == whole


def test_files_are_on_the_disk_before_they_are_renamed(tmp_path, monkeypatch):
    did, sync, replace = [], os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda handle: (did.append("sync"), sync(handle))[1])

    def renames(a, b):  # the cache renames its own files too
        did.extend(["rename"] * (Path(b).parent == tmp_path))
        return replace(a, b)

    monkeypatch.setattr(os, "replace", renames)
    assert run("export", "pendulum", "--c", tmp_path).exit_code == 0
    assert did == ["sync"] * 3 + ["rename"] * 3
    did.clear()
    (tmp_path / "arm.urdf").write_text(ARM.replace('mass value="1"', 'mass value="-1"'))
    run("doctor", tmp_path / "arm.urdf", "--out", tmp_path / "arm.urdf", "--overwrite")
    assert not did or did == ["sync", "rename"]


def test_a_failure_between_leaves_the_old_files(tmp_path, monkeypatch):
    assert run("export", "pendulum", "--c", tmp_path).exit_code == 0
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    monkeypatch.setattr(os, "fsync", lambda handle: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    one_error(run("export", "pendulum", "--c", tmp_path, "--quantity", "gravity_forces"))
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize("failing", ["fsync", "replace"])
@pytest.mark.parametrize("number", [1, 2, 3])
def test_no_scratch_file_stays_wherever_writing_fails(tmp_path, monkeypatch, failing, number):
    real, left = getattr(os, failing), [number]

    def fails(*given):
        left[0] -= failing == "fsync" or Path(given[1]).parent == tmp_path  # the cache renames its own files too
        if left[0] == 0 and (failing == "fsync" or Path(given[1]).parent == tmp_path):
            raise OSError(28, "No space left on device")
        return real(*given)

    monkeypatch.setattr(os, failing, fails)
    one_error(run("export", "pendulum", "--c", tmp_path))
    assert left == [0] and not [p.name for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_no_scratch_file_stays_where_a_later_file_cannot_begin(tmp_path):
    assert run("export", "pendulum", "--c", tmp_path).exit_code == 0
    *_, last = names = sorted(p.name for p in tmp_path.iterdir())
    (tmp_path / last).unlink()
    (tmp_path / last).mkdir()
    one_error(run("export", "pendulum", "--c", tmp_path, "--quantity", "gravity_forces"))
    assert sorted(p.name for p in tmp_path.iterdir()) == names


def test_no_scratch_file_stays_after_an_error_in_what_is_written(tmp_path, monkeypatch):
    motion = tw.Motion(range(6), [[0.0, 0.1]] * 6, robot=tw.robots.planar_2r())
    monkeypatch.setattr("csv.writer", lambda *_, **__: (_ for _ in ()).throw(RuntimeError("in the middle")))
    with pytest.raises(RuntimeError, match="in the middle"):
        motion.to_csv(tmp_path / "motion.csv")
    assert not list(tmp_path.iterdir())


# ── the environment ──


@LINUX
def test_where_executable_memory_is_forbidden_numpy_serves():
    code = (
        "import ctypes, sys; assert ctypes.CDLL(None).prctl(65, 1, 0, 0, 0) == 0\n"
        "import twistwrench as tw, numpy as np\n"
        "robot = tw.robots.panda(); q = [0, -.5, 0, -1.5, 0, 1.5, .5]\n"
        "print(robot.inverse_dynamics(q, q, q).tolist()); print(robot.rollout(q, [0] * 7, steps=3).q[-1].tolist())\n"
        "print(robot.mass_matrix(q).tolist())\n"
    )
    done = in_child(code)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("executable memory") == 1 and "JIT session" not in done.stderr
    robot, q = tw.robots.panda(), [0, -0.5, 0, -1.5, 0, 1.5, 0.5]
    tau = json.loads(done.stdout.splitlines()[0])
    assert np.allclose(tau, robot.inverse_dynamics(q, q, q), rtol=1e-12, atol=1e-12)


CACHED = "import warnings, sys, os, twistwrench as tw; warnings.simplefilter('always'); tw.robots.pendulum().mass_matrix([0.3])"


@LINUX
def test_a_cache_below_a_folder_that_others_can_write_to_is_not_used(tmp_path):
    open_to_all = tmp_path / "open"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    for place, used in ((open_to_all / "cache", False), (tmp_path / "own" / "cache", True)):
        done = in_child(CACHED, env=os.environ | {"TWISTWRENCH_CACHE_DIR": str(place)})
        assert done.returncode == 0, done.stderr
        assert ("others can rename" in done.stderr) is not used and any(place.iterdir()) is used
    entry = next((tmp_path / "own" / "cache").iterdir())
    entry.chmod(0o666)
    in_child(CACHED, env=os.environ | {"TWISTWRENCH_CACHE_DIR": str(tmp_path / "own" / "cache")})
    assert not entry.exists() or entry.stat().st_mode & 0o022 == 0  # written afresh
