"""Analytic density fields: the base of all shapes, and the round ones."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from skyscatter.errors import DomainError
from skyscatter.kernels.codes.space import BONNOR_EBERT, GAUSSIAN_SHELL, GAUSSIAN_SPHERE, POWER_LAW, SHELL, SPHERE
from skyscatter.media.programs import map_box, map_boxes, method_of
from skyscatter.media.space import Array, FieldTerm, Instruction, SpatialField
from skyscatter.units import Degrees, Metres, OptionalNumber, Place, PositiveMetres, PositiveNumber, Triple, default

#: Widths at which a Gaussian is cut: it has fallen to 1e-8 of its middle.
GAUSSIAN_CUT = 6.07


def require_positive(field: SpatialField, *names: str) -> None:
    """Refuse a field with one of these numbers given, and not above zero."""
    for name in names:
        value = getattr(field, name)
        if value is not None and not value > 0:
            raise DomainError(name, value, "must be above 0")


def axis_rotation(axis: tuple[float, float, float], turn_deg: float) -> Array:
    """Rotation (3, 3) that turns by `turn_deg` about z, then takes z to `axis` on the shortest way."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    if z < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0]) @ turn
    # Rodrigues' formula for the rotation about z x axis, with 1 - cos = (x^2 + y^2) / (1 + z).
    k = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return (np.eye(3) + k + k @ k / (1.0 + z)) @ turn


class Leaf(NamedTuple):
    """A shape in its own frame."""

    operation: int
    unit: float | tuple[float, float, float]  #: length [m] of the frame's unit, along each axis
    reach: float | Array  #: radius of the ball, or corners (2, 3) of the box, that holds it, in units
    scale: float  #: longest panel of the quadrature, in (the shortest of the) units
    parameters: tuple[float, ...] = ()
    data: NDArray[np.float32] | None = None
    numbers: tuple[int, ...] = ()


class Shape(SpatialField):
    """A field that has a place, an axis and a size along each of its axes.

    Parameters
    ----------
    position : three lengths
        Where its middle is [m].
    axis : three numbers
        Direction of its own z axis in the model's frame, of any length; x and y follow on the shortest way (for the
        opposite of z: about x).
    turn_deg : float
        Rotation about its own z axis before that.
    axes : three numbers
        Factors by which it is stretched along its own x, y and z.
    """

    position: Place = default((0.0, 0.0, 0.0))
    axis: Triple = default((0.0, 0.0, 1.0))
    turn_deg: Degrees = default(0.0)
    axes: Triple = default((1.0, 1.0, 1.0))

    @model_validator(mode="after")
    def _check_place(self) -> Shape:
        if not np.linalg.norm(self.axis) > 0:
            raise DomainError("axis", self.axis, "must point somewhere: one of its numbers is not 0")
        if min(self.axes) <= 0:
            raise DomainError("axes", self.axes, "must be three factors above 0")
        return self

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        raise NotImplementedError

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes (box, 3) of its own frame."""
        raise NotImplementedError

    @property
    def rotation(self) -> Array:
        """From its own axes to those of the model (3, 3)."""
        return axis_rotation(self.axis, self.turn_deg)

    @property
    def centre(self) -> Array:
        """Point (3,) [m] through which the reference column goes."""
        return np.array(self.position)

    def _into(self, leaf: Leaf) -> tuple[Array, Array]:
        matrix = self.rotation.T / (np.array(self.axes) * leaf.unit)[:, None]
        return matrix, -matrix @ np.array(self.position)

    def terms(self) -> tuple[FieldTerm, ...]:
        """The field as data for the kernels."""
        leaf = self.leaf()
        matrix, offset = self._into(leaf)
        step = Instruction(leaf.operation, np.column_stack([matrix, offset]), leaf.parameters, leaf.data, leaf.numbers)
        out = np.linalg.inv(matrix).astype(float)
        place = np.array(self.position)
        if isinstance(leaf.reach, np.ndarray):
            box = map_box(leaf.reach, out, place)
        else:
            box = place + np.array([[-1.0], [1.0]]) * np.linalg.norm(out, axis=1) * leaf.reach
        # A rounding error wider, so that nothing sticks out.
        box += 1e-12 * np.array([[-1.0], [1.0]]) * (box[1] - box[0])
        scale = leaf.scale * float((np.array(self.axes) * leaf.unit).min())
        return (FieldTerm((step,), method_of((step,)), 1.0, box, scale),)

    def extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes; see `SpatialField`."""
        return self.local_extremes(*map_boxes(low, high, *self._into(self.leaf())))


def radii(low: Array, high: Array) -> tuple[Array, Array]:
    """Distances of the nearest and of the farthest point of boxes (box, axes) from the origin."""
    near = np.maximum(np.maximum(low, -high), 0.0)
    far = np.maximum(np.abs(low), np.abs(high))
    return np.linalg.norm(near, axis=1), np.linalg.norm(far, axis=1)


class _Round(Shape):
    """A field that depends on the distance from its centre alone (before stretching), and never rises with it."""

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]."""
        raise NotImplementedError

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame."""
        near, far = radii(low, high)
        unit = self.leaf().unit
        return self.profile(far * unit), self.profile(near * unit)


class Sphere(_Round):
    """Density 1 within a radius.

    Parameters
    ----------
    radius : length
        [m]

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    A line that passes 1 m from the middle of a ball of 2 m:

    >>> from skyscatter import fields
    >>> ball = fields.Sphere(radius="2 m")
    >>> ball.density([[0, 0, 1], [0, 0, 3]]).tolist()
    [1.0, 0.0]
    >>> round(float(ball.column([0, 1, -9], [0, 1, 9])), 3)  # m
    3.464
    """

    kind: Literal["sphere"] = "sphere"
    radius: PositiveMetres

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]."""
        return np.where(radius <= self.radius, 1.0, 0.0)

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        return Leaf(SPHERE, self.radius, 1.0, 2.0)


class GaussianSphere(_Round):
    """exp(-r^2 / 2 width^2), cut where it has fallen to 1e-8 of the middle.

    Parameters
    ----------
    width : length
        Standard deviation [m].

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    The column through the middle is sqrt(2 pi) widths, and the density has fallen to one half at 1.177 widths:

    >>> from skyscatter import fields
    >>> core = fields.GaussianSphere(width="0.1 pc")
    >>> round(core.reference_column() / core.width, 3)
    2.507
    >>> round(float(core.density([1.1774 * core.width, 0, 0])), 3)
    0.5
    """

    kind: Literal["gaussian-sphere"] = "gaussian-sphere"
    width: PositiveMetres

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]."""
        x = np.asarray(radius) / self.width
        return np.where(x <= GAUSSIAN_CUT, np.exp(-0.5 * x**2), 0.0)

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        return Leaf(GAUSSIAN_SPHERE, self.width, GAUSSIAN_CUT, GAUSSIAN_CUT, (GAUSSIAN_CUT**2,))


class _PowerLawSphere(_Round):
    """(1 + r^2 / core^2)^(-exponent / 2) within a radius."""

    def _shape(self) -> tuple[float, float, float]:
        """Core [m], exponent, and radius of the cut [m]."""
        raise NotImplementedError

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]."""
        core, exponent, cut = self._shape()
        x = np.asarray(radius) / core
        return np.where(x <= cut / core, (1.0 + x**2) ** (-0.5 * exponent), 0.0)

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        core, exponent, cut = self._shape()
        return Leaf(POWER_LAW, core, cut / core, cut / core, (0.5 * exponent, (cut / core) ** 2))


class Plummer(_PowerLawSphere):
    """(1 + r^2 / a^2)^(-5/2), the sphere of Plummer (1911, MNRAS 71, 460).

    Parameters
    ----------
    radius : length
        a [m].
    cut : length, optional
        Radius beyond which there is nothing [m]; 40 a (1e-8 of the middle) when not given.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    The column is 4/3 a in the middle, and a quarter of that at the distance a from it:

    >>> from skyscatter import fields
    >>> cluster = fields.Plummer(radius=1)
    >>> columns = cluster.column([[0, 0, -50], [1, 0, -50]], [[0, 0, 50], [1, 0, 50]])  # m
    >>> columns.round(3).tolist()
    [1.333, 0.333]
    """

    kind: Literal["plummer"] = "plummer"
    radius: PositiveMetres
    cut: OptionalNumber[PositiveMetres] = default(None)

    def _shape(self) -> tuple[float, float, float]:
        return self.radius, 5.0, 40.0 * self.radius if self.cut is None else self.cut


class King(_PowerLawSphere):
    """(1 + r^2 / a^2)^(-3/2) within a radius: King's (1962, AJ 67, 471, eq. 27) approximation to the isothermal core.

    This is the space density whose column is (1 + R^2 / a^2)^(-1), also called the modified Hubble profile; his tidal
    edge is replaced by a sharp one.

    Parameters
    ----------
    core : length
        a [m].
    cut : length
        Radius beyond which there is nothing [m].

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    At the core radius the column has fallen to one half, when the cut lies far out:

    >>> from skyscatter import fields
    >>> cluster = fields.King(core=1, cut=1000)
    >>> columns = cluster.column([[0, 0, -2000], [1, 0, -2000]], [[0, 0, 2000], [1, 0, 2000]])  # m
    >>> columns.round(3).tolist()
    [2.0, 1.0]
    """

    kind: Literal["king"] = "king"
    core: PositiveMetres
    cut: PositiveMetres

    def _shape(self) -> tuple[float, float, float]:
        return self.core, 3.0, self.cut


class PowerLaw(_PowerLawSphere):
    """(1 + r^2 / core^2)^(-exponent / 2) within a radius.

    Parameters
    ----------
    core : length
        Radius within which it is flat [m].
    exponent : float
        Far out the density falls as r^-exponent; above 0, at most 40.
    cut : length
        Radius beyond which there is nothing [m].

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    A wind that has reached its final speed thins out as the inverse square of the distance:

    >>> from skyscatter import fields
    >>> wind = fields.PowerLaw(core=1, exponent=2, cut=1000)
    >>> wind.density([[0, 0, 0], [0, 0, 10], [0, 0, 100]]).round(6).tolist()
    [1.0, 0.009901, 0.0001]
    >>> round(wind.reference_column(), 2)  # m; pi cores without the cut
    3.14
    """

    kind: Literal["power-law"] = "power-law"
    core: PositiveMetres
    exponent: PositiveNumber
    cut: PositiveMetres

    @model_validator(mode="after")
    def _check(self) -> PowerLaw:
        if self.exponent > 40:
            raise DomainError("exponent", self.exponent, "must be at most 40; a sphere has a sharper edge")
        return self

    def _shape(self) -> tuple[float, float, float]:
        return self.core, self.exponent, self.cut


#: Nodes of the table of a Bonnor-Ebert sphere.
ISOTHERMAL_NODES = 160
#: Dimensionless radius of the largest stable sphere.
CRITICAL_RADIUS = 6.451


@lru_cache(maxsize=64)
def isothermal_table(xi_max: float) -> tuple[float, tuple[float, ...]]:
    """The isothermal sphere: psi'' + 2 psi' / xi = exp(-psi), psi(0) = psi'(0) = 0 (Chandrasekhar 1939, ch. IV, 374).

    Returns
    -------
    step : float
        Width of a cell in u = ln(1 + xi^2 / 6).
    nodes : tuple
        psi and its slope times `step` at the nodes, one after the other.
    """
    from scipy.integrate import solve_ivp

    u = np.linspace(0.0, np.log1p(xi_max**2 / 6), ISOTHERMAL_NODES)
    xi = np.sqrt(6 * np.expm1(u))
    # The series about 0 starts the integration: psi = xi^2 / 6 - xi^4 / 120 + xi^6 / 1890.
    first = min(1e-2, 0.5 * xi[1])
    start = [first**2 / 6 - first**4 / 120 + first**6 / 1890, first / 3 - first**3 / 30 + first**5 / 315]
    solution = solve_ivp(
        lambda x, y: [y[1], np.exp(-y[0]) - 2 * y[1] / x],
        (first, xi[-1] * (1 + 1e-12)), start, method="DOP853", t_eval=xi[1:], rtol=1e-12, atol=1e-14,
    )  # fmt: skip
    psi = np.concatenate([[0.0], solution.y[0]])
    slope = np.concatenate([[1.0], solution.y[1] * 3 * np.exp(u[1:]) / xi[1:]])
    return float(u[1]), tuple(np.column_stack([psi, slope * u[1]]).ravel())


class BonnorEbert(_Round):
    """Isothermal sphere in balance with its own gravity and an outer pressure, 1 in the middle.

    Bonnor (1956, MNRAS 116, 351), Ebert (1955, Z. Astrophys. 37, 217).

    Parameters
    ----------
    radius : length
        Where it ends [m].
    dimensionless_radius : float, optional
        The same in units of c_s / sqrt(4 pi G rho_c), from 0.01 to 1000; 6.451, the largest stable one, when neither
        this nor the next is given.
    pressure_contrast : float, optional
        Pressure in the middle over the outer pressure, in its place: above 1, at most 1e5.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    In the largest stable sphere the density in the middle is 14 times that at the edge.  A sphere with a contrast of 5
    ends at a smaller dimensionless radius:

    >>> from skyscatter import fields
    >>> globule = fields.BonnorEbert(radius="0.1 pc")
    >>> round(1 / float(globule.density([0.999999 * globule.radius, 0, 0])), 1)
    14.0
    >>> round(fields.BonnorEbert(radius="0.1 pc", pressure_contrast=5).xi_max, 2)
    4.08
    """

    kind: Literal["bonnor-ebert"] = "bonnor-ebert"
    radius: PositiveMetres
    dimensionless_radius: float | None = None
    pressure_contrast: float | None = None

    @model_validator(mode="after")
    def _check(self) -> BonnorEbert:
        if self.dimensionless_radius is not None and self.pressure_contrast is not None:
            raise DomainError(
                "pressure_contrast", self.pressure_contrast, "follows from dimensionless_radius; give one"
            )
        if self.dimensionless_radius is not None and not 0.01 <= self.dimensionless_radius <= 1000:
            raise DomainError("dimensionless_radius", self.dimensionless_radius, "must lie from 0.01 to 1000")
        if self.pressure_contrast is not None and not 1.0001 <= self.pressure_contrast <= 1e5:
            raise DomainError("pressure_contrast", self.pressure_contrast, "must lie from 1.0001 to 1e5")
        return self

    @property
    def xi_max(self) -> float:
        """Dimensionless radius of its edge."""
        if self.pressure_contrast is None:
            return CRITICAL_RADIUS if self.dimensionless_radius is None else self.dimensionless_radius
        from scipy.optimize import brentq

        step, nodes = isothermal_table(1000.0)
        target = np.log(self.pressure_contrast)
        return float(np.sqrt(6 * np.expm1(brentq(lambda u: isothermal_psi(u, step, nodes) - target, 0.0, 12.0))))

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]."""
        x = np.asarray(radius) / self.radius
        u = np.log1p((np.minimum(x, 1.0) * self.xi_max) ** 2 / 6)
        return np.where(x <= 1.0, np.exp(-isothermal_psi(u, *isothermal_table(self.xi_max))), 0.0)

    def leaf(self) -> Leaf:
        """The shape in its own frame, in which the dimensionless radius is the unit."""
        xi = self.xi_max
        step, nodes = isothermal_table(xi)
        # One more node, a copy, for points that rounding puts beyond the last.
        return Leaf(BONNOR_EBERT, self.radius / xi, xi, xi, (xi**2, step, *nodes, *nodes[-2:]))


def isothermal_psi(u: Array | float, step: float, nodes: tuple[float, ...]) -> Array:
    """Psi of the isothermal sphere at u = ln(1 + xi^2 / 6), by the cubics of `isothermal_table`."""
    table = np.array(nodes).reshape(-1, 2)
    k = np.clip(np.asarray(u) / step, 0, len(table) - 2).astype(int)
    f = np.asarray(u) / step - k
    (y0, d0), (y1, d1) = table[k].T, table[k + 1].T
    rise = y1 - y0
    return y0 + f * (d0 + f * (3 * rise - 2 * d0 - d1 + f * (d0 + d1 - 2 * rise)))


class Shell(Shape):
    """Density 1 between two radii; ellipsoidal with `axes`.

    Parameters
    ----------
    inner, outer : length
        Radii of the hollow and of the whole [m]; the first lies below the second.

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    Seen from outside, a shell is brightest along its inner rim, where the column is longest:

    >>> from skyscatter import fields
    >>> shell = fields.Shell(inner=0.8, outer=1)
    >>> shell.column([[0, 0, -2], [0.8, 0, -2]], [[0, 0, 2], [0.8, 0, 2]]).round(3).tolist()  # m
    [0.4, 1.2]
    """

    kind: Literal["shell"] = "shell"
    inner: Metres
    outer: PositiveMetres

    @model_validator(mode="after")
    def _check(self) -> Shell:
        if not 0 <= self.inner < self.outer:
            raise DomainError("inner", self.inner, "must lie between 0 and the outer radius")
        return self

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        return Leaf(SHELL, self.outer, 1.0, 2.0, ((self.inner / self.outer) ** 2,))

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame."""
        near, far = radii(low, high)
        inner = self.inner / self.outer
        inside, meets = (near >= inner) & (far <= 1.0), (far >= inner) & (near <= 1.0)
        return inside.astype(float), meets.astype(float)


class GaussianShell(Shape):
    """exp(-(r - radius)^2 / 2 width^2): a thin shell, cut at 1e-8 of its ridge; ellipsoidal with `axes`.

    Parameters
    ----------
    radius : length
        Of the ridge [m].
    width : length
        Standard deviation across the ridge [m].

    Other Parameters
    ----------------
    position, axis, turn_deg, axes
        As of every shape: its place [m], the direction of its own z axis, a turn about it [degree] before that, and
        factors by which it is stretched along its own x, y and z.

    Examples
    --------
    A ring nebula: the column through the middle crosses the shell twice, the one along the ridge is longer:

    >>> from skyscatter import fields
    >>> shell = fields.GaussianShell(radius=1, width=0.05)
    >>> shell.column([[0, 0, -2], [1, 0, -2]], [[0, 0, 2], [1, 0, 2]]).round(3).tolist()  # m
    [0.251, 0.694]
    """

    kind: Literal["gaussian-shell"] = "gaussian-shell"
    radius: Metres
    width: PositiveMetres

    @model_validator(mode="after")
    def _check(self) -> GaussianShell:
        require_positive(self, "radius", "width")
        return self

    def leaf(self) -> Leaf:
        """The shape in its own frame."""
        width = self.width / self.radius
        return Leaf(GAUSSIAN_SHELL, self.radius, 1.0 + GAUSSIAN_CUT * width, 1.0, (width, GAUSSIAN_CUT))

    def profile(self, radius: Array) -> Array:
        """Density at distances from the centre [m]."""
        x = np.abs((np.asarray(radius) - self.radius) / self.width)
        return np.where(x <= GAUSSIAN_CUT, np.exp(-0.5 * x**2), 0.0)

    def local_extremes(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds of the density within boxes of its own frame."""
        near, far = (r * self.radius for r in radii(low, high))
        ends = np.array([self.profile(near), self.profile(far)])
        return ends.min(axis=0), np.where((near <= self.radius) & (far >= self.radius), 1.0, ends.max(axis=0))
