"""The shell's framework: help, standard streams, errors with their exit codes, and declarations of commands."""

from __future__ import annotations

import errno
import logging
import os
import re
import shlex
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import wraps
from types import SimpleNamespace
from typing import Any, TypeAlias

import click

from ..core.arguments import visible
from ..core.verdict import ExitCode, end_at_once
from ..errors import ModelWarning, TwistWrenchError


class RobotOption(click.Option):
    """Option for reading the robot, shared by all commands."""


class OwnOptionsFirst(click.Command):
    """A command whose help lists its own options before those of the robot."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write them in two sections."""
        records = [(p, p.get_help_record(ctx)) for p in self.get_params(ctx) if isinstance(p, click.Option)]
        own = [record for param, record in records if record and not isinstance(param, RobotOption)]
        shared = [record for param, record in records if record and isinstance(param, RobotOption)]
        for title, rows in (("Options", own), ("How the robot is read", shared)):
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


# ── Standard output and error, whatever the system's code page


class VisibleStream:
    """Standard output or error that escapes control characters, so that text of files cannot steer the terminal."""

    def __init__(self, stream: Any) -> None:
        self.rich_proxied_file = (
            stream  # Rich writes past this one: its colours are ours, and its text is escaped before
        )

    def write(self, text: str) -> int:
        """Write with escapes."""
        self.rich_proxied_file.write(visible(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


@contextmanager
def visible_streams() -> Iterator[None]:
    """Standard output and error as :class:`VisibleStream` meanwhile."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (VisibleStream(stream) if stream is not None else None for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def use_utf8() -> None:
    """Write files and pipes in UTF-8, as Python does from 3.15 on; a terminal keeps its encoding.

    A sign that a terminal, or the encoding named by ``PYTHONIOENCODING``, does not have becomes a question mark.
    """
    streams: tuple[Any, ...] = (sys.stdout, sys.stderr)
    for stream in streams:
        if stream not in (sys.__stdout__, sys.__stderr__):  # a caller's own
            continue
        change = getattr(stream, "reconfigure", None)
        if change is None or str(stream.encoding).lower() in ("utf-8", "utf8"):
            continue
        if os.environ.get("PYTHONIOENCODING") or stream.isatty():
            change(errors="replace")
        else:
            change(encoding="utf-8")


# ── Endings: one line and an exit code for each error, in words of options

_KEYWORD = re.compile(r"\b(?P<name>[a-z]\w*)=(?:'(?P<word>[^']*)'|(?P<truth>True|False)|…|(?=[\s.,;]))")
"""A keyword argument in a sentence of the library: ``tip=…``, ``inertia='repair'``, ``overwrite=True``."""

_REFUSED = tuple(
    getattr(errno, name)
    for name in ["ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS", "ENAMETOOLONG", "ENOMEM", "EMFILE", "ENFILE"]
)
"""Error numbers of the system that are not faults of the program: full disks, names too long, and the like."""

_LONGEST = 80
_HEARD: list[bool] = []
"""Not empty after Ctrl-C."""

TRACEBACK = "TWISTWRENCH_TRACEBACK"
"""The environment variable that shows where a fault of the program arose."""


class Commands(click.Group):
    """Commands with errors of one line each and the exit codes of :class:`~twistwrench.core.verdict.ExitCode`."""

    command_class = OwnOptionsFirst

    def main(self, *args: Any, **options: Any) -> Any:
        """Run as a program that cleans up behind itself when it is told to end."""
        use_utf8()
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
    """Write on standard error, if it is open."""
    with suppress(OSError, ValueError):
        click.echo(text, err=True)


def _drop_output() -> None:
    """Discard the buffer of standard output, so that it does not fail again at exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on Ctrl-C and remember it, in case a library swallows it. A handler of the caller stays."""
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
    """End the program on SIGTERM as an error does, so that scratch files are removed. A handler of the caller stays."""
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


def with_option_names(text: str, command: click.Command | None = None) -> str:
    """Replace keyword arguments in a sentence of the library by options of the running command.

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


# ── Errors and warnings of the library


@contextmanager
def plain_errors() -> Iterator[None]:
    """Errors of the library end the program with one line on stderr; its warnings are a line each."""
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # what it logs of broken meshes, our errors say
    with warnings.catch_warnings():
        warnings.simplefilter("always", ModelWarning)
        warnings.showwarning = lambda message, *_args, **_rest: click.echo(
            f"note: {with_option_names(str(message))}", err=True
        )
        try:
            yield
        except TwistWrenchError as error:
            click.echo(f"error: {' '.join(with_option_names(str(error)).split())}", err=True)
            sys.exit(ExitCode.BAD_INPUT)


# ── Declarations of commands

Decorator: TypeAlias = Callable[[Any], Any]


class Given(SimpleNamespace):
    """Options of a command by the names of their parameters."""


def examples(*lines: str) -> str:
    """End of a command's help: lines without the word `twistwrench`."""
    text = "\n".join(f"  twistwrench {line}" for line in lines)
    return f"\b\nExamples:\n{text}"


def option_group(*options: Decorator) -> Decorator:
    """Options as one decorator; a command's help lists them from the last to the first."""

    def decorate(function: Any) -> Any:
        for option in options:
            function = option(function)
        return function

    return decorate


def command(name: str, *options: Decorator, examples_: Sequence[str], **settings: Any) -> Decorator:
    """A command from a function of :class:`Given` that returns an exit code; errors of the library are a line each."""

    def decorate(function: Callable[[Given], int | None]) -> click.Command:
        @wraps(function)
        def run(**given: Any) -> None:
            with plain_errors():
                if code := function(Given(**given)):
                    sys.exit(code)

        declare = click.command(name, cls=OwnOptionsFirst, epilog=examples(*examples_), **settings)
        return declare(option_group(*options)(run))

    return decorate
