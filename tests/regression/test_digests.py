"""Every solver gives the numbers that it gave: what moves code and changes none of them is held by this."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import digests
import numpy as np
import pytest

from skyscatter.kernels import forms
from skyscatter.kernels.byaddress import lay_out
from skyscatter.kernels.forms import Form
from skyscatter.kernels.jit import Entry

#: Sums of rounded numbers, and fields that are kept in single precision (`orders`): a hundred of its last digits.
DOUBLE, SINGLE = 1e-9, 6e-6
#: What is known to `SINGLE` only.  Profiles by Abel's transform come from ill-conditioned products of linear algebra:
#: four sorts of processors that OpenBLAS knows differ by 6e-8 of the largest density, a millionth of its error bar.
COARSE = ("orders", "field", "dusk", "abel")


@contextmanager
def forms_called() -> Iterator[set[Form]]:
    """The forms in which entries are called meanwhile."""
    called: set[Form] = set()
    call = Entry.__call__

    def noting(self: Entry, *arguments: Any) -> Any:
        laid = lay_out(arguments)
        assert laid is not None, self.name
        called.add(Form(self.name, laid[0]))
        return call(self, *arguments)

    Entry.__call__ = noting  # type: ignore[method-assign]
    try:
        yield called
    finally:
        Entry.__call__ = call  # type: ignore[method-assign]


def test_every_digest_is_kept() -> None:
    assert digests.kept().keys() == digests.DIGESTS.keys()


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n not in digests.QUICK)) for n in digests.DIGESTS]
)
def test_numbers_are_as_they_were(name: str) -> None:
    with forms_called() as called:
        expected, found = digests.kept()[name], digests.computed(name)
    assert called <= set(forms.every()), "run tools/record_forms.py"
    assert found.keys() == expected.keys()
    rtol = SINGLE if any(part in name for part in COARSE) else DOUBLE
    try:
        for part, values in expected.items():
            # An estimated error is the difference of two radiances, and rounded as they are.
            scale = np.nanmax(np.abs(expected["radiance"] if part == "error" else values), initial=0.0)
            np.testing.assert_allclose(found[part], values, rtol=rtol, atol=rtol * scale, err_msg=part)
    except AssertionError:
        if digests.processor() == digests.made_on() or not digests.DRAWN.search(name):
            raise
        # On another processor a walk that decides on the edge goes another way; error bars cover that, of 16 walks
        # with the tails of a t distribution: beyond 6 of them lies one value in 10 000.
        error = np.hypot(found["error"], expected["error"])
        assert np.all(np.abs(np.subtract(found["radiance"], expected["radiance"])) <= 6 * error)
