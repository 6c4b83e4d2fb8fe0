"""Models from Denavit–Hartenberg tables; conversion to and from the book's screw lists. MR chapters 4, 8, app. C."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import InertiaError, ModelError, ShapeError, UnknownNameError, ValueRangeError
from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import se3
from ..mechanics.lie.adjoint import Ad
from ..mechanics.model.builder import ModelBuilder
from ..mechanics.model.model import Model

COLUMNS = ("theta", "d", "a", "alpha")
"""Columns of a table: rotation and translation about and along z [rad, m], then along and about x [m, rad]."""
CONVENTIONS = ("standard", "modified")
_DH_TYPES = ("revolute", "prismatic")
TURN = 2 * np.pi + 1e-6
"""Largest angle in a table [rad], with rounding."""


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
    """Model from a Denavit–Hartenberg table; arguments of :func:`twistwrench.from_dh`."""
    if convention not in CONVENTIONS:
        raise UnknownNameError.from_choices("Denavit–Hartenberg convention", convention, CONVENTIONS)
    theta, d, a, alpha = _columns(table, columns)
    n = len(theta)
    if isinstance(joint_types, str):
        joint_types = [joint_types] * n
    if joint_names is None:
        joint_names = [f"joint{i + 1}" for i in range(n)]
    kinds = _names_per_row("joint_types", joint_types, n)
    names = _names_per_row("joint_names", joint_names, n)
    bodies = _inertias(n, masses, coms, moments_about_com)
    builder = ModelBuilder(name)
    for column, angles in (("theta", theta), ("alpha", alpha)):
        _remark_on_degrees(builder, column, angles)
    builder.add_link("link0")
    for i in range(n):
        if kinds[i] not in _DH_TYPES:
            raise UnknownNameError.from_choices(f"joint type (of {names[i]!r})", kinds[i], _DH_TYPES)
        parent, link, axis = f"link{i}", f"link{i + 1}", f"axis{i + 1}"
        along_z, along_x = _screw(2, theta[i], d[i]), _screw(0, alpha[i], a[i])
        if convention == "standard":  # the joint moves an axis frame, to which the link's frame is fixed
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


def _remark_on_degrees(builder: ModelBuilder, column: str, angles: Array) -> None:
    """Add a note if an angle is more than a whole turn, as angles in degrees are."""
    rows = np.flatnonzero(np.abs(angles) > TURN)
    if rows.size:
        builder.remark(
            f"{column} of row {rows[0] + 1} of the Denavit–Hartenberg table is {printed(angles[rows[0]])}, more than a "
            f"whole turn; angles are radians? If these are degrees: np.radians({column})"
        )


def _names_per_row(what: str, names: Sequence[str], n: int) -> list[str]:
    if isinstance(names, str) or not isinstance(names, Sequence) or len(names) != n:
        raise ShapeError(f"{what} is {names!r}, but the table has {n} rows: give a list with one name for each row.")
    return list(names)


def _screw(axis: int, angle: float, distance: float) -> Array:
    """Screw motion: rotation about a coordinate axis and translation along it."""
    return se3.exp(np.concatenate([angle * np.eye(3)[axis], distance * np.eye(3)[axis]]))


def _columns(table: Any, columns: Sequence[str] | None) -> list[Array]:
    """Columns theta, d, a, alpha, (n,) each."""
    named = _named_columns(table, columns)
    n = max((len(x) for x in named.values() if x.ndim == 1), default=0)
    if n == 0 or any(x.shape != (n,) for x in named.values()):
        shapes = ", ".join(f"{name} {x.shape}" for name, x in named.items()) or "none"
        raise ShapeError(
            f"the columns of a Denavit–Hartenberg table have as many numbers each, one at least: {shapes}."
        )
    return [np.asarray(named.get(name, np.zeros(n)), float) for name in COLUMNS]


def _named_columns(table: Any, columns: Sequence[str] | None) -> dict[str, Array]:
    """Columns by name, of a table of any of the three forms."""
    if isinstance(table, Mapping):
        _check_column_names(table)
        values = dict(table)
    elif isinstance(table, Sequence) and len(table) and all(isinstance(row, Mapping) for row in table):
        for row in table:
            _check_column_names(row)
        values = {}
        for name in COLUMNS:
            values[name] = [row.get(name, 0.0) for row in table]
    else:
        return _columns_of_array(table, columns)
    return {name: np.atleast_1d(arguments.finite(x, f"column {name!r} of the table")) for name, x in values.items()}


def _check_column_names(names: Iterable[str]) -> None:
    for column in names:
        if column not in COLUMNS:
            raise UnknownNameError.from_choices("column of a Denavit–Hartenberg table", column, COLUMNS)


def _columns_of_array(table: Any, columns: Sequence[str] | None) -> dict[str, Array]:
    array = arguments.finite(table, "the Denavit–Hartenberg table")
    if array.ndim != 2 or array.shape[1] != len(COLUMNS):
        raise ShapeError(f"the Denavit–Hartenberg table has shape {array.shape}, expected (n, 4).")
    if columns is None:
        raise ValueRangeError(
            "the columns of an (n, 4) table are ambiguous, since books disagree: pass columns=('theta', 'd', 'a', 'alpha') "
            "in the order it has them, or the table as a dict of named columns."
        )
    _check_column_names(columns)
    if sorted(columns) != sorted(COLUMNS):
        raise ValueRangeError(f"columns={tuple(columns)!r}: each of {', '.join(COLUMNS)} must be there once.")
    return dict(zip(columns, array.T, strict=True))


def _inertias(
    n: int, masses: ArrayLike | None, coms: ArrayLike | None, moments: ArrayLike | None
) -> list[SpatialInertia]:
    """Inertia of each link in its own frame, zero if not given."""
    wanted = (("masses", masses, (n,)), ("coms", coms, (n, 3)), ("moments_about_com", moments, (n, 3, 3)))
    arrays = []
    for what, values, shape in wanted:
        x = np.zeros(shape)
        if values is not None:
            x = arguments.finite(values, what)
        if x.shape != shape:
            raise ShapeError(f"{what} has shape {x.shape}, but the table has {n} rows: expected {shape}.")
        arrays.append(x)
    m, c, I = arrays
    return [_inertia(f"link{i + 1}", SpatialInertia.from_com, float(m[i]), c[i], I[i]) for i in range(n)]


def _inertia(link: str, build: Callable[..., SpatialInertia], *numbers: Any) -> SpatialInertia:
    """Inertia of a link; error messages include its name."""
    try:
        return build(*numbers)
    except InertiaError as problem:
        raise InertiaError(f"{link}: {problem}") from None


@dataclass(frozen=True, eq=False)
class ScrewLists:
    """Serial chain of n one-degree joints at its zero configuration, in the form of the book's functions."""

    M: Array
    """(4, 4) pose of the end-effector frame."""
    Slist: Array
    """(6, n) screw axes in the space frame, as columns."""
    Blist: Array
    """(6, n) screw axes in the end-effector frame."""
    Mlist: Array
    """(n + 1, 4, 4) pose of link frame i in link frame i - 1; the last is the end-effector in link n."""
    Glist: Array
    """(n, 6, 6) spatial inertia of each link in its own frame."""


def screw_lists(model: Model, *, at_com: bool = False) -> ScrewLists:
    """Screw lists of a serial chain; ``at_com`` moves link frames to the centres of mass, along principal axes.

    Raises ModelError unless the robot is a serial chain of one-degree joints with a tip.
    """
    if not all(body.joint.moves_body for body in model.bodies):
        raise ModelError(
            f"robot {model.name!r} has rotors, which no Slist holds. Take the screws of the robot before with_actuators."
        )
    for i, body in enumerate(model.bodies):
        if body.parent != i - 1 or body.joint.nv != 1 or body.follows:
            raise ModelError(
                f"robot {model.name!r} is not a serial chain of one-degree joints (see joint {body.joint.name!r}), so it has "
                "no Slist. Lock joints (robot.lock) until one chain is left."
            )
    end = model.frame(None)
    if end.body != len(model.bodies) - 1:
        raise ModelError(f"tip {model.tip!r} of robot {model.name!r} does not ride on the last link. Load with tip=….")
    home, frames, screws, inertias = np.eye(4), [], [], []
    for body in model.bodies:
        home = home @ body.placement
        screws.append(Ad(home) @ body.joint.axes[0])
        moved = np.eye(4)
        if at_com:
            moved = se3.pose(body.inertia.principal()[1], body.inertia.com)
        frames.append(home @ moved)
        inertias.append(body.inertia.in_frame(se3.inverse(moved)).matrix)
    M = home @ end.pose
    chain = [np.eye(4), *frames, M]
    steps = [se3.inverse(a) @ b for a, b in itertools.pairwise(chain)]
    Slist = np.array(screws).T
    return ScrewLists(M, Slist, Ad(se3.inverse(M)).apply(Slist.T).T, np.array(steps), np.array(inertias))


def from_screws(
    M: ArrayLike | None,
    Slist: ArrayLike,
    Mlist: Sequence[ArrayLike] | ArrayLike,
    Glist: Sequence[ArrayLike] | ArrayLike,
    *,
    joint_names: Sequence[str] | None,
    name: str,
    gravity: ArrayLike,
    non_unit_screws: bool,
    inertia: str,
) -> Model:
    """Model from the book's lists; arguments of :func:`twistwrench.from_screws`."""
    S, steps = np.asarray(Slist, float), np.asarray(Mlist, float)
    G = np.asarray(Glist, float)
    n = S.shape[-1] if S.ndim == 2 else 0
    if S.shape != (6, n) or n == 0 or steps.shape != (n + 1, 4, 4) or G.shape != (n, 6, 6):
        raise ShapeError(
            f"Slist {S.shape}, Mlist {steps.shape}, Glist {G.shape}: expected (6, n), (n + 1, 4, 4), (n, 6, 6). Screws are "
            "the columns of Slist; Mlist ends with the end-effector's pose in the last link."
        )
    if joint_names is None:
        joint_names = [f"joint{i + 1}" for i in range(n)]
    names = list(joint_names)
    if len(names) != n:
        raise ShapeError(f"{len(names)} joint names for {n} screws.")
    builder = ModelBuilder(name)
    builder.add_link("base")
    home, parent = np.eye(4), "base"
    for i in range(n):
        home = home @ steps[i]
        A = Ad(se3.inverse(home)) @ S[:, i]  # screw axis in its link's frame, MR section 8.3.1
        if not non_unit_screws:
            _check_unit(S[:, i], i, names[i])
        link = f"link{i + 1}"
        builder.add_link(link, _inertia(link, SpatialInertia.from_matrix, G[i]))
        kind = "prismatic"
        if np.any(A[:3]):
            kind = "helical"
        builder.add_joint(names[i], kind, parent, link, placement=steps[i], axis=A, normalise_axes=False)
        parent = link
    builder.add_link("end_effector")
    builder.add_joint("end_effector_fixed", "fixed", parent, "end_effector", placement=steps[n])
    if M is not None:
        _check_home(np.asarray(M, float), home @ steps[n])
    return builder.build(tip="end_effector", gravity=gravity, inertia=inertia, snap=0.0)


def _check_unit(S: Array, i: int, joint: str) -> None:
    w, v = float(np.linalg.norm(S[:3])), float(np.linalg.norm(S[3:]))
    length, part = v, "sliding part"
    if w > 0:
        length, part = w, "turning part"
    if abs(length - 1.0) > 1e-6:
        raise ModelError(
            f"screw {i + 1} (joint {joint!r}), {S.tolist()}: its {part} has length {printed(length)}, not 1. Divide it by "
            "that, or pass non_unit_screws=True to keep it, knowing that its coordinate is then no angle in radians."
        )


def _check_home(given: Array, product: Array) -> None:
    if given.shape != (4, 4):
        raise ShapeError(f"M has shape {given.shape}, expected (4, 4).")
    gap = float(np.abs(given - product).max())
    if not gap <= 1e-6:
        raise ModelError(
            f"M and the product of Mlist differ by up to {printed(gap, 3)}: they must describe the same end-effector frame "
            "at zero. Pass M=None to take the product."
        )
