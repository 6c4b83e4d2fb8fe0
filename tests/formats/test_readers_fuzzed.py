"""Every reader of files against files made to do harm, and files with values of other kinds: only errors of the library come out.

Files that are changed at random are those of ``tests/fuzz``.
"""

from __future__ import annotations

import base64
import io
import json
import random
import string
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.third_party import reason_of, third_party_errors
from twistwrench.motion.limits_file import read_limits
from twistwrench.sensing.files import read_sensor, write_sensor
from twistwrench.simulation import SimulationResult

ROBOT = tw.robots.planar_2r()
UR5 = tw.robots.ur5()


@cache
def written(write: Callable[[Path], Any]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "file")
        write(path)
        return path.read_bytes()


RUN = ROBOT.simulate([0.3, 0.2], duration=0.02, dt=1e-3)


def simulated(suffix: str) -> bytes:
    return written(RUN.to_csv if suffix == ".csv" else RUN.to_npz)


def write_a_sensor(path: Path) -> None:
    write_sensor(tw.sensing.ForceTorqueSensor(tw.SpatialInertia.box((0.1, 0.1, 0.1), mass=1.0)), path, (0.01, 0.1))


def sensor_file() -> bytes:
    return written(write_a_sensor)


def outcome(read: Callable[[Path], Any], path: Path) -> tw.TwistWrenchError | None:
    """The error that a reader ends in; any other than one of the library fails the test with the bytes that brought it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path)
    except tw.TwistWrenchError as error:
        return error
    except BaseException as error:
        shown = base64.b64encode(path.read_bytes()[:3000]).decode()
        raise AssertionError(f"{path.name} ends in {type(error).__name__}: {error}; its bytes: {shown}") from error
    return None


# ── values of other kinds in files that parse ──


OTHERS = [
    None,
    True,
    False,
    0,
    -1,
    1e308,
    10**400,
    "",
    "x",
    "1",
    [],
    [[]],
    [1],
    ["x"],
    {},
    {"a": 1},
    [None],
    [True],
    [[1], [2, 3]],
    "\ud800",
]


def places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths to all values within."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at, *(p for key, v in inner for p in places(v, (*at, key)))]


def with_other(content: Any, at: tuple[Any, ...], other: Any) -> Any:
    if not at:
        return other
    copied = json.loads(json.dumps(content))
    inner = copied
    for key in at[:-1]:
        inner = inner[key]
    if other is places:
        del inner[at[-1]]
    else:
        inner[at[-1]] = other
    return copied


def variants(content: Any, count: int, seed: str) -> list[Any]:
    """The content with a value replaced by one of another kind, or left out."""
    rng = random.Random(seed)
    where = places(content)
    return [
        with_other(content, at, rng.choice([*OTHERS, places]) if at else rng.choice(OTHERS))
        for at in rng.choices(where, k=count)
    ]


def test_sensor_files_with_values_of_other_kinds(tmp_path):
    path, refused = tmp_path / "sensor.json", 0
    for content in variants(json.loads(sensor_file()), 400, "sensor"):
        path.write_text(json.dumps(content))
        refused += outcome(read_sensor, path) is not None
    assert refused > 200


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_simulations_with_words_of_other_kinds(tmp_path, suffix):
    """Each word of what is said is replaced by values of every other kind; a reader that takes one would fail much later."""
    path, whole = tmp_path / f"run{suffix}", simulated(suffix)
    if suffix == ".csv":
        mark, said, rest = whole.split(b"\n", 2)
        content = json.loads(said[1:])
    else:
        with np.load(io.BytesIO(whole)) as archive:
            arrays = dict(archive)
        content = json.loads(str(arrays["said"]))
    content["events"] = [{"name": "touch", "time": 0.01, "q": [0.1, 0.2], "dq": [0.0, 0.0]}]
    kept = 0
    for changed in [content, *variants(content, 250, suffix)]:
        if suffix == ".csv":
            path.write_bytes(b"\n".join([mark, b"# " + json.dumps(changed).encode(), rest]))
        else:
            np.savez(path, **{**arrays, "said": np.array(json.dumps(changed))})
        if outcome(SimulationResult.load, path) is None:
            result = SimulationResult.load(path)
            repr(result)
            assert all(
                isinstance(x, str) for x in (result.stopped, result.method, *result.coordinate_names, *result.remarks)
            )
            assert all(e.q.shape == (2,) and e.dq.dtype == float for e in result.events)
            kept += 1
    assert 1 <= kept < 125


def test_simulations_with_arrays_of_other_kinds(tmp_path):
    path = tmp_path / "run.npz"
    with np.load(io.BytesIO(simulated(".npz"))) as archive:
        arrays = dict(archive)
    others = [
        np.array(0.0),
        np.zeros(0),
        np.zeros((3, 3)),
        np.array("x"),
        np.array([True]),
        np.zeros(21, complex),
        np.zeros((21, 2), "U3"),
    ]
    for name in arrays:
        for other in others:
            np.savez(path, **{**arrays, name: other})
            assert outcome(SimulationResult.load, path) is not None, name


# ── files made to do harm ──


def claims(shape: str) -> bytes:
    """An archive whose first array claims a size in its header that it has not."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    member = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode() + b"\x00" * 64
    return archived({"format.npy": archive_member(np.array("twistwrench simulation 1")), "times.npy": member})


def archive_member(x: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, x)
    return file.getvalue()


def archived(members: dict[str, bytes]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return file.getvalue()


def with_method(data: bytes, number: int) -> bytes:
    """The archive with another method of compression written over all its entries."""
    out, k = bytearray(data), 0
    for mark, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        k = data.find(mark)
        while k >= 0:
            out[k + offset : k + offset + 2] = number.to_bytes(2, "little")
            k = data.find(mark, k + 1)
    return bytes(out)


def encrypted(data: bytes) -> bytes:
    out = bytearray(data)
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        k = data.find(mark)
        while k >= 0:
            out[k + offset] |= 1
            k = data.find(mark, k + 1)
    return bytes(out)


DEEP = 100_000
NOT_A_NUMBER = b'# twistwrench simulation 1\n# {"robot": '

HARM: dict[str, tuple[str, Callable[[], bytes], Callable[[Path], Any]]] = {
    "npz: damaged stream": (".npz", lambda: (d := simulated(".npz"))[:90] + b"\xff" * 40 + d[130:], SimulationResult.load),
    "npz: unknown compression": (".npz", lambda: with_method(simulated(".npz"), 99), SimulationResult.load),
    "npz: Deflate64": (".npz", lambda: with_method(simulated(".npz"), 9), SimulationResult.load),
    "npz: encrypted": (".npz", lambda: encrypted(simulated(".npz")), SimulationResult.load),
    "npz: claims 5 GB": (".npz", lambda: claims("(625000000,)"), SimulationResult.load),
    "npz: claims 8 EB": (".npz", lambda: claims("(1000000000000000000,)"), SimulationResult.load),
    "npz: claims less than nothing": (".npz", lambda: claims("(-1,)"), SimulationResult.load),
    "npz: a deep header": (".npz", lambda: claims("(" * 3000 + ")" * 3000), SimulationResult.load),
    "npz: objects": (".npz", lambda: archived({"format.npy": archive_member(np.array([{}], object))}), SimulationResult.load),
    "npz: no arrays": (".npz", lambda: archived({"format.npy": b"what is this"}), SimulationResult.load),
    "npz: cut": (".npz", lambda: simulated(".npz")[:1000], SimulationResult.load),
    "csv: deep words": (".csv", lambda: NOT_A_NUMBER + b"[" * DEEP + b"\n", SimulationResult.load),
    "csv: a number of 5000 digits": (".csv", lambda: NOT_A_NUMBER + b"9" * 5000 + b"}\n", SimulationResult.load),
    "csv: no text": (".csv", lambda: bytes(range(256)), SimulationResult.load),
    "json: deep lists": (".json", lambda: b"[" * DEEP, read_sensor),
    "json: deep entries": (".json", lambda: b'{"a":' * DEEP, read_sensor),
    "json: a number of 5000 digits": (".json", lambda: b'{"load": ' + b"9" * 5000 + b"}", read_sensor),
    "json: a list": (".json", lambda: b"[]", read_sensor),
    "json: text": (".json", lambda: b'"load"', read_sensor),
    "json: half a surrogate": (".json", lambda: b'{"load": "\\ud800"}', read_sensor),
    "yaml: deep lists": (".yaml", lambda: b"actuators: " + b"[" * DEEP, UR5.with_actuators),
    "yaml: deep entries": (".yaml", lambda: b"actuators: " + b"{a: " * (DEEP // 2), UR5.with_actuators),
    "yaml: deep dashes": (".yaml", lambda: b"- " * DEEP, UR5.with_actuators),
    "yaml: deep questions": (".yaml", lambda: b"? " * DEEP, UR5.with_actuators),
    "yaml: deep blocks": (".yaml", lambda: b"".join(b" " * k + b"a:\n" for k in range(500)), UR5.with_actuators),
    "yaml: itself": (".yaml", lambda: b"actuators: &a {elbow_joint: *a}\n", UR5.with_actuators),
    "yaml: a billion of it": (
        ".yaml",
        lambda: (
            "".join(f"- &{string.ascii_letters[k + 1]} [{','.join([f'*{string.ascii_letters[k]}'] * 9)}]\n" for k in range(20))
            .replace("- &b", "- &a [x]\n- &b", 1)
            .encode()
        ),
        UR5.with_actuators,
    ),
    "yaml: an object of Python": (".yaml", lambda: b"actuators: !!python/object/apply:os.system [x]\n", UR5.with_actuators),
    "yaml: large": (".yaml", lambda: b"# \n" * 2**18, UR5.with_actuators),
    "xml: half a surrogate": (".urdf", lambda: b'<?xml version="1.0" encoding="utf-7"?><robot name="+2AA-"/>', tw.load),
    "xml: an encoding that is none": (".urdf", lambda: b'<?xml version="1.0" encoding="undefined"?><robot/>', tw.load),
    "xml: an encoding of bytes": (".urdf", lambda: b'<?xml version="1.0" encoding="zlib"?><robot/>', tw.load),
    "xml: Python's escapes": (".urdf", lambda: b'<?xml version="1.0" encoding="unicode_escape"?><robot name="\\q"/>', tw.load),
    "xml: deep elements": (".urdf", lambda: b"<robot>" + b"<a>" * DEEP, tw.load),
    "xml: entities": (".urdf", lambda: b'<!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><robot name="&b;"/>', tw.load),
    "limits: a cell of a megabyte": (".csv", lambda: b"joint,effort\n" + b"9" * 2**20 + b",1\n", lambda p: read_limits(p, ROBOT.model)),
    "limits: a quote that stays open": (".csv", lambda: b'joint,effort\n"joint1,1\n', lambda p: read_limits(p, ROBOT.model)),
}  # fmt: skip


@pytest.mark.parametrize("case", HARM)
def test_files_made_to_do_harm_end_in_one_error(case, tmp_path):
    suffix, whole, read = HARM[case]
    path = tmp_path / f"file{suffix}"
    path.write_bytes(whole())
    error = outcome(read, path)
    assert error is not None
    assert "file" in str(error)
    assert len(str(error)) < 1000


@pytest.mark.parametrize("text", ['<robot name="\ud800"><link name="a"/></robot>', '<robot name="a\x00b"/>'])
def test_text_that_is_no_text_is_refused(text):
    with pytest.raises(tw.RobotFileError, match="the text given"):
        tw.load(text)


# ── the one place where foreign errors become ours ──


@pytest.mark.parametrize(
    "problem",
    [ValueError("a\nb."), MemoryError(), RecursionError("x"), zipfile.BadZipFile("x"), KeyError("x"), OSError(5, "no")],
)
def test_foreign_errors_become_the_one_that_is_asked_for(problem):
    with pytest.raises(tw.ModelError) as caught, third_party_errors(lambda why: tw.ModelError(f"cannot: {why}.")):
        raise problem
    assert caught.value.__cause__ is problem
    assert str(caught.value) == f"cannot: {reason_of(problem)}."
    assert "\n" not in str(caught.value)


def test_own_errors_and_interrupts_pass_as_they_are():
    for problem in (tw.NotFoundError("x"), KeyboardInterrupt(), SystemExit(1)):
        with pytest.raises(type(problem)) as caught, third_party_errors(tw.ModelError):
            raise problem
        assert caught.value is problem
