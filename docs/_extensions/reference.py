"""Pages of the reference: one for every public name, one for every command.  They are made when the site is built."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)

#: The names of the package itself, in the order in which one meets them.
GROUPS: dict[str, tuple[str, ...]] = {
    "Models and scenes of the sky": (
        "load_model", "model_names", "Model", "Planet", "Scene", "Observer", "Sun", "Star", "Ground", "GroundMap",
        "sky_at", "SkyLights",
    ),
    "Matter and its optics": (
        "Medium", "Component", "Dust", "GasLines", "Particles", "SpectralTable", "register",
    ),
    "Nebulae": ("NebulaModel", "SpaceScene", "View", "PointStar", "ParallelLight", "StarField"),
    "Lamps, surfaces and fog": ("SurfaceModel", "SurfaceScene", "SurfaceMedium", "Body", "Viewpoint"),
    "Cameras": ("Panorama", "Fisheye", "Perspective", "PlanetView", "Telescope"),
    "Solvers and their options": ("Orders", "Path", "Single", "Photons"),
    "Light": ("optical_depth", "transmittance", "radiance", "Answer", "render", "solve", "RadianceField", "Fluxes",
              "CorrectionTerms"),
    "Pictures and instruments": ("SpectralImage", "SkyFrame", "observe", "FilterCurve", "FilterImage"),
    "From light back to matter": ("fit",),
}  # fmt: skip
#: The other public packages and what they are about.
PACKAGES = {
    "fields": "Densities in space",
    "surfaces": "Lamps and surfaces",
    "inversion": "Inversion",
    "dehaze": "Dehazing",
    "window": "The window",
}
#: What pydantic gives every record, which is not about light.
FOREIGN = {"BaseModel", "object", "tuple", "Enum", "IntFlag", "Flag", "int"}


def summary(value: Any) -> str:
    """First sentence of a docstring."""
    text = " ".join((inspect.getdoc(value) or "").split("\n\n")[0].split())
    return re.sub("(?<!`)`(?!`)", "``", text)


def members(value: type) -> list[str]:
    """Public methods and properties with a docstring that a class or its bases in the package define."""
    found: dict[str, None] = {}
    for base in value.__mro__:
        if base.__module__.startswith("skyscatter"):
            for name, member in list(vars(base).items()):
                plain = getattr(member, "__func__", member)
                callable_or_property = inspect.isroutine(plain) or isinstance(plain, property) or _cached(plain)
                if not name.startswith(("_", "model_")) and callable_or_property and inspect.getdoc(plain):
                    found[name] = None
    return sorted(name for name in found if not _of_pydantic(value, name))


def _cached(value: Any) -> bool:
    return type(value).__name__ == "cached_property"


def _of_pydantic(value: type, name: str) -> bool:
    decorators = getattr(value, "__pydantic_decorators__", None)
    kinds = () if decorators is None else (decorators.validators, decorators.field_validators,
                                           decorators.model_validators, decorators.field_serializers,
                                           decorators.model_serializers)  # fmt: skip
    return any(name in kind for kind in kinds)


def entry(package: str, name: str) -> str:
    """The page of one name, for autodoc."""
    value = getattr(import_module(package), name)
    title = f"{package}.{name}"
    lines = [title, "=" * len(title), "", f".. currentmodule:: {package}", ""]
    if inspect.isclass(value):
        lines += [f".. autoclass:: {name}", ""]
        for member in members(value):
            kind = "autoattribute" if _is_property(value, member) else "automethod"
            lines.append(f"   .. {kind}:: {name}.{member}")
    else:
        lines += [f".. autofunction:: {name}"]
    return "\n".join(lines) + "\n"


def _is_property(value: type, name: str) -> bool:
    member = inspect.getattr_static(value, name)
    return isinstance(member, property) or _cached(member)


def table(package: str, names: Sequence[str]) -> list[str]:
    """A table of names and what they are, each a link to its page."""
    lines = [".. toctree::", "   :hidden:", "", *(f"   {name} <{home(package, name)}>" for name in names), ""]
    lines += [".. list-table::", "   :widths: 25 75", "   :class: names", ""]
    for name in names:
        about = summary(getattr(import_module(package), name))
        lines += [f"   * - :doc:`{name} <{home(package, name)}>`", f"     - {about}"]
    return [*lines, ""]


def home(package: str, name: str) -> str:
    """The page of a name: that of the package itself, where it has the same thing."""
    top = import_module("skyscatter")
    value = getattr(import_module(package), name)
    same = name in top.__all__ and name not in PACKAGES and getattr(top, name) is value
    return f"skyscatter.{name}" if same else f"{package}.{name}"


def package_page(package: str, title: str) -> str:
    """The page of one public package."""
    module = import_module(package)
    about = (inspect.getdoc(module) or "").split("\nThe tour::")[0]
    lines = [title, "=" * len(title), "", f"``import {package}``", "", about, ""]
    if package == "skyscatter":
        left = set(module.__all__) - {"__version__", *PACKAGES}
        for group, names in GROUPS.items():
            lines += [group, "-" * len(group), "", *table(package, names)]
            left -= set(names)
        if left:
            logger.warning("reference: names without a group: %s", ", ".join(sorted(left)))
    else:
        lines += table(package, sorted(module.__all__, key=str.lower))
    return "\n".join(lines) + "\n"


def command_page(path: str, command: Any) -> str:
    """The page of one command: what it does, its arguments and options, examples."""
    shown = [p for p in command.params if not p.hidden]
    arguments = [p for p in shown if not p.opts[0].startswith("-")]
    usage = " ".join([path, *(f"[{a.name.upper()}]" for a in arguments), "[OPTIONS]"])
    told = _OPTION.sub(r"``\1``", command.help or "")
    lines = [path, "=" * len(path), "", ".. code-block:: console", "", f"   $ {usage}", "", told, ""]
    for title, chosen in (("Arguments", arguments), ("Options", [p for p in shown if p not in arguments])):
        if chosen:
            lines += [title, "-" * len(title), ""]
        for parameter in chosen:
            lines += [*_option(parameter), ""]
    if command.epilog:
        lines += ["Examples", "--------", "", "::", ""]
        lines += ["   " + line.strip() for line in command.epilog.splitlines() if line.strip().startswith("skyscatter")]
    return "\n".join(lines) + "\n"


#: An option in prose, which is not in code type already.
_OPTION = re.compile(r"(?<![`\w-])(--[a-z][a-z-]*[a-z])(?![`\w-])")


def _option(parameter: Any) -> list[str]:
    names = ", ".join(f"``{o}``" for o in [*parameter.opts, *parameter.secondary_opts])
    meta = f" *{parameter.metavar}*" if parameter.metavar else ""
    default = parameter.default
    tail = "" if default in (None, False, (), [], "") or callable(default) else f"  Default: ``{default}``."
    text = " ".join((parameter.help or "").split()).replace("*", r"\*").replace("`", "``").replace("|", r"\|")
    text = _OPTION.sub(r"``\1``", text)
    return [names + meta, f"    {text}{tail}"]


def commands() -> Iterator[tuple[str, Any]]:
    """The program's commands by their full names."""
    import typer.main

    from skyscatter.cli.main import app

    stack = [("skyscatter", typer.main.get_command(app))]
    while stack:
        path, command = stack.pop(0)
        children = getattr(command, "commands", {})
        if path != "skyscatter":
            yield path, command
        stack += [(f"{path} {name}", child) for name, child in children.items()]


def write(path: Path, text: str) -> None:
    """Write a page where it is new, so that what has not changed is not read again."""
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def make(app: Sphinx) -> None:
    """Write the pages of the reference into the folder ``api``, which git ignores."""
    folder = Path(app.srcdir) / "api"
    pages: dict[str, str] = {}
    packages = {"skyscatter": "The package", **{f"skyscatter.{name}": title for name, title in PACKAGES.items()}}
    for package, title in packages.items():
        pages[package] = package_page(package, title)
        for name in import_module(package).__all__:
            is_package = package == "skyscatter" and name in PACKAGES
            if name != "__version__" and not is_package and home(package, name) == f"{package}.{name}":
                pages[f"{package}.{name}"] = entry(package, name)
    for path, command in commands():
        pages["command-" + path.replace(" ", "-")] = command_page(path, command)
    for name, text in pages.items():
        write(folder / f"{name}.rst", text)
    for old in folder.glob("*.rst"):
        if old.stem not in pages:
            old.unlink()


def setup(app: Sphinx) -> dict[str, Any]:
    """Make the pages before anything is read."""
    app.connect("builder-inited", make)
    return {"parallel_read_safe": True, "version": "1"}
