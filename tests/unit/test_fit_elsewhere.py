"""Fits give the same numbers whatever runs their model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.inversion import fit_each, radiance_table, with_values
from skyscatter.tasks import engine_for

NAME = "aerosol.optical_depth"
FREE = {NAME: (0.0, 0.5), "calibration": (0.8, 1.2)}


def seen(depth: float, suns: tuple[float, ...] = (20.0, 40.0)) -> Any:
    """Two directions under each of some Suns, one table."""
    rows: list[tuple[float, float, float]] = []
    for sun in suns:
        scene = with_values(skyscatter.load_model("earth-simple"), {NAME: depth}).scene(
            sun_elevation_deg=sun, sun_azimuth_deg=90
        )
        low = [np.cos(np.radians(20)), 0, np.sin(np.radians(20))]
        light = skyscatter.radiance(scene, scene.observer.position, [[0, 0, 1], low], [550, 650], solver="single")
        rows += [(sun, e, *light.radiance[k]) for k, e in enumerate((90.0, 20.0))]
    table = np.array(rows)
    return radiance_table(
        np.repeat(90.0, 2 * len(table)), np.repeat(table[:, 1], 2), np.tile([550.0, 650.0], len(table)),
        table[:, 2:].ravel(), noise=0.02, sun_elevation_deg=np.repeat(table[:, 0], 2), sun_azimuth_deg=90.0,
    )  # fmt: skip


def same(one: Any, two: Any) -> None:
    np.testing.assert_array_equal(one.z, two.z)
    np.testing.assert_array_equal(one.covariance_z, two.covariance_z)
    np.testing.assert_array_equal(one.fitted, two.fitted)


def test_parts_of_the_data() -> None:
    data = seen(0.08)
    parts = data.parts()
    assert len(parts) == 2
    assert sorted(np.concatenate([rows for rows, _ in parts])) == list(range(data.values.size))
    wanted = skyscatter.fit("earth-simple", data, FREE, solver="single")
    with engine_for(2) as engine:
        same(skyscatter.fit("earth-simple", data, FREE, solver="single", executor=engine), wanted)
        one, two = seen(0.08, (20.0,)), seen(0.08, (40.0,))
        apart = skyscatter.fit("earth-simple", [one, two], FREE, solver="single")
        same(skyscatter.fit("earth-simple", [one, two], FREE, solver="single", executor=engine), apart)
    assert wanted.estimate[NAME] == pytest.approx(0.08, rel=0.02)  # the data are the model's own


@pytest.mark.slow  # two walks, and the runs of the emulators
def test_a_posterior_and_its_emulator() -> None:
    pytest.importorskip("emcee")
    given: dict[str, Any] = {"solver": "single", "method": "posterior", "steps": 60, "seed": 3}
    wanted = skyscatter.fit("earth-simple", seen(0.08), FREE, **given)
    found = skyscatter.fit("earth-simple", seen(0.08), FREE, executor=2, **given)
    np.testing.assert_array_equal(found.samples_z, wanted.samples_z)
    assert found.diagnostics == wanted.diagnostics


@pytest.mark.slow  # nine fits; the example of fit_each is quick
def test_fits_of_each() -> None:
    data = [seen(depth) for depth in (0.05, 0.1, 0.2)]
    shares: list[float] = []
    wanted = [skyscatter.fit("earth-simple", some, FREE, solver="single") for some in data]
    for executor in (None, 2):
        found = fit_each("earth-simple", data, FREE, solver="single", executor=executor, progress=shares.append)
        for one, two in zip(found, wanted, strict=True):
            same(one, two)
    assert shares == [1 / 3, 2 / 3, 1.0] * 2


def test_one_that_does_not_converge_spoils_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    from skyscatter.inversion import ensemble

    def rough(model: Any, data: Any, free: Any, **_: Any) -> Any:
        if data == 1:
            raise ConvergenceError("too rough")
        return data

    monkeypatch.setattr(ensemble, "fit", rough)
    found = fit_each("earth-simple", [0, 1, 2], FREE)
    assert found[::2] == [0, 2]
    assert isinstance(found[1], ConvergenceError)
    with pytest.raises(DomainError, match="resume"):
        fit_each("earth-simple", [0], FREE, resume="a.npz")
