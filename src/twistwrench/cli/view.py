"""The command ``twistwrench view``: pages and films of a robot and its motion."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import click
from click.core import ParameterSource

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.errors import ValueRangeError
from ..core.text import listed
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..mechanics.model.couplings import refuse_couplings
from ..motion.load_case import LoadCase
from ..reports.check import check
from ..reports.drawn_motion import DrawnMotion, reported_motion
from ..robot import Robot
from ..viz.article import ARTICLES, write_article
from ..viz.movie import film, movie_path
from ..viz.page import open_browser, write_page
from ..viz.page_loops import closed_by_file
from ..viz.page_motion import robot_of_motion
from ..viz.scene import scene_of
from ..viz.section_pages import SECTIONS, section_panel
from .main import note, option
from .parameters import Question
from .shared import LogOptions, RobotOptions
from .skin import Asked, OutputFile, Outputs, command_of
from .terminal import frame_progress
from .torques import answer_of

_MOTION_OPTIONS = ("smooth", "limits")
"""Options that need a motion, beside the options that read its file."""


@dataclass(frozen=True, eq=False, repr=False)
class ShownRobot(Answer):
    """Robot with its loads, and its motion, for a page or a film."""

    call: ClassVar[str] = "view"

    robot: Robot
    wrenches: Mapping[str, Array]
    """Wrenches on the robot by frame."""
    motion: DrawnMotion | None  # None without a trajectory
    meshes: bool
    """True if meshes are drawn."""
    speed: float
    """Factor of the film's speed."""
    page: Mapping[str, Any]
    """Options of the page: arguments of :func:`write_page`."""

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def verdict(self) -> Verdict:
        """LOOK AGAIN if the motion contradicts itself, joined with the verdict on a required clearance; otherwise DONE."""
        if self.motion is None:
            return Verdict(Word.DONE)
        if self.motion.clearance is not None:
            return self.motion.verdict.joined(self.motion.clearance.verdict)
        if self.motion.verdict.ok:
            return Verdict(Word.DONE)
        return self.motion.verdict

    def blocks(self) -> Iterator[Block]:
        """Clearance of the motion, if one is required."""
        if self.motion is not None and self.motion.clearance is not None:
            yield from self.motion.clearance.blocks()

    def write_page(self, path: str) -> None:
        """Write the page. Loops of the robot's file are closed if neither a motion nor a section moves the joints."""
        drawn_robot, closed_robot = self.robot, None
        if self.motion is not None:
            drawn_robot, _ = robot_of_motion(self.motion)
        elif self.page["section"] is None:
            closed_robot = closed_by_file(self.robot)
        write_page(
            closed_robot or self.robot, path, motion=self.motion, wrench_on_robot=self.wrenches,
            scene=scene_of(drawn_robot, meshes=self.meshes), **self.page,
        )  # fmt: skip

    def write_film(self, path: str) -> None:
        """Write the film of the motion."""
        assert self.motion is not None, "a film without a motion is refused"
        with frame_progress("filming") as progress:
            scene = scene_of(self.robot, meshes=self.meshes)
            film(self.motion, path, scene=scene, speed=self.speed, progress=progress)


@dataclass(frozen=True, eq=False, repr=False)
class ShownArticle(Answer):
    """Article on a section of the book, which has no robot."""

    call: ClassVar[str] = "view"

    section: str  # number in the book

    @property
    def verdict(self) -> Verdict:
        """DONE."""
        return Verdict(Word.DONE)

    def blocks(self) -> Iterator[Block]:
        """No blocks: the file is the answer."""
        yield from ()

    def write_page(self, path: str) -> None:
        """Write the article."""
        write_article(self.section, path)


Shown: TypeAlias = ShownRobot | ShownArticle


def _write_film(answer: Shown, path: str) -> None:
    """Write the film of a robot; an article has none."""
    assert isinstance(answer, ShownRobot), "a film without a motion is refused"
    answer.write_film(path)


@command_of(
    "view",
    check,
    option("--no-browser", "Print the path of the page, without opening a browser."),
    further_questions=(
        Question(scene_of).only("meshes"),
        Question(write_page).only("section", "embed", "control"),
        Question(film).only("speed"),
    ),
    left_out=("why", "at"),  # parameters of check that are not options
    needs_motion=False,
    files=(
        OutputFile(
            "--html OUT.html",
            "Write the page to this file, without opening a browser.",
            lambda answer, path: answer.write_page(path),
            is_data=False,
        ),
        OutputFile(
            "--movie OUT.gif|OUT.mp4",
            "Write a film of the motion.",
            _write_film,
            is_data=False,
            complete=movie_path,
        ),
    ),
    examples=(
        "view ur5 demo --payload 5 --html ur5.html",
        "view panda --section 8.1.3 --html mass_matrix.html",
        "view --section 8.2 --html article.html",
    ),
    needs_robot=False,
)
def view_command(
    robot: RobotOptions | None,
    log: LogOptions,
    asked: Asked,
    outputs: Outputs[Shown],
    meshes: bool,
    section: str | None,
    embed: bool,
    control: str | None,
    speed: float,
    no_browser: bool,
) -> Shown:
    """Show a robot in the browser, with joints to move, its motion, torques and forces at the tip; or write a page or film.

    Exit code: 1 for LOOK AGAIN, if the motion contradicts itself, or if links come too near (--clearance); it is shown
    nevertheless.
    """
    if robot is None:
        return _article(section, outputs)
    _check_files(outputs, log, section, has_page_options=embed or control is not None)
    loaded_robot, wrenches, motion = _loads_and_motion(robot, log, asked)
    if "--html" in outputs.flags:
        refuse_couplings(loaded_robot.model, "--html")
    elif "--movie" not in outputs.flags:
        page_file = Path(tempfile.mkdtemp(prefix="twistwrench-")) / "page.html"
        write = _write_page if no_browser else _write_and_open_page
        outputs.add(OutputFile("--html", "", write, is_data=False), str(page_file))
    page_options = {"section": section, "embed": embed, "control": control}
    return ShownRobot(loaded_robot, wrenches, motion, meshes=meshes, speed=speed, page=page_options)


def _write_page(answer: Shown, path: str) -> None:
    """Write the page, without opening it."""
    answer.write_page(path)


def _write_and_open_page(answer: Shown, path: str) -> None:
    """Write the page, and open it in the browser."""
    answer.write_page(path)
    if not open_browser(Path(path).as_uri()):
        note("no browser could be opened. Open the file in one.")


_NO_PAGE_FILE = "--section writes a page. Add --html OUT.html."
_ARTICLE_PARAMETERS = frozenset({"section", "file_html", "overwrite"})
"""Parameters of the command that an article has."""


def _article(section: str | None, outputs: Outputs[Shown]) -> ShownArticle:
    """Article on a section; raises if the section has no article, or if options need a robot."""
    context = click.get_current_context()
    if section is None:
        robot_argument, *_ = context.command.params
        raise click.MissingParameter(ctx=context, param=robot_argument)
    if section not in ARTICLES:
        section_panel(section)  # raises for a section that is not there
        raise ValueRangeError(
            f"section {section} has no article, only a page with a robot: twistwrench view panda --section "
            f"{section} --html page.html. Articles are on: {listed(ARTICLES, 20)}."
        )
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        is_given = source is ParameterSource.COMMANDLINE
        if is_given and parameter.name not in _ARTICLE_PARAMETERS:
            raise ValueRangeError(
                f"the article on section {section} has no robot. Leave {parameter.opts[0]} out, or name ROBOT first."
            )
    if "--html" not in outputs.flags:
        raise ValueRangeError(_NO_PAGE_FILE)
    return ShownArticle(section)


def _check_files(outputs: Outputs[Shown], log: LogOptions, section: str | None, *, has_page_options: bool) -> None:
    """Raise if options describe a page or film that is not written, or that has nothing to show."""
    if "--movie" in outputs.flags and log.trajectory is None:
        raise ValueRangeError("--movie films a motion, and there is none. Add --trajectory FILE.csv.")
    if has_page_options and "--html" not in outputs.flags:
        raise ValueRangeError("--embed and --control are about a page in a file. Add --html OUT.html.")
    if section is None:
        return
    if section in ARTICLES and section not in SECTIONS:
        raise ValueRangeError(
            f"section {section} has an article, and no page with a robot: twistwrench view --section {section} "
            f"--html page.html. Pages with a robot are on: {listed(SECTIONS, 20)}."
        )
    section_panel(section)  # raises for a section that is not there
    if "--html" not in outputs.flags:
        raise ValueRangeError(_NO_PAGE_FILE)
    if log.trajectory is not None:
        raise ValueRangeError("--section N shows a robot that is moved by hand. Leave --trajectory out.")


def _loads_and_motion(
    robot: RobotOptions, log: LogOptions, asked: Asked
) -> tuple[Robot, dict[str, Array], DrawnMotion | None]:
    """Robot with its payloads, wrenches on the robot by frame, and its motion; None without a motion.

    The motion is judged as by the command ``torques``, and its doubts are printed as notes.
    """
    if log.trajectory is None:
        motion_options = list(log.given)
        motion_options += [name for name in _MOTION_OPTIONS if name in asked]
        if motion_options:
            flag = f"--{motion_options[0].replace('_', '-')}"
            raise ValueRangeError(f"{flag} is about a motion, and none is given. Add --trajectory.")
        if "clearance" in asked or "srdf" in asked:
            raise ValueRangeError("--clearance is of a motion, and there is none. Add --trajectory FILE.csv.")
        case = LoadCase(robot.load(), tuple(asked.get("payload", ())), asked.get("wrench_on_robot", {}))
        return case.with_load, case.wrenches, None
    report = answer_of(robot, log, asked, log.path(robot))
    motion = reported_motion(report)
    for sentence in (*report.differentiation.trajectory.notes, *motion.warnings):
        note(sentence)
    return motion.load.with_load, motion.load.wrenches, motion
