"""What a page asks about a sky: its table, the spectrum in a direction, where the Sun stands, and the command."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skyscatter.window.asked import number, one_of, optional, whole
from skyscatter.window.command import Shown, sky_command
from skyscatter.window.work import Message, Told

if TYPE_CHECKING:
    from skyscatter.solvers.field import RadianceField
    from skyscatter.window.table import SkySettings

#: Wavelengths of pictures and spectra [nm], those of `skyscatter sky`.
WAVELENGTHS = np.arange(380.0, 781.0, 10.0)
#: Relative accuracy that the spectra aim at, that of `skyscatter sky`.
TOLERANCE = 5e-3
#: How far the amounts of haze and ozone may be changed, as factors, and how high the observer may stand [m].
MOST, HIGHEST = 10.0, 4.0e5
#: Largest picture of a command [pixel].
MOST_PIXELS = 8192


class Skies:
    """Answers about skies of some models.

    Parameters
    ----------
    models : callable
        Gives names or files of the models that may be asked for.
    """

    def __init__(self, models: Callable[[], tuple[str, ...]]) -> None:
        self._models = models
        self._solved: tuple[Any, RadianceField] | None = None

    def settings(self, question: Message) -> SkySettings:
        """The settings of a question."""
        from skyscatter.window.table import SkySettings

        return SkySettings(
            model=one_of(question, "model", self._models()),
            haze=number(question, "haze", 0.0, MOST, 1.0),
            ozone=number(question, "ozone", 0.0, MOST, 1.0),
            ground=optional(question, "ground", 0.0, 1.0),
            altitude_m=number(question, "altitude", 0.0, HIGHEST, 2.0),
        )

    def table(self, question: Message, told: Told) -> Iterator[tuple[Message, bytes]]:
        """Tables of the sky: a coarse one at once, then the good one."""
        from skyscatter.window.table import GOOD, QUICK, make_table

        settings = self.settings(question)
        for quick, words in ((True, "a coarse solution"), (False, "the solution")):
            told(0.0, words)
            table = make_table(settings, progress=partial(_told, told, words), quick=quick)
            tolerance = (QUICK if quick else GOOD).tolerance
            yield {"what": "table", "quick": quick, "tolerance": tolerance}, table.to_bytes()

    def point(self, question: Message, told: Told) -> Iterator[tuple[Message, None]]:
        """The spectrum in a direction, by the solver, with its estimated error."""
        from skyscatter.geometry.vectors import direction_from_azimuth_elevation
        from skyscatter.image.colour import spectrum_to_xyz

        settings = self.settings(question)
        sun = number(question, "sunElevation", -90.0, 90.0), number(question, "sunAzimuth", -360.0, 360.0)
        look = number(question, "azimuth", -360.0, 360.0), number(question, "elevation", -90.0, 90.0)
        field = self._field(settings, sun[0], told)
        position = settings.scene().observer.position
        answer = field.radiance(
            position, direction_from_azimuth_elevation(*look), sun_elevation_deg=sun[0], sun_azimuth_deg=sun[1]
        )
        yield {
            "what": "spectrum",
            "wavelengths": WAVELENGTHS.tolist(),
            "radiance": answer.radiance.tolist(),
            "error": answer.standard_error.tolist(),
            "kind": "estimated error",
            "xyz": spectrum_to_xyz(answer.radiance, WAVELENGTHS).tolist(),
        }, None

    def _field(self, settings: SkySettings, elevation: float, told: Told) -> RadianceField:
        """The solution for one Sun; the last one is kept, for the pointer goes on over the same sky."""
        from skyscatter.solvers.field import solve

        key = settings, elevation
        if self._solved is None or self._solved[0] != key:
            told(0.0, "the spectrum")
            field = solve(
                settings.scene(),
                WAVELENGTHS,
                sun_elevations_deg=(elevation, elevation),
                tolerance=TOLERANCE,
                progress=partial(_told, told, "the spectrum"),
            )
            self._solved = key, field
        return self._solved[1]

    def sun(self, question: Message, told: Told) -> Iterator[tuple[Message, None]]:
        """Where the Sun stands for a place and a time."""
        from skyscatter.models.files import load_model
        from skyscatter.models.sky import Model

        model = load_model(one_of(question, "model", self._models()))
        latitude, longitude = number(question, "latitude", -90.0, 90.0), number(question, "longitude", -360.0, 360.0)
        assert isinstance(model, Model)  # the models of skies are
        altitude = number(question, "altitude", 0, HIGHEST)
        scene = model.scene_at(latitude, longitude, str(question.get("time")), altitude, ("sun",))
        yield {"what": "sun", "elevation": scene.sun.elevation_deg, "azimuth": scene.sun.azimuth_deg}, None

    def command(self, question: Message, told: Told) -> Iterator[tuple[Message, None]]:
        """The command that makes the picture, and the model file that it needs, if any."""
        shown = Shown(
            sun_elevation=number(question, "sunElevation", -90.0, 90.0),
            sun_azimuth=number(question, "sunAzimuth", -360.0, 360.0),
            view=str(question.get("view")),
            size=(whole(question, "width", 1, MOST_PIXELS), whole(question, "height", 1, MOST_PIXELS)),
            exposure=optional(question, "exposure", -30.0, 30.0),
        )
        words, file = sky_command(self.settings(question), shown)
        saved = {} if file is None else {"file": file[0], "text": file[1]}
        yield {"what": "command", "command": words, **saved}, None


def _told(told: Told, words: str, share: float) -> None:
    """How far a solver is, with the words for what it does."""
    told(share, words)


def base_name(model: str) -> str:
    """The name of a model, or that of its file without the ending."""
    return Path(model).stem
