"""What speaks against a log, or against reading it so, each with its evidence."""

from __future__ import annotations

from collections import Counter

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.printed_numbers import number, percent, plus_minus
from ..model.model import BASE
from ..motion.single_row_glitches import LEFT_OUT
from ..typing import Array
from .column_doubts import column_doubts, drive_places, least
from .evidence import Evidence, LogDoubt, contradiction, left_unexplained
from .normal_equations import NormalEquations
from .parameter_groups import BaseParameters

_LATE = 8e-3
_UNTOLD = 0.2
_MOTION, _UNSURE = 200, 0.1
"""States of another motion, and the share of its torques that deviations of the groups may make."""
_WITHOUT = 0.5
_UNEXPLAINED_JOINT = 0.6
_NEGATIVE = 4.0
_NOTABLE = 0.1
"""Share of the torques, that is worth a word where rigid bodies with friction leave it unexplained."""
_SAID = "LOOK AGAIN: "


def doubts_of(seen: Evidence) -> tuple[LogDoubt, ...]:
    """All doubts, those that refuse the log first."""
    columns = column_doubts(seen)
    signs = {joint for doubt in columns if doubt.kind == "sign" for joint in doubt.joints}
    negative = [doubt for doubt in _negative(seen) if not signs >= set(doubt.joints)]  # said already
    unexciting = _unexciting(seen) or _untold(seen)
    found = [
        *_contradictions(seen),
        *columns,
        *([] if unexciting else _late(seen)),  # of too little, the clock's offset is a guess as well
        *([] if seen.payload_only else _without(seen)),
        *unexciting,
        *negative,
        *_unexplained(seen),
    ]
    return tuple(sorted(found, key=lambda doubt: not doubt.refuses))


def _contradictions(seen: Evidence) -> list[LogDoubt]:
    """What reading the logs found."""
    said = [note.removeprefix(_SAID) for motion in seen.motions for note in motion.notes if note.startswith(_SAID)]
    for motion in seen.motions:
        if all(note.startswith(LEFT_OUT) for note in motion.notes):  # those of files were looked at when they were read
            said += motion.contradictions
    return [contradiction(sentence) for sentence in said]


def _late(seen: Evidence) -> list[LogDoubt]:
    shift = seen.settings.shift
    if abs(shift) < _LATE:
        return []
    when = "after" if shift > 0 else "before"
    return [
        LogDoubt(
            "late",
            f"torques fit best {number(abs(shift) * 1e3, 3)} ms {when} the positions of their rows: the two were stamped by "
            "different clocks, or filtered differently. The offset is taken off.",
        )
    ]


def _without(seen: Evidence) -> list[LogDoubt]:
    """Fixed links that the file has, and the robot of the log does not carry."""
    base, model = seen.base, seen.base.unknown.model
    drives = drive_places(base)
    live = ~seen.dead

    def left_by(values: Array) -> float:
        rest = seen.tau - seen.W @ base.project(values)
        x = least(NormalEquations.of(seen.W[:, :, drives], rest))
        return float(((rest - seen.W[:, :, drives] @ x)[:, live] ** 2).sum())

    whole = left_by(base.unknown.file_values)
    names = {body.link for body in model.bodies}
    best: tuple[float, str] | None = None
    for link, frame in model.frames.items():
        G = model.link_inertias.get(link)
        if frame.body == BASE or link in names or G is None or not G.mass > 0:
            continue
        left = left_by(_less(base, frame.body, G.in_frame(frame.pose)))
        if left < _WITHOUT**2 * whole and (best is None or left < best[0]):
            best = (left, link)
    if best is None:
        return []
    size = float((seen.tau[:, live] ** 2).sum())
    return [
        LogDoubt(
            "missing-link",
            f"without {best[1]}, which is fixed to the robot in the file, the file explains the torques to "
            f"{percent(np.sqrt(best[0] / size), 3)} in place of {percent(np.sqrt(whole / size), 3)}: the robot of the log did "
            f"not carry it. Say --without {best[1]}.",
        )
    ]


def _less(base: BaseParameters, body: int, G: SpatialInertia) -> Array:
    """The file's values with an inertia taken from a body."""
    values = base.unknown.file_values.copy()
    places = base.unknown.of_bodies
    for k in np.flatnonzero((places >= 10 * body) & (places < 10 * body + 10)):
        values[k] -= G.parameters[places[k] - 10 * body]
    return values


def _unexciting(seen: Evidence) -> list[LogDoubt]:
    free = ~seen.base.held
    unknown = (seen.deviations > _UNTOLD * seen.prior.size)[free]
    if unknown.sum() <= _UNTOLD * len(unknown):
        return []
    worst = np.argsort(-(seen.deviations / seen.prior.size * free))[:3]
    names = "; ".join(seen.base.names[k].split(" ")[0] for k in worst)
    return [
        LogDoubt(
            "unexciting",
            f"the motion tells {len(unknown) - int(unknown.sum())} of {len(unknown)} groups of parameters only, least {names} "
            "and what is grouped with them: these keep the file's values. Move all joints, far, fast and slow, in both ways.",
        )
    ]


def _untold(seen: Evidence) -> list[LogDoubt]:
    """Joints whose torques the groups do not predict in another motion, as wide and as fast as the logs'."""
    base, rng = seen.base, np.random.default_rng(0)
    q = np.concatenate([motion.q for motion in seen.motions])
    wide = rng.uniform(q.min(axis=0), q.max(axis=0), (_MOTION, q.shape[1]))
    dq, ddq = (
        rng.normal(size=(_MOTION, x.shape[1])) * np.sqrt((x**2).mean(axis=0)) for x in (seen.speed, seen.acceleration)
    )
    W = base.unknown.columns(base.kept, wide, dq, ddq, seen.settings.friction_speed)
    variance = np.einsum("njk,kl,njl->j", W, seen.covariance, W)
    share = np.sqrt(np.maximum(variance, 0.0) / np.maximum(((W @ seen.x) ** 2).sum(axis=0), 1e-300))
    share[seen.dead | np.array([np.ptp(q[:, k]) == 0 for k in range(len(seen.names))])] = 0.0
    bad = [int(j) for j in np.argsort(-share) if share[j] > _UNSURE]
    if not bad:
        return []
    told = ", ".join(f"{seen.names[j]} {percent(share[j], 3)}" for j in bad[:4])
    worst = np.argsort(-((W[:, bad[0]] ** 2).sum(axis=0) * seen.covariance.diagonal()))[:3]
    least_sure = "; ".join(base.names[k].split(" ")[0] for k in worst)
    return [
        LogDoubt(
            "unexciting",
            f"of another motion, as wide and as fast, torques would be predicted no better than to: {told}. The logs are too "
            f"short, or tell too little of {least_sure} and what is grouped with them. Move these joints longer, far, fast and "
            "slow, in both ways.",
            tuple(seen.names[j] for j in bad),
        )
    ]


def _negative(seen: Evidence) -> list[LogDoubt]:
    kinds = np.array(seen.base.unknown.kinds)[seen.base.kept]
    drive = np.isin(kinds, ("coulomb", "viscous", "motor_inertia"))
    bad = np.flatnonzero(drive & (seen.x < -_NEGATIVE * seen.deviations))
    if not bad.size:
        return []
    said = ", ".join(f"{seen.base.names[k]} = {plus_minus(seen.x[k], seen.deviations[k])}" for k in bad[:4])
    joints = tuple(dict.fromkeys(seen.base.names[k].split(".")[0] for k in bad))
    count = Counter(seen.base.names[k].split(".")[0] for k in bad)
    turned = tuple(name for name, n in count.items() if n > 1)
    if turned:
        return [
            LogDoubt(
                "sign",
                f"friction and motors' inertias of {', '.join(turned)} come out negative: {said}. The torque, or the position, "
                "has the wrong sign there.",
                turned,
                refuses=True,
            )
        ]
    return [
        LogDoubt(
            "negative",
            f"friction and motors' inertias cannot be negative, and come out so: {said}. Was friction compensated by the "
            "controller, or is a unit wrong?",
            joints,
        )
    ]


def _unexplained(seen: Evidence) -> list[LogDoubt]:
    held = seen.held_out
    found = left_unexplained(held, seen.trained)
    share = held.sizes / max(float(held.sizes.sum()), 1e-300)
    bad = [
        name
        for k, (name, left) in enumerate(held.joints.items())
        if left > _UNEXPLAINED_JOINT and not seen.dead[k] and share[k] > 0
    ]
    if not found and held.all > _NOTABLE:
        worst = max(
            (name for k, name in enumerate(held.joints) if not seen.dead[k]), key=lambda name: held.joints[name]
        )
        found.append(
            LogDoubt(
                "partly-unexplained",
                f"rigid bodies with friction leave {percent(held.all, 3)} of the torques unexplained in rows held out, most at "
                f"{worst} ({percent(held.joints[worst], 3)}): elasticity, friction of another law, or torques that are not all "
                "that acts, as where the controller compensates friction.",
                (worst,),
            )
        )
    if bad and not any(doubt.refuses for doubt in found):
        said = ", ".join(f"{name} {percent(held.joints[name], 3)}" for name in bad)
        found.append(
            LogDoubt("unexplained-joint", f"torques are left unexplained in rows held out: {said}.", tuple(bad))
        )
    return found
