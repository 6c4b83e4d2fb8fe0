"""The commands ``twistwrench doctor`` and ``verify``: errors of robot files, checks of the dynamics."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from ..core.files import check_outputs, refuse_existing
from ..core.numbers import residual
from ..core.verdict import ExitCode
from ..diagnosis import DoctorReport, Finding, Severity
from ..errors import ValueRangeError
from ..verify import VerifyReport
from .console import picture, show
from .plain_table import PlainTable
from .robot_options import RobotOptions, robot_command, robot_source
from .usage import Given, command, option_group

doctor_options = option_group(
    click.option("--floating-base", is_flag=True, help="Let the base move freely, so that its own inertia counts."),
    click.option("--model", metavar="NAME", help="Of an SDF world: this model."),
    click.option("--strict", is_flag=True, help="Exit code 1 with notes too."),
    click.option("--json", "as_json", is_flag=True, help="Print everything as JSON, in SI units."),
    click.option(
        "--metric",
        type=click.Choice(["frobenius", "entropic"]),
        default="frobenius",
        show_default=True,
        help="What the nearest tensor is nearest in, where no one slip explains the numbers.",
    ),
    click.option(
        "--mirror-from",
        type=click.Choice(["left", "right"]),
        help="The side that is copied, mirrored, where two sides are no mirror images.",
    ),
    click.option(
        "--meshes", "folders", metavar="DIR", multiple=True, help="Look for meshes there too; may be repeated."
    ),
    click.option(
        "--plot", "plot_path", metavar="OUT.png", help="Draw shapes, and ellipsoids of inertia before and after."
    ),
    click.option("--page", metavar="OUT.html", help="Write a page: links in the colours of the findings."),
    click.option("--fix", metavar="OUT", help="Write the file with the repairs, everything else byte for byte."),
    click.option("--force", "overwrite", is_flag=True, help="Replace the file of --fix if it is there."),
    click.option("--only", metavar="CHECK", multiple=True, help="Run this check only; may be repeated."),
    click.argument("source", metavar="ROBOT"),
)
"""The options of the command and its ROBOT."""


@command(
    "doctor",
    doctor_options,
    examples_=(
        "doctor ur5",
        "doctor quadruped --page quadruped.html --json",
    ),
)
def doctor_command(given: Given) -> ExitCode:
    """Find errors of a robot file, their effect on M and on gravity torques, and the repair.

    Exit code 1 with errors or warnings.
    """
    from ..diagnosis import doctor

    given.plot_path = picture(given.plot_path)
    for folder in given.folders:
        if not Path(folder).is_dir():
            raise ValueRangeError(
                f"--meshes {folder!r} is no folder. Give the one that holds the meshes or their package."
            )
    found = robot_source(given.source)
    check_outputs(
        {"--fix": given.fix, "--plot": given.plot_path, "--page": given.page},
        {"ROBOT": given.source if Path(given.source).is_file() else None},
    )
    if given.fix is not None:
        refuse_existing(given.fix, overwrite=given.overwrite)
    report = doctor(
        found,
        only=given.only or None,
        meshes=given.folders or True,
        metric=given.metric,
        mirror_from=given.mirror_from,
        floating_base=given.floating_base or None,
        model=given.model,
    )
    if given.as_json:
        click.echo(report.to_json(), nl=False)
    else:
        show(doctor_view(report, every=given.strict))
    if given.fix is not None:
        repaired = report.write(given.fix, overwrite=given.overwrite)
        click.echo(
            f"wrote {given.fix}, with {len(repaired)} repair{'' if len(repaired) == 1 else 's'}", err=given.as_json
        )
    if given.plot_path is not None:
        from ..plotting.identification import links_drawn, plot_diagnosis

        if links_drawn(report):
            click.echo(f"wrote {plot_diagnosis(report, given.plot_path)}", err=given.as_json)
        else:
            click.echo("note: no finding changes an inertia, so there is nothing to draw.", err=True)
    if given.page is not None:
        from ..viz.page import write_findings_page

        click.echo(f"wrote {write_findings_page(report, given.page)}", err=given.as_json)
    return report.exit_code(strict=given.strict)


# ── The report


_COLOURS = {Severity.ERROR: "bold red", Severity.WARNING: "yellow", Severity.NOTE: "dim"}
_LISTED = 6
"""Notes of one check that are listed; more are counted."""


def doctor_view(report: DoctorReport, *, every: bool = False) -> RenderableType:
    """Heading and a paragraph for each finding; all notes if ``every``."""
    heading = Text.assemble((report.robot, "bold"), f"  {report.summary}")
    if not report.findings:
        return heading
    shown = list(_shown(report, every=every))
    left = len(report.findings) - len(shown)
    parts: list[RenderableType] = [heading]
    if str(report.effect) != "none":
        parts.append(Text(f"all repairs together change: {report.effect}"))
    parts.append(Text())
    parts += [part for finding in shown for part in _paragraph(finding)]
    if left:
        parts.append(Text(f"{left} more notes; --json lists all.", "dim"))
    return Group(*parts)


def _shown(report: DoctorReport, *, every: bool) -> Iterator[Finding]:
    notes: dict[str, int] = {}
    for finding in report.findings:
        if finding.severity is Severity.NOTE:
            notes[finding.check] = notes.get(finding.check, 0) + 1
            if notes[finding.check] > _LISTED and not every:
                continue
        yield finding


def _paragraph(finding: Finding) -> Iterator[RenderableType]:
    """Severity, check and place, and below them the sentence, the repair and its effect."""
    line = f"{finding.file + ', ' if finding.file else ''}line {finding.line}" if finding.line else ""
    head = ", ".join(x for x in (finding.check, finding.where, line) if x)
    yield Text.assemble((str(finding.severity), _COLOURS[finding.severity]), f"  {head}")
    yield Padding(Text(finding.sentence), (0, 0, 0, 2))
    if finding.repair is not None:
        yield Padding(Text(f"repair: {finding.repair.sentence}"), (0, 0, 0, 2))
    if str(finding.effect) != "none":
        yield Padding(Text(f"effect of the repair: {finding.effect}"), (0, 0, 0, 2))


# ── ``verify``


@robot_command("verify", examples=("verify ur5",))
def verify_command(options: RobotOptions, _: Given) -> ExitCode:
    """Check the robot's dynamics against independent formulas and libraries; exit code 1 if any disagrees."""
    from ..verify import verify

    robot = options.load()
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to check: {robot.name!r} has no joint that moves; load with --floating-base.")
    report = verify(robot)
    show(verification_view(report))
    return ExitCode.FINE if report.passed else ExitCode.NO


def verification_view(report: VerifyReport) -> RenderableType:
    """Verdict, and a row per check: compared quantities, residual and tolerance."""
    made = [check for check in report.checks if not check.skipped]
    failed = [check.name for check in made if not check.passed]
    verdict = f"DISAGREES: {', '.join(failed)}." if failed else f"OK: {len(made)} checks agree."
    return Group(Text(verdict, "bold red" if failed else "bold"), Text(), _table(report))


def _table(report: VerifyReport) -> PlainTable:
    table = PlainTable(f"{report.robot}: {report.states} random states, seed {report.seed}")
    table.words("check", "compares")
    table.numbers("residual", "allowed")
    table.words("")
    for check in report.checks:
        if check.skipped:
            reason = Text.assemble(f"{check.compares}\n", (f"skipped: {check.skipped}", "dim"))
            table.row(check.name, reason, "", "", Text("skipped", "dim"))
        else:
            verdict = Text("agrees", "green") if check.passed else Text("DISAGREES", "bold red")
            table.row(check.name, check.compares, residual(check.residual), residual(check.tolerance), verdict)
    return table
