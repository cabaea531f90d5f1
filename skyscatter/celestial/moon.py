"""The Moon: where it stands, how much light it sends, and how its face looks.

`moon_at` finds it for a `skyscatter.celestial.frames.Sight`; `moon_irradiance` is its light outside the air by the
model ROLO, `moon_radiance` the same light over its disk, with the Earth's on the dark part.
"""

from skyscatter.celestial.lunarplace import MOON_RADIUS, Moon, moon_at
from skyscatter.celestial.moonface import earthshine, moon_radiance
from skyscatter.celestial.rolo import moon_irradiance, moon_reflectance

__all__ = [
    "MOON_RADIUS",
    "Moon",
    "earthshine",
    "moon_at",
    "moon_irradiance",
    "moon_radiance",
    "moon_reflectance",
]
