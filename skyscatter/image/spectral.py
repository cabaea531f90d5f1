"""The result of every rendering: spectral radiance in each pixel, its standard error, and how it was made."""

from __future__ import annotations

import importlib
import json
import os
import re
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errorkind import ErrorKind, kind_of
from skyscatter.errors import DomainError, MissingDataError
from skyscatter.image import colour, nightvision
from skyscatter.image import polarisation as polar
from skyscatter.image import tone as tones
from skyscatter.image.dataset import to_dataset
from skyscatter.image.skyframe import SkyFrame
from skyscatter.workers import in_parts

if TYPE_CHECKING:
    import xarray
    from colour import MultiSpectralDistributions
    from matplotlib.axes import Axes

    from skyscatter.image.filterimage import FilterImage

Array = NDArray[np.float64]


#: Options of pictures made from three filters.
_PLANE_OPTIONS = ("palette", "filters", "stretch", "softening", "levels", "continuum")
#: Extension -> module and the options that its writer takes.
_WRITERS: dict[str, tuple[str, tuple[str, ...]]] = {
    ".exr": ("exr", ("spectral", "scale", "half")),
    ".hdr": ("hdr", ("scale",)),
    ".png": (
        "png",
        (
            *("space", "exposure", "tone", "bits", "show", "wavelength", "labels", "lines", "look", "glare"),
            *_PLANE_OPTIONS,
        ),
    ),
    ".fits": ("fits", ("filters", "dtype", "compress", "unit")),
    ".nc": ("netcdf", ("dtype", "unit")),
    ".zarr": ("zarrfolder", ("dtype",)),
}
_READERS = tuple(ext for ext in _WRITERS if ext not in (".png", ".hdr"))
#: Rows of a picture that a thread looks through at a time.
ROWS = 64
_LAYER_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")


class SpectralImage:
    """An image with a spectrum in each pixel.

    Parameters
    ----------
    radiance : array_like, shape (y, x, wavelength)
        Spectral radiance [W m-2 sr-1 nm-1]; the first row is the top of the picture.  float32 stays float32, all else
        becomes float64.  A pixel that is NaN lies outside the camera's field: black or transparent in pictures.
    wavelengths : array_like, shape (wavelength,)
        Ascending vacuum wavelengths [nm].
    standard_error : array_like, shape (y, x, wavelength), optional
        Error of `radiance`, in the same unit; `error_kind` says of which sort.
    recipe : mapping, optional
        How to make the image again (model, solver, seed, version, ...); whatever JSON can hold.
    layers : mapping of str to array_like, shape (y, x, wavelength), optional
        Named parts of the radiance, for instance direct, ground and scattered light, or orders of scattering.  Layers
        named Q, U and V make the image polarised: Stokes parameters in the frame of docs/conventions.md, and Q_error,
        U_error, V_error their standard errors.
    sky : SkyFrame, optional
        Where the picture stands in the sky; files keep it (FITS as a celestial WCS).
    features : array_like, shape (y, x, 4), optional
        What the pixels see first, by which `denoised` tells edges from noise: its albedo, and the unit vector of the
        way that it faces.  Files do not keep it.

    Raises
    ------
    DomainError
        If shapes do not fit, wavelengths do not ascend, a value is infinite, or the recipe is not JSON.

    Examples
    --------
    >>> import numpy as np
    >>> import skyscatter
    >>> cube = np.full((2, 3, 41), 0.01)  # two rows of three pixels [W m-2 sr-1 nm-1]
    >>> image = skyscatter.SpectralImage(cube, np.arange(380, 781, 10))
    >>> image
    SpectralImage(3 x 2 pixels, 41 wavelengths, 380 to 780 nm, layers: none)
    >>> float(image.luminance()[0, 0].round(-1))  # cd m-2
    730.0
    """

    def __init__(
        self,
        radiance: ArrayLike,
        wavelengths: ArrayLike,
        standard_error: ArrayLike | None = None,
        *,
        recipe: Mapping[str, Any] | None = None,
        layers: Mapping[str, ArrayLike] | None = None,
        sky: SkyFrame | None = None,
        features: ArrayLike | None = None,
    ) -> None:
        self._wavelengths = _checked_wavelengths(wavelengths)
        self._radiance = _checked_cube("radiance", radiance, None, self._wavelengths.size)
        shape = self._radiance.shape
        self._error = None if standard_error is None else _checked_cube("standard_error", standard_error, shape)
        if self._error is not None and any((row < 0.0).any() for row in self._error):
            raise DomainError("standard_error", float(np.nanmin(self._error)), "must not be negative")
        self._layers: dict[str, NDArray[Any]] = {}
        for name, values in (layers or {}).items():
            if not isinstance(name, str) or not _LAYER_NAME.fullmatch(name):
                raise DomainError("layer name", name, "letters, digits, - and _ only, 40 at most, no - or _ first")
            self._layers[name] = _checked_cube(f"layer {name}", values, shape)
        try:
            self._recipe: dict[str, Any] = json.loads(json.dumps(dict(recipe or {}), allow_nan=False))
        except (TypeError, ValueError) as error:
            raise DomainError("recipe", type(recipe).__name__, f"must be a JSON object ({error})") from error
        if sky is not None and not isinstance(sky, SkyFrame):
            raise DomainError("sky", type(sky).__name__, "must be a SkyFrame")
        self._sky = sky
        self._features = None if features is None else np.asarray(features)
        if self._features is not None and self._features.shape != (*shape[:2], 4):
            raise DomainError("features", self._features.shape, f"must have the shape {(*shape[:2], 4)}")

    def __repr__(self) -> str:
        y, x, n = self.shape
        span = f"{self._wavelengths[0]:g} to {self._wavelengths[-1]:g} nm"
        return f"SpectralImage({x} x {y} pixels, {n} wavelengths, {span}, layers: {', '.join(self._layers) or 'none'})"

    @property
    def radiance(self) -> NDArray[Any]:
        """Spectral radiance [W m-2 sr-1 nm-1], shape (y, x, wavelength)."""
        return self._radiance

    @property
    def wavelengths(self) -> Array:
        """Vacuum wavelengths [nm], shape (wavelength,)."""
        return self._wavelengths

    @property
    def standard_error(self) -> NDArray[Any] | None:
        """The same as `error`, by the name that images of all solvers share."""
        return self._error

    @property
    def error(self) -> NDArray[Any] | None:
        """Error of `radiance`, of the sort `error_kind`, same shape and unit; None if unknown."""
        return self._error

    @property
    def error_kind(self) -> ErrorKind:
        """Sort of error that the image states: "standard", "estimated" (``orders``, or `denoised`) or "none"."""
        return "estimated" if self.is_denoised else kind_of(self._recipe.get("solver"))

    @property
    def estimated_error(self) -> NDArray[Any] | None:
        """The error where it is an estimated one; None where it is a standard error, or none is stated."""
        return self._error if self.error_kind == "estimated" else None

    @property
    def is_denoised(self) -> bool:
        """Whether the radiance is that of `denoised`, and what was computed stands in the layer ``raw``."""
        return "denoising" in self._recipe

    def denoised(self, method: str = "auto") -> SpectralImage:
        """The image without most of its noise: for looking at; never fit or compare it, take the layer ``raw``.

        A denoiser is applied to two independent halves of the samples, each is judged by the other, and the result is
        mixed with the raw picture by what that says (see `skyscatter.image.denoising`).

        Parameters
        ----------
        method : {"auto", "oidn", "nlm"}
            Open Image Denoise (``pip install pyoidn``), a statistical filter that is always there, or
            the former where it is installed.

        Returns
        -------
        SpectralImage
            Its `error` is an estimated one, from the comparison of the halves.  Layers ``raw`` and ``raw_error`` are
            the radiance and the standard error as they were, other layers as they were, too; ``recipe["denoising"]``
            has the method and the relative errors of the picture and of its tiles, before and after.

        Raises
        ------
        DomainError
            For an image that was not rendered with ``halves=True``, and a method that there is not.

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> a, b = 1 + 0.2 * np.random.default_rng(1).normal(size=(2, 64, 64, 3))
        >>> error = np.full(a.shape, 0.2 / np.sqrt(2))
        >>> halves = {"half_a": a, "half_b": b}
        >>> noisy = skyscatter.SpectralImage((a + b) / 2, [450, 550, 650], error, layers=halves)
        >>> clean = noisy.denoised("nlm")
        >>> bool(clean.radiance.std() < 0.2 * noisy.radiance.std()), clean.error_kind, list(clean.layers)
        (True, 'estimated', ['raw', 'raw_error'])
        """
        from skyscatter.image.denoising import denoised

        return denoised(self, method)

    @property
    def undenoised(self) -> SpectralImage:
        """The image as it was computed: with the layers ``raw`` and ``raw_error`` as radiance and standard error.

        An image that is not `denoised` is returned as it is.

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> image = skyscatter.SpectralImage(np.ones((2, 3, 1)), [550])
        >>> image.undenoised is image
        True
        """
        if not self.is_denoised:
            return self
        from skyscatter.image.denoising import undenoised

        return undenoised(self)

    @property
    def recipe(self) -> dict[str, Any]:
        """How to make the image again."""
        return self._recipe

    @property
    def layers(self) -> dict[str, NDArray[Any]]:
        """Named parts of the radiance, each of shape (y, x, wavelength)."""
        return self._layers

    @property
    def sky(self) -> SkyFrame | None:
        """Where the picture stands in the sky; None if it does not say."""
        return self._sky

    @property
    def features(self) -> NDArray[Any] | None:
        """What the pixels see first, (y, x, 4): albedo and the way that it faces; None where that is not known."""
        return self._features

    @property
    def shape(self) -> tuple[int, int, int]:
        """(y, x, wavelength)."""
        y, x, n = self._radiance.shape
        return y, x, n

    @property
    def inside(self) -> NDArray[np.bool_]:
        """True where a pixel lies inside the camera's field, shape (y, x)."""
        return self._inside.copy()

    @cached_property
    def _inside(self) -> NDArray[np.bool_]:
        return np.stack([~np.isnan(row).any(axis=-1) for row in self._radiance])  # no mask of the whole cube

    @cached_property
    def dataset(self) -> xarray.Dataset:
        """The same arrays, labelled, as an xarray Dataset with units and CF attributes."""
        return to_dataset(self)

    @property
    def polarised(self) -> bool:
        """True if there are Stokes layers Q, U and V."""
        return all(name in self._layers for name in polar.STOKES)

    @property
    def degree_of_linear_polarisation(self) -> Array:
        """``sqrt(Q² + U²) / I``, shape (y, x, wavelength); NaN where there is no light.

        Noise in Q and U never averages out of a root of squares: where the true degree is small, this estimate is too
        large, by about the relative standard error of Q and U.

        Raises
        ------
        DomainError
            If the image has no Stokes layers, as do the next two.
        """
        i, q, u, _ = polar.stokes(self)
        return polar.degree(i, q, u)

    @property
    def degree_of_polarisation(self) -> Array:
        """``sqrt(Q² + U² + V²) / I``, shape (y, x, wavelength); NaN where there is no light."""
        i, q, u, v = polar.stokes(self)
        return polar.degree(i, q, u, v)

    @property
    def angle_of_linear_polarisation(self) -> Array:
        """``atan2(U, Q) / 2`` [degree] in 0 to 180, 180 excluded, shape (y, x, wavelength).

        From the meridian plane through the line of sight and the zenith, anticlockwise as the observer sees it: 0 is
        vertical, 90 horizontal.  NaN where there is no light or no linear polarisation.
        """
        i, q, u, _ = polar.stokes(self)
        return polar.angle(i, q, u)

    def layer(self, name: str) -> SpectralImage:
        """One layer as an image of its own (without a standard error, which layers do not have).

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> cube = np.full((2, 3, 2), 0.01)
        >>> image = skyscatter.SpectralImage(cube, [450, 650], layers={"ground": 0.25 * cube})
        >>> float((image.layer("ground").radiance / image.radiance).mean())  # the ground's share
        0.25
        """
        if name not in self._layers:
            raise DomainError("layer", name, f"one of {', '.join(self._layers) or '(this image has none)'}")
        return SpectralImage(
            self._layers[name], self._wavelengths, recipe={**self._recipe, "layer": name}, sky=self._sky
        )

    def placed(self, sky: SkyFrame) -> SpectralImage:
        """The same picture, with its arrays, at a place in the sky."""
        return SpectralImage(
            self._radiance, self._wavelengths, self._error, recipe=self._recipe, layers=self._layers, sky=sky,
            features=self._features,
        )  # fmt: skip

    def through(
        self, *filters: str | Iterable[Any] | Any, errors: Literal["correlated", "independent"] = "correlated"
    ) -> FilterImage:
        """Radiance averaged over the bands of filters, a plane for each.

        Parameters
        ----------
        *filters : str, path or FilterCurve
            Names, one by one or with commas between them (``"B,V,R"``), paths of csv files and `FilterCurve`, or one
            list of those; see `skyscatter.image.filters` for the names and for what the average is.
        errors : {"correlated", "independent"}
            How the standard errors of the wavelengths combine.  Random walks carry all wavelengths at once, so by
            default they are taken as fully correlated, which is right for grey errors and else an upper bound;
            ``"independent"`` is right for photon noise.

        Raises
        ------
        DomainError
            For an unknown filter, and where the wavelengths cover less than 90 % of one.

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> image = skyscatter.SpectralImage(np.ones((2, 3, 41)), np.arange(380, 781, 10))
        >>> bands = image.through("B,V")
        >>> bands.radiance.shape, [round(share, 2) for share in bands.coverage]
        ((2, 3, 2), [1.0, 1.0])
        """
        from skyscatter.image.filterimage import through

        return through(self, filters[0] if len(filters) == 1 else filters, errors)

    def xyz(self) -> Array:
        """Absolute CIE 1931 XYZ, shape (y, x, 3); Y in cd m-2.  See `skyscatter.image.colour.xyz_weights`."""
        return self._xyz.copy()

    @cached_property
    def _xyz(self) -> Array:
        return colour.spectrum_to_xyz(self._radiance, self._wavelengths)

    def luminance(self) -> Array:
        """Luminance [cd m-2], shape (y, x).

        Examples
        --------
        Light of 1 W m-2 sr-1 at 555 nm has 683 cd m-2, however the cells divide it.

        >>> import numpy as np
        >>> import skyscatter
        >>> image = skyscatter.SpectralImage(np.array([[[0.0, 0.5, 0.0]]]), [553, 555, 557])
        >>> float(image.luminance()[0, 0].round())
        683.0
        """
        return self.xyz()[..., 1]

    def to_colour(self) -> MultiSpectralDistributions:
        """The spectra as a ``colour.MultiSpectralDistributions`` of colour-science, one a pixel.

        Labels are "y,x".  Of large pictures take a part: that class is made for hundreds of spectra, not for millions.

        Returns
        -------
        colour.MultiSpectralDistributions
            Radiance [W m-2 sr-1 nm-1] over wavelength [nm].

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> image = skyscatter.SpectralImage(np.full((1, 2, 5), 0.01), [400, 475, 550, 625, 700])
        >>> spectra = image.to_colour()
        >>> spectra.labels, spectra.signals["0,1"].values.tolist()
        (['0,0', '0,1'], [0.01, 0.01, 0.01, 0.01, 0.01])
        """
        from skyscatter.spectra.library import colour_science

        y, x, n = self.shape
        labels = [f"{row},{column}" for row in range(y) for column in range(x)]
        spectra = self._radiance.reshape(y * x, n).T
        return colour_science().MultiSpectralDistributions(spectra, self._wavelengths, labels=labels)

    def mean_colour(self) -> dict[str, float | list[float] | None] | None:
        """What colour the light of all pixels together has; None for one wavelength, which has none, and in the dark.

        Returns
        -------
        dict or None
            ``chromaticity``: CIE 1931 x, y.  ``temperature_K``: correlated colour temperature, None where colours are
            further from black bodies than the notion holds.  ``dominant_wavelength_nm``: beside daylight (D65),
            negative for purples; None for a grey.

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> wavelengths = np.arange(380, 781, 10)
        >>> blue = skyscatter.SpectralImage((wavelengths / 550.0).reshape(1, 1, -1) ** -4, wavelengths)
        >>> blue.mean_colour()["dominant_wavelength_nm"]
        472.9
        """
        if self._wavelengths.size == 1 or not self._inside.any():
            return None
        xyz = self._xyz[self._inside].mean(axis=0)
        if not xyz.sum() > 0.0:
            return None
        temperature, wavelength = float(colour.cct(xyz)), float(colour.dominant_wavelength(xyz))
        return {
            "chromaticity": [round(float(part), 4) for part in xyz[:2] / xyz.sum()],
            "temperature_K": round(temperature) if np.isfinite(temperature) else None,
            "dominant_wavelength_nm": round(wavelength, 1) if np.isfinite(wavelength) else None,
        }

    def rgb(self, space: str = "srgb") -> Array:
        """Scene-linear RGB in "srgb", "display-p3", "rec2020", "acescg" or any space of colour-science, (y, x, 3).

        White of 1 cd m-2 is 1; not clipped, so colours outside the space have negative components.

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> wavelengths = np.arange(380, 781, 10)
        >>> blue = skyscatter.SpectralImage((wavelengths / 550.0).reshape(1, 1, -1) ** -4, wavelengths)
        >>> rgb = blue.rgb()[0, 0]
        >>> (rgb / rgb[1]).round(1)  # relative to green
        array([0.7, 1. , 2.3])
        """
        colour.colour_space(space)
        return colour.xyz_to_rgb(self.xyz(), space)

    def auto_exposure(self) -> float:
        """Exposure value (EV at ISO 100) that "auto" stands for; see `skyscatter.image.tone.auto_ev100`."""
        return self._exposed(self._xyz[..., 1])

    def _exposed(self, luminance: Array) -> float:
        """Exposure value that suits luminances of this picture."""
        if self._is_space:
            return tones.space_ev100(luminance)
        ev100 = tones.auto_ev100(luminance)
        return tones.dusk_ev100(ev100) if self._is_sky else ev100

    @property
    def _is_space(self) -> bool:
        """Whether it is a picture of a nebula, around which space shall be dark."""
        scene = self._recipe.get("scene")
        return isinstance(scene, dict) and "view" in scene and "medium" in scene

    @property
    def _is_sky(self) -> bool:
        """Whether it is a picture of a planet's sky, in which night shall look dark."""
        scene = self._recipe.get("scene")
        return isinstance(scene, dict) and "sun" in scene and "ground" in scene

    def picture(
        self, space: str = "srgb", exposure: float | Literal["auto"] = "auto", tone: str = "photograph"
    ) -> Array:
        """Display-encoded picture in [0, 1], shape (y, x, 3); black outside the camera's field.

        Parameters
        ----------
        space : str
            The display's colour space: "srgb", "display-p3", "rec2020" or any that colour-science knows by this name,
            such as "adobe-rgb-1998", if all its primaries are colours.
        exposure : float or "auto"
            Exposure value at ISO 100: a luminance of ``2**exposure * 0.125`` cd m-2 becomes mid grey.  Take one from
            `auto_exposure` to give several images the same exposure.
        tone : {"photograph", "eye", "asinh", "filmic", "linear"}
            A film-like curve with colours made stronger as cameras do, with colours that fade in dim light as the eye
            sees them, or (``filmic``) as they are; the stretch of astronomers, which shows the faint and keeps the
            colours of the bright; or a straight line that stops at white.  See `skyscatter.image.tone`.

        Examples
        --------
        >>> import numpy as np
        >>> import skyscatter
        >>> image = skyscatter.SpectralImage(np.full((2, 3, 41), 0.01), np.arange(380, 781, 10))
        >>> bright, dark = (image.picture(exposure=ev).mean() for ev in (10, 14))
        >>> image.picture().shape, bool(bright > dark)
        ((2, 3, 3), True)
        """
        return self.developed(space, exposure, tone)[0]

    def developed(
        self, space: str, exposure: float | Literal["auto"], tone: str, lens: bool | None = None
    ) -> tuple[Array, float]:
        """`picture`, and the exposure value (EV at ISO 100) that it was made with; `lens` says whether it has glare."""
        colour.display_space(space)
        xyz = self._xyz
        ev100 = self._exposed(xyz[..., 1]) if exposure == "auto" else tones.exposure_value(exposure, xyz[..., 1])
        if tone == "eye":
            xyz = nightvision.as_the_eye(xyz, nightvision.scotopic_luminance(self._radiance, self._wavelengths))
        elif tone == "photograph" and self._is_sky:
            xyz = nightvision.balanced(xyz, ev100)
        return tones.develop(colour.xyz_to_rgb(xyz, space), space, ev100, tone, lens), ev100

    def save(self, path: str | os.PathLike[str], **options: Any) -> None:
        """Write the image; the extension says how.

        Parameters
        ----------
        path : path-like
            ``.exr`` (RGB and spectral layers; options ``spectral=False`` for RGB alone, ``scale``: RGB of a white of
            1 cd m-2, ``half=True``: RGB as half floats), ``.hdr`` (RGB for lighting; option ``scale``), ``.png``
            (options ``space``, ``exposure``, ``tone`` as in `picture`, ``bits`` 8 or 16), ``.fits`` (options
            ``filters``: a plane for each instead of the spectra, see `through`; ``dtype="float32"``;
            ``compress=True``: tiles without loss; ``unit``: brightness in a unit of photometry, see
            `skyscatter.image.photometry`), ``.nc`` (netCDF-4; options ``dtype``, ``unit``) or ``.zarr`` (a folder
            with the same labels, for xarray and dask; option ``dtype``).  A ``.png`` may also show three filters as
            red, green and blue: a ``palette`` or three ``filters``, ``tone`` "lupton" or "linear", ``stretch``,
            ``softening``, ``levels``, ``continuum`` "keep", "subtract" or "natural"; see `skyscatter.image.palettes`.
            ``glare`` is "lens", "none" or, for images with a place in the sky, diffraction by an aperture such as
            "hubble"; ``look`` is a name for several of these, see `skyscatter.image.looks`.  Of the sky of a place and
            a time it may have
            ``labels=True`` (names of the Moon, planets and bright stars) and ``lines=True`` (of the constellations).
            A ``.png`` of a polarised image may also show
            ``show="degree"`` (of linear polarisation, 0 to 1 on the colour map viridis) or ``show="angle"`` (0 to 180
            degrees on the cyclic map twilight), of all wavelengths weighted by luminous efficiency or of one
            ``wavelength`` [nm]; transparent where undefined.
        **options
            As listed above.

        Raises
        ------
        DomainError
            For another extension or another option.
        SkyscatterError
            If the file cannot be written; nothing is left behind then.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> import numpy as np
        >>> import skyscatter
        >>> image = skyscatter.SpectralImage(np.full((2, 3, 5), 0.01), [400, 475, 550, 625, 700])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     image.save(pathlib.Path(folder) / "sky.png", exposure=12, bits=16)
        ...     image.save(pathlib.Path(folder) / "sky.fits", dtype="float32")
        ...     skyscatter.SpectralImage.load(pathlib.Path(folder) / "sky.fits").shape  # y, x, wavelength
        (2, 3, 5)
        """
        extension = Path(path).suffix.lower()
        if extension not in _WRITERS:
            raise DomainError("output file", str(path), f"the extension must be one of {', '.join(_WRITERS)}")
        module, known = _WRITERS[extension]
        for option in options:
            if option not in known:
                raise DomainError("option", option, f"{extension} files take {', '.join(known) or 'no options'}")
        importlib.import_module(f"skyscatter.image.{module}").write(self, Path(path), **options)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> SpectralImage:
        """Read an image back from a spectral ``.exr``, a ``.fits`` or a ``.nc`` file, or from a ``.zarr`` folder.

        Raises
        ------
        MissingDataError
            If there is no such file.
        DomainError
            If it is not what its extension says, or holds no spectra.

        Examples
        --------
        The spectra, the errors, the layers and the recipe come back.

        >>> import pathlib, tempfile
        >>> import numpy as np
        >>> import skyscatter
        >>> image = skyscatter.SpectralImage(np.full((2, 3, 2), 0.01), [450, 650], recipe={"solver": "single"})
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     image.save(pathlib.Path(folder) / "sky.fits")
        ...     again = skyscatter.SpectralImage.load(pathlib.Path(folder) / "sky.fits")
        >>> bool((again.radiance == image.radiance).all()), again.recipe["solver"]
        (True, 'single')
        """
        file = Path(path)
        extension = file.suffix.lower()
        if extension not in _READERS:
            raise DomainError("image file", str(path), f"spectra are read from {', '.join(_READERS)} files")
        if not (file.is_dir() if extension == ".zarr" else file.is_file()):
            raise MissingDataError(path, "there is no such file; check the path")
        image: SpectralImage = importlib.import_module(f"skyscatter.image.{_WRITERS[extension][0]}").read(file)
        return image

    def plot_polarisation(
        self,
        show: str = "degree",
        wavelength: float | None = None,
        *,
        bars: int = 0,
        camera: Any = None,
        ax: Axes | None = None,
        path: str | os.PathLike[str] | None = None,
    ) -> Axes:
        """Draw degree or angle of linear polarisation.  See `skyscatter.image.plot.plot_polarisation`."""
        from skyscatter.image.plot import plot_polarisation

        return plot_polarisation(self, show, wavelength, bars=bars, camera=camera, ax=ax, path=path)

    def plot_spectrum(self, x: int, y: int, ax: Axes | None = None, path: str | os.PathLike[str] | None = None) -> Axes:
        """Draw the spectrum of pixel (x, y).  See `skyscatter.image.plot.plot_spectrum`."""
        from skyscatter.image.plot import plot_spectrum

        return plot_spectrum(self, x, y, ax=ax, path=path)


def _checked_wavelengths(wavelengths: ArrayLike) -> Array:
    try:
        values = np.array(wavelengths, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DomainError("wavelengths", type(wavelengths).__name__, "must be numbers [nm]") from error
    if values.ndim != 1 or values.size == 0:
        raise DomainError("wavelengths", f"shape {values.shape}", "must be a list of at least one wavelength [nm]")
    if not np.all(np.isfinite(values)) or values[0] <= 0.0 or np.any(np.diff(values) <= 0.0):
        raise DomainError("wavelengths", values.tolist()[:8], "must be positive and ascend [nm]")
    return values


def _checked_cube(
    name: str, values: ArrayLike, shape: tuple[int, ...] | None, bands: int | None = None
) -> NDArray[Any]:
    try:
        cube = np.asarray(values)
        cube = np.ascontiguousarray(cube, dtype=np.float32 if cube.dtype == np.float32 else np.float64)
    except (TypeError, ValueError) as error:
        raise DomainError(name, type(values).__name__, "must be an array of numbers") from error
    if shape is not None and cube.shape != shape:
        raise DomainError(name, f"shape {cube.shape}", f"must have the shape of the radiance, {shape}")
    if cube.ndim != 3 or cube.size == 0 or (bands is not None and cube.shape[2] != bands):
        raise DomainError(name, f"shape {cube.shape}", f"must be (y, x, wavelength) with {bands} wavelengths")
    if _has_infinite(cube):
        raise DomainError(name, "infinite", "must be finite, or NaN outside the camera's field")
    return cube


def _has_infinite(cube: NDArray[Any]) -> bool:
    """Whether a picture has an infinite value; sums are quick, and rows where they are finite need no other look."""
    found: list[bool] = []

    def look(rows: slice) -> None:
        with np.errstate(over="ignore", invalid="ignore"):
            found.extend(not np.isfinite(row.sum()) and np.isinf(row).any() for row in cube[rows])

    in_parts(look, len(cube), ROWS)
    return any(found)
