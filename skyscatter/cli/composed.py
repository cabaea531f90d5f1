"""The view and the size of a sky's picture where the command line leaves them open."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skyscatter.cli import parse

if TYPE_CHECKING:
    from skyscatter.cli.sky import Request

#: Height of an observer whose view and height are not stated: from a mountain the ground has distance and haze.
DEFAULT_ALTITUDE = "1km"
#: Size of a landscape by random walks, and of polarised light, which cost a hundred times more a pixel [pixel].
COSTLY_SIZE = (480, 180)


def composed(request: Request, observer: Any, sun_azimuth_deg: float, around: bool = False) -> tuple[Request, Any]:
    """The request with its view and size settled, and the camera.

    Parameters
    ----------
    request : Request
        Without a view it gets the one that suits the observer, and without a size one that the solver is fit for.
    observer : Observer
    sun_azimuth_deg : float
        Azimuth [degree] of the Sun, the middle of landscapes and panoramas.
    around : bool
        Whether a landscape that was not asked for shows the whole horizon: the Sun goes along it.

    Returns
    -------
    request : Request
    camera : Camera
    """
    from skyscatter.geometry.camera import camera_from_view, suitable_view

    view = suitable_view(observer) if request.view is None else request.view
    size = request.size
    if size == (0, 0):
        costly = request.solver != "orders" or request.stokes
        size = COSTLY_SIZE if costly and view == "landscape" else parse.parse_size(None, view)
    if around and request.view is None and view == "landscape":
        view = f"landscape:{sun_azimuth_deg:.6g},360"
    camera = camera_from_view(view, *size, sun_azimuth_deg=sun_azimuth_deg, observer=observer)
    return replace(request, view=view, size=size), camera
