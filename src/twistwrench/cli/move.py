"""The command ``twistwrench move``: a motion between two configurations, as text, table and picture."""

from __future__ import annotations

from ..trajectories.move_report import MoveReport, move
from .skin import command_of, of_robot, picture_file, table_file


def _is_planned(report: MoveReport) -> bool:
    return report.trajectory is not None


move_command = command_of(
    "move",
    move,
    files=(
        table_file(MoveReport.to_csv, "Write the motion, which torques and view read", exists=_is_planned),
        picture_file("Draw the motion; with --fastest also the phase plane.", exists=_is_planned),
    ),
    report=True,
    description="""Plan a motion between two configurations and write it: in joint space, at the tip, through waypoints.

    Exit code: 1 if the robot cannot follow the path, a limit is exceeded, links come too near (--clearance), or the verdict
    is not OK for another reason.
    """,
    examples=(
        "move ur5 --to 0.9,-0.9,1.0,-0.4,1.2,1.0 --fastest",
        "move ur5 --from=-0.5,-1.9,1.9,-0.3,1.5,0 --by 0.1,0,-0.1 --csv move.csv",
    ),
)(of_robot(move))
