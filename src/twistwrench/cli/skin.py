"""Commands made from functions: the signature declares the options, the docstring has their help, the result is printed.

A parameter's annotation selects the form of its option (:data:`_KINDS`); its name is the option's name. The files of a command
are methods of the result (:class:`File`).
"""

from __future__ import annotations

import inspect
import re
import sys
import tempfile
from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, Literal, TypeAlias, TypeVar, get_args, get_origin

import click

from ..answers.answer import Answer
from ..core.arguments import parse_numbers
from ..core.errors import ValueRangeError
from ..core.files import check_outputs, picture_path, refuse_existing
from ..motion.load_case import parse_wrenches, payloads_of
from ..robots.finding import bundled_file
from .hints import Seconds
from .main import Decorator, GroupedHelp, check_matplotlib, examples_text, note, option, option_group, plain_errors
from .report import answer_report, write_answer_json
from .shared import DEGREES, LOG_READING, PLAN, ROBOT, LogOptions, RobotOptions, motion_argument, show_written
from .terminal import show_answer

Asked: TypeAlias = dict[str, Any]
"""Options that are given, by parameter of the function."""
A = TypeVar("A", bound=Answer)

# ── Parameters of a function


@dataclass(frozen=True)
class FunctionParameter:
    """Parameter of a function: name, annotation without ``| None``, default and description."""

    name: str
    annotation: str
    default: Any
    text: str

    @property
    def flag(self) -> str:
        """Option of the same name."""
        return f"--{self.name.replace('_', '-')}"


def parameters_of(function: Callable[..., Any]) -> dict[str, FunctionParameter]:
    """Parameters by name, with the descriptions in the docstring's section ``Parameters``.

    >>> from twistwrench import check
    >>> parameters_of(check)["clearance"]
    FunctionParameter(name='clearance', annotation='Metres', default=None, text='Check the least distance between links [m].')
    """
    texts, given = _descriptions(inspect.getdoc(function) or ""), inspect.signature(function).parameters
    return {
        name: FunctionParameter(
            name, str(one.annotation).removesuffix(" | None"), one.default, _in_the_shell(texts.get(name, ""), given)
        )
        for name, one in given.items()
    }


def _descriptions(docstring: str) -> dict[str, str]:
    """Description of each parameter: its indented lines, or without them the words after its type."""
    section = re.search(r"^Parameters\n-+\n(.*?)(?:\n\n|\Z)", docstring, re.DOTALL | re.MULTILINE)
    found: dict[str, str] = {}
    for entry in re.split(r"\n(?=\S)", section[1] if section else ""):
        head, *lines = entry.split("\n")
        names, _, rest = head.partition(" : ")
        words = " ".join(line.strip() for line in lines) or _without_type(rest)
        text = re.sub(r":\w+:`(?:[^`<]*<)?~?([^`>]*)>?`", r"\1", words)
        for name in names.split(", "):
            found[name] = f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""
    return found


def _in_the_shell(text: str, parameters: Container[str]) -> str:
    """Description with options in place of parameters between backticks."""
    return re.sub(r"``(.*?)``", lambda found: f"--{found[1]}" if found[1] in parameters else found[1], text)


def _without_type(rest: str) -> str:
    """Words after ``float, optional,``."""
    _, optional, after = rest.partition(", optional, ")
    return after if optional else rest.partition(", ")[2]


# ── Forms of options, by annotation


@dataclass(frozen=True)
class Kind:
    """Form of the option of a parameter: its placeholder, and how its text becomes a value."""

    form: str
    parse: Callable[[Any, str], Any] = lambda value, _flag: value
    settings: Mapping[str, Any] | None = None
    is_file: bool = False
    bundled: tuple[str, str] | None = None
    """Ending and name of the file that ``demo`` means, beside a bundled robot."""


def _vector(text: str, flag: str) -> list[float]:
    return parse_numbers(text, flag, "x,y,z in metres, for example 0,0,0.1", 3)


def _numbers(*counts: int) -> Callable[[str, str], list[float]]:
    """Parser of comma-separated numbers, as many as one of the counts."""
    form = f"{' or '.join(map(str, counts))} numbers separated by commas"
    return lambda text, flag: parse_numbers(text, flag, form, *counts)


def _sensor_file(text: str, _flag: str) -> Path:
    from ..sensing.files import sensor_path

    return sensor_path(text)


def _several(texts: Sequence[str], _flag: str) -> list[str] | None:
    return list(texts) or None


def _listed(text: str, _flag: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


DEMO = "demo"
_REPEATED = {"multiple": True}
_KINDS = {
    "str": Kind("NAME"),
    "MethodName": Kind("NAME"),
    "int": Kind("N", settings={"type": int}),
    "float": Kind("VALUE", settings={"type": float}),
    "Seconds": Kind("SECONDS", settings={"type": Seconds()}),
    "Metres": Kind("[DISTANCE]", settings={"type": float, "is_flag": False, "flag_value": 0.0}),
    "Hours": Kind("HOURS", settings={"type": float}),
    "Celsius": Kind("CELSIUS", settings={"type": float}),
    "Frame": Kind("FRAME"),
    "Vector": Kind("x,y,z", _vector),
    "LoadsGiven": Kind("MASS[,x,y,z][@FRAME]", settings=_REPEATED),
    "WrenchesGiven": Kind("FRAME:m,m,m,f,f,f", lambda texts, _flag: parse_wrenches(texts), _REPEATED),
    "ConfigurationGiven": Kind("v,v,…|NAME|JOINT=VALUE", _several, _REPEATED),
    "limits_file.Given": Kind("FILE.csv", is_file=True),
    "Any": Kind("FILE", is_file=True, bundled=(".csv", "motion")),
    "Source | Catalog": Kind("FILE.yaml", is_file=True, bundled=(".drives.yaml", "catalogue")),
    "str | Path": Kind("FILE", is_file=True),
    "str | Path | ArrayLike": Kind("FILE.csv", is_file=True),
    "str | Sequence[str]": Kind("NAME", _several, _REPEATED),
    "bool | Sequence[str | Path]": Kind("DIR", _several, _REPEATED),
    "Names": Kind("NAME,…", _listed),
    "Causes": Kind("CAUSE"),
    "SensorGiven": Kind("SENSOR.json", _sensor_file, is_file=True),
    "BiasGiven": Kind("m,m,m,f,f,f", _numbers(6)),
    "NoiseGiven": Kind("M,F", _numbers(2, 6)),
    "NoisePair": Kind("M,F", _numbers(2)),
}
"""Forms by annotation. A bool is a flag, and a Literal a choice."""
_OF_READING = frozenset({"columns", "gain", "rate", "topic", "episode", "plan"})
_OF_ROBOT = frozenset({"lock", "actuators", "tip", "degrees"})
_ARGUMENTS = frozenset({"robot", "motion", "log", "self"})
_NOT_OPTIONS = frozenset({*_ARGUMENTS, "progress", "draws", "max_bodies", *_OF_READING, *_OF_ROBOT})


@dataclass(frozen=True)
class Spelling:
    """Option that is not spelled as its parameter: its form, its values by text, and its help."""

    form: str
    values: Mapping[str, Any] | None = None
    """Values by text; that of a flag has the text ``""``."""
    text: str = ""
    """Help, if the parameter's does not fit."""


SPELLINGS = {
    "dt": Spelling("--step SECONDS"),
    "start": Spelling("--from v,v,…|JOINT=VALUE"),
    "add_masses": Spelling("--masses-included", {"": False}),
    "shared_supply": Spelling("--regeneration", {"shared": True, "none": False}),
}
"""Options that are spelled otherwise than their parameters, as a speaker of the shell would."""


class Question:
    """Function of a command, and its parameters as options."""

    def __init__(
        self,
        function: Callable[..., Any],
        left_out: Collection[str] = (),
        spellings: Mapping[str, Spelling] = MappingProxyType({}),
    ) -> None:
        self.function = function
        self.parameters = {name: one for name, one in parameters_of(function).items() if name not in left_out}
        self.spellings = {**SPELLINGS, **spellings}

    @property
    def options(self) -> list[FunctionParameter]:
        """Parameters that become options of the command alone."""
        return [each for each in self.parameters.values() if each.name not in _NOT_OPTIONS]

    def choices(self, parameter: FunctionParameter) -> tuple[str, ...]:
        """Values of a Literal, or of one and a sequence of it; empty for other parameters."""
        annotation = self._type(parameter)
        literal = next((each for each in (annotation, *get_args(annotation)) if get_origin(each) is Literal), None)
        return get_args(literal)

    def _type(self, parameter: FunctionParameter) -> Any:
        return getattr(self.function, "__globals__", {}).get(parameter.annotation)

    def _is_flag(self, parameter: FunctionParameter) -> bool:
        """True if the option has no value."""
        spelled = self.spellings.get(parameter.name)
        values = None if spelled is None else spelled.values
        return parameter.annotation == "bool" if values is None else "" in values

    def declarations(self) -> Iterator[Decorator]:
        """Options in the order of the signature. An option that is not given is None or empty: the default applies."""
        for parameter in self.options:
            yield self._declaration(parameter)

    def _declaration(self, parameter: FunctionParameter) -> Decorator:
        spelled, kind = self.spellings.get(parameter.name), _KINDS.get(parameter.annotation)
        text = (spelled.text if spelled else "") or parameter.text
        required = parameter.default is inspect.Parameter.empty
        if self._is_flag(parameter):
            flag = spelled.form if spelled else f"--no-{parameter.flag[2:]}" if parameter.default else parameter.flag
            if parameter.default and not spelled:
                text = f"Do not {text[:1].lower()}{text[1:]}"
            return option(flag, text, parameter.name)
        choices = tuple(spelled.values) if spelled and spelled.values else self.choices(parameter)
        if parameter.default not in (None, (), "", inspect.Parameter.empty) and not spelled:
            text += f" [default: {_printed(parameter.default)}]"
        if choices:
            repeated = bool(get_args(self._type(parameter))) and get_origin(self._type(parameter)) is not Literal
            several: dict[str, Any] = _REPEATED if repeated else {}
            text = f"{text[:-1]}; may be repeated." if repeated else text
            flag = f"{parameter.flag} {kind.form}" if kind else parameter.flag
            return option(spelled.form if spelled else flag, text, parameter.name, choices=choices, **several)
        assert kind is not None, parameter
        form = spelled.form if spelled else f"{parameter.flag} {kind.form}"
        if kind.settings == _REPEATED:
            text = f"{text[:-1]}; may be repeated."
        return option(form, text, parameter.name, required=required, **(kind.settings or {}))

    def values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Values of the options that are given, by parameter; ``demo`` is a file of the robot."""
        found: dict[str, Any] = {}
        for parameter in self.options:
            value = given[parameter.name]
            if value is None or value == () or (self._is_flag(parameter) and value is False):
                continue
            spelled, kind = self.spellings.get(parameter.name), _KINDS.get(parameter.annotation)
            if spelled is not None and spelled.values:
                value = spelled.values["" if value is True else value]
            elif parameter.annotation == "bool":
                value = not parameter.default
            elif kind is not None and kind.bundled and value == DEMO:
                value = bundled_file(value, given["source"], *kind.bundled)
            elif parameter.annotation == "LoadsGiven":
                value = list(payloads_of(value, given.get("tip")))
            elif kind is not None:
                value = kind.parse(value, parameter.flag)
            found[parameter.name] = value
        return found

    def files(self, values: Mapping[str, Any]) -> dict[str, str]:
        """Files that the function reads, by option."""
        kinds = {each: _KINDS.get(each.annotation) for each in self.options}
        return {
            each.flag: str(values[each.name])
            for each, kind in kinds.items()
            if kind is not None and kind.is_file and each.name in values
        }


def _printed(value: object) -> str:
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


# ── Files of an answer


@dataclass(frozen=True)
class OutputFile(Generic[A]):
    """File that a command writes: its option, and the method of the answer."""

    form: str
    text: str
    write: Callable[[A, str], object]
    is_picture: bool = False
    is_data: bool = True
    """True if an existing file is replaced only with ``--overwrite``."""
    exists: Callable[[A], bool] = lambda _answer: True
    """False for an answer without this file."""
    missing: str = ""
    """Note if the answer has no such file."""
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
        "--plot OUT.png", text, write, is_picture=True, is_data=False, exists=exists, keeps=keeps, missing=missing
    )


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

    def check(self, *, overwrite: bool) -> None:
        """Raise, before a long run, if a file cannot be written, or would replace an input or another output."""
        if self.report is not None or any(file.is_picture for file in self.files):
            check_matplotlib()
        for file in self.files:
            file.require()
        named = {file.flag: path for file, path in self.files.items() if path != "-"}
        check_outputs(named | ({} if self.report is None else {"--report": self.report}), self.inputs)
        for file, path in self.files.items():
            if file.is_data and path != "-":
                refuse_existing(path, overwrite=overwrite)

    @cached_property
    def printed(self) -> OutputFile[A] | None:
        """File that is printed in place of the report."""
        found = [file for file, path in self.files.items() if path == "-"]
        if len(found) > 1:
            flags = " and ".join(f"{file.flag} -" for file in found)
            raise ValueRangeError(f"{flags} would print two files as one. Choose one, or give the other a name.")
        return found[0] if found else None

    def written_by(self, flag: str, write: Callable[[A, str], object]) -> None:
        """Write the file of an option by another method."""
        self.files = {
            replace(file, write=write) if file.flag == flag else file: path for file, path in self.files.items()
        }

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
            elif path != "-" and file.missing:
                note(file.missing)

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
    left_out: Collection[str] = (),
    spellings: Mapping[str, Spelling] = MappingProxyType({}),
    reads: Callable[..., Mapping[str, str | Path | None]] | None = None,
) -> Callable[[Callable[..., Answer]], click.Command]:
    """Command whose options are the parameters of a function of the library, from a body that calls it.

    The body takes those of these arguments that it names: ``robot``, its options, unless the function reads the file itself;
    ``log``, the motion's; ``outputs``; options by their names; and ``asked``, all other options that are given, by parameter.
    Parameters that are ``left_out`` are functions, or spelled by ``own`` options; ``spellings`` are of this command alone.
    ``reads`` names the files of arguments that the body reads itself, from options by their names. The ``summary`` stands in
    the list of a group.
    """

    def decorate(body: Callable[..., Any]) -> click.Command:
        question = Question(function, left_out, spellings)
        call = Call(question, body, (*files, _JSON), report, own, reads, with_robot=with_robot)

        def run(**given: Any) -> None:
            with plain_errors():
                sys.exit(call.answer(given))

        run.__doc__ = description or body.__doc__
        declare = click.command(name, cls=GroupedHelp, epilog=examples_text(*examples), short_help=summary or None)
        made: click.Command = declare(option_group(*call.declarations())(run))
        named = {*call.wanted, *_names(reads)}
        missing = named - {str(param.name) for param in made.params} - set(_OFFERED)
        assert not missing, f"{name}: {missing}"
        return made

    return decorate


_OFFERED = ("asked", "robot", "log", "outputs")


def _names(function: Callable[..., Any] | None) -> list[str]:
    """Names of a function's arguments."""
    return [] if function is None else [*inspect.signature(function).parameters]


@dataclass(frozen=True)
class Call(Generic[A]):
    """Call of a command: its options, and from their values the answer, its report and its files."""

    question: Question
    body: Callable[..., A]
    files: Sequence[OutputFile[A]]
    report: bool
    own: Sequence[Decorator]
    reads: Callable[..., Mapping[str, str | Path | None]] | None
    with_robot: bool

    @cached_property
    def wanted(self) -> Sequence[str]:
        """Names of the arguments of the body."""
        return _names(self.body)

    @property
    def with_log(self) -> bool:
        """True if the command reads the file of a motion."""
        return {"motion", "columns"} <= self.question.parameters.keys()

    def declarations(self) -> Iterator[Decorator]:
        """Arguments and options, in the order of the help."""
        if self.with_robot:
            yield ROBOT
        if self.with_log:
            yield from (motion_argument(required=True), LOG_READING, PLAN)
        yield from self.question.declarations()
        yield from self.own
        yield from (file.option for file in self.files)
        if self.report:
            yield from (_REPORT, _FULL_PATHS)
        if "degrees" in self.question.parameters:
            yield DEGREES
        yield from (OVERWRITE, ALL)

    def answer(self, given: Mapping[str, Any]) -> int:
        """Answer the question, print the report, write the files; returns the exit code."""
        robot = RobotOptions.of(given) if self.with_robot else None
        log = LogOptions.of(given) if self.with_log else None
        values = self.question.values(given)
        inputs: dict[str, str | Path | None] = {}
        if self.reads is not None:
            inputs |= self.reads(**{each: given[each] for each in _names(self.reads)})
        inputs |= self.question.files(values)
        if robot is not None:
            inputs |= robot.files
            if log is not None:
                inputs = {"MOTION": log.path(robot), **inputs}
            if "degrees" in self.question.parameters and robot.degrees:
                values["degrees"] = True
        outputs = self._outputs(given, inputs)
        asked = {each: value for each, value in values.items() if each not in self.wanted}
        arguments = {**given, "asked": asked, "robot": robot, "log": log, "outputs": outputs}
        found = self.body(**{each: arguments[each] for each in self.wanted})
        self._show(found, outputs)
        if outputs.interrupt is not None:
            raise outputs.interrupt
        return found.verdict.exit_code

    def _outputs(self, given: Mapping[str, Any], inputs: Mapping[str, str | Path | None]) -> Outputs[A]:
        """Output files; raises if one cannot be written."""
        chosen = {file: given[file.name] for file in self.files if given[file.name] is not None}
        pictures = {file: picture_path(path) for file, path in chosen.items() if file.is_picture}
        outputs = Outputs(chosen | pictures, given.get("file_report"), bool(given.get("full_paths")), inputs)
        outputs.check(overwrite=given["overwrite"])
        return outputs

    def _show(self, found: A, outputs: Outputs[A]) -> None:
        """Print the report, or the file in its place, and write the files."""
        printed = outputs.printed if outputs.printed is not None and outputs.printed.exists(found) else None
        if printed is None:
            show_answer(found)
        outputs.write(found)
        if outputs.report is not None:
            answer_report(found, outputs.report, outputs.inputs, full_paths=outputs.full_paths)
            show_written(outputs.report, to_error=printed is not None)
        if printed is not None:
            outputs.print(found)
