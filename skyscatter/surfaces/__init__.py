"""Surfaces, what they are made of, the media between them, and lamps: the parts of a scene that light meets.

Examples
--------
The share of light that water reflects straight back.

>>> from skyscatter import surfaces
>>> index = surfaces.refractive_index("water", [550])
>>> (((index - 1) / (index + 1)) ** 2).round(3)
array([0.021])
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyscatter.lazy import lazy_names

_HOME = {
    "AreaLamp": "skyscatter.surfaces.lamps",
    "Body": "skyscatter.surfaces.scene",
    "Box": "skyscatter.surfaces.shapes",
    "CityLobe": "skyscatter.surfaces.lobes",
    "Conductor": "skyscatter.surfaces.materials",
    "ConeLobe": "skyscatter.surfaces.lobes",
    "CosinePowerLobe": "skyscatter.surfaces.lobes",
    "Dielectric": "skyscatter.surfaces.materials",
    "Disk": "skyscatter.surfaces.shapes",
    "Interface": "skyscatter.surfaces.materials",
    "IsotropicLobe": "skyscatter.surfaces.lobes",
    "Lambert": "skyscatter.surfaces.materials",
    "LambertLobe": "skyscatter.surfaces.lobes",
    "Environment": "skyscatter.surfaces.lamps",
    "Led": "skyscatter.surfaces.lamps",
    "Mesh": "skyscatter.surfaces.meshes",
    "Mirror": "skyscatter.surfaces.materials",
    "Mosaic": "skyscatter.surfaces.materials",
    "ParallelLamp": "skyscatter.surfaces.lamps",
    "Plane": "skyscatter.surfaces.shapes",
    "PointLamp": "skyscatter.surfaces.lamps",
    "Rectangle": "skyscatter.surfaces.shapes",
    "RossLi": "skyscatter.surfaces.grounds",
    "Rpv": "skyscatter.surfaces.grounds",
    "Sea": "skyscatter.surfaces.grounds",
    "Sphere": "skyscatter.surfaces.shapes",
    "SpotLamp": "skyscatter.surfaces.lamps",
    "SurfaceMedium": "skyscatter.surfaces.scene",
    "SurfaceModel": "skyscatter.models.surfaces",
    "SurfaceScene": "skyscatter.surfaces.scene",
    "Surroundings": "skyscatter.surfaces.lamps",
    "TabulatedLobe": "skyscatter.surfaces.lobes",
    "Town": "skyscatter.surfaces.towns",
    "TownMap": "skyscatter.surfaces.townmap",
    "Viewpoint": "skyscatter.surfaces.scene",
    "Turned": "skyscatter.surfaces.meshes",
    "lamp_names": "skyscatter.surfaces.power",
    "lamp_spectrum": "skyscatter.surfaces.power",
    "refractive_index": "skyscatter.surfaces.indices",
}

__all__ = list(_HOME)

if TYPE_CHECKING:
    from skyscatter.models.surfaces import SurfaceModel as SurfaceModel
    from skyscatter.surfaces.grounds import RossLi as RossLi
    from skyscatter.surfaces.grounds import Rpv as Rpv
    from skyscatter.surfaces.grounds import Sea as Sea
    from skyscatter.surfaces.indices import refractive_index as refractive_index
    from skyscatter.surfaces.lamps import AreaLamp as AreaLamp
    from skyscatter.surfaces.lamps import Environment as Environment
    from skyscatter.surfaces.lamps import Led as Led
    from skyscatter.surfaces.lamps import ParallelLamp as ParallelLamp
    from skyscatter.surfaces.lamps import PointLamp as PointLamp
    from skyscatter.surfaces.lamps import SpotLamp as SpotLamp
    from skyscatter.surfaces.lamps import Surroundings as Surroundings
    from skyscatter.surfaces.lobes import CityLobe as CityLobe
    from skyscatter.surfaces.lobes import ConeLobe as ConeLobe
    from skyscatter.surfaces.lobes import CosinePowerLobe as CosinePowerLobe
    from skyscatter.surfaces.lobes import IsotropicLobe as IsotropicLobe
    from skyscatter.surfaces.lobes import LambertLobe as LambertLobe
    from skyscatter.surfaces.lobes import TabulatedLobe as TabulatedLobe
    from skyscatter.surfaces.materials import Conductor as Conductor
    from skyscatter.surfaces.materials import Dielectric as Dielectric
    from skyscatter.surfaces.materials import Interface as Interface
    from skyscatter.surfaces.materials import Lambert as Lambert
    from skyscatter.surfaces.materials import Mirror as Mirror
    from skyscatter.surfaces.materials import Mosaic as Mosaic
    from skyscatter.surfaces.meshes import Mesh as Mesh
    from skyscatter.surfaces.meshes import Turned as Turned
    from skyscatter.surfaces.power import lamp_names as lamp_names
    from skyscatter.surfaces.power import lamp_spectrum as lamp_spectrum
    from skyscatter.surfaces.scene import Body as Body
    from skyscatter.surfaces.scene import SurfaceMedium as SurfaceMedium
    from skyscatter.surfaces.scene import SurfaceScene as SurfaceScene
    from skyscatter.surfaces.scene import Viewpoint as Viewpoint
    from skyscatter.surfaces.shapes import Box as Box
    from skyscatter.surfaces.shapes import Disk as Disk
    from skyscatter.surfaces.shapes import Plane as Plane
    from skyscatter.surfaces.shapes import Rectangle as Rectangle
    from skyscatter.surfaces.shapes import Sphere as Sphere
    from skyscatter.surfaces.townmap import TownMap as TownMap
    from skyscatter.surfaces.towns import Town as Town


if not TYPE_CHECKING:  # it would accept any name
    __getattr__, __dir__ = lazy_names(globals(), _HOME)
