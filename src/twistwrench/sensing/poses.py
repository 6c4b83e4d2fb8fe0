"""Poses of a sensor to read next, D-optimal for the identification of its load."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt, doubt, verdict_from_doubts
from ..core.errors import ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.gravity import STRENGTH, checked_strength
from ..core.numbers import number, printed
from ..core.tables import csv_table
from ..core.text import Argument, spell
from ..core.typing import Array
from ..core.verdict import Verdict
from ..mechanics.lie import quaternion
from .contact_detection import checked_noise
from .files import readings_of
from .log import ReadingLog, ReadingsGiven
from .sensor import rotations_to_gravity
from .unknowns import SensorState, Unknowns

NoisePair: TypeAlias = tuple[float, float]
"""Standard deviations of moments [N m] and forces [N]."""
_CANDIDATE_COUNT = 400
"""Number of candidate directions, unless they are given."""
_PRIOR_DEVIATION = 1e3
"""Prior standard deviation of each unknown, in its scale: nearly no prior knowledge."""
_MAX_OBSERVABLE_DEVIATION = 10.0
"""kg or kg m: larger standard deviations are those of the prior, so that the unknown is not observable yet."""
_MAX_GAIN_OF_TIE = 1e-9
"""Difference of the logarithmic gains of two poses up to which they count as equal."""
_TILT_ROUNDING = 1e-12
"""Excess of a tilt over the largest tilt [rad] that counts as rounding."""
POSE = ("qw", "qx", "qy", "qz", "gx", "gy", "gz")
"""Columns of a pose: orientation and direction of gravity."""
MAX_COM_INTERVAL = 0.1
"""m: a centre of mass with a larger half-width of its interval is not determined."""
_INTERVAL_95 = 1.96
"""Half-width of a 95 % interval in standard deviations."""
_MIN_FREE_TILT = math.pi / 2
"""Limit of the tilt [rad] below which a doubt advises larger tilts."""


@dataclass(frozen=True, eq=False, repr=False)
class PoseProposal(Answer):
    r"""Proposed orientations, in the order to read them, and the expected deviations: result of :func:`propose_poses`.

    Examples
    --------
    >>> import tempfile
    >>> found = propose_poses(12, mass=3.0)
    >>> found
    <PoseProposal: OK, mass ± 0.017 kg>
    >>> found.facts()["centre of mass"], found.sources(), str(next(found.blocks()).word)
    ('± 0.24 mm', {}, 'OK')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found.to_csv(f"{folder}/poses.csv").read_text().partition("\n")[0]
    'qw,qx,qy,qz,gx,gy,gz'
    """

    call: ClassVar[str] = "sensor poses"

    gravity: Array
    """Gravity (count, 3) in {f} [m/s²]."""
    rotations: Array
    """R_wf (count, 3, 3): the smallest rotation from upright to this gravity; a rotation about the vertical may be added."""
    mass_deviation: Array
    """Standard deviation (count,) of the mass [kg] after each pose, for the given noise; inf until observable."""
    first_moment_deviation: Array
    """Largest standard deviation (count,) of a component of the first moment m c [kg m] after each pose."""
    mass: float = 1.0
    """Approximate mass of the load [kg]."""
    within: float = math.pi
    """Largest tilt of the tool from upright [rad]."""
    log: ReadingLog | None = None
    """Readings that count already."""

    @property
    def subject(self) -> str:
        """File of the readings that count already."""
        return "from nothing" if self.log is None else Path(self.log.name).name

    @property
    def brief(self) -> str:
        """Half-width of the interval of the mass after all poses."""
        return f"mass ± {number(self.intervals[-1, 0], 2)} kg"

    @property
    def poses(self) -> Array:
        """(count, 7) orientations as quaternions of R_wf, scalar first, and directions of gravity in {f}."""
        directions = self.gravity / np.linalg.norm(self.gravity, axis=1, keepdims=True)
        return np.concatenate([quaternion.from_matrix(self.rotations), directions], axis=1)

    @property
    def intervals(self) -> Array:
        """(count, 2) half-widths of the 95 % intervals of mass [kg] and centre of mass [m] after each pose."""
        com_deviation = self.first_moment_deviation / self.mass
        return _INTERVAL_95 * np.stack([self.mass_deviation, com_deviation], axis=1)

    @property
    def determines_mass(self) -> bool:
        """True if the half-width of the interval of the mass will be less than the mass."""
        return bool(self.intervals[-1, 0] < self.mass)

    @cached_property
    def doubts(self) -> tuple[Doubt, ...]:
        """Reason why the poses do not determine the load, if there is one."""
        mass_half_width, com_half_width = self.intervals[-1]
        if self.determines_mass and com_half_width < MAX_COM_INTERVAL:
            return ()
        if self.determines_mass:
            interval = _half_width_text(1e3 * com_half_width, "mm")
            undetermined_quantities = f"the centre of mass{interval}"
        else:  # the centre of mass is the first moment over the mass
            interval = _half_width_text(mass_half_width, "kg")
            undetermined_quantities = f"the mass{interval} or the centre of mass"
        poses_text = "1 pose" if len(self.gravity) == 1 else f"{len(self.gravity)} poses"
        remedy = "Ask for more of them"
        if self.within < _MIN_FREE_TILT:
            poses_text += f" tilted by up to {number(math.degrees(self.within))}°"
            remedy = f"Allow larger tilts by {spell(Argument('within'))}, such as 60°"
        few_poses = doubt(
            "sensor-few-poses", those=poses_text, what=undetermined_quantities, mass=number(self.mass), way=remedy
        )
        return (few_poses,)

    @property
    def verdict(self) -> Verdict:
        """OK; LOOK AGAIN if the poses do not determine the mass or the centre of mass."""
        return verdict_from_doubts(self.doubts)

    def blocks(self) -> Iterator[Block]:
        """Verdict and the poses in measuring order; only the verdict if they do not determine the load."""
        from .views import proposal_view

        return proposal_view(self)

    def facts(self) -> Mapping[str, str]:
        """Half-widths of the 95 % intervals of mass and centre of mass, if the poses determine them.

        Returns
        -------
        facts : {name: text}
        """
        if not self.determines_mass:
            return {}
        mass_half_width, com_half_width = self.intervals[-1]
        return {
            "mass": f"± {number(mass_half_width, 2)} kg",
            "centre of mass": f"± {number(1e3 * com_half_width, 2)} mm",
        }

    def sources(self) -> Mapping[str, str | Path]:
        """File of the readings that count already.

        Returns
        -------
        files : {argument: path}
        """
        if self.log is None or not Path(self.log.name).is_file():
            return {}
        return {"LOG": Path(self.log.name)}

    def to_csv(self, path: str | Path) -> Path:
        """Write the poses as a table: orientation and direction of gravity.

        Returns
        -------
        path : Path of the file
        """
        with csv_table(path, POSE) as table:
            table.numbers(self.poses)
        return Path(path)


def _half_width_text(half_width: float, unit: str) -> str:
    """Half-width of an interval in brackets; empty if it is infinite."""
    return f" (± {number(half_width, 2)} {unit})" if math.isfinite(half_width) else ""


def propose_poses(
    count: int = 6,
    *,
    log: ReadingsGiven | None = None,
    candidates: ArrayLike | None = None,
    within: float = math.pi,
    noise: NoisePair = (0.01, 0.3),
    mass: float = 1.0,
    gravity: float = STRENGTH,
) -> PoseProposal:
    """Optimal experiment design: next orientations for a static identification, chosen greedily by D-optimality.

    Parameters
    ----------
    count : int, number of orientations
    log : ReadingLog, path of a log, "demo" or "demo-motion", optional, readings that count already
    candidates : (n, 3) array_like, optional, gravity directions in {f} to choose from; default: 400 spread evenly
    within : float, largest tilt of the tool from upright (gravity along -z of {f}) [rad]
    noise : (moment [N m], force [N])
        Standard deviation of moments [N m] and forces [N].
    mass : float
        Approximate mass of the load [kg].
    gravity : float
        Its size [m/s²]; -z of the world.

    Returns
    -------
    proposal : PoseProposal
        ``proposal.verdict``, ``proposal.rotations``, ``proposal.to_csv(path)``.

    Notes
    -----
    Source: Fedorov, "Theory of Optimal Experiments", 1972: det(M + A'A) = det M · det(1 + A M⁻¹ A').

    Examples
    --------
    >>> proposal = propose_poses(12)
    >>> proposal.gravity.shape, bool(proposal.mass_deviation[-1] < 0.01)
    ((12, 3), True)
    """
    count = arguments.integer(count, "count")
    sigma = checked_noise(noise)
    if not arguments.number(within, "within") >= 0:
        raise ValueRangeError(f"within {within!r} is not a valid largest tilt. Give an angle in rad, such as 1.0.")
    directions = _candidate_directions(candidates, within)
    if not 0 < arguments.number(mass, "mass") < math.inf:
        text = "{0} is not a valid mass. Give about how many kilograms the load has."
        raise ValueRangeError(text, Argument("mass", mass))
    unknowns = Unknowns()
    weights = (1.0 / np.repeat(sigma, 3))[:, None]  # of the three moments and three forces
    A = _design(checked_strength(gravity) * directions, unknowns) * weights
    information = np.diag(1.0 / (_PRIOR_DEVIATION * unknowns.scales) ** 2)  # M of the source
    earlier_log = None
    if log is not None:
        earlier_log = readings_of(log, gravity, "propose_poses")
        earlier_rows = _design(earlier_log.gravity, unknowns) * weights
        information = information + np.einsum("nki,nkj->ij", earlier_rows, earlier_rows)
    chosen_indices: list[int] = []
    deviations: list[tuple[float, float]] = []  # of the mass and of the first moment, after each pose
    for _ in range(count):
        covariance = np.linalg.inv(information)
        gain_matrices = np.eye(6) + A @ covariance @ np.swapaxes(A, -1, -2)  # of moments and forces of a candidate
        _, log_gains = np.linalg.slogdet(gain_matrices)
        best_indices = np.flatnonzero(log_gains > log_gains.max() - _MAX_GAIN_OF_TIE)
        best = int(best_indices[0])  # the first, so that the choice is the same on every machine
        chosen_indices.append(best)
        information = information + A[best].T @ A[best]
        variances = np.diag(np.linalg.inv(information))
        load_deviations = np.sqrt(variances)[unknowns.load]
        mass_deviation = load_deviations[0]
        first_moment_deviation = load_deviations[1:].max()  # the largest of three
        deviations.append((mass_deviation, first_moment_deviation))
    chosen_gravity = gravity * directions[chosen_indices]
    rotations = rotations_to_gravity(chosen_gravity)
    mass_deviations, first_moment_deviations = np.array(deviations).T
    mass_deviations[mass_deviations > _MAX_OBSERVABLE_DEVIATION] = math.inf
    first_moment_deviations[first_moment_deviations > _MAX_OBSERVABLE_DEVIATION] = math.inf
    return PoseProposal(chosen_gravity, rotations, mass_deviations, first_moment_deviations, mass, within, earlier_log)


def _design(gravity: Array, unknowns: Unknowns) -> Array:
    """Design matrix (n, 6, p) of readings at rest under this gravity (n, 3) [m/s²]."""
    log_at_rest = ReadingLog(np.zeros((len(gravity), 6)), gravity)
    return unknowns.design(log_at_rest, 1.0, SensorState())


def _candidate_directions(candidates: ArrayLike | None, within: float) -> Array:
    """Unit gravity directions (n, 3) within the largest tilt from upright [rad]."""
    if candidates is None:  # upright, then a Fibonacci lattice over the allowed directions
        k = np.arange(_CANDIDATE_COUNT) + 0.5
        cap_height = 1.0 - math.cos(min(within, math.pi))
        z = cap_height * k / _CANDIDATE_COUNT - 1.0
        azimuth = math.pi * (1.0 + math.sqrt(5.0)) * k  # multiples of the golden angle
        radius = np.sqrt(1.0 - z * z)
        d = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)
        d = np.concatenate([[[0.0, 0.0, -1.0]], d])
    else:
        d = np.asarray(arguments.real(candidates, "candidates"), float)
        if d.ndim != 2 or d.shape[1] != 3:
            raise ShapeError(
                f"candidates have shape {d.shape}, expected (n, 3): gravity directions in the sensor's frame."
            )
        length = np.linalg.norm(d, axis=1, keepdims=True)
        if not (np.isfinite(d).all() and (length > 0).all()):
            raise ValueRangeError("candidates must be finite and not zero: gravity directions in the sensor's frame.")
        d = d / length
    tilts = np.arccos(np.clip(-d[:, 2], -1.0, 1.0))
    allowed_directions = d[tilts <= within + _TILT_ROUNDING]
    if not len(allowed_directions):
        raise ValueRangeError(
            f"no candidate tilts the tool by {printed(math.degrees(within), 3)}° or less. Allow more."
        )
    return allowed_directions


complete(globals())
