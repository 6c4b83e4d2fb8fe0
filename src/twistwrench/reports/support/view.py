"""Contact forces of a robot that stands, as a table and as columns of a file."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...core.answers.blocks import Line, Table, numbers, share_cell, words
from ...core.colours import Style, strong
from ...core.numbers import number, seconds
from ...core.typing import Array
from ...statics.contacts import contact_maps, tangents
from .answers import SupportAnswers
from .ground_support import GroundSupport

_MOST = 11


def imbalance(found: GroundSupport) -> Iterator[Line]:
    """Line on instants at which no forces of the ground balance, so that the torques are none of a real motion."""
    without = int((found.aground & ~found.balanced).sum())
    if without:
        count = f"{without} of {len(found.time)} instants" if len(found.time) > 1 else "this instant"
        yield Line(
            ("NO EQUILIBRIUM", strong(Style.OVER)),
            f": at {count} no forces of the ground balance. Torques there are as if the contacts stuck to it.",
        )


def contact_tables(found: GroundSupport) -> Iterator[Table]:
    """Forces of each frame in contact: the largest, how near they come to slipping, and when; none if none balance."""
    if not found.balanced.any():
        return
    partly = bool((found.aground & ~found.balanced).any())
    normals = np.array([c.normal for c in found.contacts])
    friction = np.array([c.friction for c in found.contacts])
    forces = np.where(found.balanced[:, None, None], found.balanced_forces, 0.0)
    pressing = (forces * normals).sum(axis=-1)
    sliding = np.linalg.norm(forces - pressing[..., None] * normals, axis=-1)
    frames, largest, least, sideways, shares, times = found.ground.frames, [], [], [], [], []
    for frame in frames:
        mine = found.ground.contacts_at(frame)
        total, across = pressing[:, mine].sum(axis=1), sliding[:, mine].sum(axis=1)
        carries = found.in_contact[:, mine].any(axis=1) & found.balanced
        row = int(total.argmax())
        largest.append(float(total[row]))
        least.append(float(total[carries].min()) if carries.any() else np.nan)
        sideways.append(float(across.max(initial=0.0)))
        limit = friction[mine] * pressing[:, mine]
        loaded = limit > 1e-9 * max(1.0, float(total[row]))
        share = np.where(loaded, sliding[:, mine] / np.where(loaded, limit, 1.0), 0.0)
        shares.append(float(share.max(initial=0.0)) if friction[mine].any() else np.nan)
        times.append(float(found.time[row]))
    yield Table(
        "Forces of the ground, where they balance" if partly else "Forces of the ground",
        words("frame", frames),
        numbers("pressing", largest, _newton, "N"),
        numbers("when", times, seconds, "s"),
        numbers("least", least, _newton, "N"),
        numbers("sideways", sideways, _newton, "N"),
        numbers("of friction", shares, share_cell) if found.ground.given else None,
        most=_MOST,
        by=largest,
    )


def _newton(value: float) -> str:
    return number(value, 4, decimals=6)


def further_columns(held: SupportAnswers) -> dict[str, Array]:
    """Columns (n,) of a written table beside the torques: ground, mounting and grip."""
    found = {} if held.support is None else support_columns(held.support)
    for part in (held.mounting, held.grip):
        found |= {} if part is None else part.columns()
    return found


def support_columns(found: GroundSupport) -> dict[str, Array]:
    """Columns (n,) of a written table: force and centre of pressure of each frame, margins, zero moment point."""
    names, columns = list[str](), list[Array]()
    _, points = contact_maps(found.robot, found.states.q, found.contacts)
    normals = np.array([c.normal for c in found.contacts])
    axes = tangents(normals[0])
    for frame in found.ground.frames:
        mine = found.ground.contacts_at(frame)
        force = found.balanced_forces[:, mine].sum(axis=1)
        names += [f"{frame}.{part} [N]" for part in ("fx", "fy", "fz")]
        columns += list(force.T)
        if len(mine) > 1:
            weight = (found.balanced_forces[:, mine] * normals[mine]).sum(axis=-1)
            whole = weight.sum(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                place = np.einsum("nk,nkx->nx", weight, points[:, mine]) / whole[:, None]
            names += [f"{frame}.cop_x [m]", f"{frame}.cop_y [m]"]
            columns += list((place @ axes.T).T)
        names.append(f"{frame}.contact")
        columns.append(found.in_contact[:, mine].any(axis=1).astype(float))
    names += ["speed_margin", "friction_needed", "zmp.x [m]", "zmp.y [m]"]
    columns += [found.speed, found.friction, *found.zmp.T]
    return dict(zip(names, columns, strict=True))
