"""Make data/moon_terms.csv: what ERFA's series of the Moon leaves out, fitted to JPL's integrated ephemeris DE421.

Needs pyerfa, jplephem and NASA's de421.bsp, which is in the public domain: python tools/make_moon_terms.py de421.bsp

ERFA's `moon98` (Meeus) is 3 arcsec and 3 km from DE421 in the mean, up to 18 and 13.  The differences in longitude and
latitude on the ecliptic of J2000 and in distance are written as sums of sines and cosines: of multiples of the four
Delaunay arguments first, as many as stand out, and then of plain frequencies, the largest in the Fourier transform of
what is left, which the planets cause.  No two may be so close that the 150 years do not tell them apart: such pairs
would go astray outside.  Fitted to the years before 2010 the terms are 0.6 arcsec and 1 km off in 2010 to 2050.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import product

import erfa
import numpy as np
from _table import write_table
from jplephem.spk import SPK

FIRST, LAST, STEP = 2415025.0, 2469800.0, 0.45
AU_KM, ARCSEC = 149597870.7, 206264.80625
TIMES = np.arange(FIRST, LAST, STEP)
DAYS = TIMES - 2451545.0
CENTURIES = DAYS / 36525.0
ARGUMENTS = tuple(f(CENTURIES) for f in (erfa.faf03, erfa.fad03, erfa.fal03, erfa.falp03))  # F, D, l, l'
RATES = [
    ((f(1 / 36525) - f(-1 / 36525) + np.pi) % (2 * np.pi) - np.pi) / 2
    for f in (erfa.faf03, erfa.fad03, erfa.fal03, erfa.falp03)
]
APART = 2 * np.pi / (LAST - FIRST)  # frequencies closer than this look alike
#: Coordinate, least amplitude of a term that is kept, rounds of plain frequencies.
COORDINATES = (("longitude", 0.012, 9), ("latitude", 0.012, 4), ("distance", 0.02, 4))
Term = tuple[int, int, int, int]


def differences(kernel: str) -> list[np.ndarray]:
    """DE421 minus moon98: longitude and latitude [arcsec], distance [km]."""
    file = SPK.open(kernel)
    ecliptic = erfa.ecm06(2451545.0, 0.0)
    integrated = (file[3, 301].compute(TIMES) - file[3, 399].compute(TIMES)).T @ ecliptic.T
    series = np.concatenate([erfa.moon98(part, 0.0)["p"] for part in np.array_split(TIMES, 20)]) * AU_KM @ ecliptic.T
    longitude = [np.arctan2(v[:, 1], v[:, 0]) for v in (integrated, series)]
    latitude = [np.arctan2(v[:, 2], np.hypot(v[:, 0], v[:, 1])) for v in (integrated, series)]
    distance = [np.linalg.norm(v, axis=1) for v in (integrated, series)]
    turned = (longitude[0] - longitude[1] + np.pi) % (2 * np.pi) - np.pi
    return [turned * ARCSEC, (latitude[0] - latitude[1]) * ARCSEC, distance[0] - distance[1]]


def multiples(values: np.ndarray, parity: int, least: float) -> list[Term]:
    """Multiples of the arguments that stand out, largest first; `parity` of that of F."""
    window = np.hanning(values.size)
    weighted = (values * window / window.sum()).astype(np.float32)
    waves = [np.exp(1j * argument).astype(np.complex64) for argument in ARGUMENTS]
    found = []
    for f, d, anomaly in product(range(parity, 5, 2), range(-8, 9), range(-7, 8)):
        base = weighted * waves[0] ** f * _power(waves[1], d) * _power(waves[2], anomaly)
        for sun in range(-4, 5):
            term = (f, d, anomaly, sun)
            first = next((k for k in term if k), 0)
            if first > 0 and sum(map(abs, term)) <= 14:
                found.append((2 * abs(base @ _power(waves[3], sun)), term))
    return [term for amplitude, term in sorted(found, reverse=True)[:260] if amplitude > 1.6 * least]


def _power(wave: np.ndarray, k: int) -> np.ndarray:
    return wave**k if k >= 0 else np.conj(wave) ** -k


def fit(values: np.ndarray, terms: Sequence[Term], plain: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Sine and cosine of each term, then the constant and the change per century; and what is left."""
    phases = [sum(k * a for k, a in zip(term, ARGUMENTS, strict=True)) for term in terms] + [w * DAYS for w in plain]
    rows = [wave(phase) for phase in phases for wave in (np.sin, np.cos)]
    matrix = np.stack([*rows, np.ones(DAYS.size), CENTURIES], axis=1)
    size, axes = np.linalg.eigh(matrix.T @ matrix)
    kept = size > 1e-6 * size.max()
    solution = axes[:, kept] @ ((axes[:, kept].T @ (matrix.T @ values)) / size[kept])
    return solution, values - matrix @ solution


def peaks(left: np.ndarray, count: int) -> list[float]:
    """The largest frequencies [rad per day] of a series, each taken out before the next is looked for."""
    window, length = np.hanning(left.size), 1 << 19
    found: list[float] = []
    for _ in range(count):
        spectrum = np.abs(np.fft.rfft((left - left.mean()) * window, length))
        top = int(spectrum[2:].argmax()) + 2
        a, b, c = np.log(spectrum[top - 1 : top + 2])
        rate = 2 * np.pi * (top + 0.5 * (a - c) / (a - 2 * b + c)) / length / STEP
        if any(abs(rate - other) < 1e-7 for other in found):
            break
        found.append(rate)
        waves = np.stack([np.sin(rate * DAYS), np.cos(rate * DAYS)], axis=1)
        left = left - waves @ np.linalg.lstsq(waves, left, rcond=None)[0]
    return found


def told_apart(plain: Sequence[float], terms: Sequence[Term]) -> list[float]:
    """Frequencies that are apart from those before them and from the multiples."""
    named = np.array([abs(np.dot(term, RATES)) for term in terms])
    kept: list[float] = []
    for rate in plain:
        if (
            rate > APART
            and np.all(np.abs(named - rate) > 0.6 * APART)
            and all(abs(rate - k) > 0.8 * APART for k in kept)
        ):
            kept.append(rate)
    return kept


def terms_of(values: np.ndarray, parity: int, least: float, rounds: int) -> list[tuple[float, ...]]:
    """Rows of the table for one coordinate: multiples of D, l', l, F, plain rate, sine, cosine."""
    terms = multiples(values, parity, least)
    solution, _ = fit(values, terms, [])
    amplitude = np.hypot(solution[0:-2:2], solution[1:-2:2])
    terms = [term for term, size in zip(terms, amplitude, strict=True) if size > least]
    plain: list[float] = []
    for _ in range(rounds + 3):
        solution, left = fit(values, terms, plain)
        plain = told_apart(plain + peaks(left, 18), terms)
    solution, left = fit(values, terms, plain)
    amplitude = np.hypot(solution[0:-2:2], solution[1:-2:2])
    count = len(terms)
    terms = [term for term, size in zip(terms, amplitude[:count], strict=True) if size > least]
    plain = [rate for rate, size in zip(plain, amplitude[count:], strict=True) if size > least]
    solution, left = fit(values, terms, plain)
    print(f"{len(terms)} multiples, {len(plain)} rates: left {left.std():.3f}, at most {np.abs(left).max():.3f}")
    pairs = solution[:-2].reshape(-1, 2)
    rows: list[tuple[float, ...]] = [(0, 0, 0, 0, 0.0, solution[-1], solution[-2])]
    rows += [(d, sun, moon, f, 0.0, *pair) for (f, d, moon, sun), pair in zip(terms, pairs, strict=False)]
    rows += [(0, 0, 0, 0, rate, *pair) for rate, pair in zip(plain, pairs[len(terms) :], strict=True)]
    return rows


def main() -> None:
    """Fit the three coordinates and write them into one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kernel", help="de421.bsp")
    rows = []
    for number, (values, (_, least, rounds)) in enumerate(
        zip(differences(parser.parse_args().kernel), COORDINATES, strict=True)
    ):
        rows += [(number, *row) for row in terms_of(values, number % 2, least, rounds)]
    write_table(
        "moon_terms.csv",
        [
            "Terms of the Moon's motion to add to ERFA's moon98: fitted to JPL's DE421 (public domain), 1900 to 2050;",
            "own work. coordinate: 0 longitude [arcsec], 1 latitude [arcsec], ecliptic of J2000, 2 distance [km]. A",
            "term is sine sin(x) + cosine cos(x) with x = d D + sun l' + moon l + node F + rate t: multiples of the",
            "Delaunay arguments (IERS 2003) and rate in radians a day, t from J2000. Rows without either: cosine",
            "constant, sine per century. Script: tools/make_moon_terms.py",
        ],
        ["row", "coordinate", "d", "sun", "moon", "node", "rate", "sine", "cosine"],
        [
            (
                f"{i}",
                *(f"{k}" for k in row[:5]),
                f"{row[5]:.10f}".rstrip("0").rstrip("."),
                f"{row[6]:.4f}",
                f"{row[7]:.4f}",
            )
            for i, row in enumerate(rows)
        ],
    )


if __name__ == "__main__":
    main()
