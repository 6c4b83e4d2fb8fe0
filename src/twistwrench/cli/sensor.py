"""The commands ``twistwrench sensor identify``, ``compensate`` and ``poses``, with the options and files they share."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.gravity import STRENGTH
from ..core.verdict import ExitCode
from ..errors import ModelWarning, ValueRangeError
from .console import console, picture
from .usage import about, plain_errors

if TYPE_CHECKING:
    from rich.console import Console

    from ..sensing.log import ReadingLog

_DEMOS = {"demo": "demo_poses.csv", "demo-motion": "demo_motion.csv"}

_HERE = Path(__file__).parents[1] / "sensing"

SIGN = click.option(
    "--sign",
    type=click.Choice(["on_sensor", "by_sensor"]),
    default="on_sensor",
    show_default=True,
    help="Readings are what the load does to the sensor (at rest its weight), or what the sensor does to it.",
)

GRAVITY_OPTION = click.option(
    "--gravity", type=float, default=STRENGTH, show_default=True, help="Its size [m/s²]; -z of the world."
)

CSV = click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the readings without bias and load.")

PLOT = click.option("--plot", "plot_path", metavar="OUT.png", help="Draw the readings before and after.")


def log_path(name: str) -> Path:
    """The file of a log; demos are bundled."""
    return _HERE / _DEMOS[name] if name in _DEMOS and not Path(name).is_file() else Path(name)


def sensor_file(name: str) -> Path:
    """The file of a sensor; ``demo`` is bundled."""
    return _HERE / "demo_sensor.json" if name == "demo" and not Path(name).is_file() else Path(name)


def read_readings(name: str, gravity: float) -> ReadingLog:
    """The readings of a log, under gravity of that size [m/s²]. Raises ValueRangeError."""
    from ..sensing.files import read_log

    if not (gravity > 0 and math.isfinite(gravity)):
        raise ValueRangeError(f"--gravity {gravity!r} is no size of gravity. Give it in m/s², such as {STRENGTH}.")
    with warnings.catch_warnings():  # the report says what is doubtful, in its place
        warnings.simplefilter("ignore", ModelWarning)
        return read_log(log_path(name), gravity=(0.0, 0.0, -gravity))


def write_readings(log: ReadingLog, compensated: Any, path: str) -> None:
    """Write readings without bias and load (n, 6), with the times where the log has them."""
    import numpy as np

    from ..lie.labelled import WRENCH
    from ..motion.array_files import TableFile

    head = [] if log.time is None else ["time"]
    rows = compensated if log.time is None else np.column_stack([log.time, compensated])
    with TableFile.writing(path, [*head, *WRENCH]) as file:
        if file is not None:
            file.write(rows)


def parse_noise(text: str) -> tuple[float, float]:
    """Two numbers: noise of moments [N m] and of forces [N]."""
    moment, force = parse_count(text, "--noise", 2)
    return moment, force


def parse_count(text: str, option: str, count: int) -> list[float]:
    """Numbers between commas. Raises ValueRangeError, which names the option."""
    try:
        numbers = [float(x) for x in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueRangeError(f"{option} {text!r} is not {count} numbers separated by commas.")
    return numbers


def tell(*paths: str | None) -> None:
    """Say which files were written."""
    for path in filter(None, paths):
        click.echo(f"wrote {path}")


def sensor_command(function: Callable[..., None]) -> Callable[..., None]:
    """A command that prints on ``console=``, and whose errors are a line each."""

    @wraps(function)
    def command(**given: Any) -> None:
        with plain_errors():
            function(console=console(), **_checked_files(given))

    return command


def _checked_files(given: dict[str, Any]) -> dict[str, Any]:
    """The options, once each output is found to have a place of its own; a picture gets its suffix."""
    from ..core.files import check_outputs

    if "plot_path" in given:
        given["plot_path"] = picture(given["plot_path"])
    log, sensor = given.get("log"), given.get("sensor_path")
    check_outputs(
        {"--save": given.get("save_path"), "--csv": given.get("csv_path"), "--plot": given.get("plot_path")},
        {"LOG": None if log is None else log_path(log), "--sensor": None if sensor is None else sensor_file(sensor)},
    )
    return given


# ── ``sensor compensate``


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
    from ..sensing.files import read_sensor_file
    from .tables.measurement import compensation_view

    file = read_sensor_file(sensor_file(sensor_path))
    readings = read_readings(log, gravity)
    found = compensation(readings, file.sensor, file.noise, false_alarms, file.uncertainty)
    console.print(compensation_view(found))
    if csv_path is not None:
        write_readings(readings, found.rest, csv_path)
    if plot_path is not None:
        from ..plotting.explanation import plot_compensation

        plot_compensation(readings, file.sensor, file.noise, plot_path, marked=found.hits, mark="contact")
    tell(csv_path, plot_path)
    if not found.verdict.ok:
        sys.exit(found.verdict.exit_code)


# ── ``sensor identify``


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
    from ..sensing.files import write_sensor
    from ..sensing.identification import identify
    from .tables.measurement import sensor_identification_view

    readings = read_readings(log, gravity)
    found = identify(
        readings,
        sign=sign,
        inertia=inertia,
        orientation=orientation,
        drift=drift,
        delay=delay,
        tilt=tilt,
        bias=None if bias is None else parse_count(bias, "--bias", 6),
        noise=None if noise is None else parse_count(noise, "--noise", 6 if noise.count(",") > 1 else 2),
        outliers="keep" if keep_outliers else "trim",
    )
    console.print(sensor_identification_view(found, readings))
    if save_path is not None:
        write_sensor(found.sensor, save_path, found.noise, found.uncertainty)
    if csv_path is not None:
        write_readings(readings, found.rest(readings), csv_path)
    if plot_path is not None:
        from ..plotting.explanation import plot_compensation

        plot_compensation(readings, found.sensor, found.noise, plot_path, marked=~found.kept, mark="left out")
    tell(save_path, csv_path, plot_path)
    if not found.verdict.ok:
        sys.exit(found.verdict.exit_code)


# ── ``sensor poses``


@click.command("poses", **about("sensor poses"))
@click.argument("log", metavar="[LOG]", required=False)
@click.option("--count", type=int, default=6, show_default=True, help="How many.")
@click.option("--within", type=float, default=180.0, show_default=True, metavar="DEGREES", help="The largest tilt.")
@click.option("--noise", metavar="M,F", default="0.01,0.3", show_default=True, help="Of moments [N m] and forces [N].")
@click.option("--mass", type=float, default=1.0, show_default=True, help="About how heavy the load is [kg].")
@GRAVITY_OPTION
@click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the poses.")
@sensor_command
def poses_command(
    *,
    console: Console,
    log: str | None,
    count: int,
    within: float,
    noise: str,
    mass: float,
    gravity: float,
    csv_path: str | None,
) -> None:
    """The next orientations to read: those that tell most, after the readings of LOG or from nothing.

    Exit code 1, LOOK AGAIN, if these cannot tell the mass or the centre of mass.
    """
    import numpy as np

    from ..lie import quaternion
    from ..motion.array_files import TableFile
    from ..sensing.poses import propose_poses
    from .tables.measurement import cannot_tell, proposal_view

    if not (mass > 0 and math.isfinite(mass)):
        raise ValueRangeError(f"--mass {mass!r} is no mass. Give about how many kilograms the load has.")
    past = None if log is None else read_readings(log, gravity)
    proposal = propose_poses(count, log=past, within=math.radians(within), noise=parse_noise(noise), gravity=gravity)
    quat = quaternion.from_matrix(proposal.rotations)
    untold = cannot_tell(proposal, mass, None if within >= 90 else within)
    console.print(proposal_view(proposal, quat, mass, untold))
    unit = proposal.gravity / np.linalg.norm(proposal.gravity, axis=1, keepdims=True)
    with TableFile.writing(csv_path, ["qw", "qx", "qy", "qz", "gx", "gy", "gz"]) as file:
        if file is not None:
            file.write(np.concatenate([quat, unit], axis=1))
    tell(csv_path)
    if untold:
        sys.exit(ExitCode.NO)


# ── The group; heavy modules are imported inside the command that needs them


@click.group(cls=click.Group, **about("sensor"))
def sensor() -> None:
    """Six-axis force-torque sensors: find the tool's mass, remove its weight, propose poses.

    LOG is a CSV file with mx,my,mz,fx,fy,fz and an orientation (qw,qx,qy,qz or r11…r33 or gx,gy,gz),
    or 'demo' or 'demo-motion', which are bundled.
    """


sensor.add_command(identify_command)
sensor.add_command(compensate_command)
sensor.add_command(poses_command)
