"""Every public name loads and has an example that runs."""

import doctest
import importlib
import inspect

import pytest

PACKAGES = (
    "skyscatter", "skyscatter.fields", "skyscatter.surfaces", "skyscatter.inversion", "skyscatter.dehaze",
    "skyscatter.window",
)  # fmt: skip
NAMES = [(package, name) for package in PACKAGES for name in importlib.import_module(package).__all__]


@pytest.mark.parametrize(("package", "name"), NAMES, ids=[".".join(pair) for pair in NAMES])
def test_its_example_runs(package, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    value = getattr(importlib.import_module(package), name)
    if name == "__version__":
        return
    plain = value if inspect.isclass(value) else inspect.unwrap(value)
    found = doctest.DocTestFinder(recurse=False).find(plain, name, globs={})
    assert sum(len(test.examples) for test in found) >= 2, "no example in its docstring"
    said = []
    for test in found:
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=said.append)
    assert not said, "".join(said)
    assert not list(tmp_path.iterdir()), "an example leaves files behind"


def test_what_two_packages_have_is_the_same():
    for name in ("Body", "SurfaceMedium", "SurfaceModel", "SurfaceScene", "Viewpoint"):
        top, inner = (importlib.import_module(package) for package in ("skyscatter", "skyscatter.surfaces"))
        assert getattr(top, name) is getattr(inner, name)
