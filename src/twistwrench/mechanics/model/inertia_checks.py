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
"""Number of impossible bodies that an error describes; the others often have the same cause."""
INERTIA_POLICIES = ("error", "accept", "repair")
"""Policies for a moving body with a physically impossible inertia: raise an error, keep it, use the nearest consistent one."""
_MAX_ROUNDING = 1e-9
"""Rounding error of moments, relative to the largest, and of lengths [m]."""
_MAX_STEINER_ROUNDING = 1e-14
"""Rounding error that the parallel-axis theorem leaves of zero moments, relative to the moments about the origin."""


_PLANAR = (
    " A thin rod has the same moment about both axes across it: diag([0, I, I]) if it lies along x. In a planar problem the "
    "second one has no effect on the result."
)
"""Last sentences of the error on a body with a moment about one axis only."""


def reasons(inertia: SpatialInertia, size: float = 0.0) -> list[str]:
    """Violated conditions of physical consistency, as text with amounts; empty for a consistent inertia.

    Without mass, only the rotational inertia is checked: files give moments without mass to rotors whose mass is counted
    elsewhere. ``size`` [kg m²] is the size of the moments whose sum the inertia is; it determines rounding errors.
    """
    moments = inertia.parameters[4:]
    if inertia.mass == 0 and moments.any():
        with_mass = SpatialInertia.from_com(1.0, np.zeros(3), inertia.moment_about_origin)
        return with_mass.defects()
    return inertia.defects(size=size)


def judge(model: Model, policy: str, link: Callable[[str], str]) -> tuple[Model, list[str]]:
    """Check each moving body with its fixed links, then single links; returns the model and notes.

    Under the policy ``repair``, the returned model has consistent bodies. Under the policy ``error``, an inconsistent body
    raises :class:`~twistwrench.InertiaError`. ``link`` returns a link's name in messages.
    """
    remarks: list[str] = []
    errors: list[str] = []
    has_planar_body = False
    bodies = list(model.bodies)
    impossible_bodies: set[int] = set()
    is_consistent = _consistent_mask([body.inertia for body in bodies])
    for i in np.flatnonzero(~is_consistent).tolist():
        inertia = bodies[i].inertia
        violations = reasons(inertia, moved_moments(model, i))
        if not violations:
            continue
        impossible_bodies.add(i)
        label = _body_label(model, i, link)
        sentence = f"{label} cannot exist: {'; '.join(violations)}"
        if policy == "error":
            errors.append(sentence)
            has_planar_body = has_planar_body or _has_one_moment(inertia)
        elif policy == "accept":
            remarks.append(f"{sentence}; accepted as it is")
        else:
            bodies[i], change_text = _repair(bodies[i])
            remarks.append(f"{sentence}; repaired, {change_text}")
    if errors:
        raise InertiaError(_error_message(errors, has_planar_body))
    remarks.extend(_link_remarks(model, impossible_bodies, link))
    if impossible_bodies:
        model = replace(model, bodies=tuple(bodies))
    return model, remarks


def _has_one_moment(inertia: SpatialInertia) -> bool:
    """True for a body with a moment about one axis only, as in a planar problem."""
    if inertia.mass <= 0:
        return False
    moments, _ = inertia.principal()
    A, B, C = moments  # ascending
    return bool(max(abs(A), abs(B)) < _MAX_ROUNDING * C)


def _error_message(errors: Sequence[str], has_planar_body: bool) -> str:
    """Error message on inconsistent bodies: the first ones, the number of others, and the remedies."""
    addition = ""
    if len(errors) > _MAX_LISTED_BODIES:
        addition = f" {len(errors) - _MAX_LISTED_BODIES} more cannot exist either."
    if has_planar_body:
        addition += _PLANAR
    listed_errors = ". ".join(errors[:_MAX_LISTED_BODIES])
    repair_option = argument("inertia", "repair")
    accept_option = argument("inertia", "accept")
    return (
        f"{listed_errors}.{addition} Correct the numbers, or load with {repair_option} to take the nearest "
        f"valid ones, or with {accept_option} to keep them."
    )


def _consistent_mask(inertias: Sequence[SpatialInertia]) -> Array:
    """Mask (n,) of inertias that are consistent without a tolerance: a fast check, after which few bodies are left."""
    parameters = np.array([G.parameters for G in inertias]).reshape(-1, 10)
    with np.errstate(all="ignore"):
        m, h = parameters[:, 0], parameters[:, 1:4]
        c = h / m[:, None]
        tensor_entries = [4, 5, 7, 5, 6, 8, 7, 8, 9]  # xx xy xz, xy yy yz, xz yz zz in the order of the parameters
        I_origin = parameters[:, tensor_entries].reshape(-1, 3, 3)
        # Steiner's theorem: I_com = I_origin - h·c 1 + h c'
        I_com = I_origin - (h * c).sum(axis=1)[:, None, None] * np.eye(3) + h[:, :, None] * c[:, None, :]
        has_tensor = np.isfinite(I_com).all(axis=(1, 2)) & (m > 0)
        finite_I_com = np.where(has_tensor[:, None, None], I_com, 0.0)
        low, middle, high = np.linalg.eigvalsh(finite_I_com).T  # principal moments
    return np.asarray(has_tensor & (low > 0) & (low + middle >= high))


def moved_moments(model: Model, index: int) -> float:
    """Size [kg m²] of the moments that add up to a body's inertia: of its links, each moved to the body's frame."""
    total = 0.0
    for name, frame in model.frames.items():
        if frame.body == index:
            G = model.link_inertias[name]
            p = frame.pose[:3, 3]
            size = abs(float(G.moment_about_origin.trace()))
            total += size + float(G.mass * p @ p)
    return total


def _body_label(model: Model, index: int, link: Callable[[str], str]) -> str:
    """Names of the body's inconsistent links, or of all its links with an inertia; and the joint that moves the body."""
    links_of_body = [name for name, frame in model.frames.items() if frame.body == index]
    members = [name for name in links_of_body if model.link_inertias[name].parameters.any()]
    inconsistent = [name for name in members if reasons(model.link_inertias[name])]
    names_text = " and ".join(map(link, inconsistent or members))
    fused_text = f", with the {len(members)} links fused to one body," if len(members) > 1 else ""
    return f"{names_text}{fused_text} moved by joint {model.bodies[index].joint.name!r}"


def _repair(body: Body) -> tuple[Body, str]:
    """Body with the nearest consistent inertia, and the change as text."""
    inertia = body.inertia
    if inertia.mass == 0:  # without mass there is no centre of mass, so a mass is assumed and removed again
        with_mass = SpatialInertia.from_com(1.0, np.zeros(3), inertia.moment_about_origin)
        consistent = with_mass.nearest_consistent()
        nearest = SpatialInertia.from_com(0.0, np.zeros(3), consistent.moment_about_com)
    else:
        nearest = inertia.nearest_consistent()
    change = np.abs(nearest.parameters - inertia.parameters).max()
    return replace(body, inertia=nearest), f"changing its moments by {printed(change, 3)} kg m² at most"


def _link_remarks(model: Model, impossible_bodies: set[int], link: Callable[[str], str]) -> list[str]:
    """Notes on links that are inconsistent by themselves, if their body is not among the impossible ones."""
    remarks: list[str] = []
    consistent_mask = _consistent_mask(list(model.link_inertias.values()))
    for (name, inertia), is_consistent in zip(model.link_inertias.items(), consistent_mask.tolist(), strict=True):
        body = model.frames[name].body
        moments = inertia.parameters[4:]
        if inertia.mass == 0 and moments.any():
            remarks.append(ModelNote(link(name), "has rotational inertia but no mass"))
        if is_consistent:
            continue
        # The parallel-axis theorem turns zeros into rounding errors of the moments about the origin.
        max_zero = _MAX_STEINER_ROUNDING * np.abs(moments).max()
        if inertia.mass and np.abs(inertia.moment_about_com).max() <= max_zero:
            remarks.append(ModelNote(link(name), "has mass but zero inertia, as a point mass has"))
        violations = reasons(inertia)  # may be empty, with its tolerances
        if violations and body not in impossible_bodies:
            effect = "does not move" if body == BASE else "is fused into a physically consistent body"
            remarks.append(ModelNote(link(name), f"cannot exist by itself ({'; '.join(violations)}) but {effect}"))
    return remarks


# ── Missing masses: moving links without mass


def massless_links(model: Model) -> tuple[str, ...]:
    """Moving links that lack a mass they should have, in document order.

    A moving body, with all its fixed links, that has neither mass nor moments lacks a mass in three cases:

    * Nothing that it carries has a mass either: its joint then moves no inertia.
    * It has a shape in the file (``model.shaped``): a visible body has a mass.
    * No link of the file has a shape, and the next joint is at a distance: a physical link is between them.

    Other massless bodies combine several joints to one, for example three joints to a ball joint or to a planar base; they are
    accepted. Bodies with moments but no mass are accepted, too, such as rotors whose mass is counted with their housing. A
    massless frame on a fixed joint is part of the body to which it is fixed.
    """
    n = len(model.bodies)
    has_inertia = [bool(body.inertia.parameters.any()) for body in model.bodies]
    carries_inertia = list(has_inertia)
    has_distant_joint = [False] * n
    has_shape = [False] * n
    for i in reversed(range(n)):  # children before parents
        body = model.bodies[i]
        if body.parent != BASE:
            distance = float(np.abs(body.placement[:3, 3]).max())  # along the farthest axis
            carries_inertia[body.parent] |= carries_inertia[i]
            has_distant_joint[body.parent] |= distance > _MAX_ROUNDING
    for link, frame in model.frames.items():
        if link in model.shaped and frame.body != BASE:
            has_shape[frame.body] = True
    is_physical = has_shape if model.shaped else has_distant_joint
    massless: set[str] = set()
    for i, body in enumerate(model.bodies):
        lacks_inertia = is_physical[i] or not carries_inertia[i]
        if lacks_inertia and not has_inertia[i]:
            massless.add(body.link)
    return tuple(link for link in model.frames if link in massless)
