"""Commands that are ended at random moments lose nothing."""

from __future__ import annotations

import sys

import pytest
from interruptions import JOBS, judge

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no such signals to another process")


def test_a_few_moments():
    found = judge("sky-single", 3, ways=("SIGTERM", "SIGKILL", "Ctrl-C twice"), earliest=0.4, warm=False)
    assert found.slowest < 5


@pytest.mark.slow
@pytest.mark.parametrize("name", list(JOBS))
def test_many_moments(name):
    judge(name, 20)
