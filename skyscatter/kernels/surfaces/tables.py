"""A scene of surfaces, media and lamps as the kernels see it: arrays only, the wavelength always last.

What a ray can meet is an *item*: an analytic shape, or one triangle of a mesh.  Items belong to *bodies*; a body is
made of one material, may be the boundary of one medium, and may be a lamp.  Normals point out of a body; the inside
of a plane, a rectangle, a disk is the side from which the normal points away.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skyscatter.kernels.byaddress import by_address
from skyscatter.kernels.eclipse import EclipseTable
from skyscatter.kernels.lookup import ColumnTable
from skyscatter.kernels.space import SpaceTable


@by_address
class ShapeTable(NamedTuple):
    """Everything that rays can meet.  Items 0 ... shapes - 1 are shapes, the rest triangles."""

    kind: np.ndarray  #: (shape,) int64
    parameters: np.ndarray  #: (shape, 16) float64, layout by kind, see `kernels.surfaces.shapes`
    shape_body: np.ndarray  #: (shape,) int64
    triangle: np.ndarray  #: (triangle, 12) three corners (shared ones must agree to the last bit), unit normal
    triangle_body: np.ndarray  #: (triangle,) int64
    loose: np.ndarray  #: (n,) int64 items that are tested one by one: endless ones, and all where there are few
    node_box: np.ndarray  #: (node, 6) float64 bounds of the nodes of the tree over all other items; none without such
    node_link: np.ndarray  #: (node, 2) int64, layout see `kernels.surfaces.tree`
    order: np.ndarray  #: (n,) int64 items in the order of the tree's leaves
    material: np.ndarray  #: (body,) int64 row of `MaterialTable`
    inside: np.ndarray  #: (body,) int64 medium that the body bounds, -1 where it bounds none
    lamp: np.ndarray  #: (body,) int64 row of `LampTable`, -1 for bodies that do not shine
    thin: np.ndarray  #: (body,) bool, whether it is an INTERFACE, through which shadow rays go on
    passable: bool  #: whether some body is one


@by_address
class MaterialTable(NamedTuple):
    """What surfaces do to light."""

    kind: np.ndarray  #: (material,) int64
    roughness: np.ndarray  #: (material,) GGX alpha; 0 where smooth
    reflectance: np.ndarray  #: (material, wavelength) albedo of LAMBERT, MIRROR; amplitude of RPV; foam of SEA
    index: np.ndarray  # type: ignore[assignment]  #: (material, wavelength) real part n of a CONDUCTOR's or SEA's
    absorption: np.ndarray  #: (material, wavelength) imaginary part k
    #: (material, 3, wavelength) exponent, asymmetry, hot spot of RPV; weights of both kernels of ROSS_LI; of SEA the
    #: share without foam
    bowl: np.ndarray
    lost: np.ndarray  #: (material, ratio, node) share that facets throw on others, see `facets.ratio_at`
    lost_mean: np.ndarray  #: (material, ratio) its mean over directions by the cosine
    mosaic: np.ndarray  #: (material,) int64 number of the mosaic that this material lies around, -1 of others
    mosaic_place: np.ndarray  #: (mosaic, 4) x and y of its middle, side of a cell, lowest z [m]
    mosaic_shape: np.ndarray  #: (mosaic, 3) int64 first of its cells, number of rows and of columns
    mosaic_cells: np.ndarray  #: (cell,) int64 by how many rows the material of each cell follows; rows go from north


@by_address
class MediaTable(NamedTuple):
    """The media between surfaces.  Medium 0 is outside of all bodies; each owns a stretch of the components.

    A component whose density is the same everywhere has no term in `space`: `density` tells it.  Nor have shells of air
    around the planet: `shells` holds their columns.
    """

    first: np.ndarray  #: (medium + 1,) int64, first component of each medium
    priority: np.ndarray  #: (medium,) int64; where bodies overlap the medium of highest priority is met
    index: np.ndarray  # type: ignore[assignment]  #: (medium, wavelength) refractive index
    dispersive: np.ndarray  #: (medium,) bool, whether the index depends on the wavelength
    constant: np.ndarray  #: (medium,) bool, whether all of its components are equally dense everywhere
    extinction: np.ndarray  #: (medium, wavelength) [m-1] of constant media, 0 of others
    scattering: np.ndarray  #: (medium, wavelength) [m-1] of constant media, 0 of others
    space: SpaceTable | None  #: densities of components that are neither constant nor shells; None without any
    shells: ColumnTable | None  #: of all components; shells of air in one place, others empty; None without any
    centre: np.ndarray  #: (3,) of those shells [m]
    density: np.ndarray  #: (component,) of constant components, 0 of others
    sigma_s: np.ndarray  #: (component, wavelength) scattering per unit density [m-1]
    sigma_t: np.ndarray  #: (component, wavelength) extinction per unit density [m-1]
    emission: np.ndarray  #: (component, wavelength) [W m-3 sr-1 nm-1]
    phase: np.ndarray  #: (component, angle, wavelength) [sr-1], at cos_theta = 1 - 2 (k / n)^2
    phase_cdf: np.ndarray  #: (component, wavelength, angle) probability of an angle nearer to forward
    rate: np.ndarray  #: (component,) greatest extinction of any wavelength per unit density [m-1]


@by_address
class PeakTable(NamedTuple):
    """Phase functions as the sum of a broad part and a peak, see `kernels.surfaces.peaks`."""

    broad: np.ndarray  #: (component, angle, wavelength) [sr-1]
    phase: np.ndarray  #: (component, angle, wavelength) the peak [sr-1]
    phase_cdf: np.ndarray  #: (component, wavelength, angle) its distribution function
    share: np.ndarray  #: (component, wavelength) its share of the scattered light
    most: np.ndarray  #: (medium, wavelength) the largest share of it times albedo of the medium's components


@by_address
class LampTable(NamedTuple):
    """Where light comes from.

    A lamp's *lobe* is its radiant intensity over the cosine of the angle from its axis (from the surface's normal for
    lamps that are surfaces), linear between nodes, with 2 pi times its integral equal to 1.  A lamp that is a surface
    has the same lobe on every piece of it: radiance = power x lobe / (area x cosine).
    """

    kind: np.ndarray  #: (lamp,) int64
    power: np.ndarray  #: (lamp, wavelength) [W nm-1]; irradiance [W m-2 nm-1] if parallel, radiance of the surroundings
    position: np.ndarray  #: (lamp, 3) [m] of a point lamp; direction towards a parallel one
    axis: np.ndarray  #: (lamp, 3) unit vector, middle of the lobe of a point lamp
    lobe_first: np.ndarray  #: (lamp + 1,) int64
    lobe_cosine: np.ndarray  #: (node,) rising within a lamp
    lobe_value: np.ndarray  #: (node,) [sr-1]
    lobe_cdf: np.ndarray  #: (node,) 0 ... 1 within a lamp
    item_first: np.ndarray  #: (lamp + 1,) int64, the items of a lamp that is a surface
    item: np.ndarray  #: (n,) int64
    item_cdf: np.ndarray  #: (n,) 0 < ... = 1 within a lamp, by area
    area: np.ndarray  #: (lamp,) [m2], 0 of lamps without a surface
    share: np.ndarray  #: (lamp,) chance with which a photon starts from it: share of the power, wavelengths averaged
    stack: np.ndarray  #: (lamp, STACK) int64 media around it, the last entered last; -1 where none
    limb_row: np.ndarray  #: (lamp,) int64 row of `limb` of a parallel lamp with a disk, -1 of others
    disk: np.ndarray  #: (lamp,) sine of the angular radius of a parallel lamp, 0 without a disk
    limb: np.ndarray  #: (disk, ring, wavelength) radiance over its mean, over the squared fractional radius
    centre: np.ndarray  #: (3,) of a sphere around all that is finite: where parallel light and surroundings start from
    radius: float  #: of that sphere [m]
    mapped: int  #: lamp whose radiance is that of `around`, -1 if none: then the camera does not look at it
    #: (row, column, wavelength) radiance from outside beside that of other surroundings; rows are even in the elevation
    #: over the x-y plane, columns in the azimuth from y towards x; no rows where there is none
    around: np.ndarray
    around_cdf: np.ndarray  #: ((row - 1) * column,) 0 < ... = 1, by which walks aim at cells between nodes; none: never
    eclipsed: int  #: parallel lamp that the Moon stands before, -1 if none
    moon: EclipseTable  #: in the frame of the scene


@by_address
class SurfaceTable(NamedTuple):
    """A scene with surfaces."""

    shapes: ShapeTable
    materials: MaterialTable
    media: MediaTable
    lamps: LampTable
