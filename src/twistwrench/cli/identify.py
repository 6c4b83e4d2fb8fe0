"""The command ``twistwrench identify``: options, logs of any length, files of the result, and its report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
from rich.console import Group, RenderableType
from rich.text import Text

from ..core.files import check_outputs, picture_path, replacing
from ..core.numbers import estimate, number, percent, plus_minus
from ..core.tables import CsvWriter
from ..core.text import listed
from ..core.third_party import workers_of
from ..core.verdict import ExitCode, Word
from ..errors import ValueRangeError
from ..formats.actuators import actuator_content
from ..identification import IdentifiedRobot, NormalEquationBlocks, accumulate, identify, without_links
from ..identification.payload import motor_side, read_motion
from ..joints.units import heading_unit
from ..motion.coordinates import Coordinates
from ..motion.motion_file import joints_without_column, open_motion_file
from ..robot import Robot
from .console import (
    check_matplotlib,
    expand_paths,
    progress_bar,
    show,
    show_written,
    total_bytes,
    worker_options,
)
from .motion_options import (
    COLUMNS,
    FRICTION_LAWS,
    LOCK_MISSING,
    NO_MOTOR_INERTIA,
    RATE,
    check_payload,
    parse_columns,
    parse_friction,
    parse_known,
    with_torques,
)
from .plain_table import PlainTable, verdict_word
from .robot_options import RobotOptions, bundled, robot_command
from .usage import Given, option_group


class RobotFiles(NamedTuple):
    """Files of the robot that were written, and notes on them; None: nothing is written after LOOK AGAIN."""

    written: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def write_robot(
    found: IdentifiedRobot, given: Given, strength: float | None, actuators: dict[str, Any] | None
) -> RobotFiles | None:
    """Write the robot's file and its actuators; ``actuators`` are those to keep. Raises errors of the library."""
    if found.verdict.word is Word.LOOK_AGAIN and not given.force:
        return None
    paths = tuple(filter(None, (given.out_path, given.actuators_out)))
    if not paths:
        return RobotFiles()
    if strength is not None:
        found.__dict__["consistent"] = found.consistent_at(strength)
    names = ["+".join(Path(part).name for part in x.split("+")) for x in given.logs]
    notes = found.write(given.out_path, given.actuators_out, given=actuators, logs=names, force=given.force)
    return RobotFiles(paths, tuple(notes))


def write_results(found: IdentifiedRobot, given: Given, robot: RobotFiles | None) -> None:
    """Write all other files, and print what was written; after LOOK AGAIN only JSON and pictures."""
    if given.json_path is not None:
        with replacing(given.json_path) as scratch:
            scratch.write_text(found.to_json(essential=given.essential), encoding="utf-8")
        show_written(given.json_path)
    if given.plot_path is not None:
        show_written(found.plot(given.plot_path))
    if given.report_path is not None:
        show_written(found.report(given.report_path))
    if robot is None:
        if any((given.out_path, given.actuators_out, given.csv_path)):
            click.echo("nothing else is written after LOOK AGAIN; --force writes all the same.", err=True)
        return
    for note in robot.notes:
        click.echo(f"note: {note}", err=True)
    show_written(*robot.written)
    if given.csv_path is not None:
        _write_table(found, given.csv_path)
        show_written(given.csv_path)


def _write_table(found: IdentifiedRobot, path: str | Path) -> None:
    with replacing(path) as scratch, scratch.open("wb") as file:
        writer = CsvWriter(file)
        writer.row(["group", "value", "deviation", "low", "high", "file"])
        for name, value, deviation, (low, high), before in zip(
            found.groups, found.values, found.standard_deviations, found.interval(), found.prior.mean, strict=True
        ):
            writer.row([name, *map(float, (value, deviation, low, high, before))])


# ── Logs of any length: information in portions, added to what was saved

LARGE = 1 << 26
"""Bytes of all logs, from which they are read in portions."""


def robot_from_portions(robot: Robot, given: Given, options: dict[str, Any]) -> IdentifiedRobot:
    """Robot identified from all rows of the logs and those of ``--add``; ``options`` are those of :func:`accumulate`."""
    with workers_of(given.workers, given.scheduler) as team:
        settings = {**options, "client": team.client}
        information = _accumulated(robot, given.logs, given.old_path, settings)
        tested = accumulate(robot, given.tests, like=information, **settings) if given.tests else None
    found = information.identified(tested)
    if given.information_path is not None:
        information.save(given.information_path)
    return found


def _accumulated(robot: Robot, logs: tuple[str, ...], old: str | None, options: dict[str, Any]) -> NormalEquationBlocks:

    if old is None:
        return accumulate(robot, logs, **options)
    before = NormalEquationBlocks.load(old, robot)
    if twice := sorted(set(before.logs) & set(logs)):
        raise ValueRangeError(f"{old} has the rows of {twice[0]!r} already. Leave that log out.")
    return before + accumulate(robot, logs, like=before, **options)


# ── The command

_AUTO = "auto"


identify_options = option_group(
    click.option(
        "--keep-close",
        metavar="STRENGTH",
        default=_AUTO,
        show_default=True,
        help="How strongly bodies are held near the file's, 0.01 to 100000.",
    ),
    click.option("--actuators-out", metavar="OUT.yaml", help="Write friction and motor inertias as an actuator file."),
    click.option("--out", "out_path", metavar="OUT.urdf", help="Write the robot's file with the identified numbers."),
    click.option(
        "--information", "information_path", metavar="OUT.npz", help="Save what all rows say, to be added to later."
    ),
    click.option("--add", "old_path", metavar="OLD.npz", help="Add the logs to what was saved with --information."),
    worker_options,
    click.option("--force", is_flag=True, help="Write the files in spite of the verdict LOOK AGAIN."),
    click.option("--json", "json_path", metavar="OUT.json", help="Write everything found as JSON, in SI units."),
    click.option("--plot", "plot_path", metavar="OUT.png", help="Draw measured and predicted torques, groups, and γ."),
    click.option("--report", "report_path", metavar="OUT.html", help="Write all of it as one page."),
    click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the groups with their intervals as a table."),
    FRICTION_LAWS,
    click.option(
        "--stribeck-speed",
        type=float,
        metavar="SPEED",
        default=0.1,
        show_default=True,
        help="At which static friction has faded, where stribeck is asked for [rad/s, m/s].",
    ),
    click.option(
        "--payload-only",
        metavar="FRAME",
        help="Only seek the body fixed to FRAME: all other numbers, friction too, are as the robot's file has them.",
    ),
    click.option(
        "--known",
        metavar="NAME=VALUE",
        multiple=True,
        help="Hold a parameter: 'link_3.m=0.73 kg', joint_2.viscous=1.2; SI units; may be repeated.",
    ),
    click.option("--essential", is_flag=True, help="Print the fewest groups that predict as well as all of them."),
    NO_MOTOR_INERTIA,
    click.option(
        "--method",
        type=click.Choice(["irls", "wls", "ols"]),
        default="irls",
        show_default=True,
        help="Least squares: robust, weighted, or plain.",
    ),
    click.option("--shift", metavar="SECONDS", default=_AUTO, show_default=True, help="Torques later than positions."),
    click.option("--cutoff", metavar="HZ", default=_AUTO, show_default=True, help="Of the low-pass, without delay."),
    LOCK_MISSING,
    RATE,
    COLUMNS,
    click.option(
        "--without",
        "left_out",
        metavar="LINK",
        multiple=True,
        help="The robot of the logs lacks this link; may be repeated.",
    ),
    click.option(
        "--test", "tests", metavar="LOG", multiple=True, help="A log that is only predicted; may be repeated."
    ),
    click.argument("logs", metavar="LOG...", nargs=-1, required=True),
)
"""The options of the command and its LOGs."""


@robot_command(
    "identify",
    identify_options,
    examples=("identify my_arm.urdf log.csv --test other_log.csv --report report.html",),
    robot_first=True,
)
def identify_command(options: RobotOptions, given: Given) -> ExitCode:
    """The robot's masses, inertias, friction and motor inertias from logs, with intervals, and what speaks against the logs.

    The first word is the verdict. OK ends with exit code 0; UNSURE and LOOK AGAIN with 1, and after LOOK AGAIN only --json is
    written unless --force is given. Several files of one log are written a.csv+b.csv.
    """
    given.logs, given.tests = _expanded(options, given.logs), _expanded(options, given.tests)
    inputs = {f"LOG {path}": path for path in (*given.logs, *given.tests)}
    check_matplotlib(given.plot_path or given.report_path)
    given.plot_path = None if given.plot_path is None else picture_path(given.plot_path)
    outputs: dict[str, str | Path | None] = {
        "--plot": given.plot_path,
        "--report": given.report_path,
        "--out": given.out_path,
        "--actuators-out": given.actuators_out,
        "--csv": given.csv_path,
        "--json": given.json_path,
        "--information": given.information_path,
    }
    # The one output that may be an input: it is replaced when it is whole.
    updated = given.old_path == given.information_path
    check_outputs(outputs, {**inputs, **options.files, "--add": None if updated else given.old_path})
    fitting, strength = _fitting(given), _number(given.keep_close, "--keep-close")
    check_payload(given.payload_only, [name for name, path in outputs.items() if path is not None])
    robot, side = _robot(options, given.logs[0], given.columns, lock_missing=given.lock_missing)
    robot = without_links(robot, given.left_out)
    with progress_bar("identifying") as progress:
        found = _identified(robot, options, given, {**fitting, "motor_side": side, "progress": progress})
    files = write_robot(found, given, strength, _actuators(options))
    show(identification_view(found, essential=given.essential))
    show_written(given.information_path)
    write_results(found, given, files)
    return found.verdict.exit_code


def _fitting(given: Given) -> dict[str, Any]:
    """Options of the fit as keyword arguments of :func:`identify`."""
    return {
        "friction": parse_friction(given.friction),
        "known": parse_known(given.known),
        "motor_inertia": not given.no_motor_inertia,
        "cutoff": _number(given.cutoff, "--cutoff"),
        "shift": _number(given.shift, "--shift"),
        "method": given.method,
        "payload_only": given.payload_only,
        "stribeck_speed": given.stribeck_speed,
    }


def _identified(robot: Robot, options: RobotOptions, given: Given, fitting: dict[str, Any]) -> IdentifiedRobot:
    """The fit to the logs: in memory, or by portions if they are long or are to be added up."""
    reading: dict[str, Any] = {
        "columns": parse_columns(given.columns),
        "rate": given.rate,
        "degrees": options.degrees,
    }
    paths = (*given.logs, *given.tests)
    portions = any(x is not None for x in (given.information_path, given.old_path, given.workers, given.scheduler))
    if portions or total_bytes(paths) > LARGE:
        return robot_from_portions(robot, given, {**fitting, **reading})
    side = fitting["motor_side"]
    motions = {
        path: with_torques(path, read_motion(path, robot, side=side, **reading)) for path in dict.fromkeys(paths)
    }
    train, test = [motions[path] for path in given.logs], [motions[path] for path in given.tests]
    return identify(robot, train, test=test, **fitting)


def _expanded(options: RobotOptions, paths: tuple[str, ...]) -> tuple[str, ...]:
    """Expand folders and patterns to files, sorted by name, and ``demo`` to the bundled log."""
    found: list[str] = []
    for text in paths:
        found += expand_paths(bundled(text, options.source, "_log.csv", "log"), text)
    return tuple(found)


def _robot(options: RobotOptions, log: str, columns: tuple[str, ...], *, lock_missing: bool) -> tuple[Robot, Any]:
    """Robot without its actuators, and the side of the gears that logs are measured on."""
    held = (
        partial(joints_without_column, open_motion_file(log), columns=parse_columns(columns)) if lock_missing else None
    )
    bare = replace(options, actuators=None)
    robot, _ = bare.load_and_locked(held=held)
    if options.actuators is None:
        return robot, None
    return robot, motor_side(robot.model, bundled(options.actuators, options.source, ".yaml", "actuator file"))


def _actuators(options: RobotOptions) -> dict[str, Any] | None:
    """Content of the actuator file given; None without one."""
    if options.actuators is None:
        return None

    return actuator_content(bundled(options.actuators, options.source, ".yaml", "actuator file"))


def _number(text: str, option: str) -> float | None:
    if text == _AUTO:
        return None
    try:
        return float(text)
    except ValueError:
        raise ValueRangeError(f"{option} {text!r} is neither a number nor {_AUTO}.") from None


# ── The report


_KINDS = {"test": "in the logs of --test", "five-fold": "in fifths of the time, each predicted from the others"}
_VAGUE = 5


def identification_view(found: IdentifiedRobot, *, essential: bool = False) -> RenderableType:
    """Verdict and its basis; with the essential groups if ``essential``."""
    return Group(*_parts(found), *(_essential(found) if essential else ()))


def _parts(found: IdentifiedRobot) -> Iterator[RenderableType]:
    verdict = found.verdict
    yield Text.assemble(
        verdict_word(verdict.word),
        f"  {found.original.name}: {percent(found.held_out.all, 3)} of the torques left {_KINDS[found.held_out.kind]}",
    )
    for doubt in found.doubts:
        yield Text(f"• {doubt.sentence}", "" if not doubt.refuses else "red")
    for note in found.notes:
        yield Text(note)
    yield Text(
        f"{found.settings}; weights {found.method}; deviations from blocks of {number(found.covariance.block)} s"
    )
    yield _residuals(found)
    yield from _payload(found)
    yield _groups(found)
    if found.base.held.any():
        yield Text(f"{int(found.base.held.sum())} parameters were held at known values")
    if vague := found.vague:
        names = listed((name.split(" ")[0] for name in vague), _VAGUE, "; ")
        yield Text(f"vague, deviation beyond 30 %: {names}")


def _payload(found: IdentifiedRobot) -> Iterator[Text]:
    payload = found.payload
    if payload is None:
        return
    com = ", ".join(plus_minus(x, d) for x, d in zip(payload.com, payload.com_deviations, strict=True))
    yield Text(
        f"payload at {payload.frame}: {plus_minus(payload.mass, payload.mass_deviation)} kg, centre of mass "
        f"({com}) m in its frame"
    )
    if payload.unidentifiable:
        yield Text(f"no torque of this robot tells {', '.join(payload.unidentifiable)}: taken as the file has it")


def _essential(found: IdentifiedRobot) -> Iterator[Text]:
    one = found.essential
    names = "; ".join(
        f"{name.split(' ')[0]} {number(value)}" for name, value in zip(one.names, one.values, strict=True)
    )
    yield Text(
        f"{len(one.names)} essential groups of {int((~found.base.held).sum())} predict rows held out to "
        f"{percent(one.held_out, 3)}, all to {percent(one.curve[0][1], 3)} (in units of each joint's residuals): {names}"
    )


def _residuals(found: IdentifiedRobot) -> PlainTable:
    table = PlainTable("Residuals of rows held out")
    table.words("joint")
    table.numbers(
        "held out", f"size [{heading_unit('tau', Coordinates.from_model(found.original.model).angular_velocity)}]"
    )
    for (name, share), sigma in zip(found.held_out.joints.items(), found.sigma, strict=True):
        table.row(name, percent(share, 3), sigma)
    return table


def _groups(found: IdentifiedRobot) -> PlainTable:
    table = PlainTable(f"{int((~found.base.held).sum())} groups of parameters")
    table.words("group")
    table.numbers("value", "deviation", "95 % from", "to", "file")
    rows = zip(found.groups, found.values, found.standard_deviations, found.interval(), found.prior.mean, strict=True)
    for held, (name, value, deviation, (low, high), before) in zip(found.base.held, rows, strict=True):
        if held:
            continue
        table.row(name, *estimate(value, deviation), low, high, before)
    return table
