"""Of two processes that would run the same node of a robot, one starts: on one host, and behind one router."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from navloom_live.hosting import node_claims
from navloom_live.hosting.node_claims import Claimant, Claims, claimant_of, elsewhere
from navloom_live.hosting.runtime_folders import DirectoryError
from navloom_live.operating.robot_lookup import find_robot
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.links import Link
from navloom_live.transport.zenoh_bus import Bus

GATE, PLATFORM = ("gate", "main"), ("platform", "sim")
HOLD = """
import os, sys
from navloom_live.hosting.node_claims import Claims
from navloom_live.hosting.runtime_folders import DirectoryError
from navloom_live.transport.keyspace import KeySpace
claims = Claims(KeySpace("lab", os.environ["ROBOT"]), [("gate", "main")], print)
try:
    claims.take_here()
    if "FORK" in os.environ and os.fork() == 0:
        sys.stdin.read()
    print("taken", flush=True)
except DirectoryError as error:
    print(error, flush=True)
sys.stdin.read()
"""
"""Claims the gate, says so, and holds it until its standard input closes."""
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has abstract sockets")


@pytest.fixture
def robot() -> str:
    """A name that no other test uses at the same time: claims are the same for all processes of a user."""
    return f"r{os.getpid()}-{time.monotonic_ns()}"


@contextmanager
def holding(robot: str, **environment: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Another process that claims the gate, and the first line that it says."""
    own = {name: value for name, value in os.environ.items() if not name.endswith("RUNTIME_DIR")}
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD],
        env={**own, **environment, "ROBOT": robot},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None and process.stdout is not None
    try:
        yield process, process.stdout.readline().rstrip()
    finally:
        process.stdin.close()
        process.stdout.close()
        process.kill()
        process.wait()


@linux_only
def test_a_second_process_is_refused_whatever_its_shell_says_of_runtime_folders(robot: str, tmp_path: Path) -> None:
    with holding(robot, XDG_RUNTIME_DIR=str(tmp_path)) as (first, said):
        assert said == "taken"
        with holding(robot, TMPDIR=str(tmp_path)) as (_, refusal):
            assert f"robot lab/{robot}: gate main runs already on host " in refusal
            assert f"process {first.pid}, since 2" in refusal


@linux_only
def test_a_tool_of_another_shell_is_told_where_the_robot_is(
    robot: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("NAVLOOM_RUNTIME_DIR", "XDG_RUNTIME_DIR"):
        monkeypatch.delenv(name, raising=False)
    with holding(robot, XDG_RUNTIME_DIR=str(tmp_path)) as (_, said):
        assert said == "taken" and elsewhere()[f"lab/{robot}"] == tmp_path / "navloom"
        with pytest.raises(DirectoryError, match=f"{robot} is up in the runtime folder {tmp_path}/navloom, which this"):
            find_robot(robot)
        with holding(f"{robot}-apart", NAVLOOM_RUNTIME_DIR=str(tmp_path / "apart")):
            assert f"lab/{robot}-apart" not in elsewhere() and all(name.startswith("lab/") for name in elsewhere())
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        assert f"lab/{robot}" not in elsewhere()


@linux_only
def test_a_killed_process_and_its_forks_leave_no_claim(robot: str) -> None:
    with holding(robot, FORK="1") as (first, said):
        assert said == "taken"
        first.send_signal(signal.SIGKILL)
        first.wait()
        with holding(robot) as (_, again):
            assert again == "taken"


@linux_only
def test_robots_in_runtime_folders_that_were_set_apart_do_not_know_each_other(robot: str, tmp_path: Path) -> None:
    with (
        holding(robot, NAVLOOM_RUNTIME_DIR=str(tmp_path / "a")) as (_, first),
        holding(robot, NAVLOOM_RUNTIME_DIR=str(tmp_path / "b")) as (_, second),
        holding(robot, NAVLOOM_RUNTIME_DIR=str(tmp_path / "x" / ".." / "a")) as (_, third),
    ):
        assert (first, second) == ("taken", "taken") and "runs already" in third


@linux_only
def test_other_nodes_of_the_robot_may_start(robot: str) -> None:
    with Claims(KeySpace("lab", robot), [GATE], print) as one, Claims(KeySpace("lab", robot), [PLATFORM], print) as two:
        one.take_here()
        two.take_here()


@linux_only
def test_another_users_socket_of_that_name_blocks_no_robot(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_claims, "_holder", lambda address: None)  # its files are not shown to this user
    said: list[str] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as foreign:
        foreign.bind(node_claims._address(KeySpace("lab", robot), GATE))
        with Claims(KeySpace("lab", robot), [GATE], said.append) as own:
            own.take_here()
    assert said == [f"another user holds the name of gate main of robot lab/{robot}"]


def test_a_long_name_is_claimed_too() -> None:
    assert len(node_claims._address(KeySpace("lab", "r" * 200), GATE)) < 107


def test_a_claimant_is_read_as_it_was_written() -> None:
    one = Claimant(1700000000.25, "base station/2", 12, "ab")
    assert claimant_of(one.text) == Claimant(1700000000.25, "base_station_2", 12, "ab")
    assert claimant_of("a~b~c~d") is None and claimant_of("") is None


class Net:
    """A router on loopback, whose clients have no other connection."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.end = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        self.link = Link("client", (), (self.end,))
        self.stack = ExitStack()
        self.said: list[str] = []

    def start(self) -> None:
        self.stack.enter_context(Bus(Link("router", (self.end,))))

    def claims(self, *sources: tuple[str, str]) -> Claims:
        """Claims of a host, which end with the test."""
        return self.stack.enter_context(Claims(KeySpace("lab", "r1"), sources or (GATE, PLATFORM), self.said.append))


@pytest.fixture
def net() -> Iterator[Net]:
    found = Net()
    with found.stack:
        yield found


def until(claim: Any) -> None:
    limit = time.monotonic() + 20.0
    while not claim():
        assert time.monotonic() < limit
        time.sleep(0.01)


def test_behind_a_router_a_second_robot_is_refused_with_the_first_ones_host_and_process(net: Net) -> None:
    net.start()
    net.claims().take_on(net.link, now=True)
    with pytest.raises(DirectoryError, match=rf"(gate main|platform sim) runs already on host .*process {os.getpid()}"):
        net.claims().take_on(net.link, now=True)


def test_another_share_of_the_robot_may_start_behind_the_router(net: Net) -> None:
    net.start()
    net.claims(GATE).take_on(net.link, now=True)
    net.claims(PLATFORM).take_on(net.link, now=True)


def test_one_that_has_ended_is_followed_by_the_next(net: Net) -> None:
    net.start()
    with Claims(KeySpace("lab", "r1"), [GATE], print) as first:
        first.take_on(net.link, now=True)
    net.claims(GATE).take_on(net.link, now=True)


@pytest.mark.parametrize("apart", [0.0, 0.05, 0.3])
def test_of_two_that_start_together_exactly_one_goes_on(net: Net, apart: float) -> None:
    net.start()
    outcomes: list[str] = []

    def start(delay: float) -> None:
        time.sleep(delay)
        try:
            net.claims().take_on(net.link, now=True)
            outcomes.append("on")
        except DirectoryError:
            outcomes.append("refused")

    both = [threading.Thread(target=start, args=(delay,)) for delay in (0.0, apart)]
    for thread in both:
        thread.start()
    for thread in both:
        thread.join()
    assert sorted(outcomes) == ["on", "refused"]


def test_behind_a_router_that_comes_late_exactly_one_of_two_goes_on(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(node_claims, "ROUTER_FIND_WAIT", 0.1)
    both = [net.claims(GATE), net.claims(GATE)]
    for one in both:
        one.take_on(net.link, now=True)
    assert not any(one.lost for one in both)
    net.start()
    until(lambda: any(one.lost for one in both))
    assert [bool(one.lost) for one in both].count(True) == 1
    assert net.said  # and both say so, since a robot that drives by then goes on
