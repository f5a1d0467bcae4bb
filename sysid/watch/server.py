"""Shows the page of a test day to browsers on this machine, and to nobody else."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from sysid.errors import OutputError

#: The one address that is listened to.
LOOPBACK = "127.0.0.1"
#: How long a browser may take to ask [s].
_PATIENCE_S = 10.0


class PageServer:
    """Serves a page and the part of it that changes, under an address that nobody guesses.

    Parameters
    ----------
    page : the page, which asks for ``part`` beside it. port : 0 for any that is free.

    Raises
    ------
    OutputError
        If the port is taken.
    """

    def __init__(self, page: Callable[[], str], port: int = 0):
        self._page, self._part = page, b""
        self._path = f"/{secrets.token_urlsafe(16)}/"
        try:
            self._server = ThreadingHTTPServer((LOOPBACK, port), self._handler())
        except OSError as error:
            reason = (error.strerror or "unknown reason").lower()
            raise OutputError(f"Port {port} cannot be used for the page ({reason}); choose another --port.") from None
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.2,), daemon=True)

    @property
    def port(self) -> int:
        """The port that is listened to."""
        return int(self._server.server_address[1])

    @property
    def address(self) -> str:
        """Where a browser on this machine finds the page."""
        return f"http://{LOOPBACK}:{self.port}{self._path}"

    def show(self, part: str) -> None:
        """Show this from now on."""
        self._part = part.encode("utf-8")

    def start(self) -> None:
        """Answer from now on, beside everything else."""
        self._thread.start()

    def stop(self) -> None:
        """Answer no more."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        server = self

        class Handler(BaseHTTPRequestHandler):
            timeout = _PATIENCE_S
            server_version, sys_version = "sysid", ""

            def do_GET(self) -> None:
                # A page of another site that points its own name to this machine sends that name.
                if self.headers.get("Host") != f"{LOOPBACK}:{server.port}":
                    self._answer(403, b"")
                elif self.path == server._path:
                    self._answer(200, server._page().encode("utf-8"))
                elif self.path == f"{server._path}part":
                    tag = f'"{sha256(server._part).hexdigest()[:16]}"'
                    known = self.headers.get("If-None-Match") == tag
                    self._answer(304 if known else 200, b"" if known else server._part, tag)
                else:
                    self._answer(404, b"")

            def _answer(self, status: int, content: bytes, tag: str = "") -> None:
                self.send_response(status)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(content)))
                self.send_header("Cache-Control", "no-store")
                self.send_header("X-Content-Type-Options", "nosniff")
                self.send_header("X-Frame-Options", "DENY")
                self.send_header("Cross-Origin-Resource-Policy", "same-origin")
                if tag:
                    self.send_header("ETag", tag)
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, format: str, *args: object) -> None:
                """Say nothing: the terminal is for the day."""

        return Handler
