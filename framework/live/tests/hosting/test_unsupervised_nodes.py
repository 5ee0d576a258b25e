"""Nodes that are started one by one: commands find their robot as long as one of them runs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from navloom.cli.main import app
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom_live.hosting import unsupervised_nodes
from navloom_live.hosting.node_claims import Claims
from navloom_live.hosting.runtime_folders import RobotFolder, Running
from navloom_live.hosting.unsupervised_nodes import share_by_hand
from navloom_live.operating.host_faults import left_behind
from navloom_live.operating.robot_lookup import find_robot
from typer.testing import CliRunner

SYSTEM = assemble(load_config("paper"))


@pytest.fixture(autouse=True)
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(unsupervised_nodes, "_refuse_doubles", lambda network, sources: None)
    monkeypatch.setattr(Claims, "take_on", lambda claims, link, now: None)
    monkeypatch.setattr(unsupervised_nodes, "REPRESENT_CHECK_INTERVAL", 0.01)
    with TemporaryDirectory(
        prefix="nl", dir="/tmp"
    ) as folder:  # short: the path of a socket is limited to about a hundred characters
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", folder)
        yield


def until(claim: Callable[[], bool]) -> None:
    limit = time.monotonic() + 10.0
    while not claim():
        assert time.monotonic() < limit
        time.sleep(0.005)


def folder() -> RobotFolder:
    return RobotFolder("lab", "r1")


def test_when_the_process_that_represents_the_robot_ends_another_takes_over() -> None:
    with ExitStack() as second:
        with share_by_hand(SYSTEM, ["platform"], None, None, False) as first:
            until(lambda: folder().read() is not None)
            stands = find_robot(None)
            assert stands.endpoints == first.link.listen and not stands.supervised
            other = second.enter_context(share_by_hand(SYSTEM, ["gate"], None, None, False))
            assert find_robot(None).endpoints == first.link.listen
        until(lambda: folder().read() is not None)
        assert find_robot(None).endpoints == other.link.listen
    assert folder().read() is None and left_behind() == []


def test_behind_a_router_they_are_found_on_their_host_with_their_keys() -> None:
    with share_by_hand(SYSTEM, ["platform"], "tls/10.0.0.1:7447", "keys/base.pem", False) as share:
        until(lambda: folder().read() is not None)
        found = find_robot(None)
        assert share.link.identity == "base"
        assert found.via_router and found.endpoints == ("tls/10.0.0.1:7447",)
        assert found.keys == str(Path("keys").absolute())


def test_a_process_whose_host_runs_here_meets_those_beside_it_by_sockets() -> None:
    hosts = 'live.hosts={base=["robot", "safe"], brain=["think", "drive"]}'
    spread = assemble(load_config("paper", ['live.router="tls/10.0.0.1:7447"', hosts]))
    with share_by_hand(spread, ["safe"], None, "keys/base.pem", False, here=True) as share:
        mesh = share.link.mesh
        assert share.name == "safe" and share.link.identity == "base" and mesh is not None
        assert mesh.link.listen == (folder().socket("safe"),) and mesh.link.connect == (folder().socket("robot"),)
        assert {"gate/main", "process/robot", "process/safe"} < {*mesh.here} and "planner/astar" not in mesh.here
        assert not mesh.is_whole
    with pytest.raises(ConfigError, match=r"gate: --here takes one process of live\.processes"):
        share_by_hand(spread, ["gate"], None, None, False, here=True).__enter__()


def test_behind_a_router_the_robot_can_be_brought_up_beside_them_and_comes_first() -> None:
    with share_by_hand(SYSTEM, ["avoider"], "tls/10.0.0.1:7447", None, False):
        until(lambda: folder().read() is not None)
        place = folder()
        assert place.lock()
        place.clear()
        assert not find_robot(None).supervised
        place.write(Running("lab", "r1", 4711, ("tls/10.0.0.1:7447",), True, "paper", False))
        assert find_robot(None).pid == 4711
        place.leave()
        assert find_robot(None).pid == os.getpid()
    assert folder().read() is None and left_behind() == []


def test_beside_a_supervised_robot_no_node_represents_it() -> None:
    place = folder()
    place.make()
    assert place.lock()
    place.write(Running("lab", "r1", 4711, ("unixsock-stream//x",), False, "paper", False))
    with share_by_hand(SYSTEM, ["avoider"], None, None, False):
        place.unlock()
        time.sleep(0.1)  # several looks
        assert folder().read() is None


def test_down_says_to_end_them_where_they_run() -> None:
    with share_by_hand(SYSTEM, ["platform"], None, None, False):
        until(lambda: folder().read() is not None)
        done = CliRunner().invoke(app, ["down"])
        assert "was not brought up by `navloom up`" in str(done.exception)
        assert "systemctl stop navloom-lab-r1.target" in str(done.exception)
        assert find_robot(None).robot == "r1"
