"""From reflectance above the atmosphere to that of the surface: gains and offsets that change smoothly over the image.

They lie at the centres of square cells and are interpolated between them, bilinearly, by the absolute place of a pixel:
what a window holds besides has no influence.
"""

from __future__ import annotations

import math

import numpy as np

from skyscatter.kernels.jit import entry


def correct(values, row0, col0, size, gain, offset, bend, out, clipped):
    """Surface reflectance of a window; what would be negative is set to 0 and marked.

    Parameters
    ----------
    values : float32 (band, y, x)
        Reflectance above the atmosphere; NaN stays.
    row0, col0 : int
        Place of the window in the image.
    size : int
        Pixels on a side of a cell.
    gain, offset : float32 (band, row, column)
        At the centres of cells.
    bend : float32 (band, row, column)
        S in rho / (1 + S rho), where a pixel counts as its own surroundings; no rows where it does not.
    out : float32 (band, y, x)
        Result; may be `values`.
    clipped : bool (y, x)
        Set where a band was negative.
    """
    width = values.shape[2]
    row, column, share = np.zeros((3, gain.shape[2] + 1), np.float32), np.empty(width, int), np.empty(width, np.float32)
    correct_rows(values, row0, col0, size, gain, offset, bend, row, column, share, out, clipped)


@entry
def correct_rows(values, row0, col0, size, gain, offset, bend, row, column, share, out, clipped):
    """The same, with room for gains, offsets and bends (3, column + 1) of a row, and for where its pixels lie."""
    bands, height, width = values.shape
    rows, cols = gain.shape[1], gain.shape[2]
    g, o, q = row[0], row[1], row[2]
    bends = bend.shape[1] > 0
    for x in range(width):
        place = min(max((col0 + x + 0.5) / size - 0.5, 0.0), cols - 1.0)
        column[x] = int(place)
        share[x] = place - column[x]
    for y in range(height):
        place = min(max((row0 + y + 0.5) / size - 0.5, 0.0), rows - 1.0)
        j = int(place)
        k, f = min(j + 1, rows - 1), np.float32(place - j)
        for b in range(bands):
            for i in range(cols):
                g[i] = gain[b, j, i] + f * (gain[b, k, i] - gain[b, j, i])
                o[i] = offset[b, j, i] + f * (offset[b, k, i] - offset[b, j, i])
                if bends:
                    q[i] = bend[b, j, i] + f * (bend[b, k, i] - bend[b, j, i])
            g[cols], o[cols], q[cols] = g[cols - 1], o[cols - 1], q[cols - 1]
            for x in range(width):
                i, s = column[x], share[x]
                rho = values[b, y, x] * (g[i] + s * (g[i + 1] - g[i])) + (o[i] + s * (o[i + 1] - o[i]))
                if bends:
                    rho /= np.float32(1.0) + (q[i] + s * (q[i + 1] - q[i])) * rho
                if rho < 0.0:
                    rho = np.float32(0.0)
                    clipped[y, x] = True
                out[b, y, x] = rho


@entry
def spread(values, row0, col0, size, gain, offset, bend, haze, model, floor, relative, out):
    """Standard deviation of what `correct` gives.

    Parameters
    ----------
    values, row0, col0, size, gain, offset, bend
        As for `correct`.
    haze : float32 (2, band, row, column)
        Factor of the value, and constant, of the deviation that the haze may cause.
    model : float32 (model, 2, band, row, column)
        The same of those that models of the aerosol cause, each times the root of the model's probability.
    floor : float32 (band, row, column)
        Deviation that is always there.
    relative : float32 (band,)
        Deviation as a part of the result: of the gases.
    out : float32 (band, y, x)
        Result; NaN where `values` is.
    """
    bands, height, width = values.shape
    rows, cols = gain.shape[1], gain.shape[2]
    for b in range(bands):
        for y in range(height):
            py = min(max((row0 + y + 0.5) / size - 0.5, 0.0), rows - 1.0)
            j = int(py)
            k, f = min(j + 1, rows - 1), py - j
            for x in range(width):
                px = min(max((col0 + x + 0.5) / size - 0.5, 0.0), cols - 1.0)
                i = int(px)
                n, s = min(i + 1, cols - 1), px - i
                w00, w01, w10, w11 = (1 - f) * (1 - s), (1 - f) * s, f * (1 - s), f * s
                v = values[b, y, x]
                total = 0.0
                for m in range(-1, model.shape[0]):
                    table = haze if m < 0 else model[m]
                    a = (
                        w00 * (table[0, b, j, i] * v + table[1, b, j, i])
                        + w01 * (table[0, b, j, n] * v + table[1, b, j, n])
                        + w10 * (table[0, b, k, i] * v + table[1, b, k, i])
                        + w11 * (table[0, b, k, n] * v + table[1, b, k, n])
                    )
                    total += a * a
                g = w00 * gain[b, j, i] + w01 * gain[b, j, n] + w10 * gain[b, k, i] + w11 * gain[b, k, n]
                o = w00 * offset[b, j, i] + w01 * offset[b, j, n] + w10 * offset[b, k, i] + w11 * offset[b, k, n]
                low = w00 * floor[b, j, i] + w01 * floor[b, j, n] + w10 * floor[b, k, i] + w11 * floor[b, k, n]
                rho, slope = g * v + o, 1.0
                if bend.shape[1] > 0:
                    q = w00 * bend[b, j, i] + w01 * bend[b, j, n] + w10 * bend[b, k, i] + w11 * bend[b, k, n]
                    slope = 1.0 / (1.0 + q * rho) ** 2
                r = relative[b] * rho
                out[b, y, x] = slope * math.sqrt(total + low * low + r * r)
