"""Verdicts of reports, and exit codes of all commands."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from pathlib import Path
from typing import Any

from .errors import ValueRangeError

__all__ = ["ExitCode", "Reason", "Verdict", "Word"]


class ExitCode(IntEnum):
    """Exit codes of commands."""

    FINE = 0
    """Success; if the command answers a question, the answer is yes."""
    NO = 1
    """The answer is negative or unsure."""
    BAD_INPUT = 2
    """An argument, an option or a file cannot be used."""
    FAULT = 70
    """Internal error of the program, with the number in ``sysexits.h``."""
    INTERRUPTED = 130
    """Interrupted by Ctrl-C: 128 + SIGINT, as in shells."""
    PIPE_CLOSED = 141
    """128 + SIGPIPE: the program that reads the output, such as ``head``, has ended."""
    TERMINATED = 143
    """Terminated by a signal: 128 + SIGTERM."""


class Word(StrEnum):
    """First word of a report; :class:`Verdict` describes when each is given."""

    OK = "OK"
    DONE = "DONE"
    """Done, and nothing was judged."""
    UNSURE = "UNSURE"
    OVER_LIMIT = "OVER LIMIT"
    COLLISION = "COLLISION"
    CONTACT = "CONTACT"
    STOPPED = "STOPPED"
    LOOK_AGAIN = "LOOK AGAIN"


_POSITIVE = (Word.OK, Word.DONE)
"""Words of a verdict that needs no reason."""
_SEVEREST_FIRST = (Word.LOOK_AGAIN, Word.COLLISION, Word.OVER_LIMIT, Word.UNSURE, Word.OK, Word.DONE)
"""Words of verdicts that can be joined, in order of severity."""


class Reason(str):
    """Reason of a verdict, whose text ends with a remedy; the remedy is an attribute too.

    Examples
    --------
    >>> verdict = Verdict.from_reasons(unsure=[Reason("no limits are known; give them", "give them")])
    >>> str(verdict), verdict.remedies
    ('UNSURE: no limits are known; give them', ('give them',))
    """

    remedy: str

    def __new__(cls, text: str, remedy: str = "") -> Reason:
        """Reason with its whole text, and the remedy in it."""
        reason = super().__new__(cls, text)
        reason.remedy = remedy
        return reason

    def __reduce__(self) -> tuple[type[Reason], tuple[str, str]]:
        return type(self), (str(self), self.remedy)


@dataclass(frozen=True)
class Verdict:
    """Answer of a report: one word and its reasons.

    Parameters
    ----------
    word
        OK only without any reason against it. DONE if nothing was judged. UNSURE if the data do not determine the answer.
        OVER LIMIT if a limit is certainly exceeded. COLLISION if two links touch, by the distance of their shapes. CONTACT
        if a sensor measures more than its load. STOPPED if a motion ended early. LOOK AGAIN if the input contradicts
        itself, so that no number of the report is reliable.
    reasons
        A sentence for each reason against OK. Only OK and DONE may have none.

    Raises
    ------
    ValueError
        For a verdict other than OK and DONE without a reason.

    Examples
    --------
    >>> verdict = Verdict.from_reasons(over=[], unsure=["elbow: noise alone may exceed the limit"])
    >>> print(verdict)
    UNSURE: elbow: noise alone may exceed the limit
    >>> verdict.exit_code
    <ExitCode.NO: 1>
    """

    word: Word
    reasons: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.word not in _POSITIVE and not self.reasons:
            raise ValueError(f"the verdict {self.word} needs a reason")

    @classmethod
    def from_reasons(
        cls,
        *,
        look_again: list[str] | None = None,
        collision: list[str] | None = None,
        over: list[str] | None = None,
        unsure: list[str] | None = None,
    ) -> Verdict:
        """Verdict from reasons, in order of severity: contradictory input, collisions, exceeded limits, doubts.

        Parameters
        ----------
        look_again : list of str, optional, contradictions in the input
        collision : list of str, optional, contacts between links
        over : list of str, optional, limits that are certainly exceeded
        unsure : list of str, optional, questions that the data leave open

        Returns
        -------
        verdict : Verdict
        """
        reasons_by_word = {  # the most severe first
            Word.LOOK_AGAIN: look_again,
            Word.COLLISION: collision,
            Word.OVER_LIMIT: over,
            Word.UNSURE: unsure,
        }
        for word, reasons in reasons_by_word.items():
            if reasons:
                return cls(word, tuple(reasons))
        return cls(Word.OK)

    def joined(self, other: Verdict) -> Verdict:
        """Verdict on two questions: the more severe verdict; if both have one word, that word with the reasons of both.

        Parameters
        ----------
        other : Verdict

        Returns
        -------
        verdict : Verdict

        Examples
        --------
        >>> print(Verdict(Word.UNSURE, ("a",)).joined(Verdict(Word.COLLISION, ("b",))))
        COLLISION: b
        >>> print(Verdict(Word.UNSURE, ("a",)).joined(Verdict(Word.UNSURE, ("b",))))
        UNSURE: a; b
        """
        if self.word is other.word:
            return Verdict(self.word, self.reasons + other.reasons)
        return min((self, other), key=lambda verdict: _SEVEREST_FIRST.index(verdict.word))

    @property
    def ok(self) -> bool:
        """True if the answer is OK, or the work is done and nothing was judged."""
        return self.word in _POSITIVE

    @property
    def remedies(self) -> tuple[str, ...]:
        """Remedies of the reasons, each once; empty if no remedy is known."""
        remedies = [reason.remedy for reason in self.reasons if isinstance(reason, Reason) and reason.remedy]
        return tuple(dict.fromkeys(remedies))  # without repetitions, in their order

    @property
    def exit_code(self) -> ExitCode:
        """Exit code of a command with this verdict."""
        if self.ok:
            return ExitCode.FINE
        return ExitCode.NO

    def __str__(self) -> str:
        if self.reasons:
            return f"{self.word}: {'; '.join(self.reasons)}"
        return str(self.word)


def refuse_to_write(verdict: Verdict, remedy: str) -> None:
    """Raise ValueRangeError with the verdict and a remedy if it is LOOK AGAIN: such a result is not written."""
    if verdict.word is Word.LOOK_AGAIN:
        raise ValueRangeError(f"nothing is written after {str(verdict).removesuffix('.')}. {remedy}")


# ── Ctrl-C during the import of the package: the command ends without a traceback, as it does later


_STANDARD_ERROR = 2  # file descriptor


def end_at_once(*_: Any) -> None:
    """End the process immediately, as a handler of signals; no work is lost."""
    os.write(_STANDARD_ERROR, b"interrupted\n")
    os._exit(ExitCode.INTERRUPTED)


def _is_command() -> bool:
    """True if the process is the command ``twistwrench``, False for a program that imports the library."""
    arguments = getattr(sys, "argv", None) or [""]  # embedded interpreters may have none
    program = arguments[0]
    if program == "-m":  # sys.argv while Python looks for the module
        command_line = " ".join(sys.orig_argv)
        return " -m twistwrench " in f" {command_line} "  # also at its end
    return Path(program).name in ("twistwrench", "twistwrench.exe")


if _is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    with contextlib.suppress(ValueError):  # fails outside the main thread
        signal.signal(signal.SIGINT, end_at_once)
