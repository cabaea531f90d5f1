"""``skyscatter info``: what an error report should contain."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path

import typer

import skyscatter
from skyscatter.kernels.processors import processors

PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "astropy",
    "pyerfa",
    "colour-science",
    "OpenEXR",
    "matplotlib",
    "xarray",
    "miepython",
    "h5netcdf",
    "pydantic",
    "typer",
    "rich",
)


def info() -> None:
    """Print versions, threads and where compiled kernels are kept."""
    rows = [("skyscatter", skyscatter.__version__), ("python", platform.python_version())]
    for package in PACKAGES:
        try:
            rows.append((package, metadata.version(package)))
        except metadata.PackageNotFoundError:
            rows.append((package, "not installed"))
    rows += [
        ("platform", platform.platform()),
        ("threads", str(processors())),
        ("package", str(Path(skyscatter.__file__).parent)),
        ("machine code", machine_code()),
        ("kernel cache", kernel_cache()),
    ]
    for name, value in rows:
        typer.echo(f"{name:<16}{value}")


def machine_code() -> str:
    """Whether kernels come as machine code, and for which processors."""
    from skyscatter.kernels import ahead

    found = ahead.machine()
    return f"{found}: kernels are compiled when first called" if isinstance(found, str) else f"{found.level}, in use"


def kernel_cache() -> str:
    """Where numba keeps what it compiled, told without loading numba."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return f"{chosen} (NUMBA_CACHE_DIR)"
    kernels = Path(skyscatter.__file__).parent / "kernels" / "__pycache__"
    if os.access(kernels if kernels.is_dir() else kernels.parent, os.W_OK):
        return str(kernels)
    return "numba's folder in the user's cache directory (set NUMBA_CACHE_DIR to choose another)"
