"""The commands ``twistwrench view`` and ``twistwrench plot``: their options, and what they do."""

from __future__ import annotations

import os
import sys
import tempfile
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.verdict import ExitCode
from ..errors import ValueRangeError
from .console import frame_progress
from .motion_options import Load, loaded_motion_options, open_motion, option_group

if TYPE_CHECKING:
    from ..viz.drawn_motion import DrawnMotion

_KINDS = ("split", "power", "phase")


view_options = option_group(
    click.option("--no-browser", is_flag=True, help="Write the page, print its path, and open no browser."),
    click.option(
        "--speed", type=float, default=1.0, show_default=True, help="Of the film: seconds of motion a second."
    ),
    click.option("--movie", "movie", metavar="OUT.gif|OUT.mp4", help="Film the motion instead of opening a page."),
    click.option("--html", "html", metavar="OUT.html", help="Write the page to this file, and open no browser."),
    click.option(
        "--section",
        metavar="N",
        help="With --html: the page of a section of Modern Robotics, as 3.4, 5.2, 8.1.3, 8.3.",
    ),
    click.option("--no-meshes", is_flag=True, help="Draw the robot from its numbers, whatever its file looks like."),
    loaded_motion_options(required=False),
)
"""The options of ``view``, all but the robot's own."""


plot_options = option_group(
    click.option("--joint", "joints", metavar="JOINT", multiple=True, help="Of this joint alone; may be repeated."),
    click.option("--out", "out", metavar="OUT.png", required=True, help="The picture: .png, .pdf or .svg."),
    click.option(
        "--what",
        type=click.Choice(_KINDS),
        required=True,
        help="Causes of torques, power and energy, or phase planes.",
    ),
    loaded_motion_options(required=True),
)
"""The options of ``plot``, all but the robot's own."""


def run_view(
    load: Load,
    path: Path | None,
    files: Mapping[str, str | None],
    *,
    html: str | None,
    movie: str | None,
    speed: float,
    no_browser: bool,
    no_meshes: bool,
    section: str | None,
    **given: Any,
) -> ExitCode:
    """Write the page or film given by ``html`` and ``movie``; without either, a page in a temporary folder, and open it.

    Returns NO where the motion contradicts itself, which is shown all the same.
    """
    from ..core.files import check_outputs
    from ..viz.movie import film, movie_path
    from ..viz.page import write_page
    from ..viz.scene import scene_of

    if movie is not None:
        if path is None:
            raise ValueRangeError("--movie films a motion, and there is none. Add --trajectory FILE.csv.")
        movie = movie_path(movie)
    check_outputs({"--html": html, "--movie": movie}, {"--trajectory": path, **files})
    if section is not None:
        _require_page(section, html, path)
    robot, wrenches, motion = _loaded(load, path, **given)
    scene = scene_of(robot, meshes=not no_meshes)
    about: dict[str, Any] = {"motion": motion, "wrench_on_robot": wrenches, "scene": scene}
    if html is not None:
        click.echo(f"wrote {write_page(robot, html, section=section, **about)}")
    if movie is not None and motion is not None:
        with frame_progress("filming") as progress:
            film(motion, movie, scene=scene, speed=speed, progress=progress)
        click.echo(f"wrote {movie}")
    if html is None and movie is None:
        path_of_page = Path(tempfile.mkdtemp(prefix="twistwrench-")) / "page.html"
        write_page(robot, path_of_page, **about)
        click.echo(f"wrote {path_of_page}")
        if not no_browser and not _open_browser(path_of_page.as_uri()):
            click.echo("note: no browser could be opened. Open the file in one.", err=True)
    return ExitCode.FINE if motion is None else motion.verdict.exit_code


def run_plot(
    load: Load,
    path: Path,
    files: Mapping[str, str | None],
    *,
    what: str,
    out: str,
    joints: tuple[str, ...],
    **given: Any,
) -> ExitCode:
    """Draw one picture of the motion in the file ``path``. Returns NO where the motion contradicts itself."""
    from ..core.files import check_outputs, picture_path
    from ..plotting.motion import PICTURES
    from ..plotting.style import require_matplotlib

    require_matplotlib("Drawing (plot)")
    out = picture_path(out)
    if joints and what == "power":
        raise ValueRangeError("--joint chooses panels, and the picture of power has none. Leave it out.")
    check_outputs({"--out": out}, {"--trajectory": path, **files})
    _, _, motion = _loaded(load, path, **given)
    if motion is not None:
        PICTURES[what](motion, out, *([joints] if joints else []))
    click.echo(f"wrote {out}")
    return ExitCode.FINE if motion is None else motion.verdict.exit_code


def _loaded(
    load: Load,
    path: Path | None,
    *,
    degrees: bool,
    payloads: tuple[str, ...],
    wrenches: tuple[str, ...],
    no_friction: bool,
    columns: tuple[str, ...],
    rate: float | None,
    lock_missing: bool,
    smooth: bool,
) -> tuple[Any, dict[str, Any], DrawnMotion | None]:
    """The robot with its payloads, the wrenches on it, and its motion; limits that this passes are said on stderr."""
    from ..reports.load_case import LoadCase, parse_payload, parse_wrenches
    from ..viz.drawn_motion import read_motion

    if path is None and (columns or rate is not None or lock_missing or smooth):
        raise ValueRangeError(
            "--columns, --rate, --lock-missing and --smooth are about a motion, and none is given. Add --trajectory."
        )
    trajectory = None
    if path is None:
        robot, _ = load()
    else:
        reading: dict[str, Any] = {"columns": columns, "rate": rate, "lock_missing": lock_missing}
        robot, trajectory = open_motion(load, path, degrees=degrees, **reading)
    loaded = LoadCase(robot, tuple(map(parse_payload, payloads)), parse_wrenches(wrenches), friction=not no_friction)
    motion = None
    if trajectory is not None:
        motion = read_motion(loaded, trajectory, smoothing=smooth)
        for sentence in (*trajectory.notes, *motion.warnings):
            click.echo(f"note: {sentence}", err=True)
    return loaded.with_load, loaded.wrenches, motion


def _open_browser(url: str) -> bool:
    """True if a browser with windows opened the address; a browser of the terminal is not started."""
    if sys.platform.startswith("linux") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))):
        return False
    try:
        return webbrowser.open(url)
    except (webbrowser.Error, OSError):
        return False


def _require_page(section: str, html: str | None, path: Path | None) -> None:
    """Raise unless there is a page of the section, and a page without a motion is asked for."""
    from ..viz.section_pages import section_panel

    section_panel(section)
    if html is None:
        raise ValueRangeError("--section writes a page. Add --html OUT.html.")
    if path is not None:
        raise ValueRangeError("--section N shows a robot that is moved by hand. Leave --trajectory out.")
