"""Blocks of a report as a console of some width prints them."""

from rich.console import Group

from twistwrench.cli.terminal import rendered


def printed(blocks, width):
    return Group(*(rendered(block, width) for block in blocks))
