"""Errors that a user may meet; each names the field, the value and the remedy in one line."""

from __future__ import annotations


class SkyscatterError(Exception):
    """Base class of every error that skyscatter raises on purpose."""


class DomainError(SkyscatterError, ValueError):
    """A value lies outside the range in which the quantity means anything.

    Parameters
    ----------
    name : str
        The field as the user knows it.
    value : object
        What was given.
    allowed : str
        What would be accepted, in words.
    """

    def __init__(self, name: str, value: object, allowed: str) -> None:
        self.name, self.value, self.allowed = name, value, allowed
        super().__init__(f"{name} = {value!r}: {allowed}")


class UnitsError(SkyscatterError, ValueError):
    """A quantity came in a unit that cannot be converted to the expected one."""

    def __init__(self, name: str, value: object, expected: str) -> None:
        self.name, self.value, self.expected = name, value, expected
        super().__init__(f"{name} = {value!r}: give {expected}")


class ModelFileError(SkyscatterError, ValueError):
    """A model file is missing, is not TOML, or says something that no model means."""

    def __init__(self, path: object, problem: str) -> None:
        self.path, self.problem = path, problem
        super().__init__(f"{path}: {problem}")


class MissingDataError(SkyscatterError, FileNotFoundError):
    """A file that is needed is not there or cannot be read."""

    def __init__(self, path: object, remedy: str) -> None:
        self.path, self.remedy = path, remedy
        super().__init__(f"{path}: {remedy}")

    def __str__(self) -> str:
        return f"{self.path}: {self.remedy}"


class ConvergenceError(SkyscatterError, RuntimeError):
    """A numerical method stopped short of the accuracy that was asked for."""
