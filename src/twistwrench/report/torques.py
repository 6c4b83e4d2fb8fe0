"""The main job: a motion through inverse dynamics to peaks, limits and causes, in one pass and bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TrajectoryError
from .coordinates import Coordinates
from .decimation import Envelope
from .derivatives import Differentiation, States
from .estimates import UNDERSMOOTHED, estimate_peaks
from .findings import NEGLIGIBLE, Excess, JointTorque, TorqueReport, worst_joint
from .load import TERMS, LoadedRobot
from .motors import MotorTally
from .strays import Strays
from .table_file import TableFile
from .tally import Extreme, Gaps, Rms

if TYPE_CHECKING:
    from ..model.model import Limits

Array = NDArray[Any]

__all__ = ["analyse"]

_NUMBERS_PER_CHUNK = 1 << 19  # rows times velocities worked on at a time: 4 MiB an array
_AROUND = 2048  # rows kept on either side of the worst peak
_GAP = 5.0  # usual steps of time from which a step is a gap
_MASS_SAMPLES = 32  # states of each chunk whose mass matrix carries noise of accelerations into torques
_SLACK = 1e-9
"""A limit passed by less than this, in its unit, is round-off; of limits above 1, by less than this share of them."""


class _Pass:
    """One pass over the states: what is kept of them."""

    def __init__(self, load: LoadedRobot, limits: Limits, usual_step: float) -> None:
        nv = load.bare.nv
        self.load, self.limits = load, limits
        self.coordinates = Coordinates.of(load.bare.model)
        self.rows = 0
        self.begin = self.end = np.nan
        self.peak, self.rms = Extreme(nv), Rms(nv)
        self.signed = {kind: np.zeros(nv) for kind in ("effort", "lower", "upper", "velocity")}
        self.terms = {name: np.zeros(nv) for name in TERMS}
        self.passed = {kind: Extreme(nv) for kind in ("lower", "upper", "velocity")}
        """By how much; ``signed`` has the values themselves at their worst."""
        self.envelope = Envelope()
        self.around: States | None = None
        self.gaps = Gaps(_GAP * usual_step)
        self.noise = np.zeros(nv)
        self.largest = np.zeros(load.bare.nq)
        self.strays = Strays()
        self.motors = MotorTally(load.loaded.model)
        self.still = np.zeros(nv, int)
        """Rows in which the direction of motion is unknown."""

    def add(self, s: States, torques: Array, sigma_ddq: Array) -> None:
        """Take in consecutive states and their torques (n, nv)."""
        self.begin = float(s.time[0]) if self.rows == 0 else self.begin
        self.end = float(s.time[-1])
        self.rows += len(s)
        self.rms.add(s.time, torques)
        self.envelope.add(s.time, torques)
        self.gaps.add(s.time)
        fresh = self.peak.add(s.time, np.abs(torques))
        if fresh:
            joints, rows = (np.array(x) for x in zip(*fresh, strict=True))
            terms = self.load.terms(s.at(rows))
            for name, values in terms.items():
                self.terms[name][joints] = values[np.arange(len(joints)), joints]
            self.signed["effort"][joints] = torques[rows, joints]
            # A joint becomes the worst only by a new peak of its own, so its surroundings are at hand now.
            worst = worst_joint(self.peak.value, self.limits.effort)
            for joint, row in fresh:
                if joint == worst:
                    self.around = s.at(slice(max(0, row - _AROUND), row + _AROUND)).copy()
        self._check_motion(s)
        self.largest = np.maximum(self.largest, np.abs(s.logged).max(axis=0))
        self.still += s.still.sum(axis=0)
        self.strays.add(s.time, s.stray)
        if self.load.loaded.actuators:
            self.motors.add(s.time, self.load.motor_loads(s))
        if sigma_ddq.any():
            some = s.at(slice(None, None, max(1, len(s) // _MASS_SAMPLES)))
            M = self.load.loaded.mass_matrix(some.q)
            spread = np.sqrt((M * M) @ (sigma_ddq**2))
            self.noise = np.maximum(self.noise, spread.max(axis=0))

    def _check_motion(self, s: States) -> None:
        at, limits = self.coordinates.position_of, self.limits
        q = np.where(at >= 0, s.logged[:, np.maximum(at, 0)], 0.0)
        for kind, values, beyond in (
            ("lower", q, np.where(at >= 0, limits.lower, -np.inf) - q),
            ("upper", q, q - np.where(at >= 0, limits.upper, np.inf)),
            ("velocity", s.dq, np.abs(s.dq) - limits.velocity),
        ):
            for joint, row in self.passed[kind].add(s.time, beyond):
                self.signed[kind][joint] = values[row, joint]

    def excesses(self) -> tuple[Excess, ...]:
        """The limits that were passed, worst effort first."""
        c, limits = self.coordinates, self.limits
        found = []
        for kind, extreme in (("effort", self.peak), *self.passed.items()):
            bound = getattr(limits, kind)
            over = extreme.value - bound if kind == "effort" else extreme.value
            for k in np.flatnonzero(over > _SLACK * np.maximum(1.0, np.where(np.isfinite(bound), np.abs(bound), 1.0))):
                angular = bool(c.angular_velocity[k])
                unit = {"effort": ("N", "N m"), "velocity": ("m/s", "rad/s")}.get(kind, ("m", "rad"))[angular]
                value, limit, time = float(self.signed[kind][k]), float(bound[k]), float(extreme.time[k])
                found.append(Excess(c.velocity_names[k], kind, value, limit, time, unit, angular))
        return tuple(
            sorted(found, key=lambda e: (e.kind != "effort", e.kind, -abs(e.value / e.limit) if e.limit else 0.0))
        )

    def joints(self) -> tuple[JointTorque, ...]:
        """The figures of each joint."""
        c, rms = self.coordinates, self.rms.result()
        return tuple(
            JointTorque(
                joint=name,
                unit=c.torque_units[k],
                peak=float(self.signed["effort"][k]),
                time=float(self.peak.time[k]),
                rms=float(rms[k]),
                limit=float(self.limits.effort[k]),
                terms={term: float(values[k]) for term, values in self.terms.items()},
                noise=float(self.noise[k]),
            )
            for k, name in enumerate(c.velocity_names)
        )


def analyse(
    load: LoadedRobot,
    differentiation: Differentiation,
    limits: Limits,
    *,
    csv: str | Path | None = None,
    split: bool = False,
    progress: Callable[[int], None] | None = None,
    chunk: int | None = None,
) -> TorqueReport:
    """Run the motion through inverse dynamics and judge it.

    ``csv`` names a file for the torques, with the causes as columns of their own if ``split``. ``chunk`` is the number
    of rows worked on at a time; results do not depend on it, beyond round-off of sums.
    """
    nv = load.bare.nv
    chunk = chunk or max(1024, _NUMBERS_PER_CHUNK // max(1, nv))
    run = _Pass(load, limits, differentiation.quality.step)
    names = run.coordinates.velocity_names
    with TableFile.writing(csv, _csv_header(names, split)) as table:
        for s in differentiation.states(chunk, progress):
            torques = load.torques(s)
            _check_finite(torques, s)
            run.add(s, torques, differentiation.sigma_ddq)
            if table is not None:
                parts = list(load.terms(s).values()) if split else []
                table.write(np.concatenate([s.time[:, None], torques, *parts], axis=1))
    report = TorqueReport(
        robot=load.bare.name,
        trajectory=str(differentiation.trajectory.path),
        rows=run.rows,
        begin=run.begin,
        end=run.end,
        joints=run.joints(),
        excesses=run.excesses(),
        gaps=run.gaps,
        quality=differentiation.quality,
        differentiation=differentiation,
        load=load,
        envelope=run.envelope.result(),
        largest=run.largest,
        limits=limits,
        strays=run.strays.result(),
        still=tuple((run.still / max(1, run.rows)).tolist()),
        motors=run.motors.result(),
        around=run.around or States.none(load.bare.nq, nv),
        contradictions=(*load.contradictions, *differentiation.trajectory.contradictions(limits)),
    )
    return _without_noise(report, chunk, progress)


def _without_noise(report: TorqueReport, chunk: int, progress: Callable[[int], None] | None) -> TorqueReport:
    """The report with the peaks of the smoothed motion and how sure they are, where noise matters."""
    if not any(j.noise > NEGLIGIBLE * report.reference(j) for j in report.joints):
        return report
    plan = report.differentiation.smoothed(UNDERSMOOTHED)
    estimates, strays = estimate_peaks(report.load, plan, chunk, progress)
    joints = tuple(replace(j, estimate=e) for j, e in zip(report.joints, estimates, strict=True))
    return replace(report, joints=joints, smoothed=plan, strays=report.strays or strays)


def _check_finite(torques: Array, s: States) -> None:
    bad = ~np.isfinite(torques).all(axis=1)
    if bad.any():
        time = float(s.time[np.argmax(bad)])
        raise TrajectoryError(
            f"the torques at t = {time:g} s are not finite numbers. Positions may be absurdly large there, or a "
            "quaternion zero: look at that row."
        )


def _csv_header(names: tuple[str, ...], split: bool) -> list[str]:
    quantities = ["torque", *TERMS] if split else ["torque"]
    return ["time", *(f"{name}.{quantity}" for quantity in quantities for name in names)]
