"""The documentation as a site: it builds without a warning or a network, and has every name and every equation."""

from __future__ import annotations

import functools
import http.server
import importlib
import importlib.util
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("sphinx") is None, reason="the site needs pip install '.[docs]'"),
]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, made of a copy of what it is made of, with warnings as errors."""
    copy = tmp_path_factory.mktemp("tree")
    leave = shutil.ignore_patterns("api", "more", "notebooks", "_build", "__pycache__")
    for name in ("docs", "examples", "benchmarks", "data"):
        shutil.copytree(ROOT / name, copy / name, ignore=leave)
    for path in ROOT.glob("*.md"):
        shutil.copy(path, copy)
    for name in ("skyscatter", "tests", "tools", "models", "CITATION.cff", "pyproject.toml"):
        (copy / name).symlink_to(ROOT / name)
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", "site"],
        cwd=copy, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return copy / "site"


def test_every_public_name_has_a_page_with_its_example(site: Path) -> None:
    packages = ("skyscatter", "skyscatter.fields", "skyscatter.surfaces", "skyscatter.inversion", "skyscatter.dehaze",
                "skyscatter.window")  # fmt: skip
    for package in packages:
        for name in importlib.import_module(package).__all__:
            if f"{package}.{name}" in packages and package == "skyscatter":
                continue
            pages = [site / "api" / f"{home}.{name}.html" for home in (package, "skyscatter")]
            page = next((page for page in pages if page.exists()), None)
            assert name == "__version__" or (page and "&gt;&gt;&gt;" in page.read_text()), f"{package}.{name}"


def test_every_equation_has_an_anchor_and_links_to_its_functions(site: Path) -> None:
    text = "".join(path.read_text() for path in (site / "theory").glob("*.html"))
    numbers = sorted(int(n) for n in re.findall(r'id="eq-(\d+)"', text))
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) > 100
    listed = "".join(path.read_text() for path in (site / "api").glob("functions*.html"))
    targets = set(re.findall(r'href="\.\./api/functions-\w+\.html#([\w-]+)"', text))
    assert len(targets) > 100
    assert all(f'id="{target}"' in listed for target in targets)
    assert set(numbers) <= {int(n) for n in re.findall(r'html#eq-(\d+)"', listed)}


def test_short_options_stay_on_one_line(site: Path) -> None:
    text = (site / "howto-blender.html").read_text()
    assert re.search(r'<code class="[^"]*\bshort\b[^"]*">(<span class="pre">)?--view', text)
    page = (site / "api" / "command-skyscatter-sky.html").read_text()
    prose = re.sub(r"<(code|pre)\b.*?</\1>", "", page, flags=re.DOTALL)
    assert not re.findall(r">[^<]*--[a-z]+-[a-z]+", prose)  # none is torn apart for want of code type
    assert "code.short" in (site / "_static" / "skyscatter.css").read_text()


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        loaded = re.findall(r'<(?:script|img|link|iframe)[^>]*?(?:src|href)="(https?:[^"]*)"', page.read_text())
        assert not [url for url in loaded if "schema" not in url], page.name


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *words: object) -> None:
        """Say nothing."""


@pytest.fixture
def served(site: Path) -> Iterator[str]:
    handler = functools.partial(Quiet, directory=str(site))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.skipif(CHROMIUM is None, reason="no browser is installed")
def test_a_browser_finds_words_and_sets_formulas(served: str, tmp_path: Path) -> None:
    assert CHROMIUM is not None

    def seen(page: str) -> str:
        options = [
            "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
            "--disable-component-update", "--disable-sync", f"--user-data-dir={tmp_path / 'browser'}",
            "--virtual-time-budget=20000", "--dump-dom",
        ]  # fmt: skip
        done = subprocess.run([CHROMIUM, *options, f"{served}/{page}"], capture_output=True, text=True, timeout=120)
        return done.stdout

    found = seen("search.html?q=Chandrasekhar")
    assert "theory/ground.html" in found
    assert "theory/surfaces-walks.html" in found
    formulas = seen("theory/single.html")
    assert "<mjx-container" in formulas
    assert "<mjx-merror" not in formulas
