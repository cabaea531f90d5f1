"""Every solver gives the numbers that it gave: what moves code and changes none of them is held by this."""

from __future__ import annotations

import digests
import numpy as np
import pytest

#: Sums of rounded numbers, and fields that are kept in single precision (`orders`), as other processors round them.
DOUBLE, SINGLE = 1e-9, 3e-6


def test_every_digest_is_kept() -> None:
    assert digests.kept().keys() == digests.DIGESTS.keys()


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n not in digests.QUICK)) for n in digests.DIGESTS]
)
def test_numbers_are_as_they_were(name: str) -> None:
    expected, found = digests.kept()[name], digests.computed(name)
    assert found.keys() == expected.keys()
    rtol = SINGLE if "orders" in name or "field" in name or "dusk" in name else DOUBLE
    for part, values in expected.items():
        scale = np.nanmax(np.abs(values), initial=0.0)
        np.testing.assert_allclose(found[part], values, rtol=rtol, atol=rtol * scale, err_msg=part)
