"""The commands ``twistwrench doctor`` and ``verify``: errors of robot files, checks of the dynamics."""

from __future__ import annotations

from pathlib import Path

import click

from ..core.errors import ValueRangeError
from ..diagnosis.report import DoctorReport, doctor
from ..formats.xacro import ENDING as XACRO_ENDING
from ..robot import Robot, load
from ..testing.verify import VerifyReport, verify
from .shared import LOADING, RobotOptions, robot_source
from .skin import Asked, OutputFile, command_of, picture_file


def _repairs_text(report: DoctorReport) -> str:
    """Clause on the number of repairs in the written file."""
    repair_count = len(report.repairs)
    noun = "repair" if repair_count == 1 else "repairs"
    return f", with {repair_count} {noun}"


def _changes_links(report: DoctorReport) -> bool:
    """True if a picture can show changed inertias of links."""
    from ..viz.plots.diagnosis import links_drawn

    return bool(links_drawn(report))


@command_of(
    "doctor",
    doctor,
    click.argument("source", metavar="ROBOT"),
    files=(
        OutputFile(
            "--out OUT",
            "Write the repaired robot file; all else stays byte for byte.",
            lambda report, path: report.write(path, overwrite=True),
            comment=_repairs_text,
        ),
        picture_file(
            "Draw shapes, and inertia ellipsoids before and after the repair.",
            exists=_changes_links,
            missing="no finding changes an inertia, so there is nothing to draw.",
        ),
    ),
    report=True,
    examples=("doctor ur5", "doctor quadruped --report quadruped.html"),
    with_robot=False,
    reads=lambda source: {"ROBOT": source if Path(source).is_file() else None},
    further_questions=(LOADING.only("xacro"),),
)
def doctor_command(
    asked: Asked,
    source: str,
    meshes: bool | list[str],
    floating_base: bool | None,
    model: str | None,
    xacro: dict[str, str] | None,
) -> DoctorReport:
    """Find errors in a robot file, their effect on the mass matrix and gravity torques, and the repair.

    Exit code: 1 with errors or warnings.
    """
    mesh_folders = meshes if isinstance(meshes, list) else []
    for folder in mesh_folders:
        if not Path(folder).is_dir():
            raise ValueRangeError(
                f"--meshes {folder!r} is not a folder. Give the one that holds the meshes or their package."
            )
    if xacro is None and Path(source).suffix.lower() == XACRO_ENDING:
        xacro = {}  # every command expands such a file, without arguments if none are given
    robot: str | Path | Robot = robot_source(source)
    if xacro is not None and not isinstance(robot, Robot):
        robot = load(robot, xacro=xacro, inertia="accept", floating_base=floating_base, model=model)
    return doctor(robot, meshes=meshes, floating_base=floating_base, model=model, **asked)


# ── ``verify``


@command_of("verify", verify, examples=("verify ur5",))
def verify_command(robot: RobotOptions, asked: Asked) -> VerifyReport:
    """Check the dynamics of a robot against independent formulas and libraries. Exit code: 1 if one disagrees."""
    loaded_robot = robot.load()
    if loaded_robot.nv == 0:
        raise ValueRangeError(
            f"nothing to check: {loaded_robot.name!r} has no joint that moves; load with --floating-base."
        )
    return verify(loaded_robot, **asked)
