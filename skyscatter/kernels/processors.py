"""How many processors there are for this process."""

from __future__ import annotations

import math
import os
from pathlib import Path

#: Where Linux says how much time of processors a container may take, in the second and in the first version of cgroups.
QUOTA = Path("/sys/fs/cgroup/cpu.max")
OLD_QUOTA = Path("/sys/fs/cgroup/cpu/cpu.cfs_quota_us"), Path("/sys/fs/cgroup/cpu/cpu.cfs_period_us")


def processors() -> int:
    """Processors that this process may use, by its affinity and by the quota of its container."""
    bound = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min(bound, quota())))


def quota() -> float:
    """Processors' worth of time that a container may take; infinite without a limit."""
    try:
        words = QUOTA.read_text().split() if QUOTA.exists() else [file.read_text() for file in OLD_QUOTA]
        time, period = float(words[0]), float(words[1])
    except (OSError, ValueError, IndexError):  # "max", or no such system
        return math.inf
    return time / period if time > 0 and period > 0 else math.inf
