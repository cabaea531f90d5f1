"""Options of ``skyscatter nebula`` into what the image code takes, and their checks before any time is spent."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from skyscatter.cli import common, parse
from skyscatter.errors import DomainError
from skyscatter.units import metres

SOLVERS = ("path", "single", "photons")
#: What a picture of unstated size gets: walks a pixel, and the seeing [pixel] without which stars would be squares.
FIRST_SAMPLES = "4"
SEEING = 2.0


@dataclass(frozen=True)
class Request(common.RunRequest):
    """What the command line asks for, checked as far as that goes without a model."""

    turned: dict[str, float]
    field: tuple[str, float] | None
    pixel_scale_deg: float | None
    orders: int | None
    stokes: bool
    filters: str | None
    png: dict[str, Any]
    observation: dict[str, Any]
    #: Full width at half maximum [pixel] of the blur of .png files, which those with data do not get; 0 for none.
    seeing: float
    #: Whether .png files are smoothed, as it was typed; where nothing was, first pictures are.
    smooth: bool | None
    first: bool

    @property
    def evened(self) -> bool:
        """Whether noise is taken off .png files alone."""
        if self.denoise or self.solver == "single" or not common.has_suffix(self.outputs, ".png"):
            return False
        return self._can_be_halved and self.first and not self.stokes if self.smooth is None else self.smooth

    @property
    def _can_be_halved(self) -> bool:
        return "sampling" not in self.given and self.given.get("samples", 0) % 2 == 0

    @property
    def halved(self) -> bool:
        """As `RunRequest.halved`; .png files that are smoothed need them, too."""
        return super().halved or self.evened


def of_planes(options: dict[str, Any]) -> bool:
    """Whether the picture of these options shows three filters."""
    return bool({"palette", "filters"} & set(options))


def png_options(given: dict[str, Any], space: str | None, look: str | None = None) -> dict[str, Any]:
    """Options of the PNG writer that were named, by themselves or by a look, as it takes them."""
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if look is not None:
        from skyscatter.image.looks import expanded

        options = {**expanded(look, options), "look": look}
    for name in ("stretch", "softening"):
        if name in options:
            options[name] = parse.parse_positive(options[name], name)
    if "exposure" in options:
        options["exposure"] = parse.parse_exposure(options["exposure"])
    if space is not None:
        options["space"] = space
    if "," in options.get("palette", ""):
        options["filters"] = options.pop("palette")
    return options


def observation(
    psf: str | None, aperture: str | None, exposure_time: str | None, throughput: str | None, seed: str | None
) -> dict[str, Any]:
    """Options of `skyscatter.image.instrument.observe`; empty if nothing is asked of it."""
    options: dict[str, Any] = {}
    if psf is not None:
        from skyscatter.image.psf import point_spread

        options["psf"] = point_spread(psf)
    if (aperture is None) != (exposure_time is None):
        given, missing = ("aperture", "exposure-time") if exposure_time is None else ("exposure_time", "aperture")
        raise DomainError(given, aperture or exposure_time, f"photon noise needs --{missing} as well")
    if aperture is None or exposure_time is None:
        if throughput is not None:
            raise DomainError("throughput", throughput, "is for photon noise; give --aperture and --exposure-time")
        return options
    diameter = metres(aperture, "aperture")
    if not 0.0 < diameter < math.inf:
        raise DomainError("aperture", aperture, "give the diameter of the mirror, such as 2.4m")
    share = parse.parse_positive(throughput, "throughput")
    if share is not None and share > 1.0:
        raise DomainError("throughput", throughput, "give a share above 0 and at most 100 %")
    return options | {
        "photon_noise": True,
        "collecting_area_m2": math.pi * diameter**2 / 4.0,
        "exposure_s": parse.parse_time(exposure_time, "exposure_time"),
        "throughput": 1.0 if share is None else share,
        "seed": parse.parse_integer(seed, "seed", 0, "give a whole number from 0 to 9223372036854775807") or 0,
    }


def observed(image: Any, observation: dict[str, Any]) -> Any:
    """The picture as the telescope takes it that was described, and as it is without one."""
    if not observation:
        return image
    from skyscatter.image.instrument import observe

    return observe(image, **observation)


def as_seen(image: Any, seeing: float) -> Any:
    """The picture as a camera takes it whose pixels are small enough for its seeing, and none of it for 0.

    Parameters
    ----------
    image : SpectralImage
    seeing : float
        Full width at half maximum of a Gaussian [pixel].  At the edges the last pixel goes on.
    """
    if not seeing:
        return image
    from scipy.ndimage import gaussian_filter

    from skyscatter.image.spectral import SpectralImage

    sigma = seeing / math.sqrt(8.0 * math.log(2.0))
    return SpectralImage(
        gaussian_filter(image.radiance, (sigma, sigma, 0.0), mode="nearest"),
        image.wavelengths,
        recipe={**image.recipe, "seeing_pixels": seeing},
        sky=image.sky,
    )


def brightness_unit(unit: str | None, observed: dict[str, Any]) -> Any:
    """The unit as the writers take it; counts are those of the telescope that was described."""
    if unit not in ("count", "counts"):
        return unit
    if "photon_noise" not in observed:
        raise DomainError("unit", unit, "is a telescope's; give --aperture and --exposure-time")
    from skyscatter.image.photometry import Counts

    return Counts(**{name: observed[name] for name in ("collecting_area_m2", "exposure_s", "throughput")})


def with_bands(request: Request) -> Request:
    """The request with wavelengths for the narrow bands that it names, so that lines are not mixed in one cell."""
    from skyscatter.image.filters import filter_curves, with_narrow_bands
    from skyscatter.image.palettes import three_filters

    words: list[Any] = []
    if request.filters is not None:
        words.extend(filter_curves(request.filters))
    palette, three = request.png.get("palette"), request.png.get("filters")
    if palette is not None or three is not None:
        words.extend(filter_curves(dict.fromkeys(three_filters(palette, three)[0])))
    return replace(request, wavelengths=with_narrow_bands(request.wavelengths, words)) if words else request


def check(request: Request) -> None:
    """Refuse, before any time is spent, what the files could not hold."""
    if request.field is not None and request.pixel_scale_deg is not None:
        raise DomainError("pixel_scale", request.pixel_scale_deg, "give --field-of-view or --pixel-scale, not both")
    if request.filters is not None:
        if not common.has_suffix(request.outputs, ".fits"):
            raise DomainError("filters", request.filters, "are for FITS files (PNG: --palette); name one with -o")
        from skyscatter.image.filters import filter_curves

        for curve in filter_curves(request.filters):
            curve.weights(request.wavelengths)
    of_fits = {} if request.filters is None else {"filters": request.filters}
    files = {suffix: taken | (of_fits if suffix == ".fits" else {}) for suffix, taken in request.file_options.items()}
    common.check_brightness(files, request.wavelengths)
    if not of_planes(request.png):
        png = request.png
        common.check_development(png.get("space", "srgb"), png.get("tone", common.DEFAULT_TONE), request.bits)
    if common.has_suffix(request.outputs, ".png"):
        _try_picture(request)


def _try_picture(request: Request) -> None:
    """Make the picture of one dark pixel with the options of the PNG file, which refuses what it would refuse later."""
    from skyscatter.image import SkyFrame, SpectralImage

    sky = SkyFrame(ra_deg=0.0, dec_deg=0.0, pixel_scale_deg=1.0)
    dark = SpectralImage(np.zeros((1, 1, request.wavelengths.size)), request.wavelengths, sky=sky)
    with TemporaryDirectory() as folder:
        dark.save(Path(folder) / "try.png", bits=request.bits, **request.png)
