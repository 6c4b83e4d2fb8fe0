"""Checks of the inertias of moving bodies: physical consistency, and missing masses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...core.errors import InertiaError
from ...core.numbers import printed
from ...core.text import argument
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from .description import ModelNote
from .model import BASE, Body, Model

_MAX_LISTED_BODIES = 3
"""Number of impossible bodies that an error describes; several often have the same cause."""
INERTIA_POLICIES = ("error", "accept", "repair")
"""Policies for a moving body with a physically impossible inertia: error, keep it, or use the nearest consistent inertia."""


_PLANAR = (
    " A thin rod has the same moment about both axes across it: diag([0, I, I]) if it lies along x. In a planar problem the "
    "second one has no effect on the result."
)
"""Addition to the error on a body with a moment about one axis only."""


def reasons(inertia: SpatialInertia, size: float = 0.0) -> list[str]:
    """Violated conditions of physical consistency, as text with amounts; without mass, only the rotational inertia is checked.

    Files use such inertias for rotors whose mass is counted elsewhere; they cause a warning, never an error. ``size``
    [kg m²] is the size of the summed moments, which determines rounding errors.
    """
    if inertia.mass == 0 and inertia.parameters[4:].any():
        return SpatialInertia.from_com(1.0, np.zeros(3), inertia.moment_about_origin).defects()
    return inertia.defects(size=size)


def judge(model: Model, policy: str, link: Callable[[str], str]) -> tuple[Model, list[str]]:
    """Check each moving body with its fixed links, and note doubtful single links; ``link`` returns a link's name in messages.

    Raises :class:`~twistwrench.InertiaError` under the policy ``error``, listing every inconsistent body.
    """
    remarks: list[str] = []
    refused: list[str] = []
    planar = False
    bodies = list(model.bodies)
    impossible: set[int] = set()
    for i in np.flatnonzero(~_consistent_mask([body.inertia for body in bodies])).tolist():
        inertia = bodies[i].inertia
        violations = reasons(inertia, moved_moments(model, i))
        if not violations:
            continue
        impossible.add(i)
        text = f"{_body_label(model, i, link)} cannot exist: {'; '.join(violations)}"
        if policy == "error":
            refused.append(text)
            planar = planar or _has_one_moment(inertia)
        elif policy == "accept":
            remarks.append(f"{text}; accepted as it is")
        else:
            bodies[i], change = _repair(bodies[i])
            remarks.append(f"{text}; repaired, {change}")
    if refused:
        raise InertiaError(_refusal(refused, planar))
    remarks.extend(_link_remarks(model, impossible, link))
    return replace(model, bodies=tuple(bodies)) if impossible else model, remarks


def _has_one_moment(inertia: SpatialInertia) -> bool:
    """True for a body with a moment about one axis only, as in a planar problem."""
    if inertia.mass <= 0:
        return False
    A, B, C = inertia.principal()[0]
    return bool(max(abs(A), abs(B)) < 1e-9 * C)


def _refusal(refused: Sequence[str], planar: bool) -> str:
    """Error message on inconsistent bodies: the first ones, the number of others, and the remedies."""
    addition = ""
    if len(refused) > _MAX_LISTED_BODIES:
        addition = f" {len(refused) - _MAX_LISTED_BODIES} more cannot exist either."
    if planar:
        addition += _PLANAR
    return (
        f"{'. '.join(refused[:_MAX_LISTED_BODIES])}.{addition} Correct the numbers, or load with "
        f"{argument('inertia', 'repair')} to take the nearest "
        f"valid ones, or with {argument('inertia', 'accept')} to keep them."
    )


def _consistent_mask(inertias: Sequence[SpatialInertia]) -> Array:
    """Mask (n,) of inertias that are consistent without a tolerance; a vectorised check that settles most bodies."""
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
    """Largest moments [kg m²] in the sums and differences of a body with fixed links, each moved along its levers."""
    total = 0.0
    for name, frame in model.frames.items():
        if frame.body == index:
            G, p = model.link_inertias[name], frame.pose[:3, 3]
            total += abs(float(G.moment_about_origin.trace())) + float(G.mass * p @ p)
    return total


def _body_label(model: Model, index: int, link: Callable[[str], str]) -> str:
    """Name of the body by its links: the inconsistent ones, if any, else all with a mass."""
    members = [n for n, f in model.frames.items() if f.body == index and model.link_inertias[n].parameters.any()]
    named = [n for n in members if reasons(model.link_inertias[n])] or members
    fused = f", with the {len(members)} links fused to one body," if len(members) > 1 else ""
    return f"{' and '.join(map(link, named))}{fused} moved by joint {model.bodies[index].joint.name!r}"


def _repair(body: Body) -> tuple[Body, str]:
    inertia = body.inertia
    if inertia.mass == 0:  # without mass there is no centre of mass
        stand_in = SpatialInertia.from_com(1.0, np.zeros(3), inertia.moment_about_origin).nearest_consistent()
        near = SpatialInertia.from_com(0.0, np.zeros(3), stand_in.moment_about_com)
    else:
        near = inertia.nearest_consistent()
    change = np.abs(near.parameters - inertia.parameters).max()
    return replace(body, inertia=near), f"changing its moments by {printed(change, 3)} kg m² at most"


def _link_remarks(model: Model, impossible: set[int], link: Callable[[str], str]) -> list[str]:
    """Notes on links that are inconsistent by themselves without effect on their body."""
    remarks: list[str] = []
    consistent = _consistent_mask(list(model.link_inertias.values()))
    for (name, inertia), is_consistent in zip(model.link_inertias.items(), consistent.tolist(), strict=True):
        body = model.frames[name].body
        moments = inertia.parameters[4:]
        if inertia.mass == 0 and moments.any():
            remarks.append(ModelNote(link(name), "has rotational inertia but no mass"))
        if is_consistent:
            continue
        # The parallel-axis theorem turns zeros into rounding errors of the moments about the origin.
        if inertia.mass and np.abs(inertia.moment_about_com).max() <= 1e-14 * np.abs(moments).max():
            remarks.append(ModelNote(link(name), "has mass but zero inertia, as a point mass has"))
        violations = reasons(inertia)
        if violations and body not in impossible:
            effect = "is fused into a physically consistent body" if body >= 0 else "does not move"
            remarks.append(ModelNote(link(name), f"cannot exist by itself ({'; '.join(violations)}) but {effect}"))
    return remarks


# ── Missing masses: moving links without mass


def massless_links(model: Model) -> tuple[str, ...]:
    """Moving links that lack a mass they should have, in document order.

    A moving body with all its fixed links, but without mass and moments, is named

    * if nothing that it carries has a mass either: its joint then moves no inertia;
    * if it has a shape in the file (``model.shaped``): a visible body has a mass;
    * if no link of the file has a shape, and the next joint is at a distance: a physical link is between them.

    Other massless bodies combine several joints to one, such as the three of a ball joint or of a planar base; they are
    accepted. So are bodies with moments but no mass, such as rotors whose mass is counted with their housing. A
    massless frame on a fixed joint is part of the body it is fixed to.
    """
    n = len(model.bodies)
    has_inertia = [bool(body.inertia.parameters.any()) for body in model.bodies]
    carries, reaches, shaped = list(has_inertia), [False] * n, [False] * n
    for i in reversed(range(n)):  # children before parents
        body = model.bodies[i]
        if body.parent != BASE:
            carries[body.parent] |= carries[i]
            reaches[body.parent] |= max(map(abs, body.placement[:3, 3].tolist())) > 1e-9  # above rounding errors
    for link, frame in model.frames.items():
        if link in model.shaped and frame.body != BASE:
            shaped[frame.body] = True
    physical = shaped if model.shaped else reaches
    massless = {
        body.link for i, body in enumerate(model.bodies) if not has_inertia[i] and (not carries[i] or physical[i])
    }
    return tuple(link for link in model.frames if link in massless)
