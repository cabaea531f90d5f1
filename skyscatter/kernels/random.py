"""Random numbers that depend on nothing but the seed, the ray and the walk.

Each walk owns a stream: a 64-bit state that is advanced and mixed (SplitMix64: Steele, Lea & Flood 2014, OOPSLA).  So
the same seed gives the same numbers whatever the tiles and threads.  The first dimensions of a walk come from a Sobol
sequence (direction numbers of Joe & Kuo 2008, SIAM J. Sci. Comput. 30, 2635), scrambled in every batch of walks by a
hash that permutes like Owen's nested scrambling (Laine & Karras 2011, Computer Graphics Forum 30, 1197; constants of
Vegdahl 2021): points that fill the unit cube evenly, and independent from batch to batch.
"""

from __future__ import annotations

import numpy as np

from skyscatter.kernels.jit import entry, inlined, kernel

#: Dimensions of a walk that are spread evenly within a batch.
EVEN_DIMENSIONS = 12
#: Degree, coefficients and first direction numbers of the primitive polynomials from the second dimension on.
_JOE_KUO = (
    (1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)), (3, 2, (1, 1, 1)), (4, 1, (1, 1, 3, 3)), (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)), (5, 4, (1, 1, 5, 5, 5)), (5, 7, (1, 1, 7, 11, 19)), (5, 11, (1, 1, 5, 1, 1)),
    (5, 13, (1, 1, 1, 3, 11)),
)  # fmt: skip
_BITS = 32


def sobol_directions() -> np.ndarray:
    """Direction numbers of the Sobol sequence, shape (dimension, bit), as 32-bit fractions."""
    table = np.zeros((EVEN_DIMENSIONS, _BITS), np.uint32)
    table[0] = [1 << (31 - k) for k in range(_BITS)]
    for d, (degree, coefficients, first) in enumerate(_JOE_KUO, start=1):
        v = [m << (31 - k) for k, m in enumerate(first)]
        for k in range(degree, _BITS):
            x = v[k - degree] ^ (v[k - degree] >> degree)
            for j in range(1, degree):
                if (coefficients >> (degree - 1 - j)) & 1:
                    x ^= v[k - j]
            v.append(x)
        table[d] = v
    return table


DIRECTIONS = sobol_directions()
_TO_UNIT = 1.0 / 9007199254740992.0  # 2^-53
_TO_UNIT_32 = 1.0 / 4294967296.0  # 2^-32


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


@inlined
def keeps(u, weight, total):
    """Whether the newest of several, one after the other, is the one to keep; and the number u to decide by next.

    `total` is the sum of their weights so far, `weight` the newest one's.  The number in [0, 1) is used again,
    stretched, after every decision.
    """
    kept = weight > 0.0 and u * total < weight
    if kept:
        u = u * total / weight
    elif total > weight:
        u = (u * total - weight) / (total - weight)
    return kept, u


@kernel
def reverse_bits(x):
    """The 32 bits of x in reverse order."""
    x = ((x >> np.uint32(1)) & np.uint32(0x55555555)) | ((x & np.uint32(0x55555555)) << np.uint32(1))
    x = ((x >> np.uint32(2)) & np.uint32(0x33333333)) | ((x & np.uint32(0x33333333)) << np.uint32(2))
    x = ((x >> np.uint32(4)) & np.uint32(0x0F0F0F0F)) | ((x & np.uint32(0x0F0F0F0F)) << np.uint32(4))
    x = ((x >> np.uint32(8)) & np.uint32(0x00FF00FF)) | ((x & np.uint32(0x00FF00FF)) << np.uint32(8))
    return np.uint32(x >> np.uint32(16)) | np.uint32(x << np.uint32(16))


@kernel
def scramble(x, seed):
    """Owen's scrambling of a 32-bit fraction: every bit is flipped by a hash of the seed and of the bits above it."""
    x = reverse_bits(x)
    x = np.uint32(x ^ np.uint32(x * np.uint32(0x3D20ADEA)))
    x = np.uint32(x + seed)
    x = np.uint32(x * np.uint32((seed >> np.uint32(16)) | np.uint32(1)))
    x = np.uint32(x ^ np.uint32(x * np.uint32(0x05526C56)))
    x = np.uint32(x ^ np.uint32(x * np.uint32(0x53A22864)))
    return reverse_bits(x)


@entry
def sobol(n, d):
    """Point n of dimension d of the Sobol sequence as a 32-bit fraction."""
    x, k = np.uint32(0), 0
    while n > 0:
        if n & 1:
            x ^= DIRECTIONS[d, k]
        n >>= 1
        k += 1
    return x


@entry
def even_point(shift, n, out):
    """Point n of the sequence scrambled by the seeds `shift` (dimension,) uint32, into `out`."""
    for d in range(out.size):
        out[d] = scramble(sobol(n, d), shift[d]) * _TO_UNIT_32
