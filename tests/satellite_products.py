"""Small Sentinel-2 and Landsat products with the structure of real ones, made up number by number."""

from __future__ import annotations

import numpy as np

S2_BANDS = ("B01", "B02", "B03", "B04", "B05", "B06", "B07", "B08", "B8A", "B09", "B10", "B11", "B12")
S2_RESOLUTIONS = dict(zip(S2_BANDS, (60, 10, 10, 10, 20, 20, 20, 10, 20, 60, 60, 20, 20), strict=True))
#: Pixels of the made-up granule at 10 m.
S2_SIZE = 240
S2_NODES = 23
TILE = "T32TQM_20220601T101031"
GRANULE = "L1C_T32TQM_A036262_20220601T101031"

S2_NUMBERS = {
    name: np.random.default_rng(number).integers(
        1001, 9000, (S2_SIZE * 10 // S2_RESOLUTIONS[name],) * 2, dtype=np.uint16
    )
    for number, name in enumerate(S2_BANDS)
}
for _name, _numbers in S2_NUMBERS.items():
    _n = 60 // S2_RESOLUTIONS[_name]
    _numbers[: 5 * _n, : 3 * _n] = 0  # outside of the swath
S2_NUMBERS["B04"][200, 100] = 65535
S2_NUMBERS["B01"][30, 35] = 65535


def s2_product_xml(baseline="04.00", offset=-1000, level="Level-1C"):
    offsets = "".join(f'<RADIO_ADD_OFFSET band_id="{i}">{offset}</RADIO_ADD_OFFSET>' for i in range(13))
    sun = "".join(
        f'<SOLAR_IRRADIANCE bandId="{i}" unit="W/m²/µm">{1900 - 100 * i}</SOLAR_IRRADIANCE>' for i in range(13)
    )
    spectral = "".join(
        f'<Spectral_Information bandId="{i}" physicalBand="{name.replace("B0", "B")}">'
        f"<RESOLUTION>{S2_RESOLUTIONS[name]}</RESOLUTION><Wavelength>"
        f'<MIN unit="nm">{400 + 50 * i}</MIN><MAX unit="nm">{440 + 50 * i}</MAX>'
        f'<CENTRAL unit="nm">{420 + 50 * i}</CENTRAL></Wavelength></Spectral_Information>'
        for i, name in enumerate(S2_BANDS)
    )
    files = "".join(f"<IMAGE_FILE>GRANULE/{GRANULE}/IMG_DATA/{TILE}_{name}</IMAGE_FILE>" for name in S2_BANDS)
    offset_list = f"<Radiometric_Offset_List>{offsets}</Radiometric_Offset_List>" if offset is not None else ""
    return f"""<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<n1:Level-1C_User_Product xmlns:n1="https://psd-14.sentinel2.eo.esa.int/PSD/User_Product_Level-1C.xsd">
<n1:General_Info><Product_Info>
<PRODUCT_START_TIME>2022-06-01T10:10:31.024Z</PRODUCT_START_TIME>
<PRODUCT_URI>S2A_MSIL1C_20220601T101031_N0400_R022_T32TQM_20220601T121948.SAFE</PRODUCT_URI>
<PROCESSING_LEVEL>{level}</PROCESSING_LEVEL><PRODUCT_TYPE>S2MSI1C</PRODUCT_TYPE>
<PROCESSING_BASELINE>{baseline}</PROCESSING_BASELINE>
<Datatake datatakeIdentifier="GS2A_20220601T101031_036262_N04.00">
<SPACECRAFT_NAME>Sentinel-2A</SPACECRAFT_NAME></Datatake>
<Product_Organisation><Granule_List><Granule>{files}</Granule></Granule_List></Product_Organisation></Product_Info>
<Product_Image_Characteristics>
<Special_Values><SPECIAL_VALUE_TEXT>NODATA</SPECIAL_VALUE_TEXT><SPECIAL_VALUE_INDEX>0</SPECIAL_VALUE_INDEX></Special_Values>
<QUANTIFICATION_VALUE unit="none">10000</QUANTIFICATION_VALUE>{offset_list}
<Reflectance_Conversion><U>0.97</U><Solar_Irradiance_List>{sun}</Solar_Irradiance_List></Reflectance_Conversion>
<Spectral_Information_List>{spectral}</Spectral_Information_List>
</Product_Image_Characteristics></n1:General_Info></n1:Level-1C_User_Product>
"""


def _grid(tag, zenith, azimuth, more=""):
    def table(values):
        rows = "".join(f"<VALUES>{' '.join(f'{value:.4f}' for value in row)}</VALUES>" for row in values)
        step = 80  # so that the nodes span the small granule
        return (
            f'<COL_STEP unit="m">{step}</COL_STEP><ROW_STEP unit="m">{step}</ROW_STEP><Values_List>{rows}</Values_List>'
        )

    zenith, azimuth = (table(values).replace("nan", "NaN") for values in (zenith, azimuth))
    return f"<{tag}{more}><Zenith>{zenith}</Zenith><Azimuth>{azimuth}</Azimuth></{tag}>"


def s2_angles(sun_zenith=30.0):
    """Sun and the views of two detectors, each on its half of the granule with a column in common."""
    row, col = np.mgrid[0:S2_NODES, 0:S2_NODES].astype(float)
    sun = sun_zenith + 0.02 * row - 0.01 * col, 150.0 + 0.05 * col
    left = np.where(col <= 12, 4.0 + 0.1 * col, np.nan), np.where(col <= 12, 358.0 + 0.0 * col, np.nan)
    right = np.where(col >= 12, 4.0 + 0.1 * col, np.nan), np.where(col >= 12, 6.0 + 0.0 * col, np.nan)
    return sun, left, right


def s2_granule_xml(sun_zenith=30.0):
    sun, *views = s2_angles(sun_zenith)
    grids = "".join(
        _grid("Viewing_Incidence_Angles_Grids", *view, f' bandId="{band}" detectorId="{detector}"')
        for band in range(13)
        for detector, view in enumerate(views, start=1)
    )
    sizes = "".join(
        f'<Size resolution="{r}"><NROWS>{S2_SIZE * 10 // r}</NROWS><NCOLS>{S2_SIZE * 10 // r}</NCOLS></Size>'
        for r in (10, 20, 60)
    )
    places = "".join(
        f'<Geoposition resolution="{r}"><ULX>399960</ULX><ULY>5000040</ULY>'
        f"<XDIM>{r}</XDIM><YDIM>-{r}</YDIM></Geoposition>"
        for r in (10, 20, 60)
    )
    return f"""<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<n1:Level-1C_Tile_ID xmlns:n1="https://psd-14.sentinel2.eo.esa.int/PSD/S2_PDI_Level-1C_Tile_Metadata.xsd">
<n1:Geometric_Info><Tile_Geocoding metadataLevel="Brief"><HORIZONTAL_CS_NAME>WGS84 / UTM zone 32N</HORIZONTAL_CS_NAME>
<HORIZONTAL_CS_CODE>EPSG:32632</HORIZONTAL_CS_CODE>{sizes}{places}</Tile_Geocoding>
<Tile_Angles metadataLevel="Standard">{_grid("Sun_Angles_Grid", *sun)}{grids}</Tile_Angles>
</n1:Geometric_Info></n1:Level-1C_Tile_ID>
"""


def write_safe(folder, **product):
    """A SAFE folder; returns its path."""
    import rasterio

    sun_zenith = product.pop("sun_zenith", 30.0)
    safe = folder / "S2A_MSIL1C_20220601T101031_N0400_R022_T32TQM_20220601T121948.SAFE"
    images = safe / "GRANULE" / GRANULE / "IMG_DATA"
    images.mkdir(parents=True)
    (safe / "MTD_MSIL1C.xml").write_text(s2_product_xml(**product), encoding="utf-8")
    (images.parent / "MTD_TL.xml").write_text(s2_granule_xml(sun_zenith), encoding="utf-8")
    for name, numbers in S2_NUMBERS.items():
        r = S2_RESOLUTIONS[name]
        layout = {
            "driver": "JP2OpenJPEG",
            "crs": "EPSG:32632",
            "transform": rasterio.Affine(r, 0, 399960, 0, -r, 5000040),
            "QUALITY": 100,
            "REVERSIBLE": "YES",
        }
        height, width = numbers.shape
        path = images / f"{TILE}_{name}.jp2"
        with rasterio.open(path, "w", height=height, width=width, count=1, dtype="uint16", **layout) as file:
            file.write(numbers, 1)
    return safe


LANDSAT_ID = "LC08_L1TP_193027_20220601_20220609_02_T1"
LANDSAT_SHAPE = (90, 110)
LANDSAT_NUMBERS = {
    number: np.random.default_rng(100 + number).integers(5000, 30000, LANDSAT_SHAPE, dtype=np.uint16)
    for number in (1, 2, 3, 4, 5, 6, 7, 9)
}
for _numbers in LANDSAT_NUMBERS.values():
    _numbers[:8, :9] = 0
LANDSAT_NUMBERS[4][50, 60] = 65535


def mtl_groups(sun_elevation=60.0, level="L1TP"):
    """Groups of the metadata, as in a JSON or XML file."""
    numbers = (*LANDSAT_NUMBERS, 8, 10, 11)
    reflective = (1, 2, 3, 4, 5, 6, 7, 8, 9)
    return {
        "PRODUCT_CONTENTS": {
            "LANDSAT_PRODUCT_ID": LANDSAT_ID,
            "PROCESSING_LEVEL": level,
            "COLLECTION_NUMBER": "02",
            **{f"FILE_NAME_BAND_{i}": f"{LANDSAT_ID}_B{i}.TIF" for i in sorted(numbers)},
        },
        "IMAGE_ATTRIBUTES": {
            "SPACECRAFT_ID": "LANDSAT_8",
            "DATE_ACQUIRED": "2022-06-01",
            "SCENE_CENTER_TIME": "10:04:05.1234560Z",
            "SUN_AZIMUTH": "140.00000000",
            "SUN_ELEVATION": f"{sun_elevation:.8f}",
            "EARTH_SUN_DISTANCE": "1.0140411",
        },
        "LEVEL1_MIN_MAX_PIXEL_VALUE": {f"QUANTIZE_CAL_MAX_BAND_{i}": "65535" for i in reflective},
        "LEVEL1_RADIOMETRIC_RESCALING": {
            **{f"RADIANCE_MULT_BAND_{i}": f"{0.01 * i:.4E}" for i in reflective},
            **{f"RADIANCE_ADD_BAND_{i}": f"{-50.0 * i:.5f}" for i in reflective},
            **{f"REFLECTANCE_MULT_BAND_{i}": "2.0000E-05" for i in reflective},
            **{f"REFLECTANCE_ADD_BAND_{i}": "-0.100000" for i in reflective},
        },
    }


def mtl_text(groups):
    lines = ["GROUP = LANDSAT_METADATA_FILE"]
    for group, values in groups.items():
        lines.append(f"  GROUP = {group}")
        for key, value in values.items():
            plain = value.lstrip("-")[:1].isdigit() and not key.startswith(("COLLECTION", "SCENE"))
            lines.append(f"    {key} = {value}" if plain else f'    {key} = "{value}"')
        lines.append(f"  END_GROUP = {group}")
    return "\n".join([*lines, "END_GROUP = LANDSAT_METADATA_FILE", "END", ""])


def mtl_xml(groups):
    body = "".join(
        f"<{group}>{''.join(f'<{key}>{value}</{key}>' for key, value in values.items())}</{group}>"
        for group, values in groups.items()
    )
    return f'<?xml version="1.0" encoding="UTF-8"?><LANDSAT_METADATA_FILE>{body}</LANDSAT_METADATA_FILE>'


def landsat_angles():
    """Angles [degree] at every pixel: SZA, SAA, VZA, VAA; the view changes sides in the middle."""
    row, col = np.mgrid[0 : LANDSAT_SHAPE[0], 0 : LANDSAT_SHAPE[1]].astype(float)
    aside = (col - 55.0) * 0.1
    return {
        "SZA": 30.0 + 0.03 * row - 0.01 * col,
        "SAA": 140.0 + 0.01 * row,
        "VZA": np.abs(aside),
        "VAA": np.where(aside < 0, 100.0, -80.0),
    }


def write_landsat(folder, *, angles=True, form="txt", **attributes):
    """A Landsat folder; returns its path."""
    import json

    import rasterio

    place = folder / LANDSAT_ID
    place.mkdir()
    groups = mtl_groups(**attributes)
    text = {
        "txt": lambda: mtl_text(groups),
        "json": lambda: json.dumps({"LANDSAT_METADATA_FILE": groups}),
        "xml": lambda: mtl_xml(groups),
    }[form]()
    (place / f"{LANDSAT_ID}_MTL.{form}").write_text(text)
    layout = {"driver": "GTiff", "crs": "EPSG:32632", "transform": rasterio.Affine(30, 0, 399885, 0, -30, 5000015)}
    height, width = LANDSAT_SHAPE

    def write(name, numbers):
        path = place / f"{LANDSAT_ID}_{name}.TIF"
        with rasterio.open(path, "w", height=height, width=width, count=1, dtype=numbers.dtype, **layout) as file:
            file.update_tags(AREA_OR_POINT="Point")
            file.write(numbers, 1)

    for number, numbers in LANDSAT_NUMBERS.items():
        write(f"B{number}", numbers)
    if angles:
        for name, values in landsat_angles().items():
            hundredths = np.rint(100.0 * values).astype(np.int16)
            hundredths[:8, :9] = 0
            write(name, hundredths)
    return place
