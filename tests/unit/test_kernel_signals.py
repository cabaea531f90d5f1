"""Ctrl-C while machine code is made or loaded: it is answered, and neither it nor the code is lost."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from skyscatter.kernels.signals import postponed


def test_a_signal_in_a_callback_is_answered_after_it() -> None:
    heard = []

    def struck() -> None:
        signal.raise_signal(signal.SIGINT)
        heard.append("to its end")

    callback = ctypes.CFUNCTYPE(None)(struck)
    before = signal.getsignal(signal.SIGINT)

    def body() -> None:
        with postponed():
            callback()
            heard.append("behind it")

    with pytest.raises(KeyboardInterrupt):
        body()
    assert heard == ["to its end", "behind it"]
    assert signal.getsignal(signal.SIGINT) is before


def test_nothing_happens_without_a_signal_nor_in_other_threads() -> None:
    with postponed(), postponed():
        pass
    seen = []

    def body() -> None:
        with postponed():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGINT)]


PROBE = """
import signal, sys
from numba.core.codegen import JITCodeLibrary
armed = []
for name in ("_object_compiled_hook", "_object_getbuffer_hook"):
    def struck(cls, *given, hook=getattr(JITCodeLibrary, name).__func__, name=name):
        if armed:
            armed.clear()
            print("struck in", name, flush=True)
            signal.raise_signal(signal.SIGINT)
        return hook(cls, *given)
    setattr(JITCodeLibrary, name, classmethod(struck))
import probe
armed.append(True)
try:
    print("no interruption", probe.twice(1.0))
except KeyboardInterrupt:
    print("interrupted")
print(probe.twice(2.0))
"""


def test_code_that_an_interruption_strikes_is_whole(tmp_path: Path) -> None:
    """Struck in the callback itself, when the code is made, and when it is loaded by the next process."""
    (tmp_path / "probe.py").write_text(
        "from skyscatter.kernels.jit import entry\n\n@entry\ndef twice(x):\n    return 2.0 * x\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", PROBE], capture_output=True, text=True, env=environment, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        said = done.stdout.splitlines()
        assert said[0].startswith("struck in"), said
        assert said[1:] == ["interrupted", "4.0"], done.stderr
