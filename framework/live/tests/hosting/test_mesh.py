"""Two processes of one host beside a router, with real sessions: which messages reach each, and by which link."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from tempfile import TemporaryDirectory

import pytest
from navloom.messages import Command, Path
from navloom_live.hosting.network import Network
from navloom_live.hosting.process_setup import link_from_json, link_to_json
from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.transport.links import Link
from navloom_live.transport.quality_of_service import quality_of
from navloom_live.transport.sender import MOST, Sender
from navloom_live.transport.zenoh_bus import Bus, Question

SOON = 20.0
SHARES = {"drive": [("controller", "law")], "safe": [("gate", "main")]}
STREAM, AWAY = "lab/r1/controller/law/command", "lab/r1/planner/astar/path"


def until(condition: Callable[[], object], again: Callable[[], None] = lambda: None) -> None:
    limit = time.monotonic() + SOON
    while not condition():
        assert time.monotonic() < limit
        again()
        time.sleep(0.01)


@dataclass
class Host:
    """One host of a robot with a router, by plain TCP on loopback."""

    end: str
    folder: RobotFolder
    stack: contextlib.ExitStack
    said: list[str] = field(default_factory=list)

    def network(self, is_whole: bool) -> Network:
        return Network("lab", "r1", self.end, is_whole=is_whole)

    def processes(self, is_whole: bool = False) -> tuple[Bus, Bus]:
        """`drive` and `safe`."""
        links = self.network(is_whole).links(self.folder, SHARES)
        opened: dict[str, Bus] = {}

        def open_one(name: str) -> None:
            opened[name] = Bus(links[name], say=self.said.append)

        threads = [threading.Thread(target=open_one, args=(name,)) for name in links]
        for thread in threads:  # each waits for the other
            thread.start()
        for thread in threads:
            thread.join()
        for bus in opened.values():
            self.stack.enter_context(bus)
        return opened["drive"], opened["safe"]

    def router(self) -> Bus:
        return self.stack.enter_context(Bus(Link("router", (self.end,), ())))

    def elsewhere(self) -> Bus:
        """A session on another host, or of a tool."""
        return self.stack.enter_context(Bus(Link("client", (), (self.end,))))


@pytest.fixture
def host(monkeypatch: pytest.MonkeyPatch) -> Iterator[Host]:
    with contextlib.ExitStack() as stack:
        short = stack.enter_context(TemporaryDirectory(prefix="nl", dir="/tmp"))  # the path of a socket is limited
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", short)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        folder = RobotFolder("lab", "r1")
        folder.make()
        yield Host(f"tcp/127.0.0.1:{port}", folder, stack)


class Ear:
    """Messages of a stream that a process receives."""

    def __init__(self, bus: Bus, key: str) -> None:
        self.heard: list[bytes | None] = []
        bus.subscribe(key, lambda key, data, label: self.heard.append(data))


def test_streams_of_this_host_bypass_the_router_and_others_come_only_by_it(host: Host) -> None:
    host.router()
    drive, safe = host.processes()
    stranger = host.elsewhere()
    own, away, everything = Ear(safe, STREAM), Ear(safe, AWAY), Ear(safe, "lab/r1/**")
    tool = Ear(stranger, STREAM)
    command, path = drive.publication(STREAM, quality_of(Command), True), stranger.publication(AWAY, quality_of(Path))
    forged = stranger.publication(STREAM, quality_of(Command), True)
    until(lambda: own.heard and tool.heard, lambda: command.put(b"begin", ""))
    until(lambda: away.heard, lambda: path.put(b"begin", ""))
    for ear in (own, away, everything, tool):
        ear.heard.clear()
    for number in range(20):
        forged.put(b"forged", "")
        command.put(b"%d" % number, "")
        path.put(b"%d" % number, "")
    numbers = [b"%d" % number for number in range(20)]
    until(lambda: numbers[-1] in own.heard and numbers[-1] in away.heard and len(everything.heard) >= 40)
    assert own.heard[-20:] == numbers == away.heard[-20:]
    assert b"forged" not in own.heard + everything.heard
    until(lambda: numbers[-1] in tool.heard)
    assert [data for data in tool.heard if data != b"begin"] == numbers


def test_a_token_of_this_host_comes_from_its_process_alone_and_is_visible_elsewhere(host: Host) -> None:
    host.router()
    drive, safe = host.processes()
    stranger = host.elsewhere()
    changes: list[tuple[str, bool]] = []
    safe.watch("lab/r1/*/*/alive/*", lambda key, alive: changes.append((key, alive)))
    stranger.announce("lab/r1/controller/law/alive/forged")
    drive.announce("lab/r1/controller/law/alive/1")
    stranger.announce("lab/r1/planner/astar/alive/1")
    expected = {("lab/r1/controller/law/alive/1", True), ("lab/r1/planner/astar/alive/1", True)}
    until(lambda: set(changes) >= expected)
    assert set(changes) == expected
    assert safe.alive("lab/r1/controller/*/alive/*") == ["lab/r1/controller/law/alive/1"]
    until(lambda: "lab/r1/controller/law/alive/1" in stranger.alive("lab/r1/**"))


def test_a_query_is_answered_once_by_either_link(host: Host) -> None:
    host.router()
    drive, safe = host.processes()
    stranger = host.elsewhere()
    for bus, name in ((drive, "drive"), (safe, "safe"), (stranger, "think")):

        def answer(question: Question, name: str = name) -> None:
            question.answer(f"lab/r1/process/{name}/memory", name.encode())

        bus.serve(f"lab/r1/process/{name}/memory", answer)

    def answers(bus: Bus, key: str) -> list[bytes]:
        return sorted(answer.data for answer in bus.ask(key))

    until(lambda: answers(stranger, "lab/r1/process/drive/memory") == [b"drive"])
    until(lambda: answers(safe, "lab/r1/process/*/memory") == [b"drive", b"safe", b"think"])
    assert answers(safe, "lab/r1/process/drive/memory") == [b"drive"]
    assert answers(stranger, "lab/r1/process/*/memory") == [b"drive", b"safe", b"think"]


def test_the_processes_of_a_host_go_on_when_the_router_dies(host: Host) -> None:
    router = host.router()
    drive, safe = host.processes()
    changes: list[tuple[str, bool]] = []
    ear, command = Ear(safe, STREAM), drive.publication(STREAM, quality_of(Command), True)
    drive.announce("lab/r1/controller/law/alive/1")
    safe.watch("lab/r1/*/*/alive/*", lambda key, alive: changes.append((key, alive)))
    until(lambda: ear.heard and changes, lambda: command.put(b"begin", ""))
    router.close()
    sent = 0
    while not (drive.losses and safe.losses):
        command.put(b"%d" % sent, "")
        sent += 1
        time.sleep(0.01)
    until(lambda: ear.heard[-1] == b"%d" % (sent - 1))
    assert [data for data in ear.heard if data != b"begin"] == [b"%d" % number for number in range(sent)]
    host.router()
    stranger = host.elsewhere()
    late = Ear(stranger, STREAM)
    until(lambda: late.heard, lambda: command.put(b"again", ""))
    until(lambda: stranger.alive("lab/r1/**"))
    assert changes == [("lab/r1/controller/law/alive/1", True)]


def test_a_robot_on_one_host_does_not_wait_for_its_router_and_joins_it_later(host: Host) -> None:
    began = time.monotonic()
    drive, safe = host.processes(is_whole=True)
    ear, command = Ear(safe, STREAM), drive.publication(STREAM, quality_of(Command))
    until(lambda: ear.heard, lambda: command.put(b"begin", ""))
    assert time.monotonic() - began < SOON / 4
    assert not drive.has_router()
    until(lambda: any("the robot cannot be reached from other hosts" in text for text in host.said))
    host.router()
    late = Ear(host.elsewhere(), STREAM)
    until(lambda: late.heard, lambda: command.put(b"again", ""))
    assert drive.losses == 0 and len(host.said) <= 2


def test_a_link_with_its_mesh_is_handed_to_a_process_as_json(host: Host) -> None:
    (link, _) = host.network(False).links(host.folder, SHARES).values()
    assert link.mesh is not None and link.mesh.here == ("controller/law", "gate/main", "process/drive", "process/safe")
    assert link_from_json(link_to_json(link)) == link
    assert link.is_spread and not host.network(True).outsider(host.folder, SHARES).is_spread


def test_handing_over_does_not_block_and_an_overflow_sends_the_newest_in_order() -> None:
    sender, goes_on, sent = Sender(), threading.Event(), list[int]()

    def send(number: int) -> None:
        goes_on.wait(SOON)
        sent.append(number)

    began = time.monotonic()
    sender.hand(partial(send, -1), 0)
    for number in range(5):
        sender.hand(partial(send, number), MOST // 4)
    assert time.monotonic() - began < SOON / 4
    goes_on.set()
    until(lambda: sent and sent[-1] == 4)
    assert [number for number in sent if number >= 0] == [1, 2, 3, 4]
    sender.close()
