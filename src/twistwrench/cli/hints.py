"""Hints of usage errors: what to type in place of an unknown command or option, and for a missing argument."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click

from ..core.arguments import read_quantity
from ..core.errors import ValueRangeError

_ROBOT_ENDINGS = (".urdf", ".xml", ".mjcf", ".sdf", ".world", ".usd", ".usda", ".usdc", ".xacro")
"""Endings of files of robots."""
MEANINGS = {
    "ROBOT": "a file, or a name that `twistwrench robots` lists",
    "MOTION": "a log or plan, or 'demo'",
    "LOG": "a log, or several",
    "FILE": "a log, or several",
    "OUT": "a file, whose ending names the format",
}
"""Meaning of arguments, by metavar without dots and brackets."""


class Seconds(click.ParamType):  # type: ignore[type-arg]  # generic in new versions
    """Number of seconds, with or without unit: ``5``, ``5s``, ``500 ms``, ``2 min``."""

    name = "seconds"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Parse the text; raises UsageError with the units."""
        option = param.opts[0] if param else "duration"
        try:
            return read_quantity(str(value), option, "s")
        except ValueRangeError as error:
            raise click.UsageError(str(error), ctx) from None


def unknown_command(word: str, known: Iterable[str]) -> str:
    """Sentence on a command that does not exist: the robot's commands, the command of another name, or similar ones."""
    from ..core.first_calls import rows_of, similar_names

    robot_hint = _robot_hint(word)
    if robot_hint:
        return robot_hint
    text = f"No such command {word!r}."
    rows = rows_of(word, "command")
    if rows:
        replacement = rows[0].use
        verb = "Use" if replacement.startswith("twistwrench") else "In Python:"
        return f"{text} {verb} {replacement}."
    similar = similar_names(word, known)
    if similar:
        text += f" Did you mean {similar}?"
    return text


def _robot_hint(word: str) -> str:
    """Sentence with commands of a robot that stands in place of a command; empty for other words."""
    from ..robots.finding import known_robots, plain_name

    is_robot = word.lower().endswith(_ROBOT_ENDINGS) or plain_name(word) in known_robots()
    if not is_robot:
        return ""
    folder = Path(__file__).parents[1] / "robots"
    motion = "demo" if (folder / f"{plain_name(word)}_demo.csv").is_file() else "MOTION"
    return f"{word} is a robot: twistwrench info {word}, twistwrench torques {word} {motion}."


def unknown_option(error: click.NoSuchOption, typed: list[str]) -> str:
    """Sentence on an option that does not exist: the option or argument of another name, or similar options."""
    from ..core.first_calls import rows_of, similar_names

    assert error.ctx is not None
    name = error.option_name
    command_name = error.ctx.info_name
    options: set[str] = set()
    for param in error.ctx.command.params:
        options.update(param.opts, param.secondary_opts)
    text = f"No such option: {name}."
    rows = [row for row in rows_of(name, "option") if not row.only or command_name in row.only]
    rows.sort(key=lambda row: not row.only)  # rows of this command first
    for row in rows:
        first_word = row.use.split()[0]
        if first_word.startswith("-") and first_word not in options:
            continue
        robot = next((word for word in typed[1:] if not word.startswith("-")), "ROBOT")
        difference = row.differs.format(command=command_name, robot=robot, name=Path(robot).stem)
        if not row.only:
            text += f" Did you mean {row.use}?"
        if difference:
            text += f" {difference[0].upper()}{difference[1:]}."
        return text
    similar = similar_names(name, options)
    if similar:
        without_quotes = similar.replace("'", "")
        text += f" Did you mean {without_quotes}?"
    return text


def missing_parameter(error: click.MissingParameter) -> str:
    """Sentence on a missing argument with its meaning, or on a missing option."""
    name = ""
    if isinstance(error.param, click.Argument):
        name = (error.param.metavar or "").strip("[].")
    if name in MEANINGS:
        return f"Missing {name}: {MEANINGS[name]}."
    return error.format_message()
