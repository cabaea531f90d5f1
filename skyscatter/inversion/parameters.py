"""Free parameters: dotted names, what they mean in a model, and what is known of them beforehand.

A name is one of

- ``COMPONENT.QUANTITY`` with a quantity of `quantities.QUANTITIES`, such as ``haze.optical_depth`` (vertical, at
  550 nm), ``haze.asymmetry``, ``haze.single_scattering_albedo``, ``ozone.column_du``, ``dust.extinction``
  (A_V through the middle); ``haze.optical_depth@440`` means it at another wavelength [nm];
- a path to a number of the model file, such as ``haze.density.scale_height``, ``stars.A.position.x``,
  ``view.inclination_deg``; for a component the words ``density``, ``optics`` and ``phase`` may be left out where the
  last one is clear (``haze.scale_height``, ``haze.angstrom_exponent``), and ``star.luminosity`` is that of the only
  star;
- ``ground.albedo`` (of a table or a named surface: at 550 nm, the table keeping its shape), or ``ground.grey_albedo``,
  one number at all wavelengths in the place of whatever ground the model has;
- ``sun.elevation_deg``, ``sun.azimuth_deg``;
- a nuisance parameter of the data, such as ``calibration``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from skyscatter.datafiles import read_table
from skyscatter.errors import DomainError, UnitsError
from skyscatter.inversion import paths
from skyscatter.inversion.distributions import KINDS, Distribution, LogUniform, Normal, Uniform
from skyscatter.inversion.quantities import QUANTITIES, REFERENCE, Quantity, placed
from skyscatter.media.medium import Component
from skyscatter.record import nearest
from skyscatter.spectra.surfaces import surface_albedo
from skyscatter.spectra.table import SpectralTable, evaluate
from skyscatter.units import metres

INF = float("inf")
SUN = ("elevation_deg", "azimuth_deg", "distance_au")

#: Last word of a name -> values that have a meaning, and the prior when none is given (None: a factor of ten either
#: way of the model's own number).
_KNOWN: dict[str, tuple[tuple[float, float], Distribution | None]] = {
    "optical_depth": ((0, INF), Uniform(0.0, 5.0)),
    "extinction": ((0, INF), Uniform(0.0, 50.0)),
    "visual_extinction": ((0, INF), Uniform(0.0, 50.0)),
    "column_du": ((0, INF), None),
    "angstrom_exponent": ((-INF, INF), Uniform(-1.0, 4.0)),  # rain to Rayleigh
    "asymmetry": ((-1, 1), Uniform(-0.3, 0.97)),
    "g": ((-1, 1), Uniform(-0.3, 0.97)),
    "single_scattering_albedo": ((0, 1), Uniform(0.0, 1.0)),
    "albedo": ((0, 1), Uniform(0.0, 1.0)),
    "grey_albedo": ((0, 1), Uniform(0.0, 1.0)),
    "effective_radius": ((0, INF), LogUniform(1e-8, 2e-5)),
    **dict.fromkeys(("temperature", "luminosity", "radius", "scale_height", "weight", "distance"), ((0.0, INF), None)),
    "elevation_deg": ((-90, 90), Uniform(-90.0, 90.0)),
    "azimuth_deg": ((-360, 720), Uniform(0.0, 360.0)),
    "inclination_deg": ((-360, 360), Uniform(0.0, 180.0)),
    "position_angle_deg": ((-360, 360), Uniform(0.0, 360.0)),
}  # fmt: skip
_UNITS = {
    "column_du": "DU", "effective_radius": "m", "scale_height": "m", "radius": "m", "width": "m", "top": "m",
    "peak": "m", "base": "m", "height": "m", "temperature": "K", "luminosity": "Lsun", "extinction": "mag",
    "visual_extinction": "mag",
    "x": "m", "y": "m", "z": "m", "distance": "m", "inner": "m", "outer": "m", "length": "m", "thickness": "m",
}  # fmt: skip


@dataclass(frozen=True)
class Subject:
    """What parameters are written into: a model, changes of the Sun's place, and nuisance parameters of the data.

    Attributes
    ----------
    model : Model or NebulaModel
    sun : mapping
        Fields of `skyscatter.Sun` that hold for all data, whatever these say.
    nuisance : mapping
    """

    model: Any
    sun: Mapping[str, float] = field(default_factory=dict)
    nuisance: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Parameter:
    """One free number: its name, its prior, and how it is read from and written into a subject."""

    name: str
    prior: Distribution
    get: Callable[[Subject], float] = field(repr=False)
    put: Callable[[Subject, float], Subject] = field(repr=False)
    amount: bool = False
    unit: str = ""
    nuisance: bool = False


def apply(parameters: Sequence[Parameter], subject: Subject, values: Sequence[float]) -> Subject:
    """The subject with all parameters at their values; amounts last, for their meaning hangs on the rest."""
    pairs = list(zip(parameters, values, strict=True))
    for parameter, value in sorted(pairs, key=lambda pair: pair[0].amount):
        subject = parameter.put(subject, float(value))
    return subject


def with_values(model: Any, values: Mapping[str, float]) -> Any:
    """A model with other numbers, by the names of free parameters.

    Parameters
    ----------
    model : Model or NebulaModel
    values : mapping
        Name -> number, such as ``{"haze.optical_depth": 0.3, "ground.albedo": 0.2}``.

    Returns
    -------
    Model or NebulaModel
        A copy; the model that was given stays as it is.

    Raises
    ------
    DomainError
        For a name that the model does not have, or a number that it cannot have.

    Examples
    --------
    >>> import skyscatter
    >>> from skyscatter import inversion
    >>> model = skyscatter.load_model("earth-hazy")
    >>> clearer = inversion.with_values(model, {"haze.optical_depth": 0.2, "ground.grey_albedo": 0.3})
    >>> [round(float(m.components[2].optics.optical_depth), 2) for m in (model, clearer)]
    [0.45, 0.2]
    >>> clearer.ground.albedo
    0.3
    """
    subject = Subject(model)
    found = [resolve(name, None, subject, usual_needed=False) for name in values]
    return apply(found, subject, [float(v) for v in values.values()]).model


def resolve(
    name: str,
    prior: Any,
    subject: Subject,
    nuisances: Mapping[str, tuple[float, Distribution]] | None = None,
    usual_needed: bool = True,
) -> Parameter:
    """The parameter of a name.

    Parameters
    ----------
    name : str
        See the module.
    prior : Distribution or (low, high) or None
        Two numbers are the bounds of a uniform prior; None is the usual prior of that name.
    subject : Subject
        Model and Sun from which the name is read.
    nuisances : mapping, optional
        Name -> (neutral value, usual prior) of the nuisance parameters that the data have.
    usual_needed : bool
        Refuse names that have no usual prior, where none is given.

    Raises
    ------
    DomainError
        If there is no such number; the message has the names that are nearest.
    """
    base, at, wavelength = name.partition("@")
    words = tuple(base.split("."))
    try:
        reference = float(wavelength) if at else REFERENCE
    except ValueError:
        raise DomainError(
            "free", name, "after @ comes a wavelength in nm, for instance haze.optical_depth@440"
        ) from None
    if base in (nuisances or {}) and not at:
        neutral, usual = (nuisances or {})[base]
        return _nuisance(base, neutral, usual if prior is None else as_prior(prior, name, usual.support))
    get, put, amount, spectral = _access(name, words, reference, subject, nuisances or {})
    if at and not spectral:
        raise DomainError("free", name, f"{base} does not depend on wavelength; leave out @{wavelength}")
    value = get(subject)
    put(subject, value)  # refuses what can be read but not be set
    limits, common = _usual(words[-1], value)
    if prior is None and common is None and not usual_needed:
        common = Normal(value, 1.0)  # never used
    if prior is None and common is None:
        raise DomainError("free", name, f"there is no usual prior; give bounds: {name}=LOW:HIGH")
    chosen = as_prior(common if prior is None else prior, name, limits)
    return Parameter(name, chosen, get, put, amount, _UNITS.get(words[-1], "deg" if words[-1].endswith("_deg") else ""))


def _usual(word: str, value: float) -> tuple[tuple[float, float], Distribution | None]:
    limits, prior = _KNOWN.get(word, ((-INF, INF), None))
    if prior is None and value > 0:
        prior = LogUniform(value / 10, value * 10)
    return limits, prior


def _nuisance(name: str, neutral: float, prior: Distribution) -> Parameter:
    def get(subject: Subject) -> float:
        return subject.nuisance.get(name, neutral)

    def put(subject: Subject, value: float) -> Subject:
        return replace(subject, nuisance={**subject.nuisance, name: value})

    return Parameter(name, prior, get, put, nuisance=True)


Access = tuple[Callable[[Subject], float], Callable[[Subject, float], Subject], bool, bool]


def _access(
    name: str, words: tuple[str, ...], reference: float, subject: Subject, nuisances: Mapping[str, Any]
) -> Access:
    """How to read and write a name; whether it is an amount; whether it is meant at a wavelength."""
    model = subject.model
    if words[0] == "sun" and len(words) == 2 and hasattr(model, "planet"):
        return _sun_access(name, words[1], subject)
    if words == ("ground", "albedo") and hasattr(model, "ground"):
        return _ground_access(reference)
    if words == ("ground", "grey_albedo") and hasattr(model, "ground"):
        return _grey_access(reference)
    fields = type(model).model_fields
    if words[0] in fields and len(words) > 1:
        if words[0] == "components" and len(words) == 3 and words[2] in QUANTITIES:
            return _quantity_access(name, words[1], QUANTITIES[words[2]], reference)
        return _path_access(name, words)
    names = [component.name for component in model.components]
    if words[0] in names and len(words) > 1:
        if len(words) == 2 and words[1] in QUANTITIES:
            return _quantity_access(name, words[0], QUANTITIES[words[1]], reference)
        component = model.components[names.index(words[0])]
        return _path_access(name, ("components", words[0], *_full_path(component, words[1:], name)))
    stars = getattr(model, "stars", ())
    if words[0] in [star.name for star in stars]:
        return _path_access(name, ("stars", *words))
    if words[0] == "star" and len(stars) == 1:
        return _path_access(name, ("stars", "0", *words[1:]))
    if words[0] in names:
        raise DomainError("free", name, f"name a number of it, such as {words[0]}.optical_depth or {words[0]}.weight")
    known = [
        *names,
        *(star.name for star in stars),
        *(f for f in fields if f not in ("name", "description", "sources")),
    ]
    known += ["sun"] * hasattr(model, "planet") + list(nuisances)
    raise DomainError("free", name, f"{words[0]!r} is unknown here; {nearest(words[0], known)}")


def _full_path(component: Component, words: tuple[str, ...], name: str) -> tuple[str, ...]:
    """The path below a component with ``optics``, ``density`` or ``phase`` put in where they were left out."""
    if words[0] in type(component).model_fields:
        return words
    places = [("optics",), ("density",), ("optics", "phase"), ("density", "field")]
    found, known = [], list(QUANTITIES)
    for place in places:
        node: Any = component
        for step in place:
            node = getattr(node, step, None)
        if node is not None and words[0] in paths.offered(node):
            found.append(place)
        known += paths.offered(node)
    if not found:
        raise DomainError("free", name, f"{component.name} has no {words[0]!r}; {nearest(words[0], known)}")
    if len(found) > 1:
        choices = " or ".join(".".join((component.name, *place, *words)) for place in found)
        raise DomainError("free", name, f"could mean {choices}; say which")
    return (*found[0], *words)


def _path_access(name: str, words: tuple[str, ...]) -> Access:
    def get(subject: Subject) -> float:
        return paths.number(subject.model, words, name)

    def put(subject: Subject, value: float) -> Subject:
        return replace(subject, model=paths.replaced(subject.model, words, value, name))

    return get, put, False, False


def _quantity_access(name: str, component: str, quantity: Quantity, reference: float) -> Access:
    def get(subject: Subject) -> float:
        return quantity.get(paths.read(subject.model, ("components", component), name), reference)

    def put(subject: Subject, value: float) -> Subject:
        old = paths.read(subject.model, ("components", component), name)
        new = quantity.put(old, value, reference, name)
        return replace(subject, model=paths.replaced(subject.model, ("components", component), new, name))

    return get, put, quantity.amount, True


def _grey_access(reference: float) -> Access:
    get = _ground_access(reference)[0]

    def put(subject: Subject, value: float) -> Subject:
        return replace(subject, model=paths.replaced(subject.model, ("ground", "albedo"), value, "ground.grey_albedo"))

    return get, put, False, False


def _ground_access(reference: float) -> Access:
    def table(subject: Subject) -> float | SpectralTable:
        albedo = subject.model.ground.albedo
        if not isinstance(albedo, str):
            return albedo
        nodes = tuple(float(w) for w in read_table("surfaces.csv")["wavelength_nm"])
        return SpectralTable(wavelengths=nodes, values=tuple(surface_albedo(albedo, nodes).tolist()))

    def get(subject: Subject) -> float:
        return float(evaluate(table(subject), [reference])[0])

    def put(subject: Subject, value: float) -> Subject:
        moved = placed(table(subject), reference, value, 0.0, 1.0)
        return replace(subject, model=paths.replaced(subject.model, ("ground", "albedo"), moved, "ground.albedo"))

    return get, put, False, True


def _sun_access(name: str, word: str, subject: Subject) -> Access:
    if word not in SUN:
        raise DomainError("free", name, f"the Sun has no {word!r}; {nearest(word, SUN)}")
    if word not in subject.sun:
        raise DomainError("free", name, "the data have more than one Sun, or none of their own; it cannot be free")

    def get(other: Subject) -> float:
        return float(other.sun[word])

    def put(other: Subject, value: float) -> Subject:
        return replace(other, sun={**other.sun, word: value})

    return get, put, False, False


def as_prior(prior: Any, name: str, limits: tuple[float, float]) -> Distribution:
    """A prior from what was given for it, inside the values that have a meaning."""
    if isinstance(prior, Normal):
        if not limits[0] <= prior.mean <= limits[1]:
            rule = f"lies between {limits[0]:g} and {limits[1]:g}, and so must the middle of its prior"
            raise DomainError("prior", f"{name}={prior.mean:g}", rule)
        chosen: Distribution = replace(prior, low=max(prior.low, limits[0]), high=min(prior.high, limits[1]))
    elif isinstance(prior, Distribution):
        chosen = prior
    else:
        try:
            low, high = (float(v) for v in prior)
        except (TypeError, ValueError):
            raise DomainError(
                "free", f"{name}={prior!r}", "give (low, high), a prior such as Normal(...), or None"
            ) from None
        chosen = Uniform(low, high)
    low, high = chosen.support
    if low < limits[0] or high > limits[1]:
        shown = f"{name}={low:g}:{high:g}"
        raise DomainError("free", shown, f"lies between {limits[0]:g} and {limits[1]:g}; narrow the bounds")
    return chosen


_CALL = re.compile(r"([a-z]+)\(([^()]*)\)")


def parse_free(text: str) -> tuple[str, Any]:
    """``NAME``, ``NAME=LOW:HIGH``, ``NAME=MEAN~SIGMA`` or ``NAME=KIND(A, B)`` as a name and its prior.

    Numbers may have a unit of length: ``haze.scale_height=500m:3km``.
    """
    name, equals, rest = text.partition("=")
    name, rest = name.strip(), rest.strip()
    if not name or (equals and not rest):
        raise DomainError("free", text, "give NAME, NAME=LOW:HIGH or NAME=MEAN~SIGMA")
    if not equals:
        return name, None
    call = _CALL.fullmatch(rest)
    if call:
        if call[1] not in KINDS:
            raise DomainError("free", text, f"there is no prior {call[1]!r}; {nearest(call[1], KINDS)}")
        numbers = [_number(word, text) for word in call[2].split(",")]
        if len(numbers) != 2:
            raise DomainError("free", text, f"{call[1]} takes two numbers")
        return name, KINDS[call[1]](*numbers)
    for sign, kind in (("~", Normal), (":", Uniform)):
        if rest.count(sign) == 1:
            low, high = (_number(word, text) for word in rest.split(sign))
            return name, kind(low, high)
    raise DomainError("free", text, "after = come LOW:HIGH, MEAN~SIGMA, or a prior such as lognormal(0.1, 0.5)")


def _number(word: str, text: str) -> float:
    try:
        return metres(word.strip(), "free")
    except UnitsError:
        raise DomainError(
            "free", text, f"{word.strip()!r} is no number; lengths may have a unit, such as 2km"
        ) from None
