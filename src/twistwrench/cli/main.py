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
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, TypeAlias

import click

from ..core.errors import ModelWarning, TwistWrenchError
from ..core.text import visible, words_of_the_shell
from ..core.verdict import ExitCode, end_at_once
from .hints import Seconds, missing_parameter, unknown_command, unknown_option

if TYPE_CHECKING:
    pass


class RobotOption(click.Option):
    """Option for reading the robot, shared by all commands."""


# Headings of the help
QUESTION = "Question"
READING = "Reading the log"
ROBOT_GROUP = "Robot"
WRITING = "Writing"
RARE = "Rare"
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
"""Options under each heading of the help, without ``--``. Options that are not named stand under QUESTION."""
_HEADING_BY_OPTION = {f"--{name}": heading for heading, names in _HEADINGS.items() for name in names.split()}
_HEADING_BY_COMMAND_AND_OPTION = {
    ("calibrate", "--plan"): QUESTION,
    ("calibrate", "--towards"): RARE,
    ("identify", "--command-hold"): RARE,
    **{("view", f"--{name}"): RARE for name in ("feet", "wheels", "contact-friction", "mounting")},
}
"""Headings of options that stand under another heading in one command than in the others."""
_FORM_WIDTH = 26
"""Width of the column of forms in the short help, such as ``--csv OUT.csv``, in characters."""
_LINE_WIDTH = 80
"""Width of a line of the short help, in characters."""
_MAX_CLAUSE_LENGTH = _LINE_WIDTH - _FORM_WIDTH - 4
"""Longest text of an option in the short help: two blanks stand before the form, and two after it."""


class GroupedHelp(click.Command):
    """Command whose help lists the options under headings, one line each.

    ``--help-all`` adds the rare options and the full texts.
    """

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options of each heading."""
        records_by_heading: dict[str, list[tuple[str, str]]] = {heading: [] for heading in (QUESTION, *_HEADINGS)}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)  # form and text; None for a hidden option
            if not isinstance(parameter, click.Option) or record is None:
                continue
            if {"--help", "--help-all"} & {*parameter.opts}:
                continue
            flag = parameter.opts[0]
            usual_heading = _HEADING_BY_OPTION.get(flag, QUESTION)
            heading = _HEADING_BY_COMMAND_AND_OPTION.get((self.name or "", flag), usual_heading)
            records_by_heading[heading].append(record)
        with_full_texts = bool(ctx.meta.get(_HELP_ALL_ENTRY))
        for heading, records in records_by_heading.items():
            is_shown = with_full_texts or heading != RARE
            if not records or not is_shown:
                continue
            with formatter.section(heading):
                if with_full_texts:
                    formatter.write_dl(records)
                    continue
                indent = " " * formatter.current_indent
                for form, text in records:
                    formatter.write(f"{indent}{_short_help(form, text)}\n")
        rare_count = len(records_by_heading[RARE])
        if rare_count and not with_full_texts:
            formatter.write_paragraph()
            formatter.write_text(f"{rare_count} more options, and full texts: --help-all.")

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Parameters of the command, and --help-all."""
        return [*super().get_params(ctx), _HELP_ALL_OPTION]


def _short_help(form: str, text: str) -> str:
    """Form of an option and the first clause of its help, cut at a word."""
    if len(form) > _FORM_WIDTH:
        flag, _, placeholder = form.partition(" ")
        first_choice, *_ = re.split("[,|:]", placeholder.replace("[", ""))
        form = f"{flag} {first_choice}…"
    first_part, *_ = re.split(r"[;:]\s|\.\s|  ?\[default", text)
    clause = first_part.rstrip(".")
    if len(clause) > _MAX_CLAUSE_LENGTH:
        whole_words, _, _ = clause[: _MAX_CLAUSE_LENGTH - 1].rpartition(" ")  # one character is left for the ellipsis
        clause = f"{whole_words.rstrip(',')}…"
    return f"{form:{_FORM_WIDTH}}  {clause}"


_HELP_ALL_ENTRY = "twistwrench.help_all"
"""Context entry: the help describes all options."""


def _print_full_help(context: click.Context, _parameter: click.Parameter, is_given: bool) -> None:
    """Callback of --help-all: print the help of all options, and exit."""
    if is_given:
        context.meta[_HELP_ALL_ENTRY] = True
        click.echo(context.get_help())
        context.exit()


_HELP_ALL_OPTION = click.Option(
    ["--help-all"], is_flag=True, expose_value=False, is_eager=True, callback=_print_full_help,
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
    """Standard output that fails silently if its reader, such as ``head``, has ended: the command still writes its files."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream
        self.is_unread = False

    def write(self, text: str) -> int:
        """Write text; discarded if the reader has ended."""
        with self._while_read():
            self.stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Write the buffer."""
        with self._while_read():
            self.stream.flush()

    @contextmanager
    def _while_read(self) -> Iterator[None]:
        """Record that the reader has ended, instead of raising an error."""
        try:
            yield
        except BrokenPipeError:
            self.is_unread = True
            drop_output(self.stream)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def use_utf8() -> None:
    """Write to files and pipes in UTF-8, as Python does from 3.15 on; a terminal keeps its encoding.

    Characters missing in the encoding of a terminal or of ``PYTHONIOENCODING`` become question marks.
    """
    streams: tuple[Any, ...] = (sys.stdout, sys.stderr)
    for stream in streams:
        if stream not in (sys.__stdout__, sys.__stderr__):  # replaced by the caller
            continue
        reconfigure = getattr(stream, "reconfigure", None)
        if stream is None or reconfigure is None:
            continue
        if str(stream.encoding).lower() in ("utf-8", "utf8"):
            continue
        if os.environ.get("PYTHONIOENCODING") or stream.isatty():
            reconfigure(errors="replace")
        else:
            reconfigure(encoding="utf-8")


# ── Errors: one line and an exit code each, in terms of options

_EXTERNAL_ERRNOS = tuple(
    getattr(errno, name)
    for name in ["ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS", "ENAMETOOLONG", "ENOMEM", "EMFILE", "ENFILE"]
)
"""Error numbers of the operating system that are not faults of the program, such as full disks and long names."""

_MAX_PATH_LENGTH = 80
"""Largest number of characters of a path in an error message."""
_MAX_FAULT_LENGTH = 300
"""Largest number of characters of the message of a program error."""
_INTERRUPTS: list[bool] = []
"""One entry for each Ctrl-C of this run."""

ARGUMENTS = "twistwrench.arguments"
"""Name of the context entry with the words of the command line."""
NOTES = "twistwrench.notes"
"""Name of the context entry with the sentences of :func:`note`."""

TRACEBACK = "TWISTWRENCH_TRACEBACK"
"""Environment variable that enables the traceback of program errors."""


class Commands(click.Group):
    """Commands with one-line errors and the exit codes of :class:`~twistwrench.core.verdict.ExitCode`."""

    command_class = GroupedHelp

    def main(self, *args: Any, **options: Any) -> Any:
        """Run as a program that cleans up on SIGTERM."""
        use_utf8()
        _INTERRUPTS.clear()
        output: LastingStream | None = None
        visible_output: Any = None
        visible_errors: Any = None
        if sys.stdout is not None:  # None without a console
            output = LastingStream(sys.stdout)
            visible_output = VisibleStream(output)
        if sys.stderr is not None:
            visible_errors = VisibleStream(sys.stderr)
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
        typed_words = list(args)  # a copy: parsing empties the list
        with _exit_codes_of_errors():
            context = super().make_context(info_name, args, **options)
            context.meta[ARGUMENTS] = typed_words
            return context

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; errors are printed in one line."""
        with _exit_codes_of_errors():
            answer = super().invoke(ctx)
            sys.stdout.flush()  # a full disk can still be reported here
            return answer


class _OneLineUsageError(click.ClickException):
    """Usage error that is printed in one line, without click's usage text."""

    exit_code = ExitCode.BAD_INPUT

    def show(self, file: Any = None) -> None:
        click.echo(f"error: {self.message}", file=file, err=True)


@contextmanager
def _exit_codes_of_errors() -> Iterator[None]:
    """Print an error in one line, and exit with its code: usage error, interrupt, closed pipe or program error."""
    try:
        yield
    except click.exceptions.NoArgsIsHelpError:
        raise
    except click.UsageError as error:
        help_hint = f" See {error.ctx.command_path} --help." if error.ctx else ""
        sentence = " ".join(_usage_sentence(error).split())  # in one line
        raise _OneLineUsageError(sentence + help_hint) from None
    except (click.ClickException, click.exceptions.Exit, click.Abort):
        raise
    except KeyboardInterrupt:
        _print_error("interrupted")
        sys.exit(ExitCode.INTERRUPTED)
    except BrokenPipeError:
        drop_output()
        sys.exit(ExitCode.PIPE_CLOSED)
    except Exception as fault:
        if _INTERRUPTS:  # a library converted the interrupt to its own error
            _print_error("interrupted")
            sys.exit(ExitCode.INTERRUPTED)
        is_external = isinstance(fault, OSError) and fault.errno in _EXTERNAL_ERRNOS
        if is_external or isinstance(fault, MemoryError):
            _exit_for_external_error(fault)
        _exit_for_program_error(fault)


def _exit_for_external_error(error: Exception) -> NoReturn:
    """Print an error of the operating system or of memory, and exit."""
    path = getattr(error, "filename", None)
    cause = getattr(error, "strerror", None) or "more memory is needed than there is"
    if path is not None:
        cause += f": {str(path)[:_MAX_PATH_LENGTH]}"
    _print_error(f"error: {cause}.")
    if isinstance(error, OSError):
        drop_output()
    sys.exit(ExitCode.BAD_INPUT)


def _exit_for_program_error(fault: Exception) -> NoReturn:
    """Print an error of this program, with its traceback if :data:`TRACEBACK` is set, and exit."""
    with_traceback = os.environ.get(TRACEBACK, "").lower() not in ("", "0", "off", "false")
    if with_traceback:
        _print_error("".join(traceback.format_exception(fault)).rstrip())
    description = type(fault).__name__
    text = " ".join(str(fault).split())  # in one line
    if text:
        description += f": {text[:_MAX_FAULT_LENGTH]}"
    hint = "" if with_traceback else f"; {TRACEBACK}=1 shows where it arose"
    _print_error(
        f"error: a fault of twistwrench itself, not of your input: {description}. Please report it with the command{hint}."
    )
    sys.exit(ExitCode.FAULT)


def _usage_sentence(error: click.UsageError) -> str:
    """Message of a usage error, with what to type instead."""
    if isinstance(error, click.NoSuchOption) and error.ctx is not None:
        return unknown_option(error, error.ctx.meta.get(ARGUMENTS, []))
    if isinstance(error, click.MissingParameter):
        return missing_parameter(error)
    return error.format_message()


def _print_error(text: str) -> None:
    """Write a line on standard error, if it is open."""
    with suppress(OSError, ValueError):
        click.echo(text, err=True)


def drop_output(stream: Any = None) -> None:
    """Discard the buffer of standard output, or of ``stream``, so that it does not fail again at exit."""
    if stream is None:
        stream = sys.stdout
    with suppress(OSError, ValueError):
        discarding_file = os.open(os.devnull, os.O_WRONLY)
        os.dup2(discarding_file, stream.fileno())


def _interrupt(*_: Any) -> None:
    """Raise KeyboardInterrupt, and record it in case a library turns it into another error."""
    _INTERRUPTS.append(True)
    raise KeyboardInterrupt


def note(text: str) -> None:
    """Write a note on standard error, and keep it for the command's report."""
    click.echo(f"note: {text}", err=True)
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta.setdefault(NOTES, []).append(text)


@contextmanager
def noted_if_failed(hints: Iterable[str]) -> Iterator[None]:
    """Print hints on the input as notes if the work in the context fails, since no report follows."""
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
def _handling(
    signal_number: signal.Signals, handler: Callable[..., None], default_handlers: Sequence[Any]
) -> Iterator[None]:
    """Handle a signal within the context, unless the caller has installed a handler that is not a default one."""
    previous_handler = signal.getsignal(signal_number)
    in_main_thread = threading.current_thread() is threading.main_thread()  # only there Python sets handlers
    if not in_main_thread or previous_handler not in default_handlers:
        yield
        return
    signal.signal(signal_number, handler)
    try:
        yield
    finally:
        signal.signal(signal_number, previous_handler)


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
            message = " ".join(error.in_shell().split())  # in one line
            click.echo(f"error: {message}", err=True)
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
    """Option from its form, such as ``--csv OUT.csv``, and its help.

    Without placeholder, choices, type and default it is a flag. The parameter has the option's name unless a name is given.
    """
    flag, _, metavar = form.partition(" ")
    if choices:
        settings["type"] = click.Choice(choices)
    if metavar:
        settings["metavar"] = metavar
        takes_float = settings.get("type") is float or isinstance(settings.get("default"), float)
        if metavar == "SECONDS" and takes_float:
            settings["type"] = Seconds()
    elif not {"default", "type"} & settings.keys():
        settings["is_flag"] = True
    settings.setdefault("show_default", "default" in settings)
    return click.option(flag, *names, help=text, **settings)


def option_group(*options: Decorator) -> Decorator:
    """One decorator of several options, in the order of the help."""

    def decorate(function: Any) -> Any:
        for add_option in reversed(options):  # click lists the option first that is added last
            function = add_option(function)
        return function

    return decorate


def plain_command(name: str, *options: Decorator, examples: Sequence[str]) -> Decorator:
    """Command from a function of its options that returns an exit code; library errors are printed in one line."""

    def decorate(function: Callable[..., int | None]) -> click.Command:
        @wraps(function)
        def run(**arguments: Any) -> None:
            with plain_errors():
                exit_code = function(**arguments)
                if exit_code:
                    sys.exit(exit_code)

        declare = click.command(name, cls=GroupedHelp, epilog=examples_text(*examples))
        command: click.Command = declare(option_group(*options)(run))
        return command

    return decorate


# ── The commands


class _Entry(NamedTuple):
    """Entry of the list of commands."""

    module: str
    """Module of this package with the function NAME_command."""
    summary: str
    """Line in the list of commands."""


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
"""Entries of commands by group and name."""
_NAME_WIDTH = 8
"""Width of the name column in each group, in characters."""
_SYNONYMS = {"check": "torques"}
"""Listed command for each command name that is not listed."""
_COMMANDS = {name: entry for group in _GROUPS.values() for name, entry in group.items()}
"""Entries of commands by name."""


class LazyCommands(Commands):
    """Commands of :data:`_COMMANDS`, loaded on demand."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; raises UsageError with what to type instead."""
        first_word = args[0]
        if not first_word.startswith("-") and self.get_command(ctx, first_word) is None:
            raise click.UsageError(unknown_command(first_word, _COMMANDS), ctx)
        return super().resolve_command(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  as click calls it
        """Names of all commands."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load a command; None if the name is unknown."""
        cmd_name = _SYNONYMS.get(cmd_name, cmd_name)
        if cmd_name not in _COMMANDS:
            return super().get_command(ctx, cmd_name)
        module = import_module(f".{_COMMANDS[cmd_name].module}", __package__)
        command: click.Command = getattr(module, f"{cmd_name}_command")
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002  as above
        """Write the list of commands without loading them."""
        for title, entries in _GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(_NAME_WIDTH), entry.summary) for name, entry in entries.items()])


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


_PAGE_BY_TOPIC = {
    "assistant": "assistant",
    "columns": "logs",
    "limits": "limits",
    "unsure": "unsure",
    "verdicts": "verdicts",
    "skill": "skill/SKILL",
}
"""Topics of `twistwrench help` and their documentation pages."""


@click.command("help", epilog=examples_text("help columns", "help verdicts"))
@click.argument("topic", metavar="TOPIC", required=False, type=click.Choice([*_PAGE_BY_TOPIC, "robot"]))
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
        command = main.get_command(click.Context(main), "torques")  # any command with a robot has these options
        assert command is not None
        formatter = click.HelpFormatter(width=_LINE_WIDTH)
        with formatter.section("Robot options"):
            context = click.Context(command)
            robot_options = [parameter for parameter in command.params if isinstance(parameter, RobotOption)]
            records = [option.get_help_record(context) for option in robot_options]
            shown_records = [record for record in records if record is not None]  # without hidden options
            formatter.write_dl(shown_records)
        click.echo(formatter.getvalue(), nl=False)
        return
    name = f"{_PAGE_BY_TOPIC[topic]}.md"
    package = Path(__file__).parent.parent
    page = package / "guides" / name
    if not page.exists():  # in the source tree
        page = package.parent.parent / "docs" / name
    text = page.read_text("utf-8")
    if topic == "skill":  # a file to save, as it is
        click.echo(text, nl=False)
        return
    text = re.sub(r"\A---\n.*?\n---\n+", "", text, flags=re.DOTALL)  # front matter
    text = re.sub(r"^(```\w+) .*$", r"\1", text, flags=re.MULTILINE)  # options of a code block, after its language
    text = re.sub(r"\[([^\]]+)\]\((?!https?:)[^)]*\)", r"\1", text)  # links between pages
    click.echo(text)
