"""The files of ``twistwrench identify``: what was found as JSON, pictures and tables, and the robot's own file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from ..verdict import Word

if TYPE_CHECKING:
    from ..identification import IdentifiedRobot


class AskedFiles(NamedTuple):
    """The files that are asked for, and how near to the file bodies are held; None: none, chosen."""

    json: str | None
    plot: str | Path | None
    report: str | None
    robot: str | None
    actuators: str | None
    csv: str | None
    strength: float | None

    def write(
        self,
        found: IdentifiedRobot,
        logs: Sequence[str],
        given: dict[str, Any] | None,
        *,
        essential: bool,
        force: bool,
    ) -> None:
        """Write them and say so; after LOOK AGAIN only JSON and pictures, unless ``force``. ``given``: actuators to keep."""
        if self.json is not None:
            _write_text(found.to_json(essential=essential), self.json)
        if self.plot is not None:
            click.echo(f"wrote {found.plot(self.plot)}")
        if self.report is not None:
            click.echo(f"wrote {found.report(self.report)}")
        if not any((self.robot, self.actuators, self.csv)):
            return
        if found.verdict.word is Word.LOOK_AGAIN and not force:
            click.echo("nothing else is written after LOOK AGAIN; --force writes all the same.", err=True)
            return
        if self.robot is not None or self.actuators is not None:
            if self.strength is not None:
                found.__dict__["consistent"] = found.consistent_at(self.strength)
            for note in found.write(self.robot, self.actuators, given=given, logs=logs, force=force):
                click.echo(f"note: {note}", err=True)
            for path in filter(None, (self.robot, self.actuators)):
                click.echo(f"wrote {path}")
        if self.csv is not None:
            _write_table(found, self.csv)


def _write_text(text: str, path: str | Path) -> None:
    from ..outputs import replacing

    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
    click.echo(f"wrote {path}")


def _write_table(found: IdentifiedRobot, path: str | Path) -> None:
    from ..core.csv_writer import CsvWriter
    from ..outputs import replacing

    with replacing(path) as scratch, scratch.open("wb") as file:
        writer = CsvWriter(file)
        writer.row(["group", "value", "deviation", "low", "high", "file"])
        for name, value, deviation, (low, high), before in zip(
            found.groups, found.values, found.standard_deviations, found.interval(), found.prior.mean, strict=True
        ):
            writer.row([name, *map(float, (value, deviation, low, high, before))])
    click.echo(f"wrote {path}")
