"""Records of shapes and materials as the tables that kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.kernels.codes import surfaces as codes
from skyscatter.kernels.surfaces.tables import MaterialTable, ShapeTable
from skyscatter.spectra.table import evaluate
from skyscatter.surfaces.facets import ANGLES, RATIOS, lost_table
from skyscatter.surfaces.grounds import RossLi, Rpv, Sea
from skyscatter.surfaces.materials import Conductor, Dielectric, Interface, Lambert, Mirror, Mosaic
from skyscatter.surfaces.meshes import Faceted
from skyscatter.surfaces.shapes import Box, Disk, Plane, Rectangle, Sphere

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
_PARAMETERS = 16
#: So many bounded items, and more, are put into a tree: fewer are tested faster one by one.
TREE_FROM = 8
#: Rounding of a shape's bounds, relative to its coordinates.
_ROUNDING = 1e-14
#: Length [m] that is nothing, but not 0.
_TINY = 1e-200


def _row(shape: Any) -> tuple[int, list[Any]]:
    """Kind and parameters of an analytic shape, as `kernels.surfaces.shapes` lays them out."""
    if isinstance(shape, Sphere):
        return codes.SPHERE, [shape.position, [shape.radius]]
    if isinstance(shape, Plane):
        return codes.PLANE, [shape.position, shape.unit_normal]
    if isinstance(shape, Rectangle):
        corner, a, b = shape.edges
        normal = np.cross(a, b)
        return codes.RECTANGLE, [corner, a, b, normal / np.linalg.norm(normal), [1 / (a @ a), 1 / (b @ b)]]
    if isinstance(shape, Box):
        return codes.BOX, [shape.position, 0.5 * np.array(shape.size), shape.axes.ravel()]
    if isinstance(shape, Disk):
        return codes.DISK, [shape.position, shape.unit_normal, [shape.radius, shape.inner_radius], shape.across]
    raise TypeError(f"no shape: {type(shape).__name__}")


def _boxes(rows: list[tuple[Array, Array]], corners: Array) -> Array:
    """Bounds of all items (item, 6), a rounding error wider.

    Wider they are also where a bound is 0: a ray that runs within the face of a box then is inside of it.
    """
    boxes = np.concatenate(
        [
            np.array([np.concatenate(row) for row in rows]).reshape(-1, 6),
            np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1),
        ]
    )
    with np.errstate(invalid="ignore"):
        reach = _ROUNDING * np.maximum(np.abs(boxes[:, :3]), np.abs(boxes[:, 3:])) + _TINY
    boxes[:, :3] -= reach
    boxes[:, 3:] += reach
    return boxes


def _plant(boxes: Array) -> tuple[Integers, Array, Integers, Integers]:
    """Loose items, and the tree over all others: (loose, node_box, node_link, order)."""
    bounded = np.isfinite(boxes).all(axis=1)
    if bounded.sum() < TREE_FROM:
        return np.arange(len(boxes)), np.zeros((0, 6)), np.zeros((0, 2), np.int64), np.zeros(0, np.int64)
    from skyscatter.kernels.surfaces import tree

    items = np.flatnonzero(bounded)
    order = np.arange(items.size)
    node_box, node_link = np.zeros((2 * items.size + 2, 6)), np.zeros((2 * items.size + 2, 2), np.int64)
    scratch = np.zeros((128, 4), np.int64), np.zeros((tree.BINS, 7)), np.zeros(tree.BINS), np.zeros(6)
    used = tree.build_tree(np.ascontiguousarray(boxes[items]), order, node_box, node_link, *scratch)
    return np.flatnonzero(~bounded), node_box[:used].copy(), node_link[:used].copy(), items[order]


def pack_shapes(bodies: Sequence[tuple[Any, int, int, int]], materials: Sequence[Any]) -> ShapeTable:
    """The table of everything that rays can meet.

    Parameters
    ----------
    bodies : sequence of (shape, material, inside, lamp)
        In the order in which kernels will number them: the shape's record, the row of its material, the number of the
        medium inside or -1, the number of its lamp or -1.
    materials : sequence of records
        The same as for `pack_materials`.

    Raises
    ------
    DomainError
        If a medium is to be inside of a shape that holds no volume, or of a mesh that is not closed.
    """
    kinds, rows, owners, bounds = [], [], [], []
    triangles, triangle_owners = [np.zeros((0, 12))], [np.zeros(0, np.int64)]
    for body, (shape, _, inside, _) in enumerate(bodies):
        if inside >= 0:
            shape.check_volume()
        if isinstance(shape, Faceted):
            mesh = shape.triangles
            triangles.append(np.concatenate([mesh.corners.reshape(-1, 9), mesh.normals], axis=1))
            triangle_owners.append(np.full(len(mesh.normals), body))
            continue
        kind, parts = _row(shape)
        row = np.zeros(_PARAMETERS)
        values = np.concatenate([np.asarray(part, float).ravel() for part in parts])
        row[: values.size] = values
        kinds.append(kind)
        rows.append(row)
        owners.append(body)
        bounds.append(shape.bounds)
    triangle = np.concatenate(triangles)
    loose, node_box, node_link, order = _plant(_boxes(bounds, triangle[:, :9].reshape(-1, 3, 3)))
    numbers = np.array([numbers for _, *numbers in bodies], np.int64).reshape(-1, 3)
    thin = np.array([isinstance(materials[m], Interface) for m in numbers[:, 0]], bool)
    return ShapeTable(
        kind=np.array(kinds, np.int64),
        parameters=np.array(rows).reshape(-1, _PARAMETERS),
        shape_body=np.array(owners, np.int64),
        triangle=triangle,
        triangle_body=np.concatenate(triangle_owners),
        loose=loose,
        node_box=node_box,
        node_link=node_link,
        order=order,
        material=np.ascontiguousarray(numbers[:, 0]),
        inside=np.ascontiguousarray(numbers[:, 1]),
        lamp=np.ascontiguousarray(numbers[:, 2]),
        thin=thin,
        passable=bool(thin.any()),
    )


def pack_materials(materials: Sequence[Any], wavelengths_nm: ArrayLike) -> MaterialTable:
    """The table of what surfaces do to light.

    Parameters
    ----------
    materials : sequence of records
        `Interface`, `Lambert`, `Mirror`, `Dielectric`, `Conductor`, `Rpv`, `RossLi`, `Sea`, or a `Mosaic` before what
        it is made of, as `unfolded` gives them.
    wavelengths_nm : array_like, shape (wavelength,)
    """
    wl = np.atleast_1d(np.asarray(wavelengths_nm, float))
    count = len(materials)
    kind, roughness = np.zeros(count, np.int64), np.zeros(count)
    reflectance, index, absorption = np.zeros((3, count, wl.size))
    bowl = np.zeros((count, 3, wl.size))
    lost, lost_mean = np.zeros((count, RATIOS, ANGLES)), np.zeros((count, RATIOS))
    for k, material in enumerate(m.rest if isinstance(m, Mosaic) else m for m in materials):
        if isinstance(material, Interface):
            kind[k] = codes.INTERFACE
        elif isinstance(material, Lambert):
            kind[k], reflectance[k] = codes.LAMBERT, material.reflectance(wl)
        elif isinstance(material, Mirror):
            kind[k], reflectance[k] = codes.MIRROR, evaluate(material.reflectance, wl)
        elif isinstance(material, Dielectric):
            kind[k], roughness[k] = codes.DIELECTRIC, material.roughness
        elif isinstance(material, Conductor):
            kind[k], roughness[k] = codes.CONDUCTOR, material.roughness
            index[k], absorption[k] = material.index(wl)
        elif isinstance(material, Rpv):
            kind[k], (reflectance[k], *bowl[k]) = codes.RPV, material.parameters(wl)
        elif isinstance(material, RossLi):
            kind[k], (reflectance[k], *bowl[k, :2]) = codes.ROSS_LI, material.parameters(wl)
        elif isinstance(material, Sea):
            kind[k], roughness[k] = codes.SEA, material.slope
            index[k], reflectance[k] = material.refractive_index(wl), material.diffuse(wl)
            bowl[k, 0] = 1 - material.foam_cover
        else:
            raise TypeError(f"no material: {type(material).__name__}")
        if roughness[k] > 0.0 and kind[k] != codes.SEA:
            lost[k], lost_mean[k] = lost_table(roughness[k])
    return MaterialTable(kind, roughness, reflectance, index, absorption, bowl, lost, lost_mean, *_mosaics(materials))


def unfolded(materials: Sequence[Any]) -> tuple[list[Any], list[int]]:
    """Materials with what mosaics are made of behind each of them, and where those that were given are among them."""
    rows: list[Any] = []
    first = []
    for material in materials:
        first.append(len(rows))
        rows += [material, *material.materials] if isinstance(material, Mosaic) else [material]
    return rows, first


def _mosaics(materials: Sequence[Any]) -> tuple[Integers, Array, Integers, Integers]:
    """Numbers of the mosaics, where they lie, their shapes and their cells, see `MaterialTable`."""
    number, cells = np.full(len(materials), -1), [np.zeros(0, np.int64)]
    place: list[list[Any]] = []
    shape: list[list[int]] = []
    for k, material in enumerate(materials):
        if isinstance(material, Mosaic):
            picture = material.cells
            number[k] = len(place)
            lowest = -np.inf if material.lowest is None else material.lowest
            place.append([*material.middle, material.cell_size, lowest])
            shape.append([sum(part.size for part in cells), *picture.shape])
            cells.append(picture.ravel() + 1)
    return (
        number, np.array(place, float).reshape(-1, 4), np.array(shape, np.int64).reshape(-1, 3), np.concatenate(cells),
    )  # fmt: skip


def body_items(shapes: ShapeTable, body: int) -> Integers:
    """Numbers of the items of a body, shape (item,)."""
    triangles = np.flatnonzero(shapes.triangle_body == body) + shapes.kind.size
    return np.concatenate([np.flatnonzero(shapes.shape_body == body), triangles]).astype(np.int64)


def item_areas(shapes: ShapeTable) -> Array:
    """Area [m2] of every item, shape (item,); infinite for planes."""
    from skyscatter.kernels.surfaces import rays

    areas = np.zeros(shapes.kind.size + len(shapes.triangle))
    rays.item_areas(shapes, areas)
    return areas


def bounding_sphere(records: Sequence[Any]) -> tuple[Array, float]:
    """Middle (3,) and radius [m] of a sphere around all shapes that have an end; the origin and 0 without such."""
    boxes = [shape.bounds for shape in records]
    boxes = [box for box in boxes if np.isfinite(box).all()]
    if not boxes:
        return np.zeros(3), 0.0
    low, high = np.min([a for a, _ in boxes], axis=0), np.max([b for _, b in boxes], axis=0)
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))


def starting_stack(
    shapes: ShapeTable, position: ArrayLike, direction: ArrayLike | None = None, skip: int = -1
) -> Integers:
    """Media that a point is inside of, shape (STACK,), the last entered last, free slots -1.

    Parameters
    ----------
    shapes : ShapeTable
    position : array_like, shape (3,)
        [m]
    direction : array_like, shape (3,), optional
        Where a ray is sent to count; from a point on the item `skip` it goes to the side whose media are asked for.
    skip : int
        Item that the point lies on, or -1.

    Raises
    ------
    DomainError
        If there are more than a ray can be inside of.
    """
    from skyscatter.kernels.surfaces import rays

    # No round numbers: a ray along edges and faces is met more often than chance would have it.
    towards = np.array([0.3717, 0.2911, 0.8815]) if direction is None else np.array(direction, float)
    stack, place = np.full(codes.STACK, -1, np.int64), np.array(position, float)
    count = rays.fill_stack(shapes, place, towards / np.linalg.norm(towards), skip, stack, np.zeros(4))
    if count < 0:
        allowed = f"at most {codes.STACK} bodies with media inside may lie one in another"
        raise DomainError("position", tuple(place.tolist()), allowed)
    return stack
