"""What ``--help`` shows: a command's own options, then those that say how the robot is read."""

from __future__ import annotations

import click


class RobotOption(click.Option):
    """An option that says how the robot is read: one that all commands share."""


class OwnOptionsFirst(click.Command):
    """A command whose help lists its own options before those of the robot."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write them in two sections."""
        records = [(p, p.get_help_record(ctx)) for p in self.get_params(ctx) if isinstance(p, click.Option)]
        own = [record for param, record in records if record and not isinstance(param, RobotOption)]
        shared = [record for param, record in records if record and isinstance(param, RobotOption)]
        for title, rows in (("Options", own), ("How the robot is read", shared)):
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)
