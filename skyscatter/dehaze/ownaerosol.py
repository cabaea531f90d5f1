"""A user's own aerosol, from a file: numbers over wavelength (CSV), or sizes and refractive index (TOML)."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError

from skyscatter.dehaze.bands import read_csv
from skyscatter.errors import DomainError, MissingDataError, SkyscatterError
from skyscatter.optics.mie import MieAerosol
from skyscatter.optics.particles import Particles
from skyscatter.optics.phase import HenyeyGreenstein
from skyscatter.spectra.table import SpectralTable

SUFFIXES = (".csv", ".toml")
COLUMNS = ("wavelength_nm", "extinction", "single_scattering_albedo", "asymmetry")
REFERENCE_NM = 550.0


def is_file(aerosol: str) -> bool:
    """Whether an aerosol is meant as a file rather than as a name."""
    return aerosol.lower().endswith(SUFFIXES)


def is_table(aerosol: str) -> bool:
    """Whether it is meant as a file that knows the phase function by its asymmetry only."""
    return aerosol.lower().endswith(".csv")


def read_aerosol(path: str) -> MieAerosol | Particles:
    """Optics with the optical depth 1 at 550 nm.

    Parameters
    ----------
    path : str
        ``.csv`` with the columns ``wavelength_nm``, ``extinction`` (in any unit), ``single_scattering_albedo`` and
        ``asymmetry``, and a row for each wavelength, 550 nm within; the phase function is that of Henyey & Greenstein,
        which does not polarise, and what others of that asymmetry differ by is in the deviations that dehazing says.
        Or ``.toml`` with ``kind = "mie"``, ``modes`` and a refractive index, or ``kind = "particles"`` with a phase
        function, as ``optics`` has them in a model file, without an amount.

    Raises
    ------
    MissingDataError, DomainError
        If the file is missing, or what it says is no aerosol.
    """
    file = Path(path)
    if not file.is_file():
        raise MissingDataError(path, "there is no such aerosol file; check the path")
    try:
        return _from_table(file) if file.suffix.lower() == ".csv" else _from_toml(file)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"] if part not in ("mie", "particles"))
        raise DomainError("aerosol", path, f"{where + ': ' if where else ''}{first['msg']}") from None
    except DomainError as error:
        if error.name == "aerosol":
            raise
        raise DomainError("aerosol", path, str(error)) from None


def _from_table(file: Path) -> Particles:
    names, rows = read_csv(file)
    if sorted(names) != sorted(COLUMNS):
        raise DomainError("aerosol", str(file), f"needs the columns {', '.join(COLUMNS)}, and has {', '.join(names)}")
    try:
        numbers = np.array([[float(cell) for cell in row] for row in rows]).T
        columns = dict(zip(names, numbers, strict=True))
    except ValueError:
        raise DomainError("aerosol", str(file), "a cell is no number, or missing; give one in every row") from None
    wl = columns["wavelength_nm"]
    if not np.all(np.isfinite(numbers)):
        raise DomainError("aerosol", str(file), "a number is not finite; leave out rows that are not known")
    if not wl.min() <= REFERENCE_NM <= wl.max():
        raise DomainError("aerosol", str(file), "wavelengths must lie on both sides of 550 nm")
    if not columns["extinction"].min() > 0:
        raise DomainError("aerosol", str(file), f"extinction {columns['extinction'].min():g} must be above 0")
    spectra = {name: SpectralTable(wavelengths=tuple(wl), values=tuple(columns[name])) for name in COLUMNS[1:]}
    relative = columns["extinction"] / np.interp(REFERENCE_NM, wl, columns["extinction"])
    return Particles(
        optical_depth=SpectralTable(wavelengths=tuple(wl), values=tuple(relative)),
        single_scattering_albedo=spectra["single_scattering_albedo"], phase=HenyeyGreenstein(g=spectra["asymmetry"]),
    )  # fmt: skip


def _from_toml(file: Path) -> MieAerosol | Particles:
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SkyscatterError(f"{file}: is no TOML: {' '.join(str(error).split())}") from None
    kinds: dict[str, type[MieAerosol] | type[Particles]] = {"mie": MieAerosol, "particles": Particles}
    kind = content.get("kind")
    if kind not in kinds:
        raise DomainError("aerosol", str(file), f"needs kind = {' or '.join(repr(name) for name in kinds)}")
    for name in ("optical_depth", "number_density", "extinction", "wavelength"):
        if name in content:
            raise DomainError("aerosol", str(file), f"{name}: --aod or the image says how much there is; leave it out")
    optics: MieAerosol | Particles = TypeAdapter(kinds[kind]).validate_python({**content, "optical_depth": 1.0})
    return optics
