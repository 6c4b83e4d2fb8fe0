"""Changed files of every kind are read, or refused in one error: no crash, no reading without end, nothing out of their folder.

``python -m tests.fuzz --kind MCAP --first 17 --count 1 --keep /tmp/failed`` reads one file again and keeps it.
"""

from __future__ import annotations

import re
import sys
import time
import tomllib
from pathlib import Path

import pytest

import twistwrench as tw
from twistwrench.formats.robot_file import USD
from twistwrench.mechanics.bodies.mesh_files import SUFFIXES as MESHES
from twistwrench.motion.readers.array_files import _READERS

from . import log_seeds
from .containers import database
from .harness import Reader, Tally, missing, run
from .kinds import KINDS
from .known import KNOWN
from .misdeeds import MISDEEDS, takes_memory
from .mutations import Dice
from .robot_seeds import Case

QUICK = [kind for kind in KINDS.values() if not kind.slow]
FEW = 3
"""Files of each kind in the short form, times its share."""
MANY = 460
"""The same in the long form, 20,000 in all."""
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of processes are those of Linux")


def unknown(tally: Tally) -> list[str]:
    """Failures that are not among those that are known."""
    return [str(f) for f in tally.failures if not any(k == f.kind and re.search(what, f.what) for k, what, _ in KNOWN)]


@linux
def test_changed_files_of_every_kind_read_or_end_in_one_error(tmp_path: Path) -> None:
    tally = run(QUICK, FEW, "short", keep=tmp_path)
    print(tally)
    assert not unknown(tally), "\n".join([*unknown(tally), f"kept in {tmp_path}"])
    assert tally.ended.keys() == {kind.name for kind in QUICK if not missing(kind)}


@linux
@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_many_changed_files_read_or_end_in_one_error(name: str, tmp_path: Path) -> None:
    if missing(KINDS[name]):
        pytest.skip(f"needs {', '.join(missing(KINDS[name]))}")
    tally = run([KINDS[name]], MANY, "long", keep=tmp_path)
    print(tally)
    assert not unknown(tally), "\n".join([*unknown(tally), f"kept in {tmp_path}"])


def test_files_of_hdf5_are_written_whatever_name_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Links to other files by an empty name or one with a zero byte, which the library does not write."""
    pytest.importorskip("h5py")
    for name in (b"", b"a\x00.h5"):
        monkeypatch.setattr(log_seeds, "place", lambda _dice, *_endings, name=name: name)
        for number in range(60):
            assert log_seeds.hdf5_features(Dice(str(number))).files


def test_a_database_whose_names_are_damaged_is_changed_further() -> None:
    """Names that are not UTF-8 in a schema that cannot be parsed, left by an earlier change."""
    data = log_seeds.db3()[0].files["log.db3"]
    data = data.replace(b"topics", b"topic\xff").replace(b"CREATE TABLE topic", b"CREATE TABLX topic")
    for number in range(40):
        assert database(data, Dice(str(number)))


# ── No reader is left out


def test_every_reader_has_its_kinds_of_files() -> None:
    """Readers are those of the table of threats, which every module that opens files stands in."""
    table = tomllib.loads((Path(tw.__file__).parent / "formats" / "threats.toml").read_text("utf-8"))
    by_name = {"packages of robots"}  # found by name in installed packages, and read as the kinds here
    of_streams = {"requests of assistants"}  # lines on standard input: tests/cli/test_assistant_server.py
    assert {kind.threats for kind in KINDS.values()} == table["readers"].keys() - by_name - of_streams


@pytest.mark.skipif(any(map(missing, QUICK)), reason="needs the packages of all readers")
def test_every_ending_that_a_reader_knows_has_a_whole_file() -> None:
    known = {
        *_READERS,
        *USD,
        *MESHES,
        ".urdf",
        ".xml",
        ".sdf",
        ".xacro",
        ".srdf",
        ".mcap",
        ".bag",
        ".db3",
        ".csv",
        ".gz",
        ".yaml",
        ".json",
    }
    there = {Path(name).suffix for kind in QUICK for case in kind.whole for name in case.files}
    assert not known - there, f"no file with {sorted(known - there)}"


# ── The harness notices what it is made for


@linux
@pytest.mark.parametrize("misdeed", MISDEEDS, ids=lambda deed: deed.__name__)
def test_the_harness_notices(misdeed, reader: Reader, patient: Reader) -> None:
    """Filling memory takes processor time of its own, so it is read with more of it."""
    used = patient if misdeed is takes_memory else reader
    answer = used.read(Case("file", {"file": b""}), misdeed.__name__)
    assert any(MISDEEDS[misdeed] in problem for problem in answer["problems"]), answer


@pytest.fixture(scope="module")
def reader():
    with Reader(seconds=1.0, wait=3.0) as made:
        yield made


@pytest.fixture(scope="module")
def patient():
    with Reader(seconds=20.0, wait=60.0) as made:
        yield made


@pytest.mark.parametrize(
    "kind",
    [kind for kind in QUICK if kind.threats in ("URDF", "CSV logs", "NumPy logs", "actuator files")],
    ids=lambda kind: kind.name,
)
def test_a_seed_gives_the_same_files_at_any_hour_and_nearly_all_are_changed(kind, monkeypatch) -> None:
    cases = [kind.case(number, "same", "/out")[0] for number in range(30)]
    monkeypatch.setattr(time, "time", lambda clock=time.time: clock() + 86_400.0)
    assert cases == [kind.case(number, "same", "/out")[0] for number in range(30)]
    assert sum(case.files in [whole.files for whole in kind.whole] for case in cases) <= 6
    assert len({repr(case) for case in cases}) > 24
    assert Dice("1").random() == Dice("1").random()
