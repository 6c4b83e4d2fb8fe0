"""Tools of a coding assistant, made from commands: their options as a schema, and a call whose result is that of ``--json``."""

from __future__ import annotations

import io
import json
import re
import shlex
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import click

from ...core.errors import UnknownNameError, ValueRangeError
from ...core.verdict import ExitCode
from ...formats.xacro import ENDING as XACRO_ENDING
from ..hints import MEANINGS, Seconds
from ..main import main
from .confinement import Folder

_TOOLS = {
    "torques": "robot motion payload limits lock clearance",
    "payload": "robot at tool frame com limits",
    "doctor": "robot meshes limits out",
    "info": "robot tip",
    "identify": "robot logs test columns lock out",
    "move": "robot to from payload fastest csv",
    "size": "robot motion catalog payload pause ambient",
    "convert": "robot out strict overwrite",
}
"""Names of the properties of each tool, by command: its arguments, then its most used options."""
_MORE_PROPERTY = "more"
"""Property of all tools for all other options, as in the shell."""
_MAX_QUOTE_LENGTH = 80
"""Largest number of characters of a value in a message."""
_REFUSED_OPTIONS = {
    "file_json": "it is the answer",
    "workers": "it starts processes",
    "scheduler": "it opens connections",
}
"""Options that no tool has, with the reason."""
_FILE_PLACEHOLDER = re.compile(r"FILE|FOLDER|DIR|LOG|MOTION|OUT|ROBOT")
"""Placeholders of options and arguments that name files."""
_PLAIN_PLACEHOLDERS = ("VALUE", "NAME", "FRAME", "N", "SECONDS", "CELSIUS", "OUT", "LOG")
"""Placeholders without information beyond the name of their option; descriptions leave them out."""
_MAX_RESULT_LENGTH = 200_000
"""Largest result [characters]."""


class ToolResult(NamedTuple):
    """Result of a call."""

    text: str
    is_error: bool


@dataclass(frozen=True)
class Tool:
    """Command as a tool."""

    name: str
    properties: tuple[str, ...]

    @cached_property
    def command(self) -> click.Command:
        """The command."""
        command = main.get_command(click.Context(main), self.name)
        assert command is not None, self.name
        return command

    @cached_property
    def parameters(self) -> dict[str, click.Parameter]:
        """Arguments and options by property."""
        all_parameters = {_property_of(parameter): parameter for parameter in self.command.params}
        return {name: all_parameters[name] for name in self.properties}

    def description(self) -> dict[str, Any]:
        """Name, purpose and schema of the arguments."""
        properties = {}
        required = []
        for name, parameter in self.parameters.items():
            properties[name] = _schema(parameter)
            if isinstance(parameter, click.Argument):
                required.append(name)
        properties[_MORE_PROPERTY] = {"type": "string"}
        schema = {"type": "object", "properties": properties, "required": required}
        return {"name": self.name, "description": _first_sentence(self.command.help or ""), "inputSchema": schema}

    def words(self, arguments: Mapping[str, Any]) -> list[str]:
        """Words of the command line without the command; raises if an argument is unknown or has a value of a wrong type.

        ``arguments`` are values by property, in any order.
        """
        option_words: list[str] = []
        positional_words: list[str] = []
        for name, value in arguments.items():
            if name == _MORE_PROPERTY:
                continue
            if name not in self.parameters:
                raise UnknownNameError.from_choices("argument", name, [*self.parameters, _MORE_PROPERTY])
            parameter = self.parameters[name]
            if isinstance(parameter, click.Option):
                option_words += _option_words(parameter, name, value)
        for name, parameter in self.parameters.items():  # in the order of the command line
            if isinstance(parameter, click.Argument) and name in arguments:
                takes_several = parameter.nargs == -1
                positional_words += _texts(name, arguments[name], several=takes_several)
        more_words = _more_option_words(arguments.get(_MORE_PROPERTY, ""))
        return [*option_words, *more_words, "--", *positional_words]


@dataclass(frozen=True)
class Tools:
    """Tools of a server, on the files of one folder."""

    folder: Folder
    expands_xacro: bool = False
    """True if macros of xacro may be expanded."""

    @cached_property
    def by_name(self) -> dict[str, Tool]:
        """All tools."""
        return {name: Tool(name, tuple(properties.split())) for name, properties in _TOOLS.items()}

    def call(self, name: str, arguments: Mapping[str, Any]) -> ToolResult:
        """Run the command of a tool; an error is a result with the text of the error."""
        tool = self.by_name[name]
        try:
            words = tool.words(arguments)
            self._check(tool, words)
        except (ValueRangeError, UnknownNameError) as error:
            return ToolResult(f"error: {error.in_shell()}", is_error=True)
        except click.UsageError as error:
            return ToolResult(f"error: {error.format_message()}", is_error=True)
        output = io.StringIO()
        messages = io.StringIO()
        code = 0
        with redirect_stdout(output), redirect_stderr(messages):
            try:
                main.main([name, "--json=-", *words], prog_name="twistwrench")
            except SystemExit as exit_request:
                code = _exit_code(exit_request)
        if code not in (ExitCode.FINE, ExitCode.NO):
            message = messages.getvalue().strip()
            return ToolResult(message or f"exit code {code}", is_error=True)
        return _result(output.getvalue())

    def _check(self, tool: Tool, words: list[str]) -> None:
        """Raise for options that no tool has, and for files outside the folder."""
        context = click.Context(tool.command, info_name=tool.name)
        values, _, _ = tool.command.make_parser(context).parse_args(list(words))
        for parameter in tool.command.params:
            value = values.get(str(parameter.name))
            if value is None or not isinstance(value, str | list | tuple):
                continue  # not given, or not a text
            label = parameter.opts[0]
            if isinstance(parameter, click.Argument):
                label = str(parameter.metavar or parameter.name)
            if parameter.name in _REFUSED_OPTIONS:
                raise ValueRangeError(
                    f"{label} is not an option of this server: {_REFUSED_OPTIONS[str(parameter.name)]}. Leave it out."
                )
            if parameter.name == "xacro" and not self.expands_xacro:
                raise ValueRangeError(f"{label}: {_NO_XACRO}")
            if _FILE_PLACEHOLDER.search(parameter.metavar or ""):
                for text in _texts_in(value):
                    self._check_file(text, label)

    def _check_file(self, text: str, label: str) -> None:
        """Raise for a file outside the folder, and for xacro unless it may be expanded."""
        for path in text.removeprefix("@").split("+"):  # parts of one log
            self.folder.require(path, label)
            file = self.folder.path / path
            endings = {file.suffix.lower(), file.resolve().suffix.lower()}  # of a link and of its target
            if XACRO_ENDING in endings and not self.expands_xacro:
                raise ValueRangeError(f"{label} {path!r}: {_NO_XACRO}")


_NO_XACRO = "macros of xacro are not expanded by this server. Start it with --expand-xacro, or give a URDF file."


def _exit_code(exit_request: SystemExit) -> int:
    """Exit code of a process that ends so: 0 without a code, 1 for a text."""
    if isinstance(exit_request.code, int):
        return exit_request.code
    return 0 if exit_request.code is None else 1


def _property_of(parameter: click.Parameter) -> str:
    """Name of the property of an argument or option."""
    if isinstance(parameter, click.Argument):
        name = (parameter.metavar or str(parameter.name)).strip("[].").lower()
        return "logs" if name == "log" else name
    return parameter.opts[0].removeprefix("--")


def _schema(parameter: click.Parameter) -> dict[str, Any]:
    """Type and description of an argument or option."""
    if isinstance(parameter, click.Argument):
        schema: dict[str, Any] = {"type": "string"}
        if parameter.nargs == -1:
            schema = {"type": "array", "items": schema}
        name = (parameter.metavar or "").strip("[].")
        if name != "ROBOT":  # which the instructions of the server explain
            schema["description"] = _clause(MEANINGS[name])
        return schema
    assert isinstance(parameter, click.Option)
    text = _clause(parameter.help or "")
    if parameter.metavar and parameter.metavar not in _PLAIN_PLACEHOLDERS:
        text = f"{parameter.metavar}: {text}"
    if parameter.is_flag and not parameter.metavar:
        return {"type": "boolean", "description": text}
    if isinstance(parameter.type, click.Choice):
        schema = {"enum": list(parameter.type.choices)}
    else:
        is_number = parameter.type in (click.FLOAT, click.INT) or isinstance(parameter.type, Seconds)
        schema = {"type": "number" if is_number else "string"}
    is_per_joint = "JOINT=VALUE" in (parameter.metavar or "")
    if parameter.multiple and is_per_joint:
        schema = {"type": "array", "items": schema}
    return {**schema, "description": text}


_MAX_CLAUSE_LENGTH = 48
"""Largest description of a property [characters]: every conversation of the assistant begins with all of them."""


def _first_sentence(text: str) -> str:
    """First sentence, or its first clause, in one line without a full stop."""
    line = " ".join(text.split())
    # Ends of the clause: ; or : or a full stop before a blank, and the default that click appends.
    first_part, *_ = re.split(r"[;:]\s|\.\s|  ?\[default", line)
    return first_part.rstrip(".")


def _clause(text: str) -> str:
    """First clause of a text, cut after a whole word if it is long."""
    clause = _first_sentence(text)
    if len(clause) > _MAX_CLAUSE_LENGTH:
        clause = clause.split(", ")[0]
    if len(clause) > _MAX_CLAUSE_LENGTH:
        whole_words, _, _ = clause[:_MAX_CLAUSE_LENGTH].rpartition(" ")
        clause = f"{whole_words}…"
    return clause


def _option_words(parameter: click.Parameter, name: str, value: Any) -> list[str]:
    """Words of an option with a value; empty for a flag that is false."""
    flag = parameter.opts[0]
    if isinstance(value, bool):
        if not getattr(parameter, "is_flag", False):
            raise ValueRangeError(f"{name} is {value}. Give a text or a number.")
        return [flag] if value else []
    return [f"{flag}={text}" for text in _texts(name, value, several=parameter.multiple)]


def _texts(name: str, value: Any, *, several: bool) -> list[str]:
    """Texts of a number, a text or a list, as options and arguments take them.

    Numbers of a list are the components of one vector. Texts of a list are one text, unless ``several`` are allowed.
    """
    if isinstance(value, str):
        return [value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [repr(value)]
    if isinstance(value, list):
        if value and all(isinstance(item, int | float) for item in value):
            return [",".join(map(repr, value))]
        if all(isinstance(item, str) for item in value):
            return value if several else [",".join(value)]
    raise ValueRangeError(
        f"{name} is {str(value)[:_MAX_QUOTE_LENGTH]!r}. Give a text, a number, or a list of one of them."
    )


def _more_option_words(text: Any) -> list[str]:
    """Words of the options in the property ``more``."""
    if not isinstance(text, str):
        raise ValueRangeError(
            f"{_MORE_PROPERTY} is {str(text)[:_MAX_QUOTE_LENGTH]!r}. Give options as in the shell, for example '--tip tool0'."
        )
    try:
        words = shlex.split(text)
    except ValueError as problem:
        raise ValueRangeError(
            f"{_MORE_PROPERTY} {text[:_MAX_QUOTE_LENGTH]!r}: {problem}. Close the quotation."
        ) from None
    if "--" in words:
        raise ValueRangeError(
            f"{_MORE_PROPERTY} {text[:_MAX_QUOTE_LENGTH]!r} has '--', after which no options follow. Leave it out."
        )
    return words


def _texts_in(value: Any) -> Iterator[str]:
    """Texts in a parsed value, which may be nested."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _texts_in(item)


def _result(text: str) -> ToolResult:
    """Result of a command's output: its JSON with the verdict first, or its text, such as help, unchanged."""
    try:
        data = json.loads(text)
    except ValueError:  # not JSON
        return ToolResult(text, is_error=False)
    first_entries = {key: data[key] for key in ("verdict", "sentences") if key in data}
    result_text = json.dumps({**first_entries, **data}, ensure_ascii=False, separators=(",", ":"))
    if len(result_text) > _MAX_RESULT_LENGTH:
        return ToolResult(
            f"error: the result has {len(result_text):,} characters; at most {_MAX_RESULT_LENGTH:,} are sent. Write a file "
            "instead, with --csv OUT.csv or --report OUT.html in `more`, or give fewer motions.",
            is_error=True,
        )
    return ToolResult(result_text, is_error=False)


def server_instructions(folder: Path) -> str:
    """Text that an assistant reads once about all tools."""
    return (
        f"Dynamics of robots from their files. Paths are relative to {str(folder)!r}; robots are also known by name, such as "
        "ur5, and 'demo' is a bundled motion. Units are SI and radians. Results begin with the verdict: OK, OVER LIMIT, "
        "COLLISION, UNSURE or LOOK AGAIN, and its sentences; UNSURE comes with its remedy. `more` has further options as in "
        "the shell, for example '--degrees --tip tool0'; '--help' lists them."
    )
