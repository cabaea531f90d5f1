"""Polarisation along a walk against electric fields: Jones vectors in space, sphere after sphere."""

from __future__ import annotations

import itertools
from typing import Any

import miepython
import numpy as np
from bases import plain
from numpy.typing import NDArray

from skyscatter.geometry.meridian import meridian_frame
from skyscatter.kernels.polar import begin, depolarise, make_polar, polarise
from skyscatter.optics.mie import LogNormalMode, MieAerosol
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.solvers.compile import phase_cosines

Array = NDArray[np.float64]

INDEX, SIZE, WAVELENGTH = 1.6 + 0.1j, 2.0, 500.0
SPHERE = MieAerosol(
    modes=(LogNormalMode(median_radius=SIZE * WAVELENGTH * 1e-9 / (2 * np.pi), geometric_standard_deviation=1.0),),
    refractive_index_real=INDEX.real,
    refractive_index_imag=INDEX.imag,
    number_density=1.0,
)


def stokes(field: NDArray[np.complex128], v: Array, left: Array, k: Array) -> Array:
    """I, Q, U, V of a field E = Re(field exp(-i omega t)) that travels along k, by their definitions.

    V is the rate at which E sweeps over area about k: positive where E turns anticlockwise for who meets the light.
    """
    upright, leaning = field @ v, field @ left
    now, later = field.real, field.imag  # omega t = 0 and pi / 2
    return np.array([
        abs(upright) ** 2 + abs(leaning) ** 2, abs(upright) ** 2 - abs(leaning) ** 2,
        2 * (upright * leaning.conjugate()).real, 2 * np.cross(now, later) @ k,
    ])  # fmt: skip


def scattered(field: NDArray[np.complex128], k_in: Array, k_out: Array) -> NDArray[np.complex128]:
    """The far field of the sphere: S2 in the plane of scattering, S1 across it (Bohren & Huffman, eq. 4.74)."""
    s1, s2 = (s[0].conj() for s in miepython.S1_S2(INDEX.conjugate(), SIZE, np.array([k_in @ k_out]), norm="one"))
    n = np.cross(k_in, k_out)
    n /= np.linalg.norm(n)
    result: NDArray[np.complex128] = s2 * np.cross(n, k_out) * (np.cross(n, k_in) @ field) + s1 * n * (n @ field)
    return result


def walk(vertices: Array, density: Array, tables: Array) -> tuple[Array, Array]:
    """M and v of the last leg, by the plain twins of the kernels; `vertices` are the directions of the walk."""
    frame = meridian_frame(np.array([0.0, 0.0, 1.0]), vertices[:1])[0]
    polar = make_polar(tables, frame, 1)
    twins: dict[str, Any] = {}
    plain(begin, twins)(polar, 0, 0)
    for old, new in itertools.pairwise(vertices):
        plain(polarise, twins)(polar, np.ones((len(density), 1)), density, *old, new)
    return polar.matrix[:, :, 0].copy(), polar.across.copy()


def directions(seed: int, count: int) -> Array:
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))


def sphere_table() -> Array:
    return np.ascontiguousarray(SPHERE.phase_function([WAVELENGTH]).matrix(phase_cosines(), [WAVELENGTH])[None])


def test_chains_of_spheres_against_their_fields() -> None:
    tables, turning = sphere_table(), []
    for seed in range(20):
        sights = directions(seed, 4)
        matrix, across = walk(sights, np.ones(1), tables)
        first, last = sights[0], sights[-1]
        frame = meridian_frame(np.array([0.0, 0.0, 1.0]), first)
        rng = np.random.default_rng(100 + seed)
        # Any light that comes along the last leg: it travels from there to the camera, against the walk.
        v, left = across, np.cross(across, last)
        amplitudes = rng.normal(size=2) + 1j * rng.normal(size=2)
        field = amplitudes[0] * v + amplitudes[1] * left
        coming = stokes(field, v, left, -last)
        scale = 1.0
        for toward, away in zip(sights[:0:-1], sights[-2::-1], strict=True):
            field = scattered(field, -toward, -away)
            s1, s2 = miepython.S1_S2(INDEX.conjugate(), SIZE, np.array([toward @ away]), norm="one")
            scale *= 0.5 * float(abs(s1[0]) ** 2 + abs(s2[0]) ** 2)
        expected = stokes(field, *frame, -first) / scale
        turning.append(abs(expected[3] / expected[0]))
        # Chords of the table of a degree: 1e-3 at each scattering.
        np.testing.assert_allclose(matrix @ coming, expected, atol=5e-3 * expected[0])
    assert np.median(turning) > 0.1


def test_mixture_weighs_its_components_by_what_they_scatter() -> None:
    tables = np.concatenate([sphere_table(), HenyeyGreenstein(g=0.5).matrix(phase_cosines(), [WAVELENGTH])[None]])
    sights = directions(7, 2)
    density = np.array([0.3, 1.7])
    k = np.searchsorted(-phase_cosines(), -(sights[0] @ sights[1]))
    a1 = tables[:, 0, k, 0]
    share = density * a1 / (density @ a1)
    mixed = walk(sights, density, tables)[0]
    parts = [walk(sights, np.ones(1), table[None])[0] for table in np.ascontiguousarray(tables)]
    # The share is taken at the nearest node of the table.
    np.testing.assert_allclose(mixed, share[0] * parts[0] + share[1] * parts[1], atol=5e-3)


def test_straight_on_and_straight_back() -> None:
    """No plane of scattering: v stays what it was, forward keeps the light and backward mirrors U and V."""
    tables = sphere_table()
    for sign in (1.0, -1.0):
        sight = directions(3, 1)[0]
        matrix, across = walk(np.stack([sight, sign * sight]), np.ones(1), tables)
        np.testing.assert_allclose(matrix, np.diag([1.0, 1.0, sign, sign]), atol=1e-12)
        v = meridian_frame(np.array([0.0, 0.0, 1.0]), sight)[0]
        np.testing.assert_allclose(np.abs(across @ v), 1.0, atol=1e-12)


def test_ground_leaves_nothing_but_plain_light() -> None:
    polar = make_polar(sphere_table(), np.array([[0.0, 1.0, 0.0]]), 1)
    polar.matrix[:] = np.random.default_rng(2).random((4, 4, 1))
    first = polar.matrix[:, 0].copy()
    for sight in directions(4, 5):
        plain(depolarise)(polar, sight)
        assert np.array_equal(polar.matrix[:, 0], first)
        assert not polar.matrix[:, 1:].any()
        np.testing.assert_allclose([polar.across @ sight, polar.across @ polar.across], [0.0, 1.0], atol=1e-12)
