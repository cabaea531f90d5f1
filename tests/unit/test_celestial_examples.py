"""Examples in the docstrings of the sky's bodies and lights run."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest

import skyscatter.celestial

MODULES = [f"skyscatter.celestial.{module.name}" for module in pkgutil.iter_modules(skyscatter.celestial.__path__)]


@pytest.mark.parametrize("module", [*MODULES, "skyscatter.spectra.vega"])
def test_examples_run(module) -> None:
    said: list[str] = []
    for test in doctest.DocTestFinder().find(importlib.import_module(module)):
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=said.append)
    assert not said, "".join(said)
