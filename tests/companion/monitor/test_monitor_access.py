"""Who gets to see the page, over real sockets, and what the command refuses before it serves."""

import asyncio
import http.client
import urllib.parse
from collections.abc import Iterator
from pathlib import Path

import pytest
from monitor_support import Monitor
from ports import free_endpoint, free_tcp_port
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from companion.cli import main
from companion.commands.monitor import token_for
from companion.monitor.access import Gate

TOKEN = "correct horse battery"
SOCKET_PATH = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    file = tmp_path_factory.mktemp("token") / "token"
    file.write_text(f"{TOKEN}\n")
    port = free_tcp_port()
    # A peer without anybody to talk to serves all the same.
    monitor = Monitor(port, "--connect", free_endpoint(), "--token-file", str(file))
    yield port
    monitor.close()


@pytest.fixture(scope="module")
def open_one() -> Iterator[int]:
    port = free_tcp_port()
    monitor = Monitor(port, "--connect", free_endpoint())
    yield port
    monitor.close()


def ask(
    port: int, method: str, path: str, body: str | None = None, **headers: str
) -> tuple[int, dict[str, str], str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body, named)
    answer = connection.getresponse()
    found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read().decode()
    connection.close()
    return found


def log_in(port: int, token: str) -> tuple[int, str]:
    status, headers, _ = ask(port, "POST", "/login", urllib.parse.urlencode({"token": token}))
    return status, headers.get("set-cookie", "").split(";")[0]


def test_without_the_token_nothing_is_shown(guarded: int) -> None:
    for path in ("/", "/?vehicle=x", "/_nicegui/x.js", "/login", SOCKET_PATH):
        status, _, body = ask(guarded, "GET", path)
        assert status == 401
        assert 'name="token"' in body
        assert "data-field" not in body
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{guarded}{SOCKET_PATH}")


@pytest.mark.parametrize("token", ["", "wrong", TOKEN + "x", TOKEN[:-1], "é", "x" * 10_000])
def test_wrong_tokens_are_refused(guarded: int, token: str) -> None:
    status, cookie = log_in(guarded, token)
    assert (status, cookie) == (401, "")


@pytest.mark.parametrize("cookie", ["landslope_monitor=", f"landslope_monitor={TOKEN}", "x", "=;;=", "é=1"])
def test_made_up_cookies_are_refused(guarded: int, cookie: str) -> None:
    assert ask(guarded, "GET", "/", Cookie=cookie)[0] == 401


def test_the_token_opens_page_and_socket(guarded: int) -> None:
    status, cookie = log_in(guarded, TOKEN)
    assert status == 303
    assert TOKEN not in cookie
    assert ask(guarded, "GET", "/", Cookie=cookie)[0] == 200
    with connect(f"ws://127.0.0.1:{guarded}{SOCKET_PATH}", additional_headers={"Cookie": cookie}) as ws:
        assert str(ws.recv(timeout=30)).startswith("0{")


def test_a_foreign_page_cannot_use_the_socket_or_another_name(guarded: int, open_one: int) -> None:
    _, cookie = log_in(guarded, TOKEN)
    with pytest.raises(InvalidStatus, match="403"):
        connect(
            f"ws://127.0.0.1:{guarded}{SOCKET_PATH}",
            additional_headers={"Cookie": cookie},
            origin="http://elsewhere.example",
        )
    assert ask(open_one, "GET", "/", Host="elsewhere.example")[0] == 403
    assert ask(open_one, "GET", "/", Host=f"localhost:{open_one}")[0] == 200


def test_a_page_for_the_network_needs_a_token(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--connect", free_endpoint()]
    for host in ("0.0.0.0", "::", "192.168.1.5", "example.org"):
        assert main(["monitor", *where, "--host", host]) == 2
        assert "give --token-file" in capsys.readouterr().err
    short = tmp_path / "short"
    short.write_text("secret\n")
    assert main(["monitor", *where, "--token-file", str(short)]) == 2
    assert "6 characters; it needs 12" in capsys.readouterr().err
    assert main(["monitor", *where, "--token-file", str(tmp_path / "none")]) == 2
    assert "cannot be read" in capsys.readouterr().err
    assert token_for("127.0.0.1", None) is None
    assert token_for("::1", None) is None


def test_the_command_refuses_what_cannot_work(
    open_one: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["monitor"]) == 2
    assert "nowhere to look for vehicles" in capsys.readouterr().err
    where = ["--connect", free_endpoint()]
    assert main(["monitor", *where, "--port", str(open_one)]) == 2
    assert "choose another --port" in capsys.readouterr().err
    assert main(["monitor", *where, "--port", "70000"]) == 2
    assert "choose another --port" in capsys.readouterr().err
    assert main(["monitor", *where, "--refresh", "30"]) == 2
    assert "refresh_hz is 30; it must be from 0.5 to 20 Hz" in capsys.readouterr().err
    assert main(["monitor", *where, "--certificate", str(tmp_path)]) == 2
    assert "belong together" in capsys.readouterr().err
    assert main(["monitor", *where, "--foxglove", "--host", "0.0.0.0"]) == 2
    assert "loopback only" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "extra"), [((), "monitor"), (("--foxglove",), "record")])
def test_a_missing_extra_is_named(
    words: tuple[str, ...],
    extra: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["monitor", "--connect", free_endpoint(), *words]) == 2
    assert f"pip install 'landslope[{extra}]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "host", ["[::1", "[]", "a]b", "127.0.0.1:http", "[fe80::1%eth0]:x:y", "\xff\xfe", ""]
)
@pytest.mark.parametrize("token", [None, "secret"])
def test_a_broken_host_header_is_a_bad_request_and_no_fault_of_ours(host: str, token: str | None) -> None:
    sent: list[dict] = []

    async def app(scope, receive, send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message) -> None:
        sent.append(message)

    async def receive() -> dict:
        return {"type": "http.request", "body": b""}

    for kind in ("http", "websocket"):
        headers = [(b"host", host.encode("latin-1")), (b"origin", f"http://{host}".encode("latin-1"))]
        scope = {"type": kind, "path": "/", "method": "GET", "headers": headers}
        asyncio.run(Gate(app, token)(scope, receive, send))
    assert sent[0].get("status") in (400, 401, 403)
    assert sent[-1]["type"] == "websocket.close"
