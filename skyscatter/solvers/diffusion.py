"""A coarse diffusion solution of the light in a medium, by which walks are kept or split.

Where light is scattered many times its mean intensity J obeys

    -div (D grad J) + sigma_a J = S,    D = 1 / (3 sigma_tr + 3 / L)

with the transport extinction sigma_tr = sigma_a + (1 - g) sigma_s, the light S that is scattered for the first time or
emitted, and no light from outside but the background (Marshak's condition; Ishimaru 1978, Wave Propagation and
Scattering in Random Media, chapter 9).  L is the extent of the medium: what is empty conducts well, not infinitely.
Peaks of the phase function count as straight on, in the coefficients and in the beam alike (Joseph, Wiscombe & Weinman
1976).  Where much is absorbed D is such that light falls with the exponent of the slowest mode (`solvers.modes`).

The solution decides how many walks there are and never what they find.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skyscatter.solvers.compile import phase_cosines
from skyscatter.solvers.guide import guided_columns

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyscatter.kernels.volume import VolumeTable

Array = NDArray[np.float64]

#: Wavelengths that are solved for, at most; between them the correction is interpolated.
SOLVED = 5
#: Relative residual at which the solution is good enough, and iterations in which it is to be reached.
RESIDUAL, MOST_ITERATIONS = 1e-4, 1000
#: Where the light is but a small part of the brightest, that tells nothing.  Share of a cell's own light that may be
#: amiss there, what is amiss from which on it is sought anew, and sweeps in which it is to be found.
AMISS, LOST, MOST_SWEEPS = 0.01, 0.1, 400
#: The correction is kept within exp(+-this).
STEEPEST = 200.0
#: Squared exponent of diffusion below which a medium is as good as white.
WHITE = 3e-3


def guess_correction(table: VolumeTable) -> Array:
    """Logarithm of the ratio of the diffusion solution to the guess `kernels.volume.guess_light`.

    Returns
    -------
    ndarray, shape (x, y, z, wavelength)
        In the cells between the nodes of the guide.
    """
    count = table.background.size
    solved = np.unique(np.linspace(0, count - 1, min(count, SOLVED)).round().astype(int))
    cells = Cells(table)
    found = np.stack([cells.correction(int(i)) for i in solved], axis=-1)
    if solved.size == count:
        return found
    low = np.clip(np.searchsorted(solved, np.arange(count), side="right") - 1, 0, solved.size - 2)
    share = (np.arange(count) - solved[low]) / (solved[low + 1] - solved[low])
    return np.ascontiguousarray(found[..., low] * (1 - share) + found[..., low + 1] * share)


class Cells:
    """The medium on the cells of the guide."""

    def __init__(self, table: VolumeTable) -> None:
        from skyscatter.kernels.space import fill_densities, make_space_work

        self.table = table
        space = table.space
        self.size = space.bound_step * space.cells
        self.count = np.array(table.guide.shape[1:4]) - 1
        self.step = self.size / self.count
        axes = [space.bound_low[k] + (np.arange(self.count[k]) + 0.5) * self.step[k] for k in range(3)]
        self.centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        total = np.zeros((self.centres.size // 3, len(table.sigma_t)))
        out = np.zeros_like(total)
        for corner in np.ndindex(2, 2, 2):
            points = self.centres + (np.array(corner) - 0.5) * 0.5 * self.step
            fill_densities(space, points.reshape(-1, 3), make_space_work(), out)
            total += out / 8
        self.density = total.reshape(*self.count, -1)
        self.wrap = [bool(space.bound_wrap[k]) for k in range(3)]
        self.cosines = mean_cosines(table.phase)
        columns = guided_columns(table, self.centres)
        self.lights = [(columns[k], *self._fall(k)) for k in range(len(table.power))]

    def _fall(self, k: int) -> tuple[Array, Array]:
        """The fall of light k (x, y, z), and the distance of every cell."""
        if self.table.distant[k]:
            return np.ones(self.centres.shape[:3]), np.full(self.centres.shape[:3], np.inf)
        far = np.linalg.norm(self.centres - self.table.place[k], axis=-1)
        return np.maximum(far, 0.3 * self.step.min()) ** -2.0, far

    def correction(self, i: int) -> Array:
        """The same for wavelength number i, shape (x, y, z)."""
        table = self.table
        sigma_s, sigma_t = self.density @ table.sigma_s[:, i], self.density @ table.sigma_t[:, i]
        onward = self.density @ (table.sigma_s[:, i] * self.cosines[:, i])
        transport = sigma_t - onward
        straight = table.sigma_t[:, i] - table.sigma_s[:, i] * self.cosines[:, i]
        guess = np.full(sigma_t.shape, table.floor[i])
        source = self.density @ table.emission[:, i] * 4 * np.pi
        beam = np.zeros_like(guess)
        for k, (columns, fall, far) in enumerate(self.lights):
            light = table.power[k, i] * fall
            depth = columns @ table.sigma_t[:, i]
            guess += light * (0.1 + depth) * np.exp(-table.decay[i] * depth)
            direct = light * np.exp(-(columns @ straight))
            first = (sigma_s - onward) * direct
            inside = np.unravel_index(np.argmin(far), far.shape)
            if far[inside] < self.step.max():
                # What a star sends into its own cell is all that does not leave it straight.
                share = -np.expm1(-0.5 * self.step.min() * transport[inside])
                kept = float((sigma_s - onward)[inside] / max(float(transport[inside]), 1e-300))
                first[inside] = 4 * np.pi * table.power[k, i] * share * kept / self.step.prod()
            source += first
            # Light in the peak of the phase function was scattered too.
            beam += direct - light * np.exp(-depth)
        resistance = self._resistance(i, transport, sigma_t)
        fluence = self._solve(resistance, sigma_t - sigma_s, source, 4 * np.pi * table.background[i]) + beam
        ratio = np.log(np.maximum(fluence, 1e-300)) - np.log(np.maximum(guess, 1e-300))
        return np.clip(ratio, -STEEPEST, STEEPEST)

    def _resistance(self, i: int, transport: Array, sigma_t: Array) -> list[Array]:
        """1 / (2 D) along every axis [m-1], such that light falls as in the slowest mode, however coarse the cells."""
        table = self.table
        scattering, extinction = table.sigma_s[:, i].sum(), max(float(table.sigma_t[:, i].sum()), 1e-300)
        straight = float(table.sigma_s[:, i] @ self.cosines[:, i]) / extinction
        diffusive = 3 * (1 - scattering / extinction) * (1 - straight)
        # Nearly white media have the exponent of diffusion.
        slower = max(diffusive / table.decay[i] ** 2, 1.0) if diffusive > WHITE else 1.0
        plain = 1.5 * (transport + 1 / np.linalg.norm(self.size)) / slower
        fall = table.decay[i] if diffusive > WHITE else np.sqrt(max(diffusive, 0.0))
        steps = [np.minimum(fall * sigma_t * step, 50.0) for step in self.step]
        return [plain * np.where(x > 1e-3, 2 * (np.cosh(x) - 1) / np.maximum(x, 1e-3) ** 2, 1.0) for x in steps]

    def _solve(self, resistance: list[Array], absorption: Array, source: Array, outside: float) -> Array:
        """Fluence by conjugate gradients on finite volumes, preconditioned by the diagonal."""
        conductance, rim = [], np.zeros_like(source)
        for k in range(3):
            half = np.moveaxis(resistance[k], k, 0) * self.step[k]
            between = 1 / (half[1:] + half[:-1])
            edge = 1 / (half[[0, -1]] + 2.0)
            if self.wrap[k]:
                between = np.concatenate([between, 1 / (half[:1] + half[-1:])])
            else:
                np.moveaxis(rim, k, 0)[[0, -1]] += edge / self.step[k]
            conductance.append(between / self.step[k])
        diagonal = absorption + rim
        for k, between in enumerate(conductance):
            along = np.moveaxis(diagonal, k, 0)
            n = len(along)
            along[: len(between)] += between
            along[1:] += between[: n - 1]
            if self.wrap[k]:
                along[0] += between[-1]

        def product(x: Array) -> Array:
            y = diagonal * x
            for k, between in enumerate(conductance):
                xs, ys = np.moveaxis(x, k, 0), np.moveaxis(y, k, 0)
                n = len(xs)
                ys[:-1] -= between[: n - 1] * xs[1:]
                ys[1:] -= between[: n - 1] * xs[:-1]
                if self.wrap[k]:
                    ys[-1] -= between[-1] * xs[0]
                    ys[0] -= between[-1] * xs[-1]
            return y

        return _settled(product, diagonal, source + rim * outside)


def _conjugate_gradients(product: Callable[[Array], Array], diagonal: Array, source: Array) -> Array:
    """Solution of a symmetric positive system; sums without a library whose order might depend on threads."""
    x = np.zeros_like(source)
    rest = source.copy()
    step = z = rest / diagonal
    old = float(np.sum(rest * z))
    start = old
    for _ in range(MOST_ITERATIONS):
        if not old > RESIDUAL**2 * start:
            break
        there = product(step)
        length = old / float(np.sum(step * there))
        x += length * step
        rest -= length * there
        z = rest / diagonal
        new = float(np.sum(rest * z))
        step = z + new / old * step
        old = new
    return x


def _settled(product: Callable[[Array], Array], diagonal: Array, source: Array) -> Array:
    """The same, to a share of every cell's own light: behind many absorptions the brightest cell says nothing of it.

    Gauss-Seidel sweeps over the two colours of a chequerboard, from below, for light is nowhere negative: cells whose
    light is amiss are dark at first, and are lit again from those around them.
    """
    x = _conjugate_gradients(product, diagonal, source)
    x[np.abs(source - product(x)) > LOST * diagonal * x] = 0.0
    odd = np.indices(x.shape).sum(axis=0) % 2 == 1
    for _ in range(MOST_SWEEPS):
        before = x
        for colour in (odd, ~odd):
            x = np.where(colour, x + (source - product(x)) / diagonal, x)
        if np.all(np.abs(x - before) <= AMISS * x):
            break
    return x


def mean_cosines(phase: Array) -> Array:
    """Mean cosine of the scattering angle, at least 0, shape (component, wavelength)."""
    mu = phase_cosines()
    whole = -np.trapezoid(phase, mu, axis=1)
    return np.clip(-np.trapezoid(phase * mu[None, :, None], mu, axis=1) / np.maximum(whole, 1e-300), 0.0, 1.0)
