"""Reading what files call their bands: numbers, colours, wavelengths."""

from __future__ import annotations

import re
from collections.abc import Sequence

from skyscatter.dehaze.passband import Band, Role

#: A band number as files write it, as a word of its own: B2, B02, b8a, band 2, Band_10, SR_B2, T32TMT_..._B02_10m.
_NUMBER = re.compile(r"(?<![a-z0-9])(?:band|b)[ _-]?0*([0-9]{1,3}a?)(?![a-z0-9])")
_WAVELENGTH = re.compile(r"(?<![0-9.])([0-9]+(?:\.[0-9]+)?)[ _]?(nm|um|µm|micrometers?|nanometers?)(?![a-z])")

#: Words for roles, each with which of several bands of that role is meant (0 the first; None: only if there is one).
#: Longer phrases come first, so that "near infrared" is not taken for something shorter.
_WORDS: tuple[tuple[str, tuple[Role, ...], int | None], ...] = (
    (r"coastal(?:[ _-]?aerosol)?|ultra[ _-]?blue|deep[ _-]?blue", ("coastal",), None),
    (r"(?:vegetation[ _-])?red[ _-]?edge[ _-]?(?:1|01|071|705)|re1", ("rededge",), 0),
    (r"(?:vegetation[ _-])?red[ _-]?edge[ _-]?(?:2|02|075|740)|re2", ("rededge",), 1),
    (r"(?:vegetation[ _-])?red[ _-]?edge[ _-]?(?:3|03|078|783)|re3", ("rededge",), 2),
    (r"(?:vegetation[ _-])?red[ _-]?edge", ("rededge",), None),
    (r"nir[ _-]?0?9|water[ _-]?vapou?r", ("water-vapour",), None),
    (r"narrow[ _-]?nir|nir[ _-]?narrow|nir[ _-]?0?8|nir2", ("nir-narrow", "nir"), None),
    (r"near[ _-]?infra[ _-]?red|nir|nir1", ("nir", "nir-narrow"), None),
    (r"cirrus", ("cirrus",), None),
    (r"swir[ _-]?(?:1|16)|short[ _-]?wave[ _-]?infra[ _-]?red[ _-]?1", ("swir1",), None),
    (r"swir[ _-]?(?:2|22)|short[ _-]?wave[ _-]?infra[ _-]?red[ _-]?2", ("swir2",), None),
    (r"pan(?:chromatic)?", ("pan",), None),
    (r"blue|^b$", ("blue",), None),
    (r"green|^g$", ("green",), None),
    (r"red|^r$", ("red",), None),
)
_PATTERNS = tuple((re.compile(rf"(?<![a-z0-9])(?:{p})(?![a-z0-9])"), roles, which) for p, roles, which in _WORDS)


def find_band(bands: Sequence[Band], text: str) -> Band | None:
    """The band that `text` names, by number, then by word, then by wavelength; None if it names none, or several."""
    said = text.strip().lower()
    exact = [band for band in bands if band.name.lower() == said]
    if exact:
        return exact[0]
    for number in _NUMBER.findall(said):
        for band in bands:
            own = _NUMBER.fullmatch(band.name.lower())
            if own is not None and own[1] == number:
                return band
    names_number = _NUMBER.search(said) is not None and any(_NUMBER.fullmatch(band.name.lower()) for band in bands)
    if names_number:  # a number that this sensor does not have, such as a thermal band: no guess by other words
        return None
    return _by_word(bands, said) or _by_wavelength(bands, said)


def _by_word(bands: Sequence[Band], said: str) -> Band | None:
    for band in bands:  # a user's own names first
        if re.search(rf"(?<![a-z0-9]){re.escape(band.name.lower())}(?![a-z0-9])", said):
            return band
    for pattern, roles, which in _PATTERNS:
        if pattern.search(said):
            for role in roles:
                candidates = [band for band in bands if band.role == role]
                if which is not None and which < len(candidates):
                    return candidates[which]
                if which is None and len(candidates) == 1:
                    return candidates[0]
            return None
    return None


def _by_wavelength(bands: Sequence[Band], said: str) -> Band | None:
    """The narrowest band that holds the one wavelength in the text."""
    values = [float(v) * (1.0 if unit.startswith("n") else 1000.0) for v, unit in _WAVELENGTH.findall(said)]
    if len(values) != 1:
        return None
    holding = [band for band in bands if abs(values[0] - band.centre_nm) <= 0.5 * band.width_nm]
    return min(holding, key=lambda band: band.width_nm) if holding else None
