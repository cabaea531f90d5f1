"""Kinds of one's own: classes that join those that come along, in model files and in Python.

A class derived from one of the contracts (`PhaseFunction`, `OpticalModel`, `DensityField`, `SpatialField`) may stand
wherever a kind that comes along may.  That model files can name it too, it is registered; packages do so by an entry
point in the group ``skyscatter.kinds``, whose module is imported before the first model file is read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import Any, TypeVar

from pydantic import SerializeAsAny, ValidationError, WrapValidator
from pydantic_core import PydanticCustomError

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.record import Record

#: Entry points of packages that bring kinds.
GROUP = "skyscatter.kinds"
#: Classes that users have registered: by contract, then by kind.
OWN: dict[type[Record], dict[str, type[Record]]] = {}

_Kind = TypeVar("_Kind", bound=type[Record])


def contract(record: _Kind) -> _Kind:
    """Let classes of users' own fulfil what this one says; a decorator."""
    OWN[record] = {}
    return record


def open_to(base: type[Record]) -> tuple[WrapValidator, Any]:
    """Annotations by which a union of kinds takes what else fulfils their contract, and writes it as what it is."""
    own = OWN[base]

    def accept(value: Any, handler: Callable[[Any], Any]) -> Any:
        if isinstance(value, base):
            return value
        record = own.get(str(value.get("kind"))) if isinstance(value, Mapping) else None
        if record is None or _holder(base, str(value["kind"]), record) is not None:  # what comes along goes first
            return handler(value)
        try:
            return record.model_validate(value)
        except ValidationError as error:  # whose lines would be one long text
            raise PydanticCustomError("own_kind", "{lines}", {"lines": _lines(error)}) from None

    return WrapValidator(accept), SerializeAsAny()


def _kind(record: type[Record]) -> Any:
    """The kind that a class has by default."""
    fields = record.__pydantic_fields__
    return fields["kind"].default if "kind" in fields else None


def _holder(base: type[Record], kind: str, record: type[Record]) -> type[Record] | None:
    """Who has that kind already: a class that comes along, or another one that is registered."""
    waiting = list(base.__subclasses__())
    while waiting:
        one = waiting.pop()
        waiting += one.__subclasses__()
        if one.__module__.startswith("skyscatter.") and _kind(one) == kind:
            return one
    own = OWN[base].get(kind)
    # The same one is no other where its module has been loaded anew.
    return None if own is None or own.__qualname__ == record.__qualname__ else own


def _lines(error: ValidationError) -> str:
    """What is wrong in a record, on one line."""
    problems = error.errors(include_url=False)
    return "; ".join(f"{'.'.join(map(str, p['loc']))} = {p['input']!r}: {p['msg']}" for p in problems)


def register(record: _Kind) -> _Kind:
    """Let model files name a class of one's own by its `kind`; also a decorator.

    Parameters
    ----------
    record : class
        Derived from `PhaseFunction`, `OpticalModel`, `DensityField` or `SpatialField`, with a field
        ``kind: Literal["..."] = "..."``.

    Returns
    -------
    class
        The same.

    Raises
    ------
    DomainError
        If it fulfils no such contract, has no kind, or its kind is taken by another class.

    Examples
    --------
    >>> from typing import Literal
    >>> import skyscatter
    >>> from skyscatter.optics.phase import HenyeyGreenstein
    >>> @skyscatter.register
    ... class Pollen(HenyeyGreenstein):
    ...     kind: Literal["pollen"] = "pollen"
    ...     g: float = 0.8
    >>> optics = {"optical_depth": 0.1, "single_scattering_albedo": 0.9, "phase": {"kind": "pollen"}}
    >>> skyscatter.Particles(**optics).phase.g
    0.8
    """
    kind = _kind(record)
    if not isinstance(kind, str):
        raise DomainError("kind", kind, f'{record.__name__} needs a field kind: Literal["NAME"] = "NAME"')
    contracts = [base for base in OWN if issubclass(record, base)]
    if not contracts:
        known = ", ".join(sorted(base.__name__ for base in OWN))
        raise DomainError("register", record.__name__, f"derive it from one of {known}")
    for base in contracts:
        taken = _holder(base, kind, record)
        if taken is not None:
            raise DomainError("kind", kind, f"is that of {taken.__name__}; choose another name")
        OWN[base][kind] = record
    return record


@cache
def load_packages() -> None:
    """Import what packages that bring kinds have registered, once.

    Raises
    ------
    SkyscatterError
        That names the package which cannot be imported.
    """
    for point in entry_points(group=GROUP):
        try:
            point.load()
        except Exception as error:  # whatever a stranger's module raises
            name = point.dist.name if point.dist else point.name
            remedy = "mend or remove the package"
            raise SkyscatterError(f"{name}: its kinds ({point.value}) cannot be loaded: {error}; {remedy}") from error
