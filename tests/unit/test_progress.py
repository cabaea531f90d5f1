"""Progress: a bar on a terminal, lines elsewhere; never goes back; says what is done and the time left."""

from __future__ import annotations

import io
import subprocess
import sys
import time

import pytest

from skyscatter import progress
from skyscatter.errors import DomainError
from skyscatter.progress import Progress, format_seconds, say


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


@pytest.fixture
def still(monkeypatch):
    """No thread that looks by itself: the test does."""
    monkeypatch.setattr(Progress, "_watch", lambda self: None)


def test_what_is_soon_done_is_done_in_silence(still):
    stream = io.StringIO()
    with Progress(2, "sky", stream=stream) as bar:
        for _ in range(2):
            bar.update()
            bar.look()
    assert stream.getvalue() == ""
    assert bar.done == 2


def lines(clock, seconds, mode="log"):
    stream = io.StringIO()
    with Progress(seconds, "sky", mode, stream) as bar:
        for second in range(1, seconds + 1):
            clock.now = float(second)
            bar.to(second)
            bar.look()
    return stream.getvalue().splitlines()


def test_lines_come_every_ten_seconds(clock, still):
    assert lines(clock, 55) == [
        *(f"sky: {100 * k / 55:.0f} %, {55 - k} s left" for k in range(10, 51, 10)),
        "sky: done in 55 s",
    ]


def test_long_work_is_told_at_once_and_then_less_and_less_often(clock, still):
    found = lines(clock, 7200)
    assert found[0] == "sky: 0 %, 1 h 59 min left"
    assert found[-1] == "sky: done in 2 h 00 min"
    assert 100 < len(found) < 200


def test_nothing_is_shown_where_nothing_is_wanted(clock, still):
    assert lines(clock, 100, "none") == []


def test_unknown_ways_to_show_it_are_refused():
    with pytest.raises(DomainError, match="choose one of auto, bar, log, none"):
        Progress(1, "sky", "dots")


def test_words_begin_a_share_and_a_time_of_their_own(clock, still):
    stream = io.StringIO()
    with Progress(1, "sky", "log", stream) as bar:
        say("solving")
        clock.now = 30.0
        bar.to(0.5)
        bar.look()
        say("looking")
        assert bar.done == 0
        clock.now = 40.0
        bar.to(0.25)
        bar.look()
    say("nobody hears")
    assert stream.getvalue().splitlines()[:2] == ["sky: solving: 50 %, 30 s left", "sky: looking: 25 %, 30 s left"]


def test_it_says_that_it_compiles(clock, still):
    numba = pytest.importorskip("numba")
    stream = io.StringIO()

    def seen(x):
        return x + 1

    with Progress(1, "sky", "log", stream) as bar:
        bar._compiling.listen()
        notify, depths = type(bar._compiling).notify, []

        def noted(event):
            notify(bar._compiling, event)
            depths.append(bar._compiling.depth)
            clock.now += 20.0
            bar.look()

        bar._compiling.notify = noted
        assert numba.njit(seen)(1) == 2
    assert depths[0] == 1
    assert depths[-1] == 0
    assert "sky: compiling" in stream.getvalue()


def test_lines_come_without_anyone_asking(monkeypatch):
    monkeypatch.setattr(progress, "LINE_INTERVAL", 0.05)
    monkeypatch.setattr(progress, "TICK", 0.01)
    stream = io.StringIO()
    with Progress(1, "sky", "log", stream):
        deadline = time.monotonic() + 10
        while stream.getvalue().count("\n") < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
    assert stream.getvalue().startswith("sky: 0 %\nsky: 0 %\n")


def test_an_error_is_not_reported_as_done(clock, still):
    stream = io.StringIO()

    def fail():
        with Progress(1, "sky", "log", stream=stream) as bar:
            clock.now = 100.0
            bar.look()
            bar.update()
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert stream.getvalue() == "sky: 0 %\n"


def test_a_terminal_shows_a_bar_with_percent():
    stream = Terminal()
    with Progress(4, "sky", stream=stream) as bar:
        bar.to(4)
        bar.look()
    assert "sky" in stream.getvalue()
    assert "100%" in stream.getvalue()


def test_what_came_last_is_seen_above_the_bar_however_soon_it_ends():
    stream, there = Terminal(), ["nothing yet"]
    with Progress(4, "sky", stream=stream, above=lambda columns, lines: there[0]) as bar:
        bar.look()
        there[0] = "the picture"
    assert "nothing yet" in stream.getvalue()
    assert "the picture" in stream.getvalue()


def test_a_terminal_can_be_kept_quiet():
    stream = Terminal()
    with Progress(4, "sky", "none", stream=stream) as bar:
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


def test_what_was_kept_from_an_earlier_run_says_nothing_of_the_pace(clock):
    """Of the last tenth a half takes four seconds; what was there at once took none of them."""
    bar = Progress(1.0, "sky")
    clock.now = 0.5
    bar.to(0.9)
    assert bar.seconds_left() is None
    clock.now = 4.5
    bar.to(0.95)
    assert bar.seconds_left() == pytest.approx(4.0)


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
        "with Progress(1, 'x', 'log') as p: p.update()\n"
        "raise SystemExit('rich' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
