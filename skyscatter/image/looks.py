"""Looks: names for options of pictures that go together.  An option that is given beside a look wins.

- ``eye``: what a dark-adapted eye would see, without the glare of a lens: colours fade as it gets dim.
- ``photograph``: film, with its stronger colours and the glare of a lens; what is made where nothing is said.
- ``film``: the same curve and lens, colours as they are.
- ``deep``: an astronomer's stretch in natural colours: faint light is lifted, bright stars keep their colours.
- ``hubble``: sulphur, hydrogen and oxygen as red, green and blue, each with levels of its own; stars in their own
  colours, with the rings and spikes of that telescope where pixels are small enough.
- ``bicolour``: hydrogen red, oxygen cyan, without stars.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skyscatter.errors import DomainError
from skyscatter.record import nearest

#: Options of `skyscatter.SpectralImage.save` that each look stands for.
LOOKS: dict[str, dict[str, Any]] = {
    "eye": {"tone": "eye", "glare": "none"},
    "photograph": {"tone": "photograph", "glare": "lens"},
    "film": {"tone": "filmic", "glare": "lens"},
    "deep": {"tone": "asinh", "glare": "none"},
    "hubble": {"palette": "sho", "tone": "lupton", "continuum": "natural", "glare": "hubble"},
    "bicolour": {"palette": "hoo", "tone": "lupton", "continuum": "subtract"},
}
_PLANES = ("palette", "filters")


def is_of_planes(options: Mapping[str, Any]) -> bool:
    """Whether a picture with these options shows three filters."""
    return any(options.get(name) is not None for name in _PLANES)


def expanded(look: str | None, given: Mapping[str, Any]) -> dict[str, Any]:
    """Options of a picture: those that were given, and those of its look beside them.

    Parameters
    ----------
    look : str or None
        One of `LOOKS`.
    given : mapping
        None stands for an option that was not given.

    Raises
    ------
    DomainError
        For a look that there is not.
    """
    stated = {name: value for name, value in given.items() if value is not None}
    if look is None:
        return stated
    if look not in LOOKS:
        raise DomainError("look", look, nearest(look, LOOKS))
    own = LOOKS[look]
    if is_of_planes(stated):
        # filters take the place of the look's, or of its natural colours and their curve
        own = {name: value for name, value in own.items() if name not in _PLANES} if is_of_planes(own) else {}
    return {**own, **stated}
