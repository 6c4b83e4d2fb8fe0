"""The main job: a motion through inverse dynamics to peaks, limits and causes, in bounded memory.

Where the noise of a log matters, the log is smoothed and gone through again, and that second pass is the answer: peaks,
causes, limits, motors, files and pictures are all of it. What was derived from the log as it is stands beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import printed
from ..errors import TrajectoryError
from ..motion.complete_states import States
from ..motion.differentiation import Differentiation
from ..motion.table_file import TableFile
from ..typing import Array
from .estimates import PeakEstimate
from .loaded_robot import TERMS, LoadedRobot
from .motion_statistics import MotionTally
from .progress_share import Steps
from .torque_findings import NEGLIGIBLE, ZERO, AsDerived, JointTorque, TorqueReport, worst_joint

if TYPE_CHECKING:
    from ..model.limits import Limits

_NUMBERS_PER_CHUNK = 1 << 19
"""Rows times velocities worked on at a time: 4 MiB an array."""
_OF_A_PASS, _OF_THE_PLAN, _OF_THE_DRAWS = 1.0, 8.0, 1.0
"""How long each takes for a log of up to :data:`_PLANNED` bytes, in terms of a pass over it."""
_PLANNED = 1 << 21
"""Bytes of the excerpts that a longer log is planned with."""


def analyse(
    load: LoadedRobot,
    differentiation: Differentiation,
    limits: Limits,
    *,
    csv: str | Path | None = None,
    split: bool = False,
    progress: Callable[[float], None] | None = None,
    chunk: int | None = None,
) -> TorqueReport:
    """Run the motion through inverse dynamics and judge it.

    ``csv`` names a file for the torques, with the causes as columns of their own if ``split``. ``progress`` is told the share
    of the work that is done, from 0 to 1. ``chunk`` is the number of rows worked on at a time; results do not depend on
    it, beyond round-off of sums.
    """
    fixed = min(1.0, _PLANNED / max(1, differentiation.trajectory.size))
    steps = Steps(progress, (_OF_A_PASS, _OF_THE_PLAN * fixed, _OF_A_PASS, _OF_THE_DRAWS * fixed))
    run = _Run(load, limits, chunk or max(1024, _NUMBERS_PER_CHUNK // max(1, load.bare.nv)), csv, split, steps)
    if differentiation.smooths:
        steps.skip(2)
        report = run.answer(differentiation)
    elif not differentiation.sigma_ddq.any():
        report = _report(run.once(differentiation, write=True))
    else:
        derived = run.once(differentiation)
        report = _report(derived)
        if any(j.noise > NEGLIGIBLE * report.reference(j) for j in report.joints):
            report = run.answer(differentiation.smoothed(steps.next()), derived)
        elif csv is not None:
            steps.skip(1)
            run.once(differentiation, write=True)
    steps.done()
    return report


@dataclass(frozen=True, eq=False)
class _Run:
    """Passes over one motion, and the file that one of them writes."""

    load: LoadedRobot
    limits: Limits
    chunk: int
    csv: str | Path | None
    split: bool
    steps: Steps

    def once(
        self,
        plan: Differentiation,
        *,
        write: bool = False,
        beside: Differentiation | None = None,
        estimating: bool = False,
    ) -> MotionTally:
        """One pass. With ``write`` the file is of it, and has the torques of the plan ``beside`` as well.

        Where it finds rows that are to be left out, it is made again without them.
        """
        known, told = plan.trajectory.stamps_left_out, self.steps.next(plan.trajectory.size)
        found = self._pass(plan, told, write=write, beside=beside, estimating=estimating)
        if plan.trajectory.stamps_left_out > known:
            found = self._pass(plan, told, write=write, beside=beside, estimating=estimating)
        return found

    def _pass(
        self,
        plan: Differentiation,
        told: Callable[[int], None] | None,
        *,
        write: bool,
        beside: Differentiation | None,
        estimating: bool,
    ) -> MotionTally:
        tally = MotionTally(self.load, self.limits, plan, estimating=estimating)
        header = _csv_header(tally.coordinates.velocity_names, self.split, derived=beside is not None)
        with TableFile.writing(self.csv if write else None, header) as table:
            for states, motion, inner in plan.surrounded_states(self.chunk, told):
                s = states.at(inner)
                torques = self.load.torques(s)
                _check_finite(torques, s)
                tally.add(states, torques, motion, inner)
                if table is not None:
                    parts = list(self.load.terms(s).values()) if self.split else []
                    parts += [] if beside is None else [self.load.torques(beside.complete(motion).at(inner))]
                    table.write(np.concatenate([s.time[:, None], torques, *parts], axis=1))
        return tally

    def answer(self, plan: Differentiation, derived: MotionTally | None = None) -> TorqueReport:
        """The report of the smoothed motion, with what was ``derived`` from the log as it is beside it."""
        beside = None if derived is None else derived.plan
        tally, told = self.once(plan, write=True, beside=beside, estimating=True), self.steps.next()
        estimates = []
        for k in range(self.load.bare.nv):
            estimates.append(tally.estimate(k))
            if told is not None:
                told((k + 1) / self.load.bare.nv)
        return _report(tally, derived, estimates)


def _report(
    run: MotionTally, derived: MotionTally | None = None, estimates: Sequence[PeakEstimate] | None = None
) -> TorqueReport:
    plan, load, strays = run.plan, run.load, run.strays.result()
    joints = _joints(run, derived)
    if estimates is not None:
        joints = tuple(replace(j, estimate=e) for j, e in zip(joints, estimates, strict=True))
    worst = worst_joint([abs(j.peak) for j in joints], [j.limit for j in joints])
    return TorqueReport(
        robot=load.bare.name,
        trajectory=str(plan.trajectory.path),
        rows=run.rows,
        begin=run.begin,
        end=run.end,
        joints=joints,
        excesses=run.excesses(),
        gaps=run.gaps,
        quality=plan.quality,
        differentiation=plan,
        load=load,
        envelope=run.envelope.result(),
        band=None if estimates is None else run.band.result(),
        largest=run.largest,
        limits=run.limits,
        strays=strays,
        still=tuple((run.still / max(1, run.rows)).tolist()),
        motors=run.motors.result(),
        around=run.around[worst] or States.none(load.bare.nq, load.bare.nv),
        contradictions=(*load.contradictions, *plan.trajectory.contradictions(run.limits, glitches=not strays)),
        hints=plan.trajectory.hints(run.limits),
        measured=run.measured(),
        idle_payload=any(p.mass for p in load.payloads)
        and run.carried <= ZERO * float(run.peak.value.max(initial=0.0)),
        room=run.room.result(),
        derived=None
        if derived is None
        else AsDerived(derived.plan, derived.excesses(), derived.envelope.result(), derived.motors.result()),
    )


def _joints(run: MotionTally, derived: MotionTally | None) -> tuple[JointTorque, ...]:
    """The figures of each joint."""
    c, rms = run.coordinates, run.rms.result()
    noisy = run if derived is None else derived
    return tuple(
        JointTorque(
            joint=name,
            unit=c.torque_units[k],
            largest=float(run.signed["effort"][k]),
            time=float(run.peak.time[k]),
            rms=float(rms[k]),
            limit=float(run.limits.effort[k]),
            terms={term: float(values[k]) for term, values in run.terms.items()},
            noise=float(noisy.noise[k]),
            raw=None if derived is None else float(derived.signed["effort"][k]),
            raw_time=None if derived is None else float(derived.peak.time[k]),
        )
        for k, name in enumerate(c.velocity_names)
    )


def _check_finite(torques: Array, s: States) -> None:
    bad = ~np.isfinite(torques).all(axis=1)
    if bad.any():
        time = float(s.time[np.argmax(bad)])
        raise TrajectoryError(
            f"the torques at t = {printed(time)} s are not finite numbers. Positions may be absurdly large there, or a "
            "quaternion zero: look at that row."
        )


def _csv_header(names: tuple[str, ...], split: bool, *, derived: bool) -> list[str]:
    quantities = ["torque", *(TERMS if split else ()), *(["torque.derived"] if derived else [])]
    return ["time", *(f"{name}.{quantity}" for quantity in quantities for name in names)]
