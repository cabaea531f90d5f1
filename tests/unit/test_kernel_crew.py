"""Processes that compile for another: what they make is found by it, and they end with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from skyscatter.cli import warm
from skyscatter.cli.main import main
from skyscatter.kernels import crew, forms, processors
from skyscatter.kernels.forms import Form


def small() -> list[Form]:
    """Two forms that compile at once."""
    names = ("lookup:outward_columns_at", "voxels:box_extremes")
    found = [form for form in forms.every() if form.entry.removeprefix("skyscatter.kernels.") in names]
    assert len(found) >= 2
    return found[:2]


LOAD = """
from skyscatter.kernels import forms
for form in forms.every():
    if form.symbol in {symbols}:
        print(sum(forms.compile_form(form).stats.cache_hits.values()))
"""


def test_what_helpers_make_is_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    heard: list[Form] = []
    assert crew.compile_all(small(), 2, heard.append) == []
    assert set(heard) == set(small())
    code = LOAD.format(symbols={form.symbol for form in small()})
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1", "1"]


def test_a_form_that_is_claimed_is_left_to_who_claims_it() -> None:
    held = crew.Crew([], 1)
    held._waiting.extend(small())
    held._ready = {form: crew.threading.Event() for form in small()}
    assert not held.claim(small()[0])
    assert list(held._waiting) == [small()[1]]
    held._waiting.clear()  # as if a helper had begun with it, and ended without a word
    assert held.claim(small()[1])


def test_what_every_command_needs_is_shared_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The helper begins with what takes least, this process with what takes longest; nobody does both."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    least, longest = small()
    here: list[Form] = []

    def compiling(form: Form) -> None:
        here.append(form)
        assert held._ready[least].wait(60)

    monkeypatch.setattr(forms, "compile_form", compiling)
    held = crew.Crew([], 1, shared=[least, longest])
    held.work()
    held.join()
    assert here == [longest]
    assert held.claim(least)
    assert not held.claim(longest)


def test_helpers_are_asked_for_what_is_needed_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """What only some commands of a family call comes last, and where nothing can be kept nobody is called."""
    monkeypatch.setattr(crew.threading.Thread, "start", lambda self: None)
    monkeypatch.setattr(forms, "is_kept", lambda form: False)
    monkeypatch.setattr(crew, "processors", lambda: 2)
    monkeypatch.setattr(forms, "can_be_kept", lambda form: True)
    called = crew._called_for("orders", None)
    assert "sweep_height" in called._shared[-1].entry
    assert {*called._shared} == {*forms.always()["orders"]}
    assert any("fill_densities" in form.entry for form in called._waiting)
    assert not {*called._shared} & {*called._waiting}
    monkeypatch.setattr(forms, "can_be_kept", lambda form: False)
    assert not crew._called_for("orders", None)._threads


def test_what_is_always_needed_is_listed() -> None:
    for family, needed in forms.always().items():
        assert {*needed} <= {*forms.listed()[family]}
    assert any("volume_path_rays" in form.entry for form in forms.always()["volume_path"])
    assert not any("fill_densities" in form.entry for form in forms.always()["orders"])


def test_what_cannot_be_compiled_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    unknown = Form("skyscatter.kernels.optics:absent", "f8")
    assert crew.compile_all([unknown], 1, lambda form: None) == [unknown]


OWN = """
from skyscatter.kernels.jit import entry

@entry
def twice(x):
    return 2.0 * x
"""


def test_a_users_own_entry_needs_no_helper(tmp_path: Path) -> None:
    """Where helpers are allowed, and nothing has been compiled before."""
    (tmp_path / "mine.py").write_text(OWN)
    environment = {name: value for name, value in os.environ.items() if name != crew.HELPER}
    environment |= {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    run = [sys.executable, "-c", "from mine import twice; print(twice(2.0))"]
    done = subprocess.run(run, capture_output=True, text=True, env=environment)
    assert (done.stdout, done.stderr) == ("4.0\n", "")


PARENT = """
import sys
from skyscatter.kernels import crew, forms, processors
held = crew.Crew(forms.every(), 1)
while not held._processes:
    pass
print(held._processes[0].pid, flush=True)
held.join()
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks processes up in /proc")
def test_a_helper_ends_with_its_parent(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True, env=environment) as parent:
        assert parent.stdout is not None
        helper = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    for _ in range(100):
        state = Path(f"/proc/{helper}/stat")
        if not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z":
            return
        time.sleep(0.1)
    os.kill(helper, signal.SIGKILL)
    pytest.fail("the helper lives on")


def test_warm_compiles_and_says_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.delenv(crew.HELPER)
    monkeypatch.setattr(warm, "wanted", lambda what: small())
    assert main(["warm", "sky", "--threads", "1", "-q"]) == 0
    assert "2 kernels for sky ready" in capsys.readouterr().out
    assert list(tmp_path.rglob("*.nbc"))


def test_every_command_has_forms_to_warm() -> None:
    every = warm.wanted(warm.What.all)
    for what in warm.What:
        assert warm.wanted(what)
        assert set(warm.wanted(what)) <= set(every)
    assert any("sweep_height" in form.entry for form in warm.wanted(warm.What.sky))
    assert any("volume_path_rays" in form.entry for form in warm.wanted(warm.What.nebula))


@pytest.mark.parametrize(("arguments", "word"), [(["warm", "fog"], "fog"), (["warm", "--threads", "0"], "threads")])
def test_what_is_wrong_is_named(arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    assert word in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "count"), [("max 100000", 8), ("250000 100000", 3), ("50000 100000", 1), ("", 8), ("-1 100000", 8)]
)
def test_a_containers_share_of_the_processors_counts(
    written: str, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cpu.max").write_text(written)
    monkeypatch.setattr(processors, "QUOTA", tmp_path / "cpu.max")
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)), raising=False)
    assert processors.processors() == count


def test_what_is_left_to_compile_is_told() -> None:
    alone, helped = (crew.Crew([], size, seconds=dict.fromkeys(small(), 4.0)) for size in (0, 1))
    assert alone.seconds_left() == pytest.approx(8.0, abs=0.1)
    assert helped.seconds_left() == pytest.approx(6.0, abs=0.1)  # by two, who both compile what the forms share
    alone._began -= 5.0
    assert alone.seconds_left() == pytest.approx(3.0, abs=0.1)
    for form in small():
        alone.finished(form)
    assert alone.seconds_left() == 0.0
