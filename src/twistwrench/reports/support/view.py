"""Contact forces of a robot that stands, as a table and as columns of a file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...core.answers.blocks import Line, Table, numbers, share_cell, words
from ...core.colours import Style, strong
from ...core.numbers import number, seconds
from ...core.typing import Array
from ...motion.bounds import first_largest
from ...statics.contacts import contact_maps, tangents
from .answers import SupportAnswers
from .ground_support import GroundSupport

_MAX_ROWS = 11
"""Largest number of rows of the table in a short report."""
_MIN_FRICTION_SHARE = 1e-9
"""Largest possible friction, relative to the largest normal force, below which a contact is not loaded."""


def imbalance(found: GroundSupport) -> Iterator[Line]:
    """Line on instants at which no forces of the ground balance the robot; nothing if there are none."""
    unbalanced_count = int((found.aground & ~found.balanced).sum())
    if unbalanced_count:
        instants = f"{unbalanced_count} of {len(found.time)} instants"
        if len(found.time) == 1:
            instants = "this instant"
        yield Line(
            ("NO EQUILIBRIUM", strong(Style.OVER)),
            f": at {instants} no forces of the ground balance. Torques there are as if the contacts stuck to it.",
        )


def contact_tables(found: GroundSupport) -> Iterator[Table]:
    """Table of the forces on each frame in contact, and of the friction that they use; none if no forces balance."""
    if not found.balanced.any():
        return
    detail = ""
    if (found.aground & ~found.balanced).any():
        detail = ", where they balance"
    forces_by_frame = [_forces_on_frame(found, frame) for frame in found.ground.frames]
    max_pressing = [forces.max_pressing for forces in forces_by_frame]
    friction_column = None
    if found.ground.given:
        shares = [forces.share_of_friction for forces in forces_by_frame]
        friction_column = numbers("of friction", shares, share_cell)
    yield Table(
        "Forces of the ground",
        words("frame", found.ground.frames),
        numbers("pressing", max_pressing, _force_text, "N"),
        numbers("when", [forces.time for forces in forces_by_frame], seconds, "s"),
        numbers("least", [forces.min_pressing for forces in forces_by_frame], _force_text, "N"),
        numbers("sideways", [forces.max_sideways for forces in forces_by_frame], _force_text, "N"),
        friction_column,
        detail=detail,
        most=_MAX_ROWS,
        by=max_pressing,  # a short report has the frames with the largest forces
    )


class _FrameForces(NamedTuple):
    """Forces of the ground on one frame along a motion [N]."""

    max_pressing: float
    """Largest normal force of all contacts of the frame together."""
    min_pressing: float
    """Smallest normal force at instants at which the frame carries; nan if it never does."""
    max_sideways: float
    """Largest sum of the tangential forces of the contacts."""
    share_of_friction: float
    """Largest share of its friction that a contact uses; nan without friction."""
    time: float
    """Time of the largest normal force [s]."""


def _forces_on_frame(found: GroundSupport, frame: str) -> _FrameForces:
    """Forces of the ground on one frame, at the instants at which forces balance."""
    contacts = found.ground.contacts_at(frame)
    normals = found.ground.normals[contacts]
    friction = found.ground.frictions[contacts]
    forces = np.where(found.balanced[:, None, None], found.balanced_forces[:, contacts], 0.0)
    normal_forces = (forces * normals).sum(axis=-1)
    tangential_forces = np.linalg.norm(forces - normal_forces[..., None] * normals, axis=-1)
    pressing = normal_forces.sum(axis=1)
    peak_row = int(first_largest(pressing))
    max_pressing = float(pressing[peak_row])
    carries = found.in_contact[:, contacts].any(axis=1) & found.balanced
    min_pressing = math.nan
    if carries.any():
        min_pressing = float(pressing[carries].min())
    max_share = math.nan
    if friction.any():
        max_tangential = friction * normal_forces
        is_loaded = max_tangential > _MIN_FRICTION_SHARE * max(1.0, max_pressing)  # at least 1 N
        divisor = np.where(is_loaded, max_tangential, 1.0)
        shares = np.where(is_loaded, tangential_forces / divisor, 0.0)
        max_share = float(shares.max(initial=0.0))
    max_sideways = float(tangential_forces.sum(axis=1).max(initial=0.0))
    peak_time = float(found.time[peak_row])
    return _FrameForces(max_pressing, min_pressing, max_sideways, max_share, peak_time)


def _force_text(force: float) -> str:
    """Force with four digits [N]."""
    return number(force, 4, decimals=6)


def further_columns(held: SupportAnswers) -> dict[str, Array]:
    """Columns (n,) of a written table beside the torques: ground, mounting and grip."""
    columns: dict[str, Array] = {}
    if held.support is not None:
        columns |= support_columns(held.support)
    if held.mounting is not None:
        columns |= held.mounting.columns()
    if held.grip is not None:
        columns |= held.grip.columns()
    return columns


def support_columns(found: GroundSupport) -> dict[str, Array]:
    """Columns (n,) of a written table: force and centre of pressure of each frame, margins, zero moment point."""
    columns: dict[str, Array] = {}
    _, points = contact_maps(found.robot, found.states.q, found.contacts)
    normals = found.ground.normals
    ground_axes = tangents(normals[0])  # x and y on the ground, (2, 3)
    for frame in found.ground.frames:
        contacts = found.ground.contacts_at(frame)
        forces = found.balanced_forces[:, contacts]
        force_on_frame = forces.sum(axis=1)  # (n, 3)
        for axis, component in zip("xyz", force_on_frame.T, strict=True):
            columns[f"{frame}.f{axis} [N]"] = component
        if len(contacts) > 1:
            normal_forces = (forces * normals[contacts]).sum(axis=-1)
            pressing = normal_forces.sum(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):  # NaN where the frame does not carry
                centre = np.einsum("nk,nkx->nx", normal_forces, points[:, contacts]) / pressing[:, None]
            centre_on_ground = centre @ ground_axes.T  # (n, 2)
            columns[f"{frame}.cop_x [m]"], columns[f"{frame}.cop_y [m]"] = centre_on_ground.T
        columns[f"{frame}.contact"] = found.in_contact[:, contacts].any(axis=1).astype(float)
    columns["speed_margin"] = found.speed
    columns["friction_needed"] = found.friction
    columns["zmp.x [m]"], columns["zmp.y [m]"] = found.zmp.T
    return columns
