"""An identified sensor as a JSON file, from ``identify`` to ``compensate``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core import arguments
from ..core.files import read_text
from ..core.foreign_errors import foreign_errors
from ..errors import NotFoundError, ShapeError, TwistWrenchError, ValueRangeError
from ..outputs import replacing
from ..typing import Array
from .noise import checked_noise
from .sensor import ForceTorqueSensor
from .uncertainty import Uncertainty

_ARRAYS = ("covariance", "freedom", "noise", "noise_freedom")

_MOST_BYTES = 2**20
_ADVICE = "`sensor identify LOG --save FILE` writes one."


@dataclass(frozen=True)
class SensorFile:
    """What a sensor file says."""

    sensor: ForceTorqueSensor
    noise: tuple[float, float]
    """Standard deviations of moments [N m] and forces [N]."""
    uncertainty: Uncertainty | None
    """How well the sensor is known; None in older files, which say nothing of it."""


def write_sensor(
    sensor: ForceTorqueSensor, path: str | Path, noise: tuple[float, float], uncertainty: Uncertainty | None = None
) -> None:
    """Write a sensor and the noise of its readings to a file, every digit of them.

    Parameters
    ----------
    sensor : ForceTorqueSensor
    path : str or Path, the file that is written
    noise : (moment [N m], force [N]), standard deviations of a reading
    uncertainty : Uncertainty, optional, how well it is known, as :attr:`Identification.uncertainty` has it
        Covariance and degrees of freedom, which :func:`~twistwrench.sensing.compensation.compensation` needs for its
        rate of false alarms to hold. Whether the load's rotational inertia is known goes with it.

    Raises
    ------
    ShapeError
        Arguments are of another type.
    ValueRangeError
        A noise is none, or nothing can be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_sensor(ForceTorqueSensor(), f"{folder}/hand.json", (0.01, 0.3))
    ...     Path(folder, "hand.json").exists()
    True
    """
    if not isinstance(sensor, ForceTorqueSensor) or not isinstance(path, str | Path):
        raise ShapeError(
            f"write_sensor takes a ForceTorqueSensor, then a path, got {type(sensor).__name__} and {type(path).__name__}."
        )
    content: dict[str, Any] = {
        "sign": sensor.sign,
        "bias": np.asarray(sensor.bias).tolist(),
        "mounting": np.asarray(sensor.mounting).tolist(),
        "load": sensor.load.parameters.tolist(),
        "inertia": sensor.inertia,
        "noise": checked_noise(noise, none_at_all=True).tolist(),
    }
    if sensor.frame is not None:
        content["frame"] = sensor.frame
    if uncertainty is not None and not isinstance(uncertainty, Uncertainty):
        raise ShapeError(
            f"write_sensor: uncertainty is {arguments.shown(uncertainty)}: give Identification.uncertainty, or None."
        )
    if uncertainty is not None:
        content["uncertainty"] = {
            "unknowns": list(uncertainty.unknowns),
            **{name: _plain(getattr(uncertainty, name)) for name in _ARRAYS},
        }
    with replacing(path) as scratch:
        scratch.write_text(json.dumps(content, indent=1) + "\n", "utf-8")


def read_sensor(path: str | Path) -> tuple[ForceTorqueSensor, tuple[float, float]]:
    """Read a sensor and its noise from a file that :func:`write_sensor` wrote.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    sensor : ForceTorqueSensor
    noise : (moment [N m], force [N]), standard deviations of a reading

    Raises
    ------
    NotFoundError, ValueRangeError
        As :func:`read_sensor_file`.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_sensor(ForceTorqueSensor(bias=[0, 0, 0, 5, 0, 0]), f"{folder}/hand.json", (0.01, 0.3))
    ...     sensor, noise = read_sensor(f"{folder}/hand.json")
    >>> sensor.bias.tolist(), noise
    ([0.0, 0.0, 0.0, 5.0, 0.0, 0.0], (0.01, 0.3))
    """
    found = read_sensor_file(path)
    return found.sensor, found.noise


def read_sensor_file(path: str | Path) -> SensorFile:
    """Read what :func:`write_sensor` wrote, and how well the sensor is known if the file says it.

    Raises :class:`~twistwrench.NotFoundError` and :class:`~twistwrench.ValueRangeError`.
    """
    if not isinstance(path, str | Path):
        raise ShapeError(f"read_sensor takes the path of a sensor file, got {type(path).__name__}.")
    path = Path(path)
    try:
        content = _content(path)
        load = SpatialInertia.from_parameters(content["load"])
        if load.mass < 0:
            raise ValueRangeError(f"the load's mass, {load.mass} kg, is negative. Identify the sensor again.")
        sensor = ForceTorqueSensor(
            load, content["bias"], content["sign"], content["mounting"], content.get("frame"), _inertia(content, load)
        )
        moment, force = checked_noise(content["noise"], none_at_all=True).tolist()
        known = content.get("uncertainty")
        uncertainty = None if known is None else _uncertainty(known)
    except FileNotFoundError:
        raise NotFoundError(f"no sensor file {str(path)!r}. {_ADVICE}") from None
    except TwistWrenchError as problem:
        raise ValueRangeError(f"{path}: {problem}") from None
    except (ValueError, TypeError, KeyError, OverflowError):
        raise ValueRangeError(f"{path}: is no sensor file. {_ADVICE}") from None
    return SensorFile(sensor, (moment, force), uncertainty)


def _plain(x: Array) -> Any:
    """Lists of numbers for JSON, which has no infinity: null."""
    return [_plain(row) for row in x] if x.ndim > 1 else [float(v) if np.isfinite(v) else None for v in x]


def _uncertainty(known: dict[str, Any]) -> Uncertainty:
    # A float array takes None for NaN: what is no number in the file is an infinity, and refused where that is none.
    arrays = {name: np.array(known[name], float) for name in _ARRAYS}
    return Uncertainty(tuple(known["unknowns"]), **{k: np.where(np.isnan(x), np.inf, x) for k, x in arrays.items()})


def _content(path: Path) -> dict[str, Any]:
    with foreign_errors(lambda reason: ValueRangeError(f"is no sensor file: {reason}. {_ADVICE}")):
        try:
            content = json.loads(read_text(path, _MOST_BYTES), parse_int=float)  # no number beyond floats
        except FileNotFoundError:
            raise NotFoundError(str(path)) from None
    if not isinstance(content, dict):
        raise ValueRangeError(f"is no sensor file: it holds one value of kind {type(content).__name__}. {_ADVICE}")
    return content


def _inertia(content: dict[str, Any], load: SpatialInertia) -> Any:
    """What the file says of the rotational inertia; one that says nothing has none if it is that of a point mass."""
    if "inertia" in content:
        return content["inertia"]
    point = SpatialInertia.from_com(load.mass, load.com) if load.mass else SpatialInertia.zero()
    same = np.allclose(load.parameters, point.parameters, rtol=1e-9, atol=1e-12)
    return "unknown" if same or load.defects() else "given"
