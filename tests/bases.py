"""Test bases that every density field and every phase function inherits, and the registers that notice a missing one.

A subclass names its class and some examples; the register maps each class of the package to the class that tests it.
"""

from __future__ import annotations

import itertools
import math
import types
from collections.abc import Callable
from typing import Any, ClassVar, get_args

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad
from scipy.stats import chi2

from skyscatter.errors import SkyscatterError
from skyscatter.kernels.columns import density as kernel_density
from skyscatter.kernels.columns import exact_columns
from skyscatter.kernels.columns import vertical_column as kernel_vertical_column
from skyscatter.kernels.fastexp import fast_exp
from skyscatter.kernels.lookup import ColumnTable, build_column_table, densities, outward_columns
from skyscatter.kernels.optics import phase_at, sample_cosine
from skyscatter.media.fields import AnyField, DensityField
from skyscatter.media.medium import Component, Medium
from skyscatter.media.tables import pack_rows
from skyscatter.optics.base import PhaseFunction
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import AnyPhase, matrix_excess
from skyscatter.problems import problem_lines
from skyscatter.solvers.compile import compile_scene, matrix_tables, medium_optics

Array = NDArray[np.float64]
EARTH = 6371e3

#: Class of the package -> class that tests it.
FIELD_TESTS: dict[type, type] = {}
PHASE_TESTS: dict[type, type] = {}


def members(union: Any) -> set[type]:
    """Classes of an annotated union such as `AnyField`."""
    return set(get_args(get_args(union)[0]))


def complaint(build: Callable[[], Any]) -> str:
    """The one line that a user reads when `build` is refused."""
    with pytest.raises((ValidationError, SkyscatterError)) as caught:
        build()
    error = caught.value
    message = problem_lines(error)[0] if isinstance(error, ValidationError) else str(error)
    assert "\n" not in message
    return message


def plain(kernel: Any, done: dict[str, Any] | None = None) -> Any:
    """The plain Python twin of a kernel, which calls nothing but plain twins.

    ``kernel.py_func`` alone would call compiled inner kernels, which Python must not do: they have no wrappers.
    """
    done = {} if done is None else done
    twin = types.FunctionType(kernel.py_func.__code__, done.setdefault(kernel.py_func.__module__, {}))
    names = done[kernel.py_func.__module__]
    for name, value in kernel.py_func.__globals__.items():
        if name not in names:
            names[name] = value
            if value is fast_exp:
                names[name] = math.exp  # made of bit operations that Python does not have
            elif hasattr(value, "py_func"):
                names[name] = plain(value, done)
    return twin


# Inner kernels cannot be called from Python: these loops call them.


@njit
def table_columns(table: ColumnTable, h: Array, mu: Array, out: Array) -> None:
    """`outward_columns` for many points; out is (point, field)."""
    for i in range(h.size):
        outward_columns(table, h[i], mu[i], out[i])


@njit
def table_densities(table: ColumnTable, h: Array, out: Array) -> None:
    """`densities` for many altitudes; out is (point, field)."""
    for i in range(h.size):
        densities(table, h[i], out[i])


@njit
def field_values(fields: Any, f: int, h: Array, out: Array) -> None:
    """Density and vertical column of one field as the kernels see them; out is (point, 2)."""
    for i in range(h.size):
        out[i, 0] = kernel_density(fields, f, h[i])
        out[i, 1] = kernel_vertical_column(fields, f, h[i])


@njit
def kernel_phases(phase: Array, cosines: Array, out: Array) -> None:
    """`phase_at` for many angles; out is (angle, component, wavelength)."""
    for i in range(cosines.size):
        phase_at(phase, cosines[i], out[i])


@njit
def kernel_samples(optics: Any, wavelength: int, u: Array, out: Array) -> None:
    """`sample_cosine` of component 0 for many uniform numbers."""
    for i in range(u.size):
        out[i] = sample_cosine(optics, 0, wavelength, u[i])


def plain_column(density: Callable[[float], float], planet: float, start: Array, end: Array, cuts: Array) -> float:
    """Column of a density between two points by scipy's adaptive quadrature, in plain vectors.

    The path is split at its point nearest to the planet's centre and wherever it passes one of the altitudes `cuts`.
    """
    length = float(np.linalg.norm(end - start))
    direction = (end - start) / length
    nearest = -float(start @ direction)
    p = float(np.linalg.norm(np.cross(start, direction)))
    above = planet + cuts[planet + cuts > p]
    half = np.sqrt((above - p) * (above + p))
    edges = np.concatenate([[0.0, length, nearest], nearest - half, nearest + half])
    edges = np.unique(np.clip(edges, 0.0, length))

    def along(s: float) -> float:
        # r - R from the nearest point: the difference of two radii would cost 1e-9 m, which matters for thin shells.
        t = s - nearest
        return density(p - planet + t * t / (p + np.hypot(p, t)))

    return sum(quad(along, a, b, epsabs=0.0, epsrel=1e-11, limit=200)[0] for a, b in itertools.pairwise(edges))


class DensityFieldBase:
    """What every density field must pass."""

    field_class: ClassVar[type[DensityField]]
    #: Fields to try.
    examples: ClassVar[tuple[DensityField, ...]]
    #: Arguments that are refused, and what the message must name.
    refused: ClassVar[tuple[tuple[dict[str, Any], str], ...]]
    #: Largest error of tabulated columns, relative to the greatest column through the field.
    table_error: ClassVar[float] = 1e-4

    #: Largest error of the tabulated density, relative to its maximum.
    density_error: ClassVar[float] = 2e-5

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        FIELD_TESTS[cls.field_class] = cls

    def expected(self, field: Any, h: float) -> float:
        """Density by its definition, for 0 <= h < top."""
        raise NotImplementedError

    def cuts(self, field: DensityField) -> Array:
        """Altitudes between which a quadrature finds the field smooth and not too steep."""
        row = field.row()
        return np.unique(np.concatenate([np.linspace(0.0, row.top, 17), row.altitudes, row.breaks]))

    def cut_density(self, field: DensityField) -> Callable[[float], float]:
        top = field.top_altitude
        return lambda h: self.expected(field, max(h, 0.0)) if h < top else 0.0

    def test_density_is_the_stated_formula(self) -> None:
        for field in self.examples:
            h = np.linspace(0.0, field.top_altitude, 301)[:-1]
            expected = [self.expected(field, x) for x in h]
            # The same formula in another order of operations; steep exponents lose a few digits.
            np.testing.assert_allclose(field.density(h), expected, rtol=1e-11, atol=1e-14)

    def test_density_is_finite_never_negative_and_ends_at_the_top(self) -> None:
        for field in self.examples:
            h = np.concatenate([[0.0], np.geomspace(1e-3, field.top_altitude * 0.999999, 400)])
            values = field.density(h)
            assert np.all(np.isfinite(values))
            assert values.min() >= 0
            assert values.max() > 0
            above = field.top_altitude * np.array([1.0, 1.0 + 1e-12, 2.0, 1e3])
            assert np.all(field.density(above) == 0)
            assert np.all(field.vertical_column(above) == 0)

    def test_shape_follows_the_altitudes(self) -> None:
        for field in self.examples[:1]:
            assert field.density(0.0).shape == ()
            assert field.vertical_column(0.0).shape == ()
            assert field.density([[0.0, 1.0, 2.0]]).shape == (1, 3)

    def test_vertical_column_against_quadrature(self) -> None:
        for field in self.examples:
            up = np.array([0.0, 0.0, 1.0])
            whole = float(field.vertical_column(0.0))
            for share in (0.0, 0.03, 0.3, 0.6, 0.95):
                h = share * field.top_altitude
                start, end = (EARTH + h) * up, (EARTH + field.top_altitude) * up
                expected = plain_column(self.cut_density(field), EARTH, start, end, self.cuts(field))
                # Closed form; the quadrature is at its rounding: 1e-9 m of altitude.
                np.testing.assert_allclose(field.vertical_column(h), expected, rtol=1e-9, atol=1e-13 * whole)

    def test_columns_along_segments_against_quadrature(self) -> None:
        """Up, down, through the lowest point, from outside, short and long."""
        rng = np.random.default_rng(20)
        for field in self.examples:
            top = field.top_altitude
            fields = pack_rows([field.row()], EARTH)
            whole = float(field.vertical_column(0.0))
            for _ in range(25):
                lowest = top * rng.random() ** 2
                p = EARTH + lowest
                reach = np.sqrt((EARTH + top - p) * (EARTH + top + p))
                t0, t1 = np.sort(reach * rng.uniform(-1.3, 1.3, 2) * rng.choice([1.0, 0.1, 0.01]))
                r, mu = np.hypot(p, t0), t0 / np.hypot(p, t0)
                out = np.empty((1, 1))
                exact_columns(fields, np.array([r]), np.array([mu]), np.array([t1 - t0]), out)
                start, end = np.array([t0, 0.0, p]), np.array([t1, 0.0, p])
                expected = plain_column(self.cut_density(field), EARTH, start, end, self.cuts(field))
                # The 1e-6; parts of a layer that weigh less than 1e-12 of it are nobody's concern.
                np.testing.assert_allclose(out[0, 0], expected, rtol=1e-6, atol=1e-12 * whole)

    def test_tabulated_columns(self) -> None:
        """The lookup table against exact columns, half of them under flat angles."""
        for field in self.examples:
            fields = pack_rows([field.row()], EARTH)
            table = build_column_table(fields)
            rng = np.random.default_rng(4)
            h = np.concatenate([np.zeros(500), table.top * rng.random(6000) ** 2])
            mu = np.where(rng.random(h.size) < 0.5, rng.random(h.size) ** 2, 0.05 * rng.random(h.size))
            out, exact = np.empty((h.size, 1)), np.empty((h.size, 1))
            table_columns(table, h, mu, out)
            exact_columns(fields, EARTH + h, mu, np.full(h.size, np.inf), exact)
            error = np.abs(out - exact)
            worst = error.argmax()
            assert error.max() < self.table_error * exact.max(), (field, error.max() / exact.max(), h[worst], mu[worst])
            # Linear interpolation between 256 angles: no more than 4.5e-5 from the ground, where columns are greatest,
            # and a few 1e-6 as a rule.
            np.testing.assert_allclose(out[:500], exact[:500], rtol=5e-5)
            weighty = exact > 0.1 * float(field.vertical_column(0.0))
            assert np.median(error[weighty] / exact[weighty]) < 1e-5

    def test_tabulated_density(self) -> None:
        for field in self.examples:
            table = build_column_table(pack_rows([field.row()], EARTH))
            h = table.top * np.random.default_rng(5).random(4000) ** 2
            out = np.empty((h.size, 1))
            table_densities(table, h, out)
            expected = field.density(h)
            # Cubics on cells of a few hundred metres and, for profiles, on cells that may hold one of their nodes.
            error = np.max(np.abs(out[:, 0] - expected)) / expected.max()
            assert error < self.density_error, (field, error)

    def test_compiled_and_plain_twins_agree(self) -> None:
        for field in self.examples:
            fields = pack_rows([field.row()], EARTH)
            h = np.array([0.0, 0.1, 0.5, 0.9]) * field.top_altitude
            out = np.empty((h.size, 2))
            field_values(fields, 0, h, out)
            twins = plain(kernel_density), plain(kernel_vertical_column)
            np.testing.assert_allclose(
                out, [[twin(fields, 0, x) for twin in twins] for x in h], rtol=1e-13, atol=1e-300
            )  # rounding of exp and erfc

    def test_written_and_read_back(self) -> None:
        for field in self.examples:
            again = TypeAdapter(AnyField).validate_python(field.model_dump(mode="json", exclude_none=True))
            assert again == field
            assert type(again) is self.field_class
            assert hash(again) == hash(field)

    def test_refuses(self) -> None:
        assert self.refused or not self.field_class.model_fields.keys() - {"kind"}
        for arguments, word in self.refused:
            message = complaint(lambda a=arguments: self.field_class(**a))
            assert word in message, (arguments, message)
        assert "no such field" in complaint(lambda: self.field_class.model_validate({"colour": "red"} | self._plain()))

    def _plain(self) -> dict[str, Any]:
        return self.examples[0].model_dump(mode="json", exclude_none=True)


WAVELENGTHS = (400.0, 550.0, 700.0)


class PhaseFunctionBase:
    """What every phase function must pass."""

    phase_class: ClassVar[type[PhaseFunction]]
    examples: ClassVar[tuple[PhaseFunction, ...]]
    refused: ClassVar[tuple[tuple[dict[str, Any], str], ...]]
    #: Largest error of the kernels' table, relative to the phase function.
    table_error: ClassVar[float] = 2e-5
    #: By how much printed digits may break the bounds of a scattering matrix, relative to a1; rounding by itself.
    matrix_slack: ClassVar[float] = 1e-12

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        PHASE_TESTS[cls.phase_class] = cls

    def expected(self, phase: Any, mu: Array, wavelength: float) -> Array:
        """The published formula."""
        raise NotImplementedError

    def expected_mean_cosine(self, phase: Any, wavelength: float) -> float:
        """The stated mean cosine."""
        raise NotImplementedError

    def cuts(self, phase: PhaseFunction) -> list[float]:
        """Cosines between which a quadrature finds the function smooth: closing in on both peaks."""
        ends = [1.0 - 10.0**-k for k in range(7)]
        return [-1.0, *(-x for x in reversed(ends)), *ends[1:], 1.0]

    def moment(self, phase: PhaseFunction, wavelength: float, power: int) -> float:
        def integrand(mu: float) -> float:
            return float(phase.value([mu], [wavelength])[0, 0]) * mu**power

        cuts = self.cuts(phase)
        pieces = itertools.pairwise(cuts)
        return 2 * np.pi * sum(quad(integrand, a, b, epsabs=1e-13, epsrel=1e-10)[0] for a, b in pieces)

    def expected_matrix(self, phase: Any, mu: Array, wavelength: float) -> Array:
        """Elements a2, a3, a4, b1, b2 as published; by the rule of phase functions that know no polarisation."""
        a1 = self.expected(phase, mu, wavelength)
        return np.array([a1 * (1 + mu**2) / 2, a1 * mu, a1 * mu, 0 * mu, 0 * mu])

    def test_matrix_is_the_stated_one(self) -> None:
        mu = np.linspace(-1, 1, 201)
        for phase in self.examples:
            elements = phase.matrix(mu, WAVELENGTHS)
            assert elements.shape == (6, mu.size, len(WAVELENGTHS))
            np.testing.assert_allclose(elements[0], phase.value(mu, WAVELENGTHS), rtol=1e-13)  # rounding
            for i, wavelength in enumerate(WAVELENGTHS):
                expected = self.expected_matrix(phase, mu, wavelength)
                np.testing.assert_allclose(elements[1:, :, i], expected, rtol=1e-9, atol=1e-12 * elements[0].max())

    def test_matrix_obeys_bounds_and_symmetry(self) -> None:
        """No more polarised light than light; no direction singled out straight ahead and straight back."""
        mu = np.linspace(-1, 1, 401)
        for phase in self.examples:
            elements = phase.matrix(mu, WAVELENGTHS)
            assert matrix_excess(elements) < self.matrix_slack
            a1, a2, a3, _, b1, b2 = np.moveaxis(elements, 1, 0)[[0, -1]].transpose(1, 0, 2)
            small = 1e-12 * a1.max()
            # Hovenier & van der Mee (1983), Astron. Astrophys. 128, 1: values straight back (0) and ahead (1).
            for value in (b1, b2, a2[0] + a3[0], a2[1] - a3[1]):
                np.testing.assert_allclose(value, 0, atol=small)

    def test_matrix_tables_are_on_the_scale_of_the_phase_table(self) -> None:
        mu = 1 - 2 * (np.arange(1025) / 1024) ** 2
        for phase in self.examples:
            medium = _scene(phase).medium
            tables = matrix_tables(medium, WAVELENGTHS)
            assert tables.shape == (1, 6, 1025, 3)
            assert tables.flags.c_contiguous
            assert np.array_equal(tables[:, 0], medium_optics(medium, WAVELENGTHS)[3])
            expected = phase.matrix(mu, WAVELENGTHS)
            # The scale is the integral of the table's chords: as near to 1 as the table is good.
            np.testing.assert_allclose(tables[0], expected, rtol=max(self.table_error, 1e-3), atol=1e-12)

    def test_value_is_the_published_formula(self) -> None:
        mu = np.concatenate([np.linspace(-1, 1, 401), 1 - np.geomspace(1e-8, 0.1, 50)])
        for phase in self.examples:
            values = phase.value(mu, WAVELENGTHS)
            assert values.shape == (mu.size, len(WAVELENGTHS))
            for i, wavelength in enumerate(WAVELENGTHS):
                # The same numbers; near a sharp peak (1 - g)^2 is a difference of numbers near 1.
                np.testing.assert_allclose(values[:, i], self.expected(phase, mu, wavelength), rtol=1e-9)

    def test_never_negative(self) -> None:
        for phase in self.examples:
            values = phase.value(np.linspace(-1, 1, 2001), WAVELENGTHS)
            assert np.all(np.isfinite(values))
            assert values.min() >= 0

    def test_integrates_to_one(self) -> None:
        for phase in self.examples:
            for wavelength in WAVELENGTHS:
                assert self.moment(phase, wavelength, 0) == pytest.approx(1.0, abs=1e-9)  # the quadrature's tolerance

    def test_mean_cosine(self) -> None:
        for phase in self.examples:
            means = phase.mean_cosine(WAVELENGTHS)
            assert means.shape == (len(WAVELENGTHS),)
            for i, wavelength in enumerate(WAVELENGTHS):
                assert means[i] == pytest.approx(self.moment(phase, wavelength, 1), abs=1e-9)  # as above
                assert means[i] == pytest.approx(self.expected_mean_cosine(phase, wavelength), abs=1e-9)

    def test_sampler_draws_by_its_pdf(self) -> None:
        u = np.random.default_rng(11).random(10_000)
        for phase in self.examples:
            for wavelength in (WAVELENGTHS[0], WAVELENGTHS[-1]):
                check_chi_square(phase, wavelength, phase.sample(u, wavelength))
                mu = np.linspace(-0.999, 0.999, 21)
                np.testing.assert_array_equal(phase.pdf(mu, wavelength), phase.value(mu, [wavelength])[:, 0])

    def test_sampler_keeps_shape_and_range(self) -> None:
        for phase in self.examples:
            drawn = phase.sample([[0.0, 0.5, 1 - 2**-53]], 550.0)
            assert drawn.shape == (1, 3)
            assert np.all(np.abs(drawn) <= 1)

    def test_kernel_sampler_draws_by_the_phase_function(self) -> None:
        u = np.random.default_rng(12).random(100_000)
        for phase in self.examples:
            optics = compile_scene(_scene(phase), np.array(WAVELENGTHS)).optics
            drawn = np.empty_like(u)
            for i in (0, 2):
                kernel_samples(optics, i, u, drawn)
                assert np.all(np.abs(drawn) <= 1)
                check_chi_square(phase, WAVELENGTHS[i], drawn)

    def test_kernel_table_against_closed_form(self) -> None:
        rng = np.random.default_rng(13)
        mu = np.concatenate([rng.uniform(-1, 1, 4000), np.cos(np.radians(30) * rng.random(4000)), [-1.0, 1.0]])
        for phase in self.examples:
            optics = compile_scene(_scene(phase), np.array(WAVELENGTHS)).optics
            out = np.empty((mu.size, 1, len(WAVELENGTHS)))
            kernel_phases(optics.phase, mu, out)
            error = np.abs(out[:, 0] / phase.value(mu, WAVELENGTHS) - 1)
            worst = np.unravel_index(error.argmax(), error.shape)
            assert error.max() < self.table_error, (phase.kind, error.max(), mu[worst[0]])

    def test_written_and_read_back(self) -> None:
        for phase in self.examples:
            again = TypeAdapter(AnyPhase).validate_python(phase.model_dump(mode="json", exclude_none=True))
            assert again == phase
            assert type(again) is self.phase_class

    def test_refuses(self) -> None:
        assert self.refused or not self.phase_class.model_fields.keys() - {"kind"}
        for arguments, word in self.refused:
            message = complaint(lambda a=arguments: self.phase_class(**a))
            assert word in message, (arguments, message)


def check_chi_square(phase: PhaseFunction, wavelength: float, drawn: Array) -> None:
    """Pearson's test of cosines against `phase`, in 100 cells of equal probability."""
    # Distribution function by trapezoids on a grid that crowds at both ends; counts of 1000 need 1e-3 of a cell.
    x = np.linspace(0.0, np.pi, 20001)
    x = np.unique(np.concatenate([x, np.geomspace(1e-5, 0.05, 4000), np.pi - np.geomspace(1e-5, 0.05, 4000)]))
    mu = -np.cos(x)
    p = phase.value(mu, [wavelength])[:, 0]
    cdf = np.concatenate([[0.0], np.cumsum(np.pi * (p[1:] + p[:-1]) * np.diff(mu))])
    edges = np.interp(np.arange(1, 100) / 100, cdf / cdf[-1], mu)
    counts = np.bincount(np.searchsorted(edges, drawn), minlength=100)
    expected = drawn.size / 100
    statistic = float(np.sum((counts - expected) ** 2) / expected)
    # 99 degrees of freedom, fixed seeds; about 60 such tests: one at 1e-5 would be a finding.
    assert chi2.sf(statistic, 99) > 1e-5, (phase.kind, wavelength, statistic)


def _scene(phase: Any) -> Any:
    from skyscatter.media.fields import Uniform
    from skyscatter.scene import Scene, Star

    component = Component(name="it", density=Uniform(top=1e4), optics=Particles(optical_depth=1.0, phase=phase))
    return Scene(medium=Medium(planet_radius=EARTH, components=(component,)), star=Star(spectrum=1.0, radius=0))
