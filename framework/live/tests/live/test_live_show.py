"""Observers of a live robot do not block what publishes, and its drives keep what they hear."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.messages import Contact, Envelope, GoalResult, Message, Point2D, Pose2D, PoseEstimate, Twist2D
from navloom.plugins.run_observers import Onlooker
from navloom_live.drives.live_observers import LiveShow
from navloom_live.drives.live_run import LiveRun
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.process_streams import Switchboard
from navloom_live.operating.client import Client
from toys import discovery, toy_config


class Board:
    """Keeps the requested inlets, by role and port."""

    def __init__(self) -> None:
        self.inlets: dict[tuple[str, str], Inlet] = {}

    def inlet(self, source: tuple[str, str], port: str, mailbox: Mailbox, limit: int | None) -> Inlet:
        inlet = self.inlets[source[0], port] = Inlet(f"{source[0]}/{port}", mailbox, limit)
        return inlet


class Slow:
    wants = frozenset({("platform", "contact")})

    def __init__(self) -> None:
        self.seen: list[int] = []
        self.goes_on, self.is_there = threading.Event(), threading.Event()

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        self.is_there.set()
        self.goes_on.wait(30.0)
        self.seen.append(at.tick)


def test_observers_of_a_live_robot_run_in_their_own_thread(tmp_path: Path) -> None:
    system, board, slow = assemble(toy_config(tmp_path), discovery()), Board(), Slow()
    show = LiveShow(system, cast(Switchboard, board), [Onlooker(slow, print)], lambda role, name: True)
    assert list(board.inlets) == [("platform", "contact")]
    for tick in range(3):
        board.inlets["platform", "contact"].give((Contact(False), Envelope("k", 1, tick, 0, 0, 0)))  # does not block
    assert slow.is_there.wait(30.0) and slow.seen == []
    slow.goes_on.set()
    show.close()
    assert slow.seen == [0, 1, 2]


def drive_of(*reads: tuple[str, str]) -> tuple[LiveRun, Callable[[int], PoseEstimate]]:
    """A live run of the paper's robot, and a function that gives it a pose at a run time, s."""
    run = LiveRun(load_config("paper"), None, True, print, reads=frozenset(reads))
    name = dict(reversed(all_sources(run.system)))["localizer"]

    def note(time: int) -> PoseEstimate:
        stamp_ns = time * 10**9
        pose = PoseEstimate(stamp_ns, Pose2D(2.0, 1.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
        run._note(("localizer", name), "pose", pose, Envelope("pose", 20, 20, stamp_ns, stamp_ns, 0))
        return pose

    return run, note


def test_a_drive_keeps_the_poses_and_the_streams_that_metrics_read() -> None:
    run, note = drive_of(("localizer", "pose"))
    run._begin(1, 0)
    pose = note(1)
    assert run.recorder.estimates == [(1.0, 2.0, 1.0, 0.0)]
    assert run.recorder.streams == {("localizer", "pose"): [(1.0, pose)]}


def test_a_robot_that_stands_before_its_first_goal_and_after_its_last_keeps_no_more_data(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run, note = drive_of()
    monkeypatch.setattr(run, "_learn_times", lambda client: None)
    note(1)
    run._begin(1, 0)
    note(2)
    run._end(GoalResult(1, "succeeded", "", Point2D(2.0, 1.0)))
    run._tell_ended(cast(Client, None), None)
    for time in (12, 13, 1000):  # 10 s after the end, and later
        note(time)
    assert [row[0] for row in run.recorder.estimates] == [2.0, 12.0]
    run._begin(2, 0)
    note(1001)
    assert [round(row[0]) for row in run.recorder.estimates] == [1001]
