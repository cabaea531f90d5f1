"""Options in one bag, as tables of test cases hold them, into keywords of `skyscatter.radiance` and its like."""

from __future__ import annotations

from typing import Any

from skyscatter.solvers.options import RECORDS, Solver, record_of


def asked(solver: str | Solver = "orders", **bag: Any) -> dict[str, Any]:
    """Keywords with the solver's record in the place of those options of the bag that are its own.

    What is left goes on as it is: an option that the solver does not know is a keyword that nobody knows.
    """
    own = {name: bag.pop(name) for name in [*bag] if solver in RECORDS and name in RECORDS[str(solver)].about()}
    return {"solver": record_of(solver, **own) if own else solver, **bag}
