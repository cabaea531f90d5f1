"""Short texts of the command line into values; each refusal names the option, the text and what would do."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skyscatter.atomic import explained
from skyscatter.errors import DomainError, MissingDataError, UnitsError
from skyscatter.units import ANGLE, LENGTH, TIME, WAVELENGTHS, Measure, degrees, nanometres

#: Formats by extension: picture, spectral layers, RGB for lighting, FITS cube, netCDF.
OUTPUT_SUFFIXES = (".png", ".exr", ".hdr", ".fits", ".nc", ".zarr")
#: Files that hold all frames of a sequence.
FILMS = (".mp4", ".webm", ".mkv", ".gif")
PLOT_SUFFIXES = (".png", ".svg", ".pdf")
MAX_WAVELENGTHS = 10_000

_DEFAULT_SIZE = {
    "landscape": (1280, 480),
    "panorama": (360, 180),
    "panorama-upper": (360, 90),
    "fisheye": (256, 256),
    "fisheye-equisolid": (256, 256),
    "perspective": (384, 256),
    "planet": (256, 256),
    "telescope": (512, 512),
}


def parse_size(text: str | None, view: str) -> tuple[int, int]:
    """``512x256`` as (width, height) [pixel]; without a text the size that suits the view."""
    if text is None:
        return _DEFAULT_SIZE.get(view.partition(":")[0], (360, 240))
    words = text.lower().replace("×", "x").split("x")
    if len(words) != 2 or not all(word.strip().isdecimal() for word in words):
        raise DomainError("size", text, "give WIDTHxHEIGHT in pixels, for instance 512x256")
    width, height = (int(word) for word in words)
    if not (1 <= width <= 65536 and 1 <= height <= 65536):
        raise DomainError("size", text, "width and height must lie between 1 and 65536 pixels")
    return width, height


def parse_wavelengths(text: str) -> NDArray[np.float64]:
    """``start:stop:step`` (both ends included) or a list with commas, as ascending vacuum wavelengths [nm]."""
    remedy = "give START:STOP:STEP or a list with commas in nm, for instance 380:780:5 or 450,550,650"
    try:
        numbers = [nanometres(word, "wavelengths") for word in text.split(":" if ":" in text else ",")]
    except UnitsError as error:
        raise DomainError("wavelengths", text, f"{remedy}; units may follow the numbers: 0.55um") from error
    if ":" in text:
        if len(numbers) != 3:
            raise DomainError("wavelengths", text, remedy)
        start, stop, step = numbers
        if not (WAVELENGTHS[0] <= start <= stop <= WAVELENGTHS[1] and 0 < step < math.inf):
            within = f"from {WAVELENGTHS[0]:g} to {WAVELENGTHS[1]:g} nm"
            rule = f"start and step must be positive and stop not below start, {within}"
            raise DomainError("wavelengths", text, rule)
        # The tolerance keeps the last node when the step, in binary, is a hair too long.
        count = math.floor((stop - start) / step + 1e-9) + 1
        _check_count(text, count)
        return np.asarray(start + step * np.arange(count), dtype=np.float64)
    values = np.array(numbers)
    _check_count(text, values.size)
    if not (WAVELENGTHS[0] <= values[0] and values[-1] <= WAVELENGTHS[1] and np.all(np.diff(values) > 0)):
        rule = f"wavelengths must be positive and increase, from {WAVELENGTHS[0]:g} to {WAVELENGTHS[1]:g} nm"
        raise DomainError("wavelengths", text, rule)
    return values


def parse_values(text: str, name: str, convert: Callable[[str], float], example: str) -> NDArray[np.float64]:
    """``start:stop:step`` (both ends included) or a list with commas; each word as `convert` takes it."""
    remedy = f"give START:STOP:STEP or a list with commas, such as {example}"
    try:
        numbers = [convert(word.strip()) for word in text.split(":" if ":" in text else ",")]
    except ValueError as error:
        raise DomainError(name, text, remedy) from error
    if ":" in text:
        if len(numbers) != 3 or not np.all(np.isfinite(numbers)) or not (numbers[1] - numbers[0]) * numbers[2] > 0:
            raise DomainError(name, text, remedy)
        start, stop, step = numbers
        count = math.floor((stop - start) / step + 1e-9) + 1
        numbers = (start + step * np.arange(min(count, MAX_WAVELENGTHS + 1))).tolist()
    if not np.all(np.isfinite(numbers)) or len(set(numbers)) != len(numbers):
        raise DomainError(name, text, f"give each value once; {remedy}")
    if len(numbers) > MAX_WAVELENGTHS:
        raise DomainError(name, text, f"at most {MAX_WAVELENGTHS} values are allowed")
    return np.array(numbers, dtype=np.float64)


def _check_count(text: str, count: int) -> None:
    if count > MAX_WAVELENGTHS:
        raise DomainError("wavelengths", text, f"these are {count} wavelengths; at most {MAX_WAVELENGTHS} are allowed")


def parse_integer(text: str | None, name: str, lowest: int, remedy: str) -> int | None:
    """A whole number not below `lowest`; None stays None."""
    if text is None:
        return None
    word = text.strip()
    # Python's integers have no end; 64 bits are what seeds and counters have.
    if not word.isascii() or not word.isdecimal() or not lowest <= int(word[:20]) < 2**63:
        raise DomainError(name, text, remedy)
    return int(word)


def parse_degrees(text: str | None, name: str, limit: float, default: float) -> float:
    """An angle [degree] between -limit and limit."""
    if text is None:
        return default
    try:
        value = degrees(text, name)
    except UnitsError:
        value = math.nan
    if not -limit <= value <= limit:
        raise DomainError(name, text, f"give an angle between {-limit:g} and {limit:g} degrees, such as 30 or 30deg")
    return value


def _with_unit(text: str, measure: Measure) -> float:
    """A number with a unit; not a number for anything else, a bare number included."""
    try:
        return math.nan if text.strip()[-1:].isdigit() else measure.read(text, measure.noun)
    except UnitsError:
        return math.nan


def parse_angle(text: str, name: str) -> float:
    """An angle above 0 [degree] from a number with its unit, such as ``0.5arcsec``."""
    value = _with_unit(text, ANGLE)
    if not 0.0 < value < math.inf:
        units = ", ".join(ANGLE.units)
        raise DomainError(name, text, f"give an angle above 0 with its unit ({units}), such as 0.5arcsec")
    return value


def parse_field(text: str) -> tuple[str, float]:
    """``("angle", degrees)`` from ``10arcmin``, ``("length", metres)`` from ``2pc``."""
    angle = _with_unit(text, ANGLE)
    if 0.0 < angle < math.inf:
        return "angle", angle
    remedy = "give the picture's width as an angle or a length with its unit, such as 10arcmin or 2pc"
    length = _with_unit(text, LENGTH)
    if not 0.0 < length < math.inf:
        raise DomainError("field_of_view", text, remedy)
    return "length", length


def parse_time(text: str, name: str) -> float:
    """A time above 0 [s] from a number with its unit, such as ``20min``."""
    value = _with_unit(text, TIME)
    if not 0.0 < value < math.inf:
        raise DomainError(name, text, f"give a time above 0 with its unit ({', '.join(TIME.units)}), such as 600s")
    return value


def parse_bytes(text: str, name: str) -> int:
    """Bytes above 0 from a number with its unit, such as ``500MB`` or ``1.5GiB``."""
    sizes = {"GIB": 2**30, "MIB": 2**20, "TB": 10**12, "GB": 10**9, "MB": 10**6}
    word = text.strip().upper()
    unit = next((unit for unit in sizes if word.endswith(unit)), None)
    try:
        value = math.nan if unit is None else float(word[: -len(unit)]) * sizes[unit]
    except ValueError:
        value = math.nan
    if not 1.0 <= value < 2**63:
        raise DomainError(name, text, f"give a number with its unit ({', '.join(sorted(sizes))}), such as 1GB")
    return int(value)


def parse_positive(text: str | None, name: str) -> float | None:
    """A number above 0; None stays None."""
    if text is None:
        return None
    value = share(text)
    if not 0.0 < value < math.inf:
        raise DomainError(name, text, "give a number above 0")
    return value


def parse_noise(text: str | None) -> float | None:
    """``1%`` or ``0.01`` as a relative standard error."""
    if text is None:
        return None
    value = share(text)
    if not 0 < value < 1:
        raise DomainError("noise", text, "give a relative standard error between 0 and 100 %, for instance 1% or 0.01")
    return value


def share(text: str) -> float:
    """A number, or one in per cent; not a number for anything else."""
    word = text.strip()
    try:
        return float(word[:-1]) / 100 if word.endswith("%") else float(word)
    except ValueError:
        return math.nan


def parse_place(text: str) -> tuple[float, float]:
    """``LAT,LON`` in degrees, north and east positive."""
    try:
        latitude, longitude = (degrees(word, "place") for word in text.split(","))
    except ValueError:
        raise DomainError(
            "place", text, "give LATITUDE,LONGITUDE in degrees, north and east positive, for instance 48.86,2.35"
        ) from None
    return latitude, longitude


def parse_exposure(text: str) -> float | str:
    """``auto`` or an exposure value (EV at ISO 100)."""
    if text == "auto":
        return text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not -100 <= value <= 100:
        raise DomainError("exposure", text, "give auto, or an exposure value (EV at ISO 100) between -100 and 100")
    return value


def parse_show(text: str | None) -> tuple[str, float | None, str | None]:
    """What a picture shows: ``colour``, ``degree`` or ``angle``, perhaps of a wavelength (nm), or ``magnitudes:B``.

    Returns
    -------
    what : str
    wavelength : float, optional
    filter : str, optional
    """
    if text is None:
        return "colour", None, None
    what, colon, wavelength = text.partition(":")
    if what == "magnitudes":
        if wavelength not in ("", "U", "B", "V", "R", "I"):
            raise DomainError("show", text, "magnitudes are those of one of U, B, V, R, I: magnitudes:B")
        return what, None, wavelength or "V"
    remedy = "choose colour, magnitudes, degree or angle, the latter two also of one wavelength in nm: degree:550"
    if what not in ("colour", "degree", "angle") or (colon and what == "colour"):
        raise DomainError("show", text, remedy)
    try:
        return what, nanometres(wavelength, "show") if colon else None, None
    except UnitsError as error:
        raise DomainError("show", text, remedy) from error


def check_output(path: Path, suffixes: tuple[str, ...] = OUTPUT_SUFFIXES) -> Path:
    """The path, if a file of a known kind can be written there; nothing is left behind."""
    if path.suffix.lower() not in suffixes:
        raise DomainError("output", str(path), f"the extension must be one of {', '.join(suffixes)}")
    if path.suffix.lower() == ".nc":
        from skyscatter.netcdf import check_writable

        check_writable()
    try:
        path.lstat()
    except FileNotFoundError:
        pass
    except OSError as error:
        raise DomainError("output", str(path), explained(error)) from error
    if path.is_dir() and not (path.suffix.lower() == ".zarr" and _is_picture(path)):
        raise DomainError("output", str(path), "this is a folder; add a file name")
    if not path.parent.is_dir():
        raise DomainError("output", str(path), f"there is no folder {path.parent}; make it first")
    if not os.access(path.parent, os.W_OK):
        raise DomainError("output", str(path), f"the folder {path.parent} may not be written to; choose another")
    try:
        # Some folders, such as those of /proc, refuse new files in spite of their permissions.
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        remedy = f"the folder {path.parent} takes no new files ({error.strerror or error}); choose another"
        raise DomainError("output", str(path), remedy) from error
    return path


def check_new(paths: Iterable[Path | None]) -> None:
    """Refuse to replace a file (--no-clobber)."""
    for path in paths:
        if path is not None and os.path.exists(path):
            raise DomainError("output", str(path), "exists; choose another name, or leave out --no-clobber")


def check_outputs(paths: list[Path], no_clobber: bool = False, more: tuple[str, ...] = ()) -> list[Path]:
    """All paths, each writable and each only once; with `no_clobber` none of them there; `more` extensions may be."""
    seen: set[Path] = set()
    check_new(paths if no_clobber else ())
    for path in paths:
        check_output(path, (*OUTPUT_SUFFIXES, *more))
        if path.resolve() in seen:
            raise DomainError("output", str(path), "is named twice; give each file once")
        seen.add(path.resolve())
    return paths


def _is_picture(path: Path) -> bool:
    from skyscatter.image.arraystrips import is_picture

    return is_picture(path)


def check_checkpoint(path: Path) -> Path:
    """The path, if an interrupted run is kept there."""
    if not os.path.isdir(path):
        raise MissingDataError(path, "there is no such checkpoint, which is a folder; check the path")
    return path


def check_input(path: Path, what: str) -> Path:
    """The path, if a file is there."""
    if not os.path.isfile(path):  # unlike Path.is_file, also of names that no file can have
        raise MissingDataError(path, f"there is no such {what}; check the path")
    return path
