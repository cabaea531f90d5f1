"""``skyscatter warm``: compiles what commands will need, before they need it."""

from __future__ import annotations

import os
import time
from enum import StrEnum
from typing import Annotated

import typer

from skyscatter.cli import common, parse
from skyscatter.cli.info import kernel_cache
from skyscatter.errors import DomainError
from skyscatter.kernels import ahead, crew, forms
from skyscatter.kernels.forms import Form
from skyscatter.kernels.processors import processors
from skyscatter.progress import Progress, format_seconds


class What(StrEnum):
    """What to compile for."""

    sky = "sky"
    nebula = "nebula"
    render = "render"
    dehaze = "dehaze"
    invert = "invert"
    all = "all"


#: Families of forms by command; what is in none of them, such as a library's users call, is compiled with all.
FAMILIES = {
    What.sky: ("orders", "path", "single", "world"),
    What.nebula: ("volume_path", "volume_single"),
    What.render: ("surface_path", "photons"),
    What.dehaze: ("dehaze",),
    What.invert: ("orders", "inversion"),
}


def wanted(what: What) -> list[Form]:
    """The forms for a command, those first that commands call last: these are the large ones."""
    if what is What.all:
        return forms.every()
    listed = forms.listed()
    return list(dict.fromkeys(form for family in FAMILIES[what] for form in reversed(listed.get(family, ()))))


def warm(
    what: Annotated[What, typer.Argument(help="The command to compile for.")] = What.all,
    threads: common.Threads = None,
    quiet: common.Quiet = False,
    progress: common.ProgressMode = "auto",
) -> None:
    """Compile what a command needs, into the cache, so that its first run need not.

    For images of containers and for clusters.  Where machine code came with the installation there is nothing to do.
    """
    mode = common.talk(quiet, False, progress)
    size = parse.parse_integer(threads, "threads", 1, "give a number of threads, 1 or more") or processors()
    run(what, size, mode)


def run(what: What, size: int, mode: str) -> None:
    """Compile by so many processes."""
    missing = [form for form in wanted(what) if ahead.find(form.entry, form.kinds) is None]
    if not missing:
        typer.echo("nothing to compile: machine code came with the installation")
        return
    if crew.HELPER in os.environ:
        raise DomainError(crew.HELPER, os.environ[crew.HELPER], "unset it: it keeps a process from calling helpers")
    _check_cache(missing[0])
    began = time.monotonic()
    with Progress(len(missing), f"compiling for {what.value}", mode) as shown:
        failed = crew.compile_all(missing, size, lambda form: shown.update())
    if failed:
        raise RuntimeError(f"{len(failed)} kernels were not compiled, the first {failed[0].entry}")
    took = format_seconds(time.monotonic() - began)
    typer.echo(f"{len(missing)} kernels for {what.value} ready in {took}, kept in {kernel_cache()}")


def _check_cache(form: Form) -> None:
    """Refuse where nothing can be kept."""
    if not forms.can_be_kept(form):
        where = os.environ.get("NUMBA_CACHE_DIR", "")
        raise DomainError("NUMBA_CACHE_DIR", where, "no folder for compiled kernels may be written to; name one")
