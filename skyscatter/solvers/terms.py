"""The four quantities with which the light of a ground of any albedo leaves an atmosphere.

Seen from above, a Lambertian ground of albedo rho under an atmosphere has the reflectance

    rho_toa = rho_path + T_down T_up rho / (1 - S rho)

(Chandrasekhar 1960, Radiative Transfer, section 72; Vermote et al. 1997, IEEE Trans. Geosci. Remote Sens. 35, 675,
eq. 1): exact for a uniform ground.  The path reflectance and T_down come from a solution over a black ground, T_up and
S from one in which the ground alone shines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.errors import DomainError
from skyscatter.ground import Ground
from skyscatter.scene import Scene, Sun
from skyscatter.solvers.base import Array
from skyscatter.solvers.checks import check_wavelengths, worker_count
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.direct import slant_columns
from skyscatter.solvers.field import DEFAULT_TOLERANCE, LOOSEST, check_coverage, solve_once, zenith_range
from skyscatter.solvers.fluxes import fluxes
from skyscatter.solvers.sweeps import Solution, view

#: Share of the tolerance for the solution in which the ground shines.
SHINING_SHARE = 0.4


class Terms(NamedTuple):
    """Dimensionless, each (..., wavelength)."""

    path_reflectance: Array  #: pi L / (mu_s E) over a black ground
    transmittance_down: Array  #: of sunlight to the ground, direct and diffuse
    transmittance_up: Array  #: of the ground's light to the sensor, direct and diffuse
    spherical_albedo: Array  #: share of the ground's light that the atmosphere sends back
    direct_up: Array  #: direct part of `transmittance_up`

    def reflectance(self, ground_albedo: ArrayLike) -> Array:
        """Reflectance seen from above over a ground of that albedo."""
        rho = np.asarray(ground_albedo, float)
        up = self.transmittance_down * self.transmittance_up
        return self.path_reflectance + up * rho / (1 - self.spherical_albedo * rho)


class CorrectionTerms:
    """Path reflectance, transmittances and spherical albedo of an atmosphere, for any Sun and view.

    Parameters
    ----------
    scene : Scene
        Its ground plays no part.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm].
    sun_elevations_deg, tolerance, stokes, threads
        As for `skyscatter.solve`.
    degree : int, optional
        Degree to which phase functions are kept.  Where many atmospheres are to be compared, the same for all.
    orders_tolerance : float, optional
        Relative accuracy of the sums over the orders of scattering, where it is to be finer than that of the grid.
    like : CorrectionTerms, optional
        Solve on the grid of these terms, so that the errors of both are alike and their difference is smooth: of an
        atmosphere of the same extent, better a thicker one, for the same Sun, tolerance and degree.

    Raises
    ------
    DomainError
        For values out of range, and where `like` has another extent, Sun or degree.

    Examples
    --------
    A dark ground of 5 % seen from space looks brighter in the blue, and almost as it is in the red.

    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth-simple").scene()
    >>> terms = skyscatter.CorrectionTerms(scene, [450, 850], sun_elevations_deg=(40, 50), tolerance=0.02)
    >>> seen = terms.at(sun_elevation_deg=45, view_zenith_deg=10)
    >>> seen.path_reflectance.round(2), seen.spherical_albedo.round(2)
    (array([0.11, 0.01]), array([0.17, 0.03]))
    >>> seen.reflectance(0.05).round(2)
    array([0.14, 0.06])
    """

    def __init__(
        self,
        scene: Scene,
        wavelengths: ArrayLike,
        *,
        sun_elevations_deg: tuple[float, float] = (0.0, 90.0),
        tolerance: float = DEFAULT_TOLERANCE,
        stokes: bool = False,
        degree: int | None = None,
        orders_tolerance: float | None = None,
        like: CorrectionTerms | None = None,
        threads: int | None = None,
    ) -> None:
        self.wavelengths = check_wavelengths(wavelengths)
        self.degree: int | None = degree
        self.scene = scene.model_copy(update={"ground": Ground(albedo=0.0)})
        self.zenith = zenith_range(self.scene, sun_elevations_deg, tolerance)
        dark = self.scene.model_copy(
            update={"star": scene.star.model_copy(update={"spectrum": 0.0}), "background": 0.0}
        )
        tolerance, workers = min(tolerance, LOOSEST), worker_count(threads)
        if like is not None:
            mine, other = ((t.scene.medium.radius, t.scene.medium.top, t.zenith) for t in (self, like))
            if mine != other or degree != like.degree:
                raise DomainError("like", other, f"terms for the same planet, top, Sun {mine} and degree {degree}")
        grids = (None, None) if like is None else (like.black.problem.grid, like.shining.problem.grid)
        #: Sunlight over a black ground.
        self.black: Solution = solve_once(
            self.scene, self.wavelengths, self.zenith, tolerance, stokes, None, workers,
            degree=degree, orders_tolerance=orders_tolerance, grid=grids[0],
        )  # fmt: skip
        #: The light of a ground that shines by itself: one Sun stands for all, so a finer grid costs little.  It leaves
        #: the ground unpolarised, and polarisation on its way changes the diffuse part of T_up by a thousandth.
        self.shining: Solution = solve_once(
            dark, self.wavelengths, (0.5, 0.5), SHINING_SHARE * tolerance, False, None, workers, ground_radiance=1.0,
            degree=self.black.problem.degree, orders_tolerance=orders_tolerance or tolerance,
            grid=grids[1],
        )  # fmt: skip

    def at(
        self,
        sun_elevation_deg: ArrayLike,
        view_zenith_deg: ArrayLike,
        relative_azimuth_deg: ArrayLike = 0.0,
        altitude: float | None = None,
    ) -> Terms:
        """The terms for a place on the ground.

        Parameters
        ----------
        sun_elevation_deg : array_like
            Of the Sun there [degree].
        view_zenith_deg : array_like
            Zenith angle there of the direction to the sensor [degree], 0 to below 90.
        relative_azimuth_deg : array_like
            Azimuth of the sensor less that of the Sun, as seen from the ground [degree]: 0 has both on one side.
        altitude : float, optional
            Of the sensor [m]; above the atmosphere when not given.

        Returns
        -------
        Terms
            Of the broadcast shape of the angles and a last axis of wavelengths.

        Examples
        --------
        From higher up there is more air in the way, and more path reflectance.

        >>> import skyscatter
        >>> scene = skyscatter.load_model("earth-simple").scene()
        >>> terms = skyscatter.CorrectionTerms(scene, [450], sun_elevations_deg=(40, 50), tolerance=0.02)
        >>> seen = [terms.at(45, 10, altitude=height).path_reflectance[0] for height in (3e3, None)]
        >>> [f"{reflectance:.2f}" for reflectance in seen]
        ['0.03', '0.11']
        """
        elevation, zenith, azimuth = np.broadcast_arrays(
            *(np.asarray(a, float) for a in (sun_elevation_deg, view_zenith_deg, relative_azimuth_deg))
        )
        if zenith.size and not (zenith.min() >= 0 and zenith.max() < 90):
            raise DomainError("view_zenith_deg", float(zenith.max()), "lies between 0 and 90 degrees, 90 excluded")
        if elevation.size and elevation.min() <= 0:
            raise DomainError("sun_elevation_deg", float(elevation.min()), "the Sun must stand above the horizon")
        medium = self.scene.medium
        height = medium.top if altitude is None else min(float(altitude), medium.top)
        if height <= 0:
            raise DomainError("altitude", altitude, "a sensor above the ground")
        theta, phi = np.radians(zenith), np.radians(azimuth)
        up = np.stack([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)], axis=-1)
        radius = medium.radius
        length = np.sqrt((radius * np.cos(theta)) ** 2 + height * (2 * radius + height)) - radius * np.cos(theta)
        origin = np.array([0.0, 0.0, radius]) + length[..., None] * up
        path, down = self._sunlight(elevation, origin, up)
        shining = self.shining
        _, multiple, _, direct = view(
            shining.problem, shining.loaded, shining.problem.table, origin.reshape(-1, 3), -up.reshape(-1, 3)
        )
        upward = (multiple[:, 0] + direct).reshape(path.shape)
        back = fluxes(shining, np.array([0.0]), np.array([0.5])).diffuse_down[0] / np.pi
        return Terms(path, down, upward, np.broadcast_to(back, path.shape).copy(), self._direct(zenith, height))

    def _sunlight(self, elevation: Array, origin: Array, up: Array) -> tuple[Array, Array]:
        """Path reflectance and T_down for elevations (...) of the Sun [degree] and sensors (..., 3) along `up`."""
        path, down = (np.empty((*elevation.shape, self.wavelengths.size)) for _ in range(2))
        star, problem = self.scene.star, self.black.problem
        normal = star.irradiance(self.wavelengths, self.scene.star_distance)
        for height in np.unique(elevation):
            here = elevation == height
            irradiance = normal * np.sin(np.radians(height))
            sun = Sun(elevation_deg=float(height), azimuth_deg=0.0)
            o, d = origin[here], -up[here]
            check_coverage(self.scene, self.zenith, o, d, sun)
            table = compile_scene(self.scene.model_copy(update={"sun": sun}), self.wavelengths)
            scattered, multiple, _, _ = view(problem, self.black.loaded, table, o, d)
            path[here] = np.pi * (scattered[:, 0] + multiple[:, 0]) / irradiance
            flux = fluxes(self.black, np.array([0.0]), np.array([np.radians(90 - height)]))
            down[here] = (flux.direct[0] + flux.diffuse_down[0]) / irradiance
        return path, down

    def _direct(self, zenith: Array, height: float) -> Array:
        """Transmittance of the ground's light that is not scattered on its way, for zenith angles (...) [degree]."""
        table = self.shining.problem.table
        out = np.empty((*zenith.shape, self.wavelengths.size))
        for angle in np.unique(zenith):
            mu, radius = float(np.cos(np.radians(angle))), self.scene.medium.radius
            column = slant_columns(table.columns, 0.0, mu)
            beyond = None
            if height < self.scene.medium.top:
                there = np.sqrt(1 - (1 - mu**2) * (radius / (radius + height)) ** 2)
                beyond = slant_columns(table.columns, height, float(there))
            assert column is not None  # a ray that rises from the ground meets it no more
            column = column if beyond is None else column - beyond
            out[zenith == angle] = np.exp(-column @ table.optics.sigma_t)
        return out
