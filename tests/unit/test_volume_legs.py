"""Legs of walks: what points at which starlight is fetched can bring at most, and what is emitted along a leg."""

from __future__ import annotations

import math

import numpy as np
import pytest
from nebulae import dusty_sphere

import skyscatter
from skyscatter import fields
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
    prepare_volume_leg(v, x, d, 0.0, far, np.bool_(False), True, 0.5, leg, work)
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
    prepare_volume_leg(v, x, d, 0.0, end, camera, True, 0.5, leg, work)
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


@entry
def emissions(v, x, d, far, u, early, leg, work, light):
    """Emission along a leg of the length `far` (number, wavelength), one for each number u."""
    space_densities(v.space, x[0], x[1], x[2], work.space, work.density)
    for n in range(u.size):
        prepare_volume_leg(v, x, d, 0.0, far, np.bool_(False), early, u[n], leg, work)
        for i in range(light.shape[1]):
            light[n, i] = leg.escape[i]


def thin_skin() -> skyscatter.SpaceScene:
    """A ball of dust that a skin of gas surrounds, a hundredth of its radius thick, and gas all through it."""
    skin = fields.Shell(inner=1.0, outer=1.01)
    dust = skyscatter.Particles(extinction=2.0, single_scattering_albedo=0.6, phase={"kind": "isotropic"})
    lines = {"electron_density": 1e10, "temperature": 8000}
    parts = {
        "dust": (fields.Sphere(radius=1.2), dust),
        "skin": (skin, skyscatter.GasLines(**lines)),
        "oxygen": (fields.Sphere(radius=1.2), skyscatter.GasLines(**lines, hydrogen=False, ratios={"oiii_5007": 1e-2})),
    }
    made = [skyscatter.Component(name=name, density=field, optics=optics) for name, (field, optics) in parts.items()]
    return skyscatter.SpaceScene(medium=skyscatter.Medium(components=tuple(made)), view=skyscatter.View(distance=1e3))


def test_emission_along_a_leg_is_right_on_average_and_quiet_where_columns_tell_it() -> None:
    table = compile_volume(thin_skin(), (500.8, 656.5))
    assert not np.any(table.sigma_t[1:])
    assert np.all(table.emission.sum(axis=0) > 0)
    leg, work = make_volume_leg(LEG_STRATA, 3, 2), make_volume_work(3, 2)
    x, d = np.array([0.1, 0.0, -0.95]), np.array([0.0, 0.6, 0.8])
    far = float(np.dot(-x, d) + math.sqrt(1.44 - np.dot(x, x) + np.dot(x, d) ** 2))
    # Dust is evenly dense: columns are distances, and the skin lies between two known ones, or none.
    enter, leave = (float(np.dot(-x, d) + math.sqrt(r * r - np.dot(x, x) + np.dot(x, d) ** 2)) for r in (1.0, 1.01))
    sigma = table.sigma_t[0]
    through = lambda a, b: (np.exp(-sigma * a) - np.exp(-sigma * b)) / sigma  # noqa: E731
    truth = table.emission[1] * through(enter, leave) + table.emission[2] * through(0.0, far)
    u = np.random.default_rng(5).random(40000)
    spread = {}
    for early in (False, True):
        light = np.zeros((u.size, 2))
        emissions(table, x, d, far, u, early, leg, work, light)
        error = light.std(axis=0) / math.sqrt(u.size)
        spread[early] = light.std(axis=0) / truth
        print(early, light.mean(axis=0) / truth, spread[early], light.min(axis=0) / truth)
        # Four standard errors, and what columns by quadrature may be off.
        assert np.all(np.abs(light.mean(axis=0) - truth) < 4.0 * error + 1e-4 * truth)
    assert spread[True][0] < spread[False][0] / 2
    assert spread[True][1] < spread[False][1] / 5
