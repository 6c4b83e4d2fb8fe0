"""Result of a simulation: times, states, torques, energies, drift, events and the reason of its end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.glossary import complete
from ..core.numbers import number, residual
from ..errors import ValueRangeError
from ..robot.task_space_methods import require_robot
from ..typing import Array
from .events import Happening

if TYPE_CHECKING:
    from ..motion.motion import Motion
    from ..robot import Robot

_ROUNDING = 1e-9
"""Share of the energy below which drift counts as rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulationResult:
    """Simulated motion of n states, the first at time 0. Printing it shows its end and the drift.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> swing = tw.robots.pendulum().simulate([1.0], [0.0], duration=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = SimulationResult.load(swing.to_npz(f"{folder}/swing.npz"))
    ...     table, picture = swing.to_csv(f"{folder}/swing.csv"), swing.plot(f"{folder}/swing.svg")
    ...     bool((again.q == SimulationResult.load(table).q).all()), picture.name
    (True, 'swing.svg')
    >>> again.with_robot(tw.robots.pendulum()).motion
    <Motion of 'pendulum': 101 states, 0 to 0.1 s>
    """

    robot: str
    """The robot's name."""
    coordinate_names: tuple[str, ...]
    """Names of the entries of q."""
    velocity_names: tuple[str, ...]
    """Names of the entries of dq, ddq and tau."""
    times: Array
    """(n,) s."""
    q: Array
    """(n, nq)."""
    dq: Array
    """(n, nv)."""
    ddq: Array
    """(n, nv)."""
    tau: Array
    """(n, nv), of ``tau`` and the controller together; what friction and contacts do is not in it."""
    kinetic_energy: Array
    """(n,) J."""
    potential_energy: Array
    """(n,) J, of gravity and springs."""
    work: Mapping[str, Array]
    """(n,) J each, done so far on the robot by its ``torques``, by ``friction``, by ``wrenches`` and by ``contacts``."""
    momentum: Array
    """(n, 6), spatial, of the moving bodies at the base origin [N m s, N s]."""
    stopped: str
    """Why the simulation ended there, in words."""
    completed: bool = True
    """True if the run reached the end of its duration."""
    events: tuple[Happening, ...] = ()
    """Events in order."""
    method: str = ""
    """The integrator."""
    dt: float = np.nan
    """s, between the states of a record of which every one is kept; the step, unless the method adapts it."""
    steps: int = 0
    """Number of steps."""
    rejected: int = 0
    """Steps that an adaptive method took again, shorter."""
    evaluations: int = 0
    """Number of evaluations of forward dynamics."""
    error_estimate: Array = field(default_factory=lambda: np.zeros(0))
    """(nv,) rad or m, about how far off each coordinate may be: the errors of all steps added up, which would be the error of
    the motion if they neither grew nor faded nor cancelled. Some fixed steps are repeated in two halves, forces and
    contacts included; ``dopri5`` judges each of its steps. NaN where nothing is known."""
    relative_error: float = np.nan
    """The largest of them, over the largest travel of the joints that turn, or of those that slide."""
    remarks: tuple[str, ...] = ()
    """Remarks to read before use; empty if there are none."""
    coordinate_units: tuple[str, ...] = ()
    """Units of the entries of q: ``"rad"``, ``"m"``, and ``""`` for those of a quaternion."""
    simulated: Robot | None = None
    """The robot; None where the result was read from a file."""
    energy: Array = field(init=False)
    """(n,) J, kinetic and potential."""
    drift: Array = field(init=False)
    """(n,) J, gain of energy that work does not explain: the error of the method."""

    def __post_init__(self) -> None:
        with np.errstate(all="ignore"):  # the last states before a failure may be enormous
            energy = self.kinetic_energy + self.potential_energy
            drift = energy - energy[0] - sum(self.work.values())
        object.__setattr__(self, "energy", energy)
        object.__setattr__(self, "drift", drift)

    @property
    def relative_drift(self) -> float:
        """The largest drift, over the energy that moved: the largest kinetic energy, work, or change of potential energy."""
        if not np.isfinite(self.energy).all():
            return np.nan
        moved = float(self.kinetic_energy.max()), float(np.ptp(self.potential_energy))
        largest = max(*moved, *map(_largest, self.work.values()), _ROUNDING * _largest(self.energy))
        return _largest(self.drift) / largest if largest > 0 else 0.0

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        parts = [f"{len(self)} state{'s' * (len(self) != 1)} to {number(self.times[-1], 6)} s", self.stopped]
        parts.append(f"drift of energy {residual(self.relative_drift)}")
        if np.isfinite(self.relative_error):
            parts.append(f"error of the motion about {residual(self.relative_error)}")
        parts += [f"note: {r}" for r in self.remarks]
        return f"<SimulationResult of {self.robot!r}, {self.method}: {'; '.join(parts)}>"

    def _repr_html_(self) -> str:
        from ..core.tables import html_table

        title = f"{self.robot}, {self.method}: {self.stopped}; drift of energy {residual(self.relative_drift)}"
        rows = zip(self.coordinate_names, self.q[0], self.q[-1], self.q.min(axis=0), self.q.max(axis=0), strict=True)
        return html_table(f"{title}; rad, m", ("coordinate", "start", "end", "lowest", "highest"), rows)

    @property
    def motion(self) -> Motion:
        """States as a :class:`twistwrench.Motion`, whose ``tau`` are the applied torques; of a file :meth:`with_robot`."""
        if self.simulated is None:
            raise ValueRangeError(
                "this result was read from a file, which has no robot in it: result.with_robot(robot).motion."
            )
        from ..motion.motion import Motion

        return Motion(self.times, self.q, self.dq, self.ddq, self.tau, self.simulated, in_seconds=True)

    def with_robot(self, robot: Robot) -> SimulationResult:
        """Return the result with the robot that was simulated, for a result from a file.

        Returns
        -------
        result : SimulationResult
        """
        if require_robot(robot, "SimulationResult.with_robot").coordinate_names != self.coordinate_names:
            raise ValueRangeError(
                f"the result is of robot {self.robot!r}, whose coordinates are others than those of {robot.name!r}."
            )
        return replace(self, simulated=robot)

    def to_csv(self, path: str | Path, *, degrees: bool = False) -> Path:
        """Write a CSV file that ``twistwrench torques`` reads as a motion, and :meth:`load` gives back to the last bit.

        Parameters
        ----------
        degrees : bool, angles in degrees, which the header then says: ``elbow [deg]``, ``elbow.vel [deg/s]``

        Returns
        -------
        path : Path of the file written

        Notes
        -----
        Columns: time, each coordinate, ``.vel``, ``.acc`` and ``.torque`` of each velocity, energies, works and
        momentum; text in comments before the header. Degrees come back with the rounding of the conversion.
        """
        from .result_files import write_csv

        return write_csv(self, path, degrees=degrees)

    def to_npz(self, path: str | Path) -> Path:
        """Write NumPy's archive of arrays, which :meth:`load` gives back to the last bit.

        Returns
        -------
        path : Path of the file written
        """
        from .result_files import write_npz

        return write_npz(self, path)

    @staticmethod
    def load(path: str | Path) -> SimulationResult:
        """Read what :meth:`to_csv` or :meth:`to_npz` wrote, whatever the file is called, without its robot.

        Returns
        -------
        result : SimulationResult
        """
        from .result_files import read

        return read(path)

    def plot(self, path: str | Path) -> Path:
        """Plot of joints, energies and drift; the suffix sets the kind (.png, .pdf, .svg).

        Returns
        -------
        path : Path of the file written
        """
        from ..plotting.simulation import plot_simulation

        return plot_simulation(self, path)


def _largest(x: Array) -> float:
    return max(float(x.max()), -float(x.min()))


# ── Preallocated record of a run

_AT_FIRST = 1_000_000
"""States that room is made for at the beginning, at most."""


class Record:
    """Times, states, accelerations and torques of each state kept, added all at once or not at all; and what happened."""

    def __init__(self, rows: int, size: int, nv: int) -> None:
        self.count = 0
        """Number of stored states."""
        self.events: list[Happening] = []
        rows = min(rows, _AT_FIRST)
        self._parts = np.empty(rows), np.empty((rows, size)), np.empty((rows, nv)), np.empty((rows, nv))

    @property
    def last(self) -> float:
        """The time of the last state [s]; -inf where none is kept."""
        return float(self._parts[0][self.count - 1]) if self.count else -np.inf

    @property
    def states(self) -> Array:
        """(count, size)."""
        return self._parts[1][: self.count]

    def keep(self, t: float, y: Array, ddq: Array, tau: Array) -> None:
        """Add a state."""
        k = self.count
        if k == len(self._parts[0]):
            self._grow(k + 1)
        given: tuple[Any, ...] = (t, y, ddq, tau)
        for part, value in zip(self._parts, given, strict=True):
            part[k] = value
        self.count = k + 1

    def keep_block(self, times: Array, states: Array, accelerations: Array, tau: Array) -> None:
        """Add m states (m, size) under torques (nv,) or (m, nv)."""
        first, end = self.count, self.count + len(times)
        if end > len(self._parts[0]):
            self._grow(end)
        for room, given in zip(self._parts, (times, states, accelerations, tau), strict=True):
            room[first:end] = given
        self.count = end

    def result(self, robot: Robot, works: tuple[str, ...], **more: Any) -> SimulationResult:
        """Return the stored states, with energies and momentum."""
        times, Y, accelerations, torques = (x[: self.count] for x in self._parts)
        if self.count < len(self._parts[0]) - 2:  # room that an early end left unused is given back
            times, accelerations, torques = times.copy(), accelerations.copy(), torques.copy()
        q, dq, W = (np.ascontiguousarray(x) for x in np.split(Y, [robot.nq, robot.nq + robot.nv], axis=1))
        with np.errstate(all="ignore"):  # the last states before a failure may be enormous
            kinetic, potential = robot.kinetic_energy(q, dq), robot.potential_energy(q)
            momentum = robot.momentum(q, dq)
        more["coordinate_units"] = tuple(u for b in robot.model.leaders for u in b.joint.coordinate_units)
        return SimulationResult(
            robot.name, robot.coordinate_names, robot.model.velocity_names, times, q, dq, accelerations, torques,
            np.asarray(kinetic), np.asarray(potential), {name: x.copy() for name, x in zip(works, W.T, strict=True)},
            np.asarray(momentum), simulated=robot, events=tuple(self.events), **more,
        )  # fmt: skip

    def _grow(self, rows: int) -> None:
        parts = []
        for old in self._parts:
            new = np.empty((max(rows, 2 * len(old)), *old.shape[1:]))
            new[: self.count] = old[: self.count]
            parts.append(new)
        self._parts = tuple(parts)  # type: ignore[assignment]


complete(globals())
