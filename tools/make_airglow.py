"""Make data/airglow_classes.csv, airglow_lines.csv and airglow_continuum.csv.  Needs nothing: facts are typed below.

PALACE is the model of Noll et al. (2025, Geosci. Model Dev. 18, 4353; data: Zenodo 10.5281/zenodo.14064022, CC BY 4.0),
made from ten years of spectra at Cerro Paranal: annual means at night, towards the zenith, above the scattering air, at
a solar radio flux of 100 sfu.  "From memory" marks what no source was at hand for.
"""

from __future__ import annotations

import numpy as np
from _table import write_table

HC_K = 1.438777  # [cm K]
ROTATION = 190.0  # temperature of the OH and O2 layers [K], as Rousselot et al. (2000, A&A 354, 1134) took it
VIBRATION = 9000.0  # of OH [K], the same source
FEWEST = 2e-3  # share of a band below which a line is left out

#: Class: height [km] (PALACE table 2), thickness [km], change with the solar radio flux [percent per sfu].
#: Thickness: 8.6 km for all near the mesopause, the mean of 34 rockets' profiles of OH (Baker & Stair 1988, Physica
#: Scripta 37, 611); the red lines come from 200 to 300 km mostly, the width at half maximum of a Gaussian with that 2
#: sigma.  Solar activity: PALACE's table 4 for O and Na, the mean of its climatologies for the continua; OH and the
#: bands of O2 from memory (Noll et al. 2012 have nearly none and 0.6).
CLASSES = (
    ("HO2 continuum", 81.0, 8.6, 0.03),
    ("OH Meinel bands", 87.0, 8.6, 0.1),
    ("FeO continuum", 88.0, 8.6, 0.03),
    ("Na D", 92.0, 8.6, 0.235),
    ("O2 Herzberg and Chamberlain bands", 94.0, 8.6, 0.40),
    ("O2 atmospheric band", 94.0, 8.6, 0.6),
    ("OI 557.7 nm", 97.0, 8.6, 0.754),
    ("OI 630.0 and 636.4 nm", 250.0, 120.0, 1.432),
)
#: Vacuum wavelength [nm], rayleigh, class.  O: PALACE.  Na: PALACE's 36.5 R, D2 to D1 as 1.67 to 1 (from memory).
ATOMS = ((557.889, 163.0, 7), (589.158, 22.8, 4), (589.756, 13.7, 4), (630.205, 123.0, 8), (636.554, 41.0, 8))
#: Levels of OH above the lowest [cm-1] (HITRAN) and Einstein coefficients [s-1] by change of v (Nelson et al. 1990, J.
#: Chem. Phys. 93, 7003, as Makhlouf updated them in 1999), both as printed in NCAR's gcmprocpy.
OH_LEVELS = np.array([0.0, 3568.50, 6971.37, 10210.57, 13287.19, 16201.33, 18951.90, 21536.25, 23949.83, 26185.79])
OH_RATES = {  # of the bands up to 2.5 um: changes of v by 2 to 6
    2: (10.32,),
    3: (27.57, 1.122),
    4: (48.65, 4.118, 0.134),
    5: (70.73, 9.415, 0.625, 0.019),
    6: (91.13, 17.16, 1.744, 0.110, 0.003),
    7: (107.3, 27.20, 3.785, 0.364, 0.023),
    8: (116.8, 39.07, 7.033, 0.918, 0.088),
    9: (117.5, 51.94, 11.74, 1.962, 0.254),
}
OH_TOTAL = 715e3  # rayleigh from 300 to 2500 nm (PALACE)
OH_ROTATION = (18.911, 0.7242)  # B_e and alpha_e [cm-1] (from memory)
#: The O2 band (0-1) at 865 nm: rayleigh, origin, B' and B'' [cm-1] (from memory: 300 to 800 R are reported).  The band
#: (0-0) at 762 nm, some ten times as bright, is swallowed by the O2 below: no use for whoever stands on the ground.
O2_BAND = (400.0, 11564.5, 1.391, 1.430)

#: PALACE's continua [R nm-1].  HO2 and FeO (with what else glows there) every 5 nm from 300 to 650 nm:
HO2 = """
.216 .216 .215 .213 .211 .208 .205 .201 .198 .194 .190 .187 .183 .179 .176 .172 .168 .165 .161 .158
.156 .154 .153 .151 .150 .148 .146 .144 .142 .139 .137 .135 .134 .133 .133 .134 .136 .140 .146 .153
.163 .174 .186 .197 .205 .209 .212 .214 .220 .240 .306 .493 .691 .873 .945 .957 .888 .878 1.025 1.047
.923 .698 .651 .768 .834 .813 .792 .759 .742 .735 .728"""
FEO = """
.405 .409 .413 .417 .422 .428 .435 .442 .450 .458 .468 .478 .488 .499 .511 .524 .537 .550 .565 .579
.595 .610 .626 .642 .658 .674 .690 .706 .723 .742 .764 .789 .818 .850 .882 .913 .941 .965 .987 1.014
1.050 1.101 1.170 1.251 1.340 1.429 1.515 1.593 1.694 1.865 2.218 2.723 3.193 4.000 4.426 4.750 4.652 4.799 5.967 6.072
5.571 4.586 4.231 4.054 4.094 4.375 4.549 4.311 3.867 3.536 3.245"""
#: O2 every nm from 300 to 604 nm; it fades to nothing at 650.
O2 = """
3.70 3.66 3.62 3.59 3.55 3.51 3.47 3.44 3.40 3.36 3.32 3.29 3.25 3.22 3.18 3.14 3.11 3.08 3.04 3.01
2.98 4.70 4.98 4.14 3.41 2.81 3.26 3.18 2.74 4.06 4.32 4.05 4.38 3.42 2.46 2.07 2.53 3.73 3.73 2.90
2.33 2.11 2.47 2.70 2.79 3.15 3.14 2.80 2.97 3.01 2.46 2.26 2.10 1.79 3.10 4.17 2.96 2.03 1.66 1.45
1.45 1.41 1.82 2.55 2.77 2.65 2.58 2.10 1.47 1.40 1.73 1.90 2.07 2.34 2.37 2.24 1.81 1.42 1.35 1.32
1.48 1.54 1.52 1.75 1.94 1.63 1.49 1.27 .902 .863 1.01 1.19 .896 .679 1.04 .988 .587 .725 .908 .716
.741 .961 1.02 1.06 1.41 1.33 1.30 1.69 1.48 .997 .608 .508 .731 .976 .950 .837 .939 1.19 1.15 1.03
.955 .896 .836 .767 .817 .977 1.24 1.30 1.16 1.13 1.13 1.32 1.22 .845 1.03 1.13 .982 1.02 .981 .883
.982 1.21 1.41 1.46 1.24 1.00 .953 .887 .871 .957 1.03 1.01 1.21 1.60 1.61 1.42 1.28 1.15 1.09 1.03
1.00 .948 .914 .885 .710 .836 1.00 .978 1.09 1.09 1.01 .993 .947 .875 .829 .725 .659 .696 .661 .716
.838 .972 1.16 1.48 1.51 1.16 1.33 1.31 1.08 1.12 .911 .736 .778 .710 .696 .770 .847 .860 .788 .810
1.28 1.41 1.04 .932 .786 .711 .724 .689 .732 .675 .635 .659 .553 .797 1.23 1.30 1.12 1.09 .957 .747
.612 .610 .721 .656 .579 .451 .277 .334 .422 .363 .534 .686 .628 .823 .903 .789 .752 .764 .753 .625
.572 .637 .572 .554 .588 .607 .753 .643 .440 .542 .727 .906 .902 .746 .620 .527 .493 .489 .482 .475
.468 .461 .453 .446 .438 .429 .421 .412 .403 .393 .383 .372 .361 .349 .336 .323 .310 .297 .283 .270
.256 .243 .230 .217 .205 .192 .180 .169 .157 .145 .134 .123 .113 .103 .093 .084 .076 .069 .064 .059
.056 .053 .052 .050 .050"""
#: Beyond 650 nm the sum of HO2 and FeO is from memory of spectra by X-shooter, good to some 50 %.
RED = {650: 3.97, 700: 4.0, 750: 4.5, 800: 5.5, 850: 7.0, 900: 8.5, 950: 10.0, 1000: 11.0}


def branches(origin: float, upper: float, lower: float, numbers: range, pi: bool) -> list[tuple[float, float]]:
    """Vacuum wavelengths [nm] of a band's lines, and their shares, for one temperature of rotation.

    Terms B N (N + 1) and the factors of Hoenl and London, for 2Pi to 2Pi in Hund's case b or 1Sigma to 3Sigma without
    the splitting of the triplet; the doublets of OH lie within 1 nm of that.
    """
    lines = []
    for n in numbers:
        weight = np.exp(-HC_K * upper * n * (n + 1) / ROTATION)
        if pi:
            strengths = {n - 1: (n * n - 1) / n, n: (2 * n + 1) / (n * (n + 1)), n + 1: n * (n + 2) / (n + 1)}
        else:
            strengths = {n - 1: float(n), n + 1: n + 1.0}
        for below, strength in strengths.items():
            if strength > 0:
                term = origin + upper * n * (n + 1) - lower * below * (below + 1)
                lines.append((1e7 / term, strength * weight))
    total = sum(share for _, share in lines)
    lines = [(wavelength, share / total) for wavelength, share in lines if share / total > FEWEST]
    kept = sum(share for _, share in lines)
    return [(wavelength, share / kept) for wavelength, share in lines]


def oh_lines() -> list[tuple[float, float, int]]:
    """Lines of the bands of OH up to 1000 nm."""
    population = np.exp(-HC_K * OH_LEVELS / VIBRATION)
    bands = {(v, v - 2 - k): population[v] * rate for v, rates in OH_RATES.items() for k, rate in enumerate(rates)}
    scale = OH_TOTAL / sum(bands.values())
    lines = []
    for (v, below), strength in bands.items():
        origin = OH_LEVELS[v] - OH_LEVELS[below]
        upper, lower = (OH_ROTATION[0] - OH_ROTATION[1] * (number + 0.5) for number in (v, below))
        found = branches(origin, upper, lower, range(1, 15), True)
        lines += [(wavelength, share * scale * strength, 2) for wavelength, share in found]
    return lines


def continua() -> list[tuple[float, float, float, float]]:
    """Wavelength [nm], HO2, FeO and O2 [R nm-1] every 5 nm; O2 as the mean of the 5 nm around."""
    grid = np.arange(300.0, 1000.1, 5.0)
    ho2, feo, o2 = (np.array([float(word) for word in text.split()]) for text in (HO2, FEO, O2))
    near = grid <= 650.0
    fine = np.arange(300.0, 300.0 + len(o2))
    blue = grid[grid <= 600.0]
    means = [np.mean(o2[np.abs(fine - wavelength) <= 2.0]) for wavelength in blue]
    o2 = np.interp(grid, [*blue, 650.0], [*means, 0.0])
    both = np.interp(grid, list(RED), list(RED.values()))
    share = feo[-1] / (feo[-1] + ho2[-1]) * np.interp(grid, [650.0, 1000.0], [1.0, 0.25])
    feo = np.concatenate([feo, (both * share)[~near]])
    ho2 = np.concatenate([ho2, (both * (1.0 - share))[~near]])
    return list(zip(grid.tolist(), ho2.tolist(), feo.tolist(), o2.tolist(), strict=True))


def main() -> None:
    """Write the three tables."""
    write_table(
        "airglow_classes.csv",
        [
            "Classes of airglow: height and thickness of their layers, change with the solar radio flux at 10.7 cm.",
            *(f"{number} = {name}" for number, (name, *_) in enumerate(CLASSES, start=1)),
            "Heights and changes: PALACE (Noll et al. 2025, GMD 18, 4353; CC BY 4.0); changes of 2 and 6 from memory.",
            "Units: km, km, percent per sfu from 100 sfu. Script: tools/make_airglow.py, which names all sources.",
        ],
        ["class", "height_km", "thickness_km", "solar"],
        [(f"{k}", *(f"{value:g}" for value in row[1:])) for k, row in enumerate(CLASSES, start=1)],
    )
    rayleigh, origin, upper, lower = O2_BAND
    found = branches(origin, upper, lower, range(0, 30, 2), False)
    lines = sorted([*ATOMS, *oh_lines(), *((w, share * rayleigh, 6) for w, share in found)])
    write_table(
        "airglow_lines.csv",
        [
            "Lines of airglow up to 1000 nm: zenith intensity above the air, annual mean at 100 sfu.",
            "O and Na: PALACE (Noll et al. 2025; CC BY 4.0). OH: 715 kR (PALACE) up to 2.5 um, shared out by Einstein",
            "coefficients (Nelson et al. 1990) and temperatures of 9000 K (vibration) and 190 K (rotation).",
            "O2 (0-1): 400 R, from memory. Without the band (0-0) at 762 nm, which the air below swallows.",
            "Units: nm (vacuum), rayleigh, number of airglow_classes.csv. Script: tools/make_airglow.py",
        ],
        ["wavelength_nm", "rayleigh", "class"],
        [(f"{w:.3f}", f"{r:.3g}", f"{k}") for w, r, k in lines if 300.0 < w < 1000.0 and r >= 0.05],
    )
    write_table(
        "airglow_continuum.csv",
        [
            "Continua of airglow: zenith intensity above the air, annual mean at 100 sfu, thinned to 5 nm.",
            "PALACE v1.0 (Noll et al. 2024, Zenodo 10.5281/zenodo.14064022; CC BY 4.0) up to 650 nm; beyond from",
            "memory of spectra by X-shooter, good to some 50 %.",
            "Units: nm (vacuum), R nm-1; the columns are classes 1, 3 and 5. Script: tools/make_airglow.py",
        ],
        ["wavelength_nm", "ho2", "feo", "o2"],
        [(f"{row[0]:g}", *(f"{value:.3g}" for value in row[1:])) for row in continua()],
    )


if __name__ == "__main__":
    main()
