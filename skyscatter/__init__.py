"""Scattering of light in planetary atmospheres and in nebulae, as spectra.

The tour::

    model = skyscatter.load_model("earth")                       # a planet: air, ground, star
    scene = model.scene(sun_elevation_deg=10, altitude="2 km")   # the Sun and an observer
    image = skyscatter.render(scene, skyscatter.Panorama(width=512, height=256), range(380, 781, 10))
    image.save("sky.png")

    nebula = skyscatter.load_model("reflection-nebula").scene()  # dust in space, its star, its place in the sky
    telescope = skyscatter.Telescope.from_field_of_view(256, 256, 0.2)  # pixels, and the width in degrees
    walks = skyscatter.Path(samples=16)                          # a solver with its options; "path" for the usual ones
    skyscatter.render(nebula, telescope, range(400, 701, 50), solver=walks).save("nebula.png")

Densities of nebulae are fields: `skyscatter.fields` has the shapes, grids and particles to build them from.

`optical_depth` and `transmittance` work along segments, `radiance` along rays, `render` through a camera.  Names load
when they are first used, so that importing the package costs next to nothing.

Examples
--------
How much light of three wavelengths comes down through clear air.

>>> import skyscatter
>>> scene = skyscatter.load_model("earth").scene(sun_elevation_deg=60)
>>> ground = scene.observer.position  # m, from the planet's centre
>>> skyscatter.transmittance(scene, ground, ground + [0, 0, 120e3], [450, 550, 650]).round(2)
array([0.75, 0.84, 0.9 ])
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyscatter.lazy import lazy_names

__version__ = "0.1.0"

_HOME = {
    "Component": "skyscatter.media.medium",
    "Dust": "skyscatter.optics.dust",
    "GasLines": "skyscatter.optics.lines",
    "Particles": "skyscatter.optics.particles",
    "NebulaModel": "skyscatter.models.nebula",
    "ParallelLight": "skyscatter.lights",
    "PointStar": "skyscatter.lights",
    "SpaceScene": "skyscatter.space",
    "Body": "skyscatter.surfaces.scene",
    "SurfaceMedium": "skyscatter.surfaces.scene",
    "SurfaceModel": "skyscatter.models.surfaces",
    "SurfaceScene": "skyscatter.surfaces.scene",
    "Viewpoint": "skyscatter.surfaces.scene",
    "StarField": "skyscatter.starfield",
    "View": "skyscatter.space",
    "Medium": "skyscatter.media.medium",
    "Ground": "skyscatter.ground",
    "GroundMap": "skyscatter.ground",
    "Observer": "skyscatter.scene",
    "Scene": "skyscatter.scene",
    "Star": "skyscatter.scene",
    "Sun": "skyscatter.scene",
    "SkyLights": "skyscatter.celestial.lights",
    "Model": "skyscatter.models.sky",
    "Planet": "skyscatter.models.sky",
    "load_model": "skyscatter.models.files",
    "sky_at": "skyscatter.models.places",
    "model_names": "skyscatter.models.files",
    "Fisheye": "skyscatter.geometry.camera",
    "Panorama": "skyscatter.geometry.camera",
    "Perspective": "skyscatter.geometry.camera",
    "PlanetView": "skyscatter.geometry.camera",
    "Telescope": "skyscatter.geometry.telescope",
    "FilterCurve": "skyscatter.image.filters",
    "FilterImage": "skyscatter.image.filterimage",
    "SkyFrame": "skyscatter.image.skyframe",
    "SpectralImage": "skyscatter.image.spectral",
    "observe": "skyscatter.image.instrument",
    "SpectralTable": "skyscatter.spectra.table",
    "optical_depth": "skyscatter.columns",
    "register": "skyscatter.registry",
    "transmittance": "skyscatter.columns",
    "fit": "skyscatter.inversion.fitting",
    "Answer": "skyscatter.solvers.base",
    "CorrectionTerms": "skyscatter.solvers.terms",
    "Fluxes": "skyscatter.solvers.fluxes",
    "RadianceField": "skyscatter.solvers.field",
    "Orders": "skyscatter.solvers.options",
    "Path": "skyscatter.solvers.options",
    "Photons": "skyscatter.solvers.options",
    "Single": "skyscatter.solvers.options",
    "radiance": "skyscatter.solvers.run",
    "solve": "skyscatter.solvers.field",
    "render": "skyscatter.solvers.render",
}

_MODULES = ("dehaze", "fields", "inversion", "surfaces", "window")

__all__ = ["__version__", *_HOME, *_MODULES]

if TYPE_CHECKING:
    from skyscatter import fields as fields
    from skyscatter import inversion as inversion
    from skyscatter import surfaces as surfaces
    from skyscatter import window as window
    from skyscatter.celestial.lights import SkyLights as SkyLights
    from skyscatter.columns import optical_depth as optical_depth
    from skyscatter.columns import transmittance as transmittance
    from skyscatter.dehaze.called import dehaze as dehaze
    from skyscatter.geometry.camera import Fisheye as Fisheye
    from skyscatter.geometry.camera import Panorama as Panorama
    from skyscatter.geometry.camera import Perspective as Perspective
    from skyscatter.geometry.camera import PlanetView as PlanetView
    from skyscatter.geometry.telescope import Telescope as Telescope
    from skyscatter.ground import Ground as Ground
    from skyscatter.ground import GroundMap as GroundMap
    from skyscatter.image.filterimage import FilterImage as FilterImage
    from skyscatter.image.filters import FilterCurve as FilterCurve
    from skyscatter.image.instrument import observe as observe
    from skyscatter.image.skyframe import SkyFrame as SkyFrame
    from skyscatter.image.spectral import SpectralImage as SpectralImage
    from skyscatter.inversion.fitting import fit as fit
    from skyscatter.lights import ParallelLight as ParallelLight
    from skyscatter.lights import PointStar as PointStar
    from skyscatter.media.medium import Component as Component
    from skyscatter.media.medium import Medium as Medium
    from skyscatter.models.files import load_model as load_model
    from skyscatter.models.files import model_names as model_names
    from skyscatter.models.nebula import NebulaModel as NebulaModel
    from skyscatter.models.places import sky_at as sky_at
    from skyscatter.models.sky import Model as Model
    from skyscatter.models.sky import Planet as Planet
    from skyscatter.models.surfaces import SurfaceModel as SurfaceModel
    from skyscatter.optics.dust import Dust as Dust
    from skyscatter.optics.lines import GasLines as GasLines
    from skyscatter.optics.particles import Particles as Particles
    from skyscatter.registry import register as register
    from skyscatter.scene import Observer as Observer
    from skyscatter.scene import Scene as Scene
    from skyscatter.scene import Star as Star
    from skyscatter.scene import Sun as Sun
    from skyscatter.solvers.base import Answer as Answer
    from skyscatter.solvers.field import RadianceField as RadianceField
    from skyscatter.solvers.field import solve as solve
    from skyscatter.solvers.fluxes import Fluxes as Fluxes
    from skyscatter.solvers.options import Orders as Orders
    from skyscatter.solvers.options import Path as Path
    from skyscatter.solvers.options import Photons as Photons
    from skyscatter.solvers.options import Single as Single
    from skyscatter.solvers.render import render as render
    from skyscatter.solvers.run import radiance as radiance
    from skyscatter.solvers.terms import CorrectionTerms as CorrectionTerms
    from skyscatter.space import SpaceScene as SpaceScene
    from skyscatter.space import View as View
    from skyscatter.spectra.table import SpectralTable as SpectralTable
    from skyscatter.starfield import StarField as StarField
    from skyscatter.surfaces.scene import Body as Body
    from skyscatter.surfaces.scene import SurfaceMedium as SurfaceMedium
    from skyscatter.surfaces.scene import SurfaceScene as SurfaceScene
    from skyscatter.surfaces.scene import Viewpoint as Viewpoint


if not TYPE_CHECKING:  # it would accept any name
    __getattr__, __dir__ = lazy_names(globals(), _HOME, _MODULES)
