"""The command ``twistwrench sensor compensate``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from .command_texts import about
from .sensor_options import (
    CSV,
    GRAVITY_OPTION,
    PLOT,
    read_readings,
    sensor_command,
    sensor_path_of,
    tell,
    write_readings,
)

if TYPE_CHECKING:
    from rich.console import Console


@click.command("compensate", **about("sensor compensate"))
@click.argument("log", metavar="LOG")
@click.option(
    "--sensor", "sensor_path", metavar="SENSOR.json", required=True, help="From `identify --save`; or 'demo'."
)
@GRAVITY_OPTION
@click.option(
    "--contacts",
    "false_alarms",
    metavar="RATE",
    type=float,
    help="Look for contacts, with at most this share of readings called one by noise (1e-6).",
)
@CSV
@PLOT
@sensor_command
def compensate_command(
    *,
    console: Console,
    log: str,
    sensor_path: str,
    gravity: float,
    false_alarms: float | None,
    csv_path: str | None,
    plot_path: str | None,
) -> None:
    """Readings without bias, weight and inertial load of what the sensor carries.

    Exit code 1 if --contacts finds one, or, LOOK AGAIN, if the sensor file does not explain the log: another tool, unit,
    sign or orientation, or a log in motion whose moments hold an inertia that was not identified.
    """
    from ..sensing.compensation import compensation
    from ..sensing.sensor_file import read_sensor_file
    from .tables.sensor import compensation_view

    file = read_sensor_file(sensor_path_of(sensor_path))
    readings = read_readings(log, gravity)
    found = compensation(readings, file.sensor, file.noise, false_alarms, file.uncertainty)
    console.print(compensation_view(found))
    if csv_path is not None:
        write_readings(readings, found.rest, csv_path)
    if plot_path is not None:
        from ..plotting.sensor import plot_compensation

        plot_compensation(readings, file.sensor, file.noise, plot_path, marked=found.hits, mark="contact")
    tell(csv_path, plot_path)
    if not found.verdict.ok:
        sys.exit(found.verdict.exit_code)
