"""Settings of a fit, and the normal equations of all blocks of time under settings that change one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..core.printed_numbers import number
from ..typing import Array
from .filtered_rows import FilteredRows
from .normal_equations import NormalEquations, Prior

if TYPE_CHECKING:
    from .setting_choice import SettingRows

FOLDS = 5
"""Blocks of time that are left out in turn."""


@dataclass(frozen=True, eq=False)
class FitSettings:
    """What a fit is made with.

    Attributes
    ----------
    cutoff : float [Hz]
    friction_speed : (nv,) array, v_0 [rad/s or m/s]
    shift : float, by how much torques are later in the log than the positions they belong to [s]
    """

    cutoff: float
    friction_speed: Array
    shift: float

    def __str__(self) -> str:
        speeds = ", ".join(map(number, self.friction_speed))
        side = "before" if self.shift < 0 else "after"
        return (
            f"cut-off {number(self.cutoff)} Hz; torques {number(abs(self.shift) * 1e3)} ms {side} positions; friction turns "
            f"at {speeds} rad/s or m/s"
        )


@dataclass(frozen=True)
class Asked:
    """What the user fixes; None: chosen."""

    cutoff: float | None = None
    friction_speed: float | None = None
    shift: float | None = None


class Trial:
    """Normal equations of all blocks under settings that change one at a time."""

    def __init__(self, source: SettingRows, settings: FitSettings) -> None:
        self.settings, self._asked = settings, source.asked
        self._source, self.felt = source, source.base.felt
        self.coulomb = source.base.unknown.coulomb_columns(source.base.kept)
        self._blocks = list(source.kept_blocks(settings, self._made))

    @cached_property
    def _rows(self) -> FilteredRows:
        return self._source.rows(self.settings.cutoff)

    @cached_property
    def _places(self) -> list[Array | slice]:
        fold = self._source.folds(self._rows.log, self._rows.time)
        return [_as_slice(np.flatnonzero(fold == b)) for b in range(FOLDS)]

    @cached_property
    def _tau(self) -> Array:
        return self._rows.torques(self.settings.shift)

    @cached_property
    def _W(self) -> Array:
        rows, settings = self._rows, self.settings
        if np.array_equal(settings.friction_speed, self._source.usual_speed):
            return rows.W
        W = rows.W.copy()
        for c, joints in self.coulomb:
            W[:, :, c] = rows.coulomb(c, joints, settings.friction_speed)
        return W

    def _made(self) -> list[NormalEquations]:
        return [NormalEquations.of(self._W[p], self._tau[p], self.felt) for p in self._places]

    @property
    def W(self) -> Array:
        """(m, nv, r)."""
        return self._W

    @property
    def tau(self) -> Array:
        """(m, nv)."""
        return self._tau

    def changes(self, x: Array) -> Array:
        """(m, nv, k) what the predicted torques change by with each chosen setting: the clock's offset, speeds of friction."""
        found = []
        settings = self.settings
        if self._asked.shift is None:
            step = 0.1 / settings.cutoff
            later, sooner = self._rows.torques(settings.shift + step), self._rows.torques(settings.shift - step)
            found.append((later - sooner) / (2 * step))
        if self._asked.friction_speed is None:
            for j in range(self._W.shape[1]):
                speed = np.where(np.arange(self._W.shape[1]) == j, 1.1, 1.0) * settings.friction_speed
                mine = [(c, joints) for c, joints in self.coulomb if np.flatnonzero(joints)[-1] == j]
                change = np.zeros(self._tau.shape)
                for c, joints in mine:
                    change += (self._rows.coulomb(c, joints, speed) - self._W[:, :, c]) * x[c]
                found.append(change)
        return np.stack(found, axis=-1) if found else np.zeros((*self._tau.shape, 0))

    def fits(self, prior: Prior, blocks: Sequence[int]) -> list[tuple[int, Array]]:
        """Each block, and what the others of ``blocks`` give."""
        total = self._blocks[blocks[0]]
        for b in blocks[1:]:
            total = total + self._blocks[b]
        x, sigma = total.solve(prior)
        found = []
        for b in blocks:
            rest = total - self._blocks[b] if len(blocks) > 1 else total
            weight = 1.0 / sigma**2
            x = prior.solve(np.einsum("jkl,j->kl", rest.N, weight), (rest.c * weight[:, None]).sum(axis=0))
            found.append((b, x))
        return found

    def score(self, prior: Prior, blocks: Sequence[int]) -> float:
        """The sum of log |residual|² over the joints, of blocks predicted from the others."""
        left = sum((self._blocks[b].squares(x) for b, x in self.fits(prior, blocks)), np.zeros(len(self.felt)))
        return float(np.log(np.maximum(left, 1e-300)).sum())

    def shift(self, shift: float) -> None:
        """Take torques from another time."""
        _ = self._W  # of the settings before
        self._tau = self._rows.torques(shift)
        self.settings = replace(self.settings, shift=shift)
        for k, p in enumerate(self._places):
            W, tau = self._W[p], self._tau[p]
            c = np.stack([W[:, j].T @ tau[:, j] for j in range(W.shape[1])])
            self._blocks[k] = replace(self._blocks[k], c=c, y=(self._tau[p] ** 2).sum(axis=0))

    def speed(self, friction_speed: Array) -> None:
        """Take other speeds of friction."""
        changed, _, _ = friction_speed != self.settings.friction_speed, self._W, self._tau
        self.settings = replace(self.settings, friction_speed=friction_speed)
        if self._W is self._rows.W:
            self._W = self._W.copy()
        for c, joints in self.coulomb:
            if not changed[int(np.flatnonzero(joints)[-1])]:
                continue
            self._W[:, :, c] = self._rows.coulomb(c, joints, friction_speed)
            for k, p in enumerate(self._places):
                N, right = self._blocks[k].N.copy(), self._blocks[k].c.copy()
                W, tau = self._W[p], self._tau[p]
                for j in np.flatnonzero(joints):
                    N[j, :, c] = N[j, c, :] = W[:, j].T @ W[:, j, c]
                    right[j, c] = W[:, j, c] @ tau[:, j]
                self._blocks[k] = replace(self._blocks[k], N=N, c=right)


def _as_slice(places: Array) -> Array | slice:
    """Rows that follow each other as a slice, which copies nothing."""
    if len(places) and places[-1] - places[0] == len(places) - 1:
        return slice(int(places[0]), int(places[-1]) + 1)
    return places
