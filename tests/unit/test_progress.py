"""Progress: silent unless a terminal or forced; never goes back; says the time left."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest

from skyscatter import progress
from skyscatter.progress import Progress, format_seconds


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    class Clock:
        now = 0.0

        def monotonic(self):
            return self.now

    fake = Clock()
    monkeypatch.setattr(progress, "time", fake)
    return fake


def test_silent_where_there_is_no_terminal():
    stream = io.StringIO()
    with Progress(2, "sky", stream=stream) as bar:
        bar.update()
        bar.update()
    assert stream.getvalue() == ""
    assert bar.done == 2


def test_forced_lines_come_every_ten_seconds(clock):
    stream = io.StringIO()
    with Progress(100, "sky", enabled=True, stream=stream) as bar:
        for second in range(1, 31):
            clock.now = float(second)
            bar.to(second)
        clock.now = 100.0
        bar.to(100)
    lines = stream.getvalue().splitlines()
    assert lines[:3] == [
        "sky: 10 %, 1 min 30 s left",
        "sky: 20 %, 1 min 20 s left",
        "sky: 30 %, 1 min 10 s left",
    ]
    assert lines[-1] == "sky: done in 1 min 40 s"


def test_an_error_is_not_reported_as_done(clock):
    stream = io.StringIO()

    def fail():
        with Progress(1, "sky", enabled=True, stream=stream) as bar:
            bar.update()
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert stream.getvalue() == ""


def test_a_terminal_shows_a_bar_with_percent():
    stream = Terminal()
    with Progress(4, "sky", stream=stream) as bar:
        bar.to(4)
    assert "sky" in stream.getvalue()
    assert "100%" in stream.getvalue()


def test_a_terminal_can_be_kept_quiet():
    stream = Terminal()
    with Progress(4, "sky", enabled=False, stream=stream) as bar:
        bar.update(4)
    assert stream.getvalue() == ""


def test_progress_never_goes_back_nor_past_the_end(clock):
    bar = Progress(1.0, "sky")
    bar.to(0.5)
    bar.to(0.4)
    assert bar.done == 0.5
    bar.update(3)
    assert bar.done == 1.0


def test_time_left_is_unknown_before_any_work(clock):
    bar = Progress(1.0, "sky")
    assert bar.seconds_left() is None
    clock.now = 3.0
    bar.to(0.25)
    assert bar.seconds_left() == 9.0


@pytest.mark.parametrize("total", [0, -1, float("nan")])
def test_total_must_be_positive(total):
    with pytest.raises(ValueError, match="total"):
        Progress(total, "sky")


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "0 s"), (59.4, "59 s"), (59.6, "1 min 00 s"), (125, "2 min 05 s"), (4020, "1 h 07 min")]
)
def test_seconds_as_words(seconds, text):
    assert format_seconds(seconds) == text


def test_rich_is_loaded_only_for_a_bar():
    code = (
        "import sys; from skyscatter.progress import Progress\n"
        "with Progress(1, 'x') as p: p.update()\n"
        "raise SystemExit('rich' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
