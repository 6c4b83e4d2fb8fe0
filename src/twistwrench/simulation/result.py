"""Result of a simulation: times, states, torques, energies, drift, events and the reason of its end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.answers.answer import Answer
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, residual
from ..core.typing import Array
from ..robot.base import require_robot
from .events import Happening

if TYPE_CHECKING:
    from ..core.answers.blocks import Block
    from ..core.answers.page import Setting
    from ..core.verdict import Verdict
    from ..motion.motion import Motion
    from ..robot import Robot
    from .judgement import MotionClearance

_ROUNDING = 1e-9
"""Fraction of the energy below which exchanged energy counts as rounding error."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulationResult(Answer):
    """Simulated motion of n states, the first at time 0; printing it shows the report of ``twistwrench simulate``.

    The verdict is DONE, OVER LIMIT if torques were given and a limit is passed, or STOPPED if the motion ended early.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> swing = tw.robots.pendulum().simulate([1.0], [0.0], duration=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = SimulationResult.load(swing.to_npz(f"{folder}/swing.npz"))
    ...     table, picture = swing.to_csv(f"{folder}/swing.csv"), swing.plot(f"{folder}/swing.svg")
    ...     bool((again.q == SimulationResult.load(table).q).all()), picture.name
    (True, 'swing.svg')
    >>> swing.headline.split(" Energy")[0]
    'DONE: simulated 0.1 s.'
    >>> swing.facts()["simulated"], swing.sources()["ROBOT"].endswith("pendulum.urdf")
    ('0.1 s', True)
    >>> again.with_robot(tw.robots.pendulum()).motion
    <Motion of 'pendulum': 101 states, 0 to 0.1 s>
    """

    robot: str
    """Name of the robot."""
    coordinate_names: tuple[str, ...]
    """Names of the entries of q."""
    velocity_names: tuple[str, ...]
    """Names of the entries of dq, ddq and tau."""
    times: Array
    """Times (n,) [s]."""
    q: Array
    """Configurations (n, nq)."""
    dq: Array
    """Velocities (n, nv)."""
    ddq: Array
    """Accelerations (n, nv)."""
    tau: Array
    """(n, nv), sum of ``tau`` and the controller's torques, without friction and contacts."""
    kinetic_energy: Array
    """Kinetic energy (n,) [J]."""
    potential_energy: Array
    """Potential energy of gravity and springs (n,) [J]."""
    work: Mapping[str, Array]
    """Work done so far on the robot by its ``torques``, by ``friction``, ``wrenches`` and ``contacts``, (n,) [J] each."""
    momentum: Array
    """Spatial momentum (n, 6) of the moving bodies at the base origin [N m s, N s]."""
    stopped: str
    """Reason why the simulation ended, as text."""
    completed: bool = True
    """True if the run reached the end of its duration."""
    events: tuple[Happening, ...] = ()
    """Events in order of time."""
    method: str = ""
    """The integrator."""
    dt: float = np.nan
    """Interval [s] between recorded states if every state is kept; equal to the step unless the method is adaptive."""
    steps: int = 0
    """Number of steps."""
    rejected: int = 0
    """Number of rejected steps of an adaptive method."""
    evaluations: int = 0
    """Number of evaluations of forward dynamics."""
    error_estimate: Array = field(default_factory=lambda: np.zeros(0))
    """(nv,) rad or m, estimated error of each coordinate: the sum of the errors of all steps. It is the error of the motion if
    step errors neither grow nor decay nor cancel. Some of the fixed steps are repeated as two half steps, forces and
    contacts included; ``dopri5`` estimates every step. NaN if unknown."""
    relative_error: float = np.nan
    """Largest estimated error divided by the largest travel of the revolute or of the prismatic joints."""
    remarks: tuple[str, ...] = ()
    """Remarks to read before use; empty if there are none."""
    coordinate_units: tuple[str, ...] = ()
    """Units of the entries of q: ``"rad"``, ``"m"``, or ``""`` for entries of a quaternion."""
    simulated: Robot | None = None
    """Robot; None if the result was read from a file."""
    friction: bool = False
    """True if joint friction was counted."""
    clearance: MotionClearance | None = None
    """Least distance between links along the motion, if it was judged."""
    interrupted: bool = False
    """True if a step, a controller or a user ended the run."""
    degrees: bool = False
    """True if the report has angles in degrees."""
    energy: Array = field(init=False)
    """Sum of kinetic and potential energy (n,) [J]."""
    drift: Array = field(init=False)
    """Change of energy that the works do not explain (n,) [J]: the error of the method."""

    def __post_init__(self) -> None:
        with np.errstate(all="ignore"):  # the last states before a failure may overflow
            energy = self.kinetic_energy + self.potential_energy
            drift = energy - energy[0] - sum(self.work.values())
        object.__setattr__(self, "energy", energy)
        object.__setattr__(self, "drift", drift)

    @property
    def relative_drift(self) -> float:
        """Largest drift divided by the largest kinetic energy, work, or change of potential energy."""
        if not np.isfinite(self.energy).all():
            return np.nan
        energies = [float(self.kinetic_energy.max()), float(np.ptp(self.potential_energy))]
        energies += map(_largest_magnitude, self.work.values())
        energies.append(_ROUNDING * _largest_magnitude(self.energy))
        exchanged_energy = max(energies)
        if not exchanged_energy > 0:
            return 0.0
        return _largest_magnitude(self.drift) / exchanged_energy

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        states = "1 state" if len(self) == 1 else f"{len(self)} states"
        parts = [f"{states} to {number(self.times[-1], 6)} s", self.stopped]
        parts.append(f"drift of energy {residual(self.relative_drift)}")
        if np.isfinite(self.relative_error):
            parts.append(f"error of the motion about {residual(self.relative_error)}")
        parts += [f"note: {remark}" for remark in self.remarks]
        return f"<SimulationResult of {self.robot!r}, {self.method}: {'; '.join(parts)}>"

    # ── Answer

    call = "simulate"

    @cached_property
    def verdict(self) -> Verdict:
        """DONE, OVER LIMIT where torques were given, STOPPED, or the verdict on the distance between links."""
        from .judgement import verdict_with_clearance

        return verdict_with_clearance(self)

    @property
    def driven(self) -> bool:
        """True if torques were given."""
        return bool(np.any(self.tau))

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot

    @property
    def subject(self) -> str:
        """Robot and duration."""
        return f"{self.robot} · {number(self.times[-1], 6)} s"

    def blocks(self) -> Iterator[Block]:
        """Verdict, coordinates, velocities, energies, events and remarks.

        Returns
        -------
        blocks : iterator of Block
        """
        from .result_view import simulation_view

        return simulation_view(self)

    def facts(self) -> Mapping[str, str]:
        """Duration and energy drift.

        Returns
        -------
        facts : {name: text}
        """
        return {
            "simulated": f"{number(self.times[-1], 6)} s",
            "energy drift, relative to the energy exchanged": residual(self.relative_drift),
        }

    def sources(self) -> Mapping[str, str | Path]:
        """File of the robot.

        Returns
        -------
        files : {argument: path}
        """
        return {} if self.simulated is None else {"ROBOT": self.simulated.model.source}

    def origin(self) -> Iterator[Setting]:
        """Robot, method, friction, and the limits of the robot.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        from ..motion.limits_file import robot_origin
        from ..motion.model_doubts import friction_words

        if self.simulated is not None:
            yield "method", f"{self.method}, {friction_words(self.simulated.model, counted=self.friction)}"
            yield from robot_origin(self.simulated, self.simulated.limits, degrees=self.degrees)

    # ── Motion and files

    @property
    def motion(self) -> Motion:
        """States as a :class:`twistwrench.Motion` with the applied torques ``tau``; after loading, see :meth:`with_robot`."""
        if self.simulated is None:
            raise ValueRangeError(
                "this result was read from a file, which has no robot in it: result.with_robot(robot).motion."
            )
        from ..motion.motion import Motion

        return Motion(self.times, self.q, self.dq, self.ddq, self.tau, self.simulated, in_seconds=True, plan=True)

    def with_robot(self, robot: Robot) -> SimulationResult:
        """Result with the simulated robot, for a result read from a file.

        Returns
        -------
        result : SimulationResult
        """
        if require_robot(robot, "SimulationResult.with_robot").coordinate_names != self.coordinate_names:
            raise ValueRangeError(
                f"the result is of robot {self.robot!r}, whose coordinates differ from those of {robot.name!r}."
            )
        return replace(self, simulated=robot)

    def to_csv(self, path: str | Path, *, degrees: bool = False) -> Path:
        """Write a CSV file that ``twistwrench torques`` accepts as a motion, and :meth:`load` restores bit by bit.

        Parameters
        ----------
        degrees : bool, write angles in degrees, marked in the header: ``elbow [deg]``, ``elbow.vel [deg/s]``

        Returns
        -------
        path : Path of the file written

        Notes
        -----
        Columns: time, each coordinate, ``.vel``, ``.acc`` and ``.torque`` of each velocity, energies, works and
        momentum; comments before the header hold the text fields. Degrees are restored with rounding errors.
        """
        from .result_files import write_csv

        return write_csv(self, path, degrees=degrees)

    def to_npz(self, path: str | Path) -> Path:
        """Write an npz archive of arrays, which :meth:`load` restores bit by bit.

        Returns
        -------
        path : Path of the file written
        """
        from .result_files import write_npz

        return write_npz(self, path)

    @staticmethod
    def load(path: str | Path) -> SimulationResult:
        """Read a file of :meth:`to_csv` or :meth:`to_npz`, with any file name, without its robot.

        Returns
        -------
        result : SimulationResult
        """
        from .result_files import read

        return read(path)


def _largest_magnitude(x: Array) -> float:
    """Largest absolute value; NaN if an entry is NaN."""
    return max(float(x.max()), -float(x.min()))


# ── Preallocated record of a run

_USUAL_FREE_ROWS = 2
"""Number of rows that may stay free in a run that reaches its end."""
MAX_INITIAL_ROWS = 1_000_000
"""Largest number of states for which memory is allocated at the start."""


class Record:
    """Record of the times, states, accelerations and torques of a run, and of its events.

    A state counts only when all its values are stored, so an interrupt leaves no half-stored state.
    """

    def __init__(self, rows: int, size: int, nv: int) -> None:
        self.count = 0
        """Number of stored states."""
        self.events: list[Happening] = []
        rows = min(rows, MAX_INITIAL_ROWS)
        times = np.empty(rows)
        states = np.empty((rows, size))
        accelerations = np.empty((rows, nv))
        torques = np.empty((rows, nv))
        self._parts = times, states, accelerations, torques
        """Times, states, accelerations and torques; rows from ``count`` on are free."""

    @property
    def last(self) -> float:
        """Time of the last state [s]; -inf if there is none."""
        if self.count == 0:
            return -np.inf
        times, *_ = self._parts
        return float(times[self.count - 1])

    @property
    def states(self) -> Array:
        """States (count, size)."""
        _, states, *_ = self._parts
        return states[: self.count]

    def keep(self, t: float, y: Array, ddq: Array, tau: Array) -> None:
        """Add a state."""
        k = self.count
        if k == len(self._parts[0]):
            self._grow(k + 1)
        values: tuple[Any, ...] = (t, y, ddq, tau)
        for part, value in zip(self._parts, values, strict=True):
            part[k] = value
        self.count = k + 1

    def keep_block(self, times: Array, states: Array, accelerations: Array, tau: Array) -> None:
        """Add m states (m, size) under torques (nv,) or (m, nv)."""
        begin = self.count
        end = begin + len(times)
        if end > len(self._parts[0]):
            self._grow(end)
        for part, values in zip(self._parts, (times, states, accelerations, tau), strict=True):
            part[begin:end] = values
        self.count = end

    def result(self, robot: Robot, works: tuple[str, ...], **other_fields: Any) -> SimulationResult:
        """Result with the stored states, their energies and momentum, and other fields. ``works`` are names of the works."""
        times, states, accelerations, torques = (part[: self.count] for part in self._parts)
        ended_early = self.count < len(self._parts[0]) - _USUAL_FREE_ROWS
        if ended_early:  # copies release the memory of the free rows; the states are copied below in any case
            times = times.copy()
            accelerations = accelerations.copy()
            torques = torques.copy()
        column_blocks = np.split(states, [robot.nq, robot.nq + robot.nv], axis=1)
        q, dq, work_values = map(np.ascontiguousarray, column_blocks)
        with np.errstate(all="ignore"):  # the last states before a failure may overflow
            kinetic_energy = robot.kinetic_energy(q, dq)
            potential_energy = robot.potential_energy(q)
            momentum = robot.momentum(q, dq)
        units: list[str] = []
        for body in robot.model.leaders:
            units += body.joint.coordinate_units
        return SimulationResult(
            robot=robot.name,
            coordinate_names=robot.coordinate_names,
            velocity_names=robot.model.velocity_names,
            times=times,
            q=q,
            dq=dq,
            ddq=accelerations,
            tau=torques,
            kinetic_energy=np.asarray(kinetic_energy),
            potential_energy=np.asarray(potential_energy),
            work={name: values.copy() for name, values in zip(works, work_values.T, strict=True)},
            momentum=np.asarray(momentum),
            coordinate_units=tuple(units),
            simulated=robot,
            events=tuple(self.events),
            **other_fields,
        )

    def _grow(self, rows: int) -> None:
        """Make room for at least ``rows`` states, and at least twice as many as before."""
        parts = []
        for old_part in self._parts:
            new_part = np.empty((max(rows, 2 * len(old_part)), *old_part.shape[1:]))
            new_part[: self.count] = old_part[: self.count]
            parts.append(new_part)
        self._parts = tuple(parts)  # type: ignore[assignment]


complete(globals())
