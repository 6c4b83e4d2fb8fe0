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
"""Largest number of triangles of the robot on a page."""
_HIDDEN_SHARE = 0.05
"""Share of the robot's size up to which ellipsoids, as of point masses, are hidden within joints and links."""
_MAX_BOX_POSES = 12
"""Approximate number of poses of a motion from which the space that the robot takes is computed."""
_MIN_SIZE_OF_SPACE = 0.75
"""Smallest size of the view, relative to the diagonal of the space that the robot takes."""
_MIN_EXTENT = 1e-12
"""Extent of a flat surface across itself [m], so that zero does not divide."""
_GRID_STEPS = 65535
"""Steps of the grid of vertices along each axis: the largest unsigned number of 16 bits."""
_MAX_LISTED_LOOPS = 4
"""Largest number of open loops that a note names."""
KINDS = {"f4": "<f4", "f8": "<f8", "u2": "<u2", "u4": "<u4"}
"""NumPy's types of stored arrays, little-endian: floats of 4 and 8 bytes, unsigned integers of 2 and 4 bytes."""


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
        Omit the side panel, for a frame within another page. '#embed' in the address of any page has the same effect,
        and '#full' shows the panel.
    control : str, optional
        Control shown on an embedded page and on a small screen: payload, push, speed, fall, q:JOINT or section. Default: the
        first of them that the page has.

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
    contents = _contents_of(robot, motion, q, actuated, wrench_on_robot, scene, section)
    programs = PagePrograms(
        contents.robot, tuple(contents.wrenches), contents.book, payload=contents.payload, motion=motion is not None,
        loops=contents.loops,
    )  # fmt: skip
    start = contents.start(programs.tip)
    store = _ArrayStore()
    data = _robot_data(contents, programs, start, store)
    if layer is not None:
        data["layer"] = layer.data(store.put, data["size"])
    data["neighbours"] = dict(neighbours or {})
    data["embed"] = embed
    data["control"] = _require_control(control, data)
    data["fall"] |= _floor_data(contents, data)
    if control == "fall":
        data["target"][2] = data["floor"]  # the payload hangs down after release
    data["notes"] = _notes(contents)
    data["subtitle"] = f"{_freedom_text(contents)}, {_motion_text(contents)}"
    data["held"] = contents.held_remark
    data["shown"], data["switches"] = _switches(data, contents.scene, contents.book)
    programs_script = programs.script()
    page_script = joined_script(script_names(data))
    digests = (digest(programs_script), digest(page_script))
    title = contents.robot.name
    if contents.book is not None:
        title = f"{contents.book.number} {contents.book.title}, {title}"
    style = page_colours() + page_style(section=contents.book is not None)
    template = resources.files(__package__) / "player" / "page.html"
    page = Template(template.read_text("utf-8")).substitute(
        title=html.escape(title),
        sentence=html.escape(_still_sentence(data)),
        still=_still_image(contents.scene, start, motion) if still else "",
        policy=f"{POLICY} {' '.join(digests)}",
        style=style,
        programs=programs_script,
        script=page_script,
        data=store.pack(data),
    )
    return Viewer(page, digests)


@dataclass(frozen=True, eq=False)
class _PageContents:
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
    """Panel of a section of Modern Robotics; None for other pages."""
    q: Array | None = None
    """Requested initial configuration (nq,)."""
    loops: PageLoops | None = None
    held_q: Array | None = None
    """Standing pose (nq,) of a robot whose file fixes the base in the air; None for other robots."""
    held_remark: str | None = None
    """Remark about this pose; None without it."""

    def start(self, tip: str | None) -> Array:
        """Initial configuration (nq,)."""
        if self.loops is not None:
            return self.loops.start
        if self.q is not None:
            return self.q
        if self.held_q is not None:
            return self.held_q
        if self.motion is not None:
            return self.motion.q[0]
        return starting_pose(self.robot, tip)


def _contents_of(
    robot: Robot | ConstrainedRobot,
    motion: DrawnMotion | None,
    q: ArrayLike | None,
    actuated: Iterable[str] | None,
    wrench_on_robot: Mapping[str, ArrayLike] | None,
    scene: Scene | None,
    section: str | None,
) -> _PageContents:
    """Contents of a page from its arguments; raises if two arguments contradict each other."""
    closed = None
    if isinstance(robot, Robot) and robot.constraints:
        if motion is not None or section is not None:
            raise ValueRangeError(
                "a page of a closed robot is moved by hand. Leave motion and section out, or take robot.open()."
            )
        closed = cast("ConstrainedRobot", robot)
        robot = closed.open()
    robot = require_robot(robot, "page")
    book: SectionPanel | None = None
    payload: Payload | None = None
    loops: PageLoops | None = None
    held_q: Array | None = None
    held_remark: str | None = None
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
    requested_q = None
    if q is not None:
        one_q = arguments.one(q, "q", robot.nq)
        requested_q = arguments.finite(one_q, "q", robot.nq)
    if closed is not None:
        loops = loops_of(closed, requested_q, actuated)
    elif motion is None and book is None and requested_q is None:
        loops = standing_of(robot, scene)
        held = held_pose(robot, scene)
        if held is not None:
            held_q, held_remark = held
    wrenches = wrench_on_robot or {}
    return _PageContents(robot, scene, wrenches, closed, motion, payload, book, requested_q, loops, held_q, held_remark)


def _robot_data(contents: _PageContents, programs: PagePrograms, start: Array, store: _ArrayStore) -> dict[str, Any]:
    """Data of the page about the robot and what is shown with it; arrays go to the store."""
    robot = contents.robot
    scene = contents.scene
    motion = contents.motion
    book = contents.book
    loops = contents.loops
    data = robot_data(robot, start) | _scene_data(scene, store, start, motion)
    data |= wrench_data(robot, contents.wrenches)
    data |= programs.data()
    data |= {"loops": None, "standing": None}
    if loops is not None:
        data |= {"loops": loops.loops, "standing": loops.standing}
        if loops.standing is not None:
            data["floor"] = 0.0
    data |= _tips_data(robot, scene, programs, has_mass="mass" in data["programs"])
    data |= {"book": None, "python": python_source(robot, motion), "motion": None, "box": None, "layer": None}
    if book is not None:
        data["book"] = section_data(book, robot, start)
    elif motion is not None:
        data["motion"] = motion_data(robot, motion, contents.payload, store.put)
    else:
        data["box"] = scene.bounds(start).tolist()
    return data


def _floor_data(contents: _PageContents, data: Mapping[str, Any]) -> dict[str, Any]:
    """Spheres around the links, which the floor stops, and the pedestal; no spheres if the robot cannot be let go."""
    spheres = []
    can_fall = not data["fall"]["why"]  # no reason why it cannot
    if can_fall and contents.book is None:
        spheres = spheres_of(contents.scene)
    return {"spheres": spheres, "pedestal": pedestal_of(contents.scene, spheres, data["floor"])}


def _notes(contents: _PageContents) -> list[str]:
    """Notes on open loops, assumptions, shapes and the motion."""
    notes = _open_loop_notes(contents)
    if contents.loops is not None:
        notes += contents.loops.remarks
    # Pages of sections are about mechanics with example arms, so inertia ellipsoids are not drawn.
    notes += contents.scene.notes if contents.book is None else contents.scene.remarks
    if contents.motion is not None:
        notes += notes_of_motion(contents.motion)
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
        """HTML of a sandboxed frame that runs the page's scripts."""
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
    """Open an address in a graphical browser; on Linux without a display no terminal browser is started.

    Returns
    -------
    opened : bool
    """
    variables = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    has_display = any(os.environ.get(variable) for variable in variables)
    if sys.platform.startswith("linux") and not has_display:
        return False
    try:
        return webbrowser.open(url)
    except (webbrowser.Error, OSError):
        return False


class _ArrayStore:
    """Buffer of concatenated arrays, which begin at multiples of 8 bytes."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        """Number of bytes of all parts."""

    def put(self, values: ArrayLike, kind: str) -> dict[str, Any]:
        """Append an array of a kind in :data:`KINDS`; returns its entry of the header: offset, count and kind."""
        array = np.ascontiguousarray(values, dtype=KINDS[kind]).ravel()
        entry = {"at": self.size, "count": int(array.size), "kind": kind}
        part = _padded(array.tobytes())
        self.parts.append(part)
        self.size += len(part)
        return entry

    def pack(self, header: Mapping[str, Any]) -> str:
        """Length of the header, header and arrays, compressed by zlib and encoded as base64."""
        header_bytes = json.dumps(header, allow_nan=False, separators=(",", ":")).encode()
        length = len(header_bytes).to_bytes(8, "little")
        content = length + _padded(header_bytes) + b"".join(self.parts)
        return base64.b64encode(zlib.compress(content, 9)).decode("ascii")


def _padded(content: bytes) -> bytes:
    """Content with zeros up to a multiple of 8 bytes."""
    return content + bytes(-len(content) % 8)


def _scene_data(scene: Scene, store: _ArrayStore, start: Array, motion: DrawnMotion | None) -> dict[str, Any]:
    """Surfaces and shapes of the scene, and the space that the robot takes on the motion."""
    surfaces_by_id = {id(shape.surface): shape.surface for shape in scene.shapes}  # shapes may share a surface
    index_by_id = {key: k for k, key in enumerate(surfaces_by_id)}
    surfaces = [_surface_data(surface.creased(), store) for surface in surfaces_by_id.values()]
    shapes = [
        {
            "body": shape.body, "surface": index_by_id[id(shape.surface)],
            "colour": shape.colour, "layer": shape.layer, "pose": shape.pose.ravel().tolist(),
        }
        for shape in scene.shapes
    ]  # fmt: skip
    sample_poses = start[None]
    if motion is not None:
        step = max(1, len(motion.q) // _MAX_BOX_POSES)
        sample_poses = motion.q[::step]
    bounds = np.stack([scene.bounds(q) for q in sample_poses])
    low = bounds[:, 0].min(axis=0)
    high = bounds[:, 1].max(axis=0)
    return {
        "surfaces": surfaces,
        "shapes": shapes,
        "dressed": scene.dressed,
        "size": max(scene.size, _MIN_SIZE_OF_SPACE * float(np.linalg.norm(high - low))),
        "floor": float(low[2]),
        "target": ((low + high) / 2).tolist(),
    }


def _surface_data(surface: Surface, store: _ArrayStore) -> dict[str, Any]:
    """Vertices, rounded to a grid in the box of the surface, and triangles; the arrays go to the store."""
    low = surface.vertices.min(axis=0)
    step = np.maximum(np.ptp(surface.vertices, axis=0), _MIN_EXTENT) / _GRID_STEPS
    vertices = store.put(np.round((surface.vertices - low) / step), "u2")
    index_kind = "u2" if len(surface.vertices) <= _GRID_STEPS + 1 else "u4"
    faces = store.put(surface.faces, index_kind)
    return {"vertices": vertices, "faces": faces, "low": low.tolist(), "step": step.tolist()}


def _tips_data(robot: Robot, scene: Scene, programs: PagePrograms, *, has_mass: bool) -> dict[str, Any]:
    """Entries of the initial tip and, if there are several tips, of each; with the scale of mass ellipsoids if ``has_mass``."""
    entries = programs.tips_data(list(robot.model.all_frames))
    has_several_tips = len(entries) > 1
    for entry, tip in zip(entries, programs.tips, strict=True):
        tip_robot = robot
        if has_several_tips:
            tip_robot = Robot(replace(robot.model, tip=tip))
        ellipsoid_scale = 0.0
        directions = 0
        if has_mass:
            ellipsoid_scale, directions = mass_scale(tip_robot, scene)
        entry |= {
            "forceScale": force_scale(tip_robot, scene),
            "massScale": ellipsoid_scale,
            "tipDirections": directions,
        }
    initial_entry = {"tip": None, "payloadFrame": None, "forceScale": 0.0, "massScale": 0.0}
    if entries:
        initial_entry = entries[programs.chosen]
    tips = entries if has_several_tips else []
    return {**initial_entry, "tips": tips, "chosenTip": programs.chosen}


def _require_control(control: str | None, data: Mapping[str, Any]) -> str | None:
    """Return the control; raises ValueRangeError if the page does not have it."""
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


def _open_loop_notes(contents: _PageContents) -> list[str]:
    """Note on loops that the file closes but the page leaves open."""
    closures = list(contents.robot.model.closures)
    if not closures or contents.closed is not None:
        return []
    loops = ", ".join(closures[:_MAX_LISTED_LOOPS])
    if len(closures) > _MAX_LISTED_LOOPS:
        loops += ", …"
    return [f"Loops left open: {loops}. Torques and motion are those of the open tree, not of the closed mechanism."]


def _still_sentence(data: Mapping[str, Any]) -> str:
    """Sentence of a page without scripts: verdict on its motion; without one, name and degrees of freedom of the robot."""
    if data["motion"]:
        verdict = data["motion"]["verdict"].get("text")
        if verdict:
            return str(verdict)
    return f"{data['name']}: {data['subtitle']}"


_IMAGE_WIDTH = 480
"""Width of the picture of a page without scripts [pixels]."""
_MAX_IMAGE_BYTES = 25_000
"""Largest size of this picture [bytes]."""


def _still_image(scene: Scene, start: Array, motion: DrawnMotion | None) -> str:
    """HTML image of the first frame, with joints over their limits in red; empty if pictures cannot be drawn."""
    from .plots.robot_picture import first_frame

    try:
        image = first_frame(scene, start, motion, _IMAGE_WIDTH, _MAX_IMAGE_BYTES)
    except MissingExtraError:
        return ""
    encoded = base64.b64encode(image).decode("ascii")
    return f'<img alt="" width="{_IMAGE_WIDTH}" src="data:image/webp;base64,{encoded}">'


def _count_text(count: int, noun: str) -> str:
    """Number with its noun, in the singular or plural."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _freedom_text(contents: _PageContents) -> str:
    """Text with the degrees of freedom; with closed loops, also the numbers of joints and closures."""
    closed = contents.closed
    if closed is None:
        return f"{_count_text(contents.robot.nv, 'degree')} of freedom"
    degrees = _count_text(closed.nv - len(closed.independent), "degree")
    joints = _count_text(len(contents.robot.model.leaders), "joint")
    closures = _count_text(len(closed.constraints), "closure")
    return f"{degrees} of freedom ({joints}, {closures})"


def _motion_text(contents: _PageContents) -> str:
    """Text with the moving mass, a payload that no slider sets, and the length of the motion."""
    mass = moving_mass(contents.robot.model)
    text = f"{number(mass)} kg moving"
    motion = contents.motion
    if motion is None:
        return text
    if contents.payload is None and motion.load.payloads:
        masses = " + ".join(f"{number(payload.mass)} kg" for payload in motion.load.payloads)
        text += f", payload {masses}"
    duration = float(motion.time[-1] - motion.time[0])
    return f"{text} · {motion.rows} samples in {number(duration)} s"


class _Switch(NamedTuple):
    """Button that shows or hides a part of the page."""

    key: str
    label: str
    present: bool
    """True if the page has this part."""
    on: bool
    """Initial state; pages of sections set their own."""


def _switches(
    data: Mapping[str, Any], scene: Scene, book: SectionPanel | None
) -> tuple[dict[str, bool], list[tuple[str, str]]]:
    """Initial state of each part, and key and label of the buttons of parts that the page has."""
    tips = data["tips"] or [data]  # the data of the page contain the entries of a single tip
    has_tip = "jacobian0" in data["programs"] and any(tip["forceScale"] > 0 for tip in tips)
    has_payload = data["payload"] is not None and book is None
    degrees_of_freedom = len(data["torques"])
    if data["loops"] and data["loops"]["dependent"]:
        degrees_of_freedom = data["loops"]["dependent"].count(False)
    ellipsoids = [shape.surface.vertices for shape in scene.shapes if shape.layer == "inertia"]
    has_inertia = any(np.ptp(points, axis=0).max() > _HIDDEN_SHARE * scene.size for points in ellipsoids)
    has_torques = bool(data["marks"]) and (book is None or "torques" in book.shown)
    has_mass = book is None and "mass" in data["programs"]
    stands = data["standing"] is not None
    layer = data["layer"] or {"label": "", "workspace": None}
    has_path = data["motion"] is not None and data["payload"] is not None
    switches = [  # key, label, present, on
        _Switch("looks", "Robot", True, True),
        _Switch("inertia", "Inertia ellipsoids", has_inertia, False),
        _Switch("torques", "Torques", has_torques, True),
        _Switch("wrenches", "Wrenches", bool(data["wrenchMarks"]), True),
        _Switch("com", "Centre of mass", "centre" in data["programs"], stands),
        _Switch("frames", "Frames", True, False),
        _Switch("ellipsoid", "Force ellipsoid", has_tip, False),
        _Switch("polytope", "Force polytope", has_tip, False),
        _Switch("mass", "Mass ellipsoid", any(tip["massScale"] > 0 for tip in tips), False),
        _Switch("keep", "Keep orientation", has_payload, degrees_of_freedom >= 6),
        _Switch("stops", "Stops and friction", has_mass and not data["fall"]["why"], True),
        _Switch("drives", "Drives hold", has_mass and _has_only_driven_joints(data), False),
        _Switch("feet", "Feet on the floor", stands, True),
        _Switch("layer", layer["label"], data["layer"] is not None, True),
        _Switch("workspace", "Predicted error", bool(layer["workspace"]), True),
        _Switch("path", "Path of the tip", has_path, True),
    ]
    if book is None:
        is_shown = {switch.key: switch.on and switch.present for switch in switches}
    else:
        is_shown = {switch.key: switch.key in book.shown for switch in switches}
    return is_shown, [(switch.key, switch.label) for switch in switches if switch.present]


def _has_only_driven_joints(data: Mapping[str, Any]) -> bool:
    """True if each joint has one degree of freedom and a drive with a limit, and the robot can be let go."""
    torques = data["torques"]
    if not torques or data["fall"]["why"] is not None or data["loops"]:
        return False
    single_axis_hands = [hand for hand in data["hands"] if len(hand["v"]) == 1 and "turn" not in hand]
    have_limited_drives = all(row["limit"] and row["driven"] for row in torques)
    return len(single_axis_hands) == len(torques) and have_limited_drives


complete(globals())
