"""How the shell speaks: usage errors in one line, and the library's sentences in words of options."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

__all__ = ["Commands", "in_shell_words"]

_SHELL_WORDS = (
    # The library speaks Python; the shell's user knows options.
    (r"\bPass frame=…, or load with tip=…", "Name one with --tip FRAME"),
    (r"\b(inertia|mimic|sign|symbols|form)='(\w+)'", r"--\1 \2"),
    (r"\b(orientation|inertia|drift|delay|tilt)=True", r"--\1"),
    (r"\bprecision='double'", "without --float"),
    (r"\btest=False", "--no-test"),
    (r"\bprefix='([^']*)'", r"--prefix '\1'"),
    (r"\bfloating_base=True", "--floating-base"),
    (r"\b(limits|tip|lock|frame)=(?:…|(?=[\s.,;]))", r"--\1"),
)


class Commands(click.Group):
    """Commands whose usage errors are one line, as all other errors are."""

    def make_context(self, *args: Any, **options: Any) -> click.Context:
        """Parse, with usage errors in one line."""
        with _short_usage():
            return super().make_context(*args, **options)

    def invoke(self, ctx: click.Context) -> Any:
        """Run, with usage errors in one line."""
        with _short_usage():
            return super().invoke(ctx)


class _UsageLine(click.ClickException):
    exit_code = 2

    def show(self, file: Any = None) -> None:
        click.echo(f"error: {self.message}", file=file, err=True)


@contextmanager
def _short_usage() -> Iterator[None]:
    try:
        yield
    except click.exceptions.NoArgsIsHelpError:
        raise
    except click.UsageError as error:
        where = f" See {error.ctx.command_path} --help." if error.ctx else ""
        raise _UsageLine(" ".join(error.format_message().split()) + where) from None


def in_shell_words(text: str) -> str:
    """A sentence of the library with keyword arguments as the options they are here."""
    for pattern, option in _SHELL_WORDS:
        text = re.sub(pattern, option, text)
    return text
