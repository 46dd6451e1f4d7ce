"""The door of the page: this machine alone, or a token; uploads under names of ours."""

import http.client
import io
import resource
import socket
import zipfile

import pytest

import uq_handeye as uq
from uq_handeye.use.live_session.folder import Folder
from uq_handeye.use.live_session.markup import summary
from uq_handeye.use.live_session.session import MOST_BYTES, Session, keep_bag, keep_picture, keep_upload, thumbnail

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


def test_this_machine_alone(page):
    port = page.gateway.port
    assert page.url == f"http://127.0.0.1:{port}/"
    status, _, body = asked(port)
    assert status == 200 and b"<html" in body[:300].lower()
    assert asked(port, Host=f"evil.example:{port}")[0] == 403
    assert asked(port, Origin="http://evil.example")[0] == 403
    assert asked(port, "/../../etc/passwd")[0] == 404
    assert upgraded(port)[0] == 101
    assert upgraded(port, Origin="http://evil.example")[0] == 403


def test_the_inner_server_is_of_no_use_without_the_secret(page):
    """It closes the connection (opcode 8) before it says anything; through the gateway it begins to speak."""
    inner = page.viser.get_port()
    status, first = upgraded(inner)
    assert status == 101 and first[:1] == b"\x88"
    status, first = upgraded(inner, **{"X-Uq-Handeye-Secret": "guess"})
    assert first[:1] == b"\x88"
    status, first = upgraded(page.gateway.port)
    assert status == 101 and first[:1] == b"\x82"


def test_a_token_elsewhere():
    server = Server(host="0.0.0.0", port=0)
    try:
        port, token = server.gateway.port, server.gateway.token
        assert f"?token={token}" in server.url and len(token) > 20
        for wrong in ("/", "/?token=", f"/?token={token[:-1]}"):
            assert asked(port, wrong)[0] == 403
        status, headers, _ = asked(port, f"/?token={token}&darkMode=")
        assert (
            status == 303 and "HttpOnly; SameSite=Strict" in headers["Set-Cookie"] and token not in headers["Location"]
        )
        cookie = headers["Set-Cookie"].partition(";")[0]
        assert asked(port, Cookie=cookie)[0] == 200 and upgraded(port, Cookie=cookie)[0] == 101
        assert upgraded(port)[0] == 403
    finally:
        server.close()


def test_a_wrong_port():
    with pytest.raises(uq.InputError, match="between 0 and 65535, got 70000"):
        Server(port=70_000)


def test_uploads_stay_in_the_folder(tmp_path):
    assert keep_upload(tmp_path, "robot", "../../../evil.csv", b"x") == tmp_path / "robot.csv"
    assert keep_upload(tmp_path, "robot", "C:\\temp\\evil.CSV", b"y") == tmp_path / "robot_2.csv"
    assert keep_bag(tmp_path, "/etc/../a.mcap", b"x") == tmp_path / "bags" / "bag.mcap"
    for name, content, why in (
        ("page.html", b"x", "Expected a file of poses"), ("robot", b"x", "Expected a file"), ("a.csv", b"", "is empty"),
        ("a.csv", bytes(MOST_BYTES + 1), "at most 50 MB are read"),
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


def test_pictures_are_looked_at_before_they_are_kept(tmp_path):
    assert keep_picture(tmp_path, "../a.png", picture(640, 480)).name == "picture.png"
    assert thumbnail(tmp_path / "picture.png").shape == (180, 240, 3)
    bomb = picture(12_000, 9_000)  # 105 kB
    for content, why in ((bomb, "more than 100 million pixels"), (b"<svg onload=alert(1)>", "expected a picture")):
        with pytest.raises(uq.InputError, match=why):
            keep_picture(tmp_path, "b.png", content)
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]


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
