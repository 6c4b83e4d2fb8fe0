"""The commands ``twistwrench payload`` and ``move``: the largest payload at a pose, and a motion between two poses."""

from __future__ import annotations

from ..statics.payload_report import PayloadReport, payload
from ..trajectories.move_report import MoveReport, move
from .skin import command_of, of_robot, picture_file, table_file


def _is_planned(report: MoveReport) -> bool:
    return report.trajectory is not None


payload_command = command_of(
    "payload",
    payload,
    files=(
        table_file(PayloadReport.to_csv, "Write the table, one row per joint"),
        picture_file(
            "Draw force polytope, ellipsoid, shares and map.",
            exists=lambda report: report.judged,
            missing="The picture needs a torque limit of every joint that is loaded; none is written.",
        ),
    ),
    report=True,
    description="""Find the largest payload held at rest at a pose, the joint that limits it, and the forces at the tip.

    Exit code: 1 if the pose is outside the position limits, or the robot cannot hold itself there.
    """,
    examples=("payload ur5", "payload ur5 --at shoulder_lift_joint=-0.6 --at elbow_joint=0.9 --com 0,0,0.1"),
)(of_robot(payload))

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
