"""Surfaces, what they are made of, the media between them, and lamps: the parts of a scene that light meets."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "AreaLamp": "lamps",
    "Body": "scene",
    "Box": "shapes",
    "CityLobe": "lobes",
    "Conductor": "materials",
    "ConeLobe": "lobes",
    "CosinePowerLobe": "lobes",
    "Dielectric": "materials",
    "Disk": "shapes",
    "Interface": "materials",
    "IsotropicLobe": "lobes",
    "Lambert": "materials",
    "LambertLobe": "lobes",
    "Led": "lamps",
    "Mesh": "meshes",
    "Mirror": "materials",
    "ParallelLamp": "lamps",
    "Plane": "shapes",
    "PointLamp": "lamps",
    "Rectangle": "shapes",
    "Sphere": "shapes",
    "SpotLamp": "lamps",
    "SurfaceMedium": "scene",
    "SurfaceModel": "model",
    "SurfaceScene": "scene",
    "Surroundings": "lamps",
    "TabulatedLobe": "lobes",
    "Viewpoint": "scene",
    "lamp_names": "power",
    "lamp_spectrum": "power",
    "refractive_index": "indices",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(f"skyscatter.surfaces.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'skyscatter.surfaces' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
