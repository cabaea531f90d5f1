"""Background stars: a seeded, random sky behind everything, the same at any resolution and field of view."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from skyscatter.constants import BOLTZMANN, LIGHT, PLANCK
from skyscatter.errors import DomainError
from skyscatter.lights import VISUAL_WAVELENGTH, visual_irradiance
from skyscatter.optics.base import Array
from skyscatter.record import Record
from skyscatter.units import Magnitude, OptionalNumber, StarTemperature, default

_PER_CELL = 32.0  # mean number of stars in a cell of the plane: few cells, little drawn in vain at the edges
_WIDEST_CELL = 8.0  # [degree]
_MOST_STARS = 5e6
_ORIGIN = 2**31  # cells count from here, for seeds are never negative


class Stars(NamedTuple):
    """Stars of a field, brightest first; each column of shape (star,)."""

    x_deg: Array  #: to the right (west) on the tangent plane [degree]
    y_deg: Array  #: up (north) on the tangent plane [degree]
    magnitude: Array  #: in V, before any dust of the model
    temperature: Array  #: of the black body [K]

    def fluxes(self, wavelengths_nm: ArrayLike) -> Array:
        """Irradiance of each star at the observer, before any dust of the model [W m-2 nm-1]; (star, wavelength)."""
        wl = np.atleast_1d(np.asarray(wavelengths_nm, float))
        unit = PLANCK * LIGHT / (BOLTZMANN * 1e-9) / self.temperature[:, None]
        x, visual = unit / wl, unit / VISUAL_WAVELENGTH
        # Planck's law over its value at 550 nm, written so that the Wien tail does not overflow.
        shape = (VISUAL_WAVELENGTH / wl) ** 5 * np.exp(visual - x) * np.expm1(-visual) / np.expm1(-x)
        flux: Array = visual_irradiance(self.magnitude)[:, None] * shape
        return flux


class StarField(Record):
    """Random stars behind everything: uniform over the sky, their number growing with magnitude.

    The number of stars brighter than m, per square degree, is
    count_per_square_degree 10^(slope (m - limiting_magnitude)).  Temperatures are log-normal, independent of
    magnitude.  Positions are gnomonic offsets from the centre of the picture.  The plane is divided into cells, each
    with a stream of random numbers of its own: a wider field has the same stars where the narrower one was.

    Parameters
    ----------
    count_per_square_degree : float
        Stars brighter than the limiting magnitude per square degree.  To magnitude 20 there are a few thousand towards
        the galactic poles, and tens of thousands and more in the Milky Way.
    limiting_magnitude : float
        Faintest magnitude in V.
    brightest_magnitude : float, optional
        Leave out brighter stars.
    slope : float
        d log10 N / dm.  Stars evenly spread in clear space have 0.6; the Milky Way's thinning and its dust flatten the
        counts to 0.3 or so between magnitudes 12 and 20, the default.
    median_temperature : float
        Median of the stars' temperatures [K].
    temperature_spread : float
        Standard deviation of log10 of the temperature; 0.1 by default, so that two thirds have 4200 to 6600 K.
    seed : int
        Which sky.

    Examples
    --------
    Stars of a quarter of a square degree; a wider field has them too.

    >>> import numpy as np
    >>> import skyscatter
    >>> field = skyscatter.StarField(count_per_square_degree=3000, limiting_magnitude=20, seed=1)
    >>> narrow, wide = field.stars((0.5, 0.5)), field.stars((1.0, 1.0))
    >>> round(len(narrow.magnitude), -2), bool(np.isin(narrow.magnitude, wide.magnitude).all())
    (800, True)
    """

    count_per_square_degree: float = Field(gt=0.0)
    limiting_magnitude: Magnitude
    brightest_magnitude: OptionalNumber[Magnitude] = default(None)
    slope: float = Field(default=0.3, gt=0.0)
    median_temperature: StarTemperature = default(5250.0)
    temperature_spread: float = Field(default=0.1, ge=0.0, le=0.5)
    seed: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.brightest_magnitude is not None and not self.brightest_magnitude < self.limiting_magnitude:
            raise DomainError("brightest_magnitude", self.brightest_magnitude, "must lie below limiting_magnitude")
        return self

    def stars(self, field_of_view_deg: tuple[float, float], seed: int | None = None) -> Stars:
        """The stars in a field.

        Parameters
        ----------
        field_of_view_deg : (float, float)
            Width and height of the picture on the tangent plane [degree]: pixels times pixel scale at its centre.
        seed : int, optional
            Instead of the record's own.

        Returns
        -------
        Stars
        """
        for name, side in zip(("width", "height"), field_of_view_deg, strict=True):
            if not side > 0:
                raise DomainError(f"field of view, {name}", side, "must be positive [degree]")
        half_width, half_height = (0.5 * side for side in field_of_view_deg)
        expected = 4 * half_width * half_height * self.count_per_square_degree
        if expected > _MOST_STARS:
            raise DomainError(
                "count_per_square_degree", self.count_per_square_degree, f"makes {expected:.1e} stars; at most 5e6"
            )
        cell = min(np.sqrt(_PER_CELL / self.count_per_square_degree), _WIDEST_CELL)
        columns, rows = (np.arange(-n, n) for n in (int(np.ceil(h / cell)) for h in (half_width, half_height)))
        which = self.seed if seed is None else seed
        drawn = [self._cell(which, i, j, cell) for j in rows.tolist() for i in columns.tolist()]
        x, y, magnitude, temperature = np.concatenate(drawn, axis=1)
        inside = (np.abs(x) <= half_width) & (np.abs(y) <= half_height)
        if self.brightest_magnitude is not None:
            inside &= magnitude >= self.brightest_magnitude
        order = np.flatnonzero(inside)[np.argsort(magnitude[inside], kind="stable")]
        return Stars(x[order], y[order], magnitude[order], temperature[order])

    def _cell(self, seed: int, i: int, j: int, side: float) -> Array:
        """Rows x, y, magnitude and temperature of the stars in one cell of the plane; shape (4, star)."""
        rng = np.random.default_rng([seed, _ORIGIN + i, _ORIGIN + j])
        count = rng.poisson(self.count_per_square_degree * side**2)
        u = rng.random((4, count))
        normal = rng.standard_normal(count)
        x, y = side * (i + u[0]), side * (j + u[1])
        # 1 - u is never zero: no star is infinitely bright.
        magnitude = self.limiting_magnitude + np.log10(1 - u[2]) / self.slope
        temperature = self.median_temperature * 10 ** (self.temperature_spread * np.clip(normal, -3, 3))
        # The plane is wider than the sky that it shows, by 1 / cos^3 of the angle from the centre.
        cosine = 1 / np.sqrt(1 + np.radians(x) ** 2 + np.radians(y) ** 2)
        kept = u[3] < cosine**3
        return np.stack([x, y, magnitude, temperature])[:, kept]
