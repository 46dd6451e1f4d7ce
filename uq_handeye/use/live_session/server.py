"""The server of the page: viser, behind a token, with bounded uploads.

viser (Apache-2.0) brings its client in the wheel, so the page loads nothing from another machine. viser has no access
control of its own, so each request is checked first: the address that is printed holds a token, the answer to it sets
a cookie, and a request with neither, or from a page of another site, is refused. The page listens on this machine only
unless another host is given, e.g. for a phone, which has no ``ssh -L``. The tunnel by which viser shares a page through
a server of its makers is switched off.
"""

from __future__ import annotations

import contextlib
import hmac
import io
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from http import HTTPStatus
from http.cookies import SimpleCookie
from typing import TYPE_CHECKING, Any
from unittest import mock
from urllib.parse import parse_qsl, urlsplit

from ...core.limits import MAX_UPLOAD_BYTES
from ...errors import InputError, MissingExtraError

if TYPE_CHECKING:
    import viser
    from viser.infra import ClientId
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

    Check = Callable[[ServerConnection, Request], Response | None]

HOST, PORT = "127.0.0.1", 8011
_STARTING = threading.Lock()


class Server:
    """viser's server at a host and port (0: any that is free); ``viser`` is the server itself, ``url`` its address."""

    def __init__(self, host: str = HOST, port: int = PORT, label: str = "uq-handeye") -> None:
        try:
            import viser
        except ImportError as error:
            raise MissingExtraError(
                "The live page needs viser: pip install '.[live]' in the clone of uq-handeye."
            ) from error
        token = secrets.token_urlsafe(16)
        port = _free_port(host, port)
        with _silent(), _guarded(token, port):
            self.viser: viser.ViserServer = viser.ViserServer(host, port, label, verbose=False)
        _bound(self.viser)
        self.port, self.token = self.viser.get_port(), token
        self.url = f"http://{f'[{host}]' if ':' in host else host}:{self.port}/?token={token}"

    def close(self) -> None:
        """End the page."""
        with _silent():
            self.viser.stop()


def _free_port(host: str, port: int, attempts: int = 20) -> int:
    """Return the port, or the next one that is free; raises `InputError` for a host or port that cannot be used."""
    if not 0 <= port < 65_536:
        raise InputError(f"Expected the port (--port) between 0 and 65535, got {port}.")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    problem = ""
    for attempt in range(port, min(port + attempts, 65_536)):
        try:
            with socket.create_server((host, attempt), family=family) as found:
                return int(found.getsockname()[1])
        except OSError as error:
            problem = error.strerror or str(error)
    raise InputError(f"Cannot listen on {host}, port {port}: {problem}. Give another --port or --host.")


@contextlib.contextmanager
def _guarded(token: str, port: int) -> Iterator[None]:
    """Have a server of viser that starts in this block check each request; viser itself has no place for a check."""
    from websockets.asyncio import server

    original = server.serve

    def serve(*given: Any, process_request: Check, **options: Any) -> Any:
        return original(*given, process_request=_checked(process_request, token, f"uq_handeye_{port}"), **options)

    with _STARTING, mock.patch.object(server, "serve", serve):
        yield


def _checked(answer: Check, token: str, cookie: str) -> Check:
    """Return ``answer`` for requests that bring the token, in the address or as a cookie; others are refused."""

    def check(connection: ServerConnection, request: Request) -> Response | None:
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.headers.get("Host"):
            return connection.respond(HTTPStatus.FORBIDDEN, "This page is opened by itself, not from another site.\n")
        in_address = dict(parse_qsl(urlsplit(request.path).query)).get("token", "")
        kept = SimpleCookie(request.headers.get("Cookie", "")).get(cookie)
        if hmac.compare_digest(in_address.encode(), token.encode()):
            response = answer(connection, request)
            if response is not None:
                response.headers["Set-Cookie"] = f"{cookie}={token}; HttpOnly; SameSite=Strict; Path=/"
            return response
        if kept is not None and hmac.compare_digest(kept.value.encode(), token.encode()):
            return answer(connection, request)
        return connection.respond(
            HTTPStatus.FORBIDDEN, "Open the address that was printed in the terminal: it holds a token.\n"
        )

    return check


def _bound(server: viser.ViserServer) -> None:
    """Refuse uploads that are too large, and the tunnel that shares a page outside."""
    from viser import _messages as messages

    inner, uploads = server._websock_server, server.gui._current_file_upload_states
    for kind in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        inner.unregister_handler(kind)

    def bound(client: ClientId, message: messages.FileTransferStartUpload | messages.FileTransferPart) -> None:
        state = uploads.get(message.transfer_uuid)
        if state is not None and max(state["total_bytes"], state["transferred_bytes"]) > MAX_UPLOAD_BYTES:
            del uploads[message.transfer_uuid]

    inner.register_handler(messages.FileTransferStartUpload, bound)
    inner.register_handler(messages.FileTransferPart, bound)


def _silent() -> contextlib.redirect_stdout[io.StringIO]:
    """Drop what viser prints about itself."""
    return contextlib.redirect_stdout(io.StringIO())
