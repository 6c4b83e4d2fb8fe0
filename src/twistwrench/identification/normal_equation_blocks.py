"""Normal equations of logs in blocks: sums of products of regressor rows, which can be added and saved in a small file.

With A_j = (W_j, τ_j) and weights w, a block holds the lower triangles of Σ A_j' A_j and Σ A_j' w A_j, packed in a row.
A cell of state holds the second sum. All rows together have R_j with R_j' R_j = Σ A_j' w A_j by orthogonal
transformations (TSQR: Demmel,
Grigori, Hoemmen and Langou, "Communication-optimal parallel and sequential QR and LU factorizations", SIAM J. Sci. Comput. 34,
2012), which do not square the condition number.
"""

from __future__ import annotations

import json
import operator
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

from ..core.doubts import Doubt
from ..core.errors import NotFoundError, ShapeError, TrajectoryError, ValueRangeError
from ..core.estimation.covariance import GroupCovariance, StateCells, larger_covariance, sandwich_covariance
from ..core.estimation.cross_validation import FOLDS, HeldOut, HeldOutRows
from ..core.estimation.least_squares import Method, NormalEquations, Prior, huber_weights, sum_of
from ..core.files import as_path, replacing
from ..core.glossary import complete
from ..core.numbers import number
from ..core.third_party import third_party_errors
from ..core.typing import Array
from ..core.version import __version__
from ..motion.readers.array_files import check_archive
from ..robot import Robot
from .chunks import FASTER, RowFrame
from .fit_doubts import left_unexplained
from .hyperparameters import FitSettings
from .parameters import STRIBECK_SPEED, BaseParameters, UnknownParameters, uncoupled
from .payload import MotorSide
from .result import IdentifiedRobot

MOST_BLOCKS = 60
"""Maximum number of blocks of time; beyond, the two neighbours with the fewest rows are merged."""


@dataclass(frozen=True, eq=False)
class JointBlocks:
    """Sums over a set of rows."""

    sums: Array  # (b, 2, f), plain and weighted sums of each block, packed like :class:`NormalEquations`
    counts: Array  # (b, 3) number of rows; sum of weights, and rows of full weight, of all live joints
    cells: Array  # (c, f), weighted sums of each cell of state
    factors: tuple[Array, ...]  # R_j (r_j + 1, r_j + 1)

    @classmethod
    def none(cls, frame: RowFrame, blocks: int) -> JointBlocks:
        """Blocks without rows."""
        widths = (frame.active.sum(axis=1) + 1).tolist()
        size = sum(w * (w + 1) // 2 for w in widths)
        factors = tuple(np.zeros((w, w)) for w in widths)
        return cls(np.zeros((blocks, 2, size)), np.zeros((blocks, 3)), np.zeros((frame.cells.count, size)), factors)

    def added(self, frame: RowFrame, entries: Sequence[Array], block: Array, cell: Array) -> JointBlocks:
        """Add the rows of one batch, each in its ``block`` and its ``cell`` (n,); sums and counts are changed in place."""
        factors, begin = [], 0
        for j, A in enumerate(entries):
            weights = _weights(frame, j, A)
            root = np.sqrt(weights)[:, None]
            corner = np.tril_indices(A.shape[1])
            place = slice(begin, begin + len(corner[0]))
            begin = place.stop
            for b in np.unique(block).tolist():
                mine = A[block == b]
                heavy = mine * root[block == b]
                self.sums[b, 0, place] += (mine.T @ mine)[corner]
                self.sums[b, 1, place] += (heavy.T @ heavy)[corner]
                if not frame.dead[j]:
                    self.counts[b, 1:] += weights[block == b].sum(), (weights[block == b] == 1.0).sum()
            weighted = A * root
            for c in np.unique(cell).tolist():
                mine = weighted[cell == c]
                self.cells[c, place] += (mine.T @ mine)[corner]
            factors.append(_factor(self.factors[j], weighted))
        self.counts[:, 0] += np.bincount(block, minlength=len(self.counts))
        return JointBlocks(self.sums, self.counts, self.cells, tuple(factors))

    def __add__(self, other: JointBlocks) -> JointBlocks:
        """Concatenate blocks, and merge them to at most :data:`MOST_BLOCKS`."""
        sums, counts = np.concatenate([self.sums, other.sums]), np.concatenate([self.counts, other.counts])
        some = counts[:, 0] > 0
        sums, counts = sums[some], counts[some]
        while len(counts) > MOST_BLOCKS:
            k = int(np.argmin(counts[:-1, 0] + counts[1:, 0]))
            sums[k] += sums[k + 1]
            counts[k] += counts[k + 1]
            sums, counts = np.delete(sums, k + 1, axis=0), np.delete(counts, k + 1, axis=0)
        pairs = zip(self.factors, other.factors, strict=True)
        return JointBlocks(sums, counts, self.cells + other.cells, tuple(_factor(a, b) for a, b in pairs))

    def equations(self, frame: RowFrame, which: int, blocks: slice | Sequence[int] | Array) -> NormalEquations:
        """Normal equations of several blocks together, plain (0) or weighted (1)."""
        rows = float(self.counts[blocks, 0].sum())
        return NormalEquations.unpacked(self.sums[blocks, which].sum(axis=0), frame.active, rows)


def _weights(frame: RowFrame, j: int, A: Array) -> Array:
    """Huber's weights, from the residuals of the groups of an excerpt."""
    if not frame.robust or frame.dead[j]:
        return np.ones(len(A))
    groups = frame.columns.groups[j]
    return huber_weights(np.abs(A[:, -1] - A[:, : len(groups)] @ frame.x[groups]) / frame.sigma[j])


def _factor(above: Array, below: Array) -> Array:
    """Triangular factor R of both matrices stacked."""
    return np.asarray(np.linalg.qr(np.concatenate([above, below]), mode="r"))


# ── Normal equations of one or several logs


@dataclass(frozen=True, eq=False, repr=False)
class NormalEquationBlocks:
    """Normal equations of logs: sums over all rows, which can be added, saved and continued later.

    Attributes
    ----------
    robot : Robot, with the values of its file
    frame : RowFrame, groups and settings of all rows
    moments : JointBlocks
    weak : Prior, weak prior of groups without information
    sizes : (p,) array, largest plausible sizes of the unknown parameters
    changes : (k, r) array, changes of the groups by laws that explain part of an excerpt's residual
    method : str, ``irls``, ``wls`` or ``ols``
    seconds : float, duration of the logs [s]
    samples : int, number of samples of the logs
    autocorrelation_length : float, autocorrelation length of the residuals in rows
    logs : tuple of str, names of the logs
    doubts : tuple of Doubt, from the excerpts on which settings were chosen
    shown : HeldOutRows, optional, measured and predicted rows of an excerpt, for plots
    payload_frame : str or None, frame of the payload that alone is identified
    notes : tuple of str, a sentence for each kind of omitted rows and for the gaps of each log

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.pendulum(), np.arange(0, 20, 0.01)
    >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
    >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
    >>> information = tw.identification.accumulate(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
    >>> information.check() < 1e-6, information.identified().base.count
    (True, 3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = tw.identification.NormalEquationBlocks.load(information.save(f"{folder}/week.npz"), arm)
    >>> bool((again.values == information.values).all())
    True
    """

    robot: Robot
    frame: RowFrame
    moments: JointBlocks
    weak: Prior
    sizes: Array
    changes: Array
    method: Method
    seconds: float
    samples: int
    autocorrelation_length: float
    logs: tuple[str, ...]
    doubts: tuple[Doubt, ...] = ()
    shown: HeldOutRows | None = None
    payload_frame: str | None = None
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return (
            f"<NormalEquationBlocks of {self.robot.name!r}: {self.frame.base.count} groups, {self.samples} samples, "
            f"{len(self.logs)} logs, {number(self.seconds / 3600)} h>"
        )

    def __add__(self, other: NormalEquationBlocks) -> NormalEquationBlocks:
        """Sum of both; raises ValueRangeError if their groups or settings differ."""
        if not isinstance(other, NormalEquationBlocks):
            return NotImplemented
        mine, their = self.frame, other.frame
        for what, a, b in (
            ("groups", mine.base.names, their.base.names),
            ("known values", dict(mine.base.unknown.known), dict(their.base.unknown.known)),
            ("payloads", self.payload_frame, other.payload_frame),
            ("cut-offs [Hz]", mine.settings.cutoff, their.settings.cutoff),
            ("offsets of the clock [s]", mine.settings.shift, their.settings.shift),
            ("friction speeds", mine.settings.friction_speed.tolist(), their.settings.friction_speed.tolist()),
            ("weights", (self.method, *mine.sigma, *mine.x), (other.method, *their.sigma, *their.x)),
            ("chosen settings", (mine.free_shift, mine.free_speed), (their.free_shift, their.free_speed)),
        ):
            if a != b:
                raise ValueRangeError(
                    f"these do not add up: their {what} differ. Gather the new logs like the old ones, like=…, or --add FILE."
                )
        new = tuple(d for d in other.doubts if (d.kind, d.joints) not in {(x.kind, x.joints) for x in self.doubts})
        return replace(
            self,
            moments=self.moments + other.moments,
            seconds=self.seconds + other.seconds,
            samples=self.samples + other.samples,
            logs=(*self.logs, *other.logs),
            doubts=(*self.doubts, *new),
            notes=(*self.notes, *other.notes),
        )

    @property
    def values(self) -> Array:
        """(r,) values of the groups."""
        return block_solution(self)[0][: self.frame.base.count]

    def identified(self, test: NormalEquationBlocks | None = None) -> IdentifiedRobot:
        """Identify the robot from all rows together.

        Parameters
        ----------
        test : NormalEquationBlocks, optional, of test logs, accumulated with the same settings

        Returns
        -------
        found : IdentifiedRobot

        Raises
        ------
        TrajectoryError
            The logs are too short for cross-validation.
        """
        base, (x, sigma) = self.frame.base, block_solution(self)
        among = held_out = _five_fold(self)
        if test is not None:
            _ = self + test  # raises if they differ
            held_out = block_residuals(test, x)
        if self.shown is not None:
            held_out = replace(held_out, rows=(self.shown,))
        folds = tuple(_of_groups(self.moments.equations(self.frame, 1, b), base.count, x, sigma) for b in _folds(self))
        return IdentifiedRobot(
            original=uncoupled(self.robot),
            base=base,
            values=x[: base.count],
            covariance=_block_covariance(self, x, sigma),
            sigma=sigma,
            settings=_corrected_settings(self.frame, x),
            held_out=held_out,
            trained=among,
            doubts=_doubts(self, held_out, among, x),
            prior=self.weak,
            method=self.method,
            sizes=self.sizes,
            information=sum_of([fold.together() for fold in folds]),
            folds=folds,
            payload_frame=self.payload_frame,
            notes=self.notes,
        )

    def check(self) -> float:
        """Largest deviation of a group from the solution by orthogonal factors (TSQR), in standard deviations.

        Returns
        -------
        difference : float
        """
        (x, sigma), r = block_solution(self), self.frame.base.count
        deviations = _block_covariance(self, x, sigma).deviations
        off = np.abs(_by_factors(self, np.ones_like(sigma) if self.method == "ols" else sigma) - x)[:r]
        return float((off / np.maximum(deviations, 1e-300)).max(initial=0.0))

    def save(self, path: str | Path) -> Path:
        """Save atomically as a small file.

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        with replacing(target := as_path(path)) as scratch, scratch.open("wb") as file:
            np.savez(file, **_arrays(self))
        return target

    @classmethod
    def load(cls, path: str | Path, robot: Robot) -> NormalEquationBlocks:
        """Load blocks from a file of :meth:`save`.

        Parameters
        ----------
        robot : Robot, same robot as in the file

        Returns
        -------
        information : NormalEquationBlocks

        Raises
        ------
        NotFoundError, ShapeError
            The file does not exist, or cannot be read.
        """
        path = as_path(path)
        if not path.is_file():
            raise NotFoundError(f"no information {str(path)!r}. Give a file that --information wrote.")
        advice = "Give a file that --information wrote, whole."
        with third_party_errors(
            lambda reason: ShapeError(f"{path}: no information that can be read: {reason}. {advice}")
        ):
            check_archive(path)
            with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
            said = json.loads(str(arrays["said"]))
            if said["format"] != _MARK:
                raise ValueError(f"its format is {said['format']!r}")
            return _from_file(path, robot, said, arrays)  # its entries are those of the file, too


# ── Fit of all rows: groups, covariance, cross-validation over fifths of the time

_SPEED_SIZE = 3.0  # largest correction of a friction speed, in units of its step
_OFF = 0.5  # share of a step within which corrections of the settings are linear


def _prior(i: NormalEquationBlocks) -> Prior:
    """Weak prior of the groups and of the corrections of the settings."""
    shift = [0.1 / i.frame.settings.cutoff] if i.frame.free_shift else []
    size = np.array([*shift, *(_SPEED_SIZE for _ in i.frame.speeds)])
    return Prior(np.concatenate([i.weak.mean, np.zeros(len(size))]), np.concatenate([i.weak.size, size]))


def block_solution(i: NormalEquationBlocks, blocks: slice | Array = slice(None)) -> tuple[Array, Array]:
    """Least-squares solution of some blocks of time: groups, then corrections of settings; sizes of residuals (nv,)."""
    found, prior = i.moments.equations(i.frame, 1, blocks), _prior(i)
    if i.method == "wls":
        return found.solve(prior)
    if i.method == "ols":
        x = prior.solve(found.N.sum(axis=0), found.c.sum(axis=0))
        return x, np.sqrt(found.squares(x) / max(1.0, found.rows))
    return prior.solve(*found.whitened(i.frame.sigma)), i.frame.sigma


def block_residuals(
    i: NormalEquationBlocks, x: Array, blocks: slice | Array = slice(None), kind: str = "test"
) -> HeldOut:
    """Residuals of some blocks of time for given unknowns."""
    plain = i.moments.equations(i.frame, 0, blocks)
    return HeldOut(kind, plain.squares(x), plain.y, i.frame.base.unknown.model.velocity_names)


def _folds(i: NormalEquationBlocks) -> list[Array]:
    """Indices of the blocks in each fifth of the rows."""
    rows = i.moments.counts[:, 0]
    middle = (np.cumsum(rows) - 0.5 * rows) / max(rows.sum(), 1.0)
    label = np.minimum((FOLDS * middle).astype(int), FOLDS - 1)
    return [found for b in range(FOLDS) if (found := np.flatnonzero(label == b)).size]


def _five_fold(i: NormalEquationBlocks) -> HeldOut:
    """Predict each fifth of the rows from the others."""
    folds = _folds(i)
    if len(folds) < 2:
        raise TrajectoryError("the logs are too short to hold a part of them out. Give more seconds.")
    others = (np.setdiff1d(np.concatenate(folds), mine) for mine in folds)
    parts = zip(folds, others, strict=True)
    return reduce(operator.add, (block_residuals(i, block_solution(i, rest)[0], b, "five-fold") for b, rest in parts))


def _block_covariance(i: NormalEquationBlocks, x: Array, sigma: Array) -> GroupCovariance:
    """Sandwich covariance over blocks and over cells of state, like :func:`group_covariance` for rows."""
    r, prior, counts = i.frame.base.count, _prior(i), i.moments.counts
    total, _ = i.moments.equations(i.frame, 1, slice(None)).whitened(sigma)
    scaled = total * prior.size[:, None] * prior.size
    values, U = np.linalg.eigh(scaled + np.eye(len(x)))
    half = prior.size[:, None] * (U / np.sqrt(values))
    left = i.moments.equations(i.frame, 1, slice(None)).squares(x) / sigma**2
    freedom = max(1.0, float(counts[:, 0].sum()) * len(sigma) - len(x))
    own = np.einsum("ij,ij->i", half, half)
    textbook = np.sqrt(own * float(left.sum()) / freedom)[:r]

    def sandwich(clusters: Array) -> tuple[Array, Array] | None:
        parts = [NormalEquations.unpacked(one, i.frame.active, 0.0).whitened(sigma) for one in clusters]
        N, scores = np.stack([n for n, _ in parts]), np.stack([c - n @ x for n, c in parts])
        return sandwich_covariance(half.T @ N @ half, scores @ half, half)

    found = sandwich(i.moments.sums[:, 1])
    if found is None:
        inflated = half @ half.T * i.autocorrelation_length
        return GroupCovariance(inflated[:r, :r], np.full(r, 1e9), textbook, 0.0)
    matrix, degrees = larger_covariance(found, sandwich(i.moments.cells))
    _, weight, whole = counts.sum(axis=0)
    huber = (weight / whole) ** 2 if i.frame.robust and whole else 1.0
    block = i.seconds / max(1, len(counts))
    return GroupCovariance(matrix[:r, :r] * huber, degrees[:r], textbook, block, i.frame.cells).widened(i.changes)


def _corrected_settings(frame: RowFrame, x: Array) -> FitSettings:
    """Settings of the excerpt with the corrections fitted to all rows."""
    speed, shift = frame.settings.friction_speed.copy(), frame.settings.shift
    if frame.free_shift:
        shift -= float(x[frame.base.count])
    for owner, off in zip(frame.speeds, x[frame.first_speed :].tolist(), strict=True):
        speed[owner] *= max(1.0 + FASTER * off, 0.1)
    return replace(frame.settings, shift=shift, friction_speed=speed)


def _of_groups(one: NormalEquations, r: int, x: Array, sigma: Array) -> NormalEquations:
    """Whitened normal equations of the groups, with the corrections of settings subtracted from the torques."""
    off = x[r:]
    N, c, y = one.N / sigma[:, None, None] ** 2, one.c / sigma[:, None] ** 2, one.y / sigma**2
    rest = y - 2.0 * c[:, r:] @ off + np.einsum("jkl,k,l->j", N[:, r:, r:], off, off)
    return NormalEquations(N[:, :r, :r], c[:, :r] - N[:, :r, r:] @ off, rest, one.rows)


def _by_factors(i: NormalEquationBlocks, sigma: Array) -> Array:
    """Solve for the unknowns by triangular factors instead of normal equations, to avoid their loss of digits."""
    prior = _prior(i)
    rows, right = [np.diag(1.0 / prior.size)], [prior.mean / prior.size]
    for active, R, size in zip(i.frame.active, i.moments.factors, sigma, strict=True):
        row = np.zeros((len(R), len(active)))
        row[:, active] = R[:, :-1] / size
        rows.append(row)
        right.append(R[:, -1] / size)
    A, b = np.concatenate(rows) * prior.size, np.concatenate(right)
    return np.asarray(scipy.linalg.lstsq(A, b)[0] * prior.size)


def _doubts(i: NormalEquationBlocks, held: HeldOut, among: HeldOut, x: Array) -> tuple[Doubt, ...]:
    """Doubts from the excerpts and from all rows."""
    kinds = {d.kind for d in i.doubts}
    found = [*i.doubts, *(doubt for doubt in left_unexplained(held, among) if doubt.kind not in kinds)]
    if far := _settings_off(i.frame, x):
        found.append(
            Doubt(
                "other-settings",
                f"all rows require another {far} than the excerpt did, so the log is not homogeneous. Set it, or identify "
                "parts of the logs apart.",
            )
        )
    return tuple(sorted(found, key=lambda doubt: not doubt.refuses))


def _settings_off(frame: RowFrame, x: Array) -> str:
    """Sentence on settings whose correction exceeds the valid range of the linearisation."""
    if frame.free_shift and abs(x[frame.base.count]) > _OFF * 0.1 / frame.settings.cutoff:
        return "offset of the clock"
    names, steps = frame.base.unknown.model.velocity_names, np.abs(x[frame.first_speed :])
    owners = [names[owner] for owner, off in zip(frame.speeds, steps, strict=True) if off > _OFF * 10]
    return f"friction speed of {', '.join(owners)}" if owners else ""


# ── File format: arrays and their description in an archive of NumPy

_MARK = "twistwrench information 2"
_SHOWN = ("time", "log", "measured", "predicted")
_PLAIN = ("method", "seconds", "samples", "autocorrelation_length")


def _arrays(i: NormalEquationBlocks) -> dict[str, Any]:
    frame, unknown, shown = i.frame, i.frame.base.unknown, i.shown
    said = {
        "format": _MARK,
        "version": __version__,
        "robot": i.robot.name,
        "groups": list(frame.base.names),
        "motor_inertia": unknown.motor_inertia,
        "friction": list(unknown.friction),
        "known": dict(unknown.known),
        "stribeck_speed": unknown.stribeck_speed,
        "payload": i.payload_frame,
        "cutoff": frame.settings.cutoff,
        "shift": frame.settings.shift,
        "chosen": [frame.free_shift, frame.free_speed],
        "position": frame.cells.position,
        "velocities": frame.cells.velocities,
        "robust": frame.robust,
        **{name: getattr(i, name) for name in _PLAIN},
        "motors": [] if unknown.motor_side is None else list(unknown.motor_side.names),
        "logs": list(i.logs),
        "doubts": [asdict(d) for d in i.doubts],
        "notes": list(i.notes),
    }
    side = unknown.motor_side
    return {
        "said": np.array(json.dumps(said)),
        "friction_speed": frame.settings.friction_speed,
        "x": frame.x,
        "sigma": frame.sigma,
        "dead": frame.dead,
        "mean": i.weak.mean,
        "size": i.weak.size,
        "sizes": i.sizes,
        "sums": i.moments.sums,
        "counts": i.moments.counts,
        "cells": i.moments.cells,
        "edges": frame.cells.edges,
        "changes": i.changes,
        **{f"factor{j}": R for j, R in enumerate(i.moments.factors)},
        **({} if side is None else {"ratios": side.ratios, "zero": side.zero, "gain": side.gain}),
        **({} if side is None or side.rates is None else {"rates": side.rates}),
        **({} if shown is None else {f"shown_{k}": getattr(shown, k) for k in _SHOWN}),
    }


def _from_file(path: Path, robot: Robot, said: dict[str, Any], arrays: dict[str, Array]) -> NormalEquationBlocks:
    """Blocks from the content of a file; raises ValueRangeError if the robot has other groups than the file."""
    side = None
    if "ratios" in arrays and not robot.model.couplings:
        side = MotorSide(
            arrays["ratios"], arrays["zero"], arrays["gain"], tuple(said.get("motors", ())), arrays.get("rates")
        )
    speed = said.get("stribeck_speed", STRIBECK_SPEED)
    base = BaseParameters.from_unknowns(
        UnknownParameters(robot, said["motor_inertia"], tuple(said["friction"]), side, said["known"], speed)
    )
    if list(base.names) != said["groups"]:
        raise ValueRangeError(
            f"{path}: is of {said['robot']!r} with {len(said['groups'])} groups of parameters, and {robot.name!r} has "
            f"others ({base.count}). Give the robot file that it was made with."
        )
    settings = FitSettings(said["cutoff"], arrays["friction_speed"], said["shift"])
    free_shift, free_speed = said["chosen"]
    cells = StateCells(said["position"], arrays["edges"], tuple(said["velocities"]))
    frame = RowFrame(
        base, settings, arrays["x"], arrays["sigma"], arrays["dead"], free_shift, free_speed, said["robust"], cells
    )
    factors = tuple(arrays[f"factor{j}"] for j in range(len(frame.active)))
    return NormalEquationBlocks(
        robot,
        frame,
        JointBlocks(arrays["sums"], arrays["counts"], arrays["cells"], factors),
        Prior(arrays["mean"], arrays["size"]),
        arrays["sizes"],
        arrays["changes"],
        **{name: said[name] for name in _PLAIN},
        logs=tuple(said["logs"]),
        doubts=tuple(Doubt.from_saved(d) for d in said["doubts"]),
        payload_frame=said["payload"],
        notes=tuple(said.get("notes", ())),
        shown=HeldOutRows(*(arrays[f"shown_{k}"] for k in _SHOWN)) if "shown_time" in arrays else None,
    )


complete(globals())
