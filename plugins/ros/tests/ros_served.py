"""A simulated robot behind `navloom ros serve`, and a client of its actions, as fixtures."""

import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from navloom_ros.actions import ActionClient
from navloom_ros.node import Node
from navloom_ros.serving.adapter import hits
from navloom_ros.serving.behaviours import Behaviours
from navloom_ros.serving.goals import ACTIONS, Goals
from navloom_ros.serving.planning import Planning
from ros_golden import KILTED
from ros_network import Router


class Handle:
    """A goal that the robot executes; the test ends it."""

    def __init__(self):
        self.result = None
        self._news = threading.Event()

    def updates(self, timeout):
        if not self._news.wait(timeout):
            raise TimeoutError
        if self.result is None:
            self._news.clear()
            yield SimpleNamespace(time_left=2.5, recoveries=1, distance=self.distance)

    def tell(self, distance=1.25):
        self.distance = distance
        self._news.set()

    def end(self, outcome, reason="", code=""):
        self.result = SimpleNamespace(outcome=outcome, reason=reason, code=code)
        self._news.set()

    def cancel(self):
        self.end("cancelled", "as asked")


class Robot:
    def __init__(self):
        self.limits = []
        self.asked, self.handles, self.planned, self.cleared, self.sent = [], [], [], 0, []

    def plan(self, start, goal):
        self.planned.append((start, goal))
        if goal[0] > 5.0:
            return [], "goal_occupied", "the goal is occupied"
        return [(0.5, 0.0), (0.5, 1.0), (2.0, 1.0)], "", ""

    def limit_speed(self, speed, is_percentage):
        if speed < 0.0:
            raise RuntimeError("expected 0 or more")
        self.limits.append((speed, is_percentage))

    def clear_map(self):
        self.cleared += 1

    def driving(self):
        return nullcontext(SimpleNamespace(send=self.move, limit="an obstacle"))

    def move(self, vx, wz_deg):
        """For 0.05 s, without inertia, up to a wall at x = 1."""
        self.sent.append((vx, wz_deg))
        x, y, heading = self.goals.pose
        heading += np.radians(wz_deg) * 0.05
        self.goals.pose = min(1.0, x + vx * np.cos(heading) * 0.05), y + vx * np.sin(heading) * 0.05, heading

    def go(self, x, y, heading=None, via=()):
        if x > 100.0:
            raise RuntimeError("rejected: outside the map")
        self.asked.append((x, y, heading, list(via)))
        self.handles.append(Handle())
        return self.handles[-1]


@pytest.fixture(scope="module", name="network")
def served_network():
    with Router() as router, Node("served", router=router.endpoint, types=KILTED) as served:
        said = []
        goals = Goals(served, "map", (RuntimeError,), said.append)
        Behaviours(served, goals, (RuntimeError,), lambda seconds: time.sleep(0.0005))
        Planning(served, goals, "map", (RuntimeError,), hits)
        with Node("rviz", router=router.endpoint, types=KILTED) as rviz:
            clients = {kind: ActionClient(rviz, name, kind) for name, kind in ACTIONS.items()}
            assert all(client.wait(5.0) for client in clients.values())
            yield SimpleNamespace(served=served, rviz=rviz, goals=goals, clients=clients, router=router, said=said)
        goals.close()


BEHAVIOURS = {"Spin": "spin", "BackUp": "backup", "DriveOnHeading": "drive_on_heading"}


@pytest.fixture(name="robot")
def served_robot(network):
    one = network.goals.robot = Robot()
    one.goals = network.goals
    network.goals.pose = (0.5, 0.0, 0.0)
    network.said.clear()
    yield one
    for handle in one.handles:
        handle.end("cancelled")
    network.goals.robot = None


def pose(x, y, heading=0.0, frame="map"):
    orientation = {"z": np.sin(heading / 2), "w": np.cos(heading / 2)}
    return {"header": {"frame_id": frame}, "pose": {"position": {"x": x, "y": y}, "orientation": orientation}}


def ended(sent):
    return sent.result(5.0).result(6.0)
