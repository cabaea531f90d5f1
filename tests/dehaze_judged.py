"""Blind scenes put to the test: dehazed without their truth, then compared with it.

A scene's bands are single wavelengths and no gas absorbs in it.  The source says so: responses 2 nm wide, no ozone and
no water vapour; what the model's mixed gases would take in such a band is taken from the scene, so that the correction
gives it back.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skyscatter.dehaze
from skyscatter.dehaze.adjacency import environment, spread_function
from skyscatter.dehaze.bands import Sensor
from skyscatter.dehaze.flags import Flag
from skyscatter.dehaze.forward import STANDARD_PRESSURE, Atmosphere, surface_reflectance
from skyscatter.dehaze.options import SourceOptions
from skyscatter.dehaze.rasters.arrays import ArraySource
from skyscatter.dehaze.rasters.base import RasterBand
from skyscatter.dehaze.sensing import gases
from skyscatter.dehaze.table import Angles, build_table

Array = NDArray[np.float64]

WIDTH = 2.0  #: of the bands that stand for single wavelengths [nm]; Rayleigh's depth is then its own within 1e-5
#: What is asked of a retrieval: an error of at most these, and this part of the reflectance more.
WANTED, WANTED_PART = 0.005, 0.05
NO_GASES: dict[str, Any] = {"ozone_du": 0.0, "water_vapour_g_cm2": 0.0}


class BlindSource(ArraySource):
    """The image of a scene, as a satellite's product would give it: reflectance, angles and responses.

    Parameters
    ----------
    content : mapping
        Of `dehaze_scenes.render`; the truth in it is not looked at.
    """

    def __init__(self, content: Mapping[str, Any]) -> None:
        names = [f"{wl:g} nm" for wl in content["bands"]]
        self.responses = Sensor.from_shapes(
            "blind", {name: (float(wl), WIDTH) for name, wl in zip(names, content["bands"], strict=True)}
        )
        options = SourceOptions(quantity="reflectance", **{name: float(content[name]) for name in ANGLES})
        told = [RasterBand(name, wavelength_nm=float(wl)) for name, wl in zip(names, content["bands"], strict=True)]
        sun, view = (np.array([float(content[name])]) for name in ANGLES[:2])
        gas = gases(self.responses.bands, sun, view, STANDARD_PRESSURE, 0.0, 0.0)
        taken = (gas.above * gas.water)[0][:, None, None]
        super().__init__((content["reflectance"] * taken).astype(np.float32), options, bands=told, name="blind scene")
        self.sensor = self.responses.name


ANGLES = ("sun_zenith_deg", "view_zenith_deg", "relative_azimuth_deg")


@dataclass(frozen=True)
class Judged:
    """A result beside the truth.

    Attributes
    ----------
    error, sigma, truth : ndarray, shape (band, y, x)
        Estimate - truth, the standard deviation that was said, surface reflectance.
    cloud : ndarray of bool, shape (y, x)
        Pixels that were taken for cloud; there is none in the scenes.
    mask : ndarray of uint8, shape (y, x)
    aod, aod_sigma, true_aod : float
    aerosol : str
        The model that was chosen or given.
    probabilities : dict of str to float
    haze_map : ndarray, shape (y, x)
    """

    error: Array
    sigma: Array
    truth: Array
    cloud: NDArray[np.bool_]
    mask: NDArray[np.uint8]
    aod: float
    aod_sigma: float
    true_aod: float
    aerosol: str
    probabilities: dict[str, float]
    haze_map: Array

    @property
    def good(self) -> NDArray[np.bool_]:
        """Where the error is as small as is asked for, (band, y, x)."""
        return np.abs(self.error) <= WANTED + WANTED_PART * self.truth

    def within(self, limit: float) -> float:
        """Share of pixels and bands whose error is at most that."""
        return float((np.abs(self.error) <= limit).mean())

    def covered(self, probability: float) -> float:
        """Share of pixels and bands inside of the interval of that probability of a normal law."""
        return float((np.abs(self.error) <= quantile(probability) * self.sigma).mean())


def quantile(probability: float) -> float:
    """Half of the interval of a normal law that holds this probability, in standard deviations."""
    from scipy.special import erfinv

    return float(np.sqrt(2) * erfinv(probability))


def judge(content: Mapping[str, Any], **options: Any) -> Judged:
    """Dehaze a scene with the options of `skyscatter.dehaze` and compare."""
    result = skyscatter.dehaze.dehaze(
        BlindSource(content), pixel_size_m=float(content["cell_size_m"]), **NO_GASES, **options
    )
    found, truth = result.diagnostics, np.asarray(content["surface"], float)
    return Judged(
        np.asarray(result.reflectance, float) - truth, np.asarray(result.sigma, float), truth,
        (result.mask[0] & Flag.CLOUD) != 0, result.mask[0], found["aod"]["mean"], found["aod"]["sigma"],
        float(content["aod"]), found["aerosol"]["model"], found["aerosol"]["probabilities"],
        np.asarray(result.haze_map[0], float),
    )  # fmt: skip


def given(content: Mapping[str, Any]) -> dict[str, Any]:
    """Options that tell amount and kind of the haze."""
    return {"aod": float(content["aod"]), "aerosol": str(content["aerosol"])}


def with_true_surroundings(content: Mapping[str, Any], walks: int = 40000) -> Array:
    """Error (band, y, x) of the model of a pixel where haze and surroundings are the true ones: what a retrieval that
    knew what lies beyond its image would be left with."""
    wl, image = np.asarray(content["bands"], float), np.asarray(content["reflectance"], float)
    angles = [float(content[name]) for name in ANGLES]
    bands = BlindSource(content).responses.bands
    aod, atmosphere = float(content["aod"]), Atmosphere(aerosol=str(content["aerosol"]))
    table = build_table(atmosphere, bands, Angles.spanned(*(np.array([a]) for a in angles)), aod=aod)
    terms, _ = table.at(aod, *angles)
    spread = spread_function(atmosphere.medium(aod), wl, angles[1], walks=walks)
    # The map is twice as wide as the picture, and beyond it lies its mean: as `environment` has it.
    around = environment(content["surroundings"], float(content["cell_size_m"]), spread)
    y, x = ((n - m) // 2 for n, m in zip(around.shape[1:], image.shape[1:], strict=True))
    around = around[:, y : y + image.shape[1], x : x + image.shape[2]]
    found = surface_reflectance(terms[:, None, None, :], image, around)
    return np.asarray(found - content["surface"], float)


def pooled(parts: Iterable[Array]) -> Array:
    """Pixels of many scenes side by side, (band, pixel)."""
    return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)


def apu(error: Array) -> tuple[Array, Array, Array]:
    """Accuracy, precision and uncertainty of every band, from errors (band, ...).

    Mean, standard deviation and root mean square of the errors: Vermote & Kotchenova 2008 (J. Geophys. Res. 113,
    D23S90, eqs. 8 to 10), as the intercomparisons have them (Doxani et al. 2018, Remote Sens. 10, 352).
    """
    flat = error.reshape(len(error), -1)
    return flat.mean(axis=1), flat.std(axis=1), np.sqrt((flat**2).mean(axis=1))
