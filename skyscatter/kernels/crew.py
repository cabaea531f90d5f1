"""Processes that compile for this one: the compiler has one lock for all threads of a process."""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from skyscatter.kernels import forms
from skyscatter.kernels.forms import Form
from skyscatter.kernels.processors import processors

#: Set in the environment of a helper, which has none of its own.
HELPER = "SKYSCATTER_HELPER"
#: Processes that share out forms compile what these share twice: how much longer that takes than listed.
TWICE = 1.5


class Crew:
    """Helpers that take forms from a list, the first one first, and compile them into the cache.

    The first `shared` of them are for this process too: `work` takes them from the other end, and so do all helpers
    but the first.
    """

    def __init__(
        self,
        wanted: Iterable[Form],
        size: int,
        done: Callable[[Form], object] = lambda form: None,
        seconds: Mapping[Form, float] | None = None,
        shared: Iterable[Form] = (),
    ) -> None:
        self._shared, self._waiting = deque(shared), deque(wanted)
        self._left, self._began = dict(seconds or {}), time.monotonic()
        listed, hands = list(self._left.values()), size + 1  # the process that called them works too
        self._needed = max(sum(listed) / hands * (TWICE if size else 1.0), max(listed, default=0.0))
        self._ready = {form: threading.Event() for form in (*self._shared, *self._waiting)}
        self._lock, self._done, self._closed = threading.Lock(), done, False
        self._processes: list[subprocess.Popen[str]] = []
        self._threads = [
            threading.Thread(target=self._serve, args=(number,), daemon=True)
            for number in range(min(size, len(self._ready)))
        ]
        for thread in self._threads:
            thread.start()
        atexit.register(self.close)

    def _next(self, number: int) -> Form | None:
        with self._lock:
            if self._closed:
                return None
            if self._shared:
                return self._shared.pop() if number else self._shared.popleft()
            return self._waiting.popleft() if self._waiting else None

    def _serve(self, number: int) -> None:
        """Hand one form after the other to a process of one's own."""
        process = subprocess.Popen(
            [sys.executable, "-m", forms.__name__], env={**os.environ, HELPER: "1"}, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self._processes.append(process)
        assert process.stdin is not None
        assert process.stdout is not None
        with process:
            while (form := self._next(number)) is not None:
                try:
                    process.stdin.write(f"{form.symbol}\n")
                    process.stdin.flush()
                    ended = not process.stdout.readline()
                except OSError:
                    ended = True
                self._ready[form].set()
                if ended:
                    return
                self.finished(form)
                self._done(form)

    def work(self) -> None:
        """Compile here too, beside the helpers, until nobody has to be told to begin with one that is shared."""
        while self._threads:
            with self._lock:
                form = self._shared.pop() if self._shared else None
                if form is None:
                    return
                del self._ready[form]
            forms.compile_form(form)

    def claim(self, form: Form) -> bool:
        """Take a form over that nobody has begun; wait where a helper is at it.  Whether a helper has had it."""
        with self._lock:
            for left in (self._shared, self._waiting):
                if form in left:
                    left.remove(form)
                    return False
        if form not in self._ready:
            return False
        while not self._ready[form].wait(0.2):
            if not any(thread.is_alive() for thread in self._threads):
                break
        return True

    def finished(self, form: Form) -> None:
        """Note that a form has been compiled, by whomever."""
        self._left.pop(form, None)

    def seconds_left(self) -> float:
        """About how long the rest will take, as far as the list knows: no more than what was foretold."""
        rest = self._needed - (time.monotonic() - self._began)
        return max(rest, 0.0) if self._left else 0.0

    def join(self) -> None:
        """Wait for all of them."""
        for thread in self._threads:
            while thread.is_alive():
                thread.join(0.2)

    def close(self) -> None:
        """End the helpers, whatever they are at."""
        self._closed = True
        for process in self._processes:
            process.kill()


def compile_all(wanted: Iterable[Form], size: int, done: Callable[[Form], object]) -> list[Form]:
    """Compile forms into the cache by so many processes, and hear of each; those that could not be."""
    left = list(wanted)

    def note(form: Form) -> None:
        left.remove(form)
        done(form)

    crew = Crew(left, size, note)
    try:
        crew.join()
    finally:
        crew.close()
    return left


_crews: dict[str, Crew] = {}


def helped(entry: str, arguments: tuple[Any, ...]) -> bool:
    """Whether helpers have compiled an entry for arguments of these types.

    The first call of a family that finds nothing calls them, and shares with them what every command of the family
    needs: this process begins with what takes longest, the first of them with what takes least, which is called first.
    """
    if HELPER in os.environ:
        return False
    family, form = forms.family_of(entry), _form(entry, arguments)
    if family not in _crews:
        _crews[family] = _called_for(family, form)
        _crews[family].work()
    return form is not None and _crews[family].claim(form)


def _called_for(family: str, form: Form | None) -> Crew:
    """Helpers for what the cache has not of a family; none where they could leave nothing for this process to find."""
    listed, taken = forms.listed().get(family, ()), forms.seconds(family)
    missing = [other for other in reversed(listed) if not forms.is_kept(other)]
    shared = [other for other in forms.always().get(family, ()) if other in missing]
    shared.sort(key=lambda other: taken[other])
    size = processors() - 1 if missing and forms.can_be_kept(missing[0]) else 0
    rest = [other for other in missing if other not in shared and other != form]
    foretold = {other: taken[other] for other in (shared or missing)}
    return Crew(rest, size, seconds=foretold, shared=shared)


def finished(entry: str, arguments: tuple[Any, ...]) -> None:
    """Note that this process has compiled an entry for arguments of these types."""
    crew = _crews.get(forms.family_of(entry))
    form = _form(entry, arguments) if crew else None
    if crew and form:
        crew.finished(form)


def seconds_left() -> float:
    """About how long it will be until everything is compiled that was found missing [s]."""
    return sum(crew.seconds_left() for crew in list(_crews.values()))


def _form(entry: str, arguments: tuple[Any, ...]) -> Form | None:
    from skyscatter.kernels.tables import parse

    return next((form for form in forms.every() if form.entry == entry and parse(form.kinds) == arguments), None)
