"""The exponential of the inner loops."""

from __future__ import annotations

import platform
import re

import numpy as np
import pytest
from numba import njit

from skyscatter.kernels.fastexp import fast_exp, fast_expm1_over


@njit
def _exp(x, out):
    for i in range(x.size):
        out[i] = fast_exp(x[i])


@njit
def _expm1_over(x, out):
    for i in range(x.size):
        out[i] = fast_expm1_over(x[i])


def exp(x) -> np.ndarray:
    x = np.asarray(x, float)
    out = np.empty_like(x)
    _exp(x, out)
    return out


def test_relative_error() -> None:
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(-700, 700, 200_000), rng.uniform(-1, 1, 100_000), np.geomspace(1e-300, 1, 1000)])
    # The first omitted term of the series, 0.347^9 / 9! = 2e-10.
    np.testing.assert_allclose(exp(x), np.exp(x), rtol=3e-10)


def test_at_the_seams_of_range_reduction() -> None:
    seams = (np.arange(-1000, 1000) + 0.5) * np.log(2)
    x = np.concatenate([np.nextafter(seams, s) for s in (-np.inf, np.inf)])
    x = x[np.abs(x) < 700]
    np.testing.assert_allclose(exp(x), np.exp(x), rtol=3e-10)


def test_exact_at_nought_and_never_decreasing() -> None:
    assert exp([0.0])[0] == 1.0
    assert exp([-0.0])[0] == 1.0
    # Steps far larger than the error.
    assert np.all(np.diff(exp(np.arange(-700, 0, 1e-3))) > 0)


def test_deep_shadow_is_dark_and_finite() -> None:
    values = exp([-700.0, -701.0, -1e4, -1e300, -np.inf])
    assert np.all(values > 0)
    assert np.all(values < 1e-303)


def test_expm1_over_its_argument() -> None:
    """On both sides of where the series ends, whose first omitted term is 0.1^6 / 5040 = 2e-10, and 3e-10 over 0.1."""
    x = np.concatenate([np.geomspace(1e-300, 700, 20_000), np.linspace(0.09, 0.11, 1001)])
    out = np.empty_like(x)
    _expm1_over(x, out)
    np.testing.assert_allclose(out, np.expm1(x) / x, rtol=1e-8)
    _expm1_over(np.zeros(1), out[:1])
    assert out[0] == 1.0


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="names of SIMD instructions of x86-64")
def test_loop_is_vectorised() -> None:
    """The reason for its existence: packed multiplications in the loop over wavelengths."""
    exp([0.0])
    assembly = "\n".join(_exp.inspect_asm().values())
    assert len(re.findall(r"\bv?mulpd\b|\bvfn?m(?:add|sub)\d+pd\b", assembly)) >= 8
