"""The command ``twistwrench identify``: options, logs of any length, files of the result, and the robot's own file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from ..core.verdict import ExitCode, Word
from ..errors import ValueRangeError
from .console import check_matplotlib, expand_paths, progress_bar, total_bytes, worker_options
from .motion_options import (
    COLUMNS,
    FRICTION_LAWS,
    LOCK_MISSING,
    NO_MOTOR_INERTIA,
    RATE,
    check_payload,
    option_group,
    parse_columns,
    parse_friction,
    parse_known,
    with_torques,
)
from .robot_options import RobotOptions

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..identification import IdentifiedRobot, NormalEquationBlocks
    from ..robot import Robot


class OutputFiles(NamedTuple):
    """The files that are asked for, and how near to the file bodies are held; None: none, chosen."""

    json: str | None
    plot: str | Path | None
    report: str | None
    robot: str | None
    actuators: str | None
    csv: str | None
    strength: float | None

    def write(
        self,
        found: IdentifiedRobot,
        logs: Sequence[str],
        given: dict[str, Any] | None,
        *,
        essential: bool,
        force: bool,
    ) -> None:
        """Write them and say so; after LOOK AGAIN only JSON and pictures, unless ``force``. ``given``: actuators to keep."""
        if self.json is not None:
            _write_text(found.to_json(essential=essential), self.json)
        if self.plot is not None:
            click.echo(f"wrote {found.plot(self.plot)}")
        if self.report is not None:
            click.echo(f"wrote {found.report(self.report)}")
        if not any((self.robot, self.actuators, self.csv)):
            return
        if found.verdict.word is Word.LOOK_AGAIN and not force:
            click.echo("nothing else is written after LOOK AGAIN; --force writes all the same.", err=True)
            return
        if self.robot is not None or self.actuators is not None:
            if self.strength is not None:
                found.__dict__["consistent"] = found.consistent_at(self.strength)
            for note in found.write(self.robot, self.actuators, given=given, logs=logs, force=force):
                click.echo(f"note: {note}", err=True)
            for path in filter(None, (self.robot, self.actuators)):
                click.echo(f"wrote {path}")
        if self.csv is not None:
            _write_table(found, self.csv)


def _write_text(text: str, path: str | Path) -> None:
    from ..core.files import replacing

    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
    click.echo(f"wrote {path}")


def _write_table(found: IdentifiedRobot, path: str | Path) -> None:
    from ..core.files import replacing
    from ..core.tables import CsvWriter

    with replacing(path) as scratch, scratch.open("wb") as file:
        writer = CsvWriter(file)
        writer.row(["group", "value", "deviation", "low", "high", "file"])
        for name, value, deviation, (low, high), before in zip(
            found.groups, found.values, found.standard_deviations, found.interval(), found.prior.mean, strict=True
        ):
            writer.row([name, *map(float, (value, deviation, low, high, before))])
    click.echo(f"wrote {path}")


# ── Logs of any length: information in portions, added to what was saved

LARGE = 1 << 26
"""Bytes of all logs, from which they are read in portions."""


def robot_from_portions(
    robot: Robot,
    logs: tuple[str, ...],
    tests: tuple[str, ...],
    options: dict[str, Any],
    *,
    old: str | None,
    out: str | None,
    workers: int | None,
    scheduler: str | None,
) -> IdentifiedRobot:
    """What all rows of the logs tell, and those of the ``old`` file; ``options`` are those of :func:`accumulate`."""
    from ..core.cluster import workers_of
    from ..identification import accumulate

    with workers_of(workers, scheduler) as team:
        given = {**options, "client": team.client}
        information = _accumulated(robot, logs, old, given)
        tested = accumulate(robot, tests, like=information, **given) if tests else None
    found = information.identified(tested)
    if out is not None:
        click.echo(f"wrote {information.save(out)}")
    return found


def _accumulated(robot: Robot, logs: tuple[str, ...], old: str | None, options: dict[str, Any]) -> NormalEquationBlocks:
    from ..identification import NormalEquationBlocks, accumulate

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


def run_identify(
    options: RobotOptions,
    show: Callable[[RenderableType], None],
    *,
    logs: tuple[str, ...],
    tests: tuple[str, ...],
    left_out: tuple[str, ...],
    columns: tuple[str, ...],
    rate: float | None,
    lock_missing: bool,
    cutoff: str,
    shift: str,
    method: Any,
    no_motor_inertia: bool,
    friction: str,
    stribeck_speed: float,
    plot_path: str | None,
    report_path: str | None,
    csv_path: str | None,
    json_path: str | None,
    out_path: str | None,
    actuators_out: str | None,
    keep_close: str,
    force: bool,
    known: tuple[str, ...],
    payload_only: str | None,
    essential: bool,
    information_path: str | None,
    old_path: str | None,
    workers: int | None,
    scheduler: str | None,
) -> ExitCode:
    """Print what was found with ``show``, and write the files; 0 where the verdict is OK. Raises errors of the library."""
    from ..core.files import check_outputs, picture_path
    from ..identification import identify, without_links
    from .tables.measurement import identification_view

    logs, tests = _expanded(options, logs), _expanded(options, tests)
    inputs = {f"LOG {path}": path for path in (*logs, *tests)}
    check_matplotlib(plot_path or report_path)
    plot_path = None if plot_path is None else picture_path(plot_path)
    outputs: dict[str, str | Path | None] = {
        "--plot": plot_path,
        "--report": report_path,
        "--out": out_path,
        "--actuators-out": actuators_out,
        "--csv": csv_path,
        "--json": json_path,
        "--information": information_path,
    }
    updated = old_path == information_path  # the one output that may be an input: it is replaced when it is whole
    check_outputs(outputs, {**inputs, **options.files, "--add": None if updated else old_path})
    laws, held, strength = parse_friction(friction), parse_known(known), _number(keep_close, "--keep-close")
    check_payload(payload_only, [name for name, path in outputs.items() if path is not None])
    robot, side = _robot(options, logs[0], columns, lock_missing=lock_missing)
    robot = without_links(robot, left_out)
    with progress_bar("identifying") as progress:
        from ..identification.payload import read_motion

        told = parse_columns(columns)
        same: dict[str, Any] = {
            "motor_inertia": not no_motor_inertia,
            "friction": laws,
            "cutoff": _number(cutoff, "--cutoff"),
            "shift": _number(shift, "--shift"),
            "method": method,
            "motor_side": side,
            "known": held,
            "payload_only": payload_only,
            "stribeck_speed": stribeck_speed,
        }
        portions = any(x is not None for x in (information_path, old_path, workers, scheduler))
        if portions or total_bytes((*logs, *tests)) > LARGE:
            given: dict[str, Any] = {"columns": told, "rate": rate, "degrees": options.degrees, "progress": progress}
            files: dict[str, Any] = {
                "old": old_path,
                "out": information_path,
                "workers": workers,
                "scheduler": scheduler,
            }
            found = robot_from_portions(robot, logs, tests, {**same, **given}, **files)
        else:
            motions = {
                path: with_torques(
                    path, read_motion(path, robot, columns=told, rate=rate, degrees=options.degrees, side=side)
                )
                for path in dict.fromkeys((*logs, *tests))
            }
            train, test = [motions[path] for path in logs], [motions[path] for path in tests]
            found = identify(robot, train, test=test, **same, progress=progress)
    show(identification_view(found, essential=essential))
    asked = OutputFiles(json_path, plot_path, report_path, out_path, actuators_out, csv_path, strength)
    names = ["+".join(Path(part).name for part in x.split("+")) for x in logs]
    asked.write(found, names, _given(options), essential=essential, force=force)
    return found.verdict.exit_code


def _expanded(options: RobotOptions, paths: tuple[str, ...]) -> tuple[str, ...]:
    """Folders as the files in them, patterns as what they match, in the order of their names; ``demo`` as the bundled log."""
    from .robot_options import bundled

    found: list[str] = []
    for text in paths:
        found += expand_paths(bundled(text, options.source, "_log.csv", "log"), text)
    return tuple(found)


def _robot(options: RobotOptions, log: str, columns: tuple[str, ...], *, lock_missing: bool) -> tuple[Robot, Any]:
    """The robot without its actuators, and what their file says of the logs."""
    from functools import partial

    from ..identification.payload import motor_side
    from ..motion.motion_file import joints_without_column, open_motion_file
    from .robot_options import bundled

    held = (
        partial(joints_without_column, open_motion_file(log), columns=parse_columns(columns)) if lock_missing else None
    )
    bare = replace(options, actuators=None)
    robot, _ = bare.load_and_locked(held=held)
    if options.actuators is None:
        return robot, None
    return robot, motor_side(robot.model, bundled(options.actuators, options.source, ".yaml", "actuator file"))


def _given(options: RobotOptions) -> dict[str, Any] | None:
    """What the actuator file says already."""
    if options.actuators is None:
        return None
    from ..formats.actuators import actuator_content
    from .robot_options import bundled

    return actuator_content(bundled(options.actuators, options.source, ".yaml", "actuator file"))


def _number(text: str, option: str) -> float | None:
    if text == _AUTO:
        return None
    try:
        return float(text)
    except ValueError:
        raise ValueRangeError(f"{option} {text!r} is neither a number nor {_AUTO}.") from None
