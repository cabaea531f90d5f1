"""The ways to walk through a medium of three dimensions agree, with each other and with their own error bars."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest
from asking import asked
from nebulae import GREY, dust, lines_through
from significance import assert_agrees

from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.media.shapes import GaussianSphere, Shell, Sphere
from skyscatter.solvers.base import Answer
from skyscatter.solvers.run import radiance
from skyscatter.space import SpaceScene, View
from skyscatter.spectra.table import SpectralTable

WAVELENGTHS = (450.0, 550.0, 650.0)


def shell(tau: float, g: float) -> SpaceScene:
    """A hollow ball of dust with a star in the hole; optical depth `tau` outwards at the middle wavelength.

    The hole keeps plain walks, which know nothing of the star, at a finite variance.
    """
    extinction = SpectralTable(wavelengths=WAVELENGTHS, values=(1.5 * tau / 0.6, tau / 0.6, 0.6 * tau / 0.6))
    albedo = SpectralTable(wavelengths=WAVELENGTHS, values=(0.5, 0.6, 0.8))
    component = Component(name="dust", density=Shell(inner=0.4, outer=1.0), optics=dust(extinction, albedo, g))
    return SpaceScene(
        medium=Medium(components=(component,)), stars=(PointStar(spectrum=GREY),), view=View(distance=100.0)
    )


def mixture(tau: float) -> SpaceScene:
    """Two sorts of dust, one of which glows, two stars outside, parallel light and a background."""
    albedo = SpectralTable(wavelengths=WAVELENGTHS, values=(0.5, 0.6, 0.8))
    core = GaussianSphere(width=0.3, position=(0.2, 0.1, 0.0))
    components = (
        Component(name="dust", density=Sphere(radius=1.0), optics=dust(0.7 * tau, albedo, 0.5, angstrom_exponent=2.0)),
        Component(name="core", density=core, optics=dust(tau, 0.9), emission=0.01),
    )
    half = SpectralTable(wavelengths=(500.0,), values=(0.5,))
    return SpaceScene(
        medium=Medium(components=components),
        stars=(PointStar(name="a", position=(2.0, 0, 0), spectrum=GREY), PointStar(name="b", position=(-0.5, 1.8, 0.4), spectrum=half)),  # noqa: E501
        parallel=(ParallelLight(direction=(1.0, 0, 0), irradiance=0.1),), background=0.01, view=View(distance=100.0),
    )  # fmt: skip


#: Name -> keyword arguments, and how many times the samples of the forced walks it needs for errors alike.
WAYS: dict[str, tuple[dict[str, str], int]] = {
    "forced": ({"transmittance": "quadrature"}, 1),
    "forced, ratio": ({"transmittance": "ratio"}, 2),
    "forced, residual ratio": ({"transmittance": "residual-ratio"}, 2),
    "free flight": ({"sampling": "free-flight"}, 6),
    # Plain walks through the deepest dust have a tail, which fewer do not see: their error bar then is too small.
    "delta": ({"sampling": "delta"}, 24),
    "delta, residual ratio": ({"sampling": "delta", "transmittance": "residual-ratio"}, 6),
}


def blind(scene: SpaceScene, lines: tuple[Any, Any], options: dict[str, str], samples: int) -> Any:
    """Wavelengths at which a way says before it starts that its error bars are too small: (wavelength,)."""
    found = []
    for wavelength in WAVELENGTHS:
        given = asked("path", samples=samples, max_order=1, **options)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            radiance(scene, *(line[:1] for line in lines), (wavelength,), **given)
        found.append(any("too small" in str(one.message) for one in said))
    return np.array(found)


@cache
def compare(kind: str, tau: float, g: float, rays: int, samples: int) -> dict[str, tuple[Any, Any]]:
    """Mean light of rays through a scene, and its error, by every way: (wavelength,) each."""
    scene = mixture(tau) if kind == "mixture" else shell(tau, g)
    lines = lines_through(np.random.default_rng(3), rays)
    found = {}
    for number, (name, (options, factor)) in enumerate(WAYS.items()):
        # Other seeds: with the same one ways would share their first numbers.
        given = asked("path", samples=factor * samples, seed=number, **options)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "light comes through")
            answer = radiance(scene, *lines, WAVELENGTHS, **given)
        error = np.sqrt((answer.standard_error**2).sum(axis=0)) / rays
        # A way that says it sees too little is not judged there: its error is as good as endless.
        error[blind(scene, lines, options, factor * samples)] = np.inf
        found[name] = answer.radiance.mean(axis=0), error
    return found


def check_ways(kind: str, tau: float, g: float, rays: int, samples: int, most: float) -> None:
    found = compare(kind, tau, g, rays, samples)
    mean, error = found["forced"]
    for name, (value, spread) in found.items():
        sigma = np.hypot(spread, error)
        print(f"{kind} tau {tau:g} g {g:g} {name}: {value} +- {spread / value} z {((value - mean) / sigma).round(2)}")
    assert np.max(error / mean) < most
    for name, (value, spread) in found.items():
        if name != "forced":
            # The reddest wavelength is the clearest: there the plain ways have to be of use, too.
            assert spread[-1] / value[-1] < 2 * most, name
            # Over many rays the errors are as good as Gaussian.
            assert_agrees(value, mean, np.hypot(spread, error), freedom=np.inf)


@pytest.mark.parametrize(
    ("kind", "tau", "g"),
    [
        ("shell", 0.1, 0.5),
        ("shell", 1.0, 0.0),
        pytest.param("shell", 10.0, 0.5, marks=pytest.mark.slow),
        ("mixture", 1.0, 0.5),
    ],
)
def test_ways_agree(kind: str, tau: float, g: float) -> None:
    check_ways(kind, tau, g, 60, 32, 0.08)


@pytest.mark.slow
@pytest.mark.parametrize("g", [0.0, 0.5])
@pytest.mark.parametrize(
    ("kind", "tau"),
    [("shell", 0.1), ("shell", 1.0), ("shell", 10.0), *(("mixture", t) for t in (0.1, 1.0, 10.0, 30.0))],
)
def test_ways_agree_closely(kind: str, tau: float, g: float) -> None:
    check_ways(kind, tau, g, 500, 256, 0.01)


@pytest.mark.parametrize(
    "options", [{}, {"sampling": "free-flight"}, {"sampling": "delta"}], ids=["forced", "flight", "delta"]
)
def test_each_wavelength_alone_equals_all_together(options: dict[str, Any]) -> None:
    """Spectral sampling from all wavelengths at once is as right as walks of one wavelength each."""
    scene, lines = shell(1.0, 0.5), lines_through(np.random.default_rng(4), 100)
    samples = 32 if not options else 256
    together = radiance(scene, *lines, WAVELENGTHS, **asked("path", samples=samples, seed=1, **options))
    for i, wavelength in enumerate(WAVELENGTHS):
        alone = radiance(scene, *lines, (wavelength,), **asked("path", samples=samples, seed=2 + i, **options))
        a, b = together.radiance[:, i].mean(), alone.radiance[:, 0].mean()
        errors = [np.sqrt((e**2).sum()) / 100 for e in (together.standard_error[:, i], alone.standard_error[:, 0])]
        print(
            f"{options} {wavelength:g} nm: together {a:.4e} ({errors[0] / a:.2%}), alone {b:.4e} ({errors[1] / b:.2%})"
        )
        assert errors[0] < 0.05 * a
        assert_agrees(a, b, np.hypot(*errors), freedom=np.inf)


@pytest.mark.parametrize(
    "options", [{}, {"transmittance": "ratio"}, {"sampling": "free-flight"}, {"sampling": "delta"}]
)
def test_same_seed_same_bits(options: dict[str, Any]) -> None:
    scene, lines = mixture(1.0), lines_through(np.random.default_rng(5), 40)

    def run(seed: int, threads: int) -> Answer:
        return radiance(
            scene, *lines, WAVELENGTHS, threads=threads, orders=3, **asked("path", samples=16, seed=seed, **options)
        )

    one, two, other = run(7, 1), run(7, 2), run(8, 2)
    np.testing.assert_array_equal(one.radiance, two.radiance)
    np.testing.assert_array_equal(one.standard_error, two.standard_error)
    for name in one.layers:
        np.testing.assert_array_equal(one.layers[name], two.layers[name])
    assert np.any(one.radiance != other.radiance)


@pytest.mark.parametrize(
    "options", [{}, {"sampling": "free-flight"}, {"sampling": "delta"}], ids=["forced", "flight", "delta"]
)
def test_error_bars_are_the_spread_over_seeds(options: dict[str, Any]) -> None:
    """Variance over seeds against the mean squared error bar, over rays: their ratio is 1."""
    scene, lines = shell(1.0, 0.5), lines_through(np.random.default_rng(6), 60)
    seeds, samples = 24, 32 if not options else 128
    runs = [
        radiance(scene, *lines, (550.0,), **asked("path", samples=samples, seed=50 + k, **options))
        for k in range(seeds)
    ]
    values = np.array([run.radiance[:, 0] for run in runs])
    stated = np.array([run.standard_error[:, 0] for run in runs])
    hit = np.all(values > 0, axis=0)
    assert hit.sum() > 40
    values, stated = values[:, hit], stated[:, hit]
    weight = 1 / values.mean(axis=0) ** 2
    ratio = np.sum(weight * values.var(axis=0, ddof=1)) / np.sum(weight * (stated**2).mean(axis=0))
    print(f"{options}: variance over seeds / squared error bar {ratio:.3f}")
    # 60 rays with 23 degrees of freedom each, the brightest of which count most: the ratio itself is uncertain by
    # some 10 %.
    assert 0.7 < ratio < 1.4
