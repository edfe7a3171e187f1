"""Serve pages on loopback, to browsers on this computer only."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import click

from kinematics.foundation.errors import MotionError
from pulsepath import progress
from pulsepath.process.ending import EndSignal, set_exit_code
from pulsepath.process.exits import INTERRUPTED

LOOPBACK = "127.0.0.1"
# s between two looks whether the server is to end.
POLL_PERIOD = 0.1
PAGE, DATA = "text/html; charset=utf-8", "application/json"

# Path of reports, which others may have written.
REPORT_PATH = "/report"
# Content-Security-Policy of a report: its scripts run at an origin of their own, and reach no
# address. Reports need no more (benchmarks.animation.animate.POLICY, which takes long to load).
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; "
    "script-src 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob:; "
    "worker-src data: blob:; base-uri 'none'; form-action 'none'"
)

Query = Mapping[str, Sequence[str]]
# Function (path, query) of a request that returns the type and content of a page; None: no page.
FindPage = Callable[[str, Query], tuple[str, bytes] | None]


def answer_page(page: str) -> FindPage:
    """Return a function that answers requests for one page."""
    content = page.encode()
    return lambda path, _: (PAGE, content) if path == "/" else None


def serve_until_interrupted(
    find: FindPage,
    port: int,
    record: dict[str, Any],
    no_browser: bool,
    as_json: bool,
) -> None:
    """Serve pages until Ctrl-C, which ends this normally. Raises as `serve_pages`.

    record: printed with the address, as JSON.
    """
    import webbrowser

    try:
        with serve_pages(find, port) as address:
            click.echo(
                progress.as_json(record | {"address": address}) if as_json else address,
                nl=not as_json,
            )
            sys.stdout.flush()
            progress.note("press Ctrl-C to stop")
            if not no_browser:
                webbrowser.open(address)
            while True:
                time.sleep(3600)
    except EndSignal as end:
        code = 0 if end.code == INTERRUPTED else end.code
        set_exit_code(code)
        progress.note("stopped")
        click.get_current_context().exit(code)


@contextmanager
def serve_pages(find: FindPage, port: int = 0) -> Iterator[str]:
    """Serve pages at the address that it yields, until the block ends. port 0: any free one.

    Requests are answered in threads. Raises MotionError if no server can listen there.
    """

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
            if host not in (LOOPBACK, "localhost"):  # another site's name that leads here
                self.send_error(HTTPStatus.FORBIDDEN)
                return
            try:
                url = urlsplit(self.path)
            except ValueError:  # as of "http://[/"
                self.send_error(HTTPStatus.BAD_REQUEST)
                return
            path = unquote(url.path)
            page = find(path, parse_qs(url.query))
            if page is None:
                self.send_error(HTTPStatus.NOT_FOUND)
                return

            kind, content = page
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            if path == REPORT_PATH:
                self.send_header("Content-Security-Policy", REPORT_POLICY)
            self.end_headers()
            self.wfile.write(content)

        def end_headers(self) -> None:
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            super().end_headers()

        def log_message(self, format: str, *args: object) -> None:
            pass

    try:
        server = _Server((LOOPBACK, port), Handler)
    except OSError as error:
        raise MotionError(
            f"{LOOPBACK} port {port}: {error.strerror}; give another --port, or 0 for a free one"
        ) from None
    with server:
        thread = Thread(target=server.serve_forever, args=(POLL_PERIOD,), daemon=True)
        thread.start()
        try:
            yield f"http://{LOOPBACK}:{server.server_address[1]}/"
        finally:
            server.shutdown()
            thread.join()


class _Server(ThreadingHTTPServer):
    """A server without messages about browsers that leave before the answer."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)
