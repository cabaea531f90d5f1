"""What a page has asked for and not yet got: a job for each kind of question, of which the newest counts.

Compiled loops cannot be stopped from outside.  They tell how far they are, and what they tell raises `Cancelled` when
nobody waits for the answer any more: the solvers take it as Ctrl-C and leave.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from skyscatter.errors import DomainError, SkyscatterError

Message = dict[str, Any]
#: How a job tells the share of its work that is done, and what it does.
Told = Callable[[float, str], None]
#: What answers a question: messages, each with the bytes that go with it.
Answering = Callable[[Message, Told], Iterable[tuple[Message, bytes | None]]]

#: Seconds between two words about how far a job is.
PACE = 0.1

_log = logging.getLogger("skyscatter")


class Cancelled(KeyboardInterrupt):
    """Nobody waits for the answer any more."""


class Send(Protocol):
    """How messages reach the page."""

    def __call__(self, message: Message, data: bytes | None = None) -> None:
        """Send a message, with the bytes that go with it."""


class Job:
    """A question that is being answered.

    Attributes
    ----------
    wanted : bool
        Whether anybody still waits for it.
    ended : threading.Event
    """

    def __init__(self, number: int, question: Message, send: Send) -> None:
        self.number, self.question, self._send = number, question, send
        self.wanted, self.ended = True, threading.Event()
        self._said = 0.0

    def told(self, share: float, words: str = "") -> None:
        """How far the work is; raises `Cancelled` where it is not wanted any more."""
        if not self.wanted:
            raise Cancelled
        now = time.monotonic()
        if now - self._said >= PACE or share >= 1.0:
            self._said = now
            self.say({"what": "share", "share": min(max(float(share), 0.0), 1.0), "words": words})

    def say(self, message: Message, data: bytes | None = None) -> None:
        """Send a message of this job, as long as it is wanted."""
        if self.wanted:
            self._send({"number": self.number, **message}, data)


class Work:
    """The questions of one page.

    Parameters
    ----------
    send : callable
        ``send(message, data)`` brings a message to the page; it may be called from any thread.
    answering : mapping
        What answers each kind of question.
    """

    def __init__(self, send: Send, answering: dict[str, Answering]) -> None:
        self._send, self._answering = send, answering
        self._jobs: dict[str, Job] = {}
        self._lock, self._closed = threading.Lock(), False

    def ask(self, question: Message) -> None:
        """Begin to answer a question ``{"kind": ..., "number": ...}``; an older one of the same kind is dropped.

        Raises
        ------
        DomainError
            For a kind that is not known, and a number that is none.
        """
        kind, number = question.get("kind"), question.get("number")
        if not isinstance(kind, str) or kind not in self._answering:
            raise DomainError("kind", kind, f"choose one of {', '.join(self._answering)}")
        if not isinstance(number, int) or isinstance(number, bool):
            raise DomainError("number", number, "give a whole number by which the answers are known")
        job = Job(number, question, self._send)
        with self._lock:
            if self._closed:
                return
            before, self._jobs[kind] = self._jobs.get(kind), job
        if before is not None:
            before.wanted = False
        answer = self._answering[kind]
        threading.Thread(target=_run, args=(job, answer, before), name=f"page-{kind}", daemon=True).start()

    def drop(self, kind: str) -> None:
        """No answer to the last question of a kind is wanted any more."""
        with self._lock:
            job = self._jobs.get(kind)
        if job is not None:
            job.wanted = False

    @property
    def busy(self) -> bool:
        """Whether something is still being worked on, wanted or not."""
        with self._lock:
            return any(not job.ended.is_set() for job in self._jobs.values())

    def close(self) -> None:
        """The page is gone: nothing is wanted any more."""
        with self._lock:
            self._closed = True
            for job in self._jobs.values():
                job.wanted = False


def _run(job: Job, answer: Answering, before: Job | None) -> None:
    """Answer a question as soon as the one before it has let go of the processors."""
    try:
        if before is not None:
            before.ended.wait()
        if job.wanted:
            for message, data in answer(job.question, job.told):
                job.told(1.0)
                job.say(message, data)
            job.say({"what": "done"})
    except KeyboardInterrupt:
        pass
    except (SkyscatterError, ValueError, OSError) as error:
        job.say({"what": "error", "words": _one_line(error)})
    except MemoryError:
        job.say({"what": "error", "words": "not enough memory; ask for a smaller picture"})
    except Exception as error:
        _log.exception("the page asked %r", job.question)
        job.say({"what": "error", "words": f"internal error: {type(error).__name__}: {error}; please report it"})
    finally:
        job.ended.set()


def _one_line(error: Exception) -> str:
    """What is wrong, as the command line says it."""
    from pydantic import ValidationError

    from skyscatter.problems import problem_lines

    if isinstance(error, ValidationError):
        return "; ".join(problem_lines(error))
    return " ".join(str(error).split())
