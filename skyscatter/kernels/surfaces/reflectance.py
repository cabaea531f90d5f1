"""How much a ground of any material reflects towards many rays, over what a white Lambertian one does."""

from __future__ import annotations

import math

from skyscatter.kernels.jit import entry
from skyscatter.kernels.surfaces.bsdf import bsdf_value
from skyscatter.kernels.surfaces.mosaics import tile


@entry
def reflectance_factors(materials, points, normals, views, lights, irradiance, vacuum, spare, out):
    """Reflectance factors pi f of a surface of material 0, averaged over what shines: by its irradiance on the surface.

    Parameters
    ----------
    materials : MaterialTable
    points : (point, 3)
        In the frame of the map of a mosaic [m].
    normals, views : (point, 3)
        Unit vectors: of the surface, and to the observer.
    lights : (light, 3)
        Unit vectors to parts of what shines.
    irradiance : (light, wavelength)
        Of each part across its own direction.
    vacuum : (wavelength,)
        Refractive index before the ground: ones.
    spare : (2, wavelength)
        Scratch.
    out : (point, wavelength), output
        0 where nothing is above the horizon.
    """
    for j in range(points.shape[0]):
        n = normals[j]
        k = tile(materials, 0, points[j])
        for i in range(out.shape[1]):
            spare[1, i], out[j, i] = 0.0, 0.0
        for m in range(lights.shape[0]):
            cosine = n[0] * lights[m, 0] + n[1] * lights[m, 1] + n[2] * lights[m, 2]
            if not cosine > 0.0:
                continue
            bsdf_value(materials, k, n, views[j], lights[m], vacuum, vacuum, False, spare[0])
            for i in range(out.shape[1]):
                out[j, i] += math.pi * spare[0, i] * irradiance[m, i]
                spare[1, i] += cosine * irradiance[m, i]
        for i in range(out.shape[1]):
            if spare[1, i] > 0.0:
                out[j, i] /= spare[1, i]
