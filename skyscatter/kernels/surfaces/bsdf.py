"""What surfaces do to light: drawn directions, values, densities.

`n` is the outward normal of the body, `wo` = minus the direction of the walk and `wi` the new direction, both away
from the surface.  *Here* is the medium on the side of `wo`, *there* that on the other side.  Values are those of
f |cos(n, wi)|, for every wavelength; of directions that are no matter of chance (DELTA) the coefficient itself.

Camera walks carry radiance, which refraction from there to here multiplies by (index here / index there)^2; photons
(`adjoint`) carry power and do not take that factor (Veach 1997, thesis, section 5.2).

Densities are per solid angle and under each hero.  Smooth refraction by indices that depend on the wavelength takes
each hero elsewhere: all others then have value and chance 0.
"""

from __future__ import annotations

import math

from skyscatter.kernels.codes.surfaces import (
    ABSORBED,
    CONDUCTOR,
    DELTA,
    DIELECTRIC,
    INTERFACE,
    LAMBERT,
    MIRROR,
    REFLECTED,
    ROSS_LI,
    RPV,
    SEA,
    TRANSMITTED,
)
from skyscatter.kernels.jit import entry, inlined, kernel, merged
from skyscatter.kernels.surfaces.facets import (
    after_more,
    between_facets,
    draw_lost,
    lost_share,
    passed_share,
)
from skyscatter.kernels.surfaces.fresnel import fresnel_conductor, fresnel_dielectric
from skyscatter.kernels.surfaces.ggx import draw_normal, reflected_lobe, refracted_lobe, smith_lambda
from skyscatter.kernels.surfaces.grounds import LEVEL_SHARE, draw_sea, ground_density, ground_value, mirror_share


@inlined
def dot(a, b):
    """Scalar product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def is_delta(materials, k):
    """Whether a material has no directions but those that are no matter of chance."""
    return materials.kind[k] != LAMBERT and materials.kind[k] < RPV and materials.roughness[k] == 0.0


@inlined
def same(index_here, index_there, i):
    """Whether wavelength i meets the same indices as the one before it."""
    return i > 0 and index_here[i] == index_here[i - 1] and index_there[i] == index_there[i - 1]


@inlined
def metal_value(materials, k, i, here, facet, lobe, broad):
    """Both lobes of a conductor, with what each absorbs."""
    re, im = materials.index[k, i] / here, materials.absorption[k, i] / here
    value = fresnel_conductor(facet, re, im) * lobe
    return value + broad * after_more(re, im, materials.lost_mean[k, -1]) if broad > 0.0 else value


@inlined
def glass_back(materials, k, here, there, cos_o, cosine, facet, lobe):
    """What rough glass reflects, which is the density that draws it as well."""
    share, _ = fresnel_dielectric(facet, here, there)
    return share * lobe + between_facets(materials, k, here, there, cos_o, cosine)


@inlined
def glass_through(materials, k, n, side, wo, wi, cosine, here, there):
    """What rough glass lets through of photons, which is the density that draws it as well."""
    lobe, facet = refracted_lobe(materials.roughness[k], n, side, wo, wi, here, there)
    share, _ = fresnel_dielectric(facet, here, there)
    return (1.0 - share) * lobe + between_facets(materials, k, here, there, side * dot(n, wo), cosine)


@inlined
def as_radiance(here, there, adjoint):
    """What refraction makes of radiance, not of photons."""
    return 1.0 if adjoint else (here / there) ** 2


@kernel
def evaluate_bsdf(materials, k, n, wo, wi, index_here, index_there, adjoint, value, chance):
    """`bsdf_value` and `bsdf_pdf` at once, into `value` and `chance` (wavelength,)."""
    kind, alpha, last = materials.kind[k], materials.roughness[k], value.size
    for i in range(last):
        value[i], chance[i] = 0.0, 0.0
    side = 1.0 if dot(n, wo) >= 0.0 else -1.0
    cosine = side * dot(n, wi)
    if kind >= RPV:
        ground_value(materials, k, n, side, wo, wi, index_here, value)
        ground_density(materials, k, n, side, wo, wi, index_here, chance)
    elif kind == LAMBERT:
        if cosine > 0.0:
            for i in range(last):
                value[i], chance[i] = materials.reflectance[k, i] * cosine / math.pi, cosine / math.pi
    elif alpha > 0.0 and cosine > 0.0:
        lobe, facet = reflected_lobe(alpha, n, side, wo, wi)
        if kind == CONDUCTOR:
            broad = between_facets(materials, k, 1.0, 0.0, side * dot(n, wo), cosine)
            for i in range(last):
                value[i] = metal_value(materials, k, i, index_here[i], facet, lobe, broad)
                chance[i] = lobe + broad
        else:
            for i in range(last):
                if same(index_here, index_there, i):
                    value[i] = value[i - 1]
                else:
                    value[i] = glass_back(
                        materials, k, index_here[i], index_there[i], side * dot(n, wo), cosine, facet, lobe
                    )  # fmt: skip
                chance[i] = value[i]
    elif alpha > 0.0 and kind == DIELECTRIC:
        for i in range(last):
            if same(index_here, index_there, i):
                chance[i] = chance[i - 1]
            else:
                chance[i] = glass_through(materials, k, n, side, wo, wi, cosine, index_here[i], index_there[i])
            value[i] = chance[i] * as_radiance(index_here[i], index_there[i], adjoint)


@kernel
def bsdf_value(materials, k, n, wo, wi, index_here, index_there, adjoint, out):
    """Value f |cos(n, wi)| without the parts that are no matter of chance, into `out` (wavelength,) [sr-1]."""
    kind, alpha = materials.kind[k], materials.roughness[k]
    side = 1.0 if dot(n, wo) >= 0.0 else -1.0
    cosine = side * dot(n, wi)
    if kind >= RPV:
        ground_value(materials, k, n, side, wo, wi, index_here, out)
    elif kind == LAMBERT:
        for i in range(out.size):
            out[i] = materials.reflectance[k, i] * max(cosine, 0.0) / math.pi
    elif alpha == 0.0 or (cosine <= 0.0 and kind != DIELECTRIC):
        for i in range(out.size):
            out[i] = 0.0
    elif kind == CONDUCTOR:
        lobe, facet = reflected_lobe(alpha, n, side, wo, wi)
        broad = between_facets(materials, k, 1.0, 0.0, side * dot(n, wo), cosine)
        for i in range(out.size):
            out[i] = metal_value(materials, k, i, index_here[i], facet, lobe, broad)
    else:
        bsdf_pdf(materials, k, n, wo, wi, index_here, index_there, out)
        if cosine <= 0.0:
            for i in range(out.size):
                out[i] *= as_radiance(index_here[i], index_there[i], adjoint)


@kernel
def bsdf_pdf(materials, k, n, wo, wi, index_here, index_there, out):
    """Density [sr-1] with which `sample_bsdf` draws `wi` under each hero, into `out` (wavelength,)."""
    kind, alpha = materials.kind[k], materials.roughness[k]
    side = 1.0 if dot(n, wo) >= 0.0 else -1.0
    cosine = side * dot(n, wi)
    if kind >= RPV:
        ground_density(materials, k, n, side, wo, wi, index_here, out)
        return
    lobe, facet, broad = 0.0, 0.0, 0.0
    if alpha > 0.0 and cosine > 0.0:
        lobe, facet = reflected_lobe(alpha, n, side, wo, wi)
        if kind == CONDUCTOR:
            broad = between_facets(materials, k, 1.0, 0.0, side * dot(n, wo), cosine)
    for i in range(out.size):
        if kind == LAMBERT:
            out[i] = max(cosine, 0.0) / math.pi
        elif kind != DIELECTRIC or alpha == 0.0:
            out[i] = lobe + broad
        elif same(index_here, index_there, i):
            out[i] = out[i - 1]
        elif cosine > 0.0:
            out[i] = glass_back(
                materials, k, index_here[i], index_there[i], side * dot(n, wo), cosine, facet, lobe
            )  # fmt: skip
        else:
            out[i] = glass_through(materials, k, n, side, wo, wi, cosine, index_here[i], index_there[i])


@inlined
def frame_of(x, y, z):
    """Two unit vectors across a unit vector, without a singularity (Duff et al. 2017, JCGT 6, 1)."""
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return 1.0 + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y


@merged
def draw_around(n, side, z, v, wi):
    """A direction at the cosine z from `side` n, turned by the even number v, into `wi`."""
    r = math.sqrt(max(1.0 - z * z, 0.0))
    x, y = r * math.cos(2.0 * math.pi * v), r * math.sin(2.0 * math.pi * v)
    tx, ty, tz, bx, by, bz = frame_of(n[0], n[1], n[2])
    wi[0] = x * tx + y * bx + side * z * n[0]
    wi[1] = x * ty + y * by + side * z * n[1]
    wi[2] = x * tz + y * bz + side * z * n[2]


@merged
def draw_facet(alpha, n, side, wo, u, v, m):
    """Normal of a facet as seen from `wo`, into `m` (3,); that of the surface where it is smooth."""
    if alpha == 0.0:
        for i in range(3):
            m[i] = side * n[i]
        return
    tx, ty, tz, bx, by, bz = frame_of(n[0], n[1], n[2])
    ox, oy = wo[0] * tx + wo[1] * ty + wo[2] * tz, wo[0] * bx + wo[1] * by + wo[2] * bz
    x, y, z = draw_normal(alpha, ox, oy, max(side * dot(n, wo), 1e-300), u, v)
    m[0] = x * tx + y * bx + side * z * n[0]
    m[1] = x * ty + y * by + side * z * n[1]
    m[2] = x * tz + y * bz + side * z * n[2]


@inlined
def seen_share(alpha, n, side, wo, wi, reflected):
    """Chance that no other facet is in the way of light that leaves one of them, as in the lobes of `ggx`."""
    out = dot(n, wi) * (side if reflected else -side)
    if out <= 0.0:
        return 0.0
    ways = 1.0 + smith_lambda(alpha, side * dot(n, wo)) if reflected else 1.0
    return ways / (ways + smith_lambda(alpha, out))


@merged
def leave_facets(materials, k, n, side, wo, here, there, reflected, w, p, q, wi):
    """Light that has left a facet towards `wi`: 1 if it ends up on its own side, -1 on the other one, 0 if it is lost.

    What meets other facets leaves in a new direction; it is lost where that is too little to be made up for.
    """
    seen = seen_share(materials.roughness[k], n, side, wo, wi, reflected)
    if w < seen:
        return 1.0 if reflected else -1.0
    if materials.lost_mean[k, 0] == 0.0:
        return 0.0
    _, mine = lost_share(materials, k, here, there, 1.0)
    _, other = lost_share(materials, k, there, here, 1.0)
    if w - seen < (1.0 - seen) * passed_share(here, there, mine, other):
        draw_around(n, -side, draw_lost(materials, k, there, here, p), q, wi)
        return -1.0
    draw_around(n, side, draw_lost(materials, k, here, there, p), q, wi)
    return 1.0


@merged
def go_straight(hero, dispersive, wo, wi, value, chance):
    """Passage without a change of direction: no boundary, or one between equal indices."""
    for i in range(3):
        wi[i] = -wo[i]
    for i in range(value.size):
        stays = not dispersive or i == hero
        value[i], chance[i] = (1.0, 1.0) if stays else (0.0, 0.0)


@merged
def follow_facet(wi, wo, reflected, cosine, beyond, ratio):
    """Turn `wi`, which holds a facet's normal, into the reflected or the refracted direction."""
    along = 2.0 * cosine if reflected else ratio * cosine - beyond
    back = 1.0 if reflected else ratio
    for i in range(3):
        wi[i] = along * wi[i] - back * wo[i]
    norm = 1.0 / math.sqrt(dot(wi, wi))
    for i in range(3):
        wi[i] *= norm


@merged
def smooth_terms(
    materials, k, hero, reflected, cosine, index_here, index_there, dispersive, adjoint, value, chance
):  # fmt: skip
    """Coefficients and probabilities of a smooth surface."""
    kind = materials.kind[k]
    for i in range(value.size):
        here, there = index_here[i], index_there[i]
        if kind == MIRROR:
            value[i], chance[i] = materials.reflectance[k, i], 1.0
        elif kind == CONDUCTOR:
            value[i] = fresnel_conductor(cosine, materials.index[k, i] / here, materials.absorption[k, i] / here)
            chance[i] = 1.0
        else:
            share, _ = fresnel_dielectric(cosine, here, there)
            if reflected:
                value[i], chance[i] = share, share
            elif dispersive and i != hero:
                value[i], chance[i] = 0.0, 0.0
            else:
                value[i] = (1.0 - share) * (1.0 if adjoint else (here / there) ** 2)
                chance[i] = 1.0 - share


@kernel
def sample_bsdf(
    materials, k, hero, n, wo, u, v, w, p, q, index_here, index_there, dispersive, adjoint, wi, value, chance
):  # fmt: skip
    """Draw what becomes of light at a surface.

    Parameters
    ----------
    materials : MaterialTable
    k : int
        Row of it.
    hero : int
        Wavelength that decides.
    n, wo : (3,)
        See the module.
    u, v, w, p, q : float
        Random numbers in [0, 1): two of the direction, one of what happens, two of light that meets several facets.
    index_here, index_there : (wavelength,)
    dispersive : bool
        Whether the ratio of the indices depends on the wavelength.
    adjoint : bool
        Whether power is carried (photons), not radiance.
    wi : (3,), output
        The new direction.
    value, chance : (wavelength,), output
        f |cos| and density of `wi` under each hero; after DELTA coefficient and probability.

    Returns
    -------
    int
        ABSORBED, REFLECTED or TRANSMITTED, plus DELTA.  ABSORBED leaves value and chance 0.
    """
    kind, alpha = materials.kind[k], materials.roughness[k]
    side = 1.0 if dot(n, wo) >= 0.0 else -1.0
    here, there = index_here[hero], index_there[hero]
    if kind == INTERFACE or (kind == DIELECTRIC and here == there):
        go_straight(hero, dispersive and kind == DIELECTRIC, wo, wi, value, chance)
        return TRANSMITTED + DELTA
    to, cosine = 1.0, 0.0
    if kind == SEA:
        mirrors = mirror_share(materials, k, hero, here, min(side * dot(n, wo), 1.0))
        if w < mirrors:
            draw_sea(materials, k, n, side, wo, u, v, wi)
        else:
            draw_around(n, side, math.sqrt(max(u, 1e-18)), v, wi)
    elif kind == LAMBERT or kind == RPV or kind == ROSS_LI:
        level = kind == ROSS_LI and w < LEVEL_SHARE
        draw_around(n, side, max(u, 1e-9) if level else math.sqrt(max(u, 1e-18)), v, wi)
    else:
        draw_facet(alpha, n, side, wo, u, v, wi)
        cosine = min(max(dot(wi, wo), 0.0), 1.0)
        share, beyond = fresnel_dielectric(cosine, here, there)
        if kind == DIELECTRIC:
            to = 1.0 if w < share else -1.0
            w = w / share if w < share else (w - share) / (1.0 - share)
        follow_facet(wi, wo, to > 0.0, cosine, beyond, here / there)
        if alpha > 0.0:
            there = there if kind == DIELECTRIC else 0.0
            to = leave_facets(materials, k, n, side, wo, here, there, to > 0.0, w, p, q, wi)
    event = REFLECTED if to > 0.0 else TRANSMITTED
    if is_delta(materials, k):
        smooth_terms(
            materials, k, hero, to > 0.0, cosine, index_here, index_there, dispersive, adjoint, value, chance
        )  # fmt: skip
        return event + DELTA
    evaluate_bsdf(materials, k, n, wo, wi, index_here, index_there, adjoint, value, chance)
    if side * to * dot(n, wi) > 0.0 and chance[hero] > 0.0:
        return event
    for i in range(value.size):
        value[i], chance[i] = 0.0, 0.0
    return ABSORBED


@entry
def sample_bsdfs(
    materials, k, hero, n, wo, numbers, index_here, index_there, dispersive, adjoint, wi, values, chances, events
):  # fmt: skip
    """`sample_bsdf` for many random numbers (draw, 5): wi (draw, 3), values, chances (draw, wavelength), events."""
    for j in range(numbers.shape[0]):
        events[j] = sample_bsdf(
            materials, k, hero, n, wo, numbers[j, 0], numbers[j, 1], numbers[j, 2], numbers[j, 3], numbers[j, 4],
            index_here, index_there, dispersive, adjoint, wi[j], values[j], chances[j],
        )  # fmt: skip


@entry
def bsdf_values(materials, k, n, wo, wi, index_here, index_there, adjoint, values, chances, both):
    """`bsdf_value` and `bsdf_pdf` for many directions wi (draw, 3), and `evaluate_bsdf`, into both (2, draw, wl)."""
    for j in range(wi.shape[0]):
        bsdf_value(materials, k, n, wo, wi[j], index_here, index_there, adjoint, values[j])
        bsdf_pdf(materials, k, n, wo, wi[j], index_here, index_there, chances[j])
        evaluate_bsdf(materials, k, n, wo, wi[j], index_here, index_there, adjoint, both[0, j], both[1, j])
