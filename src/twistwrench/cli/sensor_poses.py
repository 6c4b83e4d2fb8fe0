"""The command ``twistwrench sensor poses``."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

import click

from ..errors import ValueRangeError
from ..verdict import ExitCode
from .command_texts import about
from .sensor_options import GRAVITY_OPTION, noise_of, read_readings, sensor_command, tell

if TYPE_CHECKING:
    from rich.console import Console


@click.command("poses", **about("sensor poses"))
@click.argument("log", metavar="[LOG]", required=False)
@click.option("--count", type=int, default=6, show_default=True, help="How many.")
@click.option("--within", type=float, default=180.0, show_default=True, metavar="DEGREES", help="The largest tilt.")
@click.option("--noise", metavar="M,F", default="0.01,0.3", show_default=True, help="Of moments [N m] and forces [N].")
@click.option("--mass", type=float, default=1.0, show_default=True, help="About how heavy the load is [kg].")
@GRAVITY_OPTION
@click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the poses.")
@sensor_command
def poses_command(
    *,
    console: Console,
    log: str | None,
    count: int,
    within: float,
    noise: str,
    mass: float,
    gravity: float,
    csv_path: str | None,
) -> None:
    """The next orientations to read: those that tell most, after the readings of LOG or from nothing.

    Exit code 1, LOOK AGAIN, if these cannot tell the mass or the centre of mass.
    """
    import numpy as np

    from ..lie import quaternion
    from ..motion.table_file import TableFile
    from ..sensing.poses import propose_poses
    from .tables.sensor import cannot_tell, proposal_view

    if not (mass > 0 and math.isfinite(mass)):
        raise ValueRangeError(f"--mass {mass!r} is no mass. Give about how many kilograms the load has.")
    past = None if log is None else read_readings(log, gravity)
    proposal = propose_poses(count, log=past, within=math.radians(within), noise=noise_of(noise), gravity=gravity)
    quat = quaternion.from_matrix(proposal.rotations)
    untold = cannot_tell(proposal, mass, None if within >= 90 else within)
    console.print(proposal_view(proposal, quat, mass, untold))
    unit = proposal.gravity / np.linalg.norm(proposal.gravity, axis=1, keepdims=True)
    with TableFile.writing(csv_path, ["qw", "qx", "qy", "qz", "gx", "gy", "gz"]) as file:
        if file is not None:
            file.write(np.concatenate([quat, unit], axis=1))
    tell(csv_path)
    if untold:
        sys.exit(ExitCode.NO)
