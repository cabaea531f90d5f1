"""The sum over the orders of scattering, kept from order to order so that it can go on later."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import ConvergenceError
from skyscatter.solvers.state import Checkpoint
from skyscatter.solvers.sweeps import Sums, Sweeper, per_light
from skyscatter.workers import Workers

Array = NDArray[np.float64]

#: Orders after which a solution that has not converged is given up.
MOST_ORDERS = 5000
#: Share of the time that a solution takes of that which it takes with the coarser one for its error.
FINE_SHARE = 0.9
#: Share of the tolerance that the sum over the orders may miss.
ORDERS_SHARE = 0.3
#: Orders from which the end of a slow series is found from several of the last ones, and how many those are.
SLOW, RECENT = 8, 6


class Series(NamedTuple):
    """Orders that have been added up, and what is needed to add more.

    None of its arrays is changed: a checkpoint may hold them.
    """

    total: Array  #: moments of all orders so far; (node, sun, moment, wavelength)
    total_flux: Array  #: (node, 2, sun, wavelength)
    moments: Array  #: of the last order
    flux: Array
    ratio: Array  #: of the last order to the one before; (node, sun, wavelength)
    #: Number of the last order; of the sum with its end: its greatest relative change, that change in units of the one
    #: before, and the share that is expected to be missing; the same three where the end is found from several orders.
    steps: Array
    recent: Array  #: moments of several last orders, the last one last; (order, node, sun, moment, wavelength)
    recent_flux: Array  #: (order, node, 2, sun, wavelength)

    @classmethod
    def first(cls, moments: Array, flux: Array) -> Series:
        """The first order alone."""
        none = np.empty((0, *moments.shape)), np.empty((0, *flux.shape))
        return cls(moments, flux, moments, flux, np.zeros_like(moments[:, :, 0]), np.ones(7), *none)

    @property
    def order(self) -> int:
        """Number of the last order."""
        return int(self.steps[0])

    @property
    def left(self) -> float:
        """Share of the light that is expected to be missing."""
        return float(min(self.steps[3], self.steps[6]))

    @property
    def rate(self) -> float:
        """By how much the sum's changes fall from order to order; 0 as long as that is unknown."""
        return float(self.steps[2]) if self.order > 2 else 0.0

    @property
    def is_slow(self) -> bool:
        """Whether there are enough orders for its end to be found from several."""
        return len(self.recent) > RECENT

    def shares(self) -> Array:
        """What each of the recent orders counts once more for those that are to come, (order, wavelength).

        Deep in a thick medium light decays in several modes.  Sums S_j of the orders so far are weighed so that what
        the next orders add to them, sum c_j m_j+1 with sum c_j = 1, is least (reduced rank extrapolation: Eddy 1979;
        Sidi 2017, Vector Extrapolation Methods, chapter 2), in units of the light that is there.
        """
        mean = self.total[:, :, 0]
        steps = (self.recent[:, :, :, 0] * per_light(mean)).reshape(len(self.recent), -1, mean.shape[-1])
        out = np.empty((len(steps), mean.shape[-1]))
        for w in range(mean.shape[-1]):
            norm = np.linalg.norm(steps[:, :, w], axis=1).max()
            rows = steps[:, :, w] / (norm if norm > 0 else 1.0)
            # With c_n = 1 - sum of the others it is an ordinary least-squares problem.
            found = np.linalg.lstsq((rows[:-1] - rows[-1]).T, -rows[-1], rcond=1e-10)[0]
            out[:, w] = -np.concatenate([[0.0], np.cumsum(found)])
        return out

    def extrapolated(self, moments: slice = slice(None)) -> tuple[Array, Array]:
        """Moments, or some of them, and fluxes, with the rest as several recent orders tell."""
        shares = self.shares()
        found = self.total[:, :, moments] + np.einsum("jw,jnsmw->nsmw", shares, self.recent[:, :, :, moments])
        return found, self.total_flux + np.einsum("jw,jnfsw->nfsw", shares, self.recent_flux)

    def extended(self) -> tuple[Array, Array]:
        """Mean radiance and fluxes, with the rest as a geometric series."""
        rest = self.ratio / (1 - self.ratio)
        mean = self.total[:, :, 0] + self.moments[:, :, 0] * self.ratio / (1 - self.ratio)
        return mean, self.total_flux + self.flux * rest[:, None]

    def share(self, goal: float) -> float:
        """Share of the orders that have been made of those until no more than `goal` is missing; 0 where unknown."""
        change, shrinks = float(self.steps[1]), float(self.steps[2])
        if self.steps[6] < self.steps[3]:
            change, shrinks = float(self.steps[4]), float(self.steps[5])
        if self.left <= goal:
            return 1.0
        if change >= 1.0 or not 0.0 < shrinks < 1.0:
            return 0.0
        return self.order / (self.order + np.log(goal / self.left) / np.log(shrinks))

    def add(self, moments: Array, flux: Array, settles: bool) -> Series:
        """With one order more; how much is missing is found where the series has to settle."""
        steps = self.steps.copy()
        steps[0] += 1
        recent, recent_flux = self.recent, self.recent_flux
        if settles and steps[0] >= SLOW:
            recent = np.concatenate([recent[-RECENT:], moments[None]])
            recent_flux = np.concatenate([recent_flux[-RECENT:], flux[None]])
        more = Series(
            self.total + moments, self.total_flux + flux, moments, flux, self.ratio, steps, recent, recent_flux
        )
        if not settles:
            return more
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.nan_to_num(np.clip(moments[:, :, 0] / self.moments[:, :, 0], 0.0, 0.9999))
        more = more._replace(ratio=ratio)
        change = greatest_change(self.extended(), more.extended())
        if not np.isfinite(change):
            raise ConvergenceError(
                f"orders: the sum is no number after {more.order} orders of scattering; use solver path"
            )
        steps[1:4] = _settling(change, self.steps[1:4])
        if self.is_slow and more.is_slow:
            mean = slice(0, 1)
            (before, flux_before), (now, flux_now) = self.extrapolated(mean), more.extrapolated(mean)
            change = greatest_change((before[:, :, 0], flux_before), (now[:, :, 0], flux_now))
            # These do not fall evenly: the larger of two changes is what may be missing.
            steps[4:] = change, change / self.steps[4], max(change, self.steps[4])
        return more

    def whole(self, max_order: int | None) -> Sums:
        """The sum with the rest of the series, or that of so many orders."""
        if max_order == 1:  # view rays bring the first order themselves
            return Sums(np.zeros_like(self.total), np.zeros_like(self.total_flux), self.order)
        if max_order is not None:
            return Sums(self.total, self.total_flux, self.order)
        if self.steps[6] < self.steps[3]:
            return Sums(*self.extrapolated(), self.order)
        tail = self.ratio / (1 - self.ratio)
        return Sums(
            self.total + self.moments * tail[:, :, None], self.total_flux + self.flux * tail[:, None], self.order
        )


def _settling(change: float, before: Array) -> tuple[float, float, float]:
    """A change of the sum, that in units of the one before, and the share that is expected to be missing.

    The sums converge as a geometric series does.  The worse of two rates counts: after one step that was huge, because
    an order outshone the one before, the next is small beside it and means nothing.
    """
    shrinks = change / before[0]
    rate = min(max(shrinks, before[1]), 0.999)
    return change, shrinks, change * rate / (1 - rate)


def greatest_change(before: tuple[Array, Array], now: tuple[Array, Array]) -> float:
    """Greatest relative change of mean radiance or fluxes, where there is light worth the name."""
    mean, flux = now
    change = float(np.max(np.abs(mean - before[0]) * per_light(mean)))
    # Where the ground shines, what comes down on it is a small part of the light there: fluxes count too.
    return max(change, float(np.max(np.abs(flux - before[1]) * per_light(flux.max(axis=0)))))


def finished(kept: Mapping[str, Array]) -> Sums | None:
    """The sums that a part of a checkpoint holds, if they were finished."""
    return Sums(kept["moments"], kept["flux"], int(kept["orders"])) if "orders" in kept else None


def is_sum(kept: Mapping[str, Array]) -> bool:
    """Whether a part of a checkpoint is of a sum that has been begun."""
    return "total" in kept


def sum_orders(
    sweeper: Sweeper,
    tolerance: float,
    max_order: int | None = None,
    progress: Callable[[float], None] | None = None,
    checkpoint: Checkpoint | None = None,
    name: str = "",
) -> Sums:
    """Add up orders of scattering until the rest is a geometric series, and add that.

    Parameters
    ----------
    sweeper : Sweeper
    tolerance : float
        Relative; three tenths of it are left to the sum over the orders.
    max_order : int, optional
        Leave out light scattered or reflected more often.
    progress : callable, optional
        Called with the finished share, 0 to 1.
    checkpoint : Checkpoint, optional
        What has been kept there goes on, and what is finished is kept from order to order.
    name : str
        Of the part of the checkpoint.

    Raises
    ------
    ConvergenceError
        If the series has not settled after `MOST_ORDERS` orders.
    """
    kept = {} if checkpoint is None else checkpoint.part(name)
    if (whole := finished(kept)) is not None:
        return whole
    goal = ORDERS_SHARE * tolerance
    # Light that is sent through in more than `last` orders is not asked for: the view ray adds one.
    last = MOST_ORDERS if max_order is None else max_order - 1
    with Workers(max_workers=sweeper.threads) as pool:
        series = Series(**kept) if kept else Series.first(*sweeper.first(pool))
        while series.order < last and not series.left < goal:
            if checkpoint is not None:
                checkpoint.put(name, series._asdict())
            sweeper.narrow(series.moments, series.total, series.rate)
            moments, flux = sweeper.next(pool, series.moments, series.flux)
            series = series.add(moments, flux, max_order is None)
            if progress is not None:
                progress(FINE_SHARE * (series.share(goal) if max_order is None else series.order / last))
    if max_order is None and not series.left < goal:
        raise ConvergenceError(
            f"orders: after {MOST_ORDERS} orders of scattering still {series.left:.1e} of the light is missing; "
            "use solver path"
        )
    sums = series.whole(max_order)
    if checkpoint is not None:
        checkpoint.put(name, {"moments": sums.moments, "flux": sums.flux, "orders": np.array(float(sums.orders))})
    return sums
