"""`navloom dashboard` and `navloom up --dashboard` as processes: addresses, TLS, and what a certificate allows."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import urllib.error
import urllib.request
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from dashboard_rig import Browser, frames
from live_rig import EMPTY, up

NAVLOOM = [sys.executable, "-m", "navloom"]


@contextmanager
def dashboard(folder: Path, *options: str) -> Iterator[dict[str, str]]:
    """A dashboard that has printed its addresses, by right."""
    environment = {**os.environ, "NAVLOOM_RUNTIME_DIR": str(folder)}
    child = subprocess.Popen(
        [*NAVLOOM, "dashboard", "--port", "0", *options], env=environment, cwd=folder, stderr=subprocess.PIPE, text=True
    )
    assert child.stderr is not None
    try:
        lines = [child.stderr.readline().split() for _ in range(2)]
        yield {line[1].removesuffix("s:"): line[2] for line in lines}
    finally:
        child.send_signal(signal.SIGINT)
        assert child.wait(20.0) == 0, child.stderr.read()


def test_it_prints_an_address_for_each_right_waits_for_robots_and_ends_on_ctrl_c(tmp_path: Path) -> None:
    with dashboard(tmp_path) as addresses:
        assert set(addresses) == {"operator", "viewer"}
        for right, act in (("operator", "operate"), ("viewer", "view")):
            url, token = addresses[right].split("/#token=")
            browser = Browser(int(url.rpartition(":")[2]))
            assert browser.login(token).body == {"right": act, "csrf": browser.csrf, "robots": []}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--bind", "0.0.0.0"], "anyone on the network could read the tokens; add --tls"),
        (["--bind", "203.0.113.9", "--insecure"], "203.0.113.9:8787: cannot be listened at"),
        (["--tls", "no/such.pem"], "no/such.pem"),
        (["--certificates"], "--certificates: browsers show theirs over TLS only"),
        (["--connect", "tls/10.0.0.1:7447"], "--connect: name the robot"),
    ],
)
def test_what_cannot_be_served_is_refused_with_a_remedy(
    options: list[str], said: str, in_process: Callable[..., tuple[int, str, str]]
) -> None:
    code, _, errors = in_process("dashboard", *options)
    assert code == 2 and said in errors


def test_over_tls_it_shows_the_robots_certificate_and_marks_its_cookie_secure(tmp_path: Path) -> None:
    assert subprocess.run([*NAVLOOM, "keys", "new", "keys", "--host", "localhost"], cwd=tmp_path, check=True)
    with dashboard(tmp_path, "--tls", "keys/router.pem") as addresses:
        url, token = addresses["viewer"].split("/#token=")
        assert url.startswith("https://127.0.0.1:")
        trusted = ssl.create_default_context(cafile=str(tmp_path / "keys" / "ca.pem"))
        there = url.replace("127.0.0.1", "localhost")
        asked = urllib.request.Request(
            f"{there}/api/login", json.dumps({"token": token}).encode(), {"Content-Type": "application/json"}
        )
        with urllib.request.urlopen(asked, context=trusted, timeout=20.0) as answer:
            assert "Secure" in answer.headers["set-cookie"]
        with pytest.raises(urllib.error.URLError, match="CERTIFICATE_VERIFY_FAILED"):
            urllib.request.urlopen(there, timeout=20.0)


def keys_in(folder: Path) -> Path:
    """A folder of certificates of a robot."""
    subprocess.run([*NAVLOOM, "keys", "new", "keys", "--host", "localhost"], cwd=folder, check=True)
    return folder / "keys"


def login_with(url: str, authority: Path, certificate: Path | None) -> str | int:
    """The right that a browser with this certificate gets, or the status of the refusal."""
    context = ssl.create_default_context(cafile=str(authority))
    if certificate is not None:
        context.load_cert_chain(certificate, certificate.with_name(f"{certificate.stem}-key.pem"))
    asked = urllib.request.Request(f"{url}/api/login", b'{"certificate": true}', {"Content-Type": "application/json"})
    try:
        with urllib.request.urlopen(asked, context=context, timeout=20.0) as answer:
            return str(json.load(answer)["right"])
    except urllib.error.HTTPError as refused:
        return refused.code


def test_certificates_of_the_robot_log_in_with_their_right_until_they_are_revoked(tmp_path: Path) -> None:
    keys = keys_in(tmp_path)
    shutil.copytree(keys, tmp_path / "kept")
    with dashboard(tmp_path, "--tls", "keys/router.pem", "--certificates") as addresses:
        url = addresses["viewer"].split("/#token=")[0].replace("127.0.0.1", "localhost")
        got = {
            name: login_with(url, keys / "ca.pem", keys / f"{name}.pem" if name else None)
            for name in ("operator", "viewer", "router", "")
        }
        assert got == {"operator": "operate", "viewer": "view", "router": 401, "": 401}
        subprocess.run([*NAVLOOM, "keys", "revoke", "keys", "operator"], cwd=tmp_path, check=True)
        assert login_with(url, keys / "ca.pem", keys / "viewer.pem") == "view"
        assert login_with(url, keys / "ca.pem", tmp_path / "kept" / "operator.pem") == 401


def test_a_certificate_of_another_authority_does_not_connect(tmp_path: Path) -> None:
    keys = keys_in(tmp_path)
    (tmp_path / "other").mkdir()
    foreign = keys_in(tmp_path / "other")
    with dashboard(tmp_path, "--tls", "keys/router.pem", "--certificates") as addresses:
        url = addresses["viewer"].split("/#token=")[0].replace("127.0.0.1", "localhost")
        with pytest.raises((urllib.error.URLError, ssl.SSLError, ConnectionError)):
            login_with(url, keys / "ca.pem", foreign / "operator.pem")


def test_without_the_option_no_certificate_logs_in(tmp_path: Path) -> None:
    keys = keys_in(tmp_path)
    with dashboard(tmp_path, "--tls", "keys/router.pem") as addresses:
        url = addresses["viewer"].split("/#token=")[0].replace("127.0.0.1", "localhost")
        assert login_with(url, keys / "ca.pem", keys / "operator.pem") == 401


@pytest.mark.parametrize(("certificate", "right", "status"), [("viewer.pem", "view", 409), ("", "operate", 200)])
def test_it_offers_what_its_own_certificate_may_do(certificate: str, right: str, status: int, tmp_path: Path) -> None:
    keys, router = tmp_path / "keys", f"tls/127.0.0.1:{free_port()}"
    subprocess.run([*NAVLOOM, "keys", "new", str(keys)], check=True)
    (tmp_path / "robot.toml").write_text(f'{EMPTY}\n[live]\nrouter = "{router}"\nkeys = "{keys}"\n')
    with up(str(tmp_path / "robot.toml")) as robot:
        robot.wait_for("every node is there")
        given = ("lab/r1", "--connect", router, "--keys", str(keys / certificate))
        with dashboard(Path(robot.environment["NAVLOOM_RUNTIME_DIR"]), *given) as addresses:
            url, token = addresses["operator"].split("/#token=")
            browser = Browser(int(url.rpartition(":")[2]))
            assert browser.login(token).status == 200
            while browser.ask("/api/lab/r1/doctor").status != 200:
                pass
            with browser.socket("/ws/lab/r1") as page:
                assert frames(page, "robot")[0]["right"] == right
                for kind in ("pose", "scan", "state"):
                    assert frames(page, kind)
            answer = browser.act("pose", x=1.0, y=1.0, heading=0.0)
            assert answer.status == status and (status == 200 or "may only look" in answer.body["error"])


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_up_dashboard_serves_the_robot_and_ends_with_it(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(EMPTY)
    with up(str(tmp_path / "robot.toml"), "--dashboard") as robot:
        number = robot.wait_for("dashboard: operators: http://")
        url, token = robot.said[number - 1].split()[-1].split("/#token=")
        robot.wait_for("every node is there")
        browser = Browser(int(url.rpartition(":")[2]))
        assert browser.login(token).status == 200
        while browser.ask("/api/lab/r1/doctor").status != 200:
            pass
        assert browser.ask("/api/session").body["robots"] == ["lab/r1"]
        robot.end()
        with pytest.raises(ConnectionError):
            browser.ask("/")


def test_up_building_dashboard_shows_the_known_map_before_any_goal() -> None:
    with up("building", "--dashboard", "--start-anew", "--set", "navigation.drive=false") as robot:
        number = robot.wait_for("dashboard: operators: http://")
        url, token = robot.said[number - 1].split()[-1].split("/#token=")
        robot.wait_for("every node is there")
        browser = Browser(int(url.rpartition(":")[2]))
        assert browser.login(token).status == 200
        while "lab/r1" not in browser.ask("/api/session").body["robots"]:
            pass
        with browser.socket("/ws/lab/r1") as page:
            (found,) = frames(page, "map")
            assert frames(page, "state")[0]["goal"] is None
        cells = np.frombuffer(zlib.decompress(found["bytes"]), np.int8)
        # A room of 8 m x 10 m with a wall and a door, all of it known.
        assert set(np.unique(cells)) == {0, 100}


def test_up_dashboard_and_barrier_contradict_each_other(in_process: Callable[..., tuple[int, str, str]]) -> None:
    code, _, errors = in_process("up", "paper", "--barrier", "--dashboard")
    assert code == 2 and "leave --barrier out" in errors
