"""The one question every solver answers: the spectral radiance along rays, and how uncertain it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from skyscatter.errorkind import ErrorKind
from skyscatter.errors import DomainError
from skyscatter.solvers.options import SolverOptions

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
    asked: Asked[Any],
    threads: int,
    progress: Callable[[float], None] | None,
) -> Tables:
    """The tables of a scene; the rest of the arguments is for solvers that do more before the first ray."""
    from skyscatter.solvers.compile import compile_ground, compile_scene, matrix_tables
    from skyscatter.solvers.eclipse import eclipse_table, free_middle

    matrix = matrix_tables(scene.medium, tuple(float(w) for w in wavelengths)) if asked.stokes else None
    table = compile_scene(scene, wavelengths)._replace(eclipse=eclipse_table(scene, wavelengths))
    if table.eclipse.share.size:
        # A crescent shines from beside the middle of the disk, by as much all over the sky as here.
        towards = table.optics.sun_direction + free_middle(scene)
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        table = table._replace(optics=table.optics._replace(sun_direction=towards))
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


H = TypeVar("H", bound=SolverOptions, covariant=True)


@dataclass(frozen=True)
class Asked(Generic[H]):
    """What a solver is asked: how it goes about it, and which layers are wanted beside the radiance.

    Attributes
    ----------
    how : SolverOptions
        The record of the solver, see `skyscatter.solvers.options`.
    parts, orders, stokes
        As for `skyscatter.radiance`.
    """

    how: H
    parts: bool = False
    orders: int = 0
    stokes: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.orders, (int, np.integer)) or self.orders < 0:
            raise DomainError("orders", self.orders, "a whole number, at least 0")

    @property
    def layers(self) -> int:
        """Layers beside the radiance and its error, at most."""
        return self.orders + 4 * bool(self.parts) + 6 * bool(self.stokes)

    def refuse(self, solver: str, *names: str) -> None:
        """Raise for what was given but means nothing to `solver`, in words such as "path in shells"."""
        usual = {one.name: one.default for one in (*fields(self), *fields(self.how))}
        given = {**vars(self), **vars(self.how)}
        for name in names:
            if given[name] != usual[name]:
                rule = f"means nothing to the solver {solver}; leave it out, or choose another solver"
                raise DomainError(name, given[name], rule)
