"""Errors that a user may meet; each names the field, the value and the remedy in one line."""

from __future__ import annotations

from typing import Any

#: Longest value that is shown whole; of longer ones both ends.
LONGEST, END = 200, 90


def shown(value: Any) -> str:
    """A value as a user wrote it: numbers of numpy as plain ones, inside of tuples and lists too; long ones cut."""
    return shortened(_written(value))


def shortened(text: str) -> str:
    """A text that fits on a line: of a long one both ends."""
    return text if len(text) <= LONGEST else f"{text[:END]} ... {text[-END:]}"


def _written(value: Any) -> str:
    if isinstance(value, (tuple, list)) and type(value) in (tuple, list):
        inner = ", ".join(_written(part) for part in value)
        if isinstance(value, list):
            return f"[{inner}]"
        return f"({inner},)" if len(value) == 1 else f"({inner})"
    return repr(value.tolist() if type(value).__module__ == "numpy" and hasattr(value, "tolist") else value)


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
        super().__init__(f"{name} = {shown(value)}: {allowed}")


class UnitsError(SkyscatterError, ValueError):
    """A quantity came in a unit that cannot be converted to the expected one."""

    def __init__(self, name: str, value: object, expected: str) -> None:
        self.name, self.value, self.expected = name, value, expected
        super().__init__(f"{name} = {shown(value)}: give {expected}")


class ModelFileError(SkyscatterError, ValueError):
    """A model file is missing, is not TOML, or says something that no model means.

    Parameters
    ----------
    path : object
        The file, or the name of the model.
    *problems : str
        What is wrong, a line each.
    """

    def __init__(self, path: object, *problems: str) -> None:
        self.path, self.problems = path, problems
        super().__init__("\n".join(f"{path}: {problem}" for problem in problems))


class TableFileError(SkyscatterError, ValueError):
    """A file of a table cannot be read, or does not hold what is asked of it; names the file, the line, the column."""

    def __init__(self, path: object, problem: str, line: int | None = None, column: str | None = None) -> None:
        self.path, self.problem, self.line, self.column = path, problem, line, column
        place = "" if line is None else f", line {line}"
        place += "" if column is None else f", column {column}"
        super().__init__(f"{path}{place}: {problem}")


class MissingDataError(SkyscatterError, FileNotFoundError):
    """A file that is needed is not there or cannot be read."""

    def __init__(self, path: object, remedy: str) -> None:
        self.path, self.remedy = path, remedy
        super().__init__(f"{path}: {remedy}")

    def __str__(self) -> str:
        return f"{self.path}: {self.remedy}"


class ConvergenceError(SkyscatterError, RuntimeError):
    """A numerical method stopped short of the accuracy that was asked for."""
