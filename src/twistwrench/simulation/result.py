"""What a simulation gives: times, states, torques, energies, what drifted, what happened, and why it stopped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..report.coordinates import Coordinates
from .events import Happening

if TYPE_CHECKING:
    from ..robot import Robot

Array = NDArray[Any]

__all__ = ["SimulationResult"]

_ROUNDING = 1e-9
"""Share of all energy that may be said to have moved where hardly any has: rounding of the whole is no drift of it."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulationResult:
    """A simulated motion: n states, the first at time 0. Printing it says how far it came, and what drifted."""

    robot: str
    """The robot's name."""
    coordinate_names: tuple[str, ...]
    """Of the entries of q."""
    velocity_names: tuple[str, ...]
    """Of the entries of dq, ddq and tau."""
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
    """Whether it came to the end of its duration."""
    events: tuple[Happening, ...] = ()
    method: str = ""
    dt: float = np.nan
    """s, between the states of a record of which every one is kept; the step, unless the method adapts it."""
    steps: int = 0
    rejected: int = 0
    """Steps that an adaptive method took again, shorter."""
    evaluations: int = 0
    """How often forward dynamics was computed."""
    error_estimate: Array = field(default_factory=lambda: np.zeros(0))
    """(nv,) rad or m, about how far off each coordinate may be: the errors of all steps added up, which would be the error of
    the motion if they neither grew nor faded nor cancelled. Of fixed steps some are taken again in two halves, forces and
    contacts included; ``dopri5`` judges each of its steps. NaN where nothing is known."""
    relative_error: float = np.nan
    """The largest of them, over the largest travel of the joints that turn, or of those that slide."""
    remarks: tuple[str, ...] = ()
    """What to know before the result is used, in words; empty if nothing."""
    coordinate_units: tuple[str, ...] = ()
    """Of the entries of q: ``"rad"``, ``"m"``, and ``""`` for those of a quaternion."""
    energy: Array = field(init=False)
    """(n,) J, kinetic and potential."""
    drift: Array = field(init=False)
    """(n,) J, gain of energy that no work accounts for: the error of the method."""

    def __post_init__(self) -> None:
        with np.errstate(all="ignore"):  # the last states before a failure may be enormous
            energy = self.kinetic_energy + self.potential_energy
            drift = energy - energy[0] - np.sum(list(self.work.values()), axis=0)
        object.__setattr__(self, "energy", energy)
        object.__setattr__(self, "drift", drift)

    @property
    def relative_drift(self) -> float:
        """The largest drift, over the energy that moved: the largest kinetic energy, work, or change of potential energy."""
        if not np.isfinite(self.energy).all():
            return np.nan
        moved = [
            self.kinetic_energy.max(),
            np.ptp(self.potential_energy),
            *(np.abs(w).max() for w in self.work.values()),
        ]
        largest = max(*map(float, moved), _ROUNDING * float(np.abs(self.energy).max()))
        return float(np.abs(self.drift).max()) / largest if largest > 0 else 0.0

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        said = [
            f"{len(self)} states to {self.times[-1]:g} s",
            self.stopped,
            f"drift of energy {self.relative_drift:.1e}",
        ]
        said += [f"error of the motion about {self.relative_error:.1e}"] if np.isfinite(self.relative_error) else []
        said += [f"note: {r}" for r in self.remarks]
        return f"<SimulationResult of {self.robot!r}, {self.method}: {'; '.join(said)}>"

    def to_csv(self, path: str | Path) -> Path:
        """Write a CSV file that ``twistwrench torques`` reads as a motion, and :meth:`load` gives back to the last bit.

        Columns: time, each coordinate, ``.vel``, ``.acc`` and ``.torque`` of each velocity, energies, works and momentum. What
        else there is stands in comments before the header. Raises ValueRangeError where nothing can be written.
        """
        from .files import write_csv

        return write_csv(self, path)

    def to_npz(self, path: str | Path) -> Path:
        """Write NumPy's archive of arrays, which :meth:`load` gives back to the last bit. Raises as :meth:`to_csv`."""
        from .files import write_npz

        return write_npz(self, path)

    @staticmethod
    def load(path: str | Path) -> SimulationResult:
        """Read what :meth:`to_csv` or :meth:`to_npz` wrote, whatever the file is called.

        Raises NotFoundError and TrajectoryError.
        """
        from .files import read

        return read(path)

    def plot(self, path: str | Path) -> Path:
        """Draw joints, energies and drift to a .png, .pdf or .svg.

        Raises MissingExtraError without matplotlib, and ValueRangeError where nothing can be written.
        """
        from .picture import plot_simulation

        return plot_simulation(self, path)


@dataclass
class Record:
    """The states kept so far."""

    times: list[float] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    accelerations: list[Array] = field(default_factory=list)
    torques: list[Array] = field(default_factory=list)
    events: list[Happening] = field(default_factory=list)

    def keep(self, t: float, y: Array, ddq: Array, tau: Array) -> None:
        """Add a state."""
        self.times.append(t)
        self.states.append(y.copy())
        self.accelerations.append(ddq.copy())
        self.torques.append(tau.copy())

    def result(self, robot: Robot, works: tuple[str, ...], **said: Any) -> SimulationResult:
        """All that was kept, with energies and momentum."""
        Y = np.array(self.states)
        q, dq, W = Y[:, : robot.nq], Y[:, robot.nq : robot.nq + robot.nv], Y[:, robot.nq + robot.nv :]
        with np.errstate(all="ignore"):  # the last states before a failure may be enormous
            kinetic, potential = robot.kinetic_energy(q, dq), robot.potential_energy(q)
            momentum = robot.momentum(q, dq)
        return SimulationResult(
            robot=robot.name,
            coordinate_names=robot.coordinate_names,
            coordinate_units=_units(robot),
            velocity_names=robot.model.velocity_names,
            times=np.array(self.times),
            q=q.copy(),
            dq=dq.copy(),
            ddq=np.array(self.accelerations),
            tau=np.array(self.torques),
            kinetic_energy=np.asarray(kinetic),
            potential_energy=np.asarray(potential),
            work={name: W[:, k].copy() for k, name in enumerate(works)},
            momentum=np.asarray(momentum),
            events=tuple(self.events),
            **said,
        )


def _units(robot: Robot) -> tuple[str, ...]:
    coordinates = Coordinates.of(robot.model)
    units = ["rad" if angular else "m" for angular in coordinates.angular]
    for place in coordinates.quaternions:
        units[place] = [""] * 4
    return tuple(units)
