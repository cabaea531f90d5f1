"""Models by name and from files."""

from __future__ import annotations

import os
import tomllib
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from pydantic import ValidationError

from skyscatter.datafiles import models_dir
from skyscatter.errors import ModelFileError
from skyscatter.models.kinds import fitting_kinds, misplaced
from skyscatter.problems import problem_lines
from skyscatter.record import similar
from skyscatter.registry import load_packages

if TYPE_CHECKING:
    from skyscatter.models.nebula import NebulaModel
    from skyscatter.models.sky import Model
    from skyscatter.models.surfaces import SurfaceModel


def model_names() -> list[str]:
    """Names of the models that come with skyscatter.

    Returns
    -------
    list of str
        In alphabetical order; each can be given to `load_model`.

    Examples
    --------
    >>> import skyscatter
    >>> [name for name in skyscatter.model_names() if name.startswith("earth")]
    ['earth', 'earth-hazy', 'earth-maritime', 'earth-observatory', 'earth-simple']
    """
    return sorted(path.stem for path in models_dir().glob("*.toml"))


SkyName = Literal["earth", "earth-hazy", "earth-maritime", "earth-observatory", "earth-simple", "mars", "titan"]
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

    Examples
    --------
    A shipped model, written to a file and read again.

    >>> import pathlib, tempfile
    >>> import skyscatter
    >>> mars = skyscatter.load_model("mars")
    >>> [component.name for component in mars.components]
    ['gas', 'dust']
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "mine.toml"
    ...     mars.save(path)
    ...     skyscatter.load_model(path) == mars
    True
    """
    content, path = read_model(name_or_path)
    return parse_model(anchored(content, path.parent.absolute()), path)


def read_model(name_or_path: str | Path) -> tuple[dict[str, Any], Path]:
    """What a model file says, unchecked, and where it is; errors are those of `load_model`."""
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
    return content, path


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
    load_packages()
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
    """What a file describes, by the tables that only such a file has; the others are not loaded."""
    if "viewpoint" in content or ("planet" not in content and not {"bodies", "media"}.isdisjoint(content)):
        from skyscatter.models.surfaces import SurfaceModel

        return SurfaceModel
    if "view" in content:
        from skyscatter.models.nebula import NebulaModel

        return NebulaModel
    from skyscatter.models.sky import Model

    return Model
