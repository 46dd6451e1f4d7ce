"""The door of the page: this machine alone, or a token; uploads under names of ours."""

import http.client
import socket

import pytest

import uq_handeye as uq
from uq_handeye.live_session.uploads import keep_upload

pytest.importorskip("viser", reason="viser (extra live) is not installed")
from uq_handeye.live_session.server import Server


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
    for name, content, why in (
        ("page.html", b"x", "Expected a file of poses"), ("robot", b"x", "Expected a file"), ("a.csv", b"", "is empty"),
    ):  # fmt: skip
        with pytest.raises(uq.InputError, match=why):
            keep_upload(tmp_path, "robot", name, content)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["robot.csv", "robot_2.csv"]
