"""Who may import whom: downwards only, nowhere in a ring, and inside functions as well."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import skyscatter

ROOT = Path(skyscatter.__file__).parent
#: Packages and modules below `skyscatter`, from the ground floor up; docs/architecture.md draws them.
FLOORS = (
    {"kernels"},
    {"errors", "errorkind", "lazy", "problems", "constants", "units", "record", "registry", "atomic", "datafiles",
     "tablefile", "netcdf", "progress", "workers", "memory", "tasks", "optics", "spectra", "geometry"},
    {"media", "fields", "ground", "lights", "starfield", "surfaces", "celestial"},
    {"scene", "space", "models"},
    {"solvers", "columns", "image"},
    {"dehaze", "inversion"},
    {"window"},
    {"cli", "plotting", "__main__"},
)  # fmt: skip


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {module_of(path): path for path in sorted(ROOT.rglob("*.py"))}


def run_time(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes beneath one, without what stands there for type checkers only."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            continue
        yield child
        yield from run_time(child)


def from_text(text: str, module: str, is_package: bool) -> set[str]:
    """Modules of the package that a source imports, wherever the statement stands."""
    package = module if is_package else module.rpartition(".")[0]
    found = set()
    for node in run_time(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            names = {f"{base}.{alias.name}" for alias in node.names}
            found |= {name if name in FILES else base for name in names}
    return {name for name in found if name in FILES and name != module}


@cache
def imported(module: str) -> frozenset[str]:
    path = FILES[module]
    return frozenset(from_text(path.read_text(encoding="utf-8"), module, path.stem == "__init__"))


def floor(module: str) -> int | None:
    """Number of a module's floor; None for the package itself, which holds its version and its lazy names."""
    part = module.partition(".")[2].partition(".")[0]
    return next((k for k, names in enumerate(FLOORS) if part in names), None) if part else None


def ring(module: str) -> list[str]:
    """The modules from one back to itself, each imported by the one before; none if there is no such way."""
    before: dict[str, str] = {}
    waiting = [module]
    while waiting:
        here = waiting.pop(0)
        for there in sorted(imported(here)):
            if there == module:
                way = [here]
                while way[-1] != module:
                    way.append(before[way[-1]])
                return [*way[::-1], module]
            if there not in before:
                before[there] = here
                waiting.append(there)
    return []


def test_every_module_stands_on_a_floor() -> None:
    assert [name for name in FILES if name != "skyscatter" and floor(name) is None] == []


def test_imports_run_downwards() -> None:
    above = [
        f"{module} (floor {floor(module)}) imports {name} (floor {floor(name)})"
        for module in FILES
        for name in imported(module)
        if floor(module) is not None and (floor(name) or 0) > (floor(module) or 0)
    ]
    assert above == []


def test_no_module_imports_itself_in_the_end() -> None:
    assert [" -> ".join(way) for module in FILES if (way := ring(module))] == []


def test_imports_are_found_wherever_they_stand() -> None:
    text = (
        "import skyscatter.units\nfrom skyscatter.media import space\nfrom typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from skyscatter.cli import main\n"
        "def f():\n    from .. import errors\n    from .fields import Uniform\n"
    )
    found = from_text(text, "skyscatter.media.x", False)
    assert found == {"skyscatter.units", "skyscatter.media.space", "skyscatter.errors", "skyscatter.media.fields"}


def test_what_is_described_loads_no_compiler() -> None:
    """Kinds are numbers that stand by themselves: models, scenes and fields can be had without numba."""
    code = (
        "import sys, skyscatter\nfrom skyscatter import fields, kernels, surfaces\n"
        "import skyscatter.kernels.codes.shells, skyscatter.kernels.codes.space, skyscatter.kernels.codes.surfaces\n"
        "skyscatter.load_model('earth').scene(), fields.Sphere(radius=1.0) * 2.0\n"
        "print('numba' in sys.modules, 'scipy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_the_default_sky_itself_asks_for_no_scipy(tmp_path: Path) -> None:
    """It takes a quarter of a second to load.  The compiler does, too, but with machine code there is no compiler."""
    code = (
        "import builtins\n"
        "plain = builtins.__import__\n"
        "def watched(name, scope=None, *rest, **named):\n"
        "    if name.split('.')[0] == 'scipy' and (scope or {}).get('__name__', '').startswith('skyscatter.'):\n"
        "        print(name, 'in', scope['__name__'])\n"
        "    return plain(name, scope, *rest, **named)\n"
        "builtins.__import__ = watched\n"
        "from skyscatter.cli.main import main\n"
        f"raise SystemExit(main(['sky', 'earth', '--size', '16x8', '-q', '-o', {str(tmp_path / 'sky.png')!r}]))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == ""
