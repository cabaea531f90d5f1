"""Numbers and names out of a page's questions; what is wrong is refused as the command line refuses it."""

from __future__ import annotations

import math
from typing import Any

from skyscatter.errors import DomainError
from skyscatter.window.work import Message


def number(question: Message, name: str, low: float, high: float, default: float | None = None) -> float:
    """A finite number between two bounds."""
    value: Any = question.get(name, default)
    good = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not good or not math.isfinite(value) or not low <= value <= high:
        raise DomainError(name, value, f"give a number from {low:g} to {high:g}")
    return float(value)


def optional(question: Message, name: str, low: float, high: float) -> float | None:
    """The same where it may be left out."""
    return None if question.get(name) is None else number(question, name, low, high)


def whole(question: Message, name: str, low: int, high: int) -> int:
    """A whole number between two bounds."""
    value = number(question, name, low, high)
    if value != int(value):
        raise DomainError(name, value, f"give a whole number from {low} to {high}")
    return int(value)


def one_of(question: Message, name: str, allowed: tuple[str, ...]) -> str:
    """One of some words."""
    value = question.get(name)
    if not isinstance(value, str) or value not in allowed:
        raise DomainError(name, value, f"choose one of {', '.join(allowed)}")
    return value
