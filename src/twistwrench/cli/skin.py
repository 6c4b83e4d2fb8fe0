"""Commands made from functions: the signature declares the options, the docstring has their help, the result is printed.

The files of a command are methods of the result (:class:`OutputFile`).
"""

from __future__ import annotations

import inspect
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeAlias, TypeVar

import click

from ..core.answers.answer import Answer
from ..core.errors import ValueRangeError
from ..core.files import check_outputs, picture_path, refuse_existing
from .main import Decorator, GroupedHelp, check_matplotlib, examples_text, note, option, option_group, plain_errors
from .parameters import Kind, Question, Spelling
from .report import answer_report, write_answer_json
from .shared import DEGREES, LOG_READING, PLAN, ROBOT, LogOptions, RobotOptions, motion_argument, show_written
from .terminal import show_answer

Asked: TypeAlias = dict[str, Any]
"""Values of the options on the command line, by parameter of the function."""
A = TypeVar("A", bound=Answer)

# ── Files of an answer


@dataclass(frozen=True)
class OutputFile(Generic[A]):
    """File that a command writes: its option, and the method of the answer."""

    option_text: str
    """Option and the name of its value, such as ``--csv OUT.csv``."""
    help_text: str
    """Help of the option."""
    write: Callable[[A, str], object]
    """Writes the file of an answer to a path."""
    complete: Callable[[str], str] = str
    """Path with the file's ending, added if the given path has none; raises for another ending."""
    is_data: bool = True
    """True if an existing file is replaced only with ``--overwrite``."""
    exists: Callable[[A], bool] = lambda _answer: True
    """True for an answer that has this file."""
    missing: Callable[[A, str], str] = lambda _answer, _path: ""
    """Note for an answer without this file; empty if none is needed."""
    comment: Callable[[A], str] = lambda _answer: ""
    """Continuation of the line that names the written file."""
    keeps: Callable[[A], bool] = lambda _answer: False
    """True for an answer that does not replace an existing file."""
    require: Callable[[], object] = lambda: None
    """Raises, before a long run, if a package for the file is not installed."""

    @property
    def flag(self) -> str:
        """Option of the file."""
        flag, _, _ = self.option_text.partition(" ")
        return flag

    @property
    def name(self) -> str:
        """Name of the option's value among the values of the command line."""
        return f"file_{self.flag[2:].replace('-', '_')}"

    @property
    def option(self) -> Decorator:
        """Declaration of the option."""
        return option(self.option_text, self.help_text, self.name)


def table_file(
    write: Callable[[A, str], object],
    help_text: str,
    *,
    exists: Callable[[A], bool] = lambda _answer: True,
    keeps: Callable[[A], bool] = lambda _answer: False,
) -> OutputFile[A]:
    """File of ``--csv``."""
    full_help = f"{help_text}; '-' prints it in place of the report."
    return OutputFile("--csv OUT.csv", full_help, write, exists=exists, keeps=keeps)


def picture_file(
    help_text: str,
    *,
    exists: Callable[[A], bool] = lambda _answer: True,
    keeps: Callable[[A], bool] = lambda _answer: False,
    missing: str = "",
) -> OutputFile[A]:
    """File of ``--plot``, the answer's usual picture."""

    def write(answer: A, path: str) -> object:
        return answer.plot(path=path)

    return OutputFile(
        "--plot OUT.png", help_text, write, complete=picture_path, is_data=False, exists=exists, keeps=keeps,
        missing=lambda _answer, _path: missing, require=check_matplotlib,
    )  # fmt: skip


_JSON: OutputFile[Any] = OutputFile(
    "--json OUT.json",
    "Write the results as JSON; '-' prints them in place of the report.",
    write_answer_json,
)
OVERWRITE = option("--overwrite", "Replace files of data that exist.")
ALL = option("--all", "Print all rows and notes.", "whole_report")
_FULL_PATHS = option("--full-paths", "Show full paths of files in --report.", "full_paths")
_REPORT = option("--report OUT.html", "Write a report as one self-contained page.", "file_report")


@dataclass
class Outputs(Generic[A]):
    """Output files of a command, and the inputs that they must not replace."""

    files: Mapping[OutputFile[A], str]
    """Path of each file; "-" prints the file in place of the report."""
    report: str | None
    """Path of the HTML page; None without ``--report``."""
    full_paths: bool
    """True if the page shows full paths."""
    inputs: Mapping[str, str | Path | None]
    """Input files, by argument."""
    interrupt: KeyboardInterrupt | None = None
    """Ctrl-C during the work, raised again after the answer so far is written."""

    def check(self, *, overwrite: bool, function_files: Mapping[str, str] | None = None) -> None:
        """Raise, before a long run, if a file cannot be written, or would replace an input or another output.

        ``function_files`` are files that the function of the command writes itself, by argument.
        """
        if self.report is not None:
            check_matplotlib()
        for file in self.files:
            file.require()
        function_files = {} if function_files is None else function_files
        paths = dict(function_files)
        paths |= {file.flag: path for file, path in self.files.items() if path != "-"}
        if self.report is not None:
            paths["--report"] = self.report
        check_outputs(paths, self.inputs)
        for path in function_files.values():
            refuse_existing(path, overwrite=overwrite)
        for file, path in self.files.items():
            if file.is_data and path != "-":
                refuse_existing(path, overwrite=overwrite)

    @cached_property
    def printed_file(self) -> OutputFile[A] | None:
        """File that is printed in place of the report, by the path "-"; None without one."""
        to_print = [file for file, path in self.files.items() if path == "-"]
        if not to_print:
            return None
        if len(to_print) > 1:
            flags = " and ".join(f"{file.flag} -" for file in to_print)
            raise ValueRangeError(f"{flags} would print two files as one. Choose one, or give the other a name.")
        return to_print[0]

    def set_writer(self, flag: str, write: Callable[[A, str], object]) -> None:
        """Replace the method that writes the file of an option."""
        files = {}
        for file, path in self.files.items():
            if file.flag == flag:
                file = replace(file, write=write)
            files[file] = path
        self.files = files

    def leave_out_all_but(self, *flags: str) -> None:
        """Write only the files of these options."""
        self.files = {file: path for file, path in self.files.items() if file.flag in flags}

    def add(self, file: OutputFile[A], path: str) -> None:
        """Add a file that no option names."""
        self.files = {**self.files, file: path}

    @property
    def flags(self) -> list[str]:
        """Options of the files, with ``--report``."""
        flags = [file.flag for file in self.files]
        if self.report is not None:
            flags.append("--report")
        return flags

    def path_of(self, flag: str) -> str:
        """Path that was given for an option; empty without it."""
        for file, path in self.files.items():
            if file.flag == flag:
                return path
        return ""

    def write(self, answer: A) -> None:
        """Write the files, and print a line for each."""
        for file, path in self.files.items():
            if path == "-":
                continue
            if file.keeps(answer) and Path(path).is_file():
                note(f"{path} is kept as it was: the motion is not complete. Name another file for it.")
            elif file.exists(answer):
                file.write(answer, path)
                show_written(f"{path}{file.comment(answer)}", to_error=self.printed_file is not None)
            else:
                reason = file.missing(answer, path)
                if reason:
                    note(reason)

    def print(self, answer: A) -> None:
        """Print the file of ``-``."""
        assert self.printed_file is not None
        with tempfile.TemporaryDirectory() as folder:
            suffix = self.printed_file.flag.removeprefix("--")  # of --csv or --json
            path = Path(folder, f"out.{suffix}")
            self.printed_file.write(answer, str(path))
            with path.open(encoding="utf-8", newline="") as text:
                while portion := text.read(_CHARACTERS_PER_READ):
                    click.echo(portion, nl=False)


_CHARACTERS_PER_READ = 1 << 16


# ── The command


def of_robot(function: Callable[..., A]) -> Callable[[RobotOptions, Asked], A]:
    """Body of a command that only calls ``function`` with the robot and the options."""

    def body(robot: RobotOptions, asked: Asked) -> A:
        return function(robot.load(), **asked)

    return body


def command_of(
    name: str,
    function: Callable[..., Answer],
    *own: Decorator,
    files: Sequence[OutputFile[A]] = (),
    report: bool = False,
    examples: Sequence[str],
    description: str = "",
    summary: str = "",
    with_robot: bool = True,
    further_questions: Sequence[Question] = (),
    needs_robot: bool = True,
    needs_motion: bool = True,
    left_out: Collection[str] = (),
    spellings: Mapping[str, Spelling] = MappingProxyType({}),
    kinds: Mapping[str, Kind] = MappingProxyType({}),
    reads: Callable[..., Mapping[str, str | Path | None]] | None = None,
) -> Callable[[Callable[..., Answer]], click.Command]:
    """Decorator that makes a command of a body; the options are the parameters of a ``function`` that the body calls.

    The body may name these arguments: ``robot`` and ``log`` (options of the robot and of the motion), ``outputs``, any option
    by its name, and ``asked``, which has the options that were given and that the body does not name, by parameter.

    ``own`` are options beside those of the function. Parameters of the functions of ``further_questions`` become options, too.
    Parameters in ``left_out`` get no option. ``spellings``, and ``kinds`` by annotation, apply to this command alone.
    ``reads`` returns the input files that the body reads itself; its arguments are options by their names.
    The ``summary`` stands in the list of a group.
    """

    def decorate(body: Callable[..., Any]) -> click.Command:
        own_question = Question(function, left_out, spellings, kinds=kinds)
        all_files = (*files, _JSON)
        call = Call(
            (own_question, *further_questions),
            body,
            all_files,
            report,
            own,
            reads,
            with_robot=with_robot,
            needs_motion=needs_motion,
        )

        def run(**options: Any) -> None:
            with plain_errors():
                sys.exit(call.answer(options))

        run.__doc__ = description or body.__doc__
        declare = click.command(name, cls=GroupedHelp, epilog=examples_text(*examples), short_help=summary or None)
        with_options = option_group(*call.declarations())
        command: click.Command = declare(with_options(run))
        if with_robot and not needs_robot:
            robot_argument = command.params[0]
            robot_argument.required = False
            robot_argument.metavar = "[ROBOT]"
        argument_names = {*call.body_arguments, *_argument_names(reads)}
        option_names = {str(param.name) for param in command.params}
        unknown_names = argument_names - option_names - _ARGUMENTS_OF_EVERY_BODY
        assert not unknown_names, f"{name}: {unknown_names}"
        return command

    return decorate


_ARGUMENTS_OF_EVERY_BODY = {"asked", "robot", "log", "outputs"}
"""Arguments of a body that are not options."""


def _argument_names(function: Callable[..., Any] | None) -> list[str]:
    """Names of a function's arguments; empty for None."""
    if function is None:
        return []
    return list(inspect.signature(function).parameters)


@dataclass(frozen=True)
class Call(Generic[A]):
    """Call of a command: its options, and from their values the answer, its report and its files."""

    questions: Sequence[Question]
    """Functions whose parameters become options."""
    body: Callable[..., A]
    files: Sequence[OutputFile[A]]
    report: bool
    """True if the command has ``--report``."""
    own: Sequence[Decorator]
    """Options of the command beside those of the functions."""
    reads: Callable[..., Mapping[str, str | Path | None]] | None
    """Returns the input files that the body reads itself; None without such files."""
    with_robot: bool
    needs_motion: bool

    @cached_property
    def body_arguments(self) -> Sequence[str]:
        """Names of the arguments of the body."""
        return _argument_names(self.body)

    @property
    def with_log(self) -> bool:
        """True if the command reads the file of a motion."""
        return self._has_parameters("motion", "columns")

    def _has_parameters(self, *parameters: str) -> bool:
        """True if one of the functions has all these parameters."""
        return any(question.parameters.keys() >= {*parameters} for question in self.questions)

    def declarations(self) -> Iterator[Decorator]:
        """Arguments and options, in the order of the help."""
        if self.with_robot:
            yield ROBOT
        if self.with_log:
            yield from (motion_argument(required=self.needs_motion), LOG_READING, PLAN)
        for question in self.questions:
            yield from question.declarations()
        yield from self.own
        yield from (file.option for file in self.files)
        if self.report:
            yield from (_REPORT, _FULL_PATHS)
        if self._has_parameters("degrees"):
            yield DEGREES
        yield from (OVERWRITE, ALL)

    def answer(self, options: Mapping[str, Any]) -> int:
        """Answer the question, print the report, write the files; returns the exit code.

        ``options`` has the values of all options and arguments, also defaults, by their names.
        """
        robot: RobotOptions | None = None
        if self.with_robot and options["source"] is not None:
            robot = RobotOptions.of(options)
        log = LogOptions.of(options) if self.with_log else None
        values: dict[str, Any] = {}
        inputs: dict[str, str | Path | None] = {}
        if self.reads is not None:
            arguments_of_reads = {name: options[name] for name in _argument_names(self.reads)}
            inputs |= self.reads(**arguments_of_reads)
        for question in self.questions:
            question_values = question.values(options)
            values |= question_values
            inputs |= question.files(question_values)
        if robot is not None:
            inputs |= robot.files
            if log is not None and log.trajectory is not None:
                inputs = {"MOTION": log.path(robot), **inputs}  # the motion is listed first
        if self._has_parameters("degrees") and options["degrees"]:
            values["degrees"] = True
        outputs = self._outputs(options, inputs)
        asked = {name: value for name, value in values.items() if name not in self.body_arguments}
        defaults: dict[str, Any] = {}
        for question in self.questions:
            defaults |= question.defaults
        arguments = {**options, **defaults, **values, "asked": asked, "robot": robot, "log": log, "outputs": outputs}
        own_arguments = {name: arguments[name] for name in self.body_arguments}
        answer = self.body(**own_arguments)
        self._show(answer, outputs)
        if outputs.interrupt is not None:
            raise outputs.interrupt
        return answer.verdict.exit_code

    def _outputs(self, options: Mapping[str, Any], inputs: Mapping[str, str | Path | None]) -> Outputs[A]:
        """Output files; raises if one cannot be written."""
        requested_files = [file for file in self.files if options[file.name] is not None]
        paths = {file: file.complete(options[file.name]) for file in requested_files}
        report_path = options.get("file_report")  # a command without --report has neither option
        full_paths = bool(options.get("full_paths"))
        outputs = Outputs(paths, report_path, full_paths, inputs)
        outputs.check(overwrite=options["overwrite"])
        return outputs

    def _show(self, answer: A, outputs: Outputs[A]) -> None:
        """Print the report or the file that replaces it, and write the files."""
        prints_file = outputs.printed_file is not None and outputs.printed_file.exists(answer)
        if not prints_file:
            show_answer(answer)
        outputs.write(answer)
        if outputs.report is not None:
            answer_report(answer, outputs.report, outputs.inputs, full_paths=outputs.full_paths)
            show_written(outputs.report, to_error=prints_file)
        if prints_file:
            outputs.print(answer)
