"""Boxes at the places where bounds of densities go wrong: on, at and across axes, planes, tips and edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyscatter.media.space import SpatialField

Array = NDArray[np.float64]

#: Boxes a field, and points in each.
BOXES, POINTS = 4000, 24
#: Rounding of densities, relative to the largest number near them: grids and particles are kept in single precision.
ROUNDING = 2e-7


def lengths_of(value: Any) -> list[float]:
    """Every number that stands in a plain record: radii, widths and distances are among them."""
    if isinstance(value, dict):
        return [x for part in value.values() for x in lengths_of(part)]
    if isinstance(value, (list, tuple)):
        return [x for part in value for x in lengths_of(part)]
    return [float(value)] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def special_coordinates(field: SpatialField, count: int = 40) -> Array:
    """Coordinates (axis, n) [m] along each axis of the model: middles, and all lengths of the field from there."""
    low, high = field.bounds
    plain = field.model_dump(exclude={"values", "positions", "masses", "smoothing_lengths"}, exclude_none=True)
    lengths = np.unique(np.abs([0.0, *lengths_of(plain)]))
    lengths = lengths[lengths <= 2 * (high - low).max()]
    if len(lengths) > count:  # a table, of whose numbers some do
        lengths = lengths[np.linspace(0, len(lengths) - 1, count).astype(int)]
    middles = np.array([field.centre, 0.5 * (low + high), np.zeros(3), getattr(field, "position", (0.0,) * 3)])
    signed = np.concatenate([-lengths, lengths])
    found = (middles[:, :, None] + signed).transpose(1, 0, 2).reshape(3, -1)
    return np.concatenate([low[:, None], high[:, None], found], axis=1)


def boxes_at(special: Array, low: Array, high: Array, count: int, random: np.random.Generator) -> tuple[Array, Array]:
    """Lowest and highest corners (count, 3) [m] of boxes: both sides free, snapped, thin, flat, tiny or huge."""
    size = high - low
    chosen = np.stack([random.choice(row, (2, count)) for row in special], axis=-1)
    free = low + size * random.uniform(-0.2, 1.2, (2, count, 3))
    first = np.where(random.random((count, 3)) < 0.6, chosen[0], free[0])
    reach = size.max() * np.array([0.0, 1e-13, 1e-9, 1e-4, 0.03, 0.3, 30.0])
    side = random.choice(reach, (count, 3)) * random.choice([-1.0, 1.0], (count, 3))
    # Boxes of one length of side, as grids of bounds are made of, are a third of all.
    side = np.where(random.random((count, 1)) < 0.3, side[:, :1] * random.choice([-1.0, 1.0], (count, 3)), side)
    kind = random.random((count, 3))
    second = np.where(kind < 0.35, chosen[1], np.where(kind < 0.55, free[1], first + side))
    # Every twentieth box is far away.
    away = np.where(random.random((count, 1)) < 0.05, 1e3 * size.max() * random.uniform(-1, 1, (count, 3)), 0.0)
    return np.minimum(first, second) + away, np.maximum(first, second) + away


def points_in(low: Array, high: Array, special: Array, random: np.random.Generator) -> Array:
    """Points (box, n, 3) of boxes, many of them on faces, edges and special places within."""
    share = random.choice([0.0, 0.5, 1.0, np.nan], (len(low), POINTS, 3), p=[0.15, 0.1, 0.15, 0.6])
    share = np.where(np.isnan(share), random.random(share.shape), share)
    points = low[:, None] + share * (high - low)[:, None]
    places = np.stack([random.choice(row, share.shape[:2]) for row in special], axis=-1)
    points = np.where(random.random(share.shape) < 0.3, places, points)
    return np.clip(points, low[:, None], high[:, None])


def assert_bounds_hold(field: SpatialField, special: Array | None = None, boxes: int = BOXES, seed: int = 31) -> None:
    """Fail if a density in a box lies outside the bounds that its field gives for it."""
    random = np.random.default_rng(seed)
    low, high = field.bounds
    far = 1e4 * float(np.min(high - low))
    low, high = np.maximum(low, -far), np.minimum(high, far)  # fields "without sides" have them very far
    special = special_coordinates(field) if special is None else special
    a, b = boxes_at(special, low, high, boxes, random)
    lowest, highest = field.extremes(a, b)
    points = points_in(a, b, special, random)
    values = field.density(points)
    assert (values > 0).any(axis=1).sum() > boxes // 100, "hardly a box meets the field"
    slack = ROUNDING * highest[:, None]
    above, below = values > highest[:, None] + slack, values < lowest[:, None] - slack
    bad = np.flatnonzero((above | below).any(axis=1))
    n = bad[0] if len(bad) else 0
    k = np.flatnonzero((above | below)[n])[0] if len(bad) else 0
    assert not len(bad), (
        f"{type(field).__name__}: {len(bad)} of {boxes} boxes, such as {a[n]!r} to {b[n]!r}: {values[n, k]:g} at "
        f"{points[n, k]!r} where bounds are {lowest[n]:g} and {highest[n]:g}"
    )
