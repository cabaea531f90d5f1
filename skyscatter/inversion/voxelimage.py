"""Images of voxels as a differentiable function of their densities.

Single scattering, emission and absorption in components given on one grid of cells: along a ray

    L = int [sum_c rho_c (j_c + sigma_s,c sum_s I_s / d_s^2 p_c(cos) exp(-tau_s))] exp(-tau) dt + B exp(-tau_end),

all wavelengths together (docs/theory/tomography.md, 135).  Density is trilinear between the middles of cells and falls
to zero half a cell outside, as `fields.VoxelGrid` has it, or is constant within cells (`interpolation`).  Maps of
columns, optical depths and transmittances are special cases of the optics: `VoxelOptics.columns`, `.depths`,
`.transmittances`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.voxelscene import VoxelFrame, VoxelLights, VoxelOptics, mean_inverse_square, scene_frame
from skyscatter.workers import Workers

if TYPE_CHECKING:
    from skyscatter.kernels.adjoint.march import MarchTable, Scratch
    from skyscatter.space import SpaceScene

Array = NDArray[np.float64]

#: Parts into which rays and nodes are cut for the threads: a fixed number, so that sums have a fixed order.
BLOCKS = 8
#: Fewer rays or nodes than this are not worth the threads.
FEW = 3000
#: Memory that the sums of all parts may take together [byte]; fewer parts where it would be more.
SUMS_MEMORY = 1 << 30
#: Distance within which the light of a star without a surface stops growing [side of a cell].
CLOSEST = 1e-6


@dataclass(frozen=True, repr=False)
class Slope(Brief):
    """Derivatives of one number (a misfit) with respect to everything that the model has; attributes in its units.

    Sizes: component (c), wavelength (w), star (s).
    """

    density: Array  #: (c, x, y, z)
    sigma_s: Array  #: (c, w), at fixed sigma_t
    sigma_t: Array  #: (c, w), at fixed sigma_s
    emission: Array  #: (c, w)
    phase: Array  #: (c, w), with respect to the parameter whose slope of the phase function was given
    power: Array  #: (s, w)
    background: Array  #: (w,)

    @property
    def luminosity(self) -> Array:
        """With respect to the luminosity of a star [W nm-1], or the irradiance of a distant light (s, w)."""
        return self.power / self._per_power

    _per_power: Array = field(default_factory=lambda: np.ones(1), repr=False)

    def extinction_albedo(self, optics: VoxelOptics) -> tuple[Array, Array]:
        """With respect to extinction at fixed albedo, and to albedo at fixed extinction, both (c, w)."""
        albedo = optics.sigma_s / np.where(optics.sigma_t > 0, optics.sigma_t, 1.0)
        return self.sigma_t + albedo * self.sigma_s, optics.sigma_t * self.sigma_s


class Prepared(NamedTuple):
    """Densities as the kernels read them."""

    density: Array  #: (node, c)
    toward: Array  #: (column node, s, c)


@dataclass(frozen=True)
class VoxelModel:
    """The light of voxels along rays, a smooth function of their densities (c, x, y, z).

    Parameters
    ----------
    frame : VoxelFrame
    optics : VoxelOptics
    lights : VoxelLights
    background : (wavelength,)
        Uniform radiance from outside [W m-2 sr-1 nm-1].
    step : float
        Longest step along a ray [shortest side of a cell].
    near : float
        Longest step as a share of the distance to the nearest star.
    fine : int
        Nodes at which columns to the stars are computed, per side of a cell; between them they are interpolated.
    interpolation : {"linear", "nearest"}
        Trilinear, or as codes on cells have it: density, and a star's light too, constant within each cell.  The light
        is then that at the middle, by the column there of trilinear densities, with the mean of 1 / distance^2 over
        the cell; rays go from face to face, and `step` and `near` are not needed.
    threads : int, optional
        All processors when not given.  Results do not depend on it.

    Examples
    --------
    A cube 4 m deep that shines and absorbs: emission 1 over extinction 0.5, times what it does not let through.

    >>> import numpy as np
    >>> from skyscatter.inversion import VoxelFrame, VoxelLights, VoxelModel, VoxelOptics
    >>> frame = VoxelFrame.cube(4, 2.0)
    >>> model = VoxelModel(frame, VoxelOptics.make(0.0, 0.5, 1.0), VoxelLights.none(1), np.zeros(1))
    >>> rho, ray = np.ones(frame.shape), ([[0, 0, -10.0]], [[0, 0, 1.0]])
    >>> light, slope = model.gradient(rho, *ray, weights=[[1.0]])
    >>> round(float(light[0, 0]), 3), round(float(1 / 0.5 * (1 - np.exp(-0.5 * 4))), 3)
    (1.729, 1.729)
    >>> slope.density.shape  # component, x, y, z
    (1, 4, 4, 4)
    """

    frame: VoxelFrame
    optics: VoxelOptics
    lights: VoxelLights
    background: Array
    step: float = 0.5
    near: float = 0.25
    fine: int = 1
    interpolation: Literal["linear", "nearest"] = "linear"
    threads: int | None = None

    def __post_init__(self) -> None:
        if not 0 < self.step <= 2:
            raise DomainError("step", self.step, "a share of a cell above 0, at most 2")
        if not 0 < self.near <= 1:
            raise DomainError("near", self.near, "a share of the distance to a star above 0, at most 1")
        if not (isinstance(self.fine, (int, np.integer)) and 1 <= self.fine <= 16):
            raise DomainError("fine", self.fine, "a whole number from 1 to 16")
        if self.interpolation not in ("linear", "nearest"):
            raise DomainError("interpolation", self.interpolation, "choose from linear, nearest")
        if self.interpolation == "nearest" and self.fine != 1:
            raise DomainError("fine", self.fine, "must be 1 with nearest, whose columns are those at the middles")
        shape = self.optics.sigma_t.shape
        for name, values in (("sigma_s", self.optics.sigma_s), ("emission", self.optics.emission)):
            if values.shape != shape:
                raise DomainError(name, values.shape, f"must have the shape of sigma_t, {shape}")
        if self.lights.power.shape != (len(self.lights.place), shape[1]):
            raise DomainError("power", self.lights.power.shape, "needs the shape (star, wavelength)")
        if np.shape(self.background) != shape[1:]:
            raise DomainError("background", np.shape(self.background), f"one number for each of {shape[1]} wavelengths")

    @classmethod
    def from_scene(
        cls, scene: SpaceScene, wavelengths: ArrayLike, frame: VoxelFrame | None = None, **options: Any
    ) -> VoxelModel:
        """A scene's optics and lights; its components' densities must be `VoxelGrid`s of one frame, or `frame` given.

        Parameters
        ----------
        scene : SpaceScene
        wavelengths : array_like, shape (wavelength,)
            Vacuum wavelengths [nm].
        frame : VoxelFrame, optional
            Where the unknown densities are; that of the scene's own densities when not given.
        **options
            `step`, `near`, `fine`, `interpolation`, `threads`.
        """
        from skyscatter.solvers.checks import check_wavelengths
        from skyscatter.solvers.compile import medium_optics

        wl = check_wavelengths(wavelengths)
        sigma_s, sigma_t, emission, phase, _ = medium_optics(scene.medium, tuple(float(w) for w in wl))
        used = frame or scene_frame(scene)
        distance, tiny = scene.view.distance, 1e-9 * float(np.linalg.norm(used.cell * used.shape))
        stars = scene.stars
        lights = VoxelLights(
            np.array([s.position for s in stars] + [p.towards for p in scene.parallel], float).reshape(-1, 3),
            np.array([False] * len(stars) + [True] * len(scene.parallel), bool),
            np.array(
                [s.spectral_luminosity(wl, distance) / (4 * np.pi) for s in stars]
                + [p.spectral_irradiance(wl) for p in scene.parallel],
                float,
            ).reshape(-1, wl.size),
            np.array([tiny if s.temperature is None else s.radius_m(distance) for s in stars]
                     + [0.0] * len(scene.parallel), float),
        )  # fmt: skip
        background = np.asarray(scene.background_radiance(wl), float)
        return cls(used, VoxelOptics(sigma_s, sigma_t, emission, phase), lights, background, **options)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Of densities: (component, x, y, z)."""
        return (len(self.optics.sigma_t), *self.frame.shape)

    def image(self, density: ArrayLike | Prepared, origins: ArrayLike, directions: ArrayLike) -> Array:
        """Light along rays [W m-2 sr-1 nm-1], shape (ray, wavelength).

        Parameters
        ----------
        density : array_like, shape (component, x, y, z) or (x, y, z)
            Or what `prepare` made of it.
        origins, directions : array_like, shape (ray, 3)
            [m], and unit vectors.
        """
        from skyscatter.kernels.adjoint.march import image_rays

        o, d = _rays(origins, directions)
        light = np.zeros((len(o), self.background.size))
        table = self._table(self.prepare(density))

        def work(part: slice, _: int) -> None:
            image_rays(table, o[part], d[part], self._scratch(), light[part])

        self._in_parts(len(o), work)
        return light

    def gradient(
        self,
        density: ArrayLike | Prepared,
        origins: ArrayLike,
        directions: ArrayLike,
        weights: ArrayLike,
        *,
        data: ArrayLike | None = None,
        optics: bool = False,
        phase_slope: Array | None = None,
    ) -> tuple[Array, Slope]:
        """The image, and the derivatives of sum(weights image), or of sum(weights (image - data)^2) / 2.

        One pass for all voxels, and for the optics and lights too where `optics` is true.

        Parameters
        ----------
        density, origins, directions
            As for `image`.
        weights : array_like, shape (ray, wavelength)
            The derivative of the loss with respect to the image; with `data`, one over the variance of the data.
        data : array_like, shape (ray, wavelength), optional
        optics : bool
            Fill the other attributes of `Slope`, which are zero otherwise.
        phase_slope : (component, angle, wavelength), optional
            Derivative of the phase tables with respect to a parameter, as of `voxelscene.henyey_greenstein_tables`.
        """
        from skyscatter.kernels.adjoint.march import Slopes, adjoint_rays

        o, d = _rays(origins, directions)
        light = np.zeros((len(o), self.background.size))
        weight = _like("weights", weights, light.shape)
        fused, given = data is not None, weight if data is None else _like("data", data, light.shape)
        ready = self.prepare(density)
        table = self._table(ready, optics)
        slope = np.zeros_like(self.optics.phase) if phase_slope is None else np.ascontiguousarray(phase_slope, float)
        if slope.shape != self.optics.phase.shape:
            raise DomainError("phase_slope", slope.shape, f"needs the shape {self.optics.phase.shape}")
        like = (*ready, *self.optics[:3], self.optics.sigma_t, self.lights.power, self.background)

        def work(part: slice, _: int) -> Any:
            sums = Slopes(*(np.zeros_like(a) for a in like))
            adjoint_rays(
                table, o[part], d[part], self._scratch(), light[part], given[part], weight[part], fused, slope,
                optics, sums,
            )  # fmt: skip
            return sums

        parts = self._in_parts(len(o), work, ready.density.nbytes + ready.toward.nbytes)
        total = [np.zeros_like(a) for a in like] if not parts else _added(parts)
        sums = Slopes(*total)
        nodes = sums.density + self._columns_back(sums.toward)
        # A luminosity goes into 4 pi; the irradiance of a distant light is its own power.
        per = np.where(self.lights.distant, 1.0, 4 * np.pi)[:, None]
        found = Slope(
            self._inner(nodes), sums.sigma_s, sums.sigma_t, sums.emission, sums.phase, sums.power, sums.background, per
        )
        return light, found

    def tangent(
        self, density: ArrayLike | Prepared, change: ArrayLike | Prepared, origins: ArrayLike, directions: ArrayLike
    ) -> tuple[Array, Array]:
        """The image, and its derivative along a change of the densities, both (ray, wavelength)."""
        from skyscatter.kernels.adjoint.march import tangent_rays

        o, d = _rays(origins, directions)
        light, moved = (np.zeros((len(o), self.background.size)) for _ in range(2))
        table, by = self._table(self.prepare(density)), self.prepare(change)

        def work(part: slice, _: int) -> None:
            tangent_rays(table, o[part], d[part], self._scratch(), by.density, by.toward, light[part], moved[part])

        self._in_parts(len(o), work)
        return light, moved

    def prepare(self, density: ArrayLike | Prepared) -> Prepared:
        """Densities on the padded nodes, and the columns to the stars: linear in the densities."""
        from skyscatter.kernels.adjoint.lightcolumns import columns_to_lights

        if isinstance(density, Prepared):
            return density
        values = np.asarray(density, float)
        if values.ndim == 3:
            values = values[None]
        if values.shape != self.shape:
            raise DomainError("density", values.shape, f"needs the shape {self.shape}")
        padded = np.zeros((*(n + 2 for n in self.frame.shape), len(values)))
        padded[1:-1, 1:-1, 1:-1] = np.moveaxis(values, 0, -1)
        nodes = padded.reshape(-1, len(values))
        stars = len(self.lights.place)
        count = self._column_nodes() if stars else 0
        toward = np.zeros((count, stars, len(values)))
        low, inverse, shape = self._geometry()
        lights, h = self.lights, self.step * float(self.frame.cell.min())

        def work(part: slice, _: int) -> None:
            columns_to_lights(
                nodes, shape, self.fine, low, inverse, lights.place, lights.distant, h, part.start, part.stop, toward
            )

        self._in_parts(count, work)
        return Prepared(nodes, toward)

    def _columns_back(self, slope: Array) -> Array:
        from skyscatter.kernels.adjoint.lightcolumns import columns_back

        low, inverse, shape = self._geometry()
        lights, h = self.lights, self.step * float(self.frame.cell.min())
        size = (int(np.prod(shape)), self.shape[0])

        def work(part: slice, _: int) -> list[Array]:
            out = np.zeros(size)
            columns_back(
                slope, shape, self.fine, low, inverse, lights.place, lights.distant, h, part.start, part.stop, out
            )
            return [out]

        parts = self._in_parts(len(slope), work, 8 * size[0] * size[1])
        return _added(parts)[0] if parts else np.zeros(size)

    def _inner(self, nodes: Array) -> Array:
        """From slopes at the padded nodes to those of the cells (c, x, y, z): those around are always zero."""
        cube = nodes.reshape(*(n + 2 for n in self.frame.shape), -1)
        return np.ascontiguousarray(np.moveaxis(cube[1:-1, 1:-1, 1:-1], -1, 0))

    def _column_nodes(self) -> int:
        return int(np.prod([(n + 1) * self.fine + 1 for n in self.frame.shape]))

    def _geometry(self) -> tuple[Array, Array, NDArray[np.int64]]:
        cell = self.frame.cell
        return np.array(self.frame.low) - 0.5 * cell, 1 / cell, np.array(self.frame.shape, np.int64) + 2

    def _table(self, ready: Prepared, emits: bool = False) -> MarchTable:
        from skyscatter.kernels.adjoint.march import MarchTable

        low, inverse, shape = self._geometry()
        cell = float(self.frame.cell.min())
        size = np.maximum(self.lights.size, CLOSEST * cell)
        sigma_s, sigma_t, emission, phase = (np.ascontiguousarray(a, dtype=float) for a in self.optics)
        return MarchTable(
            ready.density, ready.toward, shape, int(self.fine), low, inverse, sigma_s, sigma_t, emission, phase,
            self.lights.power, self.lights.place, self.lights.distant, size, np.asarray(self.background, float),
            self.step * cell, bool(emits or np.any(self.optics.emission)), float(self.near),
            self.interpolation == "nearest", self._spread,
        )  # fmt: skip

    @cached_property
    def _spread(self) -> Array:
        """Mean of 1 / distance^2 to every star over the cell of every padded node (node, s), 1 for a distant one."""
        if self.interpolation != "nearest":
            return np.zeros((0, len(self.lights.place)))
        low, _, shape = self._geometry()
        cell, out = self.frame.cell, np.ones((*shape, len(self.lights.place)))
        axes = [low[k] + (np.arange(shape[k] + 1) - 0.5) * cell[k] for k in range(3)]
        for s, place in enumerate(self.lights.place):
            if not self.lights.distant[s]:
                out[..., s] = mean_inverse_square(*(a - p for a, p in zip(axes, place, strict=True)))
        return out.reshape(int(np.prod(shape)), len(self.lights.place))

    def _scratch(self) -> Scratch:
        from skyscatter.kernels.adjoint.march import Scratch

        (c, w), s = self.optics.sigma_t.shape, len(self.lights.place)
        cells = np.linalg.norm(self.frame.cell * (np.array(self.frame.shape) + 1)) / (self.step * self.frame.cell.min())
        # Steps shrink by 1 - near on the way to a star at the least, and grow by 1 + near behind it.
        each = 2 * np.log(1 / (self.near * CLOSEST)) / np.log1p(self.near) + 4 / self.near
        n = int(np.ceil(cells + each * np.count_nonzero(~self.lights.distant))) + 16
        if self.interpolation == "nearest":
            # A ray crosses every face of the grid once.
            n = sum(self.frame.shape) + 16
        return Scratch(
            np.zeros((n, 3)), np.zeros(n), np.zeros((n, c)), np.zeros((n, s, c)), np.zeros((n, s)), np.zeros((n, s)),
            np.zeros((n, w)), np.zeros((n, s, w)), np.zeros(c), np.zeros(w), np.zeros((s, 2)), np.zeros(c),
            np.zeros((s, c)), np.zeros((4, w)),
        )  # fmt: skip

    def _in_parts(self, count: int, work: Callable[[slice, int], Any], memory: int = 0) -> list[Any]:
        """Do work(part, number) for equal parts of `count` things in a pool of threads; what it returned, in order."""
        from skyscatter.solvers.checks import worker_count

        blocks = BLOCKS if memory == 0 else int(np.clip(SUMS_MEMORY // max(memory, 1), 1, BLOCKS))
        ends = np.linspace(0, count, blocks + 1).astype(int)
        parts = [slice(int(a), int(b)) for a, b in pairwise(ends) if b > a]
        if count < FEW:
            return [work(part, k) for k, part in enumerate(parts)]
        with Workers(max_workers=worker_count(self.threads)) as pool:
            return list(pool.map(work, parts, range(len(parts))))


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    o, d = np.broadcast_arrays(np.asarray(origins, float), np.asarray(directions, float))
    if o.ndim != 2 or o.shape[1] != 3:
        raise DomainError("directions", d.shape, "origins and directions are arrays of shape (ray, 3)")
    if d.size and not np.allclose(np.linalg.norm(d, axis=1), 1.0, atol=1e-6):
        raise DomainError("directions", float(np.linalg.norm(d, axis=1).min()), "must be unit vectors")
    return np.array(o, order="C"), np.array(d, order="C")  # copies: kernels take arrays that may be written to


def _like(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    try:
        # A copy always: kernels are compiled for arrays that may be written to.
        return np.array(np.broadcast_to(np.asarray(values, float), shape), order="C")
    except ValueError as error:
        raise DomainError(name, np.shape(values), f"needs the shape (ray, wavelength) = {shape}") from error


def _added(parts: list[Any]) -> list[Array]:
    """Sums of the arrays of all parts, in their order."""
    total = [np.array(a) for a in parts[0]]
    for part in parts[1:]:
        for have, more in zip(total, part, strict=True):
            have += more
    return total
