"""Numbers of a component that people of the field mean, whatever the way in which a model file states them.

Each is read from a component and written into a new one.  Where the model has a table over wavelength, the number is
that at the reference wavelength and the table keeps its shape: amounts are multiplied by one factor; numbers between
bounds (albedos, asymmetries) are moved by one distance in their logit, so that none of them leaves its bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from skyscatter.errors import DomainError
from skyscatter.inversion.paths import changed
from skyscatter.media.medium import Component
from skyscatter.optics.absorption import DOBSON_UNIT, GasAbsorption
from skyscatter.optics.dust import MAGNITUDE, Dust
from skyscatter.optics.mie import LogNormalMode, MieAerosol
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import CornetteShanks, Draine, HenyeyGreenstein
from skyscatter.spectra.table import SpectralTable, evaluate

REFERENCE = 550.0  #: wavelength at which numbers are meant unless a name says another [nm]

#: Fields that say how much of a component there is, in the order in which they are looked for.
_AMOUNTS = (
    "optical_depth", "extinction", "number_density", "column_du", "column_m2", "visual_extinction", "hydrogen_density",
    "dust_density", "coefficient",
)  # fmt: skip
#: Logits of albedos are kept within this: 1 - 1e-9.
_FARTHEST_LOGIT = 20.7


class Quantity(NamedTuple):
    """One number of a component at a wavelength [nm]."""

    get: Callable[[Component, float], float]
    put: Callable[[Component, float, float, str], Component]  #: component, value, wavelength, name for errors
    #: Amounts are written after everything that changes what one unit of them does.
    amount: bool = False


def vertical_depth(component: Component, wavelength: float) -> float:
    """Optical depth of extinction straight up (in space: through the middle along z) at a wavelength [nm]."""
    column = component.density.reference_column()
    c = component.optics.coefficients([wavelength], column)
    return float(component.weight * column * (c.scattering[0] + c.absorption[0]))


def with_depth(component: Component, value: float, wavelength: float, name: str) -> Component:
    """The component with that optical depth, its amount changed (or its weight, where it states no amount)."""
    field = next((f for f in _AMOUNTS if getattr(component.optics, f, None) is not None), None)
    if field is None:
        unit = changed(component, name, weight=1.0)
        return changed(component, name, weight=value / _positive(vertical_depth(unit, wavelength), component, name))
    amount = getattr(component.optics, field)
    if isinstance(amount, SpectralTable):
        factor = value / _positive(vertical_depth(component, wavelength), component, name)
        scaled = SpectralTable(wavelengths=amount.wavelengths, values=tuple(factor * v for v in amount.values))
        return changed(component, name, optics=changed(component.optics, name, **{field: scaled}))
    unit = changed(component, name, optics=changed(component.optics, name, **{field: 1.0}))
    depth = _positive(vertical_depth(unit, wavelength), component, name)
    return changed(component, name, optics=changed(component.optics, name, **{field: value / depth}))


def _positive(depth: float, component: Component, name: str) -> float:
    if not depth > 0:
        rule = f"{component.name} takes no light away at the reference wavelength; name another one: {name}@WAVELENGTH"
        raise DomainError("free", name, rule)
    return depth


def _visual(component: Component, wavelength: float) -> float:
    return MAGNITUDE * vertical_depth(component, wavelength)


def _with_visual(component: Component, value: float, wavelength: float, name: str) -> Component:
    return with_depth(component, value / MAGNITUDE, wavelength, name)


def _refuse(component: Component, name: str, remedy: str) -> DomainError:
    kind = getattr(component.optics, "kind", type(component.optics).__name__)
    return DomainError("free", name, f"the optics {kind} of {component.name} have no such number; {remedy}")


def as_particles(component: Component, name: str) -> tuple[Component, Particles]:
    """The component with its optics as tables, so that albedo and asymmetry can be changed.

    Dust is turned into particles with tables at the wavelengths of the dust's own.  Returns component and optics.
    """
    optics = component.optics
    if isinstance(optics, Particles):
        return component, optics
    if not isinstance(optics, Dust):
        remedy = "free refractive_index_imag, effective_radius or weight instead"
        raise _refuse(component, name, remedy)
    from skyscatter.datafiles import read_table

    nodes = tuple(float(w) for w in read_table("dust_draine2003.csv")["wavelength_nm"])
    column = component.density.reference_column()
    c = optics.coefficients(nodes, column)
    total = c.scattering + c.absorption

    def table(values: Any) -> SpectralTable:
        return SpectralTable(wavelengths=nodes, values=tuple(float(v) for v in values))

    numbers = Particles(
        extinction=table(total),
        single_scattering_albedo=table(c.scattering / total),
        phase=optics.phase_function(nodes),
    )
    return component, numbers


def shifted(value: Any, at: float, target: float, low: float, high: float) -> Any:
    """A number, or a table of numbers between bounds moved in its logit so that it is `target` at a wavelength."""
    if not isinstance(value, SpectralTable):
        return target

    def logit(x: Any) -> Any:
        share = (np.asarray(x, float) - low) / (high - low)
        with np.errstate(divide="ignore"):
            return np.clip(np.log(share) - np.log1p(-share), -_FARTHEST_LOGIT, _FARTHEST_LOGIT)

    moved = logit(value.values) + (logit(target) - logit(evaluate(value, [at])[0]))
    share = 1.0 / (1.0 + np.exp(-moved))
    return SpectralTable(wavelengths=value.wavelengths, values=tuple((low + (high - low) * share).tolist()))


def placed(value: Any, at: float, target: float, low: float, high: float) -> Any:
    """As `shifted`, and exactly: linear between the nodes of a table, its value there is not that of a shifted node."""
    if not isinstance(value, SpectralTable) or not low < target < high:
        return shifted(value, at, target, low, high)
    below, above = low, high
    for _ in range(50):  # the value rises with the aim; 50 halvings leave 1e-15
        aim = 0.5 * (below + above)
        moved = shifted(value, at, aim, low, high)
        below, above = (aim, above) if float(evaluate(moved, [at])[0]) < target else (below, aim)
    return moved


def _albedo(component: Component, wavelength: float) -> float:
    c = component.optics.coefficients([wavelength], component.density.reference_column())
    total = float(c.scattering[0] + c.absorption[0])
    return float(c.scattering[0]) / total if total > 0 else float("nan")


def _with_albedo(component: Component, value: float, wavelength: float, name: str) -> Component:
    plain, optics = as_particles(component, name)
    moved = placed(optics.single_scattering_albedo, wavelength, value, 0.0, 1.0)
    return changed(plain, name, optics=changed(optics, name, single_scattering_albedo=moved))


def _asymmetry(component: Component, wavelength: float) -> float:
    return float(component.optics.phase_function([wavelength]).mean_cosine([wavelength])[0])


def _with_asymmetry(component: Component, value: float, wavelength: float, name: str) -> Component:
    plain, optics = as_particles(component, name)
    phase = optics.phase
    if not isinstance(phase, (HenyeyGreenstein, CornetteShanks, Draine)):
        raise DomainError(
            "free",
            name,
            f"a phase function {type(phase).__name__} has no single parameter for it; free one of its own",
        )

    def with_parameter(g: float) -> Any:
        return changed(phase, name, g=shifted(phase.g, wavelength, g, -1.0, 1.0))

    low, high = -1 + 1e-9, 1 - 1e-9
    if isinstance(phase, HenyeyGreenstein) and not isinstance(phase.g, SpectralTable):
        found = with_parameter(value)
    else:
        for _ in range(48):  # the mean cosine rises with the parameter; 48 halvings leave 1e-14
            middle = 0.5 * (low + high)
            found = with_parameter(middle)
            below = float(found.mean_cosine([wavelength])[0]) < value
            low, high = (middle, high) if below else (low, middle)
    return changed(plain, name, optics=changed(optics, name, phase=found))


def _radius(component: Component, wavelength: float) -> float:
    """Effective radius of all modes together before any cut [m]: third over second moment."""
    if not isinstance(component.optics, MieAerosol):
        raise _refuse(component, f"{component.name}.effective_radius", "only optics of kind mie have sizes")
    modes = [mode for mode in component.optics.modes if isinstance(mode, LogNormalMode)]
    if len(modes) < len(component.optics.modes):
        raise _refuse(component, f"{component.name}.effective_radius", "only log-normal modes can be stretched")
    s2 = np.array([np.log(m.geometric_standard_deviation) ** 2 for m in modes])
    r, n = np.array([m.median_radius for m in modes]), np.array([m.fraction for m in modes])
    return float(np.sum(n * r**3 * np.exp(4.5 * s2)) / np.sum(n * r**2 * np.exp(2 * s2)))


def _with_radius(component: Component, value: float, wavelength: float, name: str) -> Component:
    factor = value / _radius(component, wavelength)
    modes = []
    for mode in getattr(component.optics, "modes", ()):
        cuts = {c: getattr(mode, c) * factor for c in ("min_radius", "max_radius") if getattr(mode, c) is not None}
        modes.append(changed(mode, name, median_radius=mode.median_radius * factor, **cuts))
    return changed(component, name, optics=changed(component.optics, name, modes=tuple(modes)))


def _dobson(component: Component, wavelength: float) -> float:
    if not isinstance(component.optics, GasAbsorption):
        raise _refuse(component, f"{component.name}.column_du", "only gases have a column")
    column = component.density.reference_column()
    return component.weight * component.optics.molecules_per_volume(column) * column / DOBSON_UNIT


def _with_dobson(component: Component, value: float, wavelength: float, name: str) -> Component:
    amounts = {"column_du": value, "column_m2": None, "number_density": None}
    return changed(component, name, optics=changed(component.optics, name, **amounts), weight=1.0)


#: By the last word of a dotted name.
QUANTITIES: dict[str, Quantity] = {
    "optical_depth": Quantity(vertical_depth, with_depth, amount=True),
    "extinction": Quantity(_visual, _with_visual, amount=True),
    "visual_extinction": Quantity(_visual, _with_visual, amount=True),
    "column_du": Quantity(_dobson, _with_dobson, amount=True),
    "single_scattering_albedo": Quantity(_albedo, _with_albedo),
    "albedo": Quantity(_albedo, _with_albedo),
    "asymmetry": Quantity(_asymmetry, _with_asymmetry),
    "effective_radius": Quantity(_radius, _with_radius),
}
