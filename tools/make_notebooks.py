"""Makes the notebooks in examples/: executes NN_name.py and keeps it, with its output and pictures, as NN_name.ipynb.

python tools/make_notebooks.py                  # those whose .ipynb does not say what their .py says
python tools/make_notebooks.py 01 09 --force    # these two, whatever they say
python tools/make_notebooks.py --check          # only name those that differ, or hold errors; 1 if there are any

The .py (jupytext's percent format) is the source; the .ipynb is made from it, without running it where only prose has
changed. Needs the extra `notebooks`.
"""

from __future__ import annotations

import argparse
import base64
import io
import os
import re
import tempfile
import time
from pathlib import Path
from typing import Any

import jupytext
import nbformat

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
SOURCES = "[0-9][0-9]_*.py"
SECONDS = 600  #: for one cell
HEAVY = 700_000  #: bytes of a notebook above which its pictures should become smaller
#: Opened in JupyterLab with jupytext, an edited notebook is written to both files.
PAIRING = {"formats": "ipynb,py:percent", "notebook_metadata_filter": "-all", "cell_metadata_filter": "-all"}
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}
#: What changes from run to run, and has no meaning for a reader.
ADDRESS = re.compile(r"\bat 0x[0-9a-f]{6,}")


def sources(names: list[str] | None = None) -> list[Path]:
    """The .py of every notebook, or of those whose names begin so."""
    found = sorted(EXAMPLES.glob(SOURCES))
    if not names:
        return found
    chosen = [path for path in found if path.name.startswith(tuple(names))]
    for name in names:
        if not any(path.name.startswith(name) for path in found):
            raise SystemExit(f"no notebook begins with {name}; there are {', '.join(p.stem for p in found)}")
    return chosen


def read(source: Path) -> Any:
    """Cells of a .py, without outputs, numbered so that the same cells make the same file."""
    book = jupytext.read(source, fmt="py:percent")
    book.metadata = nbformat.from_dict({"jupytext": PAIRING, "kernelspec": KERNEL, "language_info": {"name": "python"}})
    for number, cell in enumerate(book.cells):
        cell.id, cell.metadata = f"cell-{number:02d}", nbformat.NotebookNode()
    book.nbformat, book.nbformat_minor = 4, 5
    return book


def differences(source: Path, book: Any = None) -> list[str]:
    """What is wrong with the .ipynb of a .py, or with `book` in its place: other cells, errors, no pictures."""
    kept = source.with_suffix(".ipynb")
    if book is None and not kept.is_file():
        return [f"{kept.name}: missing"]
    mine, theirs = read(source), book or nbformat.read(kept, as_version=4)
    if len(mine.cells) != len(theirs.cells):
        return [f"{kept.name}: {len(theirs.cells)} cells, {source.name} has {len(mine.cells)}"]
    pairs = enumerate(zip(mine.cells, theirs.cells, strict=True))
    wrong = [f"{kept.name}: cell {k} is not that of {source.name}" for k, (a, b) in pairs
             if (a.cell_type, a.source) != (b.cell_type, b.source)]  # fmt: skip
    outputs = [out for cell in theirs.cells for out in cell.get("outputs", ())]
    for out in outputs:
        if out.output_type == "error" or out.get("name") == "stderr":
            wrong.append(f"{kept.name}: keeps an error or warning: {str(out.get('text') or out.get('evalue'))[:90]!r}")
        if ADDRESS.search(str(out.get("text") or out.get("data", {}).get("text/plain"))):
            wrong.append(f"{kept.name}: prints an address in memory; end the line with ;")
    if not any("image/png" in out.get("data", {}) for out in outputs):
        wrong.append(f"{kept.name}: has no picture")
    return wrong


def with_kept_outputs(source: Path) -> Any:
    """The notebook with new prose and the outputs that are kept of it; None if its code has changed."""
    kept = source.with_suffix(".ipynb")
    book = read(source)
    if not kept.is_file():
        return None
    codes = [[cell for cell in b.cells if cell.cell_type == "code"] for b in (book, nbformat.read(kept, as_version=4))]
    if [cell.source for cell in codes[0]] != [cell.source for cell in codes[1]]:
        return None
    for mine, theirs in zip(*codes, strict=True):
        mine.outputs, mine.execution_count = theirs.outputs, theirs.execution_count
    return book


def execute(source: Path) -> None:
    """Run a notebook at full size in an empty folder, and keep it."""
    from nbclient import NotebookClient

    book, begin = read(source), time.perf_counter()
    environment = {k: v for k, v in os.environ.items() if k not in ("SKYSCATTER_QUICK", "MPLBACKEND")}
    path = os.pathsep.join([str(EXAMPLES.parent), environment.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            book, timeout=SECONDS, kernel_name=KERNEL["name"], record_timing=False,
            resources={"metadata": {"path": folder}},
        )  # fmt: skip
        client.execute(env={**environment, "PYTHONPATH": path})
    for cell in book.cells:
        tidy(cell)
    book.metadata = read(source).metadata
    write(source, book)
    print(f"{source.stem} took {time.perf_counter() - begin:.0f} s", flush=True)


def write(source: Path, book: Any) -> None:
    """Keep a notebook beside its .py, whole or not at all."""
    target = source.with_suffix(".ipynb")
    text = nbformat.writes(book) + "\n"
    with tempfile.NamedTemporaryFile("w", dir=EXAMPLES, suffix=".part", delete=False, encoding="utf-8") as part:
        part.write(text)
    os.chmod(part.name, 0o644)
    os.replace(part.name, target)
    size = len(text.encode())
    note = f"; above {HEAVY / 1000:.0f} kB, draw smaller pictures" if size > HEAVY else ""
    print(f"{target.name}: {size / 1000:.0f} kB{note}", flush=True)


def tidy(cell: Any) -> None:
    """Take out of a cell's outputs what changes from run to run."""
    cell.metadata = nbformat.NotebookNode()
    for out in cell.get("outputs", ()):
        out.pop("metadata", None)
        if out.output_type in ("display_data", "execute_result"):
            out.metadata = nbformat.NotebookNode()
            if "image/png" in out.data:
                out.data["image/png"] = repacked(out.data["image/png"])


def repacked(picture: str) -> str:
    """A PNG in base64 with the same pixels, without what else is written into it (versions, resolution)."""
    from PIL import Image

    image = Image.open(io.BytesIO(base64.b64decode(picture)))
    if image.mode == "RGBA" and image.getextrema()[3] == (255, 255):
        image = image.convert("RGB")
    image.info.clear()
    out = io.BytesIO()
    image.save(out, format="PNG", optimize=True)
    return base64.b64encode(out.getvalue()).decode()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="beginnings of names, such as 01")
    parser.add_argument("--check", action="store_true", help="execute nothing, say what differs")
    parser.add_argument("--force", action="store_true", help="execute those that are in order, too")
    options = parser.parse_args()
    wrong = {source: differences(source) for source in sources(options.names)}
    if options.check:
        lines = [line for found in wrong.values() for line in found]
        print("\n".join(lines) or f"{len(wrong)} notebooks are in order")
        raise SystemExit(bool(lines))
    for source, found in wrong.items():
        book = None if options.force else with_kept_outputs(source)
        if options.force or (found and (book is None or differences(source, book))):
            execute(source)
        elif found:
            write(source, book)


if __name__ == "__main__":
    main()
