"""Browsers that are slow, frozen or killed delay nothing: neither what another page sees, nor its STOP."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import pytest
from dashboard_rig import WAIT, Served, frames, served
from live_rig import EMPTY, up
from slow_link import slow_link
from websockets.sync.client import ClientConnection

ROBOT = "lab/r1"
TICK = 0.05
"""Tick of the robot, s: what is faster than it is no delay."""
RATE, LATENCY = 12_500.0, 5.0
"""Of the slow link: 100 kbit/s, and s each way."""
LOOKS = 60
"""Number of poses, and of stops, from which a delay is taken."""
BEHIND = 5
"""Number of kinds of frames that wait for a page that is behind: of state, pose, two scans, events, members, map."""
READER = """
import socket, sys
from dashboard_rig import Browser
browser = Browser(int(sys.argv[1]))
browser.cookie = sys.argv[2]
narrow = socket.socket()
narrow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
narrow.connect(("127.0.0.1", browser.port))
with browser.socket("/ws/lab/r1", sock=narrow) as page:
    for _ in page:
        print(flush=True)
"""
"""A browser in a process of its own, which says of each frame that it has come."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A dashboard of a robot whose frames are far more than the slow link can carry."""
    folder = tmp_path_factory.mktemp("robot")
    (folder / "robot.toml").write_text(f'{EMPTY}\n[[sensor]]\nname = "laser"\nkind = "laser_2d"\nbeams = 1080\n')
    with (
        up(str(folder / "robot.toml")) as robot,
        patch.dict(os.environ, robot.environment),
        served(folder / "recordings", ROBOT) as made,
    ):
        robot.wait_for("every node is there")
        browser = made.browser("operate")
        while browser.ask(f"/api/{ROBOT}/doctor").status != 200:
            pass
        yield made


class Delays(NamedTuple):
    """Of a page: greatest age of its poses but a few, and the usual time until its STOP is sent, s."""

    age: float
    stop: float


def delays(site: Served) -> Delays:
    """What a good page notices now."""
    browser = site.browser("operate")
    with browser.socket(f"/ws/{ROBOT}") as page:
        ages = [pose["age"] for pose in frames(page, "pose", LOOKS)]
    with browser.socket(f"/stop/{ROBOT}") as stop:
        times = [stop_time(stop, number) for number in range(LOOKS)]
    return Delays(float(np.percentile(ages, 90)), float(np.median(times)))


def stop_time(stop: ClientConnection, number: int) -> float:
    began = time.monotonic()
    stop.send(json.dumps({"n": number}))
    while json.loads(stop.recv(timeout=WAIT)).get("n") != number:
        pass
    return time.monotonic() - began


def wait_until_behind(site: Served) -> None:
    """Wait until frames of several kinds wait for a page: its connection is full."""
    link, limit = site.dashboard.robots[ROBOT], time.monotonic() + WAIT
    while max((len(outbox) for outbox in link._outboxes), default=0) < BEHIND:
        assert time.monotonic() < limit
        time.sleep(0.01)


@contextmanager
def slow(site: Served) -> Iterator[None]:
    """A page that reads over a slow link, and has got a frame."""
    browser = site.browser("view")
    cookie = browser.cookie
    with slow_link(site.port, RATE, LATENCY) as port:
        browser = type(browser)(port)
        browser.cookie = cookie
        with browser.socket(f"/ws/{ROBOT}", open_timeout=WAIT, ping_interval=None, max_queue=1) as page:
            frames(page, "pose")
            wait_until_behind(site)
            yield
            frames(page, "pose")  # it is still connected


def test_a_robot_is_not_driven_by_hand_over_a_link_that_shows_it_late(site: Served) -> None:
    browser = site.browser("operate")
    browser.act("resume")
    with slow_link(site.port, 1e6, 1.0) as port:
        far = type(browser)(port)
        far.cookie = browser.cookie
        with far.socket(f"/teleop/{ROBOT}", open_timeout=WAIT) as wheel, browser.socket(f"/ws/{ROBOT}") as page:
            said: dict[str, Any] = {"limited_by": ""}
            while "the link is too slow to drive: 2." not in (said["limited_by"] or ""):
                wheel.send(json.dumps({"v": 0.3, "w": 0.0, "n": 1, "heard": said.get("at")}))
                said = json.loads(wheel.recv(timeout=WAIT))
                assert said["held"] is False
            assert max(abs(now["v"]) for now in frames(page, "state", 20)) < 0.01


@contextmanager
def with_signal(site: Served, number: int) -> Iterator[None]:
    """A page that has read a while, and whose process then gets a signal."""
    given = [str(site.port), site.browser("view").cookie]
    child = subprocess.Popen(
        [sys.executable, "-c", READER, *given], cwd=Path(__file__).parent, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    try:
        for _ in range(LOOKS):
            assert child.stdout.readline() == "\n"
        child.send_signal(number)
        if number == signal.SIGSTOP:
            wait_until_behind(site)
        yield
    finally:
        child.kill()
        child.wait()


def killed(site: Served) -> AbstractContextManager[None]:
    return with_signal(site, signal.SIGKILL)


def frozen(site: Served) -> AbstractContextManager[None]:
    return with_signal(site, signal.SIGSTOP)


@pytest.mark.parametrize("bad", [slow, frozen, killed])
def test_a_bad_page_delays_neither_what_another_one_sees_nor_its_stop(
    site: Served, bad: Callable[[Served], AbstractContextManager[None]]
) -> None:
    alone = delays(site)
    with bad(site):
        beside = delays(site)
    assert beside.age < 3.0 * max(alone.age, TICK) and beside.stop < 3.0 * max(alone.stop, TICK)
