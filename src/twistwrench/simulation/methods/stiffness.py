"""Stiff equations: trial steps limited by stability, and the error that ends such a run.

The last two stages of the Dormand–Prince method are at the end of the step, at two states z and y1. The difference of
their rates, divided by the difference of the states, estimates the largest eigenvalue λ. The method is stable up to
h λ ≈ 3.3. Source: Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.2.
"""

from __future__ import annotations

import numpy as np

from ...core.errors import SimulationError
from ...core.numbers import printed, residual
from ...core.text import argument
from ..forces import System
from .trial_steps import FunctionTrials, TrialSteps

STABILITY_LIMIT = 3.25
"""Value of h λ above which stability limits the step."""
CHECK_INTERVAL = 3000
"""Number of trial steps between two checks of the progress: a few seconds."""
MAX_LIMITED_SHARE = 0.1
"""Fraction of steps limited by stability above which the equations count as stiff."""
MAX_REMAINING_STEPS = 100_000
"""Estimated number of remaining steps above which a stiff run is ended: more than a minute."""


class Stiffness:
    """Counts of trial steps since the last check: all steps, and steps limited by stability."""

    def __init__(self, system: System, trials: TrialSteps | FunctionTrials, duration: float) -> None:
        self.system = system
        self.trials = trials
        self.duration = duration
        self._trials = 0
        """Trial steps since the last check."""
        self._limited = 0
        """Trial steps limited by stability since the last check."""
        self._begin = 0.0
        """Time of the last check [s]."""

    def note(self, t: float, h: float, steepness: float, distance: float) -> None:
        """Record a trial step h to time t: two states at a distance, whose rates differ by ``steepness`` / h.

        Raises SimulationError if the equations are stiff and the run would take too long.
        """
        self._trials += 1
        self._limited += steepness > STABILITY_LIMIT * distance > 0.0  # h λ = steepness / distance is above the limit
        if self._trials < CHECK_INTERVAL:
            return
        mean_step = (t - self._begin) / self._trials
        is_stiff = self._limited > MAX_LIMITED_SHARE * self._trials
        if is_stiff and self.duration - t > MAX_REMAINING_STEPS * mean_step:
            raise SimulationError(self._message(t, h, mean_step, self._steepest_joint()))
        self._trials = 0
        self._limited = 0
        self._begin = t

    def _steepest_joint(self) -> int:
        """Number of the velocity whose torque changes most between the last two stages of a step.

        A steep torque of one joint accelerates others, too. The change δ of the accelerations is therefore divided among the
        joints by δ_i (M δ)_i, which is zero without a change of torque, and has one unit for turning and sliding joints.
        """
        count = self.trials.count
        robot = self.system.robot
        K = self.trials.rates[count]
        acceleration_change = (K[-1] - K[-2])[self.system.moving]
        M = robot.mass_matrix(self.trials.states[count][: robot.nq])
        return int(np.argmax(np.abs(acceleration_change * (M @ acceleration_change))))

    def _message(self, t: float, h: float, mean_step: float, worst: int) -> str:
        """Error message for a stiff run: step, remedy, and joint of the ``worst`` velocity."""
        names = self.system.robot.model.velocity_names
        friction = self.system.friction
        count_text = "endlessly many"
        if mean_step > 0.0:
            remaining_steps = (self.duration - t) / mean_step
            count_text = f"some {printed(remaining_steps, 1)}"
        problem = (
            f"at t = {printed(t)} s the equations are stiff: stability needs steps of {residual(h)} s, {count_text} more to "
            "the end"
        )
        if friction is not None and friction.dry[worst]:
            return (
                f"{problem}. Dry friction of joint {names[worst]!r} is eased off below {printed(friction.creep[worst], 2)} "
                f"rad/s or m/s, which is steep for so light a joint. Take {argument('method', 'semi_implicit')}, in whose "
                "steps friction stops joints and holds them; or, in Python, a larger creep=."
            )
        return (
            f"{problem}, most of all in joint {names[worst]!r}: a torque, a wrench or a contact there is steep for so light a "
            f"joint. Take less gain or stiffness, or {argument('method', 'semi_implicit')}, which takes "
            "viscous friction, and the kd of a tw.control.PD given as tau=, at the end of its steps."
        )
