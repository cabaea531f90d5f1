"""The costly solution from the coarse one: a few fine sweeps, and what is still missing found on the coarse grid.

Light L of all orders is what sunlight makes at once, S, and what scattering makes of L itself: L = S + K L.  Summed
order by order that takes a sweep K of the grid for each order.  But most of what a coarse grid cannot tell of L is
gone after one sweep of the fine one, and what is left of it is smooth.  So, with v as good a light as is known and
s = S + K v one sweep better, the coarse grid is asked for the light u that has the same defect,

    u = R s + K' u - K' R v,

K' being its own sweep and R the way to it (R L solves this but for the difference between the two sweeps); its
pattern over that of R s is put upon s.  The columns of the coarse grid (`synthetic.py`) help to find u.  This is the
full approximation scheme of multigrid methods (Brandt 1977, Math. Comp. 31, 333; Trottenberg et al. 2001, Multigrid,
section 5.3) with the sweep as the smoother.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np

from skyscatter.solvers.mixing import settled
from skyscatter.solvers.series import ORDERS_SHARE, greatest_change
from skyscatter.solvers.sweeps import Solution, Sweeper
from skyscatter.solvers.synthetic import Harmonics
from skyscatter.solvers.transfer import Light, Transfer, added, less, light_of

#: Share of what may be missing in the end that may be missing of a correction; and share of what the fine sweep
#: changed, for the next cycle finds that as well.
CORRECTION_SHARE, CHANGE_SHARE = 0.3, 0.03
#: By how much a cycle may change a logarithm: in deepest night, of which the coarse grid may know next to nothing.
MOST_CHANGE = 2.0


class TwoGrids:
    """What a coarse grid knows of the light that a finer one misses."""

    def __init__(self, sweeper: Sweeper, guide: Solution, tolerance: float, pool: ThreadPoolExecutor) -> None:
        self.goal, self.pool, self.guide = CORRECTION_SHARE * ORDERS_SHARE * tolerance, pool, guide
        self.sweeper = Sweeper(guide.problem, sweeper.threads)
        self.rate = 0.0
        self.up = Transfer.between(guide.problem, sweeper.problem)
        self.down = Transfer.between(sweeper.problem, guide.problem)

    @cached_property
    def harmonics(self) -> Harmonics:
        """Of the coarse grid; a thick medium only begins with that."""
        return Harmonics(self.guide.problem)

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

        def step(light: Light) -> Light:
            return self.harmonics.corrected(light, added(given, self.sweeper.next(self.pool, *light)))

        changed = greatest_change(*((which.moments[:, :, 0], which.flux) for which in (before, now)))
        found, self.rate = settled(step, now, max(self.goal, CHANGE_SHARE * changed), self.rate)
        return self._changed(swept, less(self.up.known(found), self.up.known(now)))

    def _lowered(self, light: Light) -> Light:
        """A light on the coarse grid."""
        down, coarse = self.down, self.guide.sums.moments
        known = light_of(down.moved(down.known(light)))
        moments = np.zeros(coarse.shape)
        moments[:, :, down.there] = known.moments
        return Light(moments, known.flux)

    def _changed(self, light: Light, change: Light) -> Light:
        """A light on the fine grid whose pattern is changed by what the coarse grid says, but not wildly."""
        out = Light(np.empty_like(light.moments), np.empty_like(light.flux))

        def at(suns: slice) -> None:
            more = self.up.moved(change, suns)
            logarithms = more.moments[:, :, :1], more.flux
            factor, brighter = (np.exp(np.clip(part, -MOST_CHANGE, MOST_CHANGE)) for part in logarithms)
            moments = light.moments[:, suns] * factor
            moments[:, :, self.up.there[1:]] += more.moments[:, :, 1:] * moments[:, :, :1]
            out.moments[:, suns], out.flux[:, :, suns] = moments, light.flux[:, :, suns] * brighter

        self.up.by_sun(self.pool, at)
        return out
