"""The base that every field of three dimensions inherits, and the register that notices a missing one."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from bases import complaint
from field_bounds import assert_bounds_hold
from numpy.typing import NDArray
from pydantic import TypeAdapter
from scipy.spatial.transform import Rotation

from skyscatter.media.operations import AnySpatialField
from skyscatter.media.space import SpatialField

Array = NDArray[np.float64]
#: Class of the package -> class that tests it.
SPACE_TESTS: dict[type, type] = {}


def own_frame(field: Any, points: Array) -> Array:
    """Points in the frame in which a shape's definition is written."""
    z = np.array([0.0, 0.0, 1.0])
    axis = np.array(field.axis) / np.linalg.norm(field.axis)
    normal, angle = np.cross(z, axis), np.arccos(np.clip(axis[2], -1, 1))
    if axis[2] == -1:
        normal = np.array([1.0, 0.0, 0.0])  # any way is as short as another; this one is documented
    tilt = Rotation.from_rotvec(angle * normal / max(np.linalg.norm(normal), 1e-300))
    turn = Rotation.from_euler("z", field.turn_deg, degrees=True)
    return (tilt * turn).inv().apply(points - np.array(field.position)) / np.array(field.axes)


def reference_columns(field: SpatialField, start: Array, end: Array) -> Array:
    """Columns by adaptive quadrature of the density, to 1e-11 of each, for all lines at once.

    Every panel is integrated by the Clenshaw-Curtis rule of 17 points, whole and as two halves, and halved until both
    agree or, at a jump, until it is too short to matter.  The rule has points at the ends (just within them, for edges
    are likely there), so that no jump hides between an end and the next point.
    """
    low, high = field.bounds
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.sort([(low - start) / (end - start), (high - start) / (end - start)], axis=0)
    enter, leave = np.nanmax(walls[0], axis=1).clip(0), np.nanmin(walls[1], axis=1).clip(None, 1)
    leave = np.maximum(enter, leave)
    angle, even = np.pi * np.arange(17) / 16, 2 * np.arange(1, 9)
    share = np.where(even == 16, 1.0, 2.0) / (even**2 - 1)
    weights = np.where((angle == 0) | (angle == np.pi), 1, 2) / 16 * (1 - np.cos(np.outer(angle, even)) @ share)
    nodes = np.cos(angle) * (1 - 1e-13)
    origin, along = start + enter[:, None] * (end - start), (leave - enter)[:, None] * (end - start)

    def integrals(line: Array, a: Array, width: Array) -> Array:
        t = a[:, None] + 0.5 * width[:, None] * (1 + nodes)
        return 0.5 * width * (field.density(origin[line][:, None] + t[..., None] * along[line][:, None]) @ weights)

    # Only where the field can be, and there in pieces, so that nothing narrow is missed.
    line, a = (x.ravel() for x in np.meshgrid(np.arange(len(start)), np.arange(64) / 64, indexing="ij"))
    width, total = np.full(a.shape, 1 / 64), np.zeros(len(start))
    whole = integrals(line, a, width)
    while line.size:
        half = 0.5 * width
        first, second = integrals(line, a, half), integrals(line, a + half, half)
        size = total + np.bincount(line, first + second, len(start))
        done = (abs(first + second - whole) <= 1e-13 * size[line]) | (half < 1e-16)
        total += np.bincount(line[done], (first + second)[done], len(start))
        line, a = np.tile(line[~done], 2), np.concatenate([a[~done], (a + half)[~done]])
        width, whole = np.tile(half[~done], 2), np.concatenate([first[~done], second[~done]])
    return total * np.linalg.norm(along, axis=1)


class SpatialFieldBase:
    """What holds for every field of three dimensions."""

    field_class: ClassVar[type[SpatialField]]
    examples: ClassVar[tuple[SpatialField, ...]]
    #: Keyword arguments that are refused, and what the one line says.
    refused: ClassVar[tuple[tuple[dict[str, Any], str], ...]] = ()
    #: Relative tolerance of columns: 1e-9 for closed forms, the quadrature's own 1e-6 elsewhere.
    tolerance: ClassVar[float] = 1e-9
    #: Change of the density over a small box, over the box's size in units of the field's.
    bound_slack: ClassVar[float] = 100.0

    def __init_subclass__(cls) -> None:
        SPACE_TESTS[cls.field_class] = cls

    def expected(self, field: Any, points: Array) -> Array:
        """The density as its definition says, written once more."""
        raise NotImplementedError

    def size(self, field: SpatialField) -> Array:
        """Sides (3,) [m] of what is looked at."""
        return np.subtract(*field.bounds[::-1])

    def sample(self, field: SpatialField, count: int, reach: float = 0.6, seed: int = 1) -> Array:
        """Points (count, 3) around the middle, up to `reach` of the field's sides away, many of them near it."""
        random = np.random.default_rng(seed)
        low, high = field.bounds
        spread = random.uniform(-1, 1, (count, 3)) * reach * np.where(random.random((count, 1)) < 0.3, 0.1, 1.0)
        return 0.5 * (low + high) + spread * self.size(field)

    def lines(self, field: SpatialField) -> tuple[Array, Array]:
        """Segments from outside, from inside, inside, grazing, along an axis, and from far away."""
        low, high = field.bounds
        middle, size = 0.5 * (low + high), self.size(field)
        candidates = self.sample(field, 2000, 0.5, 3)
        p, q = candidates[field.density(candidates) > 0][:16].reshape(2, 8, 3)
        start, end = p.copy(), q.copy()
        start[:3], end[:3] = p[:3] - 2 * (q[:3] - p[:3]), q[:3] + 2 * (q[:3] - p[:3])  # through, from outside
        end[3] = p[3] + 3 * (q[3] - p[3])  # from inside to outside
        end[4] = p[4] + 0.02 * (q[4] - p[4])  # short
        # Grazing: just within the widest place.
        graze = np.array([[-1, 0.498, 0], [1, 0.498, 0]])
        start[5], end[5] = middle + size * graze
        start[6], end[6] = p[6] + [0, 0, -size[2]], p[6] + [0, 0, size[2]]
        start[7] = p[7] + 1e4 * size.max() * np.array([0.48, -0.6, 0.64])  # an observer far away
        end[7] = 2 * p[7] - start[7]
        return start, end

    def test_density_is_what_its_definition_says(self) -> None:
        for field in self.examples:
            points = self.sample(field, 2000)
            expected = self.expected(field, points)
            assert (expected > 0).sum() > 20
            np.testing.assert_allclose(field.density(points), expected, rtol=2e-7, atol=1e-11)

    def test_columns_against_adaptive_quadrature(self) -> None:
        for field in self.examples:
            start, end = self.lines(field)
            expected = reference_columns(field, start, end)
            assert (expected > 0).sum() >= 7
            # The walk from far away knows its distance to 1e-16 of 1e4 sizes only.
            floor = 1e-11 * expected.max()
            np.testing.assert_allclose(field.column(start, end), expected, rtol=self.tolerance, atol=floor)

    def test_columns_add_up(self) -> None:
        for field in self.examples:
            start, end = self.lines(field)
            middle = start + 0.43 * (end - start)
            parts = field.column(start, middle) + field.column(middle, end)
            whole = field.column(start, end)
            floor = 1e-11 * whole.max()
            np.testing.assert_allclose(parts, whole, rtol=2 * self.tolerance, atol=floor)

    def test_nothing_outside_the_box(self) -> None:
        for field in self.examples:
            low, high = field.bounds
            points = self.sample(field, 2000, 0.8)
            outside = ((points < low) | (points > high)).any(axis=1)
            assert outside.sum() > 500
            assert (field.density(points[outside]) == 0).all()

    def test_extremes_hold_the_values(self) -> None:
        random = np.random.default_rng(5)
        for field in self.examples:
            corner = self.sample(field, 300, 0.7, 6)
            sides = self.size(field) * random.uniform(0.01, 0.5, (300, 3)) * random.choice([0.05, 1.0], (300, 1))
            lowest, highest = field.extremes(corner, corner + sides)
            assert lowest.shape == highest.shape == (300,)
            values = field.density(corner[:, None] + sides[:, None] * random.random((300, 30, 3)))
            assert (lowest >= 0).all()
            assert (values >= lowest[:, None] * (1 - 1e-7)).all()
            assert (values <= highest[:, None] * (1 + 1e-7)).all()

    def test_bounds_hold_on_axes_planes_tips_and_edges(self) -> None:
        for field in self.examples:
            assert_bounds_hold(field)

    def test_extremes_close_in_on_the_value(self) -> None:
        for field in self.examples:
            points, step = self.sample(field, 300), 1e-6 * self.size(field)
            lowest, highest = field.extremes(points - step, points + step)
            # Edges aside, which few boxes of that size meet.
            assert np.quantile(highest - lowest, 0.9) < 1e-6 * self.bound_slack

    def test_reference_column_goes_through_the_centre(self) -> None:
        for field in self.examples:
            x, y, _ = field.centre
            low, high = field.bounds
            expected = reference_columns(field, np.array([[x, y, low[2]]]), np.array([[x, y, high[2]]]))[0]
            assert expected > 0
            assert field.reference_column() == pytest.approx(expected, rel=self.tolerance)

    def test_says_the_same_when_read_back(self) -> None:
        adapter: TypeAdapter[Any] = TypeAdapter(AnySpatialField)
        for field in self.examples:
            back = adapter.validate_json(adapter.dump_json(field, exclude_none=True))
            assert type(back) is self.field_class
            assert back == field

    def test_bad_values_are_refused_in_one_line(self) -> None:
        for given, message in self.refused:
            assert message in complaint(lambda given=given: self.field_class(**given))
