"""An image with a sensor and a geometry: from reflectance above the atmosphere to that of the surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.dehaze import masks
from skyscatter.dehaze.coefficients import Coefficients, Corrector
from skyscatter.dehaze.estimate import HazeEstimate, as_given, estimate
from skyscatter.dehaze.flagcount import FlagCount
from skyscatter.dehaze.flags import MEANINGS, Flag, mark
from skyscatter.dehaze.forward import PATH, STANDARD_PRESSURE, Atmosphere, pressure_at
from skyscatter.dehaze.gather import Gathered, at_dark_pixels, look
from skyscatter.dehaze.lattice import Lattice
from skyscatter.dehaze.options import DehazeOptions
from skyscatter.dehaze.ownaerosol import is_table
from skyscatter.dehaze.pixelsize import pixel_size
from skyscatter.dehaze.rasters.base import RasterSource
from skyscatter.dehaze.rasters.windows import for_each_window, map_windows
from skyscatter.dehaze.sensing import OZONE_DU, Gases, Sensing, gases, sense, usual_water
from skyscatter.dehaze.table import GREATEST_AOD, Angles, TermsTable, build_table
from skyscatter.dehaze.unsolved import imitations, shaped

Array = NDArray[np.float64]
Values = NDArray[np.float32]
Given = tuple[Array, Array, NDArray[np.bool_]]

#: Aerosol models that are tried where none is named: each answers for a colour and a darkness of haze of its own.
TRIED = ("continental", "maritime", "urban")
#: The cirrus band holds this part of what thin cirrus adds at other wavelengths (vapour above it takes the rest), and
#: how surely: Gao et al. 1998 (J. Geophys. Res. 103, 32169) find 0.7 to 1 over scenes.
CIRRUS_SEEN = 0.85
#: Reflectance in the cirrus band that is no cloud, and that above which the ground is lost.
CIRRUS_NONE, CIRRUS_THICK = 0.002, 0.04
#: Optical depth for which the spread of light is computed before the haze is known; its shape hardly depends on it.
FIRST_GUESS = 0.2
#: Shares of the work, for the progress shown: tables, first look, estimate.
AFTER_TABLES, AFTER_LOOK, AFTER_ESTIMATE = 0.45, 0.65, 0.7
#: Walks of the spread function: its shares are then known to a percent.
WALKS = 20000

Progress = Callable[[float], object]


@dataclass(frozen=True)
class Correction:
    """All that a window needs to be corrected; the same for every window.

    Attributes
    ----------
    sensing : Sensing
    lattice : Lattice
    coefficients : Coefficients
    roles : BandRoles
        Among the corrected bands.
    air : ndarray of float32, shape (band,)
        Path reflectance without haze.
    secant : callable
        1 / cos(Sun's zenith angle) for rows and columns of pixels; used where the image holds radiance.
    haze : HazeEstimate
    """

    sensing: Sensing
    lattice: Lattice
    coefficients: Coefficients
    roles: masks.BandRoles
    air: NDArray[np.float32]
    secant: Callable[[Array, Array], Array]
    haze: HazeEstimate

    def toa(self, row0: int, col0: int, values: Values, flags: NDArray[np.uint8]) -> Values:
        """Reflectance above the atmosphere (band, y, x) without cirrus; clouds and cirrus are flagged."""
        return above_atmosphere(self.sensing, self.secant, self.roles, self.air, row0, col0, values, flags)

    def __call__(
        self, row0: int, col0: int, values: Values, flags: NDArray[np.uint8], wanted: frozenset[str]
    ) -> dict[str, NDArray[Any]]:
        """Arrays (layer, y, x) of a window: result and mask, and sigma and haze_map where wanted.

        The mask costs a few operations per pixel, against some hundred for its bands: it is always there to be counted.
        """
        from skyscatter.kernels.raster.correct import correct, spread

        c, size = self.coefficients, self.lattice.small
        flags = flags.copy()
        toa = self.toa(row0, col0, values, flags)
        surface, clipped = np.empty_like(toa), np.zeros(flags.shape, bool)
        correct(toa, row0, col0, size, c.gain, c.offset, c.bend, surface, clipped)
        result = values.copy()
        places = list(self.sensing.places)
        result[places] = surface
        out: dict[str, NDArray[Any]] = {"result": result}
        if "sigma" in wanted:
            sigma = np.full_like(values, np.nan)
            part = np.empty_like(toa)
            spread(
                toa, row0, col0, size, c.gain, c.offset, c.bend, c.haze, c.model, c.floor, c.relative, part
            )  # fmt: skip
            sigma[places] = part
            out["sigma"] = sigma
        if "haze_map" in wanted:
            out["haze_map"] = self.lattice.at_pixels(c.aod, row0, col0, flags.shape)[None]
        self.flag(flags, surface, clipped, row0, col0)
        out["mask"] = flags[None]
        return out

    def flag(self, flags: NDArray[np.uint8], surface: Values, clipped: NDArray[np.bool_], row0: int, col0: int) -> None:
        """Enter what is known of pixels after the correction."""
        free = (flags & np.uint8(Flag.CLOUD | Flag.NODATA)) == 0
        with np.errstate(invalid="ignore"):
            wet = masks.water(surface, self.roles) & free
            mark(flags, wet, Flag.WATER)
            mark(flags, masks.shadow(surface, self.roles, wet) & free, Flag.SHADOW)
        mark(flags, clipped & free, Flag.CLIPPED)
        rows, cols = (
            (start + np.arange(n)) // self.lattice.large for start, n in zip((row0, col0), flags.shape, strict=True)
        )
        mark(flags, self.haze.uncertain[rows[:, None], cols] & free, Flag.UNCERTAIN)


def above_atmosphere(
    sensing: Sensing, secant: Callable[[Array, Array], Array], roles: masks.BandRoles, air: NDArray[np.float32],
    row0: int, col0: int, values: Values, flags: NDArray[np.uint8],
) -> Values:  # fmt: skip
    """Reflectance of the bands that see the ground, less cirrus; flags of clouds are entered."""
    toa = values[list(sensing.places)]
    if sensing.factors is not None:
        rows, cols = (start + 0.5 + np.arange(n) for start, n in zip((row0, col0), flags.shape, strict=True))
        sun = secant(rows, cols).astype(np.float32)
        toa *= sensing.factors[list(sensing.places), None, None].astype(np.float32)
        toa *= sun
    with np.errstate(invalid="ignore"):
        mark(flags, masks.clouds(toa, air, roles), Flag.CLOUD)
        if sensing.cirrus is not None:
            high = values[sensing.cirrus]
            if sensing.factors is not None:
                high = high * np.float32(sensing.factors[sensing.cirrus]) * sun
            thin = np.nan_to_num(np.maximum(high - np.float32(CIRRUS_NONE), np.float32(0)), nan=0.0)
            mark(flags, thin > 0, Flag.CIRRUS)
            mark(flags, thin > CIRRUS_THICK, Flag.CLOUD)
            toa -= thin / np.float32(CIRRUS_SEEN)
    return toa


def prepare(
    source: RasterSource, options: DehazeOptions, progress: Progress, executor: Any = None
) -> tuple[Correction, dict[str, Any]]:
    """Look at the whole image once, estimate its haze, and make what corrects it; also a summary for reports."""
    sensing = sense(source)
    pixel = options.pixel_size_m or pixel_size(source)
    lattice = Lattice.of(source.height, source.width, pixel)
    assert source.geometry is not None
    known = given_haze(source, options, lattice)  # a map that cannot be used is refused before any work
    places = source.geometry.at(*lattice.large_centres())
    angles = np.stack([np.asarray(a, float) for a in places])
    tables = make_tables(sensing, angles, options, lambda share: progress(AFTER_TABLES * share), executor)
    pressure = tables[0].atmosphere.pressure_hpa
    flat = angles.reshape(3, -1)
    gas = gases(
        sensing.bands, flat[0], flat[1], pressure,
        options.ozone_du, options.water_vapour_g_cm2,
    )  # fmt: skip
    roles = masks.BandRoles(sensing.bands)
    air = clear_air(tables[0], angles)
    secant = source.geometry.secant_of_sun
    seen = gather(
        source, sensing, lattice, partial(above_atmosphere, sensing, secant, roles, air), roles, options,
        lambda share: progress(AFTER_TABLES + (AFTER_LOOK - AFTER_TABLES) * share), executor,
    )  # fmt: skip
    more = other_aerosols(tables, options)
    haze = find_haze(tables, more, seen, sensing, gas, angles, pixel, options, known)
    best = next(t for t in tables if t.atmosphere.aerosol == haze.aerosol)
    others = [(t, haze.probabilities[t.atmosphere.aerosol]) for t in (*tables, *more) if t is not best]
    around, note = neighbourhood(sensing, lattice, best, haze, angles, pixel, options)
    corrector = Corrector(lattice, angles, gas, seen.mean, around)
    correction = Correction(
        sensing, lattice, corrector.coefficients(best, others, haze), roles, air, secant, haze
    )  # fmt: skip
    progress(AFTER_ESTIMATE)
    notes = [*sensing.notes, *haze.notes, *note]
    if is_table(options.aerosol):
        notes.append("of the aerosol only the asymmetry is known: what phase functions differ by then is in sigma")
    if options.pressure_hpa is None and options.ground_height_m is None:
        notes.append("the ground is taken to lie at sea level (1013 hPa): give its pressure or height if it does not")
    return correction, summary(haze, best, sensing, options, pressure, notes)


def other_aerosols(tables: list[TermsTable], options: DehazeOptions) -> list[TermsTable]:
    """Tables of what the haze may be besides: of a kind that is named, and known in full, nothing."""
    if options.aerosol == "auto":
        return imitations(tables)
    return shaped(tables[0]) if is_table(options.aerosol) and tables[0].aod[-1] > 0 else []


def make_tables(
    sensing: Sensing, angles: Array, options: DehazeOptions, progress: Progress, executor: Any = None
) -> list[TermsTable]:
    """The table of each aerosol model that is to be tried."""
    spanned = Angles.spanned(*angles)
    if options.ground_height_m is not None:
        pressure = pressure_at(options.ground_height_m)
    else:
        pressure = STANDARD_PRESSURE if options.pressure_hpa is None else options.pressure_hpa
    known = given_depth(options)
    if known == 0.0 and options.aod_sigma:
        known = None  # what a little haze would change is in no table of none
    if options.aerosol != "auto":
        names: tuple[str, ...] = (options.aerosol,)
    else:
        names = TRIED
    tables = []
    for k, name in enumerate(names):
        atmosphere = Atmosphere(aerosol=name, pressure_hpa=pressure)

        def share(done: float, k: int = k) -> None:
            progress((k + done) / len(names))

        table = build_table(
            atmosphere, sensing.bands, spanned, aod=known, threads=options.threads, executor=executor, progress=share
        )
        tables.append(table)
    return tables


def given_depth(options: DehazeOptions) -> float | None:
    """The one optical depth that the user knows: that of no aerosol is 0; None if it is to be found, or a map's."""
    if options.aerosol == "none":
        return 0.0
    return None if options.aod == "auto" else float(options.aod)


def given_haze(source: RasterSource, options: DehazeOptions, lattice: Lattice) -> Given | None:
    """The optical depth of large cells that the user knows, its deviation, and where it is unknown; None if it is."""
    if options.aod_map is not None:
        from skyscatter.dehaze.depthmap import read_depths

        aod, sigma, missing = read_depths(options.aod_map, source, lattice)
        return aod, np.hypot(sigma, options.aod_sigma or 0.0), missing
    depth, shape = given_depth(options), lattice.large_shape
    if depth is None:
        return None
    return np.full(shape, depth), np.full(shape, options.aod_sigma or 0.0), np.zeros(shape, bool)


def clear_air(table: TermsTable, angles: Array) -> NDArray[np.float32]:
    """Path reflectance in the middle of the image under the least haze of the table, shape (band,)."""
    middle = [float(np.median(a)) for a in angles]
    terms, _ = table.at(table.aod[0], *middle)
    return np.asarray(terms[..., PATH], np.float32)


def gather(
    source: RasterSource,
    sensing: Sensing,
    lattice: Lattice,
    toa_of: Callable[..., Values],
    roles: masks.BandRoles,
    options: DehazeOptions,
    progress: Progress,
    executor: Any = None,
) -> Gathered:
    """What the cells of the whole image hold.

    Raises
    ------
    DomainError
        If no pixel is clear.
    """
    seen = Gathered.empty(lattice, len(sensing.bands))
    visible = roles.visible or list(range(len(sensing.bands)))

    def first_look(row0: int, col0: int, values: Values, flags: NDArray[np.uint8]) -> Any:
        toa = toa_of(row0, col0, values, flags)
        # A shadow that the product knows of is dark, and tells nothing of haze.
        clear = (flags & np.uint8(Flag.CLOUD | Flag.NODATA | Flag.SATURATED | Flag.SHADOW)) == 0
        clear &= np.isfinite(toa).all(axis=0)
        return look(toa, clear, visible, lattice), bool(clear.any())

    found = map_windows(
        source, first_look, size=options.window, multiple=lattice.large, flags=True, threads=options.threads,
        executor=executor, progress=progress,
    )  # fmt: skip
    clear_somewhere = False
    for window, (cells, clear) in found:
        seen.put(window.row0, window.col0, cells)
        clear_somewhere |= clear
    if not clear_somewhere:
        nothing_clear(source)
    return seen


def nothing_clear(source: RasterSource) -> None:
    """Say that there is nothing to correct."""
    from skyscatter.errors import DomainError

    raise DomainError("image", source.name, "has no clear pixel: all is cloud, saturated or without data")


def find_haze(
    tables: list[TermsTable],
    more: list[TermsTable],
    seen: Gathered,
    sensing: Sensing,
    gas: Gases,
    angles: Array,
    pixel: float | None,
    options: DehazeOptions,
    known: Given | None,
) -> HazeEstimate:
    """The haze as given, or as the dark pixels have it."""
    shape = seen.lattice.large_shape
    if known is not None:
        return as_given(
            [t.atmosphere.aerosol for t in tables], *known, others=[t.atmosphere.aerosol for t in more]
        )  # fmt: skip
    use = sensing.for_haze
    above = gas.above.reshape(*shape, -1)[..., use]
    above = np.moveaxis(above, -1, 0)
    lit = seen.mean.astype(float)
    around = []
    for table in tables:
        # Blurred before it is corrected: the air adds to all alike, and takes from all alike.
        blurred = lit
        if pixel is not None and options.adjacency:
            blurred = spread_by(table, sensing, FIRST_GUESS, angles, pixel * seen.lattice.small)(lit)
        around.append(at_dark_pixels(seen, blurred)[use] / above)
    return estimate(
        [only(t, use) for t in tables], seen.dark[use] / above, around, angles, gas_of(gas, use),
        others=[only(t, use) for t in more],
    )  # fmt: skip


def only(table: TermsTable, bands: list[int]) -> TermsTable:
    """A table of some of its bands."""
    from dataclasses import replace

    return replace(table, bands=tuple(table.bands[k] for k in bands), values=table.values[..., bands, :])


def gas_of(gas: Gases, bands: list[int]) -> Gases:
    """Gases of some bands."""
    return Gases(gas.above[:, bands], gas.water[:, bands], gas.half[:, bands], gas.relative[bands])


def neighbourhood(
    sensing: Sensing,
    lattice: Lattice,
    table: TermsTable,
    haze: HazeEstimate,
    angles: Array,
    pixel: float | None,
    options: DehazeOptions,
) -> tuple[Callable[[Array], Array] | None, list[str]]:
    """How light from around a pixel is gathered; None, and why, where it cannot be known."""
    if not options.adjacency:
        return None, []
    if pixel is None:
        return None, ["the size of a pixel is unknown: light from the surroundings of a pixel is left in it"]
    return spread_by(table, sensing, float(np.clip(haze.mean, 0.0, GREATEST_AOD)), angles, pixel * lattice.small), []


def spread_by(
    table: TermsTable, sensing: Sensing, aod: float, angles: Array, cell_size_m: float
) -> Callable[[Array], Array]:
    """Means of cells (band, row, column) as light that the air scatters into lines of sight has them."""
    from skyscatter.dehaze.adjacency import environment, spread_function

    wavelengths = np.array([band.effective_wavelength for band in sensing.bands])
    order = np.argsort(wavelengths)
    back = np.argsort(order)
    spread = spread_function(
        table.atmosphere.medium(aod), wavelengths[order], float(np.median(angles[1])), walks=WALKS
    )  # fmt: skip

    def around(cells: Array) -> Array:
        return environment(cells[order], cell_size_m, spread)[back]

    return around


def summary(
    haze: HazeEstimate, table: TermsTable, sensing: Sensing, options: DehazeOptions, pressure: float, notes: list[str]
) -> dict[str, Any]:
    """What a report says."""
    source = "estimated" if given_depth(options) is None else "given"
    return {
        "kind": "surface reflectance",
        "aod": {
            "source": "map" if options.aod_map is not None else source,
            "mean": round(haze.mean, 4),
            "sigma": round(haze.mean_sigma, 4),
            "least": round(float(haze.aod.min()), 4),
            "greatest": round(float(haze.aod.max()), 4),
        },
        "aerosol": {"model": haze.aerosol, "probabilities": told_probabilities(haze)},
        "pressure_hpa": round(pressure, 2),
        "ozone_du": OZONE_DU if options.ozone_du is None else options.ozone_du,
        "water_vapour_g_cm2": round(
            usual_water(pressure) if options.water_vapour_g_cm2 is None else options.water_vapour_g_cm2, 3
        ),
        "interpolation_error": round(table.error, 6),
        "cells_without_dark_ground": round(float(haze.uncertain.mean()), 4),
        "corrected_bands": [band.name for band in sensing.bands],
        "mask_bits": {str(int(flag)): words for flag, words in MEANINGS.items()},
        "remarks": notes,
    }


def told_probabilities(haze: HazeEstimate) -> dict[str, float]:
    """Of the models that were solved for, and of all others together."""
    solved = {name: share for name, share in haze.probabilities.items() if name in haze.solved}
    told = {name: round(share, 4) for name, share in solved.items()}
    return told if len(told) == len(haze.probabilities) else {**told, "others": round(1 - sum(solved.values()), 4)}


def dehaze_physical(
    source: RasterSource, sinks: Mapping[str, Any], options: DehazeOptions, progress: Progress, executor: Any = None
) -> dict[str, Any]:
    """Correct an image into sinks (result, sigma, haze_map, mask: those there are); returns the summary."""
    correction, report = prepare(source, options, progress, executor)
    wanted, count = frozenset(sinks), FlagCount()

    def work(row0: int, col0: int, values: Values, flags: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
        return dict(correction(row0, col0, values, flags, wanted))

    for_each_window(
        source, sinks, work, lambda found: count.add(found["mask"]), size=options.window, flags=True,
        threads=options.threads, executor=executor,
        progress=lambda share: progress(AFTER_ESTIMATE + (1 - AFTER_ESTIMATE) * share),
    )  # fmt: skip
    return {**report, "flags": count.shares()}
