"""The slowest mode of light in the depths, against closed forms and published roots."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from skyscatter.solvers.modes import SHAPE_NODES, slowest_mode

ISOTROPIC = np.eye(1, 32)[0]


@pytest.mark.parametrize("omega", [0.5, 0.6, 0.9, 0.99])
def test_isotropic_scattering_has_the_root_of_its_characteristic_equation(omega: float) -> None:
    # Case & Zweifel 1967, eq. 4.3: 1 = (omega / 2 kappa) ln((1 + kappa) / (1 - kappa)).
    root = brentq(lambda k: omega / (2 * k) * math.log((1 + k) / (1 - k)) - 1, 1e-6, 1 - 1e-12)
    kappa, shape = slowest_mode(omega, ISOTROPIC)
    # 64 Gauss points integrate 1 / (1 - kappa mu) to 1e-9 up to kappa = 0.96.
    assert kappa == pytest.approx(root, rel=1e-7)
    mu = np.linspace(-1, 1, SHAPE_NODES)
    ideal = 1 / (1 - kappa * mu)
    ratio = shape / ideal
    # One factor for all cosines: the normalisation.
    assert np.ptp(ratio) < 1e-9 * ratio.mean()


@pytest.mark.parametrize("g", [-0.3, 0.0, 0.5, 0.85])
def test_nearly_white_media_diffuse(g: float) -> None:
    # kappa -> sqrt(3 (1 - omega) (1 - omega g)) as omega -> 1 (Ishimaru 1978, eq. 9-15); next order is (1 - omega).
    omega = 0.999
    kappa, _ = slowest_mode(omega, g ** np.arange(32.0))
    assert kappa == pytest.approx(math.sqrt(3 * (1 - omega) * (1 - omega * g)), rel=3e-3)


@pytest.mark.parametrize("omega", [0.0, 0.3, 0.9, 1.0])
@pytest.mark.parametrize("g", [0.0, 0.9])
def test_shapes_are_densities_for_every_medium(omega: float, g: float) -> None:
    kappa, shape = slowest_mode(omega, g ** np.arange(32.0))
    assert 0.02 <= kappa <= 0.98
    assert shape.min() > 0
    assert 2 * np.pi * np.trapezoid(shape, np.linspace(-1, 1, SHAPE_NODES)) == pytest.approx(1)
    # Light comes from where the source is.
    assert shape[-1] >= shape[0]
