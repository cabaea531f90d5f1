"""From light at a few wavelengths to XYZ: weights that suit the spectra of one sky.

What leaves a sky is sunlight times something that changes slowly with the wavelength: powers of it, the absorption of
ozone, a ground's albedo.  Spectra of that sort are made from the optics of the sky's own components, and the weights
for a few wavelengths are those with which their XYZ come out best (least squares); what the spectra leave open
is settled by cubics between the wavelengths.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyscatter.image.colour import xyz_weights
from skyscatter.solvers.compile import compile_scene
from skyscatter.solvers.grid import cubic_weights

if TYPE_CHECKING:
    from skyscatter.kernels.optics import OpticsTable
    from skyscatter.scene import Scene

Array = NDArray[np.float64]

#: Wavelengths of the pictures that the colours shall equal [nm], those of ``skyscatter sky``.
EVERY = np.arange(380.0, 781.0, 10.0)
#: Shortest and longest wavelength at which light is solved for [nm].
ENDS = (400.0, 690.0)
#: Spectra that are made, and slant optical depths of a component up to which.
SPECTRA, DEEPEST = 800, 6.0
#: Weight of the cubics beside the spectra.
CUBIC = 1e-3


class Colours(NamedTuple):
    """A few wavelengths, and what turns light at them into XYZ."""

    wavelengths: Array  #: (wavelength,) [nm]
    weights: Array  #: (wavelength, 3) XYZ [cd m-2] of a radiance there [W m-2 sr-1 nm-1]


def colours_of(scene: Scene, count: int) -> Colours:
    """Weights for `count` wavelengths that suit a scene."""
    few = np.linspace(*ENDS, count)
    every, some = (compile_scene(scene, wavelengths).optics for wavelengths in (EVERY, few))
    light, light_some = every.sun_irradiance.sum(axis=0), some.sun_irradiance.sum(axis=0)
    whole = light[:, None] * xyz_weights(EVERY)  # of what is left of sunlight
    column = 1.0 / np.maximum(every.sigma_t.max(axis=1), 1e-300)
    taken, spectra = _spectra(some, column), _spectra(every, column)
    between = np.zeros((EVERY.size, few.size))
    inside = np.clip(EVERY, *ENDS)
    number, weight = cubic_weights(few, inside)
    np.add.at(between, (np.arange(EVERY.size)[:, None], number), weight)
    first = between.T @ whole
    wanted = spectra @ whole
    level = wanted[:, 1:2]
    taken, wanted = taken / level, wanted / level
    scale = np.linalg.norm(taken) / np.sqrt(len(first))
    system = np.concatenate([taken, CUBIC * scale * np.eye(count)])
    solved = np.linalg.lstsq(system, np.concatenate([wanted, CUBIC * scale * first]), rcond=None)[0]
    return Colours(few, solved / light_some[:, None])


def _spectra(optics: OpticsTable, column: Array) -> Array:
    """What skies may do to sunlight, (spectrum, wavelength): dim it, scatter it once or twice, reflect it.

    `column` (component,) [m] has an optical depth of 1 where the component is densest to light.
    """
    random = np.random.default_rng(1)
    count = column.size
    depth = DEEPEST * random.random((SPECTRA, count)) ** 3
    dimmed = np.exp(-(depth * column) @ optics.sigma_t)
    relative = optics.sigma_s * column[:, None]
    mixed = random.random((SPECTRA, count)) ** 2 @ relative + 1e-6
    twice = np.where(random.random((SPECTRA, 1)) < 0.3, random.random((SPECTRA, count)) @ relative + 1e-6, 1.0)
    ground = np.where(random.random((SPECTRA, 1)) < 0.2, np.maximum(optics.albedo, 1e-3), 1.0)
    return np.asarray(dimmed * mixed * twice * ground)
