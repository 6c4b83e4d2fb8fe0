"""Balance of contact forces with a load: forces in their cones, margins, and motions that prove that none balance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import ShapeError
from ..core.numbers import TOLERANCE, margin
from ..core.typing import Array
from .cone_programme import ConeOptimum, Cones, ForceBounds, Sense, cone_programme, least_norm_in_cones, two_sided
from .contacts import Contact, cones_of

_LEFT_OVER = 1e-6
"""Load that forces leave over, relative to the load, above which a row is undecided."""
_UNLIMITED_FRICTION = 10.0
"""Coefficient of friction that counts as unlimited."""
_HALVINGS = 14
"""Halvings of the interval of the least coefficient of friction."""
_REST_SPEED_SHARE = 1e-6
"""Velocity of a contact relative to the fastest below which it does not move."""


@dataclass(frozen=True, eq=False)
class BalanceSolution:
    """Forces, margins and proofs of n rows, as in :class:`~twistwrench.statics.support.Support`."""

    holds: Array
    decided: Array
    how: Array
    forces: Array
    speed: Array
    slowest: Array
    payload: Array
    friction: Array
    motion: Array
    power: Array
    least_norm: Array


class Balance:
    """Balance Σ G_i f_i = b of each row in the cones; rotational rows are divided by the contacts' lever, so all are in N."""

    def __init__(
        self,
        contacts: tuple[Contact, ...],
        maps: Array,
        b: Array,
        rest_load: Array | None,
        heavier: Array | None,
        turning: Array,
        in_contact: ArrayLike | None,
    ) -> None:
        n, _, c, _ = maps.shape
        self.contacts = contacts
        self.cones, self.bounds = cones_of(contacts, n)
        self.active = np.ones((n, c), bool) if in_contact is None else _contact_mask(in_contact, n, c)
        lever = float(np.abs(maps[:, turning]).max(initial=0.0)) or 1.0
        self.units = np.where(turning, lever, 1.0)
        self.maps = maps / self.units[:, None, None]
        pull = np.array([contact.pull for contact in contacts])
        self.preload = -pull[:, None] * self.cones.normals * self.active[..., None]
        preload = np.einsum("nmck,nck->nm", self.maps, self.preload)
        self.load = b / self.units
        self.b = self.load - preload
        self.rest_b = None if rest_load is None else rest_load / self.units - preload
        self.heavier = None if heavier is None else heavier / self.units

    def solve(self) -> BalanceSolution:
        """Forces, margins and proofs of all rows."""
        first = self._programme(self.b)
        balanced = ~np.isnan(first.s)
        residual = np.abs(np.einsum("nmck,nck->nm", self.maps, first.forces) - self.b).max(axis=1, initial=0.0)
        size = np.abs(self.b).max(axis=1, initial=0.0)
        motion, power, how = self._motions(first.prices)
        decided = first.settled & np.where(balanced, residual <= _LEFT_OVER * size + 1e-12, power > 0)
        holds = balanced & decided
        forces = np.full(first.forces.shape, np.nan)
        least_norm = np.zeros(len(forces), bool)
        forces[holds], least_norm[holds] = self._least_norm(first.forces, holds)
        failed, friction = decided & ~holds, self._friction()
        self._tip(np.flatnonzero(failed & (how == "slips") & np.isinf(friction)), motion, power, how)
        how = np.where(decided, np.where(holds, "holds", how), "undecided")
        speed, slowest = self._speeds(holds)
        return BalanceSolution(
            holds, decided, how, forces, speed, slowest, self._payloads(holds), friction,
            np.where(failed[:, None], motion, np.nan), np.where(failed, power, np.nan), least_norm,
        )  # fmt: skip

    def _tip(self, rows: Array, motion: Array, power: Array, how: Array) -> None:
        """Replace motions that slide, of rows that no friction holds, by those that no friction resists."""
        if not len(rows):
            return
        share = self._shares()
        cones = replace(self.cones, friction=_UNLIMITED_FRICTION * share)
        optimum = self._programme(self.b[rows], rows=rows, cones=cones)
        tip_motion, tip_power, tip_how = self._motions(optimum.prices, rows, slippery=share == 0)
        tips = np.isnan(optimum.s) & optimum.settled & (tip_power > 0)
        motion[rows[tips]], power[rows[tips]], how[rows[tips]] = tip_motion[tips], tip_power[tips], tip_how[tips]

    def forces(self) -> tuple[Array, Array, Array]:
        """Forces (n, c, 3), NaN where none balance, masks of those of least norm and of rows with forces."""
        first = self._programme(self.b)
        holds = ~np.isnan(first.s) & first.settled
        forces, least_norm = np.full(first.forces.shape, np.nan), np.zeros(len(holds), bool)
        forces[holds], least_norm[holds] = self._least_norm(first.forces, holds)
        return forces, least_norm, holds

    def _programme(
        self,
        b: Array,
        d: Array | None = None,
        rows: Any = slice(None),
        sense: Sense = "most",
        cones: Cones | None = None,
    ) -> ConeOptimum:
        maps, active, bounds = self.maps[rows], self.active[rows], self.bounds.of(rows)
        return cone_programme(cones or self.cones, maps, b, d, bounds=bounds, active=active, sense=sense)

    def _least_norm(self, basic: Array, rows: Array) -> tuple[Array, Array]:
        """Forces of least norm beyond the preload, basic ones where these are not found, and a mask of the former."""
        maps, active, bounds = self.maps[rows], self.active[rows], self.bounds.of(rows)
        forces, solved = least_norm_in_cones(self.cones, maps, self.b[rows], active, bounds)
        return np.where(solved[:, None, None], forces, basic[rows]) + self.preload[rows], solved

    def forces_within(
        self, forces: Array, least_norm: Array, maps: Array, tau: Array, limits: Array
    ) -> tuple[Array, Array]:
        """Forces that keep τ - Σ J_i' f_i within limits, or their largest share least, and a mask of those of least norm.

        ``forces`` (n, c, 3) and ``least_norm`` (n,) are those without limits, NaN where none balance.
        """
        forces, least_norm = forces.copy(), least_norm.copy()
        rows = np.flatnonzero(exceeding(tau - np.einsum("nvck,nck->nv", maps, forces), limits))
        if not len(rows):
            return forces, least_norm
        active, limited = self.active[rows], LimitedBalance(self, maps, tau, limits, rows)
        least = cone_programme(
            self.cones, self.maps[rows], self.b[rows], bounds=limited.growing, active=active, sense="least"
        )
        within = limited.within(np.maximum(least.s * (1.0 + TOLERANCE), 1.0))
        small, least_norm[rows] = least_norm_in_cones(self.cones, self.maps[rows], self.b[rows], active, within)
        forces[rows] = np.where(least_norm[rows, None, None], small, least.forces) + self.preload[rows]
        return forces, least_norm

    def friction_within(self, friction: Array, maps: Array, tau: Array, limits: Array, maximum: float) -> Array:
        """Least coefficients (n,) from ``friction`` to ``maximum`` for which forces keep the torques within limits.

        Rows whose torques are within them at ``friction``, or above them even with ``maximum``, keep ``friction``.
        """
        needed, share = friction.copy(), self._shares()
        finite = np.flatnonzero(np.isfinite(friction) & (friction < maximum))
        cones = replace(self.cones, friction=friction[finite][:, None] * share)
        forces, solved = least_norm_in_cones(
            cones, self.maps[finite], self.b[finite], self.active[finite], self.bounds.of(finite)
        )
        torques = tau[finite] - np.einsum("nvck,nck->nv", maps[finite], forces + self.preload[finite])
        rows = finite[exceeding(torques, limits) | ~solved]
        rows = rows[~self._keeps(rows, friction[rows], share, maps, tau, limits)]
        rows = rows[self._keeps(rows, np.full(len(rows), maximum), share, maps, tau, limits)]
        if not len(rows):
            return needed
        low, high = friction[rows], np.full(len(rows), maximum)
        for _ in range(_HALVINGS):
            middle = np.tan(0.5 * (np.arctan(low) + np.arctan(high)))
            keeps = self._keeps(rows, middle, share, maps, tau, limits)
            low, high = np.where(keeps, low, middle), np.where(keeps, middle, high)
        needed[rows] = high
        return needed

    def _keeps(self, rows: Array, friction: Array, share: Array, maps: Array, tau: Array, limits: Array) -> Array:
        """True for rows with forces within cones of these coefficients that keep the torques within limits."""
        if not len(rows):
            return np.zeros(0, bool)
        cones = replace(self.cones, friction=friction[:, None] * share)
        within = LimitedBalance(self, maps, tau, limits, rows).within(np.full(len(rows), 1.0 + TOLERANCE))
        optimum = cone_programme(cones, self.maps[rows], self.b[rows], bounds=within, active=self.active[rows])
        return ~np.isnan(optimum.s) & optimum.settled

    def _speeds(self, holds: Array) -> tuple[Array, Array]:
        """Largest and least factors of the speed: the s² that hold are an interval, as the cones are convex."""
        if self.rest_b is None:
            unknown = np.full(len(self.b), np.nan)
            return unknown, unknown
        rate = self.b - self.rest_b
        start, offset = np.where(holds[:, None], self.b, self.rest_b), np.where(holds, 1.0, 0.0)
        maximum = self._programme(start, rate)
        minimum = self._programme(self.rest_b, rate, sense="least")
        speed = np.sqrt(np.where(maximum.settled, offset + maximum.s, np.nan))
        return speed, np.sqrt(np.where(minimum.settled, minimum.s, np.nan))

    def _payloads(self, holds: Array) -> Array:
        """Further mass where the row holds, otherwise the least that has to go."""
        payload = np.full(len(self.b), np.nan)
        if self.heavier is None:
            return payload
        sides: tuple[tuple[Array, float, Sense], ...] = ((holds, 1.0, "most"), (~holds, -1.0, "least"))
        for rows, sign, sense in sides:
            if rows.any():
                optimum = self._programme(self.b[rows], sign * self.heavier[rows], rows, sense)
                payload[rows] = sign * np.where(optimum.settled, optimum.s, np.nan)
        return payload

    def _friction(self) -> Array:
        """Least coefficient that holds, by bisection: what holds with one coefficient holds with a larger one."""
        share = self._shares()
        low, high = np.zeros(len(self.b)), np.full(len(self.b), _UNLIMITED_FRICTION)
        suffices = self._holds_with(share, high)
        needs = suffices & ~self._holds_with(share, low)
        rows = np.flatnonzero(needs)
        for _ in range(_HALVINGS):
            middle = np.tan(0.5 * (np.arctan(low) + np.arctan(high)))
            holds = self._holds_with(share, middle, rows)
            high[rows[holds]], low[rows[~holds]] = middle[rows[holds]], middle[rows[~holds]]
        return np.where(suffices, np.where(needs, high, 0.0), np.inf)

    def _shares(self) -> Array:
        """Coefficients (c,) of the contacts as shares of the largest, all of which grow together."""
        mu = self.cones.friction
        largest = float(mu.max())
        return mu / largest if largest > 0 else np.ones_like(mu)

    def _holds_with(self, share: Array, friction: Array, rows: Array | slice = slice(None)) -> Array:
        cones = replace(self.cones, friction=friction[rows][:, None] * share)
        optimum = self._programme(self.b[rows], rows=rows, cones=cones)
        return ~np.isnan(optimum.s) & optimum.settled

    def _motions(
        self, prices: Array, rows: Any = slice(None), slippery: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Motions of Farkas' lemma, largest entry 1, their power, and what the contacts do in them.

        ``slippery`` (c,) are the contacts that may slide; None: all.
        """
        motion = prices / self.units
        size = np.abs(motion).max(axis=1, initial=0.0, keepdims=True)
        size = np.where(size > 0, size, 1.0)
        motion, y, active = motion / size, prices / size, self.active[rows]
        velocities = np.einsum("nmck,nm->nck", self.maps[rows], y)
        power = -(y * self.load[rows]).sum(axis=1)
        rise = (velocities * self.cones.normals).sum(axis=-1)
        slide = np.linalg.norm(velocities - rise[..., None] * self.cones.normals, axis=-1)
        small = _REST_SPEED_SHARE * np.abs(velocities).max(axis=(1, 2), initial=0.0)[:, None]
        along_cone = (slide > small) & (rise - self.cones.friction * slide < small) & active
        if slippery is not None:
            along_cone &= slippery
        preloaded = np.array([c.pull > 0 for c in self.contacts])
        leaves = (rise > small) & preloaded & active & ~along_cone
        slips, pulls = along_cone.any(axis=1), leaves.any(axis=1)
        return motion, power, np.where(pulls, "pulls off", np.where(slips, "slips", "tips"))


def exceeding(torques: Array, limits: Array) -> Array:
    """True for rows of torques (n, nv) above their limits; False where they are NaN."""
    return np.asarray(((np.abs(torques) > limits + margin(limits)) & (limits > 0)).any(axis=1))


class LimitedBalance:
    """Torques τ - Σ J_i' f_i of some rows of a balance as shares of their limits, as bounds of the forces."""

    def __init__(self, balance: Balance, maps: Array, tau: Array, limits: Array, rows: Array) -> None:
        limited = np.isfinite(limits) & (limits > 0)
        own_limits = np.broadcast_to(limits[limited], (len(rows), limited.sum()))
        load = np.einsum("nvck,nck->nv", maps[rows], balance.preload[rows]) - tau[rows]
        self.G, self.load = maps[rows][:, limited] / own_limits[..., None, None], load[:, limited] / own_limits
        self.pushes = balance.bounds.of(rows)

    @property
    def growing(self) -> ForceBounds:
        """Bounds that grow from zero with the share of the limits."""
        one = np.ones_like(self.load)
        return two_sided(self.G, self.load, 0.0 * one, one).concatenate(self.pushes)

    def within(self, share: Array) -> ForceBounds:
        """Bounds at shares (n,) of the limits."""
        one = np.ones_like(self.load)
        return two_sided(self.G, self.load, share[:, None] * one, 0.0 * one).concatenate(self.pushes)


def _contact_mask(in_contact: ArrayLike, n: int, c: int) -> Array:
    active = np.asarray(in_contact)
    if active.dtype != bool or active.shape not in ((n, c), (c,)):
        raise ShapeError(
            f"in_contact has the shape {active.shape} and the type {active.dtype}. Give ({n}, {c}) of bool: a row for each "
            "state and a column for each contact."
        )
    return np.broadcast_to(active, (n, c))
