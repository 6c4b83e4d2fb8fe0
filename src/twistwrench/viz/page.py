"""Page that shows a robot and its motion in any browser without a network."""

from __future__ import annotations

import base64
import html
import json
import os
import sys
import tempfile
import webbrowser
import zlib
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.page import Viewer, digest
from ..core.colours import page_colours
from ..core.errors import MissingExtraError, ValueRangeError
from ..core.files import replacing
from ..core.glossary import complete
from ..core.numbers import number
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.model.couplings import refuse_couplings
from ..robot import Robot
from ..robot.base import require_robot
from .colours import force_scale, mass_scale
from .page_data import robot_data, wrench_data
from .page_floor import pedestal_of, spheres_of
from .page_loops import held_pose, loops_of, standing_of
from .page_motion import motion_data, notes_of_motion, python_source, robot_of_motion
from .page_programs import PagePrograms, moving_mass
from .page_scripts import POLICY, joined_script, page_style, script_names
from .scene import Scene, scene_of
from .section_pages import SectionPanel, section_data, section_panel
from .starting_pose import starting_pose

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from ..motion.load_case import Payload
    from ..reports.drawn_motion import DrawnMotion
    from ..robot.doors import ConstrainedRobot
    from ..shapes.surface import Surface
    from .page_layer import PageLayer
    from .page_loops import PageLoops

_MAX_TRIANGLES = 300_000
_HIDDEN_SHARE = 0.05
"""Share of the robot's size up to which ellipsoids, as of point masses, are hidden within joints and links."""
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
    text = viewer_page(
        robot, motion=motion, q=q, actuated=actuated, wrench_on_robot=wrench_on_robot, scene=scene, section=section,
        embed=embed, control=control, still=embed,
    ).page  # fmt: skip
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
    subject = _subject_of(robot, motion, q, actuated, wrench_on_robot, scene, section)
    programs = PagePrograms(
        subject.robot, tuple(subject.wrenches), subject.book, payload=subject.payload, motion=motion is not None,
        loops=subject.loops,
    )  # fmt: skip
    start = subject.start(programs.tip)
    box = _Box()
    data = _header(subject, programs, start, box)
    if layer is not None:
        data["layer"] = layer.data(box.put, data["size"])
    data["neighbours"] = dict(neighbours or {})
    data["embed"], data["control"] = embed, _require_control(control, data)
    data["fall"] |= _floor_data(subject, data)
    if control == "fall":
        data["target"][2] = data["floor"]  # the payload hangs down after release
    data["notes"] = _notes(subject)
    data["subtitle"] = f"{_freedom_text(subject)}, {_motion_text(subject)}"
    data["held"] = None if subject.held is None else subject.held[1]
    data["shown"], data["switches"] = _switches(data, subject.scene, subject.book)
    scripts = programs.script(), joined_script(script_names(data))
    digests = tuple(map(digest, scripts))
    title = subject.robot.name
    if subject.book is not None:
        title = f"{subject.book.number} {subject.book.title}, {title}"
    template = resources.files(__package__) / "player" / "page.html"
    page = Template(template.read_text("utf-8")).substitute(
        title=html.escape(title),
        sentence=html.escape(_still_sentence(data)),
        still=_still_image(subject.scene, start, motion) if still else "",
        policy=f"{POLICY} {' '.join(digests)}",
        style=page_colours() + page_style(section=subject.book is not None),
        programs=scripts[0],
        script=scripts[1],
        data=box.pack(data),
    )
    return Viewer(page, digests)


@dataclass(frozen=True, eq=False)
class _Subject:
    """Robot of a page, and what is shown with it."""

    robot: Robot
    scene: Scene
    wrenches: Mapping[str, ArrayLike]
    """Wrenches on the robot, by frame."""
    closed: ConstrainedRobot | None = None
    """The robot with its loops closed; None for a tree."""
    motion: DrawnMotion | None = None
    payload: Payload | None = None
    """Payload of the motion that a slider sets."""
    book: SectionPanel | None = None
    q: Array | None = None
    """Requested initial configuration (nq,)."""
    loops: PageLoops | None = None
    held: tuple[Array, str] | None = None
    """Standing pose of a robot whose file fixes the base in the air, and its remark."""

    def start(self, tip: str | None) -> Array:
        """Initial configuration (nq,)."""
        if self.loops is not None:
            return self.loops.start
        if self.q is not None:
            return self.q
        if self.held is not None:
            return self.held[0]
        if self.motion is not None:
            return self.motion.q[0]
        return starting_pose(self.robot, tip)


def _subject_of(
    robot: Robot | ConstrainedRobot,
    motion: DrawnMotion | None,
    q: ArrayLike | None,
    actuated: Iterable[str] | None,
    wrench_on_robot: Mapping[str, ArrayLike] | None,
    scene: Scene | None,
    section: str | None,
) -> _Subject:
    """Check the arguments of a page against each other, and place the robot."""
    closed = None
    if isinstance(robot, Robot) and robot.constraints:
        if motion is not None or section is not None:
            raise ValueRangeError(
                "a page of a closed robot is moved by hand. Leave motion and section out, or take robot.open()."
            )
        closed = cast("ConstrainedRobot", robot)
        robot = closed.open()
    robot = require_robot(robot, "page")
    book, payload, loops, held = None, None, None, None
    if section is not None:
        book = section_panel(section)
        if motion is not None or wrench_on_robot:
            raise ValueRangeError(
                f"section {section}: the page sets motion and wrenches by its sliders; leave them out."
            )
        book.require(robot)
    if motion is not None:
        motion.require(robot)
        robot, payload = robot_of_motion(motion)
        wrench_on_robot = motion.load.wrenches
    if scene is None:
        scene = scene_of(robot)
    scene = scene.decimated(_MAX_TRIANGLES)
    start = None if q is None else arguments.finite(arguments.one(q, "q", robot.nq), "q", robot.nq)
    if closed is not None:
        loops = loops_of(closed, start, actuated)
    elif motion is None and book is None and start is None:
        loops, held = standing_of(robot, scene), held_pose(robot, scene)
    return _Subject(robot, scene, wrench_on_robot or {}, closed, motion, payload, book, start, loops, held)


def _header(subject: _Subject, programs: PagePrograms, start: Array, box: _Box) -> dict[str, Any]:
    """Data of the page about the robot and what is shown with it."""
    robot, scene, motion, book, loops = subject.robot, subject.scene, subject.motion, subject.book, subject.loops
    data = robot_data(robot, start) | _scene_data(scene, box, start, motion)
    data |= wrench_data(robot, subject.wrenches)
    data |= programs.data()
    data |= {"loops": None, "standing": None}
    if loops is not None:
        data |= {"loops": loops.loops, "standing": loops.standing}
        if loops.standing is not None:
            data["floor"] = 0.0
    data |= _tips_data(robot, scene, programs, weighed="mass" in data["programs"])
    data |= {"book": None, "python": python_source(robot, motion), "motion": None, "box": None, "layer": None}
    if book is not None:
        data["book"] = section_data(book, robot, start)
    elif motion is not None:
        data["motion"] = motion_data(robot, motion, subject.payload, box.put)
    else:
        data["box"] = scene.bounds(start).tolist()
    return data


def _floor_data(subject: _Subject, data: Mapping[str, Any]) -> dict[str, Any]:
    """Spheres around the links that the floor stops, and the pedestal; no spheres for robots that cannot be let go."""
    spheres = []
    if not data["fall"]["why"] and subject.book is None:
        spheres = spheres_of(subject.scene)
    return {"spheres": spheres, "pedestal": pedestal_of(subject.scene, spheres, data["floor"])}


def _notes(subject: _Subject) -> list[str]:
    """Notes on open loops, assumptions, shapes and the motion."""
    notes = _open_loop_notes(subject)
    if subject.loops is not None:
        notes += subject.loops.remarks
    # Pages of sections are about mechanics with example arms, so inertia ellipsoids are not drawn.
    notes += subject.scene.notes if subject.book is None else subject.scene.remarks
    if subject.motion is not None:
        notes += notes_of_motion(subject.motion)
    return notes


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

    def pack(self, header: Mapping[str, Any]) -> str:
        """Header and arrays, compressed by zlib and encoded as base64."""
        text = json.dumps(header, allow_nan=False, separators=(",", ":")).encode()
        raw = len(text).to_bytes(8, "little") + text + bytes(-len(text) % 8) + b"".join(self.parts)
        return base64.b64encode(zlib.compress(raw, 9)).decode("ascii")


def _scene_data(scene: Scene, box: _Box, start: Array, motion: DrawnMotion | None) -> dict[str, Any]:
    """Surfaces and shapes of the scene, and the space that the robot takes on the motion."""
    distinct = {id(shape.surface): shape.surface for shape in scene.shapes}
    place = {key: k for k, key in enumerate(distinct)}
    surfaces = [_surface_data(surface.creased(), box) for surface in distinct.values()]
    shapes = [
        {
            "body": s.body, "surface": place[id(s.surface)],
            "colour": s.colour, "layer": s.layer, "pose": s.pose.ravel().tolist(),
        }
        for s in scene.shapes
    ]  # fmt: skip
    samples = start[None]
    if motion is not None:
        samples = motion.q[:: max(1, len(motion.q) // 12)]
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


def _surface_data(surface: Surface, box: _Box) -> dict[str, Any]:
    """Vertices on a grid of 65,536 steps along each axis, and triangles."""
    low, step = surface.vertices.min(axis=0), np.maximum(np.ptp(surface.vertices, axis=0), 1e-12) / 65535
    vertices = box.put(np.round((surface.vertices - low) / step), "u2")
    faces = box.put(surface.faces, "u2" if len(surface.vertices) <= 65536 else "u4")
    return {"vertices": vertices, "faces": faces, "low": low.tolist(), "step": step.tolist()}


def _tips_data(robot: Robot, scene: Scene, programs: PagePrograms, *, weighed: bool) -> dict[str, Any]:
    """Entries of the initial tip and, if there are several tips, of each."""
    tips = programs.tips_data(list(robot.model.all_frames))
    for entry, tip in zip(tips, programs.tips, strict=True):
        tip_robot = robot
        if len(tips) > 1:
            tip_robot = Robot(replace(robot.model, tip=tip))
        mass, directions = 0.0, 0
        if weighed:
            mass, directions = mass_scale(tip_robot, scene)
        entry |= {"forceScale": force_scale(tip_robot, scene), "massScale": mass, "tipDirections": directions}
    chosen = {"tip": None, "payloadFrame": None, "forceScale": 0.0, "massScale": 0.0}
    if tips:
        chosen = tips[programs.chosen]
    return {**chosen, "tips": tips if len(tips) > 1 else [], "chosenTip": programs.chosen}


def _require_control(control: str | None, data: Mapping[str, Any]) -> str | None:
    """The control, which the page must have. Raises ValueRangeError."""
    controls = []
    if data["payload"] is not None:
        controls += ["payload", "push"]
    if data["motion"] is not None:
        controls.append("speed")
    if data["book"]:
        controls.append("section")
    elif data["fall"]["why"] is None:
        controls.append("fall")
    controls += [f"q:{hand['name']}" for hand in data["hands"]]
    if control is not None and control not in controls:
        raise ValueRangeError(f"control {control!r}: this page has {listed(controls)}. Name one of them.")
    return control


def _open_loop_notes(subject: _Subject) -> list[str]:
    """Note on loops that the file closes but the page leaves open."""
    closures = list(subject.robot.model.closures)
    if not closures or subject.closed is not None:
        return []
    loops = ", ".join(closures[:4])
    if len(closures) > 4:
        loops += ", …"
    return [f"Loops left open: {loops}. Torques and motion are those of the open tree, not of the closed mechanism."]


def _still_sentence(data: Mapping[str, Any]) -> str:
    """Sentence of a page without scripts: the verdict on its motion, otherwise what the robot is."""
    verdict = data["motion"] and data["motion"]["verdict"].get("text")
    return str(verdict or f"{data['name']}: {data['subtitle']}")


_STILL_WIDTH, _MAX_STILL_BYTES = 480, 25_000
"""Pixels of the width, and most bytes, of the picture of a page without scripts."""


def _still_image(scene: Scene, start: Array, motion: DrawnMotion | None) -> str:
    """Image of the first frame, joints over their limits in red; empty where pictures cannot be drawn."""
    from .plots.robot_picture import first_frame

    try:
        image = first_frame(scene, start, motion, _STILL_WIDTH, _MAX_STILL_BYTES)
    except MissingExtraError:
        return ""
    text = base64.b64encode(image).decode("ascii")
    return f'<img alt="" width="{_STILL_WIDTH}" src="data:image/webp;base64,{text}">'


def _count_text(count: int, noun: str) -> str:
    """Number with its noun."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _freedom_text(subject: _Subject) -> str:
    """Degrees of freedom; with loops closed, joints and closures as well."""
    closed = subject.closed
    if closed is None:
        return f"{_count_text(subject.robot.nv, 'degree')} of freedom"
    degrees = _count_text(closed.nv - len(closed.independent), "degree")
    joints = _count_text(len(subject.robot.model.leaders), "joint")
    return f"{degrees} of freedom ({joints}, {_count_text(len(closed.constraints), 'closure')})"


def _motion_text(subject: _Subject) -> str:
    """Moving mass, payload that no slider sets, and length of the motion."""
    text = f"{number(moving_mass(subject.robot.model))} kg moving"
    motion = subject.motion
    if motion is None:
        return text
    if subject.payload is None and motion.load.payloads:
        text += f", payload {' + '.join(f'{number(p.mass)} kg' for p in motion.load.payloads)}"
    span = float(motion.time[-1] - motion.time[0])
    return f"{text} · {motion.rows} samples in {number(span)} s"


class _Switch(NamedTuple):
    """Button that shows or hides a part of the page."""

    key: str
    label: str
    present: bool
    """True if it has an effect."""
    on: bool
    """Initial state, except on pages of sections."""


def _switches(
    data: Mapping[str, Any], scene: Scene, book: SectionPanel | None
) -> tuple[dict[str, bool], list[tuple[str, str]]]:
    """Initial switches, and the buttons that have an effect."""
    tips = data["tips"] or [data]
    has_tip = "jacobian0" in data["programs"] and any(tip["forceScale"] > 0 for tip in tips)
    grasped = data["payload"] is not None and book is None
    degrees = len(data["torques"])
    if data["loops"] and data["loops"]["dependent"]:
        degrees = data["loops"]["dependent"].count(False)
    ellipsoids = [shape.surface.vertices for shape in scene.shapes if shape.layer == "inertia"]
    has_inertia = any(np.ptp(points, axis=0).max() > _HIDDEN_SHARE * scene.size for points in ellipsoids)
    with_torques = bool(data["marks"]) and (book is None or "torques" in book.shown)
    weighed = book is None and "mass" in data["programs"]
    standing = data["standing"] is not None
    layer = data["layer"] or {"label": "", "workspace": None}
    has_path = data["motion"] is not None and data["payload"] is not None
    switches = [
        _Switch("looks", "Robot", True, True),
        _Switch("inertia", "Inertia ellipsoids", has_inertia, False),
        _Switch("torques", "Torques", with_torques, True),
        _Switch("wrenches", "Wrenches", bool(data["wrenchMarks"]), True),
        _Switch("com", "Centre of mass", "centre" in data["programs"], standing),
        _Switch("frames", "Frames", True, False),
        _Switch("ellipsoid", "Force ellipsoid", has_tip, False),
        _Switch("polytope", "Force polytope", has_tip, False),
        _Switch("mass", "Mass ellipsoid", any(tip["massScale"] > 0 for tip in tips), False),
        _Switch("keep", "Keep orientation", grasped, degrees >= 6),
        _Switch("stops", "Stops and friction", weighed and not data["fall"]["why"], True),
        _Switch("drives", "Drives hold", weighed and _has_only_driven_joints(data), False),
        _Switch("feet", "Feet on the floor", standing, True),
        _Switch("layer", layer["label"], data["layer"] is not None, True),
        _Switch("workspace", "Predicted error", bool(layer["workspace"]), True),
        _Switch("path", "Path of the tip", has_path, True),
    ]
    if book is None:
        shown = {switch.key: switch.on and switch.present for switch in switches}
    else:
        shown = {switch.key: switch.key in book.shown for switch in switches}
    return shown, [(switch.key, switch.label) for switch in switches if switch.present]


def _has_only_driven_joints(data: Mapping[str, Any]) -> bool:
    """True if each velocity is that of one joint whose drive has a limit, and the robot can be let go."""
    torques = data["torques"]
    if not torques or data["fall"]["why"] is not None or data["loops"]:
        return False
    single = sum(len(hand["v"]) == 1 and "turn" not in hand for hand in data["hands"])
    return single == len(torques) and all(row["limit"] and row["driven"] for row in torques)


complete(globals())
