"""Inner loops for pictures: statistics of cells, and taking a veil off.

Light is A + (J - A) t with J what a clear view would show, t the veil's transmittance and A its own colour, so that
J = A + (I - A) g with the gain g = 1/t.  Gains are interpolated between the centres of cells at absolute positions: a
pixel's result depends on nothing but itself and the lattice.
"""

from __future__ import annotations

from skyscatter.kernels.jit import entry, inlined

# Bins over the scale from which the low and the high end of a cell are read.
BINS = 1024


@inlined
def lookup(table, x):
    """Value of a table with nodes from 0 to 1; beyond them the end."""
    last = table.shape[0] - 1
    u = x * last
    if not u > 0.0:
        return table[0]
    i = int(u)
    if i >= last:
        return table[last]
    return table[i] + (u - i) * (table[i + 1] - table[i])


@inlined
def _rank(counts, rank):
    """Bin that holds the value of a rank."""
    seen = 0
    for k in range(counts.shape[0]):
        seen += counts[k]
        if seen > rank:
            return k
    return counts.shape[0] - 1


@entry
def cell_statistics(
    window, decoding, cell, tail, saturation, white, counts, low, high, mean, variance, brightest, darkest, number
):
    """Statistics of whole cells; pixels with a band that is not a number, or at the end of its scale, and
    pixels that are ``white`` in all bands (clouds: they stand above the veil), are left out.

    ``window`` is (bands, h, w) float32, ``counts`` scratch of (bands, BINS) integers; the outputs are (bands, rows,
    columns) or (rows, columns): values at the ranks ``tail`` and 1 - ``tail``, means and variances of the light, means
    of the brightest and of the darkest band of a pixel, and how many pixels were used.
    """
    bands, height, width = window.shape
    rows, columns = number.shape
    for r in range(rows):
        for c in range(columns):
            for b in range(bands):
                for k in range(BINS):
                    counts[b, k] = 0
                mean[b, r, c] = 0.0
                variance[b, r, c] = 0.0
            top = 0.0
            bottom = 0.0
            used = 0
            for y in range(r * cell, min((r + 1) * cell, height)):
                for x in range(c * cell, min((c + 1) * cell, width)):
                    good = True
                    dimmest = 2.0
                    for b in range(bands):
                        if not -1.0 < window[b, y, x] < saturation:
                            good = False
                        dimmest = min(dimmest, window[b, y, x])
                    if dimmest > white:
                        good = False
                    if not good:
                        continue
                    used += 1
                    most = -1.0
                    least = 2.0
                    for b in range(bands):
                        value = window[b, y, x]
                        counts[b, max(0, min(BINS - 1, int(value * BINS)))] += 1
                        light = float(lookup(decoding, value))
                        mean[b, r, c] += light
                        variance[b, r, c] += light * light
                        most = max(most, light)
                        least = min(least, light)
                    top += most
                    bottom += least
            number[r, c] = used
            if used == 0:
                continue
            brightest[r, c] = top / used
            darkest[r, c] = bottom / used
            rank = int(tail * used)
            for b in range(bands):
                m = mean[b, r, c] / used
                mean[b, r, c] = m
                variance[b, r, c] = max(0.0, variance[b, r, c] / used - m * m)
                low[b, r, c] = lookup(decoding, (_rank(counts[b], rank) + 0.5) / BINS)
                high[b, r, c] = lookup(decoding, (_rank(counts[b], used - 1 - rank) + 0.5) / BINS)


@inlined
def _blend_row(field, row, cell, out):
    """A lattice's values along the centres of cells, between the two rows of cells about a row of pixels."""
    rows, columns = field.shape
    v = (row + 0.5) / cell - 0.5
    i = min(max(int(v), 0), rows - 1)
    j = min(i + 1, rows - 1)
    w = min(max(v - i, 0.0), 1.0)
    for c in range(columns):
        out[c] = (1.0 - w) * field[i, c] + w * field[j, c]


@entry
def take_off(
    window, row0, col0, cell, gains, airlight, decoding, encoding, curved, knee, saturation, scratch, out, flags, marks
):
    """Clean pixels of a window of (bands, h, w) float32 whose corner is at an absolute row and column.

    ``gains`` is (bands, rows, columns), ``scratch`` (bands, columns); ``marks`` are the bits for no data,
    saturated, cloud, water and clipped.  What would exceed 1 is compressed from ``knee`` upwards, all bands of a pixel
    by one factor.
    """
    bands, height, width = window.shape
    columns = gains.shape[2]
    for y in range(height):
        for b in range(bands):
            _blend_row(gains[b], row0 + y, cell, scratch[b])
        for x in range(width):
            flag = 0
            for b in range(bands):
                value = window[b, y, x]
                if value != value:
                    flag = marks[0]
                elif value >= saturation and flag != marks[0]:
                    flag = marks[1]
            if flag == marks[0]:
                for b in range(bands):
                    out[b, y, x] = float("nan")
                flags[y, x] = flag
                continue
            u = (col0 + x + 0.5) / cell - 0.5
            i = min(max(int(u), 0), columns - 1)
            j = min(i + 1, columns - 1)
            w = min(max(u - i, 0.0), 1.0)
            brightest = 0.0
            limit = 0.0
            for b in range(bands):
                gain = (1.0 - w) * scratch[b, i] + w * scratch[b, j]
                value = min(max(window[b, y, x], 0.0), 1.0)
                light = lookup(decoding, value) if curved else value
                clear = airlight[b] + (light - airlight[b]) * gain
                limit = max(limit, airlight[b] + (1.0 - airlight[b]) * gain)
                if clear < 0.0:
                    # Half a step of 8 bits is rounding, not an error of the veil.
                    if clear < -0.002:
                        flag |= marks[4]
                    clear = 0.0
                brightest = max(brightest, clear)
                out[b, y, x] = clear
            if limit > 1.0 and brightest > knee:
                excess = brightest - knee
                bend = 1.0 / (1.0 - knee) - 1.0 / (limit - knee)
                factor = min((knee + excess / (1.0 + excess * bend)) / brightest, 1.0 / brightest)
                for b in range(bands):
                    out[b, y, x] *= factor
            most = 0.0
            least = 1.0
            for b in range(bands):
                clear = out[b, y, x]
                if curved:
                    clear = lookup(encoding, clear**0.5)
                    out[b, y, x] = clear
                most = max(most, clear)
                least = min(least, clear)
            if least > 0.75 and most - least < 0.12 * most:
                flag |= marks[2]
            elif (
                bands == 3 and most < 0.35 and out[2, y, x] > 1.3 * out[0, y, x] and out[1, y, x] < 1.15 * out[2, y, x]
            ):
                flag |= marks[3]
            flags[y, x] = flag
