"""The disk cache of compiled kernels notices an edit to any source that a kernel is made of, and to no other."""

from __future__ import annotations

import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import NullCache

import skyscatter
from skyscatter.kernels import columns, stamps
from skyscatter.kernels.jit import Kernel

PACKAGE = Path(skyscatter.__file__).parent
#: Every folder of kernels, with a constant that its own kernels read across files.
CONSTANTS = {
    "kernels": ("flight", "ROULETTE_BELOW = 0.1"),
    "kernels/surfaces": ("flights", None),
    "kernels/raster": ("simulate", "HEAVY = 0.2"),
    "kernels/adjoint": ("march", "ON_FACE = 1e-8"),
    "kernels/towns": ("first", "CLOSEST = 1.0"),
}


def kernels() -> dict[str, Kernel]:
    """Every compiled function of the package, whichever folder it stands in."""
    found = {}
    for info in pkgutil.walk_packages([str(PACKAGE)], "skyscatter."):
        module = importlib.import_module(info.name)
        for name, value in vars(module).items():
            if isinstance(value, Kernel) and value.py_func.__module__ == module.__name__:
                found[f"{info.name}.{name}"] = value
    return found


KERNELS = kernels()


def file_of(kernel: Kernel) -> Path:
    return Path(str(sys.modules[kernel.py_func.__module__].__file__))


def test_kernels_are_found() -> None:
    solvers = {"columns.exact_columns", "single.single_rays", "path.path_rays", "fastexp.fast_exp"}
    others = {"kernels.raster.correct.spread", "kernels.adjoint.march.image_rays"}
    assert {f"skyscatter.kernels.{name}" for name in solvers} <= KERNELS.keys()
    assert {f"skyscatter.{name}" for name in others} <= KERNELS.keys()


def test_every_folder_of_kernels_is_tried() -> None:
    folders = {Path(*name.split(".")[1:-2]).as_posix() for name in KERNELS}
    assert folders == set(CONSTANTS)


@pytest.mark.parametrize("name", KERNELS)
def test_cache_carries_the_stamp_of_all_its_sources(name: str) -> None:
    cache = KERNELS[name].compiled._cache
    if isinstance(cache, NullCache):
        # Not cached at all: allowed only for what is inlined into its callers.
        assert KERNELS[name].targetoptions.get("inline") == "always", name
    else:
        assert cache._cache_file._source_stamp == stamps.source_stamp(file_of(KERNELS[name])), name


def loaded(module: str) -> set[Path]:
    """Files of the package that a module holds something of, as Python sees it after the import, directly or not."""
    seen: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in seen or not name.startswith("skyscatter."):
            continue
        seen.add(name)
        for value in vars(sys.modules[name]).values():
            function = value.py_func if isinstance(value, Kernel) else value
            source = function.__name__ if type(value) is type(sys) else getattr(function, "__module__", None)
            if isinstance(source, str) and source in sys.modules:
                waiting.append(source)
    return {Path(str(sys.modules[name].__file__)) for name in seen}


@pytest.mark.parametrize("module", sorted({d.py_func.__module__ for d in KERNELS.values()}))
def test_the_closure_holds_all_that_a_module_uses(module: str) -> None:
    """Found by reading the imports; held against where the module's names come from at run time."""
    assert loaded(module) <= set(stamps.closure(Path(str(sys.modules[module].__file__))))


def copy_of_the_kernels(root: Path) -> None:
    """The kernels alone, as a package in which nothing else is to be found."""
    shutil.copytree(PACKAGE / "kernels", root / "skyscatter/kernels", ignore=shutil.ignore_patterns("__pycache__"))
    (root / "skyscatter/__init__.py").write_text("")


PROBE = """
from {source} import {name}
from skyscatter.kernels.jit import entry, kernel

@kernel
def held(x):
    return x + {name}

@entry
def probe(x):
    return held(x)
"""


def test_no_edit_runs_old_code(tmp_path: Path) -> None:
    """In a copy of each folder: a kernel that reads a constant of another file, before and after an edit there."""
    copy_of_the_kernels(tmp_path)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def ask() -> list[str]:
        say = "print(m.probe(1.0), sum(m.probe.compiled.stats.cache_hits.values()))"
        names = [f"skyscatter.{folder.replace('/', '.')}.probe_cache" for folder in CONSTANTS]
        calls = "; ".join(f"import {name} as m; {say}" for name in names)
        run = subprocess.run(
            [sys.executable, "-c", calls], env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return run.stdout.splitlines()

    for folder, (module, line) in CONSTANTS.items():
        place = tmp_path / "skyscatter" / folder
        if line is None:  # the folder reads no number across files: it is given one
            line = "CHECKED = 0.5"
            (place / f"{module}.py").write_text((place / f"{module}.py").read_text() + f"\n{line}\n")
        source = f"skyscatter/{folder}/{module}".replace("/", ".")
        (place / "probe_cache.py").write_text(PROBE.format(source=source, name=line.split()[0]))
    first = ask()
    assert [row.split()[0] for row in first] == ["1.1", "1.5", "1.2", "1.00000001", "2.0"]
    assert [row.split()[1] for row in ask()] == ["1"] * 5  # from the cache, where nothing changed
    for folder, (module, line) in CONSTANTS.items():
        file = tmp_path / "skyscatter" / folder / f"{module}.py"
        line = line or "CHECKED = 0.5"
        text = file.read_text()
        assert text.count(f"{line}\n") == 1
        file.write_text(text.replace(f"{line}\n", f"{line.split()[0]} = 4.0\n"))
    assert [row.split() for row in ask()] == [["5.0", "0"]] * 5


def test_an_edit_elsewhere_compiles_nothing_anew(tmp_path: Path) -> None:
    copy_of_the_kernels(tmp_path)
    stamp = stamps.source_stamp.__wrapped__
    kernels = tmp_path / "skyscatter/kernels"
    names = (kernels / "columns.py", kernels / "surfaces/walks.py")
    plain, rooms = (stamp(name, tmp_path) for name in names)
    file = kernels / "surfaces/bsdf.py"
    file.write_text(file.read_text() + "\n")
    assert stamp(names[0], tmp_path) == plain
    assert stamp(names[1], tmp_path) != rooms


def test_imports_in_every_form_are_followed(tmp_path: Path) -> None:
    package = tmp_path / "skyscatter" / "a"
    package.mkdir(parents=True)
    for name in ("b", "c", "d", "e", "f"):
        (package / f"{name}.py").write_text("")
    (package / "__init__.py").write_text("")
    (package / "c.py").write_text("from .e import x\n")
    (package / "first.py").write_text(
        "import skyscatter.a.b\nfrom skyscatter.a import c\n\ndef late():\n    from . import d\n"
    )
    found = {path.name for path in stamps.closure(package / "first.py", tmp_path)}
    assert found == {"first.py", "__init__.py", "b.py", "c.py", "d.py", "e.py"}


def test_a_users_own_kernel_depends_on_ours(tmp_path: Path) -> None:
    own = tmp_path / "mine.py"
    own.write_text("from skyscatter.kernels.columns import EXPONENTIAL\n")
    assert {path.name for path in stamps.closure(own)} >= {"mine.py", "columns.py", "jit.py"}


def test_a_stale_index_is_not_used(tmp_path: Path) -> None:
    """Numba gives up an index whose stamp differs from the present one."""
    from numba.core.caching import IndexDataCacheFile

    old = IndexDataCacheFile(str(tmp_path), "kernel", "stamp 1")
    old.save("signature", "machine code")
    assert IndexDataCacheFile(str(tmp_path), "kernel", "stamp 1").load("signature") == "machine code"
    assert IndexDataCacheFile(str(tmp_path), "kernel", "stamp 2").load("signature") is None
    assert isinstance(columns.exact_columns.compiled._cache._cache_file, IndexDataCacheFile)


UNWRITABLE = """
import sys
if sys.argv[1] == "refused":  # root may write anywhere: the system's answers are made up
    import os
    import numba.core.caching
    def refuse(*words, **options):
        raise PermissionError(13, "Permission denied")
    os.access, numba.core.caching.tempfile.TemporaryFile = lambda path, mode: mode != os.W_OK, refuse
from skyscatter.kernels import forms
form = next(form for form in forms.every() if form.entry.endswith("voxels:box_extremes"))
print(sum(forms.compile_form(form).stats.cache_hits.values()))
"""


def test_what_lies_in_a_folder_that_may_not_be_written_to_is_used(tmp_path: Path) -> None:
    """As in the image of a container, run by a user who may write nowhere; where nothing lies ready, it is said."""
    # Beside the sources of the package itself something may lie ready, too.
    shutil.copytree(PACKAGE, tmp_path / "own/skyscatter", ignore=shutil.ignore_patterns("__pycache__"))
    said = []
    for folder, may in (("kept", "allowed"), ("kept", "refused"), ("empty", "refused")):
        (tmp_path / folder).mkdir(exist_ok=True)
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / folder), "PYTHONPATH": str(tmp_path / "own")}
        command = [sys.executable, "-c", UNWRITABLE, may]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path)
        said.append((done.stdout.strip(), "cannot be kept" in done.stderr))
    assert said == [("0", False), ("1", False), ("0", True)]
