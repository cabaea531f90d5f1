"""New directions at vertices in a medium and at walls: by what scatters there, or past a lamp that is near.

Of a lamp that a leg passes at the height h it gathers light as 1 / h.  Drawn by the phase function or by a wall's
reflectance alone, directions near to that of a lamp are rare, and so bright that a few walks carry most of the light:
of a small lamp it has no variance.  So a share of them passes a lamp.  Their angle from it follows the light that fog
scatters once around a point lamp, its halo, which bounds the light; within the cone that the lamp fills they are even.
The share falls with the optical depth of the way: walks that diffuse towards a point at the distance r drift by one
free path over r, and more would spread the weights of walks with every turn.

Around parallel light the sky is bright in the same way where the air scatters forward: there a share of the directions
follows the phase function over the angle from it, and goes with the mean cosine (`solvers.surface_path.SUNWARD`).
Over a sea air is lit from below, too, by the glitter around the star's image: another share goes there.  Each turn that
is drawn otherwise makes the walk heavier, by one over the rest: a share that stayed the same would make of hundreds of
turns in a cloud a few walks that carry all the light.  So these shares fall with the number of turns, and with the
square of the optical depth down to the sea, as far as which a walk that diffuses would take as many.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.surfaces import PARALLEL_LAMP, SURROUNDINGS
from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import inlined, kernel
from skyscatter.kernels.random import uniform
from skyscatter.kernels.surfaces.beams import density_to_beam, draw_to_beam, place_beside, to_beam
from skyscatter.kernels.surfaces.flights import NEARBY, ORDER
from skyscatter.kernels.surfaces.lamps import face, guess_in_medium, pick
from skyscatter.kernels.surfaces.legs import gathered_at
from skyscatter.kernels.surfaces.media import depth_of, draw_scattered, medium_density
from skyscatter.kernels.tabulated import cell_of

#: Largest shares of the directions that pass lamps, from vertices in media and from walls.  They are a compromise:
#: in grey rooms walls gain up to 0.8, between white ones in thin fog that has two to five times the variance of 0.3.
PASSING, LEAVING = 0.3, 0.3
#: Largest share of those from beside a narrow beam that lead into it.
BESIDE = 0.6
#: Optical depth of the way to a lamp at which half of the directions that could leave a surface towards it do.
THIN = 0.2
#: Largest share of the directions from air that go around the image of parallel light in a sea, how far from that
#: [rad], and the reflectance of the sea where half as many go.  With the Sun at 60 degrees the glitter is dim, and half
#: of all directions there had four times the variance of none.
GLINT, WAVY, BRIGHT = 0.5, 0.7, 0.1
#: Sine of the least angle from a lamp.
LEAST_SINE = 1e-10


@inlined
def early(order):
    """What is left of the shares around parallel light after so many turns; the weights' growth ends with their sum."""
    return 1.0 / (1.0 + order * order)


@inlined
def from_middle(guide, x):
    """Distance of the place x from the middle of the planet on which a sea lies [m]."""
    z = x[2] + guide.sea
    return math.sqrt(x[0] * x[0] + x[1] * x[1] + z * z)


@inlined
def see_down(guide, x, sigma):
    """What is left of them at x where the extinction is sigma [m-1], as far as a sea below is hidden."""
    if not guide.sea > 0.0:
        return 1.0
    depth = sigma * (from_middle(guide, x) - guide.sea)
    return 1.0 / (1.0 + depth * depth)


@kernel
def shares_past(table, m, x, s):
    """Shares of the directions from a vertex that pass each lamp, into ``s.chance`` (lamp,); returns their sum.

    ``s.media.density`` holds the densities at the vertex.  How much of the view lamps fill goes to ``s.far[NEARBY]``.
    """
    lamps, guide, total, near = table.lamps, table.guide, 0.0, 0.0
    sigma = depth_of(table.media, m, s.media.density, s.light.size // 2)
    guess_in_medium(lamps, guide, x, s.chance)
    for k in range(s.chance.size):
        share = 0.0
        if lamps.kind[k] == PARALLEL_LAMP:
            share = (guide.size[k] + image_share(guide, k, x)) * s.chance[k] * early(s.at[ORDER])
            share *= see_down(guide, x, sigma)
        elif lamps.kind[k] != SURROUNDINGS:
            p, size = guide.middle[k], guide.size[k]
            along, height = place_beside(guide, k, x)
            square = (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2 + (x[2] - p[2]) ** 2
            near += s.chance[k] * min(size * size / max(square, 1e-300), 1.0)
            if height > 0.0:
                share = BESIDE * s.chance[k] / (1.0 + sigma * to_beam(along, height))
            elif square > size * size:
                share = PASSING * s.chance[k] * (1.0 - size * size / square)
                share /= 1.0 + sigma * math.sqrt(square)
        s.chance[k] = share
        total += share
    s.far[NEARBY] = near
    return total


@kernel
def shares_from_wall(table, m, x, n, s):
    """`shares_past` from a point x of a surface with normal n on the side of medium m."""
    lamps, guide, total = table.lamps, table.guide, 0.0
    if not guide.scatters[m]:
        return 0.0
    medium_density(table.media, m, x[0], x[1], x[2], s.media)
    sigma = depth_of(table.media, m, s.media.density, s.light.size // 2)
    guess_in_medium(lamps, guide, x, s.chance)
    for k in range(s.chance.size):
        share = 0.0
        if lamps.kind[k] == PARALLEL_LAMP:
            p = guide.middle[k]
            facing = n[0] * p[0] + n[1] * p[1] + n[2] * p[2] > 0.0
            share = guide.size[k] * s.chance[k] * early(s.at[ORDER]) if facing else 0.0
        elif lamps.kind[k] != SURROUNDINGS:
            p, size = guide.middle[k], guide.size[k]
            a, b, c = p[0] - x[0], p[1] - x[1], p[2] - x[2]
            square = a * a + b * b + c * c
            along, height = place_beside(guide, k, x)
            if height > 0.0:
                depth = sigma * to_beam(along, height)
                share = BESIDE * s.chance[k] / (1.0 + depth * depth)
            elif square > size * size and n[0] * a + n[1] * b + n[2] * c > -size:
                depth = sigma * math.sqrt(square)
                share = LEAVING * s.chance[k] * depth / (depth + THIN) / (1.0 + depth * depth)
        s.chance[k] = share
        total += share
    return total


@inlined
def face_lamp(table, k, x, d):
    """Unit vector from x towards lamp k, into `d` (3,)."""
    if table.lamps.kind[k] == PARALLEL_LAMP:
        for n in range(3):
            d[n] = table.guide.middle[k, n]
    else:
        face(x, table.guide.middle[k], d)


@inlined
def cone_around(table, k, x):
    """1 - cos of the half angle of the cone that lamp k fills at most, seen from x outside of it, and the angle."""
    p, size = table.guide.middle[k], table.guide.size[k]
    square = (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2 + (x[2] - p[2]) ** 2
    sine = min(size / math.sqrt(max(square, 1e-300)), 1.0)
    return sine * sine / (1.0 + math.sqrt((1.0 - sine) * (1.0 + sine))), math.asin(sine)


@inlined
def height_of(guide, k, x):
    """Scalar product of the place x as seen from the middle of the planet [m] and the direction to parallel lamp k."""
    p = guide.middle[k]
    return p[0] * x[0] + p[1] * x[1] + p[2] * (x[2] + guide.sea)


@inlined
def image_share(guide, k, x):
    """Share of the directions from air at x that go around the image of parallel lamp k in the sea.

    As much as it reflects, by the approximation of Schlick (1994, Computer Graphics Forum 13, 233) for water.
    """
    height = height_of(guide, k, x) if guide.sea > 0.0 else 0.0
    if not height > 0.0:
        return 0.0
    grazing = max(1.0 - height / from_middle(guide, x), 0.0)
    mirrored = 0.02 + 0.98 * grazing * grazing * grazing * grazing * grazing
    return GLINT * mirrored / (mirrored + BRIGHT)


@inlined
def face_image(guide, k, x, d):
    """Unit vector from x towards the image of parallel lamp k in a sea that is level as below x, into `d` (3,)."""
    p, z = guide.middle[k], x[2] + guide.sea
    back = 2.0 * height_of(guide, k, x) / (x[0] * x[0] + x[1] * x[1] + z * z)
    d[0], d[1], d[2] = p[0] - back * x[0], p[1] - back * x[1], p[2] - back * z


@inlined
def sine_between(to, d):
    """Sine of the angle between two unit vectors, not quite zero."""
    a, b, c = to[1] * d[2] - to[2] * d[1], to[2] * d[0] - to[0] * d[2], to[0] * d[1] - to[1] * d[0]
    return max(math.sqrt(a * a + b * b + c * c), LEAST_SINE)


@inlined
def angle_density(table, angle, sine):
    """Density of directions at an angle from an axis times 2 pi; `table` has the integral over the angle."""
    last = table.size - 1
    y = math.sqrt(angle / math.pi)
    n = min(int(y * last), last - 1)
    return (table[n + 1] - table[n]) * last / (2.0 * math.pi * y * sine * table[last])


@inlined
def draw_angle(table, u):
    """Angle drawn from the density whose integral `table` has."""
    last = table.size - 1
    u *= table[last]
    n = cell_of(table, 0, last, u)
    y = (n + min((u - table[n]) / (table[n + 1] - table[n]), 1.0)) / last
    return math.pi * y * y


@inlined
def density_around(guide, m, k, x, d, image, to):
    """Density of directions around parallel lamp k times their share and 2 pi, with the share `image` of those around
    its image.
    """
    sine = sine_between(to, d)
    angle = math.atan2(sine, to[0] * d[0] + to[1] * d[1] + to[2] * d[2])
    density = guide.size[k] * angle_density(guide.gathered[m], angle, sine)
    if image > 0.0:
        face_image(guide, k, x, to)
        if to[0] * d[0] + to[1] * d[1] + to[2] * d[2] > math.cos(WAVY):
            density += image / (WAVY * sine_between(to, d))
    return density


@kernel
def density_past(table, m, x, d, share, from_air, to):
    """Density of directions that pass lamps times their shares [sr-1]; `to` (3,) is scratch.

    Only those `from_air` go around images of lamps, too.
    """
    density = 0.0
    for k in range(share.size):
        if share[k] > 0.0:
            along, height = place_beside(table.guide, k, x)
            if height > 0.0:
                density += 2.0 * math.pi * share[k] * density_to_beam(table.guide, k, x, along, height, d)
                continue
            face_lamp(table, k, x, to)
            if table.lamps.kind[k] == PARALLEL_LAMP:
                image = image_share(table.guide, k, x) if from_air else 0.0
                density += share[k] * density_around(table.guide, m, k, x, d, image, to) / (table.guide.size[k] + image)
                continue
            sine = sine_between(to, d)
            angle = math.atan2(sine, to[0] * d[0] + to[1] * d[1] + to[2] * d[2])
            halo = table.guide.halo[m]
            opening, half = cone_around(table, k, x)
            if angle < half:
                density += share[k] * gathered_at(halo, half) / opening
            else:
                density += share[k] * angle_density(halo, angle, sine)
    return density / (2.0 * math.pi)


@kernel
def draw_past(table, m, k, x, from_air, u, v, d):
    """A direction that passes lamp k, into `d` (3,); see `density_past`."""
    along, height = place_beside(table.guide, k, x)
    if height > 0.0:
        draw_to_beam(table.guide, k, x, along, height, u, v, d)
        return
    face_lamp(table, k, x, d)
    if table.lamps.kind[k] == PARALLEL_LAMP:
        image = image_share(table.guide, k, x) if from_air else 0.0
        around = table.guide.size[k] / (table.guide.size[k] + image)
        if u < around:
            cosine = math.cos(draw_angle(table.guide.gathered[m], u / around))
        else:
            face_image(table.guide, k, x, d)
            cosine = math.cos(WAVY * (u - around) / (1.0 - around))
    else:
        halo = table.guide.halo[m]
        opening, half = cone_around(table, k, x)
        inside = gathered_at(halo, half)
        if u < inside:
            cosine = 1.0 - opening * u / inside
        else:
            cosine = math.cos(draw_angle(halo, u))
    turn(d, cosine, 2.0 * math.pi * v)


@kernel
def draw_direction(table, m, hero, x, u, v, s, d):
    """Turn d at a vertex, and leave the shares of the directions that pass each lamp in ``s.chance``.

    Returns
    -------
    turned : bool
        False where nothing is scattered.
    past : float
        Sum of the shares.
    """
    past = shares_past(table, m, x, s)
    if past > 0.0:
        choice = uniform(s.walk.state)
        if choice < past:
            draw_past(table, m, pick(s.chance, choice), x, True, u, v, d)
            return True, past
    return draw_scattered(table.media, m, hero, u, v, s.media, d), past
