"""Thresholds for collision detection by the residual of a momentum observer, from a log without contact.

With m_j the mean of the residual e_j in cells of (sgn dq_j, thirds of q_j), the noise n_j = e_j - m_j has block maxima
x = max n_j² over 1 s. They follow a Gumbel law, whose parameters are fitted by moments,

    P(x < u) = exp(-exp(-(u - a)/b)),     b = √6 s/π,     a = mean(x) - γ b,

as squares of Gaussian noise have exponential tails. A joint passes its level u_j in a share p of the blocks; p is such that all
joints together give the wanted number of alarms. The threshold is √u_j + max |m_j|. Source: Coles, "An Introduction to
Statistical Modeling of Extreme Values", 2001, chapter 3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block, Headline, Table, remarks, words
from ..core.doubts import Doubt, doubt, verdict_from_doubts
from ..core.errors import ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, quantity
from ..core.text import listed
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..mechanics.joints.units import units_of
from ..motion.coordinates import Coordinates

if TYPE_CHECKING:
    from ..motion.motion import Motion
    from .observer import MomentumObserver

BEGIN = 2.0
"""Time after the begin of a log that is left out [s]."""
BLOCK = 1.0
"""Length of a block [s]."""
HOUR = 3600.0
"""Length of an hour [s]."""
_MIN_BLOCKS = 30
"""Least number of blocks for a verdict without doubt."""
_CELL_COUNT = 9
"""Number of cells: three signs of the speed by three thirds of the position."""
_MIN_INDEPENDENT_ROWS = 10.0
"""Least number of independent rows in a cell whose mean is used."""
_MIN_DEVIATIONS = 3.0
"""Ratio of a mean to its standard deviation from which the mean is not noise."""
_QUIET_SHARE = 0.9
"""Share of the blocks, those with the smallest maxima, that are taken to be without a push."""
_EULER_CONSTANT = 0.5772156649
"""γ of the Gumbel law."""
_MAX_NOISE_RATIO = 3.0
"""Largest noise of a block without a push, in multiples of the threshold from quiet blocks."""
_MAX_DETECTION_TIME = 0.3
"""Time in which a push must pass a threshold [s]."""
_MAX_POSES = 200
"""About the largest number of poses at which pushes are computed."""
_MIN_SENSITIVITY = 1e-9
"""Ratio of a direction's response to the largest one below which no joint reacts to this direction."""
_DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])  # without (0, 0, 0)
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
"""(26, 3) directions to the faces, edges and corners of a cube."""


@dataclass(frozen=True, eq=False, repr=False)
class ResidualThreshold(Answer):
    """Thresholds of a momentum observer's residual, by which a collision is detected: result of ``observer.threshold``.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.planar_2r(), np.arange(0, 60, 0.01)
    >>> q = np.stack([np.sin(t), np.cos(0.7 * t)], axis=1)
    >>> noise = np.random.default_rng(0).normal(0, 0.5, q.shape)
    >>> motion = tw.Motion(t, q, robot=arm)
    >>> log = tw.Motion(t, q, motion.dq, motion.ddq, motion.torques() + noise, robot=arm)
    >>> found = tw.control.MomentumObserver(arm, 30.0).threshold(log)
    >>> found.verdict.ok, found.torques.shape, found.facts()["smallest push"]
    (True, (2,), 'pushes in some direction change no joint torque')
    >>> list(found.to_dict()["thresholds"]["joint1"])
    ['torques', 'noise', 'model']
    """

    call: ClassVar[str] = "threshold"

    observer: MomentumObserver
    """Observer with its gain."""
    noise: Array
    """Part (nv,) due to noise: level of the residual without its mean [N m, sliding joints: N]."""
    model: Array
    """Part (nv,) due to the model: largest mean of the residual in a region of speed and position [N m, N]."""
    per_hour: float
    """False alarms in an hour, of all joints together."""
    smallest_force: float
    """Least constant force at the tip that passes a threshold within 0.3 s, in the worst of 26 directions [N].

    The median over the log's poses; inf if no joint reacts to some direction.
    """
    blocks_of_log: int
    """Number of blocks of 1 s."""
    doubts: tuple[Doubt, ...] = ()
    """Reasons against OK."""

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.observer.robot.name

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.observer.robot.model.velocity_names

    @property
    def torques(self) -> Array:
        """(nv,) thresholds of the residual's size, the sum of both parts [N m, sliding joints: N]."""
        return self.noise + self.model

    @cached_property
    def verdict(self) -> Verdict:
        """UNSURE if the log is short or something pushed on the robot, or OK."""
        return verdict_from_doubts(self.doubts)

    @property
    def brief(self) -> str:
        """Least push that passes a threshold."""
        if not np.isfinite(self.smallest_force):
            return "pushes in some direction change no joint torque"
        return quantity(self.smallest_force, "N", 2)

    def facts(self) -> dict[str, str]:
        """False alarms, least push and length of the log.

        Returns
        -------
        facts : {name: text}
        """
        return {
            "false alarms": f"{number(self.per_hour, 3)} an hour",
            "smallest push": self.brief,
            "log": f"{self.blocks_of_log} blocks of 1 s",
        }

    @property
    def texts(self) -> dict[str, list[str]]:
        """Threshold of each joint and its parts, with units."""
        is_angular = Coordinates.from_model(self.observer.robot.model).angular_velocity
        units = units_of("tau", is_angular)
        columns = {}
        for name, values in (("threshold", self.torques), ("noise", self.noise), ("model", self.model)):
            columns[name] = [quantity(x, unit, 3) for x, unit in zip(values.tolist(), units, strict=True)]
        return columns

    @property
    def sentence(self) -> str:
        """Thresholds, and the smallest push that passes one."""
        push = self.brief
        if np.isfinite(self.smallest_force):
            push = f"the smallest push at the tip that passes one is {push}"
        noun = "false alarm" if self.per_hour == 1.0 else "false alarms"
        return (
            f"thresholds for {number(self.per_hour, 3)} {noun} an hour: {listed(self.texts['threshold'], 7)}; {push}."
        )

    def blocks(self) -> Iterator[Block]:
        """Verdict, and the threshold of each joint with its parts."""
        if self.verdict.word is Word.OK:
            yield Headline(Word.OK, self.sentence)
        else:
            yield Headline.from_verdict(self.verdict)
        yield ""
        yield threshold_table(self)
        yield from remarks([str(reason) for reason in self.doubts if reason.level == "note"])

    def to_dict(self) -> dict[str, Any]:
        """Data of :meth:`Answer.to_dict`, and the thresholds with their parts in SI units.

        Returns
        -------
        data : dict
        """
        thresholds = {}
        for joint, torque, noise, model in zip(self.joints, self.torques, self.noise, self.model, strict=True):
            thresholds[joint] = {"torques": float(torque), "noise": float(noise), "model": float(model)}
        return super().to_dict() | {
            "thresholds": thresholds,
            "per_hour": self.per_hour,
            "smallest_force": self.smallest_force,
            "gain": self.observer.gain.tolist(),
        }


def threshold_table(result: ResidualThreshold) -> Table:
    """Table of the threshold of each joint with its parts."""
    columns = [words(name, cells, fold=False) for name, cells in result.texts.items()]
    return Table("Thresholds", words("joint", list(result.joints), fold=False), *columns)


def residual_threshold(observer: MomentumObserver, motion: Motion, per_hour: float) -> ResidualThreshold:
    """Thresholds from a log without contact; raises ShapeError and ValueRangeError."""
    if motion.tau is None:
        raise ShapeError("MomentumObserver.threshold: the motion has no torques. Give a log with measured torques.")
    per_hour = arguments.positive(per_hour, "per_hour")
    e = observer.over(motion.time, motion.q, motion.dq, motion.tau)
    used = motion.time >= motion.time[0] + BEGIN  # mask of rows
    time_of_use = motion.time[used] - motion.time[0] - BEGIN
    block_number = (time_of_use / BLOCK).astype(int)  # of each used row
    if not used.any() or block_number[-1] < 2:  # the last block may be short: two whole ones are needed
        raise ValueRangeError(
            f"MomentumObserver.threshold: the log has {number(motion.duration, 3)} s. Give {number(BEGIN + _MIN_BLOCKS)} s or "
            "more."
        )
    step = float(np.median(np.diff(motion.time)))
    positions = _single_positions(motion)
    mean = _cell_means(e[used], motion.dq[used], positions[used], step, observer.gain)
    first_rows = np.flatnonzero(np.diff(block_number, prepend=-1))  # row at which each block begins
    maxima = np.maximum.reduceat(np.abs(e[used] - mean), first_rows)
    if len(maxima) > _MIN_BLOCKS:
        maxima = maxima[:-1]  # the last block may be short
    share = per_hour * BLOCK / HOUR / observer.robot.nv  # share of the blocks in which one joint gives a false alarm
    noise = gumbel_level(maxima, share)
    model = np.abs(mean).max(axis=0)
    doubts = tuple(_doubts(observer, motion, maxima, share))
    force = smallest_force(observer, motion.q, noise + model)
    return ResidualThreshold(observer, noise, model, per_hour, force, len(maxima), doubts)


def gumbel_level(maxima: Array, share: float) -> Array:
    """Levels √u (k,) of the residual's size, which a share p of the blocks with these maxima (n, k) passes.

    From P(x < u) = 1 - p: u = a - b log(-log(1 - p)), with a = mean(x) - γ b.
    """
    x = maxima**2
    b = np.sqrt(6.0) / np.pi * x.std(axis=0, ddof=1)  # √6 s/π
    u = x.mean(axis=0) + b * (-np.log(-np.log1p(-share)) - _EULER_CONSTANT)
    return np.asarray(np.sqrt(u))


def _single_positions(motion: Motion) -> Array:
    """Positions (n, nv) of joints with one velocity and one coordinate; zero for the velocities of other joints."""
    positions = np.zeros(motion.dq.shape)
    for body in motion.robot.model.leaders:
        if body.joint.nv == body.joint.nq == 1:
            coordinates, velocities = body.places
            positions[:, velocities] = motion.q[:, coordinates]
    return positions


def _cell_means(e: Array, dq: Array, q: Array, step: float, gain: Array) -> Array:
    """Mean (n, nv) of the residual in the cell of each row; 0 if it is not larger than its error.

    Cells are given by the sign of the speed and the third of the position. Residuals are correlated for a time 1/K, so a cell
    of n rows at the time step h has n K h/2 independent rows.
    """
    means = np.zeros_like(e)
    for j in range(e.shape[1]):
        edges = np.quantile(q[:, j], [1.0 / 3.0, 2.0 / 3.0])  # of the thirds
        sign_number = (np.sign(dq[:, j]) + 1.0).astype(int)  # 0, 1, 2
        third = np.searchsorted(edges, q[:, j])
        cell = 3 * sign_number + third
        count = np.maximum(np.bincount(cell, minlength=_CELL_COUNT), 1)  # of rows; empty cells have zero sums
        mean = np.bincount(cell, e[:, j], minlength=_CELL_COUNT) / count
        mean_square = np.bincount(cell, e[:, j] ** 2, minlength=_CELL_COUNT) / count
        variance = mean_square - mean**2
        independent_rows = np.maximum(count * min(1.0, 0.5 * gain[j] * step), 1.0)
        deviation = np.sqrt(np.maximum(variance, 0.0) / independent_rows)  # of the mean
        is_significant = np.abs(mean) > _MIN_DEVIATIONS * deviation
        cell_means = np.where(is_significant & (independent_rows >= _MIN_INDEPENDENT_ROWS), mean, 0.0)
        means[:, j] = cell_means[cell]
    return means


def _doubts(observer: MomentumObserver, motion: Motion, maxima: Array, share: float) -> Iterator[Doubt]:
    """Doubts about too few blocks, a log that contradicts itself, and a block in which something pushed."""
    if len(maxima) < _MIN_BLOCKS:
        yield doubt("residual-short", blocks=len(maxima), least=_MIN_BLOCKS)
    yield from (contradiction for contradiction in motion.doubts if contradiction.refuses)
    quiet_count = max(2, round(_QUIET_SHARE * len(maxima)))
    quiet = np.sort(maxima, axis=0)[:quiet_count]
    quiet_level = np.maximum(gumbel_level(quiet, share), 1e-300)  # not divided by zero
    ratio = maxima / quiet_level
    block, joint = np.unravel_index(int(ratio.argmax()), ratio.shape)
    max_ratio = float(ratio[block, joint])
    if max_ratio > _MAX_NOISE_RATIO:
        block_begin = float(motion.time[0]) + BEGIN + BLOCK * int(block)  # [s]
        yield doubt(
            "residual-pushed", [observer.robot.model.velocity_names[joint]],
            when=number(block_begin, 4), times=number(max_ratio, 2), found={"value": block_begin, "unit": "s"},
        )  # fmt: skip


def smallest_force(observer: MomentumObserver, q: Array, threshold: Array) -> float:
    """Least constant force at the tip that passes a threshold within 0.3 s [N].

    It is the force in the worst direction, and the median of the poses. A force of 1 N in a direction d changes the residual
    to (1 - exp(-K t)) J' d after the time t.
    """
    poses = q[:: max(1, len(q) // _MAX_POSES)]
    J = np.asarray(observer.robot.jacobian(poses))
    J_v = J[:, 3:]  # linear rows (n, 3, nv)
    torques = np.einsum("di,kij->kdj", _DIRECTIONS, J_v)  # by 1 N in each direction
    reached_share = -np.expm1(-observer.gain * _MAX_DETECTION_TIME)  # 1 - exp(-K t)
    residuals = torques * reached_share
    shares = (np.abs(residuals) / threshold).max(axis=2)  # of the joint nearest to its threshold
    min_shares = shares.min(axis=1)  # in the worst direction
    is_sensitive = min_shares > _MIN_SENSITIVITY * shares.max()
    divisors = np.maximum(min_shares, 1e-300)  # not zero
    forces = np.where(is_sensitive, 1.0 / divisors, np.inf)
    return float(np.median(forces))


complete(globals())
