"""What may be asked of a solver: a record of options for each, with what every field means kept as data beside it.

From these data come the checks, the docstrings of the records and the options of the commands with their help, so that
Python and the command line cannot disagree.  A new option is one field here, read where the solver has a use for it.
Nothing here is heavy: the command line loads it at its start.
"""

from __future__ import annotations

import inspect
import math
import textwrap
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import Any, ClassVar, Literal, TypeVar

from skyscatter.errors import DomainError

#: What solvers take where nothing is given.
USUAL_WALKS, USUAL_PASSES, USUAL_PHOTONS = 16, 16, 1 << 16
#: The same of tolerances: of orders, and in an eclipse; of path in the air and in three dimensions; of single.
ORDERS_TOLERANCE, ECLIPSE_TOLERANCE = 0.005, 0.02
AIR_TOLERANCE, SPACE_TOLERANCE, SINGLE_TOLERANCE = 5e-4, 5e-3, 5e-5
#: Largest whole number that may be given, that of 64 bits.
MOST = 2**63 - 1


@dataclass(frozen=True)
class About:
    """What a field of a record means, and which values it takes.

    Attributes
    ----------
    help : str
        One line, without a full stop.
    kind : {"whole", "share", "length", "name", "switch"}
        A whole number; a number without a unit, which may be typed in per cent; metres; one of `choices`; true or
        false.
    usual : str
        What is taken when nothing is given, in words.
    low, high : float
        The range of numbers, ends included but for those that are `open`.
    noun : str
        What a share is one of.
    example : str
        A value, where the range alone does not say how to write one.
    choices : tuple of str
    seldom : bool
        Whether it means something in few scenes only, so that commands do not advise it.
    """

    help: str
    kind: Literal["whole", "share", "length", "name", "switch"]
    usual: str
    low: float = 0
    high: float = math.inf
    open: bool = False
    noun: str = ""
    example: str = ""
    choices: tuple[str, ...] = ()
    seldom: bool = False

    @property
    def rule(self) -> str:
        """The values that it takes, in words."""
        if self.kind == "whole":
            ends = f", at least {self.low:g}" if self.high == math.inf else f" from {self.low:g} to 2^63 - 1"
            return f"a whole number{ends}"
        if self.kind == "share":
            such = f", such as {self.example}" if self.example else ""
            return f"{self.noun} between {_short(self.low)} and {_short(self.high)}{such}"
        if self.kind == "name":
            return f"choose from {', '.join(self.choices)}"
        return "a positive length [m]" if self.kind == "length" else "True or False"

    @property
    def range(self) -> str:
        """A sentence with the values that it takes, and what is taken when nothing is given."""
        return f"{self.rule[0].upper()}{self.rule[1:]}; else {self.usual}."

    @property
    def type(self) -> str:
        """Type of the field, as docstrings have it."""
        if self.kind == "name":
            return "{" + ", ".join(f'"{choice}"' for choice in self.choices) + "}"
        return {"whole": "int", "switch": "bool"}.get(self.kind, "float")

    def check(self, name: str, value: Any) -> None:
        """Refuse a value that is out of range, or none at all."""
        if not self._holds(value):
            raise DomainError(name, value, self.rule)

    def _holds(self, value: Any) -> bool:
        if self.kind == "name":
            return isinstance(value, str) and value in self.choices
        if self.kind == "switch" or isinstance(value, bool):
            return self.kind == "switch" and isinstance(value, bool)
        if not isinstance(value, Integral if self.kind == "whole" else Real):
            return False
        number: Any = value  # of numpy, too
        if self.kind == "whole" and number > MOST:
            return False
        return bool(self.low < number < self.high if self.open else self.low <= number <= self.high)


def _short(number: float) -> str:
    """A number as people write it: 1e-9."""
    return f"{number:g}".replace("e-0", "e-")


def _about(default: Any = None, **about: Any) -> Any:
    """A field of a record."""
    return field(default=default, metadata={"about": About(**about)})


def _samples(noun: str, usual: int) -> Any:
    return _about(kind="whole", low=2, help=noun, usual=str(usual))  # one walk has no standard error


def _noise() -> Any:
    help = "Go on until every ray's relative standard error, averaged over wavelengths, is below this"
    rule = {"noun": "a relative standard error", "example": "0.01"}
    return _about(kind="share", high=1, open=True, help=help, usual="the number of samples decides", **rule)


def _seed(help: str = "Same seed, same numbers, whatever the threads", **more: Any) -> Any:
    return _about(0, kind="whole", high=MOST, help=help, usual="0", **more)


def _max_order() -> Any:
    help = "Leave out light that was scattered or reflected more often than this"
    return _about(kind="whole", low=1, help=help, usual="all orders")


def _tolerance(low: float, help: str, usual: str) -> Any:
    return _about(kind="share", low=low, high=0.1, noun="a relative tolerance", help=help, usual=usual)


R = TypeVar("R", bound="SolverOptions")


def _documented(record: type[R]) -> type[R]:
    """The record with its fields in its docstring."""
    lines = ["Parameters", "----------"]
    for name, about in record.about().items():
        said = f"{about.help}.  {about.range}"
        lines += [f"{name} : {about.type}, optional", textwrap.indent(textwrap.fill(said, 112), "    ")]
    lines += ["", "Raises", "------", "DomainError", "    For values out of these ranges.", "", "Examples"]
    before, _, examples = inspect.cleandoc(record.__doc__ or "").partition("Examples\n")
    record.__doc__ = before + "\n".join(lines) + "\n" + examples
    return record


@dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """What all records have; their fields are None where nothing was given."""

    name: ClassVar[str] = ""  #: of the solver

    def __post_init__(self) -> None:
        given = self.given
        for name, about in self.about().items():
            if name in given or name == "seed":
                about.check(name, getattr(self, name))
        if {"samples", "noise"} <= set(given):
            raise DomainError("samples", given["samples"], "give samples or noise, not both")

    @classmethod
    def about(cls) -> dict[str, About]:
        """What each field means."""
        return {one.name: one.metadata["about"] for one in fields(cls)}

    @property
    def given(self) -> dict[str, Any]:
        """The fields that are not None, by their names; numbers of numpy as plain ones, which files can hold."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        plain = {name: value.item() if hasattr(value, "item") else value for name, value in values.items()}
        return {name: value for name, value in plain.items() if value is not None}

    @property
    def recorded(self) -> dict[str, Any]:
        """As recipes hold them: the seed even of solvers without chance."""
        return {"seed": 0, **self.given}


@_documented
@dataclass(frozen=True, kw_only=True)
class Orders(SolverOptions):
    """Options of the solver ``orders``: all orders of scattering by a deterministic solution, in skies of planets.

    Examples
    --------
    >>> import skyscatter
    >>> scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=40)
    >>> here, up = scene.observer.position, [0, 0, 1]
    >>> quick = skyscatter.radiance(scene, here, up, [550], solver=skyscatter.Orders(tolerance=0.02, max_order=2))
    >>> bool(quick.radiance[0] < skyscatter.radiance(scene, here, up, [550], solver="orders").radiance[0])
    True
    """

    name: ClassVar[str] = "orders"

    tolerance: float | None = _tolerance(
        1e-4, "Relative accuracy to aim at", f"{ORDERS_TOLERANCE:g}, in an eclipse of the Sun {ECLIPSE_TOLERANCE:g}"
    )
    max_order: int | None = _max_order()
    seed: int = _seed(
        "Same seed, same numbers: of the walks in an eclipse of the Sun, the one case of chance", seldom=True
    )


@_documented
@dataclass(frozen=True, kw_only=True)
class Path(SolverOptions):
    """Options of the solver ``path``: all orders of scattering by Monte Carlo, in scenes of every kind.

    With `noise` the number of walks doubles until every ray has it, without the direct Sun.  As for `sampling`, walks
    march: they are forced to where the light is.  Free flights, through inverted columns, and delta tracking are slow
    and plain, and kept for tests.

    Examples
    --------
    >>> import skyscatter
    >>> skyscatter.Path(samples=64, seed=1)
    Path(samples=64, noise=None, seed=1, max_order=None, tolerance=None, sampling=None, transmittance=None)
    >>> skyscatter.Path(noise=2)
    Traceback (most recent call last):
    skyscatter.errors.DomainError: noise = 2: a relative standard error between 0 and 1, such as 0.01
    """

    name: ClassVar[str] = "path"

    samples: int | None = _samples(
        "Walks per ray or pixel, rounded up to a multiple of 16 if more than 16", USUAL_WALKS
    )
    noise: float | None = _noise()
    seed: int = _seed()
    max_order: int | None = _max_order()
    tolerance: float | None = _tolerance(
        1e-9,
        "Most that quadrature rules may disagree on a piece of a ray (first order, air and nebulae)",
        f"{_short(AIR_TOLERANCE)} in air and {_short(SPACE_TOLERANCE)} in nebulae",
    )
    sampling: str | None = _about(
        kind="name", choices=("march", "free-flight", "delta", "area", "angular"),
        help="How walks find vertices in air and nebulae (delta: in nebulae alone), or lamps among surfaces, by "
        "area or angular alone; march among bodies under a sky leaves out what is known of it",
        usual="march, among surfaces both ways, under a sky with what orders knows of it",
    )  # fmt: skip
    transmittance: str | None = _about(
        kind="name", choices=("auto", "quadrature", "ratio", "residual-ratio"),
        help="How walks in nebulae find the transmittance towards lights: from columns, or by a way of tracking",
        usual="auto, that of them which should cost least at equal error",
    )  # fmt: skip


@_documented
@dataclass(frozen=True, kw_only=True)
class Single(SolverOptions):
    """Options of the solver ``single``: light scattered once, by quadrature, in skies of planets and in nebulae.

    Examples
    --------
    >>> import skyscatter
    >>> skyscatter.Single(tolerance=1e-6)
    Single(tolerance=1e-06)
    """

    name: ClassVar[str] = "single"

    tolerance: float | None = _tolerance(
        1e-9,
        "Most that quadrature rules may disagree on a piece of a ray, relative to its radiance; the error is as a rule "
        "a tenth of it",
        _short(SINGLE_TOLERANCE),
    )


@_documented
@dataclass(frozen=True, kw_only=True)
class Photons(SolverOptions):
    """Options of the solver ``photons``: light followed from lamps, gathered along rays, among surfaces and in nebulae.

    Spheres in which it is gathered are no larger than half a mean free path, and smaller beside surfaces.  A radius
    that falls from pass to pass lets the bias go with the noise.

    Examples
    --------
    >>> import skyscatter
    >>> skyscatter.Photons(samples=64, photons=10_000).given
    {'samples': 64, 'seed': 0, 'photons': 10000}
    """

    name: ClassVar[str] = "photons"

    samples: int | None = _samples("Passes", USUAL_PASSES)
    noise: float | None = _noise()
    seed: int = _seed()
    max_order: int | None = _max_order()
    photons: int | None = _about(kind="whole", low=1, help="Photons in every pass", usual=str(USUAL_PHOTONS))
    radius: float | None = _about(
        kind="length", open=True, help="Radius of the spheres and disks in which light is gathered, in all passes",
        usual="one that follows from the scene and falls from pass to pass",
    )  # fmt: skip
    estimator: str | None = _about(
        kind="name", choices=("both", "points", "paths"),
        help="Which photons count there: points, those that are scattered or absorbed; paths, those that pass by",
        usual="both, weighted",
    )  # fmt: skip
    direct: bool | None = _about(
        kind="switch",
        help="Find light that comes straight from lamps by rays to them, and leave it out of what is gathered",
        usual="True",
    )


#: Any of the records.
Solver = Orders | Path | Single | Photons
#: By the names of the solvers.
RECORDS: dict[str, type[Solver]] = {"orders": Orders, "path": Path, "single": Single, "photons": Photons}


def record_of(solver: str | Solver, /, **given: Any) -> Solver:
    """The record of a solver: as it is, or, by the solver's name, one with the options that are given.

    Raises
    ------
    DomainError
        For other names, and for options out of their ranges.

    Examples
    --------
    >>> from skyscatter.solvers.options import record_of
    >>> record_of("single")
    Single(tolerance=None)
    """
    if isinstance(solver, SolverOptions) and not given:
        return solver
    if not isinstance(solver, str) or solver not in RECORDS:
        rule = f"choose from {', '.join(RECORDS)}, or give options by {', '.join(r.__name__ for r in RECORDS.values())}"
        raise DomainError("solver", solver, rule)
    return RECORDS[solver](**given)
