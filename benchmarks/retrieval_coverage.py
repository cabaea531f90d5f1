"""How often the truth lies inside the stated 95 % region: aerosol and ground from sky radiances of another solver.

The data are radiances by ``path`` (walks, whose own standard error is stated below) with fresh noise in each draw; the
retrieval, optimal estimation, uses ``orders`` and knows nothing of how the data were made.  A draw counts as inside if
the truth's squared distance from the estimate, in the metric of the estimate's covariance, is below the 95 % quantile
of chi2 with as many degrees of freedom as parameters.  S_e holds the noise and, in quadrature, the error that
``orders`` states for itself at its tolerance.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from common import machine, parser, replace_section, seconds, table, versions
from scipy.stats import binom, chi2

import skyscatter
from skyscatter.inversion import radiance_table
from skyscatter.inversion.estimation import Estimate, optimal_estimation
from skyscatter.inversion.fitting import free_parameters
from skyscatter.inversion.forward import Forward
from skyscatter.inversion.observations import Run
from skyscatter.inversion.parameters import apply

PAGE = Path(__file__).parent.parent / "docs" / "validation-inversion-retrieval.md"
SUN_ELEVATION = 40.0
RELATIVE_AZIMUTHS = (5.0, 20.0, 45.0, 90.0, 135.0, 180.0)
ELEVATIONS = (10.0, 25.0, 45.0, 70.0)
WAVELENGTHS = (440.0, 670.0, 870.0)
NOISE = 0.03
TRUTH = {
    "haze.optical_depth": 0.30, "haze.single_scattering_albedo": 0.92, "haze.asymmetry": 0.65, "ground.albedo": 0.20,
}  # fmt: skip


class Remembered:
    """A forward model that keeps what it has computed: all draws begin at one state."""

    def __init__(self, forward: Forward, y: Any, kept: dict[bytes, Any]) -> None:
        self.forward, self.y, self.kept = forward, y, kept
        self.predict, self.noise_variance = forward.predict, forward.noise_variance

    def linearise(self, z: Any, steps: Any) -> Any:
        """As of `Forward`."""
        key = z.tobytes()
        if key not in self.kept:
            self.kept[key] = self.forward.linearise(z, steps)
        return self.kept[key]


def true_scene() -> Any:
    """The hazy Earth with the true numbers in it."""
    model = skyscatter.load_model("earth-hazy")
    parameters, subject = free_parameters(model, dict.fromkeys(TRUTH), [])
    return apply(parameters, subject, list(TRUTH.values())).model.scene(sun_elevation_deg=SUN_ELEVATION)


def looks() -> tuple[Any, Any]:
    """Azimuths and elevations of the rays [degree]."""
    azimuth, elevation = np.meshgrid(180.0 + np.array(RELATIVE_AZIMUTHS), ELEVATIONS, indexing="ij")
    return azimuth.ravel(), elevation.ravel()


def walked(samples: int, seed: int) -> tuple[Any, Any]:
    """Radiances by walks and their standard error, (datum,)."""
    from skyscatter.geometry.vectors import direction_from_azimuth_elevation

    scene = true_scene()
    answer = skyscatter.radiance(
        scene,
        scene.observer.position,
        direction_from_azimuth_elevation(*looks()),
        WAVELENGTHS,
        solver=skyscatter.Path(samples=samples, seed=seed),
    )
    return answer.radiance.ravel(), answer.standard_error.ravel()


def problem(radiance: Any, tolerance: float) -> Forward:
    """The retrieval; its first guess is the model's own haze, 0.45 thick."""
    azimuth, elevation = (np.repeat(a, len(WAVELENGTHS)) for a in looks())
    data = radiance_table(
        azimuth, elevation, np.tile(WAVELENGTHS, len(azimuth) // len(WAVELENGTHS)), radiance, NOISE * radiance,
        sun_elevation_deg=SUN_ELEVATION,
    )  # fmt: skip
    model = skyscatter.load_model("earth-hazy")
    parameters, subject = free_parameters(model, dict.fromkeys(TRUTH), [data])
    return Forward(parameters, subject, [data], Run(skyscatter.Orders(tolerance=tolerance)))


def distance(found: Estimate, truth: Any) -> float:
    """Squared Mahalanobis distance of the truth."""
    off = truth - found.z
    return float(off @ np.linalg.solve(found.covariance, off))


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--draws", type=int, default=200)
    options.add_argument("--samples", type=int, default=65536, help="walks per ray of the data")
    options.add_argument("--tolerance", type=float, default=0.01, help="of the retrieval's solver")
    options.add_argument("--cache", help="keep the walks in this .npz file")
    given = options.parse_args()
    print(machine(), file=sys.stderr)
    if given.cache and Path(given.cache).is_file():
        kept = np.load(given.cache)
        exact, error = kept["radiance"], kept["error"]
    else:
        exact, error = walked(given.samples, seed=11)
        if given.cache:
            np.savez(given.cache, radiance=exact, error=error)
    forward = problem(exact, given.tolerance)
    truth = forward.state(list(TRUTH.values()))
    at_truth = forward.predict(truth)
    off = at_truth.value / exact - 1
    # From the model's own numbers to those of data without noise, once; the draws begin there.
    memory: dict[bytes, Any] = {}
    first = optimal_estimation(Remembered(forward, exact, memory), forward.start())
    rng = np.random.default_rng(2026)
    draws = []
    for number in range(given.draws):
        y = exact * (1 + NOISE * rng.standard_normal(exact.size))
        took, found = seconds(lambda y=y: optimal_estimation(Remembered(forward, y, memory), first.z))
        draws.append((found, took))
        if number % 20 == 19:
            print(number + 1, "draws", f"{took:.1f} s", file=sys.stderr)
        for key in [k for k in memory if k != first.z.tobytes()]:
            del memory[key]
    lines, body = summary(forward, truth, draws, first)
    words = " ".join(
        w for w in sys.argv[1:] if w != "--write" and not w.startswith("--cache") and not w.endswith(".npz")
    )
    stated = np.median(at_truth.error / at_truth.value)
    text = "\n\n".join([
        f"`python benchmarks/retrieval_coverage.py {words} --write`; {versions('skyscatter', 'numpy', 'scipy')}.",
        f"Data: {exact.size} radiances by `path` ({given.samples} walks a ray, median standard error "
        f"{100 * np.median(error / exact):.2f} %), noise {100 * NOISE:g} %. Retrieval by `orders` (tolerance "
        f"{100 * given.tolerance:g} %). At the truth the solvers differ by {100 * off.mean():+.2f} % in the mean and "
        f"{100 * np.sqrt(np.mean(off**2)):.2f} % rms, the noise of the walks included; `orders` states "
        f"{100 * stated:.2f} % (median), which S_e holds beside the noise: "
        f"{100 * np.hypot(NOISE, stated):.2f} % in all.",
        body, lines,
    ])  # fmt: skip
    print(text)
    if given.write:
        replace_section(PAGE, "coverage", text)


def summary(forward: Forward, truth: Any, draws: list[Any], first: Estimate) -> tuple[str, str]:
    """Table of the parameters, and the sentence about the joint region."""
    found, times = [d[0] for d in draws], [d[1] for d in draws]
    n = truth.size
    inside = np.array([distance(f, truth) for f in found]) < chi2.ppf(0.95, n)
    z = np.array([f.z for f in found])
    deviation = np.array([np.sqrt(np.diag(f.covariance)) for f in found])
    values = np.array([forward.values(row) for row in z])
    rows = []
    for k, name in enumerate(TRUTH):
        within = np.abs(z[:, k] - truth[k]) < 1.96 * deviation[:, k]
        rows.append([
            name, f"{TRUTH[name]:g}", f"{values[:, k].mean():.4f}", f"{values[:, k].std(ddof=1):.4f}",
            f"{np.mean(deviation[:, k]) * forward.slopes(first.z)[k]:.4f}", f"{100 * within.mean():.1f} %",
        ])  # fmt: skip
    off = distance(first, truth)
    low, high = binom.ppf([0.025, 0.975], len(found), 0.95) / len(found)
    chi = np.array([f.chi2 for f in found])
    body = (
        f"**The truth lies inside the joint 95 % region in {100 * inside.mean():.1f} % of {len(found)} "
        f"draws** (a perfect "
        f"region: {100 * low:.1f} to {100 * high:.1f} % in 95 of 100 such experiments). Without noise the "
        f"estimate is off by "
        f"{np.sqrt(off):.2f} standard deviations, what the two solvers differ by. chi2 is "
        f"{chi.mean():.1f} in the mean for "
        f"{forward.y.size} data and {n} parameters; {sum(f.converged for f in found)} of {len(found)} converged, in "
        f"{np.mean([f.iterations for f in found]):.1f} iterations and {np.mean(times):.1f} s each."
    )
    head = [
        "parameter",
        "truth",
        "mean of the estimates",
        "their scatter",
        "stated deviation",
        "truth within 1.96 deviations",
    ]
    return table(head, rows), body


if __name__ == "__main__":
    main()
