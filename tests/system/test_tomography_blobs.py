"""Densities from images that another code, RADMC-3D, made: six views of blobs around a star, all orders."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.mark.slow
def test_blobs_by_another_code(reference: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(BENCHMARKS)])
    import tomography

    views, truth, frame = tomography.blob_views(reference / "inversion_blobs" / "blobs_seed1.npz")
    row, found = tomography.solve(views, frame, truth, **tomography.CELL_SETTINGS)
    error, correlation, mass = row[:3]
    # What is asked for; thin single scattering with a Tikhonov prior reaches 0.222, 0.991 and 0.84.
    assert error <= 0.15
    assert correlation >= 0.99
    assert mass == pytest.approx(1.0, abs=0.05)
    assert all(np.isfinite(image).all() for image in found.residuals)
