"""Logs made to do harm: each ends in one error of the tree, quickly, with little memory, without reaching other files."""

from __future__ import annotations

import gzip
import io
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from click.testing import CliRunner
from ros_logs import JOINT_STATE, header, write_messages

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.motion.motion_file import open_motion_file

ARM = tw.robots.planar_2r()
TIME = np.arange(50) * 0.01
Q = np.stack([np.sin(3 * TIME), np.cos(2 * TIME)], axis=1)
MEMORY = 1 << 28
"""Memory of the readers [bytes] beyond that of the interpreter with its libraries."""
READ = """
import resource, sys
import twistwrench as tw
from twistwrench.motion.motion_file import open_motion_file
for library in sys.argv[3:]:
    __import__(library)
most = int(open("/proc/self/statm").read().split()[5]) * resource.getpagesize() + int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_DATA, (most, most))
file = open_motion_file(sys.argv[1])
print(file.table(range(len(file.header))).shape)
"""


def read_alone(path, *libraries):
    """What a process of its own prints of a file, read without a child of it, under limits of memory and time."""
    environment = {
        **os.environ,
        "TWISTWRENCH_SANDBOX": "0",
        "OPENBLAS_NUM_THREADS": "1",
        "ARROW_DEFAULT_MEMORY_POOL": "system",
    }
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path), str(MEMORY), *libraries],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def refused(path, *, sandbox, monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_SANDBOX", "1" if sandbox else "0")
    with pytest.raises(tw.TrajectoryError) as caught:
        file = open_motion_file(path)
        file.table(range(len(file.header)))
    return str(caught.value)


# ── Arrow


def test_feather_of_version_1_is_refused_before_arrow_sees_it(tmp_path, monkeypatch):
    path = tmp_path / "old.feather"
    path.write_bytes(b"FEA1" + bytes(200) + b"FEA1")
    for sandbox in (True, False):
        said = refused(path, sandbox=sandbox, monkeypatch=monkeypatch)
        assert "Feather version 1 is not read" in said and "write_feather" in said


def test_columns_that_are_not_used_are_not_unpacked(tmp_path):
    feather, pyarrow = pytest.importorskip("pyarrow.feather"), pytest.importorskip("pyarrow")
    path = tmp_path / "log.feather"
    texts = pyarrow.chunked_array([pyarrow.array(["x" * 4096] * 4096)] * 32)  # 0.5 GB
    rows = len(texts)
    feather.write_feather(
        pyarrow.table({"time": np.arange(rows), "joint1": np.zeros(rows), "remark": texts}), path, compression="zstd"
    )
    assert path.stat().st_size < 2**20
    assert read_alone(path, "pyarrow.dataset") == f"({rows}, 2)\n"


def test_a_column_of_lists_out_of_proportion_is_ignored(tmp_path, monkeypatch):
    parquet, pyarrow = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
    path = tmp_path / "log.parquet"
    monkeypatch.setattr("twistwrench.motion.log_table.FREE_UNPACKED_SIZE", 1 << 22)
    lists = pyarrow.FixedSizeListArray.from_arrays(np.zeros(1 << 22, np.float32), 1 << 12)
    parquet.write_table(pyarrow.table({"time": np.arange(1024.0), "joint1": np.zeros(1024), "image": lists}), path)
    monkeypatch.setenv("TWISTWRENCH_SANDBOX", "0")
    file = open_motion_file(path)
    assert file.header == ("time", "joint1") and any("'image'" in note for note in file.notes)


def test_more_rows_than_a_file_of_its_size_has_are_refused(tmp_path, monkeypatch):
    parquet, pyarrow = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
    path = tmp_path / "log.parquet"
    rows = pyarrow.table({"time": np.zeros(1 << 22), "joint1": np.zeros(1 << 22)})
    with parquet.ParquetWriter(path, rows.schema) as writer:
        for _ in range(5):
            writer.write_table(rows)
    for sandbox in (True, False):
        assert "unpacks to more than" in refused(path, sandbox=sandbox, monkeypatch=monkeypatch)


# ── LeRobot datasets


def lerobot(folder, **columns):
    parquet, pyarrow = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    path = folder / "data" / "chunk-000" / "episode_000000.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    table = {"timestamp": TIME, "observation.state": Q.tolist(), "episode_index": np.zeros(len(TIME), int), **columns}
    parquet.write_table(pyarrow.table(table), path, compression="none", use_dictionary=False)
    return path


def test_metadata_of_a_dataset_are_bounded_and_come_from_its_own_folder(tmp_path, monkeypatch):
    path = lerobot(tmp_path / "set")
    info = tmp_path / "set" / "meta" / "info.json"
    with info.open("wb") as file:
        file.truncate(1 << 32)
    assert "it has more than 4 MiB" in refused(path, sandbox=False, monkeypatch=monkeypatch)
    info.write_text(json.dumps({"features": {"observation.state": {"names": ["a", "b"]}}}))
    assert open_motion_file(path).header[1] == "observation.state.a.pos"
    info.unlink()
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text("not of this dataset")
    assert open_motion_file(path).header[1] == "observation.state.1.pos"


def test_other_tables_reach_no_metadata(tmp_path):
    parquet, pyarrow = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text("something else")
    parquet.write_table(pyarrow.table({"time": TIME, "joint1": Q[:, 0]}), tmp_path / "log.parquet")
    assert open_motion_file(tmp_path / "log.parquet").header == ("time", "joint1")


def test_damaged_episodes_are_one_error(tmp_path, monkeypatch):
    path = lerobot(tmp_path)
    data = bytearray(path.read_bytes())
    at = data.rfind(np.zeros(len(TIME), np.int64).tobytes())
    data[at - 30 : at] = bytes(30)
    path.write_bytes(data)
    for sandbox in (True, False):
        assert "episode_index" in refused(path, sandbox=sandbox, monkeypatch=monkeypatch)


# ── HDF5


def hdf5(path, **options):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["time"], file["joint1"] = TIME, Q[:, 0]
        for name, given in options.items():
            file.create_dataset(name, **given)
    return path


@pytest.mark.parametrize("sandbox", [True, False])
def test_numbers_in_other_files_are_not_read(sandbox, tmp_path, monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_SANDBOX", str(int(sandbox)))
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(Q.tobytes())
    os.mkfifo(tmp_path / "pipe")
    hdf5(tmp_path / "other.h5", joint2={"data": Q[:, 1]})
    path = tmp_path / "log.h5"
    layout = h5py.VirtualLayout(shape=(50,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "joint2", shape=(50,))
    outside = {
        name: {"shape": (50,), "dtype": "f8", "external": [(str(tmp_path / name), 0, 400)]}
        for name in ("secret", "pipe")
    }
    hdf5(path, **outside)
    with h5py.File(path, "a") as file:
        file.create_virtual_dataset("virtual", layout)
        file["linked"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "joint2")
    file = open_motion_file(path)
    assert file.header == ("joint1", "time")
    assert file.notes == ("Not read, as its numbers are in other files: pipe, secret, virtual.",)


@pytest.mark.parametrize("sandbox", [True, False])
def test_datasets_out_of_proportion_are_ignored(sandbox, tmp_path, monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_SANDBOX", str(int(sandbox)))
    wide = {"shape": (50, 50_000), "dtype": "f8", "chunks": (50, 1000)}
    chunk = {"shape": (50, 1 << 20), "dtype": "f8", "chunks": (50, 1 << 20), "compression": "gzip"}
    long = {"shape": (1 << 40,), "dtype": "f8", "chunks": (1000,)}
    file = open_motion_file(hdf5(tmp_path / "log.h5", wide=wide, chunk=chunk, long=long))
    assert file.header == ("joint1", "time")
    said = " ".join(file.notes)
    assert all(
        words in said for words in ("larger than 64 MiB: chunk", "size of the file: long", "10000 numbers: wide")
    )


def test_a_filter_that_hdf5_would_look_for_is_not_asked(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = hdf5(tmp_path / "log.h5")
    with h5py.File(path, "a") as file:
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_chunk((10,))
        plan.set_filter(32099, h5py.h5z.FLAG_OPTIONAL, ())
        h5py.h5d.create(file.id, b"strange", h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple((50,)), plan)
    assert open_motion_file(path).notes == ("Not read, as its filter does not come with HDF5: strange.",)


# ── NumPy, CSV


def test_an_archive_of_wide_rows_is_refused_unread(tmp_path, monkeypatch):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (2, 1 << 27)})
    with zipfile.ZipFile(tmp_path / "log.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("q.npy", head.getvalue() + bytes(1 << 24))
    said = refused(tmp_path / "log.npz", sandbox=False, monkeypatch=monkeypatch)
    assert "a row of it has more than 10000 numbers: q" in said


def test_packed_text_out_of_proportion_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("twistwrench.motion.log_table.FREE_UNPACKED_SIZE", 1 << 22)
    path = tmp_path / "log.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(b"time,joint1\n" + b"0.0,0.0\n" * (1 << 20))
    assert path.stat().st_size < 1 << 16
    assert "unpacks to more than" in refused(path, sandbox=False, monkeypatch=monkeypatch)


def test_packed_logs_of_any_usual_ratio_are_read(tmp_path):
    path = tmp_path / "log.csv.gz"
    rows = "".join(f"{t!r},0,0\n" for t in (np.arange(20_000) * 0.01).tolist())
    with gzip.open(path, "wt") as file:
        file.write("time,joint1,joint2\n" + rows)
    assert open_motion_file(path).table([0, 1, 2]).shape == (20_000, 3)


# ── Recordings of ROS


def database(path, *statements):
    with sqlite3.connect(path) as file:
        for statement in statements:
            file.execute(statement)
    return path


TOPICS = (
    "create table topics(id integer primary key, name text, type text, serialization_format text, offered_qos_profiles text)",
    "insert into topics values (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '')",
)
COLUMNS = "id integer primary key, topic_id integer, timestamp integer"
ENDLESS = "with recursive r(k) as (select 1 union all select k + 1 from r)"


@pytest.mark.parametrize("sandbox", [True, False])
@pytest.mark.parametrize(
    ("name", "messages", "said"),
    [
        ("view", [f"create view messages as {ENDLESS} select k id, 1 topic_id, k timestamp, zeroblob(1000000000) data from r"],
         "'messages' is a view"),
        ("virtual", ["create virtual table messages using fts5(id, topic_id, timestamp, data)"], "'messages' is a virtual table"),
        ("computed", [f"create table messages({COLUMNS}, data blob as (zeroblob(1000000000)))",
                      "insert into messages values (1, 1, 0)"], "columns of 'messages' are computed: data"),
    ],
)  # fmt: skip
def test_tables_of_a_database_are_plain_tables(sandbox, name, messages, said, tmp_path, monkeypatch):
    path = database(tmp_path / "log.db3", *TOPICS, *messages)
    assert said in refused(path, sandbox=sandbox, monkeypatch=monkeypatch)
    folder = tmp_path / "bag"
    folder.mkdir()
    shutil.copy(path, folder / "bag.db3")
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths: [bag.db3]\n"
    )
    assert said in refused(folder, sandbox=sandbox, monkeypatch=monkeypatch)


def test_a_query_out_of_proportion_ends(tmp_path, monkeypatch):
    monkeypatch.setattr("twistwrench.motion.readers.recording_bounds._BASE_STEPS", 100_000)
    monkeypatch.setattr("twistwrench.motion.readers.recording_bounds._STEPS_PER_BYTE", 0)
    many = f"insert into messages {ENDLESS} select k, 1, k, zeroblob(10) from r limit 100000"
    path = database(tmp_path / "log.db3", *TOPICS, f"create table messages({COLUMNS}, data blob)", many)
    assert "take more steps to read" in refused(path, sandbox=False, monkeypatch=monkeypatch)


def test_ctrl_c_ends_a_query(tmp_path):
    import signal

    from twistwrench.motion.readers.recording_bounds import recording_database

    path = database(tmp_path / "log.db3", *TOPICS, f"create table messages({COLUMNS}, data blob)")

    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    try:
        with pytest.raises(KeyboardInterrupt), recording_database(path) as file:
            file.execute(f"{ENDLESS} select count(*) from r").fetchone()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("sandbox", [True, False])
def test_chunks_of_a_recording_are_in_proportion_to_it(sandbox, tmp_path, monkeypatch):
    zstandard = pytest.importorskip("zstandard")
    message = {"header": header(), "name": ["joint1"], "position": [0.0], "velocity": [], "effort": []}
    path = tmp_path / "log.mcap"
    write_messages(
        path, {"/joint_states": ("sensor_msgs/msg/JointState", JOINT_STATE, [(0.0, message), (1.0, message)])}
    )
    data = path.read_bytes()
    chunk = zstandard.ZstdCompressor().compress(bytes(1 << 29))
    body = (
        bytes(16)
        + (100).to_bytes(8, "little")
        + bytes(4)
        + (4).to_bytes(4, "little")
        + b"zstd"
        + len(chunk).to_bytes(8, "little")
        + chunk
    )
    record = b"\x06" + len(body).to_bytes(8, "little") + body
    head = 8 + 9 + int.from_bytes(data[9:17], "little")
    path.write_bytes(data[:head] + record + data[head:])
    assert path.stat().st_size < 1 << 18
    assert "unpacks to more than" in refused(path, sandbox=sandbox, monkeypatch=monkeypatch)


# ── Texts of a file in messages


def test_control_characters_of_a_file_reach_no_message(tmp_path):
    path = tmp_path / "log.npz"
    np.savez(path, **{"time": TIME, "joint\x1b[2J": Q[:, 0]})
    with pytest.raises(tw.TwistWrenchError) as caught:
        tw.Motion.from_file(path, ARM)
    assert "\x1b" not in str(caught.value) and r"\x1b[2J" in str(caught.value)
    for text in ("a\x00b", "a\x9bb", "a\u202eb", "a\rb"):
        assert text not in str(tw.ModelError(text)) and "a\n\tb" in str(tw.UnknownNameError("a\n\tb"))


# ── Archives of this program, and tables beside robots


class Harm:
    def __reduce__(self):
        return os.abort, ()


def test_pickled_objects_are_never_created(tmp_path, monkeypatch):
    pickled = np.array([Harm()], object)
    np.savez(tmp_path / "log.npz", time=TIME, joint1=Q[:, 0], joint2=pickled)
    assert open_motion_file(tmp_path / "log.npz").header == ("time", "joint1")
    np.save(tmp_path / "log.npy", pickled)
    assert "has no arrays of numbers" in refused(tmp_path / "log.npy", sandbox=False, monkeypatch=monkeypatch)
    (tmp_path / "log.csv").write_text("time,joint1\n0,=SYSTEM()\n")
    assert "which is not a number" in refused(tmp_path / "log.csv", sandbox=False, monkeypatch=monkeypatch)
    np.savez(tmp_path / "result.npz", format=pickled, said=pickled)
    with pytest.raises(tw.TwistWrenchError):
        tw.simulation.SimulationResult.load(tmp_path / "result.npz")


def test_archives_of_results_are_bounded(tmp_path):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (1 << 28,)})
    with zipfile.ZipFile(tmp_path / "result.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("times.npy", head.getvalue() + bytes(1 << 20))
    with pytest.raises(tw.TwistWrenchError, match="GiB once unpacked"):
        tw.simulation.SimulationResult.load(tmp_path / "result.npz")


def test_a_folder_of_ros_names_no_files_elsewhere(tmp_path, monkeypatch):
    pytest.importorskip("rosbags")
    database(tmp_path / "secret.db3", *TOPICS, f"create table messages({COLUMNS}, data blob)")
    folder = tmp_path / "bag"
    folder.mkdir()
    about = "\n  ".join(
        ["version: 5", "storage_identifier: sqlite3", "relative_file_paths: [../secret.db3]", "message_count: 0"]
    )
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  {about}\n")
    for sandbox in (True, False):
        assert "are missing" in refused(folder, sandbox=sandbox, monkeypatch=monkeypatch)


def test_tables_are_data(tmp_path):
    (tmp_path / "limits.csv").write_text("joint,effort\njoint1,=SYSTEM()\njoint2,1\n")
    (tmp_path / "poses.csv").write_text("joint1,joint2\n=SYSTEM(),1\n")
    (tmp_path / "readings.csv").write_text("fx,fy,fz,tx,ty,tz,qx,qy,qz,qw\n" + "=SYSTEM(),0,0,0,0,0,0,0,0,1\n")
    (tmp_path / "sensor.json").write_text('{"py/reduce": [{"py/function": "os.abort"}]}')
    for words in (
        ["payload", "planar_2r", "--limits", "limits.csv"],
        ["payload", "planar_2r", "--at", "poses.csv"],
        ["sensor", "identify", "readings.csv"],
        ["sensor", "compensate", "readings.csv", "--sensor", "sensor.json"],
    ):
        result = CliRunner().invoke(main, [str(tmp_path / word) if "." in word else word for word in words])
        assert result.exit_code == 2 and result.output.startswith("error: "), result.output
