"""Results that print what they are: numbers as numbers, arrays by their shape and range."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np


class Brief:
    """Base of dataclasses with ``repr=False``: one line for every field."""

    def __repr__(self) -> str:
        rows = [(f.name, _shown(getattr(self, f.name))) for f in fields(self) if f.repr]  # type: ignore[arg-type]
        width = max((len(name) for name, _ in rows), default=0)
        return "\n".join([type(self).__name__, *(f"  {name.ljust(width)}  {text}" for name, text in rows)])


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.ndim > 0:
        if value.size == 0 or value.dtype.kind not in "fiub":
            return f"array of shape {value.shape}"
        with np.errstate(all="ignore"):
            finite = value[np.isfinite(value)]
        span = f", {finite.min():.4g} to {finite.max():.4g}" if finite.size else ", nothing finite"
        return f"array of shape {value.shape}{span}"
    if isinstance(value, (float, np.floating)):
        return f"{value:.6g}"
    text = repr(value)
    return text if len(text) < 100 and "\n" not in text else f"{type(value).__name__} ..."
