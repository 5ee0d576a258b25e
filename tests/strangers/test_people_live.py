"""The same distribution with its nodes in processes: under the barrier, and on the wall clock."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from live_rig import Up, runtime_folder, up
from navloom.config import load_config
from navloom.messages import GateStatus, Message
from navloom.messages.codec import decode
from navloom.runs.episode import run_episode
from navloom_live.operating.navigator import Navigator

SHARES = """live.processes={ robot = ["platform", "localizer"], think = ["mapper", "planner", "goal", "people"],
 drive = ["reference", "controller", "avoider", "recovery", "gate"] }""".replace("\n", "")


class Heard:
    """Keeps the reasons of the gate, and the instances whose other messages were received."""

    def __init__(self, navigator: Navigator) -> None:
        self.reasons: list[str] = []
        self.instances: set[str] = set()
        self.driver = ""
        self._news = threading.Condition()
        for stream in ("gate/main/status", "avoider/polite/command", "people/beacon_tracker/tracks"):
            navigator.client.bus.subscribe(f"lab/r1/{stream}", self._hear)

    def _hear(self, key: str, data: bytes | None, label: str) -> None:
        assert data is not None
        message: Message = decode(data, label)[0]
        with self._news:
            if isinstance(message, GateStatus):
                self.reasons.append(message.reason)
                self.driver = message.instance
            else:
                self.instances.add(key.split("/")[3])
            self._news.notify_all()

    def wait_until_heard(self, instances: set[str], timeout: float = 30.0) -> None:
        """Wait until messages of these instances, and of no other one, have been received."""
        with self._news:
            assert self._news.wait_for(lambda: self.instances == instances, timeout), self.instances

    def wait_for(self, reason: str, timeout: float = 60.0, after: int = 0) -> int:
        """Wait for a status with this reason; returns the number of statuses up to it."""
        with self._news:
            if not self._news.wait_for(lambda: reason in self.reasons[after:], timeout):
                raise AssertionError(f"{reason!r} not heard within {timeout:g} s: {self.reasons[after:]}")
            return after + self.reasons[after:].index(reason) + 1

    def wait_for_news(self, instance: str, timeout: float = 60.0) -> None:
        """Wait for another message of this instance."""
        with self._news:
            self.instances.clear()
            assert self._news.wait_for(lambda: instance in self.instances, timeout), f"{instance} is silent"

    def wait_for_driver(self, instance: str, timeout: float = 60.0) -> None:
        """Wait until the gate says that this instance drives."""
        with self._news:
            assert self._news.wait_for(lambda: self.driver == instance, timeout), f"{self.driver} drives"


@contextmanager
def driving(people: Path, monkeypatch: pytest.MonkeyPatch, *changes: str) -> Iterator[tuple[Up, Heard]]:
    """A robot that drives to a goal, and what it publishes."""
    words = [word for change in changes for word in ("--set", change)]
    with up(str(people), "--set", "navigation.drive=false", "--set", "run.stop_after=600", *words) as robot:
        robot.wait_for("every node is there")
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", robot.environment["NAVLOOM_RUNTIME_DIR"])
        with Navigator() as navigator:
            heard = Heard(navigator)
            navigator.go(0.0, 7.6)
            heard.wait_for("")
            yield robot, heard


def kill(robot: Up, role: str) -> None:
    os.kill(next(node["pid"] for node in robot.json("list") if node["role"] == role), signal.SIGKILL)


def test_under_the_barrier_its_trace_is_that_of_lockstep(people: Path, tmp_path: Path) -> None:
    changes = ("run.stop_after=8.0", "node.people.latency=1.0", SHARES)  # so that the avoider waits for tracks at first
    lockstep = run_episode(load_config(str(people), changes))
    with runtime_folder() as folder:
        robot = Up(
            folder, [str(people), "--barrier", "--json", *(word for change in changes for word in ("--set", change))]
        )
        assert robot.process.stdout is not None
        said = robot.process.stdout.read()
        robot.process.wait(60)
    assert f'"trace_sha256": "{lockstep.log.trace_sha256}"' in said, robot.said


def test_the_robot_drives_on_when_an_optional_tracker_is_killed_and_the_avoider_swapped(
    people: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with driving(people, monkeypatch) as (robot, heard):
        heard.wait_until_heard({"polite", "beacon_tracker"})
        told = robot.json("echo", "people/tracks", "--count", "1")
        assert told["message"]["positions"]["shape"][1] == 2
        flow = robot.json("hz", "people/tracks", "--for", "1")["people/beacon_tracker/tracks"]
        assert flow["messages"] > 5 and flow["malformed"] == 0
        heard_by = {(edge["from"], edge["to"]) for edge in robot.json("graph")["edges"] if edge["received"]}
        assert {
            ("platform/beacon_robot", "people/beacon_tracker"),
            ("people/beacon_tracker", "avoider/polite"),
        } <= heard_by
        since, said = len(heard.reasons), len(robot.said)
        kill(robot, "people")
        robot.wait_for("process nodes was ended by SIGKILL", after=said)
        heard.wait_for_news("beacon_tracker")  # it is back; until then the avoider steers by the last tracks
        heard.wait_for_news("polite")
        assert "improved_vfh is active" in robot.run("swap", "avoider", "improved_vfh").stdout
        heard.wait_for_driver("improved_vfh")
        assert not [reason for reason in heard.reasons[since:] if reason.startswith(("gone", "waits"))]


def test_a_required_tracker_stops_the_robot_with_its_name_until_it_is_back(
    people: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with driving(people, monkeypatch, "node.people.required=true") as (robot, heard):
        since = len(heard.reasons)
        kill(robot, "people")
        stopped = heard.wait_for("gone: people beacon_tracker", after=since)
        heard.wait_for("", after=stopped)
