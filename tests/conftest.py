"""What every test shares: no network, and the folder of reference files."""

from __future__ import annotations

import logging
import os
import signal
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# Tests run side by side, one for each processor: threads of the linear algebra would only wait for each other.  To be
# said before numpy is loaded.
for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# For the same reason no process has helpers that compile for it.
os.environ.setdefault("SKYSCATTER_HELPER", "1")

# A shell ignores Ctrl-C in what it starts in the background, and so would all that tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import hypothesis  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]


# The same examples in every run, so that a red run can be repeated; no deadline, for machines are shared and kernels
# compile on their first call.
hypothesis.settings.register_profile("skyscatter", deadline=None, derandomize=True)
hypothesis.settings.load_profile("skyscatter")


#: Beginnings of files that run the same large kernels, by what they are about.  They go to one process: else several
#: would compile the same at the same time.
SAME_KERNELS = {
    "photons": ("test_photon", "test_random_rooms", "test_shipped_scenes", "test_surface_", "test_surfaces_"),
    "nebulae": ("test_nebula_", "test_random_nebulae", "test_shipped_nebulae"),
    "worlds": ("test_known_skies", "test_worlds"),
    "images": ("test_dehaze_scenes", "test_simulate"),
}
#: Files of few long tests that share nothing: one by one, else they come last and one process waits for the other.
#: Examples need kernels of all kinds, which others have compiled by then.
APART = ("test_examples.py", "test_names.py", "test_notebooks.py")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """`--dist loadfile`, but for files that belong together."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByKernels(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::", 1)[0]
            name = file.rsplit("/", 1)[-1]
            if name in APART:
                return nodeid
            return next((kind for kind, begins in SAME_KERNELS.items() if name.startswith(begins)), file)

    return ByKernels(config, log)


#: Numbers of this machine, by which workers and their scheduler find each other; they are never looked up elsewhere.
LOOPBACK = ("127.0.0.1", "::1")


class NetworkUseError(RuntimeError):
    """A test, or code under test, tried to reach the network."""


@pytest.fixture(scope="session", autouse=True)
def no_network() -> Iterator[None]:
    """Refuse every connection and every name look-up, other than within this machine."""
    patch = pytest.MonkeyPatch()
    connect, names = socket.socket.connect, socket.getaddrinfo

    def guarded(self: socket.socket, address: Any) -> None:
        if self.family != getattr(socket, "AF_UNIX", None) and address[0] not in LOOPBACK:
            raise NetworkUseError(f"connection to {address!r}: nothing here may use the network")
        connect(self, address)

    def look_up(host: Any, *rest: Any, **named: Any) -> Any:
        if host in LOOPBACK:
            return names(host, *rest, **named)
        raise NetworkUseError(f"look-up of {host!r}: nothing here may use the network")

    patch.setattr(socket.socket, "connect", guarded)
    patch.setattr(socket, "getaddrinfo", look_up)
    patch.setattr(socket, "gethostbyname", look_up)
    yield
    patch.undo()


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep results of this session in a folder of its own: none of an earlier version, none in the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SKYSCATTER_CACHE", str(tmp_path_factory.mktemp("kept")))
        yield


@pytest.fixture(autouse=True)
def numbers_as_numpy_prints_them() -> Iterator[None]:
    """Examples print arrays as a user's Python does, though a test may have imported colour, which changes that."""
    with np.printoptions(legacy=False):
        yield


@pytest.fixture(scope="session")
def reference() -> Path:
    """Folder of reference files (tables by other codes, measured skies); the test is skipped without it."""
    folder = Path(os.environ.get("SKYSCATTER_REFERENCE", ROOT.parent / "shared" / "reference"))
    if not folder.is_dir():
        pytest.skip(f"no reference files in {folder}; name their folder in SKYSCATTER_REFERENCE")
    return folder


@pytest.fixture(autouse=True)
def _log_as_it_is() -> Iterator[None]:
    """What a test has the log say is for itself: a command told to be quiet leaves the next test's log as it was."""
    log = logging.getLogger("skyscatter")
    level, propagate = log.level, log.propagate
    yield
    log.setLevel(level)
    log.propagate = propagate
