"""Doubts about a robot's model and assumptions of a verdict: masses, contacts, a base that nothing holds, tips, friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, Protocol

import numpy as np

from ..core.answers.sentences import sentence
from ..core.gravity import STRENGTH
from ..core.numbers import number, percent
from ..core.text import Argument, listed, spell
from ..core.verdict import Reason, Word
from ..mechanics.model.inertia_checks import massless_links
from ..mechanics.model.legs import hanging_base
from ..mechanics.model.limits import Limits
from ..mechanics.model.model import BASE, Model
from .load_case import Payload, without_velocity_limit

SHARE = 0.05
"""Force, as a share of the robot's weight, up to which errors of masses and derived accelerations explain it."""
SHARE_OF_WEIGHT_ON_EARTH = 0.001
"""Force, as a share of the robot's weight on earth, up to which rounding and noise explain it under weak gravity."""
SURE_FORCE = 5.0
"""Number of standard deviations that are subtracted from a force, so that the remaining force is certain."""
_MAX_LISTED = 4
"""Largest number of names in a sentence."""


class PeakTorque(Protocol):
    """Largest torque of one velocity entry."""

    @property
    def peak(self) -> float: ...  # noqa: D102  with its sign
    @property
    def uncertainty(self) -> float: ...  # noqa: D102  its standard deviation
    @property
    def unit(self) -> str: ...  # noqa: D102  N m or N


def base_velocities(model: Model) -> list[int]:
    """Indices of the velocities of bases without a drive."""
    indices: list[int] = []
    for body in model.leaders:
        if body.parent == BASE and not body.joint.driven:
            indices += range(body.v_index, body.v_index + body.joint.nv)
    return indices


def missing_force(model: Model, joints: Sequence[PeakTorque]) -> float:
    """Largest external force that a floating base needs [N]; 0 if negligible or without a floating base."""
    largest_force = 0.0
    for k in base_velocities(model):
        if joints[k].unit == "N":
            certain_force = abs(joints[k].peak) - SURE_FORCE * joints[k].uncertainty
            largest_force = max(largest_force, certain_force)
    weight_on_earth = STRENGTH * model.moving_mass
    negligible_force = max(SHARE * _weight(model), SHARE_OF_WEIGHT_ON_EARTH * weight_on_earth)
    if largest_force <= negligible_force:
        return 0.0
    return largest_force


def force_in_words(model: Model, force: float) -> str:
    """Sentence on the missing force at the base."""
    weight = _weight(model)
    share_text = ""
    if weight:
        share_text = sentence("of weight", share=percent(force / weight))
    return sentence("force", force=number(force), share=share_text)


def force_remark(model: Model, joints: Sequence[PeakTorque]) -> str:
    """Meaning and remedy of a missing force; empty without one."""
    force = missing_force(model, joints)
    if not force:
        return ""
    return sentence("contact", words=force_in_words(model, force))


def _weight(model: Model) -> float:
    """Weight of the moving links [N] under the robot's gravity."""
    return model.moving_mass * float(np.linalg.norm(model.gravity))


BaseRemedy = Literal["hanging", "hanging, feet", "hangs, payload"]
"""Sentence on a base in the air: for commands without options for feet, with them, and for the largest payload."""


def base_doubts(model: Model, remedy: BaseRemedy = "hanging") -> list[str]:
    """Reason to be unsure of the torques of a legged robot whose base nothing holds; empty for other robots."""
    base = hanging_base(model)
    if base is None:
        return []
    remedy_text = sentence(remedy)
    text = sentence("held", base=base.link, remedy=remedy_text)
    return [Reason(text, remedy_text)]


def hanging_excess(excess: str) -> str:
    """Sentence on an excess that is uncertain, since nothing holds the base of the legged robot."""
    return sentence("hangs", word=str(Word.OVER_LIMIT), excess=excess)


def open_loop_excess(excess: str) -> str:
    """Sentence on an excess that is uncertain, since the joint is in a loop that is left open."""
    return sentence("opened", word=str(Word.OVER_LIMIT), excess=excess)


_MIN_DISTANCE_OF_TIPS = 1e-3
"""Distance [m] between tips of one body above which it matters at which of them the payload is."""


def open_loop_joints(model: Model) -> list[str]:
    """Names of the velocities in loops that the file describes and that are left open.

    Their torques would change with the force of the closure.
    """
    velocity_indices: set[int] = set()
    for closure in model.closures.values():
        body_a = model.frame(closure.frame_a).body
        body_b = model.frame(closure.frame_b).body
        bodies_in_loop = model.ancestors(body_a) ^ model.ancestors(body_b)  # above one of the frames only
        for i in bodies_in_loop:
            body = model.bodies[i]
            velocity_indices.update(range(body.v_index, body.v_index + body.joint.nv))
    return [model.velocity_names[k] for k in sorted(velocity_indices)]


def model_warnings(model: Model, joints: Sequence[PeakTorque] = ()) -> list[str]:
    """Warnings about massless links, a missing force at the base and open loops, as sentences without a full stop.

    ``joints`` are the peaks of all velocities; without them, the force at the base is not judged.
    """
    warnings = []
    massless = massless_links(model)
    if massless:
        names = listed(massless, _MAX_LISTED)
        if len(massless) > 1:
            warnings.append(f"{names} have no mass, so their weight is missing from the torques")
        else:
            warnings.append(f"{names} has no mass, so its weight is missing from the torques")
    if joints:
        force = missing_force(model, joints)
        if force:
            force_text = force_in_words(model, force)
            force_clause = f"{force_text[0].lower()}{force_text[1:]}"  # follows other words
            warnings.append(sentence("no contact", words=force_clause))
    loop_joints = open_loop_joints(model)
    if loop_joints:
        first_loop, *other_loops = model.closures
        first_closure = model.closures[first_loop]
        loops_text = first_loop
        if other_loops:
            loops_text += f" and {len(other_loops)} more"
        arguments = f"{first_closure.frame_a!r}, {first_closure.frame_b!r}, {first_closure.rows!r}"
        joints_text = listed(loop_joints, _MAX_LISTED)
        warnings.append(sentence("open loops", loops=loops_text, joints=joints_text, given=arguments))
    return warnings


def assumptions(
    model: Model,
    payloads: Sequence[Payload],
    *,
    friction: bool = True,
    unjudged: Limits | None = None,
    mass: str | None = None,
) -> list[str]:
    """Assumptions of a verdict as clauses, the most consequential first.

    ``friction`` is False if the user leaves friction out. ``unjudged`` are limits that the verdict ignores: those of
    acceleration and jerk are listed. ``mass`` is a text that stands for the payload's mass; None for its number.
    """
    clauses = []
    if unjudged:
        clauses += _limit_clauses(model, unjudged)
    if model.locked:
        joint_count = len(model.leaders) + len(model.locked)
        locked_joints = listed(model.locked, _MAX_LISTED)
        clauses.append(f"{len(model.leaders)} of {joint_count} joints checked, and {locked_joints} held still")
    masses_at_tip = [payload.mass for payload in payloads if payload.frame is None]
    if any(masses_at_tip) and model.tip is not None:
        tip_distances = _tip_distances(model, model.tip)
        if max(tip_distances, default=0.0) > _MIN_DISTANCE_OF_TIPS:
            mass_text = mass or number(sum(masses_at_tip))
            remedy = spell(Argument("tip"))
            clauses.append(f"{mass_text} kg at {model.tip} (one of {len(tip_distances)} tips; {remedy})")
    weightless_links = [name for name in model.leaves if name in model.shaped and _lacks_mass(model, name)]
    if weightless_links:
        verb = "have" if len(weightless_links) > 1 else "has"
        clauses.append(f"{listed(weightless_links, _MAX_LISTED)} {verb} a shape and no mass, so no weight")
    if not friction and model.friction.any:
        clauses.append("joint friction is left out")
    return clauses


def _tip_distances(model: Model, name: str) -> list[float]:
    """Distances [m] from the tip ``name`` to all tips on its body, including itself."""
    tip = model.frame(name)
    distances = []
    for leaf in model.leaves:
        frame = model.frames[leaf]
        if frame.body == tip.body:
            distances.append(float(np.linalg.norm(frame.pose[:3, 3] - tip.pose[:3, 3])))
    return distances


def _limit_clauses(model: Model, unjudged: Limits) -> list[str]:
    """Clauses on joints without a velocity limit, and on limits that are not judged."""
    clauses = []
    unlimited_joints = without_velocity_limit(model, unjudged)
    if unlimited_joints:
        names_text = ""
        if len(unlimited_joints) < len(model.velocity_names):
            names_text = f" of {listed(unlimited_joints, _MAX_LISTED)}"
        clauses.append(f"no velocity limit{names_text} is known")
    kinds = [kind for kind in ("acceleration", "jerk") if np.isfinite(getattr(unjudged, kind)).any()]
    if kinds:
        clauses.append(f"limits of {' and '.join(kinds)} are not judged")
    return clauses


def _lacks_mass(model: Model, link: str) -> bool:
    """True if a moving link lacks mass although its body has some."""
    body_index = model.frames[link].body
    inertia = model.link_inertias.get(link)
    if body_index == BASE or inertia is None or inertia.parameters.any():
        return False
    return model.bodies[body_index].inertia.mass > 0


def assumed_words(clauses: Sequence[str]) -> str:
    """Text with the number of assumptions and the first of them; empty if there are none."""
    if not clauses:
        return ""
    if len(clauses) == 1:
        return f". Assumption: {clauses[0]}"
    return f". {len(clauses)} assumptions, the first: {clauses[0]}"


def friction_words(model: Model, *, counted: bool) -> str:
    """Text on friction for headings; ``counted`` is True if torques include it."""
    if not counted:
        return "without friction"
    return "with friction" if model.friction.any else "no friction, as its file gives none"
