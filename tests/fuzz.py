"""Hostile input, thousands of times: every one must end soon, in success or in one line that says what is wrong.

``python tests/fuzz.py [COUNT] [SEED]`` runs in one process and can be interrupted.  Each case is a model file with
wrong values, a damaged file, or a command line with wrong values; nothing is rendered: a command that would begin to
is stopped there and counts as accepted.  A finding is printed with the number of its case, which alone repeats it:
``python tests/fuzz.py 1 NUMBER``.
"""

from __future__ import annotations

import contextlib
import copy
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

#: What is wrong: values of all models, or of skies alone (whose checks compile nothing); files; command lines.
SORTS = ("values", "values", "values", "files", "commands")
SECONDS = 20.0  #: that a case may take

VALUES: list[Any] = [
    0,
    1,
    -1,
    3,
    0.5,
    1e6,
    -1e6,
    1e-300,
    5e-324,
    1e300,
    -1e300,
    1.7e308,
    2**31,
    2**63,
    -(2**63),
    2**63 - 1,
    10**40,
    float("nan"),
    float("inf"),
    float("-inf"),
    True,
    False,
    "",
    " ",
    "nan",
    "inf m",
    "1e400 km",
    "-5 km",
    "7 parsecs",
    "1 pc",
    "3 kg",
    "1 um",
    "30%",
    "0.3",
    "x" * 300,
    "a\x00b",
    "a\nb",
    "é",
    "../x",
    "/",
    ".",
    "/dev/null",
    "earth",
    [],
    [[]],
    [0],
    [1, 2],
    [1, 2, 3],
    [3, 2, 1],
    [1, 1, 1],
    [[1, 2, 3]] * 2,
    ["1 pc"] * 3,
    [float("nan")] * 3,
    [1e300] * 3,
    {},
    {"kind": "x"},
    {"kind": "everywhere"},
    {"kind": "sphere", "radius": 1},
    {"x": {"x": {}}},
]
TEXTS = [
    "",
    " ",
    "0",
    "-1",
    "1",
    "1e400",
    "nan",
    "inf",
    "-inf",
    "9" * 30,
    "1e-320",
    "x",
    "x" * 300,
    "é",
    "a\nb",
    "1:2",
    "1:2:0",
    "400:500:1e-9",
    "500:400:1",
    "400,400",
    "400,500",
    "1,2,3",
    "1km",
    "5 parsecs",
    "30%",
    "-0",
    "0x0",
    "8x4",
    "1e3",
    "True",
    "none",
    "all",
    "/",
    ".",
    "/dev/full",
    "/dev/null",
    "-",
    "--",
    "/nowhere/x.png",
    "2026-02-30T00:00Z",
    "2026-06-21T19:15Z",
    "x" * 300 + ".png",
    "90,180",
    "91,0",
    "earth",
    "mars",
    "dusty-disk",
    "fog-room",
    "in.toml",
]
COMMANDS: dict[str, list[str]] = {
    "sky": [
        "--wavelengths",
        "--samples",
        "--noise",
        "--seed",
        "--threads",
        "--exposure",
        "--space",
        "--bits",
        "-o",
        "--scale",
        "--checkpoint",
        "--progress",
        "--place",
        "--time",
        "--sun-elevation",
        "--sun-azimuth",
        "--altitude",
        "--view",
        "--size",
        "--solver",
        "--tolerance",
        "--max-order",
        "--resume",
        "--show",
        "--json",
        "--quiet",
    ],
    "nebula": [
        "--wavelengths",
        "--size",
        "--solver",
        "--samples",
        "--field-of-view",
        "-o",
        "--psf",
        "--json",
        "--filters",
    ],
    "render": [
        "--wavelengths",
        "--size",
        "--solver",
        "--samples",
        "-o",
        "--photons",
        "--radius",
        "--estimator",
        "--json",
    ],
    "flux": ["--wavelengths", "--altitude", "--sun-elevation", "--tolerance", "-o", "--json"],
    "export": ["--to", "--wavelengths", "--tolerance", "--threads", "-o", "--json"],
    "view": ["--port", "--no-open", "--keep"],
    "models": ["show", "check", "list", "--plot"],
    "dehaze": ["-o", "--aod", "--aerosol", "--sensor", "--scale", "--json"],
    "invert": ["--data", "--free", "-o", "--method", "--noise", "--json"],
}


class Accepted(BaseException):
    """A command has checked what it was given and would begin to work."""


class TooLong(BaseException):
    """A case has not ended in time."""


def _stop(*_: Any, **__: Any) -> Any:
    raise Accepted


@contextlib.contextmanager
def nothing_is_rendered() -> Iterator[None]:
    """Commands stop where their work would begin."""
    import skyscatter
    from skyscatter.cli import common
    from skyscatter.dehaze import engine
    from skyscatter.inversion import fitting
    from skyscatter.window.server import Window

    places: list[tuple[Any, str]] = [
        (common, "render_request"),
        (skyscatter, "solve"),
        (engine, "dehaze_raster"),
        (fitting, "fit"),
        (skyscatter, "fit"),
        (Window, "start"),
    ]
    before = [(home, name, getattr(home, name)) for home, name in places]
    for home, name in places:
        setattr(home, name, _stop)
    try:
        yield
    finally:
        for home, name, value in before:
            setattr(home, name, value)


@contextlib.contextmanager
def bounded(seconds: float) -> Iterator[None]:
    """`TooLong` after so many seconds."""

    def ring(_: int, __: FrameType | None) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value) if isinstance(value, (bool, str)) else repr(value)


def _places(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Ways to all values of a file, those of tables and lists among them."""
    if path:
        yield path
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield from _places(value, (*path, key))


def _mutate(content: dict[str, Any], dice: random.Random) -> None:
    """One wrong value, a missing or doubled one, or a misspelt name."""
    path = dice.choice([p for p in _places(content) if p[0] not in ("description", "sources")])
    parent = content
    for key in path[:-1]:
        parent = parent[key]
    key, how = path[-1], dice.random()
    if how < 0.75:
        value = dice.choice(VALUES)
        parent[key] = copy.deepcopy(value)
    elif how < 0.83:
        del parent[key]
    elif how < 0.9 and isinstance(parent[key], (int, float)) and not isinstance(parent[key], bool):
        parent[key] = parent[key] * dice.choice([1e3, 1e6, 1e9, 1e-9, -1])
    elif isinstance(parent, dict):
        parent[f"{key}x"] = parent.pop(key)
    elif isinstance(parent, list):
        parent.append(copy.deepcopy(parent[key]))


def _content(dice: random.Random, having: str) -> dict[str, Any]:
    """What a shipped model says, its fields with few cells; a mesh or a grid of the user's among it."""
    from skyscatter.datafiles import models_dir

    shipped = [tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(models_dir().glob("*.toml"))]
    content = dice.choice([one for one in shipped if not having or having in one])
    content.pop("sources", None)
    for path in list(_places(content)):
        parent: Any = content
        for key in path[:-1]:
            parent = parent[key]
        if path[-1] == "cells":
            parent["cells"] = 8
        if path[-1] == "hydrogen_density" and "sources" in parent:
            parent |= {"resolution_deg": 30.0, "tolerance": 0.1}
    if "bodies" in content and dice.random() < 0.5:
        dice.choice(content["bodies"])["shape"] = {"kind": "mesh", "file": dice.choice(("mesh.obj", "mesh.ply"))}
    elif "view" in content and dice.random() < 0.3:
        file = dice.choice(("cube.npy", "cube.npz", "cube.fits"))
        content["components"][0]["density"] = {"kind": "voxels", "file": file, "spacing": "0.1 pc"}
    return content


def seeds_of_files(folder: Path) -> None:
    """Good files, to be damaged."""
    from astropy.io import fits

    box = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
    ]
    faces += [(1, 5, 7), (1, 7, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in box] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n")
    head = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    body = [f"{x} {y} {z}" for x, y, z in box] + [f"3 {a} {b} {c}" for a, b, c in faces]
    (folder / "mesh.ply").write_text(head + "\n".join(body) + "\n")
    cube = np.arange(8.0).reshape(2, 2, 2)
    np.save(folder / "cube.npy", cube)
    np.savez(folder / "cube.npz", values=cube)
    fits.writeto(folder / "cube.fits", cube, overwrite=True)


def damage(path: Path, dice: random.Random) -> None:
    """Cut a file short, or change some of its bytes."""
    data = bytearray(path.read_bytes())
    if dice.random() < 0.3:
        del data[dice.randrange(len(data)) :]
    else:
        for _ in range(dice.choice((1, 1, 2, 8))):
            here = dice.randrange(min(len(data), 4000))
            new = dice.choice(
                [bytes([dice.randrange(256)]), b"", b"\x00", b"-", b"9", b"[" * 2000, b"99999999999999999999"]
            )
            data[here : here + 1] = new
    path.write_bytes(bytes(data))


def case(number: int, folder: Path, sorts: Sequence[str] = SORTS) -> list[str]:
    """The command line of a case; its files are made in the folder."""
    dice = random.Random(number)
    sort = dice.choice(sorts)
    seeds_of_files(folder)
    model = folder / "in.toml"
    content = _content(dice, "planet" if sort == "skies" else "")
    if sort in ("values", "skies"):
        for _ in range(dice.choice((1, 1, 1, 2, 4))):
            _mutate(content, dice)
    model.write_text("".join(f"{json.dumps(k)} = {_toml(v)}\n" for k, v in content.items()))
    if sort in ("values", "skies"):
        return ["models", dice.choice(("check", "check", "show")), "in.toml"]
    if sort == "files":
        used = [path for path in folder.iterdir() if path.name in model.read_text()] or [model]
        damage(dice.choice([model, *used]), dice)
        return ["models", "check", "in.toml"]
    command = dice.choice(list(COMMANDS))
    words = [command]
    if dice.random() < 0.6 and command not in ("models",):
        words.append(
            {"dehaze": "cube.fits", "invert": "cube.fits", "nebula": "dusty-disk", "render": "fog-room"}.get(
                command, "earth"
            )
        )
    for _ in range(dice.choice((0, 1, 1, 2, 3))):
        words.append(dice.choice(COMMANDS[command]))
        if dice.random() < 0.9:
            words.append(dice.choice(TEXTS))
    return words


def run(number: int, main: Callable[[list[str]], int], sorts: Sequence[str] = SORTS) -> tuple[str, str | None]:
    """Run a case.

    Returns
    -------
    outcome : {"good", "refused", "accepted", "finding"}
    finding : str or None
        What is wrong with how the case ended.
    """
    here, folder = os.getcwd(), Path(tempfile.mkdtemp(prefix="skyscatter-fuzz-"))
    words: list[str] = []
    out, err = io.StringIO(), io.StringIO()
    try:
        os.chdir(folder)
        words = case(number, folder, sorts)
        before = set(folder.iterdir())
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), bounded(SECONDS):
            status = main(words)
        left = sorted(path.name for path in set(folder.iterdir()) - before)
    except Accepted:
        return "accepted", None
    except TooLong:
        return "finding", f"{words}: no end in {SECONDS:g} s"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return "finding", f"{words}: {type(error).__name__}: {error}"
    finally:
        os.chdir(here)
        shutil.rmtree(folder, ignore_errors=True)
    said = err.getvalue()
    if status not in (0, 2) or "internal error" in said or "Traceback" in said or "np.float64(" in said:
        return "finding", f"{words}: exit status {status}: {said[:400]}"
    lines = [line for line in said.splitlines() if line.strip()]
    if status == 2 and words and "--help" not in said and not 1 <= len(lines) <= 100:
        return "finding", f"{words}: {len(lines)} lines on stderr: {said[:400]}"
    if status == 2 and (left or any(len(line) > 2000 for line in lines)):
        return "finding", f"{words}: left {left}, lines of {[len(line) for line in lines]}: {said[:200]}"
    if status == 0 and any(not line.startswith(("skyscatter: ", "checking in.toml: ")) for line in lines):
        return "finding", f"{words}: {said[:400]}"
    return ("good" if status == 0 else "refused"), None


def warm() -> None:
    """Compile what checks of good models compile: that takes longer than any check."""
    from skyscatter.cli.main import main

    with contextlib.redirect_stdout(io.StringIO()):
        for name in ("earth", "dusty-disk", "hii-region", "fog-room"):
            main(["models", "check", name])


def fuzz(count: int, first: int = 0) -> tuple[Counter[str], list[str]]:
    """Run cases; how many ended how, and the findings."""
    from skyscatter.cli.main import main

    outcomes: Counter[str] = Counter()
    findings: list[str] = []
    warm()
    with nothing_is_rendered():
        for number in range(first, first + count):
            try:
                started = time.monotonic()
                outcome, finding = run(number, main)
            except KeyboardInterrupt:
                break
            outcomes[outcome] += 1
            if finding:
                findings.append(f"case {number} ({time.monotonic() - started:.1f} s): {finding}")
                print(findings[-1], flush=True)
    return outcomes, findings


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:]]
    ended, found = fuzz(*(numbers or [5000]))
    print(dict(ended))
    sys.exit(1 if found else 0)
