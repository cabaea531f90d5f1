"""Cameras, directions, and the Sun's place in the sky."""

from __future__ import annotations

from skyscatter.geometry.camera import Camera, Fisheye, Panorama, Perspective, PlanetView, camera_from_view
from skyscatter.geometry.sun import SunPosition, sun_position

__all__ = [
    "Camera",
    "Fisheye",
    "Panorama",
    "Perspective",
    "PlanetView",
    "SunPosition",
    "camera_from_view",
    "sun_position",
]
