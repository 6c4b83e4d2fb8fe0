"""Readers that break a rule each, which the harness has to notice."""

from __future__ import annotations

import os
import socket
import subprocess
from pathlib import Path

import twistwrench as tw


def crashes(_: Path) -> None:
    os.abort()


def has_no_end(_: Path) -> None:
    while True:
        pass


def waits(path: Path) -> None:
    os.mkfifo(path.with_name("pipe"))
    path.with_name("pipe").read_bytes()


def takes_memory(_: Path) -> None:
    bytearray(1_700_000_000)


def claims_memory(_: Path) -> None:
    try:
        bytearray(1 << 40)
    except MemoryError as problem:
        raise tw.TrajectoryError("refused") from problem


def raises_what_is_no_error_of_the_library(_: Path) -> None:
    raise KeyError("x")


def opens_a_file_elsewhere(path: Path) -> None:
    (path.parents[2] / "out" / "secret.stl").read_bytes()


def reaches_a_file_by_foreign_code(path: Path) -> None:
    import ctypes

    ctypes.CDLL(None).open(str(path.parents[2] / "out" / "secret.stl").encode(), 0)


def writes_a_file_elsewhere(path: Path) -> None:
    (path.parents[2] / "made").write_bytes(b"")


def runs_a_command(_: Path) -> None:
    os.system("true")


def starts_a_program(_: Path) -> None:
    subprocess.run(["true"], check=True)


def opens_a_connection(_: Path) -> None:
    with socket.socket() as opened:
        opened.connect_ex(("127.0.0.1", 9))


def speaks_too_long(_: Path) -> None:
    class VerboseError(tw.ModelError):
        def __str__(self) -> str:
            return "x" * 1002

    raise VerboseError


def speaks_control_characters(_: Path) -> None:
    class RawError(tw.ModelError):
        def __str__(self) -> str:  # errors of the library escape them
            return "joint '\x1b[2J'"

    raise RawError


MISDEEDS = {
    crashes: "the process ends with -6", has_no_end: "takes more than", waits: "waits for more than", takes_memory: "MiB of memory", claims_memory: "more memory than the limit",
    raises_what_is_no_error_of_the_library: "KeyError", opens_a_file_elsewhere: "opens", reaches_a_file_by_foreign_code: "reaches 'secret.stl'", writes_a_file_elsewhere: "writes",
    runs_a_command: "os.system", starts_a_program: "subprocess.Popen", opens_a_connection: "socket.connect", speaks_too_long: "1002 characters", speaks_control_characters: "x1b",
}  # fmt: skip
