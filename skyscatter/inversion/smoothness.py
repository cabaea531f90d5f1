"""Smooth functions behind noisy linear data: Gaussian-process priors whose settings the data decide.

The data are y = P f + N b + noise, with the unknown function f = A g, g a Gaussian process of unit variance with the
covariance of Matern (Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, eq. 4.14), and nuisances b
(a constant of f, a background) of which nothing is known beforehand.  Length and order of the covariance, A and, where
it is not given, the noise sigma are not chosen but weighed: each combination on a grid counts by its marginal
likelihood with b integrated out (Patterson & Thompson 1971, Biometrika 58, 545; Wahba 1985, Ann. Stat. 13, 1378).  The
posterior is then a mixture of Gaussians, whose variance holds the noise, what smoothing takes away (Wahba 1983, J. R.
Stat. Soc. B 45, 133; Nychka 1988, J. Am. Stat. Assoc. 83, 1134), and the doubt about the settings themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import factorial

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: How often f can be differentiated, and half of one: broken lines, one derivative, two, all of them.
ORDERS = (0.5, 1.5, 2.5, np.inf)
_LENGTHS = 12  #: lengths of the covariance that are weighed
_RATIOS = np.linspace(-2.0, 26.0, 113)  #: log10 of (A s)^2 / sigma^2, with s the greatest singular value
_NEGLIGIBLE = 1e-4  #: settings with less than this share of the weight are left out


def matern(distance: Array, order: float) -> Array:
    """Matern's covariance of unit variance at distances in units of its length.

    Rasmussen & Williams (2006), eq. 4.16, for an order that is half of an odd number; infinity gives exp(-d^2 / 2).
    """
    if np.isinf(order):
        return np.asarray(np.exp(-0.5 * distance**2))
    p = round(order - 0.5)
    x = np.sqrt(2 * order) * distance
    powers = [factorial(p + i) / (factorial(i) * factorial(p - i)) * (2 * x) ** (p - i) for i in range(p + 1)]
    return np.asarray(factorial(p) / factorial(2 * p) * sum(powers) * np.exp(-x))


def covariance(nodes: Array, length: float, order: float, even: bool) -> Array:
    """Covariance (node, node) of g; with `even`, of a function that is mirrored at zero."""
    c = matern(np.abs(nodes[:, None] - nodes[None, :]) / length, order)
    if even:
        c = c + matern((nodes[:, None] + nodes[None, :]) / length, order)
    return c


@lru_cache(maxsize=80)
def _root(nodes_bytes: bytes, length: float, order: float, even: bool) -> Array:
    """Matrix L with L L^T the covariance; by eigenvectors, for smooth covariances are all but singular."""
    values, vectors = np.linalg.eigh(covariance(np.frombuffer(nodes_bytes), length, order, even))
    keep = values > 1e-15 * values[-1]
    return np.ascontiguousarray(vectors[:, keep] * np.sqrt(values[keep]))


def compressed(design: Array, nuisances: Array, data: Array) -> tuple[Array, Array, Array, int, float]:
    """Many data, whitened, as few as there are unknowns, with the same likelihood.

    Returns
    -------
    design, nuisances, data : ndarray
        Of as many rows as there are unknowns in all (or fewer).
    more_points : int
        Data that are left over, and
    more_misfit : float
        their sum of squares.
    """
    count = nuisances.shape[1]
    q, r = np.linalg.qr(np.hstack([nuisances, design]))
    kept = q.T @ data
    left = data - q @ kept
    return r[:, count:], r[:, :count], kept, len(data) - len(kept), float(left @ left)


def lengths_for(nodes: Array) -> Array:
    """Lengths that are weighed: from two spacings of the nodes to thrice their extent."""
    extent = nodes[-1] - nodes[0]
    spacing = extent / (len(nodes) - 1)
    return np.geomspace(2 * spacing, 3 * extent, _LENGTHS)


@dataclass(frozen=True)
class Setting:
    """One covariance with the data seen through it: what `Smooth` keeps of it."""

    length: float
    order: float
    left: Array  # (point, rank) singular vectors of the whitened, nuisance-free design
    singular: Array  # (rank,)
    right: Array  # (rank, mode)
    ratio: Array  # (ratio,) A^2 / sigma^2
    shrink: Array  # (ratio, rank) 1 / (1 + ratio singular^2)
    half_log: Array  # (ratio,) half the logarithm of the product of `shrink`
    seen: Array  # (node, rank) from whitened modes to f, with the nuisances that then fit best
    unseen: Array  # (node, mode) the same for what the data do not see at all


class Smooth:
    """The linear problem for one geometry and one relative noise; any number of data sets may be put to it.

    Parameters
    ----------
    nodes : ndarray, shape (node,)
        Where f is asked for.
    design : ndarray, shape (point, node)
        P, the data that f gives.
    sigma : ndarray, shape (point,)
        Standard deviation of the noise, or its shape up to a factor.
    nuisances : ndarray, shape (point, nuisance)
        N.
    shifts : ndarray, shape (node, nuisance)
        What each nuisance adds to f: ones for a constant, zero for a background.
    even : bool
        Whether f is mirrored at zero.
    orders : sequence of float
    lengths : ndarray, optional
    more_points : int
        Data beyond these that no f and no nuisance can change; see `compressed`.
    """

    def __init__(
        self,
        nodes: Array,
        design: Array,
        sigma: Array,
        nuisances: Array,
        shifts: Array,
        even: bool = True,
        orders: Sequence[float] = ORDERS,
        lengths: Array | None = None,
        more_points: int = 0,
    ) -> None:
        self.more_points = more_points
        self.nodes, self.shifts, self.sigma = nodes, shifts, sigma
        self.design = design / sigma[:, None]
        self.nuisances = nuisances / sigma[:, None]
        self.basis, self.triangle = np.linalg.qr(self.nuisances)
        self.free = self.design - self.basis @ (self.basis.T @ self.design)
        key = np.ascontiguousarray(nodes).tobytes()
        scales = lengths_for(nodes) if lengths is None else lengths
        self.settings = [self._setting(key, float(n), o, even) for o in orders for n in scales]

    def _setting(self, key: bytes, length: float, order: float, even: bool) -> Setting:
        root = _root(key, length, order, even)
        left, singular, right = np.linalg.svd(self.free @ root, full_matrices=False)
        keep = singular > 1e-14 * singular[0]
        left, singular, right = left[:, keep], singular[keep], right[keep]
        ratio = 10.0**_RATIOS / singular[0] ** 2
        shrink = 1.0 / (1.0 + ratio[:, None] * singular**2)
        if self.shifts.any():
            back = np.linalg.solve(self.triangle, self.basis.T @ (self.design @ root))
            root = root - self.shifts @ back
        seen = root @ right.T
        return Setting(
            length, order, left, singular, right, ratio, shrink, 0.5 * np.log(shrink).sum(axis=1), seen,
            root - seen @ right,
        )  # fmt: skip

    @property
    def freedoms(self) -> int:
        """Data less nuisances."""
        return len(self.sigma) + self.more_points - self.nuisances.shape[1]

    def posterior(self, data: Array, known_noise: bool, more_misfit: float = 0.0) -> Posterior:
        """What the data say, all settings weighed.

        Parameters
        ----------
        data : ndarray, shape (point,)
        known_noise : bool
            Whether `sigma` is the noise itself; else the noise is `sigma` times an unknown factor.
        more_misfit : float
            Sum of squares of the `more_points`, in units of sigma.
        """
        y = data / self.sigma
        y = y - self.basis @ (self.basis.T @ y)
        total = float(y @ y) + more_misfit
        parts = [self._evidence(s, y, total, known_noise) for s in self.settings]
        log = np.array([part.log_evidence for part in parts])
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        return Posterior(self, data / self.sigma, tuple(parts), weight, known_noise)

    def _evidence(self, setting: Setting, y: Array, total: float, known_noise: bool) -> Evidence:
        beta = setting.left.T @ y
        rest = max(total - float(beta @ beta), 0.0)
        # Never below what rounding leaves of the data, so that data without noise have a finite likelihood.
        misfit = np.maximum(setting.shrink @ beta**2 + rest, 1e-30 * total + 1e-300)
        n = self.freedoms
        log = setting.half_log - (0.5 * misfit if known_noise else 0.5 * n * np.log(misfit))
        return Evidence(beta, misfit, log)


@dataclass(frozen=True)
class Evidence:
    """Marginal likelihood of one covariance for each ratio A^2 / sigma^2, and what it is made of."""

    beta: Array  # (rank,) data in the singular vectors
    misfit: Array  # (ratio,)
    log_evidence: Array  # (ratio,)


@dataclass(frozen=True)
class Node:
    """One setting with one ratio: a Gaussian."""

    weight: float
    setting: int
    ratio: float
    variance: float  #: of the noise in units of sigma^2
    mean: Array  #: of f (node,)
    shrink: Array  #: 1 / (1 + ratio singular^2), (rank,)


class Posterior:
    """A mixture of Gaussians over f and the nuisances."""

    def __init__(
        self, problem: Smooth, data: Array, parts: tuple[Evidence, ...], weight: Array, known_noise: bool
    ) -> None:
        self.problem, self.data, self.parts, self.known_noise = problem, data, parts, known_noise
        self.weight = weight
        kept = np.argwhere(weight > _NEGLIGIBLE)
        scale = weight[tuple(kept.T)].sum()
        self.offset = np.linalg.solve(problem.triangle, problem.basis.T @ data)
        self.nodes = [self._node(int(j), int(k), weight[j, k] / scale) for j, k in kept]

    def _node(self, j: int, k: int, weight: float) -> Node:
        part, setting = self.parts[j], self.problem.settings[j]
        ratio, shrink = float(setting.ratio[k]), setting.shrink[k]
        variance = 1.0 if self.known_noise else float(part.misfit[k]) / max(self.problem.freedoms - 2, 1)
        mean = setting.seen @ (ratio * setting.singular * shrink * part.beta) + self.problem.shifts @ self.offset
        return Node(weight, j, ratio, variance, mean, shrink)

    def node_root(self, node: Node) -> Array:
        """Matrix R with R R^T the covariance of f in one Gaussian of the mixture."""
        setting = self.problem.settings[node.setting]
        parts = [np.sqrt(node.ratio) * setting.seen * np.sqrt(node.shrink), np.sqrt(node.ratio) * setting.unseen]
        if self.problem.shifts.any():
            parts.append(self.problem.shifts @ np.linalg.inv(self.problem.triangle))
        root: Array = np.sqrt(node.variance) * np.hstack(parts)
        return root

    @cached_property
    def mean(self) -> Array:
        """Mean of f (node,)."""
        return np.asarray(sum(node.weight * node.mean for node in self.nodes))

    def _roots(self) -> list[Array]:
        """Matrices the sum of whose R R^T is the covariance of f."""
        roots = [np.stack([np.sqrt(node.weight) * (node.mean - self.mean) for node in self.nodes], axis=1)]
        for j in sorted({node.setting for node in self.nodes}):
            mine, setting = [node for node in self.nodes if node.setting == j], self.problem.settings[j]
            within = sum(node.weight * node.variance * node.ratio * node.shrink for node in mine)
            beyond = sum(node.weight * node.variance * node.ratio for node in mine)
            roots += [setting.seen * np.sqrt(within), setting.unseen * np.sqrt(beyond)]
        if self.problem.shifts.any():
            roots.append(self.noise * self.problem.shifts @ np.linalg.inv(self.problem.triangle))
        return roots

    @cached_property
    def covariance(self) -> Array:
        """Covariance of f (node, node), doubt about the settings included."""
        return np.asarray(sum(root @ root.T for root in self._roots()))

    @cached_property
    def variance(self) -> Array:
        """Diagonal of the covariance (node,), at a small part of its cost."""
        return np.asarray(sum(np.einsum("ij,ij->i", root, root) for root in self._roots()))

    @property
    def noise(self) -> float:
        """Noise in units of the problem's `sigma` (1 where that is the noise itself)."""
        return float(np.sqrt(sum(node.weight * node.variance for node in self.nodes)))

    @property
    def freedoms(self) -> float:
        """Effective degrees of freedom of the fit: trace of the matrix from data to fitted data, nuisances included."""
        count = self.problem.nuisances.shape[1]
        return count + sum(node.weight * float((1.0 - node.shrink).sum()) for node in self.nodes)

    def average(self, name: str) -> float:
        """Geometric mean over the mixture of the covariance's "length", or of f's "amplitude" A."""
        logs = {
            "length": lambda n: np.log(self.problem.settings[n.setting].length),
            "amplitude": lambda n: 0.5 * np.log(n.ratio * n.variance),
        }[name]
        return float(np.exp(sum(node.weight * logs(node) for node in self.nodes)))

    def nuisances(self, f: Array) -> Array:
        """Nuisances (nuisance,) that fit best beside a given f from which their own shifts are taken off."""
        back = np.linalg.solve(self.problem.triangle, self.problem.basis.T)
        return np.asarray(back @ (self.data - self.problem.design @ f))

    def draws(self, count: int, rng: np.random.Generator) -> list[tuple[Node, Array]]:
        """Samples of f, grouped by the Gaussian they come from: pairs of it and an array (sample, node).

        The Gaussians are chosen by systematic sampling of their weights, so that they are represented evenly.
        """
        edges = np.cumsum([node.weight for node in self.nodes])
        chosen = np.searchsorted(edges / edges[-1], (np.arange(count) + rng.random()) / count)
        groups = []
        for i in np.unique(chosen):
            node = self.nodes[int(i)]
            root = self.node_root(node)
            white = rng.standard_normal((int((chosen == i).sum()), root.shape[1]))
            if not self.known_noise:  # Student's t: the noise has its own doubt
                half = 0.5 * self.problem.freedoms
                scale = (half - 1.0) / rng.gamma(half, size=(len(white), 1)) if half > 1 else 1.0
                white = white * np.sqrt(scale)
            groups.append((node, node.mean + white @ root.T))
        return groups
