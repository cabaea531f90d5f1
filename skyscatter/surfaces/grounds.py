"""What the grounds of planets are made of: land with a bowl and a hot spot, and the sea with its waves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.record import Record
from skyscatter.spectra.surfaces import check_albedo, spectrum_of
from skyscatter.spectra.table import (
    Albedo,
    Index,
    OptionalSpectral,
    Spectral,
    SpectralAsymmetry,
    SpectralExponent,
    SpectralShare,
    SpectralTable,
    evaluate,
)
from skyscatter.surfaces.indices import check_index, refractive_index
from skyscatter.units import OptionalNumber, Share, WindSpeed, default

Array = NDArray[np.float64]

#: Reflectance of foam as it ages on the sea (Koepke 1984, Appl. Opt. 23, 1816), in visible light.
FOAM_REFLECTANCE = 0.22
#: Light from below goes through the surface, which turns back what leaves it flat: more would be made from nothing.
BRIGHTEST_WATER = 0.3
#: Points of the quadratures of the albedo: zenith angles and azimuths.
_ZENITHS, _AZIMUTHS = 24, 48


class Rpv(Record):
    """Land by the formula of Rahman, Pinty & Verstraete: a bowl or a bell, a forward or a backward lobe, a hot spot.

    Parameters
    ----------
    amplitude : float or SpectralTable
        The overall level rho_0.
    exponent : float or SpectralTable
        k, above 0 and up to 2: below 1 the ground is brighter towards its horizon (a bowl), above 1 darker (a bell).
    asymmetry : float or SpectralTable
        Theta, between -1 and 1: below 0 it throws light back to where it came from, above 0 forward.
    hot_spot : float or SpectralTable, optional
        rho_c, at 1 there is no hot spot; as large as the amplitude when not given, as in the original.

    Raises
    ------
    pydantic.ValidationError
        A ValueError: if it would reflect more than all of an even sky's light.

    Notes
    -----
    Rahman, Pinty & Verstraete (1993), J. Geophys. Res. 98, 20791, equations 1-5.  The formula was fitted to views up to
    some 75 degrees from the zenith; for k below 1 it grows without bounds towards the horizon.

    Examples
    --------
    Bare ground that throws light back, seen from the side of the Sun and from the other:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> field = surfaces.Rpv(amplitude=0.072, exponent=0.648, asymmetry=-0.29)
    >>> a = np.radians(45)
    >>> sun, back, forward = [np.sin(a), 0, np.cos(a)], [0.5, 0, 0.866], [-0.5, 0, 0.866]
    >>> field.factor(sun, [back, forward], [660])[:, 0].round(3).tolist()
    [0.291, 0.101]
    >>> field.albedo([660]).round(3).tolist()  # under an even sky
    [0.183]
    """

    kind: Literal["rpv"] = "rpv"
    amplitude: SpectralShare = default(0.1)
    exponent: SpectralExponent = default(1.0)
    asymmetry: SpectralAsymmetry = default(0.0)
    hot_spot: OptionalSpectral[SpectralShare] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        _refuse_gain(self.albedo, "amplitude", self.amplitude, self.exponent, self.asymmetry, self.hot_spot)
        return self

    def parameters(self, wavelengths_nm: ArrayLike) -> Array:
        """rho_0, k, Theta and rho_c per wavelength, shape (4, wavelength)."""
        hot = self.amplitude if self.hot_spot is None else self.hot_spot
        return np.stack([evaluate(v, wavelengths_nm) for v in (self.amplitude, self.exponent, self.asymmetry, hot)])

    def factor(self, towards_light: ArrayLike, towards_viewer: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Bidirectional reflectance factor: how bright it is compared to white Lambertian ground.

        Parameters
        ----------
        towards_light, towards_viewer : array_like, shape (..., 3)
            Unit vectors, z along the normal and above 0.  Broadcast against each other.
        wavelengths_nm : array_like, shape (wavelength,)

        Returns
        -------
        ndarray, shape (..., wavelength)
        """
        light, viewer = np.broadcast_arrays(np.asarray(towards_light, float), np.asarray(towards_viewer, float))
        m, n, g = light[..., 2:], viewer[..., 2:], np.sum(light * viewer, axis=-1, keepdims=True)
        tangents = np.sqrt(np.maximum(1 / m**2 + 1 / n**2 - 2 * g / (m * n), 0.0))
        level, k, theta, hot = self.parameters(wavelengths_nm)
        lobe = (1 - theta**2) / (1 + theta**2 + 2 * theta * g) ** 1.5
        return np.asarray(level * (m * n * (m + n)) ** (k - 1) * lobe * (1 + (1 - hot) / (1 + tangents)))

    def albedo(self, wavelengths_nm: ArrayLike) -> Array:
        """Share of an even sky's light that it reflects, shape (wavelength,)."""
        return _albedo(self.factor, wavelengths_nm)


class RossLi(Record):
    """Land by three weights, as satellites report it: even, of a layer of leaves, and of crowns with their shadows.

    Parameters
    ----------
    isotropic : float or SpectralTable
        Weight of what is bright alike from everywhere.
    volumetric : float or SpectralTable
        Weight of the kernel of Ross for thick layers: a bowl, brighter towards the horizon.
    geometric : float or SpectralTable
        Weight of the reciprocal kernel of Li for sparse crowns: a hot spot where the light comes from, and shadows.

    Raises
    ------
    pydantic.ValidationError
        A ValueError: if it would reflect more than all of an even sky's light.

    Notes
    -----
    Lucht, Schaaf & Strahler (2000), IEEE Trans. Geosci. Remote Sens. 38, 977: the model of the albedo products of MODIS
    (MCD43) and VIIRS, whose weights may be given as they are.  It was fitted to angles up to some 75 degrees from the
    zenith; both kernels grow without bounds towards the horizon.  Where their sum is below 0 nothing is reflected.

    Examples
    --------
    Cropland in red light, seen from the side of the Sun and from the other:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> field = surfaces.RossLi(isotropic=0.09, volumetric=0.05, geometric=0.02)
    >>> a = np.radians(45)
    >>> sun, back, forward = [np.sin(a), 0, np.cos(a)], [0.5, 0, 0.866], [-0.5, 0, 0.866]
    >>> field.factor(sun, [back, forward], [645])[:, 0].round(3).tolist()
    [0.095, 0.053]
    >>> field.albedo([645]).round(3).tolist()  # under an even sky
    [0.073]
    """

    kind: Literal["ross-li"] = "ross-li"
    isotropic: SpectralShare = default(0.1)
    volumetric: SpectralShare = default(0.0)
    geometric: SpectralShare = default(0.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        _refuse_gain(self.albedo, "isotropic", self.isotropic, self.volumetric, self.geometric)
        return self

    def parameters(self, wavelengths_nm: ArrayLike) -> Array:
        """The weights in their order, shape (3, wavelength)."""
        return np.stack([evaluate(v, wavelengths_nm) for v in (self.isotropic, self.volumetric, self.geometric)])

    def factor(self, towards_light: ArrayLike, towards_viewer: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        """Bidirectional reflectance factor: how bright it is compared to white Lambertian ground.

        Parameters and result are those of `Rpv.factor`.

        Examples
        --------
        >>> from skyscatter import surfaces
        >>> surfaces.RossLi(isotropic=0.2).factor([0, 0, 1], [0.6, 0, 0.8], [550]).tolist()
        [0.2]
        """
        light, viewer = np.broadcast_arrays(np.asarray(towards_light, float), np.asarray(towards_viewer, float))
        m, n, g = light[..., 2:], viewer[..., 2:], np.sum(light * viewer, axis=-1, keepdims=True)
        angle = np.arccos(np.clip(g, -1, 1))
        leaves = ((np.pi / 2 - angle) * g + np.sin(angle)) / (m + n) - np.pi / 4
        tangents, others = (x[..., :2] / x[..., 2:] for x in (light, viewer))
        between = np.sum((tangents - others) ** 2, axis=-1, keepdims=True)
        turned = (tangents[..., :1] * others[..., 1:] - tangents[..., 1:] * others[..., :1]) ** 2
        both = 1 / m + 1 / n
        t = np.arccos(np.minimum(2 * np.sqrt(between + turned) / both, 1))
        crowns = (t - np.sin(t) * np.cos(t)) * both / np.pi - both + (1 + g) / (2 * m * n)
        even, layer, shadows = self.parameters(wavelengths_nm)
        return np.maximum(even + layer * leaves + shadows * crowns, 0.0)

    def albedo(self, wavelengths_nm: ArrayLike) -> Array:
        """Share of an even sky's light that it reflects, shape (wavelength,).

        Examples
        --------
        >>> from skyscatter import surfaces
        >>> surfaces.RossLi(isotropic=0.2).albedo([550]).round(3).tolist()
        [0.2]
        """
        return _albedo(self.factor, wavelengths_nm)


def _albedo(factor: Callable[[Array, Array, ArrayLike], Array], wavelengths_nm: ArrayLike) -> Array:
    """Share of an even sky's light that ground with a reflectance factor reflects, shape (wavelength,)."""
    x, weight = np.polynomial.legendre.leggauss(_ZENITHS)
    # Cosines m = x^4: towards the horizon the formulas go with a power of them.
    x, weight = 0.5 * (x + 1), 0.5 * weight
    m, weight = x**4, weight * 4 * x**3
    angle = np.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS
    sine = np.sqrt(1 - m**2)
    light = np.stack([sine, 0 * m, m], axis=-1)[:, None, None]
    across, beside = sine[:, None] * np.cos(angle), sine[:, None] * np.sin(angle)
    viewer = np.stack(np.broadcast_arrays(across, beside, m[:, None]), axis=-1)
    seen = factor(light, viewer, wavelengths_nm).mean(axis=2)
    return np.asarray(np.einsum("i,j,ijw->w", 2 * m * weight, 2 * m * weight, seen))


def _refuse_gain(albedo: Callable[[ArrayLike], Array], name: str, level: Spectral, *others: Spectral | None) -> None:
    """Refuse ground that would reflect more than all of an even sky's light; its level has a name."""
    nodes = _nodes(level, *others)
    highest = float(albedo(nodes).max())
    if highest > 1:
        rule = f"reflects {highest:.3g} of an even sky's light, more than all of it; lower it"
        raise DomainError(name, float(np.max(evaluate(level, nodes))), rule)


def _nodes(*values: Spectral | None) -> Array:
    """Wavelengths [nm] at which any of the values has a node; one where none has."""
    tables = [np.asarray(value.wavelengths, float) for value in values if isinstance(value, SpectralTable)]
    return np.unique(np.concatenate(tables or [np.array([550.0])]))


class Sea(Record):
    """Open water with waves by the wind: mirrors of all slopes, foam, and the light that comes back from below.

    Parameters
    ----------
    wind_speed : speed
        12.5 m above the sea [m s-1], up to 20.
    index : float or SpectralTable or str
        Refractive index of the water.
    upwelling : float or SpectralTable or str
        What the water itself reflects, seen from above, up to 0.3; also the name of a surface.
    foam : float, optional
        Covered share; by the wind when not given.

    Notes
    -----
    Slopes are normally distributed, equally in all directions, with the variance 0.003 + 0.00512 W of both components
    together (Cox & Munk 1954, J. Opt. Soc. Am. 44, 838); mutual shadows as Mishchenko & Travis (1997), J. Geophys. Res.
    102, 16989.  What one wave throws on another is lost, a few per cent of what comes from near the horizon.  Foam
    covers 2.95e-6 W^3.52 (Monahan & O'Muircheartaigh 1980, J. Phys. Oceanogr. 10, 2094), with a reflectance of 0.22
    (Koepke 1984, Appl. Opt. 23, 1816).

    Examples
    --------
    In a fresh breeze the root mean square slope is that of 13 degrees, and 1 % of the sea is white:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> sea = surfaces.Sea(wind_speed=10)
    >>> round(float(np.degrees(np.arctan(sea.slope)))), round(sea.foam_cover, 3)
    (13, 0.01)
    """

    kind: Literal["sea"] = "sea"
    wind_speed: WindSpeed = default(5.0)
    index: Index = default("water")
    upwelling: Albedo = default(0.0)
    foam: OptionalNumber[Share] = default(None)

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_index(self.index)
        check_albedo(self.upwelling)
        if not isinstance(self.upwelling, str):
            highest = float(np.max(evaluate(self.upwelling, _nodes(self.upwelling))))
            if highest > BRIGHTEST_WATER:
                raise DomainError("upwelling", highest, f"of water is {BRIGHTEST_WATER} at most; lower it")
        return self

    @property
    def slope(self) -> float:
        """Root mean square slope of the waves, both components together."""
        return float(np.sqrt(0.003 + 0.00512 * self.wind_speed))

    @property
    def foam_cover(self) -> float:
        """Share of the sea that is covered by foam."""
        return min(2.95e-6 * self.wind_speed**3.52, 1.0) if self.foam is None else self.foam

    def refractive_index(self, wavelengths_nm: ArrayLike) -> Array:
        """Of the water per wavelength, shape (wavelength,)."""
        return refractive_index(self.index, wavelengths_nm)

    def diffuse(self, wavelengths_nm: ArrayLike) -> Array:
        """What foam and the water below reflect evenly, per wavelength, shape (wavelength,)."""
        below = np.minimum(spectrum_of(self.upwelling, wavelengths_nm), BRIGHTEST_WATER)
        return np.asarray((1 - self.foam_cover) * below + self.foam_cover * FOAM_REFLECTANCE)
