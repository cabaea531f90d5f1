"""From images to matter: electron density from a recombination line, dust from an extinction map.

A line of hydrogen gives off j = alpha_eff(T) h nu n_e n_p / (4 pi) per volume and solid angle (case B), so that the
density inverted from its image is j; with n_e = n_p, which counts no electrons of helium,

    n_e = (4 pi j / (alpha_eff h nu))^(1/2)          (127 of docs/theory/abel.md).

Extinction counts dust, A_V = 1.0857 sigma_V N_H with sigma_V the extinction per hydrogen nucleon at 550 nm; the mixture
says how much dust comes with a hydrogen nucleon, and how much gas with dust.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError, UnitsError
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.spherical import SphericalResult, invert_spherical
from skyscatter.inversion.splines import spline_values
from skyscatter.optics.dust import MAGNITUDE, MIXTURES, VISUAL_WAVELENGTH, dust_properties
from skyscatter.optics.lines import effective_recombination, photon_energy
from skyscatter.units import metres

Array = NDArray[np.float64]

HYDROGEN_MASS = 1.6735328e-27  #: of an atom [kg] (CODATA 2018: 1.00782503 u)
HELIUM = 1.0 + 3.9713 * 0.096  #: mass of gas over that of its hydrogen, with the dust tables' 0.096 helium atoms
SOLAR_MASS = 1.98841e30  #: [kg], the IAU 2015 nominal GM over CODATA 2018 G
_ARCSECOND = np.pi / 648000
_NEAREST = 1e9  #: no nebula is nearer [m]; a number below it was meant in another unit
_SEEN = 2.0  #: standard deviations by which an emissivity stands out
_COPIES, _SAMPLES = 6, 64  #: pictures of an estimate from which the error of a mass is found, and samples of each


@dataclass(frozen=True, repr=False)
class LineGas(Brief):
    """Ionised gas found from a line image.

    Attributes
    ----------
    radius : ndarray, shape (node,)
        [m]
    electron_density, standard_deviation : ndarray, shape (node,)
        [m-3], with a filling factor of 1 unless another was given.
    lower, upper : ndarray, shape (node,)
        The band that is to cover the truth at 68.3 % of the radii [m-3].
    mass, mass_error : float
        Of the ionised gas, helium included [kg].
    luminosity, luminosity_error : float
        Of the line, extinction taken off [W].
    filling_factor : float
    inversion : SphericalResult
        Of the emissivity [W m-3 sr-1], with centre, background and residual.

    Examples
    --------
    Gas in clumps that fill a tenth of the volume has a third of the mass that it would have if it filled all, 0.018
    solar masses.  The luminosity is that of the image: 4 pi times its sum over the area of the pixels.

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y, x = np.mgrid[:15, :15] - 7
    >>> image = 1e-7 * np.sqrt(np.maximum(1 - (x**2 + y**2) / 25, 0))
    >>> gas = inversion.gas_from_line_image(image, 5, "1 kpc", 1e-8, centre=(7, 7), filling_factor=0.1)
    >>> f"{gas.mass / 1.988e30:.3f} solar masses"
    '0.006 solar masses'
    >>> pixel = np.radians(5 / 3600) * 1000 * 3.0857e16  # m
    >>> f"{gas.luminosity / (4 * np.pi * pixel**2 * image.sum()):.1f}"
    '1.0'
    """

    radius: Array
    electron_density: Array
    standard_deviation: Array
    lower: Array
    upper: Array
    mass: float
    mass_error: float
    luminosity: float
    luminosity_error: float
    filling_factor: float
    inversion: SphericalResult


@dataclass(frozen=True, repr=False)
class DustCloud(Brief):
    """Dust found from an extinction map.

    Attributes
    ----------
    radius : ndarray, shape (node,)
        [m]
    hydrogen_density, standard_deviation, lower, upper : ndarray, shape (node,)
        Nucleons per volume [m-3] and their band.
    dust_density : ndarray, shape (node,)
        [kg m-3]
    hydrogen_column : ndarray, shape (y, x)
        Of the map less its background [m-2].
    dust_mass, dust_mass_error : float
        Of the profile within its edge [kg].
    gas_mass, gas_mass_error : float
        The same times the mixture's gas to dust ratio [kg].
    opaque_pixels : int
        Pixels within the edge that are too dark to have an A_V.  Where there are any, noise has chosen which dark
        pixels count, and densities and masses are lower limits whatever their errors: look at a longer wavelength.
    map_dust_mass, map_dust_mass_error : float
        Sum over the map's pixels within the edge instead, which needs no symmetry (masked pixels take the fitted
        value) [kg].
    mixture : str
    inversion : SphericalResult
        Of A_V [mag m-1].

    Examples
    --------
    Two ways to the mass agree for a round cloud: the profile's integral, and the sum over the map's pixels.

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y, x = np.mgrid[:24, :24] - 11.5
    >>> visual = 3 * np.maximum(1 - (x**2 + y**2) / 64, 0) ** 1.5
    >>> cloud = inversion.dust_from_extinction(visual, 10, "140 pc", 0.05, centre=(11.5, 11.5))
    >>> f"{cloud.map_dust_mass / cloud.dust_mass:.1f}"
    '1.0'
    >>> cloud.hydrogen_column.shape, cloud.opaque_pixels
    ((24, 24), 0)
    >>> f"{cloud.hydrogen_column.max() / 1e4:.1e} per cm2 for 3 mag"
    '5.6e+21 per cm2 for 3 mag'
    """

    radius: Array
    hydrogen_density: Array
    standard_deviation: Array
    lower: Array
    upper: Array
    dust_density: Array
    hydrogen_column: Array
    dust_mass: float
    dust_mass_error: float
    gas_mass: float
    gas_mass_error: float
    opaque_pixels: int
    map_dust_mass: float
    map_dust_mass_error: float
    mixture: str
    inversion: SphericalResult


def electrons_from_emissivity(
    emissivity: ArrayLike, line: str = "halpha", *, temperature: float = 1e4, filling_factor: float = 1.0
) -> Array:
    """Electron density of gas that gives off so much light of a recombination line, equation 127 of the theory.

    Parameters
    ----------
    emissivity : array_like
        [W m-3 sr-1], averaged over clumps and gaps; 0 or above.
    line : {"halpha", "hbeta"}
    temperature : float
        Of the electrons [K].
    filling_factor : float
        Share of the volume that the gas fills, evenly; the density is that within the clumps.

    Returns
    -------
    ndarray
        [m-3]

    Raises
    ------
    DomainError
        For negative emissivities, an unknown line, a temperature or filling factor out of range.

    Examples
    --------
    Four times the light is twice the density [cm-3], and so is gas that fills a quarter of its volume.

    >>> from skyscatter import inversion
    >>> (inversion.electrons_from_emissivity([1e-22, 4e-22]) / 1e6).round()
    array([188., 377.])
    >>> float((inversion.electrons_from_emissivity(1e-22, filling_factor=0.25) / 1e6).round())
    377.0
    """
    j = np.asarray(emissivity, float)
    if not (j >= 0).all():
        raise DomainError("emissivity", float(np.nanmin(j)), "is never negative")
    _check_share("filling_factor", filling_factor)
    rate = effective_recombination(line, temperature) * photon_energy(line) / (4 * np.pi)
    return np.asarray(np.sqrt(j / (rate * filling_factor)))


def gas_from_line_image(
    image: Any,
    pixel_angle: Any,
    distance: Any,
    sigma: Any = None,
    mask: ArrayLike | None = None,
    *,
    line: str = "halpha",
    temperature: float = 1e4,
    extinction: float = 0.0,
    filling_factor: float = 1.0,
    distance_error: Any = 0.0,
    centre: tuple[float, float] | None = None,
    edge: Any = None,
    averaged: bool = True,
    seed: int = 0,
    progress: Callable[[float], Any] | None = None,
) -> LineGas:
    """Electron density and mass of a spherical nebula from its image in a recombination line.

    Parameters
    ----------
    image : array_like or Quantity, shape (y, x)
        Surface brightness of the whole line [W m-2 sr-1], or any unit that is convertible (erg s-1 cm-2 arcsec-2).
        Light of other lines in the band ([N II] beside H-alpha) must be taken off before.
    pixel_angle : float or Quantity
        Angle of a pixel's side [arcsec].
    distance : length
        [m]
    sigma : array_like or Quantity, optional
        Standard deviation of the image, in its unit; estimated when not given.
    mask : array_like of bool, shape (y, x), optional
        True for pixels that are left out.
    line : {"halpha", "hbeta"}
    temperature : float
        Of the electrons [K].
    extinction : float
        In front of the nebula, at the line's wavelength [mag].
    filling_factor : float
        1: the gas fills its volume evenly.  Clumps of a share f of the volume are denser by 1 / sqrt(f), and hold
        sqrt(f) of the mass.
    distance_error : length
        Standard deviation [m]; goes into the errors of mass and luminosity.
    centre, edge, averaged, seed, progress
        As in `invert_spherical`; the edge is a length [m].

    Returns
    -------
    LineGas

    Examples
    --------
    A uniform ball of hydrogen 1 kpc away, 6 pixels of 5 arcsec in radius; its density [cm-3] and mass [solar masses]:

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y, x = np.mgrid[:17, :17] - 8
    >>> image = 1e-7 * np.sqrt(np.maximum(1 - (x**2 + y**2) / 36, 0))
    >>> gas = inversion.gas_from_line_image(image, 5, "1 kpc", 5e-9, centre=(8, 8))
    >>> f"{round(gas.electron_density[:4].mean() / 1e6, -1):.0f} cm-3"
    '60 cm-3'
    >>> f"{gas.mass / 1.988e30:.2f} solar masses"
    '0.03 solar masses'
    """
    brightness = _plain(image, "W m-2 sr-1", "image")
    noise = None if sigma is None else _plain(sigma, "W m-2 sr-1", "sigma")
    _check_share("filling_factor", filling_factor)
    if not (np.isfinite(extinction) and extinction >= 0):
        raise DomainError("extinction", extinction, "magnitudes of 0 or above")
    effective_recombination(line, temperature)  # refuses what it does not know before anything is computed
    size, doubt = _pixel_length(pixel_angle, distance, distance_error)
    bright = 10.0 ** (0.4 * extinction)
    scale = _scale(brightness)
    found = invert_spherical(
        brightness / scale, None if noise is None else noise / scale, mask, centre=centre,
        edge=None if edge is None else metres(edge, "edge"), pixel_size=size,
        averaged=averaged, seed=seed, progress=progress,
    )  # fmt: skip
    again = _fitted_again(found, None if noise is None else noise / scale, mask, size, averaged, seed)
    found = _rescaled(found, scale)

    def electrons(j: Array) -> Array:
        return electrons_from_emissivity(
            np.maximum(j, 0.0) * bright, line, temperature=temperature, filling_factor=filling_factor
        )

    density = electrons(found.density)
    spread = 0.5 * (
        electrons(found.density + found.standard_deviation) - electrons(found.density - found.standard_deviation)
    )
    volume = _volume_weights(found.radius)
    per_electron = HYDROGEN_MASS * HELIUM * filling_factor
    seen = found.density > _SEEN * found.standard_deviation

    def gas(j: Array) -> tuple[Array, Array]:
        """Mass where the emissivity stands out of its noise, and elsewhere."""
        parts = per_electron * electrons(j) * volume
        return np.asarray(parts @ seen), np.asarray(parts @ ~seen)

    # A root of noise is no noise about zero: where nothing stands out, the mass lies between none and what is found,
    # and half of that is taken, and half is doubt.  Where it does, pictures made from the estimate, with its noise, and
    # inverted in their turn say by how much it is overestimated.
    lit, faint = (float(m) for m in gas(found.density))
    masses = gas(scale * again)[0]
    bias = float(masses.mean()) - lit
    mass = lit - bias + 0.5 * faint
    scatter = np.linalg.norm([masses.std(ddof=1) * np.sqrt(1 + 1 / len(masses)), 0.5 * bias, 0.5 * faint])
    # n_e goes with distance^(-1/2) and the volume with its cube; the light with its square.
    mass_error = float(np.hypot(scatter, 2.5 * doubt * mass))
    light = 4 * np.pi * bright * float(found.free_density @ volume)
    light_error = 4 * np.pi * bright * float(np.sqrt(volume @ found.free_covariance @ volume))
    return LineGas(
        radius=found.radius, electron_density=density, standard_deviation=spread,
        lower=electrons(found.lower), upper=electrons(found.upper), mass=mass,
        mass_error=mass_error, luminosity=light,
        luminosity_error=float(np.hypot(light_error, 2 * doubt * light)), filling_factor=filling_factor,
        inversion=found,
    )  # fmt: skip


def extinction_map(
    image: ArrayLike,
    background: float,
    sigma: ArrayLike | float | None = None,
    *,
    wavelength_nm: float = VISUAL_WAVELENGTH,
    mixture: str = "milky-way-3.1",
    foreground: float = 0.0,
) -> tuple[Array, Array | None]:
    """A_V of dust in front of a uniform background that it does not add light to.

    Parameters
    ----------
    image : array_like, shape (y, x)
        Brightness at one wavelength.
    background : float
        Brightness beside the cloud, in the same unit.
    sigma : array_like or float, optional
        Standard deviation of the image.
    wavelength_nm : float
    mixture : str
        Dust, as in `skyscatter.Dust`.
    foreground : float
        Light from in front of the cloud, which is in the background too.

    Returns
    -------
    visual_extinction : ndarray, shape (y, x)
        [mag]; NaN where the image does not rise above the foreground: there is no upper limit.
    error : ndarray or None
        [mag], to first order.  It is that of a pixel as bright as the mean of its surroundings: the pixel's own value
        would give the weight to those that noise has made bright.  For the same reason A_V is lower by what the
        logarithm of noise adds on average, half the square of the relative error.

    Raises
    ------
    DomainError
        For a background that is not above the foreground, and a sigma of 0 or below.

    Examples
    --------
    A pixel with a tenth of the light of the sky beside the cloud is behind 2.5 mag; no light at all has no A_V.

    >>> from skyscatter import inversion
    >>> visual, error = inversion.extinction_map([[50, 10, 0]], background=100)
    >>> visual.round(2)
    array([[0.75, 2.5 ,  nan]])
    """
    values = np.asarray(image, float)
    if not (np.isfinite(background) and background > foreground >= 0):
        raise DomainError("background", background, f"must be above the foreground, {foreground:g}, itself 0 or above")
    if sigma is not None and not (np.asarray(sigma, float) > 0).all():
        raise DomainError("sigma", float(np.min(sigma)), "must be above 0")
    section = dust_properties(mixture, [VISUAL_WAVELENGTH, wavelength_nm]).cross_section
    factor = float(section[0] / section[1]) * MAGNITUDE
    seen = values - foreground
    visual = -factor * np.log(np.where(seen > 0, seen, np.nan) / (background - foreground))
    if sigma is None:
        return visual, None
    relative = np.asarray(sigma, float) / np.maximum(_smoothed(seen), np.asarray(sigma, float))
    return visual - 0.5 * factor * relative**2, factor * relative


def _smoothed(image: Array) -> Array:
    """Mean of a pixel and its neighbours within two pixels, as far as they are finite."""
    from scipy.ndimage import uniform_filter

    finite = np.isfinite(image)
    share = uniform_filter(finite.astype(float), 5, mode="nearest")
    total = uniform_filter(np.where(finite, image, 0.0), 5, mode="nearest")
    return np.asarray(np.where(finite, total / np.maximum(share, 1e-12), np.nan))


def dust_from_extinction(
    visual_extinction: ArrayLike,
    pixel_angle: Any,
    distance: Any,
    sigma: ArrayLike | float | None = None,
    mask: ArrayLike | None = None,
    *,
    mixture: str = "milky-way-3.1",
    distance_error: Any = 0.0,
    centre: tuple[float, float] | None = None,
    edge: Any = None,
    averaged: bool = True,
    seed: int = 0,
    progress: Callable[[float], Any] | None = None,
) -> DustCloud:
    """Density, column and mass of the dust of a spherical cloud from a map of its extinction.

    Parameters
    ----------
    visual_extinction : array_like, shape (y, x)
        A_V [mag]; NaN where it is not known.
    pixel_angle : float or Quantity
        Angle of a pixel's side [arcsec].
    distance : length
        [m]
    sigma : array_like or float, optional
        Standard deviation [mag]; NaN where A_V is.
    mask : array_like of bool, shape (y, x), optional
        True for pixels that are left out.
    mixture : {"milky-way-3.1", "milky-way-4.0", "milky-way-5.5"}
        Dust; the number is R_V, about 5 in dense clouds.
    distance_error : length
        Standard deviation [m]; goes into the errors of masses.
    centre, edge, averaged, seed, progress
        As in `invert_spherical`; the edge is a length [m].

    Returns
    -------
    DustCloud

    Examples
    --------
    A round cloud 140 pc away, three magnitudes deep in the middle, in pixels of 10 arcsec; its density half-way to the
    edge of the map, and its masses:

    >>> import numpy as np
    >>> from skyscatter import inversion
    >>> y, x = np.mgrid[:24, :24] - 11.5
    >>> visual = 3 * np.maximum(1 - (x**2 + y**2) / 64, 0) ** 1.5
    >>> cloud = inversion.dust_from_extinction(visual, 10, "140 pc", 0.05, centre=(11.5, 11.5))
    >>> f"{np.interp(0.5, cloud.radius / cloud.radius[-1], cloud.hydrogen_density) / 1e6:.1e} hydrogen nucleons per cm3"
    '1.1e+04 hydrogen nucleons per cm3'
    >>> f"{cloud.gas_mass / 1.988e30:.2f} solar masses of gas, {cloud.dust_mass / 1.988e30:.4f} of dust"
    '0.23 solar masses of gas, 0.0019 of dust'
    """
    section = float(dust_properties(mixture, [VISUAL_WAVELENGTH]).cross_section[0])
    dust = MIXTURES[mixture]
    size, doubt = _pixel_length(pixel_angle, distance, distance_error)
    values = np.asarray(visual_extinction, float)
    noise: Any = sigma
    if sigma is not None and np.ndim(sigma) == 2:
        noise = np.where(np.isnan(values), 1.0, np.asarray(sigma, float))
    found = invert_spherical(
        values, noise, mask, centre=centre, edge=None if edge is None else metres(edge, "edge"), pixel_size=size,
        averaged=averaged, seed=seed, progress=progress,
    )  # fmt: skip
    per_magnitude = 1.0 / (MAGNITUDE * section)  # hydrogen nucleons per area for one magnitude
    volume = _volume_weights(found.radius) * per_magnitude * dust.per_hydrogen
    mass = float(volume @ found.free_density)
    error = float(np.hypot(np.sqrt(volume @ found.free_covariance @ volume), 2 * doubt * mass))
    map_mass, map_error = _map_sum(found, size)
    kept = np.ones(values.shape, bool) if mask is None else ~np.asarray(mask, bool)
    factor = per_magnitude * dust.per_hydrogen
    return DustCloud(
        radius=found.radius, hydrogen_density=per_magnitude * found.density,
        standard_deviation=per_magnitude * found.standard_deviation, lower=per_magnitude * found.lower,
        upper=per_magnitude * found.upper, dust_density=factor * found.density,
        hydrogen_column=per_magnitude * (values - found.background), dust_mass=mass, dust_mass_error=error,
        gas_mass=mass * dust.gas_to_dust, gas_mass_error=error * dust.gas_to_dust,
        opaque_pixels=int(np.count_nonzero(np.isnan(values) & kept & _within(found, size))),
        map_dust_mass=factor * map_mass,
        map_dust_mass_error=float(np.hypot(factor * map_error, 2 * doubt * factor * map_mass)),
        mixture=mixture, inversion=found,
    )  # fmt: skip


def _map_sum(found: SphericalResult, size: float) -> tuple[float, float]:
    """Sum of a map less its background within the edge, times the area of pixels, and its error."""
    inside = _within(found, size)
    filled = np.where(np.isnan(found.residual), 0.0, found.residual) + found.fitted_image - found.background
    # The residual itself says how large the pixels' noise is, wherever it is larger than elsewhere.
    noise = np.sqrt(np.nansum(found.residual[inside] ** 2))
    error = float(np.hypot(noise, inside.sum() * found.background_error))
    return float(filled[inside].sum()) * size**2, error * size**2


def _within(found: SphericalResult, size: float) -> NDArray[np.bool_]:
    """Which pixels of the image lie within the edge (y, x)."""
    rows, columns = found.fitted_image.shape
    y, x = np.mgrid[:rows, :columns]
    return np.asarray(np.hypot(x - found.centre[0], y - found.centre[1]) * size <= found.radius[-1])


def _volume_weights(radius: Array) -> Array:
    """Weights (node,) that turn densities at the nodes into the integral of 4 pi r^2 over the splines between them."""
    x, w = np.polynomial.legendre.leggauss(3)  # exact for a cubic times r^2
    half, middle = 0.5 * np.diff(radius), 0.5 * (radius[1:] + radius[:-1])
    at = (middle[:, None] + half[:, None] * x).ravel()
    weight = (half[:, None] * w).ravel() * 4 * np.pi * at**2
    return np.asarray(weight @ spline_values(radius, at))


def _fitted_again(found: SphericalResult, sigma: Any, mask: Any, size: float, averaged: bool, seed: int) -> Array:
    """Densities (copy, node) found from pictures of the estimate with new noise."""
    rng = np.random.default_rng(seed + 1)
    noise = found.noise if sigma is None else np.broadcast_to(np.asarray(sigma, float), found.fitted_image.shape)
    amount = np.where(np.isfinite(noise), noise, 0.0)
    copies = [
        invert_spherical(
            found.fitted_image + amount * rng.standard_normal(found.fitted_image.shape),
            sigma, mask, centre=found.centre, edge=float(found.radius[-1]), pixel_size=size, averaged=averaged,
            samples=_SAMPLES, seed=seed + 2 + k,
        ).density
        for k in range(_COPIES)
    ]  # fmt: skip
    return np.stack(copies)


def _rescaled(found: SphericalResult, scale: float) -> SphericalResult:
    from dataclasses import replace

    names = (
        "density",
        "standard_deviation",
        "lower",
        "upper",
        "background",
        "background_error",
        "fitted_image",
        "residual",
        "free_density",
    )
    changed: dict[str, Any] = {name: getattr(found, name) * scale for name in names}
    squares = {name: getattr(found, name) * scale**2 for name in ("covariance", "free_covariance")}
    return replace(found, **changed, **squares)


def _scale(values: Array) -> float:
    """A size of the numbers, so that tiny units do not meet tiny guards."""
    finite = values[np.isfinite(values)]
    size = float(np.abs(finite).max()) if finite.size else 0.0
    return size if size > 0 else 1.0


def _plain(value: Any, unit: str, name: str) -> Array:
    """Numbers in a unit, from numbers in it or from a Quantity."""
    if not hasattr(value, "to_value"):
        return np.asarray(value, float)
    try:
        return np.asarray(value.to_value(unit), float)
    except Exception as error:
        raise UnitsError(name, str(getattr(value, "unit", value)), f"a quantity convertible to {unit}") from error


def _pixel_length(pixel_angle: Any, distance: Any, distance_error: Any) -> tuple[float, float]:
    """Length of a pixel's side [m], and relative error of the distance."""
    angle = float(_plain(pixel_angle, "arcsec", "pixel_angle"))
    if not (np.isfinite(angle) and angle > 0):
        raise DomainError("pixel_angle", angle, "must be above 0 [arcsec]")
    far, error = metres(distance, "distance"), metres(distance_error, "distance_error")
    if not (np.isfinite(far) and far > 0):
        raise DomainError("distance", far, "must be a positive length")
    if far < _NEAREST:
        raise DomainError("distance", far, "metres are meant by a bare number; give a unit, such as '800 pc'")
    if not (np.isfinite(error) and error >= 0):
        raise DomainError("distance_error", error, "must be 0 or above")
    return angle * _ARCSECOND * far, error / far


def _check_share(name: str, value: float) -> None:
    if not 0 < value <= 1:
        raise DomainError(name, value, "must be above 0 and at most 1")
