"""The commands ``twistwrench sensor identify``, ``compensate`` and ``poses``: options, files and reports."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Group, RenderableType
from rich.text import Text

from ..core.files import check_outputs
from ..core.gravity import STRENGTH
from ..core.numbers import estimate, number, percent, quantity, seconds
from ..core.tables import csv_table
from ..core.verdict import ExitCode
from ..errors import ModelWarning, ValueRangeError
from ..joints.units import heading_unit, unit_of
from ..lie import quaternion, so3
from ..lie.labelled import WRENCH
from ..sensing.contact_detection import Compensation, compensation, left_over
from ..sensing.files import read_log, read_sensor_file, write_sensor
from ..sensing.log import ReadingLog
from ..sensing.outliers import runs
from ..sensing.poses import PoseProposal, propose_poses
from ..sensing.result import Identification
from .console import picture, show, show_written
from .plain_table import PlainTable, remarks, verdict_word
from .usage import Given, command, with_option_names

_DEMOS = {"demo": "demo_poses.csv", "demo-motion": "demo_motion.csv"}

_HERE = Path(__file__).parents[1] / "sensing"

SIGN = click.option(
    "--sign",
    type=click.Choice(["on_sensor", "by_sensor"]),
    default="on_sensor",
    show_default=True,
    help="Readings are what the load does to the sensor (at rest its weight), or what the sensor does to it.",
)

GRAVITY_OPTION = click.option(
    "--gravity", type=float, default=STRENGTH, show_default=True, help="Its size [m/s²]; -z of the world."
)

CSV = click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the readings without bias and load.")

PLOT = click.option("--plot", "plot_path", metavar="OUT.png", help="Draw the readings before and after.")


def log_path(name: str) -> Path:
    """The file of a log; demos are bundled."""
    return _HERE / _DEMOS[name] if name in _DEMOS and not Path(name).is_file() else Path(name)


def sensor_file(name: str) -> Path:
    """The file of a sensor; ``demo`` is bundled."""
    return _HERE / "demo_sensor.json" if name == "demo" and not Path(name).is_file() else Path(name)


def read_readings(name: str, gravity: float) -> ReadingLog:
    """The readings of a log, under gravity of that size [m/s²]. Raises ValueRangeError."""
    if not (gravity > 0 and math.isfinite(gravity)):
        raise ValueRangeError(f"--gravity {gravity!r} is no size of gravity. Give it in m/s², such as {STRENGTH}.")
    with warnings.catch_warnings():  # the report says what is doubtful, in its place
        warnings.simplefilter("ignore", ModelWarning)
        return read_log(log_path(name), gravity=(0.0, 0.0, -gravity))


def write_readings(log: ReadingLog, compensated: Any, path: str) -> None:
    """Write readings without bias and load (n, 6), with the times where the log has them."""
    import numpy as np

    head = [] if log.time is None else ["time"]
    rows = compensated if log.time is None else np.column_stack([log.time, compensated])
    with csv_table(path, [*head, *WRENCH]) as table:
        table.numbers(rows)


def parse_noise(text: str) -> tuple[float, float]:
    """Two numbers: noise of moments [N m] and of forces [N]."""
    moment, force = parse_count(text, "--noise", 2)
    return moment, force


def parse_count(text: str, option: str, count: int) -> list[float]:
    """Numbers between commas. Raises ValueRangeError, which names the option."""
    try:
        numbers = [float(x) for x in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueRangeError(f"{option} {text!r} is not {count} numbers separated by commas.")
    return numbers


def _check_files(given: Given) -> None:
    """Raise unless each output has a place of its own; a picture gets its suffix."""
    if hasattr(given, "plot_path"):
        given.plot_path = picture(given.plot_path)
    log, sensor = given.log, getattr(given, "sensor_path", None)
    outputs = {f"--{name}": getattr(given, f"{name}_path", None) for name in ("save", "csv", "plot")}
    check_outputs(
        outputs,
        {"LOG": None if log is None else log_path(log), "--sensor": None if sensor is None else sensor_file(sensor)},
    )


# ── ``sensor compensate``


@command(
    "compensate",
    PLOT,
    CSV,
    click.option(
        "--contacts",
        "false_alarms",
        metavar="RATE",
        type=float,
        help="Look for contacts, with at most this share of readings called one by noise (1e-6).",
    ),
    GRAVITY_OPTION,
    click.option(
        "--sensor", "sensor_path", metavar="SENSOR.json", required=True, help="From `identify --save`; or 'demo'."
    ),
    click.argument("log", metavar="LOG"),
    examples_=("sensor compensate demo --sensor demo",),
    short_help="Take weight, inertia and bias off a log; find contacts.",
)
def compensate_command(given: Given) -> ExitCode:
    """Readings without bias, weight and inertial load of what the sensor carries.

    Exit code 1 if --contacts finds one, or, LOOK AGAIN, if the sensor file does not explain the log: another tool, unit,
    sign or orientation, or a log in motion whose moments hold an inertia that was not identified.
    """
    _check_files(given)
    file = read_sensor_file(sensor_file(given.sensor_path))
    readings = read_readings(given.log, given.gravity)
    found = compensation(readings, file.sensor, file.noise, given.false_alarms, file.uncertainty)
    show(compensation_view(found))
    if given.csv_path is not None:
        write_readings(readings, found.rest, given.csv_path)
    if given.plot_path is not None:
        from ..plotting.explanation import plot_compensation

        plot_compensation(readings, file.sensor, file.noise, given.plot_path, marked=found.hits, mark="contact")
    show_written(given.csv_path, given.plot_path)
    return found.verdict.exit_code


# ── ``sensor identify``


@command(
    "identify",
    PLOT,
    CSV,
    click.option("--save", "save_path", metavar="SENSOR.json", help="Write the sensor for `compensate`."),
    click.option("--keep-outliers", is_flag=True, help="Use readings that the others contradict, too."),
    click.option(
        "--noise",
        metavar="M,F",
        help="Known noise of moments [N m] and forces [N], or of all six; estimated if not given.",
    ),
    click.option("--bias", metavar="m,m,m,f,f,f", help="A known bias, which is then not looked for."),
    click.option(
        "--tilt", is_flag=True, help="Also a tilt of the base, which turns gravity; the log needs orientations."
    ),
    click.option(
        "--delay", is_flag=True, help="Also the time by which readings are late; the log needs time and motion."
    ),
    click.option("--drift", is_flag=True, help="Also a bias that changes linearly with time."),
    click.option(
        "--orientation", is_flag=True, help="Also how the sensor's axes are turned against the frame of the poses."
    ),
    click.option("--inertia", is_flag=True, help="Also the six inertia numbers; the log needs wx … vz and dwx … dvz."),
    GRAVITY_OPTION,
    SIGN,
    click.argument("log", metavar="LOG"),
    examples_=(
        "sensor identify demo",
        "sensor identify demo --save hand.json",
    ),
    short_help="Find mass, centre of mass and bias from a log.",
)
def identify_command(given: Given) -> ExitCode:
    """Bias, mass and centre of mass of what the sensor carries, and how well they are known.

    Exit code 1, LOOK AGAIN, if readings contradict the others, if units, sign, mounting, gain or poses look wrong, or if
    no body has the inertia found; UNSURE if what is left is not white, or --drift, --delay, --tilt or --orientation would
    explain it.
    """
    _check_files(given)
    from ..sensing.identification import identify

    readings = read_readings(given.log, given.gravity)
    found = identify(
        readings,
        sign=given.sign,
        inertia=given.inertia,
        orientation=given.orientation,
        drift=given.drift,
        delay=given.delay,
        tilt=given.tilt,
        bias=None if given.bias is None else parse_count(given.bias, "--bias", 6),
        noise=None
        if given.noise is None
        else parse_count(given.noise, "--noise", 6 if given.noise.count(",") > 1 else 2),
        outliers="keep" if given.keep_outliers else "trim",
    )
    show(sensor_identification_view(found, readings))
    if given.save_path is not None:
        write_sensor(found.sensor, given.save_path, found.noise, found.uncertainty)
    if given.csv_path is not None:
        write_readings(readings, found.rest(readings), given.csv_path)
    if given.plot_path is not None:
        from ..plotting.explanation import plot_compensation

        plot_compensation(readings, found.sensor, found.noise, given.plot_path, marked=~found.kept, mark="left out")
    show_written(given.save_path, given.csv_path, given.plot_path)
    return found.verdict.exit_code


# ── ``sensor poses``


@command(
    "poses",
    click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the poses."),
    GRAVITY_OPTION,
    click.option("--mass", type=float, default=1.0, show_default=True, help="About how heavy the load is [kg]."),
    click.option(
        "--noise", metavar="M,F", default="0.01,0.3", show_default=True, help="Of moments [N m] and forces [N]."
    ),
    click.option("--within", type=float, default=180.0, show_default=True, metavar="DEGREES", help="The largest tilt."),
    click.option("--count", type=int, default=6, show_default=True, help="How many."),
    click.argument("log", metavar="[LOG]", required=False),
    examples_=(
        "sensor poses",
        "sensor poses demo --count 3",
    ),
    short_help="Propose the orientations to read next.",
)
def poses_command(given: Given) -> ExitCode:
    """The next orientations to read: those that tell most, after the readings of LOG or from nothing.

    Exit code 1, LOOK AGAIN, if these cannot tell the mass or the centre of mass.
    """
    _check_files(given)
    import numpy as np

    if not (given.mass > 0 and math.isfinite(given.mass)):
        raise ValueRangeError(f"--mass {given.mass!r} is no mass. Give about how many kilograms the load has.")
    past = None if given.log is None else read_readings(given.log, given.gravity)
    proposal = propose_poses(
        given.count, log=past, within=math.radians(given.within), noise=parse_noise(given.noise), gravity=given.gravity
    )
    quat = quaternion.from_matrix(proposal.rotations)
    untold = cannot_show_written(proposal, given.mass, None if given.within >= 90 else given.within)
    show(proposal_view(proposal, quat, given.mass, untold))
    unit = proposal.gravity / np.linalg.norm(proposal.gravity, axis=1, keepdims=True)
    if given.csv_path is not None:
        with csv_table(given.csv_path, ["qw", "qx", "qy", "qz", "gx", "gy", "gz"]) as table:
            table.numbers(np.concatenate([quat, unit], axis=1))
    show_written(given.csv_path)
    return ExitCode.NO if untold else ExitCode.FINE


# ── The group; heavy modules are imported inside the command that needs them


@click.group("sensor", cls=click.Group)
def sensor_command() -> None:
    """Six-axis force-torque sensors: find the tool's mass, remove its weight, propose poses.

    LOG is a CSV file with mx,my,mz,fx,fy,fz and an orientation (qw,qx,qy,qz or r11…r33 or gx,gy,gz),
    or 'demo' or 'demo-motion', which are bundled.
    """


sensor_command.add_command(identify_command)
sensor_command.add_command(compensate_command)
sensor_command.add_command(poses_command)


# ── The report


_WIDE = 0.1  # m; a centre of mass known no better is not told


def sensor_identification_view(found: Identification, log: ReadingLog) -> RenderableType:
    """Identified parameters with their intervals, and the compensated readings."""
    load = found.sensor.load
    table = PlainTable("Load and sensor")
    table.words("quantity", "unit", fold=False)
    table.numbers("value", f"± ({percent(found.confidence, 3)})")
    low, high = found.mass_interval
    table.row("mass", "kg", *estimate((high + low) / 2, (high - low) / 2))
    for axis, place, (low, high) in zip("xyz", load.com, found.com_intervals, strict=True):
        table.row(f"centre of mass {axis}", "mm", *estimate(1e3 * place, 5e2 * (high - low)))
    names = found.fit.unknowns.names
    if found.fit.unknowns.inertia:
        about = load.moment_about_origin
        for name in [n for n in names if n.startswith("I")]:
            i, j = ("xyz".index(a) for a in name[1:])
            low, high = found.interval(name)
            table.row(f"{name} about the origin", "kg m²", *estimate(about[i, j], (high - low) / 2))
    for axis, value in zip(WRENCH, np.asarray(found.sensor.bias), strict=True):
        name = f"bias {axis}"
        cells = estimate(value, np.ptp(found.interval(name)) / 2) if name in names else (value, "given")
        table.row(name, _unit(axis), *cells)
    if found.fit.unknowns.turn:
        for k, axis in enumerate("xyz"):
            half = math.degrees(np.ptp(found.interval(f"turn {axis}")) / 2)
            table.row(f"mounting turned about {axis}", "°", *estimate(math.degrees(found.turn[k]), half))
    per, state = "s" if log.time is not None else "reading", found.fit.state
    for name in [n for n in names if n.startswith("drift")]:
        low, high = found.interval(name)
        table.row(name, f"{_unit(name[6])}/{per}", *estimate((low + high) / 2, (high - low) / 2))
    if found.fit.unknowns.tilt:
        half = max(np.ptp(found.interval(name)) / 2 for name in names if name.startswith("tilt"))
        tilt = math.degrees(np.linalg.norm(so3.log(state.tilt)))
        table.row("base tilted by", "°", *estimate(tilt, math.degrees(half)))
    if found.fit.unknowns.delay:
        half = np.ptp(found.interval("delay")) / 2
        table.row("readings are late by", "ms", *estimate(1e3 * state.delay, 1e3 * half))
    reasons, others = _told(found, log.notes, found.remarks, found.doubts)
    parts: list[RenderableType] = [_verdict_of_sensor(found), *reasons, Text()]
    parts += [_heading(log, found.sensor.sign), table, _before_and_after(log, found.rest(log), found.kept)]
    parts.append(Text(f"Noise of a reading: {number(found.noise[0], 2)} N m, {number(found.noise[1], 2)} N (1 σ)."))
    return Group(*parts, *others)


def _told(found: Identification | Compensation, *sentences: tuple[str, ...]) -> tuple[list[Text], list[Text]]:
    """Split sentences into reasons of the verdict and remarks at the end of the report."""
    said = [sentence for group in sentences for sentence in group]
    reasons = [sentence for sentence in said if sentence in found.verdict.reasons]
    others = [sentence for sentence in said if sentence not in reasons]
    return remarks(map(with_option_names, reasons)), remarks(map(with_option_names, others))


def _verdict_of_sensor(found: Identification) -> Text:
    place = ", ".join(number(1e3 * x, decimals=1) for x in found.sensor.load.com)
    mass = found.mass_text
    text = f": {mass} at ({place}) mm." if found.mass_interval[0] > 0 else f": {mass}, which may be nothing."
    return Text.assemble(verdict_word(found.verdict.word), text)


def compensation_view(found: Compensation) -> RenderableType:
    """Readings before and after compensation, and contacts."""
    log = found.log
    missing = (found.missing_signals,) if found.missing_signals else ()
    reasons, others = _told(found, log.notes, missing, found.remarks, found.doubts)
    parts: list[RenderableType] = [_outcome(found), *reasons, Text()]
    parts += [_heading(log, found.sensor.sign), _before_and_after(log, found.rest, np.ones(len(log), bool))]
    if found.threshold is not None:
        floor = found.threshold.per_axis
        least = [
            quantity(x.min(), unit)
            for x, unit in ((floor[:3], _unit("m")), (floor[3:], _unit("f")))
            if np.isfinite(x).all()
        ]
        parts.append(
            Text(
                f"Contact is what noise alone reaches once in {number(1 / found.threshold.false_alarms)} readings: from "
                f"{' or '.join(least)} on{'; moments are not looked at' if found.missing_signals else ''}."
            )
        )
    return Group(*parts, *others)


def _outcome(found: Compensation) -> Text:
    log, hits = found.log, found.hits
    word = verdict_word(found.verdict.word)
    if found.doubts:
        return Text.assemble(word, ": this sensor file does not explain this log.")
    moment, force = left_over(found.rest[~found.off])
    noise = f"beside noise of {number(found.noise[1], 2)} N and {number(found.noise[0], 2)} N m"
    if hits.any():
        spans = [_span(log, a, b) for a, b in runs(hits)]
        peak = np.linalg.norm(found.rest[hits][:, 3:], axis=1).max()
        shown = "; ".join(spans[:5]) + ("; …" if len(spans) > 5 else "")
        return Text.assemble(word, f": {hits.sum()} of {len(log)} readings, {shown}; up to {number(peak)} N.")
    if found.threshold is not None:
        what = "no contact force; moments were not looked at" if found.missing_signals else "no contact"
        return Text.assemble(word, f": {what}.")
    if found.missing_signals_show:
        return Text.assemble(word, f": the load's inertia is left in the moments, {number(moment, 2)} N m {noise}.")
    good = int((~found.off).sum())
    said = f": {good} of {len(log)} readings are explained, with {number(force, 2)} N and {number(moment, 2)} N m left {noise}."
    rest = "" if good == len(log) else " In the others something else acts; --contacts 1e-6 says when."
    return Text.assemble(word, said + rest)


def proposal_view(
    proposal: PoseProposal, quaternions: NDArray[np.float64], mass: float, untold: str | None
) -> RenderableType:
    """Proposed orientations in measuring order; the verdict alone if they do not determine the load."""
    verdict = Text.assemble(("LOOK AGAIN", "bold red"), f": {untold}") if untold else None
    table = PlainTable("Next poses")
    table.words("no.", fold=False)
    table.numbers("qw", "qx", "qy", "qz", "gx", "gy", "gz", "mass ± [kg]", "centre ± [mm]")
    unit = proposal.gravity / np.linalg.norm(proposal.gravity, axis=1, keepdims=True)
    known = _known(proposal, mass)
    for k in range(len(unit)):
        cells = [number(x, decimals=3) for x in (*quaternions[k], *unit[k])]
        table.row(k + 1, *cells, number(known[k, 0], 2), number(1e3 * known[k, 1], 2))
    if verdict is not None and not known[-1, 0] < mass:
        return verdict
    return Group(
        *([verdict, Text()] if verdict else []),
        table,
        Text(
            "Orientations R_wf of the sensor's frame and gravity's direction in it; turns about the vertical are free.\n"
            f"± is what will be known (95 %) with all poses up to there, for a load of {number(mass)} kg; that of the centre\n"
            "is across the line to the sensor, along it add the share of the mass."
        ),
    )


def cannot_show_written(proposal: PoseProposal, mass: float, within: float | None) -> str | None:
    """Reason why the poses do not determine a load of about that mass [kg]; None if they do. ``within`` [°] is a tilt limit."""
    heavy, out = _known(proposal, mass)[-1]
    if heavy < mass and out < _WIDE:
        return None
    what = "the centre of mass" + (f" (± {number(1e3 * out, 2)} mm)" if math.isfinite(out) else "")
    if not heavy < mass:  # a place is a first moment over the mass
        what = "the mass" + (f" (± {number(heavy, 2)} kg)" if math.isfinite(heavy) else "") + " or the centre of mass"
    count = len(proposal.gravity)
    those = f"{count} pose{'s' * (count > 1)}" + ("" if within is None else f" tilted by up to {number(within)}°")
    way = "Ask for more of them" if within is None else "Allow larger tilts, such as --within 60"
    return f"{those} cannot tell {what} of a load of {number(mass)} kg. {way}."


def _known(proposal: PoseProposal, mass: float) -> NDArray[np.float64]:
    """Half of the 95 % intervals (count, 2) of mass [kg] and centre of mass [m]."""
    return 1.96 * np.stack([proposal.mass_deviation, proposal.first_moment_deviation / mass], axis=1)


def _span(log: ReadingLog, first: int, last: int) -> str:
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"reading {first}" if first == last else f"readings {first} to {last}"


def _heading(log: ReadingLog, sign: str) -> Text:
    motion = "at rest" if log.V is None else "in motion"
    lasting = "" if log.time is None or len(log) < 2 else f" over {number(np.ptp(log.time))} s"
    return Text.assemble((Path(log.name).name, "bold"), f"  {len(log)} readings{lasting}, {motion}, sign {sign}")


def _before_and_after(log: ReadingLog, compensated: NDArray[np.float64], kept: NDArray[np.bool_]) -> PlainTable:
    table = PlainTable(f"Readings, root mean square [{heading_unit('tau', (True, False))}]")
    table.words("", fold=False)
    table.numbers(*WRENCH)
    for name, values in (("before", log.readings[kept]), ("after", compensated[kept])):
        table.row(name, *(number(x, decimals=4) for x in np.sqrt(np.mean(values**2, axis=0))))
    return table


def _unit(axis: str) -> str:
    """Unit of a moment or a force."""
    return unit_of("tau", axis.startswith("m"))
