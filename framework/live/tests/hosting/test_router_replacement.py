"""A router that is replaced in operation, with real TLS sessions: nothing is lost, and revoked clients are out."""

from __future__ import annotations

import contextlib
import os
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from cryptography import x509
from navloom.messages import Command
from navloom_live.hosting import router_replacement
from navloom_live.hosting.router_replacement import Router
from navloom_live.operating.client import REQUEST_SPACING
from navloom_live.operating.diagnosis import diagnose
from navloom_live.operating.robot_lookup import join
from navloom_live.transport import connection
from navloom_live.transport.access import Identity
from navloom_live.transport.certificate_folder import add_identity, new_authority, renew, revoke
from navloom_live.transport.certificates import HOSTS, CertificateRequest
from navloom_live.transport.links import Link
from navloom_live.transport.quality_of_service import quality_of
from navloom_live.transport.zenoh_bus import Bus, Question

SOON = 20.0
STREAM = "lab/r1/controller/law/command"
DRIVING = "lab/r1/operator/main/command"
STATUS = "lab/r1/gate/main/status"
SERVICE = "lab/r1/goal/main/submit"


def until(claim: Callable[[], object], what: str) -> None:
    limit = time.monotonic() + SOON
    while not claim():
        assert time.monotonic() < limit, what
        time.sleep(0.01)


class Net:
    """A router on loopback that watches its files, and the clients that join it."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack) -> None:
        self.folder, self._stack = folder, stack
        new_authority(folder, CertificateRequest("lab", "r1", HOSTS, 20, datetime.now(UTC)))
        add_identity(folder, Identity("bob", "operator"), (), 20, datetime.now(UTC))
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.end = f"tls/127.0.0.1:{self.port}"
        self.said: list[str] = []
        self.ending = threading.Event()
        self.router = stack.enter_context(Router(Link("router", (self.end,), (), folder, "router"), self.said.append))

    def join(self, identity: str) -> Bus:
        """A client that joins until the end of the test."""
        return self._stack.enter_context(Bus(Link("client", (), (self.end,), self.folder, identity)))

    def take_new_files(self) -> None:
        """Let the router check its files until it has taken them."""
        before = len(self.said)
        until(lambda: self.router.look(self.ending) or len(self.said) > before, "the router takes the new files")

    def shown(self) -> x509.Certificate:
        """Certificate that its listener presents now."""
        context = ssl.create_default_context(cafile=str(self.folder / "ca.pem"))
        context.load_cert_chain(self.folder / "nodes.pem", self.folder / "nodes-key.pem")
        with (
            socket.create_connection(("127.0.0.1", self.port), 5.0) as plain,
            context.wrap_socket(plain, server_hostname="127.0.0.1") as secure,
        ):
            shown = secure.getpeercert(binary_form=True)
        assert shown is not None
        return x509.load_der_x509_certificate(shown)


@pytest.fixture
def net(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Net]:
    monkeypatch.setattr(connection, "CERTIFICATE_CHECK_INTERVAL", 0.05)
    monkeypatch.setattr(connection, "SESSION_SPREAD", 0.0)
    monkeypatch.setattr(connection, "SESSION_LINGER", 0.5)
    monkeypatch.setattr(router_replacement, "ROUTER_REPLACED_WITHIN", 2.0)
    with contextlib.ExitStack() as stack:
        short = stack.enter_context(TemporaryDirectory(prefix="nl", dir="/tmp"))  # the path of a socket is limited
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", short)
        yield Net(tmp_path / "keys", stack)


class Stream:
    """Numbers that one process publishes and another receives."""

    def __init__(self, sender: Bus, hearer: Bus) -> None:
        self.heard: list[int] = []
        self.sent = 0
        hearer.subscribe(STREAM, lambda key, data, label: self.heard.append(int(data or b"-1")))
        self._publication = sender.publication(STREAM, quality_of(Command), lossless=True)
        until(lambda: self.put() or self.heard, "the first message is heard")
        self._first = self.heard[0]
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def put(self) -> None:
        self._publication.put(str(self.sent).encode(), "")
        self.sent += 1

    def _run(self) -> None:
        while not self._ending.wait(0.005):
            self.put()

    def end(self) -> list[int]:
        """Stop sending, and wait in bounded time for the last number; gives the numbers that should have arrived."""
        self._ending.set()
        self._thread.join()
        with contextlib.suppress(AssertionError):
            until(lambda: self.heard[-1] == self.sent - 1, "the last message is heard")
        return list(range(self._first, self.sent))


def test_a_renewal_reaches_listener_and_clients_and_each_message_arrives_once(net: Net) -> None:
    sender, hearer = net.join("nodes"), net.join("nodes")
    stream = Stream(sender, hearer)
    before = net.shown()
    renew(net.folder, (), (), 60, datetime.now(UTC))
    net.take_new_files()
    until(lambda: sender.moves and hearer.moves, "both went over")
    expected = stream.end()
    assert stream.heard == expected
    assert (sender.losses, hearer.losses) == (0, 0)
    assert net.shown().serial_number != before.serial_number
    assert net.shown().not_valid_after_utc > before.not_valid_after_utc
    assert net.said[-1] == "all connections use the new certificates"


def test_a_process_takes_its_new_certificate_without_the_router(net: Net) -> None:
    sender, hearer = net.join("nodes"), net.join("bob")
    stream = Stream(sender, hearer)
    renew(net.folder, ("bob",), (), 60, datetime.now(UTC))
    until(lambda: hearer.moves, "it went over")
    expected = stream.end()
    assert stream.heard == expected
    assert (sender.moves, hearer.losses) == (0, 0)


def test_a_process_keeps_its_old_certificate_until_the_router_knows_the_new_one(net: Net) -> None:
    sender, hearer = net.join("nodes"), net.join("nodes")
    sender.announce("lab/r1/gate/main/alive/1")
    until(lambda: hearer.alive("lab/r1/gate/main/alive/1"), "it is seen")
    stream = Stream(sender, hearer)
    revoke(net.folder, "nodes", datetime.now(UTC), 60)
    until(lambda: sender.denials and hearer.denials, "both tried")
    assert (sender.moves, hearer.moves) == (0, 0)
    net.take_new_files()
    until(lambda: sender.moves and hearer.moves, "both went over")
    expected = stream.end()
    assert stream.heard == expected
    assert (sender.losses, hearer.losses) == (0, 0)


def test_a_process_that_changes_over_stays_alive_for_others(net: Net) -> None:
    changes: list[tuple[str, bool]] = []
    there, watcher = net.join("nodes"), net.join("nodes")
    there.announce("lab/r1/gate/main/alive/1")
    watcher.watch("lab/r1/*/*/alive/*", lambda key, is_there: changes.append((key, is_there)))
    until(lambda: changes, "it is seen")
    renew(net.folder, (), (), 60, datetime.now(UTC))
    net.take_new_files()
    until(lambda: there.moves and watcher.moves, "both went over")
    there.close()
    until(lambda: len(changes) > 1, "it is seen to go")
    assert changes == [("lab/r1/gate/main/alive/1", True), ("lab/r1/gate/main/alive/1", False)]


def test_a_query_is_answered_at_most_once_while_processes_change_over(net: Net) -> None:
    taken: list[bytes] = []
    server, asker = net.join("nodes"), net.join("operator")

    def answer(question: Question) -> None:
        taken.append(question.data)
        question.answer(SERVICE, question.data)

    server.serve(SERVICE, answer)
    until(lambda: list(asker.ask(SERVICE, b"first")), "it is served")
    renew(net.folder, (), (), 60, datetime.now(UTC))
    renewal = threading.Thread(target=net.take_new_files)
    renewal.start()
    answers: list[list[bytes]] = []
    while len(answers) < 5 or renewal.is_alive() or not (server.moves and asker.moves):
        number = str(len(answers)).encode()
        answers.append([answer.data for answer in asker.ask(SERVICE, number, timeout=0.5)])
        assert answers[-1] in ([number], []), answers[-1]
        assert taken.count(number) <= 1
        time.sleep(REQUEST_SPACING)
    renewal.join()
    assert sum(not answer for answer in answers) <= 2, "one of them may be lost where either side changes over"
    assert [answer.data for answer in asker.ask(SERVICE, b"last")] == [b"last"]


def test_a_revoked_client_neither_sends_nor_receives_while_others_go_on(net: Net) -> None:
    robot, operator, bob = net.join("nodes"), net.join("operator"), net.join("bob")
    heard_by_robot: list[str] = []
    heard_by_bob: list[str] = []
    heard_by_operator: list[str] = []
    robot.subscribe(DRIVING, lambda key, data, label: heard_by_robot.append((data or b"").decode()))
    for bus, heard in ((bob, heard_by_bob), (operator, heard_by_operator)):
        bus.subscribe(STATUS, lambda key, data, label, heard=heard: heard.append((data or b"").decode()))
    robot.serve(SERVICE, lambda question: question.answer(SERVICE, b"done"))
    ways = {who: bus.publication(DRIVING, quality_of(Command)) for who, bus in (("op", operator), ("bob", bob))}
    status = robot.publication(STATUS, quality_of(Command))
    until(lambda: ways["bob"].put(b"bob before", "") or "bob before" in heard_by_robot, "bob may act")
    until(lambda: status.put(b"before", "") or "before" in heard_by_bob, "bob may look")
    until(lambda: list(bob.ask(SERVICE)), "bob may ask")
    revoke(net.folder, "bob", datetime.now(UTC))
    net.take_new_files()
    until(lambda: robot.moves and operator.moves, "the others went over")
    heard_by_bob.clear()
    for number in range(20):
        ways["bob"].put(b"bob after", "")
        status.put(f"after {number}".encode(), "")
        ways["op"].put(f"op {number}".encode(), "")
        time.sleep(0.01)  # the router drops a message that follows another sooner
    until(lambda: "op 19" in heard_by_robot and "after 19" in heard_by_operator, "the operator is heard, and hears")
    assert list(bob.ask(SERVICE, timeout=0.5)) == []
    assert "bob after" not in heard_by_robot and heard_by_bob == []  # half a second after the operator's
    assert [answer.data for answer in operator.ask(SERVICE)] == [b"done"]


def test_files_that_do_not_fit_are_named_and_the_router_keeps_the_old_ones(net: Net) -> None:
    stream = Stream(net.join("nodes"), net.join("nodes"))
    (net.folder / "router.pem").write_bytes((net.folder / "viewer.pem").read_bytes())
    net.take_new_files()
    assert "router-key.pem does not belong to" in net.said[-1] and "old ones stay in use" in net.said[-1]
    expected = stream.end()
    assert stream.heard == expected


def test_a_router_that_took_over_can_be_replaced_as_well(net: Net) -> None:
    client = net.join("nodes")
    before = len(os.listdir("/proc/self/fd"))
    for moves in (1, 2):
        renew(net.folder, ("router",), (), 60, datetime.now(UTC))
        net.take_new_files()
        until(lambda moves=moves: client.moves == moves, "it went over")
    assert client.losses == 0
    assert len(os.listdir("/proc/self/fd")) < before + 30  # the earlier sessions linger


def test_joining_warns_of_certificates_that_expire_soon(net: Net) -> None:
    told: list[str] = []
    with join("lab/r1", net.end, str(net.folder), "viewer", say=told.append):
        pass
    assert len(told) == 1 and "certificates of bob, nodes, operator, router, viewer expire on" in told[0]
    assert f"navloom keys renew {net.folder} bob nodes operator router viewer" in told[0]


def test_doctor_notes_certificates_that_expire_soon(net: Net) -> None:
    found = diagnose("lab/r1", net.end, str(net.folder))
    (note,) = [finding for finding in found.findings if "expire" in finding.what]
    assert note.severity == "note" and "bob, nodes, operator, router, viewer expire on" in note.what
    assert "navloom keys renew" in note.remedy and "a link ends when its certificate does" in note.remedy
