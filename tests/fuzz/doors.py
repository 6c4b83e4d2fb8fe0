"""Entry points by which users read files: what a child process does with a path."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import twistwrench as tw

Door = Callable[[Path], Any]


class Fault(Exception):
    """A promise that was not kept, other than by an exception."""


@cache
def robot(name: str) -> tw.Robot:
    return getattr(tw.robots, name)()


def doctor(path: Path) -> None:
    """The report as JSON, and the file as it would be repaired."""

    def no_number(name: str) -> None:
        raise Fault(f"the report has {name}, which is not JSON")

    report = tw.doctor(path)
    json.loads(report.to_json(), parse_constant=no_number)
    report.repaired_text()


def drawn(path: Path) -> None:
    from twistwrench.shapes.visuals import read_visuals

    model = tw.load(path).model
    for tag in ("visual", "collision"):
        read_visuals(model, tag)


def motion(path: Path) -> None:
    found = tw.Motion.from_file(path, robot("planar_2r"))
    repr(found)


def episode(path: Path) -> None:
    tw.Motion.from_file(path, robot("planar_2r"), episode=0)


def quality(path: Path) -> None:
    from twistwrench.reports.log_quality import LogQuality

    repr(LogQuality.from_file(path))


def limits(path: Path) -> None:
    from twistwrench.motion.limits_file import read_limits

    read_limits(path, robot("planar_2r").model)


def factory_calibration(path: Path) -> None:
    tw.calibration.factory(robot("ur5"), path)


def measurements(path: Path) -> None:
    repr(tw.calibration.Measurements.from_file(path, robot("planar_2r")))


def calibrated(path: Path) -> None:
    json.dumps(tw.calibration.calibrate(robot("planar_2r"), path).to_dict())


def catalogue(path: Path) -> None:
    from twistwrench.sizing.catalog import read_catalog

    read_catalog(path)


def log_side(path: Path) -> None:
    from twistwrench.formats.actuators import read_log_side

    read_log_side(robot("ur5").model, path)


def srdf(path: Path) -> None:
    from twistwrench.statics.link_pairs import disabled_pairs

    disabled_pairs(robot("ur5"), path)


def shown_mesh(path: Path) -> None:
    from twistwrench.shapes.surface import read_mesh

    read_mesh(path)


def simulation(path: Path) -> None:
    from twistwrench.simulation import SimulationResult

    found = SimulationResult.load(path)
    repr(found)


def readings(path: Path) -> None:
    from twistwrench.sensing.files import read_log

    read_log(path)


def sensor(path: Path) -> None:
    from twistwrench.sensing.files import read_sensor_file

    read_sensor_file(path)


def code_cache(path: Path) -> None:
    """Entries of the cache of compiled code, damaged, then a call of the kernel that they belong to."""
    before = os.environ["TWISTWRENCH_CACHE_DIR"]
    os.environ["TWISTWRENCH_CACHE_DIR"] = str(path.parent)
    try:
        found = tw.load(tw.robots.path_of("pendulum")).mass_matrix([0.3])
    finally:
        os.environ["TWISTWRENCH_CACHE_DIR"] = before
    if not found.shape == (1, 1) or not 0 < found[0, 0] < 1e3:
        raise Fault(f"the mass matrix is {found}")


def command(*words: str) -> Door:
    """The command line, run in this process; FILE in the words is the path."""

    def run(path: Path) -> None:
        from twistwrench.cli.main import main

        out, err = io.StringIO(), io.StringIO()
        arguments = [word.replace("FILE", str(path)).replace("FOLDER", str(path.parent)) for word in words]
        code: Any = 0
        with redirect_stdout(out), redirect_stderr(err):
            try:
                main(arguments, prog_name="twistwrench")
            except SystemExit as end:
                code = end.code
        said = out.getvalue() + err.getvalue()
        if code not in (0, 1, 2, None) or "Traceback (most recent" in said:
            raise Fault(f"twistwrench {' '.join(words)} exits with {code}: {said[-600:]}")
        controls = sorted({c for c in out.getvalue() + err.getvalue() if c < " " and c not in "\n\r\t\x1b"})
        if controls:
            raise Fault(f"twistwrench {' '.join(words)} prints the control characters {controls}")
        lines = [line for line in err.getvalue().splitlines() if line.startswith("error:")]
        if any(len(line) > LONGEST + len("error: ") + 200 for line in lines):  # escaped again, and in terms of options
            raise Fault(f"an error of {max(map(len, lines))} characters: {lines[0][:300]}")
        if code == 2 and lines:
            raise tw.TwistWrenchError(lines[0])

    return run


LONGEST = 1001
"""Longest message of an error [characters]: a thousand, and the sign that more was left out."""

DOORS: dict[str, Door] = {
    "load": tw.load,
    "load as xacro": lambda path: tw.load(path, xacro=True),
    "doctor": doctor,
    "drawn": drawn,
    "actuators": lambda path: robot("ur5").with_actuators(path),
    "log side": log_side,
    "catalogue": catalogue,
    "limits": limits,
    "factory calibration": factory_calibration,
    "measurements": measurements,
    "calibrated": calibrated,
    "srdf": srdf,
    "mesh": lambda path: tw.SpatialInertia.mesh(path, density=1000.0),
    "shown mesh": shown_mesh,
    "sensor": sensor,
    "readings": readings,
    "motion": motion,
    "episode": episode,
    "quality": quality,
    "simulation": simulation,
    "code cache": code_cache,
    "info": command("info", "FILE"),
    "info of actuators": command("info", "ur5", "--actuators", "FILE"),
    "doctor command": command("doctor", "FILE"),
    "convert": command("convert", "FILE", "-", "--json", "-"),
    "log": command("log", "FILE"),
    "view": command("view", "FILE", "--html", "FOLDER/out.html"),
    "torques": command("torques", "planar_2r", "--trajectory", "FILE"),
    "torques with limits": command("torques", "planar_2r", "--trajectory", "demo", "--limits", "FILE"),
    "torques with map": command("torques", "planar_2r", "--trajectory", "FOLDER/log.csv", "--columns", "@FILE"),
    "identify": command("identify", "planar_2r", "FILE", "--cutoff", "10", "--shift", "0"),
    "size": command("size", "ur5", "demo", "--catalog", "FILE"),
    "waypoints": command("move", "planar_2r", "--to", "1,1", "--duration", "2", "--waypoints", "FILE"),
    "calibrate": command("calibrate", "planar_2r", "FILE"),
    "payload": command("payload", "ur5", "--limits", "FILE"),
    "sensor command": command("sensor", "compensate", "demo", "--sensor", "FILE"),
    "sensor poses": command("sensor", "poses", "FILE"),
    "sensor identify": command("sensor", "identify", "FILE"),
    "clearance": command("torques", "ur5", "--trajectory", "demo", "--clearance", "--srdf", "FILE"),
}

if sys.flags.optimize:
    raise SystemExit("run without -O")
