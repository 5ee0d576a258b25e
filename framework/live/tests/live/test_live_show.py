"""Observers of a live robot do not block what publishes, and its drives keep what they hear."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import cast

import numpy as np
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.messages import Contact, Envelope, Message, Pose2D, PoseEstimate, Twist2D
from navloom.plugins.run_observers import Onlooker
from navloom_live.drives.live_observers import LiveShow
from navloom_live.drives.live_run import LiveRun
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.process_streams import Switchboard
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


def test_a_drive_keeps_the_poses_and_the_streams_that_metrics_read() -> None:
    run = LiveRun(load_config("paper"), None, True, print, reads=frozenset({("localizer", "pose")}))
    name = dict(reversed(all_sources(run.system)))["localizer"]
    pose = PoseEstimate(10**9, Pose2D(2.0, 1.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
    run._note(("localizer", name), "pose", pose, Envelope("pose", 20, 20, 10**9, 10**9, 0))
    assert run.recorder.estimates == [(1.0, 2.0, 1.0, 0.0)]
    assert run.recorder.streams == {("localizer", "pose"): [(1.0, pose)]}
