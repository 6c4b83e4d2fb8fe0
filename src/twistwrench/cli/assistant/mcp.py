"""The command ``twistwrench mcp``: a server for coding assistants on standard input and output."""

from __future__ import annotations

import io
import os
import sys

import click

from ...core.verdict import ExitCode
from ..main import drop_output, option, plain_command
from .confinement import Folder
from .server import Server
from .tools import Tools


@plain_command(
    "mcp",
    click.argument("folder", metavar="[FOLDER]", default="."),
    option("--expand-xacro", "Expand macros of xacro in robot files."),
    examples=("mcp", "mcp my_robots"),
)
def mcp_command(folder: str, *, expand_xacro: bool) -> int | None:
    """Serve a coding assistant by the Model Context Protocol, on standard input and output.

    Eight commands are tools: torques, payload, doctor, info, identify, move, size, convert. Files are read and written below
    FOLDER only, by default the present one. The server ends with its input.
    """
    place = Folder(folder)
    with os.fdopen(os.dup(0), "rb") as requests, os.fdopen(os.dup(1), "wb") as answers:
        with open(os.devnull, "rb") as nothing:  # noqa: PTH123  a device
            os.dup2(nothing.fileno(), 0)
        os.dup2(2, 1)  # what a library prints is not an answer
        sys.stdin = io.StringIO()
        place.confine()
        try:
            Server(Tools(place, expands_xacro=expand_xacro)).serve(requests, answers)
            answers.flush()
        except BrokenPipeError:
            drop_output(answers)
            return ExitCode.PIPE_CLOSED
    return None
