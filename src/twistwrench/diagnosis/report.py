"""The doctor: runs all checks on a robot file and reports the findings with the repaired robot."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.errors import ValueRangeError
from ..core.files import refuse_existing, replacing
from ..core.glossary import complete
from ..core.verdict import ExitCode, Verdict, Word
from ..formats.edit import apply_edits, encode_as
from ..formats.xml import Place
from ..mechanics.bodies.inertia import SpatialInertia
from ..motion import limits_file
from ..robot import Robot, load
from ..shapes.solids import METRICS
from .checks import CHECKS
from .findings import Effect, FileRepair, Finding, Severity
from .options import Options
from .subject import MOST_BODIES, Subject, read_subject

if TYPE_CHECKING:
    from ..core.answers.blocks import Block

Metric: TypeAlias = Literal["frobenius", "entropic"]
"""Distances between inertias."""
Side: TypeAlias = Literal["left", "right"]
"""Sides of a robot that are mirror images."""
CHECKS_REPAIRED_AS_NOTES = ("impossible", "mirror")
"""Checks whose notes are also repaired: other programs reject such links, or the user chose a side."""


@dataclass(frozen=True, eq=False, repr=False)
class DoctorReport(Answer):
    """Report of :func:`twistwrench.doctor`: findings about a robot file, worst first.

    The verdict is LOOK AGAIN with errors, UNSURE with warnings, and otherwise OK.

    Attributes
    ----------
    robot : str, name of the robot
    source : str, description of the input
    findings : tuple of Finding
    checks : tuple of str, names of the executed checks
    contents : Subject, contents of the file
    strict : bool, True if notes count against the verdict

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> report = tw.doctor(tw.robots.path_of("ur5"))
    >>> print(report.headline)
    OK: ur5, 0 errors, 0 warnings, 1 note.
    >>> report.exit_code(), [one["check"] for one in report.to_dict()["findings"]], report.to_json()[0]
    (<ExitCode.FINE: 0>, ['friction'], '{')
    >>> report.repaired().nv, report.repaired_text() == tw.robots.path_of("ur5").read_text()
    (6, True)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report.write(f"{folder}/ur5.urdf")
    ()
    """

    robot: str
    source: str
    findings: tuple[Finding, ...]
    checks: tuple[str, ...]
    contents: Subject
    strict: bool = False
    call = "doctor"
    """Function and command of this answer, named in its JSON."""

    @property
    def verdict(self) -> Verdict:
        """LOOK AGAIN with errors, UNSURE with warnings, and with notes if ``strict``; otherwise OK."""
        errors = [finding for finding in self.findings if finding.severity is Severity.ERROR]
        if errors:
            return Verdict(Word.LOOK_AGAIN, _verdict_sentences(errors))
        doubts = [finding for finding in self.findings if self.strict or finding.severity is Severity.WARNING]
        if doubts:
            return Verdict(Word.UNSURE, _verdict_sentences(doubts))
        return Verdict(Word.OK)

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot

    @property
    def brief(self) -> str:
        """Number of findings by severity."""
        return self.summary

    def blocks(self) -> Iterator[Block]:
        """Verdict, effect of all repairs, and the findings.

        Returns
        -------
        blocks : iterator of Block
        """
        from .report_view import doctor_view

        return doctor_view(self)

    def sources(self) -> Mapping[str, str | Path]:
        """File of the robot.

        Returns
        -------
        files : {argument: path}
        """
        if self.contents.path is None:
            return {}
        return {"ROBOT": self.contents.path}

    @property
    def paragraphs(self) -> list[list[Finding]]:
        """Groups of findings with equal severity, check and kind of repair, worst first.

        A collective finding, which is about several joints together, is a group by itself.
        """
        groups: dict[tuple[str, str, str, str], list[Finding]] = {}
        for finding in self.findings:
            repair_kind = "" if finding.repair is None else finding.repair.kind
            own_sentence = finding.sentence if finding.collective else ""
            key = (str(finding.severity), finding.check, repair_kind, own_sentence)
            groups.setdefault(key, []).append(finding)
        return list(groups.values())

    @property
    def effect(self) -> Effect:
        """Combined effect of all repairs."""
        inertias: dict[str, SpatialInertia] = {}
        for finding in reversed(self.findings):  # later repairs replace earlier ones, so the worst finding counts
            if finding.repair is not None:
                inertias |= finding.repair.inertias
        if not inertias:
            return Effect()
        return self.contents.robot.effects.evaluate(inertias)

    @property
    def summary(self) -> str:
        """Number of findings by severity, as text."""
        counts = Counter(finding.severity for finding in self.findings)
        texts = []
        for severity in Severity:
            plural = "" if counts[severity] == 1 else "s"
            texts.append(f"{counts[severity]} {severity}{plural}")
        return ", ".join(texts)

    def exit_code(self, *, strict: bool = False) -> ExitCode:
        """Exit code of a command that prints the report: 1 for errors or warnings, and for notes if they count.

        Parameters
        ----------
        strict : bool, count notes, as a report made with ``strict`` does by itself

        Returns
        -------
        code : ExitCode
        """
        counted_findings = list(self.findings)
        if not (strict or self.strict):
            counted_findings = [finding for finding in self.findings if finding.severity is not Severity.NOTE]
        return ExitCode.NO if counted_findings else ExitCode.FINE

    def to_dict(self) -> dict[str, Any]:
        """Data of the answer in SI units; each group of :attr:`paragraphs` is one entry, with all its ``places``.

        Returns
        -------
        report : dict, which ``json.dumps`` accepts
        """
        groups = []
        for group in self.paragraphs:
            entries = list(map(_finding_data, group))
            worst_entry = entries[0]
            groups.append({**worst_entry, "places": entries})
        return {**super().to_dict(), "source": self.source, "checks": list(self.checks), "findings": groups}

    @property
    def repairs(self) -> tuple[Finding, ...]:
        """Findings whose repairs :meth:`write` applies to the file.

        These are errors, warnings, impossible tensors, and links to be mirrored if a side is given, provided that the file
        contains the numbers. If several findings change the same number, only the worst of them is included.
        """
        repaired_findings: list[Finding] = []
        edited_places: set[Place] = set()
        for finding in self.findings:  # worst first
            if finding.repair is None or not finding.repair.edits:
                continue
            if finding.severity is Severity.NOTE and finding.check not in CHECKS_REPAIRED_AS_NOTES:
                continue
            places = {edit.place for edit in finding.repair.edits}
            if places.isdisjoint(edited_places):
                repaired_findings.append(finding)
                edited_places |= places
        return tuple(repaired_findings)

    def repaired_text(self) -> str:
        """Text of the repaired file: only the affected numbers change, with a comment before each element.

        Returns
        -------
        text : str

        Raises
        ------
        ValueRangeError
            The robot has no file.
        """
        if not self.contents.text:
            raise ValueRangeError(f"robot {self.robot!r} was not read from a file, so there is none to edit.")
        edits_with_comments = []
        for finding in self.repairs:
            repair = finding.repair
            if repair is not None:
                edits_with_comments += [(edit, repair.sentence) for edit in repair.edits]
        if not edits_with_comments:
            return self.contents.text
        return apply_edits(self.contents.text, edits_with_comments)

    def repaired(self) -> Robot:
        """Robot of the repaired file.

        Returns
        -------
        robot : Robot

        Raises
        ------
        InertiaError
            A moving body is still physically impossible.
        ValueRangeError
            The robot has no file.
        """
        subject = self.contents
        folders = [] if subject.path is None else [subject.path.resolve().parent]  # of included files and meshes
        return load(
            self.repaired_text(), include_paths=folders, floating_base=subject.floating_base, model=subject.model
        )

    def write(self, path: str | Path, *, overwrite: bool = False) -> tuple[Finding, ...]:
        """Write the repaired file; all other bytes are unchanged.

        Returns
        -------
        findings : tuple of Finding, the repaired ones

        Raises
        ------
        ValueRangeError
            The robot has no file, or the path exists or cannot be written.
        """
        text = self.repaired_text()
        target = refuse_existing(path, overwrite=overwrite)
        with replacing(target) as temporary_file:
            temporary_file.write_bytes(encode_as(text, self.contents.data))  # with the encoding of the original
        return self.repairs


def _verdict_sentences(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Place and sentence of each finding, without repetitions."""
    sentences = [f"{finding.where}: {finding.sentence}".rstrip(".") for finding in findings]
    return tuple(dict.fromkeys(sentences))  # each once, in their order


def _finding_data(finding: Finding) -> dict[str, Any]:
    """Data of a finding for JSON."""
    return {
        "check": finding.check,
        "severity": str(finding.severity),
        "where": finding.where,
        "file": finding.file,
        "line": finding.line,
        "sentence": finding.sentence,
        "numbers": {name: _finite_or_none(value) for name, value in finding.numbers.items()},
        "effect": {name: _finite_or_none(value) for name, value in vars(finding.effect).items()},
        "repair": _repair_data(finding.repair),
    }


def _repair_data(repair: FileRepair | None) -> dict[str, Any] | None:
    """Data of a repair for JSON; None without a repair."""
    if repair is None:
        return None
    return {
        "kind": repair.kind,
        "sentence": repair.sentence,
        "metric": repair.metric,
        "inertias": {link: inertia.parameters.tolist() for link, inertia in repair.inertias.items()},
        "written": bool(repair.edits),  # True if the numbers to change are in the file
    }


def _finite_or_none(value: Any) -> Any:
    """Replace values that JSON cannot represent by None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def doctor(
    robot: str | Path | Robot,
    *,
    only: str | Sequence[str] | None = None,
    meshes: bool | Sequence[str | Path] = True,
    metric: Metric = "frobenius",
    mirror_from: Side | None = None,
    floating_base: bool | None = None,
    model: str | None = None,
    max_bodies: int = MOST_BODIES,
    limits: limits_file.Given = None,
    strict: bool = False,
) -> DoctorReport:
    """Find errors in a robot file, their effect on the dynamics, and repairs.

    Parameters
    ----------
    robot : str, Path or Robot, a URDF, MJCF or SDF file, its text, or a robot (its file is read again if it has one)
    only : str or sequence of str, optional
        Run only this check; default: all.
    meshes : bool or sequence of folders, whether to read mesh files
        Additional folder to search for meshes.
    metric : "frobenius" or "entropic"
        Distance to minimise if no single error explains an inertia.
    mirror_from : "left" or "right", optional
        Side to copy where left and right links are not mirror images.
    floating_base : bool, optional; default: as in the file
        Let the base move freely, so that its inertia is checked.
    model : str, optional
        Model to read from an SDF world.
    max_bodies : int, largest number of bodies
    limits : path of a limits file, Limits, {joint: effort} [N m or N], or {kind: (nv,) array}, optional
        Limits of the joints, in place of the robot file's; the table of :func:`info` is a template.
    strict : bool
        Count notes against the verdict too.

    Returns
    -------
    report : DoctorReport
        Its ``findings`` are ordered by severity, then by effect.

    Raises
    ------
    NotFoundError
        The file does not exist.
    ModelError
        The file cannot be read or is not a robot.

    Notes
    -----
    The effect of a finding is the largest change of a diagonal entry of the mass matrix and of a gravity torque between
    the file and its repair, over 200 configurations with a fixed seed. The severity depends on it.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.doctor(tw.robots.path_of("ur5"), only="impossible").summary
    '0 errors, 0 warnings, 0 notes'
    """
    check_names = list(CHECKS)
    if only is not None:
        check_names = [only] if isinstance(only, str) else list(only)
    for name in check_names:
        arguments.choice(name, "doctor: only", list(CHECKS))
    metric_name = arguments.choice(metric, "doctor: metric", list(METRICS))
    side = ""
    if mirror_from is not None:
        side = arguments.choice(mirror_from, "doctor: mirror_from", ("left", "right"))
    options = Options(metric_name, side)
    subject = read_subject(robot, meshes=meshes, floating_base=floating_base, model=model, max_bodies=max_bodies)
    if limits is not None:
        subject = _with_limits(subject, limits)
    findings: list[Finding] = []
    for name in check_names:
        findings += CHECKS[name](subject.robot, options)
    findings.sort(key=_rank)
    robot_name = subject.robot.model.name
    return DoctorReport(robot_name, _source_text(subject), tuple(findings), tuple(check_names), subject, strict)


def _with_limits(subject: Subject, limits: limits_file.Given) -> Subject:
    """Subject whose joints have other limits."""
    model = subject.robot.model
    model = replace(model, limits=limits_file.limits_of(limits, model))
    return replace(subject, robot=replace(subject.robot, model=model))


def _source_text(subject: Subject) -> str:
    """Description of the input: the path, the text, or the robot's name."""
    if subject.path is not None:
        return str(subject.path)
    return "the text given" if subject.text else subject.robot.model.name


_EFFECT_DIGITS = 6
"""Decimals of a percentage that are not rounding errors."""


def _rank(finding: Finding) -> tuple[int, float]:
    """Sort key of the report: by severity, worst first, then by effect, largest first; of equal ones, in the file's order."""
    effect = finding.effect
    severity_rank = list(Severity).index(finding.severity)
    largest_percentage = max(effect.inertia_percent, effect.effort_percent)
    return severity_rank, -round(largest_percentage, _EFFECT_DIGITS)


complete(globals())  # docstrings get the entries of arguments that several functions share
