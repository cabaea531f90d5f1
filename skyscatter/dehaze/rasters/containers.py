"""Products of many files: a folder, a .zip or a .tar, read in place."""

from __future__ import annotations

import tarfile
import zipfile
from pathlib import Path, PurePosixPath

from skyscatter.errors import MissingDataError

_ARCHIVES = (".zip", ".tar")


class Container:
    """Files of a product by name.

    Parameters
    ----------
    path : str
        Folder, .zip or .tar; or one of the product's own metadata files, for the folder that it lies in.

    Raises
    ------
    MissingDataError
        If there is none, or the archive is damaged.
    """

    def __init__(self, path: str) -> None:
        self.shown = str(path)
        place = Path(path)
        self._root = place.resolve()
        self._kind = "folder"
        if place.is_dir():
            self.names = sorted(one.relative_to(place).as_posix() for one in place.rglob("*") if one.is_file())
        elif place.suffix.lower() in _ARCHIVES and place.is_file():
            self._kind = place.suffix.lower()[1:]
            self.names = sorted(self._list())
        elif place.is_file():
            self._root = place.resolve().parent
            self.names = sorted(one.name for one in self._root.iterdir() if one.is_file())
            below = self._root / "GRANULE"
            if below.is_dir():
                self.names += sorted(one.relative_to(self._root).as_posix() for one in below.rglob("*.*"))
        else:
            raise MissingDataError(path, "there is no such product; check the path")

    def _list(self) -> list[str]:
        try:
            if self._kind == "zip":
                with zipfile.ZipFile(self._root) as archive:
                    return archive.namelist()
            with tarfile.open(self._root) as archive:
                return archive.getnames()
        except (zipfile.BadZipFile, tarfile.TarError, OSError, EOFError) as error:
            raise MissingDataError(self.shown, f"is not a whole {self._kind} archive; get it again") from error

    def find(self, *endings: str, below: str = "") -> list[str]:
        """Names that end so, whatever the case, below a folder of the product."""
        wanted = tuple(ending.lower() for ending in endings)
        return [name for name in self.names if name.startswith(below) and name.lower().endswith(wanted)]

    def beside(self, name: str, other: str) -> str | None:
        """The file called `other` (its last part, any case) in the folder of `name`; None if there is none."""
        folder, wanted = PurePosixPath(name).parent, PurePosixPath(other).name.lower()
        for one in self.names:
            if PurePosixPath(one).parent == folder and PurePosixPath(one).name.lower() == wanted:
                return one
        return None

    def read(self, name: str) -> bytes:
        """Content of a (small) file."""
        try:
            if self._kind == "zip":
                with zipfile.ZipFile(self._root) as archive:
                    return archive.read(name)
            if self._kind == "tar":
                with tarfile.open(self._root) as archive:
                    file = archive.extractfile(name)
                    return b"" if file is None else file.read()
            return (self._root / name).read_bytes()
        except (zipfile.BadZipFile, tarfile.TarError, OSError, EOFError, KeyError) as error:
            raise MissingDataError(self.show(name), "cannot be read; get the product again") from error

    def raster(self, name: str) -> str:
        """What GDAL calls the file."""
        path = f"{self._root.as_posix()}/{name.removeprefix('./')}"
        return path if self._kind == "folder" else f"/vsi{self._kind}/{path}"

    def show(self, name: str) -> str:
        """What the user calls the file."""
        name = name.removeprefix("./")
        return f"{self.shown}/{name}" if Path(self.shown).is_dir() or self._kind != "folder" else str(self._root / name)
