"""The costly solution from the coarse one: a few fine sweeps, and what is still missing found on the coarse grid.

Light L of all orders is what sunlight makes at once, S, and what scattering makes of L itself: L = S + K L.  Summed
order by order that takes a sweep K of the grid for each order.  But most of what a coarse grid cannot tell of L is
gone after one sweep of the fine one, and what is left of it is smooth.  So, with v as good a light as is known and
s = S + K v one sweep better, the coarse grid is asked for the light u that has the same defect,

    u = R s + K' u - K' R v,

K' being its own sweep and R the way to it (R L solves this but for the difference between the two sweeps); its
pattern over that of R s is put upon s.  This is the full approximation scheme of multigrid methods (Brandt 1977,
Math. Comp. 31, 333; Trottenberg et al. 2001, Multigrid, section 5.3) with the sweep as the smoother.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import ConvergenceError
from skyscatter.solvers.mixing import settled
from skyscatter.solvers.series import FINE_SHARE, ORDERS_SHARE, finished, sum_orders
from skyscatter.solvers.state import Checkpoint
from skyscatter.solvers.sweeps import FAINTEST, Solution, Sums, Sweeper
from skyscatter.solvers.transfer import Light, Transfer, added, less, light_of
from skyscatter.workers import Workers

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: What a cycle leaves of what it changed, at least, where the light is rough and the coarse grid cannot see it: a sweep
#: takes away a fifth to a half.  And the share of places [%] that are looked at: the worst are at the ends of the range
#: of Suns.
LEAST_LEFT, MOST_PLACES = 0.4, 95.0
#: Cycles after which orders are summed instead; how much each may have of the change before; and of which change the
#: first one may be: a guide that is wrong by more, as in the depth of night, is none.
MOST_CYCLES, SLOWEST, MOST_CHANGED = 12, 0.9, 1.0
#: Orders of the coarse solution beyond which they are summed on the fine grid too: in a thick medium what the coarse
#: grid cannot see falls by a twentieth with each sweep.
MOST_ORDERS = 10
#: Share of what may be missing in the end that may be missing of a correction.
CORRECTION_SHARE = 0.3


def corrected_sums(
    sweeper: Sweeper,
    guide: Solution,
    tolerance: float,
    progress: Callable[[float], None] | None = None,
    checkpoint: Checkpoint | None = None,
    name: str = "",
) -> Sums:
    """Light of all orders on the grid of a sweeper, with the help of a coarser solution at the same wavelengths.

    Parameters
    ----------
    sweeper : Sweeper
    guide : Solution
    tolerance : float
        Relative; three tenths of it may be missing.
    progress : callable, optional
        Called with the finished share, 0 to 1.
    checkpoint : Checkpoint, optional
        What has been kept there goes on, and what is finished is kept from sweep to sweep.
    name : str
        Of the part of the checkpoint.

    Raises
    ------
    ConvergenceError
        If neither this nor the orders settle.
    """
    if checkpoint is not None and (whole := finished(checkpoint.part(name))) is not None:
        return whole
    found = None
    if guide.sums.orders <= MOST_ORDERS:
        with Workers(max_workers=sweeper.threads) as pool:
            found = _cycles(sweeper, _Correction(sweeper, guide, tolerance, pool), progress, checkpoint, name)
    if found is None:
        return sum_orders(Sweeper(sweeper.problem, sweeper.threads), tolerance, None, progress, checkpoint, name)
    if checkpoint is not None:
        checkpoint.put(name, found._asdict() | {"orders": np.array(float(guide.sums.orders))})
    return Sums(*found, guide.sums.orders)


def _cycles(
    sweeper: Sweeper,
    correction: _Correction,
    progress: Callable[[float], None] | None,
    checkpoint: Checkpoint | None,
    name: str,
) -> Light | None:
    """Light that has settled, or None where it does not."""
    kept = {} if checkpoint is None else checkpoint.part(name)
    pool, goal = correction.pool, correction.goal
    if "first_moments" in kept:
        first, light = Light(kept["first_moments"], kept["first_flux"]), Light(kept["moments"], kept["flux"])
        left, changed, cycle = kept["state"].tolist()
    else:
        first = Light(*sweeper.first(pool))
        light = correction.begun(first)
        left, changed, cycle = np.inf, np.inf, 0
    while left > goal:
        if cycle == MOST_CYCLES:
            return None
        if checkpoint is not None:
            state = {"first_moments": first.moments, "first_flux": first.flux, **light._asdict()}
            checkpoint.put(name, state | {"state": np.array([left, changed, cycle])})
        if progress is not None:
            progress(FINE_SHARE * (0.3 + 0.3 * cycle / (1 + 0.3 * cycle)))
        swept = _swept(sweeper, pool, first, light)
        try:
            found = correction.corrected(light, swept)
        except ConvergenceError:
            return None
        before, changed = changed, float(np.percentile(_changes(light, found), MOST_PLACES))
        if not changed < min(SLOWEST * before, MOST_CHANGED):
            return None
        if cycle > 0:  # one alone does not tell how much is left
            left = max(changed / before, LEAST_LEFT) * changed
        light, cycle = found, cycle + 1
    return light


def _swept(sweeper: Sweeper, pool: ThreadPoolExecutor, first: Light, light: Light) -> Light:
    """What sunlight and a sweep make of a light; moments too small to be swept stay, whatever the first order has."""
    sweeper.narrow(light.moments, light.moments, 0.0)
    swept = added(first, sweeper.next(pool, *light))
    small = np.ones(light.moments.shape[2], bool)
    small[sweeper.stage.kept] = False
    swept.moments[:, :, small] = light.moments[:, :, small]
    return swept


def _changes(before: Light, now: Light) -> Array:
    """Greatest relative change of the mean radiance over wavelengths, (node, sun); 0 in the deep night."""
    mean = now.moments[:, :, 0]
    change = np.abs(mean - before.moments[:, :, 0]) / np.where(_visible(mean), mean, np.inf)
    return np.asarray(change.max(axis=2))


def _visible(mean: Array) -> Mask:
    """Where a mean radiance (node, sun, wavelength) is worth the name."""
    return np.asarray(mean > FAINTEST * mean.max(axis=(0, 1)))


class _Correction:
    """What a coarse grid knows of the light that a finer one misses."""

    def __init__(self, sweeper: Sweeper, guide: Solution, tolerance: float, pool: ThreadPoolExecutor) -> None:
        self.goal, self.pool, self.guide = ORDERS_SHARE * tolerance, pool, guide
        self.sweeper = Sweeper(guide.problem, sweeper.threads)
        self.rate = 0.0
        self.up = Transfer.between(guide.problem, sweeper.problem)
        self.down = Transfer.between(sweeper.problem, guide.problem)

    def begun(self, first: Light) -> Light:
        """The first order of the fine grid with the guide's light of all others."""
        total = self.guide.sums
        rest = self.up.known(less(Light(total.moments, total.flux), self.sweeper.first(self.pool)))
        out = Light(first.moments.copy(), first.flux.copy())

        def at(suns: slice) -> None:
            more = light_of(self.up.moved(rest, suns))
            out.moments[:, suns, self.up.there] += more.moments
            out.flux[:, :, suns] += more.flux

        self.up.by_sun(self.pool, at)
        return out

    def corrected(self, light: Light, swept: Light) -> Light:
        """The light that was swept, with what the coarse grid says that is still missing of it."""
        before, now = (self._lowered(which) for which in (light, swept))
        given = less(now, self.sweeper.next(self.pool, *before))

        found, self.rate = settled(
            lambda u: added(given, self.sweeper.next(self.pool, *u)), now, CORRECTION_SHARE * self.goal, self.rate
        )
        return self._changed(swept, less(self.up.known(found), self.up.known(now)))

    def _lowered(self, light: Light) -> Light:
        """A light on the coarse grid."""
        down, coarse = self.down, self.guide.sums.moments
        known = light_of(down.moved(down.known(light)))
        moments = np.zeros(coarse.shape)
        moments[:, :, down.there] = known.moments
        return Light(moments, known.flux)

    def _changed(self, light: Light, change: Light) -> Light:
        """A light on the fine grid whose pattern is changed by what the coarse grid says."""
        out = Light(np.empty_like(light.moments), np.empty_like(light.flux))

        def at(suns: slice) -> None:
            more = self.up.moved(change, suns)
            factor = np.exp(more.moments[:, :, :1])
            moments = light.moments[:, suns] * factor
            moments[:, :, self.up.there[1:]] += more.moments[:, :, 1:] * moments[:, :, :1]
            out.moments[:, suns], out.flux[:, :, suns] = moments, light.flux[:, :, suns] * np.exp(more.flux)

        self.up.by_sun(self.pool, at)
        return out
