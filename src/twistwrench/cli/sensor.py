"""The commands ``twistwrench sensor identify``, ``compensate`` and ``poses``: options, files and reports."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np

from ..answers.blocks import Block, Headline, Line, Remark, Table, numbers, remarks, words
from ..core.arguments import parse_numbers
from ..core.colours import Style
from ..core.doubts import Doubt, doubt
from ..core.errors import ModelWarning, ValueRangeError
from ..core.gravity import STRENGTH
from ..core.numbers import estimate, number, percent, quantity, seconds
from ..core.tables import csv_table
from ..core.typing import Array
from ..core.verdict import ExitCode, Word
from ..mechanics.joints.units import heading_unit, unit_of
from ..mechanics.lie import quaternion, so3
from ..mechanics.lie.labelled import WRENCH
from ..sensing import Identification, PoseProposal, ReadingLog, identify, propose_poses, read_log, write_sensor
from ..sensing.contact_detection import Compensation, compensation, left_over
from ..sensing.files import read_sensor_file
from ..sensing.identification import CAUSES
from ..sensing.outliers import runs
from .main import Given, command, option, with_option_names
from .report import REPORT, write_report
from .shared import JSON, csv_option, show_written, write_csv
from .terminal import show

_LOGS = {"demo": "demo_poses.csv", "demo-motion": "demo_motion.csv"}
_SENSORS = {"demo": "demo_sensor.json"}
_HERE = Path(__file__).parents[1] / "sensing"
SIGN = option(
    "--sign",
    "Readings are what the load does to the sensor (at rest its weight), or what the sensor does to it.",
    choices=("on_sensor", "by_sensor"),
    default="on_sensor",
)

GRAVITY_OPTION = option("--gravity", "Its size [m/s²]; -z of the world.", default=STRENGTH)

CSV = csv_option("Write the readings without bias and load as a table")

PLOT = option("--plot OUT.png", "Draw the readings before and after.")


def _path(name: str, demos: dict[str, str]) -> Path:
    """Path of a log or sensor file; demos are bundled."""
    return _HERE / demos[name] if name in demos and not Path(name).is_file() else Path(name)


def read_readings(name: str, gravity: float) -> ReadingLog:
    """Readings of a log with gravity of the given magnitude [m/s²]. Raises ValueRangeError."""
    if not (gravity > 0 and math.isfinite(gravity)):
        raise ValueRangeError(
            f"--gravity {gravity!r} is not a valid magnitude of gravity. Give it in m/s², such as {STRENGTH}."
        )
    with warnings.catch_warnings():  # the report lists the doubts
        warnings.simplefilter("ignore", ModelWarning)
        return read_log(_path(name, _LOGS), gravity=(0.0, 0.0, -gravity))


def write_readings(log: ReadingLog, compensated: Array, path: str | None) -> None:
    """Write readings without bias and load (n, 6), with times if the log has them."""
    head = [] if log.time is None else ["time"]
    rows = compensated if log.time is None else np.column_stack([log.time, compensated])
    if path is not None:
        with csv_table(path, [*head, *WRENCH]) as table:
            table.numbers(rows)


def parse_count(text: str, option: str, *counts: int) -> list[float]:
    """Parse comma-separated numbers; raises ValueRangeError with the name of the option."""
    return parse_numbers(text, option, f"{' or '.join(map(str, counts))} numbers separated by commas", *counts)


def _check_files(given: Given) -> dict[str, str | Path | None]:
    """Check the files of a command, and return its inputs."""
    log, sensor = given.log, getattr(given, "sensor", None)
    inputs = {"LOG": log and _path(log, _LOGS), "--sensor": sensor and _path(sensor, _SENSORS)}
    given.check_files(inputs)
    return inputs


def _draw(
    given: Given,
    command: str,
    log: ReadingLog,
    found: Identification | Compensation,
    marked: tuple[Array, str],
    blocks: list[Block],
    files: Mapping[str, str | Path | None],
) -> None:
    """Write the plot and the report if requested; readings in ``marked`` carry a label."""
    from ..viz.plots.explanation import plot_compensation

    def plot(path: Path) -> None:
        plot_compensation(log, found.sensor, found.noise, path, marked=marked[0], mark=marked[1])

    if given.plot is not None:
        plot(given.plot)
    show_written(given.csv, given.plot)
    if given.report is not None:
        from ..viz.pictures import drawn

        pictures = [drawn("Readings before and after", plot)]
        write_report(given, f"sensor {command}", Path(log.name).name, blocks, files=files, pictures=pictures)


# ── ``sensor compensate``


@command(
    "compensate",
    click.argument("log", metavar="LOG"),
    option("--sensor SENSOR.json", "Sensor file written by `identify --save`, or 'demo'.", required=True),
    GRAVITY_OPTION,
    option(
        "--contacts RATE",
        "Detect contacts, with this false-alarm rate per reading, for example 1e-6.",
        "false_alarms",
        type=float,
    ),
    CSV,
    JSON,
    PLOT,
    REPORT,
    examples_=("sensor compensate demo --sensor demo",),
    short_help="Subtract weight, inertial load and bias from a log; detect contacts.",
)
def compensate_command(given: Given) -> ExitCode:
    """Subtract bias, weight and inertial load from the readings of a sensor.

    Exit code: 1 if --contacts finds one, or, LOOK AGAIN, if the sensor file does not explain the log: another tool, unit,
    sign or orientation, or a log in motion whose moments hold an inertia that was not identified.
    """
    files = _check_files(given)
    file = read_sensor_file(_path(given.sensor, _SENSORS))
    readings = read_readings(given.log, given.gravity)
    found = compensation(readings, file.sensor, file.noise, given.false_alarms, file.uncertainty)
    blocks = list(compensation_view(found))
    show(*blocks)
    write_readings(readings, found.rest, given.csv)
    _draw(given, "compensate", readings, found, (found.hits, "contact"), blocks, files)
    return found.verdict.exit_code


# ── ``sensor identify``


@command(
    "identify",
    click.argument("log", metavar="LOG"),
    SIGN,
    GRAVITY_OPTION,
    option(
        "--with-inertia", "Estimate the six moments of inertia too; the log needs wx … vz and dwx … dvz.", "inertia"
    ),
    option(
        "--assume CAUSE",
        "Estimate this cause too; may be repeated. orientation: rotation of the sensor axes against the frame of the poses. "
        "drift: linear change of the bias. tilt: rotation of gravity; the log needs orientations. delay: delay of the "
        "readings; the log needs time and motion.",
        choices=CAUSES,
        multiple=True,
    ),
    option("--bias m,m,m,f,f,f", "Known bias [N m, N], which is then not estimated."),
    option("--noise M,F", "Standard deviation of moments [N m] and forces [N], or of all six. [default: estimated]"),
    option("--keep-outliers", "Use readings that contradict the others, too."),
    option("--save OUT.json", "Write the sensor file for `compensate`."),
    CSV,
    JSON,
    PLOT,
    REPORT,
    examples_=("sensor identify demo", "sensor identify demo --save hand.json"),
    short_help="Estimate mass, centre of mass and bias from a log.",
)
def identify_command(given: Given) -> ExitCode:
    """Estimate bias, mass and centre of mass of the load of a sensor, with intervals.

    Exit code: 1 for LOOK AGAIN, if readings contradict the others, if units, sign, mounting, gain or poses look wrong, or if
    the inertia found is impossible; 1 for UNSURE, if orientations are few, if residuals are not white, or if --assume with
    one of its causes would explain them.
    """
    files = _check_files(given)
    readings = read_readings(given.log, given.gravity)
    found = identify(
        readings,
        bias=None if given.bias is None else parse_count(given.bias, "--bias", 6),
        noise=None if given.noise is None else parse_count(given.noise, "--noise", 2, 6),
        outliers="keep" if given.keep_outliers else "trim",
        **given.pick("sign", "inertia", "assume"),
    )
    blocks = list(sensor_identification_view(found, readings))
    show(*blocks)
    if given.save is not None:
        write_sensor(found.sensor, given.save, found.noise, found.uncertainty)
    write_readings(readings, found.rest(readings), given.csv)
    show_written(given.save)
    _draw(given, "identify", readings, found, (~found.kept, "left out"), blocks, files)
    return found.verdict.exit_code


# ── ``sensor poses``


@command(
    "poses",
    click.argument("log", metavar="[LOG]", required=False),
    option("--count", "Number of orientations.", default=6),
    option("--within DEGREES", "Largest tilt.", default=180.0),
    option("--noise M,F", "Standard deviation of moments [N m] and forces [N].", default="0.01,0.3"),
    option("--mass", "Approximate mass of the load [kg].", default=1.0),
    GRAVITY_OPTION,
    csv_option("Write the poses as a table"),
    JSON,
    REPORT,
    examples_=("sensor poses", "sensor poses demo --count 3"),
    short_help="Propose the orientations to read next.",
)
def poses_command(given: Given) -> ExitCode:
    """Propose the most informative orientations to read next, given the readings of LOG, if any.

    Exit code: 1 for LOOK AGAIN, if they cannot determine the mass or the centre of mass.
    """
    files = _check_files(given)
    if not (given.mass > 0 and math.isfinite(given.mass)):
        raise ValueRangeError(f"--mass {given.mass!r} is not a valid mass. Give about how many kilograms the load has.")
    past = None if given.log is None else read_readings(given.log, given.gravity)
    moment, force = parse_count(given.noise, "--noise", 2)
    proposal = propose_poses(
        given.count, log=past, within=math.radians(given.within), noise=(moment, force), gravity=given.gravity
    )
    quat = quaternion.from_matrix(proposal.rotations)
    doubted = undetermined(proposal, given.mass, None if given.within >= 90 else given.within)
    unit = proposal.gravity / np.linalg.norm(proposal.gravity, axis=1, keepdims=True)
    poses = np.concatenate([quat, unit], axis=1)
    blocks = list(proposal_view(proposal, poses, given.mass, doubted))
    show(*blocks)
    write_csv(given.csv, dict(zip(_POSE, poses.T, strict=True)))
    show_written(given.csv)
    write_report(given, "sensor poses", given.log or "from nothing", blocks, files=files)
    return ExitCode.NO if doubted else ExitCode.FINE


# ── The group; heavy modules are imported inside the command that needs them


@click.group("sensor", cls=click.Group)
def sensor_command() -> None:
    """Calibrate a six-axis force-torque sensor: estimate the tool's mass, subtract its load, propose poses.

    LOG is a CSV file with mx,my,mz,fx,fy,fz and an orientation (qw,qx,qy,qz or r11…r33 or gx,gy,gz),
    or 'demo' or 'demo-motion', which are bundled.
    """


sensor_command.add_command(identify_command)
sensor_command.add_command(compensate_command)
sensor_command.add_command(poses_command)


# ── The report


_WIDE = 0.1  # m; a centre of mass with a larger uncertainty is not reported


def sensor_identification_view(found: Identification, log: ReadingLog) -> Iterator[Block]:
    """Identified parameters with their intervals, and the compensated readings."""
    reasons, others = _sentences(found, log.notes)
    place = ", ".join(number(1e3 * x, decimals=1) for x in found.sensor.load.com)
    where = f" at ({place}) mm." if found.mass_interval[0] > 0 else ", which may be nothing."
    yield Headline(found.verdict.word, f"{found.mass_text}{where}")
    yield from reasons
    yield ""
    yield _heading(log, found.sensor.sign)
    names, units, values, halves = zip(*_parameters(found, log), strict=True)
    yield Table(
        "Load and sensor",
        words("quantity", names, fold=False),
        words("unit", units, fold=False),
        numbers("value", values, unit=", ".join(dict.fromkeys(units)), headed=False),
        numbers(f"± ({percent(found.confidence, 3)})", halves, unit=", ".join(dict.fromkeys(units)), headed=False),
    )
    yield _before_and_after(log, found.rest(log), found.kept)
    yield f"Noise of a reading: {number(found.noise[0], 2)} N m, {number(found.noise[1], 2)} N (1 σ)."
    yield from others


def _parameters(found: Identification, log: ReadingLog) -> Iterator[tuple[Any, ...]]:
    """Name, unit, value and half-width of the interval of each parameter."""
    load, unknowns, state = found.sensor.load, found.fit.unknowns, found.fit.state

    def half(name: str) -> float:
        return float(np.ptp(found.interval(name))) / 2

    low, high = found.mass_interval
    yield "mass", "kg", *_estimate((high + low) / 2, (high - low) / 2)
    for axis, place, (low, high) in zip("xyz", load.com, found.com_intervals, strict=True):
        yield f"centre of mass {axis}", "mm", *_estimate(1e3 * place, 5e2 * (high - low))
    for name in [n for n in unknowns.names if unknowns.inertia and n.startswith("I")]:
        i, j = ("xyz".index(a) for a in name[1:])
        yield f"{name} about the origin", "kg m²", *_estimate(load.moment_about_origin[i, j], half(name))
    for axis, value in zip(WRENCH, np.asarray(found.sensor.bias), strict=True):
        name = f"bias {axis}"
        yield name, _unit(axis), *(_estimate(value, half(name)) if name in unknowns.names else (value, "given"))
    for k, axis in enumerate("xyz" if unknowns.turn else ""):
        turn = _estimate(math.degrees(found.turn[k]), math.degrees(half(f"turn {axis}")))
        yield f"mounting turned about {axis}", "°", *turn
    per = "s" if log.time is not None else "reading"
    for name in [n for n in unknowns.names if n.startswith("drift")]:
        low, high = found.interval(name)
        yield name, f"{_unit(name[6])}/{per}", *_estimate((low + high) / 2, (high - low) / 2)
    if unknowns.tilt:
        most = max(half(name) for name in unknowns.names if name.startswith("tilt"))
        tilt = math.degrees(np.linalg.norm(so3.log(state.tilt)))
        yield "base tilted by", "°", *_estimate(tilt, math.degrees(most))
    if unknowns.delay:
        yield "readings are late by", "ms", *_estimate(1e3 * state.delay, 1e3 * half("delay"))


def _estimate(value: float, sigma: float) -> Iterator[Line]:
    return (Line(text, value=x) for text, x in zip(estimate(value, sigma), (value, sigma), strict=True))


def _sentences(found: Identification | Compensation, notes: tuple[str, ...]) -> tuple[list[Remark], list[Remark]]:
    """Split doubts into reasons of the verdict and remarks at the end of the report, which include notes on the log."""
    reasons = [str(each) for each in found.doubts if str(each) in found.verdict.reasons]
    others = [*notes, *(str(each) for each in found.doubts if str(each) not in reasons)]
    return remarks(map(with_option_names, reasons)), remarks(map(with_option_names, others))


def compensation_view(found: Compensation) -> Iterator[Block]:
    """Readings before and after compensation, and contacts."""
    log = found.log
    reasons, others = _sentences(found, log.notes)
    yield Headline(found.verdict.word, _outcome(found))
    yield from reasons
    yield ""
    yield _heading(log, found.sensor.sign)
    yield _before_and_after(log, found.rest, np.ones(len(log), bool))
    if found.threshold is not None:
        moment, force = found.threshold.per_axis[:3], found.threshold.per_axis[3:]
        least = [quantity(x.min(), _unit(axis)) for axis, x in (("m", moment), ("f", force)) if np.isfinite(x).all()]
        yield (
            f"Contact is what noise alone reaches once in {number(1 / found.threshold.false_alarms)} readings: from "
            f"{' or '.join(least)} on{'; moments are not looked at' if found.inertia else ''}."
        )
    yield from others


def _outcome(found: Compensation) -> str:
    log, hits = found.log, found.hits
    if not found.explained:
        return "this sensor file does not explain this log."
    moment, force = left_over(found.rest[~found.off])
    noise = f"beside noise of {number(found.noise[1], 2)} N and {number(found.noise[0], 2)} N m"
    if hits.any():
        spans = [_span(log, a, b) for a, b in runs(hits)]
        peak = np.linalg.norm(found.rest[hits][:, 3:], axis=1).max()
        shown = "; ".join(spans[:5]) + ("; …" if len(spans) > 5 else "")
        return f"{hits.sum()} of {len(log)} readings, {shown}; up to {number(peak)} N."
    if found.threshold is not None:
        return "no contact force; moments were not looked at." if found.inertia else "no contact."
    if found.inertia and found.inertia.refuses:
        return f"the load's inertia is left in the moments, {number(moment, 2)} N m {noise}."
    good = int((~found.off).sum())
    rest = "" if good == len(log) else " In the others something else acts; --contacts 1e-6 lists when."
    left = f"{number(force, 2)} N and {number(moment, 2)} N m left {noise}"
    return f"{good} of {len(log)} readings are explained, with {left}.{rest}"


_POSE = ("qw", "qx", "qy", "qz", "gx", "gy", "gz")
"""Columns of a pose: orientation and direction of gravity."""


def proposal_view(proposal: PoseProposal, poses: Array, mass: float, doubted: Doubt | None) -> Iterator[Block]:
    """Proposed orientations (n, 7) in measuring order; only the verdict if they do not determine the load."""
    known = _known(proposal, mass)
    if doubted:
        yield Headline(Word.LOOK_AGAIN, str(doubted))
        if not known[-1, 0] < mass:
            return
    else:
        sure = f"mass ± {number(known[-1, 0], 2)} kg, centre of mass ± {number(1e3 * known[-1, 1], 2)} mm (95 %)"
        yield Headline(Word.OK, f"{len(poses)} orientations determine a load of {number(mass)} kg: {sure}.")
    yield ""
    yield Table(
        "Next poses",
        words("no.", range(1, len(poses) + 1), fold=False),
        *(numbers(head, x, lambda value: number(value, decimals=3)) for head, x in zip(_POSE, poses.T, strict=True)),
        numbers("mass ±", known[:, 0], lambda value: number(value, 2), "kg"),
        numbers("centre ±", 1e3 * known[:, 1], lambda value: number(value, 2), "mm"),
    )
    yield (
        "Orientations R_wf of the sensor's frame and gravity's direction in it; turns about the vertical are free.\n"
        f"± is what will be known (95 %) with all poses up to there, for a load of {number(mass)} kg; that of the centre\n"
        "is across the line to the sensor, along it add the share of the mass."
    )


def undetermined(proposal: PoseProposal, mass: float, within: float | None) -> Doubt | None:
    """Reason why the poses do not determine a load of this mass [kg]; None if they do. ``within`` [°] is a tilt limit."""
    heavy, out = _known(proposal, mass)[-1]
    if heavy < mass and out < _WIDE:
        return None
    what = "the centre of mass" + (f" (± {number(1e3 * out, 2)} mm)" if math.isfinite(out) else "")
    if not heavy < mass:  # centre of mass: first moment over mass
        what = "the mass" + (f" (± {number(heavy, 2)} kg)" if math.isfinite(heavy) else "") + " or the centre of mass"
    count = len(proposal.gravity)
    those = f"{count} pose{'s' * (count > 1)}" + ("" if within is None else f" tilted by up to {number(within)}°")
    way = "Ask for more of them" if within is None else "Allow larger tilts, such as --within 60"
    return doubt("sensor-few-poses", those=those, what=what, mass=number(mass), way=way)


def _known(proposal: PoseProposal, mass: float) -> Array:
    """Half-widths (count, 2) of the 95 % intervals of mass [kg] and centre of mass [m]."""
    return 1.96 * np.stack([proposal.mass_deviation, proposal.first_moment_deviation / mass], axis=1)


def _span(log: ReadingLog, first: int, last: int) -> str:
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"reading {first}" if first == last else f"readings {first} to {last}"


def _heading(log: ReadingLog, sign: str) -> Line:
    motion = "at rest" if log.V is None else "in motion"
    lasting = "" if log.time is None or len(log) < 2 else f" over {number(np.ptp(log.time))} s"
    return Line((Path(log.name).name, Style.STRONG), f"  {len(log)} readings{lasting}, {motion}, sign {sign}")


def _before_and_after(log: ReadingLog, compensated: Array, kept: Array) -> Table:
    rms = [np.sqrt(np.mean(values**2, axis=0)) for values in (log.readings[kept], compensated[kept])]
    return Table(
        f"Readings, root mean square [{heading_unit('tau', (True, False))}]",
        words("", ["before", "after"], fold=False),
        *(
            numbers(axis, x, lambda value: number(value, decimals=4), _unit(axis), headed=False)
            for axis, x in zip(WRENCH, np.transpose(rms), strict=True)
        ),
    )


def _unit(axis: str) -> str:
    """Unit of a moment or a force."""
    return unit_of("tau", axis.startswith("m"))
