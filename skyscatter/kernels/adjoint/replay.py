"""Light scattered twice and more in voxels by random walks, and its derivatives along the same walks.

A walk starts at the camera and collides in the grid at every leg; from the second collision on the stars' light is
added at every one.  Most flights are those of a collision within the grid, weighted by its chance; a few end anywhere
on the leg alike, for where there is nothing a little more would scatter too: that is all of the derivative there.  The
density along a leg is constant within steps, so flights, transmittances and chances are exact for it, and so are their
derivatives: in

    f = prod_k [T(leg k) sum_c rho_c sigma_s,c p_c] x [light of the star at the last collision]

a voxel counts -sigma_t length for every step in which a leg passes it, and 1 / rho at a collision (in a mixture the
share of each component).  The density of the draw is left alone: what is differentiated is the integrand (score of the
integrand; Vicini, Speierer & Jakob 2021, ACM Trans. Graph. 40, 108, section 4).  The walk is kept leg by leg, and gone
through once more from its end.

One wavelength, the hero, draws the flights; the balance heuristic makes the walk count for all (Wilkie et al. 2014,
Computer Graphics Forum 33, 123).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.directions import turn
from skyscatter.kernels.jit import entry, inlined
from skyscatter.kernels.tabulated import angle_cell, cell_of, draw_in_cell

#: Russian roulette begins after so many collisions, below this share of the throughput after the first.
FIRST_ROULETTE, ROULETTE_LEVEL = 3, 0.3
#: Share of the new directions that are drawn alike from all sides, and of the flights that end anywhere alike.
EVEN_SHARE, EVEN_FLIGHTS = 0.1, 0.1


@by_address
class Draws(NamedTuple):
    """Phase functions averaged over the wavelengths, from which directions are drawn."""

    sigma_s: np.ndarray  #: (c,) mean scattering [m-1]
    phase: np.ndarray  #: (c, angle) [sr-1] at cos = 1 - 2 (k / n)^2
    cdf: np.ndarray  #: (c, angle) chance of an angle nearer to forward
    scale: np.ndarray  #: (c,) a density that walks through empty places are weighted by


@by_address
class Walk(NamedTuple):
    """What is kept of a walk, collision by collision (k)."""

    start: np.ndarray  #: (k, 3) where the leg that leads there begins [m]
    direction: np.ndarray  #: (k, 3) of that leg
    place: np.ndarray  #: (k, 3) of the collision [m]
    begin: np.ndarray  #: (k,) distance at which that leg enters the grid [m]
    step: np.ndarray  #: (k,) length of its steps [m]
    number: np.ndarray  #: (k,) int64 number of the step in which the collision is
    flown: np.ndarray  #: (k,) length of it up to the collision [m]
    rho: np.ndarray  #: (k, c) density in the step of the collision
    base: np.ndarray  #: (k, w) throughput over its mean chance, before the light of the stars
    value: np.ndarray  #: (w,)
    chance: np.ndarray  #: (w,)
    column: np.ndarray  #: (c,)
    total: np.ndarray  #: (w,) optical depth of the whole leg
    by_c: np.ndarray  #: (c,)
    by_w: np.ndarray  #: (3, w)
    toward: np.ndarray  #: (c,)
    empty: np.ndarray  #: (1,) int64 number of the collision with nothing that the walk goes on from, or -1
    state: np.ndarray  #: (1,) uint64


@inlined
def uniform(state):
    """Next number in [0, 1): splitmix64 (Steele, Lea & Flood 2014, OOPSLA)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@inlined
def start_stream(state, seed, ray, walk):
    """A stream for every walk, whatever the threads."""
    state[0] = np.uint64(seed) * np.uint64(0xD1342543DE82EF95) + np.uint64(ray)
    uniform(state)
    state[0] = state[0] ^ (np.uint64(walk) * np.uint64(0xA0761D6478BD642F))
    uniform(state)


@inlined
def corner(u, v, w, n0, n1, n2):
    """Number of the lowest node around a place in cells, and the place within the cell."""
    i, j, k = min(max(int(u), 0), n0 - 2), min(max(int(v), 0), n1 - 2), min(max(int(w), 0), n2 - 2)
    return (i * n1 + j) * n2 + k, u - i, v - j, w - k


@inlined
def node_weight(q, f, g, h):
    """Weight of corner number q of a cell (its bits: x, y, z) in trilinear interpolation."""
    a = f if q & 4 else 1.0 - f
    b = g if q & 2 else 1.0 - g
    return a * b * (h if q & 1 else 1.0 - h)


@inlined
def read(values, first, f, g, h, n1, n2, out):
    """Trilinear interpolation of values (node, c), into `out` (c,)."""
    for c in range(out.size):
        out[c] = 0.0
    for q in range(8):
        node = first + (q >> 2) * n1 * n2 + ((q >> 1) & 1) * n2 + (q & 1)
        weight = node_weight(q, f, g, h)
        for c in range(out.size):
            out[c] += weight * values[node, c]


@inlined
def add(values, first, f, g, h, n1, n2, amount):
    """Transpose of `read`."""
    for q in range(8):
        node = first + (q >> 2) * n1 * n2 + ((q >> 1) & 1) * n2 + (q & 1)
        weight = node_weight(q, f, g, h)
        for c in range(amount.size):
            values[node, c] += weight * amount[c]


@inlined
def cells(m, o, d, t):
    """Place in cells of the padded nodes at distance t along a line."""
    return (
        (o[0] + t * d[0] - m.low[0]) * m.inverse[0],
        (o[1] + t * d[1] - m.low[1]) * m.inverse[1],
        (o[2] + t * d[2] - m.low[2]) * m.inverse[2],
    )


@entry
def clip(m, o, d):
    """Where a line enters and leaves the box of the padded nodes, from its start on."""
    start, end = 0.0, np.inf
    for k in range(3):
        a, b = (o[k] - m.low[k]) * m.inverse[k], d[k] * m.inverse[k]
        top = float(m.shape[k] - 1)
        if b == 0.0:
            if a <= 0.0 or a >= top:
                return 0.0, 0.0
        else:
            p, q = -a / b, (top - a) / b
            start, end = max(start, min(p, q)), min(end, max(p, q))
    return start, end


@entry
def prepare_leg(m, o, d, k, walk):
    """Begin and step of leg k, and the optical depths of all of it; returns the number of steps, 0 outside the grid."""
    start, end = clip(m, o, d)
    for c in range(walk.column.size):
        walk.column[c] = 0.0
    if not end > start:
        return 0
    count = int(math.ceil((end - start) / m.step))
    h = (end - start) / count
    for j in range(count):
        u, v, w = cells(m, o, d, start + (j + 0.5) * h)
        first, e, f, g = corner(u, v, w, m.shape[0], m.shape[1], m.shape[2])
        read(m.density, first, e, f, g, m.shape[1], m.shape[2], walk.by_c)
        for c in range(walk.column.size):
            walk.column[c] += h * walk.by_c[c]
    for i in range(walk.total.size):
        walk.total[i] = 0.0
        for c in range(walk.column.size):
            walk.total[i] += walk.column[c] * m.sigma_t[c, i]
    for a in range(3):
        walk.start[k, a], walk.direction[k, a] = o[a], d[a]
    walk.begin[k], walk.step[k] = start, h
    return count


@entry
def fly(m, o, d, k, count, hero, walk):
    """The collision of leg k: drawn by the hero within the grid, or anywhere alike."""
    h, depth = walk.step[k], 0.0
    u, v = uniform(walk.state), uniform(walk.state)
    anywhere = u < EVEN_FLIGHTS or not walk.total[hero] > 0.0
    wanted = -math.log1p(-v * -math.expm1(-walk.total[hero]))
    chosen = min(int(v * count), count - 1) if anywhere else count - 1
    rho = walk.rho[k]
    for c in range(rho.size):
        walk.column[c] = 0.0
    for j in range(chosen + 1):
        x, y, z = cells(m, o, d, walk.begin[k] + (j + 0.5) * h)
        first, e, f, g = corner(x, y, z, m.shape[0], m.shape[1], m.shape[2])
        read(m.density, first, e, f, g, m.shape[1], m.shape[2], rho)
        sigma = 0.0
        for c in range(rho.size):
            sigma += rho[c] * m.sigma_t[c, hero]
        if j == chosen or (not anywhere and depth + sigma * h >= wanted):
            part = v * count * h - j * h if anywhere else (wanted - depth) / sigma if sigma > 0.0 else h
            part = min(max(part, 0.0), h)
            walk.number[k], walk.flown[k] = j, part
            for c in range(rho.size):
                walk.column[c] += part * rho[c]
            for a in range(3):
                walk.place[k, a] = o[a] + (walk.begin[k] + j * h + part) * d[a]
            return
        depth += sigma * h
        for c in range(rho.size):
            walk.column[c] += h * rho[c]


@entry
def collide(m, k, count, walk):
    """Throughput and chances after the flight to collision k; `base` of it.  False if the walk counts for nothing."""
    mean, wavelengths, length = 0.0, walk.value.size, count * walk.step[k]
    for i in range(wavelengths):
        tau, sigma = 0.0, 0.0
        for c in range(walk.column.size):
            tau += walk.column[c] * m.sigma_t[c, i]
            sigma += walk.rho[k, c] * m.sigma_t[c, i]
        through = math.exp(-tau)
        walk.value[i] *= through
        if walk.total[i] > 0.0:
            flown = sigma * through / -math.expm1(-walk.total[i])
            walk.chance[i] *= EVEN_FLIGHTS / length + (1.0 - EVEN_FLIGHTS) * flown
        else:
            walk.chance[i] /= length
        mean += walk.chance[i]
    mean /= wavelengths
    if not mean > 0.0:
        return False
    for i in range(wavelengths):
        walk.value[i] /= mean
        walk.chance[i] /= mean
        walk.base[k, i] = walk.value[i]
    return True


@entry
def is_empty(k, walk):
    """Whether there is nothing at collision k."""
    most = 0.0
    for c in range(walk.column.size):
        most = max(most, walk.rho[k, c])
    return most <= 0.0


@entry
def face_star(m, k, s, walk):
    """What a star does at collision k: (geometry, cell of the phase table, place in it, distance); `toward` filled."""
    x, y, z = walk.place[k, 0], walk.place[k, 1], walk.place[k, 2]
    a, b, c = m.place[s, 0], m.place[s, 1], m.place[s, 2]
    far, fall = 1.0, 1.0
    if not m.distant[s]:
        a, b, c = a - x, b - y, c - z
        far = max(math.sqrt(a * a + b * b + c * c), m.size[s])
        a, b, c, fall = a / far, b / far, c / far, 1.0 / (far * far)
    d = walk.direction[k]
    # Light runs against the walk: from the star to the collision, then along -d.
    last, share = angle_cell(d[0] * a + d[1] * b + d[2] * c, m.phase.shape[1] - 1)
    first, e, f, g, n1, n2 = column_cell(m, x, y, z)
    read(m.toward[:, s], first, e, f, g, n1, n2, walk.toward)
    return fall, last, share, far


@inlined
def column_cell(m, x, y, z):
    """Lowest node of the grid of columns around a point, the place in the cell, and the nodes along y and z."""
    u, v, w = (x - m.low[0]) * m.inverse[0], (y - m.low[1]) * m.inverse[1], (z - m.low[2]) * m.inverse[2]
    n0, n1, n2 = (m.shape[0] - 1) * m.fine + 1, (m.shape[1] - 1) * m.fine + 1, (m.shape[2] - 1) * m.fine + 1
    first, e, f, g = corner(u * m.fine, v * m.fine, w * m.fine, n0, n1, n2)
    return first, e, f, g, n1, n2


@entry
def add_light(m, k, walk, light):
    """Add the stars' light at collision k to `light` (w,)."""
    for s in range(m.place.shape[0]):
        fall, last, share, far = face_star(m, k, s, walk)
        for i in range(light.size):
            tau, source = 0.0, 0.0
            for c in range(walk.column.size):
                tau += far * walk.toward[c] * m.sigma_t[c, i]
                p = (1 - share) * m.phase[c, last, i] + share * m.phase[c, last + 1, i]
                source += walk.rho[k, c] * m.sigma_s[c, i] * p
            light[i] += walk.base[k, i] * m.power[s, i] * fall * math.exp(-tau) * source


@entry
def draw_cosine(draws, c, u):
    """Cosine drawn by a tabulated phase function, which is linear in it between the nodes."""
    cdf, phase = draws.cdf[c], draws.phase[c]
    n = cdf.size - 1
    low = cell_of(cdf, 0, n, u)
    x = draw_in_cell(phase[low], phase[low + 1], cdf, low, u)
    mu_low, mu_high = 1.0 - 2.0 * (low / n) ** 2, 1.0 - 2.0 * ((low + 1) / n) ** 2
    return mu_low + x * (mu_high - mu_low)


@entry
def scatter(m, draws, k, d, walk):
    """New direction at collision k, into `d`; the throughput takes the phase functions over the density of the draw."""
    scattering = 0.0
    for c in range(walk.column.size):
        scattering += walk.rho[k, c] * draws.sigma_s[c]
    if not scattering > 0.0:
        return False
    u, v, w = uniform(walk.state), uniform(walk.state), uniform(walk.state)
    cosine = 1.0 - 2.0 * v
    if u >= EVEN_SHARE:
        rest = (u - EVEN_SHARE) / (1.0 - EVEN_SHARE) * scattering
        chosen = 0
        for c in range(walk.column.size):
            part = walk.rho[k, c] * draws.sigma_s[c]
            if part > 0.0:
                chosen = c
                if rest < part:
                    break
                rest -= part
        cosine = draw_cosine(draws, chosen, v)
    turn(d, cosine, 2.0 * math.pi * w)
    last, share = angle_cell(cosine, m.phase.shape[1] - 1)
    density = EVEN_SHARE / (4.0 * math.pi)
    for c in range(walk.column.size):
        p = (1 - share) * draws.phase[c, last] + share * draws.phase[c, last + 1]
        density += (1.0 - EVEN_SHARE) * walk.rho[k, c] * draws.sigma_s[c] / scattering * p
    for i in range(walk.value.size):
        source = 0.0
        for c in range(walk.column.size):
            p = (1 - share) * m.phase[c, last, i] + share * m.phase[c, last + 1, i]
            source += walk.rho[k, c] * m.sigma_s[c, i] * p
        walk.value[i] *= source / density
    return True


@entry
def wander(m, draws, origin, direction, derive, walk, light):
    """One walk: the light of the second and higher orders that it finds (w,); returns the number of its collisions.

    With `derive` it goes on from one place where there is nothing, as if there were something: what follows is no
    light, but tells what light a little more there would bring.
    """
    most, count = walk.begin.size, walk.value.size
    hero = min(int(uniform(walk.state) * count), count - 1)
    reference = 0.0
    walk.empty[0] = -1
    for i in range(count):
        walk.value[i], walk.chance[i] = 1.0, 1.0
    x, y = walk.start, walk.direction
    for a in range(3):
        x[0, a], y[0, a] = origin[a], direction[a]
    for k in range(most):
        steps = prepare_leg(m, x[k], y[k], k, walk)
        if steps == 0:
            return k
        fly(m, x[k], y[k], k, steps, hero, walk)
        if not collide(m, k, steps, walk):
            return k
        if k > 0 and walk.empty[0] < 0:
            add_light(m, k, walk, light)
        if is_empty(k, walk):
            if not derive or walk.empty[0] >= 0:
                return k + 1
            walk.empty[0] = k
            for c in range(walk.column.size):
                walk.rho[k, c] = draws.scale[c]
        if k + 1 == most:
            return most
        for a in range(3):
            x[k + 1, a], y[k + 1, a] = walk.place[k, a], y[k, a]
        if not scatter(m, draws, k, y[k + 1], walk):
            return k + 1
        largest = 0.0
        for i in range(count):
            largest = max(largest, walk.value[i])
        if k == 0:
            reference = largest  # also where there was nothing: the densities' scale stands for it
        elif k + 1 >= FIRST_ROULETTE:
            q = min(1.0, largest / (ROULETTE_LEVEL * reference))
            if uniform(walk.state) >= q:
                return k + 1
            for i in range(count):
                walk.value[i] /= q
        if not largest > 0.0:
            return k + 1
    return most


@entry
def replay(m, n, walk, weight, density, toward):
    """Go back along a walk of n collisions: add the derivatives of sum(weight light) to those of the tables.

    What follows a place with nothing in it is in proportion to the density there: it has a derivative by that alone.
    """
    later, own, empty = walk.by_w[0], walk.by_w[1], walk.empty[0]
    components, count = walk.column.size, weight.size
    for i in range(count):
        later[i] = 0.0
    for k in range(n - 1, -1, -1):
        for c in range(components):
            walk.by_c[c] = 0.0
        if k + 1 < n:
            onward_slope(m, k, walk, later)
        for i in range(count):
            own[i] = 0.0
        if k > 0:
            light_slope(m, k, walk, weight, own, toward, k >= empty >= 0)
        if k > empty >= 0:
            for i in range(count):
                later[i] += own[i]
            continue
        if k == empty:
            for i in range(count):
                later[i], own[i] = 0.0, 0.0
        for c in range(components):
            walk.column[c] = 0.0
            for i in range(count):
                walk.column[c] -= m.sigma_t[c, i] * (later[i] + own[i])
            # The density at the collision is that of its step.
            walk.by_c[c] += walk.flown[k] * walk.column[c]
        for i in range(count):
            later[i] += own[i]
        last = walk.number[k]
        spread(m, k, (last + 0.5) * walk.step[k], walk.by_c, walk, density)
        for c in range(components):
            walk.by_c[c] = walk.step[k] * walk.column[c]
        for j in range(last):
            spread(m, k, (j + 0.5) * walk.step[k], walk.by_c, walk, density)


@inlined
def spread(m, k, flown, amount, walk, density):
    """Add an amount (c,) to the nodes around a place on leg k."""
    u, v, w = cells(m, walk.start[k], walk.direction[k], walk.begin[k] + flown)
    first, e, f, g = corner(u, v, w, m.shape[0], m.shape[1], m.shape[2])
    add(density, first, e, f, g, m.shape[1], m.shape[2], amount)


@entry
def onward_slope(m, k, walk, later):
    """Add to ``walk.by_c`` what the scattering at collision k changes of the light of later ones."""
    a, b = walk.direction[k], walk.direction[k + 1]
    last, share = angle_cell(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], m.phase.shape[1] - 1)
    for i in range(later.size):
        source = 0.0
        for c in range(walk.column.size):
            p = (1 - share) * m.phase[c, last, i] + share * m.phase[c, last + 1, i]
            source += walk.rho[k, c] * m.sigma_s[c, i] * p
        per = later[i] / source if source > 0.0 else 0.0
        for c in range(walk.column.size):
            p = (1 - share) * m.phase[c, last, i] + share * m.phase[c, last + 1, i]
            walk.by_c[c] += per * m.sigma_s[c, i] * p


@entry
def light_slope(m, k, walk, weight, own, toward, no_light):
    """The stars' light at collision k, weighted, into `own` (w,); its derivatives to ``walk.by_c`` and `toward`.

    With `no_light` it is not there, but what it would be is wanted: dimming it changes nothing.
    """
    for s in range(m.place.shape[0]):
        fall, last, share, far = face_star(m, k, s, walk)
        for c in range(walk.column.size):
            walk.column[c] = 0.0
        for i in range(own.size):
            tau, source = 0.0, 0.0
            for c in range(walk.column.size):
                tau += far * walk.toward[c] * m.sigma_t[c, i]
            lit = weight[i] * walk.base[k, i] * m.power[s, i] * fall * math.exp(-tau)
            for c in range(walk.column.size):
                p = (1 - share) * m.phase[c, last, i] + share * m.phase[c, last + 1, i]
                walk.by_c[c] += lit * m.sigma_s[c, i] * p
                source += walk.rho[k, c] * m.sigma_s[c, i] * p
            own[i] += lit * source
            for c in range(walk.column.size):
                walk.column[c] -= far * m.sigma_t[c, i] * lit * source
        if not no_light:
            first, e, f, g, n1, n2 = column_cell(m, walk.place[k, 0], walk.place[k, 1], walk.place[k, 2])
            add(toward[:, s], first, e, f, g, n1, n2, walk.column)


@entry
def walk_rays(m, draws, origins, directions, first_ray, seed, batch, walks, weight, derive, walk,
              light, density, toward):  # fmt: skip
    """Mean light (ray, w) of walks along rays, and with `derive` the derivatives of sum(weight light)."""
    found, scaled = walk.by_w[2], np.float64(1.0 / walks)
    own = light.shape[1]
    for r in range(origins.shape[0]):
        for i in range(own):
            light[r, i] = 0.0
        for n in range(walks):
            start_stream(walk.state, seed, first_ray + r, batch * walks + n)
            for i in range(own):
                found[i] = 0.0
            collisions = wander(m, draws, origins[r], directions[r], derive, walk, found)
            for i in range(own):
                light[r, i] += scaled * found[i]
            if derive and collisions > 1:
                for i in range(own):
                    found[i] = scaled * weight[r, i]
                replay(m, collisions, walk, found, density, toward)
