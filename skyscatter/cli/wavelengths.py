"""Wavelengths [nm] at which models are described and checked."""

from __future__ import annotations

import numpy as np

SHOWN_WAVELENGTHS = np.array([450.0, 550.0, 650.0])
#: The light that eyes see, which is what pictures are made of by default; beyond, tables may end and Mie theory costs.
CHECKED_WAVELENGTHS = np.linspace(380.0, 780.0, 9)
