"""Denavit–Hartenberg tables, standard and modified, to a model. Modern Robotics appendix C; Craig; Corke; Siciliano et al."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.inertia import SpatialInertia
from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import InertiaError, ShapeError, UnknownNameError, ValueRangeError
from ..lie import se3
from ..model.builder import ModelBuilder
from ..model.model import Model
from ..typing import Array

COLUMNS = ("theta", "d", "a", "alpha")
"""About and along z [rad, m], then along and about x [m, rad]."""
CONVENTIONS = ("standard", "modified")
_DH_TYPES = ("revolute", "prismatic")
TURN = 2 * np.pi + 1e-6
"""rad; no table goes further, give or take rounding."""


def from_dh(
    table: Mapping[str, ArrayLike] | Sequence[Mapping[str, float]] | ArrayLike,
    *,
    convention: str,
    columns: Sequence[str] | None,
    joint_types: str | Sequence[str],
    masses: ArrayLike | None,
    coms: ArrayLike | None,
    moments_about_com: ArrayLike | None,
    tool: ArrayLike | None,
    joint_names: Sequence[str] | None,
    name: str,
    gravity: ArrayLike,
    inertia: str,
) -> Model:
    """The model of a Denavit–Hartenberg table, by the arguments of :func:`twistwrench.from_dh`."""
    if convention not in CONVENTIONS:
        raise UnknownNameError.of("Denavit–Hartenberg convention", convention, CONVENTIONS)
    theta, d, a, alpha = _columns(table, columns)
    n = len(theta)
    kinds = _one_each("joint_types", [joint_types] * n if isinstance(joint_types, str) else joint_types, n)
    names = _one_each("joint_names", [f"joint{i + 1}" for i in range(n)] if joint_names is None else joint_names, n)
    bodies = _inertias(n, masses, coms, moments_about_com)
    builder = ModelBuilder(name)
    for column, angles in (("theta", theta), ("alpha", alpha)):
        if (big := np.flatnonzero(np.abs(angles) > TURN)).size:
            builder.remark(
                f"{column} of row {big[0] + 1} of the Denavit–Hartenberg table is {printed(angles[big[0]])}, more than a "
                f"whole turn; angles are radians? If these are degrees: np.radians({column})"
            )
    builder.add_link("link0")
    for i in range(n):
        if kinds[i] not in _DH_TYPES:
            raise UnknownNameError.of(f"joint type (of {names[i]!r})", kinds[i], _DH_TYPES)
        parent, link, axis = f"link{i}", f"link{i + 1}", f"axis{i + 1}"
        along_z, along_x = _screw(2, theta[i], d[i]), _screw(0, alpha[i], a[i])
        if convention == "standard":  # the joint moves an axis frame, and the link's frame is fixed to that
            builder.add_link(axis)
            builder.add_joint(names[i], kinds[i], parent, axis, placement=along_z, axis=(0, 0, 1))
            builder.add_link(link, bodies[i])
            builder.add_joint(f"{link}_fixed", "fixed", axis, link, placement=along_x)
        else:
            builder.add_link(link, bodies[i])
            builder.add_joint(names[i], kinds[i], parent, link, placement=along_x @ along_z, axis=(0, 0, 1))
    tip = f"link{n}"
    if tool is not None:
        builder.add_link("tool")
        builder.add_joint("tool_fixed", "fixed", tip, "tool", placement=arguments.pose(tool, "tool"))
        tip = "tool"
    return builder.build(tip=tip, gravity=gravity, inertia=inertia)


def _one_each(what: str, given: Sequence[str], n: int) -> list[str]:
    if isinstance(given, str) or not isinstance(given, Sequence) or len(given) != n:
        raise ShapeError(f"{what} is {given!r}, but the table has {n} rows: give a list with one name for each row.")
    return list(given)


def _screw(axis: int, angle: float, distance: float) -> Array:
    """Turning about a coordinate axis and sliding along it."""
    return se3.exp(np.concatenate([angle * np.eye(3)[axis], distance * np.eye(3)[axis]]))


def _columns(table: Any, columns: Sequence[str] | None) -> list[Array]:
    """theta, d, a, alpha, (n,) each."""
    if isinstance(table, Mapping):
        found = {name: arguments.finite(x, f"column {name!r} of the table") for name, x in _known(table).items()}
        found = {name: x if x.ndim else x[None] for name, x in found.items()}
    elif _is_rows(table):
        rows = [_known(row) for row in table]
        found = {
            name: arguments.finite([row.get(name, 0.0) for row in rows], f"column {name!r} of the table")
            for name in COLUMNS
        }
    else:
        found = _by_position(table, columns)
    n = max((len(x) for x in found.values() if x.ndim == 1), default=0)
    if n == 0 or any(x.shape != (n,) for x in found.values()):
        listed = ", ".join(f"{name} {x.shape}" for name, x in found.items()) or "none"
        raise ShapeError(
            f"the columns of a Denavit–Hartenberg table have as many numbers each, one at least: {listed}."
        )
    return [np.asarray(found.get(name, np.zeros(n)), float) for name in COLUMNS]


def _is_rows(table: Any) -> bool:
    return isinstance(table, Sequence) and len(table) > 0 and all(isinstance(row, Mapping) for row in table)


def _known(named: Mapping[str, Any]) -> Mapping[str, Any]:
    for column in named:
        if column not in COLUMNS:
            raise UnknownNameError.of("column of a Denavit–Hartenberg table", column, COLUMNS)
    return named


def _by_position(table: Any, columns: Sequence[str] | None) -> dict[str, Array]:
    array = arguments.finite(table, "the Denavit–Hartenberg table")
    if array.ndim != 2 or array.shape[1] != len(COLUMNS):
        raise ShapeError(f"the Denavit–Hartenberg table has shape {array.shape}, expected (n, 4).")
    if columns is None:
        raise ValueRangeError(
            "an (n, 4) table does not say what its columns are, and books disagree: pass columns=('theta', 'd', 'a', 'alpha') "
            "in the order it has them, or the table as a dict of named columns."
        )
    if sorted(_known(dict.fromkeys(columns))) != sorted(COLUMNS) or len(columns) != len(COLUMNS):
        raise ValueRangeError(f"columns={tuple(columns)!r}: each of {', '.join(COLUMNS)} must be there once.")
    return dict(zip(columns, array.T, strict=True))


def _inertias(
    n: int, masses: ArrayLike | None, coms: ArrayLike | None, moments: ArrayLike | None
) -> list[SpatialInertia]:
    """The inertia of each link in its own frame, zero where nothing is given."""
    m = np.zeros(n) if masses is None else arguments.finite(masses, "masses")
    c = np.zeros((n, 3)) if coms is None else arguments.finite(coms, "coms")
    I = np.zeros((n, 3, 3)) if moments is None else arguments.finite(moments, "moments_about_com")
    for what, x, shape in (("masses", m, (n,)), ("coms", c, (n, 3)), ("moments_about_com", I, (n, 3, 3))):
        if x.shape != shape:
            raise ShapeError(f"{what} has shape {x.shape}, but the table has {n} rows: expected {shape}.")
    found = []
    for i in range(n):
        try:
            found.append(SpatialInertia.from_com(float(m[i]), c[i], I[i]))
        except InertiaError as problem:
            raise InertiaError(f"link{i + 1}: {problem}") from None
    return found
