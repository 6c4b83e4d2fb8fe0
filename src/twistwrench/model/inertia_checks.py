"""Checks of the inertias of moving bodies: physical consistency, and masses that are missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.numbers import printed
from ..errors import InertiaError
from ..typing import Array
from .description import ModelNote
from .model import BASE, Body, Model

_LISTED = 3
"""Number of impossible bodies that an error describes; many have one cause most often."""
INERTIA_POLICIES = ("error", "accept", "repair")
"""Policies for a physically impossible moving body: refuse it, keep it, or take the nearest consistent inertia."""


def reasons(inertia: SpatialInertia, size: float = 0.0) -> list[str]:
    """Violated conditions of physical consistency, in words with amounts. Rotational inertia without mass is checked by itself.

    Files use it for rotors whose mass is counted elsewhere; a remark is made of it, never an error. ``size`` [kg m²] is
    that of the moments it was made of, which rounding goes by.
    """
    if inertia.mass == 0 and inertia.parameters[4:].any():
        return SpatialInertia.from_com(1.0, np.zeros(3), inertia.moment_about_origin).defects()
    return inertia.defects(size=size)


def judge(model: Model, policy: str, link: Callable[[str], str]) -> tuple[Model, list[str]]:
    """Judge each moving body, fixed links fused, and remark on single links; ``link`` returns a link's name in messages.

    Raises :class:`~twistwrench.InertiaError` under the policy ``error``, listing every body that cannot exist.
    """
    remarks: list[str] = []
    refused: list[str] = []
    bodies = list(model.bodies)
    clear = _clear([body.inertia for body in bodies])
    doubtful = [i for i, body in enumerate(bodies) if not clear[i]]
    bad = {i: found for i in doubtful if (found := reasons(bodies[i].inertia, moved_moments(model, i)))}
    for i, found in bad.items():
        text = f"{_who(model, i, link)} cannot exist: {'; '.join(found)}"
        if policy == "error":
            refused.append(text)
        elif policy == "accept":
            remarks.append(f"{text}; accepted as it is")
        else:
            bodies[i], change = _repaired(bodies[i])
            remarks.append(f"{text}; repaired, {change}")
    if refused:
        more = f" {len(refused) - _LISTED} more cannot exist either." if len(refused) > _LISTED else ""
        raise InertiaError(
            f"{'. '.join(refused[:_LISTED])}.{more} Correct the numbers, or load with inertia='repair' to take the nearest "
            "valid ones, or with inertia='accept' to keep them."
        )
    remarks.extend(_on_links(model, set(bad), link))
    return replace(model, bodies=tuple(bodies)) if bad else model, remarks


def _clear(inertias: Sequence[SpatialInertia]) -> Array:
    """True for inertias that are consistent beyond doubt, without a tolerance, (n,): all at once, as few are not."""
    p = np.array([G.parameters for G in inertias]).reshape(-1, 10)
    with np.errstate(all="ignore"):
        m, h = p[:, 0], p[:, 1:4]
        c = h / m[:, None]
        I = p[:, [4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(-1, 3, 3)
        I = I - (h * c).sum(axis=1)[:, None, None] * np.eye(3) + h[:, :, None] * c[:, None, :]
        known = np.isfinite(I).all(axis=(1, 2)) & (m > 0)
        low, middle, high = np.linalg.eigvalsh(np.where(known[:, None, None], I, 0.0)).T
    return np.asarray(known & (low > 0) & (low + middle >= high))


def moved_moments(model: Model, index: int) -> float:
    """Largest moments [kg m²] of the sums and differences in a fused body: each link's, moved along its own levers."""
    total = 0.0
    for name, frame in model.frames.items():
        if frame.body == index:
            G, p = model.link_inertias[name], frame.pose[:3, 3]
            total += abs(float(G.moment_about_origin.trace())) + float(G.mass * p @ p)
    return total


def _who(model: Model, index: int, link: Callable[[str], str]) -> str:
    """Name of the body by its links: those at fault, if any, else all with a mass."""
    members = [n for n, f in model.frames.items() if f.body == index and model.link_inertias[n].parameters.any()]
    guilty = [n for n in members if reasons(model.link_inertias[n])] or members
    fused = f", with the {len(members)} links fused to one body," if len(members) > 1 else ""
    return f"{' and '.join(map(link, guilty))}{fused} moved by joint {model.bodies[index].joint.name!r}"


def _repaired(body: Body) -> tuple[Body, str]:
    inertia = body.inertia
    if inertia.mass == 0:  # only the rotational part is mended: without mass it has no centre to be about
        stand_in = SpatialInertia.from_com(1.0, np.zeros(3), inertia.moment_about_origin).nearest_consistent()
        near = SpatialInertia.from_com(0.0, np.zeros(3), stand_in.moment_about_com)
    else:
        near = inertia.nearest_consistent()
    most = np.abs(near.parameters - inertia.parameters).max()
    return replace(body, inertia=near), f"changing its moments by {printed(most, 3)} kg m² at most"


def _on_links(model: Model, bad: set[int], link: Callable[[str], str]) -> list[str]:
    """Remarks on links that are doubtful by themselves and have no effect."""
    remarks: list[str] = []
    clear = _clear(list(model.link_inertias.values()))
    for (name, inertia), fine in zip(model.link_inertias.items(), clear.tolist(), strict=True):
        body = model.frames[name].body
        moments = inertia.parameters[4:]
        if inertia.mass == 0 and moments.any():
            remarks.append(ModelNote(link(name), "has rotational inertia but no mass"))
        # Through the parallel-axis theorem a zero comes back as rounding of the moments about the origin.
        elif inertia.mass and not fine and np.abs(inertia.moment_about_com).max() <= 1e-14 * np.abs(moments).max():
            remarks.append(ModelNote(link(name), "has mass but zero inertia, as a point mass has"))
        if body not in bad and not fine and (found := reasons(inertia)):
            effect = "is fused into a physically consistent body" if body >= 0 else "does not move"
            remarks.append(ModelNote(link(name), f"cannot exist by itself ({'; '.join(found)}) but {effect}"))
    return remarks


# ── Zero-inertia checks: moving links without mass


def massless_links(model: Model) -> tuple[str, ...]:
    """Moving links without mass that must have one, in document order.

    A moving body, with all links fixed to it, that has neither mass nor moments is named

    * if nothing that it carries has a mass either: its joint then moves nothing;
    * if it has a shape in the file (``model.shaped``): what can be seen has a weight;
    * if no link of the file has a shape, and the next joint stands away from its own: something has to reach there.

    Other massless bodies join several joints to one, such as the three of a ball joint or those of a base that slides
    and turns, and are left alone. So are bodies with moments and no mass, such as rotors whose mass is counted with
    their housing. A massless frame on a fixed joint is part of the body it is fixed to.
    """
    n = len(model.bodies)
    has = [bool(body.inertia.parameters.any()) for body in model.bodies]
    carries, reaches, shaped = list(has), [False] * n, [False] * n
    for i in reversed(range(n)):  # parents come before children
        body = model.bodies[i]
        if body.parent != BASE:
            carries[body.parent] |= carries[i]
            reaches[body.parent] |= max(map(abs, body.placement[:3, 3].tolist())) > 1e-9  # more than rounding
    for link, frame in model.frames.items():
        if link in model.shaped and frame.body != BASE:
            shaped[frame.body] = True
    real = shaped if model.shaped else reaches
    named = {body.link for i, body in enumerate(model.bodies) if not has[i] and (not carries[i] or real[i])}
    return tuple(link for link in model.frames if link in named)
