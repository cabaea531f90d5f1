"""The window without a browser: who is let in, what a page gets, that work ends, and the command of a picture."""

from __future__ import annotations

import http.client
import json
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skyscatter
from skyscatter.cli.main import main
from skyscatter.cli.view import leading_to
from skyscatter.errors import DomainError
from skyscatter.window import server as serving
from skyscatter.window.bundle import live_page, modules, widget_module
from skyscatter.window.nebulae import Mean, luminance_error
from skyscatter.window.questions import Questions
from skyscatter.window.server import Window
from skyscatter.window.skies import WAVELENGTHS
from skyscatter.window.work import Work

#: Seconds for which anything is waited for; machines are shared.
PATIENCE = 60.0


@pytest.fixture(scope="module")
def questions() -> Questions:
    return Questions("earth-simple")


@pytest.fixture
def window(questions: Questions) -> Iterator[Window]:
    opened = Window(questions.work, keep=True)
    opened.start()
    yield opened
    opened.close()


def ask_http(window: Window, path: str, method: str = "GET", body: str | None = None, **headers: str) -> Any:
    """The answer to a request with these headers alone; underscores stand for hyphens."""
    connection = http.client.HTTPConnection("127.0.0.1", window.port, timeout=PATIENCE)
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.putrequest(method, path, skip_host="Host" in given)
    for name, value in given.items():
        connection.putheader(name, value)
    if body is not None:
        connection.putheader("Content-Length", str(len(body)))
    connection.endheaders(None if body is None else body.encode())
    answer = connection.getresponse()
    answer.content = answer.read()  # type: ignore[attr-defined]
    connection.close()
    return answer


@contextmanager
def line(window: Window, page: str = "abcdefgh") -> Iterator[Iterator[dict[str, Any]]]:
    """The messages to a page, as long as its line is open."""
    connection = http.client.HTTPConnection("127.0.0.1", window.port, timeout=PATIENCE)
    connection.request("GET", f"/events?page={page}", headers={"X-Skyscatter-Token": window.token})
    answer = connection.getresponse()
    assert answer.status == 200

    def messages() -> Iterator[dict[str, Any]]:
        for text in answer:
            if text.startswith(b"data: "):
                yield json.loads(text[6:])

    try:
        yield messages()
    finally:
        answer.close()
        connection.close()


def put(window: Window, question: dict[str, Any], page: str = "abcdefgh") -> int:
    json_type, origin = "application/json", window.origin
    token = {"X_Skyscatter_Token": window.token, "Content_Type": json_type, "Origin": origin}
    return ask_http(window, f"/ask?page={page}", "POST", json.dumps(question), **token).status


class Heard:
    """What a page's work has said."""

    def __init__(self, questions: Questions) -> None:
        self.messages: list[tuple[dict[str, Any], bytes | None]] = []
        self.work: Work = questions.work(lambda message, data=None: self.messages.append((message, data)))
        self.count = 0

    def answer(self, kind: str, **question: Any) -> list[tuple[dict[str, Any], bytes | None]]:
        """Ask, and wait until the answer is complete; without the words about how far it is."""
        self.count += 1
        self.work.ask({"kind": kind, "number": self.count, **question})
        wait_for(lambda: any(m["number"] == self.count and m["what"] in ("done", "error") for m, _ in self.messages))
        return [(m, data) for m, data in self.messages if m["number"] == self.count and m["what"] != "share"]


def wait_for(good: Any) -> None:
    end = time.monotonic() + PATIENCE
    while not good():
        assert time.monotonic() < end, "it does not come"
        time.sleep(0.01)


# --- who is let in


def test_the_token_lets_in_once_and_the_cookie_after_that(window: Window) -> None:
    answer = ask_http(window, f"/?token={window.token}")
    assert answer.status == 200
    assert b"<title>skyscatter</title>" in answer.content
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    pair = cookie.partition(";")[0]
    assert ask_http(window, "/page.js", Cookie=pair).status == 200
    assert ask_http(window, "/page.js", X_Skyscatter_Token=window.token).status == 200


@pytest.mark.parametrize("path", ["/", "/page.js", "/events?page=abcdefgh", "/answer?page=abcdefgh&number=1", "/no"])
def test_without_the_token_there_is_nothing(window: Window, path: str) -> None:
    assert ask_http(window, path).status == 403
    wrong = window.token[:-1] + ("A" if window.token[-1] != "A" else "B")
    mark = "&" if "?" in path else "?"
    assert ask_http(window, f"{path}{mark}token={wrong}").status == 403
    assert ask_http(window, path, Cookie=f"{window.cookie}={wrong}").status == 403
    assert ask_http(window, path, X_Skyscatter_Token=wrong).status == 403
    # the cookie of a window on another port
    assert ask_http(window, path, Cookie=f"skyscatter-1={window.token}").status == 403
    assert not window.pages


@pytest.mark.parametrize("host", ["example.org", "example.org:{port}", "127.0.0.1", "127.0.0.1:1", ""])
def test_another_name_for_this_machine_is_refused(window: Window, host: str) -> None:
    """A name of the internet that somebody has made to point here (DNS rebinding)."""
    given = host.format(port=window.port)
    assert ask_http(window, f"/?token={window.token}", Host=given).status == 403
    assert ask_http(window, f"/?token={window.token}", Host=f"localhost:{window.port}").status == 200


def test_other_pages_may_not_ask(window: Window) -> None:
    good = {"Cookie": f"{window.cookie}={window.token}", "Content_Type": "application/json", "Origin": window.origin}
    body = json.dumps({"kind": "facts", "number": 1})

    def status(**changed: str) -> int:
        headers = {name: value for name, value in {**good, **changed}.items() if value}
        return ask_http(window, "/ask?page=abcdefgh", "POST", body, **headers).status

    with line(window):
        assert status() == 204
        assert status(Origin="http://example.org") == 403
        assert status(Origin="null") == 403
        assert status(Origin="") == 403
        assert status(Sec_Fetch_Site="same-site") == 403
        assert status(Sec_Fetch_Site="cross-site") == 403
        assert status(Content_Type="text/plain") == 415  # what a form of another page could send
    assert ask_http(window, "/page.js", Cookie=good["Cookie"], Sec_Fetch_Site="cross-site").status == 403


def test_there_is_room_for_four_pages(window: Window) -> None:
    """Each holds a line of the six that browsers keep to a server; the fifth page would wait without a word."""
    token = {"X_Skyscatter_Token": window.token}
    with ExitStack() as lines:
        for number in range(4):
            assert ask_http(window, "/room", **token).status == 204
            lines.enter_context(line(window, f"page-number-{number}"))
        refused = ask_http(window, "/room", **token)
        assert refused.status == 409
        assert b"close one" in refused.content  # type: ignore[attr-defined]
        assert ask_http(window, "/events?page=page-number-5", **token).status == 409
        lines.enter_context(line(window, "page-number-2"))  # the same page anew
    wait_for(lambda: not window.pages)
    assert ask_http(window, "/room", **token).status == 204


def test_the_browser_is_started_without_the_token(window: Window, tmp_path: Path) -> None:
    """What a program is started with, all users of a machine can see."""
    leads = leading_to(window.address, tmp_path)
    assert window.token not in leads
    (page,) = tmp_path.iterdir()
    assert leads == page.as_uri()
    assert window.address in page.read_text()
    assert page.stat().st_mode & 0o077 == 0


def test_questions_that_are_none_are_refused(window: Window) -> None:
    given = {"X_Skyscatter_Token": window.token, "Content_Type": "application/json", "Origin": window.origin}
    with line(window):
        wrong = ("{", "[1]", "[" * 5000, '{"kind": "no", "number": 1}', '{"kind": "facts"}', '{"number": true}')
        for body, status in (*((text, 400) for text in wrong), ("x" * 70000, 413)):
            assert ask_http(window, "/ask?page=abcdefgh", "POST", body, **given).status == status
        assert ask_http(window, "/ask?page=hgfedcba", "POST", "{}", **given).status == 404
    assert ask_http(window, "/events?page=../../x", X_Skyscatter_Token=window.token).status == 400


@pytest.mark.parametrize("path", ["/../server.py", "/%2e%2e/server.py", "/server.py", "/assets/page.js", "//x/y"])
def test_only_files_of_the_page_are_served(window: Window, path: str) -> None:
    assert ask_http(window, path, X_Skyscatter_Token=window.token).status == 404


def test_every_answer_carries_the_policy(window: Window) -> None:
    for path in (f"/?token={window.token}", "/", f"/nothing?token={window.token}"):
        headers = ask_http(window, path).headers
        policy = dict(part.strip().split(" ", 1) for part in headers["Content-Security-Policy"].split(";"))
        assert policy["default-src"] == "'none'"
        assert all("http" not in where and "*" not in where and "unsafe" not in where for where in policy.values())
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"


def test_it_listens_to_this_machine_only(window: Window) -> None:
    assert window._http.socket.getsockname()[0] == "127.0.0.1"


def test_a_port_that_is_taken_is_refused_in_a_line(window: Window, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", "--no-open", "--port", str(window.port)]) == 2
    assert "port" in capsys.readouterr().err
    assert main(["view", "--no-open", "--port", "70000"]) == 2
    assert main(["view", "--no-open", "fog-room"]) == 2
    assert "skyscatter render" in capsys.readouterr().err
    assert main(["view", "--no-open", "no-such"]) == 2


# --- work


def test_a_page_that_closes_ends_its_work_and_the_window(
    questions: Questions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "LINGER", 0.3)
    ended = threading.Event()

    def endless(question: Any, told: Any) -> Iterator[Any]:
        try:
            while True:
                told(0.5, "going on")
                time.sleep(0.005)
        finally:
            ended.set()
        yield

    window = Window(lambda send: Work(send, {"endless": endless}))
    window.start()
    with line(window) as messages:
        assert put(window, {"kind": "endless", "number": 1}) == 204
        assert next(messages)["what"] == "share"
        page = window.pages["abcdefgh"]
        assert page.work.busy
    assert ended.wait(PATIENCE)
    wait_for(lambda: not page.work.busy)
    assert window.ended.wait(PATIENCE)
    window.close()


@pytest.mark.slow
def test_a_newer_question_ends_the_older_one_at_once(questions: Questions) -> None:
    """A picture of many walks is given up for another side; its answer never comes."""
    heard = Heard(questions)
    side = {"kind": "picture", "model": "star-in-dust", "turn": 0.0, "fieldWidth": 0.4, "width": 200, "height": 160}
    heard.work.ask({**side, "number": 1, "inclination": 0.0})
    wait_for(lambda: any(m["what"] == "picture" for m, _ in heard.messages))
    heard.work.ask({**side, "number": 2, "inclination": 60.0})
    asked = len(heard.messages)
    wait_for(lambda: any(m["number"] == 2 and m["what"] == "picture" for m, _ in heard.messages))
    assert all(m["number"] == 2 for m, _ in heard.messages[asked:])
    heard.work.drop("picture")
    began = time.monotonic()
    wait_for(lambda: not heard.work.busy)
    assert time.monotonic() - began < 10.0  # a slice of rays takes a second, more on a busy machine


def test_what_goes_with_a_message_is_fetched_once(window: Window) -> None:
    with line(window) as messages:
        put(window, {"kind": "table", "number": 7, "model": "earth-simple"})
        told = next(m for m in messages if m["what"] == "table")
        assert told["number"] == 7
        assert told["quick"]
        path = f"/answer?page=abcdefgh&number={told['data']}"
        first = ask_http(window, path, X_Skyscatter_Token=window.token)
        assert first.status == 200
        assert len(first.content) > 1000
        assert ask_http(window, path, X_Skyscatter_Token=window.token).status == 404


def test_errors_are_one_line_with_the_remedy(questions: Questions) -> None:
    heard = Heard(questions)
    for kind, question, words in (
        ("table", {"model": "/etc/passwd"}, "choose one of"),
        ("table", {"model": "earth", "haze": 99}, "haze"),
        ("table", {"model": "earth", "haze": "2"}, "haze"),
        ("table", {"model": "earth", "altitude": float("nan")}, "altitude"),
        ("sun", {"model": "earth", "latitude": 0, "longitude": 0, "altitude": 0, "time": "yesterday"}, "time"),
        ("picture", {"model": "earth"}, "model"),
    ):
        (message, _), = heard.answer(kind, **question)
        assert message["what"] == "error"
        assert words in message["words"]
        assert "\n" not in message["words"]


def test_ctrl_c_ends_the_command_at_once() -> None:
    command = [sys.executable, "-m", "skyscatter", "view", "earth-simple", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "http://127.0.0.1:" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        began = time.monotonic()
        process.wait(PATIENCE)
        assert time.monotonic() - began < 10.0
        assert process.stderr is not None
        assert "Traceback" not in process.stderr.read()


# --- answers


def test_the_spectrum_is_the_solvers(questions: Questions) -> None:
    heard = Heard(questions)
    where = {"sunElevation": 12.0, "sunAzimuth": 200.0, "azimuth": 150.0, "elevation": 25.0, "altitude": 2.0}
    (message, _), _ = heard.answer("sky-point", model="earth-simple", **where)
    scene = skyscatter.load_model("earth-simple").scene(sun_elevation_deg=12, sun_azimuth_deg=200, altitude=2.0)
    field = skyscatter.solve(scene, WAVELENGTHS, sun_elevations_deg=(12, 12))
    up, across, azimuth = np.sin(np.radians(25)), np.cos(np.radians(25)), np.radians(150)
    answer = field.radiance(scene.observer.position, [across * np.sin(azimuth), across * np.cos(azimuth), up])
    # the same solution; directions differ in the last digits
    np.testing.assert_allclose(message["radiance"], answer.radiance, rtol=1e-9)
    np.testing.assert_allclose(message["error"], answer.standard_error, rtol=1e-6)
    assert 0 < max(message["error"]) < 0.05 * max(message["radiance"])


def test_the_command_of_a_changed_sky_is_its_model_file(questions: Questions, tmp_path: Any, monkeypatch: Any) -> None:
    """Copied and run it makes the same scene, to the last digit of what the page shows."""
    monkeypatch.chdir(tmp_path)
    heard = Heard(questions)
    shown = {"sunElevation": 7.25, "sunAzimuth": 210.0, "view": "perspective:200,10,70", "width": 12, "height": 8}
    changed = {"haze": 2.5, "ozone": 0.5, "ground": 0.6, "altitude": 30.0}
    (message, _), _ = heard.answer("sky-command", model="earth", **changed, **shown)
    assert message["file"] == "earth-haze2.5-ozone0.5-ground0.6.toml"
    (tmp_path / message["file"]).write_text(message["text"])
    words = shlex.split(message["command"])
    assert words[:3] == ["skyscatter", "sky", message["file"]]
    assert main([*words[1:-1], "sky.fits", "-q", "--wavelengths", "450,550,650"]) == 0
    image = skyscatter.SpectralImage.load("sky.fits")
    from skyscatter.window.settings import SkySettings

    scene = SkySettings("earth", 2.5, 0.5, 0.6, 30.0).scene()
    scene = scene.model_copy(update={"sun": skyscatter.Sun(elevation_deg=7.25, azimuth_deg=210.0)})
    camera = skyscatter.Perspective(width=12, height=8, azimuth_deg=200, elevation_deg=10, fov_deg=70)
    np.testing.assert_allclose(image.radiance, skyscatter.render(scene, camera, [450, 550, 650]).radiance, rtol=1e-12)


def test_an_unchanged_sky_needs_no_file(questions: Questions) -> None:
    heard = Heard(questions)
    shown = {"sunElevation": 7.25, "sunAzimuth": 210.0, "view": "landscape:180,120", "width": 40, "height": 20}
    (message, _), _ = heard.answer("sky-command", model="mars", altitude=2.0, exposure=12.5, **shown)
    assert message["command"] == (
        "skyscatter sky mars --sun-elevation 7.25 --sun-azimuth 210 --altitude 2m --view landscape:180,120 "
        "--size 40x20 --exposure 12.5 -o sky.png"
    )
    assert "file" not in message
    (message, _), = heard.answer("sky-command", model="mars", altitude=2.0, **{**shown, "view": "sideways"})
    assert message["what"] == "error"


def test_the_sun_stands_where_the_ephemeris_has_it(questions: Questions) -> None:
    place = {"latitude": 48.86, "longitude": 2.35, "altitude": 0.0, "time": "2026-06-21T19:15:00Z"}
    (message, _), _ = Heard(questions).answer("sun", model="earth", **place)
    scene = skyscatter.load_model("earth").scene_at(48.86, 2.35, "2026-06-21T19:15Z")
    assert message["elevation"] == scene.sun.elevation_deg
    assert message["azimuth"] == scene.sun.azimuth_deg


def test_pictures_of_a_nebula_add_up(questions: Questions, tmp_path: Any, monkeypatch: Any) -> None:
    """Means over all walks, with the error that independent walks have; see `Mean`."""
    scene = skyscatter.load_model("star-in-dust").scene()
    camera = skyscatter.Telescope.from_length(12, 10, "0.4 pc", scene.view.distance)
    walks = [skyscatter.Path(samples=16, seed=seed) for seed in range(3)]
    images = [skyscatter.render(scene, camera, [450, 550, 650], solver=solver) for solver in walks]
    mean = Mean()
    for image in images:
        mean.add(image, 16)
    np.testing.assert_allclose(mean.radiance, np.mean([i.radiance for i in images], axis=0), rtol=1e-12)
    joined = mean.image(images[0])
    squares = sum(np.asarray(i.standard_error) ** 2 for i in images)
    np.testing.assert_allclose(joined.standard_error, np.sqrt(squares) / 3, rtol=1e-12)
    # an upper bound: that of wavelengths whose errors go together
    weights = luminance_error(joined)
    assert weights.shape == (10, 12)
    assert np.all(weights >= 0)
    monkeypatch.chdir(tmp_path)
    side = {"model": "star-in-dust", "inclination": 20.0, "turn": 5.0, "fieldWidth": 0.4, "width": 16, "height": 16}
    (message, _), _ = Heard(questions).answer("nebula-command", **side, samples=2)
    words = shlex.split(message["command"])
    assert main([*words[1:], "-q", "--wavelengths", "450,550"]) == 0
    assert (tmp_path / "nebula.png").is_file()


def test_the_modules_of_the_page_are_put_together() -> None:
    names = [name for name, _ in modules()]
    assert names[-1] == "page.js"
    assert set(names) >= {"sky.js", "state.js", "controls.js", "skyview.js", "nebulaview.js", "spectrum.js"}
    for number, (_, text) in enumerate(modules()):
        assert "import(" not in text
        assert all(f'"./{later}"' not in text for later in names[number:])
    assert "embed" in widget_module()


def test_the_page_of_the_documentation_names_no_other_address(questions: Questions) -> None:
    text = live_page(b"table", {"model": "earth", "models": []})
    addresses = set(re.findall(r"(?:https?|wss?):[^\s\"'\\\\]+", text))
    assert addresses <= {"http://www.w3.org/2000/svg"}  # a name, which nobody looks up


def test_a_kind_that_nobody_answers_is_refused(questions: Questions) -> None:
    with pytest.raises(DomainError, match="kind"):
        questions.work(lambda message, data=None: None).ask({"kind": "no", "number": 1})
