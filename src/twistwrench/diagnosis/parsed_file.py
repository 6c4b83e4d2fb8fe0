"""Parsed robot file for the doctor: links and joints, with the places of their numbers in the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from ..core.typing import Array
from ..formats import FORMATS
from ..formats.robot_text import TEXTS, RobotText, WrittenInertia
from ..formats.xml import Element
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.legs import frame_poses
from ..mechanics.model.model import BASE, Model
from ..shapes.reader import link_shapes
from ..shapes.solids import LinkSolids, SolidReader
from .findings import Effect, Effects, FileRepair, Finding, Severity
from .load_errors import LoadError


@dataclass(frozen=True, eq=False)
class ParsedLink:
    """Link in the file."""

    name: str
    line: int
    file: str = ""
    written: WrittenInertia | None = None
    assumed: tuple[str, ...] = ()
    """Missing parts of its inertia (mass, inertia) for which the format defines a value."""
    read_solids: Callable[[], LinkSolids] = LinkSolids

    @cached_property
    def shapes(self) -> LinkSolids:
        """Shapes of the link; meshes are read at the first access."""
        return self.read_solids()

    def finding(
        self,
        check: str,
        matters: bool,
        sentence: str,
        numbers: Mapping[str, float],
        effect: Effect | None = None,
        repair: FileRepair | None = None,
    ) -> Finding:
        """Finding about the link's inertia; a warning if ``matters``."""
        severity = Severity.WARNING if matters else Severity.NOTE
        element = self.written or self
        return Finding(
            check, severity, f"link {self.name!r}", element.line, sentence, numbers, effect or Effect(), repair, element.file
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ParsedFile:
    """Robot file and its model, loaded with physically impossible inertias accepted."""

    model: Model
    format: str
    """"urdf", "mjcf", "sdf", or empty for a robot without a file."""
    links: Mapping[str, ParsedLink]
    joints: Mapping[str, Element] = field(default_factory=dict)
    settings: tuple[str, ...] = ()
    """Sentences about changes of inertias by settings of the file."""
    load_errors: tuple[LoadError, ...] = ()
    """Load errors that do not prevent the checks."""

    @cached_property
    def effects(self) -> Effects:
        """Effects of changed inertias."""
        return Effects(self.model)

    @cached_property
    def neutral_poses(self) -> Mapping[str, Array]:
        """Poses (4, 4) of the links in the base frame at zero joint positions."""
        return frame_poses(self.model, self.model.neutral)

    @cached_property
    def span(self) -> float:
        """Diagonal of the bounding box of link frames at zero joint positions [m].

        The frames are those of links with at least 1 % of the mass, as simulators park helper bodies far away. With fewer than
        two such links, all frames count.
        """
        poses = self.neutral_poses
        names = [name for name, link in self.links.items() if name in poses and self.heavy(link)]
        if len(names) < 2:
            names = list(poses)
        origins = np.array([poses[name][:3, 3] for name in names])
        return float(np.linalg.norm(np.ptp(origins, axis=0)))

    @cached_property
    def mass(self) -> float:
        """Mass of all links [kg]."""
        return float(sum(inertia.mass for inertia in self.model.link_inertias.values()))

    def moves(self, link: str) -> bool:
        """True if a joint moves the link."""
        return link in self.model.frames and self.model.frames[link].body != BASE

    def heavy(self, link: ParsedLink, share: float = 0.01) -> bool:
        """True if the link has at least this share of the robot's mass."""
        return link.written is not None and link.written.mass >= share * self.mass > 0


def parse_elements(root: Element, model: Model, reader: SolidReader, path: Path | None) -> ParsedFile:
    """Links and joints of a root element that the loader accepts."""
    form = next(name for name, tag in FORMATS.items() if root.tag == tag)
    text = TEXTS[form](root, model.name, path)
    links = {}
    for name, element in text.links.items():
        if name in model.link_inertias:
            written = text.inertia(name)
            if form == "mjcf":
                written = _effective_inertia(written, model.link_inertias[name], element)
            solids = partial(_read_solids, text, name, reader)
            links[name] = ParsedLink(name, element.line, element.file, written, text.assumed_parts(name), solids)
    settings: list[str] = []
    if form == "mjcf":
        settings = [d for d in model.defects if " of <compiler> change " in d or d.startswith("settotalmass")]
    return ParsedFile(model, form, links, text.joints, tuple(settings))


def _read_solids(text: RobotText, link: str, reader: SolidReader) -> LinkSolids:
    return reader.read(link_shapes(text, link))


def _effective_inertia(written: WrittenInertia | None, final: SpatialInertia, body: Element) -> WrittenInertia | None:
    """Inertia in the file if the loader uses it; otherwise the loader's, from geoms and compiler settings."""
    if written is not None and np.allclose(written.inertia.parameters, final.parameters, rtol=1e-9, atol=1e-12):
        return written
    return WrittenInertia.from_inertia(final, body.line, body.file)
