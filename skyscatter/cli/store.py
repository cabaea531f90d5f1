"""``skyscatter store``: what is in the folders that --store makes, whether it is whole, and pictures from it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from skyscatter.cli import common, parse
from skyscatter.cli.examples import epilog
from skyscatter.errors import DomainError

app = typer.Typer(
    help="List, verify and export the folders that --store keeps runs in.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder that --store was given.")]


@app.command("list", epilog=epilog("store list"))
def list_(folder: Folder, as_json: common.AsJson = False) -> None:
    """Say what a store holds, and how much of it is finished."""
    from skyscatter.solvers.stored import PICTURES, opened_again

    with opened_again(folder, None) as store:
        recipe, sort = store.attributes["recipe"], store.attributes["sort"]
        summary = {
            "store": str(folder),
            "sort": sort,
            "skyscatter": recipe.get("skyscatter"),
            "interrupted": "block" in store.attributes or sort == "fit",
            "parts": store.parts(),
            "bytes": sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()),
        }
        if sort in PICTURES:
            amounts = [found[0] for found in (store.get(k, 1) for k in store.numbers()) if found is not None]
            summary |= {
                "solver": recipe["solver"],
                "options": recipe["options"],
                "camera": recipe["camera"],
                "wavelengths": len(recipe["wavelengths_nm"]),
                "tasks": store.tasks(),
                "finished": len(amounts),
                "amount": [min(amounts), max(amounts)] if amounts else None,
            }
        elif sort == "frames":
            summary |= {"camera": recipe["camera"], "tasks": store.attributes["frames"]}
            summary |= {"finished": len(_frames(store))}
    typer.echo(json.dumps(summary) if as_json else describe(summary))


def _frames(store: Any) -> list[int]:
    """Numbers of the frames that a store has."""
    from skyscatter.solvers.sequence import part_of

    parts = set(store.parts())
    return [k for k in range(store.attributes["frames"]) if part_of(k) in parts]


def describe(summary: dict[str, Any]) -> str:
    """A summary for people."""
    from skyscatter.memory import format_bytes

    interrupted = "an interrupted run, " * summary["interrupted"]
    by = f"{format_bytes(summary['bytes'])}, by skyscatter {summary['skyscatter']}"
    if "camera" not in summary:
        parts = ", ".join(summary["parts"]) or "none"
        return f"{summary['store']}: {interrupted}{summary['sort']}; parts: {parts}; {by}"
    camera, total = summary["camera"], summary["tasks"] or "an unknown number of"
    size = f"{summary['store']}: {interrupted}{camera['width']}x{camera['height']} pixels"
    if summary["sort"] == "frames":
        return f"{size}; {summary['finished']} of {total} frames finished; {by}"
    amount = summary["amount"]
    blocks = summary["interrupted"] and summary["solver"] != "photons"
    what = "pixels in each task" if blocks else "walks or passes in each batch"
    more = f", {amount[0]} to {amount[1]} {what}" if amount and amount[1] > 1 else ""
    return (
        f"{size}, {summary['wavelengths']} wavelengths, "
        f"solver {summary['solver']}; {summary['finished']} of {total} tasks finished{more}; {by}"
    )


@app.command("verify", epilog=epilog("store verify"))
def verify(
    folder: Folder,
    repair: Annotated[bool, typer.Option("--repair", help="Remove what is damaged; a run does it again.")] = False,
) -> None:
    """Read every part and compare its checksum and its key; exit status 2 where one is damaged."""
    from skyscatter.solvers.stored import opened_again
    from skyscatter.tasks.store import damaged

    with opened_again(folder, None) as store:
        count, broken = len(store.numbers()) + len(store.parts()), list(damaged(store))
        for task, reason in broken:
            typer.echo(f"{'part' if isinstance(task, str) else 'task'} {task}: {reason}")
            if repair:
                store.remove(task)
    typer.echo(f"{folder}: {count - len(broken)} of {count} finished tasks and parts are whole")
    if broken and not repair:
        rule = "is damaged; repair it with: skyscatter store verify --repair, and repeat the run"
        raise DomainError("store", str(folder), rule)


@app.command("export", epilog=epilog("store export"))
def export(
    folder: Folder,
    output: common.Output = None,
    exposure: common.Exposure = None,
    bits: common.Bits = None,
    no_clobber: common.NoClobber = False,
) -> None:
    """Write the picture of a store, finished or not, to files; one larger than memory strip by strip.

    Frames of a sequence go to numbered files of the kind that they were made for.
    """
    from skyscatter.solvers.render import picture_of
    from skyscatter.tasks.store import read_attributes

    outputs = parse.check_outputs(output or [], no_clobber)
    if not outputs:
        raise DomainError("output", None, "give at least one file: -o picture.png")
    common.check_png_options(outputs, {"exposure": exposure, "bits": bits})
    if read_attributes(folder).get("sort") == "frames":
        _export_frames(folder, outputs, {"exposure": exposure, "bits": bits})
        return
    if not _fits(folder):
        from skyscatter.image.strips import check_options
        from skyscatter.solvers.large import StoredPicture

        picture = StoredPicture(folder)
        for path in outputs:
            check_options(path, {})
        for path in outputs:
            picture.save(path)
        typer.echo(f"wrote {', '.join(map(str, outputs))}", err=True)
        return
    image = picture_of(folder)
    for path in outputs:
        png = path.suffix.lower() == ".png"
        given = {"exposure": "auto" if exposure is None else parse.parse_exposure(exposure)} if png else {}
        depth = parse.parse_integer(bits, "bits", 8, "choose 8 or 16") if png else None
        image.save(path, **given, **({"bits": depth} if depth else {}))
    typer.echo(f"wrote {', '.join(map(str, outputs))}", err=True)


def _export_frames(folder: Path, outputs: list[Path], options: dict[str, Any]) -> None:
    """Write the frames of a store to numbered files."""
    from skyscatter.cli.framefiles import numbered, write
    from skyscatter.solvers.sequence import part_of
    from skyscatter.solvers.stored import opened_again

    for name, value in options.items():
        if value is not None:
            raise DomainError(name, value, "was settled when the frames were made; leave it out")
    with opened_again(folder, ("frames",)) as store:
        suffix, finished = store.attributes["suffix"], _frames(store)
        for output in outputs:
            if output.suffix.lower() != suffix:
                rule = f"its frames are {suffix} files; name one, or repeat the command"
                raise DomainError("output", str(output), rule)
            paths = numbered(output, store.attributes["frames"])
            for k in finished:
                write(paths[k], {name: file.tobytes() for name, file in store.kept(part_of(k)).items()})
    typer.echo(f"wrote {len(finished)} frames", err=True)


def _fits(folder: Path) -> bool:
    """Whether memory holds the picture of a store."""
    from skyscatter.memory import available_bytes, picture_bytes
    from skyscatter.tasks.store import read_attributes

    recipe = read_attributes(folder)["recipe"]
    camera, options = recipe["camera"], recipe["options"]
    layers = options.get("orders", 0) + 4 * bool(options.get("parts")) + 6 * bool(options.get("stokes"))
    needed = picture_bytes(camera["width"], camera["height"], len(recipe["wavelengths_nm"]), layers)
    there = available_bytes()
    return there is None or needed <= there
