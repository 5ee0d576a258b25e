"""What strangers, other sites and viewers may not do. No robot is needed: each is refused before one is asked."""

from __future__ import annotations

import json
import os
import resource
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from unittest.mock import patch

import pytest
from dashboard_rig import Browser, Served, served
from navloom_live.operating import web_server
from websockets.exceptions import ConnectionClosed, InvalidStatus

ROBOT = "lab/r1"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A dashboard with a robot that is not up."""
    recordings = tmp_path_factory.mktemp("recordings")
    (recordings / "lab_r1_1.mcap").write_bytes(b"recorded")
    (recordings / "lab_r2_1.mcap").write_bytes(b"another robot's")
    (recordings.parent / "secret.mcap").write_bytes(b"secret")
    folder = tmp_path_factory.mktemp("runtime")
    with patch.dict(os.environ, NAVLOOM_RUNTIME_DIR=str(folder)), served(recordings, ROBOT) as made:
        limit = time.monotonic() + 10.0
        while ROBOT not in made.dashboard.robots and time.monotonic() < limit:
            time.sleep(0.01)
        yield made


SOCKETS = [f"/ws/{ROBOT}", f"/stop/{ROBOT}", f"/teleop/{ROBOT}"]


def refused(browser: Browser, path: str, origin: str = "") -> int:
    """Status with which a websocket is refused."""
    with pytest.raises(InvalidStatus) as told:
        browser.socket(path, origin).close()
    return told.value.response.status_code


# --- other sites --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1"])
def test_a_page_of_another_site_may_not_act_nor_open_a_websocket(site: Served, origin: str) -> None:
    browser = site.browser("operate")
    assert browser.ask(f"/api/{ROBOT}/act", {"act": "cancel"}, Origin=origin).status == 403
    assert [refused(browser, path, origin) for path in SOCKETS] == [403, 403, 403]


def test_a_websocket_without_origin_is_refused(site: Served) -> None:
    import websockets.sync.client as client

    browser = site.browser("operate")
    for path in SOCKETS:
        with pytest.raises(InvalidStatus) as told:
            client.connect(
                f"ws://127.0.0.1:{site.port}{path}", additional_headers={"Cookie": browser.cookie}, legacy=True
            )
        assert told.value.response.status_code == 403


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "localhost.:1",
                                  "a b", "[::1", "127.0.0.1:x", "1.2.3.4@evil"])  # fmt: skip
def test_a_host_name_that_is_not_ours_is_refused_so_that_no_name_can_be_rebound(site: Served, host: str) -> None:
    browser = site.browser("operate")
    for path in ("/", "/api/session", "/page/main.js"):
        assert browser.ask(path, Host=host).status in (400, 403)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST:80", "[::1]:80", "10.0.0.7"])
def test_addresses_and_localhost_are_answered(site: Served, host: str) -> None:
    assert Browser(site.port).ask("/", Host=host).status == 200


def test_an_act_without_the_token_of_its_session_is_refused(site: Served) -> None:
    browser, other = site.browser("operate"), site.browser("operate")
    for csrf in ("", "guess", other.csrf, "é"):
        assert browser.ask(f"/api/{ROBOT}/act", {"act": "cancel"}, X_CSRF_Token=csrf).status == 403


def test_a_form_of_another_site_cannot_log_in_or_act(site: Served) -> None:
    browser = site.browser("operate")
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        assert browser.ask(f"/api/{ROBOT}/act", {"act": "cancel"}, Content_Type=kind).status == 415


def test_every_answer_has_the_policy_that_allows_no_inline_script(site: Served) -> None:
    browser = site.browser("view")
    for path in ("/", "/api/session", "/page/main.js", "/no/such", f"/api/{ROBOT}/doctor"):
        headers = browser.ask(path).headers
        assert "unsafe" not in headers["content-security-policy"]
        assert "default-src 'self'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"


def test_the_cookie_is_neither_read_by_scripts_nor_sent_by_other_sites(site: Served) -> None:
    answer = site.browser().login(site.dashboard.sessions.tokens["view"])
    assert {"HttpOnly", "SameSite=strict"} <= set(answer.headers["set-cookie"].split("; "))


# --- rights -------------------------------------------------------------------------------------------------------


def test_without_a_session_only_the_page_and_the_login_answer(site: Served) -> None:
    stranger = Browser(site.port)
    assert stranger.ask("/").status == 200
    for path in ("/api/session", f"/api/{ROBOT}/params", f"/api/{ROBOT}/doctor", f"/api/{ROBOT}/recordings",
                 f"/api/{ROBOT}/recordings/lab_r1_1.mcap"):  # fmt: skip
        assert stranger.ask(path).status == 401
    assert stranger.act("cancel").status == 401
    assert [refused(stranger, path) for path in SOCKETS] == [401, 401, 401]
    stranger.cookie = f"navloom-{site.port}=guess"
    assert stranger.ask("/api/session").status == 401


def test_a_viewer_sees_but_may_not_act_stop_or_drive(site: Served) -> None:
    viewer = site.browser("view")
    assert viewer.ask("/api/session").body["right"] == "view"
    for act in ("goal", "cancel", "pose", "resume", "swap", "param", "record", "clear", "relocalise", "nonsense"):
        assert viewer.act(act).status == 403
    assert [refused(viewer, path) for path in SOCKETS[1:]] == [403, 403]
    viewer.socket(SOCKETS[0]).close()


def test_a_session_ends_with_logout_and_its_open_pages_are_closed(site: Served) -> None:
    browser = site.browser("operate")
    page = browser.socket(SOCKETS[0])
    assert browser.ask("/api/logout", {}).status == 200
    assert browser.ask("/api/session").status == 401
    with pytest.raises(ConnectionClosed):
        while True:
            page.recv(timeout=10.0)
    assert page.close_code == 4401


def test_ten_wrong_tokens_lock_their_address_out_for_a_while(tmp_path: Path) -> None:
    with served(tmp_path) as site:
        browser = site.browser()
        assert [browser.login("guess").status for _ in range(11)] == [401] * 10 + [429]
        assert browser.login(site.dashboard.sessions.tokens["operate"]).status == 429


def test_a_session_may_act_twenty_times_at_once(site: Served) -> None:
    browser = site.browser("operate")
    found = [browser.act("cancel").status for _ in range(60)]
    assert 429 in found and found[:20] == [409] * 20


# --- paths, names, sizes ------------------------------------------------------------------------------------------

TRICKS = [
    "/page/../app.py", "/page/%2e%2e/app.py", "/page/..%2fapp.py", "/page//etc/passwd", "/page/%2fetc%2fpasswd",
    "/page/main.js%00.txt", "/page/", "/page/.", "/page/../../../../../etc/passwd", "/page/..\\app.py",
    "//page/main.js", f"/api/{ROBOT}/recordings/../secret.mcap", f"/api/{ROBOT}/recordings/..%2fsecret.mcap",
    f"/api/{ROBOT}/recordings/lab_r2_1.mcap", f"/api/{ROBOT}/recordings/%2e%2e%2fsecret.mcap",
    "/api/../r1/recordings/lab_r1_1.mcap", "/api/*/*/recordings/lab_r1_1.mcap",
]  # fmt: skip


@pytest.mark.parametrize("path", TRICKS)
def test_a_path_leads_nowhere_else(site: Served, path: str) -> None:
    assert site.browser("operate").ask(path).status == 404


def test_a_recording_of_the_robot_is_downloaded(site: Served) -> None:
    answer = site.browser("view").ask(f"/api/{ROBOT}/recordings/lab_r1_1.mcap")
    assert (answer.status, answer.body) == (200, b"recorded")
    assert answer.headers["content-disposition"].startswith("attachment")


SCRIPT = "<script>alert(1)</script>"


@pytest.mark.parametrize("act", [
    {"act": SCRIPT}, {"act": "swap", "role": SCRIPT, "instance": SCRIPT},
    {"act": "param", "node": SCRIPT, "name": SCRIPT, "value": SCRIPT},
])  # fmt: skip
def test_script_in_a_name_comes_back_as_json_text_only(site: Served, act: dict[str, str]) -> None:
    answer = site.browser("operate").ask(f"/api/{ROBOT}/act", act)
    assert answer.status in (400, 409) and answer.headers["content-type"] == "application/json"
    assert site.browser("operate").ask(f"/api/{SCRIPT}/x/doctor").headers["content-type"] == "application/json"


@pytest.mark.parametrize("body", [b"", b"[1]", b"{", b"\xff", b"[" * 60_000, b'{"act": 1}', b'{"act": null}'])
def test_what_is_no_act_is_refused_with_a_reason(site: Served, body: bytes) -> None:
    answer = site.browser("operate").ask(f"/api/{ROBOT}/act", body)
    assert answer.status == 400 and answer.body["error"]


def test_a_request_of_100_mb_is_refused_before_it_is_read(site: Served) -> None:
    browser = site.browser("operate")
    with socket.create_connection(("127.0.0.1", site.port), timeout=10.0) as raw:
        head = (f"POST /api/{ROBOT}/act HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: {browser.cookie}\r\nX-CSRF-Token: "
                f"{browser.csrf}\r\nContent-Type: application/json\r\nContent-Length: 100000000\r\n\r\n")  # fmt: skip
        raw.sendall(head.encode() + b" " * 200_000)
        assert raw.recv(4096).startswith(b"HTTP/1.1 413")


@pytest.mark.parametrize("path", SOCKETS)
def test_a_websocket_message_of_100_mb_ends_its_connection(site: Served, path: str) -> None:
    opened = site.browser("operate").socket(path)
    raw = opened.socket
    # The head of a frame of 100 MB, and its first bytes: nobody waits for the rest.
    raw.sendall(bytes([0x81, 0xFF]) + struct.pack(">Q", 100_000_000) + b"\0\0\0\0" + b"x" * 1000)
    with pytest.raises(ConnectionClosed):
        while True:
            opened.recv(timeout=10.0)
    assert opened.close_code == 1009


@pytest.mark.parametrize("path", SOCKETS)
@pytest.mark.parametrize("said", [b"\0\1", "nonsense", "[]"], ids=["binary", "no_json", "no_object"])
def test_nonsense_on_a_websocket_harms_no_other(site: Served, path: str, said: str | bytes) -> None:
    operator = site.browser("operate")
    with operator.socket(SOCKETS[1]) as stop, operator.socket(path) as strange:
        strange.send(said)
        stop.send(json.dumps({"n": 1}))
        while "n" not in json.loads(stop.recv(timeout=60.0)):
            pass


def test_a_head_that_does_not_end_is_given_up(site: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_server, "HEAD_WAIT", 0.2)
    with socket.create_connection(("127.0.0.1", site.port), timeout=10.0) as slow:
        slow.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n")
        assert slow.recv(1) == b""


def test_a_head_of_a_megabyte_is_refused(site: Served) -> None:
    with socket.create_connection(("127.0.0.1", site.port), timeout=10.0) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\nX: " + b"x" * 60_000)
        assert raw.recv(4096).startswith(b"HTTP/1.1 400")


def test_ten_thousand_connections_keep_no_one_out(site: Served) -> None:
    count = 10_000
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < count + 1000:
        pytest.skip(f"this host allows {hard} open files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, count + 1000), hard))
    operator = site.browser("operate")
    stop = operator.socket(SOCKETS[1], ping_interval=None)
    with ExitStack() as held:
        for number in range(count):
            one = held.enter_context(socket.create_connection(("127.0.0.1", site.port), timeout=60.0))
            if number % 2:
                with suppress(OSError):  # it may have been closed for a newer one
                    one.sendall(b"GET / HTTP/1.1\r\n")
        assert site.server.connections <= web_server.CONNECTIONS + 1  # one more has just come, and another goes
        stop.send(json.dumps({"n": 7}))
        while "n" not in (said := json.loads(stop.recv(timeout=60.0))):
            pass
        assert said["n"] == 7
        assert site.browser("view").ask("/api/session").status == 200
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    stop.close()
