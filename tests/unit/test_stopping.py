"""Signals end a process that does not end by itself, with what is finished kept; checkpoints on the way."""

from __future__ import annotations

import json
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
from skyscatter.tasks.store import Store

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


#: A main thread that hangs, and holds what keeping waits for.
HELD = """
import threading, time
from skyscatter.cli import stopping
stopping.PATIENCE = stopping.LONGEST = 0.2
lock = threading.Lock()
with stopping.answered(), stopping.keeping(lambda: lock.acquire()), lock:
    said = False
    while True:
        try:
            if not said:
                said = True
                print("now", flush=True)  # from here on a signal may come
            time.sleep(60)
        except KeyboardInterrupt:
            pass
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_what_cannot_be_kept_does_not_hold_the_end_up():
    with subprocess.Popen([sys.executable, "-c", HELD], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "now\n"
        process.send_signal(signal.SIGTERM)
        try:
            assert process.wait(20) == 143
        finally:
            process.kill()


def state(done):
    made = RenderState.empty({}, 4, 2)
    made.put(slice(0, done), Answer(np.ones((done, 2)), np.zeros((done, 2)), samples=np.zeros(done, np.int64)))
    return made


def test_checkpoints_are_written_when_it_is_time_and_something_is_new(tmp_path, monkeypatch):
    checkpoint = Checkpoint(tmp_path / "a.zarr", every=3600)
    assert not checkpoint.save()  # of nothing
    checkpoint.begin(state(0))
    assert not checkpoint.save()
    checkpoint.state = state(2)
    checkpoint.tick()
    assert not checkpoint.path.exists()
    checkpoint.every = 1e-9
    checkpoint.tick()
    again = RenderState.empty({}, 4, 2)
    Checkpoint(checkpoint.path).begin(again, checkpoint.path)
    assert again.done.tolist() == [True, True, False, False]
    np.testing.assert_array_equal(again.radiance, state(2).radiance)
    with monkeypatch.context() as patch:
        patch.setattr(Store, "_patiently", lambda *_: pytest.fail("there is nothing new"))
        assert checkpoint.save()
    checkpoint.remove()
    checkpoint.remove()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(DomainError, match="checkpoint_every"):
        Checkpoint("a.zarr", every=0)


def test_a_checkpoint_of_blocks_goes_on_elsewhere(tmp_path, monkeypatch):
    """Only blocks with something new are written; another folder gets all of it."""
    monkeypatch.setattr("skyscatter.solvers.state.BLOCK", 3)
    rng = np.random.default_rng(4)
    made = RenderState.empty({}, 8, 2)

    def solve(first, last):
        shape = last - first, 2
        layers = {"direct": rng.random(shape)}
        made.put(slice(first, last), Answer(rng.random(shape), rng.random(shape), layers, np.full(shape[0], 7)))

    checkpoint = Checkpoint(tmp_path / "a.zarr")
    checkpoint.begin(made)
    solve(0, 2)
    checkpoint.put("fine", {"moments": np.arange(3.0)})
    assert checkpoint.save()
    written = []
    put = Store.put
    monkeypatch.setattr(Store, "put", lambda self, task, *rest: (written.append(task), put(self, task, *rest)))
    solve(7, 8)
    assert checkpoint.save()
    assert written == [2]
    codecs = json.loads((tmp_path / "a.zarr" / "values" / "zarr.json").read_text())["codecs"]
    assert [codec["name"] for codec in codecs] == ["bytes", "crc32c"], "Ctrl-C waits for no compression"
    for name in ("a.zarr", "b.zarr"):
        again, other = RenderState.empty({}, 8, 2), Checkpoint(tmp_path / name)
        other.begin(again, tmp_path / "a.zarr")
        for array in ("done", "radiance", "standard_error", "samples"):
            np.testing.assert_array_equal(getattr(again, array), getattr(made, array))
        np.testing.assert_array_equal(again.layers["direct"], made.layers["direct"])
        assert other.save()
        np.testing.assert_array_equal(other.part("fine")["moments"], np.arange(3.0))
    last = RenderState.empty({}, 8, 2)
    moved = Checkpoint(tmp_path / "b.zarr")
    moved.begin(last, tmp_path / "b.zarr")
    np.testing.assert_array_equal(last.done, made.done)
    assert moved.part("fine")


def test_a_full_disk_leaves_the_old_checkpoint_and_the_run(tmp_path, monkeypatch, caplog):
    checkpoint = Checkpoint(tmp_path / "a.zarr")
    checkpoint.begin(state(0))
    checkpoint.state = state(1)
    assert checkpoint.save()

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Store, "_write", full)
        checkpoint.state = state(3)
        assert not checkpoint.save()
        assert "the disk is full" in caplog.text
        with pytest.raises(SkyscatterError, match="the disk is full"):
            checkpoint.state.save(Path(tmp_path / "b.zarr"))
        patch.setattr(np, "savez", full)
        checkpoint.put("fine", {"moments": np.ones(3)})
        assert not checkpoint.save()
    old = RenderState.empty({}, 4, 2)
    Checkpoint(checkpoint.path).begin(old, checkpoint.path)
    assert old.done.sum() == 1
    assert checkpoint.save(), "there is room again"
    new = RenderState.empty({}, 4, 2)
    Checkpoint(checkpoint.path).begin(new, checkpoint.path)
    assert new.done.sum() == 3
    assert not list(checkpoint.path.rglob(".fine*"))


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
