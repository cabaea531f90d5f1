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
from skyscatter.scene import Scene
from skyscatter.solvers.base import Array
from skyscatter.solvers.field import DEFAULT_TOLERANCE, RadianceField, Solution, solve, solve_once
from skyscatter.solvers.run import check_wavelengths, worker_count
from skyscatter.solvers.sweeps import view


class Terms(NamedTuple):
    """Dimensionless, each (..., wavelength)."""

    path_reflectance: Array  #: pi L / (mu_s E) over a black ground
    transmittance_down: Array  #: of sunlight to the ground, direct and diffuse
    transmittance_up: Array  #: of the ground's light to the sensor, direct and diffuse
    spherical_albedo: Array  #: share of the ground's light that the atmosphere sends back

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
    """

    def __init__(
        self,
        scene: Scene,
        wavelengths: ArrayLike,
        *,
        sun_elevations_deg: tuple[float, float] = (0.0, 90.0),
        tolerance: float = DEFAULT_TOLERANCE,
        stokes: bool = False,
        threads: int | None = None,
    ) -> None:
        self.wavelengths = check_wavelengths(wavelengths)
        black = scene.model_copy(update={"ground": Ground(albedo=0.0)})
        self.black: RadianceField = solve(
            black, self.wavelengths, sun_elevations_deg=sun_elevations_deg, tolerance=tolerance, stokes=stokes,
            threads=threads,
        )  # fmt: skip
        dark = black.model_copy(update={"star": black.star.model_copy(update={"spectrum": 0.0}), "background": 0.0})
        workers = worker_count(threads)
        self.shining: Solution = solve_once(
            dark, self.wavelengths, (0.5, 0.5), tolerance, stokes, None, workers, ground_radiance=1.0
        )

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
        """
        elevation, zenith, azimuth = np.broadcast_arrays(
            *(np.asarray(a, float) for a in (sun_elevation_deg, view_zenith_deg, relative_azimuth_deg))
        )
        if zenith.size and not (zenith.min() >= 0 and zenith.max() < 90):
            raise DomainError("view_zenith_deg", float(zenith.max()), "lies between 0 and 90 degrees, 90 excluded")
        if elevation.size and elevation.min() <= 0:
            raise DomainError("sun_elevation_deg", float(elevation.min()), "the Sun must stand above the horizon")
        medium = self.black.scene.medium
        height = medium.top if altitude is None else min(float(altitude), medium.top)
        if height <= 0:
            raise DomainError("altitude", altitude, "a sensor above the ground")
        theta, phi = np.radians(zenith), np.radians(azimuth)
        up = np.stack([np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), np.cos(theta)], axis=-1)
        radius = medium.radius
        length = np.sqrt((radius * np.cos(theta)) ** 2 + height * (2 * radius + height)) - radius * np.cos(theta)
        origin = np.array([0.0, 0.0, radius]) + length[..., None] * up
        shape = (*elevation.shape, self.wavelengths.size)
        path, down = np.empty(shape), np.empty(shape)
        normal = self.black.scene.star.irradiance(self.wavelengths, self.black.scene.star_distance)
        for sun in np.unique(elevation):
            here = elevation == sun
            irradiance = normal * np.sin(np.radians(sun))
            answer = self.black.radiance(origin[here], -up[here], sun_elevation_deg=float(sun), sun_azimuth_deg=0.0)
            path[here] = np.pi * answer.radiance / irradiance
            flux = self.black.fluxes(0.0, sun_elevation_deg=float(sun))
            down[here] = (flux.direct + flux.diffuse_down) / irradiance
        shining = self.shining
        _, multiple, _, direct = view(
            shining.problem, shining.loaded, shining.problem.table, origin.reshape(-1, 3), -up.reshape(-1, 3)
        )
        upward = (multiple[:, 0] + direct).reshape(shape)
        back = np.broadcast_to(shining.sums.flux[0, 1, 0] / np.pi, shape)
        return Terms(path, down, upward, np.array(back))
