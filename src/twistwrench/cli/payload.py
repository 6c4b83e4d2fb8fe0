"""The command ``twistwrench payload``: the largest payload at a pose, as text and as a file."""

from __future__ import annotations

from ..statics.payload_report import PayloadReport, payload
from .skin import command_of, of_robot, picture_file, table_file

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
