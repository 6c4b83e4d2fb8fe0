"""Numbers that are given for a model sample by sample: refused where no robot has them, as loading refuses them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.printed_numbers import printed
from ..errors import InertiaError, ValueRangeError
from ..typing import Array
from .friction import LAWS
from .inertia_checks import moved_moments, reasons
from .model import BASE, Model
from .variable_parameters import nominal, varied

_TENSOR = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_SLACK = 1e-6
"""Of the sum of the principal moments, as of a body that is judged by itself."""


def refuse_impossible(model: Model, given: Mapping[str, Array]) -> None:
    """Refuse masses and friction below zero, and moments of inertia that no body has; NaN passes.

    ``given`` are numbers of any shape by the names of :func:`~twistwrench.model.variable_parameters.nominal`. A tensor is
    judged with the links that are fixed to its own, and left alone on a body that could not exist as it was loaded. Raises
    InertiaError and ValueRangeError, naming the link or joint and the sample.
    """
    links = {link for link, frame in model.frames.items() if frame.body != BASE}
    for name, values in given.items():
        owner, _, what = name.rpartition(".")
        if what == "mass" and (values < 0).any():
            raise InertiaError(
                f"parameters: {_at(name, values, values < 0, ' kg')}: link {owner!r} cannot have a negative mass. "
                "Give 0 or more."
            )
        if what in LAWS:
            _refuse_friction(name, what, values)
    for link in sorted(links & {name.rpartition(".")[0] for name in given if name.rpartition(".")[2] in _TENSOR}):
        _refuse_tensor(model, link, given)


def _refuse_friction(name: str, what: str, values: Array) -> None:
    bad, wanted = values < 0, "at least 0"
    if what == "stribeck":
        bad, wanted = values <= 0, "above 0"
    if what == "load":
        bad, wanted = (values < 0) | (values >= 1), "at least 0 and below 1"
    if bad.any():
        raise ValueRangeError(f"parameters: {_at(name, values, bad)}, and friction of a joint is {wanted} there.")


def _refuse_tensor(model: Model, link: str, given: Mapping[str, Array]) -> None:
    body, usual = model.frames[link].body, nominal(model)
    if reasons(model.bodies[body].inertia, moved_moments(model, body)):
        return
    xx, xy, yy, xz, yz, zz = np.broadcast_arrays(
        *(np.asarray(given.get(f"{link}.{what}", usual[f"{link}.{what}"]), float) for what in _TENSOR)
    )
    I = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(*xx.shape, 3, 3)
    known = np.isfinite(I).all(axis=(-2, -1))
    A, B, C = np.moveaxis(np.linalg.eigvalsh(np.where(known[..., None, None], I, np.eye(3))), -1, 0)
    slack = _SLACK * np.abs(A + B + C)
    bad = (-slack > A) | (A + B + slack < C)
    if not bad.any():
        return
    members = {f"{name}.": name for name, frame in model.frames.items() if frame.body == body}
    mine = {n: x for n, x in given.items() if n[: n.rfind(".") + 1] in members}
    whole = np.broadcast_shapes(*(x.shape for x in mine.values()))
    for sample in map(tuple, np.argwhere(np.broadcast_to(bad, whole))):
        values = [float(np.broadcast_to(x, whole)[sample]) for x in mine.values()]
        with np.errstate(all="ignore"):
            numbers = varied(model, list(mine), values).bodies[body].inertia.parameters.astype(float)
        G = SpatialInertia.from_parameters(numbers)
        if np.isfinite(numbers).all() and (found := reasons(G, moved_moments(model, body))):
            place = f" in sample {_index(sample)}" if sample else ""
            raise InertiaError(
                f"parameters: link {link!r}{place} cannot exist: {'; '.join(found)}. Give moments of a body that can: "
                "tw.SpatialInertia(…).nearest_consistent() finds them."
            )


def _at(name: str, values: Array, bad: Array, unit: str = "") -> str:
    sample = tuple(np.argwhere(bad)[0])
    place = f" in sample {_index(sample)}" if sample else ""
    return f"{name!r} is {printed(float(values[sample]))}{unit}{place}"


def _index(sample: tuple[int, ...]) -> str:
    return str(int(sample[0])) if len(sample) == 1 else str(tuple(map(int, sample)))
