"""The glow of towns in the sky of an observer.

Air and planet are the same in all directions, and so is the light of a town about its vertical.  So what an observer
sees per unit of a lamp's power is a function of three numbers only: the distance d of the lamp, the elevation e of the
line of sight, and the azimuth a between them,

    L(e, a) = sum over lamps  P K(d, e, a - a_lamp).                                                          (1)

K is found at a few distances: the light that is scattered once by quadrature, all the rest by walks at fewer nodes,
between which its logarithm is joined by splines.  The sum (1) is a convolution over the azimuth, whatever the number of
lamps.  So a map of a hundred thousand of them takes hardly longer than a town.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skyscatter.kernels.forms import expect
from skyscatter.kernels.path import BATCHES
from skyscatter.progress import say
from skyscatter.scene import Scene, Sun
from skyscatter.solvers.base import Array
from skyscatter.solvers.checks import check_wavelengths
from skyscatter.solvers.skylights import Picture, add_points
from skyscatter.solvers.townlamps import Lamps, check_towns, lamps_of
from skyscatter.solvers.townlight import MOST_ORDERS, Lamplight
from skyscatter.solvers.townseen import lamps_seen
from skyscatter.solvers.townsky import BELOW, TURNS, TownGlow, cell_means
from skyscatter.workers import steady_algebra

#: Walks for each node of the distance that matters most; others have fewer, as they matter less, but so many at least.
WALKS, FEWEST = 1024, 32
#: Relative standard error of light scattered more than once above which there are more walks, up to so many times as
#: many; and error of the walks to one node above which it is itself unsure: of 256 walks through haze, seen from 60 km,
#: with an error of 40 %, only 80 % lie within two of them.
NOISE, MOST, UNSURE = 0.06, 4.0, 0.2
#: Share of the light by which tables and splines may miss it, which the error holds.
JOINED = 0.005
#: Distances of lamps are joined between nodes no further apart than by this factor, as this power of the distance.
STEP, FALL = 1.25, -2.5
#: The same for light scattered more often; of one town, this is how it falls with the distance, roughly.
WALKED_STEP, WALKED_FALL = 1.6, -2.0
#: Distances of one town that are as good as one.
NARROW = 1.03

Progress = Callable[[float], None] | None


def add_towns(picture: Picture, scene: Scene, wavelengths: Array, *, progress: Progress = None) -> None:
    """Add the light of a scene's towns to a picture or to rays, in place; to pictures lamps in sight as well."""
    if progress is not None:
        say("light of towns")
    glow = kept_glow(scene_of_towns(scene), tuple(float(w) for w in wavelengths))
    if glow is None:
        return
    for pixels, rays in picture.blocks():
        picture.add("towns", pixels, *glow.at(rays))
    add_points(picture, scene, "towns", *lamps_seen(scene, wavelengths))


def scene_of_towns(scene: Scene) -> Scene:
    """The same without what makes no difference to its towns: one solution serves all hours of a night."""
    site = scene.sun.site
    sun = Sun(elevation_deg=-90.0, site=None if site is None else site.model_copy(update={"time": ""}))
    return scene.model_copy(update={"sun": sun, "lights": None})


@lru_cache(maxsize=4)
def kept_glow(scene: Scene, wavelengths: tuple[float, ...]) -> TownGlow | None:
    """`town_glow`, kept for the frames of a sequence."""
    return town_glow(scene, wavelengths)


@dataclass(frozen=True)
class Ring:
    """Lamps of one lobe about one distance.

    Attributes
    ----------
    distance : float
        [m]
    power : ndarray, shape (azimuth, wavelength)
        Of the lamps in cells about azimuths from north [W nm-1].
    """

    distance: float
    power: Array

    @property
    def worth(self) -> float:
        """How much it matters, roughly."""
        return float(self.power.sum() * self.distance**FALL)


def rings_of(lamps: list[Lamps]) -> list[Ring]:
    """Lamps of one lobe in rings, each shared by the two distances beside it."""
    nodes = distance_nodes(*_amounts(lamps))
    power = np.zeros((nodes.size, TURNS, lamps[0].spectrum.size))
    for some in lamps:
        turn = some.azimuth / (2 * np.pi) * TURNS % TURNS
        left = np.floor(turn).astype(np.int64) % TURNS
        ring = np.clip(np.searchsorted(nodes, some.distance) - 1, 0, max(nodes.size - 2, 0))
        upper = np.minimum(ring + 1, nodes.size - 1)
        step = np.log(nodes[upper] / nodes[ring])
        share = np.divide(np.log(some.distance / nodes[ring]), step, out=np.zeros_like(step), where=step > 0)
        share = np.clip(share, 0.0, 1.0)
        held = np.zeros((nodes.size, TURNS))
        for node, part in ((ring, 1 - share), (upper, share)):
            light = some.weight * part * ((some.distance / nodes[node]) ** FALL if nodes.size > 1 else 1.0)
            for cell, side in ((left, 1 - (turn - np.floor(turn))), ((left + 1) % TURNS, turn - np.floor(turn))):
                np.add.at(held, (node, cell), light * side)
        power += held[:, :, None] * some.spectrum
    return [Ring(float(d), p) for d, p in zip(nodes, power, strict=True) if p.any()]


def _amounts(lamps: list[Lamps]) -> tuple[Array, Array]:
    """Distances of lamps, and how much they shine."""
    return (
        np.concatenate([some.distance for some in lamps]),
        np.concatenate([some.weight * some.spectrum.sum() for some in lamps]),
    )


@dataclass
class Walked:
    """Light that is scattered more than once, of lamps in rings about the observer, from walks for fewer of them.

    Attributes
    ----------
    light : Lamplight
    rings : list of Ring
        Rising.
    samples : int
        Walks for each node of the distance that matters most.
    """

    light: Lamplight
    rings: list[Ring]
    samples: int

    def __post_init__(self) -> None:
        low, high = self.rings[0].distance, self.rings[-1].distance
        if high <= WALKED_STEP * low:
            worth = [ring.worth for ring in self.rings]
            self.nodes = np.array([np.average([ring.distance for ring in self.rings], weights=worth)])
        else:
            self.nodes = np.geomspace(low, high, int(np.ceil(np.log(high / low) / np.log(WALKED_STEP))) + 1)
        self.found: dict[int, tuple[Array, Array]] = {}

    def _node(self, number: int) -> tuple[Array, Array]:
        """What walks find at a node; as many of them as its rings are worth, for errors of equal weight."""
        if number not in self.found:
            nearest = [int(np.argmin(np.abs(np.log(self.nodes / ring.distance)))) for ring in self.rings]
            worth = np.bincount(nearest, [ring.worth for ring in self.rings], self.nodes.size)
            share = worth[number] / worth.max()
            walks = max(int(self.samples * np.sqrt(share)) // BATCHES * BATCHES, FEWEST)
            *found, noise = self.light.walked(float(self.nodes[number]), walks)
            # Through thick air light is scattered often and walks differ more: as many of them as that asks for.
            more = min((float(np.median(found[1][BELOW:])) / NOISE) ** 2 * share, MOST)
            if more > 1.5:
                walks = int(walks * more) // BATCHES * BATCHES
                *found, noise = self.light.walked(float(self.nodes[number]), walks)
            self.found[number] = found[0], found[1]
            if noise > UNSURE and share > 0.5:
                self._warn(float(self.nodes[number]), noise)
        return self.found[number]

    def _warn(self, distance: float, noise: float) -> None:
        warnings.warn(
            f"towns {distance / 1e3:.3g} km away: their light is scattered so often on its way through this air that "
            f"walks find it to {noise:.0%} only, and may state too small an error",
            stacklevel=2,
        )

    def at(self, distance: float) -> tuple[Array, Array]:
        """The light of a lamp so far away [m] at the nodes over the sky, and its relative standard error."""
        if self.nodes.size == 1:
            logarithm, relative = self._node(0)
            return np.exp(logarithm + WALKED_FALL * np.log(distance / self.nodes[0])), relative
        low = int(np.clip(np.searchsorted(self.nodes, distance) - 1, 0, self.nodes.size - 2))
        share = np.log(distance / self.nodes[low]) / np.log(self.nodes[low + 1] / self.nodes[low])
        (one, one_error), (other, other_error) = self._node(low), self._node(low + 1)
        share = float(np.clip(share, 0.0, 1.0))
        return np.exp((1 - share) * one + share * other), (1 - share) * one_error + share * other_error


def distance_nodes(distance: Array, weight: Array) -> Array:
    """Distances [m], rising, between which those of lamps lie; one, where they hardly differ."""
    low, high = float(distance.min()), float(distance.max())
    if high <= NARROW * low:
        return np.array([np.average(distance, weights=weight)])
    return np.geomspace(low, high, int(np.ceil(np.log(high / low) / np.log(STEP))) + 1)


def town_glow(
    scene: Scene,
    wavelengths: ArrayLike,
    *,
    samples: int = WALKS,
    seed: int = 0,
    max_order: int | None = None,
    progress: Progress = None,
) -> TownGlow | None:
    """Solve for the light of a scene's towns; None where there is none that reaches the observer's sky.

    Parameters
    ----------
    scene : Scene
    wavelengths : array_like, shape (wavelength,)
        Vacuum wavelengths [nm], rising; each stands for its cell, as everywhere.
    samples : int
        Walks for each node of the distance that matters most, to begin with; up to 4 times as many where they find
        the light to worse than 6 %.
    seed : int
        Same seed, same numbers.
    max_order : int, optional
        Leave out light that was scattered or reflected more often than this.
    progress : callable, optional
        Called with the finished share.

    Returns
    -------
    TownGlow
        Radiance over the observer's sky, with an error: a standard error of the walks, to which a part in 200 of the
        light is added for what tables and splines miss.

    Raises
    ------
    DomainError
        For ground with a map.

    Examples
    --------
    Ten kilometres from a town of 50000, by night: its light is brightest low above it.

    >>> import numpy as np
    >>> import skyscatter
    >>> from skyscatter.solvers.towns import town_glow
    >>> from skyscatter.surfaces import Town
    >>> town = Town.of_people(50_000, distance="10 km", azimuth_deg=90, spectrum="led-4000k")
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=-30)
    >>> scene = scene.model_copy(update={"towns": (town,)})
    >>> glow = town_glow(scene, [450, 550], samples=32)
    >>> low, zenith = glow.at(np.array([[0.98, 0.0, 0.199], [0.0, 0.0, 1.0]]))[0][:, 1]
    >>> bool(low > 5 * zenith)
    True
    """
    return _solved(scene, check_wavelengths(wavelengths), samples, seed, max_order, progress)


@steady_algebra()
def _solved(
    scene: Scene, wavelengths: Array, samples: int, seed: int, max_order: int | None, progress: Progress
) -> TownGlow | None:
    check_towns(scene)
    expect("towns")
    groups: dict[bytes, list[Lamps]] = {}
    for lamps in lamps_of(scene, wavelengths):
        groups.setdefault(lamps.lobe.tobytes(), []).append(lamps)
    if not groups:
        return None
    count = sum(distance_nodes(*_amounts(some)).size for some in groups.values())
    light_waves: Any = 0.0
    error_waves: Any = 0.0
    done = 0
    for some in groups.values():
        light = Lamplight(scene, wavelengths, some[0].lobe, seed, max_order or MOST_ORDERS)
        rings = rings_of(some)
        walked = Walked(light, rings, samples)
        for ring in rings:
            turned = np.fft.rfft(ring.power, axis=0)
            often, relative = walked.at(ring.distance)
            light_waves += np.fft.rfft(cell_means(light.table(ring.distance) + often, True), axis=1) * turned
            # Rings share walks, and then they err together: their errors add up in size, which bounds all others.
            error_waves += np.fft.rfft(cell_means(often * relative, False), axis=1) * turned
            done += 1
            if progress is not None:
                progress(min(done / count, 1.0))
    total, error = (np.maximum(np.fft.irfft(waves, n=TURNS, axis=1), 0.0) for waves in (light_waves, error_waves))
    total = np.maximum(total, 1e-12 * np.maximum(np.max(total, axis=(0, 1)), 1e-280))
    return TownGlow(light.horizon, np.log(total), error / total + JOINED)
