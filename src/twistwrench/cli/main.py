"""Command line: commands loaded on call, their help, output streams, errors and exit codes.

Commands read options, call one function of the library, and convert errors to one line and an exit code of
:mod:`twistwrench.core.verdict`.
"""

from __future__ import annotations

import errno
import logging
import os
import re
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import click

from ..core.errors import ModelWarning, TwistWrenchError
from ..core.text import visible, words_of_the_shell
from ..core.verdict import ExitCode, end_at_once
from .hints import Seconds, missing_parameter, unknown_command, unknown_option

if TYPE_CHECKING:
    pass


class RobotOption(click.Option):
    """Option for reading the robot, shared by all commands."""


QUESTION, READING, ROBOT_GROUP, WRITING, RARE = "Question", "Reading the log", "Robot", "Writing", "Rare"
_HEADINGS = {
    READING: "columns degrees lock-missing",
    ROBOT_GROUP: "lock tip actuators floating-base",
    WRITING: "csv json report plot out out-actuators save overwrite all",
    RARE: (
        "workers scheduler srdf topic episode gain rate keep model xacro seed restarts criterion stribeck-speed keep-close "
        "masses-included regeneration rtol every style torque-side prefix full-paths smooth plan chain include-path mimic "
        "inertia mcap rerun npz joint kind weights shift cutoff harmonics method "
        "fixed-base step jerk contact touch force control casters contact-normal bolts grip cup in-contact thresholds"
    ),
}
"""Headings of the help by option; options that are not named are of the question."""
_HEADING_OF = {f"--{name}": heading for heading, names in _HEADINGS.items() for name in names.split()}
_HEADING_IN = {
    ("calibrate", "--plan"): QUESTION,
    ("calibrate", "--towards"): RARE,
    ("identify", "--command-hold"): RARE,
    **{("view", f"--{name}"): RARE for name in ("feet", "wheels", "contact-friction", "mounting")},
}
"""Headings of options in a command that has them elsewhere than the other commands."""
_FORM, _LINE = 26, 80
"""Widths of the form of an option, and of a line of the short help."""


class GroupedHelp(click.Command):
    """Command whose options stand under headings, each in one line; --help-all adds the rare ones and the full texts."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options of each heading."""
        groups: dict[str, list[tuple[str, str]]] = {heading: [] for heading in (QUESTION, *_HEADINGS)}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if isinstance(param, click.Option) and record is not None and not {"--help", "--help-all"} & {*param.opts}:
                heading = _HEADING_OF.get(param.opts[0], QUESTION)
                groups[_HEADING_IN.get((self.name or "", param.opts[0]), heading)].append(record)
        with_full_texts = bool(ctx.meta.get(_ALL))
        for heading, records in groups.items():
            if records and (with_full_texts or heading != RARE):
                with formatter.section(heading):
                    if with_full_texts:
                        formatter.write_dl(records)
                        continue
                    for form, text in records:
                        formatter.write(f"{'':{formatter.current_indent}}{_in_a_line(form, text)}\n")
        if groups[RARE] and not with_full_texts:
            formatter.write_paragraph()
            formatter.write_text(f"{len(groups[RARE])} more options, and full texts: --help-all.")

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Parameters, and --help-all."""
        return [*super().get_params(ctx), _HELP_ALL]


def _in_a_line(form: str, text: str) -> str:
    """Form of an option and the first clause of its help, cut at a word."""
    flag, _, placeholder = form.partition(" ")
    if len(form) > _FORM:
        form = f"{flag} {re.split('[,|:]', placeholder.replace('[', ''))[0]}…"
    clause = re.split(r"[;:]\s|\.\s|  ?\[default", text)[0].rstrip(".")
    room = _LINE - _FORM - 4
    if len(clause) > room:
        clause = f"{clause[: room - 1].rpartition(' ')[0].rstrip(',')}…"
    return f"{form:{_FORM}}  {clause}"


_ALL = "twistwrench.help_all"
"""Context entry: the help describes all options."""


def _show_all(context: click.Context, _parameter: click.Parameter, given: bool) -> None:
    if given:
        context.meta[_ALL] = True
        click.echo(context.get_help())
        context.exit()


_HELP_ALL = click.Option(
    ["--help-all"], is_flag=True, expose_value=False, is_eager=True, callback=_show_all,
    help="Show this message with all options and full texts, and exit.",
)  # fmt: skip


# ── Standard output and error, independent of the system's code page


class VisibleStream:
    """Standard output or error with escaped control characters, so that text from files cannot control the terminal."""

    def __init__(self, stream: Any) -> None:
        # Rich bypasses this stream: its control characters are only colours, and its text is already escaped.
        self.rich_proxied_file = stream

    def write(self, text: str) -> int:
        """Write text with escaped control characters."""
        self.rich_proxied_file.write(visible(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


class LastingStream:
    """Standard output that outlasts its reader: a command writes its files although ``head`` has ended."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream
        self.is_unread = False

    def write(self, text: str) -> int:
        """Write text; without a reader it is dropped."""
        with self._while_read():
            self.stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Write the buffer."""
        with self._while_read():
            self.stream.flush()

    @contextmanager
    def _while_read(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            self.is_unread = True
            drop_output(self.stream)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def use_utf8() -> None:
    """Write files and pipes in UTF-8, as Python does from 3.15 on; a terminal keeps its encoding.

    Characters missing in the encoding of a terminal or of ``PYTHONIOENCODING`` become question marks.
    """
    streams: tuple[Any, ...] = (sys.stdout, sys.stderr)
    for stream in streams:
        if stream not in (sys.__stdout__, sys.__stderr__):  # replaced by the caller
            continue
        change = getattr(stream, "reconfigure", None)
        if stream is None or change is None or str(stream.encoding).lower() in ("utf-8", "utf8"):
            continue
        if os.environ.get("PYTHONIOENCODING") or stream.isatty():
            change(errors="replace")
        else:
            change(encoding="utf-8")


# ── Errors: one line and an exit code each, in terms of options

_REFUSED = tuple(
    getattr(errno, name)
    for name in ["ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS", "ENAMETOOLONG", "ENOMEM", "EMFILE", "ENFILE"]
)
"""Error numbers of the operating system that are not program errors, such as full disks and long names."""

_MAX_SHOWN_PATH = 80
_HEARD: list[bool] = []
"""Nonempty after Ctrl-C."""

ARGUMENTS, NOTES = "twistwrench.arguments", "twistwrench.notes"
"""Context entries: words of the command line, and sentences of :func:`note`."""

TRACEBACK = "TWISTWRENCH_TRACEBACK"
"""Environment variable that enables the traceback of program errors."""


class Commands(click.Group):
    """Commands with one-line errors and the exit codes of :class:`~twistwrench.core.verdict.ExitCode`."""

    command_class = GroupedHelp

    def main(self, *args: Any, **options: Any) -> Any:
        """Run as a program that cleans up on SIGTERM."""
        use_utf8()
        _HEARD.clear()
        output = None if sys.stdout is None else LastingStream(sys.stdout)
        visible_output: Any = None if output is None else VisibleStream(output)
        visible_errors: Any = None if sys.stderr is None else VisibleStream(sys.stderr)
        with (
            _handling(signal.SIGTERM, _end, (signal.SIG_DFL,)),
            _handling(signal.SIGINT, _interrupt, (signal.default_int_handler, end_at_once)),
            redirect_stdout(visible_output),
            redirect_stderr(visible_errors),
        ):
            try:
                return super().main(*args, **options)
            except SystemExit:
                if output is not None and output.is_unread:
                    raise SystemExit(ExitCode.PIPE_CLOSED) from None
                raise

    def make_context(self, info_name: str | None, args: list[str], **options: Any) -> click.Context:  # type: ignore[override]
        """Parse arguments; usage errors are printed in one line."""
        typed = list(args)
        with _own_endings():
            context = super().make_context(info_name, args, **options)
            context.meta[ARGUMENTS] = typed
            return context

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; errors are printed in one line."""
        with _own_endings():
            answer = super().invoke(ctx)
            sys.stdout.flush()  # a full disk can still be reported here
            return answer


class _UsageLine(click.ClickException):
    exit_code = ExitCode.BAD_INPUT

    def show(self, file: Any = None) -> None:
        click.echo(f"error: {self.message}", file=file, err=True)


@contextmanager
def _own_endings() -> Iterator[None]:
    """Print usage errors in one line; interrupts, closed pipes and program errors have separate exit codes."""
    try:
        yield
    except click.exceptions.NoArgsIsHelpError:
        raise
    except click.UsageError as error:
        where = f" See {error.ctx.command_path} --help." if error.ctx else ""
        raise _UsageLine(" ".join(_usage_sentence(error).split()) + where) from None
    except (click.ClickException, click.exceptions.Exit, click.Abort):
        raise
    except KeyboardInterrupt:
        _say("interrupted")
        sys.exit(ExitCode.INTERRUPTED)
    except BrokenPipeError:
        drop_output()
        sys.exit(ExitCode.PIPE_CLOSED)
    except Exception as fault:
        if _HEARD:  # a library converted the interrupt to its own error
            _say("interrupted")
            sys.exit(ExitCode.INTERRUPTED)
        if isinstance(fault, MemoryError) or (isinstance(fault, OSError) and fault.errno in _REFUSED):
            place = getattr(fault, "filename", None)
            what = getattr(fault, "strerror", None) or "more memory is needed than there is"
            if place is not None:
                what += f": {str(place)[:_MAX_SHOWN_PATH]}"
            _say(f"error: {what}.")
            if isinstance(fault, OSError):
                drop_output()
            sys.exit(ExitCode.BAD_INPUT)
        traced = os.environ.get(TRACEBACK, "").lower() not in ("", "0", "off", "false")
        if traced:
            _say("".join(traceback.format_exception(fault)).rstrip())
        text, what = " ".join(str(fault).split()), type(fault).__name__
        if text:
            what += f": {text[:300]}"
        hint = "" if traced else f"; {TRACEBACK}=1 shows where it arose"
        _say(
            f"error: a fault of twistwrench itself, not of your input: {what}. Please report it with the command{hint}."
        )
        sys.exit(ExitCode.FAULT)


def _usage_sentence(error: click.UsageError) -> str:
    """Message of a usage error, with what to type instead."""
    if isinstance(error, click.NoSuchOption) and error.ctx is not None:
        return unknown_option(error, error.ctx.meta.get(ARGUMENTS, []))
    if isinstance(error, click.MissingParameter):
        return missing_parameter(error)
    return error.format_message()


def _say(text: str) -> None:
    """Write on standard error, if it is open."""
    with suppress(OSError, ValueError):
        click.echo(text, err=True)


def drop_output(stream: Any = None) -> None:
    """Discard the buffer of standard output, so that it does not fail again at exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), (stream or sys.stdout).fileno())


def _interrupt(*_: Any) -> None:
    """Raise KeyboardInterrupt and record it in case a library catches it."""
    _HEARD.append(True)
    raise KeyboardInterrupt


def note(text: str) -> None:
    """Write a note on standard error, and keep it for the command's report."""
    click.echo(f"note: {text}", err=True)
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta.setdefault(NOTES, []).append(text)


@contextmanager
def noted_if_failed(hints: Iterable[str]) -> Iterator[None]:
    """Write hints on the input as notes if the work on it fails, since no report follows."""
    try:
        yield
    except TwistWrenchError:
        for hint in hints:
            note(hint)
        raise


def typed_words_and_notes() -> tuple[list[str], list[str]]:
    """Words of the command line after the program's name, and the sentences of :func:`note`."""
    meta = click.get_current_context().meta
    return meta.get(ARGUMENTS, []), meta.get(NOTES, [])


def _end(*_: Any) -> None:
    """Exit by an exception, so that temporary files are removed."""
    sys.exit(ExitCode.TERMINATED)


@contextmanager
def _handling(number: signal.Signals, handler: Callable[..., None], defaults: Sequence[Any]) -> Iterator[None]:
    """Handle a signal within the context, unless the caller installed a handler not in ``defaults``."""
    before = signal.getsignal(number)
    if threading.current_thread() is not threading.main_thread() or before not in defaults:
        yield
        return
    signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


# ── Errors and warnings of the library


@contextmanager
def plain_errors() -> Iterator[None]:
    """Convert library errors to one line on stderr and an exit, and library warnings to one line each."""
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # our errors already report broken meshes
    with warnings.catch_warnings():
        warnings.simplefilter("always", ModelWarning)
        warnings.showwarning = lambda message, *_args, **_rest: note(str(message))
        try:
            with words_of_the_shell():
                yield
        except TwistWrenchError as error:
            for hint in getattr(error, "__notes__", ()):
                note(hint)
            click.echo(f"error: {' '.join(error.in_shell().split())}", err=True)
            sys.exit(ExitCode.BAD_INPUT)


# ── Declarations of commands

Decorator: TypeAlias = Callable[[Any], Any]


def check_matplotlib() -> None:
    """Raise if a picture cannot be drawn, before a long run."""
    from ..viz.style import require_matplotlib

    require_matplotlib("Drawing the report")


def examples_text(*lines: str) -> str:
    """Examples at the end of a command's help: lines without the word `twistwrench`."""
    text = "\n".join(f"  twistwrench {line}" for line in lines)
    return f"\b\nExamples:\n{text}"


def option(form: str, text: str, *names: str, choices: Sequence[str] = (), **settings: Any) -> Decorator:
    """Option from its form, ``--csv OUT.csv``, and its help; a flag without value, choices, type and default.

    The parameter has the option's name unless a name is given.
    """
    flag, _, metavar = form.partition(" ")
    if choices:
        settings["type"] = click.Choice(choices)
    if metavar:
        settings["metavar"] = metavar
        if metavar == "SECONDS" and (settings.get("type") is float or isinstance(settings.get("default"), float)):
            settings["type"] = Seconds()
    elif not {"default", "type"} & settings.keys():
        settings["is_flag"] = True
    return click.option(flag, *names, help=text, **{"show_default": "default" in settings, **settings})


def option_group(*options: Decorator) -> Decorator:
    """One decorator of several options, in the order of the help."""

    def decorate(function: Any) -> Any:
        for option in reversed(options):
            function = option(function)
        return function

    return decorate


def plain_command(name: str, *options: Decorator, examples: Sequence[str]) -> Decorator:
    """Command from a function of its options that returns an exit code; library errors are printed in one line."""

    def decorate(function: Callable[..., int | None]) -> click.Command:
        @wraps(function)
        def run(**given: Any) -> None:
            with plain_errors():
                code = function(**given)
                if code:
                    sys.exit(code)

        declare = click.command(name, cls=GroupedHelp, epilog=examples_text(*examples))
        made: click.Command = declare(option_group(*options)(run))
        return made

    return decorate


# ── The commands


class _Entry(NamedTuple):
    file: str
    summary: str


_GROUPS = {
    "Check": {
        "torques": _Entry("torques", "Torques of a motion, against limits, with their causes."),
        "payload": _Entry("poses", "Largest payload at a pose, and the joint that limits it."),
        "size": _Entry("size", "Size motors and gears for a cyclic motion."),
        "doctor": _Entry("doctor", "Check and repair a robot file."),
        "info": _Entry("info", "Joints, limits, masses, inertias and frames of a robot."),
        "robots": _Entry("info", "List the robots known by name."),
    },
    "Measure": {
        "log": _Entry("log", "Check the columns of a log: rates, gaps, noise."),
        "excite": _Entry("identify", "Plan the motion to record for identify."),
        "identify": _Entry("identify", "Estimate masses, inertias and friction from logs."),
        "calibrate": _Entry("calibration.calibrate", "Fit the geometry of an arm to measured positions."),
        "sensor": _Entry("sensor", "Calibrate a six-axis sensor, and compensate the tool."),
    },
    "Move and show": {
        "move": _Entry("poses", "Plan a motion, also the fastest; writes a file."),
        "simulate": _Entry("simulate", "Simulate a motion under torques, gravity and contact."),
        "view": _Entry("view", "Show the robot in the browser, or film its motion."),
    },
    "Equations and files": {
        "derive": _Entry("derive", "Derive the equations of motion in symbols."),
        "convert": _Entry("export", "Write the robot as URDF, MJCF or SDF."),
        "join": _Entry("export", "Join robots to one: rail, arm, gripper, second arm."),
        "export": _Entry("export", "Write the dynamics as C99 or Structured Text."),
        "verify": _Entry("doctor", "Check the dynamics against independent formulas."),
        "mcp": _Entry("assistant.mcp", "Serve coding assistants (Model Context Protocol)."),
        "help": _Entry("main", "Explain columns, limits, verdicts or the robot options."),
    },
}
"""Commands by group and name: module with the function NAME_command, and line in the list of commands."""
_WIDTH = 8
"""Width of the name column in each group."""
_SYNONYMS = {"check": "torques"}
"""Commands that are not listed, by the listed command that they are."""
_COMMANDS = {name: entry for group in _GROUPS.values() for name, entry in group.items()}


class LazyCommands(Commands):
    """Commands of :data:`_COMMANDS`, loaded on demand."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; raises UsageError with what to type instead."""
        if not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            raise click.UsageError(unknown_command(args[0], _COMMANDS), ctx)
        return super().resolve_command(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  as click calls it
        """Names of all commands."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load a command; None if the name is unknown."""
        cmd_name = _SYNONYMS.get(cmd_name, cmd_name)
        if cmd_name not in _COMMANDS:
            return super().get_command(ctx, cmd_name)
        module = import_module(f".{_COMMANDS[cmd_name].file}", __package__)
        found: click.Command = getattr(module, f"{cmd_name}_command")
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002  as above
        """Write the list of commands without loading them."""
        for title, group in _GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(_WIDTH), entry.summary) for name, entry in group.items()])


@click.group(
    cls=LazyCommands,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=examples_text("torques ur5 demo --payload 10", "doctor ur5", "torques --help"),
)
@click.version_option(package_name="twistwrench")
def main() -> None:
    """Torques, payloads, motions and model parameters of robots.

    ROBOT is a robot file (URDF, MJCF, SDF, USD), or a name that `twistwrench robots` lists, such as ur5.
    """


_GUIDES = {
    "assistant": "assistant",
    "columns": "logs",
    "limits": "limits",
    "unsure": "unsure",
    "verdicts": "verdicts",
    "skill": "skill/SKILL",
}
"""Topics of `twistwrench help` and their documentation pages."""


@click.command("help", epilog=examples_text("help columns", "help verdicts"))
@click.argument("topic", metavar="TOPIC", required=False, type=click.Choice([*_GUIDES, "robot"]))
def help_command(topic: str | None) -> None:
    """Print the page of the documentation on a topic.

    columns: names and units of the columns of a log. limits: files of torque, velocity and position limits. unsure: reasons
    of the verdicts UNSURE and LOOK AGAIN, and their remedies. verdicts: first words of reports, and exit codes. robot:
    options that all commands with a robot have. assistant: ten tasks in Python, and pitfalls. skill: the file SKILL.md of
    a coding assistant.
    """
    if topic is None:
        click.echo(help_command.get_help(click.get_current_context()))
        return
    if topic == "robot":
        torques = main.get_command(click.Context(main), "torques")
        assert torques is not None
        formatter = click.HelpFormatter(width=80)
        with formatter.section("Robot options"):
            context = click.Context(torques)
            robot_options = [param for param in torques.params if isinstance(param, RobotOption)]
            records = [option.get_help_record(context) for option in robot_options]
            formatter.write_dl([record for record in records if record is not None])
        click.echo(formatter.getvalue(), nl=False)
        return
    name = f"{_GUIDES[topic]}.md"
    package = Path(__file__).parent.parent
    text = next(
        path.read_text("utf-8")
        for path in (package / "guides" / name, package.parent.parent / "docs" / name)  # installed, source tree
        if path.exists()
    )
    if topic == "skill":  # a file to save, as it is
        click.echo(text, nl=False)
        return
    text = re.sub(r"\A---\n.*?\n---\n+", "", text, flags=re.DOTALL)  # front matter
    text = re.sub(r"^(```\w+) .*$", r"\1", text, flags=re.MULTILINE)
    click.echo(re.sub(r"\[([^\]]+)\]\((?!https?:)[^)]*\)", r"\1", text))
