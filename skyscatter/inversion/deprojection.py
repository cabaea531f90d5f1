"""What spheroids may be behind an ellipse: inclination and true axis ratio, as far as an image can tell them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.brief import Brief
from skyscatter.inversion.shells import ShellFit

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Deprojection(Brief):
    """What spheroids would be seen as the fitted ellipse.

    Attributes
    ----------
    inclination_deg, axis_ratio, depth : tuple of float
        Mean and standard deviation of the posterior; the axis ratio is polar over equatorial radius c / a, the depth a
        c / b of equation 125 in units of the equatorial radius, by which `brightness` is to be divided for a density.
    inclination_range, axis_ratio_range : tuple of float
        From the 2.5th to the 97.5th percentile.
    correlation : float
        Of inclination and axis ratio.
    information : float
        How much narrower the axis ratio's posterior is than its prior: 1 less the ratio of their variances.
    axis_position_angle_deg : float
        Of the projected axis: the minor axis for oblate, the major one for prolate spheroids.
    equatorial_radius : float
        a [unit of `pixel_size`].

    Examples
    --------
    Without further knowledge an image leaves a wide range of inclinations [degree], none of them near the pole.

    >>> from skyscatter import inversion
    >>> true = {"x": 16, "y": 12, "major": 9, "minor": 6, "position_angle_deg": 30, "thickness": 0.3}
    >>> image = inversion.shell_image((24, 32), {**true, "brightness": 5, "background": 1})
    >>> found = inversion.deproject(inversion.fit_shell(image, 0.1), "oblate")
    >>> low, high = found.inclination_range
    >>> f"{low:.0f} to {high:.0f}"
    '48 to 88'
    >>> f"axis at {found.axis_position_angle_deg:.0f}, radius {found.equatorial_radius:.1f}"
    'axis at 120, radius 9.0'
    """

    inclination_deg: tuple[float, float]
    axis_ratio: tuple[float, float]
    depth: tuple[float, float]
    inclination_range: tuple[float, float]
    axis_ratio_range: tuple[float, float]
    correlation: float
    information: float
    axis_position_angle_deg: float
    equatorial_radius: float


def deproject(
    fit: ShellFit,
    spheroid: Literal["oblate", "prolate"],
    *,
    inclination_deg: float | tuple[float, float] | None = None,
    axis_ratio: float | tuple[float, float] | None = None,
) -> Deprojection:
    """Inclination and true axis ratio of the spheroid behind an ellipse, as far as they can be told.

    Without further knowledge axes are isotropic (sin i), and the ratio of the smaller to the larger radius is uniform
    from 0.05 to 1.  Either may be known: as a number, or as a mean and a standard deviation, which multiply these.

    Parameters
    ----------
    fit : ShellFit
    spheroid : {"oblate", "prolate"}
    inclination_deg : float or (float, float), optional
        Angle of the axis with the line of sight, 0 to 90.
    axis_ratio : float or (float, float), optional
        Polar over equatorial radius: below 1 for oblate, above 1 for prolate spheroids.

    Returns
    -------
    Deprojection

    Raises
    ------
    DomainError
        For another spheroid, numbers out of range, and for those that no such spheroid can be seen with.

    Examples
    --------
    An ellipse of the axis ratio 2/3 is an oblate shell of that ratio seen from its equator, or a flatter one that is
    tilted: one of half the height is inclined by 59 degrees.

    >>> from skyscatter import inversion
    >>> true = {"x": 16, "y": 12, "major": 9, "minor": 6, "position_angle_deg": 30, "thickness": 0.3}
    >>> image = inversion.shell_image((24, 32), {**true, "brightness": 5, "background": 1})
    >>> fit = inversion.fit_shell(image, 0.1)
    >>> f"{inversion.deproject(fit, 'oblate', inclination_deg=90).axis_ratio[0]:.2f}"
    '0.67'
    >>> f"{inversion.deproject(fit, 'oblate', axis_ratio=0.5).inclination_deg[0]:.0f}"
    '59'
    """
    if spheroid not in ("oblate", "prolate"):
        raise DomainError("spheroid", spheroid, 'must be "oblate" or "prolate"')
    prolate = spheroid == "prolate"
    seen, error = fit.ratio
    tilt = np.radians(np.linspace(0.0, 90.0, 361))[:, None]
    flat = np.linspace(0.05, 1.0, 761)[None, :]
    eta = 1 / flat if prolate else flat
    prior = np.sin(tilt) * np.ones_like(flat)
    prior = prior * _known(np.degrees(tilt), inclination_deg, 0.25, "inclination_deg", 0.0, 90.0)
    low, high = (1.0, 20.0) if prolate else (0.05, 1.0)
    prior = prior * _known(eta, axis_ratio, 1.25e-3 * (eta**2 if prolate else 1.0), "axis_ratio", low, high)
    b = np.sqrt(np.cos(tilt) ** 2 + (eta * np.sin(tilt)) ** 2)
    ellipse = 1 / b if prolate else b
    # Half a cell of the grid is the least that it can resolve.
    width = np.hypot(error, 2e-3)
    posterior = prior * np.exp(-0.5 * ((ellipse - seen) / width) ** 2)
    if not posterior.sum() > 1e-12 * prior.sum():
        raise DomainError("axis_ratio", axis_ratio, f"no such spheroid is seen with the axis ratio {seen:.3f}")
    mean, variance = _moments(posterior)
    i_mean, i_sd = mean(np.degrees(tilt)), float(np.sqrt(variance(np.degrees(tilt))))
    r_mean, r_sd = mean(eta), float(np.sqrt(variance(eta)))
    depth = eta / b
    both = mean((np.degrees(tilt) - i_mean) * (eta - r_mean))
    information = 1.0 - variance(eta) / max(_moments(prior)[1](eta), 1e-300)
    p = fit.parameters
    return Deprojection(
        inclination_deg=(i_mean, i_sd), axis_ratio=(r_mean, r_sd), depth=(mean(depth), float(np.sqrt(variance(depth)))),
        inclination_range=_range(np.degrees(tilt)[:, 0], posterior.sum(axis=1)),
        axis_ratio_range=_range(eta[0], posterior.sum(axis=0)),
        correlation=both / max(i_sd * r_sd, 1e-300), information=information,
        axis_position_angle_deg=(p["position_angle_deg"] + (0.0 if prolate else 90.0)) % 180.0,
        equatorial_radius=p["minor"] if prolate else p["major"],
    )  # fmt: skip


def _known(
    values: Array, given: float | tuple[float, float] | None, cell: float | Array, name: str, low: float, high: float
) -> Array:
    """Weight of a number that is known with an error, or exactly (within a cell of the grid)."""
    if given is None:
        return np.ones_like(values)
    centre, spread = (float(given), 0.0) if np.ndim(given) == 0 else (float(given[0]), float(given[1]))  # type: ignore[index, arg-type]
    if not low <= centre <= high or not spread >= 0:
        raise DomainError(name, given, f"must lie from {low:g} to {high:g}, with an error of 0 or above")
    return np.asarray(np.exp(-0.5 * ((values - centre) / np.hypot(spread, cell)) ** 2))


def _moments(weight: Array) -> tuple[Callable[[Array], float], Callable[[Array], float]]:
    total = weight.sum()

    def mean(x: Array) -> float:
        return float((weight * x).sum() / total)

    return mean, lambda x: mean((x - mean(x)) ** 2)


def _range(x: Array, weight: Array) -> tuple[float, float]:
    order = np.argsort(x)
    share = np.cumsum(weight[order]) / weight.sum()
    low, high = np.interp([0.025, 0.975], share, x[order])
    return float(low), float(high)
