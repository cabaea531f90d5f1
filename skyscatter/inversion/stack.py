"""Several scenes solved as one: copies of a scene that differ in what they do to light, side by side in the spectrum.

Solvers treat the spectrum as a list of channels that share every path, every walk and every grid.  Nothing says that
two channels must be two wavelengths of one scene: here a channel is a wavelength *of a copy*.  What differs between
copies then differs by nothing but the copies' physics: not by other walks, grids or stopping points.

A `Stack` is handed to the solvers with channel numbers in place of wavelengths.  Copies share their geometry: planet,
observer, Sun, places of stars.  Densities may differ; each different one becomes a component of its own, which the
other copies do not see.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.ground import Ground
from skyscatter.lights import ParallelLight, PointStar
from skyscatter.media.medium import Component, Medium
from skyscatter.optics.base import Coefficients, OpticalModel, PhaseFunction
from skyscatter.record import Record
from skyscatter.scene import Scene, Star
from skyscatter.space import SpaceScene
from skyscatter.spectra.table import SpectralTable, evaluate

Array = NDArray[np.float64]
AnyScene = Scene | SpaceScene


class Channels(Record):
    """Numbers 1, 2, ... of channels: wavelength by wavelength, and within each copy by copy.

    The middle channel, which the solvers take for typical, so belongs to the middle wavelength.
    """

    wavelengths: tuple[float, ...]
    copies: int

    @property
    def numbers(self) -> Array:
        """All channel numbers, in place of wavelengths."""
        return np.asarray(1.0 + np.arange(len(self.wavelengths) * self.copies), float)

    def spread(self, numbers: ArrayLike, values: Callable[[int, Array], Array]) -> Array:
        """``values(copy, wavelengths)`` of shape (..., wavelength) for every copy, as (..., channel)."""
        row = np.rint(np.atleast_1d(np.asarray(numbers, float))).astype(int) - 1
        copy, wl = row % self.copies, np.array(self.wavelengths)[row // self.copies]
        out: Array | None = None
        for k in np.unique(copy):
            part = np.asarray(values(int(k), wl[copy == k]))
            if out is None:
                out = np.zeros((*part.shape[:-1], row.size))
            out[..., copy == k] = part
        return np.zeros(0) if out is None else out

    def table(self, values: Callable[[int, Array], Array]) -> SpectralTable:
        """The same for plain spectra, as a table over the channel numbers."""
        spectrum = self.spread(self.numbers, values)
        return SpectralTable(wavelengths=tuple(self.numbers.tolist()), values=tuple(spectrum.tolist()))

    def split(self, values: Array) -> Array:
        """Results (..., channel) as (copy, ..., wavelength)."""
        shaped = values.reshape(*values.shape[:-1], len(self.wavelengths), self.copies)
        return np.moveaxis(shaped, -1, 0)


class _StackedPhase(PhaseFunction):
    """The phase function of every copy; that of the first stands for copies which do not have the component."""

    channels: Channels
    optics: tuple[Any, ...]

    def _of(self, copy: int) -> OpticalModel:
        own = self.optics[copy]
        found: OpticalModel = own if own is not None else next(o for o in self.optics if o is not None)
        return found

    def value(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        return self.channels.spread(wavelengths_nm, lambda k, wl: self._of(k).phase_function(wl).value(cos_theta, wl))

    def matrix(self, cos_theta: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        return self.channels.spread(wavelengths_nm, lambda k, wl: self._of(k).phase_function(wl).matrix(cos_theta, wl))


class _StackedOptics(OpticalModel):
    """What one unit of a density does to light in every copy: nothing in copies whose entry is None."""

    channels: Channels
    optics: tuple[Any, ...]
    weights: tuple[float, ...]
    emissions: tuple[Any, ...]

    def coefficients(self, wavelengths_nm: ArrayLike, column_m: float) -> Coefficients:
        def of(copy: int, wl: Array) -> Array:
            if self.optics[copy] is None:
                return np.zeros((3, wl.size))
            found = self.optics[copy].coefficients(wl, column_m)
            emission = found.emission + evaluate(self.emissions[copy], wl)
            return self.weights[copy] * np.stack([found.scattering, found.absorption, emission])

        return Coefficients(*self.channels.spread(wavelengths_nm, of))

    def phase_function(self, wavelengths_nm: ArrayLike) -> PhaseFunction:
        return _StackedPhase.model_construct(channels=self.channels, optics=self.optics)


class _StackedSun(Star):
    """The Sun of every copy: one disk, other spectra."""

    channels: Channels
    stars: tuple[Star, ...]

    def irradiance(self, wavelengths_nm: ArrayLike, distance: float) -> Array:
        return self.channels.spread(wavelengths_nm, lambda k, wl: self.stars[k].irradiance(wl, distance))

    def limb(self, mu: ArrayLike, wavelengths_nm: ArrayLike) -> Array:
        return self.channels.spread(wavelengths_nm, lambda k, wl: self.stars[k].limb(mu, wl))


class _StackedPointStar(PointStar):
    """A star of every copy: one place, other spectra."""

    channels: Channels
    stars: tuple[PointStar, ...]

    def spectral_luminosity(self, wavelengths_nm: ArrayLike, distance_m: float | None = None) -> Array:
        return self.channels.spread(wavelengths_nm, lambda k, wl: self.stars[k].spectral_luminosity(wl, distance_m))


class _StackedLight(ParallelLight):
    """A parallel light of every copy."""

    channels: Channels
    lights: tuple[ParallelLight, ...]

    def spectral_irradiance(self, wavelengths_nm: ArrayLike) -> Array:
        return self.channels.spread(wavelengths_nm, lambda k, wl: self.lights[k].spectral_irradiance(wl))


@dataclass(frozen=True)
class Stack:
    """Copies of a scene as one scene.

    Attributes
    ----------
    scene : Scene or SpaceScene
        To be solved at ``channels.numbers`` in place of wavelengths.
    channels : Channels
    """

    scene: AnyScene
    channels: Channels


def stack(scenes: Sequence[AnyScene], wavelengths: ArrayLike) -> Stack:
    """Stack copies of a scene that share their geometry; see `differences_forbid`.

    Parameters
    ----------
    scenes : sequence of Scene or of SpaceScene
    wavelengths : array_like, shape (wavelength,)
        [nm].

    Raises
    ------
    DomainError
        If the copies differ in more than their optics, densities, ground albedo and spectra of lights.
    """
    first = scenes[0]
    for other in scenes[1:]:
        reason = differences_forbid(first, other)
        if reason:
            raise DomainError("scenes", reason, "copies solved together must agree in it")
    wl = np.atleast_1d(np.asarray(wavelengths, float))
    channels = Channels(wavelengths=tuple(wl.tolist()), copies=len(scenes))
    medium = _stacked_medium([s.medium for s in scenes], channels)
    if isinstance(first, Scene):
        return Stack(_stacked_sky(scenes, medium, channels), channels)
    return Stack(_stacked_space(scenes, medium, channels), channels)


def differences_forbid(one: AnyScene, other: AnyScene) -> str:
    """What keeps two scenes from being stacked; empty if nothing does."""
    if type(one) is not type(other):
        return "their kind"
    if [c.name for c in one.medium.components] != [c.name for c in other.medium.components]:
        return "the components"
    if one.medium.planet_radius != other.medium.planet_radius:
        return "planet_radius"
    if isinstance(one, Scene) and isinstance(other, Scene):
        for name in ("sun", "altitude"):
            if getattr(one, name) != getattr(other, name):
                return name
        if one.ground.map != other.ground.map:
            return "ground.map"
        if any(getattr(one.star, name) != getattr(other.star, name) for name in ("radius", "distance")):
            return "star"
    if isinstance(one, SpaceScene) and isinstance(other, SpaceScene):
        if one.view != other.view or one.star_field != other.star_field:
            return "view or star_field"
        if [s.position for s in one.stars] != [s.position for s in other.stars]:
            return "places of stars"
        if [tuple(p.towards) for p in one.parallel] != [tuple(p.towards) for p in other.parallel]:
            return "directions of parallel lights"
    return ""


def _stacked_medium(media: Sequence[Medium], channels: Channels) -> Medium:
    """All components of all copies, those of one density as one."""
    components = []
    for group in zip(*(medium.components for medium in media), strict=True):
        densities: list[Any] = []
        for component in group:
            if component.density not in densities:
                densities.append(component.density)
        for number, density in enumerate(densities):
            own = [c if c.density == density else None for c in group]
            optics: Any = _StackedOptics.model_construct(
                channels=channels, optics=tuple(None if c is None else c.optics for c in own),
                weights=tuple(0.0 if c is None else c.weight for c in own),
                emissions=tuple(0.0 if c is None else c.emission for c in own),
            )  # fmt: skip
            name = group[0].name if number == 0 else f"{group[0].name} ({number + 1})"
            components.append(
                Component.model_construct(name=name, density=density, optics=optics, weight=1.0, emission=0.0)
            )
    return Medium.model_construct(components=tuple(components), planet_radius=media[0].planet_radius)


def _stacked_sky(scenes: Sequence[Any], medium: Medium, channels: Channels) -> Scene:
    first = scenes[0]
    star = _StackedSun.model_construct(
        channels=channels, stars=tuple(s.star for s in scenes), radius=first.star.radius, distance=first.star.distance
    )
    albedo = channels.table(lambda k, wl: scenes[k].ground.reflectance(wl))
    background = channels.table(lambda k, wl: evaluate(scenes[k].background, wl))
    if first.ground.map is not None:
        raise DomainError("ground.map", "a map", "scenes solved together have plain ground")
    return Scene.model_construct(
        medium=medium, ground=Ground(albedo=albedo), star=star, sun=first.sun, altitude=first.altitude,
        background=background,
    )  # fmt: skip


def _stacked_space(scenes: Sequence[Any], medium: Medium, channels: Channels) -> SpaceScene:
    first = scenes[0]
    stars = tuple(
        # The surface, which only says how near to a star light stops growing, is that of the first copy.
        _StackedPointStar.model_construct(**(_own_fields(group[0]) | {"channels": channels, "stars": group}))
        for group in zip(*(s.stars for s in scenes), strict=True)
    )
    parallel = tuple(
        _StackedLight.model_construct(**(_own_fields(group[0]) | {"channels": channels, "lights": group}))
        for group in zip(*(s.parallel for s in scenes), strict=True)
    )
    return SpaceScene.model_construct(
        medium=medium, stars=stars, parallel=parallel, view=first.view, star_field=first.star_field,
        background=channels.table(lambda k, wl: scenes[k].background_radiance(wl)),
    )  # fmt: skip


def _own_fields(record: Record) -> dict[str, Any]:
    return {name: getattr(record, name) for name in type(record).model_fields}
