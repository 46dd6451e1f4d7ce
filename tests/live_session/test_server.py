"""The server of the page: a token opens it; uploads are stored under names of the session's own."""

import http.client
import io
import resource
import socket
import zipfile

import pytest

import uq_handeye as uq
from uq_handeye.use.live_session.folder import Folder
from uq_handeye.use.live_session.markup import summary
from uq_handeye.use.live_session.session import Session
from uq_handeye.use.live_session.uploads import MAX_UPLOAD_BYTES, keep_bag, keep_picture, keep_upload, thumbnail

pytest.importorskip("viser", reason="viser (extra live) is not installed")
from uq_handeye.use.live_session.server import Server


def asked(port, path="/", **headers):
    """Return status, headers and body of a request."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, dict(answer.getheaders()), body


def upgraded(port, **headers):
    """Return the status of a request for a websocket, and what comes then."""
    lines = {
        "Host": f"127.0.0.1:{port}", "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol": "viser-v" + VERSION, **headers,
    }  # fmt: skip
    with socket.create_connection(("127.0.0.1", port), timeout=20) as link:
        link.sendall(("GET / HTTP/1.1\r\n" + "".join(f"{k}: {v}\r\n" for k, v in lines.items()) + "\r\n").encode())
        head = b""
        while b"\r\n\r\n" not in head:
            head += link.recv(1)
        return int(head.split()[1]), link.recv(2)


VERSION = __import__("viser").__version__


@pytest.fixture
def page():
    server = Server(port=0)
    yield server
    server.close()


def test_a_token_opens_the_page(page):
    port, token = page.port, page.token
    assert page.url == f"http://127.0.0.1:{port}/?token={token}" and len(token) > 20
    for wrong in ("/", "/?token=", f"/?token={token[:-1]}", "/?token=%ff"):
        assert asked(port, wrong)[0] == 403
    status, headers, body = asked(port, f"/?token={token}&darkMode=")
    assert status == 200 and b"<html" in body[:300].lower() and "HttpOnly; SameSite=Strict" in headers["Set-Cookie"]
    cookie = headers["Set-Cookie"].partition(";")[0]
    assert asked(port, Cookie=cookie)[0] == 200 and asked(port, Cookie=f"other=1; {cookie}")[0] == 200
    assert asked(port, Cookie=cookie[:-1])[0] == 403 and asked(port, Cookie="a;=;;")[0] == 403
    assert asked(port, "/../../etc/passwd", Cookie=cookie)[0] == 404


def test_a_websocket_needs_the_token_too(page):
    """Through it goes all that the page shows; one that is opened begins to speak (opcode 2)."""
    cookie = asked(page.port, f"/?token={page.token}")[1]["Set-Cookie"].partition(";")[0]
    status, first = upgraded(page.port, Cookie=cookie)
    assert status == 101 and first[:1] == b"\x82"
    assert upgraded(page.port)[0] == 403
    assert upgraded(page.port, Cookie=cookie, Origin="http://evil.example")[0] == 403
    assert upgraded(page.port, Cookie=cookie, Origin=f"http://127.0.0.1:{page.port}")[0] == 101


def test_two_pages_on_one_machine(page):
    other = Server(host="0.0.0.0", port=page.port)
    try:
        assert other.port > page.port and asked(other.port, f"/?token={page.token}")[0] == 403
        assert asked(other.port, f"/?token={other.token}")[0] == 200
    finally:
        other.close()


def test_what_viser_could_do_beyond_the_page(page):
    from viser import _messages as messages

    handlers = page.viser._websock_server._incoming_handlers
    assert not handlers.get(messages.ShareUrlRequest) and not handlers.get(messages.ShareUrlDisconnect)
    from websockets.asyncio import server

    assert server.serve.__module__ == "websockets.asyncio.server"  # the check of one page is in no other server


def test_a_wrong_port():
    with pytest.raises(uq.InputError, match="between 0 and 65535, got 70000"):
        Server(port=70_000)
    with pytest.raises(uq.InputError, match="Cannot listen on 192"):
        Server(host="192.0.2.1")


def test_uploads_stay_in_the_folder(tmp_path):
    assert keep_upload(tmp_path, "robot", "../../../evil.csv", b"x") == tmp_path / "robot.csv"
    assert keep_upload(tmp_path, "robot", "C:\\temp\\evil.CSV", b"y") == tmp_path / "robot_2.csv"
    assert keep_bag(tmp_path, "/etc/../a.mcap", b"x") == tmp_path / "bags" / "bag.mcap"
    for name, content, why in (
        ("page.html", b"x", "Expected a file of poses"), ("robot", b"x", "Expected a file"), ("a.csv", b"", "is empty"),
        ("a.csv", bytes(MAX_UPLOAD_BYTES + 1), "at most 50 MB are read"),
    ):  # fmt: skip
        with pytest.raises(uq.InputError, match=why):
            keep_upload(tmp_path, "robot", name, content)
    with pytest.raises(uq.InputError, match="Expected a bag of ROS"):
        keep_bag(tmp_path, "bag.rar", b"x")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bags", "robot.csv", "robot_2.csv"]


def picture(width, height, kind="PNG"):
    """A grey picture as bytes."""
    Image = pytest.importorskip("PIL.Image", reason="Pillow (extra live) is not installed")
    with io.BytesIO() as file:
        Image.new("L", (width, height), 128).save(file, kind)
        return file.getvalue()


@pytest.mark.slow
def test_pictures_are_looked_at_before_they_are_kept(tmp_path):
    assert keep_picture(tmp_path, "../a.png", picture(640, 480)).name == "picture.png"
    assert thumbnail(tmp_path / "picture.png").shape == (180, 240, 3)
    bomb = picture(12_000, 9_000)  # 105 kB
    for content, why in ((bomb, "more pixels than are read"), (b"<svg onload=alert(1)>", "expected a picture")):
        with pytest.raises(uq.InputError, match=why):
            keep_picture(tmp_path, "b.png", content)
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]


@pytest.mark.slow
def test_what_files_hold_is_shown_as_text_and_bounded(tmp_path):
    """Zip bombs, HTML and formulas in a file end as one line that says what cannot be read."""
    session = Session(Folder(tmp_path))
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("robot.npy", bytes(300_000_000))
    for name, content in (
        ("a.npz", bomb.getvalue()), ("a.csv", b"x,y,z,qx,qy,qz,qw\n<img src=x onerror=alert(1)>,0,0,0,0,0,1\n"),
        ("a.csv", b"x,y,z,qx,qy,qz,qw\n=cmd|' /C calc'!A0,0,0,0,0,0,1\n"), ("a.json", b'{"a":' * 100_000),
    ):  # fmt: skip
        paths = [keep_upload(tmp_path, side, name, content) for side in ("robot", "camera")]
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        session.update()
        assert session.problem and "\n" not in session.problem and session.answer.n == 0
        assert "<img" not in summary(session) and resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 250_000
        for path in paths:
            path.unlink()
