"""Serve one page on loopback, to browsers on this computer only."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

from kinematics.foundation.errors import MotionError

LOOPBACK = "127.0.0.1"
POLL_PERIOD = 0.1
"""s between two looks whether it is to end."""


@contextmanager
def serve_page(page: str, port: int = 0) -> Iterator[str]:
    """Serve a page at the address that it yields, until the block ends; port 0: any free one.

    Raises MotionError where nothing can listen there.
    """
    content = page.encode()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
            if host not in (LOOPBACK, "localhost"):  # another site's name that leads here
                self.send_error(HTTPStatus.FORBIDDEN)
            elif self.path.split("?")[0] != "/":
                self.send_error(HTTPStatus.NOT_FOUND)
            else:
                self.send_response(HTTPStatus.OK)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(content)))
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
