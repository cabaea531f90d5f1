"""A solution by orders of scattering is kept while it is made, and goes on to the same bits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.cli.main import main
from skyscatter.errors import DomainError
from skyscatter.solvers import cycles, mixing
from skyscatter.solvers.fluxes import Work
from skyscatter.solvers.run import Interrupted
from skyscatter.solvers.series import Series
from skyscatter.solvers.state import Checkpoint
from skyscatter.solvers.sweeps import Sweeper

WAVELENGTHS = [450.0, 650.0]
HOW: dict[str, Any] = {"sun_elevations_deg": (30.0, 40.0), "tolerance": 0.05}


@pytest.fixture(scope="module")
def scene() -> Any:
    return skyscatter.load_model("earth-simple").scene(sun_elevation_deg=35.0)


class Strikes:
    """Ctrl-C when something is done for the n-th time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, home: Any, name: str, number: int) -> None:
        self.left, self.did = number, getattr(home, name)
        monkeypatch.setattr(home, name, lambda *given, **options: self(*given, **options))

    def __call__(self, *given: Any, **options: Any) -> Any:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt
        return self.did(*given, **options)


@pytest.mark.parametrize("after", [4, 7])
def test_orders_go_on(scene, tmp_path, monkeypatch, after):
    with monkeypatch.context() as patch:
        swept = Strikes(patch, Sweeper, "_sweep", -1)
        whole = skyscatter.solve(scene, WAVELENGTHS, **HOW)
    assert whole.coarse.sums.orders == 4  # so that it is struck before its last one, and the finer one after its first
    kept = tmp_path / "field.zarr"
    with monkeypatch.context() as patch:
        Strikes(patch, Sweeper, "_sweep", after)
        with pytest.raises(KeyboardInterrupt):
            skyscatter.solve(scene, WAVELENGTHS, **HOW, checkpoint=kept)
    made = Strikes(monkeypatch, Sweeper, "_sweep", -1)
    found = skyscatter.solve(scene, WAVELENGTHS, **HOW, resume=kept)
    # What was swept before the stroke is not swept again.
    assert made.left == swept.left + (after - 1)
    for name in ("fine", "coarse"):
        one, other = (getattr(field, name).sums for field in (whole, found))
        np.testing.assert_array_equal(one.moments, other.moments)
        np.testing.assert_array_equal(one.flux, other.flux)
        assert one.orders == other.orders
    with pytest.raises(DomainError, match="was begun with other tolerance"):
        skyscatter.solve(scene, WAVELENGTHS, **HOW | {"tolerance": 0.04}, resume=kept)


def test_orders_that_are_summed_where_cycles_do_not_settle_go_on(scene, tmp_path, monkeypatch):
    """Cycles that were kept and gave up are no beginning of a sum; a sum that was struck goes on as one."""
    monkeypatch.setattr(mixing, "MOST_STEPS", 1)
    whole = skyscatter.solve(scene, WAVELENGTHS, **HOW)
    kept = tmp_path / "field.zarr"
    with monkeypatch.context() as patch:
        Strikes(patch, Series, "add", whole.coarse.sums.orders + 1)  # the second of the finer sum
        with pytest.raises(KeyboardInterrupt):
            skyscatter.solve(scene, WAVELENGTHS, **HOW, checkpoint=kept)
    begun = Strikes(monkeypatch, cycles, "_cycles", -1)
    found = skyscatter.solve(scene, WAVELENGTHS, **HOW, resume=kept)
    assert begun.left == -1  # no cycle more
    np.testing.assert_array_equal(found.fine.sums.moments, whole.fine.sums.moments)


def test_a_picture_keeps_its_field_before_the_first_ray(scene, tmp_path, monkeypatch):
    camera, kept = skyscatter.Panorama(width=8, height=4), tmp_path / "sky.zarr"
    with monkeypatch.context() as patch:
        Strikes(patch, Sweeper, "_sweep", 3)
        with pytest.raises(Interrupted):
            skyscatter.render(scene, camera, WAVELENGTHS, solver=skyscatter.Orders(tolerance=0.05), checkpoint=kept)
    whole = skyscatter.render(scene, camera, WAVELENGTHS, solver=skyscatter.Orders(tolerance=0.05))
    made = Strikes(monkeypatch, Series, "first", -1)
    found = skyscatter.render(scene, camera, WAVELENGTHS, solver=skyscatter.Orders(tolerance=0.05), resume=kept)
    assert made.left == -1  # the coarser one goes on
    np.testing.assert_array_equal(found.radiance, whole.radiance)
    np.testing.assert_array_equal(found.standard_error, whole.standard_error)


def test_fluxes_go_on(scene, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    box = "--altitude 0,1km,12km --sun-elevation 30,35,40 --wavelengths 450,650 --tolerance 5% -q"
    command = ["flux", "earth-simple", *box.split()]
    monkeypatch.setattr("skyscatter.solvers.fluxes.RAYS", 2000)
    assert main([*command, "-o", "whole.csv"]) == 0
    with monkeypatch.context() as patch:
        Strikes(patch, Work, "keep", 3)
        assert main([*command, "-o", "flux.csv"]) == 130
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flux.csv.partial.zarr", "whole.csv"]
    assert "go on with:\n  skyscatter flux earth-simple" in capsys.readouterr().err
    made = Strikes(monkeypatch, Sweeper, "_sweep", -1)
    assert main([*command, "-o", "flux.csv", "--resume", "flux.csv.partial.zarr"]) == 0
    assert made.left == -1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flux.csv", "whole.csv"]
    assert (tmp_path / "flux.csv").read_text() == (tmp_path / "whole.csv").read_text()


def test_fluxes_of_other_places_are_made_anew(tmp_path):
    checkpoint = Checkpoint(tmp_path / "a.zarr", 3600)
    field = skyscatter.solve(skyscatter.load_model("earth-simple").scene(), [550.0], **HOW, checkpoint=checkpoint)
    first = field.fluxes(0.0, sun_elevation_deg=35.0, checkpoint=checkpoint)
    told: list[float] = []
    other = field.fluxes(1e3, sun_elevation_deg=35.0, progress=told.append, checkpoint=checkpoint)
    assert told[-1] == 1.0
    assert other.net != first.net
    np.testing.assert_array_equal(other.net, field.fluxes(1e3, sun_elevation_deg=35.0).net)


def test_the_share_of_a_series_is_that_of_its_orders():
    one = np.ones((1, 1, 1, 1))
    series = Series.first(one, np.ones((1, 2, 1, 1)))
    shares = []
    for order in range(2, 30):
        series = series.add(one * 0.7**order, np.full((1, 2, 1, 1), 0.7**order), True)
        shares.append(series.share(1e-6))
        if series.left < 1e-6:
            break
    assert shares[-1] == 1.0
    # Told after a few orders, within a factor of two.
    ratio = np.arange(2, 2 + len(shares)) / (1 + len(shares)) / np.maximum(shares, 1e-3)
    assert np.all((ratio[2:] > 0.5) & (ratio[2:] < 2)), ratio
