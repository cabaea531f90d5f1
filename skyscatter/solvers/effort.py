"""How long a solution by orders of scattering will take, known before it is begun."""

from __future__ import annotations

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.memory import check_fits, field_bytes
from skyscatter.solvers.base import Array
from skyscatter.solvers.direct import outward_profile
from skyscatter.solvers.series import ORDERS_SHARE
from skyscatter.solvers.sweeps import Problem

#: Orders and minutes of one processor beyond which a solution is refused.
MOST_ORDERS, MOST_MINUTES = 1000, 60
#: Seconds for a point of a line, and for a wavelength there; for a moment of one Sun and wavelength at it, in the first
#: orders; measured, with caution.  And how many orders with all moments the others, which have few left, are worth.
POINT, OF_WAVELENGTH, OF_MOMENT = 1e-6, 3e-8, 4.5e-10
FIRST_ORDERS, LATER_SHARE = 4, 0.05
#: Points of a line for each row of the field.
POINTS = 1.5


def expected_orders(problem: Problem, tolerance: float) -> Array:
    """Orders of scattering until the rest is a geometric series, (wavelength,); good to a factor of two.

    Inside a layer of optical depth t, transport depth t* and albedo w the k-th mode of diffusion lives on by

        q_k = w / (1 + D k^2),   D = pi^2 / (3 t (t* + 1.42)),

    from order to order, 1.42 being the two extrapolation lengths (Davison 1957, Neutron Transport Theory, section 8);
    over a ground of albedo A the layer counts as 1 + A times as thick.  The first mode is the series that is summed;
    the second has to have gone.
    """
    diffuse = problem.diffuse
    column = outward_profile(problem.table.columns)[0]
    scattering = 4 * np.pi * diffuse.greek[0, :, 0]
    forward = 4 * np.pi / 3 * diffuse.greek[0, :, 1] if diffuse.greek.shape[2] > 1 else 0 * scattering
    total = np.maximum(column @ diffuse.sigma_t, 1e-12)
    transport = np.maximum(total - column @ forward, 0.0)
    decay = np.pi**2 / (3 * total * (transport + 1.42) * (1 + diffuse.light[2]) ** 2)
    second = column @ scattering / total / (1 + 4 * decay)
    goal = np.log(ORDERS_SHARE * tolerance)
    return np.asarray(np.maximum(goal / np.log(np.clip(second, 1e-12, 1 - 1e-12)), 1.0))


def expected_minutes(problem: Problem, orders: float) -> float:
    """Minutes of one processor for so many orders.

    About right for thin air, four times too many at optical depth 30 and up to seventeen times at 100, where the sum
    ends sooner than is expected.
    """
    grid, wavelengths = problem.grid, problem.diffuse.sigma_t.shape[1]
    points = grid.altitudes.size * grid.directions.shape[1] * POINTS * grid.rows.size
    moments = grid.sun_zenith.size * problem.moments.degree.size * wavelengths * problem.stokes
    whole = min(orders, FIRST_ORDERS) + LATER_SHARE * orders
    return float(points / 60 * (orders * (POINT + OF_WAVELENGTH * wavelengths) + whole * OF_MOMENT * moments))


def check_memory(problem: Problem) -> None:
    """Refuse a solution that memory does not hold.

    Raises
    ------
    DomainError
        That says how much it takes, how much there is, and what to change.
    """
    grid, wavelengths = problem.grid, problem.diffuse.sigma_t.shape[1]
    needed = field_bytes(
        grid.altitudes.size, grid.sun_zenith.size, problem.moments.degree.size, wavelengths, grid.rows.size
    )
    check_fits(
        needed, "wavelengths", wavelengths, f"a solution by orders to {problem.tolerance:g} takes",
        "give fewer wavelengths or a larger tolerance, or use solver path",
    )  # fmt: skip


def check_effort(problem: Problem, wavelengths: Array, tolerance: float, max_order: int | None) -> None:
    """Refuse a medium in which light is scattered too often, or which takes too long.

    Raises
    ------
    DomainError
        That says how deep the medium is, at which wavelength, and what to use instead.
    """
    expected = expected_orders(problem, tolerance)
    if max_order is not None:
        expected = np.minimum(expected, max_order)
    k = int(np.argmax(expected))
    minutes = expected_minutes(problem, float(expected[k]))
    if expected[k] <= MOST_ORDERS and minutes <= MOST_MINUTES:
        return
    depth = float(outward_profile(problem.table.columns)[0] @ problem.table.optics.sigma_t[:, k])
    raise DomainError(
        "optical depth", f"{depth:.3g} at {wavelengths[k]:g} nm",
        f"less for solver orders at a tolerance of {tolerance:g}: it would need some {expected[k]:.2g} orders of "
        f"scattering and {minutes:.2g} minutes of a processor; use solver path, a larger tolerance or max_order",
    )  # fmt: skip
