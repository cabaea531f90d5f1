"""Triangle meshes: from arrays or from files."""

from __future__ import annotations

from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skyscatter.errors import DomainError, MissingDataError, shortened
from skyscatter.media.arrays import ArrayField, stamp, unwritten
from skyscatter.media.shapes import axis_rotation
from skyscatter.surfaces.shapes import Array, Box, Disk, Plane, Rectangle, Sphere, Surface
from skyscatter.units import Degrees, Place, PositiveNumber, Profile, Triple, default

Integers = NDArray[np.int64]
#: Where vertices may be at most [m]: farther out, metres get lost in the rounding of their places.
FARTHEST = 1e12
#: Corners that are nearer to each other than this share of the mesh's size are one.
WELD = 1e-9
#: Formats of files, by their endings.
FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf", ".off")


class Triangles(NamedTuple):
    """A mesh where it stands in the scene."""

    corners: Array  #: (triangle, 3, 3) [m]; corners that triangles share agree to the last bit
    normals: Array  #: (triangle, 3) unit normals, to the side from which the corners run anticlockwise
    dropped: int  #: triangles without an area, left out


class Faceted(Surface):
    """What all surfaces of flat triangles share."""

    kind: str
    scale: PositiveNumber = default(1.0)
    position: Place = default((0.0, 0.0, 0.0))
    axis: Triple = default((0.0, 0.0, 1.0))
    turn_deg: Degrees = default(0.0)
    inside_out: bool = False

    @model_validator(mode="after")
    def _check_place(self) -> Self:
        if not np.linalg.norm(self.axis) > 0:
            raise DomainError("axis", self.axis, "must point somewhere: one of its numbers is not 0")
        return self

    @property
    def _name(self) -> str:
        """How errors call it."""
        return self.kind

    def _made(self) -> tuple[Array, Integers]:
        """Vertices (vertex, 3) and faces (triangle, 3), wound anticlockwise as seen from the front."""
        raise NotImplementedError

    @property
    def _raw(self) -> tuple[Array, Integers]:
        """Vertices and faces before they are put in their place."""
        vertices, faces = self._made()
        return vertices, faces[:, ::-1] if self.inside_out else faces

    @cached_property
    def _placed(self) -> tuple[Array, Integers]:
        """Vertices where they stand, each place once, and faces with three different ones."""
        vertices, faces = self._raw
        vertices, rows = weld(vertices)
        faces = rows[faces]
        a, b, c = faces.T
        placed = self.scale * vertices @ axis_rotation(self.axis, self.turn_deg).T + np.array(self.position)
        # Not "farther than": what is no number any more is too far, too.
        far = ~(np.abs(placed).max(axis=1) <= FARTHEST)
        if far.any():
            rule = f"vertices lie within {FARTHEST:g} m of the origin; check its numbers, scale and position"
            raise DomainError(self._name, placed[far][0].tolist(), rule)
        return placed, faces[(a != b) & (b != c) & (c != a)]

    @cached_property
    def triangles(self) -> Triangles:
        """The mesh as kernels see it."""
        places, faces = self._placed
        corners = places[faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(cross, axis=1)
        whole = length > 0
        dropped = len(self._raw[1]) - int(whole.sum())
        if not whole.any():
            raise DomainError(self._name, dropped, "none of its triangles has an area")
        return Triangles(corners[whole], cross[whole] / length[whole, None], dropped)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See `Surface`."""
        corners = self.triangles.corners.reshape(-1, 3)
        return corners.min(axis=0), corners.max(axis=0)

    def check_volume(self) -> None:
        """Refuse a mesh that holds no volume: open, wound both ways, or inside out.

        Raises
        ------
        DomainError
        """
        places, faces = self._placed
        name = self._name
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        forward = edges[:, 0] < edges[:, 1]
        keys = np.where(forward, edges[:, 0] * len(places) + edges[:, 1], edges[:, 1] * len(places) + edges[:, 0])
        _, place, uses = np.unique(keys, return_inverse=True, return_counts=True)
        balance = np.bincount(place, np.where(forward, 1, -1))
        single, twisted = int((uses % 2 == 1).sum()), int(((uses % 2 == 0) & (balance != 0)).sum())
        if single:
            remedy = "close them (for instance by trimesh.repair.fill_holes), or put no medium inside"
            raise DomainError(name, f"{single} open edges", f"a mesh around a medium must be closed: {remedy}")
        if twisted:
            remedy = "wind them alike (for instance by trimesh.repair.fix_winding)"
            raise DomainError(name, f"{twisted} edges between triangles wound against each other", remedy)
        corners = places[faces] - places.mean(axis=0)
        if np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) <= 0:
            raise DomainError(
                name, "inside out", "its triangles are wound clockwise as seen from outside: set inside_out = true"
            )


class Mesh(Faceted):
    """A surface of flat triangles.

    Give `vertices` and `faces`, or a `file` that trimesh can read (STL, OBJ, PLY, GLB, OFF; materials and textures in
    it are left aside).  Its front is where the corners run anticlockwise.  Corners that are nearer to each other than a
    billionth of the mesh's size are one; triangles without an area are left out.

    Parameters
    ----------
    vertices : array_like, shape (vertex, 3)
        Before `scale` [m].
    faces : array_like of int, shape (triangle, 3)
        Rows of `vertices`, counted from 0.
    file : str
        STL, OBJ, PLY, GLB or OFF; in a model file the path counts from its folder.
    scale : float
        Factor for all lengths of the file or of `vertices`: 0.001 for a file in millimetres.
    position : three lengths
        Where its origin is put [m].
    axis : three numbers
        Direction that its own z axis takes, of any length; x and y follow on the shortest way (for the opposite of z:
        about x).
    turn_deg : float
        Rotation about its own z axis before that.
    inside_out : bool
        Take the back of the triangles for their front.

    Examples
    --------
    A closed corner of a cube of 1 cm, given in centimetres, and its volume:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> mesh = surfaces.Mesh(vertices=corners, faces=[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], scale=0.01)
    >>> mesh.check_volume()  # nothing to complain about: a medium can be inside
    >>> a, b, c = np.moveaxis(mesh.triangles.corners, 1, 0)
    >>> round(float((a * np.cross(b, c)).sum()) / 6 * 1e6, 3)  # cm3
    0.167
    """

    kind: Literal["mesh"] = "mesh"
    vertices: ArrayField | None = None
    faces: ArrayField | None = None
    file: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _whole(cls, data: object) -> object:
        for name in ("vertices", "faces"):
            if isinstance(data, dict) and unwritten(data.get(name)):
                raise DomainError(name, data[name], "too large to be written with the model; save the mesh to a file")
        return data

    @model_validator(mode="after")
    def _check(self) -> Mesh:
        if (self.file is None) == (self.vertices is None) or (self.vertices is None) != (self.faces is None):
            raise DomainError("mesh", self.file, "give either a file, or vertices and faces")
        if self.vertices is not None and self.faces is not None:
            _check_arrays(self.vertices.array, self.faces.array)
        return self

    @property
    def _name(self) -> str:
        return "mesh" if self.file is None else f"mesh {self.file}"

    def _made(self) -> tuple[Array, Integers]:
        if self.file is not None:
            return _read(*stamp(self.file))
        assert self.vertices is not None
        assert self.faces is not None
        return self.vertices.array.astype(float), self.faces.array.astype(np.int64)


class Turned(Faceted):
    """A body turned on a lathe: a profile that goes once around the z axis.

    A profile that begins and ends on the axis closes the body, and with it a medium.  Its front is to the right of the
    profile's course (radius to the right, height up): from the bottom to the top it points outwards.

    Parameters
    ----------
    profile : pairs of lengths
        Radius and height [m] of the corners, one after the other, before `scale`.
    segments : int
        Flat facets on the way around; the corners lie on the round body, which is larger by 3.3 / segments^2 of its
        radius in the mean.
    scale, position, axis, turn_deg, inside_out
        See `Mesh`.

    Examples
    --------
    A glass of 6 cm across and 10 cm high, as a full cylinder; its facets leave it a little slimmer than the round one:

    >>> import numpy as np
    >>> from skyscatter import surfaces
    >>> glass = surfaces.Turned(profile=((0, 0), ("3 cm", 0), ("3 cm", "10 cm"), (0, "10 cm")), segments=64)
    >>> a, b, c = np.moveaxis(glass.triangles.corners, 1, 0)
    >>> volume = float((a * np.cross(b, c)).sum()) / 6
    >>> round(volume / (np.pi * 0.03**2 * 0.10), 4)
    0.9984
    """

    kind: Literal["turned"] = "turned"
    profile: Profile
    segments: Annotated[int, Field(ge=3, le=65536)] = 256

    @model_validator(mode="after")
    def _check(self) -> Turned:
        if len(self.profile) < 2:
            raise DomainError("profile", len(self.profile), "needs two corners at least")
        for radius, _ in self.profile:
            if radius < 0:
                raise DomainError("profile", radius, "a radius is never negative")
        return self

    def _made(self) -> tuple[Array, Integers]:
        radius, height = np.array(self.profile).T
        angle = 2 * np.pi * np.arange(self.segments) / self.segments
        around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        vertices = np.empty((len(radius), self.segments, 3))
        vertices[..., :2] = radius[:, None, None] * around
        vertices[..., 2] = height[:, None]
        here = np.arange(self.segments)
        onward = (here + 1) % self.segments
        faces = []
        for k in range(len(radius) - 1):
            low, high = k * self.segments, (k + 1) * self.segments
            # Corners on the axis fall into one: their triangles have no area and are left out.
            faces += [np.stack([low + here, low + onward, high + here], axis=-1)] if radius[k] > 0 else []
            faces += [np.stack([low + onward, high + onward, high + here], axis=-1)] if radius[k + 1] > 0 else []
        return vertices.reshape(-1, 3), np.concatenate(faces).astype(np.int64)


#: Any shape, by its kind.
Shape = Sphere | Plane | Rectangle | Box | Disk | Mesh | Turned
AnyShape = Annotated[Shape, Field(discriminator="kind")]


def weld(vertices: Array) -> tuple[Array, Integers]:
    """Vertices without repetitions, and the new row of every old one.

    Files repeat corners that triangles share, and programs compute the same corner twice with different rounding: what
    falls into one cell of a grid of `WELD` of the size is one.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = max(float((high - low).max()) * WELD, 1e-300)
    grid = np.round((vertices - low) / cell).astype(np.int64)
    # Sorting one hash is ten times faster than sorting rows; a collision would show.
    key = grid.astype(np.uint64) @ np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    _, first, rows = np.unique(key, return_index=True, return_inverse=True)
    if (grid[first[rows]] != grid).any():
        _, first, rows = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    return vertices[first], rows.reshape(-1)


def _check_arrays(vertices: NDArray[np.generic], faces: NDArray[np.generic]) -> None:
    """Refuse what is no mesh."""
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise DomainError("vertices", f"shape {vertices.shape}", "must have the shape (vertex, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise DomainError("faces", f"shape {faces.shape}", "must have the shape (triangle, 3), with at least one")
    values = vertices.astype(float)
    if not np.isfinite(values).all():
        raise DomainError("vertices", float(values[~np.isfinite(values)][0]), "must be finite numbers")
    rows = faces.astype(float)
    known = np.isfinite(rows) & (rows >= 0) & (rows < len(vertices)) & (rows == np.floor(rows))
    if not known.all():
        raise DomainError("faces", float(rows[~known][0]), f"must be whole numbers from 0 to {len(vertices) - 1}")


@lru_cache(maxsize=8)
def _read(path: str, _: int) -> tuple[Array, Integers]:
    """Vertices and faces of a file."""
    import trimesh

    if Path(path).suffix.lower() not in FORMATS:
        raise MissingDataError(path, f"not a mesh that can be read; give one of {', '.join(FORMATS)}")
    try:
        mesh = trimesh.load_mesh(path, process=False)
        vertices, faces = np.array(mesh.vertices, float), np.array(mesh.faces, np.int64)
    except Exception as error:  # trimesh's readers raise whatever their parsing meets
        raise MissingDataError(path, f"not a mesh that can be read ({shortened(str(error))})") from error
    if len(faces) == 0:
        raise MissingDataError(path, "has no triangles, or was cut short")
    _check_text(path)
    _check_arrays(vertices, faces)
    return vertices, faces


def _check_text(path: str) -> None:
    """Refuse what trimesh reads as another mesh: OBJ files that count from 0, PLY files that were cut short."""
    suffix = Path(path).suffix.lower()
    if suffix not in (".obj", ".ply"):
        return
    lines = [line.split() for line in Path(path).read_text(encoding="utf-8", errors="replace").splitlines()]
    if suffix == ".obj":
        for number, words in enumerate(lines, 1):
            for word in words[1:] if words[:1] == ["f"] else ():
                if set(word.split("/")[0]) == {"0"}:
                    rule = "OBJ files count vertices from 1, or backwards from -1"
                    raise MissingDataError(path, f"line {number}: a face names vertex 0; {rule}")
    elif ["format", "ascii", "1.0"] in lines and ["end_header"] in lines:
        end = lines.index(["end_header"])
        counts = [int(words[2]) for words in lines[:end] if words[:1] == ["element"] and words[2:][:1]]
        rows = [words for words in lines[end + 1 :] if words]
        if len(rows) < sum(counts):
            raise MissingDataError(path, f"ends after {len(rows)} of {sum(counts)} lines; it was cut short")
