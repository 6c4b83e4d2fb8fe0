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
from ...statics.contacts import contact_maps, tangents
from .answers import SupportAnswers
from .ground_support import GroundSupport

_MAX_ROWS = 11
"""Largest number of rows of the table in a short report."""


def imbalance(found: GroundSupport) -> Iterator[Line]:
    """Line on instants at which no forces of the ground balance, so that the robot cannot move so."""
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
    title = "Forces of the ground"
    if (found.aground & ~found.balanced).any():
        title += ", where they balance"
    rows = [_forces_on_frame(found, frame) for frame in found.ground.frames]
    largest = [row.largest for row in rows]
    friction_column = None
    if found.ground.given:
        friction_column = numbers("of friction", [row.share_of_friction for row in rows], share_cell)
    yield Table(
        title,
        words("frame", found.ground.frames),
        numbers("pressing", largest, _force_text, "N"),
        numbers("when", [row.time for row in rows], seconds, "s"),
        numbers("least", [row.least for row in rows], _force_text, "N"),
        numbers("sideways", [row.sideways for row in rows], _force_text, "N"),
        friction_column,
        most=_MAX_ROWS,
        by=largest,
    )


class _FrameForces(NamedTuple):
    """Forces of the ground on one frame along a motion [N]."""

    largest: float
    """Largest pressing force."""
    least: float
    """Least pressing force at instants at which the frame carries; nan if it never does."""
    sideways: float
    """Largest sum of the tangential forces of the contacts."""
    share_of_friction: float
    """Largest share of the friction that a contact uses; nan without friction."""
    time: float
    """Time of the largest force [s]."""


def _forces_on_frame(found: GroundSupport, frame: str) -> _FrameForces:
    """Forces of the ground on one frame, at the instants at which forces balance."""
    contacts = found.ground.contacts_at(frame)
    normals = found.ground.normals[contacts]
    friction = found.ground.frictions[contacts]
    forces = np.where(found.balanced[:, None, None], found.balanced_forces[:, contacts], 0.0)
    normal_forces = (forces * normals).sum(axis=-1)
    tangential_forces = np.linalg.norm(forces - normal_forces[..., None] * normals, axis=-1)
    pressing = normal_forces.sum(axis=1)
    peak_row = int(pressing.argmax())
    carrying = found.in_contact[:, contacts].any(axis=1) & found.balanced
    least = share = math.nan
    if carrying.any():
        least = float(pressing[carrying].min())
    if friction.any():
        limits = friction * normal_forces
        is_loaded = limits > 1e-9 * max(1.0, float(pressing[peak_row]))
        shares = np.where(is_loaded, tangential_forces / np.where(is_loaded, limits, 1.0), 0.0)
        share = float(shares.max(initial=0.0))
    sideways = float(tangential_forces.sum(axis=1).max(initial=0.0))
    return _FrameForces(float(pressing[peak_row]), least, sideways, share, float(found.time[peak_row]))


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
    axes = tangents(normals[0])
    for frame in found.ground.frames:
        contacts = found.ground.contacts_at(frame)
        forces = found.balanced_forces[:, contacts]
        columns[f"{frame}.fx [N]"], columns[f"{frame}.fy [N]"], columns[f"{frame}.fz [N]"] = forces.sum(axis=1).T
        if len(contacts) > 1:
            normal_forces = (forces * normals[contacts]).sum(axis=-1)
            pressing = normal_forces.sum(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):  # NaN where the frame does not carry
                centre = np.einsum("nk,nkx->nx", normal_forces, points[:, contacts]) / pressing[:, None]
            columns[f"{frame}.cop_x [m]"], columns[f"{frame}.cop_y [m]"] = (centre @ axes.T).T
        columns[f"{frame}.contact"] = found.in_contact[:, contacts].any(axis=1).astype(float)
    columns["speed_margin"] = found.speed
    columns["friction_needed"] = found.friction
    columns["zmp.x [m]"], columns["zmp.y [m]"] = found.zmp.T
    return columns
