"""How much memory work takes, and how much there is: what does not fit is refused before it begins."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from skyscatter.errors import DomainError

#: Bytes for each pixel beside its spectra: directions and what they are made of.
OF_PIXEL = 200
#: Cubes beside those of the answer: what files are made of.
OF_FILES = 2
#: Orders of scattering in memory at once: the sum and the last one, the next ones, what is kept and made of them, and
#: those from which the end of a slow series is found.
ORDERS = 15
#: Numbers of a point at which photons are gathered, beside its spectrum: with up to a dozen sorts of matter.
OF_POINT = 40
#: Bytes that a worker process may write to before its first task: interpreter, libraries, compiled code.  Some 290 MB
#: by the system's count (VmData, which the cap is for); two thirds of that are resident.
IDLE_WORKER = 320_000_000
_CGROUPS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


def picture_bytes(width: int, height: int, wavelengths: int, layers: int = 0, rays: int = 1) -> int:
    """Memory that a picture takes while it is made and written [byte].

    Parameters
    ----------
    width, height, wavelengths : int
    layers : int
        Beside the radiance and its error.
    rays : int
        Through each pixel.
    """
    # In the state of the run, and once more in the picture.
    cubes = 2 * (2 + layers) + OF_FILES
    return width * height * (8 * wavelengths * cubes + OF_PIXEL * rays)


def available_bytes() -> int | None:
    """Memory that this process may still take [byte]; None where the system does not say."""
    found = []
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        found += [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    for most, taken in _CGROUPS:  # of a container
        with suppress(OSError, ValueError):
            found.append(int(Path(most).read_text(encoding="ascii")) - int(Path(taken).read_text(encoding="ascii")))
    with suppress(ImportError, OSError, ValueError):
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
            found.append(limit - pages * os.sysconf("SC_PAGE_SIZE"))
    return max(min(found), 0) if found else None


def check_fits(needed: float, name: str, value: object, what: str, remedy: str) -> None:
    """Refuse what memory does not hold.

    Parameters
    ----------
    needed : float
        [byte]
    name, value
        Of the field that is to be blamed.
    what : str
        That takes the memory.
    remedy : str

    Raises
    ------
    DomainError
        If there is less.
    """
    there = available_bytes()
    if there is not None and needed > there:
        rule = f"{what} some {format_bytes(needed)} of memory, and {format_bytes(there)} are free; {remedy}"
        raise DomainError(name, value, rule)


def check_picture(width: int, height: int, wavelengths: int, layers: int = 0, rays: int = 1) -> int:
    """Memory that a picture takes [byte].

    Raises
    ------
    DomainError
        If there is less.
    """
    needed = picture_bytes(width, height, wavelengths, layers, rays)
    remedy = "make it smaller, with fewer wavelengths, or in parts"
    check_fits(needed, "size", f"{width}x{height}", f"at {wavelengths} wavelengths it takes", remedy)
    return needed


def field_bytes(nodes: int, suns: int, moments: int, wavelengths: int, rows: int) -> float:
    """Memory that a solution by orders of scattering takes while it is made [byte].

    Parameters
    ----------
    nodes, suns, moments, wavelengths : int
        Of the grid.
    rows : int
        Of the field from which rays gather, which is made twice: for the orders and for what is asked later.
    """
    order = nodes * suns * moments * wavelengths
    return 8.0 * ORDERS * order + 2 * 4.0 * rows * suns * moments * wavelengths


def tile_bytes(rays: int, wavelengths: int, layers: int = 0, batches: int = 0) -> int:
    """Memory that a worker takes for a tile of a picture [byte].

    Parameters
    ----------
    rays, wavelengths : int
    layers : int
        Beside the radiance and its error.
    batches : int
        Of walks, whose sums are kept.
    """
    # The answer is there once more, packed, on its way back; the sums come and go as well.
    return 8 * rays * wavelengths * 2 * (2 + layers + 2 * batches)


def photon_bytes(rays: int, points: int, wavelengths: int, layers: int, threads: int) -> float:
    """Memory that passes of photons take beside the picture [byte].

    Parameters
    ----------
    rays : int
    points : int
        That every thread has room for.
    wavelengths : int
    layers : int
        Beside the radiance.
    threads : int
        Each makes a pass, and holds one that waits for those before it.
    """
    return 8.0 * threads * (points * (OF_POINT + wavelengths) + 2 * rays * wavelengths * (1 + layers))


def format_bytes(count: float) -> str:
    """Bytes as words of a sensible size: ``3.2 GB``."""
    for unit, size in (("TB", 1e12), ("GB", 1e9)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count / 1e6:.0f} MB"
