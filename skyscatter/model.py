"""Model files: a planet with its air, its ground and its star, as TOML."""

from __future__ import annotations

import os
import tomllib
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, overload

from pydantic import ValidationError, model_validator

from skyscatter.atomic import atomic_path
from skyscatter.datafiles import models_dir
from skyscatter.errors import DomainError, ModelFileError
from skyscatter.ground import Ground
from skyscatter.kinds import fitting_kinds, misplaced
from skyscatter.media.arrays import unwritten
from skyscatter.media.medium import Component, Medium
from skyscatter.problems import problem_lines
from skyscatter.record import Record, similar
from skyscatter.scene import Scene, Site, Star, Sun
from skyscatter.units import PositiveMetres

if TYPE_CHECKING:
    from skyscatter.nebula import NebulaModel
    from skyscatter.surfaces.model import SurfaceModel


class Planet(Record):
    """A sphere.

    Parameters
    ----------
    name : str
        How it is called.
    radius : length
        [m].
    """

    name: str
    radius: PositiveMetres


class Model(Record):
    """What a model file says; `scene` puts an observer and a Sun into it.

    Parameters
    ----------
    name : str
        How the model is called.
    description : str
        What it is, in a sentence.
    sources : tuple of str
        Where the numbers come from.
    planet : Planet
        The sphere that carries the air.
    ground : Ground
        Its surface; black when not given.
    star : Star
        Its light; the Sun when not given.
    components : tuple of Component
        The atmosphere.
    """

    command: ClassVar[str] = "sky"  #: of the command line, which renders it

    name: str
    description: str = ""
    sources: tuple[str, ...] = ()
    planet: Planet
    ground: Ground = Ground()
    star: Star = Star()
    components: tuple[Component, ...]

    @model_validator(mode="after")
    def _check(self) -> Model:
        _ = self.medium
        return self

    @property
    def medium(self) -> Medium:
        """The atmosphere around the planet."""
        return Medium(components=self.components, planet_radius=self.planet.radius)

    @property
    def top(self) -> float:
        """Altitude of the top of the atmosphere [m]."""
        return self.medium.top

    def scene(
        self,
        sun_elevation_deg: float = 30.0,
        sun_azimuth_deg: float = 180.0,
        sun_distance_au: float | None = None,
        altitude: Any = 0.0,
    ) -> Scene:
        """A scene with the Sun at an elevation and azimuth [degree] and the observer at an altitude [m]."""
        sun = Sun(elevation_deg=sun_elevation_deg, azimuth_deg=sun_azimuth_deg, distance_au=sun_distance_au)
        return Scene(medium=self.medium, ground=self.ground, star=self.star, sun=sun, altitude=altitude)

    def scene_at(self, latitude_deg: float, longitude_deg: float, time: Any, altitude: Any = 0.0) -> Scene:
        """A scene for a place on Earth [degree] and a time (ISO 8601 text, UTC; or a datetime)."""
        from skyscatter.geometry.sun import iso_utc, sun_position

        scene = self.scene(altitude=altitude)
        sun = sun_position(latitude_deg, longitude_deg, time, scene.altitude)
        site = Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg, time=iso_utc(time))
        return scene.model_copy(update={"sun": Sun(**sun._asdict(), site=site)})

    def to_toml(self) -> str:
        """The model as TOML text, which `load_model` reads back to an equal model."""
        return to_toml(self)

    def save(self, path: str | Path) -> None:
        """Write the model file; an existing one is replaced only when the new one is complete."""
        with atomic_path(path) as temporary:
            temporary.write_text(self.to_toml(), encoding="utf-8")


def model_names() -> list[str]:
    """Names of the models that come with skyscatter."""
    return sorted(path.stem for path in models_dir().glob("*.toml"))


SkyName = Literal["earth", "earth-hazy", "earth-maritime", "earth-simple", "mars", "titan"]
NebulaName = Literal[
    "dark-globule",
    "dusty-disk",
    "hii-region",
    "reflection-nebula",
    "ring-nebula",
    "star-in-dust",
    "turbulent-pillar",
]
SurfaceName = Literal["city-skyglow", "fog-room", "light-guide", "milk-and-water", "searchlight"]


@overload
def load_model(name_or_path: SkyName) -> Model: ...
@overload
def load_model(name_or_path: NebulaName) -> NebulaModel: ...
@overload
def load_model(name_or_path: SurfaceName) -> SurfaceModel: ...
@overload
def load_model(name_or_path: str | Path) -> Model | NebulaModel | SurfaceModel: ...


def load_model(name_or_path: str | Path) -> Model | NebulaModel | SurfaceModel:
    """Read a model by the name of a shipped one or from a TOML file.

    Returns
    -------
    Model, NebulaModel or SurfaceModel
        A planet with its air, or, where the file has a table ``view``, a nebula, or, where it has a table
        ``viewpoint``, a scene of surfaces.  A type checker knows which one a shipped name gives; of a file's model
        ask ``isinstance(model, skyscatter.NebulaModel)``.

    Raises
    ------
    ModelFileError
        If there is no such model, the file is not TOML, or fields are missing, unknown or out of range; a line for
        each names the field, the value and what would be accepted.
    """
    text = str(name_or_path)
    path = Path(text)
    if not path.suffix and not os.path.isfile(path):
        path = models_dir() / f"{text}.toml"
        if not os.path.isfile(path):  # unlike Path.is_file, also for names that no file can have
            meant = similar(text, model_names())
            hint = f"did you mean {meant}? " if meant else ""
            rule = f"no such model; {hint}choose from {', '.join(model_names())}, or give a .toml file"
            raise ModelFileError(text, rule)
    try:
        with open(path, "rb") as file:
            content = tomllib.load(file)
    except OSError as error:
        raise ModelFileError(path, f"cannot be read ({error.strerror or error}); check the path") from error
    except RecursionError as error:
        raise ModelFileError(path, "its brackets are nested too deep; no field needs that") from error
    except ValueError as error:  # of TOML, of UTF-8, or a name with a NUL in it
        raise ModelFileError(path, f"is not TOML: {error}") from error
    return parse_model(anchored(content, path.parent.absolute()), path)


def anchored(content: Any, folder: Path) -> Any:
    """The content of a model file in which the names of other files count from its folder."""
    if isinstance(content, list):
        return [anchored(part, folder) for part in content]
    if not isinstance(content, dict):
        return content
    return {
        name: str(folder / value) if name == "file" and isinstance(value, str) else anchored(value, folder)
        for name, value in content.items()
    }


def parse_model(content: dict[str, Any], source: object) -> Model | NebulaModel | SurfaceModel:
    """Build a `Model`, a `NebulaModel` or a `SurfaceModel` from the content of a file; `source` is named in errors."""
    sort = sort_of(content)
    try:
        return sort.model_validate(content)
    except ValidationError as error:
        command = sort.command
        lines = problem_lines(error, content, partial(fitting_kinds, command))
        wrong = misplaced(command, content)
        # That a medium has one sort of fields follows from what is misplaced.
        lines = [line for line in lines if not (wrong and line.startswith("density = "))]
        raise ModelFileError(source, *wrong, *lines) from error


def sort_of(content: dict[str, Any]) -> type[Model] | type[NebulaModel] | type[SurfaceModel]:
    """What a file describes, by the tables that only such a file has."""
    if not {"viewpoint", "bodies", "media"}.isdisjoint(content):
        from skyscatter.surfaces.model import SurfaceModel

        return SurfaceModel
    if "view" in content:
        from skyscatter.nebula import NebulaModel

        return NebulaModel
    return Model


#: Fields that are written as tables of their own, one after the other.
_LISTS = ("components", "media", "bodies", "lamps")


def to_toml(model: Record) -> str:
    """TOML text of plain values, tables and lists of tables.

    Raises
    ------
    DomainError
        If the model holds an array that is too large to be written out.
    """
    content = model.model_dump(mode="json", exclude_none=True)
    plain = {k: v for k, v in content.items() if not isinstance(v, dict) and k not in _LISTS}
    lines = [f"{key} = {_value(value)}" for key, value in plain.items()]
    for key, value in content.items():
        if isinstance(value, dict):
            lines += ["", f"[{key}]", *(f"{k} = {_value(v)}" for k, v in value.items())]
    for name in _LISTS:
        for table in content.get(name, ()):
            lines += ["", f"[[{name}]]", *(f"{k} = {_value(v)}" for k, v in table.items())]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if unwritten(value):
        rule = "too large for a model file; write it with numpy.save and name that in the field `file`"
        raise DomainError("values", value, rule)
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    return repr(value)
