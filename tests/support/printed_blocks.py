"""Blocks of a report as a console of some width prints them."""

from rich.console import Console, Group

from twistwrench.core.answers.terminal import renderable


def printed(blocks, width):
    output = Console(width=width)
    return Group(*(renderable(block, output) for block in blocks))
