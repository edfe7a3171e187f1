"""Serve pages on loopback, to browsers on this computer only."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from urllib.parse import parse_qs, unquote, urlsplit

from kinematics.foundation.errors import MotionError

LOOPBACK = "127.0.0.1"
POLL_PERIOD = 0.1
"""s between two looks whether it is to end."""
PAGE, DATA = "text/html; charset=utf-8", "application/json"

Query = Mapping[str, Sequence[str]]
FindPage = Callable[[str, Query], tuple[str, bytes] | None]
"""From path and query of a request to the type and content of what it asks for; None: there is none."""


@contextmanager
def serve_page(page: str, port: int = 0) -> Iterator[str]:
    """Serve one page as `serve_pages` does."""
    content = page.encode()
    with serve_pages(lambda path, _: (PAGE, content) if path == "/" else None, port) as address:
        yield address


@contextmanager
def serve_pages(find: FindPage, port: int = 0) -> Iterator[str]:
    """Serve pages at the address that it yields, until the block ends; port 0: any free one.

    Requests are answered in threads. Raises MotionError where nothing can listen there.
    """

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
            if host not in (LOOPBACK, "localhost"):  # another site's name that leads here
                self.send_error(HTTPStatus.FORBIDDEN)
                return
            url = urlsplit(self.path)
            found = find(unquote(url.path), parse_qs(url.query))
            if found is None:
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            kind, content = found
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            with suppress(ConnectionError):  # a browser that has left
                self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            pass

    try:
        server = ThreadingHTTPServer((LOOPBACK, port), Handler)
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
