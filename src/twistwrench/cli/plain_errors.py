"""How errors and warnings of the library end a command: a line each, and an exit code."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import click

from ..errors import ModelWarning, TwistWrenchError
from ..verdict import ExitCode
from .usage import in_shell_words


@contextmanager
def plain_errors() -> Iterator[None]:
    """Errors of the library end the program with one line on stderr; its warnings are a line each."""
    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # what it logs of broken meshes, our errors say
    with warnings.catch_warnings():
        warnings.simplefilter("always", ModelWarning)
        warnings.showwarning = lambda message, *_args, **_rest: click.echo(
            f"note: {in_shell_words(str(message))}", err=True
        )
        try:
            yield
        except TwistWrenchError as error:
            click.echo(f"error: {' '.join(in_shell_words(str(error)).split())}", err=True)
            sys.exit(ExitCode.BAD_INPUT)
