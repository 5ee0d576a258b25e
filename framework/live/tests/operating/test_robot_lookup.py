"""How a tool finds a robot, and which certificate it presents."""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from navloom_live.hosting.network import Network
from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder, Running
from navloom_live.live.requests import CANCEL, GoalNumber
from navloom_live.live.service import Nothing
from navloom_live.operating import robot_lookup
from navloom_live.operating.client import ClientError
from navloom_live.operating.robot_lookup import join, split_name
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.links import LinkError, certificate, peer_link
from navloom_live.transport.zenoh_bus import Bus

ROUTER = "tls/127.0.0.1:9"


@pytest.mark.parametrize(
    "name", ["r1", "lab/", "/r1", "lab/*", "*/r1", "lab/r1/", "lab/r1/gate", "lab/r 1", "l/**", ""]
)
def test_a_text_that_is_no_name_of_one_robot_is_refused(name: str) -> None:
    with pytest.raises(DirectoryError, match="expected REALM/NAME"):
        split_name(name)
    with pytest.raises(DirectoryError, match="expected REALM/NAME"), join(name or "x", "tcp/127.0.0.1:9"):
        pass


def test_a_name_has_two_parts() -> None:
    assert split_name("lab-2/r_1") == ("lab-2", "r_1")


def test_the_certificate_is_the_usual_one_of_a_folder_or_the_file_that_was_named() -> None:
    assert certificate(None, "operator") == (None, None)
    assert certificate(Path("keys"), "operator") == (Path("keys"), "operator")
    assert certificate(Path("keys/alice.pem"), "operator") == (Path("keys"), "alice")
    assert certificate(Path("shadow.avoider.forces.pem"), "nodes") == (Path(), "shadow.avoider.forces")


@pytest.mark.parametrize(
    ("there", "keys", "shown"),
    [
        (("operator", "viewer"), "keys", "viewer.pem"),
        (("operator",), "keys", "operator.pem"),
        (("nodes",), "keys", "viewer.pem"),
        (("operator", "alice"), "keys/alice.pem", "alice.pem"),
    ],
    ids=["viewer", "operator-may-look-too", "neither", "named"],
)
def test_a_tool_presents_the_certificate_of_its_purpose(
    there: tuple[str, ...], keys: str, shown: str, tmp_path: Path
) -> None:
    folder = tmp_path / "keys"
    folder.mkdir(mode=0o700)
    for name in there:
        (folder / f"{name}.pem").write_text("no certificate")
    (folder / "ca.pem").write_text("-----BEGIN CERTIFICATE-----")
    with (
        pytest.raises(LinkError, match=f"certificate file .*/{shown}"),
        join(None, ROUTER, str(tmp_path / keys), "viewer"),
    ):
        pass


def test_processes_present_the_named_certificate_and_the_router_its_own() -> None:
    network = Network("lab", "r1", ROUTER, True, Path("keys/brain.pem"))
    link = network.alone()
    router = network.router_link()
    assert router is not None
    assert (link.credentials, link.identity) == (Path("keys"), "brain")
    assert (router.credentials, router.identity) == (Path("keys"), "router")
    assert network.folder == Path("keys")


def test_a_tool_that_joins_while_a_process_restarts_reaches_it_when_it_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with tempfile.TemporaryDirectory(
        dir="/tmp", prefix="nl"
    ) as short:  # the path of a socket is limited to about 100 characters
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", short)
        folder, keys = RobotFolder("lab", "r1"), KeySpace("lab", "r1")
        folder.make()
        ends = tuple(folder.socket(name) for name in ("robot", "think"))
        running = Running("lab", "r1", os.getpid(), ends, False, "robot.toml", False)
        monkeypatch.setattr(robot_lookup, "find_robot", lambda robot: running)
        robot, think = (replace(peer_link(end, ends, "lab", "r1"), peers=0) for end in ends)
        with Bus(robot), join() as client:
            with pytest.raises(ClientError, match="it is not there"):
                client.call("goal", "main", CANCEL, Nothing(), timeout=0.2)
            with Bus(think) as bus:
                key = keys.port("goal", "main", CANCEL.name)
                bus.serve(key, lambda question: question.answer(key, b'{"goal_id": 1}', "json"))
                bus.announce(keys.alive("goal", "main", "a"))
                assert client.call("goal", "main", CANCEL, Nothing(), timeout=10.0) == GoalNumber(1)


def test_without_keys_no_certificate_is_presented() -> None:
    link = Network("lab", "r1", "tcp/127.0.0.1:9").alone()
    assert (link.credentials, link.identity) == (None, None)
