"""The one question every solver answers: the spectral radiance along rays, and how uncertain it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.errorkind import ErrorKind
from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from skyscatter.kernels.optics import GroundTable, SceneTable
    from skyscatter.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rays:
    """Rays in the scene's frame; numbers tell them apart whatever the order in which they are traced.

    Attributes
    ----------
    origins, directions : ndarray, shape (ray, 3)
        From the planet's centre [m]; unit vectors.
    numbers : ndarray of int, shape (ray,)
    """

    origins: Array
    directions: Array
    numbers: NDArray[np.int64]

    def part(self, rays: slice) -> Rays:
        """Some of the rays."""
        # Copies: kernels are compiled for plain arrays, and a broadcast one would be another type.
        origins, directions = (np.array(a[rays], order="C") for a in (self.origins, self.directions))
        return Rays(origins, directions, self.numbers[rays])


class Tables(NamedTuple):
    """What the solvers `single` and `path` prepare once for all rays."""

    scene: SceneTable
    ground: GroundTable
    matrix: Array | None  #: scattering matrices, with ``stokes``


def prepare_tables(
    scene: Scene,
    rays: Rays,
    wavelengths: Array,
    options: Options,
    threads: int,
    progress: Callable[[float], None] | None,
) -> Tables:
    """The tables of a scene; the rest of the arguments is for solvers that do more before the first ray."""
    from skyscatter.solvers.compile import compile_ground, compile_scene, matrix_tables
    from skyscatter.solvers.eclipse import eclipse_table

    matrix = matrix_tables(scene.medium, tuple(float(w) for w in wavelengths)) if options.stokes else None
    table = compile_scene(scene, wavelengths)._replace(eclipse=eclipse_table(scene, wavelengths))
    return Tables(table, compile_ground(scene.ground, wavelengths), matrix)


@dataclass
class Walks:
    """Sums over the walks of some rays: with them more walks are added later, to the same digits as all at once.

    Attributes
    ----------
    done : int
        Walks of each batch that are in the sums.
    sums : ndarray, shape (ray, 1 or 4, batch, wavelength)
        Of the radiance, and of Q, U and V where light is polarised.
    marked : ndarray, shape (ray, mark, wavelength)
        Of what is told apart, such as the first orders.
    """

    done: int
    sums: Array
    marked: Array

    @classmethod
    def none(cls, rays: int, layers: int, batches: int, marks: int, wavelengths: int) -> Walks:
        """No walks so far."""
        return cls(0, np.zeros((rays, layers, batches, wavelengths)), np.zeros((rays, marks, wavelengths)))

    def mean(self, marks: slice, used: NDArray[np.int64]) -> Array:
        """Mean over the walks of some of what is told apart."""
        return np.asarray(self.marked[:, marks] / np.maximum(used, 1)[:, None, None])


@dataclass(frozen=True)
class Answer:
    """Spectral radiance along rays.

    Attributes
    ----------
    radiance : ndarray, shape (..., wavelength)
        [W m-2 sr-1 nm-1].
    standard_error : ndarray, shape (..., wavelength)
        Of the radiance, by the name that all solvers share; see `error_kind` for what it is.
    layers : dict of str to ndarray, shape (..., wavelength)
        Parts of the radiance, where they were asked for; with ``stokes`` also Q, U, V and Q_error, U_error, V_error.
    samples : ndarray of int, shape (...)
        Walks used; 0 where the solver is deterministic.
    error_kind : {"standard", "estimated", "none"}
        Whether `error` is a standard error (``path``, ``photons``), an error estimated from a coarser solution, to
        which no probability belongs (``orders``), or 0 because the solver states none (``single``).

    Examples
    --------
    The zenith, scattered once; such light of molecules is polarised across the plane of the Sun, which stands in the
    south.

    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=0, sun_azimuth_deg=180)
    >>> found = skyscatter.radiance(scene, scene.observer.position, [0, 0, 1], [550], solver="single", stokes=True)
    >>> found.radiance.shape, found.stokes.shape, found.error_kind
    ((1,), (1, 4), 'none')
    >>> bool(found.layers["Q"][0] < 0)
    True
    """

    radiance: Array
    standard_error: Array
    layers: dict[str, Array] = field(default_factory=dict)
    samples: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    error_kind: ErrorKind = "standard"

    @property
    def error(self) -> Array:
        """Error of the radiance, of the sort `error_kind`, shape (..., wavelength)."""
        return self.standard_error

    @property
    def estimated_error(self) -> Array | None:
        """The error where it is an estimated one; None where it is a standard error, or none is stated."""
        return self.standard_error if self.error_kind == "estimated" else None

    @property
    def stokes(self) -> Array:
        """Stokes vectors (I, Q, U, V) referred to the meridian plane, shape (..., wavelength, 4)."""
        return np.stack([self.radiance, *(self._polarised(name) for name in "QUV")], axis=-1)

    @property
    def stokes_error(self) -> Array:
        """Errors of `stokes`, of its shape and of the sort `error_kind`."""
        return np.stack([self.standard_error, *(self._polarised(f"{name}_error") for name in "QUV")], axis=-1)

    def _polarised(self, name: str) -> Array:
        if name not in self.layers:
            raise DomainError("stokes", False, "polarisation was not computed; ask for it with stokes=True")
        return self.layers[name]


@dataclass(frozen=True)
class Options:
    """What may be asked of a solver; see `skyscatter.radiance` for the meaning of each.

    A solver refuses options that mean nothing to it.
    """

    samples: int | None = None
    noise: float | None = None
    seed: int = 0
    max_order: int | None = None
    tolerance: float | None = None
    sampling: str | None = None
    parts: bool = False
    orders: int = 0
    stokes: bool = False
    transmittance: str | None = None
    photons: int | None = None
    radius: float | None = None
    estimator: str | None = None
    direct: bool | None = None

    @property
    def layers(self) -> int:
        """Layers beside the radiance and its error, at most."""
        return self.orders + 4 * bool(self.parts) + 6 * bool(self.stokes)

    def check(self) -> None:
        """Refuse values that no solver can use."""
        _at_least("samples", self.samples, 2)  # one walk has no standard error
        _at_least("max_order", self.max_order, 1)
        _at_least("orders", self.orders, 0)
        _at_least("photons", self.photons, 1)
        if self.radius is not None and not 0 < self.radius < np.inf:
            raise DomainError("radius", self.radius, "a positive length [m]")
        if self.noise is not None and not 0 < self.noise < 1:
            raise DomainError("noise", self.noise, "a relative standard error between 0 and 1, such as 0.01")
        if self.tolerance is not None and not 1e-9 <= self.tolerance <= 0.1:
            raise DomainError("tolerance", self.tolerance, "a relative tolerance between 1e-9 and 0.1")
        if not 0 <= self.seed < 2**63:
            raise DomainError("seed", self.seed, "a whole number from 0 to 2^63 - 1")

    def refuse(self, solver: str, *names: str) -> None:
        """Raise for options that were given but mean nothing to `solver`."""
        plain = Options()
        for name in names:
            if getattr(self, name) != getattr(plain, name):
                rule = f"means nothing to the solver {solver}; leave it out, or choose another solver"
                raise DomainError(name, getattr(self, name), rule)


def _at_least(name: str, value: Any, lowest: int) -> None:
    if value is not None and (not isinstance(value, (int, np.integer)) or value < lowest):
        raise DomainError(name, value, f"a whole number, at least {lowest}")
