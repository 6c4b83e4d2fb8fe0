"""What a robot's model lacks for the torques of a motion to be right, whatever the motion says: masses, and contacts."""

from __future__ import annotations

from collections.abc import Sequence

from ..listing import listed
from ..model.massless import massless_links
from ..model.model import Model
from .base_force import PeakTorque, force_in_words, missing_force


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
