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

_MAX_RESIDUAL = 1e-6
"""Load that the forces do not balance, relative to the load, above which a row is undecided."""
_ROUNDING_LOAD = 1e-12
"""Unbalanced load that counts as rounding, also if the load is zero [N]."""
_UNLIMITED_FRICTION = 10.0
"""Coefficient of friction that counts as unlimited."""
_BISECTION_STEPS = 14
"""Halvings of the interval in which the least coefficient of friction lies."""
_REST_SPEED_SHARE = 1e-6
"""Velocity of a contact, relative to the fastest contact, below which it does not move."""


@dataclass(frozen=True, eq=False)
class BalanceSolution:
    """Forces, margins and proofs of n rows; :class:`~twistwrench.statics.support.Support` explains each field."""

    holds: Array  # (n,) mask
    decided: Array  # (n,) mask
    how: Array  # (n,) texts
    forces: Array  # (n, c, 3) [N]
    speed: Array  # (n,) largest factors of the speed
    slowest: Array  # (n,) least factors of the speed
    payload: Array  # (n,) [kg]
    friction: Array  # (n,) least coefficients
    motion: Array  # (n, m)
    power: Array  # (n,) power of the load in the motion
    least_norm: Array  # (n,) mask


class Balance:
    """Balance Σ G_i f_i = b of n loads by forces f_i in the friction cones of c contacts.

    Moments are divided by the lever of the contacts, so all m equations of a load are in N.
    """

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
        """Balance by ``maps`` (n, m, c, 3), the matrices G; ``turning`` (m,) is the mask of the moment equations.

        Loads (n, m) are ``b``, the load at rest ``rest_load``, and the load of 1 kg more ``heavier``.
        """
        n, _, c, _ = maps.shape
        self.contacts = contacts
        self.cones, self.bounds = cones_of(contacts, n)
        self.active = np.ones((n, c), bool)  # mask of contacts that carry
        if in_contact is not None:
            self.active = _contact_mask(in_contact, n, c)
        lever = float(np.abs(maps[:, turning]).max(initial=0.0))
        if lever == 0.0:  # no moments
            lever = 1.0
        self.units = np.where(turning, lever, 1.0)
        self.maps = maps / self.units[:, None, None]
        pull = np.array([contact.pull for contact in contacts])
        self.preload = -pull[:, None] * self.cones.normals * self.active[..., None]
        preload = np.einsum("nmck,nck->nm", self.maps, self.preload)
        self.load = b / self.units
        self.b = self.load - preload  # balanced by forces beyond the preload
        self.rest_b = None if rest_load is None else rest_load / self.units - preload
        self.heavier = None if heavier is None else heavier / self.units

    def solve(self) -> BalanceSolution:
        """Forces, margins and proofs of all rows."""
        optimum = self._programme(self.b)
        balanced = ~np.isnan(optimum.s)  # s is nan if no forces balance
        unbalanced_load = np.einsum("nmck,nck->nm", self.maps, optimum.forces) - self.b
        residual = np.abs(unbalanced_load).max(axis=1, initial=0.0)
        load_size = np.abs(self.b).max(axis=1, initial=0.0)
        motion, power, how = self._motions(optimum.prices)
        is_exact = residual <= _MAX_RESIDUAL * load_size + _ROUNDING_LOAD
        has_proof = power > 0  # the load moves the body, and no contact resists
        decided = optimum.settled & np.where(balanced, is_exact, has_proof)
        holds = balanced & decided
        fails = decided & ~holds
        forces = np.full(optimum.forces.shape, np.nan)
        least_norm = np.zeros(len(forces), bool)
        forces[holds], least_norm[holds] = self._least_norm(optimum.forces, holds)
        least_friction = self._friction()
        slips_with_any_friction = fails & (how == "slips") & np.isinf(least_friction)
        self._replace_by_tipping(np.flatnonzero(slips_with_any_friction), motion, power, how)
        how = np.where(holds, "holds", how)
        how = np.where(decided, how, "undecided")
        speed, slowest = self._speeds(holds)
        motion = np.where(fails[:, None], motion, np.nan)
        power = np.where(fails, power, np.nan)
        return BalanceSolution(
            holds=holds,
            decided=decided,
            how=how,
            forces=forces,
            speed=speed,
            slowest=slowest,
            payload=self._payloads(holds),
            friction=least_friction,
            motion=motion,
            power=power,
            least_norm=least_norm,
        )

    def _replace_by_tipping(self, rows: Array, motion: Array, power: Array, how: Array) -> None:
        """Replace motion, power and ``how`` of ``rows``, which slide, by a motion that no friction resists, if there is one."""
        if not len(rows):
            return
        friction_share = self._friction_shares()
        cones = replace(self.cones, friction=_UNLIMITED_FRICTION * friction_share)
        optimum = self._programme(self.b[rows], rows=rows, cones=cones)
        tip_motion, tip_power, tip_how = self._motions(optimum.prices, rows, slippery=friction_share == 0)
        tips = np.isnan(optimum.s) & optimum.settled & (tip_power > 0)
        tipping_rows = rows[tips]
        motion[tipping_rows] = tip_motion[tips]
        power[tipping_rows] = tip_power[tips]
        how[tipping_rows] = tip_how[tips]

    def forces(self) -> tuple[Array, Array, Array]:
        """Forces (n, c, 3), NaN where none balance; mask (n,) of forces of least norm; mask (n,) of rows with forces."""
        optimum = self._programme(self.b)
        holds = ~np.isnan(optimum.s) & optimum.settled
        forces = np.full(optimum.forces.shape, np.nan)
        least_norm = np.zeros(len(holds), bool)
        forces[holds], least_norm[holds] = self._least_norm(optimum.forces, holds)
        return forces, least_norm, holds

    def _programme(
        self,
        b: Array,
        d: Array | None = None,
        rows: Any = slice(None),
        sense: Sense = "most",
        cones: Cones | None = None,
    ) -> ConeOptimum:
        """Largest or least s with balance of b + s d, for loads ``b`` of these rows; without ``d``, balance of b alone."""
        own_cones = self.cones if cones is None else cones
        return cone_programme(
            own_cones, self.maps[rows], b, d, bounds=self.bounds.of(rows), active=self.active[rows], sense=sense
        )

    def _least_norm(self, basic: Array, rows: Array) -> tuple[Array, Array]:
        """Forces of least norm beyond the preload, or ``basic`` forces where the search fails; mask of rows with least norm."""
        least_norm_forces, is_found = least_norm_in_cones(
            self.cones, self.maps[rows], self.b[rows], self.active[rows], self.bounds.of(rows)
        )
        forces = np.where(is_found[:, None, None], least_norm_forces, basic[rows])
        return forces + self.preload[rows], is_found

    def forces_within(
        self, forces: Array, least_norm: Array, maps: Array, tau: Array, limits: Array
    ) -> tuple[Array, Array]:
        """Forces that keep the torques τ - Σ J_i' f_i within limits, and the mask of forces of least norm.

        Where no forces do, the largest share of a limit is as small as possible. The arguments ``forces`` (n, c, 3) and
        ``least_norm`` (n,) are the solution without limits, with NaN where no forces balance.
        """
        forces, least_norm = forces.copy(), least_norm.copy()
        torques = tau - np.einsum("nvck,nck->nv", maps, forces)
        rows = np.flatnonzero(exceeding(torques, limits))
        if not len(rows):
            return forces, least_norm
        own_maps, own_b, active = self.maps[rows], self.b[rows], self.active[rows]
        limited = LimitedBalance(self, maps, tau, limits, rows)
        least_share = cone_programme(self.cones, own_maps, own_b, bounds=limited.growing, active=active, sense="least")
        allowed_share = np.maximum(least_share.s * (1.0 + TOLERANCE), 1.0)  # all of a limit may be used
        bounds = limited.within(allowed_share)
        least_norm_forces, is_found = least_norm_in_cones(self.cones, own_maps, own_b, active, bounds)
        least_norm[rows] = is_found
        forces[rows] = np.where(is_found[:, None, None], least_norm_forces, least_share.forces) + self.preload[rows]
        return forces, least_norm

    def friction_within(self, friction: Array, maps: Array, tau: Array, limits: Array, maximum: float) -> Array:
        """Least coefficients of friction (n,), from ``friction`` to ``maximum``, with which torques stay within limits.

        Rows with torques within limits at ``friction``, or above limits even with ``maximum``, keep ``friction``.
        """
        needed_friction = friction.copy()
        friction_share = self._friction_shares()
        is_raisable = np.isfinite(friction) & (friction < maximum)
        raisable = np.flatnonzero(is_raisable)
        cones = replace(self.cones, friction=friction[raisable][:, None] * friction_share)
        forces, solved = least_norm_in_cones(
            cones, self.maps[raisable], self.b[raisable], self.active[raisable], self.bounds.of(raisable)
        )
        torques = tau[raisable] - np.einsum("nvck,nck->nv", maps[raisable], forces + self.preload[raisable])
        rows = raisable[exceeding(torques, limits) | ~solved]
        keeps_already = self._keeps_limits(rows, friction[rows], friction_share, maps, tau, limits)
        rows = rows[~keeps_already]
        keeps_at_maximum = self._keeps_limits(rows, np.full(len(rows), maximum), friction_share, maps, tau, limits)
        rows = rows[keeps_at_maximum]
        if not len(rows):
            return needed_friction
        low = friction[rows]  # too little; high is enough
        high = np.full(len(rows), maximum)
        for _ in range(_BISECTION_STEPS):
            middle = np.tan(0.5 * (np.arctan(low) + np.arctan(high)))  # middle of the cones' angles
            keeps = self._keeps_limits(rows, middle, friction_share, maps, tau, limits)
            low = np.where(keeps, low, middle)
            high = np.where(keeps, middle, high)
        needed_friction[rows] = high
        return needed_friction

    def _keeps_limits(
        self, rows: Array, friction: Array, friction_share: Array, maps: Array, tau: Array, limits: Array
    ) -> Array:
        """True for ``rows`` where forces in cones of ``friction`` · ``friction_share`` keep torques within limits."""
        if not len(rows):
            return np.zeros(0, bool)
        cones = replace(self.cones, friction=friction[:, None] * friction_share)
        limited = LimitedBalance(self, maps, tau, limits, rows)
        bounds = limited.within(np.full(len(rows), 1.0 + TOLERANCE))
        optimum = cone_programme(cones, self.maps[rows], self.b[rows], bounds=bounds, active=self.active[rows])
        return ~np.isnan(optimum.s) & optimum.settled

    def _speeds(self, holds: Array) -> tuple[Array, Array]:
        """Largest and least factors s of the speed; s² lies in an interval, since the cones are convex. NaN without rest."""
        if self.rest_b is None:
            unknown = np.full(len(self.b), np.nan)
            return unknown, unknown
        rate = self.b - self.rest_b
        start = np.where(holds[:, None], self.b, self.rest_b)  # s² grows from 1 where the row holds, else from 0
        start_s2 = np.where(holds, 1.0, 0.0)
        maximum = self._programme(start, rate)
        minimum = self._programme(self.rest_b, rate, sense="least")
        speed = np.sqrt(np.where(maximum.settled, start_s2 + maximum.s, np.nan))
        return speed, np.sqrt(np.where(minimum.settled, minimum.s, np.nan))

    def _payloads(self, holds: Array) -> Array:
        """Largest mass to add where the row holds, otherwise minus the least mass to remove [kg]. NaN without payload."""
        payload = np.full(len(self.b), np.nan)
        if self.heavier is None:
            return payload
        # rows, sign of the added mass, and optimum of its magnitude
        add_most: tuple[Array, float, Sense] = (holds, 1.0, "most")
        remove_least: tuple[Array, float, Sense] = (~holds, -1.0, "least")
        for rows, sign, sense in (add_most, remove_least):
            if rows.any():
                optimum = self._programme(self.b[rows], sign * self.heavier[rows], rows, sense)
                payload[rows] = sign * np.where(optimum.settled, optimum.s, np.nan)
        return payload

    def _friction(self) -> Array:
        """Least coefficients of friction (n,) that hold, inf if none does.

        Bisection is possible, since a row that holds with one coefficient holds with a larger one.
        """
        friction_share = self._friction_shares()
        low = np.zeros(len(self.b))
        high = np.full(len(self.b), _UNLIMITED_FRICTION)
        suffices = self._holds_with(friction_share, high)
        needs_friction = suffices & ~self._holds_with(friction_share, low)
        rows = np.flatnonzero(needs_friction)
        for _ in range(_BISECTION_STEPS):
            middle = np.tan(0.5 * (np.arctan(low) + np.arctan(high)))  # middle of the cones' angles
            holds = self._holds_with(friction_share, middle, rows)
            high[rows[holds]] = middle[rows[holds]]
            low[rows[~holds]] = middle[rows[~holds]]
        least_friction = np.where(needs_friction, high, 0.0)
        return np.where(suffices, least_friction, np.inf)

    def _friction_shares(self) -> Array:
        """Coefficients of friction (c,) as shares of the largest; 1 for all contacts if all are frictionless."""
        mu = self.cones.friction
        largest = float(mu.max())
        return mu / largest if largest > 0 else np.ones_like(mu)

    def _holds_with(self, friction_share: Array, friction: Array, rows: Array | slice = slice(None)) -> Array:
        """True for ``rows`` that hold with coefficients ``friction`` (n,) · ``friction_share`` (c,)."""
        cones = replace(self.cones, friction=friction[rows][:, None] * friction_share)
        optimum = self._programme(self.b[rows], rows=rows, cones=cones)
        return ~np.isnan(optimum.s) & optimum.settled

    def _motions(
        self, prices: Array, rows: Any = slice(None), slippery: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Motions of Farkas' lemma with largest entry 1, power of the load in them, and "pulls off", "slips" or "tips".

        ``slippery`` (c,) is the mask of contacts that may slide; None: all.
        """
        motion = prices / self.units
        largest_entry = np.abs(motion).max(axis=1, initial=0.0, keepdims=True)
        largest_entry = np.where(largest_entry > 0, largest_entry, 1.0)
        motion = motion / largest_entry
        y = prices / largest_entry  # the same motion in scaled equations
        active = self.active[rows]
        velocities = np.einsum("nmck,nm->nck", self.maps[rows], y)
        power = -(y * self.load[rows]).sum(axis=1)
        rise_speed = (velocities * self.cones.normals).sum(axis=-1)
        slide_speed = np.linalg.norm(velocities - rise_speed[..., None] * self.cones.normals, axis=-1)
        rest_speed = _REST_SPEED_SHARE * np.abs(velocities).max(axis=(1, 2), initial=0.0)[:, None]
        is_along_cone = rise_speed - self.cones.friction * slide_speed < rest_speed
        slides = (slide_speed > rest_speed) & is_along_cone & active
        if slippery is not None:
            slides &= slippery
        preloaded = np.array([c.pull > 0 for c in self.contacts])
        leaves = (rise_speed > rest_speed) & preloaded & active & ~slides
        how = np.where(slides.any(axis=1), "slips", "tips")
        how = np.where(leaves.any(axis=1), "pulls off", how)
        return motion, power, how


def exceeding(torques: Array, limits: Array) -> Array:
    """True for rows of torques (n, nv) above their limits; False where they are NaN."""
    is_above = np.abs(torques) > limits + margin(limits)
    has_limit = limits > 0
    return np.asarray((is_above & has_limit).any(axis=1))


class LimitedBalance:
    """Limits of the torques τ - Σ J_i' f_i of some rows of a balance, as bounds of the forces f_i."""

    def __init__(self, balance: Balance, maps: Array, tau: Array, limits: Array, rows: Array) -> None:
        has_limit = np.isfinite(limits) & (limits > 0)
        own_limits = np.broadcast_to(limits[has_limit], (len(rows), has_limit.sum()))
        load = np.einsum("nvck,nck->nv", maps[rows], balance.preload[rows]) - tau[rows]
        self.G = maps[rows][:, has_limit] / own_limits[..., None, None]  # torques as shares of the limits
        self.load = load[:, has_limit] / own_limits  # torques of the preload less τ, as shares of the limits
        self.push_bounds = balance.bounds.of(rows)

    @property
    def growing(self) -> ForceBounds:
        """Bounds that grow from zero with the share of the limits."""
        most = np.zeros_like(self.load)
        rate = np.ones_like(self.load)
        return two_sided(self.G, self.load, most, rate).concatenate(self.push_bounds)

    def within(self, share: Array) -> ForceBounds:
        """Fixed bounds at shares (n,) of the limits."""
        most = share[:, None] * np.ones_like(self.load)
        rate = np.zeros_like(self.load)
        return two_sided(self.G, self.load, most, rate).concatenate(self.push_bounds)


def _contact_mask(in_contact: ArrayLike, n: int, c: int) -> Array:
    """Mask (n, c) of contacts that carry; one row stands for all n."""
    active = np.asarray(in_contact)
    if active.dtype != bool or active.shape not in ((n, c), (c,)):
        raise ShapeError(
            f"in_contact has the shape {active.shape} and the type {active.dtype}. Give ({n}, {c}) of bool: a row for each "
            "state and a column for each contact."
        )
    return np.broadcast_to(active, (n, c))
