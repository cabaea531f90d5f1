"""A browser for tests: Chromium without a window, told what to do through pipes: neither port nor driver is needed.

Only what the tests need of the protocol (https://chromedevtools.github.io/devtools-protocol/) is here.
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import queue
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ARGUMENTS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe", "--no-first-run", "--no-default-browser-check", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "about:blank",
)  # fmt: skip
#: The browser reads what it is told from the file 3 and answers on the file 4.
_BEGIN = "import os,sys; r,w=map(int,sys.argv[1:3]); os.dup2(r,3); os.dup2(w,4); os.execv(sys.argv[3],sys.argv[3:])"
#: Seconds for which anything is waited for; machines are shared.
PATIENCE = 60.0
KEYS = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Enter": 13, "Tab": 9, "Escape": 27,
        "Home": 36, " ": 32}  # fmt: skip


def found() -> str | None:
    """The browser of this machine."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """A browser that is running."""

    def __init__(self, path: str, folder: Path) -> None:
        def high(fd: int) -> int:
            try:
                return fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 10)
            finally:
                os.close(fd)

        theirs_in, ours_out = map(high, os.pipe())
        ours_in, theirs_out = map(high, os.pipe())
        begin = [sys.executable, "-c", _BEGIN, str(theirs_in), str(theirs_out), path, f"--user-data-dir={folder}"]
        self._process = subprocess.Popen(
            [*begin, *ARGUMENTS], pass_fds=(theirs_in, theirs_out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._out, self._in = os.fdopen(ours_out, "wb", 0), os.fdopen(ours_in, "rb", 0)
        self._number, self._answers = 0, queue.SimpleQueue[dict[str, Any]]()
        #: What tabs have told by themselves.
        self.events: list[dict[str, Any]] = []
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        rest = b""
        while part := self._in.read(65536):
            *whole, rest = (rest + part).split(b"\0")
            for text in whole:
                message = json.loads(text)
                self._answers.put(message) if "id" in message else self.events.append(message)

    def call(self, method: str, session: str | None = None, **parameters: Any) -> Any:
        """Have something done."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._out.write(json.dumps(message | ({"sessionId": session} if session else {})).encode() + b"\0")
        while (answer := self._answers.get(timeout=PATIENCE))["id"] != self._number:
            pass
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']['message']}")
        return answer["result"]

    def tab(self, address: str = "about:blank", width: int = 1000, height: int = 640, **media: str) -> Tab:
        """A new tab of some size [pixel]."""
        return Tab(self, address, width, height, media)

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()
        self._out.close()
        self._in.close()


class Tab:
    """A tab, and all that it has asked the network for."""

    def __init__(self, browser: Browser, address: str, width: int, height: int, media: dict[str, str]) -> None:
        context = browser.call("Target.createBrowserContext")["browserContextId"]
        self.target = browser.call("Target.createTarget", url="about:blank", browserContextId=context)["targetId"]
        self.session = browser.call("Target.attachToTarget", targetId=self.target, flatten=True)["sessionId"]
        self.browser = browser
        for domain in ("Page", "Network", "Log", "Runtime"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        features = [{"name": name.replace("_", "-"), "value": value} for name, value in media.items()]
        self.call("Emulation.setEmulatedMedia", features=features)
        self.call("Page.bringToFront")
        self.go(address)

    def call(self, method: str, **parameters: Any) -> Any:
        return self.browser.call(method, self.session, **parameters)

    def go(self, address: str) -> None:
        """Load a page."""
        self.call("Page.navigate", url=address)

    def run(self, script: str) -> Any:
        """The value of an expression in the page; promises are waited for."""
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"].get("exception", {}).get("description", script))
        return answer["result"].get("value")

    def one(self, selector: str, value: str) -> Any:
        """Something of the element `e` that a selector finds."""
        return self.run(f"(e => {value})(document.querySelector({json.dumps(selector)}))")

    def wait(self, script: str, good: Callable[[Any], object] = bool, seconds: float = PATIENCE) -> Any:
        """The value of an expression as soon as it is good."""
        end = time.monotonic() + seconds
        while True:
            try:
                value = self.run(script)
            except RuntimeError as error:  # as while the page is loaded
                value = error
            if not isinstance(value, RuntimeError) and good(value):
                return value
            assert time.monotonic() < end, f"{script} is still {value!r}"
            time.sleep(0.02)

    def press(self, key: str, shift: bool = False) -> None:
        """Press a key."""
        code = KEYS.get(key, ord(key.upper()[0]))
        about = {"key": key, "windowsVirtualKeyCode": code, "modifiers": 8 if shift else 0}
        text = {"text": {"Enter": "\r"}.get(key, key)} if len(key) == 1 or key == "Enter" else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", **about, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **about)

    def click(self, x: float, y: float) -> None:
        """Click somewhere [pixel]."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press in one place and let go in another [pixel]."""
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=start[0], y=start[1], button="left", clickCount=1)
        for share in (0.3, 0.7, 1.0):
            x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=end[0], y=end[1], button="left", clickCount=1)

    def picture(self) -> bytes:
        """What is to be seen, as a PNG file."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def told(self, method: str) -> list[dict[str, Any]]:
        """What the tab has told by itself, of one sort."""
        events = tuple(self.browser.events)
        return [e["params"] for e in events if e["method"] == method and e.get("sessionId") == self.session]

    def requests(self) -> list[str]:
        """Addresses of all that was asked for."""
        return [event["request"]["url"] for event in self.told("Network.requestWillBeSent")]

    def complaints(self) -> list[str]:
        """Errors that the page or the browser has written down."""
        thrown = [_what(e["exceptionDetails"]) for e in self.told("Runtime.exceptionThrown")]
        calls = [e for e in self.told("Runtime.consoleAPICalled") if e["type"] == "error"]
        thrown += [str(e["args"][0].get("description")) for e in calls]
        return thrown + [e["entry"]["text"] for e in self.told("Log.entryAdded") if e["entry"]["level"] == "error"]

    def close(self) -> None:
        """Close the tab."""
        self.browser.call("Target.closeTarget", targetId=self.target)


def _what(details: dict[str, Any]) -> str:
    """What an error says."""
    return str(details.get("exception", {}).get("description", details.get("text", "")))
