"""``skyscatter models`` for nebulae: what it lists, shows, checks and draws."""

from __future__ import annotations

from pathlib import Path

import pytest

from skyscatter.cli.main import main

MODEL = """
name = "ball"
description = "a uniform ball of dust, and gas that shines"
sources = ["a test"]

[view]
ra_deg = 83.5
dec_deg = -5.0
distance = "400 pc"

[[stars]]
name = "lamp"
position = ["0.1 pc", 0, 0]
temperature = 20000
luminosity = 1000

[[components]]
name = "dust"
density = { kind = "sphere", radius = "0.5 pc" }
optics = { kind = "dust", visual_extinction = 2.0 }

[[components]]
name = "gas"
density = { kind = "gaussian-sphere", width = "0.1 pc" }
optics = { kind = "gas-lines", electron_density = 1e9 }
"""


@pytest.fixture
def ball(tmp_path: Path) -> str:
    (tmp_path / "ball.toml").write_text(MODEL, encoding="utf-8")
    return str(tmp_path / "ball.toml")


def test_skies_and_nebulae_are_listed_apart(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models"]) == 0
    skies, nebulae = capsys.readouterr().out.split("nebulae (skyscatter nebula):")
    assert "  earth " in skies
    assert "  ring-nebula " in nebulae
    assert "earth" not in nebulae.lower().split()


def test_a_nebula_is_shown(ball: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "show", ball]) == 0
    out = capsys.readouterr().out
    assert "RA 83.5000, Dec -5.0000 degrees, 400 pc away" in out
    assert "1.842" in out  # 2 mag at 550 nm
    assert "dust: 1, 1, 1 pc; 8.59 arcmin" in out
    assert "lamp: 20000 K 1000 Lsun at 0.1, 0, 0 pc" in out
    assert "- a test" in out


def test_a_nebula_is_checked(ball: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models", "check", ball]) == 0
    out = capsys.readouterr().out
    assert "good (2 components, 1 stars, 1 sources; optical depth 1.84 through the centres at 550 nm)" in out


def test_columns_of_a_nebula_are_drawn(ball: str, tmp_path: Path) -> None:
    import numpy as np

    import skyscatter
    from skyscatter.plotting import nebula_figure

    assert main(["models", "show", ball, "--plot", str(tmp_path / "ball.png")]) == 0
    assert (tmp_path / "ball.png").read_bytes().startswith(b"\x89PNG")
    maps = [axes.images[0].get_array() for axes in nebula_figure(skyscatter.load_model(ball), 101).axes if axes.images]
    assert len(maps) >= 2
    assert maps[0][50, 50] == pytest.approx(2 / 1.0857, rel=1e-4)
    assert maps[1][50, 50] == pytest.approx(0.1 * np.sqrt(2 * np.pi), rel=1e-4)


def test_a_nebula_is_no_sky(ball: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sky", ball, "-o", str(tmp_path / "x.png")]) == 2
    assert "is a nebula; use skyscatter nebula" in capsys.readouterr().err
