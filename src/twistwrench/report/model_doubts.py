"""What a robot's model lacks for the torques of a motion to be right, whatever the motion says: masses, and contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..listing import listed
from ..model.massless import massless_links
from ..model.model import BASE, Model
from .base_force import PeakTorque, force_in_words, missing_force
from .loaded_robot import Payload

_APART = 1e-3
"""m between two tips, from which it matters which of them carries the payload."""


def model_doubts(model: Model, joints: Sequence[PeakTorque] = ()) -> list[str]:
    """A sentence for each, without a full stop; ``joints`` are the peaks of all velocities, where the base may float."""
    said = []
    if massless := massless_links(model):
        have, their = ("have", "their") if len(massless) > 1 else ("has", "its")
        said.append(f"{listed(massless, 4)} {have} no mass, so {their} weight is missing from the torques")
    if joints and (force := missing_force(model, joints)):
        words = force_in_words(model, force)
        said.append(f"{words[0].lower()}{words[1:]}, so contacts are missing from the torques")
    return said


def assumptions(
    model: Model, payloads: Sequence[Payload], *, held: Sequence[str] = (), friction: bool = True
) -> list[str]:
    """A clause for each thing that a verdict takes for granted, the most momentous first.

    ``held`` joints are left out as a log has no column for them; ``friction`` is False where it is left out on request.
    """
    said = []
    if held:
        joints = len(model.leaders) + len(held)
        said.append(f"{len(model.leaders)} of {joints} joints checked, and {listed(held, 4)} held still")
    if any(p.mass and p.frame is None for p in payloads) and model.tip is not None:
        tip = model.frame(model.tip)
        ends = [model.frames[name] for name in model.leaves if model.frames[name].body == tip.body]
        apart = [f for f in ends if np.linalg.norm(f.pose[:3, 3] - tip.pose[:3, 3]) > _APART]
        if apart:
            said.append(f"the payload is at {model.tip}, one of {len(ends)} tips")
    weightless = [name for name in model.leaves if name in model.shaped and _without_mass(model, name)]
    if weightless:
        have = "have a shape" if len(weightless) > 1 else "has a shape"
        said.append(f"{listed(weightless, 4)} {have} and no mass, so no weight")
    if not friction and model.friction.any:
        said.append("joint friction is left out")
    return said


def _without_mass(model: Model, link: str) -> bool:
    """Whether a link that moves, as part of a body with mass, has none itself."""
    body, own = model.frames[link].body, model.link_inertias.get(link)
    return body != BASE and own is not None and not own.parameters.any() and model.bodies[body].inertia.mass > 0


def assumed_words(said: Sequence[str]) -> str:
    """How many there are, and the first of :func:`assumptions`; empty without any."""
    if not said:
        return ""
    return f"; 1 assumption: {said[0]}" if len(said) == 1 else f"; {len(said)} assumptions, first: {said[0]}"
