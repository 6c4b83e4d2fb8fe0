"""Observability of a sensor's unknowns from a log, optimal next poses, and simulated logs of a known sensor."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt, doubt, verdict_from_doubts
from ..core.errors import ShapeError, ValueRangeError
from ..core.estimation.least_squares import null_combinations
from ..core.glossary import complete
from ..core.gravity import GRAVITY, STRENGTH, checked_strength
from ..core.numbers import number, printed
from ..core.tables import csv_table
from ..core.text import Argument, spell
from ..core.typing import Array
from ..core.verdict import Verdict
from ..mechanics.lie import quaternion, se3, so3
from .contact_detection import checked_noise
from .files import readings_of
from .fit import SensorState, Unknowns
from .log import ReadingLog, ReadingsGiven
from .sensor import ForceTorqueSensor, checked_sensor, gravity_in_frame, rotations_to_gravity, sign_factor, unlabelled

_NEAR = 1e-3  # rad; directions of gravity nearer to each other than this count as one
_UNITS = {
    "drift m": "N m/s",
    "drift f": "N/s",
    "bias m": "N m",
    "bias f": "N",
    "mass": "kg",
    "m c": "kg m",
    "I": "kg m²",
    "turn": "rad",
    "tilt": "rad",
    "delay": "s",
}


def blind_spots(log: ReadingLog, unknowns: Unknowns, factor: float) -> list[str]:
    """Combinations of unknowns without effect on any reading of the log, as sentences; empty if all are observable.

    >>> upright = ReadingLog.from_arrays(np.zeros((3, 6)), gravity=[0, 0, -9.81])
    >>> print(blind_spots(upright, Unknowns(), 1.0)[0])
    mass +1 kg with bias fz +9.81 N changes no reading: these cannot be distinguished.
    """
    # If the columns depend on the load: a load without symmetry, whose moments depend on every turn.
    load = np.array([1.0, 0.05, 0.08, 0.1, *np.zeros(6)]) if unknowns.curved.size else None
    A = unknowns.design(log, factor, SensorState(load=load)).reshape(6 * len(log), -1) * unknowns.scales
    names = unknowns.names
    # Load first and bias last: each combination is reported as a change of the load that the bias can cancel.
    order = [*range(6 * unknowns.bias, len(names)), *range(6 * unknowns.bias)]
    combinations = null_combinations(A[:, order]) * unknowns.scales[order]
    return [_sentence(row, [names[k] for k in order]) for row in combinations]


def advice(log: ReadingLog, unknowns: Unknowns) -> str:
    """Advice on the rotations that the log lacks."""
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    centre = unit.mean(axis=0)
    spread, axes = np.linalg.svd(unit - centre)[1:]
    spread = np.concatenate([spread, np.zeros(3)])[:3] / np.sqrt(len(unit))
    if spread[0] < _NEAR:
        return (
            f"In all readings gravity points along ({_vector(centre / np.linalg.norm(centre))}) of the sensor's frame. "
            "Tilt the tool about two different axes between readings, by tens of degrees; `poses` proposes some."
        )
    if spread[1] < _NEAR:
        axis = so3.cross(axes[0], centre)
        about = f" about ({_vector(axis / np.linalg.norm(axis))})" if np.linalg.norm(axis) > _NEAR else ""
        return (
            f"Gravity takes only two directions in the sensor's frame: the tool was turned{about} only. "
            "Add readings tilted about another axis; `poses` proposes some."
        )
    if unknowns.inertia:
        return (
            "Readings at rest or turning about one axis determine the inertia poorly. Log faster turns about three axes, "
            "or do not identify the inertia."
        )
    return "Add readings in other orientations; `poses` proposes some."


def _sentence(row: Array, names: list[str]) -> str:
    units = [next(unit for start, unit in _UNITS.items() if name.startswith(start)) for name in names]
    changes = zip(names, row, units, strict=True)
    terms = [f"{name} {printed(value, 3, signed=True)} {unit}" for name, value, unit in changes if value]
    if len(terms) == 1:
        return f"{terms[0]} changes no reading: it cannot be identified."
    return f"{terms[0]} with {', '.join(terms[1:])} changes no reading: these cannot be distinguished."


def _vector(x: Array) -> str:
    return ", ".join(number(v, 2) for v in x + 0.0)


# ── Poses to read next, D-optimal

NoisePair: TypeAlias = tuple[float, float]
"""Standard deviations of moments [N m] and forces [N]."""
_CANDIDATES = 400
_BELIEF = 1e3  # prior standard deviation of each unknown, in its scale


POSE = ("qw", "qx", "qy", "qz", "gx", "gy", "gz")
"""Columns of a pose: orientation and direction of gravity."""
_WIDE = 0.1  # m; a centre of mass with a larger uncertainty is not determined
_WITHIN_95 = 1.96  # half-width of a 95 % interval over the standard deviation
_UPRIGHT = math.pi / 2  # rad; a smaller limit of the tilt is named in the doubt


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
    """R_wf (count, 3, 3) for this gravity: the smallest rotation from upright. Rotation about the vertical is free."""
    mass_deviation: Array
    """Standard deviation (count,) of the mass [kg] after each pose, for the given noise; inf until observable."""
    first_moment_deviation: Array
    """Largest standard deviation (count,) of the first moment m c [kg m] after each pose; over the mass: of c."""
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
        unit = self.gravity / np.linalg.norm(self.gravity, axis=1, keepdims=True)
        return np.concatenate([quaternion.from_matrix(self.rotations), unit], axis=1)

    @property
    def intervals(self) -> Array:
        """(count, 2) half-widths of the 95 % intervals of mass [kg] and centre of mass [m] after each pose."""
        return _WITHIN_95 * np.stack([self.mass_deviation, self.first_moment_deviation / self.mass], axis=1)

    @property
    def determines_mass(self) -> bool:
        """True if the mass will be known better than to itself."""
        return bool(self.intervals[-1, 0] < self.mass)

    @cached_property
    def doubts(self) -> tuple[Doubt, ...]:
        """Reason why the poses do not determine the load, if there is one."""
        heavy, out = self.intervals[-1]
        if self.determines_mass and out < _WIDE:
            return ()
        what = "the centre of mass" + (f" (± {number(1e3 * out, 2)} mm)" if math.isfinite(out) else "")
        if not self.determines_mass:  # centre of mass: first moment over mass
            what = (
                "the mass" + (f" (± {number(heavy, 2)} kg)" if math.isfinite(heavy) else "") + " or the centre of mass"
            )
        count, limited = len(self.gravity), self.within < _UPRIGHT
        those = f"{count} pose{'s' * (count > 1)}"
        those += f" tilted by up to {number(math.degrees(self.within))}°" if limited else ""
        way = f"Allow larger tilts by {spell(Argument('within'))}, such as 60°" if limited else "Ask for more of them"
        return (doubt("sensor-few-poses", those=those, what=what, mass=number(self.mass), way=way),)

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
        mass, place = self.intervals[-1]
        return {"mass": f"± {number(mass, 2)} kg", "centre of mass": f"± {number(1e3 * place, 2)} mm"}

    def sources(self) -> Mapping[str, str | Path]:
        """File of the readings that count already.

        Returns
        -------
        files : {argument: path}
        """
        return {} if self.log is None or not Path(self.log.name).is_file() else {"LOG": Path(self.log.name)}

    def to_csv(self, path: str | Path) -> Path:
        """Write the poses as a table: orientation and direction of gravity.

        Returns
        -------
        path : Path of the file
        """
        with csv_table(path, POSE) as table:
            table.numbers(self.poses)
        return Path(path)


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
    count, sigma = arguments.integer(count, "count"), checked_noise(noise)
    if not arguments.number(within, "within") >= 0:
        raise ValueRangeError(f"within {within!r} is not a valid largest tilt. Give an angle in rad, such as 1.0.")
    directions = _choices(candidates, within)
    unknowns, weight = Unknowns(), (1.0 / np.repeat(sigma, 3))[:, None]
    if not 0 < arguments.number(mass, "mass") < math.inf:
        text = "{0} is not a valid mass. Give about how many kilograms the load has."
        raise ValueRangeError(text, Argument("mass", mass))
    rows = _design(checked_strength(gravity) * directions, unknowns) * weight
    information = np.diag(1.0 / (_BELIEF * unknowns.scales) ** 2)
    known = None if log is None else readings_of(log, gravity, "propose_poses")
    if known is not None:
        past = _design(known.gravity, unknowns) * weight
        information = information + np.einsum("nki,nkj->ij", past, past)
    chosen, deviations = [], []
    for _ in range(count):
        covariance = np.linalg.inv(information)
        gain = np.linalg.slogdet(np.eye(6) + rows @ covariance @ np.swapaxes(rows, -1, -2))[1]
        # Tie (up to rounding): take the first, so that the choice is the same on every machine.
        best = int(np.flatnonzero(gain > gain.max() - 1e-9)[0])
        chosen.append(best)
        information = information + rows[best].T @ rows[best]
        load = np.sqrt(np.diag(np.linalg.inv(information)))[unknowns.load]
        deviations.append((load[0], load[1:].max()))
    pulls = gravity * directions[chosen]
    spread = np.array(deviations)
    spread[spread > 10.0] = math.inf  # not observable yet: still the prior
    return PoseProposal(pulls, rotations_to_gravity(pulls), spread[:, 0], spread[:, 1], mass, within, known)


def _design(gravity: Array, unknowns: Unknowns) -> Array:
    still = ReadingLog(np.zeros((len(gravity), 6)), gravity)
    return unknowns.design(still, 1.0, SensorState())


def _choices(candidates: ArrayLike | None, within: float) -> Array:
    """Unit gravity directions (n, 3)."""
    if candidates is None:
        k = np.arange(_CANDIDATES) + 0.5  # Fibonacci lattice over the allowed directions; upright comes first
        cap = 1.0 - math.cos(min(within, math.pi))
        z, turn = cap * k / _CANDIDATES - 1.0, math.pi * (1.0 + math.sqrt(5.0)) * k
        radius = np.sqrt(1.0 - z * z)
        d = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=-1)
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
    allowed = d[np.arccos(np.clip(-d[:, 2], -1.0, 1.0)) <= within + 1e-12]
    if not len(allowed):
        raise ValueRangeError(
            f"no candidate tilts the tool by {printed(math.degrees(within), 3)}° or less. Allow more."
        )
    return allowed


# ── Simulated logs of a known sensor

# Unit screws, three translations and three rotations: a basis of all twists.
_SCREWS = np.roll(np.eye(6), 3, axis=0)


def simulate(
    sensor: ForceTorqueSensor,
    poses: int | ArrayLike,
    *,
    noise: tuple[float, float] = (0.01, 0.3),
    motion: float | None = None,
    touch: dict[int, ArrayLike] | None = None,
    rng: np.random.Generator | int = 0,
) -> ReadingLog:
    """Simulated log: readings of a sensor at rest in some orientations, or in a lively motion.

    Parameters
    ----------
    poses : int, (n, 3, 3) or (n, 4, 4) array_like, number of poses, or R_wf or T_wf
    noise : (moment [N m], force [N]), standard deviations
    motion : float, optional, duration of a lively motion [s], sampled at ``poses`` (a number) times
    touch : {index: (6,)}, optional, contact wrench on the load for each touched reading, in the sensor's axes

    Examples
    --------
    >>> sensor = ForceTorqueSensor(bias=[0, 0, 0, 1, 2, 3])
    >>> simulate(sensor, 2, noise=(0, 0)).readings.tolist()
    [[0.0, 0.0, 0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]]
    """
    checked_sensor(sensor, "simulate")
    rng = arguments.generator(rng)
    sigma = checked_noise(noise, none_at_all=True)
    V = dV = time = None
    counted = isinstance(poses, float | np.number) or (hasattr(poses, "__index__") and not np.shape(poses))
    if motion is not None:
        if not counted:
            raise ValueRangeError("a motion makes its own poses. Give their number, such as poses=500.")
        if not isinstance(motion, int | float | np.number) or not 0 < motion < math.inf:
            raise ValueRangeError(
                f"motion {motion!r} is not a valid duration. Give how many seconds it lasts, such as 10.0."
            )
        time = np.linspace(0.0, float(motion), arguments.integer(poses, "poses"))
        T, V, dV = lively_motion(time)
        gravity = gravity_in_frame(T)
    elif counted:
        gravity = propose_poses(arguments.integer(poses, "poses")).gravity
    else:
        gravity = np.atleast_2d(gravity_in_frame(unlabelled({"pose": poses}, sensor.frame)["pose"], GRAVITY))
    exact = sensor.predict(np.eye(3), V, dV, gravity=gravity)
    readings = exact + rng.normal(size=exact.shape) * np.repeat(sigma, 3)
    if touch is not None and not isinstance(touch, dict):
        raise ValueRangeError(f"touch is {arguments.value_text(touch)}: give {{number of a reading: wrench (6,)}}.")
    for index, wrench in (touch or {}).items():
        what = f"touch of reading {index}"
        F = arguments.finite(arguments.one(wrench, what, 6), what)
        readings[_row(index, len(readings))] += sign_factor(sensor.sign) * F
    return ReadingLog.from_arrays(readings, gravity=gravity, V=V, dV=dV, time=time, name="simulated log")


def _row(index: Any, count: int) -> int:
    try:
        row = operator.index(index)
    except TypeError:
        row = count
    if not -count <= row < count:
        raise ValueRangeError(f"touch: there is no reading {index!r}. They are 0 to {count - 1}.")
    return row


def lively_motion(time: ArrayLike) -> tuple[Array, Array, Array]:
    """Motion of a waving hand: poses, body twists and their exact rates.

    Returns
    -------
    T : (n, 4, 4) array, poses T_wf
    V, dV : (n, 6) array, body twists and their rates

    Examples
    --------
    >>> T, V, dV = lively_motion([0.0, 0.1])
    >>> T.shape, V.shape, dV.shape
    ((2, 4, 4), (2, 6), (2, 6))
    """
    t = np.asarray(time, float)[..., None]
    amplitude = np.array([0.2, 0.15, 0.1, 1.2, 1.0, 1.4])  # m, rad
    rate = np.array([2.1, 2.9, 3.7, 1.7, 2.3, 3.1])  # rad/s, all different
    phase = np.array([0.0, 1.0, 2.0, 0.5, 1.5, 2.5])
    q = amplitude * np.sin(rate * t + phase)
    dq, ddq = amplitude * rate * np.cos(rate * t + phase), -(rate**2) * q
    T = np.broadcast_to(np.eye(4), (*t.shape[:-1], 4, 4))
    V = dV = np.zeros((*t.shape[:-1], 6))
    for k, S in enumerate(_SCREWS):
        step = se3.exp(S * q[..., k : k + 1])
        back = se3.Ad(se3.inverse(step))
        own = S * dq[..., k : k + 1]
        T, V = T @ step, back @ V + own
        dV = back @ dV + se3.ad(V) @ own + S * ddq[..., k : k + 1]
    return T, V, dV


complete(globals())
