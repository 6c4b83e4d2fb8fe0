"""The command ``twistwrench view``: pages and films of a robot and its motion."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from ..core.errors import ValueRangeError
from ..core.text import listed
from ..core.verdict import ExitCode
from ..motion.load_case import parse_wrenches
from ..motion.motion_log import MotionLog
from ..reports.drawn_motion import DrawnMotion
from ..robot import Robot
from .main import Given, option
from .shared import (
    CLEARANCE,
    LIMITS,
    LogOptions,
    RobotOptions,
    clearance_along,
    clearance_verdict,
    load_case,
    loaded_motion_options,
    motion_path,
    robot_command,
)
from .skin import Asked
from .terminal import frame_progress, show


@robot_command(
    "view",
    loaded_motion_options(required=False),
    LIMITS,
    CLEARANCE,
    option("--no-meshes", "Draw joints and inertias in place of meshes."),
    option(
        "--section N",
        "Page of a section of Modern Robotics, such as 3.4, 5.2, 8.1.3 or 8.3, with this robot; without ROBOT the article on "
        "it, such as 8.2; needs --html.",
    ),
    option("--html OUT.html", "Write the page to this file, without opening a browser."),
    option("--embed", "Write a page without side panel, to embed in another page; needs --html."),
    option(
        "--control NAME",
        "Control of --embed: payload, push, speed, fall, q:JOINT or section. [default: the first available]",
    ),
    option("--movie OUT.gif|OUT.mp4", "Write a film of the motion."),
    option("--speed", "Playback speed of the film, in multiples of real time.", default=1.0),
    option("--no-browser", "Print the path of the page, without opening a browser."),
    examples=(
        "view ur5 demo --payload 5 --html ur5.html",
        "view panda --section 8.1.3 --html mass_matrix.html",
        "view --section 8.2 --html article.html",
    ),
    robot_first=True,
)
def view_command(options: RobotOptions, given: Given) -> ExitCode:
    """Show a robot in the browser, with joints to move, its motion, torques and forces at the tip; or write a page or film.

    Exit code: 1 for LOOK AGAIN, if the motion contradicts itself, or if links come too near (--clearance); it is shown
    nevertheless.
    """
    if given.source is None:
        return _article(given)
    from ..viz.movie import film, movie_path
    from ..viz.page import open_browser, write_page
    from ..viz.page_loops import closed_by_file
    from ..viz.page_motion import robot_of_motion
    from ..viz.scene import scene_of

    path = None if given.trajectory is None else motion_path(options, given.trajectory)
    if given.movie is not None:
        if path is None:
            raise ValueRangeError("--movie films a motion, and there is none. Add --trajectory FILE.csv.")
        given.movie = movie_path(given.movie)
    given.check_files({"--trajectory": path, "--srdf": given.srdf, **options.files})
    if (given.embed or given.control is not None) and given.html is None:
        raise ValueRangeError("--embed and --control are about a page in a file. Add --html OUT.html.")
    if given.section is not None:
        _require_page(given.section, given.html, path)
    robot, wrenches, motion = _judged(options, path, given)
    shown = robot if motion is None else robot_of_motion(motion)[0]
    about: dict[str, Any] = {"motion": motion, "wrench_on_robot": wrenches}
    about["scene"] = scene_of(shown, meshes=not given.no_meshes)
    closed = closed_by_file(robot) if motion is None and given.section is None else None
    if given.html is not None:
        about |= {"section": given.section, "embed": given.embed, "control": given.control}
        click.echo(f"wrote {write_page(closed or robot, given.html, **about)}")
    if given.movie is not None and motion is not None:
        scene = scene_of(robot, meshes=not given.no_meshes)
        with frame_progress("filming") as progress:
            film(motion, given.movie, scene=scene, speed=given.speed, progress=progress)
        click.echo(f"wrote {given.movie}")
    if given.html is None and given.movie is None:
        path_of_page = Path(tempfile.mkdtemp(prefix="twistwrench-")) / "page.html"
        write_page(closed or robot, path_of_page, **about)
        click.echo(f"wrote {path_of_page}")
        if not given.no_browser and not open_browser(path_of_page.as_uri()):
            click.echo("note: no browser could be opened. Open the file in one.", err=True)
    return ExitCode.FINE if motion is None else motion.verdict.exit_code


view_command.params[0].required = False  # ROBOT, as an article has none
view_command.params[0].metavar = "[ROBOT]"
_NEEDS_FILE = "--section writes a page. Add --html OUT.html."
_OF_ARTICLES = frozenset({"section", "html"})


def _article(given: Given) -> ExitCode:
    """Write the article on a section; raises if there is none, or if options need a robot."""
    context = click.get_current_context()
    if given.section is None:
        raise click.MissingParameter(ctx=context, param=context.command.params[0])
    from ..viz.article import ARTICLES, write_article
    from ..viz.section_pages import section_panel

    section_panel(given.section)
    if given.section not in ARTICLES:
        raise ValueRangeError(
            f"section {given.section} has no article, only a page with a robot: twistwrench view panda --section "
            f"{given.section} --html page.html. Articles are on: {listed(ARTICLES, 20)}."
        )
    for param in context.command.params:
        typed = context.get_parameter_source(param.name or "") is ParameterSource.COMMANDLINE
        if typed and param.name not in _OF_ARTICLES:
            raise ValueRangeError(
                f"the article on section {given.section} has no robot. Leave {param.opts[0]} out, or name ROBOT first."
            )
    if given.html is None:
        raise ValueRangeError(_NEEDS_FILE)
    click.echo(f"wrote {write_article(given.section, given.html)}")
    return ExitCode.FINE


def _judged(options: RobotOptions, path: Path | None, given: Given) -> tuple[Robot, dict[str, Any], DrawnMotion | None]:
    """Load the robot with payloads and wrenches, and its motion, judged as in ``torques``; doubts are printed on stderr."""
    from ..reports.drawn_motion import reported_motion
    from .torques import answer_of

    if path is None:
        about = ("columns", "gain", "rate", "topic", "episode", "lock_missing", "smooth", "limits")
        if unused := [f"--{name.replace('_', '-')}" for name in about if getattr(given, name) not in (None, False, ())]:
            raise ValueRangeError(f"{unused[0]} is about a motion, and none is given. Add --trajectory.")
        loaded = load_case(options.load(), options, given)
        clearance_along(given.clearance, given.srdf, loaded.robot, None)
        return loaded.with_load, loaded.wrenches, None
    asked: Asked = {name: getattr(given, name) for name in ("limits", "smooth", "clearance", "srdf")}
    asked |= {"payload": given.payloads, "wrench_on_robot": parse_wrenches(given.wrenches)}
    asked |= {"friction": not given.no_friction, "degrees": options.degrees}
    report = answer_of(options, LogOptions.of(vars(given)), asked, path)
    motion = reported_motion(report)
    if report.clearance is not None:
        show(*clearance_verdict(report.clearance), *report.clearance.lines)
        motion = replace(motion, verdict=motion.verdict.joined(report.clearance.verdict))
    _print_notes(report.differentiation.trajectory, motion)
    return motion.load.with_load, motion.load.wrenches, motion


def _print_notes(trajectory: MotionLog, motion: DrawnMotion) -> None:
    for sentence in (*trajectory.notes, *motion.warnings):
        click.echo(f"note: {sentence}", err=True)


def _require_page(section: str, html: str | None, path: Path | None) -> None:
    """Raise unless the book section has a page and no motion is given."""
    from ..viz.section_pages import section_panel

    section_panel(section)
    if html is None:
        raise ValueRangeError(_NEEDS_FILE)
    if path is not None:
        raise ValueRangeError("--section N shows a robot that is moved by hand. Leave --trajectory out.")
