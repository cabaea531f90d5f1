"""The notebooks in examples/: each runs at its reduced size, and what is kept of it says the same as its source."""

from __future__ import annotations

import importlib.util
import runpy
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "examples").glob("[0-9][0-9]_*.py"))
names = pytest.mark.parametrize("source", SOURCES, ids=[path.stem for path in SOURCES])
#: Deep white skies take a minute even at the reduced size, twilight and dehazing a quarter of one.
LONG = {
    "02_sunset_and_twilight",
    "03_aerosol_from_the_sky",
    "07_what_single_scattering_loses",
    "08_dehazing_step_by_step",
}
runs = pytest.mark.parametrize(
    "source",
    [pytest.param(p, id=p.stem, marks=[pytest.mark.slow] * (p.stem in LONG)) for p in SOURCES],
)


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    """The script that makes notebooks, which also knows how to compare them."""
    spec = importlib.util.spec_from_file_location("make_notebooks", ROOT / "tools" / "make_notebooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# Under Agg, plt.show() has nothing to show on.  All run in this process: they share its imports and loaded kernels.
@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive:UserWarning")
@runs
def test_notebook_runs_at_reduced_size_and_its_numbers_are_right(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import matplotlib

    monkeypatch.setenv("SKYSCATTER_QUICK", "1")
    monkeypatch.chdir(tmp_path)
    with matplotlib.rc_context({"backend": "Agg"}):
        import matplotlib.pyplot as plt

        try:
            runpy.run_path(str(source), run_name="__main__")
            assert plt.get_fignums(), "draws no picture"
        finally:
            plt.close("all")


@names
def test_notebook_states_its_size_and_checks_a_number(source: Path) -> None:
    text = source.read_text(encoding="utf-8")
    assert 'quick = bool(os.environ.get("SKYSCATTER_QUICK"))' in text
    assert "\nassert " in text


@names
def test_kept_notebook_is_that_of_its_source_with_pictures_and_without_errors(source: Path, tool: ModuleType) -> None:
    assert tool.differences(source) == []


@names
def test_kept_notebook_is_small(source: Path) -> None:
    # A repository is cloned whole, with every version of every picture.
    assert source.with_suffix(".ipynb").stat().st_size < 1_000_000


def test_every_notebook_is_listed() -> None:
    text = (ROOT / "examples" / "README.md").read_text(encoding="utf-8")
    assert SOURCES
    assert [path.stem for path in SOURCES if f"`{path.stem}`" not in text] == []


def test_a_changed_cell_is_noticed(tool: ModuleType, tmp_path: Path) -> None:
    source = SOURCES[0]
    for path in (source, source.with_suffix(".ipynb")):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    copy = tmp_path / source.name
    assert tool.differences(copy) == []
    copy.write_text(copy.read_text(encoding="utf-8").replace("assert ", "assert not ", 1), encoding="utf-8")
    assert "is not that of" in tool.differences(copy)[0]


def test_new_prose_keeps_pictures_and_new_code_does_not(tool: ModuleType, tmp_path: Path) -> None:
    source = SOURCES[0]
    copy = tmp_path / source.name
    copy.with_suffix(".ipynb").write_bytes(source.with_suffix(".ipynb").read_bytes())
    text = source.read_text(encoding="utf-8")
    copy.write_text(text.replace("# %% [markdown]\n# #", "# %% [markdown]\n# More about\n# #", 1), encoding="utf-8")
    assert tool.differences(copy)
    assert tool.differences(copy, tool.with_kept_outputs(copy)) == []
    copy.write_text(text.replace("assert ", "assert not ", 1), encoding="utf-8")
    assert tool.with_kept_outputs(copy) is None
