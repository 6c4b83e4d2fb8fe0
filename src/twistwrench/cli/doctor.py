"""The commands ``twistwrench doctor`` and ``verify``: errors of robot files, checks of the dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from ..core.errors import ValueRangeError
from ..core.verdict import ExitCode
from ..diagnosis import DoctorReport, doctor
from ..formats.xacro import ENDING as XACRO_ENDING
from ..robot import Robot, load
from ..testing.verify import verify
from .main import Given, command, option
from .report import PAGE, REPORT, write_report, write_viewer
from .shared import JSON, LIMITS, XACRO, RobotOptions, base_option, robot_command, robot_source, xacro_arguments
from .terminal import show_answer


@command(
    "doctor",
    click.argument("source", metavar="ROBOT"),
    option("--only CHECK", "Run only this check; may be repeated. [default: all]", multiple=True),
    option("--out OUT", "Write the repaired robot file; all else stays byte for byte."),
    REPORT,
    PAGE,
    option("--plot OUT.png", "Draw shapes, and inertia ellipsoids before and after the repair."),
    option("--meshes DIR", "Additional folder to search for meshes; may be repeated.", multiple=True),
    option(
        "--mirror-from",
        "Side to copy where left and right links are not mirror images.",
        choices=("left", "right"),
    ),
    option(
        "--metric",
        "Distance to minimise if no single error explains an inertia.",
        choices=("frobenius", "entropic"),
        default="frobenius",
    ),
    LIMITS,
    JSON,
    option("--strict", "Exit with 1 also for notes."),
    option("--model NAME", "Model to read from an SDF world."),
    option("--floating-base", "Let the base move freely, so that its inertia is checked."),
    option("--fixed-base", "Hold the base in place, as a stand does: a robot with legs hangs on purpose."),
    XACRO,
    examples_=("doctor ur5", "doctor quadruped --report quadruped.html"),
)
def doctor_command(given: Given) -> ExitCode:
    """Find errors in a robot file, their effect on the mass matrix and gravity torques, and the repair.

    Exit code: 1 with errors or warnings.
    """
    for folder in given.meshes:
        if not Path(folder).is_dir():
            raise ValueRangeError(
                f"--meshes {folder!r} is not a folder. Give the one that holds the meshes or their package."
            )
    found, arguments = robot_source(given.source), xacro_arguments(given.xacro)
    if arguments is None and Path(given.source).suffix.lower() == XACRO_ENDING:
        arguments = {}  # expanded as by every command
    files = {"ROBOT": given.source if Path(given.source).is_file() else None, "--limits": given.limits}
    given.check_files(files)
    report = doctor(
        found if arguments is None else _expanded(found, arguments, given),
        only=given.only or None,
        meshes=given.meshes or True,
        metric=given.metric,
        mirror_from=given.mirror_from,
        floating_base=base_option(given.floating_base, given.fixed_base),
        model=given.model,
        limits=given.limits,
        strict=given.strict,
    )
    show_answer(report)
    if given.out is not None:
        repaired = report.write(given.out, overwrite=given.overwrite)
        click.echo(f"wrote {given.out}, with {len(repaired)} repair{'' if len(repaired) == 1 else 's'}")
    if given.plot is not None:
        from ..viz.plots.diagnosis import links_drawn, plot_diagnosis

        if links_drawn(report):
            click.echo(f"wrote {plot_diagnosis(report, given.plot)}")
        else:
            click.echo("note: no finding changes an inertia, so there is nothing to draw.", err=True)
    if given.report is not None or given.html is not None:
        write_doctor_report(report, given, files)
    return report.verdict.exit_code


def _expanded(source: str | Path, arguments: Mapping[str, str], given: Given) -> Robot:
    """Robot of a file with macros, with whatever inertias it has."""
    floating_base = base_option(given.floating_base, given.fixed_base)
    return load(source, xacro=arguments, inertia="accept", floating_base=floating_base, model=given.model)


def write_doctor_report(report: DoctorReport, given: Given, files: Mapping[str, str | Path | None]) -> None:
    """Write the files of --html and --report."""
    from ..viz.answers import doctor_pictures
    from ..viz.page import findings_scene

    scene = findings_scene(report)
    link = write_viewer(given, scene.robot, scene=scene)
    pictures = doctor_pictures(report, scene, link) if given.report is not None else []
    blocks = list(report.blocks())
    write_report(given, "doctor", report.robot, blocks, files=files, pictures=pictures, robot=scene.robot)


# ── ``verify``


@robot_command("verify", JSON, examples=("verify ur5",), angles=False)
def verify_command(options: RobotOptions, given: Given) -> ExitCode:
    """Check the dynamics of a robot against independent formulas and libraries. Exit code: 1 if one disagrees."""
    given.check_files(options.files)
    robot = options.load()
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to check: {robot.name!r} has no joint that moves; load with --floating-base.")
    report = verify(robot)
    show_answer(report)
    return report.verdict.exit_code
