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
"""Commands, and their arguments and options that have a property of their own."""
_MORE = "more"
_NEVER = {"file_json": "it is the answer", "workers": "it starts processes", "scheduler": "it opens connections"}
"""Options that no tool has, and why."""
_FILES = re.compile(r"FILE|FOLDER|DIR|LOG|MOTION|OUT|ROBOT")
"""Placeholders of options and arguments that name files."""
_PLAIN = ("VALUE", "NAME", "FRAME", "N", "SECONDS", "CELSIUS", "OUT", "LOG")
"""Placeholders that add nothing to the name of their option."""
_MAX_RESULT = 200_000
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
        found = main.get_command(click.Context(main), self.name)
        assert found is not None, self.name
        return found

    @cached_property
    def parameters(self) -> dict[str, click.Parameter]:
        """Arguments and options by property."""
        known = {_property_of(parameter): parameter for parameter in self.command.params}
        return {name: known[name] for name in self.properties}

    def description(self) -> dict[str, Any]:
        """Name, purpose and schema of the arguments."""
        properties, required = {}, []
        for name, parameter in self.parameters.items():
            properties[name] = _schema(parameter)
            if isinstance(parameter, click.Argument):
                required.append(name)
        properties[_MORE] = {"type": "string"}
        schema = {"type": "object", "properties": properties, "required": required}
        return {"name": self.name, "description": _first_sentence(self.command.help or ""), "inputSchema": schema}

    def words(self, arguments: Mapping[str, Any]) -> list[str]:
        """Words of the command line without the command; raises for an unknown argument or a value that is not one."""
        options, positional = list[str](), list[str]()
        for name, value in arguments.items():
            if name != _MORE and name not in self.parameters:
                raise UnknownNameError.from_choices("argument", name, [*self.parameters, _MORE])
            if name != _MORE and isinstance(self.parameters[name], click.Option):
                options += _option_words(self.parameters[name], name, value)
        for name, parameter in self.parameters.items():
            if isinstance(parameter, click.Argument) and name in arguments:
                positional += _texts(name, arguments[name], several=parameter.nargs == -1)
        return [*options, *_more(arguments.get(_MORE, "")), "--", *positional]


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
        output, notes = io.StringIO(), io.StringIO()
        with redirect_stdout(output), redirect_stderr(notes):
            try:
                main.main([name, "--json=-", *words], prog_name="twistwrench")
                code = 0
            except SystemExit as ended:
                code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        if code not in (ExitCode.FINE, ExitCode.NO):
            return ToolResult(notes.getvalue().strip() or f"exit code {code}", is_error=True)
        return _result(output.getvalue())

    def _check(self, tool: Tool, words: list[str]) -> None:
        """Raise for options that no tool has, and for files outside the folder."""
        context = click.Context(tool.command, info_name=tool.name)
        given, _, _ = tool.command.make_parser(context).parse_args(list(words))
        for parameter in tool.command.params:
            value = given.get(str(parameter.name))
            if value is None or not isinstance(value, str | list | tuple):
                continue
            label = parameter.opts[0]
            if isinstance(parameter, click.Argument):
                label = str(parameter.metavar or parameter.name)
            if parameter.name in _NEVER:
                raise ValueRangeError(
                    f"{label} is not an option of this server: {_NEVER[str(parameter.name)]}. Leave it out."
                )
            if parameter.name == "xacro" and not self.expands_xacro:
                raise ValueRangeError(f"{label}: {_NO_XACRO}")
            if _FILES.search(parameter.metavar or ""):
                for text in _flat(value):
                    self._check_file(text, label)

    def _check_file(self, text: str, label: str) -> None:
        for path in text.removeprefix("@").split("+"):  # parts of one log
            self.folder.require(path, label)
            place = self.folder.path / path
            endings = {one.suffix.lower() for one in (place, place.resolve())}
            if XACRO_ENDING in endings and not self.expands_xacro:
                raise ValueRangeError(f"{label} {path!r}: {_NO_XACRO}")


_NO_XACRO = "macros of xacro are not expanded by this server. Start it with --expand-xacro, or give a URDF file."


def _property_of(parameter: click.Parameter) -> str:
    """Name of the property of an argument or option."""
    if isinstance(parameter, click.Argument):
        name = (parameter.metavar or str(parameter.name)).strip("[].").lower()
        return {"log": "logs"}.get(name, name)
    return parameter.opts[0].removeprefix("--")


def _schema(parameter: click.Parameter) -> dict[str, Any]:
    """Type and description of an argument or option."""
    if isinstance(parameter, click.Argument):
        kind: dict[str, Any] = {"type": "string"}
        if parameter.nargs == -1:
            kind = {"type": "array", "items": kind}
        name = (parameter.metavar or "").strip("[].")
        if name != "ROBOT":
            kind["description"] = _clause(MEANINGS[name])
        return kind
    assert isinstance(parameter, click.Option)
    text = _clause(parameter.help or "")
    if parameter.metavar and parameter.metavar not in _PLAIN:
        text = f"{parameter.metavar}: {text}"
    if parameter.is_flag and not parameter.metavar:
        return {"type": "boolean", "description": text}
    if isinstance(parameter.type, click.Choice):
        kind = {"enum": list(parameter.type.choices)}
    else:
        is_number = parameter.type in (click.FLOAT, click.INT) or isinstance(parameter.type, Seconds)
        kind = {"type": "number" if is_number else "string"}
    if parameter.multiple and "JOINT=VALUE" in (parameter.metavar or ""):  # of one joint each
        kind = {"type": "array", "items": kind}
    return {**kind, "description": text}


_MAX_CLAUSE = 48
"""Largest description of a property [characters]: every conversation of the assistant begins with all of them."""


def _first_sentence(text: str) -> str:
    """First sentence, or its first clause, in one line without a full stop."""
    return re.split(r"[;:]\s|\.\s|  ?\[default", " ".join(text.split()))[0].rstrip(".")


def _clause(text: str) -> str:
    """First clause, cut at a word."""
    clause = _first_sentence(text)
    if len(clause) > _MAX_CLAUSE:
        clause = clause.split(", ")[0]
    if len(clause) > _MAX_CLAUSE:
        clause = f"{clause[:_MAX_CLAUSE].rpartition(' ')[0]}…"
    return clause


def _option_words(parameter: click.Parameter, name: str, value: Any) -> list[str]:
    """Words of an option."""
    flag = parameter.opts[0]
    if isinstance(value, bool):
        if not getattr(parameter, "is_flag", False):
            raise ValueRangeError(f"{name} is {value}. Give a text or a number.")
        return [flag] if value else []
    return [f"{flag}={text}" for text in _texts(name, value, several=parameter.multiple)]


def _texts(name: str, value: Any, *, several: bool) -> list[str]:
    """Texts of a value: of a number, of a text, of a list; numbers of a list are the components of one vector."""
    if isinstance(value, str):
        return [value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return [repr(value)]
    if isinstance(value, list) and value and all(isinstance(one, int | float) for one in value):
        return [",".join(map(repr, value))]
    if isinstance(value, list) and all(isinstance(one, str) for one in value):
        return value if several else [",".join(value)]
    raise ValueRangeError(f"{name} is {str(value)[:80]!r}. Give a text, a number, or a list of one of them.")


def _more(text: Any) -> list[str]:
    """Words of further options."""
    if not isinstance(text, str):
        raise ValueRangeError(
            f"{_MORE} is {str(text)[:80]!r}. Give options as in the shell, for example '--tip tool0'."
        )
    try:
        words = shlex.split(text)
    except ValueError as problem:
        raise ValueRangeError(f"{_MORE} {text[:80]!r}: {problem}. Close the quotation.") from None
    if "--" in words:
        raise ValueRangeError(f"{_MORE} {text[:80]!r} has '--', after which no options follow. Leave it out.")
    return words


def _flat(value: Any) -> Iterator[str]:
    """Texts of a raw value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _flat(each)


def _result(text: str) -> ToolResult:
    """Result with the verdict first; help is text."""
    try:
        data = json.loads(text)
    except ValueError:
        return ToolResult(text, is_error=False)
    first = {key: data[key] for key in ("verdict", "sentences") if key in data}
    shown = json.dumps({**first, **data}, ensure_ascii=False, separators=(",", ":"))
    if len(shown) > _MAX_RESULT:
        return ToolResult(
            f"error: the result has {len(shown):,} characters; at most {_MAX_RESULT:,} are sent. Write a file instead, with "
            "--csv OUT.csv or --report OUT.html in `more`, or give fewer motions.",
            is_error=True,
        )
    return ToolResult(shown, is_error=False)


def server_instructions(folder: Path) -> str:
    """Text that an assistant reads once about all tools."""
    return (
        f"Dynamics of robots from their files. Paths are relative to {str(folder)!r}; robots are also known by name, such as "
        "ur5, and 'demo' is a bundled motion. Units are SI and radians. Results begin with the verdict: OK, OVER LIMIT, "
        "COLLISION, UNSURE or LOOK AGAIN, and its sentences; UNSURE comes with its remedy. `more` has further options as in "
        "the shell, for example '--degrees --tip tool0'; '--help' lists them."
    )
