"""Flat slabs for the published plane-parallel problems: a very large planet under a thin uniform shell.

Conventions of the discrete-ordinate codes, in which the references are written: `mu` is the cosine of the direction in
which light *travels*, positive upwards; `phi` the azimuth of travel relative to the beam's own azimuth of travel; `tau`
the optical depth below the top.  A ray of ours looks the other way, against the light.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from asking import asked
from numpy.typing import ArrayLike, NDArray

import skyscatter
from skyscatter.media.fields import Uniform
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import TabulatedPhase
from skyscatter.solvers.base import Answer

Array = NDArray[np.float64]

#: Thickness of every slab [m].
THICKNESS = 1000.0
#: Planet radius over slab thickness.  Under a zenith cosine mu the air mass of a shell differs from 1 / mu by the share
#: (thickness / radius) / (2 mu^2): 1e-4 at mu = 0.02, and much less where the fluxes come from.
FLATNESS = 1e7
#: Any wavelength: the slabs are grey.
WAVELENGTH = 500.0


@dataclass(frozen=True)
class Slab:
    """A uniform slab above a Lambertian ground, lit by a beam and from outside.

    `irradiance` is the flux through a surface normal to the beam, `beam_mu` the cosine of its zenith angle.
    """

    optical_thickness: float
    single_scattering_albedo: float
    phase: Any
    beam_mu: float = 1.0
    irradiance: float = np.pi
    ground_albedo: float = 0.0
    background: float = 0.0

    def scene(self) -> skyscatter.Scene:
        """The slab as a scene; the Sun is a point in the north."""
        optics = Particles(
            optical_depth=self.optical_thickness,
            single_scattering_albedo=self.single_scattering_albedo,
            phase=self.phase,
        )
        component = skyscatter.Component(name="slab", density=Uniform(top=THICKNESS), optics=optics)
        elevation = float(np.degrees(np.arcsin(self.beam_mu)))
        return skyscatter.Scene(
            medium=skyscatter.Medium(planet_radius=FLATNESS * THICKNESS, components=(component,)),
            ground=skyscatter.Ground(albedo=self.ground_albedo),
            star=skyscatter.Star(spectrum=self.irradiance, radius=0.0),
            sun=skyscatter.Sun(elevation_deg=elevation, azimuth_deg=0.0),
            background=self.background,
        )

    def rays(self, tau: float, mu: ArrayLike, phi: ArrayLike) -> tuple[Array, Array]:
        """Origin and line of sight along which light arrives that travels into (mu, phi) at depth tau; (..., 3) each.

        The direct beam is never met: callers keep off (mu, phi) = (-beam_mu, 0).
        """
        mu, phi = np.broadcast_arrays(np.asarray(mu, float), np.asarray(phi, float))
        sine = np.sqrt(1 - mu**2)
        # The beam travels towards the south, so light of relative azimuth phi is seen in the north turned by phi.
        sight = np.stack([sine * np.sin(phi), sine * np.cos(phi), -mu], axis=-1)
        altitude = THICKNESS * (1 - tau / self.optical_thickness)
        origin = np.broadcast_to(np.array([0.0, 0.0, FLATNESS * THICKNESS + altitude]), sight.shape)
        return origin, sight

    def radiance(self, tau: float, mu: ArrayLike, phi: ArrayLike, solver: str = "path", **options: Any) -> Answer:
        """Diffuse radiance by the solver; arrays of the shape of mu and phi, one wavelength."""
        return skyscatter.radiance(self.scene(), *self.rays(tau, mu, phi), [WAVELENGTH], **asked(solver, **options))

    def flux(
        self, tau: float, upwards: bool, nodes: int = 16, azimuths: int = 1, **options: Any
    ) -> tuple[float, float]:
        """Diffuse flux through a horizontal plane at depth tau, and its standard error.

        Gauss-Legendre in mu over one hemisphere; the midpoint rule over half a turn of azimuth (the other half is its
        mirror image), exact for azimuthal harmonics below twice the number of azimuths.
        """
        x, w = np.polynomial.legendre.leggauss(nodes)
        mu, weight = 0.5 * (x + 1), 0.5 * w
        phi = np.pi * (np.arange(azimuths) + 0.5) / azimuths
        answer = self.radiance(tau, (mu if upwards else -mu)[:, None], phi[None, :], **options)
        share = 2 * np.pi * (weight * mu)[:, None] / azimuths
        value = float(np.sum(share * answer.radiance[..., 0]))
        error = float(np.sqrt(np.sum((share * answer.standard_error[..., 0]) ** 2)))
        return value, error

    def direct_flux(self, tau: float) -> float:
        """Flux of the beam through a horizontal plane at depth tau."""
        return self.irradiance * self.beam_mu * float(np.exp(-tau / self.beam_mu))


def legendre_phase(moments: ArrayLike, cells: int = 4000) -> TabulatedPhase:
    """Phase function of Legendre moments chi_l (chi_0 = 1): sum (2 l + 1) chi_l P_l / 4 pi, tabulated finely forward.

    Parameters
    ----------
    moments : array_like, shape (l,)
    cells : int
        Nodes are at cos_theta = 1 - 2 (k / cells)^2.
    """
    chi = np.asarray(moments, float)
    cosine = (1 - 2 * (np.arange(cells + 1) / cells) ** 2)[::-1]
    cosine[0], cosine[-1] = -1.0, 1.0
    values = np.polynomial.legendre.legval(cosine, (2 * np.arange(chi.size) + 1) * chi) / (4 * np.pi)
    # A cut series may dip below zero by its last digits.
    rows = tuple((float(v),) for v in np.maximum(values, 0.0))
    return TabulatedPhase(cos_theta=tuple(cosine), wavelengths=(WAVELENGTH,), values=rows)


@dataclass(frozen=True)
class IsotropicLayers:
    """Light of a stack of isotropically scattering layers over a black ground, by an integral equation.

    Independent of every solver.  The source function obeys (Chandrasekhar 1950, chapter III)

        S(tau) = omega / 2 int E1(|tau - t|) S(t) dt + omega F exp(-tau / mu0) / (4 pi) + omega B E2(tau) / 2

    under a beam F and isotropic light B from outside.  S is constant in cells that close in on both faces of every
    layer, and integrals of the exponential integrals are exact.

    Attributes
    ----------
    edge : (cell + 1,) optical depths.
    source : (cell,)
    background : float
    """

    edge: Array
    source: Array
    background: float

    @classmethod
    def solve(
        cls, depths: ArrayLike, albedos: ArrayLike, beam_mu: float, irradiance: float, background: float = 0.0,
        cells: int = 600,
    ) -> IsotropicLayers:  # fmt: skip
        """Layers that end at cumulative optical `depths`; `cells` in each."""
        from scipy.special import expn

        faces = np.concatenate([[0.0], np.atleast_1d(np.asarray(depths, float))])
        share = 0.5 * (1 - np.cos(np.pi * np.arange(cells) / cells))
        edge = np.append((faces[:-1, None] + np.diff(faces)[:, None] * share).ravel(), faces[-1])
        omega = np.repeat(np.atleast_1d(np.asarray(albedos, float)), cells)
        middle = 0.5 * (edge[1:] + edge[:-1])

        def integral(distance: Array) -> Array:
            return np.asarray(np.sign(distance) * (1 - expn(2, np.abs(distance))))

        matrix = integral(middle[:, None] - edge[:-1]) - integral(middle[:, None] - edge[1:])
        light = irradiance / (4 * np.pi) * np.exp(-middle / beam_mu) + 0.5 * background * expn(2, middle)
        source = np.linalg.solve(np.eye(middle.size) - 0.5 * omega[:, None] * matrix, omega * light)
        return cls(edge, source, background)

    def flux(self, tau: float, upwards: bool) -> float:
        """Diffuse flux through a horizontal plane at optical depth tau."""
        from scipy.special import expn

        below, above = np.maximum(self.edge - tau, 0.0), np.maximum(tau - self.edge, 0.0)
        if upwards:
            return float(2 * np.pi * self.source @ (expn(3, below[:-1]) - expn(3, below[1:])))
        scattered = self.source @ (expn(3, above[1:]) - expn(3, above[:-1]))
        return float(2 * np.pi * (scattered + self.background * expn(3, tau)))

    def radiance(self, tau: float, mu: ArrayLike) -> Array:
        """Diffuse radiance of light that travels at cosines mu (upwards positive, not zero) at optical depth tau."""
        cosine = np.atleast_1d(np.asarray(mu, float))
        side = np.where(cosine[:, None] > 0, self.edge - tau, tau - self.edge)
        fading = np.exp(-np.maximum(side, 0.0) / np.abs(cosine[:, None]))
        scattered = np.abs(np.diff(fading, axis=1)) @ self.source
        return np.asarray(scattered + np.where(cosine < 0, self.background * np.exp(-tau / np.abs(cosine)), 0.0))


def isotropic_fluxes(slab: Slab, cells: int = 600) -> tuple[float, float]:
    """Diffuse fluxes up at the top and down at the bottom of an isotropically scattering slab over a black ground."""
    depth = slab.optical_thickness
    light = IsotropicLayers.solve(depth, slab.single_scattering_albedo, slab.beam_mu, slab.irradiance, cells=cells)
    return light.flux(0.0, True), light.flux(depth, False)
