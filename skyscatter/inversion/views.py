"""Images with what is known of them: where their rays run, and how noisy they are."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError

if TYPE_CHECKING:
    from skyscatter.space import SpaceScene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ImageView:
    """One image of the thing that is sought.

    Attributes
    ----------
    data, sigma : ndarray, shape (y, x, wavelength)
        What was measured, and its standard deviation; infinite where the image says nothing.
    origins, directions : ndarray, shape (y, x, ray, 3)
        Rays of every pixel, whose mean the pixel shows [m], unit vectors.

    Examples
    --------
    An image of 4 x 4 pixels, seen from far up the z axis, x to the right; its first row is the top.

    >>> import numpy as np
    >>> from skyscatter.inversion import ImageView
    >>> view = ImageView.parallel(np.ones((4, 4)), 0.1, towards=[0, 0, 1], right=[1, 0, 0], half_width=2.0)
    >>> view.data.shape, view.origins.shape
    ((4, 4, 1), (4, 4, 1, 3))
    >>> view.origins[0, 0, 0, :2], view.directions[0, 0, 0, 2]
    (array([-1.5,  1.5]), np.float64(-1.0))

    A pixel without a value counts for nothing:

    >>> float(ImageView.parallel([[np.nan]], 0.1, [0, 0, 1], [1, 0, 0], 1.0).sigma[0, 0, 0])
    inf
    """

    data: Array
    sigma: Array
    origins: Array
    directions: Array

    @classmethod
    def make(cls, data: ArrayLike, sigma: ArrayLike, origins: ArrayLike, directions: ArrayLike) -> ImageView:
        """From arrays: data (y, x) or (y, x, wavelength), rays (y, x, 3) or (y, x, ray, 3); NaN is no data."""
        image = np.array(data, float)
        image = image[..., None] if image.ndim == 2 else image
        if image.ndim != 3 or not image.size:
            raise DomainError("data", image.shape, "an image needs the shape (y, x) or (y, x, wavelength)")
        error = np.asarray(sigma, float)
        error = error[..., None] if error.ndim == 2 else error
        try:
            error = np.array(np.broadcast_to(error, image.shape))
        except ValueError as problem:
            raise DomainError("sigma", np.shape(sigma), f"needs the shape of the data, {image.shape}") from problem
        if np.any(error <= 0):
            raise DomainError("sigma", float(np.nanmin(error)), "a standard deviation is positive; infinite is no data")
        o, d = np.broadcast_arrays(np.asarray(origins, float), np.asarray(directions, float))
        if o.ndim == 3:
            o, d = o[:, :, None], d[:, :, None]
        if o.ndim != 4 or o.shape[:2] != image.shape[:2] or o.shape[3] != 3:
            raise DomainError("directions", d.shape, f"needs a ray for each pixel of {image.shape[:2]}")
        blind = ~np.isfinite(image) | ~np.isfinite(error) | ~np.isfinite(d).all(axis=(2, 3))[..., None]
        error[blind] = np.inf
        image[blind] = 0.0
        # Pixels outside a camera's field keep a ray that leads nowhere.
        d = np.where(np.isfinite(d), d, np.array([0.0, 0.0, 1.0]))
        return cls(image, error, np.array(o, order="C"), np.ascontiguousarray(d))

    @classmethod
    def from_camera(
        cls,
        data: ArrayLike,
        sigma: ArrayLike,
        camera: Any,
        observer: Any,
        rays: int = 1,
        *,
        scene: SpaceScene | None = None,
    ) -> ImageView:
        """As a camera of skyscatter sees it; `rays` along each side of a pixel.

        Parameters
        ----------
        data, sigma : array_like
            As for `make`; the first row is the top.
        camera : Telescope
        observer : View
            Where from; as `SpaceScene.view`.
        rays : int
            Along each side of a pixel, evenly spread.
        scene : SpaceScene, optional
            Whose stars are in the image.  Pixels around them say nothing of the matter before or around them: they
            are left out.  Without, stars that are seen are taken for bright matter.
        """
        finer = _finer(camera, rays)
        grid = finer.directions(observer)
        h, w = camera.height, camera.width
        directions = grid.reshape(h, rays, w, rays, 3).transpose(0, 2, 1, 3, 4).reshape(h, w, rays * rays, 3)
        seen = np.array(data, float)
        if scene is not None:
            seen[_starry({"scene": scene.model_dump(mode="json")}, camera)] = np.nan
        return cls.make(seen, sigma, np.asarray(observer.position, float), directions)

    @classmethod
    def parallel(
        cls,
        data: ArrayLike,
        sigma: ArrayLike,
        towards: ArrayLike,
        right: ArrayLike,
        half_width: float,
        *,
        rays: int = 1,
        distance: float | None = None,
        upwards: bool = False,
    ) -> ImageView:
        """As seen from infinitely far: all rays are parallel.

        Parameters
        ----------
        towards : (3,)
            From the thing to the observer.
        right : (3,)
            To the right of the image, at right angles to `towards`; up is ``towards x right``.
        half_width : float
            From the middle of the image, which is the origin, to its left and right edges [m].
        rays : int
            Along each side of a pixel.
        distance : float
            From which rays start [m]; 1000 half widths when not given.
        upwards : bool
            The first row is the lowest.
        """
        n, r = (np.asarray(a, float) / np.linalg.norm(a) for a in (towards, right))
        if abs(n @ r) > 1e-6:
            raise DomainError("right", tuple(map(float, r)), "must be at right angles to towards")
        up = np.cross(n, r)
        h, w = np.shape(data)[:2]
        pixel = 2 * half_width / w
        x = (np.arange(w * rays) + 0.5) / rays * pixel - half_width
        y = ((np.arange(h * rays) + 0.5) / rays - h / 2) * pixel
        y = y if upwards else -y
        away = 1000 * half_width if distance is None else distance
        grid = x[None, :, None] * r + y[:, None, None] * up + away * n
        origins = grid.reshape(h, rays, w, rays, 3).transpose(0, 2, 1, 3, 4).reshape(h, w, rays * rays, 3)
        return cls.make(data, sigma, origins, -n)

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], camera: Any, observer: Any, *, sigma: ArrayLike | None = None, rays: int = 1
    ) -> ImageView:
        """From an image file of skyscatter (FITS, EXR, netCDF) with its standard errors, or with `sigma`.

        Pixels around the stars of the scene in its recipe are left out.
        """
        from skyscatter.image.spectral import SpectralImage

        image = SpectralImage.load(path).undenoised
        error = image.standard_error if sigma is None else sigma
        if error is None or (sigma is None and not np.any(np.asarray(error) > 0)):
            raise DomainError("sigma", None, f"{path} holds no standard errors; give those of the data")
        seen = np.array(image.radiance, float)
        seen[_starry(image.recipe, camera)] = np.nan
        return cls.from_camera(seen, error, camera, observer, rays)

    @property
    def rays(self) -> int:
        """Of a pixel."""
        return self.origins.shape[2]


class Stack:
    """All pixels of all views in one row.

    Attributes
    ----------
    data, weight : ndarray, shape (pixel, wavelength)
        Weight is one over the variance; zero where there are no data.
    origins, directions : ndarray, shape (pixel * ray, 3)
    """

    def __init__(self, views: Sequence[ImageView]) -> None:
        if not views:
            raise DomainError("views", 0, "at least one image is needed")
        if len({v.rays for v in views}) > 1 or len({v.data.shape[2] for v in views}) > 1:
            raise DomainError("views", len(views), "all need as many rays to a pixel, and the same wavelengths")
        self.shapes = [v.data.shape for v in views]
        self.rays = views[0].rays
        w = views[0].data.shape[2]
        self.data = np.concatenate([v.data.reshape(-1, w) for v in views])
        self.weight = 1 / np.concatenate([v.sigma.reshape(-1, w) for v in views]) ** 2
        self.origins = np.concatenate([v.origins.reshape(-1, 3) for v in views])
        self.directions = np.concatenate([v.directions.reshape(-1, 3) for v in views])
        if not np.any(self.weight > 0):
            raise DomainError("sigma", "infinite", "no pixel says anything")

    @property
    def count(self) -> int:
        """Of data."""
        return int(np.count_nonzero(self.weight))

    def split(self, flat: Array) -> list[Array]:
        """Rows (pixel, wavelength) back to images."""
        sizes = np.cumsum([s[0] * s[1] for s in self.shapes])[:-1]
        return [part.reshape(s) for part, s in zip(np.split(flat, sizes), self.shapes, strict=True)]


def _starry(recipe: dict[str, Any], camera: Any) -> NDArray[np.bool_]:
    """Pixels around the stars of a recipe's scene, as the camera sees them."""
    from skyscatter.inversion.images import around_stars

    return around_stars(recipe, camera, (camera.height, camera.width))


def _finer(camera: Any, rays: int) -> Any:
    """The same camera with pixels cut into rays x rays."""
    if rays == 1:
        return camera
    if rays < 1 or not hasattr(camera, "pixel_scale_deg"):
        raise DomainError("rays", rays, "a whole number, at least 1; more than 1 with a Telescope only")
    # The focal length is one over the scale of a pixel in the middle: a pixel of a fraction has that fraction's scale.
    sizes = {"width": camera.width * rays, "height": camera.height * rays}
    return camera.model_copy(update={**sizes, "pixel_scale_deg": camera.pixel_scale_deg / rays})
