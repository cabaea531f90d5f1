"""From slopes of voxels to those of what lies behind them: parameters of phase functions, particles, analytic fields.

`VoxelModel.gradient` returns the derivative of a number with respect to every voxel.  Densities that are a linear map
of weights (particles spread over cells, coarse grids) or a function of a few parameters need the transpose of
that map, or the sum over voxels of the derivative times that of the field.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyscatter.errors import DomainError
from skyscatter.inversion.voxelscene import VoxelFrame

Array = NDArray[np.float64]

#: Relative step of central differences of analytic fields: the cube root of the rounding error.
FIELD_STEP = 6e-6


def through_map(slope: ArrayLike, linear: Any) -> Array:
    """Derivatives with respect to weights whose linear map is the density.

    Parameters
    ----------
    slope : array_like, shape (x, y, z)
        With respect to the density of one component.
    linear : scipy sparse matrix, array or LinearOperator, shape (voxel, weight)
        Voxels in the order of ``density.ravel()``.

    Returns
    -------
    ndarray, shape (weight,)

    Raises
    ------
    DomainError
        If the matrix does not have as many rows as there are voxels.

    Examples
    --------
    A number that grows by 3 with the density of every cell grows by 3 over the volume of a cell with the weight of a
    particle.

    >>> import numpy as np
    >>> from skyscatter.inversion import VoxelFrame, spreading_map, through_map
    >>> frame = VoxelFrame.cube(4, 1.0)
    >>> spread = spreading_map(frame, [[0.1, 0.2, 0.0], [-0.3, 0.0, 0.4]])
    >>> through_map(np.full(frame.shape, 3.0), spread) * frame.volume
    array([3., 3.])
    """
    flat = np.asarray(slope, float).ravel()
    if linear.shape[0] != flat.size:
        raise DomainError("linear", linear.shape, f"needs a row for each of {flat.size} voxels")
    return np.asarray(linear.T @ flat, float).ravel()


def spreading_map(frame: VoxelFrame, positions: ArrayLike) -> Any:
    """Sparse matrix (voxel, particle) that spreads particles of weight 1 over the eight nearest cells.

    A particle's mass is kept: the sum of a column times the volume of a cell is 1, less what falls outside the grid.

    Parameters
    ----------
    frame : VoxelFrame
    positions : array_like, shape (particle, 3)
        [m]

    Returns
    -------
    scipy.sparse.csr_matrix, shape (voxel, particle)
        [m-3]; voxels in the order of ``density.ravel()``.

    Raises
    ------
    DomainError
        If the positions have another shape.

    Examples
    --------
    A particle in the middle of the box is shared by eight cells, one in the middle of a cell is its alone.

    >>> from skyscatter.inversion import VoxelFrame, spreading_map
    >>> frame = VoxelFrame.cube(4, 2.0)  # cells of 1 m3
    >>> spread = spreading_map(frame, [[0, 0, 0], [0.5, 0.5, 0.5]])
    >>> spread.shape
    (64, 2)
    >>> spread.max(axis=0).toarray().tolist()
    [[0.125, 1.0]]
    """
    from scipy.sparse import csr_matrix

    places = np.asarray(positions, float)
    if places.ndim != 2 or places.shape[1] != 3:
        raise DomainError("positions", places.shape, "needs the shape (particle, 3)")
    u = (places - np.array(frame.low)) / frame.cell - 0.5
    first = np.floor(u).astype(int)
    rows, columns, values = [], [], []
    for corner in np.ndindex(2, 2, 2):
        index = first + corner
        share = np.prod(np.where(np.array(corner), u - first, 1 - (u - first)), axis=1)
        inside = np.all((index >= 0) & (index < frame.shape), axis=1)
        rows.append(np.ravel_multi_index(tuple(index[inside].T), frame.shape))
        columns.append(np.flatnonzero(inside))
        values.append(share[inside] / frame.volume)
    size = (int(np.prod(frame.shape)), len(places))
    return csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=size)


def through_parameters(
    slope: ArrayLike, density: Callable[..., ArrayLike], parameters: Mapping[str, float], **scales: float
) -> dict[str, float]:
    """Derivatives with respect to the parameters of an analytic density, by the chain rule over the voxels.

    Parameters
    ----------
    slope : array_like, shape (x, y, z)
        With respect to the density of one component.
    density : callable
        ``density(**parameters)``: the densities of the cells (x, y, z).
    parameters : mapping of str to float
        Where the derivatives are wanted; the density is differentiated by central differences.
    **scales : float
        How far a parameter moves before the density changes much, where its own value does not tell (1 for one that is
        zero).

    Returns
    -------
    dict of str to float
        By the names of the parameters.

    Examples
    --------
    The integral of a Gaussian of the width w is (2 pi)^(3/2) w^3, whose derivative is 3 (2 pi)^(3/2) w^2.

    >>> import numpy as np
    >>> from skyscatter.inversion import VoxelFrame, through_parameters
    >>> frame = VoxelFrame.cube(32, 6.0)
    >>> square = (frame.middles() ** 2).sum(axis=-1)
    >>> slope = np.full(frame.shape, frame.volume)  # of the integral
    >>> found = through_parameters(slope, lambda width: np.exp(-square / (2 * width**2)), {"width": 1.0})
    >>> round(found["width"], 2), round(3 * (2 * np.pi) ** 1.5, 2)
    (47.25, 47.25)
    """
    weights, found = np.asarray(slope, float), {}
    for name, value in parameters.items():
        h = FIELD_STEP * (scales.get(name) or abs(value) or 1.0)
        high, low = (np.asarray(density(**{**parameters, name: value + sign * h}), float) for sign in (1, -1))
        found[name] = float(np.sum(weights * (high - low)) / (2 * h))
    return found
