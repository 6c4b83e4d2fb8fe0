"""What the commands of ``twistwrench sensor`` share: options, the log they read, the files they write."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.gravity import STRENGTH
from ..errors import ModelWarning, ValueRangeError
from .console import console
from .picture_paths import picture
from .plain_errors import plain_errors

if TYPE_CHECKING:
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


def sensor_path_of(name: str) -> Path:
    """The file of a sensor; ``demo`` is bundled."""
    return _HERE / "demo_sensor.json" if name == "demo" and not Path(name).is_file() else Path(name)


def read_readings(name: str, gravity: float) -> ReadingLog:
    """The readings of a log, under gravity of that size [m/s²]. Raises ValueRangeError."""
    from ..sensing.log_file import read_log

    if not (gravity > 0 and math.isfinite(gravity)):
        raise ValueRangeError(f"--gravity {gravity!r} is no size of gravity. Give it in m/s², such as {STRENGTH}.")
    with warnings.catch_warnings():  # the report says what is doubtful, in its place
        warnings.simplefilter("ignore", ModelWarning)
        return read_log(log_path(name), gravity=(0.0, 0.0, -gravity))


def write_readings(log: ReadingLog, compensated: Any, path: str) -> None:
    """Write readings without bias and load (n, 6), with the times where the log has them."""
    import numpy as np

    from ..motion.table_file import TableFile
    from ..screws.component_names import WRENCH

    head = [] if log.time is None else ["time"]
    rows = compensated if log.time is None else np.column_stack([log.time, compensated])
    with TableFile.writing(path, [*head, *WRENCH]) as file:
        if file is not None:
            file.write(rows)


def noise_of(text: str) -> tuple[float, float]:
    """Two numbers: noise of moments [N m] and of forces [N]."""
    moment, force = numbers_of(text, "--noise", 2)
    return moment, force


def numbers_of(text: str, option: str, count: int) -> list[float]:
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
    from ..outputs import check_outputs

    if "plot_path" in given:
        given["plot_path"] = picture(given["plot_path"])
    log, sensor = given.get("log"), given.get("sensor_path")
    check_outputs(
        {"--save": given.get("save_path"), "--csv": given.get("csv_path"), "--plot": given.get("plot_path")},
        {"LOG": None if log is None else log_path(log), "--sensor": None if sensor is None else sensor_path_of(sensor)},
    )
    return given
