"""Long work in parts that depend on nothing but themselves, and whatever runs them: threads, processes, a cluster."""

from __future__ import annotations

from skyscatter.tasks.door import engine_for
from skyscatter.tasks.engine import Engine
from skyscatter.tasks.task import Shared, Task

__all__ = ["Engine", "Shared", "Task", "engine_for"]
