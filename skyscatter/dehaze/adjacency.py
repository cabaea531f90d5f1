"""The adjacency effect: light of a pixel's surroundings that the air scatters into the line of sight.

Of the ground's light that reaches a sensor a part comes straight from the target, the rest by scattering, from all
around.  A point-spread function says from how far; it comes from Monte Carlo through the scene's own atmosphere, and
weighs the surroundings of every pixel to the reflectance rho_env with which

    rho_toa = rho_path + T_down (t_dir rho + t_dif rho_env) / (1 - S rho_env)

(Tanre, Herman & Deschamps 1981, Appl. Opt. 20, 3676; Vermote et al. 1997, IEEE Trans. Geosci. Remote Sens. 35, 675).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from skyscatter.media.medium import Medium

Array = NDArray[np.float64]

#: Distances between which the spread is counted, twenty to a decade [m].
FIRST_EDGE, LAST_EDGE, EDGES = 10.0, 1e6, 101
DEFAULT_WALKS = 1 << 16
#: Cells on either side of the middle over which the spread is averaged; farther out it is taken at their middles.
NEAR_CELLS = 6
#: Points along each side of such a cell.
FINE = 24


@dataclass(frozen=True)
class SpreadFunction:
    """Where the light that a sensor receives from the ground by scattering left the ground.

    Attributes
    ----------
    wavelengths : ndarray, shape (wavelength,)
        Vacuum wavelengths [nm].
    view_zenith_deg : float
        Zenith angle of the sensor as seen from the target [degree].
    distance : ndarray, shape (edge,)
        From the target [m], rising from 0.
    share, share_error : ndarray, shape (edge, wavelength)
        Part of that light that left the ground within the distance, whatever the azimuth, and its standard error.
    direct : ndarray, shape (wavelength,)
        Transmittance straight from the target to the sensor.
    diffuse, diffuse_error : ndarray, shape (wavelength,)
        Transmittance by scattering: radiance at the sensor over that of a ground which shines alike everywhere.
    """

    wavelengths: Array
    view_zenith_deg: float
    distance: Array
    share: Array
    share_error: Array
    direct: Array
    diffuse: Array
    diffuse_error: Array

    def band(self, number: int) -> SpreadFunction:
        """The function at one of its wavelengths."""
        k = slice(number, number + 1)
        return SpreadFunction(
            self.wavelengths[k], self.view_zenith_deg, self.distance, self.share[:, k], self.share_error[:, k],
            self.direct[k], self.diffuse[k], self.diffuse_error[k],
        )  # fmt: skip

    def within(self, distance: ArrayLike) -> Array:
        """Share of the light that left the ground within a distance [m] of the target, shape (..., wavelength)."""
        r = np.asarray(distance, float)
        columns = [np.interp(r, self.distance, self.share[:, k]) for k in range(self.wavelengths.size)]
        return np.stack(columns, axis=-1)

    def density(self, distance: ArrayLike) -> Array:
        """Share of the light per area of the ground at a distance [m-2], shape (..., wavelength).

        A power law between bins of `distance`, through the means of the bins where a density that falls with the square
        of the distance has them (with the distance itself in the first bin, next to the target).
        """
        edges = self.distance
        area = np.pi * np.diff(edges**2)
        mean = np.maximum(np.diff(self.share, axis=0), 0.0) / area[:, None]
        middle = 0.5 * edges[1:]
        middle[1:] = np.sqrt(np.diff(edges[1:] ** 2) / (2 * np.diff(np.log(edges[1:]))))
        # Bins that no walk has met lie far beyond all others; a density of 1e-30 per m2 counts as zero.
        logarithm = np.log(np.maximum(mean, 1e-30))
        x = np.log(np.maximum(np.asarray(distance, float), 1e-3 * FIRST_EDGE))
        columns = [np.interp(x, np.log(middle), logarithm[:, k]) for k in range(self.wavelengths.size)]
        return np.exp(np.stack(columns, axis=-1))


def spread_function(
    medium: Medium,
    wavelengths: ArrayLike,
    view_zenith_deg: float = 0.0,
    *,
    altitude: float | None = None,
    walks: int = DEFAULT_WALKS,
    stokes: bool = False,
    seed: int = 0,
) -> SpreadFunction:
    """The point-spread function of an atmosphere, by backward walks from the sensor.

    Parameters
    ----------
    medium : Medium
        Of a planet.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], rising.
    view_zenith_deg : float
        Zenith angle at the target of the direction to the sensor [degree], 0 to below 90.
    altitude : float, optional
        Of the sensor [m]; above the atmosphere when not given.
    walks : int
        Random walks, shared by all wavelengths; the standard error of `share` is about 1 / sqrt(walks).
    stokes : bool
        Treat light as polarised on its way (the ground's own is not).
    seed : int
        Same seed, same numbers.

    Returns
    -------
    SpreadFunction

    Raises
    ------
    DomainError
        For a medium without a planet, angles, altitudes or numbers of walks out of range.
    """
    from skyscatter.geometry.meridian import meridian_frame
    from skyscatter.kernels.polar import make_polar
    from skyscatter.kernels.raster.spread import BATCHES, make_spread_scratch, spread_walks
    from skyscatter.scene import Scene
    from skyscatter.solvers.checks import check_wavelengths
    from skyscatter.solvers.compile import compile_scene, matrix_tables

    wl = check_wavelengths(wavelengths)
    _check(view_zenith_deg, altitude, walks, BATCHES)
    table = compile_scene(Scene(medium=medium), wl)
    height = medium.top if altitude is None else min(float(altitude), medium.top)
    target = np.array([0.0, 0.0, medium.radius])
    origin, direction = line_of_sight(medium.radius, height, view_zenith_deg)
    polar = None
    if stokes:
        frame = meridian_frame(origin[None], direction[None])[0]
        polar = make_polar(matrix_tables(medium, tuple(float(w) for w in wl)), frame, 1)
    edges = np.geomspace(FIRST_EDGE, LAST_EDGE, EDGES)
    direct, sums = np.zeros(wl.size), np.zeros((BATCHES, EDGES + 1, wl.size))
    per_batch = -(-walks // (BATCHES * wl.size)) * wl.size
    scratch = make_spread_scratch(len(medium.components), wl.size)
    spread_walks(
        table, target, origin, direction, np.int64(seed), per_batch, edges, scratch, polar, direct, sums
    )  # fmt: skip
    share, share_error, diffuse, diffuse_error = _statistics(sums)
    return SpreadFunction(
        wl, float(view_zenith_deg), np.concatenate([[0.0], edges]), share, share_error, direct, diffuse, diffuse_error
    )


def _check(view_zenith_deg: float, altitude: float | None, walks: int, fewest: int) -> None:
    if not 0 <= view_zenith_deg < 90:
        raise DomainError("view_zenith_deg", view_zenith_deg, "lies between 0 and 90 degrees, 90 excluded")
    if altitude is not None and not altitude > 0:
        raise DomainError("altitude", altitude, "a sensor above the ground")
    if walks < fewest:
        raise DomainError("walks", walks, f"at least {fewest}, for the standard errors")


def line_of_sight(radius: float, height: float, zenith_deg: float, azimuth_deg: float = 0.0) -> tuple[Array, Array]:
    """Position [m] of a sensor of that altitude [m], and the direction from it to the target below the zenith.

    `zenith_deg` and `azimuth_deg` are those of the sensor as seen from the target [degree].
    """
    theta, phi = np.radians(zenith_deg), np.radians(azimuth_deg)
    up = np.array([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)])
    along = radius * up[2]
    length = np.sqrt(along**2 + height * (2 * radius + height)) - along
    return np.array([0.0, 0.0, radius]) + length * up, -up


def _statistics(sums: Array) -> tuple[Array, Array, Array, Array]:
    """Shares at the edges, the whole, and their standard errors, from sums (batch, bin, wavelength)."""
    batches = len(sums)
    whole = sums.sum(axis=1)
    inside = np.cumsum(sums[:, :-1], axis=1)
    inside = np.concatenate([np.zeros_like(inside[:, :1]), inside], axis=1)
    diffuse = whole.mean(axis=0)
    scale = np.where(diffuse > 0, diffuse, 1.0)
    share = inside.mean(axis=0) / scale
    # The error of a ratio, to first order: part and whole of a batch vary together.
    off = inside - share * whole[:, None]
    share_error = off.std(axis=0, ddof=1) / np.sqrt(batches) / scale
    return share, share_error, diffuse, whole.std(axis=0, ddof=1) / np.sqrt(batches)


def spread_weights(spread: SpreadFunction, cell_size_m: float, reach: tuple[int, int]) -> Array:
    """Share of the light that comes from each cell of a lattice, the target being in the middle of one.

    Parameters
    ----------
    spread : SpreadFunction
    cell_size_m : float
        Side of a cell [m].
    reach : (int, int)
        Cells on either side of the middle one along y and x.

    Returns
    -------
    ndarray, shape (wavelength, 2 reach_y + 1, 2 reach_x + 1)
        The sum is what comes from within the lattice, below 1.
    """
    r = np.hypot(*np.ogrid[: reach[0] + 1, : reach[1] + 1]) * cell_size_m
    quarter = spread.density(r) * cell_size_m**2
    half = np.concatenate([quarter[:0:-1], quarter])
    weights = np.concatenate([half[:, :0:-1], half], axis=1)
    near_y, near_x = (min(n, NEAR_CELLS) for n in reach)
    offset = (np.arange(FINE) + 0.5) / FINE - 0.5
    fine_y = (np.arange(-near_y, near_y + 1)[:, None] + offset).ravel() * cell_size_m
    fine_x = (np.arange(-near_x, near_x + 1)[:, None] + offset).ravel() * cell_size_m
    fine_r = np.hypot(fine_y[:, None], fine_x[None, :])
    density = spread.density(fine_r)
    # What lies within the circle inside the middle cell is known as a whole; the density there is too steep to sample.
    density[fine_r < 0.5 * cell_size_m] = 0.0
    blocks = density.reshape(2 * near_y + 1, FINE, 2 * near_x + 1, FINE, -1).mean(axis=(1, 3)) * cell_size_m**2
    blocks[near_y, near_x] += spread.within(0.5 * cell_size_m)
    cy, cx = reach
    weights[cy - near_y : cy + near_y + 1, cx - near_x : cx + near_x + 1] = blocks
    return np.ascontiguousarray(np.moveaxis(weights, -1, 0))


def environment(reflectance: NDArray[np.floating], cell_size_m: float, spread: SpreadFunction) -> Array:
    """Reflectance of the surroundings as the sensor's scattered light weighs them.

    A cell's own light counts with the share that left the ground within it.  Where there are no data the other cells
    stand in, by their weight; beyond the edge of the lattice the band's mean does.

    Parameters
    ----------
    reflectance : ndarray, shape (band, y, x)
        Means over square cells; NaN where there are no data.
    cell_size_m : float
        Side of a cell [m].
    spread : SpreadFunction
        Its wavelengths are those of the bands.

    Returns
    -------
    ndarray, shape (band, y, x)
        NaN in bands that hold no data at all.

    Raises
    ------
    DomainError
        For a lattice without cells, another number of bands than wavelengths, or a side that is not positive.
    """
    from scipy.signal import fftconvolve

    values = np.asarray(reflectance, float)
    if values.ndim != 3 or values.size == 0:
        raise DomainError("reflectance", f"shape {values.shape}", "has the shape (band, y, x)")
    if len(values) != spread.wavelengths.size:
        rule = f"as many bands as the spread function has wavelengths, {spread.wavelengths.size}"
        raise DomainError("reflectance", f"{len(values)} bands", rule)
    if not cell_size_m > 0:
        raise DomainError("cell_size_m", cell_size_m, "must be positive [m]")
    ny, nx = values.shape[1:]
    inside = np.ones((ny, nx))
    out = np.full(values.shape, np.nan)
    for k, band in enumerate(values):
        known = np.isfinite(band)
        if not known.any():
            continue
        weights = spread_weights(spread.band(k), cell_size_m, (ny - 1, nx - 1))[0]
        mean = band[known].mean()
        # Less the mean: rounding then is relative to the contrasts.
        light = fftconvolve(np.where(known, band - mean, 0.0), weights, "same")
        seen = fftconvolve(known.astype(float), weights, "same")
        whole = seen if known.all() else fftconvolve(inside, weights, "same")
        out[k] = mean + light * np.minimum(whole, 1.0) / np.maximum(seen, 1e-12)
    return out
