"""Textures of precomputed scattering: where texels lie, how they are fitted and packed, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.cli.main import main
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.solvers.engines import three
from skyscatter.solvers.engines.bruneton import (
    IRRADIANCE_SIZE,
    MU_S_SIZE,
    MU_SIZE,
    NU_SIZE,
    R_SIZE,
    TRANSMITTANCE_SIZE,
    Layout,
    cornette_shanks,
    lookup,
    rayleigh,
)
from skyscatter.solvers.engines.textures import (
    Source,
    Textures,
    block_tridiagonal,
    fitted,
    light_of,
    rays_of,
    scattering_block,
    transmittance,
)

WAVELENGTHS = [450.0, 550.0, 650.0]
LAYOUT = Layout(6371e3, 6431e3, -0.2)


@pytest.fixture(scope="module")
def field() -> skyscatter.RadianceField:
    scene = skyscatter.load_model("earth-simple").scene()
    return skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=three.needed_suns(scene.medium), tolerance=0.05)


@pytest.fixture(scope="module")
def source(field: skyscatter.RadianceField) -> Source:
    return Source.of(field, three._layout(field))


def test_texels_lie_where_look_ups_find_them() -> None:
    radii = LAYOUT.radii()
    np.testing.assert_allclose(LAYOUT.share_of_radius(radii), np.linspace(0, 1, R_SIZE), atol=1e-9)
    shares = np.linspace(0, 1, MU_S_SIZE)
    # The inverse of a difference of nearly equal lengths near an overhead Sun: 1e-7 of them.
    np.testing.assert_allclose(LAYOUT.share_of_sun(LAYOUT.sun_cosines(shares)), shares, atol=1e-6)
    assert LAYOUT.sun_cosines(shares)[[0, -1]] == pytest.approx([-0.2, 1.0])
    for r in radii[1:]:
        mu = LAYOUT.scattering_mu(float(r))
        ground = np.arange(MU_SIZE) < MU_SIZE // 2
        rows = LAYOUT.share_of_scattering_mu(np.full(MU_SIZE, r), mu, ground) * (MU_SIZE - 1)
        # At the horizon, in the middle, rows gather and lengths are roots of small differences.
        np.testing.assert_allclose(rows[:-1], np.arange(MU_SIZE)[:-1], atol=2e-3)
    r = radii[7]
    mu = LAYOUT.transmittance_mu(float(r))
    assert mu[0] == 1.0
    assert mu[-1] == pytest.approx(-LAYOUT.horizon(r) / r)


def test_look_up_is_linear() -> None:
    x, y = np.meshgrid(np.arange(5.0), np.arange(7.0), indexing="ij")
    texture = np.stack([2 * x + 3 * y, x], axis=-1)
    found = lookup(texture, (np.array([0.3]), np.array([0.55])))
    np.testing.assert_allclose(found, [[2 * 1.2 + 3 * 3.3, 1.2]], rtol=1e-12)


def test_phase_functions_are_normalised() -> None:
    nu, weight = np.polynomial.legendre.leggauss(200)
    assert 2 * np.pi * weight @ rayleigh(nu) == pytest.approx(1, rel=1e-12)
    assert 2 * np.pi * weight @ cornette_shanks(0.8, nu) == pytest.approx(1, rel=1e-9)


def test_block_tridiagonal_against_the_whole_matrix() -> None:
    random = np.random.default_rng(3)
    blocks, n = 5, 3
    factor = random.normal(size=(blocks * n, blocks * n))
    near = np.abs(np.subtract.outer(np.arange(blocks), np.arange(blocks))) <= 1
    whole = np.kron(near, np.ones((n, n))) * (factor + factor.T) + 20 * np.eye(blocks * n)
    right = random.normal(size=(1, blocks, 1, n))
    cut = whole.reshape(blocks, n, blocks, n)
    diagonal = np.array([cut[k, :, k] for k in range(blocks)])[None, :, None]
    upper = np.array([cut[k, :, min(k + 1, blocks - 1)] for k in range(blocks)])[None, :, None]
    found = block_tridiagonal(diagonal, upper, right)
    np.testing.assert_allclose(found.ravel(), np.linalg.solve(whole, right.ravel()), rtol=1e-10)


def test_fit_leaves_what_is_right_and_mends_what_is_wrong() -> None:
    """Light that textures can hold is found again; begun a tenth too bright, it comes to within a fifth of that."""
    random, suns = np.random.default_rng(5), np.linspace(0, 1, 3 * (MU_S_SIZE - 1) + 1)
    a, b = 100 + 10 * random.random((2, MU_S_SIZE, NU_SIZE))
    nu = np.broadcast_to(np.linspace(-1, 1, 40), (1, suns.size, 40))
    shares = (np.repeat(suns, 40), np.tile((nu[0, 0] + 1) / 2, suns.size))
    both = lookup(np.stack([a, b], axis=-1), shares).reshape(1, suns.size, 40, 2)
    light = both[..., :1] * rayleigh(nu)[..., None] + both[..., 1:] * cornette_shanks(0.6, nu)[..., None]
    start = np.concatenate([a, b], axis=-1)[None, ..., None]
    day = np.full(suns.size, 0.5)
    np.testing.assert_allclose(fitted(suns, day, nu, light, start, 0.6), start, rtol=1e-9)
    mended = fitted(suns, day, nu, light, 1.1 * start, 0.6)
    made = lookup(np.moveaxis(mended.reshape(MU_S_SIZE, 2, NU_SIZE), 1, 2), shares).reshape(both.shape)
    again = made[..., :1] * rayleigh(nu)[..., None] + made[..., 1:] * cornette_shanks(0.6, nu)[..., None]
    assert np.abs(again / light - 1).max() < 0.02


def test_light_of_rays_is_that_of_the_field(field: skyscatter.RadianceField, source: Source) -> None:
    """Into the sky all of it, in three parts; towards the ground all but what the ground sends."""
    random = np.random.default_rng(2)
    r = np.full(30, LAYOUT.bottom + 3e3)
    mu, mu_s, azimuth = random.uniform(-1, 1, 30), random.uniform(0.0, 1, 30), random.uniform(0.3, np.pi, 30)
    nu = mu * mu_s + np.sqrt((1 - mu**2) * (1 - mu_s**2)) * np.cos(azimuth)
    origins, directions = rays_of(r, mu, mu_s, nu)
    np.testing.assert_allclose(np.einsum("nk,nk->n", origins, directions), r * mu, atol=1e-3)
    np.testing.assert_allclose(origins[:, 2], r * mu_s, rtol=1e-12)
    np.testing.assert_allclose(directions[:, 2], nu, atol=1e-9)
    found = light_of(source, origins, directions)
    own = field.radiance(origins, directions, sun_elevation_deg=90.0, parts=True)
    diffuse = (own.radiance - own.layers["direct"]) @ source.rgb
    sky = ~source.layout.hits_ground(r, mu)
    total = found.air + found.haze + found.multiple
    np.testing.assert_allclose(total[sky], diffuse[sky], rtol=1e-5)  # single precision within the kernels
    assert (total[~sky][:, 1] < diffuse[~sky][:, 1]).all()
    assert (found.air[:, 1] > 0).all()
    assert (found.haze[:, 1] > 0).all()
    assert (found.multiple[:, 1] > 0).all()


def test_rows_of_textures_give_the_sky_of_the_field(source: Source) -> None:
    """At the ground, between all texels: half of all directions by day within 1 %, 95 in 100 within 6 %.

    What two look-ups can hold: 8 angles, 32 Suns.  Measured 0.2 % and 2.5 %.
    """
    layout, r = source.layout, source.layout.bottom
    half = MU_SIZE // 2
    mu = np.maximum(layout.scattering_mu(r)[half:], 1e-7)
    a, b, higher = scattering_block(source, r, np.minimum(mu, 1.0))
    assert (higher < a)[..., 1].mean() > 0.9  # A is that and what air scatters once
    textures = np.zeros((2, MU_SIZE, MU_S_SIZE, NU_SIZE, 6))
    textures[:, half:] = np.concatenate([a, b], axis=-1)
    random, n = np.random.default_rng(1), 1000
    m, s = random.uniform(1e-4, 1, n), np.sin(np.radians(random.uniform(0, 90, n)))
    nu = np.clip(m * s + np.sqrt((1 - m**2) * (1 - s**2)) * np.cos(random.uniform(0, np.pi, n)), -1, 1)
    row = layout.share_of_scattering_mu(np.full(n, r), m, np.zeros(n, bool))
    found = lookup(textures, (np.zeros(n), row, layout.share_of_sun(s), (nu + 1) / 2))
    made = found[:, :3] * rayleigh(nu)[:, None] + found[:, 3:] * cornette_shanks(source.asymmetry, nu)[:, None]
    true = np.add.reduce(light_of(source, *rays_of(np.full(n, r), m, s, nu)))
    off = np.abs(made[:, 1] / true[:, 1] - 1)
    assert np.median(off) < 0.01
    assert np.percentile(off, 95) < 0.06


def test_transmittance_is_that_of_sunlight(field: skyscatter.RadianceField, source: Source) -> None:
    made = transmittance(source)
    assert made.shape == (*TRANSMITTANCE_SIZE, 3)
    layout = source.layout
    mu = layout.transmittance_mu(layout.bottom)[40]
    at = np.array([0.0, 0.0, layout.bottom])
    end = at + 3e6 * np.array([np.sqrt(1 - mu**2), 0, mu])
    share = skyscatter.transmittance(field.scene, at, end, WAVELENGTHS)
    own = (source.sunlight * share) @ source.rgb / (source.sunlight @ source.rgb)
    np.testing.assert_allclose(made[0, 40], own, rtol=1e-4)  # tables of columns against exact ones


def test_packing_puts_slices_above_each_other_from_below() -> None:
    sizes = (R_SIZE, MU_SIZE, MU_S_SIZE, NU_SIZE, 3)
    a = np.ones(sizes)
    a[2, 5, 7, 3] = 2.0
    b = np.full(sizes, 0.5)
    textures = Textures(np.zeros((*TRANSMITTANCE_SIZE, 3)), a, b, b, np.ones((*IRRADIANCE_SIZE, 3)))
    images, gain = three.packed(textures)
    image = images["scattering"]
    assert image.shape == (R_SIZE * MU_SIZE, NU_SIZE * MU_S_SIZE, 4)
    assert image.max() <= three.LARGEST
    assert np.log2(gain) % 1 == 0
    row, column = np.argwhere(image[..., 0] == image[..., 0].max())[0]
    assert (image.shape[0] - 1 - row, column) == (2 * MU_SIZE + 5, 3 * MU_S_SIZE + 7)
    assert images["transmittance"].min() > 0  # it is divided by
    assert image[0, 0, 3] == pytest.approx(0.5 * image[0, 0, 0])
    black = Textures(*(0 * x for x in textures))
    with pytest.raises(DomainError, match="black"):
        three.packed(black)


def test_what_cannot_be_exported_is_refused(field: skyscatter.RadianceField, tmp_path: Path) -> None:
    with pytest.raises(DomainError, match="choose three"):
        field.export("unity", tmp_path)
    scene = field.scene
    narrow = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(20, 40), tolerance=0.1)
    with pytest.raises(DomainError, match=r"sun_elevations_deg=\(-10.0, 90.0\)"):
        narrow.export("three", tmp_path)
    with pytest.raises(DomainError, match="textures have colours"):
        three.check_colours(np.array([500.0, 550.0, 600.0]))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "unity"], "choose one of three"),
        (["--wavelengths", "550"], "textures have colours"),
        (["-o", __file__], "is a file"),
        (["-o", f"{__file__}/deeper/down"], "is a file"),
        (["--tolerance", "x"], "tolerance"),
    ],
)
def test_command_refuses(words: list[str], said: str, capsys: Any) -> None:
    assert main(["export", "earth-simple", "-q", *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_an_export_that_fails_leaves_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Textures of one sky beside the parameters of another would be loaded, with a wrong brightness."""
    images = {name: np.full((2, 2, 4), 0.5) for name in ("transmittance", "scattering")}
    three.write_folder(tmp_path, images, {"is": "old"})
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert set(before) == {"transmittance.exr", "scattering.exr", "atmosphere.json"}
    write = three._write

    def fails(image: Any, path: Path) -> None:
        if "scattering" in path.name:
            raise OSError("no room")
        write(image, path)

    monkeypatch.setattr(three, "_write", fails)
    with pytest.raises(SkyscatterError, match="no room"):
        three.write_folder(tmp_path, {name: 2 * image for name, image in images.items()}, {"is": "new"})
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.slow
def test_command_writes_a_folder(tmp_path: Path, capsys: Any) -> None:
    """The whole way, and what it says of itself: medians of the sky by day within 2 %."""
    from skyscatter.image.exr import _open

    folder = tmp_path / "sky"
    words = ["export", "earth-simple", "--wavelengths", "450,550,650", "--tolerance", "5%", "--json", "-q"]
    assert main([*words, "-o", str(folder)]) == 0
    said = json.loads(capsys.readouterr().out)
    made = json.loads((folder / "atmosphere.json").read_text())
    assert said["deviations"] == made["deviations"]
    assert all(row["median"] < 0.02 for row in made["deviations"] if row["sun_elevations_deg"][0] >= 0)
    names = {"transmittance", "scattering", "single_mie_scattering", "higher_order_scattering", "irradiance"}
    assert {path.name for path in folder.iterdir()} == {f"{name}.exr" for name in names} | {"atmosphere.json"}
    for name in names:
        _, channels = _open(folder / f"{name}.exr")
        assert sorted(channels) == ["A", "B", "G", "R"]
        assert all(plane.dtype == np.float16 and np.isfinite(plane).all() for plane in channels.values())
    # The Sun that comes through to the ground, and the sky's light there, as the field says.
    atmosphere = made["atmosphere"]
    sun = [atmosphere["solarIrradiance"][k] * atmosphere["sunRadianceToLuminance"][k] for k in "xyz"]
    assert 1.1e5 < np.dot([0.2126, 0.7152, 0.0722], sun) < 1.5e5  # lx
