"""Skies for three.js, rendered by its own package in a browser: against the field, and against our own look-ups.

Two things are apart.  What the package makes of the files is what `bruneton.Layout` says: 0.5 %, which are single
precision of positions (half a metre) and of texture units (8 bits between two texels).  What the files hold of the sky:
half of all directions within 1 % by day (3 % on Mars) and 10 % in twilight, where the Suns of two columns are 1 to 2
degrees apart and the light of one is several times that of the other.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from threesky import bundle, rendered

import skyscatter
from skyscatter.geometry.vectors import direction_from_azimuth_elevation
from skyscatter.image.exr import _open
from skyscatter.solvers.engines import three
from skyscatter.solvers.engines.bruneton import MU_S_SIZE, MU_SIZE, NU_SIZE, R_SIZE, cornette_shanks, rayleigh
from skyscatter.solvers.engines.textures import Source, light_of, rays_of

Array = NDArray[np.float64]
pytestmark = pytest.mark.slow
WAVELENGTHS = [420.0, 480.0, 550.0, 620.0, 680.0]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
DAY, TWILIGHT = (60.0, 20.0, 2.0), (-3.5,)
#: Azimuth and elevation of the middle of pictures, the Sun in the south; altitudes [m].
VIEWS, ALTITUDES = ((180.0, 20.0), (90.0, 45.0), (0.0, 8.0)), (100.0, 10e3)


#: Of the sky's luminance by day.  On Mars much of what is seen is its dust's forward peak, narrower than textures hold.
DAY_MEDIAN = {"earth": 0.01, "mars": 0.03}


class Seen(NamedTuple):
    planet: str
    source: Source
    made: dict[str, Any]
    folder: Path
    cases: list[dict[str, Any]]
    found: list[dict[str, Any]]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    bundle(folder)
    return folder


@pytest.fixture(scope="module", params=["earth", "mars"])
def seen(request: pytest.FixtureRequest, page: Path) -> Seen:
    scene = skyscatter.load_model(request.param).scene()
    field = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=three.needed_suns(scene.medium), tolerance=0.03)
    made = field.export("three", page / "sky")
    cases = [
        {
            "altitude": altitude, "fov": 60.0, "elevation": elevation,
            "sun": direction_from_azimuth_elevation(180.0, elevation).tolist(),
            "look": direction_from_azimuth_elevation(*view).tolist(),
        }
        for altitude in ALTITUDES for elevation in DAY + TWILIGHT for view in VIEWS
    ]  # fmt: skip
    # From space, towards the day side's limb and the ground.
    high = 2 * (made["atmosphere"]["topRadius"] - made["atmosphere"]["bottomRadius"])
    cases += [{**case, "altitude": high, "look": [0.0, -0.8, -0.6]} for case in cases[: len(DAY) * len(VIEWS)]]
    return Seen(request.param, Source.of(field, three._layout(field)), made, page / "sky", cases, rendered(page, cases))


def four_numbers(seen: Seen, case: dict[str, Any], found: dict[str, Any]) -> tuple[Array, Array, Array, Array]:
    """r, mu, mu_s and nu of every pixel, of where its ray enters the textures; mu is nan beside the air."""
    d, sun, layout = np.array(found["directions"]), np.array(case["sun"]), seen.source.layout
    origin = np.array([0.0, 0.0, layout.bottom + case["altitude"]])
    r = np.full(len(d), origin[2])
    if origin[2] > layout.top:
        along = d @ origin
        square = along**2 - origin @ origin + layout.top**2
        enter = np.where((square > 0) & (along < 0), -along - np.sqrt(np.maximum(square, 0)), np.nan)
        points = origin + enter[:, None] * d
        mu, mu_s = (np.einsum("nk,nk->n", points, d) / layout.top, points @ sun / layout.top)
        return np.full(len(d), layout.top), mu, mu_s, d @ sun
    return r, d[:, 2], np.full(len(d), sun[2]), d @ sun


def luminances(seen: Seen, found: dict[str, Any]) -> Array:
    """What the browser rendered, in linear sRGB [cd m-2]."""
    return np.array(found["pixels"]).reshape(-1, 4)[:, :3] * float(seen.made["cd_per_m2_of_1"])


def texture(seen: Seen, name: str) -> Array:
    """A scattering texture of the folder (r, mu, mu_s, nu, channel) [cd m-2]."""
    _, channels = _open(seen.folder / f"{name}.exr")
    image = np.stack([channels[c] for c in "RGB"], axis=-1)[::-1].astype(float)
    sky = seen.made["atmosphere"]["skyRadianceToLuminance"]["x"]
    return np.moveaxis(image.reshape(R_SIZE, MU_SIZE, NU_SIZE, MU_S_SIZE, 3), 2, 3) * sky


def test_the_package_looks_up_what_we_do(seen: Seen) -> None:
    a, b = texture(seen, "scattering"), texture(seen, "single_mie_scattering")
    g, layout, off = seen.made["atmosphere"]["miePhaseFunctionG"], seen.source.layout, []
    for case, found in zip(seen.cases, seen.found, strict=True):
        r, mu, mu_s, nu = four_numbers(seen, case, found)
        into = np.isfinite(mu) & (np.abs(mu + layout.horizon(r) / r) > 0.003)  # not the horizon itself
        numbers = tuple(x[into] for x in (r, mu, mu_s, nu))
        own = layout.scattering_at(a, *numbers) * rayleigh(nu[into])[:, None]
        own += layout.scattering_at(b, *numbers) * cornette_shanks(g, nu[into])[:, None]
        off.append((np.abs(luminances(seen, found)[into] - own) / np.abs(own).max(axis=1, keepdims=True)).max(axis=1))
    print("look-ups: median", np.median(np.concatenate(off)), "greatest", np.concatenate(off).max())
    assert np.concatenate(off).max() < 0.005


def test_skies_are_those_of_the_field(seen: Seen) -> None:
    by_sun: dict[tuple[float, float], list[Array]] = {}
    for case, found in zip(seen.cases, seen.found, strict=True):
        r, mu, mu_s, nu = four_numbers(seen, case, found)
        into = np.isfinite(mu)
        origins, directions = rays_of(*(x[into] for x in (r, mu, mu_s, nu)))
        true = np.add.reduce(light_of(seen.source, origins, directions)) @ LUMINANCE
        off = np.abs(luminances(seen, found)[into] @ LUMINANCE / np.where(true > 1e-6, true, np.nan) - 1)
        by_sun.setdefault((case["altitude"], case["elevation"]), []).append(off[np.isfinite(off)])
    for (altitude, elevation), parts in by_sun.items():
        off = np.concatenate(parts)
        middle, most = np.median(off), np.percentile(off, 95)
        print(f"{altitude:8.0f} m, Sun {elevation:5.1f}: median {middle:.4f}, 95 % {most:.4f}, worst {off.max():.3f}")
        assert middle < (DAY_MEDIAN[seen.planet] if elevation > 0 else 0.1)


def test_light_on_the_ground_is_that_of_the_field(seen: Seen) -> None:
    """By the shader that lights ground: the Sun within 1 %, 3 % for a low one, whose disk it takes for a point.

    The sky within 3 %: its texture has 64 Suns, 2 degrees apart, and 16 altitudes.
    """
    field, source, unit = seen.source.field, seen.source, float(seen.made["cd_per_m2_of_1"])
    for case, found in list(zip(seen.cases, seen.found, strict=True))[: len(DAY) * len(VIEWS) : len(VIEWS)]:
        own = field.fluxes(case["altitude"], sun_elevation_deg=case["elevation"])
        off = [
            np.array(made) @ LUMINANCE * unit / (spectrum @ source.rgb @ LUMINANCE) - 1
            for made, spectrum in ((found["beam"], own.direct), (found["sky"], own.diffuse_down))
        ]
        print(f"Sun {case['elevation']:5.1f}: sunlight off by {off[0]:.4f}, skylight by {off[1]:.4f}")
        assert abs(off[0]) < (0.01 if case["elevation"] > 10 else 0.03)
        assert abs(off[1]) < 0.03


def test_the_folder_says_how_far_it_is_from_the_field(seen: Seen) -> None:
    assert json.loads((seen.folder / "atmosphere.json").read_text()) == seen.made
    by_day = [row["median"] for row in seen.made["deviations"] if row["sun_elevations_deg"][0] >= -1]
    assert max(by_day) < DAY_MEDIAN[seen.planet]
