"""Parsed robot file for the doctor: links, joints, load errors, symmetric links; readers of URDF, SDF and MJCF."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from ..core.errors import ModelError, ModelWarning, RobotFileError, TwistWrenchError, UnknownNameError
from ..core.files import as_path
from ..core.text import bounded_message
from ..core.typing import Array
from ..formats import FORMATS, load_model, usd_path
from ..formats.robot_file import RobotFile, file_of
from ..formats.robot_text import TEXTS, RobotText, WrittenInertia
from ..formats.source import is_text
from ..formats.urdf import add_joint, add_link
from ..formats.xacro import EXPAND
from ..formats.xml import Element, parse
from ..mechanics.algorithms.recursion import base_poses, joint_poses
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.builder import ModelBuilder
from ..mechanics.model.model import BASE, Model
from ..robot import Robot
from ..robot.load import is_name
from ..robots.finding import robot_file
from ..shapes.meshes import MeshFiles
from ..shapes.reader import link_shapes
from ..shapes.solids import LinkSolids, SolidReader
from .findings import Effect, Effects, FileRepair, Finding, Severity

# ── All load errors of a URDF

_MOST = 20


@dataclass(frozen=True)
class LoadError:
    """One reason why a file cannot be loaded."""

    where: str
    line: int
    sentence: str
    mimic: bool = False
    """True if only the leader of a mimic joint is missing; such joints can be loaded as independent."""

    def __str__(self) -> str:
        return self.sentence


def load_errors(root: Element) -> list[LoadError]:
    """All load errors of a ``<robot>``, by link and joint; empty for other formats."""
    if root.tag != "robot":
        return []
    found = [*_each_by_itself(root), *_ends(root), *_leaders(root)]
    return found[:_MOST]


def _each_by_itself(root: Element) -> Iterator[LoadError]:
    builder = ModelBuilder("robot")
    for add, tag in ((add_link, "link"), (add_joint, "joint")):
        for element in root.all(tag):
            try:
                add(builder, element)
            except TwistWrenchError as error:
                yield LoadError(f"{tag} {element.attributes.get('name', '')!r}", element.line, str(error))


def _ends(root: Element) -> Iterator[LoadError]:
    """Missing parents and children, and links with two parents."""
    links = [link.attributes.get("name", "").strip() for link in root.all("link")]
    children: Counter[str] = Counter()
    for joint in root.all("joint"):
        for end in ("parent", "child"):
            try:
                element = joint.child(end)
            except ModelError:
                continue
            name = element.attributes.get("link", "").strip() if element is not None else ""
            if not name:
                continue
            where = f"joint {joint.attributes.get('name', '')!r}"
            if name not in links:
                missing = UnknownNameError.from_choices("link", name, links)
                yield LoadError(where, joint.line, f"the {end} of {joint} is not there: {missing}")
            children[name] += end == "child"
            if end == "child" and children[name] == 2:
                text = f"{joint} gives link {name!r} a second parent. A robot must be a tree."
                yield LoadError(where, joint.line, text)


def _leaders(root: Element) -> Iterator[LoadError]:
    joints = [joint.attributes.get("name", "").strip() for joint in root.all("joint")]
    for joint in root.all("joint"):
        for mimic in joint.all("mimic") if joint.attributes.get("type") != "fixed" else ():
            leader = mimic.attributes.get("joint", "").strip()
            if leader and leader not in joints:
                missing = str(UnknownNameError.from_choices("joint", leader, joints)).partition(" Known:")[0]
                said = f"it mimics a joint that is not there: {missing}"
                yield LoadError(f"joint {joint.attributes.get('name', '')!r}", joint.line, said, mimic=True)


# ── Links and joints, with the places of their numbers in the file


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
        place, severity = self.written or self, Severity.WARNING if matters else Severity.NOTE
        where, effect = f"link {self.name!r}", effect or Effect()
        return Finding(check, severity, where, place.line, sentence, numbers, effect, repair, place.file)


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
        model = self.model
        bodies = base_poses(model, joint_poses(model, model.neutral))
        return {
            name: np.asarray(frame.pose if frame.body == BASE else bodies[frame.body] @ frame.pose)
            for name, frame in model.frames.items()
        }

    @cached_property
    def span(self) -> float:
        """Diagonal of the bounding box of link frames at zero joint positions [m].

        The frames are those of links with at least 1 % of the mass, as simulators park helper bodies far away. With fewer than
        two such links, all frames count.
        """
        poses = self.neutral_poses
        heavy = [poses[name] for name, link in self.links.items() if name in poses and self.heavy(link)]
        places = np.array([T[:3, 3] for T in (heavy if len(heavy) > 1 else poses.values())])
        return float(np.linalg.norm(np.ptp(places, axis=0)))

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


# ── Symmetric links: mirrored pairs at zero joint positions

_SIDES = {"left": "right", "l": "r", "fl": "fr", "rl": "rr", "hl": "hr", "bl": "br", "lf": "rf", "lh": "rh", "lr": "rr"}
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^A-Za-z0-9]+")
_PLANES = (np.diag([1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0]))
"""Reflections of the base frame: left and right along y, and along x."""
_ALIKE = 1e-3
"""Tolerance of mirrored frames, in m and in entries of rotations."""


@dataclass(frozen=True, eq=False)
class SymmetricLinks:
    """Two links that are mirror images."""

    left: ParsedLink
    right: ParsedLink
    D: Array
    """Matrix (3, 3) that maps points of the left link to mirrored points of the right one, in link frames."""


def right_side_names(name: str) -> Iterator[str]:
    """Possible names of a left link's counterpart on the right, by exchanging one word.

    >>> list(right_side_names("arm_left_4_link")), list(right_side_names("LElbow")), list(right_side_names("tool"))
    (['arm_right_4_link'], ['RElbow'], [])
    """
    words = _WORDS.findall(name)
    for k, part in enumerate(words):
        other = _SIDES.get(part.lower())
        if other is not None:
            cased = other.upper() if part.isupper() else other.capitalize() if part[0].isupper() else other
            yield "".join([*words[:k], cased, *words[k + 1 :]])
    # A single letter before a lower-case word, as in lshoulder.
    if re.match(r"l[a-z]{3}", name) and not name.startswith("left"):
        yield "r" + name[1:]


def symmetric_links(robot: ParsedFile) -> Iterator[SymmetricLinks]:
    """Pairs of links with left and right names whose frames are mirror images in a plane of the base."""
    poses = robot.neutral_poses
    for left in robot.links.values():
        right = next((robot.links[name] for name in right_side_names(left.name) if name in robot.links), None)
        if right is None or left.name not in poses or right.name not in poses:
            continue
        D = _mirrored(poses[left.name], poses[right.name])
        if D is not None:
            yield SymmetricLinks(left, right, D)


def _mirrored(T_a: Array, T_b: Array) -> Array | None:
    """R_b' Y R_a if it is a signed permutation and the positions are mirrored; otherwise None."""
    for Y in _PLANES:
        gap = T_b[:3, 3] - Y @ T_a[:3, 3]
        if np.linalg.norm(gap) > _ALIKE or abs(T_a[:3, 3] @ (np.eye(3) - Y).diagonal()) < 0.02:
            continue
        D = T_b[:3, :3].T @ Y @ T_a[:3, :3]
        rounded = np.round(D)
        if np.abs(D - rounded).max() < _ALIKE and np.allclose(rounded @ rounded.T, np.eye(3)):
            return np.asarray(rounded)
    return None


# ── Readers


def _parsed(root: Element, model: Model, reader: SolidReader, path: Path | None) -> ParsedFile:
    """Links and joints of a root element that the loader accepts."""
    form = next(name for name, tag in FORMATS.items() if root.tag == tag)
    text = TEXTS[form](root, model.name, path)
    links = {}
    for name, element in text.links.items():
        if name in model.link_inertias:
            written = text.inertia(name)
            if form == "mjcf":
                written = _compiled(written, model.link_inertias[name], element)
            solids = partial(_solids, text, name, reader)
            links[name] = ParsedLink(name, element.line, element.file, written, text.assumed_parts(name), solids)
    changes = " of <compiler> change ", "settotalmass"
    changed = [one for one in model.defects if form == "mjcf" and (changes[0] in one or one.startswith(changes[1]))]
    return ParsedFile(model, form, links, text.joints, tuple(changed))


def _solids(text: RobotText, link: str, reader: SolidReader) -> LinkSolids:
    return reader.read(link_shapes(text, link))


def _compiled(written: WrittenInertia | None, final: SpatialInertia, body: Element) -> WrittenInertia | None:
    """Inertia in the file if the loader uses it; otherwise the loader's, from geoms and compiler settings."""
    if written is not None and np.allclose(written.inertia.parameters, final.parameters, rtol=1e-9, atol=1e-12):
        return written
    return WrittenInertia.from_inertia(final, body.line, body.file)


# ── From a file or a robot to the input of the checks

MOST_BODIES = 2_000
"""Default of ``max_bodies``: a link takes some milliseconds."""


@dataclass(frozen=True, eq=False)
class Subject:
    """Robot to be checked, with the text of its file."""

    robot: ParsedFile
    text: str = ""
    """Text of the file; empty for a robot without a file."""
    path: Path | None = None
    data: bytes = b""
    """Bytes of the file."""
    root: Element | None = None
    """Root element of the file."""
    floating_base: bool | None = None
    model: str | None = None
    """Name of the model in an SDF world."""


def read_subject(
    source: str | Path | Robot,
    *,
    meshes: bool | Sequence[str | Path] = True,
    floating_base: bool | None = None,
    model: str | None = None,
    max_bodies: int = MOST_BODIES,
) -> Subject:
    """Read a file, accepting impossible inertias; raises NotFoundError, and ModelError if it is not a robot."""
    of = source.model.name if isinstance(source, Robot) else None
    if isinstance(source, Robot):
        kept = file_of(source.model)
        if kept is None or kept.xacro:
            links = {
                name: ParsedLink(name, 0, written=WrittenInertia.from_inertia(G))
                for name, G in source.model.link_inertias.items()
            }
            return Subject(ParsedFile(source.model, "", links))
        floating_base = (source.model.base_inertia.mass == 0 and "root_joint" in source.model.joint_names) or None
        source = kept
    if is_name(source):
        source = robot_file(str(source))
    path = None if is_text(source) else as_path(source)
    if path is not None and usd_path(path) is not None:
        raise RobotFileError(
            f"{path} is USD, whose files are not examined. Examine the robot, twistwrench.doctor(twistwrench.load(path)), or "
            "the URDF that `twistwrench convert` makes of it."
        )
    file, text = None, str(source)
    if path is not None:
        file = RobotFile.from_path(source)
        text = file.text
        if xacro := file.xacro:
            raise RobotFileError(
                f"{path}: {xacro}, and xacro files are not examined. Examine what {EXPAND} makes of it, or the robot: "
                "twistwrench.doctor(twistwrench.load(path))."
            )
    given = text if file is None else file
    if of is not None and file is not None:
        model = _model_of(file.root, of)
    problems: list[LoadError] = []
    try:
        made = _loaded(given, floating_base, "follow", model, max_bodies)
    except ModelError as error:
        with suppress(ModelError):
            problems = load_errors(
                parse(text, max_bodies=MOST_BODIES) if file is None else file.parse_root(MOST_BODIES)
            )
        if not problems:
            raise
        if any(not problem.mimic for problem in problems):  # the loader's error is the first one
            more = _with_others(str(error), problems)
            raise type(error)(bounded_message(more)) from None
        made = _loaded(given, floating_base, "independent", model, max_bodies)
    root = parse(text) if file is None else file.root
    folders = [Path(folder) for folder in meshes] if not isinstance(meshes, bool) else []
    solids = SolidReader(MeshFiles(path, folders) if meshes is not False else None)
    parsed = replace(_parsed(root, made, solids, path), load_errors=tuple(problems))
    return Subject(parsed, text, path, b"" if file is None else file.data, root, floating_base, model)


_MOST_ERRORS = 12
"""Largest number of listed errors beside the first one."""


def _with_others(first: str, problems: Sequence[LoadError]) -> str:
    """Message of the first error, and of the others in the file."""
    texts = {str(problem): f"line {problem.line})" for problem in problems}
    others = [text for text, line in texts.items() if line not in first and text.rstrip(".") not in first]
    if not others:
        return first
    rest = f" And {len(others) - _MOST_ERRORS} more." if len(others) > _MOST_ERRORS else ""
    return f"{first.rstrip('.')}. Besides: {' '.join(others[:_MOST_ERRORS])}{rest}"


def _model_of(root: Element, name: str) -> str | None:
    """Model name in an SDF file with several models, found by the robot's name."""
    models = [one for place in (root, *root.all("world")) for one in place.all("model")]
    return name if len(models) > 1 and name in [one.text("name") for one in models] else None


def _loaded(source: str | Path, floating_base: bool | None, mimic: str, model: str | None, max_bodies: int) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return load_model(
            source, inertia="accept", floating_base=floating_base, mimic=mimic, model=model, max_bodies=max_bodies
        )
