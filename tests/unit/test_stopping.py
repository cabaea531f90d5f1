"""Signals end a process that does not end by itself, with what is finished kept; checkpoints on the way."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from skyscatter.cli import stopping
from skyscatter.cli.main import main
from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.solvers.base import Answer
from skyscatter.solvers.state import Checkpoint, RenderState

#: A command that swallows Ctrl-C, as third parties do, while it writes a file.
STUBBORN = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # also where the tests run in the background
from pathlib import Path
from skyscatter.atomic import atomic_path
from skyscatter.cli import stopping
stopping.PATIENCE = 0.2
with stopping.answered(), stopping.keeping(lambda: Path("kept").write_text("all")), atomic_path("out.txt") as path:
    path.write_text("half")
    said = False
    while True:
        try:
            if not said:
                said = True
                print("at work", flush=True)
            time.sleep(60)
        except KeyboardInterrupt:
            pass
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals to another process")
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_command_that_hangs_is_ended(number, status, tmp_path):
    (tmp_path / "out.txt").write_text("old")
    with subprocess.Popen([sys.executable, "-c", STUBBORN], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "at work\n"
        process.send_signal(number)
        try:
            assert process.wait(20) == status
        finally:
            process.kill()
    assert {path.name for path in tmp_path.iterdir()} == {"kept", "out.txt"}
    assert (tmp_path / "out.txt").read_text() == "old"


#: A library that calls back from compiled code, where exceptions are lost.
CALLED_BACK = """
import ctypes, signal, time
from skyscatter.cli import stopping
with stopping.answered():
    try:
        ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGTERM))()
        time.sleep(60)
    except KeyboardInterrupt:
        print("kept", flush=True)
        raise SystemExit(stopping.status())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_what_a_callback_swallows_is_raised_again():
    done = subprocess.run([sys.executable, "-c", CALLED_BACK], capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (143, "kept\n", "")


def state(done):
    made = RenderState.empty({}, 4, 2)
    made.put(slice(0, done), Answer(np.ones((done, 2)), np.zeros((done, 2)), samples=np.zeros(done, np.int64)))
    return made


def test_checkpoints_are_written_when_it_is_time_and_something_is_new(tmp_path):
    checkpoint = Checkpoint(tmp_path / "a.npz", every=3600)
    assert not checkpoint.save()  # of nothing
    checkpoint.begin(state(0))
    assert not checkpoint.save()
    checkpoint.state = state(2)
    checkpoint.tick()
    assert not checkpoint.path.exists()
    checkpoint.every = 1e-9
    checkpoint.tick()
    assert RenderState.load(checkpoint.path, {}).done.tolist() == [True, True, False, False]
    written = checkpoint.path.stat().st_mtime_ns
    assert checkpoint.save()
    assert checkpoint.path.stat().st_mtime_ns == written
    checkpoint.remove()
    checkpoint.remove()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(DomainError, match="checkpoint_every"):
        Checkpoint("a.npz", every=0)


def test_a_full_disk_leaves_the_old_checkpoint_and_the_run(tmp_path, monkeypatch, caplog):
    checkpoint = Checkpoint(tmp_path / "a.npz")
    checkpoint.begin(state(0))
    checkpoint.state = state(1)
    assert checkpoint.save()
    old = checkpoint.path.read_bytes()

    def full(file, **arrays):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    checkpoint.state = state(3)
    assert not checkpoint.save()
    assert "the disk is full" in caplog.text
    assert checkpoint.path.read_bytes() == old
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]
    with pytest.raises(SkyscatterError, match="the disk is full"):
        checkpoint.state.save(Path(tmp_path / "b.npz"))


def test_what_a_library_makes_of_a_signal_is_no_error_of_ours(monkeypatch, capsys):
    def cut_short(name):
        raise ImportError("numba._devicearray failed to import")

    monkeypatch.setattr("skyscatter.load_model", cut_short)
    assert main(["flux", "earth"]) == 1
    assert "internal error: ImportError" in capsys.readouterr().err
    monkeypatch.setattr(stopping._now, "status", 143)
    monkeypatch.setenv("SKYSCATTER_TRACEBACK", "1")
    assert main(["flux", "earth"]) == 143
    assert capsys.readouterr().err == "skyscatter: interrupted\n"


def test_an_interrupted_dehazing_says_what_is_kept(monkeypatch, capsys, tmp_path):
    (tmp_path / "a.png").write_bytes(b"")

    def strike(request):
        raise KeyboardInterrupt

    monkeypatch.setattr("skyscatter.cli.dehaze.run", strike)
    assert main(["dehaze", str(tmp_path / "a.png"), "--json"]) == 130
    said = "skyscatter: interrupted; nothing is written; solved atmospheres are kept for the next run\n"
    assert capsys.readouterr().err == said
