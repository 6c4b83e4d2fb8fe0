"""The commands ``twistwrench doctor`` and ``verify``: errors of robot files, checks of the dynamics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import click

from ..answers.blocks import Block, Headline, Line, Table, numbers, remarks, words
from ..core.colours import Style, strong
from ..core.errors import ValueRangeError
from ..core.numbers import residual
from ..core.verdict import ExitCode, Word
from ..diagnosis import DoctorReport, Finding, Severity, doctor
from ..formats.xacro import ENDING as XACRO_ENDING
from ..motion.model_doubts import base_doubts
from ..robot import Robot, load
from ..testing.verify import Check, VerifyReport, verify
from .main import Given, command, option
from .report import PAGE, REPORT, write_report, write_viewer
from .shared import JSON, LIMITS, XACRO, RobotOptions, base_option, robot_command, robot_source, xacro_arguments
from .terminal import show


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
    option("--strict", "Exit with 1 also for notes, and list all of them."),
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
    )
    blocks = list(doctor_view(report, every=given.strict))
    if given.json is not None:
        given.results = report.to_json()
    show(*blocks)
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
        write_doctor_report(report, blocks, given, files)
    return report.exit_code(strict=given.strict)


def _expanded(source: str | Path, arguments: Mapping[str, str], given: Given) -> Robot:
    """Robot of a file with macros, with whatever inertias it has."""
    floating_base = base_option(given.floating_base, given.fixed_base)
    return load(source, xacro=arguments, inertia="accept", floating_base=floating_base, model=given.model)


def write_doctor_report(
    report: DoctorReport, blocks: Sequence[Block], given: Given, files: Mapping[str, str | Path | None]
) -> None:
    """Write the files of --html and --report, with links coloured by finding and inertias before and after repair."""
    from ..viz.page import findings_scene
    from ..viz.pictures import drawn, robot_picture
    from ..viz.plots.diagnosis import links_drawn, plot_diagnosis

    pictures, scene = [], findings_scene(report)
    link = write_viewer(given, scene.robot, scene=scene)
    if given.report is not None and scene.robot.nv:
        named = any(finding.where.startswith("link") for finding in report.findings)
        colours = ", links in the colours of their findings: red error, amber warning, grey note" if named else ""
        title = f"{report.robot}{colours}"
        pictures.append(robot_picture(scene.robot, None, None, title, scene, link))
    if given.report is not None and links_drawn(report):
        pictures.append(drawn("Inertia before and after", lambda path: plot_diagnosis(report, path)))
    write_report(given, "doctor", report.robot, blocks, files=files, pictures=pictures, robot=scene.robot)


# ── The report


_COLOURS = {Severity.ERROR: strong(Style.OVER), Severity.WARNING: Style.NEAR, Severity.NOTE: Style.QUIET}
_LISTED = 6
"""Maximum number of listed notes of one check; further notes are counted."""


def doctor_view(report: DoctorReport, *, every: bool = False) -> Iterator[Block]:
    """Heading and one paragraph per finding; all notes if ``every``."""
    severities = {finding.severity for finding in report.findings}
    doubtful = Severity.WARNING in severities or (every and severities)
    word = Word.LOOK_AGAIN if Severity.ERROR in severities else Word.UNSURE if doubtful else Word.OK
    yield Headline(word, f"{report.robot}, {report.summary}.")
    yield from remarks(f"{text[0].upper()}{text[1:]}." for text in base_doubts(report.subject.robot.model))
    if not report.findings:
        return
    if str(report.effect) != "none":
        yield f"all repairs together change: {report.effect}"
    yield ""
    shown = list(_shown(report, every=every))
    for finding in shown:
        yield from _paragraph(finding)
    if left := len(report.findings) - len(shown):
        yield Line((f"{left} more notes; --json lists all.", Style.QUIET))


def _shown(report: DoctorReport, *, every: bool) -> Iterator[Finding]:
    notes: dict[str, int] = {}
    for finding in report.findings:
        if finding.severity is Severity.NOTE:
            notes[finding.check] = notes.get(finding.check, 0) + 1
            if notes[finding.check] > _LISTED and not every:
                continue
        yield finding


def _paragraph(finding: Finding) -> Iterator[Line]:
    """Severity, check and place; below them the sentence, the repair and its effect."""
    line = f"{finding.file + ', ' if finding.file else ''}line {finding.line}" if finding.line else ""
    head = ", ".join(x for x in (finding.check, finding.where, line) if x)
    yield Line((str(finding.severity), _COLOURS[finding.severity]), f"  {head}")
    yield Line(finding.sentence, indent=2)
    if finding.repair is not None:
        yield Line(f"repair: {finding.repair.sentence}", indent=2)
    if str(finding.effect) != "none":
        yield Line(f"effect of the repair: {finding.effect}", indent=2)


# ── ``verify``


@robot_command("verify", JSON, examples=("verify ur5",), angles=False)
def verify_command(options: RobotOptions, given: Given) -> ExitCode:
    """Check the dynamics of a robot against independent formulas and libraries. Exit code: 1 if one disagrees."""
    given.check_files(options.files)
    robot = options.load()
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to check: {robot.name!r} has no joint that moves; load with --floating-base.")
    report = verify(robot)
    show(*verification_view(report))
    return ExitCode.FINE if report.passed else ExitCode.NO


def verification_view(report: VerifyReport) -> list[Block]:
    """Verdict, and one row per check: compared quantities, residual and tolerance."""
    checks = report.checks
    failed = [check.name for check in checks if not check.skipped and not check.passed]
    count = sum(not check.skipped for check in checks)
    said = f"checks that disagree: {', '.join(failed)}." if failed else f"{count} checks agree."

    def compares(check: Check) -> str | Line:
        return (
            Line(f"{check.compares}\n", (f"skipped: {check.skipped}", Style.QUIET)) if check.skipped else check.compares
        )

    def answer(check: Check) -> Line:
        if check.skipped:
            return Line(("skipped", Style.QUIET))
        return Line(("agrees", Style.GOOD) if check.passed else ("DISAGREES", strong(Style.OVER)))

    def figure(value: float) -> Line:
        return Line(residual(value), value=value)

    table = Table(
        f"{report.robot}: {report.states} random states, seed {report.seed}",
        words("check", [check.name for check in checks]),
        words("compares", map(compares, checks)),
        numbers("residual", ["" if check.skipped else figure(check.residual) for check in checks]),
        numbers("allowed", ["" if check.skipped else figure(check.tolerance) for check in checks]),
        words("", map(answer, checks)),
    )
    return [Headline(Word.LOOK_AGAIN if failed else Word.OK, said), "", table]
