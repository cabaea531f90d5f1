"""``orders`` against numbers that others have published: polarised and scalar slabs, other codes' skies, measured facts.

Several slabs are solved at once, as the "wavelengths" of one scene: optical thickness and albedos are spectra.  What
each table is good for stands at its test; `docs/validation.md` has the deviations.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from plane_parallel import WAVELENGTH, Slab

import skyscatter
from skyscatter.optics.phase import GreekPhase, Rayleigh

Array = NDArray[np.float64]
SLOW = pytest.mark.slow
#: The finest grid that `orders` has.
FINEST = 1.25e-4


def slabs(beam_mu: float, thickness: ArrayLike, ground_albedo: ArrayLike, phase: Any) -> tuple[skyscatter.Scene, Array]:
    """Conservative slabs, one a wavelength, and the wavelengths."""
    thickness, ground_albedo = np.broadcast_arrays(np.asarray(thickness, float), np.asarray(ground_albedo, float))
    wavelengths = WAVELENGTH + np.arange(thickness.size)

    def spectrum(values: Array) -> Any:
        return skyscatter.SpectralTable(wavelengths=tuple(wavelengths), values=tuple(values))

    slab = Slab(1.0, 1.0, phase, beam_mu)
    if thickness.size == 1:
        return replace(slab, optical_thickness=float(thickness), ground_albedo=float(ground_albedo)).scene(), wavelengths
    grey = replace(slab, optical_thickness=spectrum(thickness), ground_albedo=spectrum(ground_albedo))
    return grey.scene(), wavelengths


def rays(share: ArrayLike, mu: ArrayLike, phi: ArrayLike) -> tuple[Array, Array]:
    """As `Slab.rays`, at a share of the optical thickness below the top; everything broadcasts.

    Vertical rays are tilted by 1e-5, so that they have a plane of reference, and those into the beam turned by as much.
    """
    share, mu, phi = np.broadcast_arrays(*(np.asarray(a, float) for a in (share, mu, phi)))
    flat = [
        Slab(1.0, 1.0, None).rays(s, m, p) for s, m, p in
        zip(share.ravel(), np.clip(mu, -1 + 5e-11, 1 - 5e-11).ravel(), phi.ravel() + 1e-9, strict=True)
    ]  # fmt: skip
    origins, sights = (np.array(a).reshape(*mu.shape, 3) for a in zip(*flat, strict=True))
    return origins, sights


# Rayleigh slabs, polarised: Natraj, Li & Yung (2009), ApJ 691, 1909, who corrected Coulson, Dave & Sekera (1960)

CDS_DEPTHS, CDS_ALBEDOS = ("0.05", "0.25", "1"), (0.0, 0.25, 0.8)


def cds(reference: Path, parameter: str, upwards: bool, tau: str) -> tuple[Array, Array, Array]:
    """Beam cosines (7,), cosines (16,), values (albedo, mu0, mu, phi)."""
    path = reference / "rayleigh_slab_cds" / f"{parameter}_{'UP' if upwards else 'DN'}_TAU_{tau}.txt"
    lines = [line.split() for line in path.read_text().splitlines()]
    rows = np.array([[float(w) for w in words] for words in lines if len(words) == 9 and words[0] != "mu0"])
    rows = rows.reshape(3, 7, 16, 9)
    return rows[0, :, 0, 0], rows[0, 0, :, 1], rows[..., 2:]


def cds_deviations(reference: Path, sun: int, tolerance: float) -> tuple[Array, Array]:
    """Deviations of I, Q and U as shares of I, (side, tau, albedo, mu, phi, 3), and the cosines."""
    # The tables' Q and U are ours with the other sign: their r is upright.
    expected = np.array([
        [
            np.stack([sign * cds(reference, name, up, tau)[2][:, sun] for name, sign in zip("IQU", (1, -1, -1))], -1)
            for tau in CDS_DEPTHS
        ]
        for up in (True, False)
    ])  # fmt: skip
    mu0, mu, _ = cds(reference, "I", True, "1")
    pairs = np.array(list(product([float(t) for t in CDS_DEPTHS], CDS_ALBEDOS)))
    scene, wavelengths = slabs(float(mu0[sun]), pairs[:, 0], pairs[:, 1], Rayleigh())
    origin, sight = rays(
        np.array([0.0, 1.0])[:, None, None], np.stack([mu, -mu])[:, :, None], np.radians(30.0 * np.arange(7))
    )
    answer = skyscatter.radiance(scene, origin, sight, wavelengths, stokes=True, tolerance=tolerance)
    found = answer.stokes[..., :3].reshape(2, 16, 7, 3, 3, 3).transpose(0, 3, 4, 1, 2, 5)
    return (found - expected) / expected[..., :1], mu


def cds_report(off: Array, mu: Array, sun: int) -> None:
    worst = np.abs(off).max(axis=(0, 2, 4))  # (tau, mu, 3)
    for tau, row in zip(CDS_DEPTHS, worst, strict=True):
        classes = {"0.02": row[0], "0.06": row[1], "0.1 and more": row[2:].max(axis=0)}
        text = "; ".join(f"mu {name}: " + " ".join(f"{100 * v:.4f}" for v in values) for name, values in classes.items())
        print(f"CDS sun {sun} tau {tau}, largest deviation of I, Q, U in % of I: {text}")


@pytest.mark.parametrize("sun", [1, 5])
def test_corrected_coulson_tables_quickly(sun: int, reference: Path) -> None:
    """All directions of three depths and three albedos under one Sun, on a coarser grid than in the slow test."""
    off, mu = cds_deviations(reference, sun, 5e-4)
    cds_report(off, mu, sun)
    assert np.abs(off[:, :2]).max() < 1e-3
    # In the thick slab, at grazing angles, light comes from the outermost part, between the first two nodes.
    assert np.abs(off[:, 2, :, 1:]).max() < 2e-3
    assert np.abs(off[:, 2, :, 0]).max() < 5e-3


@SLOW
@pytest.mark.parametrize("sun", range(7))
def test_corrected_coulson_tables_to_a_thousandth(sun: int, reference: Path) -> None:
    """I to 0.1 %, Q and U to 0.1 % of I, in all rows but the most grazing ones of the thick slab."""
    off, mu = cds_deviations(reference, sun, FINEST)
    cds_report(off, mu, sun)
    assert np.abs(off[..., 1:, :, :]).max() < 1e-3
    assert np.abs(off[:, :2]).max() < 1e-3
    # At mu = 0.02 and thickness 1 light comes from 50 optical depths, all from the outermost fiftieth of the slab.
    assert np.abs(off[:, 2, :, 0]).max() < 2e-3


# Spheroids, polarised: Siewert (2000), JQSRT 64, 227, problem IIA


def greek(reference: Path) -> GreekPhase:
    """Randomly oriented spheroids of Kuik, de Haan & Hovenier (1992)."""
    rows = {}
    for line in (reference / "siewert2000_problem_IIA" / "greek_coefficients.csv").read_text().splitlines()[1:]:
        name, *values = line.split(",")
        rows[name.split("(")[0]] = tuple(float(v) for v in values)
    return GreekPhase(**rows)


@pytest.mark.parametrize("tolerance", [5e-4, pytest.param(FINEST, marks=SLOW)])
def test_siewert_problem_2a(tolerance: float, reference: Path) -> None:
    """I and Q at all depths and directions but the horizontal, at both azimuths."""
    depths = np.array([0.0, 0.125, 0.25, 0.5, 0.75, 0.875, 1.0])
    expected = np.empty((2, 7, 20, 2))
    for a, (azimuth, tables) in enumerate({0: ("table2_I", "table3_Q"), 180: ("table8_I", "table9_Q")}.items()):
        for k, name in enumerate(tables):
            path = reference / "siewert2000_problem_IIA" / f"{name}_az{azimuth}.csv"
            rows = np.loadtxt(path, delimiter=",", skiprows=1)
            rows = rows[rows[:, 0] != 0]
            expected[a, :, :, k] = rows[:, 1:].T
    mu = -rows[:, 0]  # cosines of travel, positive downwards in the tables
    slab = Slab(1.0, 0.973527, greek(reference), 0.6)
    origin, sight = rays(depths[:, None], mu, np.array([0.0, np.pi])[:, None, None])
    answer = skyscatter.radiance(slab.scene(), origin, sight, [WAVELENGTH], stokes=True, tolerance=tolerance)
    lit = expected[..., 0] > 0  # no light comes down at the top or up at the bottom
    off = (answer.stokes[..., 0, :2] - expected)[lit] / expected[..., :1][lit]
    worst = np.abs(off).max(axis=0)
    print(f"Siewert IIA, tolerance {tolerance}: largest deviation of I and Q in % of I {100 * worst}, "
          f"median {100 * np.median(np.abs(off), axis=0)}")  # fmt: skip
    assert lit.sum() == 2 * (7 * 20 - 2 * 10)
    assert np.all(worst < max(4 * tolerance, 1e-3))
    assert np.all(np.median(np.abs(off), axis=0) < 3e-4)


# Rayleigh at the top of the atmosphere, polarised: the tables with which 6SV1 was validated


@pytest.mark.parametrize("tolerance", [2e-3, pytest.param(5e-4, marks=SLOW)])
def test_rayleigh_reflectance_of_6sv(tolerance: float, reference: Path) -> None:
    """Kotchenova et al. (2006), Appl. Opt. 45, 6762: agreement of 6SV with Monte Carlo and Coulson 0.4 to 0.6 %."""
    with open(reference / "rayleigh_toa_6sv_validation" / "reflectance.csv") as file:
        table = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    deviations = []
    for sza in sorted({row["sza_deg"] for row in table}):
        under = [row for row in table if row["sza_deg"] == sza]
        kinds = sorted({(row["tau"], row["lambert_albedo"]) for row in under})
        pairs = np.array(kinds)
        beam_mu = float(np.cos(np.radians(sza)))
        scene, wavelengths = slabs(beam_mu, pairs[:, 0].squeeze(), pairs[:, 1].squeeze(), Rayleigh())
        mu = np.cos(np.radians([row["vza_deg"] for row in under]))
        phi = np.radians([row["relative_azimuth_deg_vsmartmom"] for row in under])
        answer = skyscatter.radiance(scene, *rays(0.0, mu, phi), wavelengths, stokes=True, tolerance=tolerance)
        kind = [kinds.index((row["tau"], row["lambert_albedo"])) for row in under]
        found = answer.radiance[np.arange(len(under)), kind] / beam_mu  # the beam's flux is pi
        expected = np.array([row["reflectance"] for row in under])
        off = found / expected - 1
        deviations += list(off)
        for pair in kinds:
            here = np.array([k == kinds.index(pair) for k in kind])
            print(f"6SV sza {sza} tau, albedo {pair}: largest {100 * np.abs(off[here]).max():.3f} %, "
                  f"mean {100 * off[here].mean():+.3f} % of {here.sum()}")  # fmt: skip
    deviations = np.abs(deviations)
    print(f"6SV: median {100 * np.median(deviations):.4f} %, largest {100 * deviations.max():.3f} %")
    assert len(deviations) == len(table)
    assert deviations.max() < 6e-3
    assert np.median(deviations) < 1e-3
