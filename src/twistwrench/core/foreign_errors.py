"""Errors of parsers and other libraries, turned into errors of this one: the one place where readers do so."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..errors import TwistWrenchError

_LONGEST = 200
"""Characters of another library's message that are worth showing."""


@contextmanager
def foreign_errors(error_of: Callable[[str], TwistWrenchError]) -> Iterator[None]:
    """Turn whatever the block raises into one error of the library; errors that are its own already pass as they are.

    For blocks that hand somebody else's bytes to somebody else's parser, and for nothing more: a mistake of our own in such
    a block would be called a mistake of the file. ``KeyboardInterrupt`` and ``SystemExit`` pass.

    Parameters
    ----------
    error_of
        Makes the error, from the reason in words.

    Raises
    ------
    TwistWrenchError
        What ``error_of`` returns, with the foreign error as its cause.

    Examples
    --------
    >>> from twistwrench.errors import ModelError
    >>> with foreign_errors(lambda reason: ModelError(f"the file cannot be read: {reason}.")):
    ...     float("four")
    Traceback (most recent call last):
    twistwrench.errors.ModelError: the file cannot be read: ValueError: could not convert string to float: 'four'.
    """
    try:
        yield
    except TwistWrenchError:
        raise
    except Exception as problem:
        raise error_of(reason_of(problem)) from problem


def reason_of(problem: Exception) -> str:
    """Why, in one line without a stop: what the system says of files, else the kind of the error and its message.

    >>> reason_of(RecursionError("maximum recursion depth exceeded"))
    'its entries are nested too deeply'
    """
    if isinstance(problem, RecursionError):
        return "its entries are nested too deeply"
    if isinstance(problem, MemoryError):
        return "it asks for more memory than there is"
    if isinstance(problem, OSError) and problem.strerror:
        return problem.strerror
    text = " ".join(str(problem).split()).rstrip(".")
    kind = type(problem).__name__
    return f"{kind}: {text[:_LONGEST]}{'…' * (len(text) > _LONGEST)}" if text else kind
