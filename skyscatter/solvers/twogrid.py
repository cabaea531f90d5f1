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
from skyscatter.solvers.series import FINE_SHARE, ORDERS_SHARE, greatest_change, sum_orders
from skyscatter.solvers.state import Checkpoint
from skyscatter.solvers.sweeps import FAINTEST, Solution, Sums, Sweeper
from skyscatter.solvers.transfer import Light, Transfer, light_of, pattern
from skyscatter.workers import Workers

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: What a correction leaves, in units of itself: 0.03 to 0.28 in clear air, haze and dust, by day and in twilight.
LEFT = 0.25
#: Corrections after which orders are summed instead; and what each may have of the one before.
MOST_CYCLES, SLOWEST = 12, 0.7
#: Share of what may be missing in the end that may be missing of a correction.
CORRECTION_SHARE = 0.3
#: Steps that are remembered to find where they lead, and their number at most.
MEMORY, MOST_STEPS = 6, 500
#: A step that darkens a place by more than this is not believed: light is not negative.
DARKEST = 0.1
#: Nor what several steps together make of a place beyond this factor of what the last one made of it.
WILDEST = 3.0


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
    kept = {} if checkpoint is None else checkpoint.part(name)
    if "orders" in kept:
        return Sums(kept["moments"], kept["flux"], int(kept["orders"]))
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
    """Light that has settled, or None where it does not; every cycle sweeps the places that have not."""
    kept = {} if checkpoint is None else checkpoint.part(name)
    pool, goal = correction.pool, correction.goal
    if "first_moments" in kept:
        first, light = Light(kept["first_moments"], kept["first_flux"]), Light(kept["moments"], kept["flux"])
        left, cycle = kept["left"], int(kept["cycle"])
    else:
        first = Light(*sweeper.first(pool))
        light = first + correction.multiple()
        left, cycle = np.ones(light.moments.shape[:2]), 0
    while left.max() > goal:
        if cycle == MOST_CYCLES:
            return None
        if checkpoint is not None:
            state = {"first_moments": first.moments, "first_flux": first.flux, "left": left, "cycle": np.array(float(cycle))}
            checkpoint.put(name, state | light._asdict())
        if progress is not None:
            progress(FINE_SHARE * (0.3 + 0.3 * cycle / (1 + 0.3 * cycle)))
        sweeper.narrow(light.moments, light.moments, 0.0)
        swept = _swept(sweeper, first, light, left > goal, pool)
        light = correction.corrected(light, swept)
        now, cycle = LEFT * _changes(swept, light), cycle + 1
        if cycle > 1 and now.max() > SLOWEST * left.max():
            return None
        left = now
    return light


def _swept(sweeper: Sweeper, first: Light, light: Light, where: Mask, pool: ThreadPoolExecutor) -> Light:
    """One sweep better, at those heights and Suns (node, sun) between which all lie that have not settled."""
    nodes, suns = np.flatnonzero(where.any(axis=1)), np.flatnonzero(where.any(axis=0))
    found = first + sweeper.next(pool, *light, nodes, suns)
    if nodes.size * suns.size == where.size:
        return found
    moments, flux = light.moments.copy(), light.flux.copy()
    here = np.ix_(nodes, suns)
    moments[here] = found.moments[here]
    flux[nodes[:, None], :, suns] = found.flux[nodes[:, None], :, suns]
    return Light(moments, flux)


def _changes(before: Light, now: Light) -> Array:
    """Greatest relative change of the mean radiance over wavelengths, (node, sun); 0 in the deep night."""
    mean = now.moments[:, :, 0]
    visible = mean > FAINTEST * mean.max(axis=(0, 1))
    change = np.abs(mean - before.moments[:, :, 0]) / np.where(visible, mean, np.inf)
    return np.asarray(change.max(axis=2))


class _Correction:
    """What a coarse grid knows of the light that a finer one misses."""

    def __init__(self, sweeper: Sweeper, guide: Solution, tolerance: float, pool: ThreadPoolExecutor) -> None:
        self.goal, self.pool, self.guide = ORDERS_SHARE * tolerance, pool, guide
        self.sweeper = Sweeper(guide.problem, sweeper.threads)
        self.up = Transfer.between(guide.problem, sweeper.problem)
        self.down = Transfer.between(sweeper.problem, guide.problem)

    def multiple(self) -> Light:
        """The guide's light but for the first order, on the fine grid."""
        total, first = self.guide.sums, self.sweeper.first(self.pool)
        rest = Light(np.array(total.moments), np.array(total.flux)) - Light(*first)
        return light_of(self.up.moved(pattern(rest)))

    def corrected(self, light: Light, swept: Light) -> Light:
        """The light that was swept, with what the coarse grid says that is still missing of it."""
        before, now = (light_of(self.down.moved(pattern(which))) for which in (light, swept))
        given = now - Light(*self.sweeper.next(self.pool, *before))
        found = settle(lambda u: given + self.sweeper.next(self.pool, *u), now, CORRECTION_SHARE * self.goal)
        return light_of(pattern(swept) + self.up.moved(pattern(found) - pattern(now)))


def settle(step: Callable[[Light], Light], light: Light, goal: float) -> Light:
    """The light that a linear step leaves as it is, from where some steps seem to lead.

    Anderson (1965), J. ACM 12, 547, for every wavelength by itself; Walker & Ni (2011), SIAM J. Numer. Anal. 49, 1715.

    Parameters
    ----------
    step : callable
    light : Light
        To begin with.
    goal : float
        Greatest relative change in the last two steps.

    Raises
    ------
    ConvergenceError
        After 500 steps.
    """
    lights: list[Light] = []
    images: list[Light] = []
    before = np.inf
    for _ in range(MOST_STEPS):
        lights, images = [*lights[1 - MEMORY :], light], [*images[1 - MEMORY :], _believed(step(light), light)]
        found = _mixed(lights, images)
        change = greatest_change((light.moments[:, :, 0], light.flux), (found.moments[:, :, 0], found.flux))
        light = found
        if not np.isfinite(change):
            break
        if max(change, before) < goal:
            return light
        before = change
    raise ConvergenceError(f"orders: light has not settled after {MOST_STEPS} steps; use solver path")


def _believed(image: Light, light: Light) -> Light:
    """What a step made of a light, but where it took nearly all of it away."""
    dark = image.moments[:, :, 0] < DARKEST * light.moments[:, :, 0]
    moments = np.where(dark[:, :, None], DARKEST * light.moments, image.moments)
    return Light(moments, np.maximum(image.flux, DARKEST * light.flux))


def _mixed(lights: list[Light], images: list[Light]) -> Light:
    """Where several lights and what a step made of them lead.

    Images are weighed so that lights with the same weights change least in the step, in units of the light there is.
    """
    last, mean = images[-1], lights[-1].moments[:, :, 0]
    if len(lights) == 1:
        return last
    scale = np.where(mean > FAINTEST * mean.max(), 1.0, 0.0) / np.maximum(mean, 1e-300)
    steps = np.stack([(b.moments[:, :, 0] - a.moments[:, :, 0]) * scale for a, b in zip(lights, images, strict=True)])
    moments, flux = last.moments.copy(), last.flux.copy()
    for w in range(mean.shape[-1]):
        rows = steps[..., w].reshape(len(steps), -1)
        length = np.linalg.norm(rows[-1])
        if length == 0:
            continue
        shares = np.linalg.lstsq((rows[-1] - rows[:-1]).T / length, rows[-1] / length, rcond=1e-8)[0]
        for share, image in zip(shares, images[:-1], strict=True):
            moments[..., w] -= share * (last.moments[..., w] - image.moments[..., w])
            flux[..., w] -= share * (last.flux[..., w] - image.flux[..., w])
    tame = _tame(moments[:, :, 0], last.moments[:, :, 0])
    return Light(np.where(tame[:, :, None], moments, last.moments), np.where(_tame(flux, last.flux), flux, last.flux))


def _tame(found: Array, last: Array) -> Mask:
    return (found * WILDEST > last) & (found < WILDEST * last)
