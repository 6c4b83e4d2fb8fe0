"""Notes on a robot file, joined into one sentence where they concern several links or joints."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable

from ..core.text import listed
from ..errors import ModelWarning

_NAMED = 4
"""Subjects that a grouped sentence names; the rest are counted, and stand in ``robot.defects``."""


class ModelNote(str):
    """A sentence whose subject is known: ``ModelNote("link 'a'", "has no mass") == "link 'a' has no mass"``."""

    subject: str
    said: str

    def __new__(cls, subject: str, said: str) -> ModelNote:
        """The sentence ``subject said``."""
        text = super().__new__(cls, f"{subject} {said}")
        text.subject, text.said = subject, said
        return text

    def __reduce__(self) -> tuple[type[ModelNote], tuple[str, str]]:
        return ModelNote, (self.subject, self.said)


def grouped(remarks: Iterable[str]) -> list[str]:
    """Remarks in their order, equal ones of several subjects joined into one sentence.

    >>> grouped([ModelNote("joint 'a'", "has no limit"), "x", ModelNote("joint 'b'", "has no limit")])
    ["joint 'a' has no limit; the same of joint 'b'", 'x']
    """
    others: dict[str, list[str]] = {}
    first: list[str] = []
    for remark in remarks:
        key = remark.said if isinstance(remark, ModelNote) else remark
        if key in others and isinstance(remark, ModelNote):
            others[key].append(remark.subject)
        else:
            others.setdefault(key, [])
            first.append(remark)
    return [_together(r, others[r.said]) if isinstance(r, ModelNote) else r for r in first]


def _together(remark: ModelNote, others: list[str]) -> str:
    if not others:
        return remark
    return f"{remark}; the same of {listed(others, _NAMED)}"


def sentences(name: str, remarks: Iterable[str]) -> list[str]:
    """The warnings of a robot with such remarks."""
    return [f"robot {name!r}: {text}." for text in grouped(remarks)]


def issue(texts: Iterable[str]) -> None:
    """Issue such warnings, at the user's line."""
    for text in texts:
        warnings.warn(text, ModelWarning, stacklevel=frames_to_user())


def frames_to_user() -> int:
    """The stack level of the first caller outside this package, so that a warning points at the user's own line."""
    package = __name__.partition(".")[0]
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        level, frame = level + 1, frame.f_back
    return level
