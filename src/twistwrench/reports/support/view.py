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


def imbalance(found: GroundSupport) -> Iterator[Line]:
    """Line on instants at which no forces of the ground balance, so that the torques are none of a real motion."""
    unbalanced = int((found.aground & ~found.balanced).sum())
    if unbalanced:
        instants = f"{unbalanced} of {len(found.time)} instants"
        if len(found.time) == 1:
            instants = "this instant"
        yield Line(
            ("NO EQUILIBRIUM", strong(Style.OVER)),
            f": at {instants} no forces of the ground balance. Torques there are as if the contacts stuck to it.",
        )


def contact_tables(found: GroundSupport) -> Iterator[Table]:
    """Forces of each frame in contact: the largest, how near they come to slipping, and when; none if none balance."""
    if not found.balanced.any():
        return
    title, slip_column = "Forces of the ground", None
    if (found.aground & ~found.balanced).any():
        title += ", where they balance"
    rows = [_frame_forces(found, frame) for frame in found.ground.frames]
    largest = [row.largest for row in rows]
    if found.ground.given:
        slip_column = numbers("of friction", [row.share_of_friction for row in rows], share_cell)
    yield Table(
        title,
        words("frame", found.ground.frames),
        numbers("pressing", largest, _newton, "N"),
        numbers("when", [row.time for row in rows], seconds, "s"),
        numbers("least", [row.least for row in rows], _newton, "N"),
        numbers("sideways", [row.sideways for row in rows], _newton, "N"),
        slip_column,
        most=_MAX_ROWS,
        by=largest,
    )


class _FrameForces(NamedTuple):
    """Forces of the ground on one frame along a motion [N]."""

    largest: float
    least: float
    """Over the instants at which the frame carries; nan if it never does."""
    sideways: float
    share_of_friction: float
    """Largest share of the friction that a contact uses; nan without friction."""
    time: float
    """Time of the largest force [s]."""


def _frame_forces(found: GroundSupport, frame: str) -> _FrameForces:
    contacts = found.ground.contacts_at(frame)
    normals, friction = found.ground.normals[contacts], found.ground.frictions[contacts]
    forces = np.where(found.balanced[:, None, None], found.balanced_forces[:, contacts], 0.0)
    pressing = (forces * normals).sum(axis=-1)
    sliding = np.linalg.norm(forces - pressing[..., None] * normals, axis=-1)
    total = pressing.sum(axis=1)
    row = int(total.argmax())
    carrying = found.in_contact[:, contacts].any(axis=1) & found.balanced
    least, share = math.nan, math.nan
    if carrying.any():
        least = float(total[carrying].min())
    if friction.any():
        limits = friction * pressing
        loaded = limits > 1e-9 * max(1.0, float(total[row]))
        shares = np.where(loaded, sliding / np.where(loaded, limits, 1.0), 0.0)
        share = float(shares.max(initial=0.0))
    sideways = float(sliding.sum(axis=1).max(initial=0.0))
    return _FrameForces(float(total[row]), least, sideways, share, float(found.time[row]))


def _newton(value: float) -> str:
    return number(value, 4, decimals=6)


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
        force = found.balanced_forces[:, contacts].sum(axis=1)
        columns[f"{frame}.fx [N]"], columns[f"{frame}.fy [N]"], columns[f"{frame}.fz [N]"] = force.T
        if len(contacts) > 1:
            pressing = (found.balanced_forces[:, contacts] * normals[contacts]).sum(axis=-1)
            total = pressing.sum(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                centre = np.einsum("nk,nkx->nx", pressing, points[:, contacts]) / total[:, None]
            columns[f"{frame}.cop_x [m]"], columns[f"{frame}.cop_y [m]"] = (centre @ axes.T).T
        columns[f"{frame}.contact"] = found.in_contact[:, contacts].any(axis=1).astype(float)
    columns["speed_margin"], columns["friction_needed"] = found.speed, found.friction
    columns["zmp.x [m]"], columns["zmp.y [m]"] = found.zmp.T
    return columns
