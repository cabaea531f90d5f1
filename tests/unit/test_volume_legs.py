"""Points at which legs of walks fetch starlight: how much more one of them can bring than all do on average."""

from __future__ import annotations

import math

import numpy as np
import pytest
from nebulae import dusty_sphere

from skyscatter.kernels.jit import entry
from skyscatter.kernels.optics import transmittance
from skyscatter.kernels.space import space_densities
from skyscatter.kernels.volume import correct_guess, guess_light, make_volume_work
from skyscatter.kernels.volume_legs import columns_to, draw_point, make_volume_leg, prepare_volume_leg
from skyscatter.kernels.volume_walks import CAMERA_STRATA, LEG_STRATA, PLAIN
from skyscatter.solvers.volume import compile_volume


@entry
def draw_points(v, x, d, far, u, leg, work, place, density):
    """Distances (point,) along a leg of the length `far`, one per number u, and their densities."""
    prepare_volume_leg(v, x, d, 0.0, far, np.bool_(False), 0.5, leg, work)
    for n in range(u.size):
        place[n], _ = draw_point(leg.light, leg.light_rim, True, leg, PLAIN, np.int64(0), u[n], leg.draw)
        density[n] = leg.draw[0]


@pytest.mark.parametrize("tau", [0.1, 10.0])
@pytest.mark.parametrize("height", [0.3, 1e-2, 1e-4, 1e-6])
def test_no_point_brings_much_more_than_all_on_average(tau: float, height: float) -> None:
    """However near to the star a leg passes; drawn by the distance the spread was 9 at 1e-4, 60 at 1e-6."""
    table = compile_volume(dusty_sphere(tau), (550.0,))
    leg, work = make_volume_leg(LEG_STRATA, 1, 1), make_volume_work(1, 1)
    # From a radius of 0.85 past the star in the centre of a sphere of radius 1.
    towards = math.asin(height / 0.85)
    x, d = np.array([0.0, 0.0, 0.85]), np.array([math.sin(towards), 0.0, -math.cos(towards)])
    along = 0.85 * math.cos(towards)
    far = along + math.sqrt(1.0 - height * height)
    u = (np.arange(20000) + 0.5) / 20000
    place, density = np.zeros((2, u.size))
    draw_points(table, x, d, far, u, leg, work, place, density)
    square = height**2 + (place - along) ** 2
    weight = np.exp(-tau * (place + np.sqrt(square))) / square / density
    # The same over the angle, where it is smooth: trapezoid.
    angle = np.linspace(math.atan(-along / height), math.atan((far - along) / height), 200001)
    t = along + height * np.tan(angle)
    light = np.exp(-tau * (t + np.hypot(height, t - along))) / height
    whole = np.trapezoid(light, angle)
    weight /= whole
    print(f"tau {tau:g}, height {height:g}: {weight.mean():.5f}, spread {weight.std():.2f}, most {weight.max():.1f}")
    # 20 000 even numbers: 8e-4 off at most.  At depth 10 a stratum beyond the star is 20 deep, and its exponential over
    # the angle leaves points that weigh 32, with a spread of 1.12; at depth 0.1 the spread is 0.25.
    assert weight.mean() == pytest.approx(1.0, rel=1e-3)
    assert weight.std() < (0.3 if tau < 1 else 1.2)
    assert weight.max() < 40.0


@entry
def weigh_vertices(v, x, d, end, camera, u, leg, work, weight):
    """What the light at each of the drawn vertices (point,) of a leg is guessed to be, over its density."""
    space_densities(v.space, x[0], x[1], x[2], work.space, work.density)
    prepare_volume_leg(v, x, d, 0.0, end, camera, 0.5, leg, work)
    for n in range(u.size):
        t, k = draw_point(leg.vertex, leg.vertex_rim, False, leg, 0.0, np.int64(0), u[n], leg.draw)
        columns_to(v, x, d, leg, k, t, work)
        transmittance(work.along, v.sigma_t, work.through)
        weight[n] = work.through[0] / leg.draw[0]
        a, b, c = x[0] + t * d[0], x[1] + t * d[1], x[2] + t * d[2]
        guess_light(v, a, b, c, d, 0.0, work, work.through, work.spare)
        correct_guess(v, a, b, c, work.spare)
        space_densities(v.space, a, b, c, work.space, work.density)
        weight[n] *= work.spare[0] * work.density[0]


@pytest.mark.parametrize(
    ("from_above", "sine", "most"),
    [(True, 0.3, 0.5), (False, 0.0, 0.18), (False, 0.7, 0.1), (False, 1.0, 0.02)],
)
def test_every_vertex_promises_the_same(from_above: bool, sine: float, most: float) -> None:
    """Where light diffuses, in a white ball of depth 30: what vertices promise multiplies over hundreds of legs."""
    table = compile_volume(dusty_sphere(30.0, albedo=1.0), (550.0,))
    strata = CAMERA_STRATA if from_above else LEG_STRATA
    leg, work = make_volume_leg(strata, 1, 1), make_volume_work(1, 1)
    # The camera's ray from the box around the ball, or a leg from two free paths below the rim: inward, aslant, across.
    if from_above:
        x, d, end = np.array([sine, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]), 2.0
    else:
        x, d = np.array([0.0, 0.0, 1.0 - 2.0 / 30.0]), np.array([sine, 0.0, -math.sqrt(1.0 - sine**2)])
        inward = -float(x @ d)
        end = inward + math.sqrt(1.0 - float(x @ x) + inward**2) - 1e-9
    u = (np.arange(4000) + 0.5) / 4000
    weight = np.zeros(u.size)
    weigh_vertices(table, x, d, end, np.bool_(from_above), u, leg, work, weight)
    spread = weight.std() / weight.mean()
    print(f"from above {from_above}, sine {sine}: spread {spread:.3f}")
    assert spread < most
