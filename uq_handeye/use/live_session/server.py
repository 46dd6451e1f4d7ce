"""The page's server: viser behind the gateway, with bounded uploads and nothing that leads outside.

viser (Apache-2.0) brings its client in the wheel, so the page asks no other machine for anything. What it could do
beyond that is switched off: the tunnel that shares a page through a server of its makers.
"""

from __future__ import annotations

import contextlib
import io
import secrets
from typing import TYPE_CHECKING, Any

from ...errors import InputError, MissingExtraError
from .gateway import SECRET_HEADER, Gateway, is_loopback, new_token

if TYPE_CHECKING:
    import viser

# Address; largest file of an upload (bytes).
HOST, PORT, MOST_UPLOADED = "127.0.0.1", 8011, 100_000_000


class Server:
    """viser's server on ``host``; from another host than the loopback a token is asked for."""

    def __init__(self, host: str = HOST, port: int = PORT, token: str | None = None, label: str = "uq-handeye") -> None:
        try:
            import viser
        except ImportError as error:
            raise MissingExtraError(
                "The live page needs viser: pip install '.[live]' in the clone of uq-handeye."
            ) from error
        if not 0 <= port < 65_536:
            raise InputError(f"Expected the port (--port) between 0 and 65535, got {port}.")
        secret = secrets.token_urlsafe(32)
        with _silent():
            self.viser: viser.ViserServer = viser.ViserServer(host="127.0.0.1", port=0, label=label, verbose=False)
        try:
            _lock(self.viser, secret)
            if token is None and not is_loopback(host):
                token = new_token()
            self.gateway = Gateway(host, port, self.viser.get_port(), secret, token)
        except BaseException:
            with _silent():
                self.viser.stop()
            raise

    @property
    def url(self) -> str:
        """Address of the page."""
        return self.gateway.url

    def close(self) -> None:
        """End the page."""
        self.gateway.close()
        with _silent():
            self.viser.stop()


def _lock(server: Any, secret: str) -> None:
    """Refuse connections that do not come through the gateway, uploads that are too large, and shared tunnels."""
    from viser import _messages as messages

    inner = server._websock_server

    async def check(connection: Any) -> None:
        live = inner._live_connections[connection.client_id]
        if not secrets.compare_digest(live.request.headers.get(SECRET_HEADER, ""), secret):
            await live.close(1008, "not through the gateway")

    inner.on_client_connect(check)
    for kind in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        inner.unregister_handler(kind)
    uploads = server.gui._current_file_upload_states

    def bound(client: int, message: Any) -> None:
        state = uploads.get(message.transfer_uuid)
        if state is not None and max(state["total_bytes"], state["transferred_bytes"]) > MOST_UPLOADED:
            del uploads[message.transfer_uuid]

    inner.register_handler(messages.FileTransferStartUpload, bound)
    inner.register_handler(messages.FileTransferPart, bound)


def _silent() -> contextlib.redirect_stdout[io.StringIO]:
    """Drop what viser prints about itself."""
    return contextlib.redirect_stdout(io.StringIO())
