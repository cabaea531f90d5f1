"""Kernels beneath an entry have no machine code of their own, and entries the same bits as by Numba's own pipeline."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import numpy as np
import pytest
from numba.core.compiler import Flags

from skyscatter.kernels.pipeline import _Entry, _Part, _QuickFlags

OURS = "from skyscatter.kernels.jit import entry as top, kernel as middle, {innermost} as lowest\n"
NUMBAS = """from numba import njit
lowest = middle = top = njit(error_model="numpy", _nrt=False, no_cfunc_wrapper=True)
"""
FUNCTIONS = """
import math

@lowest
def innermost(x):
    return math.exp(-x) * math.sin(3.0 * x) + 0.1

@middle
def inner(values, k, step):
    total = 0.0
    for j in range(k):
        total += values[j] / (1.0 + step * innermost(values[j] + step))
    return total

@top
def outer(values, out):
    for k in range(values.size):
        out[k] = inner(values, k, 0.3)

@top
def other(values, out):
    for k in range(values.size):
        out[k] = inner(values, k, 0.0)
"""


@pytest.fixture
def module_of(tmp_path):
    """Makes a module of its own, so that no test meets what another has left on the disk."""

    def make(header):
        path = tmp_path / f"made_{len(list(tmp_path.glob('*.py')))}.py"
        path.write_text(header + FUNCTIONS)
        spec = importlib.util.spec_from_file_location(path.stem, path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return make


@pytest.fixture
def values():
    return np.random.default_rng(1).uniform(0.0, 2.0, 200)


@pytest.mark.parametrize("innermost", ["kernel", "inlined", "merged"])
def test_same_bits_as_numbas_own_pipeline(module_of, values, innermost):
    found, expected = np.empty_like(values), np.empty_like(values)
    module_of(OURS.format(innermost=innermost)).outer(values, found)
    module_of(NUMBAS).outer(values, expected)
    np.testing.assert_array_equal(found, expected)
    assert np.ptp(found) > 0


def test_only_what_python_calls_has_machine_code(module_of, values):
    module = module_of(OURS.format(innermost="kernel"))
    module.outer(values, np.empty_like(values))
    functions = module.innermost, module.inner, module.outer
    libraries = [next(iter(function.compiled.overloads.values())).library for function in functions]
    assert [type(library) for library in libraries] == [_Part, _Part, _Entry]
    for part in libraries[:2]:
        assert not list(part.get_defined_functions())
        assert list(part._get_module_for_linking().functions)
    assert any("outer" in function.name for function in libraries[2].get_defined_functions())


SCRIPT = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np, made_0
out = np.empty(3)
getattr(made_0, sys.argv[2])(np.array([1.0, 2.0, 4.0]), out)
print(out[2], sum(made_0.inner.compiled.stats.cache_hits.values()))
"""


def test_a_kept_part_serves_entries_of_other_processes(module_of, tmp_path):
    """What is read from the disk can be linked, though there is nothing of it to run."""
    module_of(OURS.format(innermost="kernel"))
    for entry, step, hits in ("outer", 0.3, "0"), ("other", 0.0, "1"):
        run = [sys.executable, "-c", SCRIPT, str(tmp_path), entry]
        said = subprocess.run(run, capture_output=True, text=True, check=True).stdout.split()
        assert said[1] == hits
        x = np.array([1.0, 2.0])
        expected = (x / (1 + step * (np.exp(-x - step) * np.sin(3 * (x + step)) + 0.1))).sum()
        assert float(said[0]) == pytest.approx(expected, rel=1e-12)


def test_flags_are_told_apart_by_what_holds() -> None:
    plain, said, other, nothing = (_QuickFlags() for _ in range(4))
    said.nrt, other.nrt, nothing.nrt = True, True, False
    assert said == other
    assert hash(said) == hash(other)
    assert nothing == plain == Flags()
    assert said != plain
    other.forceinline = True
    assert said != other
