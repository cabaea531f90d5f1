"""Walks that serve all pixels of a picture of mapped ground at once.

Air is the same over every pixel, so a walk from one pixel, moved to another, is a walk from there with the same
chances; only the albedos that it meets on the ground differ.  So the walks of `skyscatter.kernels.path` are
drawn over a uniform ground, and the light of each is counted for every pixel, multiplied at every reflection by the
albedo of the cell that is met from there over that of the uniform ground.

Light that meets the map but once is gathered by the offset of the cell from the pixel, and spread over the picture
afterwards.  Only what is reflected twice or more is counted pixel by pixel; that is little light and most of the work,
so that one walk in a few does it for all.
"""

# Decorated by numba, which is untyped; the arrays are checked by the callers.
# mypy: allow-untyped-defs, allow-untyped-decorators

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.jit import entry, kernel, merged
from skyscatter.kernels.lookup import trace_line
from skyscatter.kernels.path import (
    CAMERA_STRATA,
    FIRST_ROULETTE,
    GROUND,
    GUIDED_LEGS,
    LEG_STRATA,
    NOTHING,
    choose,
    depart,
    draw,
    leave_ground,
    lift_to_ground,
    make_leg,
    make_walk,
    march,
    pick_sun,
    prepare_leg,
    rebalance,
    scatter,
    survives,
)
from skyscatter.kernels.polar import arriving, begin, depolarise
from skyscatter.kernels.random import EVEN_DIMENSIONS, even_point, start_stream, uniform
from skyscatter.kernels.work import make_work

#: Share of the walks that count light which meets the ground more than once.
HEAVY = 0.2


@by_address
class Landscape(NamedTuple):
    """The map and where the picture lies in it."""

    rows: np.ndarray  #: (y, x) uint8 row of `ratio` for every cell of the map
    ratio: np.ndarray  #: (row, wavelength) albedo over that of the ground of the walks; row 0 is outside the map
    first: np.ndarray  #: (2,) int64 row and column of the cell that the picture's first pixel shows
    cell: float  #: side of a cell [m]


@by_address
class Sums(NamedTuple):
    """What the walks of a batch bring."""

    air: np.ndarray  #: (wavelength,) light that meets no ground
    offset: np.ndarray  #: (y, x, wavelength) light that meets ground once, by the cells between pixel and cell met
    outside: np.ndarray  #: (wavelength,) the same from beyond all offsets
    picture: np.ndarray  #: (y, x, wavelength) light that meets ground more than once
    weight: np.ndarray  #: (y, x, wavelength) product of the ratios that the walk has met so far


@kernel
def offset_of(scene, land, walk, distance, target, cells):
    """Rows and columns from the pixel's cell to that of a point ahead on the walk's line, into `cells`."""
    x, d = walk.position, walk.direction
    cells[0] = math.floor(0.5 - (x[1] + distance * d[1] - target[1]) / land.cell)
    cells[1] = math.floor(0.5 + (x[0] + distance * d[0] - target[0]) / land.cell)


@kernel
def row_at(land, y, x):
    """Row of the albedo of a cell of the map; 0 outside."""
    inside = 0 <= y < land.rows.shape[0] and 0 <= x < land.rows.shape[1]
    return int(land.rows[y, x]) if inside else 0


@kernel
def darken(land, cells, bounces, weight):
    """Multiply the walk's weight in every pixel by the ratio of the cell that is met from there."""
    for y in range(weight.shape[0]):
        for x in range(weight.shape[1]):
            row = row_at(land, land.first[0] + y + cells[0], land.first[1] + x + cells[1])
            for i in range(weight.shape[2]):
                before = weight[y, x, i] if bounces > 0 else 1.0
                weight[y, x, i] = before * land.ratio[row, i]


@kernel
def count_everywhere(land, cells, air, ground, sums):
    """Add a leg's light to all pixels: what the air scatters into it, and what the cell at its end reflects."""
    weight, picture = sums.weight, sums.picture
    for y in range(weight.shape[0]):
        for x in range(weight.shape[1]):
            row = row_at(land, land.first[0] + y + cells[0], land.first[1] + x + cells[1])
            for i in range(weight.shape[2]):
                picture[y, x, i] += weight[y, x, i] * (air[i] + ground[i] * land.ratio[row, i]) / HEAVY


@kernel
def count_by_offset(cells, light, sums):
    """Add light that meets the cell at that offset, and no other, to the sums that are the same for all pixels."""
    y = cells[0] + sums.offset.shape[0] // 2
    x = cells[1] + sums.offset.shape[1] // 2
    inside = 0 <= y < sums.offset.shape[0] and 0 <= x < sums.offset.shape[1]
    for i in range(light.size):
        if inside:
            sums.offset[y, x, i] += light[i]
        else:
            sums.outside[i] += light[i]


@kernel
def count(land, bounces, heavy, cells, met, air, ground, sums):
    """Add a leg's light where it belongs by how often the walk has met ground, `met` being where it did first."""
    if bounces == 0:
        for i in range(air.size):
            sums.air[i] += air[i]
        count_by_offset(cells, ground, sums)
        return
    if bounces == 1:
        count_by_offset(met, air, sums)
        for i in range(air.size):
            air[i] = 0.0
    if heavy:
        count_everywhere(land, cells, air, ground, sums)


@kernel
def part_light(scene, line, node, leg, work, walk, polar, air, ground):
    """Light of a marched leg, by what sent it: air scattered, `ground` reflected sunlight; both (wavelength,)."""
    optics, s = scene.optics, scene.optics.sun_direction[node]
    far, x_sun = line.leave - line.start, 0.0
    for k in range(3):
        x_sun += (walk.position[k] + far * walk.direction[k]) * s[k]
    # `work.sun` is the transmittance from the leg's end to the Sun, zero in the shadow; see `_march_end`.
    scale = max(x_sun, 0.0) / (scene.columns.radius * math.pi * optics.sun_chance[node])
    for i in range(air.size):
        reflected = leg.through[i] * leg.albedo[i] * work.sun[i] * scale * optics.sun_irradiance[node, i]
        reflected = reflected if line.hits_ground else 0.0
        ground[i] = walk.value[i] * arriving(polar, 0, i, reflected, 0.0)
        air[i] = walk.value[i] * arriving(polar, 0, i, walk.gain[i] - reflected, 1.0)


@merged
def wander(
    scene, plain, land, target, line, camera, max_order, leg, work, camera_work, walk, polar, parts, cells, sums
):  # fmt: skip
    """Follow a walk from the camera to its end; as in `path.wander`, with the light counted for every pixel."""
    air, ground, met = parts[0], parts[1], cells[2:]
    bounces = 0
    heavy = uniform(walk.state) < HEAVY
    hero = min(int(walk.even[0] * walk.value.size), walk.value.size - 1)
    for i in range(walk.value.size):
        walk.value[i], walk.chance[i] = 1.0, 1.0
    found = choose(scene, line, camera, hero, walk.even[1], GUIDED_LEGS > 0, camera_work, walk)
    x, d = walk.position, walk.direction
    for order in range(1, max_order):
        if found == NOTHING:
            return
        u, v = draw(walk, order, 0), draw(walk, order, 1)
        if found == GROUND:
            lift_to_ground(scene, walk)
            offset_of(scene, land, walk, 0.0, target, cells)
            if heavy:
                darken(land, cells, bounces, sums.weight)
            elif bounces > 0:
                return
            bounces += 1
            if bounces == 1:
                met[0], met[1] = cells[0], cells[1]
            leave_ground(scene, hero, u, v, work, walk)
            depolarise(polar, d)
        else:
            scatter(scene, hero, u, v, order <= GUIDED_LEGS, work, walk, polar)
        if not rebalance(walk):
            return
        if order == 1:
            walk.worth[0] = 1.0
        elif order >= FIRST_ROULETTE and not survives(walk):
            return
        line = trace_line(scene.columns, x[0], x[1], x[2], d[0], d[1], d[2])
        prepare_leg(scene, plain, line, walk, leg, work)
        guided = order <= GUIDED_LEGS
        node = pick_sun(scene.optics, draw(walk, order, 2))
        march(scene, line, node, draw(walk, order, 3), guided, leg, work, walk, polar)
        part_light(scene, line, node, leg, work, walk, polar, air, ground)
        offset_of(scene, land, walk, line.leave - line.start, target, cells)
        count(land, bounces, heavy, cells, met, air, ground, sums)
        found = choose(scene, line, leg, hero, draw(walk, order, 4), guided, work, walk)


@entry
def simulate_batch(scene, plain, land, target, origin, direction, seed, batch, walks, max_order, scratch, polar, sums):
    """Light of the second and higher orders in all pixels of a picture, by one batch of walks.

    Parameters
    ----------
    scene : SceneTable
    plain : GroundTable
        The uniform ground of the walks; its albedo is above zero wherever one of the map is.
    land : Landscape
    target : (3,)
        Point on the ground that stands for the middle of every pixel [m].
    origin, direction : (3,)
        Of the sensor [m], and from it to the target.
    seed, batch, walks, max_order : int
    scratch : tuple
        Made by `make_simulate_scratch`.
    polar : Polar or None
        Scratch for polarised light.
    sums : Sums, output
        Sums over the walks [W m-2 sr-1 nm-1].
    """
    work, camera_work, camera, leg, walk, parts, cells, shift = scratch
    line = trace_line(scene.columns, origin[0], origin[1], origin[2], direction[0], direction[1], direction[2])
    depart(walk, origin, direction)
    prepare_leg(scene, plain, line, walk, camera, camera_work)
    begin(polar, 0, 0)
    march(scene, line, np.int64(0), 0.5, GUIDED_LEGS > 0, camera, camera_work, walk, polar)
    start_stream(walk.state, seed, batch, -1)
    for k in range(EVEN_DIMENSIONS):
        shift[k] = np.uint32(uniform(walk.state) * 4294967296.0)
    for n in range(walks):
        start_stream(walk.state, seed, batch, n)
        even_point(shift, n, walk.even)
        depart(walk, origin, direction)
        begin(polar, 0, 0)
        wander(
            scene, plain, land, target, line, camera, max_order, leg, work, camera_work, walk, polar, parts, cells, sums
        )  # fmt: skip


def make_simulate_scratch(components: int, wavelengths: int) -> tuple[Any, ...]:
    """Scratch arrays of `simulate_batch`; a thread needs its own."""
    return (
        make_work(components, wavelengths),
        make_work(components, wavelengths),
        make_leg(CAMERA_STRATA, wavelengths),
        make_leg(LEG_STRATA, wavelengths),
        make_walk(wavelengths),
        np.zeros((2, wavelengths)),
        np.zeros(4, np.int64),
        np.zeros(EVEN_DIMENSIONS, np.uint32),
    )
