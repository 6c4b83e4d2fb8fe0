"""Whole logs and results, from which changed ones are made, and logs with features that no honest program writes."""

from __future__ import annotations

import gzip
import io
import json
import tempfile
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import ros_logs

import twistwrench as tw

from .mutations import WORDS as JUNK
from .mutations import Dice, place, text_of
from .robot_seeds import Case, single

ROBOT = tw.robots.planar_2r()
NAMES = ROBOT.joint_names
TIME = np.arange(40) * 0.01
Q = np.stack([np.sin(3 * TIME), np.cos(2 * TIME)], axis=1)
TAU = np.stack([TIME, -(TIME**2)], axis=1)


def written(write: Callable[[Path], Any], name: str) -> bytes:
    """Content of a file that a function writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        write(path)
        return path.read_bytes()


def columns() -> dict[str, np.ndarray]:
    found = {"time": TIME} | {name: Q[:, k] for k, name in enumerate(NAMES)}
    return found | {f"{name}.torque": TAU[:, k] for k, name in enumerate(NAMES)}


# ── Text


def table(*, mark: str = ",", decimal: str = ".", head: bool = True, quotes: bool = False, ends: str = "\n") -> str:
    wrap = '"{}"'.format if quotes else str
    rows = [[wrap(name) for name in columns()]] * head
    rows += [[wrap(f"{x:.6g}".replace(".", decimal)) for x in row] for row in np.column_stack([*columns().values()])]
    return ends.join(mark.join(row) for row in rows) + ends


def csv() -> list[Case]:
    with_notes = "# recorded\n# by hand\n" + table().replace("time,joint1,", "time [ms],joint1 [deg],", 1)
    texts = (
        table(), table(mark=";", decimal=","), table(mark="\t"), table(mark=" "), table(head=False), table(quotes=True), table(ends="\r\n"),
        with_notes,
    )  # fmt: skip
    files = [text.encode() for text in texts]
    files += [table().encode(coding) for coding in ("utf-8-sig", "utf-16", "utf-16-le", "utf-32")]
    return [Case("log.csv", {"log.csv": data}) for data in files]


def csv_gzip() -> list[Case]:
    return [Case("log.csv.gz", {"log.csv.gz": gzip.compress(table().encode(), mtime=0)})]


def joined() -> list[Case]:
    positions = "time,joint1,joint2\n" + "".join(
        f"{t:.2f},{a:.5g},{b:.5g}\n" for t, (a, b) in zip(TIME, Q, strict=True)
    )
    torques = "time,joint1,joint2\n" + "".join(
        f"{t:.2f},{a:.5g},{b:.5g}\n" for t, (a, b) in zip(TIME, TAU, strict=True)
    )
    return [Case("pos.csv+torque.csv", {"pos.csv": positions.encode(), "torque.csv": torques.encode()})]


# ── Arrays


def npz() -> list[Case]:
    def plain(path: Path) -> None:
        np.savez(path, time=TIME, q=Q, tau=TAU, remark=np.array("a log"))

    def packed(path: Path) -> None:
        np.savez_compressed(path, **columns())

    return [Case("log.npz", {"log.npz": written(write, "log.npz")}) for write in (plain, packed)]


def npy() -> list[Case]:
    def save(x: np.ndarray) -> bytes:
        file = io.BytesIO()
        np.save(file, x)
        return file.getvalue()

    rows = np.zeros(len(TIME), [(name, float) for name in columns()])
    for name, values in columns().items():
        rows[name] = values
    return [Case("log.npy", {"log.npy": save(x)}) for x in (rows, np.column_stack([TIME, Q]), np.asfortranarray(Q))]


def mat() -> list[Case]:
    from scipy.io import savemat

    content = {"t": TIME[:, None], "q": Q, "tau": TAU, "remark": "a log", "inner": {"a": 1}}
    made = [
        written(lambda path, how=how: savemat(path, content, do_compression=how), "log.mat") for how in (False, True)
    ]
    old = written(lambda path: savemat(path, {"t": TIME[:, None], "q": Q, "tau": TAU}, format="4"), "log.mat")
    return [Case("log.mat", {"log.mat": data}) for data in (*made, old)]


def hdf5() -> list[Case]:
    import h5py

    def plain(path: Path) -> None:
        with h5py.File(path, "w") as file:
            file["time"], file["joint_states/position"], file["joint_states/effort"] = TIME, Q, TAU

    def chunked(path: Path) -> None:
        with h5py.File(path, "w", libver="latest") as file:
            for label, x in columns().items():
                file.create_dataset(label, data=x, chunks=(10,), compression="gzip", shuffle=True, fletcher32=True)

    return [Case(name, {name: written(write, name)}) for write, name in ((plain, "log.h5"), (chunked, "log.hdf5"))]


def mat_73() -> list[Case]:
    head = b"MATLAB 7.3 MAT-file, Platform: x".ljust(124) + b"\x00\x02IM" + bytes(384)
    return [Case("log.mat", {"log.mat": head + case.files[case.main]}) for case in hdf5()]


def parquet(name: str = "log.parquet") -> list[Case]:
    import pyarrow
    import pyarrow.parquet

    content = pyarrow.table(columns() | {"mode": ["run"] * len(TIME)})
    ways: list[dict[str, Any]] = [
        {"compression": "none", "use_dictionary": False}, {"compression": "none", "write_page_checksum": False}, {"compression": "zstd"}, {"compression": "snappy", "data_page_version": "2.0"},
        {"compression": "none", "use_dictionary": False, "column_encoding": {"time": "BYTE_STREAM_SPLIT", "joint1": "BYTE_STREAM_SPLIT"}},
    ]  # fmt: skip
    return [
        Case(name, {name: written(lambda path, way=way: pyarrow.parquet.write_table(content, path, **way), name)})
        for way in ways
    ]


def feather() -> list[Case]:
    import pyarrow
    import pyarrow.feather

    content = pyarrow.table(columns())
    return [
        Case(name, {name: written(lambda path, way=way: pyarrow.feather.write_feather(content, path, compression=way), name)})
        for way, name in (("uncompressed", "log.feather"), ("lz4", "log.feather"), ("zstd", "log.feather"), ("uncompressed", "log.arrow"))
    ]  # fmt: skip


def feather_1() -> list[Case]:
    """Version 1 of the format, without libraries that still write it: magic words around columns and their metadata."""
    import pyarrow
    import pyarrow.feather

    def write(path: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            pyarrow.feather.write_feather(pyarrow.table(columns()), path, version=1, compression=None)

    try:
        data = written(write, "log.feather")
    except (TypeError, ValueError, pyarrow.ArrowException):  # a library that does not write it any more
        data = b"FEA1" + bytes(2000) + b"FEA1"
    return [Case("log.feather", {"log.feather": data})]


def lerobot() -> list[Case]:
    import pyarrow
    import pyarrow.parquet

    def write(path: Path, fixed: bool) -> None:
        kind = pyarrow.list_(pyarrow.float64(), 2) if fixed else pyarrow.list_(pyarrow.float64())
        lists = pyarrow.array(Q.tolist() * 2, kind)
        count = len(TIME)
        content = {
            "observation.state": lists, "action": lists, "timestamp": np.tile(TIME, 2), "frame_index": np.tile(np.arange(count), 2),
            "episode_index": np.repeat([0, 1], count), "index": np.arange(2 * count), "task_index": np.zeros(2 * count, int),
        }  # fmt: skip
        pyarrow.parquet.write_table(pyarrow.table(content), path, compression="none", use_dictionary=fixed)

    new = {
        "codebase_version": "v3.0",
        "robot_type": "so101",
        "fps": 100,
        "features": {"observation.state": {"dtype": "float32", "shape": [2], "names": list(NAMES)}},
    }
    old = {
        "codebase_version": "v2.1",
        "features": {"observation.state": {"names": {"motors": list(NAMES)}}, "action": {"names": None}},
        "use_degrees": True,
    }
    main = "data/chunk-000/file-000.parquet"
    return [
        Case(
            main, {main: written(partial(write, fixed=fixed), "x.parquet"), "meta/info.json": json.dumps(info).encode()}
        )
        for fixed, info in ((True, new), (False, old))
    ]


# ── Recordings of ROS


def mcap() -> list[Case]:
    from mcap_ros2.writer import Writer

    def plain(path: Path) -> None:
        ros_logs.write_mcap(path, NAMES, TIME, Q, TAU)

    def plan(path: Path) -> None:
        message = ros_logs.plan(NAMES, TIME[::8], Q[::8], 0 * Q[::8], 0 * Q[::8])
        ros_logs.write_messages(
            path,
            {"/plan": ("moveit_msgs/msg/RobotTrajectory", ros_logs.ROBOT_PLAN, [(0.0, {"joint_trajectory": message})])},
        )

    def state(path: Path) -> None:
        points = [
            (
                t,
                {
                    "header": ros_logs.header(t),
                    "joint_names": list(NAMES),
                    **{n: ros_logs.point(t, a, 0 * a) for n in ros_logs.CONTROLLERS["new"]},
                },
            )
            for t, a in zip(TIME, Q, strict=True)
        ]
        ros_logs.write_messages(
            path,
            {
                "/state": (
                    "control_msgs/msg/JointTrajectoryControllerState",
                    ros_logs.controller_state("new") + ros_logs.POINT + ros_logs.HEADER,
                    points,
                )
            },
        )

    def unpacked(path: Path) -> None:
        from mcap.writer import CompressionType

        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.NONE, chunk_size=500)
            schema = writer.register_msgdef("sensor_msgs/msg/JointState", ros_logs.JOINT_STATE)
            for t, a in zip(TIME, Q, strict=True):
                message = {
                    "header": ros_logs.header(t),
                    "name": list(NAMES),
                    "position": a.tolist(),
                    "velocity": [],
                    "effort": [],
                }
                writer.write_message(
                    "/joint_states", schema, message, log_time=round(t * 1e9), publish_time=round(t * 1e9)
                )
            writer.finish()

    return [Case("log.mcap", {"log.mcap": written(write, "log.mcap")}) for write in (plain, plan, state, unpacked)]


def _joint_states() -> dict[str, Any]:
    messages = [
        (t, {"header": ros_logs.header(t), "name": list(NAMES), "position": a.tolist(), "velocity": [], "effort": b.tolist()})
        for t, a, b in zip(TIME, Q, TAU, strict=True)
    ]  # fmt: skip
    return {"/joint_states": ("sensor_msgs/msg/JointState", messages)}


def db3() -> list[Case]:
    ways = (True, False)
    made = [
        written(lambda path, way=way: ros_logs.write_database(path, _joint_states(), ros_logs.typestore(), definitions=way), "log.db3")
        for way in ways
    ]  # fmt: skip
    return [
        Case(name, {name: data})
        for data, name in zip((*made, made[0]), ("log.db3", "log.db3", "log.sqlite"), strict=True)
    ]


def bag_folder() -> list[Case]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "bag")
        ros_logs.write_folder(path, _joint_states(), ros_logs.typestore())
        files = {f"bag/{part.name}": part.read_bytes() for part in sorted(path.iterdir())}
    return [Case("bag", files)]


def bag_1() -> list[Case]:
    message = ros_logs.plan(NAMES, TIME[::8], Q[::8], 0 * Q[::8], 0 * Q[::8])

    def plan(path: Path) -> None:
        ros_logs.write_ros1(path, "trajectory_msgs/msg/JointTrajectory", [(0.0, message)])

    def states(path: Path) -> None:
        kind, messages = _joint_states()["/joint_states"]
        ros_logs.write_ros1(path, kind, messages, "/joint_states")

    return [Case("log.bag", {"log.bag": written(write, "log.bag")}) for write in (plan, states)]


# ── Results that the program reads again


def simulated(ending: str) -> list[Case]:
    run = ROBOT.simulate([0.3, 0.2], duration=0.02, dt=1e-3)
    name = f"run{ending}"
    return single(name, written(run.to_csv if ending == ".csv" else run.to_npz, name))


# ── Features that no honest program writes


def named_file(dice: Dice, *endings: str) -> str:
    """Name of another file that HDF5 can write: neither empty nor with a zero byte."""
    return text_of(place(dice, *endings)).replace("\0", "x") or "."


def hdf5_features(dice: Dice) -> Case:
    """A log with one of the features of HDF5 that reach out of the file, never end, or take more than they have."""
    import h5py

    n = dice.choice((10, 40))

    def external(file: Any) -> None:
        outside = [(named_file(dice, ".h5", ".txt", ".csv"), 0, 80)]
        file.create_dataset("joint1", shape=(10,), dtype="f8", external=outside)

    def virtual(file: Any) -> None:
        layout = h5py.VirtualLayout(shape=(n,), dtype="f8")
        layout[:] = h5py.VirtualSource(named_file(dice, ".h5"), "joint1", shape=(n,))
        file.create_virtual_dataset("joint1", layout)

    def of_itself(file: Any) -> None:
        layout = h5py.VirtualLayout(shape=(n,), dtype="f8")
        layout[:] = h5py.VirtualSource(".", "joint1", shape=(n,))
        file.create_virtual_dataset("joint1", layout)

    def linked(file: Any) -> None:
        file["joint1"] = h5py.ExternalLink(named_file(dice, ".h5"), "/joint1")

    def circle(file: Any) -> None:
        file["a/b"] = Q
        file["a/c"] = h5py.SoftLink("/a")
        file["a/d"] = file["a"]

    def wide(file: Any) -> None:
        file.create_dataset("joint1", shape=(n, dice.choice((20_000, 5_000_000))), dtype="f4", chunks=(1, 1000))

    def long(file: Any) -> None:
        file.create_dataset("joint1", shape=(dice.choice((10**7, 10**9, 10**12)),), dtype="f8", chunks=(1000,))

    def large_chunk(file: Any) -> None:
        rows = dice.choice((10**6, 4 * 10**7))
        x = file.create_dataset("joint1", shape=(rows,), dtype="f8", chunks=(rows,), compression="gzip")
        x.id.write_direct_chunk((0,), dice.randbytes(100))

    def kinds(file: Any) -> None:
        kind = dice.choice(
            ("S8", "f2", "c16", "O", "bool", "i1", "V5", ">f8", "vlen", "enum", "compound", "reference", "array")
        )
        special: dict[str, Any] = {
            "O": h5py.string_dtype(), "vlen": h5py.vlen_dtype(float), "enum": h5py.enum_dtype({"a": 1, "b": 2}, "i4"), "reference": h5py.ref_dtype,
            "compound": np.dtype([("a", "f8"), ("b", "S3"), ("c", "f8", (2,))]), "array": np.dtype(("f8", (3,))),
        }  # fmt: skip
        file.create_dataset("joint1", shape=(n,), dtype=special.get(kind, kind))

    def shapes(file: Any) -> None:
        shape = dice.choice(((), (0,), (n, 0), (n, 2, 3), (1, n), (n, 1), (1,) * 20, None))
        file.create_dataset("joint1", data=h5py.Empty("f8")) if shape is None else file.create_dataset(
            "joint1", shape, "f8"
        )

    def named(file: Any) -> None:
        word = text_of(dice.choice(JUNK)).replace("\0", "").encode("utf-8", "replace").decode().strip("/.") or "x"
        file.create_dataset(f"a/{word[:60_000]}"[:60_000], data=TIME[:n])

    def deep(file: Any) -> None:
        file["/".join("g" * dice.choice((50, 900))) + "/x"] = TIME[:n]

    def many(file: Any) -> None:
        for k in range(300):
            file.create_dataset(f"c{k}", shape=(n,), dtype="f4")

    def filters(file: Any) -> None:
        way = dice.choice(
            (
                {"compression": "lzf"},
                {"scaleoffset": 3},
                {"compression": "gzip", "compression_opts": 9},
                {"compression": 32015, "allow_unknown_filter": True},
            )
        )
        file.create_dataset("joint1", (n,), "i4" if "scaleoffset" in way else "f8", chunks=(n,), **way)

    def fill(file: Any) -> None:
        file.create_dataset(
            "joint1", (n,), "f8", fillvalue=dice.choice((np.nan, np.inf, 1e308, 0)), maxshape=(None,), chunks=(5,)
        )

    features = (
        external,
        external,
        virtual,
        of_itself,
        linked,
        circle,
        wide,
        long,
        large_chunk,
        kinds,
        shapes,
        named,
        deep,
        many,
        filters,
        fill,
    )

    def write(path: Path) -> None:
        with h5py.File(path, "w", libver=dice.choice(("earliest", "latest"))) as file:
            file["time"], file["joint2"] = TIME[:n], Q[:n, 1]
            dice.choice(features)(file)
            if "joint1" not in file and dice.often(0.5):
                file["joint1"] = Q[:n, 0]

    return Case("log.h5", {"log.h5": written(write, "log.h5")})


def arrow_features(dice: Dice) -> Case:
    """A table with columns, types, encodings and sizes that logs do not have, as parquet or feather."""
    import pyarrow
    import pyarrow.feather
    import pyarrow.parquet

    n = dice.choice((0, 1, 40, 3000))
    numbers = np.linspace(0, 1, n)
    kinds: tuple[Callable[[], Any], ...] = (
        lambda: pyarrow.nulls(n), lambda: pyarrow.array([None] * n, pyarrow.float64()), lambda: pyarrow.array(["x"] * n), lambda: pyarrow.array([b"\xff"] * n),
        lambda: pyarrow.array([[1.0, 2.0]] * n, pyarrow.list_(pyarrow.float64())), lambda: pyarrow.array([[1.0]] * (n // 2) + [[1.0, 2.0]] * (n - n // 2)),
        lambda: pyarrow.array([[[1.0]]] * n), lambda: pyarrow.array([{"a": 1}] * n), lambda: pyarrow.array([1] * n).dictionary_encode(), lambda: pyarrow.array(np.zeros(n, "f2")),
        lambda: pyarrow.array([10**8] * n, pyarrow.timestamp("ns", "Europe/Berlin")), lambda: pyarrow.array([1] * n, pyarrow.date32()), lambda: pyarrow.array([1] * n, pyarrow.duration("us")),
        lambda: pyarrow.array([1] * n).cast(pyarrow.decimal128(30, 2)), lambda: pyarrow.array([True] * n), lambda: pyarrow.array([2**63] * n, pyarrow.uint64()),
        lambda: pyarrow.array([[0.0] * 3000] * min(n, 40) + [None] * max(0, n - 40)), lambda: pyarrow.array([None, *([[1.0]] * (n - 1))] if n else []),
        lambda: pyarrow.array([np.nan] * n), lambda: pyarrow.array([2**62] * n), lambda: pyarrow.array([-(2**63)] * n, pyarrow.timestamp("s")),
    )  # fmt: skip
    columns_: dict[str, Any] = {
        "time": pyarrow.array(numbers),
        "joint1": pyarrow.array(numbers),
        "joint2": pyarrow.array(numbers),
    }
    for _ in range(dice.choice((1, 2))):
        junk = text_of(dice.choice(JUNK)).encode("utf-8", "replace").decode()
        name = dice.choice(("joint1", "time", "joint2", "observation.state", "episode_index", "extra", junk))
        columns_[name] = dice.choice(kinds)()
    if dice.often(0.1):
        columns_ |= {f"c{k}": pyarrow.array(numbers) for k in range(400)}
    content = pyarrow.table([*columns_.values()], names=[*columns_])
    if dice.often(0.1):
        content = pyarrow.table(
            [*content.columns, content.column(0)], names=[*content.column_names, content.column_names[0]]
        )
    ending = dice.choice((".parquet", ".parquet", ".feather", ".arrow"))

    def write(path: Path) -> None:
        if ending == ".parquet":
            way = dice.choice(("none", "zstd", "gzip", "brotli"))
            pyarrow.parquet.write_table(
                content, path, compression=way, row_group_size=dice.choice((7, 1000)), use_dictionary=dice.often(0.5)
            )
        elif ending == ".arrow" and dice.often(0.3):
            with pyarrow.OSFile(str(path), "wb") as sink, pyarrow.ipc.new_stream(sink, content.schema) as stream:
                stream.write_table(content)
        else:
            pyarrow.feather.write_feather(content, path, compression=dice.choice(("uncompressed", "zstd", "lz4")))

    try:
        data = written(write, f"log{ending}")
    except (pyarrow.ArrowException, ValueError, TypeError):  # a type that the format does not have
        return dice.choice(parquet())
    return Case(f"log{ending}", {f"log{ending}": data})
