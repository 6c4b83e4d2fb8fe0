"""States over time as an xarray dataset: axes with the names of samples, times and joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import MissingExtraError
from ..joints.units import unit_of, units_of
from ..model.model import Model
from ..typing import Array
from .coordinates import Coordinates


def labelled_dataset(model: Model, times: Array, arrays: Mapping[str, Array]) -> Any:
    """An ``xarray.Dataset`` of q and what else there is, each (..., n, nq) or (..., n, nv).

    Axes are ``sample`` (``sample_0``, ``sample_1``, … where there are several), ``time`` [s], ``coordinate`` for q and
    ``joint`` for all else. Torques of steps, one fewer than the times, end with NaN. Raises MissingExtraError.
    """
    try:
        import xarray
    except ImportError:
        raise MissingExtraError.of("xarray", "tables", "Making a Dataset") from None
    kinds = Coordinates.of(model)
    batch = next(iter(arrays.values())).ndim - 2
    samples = ("sample",) if batch == 1 else tuple(f"sample_{k}" for k in range(batch))
    coords = {
        "time": ("time", times, {"units": "s"}),
        "coordinate": list(kinds.names),
        "joint": list(kinds.velocity_names),
    }
    variables = {}
    for name, array in arrays.items():
        axis = "coordinate" if name == "q" else "joint"
        missing = len(times) - array.shape[-2]
        if missing:
            array = np.concatenate([array, np.full((*array.shape[:-2], missing, array.shape[-1]), np.nan)], axis=-2)
        variables[name] = ((*samples, "time", axis), array, {"units": _units(name, kinds)})
    return xarray.Dataset(variables, coords, {"robot": model.name})


def _units(name: str, kinds: Coordinates) -> str:
    """The unit of all entries, or those of each, as they stand in a row."""
    if name == "q":
        quaternion = np.zeros(len(kinds.names), bool)
        for part in kinds.quaternions:
            quaternion[part] = True
        each = ["1" if one else unit_of("q", bool(turns)) for one, turns in zip(quaternion, kinds.angular, strict=True)]
    else:
        each = [unit.replace("²", "^2") for unit in units_of(name, kinds.angular_velocity)]
    return each[0] if len(set(each)) == 1 else ", ".join(each)
