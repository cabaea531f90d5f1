"""A picture's place in the sky as cards of a FITS header, and back (Calabretta & Greisen 2002, A&A 395, 1077)."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from skyscatter.image.skyframe import SkyFrame
from skyscatter.units import PARSEC

Card = tuple[str, Any, str]

#: Cards of the orientation of the model, which the WCS does not know.
_TURNS = {
    "inclination_deg": ("INCLINAT", "[deg] tilt of the model's axis to north"),
    "azimuth_deg": ("AZIMUTH", "[deg] turn of the model about its axis"),
    "position_angle_deg": ("POSANGLE", "[deg] turn in the sky, N through E"),
}


def celestial_cards(sky: SkyFrame | None, width: int, height: int) -> list[Card]:
    """Header cards of the first two axes; none without a frame.

    Row 1 of FITS is the bottom of the picture, so that declination grows with the row; east is left, so that right
    ascension falls with the column.
    """
    if sky is None:
        return []
    cards: list[Card] = [
        ("CTYPE1", "RA---TAN", "right ascension, gnomonic"),
        ("CTYPE2", "DEC--TAN", "declination, gnomonic"),
        ("CUNIT1", "deg", ""),
        ("CUNIT2", "deg", ""),
        ("CRPIX1", (width + 1) / 2, "middle of the picture"),
        ("CRPIX2", (height + 1) / 2, "middle of the picture"),
        ("CRVAL1", sky.ra_deg, "[deg]"),
        ("CRVAL2", sky.dec_deg, "[deg]"),
        ("CDELT1", -sky.pixel_scale_deg, "[deg] east is left"),
        ("CDELT2", sky.pixel_scale_deg, "[deg] north is up"),
        ("LONPOLE", 180.0, "[deg] no rotation"),
        ("RADESYS", sky.frame.upper(), "frame of the coordinates"),
    ]
    if sky.name:
        cards.append(("OBJECT", sky.name, ""))
    if sky.distance is not None:
        cards.append(("DISTANCE", sky.distance / PARSEC, "[pc] distance of the object"))
    for name, (keyword, comment) in _TURNS.items():
        if getattr(sky, name) is not None:
            cards.append((keyword, getattr(sky, name), comment))
    return cards


def read_celestial(header: Any) -> SkyFrame | None:
    """Frame that a header describes; None where it has no celestial axes, or others than a `SkyFrame` can say.

    Other projections, rotated or oblong pixels, a reference pixel away from the middle, and frames other than the ICRS
    are of that kind: the pixels are read all the same.
    """
    if (header.get("CTYPE1", "").strip(), header.get("CTYPE2", "").strip()) != ("RA---TAN", "DEC--TAN"):
        return None
    turned = any(header.get(f"{kind}{axes}") for kind in ("PC", "CD") for axes in ("1_2", "2_1"))
    middle = tuple((header.get(f"NAXIS{axis}", 0) + 1) / 2 for axis in (1, 2))
    scale = header.get("CDELT2", 0.0) * header.get("PC2_2", 1.0)
    across = header.get("CDELT1", 0.0) * header.get("PC1_1", 1.0)
    plain = (
        not turned
        and "CD1_1" not in header
        and (header.get("CRPIX1"), header.get("CRPIX2")) == middle
        and scale > 0.0
        and abs(across + scale) <= 1e-9 * scale
        and header.get("CUNIT1", "deg").strip() == "deg" == header.get("CUNIT2", "deg").strip()
        and header.get("RADESYS", "ICRS").strip() == "ICRS"
        and header.get("LONPOLE", 180.0) == 180.0
    )
    if not plain:
        return None
    distance = header.get("DISTANCE")
    try:
        return SkyFrame(
            ra_deg=header["CRVAL1"] % 360.0,
            dec_deg=header["CRVAL2"],
            pixel_scale_deg=scale,
            distance=None if distance is None else distance * PARSEC,
            name=str(header.get("OBJECT", "")),
            **{name: header.get(keyword) for name, (keyword, _) in _TURNS.items()},
        )
    except (KeyError, TypeError, ValidationError):
        return None
