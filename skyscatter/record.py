"""The base of everything that a model file can say: frozen, checked when made, written back as it was read."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, Self, get_args

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import ErrorType

UNKNOWN = "no such field"
#: Type of the complaints about unknown fields.
UNKNOWN_FIELD = "unknown_field"
_SIMILAR = 0.7
#: Types of complaints that pydantic itself makes.
_OWN_TYPES = frozenset(get_args(ErrorType))


def similar(name: str, known: Iterable[str]) -> str | None:
    """That of the names which is most likely meant by another one: spelt nearly alike, or the same cut short."""
    names, low = list(known), name.lower()
    lowered = {one.lower(): one for one in names}
    close = difflib.get_close_matches(low, lowered, n=1, cutoff=_SIMILAR)
    close += [one for one in lowered if len(low) > 1 and one.startswith(low)]
    return lowered[close[0]] if close else None


def nearest(name: str, known: Iterable[str]) -> str:
    """The remedy for a name that is not among those known: the most similar one, or all of them."""
    names = list(known)
    meant = similar(name, names)
    return f"did you mean {meant}?" if meant else f"there are {', '.join(names)}"


class Record(BaseModel):
    """A frozen, validated value; unknown fields are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="wrap")
    @classmethod
    def _known_names(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Say of unknown fields which ones may be meant; a misspelt one is not reported as missing too."""
        try:
            return handler(data)
        except ValidationError as error:
            problems = error.errors(include_url=False)
            if not any(_unknown(problem) for problem in problems):
                raise
            remade = list(cls._explained(data, problems))
        raise ValidationError.from_exception_data(cls.__name__, remade) from None

    @classmethod
    def _explained(cls, data: Mapping[str, Any], problems: list[Any]) -> Iterable[InitErrorDetails]:
        free = [name for name in cls.model_fields if name not in data]
        needed = [p["loc"][0] for p in problems if p["type"] == "missing" and len(p["loc"]) == 1]
        meant = {}
        for name in (str(p["loc"][0]) for p in problems if _unknown(p)):
            # What is missing is meant, if only one field is: no other spelling comes near.
            only = needed[0] if len(needed) == 1 else None
            meant[name] = similar(name, free) or only or similar(name, cls.model_fields)
        for problem in problems:
            if _unknown(problem):
                name = str(problem["loc"][0])
                remedy = f"did you mean {meant[name]}?" if meant[name] else f"there are {', '.join(cls.model_fields)}"
                yield _remade(problem, PydanticCustomError(UNKNOWN_FIELD, f"{UNKNOWN}; {remedy}"))
            elif not (problem["type"] == "missing" and problem["loc"][0] in meant.values()):
                yield _remade(problem, problem["type"])


def _unknown(problem: Mapping[str, Any]) -> bool:
    return problem["type"] == "extra_forbidden" and len(problem["loc"]) == 1


def _remade(problem: Mapping[str, Any], sort: str | PydanticCustomError) -> InitErrorDetails:
    """A complaint for a new validation error."""
    if isinstance(sort, str) and sort not in _OWN_TYPES:
        sort = PydanticCustomError(UNKNOWN_FIELD, problem["msg"])
    return InitErrorDetails(type=sort, loc=problem["loc"], input=problem["input"], ctx=problem.get("ctx", {}))


__all__ = ["UNKNOWN", "UNKNOWN_FIELD", "Record", "nearest", "similar"]
