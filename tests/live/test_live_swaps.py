"""Swaps during a drive: every tick has a command, and two instances never drive at once."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from live_rig import Up, up
from navloom.messages import Command, GateStatus, Selection, StepReport
from navloom.messages.codec import decode
from navloom_live.operating.navigator import Navigator

CONFIG = """
[world]
ref = "paper_gates_obstacle"

[platform]
plugin = "sensors_sim"

[[sensor]]
name = "laser"
kind = "pitched_laser"
geometry = "paper"

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[navigation]
drive = false
start = {{ x = 0.0, y = 0.0, heading_deg = 90.0 }}
speed = [{speed}, {speed}]
handover = "{handover}"

[run]
stop_after = 600.0

[[alternative]]
name = "forces"
role = "avoider"
plugin = "vff"
shadow = true
"""


class Listener:
    """Keeps every command, step, selection and status of the gate."""

    def __init__(self, navigator: Navigator) -> None:
        self.commands: list[tuple[int, int]] = []
        self.statuses: list[GateStatus] = []
        self.selections: list[Selection] = []
        self.stepped: set[int] = set()
        self.lock = threading.Lock()
        for port in ("command", "status", "selection", "step"):
            navigator.client.bus.subscribe(f"lab/r1/gate/main/{port}", self.hear)

    def hear(self, key: str, data: bytes | None, label: str) -> None:
        assert data is not None
        message, envelope = decode(data, label)
        with self.lock:
            if isinstance(message, Command):
                self.commands.append((envelope.tick, envelope.epoch))
            elif isinstance(message, GateStatus):
                self.statuses.append(message)
            elif isinstance(message, Selection):
                self.selections.append(message)
            elif isinstance(message, StepReport) and message.trigger == "tick":
                self.stepped.add(envelope.tick)


def swap_while_driving(robot: Up, swaps: int, goal: tuple[float, float]) -> tuple[Listener, str, tuple[int, int]]:
    os.environ["NAVLOOM_RUNTIME_DIR"] = robot.environment["NAVLOOM_RUNTIME_DIR"]
    with Navigator() as navigator:
        listener = Listener(navigator)
        handle = navigator.go(*goal)
        assert next(f for f in handle.updates(timeout=60) if f.state == "driving" and f.distance > 0.0)
        first = listener.commands[-1][0]
        for number in range(swaps):
            navigator.swap("avoider", "forces" if number % 2 == 0 else "improved_vfh")
        assert handle.result is None, "the drive ended before the last swap"
        last = listener.commands[-1][0]
        return listener, handle.wait(300).outcome, (first, last)


def check(listener: Listener, outcome: str, span: tuple[int, int], swaps: int, is_alone: bool) -> None:
    """`outcome` is the live robot's own: no truth is on the wire."""
    ticks = {tick for tick, _ in listener.commands}
    asked = set(range(span[0], span[1] + 1))
    stepped = listener.stepped & asked
    stops = [status.reason for status in listener.statuses if "selection" in status.reason]
    assert (outcome, sorted(stepped - ticks), stops) == ("succeeded", [], [])
    assert len(stepped) > 0.5 * len(asked)
    if is_alone:  # beside other tests the robot may get no processor in some ticks
        assert sorted(asked - ticks) == []
    epochs = [epoch for _, epoch in listener.commands]
    assert epochs == sorted(epochs) and max(epochs) == swaps
    assert [selection.epoch for selection in listener.selections][-swaps:] == list(range(1, swaps + 1))


@pytest.mark.parametrize(
    ("swaps", "speed", "handover"),
    [
        pytest.param(6, 0.3, "when_blocked", id="six"),
        pytest.param(200, 0.1, "when_blocked", id="two-hundred", marks=pytest.mark.slow),
    ],
)
def test_every_tick_has_a_command_and_two_instances_never_drive_at_once(
    swaps: int, speed: float, handover: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = tmp_path / "swaps.toml"
    config.write_text(CONFIG.format(speed=speed, handover=handover), "utf-8")
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", "")
    with up(str(config)) as robot:
        robot.wait_for("every node is there")
        goal = (0.0, 2.6) if swaps < 10 else (0.0, 7.6)
        check(*swap_while_driving(robot, swaps, goal), swaps, is_alone=swaps > 100)
