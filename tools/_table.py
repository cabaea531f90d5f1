"""Shared by the scripts that make the tables in data/: writing a table, and finding a package's files."""

from __future__ import annotations

import importlib.util
import os
import tempfile
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path

DATA = Path(__file__).resolve().parent.parent / "data"


def write_table(name: str, remarks: Sequence[str], header: Sequence[str], rows: Iterable[Sequence[str]]) -> Path:
    """Write a CSV table with ``#`` remarks into data/, replacing it in one step."""
    text = "".join(f"# {line}\n" for line in remarks) + ",".join(header) + "\n"
    text += "".join(",".join(row) + "\n" for row in rows)
    (DATA / name).parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", dir=DATA, suffix=".part", delete=False, encoding="utf-8") as part:
        part.write(text)
    os.chmod(part.name, 0o644)
    os.replace(part.name, DATA / name)
    print(f"{DATA / name}: {len(text) / 1000:.0f} kB")
    return DATA / name


def package_file(package: str, member: str, wheel: str | None = None) -> bytes:
    """Bytes of a file inside an installed package (which is not imported), or inside a wheel file."""
    if wheel is not None:
        with zipfile.ZipFile(wheel) as archive:
            return archive.read(f"{package}/{member}")
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise SystemExit(f"{package} is not installed: pip install {package}, or give --wheel FILE")
    return (Path(spec.origin).parent / member).read_bytes()
