"""Voxel grids: the density at a point, the exact column along a line, and bounds within boxes.

A leaf `VOXELS` has, after its affine map, the six parameters `low, high` of its support in the grid's own frame, and
the integers `place of the data, walked cells (3), repeats (3), smooth, places along x, along y, along z`.  In the
grid's own frame cells have a side of 1.  Two kinds:

- smooth: the stored numbers are nodes, cell i of the walk lies between the nodes i and i + 1, and within it the density
  is trilinear.  The values outside the outermost cells are stored too, so no kernel asks about edges.
- not smooth: the stored numbers are the densities of the cells.

Number (x, y, z) is found at the sum of three places, one for each axis (one more than there are cells).  So the order
of the numbers is free, and neighbours in space can be neighbours in memory, whatever a line's direction: a column
through 128^3 to 256^3 cells then takes some 25 % less time than in C order, when the lines have nothing to do with
each other.

Along a line a trilinear density is a cubic: with its middle m, half-length vector (a, b, c) and the mixed second
derivatives at m, its mean over a cell is f(m) + (f_xy ab + f_xz ac + f_yz bc) / 3, without any further error.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.gridwalk import face_distance, start_axis
from skyscatter.kernels.jit import entry, inlined, kernel


@inlined
def clip_axis(low, high, x, d, ta, tb):
    """The part of [ta, tb] in which x + d t lies between low and high, which may be infinite."""
    if abs(d) < 1e-280:
        return (ta, tb) if low <= x <= high else (math.inf, -math.inf)
    t0, t1 = (low - x) / d, (high - x) / d
    return max(ta, min(t0, t1)), min(tb, max(t0, t1))


@inlined
def trilinear_mean(data, x0, x1, y0, y1, z0, z1, a, b, c, ab, ac, bc):
    """Mean of the density over a piece of a line within a cell.

    `x0` to `z1` are the places of the cell's nodes along each axis; `a, b, c` is the middle of the piece in fractions
    of the cell; `ab`, `ac`, `bc` are a third of the products of the components of half the piece.
    """
    # Unsigned numbers of places: signed ones are asked whether they count from the end.
    w0, w1 = np.uint64(z0), np.uint64(z1)
    p00, p01, p10, p11 = np.uint64(x0 + y0), np.uint64(x0 + y1), np.uint64(x1 + y0), np.uint64(x1 + y1)
    v00, v01 = np.float64(data[p00 + w0]), np.float64(data[p01 + w0])
    v10, v11 = np.float64(data[p10 + w0]), np.float64(data[p11 + w0])
    # In double precision: differences in single would not be those of the same density in the next cell.
    g00, g01 = np.float64(data[p00 + w1]) - v00, np.float64(data[p01 + w1]) - v01
    g10, g11 = np.float64(data[p10 + w1]) - v10, np.float64(data[p11 + w1]) - v11
    e00, e01, e10, e11 = v00 + c * g00, v01 + c * g01, v10 + c * g10, v11 + c * g11
    # Slopes: E along y, g along z, G mixed in y and z.
    E0, E1, G0, G1 = e01 - e00, e11 - e10, g01 - g00, g11 - g10
    e0, e1, g0, g1 = e00 + b * E0, e10 + b * E1, g00 + b * G0, g10 + b * G1
    return e0 + a * (e1 - e0) + ab * (E1 - E0) + ac * (g1 - g0) + bc * (G0 + a * (G1 - G0))


@kernel
def voxel_density(p, i, data, at, j, x, y, z):
    """Density at a point of the model's frame.

    Parameters
    ----------
    p, i, data : ndarray
        `parameters`, `index` and `data` of a `SpaceTable`: passing the whole table would cost more than the arithmetic.
    at, j : int
        Where the leaf begins in p and in i.
    x, y, z : float
        [m]
    """
    u = p[at] * x + p[at + 1] * y + p[at + 2] * z + p[at + 3]
    v = p[at + 4] * x + p[at + 5] * y + p[at + 6] * z + p[at + 7]
    w = p[at + 8] * x + p[at + 9] * y + p[at + 10] * z + p[at + 11]
    if not (p[at + 12] <= u <= p[at + 15] and p[at + 13] <= v <= p[at + 16] and p[at + 14] <= w <= p[at + 17]):
        return 0.0
    nu, nv, nw = i[j + 1], i[j + 2], i[j + 3]
    cu, fu, _, _ = start_axis(u, 0.0, nu, i[j + 4] != 0)
    cv, fv, _, _ = start_axis(v, 0.0, nv, i[j + 5] != 0)
    cw, fw, _, _ = start_axis(w, 0.0, nw, i[j + 6] != 0)
    pu = j + 8 + cu
    pv = j + 9 + nu + cv
    pw = j + 10 + nu + nv + cw
    x0, y0, z0 = i[j] + i[pu], i[pv], i[pw]
    if i[j + 7] == 0:
        return float(data[np.uint64(x0 + y0 + z0)])
    x1, y1, z1 = i[j] + i[pu + 1], i[pv + 1], i[pw + 1]
    return trilinear_mean(data, x0, x1, y0, y1, z0, z1, u - fu, v - fv, w - fw, 0.0, 0.0, 0.0)


@kernel
def voxel_column(p, i, data, at, j, ox, oy, oz, dx, dy, dz, ta, tb):
    """Column along the line o + d t from ta to tb, cell by cell; exact.  The first five arguments: `voxel_density`."""
    # Counting from the point of entry loses nothing when a ray comes from afar.
    ox, oy, oz, tb = ox + ta * dx, oy + ta * dy, oz + ta * dz, tb - ta
    u = p[at] * ox + p[at + 1] * oy + p[at + 2] * oz + p[at + 3]
    v = p[at + 4] * ox + p[at + 5] * oy + p[at + 6] * oz + p[at + 7]
    w = p[at + 8] * ox + p[at + 9] * oy + p[at + 10] * oz + p[at + 11]
    du = p[at] * dx + p[at + 1] * dy + p[at + 2] * dz
    dv = p[at + 4] * dx + p[at + 5] * dy + p[at + 6] * dz
    dw = p[at + 8] * dx + p[at + 9] * dy + p[at + 10] * dz
    t, tb = clip_axis(p[at + 12], p[at + 15], u, du, 0.0, tb)
    t, tb = clip_axis(p[at + 13], p[at + 16], v, dv, t, tb)
    t, tb = clip_axis(p[at + 14], p[at + 17], w, dw, t, tb)
    if not t < tb:
        return 0.0
    nu, nv, nw = i[j + 1], i[j + 2], i[j + 3]
    cu, fu, iu, ru = start_axis(u + du * t, du, nu, i[j + 4] != 0)
    cv, fv, iv, rv = start_axis(v + dv * t, dv, nv, i[j + 5] != 0)
    cw, fw, iw, rw = start_axis(w + dw * t, dw, nw, i[j + 6] != 0)
    here = i[j]
    pu = j + 8
    pv = j + 9 + nu
    pw = j + 10 + nu + nv
    x0, x1, y0, y1 = here + i[pu + cu], here + i[pu + cu + 1], i[pv + cv], i[pv + cv + 1]
    z0, z1 = i[pw + cw], i[pw + cw + 1]
    # Faces: u counts from the lower one of the cell.
    qu, qv, qw = (1.0 if du > 0.0 else 0.0), (1.0 if dv > 0.0 else 0.0), (1.0 if dw > 0.0 else 0.0)
    u, v, w = u - fu, v - fv, w - fw
    tu, tv, tw = face_distance(qu, u, ru), face_distance(qv, v, rv), face_distance(qw, w, rw)
    smooth = i[j + 7] != 0
    uv, uw, vw = du * dv / 12.0, du * dw / 12.0, dv * dw / 12.0
    total = 0.0
    while t < tb:
        leave = max(min(tu, tv, tw, tb), t)
        length = leave - t
        if smooth:
            m, s = 0.5 * (t + leave), length * length
            total += length * trilinear_mean(
                data, x0, x1, y0, y1, z0, z1, u + du * m, v + dv * m, w + dw * m, uv * s, uw * s, vw * s
            )
        else:
            total += length * data[np.uint64(x0 + y0 + z0)]
        t = leave
        # At the end of the grid a number wraps around even where the grid does not repeat: rounding may leave a piece
        # of length zero there.
        if tu <= leave:
            cu += iu
            cu = 0 if cu >= nu else (nu - 1 if cu < 0 else cu)
            x0, x1 = here + i[pu + cu], here + i[pu + cu + 1]
            u -= iu
            tu = (qu - u) * ru
        if tv <= leave:
            cv += iv
            cv = 0 if cv >= nv else (nv - 1 if cv < 0 else cv)
            y0, y1 = i[pv + cv], i[pv + cv + 1]
            v -= iv
            tv = (qv - v) * rv
        if tw <= leave:
            cw += iw
            cw = 0 if cw >= nw else (nw - 1 if cw < 0 else cw)
            z0, z1 = i[pw + cw], i[pw + cw + 1]
            w -= iw
            tw = (qw - w) * rw
    return total


@entry
def box_extremes(low_data, high_data, shape, period, first, last, lowest, highest):
    """Lowest and highest of the numbers first to last (inclusive) along every axis, box by box.

    Parameters
    ----------
    low_data, high_data : ndarray, float32
        Numbers to take the lowest and the highest of, flat in C order; the same array or those of blocks.
    shape, period : ndarray, shape (3,), int64
        Number n stands for n - period where it is not below the shape.
    first, last : ndarray, shape (box, 3), int64
    lowest, highest : ndarray, shape (box,)
        Results.
    """
    for n in range(first.shape[0]):
        low, high = math.inf, -math.inf
        for i in range(first[n, 0], last[n, 0] + 1):
            x = i if i < shape[0] else i - period[0]
            for j in range(first[n, 1], last[n, 1] + 1):
                y = j if j < shape[1] else j - period[1]
                at = (x * shape[1] + y) * shape[2]
                for k in range(first[n, 2], last[n, 2] + 1):
                    z = at + (k if k < shape[2] else k - period[2])
                    low, high = min(low, low_data[z]), max(high, high_data[z])
        lowest[n], highest[n] = low, high
