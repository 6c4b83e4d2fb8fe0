"""Models from Denavit–Hartenberg tables; conversion to and from the book's screw lists. MR chapters 4 and 8, appendix C."""

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
"""Columns of a table: rotation about z [rad], translation along z [m], translation along x [m], rotation about x [rad]."""
CONVENTIONS = ("standard", "modified")
"""Conventions: the motion about and along z comes first (standard), or the motion about and along x (modified)."""
_DH_TYPES = ("revolute", "prismatic")
"""Types of joints in a table."""
MAX_ANGLE = 2 * np.pi + 1e-6
"""Angle [rad] in a table above which angles are probably in degrees: a turn, and room for rounding."""
_TOLERANCE = 1e-6
"""Largest rounding error of the numbers of printed lists."""


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
    theta, d, a, alpha = _columns_in_order(table, columns)
    n = len(theta)
    if isinstance(joint_types, str):
        joint_types = [joint_types] * n
    if joint_names is None:
        joint_names = [f"joint{i + 1}" for i in range(n)]
    types = _names_per_row("joint_types", joint_types, n)
    names = _names_per_row("joint_names", joint_names, n)
    inertias = _inertias(n, masses, coms, moments_about_com)
    builder = ModelBuilder(name)
    _remark_on_degrees(builder, "theta", theta)
    _remark_on_degrees(builder, "alpha", alpha)
    builder.add_link("link0")
    for i in range(n):
        if types[i] not in _DH_TYPES:
            raise UnknownNameError.from_choices(f"joint type (of {names[i]!r})", types[i], _DH_TYPES)
        parent, link = f"link{i}", f"link{i + 1}"
        motion_z = _screw_motion(axis=2, angle=theta[i], distance=d[i])
        motion_x = _screw_motion(axis=0, angle=alpha[i], distance=a[i])
        if convention == "standard":  # the joint moves an axis frame, to which the link's frame is fixed
            axis_frame = f"axis{i + 1}"
            builder.add_link(axis_frame)
            builder.add_joint(names[i], types[i], parent, axis_frame, placement=motion_z, axis=(0, 0, 1))
            builder.add_link(link, inertias[i])
            builder.add_joint(f"{link}_fixed", "fixed", axis_frame, link, placement=motion_x)
        else:
            builder.add_link(link, inertias[i])
            placement = motion_x @ motion_z
            builder.add_joint(names[i], types[i], parent, link, placement=placement, axis=(0, 0, 1))
    tip = f"link{n}"
    if tool is not None:
        builder.add_link("tool")
        tool_pose = arguments.pose(tool, "tool")
        builder.add_joint("tool_fixed", "fixed", tip, "tool", placement=tool_pose)
        tip = "tool"
    return builder.build(tip=tip, gravity=gravity, inertia=inertia)


def _remark_on_degrees(builder: ModelBuilder, column: str, angles: Array) -> None:
    """Add a note if an angle is more than a turn, as angles in degrees usually are."""
    large_rows = np.flatnonzero(np.abs(angles) > MAX_ANGLE)
    if large_rows.size:
        row = large_rows[0]
        builder.remark(
            f"{column} of row {row + 1} of the Denavit–Hartenberg table is {printed(angles[row])}, more than a "
            f"whole turn; angles are radians? If these are degrees: np.radians({column})"
        )


def _names_per_row(argument: str, names: Sequence[str], n: int) -> list[str]:
    """Names as a list; raises ShapeError, which names the argument, unless there is one for each of n rows."""
    is_list = isinstance(names, Sequence) and not isinstance(names, str)
    has_one_per_row = is_list and len(names) == n
    if not has_one_per_row:
        raise ShapeError(
            f"{argument} is {names!r}, but the table has {n} rows: give a list with one name for each row."
        )
    return list(names)


def _screw_motion(axis: int, angle: float, distance: float) -> Array:
    """Pose after a screw motion: rotation about a coordinate axis and translation along it."""
    direction = np.eye(3)[axis]
    return se3.exp(np.concatenate([angle * direction, distance * direction]))


def _columns_in_order(table: Any, columns: Sequence[str] | None) -> list[Array]:
    """Columns theta, d, a, alpha, (n,) each; missing columns are zero."""
    column_by_name = _named_columns(table, columns)
    lengths = [len(column) for column in column_by_name.values() if column.ndim == 1]
    n = max(lengths, default=0)
    if n == 0 or any(column.shape != (n,) for column in column_by_name.values()):
        shapes = ", ".join(f"{name} {column.shape}" for name, column in column_by_name.items())
        shapes = shapes or "none"
        raise ShapeError(
            f"the columns of a Denavit–Hartenberg table have as many numbers each, one at least: {shapes}."
        )
    return [np.asarray(column_by_name.get(name, np.zeros(n)), float) for name in COLUMNS]


def _named_columns(table: Any, columns: Sequence[str] | None) -> dict[str, Array]:
    """Columns by name, of a mapping of columns, a sequence of rows that are mappings, or an array."""
    is_list_of_rows = isinstance(table, Sequence) and len(table) > 0 and all(isinstance(row, Mapping) for row in table)
    if isinstance(table, Mapping):
        _check_column_names(table)
        values = dict(table)
    elif is_list_of_rows:
        for row in table:
            _check_column_names(row)
        values = {}
        for name in COLUMNS:
            values[name] = [row.get(name, 0.0) for row in table]
    else:
        return _columns_of_array(table, columns)
    column_by_name = {}
    for name, column in values.items():
        numbers = arguments.finite(column, f"column {name!r} of the table")
        column_by_name[name] = np.atleast_1d(numbers)
    return column_by_name


def _check_column_names(names: Iterable[str]) -> None:
    """Raise UnknownNameError for a name that is not a column of a table."""
    for name in names:
        if name not in COLUMNS:
            raise UnknownNameError.from_choices("column of a Denavit–Hartenberg table", name, COLUMNS)


def _columns_of_array(table: Any, columns: Sequence[str] | None) -> dict[str, Array]:
    """Columns of an (n, 4) array by name; ``columns`` are their names in the order of the array."""
    array = arguments.finite(table, "the Denavit–Hartenberg table")
    if array.ndim != 2 or array.shape[1] != len(COLUMNS):
        raise ShapeError(f"the Denavit–Hartenberg table has shape {array.shape}, expected (n, 4).")
    if columns is None:
        raise ValueRangeError(
            "the columns of an (n, 4) table are ambiguous, since books disagree: pass columns=('theta', 'd', 'a', 'alpha') "
            "in the order it has them, or the table as a dict of named columns."
        )
    _check_column_names(columns)
    if sorted(columns) != sorted(COLUMNS):  # a repeated or missing name
        raise ValueRangeError(f"columns={tuple(columns)!r}: each of {', '.join(COLUMNS)} must be there once.")
    return dict(zip(columns, array.T, strict=True))


def _inertias(
    n: int, masses: ArrayLike | None, coms: ArrayLike | None, moments: ArrayLike | None
) -> list[SpatialInertia]:
    """Inertia of each link in its own frame; numbers that are not given are zero."""

    def array_or_zeros(argument: str, values: ArrayLike | None, shape: tuple[int, ...]) -> Array:
        if values is None:
            return np.zeros(shape)
        array = arguments.finite(values, argument)
        if array.shape != shape:
            raise ShapeError(f"{argument} has shape {array.shape}, but the table has {n} rows: expected {shape}.")
        return array

    m = array_or_zeros("masses", masses, (n,))
    c = array_or_zeros("coms", coms, (n, 3))
    I = array_or_zeros("moments_about_com", moments, (n, 3, 3))
    from_com = SpatialInertia.from_com
    return [_inertia_of_link(f"link{i + 1}", from_com, float(m[i]), c[i], I[i]) for i in range(n)]


def _inertia_of_link(link: str, build: Callable[..., SpatialInertia], *numbers: Any) -> SpatialInertia:
    """Inertia that ``build`` makes of numbers; error messages include the name of the link."""
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
    """(6, n) screw axes in the end-effector frame, as columns."""
    Mlist: Array
    """(n + 1, 4, 4) poses of link frame i in link frame i - 1; the last is that of the end-effector frame in link frame n."""
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
    tip_frame = model.frame(None)
    if tip_frame.body != len(model.bodies) - 1:
        raise ModelError(f"tip {model.tip!r} of robot {model.name!r} does not ride on the last link. Load with tip=….")
    home = np.eye(4)  # pose of the body in the base
    screws, link_frames, inertias = [], [], []
    for body in model.bodies:
        home = home @ body.placement
        screws.append(Ad(home) @ body.joint.axes[0])
        T_link = np.eye(4)  # pose of the link frame in the body's frame
        if at_com:
            _, principal_axes = body.inertia.principal()
            T_link = se3.pose(principal_axes, body.inertia.com)
        link_frames.append(home @ T_link)
        inertia_in_link_frame = body.inertia.in_frame(se3.inverse(T_link))
        inertias.append(inertia_in_link_frame.matrix)
    M = home @ tip_frame.pose  # after the loop, home is the pose of the last body
    frames = [np.eye(4), *link_frames, M]
    Mlist = np.array([se3.inverse(T_previous) @ T for T_previous, T in itertools.pairwise(frames)])
    Slist = np.array(screws).T
    Blist = Ad(se3.inverse(M)).apply(Slist.T).T  # apply takes screws as rows
    return ScrewLists(M, Slist, Blist, Mlist, np.array(inertias))


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
    S = np.asarray(Slist, float)
    placements = np.asarray(Mlist, float)
    G = np.asarray(Glist, float)
    n = S.shape[-1] if S.ndim == 2 else 0
    has_expected_shapes = S.shape == (6, n) and placements.shape == (n + 1, 4, 4) and G.shape == (n, 6, 6)
    if n == 0 or not has_expected_shapes:
        raise ShapeError(
            f"Slist {S.shape}, Mlist {placements.shape}, Glist {G.shape}: expected (6, n), (n + 1, 4, 4), (n, 6, 6). "
            "Screws are the columns of Slist; Mlist ends with the end-effector's pose in the last link."
        )
    if joint_names is None:
        joint_names = [f"joint{i + 1}" for i in range(n)]
    names = list(joint_names)
    if len(names) != n:
        raise ShapeError(f"{len(names)} joint names for {n} screws.")
    builder = ModelBuilder(name)
    builder.add_link("base")
    home = np.eye(4)  # pose of the link in the base
    parent = "base"
    for i in range(n):
        home = home @ placements[i]
        A = Ad(se3.inverse(home)) @ S[:, i]  # screw axis in its link's frame, MR section 8.3.1
        if not non_unit_screws:
            _check_unit(S[:, i], i, names[i])
        link = f"link{i + 1}"
        builder.add_link(link, _inertia_of_link(link, SpatialInertia.from_matrix, G[i]))
        joint_type = "helical" if np.any(A[:3]) else "prismatic"  # helical with any pitch, also zero
        builder.add_joint(names[i], joint_type, parent, link, placement=placements[i], axis=A, normalise_axes=False)
        parent = link
    builder.add_link("end_effector")
    builder.add_joint("end_effector_fixed", "fixed", parent, "end_effector", placement=placements[n])
    if M is not None:
        _check_home(np.asarray(M, float), home @ placements[n])
    return builder.build(tip="end_effector", gravity=gravity, inertia=inertia, snap=0.0)


def _check_unit(S: Array, i: int, joint: str) -> None:
    """Raise ModelError unless the angular part of screw i has unit length, or the linear part if the angular part is zero."""
    part = "turning part"
    length = float(np.linalg.norm(S[:3]))
    if length == 0.0:
        part = "sliding part"
        length = float(np.linalg.norm(S[3:]))
    if abs(length - 1.0) > _TOLERANCE:
        raise ModelError(
            f"screw {i + 1} (joint {joint!r}), {S.tolist()}: its {part} has length {printed(length, 8)}, not 1. Divide it by "
            "that, or pass non_unit_screws=True to keep it, knowing that its coordinate is then no angle in radians."
        )


def _check_home(M: Array, product: Array) -> None:
    """Raise an error unless the home pose M (4, 4) is the product of the poses in Mlist."""
    if M.shape != (4, 4):
        raise ShapeError(f"M has shape {M.shape}, expected (4, 4).")
    difference = float(np.abs(M - product).max())
    if not difference <= _TOLERANCE:  # also for nan
        raise ModelError(
            f"M and the product of Mlist differ by up to {printed(difference, 3)}: they must describe the same end-effector "
            "frame at zero. Pass M=None to take the product."
        )
