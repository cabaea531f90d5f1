"""A folder in which the results of tasks are kept: zarr's format, a chunk a task, each with its key and a checksum.

The one array ``values`` (task, row, column) has a row for each ray of a task, and in its columns one after the other
the quantities that the attribute ``columns`` names, the key of the task and the amount of work that is in the row.  A
chunk is written beside and moved into place, so that it is there whole or not at all, and zarr's checksum (CRC-32C) is
tested whenever it is read.  What has another shape, such as a solution half-way, is kept beside as named parts.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import secrets
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.tasks.claims import Claims
from skyscatter.tasks.task import key_of

Array = NDArray[np.float64]

FORMAT = 1
#: Seconds between two tries to write to a full disk, and after which it is given up.
AGAIN, PATIENCE = 2.0, 600.0
#: Columns at the end of each row.
KEY, AMOUNT = "key", "amount"
_log = logging.getLogger("skyscatter")
_FULL = (errno.ENOSPC, errno.EDQUOT)


class Store:
    """Results of the tasks of one job.

    Parameters
    ----------
    path : path-like
        Of the folder; made where it does not exist.
    recipe : mapping
        All that the results depend on; of another one the folder is refused.
    grows : sequence of str
        Names in the recipe's ``options`` that only say how much work is done, and may differ.
    about : mapping, optional
        What else shall be kept for who reads it.
    option : str
        What errors call the folder.
    patience : float, optional
        Seconds that a full disk is waited for; ten minutes when not given.
    hurried : bool
        Written in a third of the time, and as large as it is.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        recipe: Mapping[str, Any],
        grows: tuple[str, ...] = (),
        about: Mapping[str, Any] | None = None,
        option: str = "store",
        patience: float | None = None,
        hurried: bool = False,
    ) -> None:
        self.path, self._patience, self._hurried = Path(path), patience, hurried
        plain = json.loads(json.dumps(recipe))
        self.key = key_of(_without(plain, grows))
        if not (self.path / "zarr.json").is_file():
            _make(self.path, {**(about or {}), "format": FORMAT, "recipe": plain, "grows": list(grows)}, option)
        self.attributes = read_attributes(self.path, option)
        both = grows if self.attributes["grows"] == list(grows) else ()  # what could not grow then cannot now
        _compare(self.path, self.attributes["recipe"], plain, both, option)
        #: What is no part of zarr's hierarchy lies within the array's folder, where zarr does not look for members.
        self.beside = self.path / "values" / ".work"
        self._array: Any = None

    @cached_property
    def claims(self) -> Claims:
        """Who works on what; signs of life are given from the first claim on."""
        return Claims(self.beside)

    def columns(self) -> dict[str, tuple[int, int]]:
        """First column and number of columns of each quantity; empty before anything is kept."""
        array = self._open()
        return {} if array is None else {name: (a, n) for name, a, n in array.attrs["columns"]}

    def get(self, task: int, rows: int) -> tuple[int, dict[str, Array]] | None:
        """Amount and quantities (row, column) of a task; None where there is nothing, or nothing whole."""
        array = self._open()
        if array is None or task >= array.shape[0] or not self._has(array, task):
            return None
        try:
            chunk = np.asarray(array[task])[:rows]
        except (OSError, ValueError, RuntimeError, KeyError) as error:
            _log.warning("%s: task %d is damaged and is done again: %s", self.path, task, error)
            return None
        named = {name: chunk[:, a : a + n] for name, (a, n) in self.columns().items()}
        amount, key = named.pop(AMOUNT), named.pop(KEY)
        if not np.all(key == self.task_key(task)) or not np.all(amount == amount[0]):
            _log.warning("%s: task %d is of another run and is done again", self.path, task)
            return None
        return int(amount[0, 0]), named

    def put(self, task: int, amount: int, values: Mapping[str, Array], tasks: int, rows: int) -> None:
        """Keep a task; on a full disk it is waited for room.

        Parameters
        ----------
        task : int
        amount : int
            Of work in it.
        values : mapping of str to ndarray, shape (row, column)
        tasks, rows : int
            Of the whole job, and rows of its tasks at most.
        """
        columns: list[list[Any]] = []
        first = 0
        for name, array in {**values, KEY: np.zeros((1, 1)), AMOUNT: np.zeros((1, 1))}.items():
            columns.append([name, first, int(array.shape[1])])
            first += int(array.shape[1])
        chunk = np.full((rows, first), np.nan)
        for (_, a, n), array in zip(columns, values.values(), strict=False):
            chunk[: len(array), a : a + n] = array
        chunk[:, -2], chunk[:, -1] = self.task_key(task), amount
        self._patiently(lambda: self._write(task, chunk, tasks, columns))

    def task_key(self, task: int) -> float:
        """The name of a task: 48 bits of a hash of the recipe and its number, which a double holds."""
        return float(int(key_of({"job": self.key, "task": task})[:12], 16))

    def numbers(self) -> list[int]:
        """Tasks of which there is something."""
        array = self._open()
        return [] if array is None else [k for k in range(array.shape[0]) if self._has(array, k)]

    def tasks(self) -> int | None:
        """Tasks of the job; None before anything is kept."""
        array = self._open()
        return None if array is None else int(array.shape[0])

    def remove(self, task: int | str) -> None:
        """Forget a task by its number, or a part by its name: it is done again."""
        path = self._part(task) if isinstance(task, str) else self._chunk(self._open(), task)
        path.unlink(missing_ok=True)

    def keep(self, part: str, arrays: Mapping[str, Any]) -> None:
        """Keep a part with a name, whole or not at all, in place of what it was before; a full disk is waited for."""
        self._patiently(lambda: self._write_part(part, arrays))

    def kept(self, part: str) -> dict[str, Any]:
        """The arrays of such a part; empty where there is none, or nothing whole."""
        path = self._part(part)
        try:
            with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
                found = {name: file[name] for name in file.files}
            if str(found.pop(KEY)) == self.key:
                return found
            _log.warning("%s is of another run and is done again", path)
        except FileNotFoundError:
            pass
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            _log.warning("%s is damaged and is done again: %s", path, error)
        return {}

    def parts(self) -> list[str]:
        """Names of the parts that there are."""
        return sorted(path.stem for path in self.beside.glob("[!.]*.npz"))

    def close(self) -> None:
        """Give back what is claimed; everything else is on the disk."""
        if "claims" in self.__dict__:
            self.claims.close()

    def _part(self, name: str) -> Path:
        return self.beside / f"{name}.npz"

    def _write_part(self, name: str, arrays: Mapping[str, Any]) -> None:
        self.beside.mkdir(parents=True, exist_ok=True)
        beside = self.beside / f".{name}-{secrets.token_hex(6)}.npz"
        content: dict[str, Any] = {**arrays, KEY: np.array(self.key)}
        try:
            with open(beside, "wb") as file:
                np.savez(file, **content)
            os.replace(beside, self._part(name))
        finally:
            beside.unlink(missing_ok=True)

    def _write(self, task: int, chunk: Array, tasks: int, columns: list[list[Any]]) -> None:
        array = self._open() or self._make_array(tasks, chunk.shape, columns)
        if array.attrs["columns"] != columns:
            raise SkyscatterError(f"{self.path}: keeps other quantities than this run makes; choose another folder")
        array[task] = chunk

    def _make_array(self, tasks: int, shape: tuple[int, ...], columns: list[list[Any]]) -> Any:
        """The array, made by whoever comes first."""
        import zarr
        from zarr.codecs import Crc32cCodec, ZstdCodec

        with suppress(FileExistsError, zarr.errors.ContainsArrayError):
            zarr.create_array(
                str(self.path), name="values", shape=(tasks, *shape), chunks=(1, *shape), dtype="f8",
                compressors=[*([] if self._hurried else [ZstdCodec(level=1)]), Crc32cCodec()], fill_value=float("nan"),
                dimension_names=("task", "ray", "column"), attributes={"columns": columns},
            )  # fmt: skip
        array = self._open()
        if array is None:
            raise SkyscatterError(f"{self.path}: cannot be written; choose another folder")
        return array

    def _open(self) -> Any:
        if self._array is None and (self.path / "values" / "zarr.json").is_file():
            import zarr

            self._array = zarr.open_array(str(self.path / "values"), mode="r+")
        return self._array

    def _has(self, array: Any, task: int) -> bool:
        return self._chunk(array, task).is_file()

    def _chunk(self, array: Any, task: int) -> Path:
        return self.path / "values" / str(array.metadata.encode_chunk_key((task, 0, 0)))

    def _patiently(self, write: Any) -> None:
        """Write; where the disk is full, wait for room before what was worked for is given up."""
        began, said = time.monotonic(), False
        patience = PATIENCE if self._patience is None else self._patience
        while True:
            try:
                return write()
            except OSError as error:
                if error.errno not in _FULL or time.monotonic() - began >= patience:
                    reason = "the disk is full" if error.errno in _FULL else error.strerror or str(error)
                    raise SkyscatterError(f"{self.path}: cannot be written: {reason}") from error
                if not said:
                    _log.warning("%s: the disk is full; waiting %.0f minutes for room", self.path, patience / 60)
                said = True
                time.sleep(AGAIN)


def _without(recipe: Mapping[str, Any], grows: tuple[str, ...]) -> dict[str, Any]:
    options = {name: value for name, value in recipe.get("options", {}).items() if name not in grows}
    return {**recipe, "options": options} if "options" in recipe else dict(recipe)


def _make(path: Path, attributes: Mapping[str, Any], option: str) -> None:
    """A folder with its recipe, whole or not at all; of two that make it, one comes first."""
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        if (path / "zarr.json").is_file():  # made by another program just now
            return
        raise DomainError(option, str(path), "is no store of skyscatter's; choose a new folder")
    if not path.parent.is_dir():
        raise DomainError(option, str(path), "its directory does not exist; make it first")
    try:
        beside = path.with_name(f".{path.name}-{secrets.token_hex(6)}")
        beside.mkdir()
        try:
            group = {"zarr_format": 3, "node_type": "group", "attributes": {"skyscatter": dict(attributes)}}
            (beside / "zarr.json").write_text(json.dumps(group))
            try:
                os.rename(beside, path)
            except OSError:
                if not (path / "zarr.json").is_file():
                    raise
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    except OSError as error:
        raise SkyscatterError(f"{path}: cannot be written: {error.strerror or error}") from error


def discard(path: str | os.PathLike[str]) -> None:
    """Take a store away, in one step for whoever looks; anything else is left alone."""
    path = Path(path)
    with suppress(DomainError, OSError):
        read_attributes(path)
        beside = path.with_name(f".{path.name}-{secrets.token_hex(6)}")
        os.rename(path, beside)
        shutil.rmtree(beside, ignore_errors=True)


def read_attributes(path: str | os.PathLike[str], option: str = "store") -> dict[str, Any]:
    """What a store says of itself; errors call it as `option` says.

    Raises
    ------
    DomainError
        For anything that is no store.
    """
    try:
        text = json.loads((Path(path) / "zarr.json").read_text())
        found: dict[str, Any] = text["attributes"]["skyscatter"]
        found["recipe"], found["grows"]
    except (OSError, ValueError, KeyError, TypeError):
        rule = "is no store of skyscatter's; give a folder that --store or an interrupted run has made"
        raise DomainError(option, str(path), rule) from None
    if found.get("format") != FORMAT:
        raise DomainError(option, str(path), f"has format {found.get('format')}, and this version reads {FORMAT}")
    return found


def _compare(
    path: Path, found: Mapping[str, Any], wanted: Mapping[str, Any], grows: tuple[str, ...], option: str
) -> None:
    a, b = _without(found, grows), _without(wanted, grows)
    for name in sorted(set(a) | set(b)):
        if a.get(name) != b.get(name):
            more = ", or choose another folder" if option == "store" else ""
            raise DomainError(option, str(path), f"was begun with other {name}; repeat the command as it was{more}")


def damaged(store: Store) -> Iterator[tuple[int | str, str]]:
    """Numbers of the tasks and names of the parts that cannot be read, and why."""
    array = store._open()
    for task in store.numbers():
        try:
            chunk = np.asarray(array[task])
        except Exception as error:  # whatever a decoder says of broken bytes
            yield task, " ".join(str(error).split())
            continue
        if not np.all(chunk[:, -2] == store.task_key(task)):
            yield task, "belongs to another run"
    for name in store.parts():
        if not store.kept(name):
            yield name, "cannot be read"
