"""The window's server: a page and its questions, for this machine and this user alone.

It listens on 127.0.0.1 only.  Every request must name this machine as its host, so that no name of the internet can be
made to point here, and carry the token of the address that was opened: in the address once, in a cookie after that.
What asks for work must come from the page itself.  The page may load nothing from anywhere else; the browser sees to
that by the policy that goes with every answer.
"""

from __future__ import annotations

import hmac
import json
import queue
import re
import secrets
import select
import socket
import threading
import time
from collections.abc import Callable
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import count
from typing import Any
from urllib.parse import parse_qs, urlsplit

from skyscatter.errors import DomainError, SkyscatterError
from skyscatter.window.pagefiles import page_file
from skyscatter.window.work import Message, Work

#: Seconds after which the server ends when its last page has closed.
LINGER = 5.0
#: Seconds between two looks at whether a page is still there, and between two words to it that keep the line open.
LOOK, WORD = 0.2, 2.0
#: Largest question [byte], and most answers that wait to be fetched by a page.
LONGEST, MOST_ANSWERS = 65536, 16
#: What the page may do: take scripts, styles and pictures from here, and nothing from anywhere else.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
#: Pages that may be open at a time: each holds a line, and browsers keep six to a server in all.
MOST_PAGES = 4
_PAGE = re.compile(r"[A-Za-z0-9-]{8,64}")


class Page:
    """A page that is open: its work, and what is to be told to it."""

    def __init__(self, work: Callable[[Any], Work]) -> None:
        self.messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self.answers: dict[int, bytes] = {}
        self._numbers, self._lock = count(1), threading.Lock()
        self.work = work(self.send)

    def send(self, message: Message, data: bytes | None = None) -> None:
        """Tell the page something; what goes with it waits until it is fetched."""
        if data is not None:
            with self._lock:
                number = next(self._numbers)
                self.answers[number] = data
                while len(self.answers) > MOST_ANSWERS:  # the page did not want them
                    del self.answers[min(self.answers)]
            message = {**message, "data": number}
        self.messages.put(message)

    def taken(self, number: int) -> bytes | None:
        """What went with a message; it can be fetched once."""
        with self._lock:
            return self.answers.pop(number, None)


class Window:
    """The server, and the pages that are open.

    Parameters
    ----------
    work : callable
        Makes the `Work` of a page from what sends messages to it.
    port : int
        0 for a free one.
    keep : bool
        Whether it stays when the last page has closed.

    Attributes
    ----------
    address : str
        What a browser opens, with the token.
    ended : threading.Event
        Set when it is over: some seconds after the last page has closed, or when it was closed.

    Raises
    ------
    DomainError
        For a port that cannot be had.
    """

    def __init__(self, work: Callable[[Any], Work], port: int = 0, keep: bool = False) -> None:
        self.token, self.keep, self.ended = secrets.token_urlsafe(24), keep, threading.Event()
        self.pages: dict[str, Page] = {}
        self._work, self._lock, self._last = work, threading.Lock(), time.monotonic()
        self._seen = False
        try:
            self._http = _Http(("127.0.0.1", port), self)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            rule = f"cannot be had ({reason}); choose another, or none for a free one"
            raise DomainError("port", port, rule) from error
        self.port = int(self._http.server_address[1])
        self.origin = f"http://127.0.0.1:{self.port}"
        self.address = f"{self.origin}/?token={self.token}"
        self.hosts = (f"127.0.0.1:{self.port}", f"localhost:{self.port}")
        self.cookie = f"skyscatter-{self.port}"

    def start(self) -> None:
        """Answer from now on, in threads."""
        threading.Thread(target=self._http.serve_forever, args=(0.1,), name="window", daemon=True).start()
        threading.Thread(target=self._watch, name="window-watch", daemon=True).start()

    def close(self) -> None:
        """End all work and answer no more."""
        self.ended.set()
        for page in tuple(self.pages.values()):
            page.work.close()
        self._http.shutdown()
        self._http.server_close()

    def opened(self, name: str) -> Page:
        """A page has opened its line; an older line of the same page is dropped."""
        with self._lock:
            before = self.pages.get(name)
            page = self.pages[name] = Page(self._work)
            self._seen = True
        if before is not None:
            before.work.close()
        return page

    def left(self, name: str, page: Page) -> None:
        """A page is gone, and what it has asked for with it."""
        page.work.close()
        with self._lock:
            if self.pages.get(name) is page:
                del self.pages[name]
            self._last = time.monotonic()

    def _watch(self) -> None:
        """End some seconds after the last page has closed."""
        while not self.ended.wait(LOOK):
            with self._lock:
                idle = self._seen and not self.pages and time.monotonic() - self._last > LINGER
            if idle and not self.keep:
                self.ended.set()


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], window: Window) -> None:
        self.window = window
        super().__init__(address, _Handler)

    def server_bind(self) -> None:
        """Bind without asking for the name of this machine, which may take seconds."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = "127.0.0.1", int(self.server_address[1])

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that hangs up is no error."""


class _Refused(Exception):  # noqa: N818
    """A request that is not answered, and the status that says why."""

    def __init__(self, status: int, words: str) -> None:
        self.status, self.words = status, words
        super().__init__(words)


class _Handler(BaseHTTPRequestHandler):
    server: _Http

    server_version, sys_version = "skyscatter", ""
    #: Seconds that a request may take to arrive.
    timeout = 30.0

    def do_GET(self) -> None:
        """Files of the page, its line of messages, and what goes with them."""
        self._answer({"/events": self._events, "/answer": self._fetch, "/room": self._room}, self._file)

    def do_POST(self) -> None:
        """Questions."""
        self._answer({"/ask": self._ask, "/drop": self._drop}, None)

    def _answer(self, routes: dict[str, Callable[[], None]], otherwise: Callable[[], None] | None) -> None:
        self.window = self.server.window
        try:
            parts = urlsplit(self.path)
        except ValueError:
            self._reply(400, b"this is no address", "text/plain; charset=utf-8")
            return
        self.route = parts.path
        self.query = {name: values[0] for name, values in parse_qs(parts.query).items()}
        try:
            self._admit()
            found = routes.get(self.route, otherwise)
            if found is None:
                raise _Refused(404, "nothing here")
            found()
        except _Refused as refusal:
            self._reply(refusal.status, refusal.words.encode(), "text/plain; charset=utf-8")
        except (BrokenPipeError, ConnectionError):
            self.close_connection = True

    def _admit(self) -> None:
        """Refuse whoever is not the page of this user on this machine."""
        window = self.window
        if self.headers.get("Host") not in window.hosts:
            raise _Refused(403, "this server answers to 127.0.0.1 only")
        origin, by = self.headers.get("Origin"), self._token()
        if by is None:
            raise _Refused(403, "the token is wrong or missing; open the address that the command printed")
        own = tuple(f"http://{host}" for host in window.hosts)
        if (origin is not None or self.command == "POST") and origin not in own:
            raise _Refused(403, "only the page itself may ask")
        if by == "cookie" and self.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            raise _Refused(403, "only the page itself may ask")

    def _token(self) -> str | None:
        """By what the request has shown the token; None if it has not."""
        cookies: SimpleCookie = SimpleCookie()
        try:
            cookies.load(self.headers.get("Cookie", ""))
        except CookieError:
            cookies.clear()
        kept = cookies.get(self.window.cookie)
        shown = {
            "address": self.query.get("token"),
            "header": self.headers.get("X-Skyscatter-Token"),
            "cookie": None if kept is None else kept.value,
        }
        right = self.window.token.encode()
        return next((way for way, value in shown.items() if value and hmac.compare_digest(value.encode(), right)), None)

    def _file(self) -> None:
        found = page_file(self.route)
        if found is None:
            raise _Refused(404, "nothing here")
        data, kind = found
        cookie = f"{self.window.cookie}={self.window.token}; Path=/; HttpOnly; SameSite=Strict"
        self._reply(200, data, kind, {"Set-Cookie": cookie} if self.route == "/" else {})

    def _page(self) -> Page:
        page = self.window.pages.get(self.query.get("page", ""))
        if page is None:
            raise _Refused(404, "this page has closed; load it again")
        return page

    def _fetch(self) -> None:
        number = self.query.get("number", "")
        data = self._page().taken(int(number)) if number.isdecimal() and len(number) < 20 else None
        if data is None:
            raise _Refused(404, "this answer is gone")
        self._reply(200, data, "application/octet-stream")

    def _ask(self) -> None:
        question = self._question()
        try:
            self._page().work.ask(question)
        except SkyscatterError as error:
            raise _Refused(400, str(error)) from error
        self._reply(204, b"", "text/plain")

    def _drop(self) -> None:
        self._page().work.drop(str(self._question().get("kind")))
        self._reply(204, b"", "text/plain")

    def _question(self) -> Message:
        length = self.headers.get("Content-Length", "")
        if self.headers.get("Content-Type") != "application/json":
            raise _Refused(415, "questions are JSON")
        if not length.isdecimal() or not 0 < int(length) <= LONGEST:
            raise _Refused(413, f"a question has at most {LONGEST} bytes")
        try:
            question = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError) as error:
            raise _Refused(400, "this is not JSON") from error
        if not isinstance(question, dict):
            raise _Refused(400, "a question is a JSON object")
        return question

    def _events(self) -> None:
        """The line to a page: it is open as long as the page is."""
        name = self.query.get("page", "")
        if not _PAGE.fullmatch(name):
            raise _Refused(400, "a page names itself by 8 to 64 letters, digits and hyphens")
        if name not in self.window.pages:
            self._room_for_one()
        page = self.window.opened(name)  # before the answer, after which the page asks
        said = time.monotonic()
        try:
            self._head(200, "text/event-stream")
            while not self.window.ended.is_set() and self.window.pages.get(name) is page and not self._hung_up():
                try:
                    words = f"data: {json.dumps(page.messages.get(timeout=LOOK))}\n\n"
                except queue.Empty:
                    if time.monotonic() - said < WORD:
                        continue
                    words = ": still here\n\n"
                self.wfile.write(words.encode())
                self.wfile.flush()
                said = time.monotonic()
        finally:
            self.window.left(name, page)
            self.close_connection = True

    def _room(self) -> None:
        """Whether one more page may have a line: a browser that was refused one does not tell its page why."""
        self._room_for_one()
        self._reply(204, b"", "text/plain")

    def _room_for_one(self) -> None:
        if len(self.window.pages) >= MOST_PAGES:
            raise _Refused(409, f"{MOST_PAGES} pages of this window are open; close one and load this page again")

    def _hung_up(self) -> bool:
        """Whether the other side has closed the connection."""
        ready, _, _ = select.select([self.connection], [], [], 0.0)
        return bool(ready) and not self.connection.recv(1, socket.MSG_PEEK)

    def _head(self, status: int, kind: str, more: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for header, value in {"Content-Type": kind, **HEADERS, **(more or {})}.items():
            self.send_header(header, value)
        self.end_headers()

    def _reply(self, status: int, data: bytes, kind: str, more: dict[str, str] | None = None) -> None:
        length = {} if status == 204 else {"Content-Length": str(len(data))}
        self._head(status, kind, {**length, **(more or {})})
        self.wfile.write(data)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Nothing: the terminal is the user's."""
