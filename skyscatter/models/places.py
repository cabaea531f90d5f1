"""Skies of a place on Earth at a moment, with all that shines there."""

from __future__ import annotations

from typing import Any

from skyscatter.models.files import load_model
from skyscatter.models.sky import Model
from skyscatter.scene import Scene


def sky_at(
    place: tuple[float, float], time: Any, *, model: str | Model = "earth", altitude: Any = 0.0, lights: Any = "auto"
) -> Scene:
    """The scene of a place and a time, lit by all that matters there: Sun, Moon, stars and the night's own light.

    Parameters
    ----------
    place : (float, float)
        Geodetic latitude and longitude, north and east positive [degree].
    time : str or datetime
        ISO 8601 text, UTC; or a datetime.
    model : str or Model
        Name or file of a model of the Earth's air, or a model.
    altitude : float or str or Quantity
        Of the observer above the ground [m].
    lights : "auto", SkyLights or sequence of str, optional
        What shines; ``"auto"`` takes what matters at that time, None the Sun alone.

    Returns
    -------
    Scene
        To be rendered; with ``parts=True`` each light is a layer.

    Raises
    ------
    DomainError
        For a place that is not on Earth, a time that cannot be read, and unknown lights.

    Examples
    --------
    Half an hour before midnight in August in the Alps: no Sun and no Moon, but all else.

    >>> import skyscatter
    >>> scene = skyscatter.sky_at((46.55, 7.98), "2026-08-12T21:30Z", altitude="3571 m")
    >>> round(scene.sun.elevation_deg), "stars" in scene.lights.shine
    (-23, True)
    """
    found = load_model(model) if isinstance(model, str) else model
    if not isinstance(found, Model):
        raise TypeError(f"model: {model!r} is no sky; give a model of the Earth's air")
    return found.scene_at(*place, time, altitude, lights)
