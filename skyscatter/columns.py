"""Optical depth and transmittance between two points: the doors that need no solver."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.scene import Scene

if TYPE_CHECKING:
    from skyscatter.media.medium import Medium
    from skyscatter.space import SpaceScene

Array = NDArray[np.float64]


def optical_depth(
    scene: Scene | SpaceScene, start: ArrayLike, end: ArrayLike, wavelengths: ArrayLike, *, by_component: bool = False
) -> Array:
    """Optical depth of the medium along straight segments.

    Columns of shells are exact to about 1e-9 (closed form for exponential shells, Gauss-Legendre quadrature between the
    breaks of the others; see `skyscatter.kernels.columns`), those of fields in three dimensions to rounding
    where there is a closed form and to about 1e-6 elsewhere (`skyscatter.kernels.space`).

    Parameters
    ----------
    scene : Scene or SpaceScene
    start, end : array_like, shape (..., 3)
        End points [m], broadcast against each other: from the planet's centre and anywhere outside the planet, or in
        the frame of a nebula's model.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm].
    by_component : bool
        Keep the components apart, in the order of the medium's; then the fields of a `Scene`.

    Returns
    -------
    ndarray, shape (..., wavelength) or (..., component, wavelength)
        Infinite where the planet is in the way.  Bodies are not looked at.

    Raises
    ------
    DomainError
        If an end lies inside the planet, or the scene has more than one medium.

    Examples
    --------
    Towards the horizon there is 35 times as much air as overhead (without refraction, which makes it 38).

    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth").scene()
    >>> ground = scene.observer.position  # m
    >>> ends = ground + [[0, 0, 120e3], [0, 2000e3, 0]]  # overhead, and far in the north
    >>> depth = skyscatter.optical_depth(scene, ground, ends, [450, 650], by_component=True)
    >>> depth.shape  # segment, component (air, ozone and aerosol), wavelength
    (2, 3, 2)
    >>> depth[0, 0].round(3)  # of air, overhead
    array([0.221, 0.049])
    >>> (depth[1, 0] / depth[0, 0]).round()
    array([35., 35.])
    """
    from skyscatter.kernels.columns import exact_columns
    from skyscatter.media.medium import Medium
    from skyscatter.solvers.checks import check_wavelengths
    from skyscatter.solvers.compile import field_tables, medium_optics

    if not hasattr(scene, "medium"):
        raise DomainError("scene", type(scene).__name__, "give a Scene or a SpaceScene, which have one medium")
    wl = check_wavelengths(wavelengths)
    a, b = np.broadcast_arrays(np.asarray(start, float), np.asarray(end, float))
    if a.shape[-1:] != (3,):
        raise DomainError("start", a.shape, "points are arrays of shape (..., 3) [m]")
    shape, a, b = a.shape[:-1], a.reshape(-1, 3), b.reshape(-1, 3)
    if not isinstance(scene, Scene):
        parts = _space_columns(scene.medium, a, b)[:, :, None] * medium_optics(scene.medium, tuple(wl.tolist()))[1]
        tau = parts if by_component else parts.sum(axis=1)
        return tau.reshape(*shape, *tau.shape[1:])
    radius = scene.medium.radius
    for name, point in (("start", a), ("end", b)):
        low = np.linalg.norm(point, axis=1).min(initial=np.inf) - radius
        if low < -1e-6 * radius:
            raise DomainError(name, f"altitude {low:.6g} m", "lies inside the planet")
    fields, _ = field_tables(scene.medium)
    length = np.linalg.norm(b - a, axis=1)
    r = np.linalg.norm(a, axis=1)
    along = np.einsum("ij,ij->i", a, b - a)
    mu = np.clip(along / np.where(length > 0, length * r, 1.0), -1, 1)
    columns = np.zeros((len(a), len(scene.medium.components)))
    exact_columns(fields, r, mu, length, columns)
    parts = columns[:, :, None] * medium_optics(scene.medium, tuple(wl.tolist()))[1]
    if scene.fields:
        held, lift = Medium(components=scene.fields), np.array([0.0, 0.0, radius])
        more = _space_columns(held, a - lift, b - lift)[:, :, None] * medium_optics(held, tuple(wl.tolist()))[1]
        parts = np.concatenate([parts, more], axis=1)
    parts[_through_planet(r, mu, length, radius)] = np.inf
    tau = parts if by_component else parts.sum(axis=1)
    return tau.reshape(*shape, *tau.shape[1:])


def _space_columns(medium: Medium, start: Array, end: Array) -> Array:
    """Columns (segment, component) [m] of fields in three dimensions."""
    return np.stack([field.column(start, end) for field in medium.fields], axis=1)


def _through_planet(r: Array, mu: Array, length: Array, radius: float) -> NDArray[np.bool_]:
    """Whether a segment dips into the planet by more than rounding."""
    lowest = r * np.sqrt(np.maximum(1 - mu**2, 0))
    return (mu < 0) & (lowest < radius * (1 - 1e-9)) & (length > -r * mu * (1 + 1e-9))


def transmittance(scene: Scene | SpaceScene, start: ArrayLike, end: ArrayLike, wavelengths: ArrayLike) -> Array:
    """exp(-optical depth) of the medium along straight segments, 0 through the planet.

    Parameters
    ----------
    scene : Scene or SpaceScene
    start, end : array_like, shape (..., 3)
        End points [m], as for `optical_depth`.
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm].

    Returns
    -------
    ndarray, shape (..., wavelength)

    Raises
    ------
    DomainError
        If an end lies inside the planet.

    Examples
    --------
    Mountains 100 km away at the observer's height: a third of their red light arrives, and next to none of the blue.

    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth").scene(altitude="2 km")
    >>> here = scene.observer.position
    >>> skyscatter.transmittance(scene, here, here + [100e3, 0, 0], [450, 550, 650]).round(2)
    array([0.04, 0.18, 0.32])
    >>> skyscatter.transmittance(scene, here, [0, 0, -here[2]], [550])  # through the planet
    array([0.])
    """
    return np.exp(-optical_depth(scene, start, end, wavelengths))
