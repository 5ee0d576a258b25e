"""Each reason why a link does not come up gets its own message."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from navloom_live.transport.access import Identity
from navloom_live.transport.certificate_folder import add_identity, new_authority
from navloom_live.transport.certificates import HOSTS, CertificateRequest
from navloom_live.transport.link_faults import why_not
from navloom_live.transport.links import Link, settings


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    now = datetime.now(UTC)
    made = tmp_path_factory.mktemp("faults") / "keys"
    new_authority(made, CertificateRequest("lab", "r1", HOSTS, 30, now))
    add_identity(made, Identity("old", "operator"), (), 9, now - timedelta(days=9, hours=12))
    add_identity(made, Identity("old-router", "nodes"), HOSTS, 9, now - timedelta(days=9, hours=12))
    add_identity(made, Identity("elsewhere", "nodes"), ("elsewhere.example",), 30, now)
    return made


@pytest.fixture(scope="module")
def router(folder: Path) -> Iterator[str]:
    yield from listening(folder, "router")


def listening(folder: Path, identity: str, now: datetime | None = None) -> Iterator[str]:
    end = f"tls/127.0.0.1:{free_port()}"
    given = settings(Link("router", (end,), (), folder, identity), now)
    with zenoh.open(zenoh.Config.from_json5(json.dumps(given))):
        yield end


def test_a_working_link_has_no_fault(router: str, folder: Path) -> None:
    assert why_not(Link("client", (), (router,), folder, "viewer")) == ""
    assert why_not(Link("router", (router,), (), folder, "router")) == ""


def test_our_own_certificate_has_expired(router: str, folder: Path) -> None:
    assert "old.pem has expired" in why_not(Link("client", (), (router,), folder, "old"))


def test_our_certificate_is_of_another_authority(router: str, folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "keys"
    new_authority(other, CertificateRequest("lab", "r1", HOSTS, 30, datetime.now(UTC)))
    link = Link("client", (), (router,), other, "viewer")
    assert "the certificate shown there is refused" in why_not(link)
    (other / "ca.pem").write_bytes((folder / "ca.pem").read_bytes())
    assert "viewer.pem is of another authority" in why_not(link)


@pytest.mark.parametrize(("identity", "words"), [("old-router", "expired"), ("elsewhere", "IP address mismatch")])
def test_the_routers_certificate_does_not_fit(folder: Path, identity: str, words: str) -> None:
    made = datetime.now(UTC) - timedelta(hours=18 if "old" in identity else 0)
    for end in listening(folder, identity, made):
        message = why_not(Link("client", (), (end,), folder, "viewer"))
        assert words in message and "--host 127.0.0.1" in message


def test_no_process_listens(folder: Path, tmp_path: Path) -> None:
    for end in (f"tls/127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{free_port()}", f"unixsock-stream/{tmp_path}/a.sock"):
        assert "nothing listens there" in why_not(Link("client", (), (end,), folder, "viewer")), end


def test_a_host_that_does_not_exist(folder: Path) -> None:
    link = Link("client", (), ("tls/no-such-host.invalid:7447",), folder, "viewer")
    assert "no host is called no-such-host.invalid" in why_not(link)


def test_the_listener_does_not_speak_tls(folder: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def babble() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(4096)
                connection.sendall(b"220 hello, who are you?\r\n")

        thread = threading.Thread(target=babble, daemon=True)
        thread.start()
        end = f"tls/127.0.0.1:{server.getsockname()[1]}"
        assert "does not speak TLS" in why_not(Link("client", (), (end,), folder, "viewer"))
        thread.join(5.0)


def test_a_host_that_does_not_answer(folder: Path) -> None:
    with socket.socket() as full:  # the queue has one place, which is taken
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        address = full.getsockname()
        with socket.create_connection(address):
            link = Link("client", (), (f"tls/127.0.0.1:{address[1]}",), folder, "viewer")
            assert "does not answer within 0.2 s" in why_not(link, 0.2)
