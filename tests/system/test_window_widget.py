"""The window in a notebook: what the kernel hears and says, and the page with a stand-in for the notebook around it."""

from __future__ import annotations

import base64
import json
import queue
import time
from pathlib import Path
from typing import Any

import pytest
from browser import PATIENCE, Browser, found

from skyscatter.errors import DomainError

anywidget = pytest.importorskip("anywidget", reason="widgets need anywidget: pip install anywidget")

#: A notebook's side of a widget: its model, whose messages wait until they are fetched.
NOTEBOOK = """(async () => {
    window.sent = []; window.heard = {}; window.values = %s; window.saved = 0;
    const model = {
        get: name => values[name], set: (name, value) => { values[name] = value; }, save_changes: () => { saved++; },
        send: message => { sent.push(message); }, on: (name, act) => { heard[name] = act; }, off: () => {},
    };
    window.say = (message, text) => heard['msg:custom'](message, text
        ? [new DataView(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer)] : []);
    const style = document.createElement('style');
    style.textContent = %s;
    document.head.append(style);
    const module = await import(URL.createObjectURL(new Blob([%s], { type: 'text/javascript' })));
    window.end = await module.default.render({ model, el: document.getElementById('cell') });
})()"""


@pytest.fixture
def widget(monkeypatch: pytest.MonkeyPatch) -> Any:
    from skyscatter.window import SkyWidget

    said: queue.SimpleQueue[tuple[Any, Any]] = queue.SimpleQueue()
    monkeypatch.setattr(SkyWidget, "send", lambda self, message, buffers=None: said.put((message, buffers)))
    made = SkyWidget("earth", sun_elevation_deg=8, height=400)
    made.said = said
    yield made
    made.close()


def test_what_cannot_be_shown_is_refused() -> None:
    from skyscatter.window import SkyWidget

    with pytest.raises(DomainError, match="choose from sun_elevation_deg"):
        SkyWidget("earth", sun_elevation=3)
    with pytest.raises(DomainError, match="skyscatter render"):
        SkyWidget("fog-room")


def test_the_kernel_answers_questions(widget: Any) -> None:
    widget._heard(widget, {"kind": "first", "number": 5}, [])
    message, buffers = widget.said.get(timeout=PATIENCE)
    while message["what"] == "share":
        message, buffers = widget.said.get(timeout=PATIENCE)
    assert message["what"] == "table"
    assert len(buffers[0]) > 100_000
    widget._heard(widget, {"kind": "no such", "number": 6}, [])
    message, _ = widget.said.get(timeout=PATIENCE)
    while message["number"] != 6:
        message, _ = widget.said.get(timeout=PATIENCE)
    assert message["what"] == "error"


@pytest.mark.skipif(found() is None, reason="needs Chromium: apt install chromium")
def test_the_page_in_a_notebook_follows_python_and_tells_it(widget: Any, tmp_path: Path) -> None:
    (tmp_path / "notebook.html").write_text("<!doctype html><title>x</title><div id='cell' style='width: 900px'></div>")
    browser = Browser(found() or "", tmp_path / "browser")
    tab = browser.tab((tmp_path / "notebook.html").as_uri(), 1000, 600)
    tab.wait("document.getElementById('cell') !== null")
    values = {"_markup": widget._markup, "_height": widget._height, "state": dict(widget.state)}
    tab.run(NOTEBOOK % tuple(json.dumps(part) for part in (values, widget._css, widget._esm)))

    def until(script: str) -> None:
        end = time.monotonic() + PATIENCE
        while not tab.run(script):
            assert time.monotonic() < end, script
            for question in tab.run("sent.splice(0)"):
                widget._heard(widget, question, [])
            while not widget.said.empty():
                message, buffers = widget.said.get()
                text = json.dumps(base64.b64encode(buffers[0]).decode() if buffers else None)
                tab.run(f"say({json.dumps(message)}, {text})")
            time.sleep(0.02)

    until("document.querySelector('.status').textContent.startsWith('solved')")
    assert tab.run("document.querySelector('.skyscatter').clientHeight") == 400
    slider = "document.querySelector('[data-name=sunElevation]')"
    assert tab.run(f"{slider}.value") == "8"
    # Python sets the state
    tab.run("values.state = {...values.state, sunElevation: 20}; heard['change:state']()")
    assert tab.run(f"{slider}.value") == "20"
    # the user moves a slider
    tab.run(f"{slider}.value = 33; {slider}.dispatchEvent(new Event('input'))")
    until("values.state.sunElevation === 33 && saved > 0")
    assert tab.complaints() == []
    assert all(address.startswith(("file:", "blob:", "data:")) for address in tab.requests())
    browser.close()
