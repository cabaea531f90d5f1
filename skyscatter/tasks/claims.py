"""Who works on what, where several programs share one folder: a task is claimed by a file that only one can make.

Each program touches a file of its own every few seconds; claims of one whose file has gone old, or whose process has
ended on this machine, are taken over by others.
"""

from __future__ import annotations

import os
import secrets
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path

#: Seconds between two signs of life, and after which a program that gives none is taken for dead.
BEAT, SILENCE = 5.0, 45.0


class Claims:
    """Claims of one program on the tasks of a folder.

    Parameters
    ----------
    folder : path-like
        Made where it does not exist.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.name = f"{socket.gethostname()}.{os.getpid()}.{secrets.token_hex(4)}"
        self._sign = self.folder / f"{self.name}.alive"
        self._sign.touch()
        self._end = threading.Event()
        self._mine: set[str] = set()
        threading.Thread(target=self._beat, name="claims", daemon=True).start()

    def take(self, task: str) -> bool:
        """Claim a task; False where somebody who is alive has it."""
        path = self.folder / f"{task}.claim"
        for _ in range(3):
            try:
                # Written beside and linked: a claim never exists without the name of who made it.
                beside = self.folder / f"{task}.{secrets.token_hex(4)}.new"
                beside.write_text(self.name)
                try:
                    os.link(beside, path)
                finally:
                    beside.unlink()
            except FileExistsError:
                if self.alive(path):
                    return False
                self._bury(path)
                continue
            self._mine.add(task)
            return True
        return False

    def give_back(self, task: str) -> None:
        """End a claim of one's own: the task is done, or somebody else shall do it; those of others are left alone."""
        if task not in self._mine:
            return
        self._mine.discard(task)
        with suppress(OSError):
            (self.folder / f"{task}.claim").unlink()

    def alive(self, claim: Path) -> bool:
        """Whether who made a claim still works."""
        try:
            owner = claim.read_text()
        except OSError:  # given back at this moment
            return True
        if owner == self.name:
            return True
        host, process, _ = owner.rsplit(".", 2)
        if host == socket.gethostname() and not _runs(int(process)):
            return False
        try:
            # Against a file of the same file system: clocks of machines differ.
            return self._now() - (self.folder / f"{owner}.alive").stat().st_mtime < SILENCE
        except OSError:
            return False

    def close(self) -> None:
        """Give everything back."""
        self._end.set()
        for task in tuple(self._mine):
            self.give_back(task)
        with suppress(OSError):
            self._sign.unlink()

    def _bury(self, claim: Path) -> None:
        """Take a dead claim away; of several who try, one does."""
        grave = claim.with_name(f"{claim.name}.{secrets.token_hex(4)}.dead")
        with suppress(OSError):
            os.rename(claim, grave)
            grave.unlink()

    def _now(self) -> float:
        with suppress(OSError):
            self._sign.touch()
            return self._sign.stat().st_mtime
        return time.time()

    def _beat(self) -> None:
        while not self._end.wait(BEAT):
            with suppress(OSError):
                self._sign.touch()


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return True
