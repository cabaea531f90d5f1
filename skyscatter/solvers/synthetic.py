"""What a sweep of the grid still misses, from the exchange of light up and down in a few spherical harmonics.

A sweep carries light about one free path far, and in a thick medium the sum over the orders grows for hundreds of them.
But what is missing there is smooth.  A sweep makes L' of a light L; of the light that is right L' misses e, what
scattering makes of r = L' - L, and all that follows.  In a plane-parallel medium, whose orders m of azimuth are apart,
the moments e_lm of that are bound to their neighbours by the equation of transfer,

    sqrt((l+1)^2 - m^2) de_l+1/dz + sqrt(l^2 - m^2) de_l-1/dz
        = (2 l + 1) ((sigma_t - chi_l sigma_s) e_l - chi_l sigma_s r_l),

in the moments of `moments.py`, which are of where light comes from.  A few degrees from l = m on will do; the rest is
left out.  No light comes from above, and from below what the ground of albedo A sends back, the same from everywhere;
both hold on average with the moments of odd l - m as weights (Marshak's conditions).  For m = 0 and two degrees this is
the diffusion of light.  Every Sun has its own column, for light does not come from afar where it is scattered often.
Alcouffe (1977), Nucl. Sci. Eng. 64, 344; Adams & Larsen (2002), Prog. Nucl. Energy 40, 3; Marshak's conditions: Davison
(1957), Neutron Transport Theory, section 10.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.direct import outward_profile
from skyscatter.solvers.moments import I_KIND, wigner
from skyscatter.solvers.sweeps import Problem
from skyscatter.solvers.transfer import Light

Array = NDArray[np.float64]

#: Pairs of degrees of each order of azimuth.  With one pair sweeps of a cloud leave a third of what was missing, with
#: two an eighth, with three or four a tenth or less.
PAIRS = 3
#: Coefficient of a phase function below which an order of azimuth fades by itself.
LEAST_COEFFICIENT = 0.05
#: Optical depth between two nodes below which they are as good as one.
THINNEST = 1e-9
#: What is left of a mean radiance or a flux at least: light is not negative.
LEAST = 0.3
#: Points of the rule by which half-range integrals of products of angular functions are found.
HALF_RANGE = 40


class Harmonics:
    """The exchange of light in the columns of a problem, between its nodes."""

    def __init__(self, problem: Problem) -> None:
        columns = _Columns.of(problem)
        orders = range(int(problem.moments.order.max()) + 1)
        self.orders = [_Order.of(problem, columns, m) for m in orders if m == 0 or columns.turns(m) > LEAST_COEFFICIENT]

    def begun(self, first: Light) -> Light:
        """The first order with an estimate of all others."""
        return self.corrected(Light(np.zeros_like(first.moments), np.zeros_like(first.flux)), first)

    def corrected(self, light: Light, swept: Light) -> Light:
        """What a sweep made of a light, with what it still misses."""
        moments, flux = swept.moments.copy(), swept.flux
        for order in self.orders:
            even, odd = order.missing(light.moments, swept.moments)
            order.add(moments, even, odd)
            if order.azimuth == 0:
                moments[:, :, 0] = np.maximum(moments[:, :, 0], LEAST * swept.moments[:, :, 0])
                flux = np.maximum(flux + order.flux(even, odd), LEAST * flux)
        return Light(moments, flux)


@dataclass(frozen=True)
class _Columns:
    """Optical depths around nodes and between them."""

    around: Array  #: columns of the components around a node [m], (node, component)
    between: Array  #: and between two, (node - 1, component)
    extinction: Array  #: per unit column, (component, wavelength)
    scattering: Array  #: times the coefficient of each degree, (degree, component, wavelength)
    albedo: Array  #: of the ground, (wavelength,)

    @classmethod
    def of(cls, problem: Problem) -> _Columns:
        """Those of a problem."""
        light, altitudes, columns = problem.diffuse, problem.grid.altitudes, problem.table.columns
        middles = 0.5 * (altitudes[1:] + altitudes[:-1])
        at_nodes = outward_profile(columns, altitudes)
        edges = np.concatenate([at_nodes[:1], outward_profile(columns, middles), at_nodes[-1:]])
        degree = np.arange(light.greek.shape[2])[:, None, None]
        scattering = 4 * np.pi / (2 * degree + 1) * np.moveaxis(light.greek[0], 1, 0)
        return cls(edges[:-1] - edges[1:], at_nodes[:-1] - at_nodes[1:], light.sigma_t, scattering, light.light[2])

    def turns(self, degree: int) -> float:
        """Greatest coefficient of that degree among the components."""
        return float(np.max(self.scattering[degree] / np.maximum(self.scattering[0], 1e-300)))

    def scattered(self, columns: Array, degrees: list[int]) -> Array:
        """(2 l + 1) chi_l times optical depths of scattering, (column, degree, wavelength); 0 beyond what is known."""
        out = np.zeros((len(columns), len(degrees), len(self.albedo)))
        for k, degree in enumerate(degrees):
            if degree < len(self.scattering):
                out[:, k] = (2 * degree + 1) * columns @ self.scattering[degree]
        return out

    def left(self, columns: Array, degrees: list[int]) -> Array:
        """(2 l + 1) times optical depths of what is not scattered on, in the same shape."""
        factors = 2.0 * np.array(degrees)[:, None] + 1
        return np.maximum(factors * (columns @ self.extinction)[:, None] - self.scattered(columns, degrees), 0.0)


@dataclass(frozen=True)
class _Order:
    """An order of azimuth: moments of even degree, counted from the order, at nodes, and odd ones between them."""

    azimuth: int
    even: list[int | None]  #: their numbers among the moments of the problem; None: nothing scatters them
    odd: list[int | None]
    binds: Array  #: factors of the derivatives, (even, odd)
    sends: Array  #: half-range integrals by which even moments make odd ones where light leaves, (odd, even)
    made: Array  #: what scattering makes of even moments around a node, (node, even, wavelength)
    driven: Array  #: and of odd ones between two, (node - 1, odd, wavelength)
    conducts: Array  #: (node - 1, odd, wavelength)
    equations: _Equations  #: of even moments at nodes

    @classmethod
    def of(cls, problem: Problem, columns: _Columns, m: int) -> _Order:
        """One of a problem's orders."""
        table = problem.moments
        mine = np.flatnonzero((table.order == m) & (table.kind == I_KIND))
        number = {int(table.degree[k]): int(k) for k in mine}
        pairs = max(min(PAIRS, (int(table.degree.max()) - m + 2) // 2), 1)
        even, odd = ([m + side + 2 * k for k in range(pairs)] for side in (0, 1))
        binds = np.zeros((pairs, pairs))
        for i, low in enumerate(even):
            for j, high in enumerate(odd):
                if abs(low - high) == 1:
                    binds[i, j] = np.sqrt(max(low, high) ** 2 - m * m)
        x, w = np.polynomial.legendre.leggauss(HALF_RANGE)
        functions = wigner(odd[-1], m, 0, 0.5 * (x + 1))
        sends = np.einsum("k,ik,jk->ij", 0.5 * w, functions[odd], functions[even]) * (2 * np.array(even) + 1)
        whole = functions[odd] @ (0.5 * w) if m == 0 else np.zeros(pairs)
        conducts = 1.0 / np.maximum(columns.left(columns.between, odd), THINNEST)
        equations = _Equations.of(columns.left(columns.around, even), conducts, binds, sends, whole, columns.albedo)
        return cls(
            m, [number.get(k) for k in even], [number.get(k) for k in odd], binds, sends,
            columns.scattered(columns.around, even), columns.scattered(columns.between, odd), conducts, equations,
        )  # fmt: skip

    def missing(self, light: Array, swept: Array) -> tuple[Array, Array]:
        """What moments (node, sun, moment, wavelength) of a swept light miss, even and odd ones, in the same shape."""
        high = _some(swept, self.odd) - _some(light, self.odd)
        driven = (self.conducts * self.driven)[:, None] * (0.5 * (high[1:] + high[:-1]))
        made = self.made[:, None] * (_some(swept, self.even) - _some(light, self.even))
        into = np.einsum("ij,nsjw->nsiw", self.binds, driven)
        made[:-1] += into
        made[1:] -= into
        even = self.equations.solved(made.transpose(0, 3, 2, 1)).transpose(0, 3, 2, 1)
        between = driven + self.conducts[:, None] * np.einsum("ij,nsiw->nsjw", self.binds, np.diff(even, axis=0))
        return even, np.concatenate([between[:1], 0.5 * (between[1:] + between[:-1]), between[-1:]])

    def add(self, moments: Array, even: Array, odd: Array) -> None:
        """Add these to the moments of a light."""
        for numbers, values in ((self.even, even), (self.odd, odd)):
            for k, number in enumerate(numbers):
                if number is not None:
                    moments[:, :, number] += values[:, :, k]

    def flux(self, even: Array, odd: Array) -> Array:
        """Their irradiances, upward and downward, (node, 2, sun, wavelength); of the order 0."""
        both_ways = np.einsum("i,nsiw->nsw", self.sends[0], even)
        return 0.5 * np.stack([both_ways - odd[:, :, 0], both_ways + odd[:, :, 0]], axis=1)


def _some(moments: Array, numbers: list[int | None]) -> Array:
    """Moments with these numbers, zeros for those that are not there."""
    return np.stack([np.zeros_like(moments[:, :, 0]) if k is None else moments[:, :, k] for k in numbers], axis=2)


@dataclass(frozen=True)
class _Equations:
    """Equations of even moments at nodes, each of which is bound to its neighbours; eliminated from the ground up.

    With E_n the inverse of what is left of the block of node n when those below are gone, and K_n what binds it to
    node n + 1, the moments are e_n = y_n + E_n K_n e_n+1, where y_n = E_n (q_n + K_n-1 y_n-1).
    """

    inverse: Array  #: E_n, (node, wavelength, even, even)
    upward: Array  #: E_n K_n-1, (node - 1, wavelength, even, even)
    downward: Array  #: E_n K_n

    @classmethod
    def of(
        cls, left: Array, conducts: Array, binds: Array, sends: Array, whole: Array, albedo: Array
    ) -> _Equations:  # fmt: skip
        """Those of an order of azimuth.

        `left` (node, even, wavelength) is what is taken from each, and the half-range integrals `whole` (odd,) say
        what light that is the same from everywhere sends into the odd ones.
        """
        nodes, pairs, wavelengths = left.shape
        links = np.einsum("ij,njw,kj->nwik", binds, conducts, binds)
        blocks = np.zeros((nodes, wavelengths, pairs, pairs))
        blocks[..., np.arange(pairs), np.arange(pairs)] = left.transpose(0, 2, 1)
        blocks[:-1] += links
        blocks[1:] += links
        blocks[-1] += binds @ sends
        # A row of what the ground sends up for a unit that comes down.
        back = 2 * albedo[:, None, None] * whole[:, None]
        taken = np.eye(pairs) + back * np.eye(1, pairs)
        blocks[0] += binds @ np.linalg.solve(taken, sends - back * sends[0])
        inverse = np.empty_like(blocks)
        inverse[0] = np.linalg.inv(blocks[0])
        for n in range(1, nodes):
            inverse[n] = np.linalg.inv(blocks[n] - links[n - 1] @ inverse[n - 1] @ links[n - 1])
        return cls(inverse, inverse[1:] @ links, inverse[:-1] @ links)

    def solved(self, asked: Array) -> Array:
        """The moments that what is `asked` (node, wavelength, even, sun) makes, in the same shape."""
        found = self.inverse @ asked
        for n in range(1, len(found)):
            found[n] += self.upward[n - 1] @ found[n - 1]
        for n in range(len(found) - 2, -1, -1):
            found[n] += self.downward[n] @ found[n + 1]
        return found
