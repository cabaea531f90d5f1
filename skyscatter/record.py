"""The base of everything that a model file can say: frozen, checked when made, written back as it was read."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator

UNKNOWN = "no such field"


def nearest(name: str, known: Iterable[str]) -> str:
    """The remedy for a name that is not among those known: the most similar one, or all of them."""
    names = list(known)
    similar = difflib.get_close_matches(name.lower(), names, n=1)
    return f"did you mean {similar[0]}?" if similar else f"there are {', '.join(names)}"


class Record(BaseModel):
    """A frozen, validated value; unknown fields are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _known_names(cls, data: Any) -> Any:
        """Refuse unknown fields before all else: a misspelt one would otherwise be reported as missing."""
        for name, value in data.items() if isinstance(data, dict) else ():
            if name not in cls.model_fields:
                # A whole table as the value would not fit on a line and would say nothing.
                shown = f"{name} = {value!r}" if isinstance(value, (str, int, float)) else name
                raise ValueError(f"{shown}: {UNKNOWN}; {nearest(str(name), cls.model_fields)}")
        return data
