"""The window in a notebook."""

from __future__ import annotations

from typing import Any

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.window.bundle import markup, widget_module
from skyscatter.window.pagefiles import asset_text
from skyscatter.window.questions import Questions
from skyscatter.window.work import Message, Work

try:
    import anywidget
    import traitlets
except ImportError as error:
    raise SkyscatterError("window: widgets need anywidget: pip install anywidget") from error

#: What can be set at first, and how the page calls it.
NAMES = {
    "sun_elevation_deg": "sunElevation", "sun_azimuth_deg": "sunAzimuth", "haze": "haze", "ozone": "ozone",
    "altitude_m": "altitude", "view": "view", "view_azimuth_deg": "viewAzimuth", "view_elevation_deg": "viewElevation",
    "fov_deg": "fov", "inclination_deg": "inclination", "azimuth_deg": "turn",
}  # fmt: skip


class SkyWidget(anywidget.AnyWidget):
    """The window in a notebook: a sky that is drawn at once and solved behind, or a nebula that is traced.

    It is the page of ``skyscatter view``, and the kernel of the notebook is the solver behind it.  Needs anywidget.

    Parameters
    ----------
    model : str
        Name of a shipped model of a sky or a nebula, or a TOML file.
    height : int
        Of the window [pixel].
    ground : float, optional
        Grey albedo of the ground, 0 to 1, in place of the model's.
    exposure : float or "auto"
        Exposure value at ISO 100.
    **shown : float or str
        What is shown at first: of a sky ``sun_elevation_deg``, ``sun_azimuth_deg``, ``haze`` and ``ozone`` (factors on
        what the model has), ``altitude_m`` [m], ``view`` (landscape, panorama, fisheye or perspective),
        ``view_azimuth_deg``, ``view_elevation_deg`` and ``fov_deg``; of a nebula ``inclination_deg`` and
        ``azimuth_deg``.

    Attributes
    ----------
    state : dict
        What is shown, by the names of the page; it follows what the user sets, and setting it changes the page.

    Raises
    ------
    SkyscatterError
        Without anywidget, for models that have no window, and for what cannot be shown.

    Examples
    --------
    >>> from skyscatter.window import SkyWidget
    >>> widget = SkyWidget("mars", sun_elevation_deg=5, haze=2)
    >>> widget.state["sunElevation"], widget.state["haze"]
    (5, 2)
    """

    _esm = widget_module()
    _css = asset_text("window.css")
    _markup = traitlets.Unicode(markup()).tag(sync=True)
    _height = traitlets.Int(560).tag(sync=True)
    state = traitlets.Dict().tag(sync=True)
    #: None until there is something to work on.
    _work: Work | None = None

    def __init__(
        self, model: str = "earth", height: int = 560, ground: float | None = None, exposure: Any = "auto", **shown: Any
    ) -> None:
        state: dict[str, Any] = {"model": model}
        for name, value in shown.items():
            if name not in NAMES:
                raise DomainError(name, value, f"cannot be shown; choose from {', '.join(NAMES)}")
            state[NAMES[name]] = value
        state |= {} if ground is None else {"ground": ground, "ownGround": False}
        state |= {} if exposure == "auto" else {"exposure": exposure, "autoExposure": False}
        work = Questions(model).work(self._tell)
        super().__init__(state=state, _height=height)
        self._work = work
        self.on_msg(self._heard)

    def _heard(self, widget: Any, content: Message, buffers: Any) -> None:
        """A question of the page, or that it wants no answer any more."""
        if self._work is None:
            return
        if content.get("kind") == "drop":
            self._work.drop(str(content.get("drop")))
            return
        try:
            self._work.ask(content)
        except SkyscatterError as error:
            self._tell({"number": content.get("number"), "what": "error", "words": str(error)})

    def _tell(self, message: Message, data: bytes | None = None) -> None:
        self.send(message, None if data is None else [data])

    def close(self) -> None:
        """Take the window away; its work ends."""
        if self._work is not None:
            self._work.close()
        super().close()
