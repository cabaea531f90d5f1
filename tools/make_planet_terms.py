"""Make data/planet_terms.csv: what ERFA's places of the planets leave out, fitted to JPL's integrated ephemeris DE421.

Needs pyerfa, scipy, jplephem and NASA's de421.bsp, in the public domain: python tools/make_planet_terms.py de421.bsp

`plan94` (Simon et al. 1994) has the planets to 2 (Mercury) to 97 arcsec (Saturn) as seen from the Earth.  The
differences in heliocentric longitude and latitude on the ecliptic of J2000 and in distance are written as a parabola
and sines and cosines of plain frequencies, the largest in the Fourier transform of what is left, no two closer than the
span tells apart.  DE421 ends in 2053; from 2052 to 2101 Venus and Mars to Neptune are integrated on from its state,
with the Sun's relativity, which backwards over as long a time finds DE421 again to 0.04 arcsec (Mars) and 0.01.
"""

from __future__ import annotations

import argparse

import erfa
import numpy as np
from _table import write_table
from jplephem.spk import SPK
from scipy.integrate import solve_ivp

FIRST, LAST, STEP = 2415025.0, 2488430.0, 4.0
HANDED_OVER = 2470900.0  # from here on our own integration
AU_KM, ARCSEC, LIGHT = 149597870.7, 206264.80625, 299792.458
#: Sun, Mercury, Venus, Earth and Moon, Mars to Neptune, Pluto as DE421 has them [km3 s-2], and their numbers there.
MASSES = np.array([
    132712440040.944, 22032.09, 324858.592, 403503.236, 42828.375, 126712764.8, 37940585.2, 5794548.6, 6836527.1, 977.0,
])  # fmt: skip
BODIES = (10, 1, 2, 3, 4, 5, 6, 7, 8, 9)
#: Planets by their number in plan94: least amplitude kept [arcsec], rounds of twelve frequencies.
PLANETS = {1: (0.3, 2), 2: (0.3, 2), 4: (0.3, 4), 5: (0.3, 4), 6: (0.3, 8), 7: (0.3, 3), 8: (0.3, 2)}


def heliocentric(file: SPK, number: int, times: np.ndarray) -> np.ndarray:
    """Vectors from the Sun to a planet [km] in the axes of ICRS, shape (time, 3)."""
    return (file[0, number].compute(times) - file[0, 10].compute(times)).T


def integrated(file: SPK, times: np.ndarray) -> np.ndarray:
    """The same for all bodies after DE421, shape (body, time, 3), by the attraction of all on all."""
    parts = [file[0, body].compute_and_differentiate(HANDED_OVER) for body in BODIES]
    start = np.concatenate([np.ravel([place for place, _ in parts]), np.ravel([speed for _, speed in parts]) / 86400.0])

    def change(_: float, state: np.ndarray) -> np.ndarray:
        place, speed = state.reshape(2, -1, 3)
        apart = place[None] - place[:, None]
        square = np.einsum("ijk,ijk->ij", apart, apart)
        np.fill_diagonal(square, 1.0)
        pull = (MASSES[None, :, None] * apart / square[..., None] ** 1.5).sum(axis=1)
        r, v = place[1:] - place[0], speed[1:] - speed[0]
        distance = np.linalg.norm(r, axis=1)[:, None]
        along = (4 * MASSES[0] / distance - (v * v).sum(axis=1)[:, None]) * r + 4 * (r * v).sum(axis=1)[:, None] * v
        pull[1:] += MASSES[0] / LIGHT**2 / distance**3 * along
        return np.concatenate([speed.ravel(), pull.ravel()])

    seconds = (times - HANDED_OVER) * 86400.0
    solution = solve_ivp(
        change, (0.0, seconds[-1]), start, method="DOP853", rtol=1e-11, atol=1e-3, t_eval=seconds
    )  # fmt: skip
    place = solution.y.T.reshape(times.size, 2, -1, 3)[:, 0]
    return np.moveaxis(place - place[:, :1], 1, 0)


def spherical(vectors: np.ndarray) -> np.ndarray:
    """Longitude, latitude [rad] on the ecliptic of J2000 and distance, shape (3, time)."""
    x, y, z = (vectors @ erfa.ecm06(2451545.0, 0.0).T).T
    return np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)), np.sqrt(x * x + y * y + z * z)])


def fit(values: np.ndarray, days: np.ndarray, rates: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Sines and cosines, then the parabola's constant, slope and square per century; and what is left."""
    centuries = days / 36525.0
    waves = [wave(rate * days) for rate in rates for wave in (np.sin, np.cos)]
    matrix = np.stack([*waves, np.ones(days.size), centuries, centuries**2], axis=1)
    size, axes = np.linalg.eigh(matrix.T @ matrix)
    kept = size > 1e-8 * size.max()
    solution = axes[:, kept] @ ((axes[:, kept].T @ (matrix.T @ values)) / size[kept])
    return solution, values - matrix @ solution


def peaks(left: np.ndarray, days: np.ndarray, count: int) -> list[float]:
    """The largest frequencies [rad per day], each taken out before the next is looked for."""
    window, length = np.hanning(left.size), 1 << 18
    found: list[float] = []
    for _ in range(count):
        spectrum = np.abs(np.fft.rfft((left - left.mean()) * window, length))
        top = int(spectrum[2:].argmax()) + 2
        a, b, c = np.log(spectrum[top - 1 : top + 2])
        rate = 2 * np.pi * (top + 0.5 * (a - c) / (a - 2 * b + c)) / length / STEP
        if any(abs(rate - other) < 1e-9 for other in found):
            break
        found.append(rate)
        waves = np.stack([np.sin(rate * days), np.cos(rate * days)], axis=1)
        left = left - waves @ np.linalg.lstsq(waves, left, rcond=None)[0]
    return found


def terms(
    values: np.ndarray, days: np.ndarray, least: float, rounds: int
) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Frequencies whose amplitude is worth keeping, the solution, and what is left."""
    apart = 0.6 * 2 * np.pi / (days[-1] - days[0])
    rates: list[float] = []
    for _ in range(rounds):
        _, left = fit(values, days, rates)
        candidates, rates = rates + peaks(left, days, 12), []
        for rate in candidates:
            if rate > apart and all(abs(rate - other) > apart for other in rates):
                rates.append(rate)
    solution, _ = fit(values, days, rates)
    amplitude = np.hypot(solution[0:-3:2], solution[1:-3:2])
    rates = [rate for rate, size in zip(rates, amplitude, strict=True) if size > least]
    return rates, *fit(values, days, rates)


def main() -> None:
    """Fit the planets one by one and write them into one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kernel", help="de421.bsp")
    file = SPK.open(parser.parse_args().kernel)
    times = np.arange(FIRST, LAST, STEP)
    before = times < HANDED_OVER
    after = integrated(file, times[~before])
    earth = erfa.epv00(times, 0.0)[0]["p"] * AU_KM
    rows: list[tuple[float, ...]] = []
    for number, (least, rounds) in PLANETS.items():
        # The integration is no match for Mercury: its terms are those of DE421 and go on.
        used = before if number == 1 else np.ones(times.size, bool)
        true = heliocentric(file, number, times[before])
        if number != 1:
            true = np.concatenate([true, after[BODIES.index(number)]])
        days, place = times[used] - 2451545.0, spherical(true)
        series = erfa.plan94(times[used], 0.0, number)["p"] * AU_KM
        off = place - spherical(series)
        off[0] = (off[0] + np.pi) % (2 * np.pi) - np.pi
        scale = np.array([ARCSEC, ARCSEC, 1.0])
        found = place.copy()
        for coordinate in range(3):
            in_arcsec = 1.0 if coordinate < 2 else place[2].mean() / ARCSEC
            rates, solution, left = terms(off[coordinate] * scale[coordinate], days, least * in_arcsec, rounds)
            found[coordinate] -= left / scale[coordinate]
            rows.append((number, coordinate, 0.0, solution[-2], solution[-3], solution[-1]))
            rows += [
                (number, coordinate, w, *pair, 0.0) for w, pair in zip(rates, solution[:-3].reshape(-1, 2), strict=True)
            ]
        level = found[2] * np.cos(found[1])
        ours = np.stack([level * np.cos(found[0]), level * np.sin(found[0]), found[2] * np.sin(found[1])], axis=1)
        seen, exact = ours @ erfa.ecm06(2451545.0, 0.0) - earth[used], true - earth[used]
        angle = (
            np.linalg.norm(np.cross(seen, exact), axis=1) / np.linalg.norm(seen, axis=1) / np.linalg.norm(exact, axis=1)
        )
        print(f"planet {number}: {angle.std() * ARCSEC:.2f}, at most {angle.max() * ARCSEC:.1f} arcsec from the Earth")
    write_table(
        "planet_terms.csv",
        [
            "Terms of the planets' motion to add to ERFA's plan94, whose numbers they have: fitted to JPL's DE421",
            "(public domain), 1900 to 2053, and our own integration from its last state to 2101; own work. coordinate:",
            "heliocentric 0 longitude [arcsec], 1 latitude [arcsec], ecliptic of J2000, 2 distance [km]. A term is",
            "sine sin(x) + cosine cos(x) with x = rate t, radians a day from J2000. Rows of rate 0: cosine constant,",
            "sine per century, square per century squared. Script: tools/make_planet_terms.py",
        ],
        ["row", "planet", "coordinate", "rate", "sine", "cosine", "square"],
        [
            (f"{i}", f"{row[0]}", f"{row[1]}", f"{row[2]:.10f}", *(f"{value:.3f}" for value in row[3:]))
            for i, row in enumerate(rows)
        ],
    )


if __name__ == "__main__":
    main()
