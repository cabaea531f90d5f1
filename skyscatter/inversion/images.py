"""Pictures as data: sky images with their camera recipe, and images of nebulae through filters or as spectra."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.geometry.camera import CAMERAS
from skyscatter.geometry.telescope import Telescope
from skyscatter.image.filterimage import FilterImage
from skyscatter.image.horizon import sky_view
from skyscatter.image.spectral import SpectralImage
from skyscatter.inversion.looks import Integers, Look, SpaceLook
from skyscatter.inversion.observations import Array, checked_data, noise_of
from skyscatter.inversion.radiances import Radiances
from skyscatter.solvers.checks import check_wavelengths
from skyscatter.spectra.solar import solar_irradiance

#: Pixels that are used when nothing is said: neighbours tell next to the same, and each costs a ray.
PIXELS = 400
#: Pixels around a star whose light its image, or the step of the light around it, has changed.
STAR_PIXELS = 3
#: Angle from the Sun's middle within which its disk can be seen from a planet [degree].
SUN_SIZE = 0.5


def camera_of(recipe: dict[str, Any], name: str) -> Any:
    """The camera that a picture's recipe names."""
    content = recipe.get("camera")
    if not isinstance(content, dict) or content.get("kind") not in CAMERAS:
        raise DomainError("data", name, "the picture does not say with which camera it was taken; it has no recipe")
    return CAMERAS[content["kind"]](**content)


def sky_image(
    image: SpectralImage | str | os.PathLike[str],
    *,
    noise: float | None = None,
    pixels: int = PIXELS,
    wavelengths: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    sun_exclusion_deg: float = 3.0,
    sun_elevation_deg: float | None = None,
    sun_azimuth_deg: float | None = None,
    altitude: float | None = None,
) -> Radiances:
    """Pixels of a sky image as data.

    Camera, Sun and observer are those of the image's recipe; nothing else of it is used.

    Parameters
    ----------
    image : SpectralImage or path
        Such as ``skyscatter sky -o sky.nc`` writes (.nc, .exr, .fits).
    noise : float, optional
        Relative standard deviation of each pixel and wavelength, added in quadrature to the standard error of a picture
        by Monte Carlo.  Pictures by other solvers have no noise of their own: they need it.
    pixels : int
        How many to use at most, evenly spread over the picture.
    wavelengths : array_like, optional
        Which to use, out of the image's [nm]; all when not given.
    mask : array_like of bool, shape (y, x), optional
        True for pixels to leave out (clouds, horizon).
    sun_exclusion_deg : float
        Pixels so near to the Sun, and those that its disk may touch, are left out: they hold its light averaged.
    sun_elevation_deg, sun_azimuth_deg, altitude : float, optional
        In the place of the recipe's.

    Returns
    -------
    Radiances

    Raises
    ------
    DomainError
        For a picture without its recipe or of something else, a mask of another shape, no noise, or no pixel left.

    Examples
    --------
    Camera and Sun come from the picture itself; pixels below the horizon and near the Sun are left out.

    >>> import skyscatter
    >>> from skyscatter import inversion
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=30)
    >>> picture = skyscatter.render(scene, skyscatter.Fisheye(width=8, height=8), [450, 650], solver="single")
    >>> data = inversion.sky_image(picture, noise=0.02)
    >>> f"{data.values.size // 2} of 64 pixels, two wavelengths each"
    '50 of 64 pixels, two wavelengths each'
    >>> data.sun["elevation_deg"]
    30.0
    """
    name, picture = _named(image), loaded(image)
    if not isinstance(picture, SpectralImage):
        raise DomainError("data", name, "has filters; skies are fitted as spectra")
    camera = camera_of(picture.recipe, name)
    scene = picture.recipe.get("scene", {})
    if "planet_radius" not in scene.get("medium", {}):
        raise DomainError("data", name, "is no picture of a sky; for nebulae use nebula_image")
    sun = {k: v for k, v in scene.get("sun", {}).items() if v is not None and k != "site"}
    given = {"elevation_deg": sun_elevation_deg, "azimuth_deg": sun_azimuth_deg}
    sun |= {k: float(v) for k, v in given.items() if v is not None}
    height = float(scene.get("altitude", 0.0) if altitude is None else altitude)
    from skyscatter.scene import Observer, Sun

    radius = float(scene["medium"]["planet_radius"])
    # A camera that frames a planet asks for the air's top, and for the height from which the picture was taken.
    view = sky_view(picture)
    directions = camera.directions(Observer(height, radius, height)) if view is None else view.directions
    towards = Sun(**sun).direction
    with np.errstate(invalid="ignore"):
        near = np.maximum(sun_exclusion_deg, SUN_SIZE + np.degrees(_reach(directions)))
        far = np.degrees(np.arccos(np.clip(directions @ towards, -1, 1))) > near
    usable = _usable(picture.radiance, mask) & far & np.isfinite(directions[..., 0])
    chosen = _spread(usable, pixels)
    wl, columns = _wavelengths(picture.wavelengths, wavelengths)
    values, sigma = _pixels(picture, chosen, columns, noise)
    rows, ray, band = _indices(len(chosen), wl.size)
    # Fewer wavelengths have wider cells; the picture's light is that of its own.
    share = solar_irradiance(picture.wavelengths)[columns] / solar_irradiance(wl) if wavelengths is not None else None
    seen = np.ascontiguousarray(directions[chosen[:, 0], chosen[:, 1]])
    look = Look(sun, height, seen, wl, ray, band, rows, share=_own_sunlight(scene, share))
    return Radiances((look,), values, sigma, noise is not None, kind="sky image", labels=_labels(chosen, wl, ray, band))


def _own_sunlight(scene: dict[str, Any], share: Array | None) -> Array | None:
    """The share of sunlight, where the recipe's star has a spectrum with lines in it."""
    return share if scene.get("star", {}).get("spectrum", "astm-g173") == "astm-g173" else None


def nebula_image(
    image: SpectralImage | FilterImage | str | os.PathLike[str],
    *,
    noise: float | None = None,
    pixels: int = PIXELS,
    wavelengths: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    steps: int = 5,
) -> Radiances:
    """Pixels of an image of a nebula as data: spectra, or a plane for each filter.

    The model says how the nebula is turned and how far away it is; the image says only where its pixels look, by its
    recipe or, without one, by its celestial frame (north up).  Pixels around the stars of the recipe are left out, for
    pictures hold the stars themselves there and predictions do not; of other images mask them.

    Parameters
    ----------
    image : SpectralImage or FilterImage or path
        Such as ``skyscatter nebula -o ring.fits`` writes, with ``--filters`` or without.
    noise, pixels, wavelengths, mask
        As for `sky_image`.
    steps : int
        Wavelengths at which a filter's band is computed.

    Returns
    -------
    Radiances

    Raises
    ------
    DomainError
        For a picture that does not say where its pixels look, a mask of another shape, no noise, or no pixel left.

    Examples
    --------
    >>> import skyscatter
    >>> from skyscatter import fields, inversion
    >>> dust = skyscatter.Component(
    ...     name="dust", density=fields.Plummer(radius="0.3 pc"), optics=skyscatter.Dust(visual_extinction=1)
    ... )
    >>> scene = skyscatter.SpaceScene(medium=skyscatter.Medium(components=(dust,)), background=1e-9)
    >>> camera = skyscatter.Telescope.from_field_of_view(8, 8, 0.1)  # pixels, degrees
    >>> picture = skyscatter.render(scene, camera, [550], solver="single")
    >>> data = inversion.nebula_image(picture, noise=0.02, pixels=16)
    >>> data.kind, data.values.size
    ('nebula image', 16)
    """
    name, picture = _named(image), loaded(image)
    camera = _telescope(picture, name)
    shape = picture.radiance.shape[:2]
    usable = _usable(picture.radiance, mask) & ~around_stars(picture.recipe, camera, shape)
    chosen = _spread(usable, pixels)
    if isinstance(picture, FilterImage):
        if wavelengths is not None:
            raise DomainError("wavelengths", "given", "this picture has filters; leave them out")
        wl, response = _bands(picture, steps)
        columns, middles = np.arange(len(picture.filters)), np.array([f.centre for f in picture.filters])
    else:
        wl, columns = _wavelengths(picture.wavelengths, wavelengths)
        response, middles = None, wl
    values, sigma = _pixels(picture, chosen, columns, noise)
    rows, ray, band = _indices(len(chosen), columns.size)
    look = SpaceLook({}, 0.0, np.zeros((len(chosen), 3)), wl, ray, band, rows, response, camera=camera, pixels=chosen)
    return Radiances(
        (look,), values, sigma, noise is not None, kind="nebula image", labels=_labels(chosen, middles, ray, band)
    )


def _named(image: Any) -> str:
    """What to call a picture in errors."""
    return str(image) if isinstance(image, (str, os.PathLike)) else type(image).__name__


def loaded(image: Any) -> SpectralImage | FilterImage:
    """A picture as it was computed, from a file if it is none yet; of denoised ones the raw layers."""
    picture = image if isinstance(image, (SpectralImage, FilterImage)) else _read(image)
    if isinstance(picture, SpectralImage):
        return picture.undenoised
    if "denoising" in picture.recipe:
        rule = "is denoised; give the spectra, whose raw layers are read, or a picture that was not denoised"
        raise DomainError("data", _named(image), rule)
    return picture


def _read(image: str | os.PathLike[str]) -> SpectralImage | FilterImage:
    """A picture from a file."""
    path = Path(image)
    if path.suffix.lower() == ".fits" and path.is_file():
        from skyscatter.image.fits import main_image, open_fits

        if open_fits(path, lambda hdus, _: "FILTERS" in hdus or main_image(hdus, path).header["NAXIS"] == 2):
            return FilterImage.load(path)
    return SpectralImage.load(path)


def _telescope(picture: Any, name: str) -> Telescope:
    if picture.recipe.get("camera"):
        camera = camera_of(picture.recipe, name)
        if not isinstance(camera, Telescope):
            raise DomainError("data", name, "is no picture of a telescope; for skies use sky_image")
        return camera
    if picture.sky is None:
        rule = "says neither its camera nor, by a TAN frame with north up about its middle, where it stands in the sky"
        raise DomainError("data", name, f"{rule}; reproject it to such a frame")
    height, width = picture.radiance.shape[:2]
    return Telescope(width=width, height=height, pixel_scale_deg=picture.sky.pixel_scale_deg)


def around_stars(recipe: dict[str, Any], camera: Telescope, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels near the stars that the recipe's scene has, and near those of its star field."""
    from scipy.ndimage import binary_dilation

    near = np.zeros(shape, bool)
    content = recipe.get("scene", {})
    if not content.get("stars") and not content.get("star_field"):
        return near
    from skyscatter.solvers.starlight import star_images
    from skyscatter.space import SpaceScene

    scene = SpaceScene.model_validate(content)
    lit = star_images(scene, camera, np.array(recipe.get("wavelengths_nm", [550.0]), float)).sum(axis=2) > 0
    disk = np.hypot(*np.indices((2 * STAR_PIXELS + 1,) * 2) - STAR_PIXELS) <= STAR_PIXELS
    return np.asarray(binary_dilation(lit, disk))


def _reach(directions: Array) -> Array:
    """Angle between the middle of a pixel and its corners at most [rad], (y, x), from its neighbours' directions."""
    square = np.zeros(directions.shape[:2])
    for axis in (0, 1):
        if directions.shape[axis] > 1:
            step = np.nan_to_num(np.linalg.norm(np.diff(directions, axis=axis), axis=-1))
            ends = [(0, 0), (0, 0)]
            ends[axis] = (1, 1)
            padded = np.pad(step, ends, mode="edge")
            first, last = (padded[tuple(np.s_[a:b] if k == axis else np.s_[:] for k in (0, 1))]
                           for a, b in ((0, -1), (1, None)))  # fmt: skip
            square += np.maximum(first, last) ** 2
    return np.asarray(0.5 * np.sqrt(square))


def _usable(radiance: NDArray[Any], mask: ArrayLike | None) -> NDArray[np.bool_]:
    usable = np.isfinite(radiance).all(axis=2)
    if mask is None:
        return usable
    hidden = np.asarray(mask, bool)
    if hidden.shape != usable.shape:
        raise DomainError("mask", hidden.shape, f"one for each pixel, shape {usable.shape}")
    return usable & ~hidden


def _spread(usable: NDArray[np.bool_], count: int) -> Integers:
    """Rows and columns (pixel, 2) of at most so many pixels on a lattice."""
    if count < 1:
        raise DomainError("pixels", count, "at least 1")
    total = int(usable.sum())
    if total == 0:
        raise DomainError("data", "0 pixels", "nothing is left to fit: all are masked, or near the Sun or a star")
    stride = max(int(np.floor(np.sqrt(total / count))), 1)
    while True:
        lattice = np.zeros_like(usable)
        lattice[stride // 2 :: stride, stride // 2 :: stride] = True
        chosen = np.argwhere(usable & lattice)
        if len(chosen) <= count and len(chosen):
            return chosen
        if len(chosen) == 0:  # a lattice that misses the few usable pixels
            rows = np.argwhere(usable)
            return rows[np.linspace(0, len(rows) - 1, min(count, len(rows))).astype(int)]
        stride += 1


def _wavelengths(have: Array, wanted: ArrayLike | None) -> tuple[Array, Integers]:
    if wanted is None:
        return check_wavelengths(have), np.arange(have.size)
    wl = check_wavelengths(wanted)
    columns = np.abs(have[:, None] - wl).argmin(axis=0)
    off = np.abs(have[columns] - wl)
    if off.max() > 1e-6 * wl.max():
        raise DomainError("wavelengths", float(wl[off.argmax()]), "is none of the picture's")
    return wl, columns


def _pixels(picture: Any, chosen: Integers, columns: Integers, noise: float | None) -> tuple[Array, Array]:
    at = (chosen[:, 0][:, None], chosen[:, 1][:, None], columns[None, :])
    values = np.asarray(picture.radiance[at], float).ravel()
    own = None
    # What deterministic solvers state is no noise: a model of the same solver would share it.
    if picture.recipe.get("solver", "path") == "path" and picture.standard_error is not None:
        own = np.asarray(picture.standard_error[at], float).ravel()
        own = None if not own.max() > 0 else np.maximum(own, 1e-3 * np.median(own[own > 0]))
    if own is not None and noise is not None:
        own, noise = np.hypot(own, noise_of(values, None, noise, "pixel")), None
    return checked_data(values, noise_of(values, own, noise, "pixel"), "radiance")


def _bands(picture: FilterImage, steps: int) -> tuple[Array, Array]:
    """Wavelengths for all filters together, and the response (filter, wavelength)."""
    if steps < 1:
        raise DomainError("steps", steps, "at least 1")
    nodes = []
    for curve in picture.filters:
        lit = np.array(curve.wavelengths)[np.flatnonzero(np.array(curve.response) > 0)]
        share = (np.arange(steps) + 0.5) / steps
        nodes.append(lit.min() + share * (lit.max() - lit.min()) if np.ptp(lit) > 0 else lit[:1])
    wl = np.unique(np.round(np.concatenate(nodes), 6))
    response = np.zeros((len(nodes), wl.size))
    for k, (curve, own) in enumerate(zip(picture.filters, nodes, strict=True)):
        own = np.unique(np.round(own, 6))
        response[k, np.searchsorted(wl, own)] = curve.weights(own)[0]
    return check_wavelengths(wl), response


def _indices(rays: int, bands: int) -> tuple[Integers, Integers, Integers]:
    return np.arange(rays * bands), np.repeat(np.arange(rays), bands), np.tile(np.arange(bands), rays)


def _labels(chosen: Integers, wl: Array, ray: Integers, band: Integers) -> dict[str, Array]:
    row, column = (np.asarray(v, float) for v in chosen[ray].T)
    return {"row": row, "column": column, "wavelength_nm": wl[band]}


__all__: Sequence[str] = ("camera_of", "nebula_image", "sky_image")
