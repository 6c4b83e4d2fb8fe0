"""Causes of measured torques, which are identified above this package."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.doubts import Doubt
from ..motion.log_table import excerpts
from ..motion.motion_log import MotionLog

if TYPE_CHECKING:
    from .torque_report import TorqueReport

_IN_ROWS = ("repeated", "buffered")
"""Doubts about rows that could be mistaken for causes."""
_RUNS, _ROWS = 4, 8192
"""Number of blocks of a long log searched for causes, and rows of each block."""


def measured_causes(report: TorqueReport, log: MotionLog) -> tuple[Doubt, ...]:
    """Causes of measured torques that the robot's equations do not explain; empty with wrenches or defective rows."""
    wrong = any(m.cut and m.matters for m in report.measured) or any(d.kind in _IN_ROWS for d in report.doubts)
    if not report.measured or report.load.wrenches or wrong:
        return ()
    from .. import identification
    from ..motion.motion import Motion

    robot, motions, read = report.load.robot, [], tuple(report.doubts)
    for table in excerpts(log.table, _RUNS, _ROWS):
        rows = log.motion(table)
        still = np.zeros((len(rows.time), robot.nv))  # the search differentiates positions with its own cut-off
        motions.append(Motion(rows.time, rows.q, still, still, rows.tau, robot, read=read))
    return identification.measured_causes(robot, motions)
