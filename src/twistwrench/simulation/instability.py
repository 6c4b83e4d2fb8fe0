"""What is said of a step that is unstable: which joint, how fast, and what to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import printed
from ..typing import Array
from .schemes import ADAPTIVE

if TYPE_CHECKING:
    from .run import Run


def instability(run: Run, t0: float, t1: float, y: Array) -> str:
    """The step from t0 to t1 that led a run to the state y, in words."""
    speeds = y[run.system.moving]
    bad = int(np.argmax(np.where(np.isfinite(speeds), np.abs(speeds), np.inf)))
    advice = f"Take a smaller dt than {printed(run.h)} s, or method={ADAPTIVE!r}."
    if run.method == ADAPTIVE:
        advice = "Its error is within the tolerance: look for torques or wrenches that push the way it moves already."
        if run.controller is not None:  # held for h, a damping kd turns dq into (1 - kd h / M) dq
            advice += (
                f" The controller's torques are held for {printed(run.h)} s each, too long for a damping above twice the "
                "inertia over that time: take a smaller dt, less damping, or tau= in place of controller=."
            )
    return (
        f"the step from {printed(t0, 9)} s to {printed(t1, 9)} s is unstable: joint "
        f"{run.robot.model.velocity_names[bad]!r} moves at {printed(speeds[bad], 3)} rad/s or m/s after it. {advice}"
    )
