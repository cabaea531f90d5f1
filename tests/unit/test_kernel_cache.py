"""The disk cache of compiled kernels notices an edit to any kernel source."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

import skyscatter.solvers.kernels as package
from skyscatter.solvers.kernels import columns, jit


def dispatchers() -> dict[str, Dispatcher]:
    found = {}
    start = f"{package.__name__}."
    for info in pkgutil.walk_packages(package.__path__, start):
        module = importlib.import_module(info.name)
        for name, value in vars(module).items():
            if isinstance(value, Dispatcher) and value.py_func.__module__ == module.__name__:
                found[f"{info.name.removeprefix(start)}.{name}"] = value
    return found


DISPATCHERS = dispatchers()


def test_kernels_are_found() -> None:
    assert {"columns.exact_columns", "single.single_rays", "path.path_rays", "fastexp.fast_exp"} <= DISPATCHERS.keys()


@pytest.mark.parametrize("name", DISPATCHERS)
def test_cache_carries_the_stamp_of_all_sources(name: str) -> None:
    cache = DISPATCHERS[name]._cache
    if isinstance(cache, NullCache):
        # Not cached at all: allowed only for what is inlined into its callers.
        assert DISPATCHERS[name].targetoptions.get("inline") == "always", name
    else:
        assert cache._cache_file._source_stamp == jit.source_stamp(), name


def test_stamp_depends_on_every_kernel_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path(jit.__file__).parent
    names = sorted(path.relative_to(folder) for path in folder.rglob("*.py"))
    assert {Path("columns.py"), Path("surfaces/tables.py")} <= set(names)
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    monkeypatch.setattr(jit, "__file__", str(tmp_path / "jit.py"))
    plain = jit.source_stamp.__wrapped__
    before = plain()
    assert before == jit.source_stamp()
    for name in names:
        original = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(original + b"\n# edited\n")
        assert plain() != before, name
        (tmp_path / name).write_bytes(original)
    assert plain() == before


def test_a_stale_index_is_not_used(tmp_path: Path) -> None:
    """Numba gives up an index whose stamp differs from the present one."""
    from numba.core.caching import IndexDataCacheFile

    old = IndexDataCacheFile(str(tmp_path), "kernel", "stamp 1")
    old.save("signature", "machine code")
    assert IndexDataCacheFile(str(tmp_path), "kernel", "stamp 1").load("signature") == "machine code"
    assert IndexDataCacheFile(str(tmp_path), "kernel", "stamp 2").load("signature") is None
    assert isinstance(columns.exact_columns._cache._cache_file, IndexDataCacheFile)
