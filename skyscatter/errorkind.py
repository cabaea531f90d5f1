"""What sort of error stands beside a radiance: names that answers, images and files share."""

from __future__ import annotations

from typing import Literal

#: A standard error: of Monte Carlo, from the spread of independent batches; two runs in three lie within it.
#: An estimated error: of a solution on a grid, from its difference to a coarser one; no probability belongs to it.
#: None: the solver is deterministic and states no error; it keeps its tolerance.
ErrorKind = Literal["standard", "estimated", "none"]

_KINDS: dict[str, ErrorKind] = {"orders": "estimated", "single": "none"}


def kind_of(solver: object) -> ErrorKind:
    """Sort of error that a solver states, by its name; that of any other is a standard error."""
    return _KINDS.get(solver, "standard") if isinstance(solver, str) else "standard"
