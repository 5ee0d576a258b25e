"""Which links are refused, the settings of the others, and that a broken link reconnects by itself."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import zenoh
from navloom_live.hosting.network import Network
from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.transport.access import IDENTITIES
from navloom_live.transport.certificate_folder import new_authority
from navloom_live.transport.certificates import HOSTS, CertificateRequest
from navloom_live.transport.links import Endpoint, Link, LinkError, peer_link, settings

SOON = 10.0
BEAT = """
import json, sys, threading, zenoh
ending = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), ending.set()), daemon=True).start()
with zenoh.open(zenoh.Config.from_json5(sys.argv[1])) as session:
    stream = session.declare_publisher("lab/r1/test/main/beat")
    while not ending.wait(0.01):
        stream.put(sys.argv[2].encode())
"""


@pytest.fixture
def credentials(tmp_path: Path) -> Path:
    folder = tmp_path / "keys"
    new_authority(folder, CertificateRequest("lab", "r1", HOSTS, 30, datetime.now(UTC)))
    return folder


def refusal(link: Link) -> str:
    with pytest.raises(LinkError) as caught:
        settings(link)
    return str(caught.value)


# --- endpoints ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "protocol", "host", "port", "is_local", "is_wildcard"),
    [
        ("tcp/127.0.0.1:7447", "tcp", "127.0.0.1", 7447, True, False),
        ("tcp/localhost:7447", "tcp", "localhost", 7447, True, False),
        ("tcp/[::1]:1", "tcp", "::1", 1, True, False),
        ("udp/127.1.2.3:65535", "udp", "127.1.2.3", 65535, True, False),
        ("tcp/0x7f.1:7447", "tcp", "0x7f.1", 7447, True, False),
        ("tcp/[::ffff:127.0.0.1]:7447", "tcp", "::ffff:127.0.0.1", 7447, True, False),
        ("tls/10.0.0.1:7447?prio=1-3", "tls", "10.0.0.1", 7447, False, False),
        ("tcp/base.local:7447", "tcp", "base.local", 7447, False, False),
        ("tcp/localhost.example.com:7447", "tcp", "localhost.example.com", 7447, False, False),
        ("tcp/[fe80::1%eth0]:7447", "tcp", "fe80::1%eth0", 7447, False, False),
        ("tcp/0.0.0.0:7447", "tcp", "0.0.0.0", 7447, False, True),
        ("tcp/0:7447", "tcp", "0", 7447, False, True),
        ("tcp/*:7447", "tcp", "*", 7447, False, True),
        ("tcp/[::]:7447", "tcp", "::", 7447, False, True),
        ("tcp/[0:0::0]:7447", "tcp", "0:0::0", 7447, False, True),
        ("tcp/[::ffff:0.0.0.0]:7447", "tcp", "::ffff:0.0.0.0", 7447, False, True),
        ("unixsock-stream//run/x/a.sock", "unixsock-stream", "/run/x/a.sock", 0, True, False),
    ],
)
def test_an_endpoint_is_parsed(
    text: str, protocol: str, host: str, port: int, is_local: bool, is_wildcard: bool
) -> None:
    end = Endpoint.parse(text)
    assert (end.protocol, end.host, end.port) == (protocol, host, port)
    assert (end.is_local, end.is_wildcard) == (is_local, is_wildcard)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "unknown protocol"),
        ("10.0.0.1:7447", "unknown protocol"),
        ("ws/127.0.0.1:7447", "unknown protocol 'ws', expected tls/HOST:PORT"),
        ("tcp/127.0.0.1", "with a port of 1 to 65535"),
        ("tcp/127.0.0.1:", "with a port of 1 to 65535"),
        ("tcp/127.0.0.1:0", "with a port of 1 to 65535"),
        ("tcp/127.0.0.1:65536", "with a port of 1 to 65535"),
        ("tcp/:7447", "expected tcp/HOST:PORT"),
        ("tls/::1:7447", "tls/[::1]:7447"),
        ("tls/10.0.0.1:7447#verify_name_on_connect=false", "settings after # are not taken"),
        ("tcp/127.0.0.1:7447?rel=0", "expected prio=1-3"),
        ("unixsock-stream/run/a.sock", "expected an absolute path"),
    ],
)
def test_a_text_that_is_no_endpoint_is_refused_with_the_text(text: str, words: str) -> None:
    message = refusal(Link("peer", (), (text,)))
    assert words in message and repr(text) in message


# --- refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("insecure", [False, True])
@pytest.mark.parametrize("text", ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/*:7447", "udp/0:7447"])
def test_listening_on_every_interface_needs_tls(text: str, insecure: bool) -> None:
    assert "every interface needs TLS" in refusal(Link("router", (text,), insecure=insecure))


@pytest.mark.parametrize("protocol", ["tcp", "udp"])
def test_plain_links_to_other_hosts_are_refused_unless_requested(protocol: str) -> None:
    end = f"{protocol}/10.0.0.1:7447"
    for link in (Link("router", (end,)), Link("client", (), (end,))):
        message = refusal(link)
        assert "navloom keys new" in message and "tls/10.0.0.1:7447" in message and "--insecure" in message
    assert settings(Link("router", (end,), insecure=True))["listen"]["endpoints"] == [end]


def test_connecting_to_every_interface_is_refused() -> None:
    assert "address of one host" in refusal(Link("client", (), ("tcp/0.0.0.0:7447",), insecure=True))


def test_a_mode_that_does_not_exist_is_refused() -> None:
    assert "peer, client, router" in refusal(Link("broker"))


def test_tls_needs_certificates(credentials: Path) -> None:
    end = "tls/127.0.0.1:7447"
    assert "navloom keys new" in refusal(Link("client", (), (end,)))
    assert "navloom keys new" in refusal(Link("client", (), (end,), credentials))


@pytest.mark.parametrize("name", ["ca.pem", "viewer.pem", "viewer-key.pem"])
def test_a_missing_or_unreadable_certificate_file_is_named(credentials: Path, name: str) -> None:
    link = Link("client", (), ("tls/127.0.0.1:7447",), credentials, "viewer")
    path = credentials / name
    path.unlink()
    assert f"{path}: No such file" in refusal(link)
    path.mkdir()
    assert f"{path}: Is a directory" in refusal(link)
    path.rmdir()
    path.write_text("nothing", "utf-8")
    assert f"{path}: not in PEM form" in refusal(link)


def test_an_unknown_identity_is_refused_with_the_known_ones(credentials: Path) -> None:
    message = refusal(Link("client", (), ("tls/127.0.0.1:7447",), credentials, "alice"))
    assert "alice.pem" in message and "nodes, operator, router, viewer" in message


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620])
def test_a_private_key_that_others_can_use_is_refused_with_what_to_run(credentials: Path, mode: int) -> None:
    key = credentials / "viewer-key.pem"
    key.chmod(mode)
    message = refusal(Link("client", (), ("tls/127.0.0.1:7447",), credentials, "viewer"))
    assert f"`chmod 600 {key}`" in message and f"{mode:04o}" in message


def test_a_socket_in_a_folder_that_others_can_enter_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "open"
    folder.mkdir()
    folder.chmod(0o755)
    assert f"`chmod 700 {folder}`" in refusal(Link("peer", (f"unixsock-stream/{folder}/a.sock",)))
    assert "No such file" in refusal(Link("peer", (f"unixsock-stream/{folder}/b/a.sock",)))


def test_a_listener_with_tls_has_rules_or_does_not_open(credentials: Path) -> None:
    link = Link("router", ("tls/0.0.0.0:7447",), (), credentials, "router")
    assert settings(link)["access_control"]["default_permission"] == "deny"
    assert "lab/r1" in refusal(Link("router", link.listen, (), credentials, "router", robot="r2"))
    beside = Link("router", (*link.listen, "tcp/127.0.0.1:7448"), (), credentials, "router")
    assert "beside TLS" in refusal(beside)
    (credentials / IDENTITIES).write_text("{}", "utf-8")
    assert "not a list of identities" in refusal(link)
    (credentials / IDENTITIES).unlink()
    assert IDENTITIES in refusal(link)


# --- settings -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["peer", "client", "router"])
def test_scouting_is_off_and_no_other_endpoint_is_listened_on(mode: str) -> None:
    found = settings(Link(mode, (), ("tcp/127.0.0.1:7447",)))
    assert found["scouting"]["multicast"] == found["scouting"]["gossip"] == {"enabled": False}
    assert found["listen"]["endpoints"] == []
    assert found["adminspace"] == found["timestamping"] == {"enabled": False}


def test_a_link_to_another_host_is_two_links_with_small_buffers(credentials: Path) -> None:
    end = "tls/10.0.0.1:7447"
    found = settings(Link("client", (), (end,), credentials, "nodes"))
    ends = {"strategy": "allOf", "locators": [f"{end}?prio=0-3", f"{end}?prio=4-7"]}
    assert found["connect"]["endpoints"] == [ends]
    assert found["transport"]["unicast"]["max_links"] == 2
    assert found["transport"]["link"]["tls"]["so_sndbuf"] == 65536
    local = settings(Link("client", (), ("tcp/127.0.0.1:7447",)))["transport"]
    assert local["unicast"]["max_links"] == 1 and local["link"]["tcp"] == {}


def test_zenoh_takes_every_setting(credentials: Path, tmp_path: Path) -> None:
    tls, plain = "tls/10.0.0.1:7447", "tcp/10.0.0.1:7447"
    links = (
        Link("router", (tls,), (), credentials, "router"),
        Link("client", (), (tls,), credentials, "nodes"),
        Link("peer", (plain,), (plain,), insecure=True),
        Link("peer", (f"unixsock-stream/{tmp_path}/a.sock",), (f"unixsock-stream/{tmp_path}/b.sock",)),
    )
    for link in links:
        given = settings(link)
        taken = zenoh.Config.from_json5(json.dumps(given))
        for place, value in leaves(given):
            assert_holds(taken, place, value)


def leaves(tree: dict[str, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        if isinstance(value, dict) and value:
            yield from leaves(value, f"{place}{name}/")
        elif not isinstance(value, (dict, list)):
            yield f"{place}{name}", value


def assert_holds(config: zenoh.Config, place: str, value: Any) -> None:
    """Check that the configuration contains every setting: Zenoh silently drops unknown keys in some places."""
    found: Any = json.loads(str(config))
    for name in place.split("/"):
        assert isinstance(found, dict) and name in found, f"{place}: {name} is not known"
        found = found[name]
    assert found == value or (isinstance(found, dict) and value in found.values()), place


# --- reconnecting ---------------------------------------------------------------------------------------------------


@contextmanager
def beating(link: Link, text: str) -> Iterator[subprocess.Popen[str]]:
    """A process at the other end of the link that publishes."""
    process = subprocess.Popen(
        [sys.executable, "-c", BEAT, json.dumps(settings(link)), text], stdin=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdin is not None
        process.stdin.close()


class Listening:
    """Waits for a text on any key of the robot."""

    def __init__(self) -> None:
        self._heard: set[str] = set()
        self._news = threading.Condition()

    def take(self, sample: zenoh.Sample) -> None:
        with self._news:
            self._heard.add(sample.payload.to_string())
            self._news.notify_all()

    def has(self, text: str) -> bool:
        with self._news:
            return self._news.wait_for(lambda: text in self._heard, SOON)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def by_socket(folder: Path) -> str:
    return f"unixsock-stream/{folder}/beat.sock"


def by_tcp(folder: Path) -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.mark.parametrize("mode", ["peer", "client"])
@pytest.mark.parametrize("way", [by_socket, by_tcp])
def test_a_link_reconnects_after_the_other_side_was_killed(
    way: Callable[[Path], str], mode: str, tmp_path: Path
) -> None:
    end = way(tmp_path)
    far, near = Link("peer", (end,)), Link(mode, (), (end,))
    listening = Listening()
    with beating(far, "first") as process, zenoh_session(near, process) as session:
        handler = zenoh.handlers.Callback(listening.take, indirect=False)
        stream = session.declare_subscriber("lab/r1/**", handler)
        assert listening.has("first")
        process.kill()
        process.wait()
        if end.startswith("unix"):  # SIGKILL leaves the socket; it must not prevent a restart
            assert Path(re.sub(r"^unixsock-stream/", "", end)).exists()
        with beating(far, "second"):
            assert listening.has("second")
        stream.undeclare()


@contextmanager
def zenoh_session(link: Link, other: subprocess.Popen[str]) -> Iterator[zenoh.Session]:
    """Open a session, in any mode, that waits for the other side."""
    given = settings(link)
    given["connect"]["timeout_ms"] = int(SOON * 1000)
    assert other.poll() is None
    with zenoh.open(zenoh.Config.from_json5(json.dumps(given))) as session:
        yield session


def test_of_two_neighbours_only_one_connects_to_the_other() -> None:
    names = ["unixsock-stream//run/robot.sock", "unixsock-stream//run/think.sock", "unixsock-stream//run/drive.sock"]
    links = [peer_link(own, names, "lab", "r1") for own in names]
    calls = [(link.listen[0], end) for link in links for end in link.connect]
    assert len(calls) == 3 and {frozenset(call) for call in calls} == {
        frozenset((name, other)) for name in names for other in names if name != other
    }
    assert all(link.peers == 2 for link in links)


DRIVE = {"drive": [("controller", "law")]}


def test_processes_share_memory_where_the_config_says_so_and_readers_never(monkeypatch: pytest.MonkeyPatch) -> None:
    with tempfile.TemporaryDirectory(prefix="nl", dir="/tmp") as short:  # the path of a socket is limited
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", short)
        network, folder = Network("lab", "r1", shared_memory=True), RobotFolder("lab", "r1")
        folder.make()
        (usual,) = Network("lab", "r1").links(folder, DRIVE).values()
        links = usual, network.outsider(folder, DRIVE), network.links(folder, DRIVE)["drive"]
        found = [settings(link)["transport"]["shared_memory"]["enabled"] for link in links]
    assert found == [False, False, True]
