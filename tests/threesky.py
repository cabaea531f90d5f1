"""Skies in a browser: the npm package @takram/three-atmosphere with textures of ours, rendered by headless Chromium."""

from __future__ import annotations

import json
import shutil
import subprocess
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

SOURCE = Path(__file__).parent / "data" / "three_sky.js"
PACKAGES = ("@takram/three-atmosphere@0.19.1", "three@0.187", "postprocessing@6", "esbuild@0.28")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: A software renderer, so that no graphics card is asked for.
FLAGS = ("--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
         "--enable-unsafe-swiftshader", "--disable-dev-shm-usage")  # fmt: skip
#: Seconds that installing and rendering may take.
PATIENCE = 120.0


def bundle(folder: Path) -> None:
    """Install the package in a folder and bundle the page there; skips where that cannot be."""
    for program in ("node", "npm"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    if browser() is None:
        pytest.skip("no Chromium is installed")
    (folder / "package.json").write_text('{"private": true}')
    shutil.copy(SOURCE, folder / SOURCE.name)
    install = ["npm", "install", "--no-audit", "--no-fund", "--legacy-peer-deps", *PACKAGES]
    done = subprocess.run(install, cwd=folder, capture_output=True, text=True, timeout=PATIENCE)
    if done.returncode:
        pytest.skip(f"npm cannot install the package: {done.stderr.strip().splitlines()[-1:]}")
    command = ["node_modules/.bin/esbuild", SOURCE.name, "--bundle", "--format=esm", "--outfile=page.js",
               "--log-level=error"]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True, timeout=PATIENCE)
    (folder / "index.html").write_text('<!doctype html><script type="module" src="page.js"></script>')


def browser() -> str | None:
    """The program of a browser, if there is one."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


class _Handler(SimpleHTTPRequestHandler):
    def do_POST(self) -> None:
        self.server.found = json.loads(self.rfile.read(int(self.headers["Content-Length"])))  # type: ignore[attr-defined]
        self.send_response(204)
        self.end_headers()
        self.server.done.set()  # type: ignore[attr-defined]

    def log_message(self, *_: Any) -> None:
        pass


def rendered(folder: Path, cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What the page in a bundled folder, with textures in ``sky``, makes of cases."""
    (folder / "cases.json").write_text(json.dumps(cases))
    program = browser()
    assert program is not None
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, directory=folder)) as server:
        server.done, server.found = threading.Event(), {}  # type: ignore[attr-defined]
        threading.Thread(target=server.serve_forever, daemon=True).start()
        page = f"http://127.0.0.1:{server.server_address[1]}/index.html"
        command = [program, *FLAGS, f"--user-data-dir={folder / 'profile'}", page]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            try:
                assert server.done.wait(PATIENCE), "the browser has not answered"  # type: ignore[attr-defined]
            finally:
                process.terminate()
                server.shutdown()
        found: dict[str, Any] = server.found  # type: ignore[attr-defined]
    assert "found" in found, found.get("error")
    return list(found["found"])
