"""What images of voxels are made of: where the cells are, what they do to light, and the lights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from skyscatter.media.voxels import VoxelGrid
    from skyscatter.space import SpaceScene

Array = NDArray[np.float64]


def henyey_greenstein_tables(g: ArrayLike) -> tuple[Array, Array]:
    """Tables of Henyey and Greenstein's phase function, and their derivatives with respect to g.

    Both at `solvers.compile.phase_cosines`.  The tables are scaled so that they integrate to 1 when interpolated,
    and the derivative is that of the scaled tables.

    Parameters
    ----------
    g : array_like, shape (component, wavelength)

    Returns
    -------
    values, slopes : ndarray, shape (component, angle, wavelength)
        [sr-1]
    """
    from skyscatter.solvers.compile import phase_cosines

    g = np.atleast_2d(np.asarray(g, float))[:, None, :]
    if np.any(~(np.abs(g) < 1)):
        raise DomainError("g", float(np.max(np.abs(g))), "an asymmetry between -1 and 1")
    mu = phase_cosines()[None, :, None]
    below = 1 + g * g - 2 * g * mu
    values = (1 - g * g) / (4 * np.pi) * below**-1.5
    slopes = -2 * g / (4 * np.pi) * below**-1.5 - 3 * (g - mu) / below * values
    # Weights of the trapezoidal rule between nodes that fall from 1 to -1.
    steps = -np.diff(mu[0, :, 0])
    weight = np.pi * (np.append(steps, 0.0) + np.insert(steps, 0, 0.0))
    total, change = (np.einsum("a,caw->cw", weight, a)[:, None, :] for a in (values, slopes))
    return values / total, slopes / total - values * change / total**2


@dataclass(frozen=True)
class VoxelFrame:
    """Where the cells of a grid are.

    Parameters
    ----------
    shape : (int, int, int)
        Cells along x, y and z.
    low, high : (3,)
        Corners of the grid [m].

    Examples
    --------
    A box of 4 m a side in four cells each way:

    >>> from skyscatter.inversion import VoxelFrame
    >>> frame = VoxelFrame.cube(4, 2.0)
    >>> frame.cell, frame.volume  # m, m3
    (array([1., 1., 1.]), 1.0)
    >>> frame.middles()[0, 0, 0]
    array([-1.5, -1.5, -1.5])
    >>> frame.with_shape((8, 8, 8)).volume
    0.125
    """

    shape: tuple[int, int, int]
    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        shape, low, high = (np.asarray(a, float) for a in (self.shape, self.low, self.high))
        if shape.shape != (3,) or np.any(shape < 1) or np.any(shape != np.round(shape)):
            raise DomainError("shape", self.shape, "three whole numbers of cells, at least 1")
        if low.shape != (3,) or high.shape != (3,) or not np.all(high > low):
            raise DomainError("high", self.high, f"three lengths [m] above low = {self.low}")
        object.__setattr__(self, "shape", tuple(int(n) for n in shape))
        object.__setattr__(self, "low", tuple(map(float, low)))
        object.__setattr__(self, "high", tuple(map(float, high)))

    @classmethod
    def cube(cls, cells: int, half_side: float) -> VoxelFrame:
        """Cubic cells in a cube about the origin; `half_side` [m]."""
        return cls((cells,) * 3, (-half_side,) * 3, (half_side,) * 3)

    @classmethod
    def of(cls, grid: VoxelGrid) -> VoxelFrame:
        """That of a density field, which must be trilinear and fall to zero at its edges."""
        if grid.interpolation != "linear" or grid.edge != "falling" or any(grid.periodic):
            raise DomainError("density", "VoxelGrid", 'needs interpolation="linear", edge="falling", no periods')
        low, high = grid.corners
        return cls(grid.cube.shape, tuple(low), tuple(high))

    @property
    def cell(self) -> Array:
        """Sides (3,) [m] of a cell."""
        return (np.array(self.high) - np.array(self.low)) / self.shape

    @property
    def volume(self) -> float:
        """Of a cell [m3]."""
        return float(np.prod(self.cell))

    def middles(self) -> Array:
        """Middles of the cells, shape (x, y, z, 3) [m]."""
        axes = [self.low[k] + (np.arange(self.shape[k]) + 0.5) * self.cell[k] for k in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def with_shape(self, shape: tuple[int, int, int]) -> VoxelFrame:
        """The same box in other cells."""
        return replace(self, shape=shape)

    def grid(self, values: ArrayLike, **options: Any) -> VoxelGrid:
        """A density field (x, y, z) in this frame; see `fields.VoxelGrid`."""
        from skyscatter.media.voxels import VoxelGrid

        return VoxelGrid.model_validate({"values": values, "low": self.low, "high": self.high, **options})


class VoxelOptics(NamedTuple):
    """What one unit of density does to light, component by component (c), and wavelength by wavelength (w).

    Examples
    --------
    A medium with the albedo 0.9 that throws light forwards, at two wavelengths:

    >>> from skyscatter.inversion import VoxelOptics
    >>> optics = VoxelOptics.make(sigma_s=[0.9, 0.45], sigma_t=[1.0, 0.5], g=0.6)
    >>> optics.sigma_t.shape  # component, wavelength
    (1, 2)
    >>> round(float(optics.phase[0, 0, 0] / optics.phase[0, -1, 0]))  # forwards over backwards
    64
    """

    sigma_s: Array  #: scattering (c, w) [m-1]
    sigma_t: Array  #: extinction (c, w) [m-1]
    emission: Array  #: (c, w) [W m-3 sr-1 nm-1]
    phase: Array  #: phase functions (c, angle, w) [sr-1] at the angles of `solvers.compile.phase_cosines`

    @classmethod
    def make(
        cls, sigma_s: ArrayLike, sigma_t: ArrayLike, emission: ArrayLike = 0.0, g: ArrayLike | None = None
    ) -> VoxelOptics:
        """Optics by numbers, which broadcast to (component, wavelength); `g` of Henyey-Greenstein's law."""
        numbers = [sigma_s, sigma_t, emission, 0.0 if g is None else g]
        s, t, j, a = (np.array(v) for v in np.broadcast_arrays(*(np.atleast_2d(np.asarray(n, float)) for n in numbers)))
        for name, values in (("sigma_s", s), ("sigma_t", t), ("emission", j)):
            if not np.all(np.isfinite(values)) or np.any(values < 0):
                raise DomainError(name, float(values.min()), "finite numbers, never negative")
        if np.any(s > t * (1 + 1e-12)):
            raise DomainError("sigma_s", float(s[s > t * (1 + 1e-12)][0]), "is a part of sigma_t and never exceeds it")
        return cls(s, t, j, henyey_greenstein_tables(a)[0])

    @classmethod
    def columns(cls) -> VoxelOptics:
        """The image is the column of the one component [m]: a unit of light a metre, and nothing in its way."""
        return cls.make(0.0, 0.0, 1.0)

    @classmethod
    def depths(cls, sigma_t: ArrayLike) -> VoxelOptics:
        """The image is the optical depth; `sigma_t` (component, wavelength) [m-1]."""
        return cls.make(0.0, 0.0, sigma_t)

    @classmethod
    def transmittances(cls, sigma_t: ArrayLike) -> VoxelOptics:
        """The image is the transmittance, where the background of the model is 1."""
        return cls.make(0.0, sigma_t, 0.0)


class VoxelLights(NamedTuple):
    """Stars and distant lights (s).

    Examples
    --------
    A star of 4 pi W nm-1 has the intensity 1 W sr-1 nm-1.

    >>> import numpy as np
    >>> from skyscatter.inversion import VoxelLights
    >>> lights = VoxelLights.stars([[0, 0, 0]], [[4 * np.pi]])
    >>> round(float(lights.power[0, 0]), 6)
    1.0
    >>> VoxelLights.none(3).power.shape  # star, wavelength
    (0, 3)
    """

    place: Array  #: (s, 3) [m], or the unit vector towards a distant light
    distant: NDArray[np.bool_]  #: (s,)
    power: Array  #: (s, w) intensity [W sr-1 nm-1], or irradiance [W m-2 nm-1] of a distant light
    size: Array  #: (s,) radius within which light does not grow [m]

    @classmethod
    def none(cls, wavelengths: int) -> VoxelLights:
        """Darkness."""
        return cls(np.zeros((0, 3)), np.zeros(0, bool), np.zeros((0, wavelengths)), np.zeros(0))

    @classmethod
    def stars(cls, places: ArrayLike, luminosities: ArrayLike) -> VoxelLights:
        """Point stars at places (s, 3) [m] with luminosities (s, w) [W nm-1] into all directions together."""
        place = np.atleast_2d(np.asarray(places, float))
        power = np.atleast_2d(np.asarray(luminosities, float)) / (4 * np.pi)
        return cls(place, np.zeros(len(place), bool), np.ascontiguousarray(power), np.zeros(len(place)))


def scene_frame(scene: SpaceScene) -> VoxelFrame:
    """The frame that all densities of a scene share."""
    from skyscatter.media.voxels import VoxelGrid

    frames = []
    for component in scene.medium.components:
        if not isinstance(component.density, VoxelGrid):
            raise DomainError("density", component.density.kind, "needs a VoxelGrid; or say where with `frame`")
        frames.append(VoxelFrame.of(component.density))
    if any(frame != frames[0] for frame in frames):
        raise DomainError("density", "VoxelGrid", "all components need cells at the same places")
    return frames[0]


def scene_densities(scene: SpaceScene) -> Array:
    """Densities (component, x, y, z) of a scene whose components are `VoxelGrid`s of one frame."""
    scene_frame(scene)
    return np.stack([float(c.density.factor) * np.asarray(c.density.cube, float) for c in scene.medium.components])  # type: ignore[union-attr]


#: Gauss-Legendre nodes of `mean_inverse_square`.
GAUSS = 24


def mean_inverse_square(x: Array, y: Array, z: Array) -> Array:
    """Mean of 1 / r^2 over the boxes between the planes x (i+1,), y (j+1,) and z (k+1,), r from the origin; (i, j, k).

    1 / r^2 is the divergence of r / r^2, and its integral over a box is that of h / r^2 over the six faces, h their
    distance from the origin (Gauss).  Over a face, with a = h sinh(s) the one coordinate,

        int da db / (a^2 + b^2 + h^2) = int [atan(b / (h cosh s))] ds,

    which is smooth wherever the origin lies; the remaining integral is by Gauss-Legendre.
    """
    planes, total = (x, y, z), np.zeros((x.size - 1, y.size - 1, z.size - 1))
    for k in range(3):
        first, second = planes[(k + 1) % 3], planes[(k + 2) % 3]
        through = np.zeros((planes[k].size, first.size - 1, second.size - 1))
        for n, h in enumerate(np.abs(planes[k])):
            if h > 0:
                through[n] = planes[k][n] * _over_faces(first, second, float(h))
        # Axes (k, k + 1, k + 2) back to (0, 1, 2).
        total += np.moveaxis(np.diff(through, axis=0), (0, 1, 2), (k, (k + 1) % 3, (k + 2) % 3))
    volume = np.diff(x)[:, None, None] * np.diff(y)[:, None] * np.diff(z)
    mean: Array = total / volume
    return mean


def _over_faces(a: Array, b: Array, h: float) -> Array:
    """Integrals of 1 / (a^2 + b^2 + h^2) between neighbouring a (i+1,) and b (j+1,); (i, j)."""
    node, weight = np.polynomial.legendre.leggauss(GAUSS)
    s = np.arcsinh(a / h)
    half = 0.5 * np.diff(s)
    at = 0.5 * (s[1:] + s[:-1])[:, None] + half[:, None] * node
    angle = np.arctan(b[:, None, None] / (h * np.cosh(at)))
    found: Array = (np.diff(angle, axis=0) * weight).sum(axis=2).T * half[:, None]
    return found
