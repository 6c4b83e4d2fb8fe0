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
"""Options that are given, by parameter of the function."""
A = TypeVar("A", bound=Answer)

# ── Files of an answer


@dataclass(frozen=True)
class OutputFile(Generic[A]):
    """File that a command writes: its option, and the method of the answer."""

    form: str
    text: str
    write: Callable[[A, str], object]
    complete: Callable[[str], str] = str
    """Adds the ending to a name without one, and raises for another."""
    is_data: bool = True
    """True if an existing file is replaced only with ``--overwrite``."""
    exists: Callable[[A], bool] = lambda _answer: True
    """False for an answer without this file."""
    missing: Callable[[A, str], str] = lambda _answer, _path: ""
    """Note if the answer has no such file; empty without one."""
    comment: Callable[[A], str] = lambda _answer: ""
    """Continuation of the line that names the written file."""
    keeps: Callable[[A], bool] = lambda _answer: False
    """True for an answer that does not replace an existing file."""
    require: Callable[[], object] = lambda: None
    """Raises if a package for the file is not installed, before a long run."""

    @property
    def flag(self) -> str:
        """Option of the file."""
        return self.form.partition(" ")[0]

    @property
    def name(self) -> str:
        """Parameter of the option."""
        return f"file_{self.flag[2:].replace('-', '_')}"

    @property
    def option(self) -> Decorator:
        """Declaration of the option."""
        return option(self.form, self.text, self.name)


def table_file(
    write: Callable[[A, str], object],
    text: str,
    *,
    exists: Callable[[A], bool] = lambda _answer: True,
    keeps: Callable[[A], bool] = lambda _answer: False,
) -> OutputFile[A]:
    """File of ``--csv``."""
    help_ = f"{text}; '-' prints it in place of the report."
    return OutputFile("--csv OUT.csv", help_, write, exists=exists, keeps=keeps)


def picture_file(
    text: str,
    *,
    exists: Callable[[A], bool] = lambda _answer: True,
    keeps: Callable[[A], bool] = lambda _answer: False,
    missing: str = "",
) -> OutputFile[A]:
    """File of ``--plot``, the answer's usual picture."""

    def write(answer: A, path: str) -> object:
        return answer.plot(path=path)

    return OutputFile(
        "--plot OUT.png", text, write, complete=picture_path, is_data=False, exists=exists, keeps=keeps,
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
    report: str | None
    full_paths: bool
    inputs: Mapping[str, str | Path | None]
    interrupt: KeyboardInterrupt | None = None
    """Ctrl-C during the work, raised again after the answer so far is written."""

    def check(self, *, overwrite: bool, also: Mapping[str, str] | None = None) -> None:
        """Raise, before a long run, if a file cannot be written, or would replace an input or another output.

        ``also`` are files that the function of the command writes itself, by argument.
        """
        if self.report is not None:
            check_matplotlib()
        for file in self.files:
            file.require()
        named = {file.flag: path for file, path in self.files.items() if path != "-"}
        if self.report is not None:
            named["--report"] = self.report
        also = also or {}
        check_outputs({**also, **named}, self.inputs)
        for path in also.values():
            refuse_existing(path, overwrite=overwrite)
        for file, path in self.files.items():
            if file.is_data and path != "-":
                refuse_existing(path, overwrite=overwrite)

    @cached_property
    def printed(self) -> OutputFile[A] | None:
        """File that is printed in place of the report."""
        to_print = [file for file, path in self.files.items() if path == "-"]
        if not to_print:
            return None
        if len(to_print) > 1:
            flags = " and ".join(f"{file.flag} -" for file in to_print)
            raise ValueRangeError(f"{flags} would print two files as one. Choose one, or give the other a name.")
        return to_print[0]

    def written_by(self, flag: str, write: Callable[[A, str], object]) -> None:
        """Write the file of an option by another method."""
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
        """Write a file that no option names."""
        self.files = {**self.files, file: path}

    @property
    def flags(self) -> list[str]:
        """Options of the files."""
        return [file.flag for file in self.files] + ["--report"] * (self.report is not None)

    def path_of(self, flag: str) -> str:
        """Path that was given for an option; empty without it."""
        return next((path for file, path in self.files.items() if file.flag == flag), "")

    def write(self, answer: A) -> None:
        """Write the files, and print a line for each."""
        for file, path in self.files.items():
            if path != "-" and file.keeps(answer) and Path(path).is_file():
                note(f"{path} is kept as it was: the motion is not complete. Name another file for it.")
            elif path != "-" and file.exists(answer):
                file.write(answer, path)
                show_written(f"{path}{file.comment(answer)}", to_error=self.printed is not None)
            elif path != "-":
                for reason in filter(None, [file.missing(answer, path)]):
                    note(reason)

    def print(self, answer: A) -> None:
        """Print the file of ``-``."""
        assert self.printed is not None
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, f"out.{self.printed.flag[2:]}")
            self.printed.write(answer, str(path))
            with path.open(encoding="utf-8", newline="") as text:
                while portion := text.read(_PORTION):
                    click.echo(portion, nl=False)


_PORTION = 1 << 16


# ── The command


def of_robot(function: Callable[..., A]) -> Callable[[RobotOptions, Asked], A]:
    """Body of a command whose function takes the robot and the options, and nothing else."""

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
    also: Sequence[Question] = (),
    needs_robot: bool = True,
    needs_motion: bool = True,
    left_out: Collection[str] = (),
    spellings: Mapping[str, Spelling] = MappingProxyType({}),
    kinds: Mapping[str, Kind] = MappingProxyType({}),
    reads: Callable[..., Mapping[str, str | Path | None]] | None = None,
) -> Callable[[Callable[..., Answer]], click.Command]:
    """Command whose options are the parameters of a function of the library, from a body that calls it.

    The body takes those of these arguments that it names: ``robot``, its options, unless the function reads the file itself;
    ``log``, the motion's; ``outputs``; options by their names; and ``asked``, all other options that are given, by parameter.
    Parameters that are ``left_out`` are functions, or spelled by ``own`` options; ``spellings``, and ``kinds`` by
    annotation, are of this command alone. Parameters of the functions of ``also`` are options too. ``reads`` names the files
    of arguments that the body reads itself, from options by their names. The ``summary`` stands in the list of a group.
    """

    def decorate(body: Callable[..., Any]) -> click.Command:
        questions = (Question(function, left_out, spellings, kinds=kinds), *also)
        call = Call(
            questions, body, (*files, _JSON), report, own, reads, with_robot=with_robot, needs_motion=needs_motion
        )

        def run(**given: Any) -> None:
            with plain_errors():
                sys.exit(call.answer(given))

        run.__doc__ = description or body.__doc__
        declare = click.command(name, cls=GroupedHelp, epilog=examples_text(*examples), short_help=summary or None)
        made: click.Command = declare(option_group(*call.declarations())(run))
        named = {*call.wanted, *_names(reads)}
        if with_robot and not needs_robot:
            made.params[0].required, made.params[0].metavar = False, "[ROBOT]"
        missing = named - {str(param.name) for param in made.params} - set(_OFFERED)
        assert not missing, f"{name}: {missing}"
        return made

    return decorate


_OFFERED = ("asked", "robot", "log", "outputs")


def _names(function: Callable[..., Any] | None) -> list[str]:
    """Names of a function's arguments."""
    if function is None:
        return []
    return list(inspect.signature(function).parameters)


@dataclass(frozen=True)
class Call(Generic[A]):
    """Call of a command: its options, and from their values the answer, its report and its files."""

    questions: Sequence[Question]
    body: Callable[..., A]
    files: Sequence[OutputFile[A]]
    report: bool
    own: Sequence[Decorator]
    reads: Callable[..., Mapping[str, str | Path | None]] | None
    with_robot: bool
    needs_motion: bool

    @cached_property
    def wanted(self) -> Sequence[str]:
        """Names of the arguments of the body."""
        return _names(self.body)

    @property
    def with_log(self) -> bool:
        """True if the command reads the file of a motion."""
        return self._asks("motion", "columns")

    def _asks(self, *parameters: str) -> bool:
        """True if a function has these parameters."""
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
        if self._asks("degrees"):
            yield DEGREES
        yield from (OVERWRITE, ALL)

    def answer(self, given: Mapping[str, Any]) -> int:
        """Answer the question, print the report, write the files; returns the exit code."""
        robot = RobotOptions.of(given) if self.with_robot and given["source"] is not None else None
        log = LogOptions.of(given) if self.with_log else None
        values: dict[str, Any] = {}
        inputs: dict[str, str | Path | None] = {}
        if self.reads is not None:
            inputs |= self.reads(**{each: given[each] for each in _names(self.reads)})
        for question in self.questions:
            own = question.values(given)
            values |= own
            inputs |= question.files(own)
        if robot is not None:
            inputs |= robot.files
            if log is not None and log.trajectory is not None:
                inputs = {"MOTION": log.path(robot), **inputs}
        if self._asks("degrees") and given["degrees"]:
            values["degrees"] = True
        outputs = self._outputs(given, inputs)
        asked = {name: value for name, value in values.items() if name not in self.wanted}
        defaults: dict[str, Any] = {}
        for question in self.questions:
            defaults |= question.defaults
        arguments = {**given, **defaults, **values, "asked": asked, "robot": robot, "log": log, "outputs": outputs}
        found = self.body(**{each: arguments[each] for each in self.wanted})
        self._show(found, outputs)
        if outputs.interrupt is not None:
            raise outputs.interrupt
        return found.verdict.exit_code

    def _outputs(self, given: Mapping[str, Any], inputs: Mapping[str, str | Path | None]) -> Outputs[A]:
        """Output files; raises if one cannot be written."""
        chosen = {file: file.complete(given[file.name]) for file in self.files if given[file.name] is not None}
        outputs = Outputs(chosen, given.get("file_report"), bool(given.get("full_paths")), inputs)
        outputs.check(overwrite=given["overwrite"])
        return outputs

    def _show(self, found: A, outputs: Outputs[A]) -> None:
        """Print the report, or the file in its place, and write the files."""
        prints_file = outputs.printed is not None and outputs.printed.exists(found)
        if not prints_file:
            show_answer(found)
        outputs.write(found)
        if outputs.report is not None:
            answer_report(found, outputs.report, outputs.inputs, full_paths=outputs.full_paths)
            show_written(outputs.report, to_error=prints_file)
        if prints_file:
            outputs.print(found)
