"""The page's server: viser behind the gateway, with bounded uploads and nothing that leads outside.

viser (Apache-2.0) brings its client in the wheel, so the page asks no other machine for anything. What it could do
beyond that is switched off: the tunnel that shares a page through a server of its makers.

The door of the page: who may come in, before anything of the page's server is reached.

The page's own server listens on a port of the loopback that it lets nobody use who does not know a secret of this
process. The gateway adds the secret to what it passes on, and passes on

- without a token (loopback only): requests whose ``Host`` names this machine's loopback, so that no name of another
  site leads here, and whose ``Origin``, if any, is that host, so that no page of another site reaches in;
- with a token: requests that bring it, as ``?token=`` once and as a cookie from then on.

Base of all pages: server, look, and how they are opened, waited for and closed.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import io
import secrets
import threading
import webbrowser
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlencode, urlsplit

from ...errors import InputError, MissingExtraError, NotConvergedError

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
                token = secrets.token_urlsafe(16)
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


LOOPBACK = ("127.0.0.1", "localhost", "::1")
SECRET_HEADER = "X-Uq-Handeye-Secret"
# Longest head of a request (bytes), and seconds to wait for it.
MOST_HEAD, PATIENCE = 16_384, 10.0
# Ports tried where the one asked for is taken.
ATTEMPTS = 20


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine alone."""
    return host.strip("[]") in LOOPBACK


class Gateway:
    """Listens on ``host`` and ``port`` (0: any that is free) in a thread of its own, in front of ``inner`` port."""

    def __init__(self, host: str, port: int, inner: int, secret: str, token: str | None) -> None:
        self.host, self.token, self._inner, self._secret = host, token, inner, secret
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        try:
            self._server = self._loop.run_until_complete(self._listen(host, port))
        except OSError as error:
            self._loop.close()
            raise InputError(f"Cannot listen on {host}, port {port}: {error.strerror}. Give another --port.") from error
        self.port = int(self._server.sockets[0].getsockname()[1])
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True, name="gateway")
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page, with the token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/" + ("" if self.token is None else f"?token={self.token}")

    def close(self) -> None:
        """Stop listening, and end all connections."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(PATIENCE)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _listen(self, host: str, port: int) -> asyncio.Server:
        last: OSError = OSError("no port")
        for attempt in range(port, port + (ATTEMPTS if port else 1)):
            try:
                return await asyncio.start_server(self._accept, host, attempt, limit=MOST_HEAD)
            except OSError as error:
                last = error
        raise last

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            with suppress(ConnectionError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, TimeoutError):
                await self._serve(reader, writer)
        except asyncio.CancelledError:
            pass
        finally:
            self._tasks.discard(task)
            writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), PATIENCE)
        request, *lines = head.decode("latin-1").split("\r\n")[:-2]
        headers = [(name.strip().lower(), value.strip()) for name, _, value in (line.partition(":") for line in lines)]
        method, path, *_ = [*request.split(" "), "", ""]
        refused = self._refused(dict(headers), path)
        if refused is not None:
            writer.write(refused)
            await writer.drain()
            return
        inner_reader, inner_writer = await asyncio.open_connection("127.0.0.1", self._inner)
        try:
            inner_writer.write(self._passed_on(f"{method} {path} HTTP/1.1", headers).encode("latin-1"))
            both = [asyncio.create_task(_copy(*pair)) for pair in ((reader, inner_writer), (inner_reader, writer))]
            try:
                await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in both:
                    task.cancel()
                await asyncio.gather(*both, return_exceptions=True)
        finally:
            inner_writer.close()

    def _passed_on(self, request: str, headers: Iterable[tuple[str, str]]) -> str:
        """Return the head for the inner server: with the secret, and closed after one answer unless it is upgraded."""
        kept = [(name, value) for name, value in headers if name != SECRET_HEADER.lower()]
        if not any(name == "upgrade" for name, _ in kept):
            kept = [(name, value) for name, value in kept if name != "connection"] + [("connection", "close")]
        lines = [request, *(f"{name}: {value}" for name, value in (*kept, (SECRET_HEADER, self._secret)))]
        return "\r\n".join(lines) + "\r\n\r\n"

    def _refused(self, headers: dict[str, str], path: str) -> bytes | None:
        """Return the answer to a request that is not passed on; None: it is."""
        host, origin = headers.get("host", ""), headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return _answer("403 Forbidden", "This page is opened by itself, not from another site.")
        if self.token is None:
            return None if is_loopback(_name_of(host)) else _answer("403 Forbidden", "Unknown name of this machine.")
        split = urlsplit(path)
        query = parse_qsl(split.query)
        given = dict(query).get("token")
        name = f"uq_handeye_{self.port}"
        if given is not None and hmac.compare_digest(given.encode(), self.token.encode()):
            rest = urlencode([(key, value) for key, value in query if key != "token"])
            cookie = f"Set-Cookie: {name}={self.token}; HttpOnly; SameSite=Strict; Path=/"
            return _answer("303 See Other", "", f"Location: {split.path}{'?' if rest else ''}{rest}", cookie)
        cookies = dict(part.strip().partition("=")[::2] for part in headers.get("cookie", "").split(";"))
        if hmac.compare_digest(cookies.get(name, "").encode(), self.token.encode()):
            return None
        return _answer("403 Forbidden", "Open the address that was printed in the terminal: it holds a token.")


def _name_of(host: str) -> str:
    return host.partition("]")[0].lstrip("[") if host.startswith("[") else host.partition(":")[0]


def _answer(status: str, text: str, *headers: str) -> bytes:
    head = [f"HTTP/1.1 {status}", "Content-Type: text/plain; charset=utf-8", f"Content-Length: {len(text.encode())}"]
    return ("\r\n".join([*head, "Connection: close", *headers]) + f"\r\n\r\n{text}").encode()


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(65_536):
        writer.write(data)
        await writer.drain()


class BrowserPage:
    """A page with a panel at its right edge (on a phone: below)."""

    def __init__(self, host: str = HOST, port: int = PORT, token: str | None = None) -> None:
        self._server = Server(host, port, token)
        self._stop, self._drawing = threading.Event(), threading.Lock()
        self._gui = self._server.viser.gui
        self._gui.set_panel_label("uq-handeye")
        self._gui.main_panel.dock_right()
        self._theme(False)

    def _theme(self, dark: bool) -> None:
        self._gui.configure_theme(show_logo=False, show_share_button=False, control_width="large", dark_mode=dark)

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._server.url

    def open(self) -> None:
        """Open the page in the browser of this machine, where there is one."""
        with suppress(webbrowser.Error):
            webbrowser.open(self.url)

    def wait(self) -> None:
        """Stay until Ctrl-C."""
        while not self._stop.wait(0.5):
            pass

    def close(self) -> None:
        """End the page."""
        self._stop.set()
        self._server.close()

    def _button(self, label: str, work: Callable[[], Any], **look: Any) -> Any:
        button = self._gui.add_button(label, **look)
        button.on_click(lambda _: self._tried(work))
        return button

    def _upload(self, label: str, work: Callable[[str, bytes], Any], **look: Any) -> None:
        """Add a button that takes a file: its name, and its content."""
        button = self._gui.add_upload_button(label, **look)
        button.on_upload(lambda event: self._tried(lambda: work(event.target.value.name, event.target.value.content)))

    def _tried(self, work: Callable[[], Any]) -> None:
        """Do what a click asks for; what cannot be done is said on the page."""
        try:
            work()
        except (InputError, NotConvergedError, MissingExtraError) as error:
            self._say(str(error))

    def _say(self, problem: str) -> None:
        raise NotImplementedError

    @staticmethod
    def _set(element: Any, content: str) -> None:
        if element.content != content:
            element.content = content
