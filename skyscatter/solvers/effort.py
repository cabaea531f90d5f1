"""How long a solution by orders of scattering will take, known before it is begun."""

from __future__ import annotations

import numpy as np

from skyscatter.errors import ConvergenceError, DomainError
from skyscatter.memory import check_fits, field_bytes
from skyscatter.solvers.base import Array
from skyscatter.solvers.direct import outward_profile
from skyscatter.solvers.grid import MOST_GAP
from skyscatter.solvers.series import ORDERS_SHARE
from skyscatter.solvers.sweeps import Problem

#: Orders and minutes of one processor beyond which a solution is refused.
MOST_ORDERS, MOST_MINUTES = 1000, 60
#: Seconds for a point of a line, and for a wavelength there; for a moment of one Sun and wavelength at it; measured,
#: with caution.  How many orders that are summed have all moments, and what the others, which have few left, are worth.
POINT, OF_WAVELENGTH, OF_MOMENT = 1e-6, 3e-8, 4.5e-10
FIRST_ORDERS, LATER_SHARE = 4, 0.05
#: Sweeps of a solution that is not a sum of orders: two to nine, and those of the coarser one.
CYCLES = 8
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


def expected_minutes(problem: Problem, orders: float | None = None) -> float:
    """Minutes of one processor for the sum of so many orders, or for all of them in cycles; with caution.

    Cycles are made at some of the wavelengths, of which there are fewer than are reckoned with here.
    """
    grid, wavelengths = problem.grid, problem.diffuse.sigma_t.shape[1]
    points = grid.altitudes.size * grid.directions.shape[1] * POINTS * grid.rows.size
    moments = grid.sun_zenith.size * problem.moments.degree.size * wavelengths * problem.stokes
    sweeps = CYCLES if orders is None else orders
    whole = sweeps if orders is None else min(orders, FIRST_ORDERS) + LATER_SHARE * orders
    return float(points / 60 * (sweeps * (POINT + OF_WAVELENGTH * wavelengths) + whole * OF_MOMENT * moments))


def check_memory(problem: Problem) -> None:
    """Refuse a solution that memory does not hold.

    Raises
    ------
    DomainError
        That says how much it takes, how much there is, and what to change.
    """
    grid, wavelengths = problem.grid, problem.diffuse.sigma_t.shape[1]
    needed = field_bytes(
        grid.altitudes.size, grid.sun_zenith.size, problem.moments.degree.size, wavelengths, grid.seen.size
    )
    check_fits(
        needed, "wavelengths", wavelengths, f"a solution by orders to {problem.tolerance:g} takes",
        "give fewer wavelengths or a larger tolerance, or use solver path",
    )  # fmt: skip


def check_effort(problem: Problem, wavelengths: Array, tolerance: float, max_order: int | None) -> None:
    """Refuse a medium that is too deep for any grid, in which light is scattered too often, or which takes too long.

    Raises
    ------
    DomainError
        That says how deep the medium is, at which wavelength, and what to use instead.
    """
    profile = outward_profile(problem.table.columns, problem.grid.altitudes)
    gaps = (-np.diff(profile, axis=0) @ problem.diffuse.sigma_t).max(axis=0)
    expected = np.minimum(expected_orders(problem, tolerance), max_order or np.inf)
    k = int(np.argmax(expected))
    if max_order is not None:
        minutes = expected_minutes(problem, expected[k])
        why = f"it would need some {expected[k]:.2g} orders of scattering and {minutes:.2g} minutes of a processor"
        refused = minutes > MOST_MINUTES or expected[k] > MOST_ORDERS
    elif gaps.max() > MOST_GAP:
        k = int(np.argmax(gaps))
        why, refused = f"its finest grid has optical depths of {gaps[k]:.2g} from node to node", True
    else:
        minutes = expected_minutes(problem)
        why, refused = f"it would need some {minutes:.2g} minutes of a processor", minutes > MOST_MINUTES
    if not refused:
        return
    depth = float(profile[0] @ problem.table.optics.sigma_t[:, k])
    raise DomainError(
        "optical depth", f"{depth:.3g} at {wavelengths[k]:g} nm",
        f"less for solver orders at a tolerance of {tolerance:g}: {why}; use solver path, fewer wavelengths, a larger "
        "tolerance or max_order",
    )  # fmt: skip


def check_sum(problem: Problem, tolerance: float) -> None:
    """Refuse a sum of orders that takes too long, where nothing shorter has settled.

    Raises
    ------
    ConvergenceError
        That says what it would take, and what to use instead.
    """
    orders = float(expected_orders(problem, tolerance).max())
    minutes = expected_minutes(problem, orders)
    if orders > MOST_ORDERS or minutes > MOST_MINUTES:
        raise ConvergenceError(
            f"orders: light has not settled, and a sum of {orders:.2g} orders of scattering would take {minutes:.2g} "
            "minutes of a processor; use solver path, a larger tolerance or max_order"
        )
