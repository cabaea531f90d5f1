"""A fit in words: the table of priors and estimates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from skyscatter.inversion.fitresult import FitResult


#: Error of an emulator [standard deviations of a datum] above which a fit says so.
TRUSTED = 0.33
#: Reduced chi2 above which the model does not describe the data at all: ten times their noise.
HOPELESS = 100.0
#: Probability of a misfit as large or larger below which a fit says that the model is wrong.
UNLIKELY = 1e-4


def rounded(value: float, deviation: float) -> str:
    """A number with the digits that its standard deviation leaves a meaning: two of the latter."""
    if not (np.isfinite(value) and deviation > 0):
        return f"{value:.6g}"
    digits = 1 - int(np.floor(np.log10(deviation)))
    if abs(value) >= 1e6 or digits > 9:
        return f"{value:.{max(1, int(np.ceil(np.log10(max(abs(value), deviation) / deviation))) + 2)}g}"
    return f"{value:.{max(digits, 0)}f}"


def table(result: FitResult) -> str:
    """One line a parameter, and below how well the data are met."""
    head = ("parameter", "unit", "prior", "estimate", "deviation", "95 % from", "to", "from data")
    deviation, ends, share = result.standard_deviation, result.interval(0.95), np.diag(result.averaging_kernel_z)
    rows = [head]
    for k, (name, value) in enumerate(result.estimate.items()):
        s = deviation[name]
        numbers = [rounded(value, s), f"{s:.2g}", *(rounded(end, s) for end in ends[name]), f"{100 * share[k]:.0f} %"]
        rows.append((name, result.units[k] or "-", str(result.priors[k]), *numbers))  # type: ignore[arg-type]
    width = [max(len(row[k]) for row in rows) for k in range(len(head))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, width, strict=True)).rstrip() for row in rows]
    lines.insert(1, "  ".join("-" * w for w in width))
    free = result.measured.size - result.degrees_of_freedom
    lines.append(
        f"{result.measured.size} data, degrees of freedom for signal {result.degrees_of_freedom:.2f} of "
        f"{len(result.names)}; "
        f"chi2 {result.chi2:.1f} for {free:.1f} (probability {result.probability:.2g})"
    )
    lines += [f"WARNING: {text}" for text in warnings(result)]
    if result.probability > 1 - UNLIKELY:
        lines.append("NOTE: the data are met better than their noise allows; it is too large, or not independent")
    state = "converged" if result.converged else "NOT converged"
    lines.append(f"{result.method.replace('_', ' ')} with {result.solver}, {result.iterations} iterations, {state}")
    lines += sampling(result)
    return "\n".join(lines)


def warnings(result: FitResult) -> tuple[str, ...]:
    """What speaks against an estimate; see `FitResult.warnings`."""
    found = []
    if not result.converged:
        found.append(
            f"the fit has not converged in {result.iterations} iterations: allow more (max_iterations), begin nearer "
            "to the truth, or free fewer parameters"
        )
    if result.reduced_chi2 > HOPELESS:
        found.append(
            "the model misses the data by ten times their noise and more: what was found is no estimate; look at "
            "units, angles and noise of the data, and at the residual"
        )
    elif result.probability < UNLIKELY:
        found.append(
            "the model does not meet the data within their noise, so that deviations are too small; free more "
            "parameters, or look at the residual for what is missing"
        )
    if found and "ground.albedo" in result.names and spectral_ground(result.model):
        found.append(
            "the ground keeps the colours of the model's while ground.albedo is fitted: for a grey one free "
            "ground.grey_albedo in its place"
        )
    return tuple(found)


def spectral_ground(model: Any) -> bool:
    """Whether the albedo of a model's ground has a spectrum."""
    return not isinstance(model.ground.albedo, float | int)


def sampling(result: FitResult) -> list[str]:
    """How the walk through the posterior went, and whether it can be trusted; nothing for optimal estimation."""
    found = result.diagnostics
    if "acceptance" not in found:
        return []
    lines = [
        f"{found['walkers']} walkers, {found['steps']} steps, acceptance {found['acceptance']:.2f}, "
        f"{found['effective_samples']:.0f} independent samples"
    ]
    if not found["long_enough"]:
        lines.append("WARNING: the chain is shorter than 50 autocorrelation times; allow more steps")
    if "emulator_error_in_sigma" in found:
        off, beyond = found["emulator_error_in_sigma"], found["share_beyond_the_emulator"]
        lines.append(f"emulator: off by {off:.2g} standard deviations of a datum at draws of the posterior")
        # An error of every datum by a third of its deviation changes chi2 by a tenth of the data's number.
        if off > TRUSTED or beyond > 0.05:
            lines.append("WARNING: the emulator is not to be trusted that far; walk on the model itself (no emulator)")
    return lines
