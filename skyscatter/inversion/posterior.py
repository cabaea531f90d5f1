"""Draws from the whole posterior by emcee's ensemble of walkers (Foreman-Mackey et al. 2013, PASP 125, 306).

The density in the state z is exp(-J(z) / 2) with the cost J of `estimation`, whose S_e is that at the estimate of least
cost.  Walkers start around that estimate.  Where the forward model takes seconds an emulator stands for it; see
`emulator`.  Chains, and all that went into them, are kept in blocks, so that an interrupted run goes on with the same
numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import SkyscatterError
from skyscatter.inversion.emulator import Emulator, build_emulator
from skyscatter.inversion.estimation import Estimate
from skyscatter.inversion.fitstate import FitState
from skyscatter.inversion.forward import Forward

Array = NDArray[np.float64]

#: Steps between two times at which the chain is kept: emulated models are cheap, real ones are not.
BLOCK, REAL_BLOCK = 500, 5
#: Walkers for each parameter; emcee wants more than twice as many as parameters.
WALKERS_PER_PARAMETER = 6
#: Steps beyond which the mean wanders no more: so many autocorrelation times (the rule of emcee's documentation).
LONG_ENOUGH = 50
#: Walkers stay within so many times the radius of the emulator's runs.
BEYOND = 1.25
#: Draws of the posterior at which an emulator is judged by the model itself.
JUDGED = 5


class Posterior(NamedTuple):
    """What the sampling found."""

    samples: Array  #: (sample, parameter) in the state, after burn-in, thinned
    diagnostics: dict[str, Any]


def require_emcee() -> Any:
    """The package, or one line that says how to get it."""
    try:
        import emcee
    except ImportError as error:
        raise SkyscatterError(
            "method = 'posterior' needs emcee, which is not installed: pip install emcee corner"
        ) from error
    return emcee


def sample_posterior(
    forward: Forward,
    estimate: Estimate,
    state: FitState,
    kept: dict[str, Any],
    *,
    steps: int,
    seed: int,
    emulated: bool,
    progress: Callable[[float], None] | None = None,
) -> Posterior:
    """Walk through the posterior.

    Parameters
    ----------
    forward : Forward
    estimate : Estimate
        Of least cost: where the walkers start, and whose S_e holds throughout.
    state : FitState
        Where the run is kept.
    kept : dict
        What it held so far; arrays are added to it.
    steps : int
        Of every walker, at least; emulated chains go on to ten times as many until they are long enough.
    seed : int
    emulated : bool
        Walk on an emulator of the model.
    progress : callable, optional

    Returns
    -------
    Posterior
    """
    require_emcee()

    def tell(share: float) -> None:
        if progress is not None:
            progress(min(share, 1.0))

    def keep(**arrays: Any) -> None:
        kept.update(arrays)
        state.keep(**kept)

    emulator = None
    if emulated:
        emulator = build_emulator(forward, estimate, seed, kept, keep, lambda share: tell(0.7 * share))
    chain, accepted = _walk(forward, estimate, emulator, kept, keep, steps, seed, tell)
    samples, diagnostics = _summary(chain, accepted)
    if emulator is not None:
        diagnostics |= emulator.judge(forward, samples[:: max(len(samples) // JUDGED, 1)][:JUDGED])
        diagnostics["share_beyond_the_emulator"] = float(np.mean(emulator.distance(samples) > emulator.radius))
    tell(1.0)
    return Posterior(samples, diagnostics)


def _log_density(forward: Forward, estimate: Estimate, emulator: Emulator | None) -> Callable[[Array], Array]:
    y, variance = forward.y, estimate.variance

    def of(states: Array) -> Array:
        values = emulator(states) if emulator else np.array([found.value for found in forward.predictions(states)])
        extra = 0.0 if emulator is None else emulator.variance
        misfit = np.sum((y - values) ** 2 / (variance + extra), axis=1)
        density = np.asarray(-0.5 * (misfit + np.sum(states**2, axis=1)))
        if emulator is not None:  # far from its runs a polynomial says anything
            density[emulator.distance(states) > BEYOND * emulator.radius] = -np.inf
        return density

    return of


def _walk(
    forward: Forward,
    estimate: Estimate,
    emulator: Emulator | None,
    kept: dict[str, Any],
    keep: Callable[..., None],
    steps: int,
    seed: int,
    tell: Callable[[float], None],
) -> tuple[Array, Array]:
    """The chain (step, walker, parameter), and how many steps of each walker were accepted (walker,)."""
    emcee = require_emcee()
    n = estimate.z.size
    walkers = max(WALKERS_PER_PARAMETER * n, 8)
    sampler = emcee.EnsembleSampler(walkers, n, _log_density(forward, estimate, emulator), vectorize=True)
    chain = kept.get("chain", np.zeros((0, walkers, n)))
    accepted = np.asarray(kept.get("accepted", np.zeros(walkers)), float)
    if len(chain):
        sampler.random_state = _thawed(kept)
        start = emcee.State(chain[-1], log_prob=kept["log_density"], random_state=_thawed(kept))
    else:
        random = np.random.RandomState(seed % 2**32)
        root = np.linalg.cholesky(estimate.covariance)
        start = emcee.State(estimate.z + 0.5 * random.standard_normal((walkers, n)) @ root.T)
        start.random_state = random.get_state()
        sampler.random_state = random.get_state()
    block = REAL_BLOCK if emulator is None else BLOCK
    most = steps if emulator is None else 10 * steps
    while len(chain) < steps or (len(chain) < most and not _long_enough(chain)):
        positions, before = [], accepted
        for now in sampler.sample(start, iterations=min(block, most - len(chain)), store=True):
            positions.append(now.coords.copy())
        start = now
        accepted = before + sampler.backend.accepted
        sampler.reset()
        chain = np.concatenate([chain, positions])
        keep(chain=chain, accepted=accepted, log_density=start.log_prob, **_frozen(start.random_state))
        tell((0.7 if emulator else 0.0) + (0.25 if emulator else 0.95) * len(chain) / most)
    return chain, accepted


def _frozen(random_state: Any) -> dict[str, Any]:
    """A state of numpy's Mersenne twister as arrays."""
    _, key, place, has_gauss, gauss = random_state
    return {"random_key": key, "random_rest": np.array([place, has_gauss, gauss], float)}


def _thawed(kept: dict[str, Any]) -> Any:
    place, has_gauss, gauss = kept["random_rest"]
    return ("MT19937", np.asarray(kept["random_key"], np.uint32), int(place), int(has_gauss), float(gauss))


def _autocorrelation(chain: Array) -> Array:
    """Integrated autocorrelation time [steps] of each parameter."""
    from emcee.autocorr import integrated_time

    return np.asarray(integrated_time(chain, tol=0, quiet=True), float)


def _long_enough(chain: Array) -> bool:
    time = _autocorrelation(chain)
    return bool(np.all(np.isfinite(time)) and len(chain) > LONG_ENOUGH * time.max())


def _summary(chain: Array, accepted: Array) -> tuple[Array, dict[str, Any]]:
    """Samples after burn-in, thinned to half an autocorrelation time, and how the walk went."""
    steps, walkers, n = chain.shape
    time = _autocorrelation(chain)
    longest = float(np.nanmax(time)) if np.isfinite(time).any() else float(steps)
    burn = min(int(np.ceil(5 * longest)), steps // 2)
    thin = max(int(longest / 2), 1)
    samples = chain[burn::thin].reshape(-1, n)
    return samples, {
        "walkers": walkers, "steps": steps, "burn_in": burn, "thinned_by": thin,
        "acceptance": float(accepted.mean() / steps), "autocorrelation": [round(float(t), 3) for t in time],
        "effective_samples": float((steps - burn) * walkers / longest),
        "long_enough": bool(steps > LONG_ENOUGH * longest),
    }  # fmt: skip
