"""Page that shows a robot and its motion in any browser without a network, and the scene of the doctor's findings."""

from __future__ import annotations

import base64
import html
import json
import os
import re
import sys
import tempfile
import warnings
import webbrowser
import zlib
from dataclasses import replace
from importlib import resources
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.page import Viewer, digest
from ..core.colours import COLOURS, Style, page_colours
from ..core.errors import MissingExtraError, ModelWarning, ValueRangeError
from ..core.files import replacing
from ..core.glossary import complete
from ..core.numbers import number
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.model.couplings import refuse_couplings
from ..robot import Robot
from ..robot.task_space_methods import require_robot
from ..shapes.surface import Colour
from .colours import force_scale, mass_scale, quantity_colours
from .page_data import PagePrograms, robot_data, wrench_data
from .page_floor import pedestal_of, spheres_of
from .page_loops import held_pose, loops_of, standing_of
from .page_motion import motion_data, notes_of_motion, python_source, robot_of_motion
from .scene import Scene, Shape, equal_inertia_ellipsoid, scene_of
from .section_pages import SectionPanel, section_data, section_panel
from .starting_pose import starting_pose

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from ..diagnosis import DoctorReport
    from ..motion.load_case import Payload
    from ..reports.drawn_motion import DrawnMotion
    from ..robot.doors import ConstrainedRobot
    from .page_layer import PageLayer

_TRIANGLES = 300_000
_SCRIPTS = (
    "numbers.js", "matrices.js", "coordinates.js", "forces.js", "factors.js", "effective_mass.js", "mechanics.js",
    "fall.js", "floor.js", "solids.js", "orbit.js", "sharpness.js", "stage.js", "sticks.js", "grasp.js",
    "grab.js", "drives.js", "address.js", "share.js", "compact.js", "panel.js", "load.js", "scales.js",
)  # fmt: skip
_SCRIPTS_OF = {
    "motion": ("motion.js", "verdict.js", "strip.js"),
    "book": ("readouts.js", "tip_readouts.js", "article/near_misses.js", "exercises.js", "book.js"),
    "limbs": ("fold.js",),
    "loops": ("loops.js",),
    "standing": ("standing.js",),
    "layer": ("layer.js",),
}
"""Scripts that a page includes only if its header has the entry."""
POLICY = "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src 'unsafe-inline'; script-src"
"""Content-Security-Policy of the page without the digests of its scripts: no requests, no other scripts."""
KINDS = {"f4": "<f4", "f8": "<f8", "u2": "<u2", "u4": "<u4"}


def write_page(
    robot: Robot | ConstrainedRobot,
    path: str | Path,
    *,
    motion: DrawnMotion | None = None,
    q: ArrayLike | None = None,
    actuated: Iterable[str] | None = None,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
    scene: Scene | None = None,
    section: str | None = None,
    embed: bool = False,
    control: str | None = None,
) -> Path:
    """Write a self-contained page with the robot, and a motion to play.

    For a robot with closed loops, the sliders of independent joints keep the loops closed, and torques are those of the
    joints with motors. A robot with a floating base stands on its feet, which share its weight, unless ``q`` places it
    elsewhere.

    Parameters
    ----------
    motion : DrawnMotion, optional, to play
    q : (nq,) array_like, optional, initial configuration
        None: the start of the motion. Without a motion, arms have the elbow up, clear of stops and singular poses,
        robots with a floating base stand on their feet, and other robots are neutral.
    actuated : names of joints, optional, with constraints the joints with motors
        None: joints with an actuator, otherwise as many as there are degrees of freedom.
    wrench_on_robot : {frame: (6,)}, optional, (m, f) in the frame, drawn and included in holding torques
        A motion has its own wrenches. [N m, N]
    section : str, optional
        Section of Modern Robotics for the page, such as 3.4, 5.4, 8.1.3 or 8.3; for arms of at most nine joints.
    embed : bool, optional
        Omit the side panel, for a frame within another page; '#embed' in the address of any page has the same effect,
        '#full' the opposite.
    control : str, optional
        Control shown on an embedded page and on a small screen: payload, push, speed, fall, q:JOINT or section; default: the
        first of these on the page.

    Raises
    ------
    ValueRangeError
        The file cannot be written, the section has no page, or the robot does not fit the section.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     page = write_page(tw.robots.planar_2r(), f"{folder}/arm.html")
    ...     "https:" in page.read_text("utf-8")
    False
    """
    if isinstance(robot, Robot):
        refuse_couplings(robot.model, "a page")
    shown: dict[str, Any] = {
        "motion": motion,
        "q": q,
        "actuated": actuated,
        "wrench_on_robot": wrench_on_robot,
        "scene": scene,
    }
    text = viewer_page(robot, section=section, embed=embed, control=control, still=embed, **shown).page
    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
    return Path(path)


def viewer_page(
    robot: Robot | ConstrainedRobot,
    *,
    motion: DrawnMotion | None = None,
    q: ArrayLike | None = None,
    actuated: Iterable[str] | None = None,
    wrench_on_robot: Mapping[str, ArrayLike] | None = None,
    scene: Scene | None = None,
    section: str | None = None,
    embed: bool = False,
    control: str | None = None,
    neighbours: Mapping[str, str] | None = None,
    still: bool = False,
    layer: PageLayer | None = None,
) -> Viewer:
    """Return the page as text, with the digests of its scripts for a page that contains it.

    Parameters
    ----------
    neighbours : {label: address}, optional, links to other pages of a site, above the heading
    still : bool
        Add a picture of the first frame, for browsers without scripts.
    layer : PageLayer, optional, result drawn over the robot
        The other arguments are those of :func:`write_page`.

    Returns
    -------
    viewer : Viewer
    """
    closed = cast("ConstrainedRobot", robot) if isinstance(robot, Robot) and robot.constraints else None
    if closed is not None and (motion is not None or section is not None):
        raise ValueRangeError(
            "a page of a closed robot is moved by hand. Leave motion and section out, or take robot.open()."
        )
    robot = require_robot(robot if closed is None else closed.open(), "page")
    book = None if section is None else section_panel(section)
    if book is not None:
        if motion is not None or wrench_on_robot:
            raise ValueRangeError(
                f"section {section}: the page sets motion and wrenches by its sliders; leave them out."
            )
        book.require(robot)
    payload = None
    if motion is not None:
        motion.require(robot)
        robot, payload = robot_of_motion(motion)
        wrench_on_robot = motion.load.wrenches
    scene = (scene_of(robot) if scene is None else scene).decimated(_TRIANGLES)
    box = _Box()
    wrenches = wrench_on_robot or {}
    at = None if q is None else arguments.finite(arguments.one(q, "q", robot.nq), "q", robot.nq)
    loops = None
    if closed is not None:
        loops = loops_of(closed, at, actuated)
    elif motion is None and book is None and at is None:
        loops = standing_of(robot, scene)
    held = held_pose(robot, scene) if at is None and closed is None and motion is None and book is None else None
    programs = PagePrograms(robot, tuple(wrenches), book, payload=payload, motion=motion is not None, loops=loops)
    if at is not None and closed is None:
        start = at
    elif loops is not None:
        start = loops.start
    elif held is not None:
        start = held[0]
    else:
        start = starting_pose(robot, programs.tip) if motion is None else motion.q[0]
    data = robot_data(robot, start) | _scene_data(scene, box, start, motion)
    data |= wrench_data(robot, wrenches)
    data |= programs.data()
    data |= {"loops": None, "standing": None} if loops is None else {"loops": loops.loops, "standing": loops.standing}
    if loops is not None and loops.standing is not None:
        data["floor"] = 0.0
    data |= _tips_data(robot, scene, programs, weighed="mass" in data["programs"])
    data["book"] = None if book is None else section_data(book, robot, start)
    data["python"] = python_source(robot, motion)
    data["motion"] = None if motion is None else motion_data(robot, motion, payload, box.put)
    data["box"] = scene.bounds(start).tolist() if motion is None and book is None else None
    data["layer"] = None if layer is None else layer.data(box.put, data["size"])
    data["neighbours"] = dict(neighbours or {})
    data["embed"], data["control"] = embed, _checked_control(control, data)
    spheres = [] if data["fall"]["why"] or book is not None else spheres_of(scene)
    data["fall"] |= {"spheres": spheres, "pedestal": pedestal_of(scene, spheres, data["floor"])}
    if control == "fall":
        data["target"][2] = data["floor"]  # the payload hangs down after release
    # Pages of sections are about mechanics with example arms, so inertia ellipsoids are not drawn.
    of_scene = scene.notes if book is None else scene.remarks
    data["notes"] = [
        *_left_open(robot, closed=closed is not None),
        *(() if loops is None else loops.remarks),
        *of_scene,
        *(notes_of_motion(motion) if motion is not None else ()),
    ]
    data["subtitle"] = f"{_freedom(robot, closed)}, {_moving(robot, motion, payload)}"
    data["held"] = None if held is None else held[1]
    data["shown"], data["switches"] = _switches(data, scene, book)
    parts = resources.files(__package__) / "player"
    names = [*_SCRIPTS, *(name for key, more in _SCRIPTS_OF.items() if data[key] for name in more), "page.js"]
    scripts = programs.script(), joined_script(names)
    digests = tuple(map(digest, scripts))
    page = Template((parts / "page.html").read_text("utf-8")).substitute(
        title=html.escape(robot.name if book is None else f"{book.number} {book.title}, {robot.name}"),
        sentence=html.escape(_still_sentence(data)),
        still=_still_image(scene, start, motion) if still else "",
        policy=f"{POLICY} {' '.join(digests)}",
        style=page_colours() + _style(section=book is not None),
        programs=scripts[0],
        script=scripts[1],
        data=box.packed(data),
    )
    return Viewer(page, digests)


_NARROWER_STYLE = (("; }", "}"), (" { ", "{"), ("; ", ";"), (": ", ":"), (", ", ","))
"""Replacements that shorten a style sheet."""


def _style(*, section: bool) -> str:
    """Style sheet of a page; that of a section has its drawing as well."""
    parts = resources.files(__package__) / "player"
    names = ("page.css", "opening.css") if section else ("page.css",)
    style = "".join((parts / name).read_text("utf-8") for name in names)
    for wide, narrow in _NARROWER_STYLE:
        style = style.replace(wide, narrow)
    return quantity_colours() + style if section else style


_STRICT = '"use strict";'


def joined_script(names: Iterable[str]) -> str:
    """One strict script of files of the player, without comments that end a line, and without indentation."""
    parts = resources.files(__package__) / "player"
    lines = (line for name in names for line in (parts / name).read_text("utf-8").splitlines())
    short = (_COMMENT.sub(_code_before, line).strip() for line in lines)
    return "\n".join((_STRICT, *(line for line in short if line and line != _STRICT)))


_COMMENT = re.compile(r"^(.*?)(?:^|\s)//(?:\s.*)?$")
"""Line with a comment after a space or at its start."""


def _code_before(line: re.Match[str]) -> str:
    """Code before the comment, or the line where the slashes are within a text."""
    code = line[1]
    return code if all(code.count(quote) % 2 == 0 for quote in "\"'`") else line[0]


class ShownPage:
    """Page that a notebook displays below its cell.

    Parameters
    ----------
    text : str, the page
    """

    def __init__(self, text: str) -> None:
        self.text = text

    def _repr_html_(self) -> str:
        """Sandboxed frame that runs the page's scripts."""
        style = "width:100%;height:480px;border:0"
        return f'<iframe srcdoc="{html.escape(self.text)}" loading="lazy" sandbox="allow-scripts" style="{style}"></iframe>'

    def open(self) -> Path:
        """Write the page to a temporary folder and open it in the browser.

        Returns
        -------
        path : Path of the page

        Examples
        --------
        >>> ShownPage("<!doctype html>").open()  # doctest: +SKIP
        """
        path = Path(tempfile.mkdtemp(prefix="twistwrench-")) / "page.html"
        path.write_text(self.text, encoding="utf-8")
        open_browser(path.as_uri())
        return path


def show(robot: Robot | ConstrainedRobot, **options: Any) -> ShownPage:
    """Show the page of a robot or a motion, in a notebook below the cell, otherwise in the browser.

    Parameters
    ----------
    **options : those of :func:`write_page`

    Returns
    -------
    page : ShownPage
    """
    page = ShownPage(viewer_page(robot, **options).page)
    if "ipykernel" not in sys.modules:
        page.open()
    return page


def open_browser(url: str) -> bool:
    """Open an address in a graphical browser; terminal browsers are not started.

    Returns
    -------
    opened : bool
    """
    if sys.platform.startswith("linux") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))):
        return False
    try:
        return webbrowser.open(url)
    except (webbrowser.Error, OSError):
        return False


class _Box:
    """Buffer of concatenated arrays, each located by its offset."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0

    def put(self, values: ArrayLike, kind: str) -> dict[str, Any]:
        """Append an array; returns its header entry."""
        array = np.ascontiguousarray(values, dtype=KINDS[kind]).ravel()
        spec = {"at": self.size, "count": int(array.size), "kind": kind}
        raw = array.tobytes()
        raw += bytes(-len(raw) % 8)
        self.parts.append(raw)
        self.size += len(raw)
        return spec

    def packed(self, header: Mapping[str, Any]) -> str:
        """Header and arrays, compressed by zlib and encoded as base64."""
        text = json.dumps(header, allow_nan=False, separators=(",", ":")).encode()
        raw = len(text).to_bytes(8, "little") + text + bytes(-len(text) % 8) + b"".join(self.parts)
        return base64.b64encode(zlib.compress(raw, 9)).decode("ascii")


def _scene_data(scene: Scene, box: _Box, start: Array, motion: DrawnMotion | None) -> dict[str, Any]:
    distinct = {id(shape.surface): shape.surface for shape in scene.shapes}
    surfaces = []
    for surface in (each.creased() for each in distinct.values()):
        low, step = surface.vertices.min(axis=0), np.maximum(np.ptp(surface.vertices, axis=0), 1e-12) / 65535
        grid = box.put(np.round((surface.vertices - low) / step), "u2")
        faces = box.put(surface.faces, "u2" if len(surface.vertices) <= 65536 else "u4")
        surfaces.append({"vertices": grid, "faces": faces, "low": low.tolist(), "step": step.tolist()})
    place = {key: k for k, key in enumerate(distinct)}
    shapes = [
        {
            "body": s.body, "surface": place[id(s.surface)],
            "colour": s.colour, "layer": s.layer, "pose": s.pose.ravel().tolist(),
        }
        for s in scene.shapes
    ]  # fmt: skip
    samples = start[None] if motion is None else motion.q[:: max(1, len(motion.q) // 12)]
    bounds = np.stack([scene.bounds(q) for q in samples])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    return {
        "surfaces": surfaces,
        "shapes": shapes,
        "dressed": scene.dressed,
        "size": max(scene.size, 0.75 * float(np.linalg.norm(high - low))),
        "floor": float(low[2]),
        "target": ((low + high) / 2).tolist(),
    }


def _tips_data(robot: Robot, scene: Scene, programs: PagePrograms, *, weighed: bool) -> dict[str, Any]:
    """Entries of the initial tip and, if there are several tips, of each."""
    every = programs.tips_data(list(robot.model.all_frames))
    for entry, tip in zip(every, programs.tips, strict=True):
        of_tip = Robot(replace(robot.model, tip=tip)) if len(every) > 1 else robot
        mass, directions = mass_scale(of_tip, scene) if weighed else (0.0, 0)
        entry |= {"forceScale": force_scale(of_tip, scene), "massScale": mass, "tipDirections": directions}
    none = {"tip": None, "payloadFrame": None, "forceScale": 0.0, "massScale": 0.0}
    chosen = every[programs.chosen] if every else none
    return {**chosen, "tips": every if len(every) > 1 else [], "chosenTip": programs.chosen}


def _checked_control(control: str | None, data: Mapping[str, Any]) -> str | None:
    """Check that the page has the control. Raises ValueRangeError."""
    tip, moves = data["payload"] is not None, data["motion"] is not None
    falls = data["fall"]["why"] is None and not data["book"]
    every = (("payload", tip), ("push", tip), ("speed", moves), ("fall", falls), ("section", data["book"]))
    known = [name for name, there in every if there]
    choices = [*known, *(f"q:{hand['name']}" for hand in data["hands"])]
    if control is not None and control not in choices:
        raise ValueRangeError(f"control {control!r}: this page has {listed(choices)}. Name one of them.")
    return control


def _left_open(robot: Robot, *, closed: bool) -> list[str]:
    """Note on loops that the file closes but the page leaves open."""
    closures = list(robot.model.closures)
    if not closures or closed:
        return []
    loops = ", ".join(closures[:4]) + (", …" if len(closures) > 4 else "")
    return [f"Loops left open: {loops}. Torques and motion are those of the open tree, not of the closed mechanism."]


def _still_sentence(data: Mapping[str, Any]) -> str:
    """Sentence of a page without scripts: the verdict on its motion, otherwise what the robot is."""
    verdict = data["motion"] and data["motion"]["verdict"].get("text")
    return str(verdict or f"{data['name']}: {data['subtitle']}")


_STILL = 480, 25_000
"""Pixels of the width, and most bytes, of the picture of a page without scripts."""


def _still_image(scene: Scene, start: Array, motion: DrawnMotion | None) -> str:
    """Image of the first frame, joints over their limits in red; empty where pictures cannot be drawn."""
    from .movie import first_frame

    width, most = _STILL
    try:
        content = first_frame(scene, start, motion, width, most)
    except MissingExtraError:
        return ""
    return f'<img alt="" width="{width}" src="data:image/webp;base64,{base64.b64encode(content).decode("ascii")}">'


def _counted(count: int, noun: str) -> str:
    """Number with its noun."""
    return f"{count} {noun}{'s' if count != 1 else ''}"


def _freedom(robot: Robot, closed: ConstrainedRobot | None) -> str:
    """Degrees of freedom; with loops closed, joints and closures as well."""
    free = robot.nv if closed is None else closed.nv - len(closed.independent)
    text = _counted(free, "degree") + " of freedom"
    if closed is None:
        return text
    return f"{text} ({_counted(len(robot.model.leaders), 'joint')}, {_counted(len(closed.constraints), 'closure')})"


def _moving(robot: Robot, motion: DrawnMotion | None, payload: Payload | None) -> str:
    """Moving mass, and length of the motion."""
    text = f"{number(sum(float(b.inertia.mass) for b in robot.model.bodies))} kg moving"
    if motion is None:
        return text
    carried = " + ".join(f"{number(p.mass)} kg" for p in motion.load.payloads if payload is None)
    span = float(motion.time[-1] - motion.time[0])
    return f"{text}{f', payload {carried}' if carried else ''} · {motion.rows} samples in {number(span)} s"


def _switches(
    data: Mapping[str, Any], scene: Scene, book: SectionPanel | None
) -> tuple[dict[str, bool], list[tuple[str, str]]]:
    """Initial switches, and the buttons that have an effect."""
    tips = data["tips"] or [data]
    has_tip = "jacobian0" in data["programs"] and any(tip["forceScale"] > 0 for tip in tips)
    grasped = data["payload"] is not None and book is None
    closed = data["loops"]["dependent"] if data["loops"] else None
    free = closed.count(False) if closed else len(data["torques"])
    layers = {shape.layer for shape in scene.shapes}
    known = (
        ("looks", "Robot", True, True),
        ("inertia", "Inertia ellipsoids", "inertia" in layers, False),
        ("torques", "Torques", bool(data["marks"]) and (book is None or "torques" in book.shown), True),
        ("wrenches", "Wrenches", bool(data["wrenchMarks"]), True),
        ("com", "Centre of mass", "centre" in data["programs"], data["standing"] is not None),
        ("frames", "Frames", True, False),
        ("ellipsoid", "Force ellipsoid", has_tip, False),
        ("polytope", "Force polytope", has_tip, False),
        ("mass", "Mass ellipsoid", any(tip["massScale"] > 0 for tip in tips), False),
        ("keep", "Keep orientation", grasped, free >= 6),
        ("stops", "Stops and friction", book is None and "mass" in data["programs"] and not data["fall"]["why"], True),
        ("drives", "Drives hold", book is None and "mass" in data["programs"] and _driven(data), False),
        ("feet", "Feet on the floor", data["standing"] is not None, True),
        ("layer", data["layer"]["label"] if data["layer"] else "", data["layer"] is not None, True),
        ("workspace", "Predicted error", bool(data["layer"] and data["layer"]["workspace"]), True),
        ("path", "Path of the tip", data["motion"] is not None and data["payload"] is not None, True),
    )
    shown = {key: bool(on and there) if book is None else key in book.shown for key, _, there, on in known}
    return shown, [(key, label) for key, label, there, _ in known if there]


def _driven(data: Mapping[str, Any]) -> bool:
    """True if each velocity is that of one joint whose drive has a limit, and the robot can be let go."""
    single = sum(len(hand["v"]) == 1 and "turn" not in hand for hand in data["hands"])
    torques = data["torques"]
    each = bool(torques) and single == len(torques) and all(row["limit"] and row["driven"] for row in torques)
    return each and data["fall"]["why"] is None and not data["loops"]


# ── The doctor's findings on a robot

_STYLES = {"error": Style.OVER, "warning": Style.NEAR, "note": Style.QUIET}
_BEFORE: Colour = (0.84, 0.37, 0.0)
_AFTER: Colour = (0.0, 0.45, 0.70)
_NOTES = 40


def findings_scene(report: DoctorReport) -> Scene:
    """Scene of a robot with findings of the doctor: bodies in the colour of their worst finding, with notes."""
    model = report.contents.robot.model
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        scene = scene_of(Robot(model))
    colours: dict[int, Colour] = {}
    ellipsoids: list[Shape] = []
    for finding in report.findings:
        named = [link for link in model.frames if f"{link!r}" in finding.where]
        for link in named if finding.where.startswith("link") else []:
            colours.setdefault(model.frames[link].body, COLOURS[_STYLES[finding.severity]].scene)
        for link, after in finding.repair.inertias.items() if finding.repair is not None else ():
            frame = model.frames[link]
            for inertia, colour in ((model.link_inertias[link], _BEFORE), (after, _AFTER)):
                solid = equal_inertia_ellipsoid(inertia) if inertia.mass > 0 else []
                ellipsoids += [Shape(frame.body, s, np.array(frame.pose), colour, "inertia") for s in solid]
    kept = [s for s in scene.shapes if s.layer != "inertia"]
    shapes = [replace(s, colour=colours.get(s.body, s.colour)) for s in kept]
    notes = [f"{finding}. Effect: {finding.effect}." for finding in report.findings[:_NOTES]]
    return replace(scene, shapes=(*shapes, *ellipsoids), remarks=(*notes, *scene.remarks))


complete(globals())
