"""How the shell speaks and ends: errors in one line each with their exit codes, the library's sentences in words of options."""

from __future__ import annotations

import errno
import os
import re
import shlex
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import click

from ..interrupts import end_at_once
from ..verdict import ExitCode
from .help import OwnOptionsFirst
from .streams import take_every_sign, visible_streams

_KEYWORD = re.compile(r"\b(?P<name>[a-z]\w*)=(?:'(?P<word>[^']*)'|(?P<truth>True|False)|…|(?=[\s.,;]))")
"""A keyword argument in a sentence of the library: ``tip=…``, ``inertia='repair'``, ``overwrite=True``."""

_REFUSED = tuple(
    getattr(errno, name)
    for name in ["ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS", "ENAMETOOLONG", "ENOMEM", "EMFILE", "ENFILE"]
)
"""What the system says where it cannot go on, through no fault of the program: full disks, names too long, and the like."""

_LONGEST = 80
_HEARD: list[bool] = []
"""Whether Ctrl-C was heard."""

TRACEBACK = "TWISTWRENCH_TRACEBACK"
"""The environment variable that shows where a fault of the program arose."""


class Commands(click.Group):
    """Commands whose errors are one line each, and whose exit codes are those of :class:`~twistwrench.verdict.ExitCode`."""

    command_class = OwnOptionsFirst

    def main(self, *args: Any, **options: Any) -> Any:
        """Run as a program that cleans up behind itself when it is told to end."""
        take_every_sign()
        with _terminable(), _interruptible(), visible_streams():
            return super().main(*args, **options)

    def make_context(self, *args: Any, **options: Any) -> click.Context:
        """Parse, with usage errors in one line."""
        with _own_endings(), _short_usage():
            return super().make_context(*args, **options)

    def invoke(self, ctx: click.Context) -> Any:
        """Run, with errors in one line."""
        with _own_endings(), _short_usage():
            answer = super().invoke(ctx)
            sys.stdout.flush()  # while a full disk can still be said
            return answer


class _UsageLine(click.ClickException):
    exit_code = ExitCode.BAD_INPUT

    def show(self, file: Any = None) -> None:
        click.echo(f"error: {self.message}", file=file, err=True)


@contextmanager
def _short_usage() -> Iterator[None]:
    try:
        yield
    except click.exceptions.NoArgsIsHelpError:
        raise
    except click.UsageError as error:
        where = f" See {error.ctx.command_path} --help." if error.ctx else ""
        raise _UsageLine(" ".join(error.format_message().split()) + where) from None


@contextmanager
def _own_endings() -> Iterator[None]:
    """Interrupts, closed pipes and faults of the program end with codes of their own, and no traceback unless asked for."""
    try:
        yield
    except (click.ClickException, click.exceptions.Exit, click.Abort):
        raise
    except KeyboardInterrupt:
        _say("interrupted")
        sys.exit(ExitCode.INTERRUPTED)
    except BrokenPipeError:
        _drop_output()
        sys.exit(ExitCode.PIPE_CLOSED)
    except Exception as fault:
        if _HEARD:  # by a library that made an error of its own of it
            _say("interrupted")
            sys.exit(ExitCode.INTERRUPTED)
        if isinstance(fault, MemoryError) or (isinstance(fault, OSError) and fault.errno in _REFUSED):
            place = getattr(fault, "filename", None)
            what = getattr(fault, "strerror", None) or "more memory is needed than there is"
            _say(f"error: {what}{'' if place is None else f': {str(place)[:_LONGEST]}'}.")
            if isinstance(fault, OSError):
                _drop_output()
            sys.exit(ExitCode.BAD_INPUT)
        asked = os.environ.get(TRACEBACK, "").lower() not in ("", "0", "off", "false")
        if asked:
            _say("".join(traceback.format_exception(fault)).rstrip())
        said = " ".join(str(fault).split())
        what = f"{type(fault).__name__}: {said[:300]}" if said else type(fault).__name__
        hint = "" if asked else f"; {TRACEBACK}=1 shows where it arose"
        _say(
            f"error: a fault of twistwrench itself, not of your input: {what}. Please report it with the command{hint}."
        )
        sys.exit(ExitCode.FAULT)


def _say(text: str) -> None:
    """On standard error, if it still takes anything."""
    with suppress(OSError, ValueError):
        click.echo(text, err=True)


def _drop_output() -> None:
    """Let what is left in the buffer of standard output, which has nowhere to go, not fail again at the end."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt and is remembered, should a library swallow it. What the caller set for it stays."""
    _HEARD.clear()
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before not in (
        signal.default_int_handler,
        end_at_once,
    ):
        yield
        return

    def heard(*_: Any) -> None:
        _HEARD.append(True)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, heard)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _terminable() -> Iterator[None]:
    """SIGTERM ends the program as an error does, so that scratch files go. What the caller set for it stays."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return

    def end(*_: Any) -> None:
        sys.exit(ExitCode.TERMINATED)

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def in_shell_words(text: str, command: click.Command | None = None) -> str:
    """A sentence of the library with its keyword arguments as options of the command that runs, where it has them.

    An option stands for the keyword argument of its own name, or of the name its parameter has. Commands of one group, such
    as ``sensor``, advise each other's.
    """
    context = click.get_current_context(silent=True)
    command = command or (context.command if context else None)
    group = context.parent.command if context and context.parent and context.parent.parent else None
    siblings = list(group.commands.values()) if isinstance(group, click.Group) else []
    known: dict[str, click.Option] = {}
    for option in (option for each in (*siblings, command) if each for option in each.params):
        if isinstance(option, click.Option):
            known |= {option.opts[0].removeprefix("--").replace("-", "_"): option, str(option.name): option}

    def said(found: re.Match[str]) -> str:
        name, word, truth = found["name"], found["word"], found["truth"]
        if truth == "False":
            name = f"no_{name}"
        option = known.get(name)
        if option is None:
            return found[0]
        if option.is_flag and word is not None:
            return option.opts[0] if option.flag_value == word else f"no {option.opts[0]}"
        return option.opts[0] if word is None else f"{option.opts[0]} {shlex.quote(word)}"

    return _KEYWORD.sub(said, text)
