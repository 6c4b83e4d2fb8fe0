"""The command ``twistwrench sensor identify``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

from .command_texts import about
from .sensor_options import (
    CSV,
    GRAVITY_OPTION,
    PLOT,
    SIGN,
    numbers_of,
    read_readings,
    sensor_command,
    tell,
    write_readings,
)

if TYPE_CHECKING:
    from rich.console import Console


@click.command("identify", **about("sensor identify"))
@click.argument("log", metavar="LOG")
@SIGN
@GRAVITY_OPTION
@click.option("--inertia", is_flag=True, help="Also the six inertia numbers; the log needs wx … vz and dwx … dvz.")
@click.option(
    "--orientation", is_flag=True, help="Also how the sensor's axes are turned against the frame of the poses."
)
@click.option("--drift", is_flag=True, help="Also a bias that changes linearly with time.")
@click.option("--delay", is_flag=True, help="Also the time by which readings are late; the log needs time and motion.")
@click.option("--tilt", is_flag=True, help="Also a tilt of the base, which turns gravity; the log needs orientations.")
@click.option("--bias", metavar="m,m,m,f,f,f", help="A known bias, which is then not looked for.")
@click.option(
    "--noise",
    metavar="M,F",
    help="Known noise of moments [N m] and forces [N], or of all six; estimated if not given.",
)
@click.option("--keep-outliers", is_flag=True, help="Use readings that the others contradict, too.")
@click.option("--save", "save_path", metavar="SENSOR.json", help="Write the sensor for `compensate`.")
@CSV
@PLOT
@sensor_command
def identify_command(
    *,
    console: Console,
    log: str,
    sign: Any,
    gravity: float,
    inertia: bool,
    orientation: bool,
    drift: bool,
    delay: bool,
    tilt: bool,
    bias: str | None,
    noise: str | None,
    keep_outliers: bool,
    save_path: str | None,
    csv_path: str | None,
    plot_path: str | None,
) -> None:
    """Bias, mass and centre of mass of what the sensor carries, and how well they are known.

    Exit code 1, LOOK AGAIN, if readings contradict the others, if units, sign, mounting, gain or poses look wrong, or if
    no body has the inertia found; UNSURE if what is left is not white, or --drift, --delay, --tilt or --orientation would
    explain it.
    """
    from ..sensing.identification import identify
    from ..sensing.sensor_file import write_sensor
    from .tables.sensor import identification_view

    readings = read_readings(log, gravity)
    found = identify(
        readings,
        sign=sign,
        inertia=inertia,
        orientation=orientation,
        drift=drift,
        delay=delay,
        tilt=tilt,
        bias=None if bias is None else numbers_of(bias, "--bias", 6),
        noise=None if noise is None else numbers_of(noise, "--noise", 6 if noise.count(",") > 1 else 2),
        outliers="keep" if keep_outliers else "trim",
    )
    console.print(identification_view(found, readings))
    if save_path is not None:
        write_sensor(found.sensor, save_path, found.noise, found.uncertainty)
    if csv_path is not None:
        write_readings(readings, found.rest(readings), csv_path)
    if plot_path is not None:
        from ..plotting.sensor import plot_compensation

        plot_compensation(readings, found.sensor, found.noise, plot_path, marked=~found.kept, mark="left out")
    tell(save_path, csv_path, plot_path)
    if not found.verdict.ok:
        sys.exit(found.verdict.exit_code)
