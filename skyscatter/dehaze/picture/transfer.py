"""Transfer curves of pictures: from the numbers that are displayed to numbers proportional to light, and back."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError
from skyscatter.image.tone import decode as decode_srgb

Transfer = Literal["linear", "srgb"] | float
"""``"linear"``: values are proportional to light; ``"srgb"``: the curve of IEC 61966-2-1; a number: a plain power."""

TABLE_SIZE = 4097
"""Nodes of the tables; straight lines between them err by less than 1e-6 (decoding) and 1e-5 (encoding)."""


def check_transfer(transfer: Transfer) -> Transfer:
    """The curve, if it is one.

    Raises
    ------
    DomainError
        If it is neither a known name nor a power from 0.4 to 4.
    """
    if transfer in ("linear", "srgb"):
        return transfer
    if isinstance(transfer, (int, float)) and 0.4 <= transfer <= 4.0:
        return float(transfer)
    raise DomainError("transfer", transfer, "'linear', 'srgb' or a power from 0.4 to 4")


def decode(values: NDArray[np.float64], transfer: Transfer) -> NDArray[np.float64]:
    """Displayed values, 0 to 1, to values proportional to light."""
    values = np.asarray(values, dtype=np.float64)
    if transfer == "linear":
        return values
    if transfer == "srgb":
        return decode_srgb(values)
    return np.maximum(values, 0.0) ** float(transfer)


def encode(values: NDArray[np.float64], transfer: Transfer) -> NDArray[np.float64]:
    """The inverse of `decode`; values below zero stay as they are, so that they are still seen to be below zero."""
    values = np.asarray(values, dtype=np.float64)
    if transfer == "linear":
        return values
    positive = np.maximum(values, 0.0)
    if transfer == "srgb":
        curve = np.where(positive <= 0.0031308, 12.92 * positive, 1.055 * positive ** (1.0 / 2.4) - 0.055)
    else:
        curve = positive ** (1.0 / float(transfer))
    return np.where(values < 0.0, values, curve)


def encode_slope(values: NDArray[np.float64], transfer: Transfer) -> NDArray[np.float64]:
    """Derivative of `encode`; below 0.001 it is that at 0.001, for the slope of a plain power has no bound at zero."""
    if transfer == "linear":
        return np.ones_like(np.asarray(values, dtype=np.float64))
    x = np.maximum(np.asarray(values, dtype=np.float64), 1e-3)
    return (encode(x * 1.001, transfer) - encode(x * 0.999, transfer)) / (0.002 * x)


def tables(transfer: Transfer) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Decoding over the value, and encoding over the square root of the light, both 0 to 1.

    Over the square root the curves in use are nearly straight, and the steep slope at black is resolved.
    """
    nodes = np.linspace(0.0, 1.0, TABLE_SIZE)
    return decode(nodes, transfer).astype(np.float32), encode(nodes**2, transfer).astype(np.float32)
