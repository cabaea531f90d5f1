"""What was compiled into folders that may be read and not written to, such as those of an image of a container.

Numba passes over a folder that it may not write to, and what lies there ready with it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from numba.core import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator


class _Folder(_CacheLocator):
    """A folder as it is."""

    path: str

    def __init__(self, line: int) -> None:
        self._line = line

    def get_cache_path(self) -> str:
        return self.path

    def ensure_cache_path(self) -> None:
        """Nothing will be written there."""

    def get_source_stamp(self) -> str:
        return ""  # set by who reads it

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Folder:
        return cls(function.__code__.co_firstlineno)


def _cache_in(folder: str, function: Callable[..., Any], stamp: str) -> Any:
    """Numba's cache of a function in a folder of our choice."""
    place = type("Place", (_Folder,), {"path": folder})
    contents = type("Contents", (CompileResultCacheImpl,), {"_locator_classes": [place]})
    made = type("Cache", (FunctionCache,), {"_impl_class": contents})(function)
    made._cache_file._source_stamp = stamp
    return made


def read_only(function: Callable[..., Any], stamp: str) -> list[Any]:
    """Caches of a function in folders where numba would keep it, if it were allowed to."""
    file = function.__code__.co_filename
    folders = [os.path.join(os.path.dirname(file), "__pycache__")]
    if config.CACHE_DIR:
        folders.insert(0, os.path.join(config.CACHE_DIR, _CacheLocator.get_suitable_cache_subpath(file)))
    return [_cache_in(f, function, stamp) for f in folders if os.path.isdir(f) and not os.access(f, os.W_OK)]
