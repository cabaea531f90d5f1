"""All that a model file can say: its tables, and the kinds that fit into them."""

from __future__ import annotations

from typing import Any, get_args

from skyscatter.geometry.camera import Camera
from skyscatter.media.medium import AnyOptics
from skyscatter.models.kinds import densities, kinds_of
from skyscatter.models.nebula import NebulaModel
from skyscatter.models.sky import Model
from skyscatter.models.surfaces import SurfaceModel
from skyscatter.optics.phase import AnyPhase
from skyscatter.record import Record
from skyscatter.surfaces.lamps import AnyLamp
from skyscatter.surfaces.lobes import AnyLobe
from skyscatter.surfaces.materials import AnyMaterial
from skyscatter.surfaces.meshes import AnyShape
from skyscatter.surfaces.townmap import AnyTown


def sorts() -> dict[str, type[Record]]:
    """Classes of the models by the command that renders them."""
    return {"sky": Model, "nebula": NebulaModel, "render": SurfaceModel}


def groups() -> dict[str, dict[str, type[Record]]]:
    """All kinds, by what they serve."""
    unions = {
        "optics": AnyOptics, "phase functions": AnyPhase, "lamps": AnyLamp, "lobes": AnyLobe,
        "materials": AnyMaterial, "shapes": AnyShape, "cameras": Camera, "towns": AnyTown,
    }  # fmt: skip
    fields = {"densities of skies": densities("sky"), "densities in space": densities("render")}
    return fields | {title: kinds_of(union) for title, union in unions.items()}


def tables() -> list[type[Record]]:
    """Records without a kind that models are made of, in the order in which they are met."""
    named = [record for kinds in groups().values() for record in kinds.values()]
    found: list[type[Record]] = []
    waiting: list[type[Record]] = [*sorts().values(), *named]
    while waiting:
        for record in (one for info in waiting.pop(0).model_fields.values() for one in records_in(info.annotation)):
            if record not in found and "kind" not in record.model_fields:
                found.append(record)
                waiting.append(record)
    return found


def records_in(annotation: Any) -> list[type[Record]]:
    """Records that a field of this type holds."""
    if isinstance(annotation, type) and issubclass(annotation, Record):
        return [annotation]
    return [one for part in get_args(annotation) for one in records_in(part)]
