"""Machine code that is made ahead: found by kinds of arguments, with the compiler's bits, and only where it fits."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numba import typeof

from skyscatter.kernels import ahead, export, forms
from skyscatter.kernels.byaddress import by_address, lay_out
from skyscatter.kernels.forms import Form
from skyscatter.kernels.tables import parse

needs_compiler = pytest.mark.skipif(shutil.which(os.environ.get("CC", "cc")) is None, reason="needs a C compiler")


class Pair(NamedTuple):
    first: Any
    second: Any


@by_address
class Marked(NamedTuple):
    inner: Any
    number: float


DTYPES = st.sampled_from([np.float64, np.float32, np.int64, np.uint32, np.uint8, np.bool_])
NUMBERS = st.one_of(
    st.booleans(), st.integers(-(2**63), 2**64 - 1), st.floats(), st.none(), st.floats(width=32).map(np.float32),
    st.integers(0, 255).map(np.uint8), st.integers(-9, 9).map(np.int32),
)  # fmt: skip
ARRAYS = st.tuples(
    arrays.arrays(DTYPES, arrays.array_shapes(max_dims=3)), st.booleans(), st.sampled_from(["", "T", "step"])
)


def array(drawn: tuple[np.ndarray, bool, str]) -> np.ndarray:
    """As it is, turned around or with gaps; perhaps not to be written to."""
    made, locked, how = drawn
    made = made.T if how == "T" else np.repeat(made, 2, axis=-1)[..., ::2] if how == "step" else made
    made.flags.writeable = not locked
    return made


FLAT = st.one_of(NUMBERS, ARRAYS.map(array))
VALUES = st.one_of(
    FLAT,
    st.tuples(FLAT, FLAT),
    st.builds(Pair, FLAT, FLAT),
    st.builds(Marked, ARRAYS.map(array), st.floats()),
    st.builds(Pair, st.builds(Marked, ARRAYS.map(array), st.floats()), st.tuples(FLAT)),
)


@given(st.lists(VALUES, max_size=4).map(tuple))
def test_kinds_say_what_numba_would(values: tuple[Any, ...]) -> None:
    laid = lay_out(values)
    assert laid is not None
    kinds, words = laid
    assert parse(kinds) == tuple(typeof(value) for value in values)
    assert len(words) % 8 == 0


@pytest.mark.parametrize("value", ["text", 2**64, 1j, [1.0], {}])
def test_what_has_no_words_is_left_to_the_compiler(value: object) -> None:
    assert lay_out((1.0, value)) is None


def test_every_listed_form_is_one_of_an_entry_that_exists() -> None:
    assert len(forms.every()) > 30
    for form in forms.every():
        assert forms.dispatcher(form) is not None
        assert len(parse(form.kinds)) == forms.dispatcher(form).py_func.__code__.co_argcount, form.entry


def test_the_best_level_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead.platform, "machine", lambda: "x86_64")
    three, four = ahead.LEVELS["x86-64-v3"], ahead.LEVELS["x86-64-v4"]
    for has, first in ((set(), "x86-64"), (three, "x86-64-v3"), (three | four, "x86-64-v4"), (four, "x86-64")):
        monkeypatch.setattr(ahead, "features", lambda has=has: has)
        assert ahead.levels()[0] == first
        assert ahead.levels()[-1] == "x86-64"
    monkeypatch.setattr(ahead.platform, "machine", lambda: "aarch64")
    assert ahead.levels() == ["aarch64"]


#: Calls that take and give everything there is: numbers, arrays, tables, tuples; results of all sorts.
CALLS = """
import sys
import numpy as np
from skyscatter.kernels import columns, optics, random
x = np.linspace(0.1, 3.0, 7)
out = np.zeros(3)
optics.transmittance(np.array([[1.0, 2.0]])[0], np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]), out)
print(*(v.hex() for v in out.tolist()))
print(columns.chapman_outward(800.0, 0.3).hex())
print(random.sobol(5, 3))
print("numba" in sys.modules)
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the library of a few forms, for this processor's lowest level."""
    folder = tmp_path_factory.mktemp("machine")
    x = np.zeros(2)
    wanted = [
        Form("skyscatter.kernels.optics:transmittance", lay_out((x, np.zeros((2, 3)), np.zeros(3)))[0]),  # type: ignore[index]
        Form("skyscatter.kernels.columns:chapman_outward", "f8 f8"),
        Form("skyscatter.kernels.random:sobol", "i8 i8"),
    ]
    export.export(folder, 1, wanted, ahead.levels()[-1:])
    return folder


def run(folder: Path | str) -> list[str]:
    environment = {**os.environ, ahead.SWITCH: str(folder)}
    done = subprocess.run([sys.executable, "-c", CALLS], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@needs_compiler
def test_the_same_bits_without_the_compiler(made: Path) -> None:
    *found, with_compiler = run(made)
    *expected, loaded = run("0")
    assert found == expected
    assert (with_compiler, loaded) == ("False", "True")


@needs_compiler
@pytest.mark.parametrize("how", ["sources", "list", "library", "level"])
def test_what_does_not_fit_is_not_used(made: Path, tmp_path: Path, how: str) -> None:
    folder = shutil.copytree(made, tmp_path / "machine")
    said = json.loads((folder / ahead.LIST).read_text())
    if how == "sources":
        (folder / ahead.LIST).write_text(json.dumps({**said, "sources": "others"}))
    elif how == "list":
        (folder / ahead.LIST).write_text("{}")
    elif how == "level":
        (folder / ahead.LIST).write_text(json.dumps({**said, "levels": ["pdp-11"]}))
    else:
        for file in folder.glob("*.so"):
            file.write_bytes(b"nothing")
    *found, with_compiler = run(folder)
    assert found == run(made)[:-1]
    assert with_compiler == "True"


@needs_compiler
def test_an_edit_of_any_kernel_is_another_source(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "a.py").write_text("A = 1\n")
    before = ahead.sources_stamp(tmp_path)
    (tmp_path / "inner" / "a.py").write_text("A = 2\n")
    assert ahead.sources_stamp(tmp_path) != before


@pytest.mark.parametrize("words", [[], ["--help"]])
def test_the_export_says_how_it_is_called(words: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["export", *words])
    with pytest.raises(SystemExit, match=r"usage: .* FOLDER"):
        export.main()
    assert not list(tmp_path.iterdir())
