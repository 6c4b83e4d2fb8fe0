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
    """Line of the link's element in the file."""
    file: str = ""
    """Included file that has the link; empty for the robot file itself."""
    written: WrittenInertia | None = None
    """Inertia with the places of its numbers in the file; None if the file has none."""
    assumed: tuple[str, ...] = ()
    """Omitted parts of the inertia ("mass", "inertia") for which the format defines a value."""
    read_solids: Callable[[], LinkSolids] = LinkSolids
    """Function that reads the shapes of the link; by default the link has none."""

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
        """Finding about the link's inertia: a warning if it ``matters``, otherwise a note."""
        severity = Severity.WARNING if matters else Severity.NOTE
        if effect is None:
            effect = Effect()
        element = self.written or self  # has the line and file of the finding
        subject = f"link {self.name!r}"
        return Finding(check, severity, subject, element.line, sentence, numbers, effect, repair, element.file)


@dataclass(frozen=True, eq=False)
class ParsedFile:
    """Robot file, and its model, which may have physically impossible inertias."""

    model: Model
    format: str
    """Name of the format: urdf, mjcf or sdf; empty for a robot without a file."""
    links: Mapping[str, ParsedLink]
    """Links by name."""
    joints: Mapping[str, Element] = field(default_factory=dict)
    """Elements of the joints by name."""
    settings: tuple[str, ...] = ()
    """Sentences about settings of the file that change inertias."""
    load_errors: tuple[LoadError, ...] = ()
    """Load errors that do not prevent the checks."""

    @cached_property
    def effects(self) -> Effects:
        """Effects of changed inertias on the model's torques."""
        return Effects(self.model)

    @cached_property
    def neutral_poses(self) -> Mapping[str, Array]:
        """Poses (4, 4) of the links in the base frame at zero joint positions."""
        return frame_poses(self.model, self.model.neutral)

    @cached_property
    def span(self) -> float:
        """Diagonal of the bounding box of link frames at zero joint positions [m].

        Only heavy links count, as models for simulators have light helper bodies far away. If fewer than two links are heavy,
        all frames count.
        """
        poses = self.neutral_poses
        heavy_names = [name for name, link in self.links.items() if self.heavy(link)]
        names = [name for name in heavy_names if name in poses]
        if len(names) < 2:
            names = list(poses)
        origins = np.array([poses[name][:3, 3] for name in names])
        box_size = np.ptp(origins, axis=0)
        return float(np.linalg.norm(box_size))

    @cached_property
    def mass(self) -> float:
        """Mass of all links [kg]."""
        return float(sum(inertia.mass for inertia in self.model.link_inertias.values()))

    def moves(self, link: str) -> bool:
        """True if a joint moves the link."""
        return link in self.model.frames and self.model.frames[link].body != BASE

    def heavy(self, link: ParsedLink, share: float = 0.01) -> bool:
        """True if the link has at least this share of the robot's mass; False for robots without mass."""
        min_mass = share * self.mass
        return link.written is not None and link.written.mass >= min_mass > 0


def parse_elements(root: Element, model: Model, reader: SolidReader, path: Path | None) -> ParsedFile:
    """Parsed file of a root element that the loader accepts."""
    format_name = next(name for name, tag in FORMATS.items() if root.tag == tag)  # one has it, or loading had failed
    robot_text = TEXTS[format_name](root, model.name, path)
    links = {}
    for name, element in robot_text.links.items():
        if name not in model.link_inertias:
            continue
        written = robot_text.inertia(name)
        if format_name == "mjcf":
            written = _effective_inertia(written, model.link_inertias[name], element)
        links[name] = ParsedLink(
            name,
            element.line,
            element.file,
            written,
            assumed=robot_text.assumed_parts(name),
            read_solids=partial(_read_solids, robot_text, name, reader),
        )
    settings: list[str] = []
    if format_name == "mjcf":
        settings = [defect for defect in model.defects if _is_setting(defect)]
    return ParsedFile(model, format_name, links, robot_text.joints, tuple(settings))


def _is_setting(defect: str) -> bool:
    """True for a sentence of the MJCF reader on a setting that changes inertias."""
    return " of <compiler> change " in defect or defect.startswith("settotalmass")


def _read_solids(text: RobotText, link: str, reader: SolidReader) -> LinkSolids:
    """Solids of a link's shapes, by the name of the link."""
    return reader.read(link_shapes(text, link))


def _effective_inertia(written: WrittenInertia | None, loaded: SpatialInertia, body: Element) -> WrittenInertia | None:
    """Inertia in the file if the loader uses it; otherwise the loaded inertia, from geoms and compiler settings."""
    if written is not None:
        is_loaded = np.allclose(written.inertia.parameters, loaded.parameters, rtol=1e-9, atol=1e-12)  # up to rounding
        if is_loaded:
            return written
    return WrittenInertia.from_inertia(loaded, body.line, body.file)
