"""What the benchmarks share: the machine, versions, timing, tables, and a section of RESULTS.md."""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import re
import shlex
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from skyscatter.kernels.processors import processors

RESULTS = Path(__file__).with_name("RESULTS.md")
WAVELENGTHS = np.linspace(380.0, 780.0, 32)  #: vacuum wavelengths of all benchmarks [nm]


def parser(description: str | None, repeats: int | None = None) -> argparse.ArgumentParser:
    """A parser with the options that benchmarks share; `--repeats` for those that time something, with its default."""
    made = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--write", action="store_true", help="write the result into its section of RESULTS.md")
    if repeats is not None:
        made.add_argument("--repeats", type=int, default=repeats, help="repeats of each timing; the median counts")
    return made


def machine() -> str:
    """Processor, number of processors, memory, system and Python in one line, and how busy the machine is."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        found = re.search(r"^model name\s*:\s*(.+)$", info.read_text(), re.MULTILINE)
        name = found.group(1) if found else name
    memory = ""
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        memory = f", {os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30:.0f} GiB"
    busy = f", load average {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else ""
    return f"{name}, {processors()} processors{memory}, {platform.system()}, Python {platform.python_version()}{busy}"


def versions(*packages: str) -> str:
    """Versions of installed packages in one line."""
    words = []
    for package in packages:
        try:
            words.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            words.append(f"{package} not installed")
    return ", ".join(words)


def seconds(function: Callable[[], Any]) -> tuple[float, Any]:
    """Wall-clock time of one call [s], and what it returned."""
    start = time.perf_counter()
    answer = function()
    return time.perf_counter() - start, answer


def median_seconds(function: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Median wall-clock time of several calls [s], and what the last one returned."""
    runs = [seconds(function) for _ in range(max(repeats, 1))]
    return statistics.median(run[0] for run in runs), runs[-1][1]


def show(value: Any) -> str:
    """A cell of a table: three digits for numbers."""
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return str(value)


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    lines += ["| " + " | ".join(show(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def rms(values: Any) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def report(
    section: str,
    where: str,
    packages: str,
    blocks: Sequence[str],
    command: Sequence[str],
    write: bool,
    page: Path = RESULTS,
) -> None:
    """Print the blocks; with `write`, put them between the markers of their section of a page, dated."""
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    words = shlex.join([Path(command[0]).name, *(word for word in command[1:] if word != "--write")])
    body = "\n\n".join([f"{today}; {where}; {packages}.", f"Command: `python benchmarks/{words} --write`", *blocks])
    print(body)
    if write:
        replace_section(page, section, body)


def replace_section(page: Path, section: str, body: str) -> None:
    """Put `body` between the markers of a section of a Markdown page."""
    from skyscatter.atomic import atomic_path

    begin, end = f"<!-- begin {section} -->", f"<!-- end {section} -->"
    text = page.read_text(encoding="utf-8")
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if not pattern.search(text):
        raise SystemExit(f"{page}: no section {section}; put the lines {begin} and {end} back")
    new = pattern.sub(lambda _: f"{begin}\n\n{body}\n\n{end}", text)
    with atomic_path(page) as temporary:
        temporary.write_text(new, encoding="utf-8")
    print(f"\nwritten to {page}")


def view(name: str, side: int) -> tuple[Any, Any]:
    """Scene and camera of a square picture of a shipped nebula or room."""
    import skyscatter
    from skyscatter.space import width_of_all

    model: Any = skyscatter.load_model(name)
    scene = model.scene()
    if model.command == "nebula":
        across = model.picture_width or width_of_all(scene, 1.0)
        return scene, skyscatter.Telescope.from_length(side, side, across, scene.view.distance)
    return scene, type(model.camera)(**{**model.camera.model_dump(), "width": side, "height": side})
