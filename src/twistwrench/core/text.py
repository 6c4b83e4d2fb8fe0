"""Lists of names in a sentence, cut short if they are long."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

MOST = 12
"""Default number of listed names."""


_LONGEST = 200
"""Maximum number of quoted characters from foreign text in a message."""
_QUOTED = "|".join(rf"(?<!\w){q}(?:[^{q}\\]|\\.){{{_LONGEST}}}(?:[^{q}\\]|\\.)+{q}" for q in "'\"")
"""Text between quotation marks as written by repr; an apostrophe does not start one."""


def clipped(text: str) -> str:
    """Text from another author's file, shortened for messages."""
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def with_clipped_quotations(message: str) -> str:
    """Message with long quotations shortened.

    >>> len(with_clipped_quotations(f"link {'a' * 1000!r} is not there"))
    221
    """
    return re.sub(_QUOTED, lambda found: f"{found[0][: _LONGEST + 1]}…{found[0][-1]}", message)


_LONGEST_MESSAGE = 1000
"""Maximum number of characters of a message about a file."""


def bounded_message(message: str) -> str:
    """Message about another author's file with long quotations shortened, and cut if it is still long.

    >>> len(bounded_message(f"link {'a' * 1000!r} is not there")), len(bounded_message("a mass, " * 1000))
    (221, 1001)
    """
    text = with_clipped_quotations(message)
    return text if len(text) <= _LONGEST_MESSAGE else f"{text[:_LONGEST_MESSAGE]}…"


class ReadingNote(str):
    """A note on how a file was read, such as the columns that were matched; a short report only counts it."""

    __slots__ = ()


def listed(items: Iterable[object], most: int = MOST, between: str = ", ") -> str:
    r"""The first items, and the number of further ones; tabs and line ends in names become escapes.

    >>> listed(["elbow", "wrist"]), listed("abcde", 2), listed("abcde", 2, "; ")
    ('elbow, wrist', 'a, b and 3 more', 'a; b; and 3 more')
    >>> print(listed(["elbow\twrist"]))
    elbow\twrist
    """
    texts = [clipped(str(item)).replace("\t", r"\t").replace("\n", r"\n") for item in items]
    more = len(texts) - most
    tail = f"{between.rstrip().strip(',')} and {more} more" if more > 0 else ""
    return between.join(texts[:most]) + tail


def text_width(text: str) -> int:
    """Width in terminal columns; combining dots have none.

    >>> text_width("q̇ = 1")
    5
    """
    return sum(not unicodedata.combining(character) for character in text)


_UNSEEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def visible(text: str) -> str:
    r"""Text with control and bidirectional formatting characters as escapes; line ends and tabs are kept.

    >>> print(visible("joint\x1b[2J \u202e1"))
    joint\x1b[2J \u202e1
    """
    return _UNSEEN.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
