"""Responses out of a Sentinel-2 product's own metadata."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from skyscatter.dehaze.bands import load_sensor
from skyscatter.dehaze.msi import sensor_from_metadata
from skyscatter.errors import MissingDataError

PRODUCT = """<?xml version="1.0" encoding="UTF-8"?>
<n1:Level-1C_User_Product xmlns:n1="https://psd-14.sentinel2.eo.esa.int/PSD/User_Product_Level-1C.xsd">
  <n1:General_Info><Product_Info><Datatake><SPACECRAFT_NAME>{unit}</SPACECRAFT_NAME></Datatake></Product_Info>
    <Product_Image_Characteristics><Spectral_Information_List>{bands}</Spectral_Information_List>
    </Product_Image_Characteristics></n1:General_Info>
</n1:Level-1C_User_Product>
"""
BAND = """<Spectral_Information bandId="1" physicalBand="{name}"><RESOLUTION>10</RESOLUTION>
  <Wavelength><MIN unit="nm">{low}</MIN><MAX unit="nm">{high}</MAX><CENTRAL unit="nm">{centre}</CENTRAL></Wavelength>
  <Spectral_Response><STEP unit="nm">1</STEP><VALUES>{values}</VALUES></Spectral_Response></Spectral_Information>"""


def write(folder: Path, bands: str, unit: str = "Sentinel-2C") -> Path:
    path = folder / "MTD_MSIL1C.xml"
    path.write_text(PRODUCT.format(unit=unit, bands=bands))
    return path


def listed(name: str, own: str) -> str:
    """A band of our own as the metadata would list it."""
    band = load_sensor("sentinel-2b").band(own)
    wl = np.arange(np.floor(band.wavelengths[0]), np.ceil(band.wavelengths[-1]) + 1)
    values = " ".join(f"{v:.6f}" for v in np.interp(wl, band.wavelengths, band.response))
    return BAND.format(name=name, low=int(wl[0]), high=int(wl[-1]), centre=band.centre_nm, values=values)


def test_responses_are_read(tmp_path: Path) -> None:
    own = load_sensor("sentinel-2b")
    bands = [listed("B2", "B02"), listed("B8A", "B8A"), listed("B12", "B12")]
    sensor = sensor_from_metadata(write(tmp_path, "".join(bands)))
    assert sensor.name == "sentinel-2c"
    assert [band.name for band in sensor.bands] == ["B02", "B8A", "B12"]
    for band in sensor.bands:
        twin = own.band(band.name)
        assert band.role == twin.role
        assert not band.approximate
        # Sampled every nm, linear between: the corner of the shape moves by less than a nm, on both sides alike.
        assert band.effective_wavelength == pytest.approx(twin.effective_wavelength, abs=0.05)
        assert band.width_nm == pytest.approx(twin.width_nm, abs=0.5)


def test_a_product_that_names_no_spacecraft(tmp_path: Path) -> None:
    assert sensor_from_metadata(write(tmp_path, listed("B3", "B03"), unit="")).name == "sentinel-2"


@pytest.mark.parametrize(
    ("bands", "problem"),
    [
        ("", "lists no spectral responses"),
        ('<Spectral_Information bandId="0" physicalBand="B1"/>', "lists no spectral responses"),
        (BAND.format(name="B2", low="x", high=3, centre=2, values="0 1 0"), "band B02"),
        (BAND.format(name="B2", low=490, high=3, centre=2, values="0 one 0"), "band B02"),
        (BAND.format(name="B2", low=490, high=3, centre=2, values="0 0 0"), "band B02"),
    ],
)
def test_bad_metadata_is_named(tmp_path: Path, bands: str, problem: str) -> None:
    with pytest.raises(MissingDataError, match=problem) as caught:
        sensor_from_metadata(write(tmp_path, bands))
    assert "MTD_MSIL1C.xml" in str(caught.value)


def test_not_xml(tmp_path: Path) -> None:
    with pytest.raises(MissingDataError, match="check the path"):
        sensor_from_metadata(tmp_path / "none.xml")
    broken = tmp_path / "broken.xml"
    broken.write_text("<a><b></a>")
    with pytest.raises(MissingDataError, match="XML"):
        sensor_from_metadata(broken)
