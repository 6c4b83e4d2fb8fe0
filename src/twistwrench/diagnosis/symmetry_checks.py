"""Check of left and right links whose frames are mirror images: their inertias should be mirror images, too."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..core.numbers import number, percent
from ..core.typing import Array
from ..formats.edit import Edit
from ..formats.robot_text import WrittenInertia, inertia_about_com
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.inertia_checks import reasons
from .findings import Effect, FileRepair, Finding, Severity
from .options import Options
from .parsed_file import ParsedFile, ParsedLink
from .symmetric_links import SymmetricLinks, symmetric_links

_MAX_MASS_DIFFERENCE = 1e-3
"""Largest difference of masses, as a fraction of the larger mass."""
_MAX_COM_DISTANCE = 2e-3
"""Largest distance of centres of mass [m]."""
_MAX_TENSOR_DIFFERENCE = 0.05
"""Largest norm of the difference of tensors, as a fraction of the larger trace."""
_MIN_MASS_SHARE = 1e-3
"""Mass of the heavier link from which a difference is relevant, as a fraction of the robot's mass."""
_MIN_INERTIA_PERCENT = 0.5
"""Change of the mass matrix M [%] above which a difference is relevant."""
_MIN_EFFORT_PERCENT = 0.2
"""Change of torque [% of the effort limit] above which a difference is relevant."""
_MAX_NEARER_RATIO = 0.5
"""Largest ratio, of the nearer centre of mass to the farther one, of their distances from the shapes' centres."""
_MAX_BOX_GAP_SHARE = 0.05
"""Largest gap between the boxes of mirrored shapes, as a share of their diagonal, in addition to the next one."""
_MAX_BOX_GAP = 2e-3
"""Largest gap between the boxes of mirrored shapes [m]."""
_MILLI = 1e3
"""Factor of metres for millimetres."""


@dataclass(frozen=True, eq=False)
class _Copy:
    """Repair by copying one side to the other, mirrored."""

    side: str
    """Side that is copied, left or right."""
    link: ParsedLink
    """Link whose inertia changes."""
    inertia: SpatialInertia
    """New inertia of the link."""
    effect: Effect
    """Effect of the change."""


def check_mirror(robot: ParsedFile, options: Options) -> Iterator[Finding]:
    """Findings on links whose frames are mirror images at zero, but not their masses, centres of mass or tensors."""
    for pair in symmetric_links(robot):
        left = pair.left.written
        right = pair.right.written
        if left is None or right is None:
            continue
        if not (left.mass > 0 and right.mass > 0):
            continue
        image_of_left = mirror_inertia(left.inertia, pair.D)
        differences, difference_sizes = _differences(right.inertia, image_of_left)
        if not differences or _is_same_part(pair, left, right):
            continue
        effect_on_right = robot.effects.evaluate({pair.right.name: image_of_left})
        to_right = _Copy("left", pair.right, image_of_left, effect_on_right)
        image_of_right = mirror_inertia(right.inertia, pair.D.T)
        effect_on_left = robot.effects.evaluate({pair.left.name: image_of_right})
        to_left = _Copy("right", pair.left, image_of_right, effect_on_left)
        copy = _chosen_copy(to_right, to_left, options.mirror_from)
        parts_are_images = _parts_are_mirror_images(pair)
        is_heavy = robot.heavy(pair.left, _MIN_MASS_SHARE) or robot.heavy(pair.right, _MIN_MASS_SHARE)
        is_relevant = parts_are_images and is_heavy and copy.effect.reaches(_MIN_INERTIA_PERCENT, _MIN_EFFORT_PERCENT)
        reservation = "" if parts_are_images else "; one mesh serves both, or their shapes do not decide"
        yield Finding(
            check="mirror",
            severity=Severity.WARNING if is_relevant else Severity.NOTE,
            where=f"links {pair.left.name!r} and {pair.right.name!r}",
            line=left.line,
            sentence=f"they mirror each other, and their inertias do not: {'; '.join(differences)}{reservation}",
            numbers=difference_sizes,
            effect=copy.effect,
            repair=_mirror_repair(pair, copy, options.mirror_from, parts_are_images),
            file=left.file,
        )


def _is_same_part(pair: SymmetricLinks, left: WrittenInertia, right: WrittenInertia) -> bool:
    """True if the same part is mounted on both sides: equal inertias and shapes."""
    if not np.allclose(left.inertia.parameters, right.inertia.parameters, rtol=1e-3, atol=1e-9):
        return False
    return _sorted_shapes(pair.left) == _sorted_shapes(pair.right)


def _chosen_copy(to_right: _Copy, to_left: _Copy, mirror_from: str) -> _Copy:
    """Copy from the side that the user trusts; without one, the copy with the larger effect."""
    if mirror_from:
        return to_right if mirror_from == to_right.side else to_left
    return max(to_right, to_left, key=lambda copy: copy.effect.inertia_percent + copy.effect.effort_percent)


def _mirror_repair(pair: SymmetricLinks, copy: _Copy, mirror_from: str, parts_are_images: bool) -> FileRepair:
    """Repair by a copy; it edits the file only if the user trusts a side and the parts are mirror images."""
    edits: tuple[Edit, ...] = ()
    if not mirror_from:
        sentence = f"copy one side to the other, mirrored; {_evidence(pair)}"
    elif reasons(copy.inertia):
        sentence = f"the {copy.side} one, which cannot exist itself: repair it first"
    else:
        sentence = f"the {copy.side} one, mirrored"
        if copy.link.written is not None and parts_are_images:
            edits = copy.link.written.edits(copy.inertia)
    return FileRepair("mirror", sentence, {copy.link.name: copy.inertia}, edits)


def _evidence(pair: SymmetricLinks) -> str:
    """Sentence that names the side whose centre of mass is much nearer to the centre of its shapes, if there is one."""
    no_evidence = "the file does not determine which is meant"
    left_distance = _com_distance(pair.left)
    right_distance = _com_distance(pair.right)
    if left_distance is None or right_distance is None:
        return no_evidence
    smaller = min(left_distance, right_distance)
    larger = max(left_distance, right_distance)
    if smaller > _MAX_NEARER_RATIO * larger or larger - smaller < _MAX_COM_DISTANCE:
        return no_evidence
    side = "left" if left_distance < right_distance else "right"
    distance_text = f"{number(_MILLI * smaller, 2)} mm from theirs, not {number(_MILLI * larger, 2)}"
    return f"the shapes speak for the {side} one, whose centre of mass is {distance_text}"


def _com_distance(link: ParsedLink) -> float | None:
    """Distance of a link's centre of mass from the centre of its shapes as uniform solids [m]; None without solids."""
    if link.written is None or not link.shapes.complete or link.shapes.uniform is None:
        return None
    return float(np.linalg.norm(link.written.com - link.shapes.uniform.com))


def mirror_inertia(inertia: SpatialInertia, D: Array) -> SpatialInertia:
    """Inertia of the mirrored body; the matrix D (3, 3) maps the points of the body to their mirror images."""
    return inertia_about_com(inertia.mass, D @ inertia.com, D @ inertia.moment_about_com @ D.T)


def _differences(inertia: SpatialInertia, image: SpatialInertia) -> tuple[list[str], Mapping[str, float]]:
    """Texts of too large differences of an inertia from the other side's mirror image, and the sizes of all differences."""
    mass_difference = abs(inertia.mass - image.mass) / max(inertia.mass, image.mass)
    com_distance = float(np.linalg.norm(inertia.com - image.com))
    I = inertia.moment_about_com
    I_image = image.moment_about_com
    larger_trace = max(I.trace(), I_image.trace(), 1e-300)  # above 0, also for point masses
    tensor_difference = float(np.linalg.norm(I - I_image) / larger_trace)
    texts = []
    if mass_difference > _MAX_MASS_DIFFERENCE:
        texts.append(f"masses {number(image.mass)} and {number(inertia.mass)} kg")
    if com_distance > _MAX_COM_DISTANCE:
        texts.append(f"centres of mass {number(_MILLI * com_distance, 3)} mm apart")
    if tensor_difference > _MAX_TENSOR_DIFFERENCE:
        texts.append(f"tensors {percent(tensor_difference, 2)} of their trace apart")
    sizes = {"mass_share": mass_difference, "com_distance": com_distance, "tensor_share": tensor_difference}
    return texts, sizes


def _parts_are_mirror_images(pair: SymmetricLinks) -> bool:
    """True if the parts are mirror images: different mesh files on the sides, or a mesh with a negative scale.

    If all shapes were read, their boxes must also be mirrored.
    """
    left = pair.left
    right = pair.right
    left_files, left_signs = _meshes(left)
    right_files, right_signs = _meshes(right)
    if not left_files or not right_files:
        return False
    if left_files == right_files and left_signs == right_signs:
        return False
    if not (left.shapes.complete and right.shapes.complete):
        return True
    image_of_left = left.shapes.points @ pair.D.T
    points = right.shapes.points
    tolerance = _MAX_BOX_GAP_SHARE * left.shapes.diagonal + _MAX_BOX_GAP
    low_gaps = np.abs(image_of_left.min(axis=0) - points.min(axis=0))
    high_gaps = np.abs(image_of_left.max(axis=0) - points.max(axis=0))
    return bool(max(low_gaps.max(), high_gaps.max()) <= tolerance)


def _meshes(link: ParsedLink) -> tuple[set[str], set[float]]:
    """Mesh files of a link, and the signs of their scales: -1 for a mirrored mesh."""
    meshes = [shape for shape in link.shapes.shapes if shape.kind == "mesh"]
    files = {mesh.mesh for mesh in meshes}
    signs = {float(np.prod(np.sign(mesh.sizes))) for mesh in meshes}
    return files, signs


def _sorted_shapes(link: ParsedLink) -> list[tuple[str, tuple[float, ...], str]]:
    """Kind, sizes and mesh file of each shape, in an order that is the same for equal parts."""
    return sorted((shape.kind, shape.sizes, shape.mesh) for shape in link.shapes.shapes)
