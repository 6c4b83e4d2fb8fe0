"""Left against right: inertias that are not each other's mirror image where the parts are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...bodies.inertia import SpatialInertia
from ...core.printed_numbers import number, percent
from ...model.inertia_checks import reasons
from ...typing import Array
from ..described import DescribedLink, DescribedRobot, about_com
from ..findings import Edit, FileRepair, Finding, Severity
from ..pairs import Pair, pairs_of
from .options import Options

_MASS, _COM, _TENSOR = 1e-3, 2e-3, 0.05
"""Share of the mass, metres, share of the trace: less is no difference."""
_HEAVY = 1e-3
"""Share of the robot's mass that one of the two has at least."""
_MATTERS, _TORQUE = 0.5, 0.2
"""% of M and of the effort from which a difference matters."""


def check_mirror(robot: DescribedRobot, options: Options) -> Iterator[Finding]:
    """Pairs whose frames mirror each other at zero, and whose masses, centres of mass or tensors do not."""
    for pair in pairs_of(robot):
        a, b = pair.left.written, pair.right.written
        if a is None or b is None or not (a.mass > 0 and b.mass > 0):
            continue
        image = mirrored(a.inertia, pair.D)
        said, numbers = _differences(b.inertia, image)
        if not said or _same_part(pair):
            continue
        copies = {"left": (pair.right, image), "right": (pair.left, mirrored(b.inertia, pair.D.T))}
        effects = {side: robot.effects.of({link.name: G}) for side, (link, G) in copies.items()}
        side = options.mirror_from or max(effects, key=lambda s: effects[s].inertia_percent + effects[s].effort_percent)
        link, wanted = copies[side]
        parts = _parts_mirrored(pair)
        heavy = robot.heavy(pair.left, _HEAVY) or robot.heavy(pair.right, _HEAVY)
        matters = parts and heavy and effects[side].reaches(_MATTERS, _TORQUE)
        more = "" if parts else "; one mesh serves both, or their shapes do not tell"
        edits: tuple[Edit, ...] = ()
        if options.mirror_from and reasons(wanted):
            sentence = f"the {side} one, which cannot exist itself: repair it first"
        elif options.mirror_from:
            sentence = f"the {side} one, mirrored"
            edits = link.written.edits_to(wanted) if link.written is not None and parts else ()
        else:
            sentence = f"copy one side to the other, mirrored; {_evidence(pair)}"
        yield Finding(
            "mirror", Severity.WARNING if matters else Severity.NOTE,
            f"links {pair.left.name!r} and {pair.right.name!r}", a.line,
            f"they mirror each other, and their inertias do not: {'; '.join(said)}{more}", numbers, effects[side],
            FileRepair("mirror", sentence, {link.name: wanted}, edits), a.file,
        )  # fmt: skip


def _evidence(pair: Pair) -> str:
    """For which side the shapes speak: where the centre of mass is much nearer to that of the shapes."""
    unknown = "the file does not tell which is meant"
    away = []
    for link in (pair.left, pair.right):
        if link.written is None or not link.shapes.complete or link.shapes.uniform is None:
            return unknown
        away.append(float(np.linalg.norm(link.written.com - link.shapes.uniform.com)))
    if min(away) > 0.5 * max(away) or max(away) - min(away) < _COM:
        return unknown
    side, near, far = ("left" if away[0] < away[1] else "right"), 1e3 * min(away), 1e3 * max(away)
    return (
        f"the shapes speak for the {side} one, whose centre of mass is {number(near, 2)} mm from theirs, not "
        f"{number(far, 2)}"
    )


def mirrored(inertia: SpatialInertia, D: Array) -> SpatialInertia:
    """The inertia of the body's mirror image; D (3, 3) is what its points are multiplied by."""
    return about_com(inertia.mass, D @ inertia.com, D @ inertia.moment_about_com @ D.T)


def _differences(given: SpatialInertia, image: SpatialInertia) -> tuple[list[str], dict[str, float]]:
    mass = abs(given.mass - image.mass) / max(given.mass, image.mass)
    com = float(np.linalg.norm(given.com - image.com))
    I, J = given.moment_about_com, image.moment_about_com
    tensor = float(np.linalg.norm(I - J) / max(I.trace(), J.trace(), 1e-300))
    said = [f"masses {number(image.mass)} and {number(given.mass)} kg"] if mass > _MASS else []
    said += [f"centres of mass {number(1e3 * com, 3)} mm apart"] if com > _COM else []
    said += [f"tensors {percent(tensor, 2)} of their trace apart"] if tensor > _TENSOR else []
    return said, {"mass_share": mass, "com_distance": com, "tensor_share": tensor}


def _same_part(pair: Pair) -> bool:
    """Whether the same part is mounted twice: the same shapes at the same places, and the same numbers."""
    a, b = pair.left.written, pair.right.written
    if a is None or b is None:
        return False
    same = np.allclose(a.inertia.parameters, b.inertia.parameters, rtol=1e-3, atol=1e-9)
    return bool(same and _shapes(pair.left) == _shapes(pair.right))


def _parts_mirrored(pair: Pair) -> bool:
    """Whether the parts themselves are mirror images: another mesh file on each side, or a mesh scaled by a negative number.

    Where all shapes were read, their boxes must mirror each other too.
    """
    a, b = pair.left, pair.right
    files = [{spec.file for spec in link.shapes.specs if spec.kind == "mesh"} for link in (a, b)]
    signs = [{np.prod(np.sign(spec.sizes)) for spec in link.shapes.specs if spec.kind == "mesh"} for link in (a, b)]
    if not files[0] or not files[1] or (files[0] == files[1] and signs[0] == signs[1]):
        return False
    if not (a.shapes.complete and b.shapes.complete):
        return True
    image, points = a.shapes.points @ pair.D.T, b.shapes.points
    allowed = 0.05 * a.shapes.diagonal + 2e-3
    low, high = np.abs(image.min(axis=0) - points.min(axis=0)), np.abs(image.max(axis=0) - points.max(axis=0))
    return bool(max(low.max(), high.max()) <= allowed)


def _shapes(link: DescribedLink) -> list[tuple[str, tuple[float, ...], str]]:
    return sorted((spec.kind, spec.sizes, spec.file) for spec in link.shapes.specs)
