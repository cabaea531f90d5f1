"""Random numbers that depend on nothing but the seed, the ray and the walk.

Each walk owns a stream: a 64-bit state that is advanced and mixed (SplitMix64: Steele, Lea & Flood 2014, OOPSLA).  So
the same seed gives the same numbers whatever the tiles and threads.  The first dimensions of a walk come from an
additive recurrence with the generalised golden ratio, shifted at random for every batch of walks: points that fill the
unit cube more evenly than chance would.
"""

from __future__ import annotations

import numpy as np

from skyscatter.solvers.kernels.jit import entry, inlined, kernel

#: Dimensions of a walk that are spread evenly within a batch.
EVEN_DIMENSIONS = 7


def _golden_steps(dimensions: int) -> np.ndarray:
    """Steps 1/phi, 1/phi^2, ... of the recurrence, phi the root of x^(d + 1) = x + 1 greater than 1."""
    phi = 2.0
    for _ in range(60):
        phi = (1.0 + phi) ** (1.0 / (dimensions + 1))
    return (1.0 / phi) ** np.arange(1, dimensions + 1)


STEPS = _golden_steps(EVEN_DIMENSIONS)
_TO_UNIT = 1.0 / 9007199254740992.0  # 2^-53


@inlined
def mix(z):
    """Finalizer of SplitMix64: a bijection of 64 bits in which every input bit reaches every output bit."""
    z = np.uint64(z)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@entry
def start_stream(state, seed, ray, walk):
    """Set ``state[0]`` to the start of the stream of one walk."""
    z = mix(np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15))
    z = mix(z ^ (np.uint64(ray) + np.uint64(0xD1B54A32D192ED03)))
    state[0] = mix(z ^ (np.uint64(walk) + np.uint64(0x8CB92BA72F3D8DD7)))


@entry
def uniform(state):
    """The next number in [0, 1)."""
    state[0] = state[0] + np.uint64(0x9E3779B97F4A7C15)
    return np.float64(mix(state[0]) >> np.uint64(11)) * _TO_UNIT


@kernel
def even_point(shift, n, out):
    """Point n of the evenly spread sequence with a random shift (dimension,), into `out`."""
    for d in range(out.size):
        x = shift[d] + (n + 1.0) * STEPS[d]
        out[d] = x - np.floor(x)
