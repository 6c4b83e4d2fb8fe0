"""An identified sensor as a JSON file, from ``identify`` to ``compensate``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import NotFoundError, TwistWrenchError, ValueRangeError
from ..outputs import replacing
from .noise import checked_noise
from .sensor import ForceTorqueSensor

__all__ = ["read_sensor", "write_sensor"]


def write_sensor(sensor: ForceTorqueSensor, path: str | Path, noise: tuple[float, float]) -> None:
    """Write a sensor and the noise (moments [N m], forces [N]) of its readings, every digit of them.

    Raises :class:`~twistwrench.ValueRangeError` for a noise that is none, or where nothing can be written.
    """
    content: dict[str, Any] = {
        "sign": sensor.sign,
        "bias": np.asarray(sensor.bias).tolist(),
        "mounting": np.asarray(sensor.mounting).tolist(),
        "load": sensor.load.parameters.tolist(),
        "noise": checked_noise(noise, none_at_all=True).tolist(),
    }
    if sensor.frame is not None:
        content["frame"] = sensor.frame
    with replacing(path) as scratch:
        scratch.write_text(json.dumps(content, indent=1) + "\n", "utf-8")


def read_sensor(path: str | Path) -> tuple[ForceTorqueSensor, tuple[float, float]]:
    """Read what :func:`write_sensor` wrote: the sensor and its noise.

    Raises :class:`~twistwrench.NotFoundError` and :class:`~twistwrench.ValueRangeError`.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text("utf-8"))
        load = SpatialInertia.from_parameters(content["load"])
        sensor = ForceTorqueSensor(load, content["bias"], content["sign"], content["mounting"], content.get("frame"))
        if not load.mass >= 0:
            raise ValueRangeError(f"the load's mass, {load.mass} kg, is negative. Identify the sensor again.")
        moment, force = checked_noise(content["noise"], none_at_all=True).tolist()
    except FileNotFoundError:
        raise NotFoundError(f"no sensor file {str(path)!r}. `sensor identify LOG --save FILE` writes one.") from None
    except TwistWrenchError as problem:
        raise ValueRangeError(f"{path}: {problem}") from None
    except (OSError, ValueError, TypeError, KeyError):
        raise ValueRangeError(f"{path}: is no sensor file. `sensor identify LOG --save FILE` writes one.") from None
    return sensor, (moment, force)
