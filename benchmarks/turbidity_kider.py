"""A turbidity for one clear day from a pyranometer: global irradiance at Ithaca, 27 May 2013 (Kider et al. 2014).

Quiet five-minute means of broadband global irradiance are fitted by the optical depth of the aerosol, with everything
else that such a number hangs on free within what was known of it: calibration and cosine response of the instrument,
water vapour, the aerosol's albedo and Angstrom exponent, the albedo of the ground, and the clock.  Beside it stands
what a Sun photometer of AERONET saw at Egbert, Ontario, 330 km away, on the same day.
"""

from __future__ import annotations

import os
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, replace_section, seconds, table, versions

import skyscatter
from skyscatter.inversion import Broadband, Normal, Uniform, flux_table
from skyscatter.inversion.parameters import Subject, resolve

PAGE = Path(__file__).parent.parent / "docs" / "validation-inversion-retrieval.md"
PLACE = (42.44337, -76.48163)  # Rhodes Hall, Cornell
#: The record does not say when it begins; its greatest values, at local noon, put it at 09:28 to 09:30 EDT.
START = datetime(2013, 5, 27, 13, 29, tzinfo=UTC)
PRESSURE = 985.0  # [hPa] at 250 m above the sea, a normal day
BIN = 5.0  # minutes
#: A mean is used if the readings in it lie on a straight line to this [W m-2], as without clouds.
QUIET = 3.5
#: After the first disturbed hour of the afternoon clouds stay in the sky, before the Sun or beside it.
LAST_MINUTE = 390.0
NOISE = 0.005  # of a mean, beside the calibration: cosine response, temperature
PRIORS: dict[str, Any] = {
    "aerosol.optical_depth": Uniform(0.0, 1.0),
    "aerosol.single_scattering_albedo": Normal(0.94, 0.04),
    "aerosol.angstrom_exponent": Normal(1.2, 0.4),
    "ground.albedo": Normal(0.08, 0.03),  # at 550 nm; the spectrum of vegetation
    "precipitable_water": None,  # lognormal about 1.5 g cm-2, a factor of 1.8
    "calibration": Normal(1.0, 0.02),
    "cosine_error": Normal(0.0, 0.01),  # at 60 degrees from the zenith
    "time_offset_s": Normal(0.0, 60.0),
}


def readings(folder: Path) -> tuple[Any, Any, Any]:
    """Minutes, means and scatter of the five-minute bins."""
    minute, flux = np.loadtxt(folder / "kider_irradiance_2013-05-27_even_hours.txt").T
    number = np.floor(minute / BIN)
    rows = []
    for k in np.unique(number):
        t, f = minute[number == k], flux[number == k]
        line = np.polynomial.Polynomial.fit(t, f, 1)
        rows.append((t.mean(), f.mean(), np.std(f - line(t))))
    return tuple(np.array(rows).T)  # type: ignore[return-value]


def station(folder: Path) -> list[list[Any]]:
    """Time, AOD at 440 nm, exponent, and AOD at 550 nm by both, of the photometer's almucantars."""
    lines = (folder / "130527_130527_Egbert.pfn").read_text(encoding="latin-1").splitlines()
    header = lines[3].split(",")
    rows = []
    for line in lines[4:]:
        cells = dict(zip(header, line.split(","), strict=False))
        depth, alpha = float(cells["tau440(measured)"]), float(cells["alpha440-870"])
        rows.append([cells["Time(hh:mm:ss)"], depth, alpha, depth * (550 / 440) ** -alpha])
    return rows


def model() -> Any:
    """The clear Earth, its air by the pressure of the place."""
    subject = Subject(skyscatter.load_model("earth"))
    for name, value in {"air.weight": PRESSURE / 1013.25, "ozone.column_du": 340.0}.items():
        subject = resolve(name, None, subject).put(subject, value)
    return subject.model


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--reference", default=os.environ.get("SKYSCATTER_REFERENCE", "../shared/reference"))
    options.add_argument("--picture", help="corner plot")
    given = options.parse_args()
    folder = Path(given.reference) / "clear_sky_kider"
    print(machine(), file=sys.stderr)
    minute, mean, scatter = readings(folder)
    quiet = (scatter < QUIET) & (minute < LAST_MINUTE)
    times = [START + timedelta(minutes=float(m)) for m in minute[quiet]]
    data = flux_table(
        None, "global", mean[quiet], noise=NOISE, times=times, place=PLACE, altitude=0.0,
        broadband=Broadband(pressure_hpa=PRESSURE),
    )  # fmt: skip

    def fitted(priors: dict[str, Any]) -> Any:
        return skyscatter.fit(
            model(),
            data,
            priors,
            solver=skyscatter.Orders(tolerance=0.01),
            progress=lambda s: print(f"{s:.2f}", file=sys.stderr),
        )

    took, result = seconds(lambda: fitted(PRIORS))
    print(result, file=sys.stderr)
    text = describe(result, fitted, quiet, station(folder), took)
    print(text)
    if given.picture:
        result.corner(given.picture)
    if given.write:
        replace_section(PAGE, "kider", text)


def describe(result: Any, fitted: Any, quiet: Any, beside: list[list[Any]], took: float) -> str:
    """The section of the page."""
    low, high = result.interval(0.95)["aerosol.optical_depth"]
    sure = result.interval(0.6827)["aerosol.optical_depth"]
    names = list(result.names)
    at = names.index("aerosol.optical_depth")
    kernel, correlation = np.diag(result.averaging_kernel_z), result.correlation[at]
    rows = [
        [name, str(result.priors[k]), f"{result.estimate[name]:.3g} ± {result.standard_deviation[name]:.2g}",
         f"{100 * kernel[k]:.0f} %", f"{correlation[k]:+.2f}"]
        for k, name in enumerate(names)
    ]  # fmt: skip
    scale = PRIORS["calibration"].sigma
    depths = [row[3] for row in beside]
    residual = result.residual / result.measured
    words = (
        f"{int(quiet.sum())} of {quiet.size} five-minute means are quiet and before the clouds of the "
        f"afternoon. Aerosol "
        f"optical depth at 550 nm: **{result.estimate['aerosol.optical_depth']:.3f}**, 68 % between "
        f"{sure[0]:.3f} and "
        f"{sure[1]:.3f}, 95 % between {low:.3f} and {high:.3f}. The photometer at Egbert, 330 km away, "
        f"saw {min(depths):.3f} "
        f"to {max(depths):.3f} (its depth at 440 nm carried to 550 nm by its exponent). chi2 is "
        f"{result.chi2:.1f} for "
        f"{result.measured.size} data; the residual is {100 * np.sqrt(np.mean(residual**2)):.2f} % rms. "
        f"{result.degrees_of_freedom:.1f} of {len(names)} numbers are told by the data. {took:.0f} s."
    )
    apart = (
        f"The photometer's numbers lie {'below' if max(depths) < low else 'above'} the interval; it stood "
        f"elsewhere, and the "
        "shape of the day, which carries ours, is the instrument's cosine response as much as the aerosol. "
        if max(depths) < low or min(depths) > high
        else ""
    )
    honest = (
        f"{apart}What a pyranometer can say: the aerosol takes from the global irradiance only what it "
        f"absorbs and what it "
        f"sends back to space, a per cent or two for 0.1 of optical depth. The calibration, assumed known "
        f"to {100 * scale:g} "
        "%, and the cosine response, assumed right to 1 % at 60 degrees, are worth as much; so is the "
        "albedo of the aerosol. "
        "Without the direct beam apart the optical depth is therefore known to its order of magnitude, "
        "and the interval "
        "above is as wide as these priors make it."
    )
    head = ["parameter", "prior", "estimate", "from the data", "correlation with the optical depth"]
    second = table(["Egbert, UTC", "AOD 440 nm", "exponent", "AOD 550 nm"], beside)
    command = "`python benchmarks/turbidity_kider.py --write`"
    return "\n\n".join([f"{command}; {versions('skyscatter', 'numpy')}.", words, table(head, rows), honest, second])


if __name__ == "__main__":
    main()
