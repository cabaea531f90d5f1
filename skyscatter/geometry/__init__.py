"""Cameras, directions, and the Sun's place in the sky."""

from __future__ import annotations

from skyscatter.geometry.camera import Camera, Fisheye, Panorama, Perspective, PlanetView, camera_from_view
from skyscatter.geometry.sun import SunPosition, sun_position
from skyscatter.geometry.telescope import Telescope

__all__ = [
    "Camera",
    "Fisheye",
    "Panorama",
    "Perspective",
    "PlanetView",
    "SunPosition",
    "Telescope",
    "camera_from_view",
    "sun_position",
]
