"""Pages in a headless browser: read once they stand, printed, or acted in by a script."""

import json
import shutil
import subprocess
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from queue import Queue
from threading import Thread

import pytest

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
"""Path of a browser; `.ci/run` installs one where it can."""
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--enable-logging=stderr",
    "--enable-unsafe-swiftshader",
)
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium here; .ci/run installs one"
)


def browse(folder, page, *options):
    """What a browser prints of a page's file with these options (`--dump-dom`,
    `--print-to-pdf=…`).
    """
    command = [CHROMIUM, *OPTIONS, f"--user-data-dir={folder / 'profile'}", *options, page.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)


@contextmanager
def visit(folder, url):
    """Within, a browser shows the page at an address."""
    command = [
        CHROMIUM,
        *OPTIONS,
        f"--user-data-dir={folder / 'profile'}",
        "--window-size=1400,900",
        url,
    ]
    with (
        (folder / "log").open("w") as log,
        subprocess.Popen(command, stdout=log, stderr=log) as browser,
    ):
        try:
            yield
        finally:
            browser.terminate()


def act_in(folder, page, script, size="1400,900", *options):
    """What a script, run at the end of the page, sends by `fetch("/said", …)`, and what the browser
    logs.

    In real time: with a virtual clock, timers run ahead of the frames that a page draws in.
    """
    text = page.read_text(encoding="utf-8")
    text = text.replace(
        "connect-src", "connect-src 'self'"
    )  # what is sent must be allowed by the page's policy
    if "connect-src" not in text:
        text = text.replace("default-src 'none'", "default-src 'none'; connect-src 'self'", 1)
    text = text.replace("</body>", f"<script>{script}</script></body>").encode()
    said = Queue()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(text)

        def do_POST(self):
            said.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *args):
            pass

    with (
        ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server,
        (folder / "log").open("w+") as log,
    ):
        Thread(target=server.serve_forever, daemon=True).start()
        command = [
            CHROMIUM,
            *OPTIONS,
            f"--user-data-dir={folder / 'profile'}",
            f"--window-size={size}",
            *options,
        ]
        url = f"http://127.0.0.1:{server.server_port}/"
        browser = subprocess.Popen([*command, url], stdout=log, stderr=log, text=True)
        try:
            return said.get(timeout=60), (folder / "log").read_text()
        finally:
            browser.terminate()
            browser.wait(20)
            server.shutdown()
