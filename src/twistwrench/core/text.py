"""Text of messages: lists of names, quotations, and arguments in the words of Python or of the shell."""

from __future__ import annotations

import ast
import re
import shlex
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

MAX_LISTED = 12
"""Default number of listed names."""


_MAX_QUOTATION_LENGTH = 200
"""Maximum number of quoted characters from foreign text in a message."""
_LONG_QUOTATION = "|".join(  # for either mark
    rf"(?<!\w){mark}(?:[^{mark}\\]|\\.){{{_MAX_QUOTATION_LENGTH}}}(?:[^{mark}\\]|\\.)+{mark}" for mark in "'\""
)
"""Long text between quotation marks as written by repr; an apostrophe within a word does not start one."""


def shorten(text: str) -> str:
    """Text from another author's file, cut to a length that fits a message."""
    if len(text) <= _MAX_QUOTATION_LENGTH:
        return text
    return f"{text[:_MAX_QUOTATION_LENGTH]}…"


def with_clipped_quotations(message: str) -> str:
    """Message with long quotations shortened.

    >>> len(with_clipped_quotations(f"link {'a' * 1000!r} is not there"))
    221
    """

    def shorten_quotation(match: re.Match[str]) -> str:
        quotation = match[0]
        mark = quotation[-1]
        return f"{quotation[: _MAX_QUOTATION_LENGTH + 1]}…{mark}"

    return re.sub(_LONG_QUOTATION, shorten_quotation, message)


_MAX_MESSAGE_LENGTH = 1000
"""Maximum number of characters of a message about a file."""


def bounded_message(message: str) -> str:
    """Message about another author's file with long quotations shortened, and cut if it is still long.

    >>> len(bounded_message(f"link {'a' * 1000!r} is not there")), len(bounded_message("a mass, " * 1000))
    (221, 1001)
    """
    text = with_clipped_quotations(message)
    if len(text) <= _MAX_MESSAGE_LENGTH:
        return text
    return f"{text[:_MAX_MESSAGE_LENGTH]}…"


class ReadingNote(str):
    """A note on how a file was read, such as the columns that were matched; a short report only counts it."""

    __slots__ = ()


def listed(items: Iterable[object], most: int = MAX_LISTED, between: str = ", ") -> str:
    r"""List of the first items, at most ``most``, and the number of further ones; tabs and line ends become escapes.

    >>> listed(["elbow", "wrist"]), listed("abcde", 2), listed("abcde", 2, "; ")
    ('elbow, wrist', 'a, b and 3 more', 'a; b; and 3 more')
    >>> print(listed(["elbow\twrist"]))
    elbow\twrist
    """
    texts = [shorten(str(item)).replace("\t", r"\t").replace("\n", r"\n") for item in items]
    text = between.join(texts[:most])
    if len(texts) <= most:
        return text
    mark_before_and = between.rstrip().strip(",")  # "; and", but no comma before "and"
    return f"{text}{mark_before_and} and {len(texts) - most} more"


def text_width(text: str) -> int:
    """Width of a text in terminal columns; combining characters, such as the dot of q̇, have none.

    >>> text_width("q̇ = 1")
    5
    """
    return sum(not unicodedata.combining(character) for character in text)


_CONTROL_CHARACTERS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Control characters except tab and line feed; marks of direction; separators of lines and paragraphs."""


def visible(text: str) -> str:
    r"""Text with control and bidirectional formatting characters as escapes; line ends and tabs are kept.

    >>> print(visible("joint\x1b[2J \u202e1"))
    joint\x1b[2J \u202e1
    """
    return _CONTROL_CHARACTERS.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


# ── Arguments in a message: ``limits="limits.csv"`` in Python, ``--limits limits.csv`` in the shell


class Placeholder(str):
    """Word that stands for a value in a message, such as HZ or COLUMN; it is not quoted."""

    __slots__ = ()


@dataclass(frozen=True)
class Argument:
    """Argument of a function in a message, and the option of a command that does the same."""

    name: str
    value: object = ...
    """Value to give; ``...`` for the name alone; None if ``name`` is a function, for which a command has an option."""
    option: str = ""
    """Name of the option; empty if it is the name of the argument."""
    alone: bool = False
    """True if the option has no value, because its name includes the value."""


_IN_COMMAND: ContextVar[bool] = ContextVar("of_command", default=False)
"""True while a command runs."""


@contextmanager
def words_of_the_shell() -> Iterator[None]:
    """Context in which a command runs: messages name options in place of arguments.

    >>> with words_of_the_shell():
    ...     print(spell(Argument("inertia", True, option="with-inertia")))
    --with-inertia
    """
    token = _IN_COMMAND.set(True)
    try:
        yield
    finally:
        _IN_COMMAND.reset(token)


def spell(argument: Argument, *, shell: bool | None = None) -> str:
    """Argument as it is typed in Python, or as an option in the shell; None means the shell while a command runs.

    >>> arguments = Argument("lock", {"a": 0, "b c": 0}), Argument("friction", False), Argument("rate", Placeholder("HZ"))
    >>> for argument in arguments:
    ...     print(spell(argument), "|", spell(argument, shell=True))
    lock={'a': 0, 'b c': 0} | --lock 'a=0,b c=0'
    friction=False | --no-friction
    rate=HZ | --rate HZ
    """
    if shell is None:
        shell = _IN_COMMAND.get()
    if shell:
        return _option_text(argument)
    return _python_text(argument)


def _python_text(argument: Argument) -> str:
    """Argument as it is typed in Python."""
    value = argument.value
    if value is None:
        return argument.name
    if value is ...:
        return f"{argument.name}=…"
    if isinstance(value, Placeholder):
        return f"{argument.name}={value}"
    return f"{argument.name}={value!r}"


def _option_text(argument: Argument) -> str:
    """Argument as an option in the shell."""
    value = argument.value
    name = argument.option or argument.name.replace("_", "-")
    if value is False and not argument.option:
        return f"--no-{name}"
    has_no_value = value is ... or value is None or isinstance(value, bool)
    if has_no_value or argument.alone:
        return f"--{name}"
    if isinstance(value, Mapping):
        entry_texts = []
        for key, entry in value.items():
            entry_text = quote_name(str(entry))
            entry_texts.append(f"{quote_name(key)}={entry_text}")
        text = ",".join(entry_texts)
        has_words = any(isinstance(entry, str) for entry in value.values())
        if has_words and "'" not in text:  # quoted even if the shell would not need it
            return f"--{name} '{text}'"
        return f"--{name} {shlex.quote(text)}"
    parts = value if isinstance(value, tuple) else (value,)  # a tuple is several words of the shell
    words = [part if isinstance(part, Placeholder) else shlex.quote(str(part)) for part in parts]
    return " ".join([f"--{name}", *words])


def argument(name: str, value: object = ..., *, option: str = "") -> str:
    """Text of an argument as the caller types it: an argument of a function or, while a command runs, its option.

    >>> argument("tip"), argument("inertia", "repair")
    ('tip=…', "inertia='repair'")
    """
    return spell(Argument(name, value, option))


def quote_name(name: str) -> str:
    """Name in a list of the shell. It is quoted as in CSV if it begins with @, or has a comma, equals sign or quote.

    >>> quote_name("a"), quote_name("a, b")
    ('a', '"a, b"')
    """
    if name.startswith("@") or any(character in name for character in ',="'):
        return '"' + name.replace('"', '""') + '"'
    return name


_ARGUMENT_IN_TEMPLATE = re.compile(r"<(\w+)=([^<>|]+)(?:\|([\w-]+))?>")
"""Argument in a template: its groups are name, value and option."""


def spell_out(template: str) -> str:
    """Template with its arguments, ``<name=value>`` or ``<name=value|option>``, as the caller types them.

    >>> spell_out("with <friction=False> or <inertia=True|with-inertia>")
    'with friction=False or inertia=True'
    """

    def replacement(match: re.Match[str]) -> str:
        name, literal, option = match.groups("")
        value = ast.literal_eval(literal)
        if isinstance(value, str):  # it may contain fields {…}, which are filled later
            if in_the_shell():
                value = Placeholder(value)
            return spell(Argument(name, value, option))
        text = spell(Argument(name, value, option))
        return text.replace("{", "{{").replace("}", "}}")  # its braces are not fields

    return _ARGUMENT_IN_TEMPLATE.sub(replacement, template)


def in_the_shell() -> bool:
    """True while a command runs: messages name options and commands in place of arguments and functions."""
    return _IN_COMMAND.get()


def with_arguments(text: str, arguments: Sequence[Argument], *, shell: bool | None = None) -> str:
    """Text with arguments in place of ``{0}``, ``{1}`` and so on.

    >>> with_arguments("Choose one: {0}.", [Argument("episode", 3)], shell=True)
    'Choose one: --episode 3.'
    """
    for k, argument in enumerate(arguments):
        text = text.replace(f"{{{k}}}", spell(argument, shell=shell))
    return text
