"""Reading of changed files by child processes, and what was found against the rules."""

from __future__ import annotations

import importlib.util
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from . import robot_seeds
from .kinds import Kind
from .robot_seeds import Case

SECONDS = 5.0
"""Processor time of one file at most [s]."""
WAIT = 100.0
"""Time of one file at most [s]: child processes of readers end after 30 s of processor time, or three times that of waiting."""
TESTS = Path(__file__).parents[1]


@dataclass(frozen=True)
class Failure:
    """A file that a reader does not bear."""

    kind: str
    number: int
    door: str
    what: str

    def __str__(self) -> str:
        return f"{self.kind} {self.number}, {self.door}: {self.what}"


@dataclass
class Tally:
    """How many files were read, refused or failed, by their kind."""

    ended: dict[str, Counter[str]] = field(default_factory=dict)
    failures: list[Failure] = field(default_factory=list)

    def add(self, kind: Kind, number: int, door: str, answer: dict[str, Any]) -> None:
        word = "failed" if answer["problems"] else answer["ended"].partition(":")[0]
        self.ended.setdefault(kind.name, Counter())[word] += 1
        if answer["problems"]:
            self.failures.append(Failure(kind.name, number, door, "; ".join(answer["problems"])))

    def __str__(self) -> str:
        lines = [f"{'kind':18} {'files':>6} {'read':>6} {'refused':>8} {'failed':>7}"]
        for kind, counts in self.ended.items():
            lines.append(f"{kind:18} {counts.total():6} {counts['read']:6} {counts['refused']:8} {counts['failed']:7}")
        whole = sum(self.ended.values(), Counter[str]())
        lines.append(f"{'all':18} {whole.total():6} {whole['read']:6} {whole['refused']:8} {whole['failed']:7}")
        return "\n".join(lines)


def missing(kind: Kind) -> list[str]:
    """Packages that the kind needs and that are not installed."""
    return [name for name in kind.needs if importlib.util.find_spec(name) is None]


class Reader:
    """A child process for many files, started again when it dies, and the folders around it.

    Below ``base`` there are the folder of the case, the one for temporary files, and one outside, with secrets that a file may
    name and no reader may open.
    """

    def __init__(self, seconds: float = SECONDS, wait: float = WAIT) -> None:
        self.seconds, self.wait = seconds, wait
        self.base = Path(tempfile.mkdtemp(prefix="twistwrench-fuzz-")).resolve()
        self.folder, self.scratch, self.outside = self.base / "in" / "case", self.base / "tmp", self.base / "out"
        for place in (self.folder, self.scratch, self.outside):
            place.mkdir(parents=True)
        self._plant()
        self.child: subprocess.Popen[str] | None = None

    def _plant(self) -> None:
        """Files outside, whole of their kinds, so that a reader that opens one would go on; and pipes that nobody writes to."""
        whole = {
            ".stl": robot_seeds.stl_binary(), ".obj": robot_seeds.obj(), ".dae": robot_seeds.dae(), ".msh": robot_seeds.msh(), ".xml": b'<mujocoinclude><!-- SECRET --></mujocoinclude>',
            ".usda": robot_seeds.PART, ".xacro": b"<robot><SECRET/></robot>", ".yaml": b"SECRET: 1\n", ".csv": b"SECRET\n1\n", ".sdf": robot_seeds.SDF, ".h5": b"SECRET" * 99, ".txt": b"SECRET" * 99,
        }  # fmt: skip
        for ending, data in whole.items():
            (self.outside / f"secret{ending}").write_bytes(data)
            with suppress(AttributeError, OSError):
                os.mkfifo(self.outside / f"pipe{ending}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._end()
        shutil.rmtree(self.base, ignore_errors=True)

    def _started(self) -> subprocess.Popen[str]:
        if self.child is None or self.child.poll() is not None:
            environment = {
                **os.environ,
                "TMPDIR": str(self.scratch),
                "OPENBLAS_NUM_THREADS": "1",
                "PYTHONFAULTHANDLER": "",
            }
            environment.setdefault("TWISTWRENCH_CACHE_DIR", str(self.scratch / "cache"))
            environment["PYTHONPATH"] = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
            command = [
                sys.executable,
                "-W",
                "ignore",
                "-m",
                f"{__package__.rpartition('.')[2]}.worker",
                str(self.scratch),
                str(self.outside),
                str(self.seconds),
            ]
            self.child = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment, cwd=self.scratch
            )  # fmt: skip
        return self.child

    def _end(self) -> None:
        if self.child is not None:
            self.child.kill()
            self.child.communicate()
            self.child = None

    def write(self, case: Case) -> None:
        """Put the files of a case into its folder, in place of those before."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        for name, data in case.files.items():
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)

    def read(self, case: Case, door: str) -> dict[str, Any]:
        """How the reading of a case ended, and what was found against the rules."""
        self.write(case)
        child = self._started()
        assert child.stdin is not None and child.stdout is not None
        path = str(self.folder / case.main).replace("+", f"+{self.folder}/")
        child.stdin.write(json.dumps({"door": door, "path": path, "folder": str(self.folder)}) + "\n")
        child.stdin.flush()
        until = time.monotonic() + self.wait
        while not select.select([child.stdout], [], [], max(0.0, until - time.monotonic()))[0]:
            if time.monotonic() > until and not _runs(child.pid):
                self._end()
                return {"ended": "waits", "problems": [f"waits for more than {self.wait:.0f} s"]}
            until = time.monotonic() + 1.0  # the machine is busy, and the limit is one of processor time
        line = child.stdout.readline()
        if line:
            answer: dict[str, Any] = json.loads(line)
            if answer["problems"]:
                self._end()  # whatever it left behind
            return answer
        code = child.wait()
        self._end()
        what = f"takes more than {self.seconds:.0f} s" if code == -27 else f"the process ends with {code}"
        return {"ended": "crashed", "problems": [what]}


def _runs(pid: int) -> bool:
    """True if the process is computing, rather than waiting."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()[0]
    except (OSError, IndexError):
        return False
    return state == "R"


def run(
    kinds: Iterable[Kind], count: int, seed: str, *, first: int = 0, keep: Path | None = None, seconds: float = SECONDS
) -> Tally:
    """Read ``count`` files of each kind, times its share, and write those that fail below ``keep``."""
    tally = Tally()
    with Reader(seconds) as reader:
        for kind in kinds:
            if missing(kind):
                continue
            if first == 0:
                case, door = kind.whole[0], kind.doors[0]
                answer = reader.read(case, door)
                if answer["problems"] or answer["ended"].startswith("read") == kind.refused:
                    tally.failures.append(Failure(kind.name, -1, door, f"the whole file is not read: {answer}"))
            for number in range(first, first + max(1, round(count * kind.share))):
                case, door = kind.case(number, seed, str(reader.outside))
                answer = reader.read(case, door)
                tally.add(kind, number, door, answer)
                if answer["problems"] and keep is not None:
                    kept(case, keep / f"{kind.name.replace(' ', '_')}-{number}")
    return tally


def kept(case: Case, place: Path) -> None:
    for name, data in case.files.items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def unread(kinds: Iterable[Kind]) -> Iterator[str]:
    """Whole files that an entry point does not read: a mutation of them would show nothing."""
    with Reader() as reader:
        for kind in kinds:
            for case in [] if missing(kind) else kind.whole:
                ends = {door: reader.read(case, door) for door in dict.fromkeys(kind.doors)}
                if not any(answer["ended"] == "read" for answer in ends.values()):
                    yield f"{kind.name}, {case.main}: {ends}"
